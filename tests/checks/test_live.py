"""Checks of live recordings: a replay's, made like one, right and broken on purpose.

What a recorder makes of it: log times are late, by another clock where one likes, and stand still
when the clock jumps back; it begins and ends at any time, and may pause, as the node may.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

from are_ros.bag.reader import BagReader
from are_ros.bag.recording import find_recording
from are_ros.bag.types import jazzy_typestore
from are_ros.bag.writer import BagWriter
from are_ros.builder.costmap.inflation import InflatedCostmap
from are_ros.checks.record import Reading
from are_ros.checks.result import CheckResult
from are_ros.checks.run import Outcome, check_recording
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import (
    EFFECTIVE_TYPE,
    read_ros_parameters,
    write_ros_parameters,
)
from tests.replay.conftest import ReplaySample

MS = 1_000_000
OUT = "/ar_builder/"
GRIDS = ("augmented_map", "artefact_map", "augmented_costmap")
LATCHED = ("/map", "/tf_static", *(OUT + name for name in GRIDS))
TICK_OUTPUTS = ("artefacts", "perceived", "metrics", "events", "markers")

Entry = tuple[int, str, bytes]


@dataclass(frozen=True)
class Tape:
    """A recording: (log time, topic, message in CDR) in the order of the file, and the types."""

    entries: tuple[Entry, ...]
    types: dict[str, str]
    parameters: Path
    latched: frozenset[str] = field(default=frozenset(LATCHED))

    @classmethod
    def of(cls, folder: Path) -> "Tape":
        """Read the results of a replay."""
        with (folder / "augmented.mcap").open("rb") as stream:
            messages = [*make_reader(stream).iter_messages(log_time_order=False)]
        types = {channel.topic: schema.name for schema, channel, _ in messages if schema}
        entries = tuple((m.log_time, channel.topic, m.data) for _, channel, m in messages)
        return cls(entries, types, folder / "effective.yaml")

    @property
    def start_ns(self) -> int:
        """Log time of the first message."""
        return self.entries[0][0]

    def late(self, seed: int = 1, most_ns: int = 30 * MS) -> "Tape":
        """Return the tape with each message logged a little later; topics keep their order."""
        delays = np.random.default_rng(seed).integers(0, most_ns, len(self.entries)).tolist()
        last, moved = dict[str, int](), list[Entry]()
        for (log_ns, topic, data), delay_ns in zip(self.entries, delays, strict=True):
            last[topic] = max(log_ns + delay_ns, last.get(topic, 0))
            moved.append((last[topic], topic, data))
        return replace(self, entries=tuple(sorted(moved, key=lambda entry: entry[0])))

    def part(self, begin_s: float, end_s: float = 1e6, late: bool = True) -> "Tape":
        """Return what is recorded from one time to another; what is latched comes first if late."""
        begin_ns, end_ns = (self.start_ns + round(s * NS_PER_S) for s in (begin_s, end_s))
        before = {t: data for log, t, data in self.entries if log < begin_ns and t in LATCHED}
        first = [(begin_ns, topic, data) for topic, data in before.items() if late]
        kept = [entry for entry in self.entries if begin_ns <= entry[0] < end_ns]
        return replace(self, entries=(*first, *kept))

    def without_images(self) -> "Tape":
        """Return the tape without images and depth images, neither inputs nor outputs."""
        images = {t for t, name in self.types.items() if name.endswith("Image")}
        kept = (entry for entry in self.entries if entry[1] not in images)
        return replace(self, entries=tuple(kept))

    def without(self, begin_s: float, end_s: float) -> "Tape":
        """Return the tape with nothing recorded for some time."""
        times = (self.start_ns + round(s * NS_PER_S) for s in (begin_s, end_s))
        begin_ns, end_ns = times
        kept = (entry for entry in self.entries if not begin_ns <= entry[0] < end_ns)
        return replace(self, entries=tuple(kept))

    def then(self, *entries: Entry) -> "Tape":
        """Return the tape with more at its end."""
        return replace(self, entries=(*self.entries, *entries))

    def later(self, by_ns: int) -> "Tape":
        """Return the tape as of another time: all log times, and all stamps but 0."""
        entries = []
        for log_ns, topic, data in self.entries:
            message = decoded(self.types[topic], data)
            shift_stamps(message, by_ns)
            entries.append((log_ns + by_ns, topic, encoded(self.types[topic], message)))
        return replace(self, entries=tuple(entries))

    def looped(self) -> "Tape":
        """Return the tape twice; log times stand still meanwhile, as a recorder's do."""
        end_ns = self.entries[-1][0]
        return self.then(*((end_ns, topic, data) for _, topic, data in self.entries))

    def edited(
        self, name: str, change: Callable[[Any], Any], begin_s: float, end_s: float
    ) -> "Tape":
        """Return the tape with messages of a topic changed, in place; None drops one."""
        topic = name if name.startswith("/") else OUT + name
        times = tuple(self.start_ns + round(s * NS_PER_S) for s in (begin_s, end_s))
        entries: list[Entry] = []
        for log_ns, at, data in self.entries:
            if at != topic or not times[0] <= log_ns < times[1]:
                entries.append((log_ns, at, data))
                continue
            message = decoded(self.types[topic], data)
            if change(message) is not DROP:
                entries.append((log_ns, at, encoded(self.types[topic], message)))
        return replace(self, entries=tuple(entries))

    def last(self, name: str) -> Any:
        """Return the last message of a topic."""
        topic = name if name.startswith("/") else OUT + name
        data = next(data for _, at, data in reversed(self.entries) if at == topic)
        return decoded(self.types[topic], data)

    def farewell(self, stamp_ns: int) -> tuple[Entry, ...]:
        """Return what a node gives out when it takes its leave after this tape."""
        entries = []
        for name in (*GRIDS, "artefacts", "perceived", "metrics"):
            message = self.last(name)
            stamp(message.header, stamp_ns)
            if name in {"artefacts", "perceived"}:
                message.artefacts = []
            elif name == "metrics":
                message.alive = message.perceived = 0
            else:
                message.data = self.bare(name)
            topic = OUT + name
            entries.append((stamp_ns, topic, encoded(self.types[topic], message)))
        return (*entries, self.wipe(stamp_ns))

    def bare(self, name: str) -> Any:
        """Return the data of a grid without artefacts."""
        real = self.last("/map")
        cells = real.data.reshape(real.info.height, real.info.width)
        if name != "augmented_costmap":
            return cells.reshape(-1).copy() if name == "augmented_map" else 0 * cells.reshape(-1)
        costmap, world = self.settings.costmap, self.settings.world
        inflated = InflatedCostmap(
            costmap.inflation_radius, costmap.cost_scaling_factor, self.settings.robot.radius
        )
        unknown = (cells < 0) | (
            (cells > world.free_threshold) & (cells < world.occupied_threshold)
        )
        inflated.set_map(cells >= world.occupied_threshold, unknown, real.info.resolution)
        return inflated.published().copy().reshape(-1)

    def wipe(self, stamp_ns: int) -> Entry:
        """Return a DELETEALL."""
        topic = OUT + "markers"
        arrays = (decoded(self.types[topic], d) for _, at, d in self.entries if at == topic)
        array = next(array for array in arrays if array.markers)
        marker = array.markers[0]
        marker.action, marker.ns, marker.id, marker.type = 3, "", 0, 1
        marker.points, marker.colors, marker.text = [], [], ""
        stamp(marker.header, stamp_ns)
        array.markers = [marker]
        return stamp_ns, topic, encoded(self.types[topic], array)

    def redrawn(self, stamp_ns: int) -> Entry:
        """Return a DELETEALL with all that is on display then, as for a new viewer."""
        topic, shown = OUT + "markers", dict[tuple[str, int], Any]()
        for log_ns, at, data in self.entries:
            array = decoded(self.types[at], data) if at == topic and log_ns <= stamp_ns else None
            for marker in array.markers if array else ():
                shown.pop((marker.ns, marker.id), None)
                if marker.action == 0:
                    shown[marker.ns, marker.id] = marker
        array = decoded(self.types[topic], self.wipe(stamp_ns)[2])
        for marker in shown.values():
            stamp(marker.header, stamp_ns)
            array.markers.append(marker)
        return stamp_ns, topic, encoded(self.types[topic], array)

    @property
    def settings(self) -> Parameters:
        """The effective parameters."""
        return with_values(Parameters(), read_ros_parameters(self.parameters))

    def write(self, folder: Path) -> Path:
        """Write augmented.mcap and effective.yaml, as the recorder does."""
        folder.mkdir(parents=True, exist_ok=True)
        self.write_file(folder / "augmented.mcap")
        (folder / "effective.yaml").write_text(self.parameters.read_text())
        return folder

    def write_file(self, path: Path) -> Path:
        """Write an MCAP file."""
        with BagWriter(path) as writer:
            for topic, type_name in self.types.items():
                writer.add_topic(topic, type_name, is_latched=topic in self.latched, depth=0)
            for log_ns, topic, data in self.entries:
                writer.write_raw(topic, log_ns, data)
        return path


