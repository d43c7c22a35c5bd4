"""Those whose behaviour would want the same again: they go on all at once, without being asked."""

from collections.abc import Sequence
from operator import itemgetter
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts import _steady_kernels
from are_ros.artefacts._steady_kernels import BLOCKED, GIVES_WAY, MANOEUVRES, STEADY
from are_ros.artefacts.behaviours.asking import Asked, steady_of
from are_ros.artefacts.behaviours.situation import RobotView
from are_ros.artefacts.mind import (
    BLOCKED_S,
    GETS_ON_MPS,
    GIVING_WAY,
    LINGERS_S,
    MANOEUVRING,
    PATIENCE,
    SHUNTS_S,
    SPOT_M,
    Mind,
    words_of_hindrance,
)
from are_ros.artefacts.motion.traffic import Traffic
from are_ros.artefacts.navigation import Leg, Navigation
from are_ros.artefacts.onlookers import Onlookers
from are_ros.conventions import FOR_EVER_NS

_FIRST_CAPACITY: Final = 64
_LIMITS: Final = (GETS_ON_MPS, BLOCKED_S, SHUNTS_S)
_OWN_FIELDS: Final = ("waits", "is_going", "has_spot", "spot_x", "spot_y", "spot_since")
_own_of = itemgetter(*map((STEADY.names or ()).index, _OWN_FIELDS))
"""Of a row of the table, as a tuple: what a mind has, too."""


class SteadyMinds:
    """A table of those who are steady, by slot: what they want, and what became of it so far."""

    def __init__(self, navigation: Navigation) -> None:
        self._navigation = navigation
        self._table = np.zeros(_FIRST_CAPACITY, STEADY)
        self._free = list(range(_FIRST_CAPACITY))[::-1]

    def admit(self, mind: Mind) -> None:
        """Give a new mind its slot."""
        if not self._free:
            count = len(self._table)
            self._table = np.concatenate((self._table, np.zeros(count, STEADY)))
            self._free = list(range(count, 2 * count))[::-1]
        mind.slot, mind.generation = self._free.pop(), self._navigation.generation

    def dismiss(self, mind: Mind) -> None:
        """Take the slot back."""
        self._free.append(mind.slot)

    def drop(self, mind: Mind) -> None:
        """Let one be asked at its next decision; its mind goes on as the table has it."""
        if not mind.is_steady:
            return
        mind.is_steady = False
        row = self._table[mind.slot].tolist()
        waits, is_going, has_spot, x_m, y_m, since_ns = _own_of(row)
        mind.waits, mind.is_going, mind.spot_since_ns = waits, is_going != 0, since_ns
        mind.spot_m = (x_m, y_m) if has_spot else None

    def note(self, mind: Mind, leg: Leg, now_ns: int) -> None:
        """See whether one that has just decided is steady now."""
        intent, order = mind.intent, leg.order
        artefact = mind.artefact
        asked = Asked(artefact.id, artefact.row.label, now_ns)
        steady = steady_of(mind.behaviour, asked)
        if steady is None or intent is None or steady.intent is not intent:
            return
        can_go = intent.goal_m is None or leg.course >= 0
        if leg.arrived or leg.no_way or not can_go or intent.face_m is not None:
            return
        x_m, y_m = intent.goal_m or (0.0, 0.0)
        spot_x_m, spot_y_m = mind.spot_m or (0.0, 0.0)
        mind.is_steady = True
        self._table[mind.slot] = (
            min(steady.until_ns, FOR_EVER_NS),
            steady.since_ns,
            steady.patience_s,
            steady.heeds_robot,
            intent.goal_m is not None,
            x_m,
            y_m,
            intent.arrive_within_m,
            intent.speed_mps,
            leg.course,
            order.comfort_m,
            order.robot_comfort_m,
            order.wall_comfort_m,
            mind.waits,
            mind.is_going,
            mind.spot_m is not None,
            spot_x_m,
            spot_y_m,
            mind.spot_since_ns,
            # what it says may have to change at the next decision
            mind.artefact.activity not in {"", intent.activity},
        )

    def carry_on(
        self,
        due: Sequence[Mind],
        now_ns: int,
        view: Onlookers,
        traffic: Traffic,
        robot: RobotView | None,
    ) -> list[Mind]:
        """Let those go on who are steady; return those who are to be asked, in their order."""
        generation = self._navigation.generation
        for mind in due:
            if mind.generation != generation:
                self.drop(mind)  # the courses are others
                mind.generation = generation
        steady = [mind for mind in due if mind.is_steady]
        if not steady:
            return list(due)
        kept = self._carry_on(steady, now_ns, view, traffic, robot)
        for mind, is_kept in zip(steady, kept.tolist(), strict=True):
            if not is_kept:
                self.drop(mind)
        return [mind for mind in due if not mind.is_steady]

    def _carry_on(
        self,
        minds: Sequence[Mind],
        now_ns: int,
        view: Onlookers,
        traffic: Traffic,
        robot: RobotView | None,
    ) -> npt.NDArray[np.bool_]:
        """Tell who goes on, bool (K,), and let them."""
        count, table, navigation = len(minds), self._table, self._navigation
        ids = np.array([mind.artefact.id for mind in minds], np.int64)
        slots = np.array([mind.slot for mind in minds], np.int64)
        ends_ns = np.array([_end_ns(mind) for mind in minds], np.int64)
        roads, hindered = traffic.slots_of(ids), traffic.minds
        indices, (poses, speeds_mps) = view.positions_of(ids), view.motion
        kept, spans_s = np.empty(count, np.bool_), np.empty((count, 2))
        clock = (now_ns, robot is not None, SPOT_M, LINGERS_S)
        _steady_kernels.look(table, slots, poses, indices, hindered, roads, clock, kept, spans_s)
        horizon = (now_ns, navigation.period_s, navigation.horizon, PATIENCE)
        who, asked = _steady_kernels.asked_by(table, slots, indices, ends_ns, kept, horizon)
        found, _ = navigation.steps(asked, view, robot)
        rows, says = np.empty((count, 9)), np.empty(count, np.int64)
        _steady_kernels.order(table, slots, who, found, kept, rows)
        motion = (poses, speeds_mps, indices)
        _steady_kernels.settle(
            table, slots, hindered, roads, motion, _LIMITS, kept, spans_s, rows, says
        )
        for k in np.flatnonzero(says >= 0).tolist():  # orders may let what hinders be forgotten
            _say(minds[k], int(says[k]), traffic)
        traffic.give_rows(roads[kept], rows[kept])
        return kept


def _end_ns(mind: Mind) -> int:
    end_ns = mind.artefact.departure_ns
    return FOR_EVER_NS if end_ns is None else end_ns


def _say(mind: Mind, what: int, traffic: Traffic) -> None:
    """Say what one does that went on."""
    if mind.intent is None:
        return
    words = mind.intent.activity
    if what == BLOCKED:
        kind, who, _ = traffic.hindrance(mind.artefact.id)
        words = words_of_hindrance(kind, who)
    elif what == GIVES_WAY:
        words = GIVING_WAY
    elif what == MANOEUVRES:
        words = MANOEUVRING
    mind.say(words)
