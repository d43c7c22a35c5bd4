"""Which cells of a lattice a box's footprint covers, and boxes against cells and voxels.

A lattice is a float64 row (x, y, cos, sin, cell width, cell height): its corner and turn in the
map frame, and the cell sizes along its columns and rows in metres. Outlines are in cells.

A clearance field holds at each cell the distance to the nearest cell with a zero, centre to centre,
so a row can be scanned in leaps of that many cells. `unit` is the field's value for one cell.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from are_ros._compiled import compiled
from are_ros.world.rigid_transform import RigidTransform, cosine_and_sine

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
    first_row, last_row = np.int64(np.floor(y - top_y)), np.int64(np.ceil(y + top_y)) - 1
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


_Field = NDArray[np.float32]
_Mask = NDArray[np.bool_]

HALF_DIAGONAL = 0.71  # of a cell, rounded up
TWO_HALF_DIAGONALS = 1.42  # of the cell of a centre and of the one met


@compiled
def _next_zero(field: _Field, unit: float, row: int, column: int, last: int) -> int:
    """Return the first column, from `column` to `last`, where the field is 0, else last + 1."""
    while column <= last:
        distance = field[row, column]
        if distance == 0.0:
            return column
        column += max(1, np.int64(distance / unit))
    return last + 1


@compiled
def _is_far(
    field: _Field,
    unit: float,
    x: float,
    y: float,
    top: tuple[float, float],
    right: tuple[float, float],
) -> bool:
    """Tell whether the field at the outline's centre already rules out that it meets a zero."""
    if not (0.0 <= x < field.shape[1] and 0.0 <= y < field.shape[0]):
        return False
    # not hypot, which takes longer than all the rest here
    square = max(top[0] * top[0] + top[1] * top[1], right[0] * right[0] + right[1] * right[1])
    reach = np.sqrt(square)
    return bool(field[np.int64(y), np.int64(x)] > (reach + TWO_HALF_DIAGONALS) * unit)


@compiled
def hits_cells(
    packed: _FloatArray,
    lattice: _FloatArray,
    occupied: _Mask,
    field: _Field,
    unit: float,
    tolerance_m: float,
) -> _Mask:
    """Tell which footprints meet an occupied cell or reach outside the grid; see `meets`."""
    out = np.zeros(packed.shape[0], np.bool_)
    for i in range(packed.shape[0]):
        out[i] = meets(packed, i, lattice, occupied, True, field, unit, tolerance_m)
    return out


@compiled
def meets(
    packed: _FloatArray,
    i: int,
    lattice: _FloatArray,
    cells: NDArray[Any],
    value: Any,
    field: _Field,
    unit: float,
    tolerance_m: float,
) -> bool:
    """Tell whether footprint `i` meets a cell of a value, or reaches outside the grid.

    The field is 0 on all such cells. So the footprint is free if it does not meet a 0 of the field.
    """
    x, y, top_x, top_y, right_x, right_y = outline(packed, i, lattice, tolerance_m)
    if _is_far(field, unit, x, y, (top_x, top_y), (right_x, right_y)):
        return False
    first, last = np.int64(np.floor(y - top_y)), np.int64(np.ceil(y + top_y)) - 1
    if first < 0 or last >= field.shape[0]:
        return True
    for row in range(first, last + 1):
        start, end = column_range(row, x, y, top_x, top_y, right_x, right_y)
        if start < 0 or end >= field.shape[1]:
            return True
        column = _next_zero(field, unit, row, start, end)
        while column <= end:
            if cells[row, column] == value:
                return True
            column = _next_zero(field, unit, row, column + 1, end)
    return False


@compiled
def hits_voxels(
    packed: _FloatArray,
    floors_m: _FloatArray,
    lattice: _FloatArray,
    layers_m: tuple[float, float],
    occupied: NDArray[np.uint8],
    lowest: NDArray[np.int32],
    field: _Field,
    tolerance_m: float,
) -> _Mask:
    """Tell which boxes meet an occupied voxel whose top is above their floor.

    `floors_m` (N,): voxels that end at or below it are ground. `layers_m`: the lattice's low end
    and the voxels' height. `field`, in cells: 0 on each column (iy, ix) that may be met; `lowest`:
    the lowest occupied layer of each column that may be met. Under a ceiling that is all it takes.
    """
    out = np.zeros(packed.shape[0], np.bool_)
    low_m, height_m = layers_m
    for i in range(packed.shape[0]):
        bottom = max(packed[i, 2] - packed[i, 7], floors_m[i]) + tolerance_m
        top = packed[i, 2] + packed[i, 7] - tolerance_m
        first_layer = max(np.int64(np.floor((bottom - low_m) / height_m)), 0)
        end_layer = min(np.int64(np.ceil((top - low_m) / height_m)), occupied.shape[2])
        x, y, top_x, top_y, right_x, right_y = outline(packed, i, lattice, tolerance_m)
        is_far = _is_far(field, 1.0, x, y, (top_x, top_y), (right_x, right_y))
        if is_far or first_layer >= end_layer:
            continue
        row, last = np.int64(np.floor(y - top_y)), np.int64(np.ceil(y + top_y)) - 1
        row, last = max(row, 0), min(last, field.shape[0] - 1)
        while row <= last and not out[i]:
            start, end = column_range(row, x, y, top_x, top_y, right_x, right_y)
            end = min(end, field.shape[1] - 1)
            column = _next_zero(field, 1.0, row, max(start, 0), end)
            while column <= end and not out[i]:
                for layer in range(max(first_layer, lowest[row, column]), end_layer):
                    if occupied[column, row, layer]:
                        out[i] = True
                        break
                column = _next_zero(field, 1.0, row, column + 1, end)
            row += 1
    return out
