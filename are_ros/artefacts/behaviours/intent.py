"""What an artefact wants until its next decision, and the interface of whatever decides it."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, Protocol

if TYPE_CHECKING:
    from are_ros.artefacts.behaviours.situation import Situation

Point = tuple[float, float]
"""x and y in the map frame [m]."""


ARRIVE_WITHIN_M: Final = 0.4
"""How near a goal one has arrived, unless an intent says otherwise."""


@dataclass(frozen=True, slots=True)
class Intent:
    """Where an artefact wants to be, map frame; a goal of None means that it stands.

    It goes at `speed_mps` at most, and has arrived within `arrive_within_m` of the goal. While it
    stands it turns to face `face_m`, if given. `activity` says in a word or two what it is doing,
    for the ground truth and the pictures. With `is_moving_goal` no whole way is planned: it goes
    straight on while the goal is seen; a goal that is new in each decision should be such a one.
    `robot_comfort_m` is the distance kept from the robot where possible, None: the usual one.
    """

    goal_m: Point | None
    speed_mps: float
    arrive_within_m: float = ARRIVE_WITHIN_M
    face_m: Point | None = None
    activity: str = ""
    is_moving_goal: bool = False
    robot_comfort_m: float | None = None


class Behaviour(Protocol):
    """Decides for one artefact; each artefact has an instance of its own, which may keep state.

    The class is made without arguments. Its choices depend on nothing but the situations: random
    numbers come from `situation.random`, the time from `situation.now_ns`.
    """

    name: ClassVar[str]

    def decide(self, situation: "Situation") -> Intent:
        """Return what the artefact wants now; called once in each decision period (1 s)."""


def stand(activity: str, face_m: Point | None = None) -> Intent:
    """Return the intent to stand, facing a point or as it is."""
    return Intent(None, 0.0, face_m=face_m, activity=activity)
