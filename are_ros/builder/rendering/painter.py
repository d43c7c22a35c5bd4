"""Paints artefacts into an image: hidden to the pixel by what is really there, with its light."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.builder.rendering.compositing import clear, compose, mean_light
from are_ros.builder.rendering.rasterizing import (
    ROWS,
    WIDE,
    Corners,
    Faces,
    make_band,
    place_points,
    sample_rays,
)
from are_ros.builder.rendering.shading import Textures, darken, render
from are_ros.builder.rendering.surface import Surface, to_linear, to_srgb
from are_ros.world.cameras import FisheyeView, PinholeView
from are_ros.world.rigid_transform import RigidTransform, product

Floats = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int32]

_LINEAR: Final = to_linear(np.arange(256) / 255.0).astype(np.float32)
_SRGB: Final = np.rint(255.0 * to_srgb(np.arange(4096) / 4095.0)).astype(np.uint8)
_GREY: Final = 0.22
"""The mean linear intensity of the picture of a place that is lit with strength 1."""
_SHADOW_M: Final = 0.6
"""A shadow reaches as far from the body's box."""
_RING: Final = np.column_stack(
    [f(np.linspace(0.0, math.tau, 16, endpoint=False)) for f in (np.cos, np.sin)]
)
_DARKEST, _BRIGHTEST = 0.1, 1.6
_SMALL_PX: Final = 8
"""The sides of triangles that are not larger bulge little in the image of any lens."""
_MARGIN: Final = 0.02
"""Of directions [rad]: more than a pixel's width, and than rounding."""


@dataclass(frozen=True)
class Lighting:
    """The light of the place, and what a camera does to an image.

    `brightness` multiplies the light that is estimated from the image (`is_estimated`), or is the
    light itself. The lamp stands at `azimuth_rad` of the map's frame, `elevation_rad` high.
    `shadow` is the share of the light that is missing below a body. `blur_px` is the standard
    deviation of the lens's blur, `noise` that of the sensor's noise, in steps of 8 bits.
    """

    is_estimated: bool = True
    brightness: float = 1.0
    azimuth_rad: float = 0.7
    elevation_rad: float = 1.0
    shadow: float = 0.6
    blur_px: float = 0.5
    noise: float = 1.5


@dataclass(frozen=True, eq=False)
class PaintedBody:
    """An artefact to paint: its surface, in the frame of its box, and the box in the map's frame.

    `ground_m` is the height of the ground on which it stands, `half_sizes_m` (3,) half its size.
    """

    surface: Surface
    map_from_box: RigidTransform
    half_sizes_m: npt.NDArray[np.float64]
    ground_m: float


@dataclass(frozen=True, eq=False)
class Painting:
    """A painted image, and the truth about it.

    `pixels` uint8 (H, W, 3) RGB is None where nothing is visible. `mask` int32 (H, W) has the
    number of the body that covers most of a pixel, -1 where that is none. `visible_fractions`
    float64 (N,) are the visible shares of each body, NaN outside of the image.
    """

    pixels: npt.NDArray[np.uint8] | None
    mask: Indices
    visible_fractions: npt.NDArray[np.float64]


