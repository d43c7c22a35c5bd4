"""The recording in bags/, and the program that makes it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from are_ros.bag.reader import BagMessage, BagReader
from are_ros.messages.maps import read_grid
from are_ros.messages.sensors import read_cloud, read_scan
from are_ros.replay.survey.inspection import inspect_bag

PROJECT = Path(__file__).resolve().parents[2]
PROGRAM = "bags.make_sample_bag"
SAMPLE = PROJECT / "bags/sample_office.mcap"


def make(path: Path, *options: str) -> Path:
    """Run the program and return what it wrote."""
    command = [sys.executable, "-m", PROGRAM, "--out", str(path), *options]
    subprocess.run(command, check=True, capture_output=True, cwd=PROJECT)
    return path


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a full recording, made now."""
    return make(tmp_path_factory.mktemp("bag") / "fresh.mcap")


@pytest.mark.long
def test_the_program_writes_the_same_bytes_each_time(tmp_path: Path) -> None:
    """Two short recordings, in different folders."""
    (tmp_path / "elsewhere").mkdir()
    one = make(tmp_path / "one.mcap", "--duration", "2")
    other = make(tmp_path / "elsewhere/other.mcap", "--duration", "2")
    assert one.read_bytes() == other.read_bytes()


def messages(reader: BagReader, *topics: str) -> list[BagMessage]:
    """Return the messages of some topics."""
    return list(reader.messages(topics))


def test_the_committed_recording_is_what_the_program_makes(fresh: Path) -> None:
    """Topics, counts and maps are equal, the scans but for noise.

    Another version of numpy may draw other noise, so other bytes are no failure.
    """
    latched = ("/map", "/octomap_point_cloud_centers", "/tf_static")
    with BagReader([SAMPLE]) as committed, BagReader([fresh]) as now:
        assert committed.topics == now.topics
        assert committed.start_ns == now.start_ns
        for old, new in zip(messages(committed, *latched), messages(now, *latched), strict=True):
            assert (old.topic, old.log_time_ns, old.data) == (new.topic, new.log_time_ns, new.data)
        for old, new in zip(messages(committed, "/scan"), messages(now, "/scan"), strict=True):
            scans = read_scan(committed.deserialize(old)), read_scan(now.deserialize(new))
            assert scans[0].stamp_ns == scans[1].stamp_ns
            both = np.isfinite(scans[0].ranges) & np.isfinite(scans[1].ranges)
            assert both.sum() > 300
            assert np.median(np.abs(scans[0].ranges[both] - scans[1].ranges[both])) < 0.05


def test_a_replay_lacks_nothing_in_it() -> None:
    """Every role is found, images as the only ones; and the frames from map to base are there."""
    with BagReader([SAMPLE]) as reader:
        inspection = inspect_bag(reader)
    assert inspection.missing == ()
    said = inspection.roles.sentences()
    assert [(line.partition(":")[0], " is used: there is no /" in line) for line in said] == [
        ("depth", True),
        ("image", True),
    ]
    assert (inspection.map_frame, inspection.base_frame) == ("map", "base_footprint")
    assert SAMPLE.stat().st_size < 3e6


def test_other_tools_open_it() -> None:
    """The library rosbags reads map and voxels with the types that the file brings along."""
    with AnyReader([SAMPLE]) as reader:
        found = {
            connection.topic: reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages(
                [c for c in reader.connections if c.msgcount == 1]
            )
        }
    assert found.keys() == {"/map", "/octomap_point_cloud_centers", "/tf_static"}
    assert read_grid(found["/map"]).cells.shape == (240, 340)
    assert len(read_cloud(found["/octomap_point_cloud_centers"]).points_m()) > 20_000
    assert len(found["/tf_static"].transforms) == 4
