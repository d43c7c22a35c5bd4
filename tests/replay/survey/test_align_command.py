"""`are align`: small recordings, the sample turned and shifted, and real ones."""

import math
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageOps

from are_ros.bag.reader import BagReader
from are_ros.bag.roles import find_roles
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.errors import BagError
from are_ros.messages.transforms import StampedTransform
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.replay.survey.align import (
    AlignInput,
    PlacedScan,
    _longest_drive,
    gather,
    map_of,
)
from are_ros.replay.timeline import ReplayOptions
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.scan_matching import PlanarPose, ScanCloud, ScanMatcher, wrapped
from bags.simulation.making import (
    OdometryReading,
    RosbagsFactory,
    make_grid,
    make_odometry,
    make_scan,
    make_transforms,
)

RunAre = Callable[..., CompletedProcess[str]]
WriteBag = Callable[[Path, list[tuple[str, int, Any]]], Path]
S = 1_000_000_000
ROLLED = (1.0, 0.0, 0.0, 0.0)
"""Half a turn about x: a laser that hangs upside down."""
LEVEL = (0.0, 0.0, 0.0, 1.0)


def line_of(done: CompletedProcess[str]) -> tuple[PlanarPose, str]:
    """Return pose and frames of the first line that `are align` printed."""
    found = re.search(
        r'^--static-tf "(\S+) (\S+) 0 (\S+) 0 0 (\S+ \S+)"$', done.stdout, re.MULTILINE
    )
    assert found, done.stdout + done.stderr
    x, y, yaw, frames = found.groups()
    return PlanarPose(float(x), float(y), float(yaw)), frames


def assert_near(pose: PlanarPose, x_m: float, y_m: float, yaw_rad: float) -> None:
    """Assert a distance of less than 5 cm and 1 degree."""
    assert math.hypot(pose.x_m - x_m, pose.y_m - y_m) < 0.05
    assert abs(wrapped(pose.yaw_rad - yaw_rad)) < math.radians(1.0)


