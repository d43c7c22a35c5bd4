"""Who went behind whom: followers and their leaders, as the followers' activities say."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.draw.scene import Doing, Life

Floats = npt.NDArray[np.float64]
Stamps = npt.NDArray[np.int64]

_FOLLOWS: Final = re.compile(r"(?:following|waiting behind) artefact (\d+)")
_SHORTEST_NS: Final = 2 * NS_PER_S
"""A shorter stretch, as between two moments of giving way, would only be clutter in a picture."""


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
    """Return every stretch of following a leader of `lives`, in the order of the followers."""
    standing = {life.artefact_id: life for life in lives if len(life.footprints)}
    return [
        Company(life, standing[leader_id], start_ns, stop_ns)
        for life in standing.values()
        for leader_id, start_ns, stop_ns in _stretches(life, end_ns)
        if leader_id in standing
    ]


def positions_at(life: Life, stamps_ns: Stamps) -> Floats:
    """Return where it stood (N, 2) at stamps (N,), held outside; there must be a pose."""
    after = np.searchsorted(life.footprints.stamps_ns, stamps_ns, side="right")
    positions: Floats = life.footprints.poses[np.maximum(after - 1, 0), :2]
    return positions


def _stretches(life: Life, end_ns: int) -> Iterator[tuple[int, int, int]]:
    """Yield whom it followed, by id, and the [start, stop) in which it did."""
    last_ns = end_ns if life.departure_ns is None else life.departure_ns
    stops_ns = [*(doing.since_ns for doing in life.doings[1:]), last_ns]
    # A life of which no doing is known has one stop and nothing to end there.
    spans = zip(map(_leader, life.doings), life.doings, stops_ns, strict=False)
    for leader, same in groupby(spans, key=itemgetter(0)):
        stretch = list(same)
        start_ns, stop_ns = stretch[0][1].since_ns, stretch[-1][2]
        if leader is not None and stop_ns - start_ns >= _SHORTEST_NS:
            yield leader, start_ns, stop_ns


def _leader(doing: Doing) -> int | None:
    """Return whom somebody follows who does this, by id; None if nobody."""
    match = _FOLLOWS.fullmatch(doing.activity)
    return int(match[1]) if match else None
