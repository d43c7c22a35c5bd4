"""Messages that make no sense: refused with the reason, counted, and forgotten."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import pytest

from tests.ros import NOT_SET_UP

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from rclpy.serialization import serialize_message

from tests.node.live_bench import Bench
from tests.node.live_scene import (
    camera_info,
    click_at,
    cloud,
    laser_mount,
    ns,
    odometry,
    path_to,
    pose_at,
    robot_at,
    room,
    scan,
    transforms,
    wall_voxels,
)

MakeBench = Callable[..., Bench]
NAN: Final = float("nan")
WARN: Final = b"\1"
CLOUD: Final = "octomap_point_cloud_centers"


def with_(message: Any, path: str, value: Any) -> Any:
    """Return the message with another value at a dotted path; an index is a number in it."""
    *way, last = path.split(".")
    part = message
    for step in way:
        part = part[int(step)] if step.isdigit() else getattr(part, step)
    setattr(part, last, value)
    return message


def good(role: str, t_s: float) -> Any:
    """Return a message that is taken."""
    messages: dict[str, Callable[[], Any]] = {
        "map": lambda: room(stamp_s=t_s),
        CLOUD: lambda: cloud(wall_voxels()),
        "odom": lambda: odometry(t_s, 1.0, 2.0),
        "scan": lambda: scan(t_s),
        "camera/camera_info": lambda: camera_info(t_s, frame_id="base_link"),
        "tf": lambda: robot_at(t_s),
        "tf_static": laser_mount,
        "plan": lambda: path_to(3.0, 3.0),
        "clicked_point": lambda: click_at(2.5, 1.0),
    }
    return messages[role]()


VALUES: Final = [
    ("map", "info.width", 41, "width x height is 41 x 40"),
    ("map", "info.height", 0, "height is 0"),
    ("map", "info.resolution", NAN, "resolution"),
    ("map", "info.resolution", 0.0, "resolution"),
    ("map", "info.origin.orientation.w", 0.5, "origin"),
    ("map", "info.origin.position.x", NAN, "origin"),
    ("map", "header.frame_id", "", "frame_id is empty"),
    ("map", "header.frame_id", "odom", "its frame is 'odom', but frames.map is 'map'"),
    (CLOUD, "fields", [], "fields have no x"),
    (CLOUD, "row_step", 7, "row_step 7 is less than width"),
    (CLOUD, "height", 2, "height 2"),
    (CLOUD, "header.frame_id", "", "frame_id is empty"),
    (CLOUD, "point_step", 8, "ends beyond point_step 8"),
    ("odom", "pose.pose.position.x", NAN, "finite"),
    ("odom", "pose.pose.orientation.w", 0.0, "rotation"),
    ("odom", "header.frame_id", "", "frame"),
    ("odom", "child_frame_id", "odom", "odom -> odom is refused: parent and child are the same"),
    ("scan", "angle_increment", NAN, "angle_increment"),
    ("scan", "angle_increment", 0.0, "angle_increment"),
    ("scan", "range_max", -1.0, "range_max"),
    ("scan", "header.frame_id", "", "frame_id is empty"),
    ("scan", "time_increment", NAN, "time_increment"),
    ("camera/camera_info", "width", 0, "width"),
    ("camera/camera_info", "k", np.zeros(9), "k"),
    ("camera/camera_info", "k", np.full(9, NAN), "k"),
    ("camera/camera_info", "distortion_model", "pillow", "pillow"),
    ("camera/camera_info", "d", [1.0, 2.0], "d"),
    ("camera/camera_info", "header.frame_id", "", "frame_id is empty"),
    ("tf", "transforms.0.transform.translation.x", NAN, "finite"),
    ("tf", "transforms.0.transform.rotation.w", 0.0, "rotation"),
    ("tf", "transforms.0.header.frame_id", "", "empty"),
    ("tf", "transforms.0.child_frame_id", "map", "parent and child are the same frame"),
    ("tf_static", "transforms.0.transform.rotation.x", NAN, "finite"),
    ("tf_static", "transforms.0.transform.rotation.w", 2.0, "rotation"),
    ("tf_static", "transforms.0.child_frame_id", "", "empty"),
    ("plan", "poses.0.pose.position.x", NAN, "finite"),
    ("plan", "header.frame_id", "", "frame_id is empty"),
    ("plan", "header.frame_id", "arm", "'arm'"),
    ("clicked_point", "point.x", float("inf"), "finite"),
    ("clicked_point", "header.frame_id", "", "frame_id is empty"),
]
ROLES: Final = list(dict.fromkeys(role for role, *_ in VALUES))


@pytest.fixture
def bench(make_bench: MakeBench) -> Bench:
    """Return an active node at 1000.1 s that has had one good message of each type."""
    values = {"camera.model": "auto", "world.voxel_size": 0.1, "population.max_alive": 1}
    made = make_bench(values, "configure", "activate")
    made.clock(1000.0)
    for role in ROLES:
        if role != "clicked_point":
            made.send(role, good(role, 1000.0))
    made.tick(1000.1)
    return made


def what_is_known(bench: Bench) -> tuple[object, ...]:
    """Return what the builder made of its inputs; equal as long as nothing changed it."""
    assert bench.node.live is not None
    builder = bench.node.live.builder
    place = builder.frames.try_lookup("map", "laser", ns(1000.0))
    return (
        builder.world.environment,
        builder.world.missing_frame(),
        builder.camera,
        builder.lives.goal,
        None if place is None else tuple(place.matrix().reshape(-1)),
        builder.robots.last,
        builder.lives.population.counts,
    )


def refusals(bench: Bench, role: str) -> tuple[int, int, str]:
    """Return how many messages came, how many were refused, and what was said of the last."""
    bench.settle()
    assert bench.node._inputs is not None
    watch = bench.node._inputs.watches[topic_of(role)]
    return watch.count, watch.refused_count, watch.last_refusal


def topic_of(role: str) -> str:
    """Return the full topic of a role."""
    return f"/{role}"


@pytest.mark.parametrize("role", ROLES)
def test_values_without_sense_are_refused(bench: Bench, role: str) -> None:
    """Each with topic and reason; nothing is changed; the next good one is taken."""
    bad = [case[1:] for case in VALUES if case[0] == role]
    count, _, _ = refusals(bench, role)
    before = what_is_known(bench)
    for number, (path, value, reason) in enumerate(bad, start=1):
        bench.send(role, with_(good(role, 1000.12), path, value))
        work(bench)
        came, refused, said = refusals(bench, role)
        assert (came, refused) == (count + number, number), path
        assert said.startswith(topic_of(role)), path
        assert reason in said, path
        assert what_is_known(bench) == before, path
    check_that_it_goes_on(bench, role, len(bad))


def work(bench: Bench) -> None:
    """Let the node work through its inputs now, though the time stands still."""
    bench.node._work()


def check_that_it_goes_on(bench: Bench, role: str, refused: int) -> None:
    """Check that the diagnostics tell of it, and that a good message is taken."""
    status = bench.report()[f"inputs/{role}"]
    assert status.level == WARN
    noun = "message" if refused == 1 else "messages"
    assert (
        f"{refused} {noun} refused in the last 10 s; the last: {topic_of(role)}" in status.message
    )
    assert {pair.key: pair.value for pair in status.values}["refused"] == str(refused)
    bench.send(role, good(role, 1000.15))
    bench.tick(1000.3)
    assert refusals(bench, role)[1] == refused


def garbage(role: str) -> list[bytes]:
    """Return bytes that are no message of the role's type."""
    data = serialize_message(good(role, 1000.12))
    middle, begin = len(data) // 2, 4 if role.startswith("tf") else 12
    return [
        b"\0\1\0\0",
        b"\0\1\0\0" + b"\xff" * 400,
        data[:middle],
        data[:12],
        data[:begin] + b"\xff\xff\xff\xff" + data[begin + 4 :],
        b"\0\1\0\0\xff\xff\xff\x7f" + b"\xfe" * 60,
        b"\x09\x09\x09\x09" + data[4:middle],
    ]


