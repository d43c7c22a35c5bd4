"""The augmented laser scans: one sensor path per topic, and what their beams may meet."""

from operator import attrgetter

from are_ros.builder.augmented_scan import augment_scan
from are_ros.builder.lives import Lives
from are_ros.builder.mesh_bank import MeshBank
from are_ros.builder.ray_casting import VoxelField
from are_ros.builder.schedule import tick_period_ns
from are_ros.builder.sensor_path import ReleasedScan, SensorPath, SensorPathCounts
from are_ros.conventions import seconds_to_ns
from are_ros.parameters.choices import SensorGate, Shape
from are_ros.parameters.model import Parameters, SensorsParameters
from are_ros.world.environment import Environment
from are_ros.world.frame_tree import FrameTree
from are_ros.world.laser_scan import LaserScan
from are_ros.world.rigid_transform import RigidTransform


class ScanAugmentation:
    """Augments each scan at its own stamp with the artefacts that were there at that stamp.

    Of these, with those that a tick could have shown by then: an artefact is visible from the first
    tick not before its arrival, in all outputs alike. `perceived` are the ids that `sensors.gate:
    perceived` lets through.
    """

    def __init__(
        self, parameters: Parameters, frames: FrameTree, lives: Lives, meshes: MeshBank
    ) -> None:
        self.perceived: frozenset[int] = frozenset()
        self._settings = parameters.sensors
        self._history_ns = seconds_to_ns(parameters.poses.history)
        self._tick_ns = tick_period_ns(parameters.builder.tick_rate)
        self._frame_names = parameters.frames
        self._frames = frames
        self._lives = lives
        self._meshes = meshes
        self._paths: dict[str, SensorPath] = {}

    def reconfigure(self, settings: SensorsParameters) -> None:
        """Let other settings hold from now on, the wait also for the next scans of known topics."""
        self._settings = settings
        for path in self._paths.values():
            path.wait_ns = seconds_to_ns(settings.tf_wait)

    def prepare(self, environment: Environment) -> None:
        """Make an environment ready to be scanned, if scans come."""
        if self._paths:
            VoxelField.of(environment.voxels)

    def push(self, topic: str, scan: LaserScan, received_ns: int) -> None:
        """Take a scan in; topics do not wait for each other."""
        if topic not in self._paths:
            self._paths[topic] = SensorPath(
                self._frames,
                self._frame_names.map,
                self._frame_names.odom,
                seconds_to_ns(self._settings.tf_wait),
                self._history_ns,
                self._augmented,
            )
        self._paths[topic].push(topic, scan, received_ns)

    def transforms_came(self, now_ns: int) -> None:
        """Release the scans whose transform has become known."""
        for path in self._paths.values():
            path.transforms_came(now_ns)

    def next_deadline_ns(self) -> int | None:
        """Return when the next scan must leave, None if none waits."""
        deadlines = [path.next_deadline_ns() for path in self._paths.values()]
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def deadline_passed(self, now_ns: int) -> None:
        """Release the scans whose deadline is not after `now_ns`."""
        for path in self._paths.values():
            path.deadline_passed(now_ns)

    def take(self) -> list[ReleasedScan]:
        """Return what was released since the last call, in the order of release."""
        released = [scan for path in self._paths.values() for scan in path.take()]
        return sorted(released, key=attrgetter("released_ns")) if len(self._paths) > 1 else released

    def flush(self, now_ns: int) -> None:
        """Release all that still waits: the input has ended."""
        for path in self._paths.values():
            path.flush(now_ns)

    def clear(self) -> None:
        """Drop what waits: the clock jumped back."""
        for path in self._paths.values():
            path.clear()

    def counts(self) -> dict[str, SensorPathCounts]:
        """Return how the scans of each topic left."""
        return {topic: path.counts for topic, path in self._paths.items()}

    def problems(self) -> dict[str, str]:
        """Return, by topic, why the last scan that passed through unaugmented did."""
        return {
            topic: path.last_problem for topic, path in self._paths.items() if path.last_problem
        }

    def late_ns(self) -> dict[str, int]:
        """Return, by topic, how late the transforms were for which scans did not wait [ns]."""
        return {topic: path.late_ns for topic, path in self._paths.items()}

    def _augmented(self, scan: LaserScan, map_from_laser: RigidTransform) -> LaserScan:
        last_tick_ns = scan.stamp_ns // self._tick_ns * self._tick_ns
        scene = self._lives.scene_at(scan.stamp_ns, arrived_by_ns=last_tick_ns)
        if self._settings.gate is SensorGate.PERCEIVED:
            scene = scene.only(self.perceived)
        if not len(scene):
            return scan
        shapes = self._meshes.selection(scene.rows) if self._settings.shape is Shape.MESH else None
        environment = self._lives.environment
        surface = VoxelField.of(environment.voxels) if environment else None
        return augment_scan(scan, map_from_laser, scene.boxes, shapes, surface)
