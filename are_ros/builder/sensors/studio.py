"""What painters need from image to image: surfaces, rays, light, and the depths of the moment."""

from collections import deque
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.rendering.painter import Lighting, Painter
from are_ros.builder.rendering.surface import SurfaceBank
from are_ros.builder.sensors.depth_image import DepthImage
from are_ros.builder.sensors.lens import Lens
from are_ros.builder.sensors.sensor_path import Reading
from are_ros.errors import InputError
from are_ros.parameters.choices import Light
from are_ros.parameters.model import RenderingParameters
from are_ros.population.randomness import Purpose, generator
from are_ros.world.rigid_transform import RigidTransform

_KEPT: Final = 30
"""So many depth images are kept for the images that come later."""
_SAME_NS: Final = 5_000_000
"""A depth image and an image whose stamps differ by at most this are of the same time."""
_FAR_M: Final = 1e4


class Studio:
    """Keeps painters by lens, surfaces by row, and the newest depth images."""

    def __init__(self, settings: RenderingParameters, seed: int) -> None:
        self.surfaces = SurfaceBank(seed)
        self.settings = settings
        self.expects_depth = False
        """Whether there may be depth images, though none has come yet."""
        self._seed = seed
        self._painters: dict[int, tuple[Lens, Painter]] = {}
        self._depths: deque[DepthImage] = deque(maxlen=_KEPT)

    @property
    def lighting(self) -> Lighting:
        """The light and the camera's faults."""
        settings = self.settings
        return Lighting(
            settings.light is Light.ESTIMATED,
            settings.brightness,
            settings.lamp_azimuth,
            settings.lamp_elevation,
            settings.shadow,
            settings.blur,
            settings.noise,
        )

    @property
    def jpeg_quality(self) -> int:
        """The quality of JPEGs."""
        return self.settings.jpeg_quality

    def noise(self, stamp_ns: int) -> np.random.Generator:
        """Return the generator of the noise of an image."""
        return generator(self._seed, Purpose.APPEARANCE, max(stamp_ns, 0))

    def painter(self, lens: Lens) -> Painter:
        """Return the painter of a lens; the newest few are kept."""
        if id(lens) not in self._painters:
            while len(self._painters) >= 4:
                self._painters.pop(next(iter(self._painters)))
            self._painters[id(lens)] = lens, Painter(lens.view)
        return self._painters[id(lens)][1]

    def keep_depth(self, depth: DepthImage) -> None:
        """Keep a depth image, as it was received, for the image of its time."""
        self._depths.append(depth)

    def forget(self) -> None:
        """Forget the depth images: the clock jumped."""
        self._depths.clear()

    def lacks_depth(self, image: Reading) -> bool:
        """Say whether the depth image of an image is still to come.

        It is if there is none of its time yet, but there were earlier ones of its frame, or the
        first is still expected.
        """
        stamps = [one.stamp_ns for one in self._depths if one.frame_id == image.frame_id]
        if not self._depths:
            return self.expects_depth
        return bool(stamps) and max(stamps) < image.stamp_ns - _SAME_NS

    def real_ranges(
        self,
        image: Reading,
        lens: Lens,
        map_from_camera: RigidTransform,
        which: npt.NDArray[np.int64],
        surface: VoxelField | None,
    ) -> npt.NDArray[np.float32]:
        """Return how far away is what is really there, float32 (H, W) [m].

        By the depth image of the same frame, time and size. Where that has no return or is missing,
        the environment's surface in the tiles `which`, and inf elsewhere.
        """
        view = lens.view
        ranges = np.full((view.height, view.width), np.nan, dtype=np.float32)
        depth = self._depth_of(image, view.height, view.width)
        self.expects_depth = False
        if depth is not None:
            depths_m = depth.pixels.code.depths_m(depth.pixels.stored())
            np.multiply(np.maximum(depths_m, 0.0), lens.lengths, out=ranges, casting="same_kind")
        is_open = np.isnan(ranges)
        if surface is not None:
            rows, columns = np.nonzero(is_open & lens.in_tiles(which))
            directions = view.directions()[rows, columns]
            in_map = directions @ map_from_camera.rotation_matrix().T.astype(np.float32)
            hits_m = surface.first_hits(map_from_camera.translation_m, in_map, _FAR_M)
            ranges[rows, columns] = hits_m
            is_open[rows, columns] = False
        ranges[is_open] = np.inf
        return ranges

    def _depth_of(self, image: Reading, height: int, width: int) -> DepthImage | None:
        """Return the depth image that goes with an image, None if there is none."""
        near = [
            one
            for one in self._depths
            if one.frame_id == image.frame_id and abs(one.stamp_ns - image.stamp_ns) <= _SAME_NS
        ]
        for depth in sorted(near, key=lambda one: abs(one.stamp_ns - image.stamp_ns)):
            try:
                depth.pixels.stored()
            except InputError:
                continue  # it is counted where it is augmented itself
            if depth.pixels.shape == (height, width):
                return depth
        return None
