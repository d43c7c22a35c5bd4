"""Who comes late, who publishes how, and two nodes side by side: what DDS makes of the topics."""

from array import array
from collections.abc import Callable
from functools import partial
from typing import Any

import cv2
import numpy as np
import pytest

from are_ros.messages.sensors import read_cloud
from bags.simulation.making import make_time
from tests.ros import NOT_SET_UP

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from are_ros.node.watches import InputWatch
from tests.node.live_bench import DELETE_ALL, LATCHED, Bench
from tests.node.live_scene import (
    FACTORY,
    camera_info,
    cloud,
    laser_mount,
    ns,
    odometry,
    pose_at,
    robot_at,
    room,
    scan,
    sonar,
    transforms,
    wall_voxels,
)

MakeBench = Callable[..., Bench]
SCAN = "sensor_msgs/msg/LaserScan"
INFO = "camera/depth/camera_info"
CLOUD = "octomap_point_cloud_centers"
ADD = 0
RELIABLE = QoSProfile(depth=5)
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)


def crowded(make_bench: MakeBench, **options: Any) -> Bench:
    """Return an active node with two artefacts, of which the robot sees one."""
    bench = make_bench({"costmap.gate": "all"}, "configure", "activate", **options)
    bench.clock(1000.0)
    bench.send("map", room())
    bench.send("tf", robot_at(1000.0, yaw=0.0))
    bench.tick(1000.1)
    for x in (2.55, 0.45):
        assert bench.spawn(pose_at(x, 2.05), label="post").success
    bench.send("tf", robot_at(1000.1))
    bench.tick(1000.2)
    return bench


@pytest.mark.parametrize("use_events_executor", [False, True])
def test_a_late_viewer_gets_all_markers_and_so_does_a_second_one(
    make_bench: MakeBench, *, use_events_executor: bool
) -> None:
    """After a DELETEALL; who was there before sees the same again, and then only what changes."""
    bench = crowded(make_bench, use_events_executor=use_events_executor)
    first = bench.listen("markers")
    bench.tick(1000.3)
    second = bench.listen("markers")
    bench.tick(1000.4)
    bench.tick(1000.5)
    for viewer in (first, second):
        beginning, *rest = viewer[0].markers
        assert beginning.action == DELETE_ALL
        assert {(marker.action, marker.id) for marker in rest} == {(ADD, 10**9), (ADD, 10**9 + 1)}
    assert first[1] == second[0]
    deletions = [m.action for batch in first for m in batch.markers if m.action == DELETE_ALL]
    assert len(deletions) == 2


@pytest.mark.parametrize("use_events_executor", [False, True])
@pytest.mark.parametrize("name", ["augmented_map", "artefact_map", "augmented_costmap"])
def test_a_late_listener_gets_the_last_map(
    make_bench: MakeBench, name: str, *, use_events_executor: bool
) -> None:
    """With the artefacts in it, though no other one is published; so does a second listener."""
    bench = crowded(make_bench, use_events_executor=use_events_executor)
    heard = [bench.listen(name) for _ in range(2)]
    bench.until(lambda: all(heard))
    bench.settle()
    for (grid,) in heard:
        walls = 0 if name == "artefact_map" else 4 * 39
        assert grid.data.tolist().count(100) == walls + 2 * 25
        assert (grid.info.width, grid.info.height, grid.header.frame_id) == (40, 40, "map")


@pytest.mark.parametrize("qos", [RELIABLE, BEST_EFFORT], ids=["reliable", "best effort"])
def test_sensors_are_heard_however_they_are_published(
    make_bench: MakeBench, qos: QoSProfile
) -> None:
    """Odometry places the robot, the CameraInfo lets it see, and its scan is augmented."""
    static = {"frames.static": ["0 0 0 0 0 0 map odom"], "camera.model": "auto"}
    bench = make_bench(static, "configure", "activate")
    perceived, scans = bench.listen("perceived"), bench.listen("scan", SCAN)
    bench.clock(1000.0)
    bench.send("map", room())
    bench.send("tf_static", laser_mount())
    bench.send("odom", odometry(1000.0, 1.0, 2.0), qos=qos)
    info = camera_info(1000.0, frame_id="camera_optical")
    optical = transforms(("base_link", "camera_optical", 0.0, (0.0, 0.0, 0.5), 0.0))
    optical.transforms[0].transform.rotation = forward_looking()
    bench.send("tf_static", optical)
    bench.send("camera/camera_info", info, qos=qos)
    bench.tick(1000.1)
    spawned = bench.spawn(pose_at(2.5, 2.0), label="post")
    bench.send("odom", odometry(1000.2, 1.0, 2.0))
    bench.send("scan", scan(1000.15), qos=qos)
    bench.tick(1000.2)
    assert [one.id for one in perceived[-1].artefacts] == [spawned.id]
    bench.until(lambda: scans)
    assert min(scans[-1].ranges) == pytest.approx(1.3, abs=0.01), "the post's front"


