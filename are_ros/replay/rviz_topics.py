"""Which topics of a recording the picture shows, and at which moment."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from struct import error as StructError  # noqa: N812
from typing import Final

from are_ros.bag.marker_decoding import CdrCursor
from are_ros.bag.recording import PREFIX
from are_ros.conventions import NS_PER_S
from are_ros.errors import AreError, BagError
from are_ros.replay.bag_reader import BagReader, BagTopic
from are_ros.replay.roles import find_roles
from are_ros.replay.rviz_markers import MarkerDisplay

_GRID: Final = "nav_msgs/msg/OccupancyGrid"
_MARKERS: Final = "visualization_msgs/msg/MarkerArray"
_SCAN: Final = "sensor_msgs/msg/LaserScan"
_TRANSFORMS: Final = ("/tf", "/tf_static")
NEAR_M: Final = 7.0
"""Whom the view from behind the robot shows, for certain, is at most so far from the camera."""
_SETTLE_NS: Final = NS_PER_S // 20
"""So long after a list of the perceived the picture is taken: live, markers come a little later."""


@dataclass(frozen=True)
class ShownTopics:
    """The topics of the displays; None or empty where the recording has none.

    `scans` come first as ARE gives them out, then as they came in.
    """

    grid: str | None
    costmap: str | None
    markers: tuple[str, ...]
    scans: tuple[str, ...]
    odometry: str | None = None
    has_tf: bool = False
    cloud: str | None = None

    @classmethod
    def of(cls, topics: Sequence[BagTopic]) -> "ShownTopics":
        """Choose: what ARE gives out, or else what there is."""
        grids = [t.name for t in topics if t.type_name == _GRID]
        arrays = [t.name for t in topics if t.type_name == _MARKERS]
        scans = [t.name for t in topics if t.type_name == _SCAN]
        ours = [name for name in arrays if name.startswith(PREFIX)]
        wanted = (PREFIX + "augmented_map", "/map", *grids)
        roles = find_roles(topics, {})
        return cls(
            next((name for name in wanted if name in grids), None),
            next((name for name in (PREFIX + "augmented_costmap",) if name in grids), None),
            tuple(ours or arrays),
            tuple(sorted(scans, key=lambda name: (not name.startswith(PREFIX), name))),
            roles.topic("odom"),
            any(topic.name in _TRANSFORMS for topic in topics),
            roles.topic("octomap_point_cloud_centers"),
        )

    @property
    def tell_poses(self) -> bool:
        """Whether anything may tell where the robot is."""
        return self.has_tf or self.odometry is not None

    def all(self) -> set[str]:
        """Return all of them, with the updates of the grid, odometry and the transforms."""
        grids = {name for name in (self.grid, self.costmap) if name}
        updates = {f"{name}_updates" for name in grids}
        others = {name for name in (self.odometry, self.cloud) if name}
        return {*grids, *updates, *self.markers, *self.scans, *others, *_TRANSFORMS}


def moment_ns(reader: BagReader, topics: ShownTopics, at_s: float | None) -> int:
    """Return the time of the picture: `at_s` after the beginning, else the most telling one.

    That is when most artefacts are perceived within `NEAR_M` of the camera, where the views look;
    of several such, when most are perceived, and then when most are alive. Where nothing tells who
    is perceived, it is when most markers are shown. BagError for a time beyond the recording.
    """
    if at_s is None:
        return _fullest_ns(reader, topics)
    now_ns = reader.start_ns + round(at_s * NS_PER_S)
    if now_ns >= reader.end_ns:
        length_s = (reader.end_ns - 1 - reader.start_ns) / NS_PER_S
        raise BagError(f"--at {at_s:g} s is beyond the recording, which is {length_s:.3f} s long")
    return now_ns


def _fullest_ns(reader: BagReader, topics: ShownTopics) -> int:
    perceived = _perceived(reader)
    # While a looping recording was played, the log times stood still: then all is past.
    moving = [entry for entry in perceived if entry[0] < reader.end_ns - 1]
    if perceived := moving or perceived:
        alive = dict(_lengths(reader, PREFIX + "artefacts", texts=0))
        best = max(perceived, key=lambda entry: (*entry[1:], alive.get(entry[0], 0)))
        return min(best[0] + _SETTLE_NS, reader.end_ns - 1)
    display, best_count, best_ns = MarkerDisplay(), 0, reader.end_ns - 1
    for message in reader.messages(set(topics.markers)) if topics.markers else ():
        display.take(message.log_time_ns, bytes(message.data))
        count = len(display.shown(message.log_time_ns))
        if count > best_count:
            best_count, best_ns = count, message.log_time_ns
    return best_ns


def _perceived(reader: BagReader) -> list[tuple[int, int, int]]:
    """Return log time of each list of the perceived, how many are near in it, and how many in all.

    A list that cannot be understood is the checks' business.
    """
    found = []
    for message in reader.messages({PREFIX + "perceived"}):
        with suppress(AreError):
            ranges_m = [one.range for one in reader.deserialize(message).artefacts]
            near = sum(range_m <= NEAR_M for range_m in ranges_m)
            found.append((message.log_time_ns, near, len(ranges_m)))
    return found


def _lengths(reader: BagReader, topic: str, texts: int) -> list[tuple[int, int]]:
    """Return log time and length of each list after a header and so many texts."""
    lengths = ((m.log_time_ns, _length(bytes(m.data), texts)) for m in reader.messages({topic}))
    return [(log_ns, length) for log_ns, length in lengths if length is not None]


def _length(data: bytes, texts: int) -> int | None:
    """Return the length of a list; None for malformed bytes, which are the checks' business."""
    try:
        cursor = CdrCursor(data)
        cursor.time_ns()
        for _ in range(1 + texts):
            cursor.text()
        return cursor.count()
    except (ValueError, StructError):
        return None
