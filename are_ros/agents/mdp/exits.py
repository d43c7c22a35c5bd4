"""Exits: the points where artefacts leave the map after the end of their lives (section 3.2)."""

import math
from collections.abc import Sequence
from typing import Final, TypeVar

import numpy as np
import numpy.typing as npt

from are_ros.world.environment import Environment
from are_ros.world.occupancy_grid import distances_in_cells
from are_ros.world.regions import Zone, Zones, polygon_mask

PERSON_WIDTH_M: Final = 0.6
"""Narrower openings are not passable."""
_REACH_M: Final = 1.0
"""Distance of an exit point inside its opening."""
_APART_M: Final = 1.5
"""A wide opening has one exit point per this distance, so that many artefacts can leave at once."""
_LEADS_ON_M2: Final = 2.0
"""Least unknown area behind an opening; behind a gap in the map it is smaller."""

_Floats = npt.NDArray[np.float64]
_Cells = npt.NDArray[np.int64]
_Mask = npt.NDArray[np.bool_]
_Labels = npt.NDArray[np.int32]
_Points = TypeVar("_Points", npt.NDArray[np.float64], npt.NDArray[np.int64])


def exits_of(
    environment: Environment,
    region: npt.NDArray[np.bool_],
    zones: Zones,
    width_m: float = PERSON_WIDTH_M,
) -> npt.NDArray[np.float64]:
    """Return the exit points: float64 (E, 2), map frame; E may be 0.

    If `zones` has exits (else entrances), there is one point per zone: the nearest to its middle at
    which a disc of `width_m` is free, in `region` (bool, height x width) if possible, else on free
    cells. A zone without such a point is left out.

    Else the exits are the openings of the map: a disc of `width_m` can leave the region there into
    unknown space of at least 2 m^2, or over the border of the grid, without touching an occupied
    cell. The point is the one nearest to the middle of the opening, within 1 m, at which the disc
    is free; a wide opening has a point every metre or two.
    """
    # Distances are between cell centres; half of the occupied cell is in the way.
    room_m = 0.5 * (width_m + environment.grid.resolution_m)
    stands = environment.classes.free & (environment.clearance_m >= room_m)
    if zones.ways_out:
        return _middles(environment, stands, region, zones.ways_out)
    return _openings(environment, stands & region, region, room_m)


def _middles(
    environment: Environment, stands: _Mask, region: _Mask, ways_out: Sequence[Zone]
) -> _Floats:
    found = []
    for zone in ways_out:
        inside = stands & polygon_mask(zone.polygon_m, environment.grid)
        cells = np.argwhere(inside & region if (inside & region).any() else inside)
        if len(cells):
            points_m = environment.grid.cells_to_points(cells)
            found.append(_nearest_to(points_m, _centroid(zone.polygon_m)))
    return np.array(found).reshape(-1, 2)


def _openings(environment: Environment, stands: _Mask, region: _Mask, room_m: float) -> _Floats:
    """Return the exit points of each group of openings near the same place."""
    resolution_m = environment.grid.resolution_m
    frame = math.ceil((room_m + _REACH_M) / resolution_m)
    inner = (slice(frame, -frame), slice(frame, -frame))
    occupied = np.pad(environment.classes.occupied, frame)
    known = np.pad(environment.classes.free | environment.classes.occupied, frame)
    passable = distances_in_cells(~occupied) * resolution_m >= room_m
    beyond = _large_parts(passable & ~known, _LEADS_ON_M2 / environment.grid.cell_area_m2)
    opening = _dilated(beyond)[inner] & region
    if not opening.any():
        return np.empty((0, 2))
    near = _within_steps(opening, passable[inner] & region, round(_REACH_M / resolution_m))
    labels = _labels(near)
    places, apart = _by_label(labels, stands), _APART_M / resolution_m
    found = [
        place
        for label, parts in _by_label(labels, opening).items()
        if label in places
        for place in _spread(parts, places[label], apart)
    ]
    return environment.grid.cells_to_points(np.array(found).reshape(-1, 2))


def _spread(opening: _Cells, places: _Cells, apart: float) -> list[_Cells]:
    """Return the places nearest to the opening's middle, and to its far parts."""
    found: list[_Cells] = []
    part: _Cells = _nearest_to(opening, opening.mean(axis=0))
    distances = np.full(len(opening), np.inf)
    while distances.max() > apart:
        place = _nearest_to(places, part)
        if not any(np.array_equal(place, other) for other in found):
            found.append(place)
        distances = np.minimum(distances, np.hypot(*(opening - part).T))
        part = opening[int(np.argmax(distances))]
    return found


def _large_parts(mask: _Mask, least_cells: float) -> _Mask:
    """Return the mask without its connected parts of fewer cells."""
    parts, large = _labels(mask)[mask], np.zeros_like(mask)  # mostly few cells
    large[mask] = (np.bincount(parts) >= least_cells)[parts]
    return large


def _within_steps(start: _Mask, floor: _Mask, steps: int) -> _Mask:
    """Return the start, and the floor within a number of steps of it, also diagonal ones."""
    reached = start
    for _ in range(steps):
        reached = reached | (_dilated(reached) & floor)
    return reached


def _dilated(mask: _Mask) -> _Mask:
    import cv2

    grown: _Mask = cv2.dilate(mask.view(np.uint8), np.ones((3, 3), np.uint8)).view(np.bool_)
    return grown


def _labels(mask: _Mask) -> _Labels:
    """Return the 8-connected parts, numbered from 1; 0 outside."""
    import cv2

    labels: _Labels = cv2.connectedComponents(
        np.ascontiguousarray(mask).view(np.uint8), connectivity=8, ltype=cv2.CV_32S
    )[1]
    return labels


def _by_label(labels: _Labels, mask: _Mask) -> dict[int, _Cells]:
    """Return the cells (N, 2) of the mask under each label but 0, labels ascending."""
    cells = np.argwhere(mask & (labels > 0))
    numbers = labels[cells[:, 0], cells[:, 1]]
    order = np.argsort(numbers, kind="stable")
    present, starts = np.unique(numbers[order], return_index=True)
    return dict(zip(present.tolist(), np.split(cells[order], starts)[1:], strict=True))


def _nearest_to(points: _Points, place: _Floats | _Cells) -> _Points:
    """Return the one (2,) of the points (N, 2) that is nearest to a place, of equals the first."""
    nearest: _Points = points[int(np.argmin(np.hypot(*(points - place).T)))]
    return nearest


def _centroid(polygon_m: _Floats) -> _Floats:
    """Return the centre of area of a polygon (K, 2); of one without area the corners' mean."""
    middle = polygon_m.mean(axis=0)
    corners = polygon_m - middle
    following = np.roll(corners, -1, axis=0)
    crosses = corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]
    doubled = float(crosses.sum())
    if abs(doubled) < 1e-12:
        return np.asarray(middle)
    offset = ((corners + following) * crosses[:, None]).sum(axis=0) / (3.0 * doubled)
    return np.asarray(middle + offset)
