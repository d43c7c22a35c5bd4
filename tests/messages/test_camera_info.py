"""CameraInfo of both kinds of ROS."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from are_ros.messages.common import Header, read_header
from are_ros.messages.images.image import encode_camera_info, read_camera_info
from are_ros.world.cameras import CameraInfo
from bags.simulation.making import RosbagsFactory, make_camera_info

INFO = CameraInfo(
    640, 480, "plumb_bob", (0.1, -0.2, 0.0, 0.01, 0.0),
    (500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0),
    (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    (505.0, 0.0, 321.0, 0.0, 0.0, 515.0, 241.0, 0.0, 0.0, 0.0, 1.0, 0.0),
    2, 1, (10, 20, 600, 400),
)  # fmt: skip


def test_an_info_comes_back(factory: RosbagsFactory, over_the_wire: Callable[[Any], Any]) -> None:
    """Every number survives the wire, and equal infos are equal values."""
    message = over_the_wire(make_camera_info(factory, Header("camera", 7), INFO))
    assert read_camera_info(message) == INFO
    assert read_header(message, "camera_info") == ("camera", 7)


@pytest.mark.parametrize("info", [INFO, replace(INFO, d=(), do_rectify=True)])
def test_the_bytes_are_those_of_the_message(
    factory: RosbagsFactory, on_the_wire: Callable[[Any], bytes], info: CameraInfo
) -> None:
    """Encoding directly and serialising the object give the same."""
    message = make_camera_info(factory, Header("camera", 7), info)
    message.roi.do_rectify = info.do_rectify
    assert encode_camera_info(info, "camera", 7) == on_the_wire(message)


def test_the_names_of_ros_1_are_read(factory: RosbagsFactory) -> None:
    """ROS 1 wrote D, K, R and P."""
    message = make_camera_info(factory, Header("camera", 7), INFO)
    capitals = {name.upper(): getattr(message, name) for name in "dkrp"}
    others = {name: getattr(message, name) for name in vars(message) if name not in "dkrp"}
    assert read_camera_info(SimpleNamespace(**capitals, **others)) == INFO
