"""What the planner expects of the robot: to go on as it does for a moment, then to stand."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.world.footprint import Footprint

PREDICTION_S = 1.5


@dataclass(frozen=True)
class RobotMotion:
    """The robot's outline where it is, and how it moves: pose and velocities in the map frame.

    `footprint` is the one at the pose (x, y, yaw); m, rad, m/s and rad/s.
    """

    footprint: Footprint
    x_m: float
    y_m: float
    yaw_rad: float
    vx_mps: float
    vy_mps: float
    yaw_rate: float

    @property
    def speed_mps(self) -> float:
        """The speed of the base [m/s]."""
        return float(np.hypot(self.vx_mps, self.vy_mps))

    def outlines_m(self, step_s: float, count: int) -> npt.NDArray[np.float64]:
        """Return the footprint's vertices (count + 1, V, 2) now and at the next sub-steps.

        The velocity turns with the robot for `PREDICTION_S`, and then it stands.
        """
        times_s = np.minimum(step_s * np.arange(count + 1), PREDICTION_S)
        turns_rad = self.yaw_rate * times_s
        cos, sin = np.cos(turns_rad)[:, None], np.sin(turns_rad)[:, None]
        corners = self.footprint.vertices_m - (self.x_m, self.y_m)
        centres_m = self._centres_m(times_s)
        x = centres_m[:, :1] + cos * corners[:, 0] - sin * corners[:, 1]
        y = centres_m[:, 1:] + sin * corners[:, 0] + cos * corners[:, 1]
        return np.stack((x, y), axis=-1)

    def _centres_m(self, times_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the base's places (K, 2) on its arc."""
        half = 0.5 * self.yaw_rate * times_s
        chord_s = times_s * np.sinc(half / np.pi)
        cos, sin = np.cos(half), np.sin(half)
        return np.column_stack(
            (
                self.x_m + chord_s * (cos * self.vx_mps - sin * self.vy_mps),
                self.y_m + chord_s * (sin * self.vx_mps + cos * self.vy_mps),
            )
        )
