"""Several cameras on one robot: the sample with a second one that looks to the right."""

import copy
import json
from pathlib import Path

import numpy as np
import pytest

from are_ros.bag.recording import Recording, find_recording
from are_ros.draw.robot import other_fans, walls_of
from are_ros.replay.recorded_scene import read_recorded_scene
from tests.replay.conftest import Records, RunAre, WriteBag

RIGHT = (
    "0 -0.2 0.8 -1.2 0 0 base_link right_link",
    "0 0 0 -1.57079633 0 -1.57079633 right_link right_optical",
)
CROWD = ("--set", "population.arrival_rate:=0.06", "--set", "population.mean_life:=4", "--seed", 3)
TWO = (
    *("--set", f"frames.static:={json.dumps(RIGHT)}"),
    *("--set", "camera.others:=[right/camera_info]", "--set", "camera.other_rates:=[5.0]"),
)


@pytest.fixture(scope="module")
def bag(
    tmp_path_factory: pytest.TempPathFactory, sample_records: Records, write_bag: WriteBag
) -> Path:
    """Return the sample with a camera that looks to the right, on /right/camera_info."""
    added = []
    for topic, at_ns, message in sample_records:
        if topic == "/camera/camera_info":
            info = copy.deepcopy(message)
            info.header.frame_id = "right_optical"
            added.append(("/right/camera_info", at_ns, info))
    records = sorted([*sample_records, *added], key=lambda record: record[1])
    return write_bag(tmp_path_factory.mktemp("two") / "two.mcap", records)


def test_perceived_is_what_either_camera_sees_and_the_check_knows_their_images(
    bag: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """What the front camera tells is the same with and without the other."""
    seen = {}
    for name, words in (("one", ()), ("two", TWO)):
        out, how = tmp_path / name, (*CROWD, *words, "--with-inputs")
        done = run_are("replay", bag, *how, "--out", out)
        assert done.returncode == 0, done.stderr
        with Recording(find_recording(out)) as recording:
            lists = [recording.decode(m) for m in recording.messages({"/ar_builder/perceived"})]
        seen[name] = {(at.stamp_ns, one.artefact_id): one for at in lists for one in at.sightings}
    front = {key: one for key, one in seen["two"].items() if "right_optical" not in one.cameras}
    both = {one.cameras for one in seen["two"].values()}
    assert ("right_optical",) in both
    assert len(seen["one"]) > 20
    assert front == seen["one"]
    _compare_views(tmp_path / "two")
    checked = run_are("check", tmp_path / "two")
    assert checked.returncode == 0, checked.stdout


def _compare_views(out: Path) -> None:
    """Compare what is drawn of a recording with how its cameras are mounted, 1.2 rad apart."""
    scene = read_recorded_scene(out, lambda *_: lambda _: None)
    record = scene.record
    assert len(record.others) > 0.9 * len(record.camera)
    stamp_ns = next(iter(record.others))
    (right,) = record.moment(stamp_ns).others
    front = record.camera.transform_at(stamp_ns)
    assert front is not None
    assert right.number == 1
    assert right.view == record.views[0]
    looks = [pose.rotation_matrix()[:, 2] for pose in (front, right.map_from_camera)]
    assert np.cross(looks[0], looks[1])[2] == pytest.approx(-np.sin(1.2), abs=0.01)
    walls = walls_of(scene.grid, 65)
    assert len(other_fans(record, walls, stamp_ns)) == 1


def test_a_camera_that_is_not_recorded_is_named(bag: Path, run_are: RunAre, tmp_path: Path) -> None:
    """In a sentence, with those that are."""
    how = ("--set", "camera.others:=[left/camera_info]", "--out", tmp_path / "none")
    done = run_are("replay", bag, *how)
    assert done.returncode != 0
    assert "no CameraInfo '/left/camera_info'; it has: /camera/camera_info" in done.stderr
