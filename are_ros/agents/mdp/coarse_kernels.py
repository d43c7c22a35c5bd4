"""Compiled loops of the coarse map: components within blocks of cells, and what joins them.

A block is n x n cells of the fine grid (fewer at the far edges of the map). Directions are 0 east
(columns grow), 1 north (rows grow), 2 west, 3 south.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.agents.navigation.terrain import disc_fits

Labels = npt.NDArray[np.uint16]

ROW_STEPS: Final = (0, 1, 0, -1)
COL_STEPS: Final = (1, 0, -1, 0)

_UNSEEN: Final = 65535
"""The label of a cell that no component has taken yet."""


@compiled
def disc_fits_in(
    clearance_m: npt.NDArray[np.float32],
    region: npt.NDArray[np.bool_],
    radius_m: float,
    unit_m: float,
) -> bool:
    """Tell whether a disc fits about any cell of a region (H, W); mostly one of the first tells."""
    for row in range(region.shape[0]):
        for col in range(region.shape[1]):
            if region[row, col] and disc_fits(clearance_m, row, col, radius_m, unit_m):
                return True
    return False


@compiled
def label_blocks(
    clearance_m: npt.NDArray[np.float32],
    disc_m: tuple[float, float],
    levels_m: tuple[float, float],
    side: int,
    labels: Labels,
    mains: Labels,
    anchors: npt.NDArray[np.int32],
    is_main: npt.NDArray[np.bool_],
) -> None:
    """Label the fine cells in which a disc fits that keep the least clearance, block by block.

    `disc_m` are its radius and the size of a fine cell, `levels_m` the least clearance and the one
    that is enough: more is no better.
    `labels` (H, W) becomes 0 where there is too little room, else the number of the component
    within the block; `mains` (h, w) the largest component, 0 if there is none (the first of equal
    ones); `anchors` (h, w, 2) its fine cell (row, col) with most clearance, of equal ones the most
    central; `is_main` (H, W) tells which fine cells belong to it.
    """
    least_m, enough_m = levels_m
    everywhere_m = max(enough_m, disc_m[0] + disc_m[1])  # from there on a disc fits, too
    queue = np.empty((side * side, 2), np.int32)
    for i in range(mains.shape[0]):
        for j in range(mains.shape[1]):
            block = (slice(i * side, (i + 1) * side), slice(j * side, (j + 1) * side))
            room_m, inner = clearance_m[block], labels[block]
            if room_m.min() >= everywhere_m:  # most blocks of a large hall: the same, but faster
                inner[:], mains[i, j], is_main[block] = 1, 1, True
                anchors[i, j, 0] = i * side + min((side - 1) // 2, inner.shape[0] - 1)
                anchors[i, j, 1] = j * side + min((side - 1) // 2, inner.shape[1] - 1)
                continue
            unseen = 0
            for row in range(inner.shape[0]):
                for col in range(inner.shape[1]):
                    at = i * side + row, j * side + col
                    has_room = room_m[row, col] >= least_m
                    fits = has_room and disc_fits(clearance_m, at[0], at[1], disc_m[0], disc_m[1])
                    inner[row, col] = _UNSEEN if fits else 0
                    unseen += fits
            main = mains[i, j] = _label_block(inner, unseen, queue)
            most_m, nearest = -1.0, 0
            for row in range(inner.shape[0]):
                for col in range(inner.shape[1]):
                    here_m = min(float(room_m[row, col]), enough_m)
                    belongs = main != 0 and inner[row, col] == main
                    is_main[i * side + row, j * side + col] = belongs
                    if not belongs or here_m < most_m:
                        continue
                    away = (2 * row + 1 - side) ** 2 + (2 * col + 1 - side) ** 2
                    if here_m > most_m or away < nearest:
                        anchors[i, j, 0], anchors[i, j, 1] = i * side + row, j * side + col
                        most_m, nearest = here_m, away


@compiled
def _label_block(labels: Labels, unseen: int, queue: npt.NDArray[np.int32]) -> int:
    """Label the unseen cells of one block, and return the number of its largest component."""
    if unseen == labels.size:  # one component, and no need to follow it
        labels[:] = 1
        return 1
    count = largest = most = 0
    for row in range(labels.shape[0]):
        for col in range(labels.shape[1]):
            if labels[row, col] == _UNSEEN:
                count += 1
                queue[0, 0], queue[0, 1] = row, col
                labels[row, col] = count
                done, size = 0, 1
                while done < size:  # the component of the cell
                    for direction in range(4):
                        r = queue[done, 0] + ROW_STEPS[direction]
                        c = queue[done, 1] + COL_STEPS[direction]
                        inside = 0 <= r < labels.shape[0] and 0 <= c < labels.shape[1]
                        if inside and labels[r, c] == _UNSEEN:
                            labels[r, c] = count
                            queue[size, 0], queue[size, 1] = r, c
                            size += 1
                    done += 1
                if size > most:
                    largest, most = count, size
    return largest


@compiled
def open_edges(labels: Labels, mains: Labels, side: int, edges: npt.NDArray[np.bool_]) -> None:
    """Tell which neighbouring blocks' largest components join within the two: bool (4, h, w).

    They join by way of any components on both sides of the border.
    """
    edges[:] = False
    height, width = mains.shape
    reached = np.zeros((2, side * side + 1), np.bool_)
    for i in range(height):
        for j in range(width):
            for direction in range(2):
                k, m = i + ROW_STEPS[direction], j + COL_STEPS[direction]
                if k == height or m == width or mains[i, j] == 0 or mains[k, m] == 0:
                    continue
                if direction == 0:
                    rows, col = slice(i * side, (i + 1) * side), m * side
                    here, there = labels[rows, col - 1], labels[rows, col]
                else:
                    row, cols = k * side, slice(j * side, (j + 1) * side)
                    here, there = labels[row - 1, cols], labels[row, cols]
                reached[:] = False
                reached[0, mains[i, j]] = grows = True
                while grows and not reached[1, mains[k, m]]:
                    grows = False
                    for n in range(here.shape[0]):
                        a, b = here[n], there[n]
                        if a != 0 and b != 0 and reached[0, a] != reached[1, b]:
                            reached[0, a] = reached[1, b] = grows = True
                edges[direction, i, j] = edges[direction + 2, k, m] = reached[1, mains[k, m]]


def label_components(mains: Labels, edges: npt.NDArray[np.bool_]) -> npt.NDArray[np.int32]:
    """Return numbers int32 (h, w) of open blocks, equal where open edges join; -1 where closed."""
    from scipy.sparse import coo_array  # slow to import
    from scipy.sparse.csgraph import connected_components

    index = np.arange(mains.size, dtype=np.int32).reshape(mains.shape)
    joins_x, joins_y = edges[0, :, :-1], edges[1, :-1]
    ones = np.concatenate((index[:, :-1][joins_x], index[:-1][joins_y]))
    others = np.concatenate((index[:, 1:][joins_x], index[1:][joins_y]))
    joins = coo_array((np.ones(ones.size, np.int8), (ones, others)), shape=(mains.size, mains.size))
    components, is_open = np.full(mains.shape, -1, np.int32), mains != 0
    component = connected_components(joins, directed=False)[1].reshape(mains.shape)[is_open]
    # numbered in the order of their first blocks
    _, first, number = np.unique(component, return_index=True, return_inverse=True)
    components[is_open] = np.argsort(np.argsort(first))[number]
    return components
