"""Compiled decisions of those whose behaviour wants the same as before: who goes on, and how."""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.artefacts._leg_kernels import STRAIGHT
from are_ros.artefacts._step_kernels import NO_WAY, WAITS, Floats
from are_ros.artefacts.motion._state import UNHINDERED, Integers, Records
from are_ros.conventions import FOR_EVER_NS, NS_PER_S

_Mask = npt.NDArray[np.bool_]

STEADY: Final = np.dtype(
    [
        ("until", "i8"),  # from then on it is asked [ns]
        ("since", "i8"),  # it has wanted this since then [ns]
        ("patience", "f8"),  # kept from going on for longer than this [s] it is asked
        ("heeds_robot", "i8"),  # where there is a robot it is asked
        ("has_goal", "i8"),
        ("x", "f8"),
        ("y", "f8"),
        ("within", "f8"),
        ("speed", "f8"),
        ("course", "i8"),  # the number of its course
        ("others_comfort", "f8"),
        ("robot_comfort", "f8"),
        ("walls_comfort", "f8"),
        ("waits", "i8"),  # and what follows: as a mind has it
        ("is_going", "i8"),
        ("has_spot", "i8"),
        ("spot_x", "f8"),
        ("spot_y", "f8"),
        ("spot_since", "i8"),
        ("says", "i8"),
    ]
)

PLAIN, BLOCKED, GIVES_WAY, MANOEUVRES = range(4)
"""What one says that it does: what it wants; or why it does not get on."""


@compiled
def look(
    table: Records,
    slots: Integers,
    poses: Floats,
    indices: Integers,
    hindered: Records,
    roads: Integers,
    clock: tuple[int, bool, float, float],
    kept: _Mask,
    spans_s: Floats,
) -> None:
    """Tell who of K goes on without being asked, and see how long they have stayed and been kept.

    `slots` (K,) are theirs in the table, `indices` those in `poses` (N, 4), `roads` those in the
    minds of the traffic, `hindered`. `clock` is the time [ns], whether there is a robot, within
    how far [m] one lingers, and from when on [s] that counts as being kept. Fills in `kept` (K,)
    and `spans_s` (K, 2): kept from going on, lingered.
    """
    now_ns, has_robot, spot_m, lingers_s = clock
    for k in range(slots.shape[0]):
        one, mind = table[slots[k]], hindered[roads[k]]
        kept[k] = now_ns < one.until
        kept[k] &= one.heeds_robot == 0 or not has_robot
        if not kept[k]:
            continue
        x_m, y_m = poses[indices[k], 0], poses[indices[k], 1]
        is_there = np.hypot(one.spot_x - x_m, one.spot_y - y_m) <= spot_m
        if one.is_going == 0 or one.has_spot == 0 or not is_there:
            one.has_spot, one.spot_x, one.spot_y = one.is_going, x_m, y_m
            one.spot_since = now_ns
        lingered_s = (now_ns - one.spot_since) / NS_PER_S
        blocked_s = mind.blocked if mind.hindrance != UNHINDERED else 0.0
        if lingered_s > lingers_s:
            blocked_s = max(blocked_s, lingered_s)
        spans_s[k, 0], spans_s[k, 1] = blocked_s, lingered_s
        if one.has_goal != 0:
            away_m = np.hypot(one.x - x_m, one.y - y_m)
            since_s = (now_ns - one.since) / NS_PER_S
            kept[k] = away_m > one.within and min(blocked_s, since_s) <= one.patience


