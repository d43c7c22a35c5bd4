"""The ray-traced z-buffer of equation 2, tile by tile of the image."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, inlined, owning
from are_ros.builder.occlusion.meshes import Tree, cast_tile
from are_ros.builder.occlusion.rays import PIXELS, TILE, Tiles, free_cone, inverse, trace

TIE_M: Final = np.float32(1e-3)
"""Tolerance [m]: a surface nearer by at most this does not hide; else floors would hide boxes."""

INFINITE: Final = np.float32(np.inf)

RUN: Final = 8
"""Rays side by side, of which the middle one is traced first: what blocks it may block all."""
_INSIDE: Final = np.float32(0.3)
"""How far [voxels] behind the hit of that ray the others are looked at."""
_EDGE: Final = np.float32(0.01)
"""How near [voxels] a voxel's side a ray is not taken to be in it; rounding is far less."""


class Boxes(NamedTuple):
    """N boxes as the camera sees them.

    `cameras_m` float32 (3, N) is the camera's centre in the frame of each box; `turns` float32
    (2, N) cosine and sine of the box's yaw in the map; `halves_m` float32 (3, N); `far_m` float32
    (N,) no corner is farther from the camera; `meshes` int64 (N,) as in `MeshSelection`.
    """

    cameras_m: npt.NDArray[np.float32]
    turns: npt.NDArray[np.float32]
    halves_m: npt.NDArray[np.float32]
    far_m: npt.NDArray[np.float32]
    meshes: npt.NDArray[np.int64]


class Voxels(NamedTuple):
    """The environment as the camera sees it; see `VoxelField.lattice_rays`.

    `voxels_per_m` float32 (3,) are the reciprocals of the voxel's sizes.
    """

    field: npt.NDArray[np.uint8]
    origin: npt.NDArray[np.float32]
    ignored: int
    lattice_from_map: npt.NDArray[np.float32]
    voxels_per_m: npt.NDArray[np.float32]


class Visibility(NamedTuple):
    """What a camera sees of N artefacts; all arrays are read-only in the end.

    `visible_pixels` int64 (N,): pixels where the artefact is seen; it is in A_f where they exceed
    tau. `unoccluded_pixels` int64 (N,): pixels where its box is met within the range, whatever
    stands before it. `rois` int64 (N, 4): x, y, width, height of the rectangle around the visible
    pixels, zeros if there is none; in the kernels its least and greatest x and y. `nearest_m`
    float32 (N,): least distance [m] among the visible pixels, inf if there is none.
    """

    visible_pixels: npt.NDArray[np.int64]
    unoccluded_pixels: npt.NDArray[np.int64]
    rois: npt.NDArray[np.int64]
    nearest_m: npt.NDArray[np.float32]


class Scratch(NamedTuple):
    """Room for one tile, with a row for each of N boxes and one more.

    `axes` float32 (3, 3) are the tile's axis in the map frame, its axis in the lattice, and its
    spread there. `rays` float32 (3, PIXELS) are in the map frame; `depths` float32 (N + 1, PIXELS)
    is Z_a of the boxes in `candidates`, inf where a ray misses and where the environment or
    another artefact hides the box.
    """

    axes: npt.NDArray[np.float32]
    rays: npt.NDArray[np.float32]
    depths: npt.NDArray[np.float32]
    candidates: npt.NDArray[np.int64]
    nearest_bits: npt.NDArray[np.int32]
    order: npt.NDArray[np.int64]
    last_m: npt.NDArray[np.float32]
    front_m: npt.NDArray[np.float32]
    mesh_rays: npt.NDArray[np.float32]
    limits_m: npt.NDArray[np.float32]
    environment_m: npt.NDArray[np.float32]
    lattice_rays: npt.NDArray[np.float32]
    inverses_z: npt.NDArray[np.float32]
    nearest_m: npt.NDArray[np.float32]
    guesses: npt.NDArray[np.int32]
    to_trace: npt.NDArray[np.int64]
    farthest_m: npt.NDArray[np.float32]


_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_BEFORE: Final = np.int32(-1)
_BEYOND: Final = np.int32(TILE)
"""What replaces the column and row of a pixel that does not see the box, before or beyond all."""
_INFINITE_BITS: Final = np.int32(0x7F800000)
"""Depths are not negative: then their bits, as integers, have their order. Only integers does the
compiler compare side by side, as the least of floats depends on where NaN is."""


