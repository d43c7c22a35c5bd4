"""Playing in lockstep with a node: the same, message by message, and as fast as it goes."""

import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from are_ros.errors import NodeError
from tests.record.player_runs import (
    LISTENER,
    START_NS,
    Heard,
    Record,
    at_ns,
    clock_values,
    listen,
    played,
    playing,
    profile,
    wait_for_text,
    write_strings,
)
from tests.ros import WAIT_S, RosWorld, nap, running_s, wait_until

TOPICS = ("/crowded", "/fast", "/slow", "/map")
PERIOD_NS = 10_000_000


@pytest.fixture(params=[False, True], ids=["single-threaded", "events"])
def world(ros_available: None, request: pytest.FixtureRequest) -> Iterator[RosWorld]:
    """Return a world of each kind of executor."""
    del ros_available
    with closing(RosWorld(use_events_executor=request.param)) as world:
        yield world


@pytest.fixture
def records() -> list[Record]:
    """Return half a second: topics of several rates, one with several messages between clocks."""
    crowded = [("/crowded", at / 400, f"crowded {at}") for at in range(200)]
    fast = [("/fast", 0.0017 + at / 100, f"fast {at}") for at in range(49)]
    slow = [("/slow", 0.007 + at / 10, f"slow {at}") for at in range(5)]
    large = [("/map", at_s, f"map {at_s}" + "." * 300_000) for at_s in (0.0, 0.25)]
    return sorted([*crowded, *fast, *slow, *large], key=lambda record: record[1])


def test_every_message_comes_at_its_time(
    world: RosWorld, tmp_path: Path, records: list[Record]
) -> None:
    """A message is taken at the last clock value not after it, in order, by the shortest queue.

    Whatever the executor, and with best effort: a reader of depth one gets every message of a
    topic that has four of them between two values of the clock.
    """
    bag = write_strings(tmp_path / "bag.mcap", records, latched=["/map"])
    reliable, hasty = profile(depth=1), profile(depth=1, is_reliable=False)
    heard = listen(world, ("/slow", "/map"), qos=reliable)
    heard_too = listen(world, ("/crowded", "/fast"), qos=hasty, name="hasty")
    with world.spinning():
        run = played(bag, lockstep=(LISTENER,), wait_for=(LISTENER,))
    assert run.outcome.is_complete
    for topic in TOPICS:
        found = [one for one in [*heard, *heard_too] if one.topic == topic]
        assert found == expected(records, topic)


def expected(records: list[Record], topic: str) -> list[Heard]:
    """Return what is to be heard on a topic, with the last clock value that is not after it."""
    clock = clock_values(START_NS, at_ns(records[-1][1]) + 1, PERIOD_NS)
    return [
        Heard(topic, text, max(value for value in clock if value <= at_ns(at_s)))
        for name, at_s, text in records
        if name == topic
    ]


def test_it_keeps_no_pace_but_the_nodes(world: RosWorld, tmp_path: Path) -> None:
    """A minute in which nothing happens takes a few seconds at most."""
    bag = write_strings(tmp_path / "quiet.mcap", [("/a", 0.0, "first"), ("/a", 60.0, "last")])
    heard = listen(world, ("/a",))
    begun_s = running_s()
    with world.spinning():
        played(bag, lockstep=(LISTENER,), wait_for=(LISTENER,), clock_hz=10.0)
    assert running_s() - begun_s < 6.0
    assert [one.text for one in heard] == ["first", "last"]


def test_a_node_that_is_not_there_is_named(
    ros_available: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After some patience, in one sentence."""
    del ros_available
    from are_ros.record import lockstep

    monkeypatch.setattr(lockstep, "_PATIENCE_S", 0.3)
    bag = write_strings(tmp_path / "bag.mcap", [("/a", 0.0, "a")])
    with pytest.raises(NodeError, match="/nobody"):
        played(bag, lockstep=("nobody",))


def test_a_node_that_follows_no_clock_is_named(
    ros: RosWorld, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would never learn the time: the sentence says which parameter it lacks."""
    from are_ros.record import lockstep

    monkeypatch.setattr(lockstep, "_CLOCK_PATIENCE_S", 0.3)
    bag = write_strings(tmp_path / "bag.mcap", [("/a", 0.0, "a")])
    ros.make_node("listener")
    with ros.spinning(), pytest.raises(NodeError, match="use_sim_time"):
        played(bag, lockstep=(LISTENER,))


def test_a_node_that_ends_is_named(ros_available: None, tmp_path: Path) -> None:
    """Without waiting for an answer that cannot come."""
    del ros_available
    bag = write_strings(tmp_path / "bag.mcap", [("/a", 0.0, "first"), ("/a", 1e6, "last")])

    def play_until_the_node_ends() -> None:
        with playing(bag, lockstep=(LISTENER,), wait_for=(LISTENER,)) as run:
            with closing(RosWorld()) as world:
                heard = listen(world, ("/a",))
                with world.spinning():
                    wait_for_text(heard, "first")
            assert run.ended.wait(WAIT_S)

    with pytest.raises(NodeError, match="gone"):
        play_until_the_node_ends()


def test_a_node_that_does_not_answer_is_named(
    ros: RosWorld, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is there, but its executor does not turn."""
    from are_ros.record import lockstep

    monkeypatch.setattr(lockstep, "_PATIENCE_S", 0.5)
    bag = write_strings(tmp_path / "bag.mcap", [("/a", 0.0, "a")])
    listen(ros, ("/a",))
    with pytest.raises(NodeError, match=LISTENER):
        played(bag, lockstep=(LISTENER,), wait_for=(LISTENER,))


def test_it_stops_while_the_node_is_silent(ros: RosWorld, tmp_path: Path) -> None:
    """However long the player would wait for the node, it ends soon when told to."""
    bag = write_strings(tmp_path / "bag.mcap", [("/a", 0.0, "a")])
    listen(ros, ("/a",))
    with playing(bag, lockstep=(LISTENER,), wait_for=(LISTENER,)) as run:
        time.sleep(1.0)
        run.stop.set()
        wait_until(run.ended.is_set, nap, 1.0)
    assert not run.outcome.is_complete
