"""No artefact overlaps the robot at any tick, but where a contact was reported."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.oracle import Outline
from are_ros.conventions import seconds_to_ns
from are_ros.parameters.model import Parameters
from are_ros.replay._check_frames import EVER
from are_ros.replay._check_lives import ROBOT_CONTACT, events_by_tick
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Tally, at_s, skipped
from are_ros.replay._check_scene import Scene

_SLACK_M: Final = 1e-3
"""Robot poses come from interpolation of our own; contacts shallower than this are not judged."""

_DELAYS_NS: Final = (0, 50_000_000, 100_000_000, 150_000_000, 200_000_000, 300_000_000)
"""Live, how long before a tick the pose may be from that the node knew."""

Pose = tuple[float, float, float]


def check_robot(record: Record) -> CheckResult:
    """No box overlaps the robot's outline, but from a reported contact on, while it lasts.

    Which pose of the robot a live node knew is open: there, only what overlaps all of them counts.
    """
    tally = Tally("overlaps with the robot", "box")
    if record.parameters is None:
        return skipped(tally.name, "there is no effective.yaml, which says the robot's shape")
    base = record.base_frame()
    if not record.frames.has(base):
        reason = f"no transform names the base '{base}'"
        return skipped(tally.name, reason, needs_inputs=record.lacks_inputs)
    robot = record.parameters.robot
    outline = Outline.of(robot.footprint, robot.radius)
    reported: set[int] = set()
    for scene, events, _ in events_by_tick(record):
        reported |= {int(event.id) for event in events if event.kind == ROBOT_CONTACT}
        poses = _robot_at(record, record.parameters, base, scene.stamp_ns)
        if not poses:
            tally.leave_out("tick", "without the robot's pose")
            continue
        least, most = _depths_m(outline, poses, scene)
        touched = {int(number) for number in scene.ids[most > -_SLACK_M]}
        if record.runs.is_fresh(scene.stamp_ns):
            reported |= touched  # it may have been reported before the recording began
        tally.look(len(scene.ids))
        for i in np.flatnonzero(least > _SLACK_M):
            if int(scene.ids[i]) not in reported:
                text = f"id {scene.ids[i]} overlaps the robot by {least[i]:.4f} m, unreported"
                tally.fail(f"{at_s(scene.stamp_ns)} {text}")
        reported &= touched
    return tally.result()


def _depths_m(
    outline: Outline, poses: list[Pose], scene: Scene
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how deep each box (N,) is in the robot, at least and at most."""
    depths = np.array([outline.depths_m(*pose, scene) for pose in poses])
    return depths.min(axis=0), depths.max(axis=0)


def _robot_at(record: Record, parameters: Parameters, base: str, stamp_ns: int) -> list[Pose]:
    """Return the pose that the last sub-step not after a tick knew: received before it.

    Live, the poses that it may have known.
    """
    step_ns = seconds_to_ns(parameters.motion.step)
    now_ns = stamp_ns // step_ns * step_ns
    if not record.is_live:
        pose = _pose_at(record, parameters, base, now_ns, now_ns - 1)
        return [] if pose is None else [pose]
    found = (_pose_at(record, parameters, base, now_ns - late, EVER) for late in _DELAYS_NS)
    return [pose for pose in found if pose is not None]


def _pose_at(
    record: Record, parameters: Parameters, base: str, now_ns: int, known_ns: int
) -> Pose | None:
    """Return the newest pose not after now, None where there is none young enough."""
    frames, world = record.frames, parameters.frames.map
    latest_ns = frames.latest_ns(world, base, now_ns, known_ns)
    if latest_ns is None or now_ns - latest_ns > seconds_to_ns(parameters.frames.max_age):
        return None
    pose = frames.lookup(world, base, latest_ns, known_ns)
    if pose is None:
        return None
    yaw = float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))
    return float(pose.translation_m[0]), float(pose.translation_m[1]), yaw
