"""The built-in shapes that a row of the catalogue may name: people, robots, vehicles, things.

Each maker takes the row's colour; `build_shape` scales its solid to the row's size.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from are_ros.world.rigid_transform import product

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
        return np.asarray(product(volumes, centroids) / volumes.sum())

    def fitted(self, size_m: Point) -> "Solid":
        """Scale along the axes to this size, standing on z = 0 over the origin."""
        low, high = self.vertices_m.min(axis=0), self.vertices_m.max(axis=0)
        unit = (self.vertices_m - low) / (high - low)
        vertices_m = (unit - (0.5, 0.5, 0.0)) * size_m
        return Solid(vertices_m, self.faces, self.colours)


def joined(parts: Sequence[Solid]) -> Solid:
    """Return several solids as one, each with its own vertices."""
    starts = np.cumsum([0] + [len(part.vertices_m) for part in parts[:-1]])
    return Solid(
        np.concatenate([part.vertices_m for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
        np.concatenate([part.colours for part in parts]),
    )


def loft(rings: npt.ArrayLike, colour: Colour) -> Solid:
    """Return the surface over rings (R >= 2, K >= 3, 3): quadrilaterals, and a fan at each end.

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
    """Return a cuboid from its low to its high corner."""
    return tapered((*low[:2], *high[:2]), low[2], (*low[:2], *high[:2]), high[2], colour)


def tapered(
    bottom: tuple[float, float, float, float],
    bottom_z: float,
    top: tuple[float, float, float, float],
    top_z: float,
    colour: Colour,
) -> Solid:
    """Return a frustum between two rectangles (low x, low y, high x, high y)."""
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
    """Return the body of revolution of (height, radius > 0), upwards, about a vertical at `at`."""
    angles = math.tau * np.arange(sides) / sides
    circle = np.column_stack((np.cos(angles) * squash[0], np.sin(angles) * squash[1]))
    rings = [np.column_stack((circle * r + at, np.full(sides, z))) for z, r in profile]
    return loft(np.stack(rings), colour)


def extruded(
    profile: Sequence[tuple[float, float]], low_y: float, high_y: float, colour: Colour
) -> Solid:
    """Return the extrusion of a convex (x, z) profile along y, clockwise with x to the right."""
    rings = [[(x, y, z) for x, z in profile] for y in (low_y, high_y)]
    return loft(rings, colour)


def wheel(centre: Point, radius: float, width: float, colour: Colour, sides: int = 10) -> Solid:
    """Return a wheel that turns about the y axis."""
    angles = [math.tau * side / sides for side in range(sides)]
    rim = [
        (centre[0] + radius * math.sin(angle), centre[2] + radius * math.cos(angle))
        for angle in angles
    ]
    return extruded(rim, centre[1] - width / 2, centre[1] + width / 2, colour)


def mirrored(part: Solid) -> list[Solid]:
    """Return the part and its mirror image in the plane y = 0."""
    return [part, Solid(part.vertices_m * (1.0, -1.0, 1.0), part.faces[:, ::-1], part.colours)]


_SKIN: Colour = (0.85, 0.65, 0.52, 1.0)
_HAIR: Colour = (0.25, 0.17, 0.12, 1.0)
_TROUSERS: Colour = (0.17, 0.19, 0.27, 1.0)
_SHOE: Colour = (0.1, 0.1, 0.1, 1.0)
_TYRE: Colour = (0.08, 0.08, 0.08, 1.0)
_METAL: Colour = (0.55, 0.57, 0.6, 1.0)
_SENSOR: Colour = (0.12, 0.12, 0.14, 1.0)
_SCREEN: Colour = (0.2, 0.55, 0.75, 1.0)
_GLASS: Colour = (0.25, 0.33, 0.4, 1.0)
_HEADLIGHT: Colour = (1.0, 0.95, 0.7, 1.0)
_TAIL_LIGHT: Colour = (0.8, 0.05, 0.05, 1.0)
_SEAT: Colour = (0.15, 0.15, 0.15, 1.0)
_FRAME: Colour = (0.3, 0.3, 0.32, 1.0)
_WOOD: Colour = (0.72, 0.55, 0.35, 1.0)
_CARDBOARD: Colour = (0.7, 0.53, 0.34, 1.0)
_WHITE: Colour = (0.95, 0.95, 0.95, 1.0)
_BLACK: Colour = (0.12, 0.12, 0.12, 1.0)
_STEEL: Colour = (0.6, 0.6, 0.62, 1.0)


