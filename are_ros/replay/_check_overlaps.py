"""No artefact overlaps a wall or another one at any tick, nor the robot but where reported."""

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from are_ros.conventions import seconds_to_ns
from are_ros.parameters.model import Parameters
from are_ros.replay._check_cells import Cover, Covers, RealMap, united
from are_ros.replay._check_geometry import TOUCHING_M, Outline, overlap_depths_m
from are_ros.replay._check_lives import ROBOT_CONTACT, events_by_tick
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Tally, at_s, skipped
from are_ros.replay._check_scene import Scene

_ROBOT_SLACK_M: Final = 1e-3
"""Robot poses come from interpolation of our own; contacts shallower than this are not judged."""


def covers_by_tick(record: Record) -> Iterator[tuple[Scene, RealMap | None, list[Cover]]]:
    """Yield each scene with the real map that it knew, and its boxes' cells there."""
    covers: Covers | None = None
    for scene in record.scenes:
        real = record.real_map_at(scene.stamp_ns)
        if real is None:
            yield scene, None, []
            continue
        if covers is None or covers.real is not real:
            covers = Covers(real)
        yield scene, real, covers.of(scene)


def check_walls(record: Record) -> CheckResult:
    """No box covers an occupied cell of the map (voxels of a cloud are not looked at)."""
    tally = Tally("walls", "boxes")
    if record.parameters is None:
        return skipped(tally.name, "there is no effective.yaml, which says what is occupied")
    threshold = record.parameters.world.occupied_threshold
    for scene, real, covers in covers_by_tick(record):
        if real is None:
            tally.note("some ticks had no map")
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
    """The clutter ratio is the share of free cells that all artefacts together cover."""
    tally = Tally("clutter ratio", "ticks")
    if record.parameters is None:
        return skipped(tally.name, "there is no effective.yaml, which says what is free")
    metrics, free = dict(record.metrics), 0
    last_real: RealMap | None = None
    for scene, real, covers in covers_by_tick(record):
        if real is None or scene.log_ns not in metrics:
            continue
        if real is not last_real:
            free, last_real = _free_count(real, record.parameters), real
        tally.look()
        found, cover = float(metrics[scene.log_ns].clutter_ratio), united(covers)
        least = len(cover.sure) / free if free else float("nan")
        most = (len(cover.sure) + len(cover.touched)) / free if free else float("nan")
        if free and not least - 1e-12 <= found <= most + 1e-12:
            wanted = f"{len(cover.sure)} cells of {free} free ones are {least:.9g}"
            tally.fail(f"{at_s(scene.stamp_ns)} it is {found:.9g}, but {wanted}")
    return tally.result()


def _free_count(real: RealMap, parameters: Parameters) -> int:
    is_free = (real.cells >= 0) & (real.cells <= parameters.world.free_threshold)
    return int(np.count_nonzero(is_free))


def check_neighbours(record: Record) -> CheckResult:
    """No two boxes overlap, in the plane and in height."""
    tally = Tally("overlaps of artefacts", "pairs")
    last: Scene | None = None
    overlapping: list[str] = []
    for scene in record.scenes:
        first, second = np.triu_indices(len(scene.ids), 1)
        tally.look(len(first))
        if not scene.is_like(last):
            overlapping = list(_overlapping(scene, first, second))
        for text in overlapping:
            tally.fail(f"{at_s(scene.stamp_ns)} {text}")
        last = scene
    return tally.result()


def _overlapping(
    scene: Scene, first: NDArray[np.int64], second: NDArray[np.int64]
) -> Iterator[str]:
    radii = np.hypot(*scene.half_sizes_m[:, :2].T)
    apart = np.hypot(*(scene.centres_m[first] - scene.centres_m[second])[:, :2].T)
    near = apart < radii[first] + radii[second]
    first, second = first[near], second[near]
    depths = overlap_depths_m(scene, first, second)
    for i in np.flatnonzero(depths > TOUCHING_M):
        pair = f"ids {scene.ids[first[i]]} and {scene.ids[second[i]]}"
        yield f"{pair} overlap by {depths[i]:.6f} m"


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
            tally.note("at some ticks the robot's pose is not known")
            continue
        tally.look(len(scene.ids))
        depths = outline.depths_m(*pose, scene)
        for i in np.flatnonzero(depths > _ROBOT_SLACK_M):
            if int(scene.ids[i]) not in reported:
                text = f"id {scene.ids[i]} overlaps the robot by {depths[i]:.4f} m, unreported"
                tally.fail(f"{at_s(scene.stamp_ns)} {text}")
        reported &= {int(number) for number in scene.ids[depths > -_ROBOT_SLACK_M]}
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
    pose: Any = frames.lookup(world, base, latest_ns, now_ns - 1)
    if pose is None:
        return None
    yaw = float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))
    return float(pose.translation_m[0]), float(pose.translation_m[1]), yaw
