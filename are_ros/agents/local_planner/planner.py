"""The local planner as Python calls it; the package says how it works."""

from collections.abc import Sequence
from enum import Enum
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, owning
from are_ros.agents.body import PLANNERS, MotionCommand
from are_ros.agents.local_planner import deadlock as _deadlock
from are_ros.agents.local_planner import state as _state
from are_ros.agents.local_planner.deadlock import make_way, note_progress
from are_ros.agents.local_planner.gaps import fill, gap_between, separation
from are_ros.agents.local_planner.planning import commit, plan, reach_of
from are_ros.agents.local_planner.robot import RobotMotion, robot_cost, robot_path
from are_ros.agents.local_planner.state import (
    COS,
    NEVER,
    NOBODY,
    SIN,
    SPEED,
    YAW,
    AgentArrays,
    ClearanceLayer,
    PlannerTiming,
    Records,
    RobotPath,
    Workspace,
    X,
    Y,
)
from are_ros.agents.local_planner.user_planners import UserPlanners
from are_ros.agents.local_planner.walls import ClearanceLayers, wall_conflict, wall_gap_wanted
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
_Mask = npt.NDArray[np.bool_]


class LocalPlanner:
    """Moves the agents of a table by their commands."""

    def __init__(self, table: AgentTable, terrains: Terrains | None = None) -> None:
        """Take the agents, and the terrains if others share them."""
        self._table = table
        self._floors = ClearanceLayers(terrains or Terrains())
        self._workspace = _state.workspace_of(len(table), _state.path_length(table.timing))
        self.user_planners = UserPlanners(table)

    def give_commands(self, rows: Sequence[int], commands: Sequence[MotionCommand]) -> None:
        """Set the commands of the agents of some rows, from the next sub-step on."""
        for row, command in zip(rows, commands, strict=True):
            if command.planner not in PLANNERS:
                self.user_planners.use(row, command.planner)
        arrays, which = self._table.arrays, np.array(rows, np.int64)
        records = np.array([_state.command_record(command) for command in commands], np.float64)
        _deadlock.write_commands(
            arrays.command,
            arrays.memory,
            arrays.due,
            which,
            records.reshape(-1, len(_state.STAND_ROW)),
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
    ) -> tuple[_Floats, _Mask]:
        """Plan for the agents that are due, and move all by one sub-step.

        `index` is the number of the sub-step since the epoch. Returns x, y, yaw float64 (N, 3) of
        all at the next sub-step, and which poses have changed, bool (N,).
        """
        table, arrays = self._table, self._table.arrays
        if len(table) > len(self._workspace.near):
            counters = self._workspace.counters
            workspace = _state.workspace_of(2 * len(table), arrays.path.shape[1])
            self._workspace = workspace._replace(counters=counters)
        if self._all_stand(robot):
            table.now += 1
            arrays.place["is_news"] = 0
            poses = arrays.path[np.arange(len(table)), arrays.place["last"]]
            return poses[:, :3], np.zeros(len(table), np.bool_)
        is_new, floor = self._floors.of(environment, table.heights)
        if is_new:
            mark_closed(arrays, table.now, floor, self._workspace.box)
        mark_broken(arrays, table.now)
        self.user_planners.ask(self._workspace.wishes, index, environment.grid, floor, robot)
        path = robot_path(robot, table.timing.step_s)
        moved, poses = run(arrays, table.now, index, table.timing, floor, path, self._workspace)
        table.now += 1
        return poses[:, :3], moved

    def _all_stand(self, robot: RobotMotion | None) -> bool:
        """Return whether none moves, has a sub-goal, turns, is pushed, or may yield to the robot.

        Then there is no planning, and a replay without motion compiles none of its kernels.
        """
        arrays, now = self._table.arrays, self._table.now
        place = arrays.place
        is_moving = now - place["begin"] < place["last"]
        is_active = is_moving | (arrays.command["has_goal"] != 0)
        is_active |= ~np.isnan(arrays.command["face"])
        is_active |= arrays.memory["pushed_until"] > now
        if robot is not None and robot.is_moving:
            is_active |= arrays.body["speed"] > 0.0
        return not is_active.any()

    @property
    def motion(self) -> _Floats:
        """Poses and speeds of all now; see `AgentTable.motion`."""
        return self._table.motion

    def trajectory(self, row: int) -> _Floats:
        """Return x, y, yaw float64 (K, 3), K >= 1, at the next sub-steps; the last pose is held."""
        place = self._table.arrays.place[row]
        first = min(self._table.now + 1 - int(place["begin"]), int(place["last"]))
        return np.array(self._table.arrays.path[row, first : int(place["last"]) + 1, :3])

    def is_clear(self, boxes: OrientedBoxes) -> _Mask:
        """Tell which boxes (M,), standing from now on, meet no trajectory; in the map frame."""
        packed = boxes.packed
        poses = np.zeros((len(packed), 6))
        poses[:, X], poses[:, Y], poses[:, YAW] = packed[:, 0], packed[:, 1], boxes.yaws_rad
        poses[:, COS], poses[:, SIN] = packed[:, 3], packed[:, 4]
        bodies = np.zeros(len(packed), _state.BODY)
        bodies["half_x"], bodies["half_y"] = packed[:, 5], packed[:, 6]
        bodies["radius"] = np.hypot(packed[:, 5], packed[:, 6])
        clear = np.ones(len(packed), np.bool_)
        mark_clear(clear, self._table.arrays, self._table.now, poses, bodies)
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

    def are_manoeuvring(self, rows: Sequence[int]) -> list[bool]:
        """Return whether agents drive a leg of a manoeuvre, as to turn round between walls."""
        legs: list[int] = self._table.arrays.memory["leg"][list(rows)].tolist()
        return [leg != 0 for leg in legs]


