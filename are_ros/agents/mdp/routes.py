"""One-step lookahead over values, and the way that follows from it, compiled."""

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing
from are_ros.agents.mdp.coarse_kernels import COL_STEPS, ROW_STEPS

Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Lengths = npt.NDArray[np.uint8]

TIE = 1e-6
"""Actions whose values differ by less count as equal; then going straight on is preferred."""


@borrowing
def action_values(
    values: Floats,
    lengths: Lengths,
    gains: Floats,
    weights: Doubles,
    anchors_m: Doubles,
    moving: Doubles,
    state: tuple[int, int, int],
    result: Doubles,
) -> None:
    """Fill in what staying and the four directions bring: the first 5 of float64 (9,).

    `values` (4, h, w) with one epoch less; `state` row and column in the window, and heading;
    `weights` as `ValueTable.weights`; `anchors_m` (H, W, 2) of the whole coarse map; `moving`
    (M, 5) is x, y, radius, fade and weight of each moving neighbour.
    """
    row, col, heading = state
    brings = result[5:]
    result[0] = gains[4, row, col] + values[heading, row, col]
    if moving.shape[0] > 0:
        result[0] -= _bother(anchors_m, weights, row, col, moving)
    for direction in range(4):
        length = lengths[direction, row, col]
        r, c = row + length * ROW_STEPS[direction], col + length * COL_STEPS[direction]
        brings[direction] = gains[direction, row, col] + values[direction, r, c]
        if moving.shape[0] > 0 and length == 0:
            brings[direction] -= _bother(anchors_m, weights, row, col, moving)
        elif moving.shape[0] > 0:  # in each cell that the move enters, over the reach
            total = 0.0
            for k in range(1, length + 1):
                r, c = row + k * ROW_STEPS[direction], col + k * COL_STEPS[direction]
                total += _bother(anchors_m, weights, r, c, moving)
            brings[direction] -= total / weights[4]
    for direction in range(4):
        sides = brings[(direction + 1) % 4] + brings[(direction + 3) % 4]
        apart = (direction - heading) % 4
        turn = 0.0 if apart == 0 else weights[3 if apart == 2 else 2]
        result[1 + direction] = weights[0] * brings[direction] + weights[1] * sides - turn


@borrowing
def _bother(anchors_m: Doubles, weights: Doubles, row: int, col: int, moving: Doubles) -> float:
    """Return the cost of moving neighbours in a cell: their weight at their radius, fading to 0."""
    anchor_m = anchors_m[row + int(weights[5]), col + int(weights[6])]
    total = 0.0
    for k in range(moving.shape[0]):
        dx_m, dy_m = moving[k, 0] - anchor_m[0], moving[k, 1] - anchor_m[1]
        away_m = np.sqrt(dx_m * dx_m + dy_m * dy_m) - moving[k, 2]
        total += moving[k, 4] * min(1.0, max(0.0, 1.0 - away_m / moving[k, 3]))
    return total


@borrowing
def best_action(brings: Doubles, heading: int) -> int:
    """Return the best action; of equal ones the first of ahead, left, right, back and stay."""
    best = 1 + heading
    for turn in (1, 3, 2):
        action = 1 + (heading + turn) % 4
        if brings[action] > brings[best] + TIE:
            best = action
    return 0 if brings[0] > brings[best] + TIE else best


@borrowing
def follow(
    planes: Floats,
    lengths: Lengths,
    gains: Floats,
    weights: Doubles,
    anchors_m: Doubles,
    state: tuple[int, int, int],
    action: int,
    points_m: Doubles,
    brings: Doubles,
    no_others: Doubles,
) -> tuple[int, float]:
    """Fill in the anchors (K, 2) that an action and then the best ones lead along, without slips.

    Returns how many there are, and the epochs that this takes: to the goal, or to where the
    points are all used; inf if neither is ever reached. Scratch are `brings` (9,) and `no_others`
    (0, 5).
    """
    row, col, heading = state
    values = planes[planes.shape[0] - 1]
    count, epochs = 0, 0.0
    for _ in range(lengths.size):
        if (row == weights[7] and col == weights[8]) or count == points_m.shape[0]:
            return count, epochs
        length = lengths[action - 1, row, col] if action > 0 else 0
        heading = action - 1 if action > 0 else heading
        for _ in range(length):
            row, col = row + ROW_STEPS[heading], col + COL_STEPS[heading]
            if count < points_m.shape[0]:
                anchor_m = anchors_m[row + int(weights[5]), col + int(weights[6])]
                points_m[count, 0], points_m[count, 1] = anchor_m[0], anchor_m[1]
                count += 1
        epochs += length / weights[4] if length > 0 else 1.0
        state = (row, col, heading)
        action_values(values, lengths, gains, weights, anchors_m, no_others, state, brings)
        action = best_action(brings, heading)
    return count, np.inf
