"""Terrains: what voxels close for bodies of a height, and what can be seen."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.agents.navigation.terrain import Terrain, Terrains, farthest
from are_ros.world.boxes import OrientedBoxes, overlaps_any
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap
from tests.agents.floors import terrain_of
from tests.agents.local_planner.streets import CELL_M, environment, room, wall


def _voxels(yaw_rad: float = 0.3) -> VoxelMap:
    """Return some voxels of 8 cm on a turned lattice: one on the floor, a table, a lamp."""
    occupied = np.zeros((20, 20, 30), np.uint8)
    occupied[2, 3, 0] = 1  # its top is 8 cm high
    occupied[10, 5, 8] = 1  # from 0.64 m
    occupied[6, 14, 24] = 1  # from 1.92 m
    return VoxelMap(RigidTransform.planar(0.6, 0.4, yaw_rad), (0.08, 0.08, 0.08), occupied)


def test_a_grid_alone_lends_its_own_clearance_to_all_heights() -> None:
    """With no voxels of its own the environment's field serves everybody."""
    here = environment(room(4.0, 3.0))
    terrains = Terrains()
    assert terrains.of(here, 0.2) is terrains.of(here, 2.0)
    assert terrains.of(here, 1.0).clearance_m is here.clearance_m
    assert terrains.of(here, 1.0).solid is here.classes.occupied


def test_heights_are_rounded_up_and_a_new_environment_makes_new_terrains() -> None:
    """Terrains are shared by bodies of like height, and never outlive their environment."""
    terrains = Terrains()
    here = environment(room(4.0, 3.0), voxels=_voxels())
    assert terrains.of(here, 1.6) is terrains.of(here, 1.75)
    assert terrains.of(here, 1.6).height_m == 1.75
    assert terrains.of(here, 1.8) is not terrains.of(here, 1.6)
    assert terrains.of(environment(room(4.0, 3.0), voxels=_voxels()), 1.6).height_m == 1.75


@pytest.mark.parametrize(("height_m", "yaw_rad"), [(0.5, 0.3), (1.75, 0.3), (2.0, -1.0)])
def test_cells_under_voxels_in_the_way_are_closed(height_m: float, yaw_rad: float) -> None:
    """Each cell is solid just if a box on it, as high as the body, meets a voxel."""
    voxels = _voxels(yaw_rad)
    here = environment(room(3.0, 3.0), (-0.5, -0.4, 0.2), voxels)
    terrain = Terrain(here, height_m)
    rows, cols = np.indices(here.grid.cells.shape)
    centres = here.grid.cells_to_points(np.column_stack((rows.ravel(), cols.ravel())))
    low, high = here.ground_clearance_m, height_m
    cells = OrientedBoxes(
        np.column_stack((centres, np.full(len(centres), 0.5 * (low + high)))),
        np.full(len(centres), 0.2),
        np.full((len(centres), 3), (0.5 * CELL_M, 0.5 * CELL_M, 0.5 * (high - low))),
    )
    where = np.argwhere(voxels.occupied) * 0.08 + 0.04
    stones = OrientedBoxes(
        voxels.map_from_lattice.apply(where),
        np.full(len(where), yaw_rad),
        np.full((len(where), 3), 0.04),
    )
    expected = overlaps_any(cells, stones).reshape(terrain.solid.shape)
    assert (terrain.solid == (expected | here.classes.occupied)).all()
    assert ((terrain.clearance_m == 0.0) == (expected | ~here.classes.free)).all()


def test_clearance_is_the_distance_to_the_nearest_closed_cell() -> None:
    """The field with voxels agrees with a search over all closed cells."""
    here = environment(room(3.0, 2.0), voxels=_voxels())
    terrain = Terrain(here, 1.75)
    closed = np.argwhere(np.pad(terrain.clearance_m == 0.0, 1, constant_values=True)) - 1
    for cell in ((10, 10), (30, 22), (20, 40)):
        nearest = float(np.hypot(*(closed - cell).T).min()) * CELL_M
        assert terrain.clearance_m[cell] == pytest.approx(nearest, rel=1e-5)


