"""The frames of a recording as a tree, with oddities in sentences."""

import math
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.bag.clock import chain_above
from are_ros.conventions import NS_PER_S
from are_ros.errors import FrameError
from are_ros.messages.transforms import StampedTransform
from are_ros.wording import counted, listed
from are_ros.world.rigid_transform import RigidTransform, why_invalid
from are_ros.world.transforms.sources import said_of_part
from are_ros.world.transforms.table import TransformSource
from are_ros.world.transforms.tree import FrameTree

_SOURCE_NAMES: Final = {
    TransformSource.ODOMETRY: "odometry",
    TransformSource.TF: "tf",
    TransformSource.PREFERRED_ODOMETRY: "preferred odometry",
    TransformSource.PARAMETER: "what is given",
}
_AHEAD_NS = NS_PER_S // 10
"""Stamps later than the recording by more than this are reported."""
_UPWARDS: Final = 0.8
"""The z component of a look to the ceiling; bodies of cameras are tilted by some degrees."""
_NOISE_M: Final = 0.02
_NOISE_RAD: Final = 0.02
"""A joint whose transforms differ by less is rigid."""
_LINK_FROM_OPTICAL: Final = RigidTransform.from_xyz_ypr(
    0.0, 0.0, 0.0, -0.5 * math.pi, 0.0, -0.5 * math.pi
)
"""The usual joint from a camera's body (x ahead, z up) to its optical frame."""


@dataclass
class SurveyedEdge:
    """One edge parent -> child as it was recorded; the names have no leading slash.

    `still_ns` of the time between the first and the last stamp are gaps of the recording.
    `ahead_ns` is how much later than the recording the worst stamp was (negative: earlier).
    `source` is the strongest of those that gave the edge. `first_pose` is the translation and
    rotation of the first transform; `is_rigid` tells whether the others are alike.
    """

    parent: str
    child: str
    first_ns: int
    last_ns: int
    ahead_ns: int
    count: int = 0
    static_count: int = 0
    unstamped: int = 0
    topics: tuple[str, ...] = ()
    source: TransformSource = TransformSource.ODOMETRY
    still_ns: int = 0
    first_pose: tuple[float, ...] = ()
    is_rigid: bool = True

    def __str__(self) -> str:
        return f"{self.parent} -> {self.child}"

    @property
    def is_static(self) -> bool:
        """Whether each of its transforms was static."""
        return self.static_count == self.count

    @property
    def rate_hz(self) -> float:
        """Mean rate of the stamps outside of gaps, 0 for a static edge or a single stamp."""
        duration_ns = self.last_ns - self.first_ns - self.still_ns
        if self.is_static or duration_ns <= 0:
            return 0.0
        return (self.count - self.unstamped - 1) * NS_PER_S / duration_ns

    def rate_text(self) -> str:
        """Return the rate in words; where all stamps are one, there is none."""
        if self.is_static:
            return "static"
        if self.first_ns == self.last_ns:
            return "once" if self.count == 1 else "one stamp"
        return hertz(self.rate_hz)


