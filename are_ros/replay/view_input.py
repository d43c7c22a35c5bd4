"""What the viewer shows, from messages of the node: of a recording, or live; and from a replay."""

from collections import OrderedDict, deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.catalogue import Catalogue
from are_ros.bag.decoded import value_of
from are_ros.bag.reader import BagMessage, BagReader
from are_ros.bag.recording import RECORDING, find_recording
from are_ros.bag.roles import find_roles
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.assembly import catalogue_of, robot_footprint
from are_ros.builder.laser_scan import LaserScan
from are_ros.builder.outputs import ArtefactState
from are_ros.builder.sensors import ReleasedReading
from are_ros.builder.tick import Tick
from are_ros.draw.viewer import (
    MISSING_VISER,
    TickThinner,
    ViewedArtefact,
    ViewedPlace,
    ViewedScan,
    ViewedTick,
    has_viser,
    thinned_scan,
    write_view,
)
from are_ros.errors import AreError, BagError, InputError
from are_ros.messages.cloud import read_points
from are_ros.messages.common import read_header, read_time
from are_ros.messages.grid import read_grid
from are_ros.messages.odometry import OdometryNumbers
from are_ros.messages.sensors import read_scan
from are_ros.messages.transforms import StampedTransform
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import with_file
from are_ros.replay._recorded_robot import RecordedRobot
from are_ros.replay.film_command import without_robot
from are_ros.replay.listeners import PREFIX
from are_ros.replay.progress import Progress, ProgressBar
from are_ros.replay.recorded_scene import state_of
from are_ros.replay.runner import Listener
from are_ros.world.cameras import ViewModel
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.transforms.tree import FrameTree
from are_ros.world.voxel_map import VoxelMap

OpenProgress = Callable[[int, int], Progress]

_ROLES: Final = ("tf", "tf_static", "odom", "camera/camera_info", "map")
_CLOUD: Final = "octomap_point_cloud_centers"
_ARTEFACTS: Final = "are_msgs/msg/ArtefactArray"
_AUGMENTED: Final = "augmented_map"
_SCAN: Final = "sensor_msgs/msg/LaserScan"
_WAITING_TICKS: Final = 20
"""Live, what belongs to one tick is received in any order, but not later than this."""

_WAITING_SCANS: Final = 40


