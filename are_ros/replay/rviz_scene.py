"""What rviz would show of a recording at one moment: each display with what it was given so far."""

from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.checks.oracle import Outline
from are_ros.conventions import NS_PER_S
from are_ros.errors import InputError
from are_ros.messages.cloud import read_points
from are_ros.messages.headers import read_header
from are_ros.messages.scan import read_scan
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import with_file
from are_ros.replay._check_marker_decoding import MarkerFields
from are_ros.replay._check_paths import find_recording
from are_ros.replay.bag_reader import BagMessage, BagReader
from are_ros.replay.rviz_frames import RvizFrames
from are_ros.replay.rviz_grids import MapDisplay
from are_ros.replay.rviz_markers import MarkerDisplay
from are_ros.replay.rviz_topics import ShownTopics, moment_ns
from are_ros.replay.rviz_voxels import standing_part
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]

_TF_MEMORY_NS: Final = 60 * NS_PER_S
_SCANS_KEPT: Final = 30


@dataclass(frozen=True, eq=False)
class PlacedMarker:
    """A marker on display, with its pose in the fixed frame."""

    fields: MarkerFields
    fixed_from_marker: RigidTransform


@dataclass(frozen=True, eq=False)
class RvizScene:
    """The displays at `now_ns`, all in the fixed frame, in metres.

    `grid` and `costmap` come with fixed_from_grid; `scans` are topic and points (N, 3); `axes` the
    frames' poses by name; `outline_m` (K, 2) that of the robot in its base, None where it is not
    known. `complaints` are what rviz would say in its status.
    """

    now_ns: int
    elapsed_s: float
    fixed_frame: str
    base_frame: str
    topics: ShownTopics
    grid: tuple[OccupancyGrid, RigidTransform] | None
    costmap: tuple[OccupancyGrid, RigidTransform] | None
    markers: tuple[PlacedMarker, ...]
    scans: tuple[tuple[str, Floats], ...]
    axes: dict[str, RigidTransform]
    outline_m: Floats | None
    complaints: tuple[str, ...]
    voxels: VoxelMap | None = None
    """What is drawn of the octomap, in the fixed frame; None where there is none."""
    robot_problem: str = ""
    """Why the robot's pose is not known; empty where it is, or where nothing could tell it."""

    @property
    def robot(self) -> RigidTransform | None:
        """The pose of the robot's base, None where it is not known."""
        return self.axes.get(self.base_frame)


def read_scene(path: Path, at_s: float | None = None) -> RvizScene:
    """Return what rviz would show, `at_s` seconds after the beginning of a recording.

    With None at the moment when most artefacts are perceived near the camera. `path` is as for
    `find_recording`; the fixed frame is `frames.map` of an effective.yaml beside it, else the
    map's. BagError where there is no recording, ParameterError for a bad effective.yaml.
    """
    found = find_recording(path)
    parameters = _read_parameters(found.parameters)
    with BagReader([found.path]) as reader:
        topics = ShownTopics.of(reader.topics)
        now_ns = moment_ns(reader, topics, at_s)
        displays = _Displays(reader, topics, now_ns, parameters)
        return displays.scene(parameters)


def _read_parameters(path: Path | None) -> Parameters | None:
    return None if path is None else with_file(Parameters(), path)


