"""Ids in the overview picture, written beside the artefacts where they cover nothing."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.scenario import FIRST_ADMITTED_ID
from are_ros.replay._picture_artefacts import Drawn, bounding_boxes
from are_ros.replay._picture_map import Window

Floats = npt.NDArray[np.float64]

_LABEL_PT: Final = 7.0
_MOST_LABELS: Final = 300
_SIDES: Final = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))
_GAPS: Final = (0.25, 0.9)
"""How far a label may be from its artefact, in heights of a letter."""
_CLEAR_GAP: Final = 0.6
"""A label that is farther away is joined to its artefact by a line."""


def draw_labels(
    axes: Any,
    drawn: Sequence[Drawn],
    leaders: Mapping[int, int],
    window: Window,
    points_per_m: float,
    taken: Floats,
    avoided: Floats,
) -> int:
    """Write ids beside the artefacts, and return how many found room: first the perceived.

    `leaders` has the id of whom a follower followed last. No label covers another one, an artefact,
    or a rectangle (left, bottom, right, top) of `taken` (N, 4) [m]; those of `avoided` (N, 4) only
    where there is no other room.
    """
    from matplotlib.patheffects import withStroke

    look = {"fontsize": _LABEL_PT, "color": "#3b4148", "ha": "center", "va": "center"}
    halo = [withStroke(linewidth=1.6, foreground="#ffffffc0")]
    height_m = _LABEL_PT / points_per_m
    boxes = bounding_boxes(drawn)
    hard = np.concatenate((taken, boxes))
    order = sorted(drawn, key=lambda item: (not item.life.is_perceived, item.is_gone))
    count = 0
    for item in order[:_MOST_LABELS]:
        text = _label(item.life.artefact_id, leaders)
        size_m = (0.66 * height_m * len(text), height_m)
        spots = [*_spots(item, size_m, window, height_m)]
        spot = _first_free(spots, size_m, np.concatenate((hard, avoided)))
        spot = _first_free(spots, size_m, hard) if spot is None else spot
        if spot is None:
            continue
        count += 1
        hard = np.vstack((hard, (*spot, spot[0] + size_m[0], spot[1] + size_m[1])))
        if _is_unclear(item, np.concatenate((spot, spot + size_m)), boxes, _CLEAR_GAP * height_m):
            _draw_leader(axes, item, spot, size_m)
        x_m, y_m = spot[0] + 0.5 * size_m[0], spot[1] + 0.5 * size_m[1]
        axes.text(x_m, y_m, text, zorder=7, path_effects=halo, **look)
    return count


def _is_unclear(item: Drawn, label: Floats, boxes: Floats, most_m: float) -> bool:
    """Tell whether a label (4,) is far from its artefact, or another of `boxes` (N, 4) nearer."""
    gap_m = float(_gaps_m(label, bounding_boxes([item]))[0])
    return gap_m > min(most_m, float(_gaps_m(label, boxes).min()) + 1e-9)


def _draw_leader(axes: Any, item: Drawn, low_m: Floats, size_m: tuple[float, float]) -> None:
    """Join a label to its artefact by a thin line."""
    ends = np.array((np.clip(item.centre_m, low_m, low_m + size_m), item.centre_m))
    axes.plot(*ends.T, color="#3b4148", lw=0.6, zorder=6.9)


def _gaps_m(label: Floats, boxes: Floats) -> Floats:
    """Return how far a rectangle (4,) is from others (N, 4), 0 where they meet."""
    across = np.maximum(boxes[:, :2] - label[2:], label[:2] - boxes[:, 2:])
    gaps: Floats = np.hypot(*np.maximum(across, 0.0).T)
    return gaps


def squares(points_m: Floats, side_m: float) -> Floats:
    """Return the squares (left, bottom, right, top) (N, 4) about points (N, 2)."""
    return np.hstack((points_m - 0.5 * side_m, points_m + 0.5 * side_m))


def id_text(artefact_id: int) -> str:
    """Return an id as short as it can be: requested ones count from s0, not from a billion."""
    requested = artefact_id - FIRST_ADMITTED_ID
    return str(artefact_id) if requested < 0 else f"s{requested}"


def _label(artefact_id: int, leaders: Mapping[int, int]) -> str:
    text = id_text(artefact_id)
    return f"{text}\u2192{id_text(leaders[artefact_id])}" if artefact_id in leaders else text


def _spots(
    item: Drawn, size_m: tuple[float, float], window: Window, height_m: float
) -> Iterator[Floats]:
    """Yield the low corners of places for a label beside an artefact, the best first."""
    half = 0.5 * np.array(size_m)
    for gap in _GAPS:
        reach = 0.5 * np.ptp(item.corners_m, axis=0) + half + gap * height_m
        for side in _SIDES:
            low: Floats = item.centre_m + np.array(side) * reach - half
            high = low + size_m
            inside = low[0] > window.left and low[1] > window.bottom
            if inside and high[0] < window.right and high[1] < window.top:
                yield low


def _first_free(
    spots: Sequence[Floats], size_m: tuple[float, float], taken: Floats
) -> Floats | None:
    """Return the first low corner where a label meets nothing of `taken` (N, 4), None if all do."""
    for low in spots:
        apart = (low >= taken[:, 2:]).any(axis=1) | (low + size_m <= taken[:, :2]).any(axis=1)
        if apart.all():
            return low
    return None
