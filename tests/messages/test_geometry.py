"""Vectors and velocities of messages."""

from are_ros.messages.common import read_vector
from bags.simulation.making import RosbagsFactory, make_twist


def test_a_twist_holds_both_velocities(factory: RosbagsFactory) -> None:
    """Linear and angular velocity are not mixed up."""
    twist = make_twist(factory, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    assert read_vector(twist.linear) == (1.0, 2.0, 3.0)
    assert read_vector(twist.angular) == (4.0, 5.0, 6.0)
