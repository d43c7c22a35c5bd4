"""Artefacts that live: decisions, ways, traffic and collisions together, as the outputs show it."""

import math
from typing import Any

import numpy as np
import pytest

from are_ros.agents.events import EventKind
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.builder.spawning.requests import Requests, SpawnRequest
from are_ros.errors import CatalogueError
from are_ros.population.artefact import boxes_of
from are_ros.population.catalogue import Catalogue
from are_ros.world.boxes import any_overlap
from are_ros.world.rigid_transform import RigidTransform
from tests.agents.behaviours.diary import ENTRIES, MARCHER, STROLLER
from tests.builder.town import (
    CART,
    FOLLOWER,
    GATHERER,
    POST,
    STEP_NS,
    TYPES,
    WALKER,
    Record,
    Town,
    events_of,
    hall,
    row,
)
from tests.world.overlapping import overlapping_pairs

BUSY: dict[str, Any] = {"population.arrival_rate": 0.03, "population.mean_life": 6.0, "seed": 3}
WALLS = ((4.0, 4.2, 0.0, 3.4), (4.0, 4.2, 4.4, 8.0))
"""A wall across the hall, with a door of a metre."""


def assert_apart(town: Town, record: Record, first_ns: int = 0) -> None:
    """Nobody overlaps anybody or a wall at any sub-step from one on."""
    rows = town.builder.catalogue.rows
    environment = town.builder.world.environment
    assert environment is not None
    by_id = {a.id: a.row for a in town.lives.population.living.values()}
    for t_ns, moment in record.moments.items():
        known = {i: pose for i, (pose, _) in moment.items() if i in by_id}
        if t_ns < first_ns or not known:
            continue
        boxes = boxes_of([rows[by_id[i].index] for i in known], list(known.values()))
        assert len(overlapping_pairs(boxes)) == 0, t_ns
        assert not environment.hits_wall(boxes).any(), t_ns


# --- nothing depends on when ticks run


@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 33.0])
def test_lives_and_poses_do_not_depend_on_the_tick_rate(rate_hz: float) -> None:
    """At every sub-step of eight seconds each is where it is with ticks of 20 Hz, to the bit."""
    fine, coarse = (
        Town.of(BUSY, hall(10.0, 8.0, *WALLS)).run(0.0, 8.0, rate) for rate in (20.0, rate_hz)
    )
    common = fine.moments.keys() & coarse.moments.keys()
    assert len(common) >= 150
    assert sum(map(len, fine.moments.values())) > 500
    for t_ns in common:
        assert fine.moments[t_ns] == coarse.moments[t_ns], t_ns
    last_ns = max(common)
    assert [e for e in fine.events if e.stamp_ns <= last_ns] == [
        e for e in coarse.events if e.stamp_ns <= last_ns
    ]


def test_the_same_seed_gives_the_same_ground_truth_among_many() -> None:
    """With more than 150 alive, all states of all ticks of three seconds are equal."""
    values = {"population.arrival_rate": 0.4, "population.mean_life": 100.0}
    runs = []
    for _ in range(2):
        town = Town.of(values, hall(24.0, 20.0, (11.0, 11.2, 0.0, 16.0)))
        states: list[Any] = []
        for tick in range(5):
            told = town.builder.step(town.ns(0.6 * tick + 0.1)).artefacts
            states += [(s.artefact_id, s.ground_pose, s.behaviour, s.activity) for s in told]
        runs.append(states)
        assert len(town.lives.population.living) > 150
    assert runs[0] == runs[1]
    assert any(activity for *_, activity in runs[0]) or len(runs[0]) > 300


def test_removing_one_changes_no_others_random_numbers() -> None:
    """What each draws is the same, to the bit, whether a sixth is there or not, in their way."""
    types = Catalogue((row(0, STROLLER),))
    draws = []
    for extra in (False, True):
        ENTRIES.clear()
        town = Town.of(types=types)
        for k in range(5):
            town.place(0, 1.5 + 1.5 * k, 2.0, 0.1 * k)
        if extra:
            town.place(0, 5.0, 4.0, 0.5)
        town.run(0.5, 9.0)
        draws.append({k: [d for _, i, d in ENTRIES if i == k] for _, k, _ in ENTRIES})
    fewer, more = draws
    assert more.keys() - fewer.keys()
    for artefact_id, numbers in fewer.items():
        assert len(numbers) >= 8
        assert more[artefact_id] == numbers
    assert len({numbers[0] for numbers in more.values()}) == 6


