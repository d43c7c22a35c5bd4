"""Markers for rviz as values: how each looks, and apart from that where it stands."""

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S

Vector3 = tuple[float, float, float]
Colour = tuple[float, float, float, float]
Points = npt.NDArray[np.float64]
Colours = npt.NDArray[np.float32]

LIFETIME_NS: Final = 3 * NS_PER_S
_UNIT_SCALE: Final = (1.0, 1.0, 1.0)
_OPAQUE_WHITE: Final = (1.0, 1.0, 1.0, 1.0)
_UNTURNED: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
NO_POINTS: Final[Points] = np.zeros((0, 3))
NO_COLOURS: Final[Colours] = np.zeros((0, 4), np.float32)
NO_POINTS.flags.writeable = NO_COLOURS.flags.writeable = False


class MarkerKind(IntEnum):
    """The kinds of marker used here, numbered as visualization_msgs/Marker's types."""

    ARROW = 0
    CUBE = 1
    TEXT_VIEW_FACING = 9
    TRIANGLE_LIST = 11


class MarkerAction(IntEnum):
    """What to do with a marker, numbered as visualization_msgs/Marker's actions."""

    ADD = 0
    DELETE = 2
    DELETEALL = 3


@dataclass(frozen=True, eq=False)
class MarkerLook:
    """A visualization_msgs/Marker but for its pose and its stamp.

    `points` float64 (P, 3) [m] and `colours` float32 (P, 4) or (0, 4) are a TRIANGLE_LIST's,
    relative to the pose. `marker_id` fits int32. What an action does not use has a valid default.
    """

    namespace: str
    marker_id: int
    kind: MarkerKind
    action: MarkerAction
    scale: Vector3 = _UNIT_SCALE
    colour: Colour = _OPAQUE_WHITE
    text: str = ""
    points: Points = field(default_factory=lambda: NO_POINTS)
    colours: Colours = field(default_factory=lambda: NO_COLOURS)
    lifetime_ns: int = LIFETIME_NS


@dataclass(frozen=True, eq=False)
class MarkerBatch:
    """Markers in the order in which viewers obey them.

    `poses` float64 (N, 7), read-only: x y z [m] and the quaternion x y z w in the map's frame, one
    for each of `looks`. A look is the same object as long as its marker looks the same, so that
    what was made of it can be kept.
    """

    looks: tuple[MarkerLook, ...]
    poses: npt.NDArray[np.float64]

    def __post_init__(self) -> None:
        self.poses.setflags(write=False)

    def __len__(self) -> int:
        """Count the markers."""
        return len(self.looks)

    @classmethod
    def unposed(cls, *looks: MarkerLook) -> "MarkerBatch":
        """Return markers for which the pose does not matter; they are at the origin, unturned."""
        return cls(looks, np.tile(_UNTURNED, (len(looks), 1)))

    def followed_by(self, other: "MarkerBatch") -> "MarkerBatch":
        """Return these markers, then the others."""
        if not self.looks:
            return other
        return MarkerBatch(self.looks + other.looks, np.concatenate((self.poses, other.poses)))


NO_MARKERS: Final = MarkerBatch.unposed()
DELETE_ALL: Final = MarkerBatch.unposed(MarkerLook("", 0, MarkerKind.CUBE, MarkerAction.DELETEALL))
"""Removes every marker of the topic."""
