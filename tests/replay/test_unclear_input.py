"""Recordings that lack something, through the command line: what is said, and what still works."""

import copy
import json
from collections.abc import Callable, Sequence
from itertools import count
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import pytest
import yaml

from are_ros.bag.reader import BagReader
from are_ros.conventions import NS_PER_S
from are_ros.messages.sensors import read_cloud
from are_ros.messages.transforms import read_transforms
from are_ros.replay.recorded_scene import read_recorded_scene
from are_ros.world.transforms.tree import FrameTree
from bags.simulation.making import RosbagsFactory

CAMERA = "/camera/camera_info"
SCENARIO = Path(__file__).parents[2] / "config/scenarios/behind_walls.yaml"
Records = Sequence[tuple[str, int, Any]]


class WriteBag(Protocol):
    """Writes (topic, log time, message) into a recording."""

    def __call__(self, path: Path, records: Records) -> Path:
        """Return the path of what was written."""


class RunAre(Protocol):
    """Runs `are` in this process."""

    def __call__(self, *words: object) -> CompletedProcess[str]:
        """Return what it printed and its status."""


def test_two_lasers_are_both_augmented(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """A repeated --topic takes both, as sensors.scans does, and effective.yaml repeats it."""
    renamed = [("/front" if topic == "/scan" else topic, at, m) for topic, at, m in sample_records]
    rear = [("/rear", at, copy.deepcopy(m)) for topic, at, m in sample_records if topic == "/scan"]
    records = sorted([*renamed, *rear], key=lambda record: record[1])
    bag = write_bag(tmp_path / "bag.mcap", records)
    done = run_are("replay", bag, "--out", tmp_path / "out")
    assert done.returncode == 3, "none was chosen"
    assert "no scan was augmented: give --topic scan:=/NAME" in done.stderr
    assert "a choice of scans: --topic scan:=/NAME" in run_are("inspect", bag).stdout
    both = ("--topic", "scan:=/front", "--topic", "scan:=/rear")
    assert "a choice of scans" not in run_are("inspect", bag, *both).stdout
    done = run_are("replay", bag, *both, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    scans = json.loads((tmp_path / "out" / "metrics.json").read_text())["scans"]
    assert set(scans) == {"/front", "/rear"}
    assert scans["/front"] == scans["/rear"]
    again = run_are(
        "replay", bag, "--params", tmp_path / "out/effective.yaml", "--out", tmp_path / "again"
    )
    assert (tmp_path / "again/augmented.mcap").read_bytes() == (
        tmp_path / "out/augmented.mcap"
    ).read_bytes()
    assert "choose one with --topic" not in again.stderr


def test_a_second_laser_that_stays_as_it_is_is_told(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """A topic by the usual name is augmented alone; a replay says so, with the options for both."""
    rear = [("/rear", at, copy.deepcopy(m)) for topic, at, m in sample_records if topic == "/scan"]
    records = sorted([*sample_records, *rear], key=lambda record: record[1])
    bag = write_bag(tmp_path / "bag.mcap", records)
    both = ("--topic", "scan:=/scan", "--topic", "scan:=/rear")
    short = ("--duration", 1, "--out", tmp_path / "out")
    said = f"left as they are: /rear; to augment all, give {' '.join(both)}"
    assert said in run_are("inspect", bag).stdout
    assert said in run_are("replay", bag, *short).stderr
    assert "left as they are" not in run_are("replay", bag, *both, *short).stderr


def test_an_option_replaces_a_transform_of_the_file(
    run_are: RunAre, sample_bag: Path, tmp_path: Path
) -> None:
    """--static-tf about two frames of which frames.static tells holds; the others stay."""
    section = {"frames.static": ["0 0 0 0 0 0 a b", "0 0 0 0 0 0 b c"]}
    parameters = tmp_path / "p.yaml"
    parameters.write_text(yaml.safe_dump({"ar_builder": {"ros__parameters": section}}))
    words = ("--duration", 1, "--static-tf", "1 0 0 0 0 0 b a")
    done = run_are("replay", sample_bag, "--params", parameters, *words, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    effective = yaml.safe_load((tmp_path / "out/effective.yaml").read_text())
    static = effective["ar_builder"]["ros__parameters"]["frames"]["static"]
    assert static == ["0 0 0 0 0 0 b c", "1 0 0 0 0 0 b a"]


def test_the_check_takes_the_transform_that_the_replay_took(
    run_are: RunAre, sample_bag: Path, tmp_path: Path
) -> None:
    """A laser that stands elsewhere than its recorded mount says: beams end at artefacts there."""
    words = ("--duration", 3, "--static-tf", "0 0 0.3 0.7 0 0 base_link base_scan")
    many = ("--set", "population.arrival_rate:=0.05", "--with-inputs", "--out", tmp_path)
    done = run_are("replay", sample_bag, *words, *many)
    assert done.returncode == 0, done.stderr
    checked = run_are("check", tmp_path)
    assert checked.returncode == 0, checked.stdout
    (line,) = [line for line in checked.stdout.splitlines() if line.startswith("ends of changed")]
    assert "passed" in line


def _with(records: Records, topics: Sequence[str], change: Callable[[Any], None]) -> Records:
    """Return records with the messages of some topics changed."""
    changed = []
    for topic, at, message in records:
        own = copy.deepcopy(message) if topic in topics else message
        if topic in topics:
            change(own)
        changed.append((topic, at, own))
    return changed


def _turn_nothing(message: Any) -> None:
    for one in message.transforms:
        rotation = one.transform.rotation
        rotation.x = rotation.y = rotation.z = rotation.w = 0.0


def _camera_comes(records: Records, after_s: float) -> Records:
    """Return records with CameraInfo only after some seconds, or with one at the very end."""
    start_ns, end_ns = records[0][1], records[-1][1]
    others = [record for record in records if record[0] != CAMERA]
    camera = [record for record in records if record[0] == CAMERA]
    late = [record for record in camera if record[1] >= start_ns + after_s * NS_PER_S]
    return sorted([*others, *(late or [(CAMERA, end_ns, camera[0][2])])], key=lambda r: r[1])


def test_a_camera_that_comes_late_is_the_reason(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """For how long nothing was perceived, and what stands in; a frame has nothing to do with it."""
    bag = write_bag(tmp_path / "late.mcap", _camera_comes(sample_records, 3.0))
    done = run_are("replay", bag, "--out", tmp_path / "late")
    assert done.returncode == 0, done.stderr
    assert "nothing was perceived in the first 3." in done.stderr
    assert f"no CameraInfo came on {CAMERA} before; --set camera.model:=pinhole" in done.stderr
    assert f"{CAMERA} begins 3.0 s after what moves" in run_are("inspect", bag).stdout
    bag = write_bag(tmp_path / "never.mcap", _camera_comes(sample_records, 60.0))
    done = run_are("replay", bag, "--out", tmp_path / "never")
    assert done.returncode == 3
    (line,) = [line for line in done.stderr.splitlines() if "nothing was perceived" in line]
    assert f"the first CameraInfo of {CAMERA} came after the last tick" in line
    assert "--static-tf" not in line
    done = run_are("replay", bag, "--duration", 2, "--out", tmp_path / "before")
    assert f"no usable CameraInfo was received (none came on {CAMERA} in this time" in done.stderr
    good = ("--set", "camera.model:=pinhole", "--out", tmp_path / "good")
    assert run_are("replay", bag, *good).returncode == 0


def test_a_camera_that_is_refused_is_the_reason(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """What is wrong with its CameraInfo stands in the sentence."""
    records = _with(sample_records, [CAMERA], lambda message: message.k.fill(0.0))
    done = run_are("replay", write_bag(tmp_path / "a.mcap", records), "--out", tmp_path / "out")
    assert done.returncode == 3
    assert f"no usable CameraInfo was received ({CAMERA}: k is all zeros" in done.stderr
    inspected = run_are("inspect", tmp_path / "a" / "a.mcap").stdout
    assert f"the first CameraInfo is of no use: {CAMERA}: k is all zeros" in inspected


def test_transforms_that_are_all_refused_are_the_reason(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """No pose of the robot or the camera: the refusals are the cause, and inspect knows them."""
    records = _with(sample_records, ["/tf", "/tf_static"], _turn_nothing)
    bag = write_bag(tmp_path / "all.mcap", records)
    done = run_are("replay", bag, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "the robot's pose in the map was never known" in done.stderr
    assert "refused: /tf: the transform" in done.stderr
    assert "(0.0, 0.0, 0.0, 0.0) has length 0, not 1 (the first of 200 refused)" in done.stderr
    inspected = run_are("inspect", bag).stdout
    assert "transforms map -> odom of /tf refused: the rotation (0.0, 0.0, 0.0, 0.0)" in inspected
    records = _with(sample_records, ["/tf_static"], _turn_nothing)
    bag = write_bag(tmp_path / "mounts.mcap", records)
    done = run_are("replay", bag, "--out", tmp_path / "mounts")
    assert done.returncode == 3
    (line,) = [line for line in done.stderr.splitlines() if "nothing was perceived" in line]
    assert "frame 'camera_optical_frame' was not seen so far" in line
    assert "refused: /tf_static: the transform base_footprint -> base_link" in line


@pytest.mark.parametrize("command", ["inspect", "replay"])
def test_a_map_in_another_frame_names_the_option(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path, command: str
) -> None:
    """With the word that a map that moves with the robot will not do."""

    def rename(message: Any) -> None:
        message.header.frame_id = "earth"

    bag = write_bag(tmp_path / "a.mcap", _with(sample_records, ["/map"], rename))
    done = run_are(command, bag, *(("--out", tmp_path / "out") if command == "replay" else ()))
    assert done.returncode == (1 if command == "replay" else 0)
    said = done.stdout + done.stderr
    told = ("'earth'", "frames.map:=earth") if command == "replay" else ("earth", "--map-frame")
    for part in (*told, "rolling"):
        assert part in said


def _in_namespace(records: Records, space: str, frames: Sequence[str]) -> Records:
    """Return records whose topics, but for the map, are in a namespace, and some frames, too."""

    def named(frame: str) -> str:
        return f"{space}/{frame}" if frame in frames else frame

    def rename(message: Any) -> None:
        if hasattr(message, "header"):
            message.header.frame_id = named(message.header.frame_id)
        if hasattr(message, "child_frame_id"):
            message.child_frame_id = named(message.child_frame_id)
        for one in getattr(message, "transforms", ()):
            rename(one)

    topics = {topic for topic, _, _ in records} - {"/map"}
    return [
        (f"/{space}{topic}" if topic in topics else topic, at, message)
        for topic, at, message in _with(records, [*topics], rename)
    ]


FRAMES = ("odom", "base_footprint", "base_link", "base_scan", "camera_link", "camera_optical_frame")


def test_a_robot_in_a_namespace_has_its_base_there(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """Topics and frames are found, one is told, and the scans are those of the robot without."""
    plain = write_bag(tmp_path / "plain.mcap", sample_records)
    spaced = write_bag(tmp_path / "spaced.mcap", _in_namespace(sample_records, "r1", FRAMES))
    done = run_are("replay", plain, "--out", tmp_path / "a")
    assert done.returncode == 0, done.stderr
    assert "the robot's base" not in done.stderr
    done = run_are("replay", spaced, "--out", tmp_path / "b")
    assert done.returncode == 0, done.stderr
    (line,) = [line for line in done.stderr.splitlines() if "the robot's base" in line]
    assert line.startswith("no frame is called base_footprint or base_link: r1/base_footprint is")
    effective = yaml.safe_load((tmp_path / "b/effective.yaml").read_text())
    assert effective["ar_builder"]["ros__parameters"]["frames"]["base"] == "r1/base_footprint"
    assert "nothing: it can be replayed as it is" in run_are("inspect", spaced).stdout
    assert run_are("check", tmp_path / "b").returncode == 0
    ranges = {}
    for folder in ("a", "b"):
        with BagReader([tmp_path / folder / "augmented.mcap"]) as reader:
            scans = map(reader.deserialize, reader.messages(["/ar_builder/scan"]))
            ranges[folder] = [scan.ranges.tobytes() for scan in scans]
    assert ranges["a"] == ranges["b"]
    assert len(ranges["a"]) > 40


def test_odometry_of_another_frame_holds_a_correction_that_comes_once(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """As of a localization that speaks when it corrects; the scans are augmented and checked."""
    corrections = 0

    def first(message: Any) -> None:
        nonlocal corrections
        of_odometry = [one for one in message.transforms if one.header.frame_id != "map"]
        if corrections:
            message.transforms = of_odometry
        corrections += len(of_odometry) < len(message.transforms)

    records = _in_namespace(_with(sample_records, ["/tf"], first), "r1", FRAMES)
    bag = write_bag(tmp_path / "bag.mcap", records)
    done = run_are("replay", bag, "--with-inputs", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    scans = json.loads((tmp_path / "out/metrics.json").read_text())["scans"]["/r1/scan"]
    assert scans["held"] > 40
    assert scans["passed_through"] < 3
    checked = run_are("check", tmp_path / "out")
    assert checked.returncode == 0, checked.stdout
    (line,) = [one for one in checked.stdout.splitlines() if "rays that artefacts stop" in one]
    assert "rays that artefacts stop: passed" in line


def test_of_two_robots_one_has_to_be_chosen(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """The last sentence names the roles that several topics could play, not a transform."""
    one, other = (_in_namespace(sample_records, space, FRAMES) for space in ("r1", "r2"))
    both = sorted([*one, *(r for r in other if r[0] != "/map")], key=lambda record: record[1])
    bag = write_bag(tmp_path / "two.mcap", both)
    done = run_are("replay", bag, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert done.stderr.rstrip().endswith(
        "so give --topic tf:=/NAME, --topic tf_static:=/NAME and --topic odom:=/NAME"
    )
    assert "no camera is chosen: a pinhole" in done.stderr
    shared = [(topic.replace("/r1/tf", "/tf").replace("/r2/tf", "/tf"), *r) for topic, *r in both]
    done = run_are("replay", write_bag(tmp_path / "tf.mcap", shared), "--out", tmp_path / "out")
    assert done.returncode == 1
    assert done.stderr.rstrip().endswith("so give --topic odom:=/NAME")
    roles = {"tf": "tf", "tf_static": "tf_static", "odom": "odom", "scan": "scan"}
    words = [w for role, topic in roles.items() for w in ("--topic", f"{role}:=/r2/{topic}")]
    done = run_are("replay", bag, *words, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "r2/base_footprint is taken for the robot's base" in done.stderr


def test_a_pose_that_comes_too_late_names_the_parameter(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """A localiser that takes a second: which age is taken is a parameter, not a transform."""

    def arrival(topic: str, at_ns: int, message: Any) -> int:
        is_late = topic == "/tf" and message.transforms[0].header.frame_id == "map"
        return at_ns + (NS_PER_S if is_late else 0)

    records = [(topic, arrival(topic, at, m), m) for topic, at, m in sample_records]
    bag = write_bag(tmp_path / "late.mcap", sorted(records, key=lambda record: record[1]))
    done = run_are("replay", bag, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "s old): --set frames.max_age:=SECONDS takes older ones; it is 0.5" in done.stderr
    words = ("--set", "frames.max_age:=1.5", "--out", tmp_path / "out")
    assert run_are("replay", bag, *words).returncode == 0


def test_a_pose_that_is_too_old_most_of_the_time_names_the_parameter(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """A localiser that speaks every two seconds: the number that is given is enough."""
    records, next_ns = list[Any](), 0
    for record in sample_records:
        if record[0] == "/tf" and record[2].transforms[0].header.frame_id == "map":
            if record[1] < next_ns:
                continue
            next_ns = record[1] + 2 * NS_PER_S
        records.append(record)
    bag = write_bag(tmp_path / "rare.mcap", records)
    done = run_are("replay", bag, "--out", tmp_path / "out")
    (line,) = [line for line in done.stderr.splitlines() if "robot's pose was more than" in line]
    assert "more than 0.5 s old in 3" in line
    assert "of 50 ticks, so that nothing was perceived in these: --set frames.max_age:=" in line
    option = line.split("--set ")[1].split()[0]
    done = run_are("replay", bag, "--set", option, "--out", tmp_path / "out")
    assert "robot's pose was more than" not in done.stderr
    assert "1 of 50 ticks without camera or its pose" in done.stderr


def test_a_recording_that_ends_before_a_tick_says_so(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """It is the length that it lacks, and no transform."""
    end_ns = sample_records[0][1] + NS_PER_S // 25
    records = [record for record in sample_records if record[1] < end_ns]
    bag = write_bag(tmp_path / "short.mcap", records)
    done = run_are("replay", bag, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "are too short to know the robot's pose at a tick: ticks are 0.1 s apart" in done.stderr


def test_a_camera_in_the_frame_of_its_body_is_told_with_its_remedy(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """Its frame has x ahead, so that it would look at the ceiling; the option turns it."""

    def rename(message: Any) -> None:
        message.header.frame_id = "camera_link"

    many = ("--set", "population.arrival_rate:=0.012", "--set", "sensors.gate:=all")

    def perceived(bag: Path, *words: str) -> tuple[list[list[int]], list[str]]:
        done = run_are("replay", bag, *many, *words, "--out", tmp_path / "out")
        assert done.returncode == 0, done.stderr
        with BagReader([tmp_path / "out" / "augmented.mcap"]) as reader:
            lists = map(reader.deserialize, reader.messages(["/ar_builder/perceived"]))
            ids = [sorted(one.id for one in found.artefacts) for found in lists]
        return ids, [line for line in done.stderr.splitlines() if "looks up to the ceiling" in line]

    plain, nothing = perceived(write_bag(tmp_path / "a.mcap", sample_records))
    assert sum(map(len, plain)) > 20
    assert not nothing
    bag = write_bag(tmp_path / "b.mcap", _with(sample_records, [CAMERA], rename))
    to_the_ceiling, (line,) = perceived(bag)
    assert sum(map(len, to_the_ceiling)) < sum(map(len, plain)) / 4
    assert line.startswith("the camera in camera_link looks up to the ceiling")
    option = line.partition('give --static-tf "')[2].removesuffix('"')
    assert option.endswith(" base_link camera_link")
    assert line in run_are("inspect", bag).stdout
    assert "ceiling" not in run_are("inspect", bag, "--static-tf", option).stdout
    assert perceived(bag, "--static-tf", option) == (plain, [])


def test_results_without_the_animation_end_with_status_3(
    run_are: RunAre, sample_bag: Path, tmp_path: Path
) -> None:
    """The results stay, all is said of them, and the sentence names the file that could not be."""
    (tmp_path / "out" / "a.gif").mkdir(parents=True)
    words = ("--duration", 1, "--animate", "a.gif", "--out", tmp_path / "out")
    done = run_are("replay", sample_bag, *words)
    assert done.returncode == 3
    lines = done.stderr.splitlines()
    (at,) = (i for i, line in enumerate(lines) if line.startswith("results in"))
    assert "a.gif" in lines[at + 2]  # after the view
    assert (tmp_path / "out" / "metrics.json").is_file()


@pytest.mark.parametrize(("bare_of_5", "status"), [(2, 0), (3, 3)])
def test_most_scans_of_a_topic_must_be_augmented(
    run_are: RunAre,
    write_bag: WriteBag,
    sample_records: Records,
    tmp_path: Path,
    bare_of_5: int,
    status: int,
) -> None:
    """Status 3 where more passed through than were augmented; the sentence comes either way."""
    counter = count()

    def lose_its_frame(scan: Any) -> None:
        if next(counter) % 5 < bare_of_5:
            scan.header.frame_id = "nowhere"

    bag = write_bag(tmp_path / "a.mcap", _with(sample_records, ["/scan"], lose_its_frame))
    done = run_are("replay", bag, "--duration", 2, "--out", tmp_path / "out")
    assert "scans passed through unaugmented" in done.stderr
    assert done.returncode == status, done.stderr


def _write_octomap(path: Path, voxels: npt.NDArray[np.int64], size_m: float) -> None:
    """Write voxels (N, 3) as a binary octree without pruned leaves."""

    def encoded(keys: npt.NDArray[np.int64], level: int) -> tuple[bytes, int]:
        children = ((keys >> level & 1) * (1, 2, 4)).sum(axis=1)
        word, data, nodes = 0, b"", 1
        for child in np.unique(children).tolist():
            word |= (3 if level else 2) << (2 * child)
            part = encoded(keys[children == child], level - 1) if level else (b"", 1)
            data, nodes = data + part[0], nodes + part[1]
        return word.to_bytes(2, "little") + data, nodes

    data, nodes = encoded(voxels + 2**15, 15)
    head = f"# Octomap OcTree binary file\nid OcTree\nsize {nodes}\nres {size_m}\ndata\n"
    path.write_bytes(head.encode() + data)


def test_an_octomap_of_a_file_is_used_coarser_and_kept_beside_the_outputs(
    run_are: RunAre, sample_bag: Path, tmp_path: Path
) -> None:
    """Both sizes are said; the inputs that are written hold its voxels, and the picture them."""
    octomap, out = tmp_path / "wall.bt", tmp_path / "out"
    wall = np.argwhere(np.ones((4, 40, 20))) + np.array((30, -20, 0))
    _write_octomap(octomap, wall, 0.05)
    words = ("--octomap", octomap, "--duration", 1, "--with-inputs", "--out", out)
    done = run_are("replay", sample_bag, "--set", "world.voxel_size:=0.1", *words)
    assert done.returncode == 0, done.stderr
    assert "the cloud's voxels of 0.05 m become 400 of 0.1 m" in done.stderr
    with BagReader([out / "augmented.mcap"]) as reader:
        (message,) = reader.messages(["/octomap_point_cloud_centers"])
        points_m = read_cloud(reader.deserialize(message)).points_m()
    assert sorted(map(tuple, np.floor(points_m / 0.05).astype(int).tolist())) == sorted(
        map(tuple, wall.tolist())
    )
    scene = read_recorded_scene(out, lambda _start, _end: lambda _now: None)
    shown = scene.voxels
    assert shown is not None
    assert shown.voxel_size_m == pytest.approx((0.1, 0.1, 0.1))
    assert shown.occupied_count == 2 * 20 * 10


def test_a_point_cloud_of_a_file_becomes_voxels_of_the_size_that_is_set(
    run_are: RunAre, sample_bag: Path, tmp_path: Path
) -> None:
    """Without a size it is asked for; the inputs that are written hold the points themselves."""
    cloud, out = tmp_path / "wall.pcd", tmp_path / "out"
    wall = np.argwhere(np.ones((2, 20, 10))) + np.array((15, -10, 0))
    spots = np.random.default_rng(1).uniform(0.05, 0.95, (3, *wall.shape))
    points_m = (0.1 * (wall + spots)).reshape(-1, 3).round(6)
    head = f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS {len(points_m)}\n"
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in points_m.tolist())
    cloud.write_text(f"{head}DATA ascii\n{rows}")
    words = ("--octomap", cloud, "--duration", 1, "--with-inputs", "--out", out)
    done = run_are("replay", sample_bag, *words)
    assert done.returncode == 1
    assert f"{cloud}: the voxel size cannot be inferred from 1200 points" in done.stderr
    assert "set world.voxel_size" in done.stderr
    done = run_are("replay", sample_bag, "--set", "world.voxel_size:=0.1", *words)
    assert done.returncode == 0, done.stderr
    shown = read_recorded_scene(out, lambda _start, _end: lambda _now: None).voxels
    assert shown is not None
    low = np.rint(shown.map_from_lattice.translation_m / 0.1).astype(int)
    voxels = np.argwhere(shown.occupied) + low
    assert sorted(map(tuple, voxels.tolist())) == sorted(map(tuple, wall.tolist()))


def test_an_octomap_that_cannot_be_used_names_its_file(
    run_are: RunAre, sample_bag: Path, tmp_path: Path
) -> None:
    """Finer voxels than it has are refused; of too large a box the size is named that would do."""
    octomap = tmp_path / "a.bt"
    block = np.argwhere(np.ones((5, 5, 5)))
    _write_octomap(octomap, block, 0.05)
    words = ("--octomap", octomap, "--duration", 1, "--out", tmp_path / "out")
    done = run_are("replay", sample_bag, "--set", "world.voxel_size:=0.02", *words)
    assert done.returncode == 1
    assert f"{octomap}: its voxels are 0.05 m wide, finer ones" in done.stderr
    corners = np.array([(x, y, z) for x in (0, 2735) for y in (0, 2415) for z in (0, 170)])
    _write_octomap(octomap, (block + corners[:, np.newaxis]).reshape(-1, 3), 0.05)
    done = run_are("replay", sample_bag, *words)
    assert done.returncode == 1
    assert f"{octomap}: 2740 x 2420 x 175 voxels of 0.05 m are more than 1073741824" in done.stderr
    assert "set world.voxel_size to 0.1 m" in done.stderr


def test_a_map_that_comes_late_is_told_with_what_helps(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """Until then nobody can arrive."""
    for late_s in (0, 3):
        records = [(t, at + (t == "/map") * late_s * NS_PER_S, m) for t, at, m in sample_records]
        bag = write_bag(tmp_path / f"{late_s}.mcap", sorted(records, key=lambda r: r[1]))
        done = run_are("replay", bag, "--out", tmp_path / f"{late_s}_out")
        said = "nobody could arrive in the first 3.1 s: no map came on /map before; --map FILE"
        assert (said in done.stdout + done.stderr) == (late_s == 3)


def test_zones_beside_the_map_are_told(run_are: RunAre, sample_bag: Path, tmp_path: Path) -> None:
    """Nobody can arrive there; a rate of 0 is no surprise."""
    zones = tmp_path / "zones.yaml"
    zones.write_text("zones: [{polygon: [[91, 1], [92, 1], [92, 3]]}]", encoding="utf-8")
    of_zones = ("--set", "population.region:=zones", "--set", f"population.zones:={zones}")
    for rate, is_told in ((0.01, True), (0.0, False)):
        words = (*of_zones, "--set", f"population.arrival_rate:={rate}", "--duration", 2)
        done = run_are("replay", sample_bag, *words, "--out", tmp_path / f"out_{rate}")
        said = "nobody can arrive: population.zones leaves no free cell of the map"
        assert done.returncode == 0, done.stderr
        assert (said in done.stdout + done.stderr) == is_told


def test_a_first_tick_that_is_late_itself_misses_nothing(
    run_are: RunAre, sample_bag: Path, tmp_path: Path
) -> None:
    """At 0.5 Hz it may come 2 s after the start."""
    late = ("--set", "builder.tick_rate:=0.5", "--start", 0.5, "--duration", 9)
    map_file = sample_bag.with_name("sample_office_map.yaml")
    for name, words in (("topic", ()), ("file", ("--map", map_file))):
        done = run_are("replay", sample_bag, *words, *late, "--out", tmp_path / name)
        assert done.returncode == 0, done.stderr
        assert "in the first" not in done.stdout + done.stderr


@pytest.mark.parametrize("topic_of_joint", ["/tf_static", "/tf"])
def test_an_odometry_that_a_joint_overrules_names_the_parameter(
    topic_of_joint: str,
    run_are: RunAre,
    write_bag: WriteBag,
    sample_records: Records,
    factory: RosbagsFactory,
    tmp_path: Path,
) -> None:
    """Its child is below the root of the robot's description; with the parameter it holds.

    A static joint it moves with all that is above.
    """
    records = [
        (topic, at_ns, copy.deepcopy(message))
        for topic, at_ns, message in sample_records
        if topic != "/tf"
    ]
    joint = factory.make("geometry_msgs/msg/TransformStamped", child_frame_id="chassis")
    joint.header.frame_id, joint.transform.rotation.w = "base_footprint", 1.0
    for topic, _, message in records:
        if topic == "/odom":
            message.child_frame_id = "chassis"
        elif topic == "/tf_static":
            for mount in message.transforms:
                if mount.header.frame_id == "base_footprint":
                    mount.header.frame_id = "chassis"
            if topic_of_joint == "/tf_static":
                message.transforms = [*message.transforms, joint]
    if topic_of_joint == "/tf":
        for _, at_ns, message in [record for record in records if record[0] == "/odom"]:
            moved = copy.deepcopy(joint)
            moved.header.stamp = message.header.stamp
            tf = factory.make("tf2_msgs/msg/TFMessage", transforms=[moved])
            records.append(("/tf", at_ns, tf))
    bag = write_bag(tmp_path / "bag.mcap", sorted(records, key=lambda record: record[1]))
    words = ("replay", bag, "--static-tf", "1.15 5.83 0 -0.08 0 0 map odom")
    failed = run_are(*words, "--out", tmp_path / "failed")
    if topic_of_joint == "/tf_static":
        said = "odometry tells the pose of chassis, which static transforms fix to base_footprint"
        assert failed.returncode == 0, failed.stderr
        assert said in failed.stdout + failed.stderr
        return
    assert failed.returncode == 1
    said = "odometry says where chassis is in odom, and base_footprint -> chassis in tf overrules"
    assert said in failed.stderr
    options = "--set frames.odometry:=use --set frames.base:=chassis"
    assert f"{options} lets it hold" in failed.stderr
    done = run_are(*words, *options.split(), "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr


def test_a_damaged_depth_image_that_passes_through_is_no_fault_of_the_replay(
    run_are: RunAre, write_bag: WriteBag, sample_bag: Path, tmp_path: Path
) -> None:
    """The check leaves out the input, and what has its bytes."""
    records = []
    with BagReader([sample_bag]) as reader:
        for message in reader.messages(stop_ns=reader.start_ns + 4 * NS_PER_S):
            value = reader.deserialize(message)
            if message.topic.endswith("compressedDepth"):
                value.data = value.data[:3000]
            records.append((message.topic, message.log_time_ns, value))
    bag = write_bag(tmp_path / "bag.mcap", records)
    words = ("--scenario", SCENARIO, "--with-inputs", "--out", tmp_path / "out")
    done = run_are("replay", bag, *words)
    assert "its PNG is damaged" in done.stderr
    judged = run_are("check", tmp_path / "out")
    assert judged.returncode == 0, judged.stdout
    assert "with the bytes of such an input" in judged.stdout


def test_two_costmaps_are_no_missing_map(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """One has to be chosen."""
    records = [
        (name, at_ns, message)
        for topic, at_ns, message in sample_records
        for name in (("/local/costmap", "/global/costmap") if topic == "/map" else (topic,))
    ]
    done = run_are("replay", write_bag(tmp_path / "bag.mcap", records), "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "several topics could be the map: give --topic map:=/NAME" in done.stderr


def test_poses_on_the_map_stand_in_for_its_transform(
    run_are: RunAre,
    write_bag: WriteBag,
    sample_records: Records,
    factory: RosbagsFactory,
    tmp_path: Path,
) -> None:
    """A replay without map->odom ends with the option; with it, the robot is where it was."""
    tree, records, poses = FrameTree(100 * NS_PER_S), [], []
    for topic, at_ns, original in sample_records:
        message = copy.deepcopy(original)
        if topic in {"/tf", "/tf_static"}:
            for parent, child, stamp_ns, place, turn in read_transforms(message):
                if topic == "/tf_static":
                    tree.set_static(parent, child, place, turn)
                else:
                    tree.set_transform(parent, child, stamp_ns, place, turn)
            message.transforms = [t for t in message.transforms if t.child_frame_id != "odom"]
        records.append((topic, at_ns, message))
    begin_ns = sample_records[0][1]
    for second in (1, 2, 3, 4):
        at_ns = begin_ns + second * NS_PER_S
        there = tree.lookup("map", "base_footprint", at_ns)
        pose = factory.make("geometry_msgs/msg/PoseWithCovarianceStamped")
        pose.header.frame_id = "map"
        pose.header.stamp.sec, pose.header.stamp.nanosec = divmod(at_ns, NS_PER_S)
        at, turn = pose.pose.pose.position, pose.pose.pose.orientation
        at.x, at.y, at.z = there.translation_m.tolist()
        turn.x, turn.y, turn.z, turn.w = there.rotation_xyzw.tolist()
        poses.append(there)
        records.append(("/amcl_pose", at_ns, pose))
    bag = write_bag(tmp_path / "bag.mcap", sorted(records, key=lambda record: record[1]))
    failed = run_are("replay", bag, "--out", tmp_path / "failed")
    assert failed.returncode == 1
    _, _, option = failed.stderr.partition('/amcl_pose tells it: give --static-tf "')
    option = option.partition('"')[0]
    done = run_are("replay", bag, "--static-tf", option, "--with-inputs", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    base = read_recorded_scene(tmp_path / "out", lambda _start, _end: lambda _now: None).record.base
    for second, there in enumerate(poses, 1):
        (row,) = np.flatnonzero(base.stamps_ns == begin_ns + second * NS_PER_S)
        assert np.linalg.norm(base.poses[row, :3] - there.translation_m) < 0.05
