"""Cameras: view models (pinhole, fisheye), undistortion, CameraInfo, and where they sit."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.errors import InputError, ParameterError
from are_ros.world.footprint import Footprint
from are_ros.world.rigid_transform import RigidTransform, product

_Floats = npt.NDArray[np.float64]

COEFFICIENTS: Final = 14
"""OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y (the last two are refused)."""

_STEPS: Final = 30
_CONVERGED: Final = 1e-9
_NEGLIGIBLE: Final = 1e-60
_FAR: Final = 1e3
"""Slope of the steepest ray that is kept: 89.94 degrees off the axis."""


def radial_limit(coefficients: npt.NDArray[np.float64]) -> float:
    """Return the slope r up to which the radial part r (1 + k1 r^2 ...) / (1 + k4 r^2 ...) grows.

    Beyond it the lens model folds back, and a pixel no longer has one ray. `coefficients` is
    float64 (14,) in OpenCV's order; the answer is at most `_FAR`.
    """
    k1, k2, _, _, k3, k4, k5, k6 = coefficients[:8]
    upper, lower = np.poly1d((k3, k2, k1, 1.0)), np.poly1d((k6, k5, k4, 1.0))
    s = np.poly1d((1.0, 0.0))
    slope = (upper + 2 * s * upper.deriv()) * lower - 2 * s * upper * lower.deriv()
    return min(_FAR, math.sqrt(min(_first_root(slope), _first_root(lower))))


def angular_limit(coefficients: npt.NDArray[np.float64]) -> float:
    """Return the angle [rad] up to which theta (1 + k1 theta^2 + ...) grows, at most pi."""
    k1, k2, k3, k4 = coefficients
    slope = np.poly1d((9 * k4, 7 * k3, 5 * k2, 3 * k1, 1.0))
    return min(math.pi, math.sqrt(_first_root(slope)))


def _first_root(polynomial: np.poly1d) -> float:
    """Return the least positive real root, inf if there is none."""
    weights = polynomial.coeffs
    roots = np.poly1d(np.where(np.abs(weights) < _NEGLIGIBLE, 0.0, weights)).roots
    real = roots.real[(np.abs(roots.imag) < 1e-9 * (1.0 + np.abs(roots))) & (roots.real > 0.0)]
    return float(real.min(initial=np.inf))


def undistort_points(points: _Floats, coefficients: _Floats, limit: float) -> _Floats:
    """Return the undistorted slopes (N, 2) of distorted ones (N, 2); NaN where there are none.

    `limit` is `radial_limit`. A solution must reproduce the point to 1e-9 and lie where the model
    is one to one: within the limit, with a positive Jacobian. Newton's method, for all points at
    once, from the inverse of the radial part.
    """
    radii = np.sqrt(points[:, 0] * points[:, 0] + points[:, 1] * points[:, 1])
    start = _radial_inverse(radii, coefficients, limit)
    scales = np.divide(start, radii, out=np.ones_like(radii), where=radii > 0.0)
    slopes, left = np.full_like(points, np.nan), np.arange(len(points))
    x, y = points[:, 0] * scales, points[:, 1] * scales
    for _ in range(_STEPS):
        du, dv, a, b, c, d = _distorted(x, y, coefficients)
        determinant = a * d - b * c
        error_u, error_v = du - points[left, 0], dv - points[left, 1]
        fails = ~(determinant > 0.0) | (x * x + y * y > limit * limit)
        is_solved = np.abs(error_u) + np.abs(error_v) < _CONVERGED * (1.0 + radii[left])
        is_solved &= ~fails
        slopes[left[is_solved], 0], slopes[left[is_solved], 1] = x[is_solved], y[is_solved]
        goes_on = ~(fails | is_solved)
        step_x = (d * error_u - b * error_v)[goes_on] / determinant[goes_on]
        step_y = (a * error_v - c * error_u)[goes_on] / determinant[goes_on]
        x, y, left = x[goes_on] - step_x, y[goes_on] - step_y, left[goes_on]
        if not len(left):
            break
    return slopes


def _radial_inverse(radii: _Floats, coefficients: _Floats, limit: float) -> _Floats:
    """Return the slopes (N,) whose radial distortion is `radii`; the limit if it is beyond."""

    def radius_and_slope(slopes: _Floats) -> tuple[_Floats, _Floats]:
        factor, change = _radial(slopes * slopes, coefficients)
        return slopes * factor, factor + 2.0 * slopes * slopes * change

    return _bracketed_newton(radius_and_slope, radii, limit)


def _bracketed_newton(
    function: Callable[[_Floats], tuple[_Floats, _Floats]], values: _Floats, limit: float
) -> _Floats:
    """Return where a function that grows on [0, limit] takes the values (N,).

    `function` returns its value and its derivative. Newton's method, and a bisection wherever it
    would leave the bracket.
    """
    found, left = np.minimum(values, 0.5 * limit), np.arange(len(values))
    low, high = np.zeros(len(values)), np.full(len(values), limit)
    for _ in range(_STEPS * 2):
        here = found[left]
        reached, slope = function(here)
        error = reached - values[left]
        low, high = np.where(error < 0.0, here, low), np.where(error < 0.0, high, here)
        with np.errstate(divide="ignore", invalid="ignore"):
            following = here - error / slope
        is_inside = (low < following) & (following < high)
        following = np.where(is_inside, following, 0.5 * (low + high))
        goes_on = np.abs(following - here) >= _CONVERGED
        found[left] = following
        low, high, left = low[goes_on], high[goes_on], left[goes_on]
        if not len(left):
            break
    return found


def _radial(s: _Floats, coefficients: _Floats) -> tuple[_Floats, _Floats]:
    """Return the radial factor and its derivative by s = r^2."""
    k1, k2, k3 = coefficients[0], coefficients[1], coefficients[4]
    k4, k5, k6 = coefficients[5], coefficients[6], coefficients[7]
    upper = 1.0 + s * (k1 + s * (k2 + s * k3))
    lower = 1.0 + s * (k4 + s * (k5 + s * k6))
    upper_slope = k1 + s * (2.0 * k2 + s * 3.0 * k3)
    lower_slope = k4 + s * (2.0 * k5 + s * 3.0 * k6)
    factor = upper / lower
    return factor, (upper_slope - factor * lower_slope) / lower


def _distorted(x: _Floats, y: _Floats, coefficients: _Floats) -> tuple[_Floats, ...]:
    """Return the distorted slopes of (x, y), and the Jacobian's entries row by row, (N,) each."""
    p1, p2 = coefficients[2], coefficients[3]
    s1, s2, s3, s4 = coefficients[8], coefficients[9], coefficients[10], coefficients[11]
    s = x * x + y * y
    factor, slope = _radial(s, coefficients)
    u = x * factor + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x) + s1 * s + s2 * s * s
    v = y * factor + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y + s3 * s + s4 * s * s
    prism_u, prism_v = 2.0 * (s1 + 2.0 * s2 * s), 2.0 * (s3 + 2.0 * s4 * s)
    cross = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    u_x = factor + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + prism_u * x
    v_y = factor + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + prism_v * y
    return u, v, u_x, cross + prism_u * y, cross + prism_v * x, v_y


