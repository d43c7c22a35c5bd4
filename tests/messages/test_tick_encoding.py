"""A tick as messages."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from are_ros.agents.events import (
    ArtefactEvent,
    EventKind,
    PerceivedArtefact,
    SceneMetrics,
    Sighting,
)
from are_ros.bag.types import jazzy_typestore
from are_ros.builder.certainty.perception import Perception
from are_ros.builder.costmap.augmented_map import ChangedRectangle, Grids, GridUpdate
from are_ros.builder.markers import DELETE_ALL, NO_MARKERS
from are_ros.builder.scene import Scene
from are_ros.builder.tick import Demand, Tick
from are_ros.messages.tick_encoding import (
    OUTPUTS,
    EncodedMessage,
    OutputTopic,
    TickEncoder,
)
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

MS = 1_000_000
STILL = (0.0, 0.0, 0.0)
CERTAIN = (0.0,) * 36
POSE = RigidTransform.planar(1.0, 2.0, 0.5, z=0.4)
ROW = CatalogueRow(
    3, "box", "things", (0.5, 0.4, 0.8), STILL, Shape.WALL, features={"colour": "red"}
)
ARTEFACT = Artefact(
    1, ROW, Origin.RANDOM, 5 * MS, PoseHistory(5 * MS, GroundPose(1.0, 2.0, 0.0, 0.5))
)
SEEN = PerceivedArtefact(
    1, "box", ("things",), (1.0,), POSE, CERTAIN, (0.5, 0.4, 0.8), STILL, STILL, CERTAIN,
    Sighting(9, 10, (1, 2, 3, 4), 2.5, 90 * MS), 1.0,
)  # fmt: skip
METRICS = SceneMetrics(1, 0, 2, 1, 0, 0, 0, 12.5, 0.25)
CELLS = np.array([[0, 100], [-1, 0]], np.int8)
GRID = OccupancyGrid(CELLS, 0.5, RigidTransform.identity(), "earth", 80 * MS)
UPDATE = GridUpdate("earth", 80 * MS, ChangedRectangle(0, 0, 2, 2), CELLS)
EVENT = ArtefactEvent(90 * MS, EventKind.ARRIVED, 1, "box")
IN_ORDER = [
    "augmented_map", "augmented_map_updates", "artefact_map", "artefact_map_updates",
    "augmented_costmap", "events", "events", "artefacts", "perceived", "metrics", "markers",
]  # fmt: skip


def tick(now_ns: int = 100 * MS, *artefacts: Artefact, **parts: Any) -> Tick:
    """Return a tick of these artefacts, on which nothing else is to be said."""
    values: dict[str, Any] = {
        "stamp_ns": now_ns,
        "frame_id": "earth",
        "scene": Scene.of(artefacts, now_ns),
        "observer": "robot",
        "perception": Perception(now_ns),
        "events": (),
        "metrics": METRICS,
        "markers": NO_MARKERS,
        "grids": Grids(),
        "octomap": None,
        "map_from_base": None,
        "map_from_camera": None,
    }
    return Tick(**(values | parts))


def full_tick(now_ns: int = 100 * MS) -> Tick:
    """Return a tick with something on every output."""
    grids = Grids(GRID, UPDATE, GRID, UPDATE, GRID)
    return tick(
        now_ns,
        ARTEFACT,
        perception=Perception(now_ns, (SEEN,)),
        events=(EVENT, EVENT),
        markers=DELETE_ALL,
        grids=grids,
    )


def names(messages: list[EncodedMessage]) -> list[str]:
    """Return the outputs of messages."""
    return [message.name for message in messages]


def read(message: EncodedMessage) -> Any:
    """Return a message as rosbags reads it."""
    return jazzy_typestore().deserialize_cdr(message.data, OUTPUTS[message.name].type_name)


def test_a_tick_becomes_messages_of_its_time() -> None:
    """Whatever a tick holds comes in one order, at its time and in its frame."""
    messages = TickEncoder().encode(full_tick())
    assert names(messages) == IN_ORDER
    assert {message.stamp_ns for message in messages} == {100 * MS}
    by_name = {message.name: read(message) for message in messages}
    assert set(by_name) == set(OUTPUTS)
    (marker,) = by_name.pop("markers").markers
    stamps = {name: one.header.stamp.nanosec // MS for name, one in by_name.items()}
    grids = dict.fromkeys(IN_ORDER[:5], 80)
    assert stamps == {"events": 90, "artefacts": 100, "perceived": 100, "metrics": 100, **grids}
    headers = [marker.header, *(one.header for one in by_name.values())]
    assert {header.frame_id for header in headers} == {"earth"}
    assert by_name["perceived"].observer == "robot"
    assert by_name["augmented_costmap"].data.tolist() == [0, 100, -1, 0]


def test_what_there_is_not_is_not_said() -> None:
    """Lists and metrics come with each tick, the others when there is something."""
    assert names(TickEncoder().encode(tick())) == ["artefacts", "perceived", "metrics"]


def test_without_perception_there_is_no_list_of_it() -> None:
    """Nobody is told that nothing was seen where nobody looked; the demand may change."""
    encoder = TickEncoder(Demand(perception=False))
    assert names(encoder.encode(tick())) == ["artefacts", "metrics"]
    encoder.demand = Demand()
    assert names(encoder.encode(tick())) == ["artefacts", "perceived", "metrics"]


@pytest.mark.parametrize("wanted", [(), ("metrics",), ("markers", "events"), tuple(OUTPUTS)])
def test_only_what_is_wanted_is_encoded(wanted: tuple[str, ...]) -> None:
    """In the order of all; and what comes later is what one gets who wanted all before."""
    encoder, other = TickEncoder(), TickEncoder()
    messages = encoder.encode(full_tick(), wanted)
    everything = other.encode(full_tick())
    assert messages == [message for message in everything if message.name in wanted]
    later = full_tick(200 * MS)
    assert encoder.encode(later) == other.encode(later)


def test_the_maps_are_latched() -> None:
    """A late subscriber gets the last of each; types are those that ROS knows."""
    latched = {name for name, topic in OUTPUTS.items() if topic.is_latched}
    assert latched == {"augmented_map", "artefact_map", "augmented_costmap"}
    assert all((topic.depth == 1) == topic.is_latched for topic in OUTPUTS.values())
    assert OUTPUTS["events"] == OutputTopic("are_msgs/msg/ArtefactEvent", False, 100, True)
    assert all(topic.type_name in jazzy_typestore().types for topic in OUTPUTS.values())


def test_rclpy_reads_all_of_it(both_readings: Callable[[bytes, str], tuple[Any, Any]]) -> None:
    """Message by message and field by field what rosbags reads."""
    messages = TickEncoder().encode(full_tick())
    assert names(messages) == IN_ORDER
    for message in messages:
        by_rclpy, by_rosbags = both_readings(message.data, OUTPUTS[message.name].type_name)
        assert by_rclpy == by_rosbags
