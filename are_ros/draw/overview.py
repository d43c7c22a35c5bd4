"""Pictures on a map: overview.png of a run, and align.png of laser scans at their places."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
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
    FOLLOWING_PATTERN_PX,
    GONE_ALPHA,
    PATH_PX,
    SEEN_PATH_PX,
    Look,
    Outline,
    Path,
    behaviour_counts,
    behaviour_entries,
    behaviour_of,
    contacts,
    displacements,
    draw_artefact,
    draw_following,
    draw_paths,
    following_stretches,
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
    END,
    GREY,
    ROBOT,
    SEEN,
    SERIES,
    Rgb,
    behaviour_marks,
    class_colours,
    time_colour,
)
from are_ros.draw.robot import (
    Fan,
    draw_ever_seen,
    draw_robot,
    draw_robot_path,
    draw_view,
    fan_at,
    other_fans,
    robot_outline,
    spread_indices,
    telling_indices,
    time_fractions,
    walls_of,
)
from are_ros.draw.scene import Life, SceneRecord
from are_ros.draw.sheet import (
    Entry,
    Label,
    Labels,
    Sheet,
    beside,
    contains,
    dark_pixels,
    dashed_sign,
    hatched_sign,
    id_text,
    is_free,
    line_sign,
    mark_sign,
    patch_sign,
    point_to_box,
)
from are_ros.wording import counted
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]

_SHOWN_FANS: Final = 3
_SWEPT_FANS: Final = 60
_FAN_ALPHA: Final = 0.11
_LABEL_PX: Final = 12
_MOST_LABELS: Final = 300
_PATH_POINTS: Final = 400
_TAG_PX: Final = (44.0, 21.0)
_TAG_TEXT_PX: Final = 13
_TAG_GAP_PX: Final = 4.0
_TAG_SIDES: Final = ((0, 1), (0, -1), (1, 0), (-1, 0))


@dataclass(frozen=True, eq=False)
class _Drawn:
    """An artefact where it ended, on the canvas."""

    life: Life
    outline: Outline
    is_gone: bool

    @property
    def box(self) -> Rectangle:
        return bounds_of(self.outline.corners_px)


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
    one), the robot's path, some of its fields of view as far as the octomap at the camera's height,
    or else the walls of the map, and taller artefacts let them reach, and each artefact where it
    ended, with the path that it went. `ids_as_in` names where a reader finds the ids again.
    """
    _Overview(record, grid, occupied_threshold, voxels).write(path, ids_as_in)


