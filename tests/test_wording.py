"""How sentences say how many there are."""

import pytest

from are_ros.wording import counted


@pytest.mark.parametrize(
    ("count", "text"), [(0, "0 arrivals"), (1, "1 arrival"), (2, "2 arrivals")]
)
def test_one_is_no_plural(count: int, text: str) -> None:
    """All other numbers are."""
    assert counted(count, "arrival") == text
