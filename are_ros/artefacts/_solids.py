"""Closed triangle surfaces from a few lofted rings: what the procedural shapes are made of."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Colour = tuple[float, float, float, float]
Point = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed surface, normals outwards, as arrays; several closed parts may be one solid.

    `vertices_m` float64 (V, 3), `faces` int64 (F, 3) counter-clockwise seen from outside,
    `colours` float64 (F, 4), red, green, blue, alpha in [0, 1].
    """

    vertices_m: npt.NDArray[np.float64]
    faces: npt.NDArray[np.int64]
    colours: npt.NDArray[np.float64]

    def centre_of_mass_m(self) -> npt.NDArray[np.float64]:
        """Return the centre of mass (3,), of uniform density; where parts overlap, mass adds."""
        corners = self.vertices_m[self.faces]
        volumes = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
        centroids: npt.NDArray[np.float64] = corners.sum(axis=1) / 4.0
        centre_m: npt.NDArray[np.float64] = volumes @ centroids / volumes.sum()
        return centre_m

    def fitted(self, size_m: Point) -> "Solid":
        """Scale along the axes to this size, standing on z = 0 over the origin."""
        low, high = self.vertices_m.min(axis=0), self.vertices_m.max(axis=0)
        unit = (self.vertices_m - low) / (high - low)
        vertices_m = (unit - (0.5, 0.5, 0.0)) * size_m
        return Solid(vertices_m, self.faces, self.colours)


def joined(parts: Sequence[Solid]) -> Solid:
    """Put solids into one, each with its own vertices."""
    starts = np.cumsum([0] + [len(part.vertices_m) for part in parts[:-1]])
    return Solid(
        np.concatenate([part.vertices_m for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
        np.concatenate([part.colours for part in parts]),
    )


def loft(rings: npt.ArrayLike, colour: Colour) -> Solid:
    """Skin (R >= 2, K >= 3, 3) rings: quadrilaterals between neighbours, a fan over each end.

    The rings are convex and run counter-clockwise seen from the last one's side.
    """
    points = np.asarray(rings, dtype=np.float64)
    count, sides = points.shape[:2]
    here = np.arange(sides)
    after = (here + 1) % sides
    faces = []
    for start in range(0, (count - 1) * sides, sides):
        a, b, c, d = start + here, start + after, start + sides + after, start + sides + here
        faces += [np.column_stack((a, b, c)), np.column_stack((a, c, d))]
    fan = np.column_stack((np.zeros(sides - 2, dtype=np.int64), here[1:-1], here[2:]))
    faces += [fan[:, ::-1], fan + (count - 1) * sides]
    stacked = np.concatenate(faces).astype(np.int64)
    return Solid(points.reshape(-1, 3), stacked, np.tile(colour, (len(stacked), 1)))


def box(low: Point, high: Point, colour: Colour) -> Solid:
    """Make a cuboid from its low to its high corner."""
    return tapered((*low[:2], *high[:2]), low[2], (*low[:2], *high[:2]), high[2], colour)


def tapered(
    bottom: tuple[float, float, float, float],
    bottom_z: float,
    top: tuple[float, float, float, float],
    top_z: float,
    colour: Colour,
) -> Solid:
    """Make a frustum between two rectangles (low x, low y, high x, high y)."""
    rings = [
        [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
        for (x0, y0, x1, y1), z in ((bottom, bottom_z), (top, top_z))
    ]
    return loft(rings, colour)


def turned(
    profile: Sequence[tuple[float, float]],
    colour: Colour,
    *,
    at: tuple[float, float] = (0.0, 0.0),
    squash: tuple[float, float] = (1.0, 1.0),
    sides: int = 8,
) -> Solid:
    """Turn a profile of (height, radius > 0), upwards, about the vertical through `at`."""
    angles = math.tau * np.arange(sides) / sides
    circle = np.column_stack((np.cos(angles) * squash[0], np.sin(angles) * squash[1]))
    rings = [np.column_stack((circle * r + at, np.full(sides, z))) for z, r in profile]
    return loft(np.stack(rings), colour)


def extruded(
    profile: Sequence[tuple[float, float]], low_y: float, high_y: float, colour: Colour
) -> Solid:
    """Extrude a convex (x, z) profile, clockwise as drawn with x to the right, along y."""
    rings = [[(x, y, z) for x, z in profile] for y in (low_y, high_y)]
    return loft(rings, colour)


def wheel(centre: Point, radius: float, width: float, colour: Colour, sides: int = 10) -> Solid:
    """Make a wheel that turns about the y axis."""
    angles = [math.tau * side / sides for side in range(sides)]
    rim = [
        (centre[0] + radius * math.sin(angle), centre[2] + radius * math.cos(angle))
        for angle in angles
    ]
    return extruded(rim, centre[1] - width / 2, centre[1] + width / 2, colour)


def mirrored(part: Solid) -> list[Solid]:
    """Return the part and its mirror image in the plane y = 0."""
    return [part, Solid(part.vertices_m * (1.0, -1.0, 1.0), part.faces[:, ::-1], part.colours)]