@dataclass(frozen=True)
class FrameSurvey:
    """All edges in order of name, and a sentence for each oddity.

    `refused` has a sentence for each edge of which no transform can be used.
    """

    edges: tuple[SurveyedEdge, ...]
    oddities: tuple[str, ...]
    refused: tuple[str, ...]

    def frames(self) -> tuple[str, ...]:
        """Return the names of all frames, sorted."""
        return tuple(sorted({name for edge in self.edges for name in (edge.parent, edge.child)}))

    def connected_to(self, frame: str) -> frozenset[str]:
        """Return the frames that a chain of edges in force joins to `frame`, itself among them."""
        return connected_to(frame, ((parent, child) for parent, child, _ in self._in_force()))

    def root_of(self, frame: str) -> str:
        """Return the frame at the top of the tree that holds `frame`."""
        return root_above(frame, self._parents())

    def standing_frame(self, frame: str) -> str:
        """Return the frame of the tree of `frame` to which a map is to be joined.

        That is the top, unless the top moves: below it hangs the frame in which odometry moves it.
        """
        told = [(e.parent, e.child) for e in self.edges if e.source.is_odometry]
        return standing_frame(frame, self._parents(), told)

    def is_moved(self, frame: str) -> bool:
        """Return whether tf moves a frame below the top of its tree, be it ever so slowly."""
        moved = {edge.child for edge in _strongest(self.edges) if not edge.is_rigid}
        return any(above in moved for above in chain_above(frame, self._parents()))

    def stands_on(self, frame: str, base: str) -> bool:
        """Return whether static transforms alone join a base to a frame."""
        parents = self._parents()
        static = {edge.child for edge in _strongest(self.edges) if edge.is_static}
        way = set(chain_above(base, parents)) ^ set(chain_above(frame, parents))
        above = {child for child in way if child in parents}
        return frame in self.connected_to(base) and above <= static

    def moving_beside(self, frame: str) -> str:
        """Return the frame that moves in another tree, where nothing above `frame` does; or ""."""
        return moving_beside(frame, self._in_force())

    def _parents(self) -> dict[str, str]:
        """Return the parents of the edges in force, by child."""
        return {child: parent for parent, child, _ in self._in_force()}

    def _in_force(self) -> list[tuple[str, str, bool]]:
        """Return (parent, child, whether it moves) of the edges that a `FrameTree` keeps.

        Those are of a frame's strongest source; but odometry of a part that static transforms fix
        to the robot moves the robot.
        """
        kept, wholes = _strongest(self.edges), _moved_wholes(self.edges)
        edges = [(edge.parent, edge.child, edge.rate_hz > 0.0) for edge in kept]
        return edges + [
            (edge.parent, wholes[edge.parent, edge.child], edge.rate_hz > 0.0)
            for edge in self.edges
            if (edge.parent, edge.child) in wholes
        ]

    def tree_lines(self) -> tuple[str, ...]:
        """Return the tree as indented lines, roots first; each edge stands once."""
        children: dict[str, list[SurveyedEdge]] = defaultdict(list)
        for edge in self.edges:
            children[edge.parent].append(edge)
        has_parent = {edge.child for edge in self.edges}
        roots = [frame for frame in self.frames() if frame not in has_parent]
        lines: list[str] = []
        drawn: set[str] = set()
        # Frames left over after the roots form a ring; it is drawn from its first name.
        for frame in (*roots, *self.frames()):
            if frame in children and frame not in drawn:
                lines.append(frame)
                _draw_below(frame, 1, children, drawn, lines)
        return tuple(lines)


def _strongest(edges: Sequence[SurveyedEdge]) -> list[SurveyedEdge]:
    """Return the edges from the strongest source of their child.

    What is given also holds against tf that has the two frames the other way round, and tf against
    odometry.
    """
    of_given = TransformSource.PARAMETER
    turned = {(edge.child, edge.parent) for edge in edges if edge.source == of_given}
    edges = [edge for edge in edges if (edge.parent, edge.child) not in turned]
    sources: dict[str, TransformSource] = {}
    for edge in edges:
        sources[edge.child] = max(edge.source, sources.get(edge.child, edge.source))
    edges = [edge for edge in edges if edge.source == sources[edge.child]]
    of_odometry = TransformSource.ODOMETRY
    others = {(edge.child, edge.parent) for edge in edges if edge.source != of_odometry}
    return [e for e in edges if e.source != of_odometry or (e.parent, e.child) not in others]


def _moved_wholes(edges: Sequence[SurveyedEdge]) -> dict[tuple[str, str], str]:
    """Return what odometry moves of which the child is a fixed part, by (parent, child)."""
    kept = _strongest(edges)
    parents = {edge.child: edge.parent for edge in kept}
    joints = {edge.child: edge.parent for edge in kept if edge.is_static}
    wholes = {
        (edge.parent, edge.child): root_above(edge.child, joints)
        for edge in edges
        if edge.source.is_odometry and edge.child in joints
    }
    return {
        names: whole
        for names, whole in wholes.items()
        if whole not in parents and root_above(names[0], parents) != whole
    }


