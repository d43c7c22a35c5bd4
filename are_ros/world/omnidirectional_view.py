"""The view model of a camera that sees all around, as the paper's robot has one."""

import math
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
import numpy.typing as npt

from are_ros.errors import ParameterError
from are_ros.world._image_rays import Rays, unit_rays


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
