"""What the diagnostics say, and how urgently, against their page in the docs."""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from are_ros.bag.types import jazzy_typestore
from are_ros.node.diagnostics import (
    FALLS_BEHIND,
    WITHOUT_CLOCK,
    Level,
    NodeSnapshot,
    NodeState,
    PopulationSnapshot,
    SensorSnapshot,
    Status,
    clock_doubt,
    encode_diagnostics,
    input_doubts,
    load_doubt,
    robot_doubt,
    statuses,
)
from are_ros.node.watches import FaultWatch, InputSnapshot, TickFigures

PAGE = Path(__file__).resolve().parents[2] / "docs" / "diagnostics.md"
NO_MAP = InputSnapshot("map", "/map", is_required=True, is_latched=True)
NO_SCAN = InputSnapshot("scan", "/scan")
MAP = replace(NO_MAP, count=1, age_s=70.0)
SCAN = replace(NO_SCAN, count=90, age_s=0.02, period_s=0.1)
SLOW = TickFigures(0.1, count=9, age_s=0.1, p50_ms=80.0, p99_ms=100.5, max_ms=120.0)
WELL = NodeSnapshot(
    NodeState.ACTIVE,
    active_s=60.0,
    inputs=(MAP, SCAN),
    ticks=TickFigures(0.1, count=600, age_s=0.05, p50_ms=9.0, p99_ms=21.0, max_ms=30.0),
    population=PopulationSnapshot(alive=12, arrivals=40, departures=28, arrivals_lately=10),
    sensors=(SensorSnapshot("/scan", exact=80, held=9),),
)


def status_of(snapshot: NodeSnapshot, name: str) -> Status:
    """Return the only status of a name."""
    (found,) = (status for status in statuses(snapshot) if status.name == name)
    return found


def of_input(entry: InputSnapshot, active_s: float = 60.0) -> tuple[Level, str]:
    """Return level and message of an input."""
    status = status_of(replace(WELL, inputs=(entry,), active_s=active_s), f"inputs/{entry.role}")
    return status.level, status.message


def test_all_is_well() -> None:
    """Each part has a line, and each line is OK."""
    found = statuses(WELL)
    assert {status.level for status in found} == {Level.OK}
    assert [status.name for status in found] == [
        "state", "clock", "inputs/map", "inputs/scan", "frames/robot", "frames/camera", "cloud",
        "ticks", "answers", "population", "behaviours", "robot contact", "scans/scan",
    ]  # fmt: skip
    assert {status.name: status.message for status in found}["inputs/scan"] == "10.0 Hz"


@pytest.mark.parametrize(
    ("state", "names", "message"),
    [
        (NodeState.UNCONFIGURED, ["state", "clock"], "unconfigured: nothing is received"),
        (NodeState.INACTIVE, ["state", "clock", "inputs/map"], "inactive: the real map is relay"),
        (NodeState.FINALIZED, ["state", "clock"], "finalized: "),
    ],
)
def test_what_is_not_active_complains_of_nothing(
    state: NodeState, names: list[str], message: str
) -> None:
    """Its user wanted it so."""
    inputs = (NO_MAP,) if "inputs/map" in names else ()
    snapshot = NodeSnapshot(state, inputs=inputs, robot_problem="no frame", ticks=None)
    found = statuses(snapshot)
    assert [status.name for status in found] == names
    assert {status.level for status in found} == {Level.OK}
    assert found[0].message.startswith(message)


def test_paused() -> None:
    """It says so, and ticks may stand still."""
    stopped = replace(WELL, is_paused=True, ticks=TickFigures(0.1, count=1, age_s=100.0))
    assert status_of(stopped, "state").message == "paused: the real map is relayed"
    assert status_of(stopped, "ticks").level is Level.OK


def test_an_input_that_somebody_publishes_and_that_does_not_come() -> None:
    """Transforms of another QoS, say. What is latched may just not have been said."""
    silent = replace(NO_SCAN, publishers=1, published_s=5.0, asked="best effort, volatile")
    asked = "(the node asks for best effort, volatile)"
    doubt = f"no message yet, though /scan has 1 publisher; is its QoS compatible {asked}?"
    assert of_input(silent) == (Level.OK, doubt)
    without = Level.OK, "no message yet; the node works without"
    assert of_input(replace(silent, published_s=4.9)) == without
    assert of_input(replace(silent, is_latched=True)) == without


