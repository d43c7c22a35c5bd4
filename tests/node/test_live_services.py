"""What people ask of the running node: its services, and clicks in rviz."""

from collections.abc import Callable
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest

from tests.ros import NOT_SET_UP

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from are_msgs.msg import Artefact, ArtefactEvent
from rclpy.qos import QoSProfile

from are_ros.node.message_classes import service_class
from are_ros.node.services import Services
from tests.node.live_bench import Bench
from tests.node.live_scene import FACTORY, click_at, ns, pose_at, robot_at, room

MakeBench = Callable[..., Bench]
NOT_ACTIVE = "the node is not active: configure and activate it first"


@pytest.fixture
def bench(make_bench: MakeBench) -> Bench:
    """Return an active node at 1000.1 s: the room, the robot at (1, 2) turned to the left."""
    made = make_bench({"costmap.gate": "all", "population.mean_life": 5.0})
    assert made.change_state("configure", "activate")
    made.clock(1000.0)
    made.send("map", room())
    step(made, 1000.1)
    return made


def step(bench: Bench, t_s: float) -> None:
    """Let the robot say where it is, and the time go on to a tick."""
    bench.send("tf", robot_at(t_s - 0.05, yaw=1.5707963267948966))
    bench.tick(t_s)


def life_of(seconds: float) -> Any:
    """Return a Duration."""
    whole, rest = divmod(ns(seconds), 10**9)
    return FACTORY.make("builtin_interfaces/msg/Duration", sec=whole, nanosec=rest)


def test_a_request_has_one_time_and_a_tick_due_by_then_comes_first() -> None:
    """Between two looks at the clock a tick may be due: it had the departures, and the departed."""
    answers, times, clock = dict[str, Any](), list[tuple[str, int]](), iter(range(5, 100))

    def create_service(_: Any, name: str, answer: Any, *, qos_profile: QoSProfile) -> None:
        answers[name] = answer
        assert qos_profile.depth >= 1000

    def note(what: str) -> Callable[..., int]:
        def noted(*given: int) -> int:
            times.append((what, given[-1]))
            return 1

        return noted

    asked = {name: note(name) for name in ("remove", "reseed", "clear")}
    live: Any = SimpleNamespace(work=note("work"), requests=SimpleNamespace(**asked))
    node: Any = SimpleNamespace(create_service=create_service)
    Services(node, lambda: live, lambda: next(clock), str, lambda _: nullcontext())
    request = SimpleNamespace(id=7, seed=4)
    for name in asked:
        answers[f"~/{name}"](request, SimpleNamespace())
    expected = zip(asked, range(5, 8), strict=True)
    assert times == [one for name, at in expected for one in (("work", at), (name, at))]


# ------------------------------------------------------------------------------------- spawn


@pytest.mark.parametrize(
    ("asked", "labels"),
    [
        ({"label": "crate"}, {"crate"}),
        ({"label": "thing"}, {"post", "crate"}),
        ({"row": 2}, {"pillar"}),
        ({"label": "thing", "row": 1}, {"crate"}),
        ({}, {"post", "crate", "pillar"}),
    ],
)
def test_an_artefact_is_placed_where_it_was_asked_for(
    bench: Bench, asked: dict[str, Any], labels: set[str]
) -> None:
    """By the label of a row, by a class, by a row; at the very pose; from the next tick on."""
    lists, events = bench.listen("artefacts"), bench.listen("events")
    answer = bench.spawn(pose_at(2.5, 2.2, yaw=0.3), **asked)
    assert answer.success
    assert answer.message == f"artefact {answer.id} stands"
    step(bench, 1000.2)
    (artefact,) = lists[-1].artefacts
    assert artefact.id == answer.id
    assert artefact.label in labels
    assert artefact.origin == Artefact.SERVICE
    at = artefact.ground_pose.position
    assert (at.x, at.y, at.z) == pytest.approx((2.5, 2.2, 0.0))
    assert artefact.ground_pose.orientation.z == pytest.approx(0.149438, abs=1e-6)
    (event,) = (event for event in events if event.kind == ArtefactEvent.ARRIVED)
    assert (event.id, event.label) == (artefact.id, artefact.label)


