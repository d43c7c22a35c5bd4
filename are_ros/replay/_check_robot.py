"""No artefact overlaps the robot at any tick, but where a contact was reported."""

from typing import Final

import numpy as np

from are_ros.conventions import seconds_to_ns
from are_ros.parameters.model import Parameters
from are_ros.replay._check_geometry import Outline
from are_ros.replay._check_lives import ROBOT_CONTACT, events_by_tick
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Tally, at_s, skipped

_SLACK_M: Final = 1e-3
"""Robot poses come from interpolation of our own; contacts shallower than this are not judged."""


def check_robot(record: Record) -> CheckResult:
    """No box overlaps the robot's outline, but from a reported contact on, while it lasts."""
    tally = Tally("overlaps with the robot", "boxes")
    if record.parameters is None:
        return skipped(tally.name, "there is no effective.yaml, which says the robot's shape")
    base = record.base_frame()
    if not record.frames.has(base):
        return skipped(tally.name, f"no transform names the base '{base}'; see --with-inputs")
    robot = record.parameters.robot
    outline = Outline.of(robot.footprint, robot.radius)
    reported: set[int] = set()
    for scene, events, _ in events_by_tick(record):
        reported |= {int(event.id) for event in events if event.kind == ROBOT_CONTACT}
        pose = _robot_at(record, record.parameters, base, scene.stamp_ns)
        if pose is None:
            tally.leave_out("ticks without the robot's pose")
            continue
        tally.look(len(scene.ids))
        depths = outline.depths_m(*pose, scene)
        for i in np.flatnonzero(depths > _SLACK_M):
            if int(scene.ids[i]) not in reported:
                text = f"id {scene.ids[i]} overlaps the robot by {depths[i]:.4f} m, unreported"
                tally.fail(f"{at_s(scene.stamp_ns)} {text}")
        reported &= {int(number) for number in scene.ids[depths > -_SLACK_M]}
    return tally.result()


def _robot_at(
    record: Record, parameters: Parameters, base: str, stamp_ns: int
) -> tuple[float, float, float] | None:
    """Return the pose that the last sub-step not after a tick knew: received before it."""
    step_ns = seconds_to_ns(parameters.motion.step)
    now_ns = stamp_ns // step_ns * step_ns
    frames, world = record.frames, parameters.frames.map
    latest_ns = frames.latest_ns(world, base, now_ns, now_ns - 1)
    if latest_ns is None or now_ns - latest_ns > seconds_to_ns(parameters.frames.max_age):
        return None
    pose = frames.lookup(world, base, latest_ns, now_ns - 1)
    if pose is None:
        return None
    yaw = float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))
    return float(pose.translation_m[0]), float(pose.translation_m[1]), yaw
