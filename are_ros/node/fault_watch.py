"""Behaviours of the user's own that failed: what is to be logged of them, and how often."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Final

from are_ros.conventions import NS_PER_S
from are_ros.errors import BehaviourError
from are_ros.wording import counted

_REST_NS: Final = 60 * NS_PER_S
"""So long nothing more is logged of a behaviour, however often it fails."""


@dataclass(frozen=True)
class FaultSnapshot:
    """How many artefacts have lost their behaviour since the start, by its name, and the last.

    `hung` says which has not returned for long at last, and for how long.
    """

    counts: dict[str, int] = field(default_factory=dict)
    last: str = ""
    hung: str = ""


@dataclass
class _Fault:
    sentence: str
    untold: int = 0
    told_ns: int | None = None


class FaultWatch:
    """Told of each fault; says of each behaviour the first at once, then one a minute at most."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._faults: dict[str, _Fault] = {}
        self._last = ""
        self.hung = ""

    def take(self, fault: BehaviourError) -> None:
        """Take a fault."""
        self._last = str(fault)
        self._counts[fault.behaviour] += 1
        known = self._faults.setdefault(fault.behaviour, _Fault(self._last))
        known.sentence, known.untold = self._last, known.untold + 1

    def sentences(self, now_ns: int) -> list[str]:
        """Return what is to be logged now, by a clock that never jumps."""
        due = [fault for fault in self._faults.values() if _is_due(fault, now_ns)]
        sentences = [f"{fault.sentence}; it stands from now on{_more(fault)}" for fault in due]
        for fault in due:
            fault.untold, fault.told_ns = 0, now_ns
        return sentences

    def snapshot(self) -> FaultSnapshot:
        """Return what there is to say for the diagnostics."""
        return FaultSnapshot(dict(sorted(self._counts.items())), self._last, self.hung)


def _is_due(fault: _Fault, now_ns: int) -> bool:
    is_rested = fault.told_ns is None or now_ns - fault.told_ns >= _REST_NS
    return is_rested and fault.untold > 0


def _more(fault: _Fault) -> str:
    others = fault.untold - 1
    return f", as {counted(others, 'other')} before it" if others else ""
