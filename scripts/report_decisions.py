"""Measure how the artefacts' decisions are carried out, and what changes them.

Run as `python scripts/report_decisions.py --map FILE.yaml [--minutes M] [--set NAME:=VALUE ...]`.
Artefacts live beside a robot that drives about, as in `are soak`. Reported are, of the decisions
with a choice of moves:

- executed: at the next decision the artefact is where its move can lead to, or has turned towards
  it. That is a cell on the way that the move begins, or on the straight line to the sub-goal, to
  which this way is drawn tight, or beside one of them, and nearer to its points; its own cell if it
  was to stay, or the move failed. Else whether its activity or the local planner names what
  hindered it;
- the horizon changed the action: the best action with what is left of the life is another than
  the best one with the longest horizon;

and, of all decisions, in how many the behaviour changed; the planner is drawn anew with it. With
`--set population.leave:=by_exit` also how many departures no camera saw.
"""

import argparse
import math
import sys
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from are_ros.agents.behaviours.situation import Neighbour, RobotView
from are_ros.agents.events import EventKind
from are_ros.agents.local_planner.planner import Obstruction
from are_ros.agents.navigation.navigation import (
    NavigationRequest,
    NavigationResult,
    Prospect,
    Prospects,
)
from are_ros.agents.snapshot import AgentSnapshot
from are_ros.builder.assembly import catalogue_of
from are_ros.errors import AreError
from are_ros.lab.soak import SoakRun
from are_ros.population.artefact import GroundPose, boxes_of
from are_ros.population.catalogue import CatalogueRow
from are_ros.replay.command import effective_parameters
from are_ros.world.map_io import read_map_file

_TURN_RAD = math.radians(20.0)
HINDERED = ("waiting for", "blocked by", "giving way", "manoeuvring", "no way")


Polyline = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


class Pending(NamedTuple):
    """A decision whose outcome the next one shows."""

    at_m: tuple[float, float]
    yaw_rad: float
    way_m: Polyline
    """From there through the cells of the move to the sub-goal."""
    reach_m: float
    stays: bool


class Report:
    """Counts over all decisions of a run."""

    def __init__(self, run: SoakRun) -> None:
        self.counts: Counter[str] = Counter()
        self._run = run
        self._pending: dict[int, Pending] = {}
        crowd = run.builder.lives.crowd
        self._crowd = crowd
        crowd.decisions.report = self._decided
        settings = run.builder.parameters.behaviour
        self._cell_m, self._period_s = settings.cell_size, settings.decision_period

    def _decided(
        self,
        request: NavigationRequest,
        prospect: Prospect,
        result: NavigationResult,
        view: AgentSnapshot,
        robot: RobotView | None,
    ) -> None:
        me, crowd = request.me, self._crowd
        self._judge(request)
        self.counts["decisions"] += 1
        if prospect.kind is not Prospects.CHOOSES:
            return
        self.counts["choices"] += 1
        unending = request._replace(left_s=None)
        longest = crowd.navigation.prospects([unending], view, robot)[0]
        if longest.kind is Prospects.CHOOSES and longest.best != prospect.best:
            self.counts["horizon"] += 1
        subgoal_m = result.command.subgoal_m
        reach_m = max(request.speeds_mps) * self._period_s
        way_m = np.vstack((me.point_m, result.way_m, *([] if subgoal_m is None else [subgoal_m])))
        self._pending[me.id] = Pending(me.point_m, me.yaw_rad, way_m, reach_m, subgoal_m is None)

    def shares(self, changed: int, gone: Counter[str]) -> list[tuple[str, float, int]]:
        """Return what is reported: its name, its share, and of how many."""
        counts, judged = self.counts, self.counts["judged"]
        names = ("executed", "executed: turned first", "hindered, and named", "elsewhere", "stood")
        rows = [(name, counts[name], judged) for name in names]
        rows += [
            ("the horizon changed the action", counts["horizon"], counts["choices"]),
            ("the behaviour changed", changed, counts["decisions"]),
        ]
        rows += [(f"departures {name}", count, gone.total()) for name, count in gone.items()]
        return [(name, count / max(1, total), total) for name, count, total in rows]

    def _judge(self, request: NavigationRequest) -> None:
        me, last = request.me, self._pending.pop(request.me.id, None)
        if last is None:
            return
        self.counts["judged"] += 1
        if self._is_executed(last, me.point_m):
            self.counts["executed"] += 1
        elif not last.stays and _turned_rad(last, me) > _TURN_RAD:
            self.counts["executed: turned first"] += 1
        elif me.activity.startswith(HINDERED) or self._is_obstructed(me.id):
            self.counts["hindered, and named"] += 1
        elif math.dist(last.at_m, me.point_m) > 0.1 * last.reach_m:
            self.counts["elsewhere"] += 1
        else:
            self.counts["stood"] += 1

    def _is_obstructed(self, artefact_id: int) -> bool:
        """Return whether the local planner names what is in the way."""
        row = self._crowd.table.row_of(artefact_id)
        ((kind, _, since_s),) = self._crowd.planner.obstructions([row])
        return kind is not Obstruction.NONE and since_s > 0.0

    def _is_executed(self, last: Pending, now_m: tuple[float, float]) -> bool:
        if last.stays:
            return math.dist(last.at_m, now_m) <= self._cell_m + 0.5 * last.reach_m
        beside_m = math.sqrt(2.0) * self._cell_m
        return any(
            _from_segments(way_m, now_m) <= beside_m and _progress(way_m, now_m) > 0.0
            for way_m in (last.way_m, last.way_m[[0, -1]])
        )


