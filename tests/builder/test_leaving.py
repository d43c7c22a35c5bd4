"""Leaving: lives end at an exit, out of view, or when patience does, and the law knows nothing."""

import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

from are_ros.agents.events import EventKind
from are_ros.parameters.declaration import with_values
from are_ros.population.departures import Cause
from are_ros.world.occupancy_grid import OccupancyGrid
from tests.builder.town import POST, WALKER, Town, events_of, hall

WALK_OUT: dict[str, Any] = {"population.leave": "walk_to_exit"}
OPEN_HALL = hall(10.0, 8.0, gap=(9.9, 10.0, 2.0, 6.0))
"""Four metres of the east wall are missing."""


def left(town: Town, artefact_id: int, until_s: float) -> tuple[float, str]:
    """Run until an artefact has departed; return when [s], and why."""
    record = town.run(0.0, until_s)
    gone = [e for e in events_of(record.events, artefact_id) if e.kind is EventKind.DEPARTED]
    assert len(gone) == 1, [(e.kind, e.detail) for e in events_of(record.events, artefact_id)]
    return (gone[0].stamp_ns - town.ns(0.0)) / 1e9, gone[0].detail


def test_one_walks_to_the_exit_and_departs_there() -> None:
    """After the end of its life, at the opening of the map; until then it is alive and leaving."""
    town = Town.of(WALK_OUT, OPEN_HALL)
    walker = town.place(WALKER, 3.0, 4.0, life_s=1.0)
    record = town.run(0.0, 20.0)
    (gone,) = [e for e in events_of(record.events, walker) if e.kind is EventKind.DEPARTED]
    assert gone.detail == "life_over"
    assert 4.0 < (gone.stamp_ns - town.ns(1.0)) / 1e9 < 15.0
    x_m, y_m, _ = record.way_of(walker)[-1]
    assert x_m > 8.0
    assert 2.0 < y_m < 6.0
    behaviours = [m[walker][1] for m in record.moments.values() if walker in m]
    assert behaviours[-1] == "leaving"


def test_a_life_that_is_over_has_no_end_any_more() -> None:
    """While it leaves its departure is not known, and its behaviour is leaving."""
    town = Town.of(WALK_OUT, OPEN_HALL)
    walker = town.place(WALKER, 3.0, 4.0, life_s=1.0)
    assert town.one(walker).departure_ns == town.ns(1.0)
    town.run(0.0, 2.0)
    assert town.one(walker).behaviour == "leaving"
    assert town.one(walker).departure_ns is None


def test_patience_ends_what_finds_no_exit() -> None:
    """With 3 s of it, one departs 3 s after its life, wherever it is, and no later sub-step."""
    town = Town.of(WALK_OUT | {"population.exit_patience": 3.0}, OPEN_HALL)
    walker = town.place(WALKER, 1.5, 4.0, life_s=1.02)
    gone_s, why = left(town, walker, 6.0)
    assert gone_s == pytest.approx(4.05)
    assert why == "life_over"


@pytest.mark.parametrize(("yaw_rad", "is_seen"), [(0.0, True), (math.pi, False)])
def test_without_an_exit_one_vanishes_where_no_camera_sees_it(
    yaw_rad: float, is_seen: bool
) -> None:
    """Behind the robot's camera at once; before it when patience ends, or it is out of view."""
    values = {"population.exit_patience": 2.0, "camera.model": "pinhole", "camera.width": 64}
    town = Town.of(WALK_OUT | values, hall(10.0, 8.0), robot=None)
    for k in range(12):
        town.robot(0.25 * k, 1.0, 4.0, yaw_rad)
        if k == 0:
            walker = town.place(WALKER, 6.0, 4.0, life_s=0.5)
        town.builder.advance(town.ns(0.25 * k))
    gone = [e for e in town.lives.take_events() if e.kind is EventKind.DEPARTED]
    assert [e.artefact_id for e in gone] == [walker]
    gone_s = (gone[0].stamp_ns - town.ns(0.0)) / 1e9
    assert gone_s == pytest.approx(0.5, abs=0.051) if not is_seen else gone_s > 1.0


