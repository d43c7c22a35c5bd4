"""The table of agents: order, boxes, and that what was taken stays what it was."""

import numpy as np
import pytest

from are_ros.agents.table import AgentTable
from are_ros.parameters.choices import GroundKind
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory, boxes_of
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform

ROWS = (
    CatalogueRow(0, "one", "kind", (0.3, 0.5, 1.7), (0.0, 0.0, 0.0), Shape.PERSON),
    CatalogueRow(1, "long", "kind", (2.0, 0.8, 1.0), (0.4, -0.1, 0.1), Shape.CAR),
)
POSES = {
    7: GroundPose(1.0, 2.0, 0.0, 0.3),
    3: GroundPose(-4.0, 0.5, 0.2, 2.0),
    9: GroundPose(6.0, 6.0, 0.0, -1.0),
}


def environment() -> Environment:
    """Return nothing but free floor."""
    grid = OccupancyGrid(np.zeros((10, 10), np.int8), 1.0, RigidTransform.identity(), "map")
    return Environment(grid, classify(grid, 65, 25), None, PlaneGround(0.0), 0.01)


def add(table: AgentTable, artefact_id: int, row: CatalogueRow, pose: GroundPose) -> Artefact:
    """Add one that stands, and return it."""
    one = Artefact(artefact_id, row, Origin.RANDOM, 0, PoseHistory(0, pose))
    table.add(one)
    return one


@pytest.fixture
def crowd() -> AgentTable:
    """Return three, added in no order; the one of id 3 is long."""
    three = AgentTable(0.05)
    for artefact_id, pose in POSES.items():
        add(three, artefact_id, ROWS[artefact_id == 3], pose)
    return three


def put(table: AgentTable, poses: dict[int, GroundPose]) -> None:
    """Let some be elsewhere."""
    rows = table.rows_of(list(poses))
    table.move(*table.with_poses(table.poses, rows, np.array(list(poses.values()))))


def as_rows(crowd: AgentTable) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return the boxes by the slow way."""
    ids = crowd.ids.tolist()
    poses = [GroundPose(*pose) for pose in crowd.poses.tolist()]
    return boxes_of([ROWS[i == 3] for i in ids], poses).packed


def test_all_are_in_the_order_of_their_ids(crowd: AgentTable) -> None:
    """Ids, poses, radii and boxes belong together, whoever came first."""
    assert crowd.ids.tolist() == [3, 7, 9]
    assert [GroundPose(*pose) for pose in crowd.poses.tolist()] == [POSES[i] for i in (3, 7, 9)]
    np.testing.assert_allclose(crowd.boxes.packed, as_rows(crowd), atol=1e-12)
    assert crowd.radii_m.tolist() == pytest.approx(
        [np.hypot(1.4, 0.5), np.hypot(0.15, 0.25), np.hypot(0.15, 0.25)]
    )
    assert [crowd.row_of(i) for i in (3, 7, 9)] == [0, 1, 2]
    assert [one.id for one in crowd.artefacts] == [3, 7, 9]


def test_who_is_gone_leaves_no_trace(crowd: AgentTable) -> None:
    """The others keep their places in the arrays, and nobody is left in the end."""
    crowd.remove(7)
    assert crowd.ids.tolist() == [3, 9]
    np.testing.assert_allclose(crowd.boxes.packed, as_rows(crowd), atol=1e-12)
    for artefact_id in (9, 3):
        crowd.remove(artefact_id)
    assert len(crowd.boxes) == len(crowd.ids) == len(crowd.radii_m) == len(crowd.artefacts) == 0
    assert len(crowd.arrays.place) == len(crowd.arrays.path) == 0


def test_boxes_are_the_same_object_while_all_stand(crowd: AgentTable) -> None:
    """Until somebody comes, goes or moves."""
    before = crowd.boxes
    assert crowd.boxes is before
    moved, boxes = crowd.proposed(np.zeros((3, 3)), np.zeros(3, np.bool_), environment())
    assert boxes is before
    assert moved is crowd.poses
    put(crowd, {9: GroundPose(0.0, 0.0, 0.0, 0.0)})
    assert crowd.boxes is not before


def test_only_those_who_moved_are_proposed_elsewhere(crowd: AgentTable) -> None:
    """The others' numbers are kept, also where the traffic rounds them otherwise."""
    planar = crowd.poses[:, [0, 1, 3]] + 0.25
    kept, poses_before = crowd.poses, crowd.poses.copy()
    poses, boxes = crowd.proposed(planar, np.array([False, True, False]), environment())
    assert poses[1].tolist() == [1.25, 2.25, 0.0, 0.55]
    assert np.array_equal(poses[[0, 2]], poses_before[[0, 2]])
    assert np.array_equal(kept, poses_before)
    assert crowd.poses is kept
    crowd.move(poses, boxes)
    np.testing.assert_allclose(crowd.boxes.packed, as_rows(crowd), atol=1e-12)


