"""The traffic as its users see it: who is there, what is promised, what does not matter."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from are_ros.agents.body import STAND, Body, MotionCommand
from are_ros.agents.local_planner.planner import Obstruction
from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.world.boxes import overlaps_any
from tests.agents.local_planner.streets import (
    PALLET,
    PERSON,
    Street,
    boxes_at,
    environment,
    room,
)

_HERE = environment(room(16.0, 10.0))


def _crowd(street: Street, ids: list[int]) -> None:
    """Let as many as there are ids stand in rows, in the order given, and walk about."""
    command = sorted(ids)
    for one in ids:
        n = command.index(one)
        street.add(one, 2.0 + 1.5 * (n % 8), 2.0 + 2.0 * (n // 8), 0.3 * n)
    for one in command:
        n = command.index(one)
        street.send(one, 14.0 - 1.4 * (n % 8), 8.5 - 2.0 * (n // 8))


def test_bodies_of_the_catalogue_keep_their_shape_and_limits() -> None:
    """A row's body has its box and what its type can do."""
    row = read_catalogue().rows_named("car_compact_black")[0]
    body = Body.of(row)
    assert body.half_size_m == (0.5 * row.size_m[0], 0.5 * row.size_m[1])
    assert body.centre_m == row.box_centre_in_artefact_m[:2]
    assert (body.speed_mps, body.turn_radius_m) == (row.motion.speed_mps, row.motion.turn_radius_m)
    assert body.height_m == row.size_m[2]


def test_what_was_promised_is_what_happens_until_it_is_planned_anew() -> None:
    """Each pose was on the trajectory that held before, unless that one was replaced."""
    street = Street(_HERE)
    street.add(3, 2.0, 2.0, 0.0)
    street.send(3, 9.0, 2.0)
    kept = 0
    for _ in range(100):
        coming = street.trajectory(3)
        street.step()
        kept += bool((coming[0] == street.pose(3)).all())
        after = street.trajectory(3)
        assert after.shape[1] == 3
        assert len(after) >= 1
    assert kept >= 75


def test_trajectories_overlap_nobodys() -> None:
    """At each instant all that is promised is free of overlaps, as far ahead as anybody moves."""
    street = Street(_HERE)
    _crowd(street, list(range(20)))
    for _ in range(30):
        street.run(0.25)
        _inspect_promises(street)


def _inspect_promises(street: Street) -> None:
    """Lay everybody's trajectory side by side, and test all pairs at each sub-step."""
    ids = street.table.ids.tolist()
    paths = [street.trajectory(one) for one in ids]
    for k in range(max(len(path) for path in paths)):
        poses = np.array([path[min(k, len(path) - 1)] for path in paths])
        boxes = boxes_at(poses, [street.bodies[one] for one in ids])
        assert street.environment.is_placeable(boxes).all()
        for n in range(len(ids) - 1):
            assert not overlaps_any(boxes.at(n), boxes.take(slice(n + 1, None)))[0]


def test_the_order_of_arrival_does_not_matter() -> None:
    """The same ids at the same places do the same, to the last bit, whatever was there before."""
    first, second = Street(_HERE), Street(_HERE)
    ids = [5, 9, 12, 40, 77, 78, 90, 101, 150]
    for one in range(200, 290):
        second.add(one, 8.0, 5.0, 0.0, PALLET)
    for one in range(200, 290):
        second.remove(one)
    second.add(1000, 1.0, 9.0, 0.0)
    _crowd(first, ids)
    _crowd(second, ids[::-1])
    second.remove(1000)
    for _ in range(150):
        first.step()
        second.step()
        assert first.poses.tobytes() == second.poses.tobytes()


def test_many_more_than_at_first_find_room() -> None:
    """The number of artefacts grows beyond any that was foreseen, and poses stay what they were."""
    street = Street(_HERE, inspects=False)
    for one in range(300):
        street.add(one, 0.5 + 0.05 * one, 5.0, 0.1, PALLET)
    assert street.poses[:, 0] == pytest.approx(0.5 + 0.05 * np.arange(300))
    street.step()
    assert street.poses[:, 0] == pytest.approx(0.5 + 0.05 * np.arange(300))
    assert not street.moved.any()


def test_who_is_there_changes_at_once() -> None:
    """Ids ascend; poses, speeds and who moved are in their order, also between two steps."""
    street = Street(_HERE)
    street.add(7, 3.0, 3.0, 0.0)
    street.add(2, 5.0, 5.0, 1.0)
    assert street.table.ids.tolist() == [2, 7]
    assert street.poses[:, 0].tolist() == [5.0, 3.0]
    street.step()
    street.remove(2)
    assert street.poses.tolist() == [[3.0, 3.0, 0.0]]
    assert street.speeds.tolist() == [0.0]
    street.step()
    assert street.moved.tolist() == [False]
    street.remove(7)
    assert len(street.table.ids) == 0
    street.add(4, 1.0, 1.0, 0.0)
    with pytest.raises(ValueError, match="already"):
        street.add(4, 5.0, 1.0, 0.0)


