"""The readings of all sensors: each topic has its path, and meets the artefacts of its time."""

import math
from functools import partial
from operator import attrgetter
from typing import Any

from are_ros.agents.robots import RobotTracker
from are_ros.builder.occlusion.meshes import MeshBank
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.population_manager import PopulationManager
from are_ros.builder.sensors.colour_image import ColourImage, Studio
from are_ros.builder.sensors.depth_image import DepthImage
from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.builder.sensors.sensor_path import (
    Problem,
    Reading,
    ReleasedReading,
    SensorPath,
    SensorPathCounts,
)
from are_ros.builder.tick import tick_period_ns
from are_ros.conventions import seconds_to_ns
from are_ros.parameters.choices import SensorGate
from are_ros.parameters.model import Parameters
from are_ros.world.environment import Environment
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.transforms.tree import FrameTree


class SensorAugmentation:
    """Augments each reading with the artefacts present at its stamp; each topic has its own path.

    In all outputs, an artefact is visible from the first tick that is not before its arrival.
    `perceived` are the ids that `sensors.gate: perceived` admits.
    """

    def __init__(
        self,
        parameters: Parameters,
        frames: FrameTree,
        robots: RobotTracker,
        lives: PopulationManager,
        meshes: MeshBank,
    ) -> None:
        self.perceived: frozenset[int] = frozenset()
        self._settings = parameters.sensors
        self._history_ns = seconds_to_ns(parameters.poses.history)
        self._tick_ns = tick_period_ns(parameters.builder.tick_rate)
        self._map_frame = parameters.frames.map
        self._odometry_frame = partial(robots.odometry_frame, parameters.frames.odom)
        self._frames = frames
        self._lives = lives
        self._meshes = meshes
        self._paths: dict[str, SensorPath] = {}
        self._lens_topics: dict[str, str] = {}
        self._depth_topics: set[str] = set()
        self._lenses: dict[str, Any] = {}
        self._studio = Studio(parameters.rendering, parameters.seed)

    def reconfigure(self, parameters: Parameters) -> None:
        """Use other settings from now on; a new wait applies to later readings."""
        settings = self._settings = parameters.sensors
        self._studio.settings = parameters.rendering
        for path in self._paths.values():
            path.wait_ns = seconds_to_ns(settings.tf_wait)

    def reseed(self, seed: int) -> None:
        """Draw what is painted from another seed; see `Studio.reseed`."""
        self._studio.reseed(seed)

    def prepare(self, environment: Environment) -> None:
        """Compute the surface of an environment, if there are sensors."""
        if self._paths:
            VoxelField.of(environment.voxels)

    def await_lens(self, topic: str, lens_topic: str, *, is_depth: bool = False) -> None:
        """Let the images of a topic wait for the first CameraInfo, which comes on another topic."""
        self._studio.expects_depth |= is_depth
        self._lens_topics[topic] = lens_topic
        if is_depth:
            self._depth_topics.add(topic)

    def receive_lens(self, topic: str, lens: Any, received_ns: int) -> None:
        """Use a lens for the images of a topic that are released from now on.

        Its rays are computed now: the first artefact in an image shall not hold it up.
        """
        if topic not in self._depth_topics and self._lenses.get(topic) is not lens:
            self._studio.painter(lens).prepare()
        self._lenses[topic] = lens
        if topic in self._paths:
            self._paths[topic].lens = lens
            self._paths[topic].transforms_came(received_ns)

    def push(self, topic: str, reading: Reading, received_ns: int) -> None:
        """Take a reading; topics do not wait for each other."""
        if topic not in self._paths:
            self._paths[topic] = path = SensorPath(
                self._frames,
                self._map_frame,
                self._odometry_frame,
                seconds_to_ns(self._settings.tf_wait),
                self._history_ns,
                self._augmented,
                self._lens_topics.get(topic, ""),
                self._lacks_depth,
            )
            path.lens = self._lenses.get(topic)
        self._paths[topic].push(topic, reading, received_ns)
        if isinstance(reading, DepthImage):
            lens = self._paths[topic].lens
            self._studio.keep_depth(reading if lens is None else reading.seen_through(lens))
            self.transforms_came(received_ns)

    def _lacks_depth(self, reading: Reading) -> bool:
        """Say whether an image waits for the depth image of its time."""
        return isinstance(reading, ColourImage) and self._studio.lacks_depth(reading)

    def transforms_came(self, now_ns: int) -> None:
        """Release the readings whose transform has become known."""
        for path in self._paths.values():
            path.transforms_came(now_ns)

    def next_deadline_ns(self) -> int | None:
        """Return the next deadline of a reading [ns], None if none waits."""
        deadlines = [path.next_deadline_ns() for path in self._paths.values()]
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def deadline_passed(self, now_ns: int) -> None:
        """Release the readings whose deadline is not after `now_ns`."""
        for path in self._paths.values():
            path.deadline_passed(now_ns)

    def take(self) -> list[ReleasedReading]:
        """Return what was released since the last call, in the order of release."""
        released = [one for path in self._paths.values() for one in path.take()]
        return sorted(released, key=attrgetter("released_ns")) if len(self._paths) > 1 else released

    def flush(self, now_ns: int) -> None:
        """Release all that still waits: the input has ended."""
        for path in self._paths.values():
            path.flush(now_ns)

    def clear(self) -> None:
        """Drop the waiting readings: the clock jumped back."""
        self._studio.forget()
        for path in self._paths.values():
            path.clear()

    def counts(self) -> dict[str, SensorPathCounts]:
        """Return, by topic, how many readings were released in which way."""
        return {topic: path.counts for topic, path in self._paths.items()}

    def problems(self) -> dict[str, str]:
        """Return, by topic, why the last reading passed through unaugmented."""
        return {
            topic: path.last_problem for topic, path in self._paths.items() if path.last_problem
        }

    def usual_problems(self) -> dict[str, Problem]:
        """Return, by topic, why most of the readings passed through that did."""
        paths = self._paths.items()
        return {topic: path.usual_problem for topic, path in paths if path.last_problem}

    @property
    def doubt_about_depth(self) -> str:
        """See `Studio.doubt_about_depth`."""
        return self._studio.doubt_about_depth

    def late_ns(self) -> dict[str, int]:
        """Return, by topic, how late the transforms were for which readings did not wait [ns]."""
        return {topic: path.late_ns for topic, path in self._paths.items()}

    def _augmented(self, reading: Reading, map_from_sensor: RigidTransform) -> Any:
        last_tick_ns = reading.stamp_ns // self._tick_ns * self._tick_ns
        scene = self._lives.scene_at(reading.stamp_ns, arrived_by_ns=last_tick_ns)
        if self._settings.gate is SensorGate.PERCEIVED:
            scene = scene.only(self.perceived)
        if not len(scene):
            if isinstance(reading, ColourImage):
                return reading.with_nobody(map_from_sensor)
            return reading
        shapes = self._meshes.shapes(scene.rows, self._settings.shape)
        environment = self._lives.environment
        surface = VoxelField.of(environment.voxels) if environment else None
        farthest_m = self._settings.depth_range or math.inf
        obstacles = Obstacles(scene.boxes, shapes, surface, farthest_m, scene, self._studio)
        return reading.augmented(map_from_sensor, obstacles)
