"""Replays of real recordings: the commands of the README, in part here, whole in the long tests."""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import pytest

from are_ros.bag.reader import BagReader
from are_ros.world.rigid_transform import RigidTransform

RunAre = Callable[..., CompletedProcess[str]]

BAGS = Path(__file__).resolve().parents[2] / "bags"
JARVIS = "drl-jarvis-hall/"
HALL = (
    ("--map", Path(JARVIS + "i-108_10mm.yaml")),
    ("--map-frame", "pgm"),
    ("--static-tf", "14.56 3.31 0 -0.04 0 0 pgm map"),
    ("--topic", "scan:=/driver_laser_navigation/laser_scan"),
)
SHIP = "drl-ship-interior-gazebo/"


@dataclass(frozen=True)
class Recording:
    """A recording with what it lacks; paths are relative to the data's folder."""

    bag: str
    options: tuple[tuple[str, str | Path], ...]
    arrival_rate: float
    mean_life_s: float

    def words(self, data: Path) -> list[str]:
        """Return the words of the command line after `are replay`."""
        values = (
            (option, str(data / value) if isinstance(value, Path) else value)
            for option, value in self.options
        )
        population = {"arrival_rate": self.arrival_rate, "mean_life": self.mean_life_s}
        assignments = (("--set", f"population.{name}:={x}") for name, x in population.items())
        options = [word for pair in (*values, *assignments) for word in pair]
        return [str(data / self.bag), *options, "--with-inputs"]


RECORDINGS = {
    "jarvis": Recording(JARVIS + "jarvis_complex_path_fast.bag", HALL, 0.002, 30.0),
    "tb3": Recording(
        "fuse-tb3-gazebo/turtlebot3.bag",
        (
            ("--map", Path("nav2-maps/tb3_sandbox.yaml")),
            ("--static-tf", "0 0 0 0 0 0 map odom"),
            ("--static-tf", "-0.032 0 0.172 0 0 0 base_footprint base_scan"),
        ),
        0.008,
        30.0,
    ),
    "ship": Recording(
        SHIP + "ship_interior_with_tilting_laser.bag",
        (
            ("--map", Path(SHIP + "ship_interior_10mm.yaml")),
            ("--octomap", Path(SHIP + "ship_interior_20mm.bt")),
            ("--map-frame", "map_ground_truth"),
            ("--topic", "scan:=/base_scan"),
            ("--topic", "odom:=/guardian/odom"),
        ),
        0.01,
        15.0,
    ),
}


def replayed(run_are: RunAre, words: list[str], out: Path) -> Any:
    """Run a replay and return its metrics; its folder must hold every result."""
    done = run_are("replay", *words, "--out", out)
    assert done.returncode == 0, done.stderr
    names = {"augmented.mcap", "metrics.json", "timing.json", "effective.yaml", "overview.png"}
    assert {file.name for file in out.iterdir()} == names | {"view.html"}
    assert "does the map belong to the recording" not in done.stderr
    return json.loads((out / "metrics.json").read_text())


def assert_checked(run_are: RunAre, out: Path) -> None:
    """Assert that every invariant holds, and that those of map, robot and scan were looked at."""
    done = run_are("check", out)
    assert done.returncode == 0, done.stdout
    passed = {line.split(":")[0] for line in done.stdout.splitlines() if ": passed" in line}
    needed = {"walls", "overlaps of artefacts", "overlaps with the robot", "augmented map"}
    assert passed >= needed | {"costmap", "scans", "lives", "perceived", "markers of the living"}


@pytest.mark.parametrize("name", ["jarvis", "tb3"])
def test_the_beginning_of_a_real_recording(
    real_data: Path, run_are: RunAre, tmp_path: Path, name: str
) -> None:
    """Fifteen seconds among more artefacts: they come, are perceived, leave; all checks pass."""
    words = [*RECORDINGS[name].words(real_data), "--duration", "15"]
    busy = ["--set", "population.mean_life:=8", "--set", "population.arrival_rate:=0.012"]
    metrics = replayed(run_are, [*words, *busy], tmp_path)
    assert metrics["arrivals"] >= 3
    assert metrics["departures"] >= 1
    assert metrics["perceived_ever"] >= 1
    assert metrics["refused"] == {}
    assert_checked(run_are, tmp_path)


