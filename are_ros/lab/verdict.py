"""The findings of the judge of motion: counts and sentences, and both as a table."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from are_ros.wording import aligned, counted

FAULTS: Final = {
    "overlaps": "overlaps of artefacts",
    "walls": "overlaps with walls",
    "robot": "overlaps with the robot, unreported",
    "limits": "limits of motion broken",
    "still": "a minute's stand without a cause",
    "deadlocks": "waiting for each other over a minute",
}
"""Faults by kind: the words of the table."""

_KEPT_SENTENCES = 50


@dataclass
class FollowerGaps:
    """The distance of followers from their leaders, over all seconds of following."""

    followed_s: float = 0.0
    near_s: float = 0.0
    gaps_m: float = 0.0

    def note(self, gap_m: float, seconds: float, *, is_near: bool) -> None:
        """Count some seconds at a distance from the leader."""
        self.followed_s += seconds
        self.near_s += seconds * is_near
        self.gaps_m += seconds * gap_m

    @property
    def near_share(self) -> float:
        """The share of the time near the leader; 1 without followers."""
        return self.near_s / self.followed_s if self.followed_s else 1.0

    @property
    def mean_gap_m(self) -> float:
        """The mean distance from the leader; 0 without followers."""
        return self.gaps_m / self.followed_s if self.followed_s else 0.0


@dataclass
class LongStand:
    """An artefact that stood for more than a minute: its place, start, duration and cause."""

    artefact_id: int
    label: str
    behaviour: str
    since_s: float
    stood_s: float
    x_m: float
    y_m: float
    cause: str


@dataclass
class Verdict:
    """What was counted; `found` by kind of `FAULTS`, with a sentence for the first fifty of each.

    Brakings harder than the type's acceleration are apart, for only a resolved collision may cause
    them; `dead_stops` are those of them that ended in a stand within the sub-step. `stands` are
    those of more than a minute, `causes` counts them by cause, `longest_s` is the longest.
    `travelled_m`, `lived_s` and `arrivals` (stops at a destination) are by behaviour.
    """

    artefact_s: float = 0.0
    moving_s: float = 0.0
    found: Counter[str] = field(default_factory=Counter)
    sentences: dict[str, list[str]] = field(default_factory=dict)
    hard_brakes: int = 0
    dead_stops: int = 0
    hardest_mps2: float = 0.0
    stands: list[LongStand] = field(default_factory=list)
    causes: Counter[str] = field(default_factory=Counter)
    longest_s: dict[str, float] = field(default_factory=dict)
    travelled_m: dict[str, float] = field(default_factory=dict)
    lived_s: dict[str, float] = field(default_factory=dict)
    arrivals: Counter[str] = field(default_factory=Counter)
    follower_gaps: FollowerGaps = field(default_factory=FollowerGaps)

    @property
    def is_clean(self) -> bool:
        """Whether no fault was found."""
        return not self.found

    def note(self, kind: str, t_s: float, sentence: str) -> None:
        """Count a fault at a time."""
        self.found[kind] += 1
        kept = self.sentences.setdefault(kind, [])
        if len(kept) < _KEPT_SENTENCES:
            kept.append(f"{t_s:.2f} s: {sentence}")

    def note_braking(self, deceleration_mps2: float, *, is_dead_stop: bool) -> None:
        """Count a braking harder than the type can."""
        self.hard_brakes += 1
        self.dead_stops += is_dead_stop
        self.hardest_mps2 = max(self.hardest_mps2, deceleration_mps2)

    def arrivals_per_minute(self, behaviour: str) -> float:
        """Return how often an artefact of a behaviour stops at a destination, per minute."""
        lived_s = self.lived_s.get(behaviour, 0.0)
        return 60.0 * self.arrivals[behaviour] / lived_s if lived_s else 0.0

    def table(self) -> list[str]:
        """Return the findings as lines of text."""
        lines = _columns(self._summary())
        lines += ["", *_columns(self._behaviours())]
        if self.causes:
            lines += ["", *_columns(self._stands())]
        for kind, sentences in self.sentences.items():
            lines += ["", f"{FAULTS[kind]}:", *(f"  {sentence}" for sentence in sentences[:5])]
        return lines

    def as_json(self) -> dict[str, Any]:
        """Return the findings as plain values for JSON."""
        return {
            "artefact_minutes": self.artefact_s / 60.0,
            "moving_minutes": self.moving_s / 60.0,
            "faults": {kind: self.found[kind] for kind in FAULTS},
            "sentences": self.sentences,
            "hard_brakes": self.hard_brakes,
            "dead_stops": self.dead_stops,
            "hardest_braking_mps2": self.hardest_mps2,
            "stands": [asdict(stand) for stand in self.stands],
            "stands_by_cause": dict(sorted(self.causes.items())),
            "longest_stand_s": dict(sorted(self.longest_s.items())),
            "lived_s": dict(sorted(self.lived_s.items())),
            "travelled_m": dict(sorted(self.travelled_m.items())),
            "arrivals": dict(sorted(self.arrivals.items())),
            "followed_s": self.follower_gaps.followed_s,
            "near_leader_share": self.follower_gaps.near_share,
            "mean_gap_m": self.follower_gaps.mean_gap_m,
        }

    def _summary(self) -> list[tuple[str, ...]]:
        follower_gaps = self.follower_gaps
        return [
            ("artefact-minutes", f"{self.artefact_s / 60.0:.1f}"),
            ("of them moving", f"{self.moving_s / 60.0:.1f}"),
            *((words, str(self.found[kind])) for kind, words in FAULTS.items()),
            ("brakings beyond the limit", self._brakings()),
            ("time that followers are near", f"{100.0 * follower_gaps.near_share:.0f} %"),
            ("mean distance to the leader", f"{follower_gaps.mean_gap_m:.2f} m"),
        ]

    def _brakings(self) -> str:
        if not self.hard_brakes:
            return "0"
        return f"{self.hard_brakes} ({counted(self.dead_stops, 'dead stop')})"

    def _behaviours(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = [("behaviour", "minutes", "m/s", "arrivals/min")]
        for name, lived_s in sorted(self.lived_s.items()):
            speed_mps = self.travelled_m.get(name, 0.0) / lived_s
            rate = self.arrivals_per_minute(name)
            rows.append((name, f"{lived_s / 60.0:.1f}", f"{speed_mps:.2f}", f"{rate:.2f}"))
        return rows

    def _stands(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = [("stands over a minute", "times", "longest [s]")]
        for cause, count in self.causes.most_common():
            rows.append((cause, str(count), f"{self.longest_s.get(cause, 0.0):.0f}"))
        return rows


def _columns(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Return rows of cells as lines; all columns but the first to the right."""
    return [line[2:] for line in aligned(rows, range(1, len(rows[0])))]
