"""The colours and marks of all pictures, by class, behaviour, event and time."""

import colorsys
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import cycle
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
_Value = TypeVar("_Value")
Rgb = tuple[int, int, int]
"""Red, green and blue from 0 to 255."""

WHITE: Final[Rgb] = (255, 255, 255)
INK: Final[Rgb] = (35, 40, 46)
FAINT_INK: Final[Rgb] = (102, 112, 122)
GREY: Final[Rgb] = (108, 117, 125)
"""What stands for all classes in a legend."""
EDGE: Final[Rgb] = (211, 215, 219)
PAPER: Final[Rgb] = (236, 238, 240)
"""Where the map is unknown."""
FLOOR: Final[Rgb] = (252, 252, 251)
WALL: Final[Rgb] = (88, 95, 104)

SEEN: Final[Rgb] = (79, 159, 216)
"""What the camera sees."""
ROBOT: Final[Rgb] = (47, 127, 193)
START: Final[Rgb] = (124, 192, 232)
END: Final[Rgb] = (11, 47, 107)
"""The robot's path goes from START over ROBOT to END."""
CONTACT: Final[Rgb] = (230, 57, 70)
DISPLACED: Final[Rgb] = (255, 209, 102)
DISPLACED_EDGE: Final[Rgb] = (92, 68, 0)
FOLLOWING: Final[Rgb] = (90, 98, 106)

LAW: Final[Rgb] = (209, 73, 91)
"""The curve of a law, over what was counted."""
BAR: Final[Rgb] = (185, 200, 216)
BAND: Final[Rgb] = (233, 238, 243)
TINT: Final[Rgb] = (47, 93, 138)
SERIES: Final[tuple[Rgb, ...]] = (
    (232, 89, 12),
    (11, 114, 133),
    (92, 148, 13),
    (194, 37, 92),
    (24, 100, 171),
    (134, 46, 156),
    (95, 61, 17),
)
"""Colours of a series: the components of a mixture, the poses that fit a map."""

_CLASSES: Final[Mapping[str, Rgb]] = {
    "person": (209, 73, 91),
    "car": (106, 76, 147),
    "pallet": (201, 135, 31),
    "robot": (42, 157, 143),
    "structure": (125, 90, 80),
}
_FURTHER_CLASSES: Final[tuple[Rgb, ...]] = (
    (58, 125, 68),
    (181, 23, 158),
    (141, 153, 174),
    (224, 122, 31),
    (95, 15, 64),
    (96, 108, 56),
)
_SHADES: Final = (0.0, 0.1, -0.1, 0.05, -0.06)
_MARKS: Final[Mapping[str, Any]] = {
    "square": "s",
    "disc": "o",
    "diamond": "D",
    "right": ">",
    "hexagon": "h",
    "up": "^",
    "bars": ((-3, 5), (-0.6, 5), (-0.6, -3.6), (0.6, -3.6), (0.6, 5), (3, 5), (3, -5), (-3, -5)),
    "star": "*",
    "cross": "X",
    "down": "v",
    "left": "<",
    "plus": "P",
    "pentagon": "p",
    "lozenge": "d",
    "turned_hexagon": "H",
    "burst": (8, 1, 0.0),
}
"""The names of marks, with the markers of matplotlib; a sequence has the corners of its own."""
_BEHAVIOURS: Final[Mapping[str, str]] = {
    "standing": "square",
    "walking": "disc",
    "wandering": "diamond",
    "running": "right",
    "driving": "hexagon",
    "following": "up",
    "stopping": "bars",
    "gathering": "star",
    "crossing": "cross",
    "avoiding": "down",
    "leaving": "left",
    "along_way": "plus",
}
_FURTHER_BEHAVIOURS: Final = ("pentagon", "lozenge", "turned_hexagon", "disc", "square", "diamond")

_BEHAVIOUR_COLOURS: Final[Mapping[str, Rgb]] = {
    "walking": (52, 120, 190),
    "driving": (52, 120, 190),
    "along_way": (94, 160, 214),
    "running": (224, 62, 54),
    "stopping": (150, 98, 58),
    "standing": (148, 156, 164),
    "wandering": (86, 186, 190),
    "following": (122, 78, 168),
    "gathering": (232, 122, 178),
    "crossing": (240, 168, 36),
    "avoiding": (104, 156, 52),
    "leaving": (38, 44, 60),
}


def mixed(colour: Rgb, share: float, ground: Rgb = FLOOR) -> Rgb:
    """Return a colour laid over a ground with an opacity of `share`."""
    red, green, blue = (
        round(share * a + (1.0 - share) * b) for a, b in zip(colour, ground, strict=True)
    )
    return red, green, blue


def hex_of(colour: Rgb) -> str:
    """Return "#rrggbb", as matplotlib takes it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def _completed(
    known: Mapping[str, _Value], further: Sequence[_Value], names: Sequence[str]
) -> dict[str, _Value]:
    """Return what is known, and for the other names in their order what is further, in turn."""
    return {**known, **dict(zip(sorted(set(names) - set(known)), cycle(further), strict=False))}


def class_colours(names: Sequence[str]) -> dict[str, Rgb]:
    """Return a colour for each class; the classes of the shipped catalogue keep their own."""
    return _completed(_CLASSES, _FURTHER_CLASSES, names)


def with_class(colours: Mapping[str, Rgb], name: str) -> dict[str, Rgb]:
    """Return colours of `class_colours` with that of one more class; the others keep theirs."""
    number = (len(colours) - len(_CLASSES)) % len(_FURTHER_CLASSES)
    return {**colours, name: _FURTHER_CLASSES[number]}


def shade_of(colour: Rgb, artefact_id: int) -> Rgb:
    """Return the colour of a class, a little lighter or darker by the id, to tell paths apart."""
    hue, light, saturation = colorsys.rgb_to_hls(*(part / 255.0 for part in colour))
    light = min(max(light + _SHADES[artefact_id % len(_SHADES)], 0.0), 1.0)
    red, green, blue = (round(255.0 * part) for part in colorsys.hls_to_rgb(hue, light, saturation))
    return red, green, blue


def time_colour(fraction: float) -> Rgb:
    """Return the colour of an instant on the robot's path, from 0 (its start) to 1 (its end)."""
    if fraction < 0.5:
        return mixed(ROBOT, 2.0 * max(fraction, 0.0), START)
    return mixed(END, 2.0 * min(fraction, 1.0) - 1.0, ROBOT)


def behaviour_marks(names: Sequence[str]) -> dict[str, str]:
    """Return the mark of each behaviour, a name for `mark_outline`; a user's own by their names."""
    return _completed(_BEHAVIOURS, _FURTHER_BEHAVIOURS, names)


def behaviour_colours(names: Sequence[str]) -> dict[str, Rgb]:
    """Return a colour for each behaviour; a user's own by their names."""
    return _completed(_BEHAVIOUR_COLOURS, _FURTHER_CLASSES, names)


@cache
def mark_outline(name: str) -> Floats:
    """Return the outline (N, 2) of a mark of `_MARKS`, about (0, 0), x right, y down, 1 wide."""
    from matplotlib.markers import MarkerStyle

    style = MarkerStyle(_MARKS[name])
    (corners,) = style.get_path().transformed(style.get_transform()).to_polygons()
    outline: Floats = np.asarray(corners)[:-1] * (1.0, -1.0)
    return outline / float(np.ptp(outline, axis=0).max())
