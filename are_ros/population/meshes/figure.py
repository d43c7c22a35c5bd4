"""Persons as a camera sees them: no two alike in build, clothes, hair and skin.

All lengths are shares of the stature until the figure is fitted into its box.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.world.rigid_transform import product

Floats = npt.NDArray[np.float64]
Tone = tuple[float, float, float]
"""Red, green and blue in sRGB, in [0, 1]."""
Ring = tuple[float, float, float, float, float]
"""Centre x, y, z of a horizontal ring, and half its length and width."""

_SIDES: Final = 12
_CHIN: Final = 0.87
"""The height of an adult's chin; a child's is lower, for its head is large."""
_SKINS: Final = ("#f1cdb3", "#e2b08c", "#d39a72", "#b97f57", "#99643f", "#744a2e", "#52341f")
_HAIRS: Final = ("#1c1613", "#2e2119", "#4a3222", "#6d4a2d", "#a37a47", "#c9a66b", "#7a3b1e")
_GREYS: Final = ("#d5d3cf", "#a9a7a3", "#86847f")
_TOPS: Final = (
    *("#22304d", "#e9e6df", "#7d1f2b", "#2f5d46", "#1d1d20", "#8a8f98", "#c7a04a", "#3f6f9f"),
    *("#b5523b", "#5b4a6b", "#6f7a4b", "#d8c3b0", "#365a66", "#a13b57"),
)
_BOTTOMS: Final = ("#1b2233", "#2d3f5e", "#4a5f80", "#232324", "#4c4740", "#8a7b62", "#5a5f4a")
_SHOES: Final = ("#191817", "#3b2a1f", "#e6e4df", "#5a5c60", "#7a2a24")
_REFLECTOR: Final = "#d9dce0"


class Cut(NamedTuple):
    """What somebody wears: how far sleeves and hems reach, and which hair."""

    sleeve: float
    hem: float
    is_skirt: bool
    trousers: float
    hair: str


@dataclass(frozen=True)
class Appearance:
    """How a person looks. `girth` (2,) are the shares of the box's length and width it fills."""

    skin: Tone
    hair: Tone
    top: Tone
    shirt: Tone
    bottom: Tone
    shoes: Tone
    cut: Cut
    girth: tuple[float, float]
    hips: float
    stride: float
    has_stripes: bool
    has_vest: bool

    @classmethod
    def drawn(
        cls,
        random: np.random.Generator,
        colour: Sequence[float],
        *,
        is_senior: bool = False,
        has_vest: bool = False,
    ) -> "Appearance":
        """Draw an appearance; half of the persons wear the row's colour, vests always have it."""

        def pick(tones: Sequence[str]) -> Tone:
            return tone(tones[int(random.integers(len(tones)))])

        skin, shoes, bottom, shirt = pick(_SKINS), pick(_SHOES), pick(_BOTTOMS), pick(_TOPS)
        hair = pick(_GREYS if is_senior or random.random() < 0.08 else _HAIRS)
        own: Tone = (float(colour[0]), float(colour[1]), float(colour[2]))
        wears_own = random.random() < 0.5
        top = pick(_TOPS)
        is_skirt = random.random() < 0.2
        is_short = random.random() < 0.2
        cut = Cut(
            sleeve=(0.70, 0.49, 0.49)[int(random.integers(3))],
            hem=(0.47, 0.45, 0.44, 0.38)[int(random.integers(4))],
            is_skirt=is_skirt and not has_vest,
            trousers=0.3 if is_short and not has_vest else 0.05,
            hair=("short", "short", "long", "bun", "bald", "cap")[int(random.integers(6))],
        )
        return cls(
            skin,
            hair,
            own if has_vest or wears_own else top,
            shirt,
            bottom,
            shoes,
            cut._replace(hem=0.45) if has_vest else cut._replace(hem=0.49) if cut.is_skirt else cut,
            (float(random.uniform(0.86, 1.0)), float(random.uniform(0.88, 1.0))),
            float(random.uniform(0.92, 1.1)),
            float(random.uniform(-0.028, 0.028)),
            bool(random.random() < 0.15) and not has_vest,
            has_vest,
        )


def tone(code: str) -> Tone:
    """Return the colour of #rrggbb."""
    red, green, blue = bytes.fromhex(code[1:])
    return red / 255.0, green / 255.0, blue / 255.0


class Figure(NamedTuple):
    """A closed surface: corners (F, 3, 3) [m], unit normals and sRGB colours (F, 3, 3) at them."""

    corners_m: Floats
    normals: Floats
    colours: Floats


