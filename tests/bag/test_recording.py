"""Runs of ticks, farewells, jumps of the clock, and which tick a message belongs to."""

import re
import struct
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from are_ros.bag.decoded import Scene
from are_ros.bag.recording import (
    ARTEFACTS,
    LiveTicks,
    RecordedMessage,
    Runs,
    find_recording,
    part_farewells,
    runs_of,
    stamp_of,
)
from are_ros.bag.types import jazzy_typestore
from are_ros.conventions import NS_PER_S
from are_ros.errors import ParameterError
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import write_ros_parameters
from tests.record.player_runs import write_strings

TENTH = NS_PER_S // 10


def make_scene(stamp_ns: int, *ids: int) -> Scene:
    """Return a list of artefacts of which only ids matter."""
    count = len(ids)
    zeros = np.zeros(count, np.int64)
    places = np.zeros((count, 3))
    return Scene(
        stamp_ns, stamp_ns, "map", np.array(ids), places, np.zeros(count), places, zeros, zeros, ()
    )


def test_runs_end_where_ticks_are_missing_or_a_farewell_lies_between() -> None:
    """A single missing tick ends none, two do; so does a farewell, also between two ticks."""
    stamps = [k * TENTH for k in (0, 1, 3, 4, 7, 8, 9)]
    runs = runs_of(stamps, TENTH, ())
    assert runs.spans_ns == ((0, 4 * TENTH), (7 * TENTH, 9 * TENTH))
    runs = runs_of(stamps, TENTH, (8 * TENTH + 5,))
    assert runs.spans_ns[1:] == ((7 * TENTH, 8 * TENTH), (9 * TENTH, 9 * TENTH))


def test_times_are_placed_in_and_between_runs() -> None:
    """Half-open at the beginning, and a second of grace at both ends."""
    runs = Runs(((10 * NS_PER_S, 20 * NS_PER_S), (30 * NS_PER_S, 40 * NS_PER_S)))
    assert runs.is_beginning(30 * NS_PER_S)
    assert not runs.is_beginning(30 * NS_PER_S + 1)
    assert runs.is_fresh(11 * NS_PER_S - 1)
    assert not runs.is_fresh(11 * NS_PER_S)
    edges = (9, 10, 19.5, 20, 25, 40, 50)
    inside = (11, 15, 19, 31, 39)
    assert all(runs.is_edge(round(s * NS_PER_S)) for s in edges)
    assert not any(runs.is_edge(s * NS_PER_S) for s in inside)
    assert [runs.is_between(s * NS_PER_S) for s in (5, 15, 21, 22, 29, 41, 42)] == [
        False,
        False,
        False,
        True,
        True,
        False,
        True,
    ]
    assert not runs.is_between(29 * NS_PER_S + 1)
    assert runs.is_between(10**18)
    assert runs.are_together(10 * NS_PER_S, 20 * NS_PER_S)
    assert not runs.are_together(20 * NS_PER_S, 30 * NS_PER_S)
    assert not runs.are_together(25 * NS_PER_S, 26 * NS_PER_S)


def test_a_replay_has_no_runs_and_no_edges() -> None:
    """Where every tick counts, nothing is excused."""
    runs = Runs()
    assert not runs.is_fresh(0)
    assert not runs.is_edge(0)
    assert not runs.is_beginning(0)
    assert not runs.is_between(0)
    assert runs.are_together(0, 10**18)


def test_farewells_are_empty_lists_out_of_step() -> None:
    """Off the period, or again at the time of a tick; an empty tick in step is a tick."""
    scenes = [
        make_scene(0),
        make_scene(TENTH, 1),
        make_scene(TENTH + 7),
        make_scene(5 * TENTH, 1),
        make_scene(5 * TENTH),
        make_scene(6 * TENTH + 3, 1),
    ]
    ticks, farewells_ns = part_farewells(scenes, TENTH)
    assert farewells_ns == [TENTH + 7, 5 * TENTH]
    assert [tick.stamp_ns for tick in ticks] == [0, TENTH, 5 * TENTH, 6 * TENTH + 3]


def test_stamps_are_read_from_headers_and_from_lists_of_them() -> None:
    """In either byte order; bytes that are too short have none."""
    header = struct.pack("<iI", 7, 9)
    assert stamp_of("nav_msgs/msg/OccupancyGrid", b"\0\1\0\0" + header) == 7 * NS_PER_S + 9
    big = b"\0\0\0\0" + struct.pack(">iI", 7, 9)
    assert stamp_of("nav_msgs/msg/Odometry", big) == 7 * NS_PER_S + 9
    listed = b"\0\1\0\0" + struct.pack("<I", 1) + header
    assert stamp_of("tf2_msgs/msg/TFMessage", listed) == 7 * NS_PER_S + 9
    assert stamp_of("tf2_msgs/msg/TFMessage", b"\0\1\0\0\0\0\0\0") is None


def artefacts(seconds: Iterable[int], topic: str = ARTEFACTS) -> Iterator[RecordedMessage]:
    """Yield ten messages for each of some seconds, the first one of a tick."""
    for second in seconds:
        data = b"\0\1\0\0" + struct.pack("<iI", second, 0)
        yield RecordedMessage(topic, "are_msgs/msg/ArtefactArray", 0, data)
        yield from 9 * [RecordedMessage("/odom", "nav_msgs/msg/Odometry", 0, data)]