def test_what_cannot_move_vanishes_when_its_life_is_over() -> None:
    """A post has no feet."""
    town = Town.of(WALK_OUT, OPEN_HALL)
    gone_s, why = left(town, town.place(POST, 5.0, 4.0, life_s=1.0), 2.0)
    assert (gone_s, why) == (1.0, "life_over")


def test_those_who_leave_count_as_alive() -> None:
    """With room for one, arrivals are blocked as long as the one is on its way out."""
    values = {"population.arrival_rate": 0.05, "population.max_alive": 1}
    town = Town.of(WALK_OUT | values | {"population.exit_patience": 60.0}, OPEN_HALL)
    town.place(WALKER, 1.5, 4.0, life_s=0.5)
    record = town.run(0.0, 4.0)
    assert {e.detail for e in record.events if e.kind is EventKind.BLOCKED} == {"max_alive"}
    assert sum(e.kind is EventKind.ARRIVED for e in record.events) == 1


def test_one_on_its_way_out_can_be_removed() -> None:
    """By a request, with that cause, and nothing is left of it."""
    town = Town.of(WALK_OUT, OPEN_HALL)
    walker = town.place(WALKER, 1.5, 4.0, life_s=0.5)
    town.run(0.0, 1.0)
    town.lives.remove(walker, town.ns(1.0), Cause.REMOVED)
    (gone,) = [e for e in town.lives.take_events() if e.kind is EventKind.DEPARTED]
    assert gone.detail == "removed"
    town.run(1.0, 3.0)
    assert not town.lives.population.living


def test_leaving_can_be_switched_while_it_runs() -> None:
    """Whose life ends after the switch vanishes; who was leaving goes on to the exit."""
    town = Town.of(WALK_OUT, OPEN_HALL)
    first, second = (town.place(WALKER, 1.5, 2.0 + 2.0 * k, life_s=0.5 + k) for k in range(2))
    town.run(0.0, 1.0)
    changed = with_values(town.builder.parameters, {"population.leave": "vanish"})
    town.builder.reconfigure(changed, town.ns(1.0))
    record = town.run(1.0, 1.6)
    gone = [e.artefact_id for e in record.events if e.kind is EventKind.DEPARTED]
    assert gone == [second]
    assert town.one(first).behaviour == "leaving"
    record = town.run(1.6, 20.0)
    assert [e.artefact_id for e in record.events if e.kind is EventKind.DEPARTED] == [first]


def test_a_pause_takes_nothing_from_the_patience() -> None:
    """Who has walked for a second when time stands still has its other nine afterwards."""
    town = Town.of(WALK_OUT | {"population.exit_patience": 10.0}, OPEN_HALL)
    walker = town.place(WALKER, 1.5, 4.0, life_s=0.5)
    town.run(0.0, 1.5)
    assert town.one(walker).behaviour == "leaving"
    (state,) = town.lives.crowd.table.states
    assert state is not None
    gained_ns = state.gained_ns
    town.lives.pause(town.ns(1.5), is_paused=True)
    town.builder.advance(town.ns(61.5))
    town.lives.pause(town.ns(61.5), is_paused=False)
    assert state.gained_ns - gained_ns == town.ns(60.0) - town.ns(0.0), "nor is it stuck"
    town.robot(61.5, 0.5, 0.5)
    record = town.run(61.5, 66.5)
    assert [e for e in record.events if e.kind is EventKind.DEPARTED] == []
    assert math.dist(record.way_of(walker)[-1, :2], (1.5, 4.0)) > 4.0


def planned(values: dict[str, Any], grid: OccupancyGrid) -> dict[int, tuple[int, int, int | None]]:
    """Return arrival, row and end of life of all random ones of ten seconds, as drawn."""
    quick = {"population.arrival_rate": 0.02, "population.mean_life": 3.0, "seed": 5}
    town = Town.of(quick | {"population.max_alive": 100_000} | values, grid)
    lives: dict[int, tuple[int, int, int | None]] = {}
    for k in range(200):
        town.builder.advance(town.ns(0.05 * k))
        for i, one in town.lives.population.living.items():
            if one.behaviour != "leaving":
                lives.setdefault(i, (one.arrival_ns, one.row.index, one.departure_ns))
    return lives


