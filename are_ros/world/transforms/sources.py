"""What one source says of one edge, checked, and which of several sources holds."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from are_ros.errors import InvalidTransformError
from are_ros.world.rigid_transform import Values, normalised, why_invalid
from are_ros.world.transforms.lookup import Pose, composed, inverted
from are_ros.world.transforms.table import Edge, EdgeTable, FrameNames, TransformSource


@dataclass(frozen=True, slots=True)
class Claim:
    """The pose parent_from_child at a stamp [ns] (0 if static), frames by number."""

    parent: int
    child: int
    stamp_ns: int
    pose: Pose
    source: TransformSource
    is_static: bool

    def turned_round(self) -> "Claim":
        """Return the same claim with parent and child exchanged."""
        pose = inverted(self.pose)
        return Claim(self.child, self.parent, self.stamp_ns, pose, self.source, self.is_static)


def checked_pose(parent: str, child: str, translation_m: Values, rotation_xyzw: Values) -> Pose:
    """Return the seven numbers, the quaternion normalised, or raise InvalidTransformError."""
    x, y, z = translation_m
    i, j, k, w = rotation_xyzw
    reason = why_invalid(x, y, z, i, j, k, w)
    if parent == child or parent[:1] in _SUSPICIOUS or child[:1] in _SUSPICIOUS:
        reason = reason or _why_names_invalid(parent.lstrip("/"), child.lstrip("/"))
    if reason is not None:
        raise InvalidTransformError(f"the transform {parent} -> {child} is refused: {reason}")
    i, j, k, w = normalised(i, j, k, w)
    return x, y, z, i, j, k, w


_SUSPICIOUS = ("", "/")


def _why_names_invalid(parent: str, child: str) -> str | None:
    if not parent or not child:
        return "a frame's name is empty"
    return "parent and child are the same frame" if parent == child else None


_NAMES = {
    TransformSource.ODOMETRY: "odometry",
    TransformSource.TF: "tf",
    TransformSource.PREFERRED_ODOMETRY: "preferred odometry",
    TransformSource.PARAMETER: "the parameters",
}


def said_of_part(source: TransformSource, part: str, whole: str) -> str:
    """Return the sentence about odometry of a part of the robot, or of what moves with it."""
    fixed = f"which static transforms fix to {whole}: it moves {whole}"
    return f"{_NAMES[source]} tells the pose of {part}, {fixed}"


class Remark(str):
    """A notice that is no warning: robots often are so."""

    __slots__ = ()


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
    """Decides which of several claims on an edge holds, so that the frames always form trees.

    A frame has one parent at a time. Of two sources that give a frame's parent the higher one
    holds, whole; within one source the newest does, from its stamp on. A pair of frames is one edge
    in either direction: a claim that names it the other way round is turned to the direction that
    is there. A longer loop is opened at its weakest edge if that is weaker than the claim; else the
    claim is ignored.
    """

    def __init__(self, table: EdgeTable, names: FrameNames, notices: Notices) -> None:
        self._table = table
        self._names = names
        self._notices = notices

    def admit(self, claim: Claim) -> Claim | None:
        """Return the claim as it is to be stored, or None where it is ignored.

        Weaker edges that are in its way are dropped. Only a frame's newest sample is tried for
        loops: the tree as it stands now has none.
        """
        whole = self._of_the_whole(claim)
        turned = self._along_the_pair(whole)
        if turned is None or self._is_overruled(turned):
            return None
        if whole is not claim:
            self._say_moved(claim, whole)
        edge = self._table.edges.get(turned.child)
        if edge is not None and edge.source == turned.source:
            self._say_changed(edge, turned)
            if edge.parent == turned.parent:
                return turned
            if not (edge.is_static or turned.is_static) and turned.stamp_ns < edge.newest_ns:
                return turned
        return turned if self._opens_loop(turned) else None

    def _of_the_whole(self, claim: Claim) -> Claim:
        """Turn odometry of a part that joints fix to the robot into odometry of the whole robot.

        A tracking camera measures its own pose, and its mount is a static transform: a frame has
        one parent, so the top of the joints gets the moving edge. Where that is above the parent of
        odometry already, the joints say that nothing moves: the claim stays as it is.
        """
        top, pose, passed = claim.child, claim.pose, {claim.child}
        if claim.source.is_odometry and not claim.is_static:
            while (edge := self._table.edges.get(top)) is not None and edge.is_static:
                top = edge.parent
                if top in passed:
                    return claim
                passed.add(top)
                pose = composed(pose, inverted(self._table.pose_of(edge.first)))
        above = {claim.parent, *(edge.parent for edge in self._ancestry(claim.parent))}
        if top == claim.child or passed & above:
            return claim
        return replace(claim, child=top, pose=pose)

    def _along_the_pair(self, claim: Claim) -> Claim | None:
        """Turn a claim round if the pair's edge points the other way; None if it is overruled."""
        reverse = self._table.edges.get(claim.parent)
        if reverse is None or reverse.parent != claim.child:
            return claim
        child_is_free = claim.child not in self._table.edges
        if claim.source > reverse.source and child_is_free:
            self._say_overruled(reverse.parent, reverse.child, reverse.source, claim.source)
            self._table.drop(reverse.child)
            return claim
        if claim.source < reverse.source:
            self._say_overruled(claim.parent, claim.child, claim.source, reverse.source)
            if child_is_free and reverse.is_static and reverse.source == TransformSource.PARAMETER:
                self._flip(reverse)
            return None
        parent, child = self._names[claim.parent], self._names[claim.child]
        self._notices.say(
            f"the transform {parent} -> {child} from {_NAMES[claim.source]} is kept as "
            f"{child} -> {parent}, as this pair of frames was given before"
        )
        return claim.turned_round()

    def _flip(self, edge: Edge) -> None:
        """Point a parameter's edge the way tf does, so that tf may give the child's own parent."""
        pose = self._table.pose_of(edge.first)
        claim = Claim(edge.parent, edge.child, 0, pose, edge.source, is_static=True)
        turned = claim.turned_round()
        self._table.drop(edge.child)
        flipped = self._table.open(turned.child, turned.parent, edge.source, is_static=True)
        self._table.hold(flipped, turned.parent, turned.pose)

    def _is_overruled(self, claim: Claim) -> bool:
        """Tell whether a stronger source gives the child's parent; say so, either way.

        Odometry makes way for a joint without a word: from now on it may move what is above that.
        """
        edge = self._table.edges.get(claim.child)
        if edge is None or edge.source == claim.source:
            return False
        if claim.is_static and edge.source.is_odometry and edge.parent != claim.parent:
            return False
        if edge.source > claim.source:
            self._say_overruled(claim.parent, claim.child, claim.source, edge.source)
            return True
        self._say_overruled(edge.parent, edge.child, edge.source, claim.source)
        return False

    def _ancestry(self, frame: int) -> Iterator[Edge]:
        """Yield the edges from a frame up, by their newest parents, each once."""
        for _ in range(len(self._names)):
            edge = self._table.edges.get(frame)
            if edge is None:
                return
            yield edge
            frame = edge.parent

    def _opens_loop(self, claim: Claim) -> bool:
        """Drop the weakest edge of a loop that the claim would close; False: all are as strong."""
        path = []
        for edge in self._ancestry(claim.parent):
            path.append(edge)
            if edge.parent == claim.child:
                break
        else:
            return True
        weakest = min(path, key=lambda edge: edge.source)
        parent, child = self._names[claim.parent], self._names[claim.child]
        if weakest.source >= claim.source:
            self._notices.say(
                f"the transform {parent} -> {child} from {_NAMES[claim.source]} is ignored: it "
                f"would close a loop, {child} is above {parent} already"
            )
            return False
        self._say_overruled(weakest.parent, weakest.child, weakest.source, claim.source)
        self._table.drop(weakest.child)
        return True

    def _say_overruled(
        self, parent: int, child: int, weaker: TransformSource, stronger: TransformSource
    ) -> None:
        said = (
            f"the transform {self._names[parent]} -> {self._names[child]} from {_NAMES[weaker]} "
            f"is overruled by {_NAMES[stronger]}"
        )
        sends_both = (weaker, stronger) == (TransformSource.ODOMETRY, TransformSource.TF)
        self._notices.say(Remark(said) if sends_both else said)

    def _say_moved(self, of_part: Claim, whole: Claim) -> None:
        part, moved = self._names[of_part.child], self._names[whole.child]
        self._notices.say(Remark(said_of_part(whole.source, part, moved)))

    def _say_changed(self, edge: Edge, claim: Claim) -> None:
        """Tell of a new parent, and of a stamped transform that turns static or back."""
        child, source = self._names[claim.child], _NAMES[claim.source]
        if edge.parent != claim.parent:
            self._notices.say(
                f"{source} gave {child} a new parent: {self._names[claim.parent]} instead of "
                f"{self._names[edge.parent]}, from its stamp on"
            )
        if edge.is_static != claim.is_static:
            kind = "static" if claim.is_static else "stamped"
            self._notices.say(f"{source} gave {child} a {kind} transform, which replaces the other")
