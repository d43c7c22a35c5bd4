"""Whether a robot stands where its map lets it."""

import math
import re
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.builder.sensors.sensor_path import ReleasedReading
from are_ros.parameters.choices import Region
from are_ros.parameters.model import PopulationParameters, WorldParameters
from are_ros.replay.listeners import ScanFit, StandingWatch
from are_ros.world.environment import PlaneGround
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.scan_matching import PlanarPose

RunAre = Callable[..., CompletedProcess[str]]

QUESTION = "does the map belong to the recording, and is its frame right?"


def environment(cells: list[int]) -> Any:
    """Return cells of a metre in a row from (0, 0)."""
    grid = OccupancyGrid(np.array([cells], np.int8), 1.0, RigidTransform.identity(), "map")
    return SimpleNamespace(grid=grid, classes=classify(grid, 65, 25), ground=PlaneGround(0.5))


def watched(
    maps: list[Any],
    places: list[float | None],
    *,
    area_m2: float,
    region: Region,
    z_m: float = 0.5,
) -> list[str]:
    """Return what is said of a robot at (x, 0.5), in one tick with each map."""
    world = SimpleNamespace(environment=None)
    population = PopulationParameters(region=region)
    parameters = SimpleNamespace(population=population, world=WorldParameters())
    builder: Any = SimpleNamespace(world=world, parameters=parameters)
    watch = StandingWatch(builder)
    for world.environment, x_m in zip(maps, places, strict=True):
        pose = None if x_m is None else RigidTransform.planar(x_m, 0.5, 0.0, z=z_m)
        tick: Any = SimpleNamespace(map_from_base=pose, metrics=SimpleNamespace(area_m2=area_m2))
        watch.take_tick(tick)
    return watch.sentences()


ROW = environment([0, 0, 100, -1])


@pytest.mark.parametrize(
    ("places", "said"),
    [
        ([0.5] * 9 + [2.5], ""),
        ([0.5] * 8 + [2.5, 3.5], "in 2 of 10 ticks"),
        ([9.0] * 3, "in 3 of 3 ticks"),
        ([None, 0.5, 1.5], ""),
        ([None, None], ""),
    ],
)
def test_a_robot_in_walls_or_beyond_the_map_is_said(places: list[float | None], said: str) -> None:
    """Where it is not there for a moment only; ticks without its pose do not count."""
    sentences = watched([ROW] * len(places), places, area_m2=50.0, region=Region.REACHABLE)
    assert len(sentences) == bool(said)
    for sentence in sentences:
        assert sentence.endswith(f"or beyond the map, {said}: {QUESTION}")


@pytest.mark.parametrize(("z_m", "said"), [(3.5, "3.0"), (-1.5, "-2.0"), (1.9, ""), (-0.9, "")])
def test_a_robot_far_above_or_below_the_ground_is_said(z_m: float, said: str) -> None:
    """As on another floor; lasers of a robot in the air see no artefact, and nothing else tells."""
    sentences = watched([ROW] * 3, [0.5] * 3, area_m2=50.0, region=Region.FREE, z_m=z_m)
    assert len(sentences) == bool(said)
    for sentence in sentences:
        assert sentence == (
            f"the robot's base was {said} m above the ground on which artefacts stand "
            f"(world.ground_height) in 3 of 3 ticks: {QUESTION}"
        )


def test_cells_that_come_to_be_known_are_no_fault() -> None:
    """A map that is being made is judged by its end; one that is changed, by both."""
    unknown, free = environment([-1, -1]), environment([0, 0])
    for maps in ([unknown] * 9 + [free], [free] * 9 + [unknown]):
        assert watched(maps, [0.5] * 10, area_m2=50.0, region=Region.FREE) == []
    assert watched([unknown] * 6, [0.5] * 6, area_m2=50.0, region=Region.FREE) != []


def test_a_region_of_next_to_nothing_is_said() -> None:
    """Where it is the one that the robot can reach."""
    for region, area_m2, count in (
        (Region.REACHABLE, 1.16, 1),
        (Region.REACHABLE, 19.7, 0),
        (Region.ZONES, 1.16, 0),
    ):
        sentences = watched([ROW], [0.5], area_m2=area_m2, region=region)
        assert len(sentences) == count
        for sentence in sentences:
            reach = "the robot can reach 1.2 m^2 of the map at most"
            assert sentence == f"{reach}: {QUESTION}"


def test_cells_between_the_thresholds_are_the_reason() -> None:
    """A map of probabilities, of which the usual threshold takes few as free."""
    row = environment([10, 30, 45, 100])
    (sentence,) = watched([row], [1.5], area_m2=0.5, region=Region.REACHABLE)
    assert "? 50.0 % of its known cells are neither free, up to world.free_thr" in sentence