class _Overview:
    """The picture in its stages; each one draws upon those before."""

    def __init__(
        self,
        record: SceneRecord,
        grid: OccupancyGrid,
        occupied_threshold: int,
        voxels: VoxelMap | None,
    ) -> None:
        """Lay out the sheet, and draw the map."""
        part = known_part(grid)
        shown_cells = part if voxels is None else with_furniture(grid, part, voxels)
        self._record = record
        self._end_ns = int(record.series.stamps_ns[-1]) if len(record.series.stamps_ns) else 0
        self._standing = _in_drawing_order(record.lives, self._end_ns)
        moved = displacements(record.events)
        self._paths = [path_of(life, moved.get(life.artefact_id, ())) for life in self._standing]
        self._following = following_stretches(record.lives, self._end_ns)
        self._colours = class_colours([life.row.class_name for life in record.lives])
        self._marks = behaviour_marks([path.behaviour for path in self._paths])
        has_following = bool(self._following)
        legends = _legends(record, self._colours, self._marks, has_following=has_following)
        self._sheet = Sheet.of(window_of(grid, part, _extent_m(record, self._standing)), legends)
        self._canvas, self._view = self._sheet.canvas, self._sheet.view
        self._walls = walls_of(grid, occupied_threshold, voxels)
        draw_map(self._canvas, self._view, grid, shown_cells)

    def write(self, path: File, ids_as_in: str) -> None:
        """Draw everything else, from the ground up, and write the picture."""
        is_wall = dark_pixels(self._canvas.finished())
        shown = _draw_fields_of_view(self._sheet, self._record, self._walls)
        drawn = self._draw_artefacts()
        robots = _draw_robot(self._sheet, self._record, shown)
        marks = self._draw_events()
        _cover(is_wall, [*robots, *_avoided(self._record, self._view, self._paths), *marks])
        without_id = self._write_texts(drawn, Labels(is_wall, self._view.rectangle, _LABEL_PX))
        record = self._record
        duration_s = record.duration_ns / NS_PER_S if len(record.robot) else None
        subtitle = subtitle_of(record, without_id, ids_as_in)
        self._sheet.write(path, _title(record), subtitle, duration_s)

    def _draw_artefacts(self) -> list[_Drawn]:
        """Draw the paths, the links of followers to leaders, and each artefact at its end."""
        draw_paths(self._canvas, self._view, self._paths, self._colours, self._marks)
        draw_following(self._canvas, self._view, self._following, self._colours)
        drawn = []
        for life in self._standing:
            outline = outline_of(self._view, life.footprints.poses[-1], life.row.size_m)
            drawn.append(_Drawn(life, outline, is_gone(life, self._end_ns)))
            look = Look.OPAQUE if life.is_perceived else Look.HATCHED
            alpha = GONE_ALPHA if drawn[-1].is_gone else 1.0
            draw_artefact(self._canvas, outline, self._colours[life.row.class_name], look, alpha)
        return drawn

    def _draw_events(self) -> list[Rectangle]:
        """Mark displacements and contacts; return the rectangles of the marks."""
        found = []
        kinds = zip(mark_places(self._record), (DISPLACED_MARK, CONTACT_MARK), strict=True)
        for places, (name, size_px, face, edge) in kinds:
            for place in self._view.pixels(places):
                self._canvas.mark(name, place, size_px, face, edge, 1.2)
                found.append(_square(place, size_px))
        return found

    def _write_texts(self, drawn: Sequence[_Drawn], labels: Labels) -> int:
        """Write ids, "start" and "end"; return how many ids found no room."""
        tags = tag_rectangles(self._record, self._view, [item.box for item in drawn])
        leaders = {one.follower.artefact_id: one.leader.artefact_id for one in self._following}
        written = _draw_ids(self._sheet, labels, drawn, tags, leaders)
        for tag, text, colour in zip(tags, ("start", "end"), (ROBOT, END), strict=False):
            self._canvas.tag(text, tag, _TAG_TEXT_PX, colour)
        return len(drawn) - written


def tag_rectangles(record: SceneRecord, view: View, taken: Sequence[Rectangle]) -> list[Rectangle]:
    """Return where "start" and "end" are written [px]; no place without a pose of the robot.

    They are below the robot, or where they meet nothing of `taken`: above or beside it.
    """
    poses = record.robot.poses
    found: list[Rectangle] = []
    for pose in poses[[0, -1]] if len(poses) > 1 else poses:
        outline = view.pixels(robot_outline(record.footprint.at(*pose.tolist())))
        box = bounds_of(outline)
        around = (beside(box, _TAG_PX, _TAG_GAP_PX, side) for side in _TAG_SIDES)
        places = [place for place in around if place is not None]
        others = np.array([*taken, *found], dtype=np.float64).reshape(-1, 4)
        inside = (place for place in places if contains(view.rectangle, place))
        found.append(next((place for place in inside if is_free(place, others)), places[0]))
    return found


def _in_drawing_order(lives: Sequence[Life], end_ns: int) -> list[Life]:
    """Return the artefacts that have a pose; on top are those still there, and those perceived."""
    known = [life for life in lives if len(life.footprints)]
    return sorted(known, key=lambda life: (not is_gone(life, end_ns), life.is_perceived))


def _extent_m(record: SceneRecord, lives: Sequence[Life]) -> Floats:
    """Return the points (N, 2) that have to be in the picture."""
    ends = [life.footprints.poses[-1, :2] for life in lives]
    reach = [0.5 * max(life.row.size_m[:2]) for life in lives]
    corners = [end + d * r for end, r in zip(ends, reach, strict=True) for d in (-1.0, 1.0)]
    paths = [life.footprints.poses[:, :2] for life in lives]
    outline = np.array(corners, dtype=np.float64).reshape(-1, 2)
    return np.concatenate((record.robot.poses[:, :2], outline, *paths))


