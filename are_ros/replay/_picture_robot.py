"""The robot in the overview picture: where it drove, and what its camera could see."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.draw.scene import SceneRecord
from are_ros.replay._picture_map import Window
from are_ros.replay._picture_view import Fan
from are_ros.world.footprint import Footprint

Floats = npt.NDArray[np.float64]

TIME_COLOURS: Final = ("#7cc0e8", "#2f7fc1", "#0b2f6b")
SEEN_COLOUR: Final = "#4f9fd8"
_MOST_VERTICES: Final = 2000
_SMALLEST_ROBOT_PT: Final = 9.0
_MASK_PIXELS: Final = 900
_TAG_PT: Final = (26.0, 13.0)
_TAG_GAP_PT: Final = 2.5
_TAG_SIDES: Final = ((0, -1), (0, 1), (1, 0), (-1, 0))


def time_colours() -> Any:
    """Return the colour map of the time along the path, from 0 to 1."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("time", TIME_COLOURS)


def time_fraction(record: SceneRecord, stamps_ns: npt.ArrayLike) -> Floats:
    """Return the stamps as fractions of the record's duration, which has no gaps."""
    ticks_ns, passed_ns = record.series.stamps_ns, record.series.passed_ns()
    since_ns = np.asarray(stamps_ns, dtype=np.int64) - ticks_ns[0]
    fractions: Floats = np.interp(since_ns, ticks_ns - ticks_ns[0], passed_ns) / max(
        record.duration_ns, NS_PER_S // 1000
    )
    return fractions


def draw_fans(
    axes: Any, record: SceneRecord, swept: Sequence[Fan], shown: Sequence[Fan], window: Window
) -> None:
    """Tint what was ever in view, and outline a few fields of view in the colour of their time."""
    from matplotlib.patches import Polygon

    if swept:
        _tint(axes, swept, window)
    colours = time_colours()
    for fan in shown:
        colour = colours(float(time_fraction(record, fan.stamp_ns)))
        axes.add_patch(Polygon(fan.outline_m, facecolor=colour, alpha=0.10, lw=0, zorder=1.2))
        axes.add_patch(
            Polygon(fan.outline_m, fill=False, edgecolor=colour, alpha=0.25, lw=0.6, zorder=1.3)
        )


def draw_path(
    axes: Any, record: SceneRecord, shown: Sequence[Fan], points_per_m: float, tags: Floats
) -> None:
    """Draw the path in the colours of time, with the robot at its ends and where fans begin.

    `tags` are the rectangles (2, 4) where "start" and "end" have room.
    """
    from matplotlib.collections import LineCollection

    poses, stamps = record.robot.poses, record.robot.stamps_ns
    if not len(poses):
        return
    some = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), _MOST_VERTICES)).astype(int))
    points, fractions = poses[some, :2], time_fraction(record, stamps[some])
    drives = record.robot.drives()[some]
    for drive in np.unique(drives).tolist():
        way = points[drives == drive].T
        axes.plot(*way, color="white", lw=4.2, zorder=5.0, solid_capstyle="round")
    is_driven = np.diff(drives) == 0
    pieces = np.stack((points[:-1], points[1:]), axis=1)[is_driven]
    line = LineCollection([*pieces], cmap=time_colours(), zorder=5.1, lw=2.2, capstyle="round")
    line.set_array(fractions[1:][is_driven])
    line.set_clim(0.0, 1.0)
    axes.add_collection(line, autolim=False)
    for index in _shown_poses(record, shown):
        _draw_robot(axes, record, index, points_per_m)
    middles = 0.5 * (tags[:, :2] + tags[:, 2:])
    _mark(axes, middles[0], "start", TIME_COLOURS[1])
    if len(poses) > 1:
        _mark(axes, middles[-1], "end", TIME_COLOURS[-1])


def robot_places(record: SceneRecord, shown: Sequence[Fan]) -> Floats:
    """Return the middles (N, 2) of the robot where it is drawn on its path."""
    return record.robot.poses[_shown_poses(record, shown), :2].reshape(-1, 2)


def tag_rectangles(
    record: SceneRecord, points_per_m: float, window: Window, taken: Floats
) -> Floats:
    """Return what "start" and "end" cover: left, bottom, right, top (N, 4) [m].

    They are below the robot, or where they meet nothing of `taken` (N, 4) [m]: above or beside it.
    """
    found = np.empty((0, 4))
    for pose in record.robot.poses[[0, -1]] if len(record.robot) else ():
        outline = robot_outline(record.footprint.at(*pose.tolist()))
        places = _tags_around(outline, points_per_m)
        others = np.concatenate((taken, found))
        free = [place for place in places if window.holds(place) and not _meets(place, others)]
        found = np.vstack((found, (free or places)[0]))
    return found


