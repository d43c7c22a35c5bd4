"""Replay real recordings in many ways, and judge every augmented scan by rays of its own.

    python scripts/judge_scans.py --data ../shared/data --work out/judged [--select REGEX] [--list]

Each line of the table is `are replay`, `are check`, and the judge of tests/oracles/scan_judge.py,
which shares no code with are_ros, on one recording at one tick rate with one shape. The recordings
are the real ones, and others made of them: beams without a return, stamps shifted against the log
times, scans that come late, a gap. The truth of the artefacts is that of another run of the same
recording at 20 Hz. What is done stands in WORK/results.jsonl; a second call goes on from there.
`--code DIR` runs the are_ros of another checkout. Ends with status 1 if anything is wrong.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.oracles import lattices  # noqa: E402 - found by the line above
from tests.oracles.recorded import Inputs, Outputs, read_inputs, read_outputs  # noqa: E402
from tests.oracles.recordings import Changes, change_recording  # noqa: E402
from tests.oracles.scan_judge import Verdict, judge  # noqa: E402

EXPORT = """
import sys, numpy as np
from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.population.meshes.geometry import mesh_of
rows = read_catalogue().rows
np.savez(sys.argv[1], **{str(row.index): np.asarray(mesh_of(row).triangles) for row in rows})
"""
"""What writes the triangles of the shipped rows, in the artefact's frame, as data for the judge."""


@dataclass(frozen=True)
class Case:
    """A recording with what it lacks; paths are relative to the data's folder."""

    name: str
    bag: str
    scan: str = ""
    map_file: str = ""
    octomap: str = ""
    map_frame: str = "map"
    static: tuple[str, ...] = ()
    odometry: tuple[str, ...] = ()
    arrival_rate: float = 0.01
    mean_life_s: float = 10.0
    options: tuple[str, ...] = ()

    def words(self, data: Path) -> list[str]:
        """Return the options of `are replay` for what the recording lacks."""
        words = [*self.options]
        words += ["--map", str(data / self.map_file)] if self.map_file else []
        words += ["--octomap", str(data / self.octomap)] if self.octomap else []
        words += ["--map-frame", self.map_frame] if self.map_frame != "map" else []
        words += [word for line in self.static for word in ("--static-tf", line)]
        words += ["--topic", f"scan:={self.scan}"] if self.scan else []
        words += [word for topic in self.odometry for word in ("--topic", f"odom:={topic}")]
        population = {"arrival_rate": self.arrival_rate, "mean_life": self.mean_life_s}
        for name, value in population.items():
            words += ["--set", f"population.{name}:={value}"]
        return words


