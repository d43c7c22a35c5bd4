"""Voxel maps: which voxels a cloud of leaf centres stands for, and walls over a grid."""

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.errors import InputError
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap, common_spacing

IDENTITY = RigidTransform.identity()
Occupancy = npt.NDArray[np.bool_]
SIZES = st.sampled_from((0.01, 0.02, 0.05, 0.08, 0.1, 0.123, 1.0))


def rows_of(points: npt.NDArray[np.floating], size: float) -> list[tuple[int, ...]]:
    """Return the points in eighths of a voxel, sorted."""
    return sorted(map(tuple, np.rint(np.asarray(points) * 8 / size).astype(int).tolist()))


def leaves_of(occupancy: Occupancy, low: tuple[int, int, int]) -> Iterator[list[float]]:
    """Yield the centres, in voxels, of the leaves of a pruned octree over a cube of 2**n."""
    width = occupancy.shape[0]
    if occupancy.all():
        yield [corner + width / 2 for corner in low]
    elif occupancy.any():
        half = width // 2
        for child in range(8):
            di, dj, dk = half * (child & 1), half * (child >> 1 & 1), half * (child >> 2)
            part = occupancy[di : di + half, dj : dj + half, dk : dk + half]
            yield from leaves_of(part, (low[0] + di, low[1] + dj, low[2] + dk))


def random_octree(seed: int) -> Occupancy:
    """Return a cube of 8 voxels with whole blocks, and a pair of fine leaves side by side."""
    generator = np.random.default_rng(seed)
    occupancy = generator.random((8, 8, 8)) < generator.uniform(0.0, 0.5)
    blocks = np.kron(generator.random((4, 4, 4)) < 0.2, np.ones((2, 2, 2))).astype(bool)
    occupancy |= blocks | np.kron(generator.random((2, 2, 2)) < 0.2, np.ones((4, 4, 4))).astype(
        bool
    )
    occupancy[0, 0, 0], occupancy[1, 0, 0], occupancy[0, 1, 0] = True, True, False
    return occupancy


@settings(deadline=None)
@given(
    seed=st.integers(0, 2**31),
    size=SIZES,
    phase=st.tuples(*[st.floats(0.0, 1.0)] * 3),
    inferred=st.booleans(),
)
def test_fine_voxels_come_back_whatever_the_phase(
    seed: int, size: float, phase: tuple[float, float, float], inferred: bool
) -> None:
    """Float32 centres on any lattice give exactly those voxels, the size given or not."""
    generator = np.random.default_rng(seed)
    voxels = generator.integers(-6, 6, (generator.integers(1, 60), 3))
    voxels = np.unique(np.vstack((voxels, [[0, 0, 0], [1, 0, 0]])), axis=0)
    centres = ((voxels + np.array(phase)) * size).astype(np.float32)
    built = VoxelMap.from_centres(centres, None if inferred else size, IDENTITY)
    assert built.voxel_size_m == pytest.approx((size,) * 3, rel=1e-4)
    assert built.occupied_count == len(voxels)
    found = built.points_to_voxels(centres)
    assert (built.occupied[tuple(found.T)] == 1).all()
    assert np.unique(found - voxels, axis=0).shape == (1, 3)
    nearest = np.abs(built.centres_m()[:, None] - centres).max(axis=2).min(axis=1)
    assert nearest.max() < 1e-3 * size
    assert built.occupied.shape == tuple(np.ptp(voxels, axis=0) + 1)


@settings(deadline=None)
@given(
    seed=st.integers(0, 2**31),
    size=SIZES,
    low=st.tuples(*[st.integers(-40, 40)] * 3),
    inferred=st.booleans(),
)
def test_pruned_leaves_are_expanded(
    seed: int, size: float, low: tuple[int, int, int], inferred: bool
) -> None:
    """The leaves of a pruned octree, in its own frame, give back every voxel it was made of."""
    occupancy = random_octree(seed)
    corner = (8 * low[0], 8 * low[1], 8 * low[2])
    centres = (np.array(list(leaves_of(occupancy, corner))) * size).astype(np.float32)
    built = VoxelMap.from_centres(centres, None if inferred else size, IDENTITY)
    expected = (np.argwhere(occupancy) + corner + 0.5) * size
    assert rows_of(built.centres_m(), size) == rows_of(expected, size)
    assert built.voxel_size_m[0] == pytest.approx(size, rel=1e-5)