class FrameSurveyor:
    """Collects transforms, and returns their survey."""

    def __init__(self) -> None:
        self._edges: dict[tuple[str, str], SurveyedEdge] = {}
        self._slashed: set[str] = set()
        self._refused: Counter[tuple[str, str, str]] = Counter()
        """How many transforms were refused, by parent, child and topic."""
        self._reasons: dict[tuple[str, str, str], str] = {}
        """Why the first of them was."""

    def see(
        self,
        transforms: Iterable[StampedTransform],
        topic: str,
        log_time_ns: int,
        *,
        is_static: bool,
        source: TransformSource = TransformSource.TF,
    ) -> None:
        """Take in the transforms of one message."""
        for parent, child, stamp_ns, translation_m, rotation_xyzw in transforms:
            self._slashed.update(name for name in (parent, child) if name.startswith("/"))
            names = parent.lstrip("/"), child.lstrip("/")
            if reason := why_invalid(*translation_m, *rotation_xyzw):
                self._refused[names[0], names[1], topic] += 1
                self._reasons.setdefault((names[0], names[1], topic), reason)
                continue
            ahead_ns = stamp_ns - log_time_ns
            edge = self._edges.get(names)
            if edge is None:
                edge = self._edges[names] = SurveyedEdge(*names, stamp_ns, stamp_ns, ahead_ns)
            edge.first_ns = min(edge.first_ns or stamp_ns, stamp_ns or edge.first_ns)
            edge.last_ns = max(edge.last_ns, stamp_ns)
            edge.ahead_ns = max(edge.ahead_ns, ahead_ns)
            edge.count += 1
            edge.static_count += is_static
            edge.unstamped += stamp_ns == 0
            edge.source = max(edge.source, source)
            pose = (*translation_m, *rotation_xyzw)
            edge.first_pose = edge.first_pose or pose
            edge.is_rigid = edge.is_rigid and _are_alike(edge.first_pose, pose)
            if topic not in edge.topics:
                edge.topics = tuple(sorted((*edge.topics, topic)))

    def survey(
        self, gaps: Sequence[tuple[int, int]] = (), apart: Collection[str] = ()
    ) -> FrameSurvey:
        """Return the edges seen so far.

        `gaps` are the [start, stop) of the recording's gaps, by the clock of the stamps. `apart`
        names edges ("odom -> base") and topics that go by another clock: that is said elsewhere.
        """
        edges = tuple(self._edges[names] for names in sorted(self._edges))
        for edge in edges:
            edge.still_ns = sum(
                max(0, min(stop_ns, edge.last_ns) - max(start_ns, edge.first_ns))
                for start_ns, stop_ns in gaps
            )
        reasons = sorted(self._reasons.items())
        in_part = [_said_of(k, self._refused[k], r) for k, r in reasons if k[:2] in self._edges]
        oddities = [*_oddities(edges, self._slashed, apart), *in_part]
        refused = [_said_of(k, self._refused[k], r) for k, r in reasons if k[:2] not in self._edges]
        return FrameSurvey(edges, tuple(oddities), tuple(refused))


def hertz(rate_hz: float) -> str:
    """Return a rate in words, a rare one with one digit that counts."""
    return f"{rate_hz:.1f} Hz" if rate_hz >= 0.05 else f"{rate_hz:.1g} Hz"


def connected_to(frame: str, edges: Iterable[tuple[str, str]]) -> frozenset[str]:
    """Return the frames that a chain of edges (parent, child) joins to `frame`, and itself."""
    neighbours: dict[str, set[str]] = defaultdict(set)
    for parent, child in edges:
        neighbours[parent].add(child)
        neighbours[child].add(parent)
    reached, waiting = {frame}, [frame]
    while waiting:
        new = neighbours[waiting.pop()] - reached
        reached |= new
        waiting.extend(new)
    return frozenset(reached)


