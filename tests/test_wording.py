"""How sentences say how many there are."""

import pytest

from are_ros.wording import counted, listed, several


@pytest.mark.parametrize(
    ("count", "text"), [(0, "0 arrivals"), (1, "1 arrival"), (2, "2 arrivals")]
)
def test_one_is_no_plural(count: int, text: str) -> None:
    """All other numbers are."""
    assert counted(count, "arrival") == text


def test_plurals_are_the_regular_ones() -> None:
    """After a hissing sound with an e."""
    assert [several(noun) for noun in ("box", "scan", "pass")] == ["boxes", "scans", "passes"]
    assert [counted(count, "box") for count in (1, 2)] == ["1 box", "2 boxes"]


@pytest.mark.parametrize(
    ("words", "text"),
    [((), ""), (("a",), "a"), (("a", "b"), "a and b"), (("a", "b", "c"), "a, b and c")],
)
def test_the_last_word_of_a_list_follows_an_and(words: tuple[str, ...], text: str) -> None:
    """The others a comma."""
    assert listed(words) == text