def test_leaves_in_a_shifted_frame_are_two_voxels_wide() -> None:
    """Without the octree's origin a leaf between voxels is taken as of the next size."""
    occupancy = np.zeros((8, 8, 8), dtype=bool)
    occupancy[0:2, 0:2, 0:2] = True
    occupancy[:, 4, 5] = True
    occupancy[5, :, 5] = True
    centres = np.array(list(leaves_of(occupancy, (0, 0, 0)))) * 0.1 + (0.033, 0.021, -0.04)
    built = VoxelMap.from_centres(centres, 0.1, IDENTITY)
    assert built.occupied_count == occupancy.sum()
    assert np.array_equal(VoxelMap.from_centres(centres, None, IDENTITY).occupied, built.occupied)


def test_a_diagonal_pair_is_no_pruned_octree() -> None:
    """Two voxels that touch in a corner stay two voxels, aligned or not."""
    for shift in (0.0, 0.03):
        centres = np.array([[0.05, 0.05, 0.05], [0.15, 0.15, 0.15]]) + shift
        built = VoxelMap.from_centres(centres, None, IDENTITY)
        assert built.occupied_count == 2
        assert built.voxel_size_m[0] == pytest.approx(0.1)


def test_points_on_no_lattice_are_binned_at_multiples_of_a_given_size() -> None:
    """A raw cloud becomes the voxels that its points lie in."""
    points = np.random.default_rng(3).uniform(-1, 1, (500, 3))
    built = VoxelMap.from_centres(points, 0.25, IDENTITY)
    expected = np.unique(np.floor(points / 0.25).astype(int), axis=0)
    assert rows_of(built.centres_m(), 0.25) == rows_of((expected + 0.5) * 0.25, 0.25)


def test_far_from_the_origin_the_noise_of_float32_is_no_spacing() -> None:
    """At 4 km, centres are a quarter of a millimetre off; the lattice is still found."""
    voxels = np.argwhere(np.ones((6, 5, 4)))
    centres = ((voxels + 0.5) * 0.05 + (4000.0, -3000.0, 10.0)).astype(np.float32)
    built = VoxelMap.from_centres(centres, None, IDENTITY)
    assert built.voxel_size_m[0] == pytest.approx(0.05, abs=2e-4)
    assert built.occupied.shape == (6, 5, 4)
    assert built.occupied.all()


def solid_room() -> npt.NDArray[np.float64]:
    """Return the centres of the voxels of 0.1 m of a hollow box, 1,016 of them."""
    inside = np.zeros((14, 12, 10), dtype=bool)
    inside[1:-1, 1:-1, 1:-1] = True
    centres: npt.NDArray[np.float64] = 0.1 * (np.argwhere(~inside).astype(np.float64) + 0.5)
    return centres


@pytest.mark.parametrize("far_m", [40.0, 1e4, 3.6e6])
def test_one_far_point_does_not_change_the_size(far_m: float) -> None:
    """The others tell it; what then is too large a box is refused with that point's place."""
    centres = solid_room()
    cloud = np.vstack((centres, [(far_m, 0.31, 0.52)])).astype(np.float32)
    alone = VoxelMap.from_centres(centres, None, IDENTITY)
    if far_m > 1e5:
        with pytest.raises(
            InputError, match=r"crop the cloud: 1 of \d+ lie far from .* \(3\.6e\+06,"
        ):
            VoxelMap.from_centres(cloud, None, IDENTITY)
        return
    built = VoxelMap.from_centres(cloud, None, IDENTITY)
    assert built.voxel_size_m == pytest.approx((0.1, 0.1, 0.1), rel=1e-5)
    assert built.occupied_count == alone.occupied_count + 1


def test_a_few_points_on_no_lattice_do_not_change_the_size() -> None:
    """Up to a hundredth of the points may stray; they fill the voxels that they lie in."""
    strays = np.array([(0.625, 0.65, 0.45), (0.333, 0.271, 0.819)])
    built = VoxelMap.from_centres(np.vstack((solid_room(), strays)), None, IDENTITY)
    assert built.voxel_size_m == pytest.approx((0.1, 0.1, 0.1))
    assert built.occupied_count == len(solid_room()) + 2
    assert built.occupied[6, 6, 4]
    assert built.occupied[3, 2, 8]


