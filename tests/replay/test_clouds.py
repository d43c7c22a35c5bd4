"""Replays of a recording with point clouds, organised and not, judged by `are check`."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from are_ros.bag.reader import BagReader
from are_ros.messages.sensors import read_cloud
from bags.simulation.making import RosbagsFactory, make_cloud
from tests.replay.conftest import MANY, Records, RunAre, WriteBag

CLOUD, AUGMENTED = "/velodyne_points", "/ar_builder/points"
ELEVATIONS = np.radians((0.0, 3.0, 6.0, 9.0))


def cloud_of(scan: Any, factory: RosbagsFactory, *, is_organised: bool) -> Any:
    """Return a cloud of four rings where the walls of a scan are; the first is the scan itself."""
    ranges = np.array(scan.ranges, np.float64)
    is_return = (ranges >= scan.range_min) & (ranges <= scan.range_max)
    angles = scan.angle_min + np.arange(len(ranges)) * scan.angle_increment
    ranges[~is_return] = np.nan
    flat = np.stack((ranges * np.cos(angles), ranges * np.sin(angles)), axis=1)
    rings = [np.column_stack((flat, ranges * math.tan(e))) for e in ELEVATIONS.tolist()]
    points_m = np.concatenate(rings)
    if not is_organised:
        points_m = points_m[np.isfinite(points_m).all(axis=1)]
    message = make_cloud(factory, scan.header.frame_id, 0, points_m.astype(np.float32))
    message.header.stamp = scan.header.stamp
    if is_organised:
        message.height, message.width = len(ELEVATIONS), len(ranges)
        message.row_step = message.width * message.point_step
    return message


@pytest.fixture(scope="module", params=[False, True], ids=["unorganised", "organised"])
def replay(
    request: pytest.FixtureRequest,
    sample_records: Records,
    factory: RosbagsFactory,
    write_bag: WriteBag,
    run_are: RunAre,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Return the results of five seconds of the sample with a cloud beside each scan."""
    folder = tmp_path_factory.mktemp("clouds")
    records = [
        entry
        for topic, log_ns, message in sample_records
        for entry in (
            [(topic, log_ns, message)]
            + (
                [(CLOUD, log_ns + 1, cloud_of(message, factory, is_organised=request.param))]
                if topic == "/scan"
                else []
            )
        )
    ]
    bag = write_bag(folder / "bag.mcap", records)
    done = run_are("replay", bag, *MANY, "--seed", 3, "--with-inputs", "--out", folder / "out")
    assert done.returncode == 0, done.stderr
    assert f"points: {CLOUD}, the only" in done.stdout + done.stderr
    return folder / "out"


def by_stamp(recording: Path, topic: str) -> dict[tuple[int, int], Any]:
    """Return the messages of a topic by their stamps."""
    with BagReader([recording]) as reader:
        messages = [reader.deserialize(m) for m in reader.messages(topics=[topic])]
    return {(one.header.stamp.sec, one.header.stamp.nanosec): one for one in messages}


def test_clouds_pass_the_checks(replay: Path, run_are: RunAre) -> None:
    """Each changed point ends at an artefact, on its own ray, and before walls."""
    done = run_are("check", replay)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_ring_is_the_scan(replay: Path) -> None:
    """The level ring sees just what the augmented scan sees, return by return."""
    before, after, scans = (
        by_stamp(replay / "augmented.mcap", topic)
        for topic in (CLOUD, AUGMENTED, "/ar_builder/scan")
    )
    moved = 0
    assert len(after) > 20
    for stamp, cloud in after.items():
        points_m, was_m = read_cloud(cloud).points_m(), read_cloud(before[stamp]).points_m()
        scan = scans[stamp]
        level = np.isfinite(points_m).all(axis=1) & (np.abs(points_m[:, 2]) < 1e-4)
        level[len(was_m) :] = False
        angles = np.arctan2(points_m[level, 1], points_m[level, 0])
        beams = np.rint((angles - scan.angle_min) / scan.angle_increment).astype(int)
        ranges = np.asarray(scan.ranges)[beams % len(scan.ranges)]
        kept = np.isfinite(ranges)  # too close for the laser: -inf in the scan
        np.testing.assert_allclose(np.hypot(*points_m[level, :2].T)[kept], ranges[kept], atol=1e-5)
        moved += np.count_nonzero((points_m[: len(was_m)] != was_m)[level[: len(was_m)]])
    assert moved > 100
