"""Which boxes show in an image before the environment: a search from wide cones down to pixels."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder._occlusion_types import INFINITE
from are_ros.builder._outlook import Outlook, look_into
from are_ros.builder._ray_leaps import inverse
from are_ros.builder._ray_tiles import PIXELS
from are_ros.builder._view_pyramid import NONE, ViewPyramid

_ZERO: Final = np.float32(0.0)
_GROWN_M: Final = 1e-3
_GROWN_PER_M: Final = 2e-6
_STACK: Final = 64

_Floats = npt.NDArray[np.float32]


class _Box(NamedTuple):
    """One box for the search: turn from the optical frame, camera, half sizes in its frame."""

    turn: _Floats
    camera_m: _Floats
    half_m: _Floats
    towards: _Floats
    far_m: _Floats


@compiled
def seen_boxes(
    pyramid: ViewPyramid, outlook: Outlook, packed: npt.NDArray[np.float64]
) -> npt.NDArray[np.bool_]:
    """Tell which boxes, rows (N, 8) as `OrientedBoxes.packed`, show in a pixel: bool (N,).

    Each box is grown by a millimetre and two millionths of its distance on every side, more than
    all rounding: so a box that the z-buffer counts a visible pixel of is always among them. The
    pixel that showed the last box is tried first; it often shows the next one, too.
    """
    seen = np.zeros(packed.shape[0], np.bool_)
    last = np.full(2, NONE, np.int64)
    box = _Box(
        np.empty((3, 3), np.float32),
        np.empty(3, np.float32),
        np.empty(3, np.float32),
        np.empty(3, np.float32),
        np.empty(1, np.float32),
    )
    for row in range(packed.shape[0]):
        _describe(outlook, packed[row], box)
        if last[0] != NONE and _shows(pyramid, outlook, box, last[0], last[1]):
            seen[row] = True
        else:
            seen[row] = _find(pyramid, outlook, box, last)
    return seen


@compiled
def _describe(outlook: Outlook, packed: npt.NDArray[np.float64], box: _Box) -> None:
    """Write the box of a row as the camera sees it; differences are taken before rounding."""
    dx, dy, dz = (
        outlook.camera_m[0] - packed[0],
        outlook.camera_m[1] - packed[1],
        outlook.camera_m[2] - packed[2],
    )
    cosine, sine = packed[3], packed[4]
    box.camera_m[0] = cosine * dx + sine * dy
    box.camera_m[1] = cosine * dy - sine * dx
    box.camera_m[2] = dz
    turn = outlook.map_from_camera
    size = 0.0
    for axis in range(3):
        box.turn[0, axis] = cosine * turn[0, axis] + sine * turn[1, axis]
        box.turn[1, axis] = cosine * turn[1, axis] - sine * turn[0, axis]
        box.turn[2, axis] = turn[2, axis]
        box.towards[axis] = -(turn[0, axis] * dx + turn[1, axis] * dy + turn[2, axis] * dz)
        size += packed[5 + axis] * packed[5 + axis]
    far = np.sqrt(dx * dx + dy * dy + dz * dz) + np.sqrt(size)
    grown = _GROWN_M + _GROWN_PER_M * far
    for axis in range(3):
        box.half_m[axis] = packed[5 + axis] + grown
    box.far_m[0] = far + 2.0 * grown


@compiled
def _find(pyramid: ViewPyramid, outlook: Outlook, box: _Box, last: npt.NDArray[np.int64]) -> bool:
    """Search the pyramid, what lies nearest to the box's middle first; keep the pixel found."""
    tiles = outlook.known.size
    stack = np.empty(_STACK, np.int64)
    stack[0], height = pyramid.axes.shape[0] - 1, min(pyramid.axes.shape[0], 1)
    while height:
        height -= 1
        node = stack[height]
        if not _may_show(pyramid, outlook, box, node):
            continue
        if node >= tiles:
            height = _push(pyramid, box, node, stack, height)
            continue
        if not outlook.known[node]:
            look_into(pyramid, outlook, node)
        pixel = _shown_in(pyramid, outlook, box, node)
        if pixel != NONE:
            last[0], last[1] = node, pixel
            return True
    return False


@compiled
def _may_show(pyramid: ViewPyramid, outlook: Outlook, box: _Box, node: int) -> bool:
    """Tell whether a ray below a node may meet the box as near as the farthest of them sees.

    Where a ray meets the box, at t <= far, the axis at t is within `spread` far of it: so the axis
    meets the box grown by that much, and not later.
    """
    axis = pyramid.axes[node]
    grown = pyramid.spreads[node] * box.far_m[0]
    return bool(_entry(box, axis[0], axis[1], axis[2], grown) <= outlook.farthest_m[node])


@compiled
def _push(
    pyramid: ViewPyramid, box: _Box, node: int, stack: npt.NDArray[np.int64], height: int
) -> int:
    """Put a node's children on the stack, the one nearest to the box's middle on top."""
    low = height
    for slot in range(4):
        child = pyramid.children[node, slot]
        if child == NONE:
            continue
        nearness, at = _nearness(pyramid, box, child), height
        while at > low and _nearness(pyramid, box, stack[at - 1]) > nearness:
            stack[at] = stack[at - 1]
            at -= 1
        stack[at] = child
        height += 1
    return height


@compiled
def _nearness(pyramid: ViewPyramid, box: _Box, node: int) -> np.float32:
    axis, towards = pyramid.axes[node], box.towards
    nearness: np.float32 = axis[0] * towards[0] + axis[1] * towards[1] + axis[2] * towards[2]
    return nearness


@compiled
def _shows(pyramid: ViewPyramid, outlook: Outlook, box: _Box, tile: int, pixel: int) -> bool:
    rays = pyramid.tiles.rays[tile]
    entry = _entry(box, rays[0, pixel], rays[1, pixel], rays[2, pixel], _ZERO)
    return bool(entry <= outlook.reach_m[tile, pixel])


@compiled
def _shown_in(pyramid: ViewPyramid, outlook: Outlook, box: _Box, tile: int) -> int:
    """Return the middle one of a tile's pixels that show the box, NONE if none does."""
    rays, reach = pyramid.tiles.rays[tile], outlook.reach_m[tile]
    x, y, z = rays[0], rays[1], rays[2]
    shown = np.empty(PIXELS, np.int32)
    count = np.int32(0)
    for pixel in range(PIXELS):
        shows = np.int32(_entry(box, x[pixel], y[pixel], z[pixel], _ZERO) <= reach[pixel])
        shown[pixel] = shows
        count += shows
    left = (count + 1) // 2
    for pixel in range(PIXELS if count else 0):
        left -= shown[pixel]
        if left == 0:
            return pixel
    return NONE


@compiled
def _entry(box: _Box, x: np.float32, y: np.float32, z: np.float32, grown: np.float32) -> np.float32:
    """Return where a ray of the optical frame enters the grown box: 0 inside, inf if never."""
    turn, camera, half = box.turn, box.camera_m, box.half_m
    near, far = _ZERO, INFINITE
    for axis in range(3):
        slope = inverse(turn[axis, 0] * x + turn[axis, 1] * y + turn[axis, 2] * z)
        low = (-half[axis] - grown - camera[axis]) * slope
        high = (half[axis] + grown - camera[axis]) * slope
        near = max(near, min(low, high))
        far = min(far, max(low, high))
    entry: np.float32 = near if near <= far else INFINITE
    return entry
