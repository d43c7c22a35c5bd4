"""Messages of a recording become calls of the builder; bad ones are counted."""

import copy
import math
import random
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from are_ros.bag.reader import BagReader
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.assembly import catalogue_of
from are_ros.errors import InputError, InvalidTransformError
from are_ros.messages.feed import Feed, Refusals
from are_ros.messages.transforms import StampedTransform
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters, SensorsParameters
from are_ros.world.transforms.tree import FrameTree
from bags.simulation.making import RosbagsFactory, make_transforms

Records = Sequence[tuple[str, int, Any]]
WriteBag = Callable[[Path, Records], Path]
Call = tuple[str, tuple[Any, ...]]

ROLES = {
    "/map": "map",
    "/octomap_point_cloud_centers": "octomap_point_cloud_centers",
    "/odom": "odom",
    "/scan": "scan",
    "/camera/camera_info": "camera/camera_info",
    "/tf": "tf",
    "/tf_static": "tf_static",
}
NAN = float("nan")
UNIT = (0.0, 0.0, 0.0, 1.0)


class Notebook:
    """Stands in for the builder: notes what it receives, with the checks of the frame tree."""

    def __init__(self, sensors: SensorsParameters) -> None:
        self.calls: list[Call] = []
        self.parameters = SimpleNamespace(camera=SimpleNamespace(rectified=False), sensors=sensors)
        self._frames = FrameTree()

    def __getattr__(self, name: str) -> Callable[..., None]:
        def note(*values: Any, **flags: Any) -> None:
            if name == "receive_transform":
                self._frames.set_transform(*values[:5])
                values = (*values, flags["is_static"])
            self.calls.append((name, values))

        return note


def fed(
    path: Path, roles: dict[str, str], camera_infos: tuple[str, ...] = ()
) -> tuple[list[Call], Refusals]:
    """Feed a whole recording, each message as received 5 ns after it was recorded."""
    builder: Any = Notebook(SensorsParameters(camera_infos=camera_infos))
    with BagReader([path]) as reader:
        feed = Feed(reader, builder, roles)
        for message in reader.messages(tuple(roles)):
            feed.take(message, message.log_time_ns + 5)
    return builder.calls, feed.refusals


def transforms(factory: RosbagsFactory, *edges: tuple[str, str, tuple[float, ...]]) -> Any:
    """Return a TFMessage of edges with these rotations."""
    stamped: list[Any] = [StampedTransform(a, b, 7, (1.0, 2.0, 3.0), q) for a, b, q in edges]  # type: ignore[arg-type]
    return make_transforms(factory, stamped)


def test_each_role_has_its_way_into_the_builder(
    tmp_path: Path, write_bag: WriteBag, sample_records: Records
) -> None:
    """Every input of the sample is received once, at the time given, by the method of its role."""
    path = write_bag(tmp_path / "bag.mcap", sample_records)
    calls, refusals = fed(path, ROLES)
    assert refusals.counts == {}
    counts = {name: sum(call[0] == name for call in calls) for name, _ in calls}
    edges = sum(len(m.transforms) for topic, _, m in sample_records if topic.startswith("/tf"))
    assert counts == {
        "receive_map": 1,
        "receive_cloud": 1,
        "receive_odometry": sum(topic == "/odom" for topic, _, _ in sample_records),
        "receive_reading": sum(topic == "/scan" for topic, _, _ in sample_records),
        "receive_camera": sum(topic == "/camera/camera_info" for topic, _, _ in sample_records),
        "receive_transform": edges,
    }
    statics = [values for name, values in calls if name == "receive_transform" and values[-1]]
    assert {(values[0], values[1]) for values in statics} >= {("base_footprint", "base_link")}
    times = {at + 5 for _, at, _ in sample_records}
    maps = [values[1] for name, values in calls if name == "receive_map"]
    assert set(maps) <= times


def test_the_numbers_arrive_as_they_were_sent(
    tmp_path: Path, write_bag: WriteBag, sample_records: Records
) -> None:
    """An odometry's names, stamp and pose, and a scan's ranges."""
    odometry = next(record for record in sample_records if record[0] == "/odom")
    scan = next(record for record in sample_records if record[0] == "/scan")
    path = write_bag(tmp_path / "bag.mcap", sorted((odometry, scan), key=lambda one: one[1]))
    calls = dict(fed(path, ROLES)[0])
    parent, child, stamp_ns, translation_m, rotation_xyzw, received_ns = calls["receive_odometry"]
    sent = odometry[2]
    assert (parent, child) == (sent.header.frame_id, sent.child_frame_id)
    assert stamp_ns == sent.header.stamp.sec * 10**9 + sent.header.stamp.nanosec
    position, turn = sent.pose.pose.position, sent.pose.pose.orientation
    assert tuple(translation_m) == (position.x, position.y, position.z)
    assert tuple(rotation_xyzw) == (turn.x, turn.y, turn.z, turn.w)
    assert received_ns == odometry[1] + 5
    topic, received, received_ns = calls["receive_reading"]
    assert (topic, received_ns) == ("/scan", scan[1] + 5)
    assert received.ranges.tobytes() == scan[2].ranges.tobytes()