def forward_looking() -> Any:
    """Return the rotation of an optical frame (z forward, x right) whose body looks along +x."""
    quaternion = pose_at(0.0, 0.0).pose.orientation
    quaternion.x, quaternion.y, quaternion.z, quaternion.w = -0.5, 0.5, -0.5, 0.5
    return quaternion


def place_in_the_voxels(bench: Bench) -> str:
    """Ask for a post in the wall that only the cloud has, and return what is said."""
    answer = bench.spawn(pose_at(3.05, 2.05), label="post")
    if answer.success:
        bench.call("remove", id=answer.id)
    return str(answer.message)


def test_the_cloud_is_received_latched_and_not_and_after_a_switch(make_bench: MakeBench) -> None:
    """The subscription follows its publishers while the node runs, within a second or two."""
    bench = make_bench({"world.voxel_size": 0.1}, "configure", "activate")
    kind = type(cloud(wall_voxels()))
    latched = bench.user.create_publisher(kind, f"/{CLOUD}", LATCHED)
    latched.publish(cloud(wall_voxels()))
    bench.clock(1000.0)
    bench.send("map", room())
    assert bench.node._inputs is not None
    watch = bench.node._inputs.watches[f"/{CLOUD}"]
    bench.until(lambda: watch.count == 1)
    bench.tick(1000.1)
    assert "in a wall" in place_in_the_voxels(bench)
    bench.user.destroy_publisher(latched)
    bench.until(lambda: bench.node.count_publishers(f"/{CLOUD}") == 0)
    volatile = bench.user.create_publisher(kind, f"/{CLOUD}", RELIABLE)
    bench.until(volatile.get_subscription_count)
    volatile.publish(cloud([(0.55, 0.55, 0.05)]))
    bench.until(lambda: watch.count == 2)
    bench.tick(1000.2)
    assert "stands" in place_in_the_voxels(bench)
    bench.user.destroy_publisher(volatile)
    bench.until(lambda: bench.node.count_publishers(f"/{CLOUD}") == 0)
    again = bench.user.create_publisher(kind, f"/{CLOUD}", LATCHED)
    again.publish(cloud(wall_voxels()))
    bench.until(lambda: watch.count == 3)
    bench.tick(1000.3)
    assert "in a wall" in place_in_the_voxels(bench)
    assert watch.refused_count == 0


def test_the_last_latched_cloud_is_there_for_a_node_that_comes_later(
    make_bench: MakeBench,
) -> None:
    """Also where one publisher latches and another does not, from then on."""
    bench = make_bench()
    kind = type(cloud(wall_voxels()))
    latched = bench.user.create_publisher(kind, f"/{CLOUD}", LATCHED)
    latched.publish(cloud(wall_voxels()))
    bench.clock(1000.0)
    assert bench.change_state("configure", "activate")
    assert bench.node._inputs is not None
    watch = bench.node._inputs.watches[f"/{CLOUD}"]
    bench.until(lambda: watch.count == 1)
    volatile = bench.user.create_publisher(kind, f"/{CLOUD}", RELIABLE)
    bench.until(volatile.get_subscription_count)
    bench.until(lambda: latched.get_subscription_count() == 1)
    volatile.publish(cloud([(0.55, 0.55, 0.05)]))
    bench.until(lambda: watch.count == 2)


def test_a_camera_info_that_was_latched_once_is_there_for_a_node_that_comes_later(
    make_bench: MakeBench,
) -> None:
    """It does not come again; and it counts, too, where it comes before the first /clock."""
    bench = make_bench({"camera.model": "auto"})
    kind = type(camera_info(0.0))
    latched = bench.user.create_publisher(kind, "/camera/camera_info", LATCHED)
    latched.publish(camera_info(0.0, frame_id="base_link"))
    bench.until(lambda: bench.node.count_publishers("/camera/camera_info"))
    assert bench.change_state("configure", "activate")
    assert bench.node._inputs is not None
    watch = bench.node._inputs.watches["/camera/camera_info"]
    bench.until(lambda: watch.count == 1)
    bench.clock(1000.0)
    bench.send("map", room())
    bench.send("tf", robot_at(1000.0))
    bench.tick(1000.1)
    assert bench.node.live is not None
    assert bench.node.live.builder.camera is not None


