"""A replay's order of things: inputs, ticks, and what lies before the window."""

import copy
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from are_ros.bag.reader import BagMessage, BagReader
from are_ros.bag.roles import find_roles
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.assembly import catalogue_of
from are_ros.builder.sensors.sensor_path import ReleasedReading
from are_ros.builder.tick import Tick
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError
from are_ros.messages.sensors import sensor_outputs
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.replay.progress import Stopwatch
from are_ros.replay.runner import Listener, Replay
from are_ros.replay.timeline import ReplayOptions, Timeline
from bags.simulation.making import RosbagsFactory

Records = Sequence[tuple[str, int, Any]]
WriteBag = Callable[[Path, Records], Path]


class Diary(Listener):
    """A listener that notes (kind, time, what) in the order in which it is told."""

    def __init__(self) -> None:
        self.entries: list[tuple[str, int, str]] = []

    def take_tick(self, tick: Tick) -> None:
        """Note a tick."""
        self.entries.append(("tick", tick.stamp_ns, ""))

    def take_readings(self, scans: Sequence[ReleasedReading]) -> None:
        """Note scans by the time of their release."""
        self.entries += [("scan", scan.released_ns, scan.topic) for scan in scans]

    def take_input(self, message: BagMessage, received_ns: int) -> None:
        """Note an input."""
        self.entries.append(("input", received_ns, message.topic))

    def times(self, kind: str) -> list[int]:
        """Return the times of one kind."""
        return [at for name, at, _ in self.entries if name == kind]


