"""Paints artefacts into an image: hidden to the pixel by what is really there, with its light."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from are_ros.builder.rendering.kernels import (
    SAMPLES,
    blend,
    bound,
    cover,
    darken,
    draw,
    merge,
    shade,
)
from are_ros.builder.rendering.surface import Surface, to_linear, to_srgb
from are_ros.world.cameras import FisheyeView, PinholeView
from are_ros.world.rigid_transform import RigidTransform

Floats = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int32]

_LINEAR: Final = to_linear(np.arange(256) / 255.0).astype(np.float32)
_SRGB: Final = np.rint(255.0 * to_srgb(np.arange(4096) / 4095.0)).astype(np.uint8)
_GREY: Final = 0.22
"""The mean linear intensity of the picture of a place that is lit with strength 1."""
_SHADOW_M: Final = 0.5
"""A shadow reaches as far from the body's box."""
_DARKEST, _BRIGHTEST = 0.1, 1.6
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
    """Paints what one camera sees. Its rays are computed once."""

    def __init__(self, view: PinholeView | FisheyeView) -> None:
        self.view = view
        rows, columns = SAMPLES * view.height, SAMPLES * view.width
        self._ranges = np.full((rows, columns), np.inf, dtype=np.float32)
        self._faces = np.zeros((rows, columns), dtype=np.int32)
        self._front = np.full((rows, columns), np.inf, dtype=np.float32)
        self._front_body = np.full((rows, columns), -1, dtype=np.int32)
        self._front_face = np.zeros((rows, columns), dtype=np.int32)

    @cached_property
    def rays(self) -> Floats:
        """The unit rays of the pixels, float32 (H, W, 3), zero where there is none."""
        return self.view.directions()

    @cached_property
    def sample_rays(self) -> Floats:
        """The unit rays of the samples, float32 (3, 2 H, 2 W), zero where a pixel has none."""
        whole = self.rays.astype(np.float64)
        has_ray = whole.any(axis=2)
        for axis in (0, 1):
            before, after = np.roll(whole, 1, axis), np.roll(whole, -1, axis)
            first: list[slice | int] = [slice(None), slice(None)]
            last = list(first)
            first[axis], last[axis] = 0, -1
            inner, outer = list(first), list(last)
            inner[axis], outer[axis] = min(1, whole.shape[axis] - 1), -min(2, whole.shape[axis])
            before[tuple(first)] = 2.0 * whole[tuple(first)] - whole[tuple(inner)]
            after[tuple(last)] = 2.0 * whole[tuple(last)] - whole[tuple(outer)]
            # Beyond the edge of a lens's image there is no ray: the pixel's own serves.
            before[~before.any(axis=2)] = whole[~before.any(axis=2)]
            after[~after.any(axis=2)] = whole[~after.any(axis=2)]
            parts = (0.75 * whole + 0.25 * before, 0.75 * whole + 0.25 * after)
            shape = list(whole.shape)
            shape[axis] *= 2
            whole = np.stack(parts, axis=axis + 1).reshape(shape)
        whole[~np.repeat(np.repeat(has_ray, SAMPLES, 0), SAMPLES, 1)] = 0.0
        lengths = np.linalg.norm(whole, axis=2, keepdims=True)
        unit = (whole / np.maximum(lengths, 1e-12)).astype(np.float32)
        rays: Floats = np.ascontiguousarray(unit.transpose(2, 0, 1))
        return rays

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
        drawn = [self._drawn(k, body, map_from_camera, real_m) for k, body in enumerate(bodies)]
        layer = np.zeros((self.view.height, self.view.width, 4), dtype=np.float32)
        light = _light(lighting, map_from_camera)
        fractions = np.full(len(bodies), np.nan)
        touched = [window for window, met, _ in drawn if met]
        for k, (window, met, planes) in enumerate(drawn):
            surface = bodies[k].surface
            if met:
                turn = (map_from_camera.inverse() @ bodies[k].map_from_box).rotation_matrix()
                normals = surface.normals @ turn.T.astype(np.float32)
                seen = shade(
                    self.rays,
                    self.sample_rays,
                    _of_pixels(window),
                    k,
                    planes,
                    normals,
                    surface.colours,
                    surface.uvs,
                    surface.texture,
                    _LINEAR,
                    light,
                    self._front_body,
                    self._front_face,
                    layer,
                )
                fractions[k] = seen / met
        mask = self._mask(touched)
        is_visible = bool((fractions > 0.0).any())
        if not is_visible:
            self._clear(touched)
            return Painting(None, mask, fractions)
        shadow = np.ones(layer.shape[:2], dtype=np.float32)
        if lighting.shadow > 0.0:
            for body, fraction in zip(bodies, fractions, strict=True):
                if fraction > 0.0:
                    self._shadow(body, map_from_camera, real_m, lighting.shadow, shadow)
        painted = _composed(pixels, layer, shadow, lighting, random)
        self._clear(touched)
        return Painting(painted, mask, fractions)

    def _drawn(
        self,
        number: int,
        body: PaintedBody,
        map_from_camera: RigidTransform,
        real_m: Floats,
    ) -> tuple[Indices, int, Floats]:
        """Draw a body; return its window of samples, how many of them meet it, and its planes."""
        surface, window = body.surface, np.zeros(4, dtype=np.int32)
        planes = np.empty((len(surface.indices), 9), dtype=np.float32)
        if not self._may_see(body, map_from_camera):
            return window, 0, planes
        corners = np.empty((len(surface.indices), 3, 3), dtype=np.float32)
        points = (map_from_camera.inverse() @ body.map_from_box).apply(
            surface.points_m.astype(np.float64)
        )
        bounds, window = bound(
            points,
            self.view.project(points),
            surface.indices,
            self._bulges(points, surface.indices),
            (self.view.width, self.view.height),
            self._planes,
            corners,
        )
        if window[0] >= window[2] or window[1] >= window[3]:
            return window, 0, planes
        is_closed = body.surface.is_closed
        draw(self.sample_rays, corners, bounds, is_closed, self._ranges, self._faces, planes)
        up = map_from_camera.rotation_matrix()[2].astype(np.float32)
        heights = np.array((map_from_camera.translation_m[2], body.ground_m), dtype=np.float32)
        met = merge(
            self.rays,
            window,
            number,
            self._ranges,
            self._faces,
            real_m,
            up,
            heights,
            self._front,
            self._front_body,
            self._front_face,
        )
        return window, met, planes

    def _bulges(self, points: npt.NDArray[np.float64], indices: Indices) -> npt.NDArray[np.float64]:
        """Return how far the sides of triangles bulge in the image [px], (F,), or (0,) for none."""
        if self.view.is_straight:
            return np.empty(0)
        corners = points[indices]
        pixels = self.view.project(corners.reshape(-1, 3)).reshape(-1, 3, 2)
        middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
        between = self.view.project(middles.reshape(-1, 3)).reshape(-1, 3, 2)
        straight = 0.5 * (pixels + np.roll(pixels, -1, axis=1))
        bulges: npt.NDArray[np.float64] = 2.0 * np.abs(between - straight).max(axis=(1, 2))
        return bulges

    @cached_property
    def _cone(self) -> tuple[npt.NDArray[np.float64], float]:
        """The mean ray (3,), and the greatest angle of a ray from it [rad]."""
        rays = self.rays[self.rays.any(axis=2)].astype(np.float64)
        axis = rays.sum(axis=0)
        axis /= max(float(np.linalg.norm(axis)), 1e-12)
        return axis, math.acos(np.clip((rays @ axis).min(), -1.0, 1.0))

    @cached_property
    def _planes(self) -> npt.NDArray[np.float64]:
        """Planes (P, 3) that have all rays on their positive side: of a straight view its edges."""
        axis, widest_rad = self._cone
        if not self.view.is_straight:
            return axis[np.newaxis] if widest_rad < 0.5 * math.pi else np.empty((0, 3))
        corners = self.rays[[0, 0, -1, -1], [0, -1, -1, 0]].astype(np.float64)
        planes = np.cross(corners, np.roll(corners, -1, axis=0))
        planes *= np.sign(planes @ axis)[:, np.newaxis]
        planes /= np.linalg.norm(planes, axis=1, keepdims=True)
        return planes + _MARGIN * axis  # the samples lie beyond the rays of the outermost pixels

    def _may_see(self, body: PaintedBody, map_from_camera: RigidTransform) -> bool:
        """Tell whether a ray may meet the ball around a body's box."""
        axis, widest_rad = self._cone
        apart_m = body.map_from_box.translation_m - map_from_camera.translation_m
        away_m, radius_m = float(np.linalg.norm(apart_m)), float(np.linalg.norm(body.half_sizes_m))
        if away_m <= radius_m:
            return True
        cosine = float(apart_m @ (map_from_camera.rotation_matrix() @ axis)) / away_m
        aside_rad = math.acos(min(max(cosine, -1.0), 1.0)) - math.asin(radius_m / away_m)
        return aside_rad <= widest_rad + _MARGIN

    def _mask(self, windows: Sequence[Indices]) -> Indices:
        """Return which body covers most of each pixel."""
        mask = np.full((self.view.height, self.view.width), -1, dtype=np.int32)
        for window in windows:
            cover(_of_pixels(window), self._front_body, mask)
        return mask

    def _shadow(
        self,
        body: PaintedBody,
        map_from_camera: RigidTransform,
        real_m: Floats,
        strength: float,
        shadow: Floats,
    ) -> None:
        x, y, _ = body.map_from_box.translation_m.tolist()
        yaw = body.map_from_box.yaw_rad()
        half_x, half_y, _ = body.half_sizes_m.tolist()
        reach = math.hypot(half_x, half_y) + _SHADOW_M
        turns = np.linspace(0.0, math.tau, 16, endpoint=False)
        ring = np.column_stack(
            (x + reach * np.cos(turns), y + reach * np.sin(turns), np.full(16, body.ground_m))
        )
        pixels = self.view.project(map_from_camera.inverse().apply(ring))
        size = np.array((self.view.width, self.view.height))
        if np.isfinite(pixels).all():
            low, high = np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0)) + 1
            window = np.concatenate((np.clip(low, 0, size), np.clip(high, 0, size)))
        else:
            window = np.array((0, 0, *size))
        box = (x, y, body.ground_m, math.cos(yaw), math.sin(yaw), half_x, half_y)
        darken(
            self.rays,
            window.astype(np.int32),
            map_from_camera.translation_m.astype(np.float32),
            map_from_camera.rotation_matrix().astype(np.float32),
            np.array(box, dtype=np.float32),
            real_m,
            np.float32(strength),
            shadow,
        )

    def _clear(self, windows: Sequence[Indices]) -> None:
        for left, top, right, bottom in windows:
            self._front[top:bottom, left:right] = np.inf
            self._front_body[top:bottom, left:right] = -1


