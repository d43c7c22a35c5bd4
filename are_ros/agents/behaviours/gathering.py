"""The behaviour gathering: artefacts meet at a destination, stand in a ring, and part again."""

import math
from collections import Counter
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.situation import WORTH, Intent, Point, Situation, stand
from are_ros.agents.behaviours.walking import Trip, any_destination, arrival_m
from are_ros.conventions import NS_PER_S, seconds_to_ns

_MET_WITHIN_M = 25.0
_NEAR_M = 3.0
_RING_M = 0.9
_GAP_M = 0.15
_SLOTS = 12
_LARGEST_GROUP = 7
_TALK_S = (15.0, 40.0)
_ALONE_S = (8.0, 20.0)
_BLOCKED_S = 4.0
_DRIFT_M = 0.6
_LONGEST_NS = 15 * NS_PER_S
_HOSTING = _WAITING, _TALKING = "waiting", "talking"


class Gathering:
    """Walks to a meeting, stands there in a ring facing the middle, and moves on.

    The members of a meeting share no plan. If others wait or talk within 25 m and are fewer than
    seven, the artefact joins them at the destination nearest to them. Else it draws a destination,
    and waits there for 8 to 20 s. It stays with others for 15 to 40 s, walks to another
    destination, and begins anew.
    """

    name: ClassVar[str] = "gathering"

    def __init__(self) -> None:
        self._trip = Trip(self._choose)
        self._slot_m: Point | None = None
        self._until_ns: int | None = None
        self._came_ns = 0
        self._is_alone = True
        self._is_parting = False

    def reward(self, situation: Situation) -> float:
        """Return what gathering is worth: most in company, something if a meeting is near."""
        least, greatest = self.reward_bounds(situation)
        if least == greatest:
            return least
        hosts = _hosts_by_place(situation)
        has_room = _with_room(hosts, self._trip.shut(situation)) is not None if hosts else False
        return greatest if has_room else least

    def reward_bounds(self, situation: Situation) -> tuple[float, float]:
        """Return bounds of the reward, without looking for meetings."""
        if self._until_ns is not None and situation.now_ns < self._until_ns:
            reward = WORTH if self._is_alone else 2.0 * WORTH
            return reward, reward
        return 0.0, 1.5 * WORTH

    def decide(self, situation: Situation) -> Intent:
        """Return the intent to go to a meeting, to stand in its ring, or to part."""
        if self._until_ns is not None:
            self._update_company(situation)
        if self._until_ns is None:
            return self._on_the_way(situation)
        return self._in_ring(situation)

    def _on_the_way(self, situation: Situation) -> Intent:
        """Walk to the meeting, or away from it."""
        if not self._is_parting:
            self._join(situation)
        elif self._trip.is_reached(situation):
            self._is_parting = False
        middle_m = self._trip.goal(situation)
        if middle_m is None:
            return stand("nowhere to go")
        if not self._is_parting and situation.distance_m(middle_m) < _NEAR_M:
            return self._to_ring(middle_m, situation)
        self._slot_m = None
        return self._walk_to(middle_m, situation)

    def _choose(self, situation: Situation, is_shut: npt.NDArray[np.bool_]) -> int | None:
        """Return the destination of a meeting, else draw one."""
        hosts = Counter() if self._is_parting else _hosts_by_place(situation)
        hosted = _with_room(hosts, is_shut)
        return any_destination(situation, is_shut) if hosted is None else hosted

    def _join(self, situation: Situation) -> None:
        """Change to a meeting that exists, if there is none at the present destination."""
        goal_m = self._trip.goal_m
        if goal_m is None:
            return
        hosts = _hosts_by_place(situation)
        if hosts and all(_place(situation, index) != goal_m for index in hosts):
            index = _with_room(hosts, self._trip.shut(situation))
            if index is not None:
                self._trip.change_to(index, situation)
                self._slot_m = None

    def _to_ring(self, middle_m: Point, situation: Situation) -> Intent:
        """Go to a free place in the ring; give up the meeting if none is free."""
        if situation.has_reached(self._slot_m):
            self._settle(situation)
            return self._in_ring(situation)
        is_stuck = situation.no_way or situation.blocked_s > _BLOCKED_S
        is_stuck &= situation.wanted(self._slot_m)
        if self._slot_m is None:
            self._came_ns = situation.now_ns
        if self._slot_m is None or is_stuck or not _is_free(self._slot_m, situation):
            self._slot_m = _slot(middle_m, situation, self._slot_m if is_stuck else None)
        is_late = situation.now_ns - self._came_ns > _LONGEST_NS
        if self._slot_m is None and _is_vacant(middle_m, situation):
            return self._to_middle(middle_m, situation)
        if self._slot_m is None or is_late:
            self._slot_m = None
            self._trip.give_up()
            return stand("looking round")
        return self._to_slot(self._slot_m, "walking", situation)

    def _to_middle(self, middle_m: Point, situation: Situation) -> Intent:
        """Walk to the middle while no place in the ring is visible; stand there if none is."""
        if situation.has_reached(middle_m):
            self._slot_m = situation.point_m
            self._settle(situation)
            return self._in_ring(situation)
        return self._walk_to(middle_m, situation)

    def _settle(self, situation: Situation) -> None:
        self._is_alone = True
        self._wait(_ALONE_S, situation)
        self._update_company(situation)

    def _wait(self, span_s: tuple[float, float], situation: Situation) -> None:
        self._until_ns = situation.now_ns + seconds_to_ns(situation.drawn_between(*span_s))

    def _update_company(self, situation: Situation) -> None:
        """Count the others, and leave when the time is up or the others have left."""
        others = situation.neighbours_within(_NEAR_M, self.name, _HOSTING)
        is_first_met = self._is_alone and bool(others)
        if is_first_met:
            self._is_alone = False
            self._wait(_TALK_S, situation)
        is_left = not self._is_alone and not others
        if is_left or self._until_ns is None or situation.now_ns >= self._until_ns:
            self._until_ns = self._slot_m = None
            self._is_parting = not self._is_alone
            self._trip.give_up()

    def _in_ring(self, situation: Situation) -> Intent:
        """Stand facing the middle; return to the place in the ring after a displacement."""
        activity = _WAITING if self._is_alone else _TALKING
        if self._slot_m is not None and situation.distance_m(self._slot_m) > _DRIFT_M:
            return self._to_slot(self._slot_m, activity, situation)
        return stand(activity, self._trip.goal_m)

    @staticmethod
    def _walk_to(middle_m: Point, situation: Situation) -> Intent:
        speed_mps = situation.row.motion.speed_mps
        return Intent(middle_m, speed_mps, arrival_m(situation), activity="walking")

    @staticmethod
    def _to_slot(slot_m: Point, activity: str, situation: Situation) -> Intent:
        speed_mps = situation.row.motion.speed_mps
        return Intent(slot_m, speed_mps, activity=activity, is_moving_goal=True)


