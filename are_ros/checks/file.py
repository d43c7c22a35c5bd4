"""The file itself: it opens in the mcap reader, with the topics, types and QoS of section 4."""

from dataclasses import replace
from io import SEEK_END
from pathlib import Path
from struct import Struct
from types import MappingProxyType
from typing import Any, Final
from zlib import crc32

import yaml
from mcap.reader import NonSeekingReader, make_reader

from are_ros.bag.reader import sentence_of
from are_ros.bag.recording import PREFIX, home_of, without_home
from are_ros.bag.writer import NOTES
from are_ros.checks.result import CheckResult, Tally, at_s, merged, skipped
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError
from are_ros.messages.sensors import OUTPUT_TYPES
from are_ros.messages.tick_encoding import ALL_OUTPUTS, OCTOMAP, OUTPUTS, PARTS, SKIPPED
from are_ros.wording import counted

_FOOTER: Final = Struct("<QQI")
_MAGIC: Final = b"\x89MCAP0\r\n"
_LATCHED_TYPE: Final = "nav_msgs/msg/OccupancyGrid"
_JUMP_NS: Final = NS_PER_S
_NAMES: Final = ("mcap reader", "log times", "topics and types", "quality of service")
_QOS_NAMES: Final = MappingProxyType(
    {
        "reliability": {1: "reliable", 2: "best_effort"},
        "durability": {1: "transient_local", 2: "volatile"},
    }
)
"""rosbag2 wrote numbers before Jazzy."""

_Channels = dict[int, tuple[Any, Any]]


def _check_file(path: Path, *, is_live: bool) -> list[CheckResult]:
    """Read every message with the mcap reader, checksums included, and look at each channel.

    Never raises on a damaged file: that is a result. A live recording may lack topics and hold
    others of the node, its log times may jump back with the clock, and DDS tells no depths.
    """
    if path.suffix != ".mcap":
        return [skipped(name, "only MCAP files are looked at so closely") for name in _NAMES]
    reading = Tally(_NAMES[0], "message")
    order = Tally(_NAMES[1], "message")
    channels: _Channels = {}
    left_out = frozenset[str]()
    try:
        with path.open("rb") as stream:
            left_out = _left_out(stream)
            stream.seek(0)
            _read_all(stream, channels, reading, order, _JUMP_NS if is_live else None)
    except Exception as cause:  # noqa: BLE001 - the reader raises all kinds on bad bytes
        reading.look()
        reading.fail(sentence_of(cause))
    channels = _without_home(channels)
    return [
        reading.result(),
        order.result(),
        _check_topics(channels, left_out, is_live=is_live),
        _check_qos(channels, is_live=is_live),
    ]


def check_files(paths: tuple[Path, ...], *, is_live: bool) -> list[CheckResult]:
    """Check the files of a recording; each check is one outcome."""
    by_file = [_check_file(path, is_live=is_live) for path in paths]
    return [merged(results) for results in zip(*by_file, strict=True)]


def _left_out(stream: Any) -> frozenset[str]:
    """Return the outputs of the parts that a replay notes as skipped."""
    notes = [one.metadata for one in make_reader(stream).iter_metadata() if one.name == NOTES]
    parts = " ".join(note.get(SKIPPED, "") for note in notes).split()
    return frozenset(name for part in parts for name in PARTS.get(part, ()))


def _read_all(
    stream: Any, channels: _Channels, reading: Tally, order: Tally, jump_ns: int | None
) -> None:
    reader = make_reader(stream, validate_crcs=True)
    reading.require(reader.get_header().profile == "ros2", "its profile is not ros2")
    reading.require(_is_summary_whole(stream), "its summary section is damaged")
    summary = reader.get_summary()
    if summary is None or summary.statistics is None:
        reading.look()
        reading.fail("it has no summary section")
        return
    channels |= {
        number: (channel, summary.schemas.get(channel.schema_id))
        for number, channel in summary.channels.items()
    }
    latest: dict[str, int] = {}
    stream.seek(0)  # a reader that seeks would keep all messages, to have them in this order
    in_order = NonSeekingReader(stream, validate_crcs=True)
    for _, channel, message in in_order.iter_messages(log_time_order=False):
        reading.look()
        order.look()
        back_ns = latest.get(channel.topic, 0) - message.log_time
        if jump_ns is not None and back_ns > jump_ns:
            order.note("the clock went back")
        elif back_ns > 0:
            order.fail(f"{channel.topic} goes back in time {at_s(message.log_time)}")
        latest[channel.topic] = message.log_time
    promised = summary.statistics.message_count
    if reading.looked_at != promised:
        reading.fail(
            f"it holds {counted(reading.looked_at, 'message')}, its statistics say {promised}"
        )


