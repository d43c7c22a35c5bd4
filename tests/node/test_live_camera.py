"""The camera of the live node: told by CameraInfo, or the default where nobody tells it."""

from collections.abc import Callable
from typing import Any

import pytest

from tests.ros import NOT_SET_UP

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from tests.node.live_bench import Bench
from tests.node.live_scene import camera_info, pose_at, robot_at, room

MakeBench = Callable[..., Bench]
UNHEARD = "nobody publishes CameraInfo"


def looking(make_bench: MakeBench, *, has_camera: bool) -> tuple[Bench, list[Any]]:
    """Return an active node before which a post stands, and the lists of what it perceives."""
    bench = make_bench({"camera.model": "auto"}, "configure", "activate")
    perceived = bench.listen("perceived")
    bench.clock(1000.0)
    bench.send("map", room())
    bench.send("tf", robot_at(1000.0))
    if has_camera:
        bench.publisher("camera/camera_info")
    bench.tick(1000.1)
    assert bench.spawn(pose_at(2.55, 2.05), label="post").success
    return bench, perceived


def test_without_a_camera_the_default_one_looks(make_bench: MakeBench) -> None:
    """After some seconds in which nobody offered a CameraInfo; it is said."""
    bench, perceived = looking(make_bench, has_camera=False)
    assert perceived[-1].artefacts == []
    for tick in range(2, 22):  # a machine under load takes longer
        bench.turn_for(0.5)
        now_s = 1000.0 + 0.1 * tick
        bench.send("tf", robot_at(now_s))
        bench.tick(now_s)
        if perceived[-1].artefacts:
            break
    assert tick > 4
    assert len(perceived[-1].artefacts) == 1
    bench.until(lambda: any(f"{UNHEARD}: a pinhole" in said for said in bench.warnings()))


def test_before_there_is_a_map_a_camera_is_not_missed(make_bench: MakeBench) -> None:
    """A robot that is started after the node is found bit by bit: there is a grace from then on."""
    bench = make_bench({"camera.model": "auto"}, "configure", "activate")
    bench.clock(1000.0)
    bench.turn_for(5.5)
    bench.send("map", room())
    bench.turn_for(2.5)
    bench.send("camera/camera_info", camera_info(1000.2))
    bench.turn_for(3.5)
    assert not any(UNHEARD in said for said in bench.warnings())


def test_a_camera_that_is_offered_is_waited_for(make_bench: MakeBench) -> None:
    """Nothing is perceived before it has told what it is."""
    bench, perceived = looking(make_bench, has_camera=True)
    bench.turn_for(4.5)
    bench.send("tf", robot_at(1000.2))
    bench.tick(1000.2)
    assert perceived[-1].artefacts == []
    bench.send("camera/camera_info", camera_info(1000.2))
    bench.send("tf", robot_at(1000.3))
    bench.tick(1000.3)
    assert not any(UNHEARD in said for said in bench.warnings())


FRONT_AND_REAR = (
    "0 0 0.8 -1.57079633 0 -1.57079633 base_link front_optical",
    "0 0 0.8 1.57079633 0 -1.57079633 base_link rear_optical",
)
TWO_CAMERAS = {
    "camera.model": "auto",
    "camera.others": ["rear/camera_info"],
    "camera.other_rates": [10.0],
    "frames.static": [*FRONT_AND_REAR],
}


def test_two_cameras_see_before_and_behind(make_bench: MakeBench) -> None:
    """What either sees is perceived, with its optical frame; of another size, too."""
    bench = make_bench(TWO_CAMERAS, "configure", "activate")
    perceived = bench.listen("perceived")
    bench.clock(1000.0)
    bench.send("map", room())
    bench.send("tf", robot_at(1000.0, x=2.0))
    bench.tick(1000.1)
    ahead = bench.spawn(pose_at(3.05, 2.05), label="post").id
    behind = bench.spawn(pose_at(0.95, 2.05), label="post").id

    def seen_at(t_s: float) -> dict[int, list[str]]:
        bench.send("tf", robot_at(t_s, x=2.0))
        bench.tick(t_s)
        return {one.id: list(one.cameras) for one in perceived[-1].artefacts}

    bench.send("camera/camera_info", camera_info(1000.2, frame_id="front_optical"))
    assert seen_at(1000.2) == {ahead: ["front_optical"]}
    rear = camera_info(1000.3, 32, 24, "rear_optical")
    bench.send("other_camera_info", rear, topic="/rear/camera_info")
    assert seen_at(1000.3) == {ahead: ["front_optical"], behind: ["rear_optical"]}
    (pixels,) = (one.roi for one in perceived[-1].artefacts if one.id == behind)
    assert pixels.x_offset + pixels.width <= 32
    assert bench.warnings() == []
