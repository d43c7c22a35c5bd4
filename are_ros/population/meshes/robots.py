"""Robots as a camera sees them: with bumpers, stripes, scanners, trays and screens.

Each maker builds at the size of the row's box (length, width, height). Two of a kind
differ in paint and load.
"""

import math

from are_ros.population.meshes.detail import (
    AMBER,
    BLACK,
    DARK,
    RUBBER,
    STEEL,
    WHITE,
    YELLOW,
    BodySpec,
    rod,
    shade_of,
    shaded,
    soft_box,
    tilted,
    wheels,
)
from are_ros.population.meshes.shapes import (
    Colour,
    Solid,
    box,
    extruded,
    joined,
    loft,
    mirrored,
    tapered,
    turned,
)

_SCREEN: Colour = (0.16, 0.5, 0.75, 1.0)
_LED: Colour = (0.2, 0.85, 0.95, 1.0)


def disc_robot(spec: BodySpec) -> Solid:
    """Return a round robot: base with bumper, a plate on posts, a laser scanner, a camera."""
    length, _width, height = spec.size_m
    r, z = 0.5 * length, height
    paint = spec.paint(0.12)
    plate = turned(
        [(0.8 * z, 0.9 * r), (0.812 * z, 0.93 * r), (0.835 * z, 0.93 * r), (0.847 * z, 0.9 * r)],
        shaded(paint, 1.15),
        sides=28,
    )
    posts = [
        rod(
            (0.72 * r * math.cos(a), 0.72 * r * math.sin(a), 0.3 * z),
            (0.72 * r * math.cos(a), 0.72 * r * math.sin(a), 0.81 * z),
            0.011,
            STEEL,
        )
        for a in (0.7, 2.4, 3.9, 5.6)
    ]
    parts = [
        turned(
            [
                (0.05 * z, 0.9 * r),
                (0.08 * z, 0.98 * r),
                (0.12 * z, r),
                (0.3 * z, r),
                (0.35 * z, 0.95 * r),
                (0.375 * z, 0.84 * r),
            ],
            paint,
            sides=32,
        ),
        turned([(0.14 * z, 1.004 * r), (0.21 * z, 1.004 * r)], RUBBER, sides=32),
        turned(
            [(0.37 * z, 0.2 * r), (0.395 * z, 0.18 * r)],
            (0.2, 0.75, 0.3, 1.0),
            at=(0.5 * r, 0.0),
            sides=12,
        ),
        plate,
        *posts,
        turned(
            [
                (0.845 * z, 0.26 * r),
                (0.9 * z, 0.28 * r),
                (0.905 * z, 0.24 * r),
                (0.93 * z, 0.24 * r),
                (0.94 * z, 0.28 * r),
                (0.985 * z, 0.27 * r),
                (z, 0.22 * r),
            ],
            DARK,
            at=(0.15 * r, 0.0),
            sides=20,
        ),
        soft_box(
            (-0.5 * r, -0.35 * r, 0.66 * z),
            (0.25 * r, 0.35 * r, 0.72 * z),
            0.015,
            (0.14, 0.3, 0.2, 1.0),
        ),
        soft_box((0.5 * r, -0.3 * r, 0.66 * z), (0.64 * r, 0.3 * r, 0.74 * z), 0.01, BLACK),
        *wheels((0.0,), 0.86 * r, 0.14 * z, 0.16 * r),
        turned([(0.0, 0.07 * r), (0.06 * z, 0.08 * r)], STEEL, at=(0.75 * r, 0.0)),
        turned([(0.0, 0.07 * r), (0.06 * z, 0.08 * r)], STEEL, at=(-0.75 * r, 0.0)),
    ]
    return joined(parts)


def cart_robot(spec: BodySpec) -> Solid:
    """Return a delivery robot with a flag, or an AGV with deck, bumpers, stripes and scanners."""
    return (_delivery if spec.features.get("task") == "delivery" else _agv)(spec)


