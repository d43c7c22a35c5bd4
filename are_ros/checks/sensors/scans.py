"""The augmented scans, and where the artefacts were between two ticks.

A beam may change only where an artefact stands in its way, before any wall. Between two sub-steps
an artefact moves straight on, with the twist of the tick. Its position is exact up to the first
sub-step after a tick and in the last one before the next tick; in between its speed bounds it.
"""

import math
from bisect import bisect_right
from collections import defaultdict
from operator import itemgetter
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros.bag.decoded import DISPLACED, Scene
from are_ros.checks.oracle.frames import EVER, Pose
from are_ros.checks.oracle.plane import about_z, distances_m
from are_ros.checks.oracle.solids import Cloud, RealMap, Walls
from are_ros.checks.record import Record
from are_ros.checks.result import CheckResult, Tally, at_s, skipped
from are_ros.checks.sensors.depth_images import DepthFrame, box_triangles, compared
from are_ros.checks.sensors.samples import (
    BEAMS,
    Changes,
    LaserSample,
    RangeSample,
    Sample,
    SensorCloud,
)
from are_ros.checks.sensors.scan_pairs import ChangedScan, Released
from are_ros.checks.ticks import Departures
from are_ros.conventions import NS_PER_S, seconds_to_ns
from are_ros.parameters.choices import SensorGate, Shape
from are_ros.wording import counted

Floats = NDArray[np.float64]

_FASTER: Final = 1.1
_FASTER_MPS: Final = 0.3
_TURNS_RADPS: Final = 3.2
"""Between ticks a moving artefact may be this much faster than the ticks show of its label, and
turn this fast."""

_HERE_M: Final = 1e-3


class Box(NamedTuple):
    """The box of the artefact `number`, with the origin of F_A in the map.

    Any point of it may be `slack_m` elsewhere.
    """

    centre_m: Floats
    yaw_rad: float
    half_m: Floats
    slack_m: float
    number: int
    origin_m: Floats


