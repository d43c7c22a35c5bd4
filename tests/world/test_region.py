"""Spawn regions: what the robot can reach, all free cells, weighted zones."""

from collections import deque
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy import ndimage

from are_ros.parameters.choices import Region
from are_ros.world.map_io import read_map_file
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.regions import ReachableRegion, SpawnRegion, Zone, Zones, region_finder
from are_ros.world.rigid_transform import RigidTransform

Mask = npt.NDArray[np.bool_]


def _free(picture: str) -> Mask:
    return np.array([[cell == "." for cell in line.strip()] for line in picture.split()])


def _grid(
    free: Mask, resolution_m: float = 1.0, origin: RigidTransform | None = None
) -> OccupancyGrid:
    cells = np.where(free, 0, 100).astype(np.int8)
    return OccupancyGrid(cells, resolution_m, origin or RigidTransform.identity(), "map")


def _clearance_m(free: Mask, resolution_m: float = 1.0) -> npt.NDArray[np.float64]:
    padded = np.pad(free, 1)
    return np.asarray(ndimage.distance_transform_edt(padded))[1:-1, 1:-1] * resolution_m


def _reachable(
    free: Mask, radius_m: float, resolution_m: float = 1.0, snap_m: float = 1.0
) -> ReachableRegion:
    clearance_m = _clearance_m(free, resolution_m)
    return ReachableRegion(_grid(free, resolution_m), free, clearance_m, radius_m, snap_m=snap_m)


def _slow_reachable(free: Mask, radius: float, start: tuple[int, int]) -> Mask:
    """Flood the eroded cells from the start, then mark every free cell within the radius."""
    eroded = free & (_clearance_m(free) >= radius)
    queue, seen = deque([start]), {start}
    while queue:
        row, col = queue.popleft()
        for cell in ((row + 1, col), (row - 1, col), (row, col + 1), (row, col - 1)):
            inside = 0 <= cell[0] < free.shape[0] and 0 <= cell[1] < free.shape[1]
            if inside and eroded[cell] and cell not in seen:
                seen.add(cell)
                queue.append(cell)
    grown = np.zeros_like(free)
    for row, col in np.argwhere(free):
        grown[row, col] = any((row - r) ** 2 + (col - c) ** 2 <= radius**2 for r, c in seen)
    return grown


TWO_ROOMS = """
#############
#.....#.....#
#.....#.....#
#...........#
#.....#.....#
#.....#.....#
#############
"""


def test_a_door_too_narrow_divides_the_rooms() -> None:
    """A door one cell wide lets a robot of radius 1 pass, and none of radius 1.5."""
    free = _free(TWO_ROOMS)
    everything = _reachable(free, 1.0).at((2.5, 3.5))
    assert everything.area_m2 == free.sum()
    left = _reachable(free, 1.5).at((3.5, 3.5)).mask
    assert left[:, :6].any()
    assert not left[:, 7:].any()


def test_the_region_is_the_opened_component() -> None:
    """Random clutter: flooding and growing cell by cell gives the same cells."""
    rng = np.random.default_rng(4)
    for radius in (0.0, 1.0, 1.5, 2.3):
        free = rng.random((26, 30)) > 0.04
        free[10:15, 10:15] = True
        expected = _slow_reachable(free, radius, (12, 12))
        np.testing.assert_array_equal(_reachable(free, radius).at((12.5, 12.5)).mask, expected)


def test_the_region_never_leaks_through_a_diagonal_wall() -> None:
    """A wall of cells that touch only at corners parts the space, however large the robot."""
    free = ~np.eye(30, dtype=np.bool_)
    below = np.tri(30, dtype=np.bool_)
    for radius in (0.0, 1.0, 2.0, 4.3):
        region = _reachable(free, radius).at((8.5, 21.5))
        assert region.mask.any()
        assert not (region.mask & ~below).any()


def test_a_robot_too_near_a_wall_takes_the_nearest_component() -> None:
    """Standing beside the eroded space it snaps to it; beyond the distance there is nothing."""
    free = _free(TWO_ROOMS)
    finder = _reachable(free, 1.5, snap_m=2.0)
    assert finder.at((11.9, 1.1)).mask[3, 9]
    assert _reachable(free, 1.5, snap_m=0.5).at((11.9, 1.1)).area_m2 == 0.0


