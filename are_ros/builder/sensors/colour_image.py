"""An image of colours, and its augmentation: artefacts are painted into it.

`Studio` keeps what painters need from image to image: surfaces, rays, light, and the depths of the
moment.
"""

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.rendering.painter import Lighting, PaintedBody, Painter
from are_ros.builder.rendering.surface import SurfaceBank
from are_ros.builder.sensors.depth_image import DepthImage
from are_ros.builder.sensors.image import CompressedImage, Image, PictureHeader, picture_header
from are_ros.builder.sensors.lens import Lens, known_lens
from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.builder.sensors.sensor_path import Reading
from are_ros.errors import InputError
from are_ros.parameters.choices import Light
from are_ros.parameters.model import RenderingParameters
from are_ros.population.artefact import Artefact
from are_ros.population.randomness import Purpose, generator
from are_ros.wording import counted
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.rigid_transform import RigidTransform, product

Pixels = npt.NDArray[np.uint8]

_ORDERS: Final = {
    "rgb8": (0, 1, 2),
    "bgr8": (2, 1, 0),
    "rgba8": (0, 1, 2),
    "bgra8": (2, 1, 0),
    "mono8": (0, 0, 0),
}
"""Where red, green and blue are in a pixel."""
_MOSAICS: Final = {
    "bayer_rggb8": ("BayerBG2RGB", (0, 1, 1, 2)),
    "bayer_bggr8": ("BayerRG2RGB", (2, 1, 1, 0)),
    "bayer_gbrg8": ("BayerGR2RGB", (1, 2, 0, 1)),
    "bayer_grbg8": ("BayerGB2RGB", (1, 0, 2, 1)),
}
"""OpenCV's name of each mosaic, which it calls by its second row, and the colours of the first two
pixels of the first two rows: 0 red, 1 green, 2 blue."""
_YUV: Final = {
    "yuv422": ("YUV2RGB_UYVY", 1),
    "uyvy": ("YUV2RGB_UYVY", 1),
    "yuv422_yuy2": ("YUV2RGB_YUY2", 0),
    "yuyv": ("YUV2RGB_YUY2", 0),
}
"""OpenCV's name of each, and where the luma is in a pixel. Two pixels of a row share their chroma:
the first has U, the second V."""
_PAINTED_ON: Final = (*_ORDERS, *_MOSAICS, *_YUV)
_LUMA: Final = np.array((0.299, 0.587, 0.114))
"""Shares of red, green and blue in a grey (ITU-R BT.601), as cameras have them."""
_LUMA_RANGE: Final = 219.0 / 255.0, 16.0
_CHROMA: Final = np.array(((-0.148, -0.291, 0.439), (0.439, -0.368, -0.071)))
"""Of YUV: its luma is 16 to 235, U and V are these shares, beside 128 (ITU-R BT.601)."""
_BITS, _WITH_ALPHA = 8, 4
_MOST_PIXELS: Final = 1 << 26