def test_an_artefact_can_be_placed_in_another_frame(bench: Bench) -> None:
    """A metre and a half to the robot's front, which is to the left in the map."""
    lists = bench.listen("artefacts")
    assert bench.spawn(pose_at(1.5, 0.0, frame_id="base_link"), label="post").success
    step(bench, 1000.2)
    (artefact,) = lists[-1].artefacts
    at, turn = artefact.ground_pose.position, artefact.ground_pose.orientation
    assert (at.x, at.y) == pytest.approx((1.0, 3.5))
    assert turn.z == pytest.approx(2**-0.5)


def test_a_given_life_ends_when_it_is_over(bench: Bench) -> None:
    """At its very end; nothing of the artefact stays."""
    lists, maps, events = (bench.listen(n) for n in ("artefacts", "augmented_map", "events"))
    assert bench.spawn(pose_at(2.5, 2.2), label="post", life=life_of(0.45)).success
    step(bench, 1000.5)
    assert len(lists[-1].artefacts) == 1
    step(bench, 1000.6)
    assert lists[-1].artefacts == []
    assert maps[-1].data.tolist().count(100) == 4 * 39
    (event,) = (event for event in events if event.kind == ArtefactEvent.DEPARTED)
    assert (event.header.stamp.sec, event.header.stamp.nanosec) == (1000, 550_000_000)


@pytest.mark.parametrize(
    ("pose", "asked", "reason"),
    [
        (pose_at(0.05, 2.0), {}, "post at 0.05, 2.00: it would stand in a wall"),
        (pose_at(40.0, 2.0), {}, "it would stand in a wall, or not on free cells only"),
        (pose_at(1.3, 2.0), {}, "it would be nearer to the robot than robot.clearance, 0.1 m"),
        (pose_at(3.0, 3.2), {}, "it would overlap another artefact"),
        (pose_at(2.0, 2.0), {"label": "ghost"}, "'ghost'"),
        (pose_at(2.0, 2.0), {"row": 7}, "the catalogue has no row 7 of 'post'"),
        (pose_at(2.0, 2.0), {"row": -2}, "the catalogue has no row -2 of 'post'"),
        (pose_at(2.0, 2.0), {"label": "", "row": 3}, "no row 3: the rows are 0..2"),
        (pose_at(2.0, 2.0, frame_id="arm"), {}, "'arm'"),
        (pose_at(2.0, 2.0, frame_id=""), {}, "spawn: pose: header.frame_id is empty"),
        (pose_at(float("nan"), 2.0), {}, "not finite"),
        (pose_at(2.0, 2.0), {"behaviour": "walking"}, "'walking' needs an artefact that moves"),
        (pose_at(2.0, 2.0), {"life": life_of(-1.0)}, "spawn: life: -1.0 s is negative"),
    ],
)
def test_what_cannot_stand_is_refused_with_the_reason(
    bench: Bench, pose: Any, asked: dict[str, Any], reason: str
) -> None:
    """And nothing is changed; the next request works."""
    lists = bench.listen("artefacts")
    assert bench.spawn(pose_at(3.05, 3.05), label="post").success
    answer = bench.spawn(pose, **{"label": "post", **asked})
    assert not answer.success
    assert reason in answer.message
    assert answer.id == 0
    step(bench, 1000.2)
    assert len(lists[-1].artefacts) == 1
    assert bench.spawn(pose_at(2.5, 1.0), label="post").success


def test_many_requests_at_once_are_all_answered(bench: Bench) -> None:
    """As a script sends them that clears a hall; with the default of ROS ten would be kept."""
    kind, many = service_class("are_msgs/srv/RemoveArtefact"), 60
    client = bench.user.create_client(
        kind, f"{bench.name}/remove", qos_profile=QoSProfile(depth=many)
    )
    bench.until(client.service_is_ready)
    bench.settle()
    asked = [client.call_async(kind.Request(id=1000 + number)) for number in range(many)]
    bench.until(lambda: all(one.done() for one in asked))
    assert [one.result().message for one in asked] == [
        f"no artefact with id {1000 + number} is alive" for number in range(many)
    ]


def test_a_pose_that_is_no_rotation_is_refused(bench: Bench) -> None:
    """All zeros, as of a message that nobody filled, is not taken for no turn."""
    pose = pose_at(2.5, 2.0)
    pose.pose.orientation.w = 0.0
    answer = bench.spawn(pose, label="post")
    assert not answer.success
    assert "spawn: pose: pose" in answer.message