class ViewFeed:
    """Takes the node's messages in the order in which they came, and makes ticks of them.

    `show` is called with each tick as soon as all of it is known. Messages are duck-typed: those of
    rosbags and of rclpy will do.
    """

    def __init__(
        self,
        parameters: Parameters,
        show: Callable[[ViewedTick], None],
        wants_next: Callable[[], bool] = lambda: True,
        *,
        has_camera_info: bool,
    ) -> None:
        self.grid: OccupancyGrid | None = None
        self.problem = ""
        self.revision = 0
        """It changes whenever the place does."""
        self._parameters = parameters
        self._show, self._wants_next = show, wants_next
        self._robot = RecordedRobot(parameters, has_camera_info=has_camera_info)
        self._waiting: deque[tuple[ViewedTick, list[ArtefactState]]] = deque()
        self._perceived: dict[int, frozenset[int]] = {}
        self._scans = ScanKeeper(parameters.frames.map)
        self._cloud: Any = None

    @property
    def camera(self) -> ViewModel | None:
        """The camera as it is known last."""
        return None if self._robot.camera is None else self._robot.camera.view

    def robot_problem(self) -> str:
        """Return why the robot's pose was not known last, empty if it was."""
        return self._robot.missing

    def take(self, role: str, message: Any) -> None:
        """Take a message of a role of the inputs, or of an output by its name; others are left."""
        handlers: Mapping[str, Callable[[Any], None]] = {
            "artefacts": self._take_artefacts,
            "perceived": self._take_perceived,
            "camera/camera_info": self._robot.take_camera,
            "map": self._take_map,
            _AUGMENTED: self._take_augmented,
            _CLOUD: self._take_cloud,
        }
        if role in handlers:
            handlers[role](message)

    def take_transforms(self, transforms: Sequence[StampedTransform], *, is_static: bool) -> None:
        """Take those of a message of /tf or /tf_static."""
        for transform in transforms:
            self._robot.take_transform(transform, is_static=is_static)

    def take_odometry(self, numbers: OdometryNumbers) -> None:
        """Take the pose of an odometry."""
        self._robot.take_odometry(numbers)

    def take_scan(self, message: Any, *, is_output: bool) -> None:
        """Take a scan as the laser gave it, or as the node gave it out."""
        try:
            scan = read_scan(message)
        except InputError:
            return  # `are check` tells of it; here it is a scan that is not shown
        if is_output:
            self._scans.take_output(scan)
        else:
            self._scans.take_input(scan)

    def finish(self) -> None:
        """Make ticks of all that waits."""
        while self._waiting:
            self._give_first()

    def place(self) -> ViewedPlace | None:
        """Return what stays, None before there is a map."""
        if self.grid is None:
            return None
        voxels = self._voxels()
        return place_of(self._parameters, self.grid, voxels, self.camera)

    def _take_artefacts(self, message: Any) -> None:
        if self._wants_next():
            stamp_ns = read_time(message.header.stamp)
            scene = value_of(_ARTEFACTS, message, stamp_ns)
            states = [state_of(scene, i) for i in range(len(scene.ids))]
            scans = self._scans.take(self._robot.tree)
            tick = ViewedTick(stamp_ns, (), *self._robot.poses(stamp_ns), scans)
            self._waiting.append((tick, states))
        self._give()

    def _take_perceived(self, message: Any) -> None:
        ids = frozenset(int(one.id) for one in message.artefacts)
        self._perceived[read_time(message.header.stamp)] = ids
        while len(self._perceived) > 10 * _WAITING_TICKS:
            del self._perceived[next(iter(self._perceived))]
        self._give()

    def _give(self) -> None:
        while self._waiting and (
            self._waiting[0][0].stamp_ns in self._perceived or len(self._waiting) > _WAITING_TICKS
        ):
            self._give_first()

    def _give_first(self) -> None:
        tick, states = self._waiting.popleft()
        perceived = self._perceived.pop(tick.stamp_ns, frozenset())
        artefacts = tuple(viewed(one, one.artefact_id in perceived) for one in states)
        poses = tick.map_from_base, tick.map_from_camera
        self._show(ViewedTick(tick.stamp_ns, artefacts, *poses, tick.scans))

    def _take_map(self, message: Any) -> None:
        grid = read_grid(message, "map")
        if self.grid is None or not np.array_equal(grid.cells, self.grid.cells):
            self.revision += 1
        self.grid = grid

    def _take_augmented(self, message: Any) -> None:
        """Keep what was never more occupied: artefacts come and go, walls stay."""
        grid, known = read_grid(message, _AUGMENTED), self.grid
        if known is not None and known.cells.shape == grid.cells.shape:
            cells = np.minimum(known.cells, grid.cells)
            grid = OccupancyGrid(cells, grid.resolution_m, grid.origin, grid.frame_id)
        self.grid = grid

    def _take_cloud(self, message: Any) -> None:
        self.revision += self._cloud is None or bytes(self._cloud.data) != bytes(message.data)
        self._cloud = message

    def _voxels(self) -> VoxelMap | None:
        """Return the voxels of the last cloud, None where there is none whose place is known."""
        if self._cloud is None:
            return None
        try:
            points_m = read_points(self._cloud, _CLOUD)
            frame, stamp_ns = read_header(self._cloud, _CLOUD).frame_id, 0
            map_frame, tree = self._parameters.frames.map, self._robot.tree
            if frame != map_frame:
                stamp_ns = tree.latest_common_time(map_frame, frame)
            pose = (
                RigidTransform.identity()
                if frame == map_frame
                else tree.lookup(map_frame, frame, stamp_ns)
            )
            wanted_m = self._parameters.world.voxel_size or None
            return VoxelMap.from_centres(points_m, None, pose, _CLOUD, wanted_m)
        except AreError as error:
            self.problem = f"the voxels are not shown: {error}"
            return None


