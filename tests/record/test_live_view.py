"""The live viewer beside a running node, over DDS: what it hears, and what it changes."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from types import SimpleNamespace

import pytest

from tests.ros import NOT_SET_UP, WAIT_S, nap, wait_until

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from are_ros.draw.viewer import MISSING_VISER, has_viser, start_server, stop_server
from are_ros.errors import NodeError
from are_ros.node.startup import executor_of, ros_session
from are_ros.parameters.declaration import describe
from are_ros.parameters.model import Parameters
from are_ros.record.live_view import LiveView, RemoteNode, remapped, slider_range
from tests.record.live_runs import SAMPLE

INFO, IMAGE = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/CompressedImage"
needs_viser = pytest.mark.skipif(not has_viser(), reason=MISSING_VISER)


@contextmanager
def running(*words: object) -> Iterator["subprocess.Popen[bytes]"]:
    """Run `are` as a process of its own, and end it."""
    command = [sys.executable, "-m", "are_ros", *map(str, words)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(command, **quiet)  # type: ignore[call-overload]
    try:
        yield process
    finally:
        process.terminate()
        process.wait(WAIT_S)


@contextmanager
def looking(
    namespace: str = "",
) -> Iterator[tuple[LiveView, RemoteNode, Callable[[Callable[[], bool]], None]]]:
    """Open the live viewer; the callable goes on until something is the case."""
    server = start_server(0)
    try:
        with ros_session("are_viewer") as node, executor_of(node) as executor:
            remote = RemoteNode(node, executor, namespace, lambda: False)
            live = LiveView(server, remote, remote.parameters())

            def until(is_so: Callable[[], bool]) -> None:
                end_s = time.monotonic() + 2.0 * WAIT_S
                while not is_so():
                    assert time.monotonic() < end_s
                    executor.spin_once(timeout_sec=0.05)
                    live.work()

            yield live, remote, until
    finally:
        stop_server(server)


@needs_viser
def test_it_shows_the_running_node_and_changes_what_can_change(ros_available: None) -> None:
    """Artefacts come into view; a parameter, the pause and a click reach the node."""
    del ros_available
    node = ("node", "--params", SAMPLE.with_suffix(".yaml"), "--use-sim-time")
    play = ("play", SAMPLE, "--loop", "--rate", 1, "--wait-for", "/ar_builder")
    with running(*node) as process, running(*play), looking() as (live, remote, until):
        until(lambda: bool(live.ticks) and len(live.ticks[-1].artefacts) > 0)
        until(lambda: any(tick.map_from_base is not None for tick in live.ticks))
        until(lambda: any(tick.map_from_camera is not None for tick in live.ticks))
        until(lambda: any(tick.scans for tick in live.ticks))

        assert remote.set_parameter("population.mean_life", 77.0) == ""
        assert remote.parameters().population.mean_life == pytest.approx(77.0)
        assert "below" in remote.set_parameter("population.mean_life", 0.0)
        until(lambda: live.sliders["population.mean_life"].value == pytest.approx(77.0))
        assert remote.set_parameter("population.mean_life", 1e6) == ""
        until(lambda: live.sliders["population.mean_life"].value == pytest.approx(1e6))

        live.take_clicks(is_on=True)
        (entry,) = live._server.scene._scene_pointer_cb  # viser calls it for the click of a browser
        entry.callback(SimpleNamespace(ray_origin=(0.0, 0.0, 5.0), ray_direction=(0.0, 0.0, -1.0)))
        until(lambda: live.answer != "")
        # The place may be taken: then the node refuses, and the reason names the place.
        assert "stands" in live.answer or "0.00, 0.00" in live.answer

        assert "paused" in live.pause(is_paused=True)
        until(lambda: len(live.ticks[-1].artefacts) == 0)

        process.terminate()
        until(lambda: live.counts.content.startswith("nothing comes from /ar_builder: "))
        with running(*node, "--set", "population.mean_life:=55.0"):
            until(lambda: live.sliders["population.mean_life"].value == pytest.approx(55.0))
            assert live.answer == "/ar_builder is there again"


@needs_viser
def test_a_robot_may_have_a_namespace_and_its_transforms_there(ros_available: None) -> None:
    """As Nav2 starts several robots; who names no namespace is told of it."""
    del ros_available
    node = ["node", "--params", SAMPLE.with_suffix(".yaml"), "--use-sim-time"]
    node += ["--namespace", "robot", "--ros-args", "-r", "/tf:=tf", "-r", "/tf_static:=tf_static"]
    topics = ("/tf", "/tf_static", "/map", "/scan", "/odom", "/camera/camera_info")
    play = ["play", SAMPLE, "--loop", "--wait-for", "/robot/ar_builder"]
    play += [word for topic in topics for word in ("--remap", f"{topic}:=/robot{topic}")]
    with running(*node), running(*play):
        with looking("robot") as (live, _, until):
            until(lambda: any(tick.map_from_camera is not None for tick in live.ticks))
            until(lambda: any(tick.scans for tick in live.ticks))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("are_ros.record.live_view._PATIENCE_S", 8.0)
            with (
                pytest.raises(NodeError, match=r"--namespace names that of /robot/ar_builder"),
                looking(),
            ):
                pass


@needs_viser
def test_what_the_node_hears_by_other_names_is_shown(ros_available: None) -> None:
    """Map, scan, odometry and camera are remapped, as robots have names of their own."""
    del ros_available
    topics = {
        "/map": "/world/map",
        "/scan": "/front/scan",
        "/odom": "/wheels/odom",
        "/camera/camera_info": "/eye/info",
    }
    node = ["node", "--params", SAMPLE.with_suffix(".yaml"), "--use-sim-time", "--ros-args"]
    node += [word for pair in topics.items() for word in ("-r", ":=".join(pair))]
    play = ["play", SAMPLE, "--loop", "--wait-for", "/ar_builder"]
    play += [word for pair in topics.items() for word in ("--remap", ":=".join(pair))]
    with running(*node), running(*play), looking() as (live, _, until):
        until(lambda: any(tick.scans for tick in live.ticks))
        until(lambda: any(tick.map_from_camera is not None for tick in live.ticks))
        assert live._scene is not None, "the map has come"


@pytest.mark.parametrize(
    ("heard", "at"),
    [
        ({}, "/camera/camera_info"),
        ({"/eye/camera_info": INFO}, "/eye/camera_info"),
        ({"/eye/camera_info": INFO, "/eye/image": IMAGE}, "/eye/camera_info"),
        ({"/eye/info": INFO, "/camera_info": INFO, "/image": IMAGE}, "/eye/info"),
        ({"/eye/info": INFO, "/ear/info": INFO}, "/camera/camera_info"),
        ({"/eye/info": INFO, "/camera/camera_info": INFO}, "/camera/camera_info"),
    ],
)
def test_a_remapped_input_is_found_where_it_is_clear(heard: dict[str, str], at: str) -> None:
    """By its type; the CameraInfo of images is another one, but where there is no more."""
    camera, scan = ("camera/camera_info", "/camera/camera_info"), ("scan", "/scan")
    wanted = {camera: "camera/camera_info", scan: "scan"}
    assert remapped(wanted, heard) == {camera: at, scan: "/scan"}


@needs_viser
def test_what_was_latched_before_is_shown(ros_available: None) -> None:
    """A cloud of voxels and a CameraInfo that do not come again, and the map."""
    del ros_available
    from tests.node.live_bench import LATCHED
    from tests.node.live_scene import camera_info, cloud, room, wall_voxels

    latched = {
        "/map": room(),
        "/octomap_point_cloud_centers": cloud(wall_voxels()),
        "/camera/camera_info": camera_info(0.0),
    }
    server = start_server(0)
    try:
        with (
            ros_session("robot") as robot,
            ros_session("are_viewer") as node,
            executor_of(node) as executor,
        ):
            for topic, message in latched.items():
                robot.create_publisher(type(message), topic, LATCHED).publish(message)
            wait_until(lambda: all(map(node.count_publishers, latched)), nap)
            remote = RemoteNode(node, executor, "", lambda: False)
            live = LiveView(server, remote, Parameters())
            reader = live._reader

            def turn() -> None:
                executor.spin_once(timeout_sec=0.05)
                live.work()

            wait_until(
                lambda: reader.grid is not None and reader.voxels() is not None and reader.camera,
                turn,
            )
    finally:
        stop_server(server)


def answering(call: Callable[[object], SimpleNamespace], patience_s: float) -> RemoteNode:
    """Return a node whose services answer by futures that `call` returns."""
    client = SimpleNamespace(
        srv_type=SimpleNamespace(Request=SimpleNamespace),
        service_is_ready=lambda: True,
        call_async=call,
        remove_pending_request=lambda _: None,
    )
    node = SimpleNamespace(create_client=lambda *_: client)
    executor = SimpleNamespace(spin_once=lambda timeout_sec: time.sleep(0.1 * timeout_sec))
    remote = RemoteNode(node, executor, "", lambda: False)
    remote.patience_s = patience_s
    return remote


def test_a_lost_answer_is_asked_for_again() -> None:
    """But not where to ask twice is to act twice."""
    calls = count(1)

    def call(_: object) -> SimpleNamespace:
        number = next(calls)
        return SimpleNamespace(done=lambda: number > 1, result=lambda: number)

    remote = answering(call, 0.3)
    with pytest.raises(NodeError, match="/ar_builder/pause does not answer"):
        remote.ask("pause", "std_srvs/srv/SetBool", attempts=1, data=True)
    calls = count(1)
    assert remote.ask("pause", "std_srvs/srv/SetBool", data=True) == 2


def test_a_late_answer_is_taken() -> None:
    """A busy node takes longer than an attempt, for each: it answers one after the other."""
    takes_s, free_s = 0.2, [0.0]

    def call(_: object) -> SimpleNamespace:
        free_s[0] = answered_s = max(free_s[0], time.monotonic()) + takes_s
        return SimpleNamespace(done=lambda: time.monotonic() > answered_s, result=lambda: "late")

    remote = answering(call, 0.9)
    assert remote.ask("pause", "std_srvs/srv/SetBool", data=True) == "late"


def test_sliders_have_room_for_a_hand() -> None:
    """Within the bounds of the declaration, and around the value: not from 0 to ten millions."""
    items = [i for i in describe(Parameters()) if i.live and type(i.default) in {int, float}]
    assert len(items) > 5
    for item in items:
        assert isinstance(item.default, (int, float))
        low, high, step = slider_range(item, item.default)
        assert low <= item.default <= high
        assert item.low is None or low >= item.low
        assert item.high is None or high <= max(item.high, item.default)
        assert 0.0 < step <= high - low