def _tags_around(outline_m: Floats, points_per_m: float) -> list[Floats]:
    """Return the rectangles (4,) [m] of a tag about a robot's outline (N, 2), the best first."""
    low_m, high_m = outline_m.min(axis=0), outline_m.max(axis=0)
    half_m = 0.5 * np.array(_TAG_PT) / points_per_m
    reach_m = 0.5 * (high_m - low_m) + half_m + _TAG_GAP_PT / points_per_m
    middles = [0.5 * (low_m + high_m) + np.array(side) * reach_m for side in _TAG_SIDES]
    return [np.concatenate((middle - half_m, middle + half_m)) for middle in middles]


def _meets(place: Floats, taken: Floats) -> bool:
    apart = (place[:2] >= taken[:, 2:]).any(axis=1) | (place[2:] <= taken[:, :2]).any(axis=1)
    return not apart.all()


def _shown_poses(record: SceneRecord, shown: Sequence[Fan]) -> list[int]:
    """Return the indices of the robot's poses that are drawn: its ends, and where fans begin."""
    stamps = record.robot.stamps_ns
    at_fans = np.searchsorted(stamps, [fan.stamp_ns for fan in shown]).tolist()
    return sorted({0, len(stamps) - 1, *at_fans} - {len(stamps)}) if len(stamps) else []


def _tint(axes: Any, fans: Sequence[Fan], window: Window) -> None:
    """Tint the union of the fans, evenly however many overlap."""
    import cv2

    scale = _MASK_PIXELS / max(window.width_m, window.height_m)
    shape = (max(1, round(window.height_m * scale)), max(1, round(window.width_m * scale)))
    mask = np.zeros(shape, dtype=np.uint8)
    for fan in fans:
        outline = (fan.outline_m - (window.left, window.bottom)) * scale
        corners = np.rint(np.clip(outline, -1e4, 1e4) * 16).astype(np.int32)
        cv2.fillPoly(mask, [corners], 1, shift=4)
    image = np.zeros((*shape, 4), dtype=np.uint8)
    image[mask > 0] = (*(int(SEEN_COLOUR[i : i + 2], 16) for i in (1, 3, 5)), 34)
    extent = (window.left, window.right, window.bottom, window.top)
    axes.imshow(image, origin="lower", extent=extent, zorder=1.0, aspect="auto")


def _draw_robot(axes: Any, record: SceneRecord, index: int, points_per_m: float) -> None:
    """Draw the robot's outline at one pose, with a line to its front; as a dot if too small."""
    from matplotlib.patches import Polygon

    x_m, y_m, yaw_rad = record.robot.poses[index].tolist()
    fraction = time_fraction(record, record.robot.stamps_ns[index])
    colour = time_colours()(float(fraction))
    outline = robot_outline(record.footprint.at(x_m, y_m, yaw_rad))
    if np.ptp(outline, axis=0).max() * points_per_m < _SMALLEST_ROBOT_PT:
        look = {"ms": _SMALLEST_ROBOT_PT - 2.0, "markeredgecolor": colour, "markeredgewidth": 1.5}
        axes.plot(x_m, y_m, "o", markerfacecolor="white", zorder=5.2, **look)
        return
    axes.add_patch(Polygon(outline, facecolor="white", alpha=0.75, lw=0, zorder=5.2))
    axes.add_patch(Polygon(outline, fill=False, edgecolor=colour, lw=1.5, zorder=5.3))
    forward = np.array((np.cos(yaw_rad), np.sin(yaw_rad)))
    reach_m = float(((outline - (x_m, y_m)) @ forward).max())
    nose = np.array((x_m, y_m)) + np.outer((0.0, 1.0), forward * reach_m)
    axes.plot(*nose.T, color=colour, lw=1.5, zorder=5.3)


def robot_outline(footprint: Footprint) -> Floats:
    """Return the corners of a rounded polygon: those of discs at its vertices, hull taken."""
    import cv2

    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    circle = footprint.radius_m * np.column_stack((np.cos(angles), np.sin(angles)))
    points = (footprint.vertices_m[:, np.newaxis] + circle).reshape(-1, 2).astype(np.float32)
    hull: Floats = cv2.convexHull(points)[:, 0].astype(np.float64)
    return hull


def _mark(axes: Any, middle_m: Floats, text: str, colour: str) -> None:
    axes.text(
        *middle_m,
        text,
        ha="center",
        va="center",
        fontsize=7.5,
        color="white",
        zorder=8,
        bbox={"boxstyle": "round,pad=0.25", "facecolor": colour, "edgecolor": "white", "lw": 0.6},
    )