# --- decisions


@pytest.mark.parametrize("rate_hz", [5.0, 20.0, 33.0])
def test_decisions_come_a_period_apart_from_the_arrival(rate_hz: float) -> None:
    """The first in the first sub-step not before the arrival, whatever the tick rate."""
    ENTRIES.clear()
    town = Town.of({"behaviour.decision_period": 0.7}, types=Catalogue((row(0, STROLLER),)))
    arrivals = (0.13, 0.34, 0.3501, 0.99)
    ids = [town.place(0, 2.0 + 1.5 * k, 4.0, t_s) for k, t_s in enumerate(arrivals)]
    town.run(1.0, 4.5, rate_hz)
    for artefact_id, arrival_s in zip(ids, arrivals, strict=True):
        first_ns = -(-town.ns(arrival_s) // STEP_NS) * STEP_NS
        told = [t_ns for t_ns, i, _ in ENTRIES if i == artefact_id]
        assert told == [first_ns + k * 14 * STEP_NS for k in range(len(told))]
        assert len(told) >= 5


# --- motion in the histories


def test_histories_join_the_sub_steps_by_straight_lines() -> None:
    """Also where one sets off after a long stand: nobody drifts while it stands."""
    town = Town.of()
    ids = [town.place(WALKER, 2.0 + k, 3.0) for k in range(4)]
    record = Record({}, [])
    for k in range(1, 161):
        now_ns = START + k * STEP_NS
        town.builder.advance(now_ns)
        record.look(town.lives, now_ns - STEP_NS, now_ns)
        if k > 1:
            before, now = record.moments[now_ns - STEP_NS], record.moments[now_ns]
            for i in ids:
                half = town.one(i).ground_pose_at(now_ns - STEP_NS // 2)
                middle = [
                    0.5 * (a + b) for a, b in zip(before[i][0][:2], now[i][0][:2], strict=True)
                ]
                assert half[:2] == pytest.approx(middle, abs=1e-9)
                assert town.one(i).ground_pose_at(now_ns - STEP_NS) == before[i][0]
    moved = [np.hypot(*np.diff(record.way_of(i)[:, :2], axis=0).T) for i in ids]
    assert all(steps.max() > 0.02 for steps in moved)
    assert any((steps == 0.0).sum() > 3 for steps in moved)


START = Town.ns(0.0)


def test_nobody_overlaps_in_a_crowd_at_a_door() -> None:
    """Walkers, followers, gatherers and carts, for ten seconds, arrivals included."""
    values = BUSY | {"population.arrival_rate": 0.05, "population.mean_life": 30.0}
    values |= {"mixture.weights": (0.7, 0.3), "mixture.rates": (0.5, 3.0)}
    town = Town.of(values, hall(10.0, 8.0, *WALLS))
    record = town.run(0.0, 10.0)
    assert len(town.lives.population.living) > 15
    assert_apart(town, record)
    assert town.lives.crowd.counts.displaced == 0
    assert town.lives.crowd.counts.moving_steps > 1000


def test_one_that_stands_is_not_moved_by_those_who_walk() -> None:
    """A post keeps one pose for ever, to the bit."""
    town = Town.of()
    post = town.place(POST, 5.0, 4.0, yaw_rad=0.3)
    for k in range(4):
        town.place(WALKER, 1.5 + k, 6.0)
    way = town.run(0.0, 6.0).way_of(post)
    assert (way == way[0]).all()


def test_a_group_walks_without_touching() -> None:
    """Those who arrive at one instant keep clear of each other, then and later."""
    values = {"population.arrival_rate": 0.02, "population.group_size": 6.0, "seed": 2}
    town = Town.of(values | {"population.group_radius": 1.5, "population.mean_life": 100.0})
    record = town.run(0.0, 8.0)
    arrivals = [e.stamp_ns for e in record.events if e.kind is EventKind.ARRIVED]
    assert max(arrivals.count(t_ns) for t_ns in arrivals) >= 3
    assert_apart(town, record)


def test_members_of_a_group_meet() -> None:
    """Three who gather stand together after a while, each facing where they meet."""
    town = Town.of()
    ids = [town.place(GATHERER, 3.0 + k, 4.0) for k in range(3)]
    doings: set[str] = set()
    for tick in range(80):
        states = town.builder.step(town.ns(0.5 * tick)).artefacts
        talking = [s for s in states if s.activity == "talking"]
        doings |= {s.activity for s in states}
        if len(talking) == 3:
            break
    assert {s.artefact_id for s in talking} == set(ids), doings
    spots = np.array([s.ground_pose[:2] for s in talking])
    assert np.ptp(spots, axis=0).max() < 3.0


def test_a_follower_stays_near_whom_it_follows() -> None:
    """Once it has caught up it is within 4 m of the walker nine times of ten, mostly nearer."""
    town = Town.of(grid=hall(16.0, 8.0))
    leader, follower = town.place(WALKER, 5.0, 4.0), town.place(FOLLOWER, 4.0, 4.0)
    record = town.run(0.0, 25.0)
    gaps = record.way_of(leader)[:, :2] - record.way_of(follower)[:, :2]
    apart = np.hypot(*gaps[200:].T)
    assert np.median(apart) < 3.0
    assert np.percentile(apart, 90) < 4.0


# --- the robot, the map, pauses


@pytest.mark.parametrize("policy", ["hold", "displace"])
def test_a_robot_that_drives_into_a_walker(policy: str) -> None:
    """The contact is said; who is displaced jumps, within a nanosecond, and walks on from there."""
    town = Town.of({"collisions.on_robot_contact": policy}, robot=(1.0, 4.0))
    walker = town.place(WALKER, 3.0, 4.0, behaviour="standing")
    record = Record({}, [])
    for k in range(1, 100):
        t_s = 0.05 * k
        town.robot(t_s, min(1.0 + 3.0 * t_s, 4.5), 4.0)  # too fast to step aside
        town.builder.advance(town.ns(t_s))
        record.look(town.lives, town.ns(t_s) - STEP_NS, town.ns(t_s))
        record.events += town.lives.take_events()
    told = events_of(record.events, walker)
    assert EventKind.ROBOT_CONTACT in {e.kind for e in told}
    jumps = [e for e in told if e.kind is EventKind.DISPLACED]
    assert bool(jumps) == (policy == "displace")
    for jump in jumps:
        before = record.moments[jump.stamp_ns - STEP_NS][walker][0]
        after = record.moments[jump.stamp_ns][walker][0]
        stepped_m = 1.8 * 0.05  # aside, in the same sub-step
        assert jump.value == pytest.approx(math.dist(before[:2], after[:2]), abs=stepped_m)


def test_a_displaced_walker_jumps_and_walks_on() -> None:
    """A map with a block where it walks: until then it goes on as if there were none."""
    town = Town.of()
    walkers = [town.place(WALKER, 3.0 + 0.7 * k, 4.0) for k in range(6)]
    town.run(0.0, 2.0)
    town.lives.take_events()
    block = (2.0, 8.0, 3.0, 5.5)
    town.map(2.02, hall(10.0, 8.0, block))
    town.builder.advance(town.ns(2.05))
    jumps = [e for e in town.lives.take_events() if e.kind is EventKind.DISPLACED]
    assert len(jumps) >= 3
    for jump in jumps:
        one = town.one(jump.artefact_id)
        at_ns = jump.stamp_ns
        before, after = one.ground_pose_at(at_ns - 1), one.ground_pose_at(at_ns)
        assert math.dist(before[:2], after[:2]) == pytest.approx(jump.value)
        assert one.ground_pose_at(at_ns - STEP_NS // 2)[:2] == pytest.approx(before[:2], abs=0.05)
        assert np.hypot(*one.history.velocity_at(at_ns)[:2]) < 1.8 * 1.3 * 0.05
    town.robot(2.06, 0.5, 0.5)
    record = town.run(2.05, 8.0)
    assert_apart(town, record)
    ways = [record.way_of(i) for i in walkers if i in town.lives.population.living]
    assert sum(np.hypot(*np.diff(w[:, :2], axis=0).T).sum() > 1.0 for w in ways) >= 3
    assert all(np.hypot(*np.diff(w[:, :2], axis=0).T).max() < 1.8 * 1.3 * 0.05 + 1e-9 for w in ways)


def test_a_pause_freezes_everybody_where_they_are() -> None:
    """For four seconds nobody moves; then each goes on from there, without a jump."""
    town = Town.of()
    ids = [town.place(WALKER, 2.0 + k, 3.0) for k in range(4)]
    town.run(0.0, 3.0)
    frozen = {i: town.one(i).history.latest for i in ids}
    town.lives.pause(town.ns(3.0), is_paused=True)
    record = town.run(3.0, 7.0)
    for moment in record.moments.values():
        assert {i: pose for i, (pose, _) in moment.items()} == frozen
    town.lives.pause(town.ns(7.0), is_paused=False)
    ways = town.run(7.0, 9.0)
    steps = [np.hypot(*np.diff(ways.way_of(i)[:, :2], axis=0).T) for i in ids]
    assert max(s.sum() for s in steps) > 1.0
    assert max(s.max() for s in steps) < 1.3 * 0.05 + 1e-9
    for i in ids:
        assert math.dist(ways.way_of(i)[0, :2], frozen[i][:2]) < 1.3 * 0.05 + 1e-9


@pytest.mark.parametrize("rate_hz", [1.0, 20.0])
def test_the_world_stands_still_when_nothing_comes_in(rate_hz: float) -> None:
    """A minute after the last input nobody moves, however often ticks run."""
    town = Town.of()
    ids = [town.place(WALKER, 2.0 + k, 3.0, 0.0) for k in range(3)]
    town.robot(0.0, 0.5, 0.5)
    town.run(0.0, 61.0, 1.0)
    there = {i: town.one(i).history.latest for i in ids}
    town.run(61.0, 70.0, rate_hz)
    assert {i: town.one(i).history.latest for i in ids} == there


def test_one_can_walk_before_the_robot_is_known() -> None:
    """Who is placed on a map without a robot, and knows where to go, goes there."""
    town = Town.of(types=Catalogue((row(0, MARCHER),)), robot=None)
    marcher = town.place(0, 2.0, 4.0)
    town.run(0.0, 8.0)
    assert math.dist(town.one(marcher).history.latest[:2], (8.0, 4.0)) < 0.5


# --- what is asked for


def ask(town: Town, label: str, behaviour: str) -> int:
    """Ask for an artefact in the middle."""
    request = SpawnRequest("map", RigidTransform.planar(5.0, 4.0, 0.0), label, behaviour=behaviour)
    return Requests(town.builder).spawn(request, town.ns(0.1))


def test_a_requested_behaviour_is_done() -> None:
    """It need not be one of the row's own."""
    town = Town.of()
    wanderer = ask(town, "walking 0", "wandering")
    assert town.one(wanderer).behaviour == "wandering"
    way = town.run(0.1, 6.0).way_of(wanderer)
    assert np.hypot(*np.diff(way[:, :2], axis=0).T).sum() > 1.0


def life_after(seed: int, reseeded: int | None) -> tuple[str, list[list[float]]]:
    """Return the label drawn, and the way walked, after a beginning of which nobody is left."""
    town = Town.of({"seed": seed})
    requests, begin_ns = Requests(town.builder), town.ns(1.0)
    first = requests.spawn(SpawnRequest("map", RigidTransform.planar(2.0, 2.0, seed)), town.ns(0.1))
    town.run(0.1, 1.0)
    requests.remove(first, begin_ns)
    if reseeded is not None:
        requests.reseed(reseeded, begin_ns)
    middle = RigidTransform.planar(5.0, 4.0, 0.0)
    drawn = requests.spawn(SpawnRequest("map", middle, behaviour="walking"), begin_ns)
    return town.one(drawn).row.label, town.run(1.0, 12.0).way_of(drawn).tolist()


def test_who_comes_after_reseeding_chooses_by_the_new_seed_alone() -> None:
    """What was before does not count: neither the first seed nor who was there, now gone."""
    after = [life_after(seed, 7) for seed in (1, 2, 3)]
    assert len(after[0][1]) > 20
    assert after[0] == after[1] == after[2]
    ways = [after[0][1], *(life_after(seed, None)[1] for seed in (1, 2, 3))]
    assert all(ways[i] != ways[j] for i in range(4) for j in range(i))


@pytest.mark.parametrize(
    ("label", "behaviour", "sentence"),
    [
        ("walking 0", "dancing", "behaviour 'dancing' is not known; known are"),
        ("walking 0", "os:system", "behaviour 'os:system' is not known"),
        ("standing 3", "walking", "motion.speed_mps is 0"),
        ("walking 0", "along_way", "needs a way"),
    ],
)
def test_a_behaviour_that_cannot_be_is_refused(label: str, behaviour: str, sentence: str) -> None:
    """With the reason, and nobody is placed."""
    town = Town.of()
    with pytest.raises(CatalogueError, match=sentence):
        ask(town, label, behaviour)
    assert not town.lives.population.living


def test_a_cart_does_not_slide() -> None:
    """What turns on a circle of 1.3 m moves along its heading, and turns no narrower."""
    town = Town.of(grid=hall(14.0, 12.0))
    cart = town.place(CART, 7.0, 6.0)
    way = town.run(0.0, 15.0).way_of(cart)
    step, turn = np.diff(way[:, :2], axis=0), np.diff(np.unwrap(way[:, 2]))
    middle = way[:-1, 2] + 0.5 * turn
    along = step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle)
    across = step[:, 1] * np.cos(middle) - step[:, 0] * np.sin(middle)
    assert np.abs(along).sum() > 3.0
    assert np.abs(across).max() < 1e-4
    assert (np.abs(turn) * 1.3 <= np.abs(along) * 1.01 + 1e-4).all()


# --- where they are at an instant is known then


def a_busy_town(values: dict[str, Any] | None = None) -> Town:
    """Return a town in which they come and go, where a map and the robot move some by force."""
    busy = {
        "population.arrival_rate": 0.05,
        "population.mean_life": 6.0,
        "mixture.weights": (0.8, 0.2),
        "mixture.rates": (0.7, 3.0),
        "collisions.on_robot_contact": "displace",
        "poses.history": 5.0,
        **(values or {}),
    }
    return Town.of(busy)


def drive_about(town: Town, t_s: float) -> None:
    """Let the robot be where it is at a time, which is in people's way, and the map change."""
    town.robot(t_s, 5.0 + 3.0 * math.sin(0.9 * t_s), 4.0 + 2.0 * math.cos(0.7 * t_s))
    if abs(t_s % 5.0 - 2.5) < 0.01:
        at_m = 2.0 + 0.8 * t_s
        town.map(t_s, hall(10.0, 8.0, (at_m, at_m + 0.5, 2.0, 6.0)))


def test_what_was_at_an_instant_is_the_same_now_and_later() -> None:
    """Who was there and where, between sub-steps, asked at once and a while later: to the bit.

    Whoever came, went, or was moved by force meanwhile.
    """
    town, early = a_busy_town(), {}
    forced, arrived = 0, 0
    for k in range(1, 2500):
        t_ns = town.ns(0.0) + k * 13_700_001
        if k % 7 == 0:
            drive_about(town, (t_ns - town.ns(0.0)) / 1e9)
        town.builder.advance(t_ns)
        scene = town.lives.scene_at(t_ns)
        early[t_ns] = list(zip(scene.ids.tolist(), scene.ground_poses, strict=True))
        late_ns = t_ns - 29 * 13_700_001
        if late_ns in early:
            scene = town.lives.scene_at(late_ns)
            assert list(zip(scene.ids.tolist(), scene.ground_poses, strict=True)) == early.pop(
                late_ns
            )
        events = town.lives.take_events()
        forced += sum(event.kind is EventKind.DISPLACED for event in events)
        arrived += sum(event.kind is EventKind.ARRIVED for event in events)
    assert forced > 5
    assert arrived > 20


def test_nobody_turns_or_goes_faster_than_it_can_at_any_instant() -> None:
    """From the very arrival on, in the twist and in the poses a millisecond apart."""
    town, limits = a_busy_town(), {row.label: row.motion for row in TYPES.rows}
    fastest, looked_at = 0.0, 0
    for k in range(1, 2500):
        t_ns = town.ns(0.0) + k * 7_300_001
        town.builder.advance(t_ns)
        for one in town.lives.scene_at(t_ns).artefacts:
            vx_mps, vy_mps, turn_radps = one.history.velocity_at(t_ns)
            motion = limits[one.row.label]
            assert math.hypot(vx_mps, vy_mps) <= motion.top_speed_mps * 1.001 + 1e-6
            assert abs(turn_radps) <= motion.turn_rate_radps * 1.001 + 1e-6
            if t_ns - one.arrival_ns < STEP_NS:
                here, there = (one.ground_pose_at(t_ns + n * 1_000_000) for n in (0, 1))
                turn_rad = abs(math.remainder(there.yaw_rad - here.yaw_rad, math.tau))
                assert turn_rad <= 0.001 * motion.turn_rate_radps * 1.001 + 1e-6
                looked_at += 1
            fastest = max(fastest, abs(turn_radps))
    assert looked_at > 100
    assert fastest > 2.0


def test_who_arrives_stands_until_the_next_sub_step() -> None:
    """And is not where others are bound for."""
    town = a_busy_town()
    for k in range(1, 1200):
        t_ns = town.ns(0.0) + k * 13_700_001
        town.builder.advance(t_ns)
        for event in town.lives.take_events():
            is_there = event.artefact_id in town.lives.population.living
            step_ns = -(-event.stamp_ns // STEP_NS) * STEP_NS
            if event.kind is EventKind.ARRIVED and is_there and t_ns < step_ns:
                one = town.one(event.artefact_id)
                assert one.ground_pose_at(step_ns) == one.ground_pose_at(event.stamp_ns)
                crowd = town.lives.crowd.table
                there = crowd.end_boxes.packed[crowd.row_of(one.id)]
                assert np.array_equal(there, crowd.boxes.packed[crowd.row_of(one.id)])
                assert not any_overlap(crowd.end_boxes)


def scanned(late_s: float) -> list[tuple[int, bytes]]:
    """Return stamps and ranges of the scans of a drive that come late by so much, or at once."""
    town = a_busy_town({"sensors.shape": "box"})
    builder, rng = town.builder, np.random.default_rng(4)
    builder.receive_transform(
        "base_link", "laser", 0, (0.0, 0.0, 0.4), (0.0, 0.0, 0.0, 1.0), town.ns(0.0), is_static=True
    )
    none, found = np.empty(0, np.float32), []
    inputs = [(0.021 * k, "robot", k) for k in range(1, 500)]
    inputs += [(0.0610001 * k + late_s, "scan", k) for k in range(1, 160)]
    ranges = [rng.choice([np.inf, 3.0, 6.0], 180).astype(np.float32) for _ in range(160)]
    for t_s, what, k in sorted(inputs):
        if what == "robot":
            town.robot(t_s, 5.0 + math.sin(0.5 * t_s), 4.0 + math.cos(0.5 * t_s), 0.3 * t_s)
        else:
            stamp_ns = town.ns(0.0610001 * k)
            angles, spans = (-3.14, 3.14, 6.28 / 179), (0.0, 0.1, 0.1, 8.0)
            scan = LaserScan("laser", stamp_ns, *angles, *spans, ranges[k], none)
            builder.receive_reading("scan", scan, town.ns(t_s))
        found += [
            (one.reading.stamp_ns, one.reading.ranges.tobytes()) for one in builder.take_readings()
        ]
    return found


def test_a_scan_is_the_same_whether_it_comes_at_once_or_late() -> None:
    """Byte for byte: what stands at the stamp is what it shows, however late it is released."""
    at_once, late = dict(scanned(0.0)), dict(scanned(0.4))
    shared = at_once.keys() & late.keys()
    assert len(shared) > 140
    assert [stamp_ns for stamp_ns in sorted(shared) if at_once[stamp_ns] != late[stamp_ns]] == []
