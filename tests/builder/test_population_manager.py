"""The lives in the real world: who comes, who goes, who is moved, and that nothing else decides."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from are_ros.agents.events import ArtefactEvent, EventKind
from are_ros.builder.population_manager import population_of
from are_ros.errors import (
    CatalogueError,
    FrameError,
    InputError,
    ParameterError,
    PlacementError,
    ScenarioError,
)
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import Artefact, GroundPose, boxes_of
from are_ros.population.birth_death import BirthDeath
from are_ros.population.population import Counts
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.footprint import signed_distance_m
from tests.world.overlapping import overlapping_pairs

Scene = Any
"""The `Scene` of conftest, which tests cannot import."""
Make = Callable[..., Scene]
LATER = (ArtefactEvent(2**62, EventKind.ARRIVED, 0, ""),)
"""For where nothing else happens later."""
BUSY = {"population.arrival_rate": 0.2, "population.mean_life": 3.0}
"""About three arrivals a second on the room's 14 m^2, nine alive."""


def kinds(events: list[ArtefactEvent]) -> list[tuple[EventKind, str]]:
    """Return what happened, and why."""
    return [(event.kind, event.detail) for event in events]


# --- placing


def test_a_placed_artefact_lives_until_its_life_is_over(scene: Scene) -> None:
    """It arrives at the very time, departs at the very time, and both are said."""
    artefact_id = scene.place(0, (2.5, 2.0), 0.32, life_s=0.5)
    scene.builder.advance(scene.ns(2.0))
    arrived, departed = scene.builder.lives.take_events()
    assert (arrived.kind, arrived.stamp_ns) == (EventKind.ARRIVED, scene.ns(0.32))
    assert (departed.kind, departed.stamp_ns) == (EventKind.DEPARTED, scene.ns(0.82))
    assert arrived.artefact_id == departed.artefact_id == artefact_id
    assert departed.detail == "life_over"


@pytest.mark.parametrize(
    ("x", "reason"),
    [
        (0.2, "in a wall"),
        (-3.0, "not on free cells"),
        (2.8, "overlap another artefact"),
        (1.45, "robot.clearance"),
        (float("nan"), "not on free cells"),
    ],
)
def test_a_placement_that_overlaps_is_refused_with_the_reason(
    scene: Scene, x: float, reason: str
) -> None:
    """Nothing is moved, and nothing is left behind."""
    scene.place(0, (2.5, 2.0), 0.1)
    with pytest.raises(PlacementError, match=reason):
        scene.place(0, (x, 2.0), 0.2)
    assert len(scene.builder.lives.scene_at(scene.ns(0.2)).artefacts) == 1
    assert kinds(scene.builder.lives.take_events()) == [(EventKind.ARRIVED, "")]


@pytest.mark.parametrize(
    ("behaviour", "reason"),
    [
        ("walkin", "is not known; known are standing, walking"),
        ("walking", "needs an artefact that moves"),
        ("along_way", "needs a way, which only a scenario gives"),
    ],
)
def test_a_placement_with_a_behaviour_that_the_row_cannot_have_is_refused(
    scene: Scene, behaviour: str, reason: str
) -> None:
    """Nothing is left behind; the sentence names row, behaviour and reason."""
    row, pose = scene.row(0), GroundPose(2.5, 2.0, 0.0, 0.0)
    with pytest.raises(CatalogueError, match=f"{row.label}: behaviour '{behaviour}' {reason}"):
        scene.builder.lives.place(row, pose, scene.ns(0.1), behaviour=behaviour)
    assert not scene.builder.lives.scene_at(scene.ns(0.2)).artefacts
    assert not scene.builder.lives.take_events()


def test_a_placement_at_no_finite_height_is_refused(scene: Scene) -> None:
    """No wall is there, and yet it is nowhere."""
    pose = GroundPose(2.5, 2.0, float("nan"), 0.0)
    with pytest.raises(PlacementError, match="its height is not finite"):
        scene.builder.lives.place(scene.row(0), pose, scene.ns(0.1))
    assert not scene.builder.lives.scene_at(scene.ns(0.2)).artefacts


