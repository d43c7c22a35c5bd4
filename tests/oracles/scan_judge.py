"""A judge of augmented scans that shares no code with are_ros but for its oracle.

It knows the real recording (scans, transforms), the truth of the artefacts at every sub-step of
motion (the topic `artefacts` of a run of the same recording and seed at 20 Hz), the real surface
as a lattice, and the meshes of the catalogue's rows as triangles. For every beam of every augmented
scan it decides whether what the run wrote can be, by rays and transforms of its own:

- A beam that was changed ends on the surface of an artefact that is there at the scan's stamp:
  one that a tick of the run has shown by then, and that has not departed. Its pose is that
  of the truth's sub-step before, and goes on from there by the twist that the truth says.
- No changed beam went through another such artefact, or is farther than a valid real return.
- A changed beam without a real return (inf, NaN, outside the limits) gives no evidence that a
  wall is gone: it does not end behind the first solid cell.
- A beam that was not changed meets no artefact nearer than its real return, or, where it has none,
  nearer than the first solid cell.
- Every real scan has its augmented one, with the same header and angles; what did not change is
  the same bit for bit; the run's own ticks show the poses of the truth. From sub-step to
  sub-step all are where their twists lead, unless they are displaced or cannot go on.
"""

import math
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.checks.oracle.plane import signed_distances_m
from tests.oracles.judge_kernels import mesh_distances, mesh_hits
from tests.oracles.lattices import Lattice
from tests.oracles.rays import ray_hits_m
from tests.oracles.recorded import Frames, Outputs, Pose, Scan

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

TOLERANCE_M = 0.005
"""How far from an artefact's surface a changed beam may end."""
THROUGH_M = 0.02
"""How much nearer an artefact must be to count as passed through, or as missed."""
WIGGLE_M = 0.01
"""A beam counts as passed through or missed only if those this far aside, above, below meet it."""
SUB_STEP_NS = 50_000_000
WRONG = (
    "ghost",
    "through",
    "wall",
    "farther",
    "too near",
    "missing",
    "header",
    "lost scan",
    "no pose",
    "lives",
    "unsaid jump",
)
"""The kinds of what is wrong, each counted in beams but for those about scans and lives."""


@dataclass(eq=False)
class Verdict:
    """What the judge found: counts, the errors of ends [m], and an example of each wrong kind."""

    counts: Counter[str] = field(default_factory=Counter)
    examples: dict[str, str] = field(default_factory=dict)
    errors_m: list[Floats] = field(default_factory=list)

    def wrong(self) -> dict[str, int]:
        """Return what is wrong, by kind."""
        return {kind: self.counts[kind] for kind in WRONG if self.counts[kind]}

    def say(self, kind: str, count: int, example: str) -> None:
        """Count something, and keep its first example."""
        self.counts[kind] += count
        if count:
            self.examples.setdefault(kind, example)


@dataclass(frozen=True, eq=False)
class Body:
    """An artefact that may be met at a stamp, at a pose (x, y, z, yaw).

    `is_sure` where it must be met: ticks of the run before and after the stamp show it.
    """

    id: int
    box_centre: Floats
    half: Floats
    triangles: Floats | None
    pose: Floats
    is_sure: bool

    def hits(self, origin: Floats, ways: Floats) -> Floats:
        """Return the first hits (N,) of rays, inf where there is none."""
        turn = _turn(self.pose)
        start, own = turn.T @ (origin - self.pose[:3]), ways @ turn
        radius = float(np.linalg.norm(self.half) + np.linalg.norm(self.box_centre))
        along = -(own @ start)
        near = (start @ start - along**2 <= radius**2) & (along >= -radius)
        found = np.full(len(ways), np.inf)
        if near.any():
            rays = np.ascontiguousarray(own[near])
            slack = 0.0 if self.triangles is None else 1e-6
            found[near] = ray_hits_m(start, rays, self.box_centre, 0.0, self.half + slack)
        if self.triangles is None:
            return found
        near = np.isfinite(found)
        if near.any():
            rays = np.ascontiguousarray(own[near])
            found[near] = mesh_hits(start, rays, self._at_height(start, rays, radius))
        return found

    def _at_height(self, start: Floats, rays: Floats, radius: float) -> Floats:
        """Return the triangles between the lowest and the highest point of rays near it."""
        triangles = np.asarray(self.triangles)
        reach = float(np.linalg.norm(start)) + radius
        low = start[2] + reach * min(float(rays[:, 2].min()), 0.0) - 1e-6
        high = start[2] + reach * max(float(rays[:, 2].max()), 0.0) + 1e-6
        heights = triangles[:, :, 2]
        chosen = (heights.max(axis=1) >= low) & (heights.min(axis=1) <= high)
        return np.asarray(triangles[chosen])

    def distances(self, points: Floats) -> Floats:
        """Return how far points (N, 3) are from its surface."""
        own = np.ascontiguousarray((points - self.pose[:3]) @ _turn(self.pose))
        found = np.abs(signed_distances_m(own, self.box_centre, 0.0, self.half))
        inside = (np.abs(own - self.box_centre) <= self.half).all(axis=1)
        near = inside | (found < 0.1)  # of what is farther from the box that is bound enough
        if self.triangles is not None and near.any():
            found[near] = mesh_distances(own[near], self.triangles)
        return found


