"""What comes in on one input: how much, how often, and what was refused of it and why."""

from collections import deque
from dataclasses import dataclass
from typing import Final

from are_ros.conventions import NS_PER_S
from are_ros.node.count_watch import CountWatch

RATE_WINDOW_NS: Final = 10 * NS_PER_S
REFUSAL_WINDOW_NS: Final = 10 * NS_PER_S
_MOST_STAMPS: Final = 1024
"""Beyond these the rate is that over the newest; a minute's transforms need not be kept."""


@dataclass(frozen=True)
class InputFigures:
    """An input at one moment; None where nothing can be said.

    `rate_hz` and `period_s` are those of the last messages, up to 10 s of them, whenever they came:
    they stay as they were when the input stops, and `age_s` grows.
    """

    count: int = 0
    refused: int = 0
    refused_lately: int = 0
    """In the last 10 s; refused messages count as messages too."""
    last_refusal: str = ""
    age_s: float | None = None
    period_s: float | None = None

    @property
    def rate_hz(self) -> float | None:
        """Messages per second."""
        return 1.0 / self.period_s if self.period_s else None


class InputWatch:
    """Counts the messages of one input; the times are those of a clock that never jumps."""

    def __init__(self) -> None:
        self.count = 0
        self.refused_count = 0
        self.last_refusal = ""
        self._stamps: deque[int] = deque(maxlen=_MOST_STAMPS)
        self._refusals = CountWatch(REFUSAL_WINDOW_NS)

    def received(self, now_ns: int) -> None:
        """Count a message, whether or not it will be refused."""
        self.count += 1
        self._stamps.append(now_ns)
        while self._stamps[0] <= now_ns - RATE_WINDOW_NS:
            self._stamps.popleft()

    def refused(self, now_ns: int, sentence: str) -> None:
        """Count a message that was received and refused, and keep the reason."""
        self.refused_count += 1
        self.last_refusal = sentence
        self._refusals.update(now_ns, self.refused_count)

    def figures(self, now_ns: int) -> InputFigures:
        """Return what is to be said now."""
        return InputFigures(
            count=self.count,
            refused=self.refused_count,
            refused_lately=self._refusals.growth(now_ns),
            last_refusal=self.last_refusal,
            age_s=(now_ns - self._stamps[-1]) / NS_PER_S if self._stamps else None,
            period_s=self._period_s(),
        )

    def _period_s(self) -> float | None:
        intervals = len(self._stamps) - 1
        if intervals < 1:
            return None
        return (self._stamps[-1] - self._stamps[0]) / intervals / NS_PER_S