@pytest.mark.parametrize("pose", [GroundPose(2, 2, 0, 0), (2.0, 2.0, 0.0, 0.0)])
def test_a_placement_takes_whole_numbers_and_a_tuple(scene: Scene, pose: Any) -> None:
    """One in whole numbers was refused by numpy, and left half an artefact behind."""
    lives = scene.builder.lives
    artefact_id = lives.place(scene.row(0), pose, scene.ns(0.1))
    (one,) = lives.scene_at(scene.ns(0.1)).artefacts
    assert (one.id, one.ground_pose_at(scene.ns(0.2))) == (artefact_id, (2.0, 2.0, 0.0, 0.0))
    assert lives.clear(scene.ns(0.2)) == 1


def test_a_negative_seed_is_refused(scene: Scene) -> None:
    """And nothing else is drawn than before."""
    with pytest.raises(ParameterError, match="the seed -7 is negative"):
        scene.builder.reseed(-7, scene.ns(0.1))
    assert scene.place(0, (2.5, 2.0), 0.2) > 0


def test_a_placement_for_a_negative_life_is_refused(scene: Scene) -> None:
    """It would depart before it has arrived."""
    pose = GroundPose(2.5, 2.0, 0.0, 0.0)
    with pytest.raises(PlacementError, match=r"a life of -1\.5 s is negative"):
        scene.builder.lives.place(scene.row(0), pose, scene.ns(0.1), life_ns=-1_500_000_000)
    assert not scene.builder.lives.scene_at(scene.ns(0.2)).artefacts
    assert not scene.builder.lives.take_events()


def test_nothing_is_placed_before_there_is_a_map(make_scene: Make) -> None:
    """The reason says so."""
    with pytest.raises(PlacementError, match="there is no map yet"):
        make_scene().place(0, (2.0, 2.0), 0.0)


def test_the_bound_on_the_living_holds_for_placements_too(make_scene: Make) -> None:
    """With max_alive 1, the second is refused."""
    scene = make_scene({"population.max_alive": 1})
    scene.map(0.0)
    scene.place(0, (2.0, 2.0), 0.0)
    with pytest.raises(PlacementError, match="max_alive"):
        scene.place(0, (3.0, 2.0), 0.0)


def test_who_was_placed_before_the_process_starts_stays(make_scene: Make) -> None:
    """Before the robot's pose is known nobody arrives; who was placed then lives on, or ends."""
    scene = make_scene(BUSY)
    scene.map(0.0)
    brief = scene.place(0, (3.0, 3.0), 0.1, life_s=0.5)
    long = scene.place(0, (3.0, 1.0), 0.1, life_s=50.0)
    scene.builder.advance(scene.ns(1.0))
    assert [event.artefact_id for event in scene.builder.lives.take_events()] == [
        brief,
        long,
        brief,
    ]
    scene.robot(1.0, 1.0, 2.0)
    scene.builder.advance(scene.ns(1.5))
    assert long in scene.builder.lives.population.living


def test_a_life_shorter_than_a_sub_step_ends_in_time(scene: Scene) -> None:
    """The tick after its end does not have it, and tells of the end."""
    artefact_id = scene.place(0, (2.5, 2.0), 0.1, life_s=0.01)
    tick = scene.tick(0.2)
    assert tick.artefacts == ()
    ended = [e.stamp_ns for e in tick.events if e.kind is EventKind.DEPARTED]
    assert ended == [scene.ns(0.11)]
    assert artefact_id not in scene.builder.lives.population.living


# --- arrivals at random


def test_arrivals_begin_when_map_and_robot_are_known(make_scene: Make) -> None:
    """Neither alone starts the process; the area is that of the room."""
    scene = make_scene(BUSY)
    scene.robot(0.0, 1.0, 2.0)
    scene.builder.advance(scene.ns(5.0))
    assert scene.builder.lives.population.counts == Counts()
    scene.map(5.0)
    scene.robot(5.0, 1.0, 2.0)
    scene.builder.advance(scene.ns(10.0))
    events = scene.builder.lives.take_events()
    counts = scene.builder.lives.population.counts
    assert counts.arrived + counts.blocked > 5
    assert min(event.stamp_ns for event in events) >= scene.ns(5.0)
    assert scene.builder.lives.area_m2 == pytest.approx(38 * 38 * 0.01, abs=0.5)


@pytest.mark.parametrize(
    ("values", "waits"),
    [({}, True), ({"population.region": "free"}, False), ({"population.arrival_rate": 0.0}, False)],
)
def test_it_tells_whether_arrivals_wait_for_the_robot(
    make_scene: Make, values: dict[str, Any], *, waits: bool
) -> None:
    """Until its first pose, and not again when that is lost."""
    scene = make_scene(BUSY | values)
    scene.map(0.0)
    scene.builder.advance(scene.ns(1.0))
    assert scene.builder.lives.awaits_robot == waits
    scene.robot(1.0, 1.0, 2.0)
    for t_s in (1.1, 30.0):
        scene.builder.advance(scene.ns(t_s))
        assert not scene.builder.lives.awaits_robot


