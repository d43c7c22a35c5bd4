"""The node's time: simulated by /clock, which stands still, leaps and loops, and that of walls."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import pytest

from tests.ros import NOT_SET_UP, undisturbed

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from are_msgs.msg import ArtefactEvent
from rosgraph_msgs.msg import Clock

from are_ros.builder.sensors.sensor_path import SensorPathCounts
from are_ros.conventions import NS_PER_S
from bags.simulation.making import make_time
from tests.node.live_bench import DELETE_ALL, PERIOD_NS, Bench, stamp_ns
from tests.node.live_scene import FACTORY, laser_mount, ns, pose_at, robot_at, room, scan

MakeBench = Callable[..., Bench]
SCAN = "sensor_msgs/msg/LaserScan"
MANY = {"population.arrival_rate": 1.0, "population.mean_life": 2.0}


def stamps(messages: Sequence[Any]) -> list[int]:
    """Return the stamps of messages, in ticks since 1000 s."""
    assert all(stamp_ns(message) % PERIOD_NS == 0 for message in messages)
    return [(stamp_ns(message) - ns(1000.0)) // PERIOD_NS for message in messages]


def has_more_than(messages: list[Any], count: int) -> bool:
    """Tell whether more have come."""
    return len(messages) > count


@pytest.mark.parametrize("use_events_executor", [False, True])
def test_ticks_run_at_the_multiples_of_their_period_each_once(
    make_bench: MakeBench, *, use_events_executor: bool
) -> None:
    """However the clock goes; none before it is known, and then at once."""
    bench = make_bench({}, "configure", "activate", use_events_executor=use_events_executor)
    metrics = bench.listen("metrics")
    bench.send("map", room())
    bench.turn_for(0.3)
    assert metrics == []
    t_s = 1000.0
    for step_s in (0.0, 0.037, 0.063, 0.001, 0.25, 0.049, 0.1, 0.5, 0.01, 0.003):
        t_s += step_s
        bench.tick(round(t_s, 6))
    assert stamps(metrics) == [*range(11)]


def test_the_tick_rate_is_a_parameter(make_bench: MakeBench) -> None:
    """Four times as often."""
    bench = make_bench({"builder.tick_rate": 40.0}, "configure", "activate")
    metrics = bench.listen("metrics")
    bench.tick(1000.01)
    bench.tick(1000.1)
    found = [stamp_ns(message) for message in metrics]
    assert found == [ns(1000.025), ns(1000.05), ns(1000.075), ns(1000.1)]


@pytest.mark.parametrize("use_events_executor", [False, True])
def test_a_leap_ahead_floods_nobody(make_bench: MakeBench, *, use_events_executor: bool) -> None:
    """A second's worth of ticks at the most; the others are counted.

    Lives go on meanwhile, but stand still in a leap of more than five seconds.
    """
    values = {**MANY, "population.region": "free"}
    bench = make_bench(values, "configure", "activate", use_events_executor=use_events_executor)
    metrics = bench.listen("metrics")
    bench.send("map", room())
    bench.tick(1000.0)
    bench.tick(1004.0)
    assert stamps(metrics) == [0, *range(31, 41)]
    arrivals = metrics[-1].arrivals
    assert arrivals > 25, "one in a second and square metre arrives meanwhile too"
    ticks = {pair.key: pair.value for pair in bench.report()["ticks"].values}
    assert (ticks["ticks"], ticks["skipped"]) == ("11", "30")
    bench.tick(1014.0)
    assert stamps(metrics)[11:] == [*range(131, 141)]
    assert metrics[-1].arrivals == arrivals
    bench.tick(1014.5)
    assert stamps(metrics)[-1] == 145
    assert metrics[-1].arrivals > arrivals


@pytest.mark.parametrize("use_events_executor", [False, True])
def test_a_leap_back_begins_anew(make_bench: MakeBench, *, use_events_executor: bool) -> None:
    """All artefacts depart with the event, viewers are told, and life goes on with new ids."""
    values = {"population.region": "free", **MANY}
    bench = make_bench(values, "configure", "activate", use_events_executor=use_events_executor)
    names = ("artefacts", "events", "markers", "metrics")
    lists, events, markers, metrics = (bench.listen(name) for name in names)
    bench.send("map", room())
    bench.tick(1000.0)
    for t_s in (1000.5, 1001.0, 1001.5):
        bench.tick(t_s)
    before = {one.id for one in lists[-1].artefacts}
    assert len(before) > 5
    bench.node._report_timer.cancel()  # it would do what is due within a second, too
    for heard in (events, markers, metrics, lists):
        heard.clear()
    bench.tick(1000.1)
    gone = [e for e in events if e.kind == ArtefactEvent.DEPARTED and e.id in before]
    assert {event.id for event in gone} == before
    assert {event.detail for event in gone} == {"clock_jumped_back"}
    assert markers[0].markers[0].action == DELETE_ALL
    assert before.isdisjoint(one.id for one in lists[-1].artefacts)
    bench.tick(1000.9)
    bench.tick(1001.3)
    assert stamps(metrics) == [*range(1, 14)]
    now = {one.id for one in lists[-1].artefacts}
    assert len(now) > 5
    assert min(now) > max(before)
    bench.report()
    (said,) = bench.warnings()
    assert said.startswith("the clock jumped back by 1.400 s: all artefacts are gone")


@pytest.mark.parametrize("use_events_executor", [False, True])
def test_a_recording_that_loops(make_bench: MakeBench, *, use_events_executor: bool) -> None:
    """Three times the same two seconds: in each every scan comes out augmented, every tick runs."""
    bench = make_bench(
        {"costmap.gate": "all"}, "configure", "activate", use_events_executor=use_events_executor
    )
    scans, metrics = bench.listen("scan", SCAN), bench.listen("metrics")
    lists, maps = bench.listen("artefacts"), bench.listen("augmented_map")
    bench.send("tf_static", laser_mount())
    bench.send("map", room())
    ids: list[int] = []
    for _ in range(3):
        scans.clear()
        metrics.clear()
        ids.append(drive(bench))
        assert stamps(metrics) == [*range(20)]
        assert stamps(scans) == [*range(20)]
        nearest = [min(message.ranges) for message in scans[2:]]
        assert nearest == pytest.approx([1.55 - 0.01 * index for index in range(2, 20)], abs=0.01)
        assert [one.id for one in lists[-1].artefacts] == ids[-1:]
        assert maps[-1].data.tolist().count(100) == 4 * 39 + 25
    assert len(set(ids)) == 3


def drive(bench: Bench) -> int:
    """Drive two seconds towards a post that is placed at their beginning; return its id."""
    spawned = 0
    for index in range(20):
        t_s = 1000.0 + 0.1 * index
        bench.clock(t_s)
        x = 1.0 + 0.01 * index
        bench.send("tf", robot_at(t_s, x=x, y=2.05))
        bench.send("scan", scan(t_s))
        bench.tick(t_s + 0.02)
        if index == 0:
            spawned = bench.spawn(pose_at(2.75, 2.05), label="post").id
    assert spawned
    return spawned


def test_a_small_step_back_is_no_leap(make_bench: MakeBench) -> None:
    """As of a clock that is corrected: nobody leaves, and no tick comes twice."""
    bench = make_bench({}, "configure", "activate")
    lists = bench.listen("artefacts")
    bench.send("map", room())
    bench.tick(1000.0)
    bench.tick(1000.15)
    assert bench.spawn(pose_at(2.0, 2.0), label="post").success
    bench.tick(1000.25)
    bench.clock(1000.19)
    bench.settle()
    bench.tick(1000.35)
    assert stamps(lists) == [0, 1, 2, 3]
    assert len(lists[-1].artefacts) == 1


@pytest.mark.parametrize("use_events_executor", [False, True])
def test_by_the_clock_of_the_wall(make_bench: MakeBench, *, use_events_executor: bool) -> None:
    """Ten ticks in a second, at the multiples of the period, and hardly late."""
    bench = make_bench(
        {"use_sim_time": False}, "configure", "activate", use_events_executor=use_events_executor
    )
    metrics = bench.listen("metrics")
    bench.send("map", room())
    bench.until(lambda: metrics)

    def latenesses_ns() -> list[int]:
        metrics.clear()
        late_ns: list[int] = []
        while len(metrics) < 12:
            bench.until(partial(has_more_than, metrics, len(metrics)))
            late_ns.append(bench.node.now_ns() - stamp_ns(metrics[-1]))
        return late_ns

    late_ns = undisturbed(latenesses_ns)
    found = [stamp_ns(message) for message in metrics]
    assert all(stamp % PERIOD_NS == 0 for stamp in found)
    assert {later - earlier for earlier, later in pairwise(found)} == {PERIOD_NS}
    assert 0 < sorted(late_ns)[len(late_ns) // 2] < PERIOD_NS // 2


def test_simulated_time_can_be_turned_on_while_it_runs(make_bench: MakeBench) -> None:
    """It waits for /clock then, goes by it, and says in its diagnostics which time it has."""
    bench = make_bench({"use_sim_time": False}, "configure", "activate")
    metrics = bench.listen("metrics")
    bench.send("map", room())
    bench.until(lambda: metrics)
    assert bench.report()["clock"].message == "the time of this machine"
    assert bench.set(use_sim_time=True) == ""
    bench.settle()
    bench.node._report_timer.cancel()
    assert bench.report()["clock"].level == b"\2"
    metrics.clear()
    bench.turn_for(0.3)
    assert metrics == []
    bench.tick(1000.0)
    bench.tick(1000.1)
    assert stamps(metrics) == [0, 1]
    assert bench.report()["clock"].message == "the time of /clock"


@pytest.mark.parametrize("use_sim_time", [False, True])
@pytest.mark.parametrize("use_events_executor", [False, True])
def test_what_dds_holds_is_read_before_a_scan_goes_out_bare(
    make_bench: MakeBench, *, use_events_executor: bool, use_sim_time: bool
) -> None:
    """While the executor does something else for 0.4 s forty transforms come, and many are due.

    An executor takes one message of a topic at a time, and sees to its timers before the next.
    """
    values = {"use_sim_time": use_sim_time, "sensors.tf_wait": 0.1}
    executor = {"use_events_executor": use_events_executor}
    bench = make_bench(values, "configure", "activate", **executor)
    scans = bench.listen("scan", SCAN)
    bench.send("map", room())
    bench.send("tf_static", laser_mount())
    now_s = 1000.0
    if use_sim_time:
        bench.clock(now_s)
    else:
        now_s = bench.node.now_ns() / NS_PER_S
    bench.send("tf", robot_at(now_s))
    bench.send("scan", scan(now_s + 0.02))
    bench.turn_for(0.02)
    transforms = bench.publisher("tf")
    for number in range(40):
        transforms.publish(robot_at(now_s + 0.001 * number))
    if use_sim_time:
        bench._clock.publish(Clock(clock=make_time(FACTORY, ns(now_s + 0.4))))
    time.sleep(0.4)
    bench.until(lambda: scans)
    assert bench.node.live is not None
    assert bench.node.live.builder.sensors.counts()["/scan"] == SensorPathCounts(exact=1)
    assert bench.node._inputs is not None
    heard = bench.node._inputs.watches["/tf"]
    bench.until(lambda: heard.count == 41)
    bench.send("tf", robot_at(now_s + 0.5))
    assert heard.count == 42