@compiled
def asked_by(
    table: Records,
    slots: Integers,
    indices: Integers,
    ends_ns: Integers,
    kept: _Mask,
    clock: tuple[int, float, int, int],
) -> tuple[Integers, Integers]:
    """Return who of K asks for a step, (M,), and what `route_steps` takes of each, (M, 5).

    `ends_ns` (K,) are the ends of their lives, FOR_EVER_NS where that is not known. `clock` is the
    time [ns], the decision period [s], the longest horizon in periods, and how many times somebody
    waits for others.
    """
    now_ns, period_s, horizon, patience = clock
    who, asked, count = np.empty(slots.shape[0], np.int64), np.empty((slots.shape[0], 5)), 0
    numbers = asked.astype(np.int64)
    for k in range(slots.shape[0]):
        one = table[slots[k]]
        if not kept[k] or one.has_goal == 0:
            continue
        epochs = horizon
        if ends_ns[k] != FOR_EVER_NS:
            left = np.ceil((ends_ns[k] - now_ns) / NS_PER_S / period_s)
            epochs = max(1, min(horizon, np.int64(left)))
        who[count] = k
        numbers[count, 0], numbers[count, 1], numbers[count, 2] = indices[k], one.course, epochs
        numbers[count, 3], numbers[count, 4] = one.waits < patience, 0
        count += 1
    return who[:count], numbers[:count]


@compiled
def order(
    table: Records, slots: Integers, who: Integers, found: Floats, kept: _Mask, rows: Floats
) -> None:
    """Write the orders (K, 9), as `order_record` has them, of those kept; what it means for them.

    `found` (M, FOUND) are the steps of some, `who` (M,). Without a way one is not kept.
    """
    for k in range(slots.shape[0]):
        one = table[slots[k]]
        rows[k, :4], rows[k, 4], rows[k, 5] = 0.0, 1.0, np.nan
        rows[k, 6], rows[k, 7] = one.others_comfort, one.robot_comfort
        rows[k, 8] = one.walls_comfort
    for n in range(who.shape[0]):
        k, what = who[n], found[n, 0]
        one = table[slots[k]]
        kept[k] = what != NO_WAY
        if what in (NO_WAY, WAITS):
            continue
        rows[k, 0], rows[k, 3] = 1.0, one.speed
        if what == STRAIGHT:
            rows[k, 1], rows[k, 2] = one.x, one.y
        else:
            rows[k, 1], rows[k, 2], rows[k, 4] = found[n, 2], found[n, 3], found[n, 4]


@compiled
def settle(
    table: Records,
    slots: Integers,
    hindered: Records,
    roads: Integers,
    motion: tuple[Floats, Floats, Integers],
    limits: tuple[float, float, float],
    kept: _Mask,
    spans_s: Floats,
    rows: Floats,
    says: Integers,
) -> None:
    """Note what those kept do now, and what they say, (K,): -1 where that is plain as before.

    `motion` are the poses (N, 4) and speeds (N,) of all, and the indices (K,) there. `limits` are
    the speed [m/s] from which on one gets on, and from when on one says so that is kept from going
    on, or stays within a spot [s].
    """
    poses, speeds_mps, indices = motion
    gets_on_mps, kept_s, shunts_s = limits
    for k in range(slots.shape[0]):
        says[k] = -1
        if not kept[k]:
            continue
        one, mind = table[slots[k]], hindered[roads[k]]
        one.is_going = np.int64(rows[k, 0])
        waits = one.has_goal != 0 and one.is_going == 0
        yaw_rad, speed_mps = poses[indices[k], 3], speeds_mps[indices[k]]
        velocity_mps = np.hypot(speed_mps * np.cos(yaw_rad), speed_mps * np.sin(yaw_rad))
        if waits:
            one.waits += 1
        elif velocity_mps > gets_on_mps:
            one.waits = 0
        words = PLAIN
        if one.has_goal != 0:
            is_hindered = mind.hindrance != UNHINDERED and mind.blocked > 0.0
            if is_hindered and spans_s[k, 0] >= kept_s:
                words = BLOCKED
            elif waits:
                words = GIVES_WAY
            elif spans_s[k, 1] > shunts_s:
                words = MANOEUVRES
        if words != PLAIN or one.says != PLAIN:
            says[k] = words
        one.says = words
