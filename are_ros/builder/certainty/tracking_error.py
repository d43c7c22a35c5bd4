"""The error of a track: that of a Kalman filter whose model is right.

The artefacts do not move as a filter believes, so the errors of a real filter on them would not
have the covariance that it states. Here the error itself is the random process: it is driven by the
noise of the model and of the detections, and its covariance is the filter's own. So an estimate is
the truth plus an error that is normal with exactly the stated covariance, at every instant, and
correlated in time as a tracker's is.
"""

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.parameters.model import CertaintyParameters

Floats = npt.NDArray[np.float64]

AXES: Final = 3
"""x, y and yaw; their rates follow in a state."""

_UNIT: Final[Floats] = np.eye(2 * AXES)


class TrackingError:
    """The error (6,) of x, y [m], yaw [rad] and their rates in the map frame, and its covariance.

    Factors L stand for covariances L L^T. All draws come from `generator`.
    """

    def __init__(self, generator: np.random.Generator, detection: Floats, rates: Floats) -> None:
        """Begin a track with a detection: factors (3, 3) of its noise and of the unknown rates."""
        self._generator = generator
        factor = np.zeros((2 * AXES, 2 * AXES))
        factor[:AXES, :AXES], factor[AXES:, AXES:] = detection, rates
        self.error: Floats = factor @ generator.standard_normal(2 * AXES)
        self.covariance: Floats = factor @ factor.T

    def predict(self, process: "Process") -> None:
        """Go on by the time of a process."""
        drawn = process.noise @ self._generator.standard_normal(2 * AXES)
        self.error = process.step @ self.error + drawn
        self.covariance = process.grown(self.covariance)

    def correct(self, detection: Floats) -> None:
        """Take a detection whose noise has this factor (3, 3)."""
        noise = detection @ detection.T
        innovation = self.covariance[:AXES, :AXES] + noise
        gain = self.covariance[:, :AXES] @ _inverse(innovation, detection)
        drawn = detection @ self._generator.standard_normal(AXES)
        self.error = self.error + gain @ (drawn - self.error[:AXES])
        kept = _UNIT.copy()
        kept[:, :AXES] -= gain
        self.covariance = kept @ self.covariance @ kept.T + gain @ noise @ gain.T


class Process(NamedTuple):
    """What a time does to a state (6,): `step` (6, 6) carries it on at constant rates.

    `noise` (6, 6) is a factor of what white noise as accelerations adds.
    """

    step: Floats
    noise: Floats

    @classmethod
    def of(cls, settings: CertaintyParameters, dt_s: float) -> "Process":
        """Return the process of a time.

        Per axis, noise of density q adds q^2 ((dt^3 / 3, dt^2 / 2), (dt^2 / 2, dt)): however a time
        is cut into steps, the law is the same.
        """
        moves, turns = settings.acceleration, settings.turn_acceleration
        densities = math.sqrt(dt_s) * np.diag((moves, moves, turns))
        step, noise = _UNIT.copy(), np.zeros((2 * AXES, 2 * AXES))
        step[:AXES, AXES:] = dt_s * _UNIT[:AXES, :AXES]
        noise[:AXES, :AXES] = densities * dt_s / math.sqrt(3.0)
        noise[AXES:, :AXES] = densities * math.sqrt(0.75)
        noise[AXES:, AXES:] = densities * 0.5
        return cls(step, noise)

    def grown(self, covariance: Floats) -> Floats:
        """Return what a covariance (6, 6), or each of (N, 6, 6), has become after the time."""
        grown: Floats = self.step @ covariance @ self.step.T + self.noise @ self.noise.T
        return grown


def _inverse(innovation: Floats, detection: Floats) -> Floats:
    """Return the inverse; the pseudo-inverse where a component is detected without any noise.

    Such a component may be known exactly, and is then not corrected.
    """
    if np.linalg.det(detection):
        return np.asarray(np.linalg.inv(innovation), np.float64)
    return np.asarray(np.linalg.pinv(innovation, hermitian=True), np.float64)
