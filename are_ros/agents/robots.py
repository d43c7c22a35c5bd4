"""The robot's pose in the map frame, from the frame tree, and its velocity."""

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from are_ros.agents.local_planner.robot import RobotMotion
from are_ros.conventions import NS_PER_S
from are_ros.errors import FrameError
from are_ros.world.cameras import Camera, Observer
from are_ros.world.footprint import Footprint
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.transforms.tree import FrameTree

_CLOCKS_FROM_ZERO_NS: Final = 366 * 86_400 * NS_PER_S
"""Simulated clocks begin at 0, too; none runs for a year."""
WITHOUT_STAMP: Final = "so nobody knows when it was"
TOO_OLD: Final = "s old"
"""The ends of the reasons why a transform gives no pose."""


def without_stamp(stamp_ns: int) -> str:
    """Return what is wrong with what has this stamp [ns], which is 0 or less."""
    return f"is stamped {'before 1970' if stamp_ns else 0}, {WITHOUT_STAMP}"


_USUAL_BASES = ("base_footprint", "base_link")


@dataclass(frozen=True, eq=False)
class RobotPose:
    """The robot at `stamp_ns`: base in the map's frame, and its footprint laid there."""

    stamp_ns: int
    map_from_base: RigidTransform
    footprint: Footprint


class RobotTracker:
    """Looks up one robot in the frame tree, and keeps its last known pose.

    `missing` and `camera_missing` give the reason if the last lookup found no pose; else they are
    empty.
    """

    def __init__(
        self, observer: Observer, frames: FrameTree, map_frame: str, max_age_ns: int
    ) -> None:
        self.observer = observer
        self.last: RobotPose | None = None
        self.missing = "no transform was received"
        self.camera_missing = ""
        self._base_frame = ""
        self._frames = frames
        self._map_frame = map_frame
        self._max_age_ns = max_age_ns

    def base_frame(self) -> str:
        """Return the base frame: the one configured, else a usual one that exists.

        Once a usual one is connected to the map, it stays the base.
        """
        if self.observer.base_frame or self._base_frame:
            return self.observer.base_frame or self._base_frame
        known = [name for name in _USUAL_BASES if self._frames.has_frame(name)]
        connected = (name for name in known if self._is_connected(name))
        self._base_frame = next(connected, "")
        return self._base_frame or next(iter(known), _USUAL_BASES[0])

    def odometry_frame(self, name: str) -> str:
        """Return the odometry frame: the one of this name, else that in which the base moves.

        Empty if that is the map's frame, or is not known.
        """
        if self._frames.has_frame(name):
            return name
        found = self._frames.moves_in(self.base_frame())
        return "" if found == self._map_frame else found

    def _is_connected(self, frame: str) -> bool:
        try:
            self._frames.latest_common_time(self._map_frame, frame)
        except FrameError:
            return False
        return True

    def pose(self, now_ns: int) -> RobotPose | None:
        """Return the latest pose not after `now_ns`, None if it is too old or not known."""
        base = self.base_frame()
        found, self.missing = self._transform_of(base, now_ns)
        if found is None:
            self.missing += self._other_bases(base)
            return None
        stamp_ns, map_from_base = found
        last = self.last
        if (
            last is None
            or last.stamp_ns != stamp_ns
            or not _equal(last.map_from_base, map_from_base)
        ):
            x, y, _ = map_from_base.translation_m.tolist()
            footprint = self.observer.footprint.at(x, y, map_from_base.yaw_rad())
            self.last = RobotPose(stamp_ns, map_from_base, footprint)
        return self.last

    def _other_bases(self, base: str) -> str:
        """Return what helps where no frame has a usual name, but some within a namespace."""
        if self.observer.base_frame or self._frames.has_frame(base):
            return ""
        names = {name for edge in self._frames.edges() for name in (edge.parent, edge.child)}
        others = [name for name in sorted(names) if name.rpartition("/")[2] in _USUAL_BASES]
        return f"; set frames.base, to {' or '.join(others)}" if others else ""

    def _transform_of(
        self, frame: str, now_ns: int
    ) -> tuple[tuple[int, RigidTransform] | None, str]:
        """Return (stamp, map_from_frame), the latest not after `now_ns`, or None and the reason."""
        try:
            stamp_ns = self._frames.latest_before(self._map_frame, frame, now_ns)
            if now_ns - stamp_ns > self._max_age_ns:
                return None, self._too_old(frame, stamp_ns, now_ns)
            return (stamp_ns, self._frames.lookup(self._map_frame, frame, stamp_ns)), ""
        except FrameError as cause:
            return None, str(cause)

    def _too_old(self, frame: str, stamp_ns: int, now_ns: int) -> str:
        """Return the reason, which names the transform that is awaited."""
        target, age_ns = self._map_frame, now_ns - stamp_ns
        what = f"the latest transform from '{frame}' to '{target}'"
        if stamp_ns <= 0 and age_ns > _CLOCKS_FROM_ZERO_NS:
            return f"{what} {without_stamp(stamp_ns)}"
        edge = self._frames.ending_at(target, frame, stamp_ns)
        want = "" if edge in {"", f"{target} -> {frame}"} else f"for want of a newer {edge}, "
        return f"{want}{what} is {age_ns * 1e-9:.3f} {TOO_OLD}"

    def map_from_camera(self, camera: Camera, now_ns: int) -> RigidTransform | None:
        """Return the pose of a camera's optical frame as of `now_ns`, None if it is not known."""
        frame = camera.frame_id or self.base_frame()
        found, self.camera_missing = self._transform_of(frame, now_ns)
        if found is None:
            return None
        return found[1] if camera.frame_id else found[1] @ camera.base_from_optical

    def forget(self) -> None:
        """Forget the last pose: the clock jumped, or a recording has a gap."""
        self.last = None