DROP = object()
"""What a change returns for a message that is to be left out."""


def shift_stamps(message: Any, by_ns: int) -> None:
    """Add a time to all stamps in a message but those of 0, in place."""
    for value in vars(message).values():
        if type(value).__name__.endswith("__Time"):
            time_ns = value.sec * NS_PER_S + value.nanosec
            if time_ns:
                value.sec, value.nanosec = divmod(time_ns + by_ns, NS_PER_S)
        elif isinstance(value, list):
            for one in value:
                if hasattr(one, "__msgtype__"):
                    shift_stamps(one, by_ns)
        elif hasattr(value, "__msgtype__"):
            shift_stamps(value, by_ns)


def decoded(type_name: str, data: bytes) -> Any:
    """Return a message that may be changed."""
    message = jazzy_typestore().deserialize_cdr(data, type_name)
    for name in ("data", "ranges", "intensities"):
        if isinstance(getattr(message, name, None), np.ndarray):
            setattr(message, name, getattr(message, name).copy())
    return message


def encoded(type_name: str, message: Any) -> bytes:
    """Return a message in CDR."""
    return bytes(jazzy_typestore().serialize_cdr(message, type_name))


def stamp(header: Any, stamp_ns: int) -> None:
    """Set a header's stamp."""
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)


def results_of(path: Path) -> dict[str, CheckResult]:
    """Check a recording, and return the results by name."""
    return {result.name: result for result in check_recording(path)}