def person(colour: Colour) -> Solid:
    """Return a person 1.75 m tall, standing, arms down; the shirt has the row's colour."""
    leg = turned([(0.08, 0.06), (0.85, 0.095)], _TROUSERS, at=(-0.02, 0.11), sides=6)
    shoe = box((-0.1, 0.05, 0.0), (0.17, 0.17, 0.08), _SHOE)
    arm = turned([(0.72, 0.045), (1.42, 0.06)], colour, at=(-0.01, 0.24), sides=6)
    hand = box((-0.04, 0.21, 0.62), (0.05, 0.28, 0.72), _SKIN)
    torso = turned(
        [(0.83, 0.16), (1.05, 0.17), (1.38, 0.2), (1.47, 0.12)], colour, squash=(0.62, 1.0)
    )
    neck = turned([(1.46, 0.055), (1.54, 0.055)], _SKIN, sides=6)
    head = turned(
        [(1.5, 0.05), (1.56, 0.09), (1.66, 0.1)], _SKIN, at=(0.01, 0.0), squash=(1.05, 0.85)
    )
    hair = turned(
        [(1.66, 0.105), (1.72, 0.09), (1.75, 0.04)], _HAIR, at=(0.0, 0.0), squash=(1.05, 0.87)
    )
    pairs = [side for part in (leg, shoe, arm, hand) for side in mirrored(part)]
    return joined([*pairs, torso, neck, head, hair])


def disc_robot(colour: Colour) -> Solid:
    """Return a robot: a round base with two plates and a laser scanner on top."""
    base = turned([(0.03, 0.16), (0.05, 0.18), (0.14, 0.18)], colour, sides=14)
    plate = turned([(0.3, 0.17), (0.32, 0.17)], colour, sides=14)
    post = box((-0.1, 0.1, 0.14), (-0.08, 0.12, 0.3), _METAL)
    front = box((0.08, 0.1, 0.14), (0.1, 0.12, 0.3), _METAL)
    scanner = turned([(0.32, 0.05), (0.37, 0.05)], _SENSOR, at=(0.06, 0.0), sides=10)
    wheels = mirrored(wheel((0.0, 0.14, 0.05), 0.05, 0.03, _TYRE))
    return joined([base, plate, *mirrored(post), *mirrored(front), scanner, *wheels])


def cart_robot(colour: Colour) -> Solid:
    """Return a delivery robot: a box on four wheels, a sensor in front and a flag behind."""
    hull = extruded(
        [(-0.4, 0.15), (-0.4, 0.55), (0.32, 0.55), (0.42, 0.4), (0.42, 0.15)], -0.24, 0.24, colour
    )
    lid = box((-0.36, -0.21, 0.55), (0.28, 0.21, 0.58), _METAL)
    eye = box((0.38, -0.12, 0.3), (0.43, 0.12, 0.36), _SENSOR)
    flag_pole = box((-0.36, -0.01, 0.58), (-0.34, 0.01, 0.9), _METAL)
    flag = box((-0.5, -0.005, 0.8), (-0.36, 0.005, 0.9), (0.9, 0.35, 0.1, 1.0))
    scanner = turned([(0.58, 0.05), (0.65, 0.05)], _SENSOR, at=(0.18, 0.0), sides=10)
    wheels = [
        side for x in (-0.26, 0.26) for side in mirrored(wheel((x, 0.28, 0.12), 0.12, 0.08, _TYRE))
    ]
    return joined([hull, lid, eye, flag_pole, flag, scanner, *wheels])


def serving_robot(colour: Colour) -> Solid:
    """Return a service robot: three trays between two posts, with a screen."""
    base = tapered((-0.25, -0.24, 0.25, 0.24), 0.04, (-0.22, -0.22, 0.22, 0.22), 0.28, colour)
    wheels = mirrored(wheel((0.0, 0.2, 0.07), 0.07, 0.05, _TYRE))
    post = box((-0.2, 0.17, 0.28), (-0.15, 0.21, 1.1), _METAL)
    trays = [box((-0.2, -0.22, z), (0.23, 0.22, z + 0.03), colour) for z in (0.5, 0.75, 1.0)]
    head = tapered((-0.22, -0.16, -0.08, 0.16), 1.06, (-0.24, -0.14, -0.14, 0.14), 1.3, colour)
    screen = tapered((-0.09, -0.13, -0.07, 0.13), 1.08, (-0.15, -0.12, -0.13, 0.12), 1.28, _SCREEN)
    return joined([base, *wheels, *mirrored(post), *trays, head, screen])


