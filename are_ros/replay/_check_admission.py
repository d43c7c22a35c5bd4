"""Which artefacts the grids show at each tick: those that `costmap.gate` admits."""

from collections.abc import Iterator
from dataclasses import dataclass

from are_ros.conventions import seconds_to_ns
from are_ros.parameters.choices import CostmapGate
from are_ros.parameters.model import CostmapParameters
from are_ros.replay._check_cells import Cover, RealMap
from are_ros.replay._check_overlaps import covers_by_tick
from are_ros.replay._check_record import Record
from are_ros.replay._check_scene import Scene

_NEVER = -(2**63)


@dataclass(frozen=True, eq=False)
class AdmittedTick:
    """A tick with the real map that it knew (None: none yet), and the admitted boxes' cells."""

    scene: Scene
    real: RealMap | None
    covers: list[Cover]


def admitted_by_tick(record: Record, settings: CostmapParameters) -> Iterator[AdmittedTick]:
    """Yield every tick: all alive, or those perceived at most `costmap.memory` before."""
    seen_ns: dict[int, int] = {}
    perceived = record.perceived_ids()
    memory_ns = seconds_to_ns(settings.memory)
    for scene, real, covers in covers_by_tick(record):
        ids = scene.ids.tolist()
        if settings.gate is CostmapGate.ALL:
            yield AdmittedTick(scene, real, covers)
            continue
        seen_ns |= dict.fromkeys(perceived.get(scene.log_ns, ()), scene.stamp_ns)
        seen_ns = {number: seen_ns[number] for number in ids if number in seen_ns}
        limit_ns = scene.stamp_ns - memory_ns
        admitted = zip(ids, covers, strict=False)  # without a map there are no covers
        chosen = [cover for number, cover in admitted if seen_ns.get(number, _NEVER) >= limit_ns]
        yield AdmittedTick(scene, real, chosen)
