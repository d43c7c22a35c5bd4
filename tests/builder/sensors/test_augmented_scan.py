"""The augmented scan: the rules beam by beam, and hits against a slow twin."""

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.builder.occlusion.meshes import MeshPool, MeshSelection
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.rigid_transform import RigidTransform

Floats = npt.NDArray[np.float64]
HERE = RigidTransform.identity()
INF, NAN = math.inf, math.nan


def _scan(
    ranges: list[float] | Floats,
    first: float = 0.0,
    step: float = 0.01,
    limits: tuple[float, float] = (0.5, 10.0),
) -> LaserScan:
    count = len(ranges)
    return LaserScan(
        frame_id="laser",
        stamp_ns=7,
        angle_min_rad=first,
        angle_max_rad=first + (count - 1) * step,
        angle_increment_rad=step,
        time_increment_s=0.0,
        scan_time_s=0.1,
        range_min_m=limits[0],
        range_max_m=limits[1],
        ranges=np.array(ranges, dtype=np.float32),
        intensities=np.arange(1, count + 1, dtype=np.float32),
    ).checked()


def augment_scan(
    scan: LaserScan,
    map_from_laser: RigidTransform,
    boxes: OrientedBoxes,
    shapes: MeshSelection | None = None,
    surface: VoxelField | None = None,
) -> LaserScan:
    """Return the scan among boxes or, where given, meshes."""
    shapes = MeshSelection.boxes_only(len(boxes)) if shapes is None else shapes
    return scan.augmented(map_from_laser, Obstacles(boxes, shapes, surface))


def _box(x: float, size: float = 1.0, y: float = 0.0, yaw: float = 0.0) -> OrientedBoxes:
    half = np.array([[0.5 * size, 0.5 * size, 0.5]])
    return OrientedBoxes(np.array([[x, y, 0.0]]), np.array([yaw]), half)


@pytest.mark.parametrize(
    ("real", "front", "expected"),
    [
        (5.0, 3.0, 3.0),
        (2.0, 3.0, 2.0),
        (3.0, 3.0, 3.0),
        (INF, 3.0, 3.0),
        (NAN, 3.0, 3.0),
        (11.0, 3.0, 3.0),
        (0.0, 3.0, 3.0),
        (0.25, 3.0, 3.0),
        (-INF, 3.0, -INF),
        (INF, 10.0, 10.0),
        (INF, 10.5, INF),
        (11.0, 10.5, 11.0),
        (5.0, 0.25, -INF),
        (INF, 0.25, -INF),
        (0.0, 0.25, -INF),
        (-INF, 0.25, -INF),
        (0.5, 0.5, 0.5),
        (5.0, 0.5, 0.5),
    ],
)
def test_each_rule(real: float, front: float, expected: float) -> None:
    """A measured range, a box's face at a distance, and what the augmented beam says."""
    scan = _scan([real])
    result = augment_scan(scan, HERE, _box(front + 0.5))
    np.testing.assert_array_equal(result.ranges, np.array([expected], dtype=np.float32))
    replaced = not np.array_equal(result.ranges, scan.ranges, equal_nan=True)
    assert result.intensities[0] == (0.0 if replaced else 1.0)


def test_untouched_scans_come_back_as_the_same_object() -> None:
    """Without a box, out of range, beside or above the plane, nothing is made anew."""
    scan = _scan([5.0, NAN, 0.0, -INF])
    above = OrientedBoxes(np.array([[3.0, 0.0, 2.0]]), np.zeros(1), np.full((1, 3), 0.5))
    for boxes in (OrientedBoxes.empty(), _box(20.0), _box(3.0, y=-4.0), _box(-3.0), above):
        assert augment_scan(scan, HERE, boxes) is scan


def test_beams_beside_a_box_keep_their_bits() -> None:
    """Odd NaN payloads and denormals pass; the rest of the scan's fields are those of the input."""
    odd = np.array([0x7FC12345, 0x00000001, 0x40A00000, 0x7F800000], dtype=np.uint32)
    scan = replace(_scan([1.0] * 4, 0.0, 0.8), ranges=odd.view(np.float32))
    result = augment_scan(scan, HERE, _box(3.0))
    assert result.ranges[0] == 2.5
    np.testing.assert_array_equal(result.ranges.view(np.uint32)[1:], odd[1:])
    np.testing.assert_array_equal(result.intensities, [0.0, 2.0, 3.0, 4.0])
    assert (result.frame_id, result.stamp_ns, result.angle_min_rad) == ("laser", 7, 0.0)


def test_a_scan_without_intensities_stays_without() -> None:
    """The empty array stays empty."""
    scan = replace(_scan([5.0]), intensities=np.empty(0, dtype=np.float32))
    assert augment_scan(scan, HERE, _box(3.0)).intensities.shape == (0,)


def test_a_laser_inside_a_box_is_too_close_in_every_beam() -> None:
    """It hits at distance 0: -inf, or 0 where range_min is 0; a mesh has only its surface."""
    around = _box(0.0, 4.0)
    everywhere = augment_scan(_scan([5.0] * 600), HERE, around)
    assert np.isneginf(everywhere.ranges).all()
    assert augment_scan(_scan([5.0], limits=(0.0, 10.0)), HERE, around).ranges[0] == 0.0
    made = trimesh.creation.box((4.0, 4.0, 1.0))
    shapes = MeshSelection(MeshPool.of([(made.vertices, made.faces)]), np.array([0]))
    assert augment_scan(_scan([5.0]), HERE, around, shapes).ranges[0] == pytest.approx(2.0)


