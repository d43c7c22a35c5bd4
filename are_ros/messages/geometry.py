"""Points, rotations and velocities of geometry_msgs as plain numbers."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.messages.factory import MessageFactory

Vector3 = tuple[float, float, float]
Values = Sequence[float] | npt.NDArray[np.float64]


def read_vector(vector: Any) -> Vector3:
    """Return x, y, z of a Point or a Vector3, whatever they are."""
    return vector.x, vector.y, vector.z


def make_point(factory: MessageFactory, xyz_m: Values) -> Any:
    """Return a geometry_msgs/Point of three metres."""
    x, y, z = xyz_m
    return factory.make("geometry_msgs/msg/Point", x=float(x), y=float(y), z=float(z))


def make_vector(factory: MessageFactory, xyz: Values) -> Any:
    """Return a geometry_msgs/Vector3."""
    x, y, z = xyz
    return factory.make("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))


def make_quaternion(factory: MessageFactory, xyzw: Values) -> Any:
    """Return a geometry_msgs/Quaternion."""
    x, y, z, w = xyzw
    return factory.make(
        "geometry_msgs/msg/Quaternion", x=float(x), y=float(y), z=float(z), w=float(w)
    )


def make_twist(factory: MessageFactory, linear_m_s: Values, angular_rad_s: Values) -> Any:
    """Return a geometry_msgs/Twist."""
    return factory.make(
        "geometry_msgs/msg/Twist",
        linear=make_vector(factory, linear_m_s),
        angular=make_vector(factory, angular_rad_s),
    )