class _Displays:
    """The displays, fed with all messages up to a time."""

    def __init__(
        self, reader: BagReader, topics: ShownTopics, now_ns: int, parameters: Parameters | None
    ) -> None:
        self._reader = reader
        self._topics = topics
        self._now_ns = now_ns
        self._frames = RvizFrames(parameters)
        self._grids: dict[str, list[BagMessage]] = {}
        self._markers = {topic: MarkerDisplay() for topic in topics.markers}
        self._scans = {topic: deque[BagMessage](maxlen=_SCANS_KEPT) for topic in topics.scans}
        self._cloud: BagMessage | None = None
        self._complaints: list[str] = []
        for message in reader.messages(topics.all(), stop_ns=now_ns + 1):
            self._take(message)

    def scene(self, parameters: Parameters | None) -> RvizScene:
        """Return everything as it is now."""
        grid = self._map(self._topics.grid)
        fixed = parameters.frames.map if parameters else grid.frame_id if grid else "map"
        costmap = self._map(self._topics.costmap)
        axes = self._frames.axes(fixed)
        markers = self._placed_markers(fixed)
        base = self._frames.base()
        problem = "" if base in axes else self._frames.why_unknown(fixed, base)
        return RvizScene(
            now_ns=self._now_ns,
            elapsed_s=(self._now_ns - self._reader.start_ns) / NS_PER_S,
            fixed_frame=fixed,
            base_frame=base,
            topics=self._topics,
            grid=self._placed_grid(fixed, grid),
            costmap=self._placed_grid(fixed, costmap),
            markers=markers,
            scans=tuple((topic, self._scan_points(fixed, topic)) for topic in self._scans),
            axes=axes,
            outline_m=None if parameters is None else _outline(parameters),
            voxels=self._voxels(fixed, parameters or Parameters()),
            complaints=tuple(dict.fromkeys((*self._complaints, *self._frames.complaints))),
            robot_problem=problem if self._topics.tell_poses else "",
        )

    def _take(self, message: BagMessage) -> None:
        topic = message.topic
        if topic in self._markers:
            self._markers[topic].take(message.log_time_ns, bytes(message.data))
        elif topic in self._scans:
            self._scans[topic].append(message)
        elif topic in ("/tf", "/tf_static"):
            self._take_transforms(message)
        elif topic == self._topics.odometry:
            self._take_odometry(message)
        elif topic == self._topics.cloud:
            self._cloud = message
        elif topic.endswith("_updates"):
            self._grids.setdefault(topic.removesuffix("_updates"), []).append(message)
        else:
            self._grids[topic] = [message]  # a whole grid: nothing before it matters

    def _take_transforms(self, message: BagMessage) -> None:
        is_static = message.topic == "/tf_static"
        if not is_static and message.log_time_ns < self._now_ns - _TF_MEMORY_NS:
            return
        self._frames.take(self._reader.transforms(message), is_static=is_static)

    def _take_odometry(self, message: BagMessage) -> None:
        if message.log_time_ns < self._now_ns - _TF_MEMORY_NS:
            return
        try:
            self._frames.take_odometry(self._reader.odometry(message))
        except InputError as error:
            self._complaints.append(str(error))

    def _map(self, topic: str | None) -> OccupancyGrid | None:
        display = MapDisplay()
        for message in self._grids.get(topic or "", ()):
            content = self._reader.deserialize(message)
            if message.topic.endswith("_updates"):
                display.take_update(content)
            else:
                display.take_grid(content)
        if display.complaint:
            self._complaints.append(display.complaint)
        return display.grid

    def _voxels(self, fixed: str, parameters: Parameters) -> VoxelMap | None:
        """Return what is drawn of the newest cloud of voxels whose place is known."""
        if self._cloud is None:
            return None
        try:
            message = self._reader.deserialize(self._cloud)
            points_m = read_points(message, self._cloud.topic)
            pose = self._frames.newest(fixed, read_header(message, self._cloud.topic).frame_id)
            if pose is None:
                return None
            wanted_m = parameters.world.voxel_size or None
            voxels = VoxelMap.from_centres(points_m, None, pose, self._cloud.topic, wanted_m)
        except InputError as error:
            self._complaints.append(str(error))
            return None
        return standing_part(voxels, parameters.world.ground_height)

    def _placed_grid(
        self, fixed: str, grid: OccupancyGrid | None
    ) -> tuple[OccupancyGrid, RigidTransform] | None:
        """Return a grid with fixed_from_grid, by the newest transform; None where there is none."""
        pose = None if grid is None else self._frames.newest(fixed, grid.frame_id)
        return None if grid is None or pose is None else (grid, pose @ grid.origin)

    def _placed_markers(self, fixed: str) -> tuple[PlacedMarker, ...]:
        placed = []
        for display in self._markers.values():
            self._complaints += display.complaints
            for marker in display.shown(self._now_ns):
                outer = self._marker_frame(fixed, marker)
                if outer is not None:
                    placed.append(PlacedMarker(marker, outer @ _pose_of(marker)))
        return tuple(placed)

    def _marker_frame(self, fixed: str, marker: MarkerFields) -> RigidTransform | None:
        """Return the pose of a marker's frame: at its stamp, or the newest if locked to it."""
        if marker.is_frame_locked or not marker.stamp_ns:
            return self._frames.newest(fixed, marker.frame_id)
        found = self._frames.at(fixed, marker.frame_id, marker.stamp_ns)
        if found is None:
            self._complaints.append(
                f"no transform from '{marker.frame_id}' to '{fixed}' at a marker's stamp"
            )
        return found

    def _scan_points(self, fixed: str, topic: str) -> Floats:
        """Return where the newest scan whose pose is known ended (N, 3); it decays at once."""
        for message in reversed(self._scans[topic]):
            try:
                scan = read_scan(self._reader.deserialize(message))
            except InputError as error:
                self._complaints.append(str(error))
                continue
            pose = self._frames.at(fixed, scan.frame_id, scan.stamp_ns)
            if pose is None:
                continue
            returned = (scan.ranges >= scan.range_min_m) & (scan.ranges <= scan.range_max_m)
            lengths = scan.ranges[returned].astype(np.float64)[:, np.newaxis]
            return pose.apply(scan.directions()[returned] * lengths)
        return np.zeros((0, 3))


def _pose_of(marker: MarkerFields) -> RigidTransform:
    """Return the pose; a rotation that is none turns nothing, as in rviz."""
    norm = float(np.linalg.norm(marker.rotation_xyzw))
    if not norm:
        return RigidTransform(marker.position.copy(), np.array((0.0, 0.0, 0.0, 1.0)))
    return RigidTransform(marker.position.copy(), marker.rotation_xyzw / norm)


def _outline(parameters: Parameters) -> Floats:
    """Return the robot's outline (K, 2) in its base, a disc as a polygon."""
    outline = Outline.of(parameters.robot.footprint, parameters.robot.radius)
    if len(outline.corners_m) > 1:
        return outline.corners_m
    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    circle: Floats = outline.radius_m * np.column_stack((np.cos(angles), np.sin(angles)))
    return circle
