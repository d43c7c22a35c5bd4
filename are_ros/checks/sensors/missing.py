"""What sensors did not see: rays that went past an artefact, and came out as they had come in.

A ray is cast anew where nothing was changed, against the artefacts' boxes, and where these are met
against the triangles of the markers. It was missed only where rays all about it, as far off as
anything may be, meet the artefact clearly before the ray's end.
"""

from collections import Counter
from typing import Final

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.oracle.frames import Pose
from are_ros.checks.oracle.plane import in_box, slab
from are_ros.checks.oracle.solids import Walls
from are_ros.checks.record import Record
from are_ros.checks.result import CheckResult, Tally, at_s, skipped
from are_ros.checks.sensors.samples import RangeSample, Rays
from are_ros.checks.sensors.scans import Box, BoxPositions, KnownWalls, seen_ns, sensor_pose
from are_ros.conventions import seconds_to_ns
from are_ros.parameters.choices import SensorGate, Shape
from are_ros.wording import counted

Floats = NDArray[np.float64]

_CLEARLY_M: Final = 0.02
"""So much nearer an artefact has to be than the end of a ray."""
_LARGEST_SLACK_M: Final = 0.3
"""An artefact of which it is known less well where it was may be anywhere."""
_MOST_CAST: Final = 24
"""So many rays of a reading at most are cast against one artefact, spread evenly."""

_AT_M: Final = 1e-6


def check_missing(record: Record) -> CheckResult:
    """No ray without a change goes through an artefact to what is behind it."""
    tally = Tally("rays that artefacts stop", "reading")
    if not record.scans.input_topics:
        lacks_inputs = record.lacks_inputs and bool(record.scans.unmatched())
        reason = "the recording holds no scan that came in"
        return skipped(tally.name, reason, needs_inputs=lacks_inputs)
    if record.is_live:
        return skipped(tally.name, "a live recording does not tell what it was augmented with")
    if record.settings.sensors.gate is SensorGate.PERCEIVED:
        return skipped(tally.name, "sensors see what is perceived only (sensors.gate)")
    if record.scans.counts[RangeSample]:
        tally.note("range sensors aside")
    places, surface = BoxPositions(record), KnownWalls(record)
    history_ns = seconds_to_ns(record.settings.poses.history)
    for scan in record.scans.kept_rays.kept:
        found, boxes = sensor_pose(record, scan), places.at(seen_ns(record, scan))
        is_late = scan.released_ns - scan.stamp_ns > history_ns
        if found is None or boxes is None or is_late:
            tally.leave_out("reading", "for which it is not known exactly what was where")
            continue
        tally.look()
        walls = None if surface.doubt else surface.at(scan.released_ns)
        for box in _sure(record, boxes, found[1], tally):
            missed = _missed(record, scan.rays, found, box, walls)
            if missed:
                rays = counted(missed, "ray")
                what = f"as it came, though artefact {box.number} is in the way of {rays}"
                tally.fail(f"{scan.topic} {at_s(scan.stamp_ns)} {what}")
                break
    return tally.result()


def _sure(record: Record, boxes: list[Box], slack_m: float, tally: Tally) -> list[Box]:
    """Return the boxes of those of whom place and shape are known well."""
    times = Counter(box.number for box in boxes)
    known = [
        box for box in boxes if times[box.number] == 1 and box.slack_m + slack_m <= _LARGEST_SLACK_M
    ]
    if record.settings.sensors.shape is not Shape.MESH:
        return known
    shown = [box for box in known if box.number in record.meshes]
    if len(shown) < len(known):
        tally.note("artefacts without markers that are meshes aside")
    return shown