def undistort_angles(radii: _Floats, coefficients: _Floats, limit_rad: float) -> _Floats:
    """Return the angles [rad] (N,) off the axis of equidistant image radii (N,).

    `limit_rad` is `angular_limit`; NaN where a radius lies beyond it.
    """
    outermost = _angular(np.array([limit_rad]), coefficients)[0]
    angles = _bracketed_newton(lambda theta: _angular(theta, coefficients), radii, limit_rad)
    return np.where(radii > outermost, np.nan, angles)


def _angular(theta: _Floats, coefficients: _Floats) -> tuple[_Floats, _Floats]:
    """Return the image radii of angles (N,), and their derivatives."""
    s = theta * theta
    k1, k2, k3, k4 = coefficients
    value = theta * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
    return value, 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)))


Rays = npt.NDArray[np.float32]


def image_plane(
    width: int, height: int, fx: float, fy: float, cx: float, cy: float
) -> npt.NDArray[np.float64]:
    """Return (u - cx) / fx and (v - cy) / fy per pixel, (height, width, 2)."""
    columns, rows = (np.arange(width) - cx) / fx, (np.arange(height) - cy) / fy
    plane: npt.NDArray[np.float64] = np.stack(np.meshgrid(columns, rows), axis=2)
    return plane


@lru_cache(maxsize=2)  # an image and its depth mostly have the same lens
def _undistorted_plane(
    width: int,
    height: int,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    distortion: tuple[float, ...],
) -> npt.NDArray[np.float64]:
    """Return x / z and y / z per pixel, (height, width, 2), read-only; NaN where there is none."""
    distorted = image_plane(width, height, fx, fy, cx, cy)
    numbers = np.array(distortion)
    slopes = undistort_points(distorted.reshape(-1, 2), numbers, radial_limit(numbers))
    slopes.flags.writeable = False
    return slopes.reshape(distorted.shape)


