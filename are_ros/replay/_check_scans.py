"""The augmented scans: a beam changed only where an artefact stood in its way, before any wall."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.oracle import distances_m
from are_ros.checks.oracle_solids import Cloud, Walls
from are_ros.conventions import NS_PER_S, seconds_to_ns
from are_ros.parameters.model import FramesParameters
from are_ros.replay._check_frames import EVER, Pose
from are_ros.replay._check_places import Box, Places
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Tally, at_s, skipped
from are_ros.replay._check_scan_pairs import ChangedScan
from are_ros.wording import counted

Floats = NDArray[np.float64]

_EXACT_SLACK_M: Final = 0.02
_HELD_SLACK_M: Final = 0.10


def check_scans(record: Record) -> list[CheckResult]:
    """Return three outcomes: what needs no geometry, where the changed beams end, and the walls."""
    beams = Tally("scans", "scan")
    ends = Tally("ends of changed beams", "scan")
    walls = Tally("walls before changed beams", "beam")
    if not record.scans.input_topics:
        reason = "the recording holds no scan that came in"
        lacks_inputs = record.lacks_inputs and bool(record.scans.unmatched())
        names = (beams.name, ends.name, walls.name)
        return [skipped(name, reason, needs_inputs=lacks_inputs) for name in names]
    beams.look(record.scans.pairs)
    for topic, stamp_ns in record.scans.unmatched():
        if record.is_live and record.scans.may_be_lost(topic, stamp_ns):
            beams.leave_out("scan", "without the one that came in, which the recording missed")
            continue
        beams.look()
        beams.fail(f"{topic} {at_s(stamp_ns)} has no scan of this stamp that came in")
    places, surface = Places(record), _Surface(record)
    for scan in record.scans.changed:
        if scan.fault:
            beams.fail(f"{scan.topic} {at_s(scan.stamp_ns)} {scan.fault}")
        else:
            _check_ends(ends, record, places, scan)
            known = None if surface.doubt else surface.at(scan.released_ns)
            if known is not None:
                _check_walls(walls, known, record, scan)
    if not record.scans.changed:
        ends.note("no scan was changed")
    if surface.doubt:
        return [beams.result(), ends.result(), skipped(walls.name, surface.doubt)]
    if not walls.looked_at:
        walls.note("no beam without a return was changed")
    return [beams.result(), ends.result(), walls.result()]


def _check_ends(tally: Tally, record: Record, places: Places, scan: ChangedScan) -> None:
    """Each changed beam ends at a box, or one is nearer than the laser measures."""
    found = _laser_pose(record, record.settings.frames, scan)
    boxes = places.at(_seen_ns(record, scan))
    if found is None or boxes is None:
        what = "the laser was" if found is None else "all artefacts were"
        tally.leave_out("changed scan", f"for which it is not known where {what} at the stamp")
        return
    tally.look()
    pose, slack_m = found
    points = scan.points_m @ pose.rotation.T + pose.translation_m
    explained = np.zeros(len(points), np.bool_)
    for box in boxes:
        explained |= _is_met(scan, pose, points, box, slack_m + box.slack_m)
    if not explained.all():
        first = int(np.argmin(explained))
        text = f"ends at {_place(points[first])}, where no artefact is"
        beams = counted(int(np.count_nonzero(~explained)), "such beam")
        tally.fail(f"{scan.topic} {at_s(scan.stamp_ns)} a changed beam {text}; {beams}")


def _seen_ns(record: Record, scan: ChangedScan) -> int:
    """Return the instant of which a scan shows the artefacts: a stamp ahead is not known yet."""
    if record.is_live:
        return scan.stamp_ns
    step_ns = seconds_to_ns(record.settings.motion.step)
    return min(scan.stamp_ns, (scan.released_ns // step_ns + 1) * step_ns)


def _check_walls(tally: Tally, walls: Walls, record: Record, scan: ChangedScan) -> None:
    """No beam that had no return ends behind what was occupied."""
    which = np.flatnonzero(scan.unreturned & ~scan.too_close)
    frames, stamp_ns = record.frames, scan.stamp_ns
    pose = frames.lookup(record.settings.frames.map, scan.frame_id, stamp_ns, scan.released_ns)
    if pose is None or not len(which):
        return
    tally.look(len(which))
    ends = scan.points_m[which] @ pose.rotation.T + pose.translation_m
    crossed = walls.crossed(pose.translation_m, ends)
    for i in np.flatnonzero(np.isfinite(crossed[:, 0])).tolist():
        where = f"ends at {_place(ends[i])}, behind what is occupied at {_place(crossed[i])}"
        tally.fail(f"{scan.topic} {at_s(stamp_ns)} a beam without a return of its own {where}")


class _Surface:
    """What hides artefacts from beams without a return, as it was known at a time.

    `doubt` is why that is not known, else empty.
    """

    def __init__(self, record: Record) -> None:
        self._record = record
        self._known: dict[int, Walls | None] = {}
        self.doubt = ""
        if record.is_live:
            self.doubt = "a live recording does not tell what a scan was augmented with"
        elif record.walls not in {"map", "octomap"}:
            self.doubt = "it is not known whether the walls are those of the map or an octomap's"
        elif record.walls == "octomap" and len(record.clouds) != 1:
            self.doubt = "the walls are those of an octomap that is not in the recording"
        elif record.walls == "octomap" and self._of_cloud(record.clouds[0]) is None:
            self.doubt = "the octomap has leaves of several sizes, or is in another frame"
        elif record.walls == "map" and not record.maps:
            self.doubt = record.why_no_map()

    def at(self, time_ns: int) -> Walls | None:
        """Return the walls; None where they are not known for sure, as they have just changed."""
        record = self._record
        if record.walls == "octomap":
            cloud = record.clouds[0]
            return self._of_cloud(cloud) if cloud.since_ns + NS_PER_S < time_ns else None
        now, before = (record.real_map_at(t_ns) for t_ns in (time_ns, time_ns - NS_PER_S))
        if now is None or (before is not None and before is not now):
            return None
        if id(now) not in self._known:
            world = record.settings.world
            low_m, high_m = world.ground_height, world.ground_height + world.wall_height
            walls = Walls.of_map(now, world.occupied_threshold, low_m, high_m)
            self._known[id(now)] = walls
        return self._known[id(now)]

    def _of_cloud(self, cloud: Cloud) -> Walls | None:
        if cloud.frame_id != self._record.settings.frames.map:
            return None
        if id(cloud) not in self._known:
            size_m = self._record.settings.world.voxel_size
            self._known[id(cloud)] = Walls.of_cloud(cloud.centres_m, size_m)
        return self._known[id(cloud)]


def _place(point: Floats) -> str:
    return "(" + ", ".join(f"{number:.3f}" for number in point.tolist()) + ")"


def _is_met(
    scan: ChangedScan, pose: Pose, points: Floats, box: Box, reach_m: float
) -> NDArray[np.bool_]:
    """Tell which beams (M,) the box explains: they end at it; if too close, pass it before."""
    near = distances_m(points, box.centre_m, box.yaw_rad, box.half_m) <= reach_m
    shares = np.linspace(0.0, 1.0, 9) if scan.too_close.any() else ()
    for share in shares:
        along = pose.translation_m + share * (points - pose.translation_m)
        passes = distances_m(along, box.centre_m, box.yaw_rad, box.half_m) <= reach_m
        near |= scan.too_close & passes
    return near


def _laser_pose(
    record: Record, settings: FramesParameters, scan: ChangedScan
) -> tuple[Pose, float] | None:
    """Return map_from_laser as it could be known at the release, and its uncertainty."""
    frames, stamp_ns = record.frames, scan.stamp_ns
    known_ns = EVER if record.is_live else scan.released_ns
    exact = frames.lookup(settings.map, scan.frame_id, stamp_ns, known_ns)
    if exact is not None:  # live, the node may have held map->odom before it was known
        return exact, _HELD_SLACK_M if record.is_live else _EXACT_SLACK_M
    held = frames.lookup_held(settings.map, settings.odom, scan.frame_id, stamp_ns, known_ns)
    return None if held is None else (held, _HELD_SLACK_M)
