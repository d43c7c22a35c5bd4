"""A tick as the messages of its outputs, ready for a publisher and for a recording alike."""

from collections.abc import Callable, Container, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from are_ros.builder.certainty.perception import Perception
from are_ros.builder.scene import Scene
from are_ros.builder.tick import USUAL, Demand, Tick
from are_ros.messages.artefacts import (
    ArtefactEncoder,
    encode_event,
    encode_metrics,
    encode_perceived,
    encode_predicted,
)
from are_ros.messages.images.detections import encode_boxes_of_perceived, encode_boxes_of_scene
from are_ros.messages.maps import encode_grid, encode_grid_update
from are_ros.messages.markers import MarkerEncoder
from are_ros.messages.sensors import encode_cloud
from are_ros.parameters.model import Parameters


class OutputTopic(NamedTuple):
    """How an output is offered, reliably; a latched one gives late subscribers its last message.

    `of_perception`: nobody can have it if what is perceived is not computed.
    """

    type_name: str
    is_latched: bool = False
    depth: int = 10
    of_perception: bool = False


OUTPUTS: Final[Mapping[str, OutputTopic]] = MappingProxyType(
    {
        "augmented_map": OutputTopic("nav_msgs/msg/OccupancyGrid", is_latched=True, depth=1),
        "artefact_map": OutputTopic("nav_msgs/msg/OccupancyGrid", is_latched=True, depth=1),
        "augmented_costmap": OutputTopic("nav_msgs/msg/OccupancyGrid", is_latched=True, depth=1),
        "augmented_map_updates": OutputTopic("map_msgs/msg/OccupancyGridUpdate"),
        "artefact_map_updates": OutputTopic("map_msgs/msg/OccupancyGridUpdate"),
        "artefacts": OutputTopic("are_msgs/msg/ArtefactArray"),
        "perceived": OutputTopic("are_msgs/msg/PerceivedArtefactArray", of_perception=True),
        "events": OutputTopic("are_msgs/msg/ArtefactEvent", depth=100, of_perception=True),
        "metrics": OutputTopic("are_msgs/msg/SceneMetrics", of_perception=True),
        "markers": OutputTopic("visualization_msgs/msg/MarkerArray", of_perception=True),
    }
)
"""The outputs of ticks by name, the last part of their topics."""

PREDICTED: Final = "predicted"
OCTOMAP: Final = "augmented_octomap"
ARTEFACT_BOXES: Final = "artefacts/boxes"
PERCEIVED_BOXES: Final = "perceived/boxes"
OPTIONAL_OUTPUTS: Final[Mapping[str, OutputTopic]] = MappingProxyType(
    {
        PREDICTED: OutputTopic("are_msgs/msg/PredictedPathArray", of_perception=True),
        OCTOMAP: OutputTopic("sensor_msgs/msg/PointCloud2", is_latched=True, depth=1),
        ARTEFACT_BOXES: OutputTopic("vision_msgs/msg/Detection3DArray"),
        PERCEIVED_BOXES: OutputTopic("vision_msgs/msg/Detection3DArray", of_perception=True),
    }
)
"""Those that only some parameters bring, or that have to be asked for."""

ALL_OUTPUTS: Final[Mapping[str, OutputTopic]] = MappingProxyType({**OUTPUTS, **OPTIONAL_OUTPUTS})


PARTS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "perception": ("perceived", PREDICTED, PERCEIVED_BOXES),
        "grids": tuple(name for name in OUTPUTS if "_map" in name or "_costmap" in name),
        "markers": ("markers",),
        "octomap": (OCTOMAP,),
    }
)
"""The outputs that there are not without a part of the demand."""

SKIPPED: Final = "skipped"
"""Names the note in a recording with the parts, apart from each other by spaces, that it lacks."""


def skipped_parts(demand: Demand) -> tuple[str, ...]:
    """Return the names of the parts that are there by default and not in this demand."""
    return tuple(part for part in PARTS if getattr(USUAL, part) and not getattr(demand, part))


