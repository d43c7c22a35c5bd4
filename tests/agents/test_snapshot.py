"""Everybody as the others see them, against a slow twin."""

import math

import numpy as np
import numpy.typing as npt
import pytest

from are_ros.agents.behaviours.open_view import OpenView
from are_ros.agents.behaviours.situation import Neighbour, Situation
from are_ros.agents.mdp.routes import AHEAD
from are_ros.agents.navigation.destinations import Destinations
from are_ros.agents.navigation.step_kernels import (
    FADE_M,
    MINDED_M,
    Crowd,
    GoalSpec,
    Robot,
    find_others,
)
from are_ros.agents.snapshot import AgentSnapshot
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.shapes import Shape
from tests.agents.behaviours.stage import fellow_at, lattice, stream

NO_ROBOT = (np.zeros((AHEAD, 2)), -1.0)
ROBOT = (np.array([(1.0, 2.0), (3.0, 4.0)]), 0.9)
ROW = CatalogueRow(0, "somebody", "person", (0.3, 0.5, 1.7), (0.0, 0.0, 0.0), Shape.PERSON)


def left_half(me: Neighbour, x_m: float, y_m: float) -> bool:
    """See what is to the left, unless one is the third."""
    return me.id != 3 and x_m < 0.0 < abs(y_m) + 1.0


def crowd(
    count: int, seed: int = 1
) -> tuple[AgentSnapshot, dict[int, Artefact], npt.NDArray[np.float64]]:
    """Return so many people anywhere within 20 m, ids 3, 6, 9 ...

    And their numbers: x, y, z, yaw, speed, and two places ahead.
    """
    rng = np.random.default_rng(seed)
    numbers: npt.NDArray[np.float64] = rng.uniform(-10.0, 10.0, (count, 5 + 2 * AHEAD))
    ids = np.arange(3, 3 * count + 3, 3)
    living = {}
    for artefact_id, (x, y, z, yaw, _) in zip(ids.tolist(), numbers[:, :5].tolist(), strict=True):
        history = PoseHistory(0, GroundPose(x, y, z, yaw))
        living[artefact_id] = Artefact(artefact_id, ROW, Origin.RANDOM, 0, history)
    radii_m = 0.2 + 0.01 * np.arange(count, dtype=np.float64)
    ahead_m = numbers[:, 5:].reshape(count, AHEAD, 2)
    columns = (ids, numbers[:, :4], numbers[:, 4], ahead_m, radii_m)

    def doing(behaviour: str) -> npt.NDArray[np.int64]:
        return np.flatnonzero([one.behaviour == behaviour for one in living.values()])

    return AgentSnapshot(list(living.values()), columns, left_half, doing), living, numbers


def test_a_fellow_is_what_the_arrays_say() -> None:
    """Pose, velocity along the heading, radius, behaviour and activity, made once."""
    view, living, numbers = crowd(5)
    living[9].behaviour, living[9].activity = "walking", "pausing"
    neighbour = view.neighbour(9)
    assert neighbour is not None
    x, y, _, yaw, speed = numbers[2, :5].tolist()
    assert (neighbour.x_m, neighbour.y_m, neighbour.yaw_rad) == (x, y, yaw)
    assert (neighbour.vx_mps, neighbour.vy_mps) == pytest.approx(
        (speed * math.cos(yaw), speed * math.sin(yaw))
    )
    assert neighbour.radius_m == pytest.approx(0.22)
    assert (neighbour.behaviour, neighbour.activity) == ("walking", "pausing")
    assert (neighbour.class_name, neighbour.label) == ("person", "somebody")
    assert view.neighbour(9) is neighbour
    living[9].activity = "walking on"
    assert neighbour.activity == "pausing"


def test_who_does_not_live_is_nobody() -> None:
    """Neither an id that never was, nor one between two."""
    view, _, _ = crowd(3)
    assert [view.neighbour(i) for i in (0, 4, 99)] == [None] * 3


def test_by_index_is_the_same_as_by_id() -> None:
    """Before those about them were asked for, and afterwards."""
    (view, living, _), (other, others, _) = crowd(20), crowd(20)
    some = list(living)[4:15:3]
    assert [view.neighbour_at(i) for i in range(4, 15, 3)] == [other.neighbour(i) for i in some]
    assert list(view.within(0.0, 0.0, 7.0))
    assert [view.neighbour_at(i) for i in range(20)] == [other.neighbour(i) for i in others]


@pytest.mark.parametrize("radius_m", [0.01, 12.0, 30.0])
def test_the_destinations_nearest_to_those_near(radius_m: float) -> None:
    """One for each of them, in their order, as by hand; not for the one that asks."""
    view, living, _ = crowd(40)
    for k, one in enumerate(living.values()):
        one.behaviour = ("walking", "gathering")[k % 2]
        one.activity = ("", "waiting", "talking")[k % 3]
    some_m, others_m = np.random.default_rng(3).uniform(-12.0, 12.0, (2, 9, 2))
    hosts, me, count = ("gathering", ("waiting", "talking")), view.neighbour_at(1), 0
    by_hand = OpenView([view.neighbour_at(i) for i in range(40)])
    for points_m in (some_m, others_m, some_m):
        places = Destinations(points_m.copy(), np.empty((0, 2)))
        found = view.places_within(me, radius_m, *hosts, places)
        assert list(found) == by_hand.places_within(me, radius_m, *hosts, places)
        count += len(found)
    assert (count > 0) == (radius_m > 1.0)


