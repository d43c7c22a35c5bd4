"""What is perceived, events and metrics as bytes, against the objects that a serialiser takes."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from are_ros.agents.events import (
    ArtefactEvent,
    EventKind,
    PerceivedArtefact,
    PredictedPath,
    SceneMetrics,
    Sighting,
)
from are_ros.bag.types import jazzy_typestore
from are_ros.messages.artefacts import (
    encode_event,
    encode_metrics,
    encode_perceived,
    encode_predicted,
)
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.making import (
    RosbagsFactory,
    make_header,
    make_pose,
    make_time,
    make_twist,
    make_vector,
)

Wire = Callable[[Any], bytes]
Readings = Callable[[bytes, str], tuple[Any, Any]]
ARRAY = "are_msgs/msg/PerceivedArtefactArray"
PATHS = "are_msgs/msg/PredictedPathArray"
EVENT, METRICS = "are_msgs/msg/ArtefactEvent", "are_msgs/msg/SceneMetrics"
PERCEIVED = PerceivedArtefact(
    7, "adult", ("person", "car"), (0.75, 0.25), RigidTransform.planar(1.0, 2.0, 0.5),
    tuple(range(36)), (0.5, 0.6, 1.7), (1.2, 0.0, 0.0), (0.0, 0.0, 0.3), tuple(range(36, 72)),
    Sighting(120, 240, (10, 20, 30, 40), 3.25, 6_000_000_002), 0.875,
)  # fmt: skip

TEXTS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9)
NUMBERS, SINGLES = st.floats(), st.floats(width=32)
TRIPLES = st.tuples(*[NUMBERS] * 3)
COVARIANCES = st.lists(NUMBERS, min_size=2, max_size=2).map(lambda two: tuple(two * 18))
UINT32, UINT64 = st.integers(0, 2**32 - 1), st.integers(0, 2**64 - 1)
TIMES = st.integers(0, 2**31 * 10**9 - 1)
TRANSFORMS = st.builds(
    RigidTransform.from_xyz_ypr, *[st.floats(-1e6, 1e6)] * 3, *[st.floats(-4, 4)] * 3
)
SIGHTS = st.builds(
    PerceivedArtefact,
    UINT64, TEXTS, st.lists(TEXTS, max_size=3).map(tuple), st.lists(SINGLES, max_size=3).map(tuple),
    TRANSFORMS, COVARIANCES, TRIPLES, TRIPLES, TRIPLES, COVARIANCES,
    st.builds(Sighting, UINT32, UINT32, st.tuples(*[UINT32] * 4), SINGLES, TIMES), SINGLES,
)  # fmt: skip


def make_perceived(
    factory: RosbagsFactory,
    frame_id: str,
    stamp_ns: int,
    observer: str,
    perceived: Sequence[PerceivedArtefact],
) -> Any:
    """Return the list, object by object."""
    return factory.make(
        ARRAY,
        header=make_header(factory, frame_id, stamp_ns),
        observer=observer,
        artefacts=[make_perceived_artefact(factory, artefact) for artefact in perceived],
    )


def make_perceived_artefact(factory: RosbagsFactory, artefact: PerceivedArtefact) -> Any:
    """Return one of them."""
    linear, angular = artefact.linear_velocity_m_s, artefact.angular_velocity_rad_s
    seen = artefact.sighting
    x, y, width, height = seen.roi_px
    return factory.make(
        "are_msgs/msg/PerceivedArtefact",
        id=artefact.artefact_id,
        label=artefact.label,
        classes=list(artefact.classes),
        probabilities=np.array(artefact.probabilities, dtype=np.float32),
        pose=factory.make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=make_pose(factory, artefact.map_from_artefact),
            covariance=np.array(artefact.pose_covariance, dtype=np.float64),
        ),
        size=make_vector(factory, artefact.size_m),
        twist=factory.make(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=make_twist(factory, linear, angular),
            covariance=np.array(artefact.twist_covariance, dtype=np.float64),
        ),
        visible_pixels=seen.visible_pixels,
        unoccluded_pixels=seen.unoccluded_pixels,
        visible_fraction=seen.visible_fraction,
        range=seen.range_m,
        existence=artefact.existence,
        roi=factory.make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=x, y_offset=y, height=height, width=width
        ),
        last_seen=make_time(factory, seen.seen_ns),
        cameras=list(seen.cameras),
    )


def make_event(factory: RosbagsFactory, frame_id: str, event: ArtefactEvent) -> Any:
    """Return an event."""
    return factory.make(
        EVENT,
        header=make_header(factory, frame_id, event.stamp_ns),
        kind=int(event.kind),
        id=event.artefact_id,
        label=event.label,
        detail=event.detail,
        value=event.value,
    )


def make_metrics(
    factory: RosbagsFactory, frame_id: str, stamp_ns: int, metrics: SceneMetrics
) -> Any:
    """Return metrics, whose fields have the names of the message's; rho is not known."""
    header = make_header(factory, frame_id, stamp_ns)
    return factory.make(METRICS, header=header, **vars(metrics), rho=math.nan)