def test_a_map_without_its_frame_is_doubted(
    real_data: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """The first mistake with a map beside the recording: its frame is taken for the robot's."""
    words = (
        real_data / (JARVIS + "jarvis_2.bag"),
        "--map",
        real_data / (JARVIS + "i-108_10mm.yaml"),
        *("--topic", "scan:=/driver_laser_security/laser_scan"),
    )
    done = run_are("replay", *words, "--duration", "5", "--skip", "grids", "--out", tmp_path)
    assert done.returncode == 0
    doubt = done.stderr.splitlines()[-1]
    assert "the robot stood on occupied or unknown cells" in doubt
    assert "the robot can reach 1.2 m^2 of the map at most" in doubt
    assert doubt.endswith("does the map belong to the recording, and is its frame right?")


@pytest.mark.long
@pytest.mark.parametrize("name", RECORDINGS)
def test_a_whole_real_recording(
    real_data: Path,
    run_are: RunAre,
    tmp_path: Path,
    name: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The command of the README runs to the end, and the invariants hold over all of it."""
    words = RECORDINGS[name].words(real_data)
    metrics = replayed(run_are, words, tmp_path)
    with BagReader([real_data / RECORDINGS[name].bag]) as reader:
        length_s = 1e-9 * (reader.end_ns - reader.start_ns)
    assert length_s - metrics["duration_s"] < 0.2
    assert metrics["arrivals"] >= 4
    assert metrics["departures"] >= 2
    assert 2 <= metrics["perceived_ever"] <= metrics["arrivals"]
    assert metrics["alive"]["max"] <= 20
    if name != "jarvis":
        assert metrics["perceived_ever"] < metrics["arrivals"], "walls hide some"
    assert_checked(run_are, tmp_path)
    replay_s = json.loads((tmp_path / "timing.json").read_text())["phases_s"]["replay"]
    with capsys.disabled():
        print(f"\n{name}: {length_s:.0f} s in {replay_s:.1f} s")  # noqa: T201 - a figure to read


@pytest.mark.long
@pytest.mark.parametrize("shape", ["box", "mesh"])
def test_the_whole_sample(run_are: RunAre, tmp_path: Path, shape: str) -> None:
    """The README's first commands: the whole drive, and all that is checked, images too."""
    params, options = BAGS / "sample_office.yaml", ("--set", f"sensors.shape:={shape}")
    words = (BAGS / "sample_office.mcap", "--params", params, "--with-inputs", *options)
    assert run_are("replay", *words, "--out", tmp_path).returncode == 0
    assert_checked(run_are, tmp_path)
    assert "depth images computed anew: passed" in run_are("check", tmp_path).stdout


def test_an_edge_stored_the_other_way_round_is_the_same(
    real_data: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """One drive recorded with map -> odom and with odom -> map: the same lives and sightings.

    In the second the map's frame is a child already, so that the file's hangs below it, by the
    inverse transform; what differs is rounding.
    """
    inverse = RigidTransform.from_xyz_ypr(14.56, 3.31, 0.0, -0.04, 0.0, 0.0).inverse()
    x, y, z = inverse.translation_m.tolist()
    below = f"{x!r} {y!r} {z!r} {inverse.yaw_rad()!r} 0 0 map pgm"
    found = []
    for suffix, static in (("", HALL[2][1]), ("__HEAD_odom_to_map", below)):
        bag = f"{JARVIS}jarvis_circular_path_fast{suffix}.bag"
        recording = Recording(bag, (*HALL[:2], ("--static-tf", static), HALL[3]), 0.01, 8.0)
        metrics = replayed(run_are, recording.words(real_data), tmp_path / f"out{suffix}")
        assert metrics["ticks_without_perception"] <= 3
        seen = ("ticks", "arrivals", "departures", "perceived_ever", "perceived", "lives")
        found.append({name: metrics[name] for name in seen})
    assert found[0]["perceived_ever"] >= 2
    assert found[0] == found[1]


def test_no_path_of_the_machine_is_written(
    real_data: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """Neither the data's folder nor the output's stands in a reproducible file."""
    words = [*RECORDINGS["tb3"].words(real_data), "--duration", "2"]
    replayed(run_are, words, tmp_path)
    for name in ("metrics.json", "effective.yaml", "augmented.mcap"):
        content = (tmp_path / name).read_bytes()
        assert os.fsencode(real_data) not in content
        assert os.fsencode(tmp_path) not in content