@dataclass(frozen=True, eq=False)
class RawColour:
    """The pixels of a raw image."""

    image: Image

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.image.height, self.image.width

    def check(self) -> None:
        """Raise InputError if the encoding is not painted on."""
        encoding, width = self.image.encoding, self.image.width
        if encoding not in _PAINTED_ON:
            known = ", ".join(_PAINTED_ON)
            raise InputError(f"encoding {encoding!r} is not painted on; known are {known}")
        if encoding in _YUV and width % 2:
            raise InputError(f"encoding {encoding!r} needs an even width, but it is {width}")

    def rgb(self) -> Pixels:
        """Return the pixels (H, W, 3), new; InputError as `check`."""
        self.check()
        stored, encoding = self.image.pixels(), self.image.encoding
        if encoding not in _ORDERS:
            import cv2

            name, _ = _MOSAICS[encoding] if encoding in _MOSAICS else _YUV[encoding]
            code = getattr(cv2, f"COLOR_{name}")
            pixels = np.asarray(cv2.cvtColor(np.ascontiguousarray(stored), code), np.uint8)
            if encoding in _MOSAICS:  # OpenCV repeats those beside the edge there
                np.put_along_axis(pixels, self._colours(), stored[:, :, np.newaxis], axis=2)
            return pixels
        order = _ORDERS[encoding]
        if stored.ndim == 2:
            return np.repeat(stored[:, :, np.newaxis], 3, axis=2)
        first, _, last = order  # red and blue may be swapped, and an alpha beyond
        ordered = stored[:, :, :3] if first < last else stored[:, :, 2::-1]
        return np.ascontiguousarray(ordered)

    def with_rgb(self, painted: Pixels, before: Pixels, quality: int) -> "RawColour":
        """Return the message with other pixels (H, W, 3).

        `before` are those that `rgb` gave: pixels that are the same keep their bits. `quality` is
        that of a JPEG.
        """
        del quality
        stored, encoding = self.image.pixels().copy(), self.image.encoding
        if encoding in _ORDERS and stored.ndim > 2:
            for colour, channel in enumerate(_ORDERS[encoding]):
                stored[:, :, channel] = painted[:, :, colour]
            return RawColour(self.image.with_pixels(stored))
        is_changed = (painted != before).any(axis=2)
        if encoding in _MOSAICS:
            own = np.take_along_axis(painted, self._colours(), axis=2)[:, :, 0]
            stored[is_changed] = own[is_changed]
        elif encoding in _YUV:
            _put_yuv(stored, painted, before, is_changed, _YUV[encoding][1])
        else:
            stored[is_changed] = _rounded(product(painted[is_changed], _LUMA))
        return RawColour(self.image.with_pixels(stored))

    def _colours(self) -> npt.NDArray[np.int64]:
        """Return the colour of each pixel of a mosaic, (H, W, 1): 0 red, 1 green, 2 blue."""
        tile = np.array(_MOSAICS[self.image.encoding][1]).reshape(2, 2)
        rows, columns = np.ogrid[: self.image.height, : self.image.width]
        return np.asarray(tile[rows % 2, columns % 2])[:, :, np.newaxis]


def _put_yuv(
    stored: Pixels, painted: Pixels, before: Pixels, is_changed: npt.NDArray[np.bool_], luma: int
) -> None:
    """Put painted pixels (H, W, 3) into those of YUV (H, W, 2), where they changed (H, W).

    A pair's chroma is that of its mean colour, where one of the two changed. A shadow makes no luma
    greater, though colours that RGB does not have come back as others.
    """
    (share, least), now, was = _LUMA_RANGE, painted[is_changed], stored[is_changed, luma]
    lumas = _rounded(share * product(now, _LUMA) + least)
    is_darker = (now <= before[is_changed]).all(axis=1)
    stored[is_changed, luma] = np.where(is_darker, np.minimum(lumas, was), lumas)
    is_pair = is_changed[:, 0::2] | is_changed[:, 1::2]
    mean = 0.5 * painted[:, 0::2][is_pair] + 0.5 * painted[:, 1::2][is_pair]
    for k, shares in enumerate(_CHROMA):
        stored[:, k::2, 1 - luma][is_pair] = _rounded(product(mean, shares) + 128.0)


