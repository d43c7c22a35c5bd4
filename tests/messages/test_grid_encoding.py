"""Occupancy grids and their updates as bytes."""

import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.builder.costmap.augmented_map import ChangedRectangle, GridUpdate
from are_ros.messages.maps import encode_grid, encode_grid_update
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.making import RosbagsFactory, make_grid, make_header

FRAMES = st.sampled_from(["map", "m", "a_map", "Bühne"])
STAMPS = st.integers(0, 2 * 10**18)


def cells_of(rows: int, columns: int) -> Any:
    """Return different cells."""
    return (np.arange(rows * columns) % 102 - 1).astype(np.int8).reshape(rows, columns)


def make_grid_update(factory: RosbagsFactory, update: GridUpdate) -> Any:
    """Return the message of an update."""
    rows, columns = update.cells.shape
    return factory.make(
        "map_msgs/msg/OccupancyGridUpdate",
        header=make_header(factory, update.frame_id, update.stamp_ns),
        x=update.rectangle.col0,
        y=update.rectangle.row0,
        width=columns,
        height=rows,
        data=update.cells.reshape(-1),
    )


@given(frame_id=FRAMES, stamp_ns=STAMPS, rows=st.integers(1, 5), columns=st.integers(1, 5))
def test_the_bytes_of_a_grid_are_those_of_the_message(
    on_the_wire: Callable[[Any], bytes],
    factory: RosbagsFactory,
    frame_id: str,
    stamp_ns: int,
    rows: int,
    columns: int,
) -> None:
    """Encoding directly and serialising the object give the same."""
    origin = RigidTransform.planar(1.0, -2.0, 0.5)
    grid = OccupancyGrid(cells_of(rows, columns), 0.05, origin, frame_id, stamp_ns)
    assert encode_grid(grid) == on_the_wire(make_grid(factory, grid))


@given(frame_id=FRAMES, stamp_ns=STAMPS, rows=st.integers(1, 5), columns=st.integers(1, 5))
def test_the_bytes_of_an_update_are_those_of_the_message(
    on_the_wire: Callable[[Any], bytes],
    factory: RosbagsFactory,
    frame_id: str,
    stamp_ns: int,
    rows: int,
    columns: int,
) -> None:
    """Also of cells that are a part of a larger grid."""
    part = cells_of(7, 9)[1 : 1 + rows, 2 : 2 + columns]
    where = ChangedRectangle(1, 2, 1 + rows, 2 + columns)
    update = GridUpdate(frame_id, stamp_ns, where, part)
    assert encode_grid_update(update) == on_the_wire(make_grid_update(factory, update))


def test_rclpy_reads_them(both_readings: Callable[[bytes, str], tuple[Any, Any]]) -> None:
    """Field by field what rosbags reads; x is the column and y the row."""
    grid = OccupancyGrid(cells_of(2, 3), 0.5, RigidTransform.planar(1.0, 2.0, 0.5), "map", 7)
    by_rclpy, by_rosbags = both_readings(encode_grid(grid), "nav_msgs/msg/OccupancyGrid")
    assert by_rclpy == by_rosbags
    assert (by_rclpy["info"]["width"], by_rclpy["info"]["height"]) == ("3.0", "2.0")
    update = GridUpdate("map", 7, ChangedRectangle(5, 9, 7, 12), cells_of(2, 3))
    type_name = "map_msgs/msg/OccupancyGridUpdate"
    by_rclpy, by_rosbags = both_readings(encode_grid_update(update), type_name)
    assert by_rclpy == by_rosbags
    assert (by_rclpy["x"], by_rclpy["y"]) == ("9.0", "5.0")
    assert by_rclpy["data"] == ["-1.0", "0.0", "1.0", "2.0", "3.0", "4.0"]


def test_cells_are_copied_once() -> None:
    """No more memory is taken on the way than the message has itself."""
    grid = OccupancyGrid(np.zeros((1000, 1000), np.int8), 0.05, RigidTransform.identity(), "map")
    tracemalloc.start()
    try:
        data = encode_grid(grid)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak == pytest.approx(len(data), rel=0.01)
