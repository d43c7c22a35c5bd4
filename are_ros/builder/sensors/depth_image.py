"""An image of depths, and its augmentation with artefacts.

A depth is the coordinate along the camera's optical axis, not the distance along the ray. REP 118
defines images of depths as messages.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from are_ros.builder.sensors.image import CompressedImage, Image
from are_ros.builder.sensors.lens import Lens, known_lens
from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.errors import InputError
from are_ros.world.rigid_transform import RigidTransform

_Floats = npt.NDArray[np.float64]
_Stored = npt.NDArray[Any]

_TOO_NEAR_M: Final = 1e-3
"""An artefact as near as this has no depth in metres: the camera is inside of it."""


class Millimetres:
    """Whole millimetres, 0 where there is no depth: 16UC1, mono16."""

    farthest_m = 65.535
    """The largest depth that has a number [m]."""

    def depths_m(self, stored: _Stored) -> _Floats:
        """Return the depths [m], float64: NaN where nothing came back, -inf where too close."""
        return np.where(stored > 0, stored * 1e-3, np.nan)

    def stored(self, depths_m: _Floats) -> _Stored:
        """Return the numbers that are nearest to depths [m]; too close is what the code has."""
        return np.rint(np.clip(depths_m, 0.0, self.farthest_m) * 1e3).astype(np.uint16)


class Metres:
    """Metres: 32FC1. NaN, infinite, zero or negative where there is no depth; -inf: too close."""

    farthest_m = math.inf

    def depths_m(self, stored: _Stored) -> _Floats:
        """Return the depths; see `Millimetres`."""
        depths = stored.astype(np.float64)
        with np.errstate(invalid="ignore"):
            is_none = ~(depths > 0.0) | (depths == np.inf)
        depths[is_none & ~np.isneginf(depths)] = np.nan
        return depths

    def stored(self, depths_m: _Floats) -> _Stored:
        """Return the numbers; see `Millimetres`."""
        return np.where(depths_m <= _TOO_NEAR_M, -np.inf, depths_m).astype(np.float32)


@dataclass(frozen=True)
class InverseDepth:
    """Steps of a / depth + b, 0 where there is no depth: 32FC1 within compressedDepth.

    Raises InputError unless a > 0 and b < 1 are finite.
    """

    a: float
    b: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.a) and self.a > 0.0 and math.isfinite(self.b) and self.b < 1.0):
            raise InputError(f"its depthParam are {self.a:g} and {self.b:g}, which code no depth")

    @property
    def farthest_m(self) -> float:
        """See `Millimetres`."""
        return self.a / (1.0 - self.b)

    def depths_m(self, stored: _Stored) -> _Floats:
        """Return the depths; see `Millimetres`."""
        return np.where(stored > 0, self.a / (np.maximum(stored, 1) - self.b), np.nan)

    def stored(self, depths_m: _Floats) -> _Stored:
        """Return the numbers; nearer than the largest one says there is none."""
        steps = np.rint(self.a / np.maximum(depths_m, 1e-9) + self.b)
        return np.where((steps < 1.0) | (steps > 65535.0), 0.0, steps).astype(np.uint16)


DepthCode = Millimetres | Metres | InverseDepth
"""What the numbers of an image of depths mean."""


class DepthPixels(Protocol):
    """The pixels of a message, as it was received; raw images and compressed ones implement it."""

    @property
    def image(self) -> Image | CompressedImage:
        """The message."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""

    @property
    def code(self) -> DepthCode:
        """What the numbers mean."""

    def stored(self) -> _Stored:
        """Return the numbers (H, W), read-only; InputError if they cannot be decompressed."""

    def with_stored(self, stored: _Stored) -> "DepthPixels":
        """Return the message with other numbers (H, W)."""


_RAW_CODES: Final[Mapping[str, DepthCode]] = {
    "16UC1": Millimetres(),
    "mono16": Millimetres(),
    "32FC1": Metres(),
}


def code_of(encoding: str) -> DepthCode:
    """Return the code of a raw encoding; InputError if it is no depth."""
    if encoding not in _RAW_CODES:
        raise InputError(
            f"encoding {encoding!r} holds no depth; known are {', '.join(_RAW_CODES)}, and"
            " images of colours have the role image"
        )
    return _RAW_CODES[encoding]


