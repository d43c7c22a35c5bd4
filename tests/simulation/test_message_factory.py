"""The factory of rosbags objects."""

import numpy as np
import pytest

from are_ros.bag.types import jazzy_typestore
from bags.simulation.making import RosbagsFactory


@pytest.fixture(scope="module")
def factory() -> RosbagsFactory:
    """Return a factory of rosbags message objects."""
    return RosbagsFactory()


@pytest.mark.parametrize(
    "type_name",
    ["are_msgs/msg/ArtefactArray", "are_msgs/msg/PerceivedArtefact", "sensor_msgs/msg/CameraInfo",
     "visualization_msgs/msg/Marker", "diagnostic_msgs/msg/DiagnosticArray"],
)  # fmt: skip
def test_a_message_of_defaults_can_be_sent(factory: RosbagsFactory, type_name: str) -> None:
    """A message whose fields are all left out is valid on the wire."""
    store = jazzy_typestore()
    data = store.serialize_cdr(factory.make(type_name), type_name)
    assert store.serialize_cdr(store.deserialize_cdr(data, type_name), type_name) == data


def test_defaults_are_those_of_ros(factory: RosbagsFactory) -> None:
    """Numbers are zero, a quaternion is unturned, fixed arrays have their length."""
    pose = factory.make("geometry_msgs/msg/Pose")
    assert (pose.position.x, pose.orientation.w) == (0.0, 1.0)
    info = factory.make("sensor_msgs/msg/CameraInfo", width=3)
    assert (info.width, info.k.shape, info.d.shape) == (3, (9,), (0,))
    assert info.k.dtype == np.float64


def test_defaults_are_not_shared(factory: RosbagsFactory) -> None:
    """Each message has nested messages of its own."""
    one, other = factory.make("std_msgs/msg/Header"), factory.make("std_msgs/msg/Header")
    one.stamp.sec = 5
    assert other.stamp.sec == 0


def test_a_field_that_does_not_exist_is_an_error(factory: RosbagsFactory) -> None:
    """A misspelt field is not passed over."""
    with pytest.raises(TypeError):
        factory.make("std_msgs/msg/String", date="x")
