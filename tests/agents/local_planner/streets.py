"""Made-up places, bodies, and an inspector that recomputes what must hold at each sub-step."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from are_ros.agents.body import Body, MotionCommand
from are_ros.agents.local_planner.planner import LocalPlanner, Obstruction
from are_ros.agents.local_planner.robot import RobotMotion
from are_ros.agents.table import AgentTable
from are_ros.conventions import FREE, OCCUPIED
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap
from tests.world.overlapping import overlapping_pairs

STEP_S = 0.05
CELL_M = 0.05
WALKS_BACK_MPS = 0.4
"""Who turns on the spot walks no faster backward, and only where it has no room to turn."""
PERSON = Body((0.155, 0.275))
SCOOTER = Body((0.63, 0.29), (0.02, 0.0), 1.0, 1.6, 0.8, 1.0, 1.3)
CAR = Body((2.2, 0.9), (0.1, 0.0), 1.5, 3.0, 1.5, 0.6, 5.3)
PALLET = Body((0.6, 0.4), (0.0, 0.0), 0.144, 0.0)

ROW = CatalogueRow(0, "one", "kind", (0.31, 0.55, 1.7), (0.0, 0.0, 0.0), Shape.PERSON)
"""Of everybody on a street; the planner goes by their bodies."""

Cells = NDArray[np.int8]
Robot = Callable[[int], RobotMotion]


def room(width_m: float, depth_m: float) -> Cells:
    """Return free cells with walls 0.1 m thick around them; x from 0, y from 0."""
    cells = np.full((round(depth_m / CELL_M), round(width_m / CELL_M)), FREE, np.int8)
    cells[:2] = cells[-2:] = OCCUPIED
    cells[:, :2] = cells[:, -2:] = OCCUPIED
    return cells


def wall(cells: Cells, x_m: tuple[float, float], y_m: tuple[float, float]) -> None:
    """Build a wall into a room."""
    (left, right), (low, high) = ([round(end / CELL_M) for end in ends] for ends in (x_m, y_m))
    cells[low:high, left:right] = OCCUPIED


def corridor(width_m: float, length_m: float = 12.0) -> Environment:
    """Return a corridor along x, its middle at y = 0.5 width + 0.5."""
    cells = room(length_m, width_m + 1.0)
    cells[:10] = cells[-10:] = OCCUPIED
    return environment(cells)


def environment(
    cells: Cells,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    voxels: VoxelMap | None = None,
) -> Environment:
    """Return the environment of a grid whose corner has a pose (x, y, yaw) in the map."""
    grid = OccupancyGrid(cells, CELL_M, RigidTransform.planar(*origin), "map")
    return Environment(grid, classify(grid, 65, 25), voxels, PlaneGround(0.0), 0.06)


def boxes_at(poses: NDArray[np.float64], bodies: list[Body]) -> OrientedBoxes:
    """Return the boxes of bodies at poses (N, 3)."""
    halves = np.array([(*body.half_size_m, 0.5) for body in bodies]).reshape(-1, 3)
    offsets = np.array([body.centre_m for body in bodies]).reshape(-1, 2)
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = poses[:, 0] + cos * offsets[:, 0] - sin * offsets[:, 1]
    y = poses[:, 1] + sin * offsets[:, 0] + cos * offsets[:, 1]
    return OrientedBoxes(np.column_stack((x, y, np.full(len(x), 0.5))), poses[:, 2], halves)


def artefact_at(artefact_id: int, pose: GroundPose) -> Artefact:
    """Return one that has just arrived at a pose."""
    return Artefact(artefact_id, ROW, Origin.RANDOM, 0, PoseHistory(0, pose))


@dataclass
class Street:
    """A traffic in an environment, run and inspected sub-step by sub-step."""

    environment: Environment
    table: AgentTable = field(default_factory=lambda: AgentTable(STEP_S))
    planner: LocalPlanner = field(init=False)
    bodies: dict[int, Body] = field(default_factory=dict)
    index: int = 0
    inspects: bool = True
    goals: dict[int, tuple[float, float]] = field(default_factory=dict)
    track: list[NDArray[np.float64]] = field(default_factory=list)
    _poses: NDArray[np.float64] | None = None
    _speeds: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        self.planner = LocalPlanner(self.table)
        self.moved = np.zeros(0, np.bool_)

    @property
    def poses(self) -> NDArray[np.float64]:
        """Where all are: x, y, yaw."""
        return self.planner.motion[:, :3]

    @property
    def speeds(self) -> NDArray[np.float64]:
        """How fast all are."""
        return self.planner.motion[:, 5]

    def command(self, one: int, command: MotionCommand) -> None:
        """Tell one what to do."""
        self.planner.give_commands([self.table.row_of(one)], [command])

    def obstruction(self, one: int) -> tuple[Obstruction, int, float]:
        """Tell what is in the way of one."""
        return self.planner.obstructions(self.table.rows_of([one]).tolist())[0]

    def trajectory(self, one: int) -> NDArray[np.float64]:
        """Return what one is committed to."""
        return self.planner.trajectory(self.table.row_of(one))

    @property
    def plans_made(self) -> int:
        """How many plans were made so far."""
        return int(self.planner._workspace.counters[0])

    @property
    def emergency_stops(self) -> int:
        """How often no plan was free after an old one had broken."""
        return int(self.planner._workspace.counters[2])

    def put(self, one: int, pose: GroundPose) -> None:
        """Let one stand at another pose."""
        self.table.stand(self.table.row_of(one), pose)

    def add(self, one: int, x_m: float, y_m: float, yaw_rad: float, body: Body = PERSON) -> None:
        """Let one more be there."""
        self.bodies[one] = body
        self.table.add(artefact_at(one, GroundPose(x_m, y_m, 0.0, yaw_rad)), body)
        self.forget()

    def remove(self, one: int) -> None:
        """Let one be gone."""
        del self.bodies[one]
        self.table.remove(one)
        self.forget()

    def send(
        self,
        one: int,
        x_m: float,
        y_m: float,
        *,
        stop_there: bool = True,
        planner: str = "dynamic_window",
    ) -> None:
        """Order one to go to a place at its speed."""
        self.goals[one] = (x_m, y_m)
        speed = self.bodies[one].speed_mps
        self.command(one, MotionCommand((x_m, y_m), speed, stop_there, planner=planner))

    def forget(self) -> None:
        """Compare no motion across an interference from outside."""
        self._poses = self._speeds = None

    def step(self, robot: RobotMotion | None = None) -> None:
        """Go one sub-step on, and inspect."""
        if self._poses is None:
            self._poses = self.poses
        planned, self.moved = self.planner.step(self.index, self.environment, robot)
        assert np.array_equal(planned, self.poses)
        self.index += 1
        self.track.append(self.poses)
        if self.inspects:
            self._inspect()

    def run(self, seconds: float, robot: Robot | None = None) -> None:
        """Go on for a while."""
        for _ in range(round(seconds / STEP_S)):
            self.step(robot(self.index) if robot else None)

    def run_until_there(self, seconds: float, within_m: float = 0.12) -> float:
        """Go on until all have been at their goals, at most so long; return after how long."""
        missing = set(self.goals)
        for k in range(round(seconds / STEP_S)):
            self.step()
            missing -= {one for one in missing if self.distance(one) <= within_m}
            if not missing:
                return k * STEP_S
        raise AssertionError(f"{sorted(missing)} did not get there in {seconds} s")

    def pose(self, one: int) -> NDArray[np.float64]:
        """Return x, y, yaw of one."""
        pose: NDArray[np.float64] = self.poses[self.table.row_of(one)]
        return pose

    def distance(self, one: int) -> float:
        """Return how far one is from its goal."""
        return math.dist(self.pose(one)[:2], self.goals[one])

    def boxes(self) -> OrientedBoxes:
        """Return the boxes of all, in the order of ids."""
        return boxes_at(self.poses, [self.bodies[one] for one in sorted(self.bodies)])

    def longest_wait(self) -> float:
        """Return for how long the one has waited that has waited longest."""
        return max(self.obstruction(one)[2] for one in self.bodies)

    def _inspect(self) -> None:
        assert self.table.ids.tolist() == sorted(self.bodies)
        boxes, poses = self.boxes(), self.poses
        assert len(overlapping_pairs(boxes)) == 0
        assert self.environment.is_placeable(boxes).all()
        assert self._poses is not None
        self._speeds = inspect_motion(self._poses, poses, self._speeds, self.bodies)
        changed = (poses != self._poses).any(axis=1)
        assert (changed == self.moved).all()
        self._poses = poses


def inspect_motion(
    before: NDArray[np.float64],
    after: NDArray[np.float64],
    speeds: NDArray[np.float64] | None,
    bodies: Mapping[int, Body],
) -> NDArray[np.float64]:
    """Assert that the motion of one sub-step keeps to the limits; return the speeds (N,)."""
    command = [bodies[one] for one in sorted(bodies)]
    shift = after - before
    turn = np.remainder(shift[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    middle = before[:, 2] + 0.5 * turn
    along = shift[:, 0] * np.cos(middle) + shift[:, 1] * np.sin(middle)
    aside = shift[:, 1] * np.cos(middle) - shift[:, 0] * np.sin(middle)
    speed = along / STEP_S
    assert np.abs(aside).max(initial=0.0) < 1e-9
    assert (np.abs(speed) <= [body.speed_mps + 1e-9 for body in command]).all()
    assert (np.abs(turn) <= [body.turn_rate_radps * STEP_S + 1e-9 for body in command]).all()
    radii = np.array([body.turn_radius_m for body in command])
    assert (np.abs(turn) * radii <= np.abs(along) + 1e-9).all()
    assert (speed[radii == 0.0] >= -WALKS_BACK_MPS - 1e-9).all()
    if speeds is not None:
        gain = np.abs(speed - speeds) / STEP_S
        assert (gain <= [body.acceleration_mps2 + 1e-6 for body in command]).all()
    return speed