def _draw_fields_of_view(sheet: Sheet, record: SceneRecord, walls: VoxelField) -> list[Fan]:
    """Tint what was ever in view; draw a few fields of view, which are returned."""

    def fans(indices: Sequence[int]) -> list[Fan]:
        found = [fan for index in indices if (fan := fan_at(record, walls, index)) is not None]
        stamps = record.camera.stamps_ns[list(indices)].tolist()
        return found + [fan for stamp in stamps for fan in other_fans(record, walls, stamp)]

    draw_ever_seen(sheet.canvas, sheet.view, fans(spread_indices(record, _SWEPT_FANS)))
    shown = fans(telling_indices(record, _SHOWN_FANS))
    for fan in shown:
        colour = time_colour(float(time_fractions(record, fan.stamp_ns)))
        draw_view(sheet.canvas, sheet.view, fan, colour, _FAN_ALPHA)
    return shown


def _draw_robot(sheet: Sheet, record: SceneRecord, shown: Sequence[Fan]) -> list[Rectangle]:
    """Draw the path, and the robot at its ends and where fields of view begin; return its boxes."""
    track = record.robot
    if not len(track):
        return []
    fractions = time_fractions(record, track.stamps_ns)
    draw_robot_path(sheet.canvas, sheet.view, track, fractions)
    boxes = []
    for index in robot_indices(record, shown):
        colour = time_colour(float(fractions[index]))
        pose = track.poses[index]
        outline = draw_robot(sheet.canvas, sheet.view, record.footprint, pose, colour)
        boxes.append(bounds_of(outline))
    return boxes


def robot_indices(record: SceneRecord, shown: Sequence[Fan]) -> list[int]:
    """Return the poses where the robot is drawn: at its ends, and where fields of view begin."""
    stamps = record.robot.stamps_ns
    at_fans = np.searchsorted(stamps, [fan.stamp_ns for fan in shown]).tolist()
    return sorted({0, len(stamps) - 1, *at_fans} - {len(stamps)}) if len(stamps) else []


