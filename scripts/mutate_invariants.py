"""Break the code on purpose, breakage by breakage, and see that a test of each invariant fails.

A breakage replaces one function of are_ros in the process that runs the tests; no file is changed.
This file is also the plugin of pytest that does so. Exit status 0 if the unbroken code passes and
every breakage is caught. Run as: python scripts/mutate_invariants.py
"""

import functools
import importlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

PROJECT = Path(__file__).resolve().parents[1]
JOBS = 2
PASSED, FAILED = 0, 1
TIMEOUT_S = 600
CHOSEN = "ARE_BREAKAGE"
"""The environment variable that names the breakage which the plugin applies."""

CELLS = "map byte-equal outside artefact cells, 100 inside"
COSTMAP = "costmap never below the real map inflated"
RETURNS = "no real return leaves a scan but for a surface in front"
WALLS = "no artefact overlaps a wall"
OTHERS = "no artefact overlaps another"
ROBOT = "none overlaps the robot but for reported contacts"
DEPARTED = "a departed artefact leaves nothing behind"
RELAY = "the real map is relayed from the beginning"
TOPICS = "the robot's own topics are untouched"
REFUSED = "bad input is refused, counted, the last good value stays"
SAME = "same inputs and seed, same bytes"
TICKS = "what happens does not depend on the tick rate"
INVARIANTS = (
    CELLS,
    COSTMAP,
    RETURNS,
    WALLS,
    OTHERS,
    ROBOT,
    DEPARTED,
    RELAY,
    TOPICS,
    REFUSED,
    SAME,
    TICKS,
)

_RUN = "tests/builder/test_invariants.py::"
_LIVES = "tests/builder/test_population_manager.py::"
_BUILDER = "tests/builder/test_ar_builder.py::"
_CELLS_TEST = _RUN + "test_the_map_is_the_real_one_outside_artefacts_and_100_inside"
_COSTMAP_TEST = _RUN + "test_the_costmap_is_never_below_that_of_the_real_map"
_DEPTHS = (
    "tests/builder/sensors/test_depth_image.py::test_walls_hide_only_from_pixels_without_a_return"
)
_SCAN_TEST = _RUN + "test_no_real_return_leaves_a_scan_unless_a_virtual_surface_is_in_front"
_WALL_TEST = _RUN + "test_no_artefact_overlaps_a_wall"
_DEPARTED_TEST = _RUN + "test_a_departed_artefact_is_in_no_list_and_not_drawn"
_REFUSED_TEST = _RUN + "test_bad_input_is_refused_and_counted_and_the_last_good_value_stays"
_RATE_TEST = _BUILDER + "test_what_happens_does_not_depend_on_the_tick_rate"


class Breakage:
    """What breaks an invariant, and the tests that must all fail then.

    `target` is "module:name" or "module:Class.name", below are_ros. `broken` is called instead of
    it, with the real function before the arguments; what is no function it is given once.
    """

    def __init__(
        self, invariant: str, name: str, target: str, broken: Callable[..., Any], *tests: str
    ) -> None:
        self.invariant, self.name, self.target = invariant, name, target
        self.broken, self.tests = broken, tests


NO_GRIDS = SimpleNamespace(
    augmented_map=None, update=None, artefact_map=None, artefact_update=None, costmap=None
)


def none(_real: Any, items: Any, *_: Any) -> Any:
    """Say no of each of N items."""
    return np.zeros(len(items), dtype=np.bool_)


def put(owner: Any, name: str, value: Any) -> bool:
    """Set an attribute, and say no: what is to be done then follows after `or`."""
    setattr(owner, name, value)
    return False


def unseen_by_group(_: Any) -> Any:
    """Leave those out of the boxes taken who came last."""

    def taken(table: Any) -> Any:
        arrivals_ns = np.array([one.arrival_ns for one in table.artefacts], np.int64)
        return table.boxes.take(arrivals_ns < arrivals_ns.max(initial=0))

    return property(taken)


def replacing_nearer(real: Any, scan: Any, *rest: Any) -> Any:
    """Merge hits into a scan as if nothing real had come back."""
    ranges = np.where(np.isneginf(scan.ranges), scan.ranges, np.float32(np.inf))
    virtual, replaced = real(scan.with_ranges(ranges, scan.intensities), *rest)
    return np.where(replaced, virtual, scan.ranges), replaced


def sub_step_of_tick(real: Any, lives: Any, step_ns: int) -> None:
    """Run a sub-step with the robot where it was looked up last, by whom ever."""
    robots = lives._robots  # noqa: SLF001 - it is broken on purpose
    lives._robots = SimpleNamespace(  # noqa: SLF001
        pose=lambda now_ns: robots.last or robots.pose(now_ns), observer=robots.observer
    )
    real(lives, step_ns)
    lives._robots = robots  # noqa: SLF001


