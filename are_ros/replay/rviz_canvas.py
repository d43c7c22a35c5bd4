"""A small software renderer: triangles with a depth buffer, drawn large and then reduced."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.replay.rviz_camera import RvizCamera

Floats = npt.NDArray[np.float64]
Image = npt.NDArray[np.float32]
Rgb = tuple[float, float, float]

_ROWS_AT_ONCE: Final = 256
_LIGHT: Final = np.array((-0.45, -0.75, -0.5)) / np.linalg.norm((-0.45, -0.75, -0.5))
"""Towards the light, in the camera's frame: from the upper left, from behind the viewer."""

_AMBIENT, _DIFFUSE = 0.5, 0.55


@dataclass(frozen=True, eq=False)
class Triangles:
    """Corners (T, 3, 3) [m] in the fixed frame, and colours (T, 4) in 0 to 1, flatly lit or not."""

    corners_m: Floats
    colours: Floats
    lit: bool = True

    @property
    def is_opaque(self) -> bool:
        """Tell whether nothing shines through."""
        return bool((self.colours[:, 3] > 0.9998).all())


class Canvas:
    """Colours float32 (h, w, 3) in 0 to 1, and the nearness of what is there (h, w)."""

    def __init__(self, camera: RvizCamera, background: Rgb) -> None:
        self.camera = camera
        shape = (camera.height, camera.width)
        self.colours: Image = np.empty((*shape, 3), np.float32)
        self.colours[:] = background
        self.nearness: Image = np.full(shape, -np.inf, np.float32)

    def floor(self, image: npt.NDArray[np.uint8], cell_m: float, grid_from_fixed: Floats) -> None:
        """Lay an RGBA image (h, w, 4), a pixel per cell, into the plane z = 0 of its own frame.

        `grid_from_fixed` is the (4, 4) transform. The floor hides nothing.
        """
        turn, shift = grid_from_fixed[:3, :3], grid_from_fixed[:3, 3]
        height, width = image.shape[:2]
        for row in range(0, self.camera.height, _ROWS_AT_ONCE):
            rows = slice(row, min(row + _ROWS_AT_ONCE, self.camera.height))
            starts, ways = self.camera.rays(rows)
            starts, ways = starts @ turn.T + shift, ways @ turn.T
            with np.errstate(divide="ignore", invalid="ignore"):
                share = -starts[..., 2] / ways[..., 2]
                hits = starts[..., :2] + share[..., np.newaxis] * ways[..., :2]
            hits = np.where((share > 0.0)[..., np.newaxis], hits, -1.0) / cell_m
            inside = ((hits >= 0.0) & (hits < (width, height))).all(axis=-1)
            cols, lines = hits[inside].astype(np.int64).T
            texels = image[lines, cols].astype(np.float32) / 255.0
            part = self.colours[rows]
            part[inside] += texels[:, 3:] * (texels[:, :3] - part[inside])

    def lines(self, ends_m: Floats, colour: Rgb, alpha: float, width_px: int = 1) -> None:
        """Draw lines (L, 2, 3) that hide nothing; what is behind the camera is cut off."""
        import cv2

        mask = np.zeros(self.nearness.shape, np.uint8)
        for ends in ends_m:
            pixels, near = self.camera.project(_in_front(self.camera, ends))
            if np.isfinite(near).all() and np.abs(pixels).max() < 1e6:
                fixed = np.rint(pixels * 16.0).astype(np.int64).tolist()
                cv2.line(mask, fixed[0], fixed[1], 255, width_px, cv2.LINE_AA, 4)
        self.blend(mask, (slice(None), slice(None)), colour, alpha, np.inf)

    def blend(
        self,
        mask: npt.NDArray[np.uint8],
        window: tuple[slice, slice],
        colour: Rgb,
        alpha: float,
        near: float,
    ) -> None:
        """Lay a colour over where a mask (0 to 255) of a window says, unless hidden there."""
        rows, cols = np.nonzero(mask)
        if not len(rows):
            return
        part, depths = self.colours[window], self.nearness[window]
        seen = near >= depths[rows, cols]
        rows, cols = rows[seen], cols[seen]
        share = (alpha / 255.0) * mask[rows, cols].astype(np.float32)[:, np.newaxis]
        part[rows, cols] += share * (np.array(colour, np.float32) - part[rows, cols])

    def solid(self, shape: Triangles) -> None:
        """Draw triangles; translucent ones as one body, of which only the front is seen."""
        seen = self._seen(shape)
        if seen is None:
            return
        if shape.is_opaque:
            _fill(seen, self.colours[seen.window], self.nearness[seen.window])
            return
        behind = self.nearness[seen.window]
        layer: Image = np.zeros((*behind.shape, 4), np.float32)
        front: Image = np.full(behind.shape, -np.inf, np.float32)
        _fill(seen, layer, front)
        share = np.where(front > behind, layer[..., 3], 0.0)[..., np.newaxis]
        self.colours[seen.window] += share * (layer[..., :3] - self.colours[seen.window])

    def reduced(self, factor: int) -> npt.NDArray[np.uint8]:
        """Return the picture as RGB, each pixel the mean of a block of `factor` x `factor`."""
        import cv2

        size = (self.camera.width // factor, self.camera.height // factor)
        small = cv2.resize(self.colours, size, interpolation=cv2.INTER_AREA)
        picture: npt.NDArray[np.uint8] = np.rint(255.0 * np.clip(small, 0.0, 1.0)).astype(np.uint8)
        return picture

    def _lit(self, shape: Triangles) -> Floats:
        """Return colours (T, 4) by Lambert's law, each face as if turned towards the viewer."""
        if not shape.lit:
            return shape.colours
        a, b, c = shape.corners_m.transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        facing = np.sum(normals * self.camera.towards(a), axis=1)
        normals = np.where(facing[:, np.newaxis] < 0.0, -normals, normals)
        shine = _AMBIENT + _DIFFUSE * np.maximum(normals @ (self.camera.rotation.T @ _LIGHT), 0.0)
        return np.column_stack((shape.colours[:, :3] * shine[:, np.newaxis], shape.colours[:, 3]))

    def _seen(self, shape: Triangles) -> "_Seen | None":
        """Return what of a shape lies within the picture, None if nothing does."""
        pixels, near = self.camera.project(shape.corners_m.reshape(-1, 3))
        pixels, near = pixels.reshape(-1, 3, 2), near.reshape(-1, 3)
        sides = np.array((self.camera.width, self.camera.height))
        low = np.ceil(pixels.min(axis=1) - 0.5).clip(0, sides).astype(np.int64)
        high = np.floor(pixels.max(axis=1) + 0.5).clip(0, sides).astype(np.int64)
        kept = np.isfinite(near).all(axis=1) & (high > low).all(axis=1)
        if not kept.any():
            return None
        corner, end = low[kept].min(axis=0), high[kept].max(axis=0)
        return _Seen(
            window=(slice(corner[1], end[1]), slice(corner[0], end[0])),
            pixels=pixels[kept] - corner - 0.5,
            near=near[kept],
            low=low[kept] - corner,
            high=high[kept] - corner,
            colours=self._lit(shape)[kept].astype(np.float32),
        )


@dataclass(frozen=True, eq=False)
class _Seen:
    """Triangles by pixels of a window of the picture: corners (T, 3, 2), their boxes (T, 2)."""

    window: tuple[slice, slice]
    pixels: Floats
    near: Floats
    low: npt.NDArray[np.int64]
    high: npt.NDArray[np.int64]
    colours: Image


def _fill(seen: _Seen, target: Image, nearness: Image) -> None:
    """Fill triangles into buffers of their window."""
    colours = seen.colours[:, : target.shape[2]]
    for i, (low, high) in enumerate(zip(seen.low.tolist(), seen.high.tolist(), strict=True)):
        part = (slice(low[1], high[1]), slice(low[0], high[0]))
        corners = (seen.pixels[i] - low).tolist()
        _fill_one(corners, seen.near[i].tolist(), colours[i], target[part], nearness[part])


def _fill_one(
    corners: list[list[float]],
    near: list[float],
    colour: npt.NDArray[np.float32],
    target: Image,
    nearness: Image,
) -> None:
    """Fill one triangle, by pixels of the very part of the buffers."""
    (ax, ay), (bx, by), (cx, cy) = corners
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if abs(area) < 1e-9:
        return
    height, width = nearness.shape
    x, y = np.arange(width) - ax, (np.arange(height) - ay)[:, np.newaxis]
    second = (x * (cy - ay) - y * (cx - ax)) / area
    third = ((bx - ax) * y - (by - ay) * x) / area
    depth = near[0] + second * (near[1] - near[0]) + third * (near[2] - near[0])
    inside = (second >= 0.0) & (third >= 0.0) & (second + third <= 1.0) & (depth > nearness)
    target[inside] = colour
    nearness[inside] = depth[inside]


def _in_front(camera: RvizCamera, ends_m: Floats) -> Floats:
    """Return a segment (2, 3) cut off a little before the camera."""
    depths = (ends_m - camera.place_m) @ camera.rotation[2]
    order = np.argsort(depths)
    near_m, far_m = ends_m[order]
    least = 0.2
    if depths[order[0]] >= least or depths[order[1]] <= least:
        return ends_m
    share = (least - depths[order[0]]) / (depths[order[1]] - depths[order[0]])
    return np.stack((near_m + share * (far_m - near_m), far_m))
