"""`are align` without the shell: where a map lies that nothing in a recording joins to the robot."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import BagError, MapError
from are_ros.replay._picture_align import draw_alignment
from are_ros.replay.align_input import AlignInput, gather, map_of
from are_ros.replay.bag_reader import BagReader
from are_ros.replay.options import ReplayOptions
from are_ros.replay.progress_bar import ProgressBar
from are_ros.replay.roles import find_roles
from are_ros.replay.stopwatch import said_if_slow
from are_ros.wording import counted, why_refused
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.scan_matching import (
    AMBIGUOUS,
    NEAR_M,
    POOR_SHARE,
    Alignment,
    Match,
    PlanarPose,
    ScanCloud,
    ScanMatcher,
    wrapped,
)

Say = Callable[[str], None]

_SEARCHED_WAY_M: Final = 60.0
"""Odometry drifts: of a longer way only the beginning is searched for."""
_PARTS: Final = 4
_DRIVEN_M: Final = 4.0
_DRIFT_REACH_M: Final = 0.1
_DRIFT_M: Final = 0.15
_DRIFT_RAD: Final = math.radians(2.0)


@dataclass(frozen=True, eq=False)
class AlignOutcome:
    """What was found: `alignment` is None where nothing fits at all.

    `cloud` is what was searched for, `whole` the cloud of the whole way; `drift` says how far the
    parts of the way are from the line, empty if they are not.
    """

    given: AlignInput
    grid: OccupancyGrid
    map_frame: str
    alignment: Alignment | None
    cloud: ScanCloud
    whole: ScanCloud
    drift: str
    matcher: ScanMatcher

    @property
    def is_sure(self) -> bool:
        """Whether there is one answer, and a good one."""
        found = self.alignment
        return found is not None and not (found.best.is_poor or found.is_ambiguous)

    def near(self, cloud: ScanCloud) -> npt.NDArray[np.bool_]:
        """Return which endpoints of a cloud lie near an occupied cell at the best pose, (N,)."""
        if self.alignment is None:
            return np.zeros(len(cloud), dtype=bool)
        away_m, _ = self.matcher.judged(cloud, self.alignment.best.pose)
        return away_m <= NEAR_M

    def line(self, match: Match) -> str:
        """Return the option that puts the map where a match says."""
        x_m, y_m, yaw_rad = match.pose
        numbers = f"{x_m:.3f} {y_m:.3f} 0 {yaw_rad:.4f} 0 0"
        return f'--static-tf "{numbers} {self.map_frame} {self.given.root}"'


def align_command(echo: Say, say: Say, options: ReplayOptions) -> bool:
    """Run `are align`; return whether there is one answer, and a good one. Raises AreError."""
    out = options.out
    outcome = align(options, say)
    for notice in outcome.given.notices:
        say(notice)
    for text in outcome_lines(outcome):
        echo(text)
    if out is not None:
        try:
            out.parent.mkdir(parents=True, exist_ok=True)
            draw_alignment(outcome, out)
        except OSError as cause:
            raise BagError(f"--out {out}: it cannot be written ({why_refused(cause)})") from cause
        echo(f"picture      {out}")
    return outcome.is_sure


def align(options: ReplayOptions, say: Say) -> AlignOutcome:
    """Read the recording and the map, and search."""
    parameters = options.parameters
    with BagReader(options.bags) as reader:
        roles = find_roles(reader.topics, options.topics)
        grid = map_of(reader, roles, options)
        with ProgressBar("read") as bar:
            progress = bar.open(reader.start_ns, reader.end_ns)
            given = gather(reader, roles, options, progress)
    world = parameters.world
    classes = classify(grid, world.occupied_threshold, world.free_threshold)
    if not classes.occupied.any():
        raise MapError(f"{options.map_file or 'the map'}: it has no occupied cell to match with")
    whole = given.cloud()
    near = given.driven_m() <= _SEARCHED_WAY_M
    cloud = whole.part(near[whole.scans])
    with said_if_slow(say, "searching the map (and compiling its kernels the first time)"):
        matcher = ScanMatcher(grid, classes)
        found = matcher.align(cloud)
        drift = "" if found is None or found.best.is_poor else _drift(matcher, given, found.best)
    frame = parameters.frames.map
    return AlignOutcome(given, grid, frame, found, cloud, whole, drift, matcher)


def outcome_lines(outcome: AlignOutcome) -> list[str]:
    """Return what a person reads: the line first, then how sure it is."""
    found = outcome.alignment
    if found is None:
        return [
            "no fit: the scans fit nowhere on the map; is it of another place, or of another height"
            " than this laser's?"
        ]
    best = found.best
    if best.is_poor:
        return [
            f"no fit: at the best pose only {best.near:.0%} of the endpoints lie within {NEAR_M:g} m"
            f" of an occupied cell, and {POOR_SHARE:.0%} is the least to be believed; is the map of"
            " another place, or of another height than this laser's? Or does the odometry drift:"
            " try --duration 20, or another laser with --topic scan:=",
            *_fit_lines(outcome, best),
            f"that pose    {_words(best.pose)} (not to be trusted)",
        ]
    if not found.is_ambiguous:
        next_best = found.rivals[0] if found.rivals else None
        return [
            outcome.line(best),
            *_fit_lines(outcome, best),
            "next best    "
            + (
                f"{_words(next_best.pose)}: {next_best.score / best.score:.0%} of the score"
                if next_best
                else "no other place comes near"
            ),
            *([outcome.drift] if outcome.drift else []),
        ]
    rivals = [rival for rival in found.rivals if rival.score >= AMBIGUOUS * best.score]
    lines = ["ambiguous: these fit as well as each other", outcome.line(best)]
    lines += [outcome.line(rival) for rival in rivals]
    if found.slides_rad is not None:
        degrees = math.degrees(found.slides_rad)
        lines.append(
            f"the scans can be moved along {degrees:.0f} degrees of the map without loss, as in a"
            " corridor: a part of the drive that sees its end would tell"
        )
    return [*lines, *_fit_lines(outcome, best)]


def _fit_lines(outcome: AlignOutcome, best: Match) -> list[str]:
    """Return how well it fits, and what it was found by."""
    given = outcome.given
    numbers = np.unique(outcome.cloud.scans)
    scans = [given.scans[k] for k in numbers]
    seconds = (scans[-1].stamp_ns - scans[0].stamp_ns) / 1e9
    way_m = float(given.driven_m()[numbers[-1]])
    beside = f", {best.unknown:.0%} lie where the map is unknown" if best.unknown >= 0.005 else ""
    through = f", {best.through:.0%} behind a wall" if best.through >= 0.005 else ""
    return [
        f"fit          {best.near:.0%} of {len(outcome.cloud):,} endpoints within {NEAR_M:g} m of an"
        f" occupied cell{beside}{through}",
        f"scans        {counted(len(scans), 'scan')} of {', '.join(given.topics)}, over"
        f" {seconds:.0f} s and {way_m:.1f} m"
        + (f"; the way goes on for {given.driven_m()[-1]:.0f} m" if _is_part(outcome) else ""),
    ]


def _is_part(outcome: AlignOutcome) -> bool:
    return len(outcome.cloud) < len(outcome.whole)


def _words(pose: PlanarPose) -> str:
    return f"x {pose.x_m:.2f} m, y {pose.y_m:.2f} m, yaw {math.degrees(pose.yaw_rad):.1f} degrees"


def _drift(matcher: ScanMatcher, given: AlignInput, best: Match) -> str:
    """Return a sentence if the parts of the way do not fit at one pose, else nothing."""
    driven_m, whole = given.driven_m(), given.cloud()
    if driven_m[-1] < _DRIVEN_M:
        return ""
    worst, sentence = 1.0, ""
    pose = best.pose
    for part in range(_PARTS):
        bounds = driven_m[-1] * part / _PARTS, driven_m[-1] * (part + 1) / _PARTS
        inside = (driven_m >= bounds[0]) & (driven_m <= bounds[1])
        if not inside.any():
            continue
        cloud = whole.part(inside[whole.scans])
        match = matcher.refined(cloud, pose, _DRIFT_REACH_M)
        if match.score <= matcher.match(cloud, pose).score:
            continue
        pose = match.pose
        middle = cloud.origins_m.mean(axis=0)[np.newaxis]
        away_m = float(np.hypot(*(pose.apply(middle) - best.pose.apply(middle))[0]))
        turned = abs(wrapped(pose.yaw_rad - best.pose.yaw_rad))
        badness = max(away_m / _DRIFT_M, turned / _DRIFT_RAD)
        if badness > worst:
            worst = badness
            sentence = (
                f"the odometry drifts: {bounds[0]:.0f} to {bounds[1]:.0f} m along the way the scans"
                f" fit best {away_m:.2f} m and {math.degrees(turned):.1f} degrees off this line;"
                " no static transform fits the whole drive, take a part with --start, --duration"
            )
    return sentence
