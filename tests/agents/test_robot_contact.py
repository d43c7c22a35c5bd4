"""Contacts of the robot with artefacts, and the three policies."""

import numpy as np
import pytest

from are_ros.agents.collisions import (
    ContactPolicy,
    Displace,
    Hold,
    Remove,
    RobotContact,
    contacts_of,
    depths_m,
)
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.footprint import Footprint

_IDS = np.array([4, 9])
_BOXES = OrientedBoxes(np.array([[0.0, 0, 1], [2.0, 0, 1]]), np.zeros(2), np.full((2, 3), 0.5))


def test_a_robot_that_reaches_into_a_box_is_in_contact() -> None:
    """A disc of 0.3 m at x = 1.3 m reaches 0.1 m into box 9; touching box 4 is no contact."""
    reaching, touching = Footprint.disc(0.3).at(1.3, 0.0, 0.0), Footprint.disc(0.5).at(-1.0, 0, 0)
    (contact,) = contacts_of(_IDS, depths_m(reaching, _BOXES))
    assert contact.artefact_id == 9
    assert contact.penetration_m == pytest.approx(0.1)
    assert contacts_of(_IDS, depths_m(touching, _BOXES)) == ()


def test_contacts_come_in_the_order_of_artefacts() -> None:
    """A robot over both boxes gives two contacts."""
    contacts = contacts_of(_IDS, depths_m(Footprint.disc(2.0).at(1.0, 0.0, 0.0), _BOXES))
    assert [contact.artefact_id for contact in contacts] == [4, 9]


def test_without_a_robot_there_is_no_contact() -> None:
    """No pose is known: nothing to report."""
    assert contacts_of(_IDS, depths_m(None, _BOXES)) == ()
    assert RobotContact(1, 0.5) == RobotContact(1, 0.5)


@pytest.mark.parametrize(
    ("policy", "tolerated_m", "leaves"),
    [(Hold(), 0.1, False), (Displace(), 0.0, False), (Remove(), 0.0, True)],
)
def test_policies(policy: ContactPolicy, tolerated_m: float, leaves: bool) -> None:
    """Hold tolerates what is, the others nothing; only remove lets an artefact leave."""
    assert policy.tolerated_m(np.array([0.1])).tolist() == [tolerated_m]
    assert policy.leaves(np.array([True, False])).tolist() == [leaves, False]