def test_the_bound_on_the_living_holds_for_requests_too(make_bench: MakeBench) -> None:
    """With its name in the sentence."""
    bench = make_bench({"population.max_alive": 1}, "configure", "activate")
    bench.send("map", room())
    bench.tick(1000.0)
    assert bench.spawn(pose_at(2.0, 2.0), label="post").success
    answer = bench.spawn(pose_at(3.0, 3.0), label="post")
    assert "population.max_alive" in answer.message


# ------------------------------------------------------------------------------------- the others


def test_one_is_removed_and_then_all_are(bench: Bench) -> None:
    """With an event each; an id that nobody has is refused."""
    lists, events = bench.listen("artefacts"), bench.listen("events")
    ids = [bench.spawn(pose_at(2.5, y), label="post").id for y in (1.0, 2.0, 3.0)]
    assert bench.call("remove", id=ids[1]).success
    again = bench.call("remove", id=ids[1])
    assert (again.success, again.message) == (False, f"no artefact with id {ids[1]} is alive")
    step(bench, 1000.2)
    assert [one.id for one in lists[-1].artefacts] == [ids[0], ids[2]]
    answer = bench.call("clear")
    assert (answer.success, answer.message) == (True, "2 artefacts are gone")
    step(bench, 1000.3)
    assert lists[-1].artefacts == []
    gone = [event for event in events if event.kind == ArtefactEvent.DEPARTED]
    assert [event.id for event in gone] == [ids[1], ids[0], ids[2]]
    assert {event.detail for event in gone} == {"removed"}


def test_a_seed_decides_what_comes_after_it(make_bench: MakeBench) -> None:
    """The same seed gives the same instants of arrival again, another one others."""
    values = {"population.arrival_rate": 2.0, "population.mean_life": 0.5}
    bench = make_bench({**values, "population.region": "free"}, "configure", "activate")
    bench.send("map", room())
    bench.tick(999.0)
    events = bench.listen("events")
    arrivals = []
    for t_s, seed in ((1000.0, 7), (1010.0, 7), (1020.0, 8)):
        bench.tick(t_s)
        answer = bench.call("reseed", seed=seed)
        assert answer.message == f"random numbers begin anew from seed {seed}"
        events.clear()
        bench.tick(t_s + 0.9)
        came = [event for event in events if event.kind == ArtefactEvent.ARRIVED]
        arrivals.append([stamp_in(event, t_s) for event in came])
    assert len(arrivals[0]) > 3
    assert arrivals[0] == arrivals[1]
    assert arrivals[0] != arrivals[2]


def stamp_in(event: Any, begin_s: float) -> int:
    """Return when an event happened after an instant [us]."""
    return round((nanoseconds(event.header.stamp) - ns(begin_s)) / 1000)


@pytest.mark.parametrize(
    "life",
    [
        pytest.param(life_of(0.0), id="drawn"),
        pytest.param(life_of(3.0), id="given"),
    ],
)
def test_a_pause_does_not_count(bench: Bench, life: Any) -> None:
    """Artefacts come back where they were, with as much of their lives before them."""
    lists, events = bench.listen("artefacts"), bench.listen("events")
    assert bench.spawn(pose_at(2.5, 2.0), label="post", life=life).success
    step(bench, 1000.2)
    (before,) = lists[-1].artefacts
    assert bench.pause(is_paused=True).message == "paused: the real map is relayed"
    bench.clock(1100.0)
    bench.settle()
    assert lists[-1].artefacts == []
    assert bench.pause(is_paused=False).message == "artefacts live on"
    step(bench, 1100.2)
    (after,) = lists[-1].artefacts
    assert [event for event in events if event.kind == ArtefactEvent.DEPARTED] == []
    assert (after.id, after.pose) == (before.id, before.pose)
    waited_ns = nanoseconds(after.departure) - nanoseconds(before.departure)
    assert waited_ns == pytest.approx(ns(1100.0 - 1000.2), abs=1000)


def nanoseconds(stamp: Any) -> int:
    """Return a time as one number."""
    return int(stamp.sec * 10**9 + stamp.nanosec)