# One sub-step of all agents: those that are due plan, one after the other, and all move on.


_RANKS_LAST_SECONDS = 8


@borrowing
def _mark_due(
    due: _Mask,
    squares: _Floats,
    agents: AgentArrays,
    now: int,
    robot: RobotPath,
    timing: PlannerTiming,
    box: _Floats,
) -> int:
    """Write to `due` (N,) which agents plan in this sub-step; return how many they are.

    And to `squares` (N, 3), x, y, half side, a square that holds the agent on its trajectory and on
    each that it may commit to. Agents that stand may be pushed by the robot.
    """
    count, has_robot = 0, robot.outlines.shape[0] > 0
    for i in range(due.shape[0]):
        place, body = agents.place[i], agents.body[i]
        squares[i, 0], squares[i, 1], squares[i, 2] = place.x, place.y, place.reach
        due[i], moves = False, now - place.begin < place.last
        if place.is_scripted or not (has_robot or now >= agents.due[i]):
            continue
        if has_robot and not moves:
            make_way(agents, i, agents.path[i, place.last], now, robot, timing.second)
        if now >= agents.due[i]:
            command, is_pushed = agents.command[i], now < agents.memory[i].pushed_until
            due[i] = moves or command.has_goal == 1 or not np.isnan(command.face) or is_pushed
        elif moves:
            # only where what is left of its path leads into the robot, where it is or will be
            start, reach = now - place.begin, place.reach + robot.reach
            is_far = abs(place.x - robot.x) > reach or abs(place.y - robot.y) > reach
            if not is_far:
                due[i] = robot_cost(
                    agents.path[i], start, place.last, body, 0.0, robot, place.pace, box
                )[1]
        if due[i]:
            count += 1
            pose = agents.path[i, min(now - place.begin, place.last)]
            away = max(abs(pose[X] - place.x), abs(pose[Y] - place.y))
            squares[i, 0], squares[i, 1] = pose[X], pose[Y]
            squares[i, 2] = max(reach_of(body, timing), away + place.reach)
    return count


