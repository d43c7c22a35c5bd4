"""Who stands for long, why, and who waits for whom: by places and activities over time."""

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from are_ros.builder.outputs import ArtefactState
from are_ros.experiments.verdict import LongStand, Verdict

STILL_S = 60.0
_STILL_M = 0.3
_WITHOUT_CAUSE = frozenset(
    {
        "",
        "walking",
        "driving",
        "running",
        "wandering",
        "stopping",
        "following",
        "crossing",
        "avoiding",
        "leaving",
        "on its way",
    }
)
"""Activities of those who get on: no reason to stand."""

_WAITS_FOR = re.compile(r"waiting for artefact (\d+)")


@dataclass
class _Stand:
    """A stretch of time within 0.3 m: since when, and the seconds of each activity."""

    place_m: tuple[float, float]
    since_s: float
    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    cause: str | None = None
    noted: LongStand | None = None

    def main_cause(self) -> str:
        """Return the cause of most of the time that has one; empty if that is less than half."""
        named = {what: s for what, s in self.seconds.items() if not _gets_on(what)}
        if 2.0 * sum(named.values()) < sum(self.seconds.values()):
            return ""
        return max(named, key=lambda what: (named[what], what))

    def doings(self, behaviour: str) -> str:
        """Return what it said to do, the longest first."""
        said = sorted(self.seconds.items(), key=lambda item: (-item[1], item[0]))
        return ", ".join(f"{what or behaviour} {seconds:.0f} s" for what, seconds in said)


class Patience:
    """Looks at everybody once in each sub-step, and notes in the verdict who stands too long."""

    def __init__(self, verdict: Verdict, step_s: float) -> None:
        self._verdict = verdict
        self._step_s = step_s
        self._stands: dict[int, _Stand] = {}
        self._deadlocks: set[frozenset[int]] = set()

    def see(self, t_s: float, states: Iterable[ArtefactState]) -> None:
        """Take a sub-step; who is not among the states is gone."""
        before, self._stands = self._stands, {}
        for state in states:
            pose = state.ground_pose
            here_m = (pose.x_m, pose.y_m)
            stand = before.get(state.artefact_id)
            is_free = state.behaviour == state.activity == "standing"
            is_free |= state.behaviour == "standing" and not state.activity
            if stand is None or is_free or math.dist(stand.place_m, here_m) > _STILL_M:
                stand = _Stand(here_m, t_s)
            self._stands[state.artefact_id] = stand
            stand.seconds[state.activity] += self._step_s
            self._judge(t_s, state, stand)
        self._find_deadlocks(t_s)

    def _judge(self, t_s: float, state: ArtefactState, stand: _Stand) -> None:
        """Name the cause as soon as the stand is too long, and keep the longest of each."""
        stood_s = t_s - stand.since_s
        if stood_s <= STILL_S:
            return
        verdict = self._verdict
        if stand.cause is None:
            stand.cause = stand.main_cause()
            verdict.causes[_kind(stand.cause)] += 1
            stand.noted = _noted(state, stand)
            verdict.stands.append(stand.noted)
            if not stand.cause:
                who = f"{state.label} {state.artefact_id} ({state.behaviour})"
                verdict.note("still", t_s, f"{who}: {stand.doings(state.behaviour)}")
        if stand.noted is not None:
            stand.noted.stood_s = round(stood_s, 2)
        kind = _kind(stand.cause)
        verdict.longest_s[kind] = max(verdict.longest_s.get(kind, 0.0), stood_s)

    def _find_deadlocks(self, t_s: float) -> None:
        """Note those who have stood for long, each waiting for the next of a circle."""
        awaited = {}
        for artefact_id, stand in self._stands.items():
            if stand.cause is not None and (match := _WAITS_FOR.fullmatch(stand.main_cause())):
                awaited[artefact_id] = int(match[1])
        circles = {circle for one in awaited if (circle := _circle_of(one, awaited))}
        for circle in sorted(circles - self._deadlocks, key=min):
            self._verdict.note("deadlocks", t_s, "artefacts " + ", ".join(map(str, sorted(circle))))
        self._deadlocks = circles


def _noted(state: ArtefactState, stand: _Stand) -> LongStand:
    """Return a stand as the verdict keeps it."""
    x_m, y_m = (round(coordinate, 3) for coordinate in stand.place_m)
    since_s, cause = round(stand.since_s, 2), stand.cause or "no cause"
    who = (state.artefact_id, state.label, state.behaviour)
    return LongStand(*who, since_s, 0.0, x_m, y_m, cause)


def _gets_on(activity: str) -> bool:
    """Tell whether an activity, whomever it concerns, is that of one who gets on."""
    return activity.partition(" artefact ")[0] in _WITHOUT_CAUSE


def _kind(cause: str) -> str:
    """Return the cause without the number of the artefact."""
    return re.sub(r" \d+$", "", cause) or "no cause"


def _circle_of(start: int, awaited: Mapping[int, int]) -> frozenset[int]:
    """Return the circle of waiting that one is part of; empty if it is of none."""
    way, here = [start], awaited.get(start)
    while here is not None and here not in way:
        way.append(here)
        here = awaited.get(here)
    return frozenset(way) if here == start else frozenset()