# A table: of each its invariant, name, target, what takes its place, and the tests.
# fmt: off
BREAKAGES = (
    Breakage(CELLS, "artefacts are 99", "builder.costmap.augmented_map:OCCUPIED",
             lambda real: real - 1, _CELLS_TEST),
    Breakage(CELLS, "who moves away leaves free cells, not the real ones",
             "builder.costmap.augmented_map:AugmentedMap.__init__",
             lambda real, self, cells: real(self, cells) or put(self, "_real", 0 * cells),
             "tests/builder/costmap/test_augmented_map.py::"
             "test_bytes_are_the_real_ones_outside_and_100_inside"),
    Breakage(CELLS, "footprints are 3 cm too small on each side",
             "builder.costmap.registration:TOUCH_TOLERANCE_M", lambda _: 0.03, _CELLS_TEST),
    Breakage(CELLS, "the gate lets everybody through",
             "builder.costmap.augmented_map:GateMemory.admitted",
             lambda _real, _self, _now, _seen, patches, *_: frozenset(patches),
             _CELLS_TEST + "[perceived]"),
    Breakage(COSTMAP, "who moves away takes the walls' inflation along",
             "builder.costmap.inflation:restore",
             lambda real, costs, static, vacated: real(costs, np.zeros_like(static), vacated),
             _COSTMAP_TEST),
    Breakage(COSTMAP, "walls are not inflated", "builder.costmap.inflation:inflated",
             lambda real, mask, table, reach, margin:
                 (real(mask, table, reach, margin) if margin else table[0] * mask.astype(np.uint8)),
             _COSTMAP_TEST),
    Breakage(RETURNS, "a virtual return replaces a nearer real one",
             "builder.sensors.laser_scan:_merged", replacing_nearer, _SCAN_TEST),
    Breakage(RETURNS, "walls hide nothing from beams without a return",
             "builder.sensors.obstacles:Obstacles.are_hidden",
             lambda real, _self, _pose, rays, *_: none(real, rays), _SCAN_TEST),
    Breakage(RETURNS, "walls hide nothing from pixels without a depth",
             "builder.sensors.obstacles:Obstacles.are_hidden",
             lambda real, _self, _pose, rays, *_: none(real, rays), _DEPTHS),
    Breakage(RETURNS, "a scan meets the artefacts of a second ago",
             "builder.population_manager:PopulationManager.scene_at",
             lambda real, self, t_ns, arrived_by_ns=None:
                 real(self, t_ns - (arrived_by_ns is not None) * 1_000_000_000, arrived_by_ns),
             _SCAN_TEST, _BUILDER + "test_a_scan_meets_the_artefacts_of_its_own_stamp"),
    Breakage(WALLS, "a wall that appears moves nobody",
             "world.environment:Environment.hits_wall",
             lambda real, _self, boxes: none(real, boxes), _WALL_TEST,
             _LIVES + "test_a_wall_that_appears_moves_the_artefact_aside"),
    Breakage(WALLS, "the resolver tests poses against robots, not against walls",
             "agents.collisions:_are_allowed",
             lambda real, boxes, _environment, *rest:
                 real(boxes, SimpleNamespace(hits_wall=lambda all_: none(None, all_)), *rest),
             _WALL_TEST),
    Breakage(OTHERS, "arrivals do not look at the others",
             "builder.spawning.placement:overlaps_any",
             none, _LIVES + "test_arrivals_overlap_nothing_at_the_instant_they_come"),
    Breakage(OTHERS, "members of a group do not see each other",
             "agents.table:AgentTable.taken",
             unseen_by_group,
             _LIVES + "test_arrivals_overlap_nothing_at_the_instant_they_come[4.0]"),
    Breakage(OTHERS, "who is placed by service may overlap",
             "builder.spawning.spawner:overlaps_any", none,
             _LIVES + "test_a_placement_that_overlaps_is_refused_with_the_reason[2.8-"),
    Breakage(ROBOT, "arrivals do not keep away from the robot",
             "builder.spawning.spawner:Spawning.place",
             lambda real, self, row, dice, others, _robot, *rest:
                 real(self, row, dice, others, None, *rest),
             _LIVES + "test_arrivals_overlap_nothing_at_the_instant_they_come"),
    Breakage(ROBOT, "contacts are not reported", "agents.collisions:ContactLog.begun",
             lambda *_: [], _RUN + "test_none_overlaps_the_robot_but_for_reported_contacts",
             _LIVES + "test_a_robot_that_drives_into_an_artefact"),
    Breakage(ROBOT, "nobody makes way", "agents.collisions:Displace.tolerated_m",
             lambda real, *arguments: real(*arguments) + np.inf,
             _RUN + "test_none_overlaps_the_robot_but_for_reported_contacts[all]",
             _LIVES + "test_a_robot_that_drives_into_an_artefact[displace]"),
    Breakage(DEPARTED, "markers stay", "builder.markers:deletions",
             lambda real, before, now: real({i: before[i] for i in before if i in now}, now),
             _DEPARTED_TEST,
             _BUILDER + "test_a_departed_artefact_leaves_nothing_behind"),
    Breakage(DEPARTED, "cells stay", "builder.costmap.augmented_map:patch_changes",
             lambda real, *arguments: replace(real(*arguments), vacated=()), _CELLS_TEST,
             _BUILDER + "test_a_departed_artefact_leaves_nothing_behind"),
    Breakage(DEPARTED, "lives have no end for lists and scans",
             "population.population:Population.present_at",
             lambda _, self, t_ns:
                 [one for one in (*self._departed, *self._living.values())
                  if one.arrival_ns <= t_ns],
             _DEPARTED_TEST,
             _BUILDER + "test_a_departed_artefact_leaves_nothing_behind"),
    Breakage(RELAY, "no grid before the robot is known",
             "builder.ar_builder:ArBuilder._augment",
             lambda real, self, now_ns, *rest:
                 real(self, now_ns, *rest) if self.robots.pose(now_ns) else NO_GRIDS,
             _RUN + "test_the_map_is_relayed_before_the_robot_is_known",
             _BUILDER + "test_the_real_map_is_relayed_before_anything_else"),
    Breakage(RELAY, "a new map goes out only when an artefact moves",
             "builder.costmap.augmented_map:AugmentedMap.__init__",
             lambda real, self, cells: real(self, cells) or put(self, "_changed", None),
             _BUILDER + "test_the_real_map_is_relayed_before_anything_else",
             _BUILDER + "test_a_new_map_is_relayed_too"),
    Breakage(TOPICS, "outputs have the inputs' names",
             "replay.listeners:PREFIX", lambda _: "/",
             _RUN + "test_nothing_is_written_on_a_topic_of_the_robot"),
    Breakage(TOPICS, "the real map is handed on itself, not a copy",
             "builder.costmap.augmented_map:_like",
             lambda real, grid, now_ns, cells:
                 real(grid, now_ns, grid.cells if np.array_equal(cells, grid.cells) else cells),
             _RUN + "test_inputs_are_never_written_to"),
    Breakage(REFUSED, "a map in any frame is taken",
             "builder.ar_builder:ArBuilder.receive_map",
             lambda real, self, grid, received_ns:
                 real(self, replace(grid, frame_id=self.parameters.frames.map), received_ns),
             _REFUSED_TEST + "[bad3-elsewhere]",
             _BUILDER + "test_a_map_in_another_frame_is_refused_and_changes_nothing"),
    Breakage(REFUSED, "refusals are not counted", "messages.feed:Refusals.add",
             lambda _real, _self, _topic, _role, cause: str(cause), _REFUSED_TEST),
    Breakage(REFUSED, "a refused map has already been taken",
             "builder.ar_builder:ArBuilder.receive_map",
             lambda real, self, grid, received_ns:
                 (self.world.set_grid(grid) or real(self, grid, received_ns)),
             _REFUSED_TEST + "[bad3-elsewhere]",
             _RUN + "test_a_bad_map_leaves_artefacts_and_grids_as_they_were"),
    Breakage(REFUSED, "a bad cloud takes the place of the good one",
             "builder.real_world:RealWorld.set_cloud",
             lambda real, self, *cloud: put(self, "environment", None) or real(self, *cloud),
             "tests/builder/test_real_world.py::test_a_bad_cloud_is_refused_at_once_in_any_frame"),
    Breakage(SAME, "dice without a seed", "population.randomness:generator",
             lambda *_: np.random.default_rng(),
             _RUN + "test_the_same_inputs_and_seed_give_the_same_bytes",
             _BUILDER + "test_the_seed_decides_everything"),
    Breakage(SAME, "the seed decides nothing", "population.randomness:generator",
             lambda real, _seed, *stream: real(0, *stream),
             _BUILDER + "test_the_seed_decides_everything"),
    Breakage(TICKS, "sub-steps run when somebody asks",
             "builder.population_manager:StepClock.go_on",
             lambda _, self, now_ns: put(self, "next_ns", now_ns + self.period_ns),
             _RATE_TEST + "[20.0]"),
    Breakage(TICKS, "arrivals keep away from where a tick saw the robot",
             "builder.population_manager:PopulationManager._sub_step",
             sub_step_of_tick, _RATE_TEST + "[33.0]"),
    Breakage(TICKS, "scans wait for the next tick",
             "builder.sensors.augmentation:SensorAugmentation.deadline_passed",
             lambda real, self, now_ns: real(self, -(-now_ns // self._tick_ns) * self._tick_ns),
             "tests/builder/sensors/test_sensors.py::test_a_late_correction_is_held_in_the_builder"),
)
# fmt: on


def apply(breakage: Breakage, patch: pytest.MonkeyPatch) -> None:
    """Apply a breakage; ValueError, a sentence, where what it replaces is not there any more.

    A function is replaced in all modules that import it if `target` is where it is defined.
    """
    module_name, path = breakage.target.split(":")
    *classes, name = path.split(".")
    try:
        owner: Any = importlib.import_module(f"are_ros.{module_name}")
        owner = functools.reduce(getattr, classes, owner)
        real = getattr(owner, name)
    except (AttributeError, ImportError) as error:
        text = f"the breakage '{breakage.name}' cannot be applied: {breakage.target} is not there"
        raise ValueError(text) from error
    if not callable(real):
        patch.setattr(owner, name, breakage.broken(real))
        return

    def broken(*arguments: Any, **options: Any) -> Any:
        return breakage.broken(real, *arguments, **options)

    patch.setattr(owner, name, broken)
    if isinstance(owner, ModuleType) and real.__module__ == owner.__name__:
        for module in [m for n, m in sys.modules.items() if n.startswith("are_ros.")]:
            if vars(module).get(name) is real:
                patch.setattr(module, name, broken)


def pytest_configure() -> None:
    """Apply the breakage that the environment names: pytest calls this in its plugins."""
    for each in BREAKAGES:
        if each.name == os.environ.get(CHOSEN):
            try:
                apply(each, pytest.MonkeyPatch())
            except ValueError as error:
                raise pytest.UsageError(str(error)) from error


@dataclass(frozen=True)
class Verdict:
    """What became of a breakage: the named tests that did not fail, what was said, how long."""

    breakage: Breakage
    missed: tuple[str, ...]
    said: str
    seconds: float


def main() -> int:
    """Check all breakages, print a table, and return the exit status."""
    started = time.perf_counter()
    status, output = run_tests([test for breakage in BREAKAGES for test in breakage.tests])
    if status != PASSED:
        print(output, "NOT EVEN the unbroken code passes", sep="\n")
        return FAILED
    print(f"the unbroken code passes ({time.perf_counter() - started:.0f} s)", flush=True)
    verdicts = []
    with ThreadPoolExecutor(JOBS) as pool:
        for verdict in pool.map(judge, BREAKAGES):
            verdicts.append(verdict)
            mark = "NOT CAUGHT" if verdict.missed else "caught    "
            print(f"{mark} {verdict.seconds:5.1f} s  {verdict.breakage.name}", flush=True)
            for line in (*(f"passes: {test}" for test in verdict.missed), verdict.said):
                if line:
                    print(f"             {line}")
    for invariant in INVARIANTS:
        of_it = [verdict for verdict in verdicts if verdict.breakage.invariant == invariant]
        caught = sum(not verdict.missed for verdict in of_it)
        print(f"{caught:3d} of {len(of_it):2d} caught   {invariant}")
    count, uncaught = len(verdicts), sum(bool(verdict.missed) for verdict in verdicts)
    seconds = time.perf_counter() - started
    print(f"{count - uncaught} of {count} breakages caught in {seconds:.0f} s")
    return FAILED if uncaught else PASSED


def judge(breakage: Breakage) -> Verdict:
    """Run the tests of a breakage with it applied."""
    started = time.perf_counter()
    _, output = run_tests(breakage.tests, breakage.name)
    said = [line for line in output.splitlines() if "cannot be applied" in line]
    seconds = time.perf_counter() - started
    return Verdict(breakage, missed(output, breakage.tests), "".join(said[:1]), seconds)


def missed(output: str, tests: Iterable[str]) -> tuple[str, ...]:
    """Return the named tests none of whose cases failed."""
    failed = [line.split()[1] for line in output.splitlines() if line.startswith("FAILED ")]
    return tuple(test for test in tests if not any(name.startswith(test) for name in failed))


def run_tests(tests: Sequence[str], breakage: str = "") -> tuple[int, str]:
    """Run tests with a breakage, or none; return pytest's exit status and its output."""
    paths = os.pathsep.join((str(PROJECT), str(PROJECT / "scripts")))
    variables = os.environ | {"PYTHONPATH": paths, CHOSEN: breakage}
    selected = sorted({test.split("[")[0] for test in tests})
    options = ("-q", "-rf", "--tb=line", "-p", "no:cacheprovider", "-p", Path(__file__).stem)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", *options, *selected],
            cwd=PROJECT,
            env=variables,
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return FAILED, f"no end within {TIMEOUT_S} s"
    return done.returncode, done.stdout + done.stderr


if __name__ == "__main__":
    sys.exit(main())