def _equal(one: RigidTransform, other: RigidTransform) -> bool:
    same_place = one.translation_m.tolist() == other.translation_m.tolist()
    return bool(same_place and one.rotation_xyzw.tolist() == other.rotation_xyzw.tolist())


_SPAN_NS = NS_PER_S // 4
_JUMP_M = 1.0
_JUMP_MPS = 10.0
"""A way from one pose to the next that is farther and faster is a correction of localization."""


class RobotWatch:
    """Estimates the robot's velocity from its poses of the last quarter of a second."""

    def __init__(self) -> None:
        self._seen: deque[RobotPose] = deque()

    def forget(self) -> None:
        """Forget the robot's poses."""
        self._seen.clear()

    def see(self, robot: RobotPose, now_ns: int) -> RobotMotion:
        """Take the pose valid at `now_ns`, and return it with the velocity.

        The velocity is 0 if poses stop coming. It begins anew after a jump (a correction of
        localization).
        """
        seen = self._seen
        if not seen or seen[-1] is not robot:
            if seen and _has_jumped(seen[-1], robot):
                seen.clear()
            seen.append(robot)
        while len(seen) > 1 and seen[1].stamp_ns <= robot.stamp_ns - _SPAN_NS:
            seen.popleft()
        return _motion(seen[0], robot, now_ns)


def _has_jumped(last: RobotPose, new: RobotPose) -> bool:
    span_s = (new.stamp_ns - last.stamp_ns) / NS_PER_S
    path_m = new.map_from_base.translation_m - last.map_from_base.translation_m
    away_m = math.hypot(path_m[0], path_m[1])
    return span_s <= 0.0 or (away_m > _JUMP_M and away_m > _JUMP_MPS * span_s)


def _motion(first: RobotPose, last: RobotPose, now_ns: int) -> RobotMotion:
    x_m, y_m, _ = last.map_from_base.translation_m.tolist()
    yaw_rad = last.map_from_base.yaw_rad()
    then_x_m, then_y_m, _ = first.map_from_base.translation_m.tolist()
    span_s = (last.stamp_ns - first.stamp_ns) / NS_PER_S
    dx_m, dy_m = x_m - then_x_m, y_m - then_y_m
    is_standing = span_s <= 0.0 or now_ns - last.stamp_ns > 2 * _SPAN_NS
    if is_standing:
        return RobotMotion(last.footprint, x_m, y_m, yaw_rad, 0.0, 0.0, 0.0)
    turn_rad = math.remainder(yaw_rad - first.map_from_base.yaw_rad(), math.tau)
    return RobotMotion(
        last.footprint, x_m, y_m, yaw_rad, dx_m / span_s, dy_m / span_s, turn_rad / span_s
    )