class ScanKeeper:
    """Finds out where scans ended, and which returns are virtual: those that the input lacks."""

    def __init__(self, map_frame: str) -> None:
        self._map_frame = map_frame
        self._inputs: OrderedDict[tuple[int, str], LaserScan] = OrderedDict()
        self._outputs: OrderedDict[tuple[int, str], LaserScan] = OrderedDict()

    def take_input(self, scan: LaserScan) -> None:
        """Take a scan as the laser gave it."""
        _remember(self._inputs, scan)

    def take_output(self, scan: LaserScan) -> None:
        """Take a scan as the node gave it out."""
        _remember(self._outputs, scan)

    def take(self, frames: FrameTree) -> tuple[ViewedScan, ...]:
        """Return the newest scan of each frame that can be placed, and forget all before it."""
        found: dict[str, ViewedScan] = {}
        outputs = self._outputs or self._inputs
        for (stamp_ns, frame_id), scan in reversed(outputs.items()):
            if frame_id in found:
                continue
            pose = frames.try_lookup(self._map_frame, frame_id, stamp_ns)
            if pose is not None:
                found[frame_id] = viewed_scan(scan, self._inputs.get((stamp_ns, frame_id)), pose)
        self._outputs.clear()
        return tuple(found.values())


def _remember(scans: "OrderedDict[tuple[int, str], LaserScan]", scan: LaserScan) -> None:
    scans[scan.stamp_ns, scan.frame_id] = scan
    while len(scans) > _WAITING_SCANS:
        scans.popitem(last=False)


class ViewKeeper(Listener):
    """Keeps what the viewer shows of a replay."""

    def __init__(self, builder: ArBuilder) -> None:
        self.thinner = TickThinner()
        self._builder = builder
        self._scans: dict[str, ReleasedReading] = {}

    def take_tick(self, tick: Tick) -> None:
        """Keep a tick, with the newest scan of each topic."""
        if not self.thinner.wants_next():
            return
        perceived = {seen.artefact_id for seen in tick.perceived}
        artefacts = tuple(viewed(one, one.artefact_id in perceived) for one in tick.artefacts)
        scans = tuple(filter(None, map(self._viewed_scan, self._scans.values())))
        poses = tick.map_from_base, tick.map_from_camera
        self.thinner.add(ViewedTick(tick.stamp_ns, artefacts, *poses, scans))
        self._scans.clear()

    def take_readings(self, readings: Sequence[ReleasedReading]) -> None:
        """Remember laser scans until the next tick."""
        scans = (one for one in readings if isinstance(one.reading, LaserScan))
        self._scans |= {released.topic: released for released in scans}

    def _viewed_scan(self, released: ReleasedReading) -> ViewedScan | None:
        scan, frames = released.reading, self._builder.frames
        map_frame = self._builder.parameters.frames.map
        pose = frames.try_lookup(map_frame, scan.frame_id, scan.stamp_ns)
        return None if pose is None else viewed_scan(scan, released.received, pose)


def viewed(state: ArtefactState, is_perceived: bool) -> ViewedArtefact:
    """Return an artefact as the viewer takes it."""
    pose = state.map_from_artefact
    return ViewedArtefact(
        state.artefact_id,
        state.row,
        state.label,
        state.class_name,
        state.activity or state.behaviour,
        state.size_m,
        state.box_centre_m,
        (*pose.translation_m.tolist(), *pose.rotation_xyzw.tolist()),
        is_perceived,
    )


def viewed_scan(
    scan: LaserScan, received: LaserScan | None, map_from_sensor: RigidTransform
) -> ViewedScan:
    """Return where the beams of a scan end; without the scan as received none is virtual."""
    returned = (scan.ranges >= scan.range_min_m) & (scan.ranges <= scan.range_max_m)
    is_virtual: npt.NDArray[np.bool_] = np.zeros(len(scan.ranges), dtype=np.bool_)
    if received is not None and len(received.ranges) == len(scan.ranges):
        is_virtual = scan.ranges.view(np.uint32) != received.ranges.view(np.uint32)
    lengths_m = scan.ranges[returned].astype(np.float64)[:, np.newaxis]
    points_m = map_from_sensor.apply(scan.directions()[returned] * lengths_m)
    return thinned_scan(points_m.astype(np.float32), is_virtual[returned])


