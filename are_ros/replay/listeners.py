"""Listeners of a replay: they write the recording, keep the record, and check the map."""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.robots import TOO_OLD
from are_ros.bag.reader import BagMessage, BagReader
from are_ros.bag.recording import PREFIX
from are_ros.bag.roles import OCTOMAP, ROLE_TYPES
from are_ros.bag.types import OCTOMAP_TYPE, ros2_type
from are_ros.bag.writer import BagWriter
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.builder.sensors.point_cloud import PointCloud
from are_ros.builder.sensors.sensor_path import ReleasedReading
from are_ros.builder.tick import USUAL, Demand, Tick
from are_ros.conventions import NS_PER_S
from are_ros.draw.scene import ScanPoints, scan_points
from are_ros.errors import AreError
from are_ros.messages.common import read_header
from are_ros.messages.maps import Points, encode_grid, read_voxels
from are_ros.messages.sensors import SensorOutputs, encode_cloud
from are_ros.messages.tick_encoding import TickEncoder, offered_outputs
from are_ros.messages.transforms import StampedTransform, encode_transforms_cdr
from are_ros.parameters.choices import Region
from are_ros.parameters.model import Parameters
from are_ros.replay.runner import Listener
from are_ros.replay.scene_record import SceneRecorder
from are_ros.wording import percent
from are_ros.world.cameras import CameraAt
from are_ros.world.environment import Environment
from are_ros.world.occupancy_grid import OccupancyGrid, distances_in_cells
from are_ros.world.scan_matching import NEAR_M


# The outputs of the builder, under their live names.
class TickWriter(Listener):
    """Encodes ticks and released readings, and appends them."""

    def __init__(
        self,
        writer: BagWriter,
        roles: Mapping[str, str],
        parameters: Parameters,
        demand: Demand = USUAL,
    ) -> None:
        """Announce the output topics; `roles` are those of the input topics."""
        self._writer = writer
        self._encoder = TickEncoder(demand, with_boxes=parameters.sensors.boxes)
        self._sensors = SensorOutputs(roles, parameters.sensors)
        for name, output in offered_outputs(parameters, demand).items():
            writer.add_topic(
                PREFIX + name, output.type_name, is_latched=output.is_latched, depth=output.depth
            )
        for name, type_name in self._sensors.types.items():
            writer.add_topic(PREFIX + name, type_name)

    def take_tick(self, tick: Tick) -> None:
        """Append the outputs of a tick, at its time."""
        for name, stamp_ns, data in self._encoder.encode(tick):
            self._writer.write_raw(PREFIX + name, stamp_ns, data)

    def take_readings(self, readings: Sequence[ReleasedReading]) -> None:
        """Append sensor readings, each at its release time."""
        for released in readings:
            for name, data in self._sensors.messages(released):
                self._writer.write_raw(PREFIX + name, released.released_ns, data)


# The inputs of a replay, with `--with-inputs`.


_LATCHED_ROLES = ("map", OCTOMAP, "tf_static")


