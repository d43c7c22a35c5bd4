"""Break the code on purpose, breakage by breakage, and see that a test of each invariant fails.

The package and its tests are copied into a temporary folder; one breakage at a time is applied
there, and only the tests that must fail are run. Exit status 0 if the unbroken copy passes and
every breakage is caught. Run as: python scripts/mutate_invariants.py
"""

import os
import queue
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
COPIED = ("are_ros", "tests", "pyproject.toml")
JOBS = 2
PASSED, FAILED = 0, 1
TIMEOUT_S = 240

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
_LIVES = "tests/builder/test_lives.py::"
_BUILDER = "tests/builder/test_ar_builder.py::"
_CELLS_TEST = _RUN + "test_the_map_is_the_real_one_outside_artefacts_and_100_inside"
_COSTMAP_TEST = _RUN + "test_the_costmap_is_never_below_that_of_the_real_map"
_SCAN_TEST = _RUN + "test_no_real_return_leaves_a_scan_unless_a_virtual_surface_is_in_front"
_WALL_TEST = _RUN + "test_no_artefact_overlaps_a_wall"
_DEPARTED_TEST = _RUN + "test_a_departed_artefact_is_in_no_list_and_not_drawn"
_REFUSED_TEST = _RUN + "test_bad_input_is_refused_and_counted_and_the_last_good_value_stays"
_RATE_TEST = _BUILDER + "test_what_happens_does_not_depend_on_the_tick_rate"


@dataclass(frozen=True)
class Breakage:
    """A change of `source`, which occurs once in `path`, and the tests that must all fail."""

    invariant: str
    name: str
    path: str
    source: str
    broken: str
    tests: tuple[str, ...]