class BoxPositions:
    """The boxes of the artefacts at any instant of a recording."""

    def __init__(self, record: Record) -> None:
        self._record = record
        self._stamps = [scene.stamp_ns for scene in record.scenes]
        self._step_ns = seconds_to_ns(record.settings.motion.step)
        self._departures = Departures(record)
        self._jumps: dict[int, list[tuple[int, float]]] = defaultdict(list)
        for event in record.events:
            if event.kind == DISPLACED:
                self._jumps[event.artefact_id].append((event.stamp_ns, event.value))
        self._fastest = _fastest(record.scenes)

    def at(self, stamp_ns: int) -> list[Box] | None:
        """Return the boxes of the visible artefacts; None if one is unknown or after the last tick.

        Visible are the artefacts that arrived by the last due tick and have not departed.
        """
        record = self._record
        after = bisect_right(self._stamps, stamp_ns)
        if after == len(self._stamps):
            return None
        later = record.scenes[after]
        earlier = record.scenes[after - 1] if after else None
        if record.runs.spans_ns and (
            earlier is None or not record.runs.are_together(earlier.stamp_ns, later.stamp_ns)
        ):
            return None
        due_ns = stamp_ns // record.period_ns * record.period_ns
        boxes = self._arrived(earlier, later, stamp_ns, due_ns)
        if earlier is not None:
            boxes += self._present(earlier, later, stamp_ns)
            if self._came_and_went(earlier, due_ns):
                return None
        return boxes

    def _arrived(
        self, earlier: Scene | None, later: Scene, stamp_ns: int, due_ns: int
    ) -> list[Box]:
        """Return the artefacts that only the next tick lists, as the tick before is missing."""
        known = set() if earlier is None else set(earlier.ids.tolist())
        boxes = []
        for i, number in enumerate(later.ids.tolist()):
            if number not in known and later.arrivals_ns[i] <= due_ns:
                left_ns = later.stamp_ns - max(stamp_ns, int(later.arrivals_ns[i]))
                speeds = self._fastest[later.labels[i]]
                boxes.append(
                    _box(later, i, _position(later, i), _reach_m(later, i, speeds, left_ns))
                )
        return boxes

    def _came_and_went(self, earlier: Scene, due_ns: int) -> bool:
        """Tell whether an artefact departed that only a missing tick could have shown."""
        first, last = (
            bisect_right(self._departures.all, at_ns, key=itemgetter(0))
            for at_ns in (earlier.stamp_ns, due_ns)
        )
        departed = {number for _, number in self._departures.all[first:last]}
        return not departed <= set(earlier.ids.tolist())

    def _present(self, earlier: Scene, later: Scene, stamp_ns: int) -> list[Box]:
        """Return the artefacts of the tick before that have not departed."""
        numbers = {int(number): j for j, number in enumerate(later.ids)}
        boxes = []
        for i, number in enumerate(earlier.ids.tolist()):
            end_ns = self._departures.of(number, int(earlier.arrivals_ns[i]))
            if end_ns is None or stamp_ns < end_ns:
                boxes += self._between(earlier, i, later, numbers.get(number), stamp_ns)
        return boxes

    def _between(
        self, earlier: Scene, i: int, later: Scene, j: int | None, stamp_ns: int
    ) -> list[Box]:
        """Return where an artefact may be: one box, or one before and one after a jump."""
        step_ns = self._step_ns
        first_ns = (earlier.stamp_ns // step_ns + 1) * step_ns
        went_s = (min(stamp_ns, first_ns) - earlier.stamp_ns) / NS_PER_S
        start = _position(earlier, i) + went_s * np.append(earlier.rates[i], 0.0)
        if stamp_ns < first_ns:
            return [_box(earlier, i, start, 0.0)]
        number = int(earlier.ids[i])
        jumped_m = self._jumped_m(number, earlier.stamp_ns, stamp_ns)
        if stamp_ns == first_ns and not jumped_m:
            return [_box(earlier, i, start, 0.0)]
        speeds = self._fastest[earlier.labels[i]]
        since_ns, span_ns = stamp_ns - first_ns, later.stamp_ns - first_ns
        if j is None:
            return [_box(earlier, i, start, jumped_m + _reach_m(earlier, i, speeds, since_ns))]
        end, left_ns = _position(later, j), span_ns - since_ns
        slack_m = _HERE_M + speeds[0] * span_ns / NS_PER_S
        jumps_m = self._jumped_m(number, stamp_ns, later.stamp_ns)
        if jumped_m or jumps_m or _apart_m(start, end) > slack_m:
            return [
                _box(earlier, i, start, jumped_m + _reach_m(earlier, i, speeds, since_ns)),
                _box(later, j, end, jumps_m + _reach_m(later, j, speeds, left_ns)),
            ]
        way = _way(start, end, since_ns / span_ns)
        if span_ns <= step_ns:
            return [_box(earlier, i, way, 0.0)]
        root_s = math.sqrt(since_ns * left_ns) / NS_PER_S
        mean_mps = _apart_m(start, end) / (span_ns / NS_PER_S)
        aside_m = root_s * math.sqrt(max(speeds[0] ** 2 - mean_mps**2, 0.0))
        turned_m = _radius_m(earlier, i) * root_s * speeds[1]
        return [_box(earlier, i, way, aside_m + turned_m)]

    def _jumped_m(self, number: int, after_ns: int, until_ns: int) -> float:
        """Return the length of all displacements of an artefact in (after, until]."""
        jumps = self._jumps.get(number, ())
        return sum(apart_m for t_ns, apart_m in jumps if after_ns < t_ns <= until_ns)


def _fastest(scenes: list[Scene]) -> dict[str, tuple[float, float]]:
    """Return how fast [m/s, rad/s] an artefact of each label may be between two ticks."""
    seen: dict[str, tuple[float, float]] = defaultdict(lambda: (0.0, 0.0))
    for scene in scenes:
        speeds = np.hypot(scene.rates[:, 0], scene.rates[:, 1]).tolist()
        turns = np.abs(scene.rates[:, 2]).tolist()
        for label, speed_mps, turn_radps in zip(scene.labels, speeds, turns, strict=True):
            before = seen[label]
            seen[label] = max(before[0], speed_mps), max(before[1], turn_radps)
    moving = ((label, speeds) for label, speeds in seen.items() if any(speeds))
    fastest = {
        label: (_FASTER * speed_mps + _FASTER_MPS, max(_TURNS_RADPS, turn_radps))
        for label, (speed_mps, turn_radps) in moving
    }
    return defaultdict(lambda: (0.0, 0.0), fastest)


def _position(scene: Scene, i: int) -> Floats:
    """Return where F_A is, float64 (4,): x, y, yaw, and the height of the box's centre."""
    yaw_rad = float(scene.yaws_rad[i])
    x_m, y_m = scene.centres_m[i, :2] - _turned(scene.box_centres_m[i, :2], yaw_rad)
    return np.array((x_m, y_m, yaw_rad, scene.centres_m[i, 2]))


def _box(scene: Scene, i: int, position: Floats, slack_m: float) -> Box:
    """Return the box of an artefact at a position (4,)."""
    x_m, y_m, yaw_rad, z_m = position.tolist()
    dx_m, dy_m = _turned(scene.box_centres_m[i, :2], yaw_rad).tolist()
    centre_m = np.array((x_m + dx_m, y_m + dy_m, z_m))
    origin_m = np.array((x_m, y_m, z_m - float(scene.box_centres_m[i, 2])))
    return Box(centre_m, yaw_rad, scene.half_sizes_m[i], slack_m, int(scene.ids[i]), origin_m)


def _turned(offset_m: Floats, yaw_rad: float) -> Floats:
    """Return an offset (2,) turned by a yaw."""
    turned: Floats = about_z(yaw_rad)[:2, :2] @ offset_m
    return turned


def _way(start: Floats, end: Floats, share: float) -> Floats:
    """Return the position (4,) at a share of the straight way."""
    change = end - start
    change[2] = math.remainder(float(change[2]), math.tau)
    return start + share * change


def _apart_m(one: Floats, other: Floats) -> float:
    """Return how far two positions (4,) are apart on the ground."""
    return float(np.hypot(*(other - one)[:2]))


def _radius_m(scene: Scene, i: int) -> float:
    """Return how far from F_A any point of a box may be on the ground."""
    offset_m, half_m = scene.box_centres_m[i, :2], scene.half_sizes_m[i]
    return float(np.hypot(*offset_m) + np.hypot(half_m[0], half_m[1]))


def _reach_m(scene: Scene, i: int, speeds: tuple[float, float], span_ns: int) -> float:
    """Return how far any point of a box may get in a time."""
    return (speeds[0] + _radius_m(scene, i) * speeds[1]) * span_ns / NS_PER_S


# The checks of scans.


_FEW: Final = 2e-5
"""At most this share of the pixels may be rounded otherwise, or lie otherwise at an edge."""
_EXACT_SLACK_M: Final = 0.02
_HELD_SLACK_M: Final = 0.10
_BEAMS_AT_ONCE: Final = 20_000


def check_scans(record: Record) -> list[CheckResult]:
    """Return three outcomes: what needs no geometry, where the changed beams end, and the walls."""
    beams = Tally("scans", "reading")
    ends = Tally("ends of changed beams", "scan")
    walls = Tally("walls before changed beams", "beam")
    if not record.scans.input_topics:
        reason = "the recording holds no scan that came in"
        lacks_inputs = record.lacks_inputs and bool(record.scans.unmatched())
        names = (beams.name, ends.name, walls.name)
        return [skipped(name, reason, needs_inputs=lacks_inputs) for name in names]
    beams.look(record.scans.pairs)
    _note_kinds(beams, record)
    for topic, stamp_ns in record.scans.unmatched():
        if record.is_live and record.scans.may_be_lost(topic, stamp_ns):
            beams.leave_out("scan", "without the one that came in, which the recording missed")
            continue
        beams.look()
        beams.fail(f"{topic} {at_s(stamp_ns)} has no scan of this stamp that came in")
    places, surface = BoxPositions(record), KnownWalls(record)
    passed_by = _WallsPassed(walls)
    for scan in record.scans.changed:
        if scan.changes.fault:
            beams.fail(f"{scan.topic} {at_s(scan.stamp_ns)} {scan.changes.fault}")
        else:
            _check_ends(ends, record, places, scan)
            known = None if surface.doubt else surface.at(scan.released_ns)
            if known is not None:
                passed_by.take(known, record, scan)
    passed_by.judge()
    if not record.scans.changed:
        ends.note("no scan was changed")
    if surface.doubt:
        return [beams.result(), ends.result(), skipped(walls.name, surface.doubt)]
    if not walls.looked_at:
        aside = ", those of range sensors aside" if record.scans.counts[RangeSample] else ""
        walls.note(f"no beam without a return was changed{aside}")
    return [beams.result(), ends.result(), walls.result()]


def _note_kinds(tally: Tally, record: Record) -> None:
    """Say how many of the readings were no laser scans, of each kind."""
    counts = record.scans.counts
    kinds: tuple[type[Sample], ...] = (*BEAMS.values(), SensorCloud)
    for kind in kinds:
        if counts[kind] and kind is not LaserSample:
            tally.note(f"{counted(counts[kind], kind.noun)} among them")
    if counts[DepthFrame]:
        images = counted(counts[DepthFrame], "depth image")
        tally.note(f"{images} of {counted(record.scans.pixels, 'pixel')} among them")


def _check_ends(tally: Tally, record: Record, places: BoxPositions, scan: ChangedScan) -> None:
    """Each changed beam ends at a box, or one is nearer than the laser measures."""
    found = sensor_pose(record, scan)
    boxes = places.at(seen_ns(record, scan))
    if found is None or boxes is None:
        what = "the laser was" if found is None else "all artefacts were"
        tally.leave_out("changed scan", f"for which it is not known where {what} at the stamp")
        return
    tally.look()
    pose, slack_m = found
    slack_m += scan.changes.spacing_m
    points = scan.changes.points_m @ pose.rotation.T + pose.translation_m
    explained = np.zeros(len(points), np.bool_)
    for box in boxes:
        explained |= _is_met(scan.changes, pose, points, box, slack_m + box.slack_m)
    if not explained.all():
        first = int(np.argmin(explained))
        text = f"ends at {_place(points[first, 0])}, where no artefact is"
        beams = counted(int(np.count_nonzero(~explained)), "such beam")
        tally.fail(f"{scan.topic} {at_s(scan.stamp_ns)} a changed beam {text}; {beams}")


def check_depths(record: Record) -> CheckResult:
    """Depth images equal an independent recomputation, pixel by pixel."""
    tally = Tally("depth images computed anew", "pixel")
    settings, pairs = record.settings, record.scans.kept_depths.kept
    if record.is_live:
        return skipped(tally.name, "a live recording does not tell what it was augmented with")
    if settings.sensors.gate is SensorGate.PERCEIVED:
        return skipped(tally.name, "sensors see what is perceived only (sensors.gate)")
    places, surface = BoxPositions(record), KnownWalls(record)
    by_a_step = at_edges = images = 0
    for pair in pairs:
        stamp_ns, released_ns = pair.output.stamp_ns, pair.output.at_ns
        frames = record.frames
        pose = frames.lookup(settings.frames.map, pair.output.frame_id, stamp_ns, released_ns)
        boxes = places.at(min(stamp_ns, _sub_step_after(record, released_ns)))
        if pose is None or boxes is None or any(box.slack_m for box in boxes):
            tally.leave_out("depth image", "for which it is not known exactly what was where")
            continue
        bodies = bodies_of(record, boxes)
        if bodies is None or (settings.sensors.shape is Shape.BOX and _is_inside(pose, boxes)):
            what = "with the camera inside a box" if bodies else "without markers that are meshes"
            tally.leave_out("depth image", what)
            continue
        found = compared(
            pair.real,
            pair.output,
            record.scans.rays(pair.info, rectified=pair.is_rectified),
            pose,
            bodies,
            settings.sensors.depth_range or np.inf,
            None if surface.doubt else surface.at(released_ns),
        )
        images += 1
        tally.look(found.tested)
        by_a_step, at_edges = by_a_step + found.by_a_step, at_edges + found.at_edges
        if found.others:
            pixels = counted(found.others, "pixel")
            place = f"row {found.place[0]}, column {found.place[1]}"
            said = f"{pair.topic} {at_s(stamp_ns)} has {pixels} other than expected; {place}"
            tally.fail(said, found.others)
    if images:
        tally.note(f"of {counted(images, 'image')}")
    if by_a_step or at_edges:
        tally.note(f"{by_a_step} differ by a step of the encoding, {at_edges} at edges")
    differ = max(by_a_step, at_edges)
    if differ > _FEW * tally.looked_at:
        tally.fail("more pixels differ than rounding explains", differ)
    return tally.result()


def box_in(scene: Scene, i: int) -> Box:
    """Return the box of an artefact of a tick."""
    return _box(scene, i, _position(scene, i), 0.0)


def bodies_of(record: Record, boxes: list[Box]) -> list[Floats] | None:
    """Return the triangles (F, 3, 3) of artefacts in the map, as sensors see them.

    Those of meshes are the markers'; None where one was not shown.
    """
    is_mesh, found = record.settings.sensors.shape is Shape.MESH, list[Floats]()
    for box in boxes:
        turn = about_z(box.yaw_rad)
        if not is_mesh:
            corners: Floats = box_triangles() * box.half_m @ turn.T
            found.append(corners + box.centre_m)
        elif box.number in record.meshes:
            found.append(record.meshes[box.number] @ turn.T + box.origin_m)
        else:
            return None
    return found


def _is_inside(camera: Pose, boxes: list[Box]) -> bool:
    """Tell whether a camera is inside a box: then there is no depth, and no triangle before it."""
    here = camera.translation_m[None]
    return any(distances_m(here, b.centre_m, b.yaw_rad, b.half_m)[0] <= 0.0 for b in boxes)


def _sub_step_after(record: Record, time_ns: int) -> int:
    step_ns = seconds_to_ns(record.settings.motion.step)
    return (time_ns // step_ns + 1) * step_ns


def seen_ns(record: Record, scan: Released) -> int:
    """Return the instant at which a reading shows the artefacts: at most one sub-step ahead."""
    if record.is_live:
        return scan.stamp_ns
    return min(scan.stamp_ns, _sub_step_after(record, scan.released_ns))


class _WallsPassed:
    """No beam that had no return ends behind what was occupied.

    The beams of many scans are judged at once: the way through the cells takes as long for one.
    """

    def __init__(self, tally: Tally) -> None:
        self._tally = tally
        self._walls: Walls | None = None
        self._scans: list[tuple[ChangedScan, Floats, Floats]] = []
        self._beams = 0

    def take(self, walls: Walls, record: Record, scan: ChangedScan) -> None:
        """Keep the beams of a scan, to be judged by these walls."""
        changes = scan.changes
        which = np.flatnonzero(changes.unreturned & ~changes.too_close)
        frames, stamp_ns = record.frames, scan.stamp_ns
        pose = frames.lookup(record.settings.frames.map, scan.frame_id, stamp_ns, scan.released_ns)
        if pose is None or not len(which):
            return
        if walls is not self._walls or self._beams >= _BEAMS_AT_ONCE:
            self.judge()
        ends_m = changes.points_m[which, 0] @ pose.rotation.T + pose.translation_m
        starts_m = np.broadcast_to(pose.translation_m, ends_m.shape)
        self._walls = walls
        self._scans.append((scan, starts_m, ends_m))
        self._beams += len(which)

    def judge(self) -> None:
        """Judge all beams that were kept, scan by scan."""
        scans, self._scans = self._scans, []
        if self._walls is None or not scans:
            return
        self._tally.look(self._beams)
        self._beams = 0
        starts_m, ends_m = (np.concatenate([one[k] for one in scans]) for k in (1, 2))
        crossed_m = self._walls.crossed(starts_m, ends_m)
        splits = np.cumsum([len(one[2]) for one in scans])[:-1]
        for (scan, _, ends), crossed in zip(scans, np.split(crossed_m, splits), strict=True):
            for i in np.flatnonzero(np.isfinite(crossed[:, 0])).tolist():
                where = (
                    f"ends at {_place(ends[i])}, behind what is occupied at {_place(crossed[i])}"
                )
                beam = f"{scan.topic} {at_s(scan.stamp_ns)} a beam without a return of its own"
                self._tally.fail(f"{beam} {where}")


class KnownWalls:
    """What hides artefacts from beams without a return, as it was known at a time.

    `doubt` is why that is not known, else empty.
    """

    def __init__(self, record: Record) -> None:
        self._record = record
        self._known: dict[int, Walls | None] = {}
        self._map: RealMap | None = None
        self.doubt = ""
        if record.is_live:
            self.doubt = "a live recording does not tell what the node knew when it augmented it"
        elif record.walls not in {"map", "octomap"}:
            self.doubt = "it is not known whether the walls are those of the map or an octomap's"
        elif record.walls == "octomap":
            self.doubt = self._doubt_about_clouds(record)
        elif record.walls == "map" and not record.maps:
            self.doubt = record.why_no_map()

    def _doubt_about_clouds(self, record: Record) -> str:
        if not record.clouds:
            return "the walls are those of an octomap that is not in the recording"
        if len(record.clouds) > 1:
            return f"the octomap changed: there are {len(record.clouds)} in the recording"
        if record.clouds[0].frame_id != record.settings.frames.map:
            return f"the octomap is in the frame '{record.clouds[0].frame_id}', not the map's"
        if self._of_cloud(record.clouds[0]) is None:
            return "the octomap is no lattice of voxels of one size, or of world.voxel_size"
        return ""

    def at(self, time_ns: int) -> Walls | None:
        """Return the walls; None where they are not known for sure, as they have just changed."""
        record = self._record
        if record.walls == "octomap":
            cloud = record.clouds[0]
            return self._of_cloud(cloud) if cloud.since_ns + NS_PER_S < time_ns else None
        now, before = (record.real_map_at(t_ns) for t_ns in (time_ns, time_ns - NS_PER_S))
        if now is None or (before is not None and not before.is_like(now)):
            return None
        if self._map is not None and self._map.is_like(now):
            now = self._map  # it came again as it was
        self._map = now
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
    changes: Changes, pose: Pose, points: Floats, box: Box, reach_m: float
) -> NDArray[np.bool_]:
    """Tell which beams (M,) the box explains: they end at it; if too close, pass it before."""
    near = np.zeros(len(points), np.bool_)
    shares = np.linspace(0.0, 1.0, 9) if changes.too_close.any() else np.ones(1)
    for share in shares.tolist():
        along = (pose.translation_m + share * (points - pose.translation_m)).reshape(-1, 3)
        apart_m = distances_m(along, box.centre_m, box.yaw_rad, box.half_m)
        is_near = (apart_m <= reach_m).reshape(points.shape[:2]).any(axis=1)
        near |= is_near if share == 1.0 else is_near & changes.too_close
    return near


def sensor_pose(record: Record, scan: Released) -> tuple[Pose, float] | None:
    """Return map_from_sensor as it could be known at the release, and its uncertainty."""
    frames, settings, stamp_ns = record.frames, record.settings.frames, scan.stamp_ns
    known_ns = EVER if record.is_live else scan.released_ns
    exact = frames.lookup(settings.map, scan.frame_id, stamp_ns, known_ns)
    if exact is not None:  # live, the node may have held map->odom before it was known
        return exact, _HELD_SLACK_M if record.is_live else _EXACT_SLACK_M
    fixed = record.odometry_frame()
    held = frames.lookup_held(settings.map, fixed, scan.frame_id, stamp_ns, known_ns)
    return None if held is None else (held, _HELD_SLACK_M)
