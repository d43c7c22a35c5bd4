"""View models: which ray each pixel of a camera looks along (F_view, section 3.3).

Directions are in the optical frame of REP 103: z forward, x right, y down. Pixel centres have
integer coordinates, as in OpenCV and image_geometry. Models are values: two made from the same
numbers are equal, and the rays are computed once, when first asked for.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from are_ros.errors import ParameterError
from are_ros.world import _distortion
from are_ros.world._image_rays import Rays, image_plane, unit_rays


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
