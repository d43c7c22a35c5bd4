"""Places: open points, well spread, the same for the same map."""

import itertools
import math

import hypothesis
import hypothesis.strategies as st
import numpy as np
import numpy.typing as npt
import pytest
from scipy import ndimage

from are_ros.agents.navigation.destinations import Destinations, destinations_in
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

Mask = npt.NDArray[np.bool_]


def clearance_of(free: Mask, resolution_m: float) -> npt.NDArray[np.float32]:
    """Return the distance from what is not free, the outside included."""
    field = ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]
    return np.asarray(field * resolution_m, dtype=np.float32)


def places_of(
    free: Mask, resolution_m: float = 0.1, origin: RigidTransform | None = None
) -> tuple[OccupancyGrid, Destinations]:
    """Return the grid and the places of a map whose region is all that is free."""
    cells = np.where(free, 0, 100).astype(np.int8)
    grid = OccupancyGrid(cells, resolution_m, origin or RigidTransform.identity(), "map")
    return grid, destinations_in(grid, free, clearance_of(free, resolution_m))


def hall(height: int = 200, width: int = 300) -> Mask:
    """Return a hall with a wall and a door in it."""
    free = np.ones((height, width), np.bool_)
    free[:, width // 2] = False
    free[height // 2 : height // 2 + 12, width // 2] = True
    return free


def test_a_hall_has_one_for_about_25_square_metres() -> None:
    """600 m^2 give 24 or less, inside, where a person has room, and no two are near each other."""
    free = hall()
    grid, places = places_of(free)
    points_m = places.destinations_m
    assert 20 <= len(points_m) <= 24
    cells = grid.points_to_cells(points_m)
    assert (clearance_of(free, 0.1)[cells[:, 0], cells[:, 1]] >= 0.34).all()
    apart_m = [math.dist(a, b) for a, b in itertools.combinations(points_m.tolist(), 2)]
    assert min(apart_m) > 2.5


def test_every_open_point_has_a_destination_near() -> None:
    """Nowhere in the hall is one farther than 6 m away."""
    grid, places = places_of(hall())
    everywhere_m = grid.cells_to_points(np.argwhere(hall()))[::97]
    offsets_m = everywhere_m[:, None] - places.destinations_m[None]
    assert np.hypot(*np.moveaxis(offsets_m, -1, 0)).min(axis=1).max() < 6.0


def test_destinations_are_off_the_walls() -> None:
    """Of each square metre the most open point is taken."""
    free = hall()
    grid, places = places_of(free)
    cells = grid.points_to_cells(places.destinations_m)
    assert clearance_of(free, 0.1)[cells[:, 0], cells[:, 1]].min() > 0.5


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, -2.5])
def test_a_rotated_origin_turns_the_places_with_the_map(yaw_rad: float) -> None:
    """The same cells are chosen, wherever the map lies."""
    origin = RigidTransform.planar(-3.0, 8.0, yaw_rad)
    turned, turned_places = places_of(hall(), origin=origin)
    straight, places = places_of(hall())
    np.testing.assert_array_equal(
        turned.points_to_cells(turned_places.destinations_m),
        straight.points_to_cells(places.destinations_m),
    )


def test_a_large_map_has_400_at_most() -> None:
    """90,000 m^2 at half a metre."""
    _, places = places_of(np.ones((600, 600), np.bool_), 0.5)
    assert len(places.destinations_m) == 400


@pytest.mark.parametrize("side_m", [30, 60, 300])
def test_trips_between_destinations_on_open_ground_go_in_all_directions(side_m: int) -> None:
    """Of the metres of trips of 3 to 40 m about 1/9 are within 5 degrees of an axis."""
    _, places = places_of(np.ones((2 * side_m, 2 * side_m), np.bool_), 0.5)
    offsets_m = places.destinations_m[:, None] - places.destinations_m[None]
    lengths_m = np.hypot(offsets_m[..., 0], offsets_m[..., 1])
    is_trip = (lengths_m >= 3.0) & (lengths_m <= 40.0)
    metres = np.where(is_trip, lengths_m, 0.0) / is_trip.sum(axis=1, keepdims=True)
    turned = np.degrees(np.arctan2(offsets_m[..., 1], offsets_m[..., 0])) % 90.0
    near = np.minimum(turned, 90.0 - turned) < 5.0
    assert abs((metres * near).sum() / metres.sum() - 1.0 / 9.0) < 0.03


def test_only_the_region_counts() -> None:
    """A free cell that is outside of the region is no destination."""
    free = hall()
    region = free.copy()
    region[:, 100:] = False
    cells = np.where(free, 0, 100).astype(np.int8)
    grid = OccupancyGrid(cells, 0.1, RigidTransform.identity(), "map")
    places = destinations_in(grid, region, clearance_of(free, 0.1))
    assert len(places.destinations_m) == 8
    assert places.destinations_m[:, 0].max() < 10.0


def test_exits_are_taken_as_they_are() -> None:
    """They come from elsewhere; without any there are none. All of it is read-only."""
    free = np.ones((20, 20), np.bool_)
    grid, places = places_of(free)
    assert places.exits_m.shape == (0, 2)
    exits_m = np.array([[1.0, 2.0]])
    places = destinations_in(grid, free, clearance_of(free, 0.1), exits_m=exits_m)
    np.testing.assert_array_equal(places.exits_m, [[1.0, 2.0]])
    assert not places.exits_m.flags.writeable
    assert not places.destinations_m.flags.writeable


@pytest.mark.parametrize(
    ("shape", "count"),
    [((1, 1), 0), ((5, 5), 0), ((8, 8), 1), ((12, 50), 4), ((12, 20), 2), ((3, 400), 0)],
)
def test_tiny_maps_have_as_many_as_there_is_room_for(shape: tuple[int, int], count: int) -> None:
    """Where no disc of 0.35 m fits there is none; a room of enough blocks has four."""
    _, places = places_of(np.ones(shape, np.bool_))
    assert len(places.destinations_m) == count


@hypothesis.settings(max_examples=40)
@hypothesis.given(
    height=st.integers(1, 60),
    width=st.integers(1, 60),
    resolution_m=st.sampled_from([0.05, 0.1, 0.3, 2.0]),
    seed=st.integers(0, 1000),
)
def test_places_are_few_different_inside_and_always_the_same(
    height: int, width: int, resolution_m: float, seed: int
) -> None:
    """On any map, also one coarser than the blocks."""
    free = np.random.default_rng(seed).random((height, width)) < 0.97
    grid, places = places_of(free, resolution_m)
    _, again = places_of(free, resolution_m)
    np.testing.assert_array_equal(places.destinations_m, again.destinations_m)
    cells = grid.points_to_cells(places.destinations_m)
    assert len(np.unique(cells, axis=0)) == len(cells) <= 400
    assert grid.contains(cells).all()
    assert free[cells[:, 0], cells[:, 1]].all()
    area_m2 = free.sum() * grid.cell_area_m2
    assert len(cells) <= max(4, math.ceil(area_m2 / 25.0))
