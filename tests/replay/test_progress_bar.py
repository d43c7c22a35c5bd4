"""The bar that shows how far a replay has come."""

import pytest

from are_ros.conventions import NS_PER_S
from are_ros.replay.progress_bar import ProgressBar


def test_the_bar_ends_full_on_a_line_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    """At the end it shows the whole, rounded as it may be, and leaves its line."""
    start_ns, end_ns = 7 * NS_PER_S, 7 * NS_PER_S + 1_499_999_999
    with ProgressBar() as bar:
        move = bar.open(start_ns, end_ns)
        for now_ns in range(start_ns, end_ns, NS_PER_S // 10):
            move(now_ns)
        move(end_ns)
        assert capsys.readouterr().err.endswith("\n")
    with ProgressBar() as bar:
        bar.open(0, NS_PER_S)(NS_PER_S)
    shown = capsys.readouterr().err.split("\r")[-1]
    assert "100%" in shown
    assert "1/1 s" in shown


def test_a_bar_is_closed_where_the_replay_fails(capsys: pytest.CaptureFixture[str]) -> None:
    """What is said afterwards has a line of its own; a bar never opened shows nothing."""

    def fail() -> None:
        with ProgressBar() as bar:
            bar.open(0, 10 * NS_PER_S)(4 * NS_PER_S)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert capsys.readouterr().err.endswith("\n")
    with ProgressBar():
        pass
    assert capsys.readouterr().err == ""
