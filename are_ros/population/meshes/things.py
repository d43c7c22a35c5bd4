"""Pallets and structures as a camera sees them: of boards, with cartons, stripes and handles.

Each maker builds at the size of the row's box (length, width, height). Two of a kind
differ in wood, load and wear.
"""

import numpy as np

from are_ros.population.meshes.detail import (
    AMBER,
    BLACK,
    DARK,
    RUBBER,
    STEEL,
    WHITE,
    YELLOW,
    BodySpec,
    half_turned,
    rod,
    shade_of,
    shaded,
    soft_box,
)
from are_ros.population.meshes.shapes import (
    Colour,
    Point,
    Solid,
    box,
    extruded,
    joined,
    loft,
    mirrored,
    turned,
)

_WOOD: Colour = (0.72, 0.56, 0.38, 1.0)
_CARDBOARD: Colour = (0.68, 0.51, 0.34, 1.0)
_TAPE: Colour = (0.8, 0.7, 0.5, 1.0)


def _boards(size_m: Point, colour: Colour, random: np.random.Generator) -> list[Solid]:
    """Return a pallet of deck boards, stringers, nine blocks and runners; each of its own wood."""
    length, width, height = size_m
    x, y = 0.5 * length, 0.5 * width
    runner, block, stringer = (share * height for share in (0.153, 0.694, 0.847))
    worn = float(random.uniform(0.0, 0.6))
    grey = (0.5, 0.48, 0.45)
    base = [(1.0 - 0.5 * worn) * a + 0.5 * worn * b for a, b in zip(colour, grey, strict=False)]

    def wood() -> Colour:
        return shade_of(base, random, 0.16)

    rows = (-(y - 0.05), 0.0, y - 0.05)
    columns = (-(x - 0.075), 0.0, x - 0.075)
    parts = [soft_box((-x, b - 0.05, 0.0), (x, b + 0.05, runner), 0.004, wood()) for b in rows]
    parts += [
        soft_box((a - 0.073, b - 0.05, runner), (a + 0.073, b + 0.05, block), 0.006, wood())
        for a in columns
        for b in rows
    ]
    parts += [
        soft_box((a - 0.073, -y, block), (a + 0.073, y, stringer), 0.004, wood()) for a in columns
    ]
    count = max(5, round(width / 0.145) | 1)
    pitch = (width - 0.13) / (count - 1)
    for number in range(count):
        b = -y + 0.065 + number * pitch
        half = (
            0.065 if number in {0, count - 1} or number == count // 2 else min(0.05, 0.42 * pitch)
        )
        parts.append(soft_box((-x, b - half, stringer), (x, b + half, height), 0.004, wood()))
    return parts


def pallet(spec: BodySpec) -> Solid:
    """Return a flat pallet of boards and blocks."""
    parts = _boards(spec.size_m, spec.colour, spec.generator)
    return joined([*parts, *_nails(spec.size_m)])


def _nails(size_m: Point) -> list[Solid]:
    """Return the heads of the nails over the corners of a pallet, and along its sides."""
    length, width, height = size_m
    tone: Colour = (0.3, 0.28, 0.26, 1.0)
    places = [
        (a + side, b)
        for a in (0.075 - 0.5 * length, 0.0, 0.5 * length - 0.075)
        for b in (0.065 - 0.5 * width, 0.0, 0.5 * width - 0.065)
        for side in (-0.03, 0.03)
    ]
    return [
        box((a - 0.004, b - 0.004, height - 0.002), (a + 0.004, b + 0.004, height + 0.0008), tone)
        for a, b in places
    ]


def loaded_pallet(spec: BodySpec) -> Solid:
    """Return a pallet with cartons of a size that differs, taped, labelled and strapped."""
    length, width, height = spec.size_m
    deck = min(0.144, 0.3 * height)
    parts = _boards((length, width, deck), _WOOD, spec.generator)
    across, deep = int(spec.generator.integers(2, 4)), int(spec.generator.integers(1, 3))
    layers = int(spec.generator.integers(2, 5))
    dx, dy, dz = 0.96 * length / across, 0.95 * width / deep, (height - deck) / layers
    for layer in range(layers):
        for i in range(across):
            for j in range(deep):
                shift = spec.generator.uniform(-0.008, 0.008, 2)
                x0, y0 = -0.48 * length + i * dx + shift[0], -0.475 * width + j * dy + shift[1]
                z0 = deck + layer * dz
                parts += _carton(
                    (x0, y0, z0),
                    (x0 + dx - 0.006, y0 + dy - 0.006, z0 + dz - 0.003),
                    spec.generator,
                )
    strap = spec.paint(0.1)
    for at in (-0.28, 0.24):
        a, b = at * length - 0.012, at * length + 0.012
        parts.append(box((a, -0.488 * width, deck + 0.004), (b, 0.488 * width, height), strap))
    return joined(parts)