def fitted(
    at: PlanarPose, *, tilt_rad: float = 0.0, scans: int = 20, occupied: int = 100
) -> list[str]:
    """Return what is said of scans of a room on a map of it, from whose frame theirs differs."""
    room = np.zeros((120, 160), np.int8)
    room[[0, -1]] = 100
    room[:, [0, -1]] = 100
    room[40:44, 90:110] = 100
    cells = np.minimum(room, occupied).astype(np.int8)
    grid = OccupancyGrid(cells, 0.05, RigidTransform.identity(), "map")
    place = SimpleNamespace(grid=grid, classes=classify(grid, 65, 25))
    step_rad, ways_m = math.radians(2.0), np.arange(0.0, 12.0, 0.01)[:, np.newaxis]
    angles = np.arange(180) * step_rad
    cols = ((3.0 + ways_m * np.cos(angles)) / 0.05).astype(int).clip(0, 159)
    rows = ((3.0 + ways_m * np.sin(angles)) / 0.05).astype(int).clip(0, 119)
    ranges = 0.01 * (room[rows, cols] == 100).argmax(axis=0).astype(np.float32)
    laser = RigidTransform.from_xyz_ypr(3.0, 3.0, 0.0, 0.0, tilt_rad, 0.0)
    pose = RigidTransform.planar(*at) @ laser
    builder: Any = SimpleNamespace(
        world=SimpleNamespace(environment=place),
        parameters=SimpleNamespace(frames=SimpleNamespace(map="map")),
        frames=SimpleNamespace(try_lookup=lambda *_: pose),
    )
    fit, none = ScanFit(builder), np.empty(0, np.float32)
    for k in range(scans):
        stamp_ns = k * 10**9
        scan = LaserScan("laser", stamp_ns, 0.0, 6.25, step_rad, 0.0, 0.1, 0.05, 12.0, ranges, none)
        fit.take([ReleasedReading("/scan", scan, stamp_ns, is_augmented=False)])
    return fit.doubts()


@pytest.mark.parametrize(
    ("at", "is_said"),
    [
        (PlanarPose(0.0, 0.0, 0.0), False),
        (PlanarPose(0.05, -0.05, 0.005), False),
        (PlanarPose(1.0, -2.0, 0.5), True),
        (PlanarPose(90.0, 0.0, 0.0), False),
    ],
)
def test_scans_that_end_anywhere_but_at_walls_are_said(at: PlanarPose, is_said: bool) -> None:
    """The map lies elsewhere than the frames of the recording say; centimetres do not matter.

    Of what ends beyond the map nothing is said: a map may be of a part of a place.
    """
    said = fitted(at)
    assert len(said) == is_said
    for doubt in said:
        assert re.fullmatch(
            r"only \S+ % of what the scans measured on the map is where .* walls", doubt
        )


def test_a_tilted_laser_and_few_scans_tell_nothing_of_a_map() -> None:
    """It sees floor and ceiling; and what was seen once may have been anything."""
    wrong = PlanarPose(1.0, -2.0, 0.5)
    assert fitted(wrong, tilt_rad=0.3) == []
    assert fitted(wrong, scans=2) == []
    assert fitted(wrong, occupied=0) == []


def test_a_replay_says_it_of_a_wrong_frame(
    sample_bag: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """And nothing of the kind of the recording with its own."""
    words = ("replay", sample_bag, "--duration", "2", "--skip", "grids", "--skip", "markers")
    wrong = ("--static-tf", "0 0 0 0 0 0 base_footprint map")
    good = run_are(*words, "--out", tmp_path / "a")
    bad = run_are(*words, *wrong, "--out", tmp_path / "b")
    assert (good.returncode, bad.returncode) == (0, 0)
    assert QUESTION not in good.stderr
    assert bad.stderr.splitlines()[-1].endswith(QUESTION)
    assert "the robot can reach 0.0 m^2 of the map at most: " in bad.stderr


def test_ground_where_nobody_may_arrive_is_named(
    sample_bag: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """Where no_spawn leaves nothing, it is not the map alone that is in doubt."""
    zones = tmp_path / "zones.yaml"
    zones.write_text("no_spawn: [[[-90, -90], [90, -90], [90, 90], [-90, 90]]]\n")
    words = ("replay", sample_bag, "--duration", "2", "--skip", "grids", "--skip", "markers")
    done = run_are(*words, "--set", f"population.zones:={zones}", "--out", tmp_path / "a")
    assert done.returncode == 0
    assert "0.0 m^2 of the map at most, without no_spawn of population.zones: " in done.stderr
