"""The scene that a recording of the node's outputs tells of, as a replay keeps its own."""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from are_ros.artefacts.artefact import GroundPose, Origin
from are_ros.artefacts.catalogue import Catalogue, CatalogueRow
from are_ros.artefacts.shapes import Shape
from are_ros.bag.decoded import Event, Grid, Metrics, Odometry, Perceived, Scene
from are_ros.bag.reader import BagTopic
from are_ros.bag.recording import PREFIX, RecordedMessage, Recording, find_recording
from are_ros.bag.roles import find_roles
from are_ros.builder.assembly import robot_footprint
from are_ros.builder.outputs import ArtefactEvent, ArtefactState, EventKind, SceneMetrics
from are_ros.draw.scene import SceneRecord
from are_ros.errors import BagError
from are_ros.messages.odometry import OdometryNumbers
from are_ros.messages.transforms import StampedTransform
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import with_file
from are_ros.replay._recorded_robot import RecordedRobot
from are_ros.replay.progress import Progress
from are_ros.replay.scene_record import Moment, SceneRecorder
from are_ros.world.cameras import Camera
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
    with Recording(found) as recording:
        teller = _Teller(recording, parameters)
        start_ns, end_ns = recording.span_ns
        progress = open_progress(start_ns, end_ns)
        for message in recording.in_log_order(teller.role_of_topic):
            teller.take(message, recording.decode(message))
            progress(message.log_ns)
        progress(end_ns)
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

    def __init__(self, recording: Recording, parameters: Parameters) -> None:
        self.role_of_topic = _topics(recording)
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
            "events": self._take_event,
            "metrics": self._take_metrics,
            "odom": self._take_odometry,
            "camera/camera_info": lambda image: self._robot.take_camera(image.message),
            "map": self._take_map,
            _AUGMENTED: self._take_augmented,
        }

    def take(self, message: RecordedMessage, value: Any) -> None:
        """Take the value of a message of one of the topics."""
        role = self.role_of_topic[message.topic]
        if role in {"tf", "tf_static"}:
            for parent, child, stamp_ns, numbers in value.samples:
                stamped = StampedTransform(parent, child, stamp_ns, numbers[:3], numbers[3:])
                self._robot.take_transform(stamped, is_static=role == "tf_static")
        else:
            self._handlers[role](value)

    def record(self) -> SceneRecord:
        """Return the record of everything taken."""
        while self._waiting:
            self._keep_first()
        return self._recorder.record()

    def robot_problem(self) -> str:
        """Return why the robot's pose was not known last, where anything could tell it."""
        could_tell = {"tf", "tf_static", "odom"} & {*self.role_of_topic.values()}
        return self._robot.missing if could_tell else ""

    def _take_artefacts(self, scene: Scene) -> None:
        states = tuple(state_of(scene, i) for i in range(len(scene.ids)))
        for state in states:
            self._recorder.know(_row_of(state))
        poses = self._robot.poses(scene.stamp_ns)
        self._waiting.append(_Tick(scene.stamp_ns, states, *poses, self._robot.camera))
        if len(self._waiting) > _WAITING_TICKS:
            self._keep_first()

    def _take_perceived(self, perceived: Perceived) -> None:
        ids = [one.artefact_id for one in perceived.sightings]
        self._perceived[perceived.stamp_ns] = ids

    def _take_event(self, event: Event) -> None:
        kind, texts = EventKind(event.kind), (event.label, event.detail)
        self._events.append(
            ArtefactEvent(event.stamp_ns, kind, event.artefact_id, *texts, event.value)
        )

    def _take_metrics(self, metrics: Metrics) -> None:
        fields = {name: getattr(metrics, name) for name in SceneMetrics.__dataclass_fields__}
        self._metrics[metrics.stamp_ns] = SceneMetrics(**fields)

    def _take_odometry(self, odometry: Odometry) -> None:
        self._robot.take_odometry(OdometryNumbers(*odometry.sample, twist=()))

    def _take_map(self, grid: Grid) -> None:
        self.grid = grid_of(grid, "map")

    def _take_augmented(self, message: Grid) -> None:
        """Keep what was never more occupied: artefacts come and go, walls stay."""
        grid, known = grid_of(message, _AUGMENTED), self.grid
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


def state_of(scene: Scene, i: int) -> ArtefactState:
    """Return the ground truth of one artefact; of its features only the activity is known."""
    pose, ground = (_transform(poses[i].tolist()) for poses in (scene.poses, scene.ground_poses))
    x_m, y_m, z_m = ground.translation_m.tolist()
    twist = scene.twists[i].tolist()
    box_m, size_m = scene.box_centres_m[i].tolist(), (2.0 * scene.half_sizes_m[i]).tolist()
    return ArtefactState(
        artefact_id=int(scene.ids[i]),
        row=int(scene.rows[i]),
        label=scene.labels[i],
        class_name=scene.classes[i],
        map_from_artefact=pose,
        ground_pose=GroundPose(x_m, y_m, z_m, ground.yaw_rad()),
        box_centre_m=(box_m[0], box_m[1], box_m[2]),
        size_m=(size_m[0], size_m[1], size_m[2]),
        linear_velocity_m_s=(twist[0], twist[1], twist[2]),
        angular_velocity_rad_s=(twist[3], twist[4], twist[5]),
        behaviour=scene.behaviours[i],
        arrival_ns=int(scene.arrivals_ns[i]),
        departure_ns=int(scene.departures_ns[i]),
        origin=Origin(int(scene.origins[i])),
        features={},
        activity=scene.activities[i],
    )


def _row_of(state: ArtefactState) -> CatalogueRow:
    """Return what an artefact tells of its row: label, class and box; the rest is unknown."""
    return CatalogueRow(
        state.row, state.label, state.class_name, state.size_m, state.box_centre_m, Shape.WALL
    )


def grid_of(grid: Grid, source: str = "map") -> OccupancyGrid:
    """Return a recorded grid; InputError, beginning with `source`, where it is malformed."""
    x_m, y_m, z_m, *turn = grid.origin
    return OccupancyGrid.checked(
        grid.data.copy(),
        width=grid.width,
        height=grid.height,
        resolution_m=float(grid.resolution_m),
        origin_xyz_m=(x_m, y_m, z_m),
        origin_rotation_xyzw=(turn[0], turn[1], turn[2], turn[3]),
        frame_id=grid.frame_id,
        stamp_ns=grid.stamp_ns,
        source=source,
    )


def _transform(numbers: list[float]) -> RigidTransform:
    x, y, z, *turn = numbers
    return RigidTransform.checked((x, y, z), (turn[0], turn[1], turn[2], turn[3]))


def _topics(recording: Recording) -> dict[str, str]:
    """Return the role of each topic that is read."""
    counts = recording.counts
    topics = [BagTopic(t, kind, counts[t], is_latched=False) for t, kind in recording.types.items()]
    roles = find_roles(topics, {})
    found = {role: roles.topic(role) for role in _ROLES}
    chosen = {topic: role for role, topic in found.items() if topic and PREFIX not in topic}
    outputs = [*_TRUTH, *([] if "map" in chosen.values() else [_AUGMENTED])]
    return chosen | {PREFIX + name: name for name in outputs if PREFIX + name in counts}
