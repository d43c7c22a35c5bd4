"""What the planners propose, and what becomes of it: path following and the social force."""

import math

import numpy as np
import pytest

from are_ros.agents.local_planner.body import Body, MotionCommand
from are_ros.agents.local_planner.planner import Obstruction
from tests.agents.local_planner.streets import (
    PALLET,
    PERSON,
    SCOOTER,
    Street,
    corridor,
    environment,
    room,
)

AGV = Body((0.46, 0.31), (0.0, 0.0), 1.0, 1.4, 0.8, 1.0)


def way_of(street: Street, row: int = 0) -> np.ndarray:
    """Return x, y, yaw of a row at all sub-steps, (K, 3)."""
    return np.array([poses[row] for poses in street.track])


# --- path following


@pytest.mark.parametrize("yaw_rad", [0.0, 0.4, 2.5, -1.7])
def test_a_path_follower_turns_first_and_never_leaves_its_way(yaw_rad: float) -> None:
    """Once it moves at its heading it is on the straight line to the goal, and looks along it."""
    street = Street(environment(room(16.0, 10.0)))
    street.add(1, 2.0, 3.0, yaw_rad, AGV)
    street.send(1, 13.0, 7.0, planner="path_following")
    street.run_until_there(25.0)
    way = way_of(street)
    if abs(yaw_rad) > 0.5 + math.atan2(4.0, 11.0):
        assert (way[: round(0.3 / 0.05), :2] == way[0, :2]).all()
    onward = np.arctan2(7.0 - way[:, 1], 13.0 - way[:, 0])
    aside = np.abs(np.remainder(way[:, 2] - onward + np.pi, 2.0 * np.pi) - np.pi)
    is_far = np.hypot(13.0 - way[:, 0], 7.0 - way[:, 1]) > 0.5
    begins = int(np.argmax(aside < 1e-6))
    assert begins > 0 or yaw_rad == 0.0
    assert aside[begins:][is_far[begins:]].max() < 1e-6


def test_a_path_follower_brakes_behind_a_pallet_waits_and_goes_on() -> None:
    """It names the pallet, does not swerve for it, and goes on once it is gone."""
    street = Street(environment(room(16.0, 8.0)))
    street.add(1, 2.0, 4.0, 0.0, AGV)
    street.add(2, 8.0, 4.3, 0.5 * math.pi, PALLET)
    street.send(1, 14.0, 4.0, planner="path_following")
    street.run(40.0)
    assert street.speeds[0] == 0.0
    assert 7.0 < street.pose(1)[0] + 0.46 < 7.6
    what, who, since_s = street.obstruction(1)
    assert (what, who) == (Obstruction.ARTEFACT, 2)
    assert since_s > 25.0
    street.remove(2)
    street.run_until_there(15.0)
    assert np.abs(way_of(street)[:, 1] - 4.0).max() < 1e-9


def test_a_dynamic_window_swerves_where_a_path_follower_waits() -> None:
    """The same scene with the other planner, so that the test above can fail."""
    street = Street(environment(room(16.0, 8.0)))
    street.add(1, 2.0, 4.0, 0.0, AGV)
    street.add(2, 8.0, 4.3, 0.5 * math.pi, PALLET)
    street.send(1, 14.0, 4.0)
    street.run_until_there(30.0)
    assert np.abs(way_of(street)[:, 1] - 4.0).max() > 0.3


def test_people_get_out_of_the_way_of_a_path_follower_which_never_makes_way() -> None:
    """Head on in a corridor where two abreast have room: the one that can swerve does."""
    street = Street(corridor(2.4))
    street.add(1, 1.5, 1.7, 0.0, AGV)
    street.add(2, 10.5, 1.7, math.pi, PERSON)
    street.send(1, 11.0, 1.7, planner="path_following")
    street.send(2, 1.0, 1.7)
    street.run_until_there(40.0)
    assert np.abs(way_of(street)[:, 1] - 1.7).max() < 1e-9


def test_a_path_follower_in_a_gap_backs_out_when_it_is_sent_back() -> None:
    """Where it cannot turn it goes straight back; else it would wait for ever."""
    cells = room(10.0, 4.0)
    cells[:34, 60:120] = cells[46:, 60:120] = 100
    street = Street(environment(cells))
    street.add(1, 4.0, 2.0, 0.0, PERSON)
    street.send(1, 1.5, 2.0, planner="path_following")
    street.run_until_there(30.0)


def test_a_vehicle_that_follows_its_path_waits_and_does_not_steer_around() -> None:
    """It stops behind a pallet; sent elsewhere it goes back first, for it has no room to turn."""
    street = Street(environment(room(20.0, 12.0)))
    street.add(1, 3.0, 6.0, 0.0, SCOOTER)
    street.add(2, 10.0, 6.3, 0.5 * math.pi, PALLET)
    street.send(1, 17.0, 6.0, planner="path_following")
    street.run(30.0)
    assert street.speeds[0] == 0.0
    assert street.obstruction(1)[:2] == (Obstruction.ARTEFACT, 2)
    assert np.abs(way_of(street)[:, 1] - 6.0).max() < 0.02
    street.send(1, 5.0, 10.0, planner="path_following")
    street.run_until_there(60.0, within_m=0.45)


def test_another_planner_is_planned_with_at_once() -> None:
    """Who was to follow its path and is told to use the dynamic window goes round the pallet."""
    street = Street(environment(room(16.0, 8.0)))
    street.add(1, 2.0, 4.0, 0.0, AGV)
    street.add(2, 8.0, 4.0, 0.5 * math.pi, PALLET)
    for planner, seconds in (("path_following", 15.0), ("dynamic_window", 50.0)):
        assert math.dist(street.pose(1)[:2], (14.0, 4.0)) > 6.0
        street.command(1, MotionCommand((14.0, 4.0), 1.4, planner=planner))
        street.run(seconds)
    assert math.dist(street.pose(1)[:2], (14.0, 4.0)) < 0.12
