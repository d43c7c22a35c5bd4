"""Takes messages into a record, by topic and type."""

from collections.abc import Callable
from types import MappingProxyType
from typing import Any, Final

from are_ros.checks.oracle_solids import Cloud, RealMap
from are_ros.parameters.choices import OdometryUse
from are_ros.replay._check_file import PREFIX
from are_ros.replay._check_frames import ODOMETRY, PARAMETER
from are_ros.replay._check_marker_decoding import decode_markers
from are_ros.replay._check_marker_rules import change_of
from are_ros.replay._check_record import MarkerShow, Record
from are_ros.replay._check_result import Tally, at_s
from are_ros.replay._check_scene import read_scene, time_ns

MARKERS: Final = PREFIX + "markers"
ARTEFACTS: Final = PREFIX + "artefacts"
GRID_TOPICS: Final = tuple(
    PREFIX + name
    for name in (
        "augmented_map",
        "augmented_map_updates",
        "artefact_map",
        "artefact_map_updates",
        "augmented_costmap",
    )
)
INPUT_TYPES: Final = (
    "nav_msgs/msg/OccupancyGrid",
    "tf2_msgs/msg/TFMessage",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/CameraInfo",
)
_OBJECT_BYTES: Final = 16_000_000
_SAMPLE: Final = 16
"""Of more bytes of markers only each 16th message becomes objects: one per corner of a mesh."""


class Intake:
    """Fills a record; what is malformed is a fault that `tally` counts."""

    def __init__(self, record: Record, tally: Tally) -> None:
        self.record = record
        self.tally = tally
        self._marker_bytes = 0
        self._takers: dict[str, Callable[[str, int, Any], None]] = {
            "nav_msgs/msg/OccupancyGrid": self._take_map,
            "tf2_msgs/msg/TFMessage": self._take_transforms,
            "nav_msgs/msg/Odometry": self._take_odometry,
            "sensor_msgs/msg/LaserScan": record.scans.add,
            "sensor_msgs/msg/CameraInfo": self._take_camera,
            "sensor_msgs/msg/PointCloud2": self._take_cloud,
        }
        self._lists = MappingProxyType(
            {
                PREFIX + "events": record.events,
                PREFIX + "perceived": record.perceived,
                PREFIX + "metrics": record.metrics,
            }
        )

    def take(self, topic: str, type_name: str, log_ns: int, message: Any) -> None:
        """Keep what a message says; a malformed one is a fault of its own."""
        try:
            if topic in self._lists:
                self._lists[topic].append((log_ns, message))
            elif topic == ARTEFACTS:
                self.record.scenes.append(read_scene(message, log_ns))
            elif type_name in self._takers and topic not in GRID_TOPICS:
                self._takers[type_name](topic, log_ns, message)
        except (ValueError, OverflowError) as cause:
            self.tally.fail(f"{topic} {at_s(log_ns)}: {cause}")

    def take_markers(self, log_ns: int, data: bytes) -> bool:
        """Keep what markers do; return whether they are to be deserialised, too.

        ValueError for malformed bytes.
        """
        changes = tuple(change_of(marker) for marker in decode_markers(data))
        self.record.shows.append(MarkerShow(log_ns, changes))
        self._marker_bytes += len(data)
        if self._marker_bytes <= _OBJECT_BYTES:
            return True
        self.tally.note("most markers by a decoder of our own, each 16th by rosbags too")
        return len(self.record.shows) % _SAMPLE == 0

    def _take_map(self, topic: str, log_ns: int, message: Any) -> None:
        real = RealMap.of_message(message, log_ns)
        self.record.maps_by_topic.setdefault(topic, []).append(real)

    def _take_cloud(self, topic: str, log_ns: int, message: Any) -> None:
        if topic.startswith(PREFIX):
            return
        cloud, known = Cloud.of_message(message, log_ns), self.record.clouds
        if not known or not cloud.is_like(known[-1]):
            known.append(cloud)

    def _take_transforms(self, topic: str, log_ns: int, message: Any) -> None:
        self.record.frames.add_message(message, log_ns, is_static="static" in topic)

    def _take_odometry(self, topic: str, log_ns: int, message: Any) -> None:
        del topic
        settings = self.record.settings.frames
        if settings.odometry is OdometryUse.IGNORE:
            return
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        self.record.frames.add(
            message.header.frame_id,
            message.child_frame_id or self.record.base_frame(),
            time_ns(message.header.stamp),
            log_ns,
            (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w),
            PARAMETER if settings.odometry is OdometryUse.USE else ODOMETRY,
            is_static=False,
        )

    def _take_camera(self, topic: str, log_ns: int, message: Any) -> None:
        del topic
        self.record.camera_sizes.append((log_ns, *_image_size(message)))


def _image_size(info: Any) -> tuple[int, int]:
    """Return width and height of the image that a CameraInfo speaks of."""
    roi = info.roi
    width, height = (
        (roi.width, roi.height) if roi.width and roi.height else (info.width, info.height)
    )
    return width // max(info.binning_x, 1), height // max(info.binning_y, 1)
