"""Odometry messages."""

from collections.abc import Callable
from typing import Any

from are_ros.messages.transforms import OdometryNumbers, read_odometry_numbers
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.making import OdometryReading, RosbagsFactory, make_odometry

POSE = RigidTransform.planar(1.0, 2.0, 0.5)
READING = OdometryReading("odom", "", 9, POSE, (0.4, 0.0, 0.0), (0.0, 0.0, 0.1))


def test_a_reading_comes_back(factory: RosbagsFactory, over_the_wire: Callable[[Any], Any]) -> None:
    """Frames, stamp and pose survive the wire, an empty child frame too."""
    numbers = (*POSE.translation_m.tolist(), *POSE.rotation_xyzw.tolist())
    back = read_odometry_numbers(over_the_wire(make_odometry(factory, READING)))
    assert back == OdometryNumbers("odom", "", 9, numbers)