def test_a_disc_rolls_through_a_door_that_is_wide_enough() -> None:
    """The segment is clear for what is narrower than the door, and blocked for what is wider."""
    cells = room(6.0, 4.0)
    wall(cells, (2.95, 3.05), (0.0, 1.5))
    wall(cells, (2.95, 3.05), (2.5, 4.0))
    terrain = Terrain(environment(cells, (2.0, 1.0, 0.0)), 1.7)
    assert terrain.sees((3.0, 3.0), (7.0, 3.0), 0.45)
    assert not terrain.sees((3.0, 3.0), (7.0, 3.0), 0.55)
    assert not terrain.sees((3.0, 2.0), (7.0, 2.0), 0.1)
    assert terrain.sees((3.0, 3.0), (3.0, 3.0), 0.4)
    assert not terrain.sees((3.0, 3.0), (30.0, 3.0), 0.1)


@given(
    st.tuples(st.floats(0.0, 4.0), st.floats(0.0, 3.0)),
    st.tuples(st.floats(0.0, 4.0), st.floats(0.0, 3.0)),
    st.floats(0.0, 0.6),
)
def test_seeing_agrees_with_discs_along_the_segment(
    start: tuple[float, float], end: tuple[float, float], radius_m: float
) -> None:
    """Clear segments hold no disc far in a wall; blocked ones hold one that is too near one."""
    cells = room(4.0, 3.0)
    wall(cells, (1.9, 2.0), (0.0, 1.7))
    closed = (np.argwhere(cells != 0)[:, ::-1] + 0.5) * CELL_M
    shares = np.linspace(0.0, 1.0, 1 + int(math.dist(start, end) / 0.01))[:, None]
    points = np.array(start) + shares * (np.array(end) - start)
    gaps = np.abs(points[:, None] - closed) - 0.5 * CELL_M
    least = np.hypot(*np.moveaxis(np.maximum(gaps, 0.0), -1, 0)).min() - radius_m
    terrain = Terrain(environment(cells), 1.7)
    seen = terrain.sees(start, end, radius_m)
    assert seen or least < 0.06
    assert not seen or least > -0.04


@given(
    st.tuples(st.floats(0.0, 4.0), st.floats(0.0, 3.0)),
    st.floats(0.05, 0.6),
)
def test_who_is_seen_on_the_spot_covers_nothing_closed(
    point: tuple[float, float], radius_m: float
) -> None:
    """Exactly those discs that meet no closed cell's square."""
    cells = room(4.0, 3.0)
    wall(cells, (1.9, 2.0), (0.0, 1.7))
    closed = np.argwhere(np.pad(cells, 1, constant_values=100) != 0)[:, ::-1] - 1
    gaps = np.abs(point - (closed + 0.5) * CELL_M) - 0.5 * CELL_M
    least = np.hypot(*np.maximum(gaps, 0.0).T).min() - radius_m
    seen = Terrain(environment(cells), 1.7).sees(point, point, radius_m)
    assert seen == (least >= 0.0) or abs(least) < 1e-6


@given(st.integers(0, 10**6), st.integers(1, 90))
def test_what_is_aimed_at_on_a_way_is_seen_and_the_next_point_is_not(seed: int, count: int) -> None:
    """Of random ways among random walls; the end if all is seen, the first point if none is."""
    random = np.random.default_rng(seed)
    terrain = terrain_of(random.random((60, 60)) < 0.003 * random.random())
    start_m, angle = np.array((1.5, 1.5)), random.uniform(0.0, math.tau)
    turns = angle + np.cumsum(random.normal(0.0, 0.1, count))
    way_m = start_m + 0.02 * np.cumsum(np.column_stack((np.cos(turns), np.sin(turns))), axis=0)
    here_m = (start_m[0], start_m[1])
    seen = [terrain.sees(here_m, (x_m, y_m), 0.1) for x_m, y_m in way_m.tolist()]
    found = farthest(terrain.clearance_m, terrain.lattice, here_m, way_m, 0.1)
    assert seen[found] or found == 0
    assert found == count - 1 or not seen[found + 1]
    assert found == count - 1 or not all(seen)