@pytest.mark.parametrize("radius_m", [0.0, 2.0, 7.0, 50.0])
def test_who_is_near_comes_nearest_first(radius_m: float) -> None:
    """The same as by sorting all."""
    view, _, numbers = crowd(60)
    for x_m, y_m in ((0.0, 0.0), (-9.0, 4.0), (200.0, 0.0)):
        distances = np.hypot(numbers[:, 0] - x_m, numbers[:, 1] - y_m)
        order = [int(i) for i in np.argsort(distances, kind="stable") if distances[i] <= radius_m]
        assert [f.id for f in view.within(x_m, y_m, radius_m)] == [3 * i + 3 for i in order]


def test_who_is_near_can_be_asked_for_by_what_it_does() -> None:
    """Of one behaviour, at one of some activities; the same as by looking at all."""
    view, living, _ = crowd(40)
    for k, one in enumerate(living.values()):
        one.behaviour = ("walking", "gathering")[k % 2]
        one.activity = ("", "waiting", "talking")[k % 3]
    everybody = list(view.within(0.0, 0.0, 9.0))
    gathering = list(view.within(0.0, 0.0, 9.0, "gathering"))
    assert gathering == [f for f in everybody if f.behaviour == "gathering"]
    hosts = list(view.within(0.0, 0.0, 9.0, "gathering", ("waiting", "talking")))
    assert hosts == [f for f in gathering if f.activity]
    assert 0 < len(hosts) < len(gathering) < len(everybody)
    talking = list(view.within(0.0, 0.0, 9.0, activities=("talking",)))
    assert talking == [f for f in everybody if f.activity == "talking"]


def minded(
    view: AgentSnapshot, index: int, robot: Robot = NO_ROBOT, *, is_patient: bool = True
) -> npt.NDArray[np.float64]:
    """Return who is minded about one, by epoch as rows of x, y, radius, fade and weight."""
    everybody = Crowd(view.crowd[:8], *view.crowd[8:])
    going = GoalSpec(0.2, (0.0, 0.0), (0.0, 0.0), 0.4, 0.7, drives=False)
    return find_others(everybody, robot, index, is_patient, going)


@pytest.mark.parametrize("robot", [NO_ROBOT, ROBOT])
def test_others_are_minded_where_they_will_be(robot: Robot) -> None:
    """All but oneself who are near now, the nearest first; then the robot, if there is one."""
    view, _, numbers = crowd(300)
    (index,) = view.indices_of([30])
    found = minded(view, index, robot)
    away = np.hypot(*(numbers[:, :2] - numbers[index, :2]).T)
    near = [i for i in np.argsort(away).tolist() if i != index and away[i] <= MINDED_M]
    for epoch in range(AHEAD):
        expected = [
            (*numbers[i, 5 + 2 * epoch : 7 + 2 * epoch].tolist(), 0.4 + 0.01 * i, FADE_M, 0.4)
            for i in near
        ]
        if robot is ROBOT:
            expected.append(((1.0, 3.0)[epoch], (2.0, 4.0)[epoch], 0.9 + 0.2, FADE_M, 0.7))
        assert len(expected) > 5
        np.testing.assert_allclose(found[epoch], expected)


def test_alone_nobody_is_minded() -> None:
    """Nor in a crowd, by who is not to mind anybody; the robot neither."""
    assert minded(crowd(1)[0], 0).shape == (AHEAD, 0, 5)
    assert minded(crowd(300)[0], 7, ROBOT, is_patient=False).shape == (AHEAD, 0, 5)


def test_seeing_is_asked_with_who_looks() -> None:
    """The callable gets the fellow and the point."""
    view, _, _ = crowd(2)
    third, sixth = view.neighbour(3), view.neighbour(6)
    assert third is not None
    assert sixth is not None
    assert view.sees(sixth, -1.0, 2.0)
    assert not view.sees(sixth, 1.0, 2.0)
    assert not view.sees(third, -1.0, 2.0)


def test_a_text_among_activities_is_one_of_them() -> None:
    """Who does nothing in particular was found, too: an empty text is a part of each."""
    told = ("dancing", "", "dan", "standing")
    fellows = [
        fellow_at((1.0 + n, 0.0), artefact_id=n, behaviour="m:Party", activity=activity)
        for n, activity in enumerate(told)
    ]
    me, places = fellow_at((0.0, 0.0), artefact_id=9), lattice()
    found = Situation(0, me, ROW, places, stream(), OpenView([*fellows, me]))
    for behaviour in ("", "m:Party"):
        assert [one.id for one in found.neighbours_within(9.0, behaviour, "dancing")] == [0]
        assert len(found.places_within(9.0, behaviour, "dancing")) == 1
    assert [one.id for one in found.neighbours_within(9.0, activities={"dancing", ""})] == [0, 1]