def bad(results: dict[str, CheckResult]) -> list[str]:
    """Return the sentences of what failed."""
    return [r.sentence() for r in results.values() if r.outcome is Outcome.FAILED]


@pytest.fixture(scope="module")
def whole(sample_replay: Path) -> Tape:
    """Return eight seconds among many artefacts, as a replay wrote them."""
    return Tape.of(sample_replay)


@pytest.fixture(scope="module")
def live(whole: Tape) -> Tape:
    """Return them as a recorder that came 1.5 seconds late."""
    return whole.late().part(1.5)


NOT_LIVE = {"farewells", "walls before changed beams", "depth images computed anew"}
NOT_LIVE |= {"rays that artefacts stop"}


def test_a_right_live_recording_passes_every_check(live: Tape, tmp_path: Path) -> None:
    """Nothing fails though it began late; all is checked but what is not known live.

    There is no farewell, and the recording does not tell which walls a scan was augmented with.
    """
    results = tuple(check_recording(live.write(tmp_path)))
    by_name = {result.name: result for result in results}
    assert bad(by_name) == []
    skipped = {name for name, result in by_name.items() if result.outcome is Outcome.SKIPPED}
    assert skipped == NOT_LIVE
    assert len(by_name) == len(results) == 33
    assert by_name["lives"].looked_at >= 40
    assert "ms after their time" in by_name["ticks"].reason
    for name in (
        "map updates",
        "augmented map",
        "artefact map",
        "artefact map updates",
        "ends of changed beams",
        "sight events",
    ):
        assert by_name[name].looked_at > 5, name


def test_the_end_of_a_node_is_checked(live: Tape, tmp_path: Path) -> None:
    """Its farewell, and the real map that it relays afterwards, are no ticks and no faults."""
    end_ns = live.entries[-1][0] + 7 * MS
    relayed = next(data for _, topic, data in live.entries if topic == "/map")
    tape = live.then(
        *live.farewell(end_ns), (end_ns + 2 * NS_PER_S, OUT + "augmented_map", relayed)
    )
    results = results_of(tape.write(tmp_path))
    assert bad(results) == []
    assert results["farewells"].looked_at == 1
    assert results["augmented map"].looked_at > 2


@pytest.mark.parametrize("has_grids", [True, False])
@pytest.mark.parametrize("late_ns", [40 * MS, 0])
def test_a_farewell_at_the_time_of_a_tick_is_told_from_it(
    live: Tape, tmp_path: Path, late_ns: int, *, has_grids: bool
) -> None:
    """With a coarse clock it comes with the very stamp of the last tick, or a clock stood still.

    That tick gave out grids of its own, or none, as moves reach them now and then.
    """
    live = live.part(0.0, 3.0)  # there are artefacts in the maps
    message = live.last("artefacts")
    stamp_ns = message.header.stamp.sec * NS_PER_S + message.header.stamp.nanosec
    grids = {OUT + name for name in (*GRIDS, "augmented_map_updates", "artefact_map_updates")}
    end_ns = live.entries[-1][0]
    before = [entry for entry in live.entries if entry[0] < stamp_ns]
    tick = [(end_ns, topic, data) for at, topic, data in live.entries if at >= stamp_ns]
    own = [entry for entry in tick if has_grids or entry[1] not in grids]
    end = [(end_ns + late_ns, topic, data) for _, topic, data in live.farewell(stamp_ns)]
    results = results_of(replace(live, entries=(*before, *own, *end)).write(tmp_path))
    assert bad(results) == []
    assert results["farewells"].looked_at == 1


def test_a_node_that_paused_goes_on_with_those_it_had(whole: Tape, tmp_path: Path) -> None:
    """After a farewell the old ids come again, without having arrived anew."""
    first, second = whole.part(0.0, 3.0), whole.part(4.5, late=False)
    end_ns = first.entries[-1][0] + 30 * MS
    tick_ns = whole.start_ns + 4500 * MS
    everybody = whole.redrawn(tick_ns)
    tape = first.then(*first.farewell(end_ns), everybody, *second.entries)
    results = results_of(tape.late().write(tmp_path))
    assert bad(results) == []
    assert results["farewells"].looked_at == 1


@pytest.mark.parametrize("length_s", [0.4, 2.0])
def test_a_recorder_may_pause(whole: Tape, length_s: float, tmp_path: Path) -> None:
    """What was missed meanwhile is not missed by the checks."""
    results = results_of(whole.late().without(3.02, 3.02 + length_s).write(tmp_path))
    assert bad(results) == []
    assert results["lives"].looked_at > 30


def test_a_looping_recording_is_checked_until_the_clock_jumps_back(
    whole: Tape, tmp_path: Path
) -> None:
    """The user is told so; what comes after the jump is not looked at, right or wrong."""
    once = whole.late().part(1.5)
    results, single = results_of(once.looped().write(tmp_path)), results_of(once.write(tmp_path))
    assert bad(results) == []
    assert "the clock jumps back" in results["rosbags reader"].reason
    for name in ("ticks", "lives", "sight events", "overlaps with the robot", "scans"):
        assert results[name].looked_at == single[name].looked_at > 0, name