@inlined
def find_candidates(
    axis: npt.NDArray[np.float32],
    spread: np.float32,
    boxes: Boxes,
    candidates: npt.NDArray[np.int64],
) -> int:
    """Write the boxes that a ray of the bundle may meet; return how many.

    Where a ray meets a box, at t <= far, the axis at t is within `spread` far of it: so the axis
    meets the box grown by that much.
    """
    x, y, z = boxes.cameras_m[0], boxes.cameras_m[1], boxes.cameras_m[2]
    half_x, half_y, half_z = boxes.halves_m[0], boxes.halves_m[1], boxes.halves_m[2]
    cosines, sines, far_m = boxes.turns[0], boxes.turns[1], boxes.far_m
    axis_x, axis_y, inverse_z = axis[0], axis[1], inverse(axis[2])
    for box in range(far_m.shape[0]):
        grown, cosine, sine = spread * far_m[box], cosines[box], sines[box]
        near = _enter(
            x[box],
            y[box],
            z[box],
            inverse(cosine * axis_x + sine * axis_y),
            inverse(cosine * axis_y - sine * axis_x),
            inverse_z,
            half_x[box] + grown,
            half_y[box] + grown,
            half_z[box] + grown,
        )
        candidates[box] = near < INFINITE
    count = 0
    for box in range(far_m.shape[0]):  # a loop of its own, so that the tests are vectorised
        is_met, candidates[count] = candidates[box], box
        count += is_met
    return count


@borrowing
def _enter(
    ox: np.float32,
    oy: np.float32,
    oz: np.float32,
    ix: np.float32,
    iy: np.float32,
    iz: np.float32,
    half_x: np.float32,
    half_y: np.float32,
    half_z: np.float32,
) -> np.float32:
    """Return where a ray enters a closed box about the origin [m]: 0 from inside, inf if never.

    The ray's direction is given by the inverses of its components.
    """
    ax, bx = (-half_x - ox) * ix, (half_x - ox) * ix
    ay, by = (-half_y - oy) * iy, (half_y - oy) * iy
    az, bz = (-half_z - oz) * iz, (half_z - oz) * iz
    near = max(min(ax, bx), min(ay, by), min(az, bz), _ZERO)
    far = min(max(ax, bx), max(ay, by), max(az, bz))
    entered: np.float32 = near if near <= far else INFINITE
    return entered


@borrowing
def measure_boxes(
    valid: npt.NDArray[np.uint8],
    boxes: Boxes,
    tree: Tree,
    axis: npt.NDArray[np.float32],
    spread: np.float32,
    by_mesh: bool,
    max_range_m: np.float32,
    count: int,
    tallies: Visibility,
    scratch: Scratch,
) -> int:
    """Fill Z_a of each candidate; drop those that no ray meets, and return how many are left.

    Z_a is the first hit per pixel on the box, or `by_mesh` on the mesh in it; inf beyond the range.
    """
    rays_x, rays_y, inverses_z = scratch.rays[0], scratch.rays[1], scratch.inverses_z
    for pixel in range(PIXELS):
        inverses_z[pixel] = inverse(scratch.rays[2, pixel])
    kept = 0
    for candidate in range(count):
        box = scratch.candidates[candidate]
        cosine, sine = boxes.turns[0, box], boxes.turns[1, box]
        cameras_m, halves_m = boxes.cameras_m, boxes.halves_m
        ox, oy, oz = cameras_m[0, box], cameras_m[1, box], cameras_m[2, box]
        half_x, half_y, half_z = halves_m[0, box], halves_m[1, box], halves_m[2, box]
        depths, met = scratch.depths[kept], np.int32(0)
        axis_x, axis_y = cosine * axis[0] + sine * axis[1], cosine * axis[1] - sine * axis[0]
        if min(abs(axis_x), abs(axis_y), abs(axis[2])) > spread:
            # no ray turns back along any axis: all meet the same side of each slab first
            near_x = (-half_x if axis_x > _ZERO else half_x) - ox
            near_y = (-half_y if axis_y > _ZERO else half_y) - oy
            near_z = (-half_z if axis[2] > _ZERO else half_z) - oz
            far_x = (half_x if axis_x > _ZERO else -half_x) - ox
            far_y = (half_y if axis_y > _ZERO else -half_y) - oy
            far_z = (half_z if axis[2] > _ZERO else -half_z) - oz
            for pixel in range(PIXELS):
                x, y = rays_x[pixel], rays_y[pixel]
                dx, dy = cosine * x + sine * y, cosine * y - sine * x
                ix, iy, iz = _ONE / dx, _ONE / dy, inverses_z[pixel]
                near = max(near_x * ix, near_y * iy, near_z * iz, _ZERO)
                far = min(far_x * ix, far_y * iy, far_z * iz)
                hit = (near <= far) & (near <= max_range_m) & (valid[pixel] != 0)
                depths[pixel] = near if hit else INFINITE
                met = np.int32(met + hit)
        else:
            for pixel in range(PIXELS):
                x, y = rays_x[pixel], rays_y[pixel]
                dx, dy = cosine * x + sine * y, cosine * y - sine * x
                ix, iy, iz = inverse(dx), inverse(dy), inverses_z[pixel]
                near = _enter(ox, oy, oz, ix, iy, iz, half_x, half_y, half_z)
                hit = (near <= max_range_m) & (valid[pixel] != 0)
                depths[pixel] = near if hit else INFINITE
                met = np.int32(met + hit)
        if by_mesh and met > 0 and boxes.meshes[box] >= 0:
            met = _replace_by_mesh(boxes, tree, box, axis, spread, max_range_m, depths, scratch)
        tallies.unoccluded_pixels[box] += met
        scratch.candidates[kept] = box
        kept += met > 0
    return kept


