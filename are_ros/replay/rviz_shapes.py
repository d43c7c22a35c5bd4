"""The solids of markers and axes as triangles, as large as rviz draws them."""

from collections.abc import Callable
from functools import cache
from types import MappingProxyType
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.bag import marker_decoding as kinds
from are_ros.replay.rviz_canvas import Triangles
from are_ros.replay.rviz_scene import PlacedMarker
from are_ros.world.rigid_transform import RigidTransform

Floats = npt.NDArray[np.float64]

_SIDES: Final = 16
_SHAFT, _HEAD_WIDTH = 0.77, 2.0
"""An arrow's shaft takes this share of its length; its head is so many times as thick."""


def triangles_of(marker: PlacedMarker) -> Triangles | None:
    """Return the triangles of a marker, None for one that has none (text, points, mesh of a file).

    Lines are flat ribbons, seen from above.
    """
    make = _MAKERS.get(marker.fields.kind)
    if make is None:
        return None
    corners, colours = make(marker)
    if not len(corners):
        return None
    points = marker.fixed_from_marker.apply(corners.reshape(-1, 3)).reshape(-1, 3, 3)
    return Triangles(points, colours)


def axes_of(pose: RigidTransform, length_m: float, radius_m: float) -> Triangles:
    """Return the axes of a frame: x red, y green, z blue."""
    rod = _cylinder() * (2.0 * radius_m, 2.0 * radius_m, length_m) + (0.0, 0.0, 0.5 * length_m)
    rods = [rod[..., list(order)] for order in ((2, 0, 1), (1, 2, 0), (0, 1, 2))]
    colours = np.repeat(np.column_stack((np.eye(3), np.ones(3))), len(rod), axis=0)
    points = pose.apply(np.concatenate(rods).reshape(-1, 3)).reshape(-1, 3, 3)
    return Triangles(points, colours)


def ribbon(points_m: Floats, width_m: float, *, is_closed: bool = False) -> Floats:
    """Return triangles (T, 3, 3) of a flat line through points (N, 3), seen from above."""
    ends = np.roll(points_m, -1, axis=0) if is_closed else points_m[1:]
    starts = points_m if is_closed else points_m[:-1]
    return _ribbons(starts, ends, width_m)


def _ribbons(starts: Floats, ends: Floats, width_m: float) -> Floats:
    along = ends - starts
    aside = np.column_stack((-along[:, 1], along[:, 0], np.zeros(len(along))))
    aside *= 0.5 * width_m / np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-9)
    a, b, c, d = starts - aside, starts + aside, ends + aside, ends - aside
    return np.concatenate((np.stack((a, b, c), axis=1), np.stack((a, c, d), axis=1)))


_Made = tuple[Floats, Floats]


def _plain(marker: PlacedMarker, corners: Floats) -> _Made:
    return corners, np.tile(marker.fields.colour, (len(corners), 1))


def _cube_marker(marker: PlacedMarker) -> _Made:
    return _plain(marker, _cube() * marker.fields.scale)


def _sphere_marker(marker: PlacedMarker) -> _Made:
    return _plain(marker, _sphere() * marker.fields.scale)


def _cylinder_marker(marker: PlacedMarker) -> _Made:
    return _plain(marker, _cylinder() * marker.fields.scale)


def _arrow_marker(marker: PlacedMarker) -> _Made:
    """Return an arrow along x, or from its first point to its second."""
    points, scale = marker.fields.points, marker.fields.scale
    if len(points) != 2:
        return _plain(marker, _arrow(_SHAFT, 1.0, _HEAD_WIDTH) * scale)
    way = points[1] - points[0]
    length = float(np.linalg.norm(way))
    if length == 0.0:
        return _plain(marker, np.zeros((0, 3, 3)))
    head = min(float(scale[2]), length) if scale[2] else (1.0 - _SHAFT) * length
    corners = _arrow(1.0 - head / length, float(scale[0]), float(scale[1])) * (length, 1.0, 1.0)
    return _plain(marker, corners @ _basis(way / length) + points[0])


def _list_marker(solid: Callable[[], Floats]) -> Callable[[PlacedMarker], _Made]:
    def make(marker: PlacedMarker) -> _Made:
        corners = solid() * marker.fields.scale
        every = (marker.fields.points[:, np.newaxis, np.newaxis] + corners).reshape(-1, 3, 3)
        return every, np.repeat(_colours(marker, 1), len(corners), axis=0)

    return make


