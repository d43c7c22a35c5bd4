"""The outputs of the builder into a recording, under the names that they have live."""

from collections.abc import Mapping, Sequence
from typing import Any

from are_ros.builder.outputs import ArtefactState
from are_ros.builder.sensor_path import ReleasedScan
from are_ros.builder.tick import EVERYTHING, Demand, Tick
from are_ros.messages.artefacts import (
    make_artefact,
    make_artefacts,
    make_event,
    make_metrics,
    make_perceived,
)
from are_ros.messages.factory import MessageFactory
from are_ros.messages.grid import make_grid, make_grid_update
from are_ros.messages.marker_encoding import encode_markers
from are_ros.messages.scan import make_scan
from are_ros.replay.bag_writer import BagWriter

PREFIX = "/ar_builder/"
_GRID = "nav_msgs/msg/OccupancyGrid"
_TICK_TOPICS = (
    ("artefacts", "are_msgs/msg/ArtefactArray", 10),
    ("perceived", "are_msgs/msg/PerceivedArtefactArray", 10),
    ("events", "are_msgs/msg/ArtefactEvent", 100),
    ("metrics", "are_msgs/msg/SceneMetrics", 10),
    ("markers", "visualization_msgs/msg/MarkerArray", 10),
)


class TickWriter:
    """Turns ticks and released scans into messages and appends them."""

    def __init__(
        self,
        writer: BagWriter,
        factory: MessageFactory,
        scan_topics: Sequence[str],
        demand: Demand = EVERYTHING,
    ) -> None:
        """Announce all output topics; `scan_topics` are the input topics of the scans."""
        self._demand = demand
        self._writer = writer
        self._factory = factory
        self._known: dict[int, tuple[ArtefactState, Any]] = {}
        self._scan_outputs = scan_outputs(scan_topics)
        for name in ("augmented_map", "augmented_costmap"):
            writer.add_topic(PREFIX + name, _GRID, is_latched=True, depth=1)
        update_type = "map_msgs/msg/OccupancyGridUpdate"
        writer.add_topic(PREFIX + "augmented_map_updates", update_type)
        for name, type_name, depth in _TICK_TOPICS:
            writer.add_topic(PREFIX + name, type_name, depth=depth)
        for output in self._scan_outputs.values():
            writer.add_topic(output, "sensor_msgs/msg/LaserScan")

    def write_tick(self, tick: Tick) -> None:
        """Append everything that a tick gives out, at its time."""
        make, frame_id, now_ns = self._factory, tick.frame_id, tick.stamp_ns
        self._write_grids(tick)
        for event in tick.events:
            self._write("events", now_ns, make_event(make, frame_id, event))
        artefacts = make_artefacts(make, frame_id, now_ns, self._artefact_messages(tick))
        self._write("artefacts", now_ns, artefacts)
        if self._demand.perception:
            perceived = make_perceived(make, frame_id, now_ns, tick.observer, tick.perceived)
            self._write("perceived", now_ns, perceived)
        self._write("metrics", now_ns, make_metrics(make, frame_id, now_ns, tick.metrics))
        if tick.markers:
            data = encode_markers(frame_id, now_ns, tick.markers)
            self._writer.write_raw(PREFIX + "markers", now_ns, data)

    def write_scans(self, scans: Sequence[ReleasedScan]) -> None:
        """Append scans, each at the time when it was released."""
        for released in scans:
            message = make_scan(self._factory, released.scan)
            output = self._scan_outputs[released.topic]
            self._writer.write(output, released.released_ns, message)

    def _artefact_messages(self, tick: Tick) -> list[Any]:
        """Return a message for each artefact; that of a state that is the same is kept."""
        messages = {}
        for state in tick.artefacts:
            known = self._known.get(state.artefact_id)
            if known is None or known[0] is not state:
                known = (state, make_artefact(self._factory, state))
            messages[state.artefact_id] = known
        self._known = messages
        return [message for _, message in messages.values()]

    def _write_grids(self, tick: Tick) -> None:
        grids, now_ns = tick.grids, tick.stamp_ns
        if grids.augmented_map is not None:
            self._write("augmented_map", now_ns, make_grid(self._factory, grids.augmented_map))
        if grids.update is not None:
            update = grids.update
            row0, col0 = update.rectangle.row0, update.rectangle.col0
            message = make_grid_update(
                self._factory, update.frame_id, update.stamp_ns, update.cells, row0, col0
            )
            self._write("augmented_map_updates", now_ns, message)
        if grids.costmap is not None:
            self._write("augmented_costmap", now_ns, make_grid(self._factory, grids.costmap))

    def _write(self, name: str, now_ns: int, message: object) -> None:
        self._writer.write(PREFIX + name, now_ns, message)


def scan_outputs(topics: Sequence[str]) -> Mapping[str, str]:
    """Return the output of each scan topic: ~/scan, or its own name under ~/ with several."""
    if len(topics) == 1:
        return {topics[0]: PREFIX + "scan"}
    return {topic: PREFIX + topic.lstrip("/") for topic in topics}