@settings(deadline=None)
@given(
    seed=st.integers(0, 2**31), times=st.integers(1, 5), shift=st.booleans(), known=st.booleans()
)
def test_coarser_voxels_hold_what_is_in_them(
    seed: int, times: int, shift: bool, known: bool
) -> None:
    """A multiple of the cloud's size: each block in which something is, whole leaves included."""
    occupancy = random_octree(seed)
    offset = np.array((0.013, 0.022, -0.04)) if shift else np.zeros(3)
    leaves = np.array(list(leaves_of(occupancy, (0, 0, 0))))
    if shift:  # in a shifted frame leaves beyond the second size cannot be told
        leaves = np.argwhere(occupancy) + 0.5
    centres = leaves * 0.05 + offset
    own_m = 0.05 if known else None
    built = VoxelMap.from_centres(centres, own_m, IDENTITY, wanted_m=0.05 * times)
    fine = VoxelMap.from_centres(centres, own_m, IDENTITY)
    assert built.voxel_size_m == pytest.approx((0.05 * times,) * 3)
    assert built.cloud_voxel_m == (None if times == 1 else pytest.approx(0.05))
    corner = built.map_from_lattice.translation_m
    inside = np.floor((fine.centres_m() - corner) / (0.05 * times)).astype(int)
    assert sorted(set(map(tuple, inside.tolist()))) == sorted(
        map(tuple, np.argwhere(built.occupied).tolist())
    )


def test_a_size_that_is_no_multiple_leaves_no_holes() -> None:
    """A wall of 5 cm voxels is a wall of 7 cm voxels; nothing is farther off than half a voxel."""
    wall = (np.argwhere(np.ones((1, 40, 30))) + 0.5) * 0.05
    built = VoxelMap.from_centres(wall, None, IDENTITY, wanted_m=0.07)
    assert built.occupied.all()
    assert built.voxel_size_m == pytest.approx((0.07,) * 3)
    low, high = built.bounds_m()
    assert (low <= (0.025, 0.025, 0.025)).all()
    assert (high >= (0.025, 1.975, 1.475)).all()


def test_a_size_finer_than_the_cloud_is_refused() -> None:
    """It would be a sieve: the sentence has both sizes."""
    for own_m, wanted_m in ((None, 0.05), (None, 0.07), (0.1, 0.02)):
        with pytest.raises(InputError, match=r"voxels are 0\.1 m wide, finer ones .* multiple"):
            VoxelMap.from_centres(solid_room(), own_m, IDENTITY, wanted_m=wanted_m)


def test_a_few_points_take_the_size_that_is_wanted() -> None:
    """Of three voxels, two apart, nobody can say that finer ones are wrong."""
    centres = np.array([(0.05, 0.05, 0.05), (0.25, 0.05, 0.05), (0.25, 0.25, 0.05)])
    built = VoxelMap.from_centres(centres, None, IDENTITY, wanted_m=0.1)
    assert built.voxel_size_m == pytest.approx((0.1,) * 3)
    assert built.occupied_count == 3


def test_too_large_a_box_names_the_size_that_would_do() -> None:
    """137 x 121 x 8.5 m are too many voxels of 5 cm; with the size proposed they load."""
    corners = np.array(np.meshgrid((0.025, 136.975), (0.025, 120.975), (0.025, 8.475)))
    walls = (np.argwhere(np.ones((60, 1, 40))) + np.array((0.5, 400.5, 0.5))) * 0.05
    centres = np.vstack((corners.reshape(3, -1).T, walls))
    with pytest.raises(InputError, match=r"2740 x 2420 x 170 .* set world\.voxel_size to 0\.1 m"):
        VoxelMap.from_centres(centres, 0.05, IDENTITY)
    built = VoxelMap.from_centres(centres, 0.05, IDENTITY, wanted_m=0.1)
    assert built.occupied.shape == (1370, 1210, 85)
    assert built.occupied_count == 8 + 30 * 20


