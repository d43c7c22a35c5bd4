"""Gives inputs, message by message, to the builder; for live topics and recordings alike."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from struct import Struct
from typing import Any, Final, Protocol

from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.sensors.lens import Lens
from are_ros.conventions import NS_PER_S
from are_ros.errors import AreError, FrameError, InputError
from are_ros.messages.common import read_header
from are_ros.messages.goals import read_path
from are_ros.messages.images.image import is_rectified, read_camera_info
from are_ros.messages.maps import read_grid, read_voxels
from are_ros.messages.sensors import CAMERA_INFO, SENSORS, SensorKind, lens_topics
from are_ros.messages.transforms import OdometryNumbers, StampedTransform
from are_ros.world.cameras import Camera
from are_ros.world.rigid_transform import RigidTransform

_STAMP_AT, _STAMP_END = 4, 12
"""In CDR and in ROS 1 alike the stamp of a header is here; what follows is the content."""
_STAMP = Struct("<iI")

OTHER_CAMERA: Final = "other_camera_info"
"""The role of the topics of `camera.others`, in their order."""


class RawMessage(Protocol):
    """A received message: its topic, and its bytes in the adapter's encoding."""

    @property
    def topic(self) -> str:
        """The topic it came on."""

    @property
    def data(self) -> bytes:
        """The bytes, with a header's stamp at offset 4."""


class Decoding(Protocol):
    """The decoder of an adapter; InputError, naming the topic, for malformed bytes."""

    def deserialize(self, message: Any) -> Any:
        """Return the message object."""

    def transforms(self, message: Any) -> list[StampedTransform]:
        """Return the transforms of a TFMessage."""

    def odometry(self, message: Any) -> OdometryNumbers:
        """Return the numbers of an Odometry."""


Handler = Callable[[RawMessage, int], None]


@dataclass
class Refusals:
    """The number of refused messages of each topic, and the first reason."""

    counts: dict[str, int] = field(default_factory=dict)
    sentences: dict[str, str] = field(default_factory=dict)

    def add(self, topic: str, role: str, cause: AreError) -> str:
        """Count one more refused message of a topic that plays a role; return the sentence."""
        self.counts[topic] = self.counts.get(topic, 0) + 1
        text = str(cause).removeprefix(f"{topic}: ").removeprefix(f"{role}: ")
        sentence = f"{topic}: {text}"
        self.sentences.setdefault(topic, sentence)
        return sentence

    def told(self, topic: str) -> str:
        """Return the first reason of a topic, and of how many it is the first; "" without any."""
        count = self.counts.get(topic, 0)
        several = f" (the first of {count} refused)" if count > 1 else ""
        return f"{self.sentences[topic]}{several}" if count else ""


