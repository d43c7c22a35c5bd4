"""`are align`: the transform between a map and the robot's frames, found by matching scans."""

import math
import os
from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.bag.reader import BagMessage, BagReader
from are_ros.bag.roles import RolesFound, find_roles, types_of
from are_ros.bag.stretches import GAP_NS, Window
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.conventions import NS_PER_S
from are_ros.draw.overview import PlacedScans, draw_alignment
from are_ros.errors import BagError, FrameError, InputError, MapError
from are_ros.messages.maps import read_grid
from are_ros.messages.sensors import read_scan
from are_ros.replay.progress import CountBar, Progress, ProgressBar, Say, said_if_slow
from are_ros.replay.recorded_frames import FRAME_ROLES, RecordedFrames
from are_ros.replay.survey.frame_survey import connected_to, root_above, standing_frame
from are_ros.replay.timeline import WITHOUT_MAP, ReplayOptions, topics_to_read
from are_ros.wording import counted, why_refused
from are_ros.world.map_io import read_map_file
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.scan_matching import (
    NEAR_M,
    POOR_SHARE,
    Alignment,
    Match,
    PlanarPose,
    ScanCloud,
    ScanMatcher,
)
from are_ros.world.transforms.tree import FrameTree

Floats = npt.NDArray[np.float64]

_CANDIDATES: Final = 600
_MOST_SCANS: Final = 90
_FEWEST_SCANS: Final = 10
_APART_M: Final = 0.4
_APART_RAD: Final = 0.3
_SLOW_RADPS: Final = 0.1
_MOST_TILT_RAD: Final = 0.1
_ENOUGH_SHARE: Final = 0.95
_FOR_EVER_NS: Final = 2**62


@dataclass(frozen=True, eq=False)
class PlacedScan:
    """One scan in the root frame: x, y, yaw of the laser, and where its returns end, (N, 2) [m]."""

    stamp_ns: int
    topic: str
    place: tuple[float, float, float]
    endpoints_m: Floats


@dataclass(frozen=True, eq=False)
class AlignInput:
    """The usable scans of a recording in frame `root`, and notices about the others.

    `is_top` tells whether that frame has no parent, so that the map can become it.
    """

    root: str
    topics: tuple[str, ...]
    scans: tuple[PlacedScan, ...]
    notices: tuple[str, ...]
    is_top: bool = True

    def cloud(self) -> ScanCloud:
        """Return all endpoints."""
        counts = [len(scan.endpoints_m) for scan in self.scans]
        return ScanCloud(
            np.concatenate([scan.endpoints_m for scan in self.scans]),
            np.repeat([scan.place[:2] for scan in self.scans], counts, axis=0),
            np.repeat(np.arange(len(counts)), counts),
        )

    def driven_m(self) -> Floats:
        """Return the distance driven until each scan, float64 (N,) [m], by the first laser."""
        way = [scan for scan in self.scans if scan.topic == self.scans[0].topic]
        places = np.array([scan.place[:2] for scan in way])
        steps = np.hypot(*np.diff(places, axis=0).T)
        driven_m = np.concatenate(((0.0,), np.cumsum(steps)))
        stamps_ns = [scan.stamp_ns for scan in self.scans]
        return np.interp(stamps_ns, [scan.stamp_ns for scan in way], driven_m)


def map_of(reader: BagReader, roles: RolesFound, options: ReplayOptions) -> OccupancyGrid:
    """Return the map of the file, else the last of the recording; AreError where there is none."""
    if options.map_file is not None:
        return read_map_file(options.map_file, options.parameters.frames.map)
    topic = roles.topic("map")
    if topic is None:
        raise BagError(WITHOUT_MAP)
    last = deque(reader.messages((topic,)), maxlen=1)
    if not last:
        raise BagError(f"{topic}: there is no map on it: give one with --map FILE.yaml")
    grid, wanted = read_grid(reader.deserialize(last[0]), topic), options.parameters.frames.map
    if grid.frame_id != wanted:
        raise BagError(
            f"{topic}: its frame is '{grid.frame_id}', but frames.map is '{wanted}': "
            f"give --map-frame {grid.frame_id}"
        )
    return grid


