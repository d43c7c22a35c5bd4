"""The range sensor: each rule of its reading, and the nearest hit in its cone against many rays."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.builder.occlusion.meshes import MeshSelection
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.builder.sensors.range_reading import RangeReading, _rays_in_cone
from are_ros.errors import InputError
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]
HERE = RigidTransform.identity()
INF, NAN = math.inf, math.nan


def reading(range_m: float, fov_rad: float = 0.4, least_m: float = 0.5) -> RangeReading:
    """Return a reading of a sonar that measures up to 10 m."""
    return RangeReading("sonar", 7, 0, fov_rad, least_m, 10.0, range_m, 0.0).checked()


def among(boxes: OrientedBoxes, surface: VoxelField | None = None) -> Obstacles:
    """Return boxes, before the surface of an environment."""
    return Obstacles(boxes, MeshSelection.boxes_only(len(boxes)), surface)


def box(x: float, y: float = 0.0, z: float = 0.0, size: float = 1.0) -> OrientedBoxes:
    """Return a cube."""
    half = np.full((1, 3), 0.5 * size)
    return OrientedBoxes(np.array([[x, y, z]]), np.zeros(1), half)


@pytest.mark.parametrize(
    ("real", "front", "expected"),
    [
        (5.0, 3.0, 3.0),
        (2.0, 3.0, 2.0),
        (INF, 3.0, 3.0),
        (NAN, 3.0, 3.0),
        (11.0, 3.0, 3.0),
        (0.0, 3.0, 3.0),
        (-1.0, 3.0, 3.0),
        (0.1, 3.0, 0.1),
        (0.1, 0.25, 0.1),
        (-INF, 3.0, -INF),
        (INF, 10.0, 10.0),
        (INF, 10.5, INF),
        (11.0, 10.5, 11.0),
        (5.0, 0.25, -INF),
        (INF, 0.25, -INF),
        (0.5, 0.5, 0.5),
    ],
)
def test_each_rule(real: float, front: float, expected: float) -> None:
    """A measured range, a box's face at a distance, and what the augmented reading says."""
    given_reading = reading(real)
    result = given_reading.augmented(HERE, among(box(front + 0.5)))
    assert result.range_m == expected
    same = np.array_equal([result.range_m], [real], equal_nan=True)
    assert (result is given_reading) == same


def test_a_reading_of_0_is_no_return_whatever_the_least_is() -> None:
    """It hides no artefact."""
    result = reading(0.0, least_m=0.0).augmented(HERE, among(box(3.5)))
    assert result.range_m == 3.0


@pytest.mark.parametrize(("front", "expected"), [(3.0, -INF), (8.0, INF)])
def test_a_sensor_of_fixed_distance_only_detects(front: float, expected: float) -> None:
    """With min_range = max_range an artefact within it gives -inf, as REP 117 has it."""
    sensor = RangeReading("ir", 7, 1, 0.1, 5.0, 5.0, INF, 0.0).checked()
    assert sensor.augmented(HERE, among(box(front + 0.5))).range_m == expected


def test_only_what_is_in_the_cone_counts() -> None:
    """Beside, above and behind the cone is nothing; within it the side of a box is enough."""
    for outside in (box(3.0, y=2.0), box(3.0, z=2.0), box(-3.0)):
        assert reading(INF).augmented(HERE, among(outside)).range_m == INF
    for partly in (box(3.0, y=1.0), box(3.0, z=-1.0)):
        assert 2.5 < reading(INF).augmented(HERE, among(partly)).range_m < 2.7


def test_a_cone_without_width_is_a_ray() -> None:
    """A field of view of 0, as some drivers of infrared sensors say, looks along the axis."""
    assert reading(INF, fov_rad=0.0).augmented(HERE, among(box(3.0))).range_m == 2.5
    beside = among(box(3.0, y=0.6))
    assert reading(INF, fov_rad=0.0).augmented(HERE, beside).range_m == INF


