"""The artefacts' own messages."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from are_ros.artefacts.artefact import GroundPose, Origin
from are_ros.builder.events import ArtefactEvent, EventKind
from are_ros.builder.outputs import ArtefactState, PerceivedArtefact, SceneMetrics
from are_ros.messages.artefacts import (
    make_artefact,
    make_artefacts,
    make_event,
    make_metrics,
    make_perceived,
)
from are_ros.messages.geometry import read_vector
from are_ros.messages.poses import read_pose
from are_ros.messages.times import read_time
from are_ros.replay.message_types import RosbagsFactory, jazzy_typestore
from are_ros.world.rigid_transform import RigidTransform

POSE = RigidTransform.planar(1.0, 2.0, 0.5, z=0.9)
STATE = ArtefactState(
    7, 3, "adult", "person", POSE, GroundPose(1.0, 2.0, 0.25, 0.5), (0.0, 0.1, -0.05),
    (0.5, 0.6, 1.7), (1.2, 0.0, 0.0), (0.0, 0.0, 0.3), "walking", 5_000_000_001, 0, Origin.SERVICE,
    {"age": "30", "hat": "no"},
)  # fmt: skip
PERCEIVED = PerceivedArtefact(
    7, "adult", ("person", "car"), (0.75, 0.25), POSE, tuple(range(36)), (0.5, 0.6, 1.7),
    (1.2, 0.0, 0.0), (0.0, 0.0, 0.3), tuple(range(36, 72)), 120, 240, 0.5, 3.25, 0.875,
    (10, 20, 30, 40), 6_000_000_002,
)  # fmt: skip


def test_ground_truth_is_all_there(
    factory: RosbagsFactory, over_the_wire: Callable[[Any], Any]
) -> None:
    """Each field of an artefact's state stands in its message."""
    array = over_the_wire(make_artefacts(factory, "map", 9, [make_artefact(factory, STATE)]))
    (message,) = array.artefacts
    assert (array.header.frame_id, read_time(array.header.stamp)) == ("map", 9)
    assert (message.id, message.row, message.label) == (7, 3, "adult")
    assert (message.class_name, message.behaviour) == ("person", "walking")
    np.testing.assert_array_equal(read_pose(message.pose, "", "").matrix(), POSE.matrix())
    ground = read_pose(message.ground_pose, "", "")
    assert ground.translation_m.tolist() == [1.0, 2.0, 0.25]
    assert ground.yaw_rad() == pytest.approx(0.5, abs=1e-15)
    assert read_vector(message.box_centre) == (0.0, 0.1, -0.05)
    assert read_vector(message.size) == (0.5, 0.6, 1.7)
    assert read_vector(message.twist.linear) == (1.2, 0.0, 0.0)
    assert read_vector(message.twist.angular) == (0.0, 0.0, 0.3)
    assert (read_time(message.arrival), read_time(message.departure)) == (5_000_000_001, 0)
    assert message.origin == 2
    assert [(f.key, f.value) for f in message.features] == [("age", "30"), ("hat", "no")]


def test_what_is_perceived_is_all_there(
    factory: RosbagsFactory, over_the_wire: Callable[[Any], Any]
) -> None:
    """Each field of a perceived artefact stands in its message."""
    array = over_the_wire(make_perceived(factory, "map", 9, "robot", [PERCEIVED]))
    (message,) = array.artefacts
    assert (array.header.frame_id, array.observer) == ("map", "robot")
    assert (message.id, message.label, message.classes) == (7, "adult", ["person", "car"])
    assert message.probabilities.tolist() == [0.75, 0.25]
    np.testing.assert_array_equal(read_pose(message.pose.pose, "", "").matrix(), POSE.matrix())
    assert message.pose.covariance.tolist() == list(range(36))
    assert message.twist.covariance.tolist() == list(range(36, 72))
    assert read_vector(message.twist.twist.linear) == (1.2, 0.0, 0.0)
    assert read_vector(message.size) == (0.5, 0.6, 1.7)
    assert (message.visible_pixels, message.unoccluded_pixels) == (120, 240)
    assert (message.visible_fraction, message.range, message.existence) == (0.5, 3.25, 0.875)
    roi = message.roi
    assert (roi.x_offset, roi.y_offset, roi.width, roi.height) == (10, 20, 30, 40)
    assert read_time(message.last_seen) == 6_000_000_002


def test_a_perceived_artefact_holds_no_truth() -> None:
    """Nothing in the message tells row, origin, behaviour or life."""
    fields = {name for name, _ in jazzy_typestore().fielddefs["are_msgs/msg/PerceivedArtefact"][1]}
    assert not fields & {"row", "origin", "behaviour", "arrival", "departure", "ground_pose"}


def test_an_event_is_all_there(
    factory: RosbagsFactory, over_the_wire: Callable[[Any], Any]
) -> None:
    """Each field of an event stands in its message."""
    event = ArtefactEvent(11, EventKind.ROBOT_CONTACT, 7, "adult", "the robot moved", 0.125)
    message = over_the_wire(make_event(factory, "map", event))
    assert (message.header.frame_id, read_time(message.header.stamp)) == ("map", 11)
    assert (message.kind, message.id, message.label) == (6, 7, "adult")
    assert (message.detail, message.value) == ("the robot moved", 0.125)


def test_metrics_are_all_there(
    factory: RosbagsFactory, over_the_wire: Callable[[Any], Any]
) -> None:
    """Each number stands in its field; an unknown rho stays NaN."""
    metrics = SceneMetrics(1, 2, 3, 4, 5, 6, 7, 8.5, 0.25, math.nan)
    message = over_the_wire(make_metrics(factory, "map", 9, metrics))
    counts = (message.alive, message.perceived, message.arrivals, message.departures)
    assert counts == (1, 2, 3, 4)
    assert (message.blocked, message.displaced, message.robot_contacts) == (5, 6, 7)
    assert (message.area_m2, message.clutter_ratio) == (8.5, 0.25)
    assert math.isnan(message.rho)


@pytest.mark.parametrize(
    ("type_name", "enum"),
    [("are_msgs/msg/ArtefactEvent", EventKind), ("are_msgs/msg/Artefact", Origin)],
)
def test_the_constants_are_those_of_the_core(
    type_name: str, enum: type[EventKind] | type[Origin]
) -> None:
    """Names and numbers of the enums are those of the message."""
    constants = {name: value for name, _, value in jazzy_typestore().fielddefs[type_name][0]}
    assert constants == {member.name: member.value for member in enum}