class Truth:
    """Where each artefact is at any stamp, and whether a run shows it by then."""

    def __init__(
        self, truth: Outputs, run: Outputs, triangles: Mapping[int, Floats] | None
    ) -> None:
        self._run = run
        self._truth = truth
        self._triangles = triangles
        self._own = [tick.stamp_ns for tick in run.ticks]
        ends = [tick.stamp_ns for tick in truth.ticks[:1] + truth.ticks[-1:]]
        self._length_ns = ends[-1] - ends[0] + SUB_STEP_NS if ends else 0
        self._stamps: dict[int, list[int]] = {}
        self._poses: dict[int, list[Floats]] = {}
        self._rates: dict[int, list[Floats]] = {}
        for tick in truth.ticks:
            for one, pose in tick.poses.items():
                self._stamps.setdefault(one, []).append(tick.stamp_ns)
                self._poses.setdefault(one, []).append(pose)
                self._rates.setdefault(one, []).append(tick.rates[one])
        self._first: dict[int, int] = {}
        for tick in run.ticks:
            for one in tick.poses:
                self._first.setdefault(one, tick.stamp_ns)

    def covers(self, stamp_ns: int) -> bool:
        """Return whether the truth knows the stamp."""
        ticks = self._truth.ticks
        return bool(ticks) and 0 <= stamp_ns - ticks[0].stamp_ns < self._length_ns

    def bodies(self, stamp_ns: int) -> list[Body]:
        """Return who may be met at a stamp."""
        before = bisect_right(self._own, stamp_ns) - 1
        after = bisect_left(self._own, stamp_ns)
        shown = [
            self._run.ticks[k].poses.keys() if 0 <= k < len(self._own) else ()
            for k in (before, after)
        ]
        bodies = []
        for one, first_ns in self._first.items():
            if first_ns > stamp_ns or self._run.departed_ns.get(one, stamp_ns) < stamp_ns:
                continue
            pose = self._pose_at(one, stamp_ns)
            if pose is not None:
                is_sure = all(one in ids for ids in shown)
                bodies.append(self._body(one, pose, is_sure))
        return bodies

    def others(self, stamp_ns: int) -> Iterator[tuple[str, Body]]:
        """Yield those who are about, but must not be met, with the reason."""
        for one, first_ns in self._first.items():
            departed_ns = self._run.departed_ns.get(one, stamp_ns)
            stamps = self._stamps.get(one)
            if not stamps:
                continue
            if departed_ns < stamp_ns < departed_ns + 20 * SUB_STEP_NS:
                yield "of one that has departed", self._body(one, self._poses[one][-1])
            elif stamps[0] - SUB_STEP_NS < stamp_ns < first_ns:
                known = self._pose_at(one, max(stamp_ns, stamps[0]))
                if known is not None:
                    yield "of one that no tick has shown yet", self._body(one, known)

    def differing_lives(self) -> tuple[int, int, str]:
        """Return how many poses of the run's ticks were compared, differ, and an example."""
        at = {tick.stamp_ns: tick.poses for tick in self._truth.ticks}
        compared, wrong, example = 0, 0, ""
        for tick in self._run.ticks:
            poses = at.get(tick.stamp_ns)
            if poses is None:
                continue
            compared += len(poses)
            apart = [
                one
                for one in {*poses, *tick.poses}
                if one not in poses
                or one not in tick.poses
                or np.abs(poses[one] - tick.poses[one]).max() > 1e-9
            ]
            wrong += len(apart)
            if apart and not example:
                example = f"artefact {apart[0]} in the tick at {tick.stamp_ns}"
        return compared, wrong, example

    def jumps(self) -> tuple[int, int, str]:
        """Return how many jumped between two sub-steps, how many of them unsaid, and an example.

        Who was displaced has an event; who could not go on is back where it was a sub-step ago.
        """
        all_, unsaid, example = 0, 0, ""
        for one, stamps in self._stamps.items():
            said = set(self._truth.displaced_ns.get(one, ()))
            for k in range(1, len(stamps)):
                if stamps[k] - stamps[k - 1] != SUB_STEP_NS:
                    continue
                before, after = self._poses[one][k - 1], self._poses[one][k]
                went = _gone(before, self._rates[one][k - 1], SUB_STEP_NS)
                if _is_same(went, after):
                    continue
                all_ += 1
                if stamps[k] not in said and not _is_same(before, after):
                    unsaid += 1
                    example = example or f"artefact {one} at {stamps[k]}"
        return all_, unsaid, example

    def _body(self, one: int, pose: Floats, is_sure: bool = False) -> Body:
        kind = self._truth.kinds[one]
        centre = np.array((kind.box_centre.x, kind.box_centre.y, kind.box_centre.z))
        half = 0.5 * np.array((kind.size.x, kind.size.y, kind.size.z))
        triangles = None if self._triangles is None else self._triangles[kind.row]
        return Body(one, centre, half, triangles, pose, is_sure)

    def _pose_at(self, one: int, stamp_ns: int) -> Floats | None:
        """Return its pose at a stamp: where the sub-step that began before has sent it."""
        stamps = self._stamps.get(one, [])
        k = bisect_right(stamps, stamp_ns) - 1
        if k < 0 or stamp_ns - stamps[k] >= SUB_STEP_NS:
            return None
        return _gone(self._poses[one][k], self._rates[one][k], stamp_ns - stamps[k])


