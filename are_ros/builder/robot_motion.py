"""How the robot moves, from where it was seen: what others expect of it."""

import math
from collections import deque

from are_ros.artefacts.motion.robot import RobotMotion
from are_ros.builder.robots import RobotPose
from are_ros.conventions import NS_PER_S

_SPAN_NS = NS_PER_S // 4
_JUMP_M = 1.0


class RobotWatch:
    """Estimates the robot's velocity over the last quarter of a second of its poses."""

    def __init__(self) -> None:
        self._seen: deque[RobotPose] = deque()

    def forget(self) -> None:
        """Forget where the robot was."""
        self._seen.clear()

    def see(self, robot: RobotPose, now_ns: int) -> RobotMotion:
        """Take the pose that holds at `now_ns`, and return it with the velocity.

        A robot whose poses end stands; one that jumps (a correction of its place) does not move.
        """
        seen = self._seen
        if not seen or seen[-1] is not robot:
            if seen and seen[-1].stamp_ns >= robot.stamp_ns:
                seen.clear()
            seen.append(robot)
        while len(seen) > 1 and seen[1].stamp_ns <= robot.stamp_ns - _SPAN_NS:
            seen.popleft()
        return _motion(seen[0], robot, now_ns)


def _motion(first: RobotPose, last: RobotPose, now_ns: int) -> RobotMotion:
    x_m, y_m, _ = last.map_from_base.translation_m.tolist()
    yaw_rad = last.map_from_base.yaw_rad()
    then_x_m, then_y_m, _ = first.map_from_base.translation_m.tolist()
    span_s = (last.stamp_ns - first.stamp_ns) / NS_PER_S
    dx_m, dy_m = x_m - then_x_m, y_m - then_y_m
    is_standing = span_s <= 0.0 or now_ns - last.stamp_ns > 2 * _SPAN_NS
    if is_standing or math.hypot(dx_m, dy_m) > _JUMP_M:
        return RobotMotion(last.footprint, x_m, y_m, yaw_rad, 0.0, 0.0, 0.0)
    turn_rad = math.remainder(yaw_rad - first.map_from_base.yaw_rad(), math.tau)
    return RobotMotion(
        last.footprint, x_m, y_m, yaw_rad, dx_m / span_s, dy_m / span_s, turn_rad / span_s
    )