def _is_summary_whole(stream: Any) -> bool:
    """Compare the summary with the checksum in the footer: no reader does."""
    end = stream.seek(-_FOOTER.size - len(_MAGIC), SEEK_END)
    start, _, promised = _FOOTER.unpack(stream.read(_FOOTER.size))
    stream.seek(start)
    # The sum covers the footer's own head, up to where it stands itself.
    return not promised or crc32(stream.read(end + _FOOTER.size - 4 - start)) == promised


def _without_home(channels: _Channels) -> _Channels:
    """Return channels with the names of topics that they would have without a namespace."""
    try:
        home = home_of((channel.topic for channel, _ in channels.values()), "it")
    except BagError:  # several nodes, which the opening of the recording says
        return channels
    return {
        number: (replace(channel, topic=without_home(channel.topic, home)), schema)
        for number, (channel, schema) in channels.items()
    }


def _check_topics(channels: _Channels, left_out: frozenset[str], *, is_live: bool) -> CheckResult:
    """Compare topics and types with section 4, and the encodings with what ROS 2 reads."""
    tally = Tally(_NAMES[2], "topic")
    found: dict[str, str] = {}
    for channel, schema in channels.values():
        tally.look()
        name = schema.name if schema is not None else "no type"
        found[channel.topic] = name
        tally.require(
            channel.message_encoding == "cdr" and schema is not None and bool(schema.data),
            f"{channel.topic} is not CDR with a message definition",
        )
        if channel.topic.startswith(PREFIX) and not _is_expected(channel.topic, name, is_live):
            tally.fail(f"{channel.topic} of type {name} is no output of that type")
    for output, (type_name, *_) in OUTPUTS.items():
        if PREFIX + output in found or not found:
            continue
        if is_live or output in left_out:
            tally.leave_out("output", "missing from the recording")
        else:
            tally.fail(f"{PREFIX}{output} of type {type_name} is missing")
    return tally.result()


def _is_expected(topic: str, type_name: str, is_live: bool) -> bool:
    """Tell whether this is an output; a live node has other topics, too."""
    expected = ALL_OUTPUTS.get(topic.removeprefix(PREFIX))
    if expected is None:
        return is_live or type_name in OUTPUT_TYPES
    return type_name == expected.type_name


def _check_qos(channels: _Channels, *, is_live: bool) -> CheckResult:
    """Whole maps are offered reliable, transient local, depth 1; the rest is volatile."""
    tally = Tally(_NAMES[3], "topic")
    for channel, schema in channels.values():
        name = channel.topic.removeprefix(PREFIX)
        if name == channel.topic or (is_live and name not in ALL_OUTPUTS):
            continue
        tally.look()
        type_name = "" if schema is None else schema.name
        is_map = type_name == _LATCHED_TYPE or name == OCTOMAP
        wanted = ("reliable", "transient_local" if is_map else "volatile")
        profiles = _offered(channel.metadata)
        if not is_live and len(profiles) != 1:
            tally.fail(f"{channel.topic} is offered as nothing legible, not {', '.join(wanted)}")
        for *policies, depth in profiles:
            is_deep = is_map and depth != 1 and not (is_live and not depth)
            if tuple(policies) != wanted or is_deep:
                offered = f"{', '.join(policies)}, depth {depth}"
                tally.fail(f"{channel.topic} is offered as {offered}, not {', '.join(wanted)}")
        if is_live and not profiles:
            tally.leave_out("topic", "whose offered quality of service is not known")
    return tally.result()


def _offered(metadata: dict[str, str]) -> list[tuple[str, str, int]]:
    """Return reliability, durability and depth of the profiles that a channel offers."""
    try:
        profiles = yaml.safe_load(metadata.get("offered_qos_profiles", "")) or []
        return [
            (_policy(each, "reliability"), _policy(each, "durability"), int(each["depth"]))
            for each in profiles
        ]
    except (yaml.YAMLError, TypeError, ValueError, KeyError):
        return []


def _policy(profile: Any, name: str) -> str:
    value = profile[name]
    return str(_QOS_NAMES[name].get(value, value)).lower()
