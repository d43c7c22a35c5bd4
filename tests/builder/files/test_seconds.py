"""Seconds as text and nanoseconds: exact both ways."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.builder.files.scenario_file import ns_of_seconds, seconds_text


@given(st.integers(0, 10**18))
def test_nanoseconds_survive_as_text(t_ns: int) -> None:
    """Every instant of thirty years comes back from its text, which has no needless zeros."""
    text = seconds_text(t_ns)
    assert ns_of_seconds(text) == t_ns
    assert Fraction(text) * 10**9 == t_ns
    assert text == "0" or not ("." in text and text.endswith("0"))


@given(st.integers(0, 10**15 - 1))
def test_nanoseconds_survive_as_numbers_of_fifteen_digits(t_ns: int) -> None:
    """What YAML makes of a decimal of up to fifteen digits is still that decimal."""
    assert ns_of_seconds(float(seconds_text(t_ns))) == t_ns


@pytest.mark.parametrize(
    ("value", "t_ns"),
    [
        (0, 0),
        (12, 12_000_000_000),
        (0.1, 100_000_000),
        (" 1.5 ", 1_500_000_000),
        ("1e-9", 1),
        (1e-9, 1),
        ("0.0000000004", 0),
        (".5", 500_000_000),
        ("1000000000", 10**18),
    ],
)
def test_seconds_may_be_written_in_many_ways(value: object, t_ns: int) -> None:
    """Numbers and texts, with exponents or without, rounded to the nearest nanosecond."""
    assert ns_of_seconds(value) == t_ns


@pytest.mark.parametrize("value", [True, None, "", "soon", "nan", [1], "1.2.3", float("nan")])
def test_what_is_no_number_is_refused(value: object) -> None:
    """The refusal goes on from the name of a field."""
    with pytest.raises(ValueError, match=r"^is .*, but seconds are needed$"):
        ns_of_seconds(value)


@pytest.mark.parametrize("value", [-1, -0.5, "1e10", "inf", 1e300, "1e999999999"])
def test_seconds_out_of_range_are_refused(value: object) -> None:
    """Neither the past, nor what is more than thirty years off."""
    with pytest.raises(ValueError, match="but seconds"):
        ns_of_seconds(value)