def test_the_nearest_of_several_boxes_wins() -> None:
    """Whatever their order."""
    boxes = OrientedBoxes(
        np.array([[7.0, 0.0, 0.0], [3.0, 0.0, 0.0], [5.0, 0.0, 0.0]]),
        np.zeros(3),
        np.full((3, 3), 0.5),
    )
    assert augment_scan(_scan([9.0]), HERE, boxes).ranges[0] == 2.5


def test_a_scan_of_more_than_a_turn_sees_a_box_twice() -> None:
    """Beams one turn apart look the same way and measure the same, whichever way it turns."""
    for step in (0.01, -0.01):
        scan = _scan([9.0] * 1300, -0.2 * np.sign(step), step)
        hit = augment_scan(scan, HERE, _box(3.0)).ranges < 9.0
        again = hit[round(2 * math.pi / 0.01) :]
        assert hit[:40].any()
        assert again.any()


def test_an_endless_range_is_served() -> None:
    """With an infinite range_max, beams that miss stay as they are."""
    scan = _scan([INF, INF], 0.0, 1.0, (0.1, INF))
    np.testing.assert_array_equal(augment_scan(scan, HERE, _box(30.5)).ranges, [30.0, INF])


def test_a_range_of_0_is_no_return_whatever_the_least_is() -> None:
    """Drivers write it for nothing: it proves that no beam ended, and hides no artefact."""
    scan = _scan([0.0, 0.0, 2.0], 0.0, 1.0, (0.0, 8.0))
    assert augment_scan(scan, HERE, _box(3.5)).ranges.tolist() == [3.0, 0.0, 2.0]
    assert np.flatnonzero(scan.returns()[1]).tolist() == [2]


def _twin(scan: LaserScan, pose: RigidTransform, boxes: OrientedBoxes) -> Floats:
    """Return first hits on all boxes by slabs, every beam with every box."""
    rays, best = scan.directions() @ pose.rotation_matrix().T, np.full(len(scan.ranges), np.inf)
    for centre, yaw, half in zip(boxes.centres_m, boxes.yaws_rad, boxes.half_sizes_m, strict=True):
        turn = RigidTransform.planar(0.0, 0.0, float(yaw)).rotation_matrix()
        start, turned = (pose.translation_m - centre) @ turn, rays @ turn
        with np.errstate(all="ignore"):
            a, b = (-half - start) / turned, (half - start) / turned
        near = np.maximum(np.fmin(a, b).max(axis=1), 0.0)
        hit = near <= np.fmax(a, b).min(axis=1)
        best = np.where(hit, np.minimum(best, near), best)
    return best


finite = st.floats(-3.0, 3.0)


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    angles=st.tuples(finite, st.floats(-0.6, 0.6), st.floats(-0.6, 0.6)),
    first=st.floats(-7.0, 7.0),
    step=st.sampled_from([0.02, -0.02, 0.0174, -0.03]),
    count=st.integers(1, 400),
    as_mesh=st.booleans(),
)
def test_hits_agree_with_every_beam_against_every_box(
    seed: int,
    angles: tuple[float, float, float],
    first: float,
    step: float,
    count: int,
    as_mesh: bool,
) -> None:
    """Any plane, any sector: distances are the slow twin's to 1e-5 m, but for grazing beams."""
    rng = np.random.default_rng(seed)
    boxes = OrientedBoxes(
        rng.uniform(-6.0, 6.0, (7, 3)) * (1.0, 1.0, 0.2),
        rng.uniform(-4, 4, 7),
        rng.uniform(0.1, 1, (7, 3)),
    )
    x, y = rng.uniform(-1.0, 1.0, 2)
    pose = RigidTransform.from_xyz_ypr(x, y, 0.1, *angles)
    scan = _scan([INF] * count, first, step, (0.0, 30.0))
    expected = _twin(scan, pose, boxes)
    inside = as_mesh and bool((expected == 0.0).any())
    if inside:
        return
    hits = augment_scan(scan, pose, boxes, _as_meshes(boxes) if as_mesh else None).ranges
    with np.errstate(invalid="ignore"):
        apart = (hits != expected) & ~(np.abs(hits - expected) < 1e-5)
    assert apart.sum() <= 1


def _as_meshes(boxes: OrientedBoxes) -> MeshSelection:
    """Return the boxes as meshes of twelve triangles."""
    solids = [trimesh.creation.box(2.0 * half) for half in boxes.half_sizes_m]
    pool = MeshPool.of([(solid.vertices, solid.faces) for solid in solids])
    return MeshSelection(pool, np.arange(len(boxes)))


@settings(max_examples=100, deadline=None)
@given(
    ranges=st.lists(
        st.one_of(st.floats(-1.0, 40.0, width=32), st.sampled_from([INF, -INF, NAN, 0.0])),
        min_size=1,
        max_size=60,
    ),
    distance=st.floats(0.0, 40.0),
)
def test_a_real_return_only_leaves_for_something_nearer(
    ranges: list[float], distance: float
) -> None:
    """Each beam is its input's bits, or a hit nearer than a valid return; -inf never leaves."""
    scan = _scan(ranges, -0.3)
    result = augment_scan(scan, HERE, _box(distance + 1.0, 2.0, yaw=0.3))
    same = result.ranges.view(np.uint32) == scan.ranges.view(np.uint32)
    valid = (scan.ranges >= 0.5) & (scan.ranges <= 10.0)
    assert (same | (result.ranges < scan.ranges) | ~valid).all()
    assert np.isneginf(result.ranges[np.isneginf(scan.ranges)]).all()
    changed = result.ranges[~same]
    assert (np.isneginf(changed) | ((changed >= 0.5) & (changed <= 10.0))).all()