def test_a_required_input_that_never_came() -> None:
    """An error after 5 s, which says what can be done."""
    nothing = NO_MAP
    assert of_input(nothing, 4.9) == (Level.OK, "no message yet")
    expected = (Level.ERROR, "no message for 8 s: nobody publishes /map")
    assert of_input(nothing, 8.0) == expected
    assert of_input(replace(nothing, publishers=1, published_s=4.9), 8.0)[0] is Level.OK
    asked = "reliable, transient local"
    published = replace(nothing, publishers=1, published_s=5.0, asked=asked)
    level, message = of_input(published, 8.0)
    assert level is Level.ERROR
    asked = f"(the node asks for {asked})"
    doubt = f"though /map has 1 publisher; is its QoS compatible {asked}?"
    assert message == f"no message for 8 s, {doubt}"


def test_an_input_that_is_published_as_another_type() -> None:
    """Nothing of it can ever come, whatever the QoS: a warning after a while, also in the log."""
    types = "std_msgs/msg/String, not sensor_msgs/msg/LaserScan"
    wrong = replace(NO_SCAN, publishers=1, published_s=5.0, mistyped=types)
    said = f": /scan is published as {types}"
    assert of_input(wrong, 5.0) == (Level.WARN, f"no message yet{said}")
    assert of_input(wrong, 4.9)[0] is of_input(replace(wrong, published_s=4.9))[0] is Level.OK
    active = replace(WELL, inputs=(wrong,), active_s=5.0)
    assert input_doubts(active) == [f"no message of /scan yet{said}"]
    assert input_doubts(replace(active, inputs=(replace(wrong, published_s=4.9),))) == []
    required = replace(wrong, is_required=True)
    assert of_input(required, 8.0) == (Level.ERROR, f"no message for 8 s{said}")
    assert input_doubts(replace(active, inputs=(required,))) == [f"no message of /scan yet{said}"]


def test_the_log_says_that_the_node_falls_behind() -> None:
    """In a sentence without numbers, so that it is logged once."""
    assert load_doubt(replace(WELL, ticks=None)) == load_doubt(WELL) == ""
    some, more = (load_doubt(replace(WELL, ticks=replace(SLOW, left_out=n))) for n in (1, 267))
    assert some == more
    assert some.startswith("the node does not keep up with its clock: ticks are left out")


def test_the_log_names_the_required_inputs_that_never_came() -> None:
    """In a sentence that stays the same, so that it is logged once; of optional ones nothing."""
    waiting = replace(WELL, inputs=(NO_MAP, NO_SCAN), active_s=4.9)
    assert input_doubts(waiting) == []
    expected = ["no message of /map yet: nobody publishes /map"]
    for active_s in (5.0, 60.0):
        assert input_doubts(replace(waiting, active_s=active_s)) == expected
    assert input_doubts(WELL) == []


def test_the_log_says_why_there_is_no_pose_of_the_robot() -> None:
    """Once the map has come; before, that is what is missing."""
    lost = replace(WELL, robot_problem="frame 'odom' was not seen so far")
    expected = "no pose of the robot, so nothing is perceived: frame 'odom' was not seen so far"
    assert robot_doubt(lost) == expected
    nobody = expected.replace("perceived:", "perceived and nobody arrives:")
    assert robot_doubt(replace(lost, awaits_robot=True)) == nobody
    assert robot_doubt(replace(lost, active_s=4.9)) == ""
    assert robot_doubt(replace(lost, inputs=(NO_MAP,))) == ""
    assert robot_doubt(WELL) == ""


