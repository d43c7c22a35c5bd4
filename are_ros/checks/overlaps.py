"""No artefact overlaps a wall, another one, or the robot; and how much of the map they cover."""

from collections.abc import Iterator
from math import isnan
from typing import Final

import numpy as np

from are_ros.bag.decoded import ROBOT_CONTACT, Scene
from are_ros.checks.oracle.frames import EVER
from are_ros.checks.oracle.plane import Outline, overlapping
from are_ros.checks.oracle.solids import SURE, Cover, Covers, RealMap, are_same, layer
from are_ros.checks.record import Record
from are_ros.checks.result import CheckResult, Tally, at_s, skipped
from are_ros.checks.ticks import events_by_tick
from are_ros.conventions import seconds_to_ns
from are_ros.parameters.model import Parameters
from are_ros.wording import counted

_SLACK_M: Final = 1e-3
"""Robot poses come from interpolation of our own; contacts shallower than this are not judged."""
_TURNING_M: Final = 0.01
"""Artefacts keep clear of each other sub-step by sub-step. Between two sub-steps the corners of
bodies that turn may meet, by less than this."""

_DELAYS_NS: Final = (0, 50_000_000, 100_000_000, 150_000_000, 200_000_000, 300_000_000)
"""Live, how long before a tick the pose may be from that the node knew."""

Pose = tuple[float, float, float]


def covers_by_tick(record: Record) -> Iterator[tuple[Scene, RealMap | None, list[Cover]]]:
    """Yield each scene with the real map that it knew, and its boxes' cells there."""
    covers: Covers | None = None
    for scene in record.scenes:
        real = record.real_map_of_tick(scene.stamp_ns)
        if real is None:
            yield scene, None, []
            continue
        if covers is None or covers.real is not real:
            covers = Covers(real)
        yield scene, real, covers.of(scene)


def check_walls(record: Record) -> CheckResult:
    """No box covers an occupied cell of the map (voxels of a cloud are not looked at)."""
    tally = Tally("walls", "box")
    if record.parameters is None:
        return skipped(tally.name, "nothing tells its parameters, which say what is occupied")
    if not record.maps:
        return skipped(tally.name, record.why_no_map(), needs_inputs=record.lacks_inputs)
    threshold = record.parameters.world.occupied_threshold
    for scene, real, covers in covers_by_tick(record):
        if real is None:
            tally.leave_out("tick", "without a map")
            continue
        values = real.cells.reshape(-1)
        for i, cover in enumerate(covers):
            tally.look()
            hit = cover.sure[values[cover.sure] >= threshold]
            if hit.size:
                row, col = divmod(int(hit[0]), real.cells.shape[1])
                cell = f"the occupied cell ({row}, {col})"
                tally.fail(f"{at_s(scene.stamp_ns)} id {scene.ids[i]} covers {cell}")
    return tally.result()


def check_clutter(record: Record) -> CheckResult:
    """Compare the clutter ratio with the share of free cells that all artefacts cover."""
    tally = Tally("clutter ratio", "tick")
    if record.parameters is None:
        return skipped(tally.name, "nothing tells its parameters, which say what is free")
    if not record.maps:
        return skipped(tally.name, record.why_no_map(), needs_inputs=record.lacks_inputs)
    ratios = {message.at_ns: message.clutter_ratio for message in record.metrics}
    last_real: RealMap | None = None
    last_covers: list[Cover] = []
    free = least = most = 0
    is_known = False
    for scene, real, covers in covers_by_tick(record):
        # A run may begin as the node is started again.
        is_known = is_known and not record.runs.is_beginning(scene.stamp_ns)
        if real is None or scene.at_ns not in ratios:
            tally.leave_out("tick", "without a map" if real is None else "without metrics")
            continue
        if real is not last_real:
            threshold = record.parameters.world.free_threshold
            free = int(np.count_nonzero((real.cells >= 0) & (real.cells <= threshold)))
        if real is not last_real or not are_same(covers, last_covers):
            cells = layer(covers, real)
            least, most = int(np.count_nonzero(cells == SURE)), int(np.count_nonzero(cells))
        last_real, last_covers = real, covers
        found = ratios[scene.at_ns]
        if isnan(found) and real.since_ns == scene.stamp_ns:
            continue  # the map of that very time may have come after the tick
        is_known = is_known or not isnan(found)
        if record.is_live and not is_known:
            tally.leave_out("tick", "before the node knew a map")
            continue
        tally.look()
        if free and not least / free - 1e-12 <= found <= most / free + 1e-12:
            wanted = f"{least / free:.9g}, {least} of {counted(free, 'free cell')}"
            tally.fail(f"{at_s(scene.stamp_ns)} it is {found:.9g}, not {wanted}")
    return tally.result()


def check_neighbours(record: Record) -> CheckResult:
    """No two boxes overlap, in the plane and in height; between sub-steps, no more than a touch."""
    tally = Tally("overlaps of artefacts", "pair")
    step_ns = 1 if record.parameters is None else seconds_to_ns(record.parameters.motion.step)
    last: Scene | None = None
    found: list[tuple[int, int, float]] = []
    for scene in record.scenes:
        tally.look(len(scene.ids) * (len(scene.ids) - 1) // 2)
        if not scene.is_like(last):
            found = overlapping(scene)
        for i, j, depth_m in found:
            if scene.stamp_ns % step_ns and depth_m < _TURNING_M:
                tally.leave_out("pair", "touching between two sub-steps")
            else:
                text = f"ids {scene.ids[i]} and {scene.ids[j]} overlap by {depth_m:.6f} m"
                tally.fail(f"{at_s(scene.stamp_ns)} {text}")
        last = scene
    return tally.result()


def check_robot(record: Record) -> CheckResult:
    """No box overlaps the robot's outline, but from a reported contact on, while it lasts.

    Which pose of the robot a live node knew is open: there, only what overlaps all of them counts.
    """
    tally = Tally("overlaps with the robot", "box")
    if record.parameters is None:
        return skipped(tally.name, "nothing tells its parameters, which say the robot's shape")
    base = record.base_frame()
    if not record.frames.has(base):
        given = record.parameters.frames.base
        reason = f"no transform names the base '{base}'" if given else "no transform names a base"
        return skipped(tally.name, reason, needs_inputs=record.lacks_inputs)
    robot = record.parameters.robot
    outline = Outline.of(robot.footprint, robot.radius)
    reported: set[int] = set()
    for scene, events, _ in events_by_tick(record):
        reported |= {event.artefact_id for event in events if event.kind == ROBOT_CONTACT}
        poses = _robot_at(record, record.parameters, base, scene.stamp_ns)
        if not poses:
            tally.leave_out("tick", "without the robot's pose")
            continue
        depths_m = np.array([outline.depths_m(*pose, scene) for pose in poses])
        least, most = depths_m.min(axis=0), depths_m.max(axis=0)
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