@borrowing
def _replace_by_mesh(
    boxes: Boxes,
    tree: Tree,
    box: int,
    axis: npt.NDArray[np.float32],
    spread: np.float32,
    max_range_m: np.float32,
    depths: npt.NDArray[np.float32],
    scratch: Scratch,
) -> np.int32:
    """Put the hits on a mesh in place of those on its box; return their number."""
    front, met = scratch.front_m, np.int32(0)
    for pixel in range(PIXELS):
        front[pixel] = max_range_m if depths[pixel] < INFINITE else -INFINITE
    _lower_to_mesh(boxes, tree, box, axis, spread, scratch)
    for pixel in range(PIXELS):
        hit = (front[pixel] < max_range_m) & (front[pixel] >= _ZERO)
        depths[pixel] = front[pixel] if hit else INFINITE
        met = np.int32(met + hit)
    found: np.int32 = met
    return found


@borrowing
def hide_behind_others(
    boxes: Boxes,
    tree: Tree,
    axis: npt.NDArray[np.float32],
    spread: np.float32,
    count: int,
    scratch: Scratch,
) -> int:
    """Set Z_a to inf where another artefact's shape is in front of a; see `_keep_in_front_of`.

    Since a shape lies inside its box, or is Z_a itself, none is hidden by its own shape, and one
    shared nearest surface (the front) serves all.
    """
    depths, front, meshes = scratch.depths, scratch.front_m, 0
    front[:] = INFINITE
    for candidate in range(count):
        if boxes.meshes[scratch.candidates[candidate]] >= 0:
            meshes += 1
            continue
        depth = depths[candidate]
        for pixel in range(PIXELS):
            front[pixel] = min(front[pixel], depth[pixel])
    if meshes > 0:
        _lower_to_meshes(boxes, tree, axis, spread, count, scratch)
    return _keep_in_front_of(front, count, scratch)


@borrowing
def _keep_in_front_of(surface_m: npt.NDArray[np.float32], count: int, scratch: Scratch) -> int:
    """Set Z_a to inf behind a surface (PIXELS,); drop the candidates of which nothing is left.

    Return how many remain.
    """
    depths, kept = scratch.depths, 0
    for candidate in range(count):
        depth, seen = depths[candidate], np.int32(0)
        for pixel in range(PIXELS):
            is_seen = (depth[pixel] <= surface_m[pixel] + TIE_M) & (depth[pixel] < INFINITE)
            depth[pixel] = depth[pixel] if is_seen else INFINITE
            seen = np.int32(seen + is_seen)
        if seen > 0:
            scratch.candidates[kept] = scratch.candidates[candidate]
            for pixel in range(PIXELS if kept < candidate else 0):
                depths[kept, pixel] = depth[pixel]
            kept += 1
    return kept