def test_a_camera_info_is_received_latched_and_not_and_after_a_switch(
    make_bench: MakeBench,
) -> None:
    """The subscription follows its publishers while the node runs, within a second or two."""
    bench = make_bench({}, "configure", "activate")
    kind, topic = type(camera_info(0.0)), "/camera/camera_info"
    assert bench.node._inputs is not None
    watch = bench.node._inputs.watches[topic]
    for qos in (LATCHED, BEST_EFFORT, LATCHED):
        before = watch.count
        publisher = bench.user.create_publisher(kind, topic, qos)
        if qos is BEST_EFFORT:
            bench.until(publisher.get_subscription_count)
        publisher.publish(camera_info(0.0))
        bench.until(partial(has_come, watch, before))
        bench.user.destroy_publisher(publisher)
        bench.until(lambda: bench.node.count_publishers(topic) == 0)
    assert bench.warnings() == []


def has_come(watch: InputWatch, before: int) -> bool:
    """Tell whether more has come of an input."""
    return watch.count > before


def test_qos_can_be_overridden_by_parameters(make_bench: MakeBench) -> None:
    """As in every node: here, markers latched, and reliable scans only."""
    overrides = {
        "qos_overrides./ar_builder/markers.publisher.durability": "transient_local",
        "qos_overrides./scan.subscription.reliability": "reliable",
    }
    bench = make_bench(overrides, "configure")
    (markers,) = bench.user.get_publishers_info_by_topic("/ar_builder/markers")
    assert markers.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    (taken,) = bench.user.get_subscriptions_info_by_topic("/scan")
    assert taken.qos_profile.reliability == ReliabilityPolicy.RELIABLE


def test_a_range_sensor_meets_what_is_before_it(make_bench: MakeBench) -> None:
    """With its topic as a parameter, its readings come out on `range`, with the artefact."""
    bench = make_bench({"sensors.ranges": ["sonar/front"]}, "configure", "activate")
    ranges = bench.listen("range", "sensor_msgs/msg/Range")
    bench.clock(1000.0)
    bench.send("map", room())
    bench.send("tf_static", laser_mount())
    bench.send("tf", robot_at(1000.0))
    bench.tick(1000.1)
    bench.spawn(pose_at(2.5, 2.0), label="post")
    bench.send("tf", robot_at(1000.2))
    bench.send("range", sonar(1000.15), topic="/sonar/front")
    bench.tick(1000.2)
    bench.until(lambda: ranges)
    assert ranges[-1].range == pytest.approx(1.3, abs=0.01), "the post's front"


def test_a_point_cloud_meets_what_is_before_it(make_bench: MakeBench) -> None:
    """By default that of `points`; what is behind the artefact moves onto it."""
    bench = make_bench({}, "configure", "activate")
    clouds = bench.listen("points", "sensor_msgs/msg/PointCloud2")
    bench.clock(1000.0)
    bench.send("map", room())
    bench.send("tf_static", laser_mount())
    bench.send("tf", robot_at(1000.0))
    bench.tick(1000.1)
    bench.spawn(pose_at(2.5, 2.0), label="post")
    bench.send("tf", robot_at(1000.2))
    message = cloud([(2.5, 0.0, 0.0), (0.0, 1.5, 0.0)], "laser")
    message.header.stamp = make_time(FACTORY, ns(1000.15))
    bench.send("points", message)
    bench.tick(1000.2)
    bench.until(lambda: clouds)
    points_m = read_cloud(clouds[-1]).points_m()
    np.testing.assert_allclose(points_m, [(1.3, 0.0, 0.0), (0.0, 1.5, 0.0)], atol=0.01)


def test_inputs_can_be_remapped(make_bench: MakeBench) -> None:
    """By the usual rules; the diagnostics tell the topic that is really read."""
    rules = ("-r", "map:=/upstairs/map", "-r", "scan:=/front/scan")
    bench = make_bench({}, "configure", arguments=rules)
    maps, scans = bench.listen("augmented_map"), bench.listen("scan", SCAN)
    bench.send("map", room(), topic="/upstairs/map")
    bench.send("scan", scan(999.0), topic="/front/scan")
    bench.until(lambda: maps and scans)
    values = {pair.key: pair.value for pair in bench.report()["inputs/map"].values}
    assert values["topic"] == "/upstairs/map"


def test_several_scans_keep_their_names(make_bench: MakeBench) -> None:
    """Each comes out on its own topic."""
    names = ["front/scan", "rear/scan"]
    bench = make_bench({"sensors.scans": names}, "configure")
    outputs = {name: bench.listen(name, SCAN) for name in names}
    for index, name in enumerate(names):
        bench.send("scan", scan(999.0 + index), topic=f"/{name}")
    bench.until(lambda: all(outputs.values()))
    assert [outputs[name][0].header.stamp.sec for name in names] == [999, 1000]


