"""The parameters of the core as ROS parameters of a node: declared, checked and changed."""

import sys
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from are_ros.errors import AreError, ParameterError
from are_ros.parameters.declaration import (
    Description,
    NodeParameters,
    Value,
    describe,
    plain,
    value_at,
    with_values,
)
from are_ros.parameters.model import Parameters
from are_ros.parameters.validation import validated

# How ROS sees a parameter that is declared in the core: its type, value and descriptor.


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


def descriptor(item: Description, *, is_read_only: bool) -> ParameterDescriptor:
    """Return the descriptor of a parameter: meaning, unit, choices, bounds, when it may change."""
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
    """Return the constraints that a range cannot express."""
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


_QOS_OVERRIDES: Final = "qos_overrides."


class ParameterBridge:
    """Declares the parameters on a node; `values` are the current ones, valid at any time.

    The values that parameter files and the command line give are taken at the start; ParameterError
    if one is wrong, unknown, or contradicts another. Later calls of the parameter services are
    accepted or refused as a whole. A refusal carries the sentence of the error. While `is_fixed()`,
    parameters that take effect at configure cannot change. `check(candidate)` raises an AreError if
    the running node cannot use the candidate; `on_change(values)` follows each accepted call.
    """

    def __init__(
        self,
        node: Node,
        is_fixed: Callable[[], bool],
        check: Callable[[Parameters], None],
        on_change: Callable[[Parameters], None],
    ) -> None:
        self._node = node
        self._is_fixed = is_fixed
        self._check = check
        self._on_change = on_change
        self._items = {item.path: item for item in describe(Parameters())}
        self._node_items = {item.path: item for item in describe(NodeParameters())}
        self._refusal: tuple[Parameter, str] | None = None
        given = _overrides(node, self._items | self._node_items)
        own = {path: given.pop(path) for path in self._node_items if path in given}
        self.node_values = with_values(NodeParameters(), own)
        self.values = validated(with_values(Parameters(), given))
        self._declare(self._node_items.values(), self.node_values, is_read_only=True)
        self._declare(self._items.values(), self.values, is_read_only=False)
        node.add_pre_set_parameters_callback(self._before_set)
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(self._after_set)

    def _declare(self, items: Iterable[Description], values: Any, *, is_read_only: bool) -> None:
        for item in items:
            parameter = ros_parameter(item, plain(value_at(values, item.path)))
            shown = descriptor(item, is_read_only=is_read_only)
            is_empty_list = parameter.value == []
            declared = ros_type(item) if is_empty_list else parameter.value
            self._node.declare_parameter(item.path, declared, shown, ignore_override=True)
            if is_empty_list:
                self._node.set_parameters([parameter])

    def _before_set(self, given: Sequence[Parameter]) -> list[Parameter]:
        """Check a call before rclpy does, and give each value the type of its parameter.

        So `mean_life: 60` stays a float, and a refused call changes nothing (with dynamic typing,
        rclpy changes the type before it refuses the value). A refused call is replaced by setting
        one parameter to its current value, which `_on_set` then refuses with the reason.
        """
        try:
            accepted = self._accepted(given)
        except AreError as cause:
            stand_in = self._as_is(next(iter(self._items.values())), self.values)
            self._refusal = (stand_in, str(cause))
            return [stand_in]
        return [
            self._as_is(self._items[one.name], accepted) if one.name in self._items else one
            for one in given
        ]

    def _on_set(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        if self._refusal is not None:
            stand_in, reason = self._refusal
            if any(one is stand_in for one in parameters):
                self._refusal = None
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

    def _after_set(self, parameters: Sequence[Parameter]) -> None:
        changes = {one.name: one.value for one in parameters if one.name in self._items}
        if changes:
            self.values = validated(with_values(self.values, changes))
            self._on_change(self.values)

    def _accepted(self, given: Sequence[Parameter]) -> Parameters:
        """Return the values with those given; AreError if the call must be refused."""
        known = self._items.keys() | self._node_items.keys()
        # What rclpy or other code has declared is theirs.
        own = [one for one in given if one.name in known or not self._node.has_parameter(one.name)]
        changes = {one.name: _value_of(one) for one in own}
        for path, value in changes.items():
            if path in self._node_items:
                raise ParameterError(f"parameter '{path}': it is read at the start only")
            if value is None and path in self._items:
                raise ParameterError(f"parameter '{path}': it cannot be deleted")
        candidate = validated(with_values(self.values, changes))
        if self._is_fixed():
            self._check_live(candidate)
        if candidate != self.values:
            self._check(candidate)
        return candidate

    def _check_live(self, candidate: Parameters) -> None:
        for path, item in self._items.items():
            if not item.live and value_at(candidate, path) != value_at(self.values, path):
                name = self._node.get_fully_qualified_name()
                message = (
                    f"parameter '{path}': it takes effect at configure; clean up the node first (if"
                    f" it is active: ros2 lifecycle set {name} deactivate; then the same with"
                    " cleanup)"
                )
                raise ParameterError(message)

    def _as_is(self, item: Description, values: Parameters) -> Parameter:
        return ros_parameter(item, plain(value_at(values, item.path)))


def _value_of(parameter: Parameter) -> Any:
    """Return a value as YAML has it: a list where rclpy has an array of Python's."""
    value = parameter.value
    return value.tolist() if isinstance(value, array) else value


def _overrides(node: Node, items: Mapping[str, Description]) -> dict[str, Any]:
    """Return the values that files and command line give, but for those that are rclpy's own.

    An empty list comes without a type, as if there were no value.
    """
    given: Mapping[str, Parameter] = node._parameter_overrides  # noqa: SLF001 - it has no other name
    values = {
        name: _value_of(parameter)
        for name, parameter in given.items()
        if not name.startswith(_QOS_OVERRIDES) and not node.has_parameter(name)
    }
    for name, value in values.items():
        if value is None and name in items:
            if not isinstance(items[name].default, tuple):
                raise ParameterError(f"parameter '{name}': it is given no value")
            values[name] = ()
    return values