def test_parameters_that_changed_meanwhile_are_told(whole: Tape, tmp_path: Path) -> None:
    """The checks do not follow them, so a result that differs may be right."""
    topic, text_type = "/ar_builder/effective_parameters", jazzy_typestore().types[EFFECTIVE_TYPE]
    changed = with_values(Parameters(), {"costmap.gate": "all", "camera.mount": [0.1] * 6})
    tape = replace(whole.part(1.5), types={**whole.types, topic: EFFECTIVE_TYPE})
    said = "camera.mount and costmap.gate changed while it was recorded"
    for folder, told in (("once", [Parameters()]), ("twice", [Parameters(), changed])):
        texts = [text_type(write_ros_parameters(parameters)) for parameters in told]
        at_ns = tape.entries[-1][0]
        entries = [(at_ns + k, topic, encoded(EFFECTIVE_TYPE, t)) for k, t in enumerate(texts)]
        reason = results_of(tape.then(*entries).write(tmp_path / folder))["rosbags reader"].reason
        assert (said in reason) == (folder == "twice")


def test_messages_of_both_sides_may_mix_about_the_jump(whole: Tape, tmp_path: Path) -> None:
    """The topics do not jump at once: some messages of the end come after the beginning's."""
    tape = whole.part(1.5, 5.0).looped()
    half = len(tape.entries) // 2
    near = list(tape.entries[half - 40 : half + 40])
    order = np.random.default_rng(4).permutation(len(near)).tolist()
    by_topic: dict[str, list[Entry]] = {}
    for entry in tape.entries[half - 40 : half + 40]:
        by_topic.setdefault(entry[1], []).append(entry)
    mixed = [by_topic[near[number][1]].pop(0) for number in order]
    entries = (*tape.entries[: half - 40], *mixed, *tape.entries[half + 40 :])
    assert bad(results_of(replace(tape, entries=entries).write(tmp_path))) == []


def test_another_clock_than_that_of_the_stamps_does_no_harm(live: Tape, tmp_path: Path) -> None:
    """A recorder may log by the wall clock what is stamped in simulated time at twice the rate."""
    start_ns = live.entries[0][0]
    entries = tuple((5 + (log - start_ns) // 2, topic, data) for log, topic, data in live.entries)
    results = results_of(replace(live, entries=entries).write(tmp_path))
    assert bad(results) == []
    assert "another clock" in results["ticks"].reason


def describe_folder(file: Path) -> None:
    """Write the metadata.yaml of rosbag2 beside an MCAP file."""
    with BagReader([file]) as reader:
        topics = [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": [],
                    "type_description_hash": "",
                },
                "message_count": topic.count,
            }
            for topic in reader.topics
        ]
        start_ns, end_ns = reader.start_ns, reader.end_ns
        total = sum(topic.count for topic in reader.topics)
    extent = {
        "starting_time": {"nanoseconds_since_epoch": start_ns},
        "duration": {"nanoseconds": end_ns - start_ns},
        "message_count": total,
    }
    description = {
        "version": 9,
        "storage_identifier": "mcap",
        **extent,
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name],
        "files": [{"path": file.name, **extent}],
        "custom_data": None,
        "ros_distro": "jazzy",
    }
    content = yaml.safe_dump({"rosbag2_bagfile_information": description})
    file.with_name("metadata.yaml").write_text(content, encoding="utf-8")


def test_a_bare_file_and_a_rosbag2_folder_are_recordings(live: Tape, tmp_path: Path) -> None:
    """Without parameters what needs them is skipped; they may be given, or lie beside the file."""
    bag = tmp_path / "bag"
    bag.mkdir()
    file = live.write_file(bag / "bag_0.mcap")
    results = results_of(file)
    assert bad(results) == []
    assert results["lives"].outcome is Outcome.PASSED
    assert "nothing tells its parameters" in results["costmap"].sentence()
    describe_folder(file)
    (bag / "effective.yaml").write_text("[", encoding="utf-8")  # not looked at where one is given
    given = tuple(check_recording(bag, parameters_file=live.parameters))
    assert {r.name for r in given if r.outcome is not Outcome.PASSED} == NOT_LIVE


def test_a_database_is_read_too(live: Tape, tmp_path: Path) -> None:
    """An .db3 folder passes, but what is looked at in MCAP files only is skipped."""
    folder = tmp_path / "db"
    with Ros2Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connections = {
            topic: writer.add_connection(topic, name, typestore=jazzy_typestore())
            for topic, name in live.types.items()
        }
        for log_ns, topic, data in live.entries:
            writer.write(connections[topic], log_ns, data)
    (folder / "effective.yaml").write_text(live.parameters.read_text())
    results = results_of(folder)
    assert bad(results) == []
    assert "only MCAP" in results["quality of service"].sentence()
    assert results["costmap"].outcome is Outcome.PASSED


def test_topics_that_were_not_recorded_are_not_missed(live: Tape, tmp_path: Path) -> None:
    """Only with the lists of artefacts there are ticks; the rest is checked as far as it goes."""
    few = {OUT + "artefacts", OUT + "markers", "/map"}
    tape = replace(
        live,
        entries=tuple(entry for entry in live.entries if entry[1] in few),
        types={topic: name for topic, name in live.types.items() if topic in few},
    )
    results = results_of(tape.write(tmp_path))
    assert results["walls"].outcome is Outcome.PASSED
    assert results["markers of the living"].outcome is Outcome.PASSED
    assert "without ~/perceived" in results["ticks"].reason
    assert {r.name for r in results.values() if r.outcome is Outcome.FAILED} == {"lives"}