def _missed(
    record: Record, rays: Rays, found: tuple[Pose, float], box: Box, walls: Walls | None
) -> int:
    """Return how many rays go through an artefact, of those that are looked at."""
    pose, slack_m = found[0], found[1] + box.slack_m
    turned = rays.ways @ pose.rotation.T
    enter_m, leave_m = _box_hits(box, pose.translation_m[None], turned)
    limits_m = rays.limits_m - slack_m - _CLEARLY_M
    # From inside a box (0) it is not clear what is met.
    through = (slack_m < enter_m) & (enter_m <= leave_m) & (enter_m < limits_m)
    through &= (walls is not None) | ~rays.unreturned
    which = np.flatnonzero(through)
    if not len(which):
        return 0
    which = which[np.linspace(0, len(which) - 1, min(len(which), _MOST_CAST)).astype(int)]
    starts, ways = np.broadcast_to(pose.translation_m, (len(which), 3)), turned[which]
    sides = np.cross(ways, (0.0, 0.0, 1.0))
    sides /= np.maximum(np.linalg.norm(sides, axis=1), 1e-9)[:, None]
    ups = np.cross(sides, ways)
    abouts = [starts + slack_m * off for off in (0.0 * sides, sides, -sides, ups, -ups)]
    hits_m = np.max([_hits(record, box, about, ways) for about in abouts], axis=0)
    is_missed = hits_m < limits_m[which]
    for one in abouts:
        unsure = np.flatnonzero(is_missed & rays.unreturned[which])
        if walls is not None and len(unsure):
            reaches_m = hits_m[unsure] + slack_m
            first_m = walls.first_solid(one[unsure], ways[unsure], reaches_m)
            is_missed[unsure] = np.isinf(first_m)
    return int(np.count_nonzero(is_missed))


def _hits(record: Record, box: Box, starts: Floats, ways: Floats) -> Floats:
    """Return how far rays (K, 3) go to an artefact, inf where they do not meet it."""
    enter_m, leave_m = _box_hits(box, starts, ways)
    is_met = (enter_m > 0.0) & (enter_m <= leave_m)
    hits_m = np.where(is_met, enter_m, np.inf)
    if record.settings.sensors.shape is Shape.MESH and is_met.any():
        own_starts = in_box(starts[is_met] - box.origin_m, box.yaw_rad)
        own_ways = in_box(ways[is_met], box.yaw_rad)
        ends_m = np.stack((enter_m[is_met], leave_m[is_met]))
        triangles = _at_heights(record.meshes[box.number], own_starts, own_ways, ends_m)
        hits_m[is_met] = _mesh_hits(own_starts, own_ways, triangles)
    return hits_m


def _box_hits(box: Box, starts: Floats, ways: Floats) -> tuple[Floats, Floats]:
    """Return where rays (K, 3) enter and leave a box."""
    own_starts, own_ways = in_box(starts - box.centre_m, box.yaw_rad), in_box(ways, box.yaw_rad)
    enter, leave = slab(own_starts, own_ways, -box.half_m, box.half_m)
    return enter.max(axis=1), leave.min(axis=1)


def _at_heights(triangles: Floats, starts: Floats, ways: Floats, ends_m: Floats) -> Floats:
    """Return the triangles between the lowest and the highest end (2, K) of rays: few of a mesh."""
    heights_m = starts[:, 2] + ends_m * ways[:, 2]
    low_m, high_m = heights_m.min() - _AT_M, heights_m.max() + _AT_M
    of_corners_m = triangles[:, :, 2]
    found: Floats = triangles[
        (of_corners_m.max(axis=1) >= low_m) & (of_corners_m.min(axis=1) <= high_m)
    ]
    return found


def _mesh_hits(starts: Floats, ways: Floats, triangles: Floats) -> Floats:
    """Return how far rays (K, 3) go to triangles (F, 3, 3), inf where they do not meet any.

    By Möller and Trumbore, all rays with all triangles.
    """
    corner, one, other = triangles[:, 0], *(triangles[:, k] - triangles[:, 0] for k in (1, 2))
    across = np.cross(ways[:, None], other)
    volume = (across * one).sum(axis=2)
    volume[np.abs(volume) < 1e-15] = np.nan
    apart = starts[:, None] - corner
    u = (across * apart).sum(axis=2) / volume
    along = np.cross(apart, one)
    v = (along * ways[:, None]).sum(axis=2) / volume
    far_m = (along * other).sum(axis=2) / volume
    with np.errstate(invalid="ignore"):
        is_met = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (far_m > 0.0)
    hits_m: Floats = np.where(is_met, far_m, np.inf).min(axis=1, initial=np.inf)
    return hits_m
