"""The scene that a recording of the node's outputs tells of, as a replay keeps its own."""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from are_ros.artefacts.catalogue import Catalogue
from are_ros.bag.recording import PREFIX, find_recording
from are_ros.builder.assembly import robot_footprint
from are_ros.builder.events import ArtefactEvent
from are_ros.builder.outputs import ArtefactState, SceneMetrics
from are_ros.errors import BagError
from are_ros.messages.grid import read_grid
from are_ros.messages.times import read_time
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import with_file
from are_ros.replay._recorded_messages import event_of, metrics_of, row_of, state_of
from are_ros.replay._recorded_robot import RecordedRobot
from are_ros.replay.bag_reader import BagMessage, BagReader
from are_ros.replay.roles import find_roles
from are_ros.replay.runner import Progress
from are_ros.replay.scene_record import Moment, SceneRecord, SceneRecorder
from are_ros.world.observer import Camera
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

OpenProgress = Callable[[int, int], Progress]

_ROLES: Final = ("tf", "tf_static", "odom", "camera/camera_info", "map")
_TRUTH: Final = ("artefacts", "perceived", "events", "metrics")
_AUGMENTED: Final = "augmented_map"
_WAITING_TICKS: Final = 20
"""Live, what belongs to one tick is received in any order, but not later than this."""

_NO_METRICS: Final = SceneMetrics(0, 0, 0, 0, 0, 0, 0, 0.0, 0.0, float("nan"))


@dataclass(frozen=True, eq=False)
class RecordedScene:
    """The record, the map that it goes with, and the parameters in force (effective.yaml's)."""

    record: SceneRecord
    grid: OccupancyGrid
    parameters: Parameters
    robot_problem: str = ""
    """Why the robot is nowhere in it; empty where it is, or where nothing could tell."""


def read_recorded_scene(path: Path, open_progress: OpenProgress) -> RecordedScene:
    """Return the scene of a recording of the node's outputs; `path` is as for `find_recording`.

    Where it holds no real map, the least of each cell of the augmented maps stands in; without
    transforms there is no robot. Raises BagError where there is no recording, or no ground truth
    or no map in it, ParameterError for a bad effective.yaml.
    """
    found = find_recording(path)
    parameters = Parameters()
    if found.parameters is not None:
        parameters = with_file(parameters, found.parameters)
    with BagReader([found.path]) as reader:
        teller = _Teller(reader, parameters)
        progress = open_progress(reader.start_ns, reader.end_ns)
        for message in reader.messages(tuple(teller.role_of_topic)):
            teller.take(message)
            progress(message.log_time_ns)
        progress(reader.end_ns)
    record, grid = teller.record(), teller.grid
    if not len(record.series.stamps_ns):
        raise BagError(f"{path}: it holds no {PREFIX}artefacts, so there is nothing to show")
    if grid is None:
        raise BagError(f"{path}: it holds no map, neither /map nor {PREFIX}{_AUGMENTED}")
    return RecordedScene(record, grid, parameters, teller.robot_problem())


@dataclass(frozen=True, eq=False)
class _Tick:
    """What is known when a list of artefacts comes."""

    stamp_ns: int
    states: tuple[ArtefactState, ...]
    map_from_base: RigidTransform | None
    map_from_camera: RigidTransform | None
    camera: Camera | None


