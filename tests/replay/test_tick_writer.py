"""Ticks and scans as messages of a recording."""

from pathlib import Path
from typing import Any

import numpy as np

from are_ros.agents.events import ArtefactEvent, EventKind, SceneMetrics
from are_ros.bag.reader import BagReader
from are_ros.bag.recording import PREFIX
from are_ros.bag.writer import BagWriter
from are_ros.builder.certainty.perception import Perception
from are_ros.builder.costmap.augmented_map import Grids
from are_ros.builder.markers import NO_MARKERS
from are_ros.builder.scene import Scene
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.builder.sensors.sensor_path import ReleasedReading
from are_ros.builder.tick import USUAL, Demand, Tick
from are_ros.messages.tick_encoding import OUTPUTS
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.replay.listeners import TickWriter
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

MS = 1_000_000
METRICS = SceneMetrics(1, 0, 2, 1, 0, 0, 0, 12.5, 0.25)


ROW = CatalogueRow(
    3, "box", "things", (0.5, 0.4, 0.8), (0.0, 0.0, 0.0), Shape.WALL, features={"colour": "red"}
)


def standing(artefact_id: int, x_m: float = 1.0) -> Artefact:
    """Return a standing artefact."""
    history = PoseHistory(5 * MS, GroundPose(x_m, 2.0, 0.0, 0.5))
    return Artefact(artefact_id, ROW, Origin.RANDOM, 5 * MS, history)


def tick(now_ns: int, *artefacts: Artefact, **parts: Any) -> Tick:
    """Return a tick of these artefacts, nothing perceived."""
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


def written(path: Path, *ticks: Tick, demand: Demand = USUAL) -> list[tuple[str, int, Any]]:
    """Write ticks, and return what stands in the recording."""
    with BagWriter(path) as writer:
        tick_writer = TickWriter(writer, {}, Parameters(), demand)
        for one in ticks:
            tick_writer.take_tick(one)
    with BagReader([path]) as reader:
        return [(m.topic, m.log_time_ns, reader.deserialize(m)) for m in reader.messages()]


def test_a_tick_becomes_messages_of_its_time(tmp_path: Path) -> None:
    """List, sightings, metrics and each event are written at the tick's time, in its frame."""
    event = ArtefactEvent(90 * MS, EventKind.ARRIVED, 1, "box", "", 0.0)
    found = written(tmp_path / "a.mcap", tick(100 * MS, standing(1), events=(event, event)))
    names = [topic.removeprefix(PREFIX) for topic, _, _ in found]
    assert names == ["events", "events", "artefacts", "perceived", "metrics"]
    assert {at for _, at, _ in found} == {100 * MS}
    assert {message.header.frame_id for _, _, message in found} == {"earth"}
    by_name = dict(zip(names, (message for _, _, message in found), strict=True))
    assert by_name["events"].header.stamp.nanosec == 90 * MS
    assert by_name["perceived"].observer == "robot"
    assert by_name["metrics"].area_m2 == 12.5
    (artefact,) = by_name["artefacts"].artefacts
    assert (artefact.id, artefact.row, artefact.label) == (1, 3, "box")


def test_without_perception_no_list_of_it_is_written(tmp_path: Path) -> None:
    """Nobody is told that nothing was seen where nobody looked."""
    demand = Demand(perception=False)
    found = written(tmp_path / "a.mcap", tick(0), demand=demand)
    assert [topic.removeprefix(PREFIX) for topic, _, _ in found] == ["artefacts", "metrics"]


def test_grids_are_written_when_there_are_some(tmp_path: Path) -> None:
    """Whole maps and a costmap go out, latched, when they changed."""
    cells = np.array([[0, 100], [-1, 0]], np.int8)
    grid = OccupancyGrid(cells, 0.5, RigidTransform.identity(), "earth")
    grids = Grids(augmented_map=grid, artefact_map=grid, costmap=grid)
    found = written(tmp_path / "a.mcap", tick(0, grids=grids), tick(MS))
    maps = [(topic, message) for topic, _, message in found if hasattr(message, "info")]
    assert [topic for topic, _ in maps] == [
        PREFIX + "augmented_map",
        PREFIX + "artefact_map",
        PREFIX + "augmented_costmap",
    ]
    assert all(message.data.tolist() == [0, 100, -1, 0] for _, message in maps)
    with BagReader([tmp_path / "a.mcap"]) as reader:
        latched = {topic.name.removeprefix(PREFIX) for topic in reader.topics if topic.is_latched}
    assert latched == {"augmented_map", "artefact_map", "augmented_costmap"}


def test_all_topics_are_announced(tmp_path: Path) -> None:
    """Also those on which nothing is said, in their order, the scans at the end."""
    with BagWriter(tmp_path / "a.mcap") as writer:
        TickWriter(writer, {"/base_scan": "scan", "/odom": "odom"}, Parameters())
        names = [topic.removeprefix(PREFIX) for topic in writer.counts()]
    assert names == [*OUTPUTS, "scan"]


def test_scans_are_written_when_they_were_released(tmp_path: Path) -> None:
    """Log time is the release, the stamp the scan's own; the topic is the input's under ~/."""
    ranges = np.array([1.0, 2.0], np.float32)
    scan = LaserScan(
        "laser", 40 * MS, 0.0, 0.1, 0.1, 0.0, 0.1, 0.1, 9.0, ranges, np.empty(0, np.float32)
    )
    with BagWriter(tmp_path / "a.mcap") as writer:
        roles = {"/front/scan": "scan", "/rear/scan": "scan"}
        tick_writer = TickWriter(writer, roles, Parameters())
        tick_writer.take_readings([ReleasedReading("/rear/scan", scan, 70 * MS, is_augmented=True)])
    with BagReader([tmp_path / "a.mcap"]) as reader:
        (message,) = reader.messages()
        content = reader.deserialize(message)
    assert (message.topic, message.log_time_ns) == (PREFIX + "rear/scan", 70 * MS)
    assert content.header.stamp.nanosec == 40 * MS
    assert content.ranges.tolist() == [1.0, 2.0]
