"""Which artefacts the navigation stack is shown: those perceived, or all (§3.3, costmap.gate)."""

from collections.abc import Collection, Iterable

from are_ros.errors import ParameterError
from are_ros.parameters.choices import CostmapGate


class GateMemory:
    """Admits the perceived, and for a while those that were: the paper's A_f at memory 0.

    An artefact last perceived at t is admitted while now - t <= `memory_ns`; the end is included,
    so that a memory of 0 means only now. ParameterError if the memory is negative.
    """

    def __init__(self, memory_ns: int) -> None:
        if memory_ns < 0:
            raise ParameterError(f"costmap.memory of {memory_ns} ns is negative")
        self._memory_ns = memory_ns
        self._last_seen_ns: dict[int, int] = {}
        self._now_ns: int | None = None

    def admitted(
        self,
        now_ns: int,
        perceived_ids: Collection[int],
        alive_ids: Iterable[int],
        seen_ns: int | None = None,
    ) -> tuple[int, ...]:
        """Return the ids of the living seen recently enough, ascending.

        `seen_ns` is when the perceived were looked at, if not now. The departed are forgotten at
        once; a clock that jumped back forgets everything seen before.
        """
        if self._now_ns is not None and now_ns < self._now_ns:
            self._last_seen_ns.clear()
        self._now_ns = now_ns
        last_ns = self._last_seen_ns
        last_ns.update(dict.fromkeys(perceived_ids, now_ns if seen_ns is None else seen_ns))
        self._last_seen_ns = {i: last_ns[i] for i in sorted(alive_ids) if i in last_ns}
        return tuple(
            i
            for i, ns in self._last_seen_ns.items()
            if i in perceived_ids or now_ns - ns <= self._memory_ns
        )


class OpenGate:
    """Admits every living artefact."""

    def admitted(
        self,
        now_ns: int,
        perceived_ids: Collection[int],
        alive_ids: Iterable[int],
        seen_ns: int | None = None,
    ) -> tuple[int, ...]:
        """Return the ids of the living, ascending."""
        del now_ns, perceived_ids, seen_ns
        return tuple(sorted(set(alive_ids)))


def gate_of(gate: CostmapGate, memory_ns: int) -> GateMemory | OpenGate:
    """Return the gate of this kind; the memory matters to `CostmapGate.PERCEIVED` only."""
    return GateMemory(memory_ns) if gate is CostmapGate.PERCEIVED else OpenGate()