def test_a_camera_that_says_the_same_is_read_once(
    tmp_path: Path, write_bag: WriteBag, sample_records: Records
) -> None:
    """Only a changed CameraInfo makes a new view; each is received."""
    infos = [record for record in sample_records if record[0] == "/camera/camera_info"][:4]
    changed = copy.deepcopy(infos[2][2])
    changed.width = 320
    infos[2] = (infos[2][0], infos[2][1], changed)
    calls, _ = fed(write_bag(tmp_path / "bag.mcap", infos), ROLES)
    cameras = [values[0] for _, values in calls]
    assert len(cameras) == 4
    assert cameras[0] is cameras[1]
    assert [camera.view.width for camera in cameras] == [640, 640, 320, 640]


def test_a_bad_transform_does_not_spoil_its_message(
    tmp_path: Path, write_bag: WriteBag, factory: RosbagsFactory
) -> None:
    """Those before and after it are taken; the message counts as refused, once."""
    edges = [
        ("a", "b", UNIT),
        ("b", "c", (0.0, 0.0, 0.0, 0.5)),
        ("b", "d", UNIT),
        ("d", "e", (0.0, 0.0, NAN, 1.0)),
        ("d", "f", UNIT),
    ]
    path = write_bag(tmp_path / "bag.mcap", [("/tf", 1, transforms(factory, *edges))])
    calls, refusals = fed(path, ROLES)
    assert [values[1] for _, values in calls] == ["b", "d", "f"]
    assert refusals.counts == {"/tf": 1}
    assert refusals.sentences["/tf"].startswith("/tf: ")
    assert "c" in refusals.sentences["/tf"]


@pytest.mark.parametrize("suffix", [".mcap", ".db3", ".bag"])
def test_a_good_message_after_a_bad_one_is_taken(
    tmp_path: Path,
    write_bag: WriteBag,
    factory: RosbagsFactory,
    as_ros1: Callable[[Any], Any],
    suffix: str,
) -> None:
    """Bad, good, bad, good: two taken, two counted, the first sentence kept."""
    records = [
        ("/tf", 1, transforms(factory, ("a", "a", UNIT))),
        ("/tf", 2, transforms(factory, ("a", "b", UNIT))),
        ("/tf", 3, transforms(factory, ("", "b", UNIT))),
        ("/tf", 4, transforms(factory, ("a", "c", UNIT))),
    ]
    if suffix == ".bag":
        records = [(topic, at, as_ros1(message)) for topic, at, message in records]
    calls, refusals = fed(write_bag(tmp_path / f"bag{suffix}", records), ROLES)
    assert [values[1] for _, values in calls] == ["b", "c"]
    assert refusals.counts == {"/tf": 2}
    assert "a -> a" in refusals.sentences["/tf"]


def _damaged(data: bytes, chance: random.Random) -> bytes:
    """Return a message with a byte, a number or its end spoilt."""
    spoilt = bytearray(data)
    at = chance.randrange(4, min(len(data), 250))
    number = chance.choice((NAN, math.inf, 1e300, -1e300, 1e-310, 0.0, -1.0))
    if chance.random() < 0.4:
        spoilt[at] = chance.randrange(256)
    elif chance.random() < 0.9:
        spoilt[at : at + 8] = struct.pack("<d", number)
    else:
        del spoilt[at:]
    return bytes(spoilt)


@pytest.mark.parametrize("seed", range(3))
def test_damaged_messages_never_stop_the_builder(
    tmp_path: Path, write_bag: WriteBag, sample_records: Records, seed: int
) -> None:
    """Whatever bytes are spoilt, a message is taken or refused, and the next tick runs."""
    chance = random.Random(seed)  # noqa: S311 - damage, no secret
    parameters = with_values(
        Parameters(), {"population.arrival_rate": 0.02, "camera.rate": 2.0, "camera.width": 64}
    )
    builder = ArBuilder(parameters, catalogue_of(parameters))
    path = write_bag(tmp_path / "bag.mcap", sample_records[:120])
    with BagReader([path]) as reader:
        feed = Feed(reader, builder, ROLES)
        messages = list(reader.messages())
        for message in messages:
            feed.take(message, message.log_time_ns)
        assert feed.refusals.counts == {}
        firsts = {message.topic: message for message in reversed(messages)}
        now_ns = messages[-1].log_time_ns
        for _ in range(120):
            now_ns += 10_000_000
            message = firsts[chance.choice(sorted(firsts))]
            feed.take(message._replace(data=_damaged(message.data, chance)), now_ns)
            builder.step(now_ns)
    assert sum(feed.refusals.counts.values()) > 20