class Feed:
    """Decodes messages by the role of their topic, and gives them to the builder.

    A malformed message is counted and changes nothing; the next good one is taken. Maps, clouds
    and cameras that equal the last one, except for the stamp, are not decoded again.
    """

    def __init__(self, decoding: Decoding, builder: ArBuilder, roles: Mapping[str, str]) -> None:
        """Take the decoder, the builder, and the role of each topic that is read."""
        self.refusals = Refusals()
        self._decoding = decoding
        self._builder = builder
        self._roles = dict(roles)
        self._last: dict[tuple[str, str], tuple[bytes, Any]] = {}
        self._images: dict[str, list[str]] = {}
        """The topics of the images that a CameraInfo belongs to, by its topic."""
        for topic, lens_topic in lens_topics(roles, builder.parameters.sensors).items():
            self._images.setdefault(lens_topic, []).append(topic)
            builder.await_lens(topic, lens_topic, is_depth=roles[topic] == "depth")
        handlers: Mapping[str, Handler] = {
            "map": self._map,
            "octomap_point_cloud_centers": self._cloud,
            "odom": self._odometry,
            "camera/camera_info": partial(self._camera, 0),
            CAMERA_INFO: self._lens,
            "tf": partial(self._transforms, is_static=False),
            "tf_static": partial(self._transforms, is_static=True),
            "plan": self._plan,
            **{role: partial(self._reading, kind) for role, kind in SENSORS.items()},
        }
        others = count(1)
        self._handlers = {
            topic: partial(self._camera, next(others)) if role == OTHER_CAMERA else handlers[role]
            for topic, role in roles.items()
        }

    def take(self, message: RawMessage, received_ns: int) -> str:
        """Give one message to the builder; an InputError or a FrameError is counted.

        Returns why it was refused, empty if it was not.
        """
        try:
            self._handlers[message.topic](message, received_ns)
        except (InputError, FrameError) as cause:
            return self.refusals.add(message.topic, self._roles[message.topic], cause)
        return ""

    def _map(self, message: RawMessage, received_ns: int) -> None:
        grid = self._decoded(message, read_grid)
        self._builder.receive_map(grid, received_ns)

    def _cloud(self, message: RawMessage, received_ns: int) -> None:
        def decode(raw: Any, source: str) -> Any:
            return *read_voxels(raw, source), read_header(raw, source).frame_id

        points_m, size_m, frame_id = self._decoded(message, decode)
        seconds, nanoseconds = _STAMP.unpack_from(message.data, _STAMP_AT)
        stamp_ns = seconds * NS_PER_S + nanoseconds
        self._builder.receive_cloud(points_m, frame_id, received_ns, size_m, stamp_ns)

    def _odometry(self, message: RawMessage, received_ns: int) -> None:
        numbers = self._decoding.odometry(message)
        self._builder.receive_odometry(
            numbers.frame_id,
            numbers.child_frame_id,
            numbers.stamp_ns,
            numbers.pose[:3],
            numbers.pose[3:],
            received_ns,
        )

    def _reading(self, kind: SensorKind, message: RawMessage, received_ns: int) -> None:
        reading = kind.read(self._decoding.deserialize(message), message.topic)
        self._builder.receive_reading(message.topic, reading, received_ns)

    def _plan(self, message: RawMessage, received_ns: int) -> None:
        path = read_path(self._decoding.deserialize(message), message.topic)
        self._builder.receive_plan(path.points_m, path.frame_id, received_ns)

    def _camera(self, number: int, message: RawMessage, received_ns: int) -> None:
        def decode(raw: Any, source: str) -> Camera:
            rectified = self._builder.parameters.camera.rectified
            view = read_camera_info(raw, source).view(rectified=rectified)
            frame_id = read_header(raw, source).frame_id
            return Camera(view, frame_id, RigidTransform.identity())

        try:
            self._builder.receive_camera(self._decoded(message, decode), received_ns, number)
        finally:
            self._lens(message, received_ns)

    def _lens(self, message: RawMessage, received_ns: int) -> None:
        """Give the images beside a CameraInfo their lens."""

        def decode(raw: Any, source: str) -> dict[str, Lens]:
            info, frame_id = read_camera_info(raw, source), read_header(raw, source).frame_id
            images = self._images[source]
            views = {flag: info.view(rectified=flag) for flag in {*map(is_rectified, images)}}
            lenses = {flag: Lens(frame_id, info, view) for flag, view in views.items()}
            return {image: lenses[is_rectified(image)] for image in images}

        if message.topic in self._images:
            for image, lens in self._decoded(message, decode, CAMERA_INFO).items():
                self._builder.receive_lens(image, lens, received_ns)

    def _decoded(
        self, message: RawMessage, decode: Callable[[Any, str], Any], purpose: str = ""
    ) -> Any:
        """Return the decoded content; a content that is repeated is not decoded again."""
        content, key = message.data[_STAMP_END:], (message.topic, purpose)
        known = self._last.get(key)
        if known is None or known[0] != content:
            known = content, decode(self._decoding.deserialize(message), message.topic)
            self._last[key] = known
        return known[1]

    def _transforms(self, message: RawMessage, received_ns: int, *, is_static: bool) -> None:
        """Take the good transforms of a message; the first bad one is raised at the end."""
        refused: FrameError | None = None
        for transform in self._decoding.transforms(message):
            try:
                self._builder.receive_transform(*transform, received_ns, is_static=is_static)
            except FrameError as cause:  # noqa: PERF203 - each stands on its own
                refused = refused or cause
        if refused is not None:
            raise refused