def room() -> OccupancyGrid:
    """Return a room of 4 x 3 m in cells of 5 cm, with a cupboard; its corner is the origin."""
    cells = np.zeros((60, 80), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    cells[40:60, 10:22] = 100
    return OccupancyGrid(cells, 0.05, RigidTransform.identity(), "map")


def scan_of(grid: OccupancyGrid, at: PlanarPose, stamp_ns: int, *, hangs: bool) -> LaserScan:
    """Return what a laser sees; one that hangs counts its beams the other way round."""
    angles = np.arange(360) * math.radians(1.0) - math.pi
    steps = np.arange(0.0, 6.0, 0.01)
    ranges = np.full(360, np.inf, np.float32)
    for k, angle in enumerate(angles):
        heading = at.yaw_rad + (-angle if hangs else angle)
        way = np.outer(steps, (math.cos(heading), math.sin(heading))) + at[:2]
        cells = grid.points_to_cells(way)
        inside = grid.contains(cells)
        hits = np.flatnonzero(grid.cells[tuple(cells[inside].T)] == 100)
        if len(hits) and k % 9:
            ranges[k] = steps[hits[0]]
    ranges[1::50] = np.nan
    return LaserScan(
        "laser", stamp_ns, -math.pi, float(angles[-1]), math.radians(1.0), 0.0, 0.1, 0.05, 8.0,
        ranges, np.empty(0, np.float32),
    )  # fmt: skip


def transform(parent: str, child: str, stamp_ns: int, pose: PlanarPose, turn: Any) -> Any:
    """Return a stamped transform of a planar pose, or of a place and any rotation."""
    place = (pose.x_m, pose.y_m, 0.2)
    planar = RigidTransform.planar(*pose).rotation_xyzw.tolist()
    return StampedTransform(parent, child, stamp_ns, place, turn or tuple(planar))


@pytest.fixture
def small_bag(tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag) -> Callable[..., Path]:
    """Return a writer of a recording of a drive through the room, odom at (2, 1, 0.5) in it."""

    def write(mount: Any = LEVEL, *, is_turned: bool = False, malformed: int = 0) -> Path:
        records: list[tuple[str, int, Any]] = [("/map", 0, make_grid(factory, room()))]
        mounted = transform("base", "laser", 0, PlanarPose(0.0, 0.0, 0.0), mount)
        records.append(("/tf_static", 0, make_transforms(factory, [mounted])))
        map_from_odom = PlanarPose(2.0, 1.0, 0.5)
        for k in range(11):
            at = PlanarPose(1.0 + 0.2 * k, 0.8 + 0.05 * k, 0.1 * k)
            pose = map_from_odom.inverse().after(at)
            moved = transform("odom", "base", k * S, pose, None)
            if is_turned:
                there = RigidTransform.checked(moved.translation_m, moved.rotation_xyzw)
                still = (0.0, 0.0, 0.0)
                odometry = OdometryReading("odom", "base", k * S, there, still, still)
                records.append(("/odom", k * S + 1, make_odometry(factory, odometry)))
                back = there.inverse()
                place, turn = back.translation_m.tolist(), back.rotation_xyzw.tolist()
                moved = StampedTransform("base", "odom", k * S, tuple(place), tuple(turn))
            records.append(("/tf", k * S, make_transforms(factory, [moved])))
            scan = scan_of(room(), at, k * S, hangs=mount == ROLLED)
            scan = replace(scan, frame_id="" if k < malformed else scan.frame_id)
            records.append(("/scan", k * S + S // 10, make_scan(factory, scan)))
        return write_bag(tmp_path / "bag.mcap", records)

    return write


@pytest.mark.parametrize("mount", [LEVEL, ROLLED])
def test_map_to_odom_is_printed_ready_to_paste(
    run_are: RunAre, small_bag: Callable[..., Path], tmp_path: Path, mount: Any
) -> None:
    """The map of the recording, a laser either way up: line, share and picture."""
    bag, picture = small_bag(mount), tmp_path / "pictures" / "align.png"
    done = run_are("align", bag, "--out", picture)
    assert done.returncode == 0, done.stdout + done.stderr
    pose, frames = line_of(done)
    assert frames == "map odom"
    assert_near(pose, 2.0, 1.0, 0.5)
    assert re.search(r"fit +(9\d|100)% of 2,\d\d\d endpoints within 0.1 m", done.stdout)
    assert re.search(r"scans +[78] scans of /scan, over \d+ s and [12]", done.stdout)
    assert picture.read_bytes().startswith(b"\x89PNG")
    option = done.stdout.splitlines()[0].split('"')[1]
    again = run_are("align", bag, "--static-tf", option, "--out", picture)
    assert again.returncode == 1
    assert "hang together already" in again.stderr


def test_the_first_scans_may_be_malformed(
    run_are: RunAre, small_bag: Callable[..., Path], tmp_path: Path
) -> None:
    """They are left out, with a sentence; where all are, that is the error."""
    picture = ("--out", tmp_path / "align.png")
    done = run_are("align", small_bag(malformed=2), *picture)
    assert done.returncode == 0, done.stdout + done.stderr
    assert_near(line_of(done)[0], 2.0, 1.0, 0.5)
    assert "2 of 11 scans are refused (/scan: header.frame_id is empty)" in done.stderr
    shutil.rmtree(tmp_path / "bag")
    done = run_are("align", small_bag(malformed=11), *picture)
    assert done.returncode == 1
    assert "/scan: header.frame_id is empty" in done.stderr


def test_odometry_that_tf_hangs_below_the_robot_takes_the_map(
    run_are: RunAre, small_bag: Callable[..., Path], tmp_path: Path
) -> None:
    """As a legged robot's tf: the top of the tree walks, and the map cannot hang above it."""
    done = run_are("align", small_bag(is_turned=True), "--out", tmp_path / "align.png")
    assert done.returncode == 0, done.stdout + done.stderr
    pose, frames = line_of(done)
    assert frames == "odom map"
    assert_near(pose.inverse(), 2.0, 1.0, 0.5)


def test_a_picture_that_cannot_be_written_is_said_before_the_search(
    run_are: RunAre, tmp_path: Path
) -> None:
    """Before anything is read: the recording is not there, either."""
    (tmp_path / "file").write_text("")
    for name, reason in (
        ("file/align.png", "its folder cannot be made (it is a file)"),
        ("", "it cannot be written (a folder has that name)"),
    ):
        done = run_are("align", tmp_path / "no.mcap", "--out", tmp_path / name)
        assert done.returncode == 1
        assert reason in done.stderr


def test_a_laser_that_is_not_level_is_not_matched(
    run_are: RunAre, small_bag: Callable[..., Path]
) -> None:
    """A tilted plane cuts the walls elsewhere: one sentence, and no line."""
    tilted = (0.0, math.sin(0.2), 0.0, math.cos(0.2))
    done = run_are("align", small_bag(tilted))
    assert done.returncode == 1
    assert "11 of 11 scans are not level" in done.stderr
    assert "--static-tf" not in done.stdout


def test_what_lacks_is_said_with_the_line_that_gives_it(
    run_are: RunAre, small_bag: Callable[..., Path], tmp_path: Path
) -> None:
    """Inspect and replay print the option for map and odom, and name `are align`."""
    bag, base = small_bag(), ("--set", "frames.base:=base")
    replayed = run_are("replay", bag, *base, "--out", tmp_path / "out")
    assert replayed.returncode == 1
    line = '--static-tf "X Y Z YAW PITCH ROLL map odom"'
    assert line in replayed.stderr
    assert "`are align`" in replayed.stderr


def test_nothing_to_match_is_one_sentence(
    run_are: RunAre, sample_bag: Path, tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """A recording that is joined already, and one without scans."""
    joined = run_are("align", sample_bag)
    assert joined.returncode == 1
    assert "map and base_scan hang together already" in joined.stderr
    assert "--map-frame site" in joined.stderr
    bag = write_bag(tmp_path / "bag.mcap", [("/map", 0, make_grid(factory, room()))])
    done = run_are("align", bag)
    assert done.returncode == 1
    assert "the recording has no laser scan" in done.stderr


def gathered(bag: Path, **options: Any) -> tuple[AlignInput, OccupancyGrid]:
    """Return the scans and the map of a recording; the map's frame is another than any in it."""
    parameters = with_values(Parameters(), {"frames.map": "site"})
    replay = ReplayOptions(bags=(bag,), parameters=parameters, **options)
    with BagReader([bag]) as reader:
        roles = find_roles(reader.topics, {})
        grid = map_of(reader, roles, replace(replay, parameters=Parameters()))
        return gather(reader, roles, replay, lambda _: None), grid


@pytest.fixture(scope="module")
def sample_without_map(
    sample_bag: Path, tmp_path_factory: pytest.TempPathFactory, write_bag: WriteBag
) -> Path:
    """Return the sample without map -> odom, and without what nobody needs here."""

    def kept() -> Iterator[tuple[str, int, Any]]:
        with BagReader([sample_bag]) as reader:
            for message in reader.messages(("/map", "/scan", "/odom", "/tf_static")):
                yield message.topic, message.log_time_ns, reader.deserialize(message)

    return write_bag(tmp_path_factory.mktemp("sample") / "bag.mcap", list(kept()))


def map_from_odom(bag: Path, at_ns: int) -> PlanarPose:
    """Return map -> odom so long after the beginning of a recording that has it."""
    with BagReader([bag]) as reader:
        for message in reader.messages(("/tf",), reader.start_ns + at_ns):
            for parent, _, _, place, turn in reader.transforms(message):
                if parent == "map":
                    yaw = RigidTransform.checked(place, turn).yaw_rad()
                    return PlanarPose(place[0], place[1], yaw)
    raise AssertionError


def test_map_to_odom_of_the_sample(
    run_are: RunAre, sample_bag: Path, sample_without_map: Path, tmp_path: Path
) -> None:
    """By odometry alone, while it has not drifted much: as the recording's own localisation."""
    part = ("--duration", 6, "--out", tmp_path / "align.png")
    done = run_are("align", sample_without_map, *part)
    assert done.returncode == 0, done.stdout + done.stderr
    pose, frames = line_of(done)
    assert frames == "map odom"
    assert_near(pose, *map_from_odom(sample_bag, 3 * S))


@pytest.mark.parametrize(("percent", "said"), [(-2, "2% too small"), (0, ""), (2, "2% too large")])
def test_a_resolution_that_is_wrong_is_said(
    run_are: RunAre, sample_bag: Path, tmp_path: Path, percent: int, said: str
) -> None:
    """The map is found all the same, beside its place; where all is right there is no such line."""
    made = sample_bag.with_name("sample_office_map.yaml")
    text = made.read_text(encoding="utf-8").replace("image: ", f"image: {made.parent}/")
    scaled = f"resolution: {0.05 * (1.0 + 0.01 * percent)}"
    (tmp_path / "map.yaml").write_text(text.replace("resolution: 0.05", scaled), encoding="utf-8")
    named = ("--map", tmp_path / "map.yaml", "--map-frame", "site", "--out", tmp_path / "align.png")
    done = run_are("align", sample_bag, *named)
    assert done.returncode == 0, done.stdout + done.stderr
    assert line_of(done)[1] == "site map"
    lines = [line for line in done.stdout.splitlines() if line.startswith("scale")]
    assert len(lines) == bool(said)
    assert not lines or f"the map seems about {said} for the scans" in lines[0]


@pytest.mark.parametrize("times", [3, pytest.param(20, marks=pytest.mark.long)])
def test_the_sample_is_found_turned_and_shifted_at_random(sample_bag: Path, times: int) -> None:
    """Each time another odom frame and another origin of the map: 5 cm, 1 degree, no doubt."""
    given, grid = gathered(sample_bag)
    assert given.root == "map"
    cloud = given.cloud()
    dice = np.random.Generator(np.random.PCG64(11))
    for _ in range(times):
        moved = PlanarPose(*dice.uniform((-50.0, -50.0, -math.pi), (50.0, 50.0, math.pi)).tolist())
        origin = PlanarPose(*dice.uniform((-50.0, -50.0, -math.pi), (50.0, 50.0, math.pi)).tolist())
        ends, origins = moved.apply(cloud.endpoints_m), moved.apply(cloud.origins_m)
        x_m, y_m, _ = grid.origin.translation_m.tolist()
        corner = origin.after(PlanarPose(x_m, y_m, 0.0))
        shifted = OccupancyGrid(
            grid.cells, grid.resolution_m, RigidTransform.planar(*corner), "map"
        )
        matcher = ScanMatcher(shifted, classify(shifted, 65, 20))
        found = matcher.align(ScanCloud(ends, origins, cloud.scans))
        assert found is not None
        assert not found.is_ambiguous
        expected = origin.after(moved.inverse())
        place = origins.mean(axis=0)[np.newaxis]
        apart_m = np.hypot(*(found.best.pose.apply(place) - expected.apply(place))[0])
        assert apart_m < 0.05
        assert abs(wrapped(found.best.pose.yaw_rad - expected.yaw_rad)) < math.radians(1.0)


JARVIS = "drl-jarvis-hall"
REFERENCES = [
    ("jarvis_complex_path_fast", (14.56, 3.31, -0.04)),
    ("jarvis_circular_path_fast", (14.56, 3.31, -0.04)),
    ("jarvis_2", (14.37, 3.33, -0.045)),
]


@pytest.mark.parametrize(
    ("bag", "reference"),
    [*REFERENCES[2:], *(pytest.param(*one, marks=pytest.mark.long) for one in REFERENCES[:2])],
)
def test_the_hall_s_plan_is_found(
    run_are: RunAre,
    real_data: Path,
    tmp_path: Path,
    bag: str,
    reference: tuple[float, float, float],
) -> None:
    """The references are fits, too, of the same scans by another program."""
    words = (
        *("--map", real_data / JARVIS / "i-108_10mm.yaml", "--map-frame", "pgm"),
        *("--topic", "scan:=/driver_laser_navigation/laser_scan", "--out", tmp_path / "a.png"),
    )
    done = run_are("align", real_data / JARVIS / f"{bag}.bag", *words)
    assert done.returncode == 0, done.stdout + done.stderr
    pose, frames = line_of(done)
    assert frames == "pgm map"
    assert_near(pose, *reference)


def test_a_turtlebot_s_map_is_its_odometry_s(
    run_are: RunAre, real_data: Path, tmp_path: Path
) -> None:
    """Odometry as a topic, no tf: the identity."""
    done = run_are(
        *("align", real_data / "fuse-tb3-gazebo" / "turtlebot3.bag"),
        *("--map", real_data / "nav2-maps" / "tb3_sandbox.yaml", "--out", tmp_path / "a.png"),
        *("--static-tf", "-0.032 0 0.172 0 0 0 base_footprint base_scan"),
    )
    assert done.returncode == 0, done.stdout + done.stderr
    pose, frames = line_of(done)
    assert frames == "map odom"
    assert_near(pose, 0.0, 0.0, 0.0)


def test_a_low_laser_in_a_hall_mapped_high_gets_no_line(
    run_are: RunAre, real_data: Path, tmp_path: Path
) -> None:
    """What stands on the floor is not on the plan: no confident wrong line, and status 3."""
    done = run_are(
        *("align", real_data / JARVIS / "jarvis_complex_path_fast.bag", "--map-frame", "pgm"),
        *("--map", real_data / JARVIS / "i-108_10mm.yaml", "--out", tmp_path / "a.png"),
        *("--topic", "scan:=/driver_laser_security/laser_scan"),
    )
    assert done.returncode == 3, done.stdout + done.stderr
    assert done.stdout.startswith("no fit: ")
    assert "--static-tf" not in done.stdout


def test_a_mirrored_map_fits_nowhere_and_is_asked_for(
    run_are: RunAre, sample_bag: Path, tmp_path: Path
) -> None:
    """An image from a drawing may be seen from below: no turn of it is right."""
    given = sample_bag.with_name("sample_office_map.yaml")
    with Image.open(given.with_suffix(".png")) as image:
        ImageOps.mirror(image).save(tmp_path / "sample_office_map.png")
    (tmp_path / given.name).write_text(given.read_text(encoding="utf-8"), encoding="utf-8")
    words = ("--map", tmp_path / given.name, "--map-frame", "site", "--out", tmp_path / "a.png")
    done = run_are("align", sample_bag, *words)
    assert done.returncode == 3, done.stdout + done.stderr
    assert done.stdout.startswith("no fit: ")
    assert "is it mirrored" in done.stdout


def test_the_way_of_two_lasers_is_that_of_one() -> None:
    """From front to rear nobody drives."""
    none = np.empty((0, 2))
    scans = [
        PlacedScan(k, f"/{k % 2}", (0.1 * (k // 2) - 1.5 * (k % 2), 0.0, 0.0), none)
        for k in range(6)
    ]
    driven_m = AlignInput("odom", ("/0", "/1"), tuple(scans), ()).driven_m()
    np.testing.assert_allclose(driven_m, (0.0, 0.05, 0.1, 0.15, 0.2, 0.2))


def test_a_recorded_map_in_another_frame_is_refused_as_in_a_replay(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """Else the line that is printed would be of no use."""
    message = make_grid(factory, replace(room(), frame_id="site"))
    bag = write_bag(tmp_path / "bag.mcap", [("/map", 0, message)])
    with BagReader((bag,)) as reader:
        roles = find_roles(reader.topics, {})
        with pytest.raises(BagError, match="--map-frame site"):
            map_of(reader, roles, ReplayOptions((bag,), Parameters()))
        there = with_values(Parameters(), {"frames.map": "site"})
        assert map_of(reader, roles, ReplayOptions((bag,), there)).frame_id == "site"


def test_only_one_side_of_a_gap_is_matched() -> None:
    """The longer one; the others are counted."""
    none = np.empty((0, 2))
    placed = [
        PlacedScan(at_s * S, "/scan", (0.0, 0.0, 0.0), none) for at_s in (0, 1, 100, 101, 102)
    ]
    drive, (notice,) = _longest_drive(placed)
    assert [scan.stamp_ns // S for scan in drive] == [100, 101, 102]
    assert "2 scans beyond it left out" in notice
    assert _longest_drive(placed[2:]) == (placed[2:], [])