@owning
def run(
    agents: AgentArrays,
    now: int,
    index: int,
    timing: PlannerTiming,
    floor: ClearanceLayer,
    robot: RobotPath,
    workspace: Workspace,
) -> tuple[_Mask, _Floats]:
    """Plan for the agents that are due at sub-step `now`, in the order of ids; then all move on.

    Returns bool (N,): which poses have changed; and the poses (N, 6) at the next sub-step.
    """
    size = agents.place.shape[0]
    due, squares = np.empty(size, np.bool_), np.empty((size, 3))
    epoch, since = divmod(index, _RANKS_LAST_SECONDS * timing.second)
    if since == 0:  # else two could go on to inherit from each other
        for i in range(size):
            agents.memory[i].push_rank = 0.0
    if _mark_due(due, squares, agents, now, robot, timing, workspace.box) > 0:
        buckets = fill(squares)
        for i in range(size):
            if due[i]:
                plan(agents, i, now, epoch, timing, floor, robot, buckets, workspace)
    moved, poses = np.empty(size, np.bool_), np.empty((size, 6))
    for i in range(size):
        place, path = agents.place[i], agents.path[i]
        before = path[min(now - place.begin, place.last)]
        after = path[min(now + 1 - place.begin, place.last)]
        for column in range(6):
            poses[i, column] = after[column]
        moved[i] = before[X] != after[X] or before[Y] != after[Y] or before[YAW] != after[YAW]
        if agents.command[i].has_goal:
            note_progress(agents, i, before, after, now + 1, timing)
    return moved, poses


@borrowing
def mark_closed(agents: AgentArrays, now: int, floor: ClearanceLayer, box: _Floats) -> None:
    """Make those agents plan at once whose trajectory meets closed ground of a new map."""
    for i in range(agents.place.shape[0]):
        place, body = agents.place[i], agents.body[i]
        if place.is_scripted or now - place.begin >= place.last:
            continue
        rest = agents.path[i][now - place.begin : place.last + 1]
        last = rest.shape[0] - 1
        wanted = wall_gap_wanted(rest[0], body, 0.0, floor, box)
        if (
            wall_conflict(rest, last, body, wanted, place.pace, floor, box, rest[last], False)[1]
            != NEVER
        ):
            place.must_plan, agents.due[i] = 1, now


@borrowing
def mark_broken(agents: AgentArrays, now: int) -> None:
    """Make those agents plan at once that meet a trajectory which was changed from outside."""
    for j in range(agents.place.shape[0]):
        other = agents.place[j]
        if not other.is_news:
            continue
        other.is_news = 0
        for i in range(agents.place.shape[0]):
            place = agents.place[i]
            dx, dy, far = place.x - other.x, place.y - other.y, place.reach + other.reach
            if i == j or dx * dx + dy * dy >= far * far:
                continue
            if place.is_scripted or now - place.begin >= place.last:
                continue
            rest = agents.path[i][now - place.begin : place.last + 1]
            last = rest.shape[0] - 1
            _, k = gap_between(
                rest,
                last,
                agents.body[i],
                agents.path[j],
                min(now - other.begin, other.last),
                other.last,
                agents.body[j],
                0.0,
                place.pace + other.pace,
                NEVER,
                rest[last],
            )
            if k != NEVER:
                place.must_plan, agents.due[i] = 1, now


@borrowing
def mark_clear(
    clear: _Mask, agents: AgentArrays, now: int, poses: _Floats, bodies: Records
) -> None:
    """Set `clear` (M,) to False for each body (M,) that a trajectory meets.

    The bodies stand at poses (M, 6) from now on.
    """
    for m in range(poses.shape[0]):
        pose = poses[m : m + 1]
        for i in range(agents.place.shape[0]):
            place, path = agents.place[i], agents.path[i]
            dx, dy = place.x - poses[m, X], place.y - poses[m, Y]
            far = place.reach + bodies[m].radius
            if dx * dx + dy * dy >= far * far:
                continue
            body, other = bodies[m], agents.body[i]
            start = min(now - place.begin, place.last)
            if separation(pose[0], body, path[start], other) >= 0.0:
                _, k = gap_between(
                    pose, 0, body, path, start, place.last, other, 0.0, place.pace, NEVER, pose[0]
                )
                if k == NEVER:
                    continue
            clear[m] = False
            break
