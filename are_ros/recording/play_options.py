"""What is asked of a player."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from are_ros.errors import BagError


@dataclass(frozen=True)
class PlayOptions:
    """The options of `are play`; BagError for one that makes no sense.

    `topics` (empty: all) and `exclude` are names as recorded, `remaps` gives others. `clock_hz` of
    0: no /clock. `lockstep` names the nodes to keep in step with, `wait_for` those
    to wait for, for at most `wait_s`: long enough for kernels to be compiled on a busy machine.
    """

    bags: tuple[Path, ...]
    rate: float = 1.0
    loop: bool = False
    start_s: float = 0.0
    duration_s: float | None = None
    topics: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    remaps: Mapping[str, str] = field(default_factory=dict)
    clock_hz: float = 100.0
    lockstep: tuple[str, ...] = ()
    wait_for: tuple[str, ...] = ()
    wait_s: float = 600.0

    def __post_init__(self) -> None:
        if not 0.0 < self.rate < math.inf:
            raise BagError(f"--rate {self.rate}: it is not a number above 0")
        if not 0.0 <= self.clock_hz <= 1000.0:
            raise BagError(f"--clock {self.clock_hz}: it is not a rate from 0 to 1000 Hz")
        if self.lockstep and not self.clock_hz:
            raise BagError("--lockstep needs /clock: leave --clock 0 out")

    def check_topics(self, recorded: Collection[str]) -> None:
        """Raise BagError where an option names a topic that was not recorded."""
        known = set(map(_slashed, recorded))
        named = {"--topics": self.topics, "--exclude": self.exclude, "--remap": self.remaps}
        for option, topics in named.items():
            for topic in topics:
                if _slashed(topic) not in known:
                    there = ", ".join(sorted(known))
                    raise BagError(f"{option} {topic}: not in the recording, which has {there}")

    def is_chosen(self, topic: str) -> bool:
        """Tell whether a recorded topic is to be played."""
        chosen = not self.topics or _slashed(topic) in map(_slashed, self.topics)
        return chosen and _slashed(topic) not in map(_slashed, self.exclude)

    def target(self, topic: str) -> str:
        """Return the name under which a recorded topic is played."""
        remaps = {_slashed(source): target for source, target in self.remaps.items()}
        return _slashed(remaps.get(_slashed(topic), topic))


def _slashed(name: str) -> str:
    return name if name.startswith("/") else f"/{name}"