@dataclass(frozen=True, eq=False)
class RawDepth:
    """The pixels of a raw image; InputError if its encoding holds no depth."""

    image: Image

    def __post_init__(self) -> None:
        code_of(self.image.encoding)

    @property
    def shape(self) -> tuple[int, int]:
        """See `DepthPixels`."""
        return self.image.height, self.image.width

    @property
    def code(self) -> DepthCode:
        """See `DepthPixels`."""
        return code_of(self.image.encoding)

    def stored(self) -> _Stored:
        """See `DepthPixels`."""
        return self.image.pixels()

    def with_stored(self, stored: _Stored) -> "RawDepth":
        """See `DepthPixels`."""
        return RawDepth(self.image.with_pixels(stored))


@dataclass(frozen=True, eq=False)
class DepthImage:
    """Depths (H, W) in the optical frame of their camera; without a `lens`, rays are unknown."""

    pixels: DepthPixels
    lens: Lens | None = None

    @classmethod
    def miniature(cls, frame_id: str, stamp_ns: int) -> "DepthImage":
        """Return an image in which nothing came back, for `warm_up`."""
        return cls(RawDepth(Image.miniature(frame_id, stamp_ns, "16UC1", bytes(2))))

    @property
    def frame_id(self) -> str:
        """The optical frame."""
        return self.pixels.image.frame_id

    @property
    def stamp_ns(self) -> int:
        """The time of measurement [ns]."""
        return self.pixels.image.stamp_ns

    def seen_through(self, lens: Lens) -> "DepthImage":
        """Return the image with the lens that it was taken with."""
        return replace(self, lens=lens)

    def augmented(self, map_from_sensor: RigidTransform, obstacles: Obstacles) -> "DepthImage":
        """Return the image with the depths of artefacts where they are nearer than what came back.

        Per pixel, along its ray, with the depth of the first hit on any artefact:

        - a return behind the hit becomes the hit, whatever walls the environment has: the return
          proves that the ray is free up to there; one in front of it stays;
        - a pixel without a return becomes the hit if that is within `obstacles.depth_range_m` and
          what the encoding can tell, and the environment's surface is not in front of it.

        A depth is rounded to the nearest number of the encoding. From inside of an artefact there
        is no depth: 0, or -inf in metres. A pixel that has -inf (too close, REP 118) stays. Other
        pixels keep their bits; if no number changes, the same object is returned. Raises
        InputError if the lens is not known or of another size, or the image cannot be decompressed.
        """
        lens = known_lens(self.lens)
        lens.check_size(*self.pixels.shape)
        which = lens.tiles_towards(map_from_sensor, obstacles.boxes)
        if not len(which):
            return self
        rows, columns = lens.tiles.rows[which], lens.tiles.columns[which]
        code, before = self.pixels.code, self.pixels.stored()
        real = before[rows, columns]
        real_m = code.depths_m(real)
        is_none = np.isnan(real_m)
        limits_m = np.where(is_none, min(code.farthest_m, obstacles.depth_range_m), real_m)
        limits_m[~lens.tiles.valid[which]] = -np.inf
        hits_m = limits_m.copy()
        boxes, shapes = obstacles.boxes, obstacles.shapes
        lens.lower_depths(map_from_sensor, which, boxes, shapes, hits_m)
        is_hit = hits_m < limits_m
        tile, pixel = np.nonzero(is_hit & is_none)
        rays = lens.tiles.rays[which[tile], :, pixel]
        lengths = np.linalg.norm(rays, axis=1)
        along_m = hits_m[tile, pixel] * lengths
        hidden = obstacles.are_hidden(map_from_sensor, rays / lengths[:, None], along_m)
        is_hit[tile[hidden], pixel[hidden]] = False
        places = rows[is_hit], columns[is_hit]
        numbers = code.stored(hits_m[is_hit])
        if (numbers == real[is_hit]).all():
            return self
        after = before.copy()
        after[places] = numbers
        return replace(self, pixels=self.pixels.with_stored(after))
