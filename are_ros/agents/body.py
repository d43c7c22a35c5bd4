"""A type's shape on the ground and its limits, as numbers for the planner."""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from are_ros.population.catalogue import CatalogueRow

TIGHTEST = 1.01
"""The tightest arc that is planned, in turning radii: a little wider, for rounding."""
_SQUARISH = 0.7
"""Boxes up to this longer than n times their width are filled by n + 1 discs at most."""


@dataclass(frozen=True)
class Body:
    """A box in F_A on the ground, and what the type can do.

    `half_size_m` and `centre_m` (x, y): half the box's length and width, and its centre in F_A.
    Limits as in `MotionLimits`; one with a speed of 0 never moves.
    """

    half_size_m: tuple[float, float]
    centre_m: tuple[float, float] = (0.0, 0.0)
    height_m: float = 1.7
    speed_mps: float = 1.35
    acceleration_mps2: float = 1.5
    turn_rate_radps: float = 3.0
    turn_radius_m: float = 0.0

    @classmethod
    def of(cls, row: CatalogueRow) -> "Body":
        """Return the body of a row of the catalogue."""
        limits = row.motion
        return cls(
            (0.5 * row.size_m[0], 0.5 * row.size_m[1]),
            (row.box_centre_in_artefact_m[0], row.box_centre_in_artefact_m[1]),
            row.size_m[2],
            limits.top_speed_mps,
            limits.acceleration_mps2,
            limits.turn_rate_radps,
            limits.turn_radius_m,
        )

    @property
    def radius_m(self) -> float:
        """Radius of the smallest disc about F_A's ground point that holds the box."""
        x, y = self.centre_m
        return math.hypot(abs(x) + self.half_size_m[0], abs(y) + self.half_size_m[1])

    def discs(self) -> tuple[int, float, float]:
        """Return how many equal discs along the box's long axis cover it, their gap and radius [m].

        The discs' centres lie at gap * (n - (count - 1) / 2) from the box's centre.
        """
        longer, shorter = max(self.half_size_m), min(self.half_size_m)
        count = max(1, math.ceil(longer / max(shorter, 1e-3) - _SQUARISH))
        count = min(count, 12)
        return count, 2.0 * longer / count, math.hypot(longer / count, shorter)


# What an artefact is to do until told otherwise.


PLANNERS: Final = ("dynamic_window", "social_force", "path_following")
"""Names of the planners that propose motions, without user-defined ones."""


class MotionCommand(NamedTuple):
    """Move to `subgoal_m` (x, y in the map frame), or brake and stand where it is None.

    `speed_mps` is the speed wanted; the type's own limit holds, too. With `stop_there` the subgoal
    is the end of the way, else it is passed, and the way goes on to `beyond_m`, where it is given,
    to stop there. `face_rad` is the heading wanted when standing there
    (None: any), of those that turn on the spot. The comfort distances are kept from others, the
    robot and the walls where possible. `planner`: a name of `PLANNERS`, or `module:Class`.
    """

    subgoal_m: tuple[float, float] | None
    speed_mps: float
    stop_there: bool = True
    face_rad: float | None = None
    comfort_m: float = 0.3
    robot_comfort_m: float = 0.5
    wall_comfort_m: float = 0.1
    planner: str = PLANNERS[0]
    beyond_m: tuple[float, float] | None = None


STAND = MotionCommand(None, 0.0)
