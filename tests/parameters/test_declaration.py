"""Declared parameters: found by path, checked, changed, and never half."""

from dataclasses import FrozenInstanceError, dataclass, field
from enum import Enum
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.errors import ParameterError
from are_ros.parameters.declaration import (
    describe,
    flatten,
    parameter,
    plain,
    value_at,
    with_values,
)


class Colour(Enum):
    """A choice."""

    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class Inner:
    """A section."""

    length: float = parameter(1.5, "A length.", unit="m", bounds=(0.0, 2.0), live=True)
    colour: Colour = parameter(Colour.RED, "A colour.")  # noqa: RUF009 - it returns a field


@dataclass(frozen=True)
class Outer:
    """A root with every type of parameter."""

    count: int = parameter(3, "A count.", bounds=(1, 9))
    switch: bool = parameter(False, "A switch.")
    name: str = parameter("x", "A name.")
    weights: tuple[float, ...] = parameter((0.5, 0.5), "Weights.", bounds=(0.0, 1.0))
    topics: tuple[str, ...] = parameter((), "Topics.")
    inner: Inner = field(default_factory=Inner)


DEFAULTS = {
    "count": 3,
    "switch": False,
    "name": "x",
    "weights": (0.5, 0.5),
    "topics": (),
    "inner.length": 1.5,
    "inner.colour": "red",
}


def test_paths_and_plain_values_in_the_order_of_declaration() -> None:
    """An Enum is given as its string."""
    assert flatten(Outer()) == DEFAULTS
    assert list(flatten(Outer())) == list(DEFAULTS)
    assert value_at(Outer(), "inner.colour") is Colour.RED
    assert plain(Colour.BLUE) == "blue"


def test_descriptions_tell_all_that_was_declared() -> None:
    """Default, unit, bounds, choices, whether it may change live, and the meaning."""
    by_path = {item.path: item for item in describe(Outer())}
    length, colour = by_path["inner.length"], by_path["inner.colour"]
    assert (length.default, length.unit, length.low, length.high) == (1.5, "m", 0.0, 2.0)
    assert (length.live, length.text, length.choices) == (True, "A length.", ())
    assert (colour.default, colour.choices, colour.live) == ("red", ("red", "blue"), False)


def test_the_default_described_is_that_of_the_declaration() -> None:
    """Not the value in force."""
    changed = with_values(Outer(), {"inner.length": 0.5})
    assert {i.path: i.default for i in describe(changed)}["inner.length"] == 1.5


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        ("count", 9, 9),
        ("switch", True, True),
        ("name", "", ""),
        ("inner.length", 2, 2.0),
        ("inner.colour", "blue", Colour.BLUE),
        ("inner.colour", Colour.BLUE, Colour.BLUE),
        ("weights", [0, 1], (0.0, 1.0)),
        ("weights", [], ()),
        ("topics", ["a", "b"], ("a", "b")),
    ],
)
def test_good_values_are_taken_in_their_own_type(path: str, value: Any, expected: Any) -> None:
    """A whole number may stand for a float; a list becomes a tuple."""
    found = value_at(with_values(Outer(), {path: value}), path)
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize(
    ("path", "value", "reason"),
    [
        ("count", 0, "0 is below 1"),
        ("count", 10, "10 is above 9"),
        ("count", 2.0, "2.0 is not a whole number"),
        ("count", True, "True is not a whole number"),
        ("switch", 1, "1 is not true or false"),
        ("switch", "yes", "'yes' is not true or false"),
        ("name", 5, "5 is not a string"),
        ("inner.length", -0.1, "-0.1 is below 0.0 m"),
        ("inner.length", float("nan"), "nan is not finite"),
        ("inner.length", "1", "'1' is not a number"),
        ("inner.length", True, "True is not a number"),
        ("inner.length", None, "None is not a number"),
        ("inner.colour", "green", "'green' is none of red, blue"),
        ("inner.colour", ["red"], "is none of red, blue"),
        ("weights", 0.5, "0.5 is not a list"),
        ("weights", "ab", "'ab' is not a list"),
        ("weights", [0.5, "a"], "'a' is not a number"),
        ("weights", [1.5], "1.5 is above 1.0"),
        ("topics", "scan", "'scan' is not a list"),
        ("topics", [1], "1 is not a string"),
        ("inner", {}, "it is a group of parameters, as inner.length, and has no value"),
        ("inner.001", None, "a decimal comma has to be a point"),
        ("inner.lenght", 1.0, "did you mean 'inner.length'"),
    ],
)
def test_bad_values_are_refused_by_name_and_change_nothing(
    path: str, value: Any, reason: str
) -> None:
    """Also the good ones that come along with a bad one."""
    section = Outer()
    with pytest.raises(ParameterError) as caught:
        with_values(section, {"count": 5, path: value})
    assert str(caught.value).startswith(f"parameter '{path}': ")
    assert reason in str(caught.value)
    assert flatten(section) == DEFAULTS


def test_a_section_cannot_be_changed_in_place() -> None:
    """It is a value."""
    with pytest.raises(FrozenInstanceError):
        Outer().count = 4  # type: ignore[misc]


@given(
    count=st.integers(1, 9),
    length=st.floats(0.0, 2.0),
    name=st.text(),
    weights=st.lists(st.floats(0.0, 1.0)),
)
def test_flatten_undoes_with_values(
    count: int, length: float, name: str, weights: list[float]
) -> None:
    """What goes in by path comes out by path."""
    values = {"count": count, "inner.length": length, "name": name, "weights": tuple(weights)}
    section = with_values(Outer(), values)
    assert flatten(section) == DEFAULTS | values
    assert with_values(Outer(), flatten(section)) == section
