"""The navigation profile of an artefact's type: sizes, clearances and their prices."""

from dataclasses import dataclass

from are_ros.agents.body import Body
from are_ros.population.catalogue import CatalogueRow, RewardWeights

_TURNING_ROOM = 0.1
"""Room beside the half width of a vehicle to turn at corners, as a share of its length."""

_PASSING_ROOM_M = 0.04
"""Room beside the half width of a body that turns on the spot, to pass a gap."""

_PERSONAL_SPACE, _ROBOT = 0.3, 0.6
"""Cost per epoch of one unit of these reward weights, beside the price of time."""


@dataclass(frozen=True)
class Clearances:
    """Distances [m] that an artefact keeps where it can, by its type's reward weights."""

    others_m: float
    robot_m: float
    walls_m: float

    @classmethod
    def of(cls, rewards: RewardWeights) -> "Clearances":
        """Return those of a type: a person keeps some 0.3 m from others, 0.5 m from robots."""
        return cls(0.4 * rewards.personal_space, 0.6 * rewards.robot, 0.3 * rewards.clearance)


@dataclass(frozen=True, eq=False, slots=True)
class NavigationProfile:
    """What navigation needs to know of an artefact's type.

    `others_price` and `robot_price` are the costs per epoch of being near others and the robot. If
    there is no way for a disc of `radius_m`, one of `narrow_m` is tried, which leads between two
    places where the body can turn.
    """

    row: CatalogueRow
    body: Body
    radius_m: float
    narrow_m: float
    height_m: float
    clearances: Clearances
    others_price: float
    robot_price: float

    @classmethod
    def of(cls, row: CatalogueRow, body: Body) -> "NavigationProfile":
        """Return the profile of a row.

        A body that turns on the spot needs all of its disc wherever it stops. A vehicle needs its
        width, and some room for its turns.
        """
        radius_m, rewards = body.radius_m, row.rewards
        narrow_m = radius_m
        if _stride_m(body, row.motion.speed_mps) >= 2.0 * radius_m:
            half_m = body.half_size_m[1] + abs(body.centre_m[1])
            narrow_m = min(radius_m, half_m + _PASSING_ROOM_M)
        if body.turn_radius_m > 0.0:
            narrow_m = 0.5 * row.size_m[1] + _TURNING_ROOM * row.size_m[0]
            radius_m = narrow_m = min(radius_m, narrow_m)
        prices = (_PERSONAL_SPACE * rewards.personal_space, _ROBOT * rewards.robot)
        return cls(row, body, radius_m, narrow_m, row.size_m[2], Clearances.of(rewards), *prices)


def _stride_m(body: Body, speed_mps: float) -> float:
    """Return the distance of a start from rest, a second of motion, and a stop [m].

    A gap of this depth is passed in one motion, without a stop where the body could not turn.
    """
    start_s = min(1.0, speed_mps / body.acceleration_mps2)
    speed_mps = body.acceleration_mps2 * start_s
    return speed_mps * (1.0 - 0.5 * start_s) + 0.5 * speed_mps**2 / body.acceleration_mps2
