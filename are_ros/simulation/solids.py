"""The solid things that a building is made of: upright boxes and cylinders."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt


class Solid(Protocol):
    """An upright prism over an outline on the floor, from `bottom_m` up to `top_m`."""

    @property
    def bottom_m(self) -> float:
        """Height of the lower face above the floor."""

    @property
    def top_m(self) -> float:
        """Height of the upper face above the floor."""

    def covers(
        self, x_m: npt.NDArray[np.float64], y_m: npt.NDArray[np.float64], depth_m: float = 0.0
    ) -> npt.NDArray[np.bool_]:
        """Tell which points of the floor lie deeper than `depth_m` inside the outline.

        The arrays x and y broadcast.
        """


@dataclass(frozen=True)
class Cuboid:
    """A box about (x_m, y_m), `length_m` along its heading `yaw_rad` and `width_m` across."""

    x_m: float
    y_m: float
    length_m: float
    width_m: float
    top_m: float
    bottom_m: float = 0.0
    yaw_rad: float = 0.0

    @classmethod
    def between(
        cls,
        low_x_m: float,
        low_y_m: float,
        high_x_m: float,
        high_y_m: float,
        top_m: float,
        bottom_m: float = 0.0,
    ) -> "Cuboid":
        """Return the box over an axis-parallel rectangle."""
        centre = 0.5 * (low_x_m + high_x_m), 0.5 * (low_y_m + high_y_m)
        return cls(*centre, high_x_m - low_x_m, high_y_m - low_y_m, top_m, bottom_m)

    def covers(
        self, x_m: npt.NDArray[np.float64], y_m: npt.NDArray[np.float64], depth_m: float = 0.0
    ) -> npt.NDArray[np.bool_]:
        """Tell which points of the floor lie deeper than `depth_m` inside the outline.

        The arrays x and y broadcast.
        """
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        dx, dy = x_m - self.x_m, y_m - self.y_m
        along, across = dx * cosine + dy * sine, dy * cosine - dx * sine
        inside: npt.NDArray[np.bool_]
        inside = abs(along) < 0.5 * self.length_m - depth_m
        inside &= abs(across) < 0.5 * self.width_m - depth_m
        return inside


@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder about (x_m, y_m)."""

    x_m: float
    y_m: float
    radius_m: float
    top_m: float
    bottom_m: float = 0.0

    def covers(
        self, x_m: npt.NDArray[np.float64], y_m: npt.NDArray[np.float64], depth_m: float = 0.0
    ) -> npt.NDArray[np.bool_]:
        """Tell which points of the floor lie deeper than `depth_m` inside the outline.

        The arrays x and y broadcast.
        """
        inside: npt.NDArray[np.bool_]
        inside = np.hypot(x_m - self.x_m, y_m - self.y_m) < self.radius_m - depth_m
        return inside
