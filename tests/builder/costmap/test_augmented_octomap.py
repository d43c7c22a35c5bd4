"""The augmented octomap: exact voxels of surfaces, and when the cloud goes out."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from are_ros.builder.costmap.augmented_octomap import (
    AugmentedOctomap,
    Solid,
    box_triangles,
    surface_voxels,
    unpacked,
)
from are_ros.builder.occlusion.meshes import MeshPool
from are_ros.builder.sensors.point_cloud import PointCloud
from are_ros.checks.sensors.octomap import met_voxels
from are_ros.conventions import NS_PER_S
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

Floats = NDArray[np.float64]
SIZE_M = 0.1
NOTHING = MeshPool.of([])


def place(yaw: float = 0.0, share: float = 0.1) -> VoxelMap:
    """Return a cube of 2 m about the origin, in which some voxels are occupied."""
    occupied = (np.random.default_rng(3).random((20, 20, 20)) < share).astype(np.uint8)
    corner = RigidTransform.planar(-1.0, -1.0, yaw)
    return VoxelMap(corner, (SIZE_M, SIZE_M, 0.5 * SIZE_M), occupied)


def box_row(at: Floats, yaw: float, halves_m: Floats) -> Floats:
    """Return a row of `OrientedBoxes.packed`."""
    return np.array([*at, np.cos(yaw), np.sin(yaw), *halves_m])


def by_slices(box: Floats, triangles: Floats, voxels: VoxelMap) -> set[tuple[int, ...]]:
    """Return what surfaces meet by the slow twin, which cuts triangles into slices."""
    c, s = box[3:5]
    turn = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
    starts = triangles[:, :3]
    corners = np.stack((starts, starts + triangles[:, 3:6], starts + triangles[:, 6:]), axis=1)
    points = (corners @ turn.T + box[:3]).reshape(-1, 3)
    local = voxels.map_from_lattice.inverse().apply(points) / np.array(voxels.voxel_size_m)
    met: set[tuple[int, ...]] = {*met_voxels(local.reshape(-1, 3, 3), 0.0)}
    shape = voxels.occupied.shape
    return {
        at
        for at in met
        if not (all(0 <= k < n for k, n in zip(at, shape, strict=True)) and voxels.occupied[at])
    }


@given(seed=st.integers(0, 2**32 - 1), is_box=st.booleans())
def test_voxels_are_those_of_the_slow_twin(seed: int, is_box: bool) -> None:
    """Boxes and any triangles, on a lattice that is turned and flat, also beyond its array."""
    random = np.random.default_rng(seed)
    voxels = place(random.uniform(-3.0, 3.0))
    halves_m = random.uniform(0.05, 0.6, 3)
    row = box_row(random.uniform(-1.0, 1.0, 3), random.uniform(-3.0, 3.0), halves_m)
    triangles = random.uniform(-1.0, 1.0, (20, 9)) * np.tile(halves_m, 3)
    triangles = box_triangles(halves_m) if is_box else triangles
    found = unpacked(surface_voxels(row, triangles, voxels)).tolist()
    assert {*map(tuple, found)} == by_slices(row, triangles, voxels)
    assert found == sorted(found)


def test_what_ends_on_the_border_of_voxels_adds_none_beyond() -> None:
    """A box of whole voxels has its outermost voxels, no more: 6 x 4 x 8 without what is inside."""
    halves_m = np.array((0.3, 0.2, 0.2))
    row = box_row(np.array((0.2, 0.1, 0.5)), 0.0, halves_m)
    found = unpacked(surface_voxels(row, box_triangles(halves_m), place(share=0.0)))
    assert found.min(axis=0).tolist() == [9, 9, 6]
    assert found.max(axis=0).tolist() == [14, 12, 13]
    assert len(found) == 6 * 4 * 8 - 4 * 2 * 6


def cloud_of(octomap: AugmentedOctomap, t_s: float, *at_m: float) -> PointCloud | None:
    """Update with a box at each of these places on x, half a metre high."""
    solids = [
        Solid(k, box_row(np.array((x_m, 0.0, 0.5)), 0.3, np.full(3, 0.2)), -1)
        for k, x_m in enumerate(at_m)
    ]
    return octomap.update(round(t_s * NS_PER_S), "map", PLACE, solids, NOTHING)


PLACE = place()


def test_the_cloud_is_the_real_one_with_what_is_added() -> None:
    """Real centres first, the same bytes as ever; each voxel once, also where two boxes meet."""
    octomap = AugmentedOctomap(5.0)
    bare, alone = cloud_of(octomap, 0.0), cloud_of(octomap, 1.0, 0.0)
    both, other = cloud_of(octomap, 2.0, 0.0, 0.1), cloud_of(AugmentedOctomap(5.0), 0.0, 0.1)
    assert bare is not None
    assert alone is not None
    assert both is not None
    assert other is not None
    real = PLACE.centres_m().astype(np.float32)
    np.testing.assert_array_equal(bare.points_m(), real)
    np.testing.assert_array_equal(both.points_m()[: len(real)], real)
    added = [{*map(tuple, c.points_m()[len(real) :].tolist())} for c in (alone, other, both)]
    assert len(added[2]) == both.width - len(real)
    assert added[0] & added[1]
    assert added[2] == added[0] | added[1]


def test_it_goes_out_when_it_changed_and_not_too_often() -> None:
    """Moves wait for the rate; who comes or goes does not, nor what was forgotten."""
    octomap = AugmentedOctomap(1.0)
    assert cloud_of(octomap, 0.0, 0.0) is not None
    assert cloud_of(octomap, 0.1, 0.0) is None
    assert cloud_of(octomap, 0.2, 0.2) is None
    assert cloud_of(octomap, 0.3, 0.2, 0.8) is not None
    assert cloud_of(octomap, 0.4, 0.2) is not None
    assert cloud_of(octomap, 3.0, 0.2) is None
    octomap.forget()
    assert cloud_of(octomap, 3.1, 0.2) is not None


@pytest.mark.parametrize("x_m", [0.0, 50.0])
def test_it_knows_whether_these_voxels_went_out_with_nobody(x_m: float) -> None:
    """Also of artefacts beyond the lattice, and of other voxels."""
    octomap = AugmentedOctomap(1.0)
    assert not AugmentedOctomap(1.0).has_gone_out
    cloud_of(octomap, 0.0)
    assert octomap.has_gone_out
    assert octomap.is_bare(PLACE)
    assert not octomap.is_bare(place())
    cloud_of(octomap, 5.0, x_m)
    assert not octomap.is_bare(PLACE)
