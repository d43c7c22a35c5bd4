"""The traffic: everybody on a committed trajectory that ends in a stand and meets nobody's.

A trajectory is a manoeuvre of about a second and then braking. It is taken only if, sub-step by
sub-step, its boxes overlap neither closed ground nor anybody on the trajectory that he is committed
to (open boxes, exact); else the old one goes on, which was free and still is, for all the others
have kept clear of it. So nobody ever overlaps, unless something breaks in from outside: an arrival,
a displaced one, a new map, the robot. Those who are due in a sub-step plan one after the other, by
id, so each knows what the ones before it have decided.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.local_planner import patience as _orders
from are_ros.agents.local_planner import state as _state
from are_ros.agents.local_planner import sub_step as _steps
from are_ros.agents.local_planner.body import MotionCommand
from are_ros.agents.local_planner.planning import commit
from are_ros.agents.local_planner.robot import RobotMotion, robot_path
from are_ros.agents.local_planner.state import COS, NOBODY, SIN, SPEED, YAW, X, Y
from are_ros.agents.local_planner.walls import ClearanceLayers
from are_ros.agents.navigation.terrain import Terrains
from are_ros.agents.table import AgentTable
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment

# What may be in an artefact's way.


class Obstruction(Enum):
    """Nothing, a wall (or unknown ground), another artefact, the robot."""

    NONE = _state.UNOBSTRUCTED
    WALL = _state.BY_WALL
    ARTEFACT = _state.BY_ARTEFACT
    ROBOT = _state.BY_ROBOT


_UNOBSTRUCTED: Final = (Obstruction.NONE, NOBODY, 0.0)

_Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PlannerCounters:
    """How often so far a plan was made, an old one kept, a broken one found no way out."""

    plans_made: int
    plans_kept: int
    emergency_stops: int


class LocalPlanner:
    """Moves the agents of a table by their orders."""

    def __init__(self, table: AgentTable, terrains: Terrains | None = None) -> None:
        """Take the agents, and the terrains where others need them, too."""
        self._table = table
        self._floors = ClearanceLayers(terrains or Terrains())
        self._workspace = _state.workspace_of(len(table), _state.path_length(table.timing))

    def give_commands(self, rows: Sequence[int], commands: Sequence[MotionCommand]) -> None:
        """Tell the agents of some rows what to do from the next sub-step on."""
        arrays, which = self._table.arrays, np.array(rows, np.int64)
        records = np.array([_state.command_record(command) for command in commands], np.float64)
        _orders.give(
            arrays.command, arrays.mind, arrays.due, which, records.reshape(-1, 9), self._table.now
        )

    def prescribe(self, row: int, poses: _Floats) -> None:
        """Let one follow x, y, yaw float64 (K, 3), K > 0, in the next sub-steps, then stand.

        Nothing is tested; the others plan around it. It plans nothing of its own any more.
        """
        arrays, now, timing = self._table.arrays, self._table.now, self._table.timing
        place, coming = arrays.place[row], poses[: arrays.path.shape[1] - 1]
        path = np.empty((len(coming) + 1, arrays.path.shape[2]))
        path[0] = arrays.path[row, min(now - int(place["begin"]), int(place["last"]))]
        path[1:, :3] = coming
        path[:, COS], path[:, SIN] = np.cos(path[:, YAW]), np.sin(path[:, YAW])
        steps = np.diff(path[:, :2], axis=0)
        along = steps[:, 0] * path[1:, COS] + steps[:, 1] * path[1:, SIN]
        ways = np.hypot(steps[:, 0], steps[:, 1])
        path[1:, SPEED] = np.where(along < 0.0, -ways, ways) / timing.step_s
        path[-1, SPEED] = 0.0  # where it will stand if nothing follows
        commit(arrays, row, path, len(coming), now, timing)
        place["is_scripted"] = place["is_news"] = 1

    def step(
        self, index: int, environment: Environment, robot: RobotMotion | None
    ) -> tuple[_Floats, npt.NDArray[np.bool_]]:
        """Let those plan who are due, and everybody go one sub-step on.

        `index` is the number of the sub-step since the epoch: it fixes who is due. Returns x, y,
        yaw float64 (N, 3) of all at the next sub-step, and whose pose is another then, bool (N,).
        """
        table, arrays = self._table, self._table.arrays
        if len(table) > len(self._workspace.near):
            counters = self._workspace.counters
            workspace = _state.workspace_of(2 * len(table), arrays.path.shape[1])
            self._workspace = workspace._replace(counters=counters)
        is_new, floor = self._floors.of(environment, table.heights)
        if is_new:
            _steps.mark_closed(arrays, table.now, floor, self._workspace.box)
        _steps.mark_broken(arrays, table.now)
        path = robot_path(robot, table.timing.step_s)
        moved, poses = _steps.run(
            arrays, table.now, index, table.timing, floor, path, self._workspace
        )
        table.now += 1
        return poses[:, :3], moved

    @property
    def motion(self) -> _Floats:
        """Where all are now and how fast: x, y, yaw, cos, sin, speed along it, float64 (N, 6)."""
        arrays, now = self._table.arrays, self._table.now
        steps = np.minimum(now - arrays.place["begin"], arrays.place["last"])
        motion: _Floats = arrays.path[np.arange(len(steps)), steps]
        return motion

    @property
    def counters(self) -> PlannerCounters:
        """What planning has come to so far."""
        made, kept, emergencies, _ = self._workspace.counters.tolist()
        return PlannerCounters(made, kept, emergencies)

    def trajectory(self, row: int) -> _Floats:
        """Return x, y, yaw float64 (K, 3), K >= 1, at the next sub-steps; it holds the last."""
        place = self._table.arrays.place[row]
        first = min(self._table.now + 1 - int(place["begin"]), int(place["last"]))
        return np.array(self._table.arrays.path[row, first : int(place["last"]) + 1, :3])

    def is_clear(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell which boxes (M,), standing from now on, nobody meets on his trajectory."""
        packed = boxes.packed
        poses = np.zeros((len(packed), 6))
        poses[:, X], poses[:, Y], poses[:, YAW] = packed[:, 0], packed[:, 1], boxes.yaws_rad
        poses[:, COS], poses[:, SIN] = packed[:, 3], packed[:, 4]
        bodies = np.zeros(len(packed), _state.BODY)
        bodies["half_x"], bodies["half_y"] = packed[:, 5], packed[:, 6]
        bodies["radius"] = np.hypot(packed[:, 5], packed[:, 6])
        clear = np.ones(len(packed), np.bool_)
        _steps.mark_clear(clear, self._table.arrays, self._table.now, poses, bodies)
        return clear

    def obstructions(self, rows: Sequence[int]) -> list[tuple[Obstruction, int, float]]:
        """Tell what is in the way of some agents, whose id that is (or -1), and since when [s].

        The time is that in which one wanted to move and came nearer to its sub-goal by less than
        0.1 m/s; 0: nothing is in its way.
        """
        minds = self._table.arrays.mind[list(rows)]
        fields = (minds[name].tolist() for name in ("obstruction", "obstructed_by", "blocked"))
        return [
            (Obstruction(kind), who, since_s) if since_s > 0.0 else _UNOBSTRUCTED
            for kind, who, since_s in zip(*fields, strict=True)
        ]
