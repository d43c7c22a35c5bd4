"""Compiled loops of the coarse map: components within blocks of cells, and what joins them.

A block is n x n cells of the fine grid (fewer at the far edges of the map). Directions are 0 east
(columns grow), 1 north (rows grow), 2 west, 3 south.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.agents.navigation.terrain import disc_is_free
from are_ros.world.boxes import TOUCH_TOLERANCE_M

Labels = npt.NDArray[np.uint16]

ROW_STEPS: Final = (0, 1, 0, -1)
COL_STEPS: Final = (1, 0, -1, 0)


@compiled
def exact_room(
    clearance_m: npt.NDArray[np.float32], radius_m: float, unit_m: float
) -> npt.NDArray[np.float32]:
    """Return the clearance (H, W), but 0 where a disc about the cell's centre meets a closed one.

    Clearance is to centres: half a cell more than the radius is enough beside a cell, and half a
    diagonal before its corner; between the two the cells around are looked at.
    """
    room_m: npt.NDArray[np.float32] = clearance_m.copy()
    radius = radius_m / unit_m - TOUCH_TOLERANCE_M
    least_m, enough_m = radius_m + (0.5 - 1e-3) * unit_m, radius_m + 0.7072 * unit_m
    for row in range(room_m.shape[0]):
        for col in range(room_m.shape[1]):
            if room_m[row, col] < enough_m and (
                room_m[row, col] < least_m
                or not disc_is_free(clearance_m, col + 0.5, row + 0.5, radius)
            ):
                room_m[row, col] = 0.0
    return room_m


@compiled
def label_blocks(
    clearance_m: npt.NDArray[np.float32],
    levels_m: tuple[float, float],
    side: int,
    labels: Labels,
    mains: Labels,
    anchors: npt.NDArray[np.int32],
) -> None:
    """Label the fine cells that keep the least clearance, block by block.

    `levels_m` are the least clearance and the one that is enough: more is no better.
    `labels` (H, W) becomes 0 where there is too little room, else the number of the component
    within the block; `mains` (h, w) the largest component, 0 if there is none (the first of equal
    ones); `anchors` (h, w, 2) its best fine cell (row, col).
    """
    least_m, enough_m = levels_m
    queue = np.empty((side * side, 2), np.int32)
    for i in range(mains.shape[0]):
        for j in range(mains.shape[1]):
            block = (slice(i * side, (i + 1) * side), slice(j * side, (j + 1) * side))
            room_m, inner = clearance_m[block], labels[block]
            mains[i, j] = _label_block(room_m, least_m, inner, queue)
            if mains[i, j] != 0:
                row, col = _best_cell(room_m, enough_m, inner, mains[i, j], side)
                anchors[i, j, 0], anchors[i, j, 1] = i * side + row, j * side + col


@compiled
def _label_block(
    room_m: npt.NDArray[np.float32], least_m: float, labels: Labels, queue: npt.NDArray[np.int32]
) -> int:
    """Label one block, and return the number of its largest component."""
    count = largest = most = 0
    labels[:] = 0
    for row in range(labels.shape[0]):
        for col in range(labels.shape[1]):
            if labels[row, col] == 0 and room_m[row, col] >= least_m:
                count += 1
                queue[0, 0], queue[0, 1] = row, col
                labels[row, col] = count
                done, size = 0, 1
                while done < size:  # the component of the cell
                    for direction in range(4):
                        r = queue[done, 0] + ROW_STEPS[direction]
                        c = queue[done, 1] + COL_STEPS[direction]
                        inside = 0 <= r < labels.shape[0] and 0 <= c < labels.shape[1]
                        if inside and labels[r, c] == 0 and room_m[r, c] >= least_m:
                            labels[r, c] = count
                            queue[size, 0], queue[size, 1] = r, c
                            size += 1
                    done += 1
                if size > most:
                    largest, most = count, size
    return largest


@compiled
def _best_cell(
    room_m: npt.NDArray[np.float32], enough_m: float, labels: Labels, label: int, side: int
) -> tuple[int, int]:
    """Return the cell of a component with most clearance, of equal ones the most central."""
    best = (0, 0)
    most_m, nearest = -1.0, 0
    for row in range(labels.shape[0]):
        for col in range(labels.shape[1]):
            here_m = min(float(room_m[row, col]), enough_m)
            if labels[row, col] != label or here_m < most_m:
                continue
            away = (2 * row + 1 - side) ** 2 + (2 * col + 1 - side) ** 2
            if here_m > most_m or away < nearest:
                best, most_m, nearest = (row, col), here_m, away
    return best


@compiled
def open_edges(labels: Labels, mains: Labels, side: int, edges: npt.NDArray[np.bool_]) -> None:
    """Tell which neighbouring blocks' largest components join within the two: bool (4, h, w)."""
    edges[:] = False
    height, width = mains.shape
    reached = np.zeros((2, side * side + 1), np.bool_)
    for i in range(height):
        for j in range(width):
            row, col = (i + 1) * side, (j + 1) * side
            if j + 1 < width:
                rows = slice(i * side, row)
                west, east = labels[rows, col - 1], labels[rows, col]
                is_open = _join(west, east, mains[i, j], mains[i, j + 1], reached)
                edges[0, i, j] = edges[2, i, j + 1] = is_open
            if i + 1 < height:
                cols = slice(j * side, col)
                south, north = labels[row - 1, cols], labels[row, cols]
                is_open = _join(south, north, mains[i, j], mains[i + 1, j], reached)
                edges[1, i, j] = edges[3, i + 1, j] = is_open


@compiled
def _join(
    side_a: Labels, side_b: Labels, main_a: int, main_b: int, reached: npt.NDArray[np.bool_]
) -> bool:
    """Tell whether two components join by way of any components on both sides of a border."""
    if main_a == 0 or main_b == 0:
        return False
    reached[:] = False
    reached[0, main_a] = True
    grows = True
    while grows and not reached[1, main_b]:
        grows = False
        for i in range(side_a.shape[0]):
            a, b = side_a[i], side_b[i]
            if a != 0 and b != 0 and reached[0, a] != reached[1, b]:
                reached[0, a] = reached[1, b] = grows = True
    return bool(reached[1, main_b])


def label_components(mains: Labels, edges: npt.NDArray[np.bool_]) -> npt.NDArray[np.int32]:
    """Return numbers int32 (h, w) of open blocks, equal where open edges join; -1 where closed.

    The least index in a component spreads over its open edges until nothing changes.
    """
    least = np.arange(mains.size, dtype=np.int32).reshape(mains.shape)
    west, east, south, north = least[:, :-1], least[:, 1:], least[:-1], least[1:]
    joins_x, joins_y = edges[0, :, :-1], edges[1, :-1]
    has_changed = True
    while has_changed:
        before = least.copy()
        for one, other, joins in ((west, east, joins_x), (south, north, joins_y)):
            np.minimum(one, other, out=one, where=joins)
            np.minimum(one, other, out=other, where=joins)
        has_changed = not np.array_equal(least, before)
    components, is_open = np.full(mains.shape, -1, np.int32), mains != 0
    components[is_open] = np.unique(least[is_open], return_inverse=True)[1]
    return components


def belongs_to_main(labels: Labels, mains: Labels, side: int) -> npt.NDArray[np.bool_]:
    """Tell which fine cells (H, W) belong to the largest component of their block."""
    main = mains.repeat(side, axis=0).repeat(side, axis=1)[: labels.shape[0], : labels.shape[1]]
    is_main: npt.NDArray[np.bool_] = (labels == main) & (main != 0)
    return is_main