def _carton(low: Point, high: Point, random: np.random.Generator) -> list[Solid]:
    """Return a carton with tape over its top and down its sides, and a label on some."""
    body = box(low, high, shade_of(_CARDBOARD, random, 0.12))
    middle, out = 0.5 * (low[1] + high[1]), 0.0012
    tape = box(
        (low[0] - out, middle - 0.025, high[2] - 0.09),
        (high[0] + out, middle + 0.025, high[2] + 0.0005),
        _TAPE,
    )
    parts = [body, tape]
    for axis in (0, 1):
        parts += [
            _label(low, high, axis, face, random)
            for face in (low[axis], high[axis])
            if random.random() < 0.55
        ]
    return parts


def _label(low: Point, high: Point, axis: int, face: float, random: np.random.Generator) -> Solid:
    """Return a label on the face of a carton across an axis."""
    tone = WHITE if random.random() < 0.75 else DARK
    along, out = 1 - axis, 0.0012
    tall, wide = 0.3 * (high[2] - low[2]), 0.36 * (high[along] - low[along])
    z = low[2] + float(random.uniform(0.2, 0.45)) * (high[2] - low[2])
    start = low[along] + float(random.uniform(0.12, 0.45)) * (high[along] - low[along])
    near, far = [0.0, 0.0, z], [0.0, 0.0, z + tall]
    near[axis], far[axis] = face - out, face + out
    near[along], far[along] = start, start + wide
    return box((near[0], near[1], near[2]), (far[0], far[1], far[2]), tone)


def wall(spec: BodySpec) -> Solid:
    """Return a wall of panels with joints, a skirting board, and a cap."""
    length, width, height = spec.size_m
    x, y = 0.5 * length, 0.5 * width
    skirt = min(0.1, 0.1 * height)
    parts = [
        soft_box((-x, -y, 0.0), (x, y, skirt), 0.012, shaded(spec.colour, 0.55)),
        box((-0.7 * x, -y, skirt - 0.01), (0.7 * x, y, height), shaded(spec.colour, 0.72)),
        soft_box(
            (-0.86 * x, -y, 0.985 * height), (0.86 * x, y, height), 0.006, shaded(spec.colour, 0.85)
        ),
    ]
    count = max(1, round(width / 1.0))
    for number in range(count):
        low = -y + number * width / count + 0.004
        parts.append(
            soft_box(
                (-0.83 * x, low, skirt),
                (0.83 * x, low + width / count - 0.008, 0.985 * height),
                0.003,
                spec.colour,
            )
        )
    return joined(parts)


