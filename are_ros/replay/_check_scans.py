"""The augmented scans: a beam changed only where an artefact stood in its way."""

from bisect import bisect_right
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros.parameters.model import FramesParameters
from are_ros.replay._check_frames import EVER, Pose
from are_ros.replay._check_geometry import distances_m
from are_ros.replay._check_lives import departures_ns
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Tally, at_s, skipped
from are_ros.replay._check_scan_pairs import ChangedScan
from are_ros.replay._check_scene import Scene
from are_ros.wording import counted

Floats = NDArray[np.float64]

_EXACT_SLACK_M: Final = 0.02
_HELD_SLACK_M: Final = 0.10


class _Box(NamedTuple):
    """An artefact's box at a scan's stamp; `moved_m` is how far it came from tick to tick."""

    centre_m: Floats
    yaw_rad: float
    half_m: Floats
    moved_m: float


def check_scans(record: Record) -> list[CheckResult]:
    """Return two outcomes: what needs no geometry, and where the changed beams end."""
    beams = Tally("scans", "scan")
    ends = Tally("ends of changed beams", "scan")
    if not record.scans.input_topics:
        reason = "the recording holds no scan that came in"
        lacks_inputs = record.lacks_inputs and bool(record.scans.unmatched())
        names = (beams.name, ends.name)
        return [skipped(name, reason, needs_inputs=lacks_inputs) for name in names]
    beams.look(record.scans.pairs)
    for topic, stamp_ns in record.scans.unmatched():
        if record.is_live and record.scans.may_be_lost(topic, stamp_ns):
            beams.leave_out("scan", "without the one that came in, which the recording missed")
            continue
        beams.look()
        beams.fail(f"{topic} {at_s(stamp_ns)} has no scan of this stamp that came in")
    artefacts = _Artefacts(record)
    for scan in record.scans.changed:
        if scan.fault:
            beams.fail(f"{scan.topic} {at_s(scan.stamp_ns)} {scan.fault}")
        else:
            _check_ends(ends, record, artefacts, scan)
    if not record.scans.changed:
        ends.note("no scan was changed")
    return [beams.result(), ends.result()]


def _check_ends(tally: Tally, record: Record, artefacts: "_Artefacts", scan: ChangedScan) -> None:
    """Each changed beam ends at a box, or one is nearer than the laser measures."""
    found = _laser_pose(record, record.settings.frames, scan)
    released_ns = scan.stamp_ns if record.is_live else scan.released_ns
    boxes = artefacts.at(min(scan.stamp_ns, released_ns))
    if found is None or boxes is None:
        what = "the laser was" if found is None else "all artefacts were"
        tally.leave_out("changed scan", f"for which it is not known where {what} at the stamp")
        return
    tally.look()
    pose, slack_m = found
    points = scan.points_m @ pose.rotation.T + pose.translation_m
    explained = np.zeros(len(points), np.bool_)
    for box in boxes:
        reach_m = slack_m + box.moved_m
        explained |= _is_met(scan, pose, points, box, reach_m)
    if not explained.all():
        first = int(np.argmin(explained))
        x, y, z = points[first].tolist()
        text = f"ends at ({x:.3f}, {y:.3f}, {z:.3f}), where no artefact is"
        beams = counted(int(np.count_nonzero(~explained)), "such beam")
        tally.fail(f"{scan.topic} {at_s(scan.stamp_ns)} a changed beam {text}; {beams}")


def _is_met(
    scan: ChangedScan, pose: Pose, points: Floats, box: _Box, reach_m: float
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


class _Artefacts:
    """Where the artefacts stood at any time between two ticks, live of one run."""

    def __init__(self, record: Record) -> None:
        self._runs = record.runs
        self._scenes = record.scenes
        self._stamps = [scene.stamp_ns for scene in record.scenes]
        self._departures_ns = departures_ns(record)

    def at(self, stamp_ns: int) -> list[_Box] | None:
        """Return the boxes of those alive; None after the last tick, or where one is unknown."""
        after = bisect_right(self._stamps, stamp_ns)
        if after == len(self._stamps):
            return None
        later = self._scenes[after]
        earlier = self._scenes[after - 1] if after else None
        if self._runs.spans_ns and (
            earlier is None or not self._runs.are_together(earlier.stamp_ns, later.stamp_ns)
        ):
            return None
        boxes = [*_arrived(earlier, later, stamp_ns)]
        if earlier is not None:
            boxes += self._present(earlier, later, stamp_ns)
            if self._came_and_went(earlier, later):
                return None
        return boxes

    def _present(self, earlier: Scene, later: Scene, stamp_ns: int) -> list[_Box]:
        """Return those of the tick before, moved towards where the next one has them."""
        share = (stamp_ns - earlier.stamp_ns) / (later.stamp_ns - earlier.stamp_ns)
        places = {int(number): i for i, number in enumerate(later.ids)}
        boxes = []
        for i, number in enumerate(earlier.ids.tolist()):
            if number in places:
                boxes.append(_moved(earlier, i, later, places[number], share))
            elif stamp_ns < self._departures_ns.get(number, later.stamp_ns):
                boxes.append(_still(earlier, i))
        return boxes

    def _came_and_went(self, earlier: Scene, later: Scene) -> bool:
        """Tell whether somebody departed between two ticks whom no list ever named."""
        listed = set(earlier.ids.tolist())
        return any(
            earlier.stamp_ns < departed_ns <= later.stamp_ns and number not in listed
            for number, departed_ns in self._departures_ns.items()
        )


def _arrived(earlier: Scene | None, later: Scene, stamp_ns: int) -> list[_Box]:
    """Return those who are listed at the next tick only, and had arrived."""
    known = set() if earlier is None else set(earlier.ids.tolist())
    return [
        _still(later, i)
        for i, number in enumerate(later.ids.tolist())
        if number not in known and later.arrivals_ns[i] <= stamp_ns
    ]


def _still(scene: Scene, i: int) -> _Box:
    return _Box(scene.centres_m[i], float(scene.yaws_rad[i]), scene.half_sizes_m[i], 0.0)


def _moved(earlier: Scene, i: int, later: Scene, j: int, share: float) -> _Box:
    """Return a box between two ticks; it may be anywhere on the way, so that is its slack."""
    way = later.centres_m[j] - earlier.centres_m[i]
    turn = float(np.angle(np.exp(1j * (later.yaws_rad[j] - earlier.yaws_rad[i]))))
    half = earlier.half_sizes_m[i]
    moved_m = float(np.linalg.norm(way)) + abs(turn) * float(np.hypot(half[0], half[1]))
    centre = earlier.centres_m[i] + share * way
    return _Box(centre, float(earlier.yaws_rad[i]) + share * turn, half, moved_m)
