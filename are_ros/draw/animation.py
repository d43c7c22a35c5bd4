"""animation.gif: a run from above, with the robot, its field of view and moving artefacts."""

import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import EventKind
from are_ros.conventions import NS_PER_S
from are_ros.draw.artefacts import (
    Outline,
    draw_artefact,
    following_stretches,
    outline_of,
)
from are_ros.draw.canvas import Canvas, Image, Rectangle, bounds_of
from are_ros.draw.map import View, draw_map, known_part, window_of
from are_ros.draw.palette import (
    CONTACT,
    FOLLOWING,
    GREY,
    INK,
    PAPER,
    ROBOT,
    SEEN,
    WHITE,
    Rgb,
    behaviour_colours,
    class_colours,
    mixed,
)
from are_ros.draw.robot import draw_robot, draw_view, fan_at, other_fans, walls_of
from are_ros.draw.scene import Life, LivesById, SceneRecord
from are_ros.draw.sheet import (
    Entry,
    Label,
    Labels,
    dashed_sign,
    draw_row,
    id_text,
    line_sign,
    patch_sign,
    ring_sign,
    robot_sign,
    row_width_px,
    rows_of,
)
from are_ros.errors import BagError
from are_ros.whole_file import write_whole
from are_ros.wording import counted, why_refused
from are_ros.world.occupancy_grid import OccupancyGrid

Floats = npt.NDArray[np.float64]
Progress = Callable[[int], object]
OpenProgress = Callable[[int, int], Progress]

HEADER_PX, ROW_PX = 30, 26
_FPS: Final = 10
_SPEED: Final = 3
_MOST_PICTURES: Final = 600
_SAMPLES: Final = 16
_COLOURS: Final = 255
_RARE_WEIGHT: Final = 0.35
"""Counts are raised to this power: a small red footprint matters as much as a white floor."""
_SCALES: Final = (1.0, 0.75, 0.55, 0.4)
_MOST_BYTES: Final = 10_000_000
_LARGEST_PX: Final = (840, 620)
_NARROWEST_PX: Final = 360
_MARGIN_PX: Final = 12
_CLOCK_PX: Final = 350
"""What the time and the counts take of the header."""
_TEXT_PX, _LABEL_PX = 13, 11
_MOST_TOLD: Final = 16
"""Of more artefacts than these only the perceived have words beside their ids."""
_TAIL_NS: Final = 4 * NS_PER_S
_JUMP_M: Final = 0.5
_FLASH_NS: Final = 6 * NS_PER_S // 5
_SOON_NS: Final = NS_PER_S
"""The first ticks come before the first transform: for so long the robot is shown all the same."""
_PATH_COLOUR: Final = mixed(ROBOT, 0.45)
_COMING_AND_GOING: Final[Rgb] = (120, 130, 140)
_FLASHES: Final[Mapping[EventKind, tuple[str, Rgb]]] = {
    EventKind.ARRIVED: ("comes or goes", _COMING_AND_GOING),
    EventKind.DEPARTED: ("comes or goes", (170, 178, 186)),
    EventKind.ROBOT_CONTACT: ("robot contact", CONTACT),
    EventKind.DISPLACED: ("displaced", (224, 160, 16)),
}
_ARTEFACT: Final = re.compile(r"artefact (\d+)")
_NEWS_NS: Final = 7 * NS_PER_S
_WAITS: Final = "waiting for "
_LONG_WAIT_NS: Final = 3 * NS_PER_S
_TAG_PAD_PX: Final = (3.0, 2.0)


@dataclass(frozen=True)
class Animation:
    """What was written: so many pictures, so many times as fast as it was, and the size."""

    path: Path
    pictures: int
    speed: float
    size_px: tuple[int, int]
    length_bytes: int

    def sentence(self) -> str:
        """Say it."""
        return (
            f"animation: {self.path} ({self.length_bytes / 1e6:.1f} MB, {self.pictures} pictures "
            f"of {self.size_px[0]}x{self.size_px[1]}, {self.speed:g} times real time)"
        )


