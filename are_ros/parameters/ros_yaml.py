"""The `ros__parameters` file of node and replay, and `name:=value` of a command line."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from are_ros.errors import ParameterError
from are_ros.parameters.declaration import Value, describe, flatten
from are_ros.parameters.model import Parameters
from are_ros.parameters.node_parameters import NodeParameters
from are_ros.yaml_text import parse_yaml, read_yaml

_NODE = "ar_builder"


_OF_ROS_ITSELF = ("use_sim_time", "qos_overrides", "start_type_description_service")
_OF_THE_NODE = tuple(item.path for item in describe(NodeParameters()))


def read_ros_parameters(path: Path) -> dict[str, Any]:
    """Return the values by path that a file gives to the node `ar_builder`.

    Sections `/**`, `ar_builder` and any `/name/space/ar_builder` count, later ones win; names that
    rclpy itself owns (use_sim_time and the like), and the node's own (autostart), are left to
    them. Raises ParameterError.
    """
    content = read_yaml(path, f"parameter file {path}", ParameterError)
    if not isinstance(content, Mapping):
        raise ParameterError(f"parameter file {path.name}: its top level is not a mapping")
    values: dict[str, Any] = {}
    for node, section in content.items():
        if _is_for_us(str(node)):
            values.update(_flattened(_own_values(path, str(node), section)))
    return {name: value for name, value in values.items() if not _belongs_to_ros(name)}


def in_any_namespace(path: Path) -> str:
    """Return the text of a parameter file whose `ar_builder:` holds in every namespace.

    ROS takes that line for /ar_builder alone, and would leave a node of a namespace its defaults
    without a word. ParameterError if the file cannot be read.
    """
    read_ros_parameters(path)
    text = path.read_text(encoding="utf-8")
    return re.sub(rf"^/?{_NODE}:", f"/**/{_NODE}:", text, flags=re.MULTILINE)


def parse_assignment(text: str) -> tuple[str, Any]:
    """Return (path, value) of `name:=value`, the value read as YAML. Raises ParameterError."""
    name, separator, value = text.partition(":=")
    if not separator or not name.strip():
        raise ParameterError(f"'{text}': a parameter is set as name:=value")
    subject = f"parameter '{name.strip()}': {value!r}"
    return name.strip(), parse_yaml(value, subject, ParameterError) if value.strip() else ""


def write_ros_parameters(parameters: Parameters) -> str:
    """Return the text of a parameter file with every value, its meaning as a comment."""
    return "".join(_lines(parameters))


def _is_for_us(node: str) -> bool:
    return node == "/**" or node.rsplit("/", maxsplit=1)[-1] == _NODE


def _own_values(path: Path, node: str, section: Any) -> Mapping[str, Any]:
    own = section.get("ros__parameters") if isinstance(section, Mapping) else None
    if not isinstance(own, Mapping):
        raise ParameterError(f"parameter file {path.name}: '{node}' has no ros__parameters mapping")
    return own


def _flattened(section: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in section.items():
        if isinstance(value, Mapping):
            yield from _flattened(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _belongs_to_ros(name: str) -> bool:
    return name.split(".", maxsplit=1)[0] in (*_OF_ROS_ITSELF, *_OF_THE_NODE)


def _lines(parameters: Parameters) -> Iterator[str]:
    values = flatten(parameters)
    yield f"{_NODE}:\n  ros__parameters:\n"
    for item in describe(NodeParameters()):
        yield f"    # {_comment(item)}\n    {item.path}: {_scalar_text(item.default)}\n"
    section: list[str] = []
    for item in describe(parameters):
        *parents, name = item.path.split(".")
        if parents != section:
            section = parents
            yield f"\n    {parents[0]}:\n"
        indent = "  " * (len(parents) + 2)
        yield f"{indent}# {_comment(item)}\n{indent}{name}: {_scalar_text(values[item.path])}\n"


def _comment(item: Any) -> str:
    unit = f" [{item.unit}]" if item.unit else ""
    choices = f" One of: {', '.join(item.choices)}." if item.choices else ""
    return f"{item.text}{unit}{choices}"


def _scalar_text(value: Value) -> str:
    if isinstance(value, tuple):
        value = list(value)  # type: ignore[assignment]
    text: str = yaml.safe_dump(value, default_flow_style=True, width=10_000)
    return text.removesuffix("\n").removesuffix("...").rstrip()
