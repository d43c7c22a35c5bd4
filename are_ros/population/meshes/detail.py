"""Parts from which the finer bodies of vehicles and things are made: hulls, wheels, soft boxes."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.population.meshes.shapes import Colour, Point, Solid, joined, loft, mirrored, turned
from are_ros.world.rigid_transform import product

Floats = npt.NDArray[np.float64]

TYRE: Final[Colour] = (0.055, 0.055, 0.06, 1.0)
RUBBER: Final[Colour] = (0.1, 0.1, 0.11, 1.0)
RIM: Final[Colour] = (0.66, 0.67, 0.69, 1.0)
STEEL: Final[Colour] = (0.55, 0.57, 0.6, 1.0)
DARK: Final[Colour] = (0.07, 0.075, 0.085, 1.0)
GLASS: Final[Colour] = (0.13, 0.17, 0.2, 1.0)
HEADLIGHT: Final[Colour] = (0.93, 0.95, 0.98, 1.0)
TAIL_LIGHT: Final[Colour] = (0.72, 0.03, 0.05, 1.0)
AMBER: Final[Colour] = (0.98, 0.55, 0.05, 1.0)
WHITE: Final[Colour] = (0.93, 0.93, 0.92, 1.0)
BLACK: Final[Colour] = (0.08, 0.08, 0.08, 1.0)
YELLOW: Final[Colour] = (0.96, 0.78, 0.05, 1.0)
SEAT: Final[Colour] = (0.14, 0.13, 0.13, 1.0)


def shaded(colour: Sequence[float], factor: float) -> Colour:
    """Return a colour that is lighter or darker by a factor."""
    red, green, blue = (min(max(factor * part, 0.0), 1.0) for part in colour[:3])
    return red, green, blue, 1.0


def shade_of(colour: Sequence[float], random: np.random.Generator, spread: float) -> Colour:
    """Return a shade near a colour: up to `spread` lighter or darker, a little warmer or cooler."""
    factor = 1.0 + random.uniform(-spread, spread)
    cast = 1.0 + 0.2 * spread * random.uniform(-1.0, 1.0)
    return shaded((colour[0] * cast, colour[1], colour[2] / cast), float(factor))


@dataclass(frozen=True)
class BodySpec:
    """What to build: the size of the box (length, width, height) [m], the row's colour, features.

    `generator` makes the bodies of a row differ.
    """

    size_m: Point
    colour: Colour
    generator: np.random.Generator
    features: Mapping[str, str]

    def paint(self, spread: float) -> Colour:
        """Return a shade near the row's colour, as `shade_of`."""
        return shade_of(self.colour, self.generator, spread)


def soft_box(low: Point, high: Point, edge_m: float, colour: Colour) -> Solid:
    """Return a cuboid from its low to its high corner whose edges are cut off by `edge_m`."""
    edge = min(edge_m, *(0.49 * (b - a) for a, b in zip(low, high, strict=True)))
    (x0, y0, z0), (x1, y1, z1) = low, high

    def ring(inset: float, z: float) -> list[Point]:
        a, b, c, d = x0 + inset, x1 - inset, y0 + inset, y1 - inset
        return [
            (a + edge, c, z), (b - edge, c, z), (b, c + edge, z), (b, d - edge, z),
            (b - edge, d, z), (a + edge, d, z), (a, d - edge, z), (a, c + edge, z),
        ]  # fmt: skip

    edge *= 0.999  # so that no side of the inner rings is of length zero
    rings = [ring(edge / 2, z0), ring(0.0, z0 + edge / 2), ring(0.0, z1 - edge / 2)]
    return loft([*rings, ring(edge / 2, z1)], colour)


def lying(solid: Solid, at: Point) -> Solid:
    """Return a solid whose z axis is laid along +y, moved to a place."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return Solid(product(solid.vertices_m, turn) + at, solid.faces, solid.colours)


def half_turned(solid: Solid) -> Solid:
    """Return a solid turned by half a turn about the vertical."""
    return Solid(solid.vertices_m * (-1.0, -1.0, 1.0), solid.faces, solid.colours)


def tilted(solid: Solid, about: tuple[float, float], angle_rad: float) -> Solid:
    """Return a solid turned about the y axis through (x, z); a positive angle leans backwards."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    turn = np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
    pivot = np.array((about[0], 0.0, about[1]))
    return Solid(product(solid.vertices_m - pivot, turn.T) + pivot, solid.faces, solid.colours)


def rod(start: Point, end: Point, radius_m: float, colour: Colour, sides: int = 8) -> Solid:
    """Return a round rod between two points."""
    a, b = np.array(start), np.array(end)
    axis = (b - a) / np.linalg.norm(b - a)
    aside = np.cross(axis, (1.0, 0.0, 0.0) if abs(axis[0]) < 0.9 else (0.0, 1.0, 0.0))
    aside /= np.linalg.norm(aside)
    third = np.cross(axis, aside)
    turns = math.tau * np.arange(sides) / sides
    circle = radius_m * (np.outer(np.cos(turns), aside) + np.outer(np.sin(turns), third))
    return loft(np.stack((a + circle, b + circle)), colour)