HALL = Case(
    name="jarvis-complex-low",
    bag="drl-jarvis-hall/jarvis_complex_path_fast.bag",
    scan="/driver_laser_security/laser_scan",
    map_file="drl-jarvis-hall/i-108_10mm.yaml",
    map_frame="pgm",
    static=("14.56 3.31 0 -0.04 0 0 pgm map",),
)
HIGH = "/driver_laser_navigation/laser_scan"
CIRCLE = "drl-jarvis-hall/jarvis_circular_path_fast"
SHIP = Case(
    name="ship-base",
    bag="drl-ship-interior-gazebo/ship_interior_with_tilting_laser.bag",
    scan="/base_scan",
    map_file="drl-ship-interior-gazebo/ship_interior_10mm.yaml",
    octomap="drl-ship-interior-gazebo/ship_interior_20mm.bt",
    map_frame="map_ground_truth",
    odometry=("/guardian/odom",),
    arrival_rate=0.02,
    mean_life_s=8.0,
)
CASES = (
    Case("sample", "sample", scan="/scan", arrival_rate=0.01, mean_life_s=8.0),
    Case(
        name="tb3",
        bag="fuse-tb3-gazebo/turtlebot3.bag",
        scan="/scan",
        map_file="nav2-maps/tb3_sandbox.yaml",
        static=("0 0 0 0 0 0 map odom", "-0.032 0 0.172 0 0 0 base_footprint base_scan"),
        odometry=("/odom",),
        arrival_rate=0.04,
    ),
    HALL,
    replace(HALL, name="jarvis-complex-high", scan=HIGH),
    replace(HALL, name="jarvis-circle-low", bag=f"{CIRCLE}.bag"),
    replace(
        HALL,
        name="jarvis-inverted-low",
        bag=f"{CIRCLE}__HEAD_odom_to_map.bag",
        static=("-14.415988856826079 -3.88959705880523 0 0.04 0 0 map pgm",),
    ),
    replace(
        HALL,
        name="jarvis-2-low",
        bag="drl-jarvis-hall/jarvis_2.bag",
        static=("14.37 3.33 0 -0.045 0 0 pgm map",),
    ),
    SHIP,
    replace(SHIP, name="ship-grid", octomap=""),
    replace(SHIP, name="ship-tilt", scan="/tilt_scan"),
    Case("tum-desk", "tum-desk-rgbd/tum-desk-rgbd.mcap", arrival_rate=0.2, mean_life_s=2.0),
    Case("redwood", "redwood-rgbd/redwood-rgbd.mcap", arrival_rate=0.2, mean_life_s=2.0),
)
WHOLE = "as-is"
"""Of this all rates and shapes are run, over the whole recording; of the others two each."""
LATER = ((0.0, 1000.0),)
"""One recording begins at 0, and no stamp may be negative: all of it is moved on."""
SHIFTS_S = (-12.0, -7.6, -3.0, -0.8, 0.8, 3.0, 7.6, 12.0)
VARIANTS = {
    WHOLE: Changes(),
    "infinite": Changes(infinite=0.3),
    **{f"shift{s:+g}": Changes(shift_s=s, infinite=0.15, gaps=LATER) for s in SHIFTS_S},
    **{
        f"late{round(1e3 * late)}": Changes(late_s=late, jitter_s=0.03, infinite=0.15)
        for late in (0.1, 0.25, 0.4)
    },
    "late0-400": Changes(late_s=0.0, jitter_s=0.4, infinite=0.15),
    "shift+7.6-late250": Changes(shift_s=7.6, late_s=0.25, jitter_s=0.03, infinite=0.15),
    "shift-3-late400": Changes(shift_s=-3.0, late_s=0.4, jitter_s=0.03, infinite=0.15, gaps=LATER),
    "gap": Changes(gaps=((7.0, 300.0),), infinite=0.15),
}
RATES, SHAPES = (20, 5, 10), ("box", "mesh")


@dataclass(frozen=True)
class Run:
    """One line of the table."""

    case: Case
    variant: str
    rate_hz: int
    shape: str
    duration_s: float | None

    @property
    def key(self) -> str:
        """The name of the line."""
        return f"{self.case.name} {self.variant} {self.rate_hz} {self.shape}"


def matrix(duration_s: float) -> Iterator[Run]:
    """Yield all runs, those first of which each recording and each variant has one."""
    pairs = [(rate, shape) for rate in RATES for shape in SHAPES]
    for turn in range(len(pairs)):
        for v, variant in enumerate(VARIANTS):
            for c, case in enumerate(CASES):
                if (turn > 1 and variant != WHOLE) or (not case.scan and variant != WHOLE):
                    continue
                shift = turn if variant == WHOLE else v + c + 3 * turn
                rate, shape = pairs[shift % len(pairs)]
                length = None if variant in {WHOLE, "gap"} else duration_s
                yield Run(case, variant, rate, shape, length)