def test_the_last_region_stays_when_the_robot_is_nowhere() -> None:
    """Unknown, undefined and far poses keep the region, and it is the same object."""
    finder = _reachable(_free(TWO_ROOMS), 1.5)
    assert finder.at(None).area_m2 == 0.0
    region = finder.at((3.5, 3.5))
    for point_m in ((3.6, 2.9), None, (1e12, 0.0), (-50.0, -50.0), (float("nan"), 0.0)):
        assert finder.at(point_m) is region
    assert finder.last_point_m == (3.6, 2.9)
    assert finder.at((9.5, 3.5)) is not region


def test_a_robot_between_two_components_meets_the_same_regions() -> None:
    """To and fro: each component's region is made once, and is the same object again."""
    finder = _reachable(_free(TWO_ROOMS), 1.5)
    left, right = finder.at((3.5, 3.5)), finder.at((9.5, 3.5))
    assert not (left.mask & right.mask).any()
    for _ in range(3):
        assert finder.at((3.4, 3.5)) is left
        assert finder.at((9.4, 3.5)) is right


def test_a_new_map_tries_the_last_point_of_the_old_one() -> None:
    """With the robot lost, the component that it was last seen in is taken over."""
    free = _free(TWO_ROOMS)
    grid, clearance_m = _grid(free), _clearance_m(free)
    finder = ReachableRegion(grid, free, clearance_m, 1.5, last_point_m=(9.5, 3.5))
    assert finder.at(None).mask[3, 9]


def test_no_spawn_is_cut_from_every_kind() -> None:
    """The forbidden square is missing, wherever artefacts may arrive otherwise."""
    free = np.ones((6, 6), np.bool_)
    square = np.array([[1.0, 1.0], [3.0, 1.0], [3.0, 3.0], [1.0, 3.0]])
    everywhere = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]])
    zones = Zones((Zone("all", everywhere),), (square,))
    for kind in Region:
        finder = region_finder(kind, _grid(free), free, _clearance_m(free), 0.5, zones=zones)
        region = finder.at((5.5, 5.5))
        assert region.area_m2 == 36 - 4, kind
        assert not region.mask[1:3, 1:3].any()


def test_zone_weights_make_the_effective_area() -> None:
    """Overlapping weights add, walls count nothing, the area is the sum over the cells."""
    free = np.ones((4, 8), np.bool_)
    free[0] = False
    left = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    wide = np.array([[0.5, 0.0], [4.0, 0.0], [4.0, 2.0], [0.5, 2.0]])
    zones = Zones((Zone("left", left, 3.0), Zone("wide", wide, 0.5)))
    finder = region_finder(
        Region.ZONES, _grid(free, 0.5), free, _clearance_m(free), 0.2, zones=zones
    )
    region = finder.at(None)
    assert region.weight is not None
    np.testing.assert_array_equal(region.weight[1], [3.0, 3.5, 3.5, 3.5, 0.5, 0.5, 0.5, 0.5])
    assert region.area_m2 == pytest.approx(3 * (3.0 + 3 * 3.5 + 4 * 0.5) * 0.25)
    np.testing.assert_array_equal(region.mask, region.weight > 0)
    assert not region.mask[0].any()


def test_a_turned_map_finds_the_robot() -> None:
    """The robot's point goes through the grid's origin: the room is the one it stands in."""
    free = _free(TWO_ROOMS)
    origin = RigidTransform.planar(10.0, -3.0, 2.1)
    grid = _grid(free, 0.5, origin)
    finder = region_finder(Region.REACHABLE, grid, free, _clearance_m(free, 0.5), 0.75)
    point = grid.cells_to_points([(3, 9)])[0]
    region = finder.at((float(point[0]), float(point[1])))
    assert region.mask[3, 9]
    assert not region.mask[3, 3]


def test_regions_are_read_only() -> None:
    """Nobody changes a region in place."""
    region = SpawnRegion(np.ones((2, 2), np.bool_), np.ones((2, 2), np.float32), 4.0)
    assert region.weight is not None
    assert not region.mask.flags.writeable
    assert not region.weight.flags.writeable


def test_the_hall_is_reachable(real_data: Path) -> None:
    """2051 x 765 cells: the robot in the hall reaches most of it."""
    grid = read_map_file(real_data / "drl-jarvis-hall" / "i-108_10mm.yaml", "map")
    free = np.ascontiguousarray(classify(grid, 65, 25).free)
    clearance_m = _clearance_m(free, grid.resolution_m)
    point = grid.cells_to_points(np.argwhere(clearance_m == clearance_m.max())[:1])[0]
    region = ReachableRegion(grid, free, clearance_m, 0.3).at((float(point[0]), float(point[1])))
    assert 100.0 < region.area_m2 <= free.sum() * grid.cell_area_m2
    assert not (region.mask & ~free).any()