def gather(
    reader: BagReader, roles: RolesFound, options: ReplayOptions, progress: Progress
) -> AlignInput:
    """Read scans that are spread over the way of the robot; BagError where none is usable.

    `progress` gets the log time reached.
    """
    role_of_topic = topics_to_read(reader, options, roles)
    topics = tuple(topic for topic, role in role_of_topic.items() if role == "scan")
    if not topics:
        raise BagError(_no_scan(roles))
    reader.expect(types_of(role_of_topic))
    frames = {topic: role for topic, role in role_of_topic.items() if role in FRAME_ROLES}
    window = Window.of(reader, role_of_topic, options.start_s, options.duration_s)
    begin_ns, end_ns = window.start_ns, window.stop_ns
    laser = _laser_frame(reader, topics, begin_ns, end_ns)
    tree = _frames_of(reader, options, frames, window, progress)
    told = _told_by_odometry(reader, roles.topic("odom"))
    root, is_top = _root(tree, laser, told, options)
    collector = _Collector(tree, root)
    wanted = _spread_scans(reader, topics, begin_ns, end_ns)
    for message in reader.messages(topics, begin_ns, end_ns):
        if (message.topic, message.log_time_ns) in wanted:
            collector.take(reader, message)
    progress(end_ns)
    if not collector.placed:
        raise BagError(f"{', '.join(topics)}: none of the scans can be used: {collector.reason()}")
    placed = sorted(collector.placed, key=lambda scan: scan.stamp_ns)
    drive, notices = _longest_drive(placed)
    return AlignInput(
        root, topics, tuple(_telling(drive)), (*collector.notices(), *notices), is_top
    )


def _laser_frame(reader: BagReader, topics: Collection[str], begin_ns: int, end_ns: int) -> str:
    """Return the frame of the first scan that is not malformed; a driver's first ones may be.

    BagError where there is no scan; the InputError of the first one where all are malformed.
    """
    malformed: InputError | None = None
    for message in filter(reader.is_expected, reader.messages(topics, begin_ns, end_ns)):
        scan = _read(reader, message)
        if isinstance(scan, LaserScan):
            return scan.frame_id
        malformed = malformed or scan
    said = f"{', '.join(topics)}: no scan lies in the time that is to be read"
    raise malformed or BagError(said)


def _read(reader: BagReader, message: BagMessage) -> LaserScan | InputError:
    """Return the scan of a message, or what is wrong with it."""
    try:
        return read_scan(reader.deserialize(message), message.topic)
    except InputError as error:
        return error


def _longest_drive(placed: list[PlacedScan]) -> tuple[list[PlacedScan], list[str]]:
    """Return the scans of the longest stretch without a gap, and a notice about the others.

    Odometry begins anew after a gap: no one transform holds on both sides of it.
    """
    stamps_ns = np.array([scan.stamp_ns for scan in placed])
    bounds = [0, *(np.flatnonzero(np.diff(stamps_ns) >= GAP_NS) + 1).tolist(), len(placed)]
    begin, end = max(pairwise(bounds), key=lambda part: part[1] - part[0])
    if end - begin == len(placed):
        return placed, []
    others = counted(len(placed) - (end - begin), "scan")
    return placed[begin:end], [f"the recording has a gap: {others} beyond it left out"]


class _Collector:
    """Places scans in the root frame, and counts those that cannot be."""

    def __init__(self, tree: FrameTree, root: str) -> None:
        self.root = root
        self.placed: list[PlacedScan] = []
        self._tree = tree
        self._taken = self._tilted = self._refused = self._lost = 0
        self._why_refused = self._why_lost = ""

    def take(self, reader: BagReader, message: BagMessage) -> None:
        """Place a scan; one that is malformed, tilted or without a transform is counted."""
        self._taken += 1
        try:
            scan = read_scan(reader.deserialize(message), message.topic)
            placed = _placed(self._tree, self.root, message.topic, scan)
        except InputError as error:
            self._refused += 1
            self._why_refused = self._why_refused or str(error)
        except FrameError as error:
            self._lost += 1
            self._why_lost = str(error)
        else:
            if placed is None:
                self._tilted += 1
            elif len(placed.endpoints_m):
                self.placed.append(placed)

    def reason(self) -> str:
        """Return why no scan is usable."""
        return "; ".join(self.notices()) or "no beam has a return"

    def notices(self) -> list[str]:
        """Return notices about scans that are not used."""
        of = f"of {self._taken} scans"
        notices: list[str] = []
        if self.placed and len(self.placed) > _ENOUGH_SHARE * self._taken:
            return notices
        if self._refused:
            notices.append(f"{self._refused} {of} are refused ({self._why_refused})")
        if self._lost:
            lack = f"{self._lost} {of} have no transform ({self._why_lost})"
            advice = "" if self.placed else "; if it is fixed, give it with --static-tf"
            notices.append(f"{lack}{advice}")
        if self._tilted:
            notices.append(f"{self._tilted} {of} are not level, and a map tells nothing of them")
        return notices


