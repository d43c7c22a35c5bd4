"""Pictures on a map: overview.png of a run, and align.png of laser scans at their places."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path as File
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import EventKind
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.conventions import NS_PER_S
from are_ros.draw.artefacts import (
    BEHAVIOUR_PX,
    CONTACT_MARK,
    DISPLACED_MARK,
    GONE_ALPHA,
    PATH_PX,
    SEEN_PATH_PX,
    UNSEEN_ALPHA,
    behaviour_of,
    contacts,
    displacements,
    draw_artefact,
    draw_paths,
    forced,
    is_gone,
    mark_places,
    outline_of,
    path_of,
)
from are_ros.draw.canvas import Canvas, Rectangle, bounds_of
from are_ros.draw.map import View, draw_map, known_part, window_of, with_furniture
from are_ros.draw.palette import (
    CONTACT,
    GREY,
    INK,
    ROBOT,
    SEEN,
    SERIES,
    Rgb,
    behaviour_marks,
    class_colours,
    time_colour,
)
from are_ros.draw.robot import (
    draw_ever_seen,
    draw_robot,
    draw_robot_path,
    fan_at,
    other_fans,
    spread_indices,
    time_fractions,
    walls_of,
)
from are_ros.draw.scene import Life, SceneRecord
from are_ros.draw.sheet import (
    Entry,
    Label,
    Labels,
    Sheet,
    id_text,
    line_sign,
    mark_sign,
    patch_sign,
)
from are_ros.population.scenario import FIRST_ADMITTED_ID
from are_ros.wording import counted
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.scan_matching import NEAR_M
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]

_SWEPT_FANS: Final = 60
_LABEL_PX: Final = 12
_LONGEST_GAP_PX: Final = 10.0
"""A number that is farther from its artefact has a line to it."""


def draw_overview(
    record: SceneRecord,
    grid: OccupancyGrid,
    path: File,
    *,
    occupied_threshold: int,
    ids_as_in: str = "metrics.json",
    voxels: VoxelMap | None = None,
) -> None:
    """Write the picture of a run over its map, as PNG; the same input gives the same bytes.

    It shows the known part of the map, what stands there by the octomap (`voxels`, if there is
    one), what was in view at some time (as far as the octomap at the camera's height, or else the
    walls of the map, and taller artefacts let the camera see), the robot's path, and each artefact
    where it ended, with the path that it went. `ids_as_in` names where a reader finds the ids
    again.
    """
    part = known_part(grid)
    shown_cells = part if voxels is None else with_furniture(grid, part, voxels)
    end_ns = int(record.series.stamps_ns[-1]) if len(record.series.stamps_ns) else 0
    # On top are those still there, and those perceived.
    standing = [life for life in record.lives if len(life.footprints)]
    standing.sort(key=lambda life: (not is_gone(life, end_ns), life.is_perceived))
    moved = displacements(record.events)
    paths = [path_of(life, moved.get(life.artefact_id, ())) for life in standing]
    colours = class_colours([life.row.class_name for life in record.lives])
    marks = behaviour_marks([behaviour_of(life) for life in standing])
    window = window_of(grid, part, _extent_m(record, standing))
    sheet = Sheet.of(window, _legends(record, colours, marks, end_ns))
    canvas, view = sheet.canvas, sheet.view
    draw_map(canvas, view, grid, shown_cells)
    _draw_ever_seen(sheet, record, walls_of(grid, occupied_threshold, voxels))
    draw_paths(canvas, view, paths, colours, marks)
    outlines_px = _draw_artefacts(sheet, standing, colours, end_ns)
    _draw_robot(sheet, record)
    _draw_events(sheet, record)
    left_out = _draw_ids(sheet, [life.artefact_id for life in standing], outlines_px)
    duration_s = record.duration_ns / NS_PER_S if len(record.robot) else None
    subtitle = subtitle_of(record, left_out, ids_as_in)
    sheet.write(path, _title(record), subtitle, duration_s)


def _extent_m(record: SceneRecord, lives: Sequence[Life]) -> Floats:
    """Return the points (N, 2) that have to be in the picture."""
    ends = [life.footprints.poses[-1, :2] for life in lives]
    reach = [0.5 * max(life.row.size_m[:2]) for life in lives]
    corners = [end + d * r for end, r in zip(ends, reach, strict=True) for d in (-1.0, 1.0)]
    paths = [life.footprints.poses[:, :2] for life in lives]
    outline = np.array(corners, dtype=np.float64).reshape(-1, 2)
    return np.concatenate((record.robot.poses[:, :2], outline, *paths))


def _draw_ever_seen(sheet: Sheet, record: SceneRecord, walls: VoxelField) -> None:
    """Tint what was ever in view of a camera."""
    indices = spread_indices(record, _SWEPT_FANS)
    found = [fan for index in indices if (fan := fan_at(record, walls, index)) is not None]
    stamps = record.camera.stamps_ns[list(indices)].tolist()
    if not stamps:  # the first camera has no pose, others have
        known = sorted(record.others)
        stamps = known[:: max(1, math.ceil(len(known) / _SWEPT_FANS))]
    found += [fan for stamp in stamps for fan in other_fans(record, walls, stamp)]
    draw_ever_seen(sheet.canvas, sheet.view, found)


def _draw_artefacts(
    sheet: Sheet, lives: Sequence[Life], colours: Mapping[str, Rgb], end_ns: int
) -> list[Floats]:
    """Draw each artefact at its end; return the corners (4, 2) of each, what is on top last."""
    corners_px = []
    for life in lives:
        outline = outline_of(sheet.view, life.footprints.poses[-1], life.row.size_m)
        alpha = GONE_ALPHA if is_gone(life, end_ns) else 1.0
        colour = colours[life.row.class_name]
        draw_artefact(sheet.canvas, outline, colour, is_opaque=life.is_perceived, alpha=alpha)
        corners_px.append(outline.corners_px)
    return corners_px


def _draw_ids(sheet: Sheet, ids: Sequence[int], corners_px: Sequence[Floats]) -> int:
    """Write the ids beside their artefacts, those on top first; return how many found no place."""
    labels = [
        Label(k, bounds_of(corners_px[k]), (id_text(ids[k]),)) for k in reversed(range(len(ids)))
    ]
    placed = Labels(sheet.view.rectangle, _LABEL_PX).place(labels, [one.box for one in labels])
    for one in placed:
        leader_px = _leader_px(one.place, corners_px[one.label.key])
        if math.dist(*leader_px) > _LONGEST_GAP_PX:
            sheet.canvas.line(leader_px, INK, 0.8)
        sheet.canvas.text(one.text, one.place[:2], _LABEL_PX)
    return len(labels) - len(placed)


def _leader_px(place: Rectangle, corners_px: Floats) -> Floats:
    """Return the two points (2, 2) at which a rectangle and a turned one come nearest, or so."""
    left, top, right, bottom = place
    middle = np.array((0.5 * (left + right), 0.5 * (top + bottom)))
    sides = np.roll(corners_px, -1, axis=0) - corners_px
    lengths = np.maximum((sides**2).sum(axis=1), 1e-9)
    along = np.clip(((middle - corners_px) * sides).sum(axis=1) / lengths, 0.0, 1.0)
    points = corners_px + along[:, np.newaxis] * sides
    nearest = points[np.linalg.norm(points - middle, axis=1).argmin()]
    return np.array((np.clip(nearest, (left, top), (right, bottom)), nearest))


def _draw_robot(sheet: Sheet, record: SceneRecord) -> None:
    """Draw the path, and the robot at both ends of it."""
    track = record.robot
    if not len(track):
        return
    draw_robot_path(sheet.canvas, sheet.view, track, time_fractions(record, track.stamps_ns))
    for index, fraction in ((0, 0.0), (-1, 1.0)):
        colour = time_colour(fraction)
        draw_robot(sheet.canvas, sheet.view, record.footprint, track.poses[index], colour)


def _draw_events(sheet: Sheet, record: SceneRecord) -> None:
    """Mark displacements and contacts."""
    kinds = zip(mark_places(record), (DISPLACED_MARK, CONTACT_MARK), strict=True)
    for places, (name, size_px, face, edge) in kinds:
        for place in sheet.view.pixels(places):
            sheet.canvas.mark(name, place, size_px, face, edge, 1.2)


def _title(record: SceneRecord) -> str:
    arrived = record.metrics.arrivals if record.metrics else 0
    perceived = sum(life.is_perceived for life in record.lives)
    seen = f"{perceived} perceived" if record.is_perceiving else "perception left out"
    return f"{counted(arrived, 'virtual artefact')} arrived, {seen}"


def subtitle_of(record: SceneRecord, without_id: int, ids_as_in: str) -> list[str]:
    """Return what is said below the title; so many artefacts have no id, for want of room."""
    ids = f"numbers are ids, as in {ids_as_in}"
    if any(life.artefact_id >= FIRST_ADMITTED_ID for life in record.lives):
        ids += f", s0 for {FIRST_ADMITTED_ID}"
    if without_id:
        ids += f"; {counted(without_id, 'number')} left out for want of room"
    steps = np.diff(record.robot.poses[:, :2], axis=0)
    is_driven = np.diff(record.robot.drives()) == 0
    driven_m = float(np.linalg.norm(steps[is_driven], axis=1).sum())
    blocked = Counter(event.kind for event in record.events)[EventKind.BLOCKED]
    return [
        f"{record.duration_ns / NS_PER_S:.0f} s",
        f"robot drove {driven_m:.1f} m" if len(record.robot) else "no pose of the robot",
        f"{counted(blocked, 'arrival')} blocked" if blocked else "",
        f"seed {record.seed}",
        "each artefact where it was last" if record.lives else "",
        ids if record.lives else "",
    ]


def _legends(
    record: SceneRecord, colours: Mapping[str, Rgb], marks: Mapping[str, str], end_ns: int
) -> list[list[Entry]]:
    """Return the entries for classes, behaviours, and what else there is to see."""
    rest = [*_artefact_entries(record, end_ns), *_event_entries(record)]
    if record.has_cameras:
        rest.append(Entry("in view at some time", patch_sign(SEEN, 0.17)))
    return [class_entries(record, colours), behaviour_entries(record.lives, marks), rest]


def class_entries(record: SceneRecord, colours: Mapping[str, Rgb]) -> list[Entry]:
    """Return an entry for each class: how many were perceived, if known, and how many came."""
    counts = Counter(life.row.class_name for life in record.lives)
    seen = Counter(life.row.class_name for life in record.lives if life.is_perceived)
    shares = {
        name: f"{seen[name]} of {count}" if record.is_perceiving else f"{count}"
        for name, count in sorted(counts.items())
    }
    return [Entry(f"{name}  {share}", patch_sign(colours[name])) for name, share in shares.items()]


def behaviour_entries(lives: Sequence[Life], marks: Mapping[str, str]) -> list[Entry]:
    """Return an entry for each behaviour with which artefacts came, the most frequent first."""
    counts = Counter(filter(None, map(behaviour_of, lives)))
    return [
        Entry(f"{name}  {count}", mark_sign(marks[name], BEHAVIOUR_PX, edge_px=1.5))
        for name, count in sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    ]


def _artefact_entries(record: SceneRecord, end_ns: int) -> list[Entry]:
    if not record.lives:
        return []
    entries = []
    if record.is_perceiving:
        entries.append(Entry("perceived", patch_sign(GREY)))
        entries.append(Entry("never perceived", patch_sign(GREY, UNSEEN_ALPHA)))
    if any(is_gone(life, end_ns) for life in record.lives):
        entries.append(Entry("left", patch_sign(GREY, GONE_ALPHA)))
    if any(len(life.footprints) > 1 for life in record.lives):
        entries.append(Entry("path", line_sign(GREY, PATH_PX)))
        if record.is_perceiving:
            entries.append(Entry("path while perceived", line_sign(GREY, SEEN_PATH_PX)))
    return entries


def _event_entries(record: SceneRecord) -> list[Entry]:
    """Return the marks that there are, with their counts."""
    kinds = (
        (contacts(record), CONTACT_MARK, "robot contact"),
        (forced(record), DISPLACED_MARK, "displaced"),
    )
    return [
        Entry(f"{text}  {len(events)}", mark_sign(*mark, 1.2))
        for events, mark, text in kinds
        if events
    ]


_NEAR: Final = SERIES[2]
_FAR: Final = SERIES[0]
_RIVALS: Final = (SERIES[5], CONTACT, SERIES[1])
_DOTS_PX: Final = (3.0, 3.0)


@dataclass(frozen=True, eq=False)
class PlacedScans:
    """Scans at a pose of the map: endpoints (N, 2), and where the laser was (M, 2) [m]."""

    endpoints_m: Floats
    places_m: Floats


def draw_alignment(
    grid: OccupancyGrid,
    placed: Sequence[PlacedScans],
    is_near: npt.NDArray[np.bool_],
    path: File,
    *,
    title: str,
    subtitle: str,
) -> None:
    """Write the map with scans at their best pose, and at those that fit as well, as PNG.

    The best is the first of `placed`, whose endpoints lie near a wall or not, (N,).
    The same input gives the same bytes. Raises OSError.
    """
    part = known_part(grid)
    rivals = [*zip(placed[1:], _RIVALS, strict=False)]
    places = [np.empty((0, 2)), *(scans.places_m for scans in placed)]
    window = window_of(grid, part, np.concatenate(places))
    sheet = Sheet.of(window, [_legend(placed, rivals)])
    canvas, view = sheet.canvas, sheet.view
    draw_map(canvas, view, grid, part)
    for scans, colour in reversed(rivals):
        _draw_dots(canvas, view, scans.endpoints_m, colour)
        for start, end in pairwise(view.pixels(scans.places_m)):
            canvas.dashes(start, end, colour, 1.3, pattern_px=_DOTS_PX)
    for scans in placed[:1]:
        _draw_dots(canvas, view, scans.endpoints_m[~is_near], _FAR)
        _draw_dots(canvas, view, scans.endpoints_m[is_near], _NEAR)
        points = view.pixels(scans.places_m)
        canvas.line(points, ROBOT, 2.0)
        canvas.mark("disc", points[0], 8.0, ROBOT, ROBOT)
    sheet.write(path, title, [subtitle])


def _draw_dots(canvas: Canvas, view: View, points_m: Floats, colour: Rgb) -> None:
    """Draw points (N, 2) as dots of a pixel and a half."""
    side, half = round(1.5 * canvas.fine), 0.75
    corners = np.rint((view.pixels(points_m) - half) * canvas.fine).astype(np.int64)
    height, width = canvas.pixels.shape[:2]
    for dx in range(side):
        for dy in range(side):
            x, y = np.add(corners, (dx, dy)).T
            inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
            canvas.pixels[y[inside], x[inside]] = colour


def _legend(
    placed: Sequence[PlacedScans], rivals: Sequence[tuple[PlacedScans, Rgb]]
) -> list[Entry]:
    def dot(text: str, colour: Rgb) -> Entry:
        return Entry(text, mark_sign("disc", 6.0, colour, colour))

    if not placed:
        return []
    return [
        dot(f"endpoint within {NEAR_M:g} m of a wall", _NEAR),
        dot("farther", _FAR),
        Entry("path of the laser", line_sign(ROBOT, 2.0)),
        *(dot("fits as well", colour) for _, colour in rivals),
    ]
