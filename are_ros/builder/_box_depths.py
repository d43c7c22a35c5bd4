"""Z_a of equation 2: where the rays of a tile first meet the boxes."""

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder._occlusion_types import INFINITE, Boxes, Scratch, Tallies
from are_ros.builder._ray_leaps import inverse
from are_ros.builder._ray_tiles import PIXELS

_ZERO = np.float32(0.0)


@compiled
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
    count = 0
    for box in range(boxes.far_m.size):
        grown = spread * boxes.far_m[box]
        cosine, sine = boxes.turns[box, 0], boxes.turns[box, 1]
        near = _enter(
            boxes.cameras_m[box, 0],
            boxes.cameras_m[box, 1],
            boxes.cameras_m[box, 2],
            cosine * axis[0] + sine * axis[1],
            cosine * axis[1] - sine * axis[0],
            axis[2],
            boxes.halves_m[box, 0] + grown,
            boxes.halves_m[box, 1] + grown,
            boxes.halves_m[box, 2] + grown,
        )
        candidates[count] = box
        count += near < INFINITE
    return count


@compiled
def _enter(
    ox: np.float32,
    oy: np.float32,
    oz: np.float32,
    dx: np.float32,
    dy: np.float32,
    dz: np.float32,
    half_x: np.float32,
    half_y: np.float32,
    half_z: np.float32,
) -> np.float32:
    """Return where a ray enters a closed box about the origin [m]: 0 from inside, inf if never."""
    ix, iy, iz = inverse(dx), inverse(dy), inverse(dz)
    ax, bx = (-half_x - ox) * ix, (half_x - ox) * ix
    ay, by = (-half_y - oy) * iy, (half_y - oy) * iy
    az, bz = (-half_z - oz) * iz, (half_z - oz) * iz
    near = max(min(ax, bx), min(ay, by), min(az, bz), _ZERO)
    far = min(max(ax, bx), max(ay, by), max(az, bz))
    entered: np.float32 = near if near <= far else INFINITE
    return entered


@compiled
def measure_boxes(
    valid: npt.NDArray[np.uint8],
    boxes: Boxes,
    max_range_m: np.float32,
    count: int,
    tallies: Tallies,
    scratch: Scratch,
) -> int:
    """Fill Z_a of each candidate; drop those that no ray meets, and return how many are left."""
    kept = 0
    for candidate in range(count):
        box = scratch.candidates[candidate]
        met = _box_depths(
            scratch.rays[0],
            scratch.rays[1],
            scratch.rays[2],
            valid,
            boxes.cameras_m[box],
            boxes.turns[box],
            boxes.halves_m[box],
            max_range_m,
            scratch.depths[kept],
        )
        tallies.unoccluded[box] += met
        scratch.candidates[kept] = box
        kept += met > 0
    return kept


@compiled
def _box_depths(
    rays_x: npt.NDArray[np.float32],
    rays_y: npt.NDArray[np.float32],
    rays_z: npt.NDArray[np.float32],
    valid: npt.NDArray[np.uint8],
    camera_m: npt.NDArray[np.float32],
    turn: npt.NDArray[np.float32],
    half_m: npt.NDArray[np.float32],
    max_range_m: np.float32,
    depths: npt.NDArray[np.float32],
) -> int:
    """Write the first hit on a box per pixel, inf beyond the range; return the number of hits."""
    cosine, sine = turn[0], turn[1]
    ox, oy, oz = camera_m[0], camera_m[1], camera_m[2]
    half_x, half_y, half_z = half_m[0], half_m[1], half_m[2]
    met = np.int32(0)
    for pixel in range(PIXELS):
        x, y = rays_x[pixel], rays_y[pixel]
        dx, dy = cosine * x + sine * y, cosine * y - sine * x
        near = _enter(ox, oy, oz, dx, dy, rays_z[pixel], half_x, half_y, half_z)
        hit = (near <= max_range_m) & (valid[pixel] != 0)
        depths[pixel] = near if hit else INFINITE
        met += np.int32(hit)
    return int(met)
