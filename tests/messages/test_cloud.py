"""Point clouds of any layout."""

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.errors import InputError
from are_ros.messages.sensors import encode_cloud, read_cloud
from bags.simulation.making import RosbagsFactory, make_cloud

FACTORY = RosbagsFactory()


def packed_cloud(
    points: np.ndarray[Any, Any],
    *,
    order: tuple[str, ...] = ("x", "y", "z", "intensity"),
    kinds: tuple[int, ...] = (7, 7, 7, 7),
    gaps: tuple[int, ...] = (0, 0, 0, 0),
    is_bigendian: bool = False,
    row_padding: int = 0,
) -> Any:
    """Return a cloud packed value by value; `points` is (height, width, 3)."""
    letters = {7: "f", 8: "d"}
    fields, offset = [], 0
    for name, kind, gap in zip(order, kinds, gaps, strict=True):
        offset += gap
        fields.append(
            FACTORY.make(
                "sensor_msgs/msg/PointField", name=name, offset=offset, datatype=kind, count=1
            )
        )
        offset += struct.calcsize(letters[kind])
    data = bytearray()
    for row in points:
        for point in row:
            values = dict(zip("xyz", point, strict=True)) | {"intensity": 9.0}
            one = bytearray(offset)
            for field in fields:
                code = (">" if is_bigendian else "<") + letters[field.datatype]
                struct.pack_into(code, one, field.offset, values[field.name])
            data += one
        data += bytes(row_padding)
    height, width = points.shape[:2]
    return FACTORY.make(
        "sensor_msgs/msg/PointCloud2",
        header=FACTORY.make("std_msgs/msg/Header", frame_id="laser"),
        height=height,
        width=width,
        fields=fields,
        is_bigendian=is_bigendian,
        point_step=offset,
        row_step=offset * width + row_padding,
        data=np.frombuffer(bytes(data), np.uint8),
        is_dense=True,
    )


LAYOUTS: dict[str, Any] = {
    "usual": {},
    "doubles": {"kinds": (8, 8, 8, 7)},
    "padded": {"gaps": (0, 0, 0, 4), "row_padding": 5},
    "big-endian": {"is_bigendian": True},
    "mixed": {"order": ("intensity", "z", "x", "y"), "gaps": (1, 2, 3, 0)},
}


@pytest.mark.parametrize("name", list(LAYOUTS))
@pytest.mark.parametrize("shape", [(1, 7), (3, 4), (1, 0), (0, 0)])
def test_what_comes_in_goes_out_byte_for_byte(
    on_the_wire: Callable[[Any], bytes], name: str, shape: tuple[int, int]
) -> None:
    """A cloud that no artefact changes is the message that came, padding included."""
    points = np.random.default_rng(2).normal(size=(*shape, 3))
    message = packed_cloud(points, **LAYOUTS[name])
    assert encode_cloud(read_cloud(message)) == on_the_wire(message)


def test_rclpy_reads_it(both_readings: Callable[[bytes, str], tuple[Any, Any]]) -> None:
    """Field by field what rosbags reads."""
    message = packed_cloud(np.ones((2, 3, 3)), row_padding=3)
    data = encode_cloud(read_cloud(message))
    by_rclpy, by_rosbags = both_readings(data, "sensor_msgs/msg/PointCloud2")
    assert by_rclpy == by_rosbags
    assert (by_rclpy["width"], by_rclpy["row_step"]) == ("3.0", "51.0")


@given(
    order=st.permutations(["x", "y", "z", "intensity"]),
    kinds=st.lists(st.sampled_from([7, 8]), min_size=4, max_size=4),
    gaps=st.lists(st.integers(0, 5), min_size=4, max_size=4),
    is_bigendian=st.booleans(),
    row_padding=st.integers(0, 7),
    shape=st.tuples(st.integers(0, 3), st.integers(0, 4)),
)
def test_every_layout_gives_the_points(
    order: list[str],
    kinds: list[int],
    gaps: list[int],
    is_bigendian: bool,
    row_padding: int,
    shape: tuple[int, int],
) -> None:
    """Order, offsets, kinds, byte order and padding do not matter."""
    points = np.random.default_rng(0).integers(-99, 99, (*shape, 3)) / 8
    message = packed_cloud(
        points,
        order=tuple(order),
        kinds=tuple(kinds),
        gaps=tuple(gaps),
        is_bigendian=is_bigendian,
        row_padding=row_padding,
    )
    read = read_cloud(message).points_m()
    np.testing.assert_array_equal(read, points.reshape(-1, 3))
    wide = any(kind == 8 for name, kind in zip(order, kinds, strict=True) if name in "xyz")
    assert read.dtype == (np.float64 if wide else np.float32)


def test_a_cloud_comes_back(over_the_wire: Callable[[Any], Any]) -> None:
    """Points written by us are read again, NaN among them."""
    points = np.array([[1.0, 2.0, 3.0], [np.nan, 0.0, -1.0]], dtype=np.float32)
    message = over_the_wire(make_cloud(FACTORY, "map", 5, points))
    np.testing.assert_array_equal(read_cloud(message).points_m(), points)
    assert (message.header.frame_id, message.is_dense, message.width) == ("map", False, 2)


@pytest.mark.parametrize(
    ("field", "value", "sentence"),
    [
        ("data", np.zeros(95, np.uint8), "data has 95 bytes, but height 2 x row_step 48 = 96"),
        ("row_step", 47, "row_step 47 is less than width 3 x point_step 16"),
        ("point_step", 11, "field z ends beyond point_step 11"),
        ("fields", [], "fields have no x of one float32 or float64 (none)"),
    ],
)
def test_a_malformed_cloud_is_refused(field: str, value: object, sentence: str) -> None:
    """Sizes that contradict each other are named."""
    message = packed_cloud(np.zeros((2, 3, 3)))
    setattr(message, field, value)
    with pytest.raises(InputError) as caught:
        read_cloud(message, "/points").points_m()
    assert str(caught.value) == f"/points: {sentence}"


def test_integers_are_no_coordinates() -> None:
    """A cloud whose y is an integer is refused."""
    message = packed_cloud(np.zeros((1, 1, 3)))
    message.fields[1].datatype = 5
    with pytest.raises(InputError, match="fields have no y of one float32"):
        read_cloud(message).points_m()


def test_a_coordinate_that_is_there_twice_is_refused() -> None:
    """Nobody knows which one is meant."""
    message = packed_cloud(np.ones((1, 2, 3)), order=("x", "y", "z", "intensity"))
    message.fields[3].name = "x"
    with pytest.raises(InputError, match="points: fields have more than one x"):
        read_cloud(message, "points")
