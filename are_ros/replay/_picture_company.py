"""Who went behind whom: followers and their leaders, from where both were.

The ground truth says that somebody follows, not whom: the leader is taken to be the one that was
nearest all along, of those that moved.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.replay.life_record import Life

Floats = npt.NDArray[np.float64]
Stamps = npt.NDArray[np.int64]

FOLLOWING: Final = "following"
_STEP_NS: Final = NS_PER_S // 2
_SHORTEST_NS: Final = 2 * NS_PER_S
_FARTHEST_M: Final = 3.5
_PRESENT: Final = 0.9
_MOVED_M: Final = 0.5


@dataclass(frozen=True, eq=False)
class Company:
    """A follower behind its leader, from `start_ns` to `end_ns`."""

    follower: Life
    leader: Life
    start_ns: int
    end_ns: int

    def instants(self, count: int) -> Stamps:
        """Return `count` stamps (count,) spread evenly over the inside of the stretch."""
        shares = (np.arange(count) + 0.5) / count
        instants: Stamps = self.start_ns + np.rint(shares * (self.end_ns - self.start_ns)).astype(
            np.int64
        )
        return instants


def companies(lives: Sequence[Life], end_ns: int) -> list[Company]:
    """Return every stretch of following whose leader is known, in the order of the followers."""
    standing = [life for life in lives if len(life.footprints)]
    found = []
    for life in standing:
        for start_ns, stop_ns in _stretches(life, end_ns):
            leader = _leader(life, standing, np.arange(start_ns, stop_ns, _STEP_NS))
            if leader is not None:
                found.append(Company(life, leader, start_ns, stop_ns))
    return found


def positions_at(life: Life, stamps_ns: Stamps) -> Floats:
    """Return where it stood (N, 2) at stamps (N,), held outside; there must be a pose."""
    after = np.searchsorted(life.footprints.stamps_ns, stamps_ns, side="right")
    positions: Floats = life.footprints.poses[np.maximum(after - 1, 0), :2]
    return positions


def _stretches(life: Life, end_ns: int) -> Iterator[tuple[int, int]]:
    """Yield [start, stop) of what it followed in; waiting behind the leader goes on with it."""
    last_ns = end_ns if life.departure_ns is None else life.departure_ns
    start_ns: int | None = None
    for doing in life.doings:
        follows = doing.behaviour == FOLLOWING and doing.activity in {"", FOLLOWING}
        if follows and start_ns is None:
            start_ns = doing.since_ns
        elif not follows and start_ns is not None:
            if doing.since_ns - start_ns >= _SHORTEST_NS:
                yield start_ns, doing.since_ns
            start_ns = None
    if start_ns is not None and last_ns - start_ns >= _SHORTEST_NS:
        yield start_ns, last_ns


def _leader(life: Life, others: Sequence[Life], stamps_ns: Stamps) -> Life | None:
    """Return who was nearest at most of the stamps, None if nobody was near."""
    here = positions_at(life, stamps_ns)
    near: list[tuple[float, int, Life]] = []
    for other in others:
        if not _may_lead(other, life) or _share_present(other, stamps_ns) < _PRESENT:
            continue
        there = positions_at(other, stamps_ns)
        if np.ptp(there, axis=0).max() < _MOVED_M:
            continue
        apart_m = np.linalg.norm(there - here, axis=1)
        near.append((float(np.median(apart_m)), other.artefact_id, other))
    apart_m, _, leader = min(near, key=lambda entry: entry[:2], default=(np.inf, 0, None))
    return leader if apart_m <= _FARTHEST_M else None


def _may_lead(other: Life, life: Life) -> bool:
    """Say whether it may be followed: of two followers only the younger follows the other."""
    follows = any(doing.behaviour == FOLLOWING for doing in other.doings)
    return other.artefact_id < life.artefact_id or (other is not life and not follows)


def _share_present(life: Life, stamps_ns: Stamps) -> float:
    gone_ns = np.iinfo(np.int64).max if life.departure_ns is None else life.departure_ns
    return float(((stamps_ns >= life.arrival_ns) & (stamps_ns < gone_ns)).mean())
