"""The message and service classes of rclpy, found by name."""

from functools import cache
from importlib import import_module
from typing import Any, Final

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