def wheels(xs: Sequence[float], y: float, radius_m: float, width_m: float) -> list[Solid]:
    """Return a pair of wheels with rims at each x; their outer sides are `y` from the middle."""
    return [side for x in xs for side in mirrored(_wheel((x, y, radius_m), width_m))]


def _wheel(outer: Point, width_m: float) -> Solid:
    """Return a wheel about the y axis, on the left; `outer` is the middle of its outer side."""
    x, y, radius = outer
    soft = min(0.12 * radius, 0.25 * width_m)
    tyre = [
        (-width_m, radius - soft), (-width_m + soft, radius), (-1.6 * soft, radius),
        (-0.4 * soft, radius - 0.5 * soft), (0.0, radius - 1.6 * soft),
    ]  # fmt: skip
    hub = 0.66 * radius
    parts = [
        turned(tyre, TYRE, sides=16),
        turned([(-0.01, 1.04 * hub), (0.002, hub)], RIM, sides=12),
        turned([(-0.01, 0.9 * hub), (0.003, 0.9 * hub)], DARK, sides=10),
        turned([(-0.01, 0.22 * hub), (0.006, 0.2 * hub)], RIM, sides=6),
    ]
    for turn in math.tau * np.arange(5) / 5 + 0.3:
        along = np.array((math.cos(turn), math.sin(turn)))
        across = 0.11 * hub * np.array((-along[1], along[0]))
        corners = [0.1 * hub * along - across, hub * along - 0.8 * across]
        ring = np.array(
            [corners[0], corners[1], hub * along + 0.8 * across, 0.1 * hub * along + across]
        )
        rings = [np.column_stack((ring, np.full(4, z))) for z in (-0.005, 0.0055)]
        parts.append(loft(np.stack(rings), RIM))
    return lying(joined(parts), (x, y, radius))


def hull(
    xs_m: Floats, sections_m: Floats, tone_at: Callable[[float, int], Colour], under: Colour
) -> Solid:
    """Return the skin over the sections of a vehicle, from its rear to its front.

    `xs_m` (S,) rise; `sections_m` (S, K, 2) are the left halves (y > 0, z) of the sections, from
    below to above. `tone_at(x, k)` is the colour of the stripe from point k to k + 1 near x; K - 1
    is the stripe over the roof. The bottom and both ends have the colour `under`.
    """
    right = sections_m[:, ::-1] * (-1.0, 1.0)
    rings = np.concatenate((sections_m, right), axis=1)
    count, sides = rings.shape[:2]
    points = np.concatenate(
        (np.broadcast_to(xs_m[:, np.newaxis, np.newaxis], (count, sides, 1)), rings), axis=2
    )
    skin = loft(points, under)
    half = sections_m.shape[1]
    stripes = [*range(half), *range(half - 2, -1, -1)]
    colours = skin.colours.copy()
    for band in range(count - 1):
        x = 0.5 * float(xs_m[band] + xs_m[band + 1])
        tones = [*(tone_at(x, k) for k in stripes), under]
        colours[2 * band * sides : 2 * (band + 1) * sides] = tones * 2
    return Solid(skin.vertices_m, skin.faces, colours)


def stations(
    keys: Sequence[tuple[float, Sequence[tuple[float, float]]]],
    arches: Sequence[tuple[float, float, float]],
    cuts_m: Sequence[float],
) -> tuple[Floats, Floats]:
    """Return xs (S,) and sections (S, K, 2) between key sections, with wheel arches cut out.

    An arch is x, z and radius of its circle. `cuts_m` are more places that need a section.
    """
    at = np.array([x for x, _ in keys])
    given = np.array([section for _, section in keys])
    wanted = [*at, *cuts_m]
    for x, _, radius in arches:
        wanted += [x + radius * math.cos(turn) for turn in np.linspace(0.0, math.pi, 7)]
        wanted += [x - 1.02 * radius, x + 1.02 * radius]
    xs = np.unique(np.clip(np.round(wanted, 4), at[0], at[-1]))
    xs = xs[np.concatenate(([True], np.diff(xs) > 0.003))]
    sections = np.empty((len(xs), *given.shape[1:]))
    for point in range(given.shape[1]):
        for axis in range(2):
            sections[:, point, axis] = np.interp(xs, at, given[:, point, axis])
    for x, z, radius in arches:
        rise = np.sqrt(np.maximum(radius**2 - (xs - x) ** 2, 0.0))
        low = np.where(np.abs(xs - x) <= radius, z + rise, -np.inf)
        for point in range(given.shape[1]):
            sections[:, point, 1] = np.maximum(sections[:, point, 1], low + 0.004 * point)
    return xs, sections
