"""People in a crowd keep on their way: they do not turn on their heel for each other."""

import math

import numpy as np

from tests.builder.town import WALKER, Town, hall

LEG_S = 0.5
SHARPLY_RAD = 2.3
WALKERS, SECONDS = 20, 180


def test_walkers_do_not_turn_round_for_each_other() -> None:
    """Twenty in a hall of 15 m, each on its way to a place that stays the same.

    A turn is sharp if two legs of half a second, at most two seconds apart, lead so far from each
    other. There were 1.5 for each minute of walking.
    """
    town = Town.of(grid=hall(15.0, 15.0))
    ids = [
        town.place(WALKER, 2.0 + 2.5 * (k % 5), 2.0 + 3.0 * (k // 5), yaw_rad=k)
        for k in range(WALKERS)
    ]
    table, goals, places = town.lives.crowd.table, [], []
    for leg in range(round(SECONDS / LEG_S)):
        town.robot(leg * LEG_S, 0.5, 0.5)
        town.run(leg * LEG_S, (leg + 1) * LEG_S)
        states = [table.states[table.row_of(one)] for one in ids]
        goals.append([None if s is None or s.intent is None else s.intent.goal_m for s in states])
        places.append([table.poses[table.row_of(one), :2].tolist() for one in ids])
    moves = np.diff(np.array(places), axis=0)
    lengths_m, headings = np.hypot(*moves.T).T, np.arctan2(moves[..., 1], moves[..., 0])
    walked_min = (lengths_m > 0.1).sum() * LEG_S / 60.0
    assert walked_min > 30.0
    turns = 0
    for k in range(WALKERS):
        last = 0
        for leg in range(8, len(moves) - 1):
            goal_m = goals[leg + 1][k]
            is_same = all(goals[one][k] == goal_m for one in range(leg - 8, leg + 2))
            if leg - last < 5 or not is_same or goal_m is None:
                continue
            is_sharp = any(
                min(lengths_m[leg, k], lengths_m[leg - m, k]) > 0.1
                and abs(math.remainder(headings[leg, k] - headings[leg - m, k], math.tau))
                > SHARPLY_RAD
                for m in (1, 2, 3, 4)
            )
            if is_sharp and math.dist(places[leg][k], goal_m) > 1.5:
                turns, last = turns + 1, leg
    assert turns < 0.7 * walked_min
