"""What one tick of the builder gives out, and what it is asked for."""

from dataclasses import dataclass
from typing import Final

from are_ros.builder.costmap.augmented_map import Grids
from are_ros.builder.events import ArtefactEvent
from are_ros.builder.marker_batch import MarkerBatch
from are_ros.builder.outputs import ArtefactState, PerceivedArtefact, SceneMetrics
from are_ros.world.rigid_transform import RigidTransform


@dataclass(frozen=True)
class Demand:
    """Which parts somebody wants; what nobody wants is not computed.

    Without perception nothing counts as perceived, and no events tell of it.
    """

    perception: bool = True
    grids: bool = True
    markers: bool = True


EVERYTHING: Final = Demand()


@dataclass(frozen=True, eq=False)
class Tick:
    """The outputs of one tick, in the map's frame; `events` are those since the last tick.

    `map_from_base` and `map_from_camera` are the poses that the tick used, None where it had none:
    then nothing is perceived. Scans leave by a path of their own.
    """

    stamp_ns: int
    frame_id: str
    artefacts: tuple[ArtefactState, ...]
    observer: str
    perceived: tuple[PerceivedArtefact, ...]
    events: tuple[ArtefactEvent, ...]
    metrics: SceneMetrics
    markers: MarkerBatch
    grids: Grids
    map_from_base: RigidTransform | None
    map_from_camera: RigidTransform | None
