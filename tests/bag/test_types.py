"""The types of messages that are known without a middleware."""

from are_ros.bag.types import jazzy_typestore, message_texts


def test_all_our_types_are_known() -> None:
    """Every definition that ARE brings along is registered, and so are those of ROS."""
    known = set(jazzy_typestore().types)
    assert set(message_texts()) <= known
    assert "nav_msgs/msg/OccupancyGrid" in known