@given(
    frame_id=TEXTS, stamp_ns=TIMES, observer=TEXTS, perceived=st.lists(SIGHTS, max_size=5)
)  # fmt: skip
def test_the_bytes_of_what_is_perceived_are_those_of_the_message(
    on_the_wire: Wire,
    factory: RosbagsFactory,
    frame_id: str,
    stamp_ns: int,
    observer: str,
    perceived: list[PerceivedArtefact],
) -> None:
    """Encoding directly and serialising the objects give the same, whatever the padding."""
    expected = on_the_wire(make_perceived(factory, frame_id, stamp_ns, observer, perceived))
    assert encode_perceived(frame_id, stamp_ns, observer, perceived) == expected


def make_path(factory: RosbagsFactory, path: PredictedPath) -> Any:
    """Return a path, pose by pose."""
    poses = [
        factory.make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=factory.make(
                "geometry_msgs/msg/Pose",
                position=factory.make(
                    "geometry_msgs/msg/Point", **dict(zip("xyz", numbers[:3], strict=True))
                ),
                orientation=factory.make(
                    "geometry_msgs/msg/Quaternion", **dict(zip("xyzw", numbers[3:7], strict=True))
                ),
            ),
            covariance=numbers[7:],
        )
        for numbers in path.numbers
    ]
    return factory.make("are_msgs/msg/PredictedPath", id=path.artefact_id, poses=poses)


@given(
    frame_id=TEXTS,
    stamp_ns=TIMES,
    observer=TEXTS,
    step_ns=TIMES,
    lengths=st.lists(st.integers(0, 3)),
)
def test_the_bytes_of_predicted_paths_are_those_of_the_message(
    on_the_wire: Wire,
    factory: RosbagsFactory,
    frame_id: str,
    stamp_ns: int,
    observer: str,
    step_ns: int,
    lengths: list[int],
) -> None:
    """Encoding directly and serialising the objects give the same, of empty paths too."""
    paths = [
        PredictedPath(7 * k, np.arange(43.0 * length).reshape(length, 43))
        for k, length in enumerate(lengths)
    ]
    message = factory.make(
        PATHS,
        header=make_header(factory, frame_id, stamp_ns),
        observer=observer,
        step=factory.make(
            "builtin_interfaces/msg/Duration", sec=step_ns // 10**9, nanosec=step_ns % 10**9
        ),
        paths=[make_path(factory, path) for path in paths],
    )
    assert encode_predicted(frame_id, stamp_ns, observer, step_ns, paths) == on_the_wire(message)


@given(
    frame_id=TEXTS,
    event=st.builds(
        ArtefactEvent, TIMES, st.sampled_from(EventKind), UINT64, TEXTS, TEXTS, NUMBERS
    ),
)
def test_the_bytes_of_an_event_are_those_of_the_message(
    on_the_wire: Wire, factory: RosbagsFactory, frame_id: str, event: ArtefactEvent
) -> None:
    """Encoding directly and serialising the object give the same."""
    assert encode_event(frame_id, event) == on_the_wire(make_event(factory, frame_id, event))


@given(
    frame_id=TEXTS,
    stamp_ns=TIMES,
    metrics=st.builds(SceneMetrics, *[UINT32] * 2, *[UINT64] * 5, *[NUMBERS] * 2),
)
def test_the_bytes_of_metrics_are_those_of_the_message(
    on_the_wire: Wire, factory: RosbagsFactory, frame_id: str, stamp_ns: int, metrics: SceneMetrics
) -> None:
    """Encoding directly and serialising the object give the same; rho is not known."""
    expected = on_the_wire(make_metrics(factory, frame_id, stamp_ns, metrics))
    assert encode_metrics(frame_id, stamp_ns, metrics) == expected


def test_rclpy_reads_them(both_readings: Readings) -> None:
    """Field by field what rosbags reads."""
    for count in range(3):
        data = encode_perceived("map", 9, "robot", [PERCEIVED] * count)
        by_rclpy, by_rosbags = both_readings(data, ARRAY)
        assert by_rclpy == by_rosbags
        assert len(by_rclpy["artefacts"]) == count
    event = ArtefactEvent(11, EventKind.ROBOT_CONTACT, 7, "adult", "the robot moved", 0.125)
    by_rclpy, by_rosbags = both_readings(encode_event("map", event), EVENT)
    assert by_rclpy == by_rosbags
    assert (by_rclpy["kind"], by_rclpy["detail"]) == ("6.0", "the robot moved")
    metrics = SceneMetrics(1, 2, 3, 4, 5, 6, 7, 8.5, 0.25)
    by_rclpy, by_rosbags = both_readings(encode_metrics("map", 9, metrics), METRICS)
    assert by_rclpy == by_rosbags
    assert (by_rclpy["robot_contacts"], by_rclpy["rho"]) == ("7.0", "nan")


def test_a_perceived_artefact_holds_no_truth() -> None:
    """Nothing in the message tells row, origin, behaviour or life."""
    fields = {name for name, _ in jazzy_typestore().fielddefs["are_msgs/msg/PerceivedArtefact"][1]}
    assert not fields & {"row", "origin", "behaviour", "arrival", "departure", "ground_pose"}


def test_the_constants_are_those_of_the_core() -> None:
    """Names and numbers of the enum are those of the message."""
    constants = {name: value for name, _, value in jazzy_typestore().fielddefs[EVENT][0]}
    assert constants == {member.name: member.value for member in EventKind}