def test_a_wall_hides_where_nothing_came_back() -> None:
    """Without a return a wall hides the box behind it; a farther return says that it is not so."""
    y, z = np.meshgrid(np.arange(-2.0, 2.0, 0.1), np.arange(-2.0, 2.0, 0.1))
    wall = np.stack((np.full(y.size, 2.05), y.ravel() + 0.05, z.ravel() + 0.05), axis=1)
    surface = VoxelField.of(VoxelMap.from_centres(wall, 0.1, HERE))
    behind = among(box(4.0), surface)
    assert reading(INF).augmented(HERE, behind).range_m == INF
    assert reading(6.0).augmented(HERE, behind).range_m == 3.5
    assert reading(INF).augmented(HERE, among(box(1.5), surface)).range_m == 1.0
    endless = RangeReading("sonar", 7, 0, 0.4, 0.5, INF, INF, 0.0).checked()
    assert endless.augmented(HERE, behind).range_m == INF, "an infinite range is no return"
    assert endless.augmented(HERE, among(box(1.5), surface)).range_m == 1.0


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("frame_id", ""),
        ("field_of_view_rad", -0.1),
        ("field_of_view_rad", NAN),
        ("field_of_view_rad", 7.0),
        ("min_range_m", -1.0),
        ("min_range_m", 11.0),
        ("max_range_m", NAN),
    ],
)
def test_what_no_sensor_says_is_refused(field: str, value: object) -> None:
    """The sentence begins with the topic."""
    values = {**vars(reading(5.0)), field: value}
    with pytest.raises(InputError, match=r"^/sonar: "):
        RangeReading(**values).checked("/sonar")


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    fov_rad=st.floats(0.05, 1.5),
    angles=st.tuples(st.floats(-3.0, 3.0), st.floats(-0.6, 0.6), st.floats(-3.0, 3.0)),
)
def test_the_nearest_hit_agrees_with_many_rays(
    seed: int, fov_rad: float, angles: tuple[float, float, float]
) -> None:
    """The reading lies between the first hits of 40,000 rays on larger and on smaller boxes.

    Every point of a smaller box has a ray of the sensor nearby that meets the box itself; every hit
    of the sensor has one of the 40,000 rays nearby that meets the larger box.
    """
    rng = np.random.default_rng(seed)
    boxes = OrientedBoxes(
        rng.uniform(-5.0, 5.0, (6, 3)), rng.uniform(-4, 4, 6), rng.uniform(0.2, 0.8, (6, 3))
    )
    x, y, z = rng.uniform(-1.0, 1.0, 3)
    pose = RigidTransform.from_xyz_ypr(x, y, z, *angles)
    found = reading(INF, fov_rad, 0.0).augmented(pose, among(boxes)).range_m
    rays = rays_in_cone(fov_rad, 40_000) @ pose.rotation_matrix().T
    smaller = first_hits(pose.translation_m, rays, boxes, -0.08).min()
    larger = first_hits(pose.translation_m, rays, boxes, 0.15).min()
    assert larger <= found + 1e-5 or found > 10.0
    assert found <= smaller + 1e-5 or smaller > 10.0


def rays_in_cone(fov_rad: float, count: int) -> Floats:
    """Return unit vectors (N, 3), evenly spread over the cone about x (a Fibonacci spiral)."""
    cosine = np.linspace(1.0, math.cos(0.5 * fov_rad), count)
    turn, sine = np.arange(count) * math.pi * (3.0 - math.sqrt(5.0)), np.sqrt(1.0 - cosine**2)
    return np.stack((cosine, sine * np.cos(turn), sine * np.sin(turn)), axis=1)


def first_hits(origin_m: Floats, rays: Floats, boxes: OrientedBoxes, more_m: float) -> Floats:
    """Return the first hit of each ray on any box, larger by that on each side; inf if none."""
    best = np.full(len(rays), np.inf)
    halves_m = boxes.half_sizes_m + more_m
    for centre, yaw, half in zip(boxes.centres_m, boxes.yaws_rad, halves_m, strict=True):
        turn = RigidTransform.planar(0.0, 0.0, float(yaw)).rotation_matrix()
        start, turned = (origin_m - centre) @ turn, rays @ turn
        with np.errstate(all="ignore"):
            a, b = (-half - start) / turned, (half - start) / turned
        near = np.maximum(np.fmin(a, b).max(axis=1), 0.0)
        hit = near <= np.fmax(a, b).min(axis=1)
        best = np.where(hit, np.minimum(best, near), best)
    return best


@pytest.mark.parametrize("fov_rad", [0.2, 0.5, 1.0, 2.0])
def test_no_gap_of_the_cone_is_wider_than_a_hundredth(fov_rad: float) -> None:
    """On its rim, where the fans are farthest apart, and from ray to ray of a fan."""
    rays = _rays_in_cone(fov_rad)
    away_rad = np.arccos(np.clip(rays[:, 0], -1.0, 1.0))
    assert away_rad.max() == pytest.approx(0.5 * fov_rad)
    assert np.diff(np.unique(np.round(away_rad, 9))).max() <= 0.0101
    rim = rays[away_rad > 0.5 * fov_rad - 1e-6]
    turns = np.unique(np.round(np.arctan2(rim[:, 2], rim[:, 1]), 9))
    gaps_rad = np.diff(np.append(turns, turns[0] + math.tau))
    assert gaps_rad.max() * math.sin(0.5 * fov_rad) <= 0.0101


def test_a_cone_wider_than_half_a_space_has_the_rays_of_its_equator() -> None:
    """Its fans are farthest apart there, and not on its rim."""
    assert len(_rays_in_cone(math.tau)) >= 314 * 600
