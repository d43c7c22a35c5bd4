"""The file itself: it opens in the mcap reader, with the topics, types and QoS of section 4."""

from io import SEEK_END
from pathlib import Path
from struct import Struct
from types import MappingProxyType
from typing import Any, Final
from zlib import crc32

import yaml
from mcap.reader import make_reader

from are_ros.replay._bag_errors import sentence_of
from are_ros.replay._check_result import CheckResult, Tally, at_s

PREFIX: Final = "/ar_builder/"

OUTPUT_TYPES: Final = MappingProxyType(
    {
        "augmented_map": "nav_msgs/msg/OccupancyGrid",
        "augmented_map_updates": "map_msgs/msg/OccupancyGridUpdate",
        "augmented_costmap": "nav_msgs/msg/OccupancyGrid",
        "markers": "visualization_msgs/msg/MarkerArray",
        "perceived": "are_msgs/msg/PerceivedArtefactArray",
        "artefacts": "are_msgs/msg/ArtefactArray",
        "events": "are_msgs/msg/ArtefactEvent",
        "metrics": "are_msgs/msg/SceneMetrics",
    }
)
"""The outputs of section 4 that every replay announces, without the prefix."""

_OPTIONAL_TYPES: Final = MappingProxyType({"augmented_octomap": "sensor_msgs/msg/PointCloud2"})
_SENSOR_TYPES: Final = tuple(f"sensor_msgs/msg/{t}" for t in ("LaserScan", "PointCloud2", "Image"))
_FOOTER: Final = Struct("<QQI")
_MAGIC: Final = b"\x89MCAP0\r\n"
_LATCHED: Final = (PREFIX + "augmented_map", PREFIX + "augmented_costmap")
_QOS_NAMES: Final = MappingProxyType(
    {
        "reliability": {1: "reliable", 2: "best_effort"},
        "durability": {1: "transient_local", 2: "volatile"},
    }
)
"""rosbag2 wrote numbers before Jazzy."""


def check_file(path: Path) -> list[CheckResult]:
    """Read every message with the mcap reader, checksums included, and look at each channel.

    Never raises on a damaged file: that is a result.
    """
    reading = Tally("mcap reader", "messages")
    order = Tally("log times", "messages")
    channels: dict[int, tuple[Any, Any]] = {}
    try:
        with path.open("rb") as stream:
            _read_all(stream, channels, reading, order)
    except Exception as cause:  # noqa: BLE001 - the reader raises all kinds on bad bytes
        reading.look()
        reading.fail(sentence_of(cause))
    return [reading.result(), order.result(), _check_topics(channels), _check_qos(channels)]


def _read_all(
    stream: Any, channels: dict[int, tuple[Any, Any]], reading: Tally, order: Tally
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
    for _, channel, message in reader.iter_messages(log_time_order=False):
        reading.look()
        order.look()
        if message.log_time < latest.get(channel.topic, 0):
            order.fail(f"{channel.topic} goes back in time {at_s(message.log_time)}")
        latest[channel.topic] = message.log_time
    promised = summary.statistics.message_count
    if reading.looked_at != promised:
        reading.fail(f"it holds {reading.looked_at} messages, its statistics say {promised}")


def _is_summary_whole(stream: Any) -> bool:
    """Tell whether the checksum in the footer is that of the summary, which no reader looks at."""
    end = stream.seek(-_FOOTER.size - len(_MAGIC), SEEK_END)
    start, _, promised = _FOOTER.unpack(stream.read(_FOOTER.size))
    stream.seek(start)
    # The sum covers the footer's own head, up to where it stands itself.
    return not promised or crc32(stream.read(end + _FOOTER.size - 4 - start)) == promised


def _check_topics(channels: dict[int, tuple[Any, Any]]) -> CheckResult:
    """Compare topics and types with section 4, and the encodings with what ROS 2 reads."""
    tally = Tally("topics and types", "topics")
    found: dict[str, str] = {}
    for channel, schema in channels.values():
        tally.look()
        name = schema.name if schema is not None else "no type"
        found[channel.topic] = name
        tally.require(
            channel.message_encoding == "cdr" and schema is not None and bool(schema.data),
            f"{channel.topic} is not CDR with a message definition",
        )
        if channel.topic.startswith(PREFIX) and not _is_expected(channel.topic, name):
            tally.fail(f"{channel.topic} of type {name} is no output of that type")
    for output, type_name in OUTPUT_TYPES.items():
        if PREFIX + output not in found and found:
            tally.fail(f"{PREFIX}{output} of type {type_name} is missing")
    return tally.result()


def _is_expected(topic: str, type_name: str) -> bool:
    expected = {**OUTPUT_TYPES, **_OPTIONAL_TYPES}.get(topic.removeprefix(PREFIX))
    return type_name in _SENSOR_TYPES if expected is None else type_name == expected


def _check_qos(channels: dict[int, tuple[Any, Any]]) -> CheckResult:
    """Both maps are offered reliable, transient local, depth 1; the rest reliable, volatile."""
    tally = Tally("quality of service", "topics")
    for channel, _ in channels.values():
        if not channel.topic.startswith(PREFIX):
            continue
        tally.look()
        reliability, durability, depth = _offered(channel.metadata)
        is_map = channel.topic in _LATCHED
        wanted = ("reliable", "transient_local" if is_map else "volatile")
        if (reliability, durability) != wanted or (is_map and depth != 1):
            offered = f"{reliability}, {durability}, depth {depth}"
            tally.fail(f"{channel.topic} is offered as {offered}, not {', '.join(wanted)}")
    return tally.result()


def _offered(metadata: dict[str, str]) -> tuple[str, str, int]:
    """Return reliability, durability and depth of the one profile that a channel offers."""
    try:
        (profile,) = yaml.safe_load(metadata.get("offered_qos_profiles", ""))
        names = [
            str(codes.get(profile[key], profile[key])).lower() for key, codes in _QOS_NAMES.items()
        ]
        return names[0], names[1], int(profile["depth"])
    except (yaml.YAMLError, TypeError, ValueError, KeyError):
        return "nothing legible", "nothing legible", 0
