"""Procedural vehicles; each takes the row's colour and is scaled to the row's size."""

from are_ros.artefacts._solids import (
    Colour,
    Solid,
    box,
    extruded,
    joined,
    mirrored,
    tapered,
    wheel,
)

_TYRE: Colour = (0.08, 0.08, 0.08, 1.0)
_GLASS: Colour = (0.25, 0.33, 0.4, 1.0)
_HEADLIGHT: Colour = (1.0, 0.95, 0.7, 1.0)
_TAIL_LIGHT: Colour = (0.8, 0.05, 0.05, 1.0)
_SEAT: Colour = (0.15, 0.15, 0.15, 1.0)
_FRAME: Colour = (0.3, 0.3, 0.32, 1.0)
_PLATFORM: Colour = (0.45, 0.4, 0.35, 1.0)


def _wheels(front: float, rear: float, y: float, radius: float, width: float) -> list[Solid]:
    """Make two axles of two wheels that stand on the ground."""
    return [
        side
        for x in (front, rear)
        for side in mirrored(wheel((x, y, radius), radius, width, _TYRE))
    ]


def _lights(front: float, rear: float, y: float, z: float) -> list[Solid]:
    """Make two headlights at x = `front` and two tail lights at x = `rear`."""
    head = box((front - 0.06, y - 0.16, z), (front + 0.01, y + 0.16, z + 0.14), _HEADLIGHT)
    tail = box((rear - 0.01, y - 0.16, z + 0.05), (rear + 0.06, y + 0.16, z + 0.19), _TAIL_LIGHT)
    return [*mirrored(head), *mirrored(tail)]


def car(colour: Colour) -> Solid:
    """Drive a saloon of 4.4 x 1.8 x 1.45 m: body, cabin of glass, roof, wheels, lights."""
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
    """Drive a box van of 5.0 x 1.95 x 2.0 m: high body, sloped windscreen, side windows."""
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
    """Drive a lorry of 7.2 x 2.4 x 3.2 m: cab, load box, frame, wheels."""
    cab = extruded([(1.9, 0.5), (1.9, 2.5), (3.2, 2.5), (3.6, 1.5), (3.6, 0.5)], -1.1, 1.1, colour)
    screen = extruded([(3.24, 2.42), (3.62, 1.5), (3.5, 1.5), (3.1, 2.42)], -0.95, 0.95, _GLASS)
    load = box((-3.6, -1.2, 1.0), (1.7, 1.2, 3.2), (0.88, 0.88, 0.86, 1.0))
    frame = box((-3.5, -0.5, 0.6), (2.0, 0.5, 1.0), _FRAME)
    wheels = _wheels(2.7, -2.3, 1.0, 0.5, 0.3)
    return joined([cab, screen, load, frame, *wheels, *_lights(3.6, -3.6, 0.8, 0.65)])


def buggy(colour: Colour) -> Solid:
    """Drive an open electric buggy of 2.4 x 1.2 x 1.75 m: tub, bench, posts and roof."""
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
    """Drive a mobility scooter of 1.3 x 0.6 x 1.0 m: floor, seat with back, tiller, wheels."""
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