def _hosts_by_place(situation: Situation) -> Counter[int]:
    """Count the artefacts in meetings by their nearest destination, the nearest one first."""
    return Counter(situation.places_within(_MET_WITHIN_M, Gathering.name, _HOSTING))


def _place(situation: Situation, index: int) -> Point:
    x_m, y_m = situation.places.destinations_m[index].tolist()
    return x_m, y_m


def _with_room(hosts: Counter[int], is_shut: npt.NDArray[np.bool_]) -> int | None:
    """Return the destination of the nearest meeting with room, None if there is none."""
    return next((p for p, n in hosts.items() if n < _LARGEST_GROUP and not is_shut[p]), None)


def _slot(middle_m: Point, situation: Situation, but_m: Point | None) -> Point | None:
    """Return the nearest free place in the ring except `but_m`, None if there is none."""
    radius_m = max(_RING_M, 2.0 * situation.me.radius_m)
    bearing_rad = math.atan2(situation.me.y_m - middle_m[1], situation.me.x_m - middle_m[0])
    for number in range(_SLOTS):
        steps = (number + 1) // 2 * (1 if number % 2 else -1)
        angle_rad = bearing_rad + steps * math.tau / _SLOTS
        slot_m = (
            middle_m[0] + radius_m * math.cos(angle_rad),
            middle_m[1] + radius_m * math.sin(angle_rad),
        )
        is_other = but_m is None or math.dist(slot_m, but_m) > _GAP_M
        if is_other and situation.sees(*slot_m) and _is_free(slot_m, situation):
            return slot_m
    return None


def _is_vacant(middle_m: Point, situation: Situation) -> bool:
    """Return whether there is no meeting about a point."""
    within_m = situation.distance_m(middle_m) + _NEAR_M
    hosts = situation.neighbours_within(within_m, Gathering.name, _HOSTING)
    return all(math.dist(host.point_m, middle_m) > _NEAR_M for host in hosts)


def _is_free(slot_m: Point, situation: Situation) -> bool:
    """Return whether no artefact stands at a place in the ring."""
    own_m = situation.me.radius_m + _GAP_M
    near = situation.neighbours_within(situation.distance_m(slot_m) + _NEAR_M)
    return all(math.dist(other.point_m, slot_m) >= other.radius_m + own_m for other in near)
