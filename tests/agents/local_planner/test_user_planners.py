"""Planners of the user's own: they wish, the search decides; who fails is named in a sentence."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from are_ros.agents.body import PLANNERS
from are_ros.agents.local_planner.robot import RobotMotion
from are_ros.agents.local_planner.user_planners import why_not
from are_ros.errors import BehaviourError
from are_ros.world.footprint import Footprint, signed_distance_m
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap
from tests.agents.local_planner import own_planners
from tests.agents.local_planner.own_planners import MODULE
from tests.agents.local_planner.streets import PERSON, SCOOTER, Street, environment, room

FILE = Path(own_planners.__file__)


def test_who_drives_into_others_collides_with_nobody() -> None:
    """Six of them among people and scooters that walk about; the street inspects all."""
    random = np.random.default_rng(3)
    street = Street(environment(room(12.0, 9.0)))
    for n in range(12):
        body = SCOOTER if n % 4 == 2 else PERSON
        street.add(n, 1.5 + 3.0 * (n % 4), 1.5 + 3.0 * (n // 4), random.uniform(-3.0, 3.0), body)
    moved_m = np.zeros(12)
    for k in range(600):
        if k % 5 == 0:
            one = int(random.integers(12))
            planner = f"{MODULE}:Rammer" if one % 2 else "dynamic_window"
            street.send(one, *random.uniform((0.7, 0.7), (11.3, 8.3)), planner=planner)
        before = street.poses
        street.step()
        moved_m += np.hypot(*(street.poses - before)[:, :2].T)
    assert moved_m[1::2].min() > 0.5
    assert street.emergency_stops == 0


def test_who_drives_into_a_robot_that_stands_does_not_touch_it() -> None:
    """It comes near, and brakes."""
    street = Street(environment(room(12.0, 8.0)))
    street.add(1, 2.0, 4.0, 1.0)
    street.send(1, 11.0, 4.0, planner=f"{MODULE}:Rammer")
    footprint = Footprint.disc(0.3).at(7.0, 4.5, 0.0)
    robot = RobotMotion(footprint, 7.0, 4.5, 0.0, 0.0, 0.0, 0.0)
    for _ in range(240):
        street.step(robot)
        assert signed_distance_m(footprint, street.boxes()).min() > 0.0
    assert signed_distance_m(footprint, street.boxes()).min() < 1.6
    assert street.speeds[0] == 0.0


def test_the_first_wish_that_is_free_comes_true() -> None:
    """To the left in the open; straight on along a wall to the left; others make no difference."""
    ways = []
    for y_m in (2.0, 7.4):
        street = Street(environment(room(14.0, 8.0)))
        street.add(1, 2.0, y_m, 0.0)
        street.send(1, 12.0, y_m, planner=f"{MODULE}:Sideways")
        street.run(2.5)
        ways.append(street.pose(1)[:2] - (2.0, y_m))
        street.run_until_there(20.0)
    assert ways[0][1] > 2.0 > ways[0][0]
    assert ways[1][0] > 2.0
    assert ways[1][1] < 0.35


def test_a_vehicle_steers_towards_its_wish_and_reverses_for_a_negative_speed() -> None:
    """With its nose at a wall it goes back, at the speed that it wishes."""
    street = Street(environment(room(16.0, 10.0)))
    street.add(1, 8.0, 8.9, 0.5 * math.pi, SCOOTER)
    street.send(1, 13.0, 3.0, planner=f"{MODULE}:Sideways")
    slowest_mps = 0.0
    for _ in range(60):
        street.step()
        slowest_mps = min(slowest_mps, float(street.speeds[0]))
    assert slowest_mps == pytest.approx(-0.5, abs=0.01)
    assert why_not(f"{MODULE}:Sideways") is None


def test_what_a_planner_sees() -> None:
    """Itself, its command, the others by distance, the robot, the walls, the time."""
    street = Street(environment(room(14.0, 8.0)))
    for one, x_m, y_m in ((1, 2.0, 3.0), (4, 5.0, 3.0), (6, 3.5, 3.0), (9, 13.0, 3.0)):
        street.add(one, x_m, y_m, 0.0)
    street.send(4, 11.0, 3.0)
    street.run(1.0)
    street.send(1, 12.0, 4.0, stop_there=False, planner=f"{MODULE}:Looks")
    robot = RobotMotion(Footprint.disc(0.3).at(7.0, 6.0, 0.0), 7.0, 6.0, 0.0, 0.3, 0.1, 0.0)
    street.step(robot)
    scene = own_planners.Looks.seen
    assert scene.now_ns == 1_000_000_000
    assert scene.me[:4] == (2.0, 3.0, 0.0, 0.0)
    assert scene.me.radius_m == pytest.approx(PERSON.radius_m, abs=0.1)
    assert scene.goal_m == (12.0, 4.0)
    assert (scene.speed_mps, scene.stop_there, scene.turn_radius_m) == (1.35, False, 0.0)
    assert [round(one.x_m, 1) for one in scene.others] == [3.5, pytest.approx(5.8, abs=0.3)]
    assert scene.others[1].vx_mps > 1.0
    assert scene.robot == (7.0, 6.0, 0.3, 0.1, 0.3)
    assert scene.clearance_m(2.0, 3.0) == pytest.approx(1.9, abs=0.08)
    street.run(1.0)
    assert street.speeds[0] == 0.0  # it proposed nothing, so it brakes


def test_a_planner_sees_what_hangs_over_the_floor() -> None:
    """A table top at the height of a head is closed to a person, and its clearance is 0."""
    along = np.arange(0.5, 1.5, 0.1) + 5.05
    top = np.array([(x_m, y_m, 0.75) for x_m in along for y_m in along])
    voxels = VoxelMap.from_centres(top, 0.1, RigidTransform.identity())
    street = Street(environment(room(14.0, 14.0), voxels=voxels))
    street.add(1, 2.0, 3.0, 0.0)
    street.send(1, 12.0, 4.0, planner=f"{MODULE}:Looks")
    street.step()
    scene = own_planners.Looks.seen
    assert scene.clearance_m(6.0, 6.0) == 0.0
    assert scene.clearance_m(2.0, 6.0) > 1.5
    assert scene.clearance_m(-1.0, 6.0) == 0.0


def test_one_that_raises_stops_a_replay_with_one_sentence() -> None:
    """It names the planner, the artefact, the time and the line."""
    street = Street(environment(room(14.0, 8.0)))
    street.add(7, 2.0, 4.0, 0.0)
    street.send(7, 12.0, 4.0, planner=f"{MODULE}:Late")
    line = next(n for n, text in enumerate(FILE.read_text().splitlines(), 1) if "late boom" in text)
    with pytest.raises(BehaviourError) as caught:
        street.run(3.0)
    assert str(caught.value) == (
        f"the planner {MODULE}:Late of artefact 7 (one) failed at 1.000 s: ValueError: late boom "
        f"({FILE}, line {line})"
    )


def test_one_that_raises_is_told_once_and_its_agent_brakes() -> None:
    """Where somebody listens; it is not asked again."""
    told: list[tuple[int, str]] = []
    street = Street(environment(room(14.0, 8.0)))
    street.planner.user_planners.stop = lambda who, fault, _: told.append((who, str(fault)))
    street.add(7, 2.0, 4.0, 0.0)
    for _ in range(5):
        street.send(7, 12.0, 4.0, planner=f"{MODULE}:Late")
        street.run(1.0)
    assert [who for who, _ in told] == [7]
    assert street.speeds[0] == 0.0
    assert 3.0 < street.pose(7)[0] < 5.0


BAD: list[tuple[Any, str]] = [
    (None, "None, which is no sequence of wishes"),
    ("left", "a str, which is no sequence of wishes"),
    (1.0, "a float, which is no sequence of wishes"),
    ([(0.0, 1.0)] * 17, "17 wishes: at most 16 are taken"),
    ([0.0, 1.0], "the wish 0.0: a tuple of two finite numbers is needed"),
    ([(0.0, 1.0, 2.0)], "the wish (0.0, 1.0, 2.0): "),
    ([(math.nan, 1.0)], "the wish (nan, 1.0): "),
    ([(0.0, math.inf)], "the wish (0.0, inf): "),
    ([(10**400, 1.0)], "the wish (1000"),
]


@pytest.mark.parametrize(("what", "words"), BAD, ids=[words for _, words in BAD])
def test_what_are_no_wishes_is_said(what: Any, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Which wish, and what is needed."""
    monkeypatch.setattr(own_planners.Returns, "what", what)
    street = Street(environment(room(14.0, 8.0)))
    street.add(7, 2.0, 4.0, 0.0)
    street.send(7, 12.0, 4.0, planner=f"{MODULE}:Returns")
    with pytest.raises(BehaviourError, match=r"failed at 0\.000 s: propose returned ") as caught:
        street.step()
    assert words in str(caught.value)


