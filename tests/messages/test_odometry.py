"""Odometry messages."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from are_ros.bag.types import RosbagsFactory
from are_ros.errors import InputError
from are_ros.messages.odometry import OdometryReading, make_odometry, read_odometry
from are_ros.world.rigid_transform import RigidTransform

READING = OdometryReading(
    "odom", "base", 9, RigidTransform.planar(1.0, 2.0, 0.5), (0.4, 0.0, 0.0), (0.0, 0.0, 0.1)
)


def test_a_reading_comes_back(factory: RosbagsFactory, over_the_wire: Callable[[Any], Any]) -> None:
    """Frames, stamp, pose and velocities survive the wire."""
    back = read_odometry(over_the_wire(make_odometry(factory, READING)))
    assert (back.frame_id, back.child_frame_id, back.stamp_ns) == ("odom", "base", 9)
    np.testing.assert_array_equal(back.frame_from_child.matrix(), READING.frame_from_child.matrix())
    assert back.linear_velocity_m_s == (0.4, 0.0, 0.0)
    assert back.angular_velocity_rad_s == (0.0, 0.0, 0.1)


def test_an_empty_child_frame_is_kept(factory: RosbagsFactory) -> None:
    """A message that leaves its child frame out says so; slashes of ROS 1 go."""
    message = make_odometry(factory, READING)
    message.child_frame_id, message.header.frame_id = "", "/odom"
    reading = read_odometry(message)
    assert (reading.frame_id, reading.child_frame_id) == ("odom", "")


@pytest.mark.parametrize(
    ("path", "sentence"),
    [
        ("pose.pose.position", "/odom: pose.pose: "),
        ("twist.twist.linear", "/odom: twist.twist is not finite"),
        ("twist.twist.angular", "/odom: twist.twist is not finite"),
    ],
)
def test_numbers_that_are_not_finite_are_refused(
    factory: RosbagsFactory, path: str, sentence: str
) -> None:
    """NaN is refused with topic and field."""
    message: Any = make_odometry(factory, READING)
    part = message
    for name in path.split("."):
        part = getattr(part, name)
    part.y = float("nan")
    with pytest.raises(InputError) as caught:
        read_odometry(message, "/odom")
    assert str(caught.value).startswith(sentence)
