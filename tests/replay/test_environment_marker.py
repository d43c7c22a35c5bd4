"""The environment's surface in a replay's recording, and what `are check` says of it."""

import numpy as np
import pytest

from are_ros.bag.reader import BagReader
from are_ros.bag.types import jazzy_typestore
from tests.replay.conftest import ReplaySample, RunAre

MARKERS = "/ar_builder/markers"


def test_a_replay_writes_the_surface_once_and_the_checks_pass(
    replay_sample: ReplaySample, run_are: RunAre
) -> None:
    """Read by rosbags; it is endless, has no colours of its own, and reaches as far as the map."""
    out = replay_sample("--with-inputs", "--set", "markers.environment:=true")
    store, found = jazzy_typestore(), []
    with BagReader([out / "augmented.mcap"]) as reader:
        for message in reader.messages([MARKERS]):
            array = store.deserialize_cdr(bytes(message.data), "visualization_msgs/msg/MarkerArray")
            found += [marker for marker in array.markers if marker.ns == "environment"]
    (surface,) = found
    assert (surface.type, surface.action, surface.id) == (11, 0, 0)
    assert (surface.lifetime.sec, surface.lifetime.nanosec) == (0, 0)
    assert (surface.header.frame_id, len(surface.colors)) == ("map", 0)
    assert surface.color.a == 1.0
    points = np.array([(point.x, point.y, point.z) for point in surface.points])
    assert len(points) % 3 == 0
    assert (*points.min(axis=0), *points.max(axis=0)) == pytest.approx((0, 0, -0.1, 16, 11, 2.4))
    done = run_are("check", out)
    assert done.returncode == 0, done.stdout
    for name in ("marker rules", "markers of the living", "markers fade"):
        assert f"{name}: passed" in done.stdout