class InputCopy(Listener):
    """Writes the messages that the replay read under their own topics, as ROS 2 messages.

    An octree is written as octomap_server's other topic, the centres of its voxels.
    """

    def __init__(self, reader: BagReader, writer: BagWriter, roles: Mapping[str, str]) -> None:
        """Announce the topics; `roles` maps each topic that is read to its role."""
        self._reader = reader
        self._writer = writer
        self._types: dict[str, str] = {}
        for topic in reader.topics:
            role = roles.get(topic.name)
            serves = role is not None and topic.type_name in ROLE_TYPES.get(
                role, (topic.type_name,)
            )
            if serves and topic.name not in self._types:
                type_name = ros2_type(topic.type_name)
                self._types[topic.name] = type_name
                if type_name == OCTOMAP_TYPE:
                    continue  # few programs read it: the voxels are written as their centres
                is_latched = roles[topic.name] in _LATCHED_ROLES
                writer.add_topic(topic.name, type_name, is_latched=is_latched, depth=100)

    def take_input(self, message: BagMessage, received_ns: int) -> None:
        """Append one input; one of another type than its topic's is left out."""
        if self._types.get(message.topic) != ros2_type(message.connection.msgtype):
            return
        if self._types[message.topic] == OCTOMAP_TYPE:
            self._write_octomap(message, received_ns)
            return
        if not self._reader.is_ros1:
            self._writer.write_raw(message.topic, received_ns, message.data)
            return
        try:
            data = self._reader.as_ros2(message)
        except AreError:
            return
        self._writer.write_raw(message.topic, received_ns, data)

    def _write_octomap(self, message: BagMessage, received_ns: int) -> None:
        """Append the voxels of an octree as their centres; a malformed one is left out."""
        try:
            octree = self._reader.deserialize(message)
            centres_m, _ = read_voxels(octree, message.topic)
            frame_id, stamp_ns = read_header(octree, message.topic)
        except AreError:
            return
        self.write_cloud(centres_m, frame_id, received_ns, stamp_ns)

    def write_map(self, topic: str, grid: OccupancyGrid, now_ns: int) -> None:
        """Append the map that came from a file, once."""
        self._write_latched(topic, "nav_msgs/msg/OccupancyGrid", 1, now_ns, encode_grid(grid))

    def write_cloud(
        self, centres_m: Points, frame_id: str, now_ns: int, stamp_ns: int | None = None
    ) -> None:
        """Append voxels (N, 3) [m]; their stamp is the present time unless given."""
        topic, kind = f"/{OCTOMAP}", "sensor_msgs/msg/PointCloud2"
        data = encode_cloud(
            PointCloud.of_points(frame_id, now_ns if stamp_ns is None else stamp_ns, centres_m)
        )
        self._write_latched(topic, kind, 1, now_ns, data)

    def write_static(self, transforms: list[StampedTransform], now_ns: int) -> None:
        """Append the static transforms that were given as parameters."""
        data = encode_transforms_cdr(transforms)
        self._write_latched("/tf_static", "tf2_msgs/msg/TFMessage", 100, now_ns, data)

    def _write_latched(
        self, topic: str, type_name: str, depth: int, now_ns: int, data: bytes
    ) -> None:
        """Append a message to a latched topic, which is added unless it is one of the inputs."""
        if topic not in self._types:
            self._types[topic] = type_name
            self._writer.add_topic(topic, type_name, is_latched=True, depth=depth)
        self._writer.write_raw(topic, now_ns, data)


SHARE: Final = 0.1
"""No doubt is reported while at most this share of the ticks gives reason to."""


class RecordKeeper(Listener):
    """Keeps the record for pictures, viewer and metrics.

    `first_ns` is the time of the first tick, `camera_since_ns` that of the first one that knew the
    camera, `map_since_ns` that of the first one that knew a map; None before it. Of all `ticks`,
    the robot's pose was too old at `old_ticks`; `oldest_ns` is how old it was at most.
    """

    def __init__(self, recorder: SceneRecorder, builder: ArBuilder) -> None:
        self.first_ns: int | None = None
        self.camera_since_ns: int | None = None
        self.map_since_ns: int | None = None
        self.ticks = self.old_ticks = self.oldest_ns = 0
        self._recorder = recorder
        self._builder = builder
        self._scans: dict[str, ReleasedReading] = {}

    def take_tick(self, tick: Tick) -> None:
        """Keep a tick, with the camera that it looked through and the newest scan of each topic."""
        if self.first_ns is None:
            self.first_ns = tick.stamp_ns
        if self.camera_since_ns is None and self._builder.camera is not None:
            self.camera_since_ns = tick.stamp_ns
        if self.map_since_ns is None and self._builder.world.grid is not None:
            self.map_since_ns = tick.stamp_ns
        self.ticks += 1
        if tick.map_from_base is None:
            self._count_old(tick.stamp_ns)
        scans: list[ScanPoints] = []
        if self._recorder.wants_scans:
            scans = [*filter(None, map(self._placed, self._scans.values()))]
            self._scans.clear()
        self._recorder.add(tick, self._builder.camera, scans, self._others(tick.stamp_ns))

    def _count_old(self, stamp_ns: int) -> None:
        """Count a tick without the robot's pose if there is one that is too old."""
        robots, map_frame = self._builder.robots, self._builder.parameters.frames.map
        if robots.missing.endswith(TOO_OLD):
            known_ns = self._builder.frames.latest_before(map_frame, robots.base_frame(), stamp_ns)
            self.old_ticks += 1
            self.oldest_ns = max(self.oldest_ns, stamp_ns - known_ns)

    def _others(self, stamp_ns: int) -> list[CameraAt]:
        """Return the cameras after the first whose pose is known."""
        if not self._builder.demand.perception:
            return []
        return [camera for camera in self._builder.cameras_at(stamp_ns) if camera.number]

    def take_readings(self, readings: Sequence[ReleasedReading]) -> None:
        """Remember laser scans until the next tick that is shown."""
        scans = (one for one in readings if isinstance(one.reading, LaserScan))
        self._scans |= {released.topic: released for released in scans}

    def _placed(self, released: ReleasedReading) -> ScanPoints | None:
        scan, frames = released.reading, self._builder.frames
        map_frame = self._builder.parameters.frames.map
        pose = frames.try_lookup(map_frame, scan.frame_id, scan.stamp_ns)
        return None if pose is None else scan_points(scan, released.received, pose)