def root_above(frame: str, parents: Mapping[str, str]) -> str:
    """Return the last of the parents above a frame, `parents` by child; in a ring any of it."""
    return chain_above(frame, parents)[-1]


def standing_frame(frame: str, parents: Mapping[str, str], told: Iterable[tuple[str, str]]) -> str:
    """Return the top of the tree of `frame`, or what stands below a top that moves.

    `told` are the frames (parent, child) of odometry: in tf the parent may hang below the child.
    """
    root = root_above(frame, parents)
    below = (standing for standing, moving in told if moving in chain_above(standing, parents))
    return next((standing for standing in below if root_above(standing, parents) == root), root)


def _are_alike(one: Sequence[float], other: Sequence[float]) -> bool:
    """Return whether two poses (x y z, then x y z w) differ by less than a joint's noise."""
    if one == other:
        return True
    away_m = math.dist(one[:3], other[:3])
    cosine = abs(sum(a * b for a, b in zip(one[3:], other[3:], strict=True)))
    lengths = math.hypot(*one[3:]) * math.hypot(*other[3:])
    return away_m < _NOISE_M and 2.0 * math.acos(min(1.0, cosine / lengths)) < _NOISE_RAD


def moving_beside(frame: str, edges: Iterable[tuple[str, str, bool]]) -> str:
    """Return the frame that moves in another tree, where nothing above `frame` does.

    Edges are (parent, child, whether it moves). Empty if there is none, or more than one.
    """
    edges = list(edges)
    joined = connected_to(frame, ((parent, child) for parent, child, _ in edges))
    parents = {child: parent for parent, child, _ in edges}
    moving = {child for _, child, moves in edges if moves}
    ends = moving - joined - {parents[child] for child in moving}
    is_moved = not moving.isdisjoint(chain_above(frame, parents))
    return ends.pop() if len(ends) == 1 and not is_moved else ""


def static_tf_option(parent: str, child: str, pose: npt.NDArray[np.float64] | None = None) -> str:
    """Return the option that joins two frames by parent_from_child (4, 4), or words without it."""
    numbers = "X Y Z YAW PITCH ROLL"
    if pose is not None and np.isfinite(pose).all():
        x_m, y_m, z_m = pose[:3, 3]
        yaw, roll = np.arctan2(pose[1, 0], pose[0, 0]), np.arctan2(pose[2, 1], pose[2, 2])
        pitch = np.arctan2(-pose[2, 0], np.hypot(pose[0, 0], pose[1, 0]))
        # zeros are added so that there is no -0
        numbers = " ".join(f"{v.round(4) + 0.0:g}" for v in (x_m, y_m, z_m, yaw, pitch, roll))
    return f'--static-tf "{numbers} {parent} {child}"'


def turned_joint(survey: FrameSurvey, base_frame: str, frames: FrameTree) -> str:
    """Return what to do where tf moves a part of the robot of which odometry tells the pose.

    Empty if there is no such part, or tf moves the robot itself, as with another odometry; the
    joint is that at the end of `frames`.
    """
    if survey.is_moved(base_frame):
        return ""
    on_robot = survey.connected_to(base_frame)
    for edge in survey.edges:
        if edge.source.is_odometry and edge.child in on_robot:
            whole = survey.root_of(edge.child)
            if edge.parent not in on_robot and whole != edge.child:
                option = static_tf_option(edge.child, whole, _pose_in(frames, edge.child, whole))
                return (
                    f"odometry tells the pose of {edge.child}, which tf hangs below {whole}, so it"
                    f" moves nothing: if that joint is rigid, turn it round with {option}"
                )
    return ""


