"""Which cells of a lattice a box's footprint covers: its outline in cells, row by row.

A lattice is a float64 row (x, y, cos, sin, cell width, cell height): its corner and turn in the
map frame, and the cell sizes along its columns and rows in metres. Outlines are in cells.
"""

import numpy as np
from numpy.typing import NDArray

from are_ros._compiled import compiled
from are_ros.world._planar import cosine_and_sine
from are_ros.world.rigid_transform import RigidTransform

_FloatArray = NDArray[np.float64]


def lattice_row(map_from_lattice: RigidTransform, width_m: float, depth_m: float) -> _FloatArray:
    """Return a lattice, turned about z only, of cells `width_m` along x and `depth_m` along y."""
    x, y, _ = map_from_lattice.translation_m
    return np.array([x, y, *cosine_and_sine(map_from_lattice.rotation_xyzw), width_m, depth_m])


@compiled
def outline(
    packed: _FloatArray, i: int, lattice: _FloatArray, tolerance_m: float
) -> tuple[float, float, float, float, float, float]:
    """Return centre, topmost corner and rightmost corner of footprint i, in cells.

    The corners are relative to the centre; the other two are opposite. The footprint is shrunk by
    the tolerance on each side, so that one which ends on a cell's edge, but for rounding, ends
    before it.
    """
    dx = packed[i, 0] - lattice[0]
    dy = packed[i, 1] - lattice[1]
    x = (dx * lattice[2] + dy * lattice[3]) / lattice[4]
    y = (dy * lattice[2] - dx * lattice[3]) / lattice[5]
    c = packed[i, 3] * lattice[2] + packed[i, 4] * lattice[3]
    s = packed[i, 4] * lattice[2] - packed[i, 3] * lattice[3]
    ahead = max(packed[i, 5] - tolerance_m, 0.0)
    aside = max(packed[i, 6] - tolerance_m, 0.0)
    if (
        c * s < 0.0
    ):  # turn by a quarter into the first quadrant, where the order of corners is known
        c, s, ahead, aside = s, c, aside, ahead
    c, s = abs(c), abs(s)
    top_x, top_y = c * ahead - s * aside, s * ahead + c * aside
    right_x, right_y = c * ahead + s * aside, s * ahead - c * aside
    return (
        x,
        y,
        top_x / lattice[4],
        top_y / lattice[5],
        right_x / lattice[4],
        right_y / lattice[5],
    )


@compiled
def row_range(y: float, top_y: float) -> tuple[int, int]:
    """Return the first and last row whose open band meets the outline."""
    return np.int64(np.floor(y - top_y)), np.int64(np.ceil(y + top_y)) - 1


@compiled
def _left_end(
    low: float, high: float, top_x: float, top_y: float, right_x: float, right_y: float
) -> float:
    """Return the least x of the outline between two heights, all relative to its centre."""
    if high < -right_y:
        share = min(max((high + top_y) / (top_y - right_y), 0.0), 1.0)
        return share * (top_x - right_x) - top_x
    if low > -right_y:
        share = min(max((low + right_y) / (top_y + right_y), 0.0), 1.0)
        return share * (top_x + right_x) - right_x
    return -right_x


@compiled
def column_range(
    row: int, x: float, y: float, top_x: float, top_y: float, right_x: float, right_y: float
) -> tuple[int, int]:
    """Return the first and last column of a row whose open square meets the outline."""
    low, high = row - y, row + 1 - y
    left = _left_end(low, high, top_x, top_y, right_x, right_y)
    right = -_left_end(-high, -low, top_x, top_y, right_x, right_y)
    return np.int64(np.floor(x + left)), np.int64(np.ceil(x + right)) - 1


@compiled
def covered(
    packed: _FloatArray, i: int, lattice: _FloatArray, shape: tuple[int, int], tolerance_m: float
) -> tuple[int, int, NDArray[np.bool_]]:
    """Return first row, first column and mask of the cells that footprint i covers in a grid."""
    x, y, top_x, top_y, right_x, right_y = outline(packed, i, lattice, tolerance_m)
    first_row, last_row = row_range(y, top_y)
    first_row, last_row = max(first_row, 0), min(last_row, shape[0] - 1)
    first_column = max(np.int64(np.floor(x - right_x)), 0)
    last_column = min(np.int64(np.ceil(x + right_x)) - 1, shape[1] - 1)
    if last_row < first_row or last_column < first_column:
        return 0, 0, np.zeros((0, 0), np.bool_)
    mask = np.zeros((last_row - first_row + 1, last_column - first_column + 1), np.bool_)
    for row in range(first_row, last_row + 1):
        start, end = column_range(row, x, y, top_x, top_y, right_x, right_y)
        start, end = max(start, first_column), min(end, last_column)
        if start <= end:  # a negative end would count from the back
            mask[row - first_row, start - first_column : end + 1 - first_column] = True
    return first_row, first_column, mask


@compiled
def count_new(mask: NDArray[np.bool_], row0: int, col0: int, is_counted: NDArray[np.bool_]) -> int:
    """Count the cells of a mask, laid at (row0, col0), that are not counted yet, and mark them."""
    count = 0
    for row in range(mask.shape[0]):
        new = mask[row]
        old = is_counted[row0 + row, col0 : col0 + mask.shape[1]]
        for column in range(new.shape[0]):  # without branches, so that it vectorises
            count += new[column] > old[column]
            old[column] |= new[column]
    return count
