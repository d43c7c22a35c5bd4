"""View models: which ray each pixel of a camera looks along (F_view, section 3.3).

Directions are in the optical frame of REP 103: z forward, x right, y down. Pixel centres have
integer coordinates, as in OpenCV and image_geometry. Models are values: two made from the same
numbers are equal, and the rays are computed once, when first asked for.
"""

import math
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from are_ros.errors import ParameterError
from are_ros.world import _distortion

Rays = npt.NDArray[np.float32]


def image_plane(
    width: int, height: int, fx: float, fy: float, cx: float, cy: float
) -> npt.NDArray[np.float64]:
    """Return (u - cx) / fx and (v - cy) / fy per pixel, (height, width, 2)."""
    columns, rows = (np.arange(width) - cx) / fx, (np.arange(height) - cy) / fy
    plane: npt.NDArray[np.float64] = np.stack(np.meshgrid(columns, rows), axis=2)
    return plane


def unit_rays(rays: npt.NDArray[np.float64]) -> Rays:
    """Return rays (H, W, 3) scaled to length 1, float32 and read-only; NaN becomes zero."""
    unit = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    unit[~np.isfinite(unit).all(axis=2)] = 0.0
    result: Rays = unit.astype(np.float32)
    result.flags.writeable = False
    return result


class ViewModel(Protocol):
    """What a camera is to the occlusion: a size in pixels and a ray for each."""

    @property
    def width(self) -> int:
        """Columns."""

    @property
    def height(self) -> int:
        """Rows."""

    def directions(self) -> Rays:
        """Return the unit rays, float32 (height, width, 3), read-only; zero where there is none."""


@dataclass(frozen=True)
class PinholeView:
    """A camera with a flat image, possibly distorted: plumb_bob, rational_polynomial, thin prism.

    `distortion` is empty or has OpenCV's 14 coefficients. `rectified_from_camera` is empty, or the
    row-major rotation R of a rectified image, whose rays are turned back into the camera's frame. A
    pixel that the lens model gives no ray (its inverse does not converge, or lies where the model
    folds back) has a zero direction and sees nothing.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    rectified_from_camera: tuple[float, ...] = ()

    @classmethod
    def from_field_of_view(cls, width: int, height: int, hfov_rad: float) -> "PinholeView":
        """Return an undistorted camera with square pixels and a horizontal field of view.

        Raises ParameterError unless the size is positive and 0 < hfov < pi.
        """
        if width < 1 or height < 1 or not 0.0 < hfov_rad < math.pi:
            message = (
                f"a pinhole camera needs a positive size and a field of view between 0 and pi, "
                f"not {width} x {height} pixels and {hfov_rad} rad"
            )
            raise ParameterError(message)
        focal = 0.5 * width / math.tan(0.5 * hfov_rad)
        return cls(width, height, focal, focal, 0.5 * (width - 1), 0.5 * (height - 1))

    def directions(self) -> Rays:
        """Return the unit rays; see `ViewModel`."""
        return self._directions

    def _rotation(self) -> npt.NDArray[np.float64]:
        numbers = self.rectified_from_camera
        return np.array(numbers).reshape(3, 3) if numbers else np.eye(3)

    @cached_property
    def _directions(self) -> Rays:
        slopes = self._slopes()
        rays = np.concatenate((slopes, np.ones((*slopes.shape[:2], 1))), axis=2)
        return unit_rays(rays @ self._rotation())

    def _slopes(self) -> npt.NDArray[np.float64]:
        """Return x / z and y / z per pixel, (height, width, 2), NaN where there is no ray."""
        distorted = image_plane(self.width, self.height, self.fx, self.fy, self.cx, self.cy)
        if not any(self.distortion):
            return distorted
        numbers = np.array(self.distortion)
        limit = _distortion.radial_limit(numbers)
        slopes = _distortion.undistort_points(distorted.reshape(-1, 2), numbers, limit)
        return slopes.reshape(distorted.shape)


@dataclass(frozen=True)
class FisheyeView:
    """A camera whose image radius grows with the angle off the axis (`equidistant`), up to pi.

    `distortion` holds k1 to k4. A pixel whose radius lies beyond the largest that the polynomial
    reaches has a zero direction and sees nothing.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def directions(self) -> Rays:
        """Return the unit rays; see `ViewModel`."""
        return self._directions

    @cached_property
    def _directions(self) -> Rays:
        plane = image_plane(self.width, self.height, self.fx, self.fy, self.cx, self.cy)
        radii = np.hypot(plane[:, :, 0], plane[:, :, 1])
        numbers = np.array(self.distortion)
        limit = _distortion.angular_limit(numbers)
        angles = _distortion.undistort_angles(radii.reshape(-1), numbers, limit)
        angles = angles.reshape(radii.shape)
        sideways = np.sin(angles) / np.maximum(radii, 1e-12)
        rays = (plane[:, :, 0] * sideways, plane[:, :, 1] * sideways, np.cos(angles))
        return unit_rays(np.stack(rays, axis=2))


class Projection(Enum):
    """How the rows of an omnidirectional image go: equal angles, or equal heights on a cylinder."""

    SPHERE = "sphere"
    CYLINDER = "cylinder"


@dataclass(frozen=True)
class OmnidirectionalView:
    """A camera that sees all around: columns are azimuths over 360 degrees, rows elevations.

    The middle of the image looks along z (forward), azimuth grows to the right; the seam is behind.
    Elevation is positive upwards (against y) [rad] and falls from the top edge of the image to the
    bottom edge, evenly in angle (SPHERE) or in tangent (CYLINDER). Raises ParameterError unless the
    size is positive and -pi/2 <= lowest < highest <= pi/2 (without the ends for a cylinder).
    """

    width: int
    height: int
    lowest_rad: float
    highest_rad: float
    projection: Projection = Projection.SPHERE

    def __post_init__(self) -> None:
        end = 0.5 * math.pi - (1e-3 if self.projection is Projection.CYLINDER else 0.0)
        ordered = -end <= self.lowest_rad < self.highest_rad <= end
        if self.width < 1 or self.height < 1 or not ordered:
            message = (
                f"an omnidirectional camera ({self.projection.value}) needs a positive size and "
                f"elevations within {end:.4g} rad, not {self.width} x {self.height} pixels "
                f"from {self.lowest_rad} to {self.highest_rad}"
            )
            raise ParameterError(message)

    def directions(self) -> Rays:
        """Return the unit rays; see `ViewModel`."""
        return self._directions

    @cached_property
    def _directions(self) -> Rays:
        azimuth, elevation = self._angles()
        level = np.cos(elevation)[:, np.newaxis]
        down = np.broadcast_to(-np.sin(elevation)[:, np.newaxis], (self.height, self.width))
        return unit_rays(np.stack((level * np.sin(azimuth), down, level * np.cos(azimuth)), axis=2))

    def _angles(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return the azimuths of the columns and the elevations of the rows [rad]."""
        azimuth = ((np.arange(self.width) + 0.5) / self.width - 0.5) * 2.0 * math.pi
        fraction = (np.arange(self.height) + 0.5) / self.height
        if self.projection is Projection.SPHERE:
            return azimuth, self.highest_rad + fraction * (self.lowest_rad - self.highest_rad)
        top, bottom = math.tan(self.highest_rad), math.tan(self.lowest_rad)
        return azimuth, np.arctan(top + fraction * (bottom - top))
