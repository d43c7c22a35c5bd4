"""Which artefacts the navigation stack is shown: those perceived, or all (§3.3, costmap.gate)."""

from collections.abc import Iterable, Mapping

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
        self, now_ns: int, perceived_ns: Mapping[int, int], alive_ids: Iterable[int]
    ) -> tuple[int, ...]:
        """Return the ids of the living seen recently enough, ascending.

        `perceived_ns` is when those perceived now were seen, by id. The departed are forgotten at
        once; a clock that jumped back forgets everything seen before.
        """
        if self._now_ns is not None and now_ns < self._now_ns:
            self._last_seen_ns.clear()
        self._now_ns = now_ns
        last_ns = self._last_seen_ns
        last_ns.update(perceived_ns)
        self._last_seen_ns = {i: last_ns[i] for i in sorted(alive_ids) if i in last_ns}
        return tuple(
            i
            for i, ns in self._last_seen_ns.items()
            if i in perceived_ns or now_ns - ns <= self._memory_ns
        )


class OpenGate:
    """Admits every living artefact."""

    def admitted(
        self, now_ns: int, perceived_ns: Mapping[int, int], alive_ids: Iterable[int]
    ) -> tuple[int, ...]:
        """Return the ids of the living, ascending."""
        del now_ns, perceived_ns
        return tuple(sorted(set(alive_ids)))


def gate_of(gate: CostmapGate, memory_ns: int) -> GateMemory | OpenGate:
    """Return the gate of this kind; the memory matters to `CostmapGate.PERCEIVED` only."""
    return GateMemory(memory_ns) if gate is CostmapGate.PERCEIVED else OpenGate()