def person_figure(size_m: tuple[float, float, float], looks: Appearance) -> Figure:
    """Return a person that stands within a box of this size, in the frame of the box's centre."""
    length_m, width_m, height_m = size_m
    # A head is 0.21 m high, somewhat less for children.
    head = min(max((0.145 + 0.04 * height_m) / height_m, 0.115), 0.2)
    low = (1.0 - head) / _CHIN
    trunk = _trunk(looks, low)
    places = np.concatenate([part.corners_m.reshape(-1, 3) for part in trunk])
    reach = np.abs(places).max(axis=0)
    stretch = 0.5 * np.array((length_m, width_m)) * looks.girth / (reach[:2] * height_m)
    parts = [*trunk, *_head(looks, head, tuple((1.0 / stretch).tolist()))]
    whole = Figure(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    scale = height_m * np.array((*stretch, 1.0 / whole.corners_m[:, :, 2].max()))
    corners = whole.corners_m * scale
    np.clip(
        corners, (-length_m / 2, -width_m / 2, 0), (length_m / 2, width_m / 2, height_m), corners
    )
    corners[:, :, 2] -= 0.5 * height_m
    normals = whole.normals / scale
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return Figure(corners, normals, whole.colours)


def _trunk(looks: Appearance, low: float) -> list[Figure]:
    """Return all below the chin, for an adult's proportions, with heights times `low`."""
    cut, hips, step = looks.cut, looks.hips, looks.stride
    parts: list[Figure] = []
    for side, swing in ((1.0, step), (-1.0, -step)):
        y = side * 0.052
        leg: list[Ring] = [
            (swing - 0.004, y * 0.9, 0.035, 0.024, 0.023),
            (swing - 0.006, y * 0.93, 0.06, 0.026, 0.025),
            (0.8 * swing - 0.010, y * 0.97, 0.19, 0.036, 0.034),
            (0.55 * swing - 0.002, y, 0.285, 0.033, 0.033),
            (0.25 * swing, y, 0.40, 0.044, 0.041 * hips),
            (0.0, 0.88 * y, 0.50, 0.050, 0.043 * hips),
        ]
        wide = 0.0 if cut.is_skirt else 0.005
        parts.append(
            _tube(
                [(x, yy, z * low, a + wide, b + wide) for x, yy, z, a, b in leg],
                lambda z: _leg(looks, z / low),
                dim=(0.0, -side, 0.35),
            )
        )
        parts.append(_shoe(looks, swing, side * 0.048))
        arm: list[Ring] = [
            (0.030 - swing, side * 0.142, 0.425, 0.012, 0.006),
            (0.028 - swing, side * 0.144, 0.455, 0.020, 0.011),
            (0.020 - 0.9 * swing, side * 0.143, 0.490, 0.017, 0.014),
            (0.005 - 0.6 * swing, side * 0.142, 0.570, 0.024, 0.021),
            (-0.008 - 0.3 * swing, side * 0.139, 0.640, 0.024, 0.023),
            (-0.008, side * 0.130, 0.735, 0.030, 0.027),
            (-0.004, side * 0.115, 0.790, 0.035, 0.029),
            (-0.004, side * 0.096, 0.822, 0.020, 0.020),
        ]
        parts.append(
            _tube(
                [(x, yy, z * low, a, b) for x, yy, z, a, b in arm],
                lambda z: looks.skin if z < cut.sleeve * low else _sleeve(looks, z / low),
                dim=(0.0, -side, 0.4),
            )
        )
    flare = 0.014 if cut.hem < 0.44 else 0.0
    torso: list[Ring] = [
        (0.0, 0.0, cut.hem, 0.070 + flare, (0.104 + flare) * hips),
        (-0.002, 0.0, 0.51, 0.072, 0.101 * hips),
        (0.0, 0.0, 0.55, 0.069, 0.096 * hips),
        (0.004, 0.0, 0.62, 0.061, 0.086),
        (0.004, 0.0, 0.72, 0.070, 0.098),
        (0.0, 0.0, 0.775, 0.066, 0.106),
        (-0.006, 0.0, 0.822, 0.050, 0.090),
        (-0.008, 0.0, 0.852, 0.034, 0.044),
    ]
    parts.append(
        _tube(
            [(x, y, z * low, a, b) for x, y, z, a, b in torso],
            lambda z: _front(looks, z / low),
            bend=0.82,
            finer=3,
        )
    )
    if cut.is_skirt:
        skirt: list[Ring] = [
            (0.0, 0.0, 0.27, 0.092, 0.125),
            (0.0, 0.0, 0.38, 0.084, 0.115 * hips),
            (0.0, 0.0, 0.52, 0.066, 0.093 * hips),
        ]
        parts.append(
            _tube([(x, y, z * low, a, b) for x, y, z, a, b in skirt], lambda _: looks.bottom)
        )
    neck: list[Ring] = [
        (-0.012, 0.0, 0.83, 0.034, 0.036),
        (-0.006, 0.0, 0.86, 0.031, 0.031),
        (0.000, 0.0, 0.90, 0.030, 0.030),
    ]
    shaded: Tone = (0.82 * looks.skin[0], 0.8 * looks.skin[1], 0.78 * looks.skin[2])
    parts.append(_tube([(x, y, z * low, a, b) for x, y, z, a, b in neck], lambda _: shaded))
    return parts


def _leg(looks: Appearance, z: float) -> Tone:
    """Return the colour of a leg at a height."""
    return looks.skin if looks.cut.is_skirt or z < looks.cut.trousers else looks.bottom


def _sleeve(looks: Appearance, z: float) -> Tone:
    """Return the colour of a sleeve at a height."""
    return looks.shirt if looks.has_vest else _stripes(looks, z)


def _stripes(looks: Appearance, z: float) -> Tone:
    return looks.shirt if looks.has_stripes and int(z * 40.0) % 2 else looks.top


def _front(looks: Appearance, z: float) -> Tone:
    """Return the colour of the torso at a height."""
    if looks.has_vest and (0.55 < z < 0.585 or 0.64 < z < 0.675):
        return tone(_REFLECTOR)
    return _stripes(looks, z)


def _shoe(looks: Appearance, x: float, y: float) -> Figure:
    """Return a shoe that stands on the ground: rings from heel to toe."""
    rings: list[Ring] = [
        (0.013, y, x - 0.036, 0.013, 0.015),
        (0.022, y, x - 0.028, 0.022, 0.021),
        (0.025, y, x, 0.025, 0.023),
        (0.020, 1.08 * y, x + 0.035, 0.020, 0.026),
        (0.015, 1.14 * y, x + 0.075, 0.015, 0.027),
        (0.010, 1.14 * y, x + 0.100, 0.010, 0.016),
    ]
    # A tube along x: its own z, x, y are x, -z, y (a rotation).
    lying = _tube([(-z, y, x, a, b) for z, y, x, a, b in rings], lambda _: looks.shoes, bend=0.75)
    turn = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    return Figure(product(lying.corners_m, turn), product(lying.normals, turn), lying.colours)


def _head(looks: Appearance, head: float, squeeze: tuple[float, ...]) -> list[Figure]:
    """Return head, face and hair, squeezed so that the fitting into the box leaves them round."""
    s = head / 0.13
    chin = 1.0 - head
    sx, sy = squeeze

    def at(rings: Sequence[Ring]) -> list[Ring]:
        return [
            (0.006 + x * s * sx, y * s * sy, chin + z * s, a * s * sx, b * s * sy)
            for x, y, z, a, b in rings
        ]

    skin = looks.skin
    lips: Tone = (0.72 * skin[0] + 0.05, 0.52 * skin[1], 0.52 * skin[2])
    skull = at(
        [
            (0.016, 0.0, 0.000, 0.022, 0.014),
            (0.012, 0.0, 0.008, 0.036, 0.026),
            (0.006, 0.0, 0.030, 0.050, 0.037),
            (0.002, 0.0, 0.060, 0.056, 0.043),
            (0.000, 0.0, 0.085, 0.057, 0.0445),
            (-0.002, 0.0, 0.108, 0.048, 0.038),
            (-0.003, 0.0, 0.122, 0.030, 0.024),
            (-0.004, 0.0, 0.127, 0.010, 0.008),
        ]
    )
    parts = [_tube(skull, lambda _: skin)]
    nose = at([(0.055, 0.0, 0.040, 0.010, 0.009), (0.053, 0.0, 0.068, 0.004, 0.005)])
    mouth = at([(0.050, 0.0, 0.022, 0.0055, 0.013), (0.050, 0.0, 0.028, 0.0055, 0.013)])
    parts += [
        _tube(nose, lambda _: skin, sides=6, finer=1),
        _tube(mouth, lambda _: lips, sides=6, finer=1),
    ]
    for side in (1.0, -1.0):
        eye = [
            (0.0475, side * 0.017, 0.064, 0.006, 0.007),
            (0.0475, side * 0.017, 0.069, 0.006, 0.007),
        ]
        brow = [
            (0.0475, side * 0.017, 0.077, 0.007, 0.009),
            (0.047, side * 0.017, 0.080, 0.007, 0.009),
        ]
        ear = [
            (-0.004, side * 0.043, 0.045, 0.006, 0.005),
            (-0.006, side * 0.044, 0.075, 0.010, 0.005),
        ]
        parts.append(_tube(at(eye), lambda _: (0.16, 0.12, 0.1), sides=6, finer=1))
        parts.append(_tube(at(brow), lambda _: looks.hair, sides=6, finer=1))
        parts.append(_tube(at(ear), lambda _: skin, sides=6, finer=1))
    return parts + _hair(looks, at)


def _hair(looks: Appearance, at: Callable[[Sequence[Ring]], list[Ring]]) -> list[Figure]:
    """Return the hair, or what covers it."""
    style = looks.cut.hair
    if style == "bald":
        return []
    cap = at(
        [
            (-0.020, 0.0, 0.045, 0.036, 0.038),
            (-0.017, 0.0, 0.062, 0.047, 0.0455),
            (-0.008, 0.0, 0.090, 0.056, 0.049),
            (-0.003, 0.0, 0.104, 0.056, 0.046),
            (-0.003, 0.0, 0.120, 0.042, 0.034),
            (-0.004, 0.0, 0.1295, 0.014, 0.011),
        ]
    )
    if style == "cap":
        peak = at([(0.045, 0.0, 0.092, 0.052, 0.034), (0.040, 0.0, 0.097, 0.050, 0.034)])
        return [_tube(cap, lambda _: looks.shirt), _tube(peak, lambda _: looks.shirt)]
    parts = [_tube(cap, lambda _: looks.hair)]
    if style == "long":
        fall = [
            (-0.030, 0.0, -0.045, 0.016, 0.034),
            (-0.028, 0.0, -0.015, 0.026, 0.046),
            (-0.022, 0.0, 0.030, 0.035, 0.050),
            (-0.016, 0.0, 0.080, 0.042, 0.049),
        ]
        parts.append(_tube(at(fall), lambda _: looks.hair))
    if style == "bun":
        bun = [
            (-0.062, 0.0, 0.078, 0.010, 0.010),
            (-0.064, 0.0, 0.090, 0.022, 0.022),
            (-0.062, 0.0, 0.108, 0.020, 0.020),
            (-0.060, 0.0, 0.118, 0.007, 0.007),
        ]
        parts.append(_tube(at(bun), lambda _: looks.hair, sides=10))
    return parts


def _tube(
    rings: Sequence[Ring],
    tone_at: Callable[[float], Tone],
    *,
    sides: int = _SIDES,
    bend: float = 1.0,
    finer: int = 2,
    dim: tuple[float, float, float] | None = None,
) -> Figure:
    """Return the smooth closed tube over rings that rise, in the colours of its heights.

    A `bend` below 1 makes the ellipses squarer. `dim` is a direction (x, y) in which the surface
    is darker, for another part of the body is near, and by which share.
    """
    from scipy.interpolate import PchipInterpolator  # takes 0.3 s, and few commands need figures

    controls = np.array(rings)
    steps = np.arange(0.0, len(controls) - 1 + 1e-9, 1.0 / finer)
    along = PchipInterpolator(np.arange(len(controls)), controls)(steps)
    turns = 2.0 * np.pi * np.arange(sides) / sides
    circle = np.stack((np.cos(turns), np.sin(turns)), axis=1)
    circle = np.sign(circle) * np.abs(circle) ** bend
    points = np.empty((len(along), sides, 3))
    points[:, :, :2] = along[:, np.newaxis, :2] + circle * along[:, np.newaxis, 3:]
    points[:, :, 2] = along[:, 2, np.newaxis]
    around = np.roll(points, -1, axis=1) - np.roll(points, 1, axis=1)
    normals = np.cross(around, np.gradient(points, axis=0))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    here, after = np.arange(sides), (np.arange(sides) + 1) % sides
    # The corners of the two triangles of a band's quadrilateral: which ring, and which place in it.
    upper = np.array((0, 0, 1, 0, 1, 1))
    place = np.stack((here, after, after, here, after, here), axis=1)
    bands = np.arange(len(along) - 1)
    ring = np.broadcast_to(bands[:, np.newaxis, np.newaxis] + upper, (len(bands), sides, 6))
    column = np.broadcast_to(place, ring.shape)
    corners = points[ring, column].reshape(-1, 3, 3)
    across = normals[ring, column].reshape(-1, 3, 3)
    tones = np.array([tone_at(0.5 * (along[k, 2] + along[k + 1, 2])) for k in bands])
    colours = np.repeat(tones, 2 * sides, axis=0)[:, np.newaxis].repeat(3, axis=1)
    if dim is not None:
        inward = np.maximum(across[:, :, 0] * dim[0] + across[:, :, 1] * dim[1], 0.0)
        colours = colours * (1.0 - dim[2] * inward)[:, :, np.newaxis]
    fan = np.stack((np.zeros(sides - 2, dtype=int), here[2:], here[1:-1]), axis=1)
    ends = [
        (points[0][fan], (0.0, 0.0, -1.0), tones[0]),
        (points[-1][fan[:, ::-1]], (0.0, 0.0, 1.0), tones[-1]),
    ]
    return Figure(
        np.concatenate((corners, *(end for end, _, _ in ends))),
        np.concatenate((across, *(np.broadcast_to(n, end.shape) for end, n, _ in ends))),
        np.concatenate((colours, *(np.broadcast_to(c, end.shape) for end, _, c in ends))),
    )
