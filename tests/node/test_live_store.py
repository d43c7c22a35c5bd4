"""What the live builder keeps and relays without ticks; no DDS, messages stand for themselves."""

from collections import defaultdict
from typing import Any, NamedTuple, cast

import numpy as np
import pytest

from are_ros.bag.types import jazzy_typestore
from are_ros.builder.files.catalogue_file import SHIPPED_CATALOGUE, read_catalogue
from are_ros.errors import InputError
from are_ros.node.live_builder import Inbox, LiveBuilder
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.making import RosbagsFactory, make_grid

GRID = "nav_msgs/msg/OccupancyGrid"
NOW_NS = 1_000_000_000_000
ROLES = {
    "/map": "map",
    "/tf_static": "tf_static",
    "/tf": "tf",
    "/scan": "scan",
    "/camera/camera_info": "camera/camera_info",
}


class Message(NamedTuple):
    """A raw message."""

    topic: str
    data: bytes


class Decoding:
    """Decodes grids only."""

    def deserialize(self, message: Any) -> Any:
        """Return the message object; InputError for what is none."""
        if len(message.data) < 40:
            raise InputError(f"{message.topic}: no grid")
        return jazzy_typestore().deserialize_cdr(message.data, GRID)

    def transforms(self, message: Any) -> list[Any]:
        """Return nothing."""
        del message
        return []

    def odometry(self, message: Any) -> Any:
        """Refuse."""
        raise InputError(f"{message.topic}: no odometry")


class OutputSink:
    """Keeps what is published; everybody wants everything."""

    def __init__(self) -> None:
        self.sent: dict[str, list[bytes]] = defaultdict(list)

    def wanted(self) -> Any:
        """Return something that contains every name."""
        return self

    def __contains__(self, name: object) -> bool:
        return True

    def publish(self, name: str, data: bytes) -> None:
        """Keep a message."""
        self.sent[name].append(bytes(data))


def map_message(side: int, value: int = 0) -> Message:
    """Return a map of `side` cells squared, all of one value."""
    cells = np.full((side, side), value, dtype=np.int8)
    grid = OccupancyGrid(cells, 0.1, RigidTransform.identity(), "map")
    message = make_grid(RosbagsFactory(), grid)
    return Message("/map", bytes(jazzy_typestore().serialize_cdr(message, GRID)))


@pytest.fixture
def outlet() -> OutputSink:
    """Return where outputs go."""
    return OutputSink()


@pytest.fixture
def live(outlet: OutputSink) -> LiveBuilder:
    """Return a live builder that does not run yet."""
    parameters = with_values(Parameters(), {"camera.model": "pinhole"})
    catalogue = read_catalogue(SHIPPED_CATALOGUE)
    inbox = cast(Inbox, None)  # it is asked while the node runs only
    return LiveBuilder(parameters, catalogue, Decoding(), ROLES, inbox, outlet, lambda *_: None)


def test_before_the_time_is_known_only_the_newest_map_is_kept(live: LiveBuilder) -> None:
    """However many come; the same statics once; what is never latched not at all."""
    for value in range(100):
        live.store(map_message(20, value % 3), 0)
        live.store(Message("/camera/camera_info", b"%d" % value), 0)
        live.store(Message("/tf_static", b"same"), 0)
        live.store(Message("/tf", b"moving"), 0)
    kept = {stored.message.topic: stored.message.data for stored in live._stored}
    assert sorted(kept) == ["/camera/camera_info", "/map", "/tf_static"]
    assert len(live._stored) == 3
    assert kept["/camera/camera_info"] == b"99"
    live.work(NOW_NS)
    grid = live.builder.world.grid
    assert grid is not None
    assert grid.cells[0, 0] == 99 % 3
    assert len(live._stored) == 0


def test_the_latched_costmap_follows_the_map_while_nothing_runs(
    live: LiveBuilder, outlet: OutputSink
) -> None:
    """Before the first activation and in a pause alike: of the same size as the newest map."""
    for number, side in enumerate((20, 30)):
        live.store(map_message(side), NOW_NS + number)
        live.work(NOW_NS + number)
    live.resume(NOW_NS + 2)
    live.pause(NOW_NS + 3)
    live.store(map_message(40), NOW_NS + 4)
    live.work(NOW_NS + 4)
    sent = [
        jazzy_typestore().deserialize_cdr(data, GRID) for data in outlet.sent["augmented_costmap"]
    ]
    assert [one.info.width for one in sent] == [20, 30, 30, 40]
    maps = [jazzy_typestore().deserialize_cdr(data, GRID) for data in outlet.sent["augmented_map"]]
    assert [one.info.width for one in maps] == [20, 30, 30, 40]


def test_scans_are_relayed_byte_by_byte_while_nothing_runs(
    live: LiveBuilder, outlet: OutputSink
) -> None:
    """As they came, at once, and none is kept."""
    assert not live.store(Message("/scan", b"a scan"), NOW_NS)
    assert outlet.sent["scan"] == [b"a scan"]
    assert len(live._stored) == 0
