"""The commands that play and record: their texts, and what they return."""

import signal
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from are_ros.errors import BagError
from bags.simulation.making import RosbagsFactory
from tests.record.player_runs import STRING, write_messages, write_strings


def test_remaps_are_read(ros_available: None) -> None:
    """Names stay as they are given, without the spaces around them."""
    del ros_available
    from are_ros.record.commands import read_remaps

    assert read_remaps(["/scan:=/front/scan", " odom := wheel/odom "]) == {
        "/scan": "/front/scan",
        "odom": "wheel/odom",
    }
    assert read_remaps([]) == {}


@pytest.mark.parametrize("text", ["", "/scan", "/scan:=", ":=/scan", " := ", "/scan=/front"])
def test_other_remaps_are_refused(ros_available: None, text: str) -> None:
    """The sentence shows the form."""
    del ros_available
    from are_ros.record.commands import read_remaps

    with pytest.raises(BagError, match="must be /FROM:=/TO, as /scan:=/front/scan") as caught:
        read_remaps([text])
    assert "\n" not in str(caught.value)


def test_play_says_what_it_played(ros_available: None, tmp_path: Path) -> None:
    """True where all of it could be; False, with the reason, where a type is not installed."""
    del ros_available
    from are_ros.record.commands import play_command

    records = [("/a", 0.0, "x"), ("/a", 0.1, "y"), ("/odd", 0.1, "z")]
    bag = write_strings(tmp_path / "bag.mcap", records, unknown=["/odd"])
    said: list[str] = []
    assert play_command(said.append, (), bags=(bag,), exclude=("/odd",))
    assert said == ["played       2 messages on 1 topic"]
    said.clear()
    assert not play_command(said.append, (), bags=(bag,))
    assert "/odd is not played" in said[0]


def test_a_recorded_clock_that_gives_way_leaves_nothing_out(
    ros_available: None, tmp_path: Path
) -> None:
    """As of every recording of a simulation: the player tells the same time itself."""
    del ros_available
    from are_ros.record.commands import play_command

    factory = RosbagsFactory()
    zero = factory.make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
    clock = factory.make("rosgraph_msgs/msg/Clock", clock=zero)
    records = [("/clock", 0.0, clock), ("/a", 0.0, factory.make(STRING, data="x"))]
    bag = write_messages(tmp_path / "bag.mcap", records)
    said: list[str] = []
    assert play_command(said.append, (), bags=(bag,))
    assert "/clock is not played: the player tells the time itself" in said
    assert said[-1] == "played       1 message on 1 topic"


@pytest.mark.parametrize("loop", [False, True])
def test_play_that_is_ended_is_interrupted(
    ros_available: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, loop: bool
) -> None:
    """It says what it played, and the exit status tells that this is not all; a loop has no end."""
    del ros_available
    from are_ros.record import commands
    from are_ros.record.player import play

    bag = write_strings(tmp_path / "bag.mcap", [("/a", 0.0, "x"), ("/a", 9.0, "y")])

    def ended(*words: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        return play(*words)

    monkeypatch.setattr(commands, "play", ended)
    said: list[str] = []
    with nullcontext() if loop else pytest.raises(KeyboardInterrupt):
        assert commands.play_command(said.append, (), bags=(bag,), loop=loop)
    assert said[0].startswith("played")


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        ("/odd name", "/odd name is no name of a topic"),
        ("/clock", "the player tells the time itself"),
        ("/parameter_events", "/parameter_events cannot be published as std_msgs/msg/String"),
    ],
)
def test_a_topic_that_cannot_be_published_is_told(
    ros_available: None, tmp_path: Path, target: str, reason: str
) -> None:
    """By its name, or because it is of another type here."""
    del ros_available
    from are_ros.record.commands import play_command

    bag = write_strings(tmp_path / "bag.mcap", [("/a", 0.0, "x"), ("/b", 0.0, "y")])
    said: list[str] = []
    assert not play_command(said.append, (f"/a:={target}",), bags=(bag,), clock_hz=10.0)
    assert said[0].startswith(f"/a is not played: {reason}")


def test_record_says_what_it_recorded(ros_available: None, tmp_path: Path) -> None:
    """When it is ready, and the file; False where nothing is in it, or not what was asked for."""
    del ros_available
    from are_ros.record.commands import record_command

    said: list[str] = []
    path = tmp_path / "nothing.mcap"
    assert not record_command(said.append, path=path, topics=("/nobody*",), duration_s=0.2)
    nothing = "nothing is recorded: no message arrived on any topic"
    assert said == [f"recording into {path}; Ctrl-C ends it", nothing, f"{path}: 0.0 MB"]
    assert path.is_file()
    named = {"path": path, "topics": ("/nobody",), "duration_s": 0.2}
    assert not record_command(said.append, **named, overwrite=True)
    assert "/nobody is not recorded: nobody published it" in said
