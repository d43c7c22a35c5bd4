"""How the frames of a recording hang together, for a person to read."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field

from are_ros.conventions import NS_PER_S
from are_ros.messages.transforms import StampedTransform
from are_ros.wording import listed

_AHEAD_NS = NS_PER_S // 10
"""Stamps later than the recording by more than this are worth a word."""


@dataclass(frozen=True)
class SurveyedEdge:
    """One edge parent -> child as it was recorded; the names have no leading slash.

    `rate_hz` is the mean rate between the first and the last stamp, 0 for a static edge or a single
    one. `ahead_ns` is how much later than the recording the worst stamp was (negative: earlier).
    """

    parent: str
    child: str
    is_static: bool
    topics: tuple[str, ...]
    count: int
    first_ns: int
    last_ns: int
    ahead_ns: int

    @property
    def rate_hz(self) -> float:
        """Mean rate of the stamps."""
        duration_ns = self.last_ns - self.first_ns
        if self.is_static or duration_ns <= 0:
            return 0.0
        return (self.count - 1) * NS_PER_S / duration_ns

    def rate_text(self) -> str:
        """Return the rate in words; where all stamps are one, there is none."""
        if self.is_static:
            return "static"
        if self.first_ns == self.last_ns:
            return "once" if self.count == 1 else "one stamp"
        return f"{self.rate_hz:.1f} Hz" if self.rate_hz >= 0.05 else f"{self.rate_hz:.1g} Hz"


@dataclass(frozen=True)
class FrameSurvey:
    """All edges in order of name, and what is odd about them, a sentence each."""

    edges: tuple[SurveyedEdge, ...]
    oddities: tuple[str, ...]

    def frames(self) -> tuple[str, ...]:
        """Return the names of all frames, sorted."""
        return tuple(sorted({name for edge in self.edges for name in (edge.parent, edge.child)}))

    def connected_to(self, frame: str) -> frozenset[str]:
        """Return the frames that a chain of edges joins to `frame`, itself among them."""
        neighbours: dict[str, set[str]] = defaultdict(set)
        for edge in self.edges:
            neighbours[edge.parent].add(edge.child)
            neighbours[edge.child].add(edge.parent)
        reached, waiting = {frame}, [frame]
        while waiting:
            new = neighbours[waiting.pop()] - reached
            reached |= new
            waiting.extend(new)
        return frozenset(reached)

    def tree_lines(self) -> tuple[str, ...]:
        """Return the tree as indented lines, roots first; each edge stands once."""
        children: dict[str, list[SurveyedEdge]] = defaultdict(list)
        for edge in self.edges:
            children[edge.parent].append(edge)
        has_parent = {edge.child for edge in self.edges}
        roots = [frame for frame in self.frames() if frame not in has_parent]
        lines: list[str] = []
        drawn: set[str] = set()
        # Frames left over after the roots hang in a ring; it is opened at its first name.
        for frame in (*roots, *self.frames()):
            if frame in children and frame not in drawn:
                lines.append(frame)
                _draw_below(frame, 1, children, drawn, lines)
        return tuple(lines)


@dataclass
class _Tally:
    """What was seen of one edge so far."""

    first_ns: int
    last_ns: int
    ahead_ns: int
    count: int = 0
    topics: set[str] = field(default_factory=set)
    static_count: int = 0


class FrameSurveyor:
    """Collects transforms as they come and tells what they amount to."""

    def __init__(self) -> None:
        self._tallies: dict[tuple[str, str], _Tally] = {}
        self._slashed: set[str] = set()

    def see(
        self,
        transforms: Iterable[StampedTransform],
        topic: str,
        log_time_ns: int,
        *,
        is_static: bool,
    ) -> None:
        """Take in the transforms of one message."""
        for parent, child, stamp_ns, _, _ in transforms:
            self._slashed.update(name for name in (parent, child) if name.startswith("/"))
            edge = parent.lstrip("/"), child.lstrip("/")
            ahead_ns = stamp_ns - log_time_ns
            tally = self._tallies.get(edge)
            if tally is None:
                tally = self._tallies[edge] = _Tally(stamp_ns, stamp_ns, ahead_ns)
            tally.first_ns = min(tally.first_ns, stamp_ns)
            tally.last_ns = max(tally.last_ns, stamp_ns)
            tally.ahead_ns = max(tally.ahead_ns, ahead_ns)
            tally.count += 1
            tally.static_count += is_static
            tally.topics.add(topic)

    def survey(self) -> FrameSurvey:
        """Return the edges seen so far."""
        edges = tuple(
            SurveyedEdge(
                parent,
                child,
                tally.static_count == tally.count,
                tuple(sorted(tally.topics)),
                tally.count,
                tally.first_ns,
                tally.last_ns,
                tally.ahead_ns,
            )
            for (parent, child), tally in sorted(self._tallies.items())
        )
        return FrameSurvey(edges, tuple(_oddities(edges, self._slashed)))


def _oddities(edges: tuple[SurveyedEdge, ...], slashed: set[str]) -> Iterable[str]:
    """Yield a sentence for each thing that a user would not expect."""
    pairs = {(edge.parent, edge.child) for edge in edges}
    for parent, child in sorted(pairs):
        if parent < child and (child, parent) in pairs:
            yield f"{parent} -> {child} is there in both directions"
    parents: dict[str, list[str]] = defaultdict(list)
    for edge in edges:
        parents[edge.child].append(edge.parent)
    for child, names in sorted(parents.items()):
        if len(names) > 1:
            yield f"{child} has several parents: {', '.join(names)}; the last one received holds"
    for edge in edges:
        name = f"{edge.parent} -> {edge.child}"
        if len(edge.topics) > 1:
            yield f"{name} comes from several topics: {', '.join(edge.topics)}"
    if ahead := [e for e in edges if not e.is_static and e.ahead_ns > _AHEAD_NS]:
        told = listed([f"{edge.parent} -> {edge.child}" for edge in ahead])
        one_is = "is" if len(ahead) == 1 else "are"
        most_s = max(edge.ahead_ns for edge in ahead) / NS_PER_S
        yield f"{told} {one_is} stamped up to {most_s:.2f} s after being recorded"
    if slashed:
        shown = ", ".join(sorted(slashed)[:5]) + (", ..." if len(slashed) > 5 else "")
        yield f"{len(slashed)} frame names begin with a slash, which is dropped: {shown}"


def _draw_below(
    frame: str,
    depth: int,
    children: dict[str, list[SurveyedEdge]],
    drawn: set[str],
    lines: list[str],
) -> None:
    drawn.add(frame)
    for edge in children[frame]:
        again = ", see above" if edge.child in drawn else ""
        lines.append(
            f"{'  ' * depth}{edge.child} ({edge.rate_text()}, {', '.join(edge.topics)}{again})"
        )
        if edge.child not in drawn:
            _draw_below(edge.child, depth + 1, children, drawn, lines)
