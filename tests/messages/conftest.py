"""Fixtures of the message tests: real message objects, built and serialised without ROS."""

from collections.abc import Callable
from typing import Any

import pytest

from are_ros.replay.message_types import RosbagsFactory, jazzy_typestore


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
