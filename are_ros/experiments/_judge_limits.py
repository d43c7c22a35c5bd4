"""Whether a body can move so: speed, acceleration, turning, and no sliding sideways."""

import math
from dataclasses import dataclass

_FASTER, _STRONGER = 1.001, 1.02
"""What rounding may add: positions are rounded, and accelerations are their second differences."""

_STANDS_MPS = 1e-6


@dataclass(frozen=True)
class Limits:
    """What a type can do: top speed [m/s], acceleration [m/s^2], turn rate [rad/s], radius [m].

    `turn_radius_m` is that of the smallest circle it can drive, 0: it turns on the spot.
    """

    speed_mps: float
    acceleration_mps2: float
    turn_rate_radps: float
    turn_radius_m: float


@dataclass(frozen=True)
class Motion:
    """What a body did in a sub-step: along its mean heading, across it, and turning."""

    step_s: float
    along_m: float
    across_m: float
    turn_rad: float

    @classmethod
    def between(
        cls, start: tuple[float, float, float], end: tuple[float, float, float], step_s: float
    ) -> "Motion":
        """Return the motion from one x, y, yaw to another: on an arc, the chord is along."""
        dx_m, dy_m = end[0] - start[0], end[1] - start[1]
        turn_rad = math.remainder(end[2] - start[2], math.tau)
        middle_rad = start[2] + 0.5 * turn_rad
        c, s = math.cos(middle_rad), math.sin(middle_rad)
        return cls(step_s, dx_m * c + dy_m * s, dy_m * c - dx_m * s, turn_rad)

    @property
    def speed_mps(self) -> float:
        """The speed along the heading; negative in reverse."""
        return self.along_m / self.step_s

    @property
    def length_m(self) -> float:
        """How far it came."""
        return math.hypot(self.along_m, self.across_m)


def excess(speed_mps: float, turn_rate: float, limits: Limits) -> str:
    """Return which of a speed and a turn rate [rad/s] is too high; empty if none is."""
    if speed_mps > limits.speed_mps * _FASTER + 1e-6:
        return f"speed {speed_mps:.3f} m/s, at most {limits.speed_mps:g}"
    if turn_rate > limits.turn_rate_radps * _FASTER + 1e-6:
        return f"turns at {turn_rate:.3f} rad/s, at most {limits.turn_rate_radps:g}"
    return ""


def breach(motion: Motion, before_mps: float, limits: Limits) -> str:
    """Return how a motion, after a speed (NaN: unknown), breaks the limits; empty if not."""
    speed_mps, turn_rate = motion.speed_mps, abs(motion.turn_rad) / motion.step_s
    too_fast = excess(motion.length_m / motion.step_s, turn_rate, limits)
    if too_fast:
        return too_fast
    gain = (speed_mps - before_mps) / motion.step_s
    if abs(speed_mps) > abs(before_mps) and _is_beyond(gain, limits):
        return f"gains {gain:.3f} m/s^2, at most {limits.acceleration_mps2:g}"
    if abs(motion.across_m) > 1e-4 + 0.002 * abs(motion.along_m):
        return f"slides {1000.0 * motion.across_m:.2f} mm sideways"
    radius_m = limits.turn_radius_m
    if radius_m > 0.0 and turn_rate * radius_m > abs(speed_mps) * 1.01 + 1e-3:
        speeds = f"{turn_rate:.3f} rad/s with {speed_mps:.3f} m/s"
        return f"turns at {speeds}: radius below {radius_m:g} m"
    return ""


def hard_braking_mps2(motion: Motion, before_mps: float, limits: Limits) -> float:
    """Return the deceleration where it is beyond the limit, else 0."""
    change = (motion.speed_mps - before_mps) / motion.step_s
    is_braking = abs(motion.speed_mps) <= abs(before_mps)
    return abs(change) if is_braking and _is_beyond(change, limits) else 0.0


def is_standing(motion: Motion) -> bool:
    """Tell whether the body is where it was."""
    return abs(motion.speed_mps) <= _STANDS_MPS


def _is_beyond(change_mps2: float, limits: Limits) -> bool:
    # Positions rounded to float64 are exact enough; the millimetre per second is for arcs.
    return abs(change_mps2) > limits.acceleration_mps2 * _STRONGER + 1e-3