def test_several_grids_leave_open_which_is_the_real_map(live: Tape, tmp_path: Path) -> None:
    """A costmap of Nav2 is not taken for the map, nor does it hide it."""
    costmap = "/global_costmap/costmap"
    data = next(data for _, topic, data in live.entries if topic == OUT + "augmented_costmap")
    more = replace(live, types=live.types | {costmap: "nav_msgs/msg/OccupancyGrid"})
    more = replace(more, entries=((live.start_ns, costmap, data), *more.entries))
    assert bad(results_of(more.write(tmp_path))) == []
    renamed = tuple((log, "/floor" if t == "/map" else t, d) for log, t, d in more.entries)
    types = {"/floor" if t == "/map" else t: name for t, name in more.types.items()}
    results = results_of(replace(more, entries=renamed, types=types).write(tmp_path))
    assert "(/floor, /global_costmap/costmap)" in results["costmap"].sentence()


def test_an_odd_type_of_another_topic_does_no_harm(live: Tape, tmp_path: Path) -> None:
    """Robots record types that nobody else can read."""
    with (tmp_path / "odd.mcap").open("wb") as stream:
        writer = McapWriter(stream)
        writer.start(profile="ros2")
        schema = writer.register_schema("odd_msgs/msg/Odd", "ros2msg", b"no such thing = ?")
        odd = writer.register_channel("/odd", "cdr", schema)
        channels = {}
        for topic, name in live.types.items():
            text = jazzy_typestore().generate_msgdef(name)[0].encode()
            number = writer.register_schema(name, "ros2msg", text)
            channels[topic] = writer.register_channel(topic, "cdr", number)
        for log_ns, topic, data in live.entries:
            writer.add_message(odd, log_ns, b"\0\1\0\0?", log_ns)
            writer.add_message(channels[topic], log_ns, data, log_ns)
        writer.finish()
    results = results_of(tmp_path / "odd.mcap")
    assert bad(results) == []
    assert results["lives"].outcome is Outcome.PASSED
    assert "offered quality of service is not known" in results["quality of service"].sentence()


def test_what_is_no_recording_of_the_node_is_refused(sample_bag: Path, tmp_path: Path) -> None:
    """A sentence says what is missing."""
    for path, text in (
        (tmp_path / "none", "there is no such file"),
        (tmp_path, r"there is no augmented\.mcap"),
        (sample_bag, "holds no topic of the node"),
        (sample_bag.parent / "README.md", "no recording of ROS 2"),
    ):
        with pytest.raises(BagError, match=text):
            tuple(check_recording(path))
    for name in ("a.mcap", "b.mcap"):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(BagError, match=r"several recordings.*a\.mcap, b\.mcap"):
        tuple(check_recording(tmp_path))
    (tmp_path / "metadata.yaml").write_text("a: [")
    with pytest.raises(BagError, match=r"metadata\.yaml is malformed"):
        tuple(check_recording(tmp_path))


def test_a_map_may_come_to_the_node_after_its_first_ticks(live: Tape, tmp_path: Path) -> None:
    """Until then it knows no clutter ratio, and gives out no grids."""
    tape = live.edited("metrics", _set("clutter_ratio", float("nan")), -1.0, 3.0)
    for name in (*GRIDS, "augmented_map_updates", "artefact_map_updates"):
        tape = tape.edited(name, _drop, -1.0, 3.0)
    results = results_of(tape.write(tmp_path))
    assert bad(results) == []
    assert "ticks before the node knew a map" in results["clutter ratio"].reason


def test_a_damaged_live_recording_is_a_result(live: Tape, tmp_path: Path) -> None:
    """A file without an end fails, and raises nothing; there is nothing else to look at."""
    path = live.write(tmp_path) / "augmented.mcap"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    results = results_of(tmp_path)
    assert set(results) == {"mcap reader", "rosbags reader"}
    for result in results.values():
        assert result.outcome is Outcome.FAILED
        assert "it ends too early" in result.counter_example
    path.write_text("no recording at all\n" * 100)
    for result in results_of(tmp_path).values():
        assert "its first bytes are not those of a bag" in result.counter_example


def test_a_replay_s_folder_is_told_by_its_metrics(
    sample_replay: Path, live: Tape, tmp_path: Path
) -> None:
    """With metrics.json log times must be the stamps; without, they need not."""
    assert bad(results_of(sample_replay)) == []
    assert "farewells" not in results_of(sample_replay)
    live.write(tmp_path)
    (tmp_path / "metrics.json").write_text("{}")
    assert results_of(tmp_path)["ticks"].outcome is Outcome.FAILED
    assert results_of(tmp_path / "augmented.mcap")["ticks"].outcome is Outcome.FAILED


Break = Callable[[Tape], Tape]


def _each(
    name: str, change: Callable[[Any], Any], begin_s: float = 4.0, end_s: float = 4.3
) -> Break:
    """Return what changes the messages of a topic in some tenths of a second."""
    return lambda tape: tape.edited(name, change, begin_s, end_s)


def _drop(_message: Any) -> object:
    return DROP


def _set(path: str, value: Any) -> Callable[[Any], None]:
    """Return what sets a field; a number in the path is an index."""

    def change(message: Any) -> None:
        *parents, last = path.split(".")
        for part in parents:
            message = message[int(part)] if part.isdecimal() else getattr(message, part)
        setattr(message, last, value)

    return change