def write_animation(
    record: SceneRecord,
    grid: OccupancyGrid,
    path: Path,
    open_progress: OpenProgress,
    *,
    occupied_threshold: int,
    most_bytes: int = _MOST_BYTES,
) -> Animation:
    """Write an animated GIF of a run over its map; return what it is.

    Ten pictures a second, at three times real time, or faster where that would be more than 600
    pictures; smaller where the file would be larger than `most_bytes`. The same input gives the
    same bytes. Raises BagError for a record without ticks, or where the system refuses to write.
    """
    if not len(record.series.stamps_ns):
        raise BagError(f"{path}: there is no tick to animate")
    stamps, speed = shown_stamps(record)
    for scale in _SCALES:
        frames = Frames(record, grid, occupied_threshold, scale)
        content = _gif(frames, stamps, open_progress(stamps[0], stamps[-1] + 1))
        if len(content) <= most_bytes:
            break
    try:
        write_whole(path, content)
    except OSError as cause:
        message = f"{path}: the animation cannot be written ({why_refused(cause)})"
        raise BagError(message) from cause
    return Animation(path, len(stamps), speed, frames.size_px, len(content))


def shown_stamps(record: SceneRecord) -> tuple[list[int], float]:
    """Return the stamps of the ticks that are shown, and how much faster than it was."""
    ticks = record.series.stamps_ns
    shown_ns = record.duration_ns
    speed = max(_SPEED, -(-shown_ns * _FPS // ((_MOST_PICTURES - 1) * NS_PER_S)))
    step_ns = speed * NS_PER_S // _FPS
    wanted = np.arange(0, shown_ns + 1, step_ns, dtype=np.int64)
    at = np.searchsorted(record.series.passed_ns(), wanted, side="right") - 1
    return ticks[at].tolist(), float(speed)


def _gif(frames: "Frames", stamps: Sequence[int], progress: Progress) -> bytes:
    """Return the GIF of the frames at the stamps; it repeats for ever."""
    from PIL import Image as Pil

    samples = np.unique(np.linspace(0, len(stamps) - 1, _SAMPLES).astype(np.int64))
    palette = _palette([frames.picture(stamps[i]) for i in samples.tolist()])
    frames.forget()

    def pictures() -> Iterator[Any]:
        for stamp_ns in stamps:
            picture = Pil.fromarray(frames.picture(stamp_ns))
            yield picture.quantize(palette=palette, dither=Pil.Dither.NONE)
            progress(stamp_ns)

    rest, file = pictures(), io.BytesIO()
    next(rest).save(
        file,
        "GIF",
        save_all=True,
        append_images=rest,
        duration=1000 // _FPS,
        loop=0,
        disposal=1,
        optimize=True,  # pixels that do not change are transparent: a third of the size
    )
    progress(stamps[-1] + 1)
    return file.getvalue()


def _palette(pictures: Sequence[Image]) -> Any:
    """Return a Pillow image whose palette has up to 255 colours of the pictures."""
    from PIL import Image as Pil

    keys = np.stack(pictures) @ np.array((1 << 16, 1 << 8, 1), dtype=np.int32)
    keys, counts = np.unique(keys, return_counts=True)
    colours = np.stack((keys >> 16, (keys >> 8) & 255, keys & 255), axis=1).astype(np.uint8)
    pixels = np.repeat(colours, np.ceil(counts**_RARE_WEIGHT).astype(np.int64), axis=0)
    image = Pil.fromarray(np.ascontiguousarray(pixels[np.newaxis]))
    return image.quantize(_COLOURS, method=Pil.Quantize.MEDIANCUT, kmeans=1)


@dataclass(frozen=True, eq=False)
class _Actor:
    """An artefact at an instant, on the canvas; `texts` are its label, the longest first."""

    number: int
    outline: Outline
    tail_px: tuple[Floats, ...]
    colour: Rgb
    is_perceived: bool
    texts: tuple[str, str]
    news: "_News | None"


class _News(NamedTuple):
    """What a tag tells for some seconds: that a behaviour changed, or that a long wait began."""

    text: str
    colour: Rgb


class Frames:
    """Draws a run at its instants, in their order: labels remember where they were."""

    def __init__(
        self,
        record: SceneRecord,
        grid: OccupancyGrid,
        occupied_threshold: int,
        scale: float = 1.0,
    ) -> None:
        """Lay out a picture of at most 840 x 620 pixels times `scale`, and draw the map."""
        part = known_part(grid)
        self._record = record
        self._walls = walls_of(grid, occupied_threshold)
        paths = [life.footprints.poses[:, :2] for life in record.lives]
        window = window_of(grid, part, np.concatenate((record.robot.poses[:, :2], *paths)))
        largest = (scale * _LARGEST_PX[0], scale * _LARGEST_PX[1])
        px_per_m = min(largest[0] / window.width_m, largest[1] / window.height_m)
        self.view = View(window, px_per_m, 0.0, HEADER_PX)
        self._colours = class_colours([life.row.class_name for life in record.lives])
        self._lives = LivesById(record.lives)
        self._tag_colours = behaviour_colours(
            [doing.behaviour for life in record.lives for doing in life.doings]
        )
        self._following = following_stretches(record.lives, int(record.series.stamps_ns[-1]) + 1)
        self.footer_px = ROW_PX * max(len(_rows_below(self.legend()[1], self._width_px)), 1)
        """How high the rows of the legend below the map are."""
        width, height = self.size_px
        self._ground = Canvas((width, height))
        self._ground.pixels[HEADER_PX : height - self.footer_px] = PAPER
        draw_map(self._ground, self.view, grid, part)
        self._ground.pixels[height - self.footer_px :] = WHITE
        self.forget()
        draw_legend(self._ground, *self.legend())

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the pictures."""
        return self._width_px, round(self.view.size_px[1]) + HEADER_PX + self.footer_px

    @property
    def _width_px(self) -> int:
        return max(round(self.view.size_px[0]), _NARROWEST_PX)

    def forget(self) -> None:
        """Begin anew: labels may be anywhere."""
        width, height = self.size_px
        inside = (0.0, HEADER_PX, float(width), float(height - self.footer_px))
        self._labels = Labels(inside, _LABEL_PX)
        self._tags = Labels(inside, _LABEL_PX + 1)

    def picture(self, stamp_ns: int) -> Image:
        """Return the picture (h, w, 3), RGB, at the stamp of a tick."""
        canvas = self._ground.copy()
        actors = [
            self._actor(life, stamp_ns)
            for life in self._record.lives
            if life.is_present_at(stamp_ns) and len(life.footprints)
        ]
        self._draw_field_of_view(canvas, stamp_ns)
        self._draw_robot_path(canvas, stamp_ns)
        for actor in actors:
            _draw_tail(canvas, actor)
        for actor in sorted(actors, key=lambda actor: actor.is_perceived):
            draw_artefact(canvas, actor.outline, actor.colour, is_opaque=actor.is_perceived)
        self._draw_following(canvas, actors, stamp_ns)
        taken = self._draw_robot(canvas, stamp_ns)
        self._draw_flashes(canvas, stamp_ns)
        self._draw_texts(canvas, actors, taken)
        self._draw_clock(canvas, actors, stamp_ns)
        return canvas.pixels

    def _actor(self, life: Life, stamp_ns: int) -> _Actor:
        doing, number = life.doing_at(stamp_ns), id_text(life.artefact_id)
        words = doing.activity or doing.behaviour
        words = _ARTEFACT.sub(lambda found: id_text(int(found[1])), words)
        return _Actor(
            life.artefact_id,
            outline_of(self.view, life.footprint_at(stamp_ns), life.row.size_m),
            tuple(self.view.pixels(piece) for piece in _tail(life, stamp_ns)),
            self._colours[life.row.class_name],
            life.is_perceived_at(stamp_ns),
            (f"{number} {words}".strip(), number),
            self._news(life, stamp_ns),
        )

    def _news(self, life: Life, stamp_ns: int) -> _News | None:
        """Return the last change of behaviour or beginning of a long wait, if it was of late."""
        number, doings = id_text(life.artefact_id), life.doings
        begun = [i for i, doing in enumerate(doings) if doing.since_ns <= stamp_ns]
        for i in reversed(begun):
            doing, before = doings[i], doings[max(i - 1, 0)]
            if stamp_ns - doing.since_ns >= _NEWS_NS:
                return None
            if i == begun[-1] and _is_long_wait(life, i):
                named = partial(self._named, doing.since_ns)
                return _News(f"{number} {_ARTEFACT.sub(named, doing.activity)}", INK)
            if doing.behaviour != before.behaviour:
                text = f"{number} {before.behaviour} \N{RIGHTWARDS ARROW} {doing.behaviour}"
                return _News(text, mixed(self._tag_colours[doing.behaviour], 0.85, INK))
        return None

    def _named(self, since_ns: int, found: re.Match[str]) -> str:
        """Return the class and the id of an artefact that an activity names, which began then."""
        number = int(found[1])
        life = self._lives.at(number, since_ns)
        return f"{'artefact' if life is None else life.row.class_name} {id_text(number)}"

    def _draw_field_of_view(self, canvas: Canvas, stamp_ns: int) -> None:
        stamps = self._record.camera.stamps_ns
        index, fans = int(np.searchsorted(stamps, stamp_ns)), list[Floats | None]()
        if index < len(stamps) and int(stamps[index]) == stamp_ns:
            fans.append(fan_at(self._record, self._walls, index))
        for fan in (*fans, *other_fans(self._record, self._walls, stamp_ns)):
            if fan is not None:
                draw_view(canvas, self.view, fan)

    def _draw_robot_path(self, canvas: Canvas, stamp_ns: int) -> None:
        track = self._record.robot
        count = int(np.searchsorted(track.stamps_ns, stamp_ns, side="right"))
        drives = track.drives()[:count]
        for drive in np.unique(drives).tolist():
            driven_m = track.poses[:count, :2][drives == drive]
            if len(driven_m) > 1:
                canvas.line(self.view.pixels(driven_m), _PATH_COLOUR, 2.0)

    def _draw_robot(self, canvas: Canvas, stamp_ns: int) -> list[Rectangle]:
        """Draw the robot where it was last known, or is a moment later; return its rectangle."""
        track = self._record.robot
        index = int(np.searchsorted(track.stamps_ns, stamp_ns, side="right")) - 1
        is_soon = len(track) > 0 and int(track.stamps_ns[0]) - stamp_ns <= _SOON_NS
        if index < 0 and not is_soon:
            return []
        pose = track.poses[max(index, 0)]
        outline = draw_robot(canvas, self.view, self._record.footprint, pose, ROBOT)
        return [bounds_of(outline)]

    def _draw_following(self, canvas: Canvas, actors: Sequence[_Actor], stamp_ns: int) -> None:
        """Join followers and leaders by a dashed line."""
        centres = {actor.number: actor.outline.nose_px[0] for actor in actors}
        for one in self._following:
            ids = (one.follower.artefact_id, one.leader.artefact_id)
            if one.start_ns <= stamp_ns < one.end_ns and all(i in centres for i in ids):
                start, end = (centres[i] for i in ids)
                canvas.dashes(start, end, FOLLOWING)

    def _draw_flashes(self, canvas: Canvas, stamp_ns: int) -> None:
        """Draw a growing ring where something happened a moment ago."""
        for event in self._record.events:
            age = (stamp_ns - event.stamp_ns) / _FLASH_NS
            if event.kind not in _FLASHES or not 0.0 <= age < 1.0:
                continue
            if life := self._lives.at(event.artefact_id, event.stamp_ns):
                x_m, y_m, _ = life.footprint_at(event.stamp_ns)
                is_grave = event.kind in {EventKind.ROBOT_CONTACT, EventKind.DISPLACED}
                colour = mixed(_FLASHES[event.kind][1], 1.0 - 0.7 * age)
                centre = self.view.pixels((x_m, y_m))
                canvas.ring(centre, 8.0 + 14.0 * age, colour, 3.0 if is_grave else 1.0)

    def _draw_texts(
        self, canvas: Canvas, actors: Sequence[_Actor], taken: Sequence[Rectangle]
    ) -> None:
        """Write a tag or a label for each artefact: its id, and what it does or what is new."""
        boxes = {actor.number: bounds_of(actor.outline.corners_px) for actor in actors}
        by_number = {actor.number: actor for actor in actors}
        news = [Label(a.number, boxes[a.number], (a.news.text,)) for a in actors if a.news]
        taken = [*boxes.values(), *taken]
        tags = self._tags.place(news, taken)
        tagged = {placed.label.key for placed in tags}
        labels = [one for one in _labels_of(actors, boxes) if one.key not in tagged]
        taken += (_padded(placed.place) for placed in tags)
        for placed in self._labels.place(labels, taken):
            actor = by_number[placed.label.key]
            colour = INK if actor.is_perceived else mixed(INK, 0.62)
            canvas.text(placed.text, placed.place[:2], _LABEL_PX, colour)
        for placed in tags:
            actor = by_number[placed.label.key]
            if actor.news is not None:
                left, top, right, bottom = placed.place
                middle = (0.5 * (left + right), 0.5 * (top + bottom))
                ends = np.array((middle, actor.outline.nose_px[0]))
                canvas.line(ends, actor.news.colour, 1.5)
                canvas.tag(placed.text, _padded(placed.place), _LABEL_PX + 1, actor.news.colour)

    def _draw_clock(self, canvas: Canvas, actors: Sequence[_Actor], stamp_ns: int) -> None:
        """Write the time, and how many artefacts are there and perceived."""
        series = self._record.series
        passed_ns = series.passed_ns()[np.searchsorted(series.stamps_ns, stamp_ns)]
        perceived = sum(actor.is_perceived for actor in actors)
        count = counted(len(actors), "virtual artefact")
        if self._record.is_perceiving:
            count += f", {perceived} perceived"
        canvas.text(f"{int(passed_ns) / NS_PER_S:5.1f} s", (_MARGIN_PX, 7), _TEXT_PX)
        canvas.text(count, (84, 7), _TEXT_PX)

    def legend(self) -> tuple[list[Entry], list[Entry]]:
        """Return what is named in the header, which is the robot's, and in the footer."""
        header = []
        if len(self._record.robot):
            header = [
                Entry("real robot", robot_sign(ROBOT)),
                Entry("its path", line_sign(_PATH_COLOUR, 2.0)),
            ]
        if self._record.has_cameras:
            header.append(Entry("field of view", patch_sign(SEEN, 0.25)))
        names = sorted({life.row.class_name for life in self._record.lives})
        footer = [Entry(name, patch_sign(self._colours[name])) for name in names]
        if names and self._record.is_perceiving:
            footer.append(Entry("perceived", patch_sign(GREY)))
            footer.append(Entry("not perceived", patch_sign(GREY, 0.34)))
        happened = {event.kind for event in self._record.events}
        rings: dict[str, Rgb] = {}
        for kind, (name, colour) in _FLASHES.items():
            if kind in happened:
                rings.setdefault(name, colour)
        footer += [Entry(name, ring_sign(colour, 1.0)) for name, colour in rings.items()]
        if self._following:
            footer.append(Entry("follows", dashed_sign(FOLLOWING, 1.0)))
        return header, footer


def draw_legend(canvas: Canvas, header: Sequence[Entry], footer: Sequence[Entry]) -> None:
    """Draw the header's entries, at its right and as many as fit, and the rows of the footer."""
    width, height = canvas.size_px
    count = len(header)
    while count and row_width_px(header[:count], _TEXT_PX) > width - _CLOCK_PX - _MARGIN_PX:
        count -= 1
    left = width - row_width_px(header[:count], _TEXT_PX) - _MARGIN_PX
    draw_row(canvas, header[:count], (left, 0.5 * HEADER_PX), _TEXT_PX)
    rows = _rows_below(footer, width)
    for number, row in enumerate(rows):
        y_px = height - ROW_PX * (len(rows) - number - 0.5)
        draw_row(canvas, row, (_MARGIN_PX, y_px), _TEXT_PX)


def _rows_below(footer: Sequence[Entry], width_px: int) -> list[list[Entry]]:
    """Return the rows of the footer, in a picture of a width."""
    return rows_of(footer, width_px - 2 * _MARGIN_PX, _TEXT_PX)


def _is_long_wait(life: Life, index: int) -> bool:
    """Tell whether an artefact waited, and for long, during the doing of an index."""
    doing, after = life.doings[index], life.doings[index + 1 : index + 2]
    end_ns = after[0].since_ns if after else life.departure_ns
    is_long = end_ns is None or end_ns - doing.since_ns >= _LONG_WAIT_NS
    return is_long and doing.activity.startswith(_WAITS)


def _labels_of(actors: Sequence[_Actor], boxes: Mapping[int, Rectangle]) -> list[Label]:
    """Return the labels; the perceived artefacts come first, and of many only they have words."""
    is_few = len(actors) <= _MOST_TOLD
    return [
        Label(
            actor.number,
            boxes[actor.number],
            actor.texts if actor.is_perceived or is_few else actor.texts[1:],
        )
        for actor in sorted(actors, key=lambda actor: not actor.is_perceived)
    ]


def _padded(place: Rectangle) -> Rectangle:
    """Return a rectangle with the edge of a tag around it."""
    (across, down), (left, top, right, bottom) = _TAG_PAD_PX, place
    return left - across, top - down, right + across, bottom + down


def _tail(life: Life, stamp_ns: int) -> list[Floats]:
    """Return where an artefact went of late, as pieces (N, 2) [m] between jumps, oldest first."""
    stamps, poses = life.footprints.stamps_ns, life.footprints.poses
    first = max(int(np.searchsorted(stamps, stamp_ns - _TAIL_NS)) - 1, 0)
    points = poses[first : int(np.searchsorted(stamps, stamp_ns, side="right")), :2]
    if len(points) < 2:
        return []
    jumps = np.flatnonzero(np.linalg.norm(np.diff(points, axis=0), axis=1) > _JUMP_M)
    return [piece for piece in np.split(points, jumps + 1) if len(piece) > 1]


def _draw_tail(canvas: Canvas, actor: _Actor) -> None:
    count = sum(len(piece) - 1 for piece in actor.tail_px)
    strongest, done = 0.75 if actor.is_perceived else 0.45, 0
    for piece in actor.tail_px:
        steps = np.arange(done + 1, done + len(piece))
        alphas = strongest * (0.15 + 0.85 * steps / count)
        canvas.fading(piece, actor.colour, np.full(len(alphas), 2.0), alphas)
        done += len(alphas)
