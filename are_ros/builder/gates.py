"""Which artefacts the navigation stack is shown: those perceived, or all (§3.3, costmap.gate)."""

from collections.abc import Iterable
from typing import Protocol, TypeAlias

from are_ros.errors import ParameterError
from are_ros.parameters.choices import CostmapGate

Gate: TypeAlias = CostmapGate
"""The choice `costmap.gate`: perceived or all."""


class ArtefactGate(Protocol):
    """What decides, tick by tick, which artefacts are admitted."""

    def admitted(
        self,
        now_ns: int,
        perceived_ids: Iterable[int],
        alive_ids: Iterable[int],
        seen_ns: int | None = None,
    ) -> tuple[int, ...]:
        """Return the ids to show at `now_ns`, ascending; always a subset of the living.

        `seen_ns` is when the perceived were looked at, if not now.
        """
        ...


class GateMemory:
    """Admits the perceived, and for a while those who were: the paper's A_f at memory 0.

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
        perceived_ids: Iterable[int],
        alive_ids: Iterable[int],
        seen_ns: int | None = None,
    ) -> tuple[int, ...]:
        """Return the ids of the living seen recently enough, ascending.

        The departed are forgotten at once; a clock that jumped back forgets everything seen before.
        """
        if self._now_ns is not None and now_ns < self._now_ns:
            self._last_seen_ns.clear()
        self._now_ns = now_ns
        perceived, alive = set(perceived_ids), set(alive_ids)
        self._last_seen_ns.update(dict.fromkeys(perceived, now_ns if seen_ns is None else seen_ns))
        self._last_seen_ns = {i: seen for i, seen in self._last_seen_ns.items() if i in alive}
        shown = (i for i in alive if i in perceived or self._is_remembered(i, now_ns))
        return tuple(sorted(shown))

    def _is_remembered(self, artefact_id: int, now_ns: int) -> bool:
        seen_ns = self._last_seen_ns.get(artefact_id)
        return seen_ns is not None and now_ns - seen_ns <= self._memory_ns

    def last_seen_ns(self, artefact_id: int) -> int | None:
        """Return when a living artefact was last perceived, None if it never was.

        Kept for as long as it lives, also beyond the memory.
        """
        return self._last_seen_ns.get(artefact_id)


class OpenGate:
    """Admits every living artefact."""

    def admitted(
        self,
        now_ns: int,
        perceived_ids: Iterable[int],
        alive_ids: Iterable[int],
        seen_ns: int | None = None,
    ) -> tuple[int, ...]:
        """Return the ids of the living, ascending."""
        del now_ns, perceived_ids, seen_ns
        return tuple(sorted(set(alive_ids)))


def gate_of(gate: Gate, memory_ns: int) -> ArtefactGate:
    """Return the gate of this kind; the memory matters to `Gate.PERCEIVED` only."""
    return GateMemory(memory_ns) if gate is Gate.PERCEIVED else OpenGate()