def _boxes_at_arrival(artefacts: list[Artefact]) -> OrientedBoxes:
    poses = [one.ground_pose_at(one.arrival_ns) for one in artefacts]
    return boxes_of([one.row for one in artefacts], poses)


FULL = BUSY | {"population.initial": "stationary", "population.mean_life": 10.0}


def test_a_run_may_begin_with_as_many_as_after_a_long_time(make_scene: Make) -> None:
    """All at one instant, when map and robot are known; again after a jump of the clock."""
    scene = make_scene(FULL)
    scene.map(5.0)
    scene.builder.advance(scene.ns(5.0))
    assert not scene.builder.lives.take_events()
    scene.robot(5.0, 1.0, 2.0)
    scene.builder.advance(scene.ns(5.2))
    living = [*scene.builder.lives.population.living.values()]
    first = [one for one in living if one.arrival_ns == min(o.arrival_ns for o in living)]
    assert len(first) > 3
    assert len(overlapping_pairs(_boxes_at_arrival(first))) == 0
    assert all(not one.row.forever for one in first)
    before = {one.id for one in living}
    scene.robot(1.0, 1.0, 2.0)
    scene.builder.advance(scene.ns(1.2))
    anew = scene.builder.lives.population.living
    assert len(anew) > 3
    assert not before & set(anew)


@pytest.mark.parametrize(
    "change",
    [
        {"population.initial": "empty"},
        {"population.arrival_rate": 0.0},
        {"population.max_alive": 0},
        {"population.scenario": "NOBODY"},
    ],
)
def test_a_run_begins_empty_otherwise(
    make_scene: Make, tmp_path: Path, change: dict[str, Any]
) -> None:
    """By default, and where nobody comes at random."""
    path = tmp_path / "nobody.yaml"
    path.write_text("{scenario: {random: false}, artefacts: []}", encoding="utf-8")
    given = {key: str(path) if value == "NOBODY" else value for key, value in change.items()}
    scene = make_scene(FULL | given)
    scene.map(0.0)
    scene.robot(0.0, 1.0, 2.0)
    scene.builder.advance(scene.ns(0.1))
    assert not scene.builder.lives.population.living


SLOW = FULL | {"population.arrival_rate": 0.01, "population.mean_life": 1e6}
CROWDED = SLOW | {"population.region": "free", "population.max_alive": 3}
"""Far more would be there without the bound, but none comes in the first instants."""


@pytest.mark.parametrize("seed", range(4))
def test_a_run_begins_with_rows_that_fit(make_scene: Make, seed: int) -> None:
    """In pockets of half a metre only posts do; as many are there as the law of these says."""
    scene = make_scene(CROWDED | {"seed": seed})
    walls = range(6, 40, 6)
    scene.map(0.0, *((k, k + 1, 0, 40) for k in walls), *((0, 40, k, k + 1) for k in walls))
    scene.robot(0.0, 1.0, 2.0)
    scene.builder.advance(scene.ns(0.1))
    living = scene.builder.lives.population.living.values()
    assert [one.row.label for one in living] == ["post"] * 3
    assert {event.kind for event in scene.builder.lives.take_events()} == {EventKind.ARRIVED}


def test_who_is_outside_the_law_takes_of_the_bound_at_the_beginning(make_scene: Make) -> None:
    """The number is drawn for what is left; nobody comes to be blocked."""
    scene = make_scene(CROWDED)
    scene.map(0.0)
    scene.place(0, (3.0, 3.0), 0.0)
    scene.place(3, (3.0, 1.0), 0.0)
    scene.robot(0.0, 1.0, 2.0)
    scene.builder.advance(scene.ns(0.1))
    assert len(scene.builder.lives.population.living) == 3
    assert kinds(scene.builder.lives.take_events()) == [(EventKind.ARRIVED, "")] * 3


