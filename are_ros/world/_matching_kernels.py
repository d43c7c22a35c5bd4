"""How well a cloud of scan endpoints fits a map at a pose, and the branch-and-bound search for it.

Poses are (x, y, yaw) of the cloud's reference point, in cells of the search grid and in radians.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

FULL: Final = 255
"""The value of an endpoint on a wall, in the fields of the search."""

FREE_CELL: Final = 0
WALL_CELL: Final = 1
UNKNOWN_CELL: Final = 2

_CHECK_EVERY: Final = 8
_STEP_CELLS: Final = 0.5
_LEAF_EFFORT: Final = 60
"""What expanding a node to leaves costs, whose beams are followed, in nodes of other levels."""


@compiled
def crosses_wall(
    clear: Bytes, x0: float, y0: float, x1: float, y1: float, margin_cells: float
) -> bool:
    """Tell whether a beam from (x0, y0) to (x1, y1) [cells] meets a wall before its last part.

    `clear` is how many cells away a wall may begin, 0 in a wall (`clearance`). The last
    `margin_cells` are left out: there the wall that the beam hits begins.
    """
    dx, dy = x1 - x0, y1 - y0
    length = np.sqrt(dx * dx + dy * dy)
    reach = length - margin_cells
    along = 0.0
    while along < reach:
        x, y = x0 + along / length * dx, y0 + along / length * dy
        leap = _STEP_CELLS
        if 0.0 <= x < clear.shape[1] and 0.0 <= y < clear.shape[0]:
            cells = clear[int(y), int(x)]
            if cells == 0:
                return True
            leap = max(_STEP_CELLS, cells - 1.5)
        along += leap
    return False


@compiled
def bound_at(
    field: Bytes, pad: int, outside: int, points: Floats, x: float, y: float, yaw: float, floor: int
) -> int:
    """Return the sum of the field over the points (N, 2) at a pose; -1 if not above `floor`.

    `field` is the map's with `pad` cells around; beyond it the value is `outside`.
    """
    cosine, sine = np.cos(yaw), np.sin(yaw)
    total, left = 0, FULL * points.shape[0]
    x, y = x + pad, y + pad
    for k in range(points.shape[0]):
        col = cosine * points[k, 0] - sine * points[k, 1] + x
        row = sine * points[k, 0] + cosine * points[k, 1] + y
        if 0.0 <= col < field.shape[1] and 0.0 <= row < field.shape[0]:
            total += int(field[int(row), int(col)])
        else:
            total += outside
        left -= FULL
        if k % _CHECK_EVERY == 0 and total + left <= floor:
            return -1
    return total if total > floor else -1


@compiled
def score_at(
    field: Bytes,
    pad: int,
    outside: int,
    clear: Bytes,
    points: Floats,
    origins: Floats,
    margin_cells: float,
    x: float,
    y: float,
    yaw: float,
    bound: int,
    floor: int,
) -> int:
    """Return the score of a pose: its `bound_at`, but an endpoint behind a wall counts -`FULL`.

    `clear` is the clearance without padding, `origins` (N, 2) are the beams' beginnings.
    """
    cosine, sine = np.cos(yaw), np.sin(yaw)
    for k in range(points.shape[0]):
        col = cosine * points[k, 0] - sine * points[k, 1] + x
        row = sine * points[k, 0] + cosine * points[k, 1] + y
        x0 = cosine * origins[k, 0] - sine * origins[k, 1] + x
        y0 = sine * origins[k, 0] + cosine * origins[k, 1] + y
        if crosses_wall(clear, x0, y0, col, row, margin_cells):
            value = outside
            if -pad <= col < field.shape[1] - pad and -pad <= row < field.shape[0] - pad:
                value = int(field[int(row + pad), int(col + pad)])
            bound -= value + FULL
            if bound <= floor:
                return -1
    return bound


@compiled
def top_bounds(
    field: Bytes,
    pad: int,
    outside: int,
    points: Floats,
    level: int,
    yaw_step: float,
    floor: int,
    out: npt.NDArray[np.int32],
) -> None:
    """Write the bound of each node (yaw, y, x) of a level into `out`, -1 if not above `floor`."""
    size = float(1 << level)
    for it in range(out.shape[0]):
        yaw = (it + 0.5) * size * yaw_step
        for iy in range(out.shape[1]):
            for ix in range(out.shape[2]):
                x, y = (ix + 0.5) * size, (iy + 0.5) * size
                out[it, iy, ix] = bound_at(field, pad, outside, points, x, y, yaw, floor)


@compiled
def is_within(
    x: float, y: float, yaw: float, excluded: Floats, radius: float, turn: float, reach: float
) -> bool:
    """Tell whether all poses around one are near an excluded pose (M, 3).

    `reach` is how far those around lie [cells, and in units of `turn` per radius].
    """
    for m in range(excluded.shape[0]):
        dx, dy = x - excluded[m, 0], y - excluded[m, 1]
        away = abs(yaw - excluded[m, 2]) % (2.0 * np.pi)
        away = min(away, 2.0 * np.pi - away)
        if np.sqrt(dx * dx + dy * dy) + reach < radius and away + reach / radius * turn < turn:
            return True
    return False


@compiled
def _push_children(
    fields: Bytes,
    pad: int,
    outside: int,
    clear: Bytes,
    points: Floats,
    origins: Floats,
    margin_cells: float,
    node: Ints,
    sides: Ints,
    yaw_step: float,
    excluded: Floats,
    radius: float,
    turn: float,
    best: int,
    children: Ints,
) -> int:
    """Write the children of a node that may exceed `best`, the lowest first; return how many."""
    below = node[0] - 1
    size = float(1 << below)
    # How far the poses of a child lie from its middle, the turn in the measure of the exclusion.
    wide = max(0.71 * (size - 1.0), 0.5 * (size - 1.0) * yaw_step / turn * radius)
    found = 0
    for number in range(8):
        ix, iy = 2 * node[1] + (number & 1), 2 * node[2] + ((number >> 1) & 1)
        it = 2 * node[3] + (number >> 2)
        x, y, yaw = (ix + 0.5) * size, (iy + 0.5) * size, (it + 0.5) * size * yaw_step
        if (ix << below) >= sides[0] or (iy << below) >= sides[1]:
            continue
        if is_within(x, y, yaw, excluded, radius, turn, wide):
            continue
        value = bound_at(fields[below], pad, outside, points, x, y, yaw, best)
        if below == 0 and value > best:
            value = score_at(
                fields[0], pad, outside, clear, points, origins, margin_cells, x, y, yaw, value,
                best,
            )  # fmt: skip
        if value <= best:
            continue
        k = found
        while k > 0 and children[k - 1, 4] > value:
            children[k] = children[k - 1]
            k -= 1
        children[k, 0], children[k, 1], children[k, 2] = below, ix, iy
        children[k, 3], children[k, 4] = it, value
        found += 1
    return found


@compiled
def search_nodes(
    fields: Bytes,
    pad: int,
    outside: int,
    clear: Bytes,
    points: Floats,
    origins: Floats,
    margin_cells: float,
    level: int,
    nodes: Ints,
    bounds: npt.NDArray[np.int32],
    sides: Ints,
    yaw_step: float,
    excluded: Floats,
    radius: float,
    turn: float,
    best: int,
    best_leaf: Ints,
    left: Ints,
) -> int:
    """Search below nodes (N, 3) of one level for the leaf with the highest score above `best`.

    Depth first, the child with the highest bound first. `fields` (levels, H, W) holds for each
    level the highest value within 2^level - 1 cells, padded; `sides` is the number of leaves along
    x, y and yaw. Leaves that lie near an `excluded` pose are left out. Writes the leaf (x, y, yaw)
    and returns its score, or `best` where there is none. `left[0]` counts down the effort that may
    be spent; where nothing is left, the search is given up.
    """
    stack = np.empty((8 * (level + 1) + 8, 5), np.int64)
    children = np.empty((8, 5), np.int64)
    for n in range(nodes.shape[0]):
        if bounds[n] <= best:
            continue
        stack[0, 0], stack[0, 4] = level, bounds[n]
        stack[0, 1], stack[0, 2], stack[0, 3] = nodes[n, 0], nodes[n, 1], nodes[n, 2]
        depth = 1
        while depth > 0 and left[0] > 0:
            depth -= 1
            node = stack[depth].copy()
            if node[4] <= best:
                continue
            if node[0] == 0:
                best = node[4]
                best_leaf[:] = node[1:4]
                continue
            left[0] -= _LEAF_EFFORT if node[0] == 1 else 1
            found = _push_children(
                fields, pad, outside, clear, points, origins, margin_cells, node, sides, yaw_step,
                excluded, radius, turn, best, children,
            )  # fmt: skip
            stack[depth : depth + found] = children[:found]
            depth += found
    return best


@compiled
def distance_at(distances: npt.NDArray[np.float32], col: float, row: float) -> float:
    """Return the distance between the cells' centres, bilinear; infinite beyond the map."""
    col, row = col - 0.5, row - 0.5
    if not (0.0 <= col < distances.shape[1] - 1 and 0.0 <= row < distances.shape[0] - 1):
        return np.inf
    i, j = int(row), int(col)
    fy, fx = row - i, col - j
    low = distances[i, j] * (1.0 - fx) + distances[i, j + 1] * fx
    high = distances[i + 1, j] * (1.0 - fx) + distances[i + 1, j + 1] * fx
    return float(low * (1.0 - fy) + high * fy)