def _wheels(front: float, rear: float, y: float, radius: float, width: float) -> list[Solid]:
    """Return two axles of two wheels that stand on the ground."""
    return [
        side
        for x in (front, rear)
        for side in mirrored(wheel((x, y, radius), radius, width, _TYRE))
    ]


def _lights(front: float, rear: float, y: float, z: float) -> list[Solid]:
    """Return two headlights at x = `front` and two tail lights at x = `rear`."""
    head = box((front - 0.06, y - 0.16, z), (front + 0.01, y + 0.16, z + 0.14), _HEADLIGHT)
    tail = box((rear - 0.01, y - 0.16, z + 0.05), (rear + 0.06, y + 0.16, z + 0.19), _TAIL_LIGHT)
    return [*mirrored(head), *mirrored(tail)]


def car(colour: Colour) -> Solid:
    """Return a saloon of 4.4 x 1.8 x 1.45 m: body, cabin of glass, roof, wheels, lights."""
    body = extruded(
        [
            (-2.2, 0.25), (-2.2, 0.8), (-1.7, 0.9), (0.9, 0.9), (2.05, 0.72), (2.2, 0.55),
            (2.2, 0.25),
        ],
        -0.86,
        0.86,
        colour,
    )  # fmt: skip
    cabin = tapered((-1.75, -0.8, 1.05, 0.8), 0.88, (-1.05, -0.62, 0.3, 0.62), 1.38, _GLASS)
    roof = tapered((-1.1, -0.65, 0.35, 0.65), 1.36, (-0.95, -0.58, 0.2, 0.58), 1.45, colour)
    wheels = _wheels(1.35, -1.35, 0.8, 0.32, 0.2)
    return joined([body, cabin, roof, *wheels, *_lights(2.2, -2.2, 0.62, 0.5)])


def van(colour: Colour) -> Solid:
    """Return a box van of 5.0 x 1.95 x 2.0 m: high body, sloped windscreen, side windows."""
    body = extruded(
        [(-2.5, 0.3), (-2.5, 1.98), (1.0, 2.0), (1.9, 1.1), (2.5, 0.95), (2.5, 0.3)],
        -0.92,
        0.92,
        colour,
    )
    screen = extruded([(1.1, 1.92), (1.95, 1.12), (1.85, 1.1), (1.05, 1.85)], -0.8, 0.8, _GLASS)
    window = box((0.2, 0.9, 1.15), (1.1, 0.94, 1.7), _GLASS)
    wheels = _wheels(1.6, -1.5, 0.87, 0.36, 0.22)
    return joined([body, screen, *mirrored(window), *wheels, *_lights(2.5, -2.5, 0.68, 0.6)])


def lorry(colour: Colour) -> Solid:
    """Return a lorry of 7.2 x 2.4 x 3.2 m: cab, load box, frame, wheels."""
    cab = extruded([(1.9, 0.5), (1.9, 2.5), (3.2, 2.5), (3.6, 1.5), (3.6, 0.5)], -1.1, 1.1, colour)
    screen = extruded([(3.24, 2.42), (3.62, 1.5), (3.5, 1.5), (3.1, 2.42)], -0.95, 0.95, _GLASS)
    load = box((-3.6, -1.2, 1.0), (1.7, 1.2, 3.2), (0.88, 0.88, 0.86, 1.0))
    frame = box((-3.5, -0.5, 0.6), (2.0, 0.5, 1.0), _FRAME)
    wheels = _wheels(2.7, -2.3, 1.0, 0.5, 0.3)
    return joined([cab, screen, load, frame, *wheels, *_lights(3.6, -3.6, 0.8, 0.65)])


def buggy(colour: Colour) -> Solid:
    """Return an open electric buggy of 2.4 x 1.2 x 1.75 m: tub, bench, posts and roof."""
    floor = box((-1.2, -0.55, 0.25), (0.6, 0.55, 0.36), colour)
    tub = box((-1.2, -0.55, 0.36), (-0.25, 0.55, 0.65), colour)
    nose = extruded(
        [(0.5, 0.25), (0.6, 0.85), (0.8, 0.85), (1.2, 0.5), (1.2, 0.25)], -0.5, 0.5, colour
    )
    bench = box((-0.7, -0.5, 0.65), (-0.2, 0.5, 0.78), _SEAT)
    back = box((-0.8, -0.5, 0.65), (-0.68, 0.5, 1.15), _SEAT)
    posts = [
        side
        for x in (-1.05, 0.62)
        for side in mirrored(box((x, 0.46, 0.6), (x + 0.05, 0.51, 1.68), _FRAME))
    ]
    roof = box((-1.15, -0.56, 1.68), (0.75, 0.56, 1.75), colour)
    return joined(
        [floor, tub, nose, bench, back, *posts, roof, *_wheels(0.8, -0.8, 0.5, 0.23, 0.2)]
    )


