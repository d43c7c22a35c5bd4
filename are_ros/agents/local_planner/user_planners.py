"""User-defined planners: what they see, what they return, and what happens when they fail."""

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.calls import (
    BehaviourCall,
    answer_of,
    is_number,
    new_behaviour,
    shown,
    wrong_answer,
)
from are_ros.agents.behaviours.registry import user_class
from are_ros.agents.body import PLANNERS
from are_ros.agents.local_planner.state import MOST_WISHES, SPEED, WISHES, YAW, X, Y
from are_ros.conventions import seconds_to_ns
from are_ros.errors import BehaviourError, CatalogueError

if TYPE_CHECKING:
    from are_ros.agents.local_planner.robot import RobotMotion
    from are_ros.agents.local_planner.state import ClearanceLayer
    from are_ros.agents.table import AgentTable
    from are_ros.world.occupancy_grid import OccupancyGrid

_SEES_M: Final = 10.0


class Mover(NamedTuple):
    """Another artefact, or the robot: its place and velocity in the map frame, and its radius."""

    x_m: float
    y_m: float
    vx_mps: float
    vy_mps: float
    radius_m: float


class PlanningScene(NamedTuple):
    """What a planner knows when it proposes, in the map frame.

    `me` and its heading; the sub-goal, the speed wanted, and whether the way ends there.
    `turn_radius_m` is 0 for an agent that turns on the spot. `others` are those within 10 m, the
    nearest first. `clearance_m(x_m, y_m)` is how far the cell of a point is from one that is closed
    for a body of this height, from middle to middle; 0 beyond the map.
    """

    now_ns: int
    me: Mover
    yaw_rad: float
    goal_m: tuple[float, float]
    speed_mps: float
    stop_there: bool
    turn_radius_m: float
    others: tuple[Mover, ...]
    robot: Mover | None
    clearance_m: Callable[[float, float], float]


Wish = tuple[float, float]
"""A heading in the map frame [rad] and a speed [m/s], to be kept for a second."""


class Planner(Protocol):
    """Proposes motions for one artefact; each has its own instance, made without arguments.

    A vehicle steers towards the heading as far as it can; its speed may be negative: reverse.
    """

    name: ClassVar[str]

    def propose(self, scene: PlanningScene) -> Sequence[Wish]:
        """Return up to 16 wishes; the first that is free comes true, else the artefact brakes."""


def why_not(name: str) -> str | None:
    """Return why there is no planner of this name, None if there is one.

    The text continues a sentence that begins with the name: "is not known; ...".
    """
    try:
        if name not in PLANNERS:
            _class_named(name)
    except CatalogueError as refusal:
        return str(refusal).removeprefix(f"{name} ")
    return None


def _class_named(name: str) -> type[Planner]:
    return user_class(name, PLANNERS, "propose", "a scene")


class _Own:
    """The planner of one agent, its name and its last wishes; no planner after it has failed."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.planner: Planner | None = None
        self.has_failed = False
        self.wishes = np.full((MOST_WISHES, 2), np.nan)

    def propose(self, scene: PlanningScene, call: BehaviourCall) -> None:
        """Ask for wishes; BehaviourError, and none from then on, if the user's class fails."""
        self.wishes[:] = np.nan
        self.has_failed = True
        if self.planner is None:
            self.planner = new_behaviour(_class_named(self.name), call)
        answer = answer_of(self.planner, "propose", scene, call)
        for n, wish in enumerate(_checked(answer, self.planner, call)):
            self.wishes[n] = wish
        self.has_failed = False