def _delivery(spec: BodySpec) -> Solid:
    length, width, height = spec.size_m
    x, y, z = 0.5 * length, 0.5 * width, height
    paint = spec.paint(0.08)
    trim = shade_of((0.85, 0.3, 0.1), spec.generator, 0.3)
    body = tapered(
        (-0.8 * x, -0.8 * y, 0.86 * x, 0.8 * y),
        0.17 * z,
        (-0.76 * x, -0.76 * y, 0.7 * x, 0.76 * y),
        0.6 * z,
        paint,
    )
    parts = [
        soft_box((-0.82 * x, -0.84 * y, 0.15 * z), (0.9 * x, 0.84 * y, 0.36 * z), 0.08, paint),
        body,
        soft_box((-0.8 * x, -0.82 * y, 0.585 * z), (0.74 * x, 0.82 * y, 0.655 * z), 0.05, DARK),
        soft_box((-0.84 * x, -0.86 * y, 0.34 * z), (0.9 * x, 0.86 * y, 0.375 * z), 0.02, trim),
        soft_box((0.76 * x, -0.5 * y, 0.4 * z), (0.87 * x, 0.5 * y, 0.52 * z), 0.03, BLACK),
        soft_box((0.84 * x, -0.6 * y, 0.19 * z), (1.0 * x, 0.6 * y, 0.27 * z), 0.03, RUBBER),
        turned(
            [(0.64 * z, 0.05), (0.7 * z, 0.05), (0.73 * z, 0.035)],
            DARK,
            at=(0.45 * x, 0.0),
            sides=14,
        ),
        rod((-0.74 * x, 0.0, 0.6 * z), (-0.74 * x, 0.0, z), 0.008, STEEL),
        extruded(
            [(-x, 0.9 * z), (-0.74 * x, 0.995 * z), (-0.74 * x, 0.87 * z)], -0.006, 0.006, trim
        ),
        *wheels((-0.58 * x, 0.02 * x, 0.6 * x), y, 0.13 * z, 0.24 * y),
    ]
    for side in (0.32, -0.32):
        lamp = soft_box(
            (0.8 * x, side * y - 0.03, 0.43 * z),
            (0.885 * x, side * y + 0.03, 0.49 * z),
            0.015,
            _LED,
        )
        parts.append(lamp)
    return joined(parts)


def _agv(spec: BodySpec) -> Solid:
    length, width, height = spec.size_m
    x, y, deck = 0.5 * length, 0.5 * width, 0.64 * height
    paint = spec.paint(0.1)
    skirt = 0.16 * height
    parts = [
        soft_box((-0.97 * x, -0.93 * y, skirt), (0.97 * x, 0.93 * y, 0.93 * deck), 0.05, paint),
        soft_box(
            (-0.9 * x, -0.88 * y, 0.92 * deck),
            (0.9 * x, 0.88 * y, deck),
            0.02,
            (0.25, 0.26, 0.28, 1.0),
        ),
        *(
            box(
                (0.9 * x * s, -0.8 * y, deck - 0.004),
                (0.9 * x * s + 0.02, 0.8 * y, deck + 0.006),
                YELLOW,
            )
            for s in (-0.85, 0.0, 0.8)
        ),
        box((-0.9 * x, -0.7 * y, 0.05 * height), (0.9 * x, 0.7 * y, skirt + 0.02), DARK),
        *wheels((-0.62 * x, 0.62 * x), 0.86 * y, 0.15 * height, 0.16 * y),
        rod((-0.85 * x, 0.55 * y, deck - 0.02), (-0.85 * x, 0.55 * y, 0.93 * height), 0.014, STEEL),
        turned(
            [(0.92 * height, 0.03), (0.985 * height, 0.03), (height, 0.022)],
            AMBER,
            at=(-0.85 * x, 0.55 * y),
            sides=12,
        ),
        turned(
            [(0.42 * deck, 0.055), (0.7 * deck, 0.06)], YELLOW, at=(0.9 * x, 0.84 * y), sides=16
        ),
        turned(
            [(0.42 * deck, 0.055), (0.7 * deck, 0.06)], YELLOW, at=(-0.9 * x, -0.84 * y), sides=16
        ),
        turned([(0.5 * deck, 0.062), (0.6 * deck, 0.062)], BLACK, at=(0.9 * x, 0.84 * y), sides=16),
        turned(
            [(0.5 * deck, 0.062), (0.6 * deck, 0.062)], BLACK, at=(-0.9 * x, -0.84 * y), sides=16
        ),
    ]
    for end in (-1.0, 1.0):
        low, high = sorted((end * 0.95 * x, end * x))
        parts.append(soft_box((low, -0.96 * y, skirt), (high, 0.96 * y, 0.5 * deck), 0.015, BLACK))
        parts += _warning(end * x, 0.94 * y, (skirt + 0.02, 0.47 * deck))
    strip = soft_box((-0.7 * x, 0.9 * y, 0.7 * deck), (0.7 * x, 0.945 * y, 0.76 * deck), 0.01, _LED)
    name = box((-0.3 * x, 0.9 * y, 0.45 * deck), (0.3 * x, 0.935 * y, 0.58 * deck), WHITE)
    button = box(
        (0.5 * x, 0.9 * y, 0.46 * deck),
        (0.5 * x + 0.05, y, 0.46 * deck + 0.05),
        (0.8, 0.05, 0.05, 1.0),
    )
    return joined([*parts, *mirrored(strip), *mirrored(name), *mirrored(button)])