def judge(
    real: Sequence[Scan],
    run: Outputs,
    truth: Outputs,
    frames: Frames,
    map_frame: str,
    lattice: Lattice,
    triangles: Mapping[int, Floats] | None = None,
    topic: str = "/ar_builder/scan",
) -> Verdict:
    """Return what is wrong in the augmented scans of a topic.

    `triangles` are the rows' meshes (T, 3, 3) in the artefact's frame; None: boxes are met.
    """
    verdict = Verdict()
    here = Truth(truth, run, triangles)
    compared, wrong, example = here.differing_lives()
    verdict.counts["poses of ticks"] = compared
    verdict.say("lives", wrong, example)
    verdict.counts["jumps"], unsaid, example = here.jumps()
    verdict.say("unsaid jump", unsaid, example)
    augmented = {scan.stamp_ns: scan for scan in run.scans.get(topic, ())}
    replayed = _replayed(real, run)
    verdict.counts["scans outside"] = len(real) - len(replayed)
    for scan in replayed:
        other = augmented.get(scan.stamp_ns)
        if other is None:
            verdict.say("lost scan", 1, f"the scan at {scan.stamp_ns}")
            continue
        _judge_scan(scan, other, here, frames.lookup, map_frame, lattice, verdict)
    return verdict


def _replayed(real: Sequence[Scan], run: Outputs) -> list[Scan]:
    """Return the real scans from the first to the last stamp that came out."""
    stamps = [scan.stamp_ns for scans in run.scans.values() for scan in scans]
    if not stamps:
        return list(real)
    return [scan for scan in real if min(stamps) <= scan.stamp_ns <= max(stamps)]


def _judge_scan(
    real: Scan,
    augmented: Scan,
    truth: Truth,
    lookup: Any,
    map_frame: str,
    lattice: Lattice,
    verdict: Verdict,
) -> None:
    at = f"scan {real.stamp_ns}"
    if not _same_but_ranges(real.message, augmented.message):
        verdict.say("header", 1, at)
        return
    changed = ~_same_bits(real.ranges, augmented.ranges)
    verdict.counts["scans"] += 1
    verdict.counts["beams"] += len(changed)
    verdict.counts["changed"] += int(changed.sum())
    frame = real.message.header.frame_id
    pose = lookup(map_frame, frame, real.stamp_ns)
    if pose is None:
        pose = lookup(map_frame, frame, real.stamp_ns, held=("map", "odom"))
        verdict.counts["scans with map -> odom held"] += pose is not None
    if pose is None or not truth.covers(real.stamp_ns):
        verdict.counts["scans not judged"] += 1
        verdict.say("no pose", int(changed.sum()), f"{at}: {'truth' if pose else 'transform'}")
        return
    _Look(real, augmented, changed, pose, truth, lattice, verdict).judge()


