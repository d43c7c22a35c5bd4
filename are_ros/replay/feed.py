"""The inputs of a recording, message by message, into the builder."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from are_ros.builder.ar_builder import ArBuilder
from are_ros.errors import AreError, FrameError, InputError
from are_ros.messages.camera_info import read_camera_info
from are_ros.messages.cloud import read_points
from are_ros.messages.grid import read_grid
from are_ros.messages.headers import read_header
from are_ros.messages.scan import read_scan
from are_ros.replay.bag_reader import BagMessage, BagReader
from are_ros.world.observer import Camera
from are_ros.world.rigid_transform import RigidTransform

_STAMP_END = 12
"""In CDR and in ROS 1 alike the stamp of a header ends here; what follows is the content."""

Handler = Callable[[BagMessage, int], None]


@dataclass
class Refusals:
    """How many messages of each topic were refused, and what was said of the first."""

    counts: dict[str, int] = field(default_factory=dict)
    sentences: dict[str, str] = field(default_factory=dict)

    def add(self, topic: str, role: str, cause: AreError) -> None:
        """Count one more refused message of a topic that plays a role."""
        self.counts[topic] = self.counts.get(topic, 0) + 1
        self.sentences.setdefault(topic, _about(topic, role, cause))


class Feed:
    """Reads what each topic's messages say into the builder, as received at a given time.

    A malformed message is counted and changes nothing; the next good one is taken.
    """

    def __init__(self, reader: BagReader, builder: ArBuilder, roles: Mapping[str, str]) -> None:
        """Take the reader, the builder and the role of each topic that is to be read."""
        self.refusals = Refusals()
        self._reader = reader
        self._builder = builder
        self._roles = dict(roles)
        self._last_camera: tuple[bytes, Camera] | None = None
        makers: Mapping[str, Callable[[], Handler]] = {
            "map": lambda: self._map,
            "octomap_point_cloud_centers": lambda: self._cloud,
            "odom": lambda: self._odometry,
            "scan": lambda: self._scan,
            "camera/camera_info": lambda: self._camera,
            "tf": lambda: self._transforms,
            "tf_static": lambda: self._static_transforms,
        }
        self._handlers = {topic: makers[role]() for topic, role in roles.items()}

    def take(self, message: BagMessage, received_ns: int) -> None:
        """Give one message to the builder; an InputError or a FrameError is counted."""
        try:
            self._handlers[message.topic](message, received_ns)
        except (InputError, FrameError) as cause:
            self.refusals.add(message.topic, self._roles[message.topic], cause)

    def _map(self, message: BagMessage, received_ns: int) -> None:
        grid = read_grid(self._object(message), message.topic)
        self._builder.receive_map(grid, received_ns)

    def _cloud(self, message: BagMessage, received_ns: int) -> None:
        cloud = self._object(message)
        points_m = read_points(cloud, message.topic)
        header = read_header(cloud, message.topic)
        self._builder.receive_cloud(
            points_m, header.frame_id, received_ns, stamp_ns=header.stamp_ns
        )

    def _odometry(self, message: BagMessage, received_ns: int) -> None:
        numbers = self._reader.odometry(message)
        self._builder.receive_odometry(
            numbers.frame_id,
            numbers.child_frame_id,
            numbers.stamp_ns,
            numbers.pose[:3],
            numbers.pose[3:],
            received_ns,
        )

    def _scan(self, message: BagMessage, received_ns: int) -> None:
        scan = read_scan(self._object(message), message.topic)
        self._builder.receive_scan(message.topic, scan, received_ns)

    def _camera(self, message: BagMessage, received_ns: int) -> None:
        """Take a camera; one that says the same as the last, but for its stamp, is not read."""
        content = message.data[_STAMP_END:]
        if self._last_camera is None or self._last_camera[0] != content:
            raw = self._object(message)
            rectified = self._builder.parameters.camera.rectified
            view = read_camera_info(raw, message.topic).view(rectified=rectified)
            frame_id = read_header(raw, message.topic).frame_id
            self._last_camera = content, Camera(view, frame_id, RigidTransform.identity())
        self._builder.receive_camera(self._last_camera[1], received_ns)

    def _transforms(self, message: BagMessage, received_ns: int) -> None:
        self._take_transforms(message, received_ns, is_static=False)

    def _static_transforms(self, message: BagMessage, received_ns: int) -> None:
        self._take_transforms(message, received_ns, is_static=True)

    def _take_transforms(self, message: BagMessage, received_ns: int, *, is_static: bool) -> None:
        """Take the good transforms of a message; the first bad one is raised at the end."""
        refused: FrameError | None = None
        for transform in self._reader.transforms(message):
            try:
                self._builder.receive_transform(*transform, received_ns, is_static=is_static)
            except FrameError as cause:  # noqa: PERF203 - each stands on its own
                refused = refused or cause
        if refused is not None:
            raise refused

    def _object(self, message: BagMessage) -> Any:
        return self._reader.deserialize(message)


def _about(topic: str, role: str, cause: AreError) -> str:
    """Return the cause with its topic in front, whether it named topic, role or neither."""
    text = str(cause).removeprefix(f"{topic}: ").removeprefix(f"{role}: ")
    return f"{topic}: {text}"