def door(spec: BodySpec) -> Solid:
    """Return a closed door: frame, leaf with panels, hinges, lever handles and locks."""
    length, width, height = spec.size_m
    x, y, z = 0.5 * length, 0.5 * width, height
    wood = spec.paint(0.12)
    frame = min(0.08, 0.1 * width)
    parts = [
        *mirrored(soft_box((-0.6 * x, y - frame, 0.0), (0.6 * x, y, z), 0.012, WHITE)),
        soft_box((-0.6 * x, -y + frame, z - frame), (0.6 * x, y - frame, z), 0.012, WHITE),
        box((-0.26 * x, -y + frame, 0.008), (0.26 * x, y - frame, z - frame), wood),
        box((-0.24 * x, -y + frame, 0.0), (0.24 * x, y - frame, 0.02), STEEL),
    ]
    wide = y - frame - 0.1
    for low, high in ((0.09, 0.4), (0.52, 0.92)):
        for side in (-1.0, 1.0):
            a, b = sorted((0.02 if side > 0 else -0.02, side * wide))
            parts.append(
                soft_box(
                    (-0.33 * x, a, low * z), (0.33 * x, b, high * z), 0.004, shaded(wood, 0.82)
                )
            )
            parts.append(
                soft_box(
                    (-0.36 * x, a + 0.045, low * z + 0.045),
                    (0.36 * x, b - 0.045, high * z - 0.045),
                    0.002,
                    shaded(wood, 1.06),
                )
            )
    at = y - frame - 0.06
    for side in (-1.0, 1.0):
        a, b = sorted((side * 0.3 * x, side * 0.42 * x))
        parts.append(soft_box((a, at - 0.025, 0.42 * z), (b, at + 0.025, 0.52 * z), 0.008, STEEL))
        parts.append(
            rod((side * 0.3 * x, at, 0.49 * z), (side * 0.95 * x, at, 0.49 * z), 0.011, STEEL)
        )
        a, b = sorted((side * 0.82 * x, side * x))
        parts.append(soft_box((a, at - 0.13, 0.483 * z), (b, at + 0.012, 0.497 * z), 0.008, STEEL))
    parts += [
        rod((0.3 * x, -y + frame, h * z), (0.3 * x, -y + frame, (h + 0.045) * z), 0.012, STEEL)
        for h in (0.12, 0.5, 0.85)
    ]
    return joined(parts)


def barrier(spec: BodySpec) -> Solid:
    """Return a road works barrier: two rails with slanting stripes, posts, feet and a lamp."""
    length, width, height = spec.size_m
    x, y, z = 0.5 * length, 0.5 * width, height
    paint = spec.paint(0.1)
    parts: list[Solid] = []
    for low, high in ((0.45, 0.65), (0.8, 0.985)):
        parts.append(soft_box((-0.022, -y, low * z), (0.022, y, high * z), 0.008, WHITE))
        lean, wide = (high - low) * z, 0.16
        at = -y + 0.005 - lean
        while at < y:
            ring = [
                (at, low * z),
                (at + wide, low * z),
                (at + wide + lean, high * z),
                (at + lean, high * z),
            ]
            ring = [
                (min(max(a, -y + 0.004 + 0.0005 * k), y - 0.004 - 0.0005 * k), b)
                for k, (a, b) in enumerate(ring)
            ]
            if ring[1][0] - ring[0][0] > 0.01 and ring[2][0] - ring[3][0] > 0.01:
                parts.append(
                    loft(
                        [
                            [(d, a, b + e) for a, b in ring]
                            for d, e in ((-0.024, 0.0), (0.024, 0.0))
                        ],
                        paint,
                    )
                )
            at += 2.0 * wide
    post = soft_box((-0.045, 0.72 * y, 0.05 * z), (-0.012, 0.77 * y, 0.96 * z), 0.006, STEEL)
    foot = extruded(
        [(-x, 0.0), (-0.85 * x, 0.075 * z), (0.85 * x, 0.075 * z), (x, 0.0)],
        0.66 * y,
        0.83 * y,
        RUBBER,
    )
    grip = box((-0.3 * x, 0.72 * y, 0.07 * z), (0.3 * x, 0.77 * y, 0.085 * z), YELLOW)
    parts += [*mirrored(post), *mirrored(foot), *mirrored(grip)]
    parts.append(soft_box((-0.05, 0.7 * y, 0.92 * z), (0.03, 0.79 * y, z), 0.02, AMBER))
    return joined(parts)


def cone(spec: BodySpec) -> Solid:
    """Return a traffic cone with two reflecting bands on a square foot of rubber."""
    length, width, height = spec.size_m
    paint = spec.paint(0.14)
    ratio = width / length
    foot = 0.06 * height
    parts = [
        soft_box(
            (-0.5 * length, -0.5 * width, 0.0), (0.5 * length, 0.5 * width, foot), 0.05, BLACK
        ),
        turned(
            [
                (foot - 0.005, 0.41 * length),
                (foot + 0.015, 0.39 * length),
                (foot + 0.03, 0.345 * length),
            ],
            paint,
            squash=(1.0, ratio),
            sides=24,
        ),
    ]
    heights = np.array((foot, 0.28, 0.45, 0.56, 0.7, 0.96)) * (1.0, *[height] * 5)
    radii = length * np.interp(heights, (foot, 0.96 * height), (0.365, 0.085))
    for k in range(5):
        out = 0.002 if k in {1, 3} else 0.0
        parts.append(
            turned(
                [(heights[k], radii[k] + out), (heights[k + 1], radii[k + 1] + out)],
                WHITE if k in {1, 3} else paint, squash=(1.0, ratio), sides=24,
            )
        )  # fmt: skip
    parts.append(
        turned(
            [
                (0.955 * height, 0.085 * length),
                (0.985 * height, 0.09 * length),
                (height, 0.07 * length),
            ],
            paint,
            squash=(1.0, ratio),
            sides=24,
        )
    )
    return joined(parts)