def _warning(x: float, y: float, band: tuple[float, float]) -> list[Solid]:
    """Return slanting yellow stripes on the black bumper at x."""
    low, high = band
    lean, wide = high - low, 0.05
    stripes = []
    at = -y + 0.01
    while at + wide + lean < y:
        ring = [(at, low), (at + wide, low), (at + wide + lean, high), (at + lean, high)]
        rings = [[(x + d, a, b) for a, b in ring] for d in (-0.003, 0.003)]
        stripes.append(loft(rings, YELLOW))
        at += 2.0 * wide
    return stripes


def serving_robot(spec: BodySpec) -> Solid:
    """Return a serving robot: base with lights, trays with rims and dishes, a face on a screen."""
    length, width, height = spec.size_m
    x, y, z = 0.5 * length, 0.5 * width, height
    paint = spec.paint(0.08)
    parts = [
        soft_box(
            (-0.96 * x, -0.98 * y, 0.03 * z), (x, 0.98 * y, 0.15 * z), 0.12, shaded(paint, 0.8)
        ),
        soft_box((-0.92 * x, -0.94 * y, 0.14 * z), (0.95 * x, 0.94 * y, 0.23 * z), 0.1, paint),
        soft_box((-0.97 * x, -y, 0.13 * z), (0.985 * x, y, 0.145 * z), 0.1, _LED),
        *wheels((0.0,), 0.9 * y, 0.055 * z, 0.15 * y),
        soft_box((0.9 * x, -0.35 * y, 0.17 * z), (0.975 * x, 0.35 * y, 0.2 * z), 0.01, BLACK),
        *mirrored(
            soft_box((-0.86 * x, 0.72 * y, 0.21 * z), (-0.58 * x, 0.9 * y, 0.88 * z), 0.04, paint)
        ),
        tilted(
            soft_box((-0.98 * x, -0.72 * y, 0.83 * z), (-0.62 * x, 0.72 * y, z), 0.05, paint),
            (-0.8 * x, 0.85 * z),
            0.12,
        ),
        tilted(
            box((-0.63 * x, -0.6 * y, 0.85 * z), (-0.605 * x, 0.6 * y, 0.98 * z), BLACK),
            (-0.8 * x, 0.85 * z),
            0.12,
        ),
        tilted(
            box((-0.63 * x, -0.54 * y, 0.86 * z), (-0.595 * x, 0.54 * y, 0.97 * z), _SCREEN),
            (-0.8 * x, 0.85 * z),
            0.12,
        ),
    ]
    for side in (0.22, -0.22):
        eye = box(
            (-0.63 * x, side * y - 0.018, 0.905 * z),
            (-0.585 * x, side * y + 0.018, 0.94 * z),
            WHITE,
        )
        parts.append(tilted(eye, (-0.8 * x, 0.85 * z), 0.12))
    for shelf in (0.385, 0.577, 0.75):
        parts.append(
            soft_box(
                (-0.84 * x, -0.9 * y, shelf * z),
                (0.94 * x, 0.9 * y, (shelf + 0.022) * z),
                0.02,
                (0.28, 0.28, 0.3, 1.0),
            )
        )
        parts.append(
            soft_box(
                (0.9 * x, -0.92 * y, (shelf + 0.005) * z),
                (0.97 * x, 0.92 * y, (shelf + 0.035) * z),
                0.02,
                paint,
            )
        )
        rail = soft_box(
            (-0.8 * x, 0.86 * y, (shelf + 0.005) * z),
            (0.96 * x, 0.93 * y, (shelf + 0.035) * z),
            0.02,
            paint,
        )
        parts += mirrored(rail)
        for _unused in range(int(spec.generator.integers(0, 4))):
            at = (
                float(spec.generator.uniform(-0.4, 0.65)) * x,
                float(spec.generator.uniform(-0.6, 0.6)) * y,
            )
            base = (shelf + 0.022) * z
            if spec.generator.random() < 0.5:
                dish = turned(
                    [(base, 0.05), (base + 0.025, 0.09), (base + 0.03, 0.085)],
                    WHITE,
                    at=at,
                    sides=14,
                )
            else:
                tone = shade_of((0.8, 0.25, 0.2), spec.generator, 0.5)
                dish = turned([(base, 0.03), (base + 0.09, 0.038)], tone, at=at, sides=12)
            parts.append(dish)
    return joined(parts)