class Bench:
    """Runs `are` of a checkout on recordings in a folder of work, and judges what it writes."""

    def __init__(self, code: Path, data: Path, work: Path, seed: int, extra: list[str]) -> None:
        self.code, self.data, self.work, self.seed, self.extra = code, data, work, seed, extra
        work.mkdir(parents=True, exist_ok=True)
        self.meshes = self._meshes()
        self.inputs = lru_cache(maxsize=2)(self._inputs)
        self.truth = lru_cache(maxsize=2)(self._truth)
        self.lattice = lru_cache(maxsize=None)(self._lattice)

    def done(self, run: Run) -> dict[str, Any]:
        """Do one run and return its line."""
        out = self.work / "run"
        shutil.rmtree(out, ignore_errors=True)
        line: dict[str, Any] = {"key": run.key, "wrong": {}, "counts": {}, "examples": {}}
        words = ["--set", f"builder.tick_rate:={run.rate_hz}"]
        words += ["--set", f"sensors.shape:={run.shape}", "--with-inputs"]
        begun = time.monotonic()
        status, said = self._replay(run, words, out)
        if status not in {0, 3}:
            return line | {"check": f"replay ended with {status}", "said": said[-600:]}
        metrics = json.loads((out / "metrics.json").read_text())
        timing = json.loads((out / "timing.json").read_text())
        ways: Counter[str] = Counter()
        for counts in metrics["scans"].values():
            ways.update(counts)
        line |= {"speed": timing["real_time_factor"], "ways": dict(ways), "said": said[-1500:]}
        status, said = self.are("check", str(out))
        failed = [
            row for row in said.splitlines() if ": passed" not in row and "skipped" not in row
        ]
        line["check"] = "passed" if status == 0 else " | ".join(failed)[:600]
        replay_s = time.monotonic() - begun
        if run.case.scan:
            verdict = self._judged(run, out)
            line |= {"counts": dict(verdict.counts), "wrong": verdict.wrong()}
            line |= {"examples": verdict.examples, "ends_m": _spread(verdict)}
        line["seconds"] = [round(replay_s, 1), round(time.monotonic() - begun - replay_s, 1)]
        return line

    def recording(self, case: Case, variant: str) -> Path:
        """Return the changed recording, which is made when it is asked for the first time."""
        sample = ROOT / "bags" / "sample_office.mcap"
        source = sample if case.bag == "sample" else self.data / case.bag
        if VARIANTS[variant] == Changes():
            return source
        folder = self.work.parent / "recordings" / f"{source.stem}-{variant}"
        if not (folder / "metadata.yaml").exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.parent.mkdir(parents=True, exist_ok=True)
            change_recording(source, folder, VARIANTS[variant])
        return folder

    def _judged(self, run: Run, out: Path) -> Verdict:
        inputs = self.inputs(run.case, run.variant, run.duration_s)
        return judge(
            inputs.scans[run.case.scan],
            read_outputs(out / "augmented.mcap"),
            self.truth(run.case, run.variant, run.duration_s),
            inputs.frames,
            run.case.map_frame,
            self.lattice(run.case),
            self.meshes if run.shape == "mesh" else None,
        )

    def _inputs(self, case: Case, variant: str, duration_s: float | None) -> Inputs:
        recording = self.recording(case, variant)
        return read_inputs(recording, case.static, case.odometry, duration_s=duration_s)

    def _truth(self, case: Case, variant: str, duration_s: float | None) -> Outputs:
        """Return the truth at every sub-step: a run of the same recording at 20 Hz."""
        out = self.work / "truth"
        shutil.rmtree(out, ignore_errors=True)
        run = Run(case, variant, 20, "box", duration_s)
        skipped = [word for part in ("perception", "grids", "markers") for word in ("--skip", part)]
        status, said = self._replay(run, ["--set", "builder.tick_rate:=20", *skipped], out)
        if status not in {0, 3}:
            raise RuntimeError(said)
        return read_outputs(out / "augmented.mcap")

    def _lattice(self, case: Case) -> lattices.Lattice:
        if case.octomap:
            return lattices.of_octomap_file(self.data / case.octomap)
        if case.map_file:
            return lattices.of_map_file(self.data / case.map_file)
        inputs = self.inputs(case, WHOLE, None)
        return lattices.of_cloud(inputs.cloud) if inputs.cloud else lattices.of_grid(inputs.grid)

    def _meshes(self) -> dict[int, Any]:
        path = self.work / "meshes.npz"
        subprocess.run(
            [*self._python(), "-c", EXPORT, str(path)], check=True, env=self._env(), cwd=self.work
        )
        with np.load(path) as stored:
            return {int(row): stored[row] for row in stored}

    def _replay(self, run: Run, words: Sequence[str], out: Path) -> tuple[int, str]:
        bag = self.recording(run.case, run.variant)
        length = [] if run.duration_s is None else ["--duration", str(run.duration_s)]
        seed = ["--seed", str(self.seed), "--out", str(out)]
        options = [*run.case.words(self.data), *words, *length, *self.extra, *seed]
        return self.are("replay", str(bag), *options)

    def are(self, *words: str) -> tuple[int, str]:
        """Run the command in a process of its own; return its status and what it says."""
        done = subprocess.run(
            [*self._python(), "-m", "are_ros", *words],
            check=False,
            env=self._env(),
            cwd=self.work,
            capture_output=True,
            text=True,
        )
        return done.returncode, done.stdout + done.stderr

    def _python(self) -> list[str]:
        own = self.code / ".venv" / "bin" / "python"
        return [str(own) if own.exists() else sys.executable]

    def _env(self) -> dict[str, str]:
        return os.environ | {"PYTHONPATH": str(self.code)}


