"""Headers: frame and stamp."""

from types import SimpleNamespace

import pytest

from are_ros.errors import InputError
from are_ros.messages.common import read_header
from bags.simulation.making import RosbagsFactory, make_header


def test_a_header_comes_back(factory: RosbagsFactory) -> None:
    """Frame and stamp survive; a leading slash of ROS 1 does not."""
    message = SimpleNamespace(header=make_header(factory, "/map", 5_000_000_007))
    assert read_header(message, "scan") == ("map", 5_000_000_007)


def test_a_header_without_frame_is_refused(factory: RosbagsFactory) -> None:
    """The sentence names topic and field."""
    message = SimpleNamespace(header=make_header(factory, "", 0))
    with pytest.raises(InputError, match=r"^/scan: header\.frame_id is empty$"):
        read_header(message, "/scan")