def test_the_drawn_lives_do_not_know_how_they_end() -> None:
    """Arrivals, types and ends of lives are bit-identical with vanishing and with walking out."""
    vanish, walk = planned({}, OPEN_HALL), planned(WALK_OUT, OPEN_HALL)
    common = vanish.keys() & walk.keys()
    assert len(common) > 8
    assert len(common) >= 0.8 * max(len(vanish), len(walk))
    assert {i: vanish[i] for i in common} == {i: walk[i] for i in common}


def test_a_crowd_leaves_by_a_door() -> None:
    """Ten whose lives end together are all gone within 25 s, none by losing patience."""
    town = Town.of(WALK_OUT, OPEN_HALL)
    ids = [town.place(WALKER, 2.0 + k % 5, 2.0 + 3.0 * (k // 5), life_s=1.0) for k in range(10)]
    record = town.run(0.0, 26.0)
    gone = {e.artefact_id: e for e in record.events if e.kind is EventKind.DEPARTED}
    assert gone.keys() == set(ids)
    ends = np.array([record.way_of(i)[-1, 0] for i in ids])
    assert (ends > 8.0).all()


# --- by an exit, before the end of the life

BY_EXIT: dict[str, Any] = {"population.leave": "by_exit"}


@pytest.mark.parametrize("y_m", [1.5, 4.0, 6.5])
def test_one_is_at_an_exit_when_its_life_ends(y_m: float) -> None:
    """It vanishes at that instant, not before, and has said that it is leaving."""
    town = Town.of(BY_EXIT, OPEN_HALL, robot=None)
    town.robot(0.0, 0.5, 0.5, math.pi)  # with its back to the opening
    walker = town.place(WALKER, 2.0, y_m, life_s=20.0)
    record = town.run(0.0, 21.0)
    (gone,) = [e for e in events_of(record.events, walker) if e.kind is EventKind.DEPARTED]
    assert gone.stamp_ns == town.ns(20.0)
    x_m, _, _ = record.way_of(walker)[-1]
    assert x_m > 8.0
    changes = [e for e in events_of(record.events, walker) if e.kind is EventKind.CHANGED]
    assert changes[-1].detail == "walking -> leaving"


def test_the_exit_is_one_that_no_camera_sees() -> None:
    """The robot looks at the opening: behind it, a destination takes the place of an exit."""
    values = {"camera.model": "pinhole", "camera.width": 64, "camera.height": 48}
    town = Town.of(BY_EXIT | values, OPEN_HALL, robot=None)
    town.robot(0.0, 4.0, 4.0, 0.0)
    walker = town.place(WALKER, 6.0, 2.0, life_s=25.0)
    for k in range(250):
        town.robot(0.1 * k, 4.0, 4.0, 0.0)
        town.builder.advance(town.ns(0.1 * k))
    pose = town.one(walker).ground_pose_at(town.ns(24.9))
    bearing_rad = math.atan2(pose.y_m - 4.0, pose.x_m - 4.0)
    assert abs(bearing_rad) > math.radians(45.0)


def test_lives_keep_their_law() -> None:
    """Exponential with the mean that was asked for (Kolmogorov-Smirnov)."""
    values = {"population.arrival_rate": 0.02, "population.mean_life": 8.0}
    town = Town.of(BY_EXIT | values, OPEN_HALL)
    record = town.run(0.0, 150.0)
    arrived_ns = {e.artefact_id: e.stamp_ns for e in record.events if e.kind is EventKind.ARRIVED}
    begun_by_s = 150.0 - 60.0  # those that could not have ended are left out
    lives_s = [
        (e.stamp_ns - arrived_ns[e.artefact_id]) / 1e9
        for e in record.events
        if e.kind is EventKind.DEPARTED and arrived_ns[e.artefact_id] < town.ns(begun_by_s)
    ]
    assert len(lives_s) > 80
    assert stats.kstest(lives_s, "expon", args=(0.0, 8.0)).pvalue > 1e-3