def test_points_that_are_not_finite_are_dropped() -> None:
    """NaN and infinity are how a cloud says there is no point."""
    centres = np.array([[0.5, 0.5, 0.5], [1.5, 0.5, 0.5], [np.nan, 0, 0], [0, np.inf, 0]])
    assert VoxelMap.from_centres(centres, None, IDENTITY).occupied_count == 2
    with pytest.raises(InputError, match="no finite point among 2"):
        VoxelMap.from_centres(centres[2:], 1.0, IDENTITY)


@pytest.mark.parametrize(
    ("points", "size", "reason"),
    [
        (np.zeros((1, 3)), None, "set world.voxel_size"),
        (np.zeros((7, 3)), None, "set world.voxel_size"),
        (np.random.default_rng(0).random((50, 3)), None, "set world.voxel_size"),
        (np.zeros((0, 3)), 0.1, "there is no occupied voxel in it"),
        (np.zeros((4, 2)), 0.1, r"not \(N, 3\)"),
        (np.zeros((1, 3)), 0.0, "positive length"),
        (np.zeros((1, 3)), -1.0, "positive length"),
        (np.zeros((1, 3)), math.nan, "positive length"),
        (np.array([[0.0, 0, 0], [200, 200, 200]]), 0.1, "more than 1073741824"),
        (np.array([[0.0, 0, 0], [1e30, 1e30, 1e30]]), 0.1, "a point lies 1e[+]30 m from"),
    ],
)
def test_bad_clouds_are_refused(
    points: npt.NDArray[np.float64], size: float | None, reason: str
) -> None:
    """One sentence with the topic and the reason; nothing is guessed."""
    with pytest.raises(InputError, match=reason) as caught:
        VoxelMap.from_centres(points, size, IDENTITY, source="/cells")
    assert str(caught.value).startswith("/cells: ")


def test_one_point_with_a_size_is_one_voxel() -> None:
    """Its own position is the lattice's phase."""
    built = VoxelMap.from_centres(np.array([[1.23, 4.56, 7.89]]), 0.2, IDENTITY)
    assert built.centres_m() == pytest.approx(np.array([[1.23, 4.56, 7.89]]))


@settings(deadline=None)
@given(yaw=st.floats(-math.pi, math.pi), x=st.floats(-50, 50), z=st.floats(-5, 5))
def test_a_cloud_in_another_frame_lands_where_the_transform_says(
    yaw: float, x: float, z: float
) -> None:
    """centres_m are the transformed input; every centre is found in its own voxel."""
    centres = (np.argwhere(np.random.default_rng(1).random((4, 5, 3)) < 0.5) + 0.5) * 0.1
    map_from_cloud = RigidTransform.planar(x, 2.0, yaw, z)
    built = VoxelMap.from_centres(centres, 0.1, map_from_cloud)
    expected = map_from_cloud.apply(centres)
    assert built.centres_m() == pytest.approx(expected, abs=1e-9)
    voxels = built.points_to_voxels(expected)
    assert np.array_equal(voxels, np.argwhere(built.occupied))
    low, high = built.bounds_m()
    assert ((expected > low) & (expected < high)).all()


def test_a_tilted_cloud_is_refused_and_a_milliradian_is_not() -> None:
    """Voxels stand upright; noise in roll and pitch is dropped."""
    centres = np.array([[0.5, 0.5, 0.5], [1.5, 0.5, 0.5]])
    nearly = RigidTransform.from_xyz_ypr(0, 0, 0, 0.3, 5e-4, 5e-4)
    built = VoxelMap.from_centres(centres, None, nearly)
    assert built.map_from_lattice.rotation_xyzw[:2].tolist() == [0.0, 0.0]
    with pytest.raises(InputError, match=r"tilts by 0\.0020 rad"):
        VoxelMap.from_centres(centres, None, RigidTransform.from_xyz_ypr(0, 0, 0, 0, 0.002, 0))


def test_the_array_is_read_only() -> None:
    """A map is a value; a new map makes a new one."""
    built = VoxelMap(IDENTITY, (1.0, 1.0, 1.0), np.ones((1, 1, 1), np.uint8))
    with pytest.raises(ValueError, match="read-only"):
        built.occupied[0, 0, 0] = 0


