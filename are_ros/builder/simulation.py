"""The inputs and the artefacts that live among them, in the order of time.

Each input is received through a method of `Simulation`, which first runs what is due before it.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder import assembly
from are_ros.builder.occlusion.meshes import MeshBank
from are_ros.builder.population_manager import PopulationManager
from are_ros.builder.real_world import RealWorld
from are_ros.builder.sensors.augmentation import SensorAugmentation
from are_ros.builder.sensors.lens import Lens
from are_ros.builder.sensors.sensor_path import Reading, ReleasedReading
from are_ros.conventions import NS_PER_S
from are_ros.errors import InputError, ParameterError
from are_ros.parameters.choices import CameraModel
from are_ros.parameters.model import Parameters
from are_ros.population.catalogue import Catalogue
from are_ros.population.departures import Cause
from are_ros.world.cameras import Camera, CameraAt
from are_ros.world.footprint import Footprint
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import Values
from are_ros.world.transforms.tree import FrameTree

_BEFORE_ALL_NS: Final = -(2**63)
_AFTER_ALL_NS: Final = 2**63 - 1
CLOCK_JITTER_NS: Final = NS_PER_S
"""An input that is out of order by at most this counts as received now: clocks are set back by
fractions of a second, while a recording that loops goes back further."""
_LEAP_NS: Final = 7200 * NS_PER_S
"""If the clock leaps ahead by more than this, the simulation restarts: to compute a day takes
seconds, years take hours."""


class Simulation:
    """Everything that happens between ticks: inputs, population, sensor readings.

    The `receive_...` methods take inputs in the order of their reception. Events that are due
    before an input are processed first, without it. Bad input raises InputError or FrameError and
    changes nothing.
    """

    def __init__(self, parameters: Parameters, catalogue: Catalogue) -> None:
        self.parameters = parameters
        self.catalogue = catalogue
        self.notices: list[str] = []
        self.frames = FrameTree()
        self.world = RealWorld(parameters.world, parameters.frames.map, self.frames, self.notices)
        self.robots = assembly.robot_tracker(parameters, self.frames)
        resolver = assembly.collision_resolver(parameters)
        self.lives = PopulationManager(parameters, catalogue, self.world, self.robots, resolver)
        self.cameras: list[Camera | None] = [None for _ in parameters.camera.rates]
        """The robot's camera, and those of `camera.others`; None: its CameraInfo has not come."""
        self.camera = assembly.default_camera(parameters)
        self._meshes = MeshBank()
        self.lives.viewpoints = self.cameras_at
        self.sensors = SensorAugmentation(
            parameters, self.frames, self.robots, self.lives, self._meshes
        )
        self.judges_until_ns = _AFTER_ALL_NS
        """Deadlines of readings after this are not processed yet; a node sets it."""
        self._now_ns = _BEFORE_ALL_NS
        self._idle_until_ns = _BEFORE_ALL_NS
        assembly.set_static_frames(parameters, self.frames)

    @property
    def camera(self) -> Camera | None:
        """The first camera of the robot, None before it is known."""
        return self.cameras[0]

    @camera.setter
    def camera(self, camera: Camera | None) -> None:
        self.cameras[0] = camera

    # ------------------------------------------------------------------------------ inputs

    def receive_map(self, grid: OccupancyGrid, received_ns: int) -> None:
        """Take the real map M2D, which must be in the map's frame."""
        self._received(received_ns)
        if grid.frame_id != self.parameters.frames.map:
            wanted = self.parameters.frames.map
            raise InputError(
                f"map: its frame is '{grid.frame_id}', but frames.map is '{wanted}': set that to "
                f"the map's frame (--set frames.map:={grid.frame_id}); but a map that moves with "
                "the robot (a local, rolling one) cannot be the real map"
            )
        self.world.set_grid(grid)

    def receive_cloud(
        self,
        centres_m: npt.NDArray[np.floating],
        frame_id: str,
        received_ns: int,
        voxel_size_m: float | None = None,
        stamp_ns: int | None = None,
    ) -> None:
        """Take the centres (N, 3) of M3D's occupied voxels, in any frame of the tree.

        The frame's pose is that at the stamp if it is known, else (stamp None or too long ago) the
        newest. If the frame is not known yet, the cloud waits for it.
        """
        self._received(received_ns)
        self.world.set_cloud(centres_m, voxel_size_m, frame_id, stamp_ns)

    def receive_transform(
        self,
        parent: str,
        child: str,
        stamp_ns: int,
        translation_m: Values,
        rotation_xyzw: Values,
        received_ns: int,
        *,
        is_static: bool = False,
    ) -> None:
        """Take one transform of /tf or /tf_static: the pose of the child in the parent.

        `translation_m` is x, y, z, `rotation_xyzw` a quaternion. Raises InvalidTransformError, and
        changes nothing, where a number is not finite, the quaternion's length is not 1, a name is
        empty or both are the same.
        """
        self._received(received_ns)
        if is_static:
            self.frames.set_static(parent, child, translation_m, rotation_xyzw)
        else:
            self.frames.set_transform(
                parent, child, stamp_ns, translation_m, rotation_xyzw, now_ns=received_ns
            )
        self.sensors.transforms_came(received_ns)

    def receive_odometry(
        self,
        parent: str,
        child: str,
        stamp_ns: int,
        translation_m: Values,
        rotation_xyzw: Values,
        received_ns: int,
    ) -> None:
        """Take a pose from odometry; an empty child frame means the robot's base."""
        self._received(received_ns)
        source = assembly.odometry_source(self.parameters)
        if source is None:
            return
        child = child or self.robots.base_frame()
        self.frames.set_transform(
            parent,
            child,
            stamp_ns,
            translation_m,
            rotation_xyzw,
            source=source,
            now_ns=received_ns,
        )
        self.sensors.transforms_came(received_ns)

    def receive_camera(self, camera: Camera, received_ns: int, number: int = 0) -> None:
        """Take the view model of a camera of the robot, from its CameraInfo.

        Number 0 is its own, the others are those of `camera.others`, counted from 1.
        """
        self._received(received_ns)
        is_first = number == 0
        chosen = assembly.chosen_camera(self.parameters, camera) if is_first else camera
        self.cameras[number] = chosen

    def receive_reading(self, topic: str, reading: Reading, received_ns: int) -> None:
        """Take a reading of a sensor; `take_readings` returns it, augmented."""
        self._received(received_ns)
        self.sensors.push(topic, reading, received_ns)
        self._idle_until_ns = received_ns

    def await_lens(self, topic: str, lens_topic: str, *, is_depth: bool = False) -> None:
        """Let the images of a topic wait for the CameraInfo that comes on another one."""
        self.sensors.await_lens(topic, lens_topic, is_depth=is_depth)

    def receive_lens(self, topic: str, lens: Lens, received_ns: int) -> None:
        """Take the lens of the images of a topic, from the CameraInfo beside them."""
        self._received(received_ns)
        self.sensors.receive_lens(topic, lens, received_ns)

    def receive_plan(
        self, points_m: npt.NDArray[np.floating], frame_id: str, received_ns: int
    ) -> None:
        """Take the path (N, 3) that the robot plans, in any frame of the tree; its end is the goal.

        No artefact arrives within the robot's clearance of the goal. An empty path means no goal.
        Raises FrameError if the frame's pose is not known, InputError if a number is not finite, or
        the shape is another.
        """
        self._received(received_ns)
        shape = np.shape(points_m)
        if len(points_m) and (len(shape) != 2 or shape[1] != 3):
            raise InputError(f"plan: points have the shape {shape}, not (N, 3)")
        if not np.isfinite(points_m).all():
            raise InputError("plan: it holds a position that is not finite")
        plan_m = np.empty((0, 3))
        if len(points_m):
            map_from_plan = self.frames.lookup_latest(self.parameters.frames.map, frame_id)
            plan_m = map_from_plan.apply(np.asarray(points_m, dtype=np.float64))
        self.lives.plan_m = plan_m[:, :2]
        radius_m = self.robots.observer.footprint.circumscribed_radius_m
        self.lives.goal = Footprint(plan_m[-1:, :2], radius_m) if len(plan_m) else None

    def take_readings(self) -> list[ReleasedReading]:
        """Return the readings released since the last call."""
        return self.sensors.take()

    def await_camera(self) -> None:
        """Perceive nothing before the first CameraInfo, unless the parameters give the camera."""
        if self.parameters.camera.model is CameraModel.AUTO:
            self.camera = None

    def use_default_camera(self) -> str:
        """Use the camera of the parameters until a CameraInfo comes; return a notice about it."""
        self.camera, camera = assembly.default_camera(self.parameters), self.parameters.camera
        return (
            f"a pinhole of {camera.width}x{camera.height} pixels on the base, "
            f"{camera.mount[2]:g} m up, stands in for it (parameters camera.*)"
        )

    # ------------------------------------------------------------------------------ time

    @property
    def doubt_about_region(self) -> str:
        """Where nobody can arrive at random though map and robot are known, and why; else empty."""
        is_known = self.world.has_free_cells and not self.robots.missing
        return self.lives.doubt_about_region if is_known else ""

    @property
    def has_begun(self) -> bool:
        """Whether there was an instant yet: before it nothing is due, and no time is known."""
        return self._now_ns != _BEFORE_ALL_NS

    def advance(self, now_ns: int) -> None:
        """Process what is due up to `now_ns`: arrivals, departures, sub-steps, readings."""
        if now_ns < self._idle_until_ns:
            if self._check_clock(now_ns) or not self.lives.may_be_due:
                return
            now_ns = self._now_ns
        if self.has_begun and now_ns > self._now_ns + _LEAP_NS:
            self._leap(now_ns)
        self._now_ns = max(self._now_ns, now_ns)
        while (deadline_ns := self.sensors.next_deadline_ns()) is not None:
            if deadline_ns > min(now_ns, self.judges_until_ns):
                break
            self.lives.advance(deadline_ns)
            self.sensors.deadline_passed(deadline_ns)
        self.lives.advance(now_ns)
        due_ns = self.lives.next_due_ns()
        self._idle_until_ns = due_ns if deadline_ns is None else min(due_ns, deadline_ns)

    def finish(self, now_ns: int) -> None:
        """Release the readings that still wait: the inputs have ended."""
        if self.has_begun:
            self.advance(now_ns)
        self.sensors.flush(now_ns)

    def next_deadline_ns(self) -> int | None:
        """Return when the next reading that waits must leave, None if none waits."""
        return self.sensors.next_deadline_ns()

    def _check_clock(self, now_ns: int) -> bool:
        """Restart if the clock has jumped back, as it does when a recording loops; tell if so."""
        if now_ns >= self._now_ns - CLOCK_JITTER_NS:
            self._now_ns = max(self._now_ns, now_ns)
            return False
        self.notices.append(
            f"the clock jumped back by {(self._now_ns - now_ns) / NS_PER_S:.3f} s: "
            "all artefacts are gone, and later transforms and scans are forgotten"
        )
        self._now_ns = self._idle_until_ns = now_ns
        self.restart(now_ns)
        return True

    def _leap(self, now_ns: int) -> None:
        """Restart: the clock has leapt ahead, as it does when another recording begins."""
        self.notices.append(
            f"the clock leapt ahead by {(now_ns - self._now_ns) / NS_PER_S:.0f} s: "
            "all artefacts are gone"
        )
        self.restart(now_ns, Cause.CLOCK_LEAPT)

    def restart(self, now_ns: int, cause: Cause = Cause.CLOCK_JUMPED_BACK) -> None:
        """Remove all artefacts, and forget transforms later than `now_ns`: the clock jumped."""
        self.frames.forget_after(now_ns)
        self.robots.forget()
        self.lives.restart(now_ns, cause)
        self.sensors.clear()

    def reseed(self, seed: int, now_ns: int) -> None:
        """Draw from another seed from now on; artefacts alive stay.

        Raises ParameterError, and changes nothing, where the seed is negative.
        """
        if seed < 0:
            raise ParameterError(f"the seed {seed} is negative")
        self.advance(now_ns)
        self.lives.reseed(seed, now_ns)
        self.sensors.reseed(seed)

    def interrupt(self, from_ns: int, until_ns: int) -> None:
        """Skip [from_ns, until_ns), a gap of the recording.

        All artefacts are removed at its beginning. The robot's pose and all transforms that are not
        static are forgotten, as it may be anywhere. A scenario goes on afterwards.
        """
        self.finish(from_ns)
        self.frames.forget_after(_BEFORE_ALL_NS)
        self.robots.forget()
        self.lives.interrupt(from_ns, until_ns)
        self._now_ns = self._idle_until_ns = until_ns

    def stand_still(self, until_ns: int) -> float:
        """Go on at `until_ns`; artefacts stand still until then. Return for how long [s].

        For a machine that cannot keep up, and a clock that leaps: nothing of that time is
        simulated. A leap of hours is left to `advance`.
        """
        from_ns = self._now_ns
        if not from_ns < until_ns <= from_ns + _LEAP_NS:
            return 0.0
        self.lives.stand_still(from_ns, until_ns)
        self._now_ns = self._idle_until_ns = until_ns
        return (until_ns - from_ns) / NS_PER_S

    def _received(self, received_ns: int) -> None:
        """Process what is due before an input."""
        self.advance(received_ns)
        self.lives.touch(received_ns)

    def cameras_at(self, now_ns: int) -> list[CameraAt]:
        """Return the cameras at their poses, without those whose pose is not known."""
        found = []
        for number, camera in enumerate(self.cameras):
            if camera is None:
                continue
            pose = self.robots.map_from_camera(camera, now_ns)
            if pose is not None:
                found.append(CameraAt(number, camera.view, pose))
        return found