def upward_cameras(frames: FrameTree, base_frame: str, camera_frames: Iterable[str]) -> list[str]:
    """Return a sentence for each frame of a camera that looks up to the ceiling.

    Few do: mostly the frame is that of the body, whose x axis is the look (REP 103).
    """
    parents = {edge.child: edge.parent for edge in frames.edges()}
    doubts = []
    for frame in sorted(set(camera_frames) & parents.keys()):
        if _pose_in(frames, base_frame, frame)[2, 2] > _UPWARDS:
            pose = _pose_in(frames, parents[frame], frame) @ _LINK_FROM_OPTICAL.matrix()
            option = static_tf_option(parents[frame], frame, pose)
            doubts.append(
                f"the camera in {frame} looks up to the ceiling, as the z axis of its frame does;"
                f" if the x axis is the look, give {option}"
            )
    return doubts


def _pose_in(frames: FrameTree, parent: str, child: str) -> npt.NDArray[np.float64]:
    """Return the newest pose of a frame in another as a matrix (4, 4), NaN where not known."""
    try:
        return frames.lookup_latest(parent, child).matrix()
    except FrameError:
        return np.full((4, 4), np.nan)


def _said_of(key: tuple[str, str, str], count: int, reason: str) -> str:
    parent, child, topic = key
    return f"{counted(count, 'transform')} {parent} -> {child} of {topic} refused: {reason}"


def _oddities(
    edges: tuple[SurveyedEdge, ...], slashed: set[str], apart: Collection[str]
) -> Iterable[str]:
    """Yield a sentence for each oddity."""
    pairs = {(edge.parent, edge.child): edge.source for edge in edges}
    for parent, child in sorted(pairs):
        if parent < child and (child, parent) in pairs:
            weaker, stronger = sorted((pairs[parent, child], pairs[child, parent]))
            holds = f"; {_SOURCE_NAMES[stronger]} holds, not {_SOURCE_NAMES[weaker]}"
            said = f"{parent} -> {child} is there in both directions"
            yield said + holds * (weaker != stronger)
    yield from _odd_parents(edges)
    for edge in edges:
        if len(edge.topics) > 1:
            yield f"{edge} comes from several topics: {', '.join(edge.topics)}"
    ahead = [e for e in edges if not e.is_static and e.ahead_ns > _AHEAD_NS]
    ahead = [e for e in ahead if not {str(e), *e.topics} & set(apart)]
    if ahead:
        told = listed([str(edge) for edge in ahead])
        one_is = "is" if len(ahead) == 1 else "are"
        most_s = max(edge.ahead_ns for edge in ahead) / NS_PER_S
        yield f"{told} {one_is} stamped up to {most_s:.2f} s after being recorded"
    if slashed:
        shown = ", ".join(sorted(slashed)[:5]) + (", ..." if len(slashed) > 5 else "")
        names = f"{counted(len(slashed), 'frame name')} begin{'s' if len(slashed) == 1 else ''}"
        yield f"{names} with a slash, which is dropped: {shown}"


def _odd_parents(edges: Sequence[SurveyedEdge]) -> Iterable[str]:
    """Yield a sentence for what odometry moves by a part of it, and for each second parent."""
    sources: dict[str, dict[str, TransformSource]] = defaultdict(dict)
    wholes = _moved_wholes(edges)
    for edge in edges:
        whole = wholes.get((edge.parent, edge.child))
        if whole is None:
            sources[edge.child][edge.parent] = edge.source
        else:
            yield said_of_part(edge.source, edge.child, whole)
    for child, of_child in sorted(sources.items()):
        if len(of_child) > 1:
            yield _said_of_parents(child, of_child)


def _said_of_parents(child: str, sources: Mapping[str, TransformSource]) -> str:
    """Say which parents a frame has, and which of them is used."""
    said = f"{child} has several parents: {', '.join(sources)}"
    strongest = max(sources.values())
    best = [parent for parent, source in sources.items() if source == strongest]
    if len(best) < len(sources):
        others = {_SOURCE_NAMES[source] for source in sources.values() if source != strongest}
        said += f"; {_SOURCE_NAMES[strongest]} holds, not {' nor '.join(sorted(others))}"
    if len(best) > 1:
        said += (
            f"; of {' and '.join(best)} the newer transform holds, from its stamp on,"
            f" so that all below {child} jumps or gets lost: let one of their publishers be silent"
        )
    return said


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
