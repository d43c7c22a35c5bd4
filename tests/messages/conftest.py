"""Fixtures of the message tests: real message objects, built and serialised without ROS."""

from array import array
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
import pytest

from are_ros.bag.types import jazzy_typestore
from bags.simulation.making import RosbagsFactory


@pytest.fixture(scope="session")
def factory() -> RosbagsFactory:
    """Return a factory of rosbags message objects."""
    return RosbagsFactory()


@pytest.fixture(scope="session")
def over_the_wire() -> Callable[[Any], Any]:
    """Return a function that serialises a message and reads it back."""

    def send(message: Any) -> Any:
        store, name = jazzy_typestore(), message.__msgtype__
        return store.deserialize_cdr(store.serialize_cdr(message, name), name)

    return send


@pytest.fixture(scope="session")
def on_the_wire() -> Callable[[Any], bytes]:
    """Return a function that serialises a message."""

    def serialised(message: Any) -> bytes:
        return bytes(jazzy_typestore().serialize_cdr(message, message.__msgtype__))

    return serialised


@pytest.fixture(scope="session")
def both_readings(ros_available: None) -> Callable[[bytes, str], tuple[Any, Any]]:  # noqa: ARG001
    """Return a function that gives what rclpy and rosbags read from bytes, as plain values."""
    from rclpy.serialization import deserialize_message

    def read(data: bytes, type_name: str) -> tuple[Any, Any]:
        package, _, name = type_name.split("/")
        kind = getattr(import_module(f"{package}.msg"), name)
        ours = jazzy_typestore().deserialize_cdr(data, type_name)
        return plain(deserialize_message(data, kind)), plain(ours)

    return read


def plain(value: Any) -> Any:
    """Return a message of rclpy or rosbags as dictionaries, lists and texts of numbers."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if hasattr(value, "__msgtype__"):
        fields = [name for name in vars(value) if name != "__msgtype__" and not name.isupper()]
        return {name: plain(getattr(value, name)) for name in fields}
    if isinstance(value, (list, tuple, array, np.ndarray)):
        return [plain(entry) for entry in value]
    return value if isinstance(value, str) else repr(float(value))