class UserPlanners:
    """The user-defined planners of the agents of a table."""

    def __init__(self, table: "AgentTable") -> None:
        self.stop: Callable[[int, BehaviourError, int], None] | None = None
        """(agent's id, error, time [ns]): called for each that fails; if None, it is raised."""
        self._table = table
        self._period_ns = seconds_to_ns(table.timing.step_s)
        self._owned: dict[int, _Own] = {}

    def use(self, row: int, name: str) -> None:
        """Let the agent of a row have the planner of this name, its own instance."""
        agent_id = int(self._table.ids[row])
        if agent_id not in self._owned or self._owned[agent_id].name != name:
            self._owned[agent_id] = _Own(name)

    def ask(
        self,
        wishes: npt.NDArray[np.float64],
        index: int,
        grid: "OccupancyGrid",
        floor: "ClearanceLayer",
        robot: "RobotMotion | None",
    ) -> None:
        """Ask the planners of the agents that plan in this sub-step; write `wishes` (N, K, 2)."""
        if not self._owned:
            return
        table, arrays = self._table, self._table.arrays
        rows = np.flatnonzero(arrays.command["planner"] == WISHES).tolist()
        ids = table.ids.tolist()
        self._owned = {ids[row]: self._owned[ids[row]] for row in rows}
        for row in rows:
            own = self._owned[ids[row]]
            is_due = arrays.due[row] <= table.now and arrays.command["has_goal"][row]
            if is_due and not own.has_failed:
                scene = _scene(table, row, index * self._period_ns, grid, floor, robot)
                call = BehaviourCall(
                    ids[row], table.artefacts[row].row.label, scene.now_ns, "planner"
                )
                self._propose(own, scene, call)
            wishes[row] = own.wishes

    def _propose(self, own: _Own, scene: PlanningScene, call: BehaviourCall) -> None:
        try:
            own.propose(scene, call)
        except BehaviourError as fault:
            if self.stop is None:
                raise
            self.stop(call.artefact_id, fault, call.now_ns)


def _scene(
    table: "AgentTable",
    row: int,
    now_ns: int,
    grid: "OccupancyGrid",
    floor: "ClearanceLayer",
    robot: "RobotMotion | None",
) -> PlanningScene:
    """Return what the planner of the agent of a row sees."""
    arrays = table.arrays
    layers = floor.clearance
    field = layers[min(int(arrays.body["terrain"][row]), len(layers) - 1)]

    def clearance_m(x_m: float, y_m: float) -> float:
        cell = grid.cell_at(x_m, y_m)
        return 0.0 if cell is None else float(field[cell])

    command, body, motion = arrays.command[row], arrays.body[row], table.motion
    away_m = np.hypot(*(motion[:, :2] - motion[row, :2]).T)
    near = [n for n in np.argsort(away_m, kind="stable").tolist() if away_m[n] <= _SEES_M]
    return PlanningScene(
        now_ns,
        _mover(motion[row], table.radii_m[row]),
        float(motion[row, YAW]),
        (float(command["x"]), float(command["y"])),
        float(min(command["speed"], body["speed"])),
        bool(command["stops"]),
        float(body["turn_radius"]),
        tuple(_mover(motion[n], table.radii_m[n]) for n in near if n != row),
        None if robot is None else _robot_mover(robot),
        clearance_m,
    )


def _mover(motion: npt.NDArray[np.float64], radius_m: float) -> Mover:
    x_m, y_m, yaw_rad, speed_mps = motion[[X, Y, YAW, SPEED]].tolist()
    vx_mps, vy_mps = speed_mps * math.cos(yaw_rad), speed_mps * math.sin(yaw_rad)
    return Mover(x_m, y_m, vx_mps, vy_mps, float(radius_m))


def _robot_mover(robot: "RobotMotion") -> Mover:
    return Mover(robot.x_m, robot.y_m, robot.vx_mps, robot.vy_mps, robot.radius_m)


def _checked(answer: object, planner: Planner, call: BehaviourCall) -> list[Wish]:
    """Return the wishes, headings within half a turn; BehaviourError if they are none."""
    kind = type(planner)
    if not isinstance(answer, Sequence) or isinstance(answer, str):
        what = "None" if answer is None else f"a {type(answer).__name__}"
        raise wrong_answer(kind, "propose", f"{what}, which is no sequence of wishes", call)
    if len(answer) > MOST_WISHES:
        reason = f"{len(answer)} wishes: at most {MOST_WISHES} are taken"
        raise wrong_answer(kind, "propose", reason, call)
    for wish in answer:
        if not (isinstance(wish, tuple) and len(wish) == 2 and all(map(is_number, wish))):
            reason = f"the wish {shown(wish)}: a tuple of two finite numbers is needed"
            raise wrong_answer(kind, "propose", reason, call)
    return [(math.remainder(heading, math.tau), speed) for heading, speed in answer]
