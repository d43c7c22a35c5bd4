"""Cameras over the scene: rviz's orbit view in perspective, and its top-down orthographic one."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

FIELD_OF_VIEW_RAD: Final = np.deg2rad(45.0)
"""The vertical angle of rviz's views."""

_NEAREST_M: Final = 0.05
_FAR_M: Final = 1e4


@dataclass(frozen=True, eq=False)
class RvizCamera:
    """Pixels (x right, y down) of points, and how near these are.

    `rotation` (3, 3) takes directions of the fixed frame into the camera's (x right, y down, z
    forward); `scale` is the focal length in pixels, or pixels per metre where it is orthographic.
    """

    rotation: Floats
    place_m: Floats
    scale: float
    width: int
    height: int
    is_perspective: bool

    @classmethod
    def orbit(
        cls,
        focus_m: Floats,
        distance_m: float,
        yaw_rad: float,
        pitch_rad: float,
        size: tuple[int, int],
    ) -> "RvizCamera":
        """Return the view of a point from so far behind (against `yaw_rad`) and above."""
        cos_p, sin_p = np.cos(pitch_rad), np.sin(pitch_rad)
        forward = np.array((np.cos(yaw_rad) * cos_p, np.sin(yaw_rad) * cos_p, -sin_p))
        right = np.array((np.sin(yaw_rad), -np.cos(yaw_rad), 0.0))
        rotation = np.stack((right, np.cross(forward, right), forward))
        width, height = size
        scale = 0.5 * height / float(np.tan(0.5 * FIELD_OF_VIEW_RAD))
        place = np.asarray(focus_m, dtype=np.float64) - distance_m * forward
        return cls(rotation, place, scale, width, height, is_perspective=True)

    @classmethod
    def top_down(cls, centre_m: Floats, pixels_per_m: float, size: tuple[int, int]) -> "RvizCamera":
        """Return the view from above, x to the right and y up."""
        rotation = np.array(((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)))
        place = np.array((centre_m[0], centre_m[1], 500.0))
        return cls(rotation, place, pixels_per_m, *size, is_perspective=False)

    def project(self, points_m: Floats) -> tuple[Floats, Floats]:
        """Return pixels (N, 2) and nearness (N,) of points (N, 3).

        Nearness is linear over the image of a plane, and greater for what is nearer; it is -inf
        behind the camera, where the pixels mean nothing.
        """
        local = (points_m - self.place_m) @ self.rotation.T
        depth = local[:, 2]
        behind = depth < _NEAREST_M
        safe = np.where(behind, 1.0, depth)
        factor = self.scale / safe if self.is_perspective else np.full(len(safe), self.scale)
        pixels = local[:, :2] * factor[:, np.newaxis] + (0.5 * self.width, 0.5 * self.height)
        near = 1.0 / safe if self.is_perspective else -depth / _FAR_M
        return pixels, np.where(behind, -np.inf, near)

    def pixels_per_m(self, points_m: Floats) -> Floats:
        """Return how many pixels a metre takes (N,), facing the camera at points (N, 3)."""
        depth = np.maximum((points_m - self.place_m) @ self.rotation[2], _NEAREST_M)
        return self.scale / depth if self.is_perspective else np.full(len(depth), self.scale)

    def rays(self, rows: slice) -> tuple[Floats, Floats]:
        """Return where the rays of some rows of pixels begin, and where to, (R, width, 3) each."""
        y, x = np.mgrid[rows, : self.width].astype(np.float64)
        x, y = (x + 0.5 - 0.5 * self.width) / self.scale, (y + 0.5 - 0.5 * self.height) / self.scale
        if self.is_perspective:
            local = np.stack((x, y, np.ones_like(x)), axis=-1)
            return np.broadcast_to(self.place_m, local.shape), local @ self.rotation
        aside = np.stack((x, y, np.zeros_like(x)), axis=-1) @ self.rotation
        return self.place_m + aside, np.broadcast_to(self.rotation[2], aside.shape)

    def towards(self, points_m: Floats) -> Floats:
        """Return unit vectors (N, 3) from points to the camera."""
        if not self.is_perspective:
            return np.broadcast_to(-self.rotation[2], points_m.shape)
        away = self.place_m - points_m
        lengths = np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        vectors: Floats = away / lengths
        return vectors