def offered_outputs(parameters: Parameters, demand: Demand = USUAL) -> Mapping[str, OutputTopic]:
    """Return the outputs that there are with these parameters and this demand."""
    certainty = parameters.certainty
    left_out = {name for part in PARTS if not getattr(demand, part) for name in PARTS[part]}
    offered = {name: output for name, output in ALL_OUTPUTS.items() if name not in left_out}
    if not (certainty.enabled and certainty.prediction_horizon > 0.0):
        offered.pop(PREDICTED, None)
    if not parameters.sensors.boxes:
        del offered[ARTEFACT_BOXES]
        offered.pop(PERCEIVED_BOXES, None)
    return offered


class EncodedMessage(NamedTuple):
    """A message of an output as little-endian XCDR1 with its encapsulation, and the tick's time."""

    name: str
    stamp_ns: int
    data: bytes


class TickEncoder:
    """Encodes the ticks of one builder, in their order.

    What stays the same from tick to tick is encoded once. Without perception in `demand`, which may
    change, there is no list of the perceived: an empty one would say that the camera saw nothing.
    """

    def __init__(self, demand: Demand = USUAL, *, with_boxes: bool = False) -> None:
        self.demand = demand
        self._with_boxes = with_boxes
        self._artefacts = ArtefactEncoder()
        self._markers = MarkerEncoder()

    def encode(self, tick: Tick, wanted: Container[str] | None = None) -> list[EncodedMessage]:
        """Return the messages of a tick, of the outputs `wanted` or of all.

        What is not wanted costs nothing, and may be wanted at any later tick. InputError for a name
        with the character NUL in it.
        """
        frame_id, stamp_ns, grids = tick.frame_id, tick.stamp_ns, tick.grids
        perception = tick.perception
        is_demanded = self.demand.perception
        perceived = perception.artefacts if is_demanded else None
        paths = perception.paths if is_demanded else None
        seen_by = frame_id, perception.stamp_ns, tick.observer
        outputs: tuple[tuple[str, Any, Callable[[Any], bytes]], ...] = (
            ("augmented_map", grids.augmented_map, encode_grid),
            ("augmented_map_updates", grids.update, encode_grid_update),
            ("artefact_map", grids.artefact_map, encode_grid),
            ("artefact_map_updates", grids.artefact_update, encode_grid_update),
            ("augmented_costmap", grids.costmap, encode_grid),
            (OCTOMAP, tick.octomap, encode_cloud),
            *(("events", event, partial(encode_event, frame_id)) for event in tick.events),
            ("artefacts", tick.scene, partial(self._artefacts.encode, frame_id, stamp_ns)),
            ("perceived", perceived, partial(encode_perceived, *seen_by)),
            *(self._boxes(tick) if self._with_boxes else ()),
            (PREDICTED, paths, partial(encode_predicted, *seen_by, perception.step_ns)),
            ("metrics", tick.metrics, partial(encode_metrics, frame_id, stamp_ns)),
            ("markers", tick.markers or None, partial(self._markers.encode, frame_id, stamp_ns)),
        )
        return [
            EncodedMessage(name, stamp_ns, encode(value))
            for name, value, encode in outputs
            if value is not None and (wanted is None or name in wanted)
        ]

    def _boxes(self, tick: Tick) -> Sequence[tuple[str, Any, Callable[[Any], bytes]]]:
        """Return the boxes of a tick, of the artefacts and of what is perceived."""
        frame_id, perception = tick.frame_id, tick.perception
        perceived = perception if self.demand.perception else None
        of_scene = partial(encode_boxes_of_scene, frame_id, tick.stamp_ns)
        of_perceived = partial(_encode_perceived_boxes, frame_id, tick.scene)
        return (
            (ARTEFACT_BOXES, tick.scene, of_scene),
            (PERCEIVED_BOXES, perceived, of_perceived),
        )


def _encode_perceived_boxes(frame_id: str, scene: Scene, perception: Perception) -> bytes:
    """Return the boxes of what is perceived: where it is perceived, or where it is in the scene."""
    boxes, artefacts = perception.boxes, perception.artefacts
    if boxes is None:
        boxes = scene.only({one.artefact_id for one in artefacts}).boxes
    return encode_boxes_of_perceived(frame_id, perception.stamp_ns, artefacts, boxes)
