"""Whoever does not return is named; several who are slow are not."""

from itertools import count
from time import monotonic_ns, sleep

import pytest

from are_ros.node import watches as hang_watch
from are_ros.node.watches import CallbackTimer, Watchdog

PATIENCE_S = 0.4


@pytest.mark.parametrize("is_one", [True, False])
def test_only_one_who_does_not_return_is_named(
    monkeypatch: pytest.MonkeyPatch, *, is_one: bool
) -> None:
    """A long turn in which each look finds another behaviour has no hang in it."""
    asked = count()
    monkeypatch.setattr(hang_watch, "PATIENCE_NS", int(PATIENCE_S * 1e9))
    monkeypatch.setattr(
        hang_watch, "running_behaviour", lambda _: "one" if is_one else f"number {next(asked)}"
    )
    said: list[str] = []
    busy = CallbackTimer()
    watch = Watchdog(busy, said.append)
    busy.begin(monotonic_ns(), "ticks")
    turn = busy.turn
    sleep(4 * PATIENCE_S)
    busy.end(monotonic_ns())
    hung = watch.take()
    watch.close()
    assert (len(said), hung) == ((1, (turn, "one")) if is_one else (0, None))
