"""The ray-traced z-buffer of equation 2, tile by tile of the image."""

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder._box_depths import find_candidates, measure_boxes
from are_ros.builder._mesh_kernels import Tree
from are_ros.builder._occluders import hide_behind_others
from are_ros.builder._occlusion_types import INFINITE, TIE_M, Boxes, Scratch, Tallies, Voxels
from are_ros.builder._ray_leaps import free_cone, trace
from are_ros.builder._ray_tiles import PIXELS, TILE, Tiles

_ZERO = np.float32(0.0)


@compiled
def render(
    tiles: Tiles,
    map_from_camera: npt.NDArray[np.float32],
    boxes: Boxes,
    voxels: Voxels,
    tree: Tree,
    mutual: bool,
    max_range_m: np.float32,
    tallies: Tallies,
    scratch: Scratch,
) -> None:
    """Count, for each box, the pixels where it is met at all and those where it is seen."""
    for tile in range(tiles.rays.shape[0]):
        axis = _turned(map_from_camera, tiles.axes[tile])
        count = find_candidates(axis, tiles.spreads[tile], boxes, scratch.candidates)
        if count == 0:
            continue
        _turn_rays(map_from_camera, tiles.rays[tile], scratch.rays)
        count = measure_boxes(tiles.valid[tile], boxes, max_range_m, count, tallies, scratch)
        if count > 1 and mutual:
            hide_behind_others(boxes, tree, axis, tiles.spreads[tile], count, scratch)
        if count > 0:
            _trace_environment(voxels, axis, tiles.spreads[tile], count, scratch)
            _tally(tiles.first_pixels[tile], count, tallies, scratch)


@compiled
def _turned(
    matrix: npt.NDArray[np.float32], vector: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    turned = np.empty(3, dtype=np.float32)
    for row in range(3):
        turned[row] = (
            matrix[row, 0] * vector[0] + matrix[row, 1] * vector[1] + matrix[row, 2] * vector[2]
        )
    return turned


@compiled
def _turn_rays(
    matrix: npt.NDArray[np.float32],
    rays: npt.NDArray[np.float32],
    turned: npt.NDArray[np.float32],
) -> None:
    x, y, z = rays[0], rays[1], rays[2]
    for row in range(3):
        a, b, c, out = matrix[row, 0], matrix[row, 1], matrix[row, 2], turned[row]
        for pixel in range(PIXELS):
            out[pixel] = a * x[pixel] + b * y[pixel] + c * z[pixel]


@compiled
def _trace_environment(
    voxels: Voxels, axis: npt.NDArray[np.float32], spread: np.float32, count: int, scratch: Scratch
) -> None:
    """Fill the environment's depth, inf where nothing is in front of any box still to be seen."""
    limits, traced, environment = scratch.limits_m, scratch.traced, scratch.environment_m
    farthest = _limits(scratch.depths, count, limits)
    environment[:] = INFINITE
    lattice_axis = _turned(voxels.lattice_from_map, axis)
    spreads = voxels.voxels_per_m * spread
    start = free_cone(voxels.field, voxels.origin, voxels.ignored, lattice_axis, spreads, farthest)
    waiting = 0
    for pixel in range(PIXELS):
        traced[waiting] = pixel
        waiting += limits[pixel] > start
    _lattice_rays(voxels.lattice_from_map, waiting, scratch)
    hits = scratch.hits_m[:waiting]
    trace(
        voxels.field,
        voxels.origin,
        voxels.ignored,
        scratch.lattice_rays,
        start,
        scratch.limits_m,
        hits,
    )
    for ray in range(waiting):
        environment[traced[ray]] = hits[ray]


@compiled
def _limits(
    depths: npt.NDArray[np.float32], count: int, limits_m: npt.NDArray[np.float32]
) -> np.float32:
    """Write how far the environment matters per pixel: just before the farthest box."""
    limits_m[:] = _ZERO
    for candidate in range(count):
        row = depths[candidate]
        for pixel in range(PIXELS):
            limit = row[pixel] - TIE_M
            farther = (limit > limits_m[pixel]) & (limit < INFINITE)
            limits_m[pixel] = limit if farther else limits_m[pixel]
    farthest: np.float32 = limits_m.max()
    return farthest


@compiled
def _lattice_rays(matrix: npt.NDArray[np.float32], waiting: int, scratch: Scratch) -> None:
    """Gather the rays to trace, turned and scaled into the lattice, and their limits."""
    rays, turned, traced, limits = (
        scratch.rays,
        scratch.lattice_rays,
        scratch.traced,
        scratch.limits_m,
    )
    for ray in range(waiting):
        pixel = traced[ray]
        x, y, z = rays[0, pixel], rays[1, pixel], rays[2, pixel]
        limits[ray] = limits[pixel]
        for row in range(3):
            turned[row, ray] = matrix[row, 0] * x + matrix[row, 1] * y + matrix[row, 2] * z


@compiled
def _tally(
    first_pixel: npt.NDArray[np.int64], count: int, tallies: Tallies, scratch: Scratch
) -> None:
    """Count the pixels where Z_a <= Z_S, and keep their rectangle and least distance."""
    for candidate in range(count):
        box, depths = scratch.candidates[candidate], scratch.depths[candidate]
        bounds = tallies.bounds[box]
        for pixel in range(PIXELS):
            depth = depths[pixel]
            if depth < INFINITE and depth <= scratch.environment_m[pixel] + TIE_M:
                x, y = first_pixel[0] + pixel % TILE, first_pixel[1] + pixel // TILE
                bounds[0], bounds[1] = min(bounds[0], x), min(bounds[1], y)
                bounds[2], bounds[3] = max(bounds[2], x), max(bounds[3], y)
                tallies.visible[box] += 1
                tallies.nearest_m[box] = min(tallies.nearest_m[box], depth)