class Painter:
    """Paints what one camera sees. Its rays are computed once.

    Bodies are painted from coarser surfaces, no point of which is moved by more than `tolerance_px`
    as seen from the distance of the body's box; 0: from their own. In the middle of the image this
    is so of any lens. Towards the edge of a flat image pixels see smaller angles, so it can be more
    there: by 1 / cos of the angle from the axis.
    """

    def __init__(self, view: PinholeView | FisheyeView, tolerance_px: float = 1.0) -> None:
        self.view = view
        self._tolerance_rad = tolerance_px / max(view.fx, view.fy)
        height, width = view.height, view.width
        self._layer = np.zeros((height, 4 * width), dtype=np.float32)
        self._shadow_left = np.ones((height, width), dtype=np.float32)
        self._marks = np.zeros((height, -(-width // WIDE)), dtype=np.uint8)
        self._band = make_band(width)
        self._least = np.zeros(WIDE * self._band.shape[1], dtype=np.float32)
        self._faces = Faces.room(0)
        self._surfaces = _SurfaceSet()

    @cached_property
    def rays(self) -> Floats:
        """The unit rays of the pixels, float32 (H, W, 3), zero where there is none."""
        return self.view.directions()

    @cached_property
    def _flat_rays(self) -> Floats:
        """The same, float32 (3, H, W)."""
        return np.ascontiguousarray(self.rays.transpose(2, 0, 1))

    @cached_property
    def samples(self) -> Floats:
        """The unit rays of the samples, in blocks; see `rasterizing`."""
        return sample_rays(self.rays)

    def prepare(self) -> None:
        """Compute the rays now, not when the first image comes."""
        _ = self._flat_rays, self.samples, self._planes, self._small_bulge_px

    def paint(
        self,
        pixels: npt.NDArray[np.uint8],
        map_from_camera: RigidTransform,
        bodies: Sequence[PaintedBody],
        real_m: Floats,
        lighting: Lighting,
        random: np.random.Generator,
    ) -> Painting:
        """Return the image (H, W, 3), RGB, with the bodies.

        `real_m` float32 (H, W) are the ranges of what is really there, inf where nothing is.
        """
        mask = np.full((self.view.height, self.view.width), -1, dtype=np.int32)
        boxes = _Boxes.of(bodies)
        met, seen = self._draw(bodies, boxes, map_from_camera, real_m, lighting, mask)
        fractions = np.where(met > 0, seen / np.maximum(met, 1), np.nan)
        painted = None
        if seen.any():
            if lighting.shadow > 0.0:
                casting = _Boxes(*(numbers[seen > 0] for numbers in boxes))
                self._cast_shadows(casting, map_from_camera, real_m, lighting.shadow)
            painted = self._composed(pixels, lighting, random)
        clear(self._layer, self._shadow_left, self._marks)
        return Painting(painted, mask, fractions)

    def _draw(
        self,
        bodies: Sequence[PaintedBody],
        boxes: "_Boxes",
        map_from_camera: RigidTransform,
        real_m: Floats,
        lighting: Lighting,
        mask: Indices,
    ) -> npt.NDArray[np.int64]:
        """Draw all bodies into the layer and the mask.

        Return how many samples meet each, hidden or not, and how many see it, int64 (2, N).
        """
        counts = np.zeros((2, len(bodies)), dtype=np.int64)
        map_from_optical = map_from_camera.rotation_matrix()
        apart_m = boxes.centres_m - map_from_camera.translation_m
        near = np.flatnonzero(self._may_see(boxes, apart_m, map_from_optical))
        turns, apart_m = boxes.turns[near], apart_m[near]
        cameras_m = -product(apart_m[:, np.newaxis], turns)[:, 0]
        away_m = np.maximum(np.abs(cameras_m) - boxes.half_sizes_m[near], 0.0)
        tolerances_m = self._tolerance_rad * np.sqrt((away_m * away_m).sum(axis=1))
        surfaces = [bodies[k].surface for k in near.tolist()]
        self._surfaces.hold([s.within(m) for s, m in zip(surfaces, tolerances_m, strict=True)])
        corners = self._surfaces.corners
        if len(corners.indices) >= len(self._faces.owners):
            self._faces = Faces.room(len(corners.indices))
        poses = np.empty((len(near), 3, 4))
        poses[:, :, :3] = product(map_from_optical.T, turns)
        poses[:, :, 3] = product(apart_m, map_from_optical)
        points = np.empty((len(corners.points_m), 3))
        place_points(corners, poses, points)
        places = self.view.project(points)
        lights = np.empty((len(near), 3, 3))
        lights[:, :2], lights[:, 2] = _lights(lighting)
        lights[:, :2] = product(lights[:, :2], turns)
        heights_m = np.empty((len(near), 2), dtype=np.float32)
        heights_m[:, 0], heights_m[:, 1] = map_from_camera.translation_m[2], boxes.grounds_m[near]
        bands = -(-self.view.height // ROWS)
        render(
            corners,
            points,
            places,
            self._bulges(points, places, corners.indices),
            self._planes,
            near.astype(np.int32),
            cameras_m,
            lights,
            heights_m,
            map_from_optical[2].astype(np.float32),
            self._flat_rays,
            self.samples,
            real_m,
            self._surfaces.textures,
            _LINEAR,
            self._faces,
            np.empty((len(near), bands + 1), dtype=np.int32),
            np.empty((len(near), bands + 1, 2), dtype=np.int32),
            np.full(self._band.shape[1], -1, dtype=np.int32),
            self._least,
            self._band,
            self._marks,
            mask,
            counts[0],
            counts[1],
            self._layer,
        )
        return counts

    def _bulges(
        self,
        points: npt.NDArray[np.float64],
        pixels: npt.NDArray[np.float64],
        indices: Indices,
    ) -> npt.NDArray[np.float64]:
        """Return how far the sides of triangles bulge in the image [px], (F,), or (0,) for none."""
        if self.view.is_straight:
            return np.empty(0)
        ends = pixels[indices]
        bulges = np.full(len(indices), self._small_bulge_px)
        with np.errstate(invalid="ignore"):
            is_large = ~((ends.max(axis=1) - ends.min(axis=1)).max(axis=1) <= _SMALL_PX)
        corners, ends = points[indices[is_large]], ends[is_large]
        bulges[is_large] = self._measured_bulges(corners, ends)
        return bulges

    def _measured_bulges(
        self, corners: npt.NDArray[np.float64], ends: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float64]:
        """Return twice how far the middles of sides are from the straight lines [px], (F,)."""
        middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
        between = self.view.project(middles.reshape(-1, 3)).reshape(-1, 3, 2)
        straight = 0.5 * (ends + np.roll(ends, -1, axis=1))
        bulges: npt.NDArray[np.float64] = 2.0 * np.abs(between - straight).max(axis=(1, 2))
        return bulges

    @cached_property
    def _small_bulge_px(self) -> float:
        """How far the sides of triangles no larger than `_SMALL_PX` bulge, anywhere in the image.

        Half as much again as the most that is measured, at right triangles of that size everywhere.
        """
        rays = self.rays.astype(np.float64)
        step = _SMALL_PX
        if min(rays.shape[:2]) <= step:
            return float(step)
        corners = np.stack(
            (rays[:-step, :-step], rays[step:, :-step], rays[:-step, step:]), axis=2
        )[::4, ::4].reshape(-1, 3, 3)
        corners = corners[np.all(corners.any(axis=2), axis=1)]
        ends = self.view.project(corners.reshape(-1, 3)).reshape(-1, 3, 2)
        measured = self._measured_bulges(corners, ends)
        return 1.5 * float(np.nanmax(measured, initial=0.0))

    @cached_property
    def _cone(self) -> tuple[npt.NDArray[np.float64], float]:
        """The mean ray (3,), and the greatest angle of a ray from it [rad]."""
        rays = self.rays[self.rays.any(axis=2)].astype(np.float64)
        axis = rays.sum(axis=0)
        axis /= max(float(np.linalg.norm(axis)), 1e-12)
        return axis, math.acos(np.clip(product(rays, axis).min(), -1.0, 1.0))

    @cached_property
    def _planes(self) -> npt.NDArray[np.float64]:
        """Planes (P, 3) that have all rays on their positive side: of a straight view its edges."""
        axis, widest_rad = self._cone
        if not self.view.is_straight:
            return axis[np.newaxis] if widest_rad < 0.5 * math.pi else np.empty((0, 3))
        corners = self.rays[[0, 0, -1, -1], [0, -1, -1, 0]].astype(np.float64)
        planes = np.cross(corners, np.roll(corners, -1, axis=0))
        planes *= np.sign(product(planes, axis))[:, np.newaxis]
        planes /= np.linalg.norm(planes, axis=1, keepdims=True)
        return planes + _MARGIN * axis  # the samples lie beyond the rays of the outermost pixels

    def _may_see(
        self,
        boxes: "_Boxes",
        apart_m: npt.NDArray[np.float64],
        map_from_optical: npt.NDArray[np.float64],
    ) -> npt.NDArray[np.bool_]:
        """Tell whether a ray may meet the ball around each box, which is so far apart (N, 3)."""
        axis, widest_rad = self._cone
        away_m = np.maximum(np.linalg.norm(apart_m, axis=1), 1e-12)
        radii_m = np.linalg.norm(boxes.half_sizes_m, axis=1)
        along_m = product(apart_m, product(map_from_optical, axis))
        aside_rad = np.arccos(np.clip(along_m / away_m, -1.0, 1.0))
        ball_rad = np.arcsin(np.minimum(radii_m / away_m, 1.0))
        is_near = aside_rad - ball_rad <= widest_rad + _MARGIN
        seen: npt.NDArray[np.bool_] = (away_m <= radii_m) | is_near
        return seen

    def _cast_shadows(
        self,
        boxes: "_Boxes",
        map_from_camera: RigidTransform,
        real_m: Floats,
        strength: float,
    ) -> None:
        """Darken the floor around bodies."""
        size, count = np.array((self.view.width, self.view.height)), len(boxes.grounds_m)
        reaches_m = np.hypot(boxes.half_sizes_m[:, 0], boxes.half_sizes_m[:, 1]) + _SHADOW_M
        rings = np.empty((count, len(_RING), 3))
        rings[:, :, :2] = reaches_m[:, np.newaxis, np.newaxis] * _RING
        rings[:, :, :2] += boxes.centres_m[:, np.newaxis, :2]
        rings[:, :, 2] = boxes.grounds_m[:, np.newaxis]
        points = map_from_camera.inverse().apply(rings.reshape(-1, 3))
        pixels = self.view.project(points).reshape(count, -1, 2)
        low, high = pixels.min(axis=1), pixels.max(axis=1)
        is_known = np.isfinite(low + high)  # else the ring may reach behind the camera
        low = np.where(is_known.all(axis=1, keepdims=True), np.floor(low), 0)
        high = np.where(is_known.all(axis=1, keepdims=True), np.ceil(high) + 1, size)
        windows = np.concatenate((np.clip(low, 0, size), np.clip(high, 0, size)), axis=1)
        level = boxes.turns[:, :2, 0]  # the box's x axis in the map's plane
        level = level / np.linalg.norm(level, axis=1, keepdims=True)
        foots = np.empty((count, 7), dtype=np.float32)
        places_m = np.column_stack((boxes.centres_m[:, :2], boxes.grounds_m))
        foots[:, :3] = places_m - map_from_camera.translation_m  # float32 is coarse far away
        foots[:, 3:5] = level
        foots[:, 5:] = boxes.half_sizes_m[:, :2]
        turn, share = map_from_camera.rotation_matrix().astype(np.float32), np.float32(strength)
        left, marks = self._shadow_left, self._marks
        for window, foot in zip(windows.astype(np.int32), foots, strict=True):
            darken(self._flat_rays, window, turn, foot, real_m, share, left, marks)

    def _composed(
        self, pixels: npt.NDArray[np.uint8], lighting: Lighting, random: np.random.Generator
    ) -> npt.NDArray[np.uint8]:
        """Return the image with what is painted; what neither layer nor shadow touches is kept."""
        painted: npt.NDArray[np.uint8] = pixels.copy()
        gain = np.full(3, lighting.brightness, dtype=np.float32)
        if lighting.is_estimated:
            mean = np.empty(3, dtype=np.float32)
            mean_light(painted, _LINEAR, mean)
            whole = float(mean.mean())
            gain *= np.sqrt(np.maximum(mean, 1e-4) / max(whole, 1e-4))
            gain *= min(max(whole / _GREY, _DARKEST), _BRIGHTEST)
        taps = _taps(lighting.blur_px)
        compose(
            self._layer,
            self._shadow_left,
            self._marks,
            taps,
            gain,
            np.float32(lighting.noise),
            random.integers(2**64, dtype=np.uint64),
            _LINEAR,
            _SRGB,
            np.empty((2, self._marks.shape[1]), dtype=np.uint8),
            np.empty((2, 4 * (self.view.width + len(taps))), dtype=np.float32),
            painted,
        )
        return painted


class _Boxes(NamedTuple):
    """The boxes of N bodies in the map's frame.

    Rotations (N, 3, 3), centres and half sizes (N, 3), and the heights of their grounds (N,) [m].
    """

    turns: npt.NDArray[np.float64]
    centres_m: npt.NDArray[np.float64]
    half_sizes_m: npt.NDArray[np.float64]
    grounds_m: npt.NDArray[np.float64]

    @classmethod
    def of(cls, bodies: Sequence[PaintedBody]) -> "_Boxes":
        """Return the boxes of bodies."""
        return cls(
            np.array([body.map_from_box.rotation_matrix() for body in bodies]).reshape(-1, 3, 3),
            np.array([body.map_from_box.translation_m for body in bodies]).reshape(-1, 3),
            np.array([body.half_sizes_m for body in bodies]).reshape(-1, 3),
            np.array([body.ground_m for body in bodies], dtype=np.float64),
        )


class _SurfaceSet:
    """The surfaces in an image, packed anew only when they are others."""

    def __init__(self) -> None:
        self._held: list[Surface] = []
        self._pack()

    def hold(self, surfaces: list[Surface]) -> None:
        """Pack surfaces, unless they are packed already."""
        is_held = len(surfaces) == len(self._held) and all(
            one is other for one, other in zip(surfaces, self._held, strict=True)
        )
        if not is_held:
            self._held = surfaces
            self._pack()

    def _pack(self) -> None:
        held = self._held
        sizes = [(len(one.points_m), len(one.indices), one.texture.size) for one in held]
        starts = np.cumsum([(0, 0, 0), *sizes], axis=0)
        self.corners = Corners(
            starts[:, :2].copy(),
            np.array([one.is_closed for one in held], dtype=np.bool_),
            _joined([one.points_m for one in held], (0, 3), np.float32),
            _joined(
                [one.indices + start for one, start in zip(held, starts[:, 0], strict=False)],
                (0, 3),
                np.int32,
            ),
            _joined([one.normals for one in held], (0, 3, 3), np.float32),
            _joined([one.colours for one in held], (0, 3, 3), np.float32),
            _joined([one.uvs for one in held], (0, 3, 2), np.float32),
        )
        places = [
            (start, *one.texture.shape[:2]) for one, start in zip(held, starts[:, 2], strict=False)
        ]
        self.textures = Textures(
            _joined([one.texture.reshape(-1) for one in held], (0,), np.uint8),
            np.array(places, dtype=np.int64).reshape(-1, 3),
        )


def _joined(arrays: list[Any], shape: tuple[int, ...], kind: type[np.generic]) -> Any:
    """Return arrays one after the other, of a shape with no rows if there are none."""
    return np.concatenate([np.empty(shape, dtype=kind), *arrays], dtype=kind, casting="same_kind")


def _lights(lighting: Lighting) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the directions to the lamp and up in the map's frame (2, 3), and the strengths (3,).

    These are of the lamp, of the sky above, and of the ground below.
    """
    level = math.cos(lighting.elevation_rad)
    lamp = (
        level * math.cos(lighting.azimuth_rad),
        level * math.sin(lighting.azimuth_rad),
        math.sin(lighting.elevation_rad),
    )
    return np.array((lamp, (0.0, 0.0, 1.0))), np.array((0.55, 0.5, 0.28))


@lru_cache(maxsize=4)
def _taps(blur_px: float) -> Floats:
    """Return the weights of a Gaussian blur, float32 (2 R + 1,)."""
    radius = math.ceil(3.0 * blur_px)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / max(blur_px, 1e-6)) ** 2)
    taps: Floats = (weights / weights.sum()).astype(np.float32)
    return taps
