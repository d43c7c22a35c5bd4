"""A recording of the simulated robot: its messages, their times and their frames."""

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from are_ros.conventions import NS_PER_S
from are_ros.messages.common import read_time
from are_ros.messages.images.image import read_camera_info
from are_ros.messages.maps import read_grid
from are_ros.messages.sensors import read_cloud, read_scan
from are_ros.messages.transforms import read_odometry_numbers, read_transforms
from are_ros.world.transforms.tree import FrameTree
from bags.simulation.building import Building
from bags.simulation.frames import (
    BASE_FRAME,
    CAMERA_FRAME,
    CAMERA_INFO,
    MAP_FRAME,
    ODOM_FRAME,
    SCAN_FRAME,
)
from bags.simulation.office import OFFICE_START
from bags.simulation.topics import MAX_LATENCY_NS

START_NS = 1_700_000_000 * NS_PER_S
SECONDS = 4.0
Sink = Any
"""The `ListSink` of conftest, which tests cannot import."""


@pytest.fixture(scope="module")
def recording(record_office: Callable[[float, int], Sink]) -> Sink:
    """Return the first four seconds of the tour."""
    return record_office(SECONDS, START_NS)


def stamp_ns(message: Any) -> int:
    """Return the stamp of a message, of a TFMessage that of its first transform."""
    stamped = message.transforms[0] if hasattr(message, "transforms") else message
    return read_time(stamped.header.stamp)


def test_every_topic_has_its_rate(recording: Sink) -> None:
    """30 Hz of odometry, 10 Hz of sensors and corrections, maps and joints once and latched."""
    counts = Counter(topic for topic, _, _ in recording.messages)
    assert counts == {
        "/map": 1,
        "/octomap_point_cloud_centers": 1,
        "/tf_static": 1,
        "/tf": 4 * (30 + 10),
        "/odom": 4 * 30,
        "/scan": 4 * 10,
        "/camera/camera_info": 4 * 10,
    }
    assert set(recording.topics) == set(counts)
    assert recording.latched == {"/map", "/octomap_point_cloud_centers", "/tf_static"}


def test_messages_arrive_in_order_and_after_their_stamps(recording: Sink) -> None:
    """Log times ascend from the start; latencies are a few milliseconds, and scans wait for tf."""
    times = [when_ns for _, when_ns, _ in recording.messages]
    assert times == sorted(times)
    assert times[0] == START_NS
    assert times[-1] < START_NS + SECONDS * NS_PER_S + MAX_LATENCY_NS
    for _, when_ns, message in recording.messages:
        assert 0 < when_ns - stamp_ns(message) <= MAX_LATENCY_NS
    scans = {stamp_ns(message): when_ns for when_ns, message in recording.of("/scan")}
    corrections = {
        stamp_ns(message): when_ns
        for when_ns, message in recording.of("/tf")
        if message.transforms[0].child_frame_id == ODOM_FRAME
    }
    assert scans.keys() == corrections.keys()
    assert all(0 < corrections[stamp] - when_ns < 25e6 for stamp, when_ns in scans.items())


def test_the_frames_are_connected(recording: Sink) -> None:
    """From the map to both sensors at each scan's stamp; the base starts where the tour does."""
    tree = FrameTree()
    for _, message in recording.of("/tf_static"):
        for joint in read_transforms(message):
            tree.set_static(joint.parent, joint.child, joint.translation_m, joint.rotation_xyzw)
    for _, message in recording.of("/tf"):
        for edge in read_transforms(message):
            tree.set_transform(
                edge.parent, edge.child, edge.stamp_ns, edge.translation_m, edge.rotation_xyzw
            )
    stamps = [stamp_ns(message) for _, message in recording.of("/scan")]
    for frame, height_m in ((SCAN_FRAME, 0.2), (CAMERA_FRAME, 0.9)):
        heights_m = [tree.lookup(MAP_FRAME, frame, ns).translation_m[2] for ns in stamps[:-1]]
        assert heights_m == pytest.approx([height_m] * len(heights_m))
    base = tree.lookup(MAP_FRAME, BASE_FRAME, stamps[0])
    start = OFFICE_START
    assert base.translation_m.tolist() == pytest.approx([start.x_m, start.y_m, 0.0], abs=0.01)


def test_odometry_and_tf_say_the_same(recording: Sink) -> None:
    """/odom repeats odom -> base_footprint, stamp by stamp, and reports the speed."""
    edges = {
        edge.stamp_ns: edge
        for _, message in recording.of("/tf")
        for edge in read_transforms(message)
        if edge.child == BASE_FRAME
    }
    messages = [message for _, message in recording.of("/odom")]
    for numbers in map(read_odometry_numbers, messages):
        assert (numbers.frame_id, numbers.child_frame_id) == (ODOM_FRAME, BASE_FRAME)
        edge = edges[numbers.stamp_ns]
        assert numbers.pose == (*edge.translation_m, *edge.rotation_xyzw)
    assert messages[-1].twist.twist.linear.x == pytest.approx(0.6, abs=0.05)


def test_the_messages_hold_the_building_and_the_sensors(recording: Sink, office: Building) -> None:
    """Map, cloud, scan and camera come back as they went in."""
    (_, grid), (_, cloud) = recording.of("/map")[0], recording.of("/octomap_point_cloud_centers")[0]
    assert np.array_equal(read_grid(grid).cells, office.grid().cells)
    assert cloud.header.frame_id == MAP_FRAME
    assert len(read_cloud(cloud).points_m()) > 20_000
    scan = read_scan(recording.of("/scan")[0][1])
    assert (len(scan.ranges), scan.frame_id) == (360, SCAN_FRAME)
    info = recording.of("/camera/camera_info")[0][1]
    assert read_camera_info(info) == CAMERA_INFO
    assert info.header.frame_id == CAMERA_FRAME
