"""Number arrays of both kinds of message object."""

from array import array

import numpy as np
import pytest

from are_ros.messages.common import read_array


def test_an_array_of_rclpy_is_viewed() -> None:
    """What rclpy holds is shared, not copied."""
    data = array("b", [1, 2, 3])
    values = read_array(data, np.int8)
    data[0] = 7
    assert values.tolist() == [7, 2, 3]


def test_an_array_of_rosbags_is_the_same() -> None:
    """A numpy array of the right dtype comes back as it is."""
    data = np.arange(4, dtype=np.float32)
    assert read_array(data, np.float32) is data


@pytest.mark.parametrize("data", [b"", array("B"), np.zeros(0, np.uint8), []])
def test_empty_data_are_an_empty_array(data: object) -> None:
    """No data at all are no error."""
    values = read_array(data, np.uint8)
    assert values.shape == (0,)
    assert values.dtype == np.uint8


def test_bytes_are_unsigned() -> None:
    """Bytes are read as uint8, and as the signed ones where those are asked for."""
    assert read_array(b"\x00\xff", np.uint8).tolist() == [0, 255]
    assert read_array(b"\x00\xff", np.int8).tolist() == [0, -1]
