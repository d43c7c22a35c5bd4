"""Where artefacts appear: out of every camera's view, in entrances, where the traffic leaves room.

The law of each is held against plain rejection over the whole map, with the z-buffer and the
polygons as judges of their own.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from are_ros.agents.robots import RobotPose
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.occlusion.zbuffer import ZBuffer
from are_ros.builder.spawning.spawner import Allowed, Spawning
from are_ros.errors import ParameterError
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import GroundPose, boxes_of
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.departures import Cause
from are_ros.population.meshes.shapes import Shape
from are_ros.population.randomness import Purpose, generator
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import (
    FORWARD_FROM_OPTICAL,
    CameraAt,
    OmnidirectionalView,
    PinholeView,
    ViewModel,
)
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.footprint import Footprint
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]

SIDE_M = 6.0
DISC = Footprint.disc(0.2)
NOBODY = OrientedBoxes.empty()
AHEAD = PinholeView.from_field_of_view(96, 72, math.pi / 2)
ALL_AROUND = OmnidirectionalView(180, 60, -1.2, 1.2)
POST = CatalogueRow(0, "post", "thing", (0.3, 0.3, 1.6), (0.0, 0.0, 0.8), Shape.CRATE)
TABLE = CatalogueRow(1, "table", "thing", (1.2, 0.4, 0.5), (0.1, 0.0, 0.2), Shape.CRATE)
HOUSE = CatalogueRow(2, "house", "thing", (7.0, 7.0, 3.0), (0.0, 0.0, 1.5), Shape.CRATE)
SCREEN = (18, 44, 30, 32)
"""A wall in the middle of the room."""
ENTRANCES = """
zones:
- polygon: [[0, 0], [3, 0], [3, 6], [0, 6]]
no_spawn:
- [[0, 0], [6, 0], [6, 0.5], [0, 0.5]]
entrances:
- {polygon: [[0, 0], [1, 0], [1, 6], [0, 6]], weight: 3}
- {polygon: [[4, 0], [6, 0], [6, 2], [4, 2]]}
"""


def _room(*blocks: tuple[int, int, int, int]) -> Environment:
    """Return a room of 6 x 6 m within walls, all walls extruded to 2.5 m."""
    cells = np.zeros((60, 60), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    for row0, row1, col0, col1 in blocks:
        cells[row0:row1, col0:col1] = 100
    grid = OccupancyGrid(cells, 0.1, RigidTransform.identity(), "map")
    classes = classify(grid, 65, 25)
    walls = VoxelMap.extruded(grid, classes.occupied, 2.5, 0.0)
    return Environment(grid, classes, walls, PlaneGround(0.0), 0.01)


def _robot(x: float, y: float) -> RobotPose:
    return RobotPose(0, RigidTransform.planar(x, y, 0.0), DISC.at(x, y, 0.0))


def _looking(view: ViewModel, x: float, y: float, yaw: float) -> CameraAt:
    pose = RigidTransform.from_xyz_ypr(x, y, 1.0, yaw, 0.0, 0.0)
    return CameraAt(0, view, pose @ FORWARD_FROM_OPTICAL)


def _parameters(**values: Any) -> Parameters:
    paths = {f"population.{name}": value for name, value in values.items()}
    return with_values(Parameters(), {"robot.clearance": 0.1, **paths})


def _zones_file(tmp_path: Path, text: str = ENTRANCES) -> str:
    path = tmp_path / "zones.yaml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def _placed(
    spawn: Spawning,
    row: CatalogueRow,
    robot: RobotPose | None,
    number: int = 0,
    allowed: Allowed | None = None,
) -> GroundPose | Cause:
    stream = generator(7, Purpose.PLACE, number)
    return spawn.place(row, stream, NOBODY, robot, None, allowed)


def _drawn(spawn: Spawning, row: CatalogueRow, robot: RobotPose | None, count: int) -> Floats:
    drawn = (_placed(spawn, row, robot, number) for number in range(count))
    poses = [pose for pose in drawn if isinstance(pose, GroundPose)]
    return np.array([(pose.x_m, pose.y_m, pose.yaw_rad) for pose in poses])


def _tries(count: int) -> Floats:
    """Return poses (N, 3) anywhere in the room."""
    return np.random.default_rng(5).uniform(
        (0.0, 0.0, -math.pi), (SIDE_M, SIDE_M, math.pi), (count, 3)
    )


def _boxes(row: CatalogueRow, poses: Floats) -> OrientedBoxes:
    return boxes_of([row] * len(poses), [GroundPose(x, y, 0.0, yaw) for x, y, yaw in poses])


def _counts(poses: Floats) -> npt.NDArray[np.int64]:
    """Count poses by squares of 1 m and two kinds of heading, along x or along y."""
    across = (np.abs(np.sin(poses[:, 2])) > math.sqrt(0.5)).astype(np.int64)
    cells = (poses[:, 0].astype(np.int64) * 6 + poses[:, 1].astype(np.int64)) * 2 + across
    return np.bincount(cells, minlength=72)


def _same_law(first: Floats, second: Floats) -> float:
    counts = np.array([_counts(first), _counts(second)])
    return float(stats.chi2_contingency(counts[:, counts.sum(axis=0) > 20]).pvalue)


@pytest.mark.parametrize("row", [POST, TABLE])
def test_poses_out_of_view_are_uniform_over_the_hidden_ones(row: CatalogueRow) -> None:
    """1,500 poses against rejection with the z-buffer as judge: chi-square, level 1/1,000."""
    environment, robot = _room(SCREEN), _robot(1.0, 3.0)
    viewpoint = _looking(AHEAD, 1.0, 3.0, 0.3)
    spawn = Spawning(_parameters(appear="out_of_view"), DISC)
    spawn.refresh(environment, robot, [viewpoint])
    poses = _drawn(spawn, row, robot, 1500)
    assert len(poses) == 1500
    walls = environment.voxels
    assert walls is not None
    buffer, field = ZBuffer(viewpoint.view, 30.0), VoxelField.of(walls)

    def is_hidden(boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        seen = buffer.visibility(viewpoint.map_from_camera, boxes, field, None, False)
        return np.asarray(seen.visible_pixels == 0)

    assert is_hidden(_boxes(row, poses)).all()
    tries = _tries(16000)
    boxes = _boxes(row, tries)
    feasible = [
        spawn.why_not(boxes.at(i), environment, NOBODY, robot) == "" for i in range(len(boxes))
    ]
    oracle = tries[np.array(feasible) & is_hidden(boxes)]
    assert 2000 < len(oracle) < 0.9 * sum(feasible)
    assert _same_law(poses, oracle) > 1e-3


def test_where_all_is_seen_arrivals_are_blocked_with_a_cause_of_their_own() -> None:
    """A house that fits nowhere, and a post before a camera that sees everything."""
    environment, robot = _room(), _robot(3.0, 3.0)
    spawn = Spawning(_parameters(appear="out_of_view"), DISC)
    spawn.refresh(environment, robot, [_looking(ALL_AROUND, 3.0, 3.0, 0.0)])
    assert _placed(spawn, POST, robot) is Cause.NO_HIDDEN_PLACE
    assert _placed(spawn, HOUSE, robot) is Cause.NO_PLACE
    spawn.refresh(_room(SCREEN), robot, [_looking(ALL_AROUND, 1.0, 3.0, 0.0)])
    pose = _placed(spawn, POST, robot)
    assert isinstance(pose, GroundPose)
    assert pose.x_m > 3.1


def test_without_a_camera_everything_is_hidden_but_the_robots_surroundings() -> None:
    """No viewpoint known: poses as anywhere."""
    environment, robot = _room(), _robot(3.0, 3.0)
    unseen, anywhere = (
        Spawning(_parameters(appear="out_of_view"), DISC),
        Spawning(_parameters(), DISC),
    )
    for spawn in (unseen, anywhere):
        spawn.refresh(environment, robot)
    poses = _drawn(unseen, POST, robot, 50)
    np.testing.assert_array_equal(poses, _drawn(anywhere, POST, robot, 50))
    assert np.hypot(*(poses[:, :2] - 3.0).T).min() > 0.3


@pytest.mark.parametrize(("region", "has_low_part"), [("reachable", True), ("zones", False)])
def test_poses_lie_in_the_entrances_by_their_weights(
    tmp_path: Path, region: str, has_low_part: bool
) -> None:
    """2,000 poses against rejection by weight: chi-square, level 1/1,000.

    The area, and so the rate, stays that of the region. No-spawn polygons keep both kinds clear.
    """
    environment = _room()
    values = {"appear": "zones", "region": region, "zones": _zones_file(tmp_path)}
    spawn, robot = Spawning(_parameters(**values), DISC), _robot(3.0, 4.0)
    spawn.refresh(environment, robot)
    expected_m2 = 5.8 * 5.4 if has_low_part else 2.9 * 5.4
    assert spawn.area_m2 == pytest.approx(expected_m2, abs=0.1)
    poses, tries = _drawn(spawn, POST, None, 2000), _tries(40000)
    assert len(poses) == 2000
    left = (tries[:, 0] < 1.0) & (tries[:, 1] > 0.5)
    right = (tries[:, 0] > 4.0) & (tries[:, 1] < 2.0) & (tries[:, 1] > 0.5)
    taken = np.random.default_rng(6).random(len(tries)) < np.where(left, 1.0, right / 3.0)
    oracle = tries[taken]
    oracle = oracle[environment.is_placeable(_boxes(POST, oracle))]
    assert len(oracle) > 3000
    assert _same_law(poses, oracle) > 1e-3


def test_zones_stand_in_for_entrances(tmp_path: Path) -> None:
    """A file without entrances; one without either is refused, at the start and live."""
    path = _zones_file(tmp_path, "zones: [{polygon: [[2, 2], [3, 2], [3, 3]]}]")
    spawn = Spawning(_parameters(appear="zones", zones=path), DISC)
    spawn.refresh(_room(), _robot(4.0, 4.0))
    poses = _drawn(spawn, POST, None, 30)
    assert poses[:, :2].min() > 2.0
    assert poses[:, :2].max() < 3.0
    with pytest.raises(ParameterError, match=r"population\.appear is zones"):
        Spawning(_parameters(appear="zones"), DISC)
    spawn = Spawning(_parameters(), DISC)
    spawn.refresh(_room(), _robot(4.0, 4.0))
    with pytest.raises(ParameterError, match="entrances"):
        spawn.reconfigure(_parameters(appear="zones"))
    assert len(_drawn(spawn, POST, None, 5)) == 5


def test_entrances_out_of_the_region_are_none(tmp_path: Path) -> None:
    """An entrance behind a wall that the robot cannot pass blocks all who want to arrive there."""
    text = "entrances: [{polygon: [[4, 1], [5, 1], [5, 5], [4, 5]]}]"
    values = {"appear": "zones", "zones": _zones_file(tmp_path, text)}
    spawn = Spawning(_parameters(**values), DISC)
    spawn.refresh(_room((0, 60, 29, 31)), _robot(1.0, 1.0))
    assert _placed(spawn, POST, None) is Cause.NO_PLACE
    assert spawn.refresh(_room(), _robot(1.0, 1.0))
    assert isinstance(_placed(spawn, POST, None), GroundPose)


def test_how_they_appear_may_change_at_any_time(tmp_path: Path) -> None:
    """Anywhere, then out of view, then in zones, then anywhere again."""
    spawn = Spawning(_parameters(zones=_zones_file(tmp_path)), DISC)
    robot, viewpoint = _robot(1.0, 3.0), _looking(AHEAD, 1.0, 3.0, 0.0)
    spawn.refresh(_room(SCREEN), robot, [viewpoint])
    before = _drawn(spawn, POST, robot, 60)

    def drawn(appear: str) -> Floats:
        parameters = _parameters(zones=_zones_file(tmp_path), appear=appear)
        spawn.reconfigure(parameters)
        assert spawn.needs_viewpoints == (appear == "out_of_view")
        return _drawn(spawn, POST, robot, 60)

    unseen = drawn("out_of_view")
    assert spawn.out_of_view.hides(_boxes(POST, unseen)).all()
    assert not spawn.out_of_view.hides(_boxes(POST, before)).all()
    inside = drawn("zones")
    assert ((inside[:, 0] < 1.0) | (inside[:, 1] < 2.0)).all()
    np.testing.assert_array_equal(drawn("anywhere"), before)
    spawn.reconfigure(_parameters(leave="walk_to_exit"))
    assert spawn.needs_viewpoints


@pytest.mark.parametrize("appear", ["anywhere", "out_of_view"])
def test_a_wish_is_granted_where_it_can_be(appear: str) -> None:
    """Who is asked to keep to the upper half does, though not where the lower one is the only."""
    spawn, robot = Spawning(_parameters(appear=appear), DISC), _robot(1.0, 3.0)
    spawn.refresh(_room(SCREEN), robot, [_looking(ALL_AROUND, 1.0, 3.0, 0.0)])
    asked: list[int] = []

    def upper(boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        asked.append(len(boxes))
        assert spawn.out_of_view.hides(boxes).all() or appear == "anywhere"
        return boxes.centres_m[:, 1] > 3.0

    for number in range(20):
        pose = _placed(spawn, POST, robot, number, upper)
        assert isinstance(pose, GroundPose)
        assert pose.y_m > 3.0
    assert asked

    def nowhere(boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        return np.zeros(len(boxes), np.bool_)

    pose = _placed(spawn, POST, robot, 1, nowhere)
    assert isinstance(pose, GroundPose)
    assert (
        spawn.out_of_view.hides(_boxes(POST, np.array([(pose.x_m, pose.y_m, pose.yaw_rad)])))[0]
        or appear == "anywhere"
    )


def test_a_wish_that_makes_no_difference_makes_none() -> None:
    """The pose is the same, and nothing is searched twice where a wish refused nobody."""
    spawn, robot = Spawning(_parameters(appear="out_of_view"), DISC), _robot(3.0, 3.0)
    spawn.refresh(_room(SCREEN), robot, [_looking(AHEAD, 1.0, 3.0, 0.0)])
    everywhere = _placed(spawn, POST, robot, 4, lambda boxes: np.ones(len(boxes), np.bool_))
    assert everywhere == _placed(spawn, POST, robot, 4)
    assert isinstance(everywhere, GroundPose)
    spawn.refresh(_room(), robot, [_looking(ALL_AROUND, 3.0, 3.0, 0.0)])
    refused = _placed(spawn, POST, robot, 4, lambda boxes: np.zeros(len(boxes), np.bool_))
    assert refused is Cause.NO_HIDDEN_PLACE