@compiled
def likelihood(
    distances: npt.NDArray[np.float32],
    resolution_m: float,
    points_m: Floats,
    x_m: float,
    y_m: float,
    yaw: float,
    sigma_m: float,
) -> float:
    """Return the mean of exp(-d^2 / 2 sigma^2) over the points (N, 2) [m] at a pose."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    total = 0.0
    for k in range(points_m.shape[0]):
        x = cosine * points_m[k, 0] - sine * points_m[k, 1] + x_m
        y = sine * points_m[k, 0] + cosine * points_m[k, 1] + y_m
        d = distance_at(distances, x / resolution_m, y / resolution_m)
        if d < 5.0 * sigma_m:
            total += np.exp(-0.5 * (d / sigma_m) ** 2)
    return float(total / points_m.shape[0])


@compiled
def judge_points(
    distances: npt.NDArray[np.float32],
    kinds: Bytes,
    clear: Bytes,
    resolution_m: float,
    points_m: Floats,
    origins_m: Floats,
    x_m: float,
    y_m: float,
    yaw: float,
    margin_m: float,
    away_m: Floats,
    flags: Bytes,
) -> None:
    """Write for each endpoint how far from an occupied cell it lies [m], and `flags`.

    A flag is UNKNOWN_CELL or FREE_CELL, that of the endpoint's cell (unknown beyond the map), or
    WALL_CELL where the beam meets a wall more than `margin_m` before its end.
    """
    cosine, sine = np.cos(yaw), np.sin(yaw)
    for k in range(points_m.shape[0]):
        col = (cosine * points_m[k, 0] - sine * points_m[k, 1] + x_m) / resolution_m
        row = (sine * points_m[k, 0] + cosine * points_m[k, 1] + y_m) / resolution_m
        x0 = (cosine * origins_m[k, 0] - sine * origins_m[k, 1] + x_m) / resolution_m
        y0 = (sine * origins_m[k, 0] + cosine * origins_m[k, 1] + y_m) / resolution_m
        away_m[k], flags[k] = np.inf, UNKNOWN_CELL
        if 0.0 <= col < kinds.shape[1] and 0.0 <= row < kinds.shape[0]:
            kind = kinds[int(row), int(col)]
            if kind == WALL_CELL:
                away_m[k] = 0.0
            else:
                away_m[k] = distances[int(row), int(col)]
            flags[k] = FREE_CELL if kind == WALL_CELL else kind
        if crosses_wall(clear, x0, y0, col, row, margin_m / resolution_m):
            flags[k] = WALL_CELL