def _avoided(record: SceneRecord, view: View, paths: Sequence[Path]) -> Iterator[Rectangle]:
    """Yield what ids had better not cover: the robot's path, and where the others begin."""
    for point in view.pixels(record.robot.poses[:: max(1, len(record.robot) // _PATH_POINTS), :2]):
        yield _square(point, 7.0)
    for path in paths:
        yield _square(view.pixels(path.points_m[0]), BEHAVIOUR_PX)


def _square(middle_px: Floats, side_px: float) -> Rectangle:
    x, y = middle_px.tolist()
    half = 0.5 * side_px
    return x - half, y - half, x + half, y + half


def _cover(mask: npt.NDArray[np.bool_], places: Sequence[Rectangle]) -> None:
    """Set the pixels of rectangles in a mask (height, width)."""
    for place in places:
        left, top, right, bottom = (max(round(side), 0) for side in place)
        mask[top:bottom, left:right] = True


def _draw_ids(
    sheet: Sheet,
    labels: Labels,
    drawn: Sequence[_Drawn],
    taken: Sequence[Rectangle],
    leaders: Mapping[int, int],
) -> int:
    """Write ids beside the artefacts, and return how many found room: first the perceived.

    An id that is far from its artefact is joined to it by a line. `leaders` gives the artefact that
    a follower followed last.
    """
    order = sorted(drawn, key=lambda item: (not item.life.is_perceived, item.is_gone))
    ends = {item.life.artefact_id: item.outline.nose_px[0] for item in drawn}
    wanted = []
    for item in order[:_MOST_LABELS]:
        number, text = item.life.artefact_id, id_text(item.life.artefact_id)
        if number in leaders:
            text += f"\u2192{id_text(leaders[number])}"
        wanted.append(Label(number, item.box, (text,)))
    found = labels.place(wanted, [item.box for item in drawn], taken)
    for placed in found:
        point_to_box(sheet.canvas, placed, ends[placed.label.key])
    for placed in found:
        sheet.canvas.text(placed.text, placed.place[:2], _LABEL_PX)
    return len(found)


def _title(record: SceneRecord) -> str:
    arrived = record.metrics.arrivals if record.metrics else 0
    perceived = sum(life.is_perceived for life in record.lives)
    return f"{counted(arrived, 'virtual artefact')} arrived, {perceived} perceived"


def subtitle_of(record: SceneRecord, without_id: int, ids_as_in: str) -> list[str]:
    """Return what is said below the title; so many artefacts have no id, for want of room."""
    ids = f"numbers are ids, as in {ids_as_in}"
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
        ids if record.lives else "",
    ]


def _legends(
    record: SceneRecord,
    colours: Mapping[str, Rgb],
    marks: Mapping[str, str],
    *,
    has_following: bool,
) -> list[list[Entry]]:
    """Return the entries for classes, behaviours, and what else there is to see."""
    rest = [*_artefact_entries(record), *_event_entries(record)]
    if has_following:
        rest.append(Entry("following", dashed_sign(GREY, 1.8, FOLLOWING_PATTERN_PX)))
    if record.has_cameras:
        rest.append(Entry("field of view", patch_sign(SEEN, 0.42)))
        rest.append(Entry("in view at some time", patch_sign(SEEN, 0.17)))
    behaviours = behaviour_counts([behaviour_of(life) for life in record.lives])
    return [
        class_entries(record.lives, colours),
        behaviour_entries(behaviours, marks),
        rest,
    ]


def class_entries(lives: Sequence[Life], colours: Mapping[str, Rgb]) -> list[Entry]:
    """Return an entry for each class: how many were perceived, and how many there were."""
    counts = Counter(life.row.class_name for life in lives)
    seen = Counter(life.row.class_name for life in lives if life.is_perceived)
    return [
        Entry(f"{name}  {seen[name]} of {counts[name]}", patch_sign(colours[name]))
        for name in sorted(counts)
    ]


def _artefact_entries(record: SceneRecord) -> list[Entry]:
    if not record.lives:
        return []
    entries = [
        Entry("perceived", patch_sign(GREY)),
        Entry("never perceived", hatched_sign(GREY)),
    ]
    end_ns = int(record.series.stamps_ns[-1]) if len(record.series.stamps_ns) else 0
    if any(is_gone(life, end_ns) for life in record.lives):
        entries.append(Entry("left", patch_sign(GREY, GONE_ALPHA)))
    if any(len(life.footprints) > 1 for life in record.lives):
        entries.append(Entry("path", line_sign(GREY, PATH_PX)))
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
    near_m: float,
    title: str,
    subtitle: str,
) -> None:
    """Write the map with scans at their best pose, and at those that fit as well, as PNG.

    The best is the first of `placed`, whose endpoints lie near a wall or not, (N,), by `near_m`.
    The same input gives the same bytes. Raises OSError.
    """
    part = known_part(grid)
    rivals = [*zip(placed[1:], _RIVALS, strict=False)]
    window = window_of(grid, part, np.concatenate((np.empty((0, 2)), *_paths(placed))))
    sheet = Sheet.of(window, [_legend(placed, rivals, near_m)])
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


def _paths(placed: Sequence[PlacedScans]) -> list[Floats]:
    return [scans.places_m for scans in placed]


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
    placed: Sequence[PlacedScans], rivals: Sequence[tuple[PlacedScans, Rgb]], near_m: float
) -> list[Entry]:
    def dot(text: str, colour: Rgb) -> Entry:
        return Entry(text, mark_sign("disc", 6.0, colour, colour))

    if not placed:
        return []
    return [
        dot(f"endpoint within {near_m:g} m of a wall", _NEAR),
        dot("farther", _FAR),
        Entry("path of the laser", line_sign(ROBOT, 2.0)),
        *(dot("fits as well", colour) for _, colour in rivals),
    ]
