"""Painted images of the live node, and the truth beside them, over DDS."""

from array import array
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.ros import NOT_SET_UP

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from tests.node.live_bench import Bench, stamp_ns
from tests.node.live_scene import FACTORY, camera_info, pose_at, robot_at, room

MakeBench = Callable[..., Bench]
OUT = "camera/image"
TOLD = {
    f"{OUT}/mask": "sensor_msgs/msg/Image",
    f"{OUT}/truth": "are_msgs/msg/ImageTruth",
    f"{OUT}/boxes": "vision_msgs/msg/Detection2DArray",
    "artefacts/boxes": "vision_msgs/msg/Detection3DArray",
    "perceived/boxes": "vision_msgs/msg/Detection3DArray",
}
WITH_TRUTH = {
    "sensors.depths": [],  # an image would wait for the first depth image
    "sensors.images": ["front/image_rect"],
    "sensors.masks": True,
    "sensors.boxes": True,
}


def send_image(bench: Bench, t_s: float) -> Any:
    """Send a grey image of a camera on the robot's base, and its CameraInfo."""
    info = camera_info(t_s, frame_id="base_link")
    info.r = np.array([0.0, -1, 0, 0, 0, -1, 1, 0, 0])  # the rectified image looks along x
    image = FACTORY.make(
        "sensor_msgs/msg/Image",
        header=info.header,
        height=48,
        width=64,
        encoding="mono8",
        step=64,
        data=array("B", bytes([120]) * (48 * 64)),
    )
    bench.send("tf", robot_at(t_s))
    bench.send("camera_info", info, topic="/front/camera_info")
    bench.send("image", image, topic="/front/image_rect")
    return image


def before_a_post(make_bench: MakeBench, values: dict[str, Any]) -> Bench:
    """Return an active node whose robot stands 1.3 m before a post."""
    bench = make_bench(WITH_TRUTH | values, "configure", "activate")
    bench.send("map", room())
    bench.clock(1000.0)
    bench.send("tf", robot_at(1000.0))
    bench.tick(1000.1)
    assert bench.spawn(pose_at(2.5, 2.0), label="post").success
    bench.tick(1000.2)
    return bench


def test_the_truth_goes_beside_each_painted_image(make_bench: MakeBench) -> None:
    """Mask, fractions and boxes say the same, with the image's header; 3D boxes with each tick."""
    bench = before_a_post(make_bench, {})
    images = bench.listen(OUT, "sensor_msgs/msg/Image")
    heard = {name: bench.listen(name, kind) for name, kind in TOLD.items()}
    sent = send_image(bench, 1000.3)
    bench.tick(1000.3)
    bench.until(lambda: images and all(heard.values()))
    assert bytes(images[-1].data) != bytes(sent.data)
    mask, truth, boxes = (heard[f"{OUT}/{name}"][-1] for name in ("mask", "truth", "boxes"))
    assert [one.header for one in (mask, truth, boxes)] == [sent.header] * 3
    ids = np.array(mask.data).view("<i4").reshape(48, 64)
    (post,), (box,) = truth.artefacts, boxes.detections
    assert (post.id, post.class_name) == (10**9, "thing")
    assert (box.id, box.results[0].hypothesis.class_id) == (str(10**9), "thing")
    rows, columns = np.nonzero(ids == post.id)
    assert post.visible_pixels == len(rows) > 100
    assert post.visible_fraction == pytest.approx(1.0)
    assert (post.roi.x_offset, post.roi.width) == (columns.min(), np.ptp(columns) + 1)
    assert box.bbox.size_y == post.roi.height == np.ptp(rows) + 1
    assert box.bbox.center.position.x == post.roi.x_offset + 0.5 * post.roi.width
    assert post.box.position.x == pytest.approx(1.5)  # along the robot's x, as its frame has it
    for name in ("artefacts/boxes", "perceived/boxes"):
        (tall,) = heard[name][-1].detections
        assert stamp_ns(heard[name][-1]) == 1_000_300_000_000
        assert (tall.id, tall.results[0].hypothesis.score) == (str(10**9), 1.0)
        at = tall.bbox.center.position
        assert (at.x, at.y, at.z) == pytest.approx((2.5, 2.0, 0.8))


def test_without_vision_msgs_there_are_no_boxes_of_it(
    make_bench: MakeBench, without_packages: Callable[..., None]
) -> None:
    """It says which, once each; the mask and the truth of are_msgs come as ever."""
    without_packages("vision_msgs")
    bench = before_a_post(make_bench, {})
    said = [one for one in bench.warnings() if "vision_msgs" in one]
    missing = {name for name, kind in TOLD.items() if kind.startswith("vision_msgs")}
    assert {one.partition(" ")[0] for one in said} == {f"~/{name}" for name in missing}
    assert all("'sudo apt install ros-jazzy-vision-msgs' installs it" in one for one in said)
    kept = TOLD.keys() - missing
    heard = [bench.listen(name, TOLD[name]) for name in kept]
    send_image(bench, 1000.3)
    bench.tick(1000.3)
    bench.until(lambda: all(heard))
    assert bench.user.count_publishers(f"/ar_builder/{OUT}/boxes") == 0


def test_the_truth_is_told_by_choice(make_bench: MakeBench) -> None:
    """With the defaults there is neither mask nor box, and nothing is said of vision_msgs."""
    bench = before_a_post(make_bench, {"sensors.masks": False, "sensors.boxes": False})
    images = bench.listen(OUT, "sensor_msgs/msg/Image")
    send_image(bench, 1000.3)
    bench.tick(1000.3)
    bench.until(lambda: images)
    assert not any(bench.user.count_publishers(f"/ar_builder/{name}") for name in TOLD)
