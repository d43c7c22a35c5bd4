"""The `ros__parameters` file of node and replay, and `name:=value` of a command line."""

import difflib
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import yaml

from are_ros.errors import ParameterError
from are_ros.parameters.declaration import (
    NodeParameters,
    Value,
    describe,
    flatten,
    value_at,
    with_values,
)
from are_ros.parameters.model import Parameters
from are_ros.wording import listed
from are_ros.yaml_text import Dumper, parse_yaml, read_yaml

EFFECTIVE_TOPIC: Final = "effective_parameters"
EFFECTIVE_TYPE: Final = "std_msgs/msg/String"
"""Below its name, the node publishes here the text of a file with the parameters in force."""

_NODE = "ar_builder"
_SECTION = "ros__parameters"
_OURS = (_NODE, "*", "**")
"""How the last part of a node's name addresses us, as rcl matches names of nodes."""

_FILES = ("catalogue", "population.zones", "population.scenario")
"""Parameters that name files."""

_OF_ROS_ITSELF = ("use_sim_time", "qos_overrides", "start_type_description_service")
_OF_THE_NODE = tuple(item.path for item in describe(NodeParameters()))


def read_ros_parameters(path: Path) -> dict[str, Any]:
    """Return the values by path that a file gives to the node `ar_builder`.

    Sections `/**`, `ar_builder` and `/name/space/ar_builder` count, also where namespaces are
    nested, later ones win; names that rclpy itself owns (use_sim_time and the like), and the
    node's own (autostart), are left to them. Raises ParameterError, also where nothing in the
    file is for the node, or where it names the node in two namespaces.
    """
    sections = _our_sections(path)
    nodes = {_full_name(node) for node, _ in sections if node.strip("/") != _NODE}
    named = sorted(node for node in nodes if "*" not in node)
    if len(named) > 1:
        raise ParameterError(
            f"parameter file {path} is for several nodes, {listed(named)}: give a file for one"
        )
    return _values_of(sections)


def _values_of(sections: Sequence[tuple[str, dict[str, Any]]]) -> dict[str, Any]:
    """Return the values by path, those of later sections winning, without what is not ours."""
    values: dict[str, Any] = {}
    for _, own in sections:
        values.update(own)
    not_ours = {*_OF_ROS_ITSELF, *_OF_THE_NODE}
    return {name: v for name, v in values.items() if name.split(".")[0] not in not_ours}


def with_file(parameters: Parameters, path: Path) -> Parameters:
    """Return parameters with the values of a file; ParameterError names the file.

    A file that it names is looked for beside it, else from the present folder.
    """
    values = read_ros_parameters(path)
    try:
        return with_values(parameters, {**values, **_files_beside(path, values)})
    except ParameterError as cause:
        raise ParameterError(f"{path}: {cause}") from cause


def with_text(parameters: Parameters, text: str, subject: str) -> Parameters:
    """Return parameters with the values of a file's text; ParameterError begins with `subject`."""
    sections = _sections_for_us(parse_yaml(text, subject, ParameterError), subject)
    try:
        return with_values(parameters, _values_of(sections))
    except ParameterError as cause:
        raise ParameterError(f"{subject}: {cause}") from cause


def parameter_file_for_ros(paths: Sequence[Path], namespace: str = "") -> str:
    """Return the text of the parameter file that ROS is to read, in place of several.

    It holds what they give to the node in the namespace, later values winning, with the paths of
    files that lie beside them. ROS itself applies `ar_builder:` to /ar_builder only, and of two
    values of one name under one section it keeps the first where they are of different types, as
    30 and 12.5 are; a list of both it refuses. ParameterError if a file cannot be read, holds
    nothing for the node, or a list that its parameter cannot take.
    """
    node = _full_name(f"{namespace.strip('/')}/{_NODE}")
    values: dict[str, Any] = {}
    for path in paths:
        sections = _our_sections(path)
        ours = [own for section, own in sections if _addresses(section, node)]
        if not ours:
            others = listed(sorted({_full_name(section) for section, _ in sections}))
            message = f"parameter file {path} holds nothing for {node}: it is for {others}"
            raise ParameterError(message)
        for own in ours:
            if empty := [name for name, value in own.items() if value is None]:
                raise ParameterError(f"parameter file {path}: '{empty[0]}' has no value")
            try:
                values |= {**_with_lists_of_one_type(own), **_files_beside(path, own)}
            except ParameterError as cause:
                raise ParameterError(f"parameter file {path}: {cause}") from cause
    return _section_for_ros("/**/*", values)


def assignments_for_ros(texts: Sequence[str]) -> str:
    """Return the text of a parameter file with `name:=value`, one or more, for ROS to read last.

    Raises ParameterError as `parse_assignment`, and for a list that its parameter cannot take.
    """
    values = _with_lists_of_one_type(dict(map(parse_assignment, texts)))
    return _section_for_ros("/**/**", values)