def _line_marker(marker: PlacedMarker) -> _Made:
    points = marker.fields.points.astype(np.float64)
    is_strip = marker.fields.kind == kinds.LINE_STRIP
    step = 1 if is_strip else 2
    ends = points[1::step]
    corners = _ribbons(points[: -1 if is_strip else None : step], ends, marker.fields.scale[0])
    return corners, np.tile(_colours(marker, 1)[1::step], (2, 1))


def _triangle_marker(marker: PlacedMarker) -> _Made:
    count = len(marker.fields.points) // 3
    corners = marker.fields.points[: 3 * count].reshape(-1, 3, 3) * marker.fields.scale
    return corners, _colours(marker, 3)


def _colours(marker: PlacedMarker, corners: int) -> Floats:
    """Return the colours of groups of so many points, each colour's alpha times the marker's."""
    fields = marker.fields
    groups = len(fields.points) // corners
    colours = fields.colours.astype(np.float64)
    if len(colours) == groups * corners and groups:
        colours = colours.reshape(groups, corners, 4).mean(axis=1)
    elif len(colours) != groups:
        return np.tile(fields.colour, (groups, 1))
    colours[:, 3] *= fields.colour[3]
    return colours


@cache
def _cube() -> Floats:
    """Return a cube of side 1 about the origin, (12, 3, 3)."""
    faces = []
    for axis in range(3):
        for side in (-0.5, 0.5):
            corners = np.empty((4, 3))
            corners[:, axis] = side
            corners[:, (axis + 1) % 3] = (-0.5, 0.5, 0.5, -0.5)
            corners[:, (axis + 2) % 3] = (-0.5, -0.5, 0.5, 0.5)
            faces += [corners[[0, 1, 2]], corners[[0, 2, 3]]]
    return np.stack(faces)


@cache
def _cylinder() -> Floats:
    """Return a cylinder of diameter and height 1 about the origin, along z."""
    return _turned(np.array(((0.0, -0.5), (0.5, -0.5), (0.5, 0.5), (0.0, 0.5))))


@cache
def _sphere() -> Floats:
    """Return a sphere of diameter 1 about the origin."""
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _SIDES // 2 + 1)
    return _turned(0.5 * np.column_stack((np.cos(angles), np.sin(angles))))


def _arrow(shaft: float, shaft_width: float, head_width: float) -> Floats:
    """Return an arrow along x from 0 to 1."""
    profile = np.array(
        (
            (0.0, 0.0),
            (0.5 * shaft_width, 0.0),
            (0.5 * shaft_width, shaft),
            (0.5 * head_width, shaft),
            (0.0, 1.0),
        )
    )
    return _turned(profile)[..., [2, 0, 1]]


def _turned(profile: Floats) -> Floats:
    """Return the triangles of a profile (radius, z) turned about z."""
    angles = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
    circle = np.column_stack((np.cos(angles), np.sin(angles)))
    rings = np.concatenate(
        [
            np.column_stack((radius * circle, np.full(_SIDES, height)))[np.newaxis]
            for radius, height in profile
        ]
    )
    low, high = rings[:-1], rings[1:]
    after_low, after_high = np.roll(low, -1, axis=1), np.roll(high, -1, axis=1)
    one = np.stack((low, after_low, after_high), axis=2)
    other = np.stack((low, after_high, high), axis=2)
    return np.concatenate((one, other)).reshape(-1, 3, 3)


def _basis(along: Floats) -> Floats:
    """Return axes (3, 3), row by row, of which the first is a unit vector."""
    helper = np.array((0.0, 0.0, 1.0)) if abs(along[2]) < 0.9 else np.array((1.0, 0.0, 0.0))
    second = np.cross(helper, along)
    second /= np.linalg.norm(second)
    return np.stack((along, second, np.cross(along, second)))


_MAKERS: Final = MappingProxyType(
    {
        kinds.ARROW: _arrow_marker,
        kinds.CUBE: _cube_marker,
        kinds.SPHERE: _sphere_marker,
        kinds.CYLINDER: _cylinder_marker,
        kinds.LINE_STRIP: _line_marker,
        kinds.LINE_LIST: _line_marker,
        kinds.CUBE_LIST: _list_marker(_cube),
        kinds.SPHERE_LIST: _list_marker(_sphere),
        kinds.TRIANGLES: _triangle_marker,
    }
)
