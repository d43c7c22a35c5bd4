"""`are export --tracks` and `--kitti`: read back by other means, against the recording."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from are_ros.bag.decoded import Scene
from are_ros.bag.recording import Recording, find_recording
from are_ros.export.coco import CocoWriter
from are_ros.export.tracks import _Life, _save
from are_ros.export.truth import Interval, TrueTick
from are_ros.replay.recorded_scene import read_recorded_scene
from bags.simulation.making import RosbagsFactory
from tests.checks.test_live import Tape
from tests.oracles.recorded import read_outputs
from tests.replay.conftest import Records, RunAre, WriteBag
from tests.replay.test_clouds import AUGMENTED, by_stamp, cloud_of

Floats = npt.NDArray[np.float64]
NS_PER_S = 1_000_000_000
SAMPLE = Path(__file__).parents[2] / "bags" / "sample_office.mcap"
KITTI_COLUMNS = 15
CROWD = ("--set", "population.arrival_rate:=0.06", "--set", "population.mean_life:=6")


@pytest.fixture(scope="module")
def tracks(sample_replay: Path, run_are: RunAre, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the sample's tracks."""
    folder: Path = tmp_path_factory.mktemp("sets") / "tracks"
    done = run_are("export", sample_replay, "--tracks", folder)
    assert done.returncode == 0, done.stderr
    assert f"tracks: {folder} (" in done.stderr
    return folder


def test_the_table_has_each_artefact_of_each_tick(sample_replay: Path, tracks: Path) -> None:
    """At its pose, with what the list of the perceived says."""
    outputs = read_outputs(sample_replay / "augmented.mcap")
    seen = by_stamp(sample_replay / "augmented.mcap", "/ar_builder/perceived")
    with (tracks / "tracks.csv").open(encoding="utf-8") as file:
        rows = {(int(row["stamp_ns"]), int(row["id"])): row for row in csv.DictReader(file)}
    assert rows.keys() == {(t.stamp_ns, i) for t in outputs.ticks for i in t.poses}
    assert len(rows) > 150
    for tick in outputs.ticks:
        sightings = {one.id: one for one in seen[divmod(tick.stamp_ns, NS_PER_S)].artefacts}
        for number, pose in tick.poses.items():
            row, state = rows[tick.stamp_ns, number], outputs.kinds[number]
            x, y, z, qz, qw = (float(row[name]) for name in ("x", "y", "z", "qz", "qw"))
            assert (x, y, z, 2.0 * math.atan2(qz, qw)) == pytest.approx(pose, abs=1e-6)
            assert (row["label"], row["class"]) == (state.label, state.class_name)
            assert float(row["length"]) == pytest.approx(state.size.x)
            assert (row["perceived"] == "1") == (number in sightings)
            if number in sightings:
                fraction = sightings[number].visible_fraction
                assert float(row["visible_fraction"]) == pytest.approx(fraction, rel=1e-5)
                assert row["cameras"] == "camera_optical_frame"


