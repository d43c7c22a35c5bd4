"""Lookahead over the next epochs, and the way that follows from the values, compiled."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, compiled
from are_ros.agents.mdp.coarse_kernels import COL_STEPS, ROW_STEPS

Floats = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Lengths = npt.NDArray[np.uint8]
Cell = tuple[int, int]

TIE = 1e-6
"""Actions whose values differ by less count as equal; then going straight on is preferred."""

_ROUNDING = 1e-5
"""Costs of ways that differ by this share count as equal."""

AHEAD = 2
"""For so many epochs the motion of the others is foreseen."""

_WAY_CELLS = 6
"""So many cells ahead tell where a way leads."""

_BACK = -0.5
"""A move goes back if the cosine of its angle with the way is less."""


class ValueArrays(NamedTuple):
    """A value table as the kernels take it, with a window of h x w cells.

    `planes`, `epochs`, `settled` and `nearness` as in `ValueTable`, `lengths` and `costs` as in
    `Ways`. `paces` (P, 2) are reach and effort of each. `prices` are those of time and clearance,
    and what resting saves; `chances` as in `Process`; `turns` those of turning by none to three
    quarters; `corner` is the window's first cell, `goal` the goal's in the window.
    """

    planes: Floats
    epochs: tuple[int, int]
    settled: Lengths
    lengths: Lengths
    costs: Floats
    nearness: Floats
    paces: Doubles
    prices: tuple[float, float, float]
    chances: tuple[float, float, float]
    turns: tuple[float, float, float, float]
    corner: Cell
    goal: Cell


ValueTuple = tuple[Any, ...]
"""The fields of `ValueArrays`."""


class Moves(NamedTuple):
    """Scratch for the moves from a cell, float64 (P, 4) each.

    What an epoch brings, how many cells are gone, what comes of it in all, and the same where it
    may slip. `after` (4,) are values by heading.
    """

    gains: Doubles
    lengths: Doubles
    brings: Doubles
    slipping: Doubles
    after: Doubles


@compiled
def action_values(
    values: ValueArrays,
    epochs_left: int,
    anchors_m: Doubles,
    others: Doubles,
    state: tuple[int, int, int],
    result: Doubles,
) -> float:
    """Fill in what staying and the four directions bring at each pace, (P, 5).

    Returns the value of the state with an epoch less.

    `anchors_m` (H, W, 2) of the whole coarse map. `others` (K, M, 5) is x, y, radius, fade and
    weight of each moving neighbour in each of K epochs, K at most `epochs_left`. They cost their
    weight within the radius, fading to 0, in each cell entered, and a move that enters the radius
    of one fails. Backward induction over the states that can be reached in K epochs, exact.
    """
    row, col, heading = state
    numbers, after = np.empty((2, 4, values.paces.shape[0], 4)), np.empty((2, 4))
    moves = Moves(numbers[0, 0], numbers[0, 1], numbers[0, 2], numbers[0, 3], after[0])
    further = Moves(numbers[1, 0], numbers[1, 1], numbers[1, 2], numbers[1, 3], after[1])
    epochs_left -= 1
    here = _find_moves(values, anchors_m, others[0], (row, col), moves)
    _find_after(values, epochs_left, anchors_m, others[1:], (row, col), further)
    for direction in range(4):
        moves.after[direction] = further.after[direction]
    for direction in range(4):
        for pace in range(moves.gains.shape[0]):
            length = int(moves.lengths[pace, direction])
            if length == 0:
                after = moves.after[direction]
            elif pace > 0 and length == moves.lengths[pace - 1, direction]:
                after = moves.brings[pace - 1, direction] - moves.gains[pace - 1, direction]
            else:
                r, c = row + length * ROW_STEPS[direction], col + length * COL_STEPS[direction]
                _find_after(values, epochs_left, anchors_m, others[1:], (r, c), further)
                after = further.after[direction]
            moves.brings[pace, direction] = moves.gains[pace, direction] + after
    _slip(values, here, moves)
    for pace in range(moves.gains.shape[0]):
        result[pace, 0] = moves.after[heading] - here + values.prices[2]
        for direction in range(4):
            turn = values.turns[(direction - heading) % 4]
            result[pace, 1 + direction] = moves.slipping[pace, direction] - turn
    return float(moves.after[heading])


@borrowing
def _find_moves(
    values: ValueArrays, anchors_m: Doubles, others: Doubles, cell: Cell, moves: Moves
) -> float:
    """Find how far moves go and what the epoch brings; return what the epoch costs in the cell."""
    row, col = cell
    here, _ = _price(values, anchors_m, others, row, col)
    for direction in range(4):
        longest = int(values.lengths[direction, row, col])
        is_free, swept, k = True, 0.0, 0
        while True:
            for pace in range(values.paces.shape[0]):
                reach, effort = values.paces[pace, 0], values.paces[pace, 1]
                if k == min(longest, int(reach)):
                    length = k if is_free else 0
                    dearer = (1.0 + effort / values.prices[0]) / reach
                    cost = swept * dearer if length > 0 else here + effort
                    moves.lengths[pace, direction] = length
                    moves.gains[pace, direction] = -cost
            if k >= longest:
                break
            k += 1
            r, c = row + k * ROW_STEPS[direction], col + k * COL_STEPS[direction]
            price, is_occupied = _price(values, anchors_m, others, r, c)
            is_free = is_free and not is_occupied
            swept += price
    return here


@borrowing
def _find_after(
    values: ValueArrays,
    epochs_left: int,
    anchors_m: Doubles,
    others: Doubles,
    cell: Cell,
    moves: Moves,
) -> None:
    """Find the values of a cell by heading, with others in the next epochs."""
    row, col = cell
    after, ahead = moves.after, others.shape[0]
    # the plane with so many epochs left, or the last one, which holds for all that is not kept
    last, kept, left = values.epochs[0], values.planes.shape[0], epochs_left - ahead
    later = values.planes[(left if max(0, last - kept + 1) <= left < last else last) % kept]
    for heading in range(4):
        after[heading] = later[heading, row, col]
    is_goal = row == values.goal[0] and col == values.goal[1]
    if is_goal or ahead == 0:
        return
    here = _find_moves(values, anchors_m, others[0], cell, moves)
    for direction in range(4):
        for pace in range(moves.gains.shape[0]):
            length = int(moves.lengths[pace, direction])
            r, c = row + length * ROW_STEPS[direction], col + length * COL_STEPS[direction]
            moves.brings[pace, direction] = moves.gains[pace, direction] + later[direction, r, c]
    _slip(values, here, moves)
    for heading in range(4):
        best = after[heading] - here + values.prices[2]
        for direction in range(4):
            turn = values.turns[(direction - heading) % 4]
            for pace in range(moves.gains.shape[0]):
                best = max(best, moves.slipping[pace, direction] - turn)
        after[heading] = best


@borrowing
def _slip(values: ValueArrays, here: float, moves: Moves) -> None:
    """Compute the values of moves that may slip; `here` is what an epoch in the cell costs."""
    straight, fails, aside = values.chances
    for pace in range(moves.gains.shape[0]):
        for direction in range(4):
            sides = (
                moves.brings[pace, (direction + 1) % 4] + moves.brings[pace, (direction + 3) % 4]
            )
            failed = moves.after[direction] - here - values.paces[pace, 1]
            moves.slipping[pace, direction] = (
                straight * moves.brings[pace, direction] + aside * sides + fails * failed
            )


@borrowing
def _price(
    values: ValueArrays, anchors_m: Doubles, others: Doubles, row: int, col: int
) -> tuple[float, bool]:
    """Return what an epoch in a cell costs, and whether another will cover the cell's anchor.

    The price is time, walls, and others by how near they are.
    """
    row, col = row + values.corner[0], col + values.corner[1]
    total, is_occupied = (
        values.prices[0] + values.prices[1] * float(values.nearness[row, col]),
        False,
    )
    for k in range(others.shape[0]):
        dx_m, dy_m = others[k, 0] - anchors_m[row, col, 0], others[k, 1] - anchors_m[row, col, 1]
        away_m = np.sqrt(dx_m * dx_m + dy_m * dy_m) - others[k, 2]
        total += others[k, 4] * min(1.0, max(0.0, 1.0 - away_m / others[k, 3]))
        is_occupied = is_occupied or away_m < 0.0
    return total, is_occupied


@borrowing
def best_action(brings: Doubles, heading: int) -> tuple[int, int]:
    """Return the pace and the move of the best action of (P, 5).

    Of equal ones the first pace, and the first of ahead, left, right, back and stay.
    """
    best = (0, 1 + heading)
    for pace in range(brings.shape[0]):
        for turn in (0, 1, 3, 2):
            move = 1 + (heading + turn) % 4
            if brings[pace, move] > brings[best] + TIE:
                best = (pace, move)
    return (0, 0) if brings[0, 0] > brings[best] + TIE else best


@borrowing
def follow(
    values: ValueArrays,
    anchors_m: Doubles,
    state: tuple[int, int, int],
    action: tuple[int, int],
    points_m: Doubles,
) -> int:
    """Fill in the anchors (K, 2) along an action, and then along a cheapest way from there.

    Of several ways it is the one that does not go back on the move in the same epoch, and else the
    one that stays near the straight line from the state to the goal: the coarse cells are not to be
    seen in it. Returns how many points there are.
    """
    costs, (row, col, _), (pace, move) = values.costs, state, action
    rows, cols = values.goal[0] - row, values.goal[1] - col
    direction, left, count = move - 1, 0, 0
    back, reach = (move + 1) % 4 if move > 0 else -1, int(values.paces[pace, 0])
    if move > 0:
        left = min(reach, int(values.lengths[direction, row, col]))
    while count < points_m.shape[0]:
        if left == 0:  # on along a cheapest way, a cell at a time
            left, direction, nearest = 1, -1, (0, 0)
            for k in range(4):
                r, c = row + ROW_STEPS[k], col + COL_STEPS[k]
                if values.lengths[k, row, col] == 0 or costs[r, c] >= costs[row, col]:
                    continue
                nearness = float(values.nearness[r + values.corner[0], c + values.corner[1]])
                step = (values.prices[0] + values.prices[1] * nearness) / values.paces[0, 0]
                is_cheapest = costs[r, c] + step <= (1.0 + _ROUNDING) * costs[row, col]
                away = (
                    int(k == back and count < reach),
                    abs((r - state[0]) * cols - (c - state[1]) * rows),
                )
                if is_cheapest and (direction < 0 or away < nearest):
                    direction, nearest = k, away
            if direction < 0:
                break
        row, col = row + ROW_STEPS[direction], col + COL_STEPS[direction]
        anchor_m = anchors_m[row + values.corner[0], col + values.corner[1]]
        points_m[count, 0], points_m[count, 1] = anchor_m[0], anchor_m[1]
        left, count = left - 1, count + 1
    return count


@compiled
def leave_out(
    values: ValueArrays,
    anchors_m: Doubles,
    others: Doubles,
    state: tuple[int, int, int],
    best_move: int,
    brings: Doubles,
) -> None:
    """Set to -inf, in (P, 5), the moves that a walker does not make among others.

    These are to go back from where its way leads without them, and to where its way is dearer: it
    would turn on its heel, and again once they have passed. Neither are moves that fail because
    somebody will be there: they would only make it turn. `best_move`, the best one without them, is
    left then, and as good as to stay without resting: the local planner may find a way past.
    """
    numbers = np.empty((4, values.paces.shape[0], 4))
    moves = Moves(numbers[0], numbers[1], numbers[2], numbers[3], np.empty(4))
    _find_moves(values, anchors_m, others, (state[0], state[1]), moves)
    points_m = np.empty((_WAY_CELLS, 2))
    count = follow(values, anchors_m, state, (0, 0), points_m)
    at_row, at_col = state[0] + values.corner[0], state[1] + values.corner[1]
    ahead_m = points_m[max(count - 1, 0)] - anchors_m[at_row, at_col]
    for direction in range(4):
        move, is_back = direction + 1, False
        is_open = values.lengths[direction, state[0], state[1]] > 0
        if is_open and count > 0:
            beside_m = anchors_m[at_row + ROW_STEPS[direction], at_col + COL_STEPS[direction]]
            step_m = beside_m - anchors_m[at_row, at_col]
            along_m2 = step_m[0] * ahead_m[0] + step_m[1] * ahead_m[1]
            straight_m2 = np.hypot(step_m[0], step_m[1]) * np.hypot(ahead_m[0], ahead_m[1])
            r, c = state[0] + ROW_STEPS[direction], state[1] + COL_STEPS[direction]
            is_dearer = values.costs[r, c] > values.costs[state[0], state[1]]
            is_back = is_dearer or along_m2 < _BACK * straight_m2
        for pace in range(brings.shape[0]):
            is_blocked = is_open and moves.lengths[pace, direction] == 0
            if is_blocked and move == best_move:
                brings[pace, move] = brings[0, 0] - values.prices[2]
            elif is_back or is_blocked:
                brings[pace, move] = -np.inf


@borrowing
def is_settled(values: ValueArrays, row: int, col: int, epochs_left: int, ahead: int) -> bool:
    """Tell whether the planes have the values after the epochs ahead, where these may lead to."""
    last, (computed, longest) = epochs_left - ahead, values.epochs
    if last > computed - values.planes.shape[0]:
        return last <= longest
    reach = 0
    for pace in range(values.paces.shape[0]):
        reach = max(reach, ahead * int(values.paces[pace, 0]))
    height, width = values.settled.shape
    last = min(last, 254)
    for r in range(max(0, row - reach), min(height, row + reach + 1)):
        for c in range(max(0, col - reach), min(width, col + reach + 1)):
            if values.settled[r, c] > last:
                return False
    return True