class _Look:
    """One scan, as the judge looks at it."""

    def __init__(
        self,
        real: Scan,
        augmented: Scan,
        changed: Bools,
        pose: Pose,
        truth: Truth,
        lattice: Lattice,
        verdict: Verdict,
    ) -> None:
        self.real, self.virtual, self.changed = real, augmented, changed
        self.turn, self.origin = pose
        self.truth, self.lattice, self.verdict = truth, lattice, verdict
        self.bodies = truth.bodies(real.stamp_ns)
        self.ways = np.ascontiguousarray(real.ways() @ self.turn.T)
        message = real.message
        self.limits = (np.float32(message.range_min), np.float32(message.range_max))
        values = real.ranges
        self.valid = (values >= self.limits[0]) & (values <= self.limits[1])
        hits = [body.hits(self.origin, self.ways) for body in self.bodies]
        none = np.full(len(values), np.inf)
        sure = [h for h, body in zip(hits, self.bodies, strict=True) if body.is_sure]
        self.all_hits = np.stack([none, *hits])
        self.nearest = self.all_hits.min(axis=0)
        self.sure = np.min(np.stack([none, *sure]), axis=0)

    def judge(self) -> None:
        """Judge every beam."""
        close = self.changed & np.isneginf(self.virtual.ranges)
        ends = self.changed & ~close
        self._ends(np.flatnonzero(ends))
        self._close(np.flatnonzero(close))
        self._walls(np.flatnonzero(ends & ~self.valid))
        self._missing(np.flatnonzero(~self.changed))

    def _ends(self, beams: npt.NDArray[np.int64]) -> None:
        """Each ends on a surface, through none, and nearer than the valid return."""
        ranges = self.virtual.ranges[beams].astype(np.float64)
        if not np.isfinite(ranges).all():
            self._say("ghost", beams[~np.isfinite(ranges)])
            beams, ranges = beams[np.isfinite(ranges)], ranges[np.isfinite(ranges)]
        if not len(beams):
            return
        farther = self.valid[beams] & (ranges > self.real.ranges[beams])
        self._say("farther", beams[farther])
        errors = np.abs(self.all_hits[:, beams] - ranges).min(axis=0)
        points = self.origin + ranges[:, None] * self.ways[beams]
        for body in self.bodies:
            loose = errors > TOLERANCE_M
            if loose.any():
                errors[loose] = np.minimum(errors[loose], body.distances(points[loose]))
        self.verdict.errors_m.append(errors)
        wrong = errors > TOLERANCE_M
        self._say("ghost", beams[wrong], errors[wrong], self._whose(points[wrong]))
        for name, limit in (("ghost over 5 cm", 0.05), ("ghost over 20 cm", 0.2)):
            self.verdict.counts[name] += int((errors[wrong] > limit).sum())
        through = self._met_well_before(beams, ranges - THROUGH_M)
        self._say("through", beams[through])

    def _whose(self, points: Floats) -> str:
        """Return on whose surface ghosts lie who must not be met, for the sentence; count them."""
        said = ""
        for reason, body in self.truth.others(self.real.stamp_ns) if len(points) else ():
            on = int((body.distances(points) <= 10 * TOLERANCE_M).sum())
            self.verdict.counts[f"ghost {reason}"] += on
            if on:
                said = f"{on} {reason} ({body.id})"
        return said

    def _close(self, beams: npt.NDArray[np.int64]) -> None:
        """Judge what became -inf: it meets an artefact nearer than range_min."""
        wrong = self.nearest[beams] > float(self.limits[0]) + TOLERANCE_M
        self._say("too near", beams[wrong])

    def _walls(self, beams: npt.NDArray[np.int64]) -> None:
        """Where there was no return, no virtual one is behind the first solid cell."""
        self.verdict.counts["changed without a return"] += len(beams)
        ranges = self.virtual.ranges[beams].astype(np.float64)
        behind = ranges - self._surfaces(beams, ranges)
        wrong = behind > self.lattice.slack_m + TOLERANCE_M
        self._say("wall", beams[wrong], behind[wrong])
        self.verdict.counts["wall over 0.5 m"] += int((behind > 0.5).sum())

    def _surfaces(self, beams: npt.NDArray[np.int64], reach: Floats) -> Floats:
        """Return the first solid cell on each beam, inf if a beam just beside it meets none."""
        found = np.zeros(len(beams))
        for turn in (-3e-4, 0.0, 3e-4):
            ways = self._turned(beams, np.full(len(beams), turn))
            origins = np.repeat(self.origin[None], len(beams), axis=0)
            found = np.maximum(found, self.lattice.first_solid(origins, ways, reach))
        return found

    def _missing(self, beams: npt.NDArray[np.int64]) -> None:
        """No artefact is nearer than what stayed."""
        real = self.real.ranges[beams]
        limit = np.where(self.valid[beams], real, self.limits[1]).astype(np.float64) - THROUGH_M
        limit[np.isneginf(real)] = -np.inf
        maybe = self.sure[beams] < limit
        beams, limit = beams[maybe], limit[maybe]
        blind = ~self.valid[beams]
        if blind.any():
            walls = self._first_wall(beams[blind], limit[blind])
            limit[blind] = np.minimum(limit[blind], walls - self.lattice.slack_m)
        missed = self._met_well_before(beams, limit)
        self._say("missing", beams[missed])
        if missed.sum() > 2 and not self.changed.any():
            self.verdict.say("bare scans", 1, f"scan {self.real.stamp_ns}")

    def _first_wall(self, beams: npt.NDArray[np.int64], reach: Floats) -> Floats:
        """Return the first solid cell on a beam or just beside it, whichever is nearer."""
        found = np.full(len(beams), np.inf)
        for turn in (-3e-4, 0.0, 3e-4):
            ways = self._turned(beams, np.full(len(beams), turn))
            origins = np.repeat(self.origin[None], len(beams), axis=0)
            found = np.minimum(found, self.lattice.first_solid(origins, ways, reach))
        return found

    def _met_well_before(self, beams: npt.NDArray[np.int64], limit: Floats) -> Bools:
        """Return which beams, and their neighbours, meet who is sure nearer than `limit`."""
        met: Bools = np.asarray(self.sure[beams] < limit)
        for aside, up in ((-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)) if met.any() else ():
            chosen = np.flatnonzero(met)
            turn = np.minimum(0.02, WIGGLE_M / np.maximum(self.sure[beams[chosen]], 0.1))
            ways = self._turned(beams[chosen], aside * turn, up * turn)
            hits = [body.hits(self.origin, ways) for body in self.bodies if body.is_sure]
            met[chosen] = np.min(hits, axis=0) < limit[chosen]
        return met

    def _turned(
        self, beams: npt.NDArray[np.int64], by_rad: Floats, up_rad: Floats | float = 0.0
    ) -> Floats:
        """Return the ways of beams, turned a little in the laser's plane and out of it."""
        message = self.real.message
        turns = message.angle_min + message.angle_increment * beams + by_rad
        level, height = np.cos(up_rad), np.sin(up_rad) * np.ones(len(turns))
        own = np.stack((level * np.cos(turns), level * np.sin(turns), height), axis=1)
        return np.ascontiguousarray(own @ self.turn.T)

    def _say(
        self,
        kind: str,
        beams: npt.NDArray[np.int64],
        by_m: Floats | None = None,
        more: str = "",
    ) -> None:
        if not len(beams):
            return
        k = 0 if by_m is None else int(np.argmax(np.where(np.isfinite(by_m), by_m, -1.0)))
        beam = int(beams[k])
        far = "" if by_m is None else f", by {by_m[k]:.3f} m"
        ranges = f"{self.real.ranges[beam]:.3f} -> {self.virtual.ranges[beam]:.3f}"
        text = f"scan {self.real.stamp_ns} beam {beam}: {ranges}{far}"
        self.verdict.say(kind, len(beams), f"{text}; {more}" if more else text)


