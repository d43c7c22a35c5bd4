"""Poses of messages."""

import math

import numpy as np
import pytest

from are_ros.errors import InputError
from are_ros.messages.common import read_pose
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.making import RosbagsFactory, make_pose


def test_a_pose_comes_back(factory: RosbagsFactory) -> None:
    """Position and orientation survive to the bit."""
    pose = RigidTransform.from_xyz_ypr(1.0, -2.0, 0.5, 0.3, -0.2, 0.1)
    back = read_pose(make_pose(factory, pose), "pose", "odom")
    np.testing.assert_array_equal(back.translation_m, pose.translation_m)
    np.testing.assert_array_equal(back.rotation_xyzw, pose.rotation_xyzw)


@pytest.mark.parametrize(
    ("field", "value"), [("position", math.nan), ("position", math.inf), ("orientation", 0.0)]
)
def test_a_pose_that_is_none_is_refused(factory: RosbagsFactory, field: str, value: float) -> None:
    """NaN, infinity and a rotation of length zero are named with topic and field."""
    pose = make_pose(factory, RigidTransform.identity())
    part = getattr(pose, field)
    part.x = part.y = part.z = value
    if field == "orientation":
        part.w = value
    with pytest.raises(InputError, match=r"^/odom: pose\.pose: "):
        read_pose(pose, "pose.pose", "/odom")
