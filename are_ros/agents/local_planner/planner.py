"""The local planner as Python calls it; the package says how it works."""

from collections.abc import Sequence
from enum import Enum
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.local_planner import deadlock as _deadlock
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


class Obstruction(Enum):
    """What obstructs an agent: nothing, a wall (or unknown ground), another artefact, the robot."""

    NONE = _state.UNOBSTRUCTED
    WALL = _state.BY_WALL
    ARTEFACT = _state.BY_ARTEFACT
    ROBOT = _state.BY_ROBOT


_UNOBSTRUCTED: Final = (Obstruction.NONE, NOBODY, 0.0)

_Floats = npt.NDArray[np.float64]


class LocalPlanner:
    """Moves the agents of a table by their commands."""

    def __init__(self, table: AgentTable, terrains: Terrains | None = None) -> None:
        """Take the agents, and the terrains if others share them."""
        self._table = table
        self._floors = ClearanceLayers(terrains or Terrains())
        self._workspace = _state.workspace_of(len(table), _state.path_length(table.timing))

    def give_commands(self, rows: Sequence[int], commands: Sequence[MotionCommand]) -> None:
        """Set the commands of the agents of some rows, from the next sub-step on."""
        arrays, which = self._table.arrays, np.array(rows, np.int64)
        records = np.array([_state.command_record(command) for command in commands], np.float64)
        _deadlock.write_commands(
            arrays.command,
            arrays.memory,
            arrays.due,
            which,
            records.reshape(-1, 9),
            self._table.now,
        )

    def prescribe(self, row: int, poses: _Floats) -> None:
        """Make an agent follow x, y, yaw float64 (K, 3), K > 0, in the next sub-steps, then stand.

        Nothing is tested; the others plan around it. It does not plan any more.
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
        path[-1, SPEED] = 0.0  # it stands there if nothing follows
        commit(arrays, row, path, len(coming), now, timing)
        place["is_scripted"] = place["is_news"] = 1

    def step(
        self, index: int, environment: Environment, robot: RobotMotion | None
    ) -> tuple[_Floats, npt.NDArray[np.bool_]]:
        """Plan for the agents that are due, and move all by one sub-step.

        `index` is the number of the sub-step since the epoch. Returns x, y, yaw float64 (N, 3) of
        all at the next sub-step, and which poses have changed, bool (N,).
        """
        table, arrays = self._table, self._table.arrays
        if len(table) > len(self._workspace.near):
            counters = self._workspace.counters
            workspace = _state.workspace_of(2 * len(table), arrays.path.shape[1])
            self._workspace = workspace._replace(counters=counters)
        if self._all_stand():
            table.now += 1
            arrays.place["is_news"] = 0
            poses = arrays.path[np.arange(len(table)), arrays.place["last"]]
            return poses[:, :3], np.zeros(len(table), np.bool_)
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

    def _all_stand(self) -> bool:
        """Return whether no agent moves, has a sub-goal or is pushed: then there is no planning.

        So a replay without motion compiles none of the planner's kernels.
        """
        arrays, now = self._table.arrays, self._table.now
        place = arrays.place
        is_moving = now - place["begin"] < place["last"]
        is_active = is_moving | (arrays.command["has_goal"] != 0)
        is_active |= arrays.memory["pushed_until"] > now
        return not is_active.any()

    @property
    def motion(self) -> _Floats:
        """Poses and speeds of all now: x, y, yaw, cos, sin, speed along yaw, float64 (N, 6)."""
        arrays, now = self._table.arrays, self._table.now
        steps = np.minimum(now - arrays.place["begin"], arrays.place["last"])
        motion: _Floats = arrays.path[np.arange(len(steps)), steps]
        return motion

    def trajectory(self, row: int) -> _Floats:
        """Return x, y, yaw float64 (K, 3), K >= 1, at the next sub-steps; the last pose is held."""
        place = self._table.arrays.place[row]
        first = min(self._table.now + 1 - int(place["begin"]), int(place["last"]))
        return np.array(self._table.arrays.path[row, first : int(place["last"]) + 1, :3])

    def is_clear(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell which boxes (M,), standing from now on, are met by no trajectory."""
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
        """Return what obstructs some agents, the id of the artefact (or -1), and for how long [s].

        The time counts while an agent wants to move and comes nearer to its sub-goal by less than
        0.1 m/s; 0: nothing obstructs it.
        """
        memories = self._table.arrays.memory[list(rows)]
        fields = (memories[name].tolist() for name in ("obstruction", "obstructed_by", "blocked"))
        return [
            (Obstruction(kind), who, since_s) if since_s > 0.0 else _UNOBSTRUCTED
            for kind, who, since_s in zip(*fields, strict=True)
        ]
