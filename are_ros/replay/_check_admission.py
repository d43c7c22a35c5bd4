"""Which artefacts the grids show at each tick: those that `costmap.gate` admits."""

from collections.abc import Container, Iterator
from dataclasses import dataclass

from are_ros.checks.oracle_solids import Cover, RealMap
from are_ros.conventions import seconds_to_ns
from are_ros.parameters.choices import CostmapGate
from are_ros.parameters.model import CostmapParameters
from are_ros.replay._check_overlaps import covers_by_tick
from are_ros.replay._check_record import Record
from are_ros.replay._check_scene import Scene, time_ns

_NEVER = -(2**63)


@dataclass(frozen=True, eq=False)
class AdmittedTick:
    """A tick with the real map that it knew (None: none yet), and the admitted boxes' cells.

    `ids` are those of the admitted. `is_sure` is unset where a live recording does not tell who
    was perceived.
    """

    scene: Scene
    real: RealMap | None
    covers: list[Cover]
    ids: frozenset[int]
    is_sure: bool = True


def admitted_by_tick(record: Record, settings: CostmapParameters) -> Iterator[AdmittedTick]:
    """Yield every tick: all alive, or those perceived at most `costmap.memory` before."""
    seen_ns: dict[int, int] = {}
    perceived = _last_seen_ns(record)
    memory_ns = seconds_to_ns(settings.memory)
    unsure_until_ns = _NEVER
    for scene, real, covers in covers_by_tick(record):
        ids = scene.ids.tolist()
        if settings.gate is CostmapGate.ALL:
            yield AdmittedTick(scene, real, covers, frozenset(ids))
            continue
        if record.is_live:
            end_ns = _unsure_until_ns(record, scene, perceived.keys(), memory_ns)
            unsure_until_ns = max(unsure_until_ns, end_ns)
        now_seen = perceived.get(scene.log_ns, {})
        seen_ns |= now_seen
        seen_ns = {number: seen_ns[number] for number in ids if number in seen_ns}
        limit_ns = scene.stamp_ns - memory_ns
        shown = frozenset(i for i, at_ns in seen_ns.items() if i in now_seen or at_ns >= limit_ns)
        both = zip(ids, covers, strict=False)  # without a map there are no covers
        chosen = [cover for number, cover in both if number in shown]
        yield AdmittedTick(scene, real, chosen, shown, scene.stamp_ns >= unsure_until_ns)


def _last_seen_ns(record: Record) -> dict[int, dict[int, int]]:
    """Return when the perceived were looked at, by the tick's time and by id.

    With a camera that is slower than the ticks that was before the tick.
    """
    return {
        log_ns: {int(one.id): time_ns(one.last_seen) for one in message.artefacts}
        for log_ns, message in record.perceived
    }


def _unsure_until_ns(
    record: Record, scene: Scene, perceived_ns: Container[int], memory_ns: int
) -> int:
    """Return until when it is open who is admitted, as a list is missing, or those before it."""
    is_missing = scene.log_ns not in perceived_ns
    if is_missing or (memory_ns and record.runs.is_beginning(scene.stamp_ns)):
        return scene.stamp_ns + memory_ns + 1
    return _NEVER
