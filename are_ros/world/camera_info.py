"""A view model from the numbers of sensor_msgs/CameraInfo."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from are_ros.errors import InputError
from are_ros.world._distortion import COEFFICIENTS
from are_ros.world.view_models import FisheyeView, PinholeView

MAX_PIXELS: Final = 1 << 26
_MAX_NUMBER: Final = 1e9
_MIN_FOCAL_LENGTH_PX: Final = 1e-3
"""Beyond these no lens is described, and a ray's slope might overflow."""

_LENGTHS: Final = {
    "": (0, 4, 5),
    "none": (0, 4, 5),
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
    width and height of 0 mean all of it. Equal infos are equal values, so that a camera_info that
    repeats itself costs one comparison. `source` begins every sentence of an error.
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
        if model in {"", "none"} and any(self.d):
            raise self._error("distortion_model", f"is {model!r}, and d is not zero")
        return self.d