# The scans of a recording must end on walls of the map, and its robot stand on free cells: else the
# map does not belong to it.


_SCAN_PERIOD_NS: Final = NS_PER_S
"""Of each laser one scan in this time is looked at."""
_MOST_SCANS: Final = 1000
_FEWEST_POINTS: Final = 500
_LEVEL: Final = 0.995
"""The least z component of the axis of a laser that is level."""
_NO_FIT_SHARE: Final = 0.5
_SHIFTS_M: Final = (1.0, 2.5)
_SHIFT_ANGLES_RAD: Final = np.arange(8) * math.pi / 4.0 + 0.2


class ScanFit:
    """Keeps where level scans end, and compares with the walls of the last map.

    Scans that fit do so at their place only. Where they end on walls no more often than a metre or
    two beside it, they have nothing to do with the map.
    """

    def __init__(self, builder: ArBuilder) -> None:
        self._builder = builder
        self._last_ns: dict[str, int] = {}
        self._ends_m: list[npt.NDArray[np.float32]] = []

    def take(self, readings: Sequence[ReleasedReading]) -> None:
        """Keep the ends of some scans in the map's frame, as they were received."""
        for released in readings:
            scan = released.received or released.reading
            if not isinstance(scan, LaserScan) or len(self._ends_m) >= _MOST_SCANS:
                continue
            last_ns = self._last_ns.get(released.topic)
            if last_ns is not None and 0 <= scan.stamp_ns - last_ns < _SCAN_PERIOD_NS:
                continue
            frames, map_frame = self._builder.frames, self._builder.parameters.frames.map
            pose = frames.try_lookup(map_frame, scan.frame_id, scan.stamp_ns)
            if pose is not None and abs(pose.rotation_matrix()[2, 2]) > _LEVEL:
                self._last_ns[released.topic] = scan.stamp_ns
                self._ends_m.append(pose.apply(scan.returns()[0])[:, :2].astype(np.float32))

    def doubts(self) -> list[str]:
        """Return half a sentence if the scans do not fit the map, else nothing."""
        environment = self._builder.world.environment
        ends_m = np.concatenate(self._ends_m) if self._ends_m else np.empty((0, 2))
        if environment is None or not environment.classes.occupied.any():
            return []
        is_near = _near_walls(environment)

        def share(shift_m: tuple[float, float]) -> float:
            """Return the share near walls of the ends that lie on the map; NaN of too few."""
            cells = environment.grid.points_to_cells(ends_m + shift_m)
            cells = cells[environment.grid.contains(cells)]
            if len(cells) < _FEWEST_POINTS:
                return math.nan
            return float(is_near[cells[:, 0], cells[:, 1]].mean())

        here = share((0.0, 0.0))
        if not here < _NO_FIT_SHARE:
            return []
        shifts = [(r * math.cos(a), r * math.sin(a)) for r in _SHIFTS_M for a in _SHIFT_ANGLES_RAD]
        beside = [share(shift_m) for shift_m in shifts]
        if not here <= 1.5 * float(np.nanmedian([here, *beside])):
            return []
        return [f"only {percent(here)} of what the scans measured on the map is where it has walls"]