def _of_pixels(window: Indices) -> Indices:
    """Return the rectangle of pixels around one of samples."""
    low, high = window[:2] // SAMPLES, -(-window[2:] // SAMPLES)
    return np.concatenate((low, high)).astype(np.int32)


def _light(lighting: Lighting, map_from_camera: RigidTransform) -> Floats:
    """Return the directions to the lamp and up in the camera's frame, and the strengths."""
    level = math.cos(lighting.elevation_rad)
    lamp = (
        level * math.cos(lighting.azimuth_rad),
        level * math.sin(lighting.azimuth_rad),
        math.sin(lighting.elevation_rad),
    )
    into_camera = map_from_camera.rotation_matrix().T
    rows = (into_camera @ lamp, into_camera @ (0.0, 0.0, 1.0), (0.55, 0.5, 0.28))
    return np.array(rows, dtype=np.float32)


def _composed(
    pixels: npt.NDArray[np.uint8],
    layer: Floats,
    shadow: Floats,
    lighting: Lighting,
    random: np.random.Generator,
) -> npt.NDArray[np.uint8]:
    """Return the image with shadows and the layer over it; what neither touches keeps its bits."""
    gain = np.full(3, lighting.brightness, dtype=np.float32)
    if lighting.is_estimated:
        mean = _LINEAR[pixels[::4, ::4]].mean(axis=(0, 1))
        cast = np.sqrt(np.maximum(mean, 1e-4) / max(float(mean.mean()), 1e-4))
        gain *= np.clip(mean.mean() / _GREY, _DARKEST, _BRIGHTEST) * cast
    is_touched = (layer[:, :, 3] > 0.0) | (shadow < 0.999)
    marks = is_touched.view(np.uint8)  # their greatest is found quicker than whether any is set
    rows, columns = (np.flatnonzero(marks.max(axis=axis)) for axis in (1, 0))
    margin = math.ceil(3.0 * lighting.blur_px) if lighting.blur_px > 0.0 else 0
    top, left = max(int(rows.min()) - margin, 0), max(int(columns.min()) - margin, 0)
    part = slice(top, int(rows.max()) + margin + 1), slice(left, int(columns.max()) + margin + 1)
    over, kept = np.ascontiguousarray(layer[part]), np.ascontiguousarray(shadow[part])
    if lighting.blur_px > 0.0:
        sigma = lighting.blur_px
        over = cv2.GaussianBlur(over, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
        kept = cv2.GaussianBlur(kept, (0, 0), max(1.0, sigma), borderType=cv2.BORDER_REPLICATE)
    noise = np.zeros(over.shape[:2], dtype=np.float32)
    if lighting.noise > 0.0:
        is_covered = over[:, :, 3] > 0.0
        count = int(np.count_nonzero(is_covered))
        noise[is_covered] = lighting.noise * random.standard_normal(count, dtype=np.float32)
    painted: npt.NDArray[np.uint8] = pixels.copy()
    mixed = np.ascontiguousarray(painted[part])
    blend(over, np.ascontiguousarray(kept), gain.astype(np.float32), noise, _LINEAR, _SRGB, mixed)
    painted[part] = mixed
    return painted
