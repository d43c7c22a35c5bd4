"""What finding a way takes of an artefact's type: its size, what it likes, and what that costs."""

from dataclasses import dataclass

from are_ros.artefacts.catalogue import CatalogueRow, RewardWeights
from are_ros.artefacts.motion.body import Body

_TURNING_ROOM = 0.1
"""What a body needs beside its half width to get round corners, as a share of its length."""

_PERSONAL_SPACE, _ROBOT = 0.3, 0.6
"""What a whole unit of these reward weights costs per epoch, beside the price of time."""


@dataclass(frozen=True)
class Comfort:
    """Distances [m] that an artefact keeps where it can, by its type's reward weights."""

    others_m: float
    robot_m: float
    walls_m: float

    @classmethod
    def of(cls, rewards: RewardWeights) -> "Comfort":
        """Return what a type likes: a person about 0.3 m from others, half a metre from robots."""
        return cls(0.4 * rewards.personal_space, 0.6 * rewards.robot, 0.3 * rewards.clearance)


@dataclass(frozen=True, eq=False, slots=True)
class Traveller:
    """What finding a way needs to know of an artefact's type.

    `others_price` and `robot_price` are what being near costs per epoch.
    """

    row: CatalogueRow
    body: Body
    radius_m: float
    height_m: float
    comfort: Comfort
    others_price: float
    robot_price: float

    @classmethod
    def of(cls, row: CatalogueRow, body: Body) -> "Traveller":
        """Return the traveller of a row.

        Who turns on the spot needs all of its disc wherever it may come to stand: that is where
        the traffic lets it stop. A vehicle needs its width, and some room for its turns.
        """
        radius_m, rewards = body.radius_m, row.rewards
        if body.turn_radius_m > 0.0:
            narrow_m = 0.5 * row.size_m[1] + _TURNING_ROOM * row.size_m[0]
            radius_m = min(radius_m, narrow_m)
        prices = (_PERSONAL_SPACE * rewards.personal_space, _ROBOT * rewards.robot)
        return cls(row, body, radius_m, row.size_m[2], Comfort.of(rewards), *prices)