def test_names_of_no_planners_are_refused_with_the_reason() -> None:
    """Those of are_ros are known; the others are imported and looked at."""
    assert [why_not(name) for name in PLANNERS] == [None, None, None]
    assert why_not("swarm") == (
        "is not known; known are dynamic_window, social_force, path_following, and module:Class"
    )
    assert str(why_not("nowhere:One")).startswith("cannot be imported (ModuleNotFoundError")
    assert why_not(f"{MODULE}:NoMethod") == "has no method propose"


def test_planners_of_those_who_left_are_forgotten() -> None:
    """And a new one of the same id has its own."""
    street = Street(environment(room(14.0, 8.0)))
    for one in (1, 2):
        street.add(one, 2.0, 2.0 * one, 0.0)
        street.send(one, 12.0, 2.0 * one, planner=f"{MODULE}:Sideways")
    street.run(1.0)
    street.remove(1)
    street.step()
    assert set(street.planner.user_planners._owned) == {2}


def test_the_planner_of_the_documentation_hurries(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The class of docs/planners.md gets to its goal, around somebody to the left."""
    monkeypatch.syspath_prepend(tmp_path)
    text = (Path(__file__).parents[3] / "docs" / "planners.md").read_text()
    (tmp_path / "hurrying.py").write_text(text.split("```python\n")[1].split("```")[0])
    assert why_not("hurrying:Hurrying") is None
    street = Street(environment(room(14.0, 8.0)))
    street.add(1, 2.0, 4.0, 0.0)
    street.add(2, 7.0, 4.0, 0.0)
    street.send(1, 12.0, 4.0, planner="hurrying:Hurrying")
    street.run_until_there(20.0)
    assert max(float(poses[0, 1]) for poses in street.track) > 4.4
