"""What may be in an artefact's way."""

from enum import Enum

from are_ros.artefacts.motion import _state


class Hindrance(Enum):
    """Nothing, a wall (or unknown ground), another artefact, the robot."""

    NONE = _state.UNHINDERED
    WALL = _state.BY_WALL
    ARTEFACT = _state.BY_ARTEFACT
    ROBOT = _state.BY_ROBOT