def test_nobody_arrives_while_it_is_paused(make_bench: MakeBench) -> None:
    """And afterwards those come that would have come."""
    values = {"population.arrival_rate": 1.0, "population.mean_life": 1000.0}
    bench = make_bench({**values, "population.region": "free"}, "configure", "activate")
    lists = bench.listen("artefacts")
    bench.send("map", room())
    bench.tick(1000.0)
    bench.tick(1000.3)
    before = len(lists[-1].artefacts)
    bench.pause(is_paused=True)
    bench.clock(1050.0)
    bench.pause(is_paused=False)
    bench.tick(1050.1)
    assert before > 0
    assert len(lists[-1].artefacts) < before + 5
    bench.tick(1050.8)
    assert len(lists[-1].artefacts) > before


def test_pausing_twice_is_said(bench: Bench) -> None:
    """It is no error."""
    assert bench.pause(is_paused=False).message == "it is not paused"
    bench.pause(is_paused=True)
    answer = bench.pause(is_paused=True)
    assert (answer.success, answer.message) == (True, "it is already paused")
    assert bench.report()["state"].message == "paused: the real map is relayed"


@pytest.mark.parametrize("transitions", [(), ("configure",)])
def test_a_node_that_is_not_active_refuses(
    make_bench: MakeBench, transitions: tuple[str, ...]
) -> None:
    """All services, with the sentence that says what to do."""
    bench = make_bench({}, *transitions)
    answers = [
        bench.spawn(pose_at(2.0, 2.0)),
        bench.call("remove", id=1),
        bench.call("clear"),
        bench.call("reseed", seed=1),
        bench.pause(is_paused=True),
    ]
    assert {(answer.success, answer.message) for answer in answers} == {(False, NOT_ACTIVE)}


def test_before_the_first_clock_there_is_a_sentence(make_bench: MakeBench) -> None:
    """Nothing can be placed while the time is not known."""
    bench = make_bench({}, "configure", "activate")
    bench.send("map", room())
    answer = bench.spawn(pose_at(2.0, 2.0))
    assert not answer.success
    assert answer.message
    bench.tick(1000.0)
    assert bench.spawn(pose_at(2.0, 2.0)).success


# ------------------------------------------------------------------------------------- clicks


def test_a_click_places_an_artefact(bench: Bench) -> None:
    """Of the label that the parameter says, in the frame of the click."""
    lists = bench.listen("artefacts")
    assert bench.set(clicks__label="crate") == ""
    bench.send("clicked_point", click_at(2.5, 2.0))
    bench.send("clicked_point", click_at(1.5, 0.0, frame_id="base_link"))
    step(bench, 1000.2)
    places = [
        (a.label, a.ground_pose.position.x, a.ground_pose.position.y) for a in lists[-1].artefacts
    ]
    assert places == [("crate", 2.5, 2.0), ("crate", pytest.approx(1.0), pytest.approx(3.5))]


@pytest.mark.parametrize(
    ("click", "reason"),
    [
        (click_at(0.0, 2.0), "it would stand in a wall"),
        (click_at(2.0, 2.0, frame_id="arm"), "'arm'"),
        (click_at(float("inf"), 2.0), "not finite"),
        (click_at(2.0, 2.0, frame_id=""), "header.frame_id is empty"),
    ],
)
def test_a_click_that_cannot_be_followed_is_refused(bench: Bench, click: Any, reason: str) -> None:
    """With a warning and in the diagnostics; the next one works."""
    lists = bench.listen("artefacts")
    bench.send("clicked_point", click)
    step(bench, 1000.2)
    assert lists[-1].artefacts == []
    (said,) = bench.warnings()
    assert reason in said
    status = bench.report()["inputs/clicked_point"]
    assert status.level == b"\1"
    assert reason in status.message
    bench.send("clicked_point", click_at(2.5, 2.0))
    step(bench, 1000.3)
    assert len(lists[-1].artefacts) == 1


@pytest.mark.parametrize("phase", ["inactive", "paused"])
def test_a_click_while_nothing_runs_is_refused(bench: Bench, phase: str) -> None:
    """It places nothing later either."""
    lists = bench.listen("artefacts")
    if phase == "paused":
        bench.pause(is_paused=True)
    else:
        bench.change_state("deactivate")
    bench.send("clicked_point", click_at(2.5, 2.0))
    bench.report()
    (said,) = bench.warnings()
    assert said == "/clicked_point: nobody lives: not active, or paused"
    if phase == "paused":
        bench.pause(is_paused=False)
    else:
        bench.change_state("activate")
    step(bench, 1000.3)
    assert lists[-1].artefacts == []