def _turned_rad(last: Pending, me: Neighbour) -> float:
    """Return by how much an artefact has turned towards where its way leads."""
    x_m, y_m = last.way_m[-1]
    bearing_rad = math.atan2(y_m - last.at_m[1], x_m - last.at_m[0])
    before = abs(math.remainder(bearing_rad - last.yaw_rad, math.tau))
    return before - abs(math.remainder(bearing_rad - me.yaw_rad, math.tau))


def _from_segments(way_m: Polyline, point_m: tuple[float, float]) -> float:
    starts, steps = way_m[:-1], np.diff(way_m, axis=0)
    squares = np.maximum((steps**2).sum(axis=1), 1e-12)
    shares = np.clip(((np.array(point_m) - starts) * steps).sum(axis=1) / squares, 0.0, 1.0)
    return float(np.hypot(*(starts + shares[:, None] * steps - np.array(point_m)).T).min())


def _progress(way_m: Polyline, now_m: tuple[float, float]) -> float:
    """Return how far [m] an artefact has got towards one of the next points of its way."""
    ahead_m = way_m[1:6]
    before = np.hypot(*(ahead_m - way_m[0]).T)
    after = np.hypot(*(ahead_m - np.array(now_m)).T)
    return float((before - after).max()) if len(ahead_m) else 0.0


def main() -> None:
    """Run, and print the report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--map", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--set", action="append", default=[], metavar="NAME:=VALUE")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    parameters = effective_parameters((), tuple(arguments.set), arguments.seed)
    grid = read_map_file(arguments.map, parameters.frames.map)
    run = SoakRun(grid, parameters, catalogue_of(parameters))
    report, changes, gone = Report(run), Counter[str](), Counter[str]()
    last = dict[int, tuple[CatalogueRow, GroundPose]]()
    while run.judge.verdict.artefact_s < 60.0 * arguments.minutes:
        tick, lives = run.step(), run.builder.lives
        for event in tick.events:
            changes[EventKind(event.kind).name] += 1
            if event.kind is EventKind.DEPARTED and event.artefact_id in last:
                row, pose = last[event.artefact_id]
                is_hidden = lives.is_hidden(boxes_of([row], [pose])).all()
                gone["out of view" if is_hidden else "in view"] += 1
        scene = tick.scene
        last = {
            one.id: (one.row, pose)
            for one, pose in zip(scene.artefacts, scene.ground_poses, strict=True)
        }
    print(f"{arguments.map.stem}: {run.judge.verdict.artefact_s / 60.0:.0f} artefact-minutes")
    for name, share, total in report.shares(changes["CHANGED"], gone):
        print(f"  {name:32}{100.0 * share:7.2f} % of {total}")


if __name__ == "__main__":
    try:
        main()
    except AreError as cause:
        sys.exit(str(cause))