@pytest.mark.parametrize(
    ("cause", "sentence"),
    [
        (InputError("/scan: ranges are odd"), "/scan: ranges are odd"),
        (InputError("scan: ranges are odd"), "/scan: ranges are odd"),
        (InvalidTransformError("the rotation is odd"), "/scan: the rotation is odd"),
        (InputError("/scan_2: ranges are odd"), "/scan: /scan_2: ranges are odd"),
    ],
)
def test_a_refusal_names_its_topic_once(cause: InputError, sentence: str) -> None:
    """Whether the cause named the topic, the role or neither."""
    refusals = Refusals()
    refusals.add("/scan", "scan", cause)
    refusals.add("/scan", "scan", InputError("another"))
    assert refusals.counts == {"/scan": 2}
    assert refusals.sentences == {"/scan": sentence}


def depth_records(factory: RosbagsFactory) -> list[tuple[str, int, Any]]:
    """Return bad and good images of depths, and the CameraInfo beside them, twice each."""
    header = factory.make("std_msgs/msg/Header", frame_id="kinect")
    image = factory.make(
        "sensor_msgs/msg/Image", header=header, height=2, width=3, encoding="16UC1", step=6,
        data=np.zeros(12, np.uint8),
    )  # fmt: skip
    eye = np.eye(3).ravel()
    info = factory.make(
        "sensor_msgs/msg/CameraInfo", header=header, height=2, width=3,
        distortion_model="plumb_bob", d=np.zeros(5), k=eye, r=eye, p=np.eye(3, 4).ravel(),
    )  # fmt: skip
    records = list[tuple[str, int, Any]]()
    for topic, message, changes in (
        ("/d/image", image, {"encoding": "rgb8"}),
        ("/d/image", image, {"step": 5}),
        ("/d/camera_info", info, {"k": 0.0 * eye}),
        ("/d/camera_info", info, {"k": NAN * eye}),
        ("/d/camera_info", info, {}),
        ("/d/camera_info", info, {}),
        ("/d/image", image, {}),
        ("/d/image", image, {"data": np.zeros(11, np.uint8)}),
    ):
        changed = copy.copy(message)
        for name, value in changes.items():
            object.__setattr__(changed, name, value)
        records.append((topic, 10 + len(records), changed))
    return records


@pytest.mark.parametrize("role", ["camera_info", "camera/camera_info"])
def test_images_get_their_lens_from_the_camera_info_beside_them(
    tmp_path: Path, write_bag: WriteBag, factory: RosbagsFactory, role: str
) -> None:
    """It may be that of the robot's camera, too; what is bad is counted, and disturbs nothing."""
    path = write_bag(tmp_path / "bag.mcap", depth_records(factory))
    calls, refusals = fed(path, {"/d/image": "depth", "/d/camera_info": role})
    assert calls[0] == ("await_lens", ("/d/image", "/d/camera_info"))
    lenses = [values for name, values in calls if name == "receive_lens"]
    assert [(topic, at) for topic, _, at in lenses] == [("/d/image", 19), ("/d/image", 20)]
    assert lenses[0][1] is lenses[1][1]
    assert lenses[0][1].frame_id == "kinect"
    readings = [values[0] for name, values in calls if name == "receive_reading"]
    assert readings == ["/d/image"]
    cameras = [name for name, _ in calls if name == "receive_camera"]
    assert len(cameras) == (2 if role == "camera/camera_info" else 0)
    assert refusals.counts == {"/d/image": 3, "/d/camera_info": 2}
    elsewhere = {"/d/image": "depth", "/e/image": "depth", "/d/camera_info": role}
    calls, _ = fed(path, elsewhere, ("/e/image:=/d/camera_info",))
    assert [values[0] for name, values in calls if name == "receive_lens"] == [
        "/d/image", "/e/image", "/d/image", "/e/image"
    ]  # fmt: skip
    assert refusals.sentences == {
        "/d/image": "/d/image: encoding 'rgb8' holds no depth; known are 16UC1, mono16, 32FC1,"
        " and images of colours have the role image",
        "/d/camera_info": "/d/camera_info: k is all zeros, so this camera is not calibrated",
    }