class _Teller:
    """Takes messages in the order of the log, and keeps what they tell tick by tick."""

    def __init__(self, reader: BagReader, parameters: Parameters) -> None:
        self._reader = reader
        self.role_of_topic = _topics(reader)
        roles = set(self.role_of_topic.values())
        self._robot = RecordedRobot(parameters, has_camera_info="camera/camera_info" in roles)
        self._recorder = SceneRecorder(
            Catalogue(()),
            seed=parameters.seed,
            max_range_m=parameters.occlusion.max_range,
            footprint=robot_footprint(parameters.robot),
        )
        self._waiting: deque[_Tick] = deque()
        self._perceived: dict[int, list[int]] = {}
        self._metrics: dict[int, SceneMetrics] = {}
        self._last_metrics = _NO_METRICS
        self._events: list[ArtefactEvent] = []
        self.grid: OccupancyGrid | None = None
        self._handlers: Mapping[str, Callable[[Any], None]] = {
            "artefacts": self._take_artefacts,
            "perceived": self._take_perceived,
            "events": lambda message: self._events.append(event_of(message)),
            "metrics": self._take_metrics,
            "camera/camera_info": self._robot.take_camera,
            "map": self._take_map,
            _AUGMENTED: self._take_augmented,
        }

    def take(self, message: BagMessage) -> None:
        """Take a message of one of the topics."""
        role = self.role_of_topic[message.topic]
        if role in {"tf", "tf_static"}:
            for transform in self._reader.transforms(message):
                self._robot.take_transform(transform, is_static=role == "tf_static")
        elif role == "odom":
            self._robot.take_odometry(self._reader.odometry(message))
        else:
            self._handlers[role](self._reader.deserialize(message))

    def record(self) -> SceneRecord:
        """Return the record of everything taken."""
        while self._waiting:
            self._keep_first()
        return self._recorder.record()

    def robot_problem(self) -> str:
        """Return why the robot's pose was not known last, where anything could tell it."""
        could_tell = {"tf", "tf_static", "odom"} & {*self.role_of_topic.values()}
        return self._robot.missing if could_tell else ""

    def _take_artefacts(self, message: Any) -> None:
        stamp_ns = read_time(message.header.stamp)
        states = tuple(state_of(one) for one in message.artefacts)
        for state in states:
            self._recorder.know(row_of(state))
        poses = self._robot.poses(stamp_ns)
        self._waiting.append(_Tick(stamp_ns, states, *poses, self._robot.camera))
        if len(self._waiting) > _WAITING_TICKS:
            self._keep_first()

    def _take_perceived(self, message: Any) -> None:
        stamp_ns = read_time(message.header.stamp)
        self._perceived[stamp_ns] = [int(one.id) for one in message.artefacts]

    def _take_metrics(self, message: Any) -> None:
        self._metrics[read_time(message.header.stamp)] = metrics_of(message)

    def _take_map(self, message: Any) -> None:
        self.grid = read_grid(message, "map")

    def _take_augmented(self, message: Any) -> None:
        """Keep what was never more occupied: artefacts come and go, walls stay."""
        grid, known = read_grid(message, _AUGMENTED), self.grid
        if known is not None and known.cells.shape == grid.cells.shape:
            cells = np.minimum(known.cells, grid.cells)
            grid = OccupancyGrid(cells, grid.resolution_m, grid.origin, grid.frame_id)
        self.grid = grid

    def _keep_first(self) -> None:
        tick = self._waiting.popleft()
        self._last_metrics = self._metrics.pop(tick.stamp_ns, self._last_metrics)
        events = [event for event in self._events if event.stamp_ns <= tick.stamp_ns]
        self._events = [event for event in self._events if event.stamp_ns > tick.stamp_ns]
        moment = Moment(
            tick.stamp_ns,
            tick.states,
            self._perceived.pop(tick.stamp_ns, []),
            events,
            self._last_metrics,
            tick.map_from_base,
            tick.map_from_camera,
        )
        self._recorder.keep(moment, tick.camera)


def _topics(reader: BagReader) -> dict[str, str]:
    """Return the role of each topic that is read."""
    roles = find_roles(reader.topics, {})
    found = {role: roles.topic(role) for role in _ROLES}
    chosen = {topic: role for role, topic in found.items() if topic and PREFIX not in topic}
    outputs = [*_TRUTH, *([] if "map" in chosen.values() else [_AUGMENTED])]
    names = {topic.name for topic in reader.topics}
    return chosen | {PREFIX + name: name for name in outputs if PREFIX + name in names}
