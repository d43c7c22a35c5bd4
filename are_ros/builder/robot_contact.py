"""What happens when a robot has moved into an artefact (section 3.3 and DESIGN, robot contact)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from are_ros.world.boxes import TOUCH_TOLERANCE_M, OrientedBoxes
from are_ros.world.footprint import Footprint, penetration_m


@dataclass(frozen=True)
class RobotContact:
    """Robot number `observer` overlaps an artefact, by this penetration depth."""

    observer: int
    artefact_id: int
    penetration_m: float


def depths_m(robots: Sequence[Footprint], boxes: OrientedBoxes) -> NDArray[np.float64]:
    """Return the penetration depths (N, R) of R robots into N boxes, 0 where apart."""
    if not robots:
        return np.zeros((len(boxes), 0))
    return np.column_stack([penetration_m(robot, boxes) for robot in robots])


def contacts_of(ids: NDArray[np.int64], depths: NDArray[np.float64]) -> tuple[RobotContact, ...]:
    """Return the contacts among depths (N, R) of R robots into the N artefacts `ids`.

    The order is that of the artefacts, then of the robots. Touching is no contact.
    """
    if not depths.any():
        return ()
    return tuple(
        RobotContact(int(observer), int(ids[i]), float(depths[i, observer]))
        for i, observer in np.argwhere(depths > TOUCH_TOLERANCE_M)
    )


class ContactPolicy(Protocol):
    """Says what becomes of artefacts that a robot has moved into."""

    def tolerated_m(self, depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the depths (N, R) up to which robots are tolerated, given the present ones."""
        ...

    def leaves(self, in_contact: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which artefacts (N,) leave, given which are in contact."""
        ...


class Hold:
    """The artefact stays, and may back out, but never goes deeper, while the overlap lasts."""

    def tolerated_m(self, depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """Tolerate what is."""
        return depths

    def leaves(self, in_contact: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Let nobody leave."""
        return np.zeros_like(in_contact)


class Displace:
    """The artefact makes way: its pose is no longer safe, so that the remedies apply."""

    def tolerated_m(self, depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """Tolerate nothing."""
        return np.zeros_like(depths)

    def leaves(self, in_contact: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Let nobody leave."""
        return np.zeros_like(in_contact)


class Remove:
    """The artefact leaves at once."""

    def tolerated_m(self, depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """Tolerate nothing."""
        return np.zeros_like(depths)

    def leaves(self, in_contact: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Let all in contact leave."""
        return in_contact