def test_without_a_time_that_alone_is_told() -> None:
    """Map and transforms wait for it: that they are missing would be wrong."""
    lost = replace(WELL, robot_problem="no transform was received", camera_problem="no map")
    waiting = replace(lost, uses_sim_time=True, is_without_clock=True)
    names = [status.name for status in statuses(waiting)]
    assert names[:2] == ["state", "clock"]
    assert all(name.startswith("inputs/") for name in names[2:])
    assert robot_doubt(waiting) == ""
    assert clock_doubt(waiting) == WITHOUT_CLOCK
    assert clock_doubt(replace(waiting, active_s=4.9)) == ""


def test_an_optional_input_that_never_came() -> None:
    """It is said, and no more."""
    assert of_input(NO_SCAN) == (Level.OK, "no message yet; the node works without")


@pytest.mark.parametrize(
    ("age_s", "period_s", "is_stale"),
    [
        (0.9, 0.1, False),
        (1.0, 0.1, False),
        (1.1, 0.1, True),
        (4.9, 1.0, False),
        (5.1, 1.0, True),
        (1e6, None, False),
    ],
)
def test_stale_is_five_periods_and_a_second(
    age_s: float, period_s: float | None, is_stale: bool
) -> None:
    """An input that never had a rate cannot stop; nor can one that is latched."""
    scan = replace(NO_SCAN, count=9, age_s=age_s, period_s=period_s)
    level, message = of_input(scan)
    assert (level is Level.STALE) == is_stale
    assert message.startswith("it has stopped: it came at") == is_stale
    assert of_input(replace(scan, is_latched=True))[0] is Level.OK


def test_refused_messages() -> None:
    """A warning while it is recent; an error where a required input brought nothing else."""
    why = "scan: ranges: 3 values for 4 beams"
    scan = InputSnapshot("scan", "/scan", 9, 2, 2, why, 0.1, 0.1)
    level, message = of_input(scan)
    assert level is Level.WARN
    expected = "2 messages refused in the last 10 s; the last: scan: ranges: 3 values for 4 beams"
    assert message == expected
    assert of_input(replace(scan, refused_lately=0))[0] is Level.OK
    why = "map: data: it is empty"
    level, message = of_input(replace(NO_MAP, count=1, refused=1, last_refusal=why, age_s=50.0))
    assert level is Level.ERROR
    assert message == "1 message, none of use; the last: map: data: it is empty"


