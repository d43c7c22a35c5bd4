"""align.png: the map with the scans of a recording where `are align` puts them."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from are_ros.replay._picture_frame import Sheet, draw_map, draw_surroundings
from are_ros.replay._picture_map import known_part, window_of
from are_ros.world.scan_matching import NEAR_M, Match, ScanCloud

if TYPE_CHECKING:
    from are_ros.replay.align import AlignOutcome

_NEAR: Final = "#2b8a3e"
_FAR: Final = "#e8590c"
_WAY: Final = "#1864ab"
_RIVALS: Final = ("#862e9c", "#c2255c", "#0b7285")
_DOT_PT: Final = 1.1
_MOST_DOTS: Final = 20_000


def draw_alignment(outcome: "AlignOutcome", path: Path) -> None:
    """Write the picture as PNG; the same outcome gives the same bytes.

    Endpoints on walls and beside them at the best pose, the way of the laser, and the scans at
    poses that fit as well. Settings of matplotlib in force change nothing.
    """
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update({"font.family": "DejaVu Sans"})
        _figure(outcome).savefig(path, format="png", metadata={"Software": None})


def _figure(outcome: "AlignOutcome") -> Any:
    found, grid = outcome.alignment, outcome.grid
    cloud = _fewer(outcome.cloud)
    places = np.array([scan.place[:2] for scan in outcome.given.scans])
    places = places[np.unique(outcome.cloud.scans)]
    part = known_part(grid)
    matches: list[Match] = []
    if found is not None:
        matches = [found.best, *found.equals]
    shown = [match.pose.apply(places) for match in matches]
    window = window_of(grid, part, np.concatenate((np.empty((0, 2)), *shown)))
    handles = _legend(matches)
    sheet = Sheet.of(window, [handles])
    draw_map(sheet, grid, part)
    for match, colour in reversed(list(zip(matches[1:], _RIVALS, strict=False))):
        points = match.pose.apply(cloud.endpoints_m)
        _dots(sheet, points, colour, 2)
        sheet.axes.plot(*match.pose.apply(places).T, color=colour, lw=0.8, ls=":", zorder=3)
    if matches:
        best = matches[0].pose
        points, is_near = best.apply(cloud.endpoints_m), outcome.near(cloud)
        _dots(sheet, points[~is_near], _FAR, 4)
        _dots(sheet, points[is_near], _NEAR, 5)
        way = best.apply(places)
        sheet.axes.plot(*way.T, color=_WAY, lw=1.2, zorder=6)
        sheet.axes.plot(*way[0], color=_WAY, marker="o", ms=5, zorder=7)
    draw_surroundings(sheet, _title(outcome), _subtitle(outcome), [handles])
    return sheet.figure


def _fewer(cloud: ScanCloud) -> ScanCloud:
    return cloud.part(np.arange(0, len(cloud), -(-len(cloud) // _MOST_DOTS)))


def _dots(sheet: Sheet, points: Any, colour: str, zorder: int) -> None:
    sheet.axes.plot(*points.T, ls="none", marker=".", ms=_DOT_PT, color=colour, zorder=zorder)


def _legend(matches: list[Match]) -> list[Any]:
    from matplotlib.lines import Line2D

    def dot(colour: str, text: str) -> Any:
        return Line2D([], [], ls="none", marker="o", ms=4, color=colour, label=text)

    if not matches:
        return []
    handles = [
        dot(_NEAR, f"endpoint within {NEAR_M:g} m of a wall"),
        dot(_FAR, "farther"),
        Line2D([], [], color=_WAY, lw=1.2, marker="o", ms=4, label="way of the laser"),
    ]
    rivals = zip(matches[1:], _RIVALS, strict=False)
    return handles + [dot(colour, "fits as well") for _, colour in rivals]


def _title(outcome: "AlignOutcome") -> str:
    names = f"{outcome.map_frame} to {outcome.given.root}"
    found = outcome.alignment
    if found is None or found.best.is_poor:
        return f"no fit of {names}"
    return f"ambiguous: {names}" if found.is_ambiguous else f"{names}, found by scans"


def _subtitle(outcome: "AlignOutcome") -> str:
    if outcome.alignment is None:
        return "the scans fit nowhere on the map"
    best = outcome.alignment.best
    return f"{outcome.line(best)}   ·   {best.near:.0%} of endpoints within {NEAR_M:g} m of a wall"