@borrowing
def _lower_to_meshes(
    boxes: Boxes,
    tree: Tree,
    axis: npt.NDArray[np.float32],
    spread: np.float32,
    count: int,
    scratch: Scratch,
) -> None:
    """Lower the front to the meshes, the nearest box first.

    A mesh is skipped if its box is behind the front, or if no other Z_a is behind its box.
    """
    depths, front, last = scratch.depths, scratch.front_m, scratch.last_m
    nearest, order, meshes = scratch.nearest_bits, scratch.order, 0
    last[:] = -INFINITE
    for candidate in range(count):
        depth, least = depths[candidate], _INFINITE_BITS
        bits = depth.view(np.int32)
        for pixel in range(PIXELS):
            higher = (depth[pixel] > last[pixel]) & (depth[pixel] < INFINITE)
            last[pixel] = depth[pixel] if higher else last[pixel]
            least = min(least, bits[pixel])
        if boxes.meshes[scratch.candidates[candidate]] < 0:
            continue
        place = meshes
        while place > 0 and nearest[place - 1] > least:  # sort by the least depth in the tile
            nearest[place], order[place] = nearest[place - 1], order[place - 1]
            place -= 1
        nearest[place], order[place] = least, candidate
        meshes += 1
    for place in order[:meshes]:
        if _matters(depths[place], last, front):
            _lower_to_mesh(boxes, tree, scratch.candidates[place], axis, spread, scratch)


@inlined
def _matters(
    depths: npt.NDArray[np.float32],
    last: npt.NDArray[np.float32],
    front: npt.NDArray[np.float32],
) -> bool:
    matters = np.int32(0)
    for pixel in range(PIXELS):
        depth = depths[pixel]
        matters = np.int32(matters + ((depth + TIE_M < last[pixel]) & (depth < front[pixel])))
    return bool(matters > 0)


@owning
def _lower_to_mesh(
    boxes: Boxes,
    tree: Tree,
    box: int,
    axis: npt.NDArray[np.float32],
    spread: np.float32,
    scratch: Scratch,
) -> None:
    """Lower the front to the mesh that stands in a box."""
    cosine, sine = boxes.turns[0, box], boxes.turns[1, box]
    rays, turned = scratch.rays, scratch.mesh_rays
    for pixel in range(PIXELS):
        turned[0, pixel] = cosine * rays[0, pixel] + sine * rays[1, pixel]
        turned[1, pixel] = cosine * rays[1, pixel] - sine * rays[0, pixel]
        turned[2, pixel] = rays[2, pixel]
    camera_m, mesh_axis = np.empty(3, dtype=np.float32), np.empty(3, dtype=np.float32)
    for row in range(3):
        camera_m[row] = boxes.cameras_m[row, box]
    mesh_axis[0] = cosine * axis[0] + sine * axis[1]
    mesh_axis[1] = cosine * axis[1] - sine * axis[0]
    mesh_axis[2] = axis[2]
    grown = spread * boxes.far_m[box]
    cast_tile(tree, boxes.meshes[box], camera_m, mesh_axis, grown, turned, scratch.front_m)


@borrowing
def render(
    tiles: Tiles,
    map_from_camera: npt.NDArray[np.float32],
    boxes: Boxes,
    voxels: Voxels,
    tree: Tree,
    mutual: bool,
    by_mesh: bool,
    max_range_m: np.float32,
    tallies: Visibility,
    scratch: Scratch,
) -> None:
    """Count, for each box, the pixels where it is met at all and those where it is seen.

    Sums and indices of these loops are kept int32: numba makes int64 of the sum of two int32, and
    then half as many pixels fit into a vector.
    """
    axis = scratch.axes[0]
    for tile in range(tiles.rays.shape[0]):
        spread = tiles.spreads[tile]
        _turn(map_from_camera, tiles.axes[tile], axis)
        count = find_candidates(axis, spread, boxes, scratch.candidates)
        if count == 0:
            continue
        _turn_all(map_from_camera, tiles.rays[tile], scratch.rays)
        count = measure_boxes(
            tiles.valid[tile],
            boxes,
            tree,
            axis,
            spread,
            by_mesh,
            max_range_m,
            count,
            tallies,
            scratch,
        )
        if count > 0:  # before the others: their meshes are slow, and need not hide what is hidden
            _trace_environment(voxels, axis, spread, count, scratch)
            count = _keep_in_front_of(scratch.environment_m, count, scratch)
        if count > 1 and mutual:
            count = hide_behind_others(boxes, tree, axis, spread, count, scratch)
        if count > 0:
            _tally(tiles.first_pixels[tile], count, tallies, scratch)


