"""What one source says of one edge, checked."""

from dataclasses import dataclass

from are_ros.errors import InvalidTransformError
from are_ros.world._edge_table import TransformSource
from are_ros.world._interpolation import Pose, inverted
from are_ros.world.rigid_transform import Values, normalised, why_invalid


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
