"""The simulated laser."""

import numpy as np
import numpy.typing as npt
import pytest

from are_ros.builder.occlusion.rays import VoxelField
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap
from bags.simulation.simulator import Lidar, LidarModel

ROOM_M = np.array([6.0, 4.0])
"""Inner size of a room whose inner corner is the map's origin."""


@pytest.fixture(scope="module")
def room() -> VoxelField:
    """Return the room, its walls a cell of 0.1 m thick."""
    occupied = np.ones((62, 42, 1), dtype=np.uint8)
    occupied[1:-1, 1:-1] = 0
    lattice = RigidTransform.planar(-0.1, -0.1, 0.0)
    return VoxelField.of(VoxelMap(lattice, (0.1, 0.1, 2.0), occupied))


def lidar(room: VoxelField, *, noise_m: float, range_max_m: float = 8.0, seed: int = 1) -> Lidar:
    """Return a laser in that room."""
    model = LidarModel(noise_m=noise_m, range_max_m=range_max_m)
    return Lidar(model, room, "base_scan", np.random.default_rng(seed))


def distances_m(x: float, y: float, yaw: float) -> npt.NDArray[np.float64]:
    """Return the distances to the walls of the rectangle, in closed form, for 360 beams.

    No beam may be parallel to a wall.
    """
    angles = yaw + np.arange(360) * np.pi / 180
    heading = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    to_wall = np.where(heading > 0, ROOM_M - (x, y), -np.array([x, y]))
    ways: npt.NDArray[np.float64] = np.min(to_wall / heading, axis=1)
    return ways


@pytest.mark.parametrize(("x", "y", "yaw"), [(3.0, 2.0, 0.013), (0.52, 3.1, 1.0), (5.0, 0.4, -2.3)])
def test_ranges_are_the_distances_to_the_walls(
    room: VoxelField, x: float, y: float, yaw: float
) -> None:
    """A scan without noise against the closed form."""
    scan = lidar(room, noise_m=0.0).scan(RigidTransform.planar(x, y, yaw, 0.2), 42)
    np.testing.assert_allclose(scan.ranges, distances_m(x, y, yaw), atol=1e-4)
    assert (scan.frame_id, scan.stamp_ns) == ("base_scan", 42)
    scan.checked()


def test_the_noise_has_its_standard_deviation(room: VoxelField) -> None:
    """Of 18,000 residuals; false alarms: 5 % is 9 standard errors of the deviation."""
    laser, pose = lidar(room, noise_m=0.02), RigidTransform.planar(3.0, 2.0, 0.2, 0.2)
    residuals = [laser.scan(pose, 0).ranges - distances_m(3.0, 2.0, 0.2) for _ in range(50)]
    assert np.std(residuals) == pytest.approx(0.02, rel=0.05)
    assert np.mean(residuals) == pytest.approx(0.0, abs=0.001)


def test_beyond_its_reach_nothing_returns(room: VoxelField) -> None:
    """Ranges over 2 m are inf, the others stay."""
    pose = RigidTransform.planar(1.0, 2.1, 0.013, 0.2)
    scan = lidar(room, noise_m=0.0, range_max_m=2.0).scan(pose, 0)
    true_m = distances_m(1.0, 2.1, 0.013)
    assert np.isinf(scan.ranges[true_m > 2.001]).all()
    assert np.isfinite(scan.ranges[true_m < 1.999]).all()
    assert 0 < np.isinf(scan.ranges).sum() < 360


def test_too_near_is_minus_inf(room: VoxelField) -> None:
    """A wall at 5 cm is too near to measure (REP 117)."""
    scan = lidar(room, noise_m=0.0).scan(RigidTransform.planar(5.95, 2.0, 0.0, 0.2), 0)
    assert scan.ranges[0] == -np.inf


def test_the_same_seed_gives_the_same_scans(room: VoxelField) -> None:
    """And another seed others."""
    pose = RigidTransform.planar(3.0, 2.0, 0.0, 0.2)
    one, same, other = (lidar(room, noise_m=0.01, seed=seed).scan(pose, 0) for seed in (1, 1, 2))
    assert one.ranges.tolist() == same.ranges.tolist()
    assert one.ranges.tolist() != other.ranges.tolist()
