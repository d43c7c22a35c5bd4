"""What an observer perceives: A_f by the z-buffer of its camera (section 3.3)."""

from dataclasses import dataclass

from are_ros.builder.occlusion.meshes import MeshBank
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.occlusion.zbuffer import Visibility, ZBuffer
from are_ros.builder.scene import Scene
from are_ros.parameters.choices import Shape
from are_ros.parameters.model import OcclusionParameters
from are_ros.world.cameras import Camera
from are_ros.world.environment import Environment
from are_ros.world.rigid_transform import RigidTransform


@dataclass(frozen=True)
class Sighting:
    """How one member of A_f was seen; `range_m` is to its nearest visible point."""

    visible_pixels: int
    unoccluded_pixels: int
    roi_px: tuple[int, int, int, int]
    range_m: float


class Perception:
    """The z-buffer of one camera over the newest environment; both may change."""

    def __init__(self, meshes: MeshBank) -> None:
        self._meshes = meshes
        self._camera: Camera | None = None
        self._buffer: ZBuffer | None = None
        self._max_range_m = 0.0
        self._environment: Environment | None = None
        self._field = VoxelField.empty()

    def look(
        self,
        camera: Camera,
        map_from_camera: RigidTransform,
        environment: Environment,
        scene: Scene,
        settings: OcclusionParameters,
    ) -> dict[int, Sighting]:
        """Return A_f by id: the artefacts of which more than tau pixels are visible."""
        if not len(scene):
            return {}
        self.use_environment(environment)
        shapes = self._meshes.selection(scene.rows) if settings.shape is Shape.MESH else None
        buffer = self.buffer_of(camera, settings.max_range)
        seen = buffer.visibility(map_from_camera, scene.boxes, self._field, shapes, settings.mutual)
        return {
            artefact.id: _sighting(seen, i)
            for i, artefact in enumerate(scene.artefacts)
            if seen.visible_pixels[i] > settings.tau
        }

    def buffer_of(self, camera: Camera, max_range_m: float) -> ZBuffer:
        """Return the buffer of a view model; made anew only when the model or the range changes."""
        known = self._camera is not None and self._camera.view == camera.view
        if self._buffer is None or not known or self._max_range_m != max_range_m:
            self._buffer = ZBuffer(camera.view, max_range_m)
            self._camera, self._max_range_m = camera, max_range_m
        return self._buffer

    def use_environment(self, environment: Environment) -> None:
        """Make the rays ready for an environment, if it is another one than before."""
        if self._environment is not environment:
            self._environment = environment
            self._field = VoxelField.of(environment.voxels)


def _sighting(seen: Visibility, index: int) -> Sighting:
    x, y, width, height = seen.rois[index].tolist()
    return Sighting(
        int(seen.visible_pixels[index]),
        int(seen.unoccluded_pixels[index]),
        (x, y, width, height),
        float(seen.nearest_m[index]),
    )
