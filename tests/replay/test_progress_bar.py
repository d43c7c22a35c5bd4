"""The bar that shows how far a replay has come."""

import signal
import sys

import pytest

from are_ros.conventions import NS_PER_S
from are_ros.replay.progress import CountBar, KernelBar, ProgressBar

Terminal = pytest.CaptureFixture[str]


@pytest.fixture
def terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Let stderr, which is captured, count as a terminal."""
    monkeypatch.setattr(type(sys.stderr), "isatty", lambda _: True)
    return capsys


def test_there_is_no_bar_without_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    """A log of CI gets nothing, and the bar can be moved all the same."""
    with ProgressBar() as bar:
        move = bar.open(0, 2 * NS_PER_S)
        move(NS_PER_S)
        move(2 * NS_PER_S)
    assert capsys.readouterr() == ("", "")


def test_the_bar_ends_full_on_a_line_of_its_own(terminal: Terminal) -> None:
    """At the end it shows the whole, rounded as it may be, and leaves its line."""
    start_ns, end_ns = 7 * NS_PER_S, 7 * NS_PER_S + 1_499_999_999
    with ProgressBar() as bar:
        move = bar.open(start_ns, end_ns)
        for now_ns in range(start_ns, end_ns, NS_PER_S // 10):
            move(now_ns)
        move(end_ns)
        assert terminal.readouterr().err.endswith("\n")
    with ProgressBar() as bar:
        bar.open(0, NS_PER_S)(NS_PER_S)
    shown = terminal.readouterr().err.split("\r")[-1]
    assert "100%" in shown
    assert "1/1 s" in shown


def test_a_bar_is_closed_where_the_replay_fails(terminal: Terminal) -> None:
    """What is said afterwards has a line of its own; a bar never opened shows nothing."""

    def fail() -> None:
        with ProgressBar() as bar:
            bar.open(0, 10 * NS_PER_S)(4 * NS_PER_S)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert terminal.readouterr().err.endswith("\n")
    with ProgressBar():
        pass
    assert terminal.readouterr().err == ""


def test_kernels_are_counted_once_that_takes_seconds(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those that nobody needed are not missing at the end; what is quick shows no bar."""
    with KernelBar() as bar:
        bar.count(1, 9)
    assert "kernels" not in terminal.readouterr().err
    monkeypatch.setattr("are_ros.replay.progress.SLOW_S", 0.0)
    with KernelBar() as bar:
        bar.count(4, 9)
        bar.count(6, 9)
    shown = terminal.readouterr().err.split("\r")[-1]
    assert "100%" in shown
    assert "6/6" in shown


def test_what_is_done_is_counted_once_that_takes_seconds(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the work fails the bar shows how far it came; what is quick shows none."""

    def search(*done: int) -> None:
        with CountBar("headings") as bar:
            for count in done:
                bar.count(count, 8)
            assert done[-1] == 8, "the work failed"

    search(3, 8)
    assert "headings" not in terminal.readouterr().err
    monkeypatch.setattr("are_ros.replay.progress.SLOW_S", 0.0)
    search(3, 8)
    shown = terminal.readouterr().err.split("\r")[-1]
    assert "headings 100%" in shown
    assert "8/8" in shown
    with pytest.raises(AssertionError, match="the work failed"):
        search(2, 6)
    shown = terminal.readouterr().err.split("\r")[-1]
    assert "headings  75%" in shown
    assert "6/8" in shown
    assert shown.endswith("\n")
    monkeypatch.setattr(type(sys.stderr), "isatty", lambda _: False)
    search(3, 8)
    assert terminal.readouterr().err == ""


def _compile(presses: int) -> None:
    """Compile as a command does, while Ctrl-C is pressed so often."""
    with KernelBar() as bar:
        assert bar.is_wanted()
        for press in range(presses):
            signal.raise_signal(signal.SIGINT)
            assert press == 0, "the second Ctrl-C did not interrupt"
            assert not bar.is_wanted()


def test_a_ctrl_c_waits_for_the_compiler() -> None:
    """The compilation is asked to end, then the command is interrupted; a second one is at once."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        for presses in (1, 2):
            with pytest.raises(KeyboardInterrupt):
                _compile(presses)
            assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        _compile(0)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