BLOCKED = (
    "3 of 5 that were to arrive in the last minute found no place: "
    "fewer (population.arrival_rate), or a larger region or max_alive"
)
TROUBLES: list[tuple[dict[str, Any], str, Level, str]] = [
    (
        {"faults": FaultWatch(Counter({"b:B": 1, "a:A": 2}), "b:B fell")},
        "behaviours",
        Level.WARN,
        "the behaviour of 3 artefacts has failed, and they stand; the last: b:B fell",
    ),
    (
        {"namesake": "/ar_builder"},
        "state",
        Level.WARN,
        (
            "active; another node is called /ar_builder, too: they publish on the same topics; "
            "end one, or give one a namespace (--namespace)"
        ),
    ),
    (
        {"uses_sim_time": True, "is_without_clock": True},
        "clock",
        Level.ERROR,
        (
            "use_sim_time is true, but nothing or only 0 came on /clock, as of a simulator that is "
            "paused: the time stands still"
        ),
    ),
    (
        {"uses_sim_time": True, "clocks": 2},
        "clock",
        Level.ERROR,
        (
            "2 publishers give /clock (two players, or a simulator and a player): the time jumps "
            "to and fro between them; end all but one"
        ),
    ),
    (
        {"stamps_ahead_s": -3.15e7 * 54},
        "clock",
        Level.ERROR,
        (
            "transforms are stamped 53.9 years earlier than the time of this machine: for a "
            "simulated robot or one that is played from a recording, start the node with "
            "--use-sim-time (use_sim_time:=true)"
        ),
    ),
    (
        {"uses_sim_time": True, "stamps_ahead_s": 3.15e8},
        "clock",
        Level.ERROR,
        (
            "transforms are stamped 10.0 years later than the time of /clock: is use_sim_time "
            "set by mistake, or does another recording give the clock?"
        ),
    ),
    (
        {"robot_problem": "frame 'odom' was not seen so far"},
        "frames/robot",
        Level.ERROR,
        "no pose of the robot: frame 'odom' was not seen so far",
    ),
    (
        {"robot_beyond": "the robot is beyond the map"},
        "frames/robot",
        Level.WARN,
        "the robot is beyond the map",
    ),
    (
        {"camera_problem": "frame 'camera' was not seen so far"},
        "frames/camera",
        Level.WARN,
        "nothing is perceived: frame 'camera' was not seen so far",
    ),
    (
        {"cloud_problem": "frame 'world' was not seen so far"},
        "cloud",
        Level.WARN,
        "the cloud of voxels is not used yet: frame 'world' was not seen so far",
    ),
    (
        {"ticks": TickFigures(0.1, count=9, age_s=1.2)},
        "ticks",
        Level.STALE,
        "the last tick was 1.2 s ago: the time stands still, or one hangs",
    ),
    (
        {"ticks": replace(SLOW, left_out=267)},
        "ticks",
        Level.WARN,
        f"267 were left out in the last minute: {FALLS_BEHIND}; p50 80.0 ms, p99 100.5 ms",
    ),
    (
        {"ticks": replace(SLOW, over=2)},
        "ticks",
        Level.WARN,
        "ticks take longer than their period, 100.0 ms: p50 80.0 ms, p99 100.5 ms",
    ),
    (
        {"busy_ms": {"inputs": 3.0, "machine": 130.0, "preparing": 400.0}},
        "answers",
        Level.WARN,
        "for 130.0 ms the node did not answer: machine",
    ),
    (
        {"faults": FaultWatch(hung="the behaviour a:A of artefact 7 (guest) did not return")},
        "behaviours",
        Level.WARN,
        "the behaviour a:A of artefact 7 (guest) did not return",
    ),
    (
        {"population": PopulationSnapshot(arrivals_lately=2, blocked_lately=3)},
        "population",
        Level.WARN,
        BLOCKED,
    ),
    (
        {"population": PopulationSnapshot(is_map_closed=True)},
        "population",
        Level.WARN,
        "the map has no free cell: nobody can arrive",
    ),
    (
        {"population": PopulationSnapshot(doubt_about_region="nobody can arrive: no zone")},
        "population",
        Level.WARN,
        "nobody can arrive: no zone",
    ),
    (
        {"contacts": 2, "last_contact": "person_adult 7, 0.05 m deep", "last_contact_age_s": 5.0},
        "robot contact",
        Level.WARN,
        "the robot has touched person_adult 7, 0.05 m deep, 5.0 s ago",
    ),
    (
        {"sensors": (SensorSnapshot("/a", passed_through_lately=1, last_problem="no frame 'x'"),)},
        "scans/a",
        Level.WARN,
        "1 scan without artefacts in the last 10 s: no frame 'x'",
    ),
    (
        {"sensors": (SensorSnapshot("/b", "range", passed_through_lately=1, last_problem="why"),)},
        "ranges/b",
        Level.WARN,
        "1 range without artefacts in the last 10 s: why",
    ),
    (
        {"sensors": (SensorSnapshot("/a", "scan", 0, 0, 0, 2, "late", 0.24),)},
        "scans/a",
        Level.WARN,
        (
            "2 scans without artefacts in the last 10 s: late; transforms come up to 0.240 s "
            "after the scans: set sensors.tf_wait to 0.25"
        ),
    ),
]


@pytest.mark.parametrize(
    ("change", "name", "level", "message"), TROUBLES, ids=[one[1] for one in TROUBLES]
)
def test_trouble_is_told_by_the_part_that_has_it(
    change: dict[str, Any], name: str, level: Level, message: str
) -> None:
    """With a sentence; all others stay OK."""
    found = statuses(replace(WELL, **change))
    (bad,) = (status for status in found if status.level is not Level.OK)
    assert (bad.name, bad.level, bad.message) == (name, level, message)