def scooter(colour: Colour) -> Solid:
    """Return a mobility scooter of 1.3 x 0.6 x 1.0 m: floor, seat with back, tiller, wheels."""
    floor = box((-0.35, -0.24, 0.14), (0.45, 0.24, 0.2), _SEAT)
    rear = tapered((-0.62, -0.26, -0.02, 0.26), 0.18, (-0.5, -0.22, -0.05, 0.22), 0.42, colour)
    nose = tapered((0.3, -0.2, 0.62, 0.2), 0.2, (0.34, -0.12, 0.46, 0.12), 0.6, colour)
    pillar = box((-0.32, -0.05, 0.42), (-0.24, 0.05, 0.55), _FRAME)
    seat = box((-0.48, -0.22, 0.55), (-0.05, 0.22, 0.63), _SEAT)
    back = tapered((-0.5, -0.21, -0.42, 0.21), 0.63, (-0.6, -0.19, -0.54, 0.19), 1.0, _SEAT)
    tiller = tapered((0.38, -0.03, 0.44, 0.03), 0.58, (0.24, -0.03, 0.3, 0.03), 0.92, _FRAME)
    bar = box((0.22, -0.28, 0.9), (0.3, 0.28, 0.95), _TYRE)
    wheels = _wheels(0.5, -0.45, 0.25, 0.13, 0.08)
    return joined([floor, rear, nose, pillar, seat, back, tiller, bar, *wheels])


def _bottom(colour: Colour, *, blocks: bool) -> list[Solid]:
    """Return three runners with nine blocks (or three beams) of a pallet of 1.2 x 0.8 m."""
    parts = [box((-0.6, y - 0.05, 0.0), (0.6, y + 0.05, 0.022), colour) for y in (-0.35, 0, 0.35)]
    for y in (-0.35, 0.0, 0.35):
        lengths = [(x - 0.07, x + 0.07) for x in (-0.53, 0.0, 0.53)] if blocks else [(-0.6, 0.6)]
        parts += [box((a, y - 0.05, 0.022), (b, y + 0.05, 0.1), colour) for a, b in lengths]
    return parts


def pallet(colour: Colour) -> Solid:
    """Return a flat pallet of 1.2 x 0.8 x 0.144 m: runners, blocks, stringers, deck boards."""
    stringers = [
        box((x - 0.07, -0.4, 0.1), (x + 0.07, 0.4, 0.122), colour) for x in (-0.53, 0, 0.53)
    ]
    boards = [
        box((-0.6, y - 0.06, 0.122), (0.6, y + 0.06, 0.144), colour)
        for y in (-0.34, -0.17, 0.0, 0.17, 0.34)
    ]
    return joined([*_bottom(colour, blocks=True), *stringers, *boards])


def loaded_pallet(colour: Colour) -> Solid:
    """Return a pallet of 1.2 x 0.8 m with boxes up to 1.2 m; its straps are coloured."""
    deck = box((-0.6, -0.4, 0.1), (0.6, 0.4, 0.144), _WOOD)
    crates = [
        box((x + 0.01, y + 0.01, z + 0.005), (x + 0.56, y + 0.36, z + 0.52), _CARDBOARD)
        for x in (-0.57, 0.0)
        for y in (-0.37, 0.0)
        for z in (0.144, 0.669)
    ]
    straps = [box((x - 0.03, -0.38, 0.144), (x + 0.03, 0.38, 1.2), colour) for x in (-0.3, 0.3)]
    return joined([*_bottom(_WOOD, blocks=False), deck, *crates, *straps])


def wall(colour: Colour) -> Solid:
    """Return a plain wall 2 m wide (along y), 2.5 m high, with a skirting board."""
    skirting = box((-0.06, -1.0, 0.0), (0.06, 1.0, 0.1), _STEEL)
    return joined([skirting, box((-0.05, -1.0, 0.1), (0.05, 1.0, 2.5), colour)])


