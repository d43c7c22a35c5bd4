"""Following waypoints."""

import math

import pytest

from bags.simulation.robot import (
    Command,
    DriveLimits,
    RobotState,
    RouteFollower,
    Waypoint,
    drive,
)

LIMITS = DriveLimits()


def follow(route: RouteFollower, seconds: float) -> list[RobotState]:
    """Return the states of a robot that starts at the origin, 100 a second."""
    states = [RobotState(0.0, 0.0, 0.0)]
    for _ in range(round(100 * seconds)):
        states.append(drive(states[-1], route.command(states[-1]), LIMITS, 0.01))
    return states


def test_it_passes_by_a_waypoint_and_stops_at_the_last() -> None:
    """It comes within 0.25 m of the first at speed, and comes to rest on the second."""
    route = RouteFollower([Waypoint(2.0, 0.3), Waypoint(4.0, 0.0)], LIMITS)
    states = follow(route, 15.0)
    nearest = min(states, key=lambda state: math.hypot(state.x_m - 2.0, state.y_m - 0.3))
    assert math.hypot(nearest.x_m - 2.0, nearest.y_m - 0.3) < 0.25
    assert nearest.speed_m_s > 0.5
    assert route.is_done
    assert (states[-1].x_m, states[-1].y_m) == pytest.approx((4.0, 0.0), abs=0.06)
    assert states[-1].speed_m_s == 0.0


def test_it_looks_around_in_order() -> None:
    """On the waypoint it turns to each heading, by the shorter way, without leaving it."""
    looks = (2.0, -1.0, 3.0)
    route = RouteFollower([Waypoint(1.0, 0.0, looks)], LIMITS)
    states = follow(route, 20.0)
    there = [state for state in states if state.x_m > 0.95]
    assert max(math.hypot(state.x_m - 1.0, state.y_m) for state in there) < 0.06
    times = [
        next(
            k for k, s in enumerate(there) if abs(math.remainder(s.yaw_rad - look, math.tau)) < 0.03
        )
        for look in looks
    ]
    assert times == sorted(times)
    assert there[-1].yaw_rad == pytest.approx(3.0 - math.tau, abs=0.06)


def test_a_waypoint_behind_is_turned_to_first() -> None:
    """The robot does not sweep aside: it turns on the spot."""
    states = follow(RouteFollower([Waypoint(-1.0, 0.0)], LIMITS), 12.0)
    assert max(abs(state.y_m) for state in states) < 0.05
    assert max(state.x_m for state in states) < 0.05
    assert states[-1].x_m == pytest.approx(-1.0, abs=0.06)


def test_an_empty_route_stands() -> None:
    """Nothing to do is done at once."""
    route = RouteFollower([], LIMITS)
    assert route.is_done
    assert route.command(RobotState(0.0, 0.0, 0.0)) == Command()