def test_those_without_orders_make_no_plans() -> None:
    """A stand costs nothing, also of one that could walk."""
    street = Street(_HERE)
    _crowd(street, list(range(10)))
    for one in range(10):
        street.command(one, STAND)
    street.run(2.0)
    assert street.plans_made == 0
    assert not street.moved.any()


def test_an_order_to_stand_brakes() -> None:
    """One at full speed comes to a stand within its braking distance, and has no hindrance."""
    street = Street(_HERE)
    street.add(1, 2.0, 5.0, 0.0)
    street.send(1, 12.0, 5.0)
    street.run(3.0)
    x = float(street.pose(1)[0])
    street.command(1, STAND)
    street.run(3.0)
    assert street.speeds[0] == 0.0
    assert street.pose(1)[0] - x < 1.35**2 / 3.0 + 1.35 * 0.3
    assert street.obstruction(1) == (Obstruction.NONE, -1, 0.0)


def test_places_that_nobody_comes_to_are_clear() -> None:
    """A box may stand where no trajectory passes, not on anybody, nor on anybody's way."""
    street = Street(_HERE)
    street.add(1, 2.0, 5.0, 0.0)
    street.send(1, 12.0, 5.0)
    street.run(1.5)
    x = float(street.pose(1)[0])
    places = np.array(
        [[x, 5.0, 0.0], [x + 1.0, 5.0, 0.0], [x + 1.0, 6.0, 0.5], [x - 0.8, 5.0, 0.0]]
    )
    clear = street.planner.is_clear(boxes_at(places, [PERSON] * 4))
    assert clear.tolist() == [False, False, True, True]


def _circle(count: int) -> NDArray[np.float64]:
    angles = np.linspace(0.0, math.pi, count + 1)[1:]
    return np.column_stack((8.0 + 3.0 * np.cos(angles), 5.0 + 3.0 * np.sin(angles), angles))


def test_a_scripted_one_follows_its_poses_and_the_others_plan_around_it() -> None:
    """It is exactly where it was told, for as long; a walker on its way lets it pass."""
    street = Street(_HERE, inspects=False)
    street.add(1, 11.0, 5.0, 0.0)
    street.add(2, 8.0, 3.0, 0.5 * math.pi)
    street.send(2, 8.0, 9.3)
    script = _circle(200)
    for k, row in enumerate(script):
        street.planner.prescribe(0, script[k : k + 30])
        street.step()
        assert (street.pose(1) == row).all()
        assert not overlaps_any(street.boxes().at(0), street.boxes().at(1))[0]
    street.run(6.0)
    assert (street.pose(1) == script[-1]).all()
    assert street.distance(2) < 0.12


def test_a_script_that_is_not_continued_ends_in_a_stand() -> None:
    """As far as it is prescribed the artefact follows it, and then stands, whatever it is told."""
    street = Street(_HERE, inspects=False)
    street.add(1, 11.0, 5.0, 0.0)
    street.planner.prescribe(0, _circle(200)[:20])
    street.send(1, 4.0, 2.0)
    street.run(3.0)
    assert (street.pose(1) == _circle(200)[19]).all()
    assert street.speeds[0] == 0.0


def test_who_waits_says_for_whom_and_how_long() -> None:
    """A walker before a row of boxes across the room names one of them, and the time."""
    street = Street(environment(room(8.0, 2.4)))
    street.add(1, 1.0, 1.2, 0.0)
    street.add(2, 5.0, 1.2, 0.0, Body((0.2, 1.0), speed_mps=0.0))
    street.command(1, MotionCommand((7.0, 1.2), 1.3))
    told = []
    for _ in range(40):
        street.run(0.25)
        told.append(street.obstruction(1))
    kind, who, seconds = max(told, key=lambda obstruction: obstruction[2])
    assert (kind, who) == (Obstruction.ARTEFACT, 2)
    assert 2.0 < seconds < 8.0


def test_a_wall_on_a_new_map_is_not_run_into() -> None:
    """Paths that a new map closes are planned anew at once."""
    street = Street(_HERE)
    street.add(1, 2.0, 5.0, 0.0)
    street.send(1, 14.0, 5.0)
    street.run(2.0)
    cells = room(16.0, 10.0)
    column = round((float(street.pose(1)[0]) + 1.3) / 0.05)
    cells[:, column : column + 4] = 100
    street.environment = environment(cells)
    told = set()
    for _ in range(20):
        street.run(0.5)
        told.add(street.obstruction(1)[0])
    assert street.pose(1)[0] < column * 0.05
    assert told == {Obstruction.NONE, Obstruction.WALL}