def _placed(tree: FrameTree, root: str, topic: str, scan: LaserScan) -> PlacedScan | None:
    """Return a scan in the root frame, as of its stamp; None if it is tilted.

    Beams are not moved to where the laser was at each: a NAV350 corrects that itself, and nothing
    in a message tells. Raises FrameError while a transform is missing.
    """
    root_from_laser = tree.lookup(root, scan.frame_id, scan.stamp_ns)
    # Of a laser upside down z points down, and its beams are in the plane all the same.
    tilt_rad = math.acos(min(1.0, abs(float(root_from_laser.rotation_matrix()[2, 2]))))
    if tilt_rad > _MOST_TILT_RAD:
        return None
    endpoints = root_from_laser.apply(scan.returns()[0])[:, :2]
    x, y, _ = root_from_laser.translation_m.tolist()
    place = (x, y, root_from_laser.yaw_rad())
    return PlacedScan(scan.stamp_ns, topic, place, endpoints)


def _telling(placed: list[PlacedScan]) -> list[PlacedScan]:
    """Return scans from places that are apart, or evenly over the time where there are few.

    Of the scans those count in which the laser turned little: a turn shears a scan.
    """
    placed = _steady(placed)
    kept: dict[str, list[int]] = {}
    for number, scan in enumerate(placed):
        before = kept.setdefault(scan.topic, [])
        if not before or _is_apart(placed[before[-1]], scan):
            before.append(number)
    chosen = {number for numbers in kept.values() for number in numbers}
    if len(chosen) < _FEWEST_SCANS:
        chosen.update(_evenly(len(placed), _FEWEST_SCANS))
    numbers = sorted(chosen)
    return [placed[numbers[k]] for k in _evenly(len(numbers), _MOST_SCANS)]


def _steady(placed: list[PlacedScan]) -> list[PlacedScan]:
    """Return the slower half by the rate of turning, and all that hardly turn."""
    rates_radps = np.zeros(len(placed))
    last: dict[str, int] = {}
    for number, scan in enumerate(placed):
        before = last.setdefault(scan.topic, number)
        last[scan.topic] = number
        lasted_s = (scan.stamp_ns - placed[before].stamp_ns) / NS_PER_S
        if lasted_s > 0.0:
            rates_radps[number] = _turned(placed[before], scan) / lasted_s
    most_radps = max(_SLOW_RADPS, float(np.median(rates_radps))) if placed else 0.0
    return [placed[number] for number in np.flatnonzero(rates_radps <= most_radps).tolist()]


def _turned(one: PlacedScan, other: PlacedScan) -> float:
    """Return by how much the laser has turned [rad]."""
    return abs(math.remainder(other.place[2] - one.place[2], math.tau))


def _is_apart(one: PlacedScan, other: PlacedScan) -> bool:
    (x, y, _), (x1, y1, _) = one.place, other.place
    return math.hypot(x1 - x, y1 - y) > _APART_M or _turned(one, other) > _APART_RAD


def _evenly(count: int, most: int) -> list[int]:
    """Return `most` of the numbers below `count`, evenly spread; all where there are fewer."""
    if count <= most:
        return list(range(count))
    return [round(k) for k in np.linspace(0, count - 1, most).tolist()]


def _spread_scans(
    reader: BagReader, topics: Collection[str], begin_ns: int, end_ns: int
) -> frozenset[tuple[str, int]]:
    """Return the (topic, log time) of the scans to read: all, or some of a long recording."""
    found = [(m.topic, m.log_time_ns) for m in reader.messages(topics, begin_ns, end_ns)]
    return frozenset(found[k] for k in _evenly(len(found), _CANDIDATES))


def _frames_of(
    reader: BagReader,
    options: ReplayOptions,
    frames: Mapping[str, str],
    window: Window,
    progress: Progress,
) -> FrameTree:
    """Return the tree with the transforms of the window, and the static ones of the whole."""
    recorded = RecordedFrames(options.parameters, history_ns=_FOR_EVER_NS)
    static = [topic for topic, role in frames.items() if role == "tf_static"]
    for message in reader.messages(static) if static else ():
        recorded.take_message(reader, message, "tf_static")
    moving = [topic for topic in frames if topic not in static]
    for message in reader.messages(moving, window.start_ns, window.stop_ns) if moving else ():
        recorded.take_message(reader, message, frames[message.topic])
        progress(message.log_time_ns)
    return recorded.tree


def _told_by_odometry(reader: BagReader, topic: str | None) -> list[tuple[str, str]]:
    """Return parent and child of the odometry, where it names both."""
    first = None if topic is None else reader.first_object(topic)
    if first is None:
        return []
    names = first.header.frame_id.lstrip("/"), first.child_frame_id.lstrip("/")
    return [names] if all(names) else []


