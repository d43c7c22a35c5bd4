"""Recordings made of others: stamps shifted, scans late, beams without a return, gaps.

Shares no code with are_ros: rosbags reads ROS 1 bags and rosbag2, and writes rosbag2 (mcap).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

NS_PER_S = 1_000_000_000
STAMP = "builtin_interfaces/msg/Time"
SCAN = "sensor_msgs/msg/LaserScan"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
KEPT = (
    TRANSFORMS,
    SCAN,
    "nav_msgs/msg/Odometry",
    "nav_msgs/msg/OccupancyGrid",
    "sensor_msgs/msg/PointCloud2",
    "sensor_msgs/msg/CameraInfo",
)
"""What is copied; /clock is not, for it would be of neither clock."""


@dataclass(frozen=True)
class Changes:
    """What is changed in a recording; the default changes nothing.

    `shift_s` is added to every stamp, transforms' too; log times stay. Scans are logged `late_s`
    later, and up to `jitter_s` more at random, in their order. `infinite` is the share of the
    beams of a scan that lose their return (become +inf), in a few sectors. `gaps` are pairs
    (seconds after the start, length in seconds): all later stamps and log times move on by the
    length. `seed` is that of the random draws.
    """

    shift_s: float = 0.0
    late_s: float = 0.0
    jitter_s: float = 0.0
    infinite: float = 0.0
    gaps: tuple[tuple[float, float], ...] = ()
    seed: int = 0


def store() -> Any:
    """Return the types of ROS 2, with the one of tf2_msgs that rosbags leaves out."""
    types = get_typestore(Stores.ROS2_JAZZY)
    if TRANSFORMS not in types.fielddefs:
        text = "geometry_msgs/TransformStamped[] transforms\n"
        types.register(get_types_from_msg(text, TRANSFORMS))
    return types


def change_recording(
    source: Path, folder: Path, changes: Changes, topics: Sequence[str] | None = None
) -> Path:
    """Write the changed recording as a rosbag2 folder and return that.

    `topics` (None: all) limits what is copied, beside the kinds of `KEPT`.
    """
    types = store()
    random = np.random.default_rng(changes.seed)
    newest: dict[str, int] = {}
    records: list[tuple[int, int, Any, bytes]] = []
    with AnyReader([source], default_typestore=types) as reader:
        wanted = [c for c in reader.connections if c.msgtype in KEPT]
        wanted = [c for c in wanted if topics is None or c.topic in topics]
        for connection, log_ns, raw in reader.messages(connections=wanted):
            message = _as_ros2(reader.deserialize(raw, connection.msgtype), types)
            gap_ns = _gap_ns(log_ns - reader.start_time, changes)
            for stamp in _stamps(message):
                _move(stamp, gap_ns + round(changes.shift_s * NS_PER_S))
            time_ns = log_ns + gap_ns
            if connection.msgtype == SCAN:
                delay_s = changes.late_s + changes.jitter_s * random.random()
                time_ns += round(delay_s * NS_PER_S)
                time_ns = newest[connection.topic] = max(
                    time_ns, newest.get(connection.topic, time_ns)
                )
                _lose_returns(message, changes.infinite, random)
            data = bytes(types.serialize_cdr(message, connection.msgtype))
            records.append((time_ns, len(records), connection, data))
    _write(folder, sorted(records, key=lambda record: record[:2]), types)
    return folder


def _write(folder: Path, records: list[tuple[int, int, Any, bytes]], types: Any) -> None:
    """Write the records in their order."""
    connections: dict[str, Any] = {}
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for time_ns, _, source, data in records:
            if source.topic not in connections:
                qos = getattr(source.ext, "offered_qos_profiles", None)
                options = {"offered_qos_profiles": qos} if qos else {}
                connections[source.topic] = writer.add_connection(
                    source.topic, source.msgtype, typestore=types, **options
                )
            writer.write(connections[source.topic], time_ns, data)


def _gap_ns(after_start_ns: int, changes: Changes) -> int:
    """Return by how much what was logged then moves on."""
    passed = [length for at, length in changes.gaps if after_start_ns >= at * NS_PER_S]
    return round(sum(passed) * NS_PER_S)


def _lose_returns(scan: Any, share: float, random: np.random.Generator) -> None:
    """Make +inf of the beams of three random sectors, in all a share of the scan."""
    width = round(len(scan.ranges) * share / 3)
    if not width:
        return
    ranges = np.array(scan.ranges)
    for begin in random.integers(0, len(ranges), 3):
        ranges[np.arange(begin, begin + width) % len(ranges)] = np.inf
    scan.ranges = ranges


def _stamps(message: Any) -> Iterator[Any]:
    """Yield the stamps of a message's headers."""
    if hasattr(message, "header"):
        yield message.header.stamp
    for transform in getattr(message, "transforms", ()):
        yield transform.header.stamp


def _move(stamp: Any, by_ns: int) -> None:
    """Add nanoseconds to a stamp, in place."""
    stamp_ns = stamp.sec * NS_PER_S + stamp.nanosec + by_ns
    stamp.sec, stamp.nanosec = divmod(stamp_ns, NS_PER_S)


def _as_ros2(message: Any, types: Any) -> Any:
    """Return a copy of a message, of ROS 1 or 2, as one of ROS 2; fields go by their names."""
    fields = {}
    for name, _ in types.fielddefs[message.__msgtype__][1]:
        value = getattr(message, name, None)
        value = getattr(message, name.upper()) if value is None else value
        if isinstance(value, list):
            value = [_as_ros2(one, types) if hasattr(one, "__msgtype__") else one for one in value]
        fields[name] = _as_ros2(value, types) if hasattr(value, "__msgtype__") else value
    return types.types[message.__msgtype__](**fields)
