"""Occupancy grids as messages."""

from array import array
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from are_ros.errors import InputError
from are_ros.messages.maps import read_grid
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.making import RosbagsFactory, make_grid

CELLS = np.array([[-1, 0, 100], [50, 0, -1]], dtype=np.int8)


@pytest.fixture
def grid() -> OccupancyGrid:
    """Return a grid of 2 x 3 cells with a turned origin."""
    return OccupancyGrid(CELLS, 0.25, RigidTransform.planar(1.0, -2.0, 0.5), "map", 7_000_000_001)


def test_a_grid_comes_back(
    factory: RosbagsFactory, over_the_wire: Callable[[Any], Any], grid: OccupancyGrid
) -> None:
    """Cells, geometry, frame and stamp survive the wire."""
    back = read_grid(over_the_wire(make_grid(factory, grid)))
    np.testing.assert_array_equal(back.cells, grid.cells)
    np.testing.assert_allclose(back.origin.matrix(), grid.origin.matrix(), atol=1e-15)
    assert (back.resolution_m, back.frame_id, back.stamp_ns) == (0.25, "map", 7_000_000_001)


def test_rows_follow_each_other_in_the_data(factory: RosbagsFactory, grid: OccupancyGrid) -> None:
    """The data are the rows from the origin on."""
    assert make_grid(factory, grid).data.tolist() == [-1, 0, 100, 50, 0, -1]


def test_a_grid_of_rclpy_is_read(factory: RosbagsFactory, grid: OccupancyGrid) -> None:
    """Data as an `array.array` give the same grid."""
    message = make_grid(factory, grid)
    message.data = array("b", message.data.tolist())
    np.testing.assert_array_equal(read_grid(message).cells, CELLS)


def test_the_grid_does_not_change_with_its_message(
    factory: RosbagsFactory, grid: OccupancyGrid
) -> None:
    """A grid keeps its cells when the message's buffer is used again."""
    message = make_grid(factory, grid)
    message.data = message.data.copy()
    read = read_grid(message)
    message.data[:] = 0
    np.testing.assert_array_equal(read.cells, CELLS)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda m: setattr(m.info, "resolution", 0.0), ": resolution is "),
        (lambda m: setattr(m.info, "resolution", float("nan")), ": resolution is "),
        (lambda m: setattr(m.info, "width", 4), "data has 6 cells"),
        (lambda m: setattr(m.info, "height", 0), ": height is "),
        (lambda m: setattr(m.info.origin.position, "x", float("nan")), "info.origin.position"),
        (lambda m: setattr(m.info.origin.orientation, "w", 0.0), "info.origin.orientation"),
        (lambda m: setattr(m.header, "frame_id", ""), "header.frame_id"),
        (lambda m: setattr(m, "data", np.full(6, 101, np.int8)), "101"),
    ],
)
def test_a_malformed_grid_is_refused(
    factory: RosbagsFactory,
    grid: OccupancyGrid,
    change: Callable[[SimpleNamespace], None],
    sentence: str,
) -> None:
    """Each fault is refused with topic and field."""
    message = make_grid(factory, grid)
    change(message)
    with pytest.raises(InputError) as caught:
        read_grid(message, "/map")
    assert str(caught.value).startswith("/map: ")
    assert sentence in str(caught.value)
