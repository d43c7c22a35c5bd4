"""Procedural people and robots; each takes the row's colour and is scaled to the row's size."""

from are_ros.artefacts._solids import (
    Colour,
    Solid,
    box,
    extruded,
    joined,
    mirrored,
    tapered,
    turned,
    wheel,
)

_SKIN: Colour = (0.85, 0.65, 0.52, 1.0)
_HAIR: Colour = (0.25, 0.17, 0.12, 1.0)
_TROUSERS: Colour = (0.17, 0.19, 0.27, 1.0)
_SHOE: Colour = (0.1, 0.1, 0.1, 1.0)
_TYRE: Colour = (0.08, 0.08, 0.08, 1.0)
_METAL: Colour = (0.55, 0.57, 0.6, 1.0)
_SENSOR: Colour = (0.12, 0.12, 0.14, 1.0)
_SCREEN: Colour = (0.2, 0.55, 0.75, 1.0)


def person(colour: Colour) -> Solid:
    """Stand 1.75 m tall on two legs, arms down; the row's colour is the shirt's."""
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
    """Roll on a round base with two plates and a laser scanner on top."""
    base = turned([(0.03, 0.16), (0.05, 0.18), (0.14, 0.18)], colour, sides=14)
    plate = turned([(0.3, 0.17), (0.32, 0.17)], colour, sides=14)
    post = box((-0.1, 0.1, 0.14), (-0.08, 0.12, 0.3), _METAL)
    front = box((0.08, 0.1, 0.14), (0.1, 0.12, 0.3), _METAL)
    scanner = turned([(0.32, 0.05), (0.37, 0.05)], _SENSOR, at=(0.06, 0.0), sides=10)
    wheels = mirrored(wheel((0.0, 0.14, 0.05), 0.05, 0.03, _TYRE))
    return joined([base, plate, *mirrored(post), *mirrored(front), scanner, *wheels])


def cart_robot(colour: Colour) -> Solid:
    """Carry parcels in a box on four wheels, a sensor in front and a flag behind."""
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
    """Serve from three trays between two posts, with a screen for a face."""
    base = tapered((-0.25, -0.24, 0.25, 0.24), 0.04, (-0.22, -0.22, 0.22, 0.22), 0.28, colour)
    wheels = mirrored(wheel((0.0, 0.2, 0.07), 0.07, 0.05, _TYRE))
    post = box((-0.2, 0.17, 0.28), (-0.15, 0.21, 1.1), _METAL)
    trays = [box((-0.2, -0.22, z), (0.23, 0.22, z + 0.03), colour) for z in (0.5, 0.75, 1.0)]
    head = tapered((-0.22, -0.16, -0.08, 0.16), 1.06, (-0.24, -0.14, -0.14, 0.14), 1.3, colour)
    screen = tapered((-0.09, -0.13, -0.07, 0.13), 1.08, (-0.15, -0.12, -0.13, 0.12), 1.28, _SCREEN)
    return joined([base, *wheels, *mirrored(post), *trays, head, screen])
