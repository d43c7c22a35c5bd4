"""The behaviour following: an artefact follows another one, 1 m behind it."""

import math
from collections import deque
from typing import ClassVar

from are_ros.agents.behaviours.calls import name_of
from are_ros.agents.behaviours.situation import (
    ARRIVE_WITHIN_M,
    WORTH,
    Intent,
    Neighbour,
    Point,
    Situation,
    stand,
)
from are_ros.agents.behaviours.walking import Walking
from are_ros.conventions import NS_PER_S

GAP_M = 1.0
_LOOKED_FOR_WITHIN_M = 12.0
_NOTICED_WITHIN_M = 4.0
_STEP_OF_TRAIL_M = 0.3
_LONGEST_TRAIL = 100
_IS_STANDING_MPS = 0.1
_PATIENCE_S = (15.0, 40.0)
_BLOCKED_S = 8.0
_LEFT_ALONE_NS = 30 * NS_PER_S
_HURRY = 1.3
_CATCH_UP_PER_S = 0.5


class Following:
    """Follows the nearest moving artefact that is not too fast, 1 m behind; else walks.

    It stores the trail of its leader and walks along it when the leader is out of sight. It chooses
    another leader when its leader is gone, has stood longer than its patience (15 to 40 s), or
    cannot be followed. A follower follows only followers with lower ids, so there are no circles.
    """

    name: ClassVar[str] = "following"

    def __init__(self, leader_id: int | None = None) -> None:
        """Follow any artefact; with `leader_id`, only that one."""
        self._only_id = leader_id
        self._followers = {Following.name, name_of(type(self))}
        self._walk = Walking()
        self._leader_id: int | None = None
        self._left_id: int | None = None
        self._left_ns = 0
        self._trail: deque[Point] = deque(maxlen=_LONGEST_TRAIL)
        self._since_ns = 0
        self._moved_ns = 0
        self._patience_s = 0.0

    def reward(self, situation: Situation) -> float:
        """Return what following is worth: something with a leader, nothing without one near."""
        if self._has_leader(situation) or self._leader_within(_NOTICED_WITHIN_M, situation):
            return WORTH
        return -WORTH

    def reward_bounds(self, situation: Situation) -> tuple[float, float]:
        """Return bounds of the reward, without looking for a leader."""
        return WORTH if self._has_leader(situation) else -WORTH, WORTH

    def decide(self, situation: Situation) -> Intent:
        """Return the intent to follow the leader, to wait behind it, or to walk."""
        leader = self._leader(situation)
        if leader is None:
            return self._walk.decide(situation)
        self._note_trail(leader, situation)
        if situation.sees(*leader.point_m):
            return self._behind(leader, situation)
        return self._along_trail(leader, situation)

    def _has_leader(self, situation: Situation) -> bool:
        """Return whether its leader is alive."""
        return self._leader_id is not None and situation.neighbour(self._leader_id) is not None

    def _leader(self, situation: Situation) -> Neighbour | None:
        """Return the leader, a new one if necessary, None if there is none."""
        if self._only_id is not None:
            return self._fixed_leader(self._only_id, situation)
        leader = None
        if self._leader_id is not None:
            leader = situation.neighbour(self._leader_id)
            if leader is None or self._gives_up(situation):
                self._left_id, self._left_ns = self._leader_id, situation.now_ns
                self._leader_id = leader = None
        if leader is None:
            leader = self._leader_within(_LOOKED_FOR_WITHIN_M, situation)
            if leader is not None:
                self._begin(leader, situation)
        return leader

    def _fixed_leader(self, leader_id: int, situation: Situation) -> Neighbour | None:
        """Return the leader given at construction, None if it is not alive."""
        leader = situation.neighbour(leader_id)
        if leader is not None and self._leader_id is None:
            self._begin(leader, situation)
        return leader

    def _leader_within(self, radius_m: float, situation: Situation) -> Neighbour | None:
        """Return the nearest artefact within a radius that may lead, None if none may."""
        return situation.nearest(radius_m, lambda one: self._may_lead(one, situation))

    def _may_lead(self, neighbour: Neighbour, situation: Situation) -> bool:
        is_free = neighbour.behaviour not in self._followers or neighbour.id < situation.me.id
        moves = _IS_STANDING_MPS < neighbour.speed_mps <= _fastest_mps(situation)
        is_left = (
            neighbour.id == self._left_id and situation.now_ns < self._left_ns + _LEFT_ALONE_NS
        )
        return is_free and moves and not is_left and situation.sees(*neighbour.point_m)

    def _begin(self, leader: Neighbour, situation: Situation) -> None:
        self._leader_id = leader.id
        self._trail.clear()
        self._since_ns = self._moved_ns = situation.now_ns
        self._patience_s = situation.drawn_between(*_PATIENCE_S)

    def _gives_up(self, situation: Situation) -> bool:
        followed_s = (situation.now_ns - self._since_ns) / NS_PER_S
        stood_s = (situation.now_ns - self._moved_ns) / NS_PER_S
        # The obstruction may be older than the following.
        is_stuck = min(situation.blocked_s, followed_s) > _BLOCKED_S
        cannot = situation.no_way and followed_s > 0.0
        return stood_s > self._patience_s or is_stuck or cannot

    def _note_trail(self, leader: Neighbour, situation: Situation) -> None:
        """Store the leader's position, one point every 0.3 m or more."""
        if leader.speed_mps > _IS_STANDING_MPS:
            self._moved_ns = situation.now_ns
        trail = self._trail
        if not trail or math.dist(trail[-1], leader.point_m) >= _STEP_OF_TRAIL_M:
            trail.append(leader.point_m)

    def _behind(self, leader: Neighbour, situation: Situation) -> Intent:
        """Go to the point of the trail that is one gap behind the leader."""
        keep_m = GAP_M + leader.radius_m + situation.me.radius_m
        goal_m = self._point_behind(leader, keep_m, situation)
        apart_m = situation.distance_m(leader.point_m)
        if apart_m <= keep_m and not _is_in_the_way(leader, situation):
            return stand(_activity(leader, is_there=True), leader.point_m)
        if not situation.sees(*goal_m):
            goal_m = leader.point_m
        speed_mps = self._speed_mps(leader, apart_m - keep_m, situation)
        is_there = situation.distance_m(goal_m) <= ARRIVE_WITHIN_M
        return Intent(
            goal_m,
            speed_mps,
            ARRIVE_WITHIN_M,
            leader.point_m,
            _activity(leader, is_there=is_there),
            is_moving_goal=True,
        )

    def _point_behind(self, leader: Neighbour, keep_m: float, situation: Situation) -> Point:
        """Return the point `keep_m` behind the leader, on its trail.

        Without a trail of that length it is behind its motion. Of one that stands it is on this
        side of it: it may turn on the spot, and would lead its followers round it.
        """
        here_m = leader.point_m
        far = next((at for at in reversed(self._trail) if math.dist(at, here_m) >= keep_m), None)
        if far is None and leader.speed_mps > _IS_STANDING_MPS:
            far = leader.x_m - leader.vx_mps, leader.y_m - leader.vy_mps
        return _on_line(here_m, far or situation.me.point_m, keep_m)

    def _along_trail(self, leader: Neighbour, situation: Situation) -> Intent:
        """Go to the newest visible point of the trail, else plan a way to the oldest."""
        trail = self._trail
        newest = next((k for k in range(len(trail) - 1, -1, -1) if situation.sees(*trail[k])), 0)
        for _ in range(newest):
            trail.popleft()
        while len(trail) > 1 and situation.distance_m(trail[0]) <= ARRIVE_WITHIN_M:
            trail.popleft()  # reached already; the artefact would stop there
        speed_mps = self._speed_mps(leader, situation.distance_m(leader.point_m), situation)
        is_seen = situation.sees(*trail[0])
        return Intent(trail[0], speed_mps, activity=_activity(leader), is_moving_goal=is_seen)

    def _speed_mps(self, leader: Neighbour, behind_m: float, situation: Situation) -> float:
        """Return the leader's speed, plus some to catch up."""
        wanted_mps = leader.speed_mps + _CATCH_UP_PER_S * behind_m
        least_mps = 0.3 * situation.row.motion.speed_mps
        return min(max(wanted_mps, least_mps), _fastest_mps(situation))


def _fastest_mps(situation: Situation) -> float:
    """Return the speed of a follower that catches up."""
    motion = situation.row.motion
    return min(_HURRY * motion.speed_mps, motion.top_speed_mps)


def _activity(leader: Neighbour, *, is_there: bool = False) -> str:
    """Return the activity, which names the leader."""
    return f"{'waiting behind' if is_there else 'following'} artefact {leader.id}"


def _is_in_the_way(leader: Neighbour, situation: Situation) -> bool:
    """Return whether the leader comes towards the follower."""
    dx_m, dy_m = situation.me.x_m - leader.x_m, situation.me.y_m - leader.y_m
    along = dx_m * leader.vx_mps + dy_m * leader.vy_mps
    return along > 0.7 * math.hypot(dx_m, dy_m) * leader.speed_mps > 0.0


def _on_line(start_m: Point, towards_m: Point, length_m: float) -> Point:
    """Return the point at `length_m` from the start towards another point."""
    share = length_m / math.dist(start_m, towards_m)
    return (
        start_m[0] + share * (towards_m[0] - start_m[0]),
        start_m[1] + share * (towards_m[1] - start_m[1]),
    )
