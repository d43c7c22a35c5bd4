"""YAML text: what it says, and one sentence for all that is wrong with it."""

import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.errors import AreError, CatalogueError, MapError, ParameterError
from are_ros.parameters.ros_yaml import parse_assignment, read_ros_parameters
from are_ros.world.map_io import read_map_file
from are_ros.world.regions import read_zones_file
from are_ros.yaml_text import parse_yaml, read_yaml

FAULTS = (
    "2001-99-99",
    "2001-01-01 99:99:99",
    "!!timestamp x",
    "!!bool x",
    "!!int x",
    '!!int ""',
    "!!float x",
    '!!float ""',
    "!!binary é",
    "!!set [1]",
    "? [1]\n: 2",
    "!!python/object:os.system {}",
    "[1",
    "a: b: c",
    "*missing",
    "&own [*own]",
    "&own {a: *own}",
    "\0",
    "\ud800",
    "[" * 101 + "]" * 101,
    "[" * 200_000,
    "{a: " * 200_000,
    "- " * 200_000 + "1",
)
"""Texts for which PyYAML raises errors of many kinds, loops for ever, or ends the process."""


@pytest.mark.parametrize("text", FAULTS, ids=lambda text: repr(text[:24]))
def test_whatever_is_wrong_is_one_sentence(text: str) -> None:
    """It begins with the subject and is of the kind that was asked for."""
    with pytest.raises(MapError) as caught:
        parse_yaml(text, "the text", MapError)
    sentence = str(caught.value)
    assert sentence.startswith("the text is no valid YAML")
    assert sentence.rpartition(": ")[2].strip()
    assert "\n" not in sentence
    assert len(sentence) < 300


@given(st.text(max_size=40) | st.text(alphabet="!&*[]{}:-?,<| \n'\"#.~0123a", max_size=20))
def test_no_text_gives_another_error(text: str) -> None:
    """Whatever the text: a value, or an error of the family."""
    with suppress(ParameterError):
        parse_yaml(text, "the text", ParameterError)


@pytest.mark.parametrize(
    "text", ["{a: [1, 2.5, true, ~, x], b: {c: 0x1f}}", "- &a {x: 1}\n- *a\n", "", "[1e, e3, .e1]"]
)
def test_values_are_those_of_yaml(text: str) -> None:
    """Plain values come as PyYAML's safe loader gives them, shared ones too."""
    assert parse_yaml(text, "the text", ParameterError) == yaml.safe_load(text)


@pytest.mark.parametrize("number", ["1e-3", "+1E-3", "0.1e-2", ".1e-2"])
def test_an_exponent_makes_a_number(number: str) -> None:
    """With or without a point, as ROS reads it."""
    assert parse_yaml(number, "the text", ParameterError) == 0.001


def test_a_number_beyond_all_floats_is_refused() -> None:
    """Wherever it stands; as a text it may be as long as it likes."""
    huge = "1" + 400 * "0"
    with pytest.raises(ParameterError, match=r"line 2: 100000000000\.\.\. is too large a number"):
        parse_yaml(f"a: 1\nb: [{huge}]", "it", ParameterError)
    with pytest.raises(ParameterError, match="too large"):
        parse_yaml(f"-{huge}", "it", ParameterError)
    assert parse_yaml(f"'{huge}'", "it", ParameterError) == huge


@pytest.mark.parametrize("number", ["010", "-010", "0_10"])
def test_a_number_with_a_zero_before_it_is_refused(number: str) -> None:
    """YAML 1.1 reads 8, and most mean 10; 007 is 7 for all, and a text in quotes is no number."""
    with pytest.raises(ParameterError, match=f"line 2: {number} may mean 8 or 10: write the one"):
        parse_yaml(f"a: 1\nb: [{number}, 1]\n", "the text", ParameterError)
    assert parse_yaml("[007, 00, '010', 0x10, 10]", "it", ParameterError) == [7, 0, "010", 16, 10]


def test_a_line_is_named() -> None:
    """The line where the reader stumbles, counted from 1."""
    with pytest.raises(ParameterError, match="no valid YAML, line 3: "):
        parse_yaml("a: 1\nb:\n  c: d: e\n", "the text", ParameterError)


def test_the_folder_where_a_file_was_sought_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the name does not tell it; the folder itself may be gone."""
    monkeypatch.chdir(tmp_path)
    reason = f"No such file or directory in {tmp_path}"
    with pytest.raises(CatalogueError, match=re.escape(f"({reason})")):
        read_yaml(Path("rows.yaml"), "it", CatalogueError)
    tmp_path.rmdir()
    with pytest.raises(CatalogueError, match=r"\(No such file or directory\)"):
        read_yaml(Path("rows.yaml"), "it", CatalogueError)


def test_a_file_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    """It is missing, a folder, no text, or has an impossible name."""
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00")
    for path, reason in (
        (tmp_path / "missing", "No such file"),
        (tmp_path, "directory"),
        (tmp_path / "bytes", "not UTF-8 text"),
        (Path("a\0b"), ""),
    ):
        with pytest.raises(CatalogueError, match=rf"it cannot be read \(.*{reason}.*\)"):
            read_yaml(path, "it", CatalogueError)


READERS = (
    (read_ros_parameters, ParameterError, "ar_builder: {{ros__parameters: {{x: {}}}}}"),
    (read_catalogue, CatalogueError, "rows: {}"),
    (read_zones_file, ParameterError, "zones: {}"),
    (read_map_file, MapError, "image: {}"),
)


@pytest.mark.parametrize("scalar", ["2001-99-99", "!!timestamp x", "!!bool x", "&a [*a]"])
@pytest.mark.parametrize(("reader", "kind", "text"), READERS)
def test_every_reader_of_yaml_names_its_file(
    reader: Any, kind: type[AreError], text: str, scalar: str, tmp_path: Path
) -> None:
    """Parameters, catalogue, zones and map: their error, with the file's name."""
    path = tmp_path / "some.yaml"
    path.write_text(text.format(scalar), encoding="utf-8")
    with pytest.raises(kind, match=r"some\.yaml.* is no valid YAML"):
        reader(path)


def test_a_bad_value_of_an_assignment_names_its_parameter() -> None:
    """No date has a month 99."""
    with pytest.raises(ParameterError, match=r"'population\.zones': '2001-99-99' is no valid"):
        parse_assignment("population.zones:=2001-99-99")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a: 1\nb: 2\na: 3\n", "line 3: the key 'a' comes twice in one mapping"),
        ("x:\n- {a: 1, b: {a: 2}, 'a': 3}\n", "line 2: the key 'a' comes twice"),
        ("? [1, 2]\n: {a: 1}\nb: {}\nb: 2\n", "line 4: the key 'b' comes twice"),
        ("&k a: 1\nb: *k\nb: 2\n", "line 3: the key 'b' comes twice"),
    ],
)
def test_a_key_that_comes_twice_is_refused(text: str, reason: str) -> None:
    """Else the last one would win without a word."""
    with pytest.raises(ParameterError) as caught:
        parse_yaml(text, "the text", ParameterError)
    assert reason in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "[{a: 1}, {a: 2}, a, a]",
        "{a: {a: {a: a}}, b: a, c: [a, b, a]}",
        "x: &x {a: 1}\ny: &y {<<: *x, a: 2}\nz: {<<: *y, a: 3}\na: *x\n",
    ],
)
def test_keys_of_several_mappings_may_be_the_same(text: str) -> None:
    """And values may be as keys are, and what is merged in may be given anew."""
    assert parse_yaml(text, "the text", ParameterError) == yaml.safe_load(text)