def place_of(
    parameters: Parameters,
    grid: OccupancyGrid,
    voxels: VoxelMap | None,
    camera: ViewModel | None,
    catalogue: Catalogue | None = None,
) -> ViewedPlace:
    """Return the place that parameters, a map and its voxels make up; without, walls stand."""
    world = parameters.world
    if voxels is None:
        walls = grid.cells >= world.occupied_threshold
        voxels = VoxelMap.extruded(grid, walls, world.wall_height, world.ground_height)
    return ViewedPlace(
        grid=grid,
        occupied_threshold=world.occupied_threshold,
        voxels=voxels,
        catalogue=catalogue if catalogue is not None else _catalogue(parameters),
        footprint=robot_footprint(parameters.robot),
        camera=camera,
        max_range_m=parameters.occlusion.max_range,
        ground_m=world.ground_height,
    )


def _catalogue(parameters: Parameters) -> Catalogue:
    """Return the catalogue of a recording, empty where its files are not at hand: boxes will do."""
    try:
        return catalogue_of(parameters)
    except AreError:
        return Catalogue(())


def view_recording(recording: Path, page: Path, say: Callable[[str], None]) -> None:
    """Write the page of a recording of the node's outputs, and say what it is. Raises AreError."""
    if not has_viser():
        raise BagError(MISSING_VISER)
    with ProgressBar("reading") as bar:
        place, thinner, problems = read_view(recording, bar.open)
    path = recording.resolve()
    title = path.parent.name if path.name == RECORDING else path.stem
    for sentence in (write_view(page, place, thinner, title).sentence(), *problems):
        say(sentence)


def read_view(
    path: Path, open_progress: OpenProgress
) -> tuple[ViewedPlace, TickThinner, tuple[str, ...]]:
    """Return what the viewer shows of a recording of the node's outputs, and what it lacks.

    `path` is as for `find_recording`. Raises BagError where there is no recording, or no ground
    truth or no map in it, ParameterError for a bad effective.yaml.
    """
    found = find_recording(path)
    parameters = Parameters()
    if found.parameters is not None:
        parameters = with_file(parameters, found.parameters)
    thinner = TickThinner()
    with BagReader([found.path]) as reader:
        role_of_topic = _roles_of(reader)
        roles = set(role_of_topic.values())
        feed = ViewFeed(
            parameters,
            thinner.add,
            thinner.wants_next,
            has_camera_info="camera/camera_info" in roles,
        )
        progress = open_progress(reader.start_ns, reader.end_ns)
        for message in reader.messages(tuple(role_of_topic)):
            _hand_over(feed, reader, role_of_topic[message.topic], message)
            progress(message.log_time_ns)
        progress(reader.end_ns)
    feed.finish()
    place = feed.place()
    if not thinner.ticks:
        raise BagError(f"{path}: it holds no {PREFIX}artefacts, so there is nothing to show")
    if place is None:
        raise BagError(f"{path}: it holds no map, neither /map nor {PREFIX}{_AUGMENTED}")
    said = [feed.problem] if feed.problem else []
    if all(tick.map_from_base is None for tick in thinner.ticks):
        could_tell = {"tf", "tf_static", "odom"} & roles
        said.append(without_robot(feed.robot_problem() if could_tell else ""))
    return place, thinner, tuple(said)


def _hand_over(feed: ViewFeed, reader: BagReader, role: str, message: BagMessage) -> None:
    if role in {"tf", "tf_static"}:
        feed.take_transforms(reader.transforms(message), is_static=role == "tf_static")
    elif role == "odom":
        feed.take_odometry(reader.odometry(message))
    elif role == _SCAN:
        is_output = message.topic.startswith(PREFIX)
        feed.take_scan(reader.deserialize(message), is_output=is_output)
    else:
        feed.take(role, reader.deserialize(message))


def _roles_of(reader: BagReader) -> dict[str, str]:
    """Return the role of each topic that is read."""
    roles = find_roles(reader.topics, {})
    found = {role: roles.topic(role) for role in (*_ROLES, _CLOUD)}
    chosen = {topic: role for role, topic in found.items() if topic and PREFIX not in topic}
    outputs = ["artefacts", "perceived", *([] if "map" in chosen.values() else [_AUGMENTED])]
    names = {topic.name for topic in reader.topics}
    scans = {topic.name: _SCAN for topic in reader.topics if topic.type_name == _SCAN}
    return chosen | scans | {PREFIX + name: name for name in outputs if PREFIX + name in names}
