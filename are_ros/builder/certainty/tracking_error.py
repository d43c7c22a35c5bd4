"""The error of a track: that of a Kalman filter whose model is right.

The artefacts do not move as a filter believes, so the errors of a real filter on them would not
have the covariance that it states. Here the error itself is the random process: it is driven by the
noise of the model and of the detections, and its covariance is the filter's own. So an estimate is
the truth plus an error that is normal with exactly the stated covariance, at every instant, and
correlated in time as a tracker's is.
"""

import math

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

AXES = 3
"""x, y and yaw; their rates follow in a state."""


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

    def predict(self, dt_s: float, densities: Floats) -> None:
        """Go on by a time, with white noise of these densities (3,) as accelerations."""
        step, noise = transition(dt_s), process_noise(dt_s, densities)
        self.error = step @ self.error + noise @ self._generator.standard_normal(2 * AXES)
        self.covariance = step @ self.covariance @ step.T + noise @ noise.T

    def correct(self, detection: Floats) -> None:
        """Take a detection whose noise has this factor (3, 3)."""
        noise = detection @ detection.T
        innovation = self.covariance[:AXES, :AXES] + noise
        # The pseudo-inverse: a component that is known exactly is not corrected.
        gain = self.covariance[:, :AXES] @ np.linalg.pinv(innovation, hermitian=True)
        drawn = detection @ self._generator.standard_normal(AXES)
        self.error = self.error + gain @ (drawn - self.error[:AXES])
        kept = np.eye(2 * AXES)
        kept[:, :AXES] -= gain
        self.covariance = kept @ self.covariance @ kept.T + gain @ noise @ gain.T


def transition(dt_s: float) -> Floats:
    """Return the matrix (6, 6) that carries a state on by a time at constant rates."""
    step = np.eye(2 * AXES)
    step[:AXES, AXES:] = dt_s * np.eye(AXES)
    return step


def process_noise(dt_s: float, densities: Floats) -> Floats:
    """Return a factor (6, 6) of what white accelerations of densities (3,) add in a time.

    Per axis the covariance is q^2 ((dt^3 / 3, dt^2 / 2), (dt^2 / 2, dt)): however a time is cut
    into steps, the law is the same.
    """
    root_s = math.sqrt(dt_s)
    factor = np.zeros((2 * AXES, 2 * AXES))
    factor[:AXES, :AXES] = np.diag(densities * dt_s * root_s / math.sqrt(3.0))
    factor[AXES:, :AXES] = np.diag(densities * root_s * math.sqrt(0.75))
    factor[AXES:, AXES:] = np.diag(densities * root_s * 0.5)
    return factor
