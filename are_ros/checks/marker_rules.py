"""The rules of visualization_msgs/Marker that rviz enforces, applied to one marker.

The node writes cubes, triangles, texts and arrows: another kind is a fault.
"""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros.bag.marker_decoding import (
    ADD,
    ARROW,
    CUBE,
    DELETE,
    DELETE_ALL,
    TEXT,
    TRIANGLES,
    MarkerFields,
)
from are_ros.wording import counted

_UNIT_TOLERANCE: Final = 1e-3
"""How far the squared norm of a rotation may be from 1; rviz warns from 0.01 on."""

_INVISIBLE_NS: Final = 100_000
"""rviz takes a lifetime of no more than this as endless."""

_KINDS: Final = (ARROW, CUBE, TEXT, TRIANGLES)


class MarkerChange(NamedTuple):
    """What one marker does to a viewer, and the rule that it breaks ("" for none).

    `alpha` is the opacity of what it draws.
    """

    action: int
    key: tuple[str, int]
    frame_id: str
    lifetime_ns: int
    fault: str
    alpha: float


def change_of(marker: MarkerFields) -> MarkerChange:
    """Return what a marker does, with the first rule that it breaks; the frame may be any."""
    fault = next(_faults(marker), "")
    key = (marker.namespace, marker.number)
    alpha = float(marker.colours[0, 3] if len(marker.colours) else marker.colour[3])
    return MarkerChange(marker.action, key, marker.frame_id, marker.lifetime_ns, fault, alpha)


def _faults(marker: MarkerFields) -> Iterator[str]:
    """Yield what breaks a rule of every action, then what breaks one of ADD."""
    if not marker.frame_id:
        yield "names no frame"
    if marker.action not in {ADD, DELETE, DELETE_ALL}:
        yield f"has the action {marker.action}, which there is not"
    if marker.kind not in _KINDS:
        yield f"is of type {marker.kind}, which the node does not write"
    yield from _endless_numbers(marker)
    if marker.action == ADD:
        yield from _wrong_looks(marker)
        yield from _wrong_points(marker)
        yield from _wrong_texts(marker)


def _endless_numbers(marker: MarkerFields) -> Iterator[str]:
    """Find a number that is not finite: rviz then ignores the whole marker, a DELETE too."""
    fields = (
        ("position", marker.position),
        ("rotation", marker.rotation_xyzw),
        ("scale", marker.scale),
        ("colour", marker.colour),
        ("points", marker.points),
        ("colours", marker.colours),
    )
    for name, values in fields:
        if not np.isfinite(values).all():
            yield f"has numbers that are not finite, in its {name}"


def _wrong_looks(marker: MarkerFields) -> Iterator[str]:
    square, colour = float(marker.rotation_xyzw @ marker.rotation_xyzw), marker.colour
    if abs(square - 1.0) > _UNIT_TOLERANCE:
        yield "has a rotation that is no unit quaternion"
    if (_used_scale(marker) <= 0.0).any():
        yield f"has the scale {marker.scale.tolist()}"
    if colour.min() < 0.0 or colour.max() > 1.0 or colour[3] == 0.0:
        yield f"has the colour {colour.tolist()}"
    if marker.lifetime_ns < 0:
        yield "has a negative lifetime"
    elif 0 < marker.lifetime_ns <= _INVISIBLE_NS:
        yield f"has a lifetime of {marker.lifetime_ns} ns, which rviz takes as endless"


def _used_scale(marker: MarkerFields) -> NDArray[np.float64]:
    """Return the components of the scale that count; an arrow between points chooses its head."""
    if marker.kind == TEXT:
        return marker.scale[2:]
    is_between_points = marker.kind == ARROW and len(marker.points) > 0
    return marker.scale[:2] if is_between_points else marker.scale


def _wrong_points(marker: MarkerFields) -> Iterator[str]:
    """Check points and their colours: none, one of each, or one of each triangle."""
    points, colours = len(marker.points), len(marker.colours)
    if marker.kind == TRIANGLES:
        points_fit, fitting = points > 0 and points % 3 == 0, {0, points, points // 3}
    else:
        points_fit, fitting = points in ({0, 2} if marker.kind == ARROW else {0}), {0}
    if not points_fit:
        yield f"has {counted(points, 'point')}"
    if colours not in fitting:
        yield f"has {counted(colours, 'colour')} for {counted(points, 'point')}"
    elif ((marker.colours < 0.0) | (marker.colours > 1.0)).any():
        yield "has colours outside of 0 to 1"
    elif colours and not marker.colours[:, 3].any():
        yield "has only colours with an alpha of 0"
    if marker.texture_points:
        yield f"has {counted(marker.texture_points, 'coordinate')} of a texture"


def _wrong_texts(marker: MarkerFields) -> Iterator[str]:
    if marker.kind == TEXT and not marker.text.strip():
        yield "has no text"
    if marker.kind != TEXT and marker.text:
        yield f"has the text '{marker.text}', which nobody sees"
    if marker.mesh or marker.keeps_materials:
        yield "names a mesh, which nobody sees"
