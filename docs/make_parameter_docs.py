"""Write docs/parameters.md and config/are.yaml anew from the declaration of the parameters."""  # noqa: INP001

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from are_ros.parameters.declaration import Description, NodeParameters, describe
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import write_ros_parameters

PROJECT: Final = Path(__file__).resolve().parents[1]
_INTRODUCTION: Final = """\
# Parameters

The path of a parameter is the same in YAML, in ROS and in Python. A live one may change while ARE
runs: by `ros2 param set /ar_builder PATH VALUE`, or by a slider of `are view --live`, for which ROS
need not be installed. The others take effect at the start: `--params FILE`, `--set PATH:=VALUE`; in
the node, when it is configured. A value that is out of range is refused, with the reason, and
nothing changes. `are describe` says what a set of values means: arrivals per minute, the expected
population, how likely each class is.

This page and `config/are.yaml` are made from the declaration in `are_ros/parameters/model.py` by
`python docs/make_parameter_docs.py`.
"""
_HEADER: Final = """\
| parameter | default | unit | range or choices | live | meaning |
|---|---|---|---|---|---|
"""


def parameter_table_markdown() -> str:
    """Return the text of docs/parameters.md: a table per section, in the order of declaration."""
    return _INTRODUCTION + "".join(_tables())


def parameter_files() -> dict[Path, str]:
    """Return the texts of the files that derive from the declaration, by path in the project."""
    return {
        Path("docs/parameters.md"): parameter_table_markdown(),
        Path("config/are.yaml"): write_ros_parameters(Parameters()),
    }


def _tables() -> Iterator[str]:
    current = None
    for item in (*describe(NodeParameters()), *describe(Parameters())):
        head, dot, _ = item.path.partition(".")
        title = head if dot else "general"
        if title != current:
            current = title
            yield f"\n## {title}\n\n{_HEADER}"
        yield _line(item)


def _line(item: Description) -> str:
    cells = (
        f"`{item.path}`",
        f"`{_default(item)}`",
        item.unit,
        _range(item),
        "yes" if item.live else "",
        item.text.replace("|", "\\|"),
    )
    return "| " + " | ".join(cells) + " |\n"


def _default(item: Description) -> str:
    value = item.default
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return "[" + ", ".join(_scalar(one) for one in value) + "]"
    return _scalar(value)


def _scalar(value: float | str) -> str:
    if isinstance(value, str):
        return value or '""'
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _range(item: Description) -> str:
    if item.choices:
        return ", ".join(f"`{choice}`" for choice in item.choices)
    if item.low is None or item.high is None:
        return ""
    return f"{_scalar(item.low)} to {_scalar(item.high)}"


if __name__ == "__main__":
    for path, text in parameter_files().items():
        (PROJECT / path).write_text(text, encoding="utf-8")
