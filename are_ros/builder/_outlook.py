"""How far each pixel of a camera sees in an environment, traced tile by tile when it matters."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder._occlusion_types import TIE_M, Voxels
from are_ros.builder._ray_leaps import free_cone, trace
from are_ros.builder._ray_tiles import PIXELS
from are_ros.builder._view_pyramid import NONE, ViewPyramid

_NOWHERE: Final = np.float32(-1.0)
_Floats = npt.NDArray[np.float32]


class Outlook(NamedTuple):
    """What one camera can see of one environment, as far as it was looked up.

    `map_from_camera` float32 (3, 3) is the turn, `camera_m` float64 (3,) the place. `reach_m`
    float32 (T, PIXELS): how far a pixel sees before the environment hides all, -1 where it has no
    ray; filled in for the tiles whose `known` uint8 (T,) is 1. `farthest_m` float32 (M,) is the
    most of it below a node, or the range as long as that is not known.
    """

    map_from_camera: _Floats
    camera_m: npt.NDArray[np.float64]
    max_range_m: np.float32
    voxels: Voxels
    known: npt.NDArray[np.uint8]
    reach_m: _Floats
    farthest_m: _Floats


@compiled
def look_into(pyramid: ViewPyramid, outlook: Outlook, tile: int) -> None:
    """Trace a tile's rays to the environment, just as the z-buffer does."""
    rays, valid = pyramid.tiles.rays[tile], pyramid.tiles.valid[tile]
    voxels, reach = outlook.voxels, outlook.reach_m[tile]
    axis = _turned(voxels.lattice_from_map, _turned(outlook.map_from_camera, pyramid.axes[tile]))
    spreads = voxels.voxels_per_m * pyramid.spreads[tile]
    start = free_cone(
        voxels.field, voxels.origin, voxels.ignored, axis, spreads, outlook.max_range_m
    )
    directions = _turned_all(voxels.lattice_from_map, _turned_all(outlook.map_from_camera, rays))
    limits = np.empty(PIXELS, np.float32)
    for pixel in range(PIXELS):
        limits[pixel] = outlook.max_range_m if valid[pixel] else _NOWHERE
    trace(voxels.field, voxels.origin, voxels.ignored, directions, start, limits, reach)
    for pixel in range(PIXELS):
        before_all = min(reach[pixel] + TIE_M, outlook.max_range_m)
        reach[pixel] = before_all if valid[pixel] else _NOWHERE
    outlook.known[tile] = 1
    _lower(pyramid, outlook, tile, reach.max())


@compiled
def _lower(pyramid: ViewPyramid, outlook: Outlook, node: int, farthest_m: np.float32) -> None:
    """Set how far a node sees, and with it those above."""
    outlook.farthest_m[node] = farthest_m
    node = pyramid.parents[node]
    while node != NONE:
        farthest_m = _NOWHERE
        for slot in range(4):
            child = pyramid.children[node, slot]
            if child != NONE:
                farthest_m = max(farthest_m, outlook.farthest_m[child])
        if farthest_m == outlook.farthest_m[node]:
            return
        outlook.farthest_m[node] = farthest_m
        node = pyramid.parents[node]


@compiled
def _turned(matrix: _Floats, vector: _Floats) -> _Floats:
    turned = np.empty(3, np.float32)
    for row in range(3):
        turned[row] = (
            matrix[row, 0] * vector[0] + matrix[row, 1] * vector[1] + matrix[row, 2] * vector[2]
        )
    return turned


@compiled
def _turned_all(matrix: _Floats, vectors: _Floats) -> _Floats:
    turned = np.empty((3, PIXELS), np.float32)
    for row in range(3):
        a, b, c = matrix[row, 0], matrix[row, 1], matrix[row, 2]
        for pixel in range(PIXELS):
            turned[row, pixel] = (
                a * vectors[0, pixel] + b * vectors[1, pixel] + c * vectors[2, pixel]
            )
    return turned