def test_what_was_taken_is_never_written_into(crowd: AgentTable) -> None:
    """Poses and boxes of before stay, whatever comes after."""
    poses, boxes = crowd.poses, crowd.boxes
    copies = poses.copy(), boxes.packed.copy()
    put(crowd, {3: GroundPose(0.0, 0.0, 0.0, 0.0), 9: GroundPose(5.0, 0.0, 0.0, 0.0)})
    add(crowd, 5, ROWS[0], GroundPose(2.0, 9.0, 0.0, 0.0))
    crowd.remove(7)
    assert np.array_equal(poses, copies[0])
    assert np.array_equal(boxes.packed, copies[1])


def test_on_voxel_ground_heights_are_asked_for() -> None:
    """Who moves stands on the ground where it comes to; who stands keeps its height."""
    crowd = AgentTable(0.05, GroundKind.VOXELS)
    for k in range(2):
        add(crowd, k, ROWS[0], GroundPose(2.0 + k, 2.0, 0.7, 0.0))
    poses, boxes = crowd.proposed(
        crowd.poses[:, [0, 1, 3]] + 0.1, np.array([True, False]), environment()
    )
    assert poses[:, 2].tolist() == [0.0, 0.7]
    assert boxes.centres_m[:, 2].tolist() == pytest.approx([0.85, 1.55])


def test_who_arrives_while_others_move_has_both_its_boxes_taken(crowd: AgentTable) -> None:
    """Boxes at the start and at the end of the sub-step are in the order of ids."""
    planar = crowd.poses[:, [0, 1, 3]] + 0.25
    crowd.set_ends(*crowd.proposed(planar, np.ones(3, np.bool_), environment()))
    add(crowd, 5, ROWS[0], GroundPose(2.0, 9.0, 0.0, 0.0))
    rows = [ROWS[i == 3] for i in crowd.ids.tolist()]
    expected = [
        boxes_of(rows, [GroundPose(*pose) for pose in poses.tolist()]).packed
        for poses in (crowd.poses, crowd.ends)
    ]
    np.testing.assert_allclose(crowd.taken.packed, np.concatenate(expected), atol=1e-12)
    crowd.remove(5)
    assert len(crowd.taken) == 6
    assert crowd.ends is not crowd.poses


def test_the_history_of_one_that_is_removed_stays() -> None:
    """A later frame of the others is not its own."""
    table = AgentTable(0.05)
    one = add(table, 1, ROWS[0], GroundPose(1.0, 2.0, 0.0, 0.0))
    table.history.record(10, 60, table.ids, table.poses, table.ends)
    table.remove(1)
    table.history.record(60, 110, table.ids, table.poses, table.ends)
    assert one.ground_pose_at(200) == GroundPose(1.0, 2.0, 0.0, 0.0)
    assert one.history.latest_ns == 60


def test_committed_paths_end_in_a_stand() -> None:
    """At each sub-step ahead all are where their paths say, by the slow way; then they stand."""
    table, rng = AgentTable(0.05), np.random.default_rng(2)
    for artefact_id in range(9):
        add(table, artefact_id, ROWS[0], POSES[7])
    arrays, table.now = table.arrays, 30
    arrays.path[:] = rng.normal(size=arrays.path.shape)
    arrays.place["begin"] = rng.integers(15, 31, 9)
    arrays.place["last"] = (0, 1, 5, 20, 40, 60, 3, 25, 80)
    held = 0
    for ahead in (0, 1, 20, 40):
        for row, found in enumerate(table.committed(ahead)):
            step, last = 30 + ahead - int(arrays.place["begin"][row]), arrays.place["last"][row]
            held += step > last
            assert np.array_equal(found, arrays.path[row, min(last, step)])
    assert 5 < held < 30
    assert np.array_equal(table.motion, table.committed(0))
