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