class ViewModel(ABC):
    """What a camera is to the occlusion: a size in pixels and a ray for each."""

    width: int
    height: int

    def directions(self) -> Rays:
        """Return the unit rays, float32 (height, width, 3), read-only; zero where there is none."""
        return self._directions

    @cached_property
    def _directions(self) -> Rays:
        rays = self._rays()
        unit = rays / np.linalg.norm(rays, axis=2, keepdims=True)
        unit[~np.isfinite(unit).all(axis=2)] = 0.0
        result: Rays = unit.astype(np.float32)
        result.flags.writeable = False
        return result

    @abstractmethod
    def _rays(self) -> npt.NDArray[np.float64]:
        """Return the rays (height, width, 3) of any length, NaN where there is none."""


@dataclass(frozen=True)
class PinholeView(ViewModel):
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

    @cached_property
    def _radial_limit(self) -> float:
        return radial_limit(np.array(self.distortion))

    @property
    def is_straight(self) -> bool:
        """Whether straight lines have straight images."""
        return not any(self.distortion)

    def project(self, points_m: _Floats) -> _Floats:
        """Return the pixels (N, 2) of points (N, 3) of the camera's frame.

        NaN for what is behind the camera, or where the lens model is not one to one.
        """
        is_turned = bool(self.rectified_from_camera)
        points = product(points_m, self.rectification().T) if is_turned else points_m
        x, y, z = points.T
        depths = np.where(z > 0.0, z, np.nan)
        x, y = x / depths, y / depths
        if not self.is_straight:
            is_outside = np.hypot(x, y) > self._radial_limit
            x, y = _distorted(x, y, np.array(self.distortion))[:2]
            x[is_outside] = y[is_outside] = np.nan
        pixels = np.empty((len(points), 2))
        pixels[:, 0], pixels[:, 1] = self.fx * x + self.cx, self.fy * y + self.cy
        return pixels

    def rectification(self) -> npt.NDArray[np.float64]:
        """Return R (3, 3), which turns the camera's frame into that of a rectified image."""
        numbers = self.rectified_from_camera
        return np.array(numbers).reshape(3, 3) if numbers else np.eye(3)

    def rays_to_depth(self) -> npt.NDArray[np.float64]:
        """Return the rays to 1 m of depth, float64 (height, width, 3); NaN where there is none."""
        rays: npt.NDArray[np.float64] = self._rays_to_depth.copy()
        return rays

    @cached_property
    def _rays_to_depth(self) -> npt.NDArray[np.float64]:
        slopes = self._slopes()
        rays = np.concatenate((slopes, np.ones((*slopes.shape[:2], 1))), axis=2)
        return product(rays, self.rectification())

    def _rays(self) -> npt.NDArray[np.float64]:
        return self._rays_to_depth

    def _slopes(self) -> npt.NDArray[np.float64]:
        """Return x / z and y / z per pixel, (height, width, 2), NaN where there is no ray."""
        numbers = (self.width, self.height, self.fx, self.fy, self.cx, self.cy)
        if self.is_straight:
            return image_plane(*numbers)
        return _undistorted_plane(*numbers, self.distortion)