def _with_lists_of_one_type(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values, and lists with the elements that their parameters have, as 0.0 for 0."""
    defaults = flatten(Parameters())
    lists = {
        name: value
        for name, value in values.items()
        if isinstance(value, list) and isinstance(defaults.get(name), tuple)
    }
    taken = with_values(Parameters(), lists)
    return {**values, **{name: list(value_at(taken, name)) for name in lists}}


def _section_for_ros(section: str, values: Mapping[str, Any]) -> str:
    """Return a parameter file for any node; no other writes the name of the section so."""
    return yaml.dump({section: {_SECTION: {**values}}}, Dumper=_Dumper, sort_keys=False)


class _Dumper(yaml.SafeDumper):
    """Puts quotes round each text, whatever ROS would take it for."""


_Dumper.add_representer(
    str, lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"')
)


def _our_sections(path: Path) -> list[tuple[str, dict[str, Any]]]:
    """Return name and values by path of each section for a node of our name. ParameterError."""
    subject = f"parameter file {path}"
    return _sections_for_us(read_yaml(path, subject, ParameterError), subject)


def _sections_for_us(content: Any, subject: str) -> list[tuple[str, dict[str, Any]]]:
    """Return the same of what YAML gave; ParameterError begins with `subject`."""
    if not isinstance(content, Mapping):
        reason = "it is empty" if content is None else "its top level is not a mapping"
        raise ParameterError(f"{subject}: {reason}")
    sections = [*_sections(content)]
    ours = [(node, section) for node, section in sections if _is_for_us(node)]
    if not ours:
        reason = _why_not_for_us(content, [node for node, _ in sections])
        raise ParameterError(f"{subject} holds nothing for {_NODE}: {reason}")
    found = []
    for node, section in ours:
        own = section.get(_SECTION) if isinstance(section, Mapping) else None
        if not isinstance(own, Mapping):
            raise ParameterError(f"{subject}: '{node}' has no {_SECTION} mapping")
        names = Counter(name for name, _ in _flattened(own))
        if twice := [name for name, times in names.items() if times > 1]:
            raise ParameterError(f"{subject}: {listed(twice)} stands in it twice")
        found.append((node, dict(_flattened(own))))
    return found


def _files_beside(path: Path, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values that name files: with the path of one beside a parameter file.

    One that is not beside it, or that is taken back by an empty name, stays as it is given.
    """
    given = {name: values[name] for name in _FILES if values.get(name) is not None}
    beside = {name: path.parent / str(file) for name, file in given.items()}
    return {name: str(beside[name]) if beside[name].is_file() else given[name] for name in given}


def _full_name(node: str) -> str:
    return "/" + node.strip("/")


def _addresses(section: str, node: str) -> bool:
    """Tell whether a section's name is for a node, as rcl matches names; ours alone is for any."""
    name = f"**/{_NODE}" if section.strip("/") == _NODE else section.strip("/")
    words = name.split("/")
    anything = {"*": "/[^/]+", "**": "(/[^/]+)*"}
    return bool(re.fullmatch("".join(anything.get(w, "/" + re.escape(w)) for w in words), node))


def parse_assignment(text: str) -> tuple[str, Any]:
    """Return (path, value) of `name:=value`, the value read as YAML. Raises ParameterError.

    A list for a string parameter (robot.footprint) stays a text, so that it needs no quotes.
    """
    name, separator, value = text.partition(":=")
    name = name.strip()
    if not separator or not name:
        raise ParameterError(f"'{text}': a parameter is set as name:=value")
    if not value.strip():
        return name, ""
    read = parse_yaml(value, f"parameter '{name}': {value!r}", ParameterError)
    is_text = any(i.path == name and isinstance(i.default, str) for i in describe(Parameters()))
    return name, value.strip() if is_text and isinstance(read, list) else read


def write_ros_parameters(parameters: Parameters) -> str:
    """Return the text of a parameter file with every value, its meaning as a comment."""
    return "".join(_lines(parameters))


def _sections(content: Mapping[Any, Any], namespace: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the name and the section of each node, and of what has the name of ours."""
    for key, section in content.items():
        node = f"{namespace}{key}"
        is_namespace = isinstance(section, Mapping) and _SECTION not in section
        if is_namespace and not _is_for_us(node):
            yield from _sections(section, f"{node}/")
        elif _is_for_us(node) or isinstance(section, Mapping):
            yield node, section


def _is_for_us(node: str) -> bool:
    return node.rsplit("/", maxsplit=1)[-1] in _OURS


def _why_not_for_us(content: Mapping[Any, Any], nodes: Sequence[str]) -> str:
    """Return why a file has no section for this node."""
    known = {item.path for item in describe(Parameters())}
    known |= {path.split(".", maxsplit=1)[0] for path in known}
    for name in map(str, content):
        if name == _SECTION or name in known:
            above = f"'{_NODE}:'" if name == _SECTION else f"'{_NODE}:' and '{_SECTION}:'"
            return f"'{name}' stands in it without {above} above"
    names = {name.rsplit("/", maxsplit=1)[-1]: name for name in (*map(str, content), *nodes)}
    if near := difflib.get_close_matches(_NODE, names, n=1):
        return f"it is for '{names[near[0]]}'; did you mean '{_NODE}'?"
    return f"it is for {listed(nodes)}" if nodes else "no node is named in it"


def _flattened(section: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in section.items():
        if isinstance(value, Mapping):
            yield from _flattened(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


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
    text: str = yaml.dump(value, Dumper=Dumper, default_flow_style=True, width=10_000)
    return text.removesuffix("\n").removesuffix("...").rstrip()