def _same_but_ranges(a: Any, b: Any) -> bool:
    """Return whether two scans are one but for ranges and intensities."""
    names = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time")
    same = all(getattr(a, name) == getattr(b, name) for name in (*names, "range_min", "range_max"))
    frames = [one.header.frame_id.lstrip("/") for one in (a, b)]
    sizes = [(len(one.ranges), len(one.intensities)) for one in (a, b)]
    return same and frames[0] == frames[1] and sizes[0] == sizes[1]


def _same_bits(a: npt.NDArray[np.float32], b: npt.NDArray[np.float32]) -> Bools:
    return np.asarray((a.view(np.uint32) == b.view(np.uint32)) | (np.isnan(a) & np.isnan(b)))


def _gone(pose: Floats, rates: Floats, by_ns: int) -> Floats:
    """Return a pose (x, y, z, yaw) some time later; rates (x, y, yaw) are in its own frame."""
    seconds = 1e-9 * by_ns
    moved = pose.copy()
    moved[:2] += seconds * (_turn(pose)[:2, :2] @ rates[:2])
    moved[3] += seconds * rates[2]
    return np.asarray(moved)


def _is_same(a: Floats, b: Floats) -> bool:
    apart = np.abs(a - b)
    apart[3] = abs(math.remainder(a[3] - b[3], 2.0 * math.pi))
    return bool(apart.max() < 1e-6)


def _turn(pose: Floats) -> Floats:
    cosine, sine = math.cos(pose[3]), math.sin(pose[3])
    return np.array(((cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0)))