@dataclass(frozen=True)
class FisheyeView(ViewModel):
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

    @property
    def is_straight(self) -> bool:
        """Whether straight lines have straight images."""
        return False

    @cached_property
    def _angular_limit(self) -> float:
        return angular_limit(np.array(self.distortion))

    def project(self, points_m: _Floats) -> _Floats:
        """Return the pixels (N, 2) of points (N, 3) of the camera's frame.

        NaN for what lies beyond the largest angle that the polynomial reaches.
        """
        aside = np.hypot(points_m[:, 0], points_m[:, 1])
        angles = np.arctan2(aside, points_m[:, 2])
        numbers = np.array(self.distortion)
        radii = np.where(angles <= self._angular_limit, _angular(angles, numbers)[0], np.nan)
        turns = points_m[:, :2] / np.maximum(aside, 1e-12)[:, np.newaxis]
        pixels: _Floats = turns * radii[:, np.newaxis] * (self.fx, self.fy) + (self.cx, self.cy)
        return pixels

    def rays_to_depth(self) -> npt.NDArray[np.float64]:
        """Return the rays to 1 m of depth, float64 (height, width, 3).

        They are NaN where there is no ray, or it goes 89.94 degrees or more away from the axis.
        """
        rays = self._rays()
        depths = rays[:, :, 2:]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(depths * _FAR > 1.0, rays / depths, np.nan)

    def _rays(self) -> npt.NDArray[np.float64]:
        """Return the unit rays (height, width, 3), NaN where there is none."""
        plane = image_plane(self.width, self.height, self.fx, self.fy, self.cx, self.cy)
        radii = np.hypot(plane[:, :, 0], plane[:, :, 1])
        numbers = np.array(self.distortion)
        limit = angular_limit(numbers)
        angles = undistort_angles(radii.reshape(-1), numbers, limit)
        angles = angles.reshape(radii.shape)
        sideways = np.sin(angles) / np.maximum(radii, 1e-12)
        rays = (plane[:, :, 0] * sideways, plane[:, :, 1] * sideways, np.cos(angles))
        return np.stack(rays, axis=2)


@dataclass(frozen=True)
class OmnidirectionalView(ViewModel):
    """A camera that sees all around: columns are azimuths over 360 degrees, rows elevations.

    The middle of the image looks along z (forward), azimuth grows to the right; the seam is behind.
    Elevation is positive upwards (against y) [rad] and falls evenly from the top edge of the image
    to the bottom edge. Raises ParameterError unless the size is positive and
    -pi/2 <= lowest < highest <= pi/2.
    """

    width: int
    height: int
    lowest_rad: float
    highest_rad: float

    def __post_init__(self) -> None:
        end = 0.5 * math.pi
        ordered = -end <= self.lowest_rad < self.highest_rad <= end
        if self.width < 1 or self.height < 1 or not ordered:
            message = (
                f"an omnidirectional camera needs a positive size and "
                f"elevations within {end:.4g} rad, not {self.width} x {self.height} pixels "
                f"from {self.lowest_rad} to {self.highest_rad}"
            )
            raise ParameterError(message)

    def _rays(self) -> npt.NDArray[np.float64]:
        azimuth = ((np.arange(self.width) + 0.5) / self.width - 0.5) * 2.0 * math.pi
        fraction = (np.arange(self.height) + 0.5) / self.height
        elevation = self.highest_rad + fraction * (self.lowest_rad - self.highest_rad)
        level = np.cos(elevation)[:, np.newaxis]
        down = np.broadcast_to(-np.sin(elevation)[:, np.newaxis], (self.height, self.width))
        return np.stack((level * np.sin(azimuth), down, level * np.cos(azimuth)), axis=2)


MAX_PIXELS: Final = 1 << 26
_MAX_NUMBER: Final = 1e9
_MIN_FOCAL_LENGTH_PX: Final = 1e-3
"""Beyond these no lens is described, and a ray's slope might overflow."""

_LENGTHS: Final = {
    "": (0, 4, 5),
    "none": (0, 4, 5),
    "pinhole": (0, 4, 5),
    "plumb_bob": (0, 4, 5),
    "rational_polynomial": (0, 8, 12, 14),
    "equidistant": (0, 4),
}
"""Distortion models, and how many coefficients each may have; none means no distortion."""