@pytest.mark.parametrize("use_events_executor", [False, True])
@pytest.mark.parametrize("role", ROLES)
def test_bytes_without_sense_are_refused(
    make_bench: MakeBench, role: str, *, use_events_executor: bool
) -> None:
    """Published as they are; the node lives, and the next good message is taken."""
    values = {"camera.model": "auto", "world.voxel_size": 0.1}
    bench = make_bench(values, "configure", "activate", use_events_executor=use_events_executor)
    bench.clock(1000.0)
    bench.send("map", room())
    bench.send("tf", robot_at(1000.0))
    bench.tick(1000.1)
    before = what_is_known(bench)
    cases = garbage(role)
    earlier = refusals(bench, role)[0]
    for number, data in enumerate(cases, start=1):
        bench.send(role, data)
        work(bench)
        came, refused, said = refusals(bench, role)
        assert (came, refused) == (earlier + number, number), data
        assert said.startswith(topic_of(role)), data
        assert what_is_known(bench) == before, data
    check_that_it_goes_on(bench, role, len(cases))


def test_good_transforms_beside_a_bad_one_are_taken(bench: Bench) -> None:
    """The message counts as refused, with the reason of the bad one."""
    unturned = (0.0, 0.0, 0.0), 0.0
    both = transforms(("map", "door", 1000.1, *unturned), ("map", "gate", 1000.1, *unturned))
    bench.send("tf", with_(both, "transforms.0.transform.translation.x", NAN))
    bench.tick(1000.2)
    assert "map -> door is refused" in refusals(bench, "tf")[2]
    assert bench.spawn(pose_at(2.5, 1.0, frame_id="gate"), label="post").success
    assert not bench.spawn(pose_at(2.5, 3.0, frame_id="door"), label="post").success


def test_a_refusal_is_logged_once(bench: Bench) -> None:
    """However often it happens."""
    for _ in range(3):
        bench.send("scan", with_(scan(1000.1), "header.frame_id", ""))
    bench.settle()
    assert bench.warnings() == ["/scan: header.frame_id is empty"]


def test_a_scan_that_makes_no_sense_does_not_come_out(bench: Bench) -> None:
    """Neither does it hold up the next one."""
    scans = bench.listen("scan", "sensor_msgs/msg/LaserScan")
    bench.send("scan", with_(scan(1000.1), "angle_increment", NAN))
    bench.send("scan", scan(1000.1))
    bench.tick(1000.3)
    assert [message.angle_increment for message in scans] == [pytest.approx(2 * np.pi / 90)]