def pillar(spec: BodySpec) -> Solid:
    """Return a round pillar with base, rings and capital."""
    length, width, height = spec.size_m
    x, y = 0.5 * length, 0.5 * width
    ratio = width / length
    profile = [
        (0.075, 0.84),
        (0.085, 0.84),
        (0.095, 0.78),
        (0.3, 0.78),
        (0.9, 0.72),
        (0.905, 0.78),
        (0.915, 0.78),
        (0.925, 0.9),
    ]
    shaft = turned(
        [(a * height, b * x) for a, b in profile], spec.colour, squash=(1.0, ratio), sides=32
    )
    base = soft_box((-x, -y, 0.0), (x, y, 0.07 * height), 0.02, shaded(spec.colour, 0.85))
    ring = turned(
        [(0.065 * height, 0.94 * x), (0.072 * height, 0.96 * x), (0.078 * height, 0.9 * x)],
        shaded(spec.colour, 0.9),
        squash=(1.0, ratio),
        sides=32,
    )
    top = soft_box((-x, -y, 0.92 * height), (x, y, height), 0.02, shaded(spec.colour, 0.95))
    return joined([base, ring, shaft, top])


def crate(spec: BodySpec) -> Solid:
    """Return a crate of boards with corner posts and a lid; a small one is a taped carton."""
    length, width, height = spec.size_m
    x, y = 0.5 * length, 0.5 * width
    if max(spec.size_m) < 0.95 and length * width < 0.3:
        paint = spec.paint(0.12)
        high = (x, y, height)
        tape = box((-x - 0.001, -0.03, height - 0.08), (x + 0.001, 0.03, height + 0.0006), _TAPE)
        label = box((x - 0.01, -0.6 * y, 0.3 * height), (x + 0.001, 0.2 * y, 0.6 * height), WHITE)
        side = box((-0.5 * x, -y - 0.001, 0.35 * height), (0.1 * x, -y + 0.01, 0.6 * height), WHITE)
        return joined([soft_box((-x, -y, 0.0), high, 0.008, paint), tape, label, side])
    parts = [
        box(
            (-0.95 * x, -0.95 * y, 0.03 * height),
            (0.95 * x, 0.95 * y, 0.96 * height),
            shaded(spec.colour, 0.45),
        )
    ]
    count = max(3, round(height / 0.13))
    for number in range(count):
        low, high_z = (number * height / count + 0.004, (number + 1) * height / count - 0.004)
        tone = spec.paint(0.13)
        board = soft_box((-0.985 * x, 0.9 * y, low), (0.985 * x, 0.975 * y, high_z), 0.004, tone)
        end = soft_box(
            (0.9 * x, -0.93 * y, low), (0.98 * x, 0.93 * y, high_z), 0.004, spec.paint(0.13)
        )
        parts += [*mirrored(board), end, half_turned(end)]
    for a in (-1.0, 1.0):
        lo, hi = sorted((a * 0.86 * x, a * x))
        parts += mirrored(soft_box((lo, 0.88 * y, 0.0), (hi, y, height), 0.008, spec.paint(0.1)))
    planks = max(3, round(width / 0.14))
    for number in range(planks):
        low = -0.96 * y + number * 1.92 * y / planks + 0.003
        plank = soft_box(
            (-0.97 * x, low, 0.955 * height),
            (0.97 * x, low + 1.92 * y / planks - 0.006, 0.99 * height),
            0.004,
            spec.paint(0.13),
        )
        parts.append(plank)
    return joined(parts)
