"""When ticks run, what one tick gives out, and what it is asked for."""

from dataclasses import dataclass
from typing import Final

from are_ros.agents.events import ArtefactEvent, ArtefactState, PerceivedArtefact, SceneMetrics
from are_ros.builder.certainty.perception import Perception
from are_ros.builder.costmap.augmented_map import Grids
from are_ros.builder.markers import MarkerBatch
from are_ros.builder.scene import Scene
from are_ros.builder.sensors.point_cloud import PointCloud
from are_ros.conventions import NS_PER_S
from are_ros.world.rigid_transform import RigidTransform


@dataclass(frozen=True)
class Demand:
    """Which parts of a tick are wanted; the others are not computed.

    Without perception nothing counts as perceived, and there are no events of it. The octomap is
    large, so that it has to be asked for.
    """

    perception: bool = True
    grids: bool = True
    markers: bool = True
    octomap: bool = False


USUAL: Final = Demand()
MOTION_ONLY: Final = Demand(perception=False, grids=False, markers=False)


@dataclass(frozen=True, eq=False)
class Tick:
    """The outputs of one tick, in the map's frame; `events` are those since the last tick.

    `scene` are the living artefacts as columns. `octomap` is M3D with the surfaces of the
    artefacts, where it goes out. `perception` is what the observer is told to perceive, as of a
    stamp of its own. `map_from_base` and `map_from_camera` are the poses that the tick used, None
    where it had none: then nothing is seen. Readings of sensors leave by a path of their own.
    """

    stamp_ns: int
    frame_id: str
    scene: Scene
    observer: str
    perception: Perception
    events: tuple[ArtefactEvent, ...]
    metrics: SceneMetrics
    markers: MarkerBatch
    grids: Grids
    octomap: PointCloud | None
    map_from_base: RigidTransform | None
    map_from_camera: RigidTransform | None

    @property
    def perceived(self) -> tuple[PerceivedArtefact, ...]:
        """The artefacts of the perception."""
        return self.perception.artefacts

    @property
    def artefacts(self) -> tuple[ArtefactState, ...]:
        """The ground truth, artefact by artefact: new values each time, made from the scene."""
        return tuple([self.scene.state(k) for k in range(len(self.scene))])


@dataclass
class TickSchedule:
    """Gives the instants of the ticks [ns], in order, each once.

    The first is the first multiple of the period not before `start_ns`.
    """

    period_ns: int
    next_ns: int

    @classmethod
    def of(cls, rate_hz: float, start_ns: int) -> "TickSchedule":
        """Return the schedule of a rate from an instant on."""
        period_ns = tick_period_ns(rate_hz)
        return cls(period_ns, -(-start_ns // period_ns) * period_ns)

    def pop(self, until_ns: int) -> int | None:
        """Return the next instant if it is not after `until_ns`, and go on to the one after."""
        if self.next_ns > until_ns:
            return None
        instant_ns = self.next_ns
        self.next_ns += self.period_ns
        return instant_ns

    def skip_to(self, now_ns: int, backlog_ns: int) -> int:
        """Leave out the ticks that are late by `backlog_ns` or more; return their number.

        This is for a machine that cannot keep up, and for clocks that jump ahead.
        """
        behind = (now_ns - backlog_ns - self.next_ns) // self.period_ns + 1
        skipped = max(0, behind)
        self.next_ns += skipped * self.period_ns
        return skipped


def tick_period_ns(rate_hz: float) -> int:
    """Return the time from tick to tick [ns]; tick k is at exactly k of them since the epoch."""
    return round(NS_PER_S / rate_hz)
