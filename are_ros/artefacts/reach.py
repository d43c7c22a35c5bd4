"""Where one type can get to from where it is: the places that a way leads to, on its coarse map."""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.coarse_map import Cell, CoarseMap
from are_ros.artefacts.places import FEWEST, Destinations

APART_M: Final = 1.6
"""Places that are added keep so far from all others: a trip is a metre at least, from half a metre
beside one place."""

_Points = npt.NDArray[np.float64]
_Mask = npt.NDArray[np.bool_]
_Key = tuple[tuple[int, float, float, float], int, float]


class Reach:
    """The places of one map, sorted by which of them a disc can get to; found when first asked."""

    def __init__(self, places: Destinations) -> None:
        self._places = places
        self._known: dict[_Key, Destinations] = {}

    def places_from(
        self, coarse: CoarseMap, point_m: tuple[float, float], spare_m: float = 0.0
    ) -> Destinations:
        """Return the places that can be reached from a point of the map frame.

        A place has `spare_m` of room beside the disc of the coarse map. Destinations are those that
        ways lead to, each once, or the nearest point to it where the disc fits. Where they are less
        than `FEWEST`, others are spread over what can be reached, at least `APART_M` apart, as far
        as there is room. Exits are those of the map. Who is shut in is told all places, to none of
        which a way leads.
        """
        cell = coarse.cell_of(*point_m)
        if cell is None:
            return self._places
        key = (coarse.key, int(coarse.components[cell]), spare_m)
        if key not in self._known:
            part = (coarse.components == key[1]) & (coarse.room_m >= spare_m)
            self._known[key] = self._of_part(coarse, part, spare_m)
        return self._known[key]

    def _of_part(self, coarse: CoarseMap, part: _Mask, spare_m: float) -> Destinations:
        points_m = _held(coarse, part, spare_m, self._places.destinations_m)
        if len(points_m) < FEWEST:
            points_m = _with_others(coarse.anchors_m[part], coarse.room_m[part], points_m)
        if not len(points_m):
            return self._places
        return Destinations(points_m, self._places.exits_m)


def _held(coarse: CoarseMap, part: _Mask, spare_m: float, points_m: _Points) -> _Points:
    """Return where a disc ends on its way to points (K, 2): (N, 2), those in a part (h, w)."""
    held: dict[Cell, tuple[float, float]] = {}
    for x_m, y_m in points_m.tolist():
        cell = coarse.cell_of(x_m, y_m)
        if cell is not None and part[cell] and cell not in held:
            fits = coarse.holds(x_m, y_m, coarse.radius_m + spare_m)
            held[cell] = (x_m, y_m) if fits else coarse.anchor_of(cell)
    return np.array(list(held.values()), np.float64).reshape(-1, 2)


def _with_others(anchors_m: _Points, room_m: npt.NDArray[np.float32], points_m: _Points) -> _Points:
    """Return the points (K, 2), and anchors (N, 2) of a part: each the farthest from all before.

    The first is the one with most room, if there is none before. Where one point in the middle of
    a small part keeps all others out, the part's ends take its place.
    """
    if not len(anchors_m):
        return points_m
    if not len(points_m):
        points_m = anchors_m[int(room_m.argmax())][None]
    found_m = _filled_up(anchors_m, points_m)
    if len(found_m) < 2:
        end_m = anchors_m[int(_nearest_m(anchors_m, found_m).argmax())]
        found_m = _filled_up(anchors_m, end_m[None])
    return found_m if len(found_m) > 1 else np.empty((0, 2))


def _filled_up(anchors_m: _Points, points_m: _Points) -> _Points:
    """Return at least one point (K, 2), and up to `FEWEST` with anchors (N, 2) well apart."""
    while len(points_m) < FEWEST:
        nearest_m = _nearest_m(anchors_m, points_m)
        farthest = int(nearest_m.argmax())
        if nearest_m[farthest] < APART_M:
            break
        points_m = np.vstack((points_m, anchors_m[farthest]))
    return points_m


def _nearest_m(anchors_m: _Points, points_m: _Points) -> npt.NDArray[np.float64]:
    """Return how far anchors (N, 2) are from the nearest of the points (K, 2): (N,)."""
    offsets_m = anchors_m[:, None] - points_m
    nearest_m: npt.NDArray[np.float64] = np.hypot(offsets_m[..., 0], offsets_m[..., 1]).min(axis=1)
    return nearest_m
