"""How ROS sees a parameter that is declared in the core: its type, value and descriptor."""

import sys
from typing import Any, Final

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.parameter import Parameter

from are_ros.parameters.declaration import Description, Value

_LARGEST_INTEGER: Final = 2**63 - 1
_TYPES: Final = {
    bool: Parameter.Type.BOOL,
    int: Parameter.Type.INTEGER,
    float: Parameter.Type.DOUBLE,
    str: Parameter.Type.STRING,
}


def ros_parameter(item: Description, value: Value) -> Parameter:
    """Return a parameter with a value, of the type of its default; an empty list has one too.

    rclpy on its own would take an empty list for a BYTE_ARRAY.
    """
    plain = list(value) if isinstance(value, tuple) else value
    return Parameter(item.path, ros_type(item), plain)


def ros_type(item: Description) -> Any:
    """Return the type of a parameter; a list is of strings unless its default holds numbers."""
    default = item.default
    if not isinstance(default, tuple):
        return _TYPES[type(default)]
    is_numbers = bool(default) and isinstance(default[0], float)
    return Parameter.Type.DOUBLE_ARRAY if is_numbers else Parameter.Type.STRING_ARRAY


def descriptor(item: Description, *, is_read_only: bool = False) -> ParameterDescriptor:
    """Return what tools show of a parameter: meaning, unit, choices, bounds, when it may change."""
    unit = f" [{item.unit}]" if item.unit else ""
    return ParameterDescriptor(
        name=item.path,
        type=ros_type(item).value,
        description=f"{item.text}{unit}",
        additional_constraints="; ".join(_constraints(item, is_read_only=is_read_only)),
        read_only=is_read_only,
        **_ranges(item),
    )


def _constraints(item: Description, *, is_read_only: bool) -> list[str]:
    """Return in words what a range cannot say."""
    found = []
    if item.choices:
        found.append(f"one of: {', '.join(item.choices)}")
    if isinstance(item.default, tuple) and item.low is not None and item.high is not None:
        found.append(f"each from {item.low:g} to {item.high:g}")
    if not item.live:
        found.append("read at the start only" if is_read_only else "takes effect at configure")
    return found


def _ranges(item: Description) -> dict[str, list[Any]]:
    """Return the range of a number, one of its ends the largest there is where it has none."""
    if item.low is None and item.high is None:
        return {}
    if isinstance(item.default, float):
        low, high = _ends(item, sys.float_info.max)
        return {"floating_point_range": [FloatingPointRange(from_value=low, to_value=high)]}
    if isinstance(item.default, int):
        low, high = _ends(item, _LARGEST_INTEGER)
        return {"integer_range": [IntegerRange(from_value=int(low), to_value=int(high))]}
    return {}


def _ends(item: Description, largest: float) -> tuple[float, float]:
    kind = type(largest)
    low = -largest if item.low is None else item.low
    high = largest if item.high is None else item.high
    return kind(low), kind(high)