@dataclass(frozen=True)
class CameraInfo:
    """The fields of sensor_msgs/CameraInfo that a view depends on, as plain numbers.

    `d` has any length; `k` and `r` nine numbers, `p` twelve, row by row. `binning_x`, `binning_y`
    of 0 count as 1. `roi` is (x_offset, y_offset, width, height) in pixels of the full image; a
    width and height of 0 mean all of it, and `do_rectify` is its flag. Equal infos are equal
    values, so that a camera_info that repeats itself costs one comparison. `source` begins every
    sentence of an error.
    """

    width: int
    height: int
    distortion_model: str
    d: tuple[float, ...]
    k: tuple[float, ...]
    r: tuple[float, ...]
    p: tuple[float, ...]
    binning_x: int = 0
    binning_y: int = 0
    roi: tuple[int, int, int, int] = (0, 0, 0, 0)
    source: str = "camera_info"
    do_rectify: bool = False

    def view(self, *, rectified: bool) -> PinholeView | FisheyeView:
        """Return the view model of the raw image (K and D), or of the rectified one (P and R).

        Of K and P the focal lengths and the centre are read, as image_geometry does; the baseline
        in P is not, for rays start at the frame's origin. The region of interest shifts the centre,
        then binning divides centre and focal lengths. Equal infos give equal views.

        Raises InputError, with field and reason: a size, region or binning that gives no image, a
        number that is not finite or is beyond 1e9, a focal length below 1e-3 px (K of zeros: an
        uncalibrated camera), an unknown distortion model, a wrong number of coefficients,
        tilted-sensor coefficients, or an R that is no rotation.
        """
        for name, numbers, length in (("k", self.k, 9), ("r", self.r, 9), ("p", self.p, 12)):
            self._require_numbers(name, numbers, length)
        self._require_numbers("d", self.d, len(self.d))
        size = self._size()
        if rectified:
            numbers = self._intrinsics("p", (self.p[0], self.p[5], self.p[2], self.p[6]))
            return PinholeView(*size, *numbers, rectified_from_camera=self._rotation())
        numbers = self._intrinsics("k", (self.k[0], self.k[4], self.k[2], self.k[5]))
        coefficients = self._coefficients()
        if self.distortion_model == "equidistant":
            k1, k2, k3, k4 = coefficients or (0.0, 0.0, 0.0, 0.0)
            return FisheyeView(*size, *numbers, distortion=(k1, k2, k3, k4))
        if not any(coefficients):
            return PinholeView(*size, *numbers)
        padded = coefficients + (0.0,) * (COEFFICIENTS - len(coefficients))
        return PinholeView(*size, *numbers, distortion=padded)

    def _error(self, field: str, reason: str) -> InputError:
        return InputError(f"{self.source}: {field} {reason}")

    def _require_numbers(self, name: str, numbers: Sequence[float], length: int) -> None:
        if len(numbers) != length:
            raise self._error(name, f"has {len(numbers)} numbers, not {length}")
        if not all(math.isfinite(number) for number in numbers):
            raise self._error(name, f"has a number that is not finite: {list(numbers)}")
        if any(abs(number) > _MAX_NUMBER for number in numbers):
            raise self._error(name, f"has a number beyond {_MAX_NUMBER:g}: {list(numbers)}")

    def _region(self) -> tuple[int, int, int, int]:
        """Return the region of interest; raise InputError if it is not within the image."""
        if self.width < 1 or self.height < 1:
            raise self._error("width, height", f"are {self.width} and {self.height}, not positive")
        x, y, width, height = self.roi
        width, height = width or self.width - x, height or self.height - y
        fits = x >= 0 and y >= 0 and width > 0 and height > 0
        if not (fits and x + width <= self.width and y + height <= self.height):
            image = f"{self.width} x {self.height}"
            raise self._error("roi", f"{self.roi} (x, y, width, height) leaves the {image} image")
        return x, y, width, height

    def _binning(self) -> tuple[int, int]:
        if self.binning_x < 0 or self.binning_y < 0:
            raise self._error("binning_x, binning_y", f"are {self.binning_x}, {self.binning_y}")
        return self.binning_x or 1, self.binning_y or 1

    def _size(self) -> tuple[int, int]:
        _, _, width, height = self._region()
        across, down = self._binning()
        width, height = width // across, height // down
        if width < 1 or height < 1:
            raise self._error("binning_x, binning_y", f"of {across} and {down} leave no pixel")
        if width * height > MAX_PIXELS:
            raise self._error("width, height", f"give {width * height} pixels, over {MAX_PIXELS}")
        return width, height

    def _intrinsics(
        self, name: str, numbers: tuple[float, float, float, float]
    ) -> tuple[float, float, float, float]:
        """Return fx, fy, cx, cy of the image as it is delivered."""
        fx, fy, cx, cy = numbers
        if not any(numbers):
            raise self._error(name, "is all zeros, so this camera is not calibrated")
        if fx <= 0.0 or fy <= 0.0:
            raise self._error(name, f"has focal lengths {fx} and {fy}, which are not positive")
        if min(fx, fy) < _MIN_FOCAL_LENGTH_PX:
            raise self._error(name, f"has focal lengths {fx} and {fy}, which are too small")
        x, y, _, _ = self._region()
        across, down = self._binning()
        return fx / across, fy / down, (cx - x) / across, (cy - y) / down

    def _rotation(self) -> tuple[float, ...]:
        """Return R, or nothing where it is the identity."""
        matrix = np.array(self.r).reshape(3, 3)
        unit = np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-3)
        if not (unit and np.linalg.det(matrix) > 0.0):
            raise self._error("r", f"is no rotation: {list(self.r)}")
        return () if np.array_equal(matrix, np.eye(3)) else self.r

    def _coefficients(self) -> tuple[float, ...]:
        """Return D as it is, checked against the distortion model."""
        model = self.distortion_model
        if model not in _LENGTHS:
            known = ", ".join(name for name in _LENGTHS if name)
            raise self._error("distortion_model", f"{model!r} is unknown; known are {known}")
        if len(self.d) not in _LENGTHS[model]:
            wanted = " or ".join(str(length) for length in _LENGTHS[model])
            reason = f"has {len(self.d)} coefficients, and {model!r} takes {wanted}"
            raise self._error("d", reason)
        if any(self.d[12:]):
            raise self._error("d", f"has coefficients of a tilted sensor, {self.d[12:]}")
        if model in {"", "none", "pinhole"} and any(self.d):
            raise self._error("distortion_model", f"is {model!r}, and d is not zero")
        return self.d


