"""The window around the views: the displays, titles and the time, as rviz lays them out."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.bag import marker_decoding as kinds
from are_ros.conventions import NS_PER_S
from are_ros.replay.rviz_canvas import Rgb
from are_ros.replay.rviz_scene import PlacedMarker, RvizScene
from are_ros.replay.rviz_views import GRID_LINE, OUTLINE, scan_colour
from are_ros.replay.rviz_voxels import HIGHEST_M, LOWEST_M
from are_ros.wording import counted

Picture = npt.NDArray[np.uint8]

WIDTH_PX, HEIGHT_PX = 1680, 940
_DPI: Final = 100
_FRAME: Final = "#efefef"
_EDGE: Final = "#b9b9b9"
_INK: Final = "#26282b"
_FAINT: Final = "#74777c"
_WARN: Final = "#b5541c"
_LINE_PX: Final = 21
_MOST_ROWS: Final = 34
_STATUS_LINES: Final = 2
_STATUS_LETTERS: Final = 185
"""Of a line of the status beside the time, at its size; widest letters may take half as much more,
and none is cut off at the edge then."""
_STATUS_PX: Final = 15
_TOPIC_LETTERS: Final = 130
"""Of the topics beside the title; the list of displays has all of them."""


class Place(NamedTuple):
    """A rectangle of the window in pixels, from its upper left corner."""

    left: int
    top: int
    width: int
    height: int

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.width, self.height


DISPLAYS: Final = Place(8, 40, 284, 856)
MAIN: Final = Place(300, 66, 928, 830)
TOP_DOWN: Final = Place(1236, 66, 436, 398)
COSTMAP: Final = Place(1236, 498, 436, 398)


@dataclass(frozen=True)
class Row:
    """A line of the list of displays."""

    text: str
    value: str = ""
    colour: Rgb | None = None
    is_head: bool = False


class Window:
    """A window to be filled with pictures and words."""

    def __init__(self) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        size = (WIDTH_PX / _DPI, HEIGHT_PX / _DPI)
        self._figure: Any = Figure(figsize=size, dpi=_DPI, facecolor=_FRAME)
        FigureCanvasAgg(self._figure)

    def picture(self, place: Place, picture: Picture, title: str) -> None:
        """Put a picture (h, w, 3) to a place, with its title above."""
        below = HEIGHT_PX - place.top - place.height
        self._figure.figimage(picture, xo=place.left, yo=below, origin="upper", zorder=2)
        self.box(place, "none")
        self.words(place.left + 2, place.top - 9, title, size=8.5)

    def box(self, place: Place, colour: str) -> None:
        """Draw a rectangle with an edge."""
        from matplotlib.patches import Rectangle

        corner = (place.left, HEIGHT_PX - place.top - place.height)
        patch = Rectangle(corner, *place.size, facecolor=colour, edgecolor=_EDGE, lw=0.8, zorder=3)
        patch.set_transform(None)
        self._figure.patches.append(patch)

    def swatch(self, left: int, middle: int, colour: Rgb) -> None:
        """Draw a small square of a colour."""
        from matplotlib.patches import Rectangle

        corner = (left, HEIGHT_PX - middle - 5)
        patch = Rectangle(corner, 10, 10, facecolor=colour, edgecolor=_FAINT, lw=0.6, zorder=4)
        patch.set_transform(None)
        self._figure.patches.append(patch)

    def words(self, left: int, middle: int, text: str, **looks: Any) -> None:
        """Write words, centred about a height."""
        looks = {"size": 8.0, "color": _INK, "va": "center_baseline", "zorder": 5, **looks}
        looks["parse_math"] = False
        self._figure.text(left / WIDTH_PX, 1.0 - middle / HEIGHT_PX, text, **looks)

    def save(self, path: Path) -> None:
        """Write a PNG; the same content gives the same bytes."""
        self._figure.savefig(path, format="png", dpi=_DPI, metadata={"Software": None})


def draw_frame(window: Window, scene: RvizScene, name: str) -> None:
    """Write title, list of displays and time."""
    title = f"What rviz would show of the recording '{name}'"
    window.words(10, 20, title, size=11.5, weight="bold")
    window.words(WIDTH_PX - 10, 20, _counts_text(scene), size=9.0, ha="right", color=_FAINT)
    window.box(DISPLAYS, "white")
    window.words(DISPLAYS.left + 10, DISPLAYS.top + 14, "Displays", weight="bold", size=8.5)
    rows = [*display_rows(scene)][:_MOST_ROWS]
    for number, row in enumerate(rows):
        _draw_row(window, row, DISPLAYS.top + 40 + number * _LINE_PX)
    _draw_legend(window, scene)
    window.words(10, HEIGHT_PX - 21, _time_text(scene), size=9.0)
    colour = _WARN if scene.complaints else _FAINT
    lines = status_lines(scene.complaints)
    for number, line in enumerate(lines):
        middle = HEIGHT_PX - 21 + round(_STATUS_PX * (number - 0.5 * (len(lines) - 1)))
        window.words(WIDTH_PX - 10, middle, line, ha="right", color=colour)


def status_lines(complaints: Sequence[str]) -> list[str]:
    """Return the lines of the status: as many complaints as there is room for, and how many more.

    Only one that alone is too long for all the room is shortened.
    """
    if not complaints:
        return ["Status: OK"]
    for count in range(len(complaints), 0, -1):
        more = f"; and {len(complaints) - count} more" if count < len(complaints) else ""
        lines = wrap("; ".join(complaints[:count]) + more, _STATUS_LETTERS)
        if len(lines) <= _STATUS_LINES:
            return lines
    end = f" ...{more}"
    room = _STATUS_LETTERS - len(end)
    return [lines[0], f"{lines[1][:room].rstrip()}{end}"]


def _draw_legend(window: Window, scene: RvizScene) -> None:
    """Say at the foot of the list what rviz's looks mean here."""
    lines = []
    if scene.markers:
        lines += ["opaque: perceived; translucent: not", "arrow: heading, longer if faster"]
    if any(_is_id(marker) for marker in scene.markers):
        lines.append("number: the id, where labels are close")
    if len(scene.scans) > 1:
        lines.append("red points: beams that ARE changed")
    if scene.voxels is not None:
        lines.append(f"octomap: from {LOWEST_M:g} to {HIGHEST_M:g} m above the floor")
    top = DISPLAYS.top + DISPLAYS.height - 14 - _LINE_PX * (len(lines) - 1)
    for number, line in enumerate(lines):
        window.words(DISPLAYS.left + 12, top + number * _LINE_PX, line, color=_FAINT)


