"""Paths, clicked points and stamped poses."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from are_ros.errors import InputError
from are_ros.messages.goals import (
    StampedPoints,
    read_clicked_point,
    read_path,
    read_stamped_pose,
)
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.making import (
    RosbagsFactory,
    make_clicked_point,
    make_header,
    make_path,
    make_pose,
)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_a_path_comes_back(
    factory: RosbagsFactory, over_the_wire: Callable[[Any], Any], count: int
) -> None:
    """The positions survive, none of them too: an empty path is a plan that failed."""
    path = StampedPoints("map", 4, np.arange(3.0 * count).reshape(count, 3))
    back = read_path(over_the_wire(make_path(factory, path)))
    np.testing.assert_array_equal(back.points_m, path.points_m)
    assert (back.frame_id, back.stamp_ns) == ("map", 4)


def test_a_click_comes_back(factory: RosbagsFactory) -> None:
    """The one point survives."""
    click = StampedPoints("map", 4, np.array([[1.0, 2.0, 3.0]]))
    back = read_clicked_point(make_clicked_point(factory, click))
    np.testing.assert_array_equal(back.points_m, click.points_m)


def test_positions_that_are_not_finite_are_refused(factory: RosbagsFactory) -> None:
    """The sentence names topic and field."""
    points = StampedPoints("map", 4, np.array([[np.nan, 2.0, 3.0]]))
    with pytest.raises(InputError, match=r"^/plan: poses holds"):
        read_path(make_path(factory, points), "/plan")
    with pytest.raises(InputError, match=r"^/clicked_point: point holds"):
        read_clicked_point(make_clicked_point(factory, points), "/clicked_point")


def test_positions_that_are_nowhere_on_earth_are_refused(factory: RosbagsFactory) -> None:
    """A sentence with such a number is 300 digits long."""
    points = StampedPoints("map", 4, np.array([[1e300, 2.0, 3.0]]))
    with pytest.raises(InputError, match=r"^/c: point holds a position farther than 1e\+09 m"):
        read_clicked_point(make_clicked_point(factory, points), "/c")


def test_a_stamped_pose_is_read(factory: RosbagsFactory) -> None:
    """Frame, stamp and pose of a request."""
    pose = RigidTransform.planar(1.0, 2.0, 0.5)
    message = factory.make(
        "geometry_msgs/msg/PoseStamped",
        header=make_header(factory, "map", 8),
        pose=make_pose(factory, pose),
    )
    frame_id, stamp_ns, read = read_stamped_pose(message, "spawn")
    assert (frame_id, stamp_ns) == ("map", 8)
    np.testing.assert_array_equal(read.matrix(), pose.matrix())
