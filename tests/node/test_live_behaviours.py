"""The running node and behaviours of the user's own that fail: it lives on, and says so."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.ros import NOT_SET_UP

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from tests.node.live_bench import Bench
from tests.node.live_scene import pose_at, robot_at, room

MakeBench = Callable[..., Bench]
CATALOGUE = """
classes:
  person:
    shape: person
    motion: {speed_mps: 1.0, turn_rate_radps: 3.0}
rows:
  - {label: late, class: person, size_m: [0.3, 0.4, 1.7], behaviours: {"FAILING:Late": 1}}
  - {label: unmade, class: person, size_m: [0.3, 0.4, 1.6], behaviours: {"FAILING:Unmade": 1}}
  - {label: nothing, class: person, size_m: [0.3, 0.4, 1.5], behaviours: {"FAILING:Returns": 1}}
  - {label: sleeper, class: person, size_m: [0.3, 0.4, 1.4], behaviours: {"FAILING:Sleeps": 1}}
  - {label: walker, class: person, size_m: [0.3, 0.4, 1.8], behaviours: {walking: 1}}
"""
PLACES = {"late": (2.5, 1.0), "unmade": (3.3, 1.0), "nothing": (3.3, 2.0), "walker": (2.5, 3.0)}


@pytest.fixture
def bench(make_bench: MakeBench, tmp_path: Path) -> Bench:
    """Return an active node at 1000.1 s: the room, the robot in it, nobody else."""
    catalogue = tmp_path / "catalogue.yaml"
    catalogue.write_text(
        CATALOGUE.replace("FAILING", "tests.agents.behaviours.failing"), encoding="utf-8"
    )
    made = make_bench({"catalogue": str(catalogue)}, "configure", "activate")
    made.clock(1000.0)
    made.send("map", room())
    step(made, 1000.1)
    return made


def step(bench: Bench, t_s: float) -> None:
    """Let the robot say where it is, and the time go on to a tick."""
    bench.send("tf", robot_at(t_s - 0.05, x=1.0))
    bench.tick(t_s)


def test_the_node_lives_on_and_who_has_failed_stands(bench: Bench) -> None:
    """Each sort is an error in the log once; diagnostics tell; maps go out, the others walk."""
    lists, maps = bench.listen("artefacts"), bench.listen("augmented_map")
    ids = {label: bench.spawn(pose_at(*place), label=label).id for label, place in PLACES.items()}
    step(bench, 1000.2)
    ids["again"] = bench.spawn(pose_at(3.3, 3.3), label="unmade").id
    for tick in range(3, 56):
        step(bench, 1000.0 + 0.1 * tick)
    living = {one.id: one for one in lists[-1].artefacts}
    for label in ("late", "unmade", "nothing", "again"):
        one = living[ids[label]]
        assert one.behaviour == "standing"
        assert ("activity", "its behaviour failed") in [(f.key, f.value) for f in one.features]
    assert living[ids["walker"]].behaviour == "walking"
    assert living[ids["late"]].ground_pose.position.x > PLACES["late"][0] + 0.3
    assert bench.state() == "active"
    assert len(maps) > 0
    errors = [line for line in bench.warnings() if "failed at" in line]
    for label, words in (
        ("Unmade", "RuntimeError: no parts"),
        ("Late", "ValueError: late boom"),
        ("Returns", "decide returned None, which is no Intent"),
    ):
        (line,) = (line for line in errors if f"failing:{label} of artefact " in line)
        assert words in line
        assert line.endswith("; it stands from now on")
    status = bench.report()["behaviours"]
    assert status.level == b"\1"
    assert status.message.startswith("the behaviour of 4 artefacts has failed, and they stand")
    counts = {value.key.partition(":")[2]: value.value for value in status.values}
    assert counts == {"Late": "1 failed", "Returns": "1 failed", "Unmade": "2 failed"}


def test_who_does_not_return_is_told_while_the_node_stands_still_and_afterwards(
    bench: Bench,
) -> None:
    """In the log at once, with the place; then with the time it took, in the diagnostics too."""
    sleeper = bench.spawn(pose_at(2.5, 2.0), label="sleeper").id
    for tick in range(2, 14):
        step(bench, 1000.0 + 0.1 * tick)
    who = f"the behaviour tests.agents.behaviours.failing:Sleeps of artefact {sleeper} (sleeper)"
    said = [line for line in bench.warnings() if line.startswith(who)]
    at_once, afterwards = said
    assert "failing.py, line " in at_once
    assert at_once.endswith(") has not returned for a second; the node stands still")
    took_s = float(afterwards.partition("did not return: for ")[2].partition(" s ")[0])
    assert 1.5 <= took_s < 10.0
    status = bench.report()["behaviours"]
    assert (status.level, status.message) == (b"\1", afterwards)
    status = bench.report()["answers"]
    assert status.level == b"\1"
    assert bench.state() == "active"
