"""What an observer perceives: A_f by the z-buffer of its camera (section 3.3); when it looks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from are_ros.agents.events import (
    ArtefactEvent,
    ArtefactState,
    EventKind,
    PerceivedArtefact,
    Sighting,
)
from are_ros.agents.robots import RobotTracker
from are_ros.builder.occlusion.kernels import Visibility
from are_ros.builder.occlusion.meshes import MeshBank
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.occlusion.zbuffer import ZBuffer
from are_ros.builder.scene import Scene
from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import Shape
from are_ros.parameters.model import OcclusionParameters
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import Camera, ViewModel
from are_ros.world.environment import Environment
from are_ros.world.rigid_transform import RigidTransform

_CERTAIN = (0.0,) * 36
"""A covariance of zeros."""


def joined(one: Sighting, other: Sighting) -> Sighting:
    """Return one sighting for two cameras: that of the camera which sees more pixels, then `one`'s.

    Both cameras are named.
    """
    first, second = (other, one) if other.visible_pixels > one.visible_pixels else (one, other)
    return replace(first, cameras=(*first.cameras, *second.cameras))


def _sighting(seen: Visibility, index: int, seen_ns: int, camera: Camera) -> Sighting:
    x, y, width, height = seen.rois[index].tolist()
    return Sighting(
        int(seen.visible_pixels[index]),
        int(seen.unoccluded_pixels[index]),
        (x, y, width, height),
        float(seen.nearest_m[index]),
        seen_ns,
        (camera.name,),
    )


@dataclass(frozen=True, eq=False)
class Look:
    """What one camera, looking every `period_s`, saw at `seen_ns`, by id.

    `map_from_camera` is None where its pose was not known: then it saw nothing.
    """

    number: int = 0
    camera: Camera | None = None
    map_from_camera: RigidTransform | None = None
    sightings: Mapping[int, Sighting] = field(default_factory=dict)
    seen_ns: int = 0
    period_s: float = 0.0


@dataclass(frozen=True, eq=False)
class Observation:
    """What an observer sees: the pose of its base, and A_f by id, the union over its cameras.

    `map_from_camera` is the pose of the first camera at its last look. Poses are None where they
    are not known. `looks` are those of this tick, None where it was no camera's time to look.
    """

    map_from_base: RigidTransform | None = None
    map_from_camera: RigidTransform | None = None
    sightings: Mapping[int, Sighting] = field(default_factory=dict)
    looks: tuple[Look, ...] | None = None


def perceived_artefacts(scene: Scene, observation: Observation) -> tuple[PerceivedArtefact, ...]:
    """Return A_f: what the observer knows of each artefact of a scene that it sees."""
    sightings = observation.sightings
    return tuple(
        perceived_artefact(scene.state(k), sightings[artefact.id])
        for k, artefact in enumerate(scene.artefacts)
        if artefact.id in sightings
    )


def perceived_artefact(state: ArtefactState, sighting: Sighting) -> PerceivedArtefact:
    """Return what an observer without any uncertainty knows of an artefact that it saw."""
    return PerceivedArtefact(
        artefact_id=state.artefact_id,
        label=state.label,
        classes=(state.class_name,),
        probabilities=(1.0,),
        map_from_artefact=state.map_from_artefact,
        pose_covariance=_CERTAIN,
        size_m=state.size_m,
        linear_velocity_m_s=state.linear_velocity_m_s,
        angular_velocity_rad_s=state.angular_velocity_rad_s,
        twist_covariance=_CERTAIN,
        sighting=sighting,
        existence=1.0,
    )


class CameraObserver:
    """Looks at most `rate_hz` times a second; in between, the last sightings hold.

    `looks` counts the looks, `missing` says why the camera's pose was not known when it was last
    time for one. Camera and environment may change from look to look. `number` is the camera's
    place among those of the robot.
    """

    def __init__(
        self,
        robots: RobotTracker,
        meshes: MeshBank,
        rate_hz: float,
        tick_rate_hz: float,
        number: int,
    ) -> None:
        self.looks = 0
        self.missing = ""
        self._number = number
        self._period_s = 1.0 / min(rate_hz, tick_rate_hz)
        self._robots, self._meshes = robots, meshes
        self._period_ns = round(NS_PER_S / rate_hz)
        self._looks_at_each_tick = rate_hz >= tick_rate_hz
        self._last = Look(number)
        self._last_period = -1
        self._view: tuple[ViewModel | None, float] = (None, 0.0)
        self._buffer: ZBuffer | None = None
        self._environment: Environment | None = None
        self._field = VoxelField.empty()

    def observe(
        self,
        now_ns: int,
        camera: Camera,
        environment: Environment,
        scene: Scene,
        settings: OcclusionParameters,
    ) -> Look:
        """Return what the camera perceives at `now_ns`; departed artefacts are left out."""
        if not self._is_due(now_ns):
            alive = {artefact.id for artefact in scene.artefacts}
            held = {i: seen for i, seen in self._last.sightings.items() if i in alive}
            return replace(self._last, sightings=held)
        map_from_camera = self._robots.map_from_camera(camera, now_ns)
        self.missing = self._robots.camera_missing
        sightings: Mapping[int, Sighting] = {}
        if map_from_camera is not None:
            self.looks += 1
            sightings = self.look(now_ns, camera, map_from_camera, environment, scene, settings)
        self._last = Look(self._number, camera, map_from_camera, sightings, now_ns, self._period_s)
        return self._last

    def look(
        self,
        now_ns: int,
        camera: Camera,
        map_from_camera: RigidTransform,
        environment: Environment,
        scene: Scene,
        settings: OcclusionParameters,
    ) -> dict[int, Sighting]:
        """Return A_f by id: the artefacts of which more than tau pixels are visible."""
        if not len(scene):
            return {}
        self.prepare(environment)
        shapes = self._meshes.selection(scene.rows) if settings.shape is Shape.MESH else None
        buffer = self.prepare_camera(camera, settings)
        seen = buffer.visibility(
            map_from_camera,
            scene.boxes,
            self._field,
            shapes,
            settings.mutual,
            by_mesh=settings.target is Shape.MESH,
        )
        return {
            artefact.id: _sighting(seen, i, now_ns, camera)
            for i, artefact in enumerate(scene.artefacts)
            if seen.visible_pixels[i] > settings.tau
        }

    def imagine(
        self,
        camera: Camera,
        map_from_camera: RigidTransform,
        environment: Environment,
        settings: OcclusionParameters,
        boxes: OrientedBoxes,
    ) -> list[Sighting | None]:
        """Return how each of N boxes would be seen, alone in the environment.

        None for a box of which not more than tau pixels are visible.
        """
        self.prepare(environment)
        buffer = self.prepare_camera(camera, settings)
        seen = buffer.visibility(map_from_camera, boxes, self._field, mutual=False)
        are_seen = (seen.visible_pixels > settings.tau).tolist()
        return [
            _sighting(seen, i, self._last.seen_ns, camera) if is_seen else None
            for i, is_seen in enumerate(are_seen)
        ]

    def prepare(self, environment: Environment) -> None:
        """Prepare the rays for an environment, if it is another one than before."""
        if self._environment is not environment:
            self._environment = environment
            self._field = VoxelField.of(environment.voxels)

    def prepare_camera(self, camera: Camera, settings: OcclusionParameters) -> ZBuffer:
        """Return the z-buffer of a camera, a new one if the view model or the range changed."""
        view = (camera.view, settings.max_range)
        if self._buffer is None or self._view != view:
            self._buffer, self._view = ZBuffer(*view), view
        return self._buffer

    def forget(self) -> None:
        """Forget what was seen: the clock jumped back."""
        self._last, self._last_period = Look(self._number), -1

    def _is_due(self, now_ns: int) -> bool:
        period = now_ns // self._period_ns
        is_due = self._looks_at_each_tick or period != self._last_period
        self._last_period = period
        return is_due


class Watch:
    """Looks with all cameras of a robot, each at its own rate; what it sees is their union."""

    def __init__(
        self,
        robots: RobotTracker,
        meshes: MeshBank,
        rates_hz: Sequence[float],
        tick_rate_hz: float,
    ) -> None:
        self.eyes = [
            CameraObserver(robots, meshes, rate_hz, tick_rate_hz, number)
            for number, rate_hz in enumerate(rates_hz)
        ]
        self._robots = robots

    @property
    def looks(self) -> int:
        """How often it was time for a look, and the camera's pose was known."""
        return sum(eye.looks for eye in self.eyes)

    @property
    def missing(self) -> str:
        """Why the pose of a camera is not known, empty if all are."""
        return next((eye.missing for eye in self.eyes if eye.missing), "")

    def observe(
        self,
        now_ns: int,
        cameras: Sequence[Camera | None],
        environment: Environment,
        scene: Scene,
        settings: OcclusionParameters,
    ) -> Observation:
        """Return what is perceived at `now_ns` by the cameras that are known, one for each eye."""
        looks = [
            eye.observe(now_ns, camera, environment, scene, settings)
            for eye, camera in zip(self.eyes, cameras, strict=True)
            if camera is not None
        ]
        union: dict[int, Sighting] = {}
        for look in looks:
            for number, sighting in look.sightings.items():
                before = union.get(number)
                union[number] = sighting if before is None else joined(before, sighting)
        due = tuple(look for look in looks if look.seen_ns == now_ns)
        first = next((look for look in looks if look.number == 0), Look())
        return replace(
            self.stand_by(now_ns),
            map_from_camera=first.map_from_camera,
            sightings=union,
            looks=due or None,
        )

    def stand_by(self, now_ns: int) -> Observation:
        """Return the pose of the robot's base, without a look."""
        robot = self._robots.pose(now_ns)
        return Observation(robot.map_from_base if robot else None)

    def prepare(self, environment: Environment) -> None:
        """Prepare the rays for an environment."""
        for eye in self.eyes:
            eye.prepare(environment)

    def prepare_cameras(
        self, cameras: Sequence[Camera | None], settings: OcclusionParameters
    ) -> None:
        """Prepare the rays of the cameras that are known."""
        for eye, camera in zip(self.eyes, cameras, strict=True):
            if camera is not None:
                eye.prepare_camera(camera, settings)

    def forget(self) -> None:
        """Forget what was seen: the clock jumped back."""
        for eye in self.eyes:
            eye.forget()


def sight_events(
    now_ns: int, before: Mapping[int, str], seen: Mapping[int, str], living: Mapping[int, str]
) -> list[ArtefactEvent]:
    """Return the events of artefacts that came into sight, or are alive and went out of it.

    `before`, `seen` and `living` are labels by id.
    """
    found = [i for i in sorted(seen) if i not in before]
    lost = [i for i in sorted(before) if i not in seen and i in living]
    return [
        *(ArtefactEvent(now_ns, EventKind.PERCEIVED, i, seen[i]) for i in found),
        *(ArtefactEvent(now_ns, EventKind.LOST, i, living[i]) for i in lost),
    ]
