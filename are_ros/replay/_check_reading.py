"""Reads a recording with rosbags: every message is deserialised, what matters is kept."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any, Final

from rosbags.highlevel import AnyReader

from are_ros.parameters.choices import OdometryUse
from are_ros.replay._bag_errors import sentence_of
from are_ros.replay._check_cells import RealMap
from are_ros.replay._check_file import PREFIX
from are_ros.replay._check_frames import ODOMETRY, PARAMETER
from are_ros.replay._check_marker_decoding import decode_markers
from are_ros.replay._check_marker_rules import change_of
from are_ros.replay._check_record import MarkerShow, Record
from are_ros.replay._check_result import Tally, at_s
from are_ros.replay._check_scene import read_scene, time_ns

GRID_TOPICS: Final = tuple(
    PREFIX + name for name in ("augmented_map", "augmented_map_updates", "augmented_costmap")
)
_MARKERS: Final = PREFIX + "markers"
_OBJECT_BYTES: Final = 16_000_000
_SAMPLE: Final = 16
"""Of more bytes of markers only each 16th message becomes objects: one per corner of a mesh."""


class Reading:
    """One pass over all but the grids, a second over these, both counted in `tally`.

    A context manager, open inside `with`.
    """

    def __init__(self, path: Path, record: Record, progress: Callable[[], None]) -> None:
        self.tally = Tally("rosbags reader", "messages")
        self.record = record
        self._path = path
        self._progress = progress
        self._marker_bytes = 0
        self._reader: AnyReader | None = None
        self._takers: dict[str, Callable[[str, int, Any], None]] = {
            "nav_msgs/msg/OccupancyGrid": self._take_map,
            "tf2_msgs/msg/TFMessage": self._take_transforms,
            "nav_msgs/msg/Odometry": self._take_odometry,
            "sensor_msgs/msg/LaserScan": self.record.scans.add,
            "sensor_msgs/msg/CameraInfo": self._take_camera,
        }
        self._outputs = MappingProxyType(
            {
                PREFIX + "events": record.events,
                PREFIX + "perceived": record.perceived,
                PREFIX + "metrics": record.metrics,
            }
        )

    def __enter__(self) -> "Reading":  # noqa: PYI034 (Self came with Python 3.11)
        """Open the recording; one that cannot be opened is a fault, and holds no messages."""
        with self._faults():
            reader = AnyReader([self._path])
            reader.open()
            self._reader = reader
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._reader is not None:
            self._reader.close()

    def read_all_but_grids(self) -> None:
        """Fill the record."""
        for topic, type_name, log_ns, message in self._messages(wants_grids=False):
            if topic in self._outputs:
                self._outputs[topic].append((log_ns, message))
            else:
                self._take(topic, type_name, log_ns, message)

    def grids(self) -> Iterator[tuple[str, int, Any]]:
        """Yield topic, log time and message of the grids that went out."""
        for topic, _, log_ns, message in self._messages(wants_grids=True):
            yield topic, log_ns, message

    def _messages(self, *, wants_grids: bool) -> Iterator[tuple[str, str, int, Any]]:
        """Yield what can be deserialised; a fault of the file ends it."""
        reader = self._reader
        if reader is None:
            return
        chosen = [c for c in reader.connections if (c.topic in GRID_TOPICS) == wants_grids]
        self.record.topics |= {connection.topic for connection in chosen}
        if not chosen:  # rosbags would take none as all
            return
        with self._faults():
            for connection, log_ns, data in reader.messages(connections=chosen):
                message = self._deserialized(reader, connection, log_ns, data)
                self._progress()
                if message is not None:
                    yield connection.topic, connection.msgtype, log_ns, message

    @contextmanager
    def _faults(self) -> Iterator[None]:
        """Count what the reader raises as a fault of the file."""
        try:
            yield
        except Exception as cause:  # noqa: BLE001 - the reader raises all kinds on bad bytes
            self.tally.look()
            self.tally.fail(sentence_of(cause))

    def _deserialized(self, reader: AnyReader, connection: Any, log_ns: int, data: bytes) -> Any:
        self.tally.look()
        try:
            if connection.topic == _MARKERS:
                self._take_markers(log_ns, data)
                if self._marker_bytes > _OBJECT_BYTES and len(self.record.shows) % _SAMPLE:
                    return None
            return reader.deserialize(data, connection.msgtype)
        except Exception as cause:  # noqa: BLE001 - so do its codecs
            self.tally.fail(f"{connection.topic} {at_s(log_ns)}: {sentence_of(cause)}")
            return None

    def _take(self, topic: str, type_name: str, log_ns: int, message: Any) -> None:
        """Keep what a message says, by its type; a malformed one is a fault of its own."""
        try:
            if topic == PREFIX + "artefacts":
                self.record.scenes.append(read_scene(message, log_ns))
            elif type_name in self._takers:
                self._takers[type_name](topic, log_ns, message)
        except (ValueError, OverflowError) as cause:
            self.tally.fail(f"{topic} {at_s(log_ns)}: {cause}")

    def _take_markers(self, log_ns: int, data: bytes) -> None:
        frame_id = self.record.world_frame
        changes = tuple(change_of(each, frame_id) for each in decode_markers(bytes(data)))
        self.record.shows.append(MarkerShow(log_ns, changes))
        self._marker_bytes += len(data)
        if self._marker_bytes > _OBJECT_BYTES:
            self.tally.note("most markers by a decoder of our own, each 16th by rosbags too")

    def _take_map(self, topic: str, log_ns: int, message: Any) -> None:
        del topic
        real = RealMap.of_message(message, log_ns)
        if real.is_usable(self.record.world_frame):
            self.record.maps.append(real)

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
