"""`are align` without the shell: where a map lies to which nothing joins the robot."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.draw.alignment import PlacedScans, draw_alignment
from are_ros.errors import BagError, MapError
from are_ros.replay.align_input import AlignInput, gather, map_of
from are_ros.replay.bag_reader import BagReader
from are_ros.replay.options import ReplayOptions
from are_ros.replay.progress_bar import ProgressBar
from are_ros.replay.roles import find_roles
from are_ros.replay.stopwatch import said_if_slow
from are_ros.wording import counted, why_refused
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.scan_matching import (
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
_WORTH_A_WORD: Final = 0.005
_MOST_DOTS: Final = 20_000
_ADVICE: Final = (
    "is the map of another place, or of another height than this laser? try another laser with"
    " --topic scan:=/NAME, or, where odometry drifts, a part with --duration 20"
)


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
            draw_outcome(outcome, out)
        except OSError as cause:
            raise BagError(f"--out {out}: it cannot be written ({why_refused(cause)})") from cause
        echo(f"picture      {out}")
    return outcome.is_sure


def draw_outcome(outcome: AlignOutcome, path: Path) -> None:
    """Write the map with the scans at the poses that were found, as PNG. Raises OSError."""
    found, cloud = outcome.alignment, outcome.cloud
    cloud = cloud.part(np.arange(0, len(cloud), -(-len(cloud) // _MOST_DOTS)))
    places = np.array([scan.place[:2] for scan in outcome.given.scans])
    places = places[np.unique(outcome.cloud.scans)]
    matches = [] if found is None else [found.best, *found.equals]
    placed = [
        PlacedScans(match.pose.apply(cloud.endpoints_m), match.pose.apply(places))
        for match in matches
    ]
    names = f"{outcome.map_frame} to {outcome.given.root}"
    if found is None or found.best.is_poor:
        title = f"no fit of {names}"
    else:
        title = f"ambiguous: {names}" if found.is_ambiguous else f"{names}, found by scans"
    subtitle = "the scans fit nowhere on the map"
    if found is not None:
        share = f"{found.best.near:.0%} of endpoints within {NEAR_M:g} m of a wall"
        subtitle = f"{outcome.line(found.best)}   ·   {share}"
    is_near = outcome.near(cloud)
    draw_alignment(
        outcome.grid, placed, is_near, path, near_m=NEAR_M, title=title, subtitle=subtitle
    )


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
        return [f"no fit: the scans fit nowhere on the map much better than elsewhere; {_ADVICE}"]
    best = found.best
    if best.is_poor:
        return _poor_lines(outcome, best)
    if found.is_ambiguous:
        return _ambiguous_lines(outcome, found)
    next_best = "no other place comes near"
    if found.rivals:
        rival = found.rivals[0]
        next_best = f"{_words(rival.pose)}: {rival.score / best.score:.0%} of the score"
    drift = [outcome.drift] if outcome.drift else []
    return [outcome.line(best), *_fit_lines(outcome, best), f"next best    {next_best}", *drift]


def _poor_lines(outcome: AlignOutcome, best: Match) -> list[str]:
    sentence = (
        f"no fit: at the best pose only {best.near:.0%} of the endpoints lie within {NEAR_M:g} m of"
        f" an occupied cell, and less than {POOR_SHARE:.0%} is not to be believed; {_ADVICE}"
    )
    return [sentence, *_fit_lines(outcome, best), f"that pose    {_words(best.pose)}"]


def _ambiguous_lines(outcome: AlignOutcome, found: Alignment) -> list[str]:
    best = found.best
    lines = ["ambiguous: these fit about as well as each other", outcome.line(best)]
    lines += [outcome.line(rival) for rival in found.equals]
    if found.slides_rad is not None:
        lines.append(
            f"the scans can be moved along {math.degrees(found.slides_rad) % 180.0:.0f} degrees of"
            " the map without loss, as in a corridor: a drive that sees its end would tell"
        )
    return [*lines, *_fit_lines(outcome, best)]


def _fit_lines(outcome: AlignOutcome, best: Match) -> list[str]:
    """Return how well it fits, and what it was found by."""
    given, cloud = outcome.given, outcome.cloud
    numbers = np.unique(cloud.scans)
    driven_m = given.driven_m()
    first_ns, last_ns = (given.scans[k].stamp_ns for k in (numbers[0], numbers[-1]))
    fit = f"{best.near:.0%} of {len(cloud):,} endpoints within {NEAR_M:g} m of an occupied cell"
    for share, where in (
        (best.unknown, "where the map is unknown"),
        (best.through, "behind walls"),
    ):
        if share >= _WORTH_A_WORD:
            fit += f", {share:.0%} {where}"
    scans = f"{counted(len(numbers), 'scan')} of {', '.join(given.topics)}, over"
    scans += f" {(last_ns - first_ns) / NS_PER_S:.0f} s and {driven_m[numbers[-1]]:.1f} m"
    if len(cloud) < len(outcome.whole):
        scans += f" (the first of {driven_m[-1]:.0f} m)"
    return [f"fit          {fit}", f"scans        {scans}"]


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
