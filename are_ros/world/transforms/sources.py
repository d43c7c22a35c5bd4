"""What one source says of one edge, checked, and which of several sources holds."""

from dataclasses import dataclass, replace

from are_ros.errors import InvalidTransformError
from are_ros.world.rigid_transform import Pose, Values, inverted, normalised, why_invalid
from are_ros.world.transforms.edges import Edge, TransformSource


@dataclass(frozen=True, slots=True)
class Claim:
    """The pose parent_from_child at a stamp [ns] (0 if static)."""

    parent: str
    child: str
    stamp_ns: int
    pose: Pose
    source: TransformSource
    is_static: bool


def checked_pose(parent: str, child: str, translation_m: Values, rotation_xyzw: Values) -> Pose:
    """Return the seven numbers, the quaternion normalised, or raise InvalidTransformError."""
    x, y, z = map(float, translation_m)
    i, j, k, w = map(float, rotation_xyzw)
    above, below = parent.lstrip("/"), child.lstrip("/")
    reason = why_invalid(x, y, z, i, j, k, w)
    if reason is None and not (above and below):
        reason = "a frame's name is empty"
    if reason is None and above == below:
        reason = "parent and child are the same frame"
    if reason is not None:
        raise InvalidTransformError(f"the transform {parent} -> {child} is refused: {reason}")
    return x, y, z, *normalised(i, j, k, w)


_NAMES = {
    TransformSource.ODOMETRY: "odometry",
    TransformSource.TF: "tf",
    TransformSource.PREFERRED_ODOMETRY: "preferred odometry",
    TransformSource.PARAMETER: "the parameters",
}


class Notices:
    """Sentences for the log, each said once."""

    def __init__(self) -> None:
        self._said: set[str] = set()
        self._pending: list[str] = []

    def say(self, sentence: str) -> None:
        """Add a sentence, unless it was said before."""
        if sentence not in self._said:
            self._said.add(sentence)
            self._pending.append(sentence)

    def drain(self) -> list[str]:
        """Return what is new since the last time, oldest first."""
        pending, self._pending = self._pending, []
        return pending


class Precedence:
    """The rules between sources, over the edges of one tree by their child frames."""

    def __init__(self, edges: dict[str, Edge], notices: Notices) -> None:
        self._edges = edges
        self._notices = notices

    def admit(self, claim: Claim) -> Claim | None:
        """Return the claim as it is to be stored, or None where it is ignored.

        Weaker edges that are in its way are dropped. Only a frame's newest sample is tried for
        loops: the tree as it stands now has none.
        """
        turned = self._along_the_pair(claim)
        if turned is None or self._is_overruled(turned):
            return None
        edge = self._edges.get(turned.child)
        if edge is not None and edge.source == turned.source:
            self._say_changed(edge, turned)
            if edge.parent == turned.parent:
                return turned
            if not (edge.is_static or turned.is_static) and turned.stamp_ns < edge.newest_ns:
                return turned
        return turned if self._opens_loop(turned) else None

    def _along_the_pair(self, claim: Claim) -> Claim | None:
        """Turn a claim round if the pair's edge points the other way; None if it is overruled."""
        reverse = self._edges.get(claim.parent)
        if reverse is None or reverse.parent != claim.child:
            return claim
        child_is_free = claim.child not in self._edges
        if claim.source > reverse.source and child_is_free:
            self._say_overruled(reverse.parent, reverse.child, reverse.source, claim.source)
            del self._edges[reverse.child]
            return claim
        if claim.source < reverse.source:
            self._say_overruled(claim.parent, claim.child, claim.source, reverse.source)
            if child_is_free and reverse.is_static and reverse.source == TransformSource.PARAMETER:
                # tf may give the child's own parent, if a parameter's edge points the way tf does.
                del self._edges[reverse.child]
                pose, source = inverted(reverse.poses[0]), reverse.source
                self._edges[claim.child] = Edge(
                    claim.child, source, True, [0], [claim.parent], [pose]
                )
            return None
        self._notices.say(
            f"the transform {claim.parent} -> {claim.child} from {_NAMES[claim.source]} is kept as "
            f"{claim.child} -> {claim.parent}, as this pair of frames was given before"
        )
        pose = inverted(claim.pose)
        return replace(claim, parent=claim.child, child=claim.parent, pose=pose)

    def _is_overruled(self, claim: Claim) -> bool:
        """Tell whether a stronger source gives the child's parent; say so, either way."""
        edge = self._edges.get(claim.child)
        if edge is None or edge.source == claim.source:
            return False
        if edge.source > claim.source:
            self._say_overruled(claim.parent, claim.child, claim.source, edge.source)
            return True
        self._say_overruled(edge.parent, edge.child, edge.source, claim.source)
        return False

    def _opens_loop(self, claim: Claim) -> bool:
        """Drop the weakest edge of a loop that the claim would close; False: all are as strong."""
        path: dict[str, Edge] = {}
        frame = claim.parent
        while frame != claim.child:
            edge = self._edges.get(frame)
            if edge is None or frame in path:
                return True
            path[frame] = edge
            frame = edge.parent
        weakest = min(path.values(), key=lambda edge: edge.source)
        parent, child = claim.parent, claim.child
        if weakest.source >= claim.source:
            self._notices.say(
                f"the transform {parent} -> {child} from {_NAMES[claim.source]} is ignored: it "
                f"would close a loop, {child} is above {parent} already"
            )
            return False
        self._say_overruled(weakest.parent, weakest.child, weakest.source, claim.source)
        del self._edges[weakest.child]
        return True

    def _say_overruled(
        self, parent: str, child: str, weaker: TransformSource, stronger: TransformSource
    ) -> None:
        self._notices.say(
            f"the transform {parent} -> {child} from {_NAMES[weaker]} "
            f"is overruled by {_NAMES[stronger]}"
        )

    def _say_changed(self, edge: Edge, claim: Claim) -> None:
        """Tell of a new parent, and of a stamped transform that turns static or back."""
        child, source = claim.child, _NAMES[claim.source]
        if edge.parent != claim.parent:
            self._notices.say(
                f"{source} gave {child} a new parent: {claim.parent} instead of "
                f"{edge.parent}, from its stamp on"
            )
        if edge.is_static != claim.is_static:
            kind = "static" if claim.is_static else "stamped"
            self._notices.say(f"{source} gave {child} a {kind} transform, which replaces the other")