def _spread(verdict: Verdict) -> list[float]:
    """Return the median, the 99th percentile and the worst of the ends' errors [m]."""
    errors = np.concatenate([*verdict.errors_m, np.zeros(1)])
    ordered = np.sort(errors)
    return [float(ordered[int(share * (len(ordered) - 1))]) for share in (0.5, 0.99, 1.0)]


HEADS = ("ghost", "through", "wall", "missing")


def row(line: dict[str, Any]) -> str:
    """Return a line of the table."""
    counts, wrong = line["counts"], line["wrong"]
    ways = line.get("ways", {})
    left = "/".join(str(ways.get(name, 0)) for name in ("exact", "held", "passed_through"))
    others = {kind: n for kind, n in wrong.items() if kind not in HEADS}
    numbers = " ".join(f"{counts.get(kind, 0):7d}" for kind in ("beams", "changed", *HEADS))
    text = f"{line['key']:42s} {numbers} {left:>11s} {line.get('speed', 0.0):6.1f}x"
    return f"{text}  {line['check'][:60]} {others or ''}"


def is_wrong(line: dict[str, Any]) -> bool:
    """Return whether anything is wrong in a line."""
    return bool(line["wrong"]) or line["check"] != "passed"


def report(lines: Sequence[dict[str, Any]]) -> None:
    """Print the table and the totals."""
    names = " ".join(f"{kind:>7s}" for kind in ("beams", "changed", *HEADS))
    print(f"{'recording variant Hz shape':42s} {names} {'ex/held/out':>11s}   speed  check, others")
    for line in sorted(lines, key=lambda one: str(one["key"])):
        print(row(line))
    total: Counter[str] = Counter()
    for line in lines:
        total.update(line["counts"])
    wrong: Counter[str] = Counter()
    for line in lines:
        wrong.update(line["wrong"])
    failed = sum(line["check"] != "passed" for line in lines)
    print(f"\n{len(lines)} runs, {total['scans']} scans, {total['beams']} beams")
    print(
        f"{total['changed']} changed, of them {total['changed without a return']} without a return"
    )
    print(f"checks that failed: {failed}; wrong: {dict(wrong) or 'nothing'}")
    print(f"scans not judged: {total['scans not judged']}; bare scans: {total['bare scans']}")


def options() -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--work", type=Path, default=ROOT / "out" / "judged")
    parser.add_argument("--code", type=Path, default=ROOT)
    parser.add_argument("--select", default="", help="regular expression on the names of runs")
    parser.add_argument(
        "--keys", type=Path, help="a file of names of runs, in the order to do them"
    )
    parser.add_argument("--duration", type=float, default=15.0, help="of the made recordings [s]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], help="for are replay; repeatable")
    parser.add_argument("--minutes", type=float, default=1e9, help="begin no run after these")
    parser.add_argument("--list", action="store_true", help="print the names of the runs")
    parser.add_argument("--table", action="store_true", help="print the table of what is done")
    return parser.parse_args()


def main() -> None:
    """Do what is not done yet, and print the table."""
    given = options()
    runs = [run for run in matrix(given.duration) if re.search(given.select, run.key)]
    if given.keys:
        named = {run.key: run for run in runs}
        runs = [named[key] for key in given.keys.read_text().splitlines() if key in named]
    if given.list:
        print(*(run.key for run in runs), sep="\n")
        return
    results = given.work / "results.jsonl"
    lines = (
        [json.loads(text) for text in results.read_text().splitlines()] if results.exists() else []
    )
    known = {line["key"] for line in lines}
    todo = [] if given.table else [run for run in runs if run.key not in known]
    if todo:
        extra = [word for one in given.set for word in ("--set", one)]
        bench = Bench(
            given.code.resolve(), given.data.resolve(), given.work.resolve(), given.seed, extra
        )
        begun = time.monotonic()
        for number, run in enumerate(todo, 1):
            if time.monotonic() - begun > 60 * given.minutes:
                break
            line = bench.done(run)
            lines.append(line)
            with results.open("a") as file:
                file.write(json.dumps(line) + "\n")
            print(f"{number}/{len(todo)} {row(line)}", flush=True)
    report([line for line in lines if re.search(given.select, line["key"])])
    sys.exit(any(map(is_wrong, lines)))


if __name__ == "__main__":
    main()
