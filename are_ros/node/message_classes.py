"""The message and service classes of rclpy, found by name, and messages built from numpy values."""

import operator
from array import array
from functools import cache
from importlib import import_module
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import NodeError

_BUILT_HERE: Final = ("are_msgs",)
_COMPAT: Final = ("map_msgs", "tf2_msgs", "vision_msgs")
_PROJECT: Final = "'make setup' in the project builds it"


def message_class(type_name: str) -> Any:
    """Return the class of a message, as of "nav_msgs/msg/OccupancyGrid"; NodeError if it is absent.

    The error names the command that brings the package.
    """
    return _class(type_name, "msg")


def service_class(type_name: str) -> Any:
    """Return the class of a service, as of "are_msgs/srv/SpawnArtefact"; NodeError if absent."""
    return _class(type_name, "srv")


class RclpyFactory:
    """A `MessageFactory` of rclpy objects, for the few messages that are not encoded to bytes."""

    def make(self, type_name: str, /, **fields: Any) -> Any:
        """Return a new message; AttributeError for a field of no such name.

        Arrays of numbers must have the field's dtype (TypeError); they are copied. AssertionError
        for a value of another kind than the field's.
        """
        message = message_class(type_name)(check_fields=True)
        for name, value in fields.items():
            setattr(message, name, _as_field(getattr(message, name), value))
        return message


@cache
def _class(type_name: str, kind: str) -> Any:
    package, _, rest = type_name.partition("/")
    if rest.partition("/")[0] != kind:
        raise NodeError(f"'{type_name}' is no name of a type: it reads package/{kind}/Name")
    name = rest.partition("/")[2]
    try:
        module = import_module(f"{package}.{kind}")
    except ModuleNotFoundError as cause:
        raise NodeError(f"{type_name}: {package} is not installed; {_remedy(package)}") from cause
    try:
        return getattr(module, name)
    except AttributeError as cause:
        message = f"{type_name}: the {package} installed is another one; {_remedy(package)}"
        raise NodeError(message) from cause


def _remedy(package: str) -> str:
    """Return which command brings a package of messages."""
    if package in _BUILT_HERE:
        return f"'colcon build' in the workspace builds it, and {_PROJECT} where there is no ROS"
    install = f"'sudo apt install ros-jazzy-{package.replace('_', '-')}' installs it"
    return f"{install}, and {_PROJECT} where there is no ROS" if package in _COMPAT else install


def _as_field(default: Any, value: Any) -> Any:
    """Return a value as rclpy wants it for a field that has this default.

    Without its checks, rclpy would read an int in a field of floats as if it were one.
    """
    if isinstance(value, np.ndarray) and not isinstance(default, np.ndarray):
        return _as_array(default, value)
    if isinstance(default, bytes):
        return bytes([operator.index(value)])
    if isinstance(default, float):
        return float(value)
    if isinstance(default, int) and not isinstance(default, bool):
        return operator.index(value)
    return value


def _as_array(default: Any, values: npt.NDArray[Any]) -> Any:
    """Return numbers as an `array.array`, where the field holds one; else as a list."""
    if not isinstance(default, array):
        return values.tolist()
    if np.dtype(default.typecode) != values.dtype:
        raise TypeError(f"an array of {values.dtype} for a field of {np.dtype(default.typecode)}")
    filled = array(default.typecode)
    filled.frombytes(values.tobytes())
    return filled
