"""The simulated robot's topics: which there are, and what is said on them when."""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from are_ros.messages.common import Header
from bags.simulation.building import surface_centres_m
from bags.simulation.camera import OfficeCamera, make_depth_png, make_jpeg
from bags.simulation.frames import (
    BASE_FRAME,
    BASE_FROM_OPTICAL,
    CAMERA_FRAME,
    CAMERA_INFO,
    MAP_FRAME,
    ODOM_FRAME,
    fixed_joints,
    stamped,
)
from bags.simulation.making import (
    MessageFactory,
    OdometryReading,
    make_camera_info,
    make_cloud,
    make_grid,
    make_odometry,
    make_scan,
    make_transforms,
)
from bags.simulation.robot import Driver
from bags.simulation.simulator import STEPS_PER_S, Simulator

_MS: Final = 1_000_000


class TimedMessage(NamedTuple):
    """A message, and when it reaches a subscriber."""

    topic: str
    arrival_ns: int
    message: Any


@dataclass(frozen=True)
class RobotTopic:
    """A topic as its publisher offers it."""

    name: str
    type_name: str
    is_latched: bool = False
    is_reliable: bool = True
    depth: int = 10


ROBOT_TOPICS: Final = (
    RobotTopic("/map", "nav_msgs/msg/OccupancyGrid", is_latched=True, depth=1),
    RobotTopic(
        "/octomap_point_cloud_centers", "sensor_msgs/msg/PointCloud2", is_latched=True, depth=1
    ),
    RobotTopic("/tf_static", "tf2_msgs/msg/TFMessage", is_latched=True, depth=100),
    RobotTopic("/tf", "tf2_msgs/msg/TFMessage", depth=100),
    RobotTopic("/odom", "nav_msgs/msg/Odometry"),
    RobotTopic("/scan", "sensor_msgs/msg/LaserScan", is_reliable=False),
    RobotTopic("/camera/camera_info", "sensor_msgs/msg/CameraInfo", is_reliable=False),
)


IMAGE_TOPICS: Final = (
    RobotTopic(
        "/camera/depth_raw/compressedDepth", "sensor_msgs/msg/CompressedImage", is_reliable=False
    ),
    RobotTopic(
        "/camera/image_raw/compressed", "sensor_msgs/msg/CompressedImage", is_reliable=False
    ),
)
"""Those of a robot whose camera takes pictures; /camera/camera_info is theirs, too."""


@dataclass(frozen=True)
class _Beat:
    """When something is said: every `period` steps from `phase` on, and how late it arrives."""

    period: int
    phase: int
    latency_ns: tuple[int, int]

    def is_due(self, steps: int) -> bool:
        return steps >= self.phase and (steps - self.phase) % self.period == 0


_ODOMETRY: Final = _Beat(4, 0, (1 * _MS, 3 * _MS))
_BASE_TF: Final = _Beat(4, 0, (2 * _MS, 5 * _MS))
_SCAN: Final = _Beat(12, 5, (18 * _MS, 23 * _MS))
# A localiser stamps its correction as the scan that it matched, and needs that scan first.
_CORRECTION: Final = _Beat(12, 5, (30 * _MS, 42 * _MS))
_CAMERA: Final = _Beat(12, 2, (24 * _MS, 33 * _MS))
_PICTURE: Final = _Beat(360, 122, (38 * _MS, 40 * _MS))
"""The depth image comes first. Both come at fixed times: what else is said stays as it is."""

MAX_LATENCY_NS: Final = max(
    beat.latency_ns[1] for beat in (_ODOMETRY, _BASE_TF, _SCAN, _CORRECTION, _CAMERA, _PICTURE)
)
"""Nothing arrives later than this after its stamp."""

_LATCHED_AGE_NS: Final = 5 * _MS