def _root(
    tree: FrameTree, laser: str, told: list[tuple[str, str]], options: ReplayOptions
) -> tuple[str, bool]:
    """Return the frame that the map is to be joined to, and whether it has no parent.

    `told` are the frames of odometry. BagError where the map is joined already.
    """
    parents = {edge.child: edge.parent for edge in tree.edges()}
    map_frame = options.parameters.frames.map
    root = standing_frame(laser, parents, told)
    if map_frame in connected_to(laser, ((parent, child) for child, parent in parents.items())):
        raise BagError(
            f"{map_frame} and {laser} hang together already: to find where another map lies, name"
            f" its frame, as with --map-frame site; the transform is then that of site -> {root}"
        )
    return root, root == root_above(laser, parents)


def _no_scan(roles: RolesFound) -> str:
    """Return why there is no scan topic."""
    said = [sentence for sentence in roles.sentences() if sentence.startswith("scan:")]
    return (
        said[0] if said else "the recording has no laser scan, and a map can be matched with none"
    )


_SEARCHED_WAY_M: Final = 60.0
"""Odometry drifts: of a longer way only the beginning is searched for."""
_MOST_DOTS: Final = 20_000
_WORTH_A_WORD: Final = 0.005
_ADVICE: Final = (
    "is the map of another place, or of another height than this laser, is it mirrored, or is its"
    " resolution wrong? try another laser with --topic scan:=/NAME, or, where odometry drifts, a"
    " part with --duration 20"
)


@dataclass(frozen=True, eq=False)
class AlignOutcome:
    """The result: `alignment` is None where the scans fit nowhere.

    `cloud` has the endpoints that were searched for.
    """

    given: AlignInput
    grid: OccupancyGrid
    map_frame: str
    alignment: Alignment | None
    cloud: ScanCloud
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
        """Return the --static-tf option of a match."""
        pose, ends = match.pose, f"{self.map_frame} {self.given.root}"
        if not self.given.is_top:
            pose, ends = pose.inverse(), f"{self.given.root} {self.map_frame}"
        x_m, y_m, yaw_rad = pose
        return f'--static-tf "{x_m:.3f} {y_m:.3f} 0 {yaw_rad:.4f} 0 0 {ends}"'


def align_command(echo: Say, say: Say, options: ReplayOptions) -> bool:
    """Run `are align`; return whether there is one answer, and a good one. Raises AreError."""
    out = options.out
    if out is not None:
        _prepare_picture(out)
    outcome = align(options, say)
    for notice in outcome.given.notices:
        say(notice)
    for text in outcome_lines(outcome):
        echo(text)
    if out is not None:
        try:
            draw_outcome(outcome, out)
        except OSError as cause:
            raise BagError(f"--out {out}: it cannot be written ({why_refused(cause)})") from cause
        echo(f"picture      {out}")
    return outcome.is_sure


def _prepare_picture(out: Path) -> None:
    """Make the folder of the picture before the search; BagError if it cannot be written."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as cause:
        raise BagError(f"--out {out}: its folder cannot be made ({why_refused(cause)})") from cause
    reason = "a folder has that name" if out.is_dir() else ""
    if not os.access(out if out.exists() else out.parent, os.W_OK):
        reason = "permission denied"
    if reason:
        raise BagError(f"--out {out}: it cannot be written ({reason})")


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
    draw_alignment(outcome.grid, placed, is_near, path, title=title, subtitle=subtitle)


def align(options: ReplayOptions, say: Say) -> AlignOutcome:
    """Read the recording and the map, and search."""
    parameters = options.parameters
    with BagReader(options.bags) as reader:
        for sentence in reader.unnamed:
            say(sentence)
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
        with CountBar("headings") as bar:
            found = matcher.align(cloud, bar.count)
    frame = parameters.frames.map
    return AlignOutcome(given, grid, frame, found, cloud, matcher)


def outcome_lines(outcome: AlignOutcome) -> list[str]:
    """Return the text: the option first, then the quality of the fit."""
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
    lines = [outcome.line(best), *_fit_lines(outcome, best), f"next best    {next_best}"]
    return [*lines, *_scale_lines(outcome, best)]


def _scale_lines(outcome: AlignOutcome, best: Match) -> list[str]:
    """Say where the map has another scale than the scans, so that the pose is only near."""
    scale = outcome.matcher.best_scale(outcome.cloud, best)
    if scale == 1.0:
        return []
    order = "large" if scale > 1.0 else "small"
    sentence = (
        f"the map seems about {abs(scale - 1.0):.0%} too {order} for the scans, so the pose is"
    )
    return [f"scale        {sentence} only near: is the map's resolution right?"]


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
    """Return the quality of the fit, and the scans that it is based on."""
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
    if numbers[-1] + 1 < len(given.scans):
        scans += f" (the first of {driven_m[-1]:.0f} m)"
    return [f"fit          {fit}", f"scans        {scans}"]


def _words(pose: PlanarPose) -> str:
    return f"x {pose.x_m:.2f} m, y {pose.y_m:.2f} m, yaw {math.degrees(pose.yaw_rad):.1f} degrees"