BREAKAGES = (
    Breakage(
        CELLS,
        "artefacts are 99",
        "are_ros/builder/augmented_map.py",
        "np.copyto(each.of(self._next), np.int8(OCCUPIED), where=each.mask)",
        "np.copyto(each.of(self._next), np.int8(OCCUPIED - 1), where=each.mask)",
        (_CELLS_TEST,),
    ),
    Breakage(
        CELLS,
        "who moves away leaves free cells, not the real ones",
        "are_ros/builder/augmented_map.py",
        "np.copyto(each.of(self._next), each.of(self._real), where=each.mask)",
        "np.copyto(each.of(self._next), np.int8(0), where=each.mask)",
        (_CELLS_TEST,),
    ),
    Breakage(
        CELLS,
        "footprints are 3 cm too small on each side",
        "are_ros/builder/registration.py",
        "covered(boxes.packed, i, lattice, shape, TOUCH_TOLERANCE_M)",
        "covered(boxes.packed, i, lattice, shape, 0.03)",
        (_CELLS_TEST,),
    ),
    Breakage(
        CELLS,
        "the gate lets everybody through",
        "are_ros/builder/ar_builder.py",
        "{i: patches[i] for i in admitted}",
        "{i: patches[i] for i in patches}",
        (_CELLS_TEST + "[perceived]",),
    ),
    Breakage(
        COSTMAP,
        "who moves away takes the walls' inflation along",
        "are_ros/builder/costmap.py",
        "restore(self._costs, self._static, vacated)",
        "restore(self._costs, np.zeros_like(self._static), vacated)",
        (_COSTMAP_TEST,),
    ),
    Breakage(
        COSTMAP,
        "walls are not inflated",
        "are_ros/builder/costmap.py",
        "self._static = inflated(occupied, self._cost_of_d2, self._radius_cells, 0)",
        "self._static = np.where(occupied, np.uint8(LETHAL), np.uint8(0))",
        (_COSTMAP_TEST,),
    ),
    Breakage(
        RETURNS,
        "a virtual return replaces a nearer real one",
        "are_ros/builder/augmented_scan.py",
        "nearer = np.where(returned, hits < real, hits <= farthest)",
        "nearer = hits <= farthest",
        (_SCAN_TEST,),
    ),
    Breakage(
        RETURNS,
        "walls hide nothing from beams without a return",
        "are_ros/builder/augmented_scan.py",
        "    if surface is not None:\n",
        "    if surface is None:\n",
        (_SCAN_TEST,),
    ),
    Breakage(
        RETURNS,
        "a scan meets the artefacts of a second ago",
        "are_ros/builder/scans.py",
        "self._lives.scene_at(scan.stamp_ns,",
        "self._lives.scene_at(scan.stamp_ns - 1_000_000_000,",
        (_SCAN_TEST, _BUILDER + "test_a_scan_meets_the_artefacts_of_its_own_stamp"),
    ),
    Breakage(
        WALLS,
        "a wall that appears moves nobody",
        "are_ros/builder/collisions.py",
        "~walls & (depths_m(self._robots, boxes) <= self._limits).all(axis=1)",
        "(depths_m(self._robots, boxes) <= self._limits).all(axis=1)",
        (_WALL_TEST, _LIVES + "test_a_wall_that_appears_moves_the_artefact_aside"),
    ),
    Breakage(
        WALLS,
        "a new map is not looked at once a scene was found safe",
        "are_ros/builder/collisions.py",
        "if self._scene is None or self._scene[0] is not environment:",
        "if self._scene is None:",
        (_WALL_TEST,),
    ),
    Breakage(
        OTHERS,
        "arrivals do not look at the others",
        "are_ros/artefacts/surroundings.py",
        "clear = ~overlaps_any(boxes, self.others)",
        "clear = np.ones(len(boxes), dtype=np.bool_)",
        (_LIVES + "test_arrivals_overlap_nothing_at_the_instant_they_come",),
    ),
    Breakage(
        OTHERS,
        "members of a group do not see each other",
        "are_ros/builder/crowd.py",
        "        self._boxes = self._end_boxes = None  # the next of a group sees this one\n",
        "",
        (_LIVES + "test_arrivals_overlap_nothing_at_the_instant_they_come[4.0]",),
    ),
    Breakage(
        OTHERS,
        "who is placed by service may overlap",
        "are_ros/builder/spawning.py",
        "if overlaps_any(box, others)[0]:",
        "if overlaps_any(box, others)[0] and not len(others):",
        (_LIVES + "test_a_placement_that_overlaps_is_refused_with_the_reason[2.8-",),
    ),
    Breakage(
        ROBOT,
        "arrivals do not keep away from the robot",
        "are_ros/builder/spawning.py",
        "keep_out = tuple(KeepOut(shape, self._clearance_m) for shape in shapes)",
        "keep_out = ()",
        (_LIVES + "test_arrivals_overlap_nothing_at_the_instant_they_come",),
    ),
    Breakage(
        ROBOT,
        "contacts are not reported",
        "are_ros/builder/motions.py",
        "begun = self.contacts.begun(step_ns, resolution.contacts, living)",
        "begun: list[ArtefactEvent] = []",
        (
            _RUN + "test_none_overlaps_the_robot_but_for_reported_contacts",
            _LIVES + "test_a_robot_that_drives_into_an_artefact",
        ),
    ),
    Breakage(
        ROBOT,
        "nobody makes way",
        "are_ros/builder/assembly.py",
        "OnRobotContact.DISPLACE: Displace(),",
        "OnRobotContact.DISPLACE: Hold(),",
        (
            _RUN + "test_none_overlaps_the_robot_but_for_reported_contacts[all]",
            _LIVES + "test_a_robot_that_drives_into_an_artefact[displace]",
        ),
    ),
    Breakage(
        DEPARTED,
        "markers stay",
        "are_ros/builder/markers.py",
        "[look for number in sorted(known) for look in deletion(known[number])]",
        "[]",
        (_DEPARTED_TEST, _BUILDER + "test_a_departed_artefact_leaves_nothing_behind"),
    ),
    Breakage(
        DEPARTED,
        "cells stay",
        "are_ros/builder/_patches.py",
        "vacated=tuple(placed for i, placed in before.items() if i not in standing)",
        "vacated=()",
        (_CELLS_TEST, _BUILDER + "test_a_departed_artefact_leaves_nothing_behind"),
    ),
    Breakage(
        DEPARTED,
        "lives have no end for lists and scans",
        "are_ros/artefacts/artefact.py",
        "(self.departure_ns is None or t_ns < self.departure_ns)",
        "True",
        (_DEPARTED_TEST, _BUILDER + "test_a_departed_artefact_leaves_nothing_behind"),
    ),
    Breakage(
        RELAY,
        "no grid before the robot is known",
        "are_ros/builder/ar_builder.py",
        "if environment is None or not self.demand.grids:\n            return Grids()",
        "if environment is None or observation.map_from_base is None:\n            return Grids()",
        (
            _RUN + "test_the_map_is_relayed_before_the_robot_is_known",
            _BUILDER + "test_the_real_map_is_relayed_before_anything_else",
        ),
    ),
    Breakage(
        RELAY,
        "a new map goes out only when an artefact moves",
        "are_ros/builder/augmented_map.py",
        "        if was_new:\n            return ChangedRectangle(0, 0, *shape)\n",
        "",
        (
            _BUILDER + "test_the_real_map_is_relayed_before_anything_else",
            _BUILDER + "test_a_new_map_is_relayed_too",
        ),
    ),
    Breakage(
        TOPICS,
        "outputs have the inputs' names",
        "are_ros/replay/tick_writer.py",
        'PREFIX = "/ar_builder/"',
        'PREFIX = "/"',
        (_RUN + "test_nothing_is_written_on_a_topic_of_the_robot",),
    ),
    Breakage(
        TOPICS,
        "the real map is handed on itself, not a copy",
        "are_ros/builder/grids.py",
        "return _like(real, now_ns, cells.copy()), None if is_first else update",
        "return _like(real, now_ns, real.cells), None if is_first else update",
        (_RUN + "test_inputs_are_never_written_to",),
    ),
    Breakage(
        REFUSED,
        "a map in any frame is taken",
        "are_ros/builder/reality.py",
        "if grid.frame_id != self.parameters.frames.map:",
        "if not grid.frame_id:",
        (
            _REFUSED_TEST + "[bad3-elsewhere]",
            _BUILDER + "test_a_map_in_another_frame_is_refused_and_changes_nothing",
        ),
    ),
    Breakage(
        REFUSED,
        "refusals are not counted",
        "are_ros/messages/feed.py",
        "            return self.refusals.add(message.topic, self._roles[message.topic], cause)\n",
        "            return str(cause)\n",
        (_REFUSED_TEST,),
    ),
    Breakage(
        REFUSED,
        "a refused map has already been taken",
        "are_ros/builder/reality.py",
        "        self._received(received_ns)\n        if grid.frame_id",
        "        self._received(received_ns)\n        self.world.set_grid(grid)\n"
        "        if grid.frame_id",
        (
            _REFUSED_TEST + "[bad3-elsewhere]",
            _RUN + "test_a_bad_map_leaves_artefacts_and_grids_as_they_were",
        ),
    ),
    Breakage(
        REFUSED,
        "a bad cloud takes the place of the good one",
        "are_ros/builder/real_world.py",
        "        if self._is_known(cloud, map_from_cloud):\n",
        "        self.environment = None\n        if self._is_known(cloud, map_from_cloud):\n",
        ("tests/builder/test_real_world.py::test_a_bad_cloud_is_refused_at_once_in_any_frame",),
    ),
    Breakage(
        SAME,
        "dice without a seed",
        "are_ros/artefacts/randomness.py",
        "np.random.PCG64(sequence)",
        "np.random.PCG64()",
        (
            _RUN + "test_the_same_inputs_and_seed_give_the_same_bytes",
            _BUILDER + "test_the_seed_decides_everything",
        ),
    ),
    Breakage(
        SAME,
        "the seed decides nothing",
        "are_ros/artefacts/randomness.py",
        "SeedSequence(seed, spawn",
        "SeedSequence(0 * seed, spawn",
        (_BUILDER + "test_the_seed_decides_everything",),
    ),
    Breakage(
        TICKS,
        "sub-steps run when somebody asks",
        "are_ros/builder/lives.py",
        "steps.go_on(now_ns)",
        "steps.next_ns = now_ns + steps.period_ns",
        (_RATE_TEST + "[20.0]",),
    ),
    Breakage(
        TICKS,
        "arrivals keep away from where a tick saw the robot",
        "are_ros/builder/lives.py",
        "self._robot = self._robots.pose(step_ns) or self._robot",
        "self._robot = self._robots.last or self._robots.pose(step_ns)",
        (_RATE_TEST + "[33.0]",),
    ),
    Breakage(
        TICKS,
        "scans wait for the next tick",
        "are_ros/builder/reality.py",
        "            self._scans.deadline_passed(deadline_ns)\n",
        "            self._scans.deadline_passed(now_ns)\n",
        ("tests/builder/test_scans.py::test_a_late_correction_is_held_in_the_builder",),
    ),
)