@pytest.mark.parametrize(("lens", "slash"), [(INFO, ""), ("lens", "/"), ("lens", "")])
def test_depth_images_are_augmented_raw_and_compressed(
    make_bench: MakeBench, lens: str, slash: str
) -> None:
    """Both have the post before the robot, in the same pixels, and the CameraInfo beside them.

    That comes from elsewhere if the parameters say so, with full names or without.
    """
    raw = "camera/depth/image_rect"
    names = [raw, f"{raw}/compressedDepth"]
    values: dict[str, Any] = {"sensors.depths": names, "sensors.shape": "box"}
    if lens != INFO:
        values["sensors.camera_infos"] = [f"{slash}{name}:={slash}{lens}" for name in names]
    bench = make_bench(values, "configure", "activate")
    bench.send("map", room())
    bench.clock(1000.0)
    bench.send("tf", robot_at(1000.0))
    bench.tick(1000.1)
    assert bench.spawn(pose_at(2.5, 2.0), label="post").success
    bench.tick(1000.2)
    kinds = [f"sensor_msgs/msg/{kind}" for kind in ("Image", "CompressedImage", "CameraInfo")]
    heard = [bench.listen(n, k) for n, k in zip((*names, INFO), kinds, strict=True)]
    info = camera_info(1000.2, frame_id="base_link")
    info.r = np.array([0.0, -1, 0, 0, 0, -1, 1, 0, 0])  # the rectified image looks along x
    nothing = np.zeros((48, 64), np.uint16)
    header = info.header
    image = FACTORY.make(
        "sensor_msgs/msg/Image",
        header=header,
        height=48,
        width=64,
        encoding="16UC1",
        step=128,
        data=array("B", bytes(nothing)),
    )
    png = cv2.imencode(".png", nothing)[1].tobytes()
    packed = FACTORY.make(
        "sensor_msgs/msg/CompressedImage",
        header=header,
        format="16UC1; compressedDepth png",
        data=array("B", bytes(12) + png),
    )
    bench.send("tf", robot_at(1000.3))
    for name, message in zip(names, (image, packed), strict=True):
        bench.send("depth", message, topic=f"/{name}")
    bench.send("camera_info", info, topic=f"/{lens}")
    bench.tick(1000.3)
    bench.until(lambda: all(heard))
    depths_mm = np.array(heard[0][0].data).view("<u2").reshape(48, 64)
    assert set(np.unique(depths_mm).tolist()) == {0, 1300}
    data = np.array(heard[1][0].data)[12:]
    np.testing.assert_array_equal(cv2.imdecode(data, cv2.IMREAD_UNCHANGED), depths_mm)
    assert [m.header for m in (heard[0][0], heard[1][0], heard[2][0])] == [header] * 3
    assert heard[2][0].k.tolist() == info.k.tolist()


def test_two_nodes_in_two_namespaces_live_side_by_side(make_bench: MakeBench) -> None:
    """Each with a map, artefacts, services and outputs of its own; the transforms are shared."""
    spaces = ("one", "two")
    benches = [
        make_bench(
            {"costmap.gate": "all"},
            "configure",
            "activate",
            arguments=("-r", f"__ns:=/{space}"),
        )
        for space in spaces
    ]
    blocks: tuple[tuple[tuple[int, int, int, int], ...], ...] = ((), ((30, 34, 30, 34),))
    heard = [(bench.listen("augmented_map"), bench.listen("artefacts")) for bench in benches]
    for bench, block in zip(benches, blocks, strict=True):
        bench.send("map", room(*block))
        bench.clock(1000.0)
        bench.tick(1000.1)
    assert benches[0].spawn(pose_at(2.05, 2.05), label="post").success
    for bench in benches:
        bench.tick(1000.2)
    counts = [maps[-1].data.tolist().count(100) for maps, _ in heard]
    assert counts == [4 * 39 + 25, 4 * 39 + 16]
    assert [len(lists[-1].artefacts) for _, lists in heard] == [1, 0]
    names = [status.name for bench in benches for status in statuses(bench)]
    assert {name.partition(":")[0] for name in names} == {"one/ar_builder", "two/ar_builder"}


def statuses(bench: Bench) -> list[Any]:
    """Return what a node says in its diagnostics."""
    bench.report()
    assert bench._reports is not None
    return list(bench._reports[-1].status)


def test_nobody_is_perceived_for_nothing(make_bench: MakeBench) -> None:
    """Without listeners, and with a gate that lets all in, nothing looks; then it does."""
    bench = crowded(make_bench)
    assert bench.node.live is not None
    builder = bench.node.live.builder
    assert builder.looks == 0
    perceived = bench.listen("perceived")
    bench.send("tf", robot_at(1000.2))
    bench.tick(1000.3)
    assert builder.looks == 1
    assert [one.id for one in perceived[-1].artefacts] == [10**9]