@settings(deadline=None)
@given(seed=st.integers(0, 2**31), yaw=st.floats(-math.pi, math.pi))
def test_extruded_walls_stand_on_their_cells(seed: int, yaw: float) -> None:
    """Each tall voxel's centre is over its cell's centre, on rotated grids too."""
    generator = np.random.default_rng(seed)
    cells = np.zeros(tuple(generator.integers(1, 9, 2)), np.int8)
    grid = OccupancyGrid(cells, 0.1, RigidTransform.planar(3.0, -1.0, yaw, 9.0), "map")
    mask: Occupancy = np.asarray(generator.random(cells.shape) < 0.5)
    built = VoxelMap.extruded(grid, mask, 2.5, 0.2)
    assert built.is_extruded
    assert built.voxel_size_m == (0.1, 0.1, 2.5)
    assert built.occupied.shape == (grid.width, grid.height, 1)
    assert built.occupied.flags.c_contiguous
    expected = grid.cells_to_points(np.argwhere(mask.T)[:, ::-1])
    assert built.centres_m()[:, :2] == pytest.approx(expected, abs=1e-9)
    assert built.centres_m()[:, 2] == pytest.approx(0.2 + 1.25)


def test_extrusions_without_height_or_of_another_shape_are_refused() -> None:
    """A wall has a positive, finite height, and the mask is of this grid."""
    grid = OccupancyGrid(np.zeros((2, 3), np.int8), 0.1, IDENTITY, "map")
    for height in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match="cannot be extruded"):
            VoxelMap.extruded(grid, np.ones((2, 3), bool), height, 0.0)
    with pytest.raises(InputError, match=r"the mask is \(3, 2\)"):
        VoxelMap.extruded(grid, np.ones((3, 2), bool), 1.0, 0.0)


def test_spacing_is_the_common_divisor_of_all_gaps() -> None:
    """Gaps of 2 and 3 voxels alone still tell the voxel."""
    points = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.25, 0, 0]])
    assert common_spacing(points) == pytest.approx(0.05)


def test_a_large_map_keeps_every_voxel() -> None:
    """900 k voxels of 2 cm, as many as there were centres."""
    occupied = np.random.default_rng(0).random((600, 600, 130)) < 0.0192
    centres = ((np.argwhere(occupied) + 0.5 - (300, 300, 5)) * 0.02).astype(np.float32)
    built = VoxelMap.from_centres(centres, None, IDENTITY)
    assert np.count_nonzero(built.occupied) == len(centres)


@settings(deadline=None)
@given(seed=st.integers(0, 2**31), yaw=st.floats(-3.1, 3.1))
def test_points_are_in_an_occupied_voxel_or_not(seed: int, yaw: float) -> None:
    """Found for one point after the other in the lattice's own frame; outside nothing is."""
    rng = np.random.default_rng(seed)
    occupied = (rng.random((4, 3, 2)) < 0.5).astype(np.uint8)
    voxels = VoxelMap(RigidTransform.planar(1.0, -2.0, yaw, 0.3), (0.2, 0.3, 1.0), occupied)
    local = rng.uniform((-0.2, -0.3, -1.0), (1.0, 1.2, 3.0), (40, 3))
    expected = []
    for point in local:
        i, j, k = (int(np.floor(c / s)) for c, s in zip(point, (0.2, 0.3, 1.0), strict=True))
        is_inside = 0 <= i < 4 and 0 <= j < 3 and 0 <= k < 2
        expected.append(is_inside and bool(occupied[i, j, k]))
    assert voxels.are_occupied(voxels.map_from_lattice.apply(local)).tolist() == expected


def test_a_spacing_below_a_millimetre_is_none() -> None:
    """As of centres that were turned into another frame; with a size they are binned."""
    steps = np.random.default_rng(8).integers(0, 70_000, (5_000, 3))
    points = steps * 5e-5
    with pytest.raises(InputError, match="octomap: its 5000 points lie on no grid along the axes"):
        VoxelMap.from_centres(points, None, IDENTITY, "octomap")
    built = VoxelMap.from_centres(points, None, IDENTITY, "octomap", wanted_m=0.15)
    assert built.voxel_size_m[0] == 0.15