def _near_walls(environment: Environment) -> npt.NDArray[np.bool_]:
    """Return which cells are within `NEAR_M` of an occupied one, bool (height, width)."""
    away = distances_in_cells(~environment.classes.occupied)
    near: npt.NDArray[np.bool_] = away <= NEAR_M / environment.grid.resolution_m + 1.0
    return near


_LEAST_AREA_M2: Final = 3.0
"""A robot needs about this area to turn on the spot; a smaller region cannot be right."""


_MOST_ABOVE_M: Final = 1.5
"""The base of a robot is not so far above or below the ground that it drives on."""


class StandingWatch(Listener):
    """Looks at each tick whether the cell of the robot's base is free, and where scans end.

    And how high the base is above the ground.
    """

    def __init__(self, builder: ArBuilder) -> None:
        self._builder = builder
        self._scans = ScanFit(builder)
        self._ticks = 0
        self._outside_m: list[tuple[float, float]] = []
        self._aloft_m: list[float] = []
        self._area_m2 = 0.0

    def take_tick(self, tick: Tick) -> None:
        """Check the cell under the robot, once there are a map and a pose."""
        environment = self._builder.world.environment
        if environment is None or tick.map_from_base is None:
            return
        x_m, y_m, z_m = tick.map_from_base.translation_m.tolist()
        self._ticks += 1
        above_m = z_m - float(environment.ground.heights(np.array([(x_m, y_m)]))[0])
        if abs(above_m) > _MOST_ABOVE_M:
            self._aloft_m.append(above_m)
        self._area_m2 = max(self._area_m2, tick.metrics.area_m2)
        if not _is_free(environment, (x_m, y_m)):
            self._outside_m.append((x_m, y_m))

    def take_readings(self, readings: Sequence[ReleasedReading]) -> None:
        """Keep where scans end."""
        self._scans.take(readings)

    def sentences(self) -> list[str]:
        """Return a sentence if robot and map do not agree."""
        doubts = self._scans.doubts()
        outside = self._outside()
        if outside > SHARE * self._ticks:
            doubts.append(
                "the robot stood on occupied or unknown cells, or beyond the map, "
                f"in {outside} of {self._ticks} ticks"
            )
        if len(self._aloft_m) > SHARE * self._ticks:
            doubts.append(
                f"the robot's base was {float(np.median(self._aloft_m)):.1f} m above the ground on "
                f"which artefacts stand (world.ground_height) in {len(self._aloft_m)} of "
                f"{self._ticks} ticks"
            )
        population = self._builder.parameters.population
        is_small = self._ticks and self._area_m2 < _LEAST_AREA_M2
        if is_small and population.region is Region.REACHABLE:
            but = ", without no_spawn of population.zones" if population.zones else ""
            doubts.append(f"the robot can reach {self._area_m2:.1f} m^2 of the map at most{but}")
        question = "does the map belong to the recording, and is its frame right?"
        return [f"{', and '.join(doubts)}: {question}{self._undecided()}"] if doubts else []

    def _undecided(self) -> str:
        """Say if many cells of the last map are neither free nor occupied, for its thresholds."""
        last, settings = self._builder.world.environment, self._builder.parameters.world
        if last is None:
            return ""
        known = last.grid.cells >= 0
        between = known & ~last.classes.free & ~last.classes.occupied
        share = float(between.sum()) / max(int(known.sum()), 1)
        if share <= SHARE:
            return ""
        return (
            f" {percent(share)} of its known cells are neither free, up to world.free_threshold "
            f"({settings.free_threshold}), nor occupied, from world.occupied_threshold "
            f"({settings.occupied_threshold}) on: --set world.free_threshold:=N takes more as free"
        )

    def _outside(self) -> int:
        """Return the number of ticks on cells that were not free, then and in the last map.

        While a map is being made, the cells under the robot may become known later.
        """
        last = self._builder.world.environment
        return 0 if last is None else sum(not _is_free(last, at_m) for at_m in self._outside_m)


def _is_free(environment: Environment, at_m: tuple[float, float]) -> bool:
    cell = environment.grid.cell_at(*at_m)
    return cell is not None and bool(environment.classes.free[cell])