@dataclass(frozen=True)
class Verdict:
    """What became of a breakage: the named tests that did not fail, and how long it took."""

    breakage: Breakage
    missed: tuple[str, ...]
    seconds: float


def main() -> int:
    """Check all breakages, print a table, and return the exit status."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="mutate_") as folder:
        copies = [copy_project(Path(folder) / str(number)) for number in range(JOBS)]
        tests = sorted({test for breakage in BREAKAGES for test in breakage.tests})
        files = sorted({test.split("::")[0] for test in tests})
        status, output = run_tests(copies[0], files)
        if status != PASSED:
            print(output)
            print("NOT EVEN the unbroken copy passes")
            return FAILED
        print(f"the unbroken copy passes ({time.perf_counter() - started:.0f} s)", flush=True)
        verdicts = list(judge_all(copies))
    uncaught = [verdict for verdict in verdicts if verdict.missed]
    for invariant in INVARIANTS:
        of_it = [verdict for verdict in verdicts if verdict.breakage.invariant == invariant]
        caught = sum(not verdict.missed for verdict in of_it)
        print(f"{caught:3d} of {len(of_it):2d} caught   {invariant}")
    count, seconds = len(verdicts), time.perf_counter() - started
    print(f"{count - len(uncaught)} of {count} breakages caught in {seconds:.0f} s")
    return FAILED if uncaught else PASSED


def judge_all(copies: Sequence[Path]) -> Iterable[Verdict]:
    """Yield the verdicts in the order of the breakages, each copy serving one at a time."""
    free: queue.Queue[Path] = queue.Queue()
    for copy in copies:
        free.put(copy)

    def judge_somewhere(breakage: Breakage) -> Verdict:
        copy = free.get()
        try:
            return judge(copy, breakage)
        finally:
            free.put(copy)

    with ThreadPoolExecutor(len(copies)) as pool:
        for verdict in pool.map(judge_somewhere, BREAKAGES):
            breakage = verdict.breakage
            mark = "NOT CAUGHT" if verdict.missed else "caught    "
            print(f"{mark} {verdict.seconds:5.1f} s  {breakage.name}", flush=True)
            for test in verdict.missed:
                print(f"             passes: {test}")
            yield verdict


def copy_project(to: Path) -> Path:
    """Copy what the tests need, with times and compiled kernels, so that these still hold."""
    for name in COPIED:
        source = PROJECT / name
        if source.is_dir():
            shutil.copytree(source, to / name)
        else:
            shutil.copy2(source, to / name)
    return to


def judge(copy: Path, breakage: Breakage) -> Verdict:
    """Apply a breakage to a copy, run its tests, and put the file back as it was."""
    started, path = time.perf_counter(), copy / breakage.path
    original, times = path.read_text(encoding="utf-8"), path.stat()
    try:
        path.write_text(broken_text(original, breakage), encoding="utf-8")
        _, output = run_tests(copy, breakage.tests)
    finally:
        path.write_text(original, encoding="utf-8")
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    return Verdict(breakage, missed(output, breakage.tests), time.perf_counter() - started)


def broken_text(original: str, breakage: Breakage) -> str:
    """Return a source with the breakage in it; ValueError unless its snippet is there once."""
    count = original.count(breakage.source)
    if count != 1:
        raise ValueError(f"{breakage.path} has {count} times the snippet of: {breakage.name}")
    return original.replace(breakage.source, breakage.broken)


def missed(output: str, tests: Iterable[str]) -> tuple[str, ...]:
    """Return the named tests none of whose cases failed."""
    failed = [line.split()[1] for line in output.splitlines() if line.startswith("FAILED ")]
    return tuple(test for test in tests if not any(name.startswith(test) for name in failed))


def run_tests(copy: Path, tests: Sequence[str]) -> tuple[int, str]:
    """Run tests on a copy's package; return pytest's exit status and its output."""
    variables = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    variables |= {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    selected = sorted({test.split("[")[0] for test in tests})
    command = [sys.executable, "-m", "pytest", "-q", "-rf", "--tb=line", "-p", "no:cacheprovider"]
    try:
        done = subprocess.run(
            [*command, *selected],
            cwd=copy,
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