class RobotSpeech:
    """Turns the state of a simulator into messages; ask once after each step.

    Stamps are the simulator's time, arrivals a few milliseconds later, as in real systems, with
    jitter drawn from `generator`.
    """

    def __init__(
        self,
        simulator: Simulator,
        factory: MessageFactory,
        generator: np.random.Generator,
        camera: OfficeCamera | None = None,
    ) -> None:
        self._camera = camera
        self._simulator = simulator
        self._factory = factory
        self._generator = generator

    def latched(self) -> Iterator[TimedMessage]:
        """Yield what is said once, at the start: map, voxel cloud and fixed joints."""
        factory, building = self._factory, self._simulator.building
        now_ns = self._simulator.now_ns
        stamp_ns = now_ns - _LATCHED_AGE_NS
        centres_m = surface_centres_m(building.voxels())
        cloud = make_cloud(factory, MAP_FRAME, stamp_ns, centres_m.astype(np.float32))
        yield TimedMessage("/map", now_ns, make_grid(factory, building.grid(stamp_ns)))
        yield TimedMessage("/octomap_point_cloud_centers", now_ns, cloud)
        joints = make_transforms(factory, fixed_joints(stamp_ns))
        yield TimedMessage("/tf_static", now_ns, joints)

    def due(self) -> Iterator[TimedMessage]:
        """Yield what is stamped with the present step."""
        steps = self._simulator.steps
        for topic, beat, make in (
            ("/odom", _ODOMETRY, self._odometry),
            ("/tf", _BASE_TF, self._base_transform),
            ("/scan", _SCAN, self._scan),
            ("/tf", _CORRECTION, self._correction),
            ("/camera/camera_info", _CAMERA, self._camera_info),
        ):
            if beat.is_due(steps):
                latency_ns = int(self._generator.integers(*beat.latency_ns))
                yield TimedMessage(topic, self._simulator.now_ns + latency_ns, make())
        if self._camera is not None and _PICTURE.is_due(steps):
            yield from self._pictures(self._camera, steps // _PICTURE.period)

    def _pictures(self, camera: OfficeCamera, number: int) -> Iterator[TimedMessage]:
        """Yield picture `number`, its depths before."""
        now_ns, factory = self._simulator.now_ns, self._factory
        header = Header(CAMERA_FRAME, now_ns)
        map_from_camera = self._simulator.map_from_base @ BASE_FROM_OPTICAL
        depths = make_depth_png(factory, header, camera.depths_mm(map_from_camera))
        colours = make_jpeg(factory, header, camera.colours(map_from_camera, number))
        for topic, late_ns, message in zip(
            IMAGE_TOPICS, _PICTURE.latency_ns, (depths, colours), strict=True
        ):
            yield TimedMessage(topic.name, now_ns + late_ns, message)

    def _odometry(self) -> Any:
        simulator = self._simulator
        reading = OdometryReading(
            ODOM_FRAME,
            BASE_FRAME,
            simulator.now_ns,
            simulator.odom_from_base,
            (simulator.state.speed_m_s, 0.0, 0.0),
            (0.0, 0.0, simulator.state.turn_rate_rad_s),
        )
        return make_odometry(self._factory, reading)

    def _base_transform(self) -> Any:
        now_ns, pose = self._simulator.now_ns, self._simulator.odom_from_base
        return make_transforms(self._factory, [stamped(ODOM_FRAME, BASE_FRAME, now_ns, pose)])

    def _correction(self) -> Any:
        now_ns, pose = self._simulator.now_ns, self._simulator.map_from_odom
        return make_transforms(self._factory, [stamped(MAP_FRAME, ODOM_FRAME, now_ns, pose)])

    def _scan(self) -> Any:
        return make_scan(self._factory, self._simulator.scan())

    def _camera_info(self) -> Any:
        header = Header(CAMERA_FRAME, self._simulator.now_ns)
        return make_camera_info(self._factory, header, CAMERA_INFO)


# Records a simulated drive, as `ros2 bag record` would on the robot.


class MessageSink(Protocol):
    """What a recording goes into; the replay's `BagWriter` is one."""

    def add_topic(
        self,
        topic: str,
        type_name: str,
        *,
        is_latched: bool = False,
        is_reliable: bool = True,
        depth: int = 10,
    ) -> None:
        """Announce a topic and its quality of service."""

    def write(self, topic: str, log_time_ns: int, message: Any) -> None:
        """Append a message that the sink's own factory made."""


def record(
    simulator: Simulator,
    driver: Driver,
    sink: MessageSink,
    factory: MessageFactory,
    duration_s: float,
    seed: int = 0,
    camera: OfficeCamera | None = None,
) -> None:
    """Drive for [0, duration_s) and write all messages stamped in it, in order of arrival.

    With a camera there are images.
    """
    for topic in (*ROBOT_TOPICS, *(IMAGE_TOPICS if camera is not None else ())):
        sink.add_topic(
            topic.name,
            topic.type_name,
            is_latched=topic.is_latched,
            is_reliable=topic.is_reliable,
            depth=topic.depth,
        )
    speech = RobotSpeech(simulator, factory, np.random.default_rng(seed), camera)
    spoken = _spoken(simulator, driver, speech, round(duration_s * STEPS_PER_S))
    for message in _in_order(spoken):
        sink.write(message.topic, message.arrival_ns, message.message)


def _spoken(
    simulator: Simulator, driver: Driver, speech: RobotSpeech, steps: int
) -> Iterator[TimedMessage]:
    """Yield all messages in order of their stamps."""
    yield from speech.latched()
    for _ in range(steps):
        yield from speech.due()
        simulator.step(driver.command(simulator.state))


def _in_order(messages: Iterator[TimedMessage]) -> Iterator[TimedMessage]:
    """Sort by arrival messages that arrive out of order by at most the longest latency."""
    waiting: list[tuple[int, int, TimedMessage]] = []
    for number, message in enumerate(messages):
        heapq.heappush(waiting, (message.arrival_ns, number, message))
        while waiting[0][0] <= message.arrival_ns - MAX_LATENCY_NS:
            yield heapq.heappop(waiting)[2]
    while waiting:
        yield heapq.heappop(waiting)[2]