@pytest.mark.parametrize(
    "change",
    [
        {"robot_problem": "frame 'odom' was not seen so far", "active_s": 4.0},
        {"camera_problem": "frame 'odom' was not seen so far", "active_s": 4.0},
        {"ticks": TickFigures(0.1)},
        {"ticks": None},
        {"ticks": TickFigures(0.1, count=9, age_s=1.0, p99_ms=100.0)},
        {"ticks": TickFigures(2.0, count=9, age_s=9.0)},
        {"ticks": replace(SLOW, over=1)},  # the first of all takes long
        {"busy_ms": {"ticks": 100.0, "preparing": 400.0, "transitions": 9000.0}},
        {"busy_ms": {"preparing": 400.0}},
        {"population": PopulationSnapshot(arrivals_lately=1, blocked_lately=2)},
        {"population": PopulationSnapshot(arrivals_lately=5, blocked_lately=5)},
        {"contacts": 2, "last_contact": "person_adult 7", "last_contact_age_s": 5.1},
        {"sensors": (SensorSnapshot("/a", passed_through=9, last_problem="no frame 'x'"),)},
        {"uses_sim_time": True},
        {"stamps_ahead_s": -86_400.0},
    ],
)
def test_what_is_no_trouble(change: dict[str, Any]) -> None:
    """It has just begun, is at its limit, or long ago."""
    assert {status.level for status in statuses(replace(WELL, **change))} == {Level.OK}


def documented() -> Iterator[tuple[str, Level]]:
    """Yield the names and levels of the page's table."""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if row := re.match(r"\| `([^`]+)` \| (\w+) \|", line):
            yield row[1], Level[row[2]]


def test_the_page_tells_of_every_level_that_a_line_can_have() -> None:
    """And of no other; OK needs no line."""
    stopped = replace(NO_SCAN, count=9, age_s=9.0, period_s=0.1)
    refused = InputSnapshot("scan", "/scan", 9, 1, 1, "why", 0.1, 0.1)
    inputs = [NO_MAP, stopped, refused]
    snapshots = [replace(WELL, **change) for change, *_ in TROUBLES]
    snapshots += [replace(WELL, inputs=(entry,)) for entry in inputs]
    found = {
        (re.sub("/(map|scan|a|b)$", "/", status.name), status.level)
        for snapshot in snapshots
        for status in statuses(snapshot)
        if status.level is not Level.OK or status.name == "state"
    }
    assert {(re.sub("/(ROLE|TOPIC)$", "/", name), level) for name, level in documented()} == found


def test_messages_go_out_with_names_and_figures() -> None:
    """A DiagnosticArray of rosbags, read back."""
    store = jazzy_typestore()
    data = encode_diagnostics(1_500_000_000, statuses(WELL))
    read = store.deserialize_cdr(data, "diagnostic_msgs/msg/DiagnosticArray")
    assert bytes(store.serialize_cdr(read, read.__msgtype__)) == data
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (1, 500_000_000)
    (scan,) = (status for status in read.status if status.name == "ar_builder: inputs/scan")
    assert (scan.level, scan.message, scan.hardware_id) == (0, "10.0 Hz", "are_ros")
    values = {value.key: value.value for value in scan.values}
    assert (values["topic"], values["rate"], values["messages"]) == ("/scan", "10.0 Hz", "90")


@pytest.mark.usefixtures("ros_available")
def test_the_same_message_goes_out_live() -> None:
    """What rclpy reads of it is equal."""
    from rclpy.serialization import deserialize_message

    from are_ros.node.message_classes import message_class

    found = statuses(replace(WELL, robot_problem="frame 'odom' was not seen so far"))
    data = encode_diagnostics(5, found, "robot/ar_builder")
    read = deserialize_message(data, message_class("diagnostic_msgs/msg/DiagnosticArray"))
    assert read.header.stamp.nanosec == 5
    assert [one.name for one in read.status] == [f"robot/ar_builder: {one.name}" for one in found]
    assert [one.level for one in read.status] == [bytes([one.level]) for one in found]
    assert [one.message for one in read.status] == [one.message for one in found]
    told = [{pair.key: pair.value for pair in one.values} for one in read.status]
    assert told == [one.values for one in found]
