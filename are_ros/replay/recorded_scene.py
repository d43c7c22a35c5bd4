"""The record of a run from messages of the node: of a recording, or live from the running node."""

import math
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from are_ros.agents.events import ArtefactEvent, EventKind, SceneMetrics
from are_ros.bag.decoded import Event, Grid, Metrics, Perceived, Scene
from are_ros.bag.recording import PREFIX, Recording, find_recording
from are_ros.bag.roles import CAMERA, OCTOMAP, find_roles, slashed
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.conventions import UNKNOWN
from are_ros.draw.scene import ArtefactAt, Moment, ScanPoints, SceneRecord, scan_points
from are_ros.errors import AreError, BagError, InputError
from are_ros.messages.common import read_header
from are_ros.messages.maps import read_voxels
from are_ros.messages.sensors import read_scan
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import GroundPose
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.replay.progress import OpenProgress
from are_ros.replay.recorded_frames import ROBOT_ROLES, RecordedRobot
from are_ros.replay.scene_record import SceneRecorder
from are_ros.world.cameras import Camera, ViewModel
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.transforms.tree import FrameTree
from are_ros.world.voxel_map import VoxelMap

Keep = Callable[[Moment, Camera | None], None]

SCAN, AUGMENTED_SCAN = "scan", "augmented_scan"
"""The roles of scans as the laser gave them, and as the node gave them out."""
_ROLES: Final = (*ROBOT_ROLES, "map")
_OUTPUTS: Final = ("artefacts", "perceived", "events", "metrics")
_AUGMENTED: Final = "augmented_map"
_OTHER_CAMERA: Final = "other_camera_info/"
"""The roles of other cameras begin so, and end with their numbers."""
_SCAN_TYPE: Final = "sensor_msgs/msg/LaserScan"
WAITING_TICKS: Final = 20
"""The messages of a tick come in any order, but not later than this."""
LATEST_TICKS: Final = 1200
"""A list of the perceived comes at most so much later: 10 s of latency at 100 Hz, and some."""
_WAITING_SCANS: Final = 2000
"""Scans as received wait for what was made of them: seconds, of several lasers at 100 Hz."""
_NO_METRICS: Final = SceneMetrics(0, 0, 0, 0, 0, 0, 0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class RecordedScene:
    """The record, the map that it goes with, and the parameters in force.

    `voxels` is the octomap, None where there is none. `robot_problem` says why the record has no
    pose of the robot, empty where it has one or no transforms were recorded; `cloud_problem` says
    why a recorded cloud gave no voxels; `left_out` says what else the recording holds.
    """

    record: SceneRecord
    grid: OccupancyGrid
    parameters: Parameters
    robot_problem: str
    voxels: VoxelMap | None
    cloud_problem: str
    left_out: str


def read_recorded_scene(
    path: Path,
    open_progress: OpenProgress,
    *,
    with_scans: bool = False,
) -> RecordedScene:
    """Return the scene of a recording of the node's outputs; `path` is as for `find_recording`.

    Where it holds no real map, the least of each cell of the augmented maps stands in; without
    transforms there is no robot. Scans are read only if asked for. Raises BagError
    where there is no recording, or no ground truth or no map in it, ParameterError for bad
    parameters.
    """
    found = find_recording(path)
    parameters = found.effective()
    recorder = SceneRecorder(parameters, Catalogue(()))
    with Recording(found) as recording:
        cameras = {slashed(name): role for name, role in other_camera_roles(parameters).items()}
        roles = _topics(recording, cameras, with_scans=with_scans)
        has_camera_info = CAMERA in roles.values()
        reader = SceneReader(parameters, recorder.keep, has_camera_info=has_camera_info)
        for message in recording.messages(roles, open_progress):
            reader.take(roles[message.topic], recording.decode(message))
        left_out = recording.left_out
    reader.finish()
    record, grid = recorder.record(), reader.grid
    if not len(record.series.stamps_ns):
        raise BagError(f"{path}: it holds no {PREFIX}artefacts, so there is nothing to show")
    if grid is None:
        raise BagError(f"{path}: it holds no map, neither /map nor {PREFIX}{_AUGMENTED}")
    could_tell = {"tf", "tf_static", "odom"} & {*roles.values()}
    problem = reader.robot_problem if could_tell else ""
    problem += found.untold if problem else ""
    voxels = reader.voxels()
    return RecordedScene(record, grid, parameters, problem, voxels, reader.cloud_problem, left_out)


def other_camera_roles(parameters: Parameters) -> dict[str, str]:
    """Return the role, for a `SceneReader`, of each topic of `camera.others`."""
    topics = enumerate(parameters.camera.others, 1)
    return {topic: f"{_OTHER_CAMERA}{number}" for number, topic in topics}


def _topics(
    recording: Recording, cameras: Mapping[str, str], *, with_scans: bool
) -> dict[str, str]:
    """Return the role of each topic that is read; `cameras` are those of other cameras."""
    types = recording.types
    roles = find_roles([topic for topic in recording.topics if topic.name not in cameras], {})
    chosen = roles.by_topic((*_ROLES, OCTOMAP))
    if with_scans:
        for topic, type_name in types.items():
            if type_name == _SCAN_TYPE:
                chosen[topic] = AUGMENTED_SCAN if topic.startswith(PREFIX) else SCAN
    outputs = [*_OUTPUTS, *([] if "map" in chosen.values() else [_AUGMENTED])]
    chosen |= {topic: role for topic, role in cameras.items() if topic in types}
    return chosen | {PREFIX + name: name for name in outputs if PREFIX + name in types}


class SceneReader:
    """Takes decoded messages in their order, and gives a `Moment` for each tick.

    `keep` is called with the moment and the camera of that time when all messages of the tick have
    come: 20 ticks later and after the list of the perceived of that tick or of a later one, which
    the latency of a detector delays; live, as soon as that list has come, or is overdue.
    """

    def __init__(
        self, parameters: Parameters, keep: Keep, *, has_camera_info: bool, is_live: bool = False
    ) -> None:
        self.grid: OccupancyGrid | None = None
        self.cloud_problem = ""
        self.revision = 0
        """It changes whenever the map or the voxels do."""
        self._parameters, self._keep, self._is_live = parameters, keep, is_live
        certainty = parameters.certainty
        late_s = certainty.latency if certainty.enabled else 0.0
        late = math.ceil(late_s * parameters.builder.tick_rate)
        self._most = WAITING_TICKS + late if is_live else LATEST_TICKS
        self._robot = RecordedRobot(parameters, has_camera_info=has_camera_info)
        self._scans = _ScanKeeper(parameters.frames.map)
        self._waiting: deque[tuple[Moment, Camera | None]] = deque()
        self._perceived: OrderedDict[int, frozenset[int]] = OrderedDict()
        self._last_ns = -1
        self._listed_ns = -1
        """The stamp of the last list of the perceived: those of ticks before it have come."""
        self._metrics: OrderedDict[int, SceneMetrics] = OrderedDict()
        self._last_metrics = _NO_METRICS
        self._events: list[ArtefactEvent] = []
        self._rows: dict[tuple[int, str], CatalogueRow] = {}
        self._cloud: Any = None
        self._handlers: Mapping[str, Callable[[Any], None]] = {
            "artefacts": self._take_artefacts,
            "perceived": self._take_perceived,
            "events": self._take_event,
            "metrics": self._take_metrics,
            **{role: partial(self._robot.take, role) for role in ROBOT_ROLES},
            "map": self._take_map,
            _AUGMENTED: self._take_augmented,
            OCTOMAP: self._take_cloud,
            SCAN: partial(_remember, self._scans.inputs),
            AUGMENTED_SCAN: partial(_remember, self._scans.outputs),
            **{
                role: partial(self._take_camera, int(role.removeprefix(_OTHER_CAMERA)))
                for role in other_camera_roles(parameters).values()
            },
        }

    def _take_camera(self, number: int, image: Any) -> None:
        self._robot.take_camera(image.message, number)

    @property
    def camera(self) -> ViewModel | None:
        """The camera as it is known last."""
        return None if self._robot.camera is None else self._robot.camera.view

    @property
    def robot_problem(self) -> str:
        """Why the robot's pose was not known last, empty if it was."""
        return self._robot.missing

    def take(self, role: str, value: Any) -> None:
        """Take a value of `bag.decoded`, by its role among the inputs or the output's name."""
        self._handlers[role](value)

    def finish(self) -> None:
        """Give all waiting ticks."""
        while self._waiting:
            self._give_first()

    def voxels(self) -> VoxelMap | None:
        """Return the voxels of the last cloud, None where there is none whose place is known."""
        if self._cloud is None:
            return None
        try:
            points_m, size_m = read_voxels(self._cloud, OCTOMAP)
            frame = read_header(self._cloud, OCTOMAP).frame_id
            pose = self._robot.tree.lookup_latest(self._parameters.frames.map, frame)
            wanted_m = self._parameters.world.voxel_size or None
            return VoxelMap.from_centres(points_m, size_m, pose, OCTOMAP, wanted_m)
        except AreError as error:
            self.cloud_problem = f"the voxels are not shown: {error}"
            return None

    def _take_artefacts(self, scene: Scene) -> None:
        if scene.stamp_ns < self._last_ns:
            self._begin_anew(scene.stamp_ns)
        self._last_ns = scene.stamp_ns
        artefacts = [self._artefact(scene, i) for i in range(len(scene.ids))]
        poses, scans = self._robot.poses(scene.stamp_ns), self._scans.take(self._robot.tree)
        others = self._robot.others(scene.stamp_ns)
        moment = Moment(scene.stamp_ns, artefacts, frozenset(), *poses, scans=scans, others=others)
        self._waiting.append((moment, self._robot.camera))
        self._give()

    def _begin_anew(self, now_ns: int) -> None:
        """Forget what is later than a tick: the clock jumped back to it."""
        self.finish()
        self._robot.forget_after(now_ns)
        self._scans.forget()
        for told in (self._perceived, self._metrics):
            for late_ns in [stamp_ns for stamp_ns in told if stamp_ns > now_ns]:
                del told[late_ns]
        self._listed_ns = max(self._perceived, default=-1)
        self._events = [event for event in self._events if event.stamp_ns <= now_ns]

    def _artefact(self, scene: Scene, i: int) -> ArtefactAt:
        x_m, y_m, z_m, *_, z, w = scene.ground_poses[i].tolist()
        yaw_rad = math.atan2(2.0 * w * z, 1.0 - 2.0 * z * z)
        key = int(scene.rows[i]), scene.labels[i]
        if key not in self._rows:
            self._rows[key] = _row(scene, i)
        pose, doing = GroundPose(x_m, y_m, z_m, yaw_rad), (scene.behaviours[i], scene.activities[i])
        number, arrival_ns = int(scene.ids[i]), int(scene.arrivals_ns[i])
        return ArtefactAt(number, self._rows[key], pose, *doing, arrival_ns)

    def _take_perceived(self, perceived: Perceived) -> None:
        self._perceived[perceived.stamp_ns] = perceived.ids
        self._listed_ns = perceived.stamp_ns
        self._give()

    def _take_event(self, event: Event) -> None:
        if event.kind not in list(EventKind):
            raise BagError(f"an event of artefact {event.artefact_id} is of no kind: {event.kind}")
        kind, texts = EventKind(event.kind), (event.label, event.detail)
        self._events.append(
            ArtefactEvent(event.stamp_ns, kind, event.artefact_id, *texts, event.value)
        )

    def _take_metrics(self, metrics: Metrics) -> None:
        names = [field.name for field in fields(SceneMetrics)]
        self._metrics[metrics.stamp_ns] = SceneMetrics(*(getattr(metrics, n) for n in names))

    def _take_map(self, value: Grid) -> None:
        grid = grid_of(value, "map")
        if self.grid is None or not grid.is_same_map(self.grid):
            self.revision += 1
        self.grid = grid

    def _take_augmented(self, value: Grid) -> None:
        """Keep the least known value of each cell: artefacts come and go, walls stay.

        Where a map is being made, unknown cells become known; one that has grown or moved is new.
        """
        grid, known = grid_of(value, _AUGMENTED), self.grid
        if known is not None and known.is_same_lattice(grid):
            are_known = (known.cells > UNKNOWN) & (grid.cells > UNKNOWN)
            cells = np.where(are_known, np.minimum(known.cells, grid.cells), grid.cells)
            grid = OccupancyGrid(cells, grid.resolution_m, grid.origin, grid.frame_id)
        self.grid = grid

    def _take_cloud(self, message: Any) -> None:
        self.revision += self._cloud is None or bytes(self._cloud.data) != bytes(message.data)
        self._cloud = message

    def _give(self) -> None:
        least = 0 if self._is_live else WAITING_TICKS
        while len(self._waiting) > least and (
            self._waiting[0][0].stamp_ns <= self._listed_ns or len(self._waiting) > self._most
        ):
            self._give_first()

    def _give_first(self) -> None:
        moment, camera = self._waiting.popleft()
        now_ns = moment.stamp_ns
        self._last_metrics = self._metrics.pop(now_ns, self._last_metrics)
        events = [event for event in self._events if event.stamp_ns <= now_ns]
        self._events = [event for event in self._events if event.stamp_ns > now_ns]
        perceived = self._perceived.pop(now_ns, frozenset())
        for unused in (self._perceived, self._metrics):
            while len(unused) > 2 * LATEST_TICKS:
                unused.popitem(last=False)
        metrics = self._last_metrics
        self._keep(replace(moment, perceived=perceived, events=events, metrics=metrics), camera)


class _ScanKeeper:
    """Finds the ends of the beams, and which returns are virtual: those that the input lacks.

    The scans are those that the node gave out; where it gave out none yet, those it received.
    """

    def __init__(self, map_frame: str) -> None:
        self._map_frame = map_frame
        self.inputs: OrderedDict[tuple[int, str], LaserScan] = OrderedDict()
        self.outputs: OrderedDict[tuple[int, str], LaserScan] = OrderedDict()
        self._are_given_out = False
        self._shown_ns: dict[str, int] = {}
        """The stamp of the last scan of each frame that was returned."""

    def forget(self) -> None:
        """Forget all scans: the clock jumped back."""
        self.inputs.clear()
        self.outputs.clear()
        self._shown_ns.clear()

    def take(self, frames: FrameTree) -> tuple[ScanPoints, ...]:
        """Return the newest scan of each frame that can be placed, those since the last call."""
        self._are_given_out = self._are_given_out or bool(self.outputs)
        found: list[ScanPoints] = []
        newest_ns: dict[str, int] = {}
        scans = self.outputs if self._are_given_out else self.inputs
        for (stamp_ns, frame_id), scan in reversed(scans.items()):
            if frame_id in newest_ns:
                continue
            if stamp_ns == self._shown_ns.get(frame_id):  # and so are all before it
                newest_ns[frame_id] = stamp_ns
                continue
            pose = frames.try_lookup(self._map_frame, frame_id, stamp_ns)
            if pose is not None:
                found.append(scan_points(scan, self.inputs.get((stamp_ns, frame_id)), pose))
                newest_ns[frame_id] = stamp_ns
        self._shown_ns |= newest_ns
        self.outputs.clear()
        return tuple(found)


def _remember(scans: "OrderedDict[tuple[int, str], LaserScan]", message: Any) -> None:
    """Keep a scan; a malformed one is not shown, and `are check` reports it."""
    try:
        scan = read_scan(message)
    except InputError:
        return
    scans[scan.stamp_ns, scan.frame_id] = scan
    while len(scans) > _WAITING_SCANS:
        scans.popitem(last=False)


def _row(scene: Scene, i: int) -> CatalogueRow:
    """Return the row of an artefact: label, class and box; the rest is unknown."""
    length_m, width_m, height_m = (2.0 * scene.half_sizes_m[i]).tolist()
    x_m, y_m, z_m = scene.box_centres_m[i].tolist()
    names = int(scene.rows[i]), scene.labels[i], scene.classes[i]
    return CatalogueRow(*names, (length_m, width_m, height_m), (x_m, y_m, z_m), Shape.WALL)


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