@pytest.fixture(scope="module")
def bag(
    write_bag: WriteBag, sample_records: Records, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Return a recording of the sample's first seconds."""
    return write_bag(tmp_path_factory.mktemp("bag") / "bag.mcap", sample_records)


def prepared(reader: BagReader, values: dict[str, Any], **options: Any) -> Replay:
    """Return a replay that sees nothing, which is quick."""
    parameters = with_values(Parameters(), {"camera.rate": 0.1, **values})
    builder = ArBuilder(parameters, catalogue_of(parameters))
    asked = ReplayOptions((), parameters, **options)
    timeline = Timeline.of(reader, asked, find_roles(reader.topics, {}))
    return Replay(reader, builder, asked, timeline, Stopwatch())


def diary(bag: Path, values: dict[str, Any] | None = None, **options: Any) -> tuple[Diary, Replay]:
    """Run a replay and return what it told."""
    told = Diary()
    with BagReader([bag]) as reader:
        replay = prepared(reader, values or {}, **options)
        replay.run([told], lambda _: None)
    return told, replay


@pytest.mark.parametrize("rate_hz", [7.0, 10.0])
def test_ticks_run_at_multiples_with_what_came_before(bag: Path, rate_hz: float) -> None:
    """Each multiple of the period since the epoch once, after all inputs before it."""
    told, replay = diary(bag, {"builder.tick_rate": rate_hz})
    period_ns = round(NS_PER_S / rate_hz)
    ticks = told.times("tick")
    first, last = -(-replay.start_ns // period_ns), replay.end_ns // period_ns
    assert ticks == [k * period_ns for k in range(first, last + 1)]
    assert replay.ticks == len(ticks)
    for index, (kind, now_ns, _) in enumerate(told.entries):
        if kind == "tick":
            assert all(at < now_ns for name, at, _ in told.entries[:index] if name == "input")
            assert all(at >= now_ns for name, at, _ in told.entries[index:] if name == "input")


def test_every_input_and_every_scan_comes_through(bag: Path, sample_records: Records) -> None:
    """All messages of the roles are told once; each scan is released once, none before it came."""
    told, _ = diary(bag)
    inputs = [topic for kind, _, topic in told.entries if kind == "input"]
    assert sorted(inputs) == sorted(topic for topic, _, _ in sample_records)
    assert len(told.times("scan")) == inputs.count("/scan")
    received = [at for kind, at, topic in told.entries if (kind, topic) == ("input", "/scan")]
    pairs = zip(told.times("scan"), received, strict=True)
    assert all(released >= came for released, came in pairs)


def test_before_the_window_only_what_lasts_is_fed(bag: Path, sample_records: Records) -> None:
    """Map, cloud, camera and transforms from before count as received at its start."""
    told, replay = diary(bag, start_s=2.0, duration_s=1.0)
    start_ns = sample_records[0][1] + 2 * NS_PER_S
    assert (replay.start_ns, replay.end_ns) == (start_ns, start_ns + NS_PER_S)
    assert min(told.times("input")) == start_ns
    early = sum(at < start_ns for _, at, _ in sample_records)
    skipped = sum(at < start_ns and t in {"/odom", "/scan"} for t, at, _ in sample_records)
    at_start = sum(at == start_ns for _, at, _ in sample_records)
    assert told.times("input").count(start_ns) == early - skipped + at_start
    assert max(told.times("input")) < start_ns + NS_PER_S
    assert min(told.times("tick")) == start_ns


def test_progress_ends_at_the_end(bag: Path) -> None:
    """What is told the time reached hears times that do not go back, and at last the end."""
    heard: list[int] = []
    with BagReader([bag]) as reader:
        replay = prepared(reader, {}, duration_s=1.5)
        replay.run([Diary()], heard.append)
    assert heard == sorted(heard)
    assert heard[-1] == replay.end_ns


def test_topics_are_those_of_the_roles(bag: Path) -> None:
    """A file stands in for the map's topic; `sensors.scans` names the scans."""
    with BagReader([bag]) as reader:
        usual = prepared(reader, {})
        replaced = prepared(reader, {}, map_file=Path("any.yaml"), octomap_file=Path("any.bt"))
        assert set(usual.role_of_topic) - set(replaced.role_of_topic) == {
            "/map",
            "/octomap_point_cloud_centers",
        }
        assert sensor_outputs(usual.role_of_topic) == {"/scan": "scan"}
        named = prepared(reader, {"sensors.scans": ["/scan"]})
        assert sensor_outputs(named.role_of_topic) == {"/scan": "scan"}
        none = prepared(reader, {"sensors.scans": []})
        assert sensor_outputs(none.role_of_topic) == {}


@pytest.mark.parametrize(
    ("options", "values", "sentence"),
    [
        ({"start_s": 100.0}, {}, "--start 100: the recording is 5.0 s long"),
        ({"duration_s": 0.0}, {}, "--duration 0: it must be above 0"),
        ({}, {"sensors.scans": ["nix"]}, "sensors.scans: the recording has no scan '/nix'"),
    ],
)
def test_what_cannot_be_replayed_is_said(
    bag: Path, options: dict[str, Any], values: dict[str, Any], sentence: str
) -> None:
    """An empty window and a scan that is not there."""
    with BagReader([bag]) as reader, pytest.raises(BagError) as caught:
        prepared(reader, values, **options)
    assert str(caught.value).startswith(sentence)


def test_a_range_sensor_is_augmented(
    tmp_path: Path, write_bag: WriteBag, sample_records: Records, factory: RosbagsFactory
) -> None:
    """Each reading of a named topic comes out once: nearer where an artefact is, else as it was."""
    far_m = 8.0
    sonar = [
        ("/sonar", at_ns + 1, _range(factory, message.header, far_m))
        for topic, at_ns, message in sample_records
        if topic == "/scan"
    ]
    bag = write_bag(
        tmp_path / "bag.mcap", sorted([*sample_records, *sonar], key=lambda one: one[1])
    )
    crowd = {"population.arrival_rate": 0.2, "population.mean_life": 60.0}
    kept = Kept()
    with BagReader([bag]) as reader:
        assert "/sonar" not in prepared(reader, {}).role_of_topic
        replay = prepared(reader, {"sensors.ranges": ["/sonar"], **crowd})
        replay.run([kept], lambda _: None)
    ranges = [one.reading.range_m for one in kept.readings if one.topic == "/sonar"]
    assert len(ranges) == len(sonar)
    assert max(ranges) == far_m
    assert min(ranges) < far_m


class Kept(Listener):
    """A listener that keeps readings."""

    def __init__(self) -> None:
        self.readings: list[ReleasedReading] = []

    def take_readings(self, readings: Sequence[ReleasedReading]) -> None:
        """Keep them."""
        self.readings += readings


def _range(factory: RosbagsFactory, header: Any, range_m: float) -> Any:
    """Return a Range of a sonar where the laser is, at the time of its scan."""
    return factory.make(
        "sensor_msgs/msg/Range",
        header=header,
        radiation_type=0,
        field_of_view=0.6,
        min_range=0.1,
        max_range=10.0,
        range=range_m,
        variance=0.0,
    )


class Poses(Diary):
    """A diary that keeps where the robot was at each tick."""

    def __init__(self) -> None:
        super().__init__()
        self.poses: list[list[float] | None] = []

    def take_tick(self, tick: Tick) -> None:
        """Note the robot's place."""
        at = tick.map_from_base
        self.poses.append(None if at is None else at.translation_m.tolist())


def test_static_transforms_hold_from_the_beginning_whenever_they_come(
    tmp_path: Path, write_bag: WriteBag, sample_records: Records
) -> None:
    """A recorder that missed the first ones; of two about one frame the earlier holds till then."""
    (statics,) = (m for topic, _, m in sample_records if topic == "/tf_static")
    begin_ns = sample_records[0][1]
    moved = copy.deepcopy(statics)
    for transform in moved.transforms:
        transform.transform.translation.x += 1.0
    others = [record for record in sample_records if record[0] != "/tf_static"]

    def poses(*at_s: tuple[float, Any]) -> list[list[float] | None]:
        told = [("/tf_static", begin_ns + round(s * NS_PER_S), message) for s, message in at_s]
        records = sorted([*others, *told], key=lambda record: record[1])
        path = write_bag(tmp_path / f"{len(list(tmp_path.iterdir()))}.mcap", records)
        noted = Poses()
        with BagReader([path]) as reader:
            # in the sample the base is base_footprint, which is no child of a static transform
            prepared(reader, {"frames.base": "base_scan"}).run([noted], lambda _: None)
        return noted.poses

    usual, late = poses((0.0, statics)), poses((3.0, statics))
    assert None not in usual[1:]
    assert late == usual
    twice = poses((3.0, statics), (4.0, moved))
    assert twice[:40] == usual[:40]
    assert twice[45] != usual[45]
    assert poses((0.0, statics), (4.0, moved)) == twice