def _few_pixels(message: Any) -> None:
    for one in message.artefacts:
        one.visible_pixels = 3


def _swap_first(message: Any) -> None:
    message.artefacts[0], message.artefacts[1] = message.artefacts[1], message.artefacts[0]


def _onto(message: Any) -> None:
    """Put the second artefact into the first."""
    for pose in ("pose", "ground_pose"):
        place = getattr(message.artefacts[0], pose).position
        getattr(message.artefacts[1], pose).position = place


def _move(x: float, y: float) -> Callable[[Any], None]:
    """Return what puts the first artefact somewhere."""

    def change(message: Any) -> None:
        for pose in (message.artefacts[0].pose, message.artefacts[0].ground_pose):
            pose.position.x, pose.position.y = x, y

    return change


def _into_the_robot(tape: Tape) -> Tape:
    """Put the first artefact to where the robot is meanwhile."""
    frames = [decoded(tape.types["/tf"], data) for _, topic, data in tape.entries if topic == "/tf"]
    edges = [t for message in frames for t in message.transforms]
    outer = next(t for t in edges if t.child_frame_id == "odom").transform
    near = min(
        (t for t in edges if t.child_frame_id == "base_footprint"),
        key=lambda t: abs(t.header.stamp.sec + t.header.stamp.nanosec / 1e9 - _middle_s(tape)),
    ).transform
    yaw = 2.0 * np.arctan2(outer.rotation.z, outer.rotation.w)
    x, y = near.translation.x, near.translation.y
    place = (
        outer.translation.x + np.cos(yaw) * x - np.sin(yaw) * y,
        outer.translation.y + np.sin(yaw) * x + np.cos(yaw) * y,
    )
    return tape.edited("artefacts", _move(*map(float, place)), 4.0, 4.3)


def _middle_s(tape: Tape) -> float:
    return tape.start_ns / NS_PER_S + 4.1


def _flip_cell(message: Any) -> None:
    free = np.flatnonzero(message.data == 0)
    message.data[free[0]] = 100


def _lower(message: Any) -> None:
    message.data[np.flatnonzero(message.data == 99)[0]] = 0


def _raise(message: Any) -> None:
    message.data[np.flatnonzero(message.data == 0)[0]] = 42


def _in_update(message: Any) -> None:
    message.data[:] = 7


def _longer(message: Any) -> None:
    message.ranges[np.flatnonzero(message.ranges > 1.0)[0]] += 0.5


def _in_the_air(message: Any) -> None:
    beam = np.flatnonzero(message.ranges > 2.0)[0]
    message.ranges[beam] = 0.4


def _lives_for_ever(message: Any) -> None:
    for marker in message.markers:
        marker.lifetime.sec = 0


def _no_deletes(message: Any) -> None:
    message.markers = [marker for marker in message.markers if marker.action == 0]


def _unlocated(message: Any) -> None:
    for marker in message.markers:
        marker.header.frame_id = "odom"


def _bad_farewell(name: str, change: Callable[[Any], Any]) -> Break:
    """Return what ends a recording with a farewell in which something is wrong."""

    def make(tape: Tape) -> Tape:
        end_ns = tape.entries[-1][0] + 7 * MS
        end = replace(tape, entries=tape.farewell(end_ns)).edited(name, change, -1.0, 1.0)
        more = whole_second(tape, end_ns)
        return tape.then(*end.entries, *more)

    return make