def door(colour: Colour) -> Solid:
    """Return a closed door 1 m wide (along y), 2.1 m high: frame, leaf, panels, handles."""
    jamb = box((-0.06, 0.42, 0.0), (0.06, 0.5, 2.1), _WHITE)
    lintel = box((-0.06, -0.42, 2.02), (0.06, 0.42, 2.1), _WHITE)
    leaf = box((-0.03, -0.42, 0.01), (0.03, 0.42, 2.02), colour)
    panels = [
        box((-0.04, -0.3, low), (0.04, 0.3, high), colour)
        for low, high in ((0.2, 0.9), (1.15, 1.8))
    ]
    spindle = box((-0.09, 0.33, 1.0), (0.09, 0.36, 1.03), _STEEL)
    levers = [box((x - 0.01, 0.22, 1.0), (x + 0.01, 0.36, 1.03), _STEEL) for x in (-0.09, 0.09)]
    return joined([*mirrored(jamb), lintel, leaf, *panels, spindle, *levers])


def barrier(colour: Colour) -> Solid:
    """Return a barrier 2 m wide (along y), 1 m high: striped rails on two feet."""
    parts: list[Solid] = []
    for low in (0.45, 0.8):
        parts += [
            box((-0.02, y, low), (0.02, y + 0.25, low + 0.2), colour if number % 2 else _WHITE)
            for number, y in enumerate((-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75))
        ]
    post = box((-0.04, 0.68, 0.08), (-0.02, 0.74, 0.95), _STEEL)
    foot = extruded([(-0.25, 0.0), (-0.2, 0.08), (0.2, 0.08), (0.25, 0.0)], 0.64, 0.78, _BLACK)
    return joined([*parts, *mirrored(post), *mirrored(foot)])


def cone(colour: Colour) -> Solid:
    """Return a traffic cone 0.75 m high with two white bands on a square foot."""
    foot = box((-0.2, -0.2, 0.0), (0.2, 0.2, 0.04), _BLACK)
    heights = (0.04, 0.25, 0.38, 0.48, 0.58, 0.75)
    radii = [0.155 - 0.17 * height for height in heights]
    bands = [
        turned(
            [(heights[i], radii[i]), (heights[i + 1], radii[i + 1])],
            _WHITE if i in {1, 3} else colour,
            sides=10,
        )
        for i in range(5)
    ]
    return joined([foot, *bands])


def pillar(colour: Colour) -> Solid:
    """Return a round pillar 0.4 m thick, 2.5 m high, with base and capital."""
    shaft = turned([(0.15, 0.16), (2.35, 0.15)], colour, sides=16)
    base = tapered((-0.2, -0.2, 0.2, 0.2), 0.0, (-0.18, -0.18, 0.18, 0.18), 0.15, colour)
    top = tapered((-0.16, -0.16, 0.16, 0.16), 2.35, (-0.2, -0.2, 0.2, 0.2), 2.5, colour)
    return joined([base, shaft, top])


def crate(colour: Colour) -> Solid:
    """Return a plain box with darker edges at top and bottom, for anything else."""
    red, green, blue, alpha = colour
    rim: Colour = (0.7 * red, 0.7 * green, 0.7 * blue, alpha)
    bands = [box((-0.5, -0.5, z), (0.5, 0.5, z + 0.08), rim) for z in (0.0, 0.92)]
    return joined([*bands, box((-0.48, -0.48, 0.08), (0.48, 0.48, 0.92), colour)])


class Shape(Enum):
    """A built-in shape; the value is its name in a catalogue."""

    PERSON = "person"
    DISC_ROBOT = "disc_robot"
    CART_ROBOT = "cart_robot"
    SERVING_ROBOT = "serving_robot"
    CAR = "car"
    VAN = "van"
    LORRY = "lorry"
    BUGGY = "buggy"
    SCOOTER = "scooter"
    PALLET = "pallet"
    LOADED_PALLET = "loaded_pallet"
    WALL = "wall"
    DOOR = "door"
    BARRIER = "barrier"
    CONE = "cone"
    PILLAR = "pillar"
    CRATE = "crate"


_MAKERS: Mapping[Shape, Callable[[Colour], Solid]] = {
    Shape(maker.__name__): maker
    for maker in (
        *(person, disc_robot, cart_robot, serving_robot, car, van, lorry, buggy, scooter),
        *(pallet, loaded_pallet, wall, door, barrier, cone, pillar, crate),
    )
}


def build_shape(shape: Shape, size_m: Point, colour: Colour) -> Solid:
    """Build a shape whose bounds are exactly `size_m` (x forward, y left, z up), in metres.

    It stands on z = 0 with the middle of its footprint on the origin, facing +x: not yet in F_A,
    which is at `Solid.centre_of_mass_m()`. Every shape has fewer than 300 triangles.
    """
    return _MAKERS[shape](colour).fitted(size_m)