FORWARD_FROM_OPTICAL = RigidTransform(np.zeros(3), np.array((-0.5, 0.5, -0.5, 0.5)))
"""An optical frame (z forward, x right, y down) in a body frame (x forward, y left, z up)."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A view model and where it sits: in a frame of the tree, or mounted on the base.

    `frame_id` is the optical frame; where it is empty, `base_from_optical` says where it is.
    """

    view: ViewModel
    frame_id: str
    base_from_optical: RigidTransform

    @property
    def name(self) -> str:
        """What a sighting calls it: its optical frame, "camera" where it has none."""
        return self.frame_id or "camera"


class CameraAt(NamedTuple):
    """A camera of the robot at an instant, its optical frame at a pose in the map frame.

    `number` is 0 of its own camera; it counts those of `camera.others` from 1.
    """

    number: int
    view: ViewModel
    map_from_camera: RigidTransform


@dataclass(frozen=True, eq=False)
class Observer:
    """A robot of this name and footprint, on `base_frame` (empty: found in the frame tree)."""

    name: str
    base_frame: str
    footprint: Footprint


def mounted_camera(view: ViewModel, mount: tuple[float, ...]) -> Camera:
    """Return a camera on the base that looks along +x of its mount.

    `mount` is x, y, z [m], yaw, pitch, roll [rad] in the base frame.
    """
    x, y, z, yaw, pitch, roll = mount
    base_from_mount = RigidTransform.from_xyz_ypr(x, y, z, yaw, pitch, roll)
    return Camera(view, "", base_from_mount @ FORWARD_FROM_OPTICAL)
