"""What the rules of visualization_msgs/Marker, as rviz enforces them, say of one marker."""

from collections.abc import Callable
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from are_ros.bag.marker_decoding import (
    ADD,
    ARROW,
    ARROW_STRIP,
    CUBE,
    CUBE_LIST,
    CYLINDER,
    DELETE,
    DELETE_ALL,
    LINE_LIST,
    LINE_STRIP,
    MESH,
    POINTS,
    SPHERE,
    SPHERE_LIST,
    TEXT,
    TRIANGLES,
    MarkerFields,
)
from are_ros.wording import counted

_UNIT_TOLERANCE: Final = 1e-3
"""How far the squared norm of a rotation may be from 1; rviz warns from 0.01 on."""

_INVISIBLE_NS: Final = 100_000
"""rviz takes a lifetime of no more than this as endless."""

_USED_SCALES: Final = MappingProxyType({TEXT: (2,), LINE_STRIP: (0,), LINE_LIST: (0,)})
_GROUPS: Final = MappingProxyType({LINE_LIST: 2, TRIANGLES: 3})
_LEAST: Final = MappingProxyType({LINE_STRIP: 2, ARROW_STRIP: 2})
_LISTS: Final = (LINE_STRIP, LINE_LIST, CUBE_LIST, SPHERE_LIST, POINTS, TRIANGLES, ARROW_STRIP)
_COLOURED: Final = (LINE_STRIP, LINE_LIST, CUBE_LIST, SPHERE_LIST, POINTS, TRIANGLES)
_KINDS: Final = (*_LISTS, ARROW, CUBE, SPHERE, CYLINDER, TEXT, MESH)


class MarkerChange(NamedTuple):
    """What one marker does to a viewer, and what is wrong with it ("" if nothing is).

    `alpha` is that of what it draws.
    """

    action: int
    key: tuple[str, int]
    frame_id: str
    lifetime_ns: int
    fault: str
    alpha: float = 1.0


def change_of(marker: MarkerFields) -> MarkerChange:
    """Return what a marker does, with the first rule that it breaks; of frames each will do."""
    rules = _RULES_OF_ALL if marker.action != ADD else (*_RULES_OF_ALL, *_RULES_OF_ADD)
    fault = next(filter(None, (rule(marker) for rule in rules)), "")
    key = (marker.namespace, marker.number)
    alpha = float(marker.colours[0, 3] if len(marker.colours) else marker.colour[3])
    return MarkerChange(marker.action, key, marker.frame_id, marker.lifetime_ns, fault, alpha)


def _frame_fault(marker: MarkerFields) -> str:
    return "" if marker.frame_id else "names no frame"


def _action_fault(marker: MarkerFields) -> str:
    if marker.action not in {ADD, DELETE, DELETE_ALL}:
        return f"has the action {marker.action}, which there is not"
    return "" if marker.kind in _KINDS else f"is of type {marker.kind}, which there is not"


def _number_fault(marker: MarkerFields) -> str:
    """Find what is not finite: rviz leaves out the whole marker then, a DELETE too."""
    fields = (
        ("position", marker.position),
        ("rotation", marker.rotation_xyzw),
        ("scale", marker.scale),
        ("colour", marker.colour),
        ("points", marker.points),
        ("colours", marker.colours),
    )
    wrong = next((name for name, values in fields if not np.isfinite(values).all()), "")
    return f"has numbers that are not finite, in its {wrong}" if wrong else ""


def _rotation_fault(marker: MarkerFields) -> str:
    square = float(marker.rotation_xyzw @ marker.rotation_xyzw)
    is_unit = abs(square - 1.0) <= _UNIT_TOLERANCE
    return "" if is_unit else "has a rotation that is no unit quaternion"


def _scale_fault(marker: MarkerFields) -> str:
    used = marker.scale[list(_used_scales(marker))]
    return f"has the scale {marker.scale.tolist()}" if (used <= 0.0).any() else ""


def _used_scales(marker: MarkerFields) -> tuple[int, ...]:
    """Return which components of the scale count; an arrow between points chooses its head."""
    if marker.kind == POINTS or (marker.kind == ARROW and len(marker.points)):
        return (0, 1)
    return _USED_SCALES.get(marker.kind, (0, 1, 2))


def _colour_fault(marker: MarkerFields) -> str:
    colour = marker.colour
    own_materials = marker.kind == MESH and marker.keeps_materials and not colour.any()
    if colour.min() < 0.0 or colour.max() > 1.0 or (colour[3] == 0.0 and not own_materials):
        return f"has the colour {colour.tolist()}"
    return ""


def _lifetime_fault(marker: MarkerFields) -> str:
    if marker.lifetime_ns < 0:
        return "has a negative lifetime"
    if 0 < marker.lifetime_ns <= _INVISIBLE_NS:
        return f"has a lifetime of {marker.lifetime_ns} ns, which rviz takes as endless"
    return ""


def _points_fault(marker: MarkerFields) -> str:
    count = len(marker.points)
    if marker.kind == ARROW:
        fits = count in {0, 2}
    elif marker.kind in _LISTS:
        fits = count >= _LEAST.get(marker.kind, 1) and count % _GROUPS.get(marker.kind, 1) == 0
    else:
        fits = count == 0
    return "" if fits else f"has {counted(count, 'point')}"


def _colours_fault(marker: MarkerFields) -> str:
    """Check the colours of points: none, one of each, or one of each triangle."""
    count, points = len(marker.colours), len(marker.points)
    fits = {0, points} if marker.kind in _COLOURED else {0}
    if marker.kind == TRIANGLES:
        fits |= {points // 3}
    if count not in fits:
        return f"has {counted(count, 'colour')} for {counted(points, 'point')}"
    if not count:
        return ""
    if ((marker.colours < 0.0) | (marker.colours > 1.0)).any():
        return "has colours outside of 0 to 1"
    return "" if marker.colours[:, 3].any() else "has only colours with an alpha of 0"


def _texture_fault(marker: MarkerFields) -> str:
    fits = {0, len(marker.points)} if marker.kind == TRIANGLES else {0}
    count = marker.texture_points
    return "" if count in fits else f"has {counted(count, 'coordinate')} of a texture"


def _text_fault(marker: MarkerFields) -> str:
    if marker.kind == TEXT:
        return "" if marker.text.strip() else "has no text"
    return f"has the text '{marker.text}', which nobody sees" if marker.text else ""


def _mesh_fault(marker: MarkerFields) -> str:
    if marker.kind == MESH:
        return "" if marker.mesh else "has no mesh"
    is_plain = not marker.mesh and not marker.keeps_materials
    return "" if is_plain else "names a mesh, which nobody sees"


_Rule = Callable[[MarkerFields], str]
_RULES_OF_ALL: Final[tuple[_Rule, ...]] = (_frame_fault, _action_fault, _number_fault)
_RULES_OF_ADD: Final[tuple[_Rule, ...]] = (
    _rotation_fault,
    _scale_fault,
    _colour_fault,
    _lifetime_fault,
    _points_fault,
    _colours_fault,
    _texture_fault,
    _text_fault,
    _mesh_fault,
)