def _is_id(marker: PlacedMarker) -> bool:
    """Tell whether a marker is a text with nothing but a number."""
    return marker.fields.kind == kinds.TEXT and marker.fields.text.isdigit()


def _draw_row(window: Window, row: Row, middle: int) -> None:
    left = DISPLAYS.left + (12 if row.is_head else 28)
    if row.colour is not None:
        window.swatch(left, middle, row.colour)
        left += 17
    window.words(left, middle, row.text, weight="bold" if row.is_head else "normal")
    if row.value:
        right = DISPLAYS.left + DISPLAYS.width - 10
        window.words(right, middle, row.value, ha="right", color=_FAINT)


def display_rows(scene: RvizScene) -> Iterator[Row]:
    """Yield the displays with their topics: what the picture is made of."""
    yield Row("Global Options", is_head=True)
    yield Row("Fixed frame", scene.fixed_frame)
    yield Row("Grid", "1 m", GRID_LINE, is_head=True)
    for text, topic, grid in (
        ("Map", scene.topics.grid, scene.grid),
        ("Map, as costmap", scene.topics.costmap, scene.costmap),
    ):
        if topic and grid:
            yield Row(text, f"{grid[0].width} x {grid[0].height} cells", is_head=True)
            yield Row(topic)
    if scene.voxels is not None:
        yield Row("PointCloud2", counted(scene.voxels.occupied_count, "box"), is_head=True)
        yield Row(scene.topics.cloud or "")
    for topic, points in scene.scans:
        yield Row("LaserScan", counted(len(points), "point"), scan_colour(topic), is_head=True)
        yield Row(topic)
    for topic in scene.topics.markers:
        yield Row("MarkerArray", counted(len(scene.markers), "marker"), is_head=True)
        yield Row(topic)
    for namespace, count in sorted(_namespaces(scene).items()):
        yield Row(f"  {namespace}", str(count))
    if scene.outline_m is not None and scene.robot is not None:
        yield Row("Polygon, the robot's outline", "", OUTLINE, is_head=True)
    if scene.axes:
        yield Row("TF", counted(len(scene.axes), "frame"), is_head=True)


def _namespaces(scene: RvizScene) -> Counter[str]:
    return Counter(marker.fields.namespace for marker in scene.markers)


def _counts_text(scene: RvizScene) -> str:
    topics = (scene.topics.grid, scene.topics.costmap, *scene.topics.markers)
    shown = [topic for topic in (*topics, *(topic for topic, _ in scene.scans)) if topic]
    while sum(map(len, shown)) > _TOPIC_LETTERS:
        shown = [*shown[:-2], "..."]
    return f"{counted(len(scene.markers), 'marker')}   ·   {'   '.join(shown)}"


def _time_text(scene: RvizScene) -> str:
    seconds, rest = divmod(scene.now_ns, NS_PER_S)
    return f"ROS Time: {seconds}.{rest // 1_000_000:03d}      Elapsed: {scene.elapsed_s:.2f} s"