def whole_second(tape: Tape, after_ns: int) -> tuple[Entry, ...]:
    """Return an empty tick some time after the end."""
    stamp_ns = (after_ns // (100 * MS) + 20) * 100 * MS
    names = {OUT + name for name in ("artefacts", "perceived", "metrics")}
    entries = []
    for _, topic, data in tape.farewell(stamp_ns):
        if topic in names:
            entries.append((stamp_ns, topic, data))
    return tuple(entries)


def _retyped(tape: Tape) -> Tape:
    topic = OUT + "metrics"
    kept = tuple(entry for entry in tape.entries if entry[1] != topic)
    return replace(tape, entries=kept, types=tape.types | {topic: "std_msgs/msg/Header"})


def _back_in_time(tape: Tape) -> Tape:
    (log_ns, topic, data), *others = reversed(tape.entries)
    return replace(tape, entries=(*reversed(others), (log_ns - 500 * MS, topic, data)))


def _shifted_scan(tape: Tape) -> Tape:
    def change(message: Any) -> None:
        message.header.stamp.nanosec += 1000

    return tape.edited("scan", change, 4.0, 4.3)


def _departed_for_good(tape: Tape) -> Tape:
    """Take the DELETEs away, and give the markers a long life."""

    def change(message: Any) -> None:
        _no_deletes(message)
        for marker in message.markers:
            marker.lifetime.sec = 60

    return tape.edited("markers", change, -1.0, 60.0)


def stamp_later(message: Any, by_ns: int) -> None:
    """Move a message's stamp."""
    header = message.header
    stamp(header, header.stamp.sec * NS_PER_S + header.stamp.nanosec + by_ns)


def _relayed_late(tape: Tape) -> Tape:
    """Return a tape after whose end something else than the real map is relayed."""
    message = tape.last("/map")
    _flip_cell(message)
    topic, end_ns = OUT + "augmented_map", tape.entries[-1][0] + 5 * NS_PER_S
    stamp(message.header, end_ns)
    tick = whole_second(tape, end_ns + 5 * NS_PER_S)
    return tape.then((end_ns, topic, encoded(tape.types[topic], message)), *tick)


BROKEN: dict[str, tuple[str, Break, str]] = {
    "cut message": (
        "rosbags reader",
        lambda tape: tape.then((tape.entries[-1][0], OUT + "events", b"\0\1\0\0short")),
        "/ar_builder/events logged",
    ),
    "cut markers": (
        "rosbags reader",
        lambda tape: tape.then((tape.entries[-1][0], OUT + "markers", b"\0\1\0\0\1\0\0\0")),
        "/ar_builder/markers",
    ),
    "log times": ("log times", _back_in_time, "goes back in time"),
    "wrong type": ("topics and types", _retyped, "/ar_builder/metrics of type std_msgs"),
    "volatile map": (
        "quality of service",
        lambda tape: replace(tape, latched=tape.latched - {OUT + "augmented_map"}),
        "/ar_builder/augmented_map is offered as reliable, volatile",
    ),
    "metrics lost": ("ticks", _each("metrics", _drop), "~/metrics and ~/artefacts differ"),
    "list lost": ("ticks", _each("artefacts", _drop, 4.0, 4.1), "differ"),
    "frame": ("ticks", _each("artefacts", _set("header.frame_id", "odom")), "frame is 'odom'"),
    "off the period": (
        "ticks",
        _each("artefacts", lambda message: stamp_later(message, 7 * MS)),
        "there is no tick",
    ),
    "order of ids": ("ticks", _each("artefacts", _swap_first), "do not ascend"),
    "dropped from the list": (
        "lives",
        _each("artefacts", lambda message: message.artefacts.pop(0) and None),
        "differ in the ids",
    ),
    "events lost": ("lives", _each("events", _drop, 4.0, 5.0), "differ in the ids"),
    "count": (
        "metrics",
        _each("metrics", lambda m: setattr(m, "arrivals", m.arrivals + 1)),
        "arrivals is",
    ),
    "alive": ("metrics", _each("metrics", _set("alive", 77)), "alive is 77"),
    "few pixels": (
        "perceived",
        _each("perceived", _few_pixels, 0.0, 60.0),
        "tau is",
    ),
    "sight unsaid": ("sight events", _each("events", _drop, 1.0, 6.4), "PERCEIVED tells of"),
    "in the wall": ("walls", _each("artefacts", _move(-0.1, 4.0)), "covers the occupied cell"),
    "overlap": ("overlaps of artefacts", _each("artefacts", _onto), "overlap by"),
    "in the robot": ("overlaps with the robot", _into_the_robot, "overlaps the robot"),
    "clutter": ("clutter ratio", _each("metrics", _set("clutter_ratio", 0.9)), "it is 0.9"),
    "clutter unknown": (
        "clutter ratio",
        _each("metrics", _set("clutter_ratio", float("nan"))),
        "it is nan",
    ),
    "marker frame": ("marker rules", _each("markers", _unlocated, 4.0, 5.0), "is in frame 'odom'"),
    "not deleted": ("markers of the living", _each("markers", _no_deletes, -1, 60), "stale ["),
    "markers lost": ("markers of the living", _each("markers", _drop, 4.0, 5.5), "is wrong"),
    "endless": ("markers fade", _each("markers", _lives_for_ever), "a lifetime of 0 s"),
    "outlived": ("markers fade", _departed_for_good, "a lifetime of 60 s"),
    "cell": ("augmented map", _each("augmented_map", _flip_cell, 3.0, 6.0), "is 100, it must be"),
    "stale map": ("augmented map is current", _each("augmented_map", _drop, 3.0, 60), "since"),
    "stale costs": ("costmap is current", _each("augmented_costmap", _drop, 3.0, 60), "since"),
    "artefact cell": ("artefact map", _each("artefact_map", _flip_cell, 3.0, 6.0), "must be 0"),
    "artefact update": (
        "artefact map updates",
        _each("artefact_map_updates", _in_update, 3.0, 6.0),
        "the map before",
    ),
    "stale artefacts": (
        "artefact map is current",
        _each("artefact_map", _drop, 3.0, 60),
        "since",
    ),
    "update": (
        "map updates",
        _each("augmented_map_updates", _in_update, 3.0, 6.0),
        "the map before",
    ),
    "update unsaid": (
        "map updates",
        _each("augmented_map_updates", _drop, 3.0, 6.0),
        "without an update",
    ),
    "floor": (
        "costmap is never lower than the real map's",
        _each("augmented_costmap", _lower, 3.0, 6.0),
        "is 0, it must be 99",
    ),
    "costs": ("costmap", _each("augmented_costmap", _raise, 3.0, 6.0), "is 42"),
    "relayed otherwise": (
        "augmented map",
        _relayed_late,
        "belongs to no tick, and is not the real map's",
    ),
    "longer beam": ("scans", _each("scan", _longer), "where its input has"),
    "invented scan": ("scans", _shifted_scan, "has no scan of this stamp"),
    "in the air": ("ends of changed beams", _each("scan", _in_the_air), "where no artefact is"),
    "markers stay": ("farewells", _bad_farewell("markers", _drop), "the markers are not deleted"),
    "told of": (
        "farewells",
        _bad_farewell("metrics", _set("alive", 2)),
        "there is still word of 2 artefacts",
    ),
    "left behind": ("augmented map", _bad_farewell("augmented_map", _flip_cell), "at a farewell"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_is_broken_is_caught_live(case: str, live: Tape, tmp_path: Path) -> None:
    """The check whose business it is fails, with a counter-example that names the place.

    None of them is about images, which take most of the time of a check.
    """
    name, break_it, text = BROKEN[case]
    result = results_of(break_it(live.without_images()).write(tmp_path))[name]
    assert result.outcome is Outcome.FAILED, result.sentence()
    assert text in result.counter_example


@pytest.mark.parametrize(
    ("begin_s", "end_s", "has_farewell"),
    [(0.15, 1e6, True), (0.0, 1e6, True), *((0.0, end_s, False) for end_s in (3.0, 5.0, 7.0))],
)
def test_a_node_that_was_started_again_begins_with_the_same_ids(
    whole: Tape, tmp_path: Path, begin_s: float, end_s: float, has_farewell: bool
) -> None:
    """Every check passes, though the ids of before arrive again, and live on to the end.

    And though the node knows no map at its first tick; one that was killed says no farewell.
    """
    first = whole.late()
    first = first.then(*first.farewell(first.entries[-1][0])) if has_farewell else first
    second = whole.later(20 * NS_PER_S).late(2).part(begin_s, end_s)
    results = results_of(first.then(*second.entries).write(tmp_path / "run"))
    assert [one.sentence() for one in results.values() if one.outcome is Outcome.FAILED] == []
    assert results["lives"].outcome is Outcome.PASSED


@pytest.mark.parametrize("has_farewell", [False, True])
def test_what_a_node_that_was_started_again_says_first_may_be_missed(
    replay_sample: ReplaySample, tmp_path: Path, has_farewell: bool
) -> None:
    """The recorder hears of its topics a moment late, of what is latched the last.

    It begins with as many artefacts as had come before, so that their number tells nothing.
    """
    many = ("--set", "population.initial:=stationary", "--set", "population.arrival_rate:=0.0003")
    long = ("--set", "population.mean_life:=400", "--seed", 1)
    tape = Tape.of(replay_sample("--with-inputs", *many, *long)).without_images()
    first = tape.late().part(0.0, 3.0)
    first = first.then(*first.farewell(first.entries[-1][0])) if has_farewell else first
    second = tape.later(20 * NS_PER_S).late(2).part(0.45)
    topic, arrivals = OUT + "metrics", list[list[int]]()
    for one in (first, second):
        told = [decoded(one.types[topic], data) for _, at, data in one.entries if at == topic]
        arrivals.append([message.arrivals for message in told])
    assert 0 < max(arrivals[0]) <= min(arrivals[1])
    results = results_of(first.then(*second.entries).write(tmp_path / "run"))
    assert [one.sentence() for one in results.values() if one.outcome is Outcome.FAILED] == []


def test_an_id_that_comes_again_after_its_end_is_caught(whole: Tape, tmp_path: Path) -> None:
    """Also where the recorder paused in between: the end was told."""
    tape = whole.late()
    topic = OUT + "events"
    ends = [decoded(tape.types[topic], data) for _, at, data in tape.entries if at == topic]
    gone = next(event.id for event in ends if event.kind == 1)

    def change(message: Any) -> None:
        message.artefacts[0].id = gone

    broken = tape.edited("artefacts", change, 6.0, 6.3)
    assert results_of(broken.write(tmp_path))["lives"].outcome is Outcome.FAILED


def test_the_only_camera_info_may_be_that_of_images_alone(whole: Tape, tmp_path: Path) -> None:
    """Without one of its own the node takes the default camera, whose image is larger here."""
    kind, store = "sensor_msgs/msg/CameraInfo", jazzy_typestore()
    for name, is_right in (("/lens", True), ("/camera/camera_info", False)):
        entries = []
        for log_ns, topic, data in whole.without_images().entries:
            if whole.types[topic] != kind:
                entries.append((log_ns, topic, data))
            elif topic == "/camera/camera_info":
                info = decoded(kind, data)
                info.width, info.height = 32, 24
                entries.append((log_ns, name, bytes(store.serialize_cdr(info, kind))))
        types = {name: kind} | {t: k for t, k in whole.types.items() if k != kind}
        tape = replace(whole, entries=tuple(entries), types=types)
        results = results_of(tape.write(tmp_path / name[1:]))
        wanted = Outcome.PASSED if is_right else Outcome.FAILED
        assert results["perceived"].outcome is wanted, results["perceived"].sentence()


def test_a_camera_info_given_without_a_slash_is_that_of_the_recording(
    whole: Tape, tmp_path: Path
) -> None:
    """The node's names are full ones; a recording may have others."""
    kinds = {"/cam/image": "sensor_msgs/msg/Image", "lens": "sensor_msgs/msg/CameraInfo"}
    path = replace(whole, types=whole.types | kinds).write(tmp_path) / "augmented.mcap"
    given = {"sensors.camera_infos": ["cam/image:=lens", "/b:=a/lens"]}
    with Reading(find_recording(path), with_values(Parameters(), given)) as reading:
        found = reading.record.scans.given_infos
    assert found == {"/cam/image": "lens", "/b": "/a/lens"}