def test_messages_come_after_the_last_tick_before_them() -> None:
    """By their place alone; before all ticks, with the first."""
    ticks = LiveTicks.of([*artefacts([7], "/ar_builder/metrics"), *artefacts(range(10))])
    assert ticks.end is None
    assert ticks.before(35) == 2 * NS_PER_S
    assert ticks.before(3) == 0
    assert ticks.before(1000) == 9 * NS_PER_S


def test_ticks_end_where_an_output_of_ticks_jumps_back() -> None:
    """A jitter of a second is no jump, and what inputs are stamped does not matter."""
    assert LiveTicks.of(artefacts([0, 1, 2, 1, 3, 2])).end is None
    ticks = LiveTicks.of(artefacts([*range(10), *range(2, 6)]))
    assert (ticks.end, len(ticks.places)) == (100, 10)
    mixed = [*artefacts([5, 6]), *artefacts([6, 2], "/ar_builder/metrics"), *artefacts([7, 3])]
    assert LiveTicks.of(mixed).end == 30


def test_without_ticks_nothing_comes_before() -> None:
    """The messages are then at their own stamps."""
    assert LiveTicks.of([]).before(5) is None


def test_the_parameters_of_another_run_in_the_folder_are_not_taken(tmp_path: Path) -> None:
    """Beside augmented.mcap they are those of that run; alone with a recording they are its own."""
    (tmp_path / "live.mcap").touch()
    (tmp_path / "effective.yaml").touch()
    assert find_recording(tmp_path / "live.mcap").parameters == tmp_path / "effective.yaml"
    (tmp_path / "augmented.mcap").touch()
    assert find_recording(tmp_path / "live.mcap").parameters is None
    assert find_recording(tmp_path).parameters == tmp_path / "effective.yaml"


def test_it_is_said_how_the_parameters_of_a_live_run_are_given(tmp_path: Path) -> None:
    """Without ROS's tools, too: the file that the node took, by the name of a run's own."""
    (tmp_path / "run.mcap").touch()
    found = find_recording(tmp_path / "run.mcap")
    assert found.effective() == Parameters()
    assert "copy the node's parameter file there by that name, or write it with" in found.untold
    given = "ar_builder: {ros__parameters: {seed: 7, frames: {base: chassis}}}"
    (tmp_path / "effective.yaml").write_text(given, encoding="utf-8")
    found = find_recording(tmp_path / "run.mcap")
    assert (found.effective().frames.base, found.untold) == ("chassis", "")


def write_told(path: Path, *texts: str) -> None:
    """Write a recording of the node's parameters, a second apart."""
    topic = "/robot1/ar_builder/effective_parameters"
    write_strings(path, [(topic, float(k), text) for k, text in enumerate(texts)])


def test_the_parameters_that_the_node_told_last_are_taken(tmp_path: Path) -> None:
    """Also those of a node in a namespace; a file beside the recording goes before them."""
    bag = tmp_path / "run.mcap"
    parameters = with_values(Parameters(), {"seed": 7, "robot.radius": 0.4})
    first = write_ros_parameters(Parameters())
    write_told(bag, first, write_ros_parameters(parameters))
    found = find_recording(bag)
    assert (found.told, found.effective(), found.untold) == (parameters, parameters, "")
    (tmp_path / "effective.yaml").write_text(first, encoding="utf-8")
    assert find_recording(bag).told == Parameters()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("ar_builder: {ros__parameters: {sed: 7}}", "'sed'"),
        ("ar_builder: [", "is no valid YAML"),
        ("7", "its top level is not a mapping"),
    ],
)
def test_parameters_that_are_none_are_said_so(tmp_path: Path, text: str, reason: str) -> None:
    """With the file and the topic."""
    write_told(tmp_path / "run.mcap", text)
    with pytest.raises(ParameterError, match=re.escape(reason)) as raised:
        _ = find_recording(tmp_path / "run.mcap").told
    assert str(raised.value).startswith(f"{tmp_path / 'run.mcap'}: its /ar_builder/effective_para")


@pytest.mark.parametrize(
    ("type_name", "data", "reason"),
    [
        ("std_msgs/msg/String", bytes((0, 1, 0, 0, 9, 0, 0, 0, 65)), "it cannot be read"),
        ("std_msgs/msg/Int32", bytes((0, 1, 0, 0, 9, 0, 0, 0)), None),
    ],
)
def test_a_damaged_text_of_parameters_is_said_and_what_is_no_text_is_left_alone(
    tmp_path: Path, type_name: str, data: bytes, reason: str | None
) -> None:
    """The sentence begins with the recording, as that about a text without sense."""
    topic, store = "/ar_builder/effective_parameters", jazzy_typestore()
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.write(writer.add_connection(topic, type_name, typestore=store), 1, data)
    found = find_recording(tmp_path / "bag")
    if reason is None:
        assert found.told is None
        return
    with pytest.raises(ParameterError, match=reason) as raised:
        _ = found.told
    assert str(raised.value).startswith(f"{tmp_path / 'bag'}: {topic}: ")
