"""A run as a film: its picture at any instant, drawn over a map that was drawn once."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.events import ArtefactEvent, EventKind
from are_ros.conventions import NS_PER_S
from are_ros.draw.scene import SceneRecord
from are_ros.replay._film_actors import UNSEEN_SHARE, Actor, actors_at, draw_actors, rgb_of
from are_ros.replay._film_canvas import (
    INK,
    Picture,
    Rgb,
    Stage,
    dashed,
    fill,
    line,
    mixed,
    ring,
    write,
)
from are_ros.replay._film_labels import Labels, bounds_of
from are_ros.replay._film_legend import Entry, circle, dashes, draw_legend, patch, robot, way
from are_ros.replay._picture_artefacts import class_colours
from are_ros.replay._picture_company import companies
from are_ros.replay._picture_map import known_part, window_of
from are_ros.replay._picture_robot import SEEN_COLOUR, TIME_COLOURS, robot_outline
from are_ros.replay._picture_view import Sight, fan_at
from are_ros.world.occupancy_grid import OccupancyGrid

Floats = npt.NDArray[np.float64]

_LARGEST_PX: Final = (840, 620)
_FLASH_NS: Final = 6 * NS_PER_S // 5
_SOON_NS: Final = NS_PER_S
"""The first ticks come before the first transform: for so long the robot is shown all the same."""

_FLASHES: Final[dict[EventKind, Rgb]] = {
    EventKind.ROBOT_CONTACT: (230, 57, 70),
    EventKind.DISPLACED: (224, 160, 16),
    EventKind.ARRIVED: (120, 130, 140),
    EventKind.DEPARTED: (170, 178, 186),
}
_FLASH_NAMES: Final[dict[str, tuple[EventKind, ...]]] = {
    "comes or goes": (EventKind.ARRIVED, EventKind.DEPARTED),
    "robot contact": (EventKind.ROBOT_CONTACT,),
    "displaced": (EventKind.DISPLACED,),
}
_ROBOT: Final = rgb_of(TIME_COLOURS[1])
_PATH: Final = mixed(_ROBOT, 0.45)
_SEEN: Final = rgb_of(SEEN_COLOUR)
_GREY: Final = (108, 117, 125)
_FOLLOWING: Final[Rgb] = (90, 98, 106)
_TEXT_PX: Final = 13
_SMALLEST_ROBOT_M_PX: Final = 9.0


class FilmScene:
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
        self._sight = Sight(grid, part, occupied_threshold)
        ways = [life.footprints.poses[:, :2] for life in record.lives]
        window = window_of(grid, part, np.concatenate((record.robot.poses[:, :2], *ways)))
        self.stage = Stage.of(
            window, (round(scale * _LARGEST_PX[0]), round(scale * _LARGEST_PX[1]))
        )
        self._colours = class_colours([life.row.class_name for life in record.lives])
        self._companies = companies(record.lives, int(record.series.stamps_ns[-1]) + 1)
        self._ground: Picture = self.stage.background(grid, part)
        self._labels = Labels(self._ground)
        self._draw_legend(self._ground)

    def picture(self, stamp_ns: int) -> Picture:
        """Return the picture (h, w, 3), RGB, at the stamp of a tick."""
        picture: Picture = self._ground.copy()
        actors = actors_at(self._record.lives, stamp_ns, self.stage, self._colours)
        self._draw_fan(picture, stamp_ns)
        self._draw_path(picture, stamp_ns)
        self._draw_companies(picture, actors, stamp_ns)
        draw_actors(picture, actors)
        outline = self._draw_robot(picture, stamp_ns)
        self._draw_flashes(picture, stamp_ns)
        taken = [] if outline is None else [bounds_of(outline)]
        self._labels.draw(picture, actors, taken)
        self._draw_clock(picture, actors, stamp_ns)
        return picture

    def _draw_fan(self, picture: Picture, stamp_ns: int) -> None:
        stamps = self._record.camera.stamps_ns
        index = int(np.searchsorted(stamps, stamp_ns))
        if index == len(stamps) or int(stamps[index]) != stamp_ns:
            return
        fan = fan_at(self._record, self._sight, index)
        if fan is not None:
            outline = self.stage.pixels(fan.outline_m)
            fill(picture, outline, _SEEN, 0.2)
            line(picture, outline, mixed(_SEEN, 0.45), closed=True)

    def _draw_path(self, picture: Picture, stamp_ns: int) -> None:
        robot = self._record.robot
        count = int(np.searchsorted(robot.stamps_ns, stamp_ns, side="right"))
        drives = robot.drives()[:count]
        for drive in np.unique(drives).tolist():
            way_m = robot.poses[:count, :2][drives == drive]
            if len(way_m) > 1:
                line(picture, self.stage.pixels(way_m), _PATH, 2)

    def _draw_robot(self, picture: Picture, stamp_ns: int) -> Floats | None:
        """Draw the robot where it was last known, or is a moment later; return its outline [px]."""
        robot = self._record.robot
        index = int(np.searchsorted(robot.stamps_ns, stamp_ns, side="right")) - 1
        if index < 0 and not self._is_about_to_be_known(stamp_ns):
            return None
        index = max(index, 0)
        x_m, y_m, yaw_rad = robot.poses[index].tolist()
        outline_m = robot_outline(self._record.footprint.at(x_m, y_m, yaw_rad))
        outline_m = _at_least(outline_m, _SMALLEST_ROBOT_M_PX / self.stage.px_per_m)
        forward = np.array((np.cos(yaw_rad), np.sin(yaw_rad)))
        centre = np.array((x_m, y_m))
        nose = np.array((centre, centre + forward * ((outline_m - centre) @ forward).max()))
        outline = self.stage.pixels(outline_m)
        fill(picture, outline, (255, 255, 255), 0.85)
        line(picture, outline, _ROBOT, 2, closed=True)
        line(picture, self.stage.pixels(nose), _ROBOT, 2)
        return outline

    def _is_about_to_be_known(self, stamp_ns: int) -> bool:
        """Say whether the robot's first pose, of a moment later, may stand for it at a stamp."""
        stamps = self._record.robot.stamps_ns
        return len(stamps) > 0 and int(stamps[0]) - stamp_ns <= _SOON_NS

    def _draw_companies(self, picture: Picture, actors: Sequence[Actor], stamp_ns: int) -> None:
        """Join followers and leaders by a dashed line."""
        centre_of = {actor.life.artefact_id: actor.nose_px[0] for actor in actors}
        for one in self._companies:
            ids = (one.follower.artefact_id, one.leader.artefact_id)
            if one.start_ns <= stamp_ns < one.end_ns and all(i in centre_of for i in ids):
                dashed(picture, centre_of[ids[0]], centre_of[ids[1]], _FOLLOWING)

    def _draw_flashes(self, picture: Picture, stamp_ns: int) -> None:
        """Draw a growing ring where something happened a moment ago."""
        lives = {life.artefact_id: life for life in self._record.lives if len(life.footprints)}
        for event in self._record.events:
            age_ns = stamp_ns - event.stamp_ns
            if event.kind in _FLASHES and 0 <= age_ns < _FLASH_NS and event.artefact_id in lives:
                x_m, y_m, _ = lives[event.artefact_id].footprint_at(event.stamp_ns)
                self._draw_flash(picture, event, (x_m, y_m), age_ns / _FLASH_NS)

    def _draw_flash(
        self, picture: Picture, event: ArtefactEvent, place_m: tuple[float, float], age: float
    ) -> None:
        is_grave = event.kind in {EventKind.ROBOT_CONTACT, EventKind.DISPLACED}
        colour = mixed(_FLASHES[event.kind], 1.0 - 0.7 * age)
        centre = self.stage.pixels(place_m)
        ring(picture, centre, 8.0 + 14.0 * age, colour, 3 if is_grave else 1)

    def _draw_clock(self, picture: Picture, actors: Sequence[Actor], stamp_ns: int) -> None:
        """Write the time, and how many are there and perceived."""
        series = self._record.series
        passed_ns = series.passed_ns()[np.searchsorted(series.stamps_ns, stamp_ns)]
        passed_s = int(passed_ns) / NS_PER_S
        perceived = sum(actor.is_perceived for actor in actors)
        count = f"{len(actors)} virtual artefacts, {perceived} perceived"
        write(picture, f"{passed_s:5.1f} s", (12, 7), _TEXT_PX, INK)
        write(picture, count, (84, 7), _TEXT_PX, INK)

    def _draw_legend(self, picture: Picture) -> None:
        """Name what belongs to the robot, the colours of the classes, and what is opaque."""
        header = []
        if len(self._record.robot):
            header = [Entry("real robot", robot(_ROBOT)), Entry("its path", way(_PATH))]
        if len(self._record.camera):
            header.append(Entry("field of view", patch(_SEEN, 0.25)))
        names = sorted({life.row.class_name for life in self._record.lives})
        footer = [Entry(name, patch(rgb_of(self._colours[name]))) for name in names]
        if names:
            footer += [
                Entry("perceived", patch(_GREY)),
                Entry("not perceived", patch(_GREY, UNSEEN_SHARE)),
            ]
        draw_legend(picture, header, [*footer, *self._happenings()])

    def _happenings(self) -> list[Entry]:
        """Name the rings and lines of what happens, as far as it happens."""
        kinds = {event.kind for event in self._record.events}
        entries = [
            Entry(name, circle(_FLASHES[own[0]]))
            for name, own in _FLASH_NAMES.items()
            if kinds.intersection(own)
        ]
        return [*entries, *([Entry("follows", dashes(_FOLLOWING))] if self._companies else [])]


def _at_least(outline_m: Floats, smallest_m: float) -> Floats:
    """Return an outline, enlarged about its middle where it would be too small to be seen."""
    middle = outline_m.mean(axis=0)
    factor = max(1.0, smallest_m / float(np.ptp(outline_m, axis=0).max()))
    enlarged: Floats = middle + factor * (outline_m - middle)
    return enlarged
