"""Message classes by name, and messages of rclpy built from plain values."""

from typing import Any

import numpy as np
import pytest

from tests.ros import NOT_SET_UP

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from are_ros.bag.types import jazzy_typestore, message_texts
from are_ros.errors import NodeError
from are_ros.node.message_classes import message_class, service_class
from are_ros.node.qos import INPUTS
from bags.simulation.making import RosbagsFactory, make_header
from tests.node.rclpy_factory import RclpyFactory


@pytest.mark.parametrize(
    "name", sorted({*message_texts(), *(i.type_name for i in INPUTS.values())})
)
def test_every_message_is_there_under_its_name(name: str) -> None:
    """Those that ARE brings along and those that it takes in."""
    found = message_class(name)
    package, _, last = name.split("/")
    assert found.__name__ == last
    assert found.__module__.startswith(f"{package}.msg.")


def test_services_are_there() -> None:
    """Ours and a standard one, with their requests."""
    assert service_class("are_msgs/srv/Reseed").Request(seed=3).seed == 3
    assert service_class("std_srvs/srv/Trigger").Response(success=True).success


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("no_msgs/msg/Thing", "no_msgs is not installed; 'sudo apt install ros-jazzy-no-msgs'"),
        ("are_msgs/msg/Thing", "another one; 'colcon build' in the workspace builds it, and 'make"),
        ("map_msgs/msg/Thing", "ros-jazzy-map-msgs' installs it, and 'make setup' in the project"),
        ("nav_msgs/OccupancyGrid", "it reads package/msg/Name"),
        ("are_msgs/srv/Reseed", "it reads package/msg/Name"),
        ("", "it reads package/msg/Name"),
    ],
)
def test_what_is_absent_is_named_with_the_command_that_brings_it(name: str, sentence: str) -> None:
    """One sentence."""
    with pytest.raises(NodeError) as caught:
        message_class(name)
    assert sentence in str(caught.value)
    assert str(caught.value).startswith((name, f"'{name}'"))


@pytest.mark.parametrize(
    ("kind", "dtype"),
    [("Int8", "i1"), ("UInt8", "u1"), ("Int32", "i4"), ("UInt64", "u8"), ("Float32", "f4")],
)
@pytest.mark.parametrize("count", [0, 3])
def test_arrays_are_filled_from_numpy(kind: str, dtype: str, count: int) -> None:
    """Whatever their type, also empty and also from a view with strides."""
    values = np.arange(2 * count).astype(dtype)[::2]
    message = RclpyFactory().make(f"std_msgs/msg/{kind}MultiArray", data=values)
    assert list(message.data) == list(values)
    assert message.data.itemsize == np.dtype(dtype).itemsize


def test_an_array_of_another_dtype_is_refused() -> None:
    """Nothing is converted unseen."""
    values = np.arange(3, dtype=np.int64)
    with pytest.raises(TypeError, match="an array of int64 for a field of int8"):
        RclpyFactory().make("nav_msgs/msg/OccupancyGrid", data=values)


def test_fixed_arrays_and_lists_keep_their_kind() -> None:
    """A covariance is a numpy array in rclpy too; flags are a list."""
    make = RclpyFactory().make
    covariance = np.arange(36, dtype=np.float64)
    pose = make("geometry_msgs/msg/PoseWithCovariance", covariance=covariance)
    assert pose.covariance is covariance
    flags = make("rcl_interfaces/msg/ParameterValue", bool_array_value=np.array([True, False]))
    assert flags.bool_array_value == [True, False]


def test_numbers_become_what_the_field_holds() -> None:
    """An int for a float, a numpy integer for an int, a number for a byte."""
    make = RclpyFactory().make
    assert repr(make("geometry_msgs/msg/Point", x=3).x) == "3.0"
    assert repr(make("std_msgs/msg/UInt32", data=np.uint64(5)).data) == "5"
    assert make("diagnostic_msgs/msg/DiagnosticStatus", level=2).level == b"\x02"


@pytest.mark.parametrize(
    ("fields", "kind"),
    [({"nothing": 1}, AttributeError), ({"x": "one"}, ValueError), ({"x": None}, TypeError)],
)
def test_what_does_not_fit_is_refused(fields: dict[str, Any], kind: type[Exception]) -> None:
    """Here, and not where rclpy would read it as something else."""
    with pytest.raises(kind):
        RclpyFactory().make("geometry_msgs/msg/Point", **fields)


@pytest.mark.usefixtures("ros_available")
@pytest.mark.parametrize("stamp_ns", [0, 1_234_567_890_123, -1])
def test_both_factories_build_the_same_message(stamp_ns: int) -> None:
    """What rosbags reads of it is equal; rclpy leaves the padding as it finds it."""
    from rclpy.serialization import serialize_message

    expected = make_header(RosbagsFactory(), "map", stamp_ns)
    data = serialize_message(make_header(RclpyFactory(), "map", stamp_ns))
    assert jazzy_typestore().deserialize_cdr(data, expected.__msgtype__) == expected