def test_who_came_before_the_robot_was_known_is_one_of_the_number(
    make_scene: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the region needs no robot, or after a jump of the clock; it is no second number."""
    monkeypatch.setattr(BirthDeath, "drawn", lambda *_: 8)
    scene = make_scene(SLOW | {"population.region": "free"})
    scene.map(0.0)
    scene.builder.advance(scene.ns(40.0))
    living = scene.builder.lives.population.living
    assert 0 < len(living) < 8
    scene.robot(40.0, 1.0, 2.0)
    scene.builder.advance(scene.ns(40.1))
    assert len(living) == 8


def test_a_new_seed_draws_another_beginning(make_scene: Make) -> None:
    """All of it: a node that is seeded anew begins as one that had this seed from the start."""

    def begun(seed: int) -> list[tuple[str, GroundPose]]:
        scene = make_scene(FULL | {"seed": seed})
        scene.map(0.0)
        scene.robot(0.0, 1.0, 2.0)
        scene.builder.reseed(7, scene.ns(0.0))
        scene.builder.advance(scene.ns(0.1))
        living = scene.builder.lives.population.living.values()
        return [(one.row.label, one.ground_pose_at(scene.ns(0.1))) for one in living]

    assert begun(1) == begun(2) == begun(7) != []


def test_a_run_waits_for_a_region_to_begin_in(make_scene: Make) -> None:
    """Also where the first map after a jump of the clock has no free cell."""
    scene = make_scene(FULL)
    scene.map(0.0)
    scene.robot(0.0, 1.0, 2.0)
    scene.builder.advance(scene.ns(3.0))
    scene.map(3.01, (0, 40, 0, 40))
    scene.robot(1.0, 1.0, 2.0)
    scene.builder.advance(scene.ns(1.2))
    assert not scene.builder.lives.population.living
    scene.map(1.2)
    scene.builder.advance(scene.ns(1.3))
    assert len(scene.builder.lives.population.living) > 3


@pytest.mark.parametrize("group_size", [1.0, 4.0])
def test_arrivals_overlap_nothing_at_the_instant_they_come(
    make_scene: Make, group_size: float
) -> None:
    """Not even members of one group each other: nobody ever has to be moved."""
    scene = make_scene(BUSY | {"population.group_size": group_size})
    scene.map(0.0)
    scene.robot(0.0, 1.0, 2.0)
    lives = scene.builder.lives
    for _ in range(60):
        due_ns = lives.population.next_event_ns() or scene.ns(0.05)
        scene.builder.advance(due_ns)
        living = lives.scene_at(due_ns).artefacts
        boxes = boxes_of([a.row for a in living], [a.ground_pose_at(due_ns) for a in living])
        assert len(overlapping_pairs(boxes)) == 0
        assert not scene.builder.world.environment.hits_wall(boxes).any()
        robot = scene.builder.robots.last.footprint
        assert (signed_distance_m(robot, boxes) >= 0.1 - 1e-9).all()
    assert lives.population.counts.arrived > 15
    assert lives.crowd.counts.displaced == 0


def busy_run(scene: Scene, late_s: float) -> list[ArtefactEvent]:
    """Return what happens when walls and a robot come and go, all received `late_s` late."""
    for step in range(60):
        scene.map(0.1 * step + late_s, (10, 30, 18, 38) if step % 2 else (2, 8, 18, 38))
        stamp_ns, now_ns = scene.ns(0.1 * step), scene.ns(0.1 * step + late_s)
        place = (1.0 + 0.01 * step, 2.0, 0.0)
        turn = (0.0, 0.0, 0.0, 1.0)
        scene.builder.receive_transform("map", "base_link", stamp_ns, place, turn, now_ns)
    scene.builder.advance(scene.ns(6.0))
    events: list[ArtefactEvent] = scene.builder.lives.take_events()
    return events


def test_the_instant_of_reception_within_a_sub_step_decides_nothing(make_scene: Make) -> None:
    """Whether maps and transforms come just after a sub-step or just before the next."""
    values = {"population.arrival_rate": 1.0, "population.mean_life": 2.0}
    early, late = (busy_run(make_scene(values), late_s) for late_s in (0.0, 0.049))
    assert len(early) > 100
    assert early == late
    assert any(event.kind is EventKind.DISPLACED for event in early)
    assert early != busy_run(make_scene(values), 0.06)


def test_nobody_stands_in_a_new_wall_after_the_next_sub_step(make_scene: Make) -> None:
    """Who arrives between a new map and the sub-step after it makes way like the others."""
    scene = make_scene({"population.arrival_rate": 5.0, "population.mean_life": 0.2})
    scene.robot(0.0, 1.0, 2.0)
    lives, seen = scene.builder.lives, 0
    for step in range(60):
        scene.map(0.1 * step + 0.051, (10, 30, 18, 38) if step % 2 else (2, 8, 18, 38))
        scene.builder.advance(scene.ns(0.1 * step + 0.1))
        standing = lives.scene_at(scene.ns(0.1 * step + 0.1))
        seen += len(standing)
        assert not scene.builder.world.environment.hits_wall(standing.boxes).any()
    assert seen > 50


@pytest.mark.parametrize("change", ["rate", "seed", "placed", "resumed"])
def test_what_a_change_brings_sooner_does_not_wait_for_the_next_sub_step(
    make_scene: Make, change: str
) -> None:
    """All that happens up to a tick is in it, where sub-steps are a second apart."""
    scene = make_scene({"motion.step": 1.0, "population.max_alive": 1000})
    builder, at_ns = scene.builder, scene.ns(1.1)
    scene.map(0.0)
    scene.robot(0.95, 1.0, 2.0)
    builder.advance(scene.ns(1.0))
    busy = with_values(builder.parameters, {"population.arrival_rate": 2.0})
    if change != "rate":
        builder.reconfigure(busy, scene.ns(1.0))
    builder.lives.pause(scene.ns(1.0), is_paused=change == "resumed")
    builder.advance(at_ns)
    if change == "rate":
        builder.reconfigure(busy, at_ns)
    elif change == "seed":
        builder.reseed(77, at_ns)
    elif change == "placed":
        builder.reconfigure(with_values(busy, {"population.arrival_rate": 0.0}), at_ns)
        scene.place(0, (2.5, 2.0), 1.1, life_s=0.3)
    else:
        builder.lives.pause(at_ns, is_paused=False)
    builder.lives.take_events()
    tick = scene.tick(1.95)
    builder.advance(scene.ns(4.0))
    assert tick.events
    assert min(event.stamp_ns for event in (*builder.lives.take_events(), *LATER)) > tick.stamp_ns


def test_nothing_goes_on_in_a_pause(make_scene: Make) -> None:
    """Nobody arrives, no life is used up, drawn or given, and nobody is moved."""
    scene = make_scene(BUSY)
    scene.map(0.0)
    scene.robot(0.0, 1.0, 2.0)
    given = scene.place(0, (3.0, 3.0), 0.1, life_s=2.0)
    scene.builder.advance(scene.ns(1.0))
    lives = scene.builder.lives
    before = {i: one.departure_ns for i, one in lives.population.living.items()}
    assert len(before) > 1
    lives.take_events()
    lives.pause(scene.ns(1.0), is_paused=True)
    scene.robot(5.0, 3.0, 3.0)
    scene.builder.advance(scene.ns(11.0))
    assert lives.take_events() == []
    scene.robot(11.0, 1.0, 2.0)
    lives.pause(scene.ns(11.0), is_paused=False)
    after = {i: one.departure_ns for i, one in lives.population.living.items()}
    assert after.keys() == before.keys()
    assert all(abs(after[i] - before[i] - scene.ns(10.0) + scene.ns(0.0)) <= 2 for i in before)
    scene.builder.advance(scene.ns(20.0))
    ends = {event.artefact_id: event.stamp_ns for event in lives.take_events()}
    assert ends[given] == scene.ns(12.1)


def test_a_life_that_begins_in_a_pause_is_as_long_as_another(make_scene: Make) -> None:
    """It is postponed by what was left of the pause at its arrival."""
    scene = make_scene()
    scene.map(0.0)
    scene.builder.advance(scene.ns(1.0))
    lives = scene.builder.lives
    lives.pause(scene.ns(1.0), is_paused=True)
    guest = scene.place(0, (3.0, 3.0), 51.0, life_s=10.0)
    lives.pause(scene.ns(101.0), is_paused=False)
    assert lives.population.living[guest].departure_ns == scene.ns(111.0)


@pytest.mark.parametrize("to_s", [20_000.0, 10.0])
def test_a_scenario_begins_with_a_population_that_is_paused(
    make_scene: Make, tmp_path: Path, to_s: float
) -> None:
    """As that of a node before it is activated, or across a jump of the clock."""
    path = tmp_path / "scenario.yaml"
    path.write_text("artefacts:\n  - {label: post, at: [3.0, 3.0, 0.0], arrives: 60.0}\n")
    scene = make_scene({"population.scenario": str(path)})
    lives = scene.builder.lives
    lives.is_paused = True
    scene.map(0.0)
    scene.builder.advance(scene.ns(5.0))
    lives.pause(scene.ns(10.0), is_paused=False)
    assert lives.population.scripted.next_ns() == scene.ns(70.0)
    scene.builder.advance(scene.ns(30.0))
    lives.pause(scene.ns(30.0), is_paused=True)
    scene.builder.step(scene.ns(to_s))
    lives.pause(scene.ns(to_s + 10.0), is_paused=False)
    assert lives.population.scripted.next_ns() == scene.ns(to_s + 70.0)


def test_a_gap_within_a_pause_postpones_a_scenario_once(make_scene: Make, tmp_path: Path) -> None:
    """The gap is a part of the pause."""
    path = tmp_path / "scenario.yaml"
    path.write_text("artefacts:\n  - {label: post, at: [3.0, 3.0, 0.0], arrives: 60.0}\n")
    scene = make_scene({"population.scenario": str(path)})
    lives = scene.builder.lives
    scene.map(0.0)
    scene.builder.advance(scene.ns(2.0))
    lives.pause(scene.ns(2.0), is_paused=True)
    scene.builder.interrupt(scene.ns(3.0), scene.ns(5.0))
    lives.pause(scene.ns(7.0), is_paused=False)
    assert lives.population.scripted.next_ns() == scene.ns(65.0)


@pytest.mark.parametrize("masks", [True, False])
def test_an_id_that_does_not_fit_into_a_mask_is_refused(
    make_scene: Make, tmp_path: Path, *, masks: bool
) -> None:
    """Before the run, where masks go out: their pixels are of 32 bits. Without, any id is fine."""
    path = tmp_path / "scenario.yaml"
    who = "{label: post, at: [3.0, 3.0, 0.0], arrives: 0.0, id: 3000000000}"
    path.write_text(f"artefacts:\n  - {who}\n")
    values = {"population.scenario": str(path), "sensors.masks": masks}
    if masks:
        with pytest.raises(ScenarioError, match="the id 3000000000 does not fit into a mask"):
            make_scene(values)
    else:
        scene = make_scene(values)
        scene.map(0.0)
        scene.builder.advance(scene.ns(1.0))
        assert list(scene.builder.lives.population.living) == [3_000_000_000]


def test_nobody_arrives_at_the_robots_goal(make_scene: Make) -> None:
    """Where its plan ends the robot's clearance is kept, until there is no plan."""
    scene = make_scene(BUSY | {"population.mean_life": 0.1, "robot.clearance": 0.8})
    scene.map(0.0)
    scene.robot(0.0, 0.6, 0.6)
    scene.builder.receive_plan(np.array([[1.0, 1.0, 0.0], [2.5, 2.5, 0.0]]), "map", scene.ns(0.0))
    distances = arrival_distances(scene, 60.0, (2.5, 2.5))
    assert len(distances) > 100
    assert distances.min() >= 0.8 + 0.2 + 0.05
    scene.builder.receive_plan(np.empty((0, 3)), "map", scene.ns(60.0))
    assert arrival_distances(scene, 120.0, (2.5, 2.5)).min() < 0.8


def test_a_plan_in_the_maps_frame_needs_no_transform(make_scene: Make) -> None:
    """It is where it says; a plan in a frame that nobody knows is refused, and changes nothing."""
    scene, plan_m = make_scene(), np.array([[1.0, 1.0, 0.0], [2.5, 2.0, 0.0]])
    scene.builder.receive_plan(plan_m, "map", scene.ns(0.0))
    with pytest.raises(FrameError, match="not seen so far"):
        scene.builder.receive_plan(plan_m + 1.0, "odom", scene.ns(0.1))
    np.testing.assert_array_equal(scene.builder.lives.plan_m, plan_m[:, :2])


@pytest.mark.parametrize("row", [0, 1])
def test_a_plan_that_is_not_finite_is_refused(make_scene: Make, row: int) -> None:
    """Wherever in it the number is; the plan before it holds on."""
    scene, plan_m = make_scene(), np.array([[1.0, 1.0, 0.0], [2.5, 2.0, 0.0]])
    scene.builder.receive_plan(plan_m, "map", scene.ns(0.0))
    goal, bad_m = scene.builder.lives.goal, plan_m.copy()
    bad_m[row, 1] = np.nan
    with pytest.raises(InputError, match="plan: it holds a position that is not finite"):
        scene.builder.receive_plan(bad_m, "map", scene.ns(0.1))
    np.testing.assert_array_equal(scene.builder.lives.plan_m, plan_m[:, :2])
    assert scene.builder.lives.goal is goal


def test_a_plan_without_heights_is_refused(make_scene: Make) -> None:
    """It was a sentence of numpy's."""
    with pytest.raises(InputError, match=r"plan: points have the shape \(2, 2\), not \(N, 3\)"):
        make_scene().builder.receive_plan(np.ones((2, 2)), "map", 0)


def arrival_distances(scene: Scene, until_s: float, point: tuple[float, float]) -> Any:
    """Return how far from a point the middles of those who arrive come to stand."""
    lives, distances = scene.builder.lives, []
    while (due_ns := lives.population.next_event_ns() or scene.ns(0.05)) < scene.ns(until_s):
        scene.builder.advance(due_ns)
        for artefact in lives.scene_at(due_ns).artefacts:
            if artefact.arrival_ns == due_ns:
                pose = artefact.ground_pose_at(due_ns)
                distances.append(np.hypot(pose.x_m - point[0], pose.y_m - point[1]))
    return np.array(distances)


def test_a_full_place_blocks_arrivals_and_says_so(make_scene: Make) -> None:
    """Where nothing fits, each arrival is an event, with the cause."""
    scene = make_scene(BUSY | {"population.max_alive": 0})
    scene.map(0.0)
    scene.robot(0.0, 1.0, 2.0)
    scene.builder.advance(scene.ns(3.0))
    events = scene.builder.lives.take_events()
    assert len(events) > 3
    assert set(kinds(events)) == {(EventKind.BLOCKED, "max_alive")}


def test_events_come_in_the_order_of_time(make_scene: Make) -> None:
    """Arrivals, departures and what collisions do, all in one order."""
    scene = make_scene(BUSY)
    scene.map(0.0)
    for step in range(50):
        scene.robot(0.1 * step, 1.0 + 0.04 * step, 2.0)
    stamps = [event.stamp_ns for event in scene.builder.lives.take_events()]
    assert len(stamps) > 10
    assert stamps == sorted(stamps)


# --- remedies


def test_a_wall_that_appears_moves_the_artefact_aside(scene: Scene) -> None:
    """To the nearest safe place, at the next sub-step; the event tells how far."""
    artefact_id = scene.place(0, (2.5, 2.0), 0.1)
    scene.map(0.32, (18, 22, 26, 30))
    scene.builder.advance(scene.ns(0.35))
    (artefact,) = scene.builder.lives.scene_at(scene.ns(0.35)).artefacts
    pose = artefact.ground_pose_at(scene.ns(0.35))
    boxes = boxes_of([artefact.row], [pose])
    assert not scene.builder.world.environment.hits_wall(boxes).any()
    assert artefact.ground_pose_at(scene.ns(0.34)) == GroundPose(2.5, 2.0, 0.0, 0.0)
    assert artefact.ground_pose_at(scene.ns(0.35)) == pose
    _, moved = scene.builder.lives.take_events()
    assert (moved.kind, moved.artefact_id) == (EventKind.DISPLACED, artefact_id)
    assert moved.value == pytest.approx(np.hypot(pose.x_m - 2.5, pose.y_m - 2.0))
    assert 0.1 <= moved.value <= 0.3
    assert scene.builder.lives.crowd.counts.displaced == 1


def test_an_artefact_without_a_place_leaves(make_scene: Make) -> None:
    """When the new map leaves no room within the search radius, it departs, displaced."""
    scene = make_scene({"collisions.search_radius": 0.3})
    scene.map(0.0)
    scene.place(0, (2.5, 2.0), 0.1)
    scene.map(0.2, (5, 35, 10, 39))
    scene.builder.advance(scene.ns(0.25))
    assert scene.builder.lives.scene_at(scene.ns(0.25)).artefacts == ()
    assert kinds(scene.builder.lives.take_events()) == [
        (EventKind.ARRIVED, ""),
        (EventKind.DEPARTED, "displaced"),
    ]
    assert scene.builder.lives.crowd.counts.displaced == 1


@pytest.mark.parametrize("policy", ["displace", "hold", "remove", "auto"])
def test_a_robot_that_drives_into_an_artefact(make_scene: Make, policy: str) -> None:
    """The contact is said once, with its depth; then the policy decides. Auto holds."""
    scene = make_scene({"collisions.on_robot_contact": policy})
    scene.map(0.0)
    scene.robot(0.0, 1.0, 2.0)
    artefact_id = scene.place(0, (2.0, 2.0), 0.0)
    for step in range(1, 6):
        scene.robot(0.1 * step, 1.65, 2.0)
    scene.builder.advance(scene.ns(0.55))
    lives = scene.builder.lives
    events = lives.take_events()
    contacts = [event for event in events if event.kind is EventKind.ROBOT_CONTACT]
    assert [(c.artefact_id, c.detail) for c in contacts] == [(artefact_id, "robot")]
    assert contacts[0].value == pytest.approx(0.05)
    assert contacts[0].stamp_ns == scene.ns(0.15)
    assert lives.crowd.contacts.count == 1
    after = kinds(events)[-1]
    if policy == "remove":
        assert after == (EventKind.DEPARTED, "robot_contact")
        assert lives.scene_at(scene.ns(0.55)).artefacts == ()
        return
    pose = lives.scene_at(scene.ns(0.55)).artefacts[0].ground_pose_at(scene.ns(0.55))
    was_moved = pose != GroundPose(2.0, 2.0, 0.0, 0.0)
    assert was_moved == (policy == "displace")
    assert after[0] is (EventKind.DISPLACED if was_moved else EventKind.ROBOT_CONTACT)


def test_a_second_contact_is_another_contact(scene: Scene) -> None:
    """Back off and drive in again: two events."""
    scene.place(0, (2.0, 2.0), 0.0)
    for step, x in enumerate((1.65, 1.65, 1.0, 1.0, 1.65, 1.65)):
        scene.robot(0.1 * (step + 1), x, 2.0)
    scene.builder.advance(scene.ns(0.7))
    assert scene.builder.lives.crowd.contacts.count == 2


# --- independence of how often it is asked


def test_who_was_there_is_known_for_the_history(scene: Scene) -> None:
    """A late scan still finds who has departed since."""
    artefact_id = scene.place(0, (2.5, 2.0), 0.1, life_s=0.4)
    scene.builder.advance(scene.ns(1.0))
    lives = scene.builder.lives
    assert [a.id for a in lives.scene_at(scene.ns(0.49)).artefacts] == [artefact_id]
    assert lives.scene_at(scene.ns(0.5)).artefacts == ()
    assert lives.scene_at(scene.ns(0.09)).artefacts == ()


@pytest.mark.parametrize("leave", ["vanish", "walk_to_exit"])
def test_what_cannot_move_lives_and_goes_the_same_however_lives_end(
    make_scene: Make, leave: str
) -> None:
    """Rows without a speed have no way out to walk: every event is that of vanishing."""
    plain, other = make_scene(BUSY), make_scene(BUSY | {"population.leave": leave})
    for scene in (plain, other):
        scene.map(0.0)
        scene.robot(0.0, 1.0, 2.0)
        scene.builder.advance(scene.ns(6.0))
    events = plain.builder.lives.take_events()
    assert len(events) > 10
    assert events == other.builder.lives.take_events()


def test_sub_steps_are_counted_for_all_who_live(scene: Scene) -> None:
    """Twenty a second for each, none of them moving, none resolved."""
    scene.place(0, (2.5, 2.0), 0.02)
    scene.place(0, (3.2, 2.0), 0.52)
    scene.builder.advance(scene.ns(1.01))
    counts = scene.builder.lives.crowd.counts
    assert counts.artefact_steps == 20 + 10
    assert (counts.moving_steps, counts.moved_back, counts.displaced) == (0, 0, 0)


def test_long_silence_is_crossed_in_no_time(make_scene: Make) -> None:
    """An hour without any input needs no sub-steps, and loses no event of the population."""
    quiet = {"population.arrival_rate": 0.001, "population.mean_life": 30.0}
    one, other = make_scene(quiet), make_scene(quiet)
    for each in (one, other):
        each.map(0.0)
        each.robot(0.0, 1.0, 2.0)
    one.builder.advance(one.ns(3600.0))
    for second in range(1, 3601):
        other.builder.advance(other.ns(float(second)))
    events = one.builder.lives.take_events()
    assert len(events) > 50
    assert events == other.builder.lives.take_events()


def test_a_bad_mixture_is_refused_by_name() -> None:
    """Weights that do not fit the rates are a parameter error."""
    from are_ros.builder.files.catalogue_file import read_catalogue

    parameters = with_values(Parameters(), {"mixture.weights": (0.5, 0.5), "mixture.rates": (1.0,)})
    with pytest.raises(ParameterError, match="mixture"):
        population_of(
            parameters, read_catalogue(), begun=lambda *_: None, stays_on=lambda *_: False
        )
