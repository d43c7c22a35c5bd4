"""Vehicles as a camera sees them: bodies with arches, windows, lights, mirrors, wheels and plates.

Each maker builds at the size of the row's box (length, width, height), so that wheels stay round.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from are_ros.population.meshes.detail import (
    AMBER,
    BLACK,
    DARK,
    GLASS,
    HEADLIGHT,
    RUBBER,
    SEAT,
    STEEL,
    TAIL_LIGHT,
    WHITE,
    BodySpec,
    half_turned,
    hull,
    rod,
    shade_of,
    shaded,
    soft_box,
    stations,
    tilted,
    wheels,
)
from are_ros.population.meshes.shapes import Colour, Point, Solid, box, joined, mirrored

Outline = list[tuple[float, float]]
Key = tuple[float, Outline]
"""The x of a section and its half outline, in shares of length, half width and height."""

_NOTCHED: Final = ("saloon", "limousine", "sports car")
_FOUR_DOORS_M: Final = 3.0
"""Cars that are longer have rear doors."""
_LIGHTS, _SHOULDER, _TOP = 3, 4, 7
"""Stripes of a hull over `_section`: of the lights, below the windows, of screens and roof."""


def _section(
    width: float, belt: float, eave: tuple[float, float], top: tuple[float, float]
) -> Outline:
    """Return a half section: sill, flank, lights, shoulder, eave, edge and crown of the top."""
    sill = 0.15
    low, high = sill + 0.55 * (belt - sill), sill + 0.82 * (belt - sill)
    return [
        (0.86 * width, sill),
        (0.97 * width, sill + 0.1 * (belt - sill)),
        (1.0 * width, sill + 0.34 * (belt - sill)),
        (0.99 * width, low),
        (0.965 * width, high),
        (0.925 * width, belt),
        eave,
        top,
        (0.5 * top[0], top[1] + 0.012),
    ]


def _bonnet(width: float, height: float) -> Outline:
    """Return a half section without a cabin, whose lid is at a height."""
    return _section(width, height - 0.035, (0.84 * width, height - 0.012), (0.62 * width, height))


class _Cabin(NamedTuple):
    """Where the windows of a car begin and end, in shares of its length, and its pillars stand."""

    tail: float
    roof_rear: float
    roof_front: float
    cowl: float

    @property
    def pillar(self) -> float:
        """The place of the pillar between the doors."""
        return 0.5 * (self.roof_rear + self.roof_front) + 0.02

    @property
    def posts(self) -> tuple[tuple[float, float], ...]:
        """Begin and end of the posts between the side windows."""
        return ((self.pillar - 0.008, self.pillar + 0.008), (self.roof_rear, self.roof_rear + 0.02))


def car(spec: BodySpec) -> Solid:
    """Return a car, with a boot if the feature `kind` is saloon, limousine or sports car."""
    length, width, z = spec.size_m
    paint = spec.paint(0.18)
    kind = spec.features.get("kind", "")
    has_boot = kind in _NOTCHED
    if has_boot:
        cabin = _Cabin(-0.345, -0.17, 0.06, 0.235)
    else:
        cabin = _Cabin(-0.478, -0.43 if kind == "estate" else -0.375, 0.1, 0.27)
    radius = min(0.225 * z, 0.085 * length)
    axles = (0.315 * length, -0.29 * length)
    seams = [cabin.cowl - 0.02, cabin.pillar]
    if length > _FOUR_DOORS_M:
        seams.append(cabin.roof_rear + 0.075)
    cuts = [at * length + side for at in seams for side in (-0.006, 0.006)]
    cuts += [at * length for post in cabin.posts for at in post]
    arches = [(x, radius, 1.16 * radius) for x in axles]
    keys = _scaled(_car_outline(cabin, has_boot=has_boot), spec.size_m)
    xs, sections = stations(keys, arches, cuts)
    tail_light = -0.462 if has_boot else -0.478

    def tone_at(x: float, stripe: int) -> Colour:
        at = x / length
        if stripe > _SHOULDER:
            return _cabin_tone(cabin, at, stripe, paint)
        if stripe == _LIGHTS and (at > 0.44 or at < tail_light):
            return HEADLIGHT if at > 0.0 else TAIL_LIGHT
        is_seam = any(abs(x - seam * length) < 0.0055 for seam in seams)
        return _flank_tone(stripe, paint, is_seam=is_seam)

    y = 0.5 * width
    chassis = box((axles[1], -0.6 * y, 0.12 * z), (axles[0], 0.6 * y, 0.42 * z), DARK)
    parts = [
        hull(xs, sections, tone_at, shaded(paint, 0.9)),
        chassis,
        *wheels(axles, 0.93 * y, radius, 0.24 * y),
        *_face(spec.size_m, spec.generator),
        *mirrored(_mirror((cabin.cowl - 0.03) * length, y, 0.64 * z, paint)),
    ]
    for seam in seams[1:]:
        x = (seam + 0.015) * length
        low, high = (x, 0.92 * y, 0.535 * z), (x + 0.16, 0.948 * y, 0.555 * z)
        parts += mirrored(box(low, high, shaded(paint, 0.75)))
    return joined(parts)


def _car_outline(cabin: _Cabin, *, has_boot: bool) -> list[Key]:
    """Return the sections of a car from its rear to its front."""
    belt, half = 0.645, 0.94
    lid = 0.665 if has_boot else 0.64

    def roof(narrow: float, eave: float, top: float) -> Outline:
        return _section(half, belt, (narrow * half, eave), ((narrow - 0.105) * half, top))

    boot = [(-0.45, _bonnet(0.96 * half, lid))] if has_boot else []
    return [
        (-0.5, _bonnet(0.78 * half, lid - 0.1)),
        (-0.496, _bonnet(0.86 * half, lid - 0.05)),
        (-0.482, _bonnet(0.93 * half, lid - 0.015)),
        *boot,
        (
            cabin.tail,
            _section(0.98 * half, belt, (0.88 * half, lid + 0.005), (0.8 * half, lid + 0.012)),
        ),
        (cabin.roof_rear, roof(0.76, 0.9, 0.955)),
        (cabin.roof_rear + 0.06, roof(0.78, 0.915, 0.978)),
        (0.5 * (cabin.roof_rear + cabin.roof_front), roof(0.78, 0.92, 0.988)),
        (cabin.roof_front - 0.05, roof(0.78, 0.915, 0.977)),
        (cabin.roof_front, roof(0.76, 0.895, 0.95)),
        (cabin.cowl, _section(half, 0.625, (0.9 * half, 0.645), (0.84 * half, 0.652))),
        (0.34, _bonnet(0.99 * half, 0.635)),
        (0.425, _bonnet(0.96 * half, 0.59)),
        (0.468, _bonnet(0.9 * half, 0.545)),
        (0.49, _bonnet(0.82 * half, 0.495)),
        (0.5, _bonnet(0.72 * half, 0.43)),
    ]


def _flank_tone(stripe: int, paint: Colour, *, is_seam: bool) -> Colour:
    """Return the colour of the body below its windows."""
    if stripe == 0:
        return RUBBER
    return shaded(paint, 0.35) if is_seam else paint


def _cabin_tone(cabin: _Cabin, at: float, stripe: int, paint: Colour) -> Colour:
    """Return the colour of bonnet, windows, roof or boot at a share of the length."""
    is_window = stripe == _SHOULDER + 1 and cabin.roof_rear < at < cabin.cowl
    if is_window:
        return DARK if any(low < at < high for low, high in cabin.posts) else GLASS
    is_screen = cabin.roof_front < at < cabin.cowl or cabin.tail < at < cabin.roof_rear
    return GLASS if is_screen and stripe >= _TOP else paint


def _scaled(keys: Sequence[Key], size_m: Point) -> list[Key]:
    """Return key sections in metres; grille and plates stand before the ends of the hull."""
    length, width, height = size_m[0] - 0.03, *size_m[1:]
    return [
        (x * length, [(0.5 * width * y, height * z) for y, z in section]) for x, section in keys
    ]


def _mirror(x: float, y: float, z: float, paint: Colour) -> Solid:
    """Return the left mirror, whose outer edge is at `y`."""
    shell = soft_box((x - 0.06, y - 0.17, z), (x + 0.06, y, z + 0.13), 0.05, paint)
    glass = box((x - 0.064, y - 0.15, z + 0.02), (x - 0.055, y - 0.02, z + 0.11), GLASS)
    return joined([shell, glass])


def _face(size_m: Point, random: np.random.Generator) -> list[Solid]:
    """Return what front and rear of a car have: grille, intake, bumper, plates."""
    length, width, z = size_m
    front, y = 0.5 * length, 0.5 * width
    parts = [
        soft_box((front - 0.1, -0.42 * y, 0.325 * z), (front, 0.42 * y, 0.395 * z), 0.02, DARK),
        soft_box(
            (front - 0.1, -0.6 * y, 0.165 * z), (front - 0.006, 0.6 * y, 0.235 * z), 0.02, DARK
        ),
        soft_box(
            (-front + 0.002, -0.62 * y, 0.17 * z), (-front + 0.1, 0.62 * y, 0.25 * z), 0.02, RUBBER
        ),
        *plate(front - 0.016, 0.25 * z, random),
        *(half_turned(part) for part in plate(front - 0.016, 0.42 * z, random)),
    ]
    lamps = soft_box(
        (front - 0.14, 0.6 * y, 0.18 * z), (front - 0.012, 0.7 * y, 0.225 * z), 0.02, WHITE
    )
    return [*parts, *mirrored(lamps)]


def plate(front: float, z: float, random: np.random.Generator) -> list[Solid]:
    """Return a number plate, 0.46 x 0.11 m, before x = `front`; no two alike."""
    board = box((front, -0.23, z), (front + 0.008, 0.23, z + 0.11), WHITE)
    edge = box((front, 0.19, z + 0.005), (front + 0.0095, 0.225, z + 0.105), (0.05, 0.2, 0.6, 1.0))
    signs, y = [], 0.165
    while y > -0.2:
        wide = float(random.uniform(0.018, 0.034))
        low, high = sorted(random.uniform(0.02, 0.09, 2).tolist())
        tall = (0.02, 0.09) if high - low < 0.035 else (0.02, max(high, 0.06))
        signs.append(box((front, y - wide, z + tall[0]), (front + 0.0095, y, z + tall[1]), BLACK))
        y -= wide + float(random.choice((0.012, 0.014, 0.04)))
    return [board, edge, *signs]


def van(spec: BodySpec) -> Solid:
    """Return a van with a short bonnet; the `kind` minibus has windows all along."""
    length, width, z = spec.size_m
    paint = spec.paint(0.12)
    half, is_bus = 0.94, "bus" in spec.features.get("kind", "")
    cowl, roof_front = 0.37, 0.2
    belt = 0.52

    def tall(w: float, top: float) -> Outline:
        return _section(w, belt, (0.93 * w, top - 0.13), (0.84 * w, top))

    keys: list[Key] = [
        (-0.5, tall(0.93 * half, 0.955)),
        (-0.495, tall(0.97 * half, 0.97)),
        (-0.475, tall(half, 0.982)),
        (0.0, tall(half, 0.988)),
        (0.15, tall(half, 0.98)),
        (roof_front, _section(half, belt, (0.92 * half, 0.84), (0.8 * half, 0.955))),
        (cowl, _section(0.99 * half, belt - 0.01, (0.92 * half, 0.53), (0.86 * half, 0.538))),
        (0.43, _bonnet(0.96 * half, 0.5)),
        (0.475, _bonnet(0.92 * half, 0.455)),
        (0.494, _bonnet(0.86 * half, 0.41)),
        (0.5, _bonnet(0.78 * half, 0.36)),
    ]
    radius = min(0.18 * z, 0.068 * length)
    axles = (0.31 * length, -0.3 * length)
    door, slide = 0.13, -0.12
    panes = [(-0.45, -0.3), (-0.28, -0.13), (-0.11, 0.03)] if is_bus else []
    panes.append((0.06, cowl))
    seams = [cowl - 0.03, 0.045, slide - 0.03]
    cuts = [at * length + side for at in seams for side in (-0.006, 0.006)]
    cuts += [at * length for pane in panes for at in pane]
    cuts += [(door + 0.045) * length, (door + 0.052) * length]
    xs, sections = stations(
        _scaled(keys, spec.size_m), [(x, radius, 1.18 * radius) for x in axles], cuts
    )

    def tone_at(x: float, stripe: int) -> Colour:
        at = x / length
        if stripe == _SHOULDER + 1 and any(low < at < high for low, high in panes):
            return DARK if 0.17 < at < 0.185 else GLASS
        if stripe > _SHOULDER:
            return GLASS if stripe >= _TOP and roof_front < at < cowl else paint
        if stripe == _LIGHTS and at > 0.43:
            return HEADLIGHT
        if stripe >= _LIGHTS and at < -0.492:
            return TAIL_LIGHT
        is_seam = any(abs(x - seam * length) < 0.0055 for seam in seams)
        return _flank_tone(stripe, paint, is_seam=is_seam)

    skin = hull(xs, sections, tone_at, shaded(paint, 0.92))
    y, rear = 0.5 * width, -0.5 * length
    parts = [
        skin,
        box((axles[1], -0.6 * y, 0.1 * z), (axles[0], 0.6 * y, 0.34 * z), DARK),
        *wheels(axles, 0.93 * y, radius, 0.24 * y),
        *_face(spec.size_m, spec.generator),
        *mirrored(_mirror((cowl - 0.05) * length, y, 0.54 * z, BLACK)),
        box((rear - 0.004, -0.006, 0.2 * z), (rear + 0.05, 0.006, 0.93 * z), DARK),
        *mirrored(box((rear - 0.004, 0.1 * y, 0.56 * z), (rear + 0.05, 0.72 * y, 0.8 * z), GLASS)),
        *mirrored(
            soft_box(
                (-0.45 * length, 0.93 * y, 0.3 * z),
                (0.18 * length, 0.955 * y, 0.33 * z),
                0.01,
                RUBBER,
            )
        ),
    ]
    return joined(parts)


def lorry(spec: BodySpec) -> Solid:
    """Return a lorry: cab, load box with a stripe in the colour of the cab, frame, wheels."""
    length, width, z = spec.size_m
    y, paint = 0.5 * width, spec.paint(0.18)
    cab_rear, front = 0.235 * length, 0.5 * length
    half, belt = 0.915, 0.48

    def tall(w: float, top: float) -> Outline:
        return _section(w, belt, (0.96 * w, top - 0.08), (0.9 * w, top))

    keys: list[Key] = [
        (0.24, tall(half, 0.77)),
        (0.31, tall(half, 0.785)),
        (0.425, tall(half, 0.775)),
        (0.446, tall(0.99 * half, 0.745)),
        (0.487, _section(0.97 * half, belt, (0.94 * half, 0.488), (0.88 * half, 0.496))),
        (0.494, _section(0.95 * half, belt - 0.03, (0.9 * half, 0.458), (0.82 * half, 0.465))),
        (0.5, _section(0.9 * half, belt - 0.06, (0.84 * half, 0.43), (0.74 * half, 0.437))),
    ]
    radius = min(0.157 * z, 0.075 * length)
    steer, drive = 0.375 * length, -0.3 * length
    door = (0.26, 0.42)
    cuts = [at * length + side for at in door for side in (-0.008, 0.008)]
    xs, sections = stations(_scaled(keys, spec.size_m), [(steer, radius, 1.18 * radius)], cuts)

    def tone_at(x: float, stripe: int) -> Colour:
        at = x / length
        if stripe == _SHOULDER + 1 and 0.265 < at < 0.48:
            return GLASS
        if stripe > _SHOULDER:
            return GLASS if stripe >= _TOP and 0.44 < at < 0.485 else paint
        is_seam = any(abs(x - edge * length) < 0.0075 for edge in door)
        return _flank_tone(stripe, paint, is_seam=is_seam)

    box_low, box_front = 0.315 * z, cab_rear - 0.1
    load = shade_of((0.87, 0.87, 0.85), spec.generator, 0.06)
    rear = -front
    parts = [
        hull(xs, sections, tone_at, shaded(paint, 0.9)),
        box((cab_rear, -0.6 * y, 0.16 * z), (steer + radius, 0.6 * y, 0.4 * z), DARK),
        soft_box((rear, -y, box_low), (box_front, y, z), 0.05, load),
        box((rear + 0.1, -0.42 * y, 0.2 * z), (cab_rear + 0.4, 0.42 * y, box_low), DARK),
        *wheels((steer,), 0.95 * y, radius, 0.24 * y),
        *wheels((drive,), 0.97 * y, radius, 0.42 * y),
        box((drive - 0.06, -0.7 * y, radius - 0.06), (drive + 0.06, 0.7 * y, radius + 0.06), DARK),
        *mirrored(_mirror(0.45 * length, y, 0.52 * z, BLACK)),
        *mirrored(
            soft_box(
                (front - 0.1, 0.58 * y, 0.2 * z),
                (front - 0.004, 0.86 * y, 0.245 * z),
                0.03,
                HEADLIGHT,
            )
        ),
        *mirrored(
            box((rear + 0.05, 0.45 * y, 0.24 * z), (rear + 0.12, 0.85 * y, 0.28 * z), TAIL_LIGHT)
        ),
        box((rear + 0.06, -0.86 * y, 0.18 * z), (rear + 0.14, 0.86 * y, 0.21 * z), STEEL),
        box((rear - 0.004, -0.01, box_low + 0.05), (rear + 0.02, 0.01, z - 0.05), DARK),
        *plate(front - 0.014, 0.19 * z, spec.generator),
        *(half_turned(part) for part in plate(front - 0.12, 0.235 * z, spec.generator)),
    ]
    parts += [
        soft_box((front - 0.1, -0.5 * y, low * z), (front, 0.5 * y, (low + 0.025) * z), 0.015, DARK)
        for low in (0.27, 0.315, 0.36)
    ]
    stripe = box((rear + 0.15, y - 0.05, 0.5 * z), (box_front - 0.15, y + 0.004, 0.58 * z), paint)
    guard = box((-0.18 * length, 0.9 * y, 0.19 * z), (0.18 * length, 0.93 * y, 0.24 * z), STEEL)
    tank = soft_box(
        (0.05 * length, 0.5 * y, 0.15 * z), (0.2 * length, 0.88 * y, 0.29 * z), 0.05, STEEL
    )
    return joined([*parts, *mirrored(stripe), *mirrored(guard), *mirrored(tank)])


def buggy(spec: BodySpec) -> Solid:
    """Return an open electric buggy: nose, bench, posts, roof, and bags or a box behind."""
    length, width, z = spec.size_m
    paint, y, front = spec.paint(0.12), 0.5 * width, 0.5 * length
    radius = min(0.135 * z, 0.115 * length)
    axles = (0.345 * length, -0.33 * length)
    half = 0.92

    def low(w: float, top: float) -> Outline:
        return [
            (0.84 * w, 0.14),
            (0.96 * w, 0.16),
            (w, 0.2),
            (0.98 * w, 0.23),
            (0.9 * w, top),
            (0.4 * w, top + 0.006),
        ]

    keys: list[Key] = [
        (-0.5, low(0.86 * half, 0.35)),
        (-0.49, low(0.93 * half, 0.37)),
        (-0.44, low(half, 0.385)),
        (-0.12, low(half, 0.385)),
        (-0.105, low(half, 0.245)),
        (0.2, low(half, 0.245)),
        (0.225, low(0.98 * half, 0.47)),
        (0.28, low(0.96 * half, 0.475)),
        (0.42, low(0.9 * half, 0.38)),
        (0.47, low(0.84 * half, 0.32)),
        (0.493, low(0.74 * half, 0.27)),
        (0.5, low(0.64 * half, 0.245)),
    ]
    arches = [(x, radius, 1.2 * radius) for x in axles]
    xs, sections = stations(_scaled(keys, spec.size_m), arches, [])

    def tone_at(x: float, stripe: int) -> Colour:
        if stripe == 0 or (stripe >= 4 and -0.11 < x / length < 0.215):
            return RUBBER
        return paint

    seat_x, seat_z = -0.16 * length, 0.385 * z
    cushion = soft_box(
        (seat_x - 0.12 * length, -0.78 * y, seat_z),
        (seat_x + 0.1 * length, 0.78 * y, seat_z + 0.06 * z),
        0.04,
        SEAT,
    )
    back = tilted(
        soft_box(
            (seat_x - 0.15 * length, -0.78 * y, seat_z + 0.05 * z),
            (seat_x - 0.11 * length, 0.78 * y, 0.66 * z),
            0.04,
            SEAT,
        ),
        (seat_x - 0.13 * length, seat_z),
        0.12,
    )
    roof_z = 0.955 * z
    parts = [
        hull(xs, sections, tone_at, shaded(paint, 0.9)),
        box((axles[1], -0.55 * y, 0.08 * z), (axles[0], 0.55 * y, 0.2 * z), DARK),
        *wheels(axles, y, radius, 0.3 * y),
        cushion,
        back,
        soft_box(
            (-0.48 * length, -0.97 * y, roof_z),
            (0.31 * length, 0.97 * y, z),
            0.04,
            shaded(paint, 1.04),
        ),
        rod((0.22 * length, 0.35 * y, 0.42 * z), (0.12 * length, 0.35 * y, 0.56 * z), 0.018, DARK),
        _steering_wheel((0.12 * length, 0.35 * y, 0.56 * z)),
        *_bumper(front - 0.012, 0.17 * z),
    ]
    for x, foot in ((-0.445, 0.38), (0.235, 0.46)):
        post = rod(
            (x * length, 0.86 * y, foot * z),
            ((x + 0.02) * length, 0.86 * y, roof_z + 0.01),
            0.02,
            DARK,
        )
        parts += mirrored(post)
    lamp = soft_box(
        (0.462 * length, 0.45 * y, 0.245 * z),
        (0.485 * length, 0.72 * y, 0.295 * z),
        0.03,
        HEADLIGHT,
    )
    tail = box((-front, 0.5 * y, 0.25 * z), (-front + 0.03, 0.78 * y, 0.29 * z), TAIL_LIGHT)
    parts += [*mirrored(lamp), *mirrored(tail)]
    if spec.features.get("kind") == "golf cart":
        for side in (-0.35, 0.3):
            bag = soft_box(
                (-0.45 * length, side * y - 0.1, 0.385 * z),
                (-0.45 * length + 0.2, side * y + 0.1, 0.74 * z),
                0.05,
                shade_of((0.5, 0.25, 0.2), spec.generator, 0.5),
            )
            parts.append(bag)
    else:
        parts.append(
            soft_box(
                (-0.46 * length, -0.7 * y, 0.385 * z),
                (-0.34 * length, 0.7 * y, 0.5 * z),
                0.03,
                shaded(paint, 0.55),
            )
        )
        parts.append(
            soft_box(
                (0.2 * length, -0.09, z - 0.005), (0.2 * length + 0.12, 0.09, z + 0.09), 0.03, AMBER
            )
        )
    return joined(parts)


def _steering_wheel(at: Point) -> Solid:
    """Return a ring of short rods, and a spoke, that leans towards the seat."""
    turns = math.tau * np.arange(10) / 10
    ring = [(at[0], at[1] + 0.17 * math.sin(a), at[2] + 0.17 * math.cos(a)) for a in turns]
    rods = [rod(ring[k - 1], ring[k], 0.014, BLACK, sides=5) for k in range(10)]
    return tilted(
        joined([*rods, rod(ring[2], ring[8], 0.018, BLACK, sides=5)]), (at[0], at[2]), -0.6
    )


def _bumper(front: float, z: float) -> list[Solid]:
    """Return the bumper bar of a small vehicle."""
    return [soft_box((front - 0.05, -0.3, z), (front + 0.012, 0.3, z + 0.06), 0.02, RUBBER)]


def scooter(spec: BodySpec) -> Solid:
    """Return a mobility scooter: footboard, shrouds, seat with arms, tiller, wheels."""
    length, width, height = spec.size_m
    paint, y = spec.paint(0.15), 0.5 * width
    radius = 0.13 * height
    x, z = length / 1.3, height

    def block(low: Point, high: Point, edge_m: float, tone: Colour) -> Solid:
        return soft_box(
            (low[0] * x, low[1] * y, low[2] * z),
            (high[0] * x, high[1] * y, high[2] * z),
            edge_m,
            tone,
        )

    parts = [
        block((-0.3, -0.8, 0.13), (0.42, 0.8, 0.19), 0.03, RUBBER),
        block((-0.65, -0.84, 0.22), (-0.08, 0.84, 0.42), 0.1, paint),
        tilted(
            block((0.3, -0.62, 0.16), (0.5, 0.62, 0.62), 0.09, paint), (0.4 * x, 0.16 * z), 0.22
        ),
        block((0.4, -0.75, 0.22), (0.64, 0.75, 0.32), 0.06, paint),
        rod((-0.3 * x, 0.0, 0.4 * z), (-0.3 * x, 0.0, 0.56 * z), 0.04, DARK),
        block((-0.52, -0.72, 0.55), (-0.02, 0.72, 0.64), 0.05, SEAT),
        tilted(
            block((-0.53, -0.7, 0.6), (-0.43, 0.7, 1.0), 0.06, SEAT), (-0.48 * x, 0.6 * z), 0.16
        ),
        rod((0.38 * x, 0.0, 0.5 * z), (0.22 * x, 0.0, 0.92 * z), 0.03, DARK),
        block((0.16, -0.35, 0.87), (0.3, 0.35, 0.95), 0.04, paint),
        rod((0.21 * x, -0.97 * y, 0.93 * z), (0.21 * x, 0.97 * y, 0.93 * z), 0.016, BLACK),
        block((0.5, -0.2, 0.42), (0.53, 0.2, 0.5), 0.02, HEADLIGHT),
        tilted(
            block((0.16, -0.72, 0.3), (0.34, 0.72, 0.56), 0.05, (0.2, 0.2, 0.21, 1.0)),
            (0.3 * x, 0.3 * z),
            0.2,
        ),
        *mirrored(block((-0.66, 0.45, 0.3), (-0.63, 0.75, 0.36), 0.01, TAIL_LIGHT)),
        *mirrored(block((-0.42, 0.78, 0.72), (-0.06, 0.96, 0.77), 0.02, SEAT)),
        *mirrored(block((-0.46, 0.84, 0.58), (-0.4, 0.93, 0.75), 0.01, DARK)),
        *wheels((0.5 * x, -0.45 * x), y, radius, 0.3 * y),
    ]
    return joined(parts)