def _rounded(numbers: npt.NDArray[np.float64]) -> Pixels:
    return np.rint(numbers).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class CompressedColour:
    """A JPEG or PNG of 8 bits; it is decompressed when an artefact may be in it."""

    image: CompressedImage

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, as the data's beginning has them; InputError as `check`."""
        header = self._header()
        return header.height, header.width

    def check(self) -> None:
        """Raise InputError if the data are no picture that is painted on, by their beginning."""
        self._header()

    def rgb(self) -> Pixels:
        """Return the pixels (H, W, 3), new; InputError if they cannot be decompressed."""
        import cv2

        self._header()
        stored = self._decoded(cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        return np.ascontiguousarray(stored[:, :, ::-1])

    def with_rgb(self, painted: Pixels, before: Pixels, quality: int) -> "CompressedColour":
        """Return the message with other pixels (H, W, 3), see `RawColour`."""
        import cv2

        del before
        header, stored = self._header(), np.ascontiguousarray(painted[:, :, ::-1])
        if header.channels == 1:
            stored = cv2.cvtColor(stored, cv2.COLOR_BGR2GRAY)
        elif header.channels == _WITH_ALPHA:
            stored = np.dstack((stored, self._decoded(cv2.IMREAD_UNCHANGED)[:, :, 3]))
        how = [cv2.IMWRITE_JPEG_QUALITY, quality] if header.suffix == ".jpg" else []
        _, data = cv2.imencode(header.suffix, stored, how)
        return CompressedColour(replace(self.image, data=data.reshape(-1)))

    def _decoded(self, flags: int) -> npt.NDArray[Any]:
        """Return the pixels as OpenCV reads them; InputError if it cannot."""
        import cv2

        try:
            stored = cv2.imdecode(self.image.data, flags)
        except cv2.error:
            stored = None
        if stored is None:
            raise InputError(f"format {self.image.format!r}: its data are damaged")
        decoded: npt.NDArray[Any] = stored
        return decoded

    def _header(self) -> PictureHeader:
        """Return what the data begin with; InputError if they are not painted on."""
        name = f"format {self.image.format!r}"
        try:
            header = picture_header(self.image.data)
        except InputError as cause:
            raise InputError(f"{name}: {cause}") from cause
        is_cmyk = header.suffix == ".jpg" and header.channels == _WITH_ALPHA
        if header.bits > _BITS or header.channels not in (1, 3, _WITH_ALPHA) or is_cmyk:
            what = "CMYK" if is_cmyk else counted(header.channels, "number")
            raise InputError(
                f"{name}: its pixels have {what} of {header.bits} bits; grey, RGB and RGBA of "
                "8 bits are painted on"
            )
        if header.width * header.height > _MOST_PIXELS:
            raise InputError(f"{name}: it claims to have {header.width} x {header.height} pixels")
        return header


ColourPixels = RawColour | CompressedColour
"""The pixels of a message, as it was received."""


@dataclass(frozen=True, eq=False)
class ArtefactInImage:
    """An artefact that an image shows, or would show if nothing hid it.

    `roi_px` is (x, y, width, height), the smallest rectangle around its `visible_pixels` in the
    mask. `visible_fraction` is the share of its samples that are visible, four to a pixel.
    `camera_from_box` is the pose of the middle of its box, in the optical frame.
    """

    artefact: Artefact
    roi_px: tuple[int, int, int, int]
    visible_pixels: int
    visible_fraction: float
    camera_from_box: RigidTransform


@dataclass(frozen=True, eq=False)
class ImageTruth:
    """What is painted: which of N artefacts covers most of each pixel, -1 for none, int32 (H, W).

    `bodies` are those of the artefacts, and `visible_fractions` (N,) their visible shares, NaN for
    those outside of the image.
    """

    mask: npt.NDArray[np.int32]
    map_from_camera: RigidTransform
    artefacts: Sequence[Artefact] = ()
    bodies: Sequence[PaintedBody] = ()
    visible_fractions: npt.NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    @property
    def ids(self) -> npt.NDArray[np.int32]:
        """The id of the artefact at each pixel, 0 where there is none, int32 (H, W)."""
        ids = np.array([*(artefact.id for artefact in self.artefacts), 0], dtype=np.int32)
        return ids[self.mask]

    @cached_property
    def in_image(self) -> tuple[ArtefactInImage, ...]:
        """The artefacts that are in the image, visible or hidden, in the order of their ids."""
        from scipy.ndimage import find_objects

        numbers, count = self.mask + 1, len(self.artefacts)
        regions = find_objects(numbers, count)
        pixels = np.bincount(numbers.reshape(-1), minlength=count + 1)[1:].tolist()
        camera_from_map = self.map_from_camera.inverse()
        return tuple(
            ArtefactInImage(
                self.artefacts[k],
                _roi_px(regions[k]),
                pixels[k],
                float(self.visible_fractions[k]),
                camera_from_map @ self.bodies[k].map_from_box,
            )
            for k in np.flatnonzero(~np.isnan(self.visible_fractions)).tolist()
        )


def _roi_px(region: tuple[slice, slice] | None) -> tuple[int, int, int, int]:
    """Return x, y, width and height of a region, all 0 for none."""
    if region is None:
        return 0, 0, 0, 0
    rows, columns = region
    return columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start


_KEPT: Final = 30
"""So many depth images are kept for the images that come later."""
_SAME_NS: Final = 5_000_000
"""A depth image and an image whose stamps differ by at most this are of the same time."""
_OTHER_FRAME: Final = "they are in another frame"
_FEW: Final = 0.1
"""A smaller share of images without a depth image is no cause for a warning."""
_FAR_M: Final = 1e4


class Studio:
    """Keeps painters by lens, surfaces by row, and the newest depth images."""

    def __init__(self, settings: RenderingParameters, seed: int) -> None:
        self.surfaces = SurfaceBank(seed)
        self.settings = settings
        self.expects_depth = False
        """Whether there may be depth images, though none has come yet."""
        self._painters: dict[int, tuple[Lens, Painter]] = {}
        self._depths: deque[DepthImage] = deque(maxlen=_KEPT)
        self._paired, self._alone = 0, Counter[str]()

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

    def noise(self, stamp_ns: int) -> np.random.Generator:
        """Return the generator of the noise of an image."""
        return generator(self.surfaces.seed, Purpose.IMAGE_NOISE, max(stamp_ns, 0))

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

    @property
    def doubt_about_depth(self) -> str:
        """A sentence, if depth images came, and many images found none that goes with them.

        Empty if another camera's did: this one may have no depth camera beside it.
        """
        alone = self._alone.copy()
        if self._paired:
            del alone[_OTHER_FRAME]
        count, painted = alone.total(), alone.total() + self._paired
        if count <= _FEW * painted:
            return ""
        reason, _ = alone.most_common(1)[0]
        return (
            f"{count} of {painted} images with artefacts had no depth image that goes with them"
            f" ({reason}): there only what is in the map hides artefacts"
        )

    def reseed(self, seed: int) -> None:
        """Draw noise and the looks of later artefacts from another seed."""
        self.surfaces.seed = seed

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

        By the depth image of the same frame, time and size, of several that of its lens. Where that
        has no return or is missing, the environment's surface in the tiles `which`, and inf
        elsewhere.
        """
        view = lens.view
        ranges = np.full((view.height, view.width), np.nan, dtype=np.float32)
        depth = self._depth_of(image, lens)
        self.expects_depth = False
        self._paired += depth is not None
        if depth is None and self._depths:
            self._alone[self._why_alone(image)] += 1
        if depth is not None:
            depths_m = depth.pixels.code.depths_m(depth.pixels.stored())
            np.multiply(np.maximum(depths_m, 0.0), lens.lengths, out=ranges, casting="same_kind")
        is_open = np.isnan(ranges)
        if surface is not None:
            rows, columns = np.nonzero(is_open & lens.in_tiles(which))
            directions = view.directions()[rows, columns]
            in_map = product(directions, map_from_camera.rotation_matrix().T.astype(np.float32))
            hits_m = surface.first_hits(map_from_camera.translation_m, in_map, _FAR_M)
            ranges[rows, columns] = hits_m
            is_open[rows, columns] = False
        ranges[is_open] = np.inf
        return ranges

    def _depth_of(self, image: Reading, lens: Lens) -> DepthImage | None:
        """Return the depth image that goes with an image, None if there is none.

        Of several that may, that of the same lens: two cameras may share a frame.
        """
        near = [
            one
            for one in self._depths
            if one.frame_id == image.frame_id and abs(one.stamp_ns - image.stamp_ns) <= _SAME_NS
        ]
        near.sort(key=lambda one: abs(one.stamp_ns - image.stamp_ns))
        for depth in sorted(near, key=lambda one: one.lens is None or not lens.is_like(one.lens)):
            try:
                depth.pixels.stored()
            except InputError:
                continue  # it is counted where it is augmented itself
            if depth.pixels.shape == (lens.view.height, lens.view.width):
                return depth
        return None

    def _why_alone(self, image: Reading) -> str:
        """Return why none of the depth images goes with an image."""
        stamps = [one.stamp_ns for one in self._depths if one.frame_id == image.frame_id]
        if not stamps:
            return _OTHER_FRAME
        if min(abs(stamp_ns - image.stamp_ns) for stamp_ns in stamps) > _SAME_NS:
            return "they are more than 5 ms apart"
        return "their sizes differ"


@dataclass(frozen=True, eq=False)
class ColourImage:
    """Colours (H, W) in the optical frame of their camera; without a `lens`, rays are unknown.

    `truth` is what was painted; None: nothing was looked for.
    """

    pixels: ColourPixels
    lens: Lens | None = None
    truth: ImageTruth | None = None

    @classmethod
    def miniature(cls, frame_id: str, stamp_ns: int) -> "ColourImage":
        """Return a grey image, in which what arrives is painted, for `warm_up`."""
        return cls(RawColour(Image.miniature(frame_id, stamp_ns, "rgb8", bytes((100,) * 3))))

    @property
    def frame_id(self) -> str:
        """The optical frame."""
        return self.pixels.image.frame_id

    @property
    def stamp_ns(self) -> int:
        """The time of measurement [ns]."""
        return self.pixels.image.stamp_ns

    def seen_through(self, lens: Lens) -> "ColourImage":
        """Return the image with the lens that it was taken with."""
        return replace(self, lens=lens)

    def with_nobody(self, map_from_sensor: RigidTransform) -> "ColourImage":
        """Return the image with the truth that no artefact is in it, if its lens is known.

        InputError if the lens is of another size: then nothing is known of the image's pixels.
        """
        if self.lens is None:
            return self
        self.lens.check_size(*self.pixels.shape)
        nobody = np.full((self.lens.view.height, self.lens.view.width), -1, dtype=np.int32)
        return replace(self, truth=ImageTruth(nobody, map_from_sensor))

    def augmented(self, map_from_sensor: RigidTransform, obstacles: Obstacles) -> "ColourImage":
        """Return the image with the artefacts painted in, hidden by what is really there.

        What is really there is told, pixel by pixel, by the depth image of the same time and place,
        else by the surface of the environment. If no artefact is visible, the pixels stay as they
        are. Raises InputError if the lens is not known or of another size, or the image is not one
        that is painted on.
        """
        lens, studio, scene = known_lens(self.lens), obstacles.studio, obstacles.scene
        if not isinstance(studio, Studio) or scene is None:
            return self
        self.pixels.check()
        which = lens.tiles_towards(map_from_sensor, _with_shadows(obstacles.boxes))
        if not len(which):
            return self.with_nobody(map_from_sensor)
        before = self.pixels.rgb()
        lens.check_size(*before.shape[:2])
        bodies = [
            _body(studio, artefact, pose, half_sizes_m)
            for artefact, pose, half_sizes_m in zip(
                scene.artefacts,
                np.column_stack((obstacles.boxes.centres_m, obstacles.boxes.yaws_rad)).tolist(),
                obstacles.boxes.half_sizes_m,
                strict=True,
            )
        ]
        real_m = studio.real_ranges(self, lens, map_from_sensor, which, obstacles.surface)
        painting = studio.painter(lens).paint(
            before, map_from_sensor, bodies, real_m, studio.lighting, studio.noise(self.stamp_ns)
        )
        fractions = painting.visible_fractions
        truth = ImageTruth(painting.mask, map_from_sensor, scene.artefacts, bodies, fractions)
        done = replace(self, truth=truth)
        if painting.pixels is None:
            return done
        quality = studio.settings.jpeg_quality
        return replace(done, pixels=self.pixels.with_rgb(painting.pixels, before, quality))


def _body(
    studio: Studio,
    artefact: Artefact,
    pose: Sequence[float],
    half_sizes_m: npt.NDArray[np.float64],
) -> PaintedBody:
    """Return an artefact to paint; `pose` is x, y, z of its box's centre, and the yaw."""
    x_m, y_m, z_m, yaw_rad = pose
    map_from_box = RigidTransform.planar(x_m, y_m, yaw_rad, z_m)
    ground_m = z_m - float(half_sizes_m[2])
    return PaintedBody(
        studio.surfaces.of(artefact.row, artefact.id), map_from_box, half_sizes_m, ground_m
    )


def _with_shadows(boxes: OrientedBoxes) -> OrientedBoxes:
    """Return the boxes, grown by the reach of their shadows."""
    return replace(boxes, half_sizes_m=boxes.half_sizes_m + 0.75)