@inlined
def _turn(
    matrix: npt.NDArray[np.float32],
    vector: npt.NDArray[np.float32],
    turned: npt.NDArray[np.float32],
) -> None:
    """Write a vector (3,), turned by a matrix."""
    for row in range(3):
        turned[row] = (
            matrix[row, 0] * vector[0] + matrix[row, 1] * vector[1] + matrix[row, 2] * vector[2]
        )


@inlined
def _turn_all(
    matrix: npt.NDArray[np.float32],
    rays: npt.NDArray[np.float32],
    turned: npt.NDArray[np.float32],
) -> None:
    """Write the rays of a tile (3, PIXELS), turned by a matrix."""
    x, y, z = rays[0], rays[1], rays[2]
    for row in range(3):
        out, a, b, c = turned[row], matrix[row, 0], matrix[row, 1], matrix[row, 2]
        for pixel in range(PIXELS):
            out[pixel] = a * x[pixel] + b * y[pixel] + c * z[pixel]


@borrowing
def _trace_environment(
    voxels: Voxels, axis: npt.NDArray[np.float32], spread: np.float32, count: int, scratch: Scratch
) -> None:
    """Fill the environment's depth, as far as it tells what it hides of the candidates.

    It is inf where no box is so far away, or nothing hides one; where a ray is known to be blocked
    before all boxes, it may be that of another surface behind the first.
    """
    environment, limits, rays = scratch.environment_m, scratch.limits_m, scratch.lattice_rays
    lattice_axis, spreads = scratch.axes[1], scratch.axes[2]
    _turn(voxels.lattice_from_map, axis, lattice_axis)
    for row in range(3):
        spreads[row] = voxels.voxels_per_m[row] * spread
    farthest = _farthest(count, scratch) - TIE_M  # what is behind all boxes hides none
    field, origin, ignored = voxels.field, voxels.origin, voxels.ignored
    start = free_cone(field, origin, ignored, lattice_axis, spreads, farthest)
    environment[:] = INFINITE
    if farthest <= start:
        return
    _turn_all(voxels.lattice_from_map, scratch.rays, rays)
    limits[:] = farthest
    for probe in range(PIXELS // RUN):
        scratch.to_trace[probe] = RUN * probe + RUN // 2
    probes = scratch.to_trace[: PIXELS // RUN]
    trace(field, origin, ignored, rays, probes, start, limits, environment)
    _set_limits(count, scratch)
    _guess_from_probes(voxels, scratch)
    rest = scratch.to_trace[: _without_the_blocked(voxels, scratch)]
    trace(field, origin, ignored, rays, rest, start, limits, environment)


@inlined
def _set_limits(count: int, scratch: Scratch) -> None:
    """Write just before which depths the environment hides a box, and hides all, at each pixel.

    Where there is no box, that is 0 and inf.
    """
    limits, nearest = scratch.limits_m, scratch.nearest_m
    limits[:] = _ZERO
    nearest[:] = INFINITE
    for candidate in range(count):
        depth = scratch.depths[candidate]
        for pixel in range(PIXELS):
            limit = depth[pixel] - TIE_M
            farther = (limit > limits[pixel]) & (limit < INFINITE)
            limits[pixel] = limit if farther else limits[pixel]
            nearest[pixel] = min(nearest[pixel], limit)


@inlined
def _guess_from_probes(voxels: Voxels, scratch: Scratch) -> None:
    """Write for each ray in which voxel it may be blocked: a little behind what its probe has met.

    -1 if that is not before all boxes there, or so near the voxel's side that rounding could put it
    into the next voxel. The environment's depth becomes that of the guess.
    """
    rays, depths, guesses = scratch.lattice_rays, scratch.environment_m, scratch.guesses
    x, y, z = rays[0], rays[1], rays[2]
    ox, oy, oz = voxels.origin[0], voxels.origin[1], voxels.origin[2]
    rows, columns = np.int32(voxels.field.shape[1]), np.int32(voxels.field.shape[2])
    layers, per_m = np.int32(voxels.field.shape[0]), voxels.voxels_per_m
    inside_m = _INSIDE / max(per_m[0], per_m[1], per_m[2])
    for first in range(0, PIXELS, RUN):
        guess_m = depths[first + RUN // 2] + inside_m
        for pixel in range(first, first + RUN):
            depths[pixel] = guess_m
    for pixel in range(PIXELS):
        is_before = depths[pixel] < scratch.nearest_m[pixel] - TIE_M
        t = depths[pixel] if is_before else _ZERO
        at_x, at_y, at_z = ox + t * x[pixel], oy + t * y[pixel], oz + t * z[pixel]
        i, j, k = np.int32(at_x), np.int32(at_y), np.int32(at_z)
        u, v, w = at_x - np.float32(i), at_y - np.float32(j), at_z - np.float32(k)
        is_within = (min(u, v, w) > _EDGE) & (max(u, v, w) < _ONE - _EDGE)
        is_within &= (i < rows) & (j < columns) & (k < layers)
        index = np.int32((k * rows + i) * columns + j)
        guesses[pixel] = index if is_before & is_within else np.int32(-1)


@inlined
def _without_the_blocked(voxels: Voxels, scratch: Scratch) -> int:
    """List the rays that are still to be traced; return how many.

    What blocks the others hides all boxes there, so its depth may stay a guess.
    """
    flat, own = voxels.field.reshape(-1), np.int32(voxels.ignored)
    guesses, limits, to_trace, count = scratch.guesses, scratch.limits_m, scratch.to_trace, 0
    for pixel in range(PIXELS):
        guess = guesses[pixel]
        is_free = (guess < 0) | (guess == own) | (flat[max(guess, np.int32(0))] != 0)
        to_trace[count] = pixel
        count += is_free & (limits[pixel] > _ZERO)
    return count


@inlined
def _farthest(count: int, scratch: Scratch) -> np.float32:
    """Return the greatest Z_a of the candidates [m]; each has at least one."""
    farthest = np.int32(0)
    for candidate in range(count):
        bits = scratch.depths[candidate].view(np.int32)
        for pixel in range(PIXELS):
            farthest = max(farthest, bits[pixel] if bits[pixel] < _INFINITE_BITS else np.int32(0))
    scratch.farthest_m.view(np.int32)[0] = farthest
    found: np.float32 = scratch.farthest_m[0]
    return found


@inlined
def _tally(
    first_pixel: npt.NDArray[np.int64], count: int, tallies: Visibility, scratch: Scratch
) -> None:
    """Count the pixels where each box is not hidden (Eq. 2); keep rectangle and distance."""
    nearest_bits = tallies.nearest_m.view(np.int32)
    for candidate in range(count):
        box, depths = scratch.candidates[candidate], scratch.depths[candidate]
        seen, nearest, bits = np.int32(0), _INFINITE_BITS, depths.view(np.int32)
        left, top, right, bottom = _BEYOND, _BEYOND, _BEFORE, _BEFORE
        for pixel in range(PIXELS):
            is_seen = depths[pixel] < INFINITE
            seen = np.int32(seen + is_seen)
            nearest = min(nearest, bits[pixel] if is_seen else _INFINITE_BITS)
            x, y = np.int32(pixel % TILE), np.int32(pixel // TILE)
            left, top = min(left, x if is_seen else _BEYOND), min(top, y if is_seen else _BEYOND)
            right = max(right, x if is_seen else _BEFORE)
            bottom = max(bottom, y if is_seen else _BEFORE)
        if seen > 0:
            tallies.visible_pixels[box] += seen
            nearest_bits[box] = min(nearest_bits[box], nearest)
            bounds, x0, y0 = tallies.rois[box], first_pixel[0], first_pixel[1]
            bounds[0], bounds[1] = min(bounds[0], x0 + left), min(bounds[1], y0 + top)
            bounds[2], bounds[3] = max(bounds[2], x0 + right), max(bounds[3], y0 + bottom)
