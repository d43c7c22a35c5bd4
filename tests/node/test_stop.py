"""Signals are noted, and disturb nothing."""

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from are_ros.node.startup import stop_on_signals

NUMBERS = (signal.SIGINT, signal.SIGTERM)


@pytest.fixture(autouse=True)
def own_handlers() -> Iterator[None]:
    """Restore what signals did before a test."""
    before = {number: signal.getsignal(number) for number in NUMBERS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", NUMBERS)
def test_a_signal_is_noted(number: signal.Signals) -> None:
    """Nothing is raised, however often it comes."""
    with stop_on_signals() as stop:
        assert not stop.is_set
        signal.raise_signal(number)
        signal.raise_signal(number)
        assert stop.is_set


def test_afterwards_signals_are_what_they_were() -> None:
    """Also where the block failed."""
    before = [signal.getsignal(number) for number in NUMBERS]
    with pytest.raises(ValueError, match="mine"), stop_on_signals():
        raise ValueError("mine")
    assert [signal.getsignal(number) for number in NUMBERS] == before


@pytest.mark.parametrize("number", NUMBERS)
def test_a_signal_of_a_block_that_is_not_the_last_changes_nothing(number: signal.Signals) -> None:
    """Afterwards it does what it did before."""
    before = signal.getsignal(number)
    with stop_on_signals(is_last=False) as stop:
        assert not stop.should_stop()
        signal.raise_signal(number)
        assert stop.should_stop()
    assert signal.getsignal(number) == before


def test_an_exception_lets_ctrl_c_interrupt_again() -> None:
    """The block's own handler is gone."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    with pytest.raises(ZeroDivisionError), stop_on_signals(is_last=False):
        raise ZeroDivisionError
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_who_ends_already_is_not_disturbed() -> None:
    """As by a second Ctrl-C while the interpreter ends."""
    with stop_on_signals():
        signal.raise_signal(signal.SIGTERM)
    for number in NUMBERS:
        signal.raise_signal(number)


def test_a_package_that_the_node_lacks_is_one_sentence() -> None:
    """As numba, where colcon built with the system's Python."""
    lines = ("import sys", "sys.modules['numba'] = None", "from are_ros.node.startup import main")
    words = [sys.executable, "-c", "\n".join((*lines, "sys.exit(main())"))]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    said = "ar_builder: the Python package numba is not installed: python -m pip install"
    assert (done.returncode, done.stderr.partition(' "')[0]) == (1, said)