def test_the_table_tells_how_far_the_robot_was(sample_replay: Path, tracks: Path) -> None:
    """A disc of the robot's radius from the rectangle of the artefact; empty without its pose."""
    kinds = read_outputs(sample_replay / "augmented.mcap").kinds
    robot = {round(line[0], 3): line for line in np.loadtxt(tracks / "tum" / "robot.txt")}
    radius_m = find_recording(sample_replay).effective().robot.radius
    compared = 0
    with (tracks / "tracks.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            pose = robot.get(round(int(row["stamp_ns"]) / NS_PER_S, 3))
            assert (row["robot_distance"] == "") == (pose is None)
            if pose is None:
                continue
            compared += 1
            centre = kinds[int(row["id"])].box_centre
            yaw_rad = 2.0 * math.atan2(float(row["qz"]), float(row["qw"]))
            away = complex(pose[1] - float(row["x"]), pose[2] - float(row["y"]))
            away = away * complex(math.cos(yaw_rad), -math.sin(yaw_rad))
            past_x = abs(away.real - centre.x) - 0.5 * float(row["length"])
            past_y = abs(away.imag - centre.y) - 0.5 * float(row["width"])
            outside_m = math.hypot(max(past_x, 0.0), max(past_y, 0.0))
            expected_m = outside_m + min(max(past_x, past_y), 0.0) - radius_m
            assert float(row["robot_distance"]) == pytest.approx(expected_m, abs=1e-4)
    assert compared > 150


def test_each_track_is_a_file_as_tum_has_them(sample_replay: Path, tracks: Path) -> None:
    """Eight numbers a line, time first; the robot's, too."""
    outputs = read_outputs(sample_replay / "augmented.mcap")
    ids = {i for tick in outputs.ticks for i in tick.poses}
    files = {path.stem: path for path in (tracks / "tum").iterdir()}
    assert files.keys() == {"robot", *(f"{outputs.kinds[i].label}_{i}" for i in ids)}
    robot = np.loadtxt(files["robot"])
    assert len(outputs.ticks) - 1 <= len(robot) <= len(outputs.ticks)  # the first may know none
    assert np.hypot(*np.ptp(robot[:, 1:3], axis=0)) > 1.0
    number = min(ids)
    track = np.loadtxt(files[f"{outputs.kinds[number].label}_{number}"], ndmin=2)
    poses = {tick.stamp_ns: tick.poses[number] for tick in outputs.ticks if number in tick.poses}
    assert track[:, 0] == pytest.approx(np.array(list(poses)) / NS_PER_S, abs=1e-6)
    assert track[:, 1:4] == pytest.approx(np.array([p[:3] for p in poses.values()]), abs=1e-6)


def test_each_life_has_a_file_of_its_own(tmp_path: Path) -> None:
    """Also where a label ends as the name of another's second life does."""
    lives = [_Life(1, "box", 10), _Life(1, "box", 20), _Life(2, "box_1", 20), _Life(1, "box", 20)]
    files: dict[str, _Life] = {}
    for number, life in enumerate(lives):
        _save(tmp_path, life, files, [f"{number}\n"])
    texts = {path.stem: path.read_text() for path in tmp_path.iterdir()}
    assert texts == {"box_1": "0\n", "box_1_2": "1\n3\n", "box_1_2_2": "2\n"}
    assert len(files) == 3


def test_the_robot_is_where_its_transforms_say_at_the_stamp(
    sample_replay: Path, tracks: Path
) -> None:
    """Between two transforms, by numpy's interpolation; the tick itself knew but the first."""
    samples: dict[str, list[list[float]]] = {"odom": [], "base_footprint": []}
    with Recording(find_recording(sample_replay)) as recording:
        for message in recording.messages(["/tf", "/tf_static"]):
            for one in recording.decode(message).samples:
                if one.child in samples:
                    yaw_rad = 2.0 * math.atan2(one.rotation_xyzw[2], one.rotation_xyzw[3])
                    samples[one.child].append(
                        [one.stamp_ns / NS_PER_S, *one.translation_m, yaw_rad]
                    )
    robot = np.loadtxt(tracks / "tum" / "robot.txt")
    at_s = robot[:-2, 0]

    def pose(child: str) -> Floats:
        known = np.array(samples[child])
        known[:, 4] = np.unwrap(known[:, 4])
        return np.stack([np.interp(at_s, known[:, 0], known[:, k]) for k in (1, 2, 4)], axis=1)

    odom, base = pose("odom"), pose("base_footprint")
    turn = np.exp(1j * odom[:, 2]) * (base[:, 0] + 1j * base[:, 1])
    expected = odom[:, :2] + np.stack((turn.real, turn.imag), axis=1)
    assert robot[:-2, 1:3] == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("certainty", ["latency:=2.5", "latency:=0.1"])
def test_perceptions_that_come_late_belong_to_the_tick_of_their_stamp(
    run_are: RunAre, tmp_path: Path, certainty: str
) -> None:
    """A detector with latency tells of the past: in tracks and in pictures it is there."""
    words = ("replay", SAMPLE, "--params", SAMPLE.with_suffix(".yaml"), "--duration", "40")
    given = ("--set", "certainty.enabled:=true", "--set", f"certainty.{certainty}")
    done = run_are(*words, *given, "--with-inputs", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert run_are("export", tmp_path / "out", "--tracks", tmp_path / "tracks").returncode == 0
    recording = tmp_path / "out" / "augmented.mcap"
    outputs, seen = read_outputs(recording), by_stamp(recording, "/ar_builder/perceived")
    expected = set()
    for tick in outputs.ticks:
        lists = seen.get(divmod(tick.stamp_ns, NS_PER_S))
        told = {one.id for one in lists.artefacts} if lists else set()
        expected |= {(tick.stamp_ns, number) for number in told & tick.poses.keys()}
    with (tmp_path / "tracks" / "tracks.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["perceived"] == "1"]
    assert {(int(row["stamp_ns"]), int(row["id"])) for row in rows} == expected
    assert len(expected) > 20
    scene = read_recorded_scene(tmp_path / "out", lambda _start, _end: lambda _now: None)
    shown = {
        (moment.stamp_ns, number)
        for moment in scene.record.moments()
        for number in moment.perceived & {one.artefact_id for one in moment.artefacts}
    }
    assert shown == expected


def test_a_live_recording_gives_the_tracks_of_the_replay_it_was_made_of(
    sample_replay: Path, tracks: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """Messages are logged late and in another order, yet what was perceived belongs to its tick."""
    tape = Tape.of(sample_replay).late(most_ns=250_000_000)
    done = run_are("export", tape.write(tmp_path / "run"), "--tracks", tmp_path / "tracks")
    assert done.returncode == 0, done.stderr
    with (tracks / "tracks.csv").open(encoding="utf-8") as file:
        assert any(row["perceived"] == "1" for row in csv.DictReader(file))
    assert (tmp_path / "tracks" / "tracks.csv").read_text() == (tracks / "tracks.csv").read_text()


def test_of_a_looped_recording_the_first_pass_is_exported(
    sample_replay: Path, tracks: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """And one sentence says so."""
    run = Tape.of(sample_replay).looped().write(tmp_path / "run")
    done = run_are("export", run, "--tracks", tmp_path / "tracks")
    assert done.returncode == 0, done.stderr
    assert "the clock jumps back" in done.stderr
    assert (tmp_path / "tracks" / "tracks.csv").read_text() == (tracks / "tracks.csv").read_text()


@pytest.fixture(scope="module")
def cloud_replay(
    sample_records: Records,
    factory: RosbagsFactory,
    write_bag: WriteBag,
    run_are: RunAre,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Return the results of five seconds of the sample with a cloud beside each scan."""
    folder = tmp_path_factory.mktemp("kitti")
    clouds = [
        ("/velodyne_points", log_ns + 1, cloud_of(message, factory, is_organised=False))
        for topic, log_ns, message in sample_records
        if topic == "/scan"
    ]
    clouds[20][2].header.frame_id = "nowhere"
    records = sorted([*sample_records, *clouds], key=lambda record: record[1])
    bag = write_bag(folder / "bag.mcap", records)
    done = run_are("replay", bag, *CROWD, "--seed", 3, "--with-inputs", "--out", folder / "out")
    assert done.returncode == 0, done.stderr
    return folder / "out"


def read_frame(folder: Path, name: str) -> tuple[Floats, list[list[str]], dict[str, Floats]]:
    """Return points (N, 4), the words of each label, and the matrices of a frame."""
    points = np.fromfile(folder / "velodyne" / f"{name}.bin", "<f4").reshape(-1, 4)
    labels = [
        line.split() for line in (folder / "label_2" / f"{name}.txt").read_text().splitlines()
    ]
    rows = [line.split(":") for line in (folder / "calib" / f"{name}.txt").read_text().splitlines()]
    matrices = {key: np.array(text.split(), np.float64) for key, text in rows}
    return points.astype(np.float64), labels, matrices


def in_box(points: Floats, label: list[str], margin_m: float) -> npt.NDArray[np.bool_]:
    """Return which points (N, 3) of the camera's frame lie in a label's box, or so near to it."""
    height, width, length, x, y, z, turn = (float(word) for word in label[8:15])
    offset = points - (x, y, z)
    along = math.cos(turn) * offset[:, 0] - math.sin(turn) * offset[:, 2]
    across = math.sin(turn) * offset[:, 0] + math.cos(turn) * offset[:, 2]
    inside: npt.NDArray[np.bool_] = (
        (np.abs(along) <= 0.5 * length + margin_m)
        & (np.abs(across) <= 0.5 * width + margin_m)
        & (offset[:, 1] <= margin_m)
        & (offset[:, 1] >= -height - margin_m)
    )
    return inside


def test_labels_clouds_and_calibration_of_kitti_fit_together(
    cloud_replay: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """Points that the artefacts changed lie in labelled boxes, boxes in their rectangles.

    What is left out is told with the reason.
    """
    done = run_are("export", cloud_replay, "--kitti", tmp_path / "set")
    assert done.returncode == 0, done.stderr
    assert "; 1 left out, the pose of its sensor or of the camera is not known" in done.stderr
    with (tmp_path / "set" / "frames.csv").open(encoding="utf-8") as file:
        stamps = {row["frame"]: int(row["stamp_ns"]) for row in csv.DictReader(file)}
    before = by_stamp(cloud_replay / "augmented.mcap", "/velodyne_points")
    after = by_stamp(cloud_replay / "augmented.mcap", AUGMENTED)
    seen = by_stamp(cloud_replay / "augmented.mcap", "/ar_builder/perceived")
    assert len(stamps) > 0.9 * len(after)
    changed = inside = boxes = 0
    for name, stamp_ns in stamps.items():
        points, labels, matrices = read_frame(tmp_path / "set" / "training", name)
        stamp = divmod(stamp_ns, NS_PER_S)
        assert points[:, :3] == pytest.approx(_xyz(after[stamp]))
        real = _xyz(before[stamp])
        is_changed = np.ones(len(points), dtype=bool)
        is_changed[: len(real)] = (points[: len(real), :3] != real).any(axis=1)
        to_camera = np.vstack((matrices["Tr_velo_to_cam"].reshape(3, 4), (0.0, 0.0, 0.0, 1.0)))
        homogeneous = np.column_stack((points[:, :3], np.ones(len(points))))
        in_camera = homogeneous @ to_camera.T
        projection = matrices["P2"].reshape(3, 4)
        found = np.zeros(len(points), dtype=bool)
        for label in labels:
            assert len(label) == KITTI_COLUMNS
            own = in_box(in_camera[:, :3], label, 0.03)
            pixels = in_camera[own] @ projection.T
            pixels = pixels[pixels[:, 2] > 0.1]
            pixels = pixels[:, :2] / pixels[:, 2:]
            left, top, right, bottom = (float(word) for word in label[4:8])
            # What lies beyond the image is cut off in the rectangle.
            shown = ((pixels > 0) & (pixels < (639, 479))).all(axis=1)
            low, high = (left - 8, top - 8), (right + 8, bottom + 8)
            assert ((pixels[shown] >= low) & (pixels[shown] <= high)).all()
            found |= own
            boxes += 1
        visible = (in_camera @ projection.T)[:, 2] > 0.1
        ids = {one.id for one in seen.get(stamp, _NONE).artefacts} if stamp in seen else set()
        assert len(labels) <= len(ids) or stamp not in seen
        changed += np.count_nonzero(is_changed & visible)
        inside += np.count_nonzero(is_changed & visible & found)
    assert boxes > 30
    assert changed > 1000
    assert inside > 0.9 * changed


@pytest.mark.parametrize(
    ("cameras", "levels"),
    [
        (["camera_optical_frame"], {"0", "1", "2"}),
        (["left_optical"], set()),
        (["left_optical", "camera_optical_frame"], {"3"}),
    ],
)
def test_labels_of_kitti_are_of_one_camera(
    cloud_replay: Path, run_are: RunAre, tmp_path: Path, cameras: list[str], levels: set[str]
) -> None:
    """Who is seen by another one only has none; whose fraction is another's, unknown occlusion."""

    def by(message: Any) -> None:
        for one in message.artefacts:
            one.cameras = cameras

    run = Tape.of(cloud_replay).edited("perceived", by, 0.0, 99.0).write(tmp_path / "run")
    assert run_are("export", run, "--kitti", tmp_path / "set").returncode == 0
    files = (tmp_path / "set" / "training" / "label_2").iterdir()
    found = {line.split()[2] for file in files for line in file.read_text().splitlines()}
    assert found <= levels
    assert bool(found) == bool(levels)


@pytest.mark.parametrize("late", [frozenset({AUGMENTED}), frozenset({"/tf"})])
def test_what_is_recorded_late_is_in_the_set_of_kitti(
    cloud_replay: Path, run_are: RunAre, tmp_path: Path, late: frozenset[str]
) -> None:
    """Clouds of a slow driver after their ticks, or transforms after the clouds: all the same."""
    tape = Tape.of(cloud_replay)
    moved = [(at + 500_000_000 * (topic in late), topic, data) for at, topic, data in tape.entries]
    entries = tuple(sorted(moved, key=lambda entry: entry[0]))
    run = replace(tape, entries=entries).write(tmp_path / "run")
    files = []
    for name, recording in (("prompt", cloud_replay), ("late", run)):
        folder = tmp_path / name
        assert run_are("export", recording, "--kitti", folder).returncode == 0
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        files.append({str(path.relative_to(folder)): path.read_bytes() for path in paths})
    assert len(files[0]) > 100
    assert files[0] == files[1]


def test_no_empty_set_of_kitti_is_written(
    cloud_replay: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """A topic of clouds on which none came is none, as in a live recording without the sensor."""
    tape = Tape.of(cloud_replay)
    kept = tuple(entry for entry in tape.entries if entry[1] != AUGMENTED)
    run = replace(tape, entries=kept).write(tmp_path / "run")
    done = run_are("export", run, "--kitti", tmp_path / "set")
    assert done.returncode == 1
    assert "has no augmented cloud (sensors.clouds)" in done.stderr
    assert not (tmp_path / "set").exists()


def test_a_set_of_kitti_without_a_frame_is_refused(
    cloud_replay: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """With what left out all clouds, and how to record it; no folder stays behind."""
    tape = Tape.of(cloud_replay)
    kept = tuple(entry for entry in tape.entries if entry[1] not in {"/tf", "/tf_static"})
    run = replace(tape, entries=kept).write(tmp_path / "run")
    done = run_are("export", run, "--kitti", tmp_path / "set")
    assert done.returncode == 1
    assert "--kitti: no cloud can be written (" in done.stderr
    assert "the pose of its sensor or of the camera is not known" in done.stderr
    assert done.stderr.endswith("a replay records transforms and CameraInfo with --with-inputs\n")
    assert not (tmp_path / "set").exists()


class _None:
    artefacts: tuple[Any, ...] = ()


_NONE = _None()


def _xyz(cloud: Any) -> Floats:
    """Return the returns (N, 3) of a cloud."""
    data = np.asarray(cloud.data, np.uint8).reshape(-1, cloud.point_step)
    points = data[:, :12].copy().view("<f4").astype(np.float64)
    found: Floats = points[np.isfinite(points).all(axis=1)]
    return found


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--kitti", "set"), "has no augmented cloud (sensors.clouds)"),
        (("--coco", "set"), "has no mask of an image (sensors.masks: true)"),
        (("--tracks", "full"), "full: it is there already, and not empty; give a new folder"),
    ],
)
def test_what_cannot_be_written_is_refused(
    sample_replay: Path,
    run_are: RunAre,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, str],
    reason: str,
) -> None:
    """In one sentence, and nothing is lost."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    done = run_are("export", sample_replay, *words)
    assert done.returncode == 1
    assert reason in done.stderr
    assert (tmp_path / "full" / "mine.txt").read_text() == "mine"


def test_the_cloud_is_chosen_by_name(cloud_replay: Path, run_are: RunAre, tmp_path: Path) -> None:
    """A name that is not there is refused with those that are."""
    words = ("--kitti", tmp_path / "set", "--cloud", "/front")
    done = run_are("export", cloud_replay, *words)
    assert f"--kitti: there is no /front; choose one with --cloud: {AUGMENTED}" in done.stderr


@pytest.fixture(scope="module")
def image_replay(
    sample_records: Records,
    factory: RosbagsFactory,
    write_bag: WriteBag,
    run_are: RunAre,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Return the results of five seconds of the sample with a grey image at each CameraInfo."""
    folder = tmp_path_factory.mktemp("coco")
    infos = [(at, m) for topic, at, m in sample_records if topic == "/camera/camera_info"]
    images = [("/camera/image", at + 1, grey_image(factory, info)) for at, info in infos[::3]]
    records = sorted([*sample_records, *images], key=lambda record: record[1])
    bag = write_bag(folder / "bag.mcap", records)
    words = (*CROWD, "--seed", 3, "--set", "sensors.masks:=true", "--with-inputs")
    done = run_are("replay", bag, *words, "--out", folder / "out")
    assert done.returncode == 0, done.stderr
    return folder / "out"


def test_images_in_which_nobody_is_are_told(
    sample_bag: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """They are written, without annotations."""
    words = ("--set", "population.arrival_rate:=0", "--set", "sensors.masks:=true")
    out = tmp_path / "out"
    done = run_are("replay", sample_bag, *words, "--duration", 4, "--with-inputs", "--out", out)
    assert done.returncode == 0, done.stderr
    done = run_are("export", out, "--coco", tmp_path / "set")
    assert done.returncode == 0, done.stderr
    assert done.stderr.endswith("(1 image, 0 annotations); no artefact is in view in any image\n")


def grey_image(factory: RosbagsFactory, info: Any) -> Any:
    """Return an image of one grey, at the time of a CameraInfo."""
    return factory.make(
        "sensor_msgs/msg/Image",
        header=info.header,
        height=info.height,
        width=info.width,
        encoding="bgr8",
        is_bigendian=0,
        step=3 * info.width,
        data=np.full(3 * info.width * info.height, 120, np.uint8),
    )


def test_images_masks_and_boxes_of_coco_fit_together(
    image_replay: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """Decoded by hand: what a mask covers is painted, and its box is around it."""
    done = run_are("export", image_replay, "--coco", tmp_path / "set")
    assert done.returncode == 0, done.stderr
    content = json.loads((tmp_path / "set" / "annotations.json").read_text())
    names = {one["id"]: one["name"] for one in content["categories"]}
    outputs = read_outputs(image_replay / "augmented.mcap")
    pictures = {}
    for one in content["images"]:
        picture = cv2.imread(str(tmp_path / "set" / "images" / one["file_name"]))
        assert picture is not None
        assert picture.shape == (one["height"], one["width"], 3)
        pictures[one["id"]] = picture
    assert len(pictures) > 10
    assert len(content["annotations"]) > 10
    for one in content["annotations"]:
        height, width = one["segmentation"]["size"]
        counts = one["segmentation"]["counts"]
        values = np.arange(len(counts)) % 2
        mask = np.repeat(values, counts).reshape((height, width), order="F").astype(bool)
        assert mask.sum() == one["area"] > 0
        left, top, across, down = one["bbox"]
        box = mask[top : top + down, left : left + across]
        assert box.sum() == one["area"]
        assert all(edge.any() for edge in (box[0], box[-1], box[:, 0], box[:, -1]))
        is_painted = (pictures[one["image_id"]] != 120).any(axis=2)
        assert is_painted[mask].mean() > 0.95
        state = outputs.kinds[one["artefact_id"]]
        assert (names[one["category_id"]], one["label"]) == (state.class_name, state.label)


def test_images_and_masks_that_are_alone_are_told(
    image_replay: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """As where images passed through, or their topic was not recorded; no empty set is left."""
    tape, image = Tape.of(image_replay), "/ar_builder/camera/image"
    places = {
        topic: [k for k, entry in enumerate(tape.entries) if entry[1] == topic]
        for topic in (image, f"{image}/mask")
    }
    images, masks = places[image], places[f"{image}/mask"]
    alone = len(images) - len(masks) + 3
    for lacking, status, said in (
        (masks[:3], 0, f"; {alone} images of {image} without a mask left out\n"),
        (images, 1, f"({len(masks)} masks without an image of {image} left out)\n"),
    ):
        kept = tuple(entry for k, entry in enumerate(tape.entries) if k not in lacking)
        run = replace(tape, entries=kept).write(tmp_path / f"run {len(lacking)}")
        done = run_are("export", run, "--coco", tmp_path / f"set {len(lacking)}")
        assert (done.returncode, done.stderr.endswith(said)) == (status, True), done.stderr
        assert (tmp_path / f"set {len(lacking)}").exists() == (status == 0)


def _scene(stamp_ns: int, arrival_ns: int, class_name: str, x_m: float) -> Scene:
    """Return a tick with the artefact 1."""
    numbers = np.zeros((1, 3))
    return Scene(
        stamp_ns=stamp_ns,
        at_ns=stamp_ns,
        frame_id="map",
        ids=np.array([1]),
        centres_m=numbers,
        yaws_rad=numbers[:, 0],
        half_sizes_m=numbers + 1.0,
        arrivals_ns=np.array([arrival_ns]),
        departures_ns=np.array([0]),
        classes=(class_name,),
        poses=np.array([(x_m, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)]),
        labels=("a",),
    )


def test_the_class_of_coco_is_that_of_the_life_at_the_time(tmp_path: Path) -> None:
    """A node that was started again gives ids another time."""
    writer = CocoWriter(tmp_path)
    writer.learn(_scene(10, 5, "person", 0.0))
    for stamp_ns in (4, 10, 30):  # the first image may be of before the first tick
        pixels = np.zeros((2, 2, 3), np.uint8)
        writer.add(stamp_ns, pixels, np.array(((1, 0), (0, 2)), np.int32))
    writer.learn(_scene(20, 15, "car", 0.0))
    assert writer.finish() == 3
    content = json.loads((tmp_path / "annotations.json").read_text())
    names = {one["id"]: one["name"] for one in content["categories"]}
    told = [names[one["category_id"]] for one in content["annotations"]]
    assert told == ["person", "person", "car"]


def test_between_two_lives_of_an_id_nobody_is() -> None:
    """Nor on the way from the place of the one to that of the other."""
    ticks = [_scene(10, 5, "a", 0.0), _scene(20, 5, "a", 1.0), _scene(30, 25, "a", 9.0)]
    first, second, third = (TrueTick(scene, {}, None) for scene in ticks)
    assert Interval(first, second).poses_at(15)[1][1][0] == 0.5
    assert Interval(second, third).poses_at(25) == {}


def test_calibration_of_kitti_turns_what_a_rectified_image_shows(
    cloud_replay: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """P2 has the rotation R of the CameraInfo in it, about which a rectified image is turned."""
    turn = cv2.Rodrigues(np.array((0.05, -0.12, 0.03)))[0]
    tape = Tape.of(cloud_replay)

    def rectify(info: Any) -> None:
        info.r, info.p = turn.ravel(), np.column_stack((info.k.reshape(3, 3), np.zeros(3))).ravel()

    intrinsics = tape.last("/camera/camera_info").k.reshape(3, 3)
    parameters = tmp_path / "effective.yaml"
    text = tape.parameters.read_text(encoding="utf-8")
    assert "rectified: false" in text
    parameters.write_text(text.replace("rectified: false", "rectified: true"), encoding="utf-8")
    turned = tape.edited("/camera/camera_info", rectify, 0.0, 99.0)
    projections = []
    for number, one in enumerate((tape, replace(turned, parameters=parameters))):
        folder = tmp_path / f"set_{number}"
        run = one.write(tmp_path / f"run_{number}")
        assert run_are("export", run, "--kitti", folder).returncode == 0
        calibration = read_frame(folder / "training", "000000")[2]
        projections.append(calibration["P2"].reshape(3, 4))
    plain, rectified = projections
    expected = intrinsics @ turn @ np.linalg.inv(intrinsics) @ plain
    assert rectified == pytest.approx(expected, abs=1e-6)
    assert not np.allclose(rectified, plain, atol=1.0)
