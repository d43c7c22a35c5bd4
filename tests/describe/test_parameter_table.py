"""The files that derive from the declaration of the parameters are those in the repository."""

import runpy
from pathlib import Path

import pytest

from are_ros.parameters.declaration import describe, flatten, with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import read_ros_parameters

PROJECT = Path(__file__).resolve().parents[2]
SCRIPT = runpy.run_path(str(PROJECT / "docs" / "make_parameter_docs.py"))
parameter_files, parameter_table_markdown = (
    SCRIPT[name] for name in ("parameter_files", "parameter_table_markdown")
)


@pytest.mark.parametrize("path", parameter_files(), ids=str)
def test_files_are_up_to_date(path: Path) -> None:
    """The file says what the code says today."""
    message = f"{path} is out of date: run python docs/make_parameter_docs.py"
    assert (PROJECT / path).read_text(encoding="utf-8") == parameter_files()[path], message


def test_every_parameter_has_its_line() -> None:
    """The table has one line per parameter, with its path first."""
    lines = parameter_table_markdown().splitlines()
    for item in describe(Parameters()):
        assert sum(line.startswith(f"| `{item.path}` |") for line in lines) == 1


def test_table_has_even_columns() -> None:
    """No meaning breaks the table: every line of it has six columns."""
    rows = [line for line in parameter_table_markdown().splitlines() if line.startswith("|")]
    assert {line.replace("\\|", "").count("|") for line in rows} == {7}


def test_shipped_file_holds_the_defaults() -> None:
    """The shipped parameter file reads back as the defaults."""
    values = read_ros_parameters(PROJECT / "config" / "are.yaml")
    assert flatten(with_values(Parameters(), values)) == flatten(Parameters())
    assert values.keys() == flatten(Parameters()).keys()
