"""A tick as the messages of its outputs, ready for a publisher and for a recording alike."""

from collections.abc import Callable, Container, Iterable, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from are_ros.builder.costmap.augmented_map import GridUpdate
from are_ros.builder.tick import EVERYTHING, Demand, Tick
from are_ros.messages.artefacts import (
    ArtefactEncoder,
    encode_event,
    encode_metrics,
    encode_perceived,
)
from are_ros.messages.maps import encode_grid, encode_grid_update
from are_ros.messages.markers import MarkerEncoder
from are_ros.world.occupancy_grid import OccupancyGrid


class OutputTopic(NamedTuple):
    """How an output is offered, reliably; a latched one gives late subscribers its last message."""

    type_name: str
    is_latched: bool = False
    depth: int = 10


OUTPUTS: Final[Mapping[str, OutputTopic]] = MappingProxyType(
    {
        "augmented_map": OutputTopic("nav_msgs/msg/OccupancyGrid", is_latched=True, depth=1),
        "artefact_map": OutputTopic("nav_msgs/msg/OccupancyGrid", is_latched=True, depth=1),
        "augmented_costmap": OutputTopic("nav_msgs/msg/OccupancyGrid", is_latched=True, depth=1),
        "augmented_map_updates": OutputTopic("map_msgs/msg/OccupancyGridUpdate"),
        "artefact_map_updates": OutputTopic("map_msgs/msg/OccupancyGridUpdate"),
        "artefacts": OutputTopic("are_msgs/msg/ArtefactArray"),
        "perceived": OutputTopic("are_msgs/msg/PerceivedArtefactArray"),
        "events": OutputTopic("are_msgs/msg/ArtefactEvent", depth=100),
        "metrics": OutputTopic("are_msgs/msg/SceneMetrics"),
        "markers": OutputTopic("visualization_msgs/msg/MarkerArray"),
    }
)
"""The outputs of ticks by name, the last part of their topics."""


class EncodedMessage(NamedTuple):
    """A message of an output as little-endian XCDR1 with its encapsulation, and the tick's time."""

    name: str
    stamp_ns: int
    data: bytes


class TickEncoder:
    """Encodes the ticks of one builder, in their order.

    What stays the same from tick to tick is encoded once. Without perception in `demand`, which may
    change, there is no list of it: nobody is told that nothing was seen where nobody looked.
    """

    def __init__(self, demand: Demand = EVERYTHING) -> None:
        self.demand = demand
        self._artefacts = ArtefactEncoder()
        self._markers = MarkerEncoder()
        self._outputs: Mapping[str, Callable[[Tick], Iterable[bytes]]] = {
            "augmented_map": lambda tick: _grid(tick.grids.augmented_map),
            "augmented_map_updates": lambda tick: _update(tick.grids.update),
            "artefact_map": lambda tick: _grid(tick.grids.artefact_map),
            "artefact_map_updates": lambda tick: _update(tick.grids.artefact_update),
            "augmented_costmap": lambda tick: _grid(tick.grids.costmap),
            "events": _events,
            "artefacts": self._encode_artefacts,
            "perceived": self._encode_perceived,
            "metrics": _metrics,
            "markers": self._encode_markers,
        }

    def encode(self, tick: Tick, wanted: Container[str] | None = None) -> list[EncodedMessage]:
        """Return the messages of a tick, of the outputs `wanted` or of all.

        What is not wanted costs nothing, and may be wanted at any later tick. InputError for a name
        with the character NUL in it.
        """
        return [
            EncodedMessage(name, tick.stamp_ns, data)
            for name, encode in self._outputs.items()
            if wanted is None or name in wanted
            for data in encode(tick)
        ]

    def _encode_artefacts(self, tick: Tick) -> Iterable[bytes]:
        return (self._artefacts.encode(tick.frame_id, tick.stamp_ns, tick.artefacts),)

    def _encode_perceived(self, tick: Tick) -> Iterable[bytes]:
        if not self.demand.perception:
            return ()
        return (encode_perceived(tick.frame_id, tick.stamp_ns, tick.observer, tick.perceived),)

    def _encode_markers(self, tick: Tick) -> Iterable[bytes]:
        if not tick.markers:
            return ()
        return (self._markers.encode(tick.frame_id, tick.stamp_ns, tick.markers),)


def _grid(grid: OccupancyGrid | None) -> Iterable[bytes]:
    return () if grid is None else (encode_grid(grid),)


def _update(update: GridUpdate | None) -> Iterable[bytes]:
    return () if update is None else (encode_grid_update(update),)


def _events(tick: Tick) -> Iterable[bytes]:
    return [encode_event(tick.frame_id, event) for event in tick.events]


def _metrics(tick: Tick) -> Iterable[bytes]:
    return (encode_metrics(tick.frame_id, tick.stamp_ns, tick.metrics),)
