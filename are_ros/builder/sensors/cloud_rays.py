"""The rays of a point cloud that had no return, from those that had one.

A cloud says where its rays have ended, and not where the others went. In an organised cloud each
point has its row and column: the directions of the returns tell those of all. In an unorganised one
rays that did not come back are missing, and leave gaps in its rows; a row is what one beam of a
turning laser measures, else a stripe of directions as wide as neighbouring points are apart. Rows
that are numbered count if they are circles about one axis. Rays fill these gaps as densely as the
row is otherwise. Where nothing comes back over more than ten degrees on all rows, the sensor is
supposed not to look.
"""

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.world.rigid_transform import product

_Floats = npt.NDArray[np.float64]
_Indices = npt.NDArray[np.int64]

_NO_RAYS: Final = np.empty(0, np.int64), np.empty((0, 3))
_TURN: Final = 2.0 * np.pi


def _wrapped(angles: _Floats) -> _Floats:
    """Return angles in [-pi, pi)."""
    wrapped: _Floats = (angles + np.pi) % _TURN - np.pi
    return wrapped


# Organised clouds.


_MOST_OFF: Final = 0.25
"""The directions of returns may be off their row and column by so many steps, in the median."""

_ROUNDS: Final = 4
"""Of fitting columns to rows, and rows to columns; what is missing differs from row to row."""

_CAMERAS: Final = (2, 0, 1), (0, 1, 2)
"""Of a camera that looks along z, and of one that looks along x: the axes ahead and across."""

_SAMPLE: Final = 2_000
"""So many returns tell which lattice the rays of a camera are, and how dense directions are."""

_FEWEST: Final = 16
"""With fewer returns nothing is known of the others."""


def rays_of_holes(
    shape: tuple[int, int], returns: _Indices, directions: _Floats
) -> tuple[_Indices, _Floats]:
    """Return the points (K,) of an organised cloud without a return, and their rays (K, 3).

    `returns` (N,) are the points with one, row by row, `directions` (N, 3) their unit vectors. Rays
    are those of a camera that looks along z or x, or of a laser that turns about z, whichever fits;
    there are none if none does, or if too few came back.
    """
    if not _FEWEST <= len(returns) < shape[0] * shape[1]:
        return _NO_RAYS
    is_hole = np.ones(shape[0] * shape[1], np.bool_)
    is_hole[returns] = False
    holes = np.flatnonzero(is_hole)
    for axes in _CAMERAS:
        rays = _rays_of_camera(shape, returns, directions, holes, axes)
        if rays is not None:
            return holes, rays
    rays = _rays_of_laser(shape, returns, directions, holes)
    return _NO_RAYS if rays is None else (holes, rays)


def _rays_of_camera(
    shape: tuple[int, int],
    returns: _Indices,
    directions: _Floats,
    holes: _Indices,
    axes: tuple[int, int, int],
) -> _Floats | None:
    """Return the rays of the holes, which meet a plane ahead in a lattice; None if they do not."""
    ahead, *across = axes
    if directions[:, ahead].min() <= 0.0:
        return None
    some = slice(None, None, max(1, len(returns) // _SAMPLE))
    at, slopes = _rows_and_columns(shape, returns[some]), directions[some]
    slopes = slopes[:, across] / slopes[:, [ahead]]
    lattice, *_ = np.linalg.lstsq(at, slopes, rcond=None)
    steps = np.abs(lattice[1:]).max(axis=0)
    off = np.median(np.abs(slopes - product(at, lattice)), axis=0)
    if not (off < _MOST_OFF * steps).all():
        return None
    rays = np.ones((len(holes), 3))
    rays[:, across] = product(_rows_and_columns(shape, holes), lattice)
    unit: _Floats = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return unit


def _rows_and_columns(shape: tuple[int, int], points: _Indices) -> _Floats:
    """Return 1, row and column (N, 3) of points (N,)."""
    rows, columns = np.divmod(points, shape[1])
    return np.stack((np.ones(len(points)), rows, columns), axis=1)


def _rays_of_laser(
    shape: tuple[int, int], returns: _Indices, directions: _Floats, holes: _Indices
) -> _Floats | None:
    """Return the rays of the holes of a turning laser; None if it is none.

    Its rows are rings, or its columns.
    """
    grids = np.full((2, *shape), np.nan)
    grids.reshape(2, -1)[:, returns] = _laser_angles(directions).T
    for is_turned in (False, True):
        azimuths, elevations = grids.swapaxes(1, 2) if is_turned else grids
        around, around_off = _by_column(azimuths, _ROUNDS)
        up, up_off = _by_column(elevations.T, 1) if around_off < _MOST_OFF else (around, np.inf)
        if up_off < _MOST_OFF:
            around, up = (around.T, up) if is_turned else (around, up.T)
            return _laser_directions(around.ravel()[holes], up.ravel()[holes])
    return None


def _laser_angles(rays: _Floats) -> _Floats:
    return np.stack(
        (np.arctan2(rays[:, 1], rays[:, 0]), np.arcsin(np.clip(rays[:, 2], -1.0, 1.0))), axis=1
    )


def _laser_directions(azimuths: _Floats, elevations: _Floats) -> _Floats:
    flat = np.cos(elevations)
    x, y = flat * np.cos(azimuths), flat * np.sin(azimuths)
    return np.stack((x, y, np.sin(elevations)), axis=1)


def _by_column(grid: _Floats, rounds: int) -> tuple[_Floats, float]:
    """Return one angle per column plus a shift per row (H, W), for angles with NaN where unknown.

    Beams of a laser may be staggered: then rows are shifted. In the first of the `rounds` they are
    not. Also returned: by how many steps between columns the angles are off, in the median.
    """
    is_known = ~np.isnan(grid)
    has_any, has_row = is_known.any(axis=0), is_known.any(axis=1)
    if np.count_nonzero(has_any) < 2:
        return grid, np.inf
    shifts, places, rests = np.zeros(len(grid)), np.flatnonzero(has_any), np.zeros_like(grid)
    for number in range(rounds):
        if number:
            shifts[has_row] += np.nanmedian(rests[has_row], axis=1)
        turned = np.exp(1j * np.where(is_known, grid - shifts[:, None], 0.0))
        known = np.angle(np.where(is_known, turned, 0.0).sum(axis=0)[has_any])
        columns = _filled(np.unwrap(known), places, grid.shape[1])
        rests = _wrapped(grid - shifts[:, None] - columns)
    step, off = np.median(np.abs(np.diff(columns))), np.median(np.abs(rests[is_known]))
    return columns + shifts[:, None], float(off / step) if step > 0.0 else np.inf


def _filled(values: _Floats, places: _Indices, count: int) -> _Floats:
    """Return values (count,) of which some (K,) are known, K > 1: straight between and beyond."""
    slope = (values[-1] - values[0]) / (places[-1] - places[0])
    every = np.arange(count)
    beyond = np.minimum(every - places[0], 0) + np.maximum(every - places[-1], 0)
    filled: _Floats = np.interp(every, places, values) + slope * beyond
    return filled


# Unorganised clouds.


_WIDE_GAP, _WIDE_GAP_OF_STRIPE = 1.5, 4.0
"""In a gap of more than so many steps between neighbours a ray is missing; in a stripe, whose
points are at random, some gaps are wide by chance."""
_NEAREST: Final = 16
"""So many neighbours tell how dense directions are, in a lattice as well as at random."""
_OF_OWN_RING: Final = 0.5
"""Of this share of the returns the nearest one is on their own ring."""
WIDEST_GAP_RAD: Final = math.radians(10.0)
"""A sensor does not look at where nothing comes back on any row over more than this."""
_RING_GAP_RAD, _RING_WIDTH_RAD = np.radians(0.1), np.radians(0.08)
_FEWEST_ON_RING: Final = 8
_ROW_WIDTH, _TURNED_ROW_WIDTH = np.sin(np.radians((2.0, 0.1)))
"""In the median the points of a numbered row are at most so far off its circle about the pole: a
little, where the motion of the sensor was taken out. About a pole that is looked for they have to
be on it: about the direction of the cloud's middle any narrow cloud is nearly a circle."""
_ALONG_Z: Final = 0.8
"""If the mean direction has so much of z, the sensor looks along z, as cameras do."""


def rays_between(directions: _Floats, rows: npt.NDArray[Any] | None) -> tuple[_Indices, _Floats]:
    """Return the rays (K, 3) in the gaps of an unorganised cloud, and a neighbour (K,) of each.

    `directions` (N, 3) are the unit vectors of the returns, `rows` (N,) the numbers of the beams
    that measured them, if these are known; they count if they are circles about one axis.
    """
    if len(directions) < _FEWEST:
        return _NO_RAYS
    from scipy.spatial import cKDTree

    to_pole = np.eye(3)[_axes_about_pole(directions)]
    rings = None
    if rows is not None:
        rings, to_pole = _numbered_rings(directions, rows, to_pole)
    if rings is None:
        rings = _rings(_laser_angles(product(directions, to_pole.T))[:, 1])
    tree: Any = None
    if rings is None:
        tree = cKDTree(directions)
        rings, to_pole = _turned_rings(directions, tree, to_pole)
    azimuths, elevations = _laser_angles(product(directions, to_pole.T)).T
    spacing_rad = 0.0
    if rings is None:
        spacing_rad = _spacing(directions, tree)
        rings = np.unique(np.floor(elevations / spacing_rad), return_inverse=True)[1]
    by_ring = np.argsort(rings.astype(np.min_scalar_type(rings.max())), kind="stable")
    neighbours, turns, heights = list[_Indices](), list[_Floats](), list[_Floats]()
    for any_order in np.split(by_ring, np.cumsum(np.bincount(rings))[:-1]):
        row = any_order[np.argsort(azimuths[any_order], kind="stable")]
        height = float(np.median(elevations[row]))
        step, wide = _usual_step(azimuths[row]), _WIDE_GAP
        if spacing_rad:
            step, wide = spacing_rad / max(np.cos(height), 0.1), _WIDE_GAP_OF_STRIPE
        before, between = _in_gaps(azimuths[row], step, wide)
        neighbours.append(row[before])
        turns.append(between)
        heights.append(np.full(len(between), height))
    around, above = np.concatenate(turns), np.concatenate(heights)
    is_looked_at = _looked_at(around, azimuths)
    rays = product(_laser_directions(around[is_looked_at], above[is_looked_at]), to_pole)
    return np.concatenate(neighbours)[is_looked_at], rays


def _axes_about_pole(directions: _Floats) -> list[int]:
    """Return the axes in the order in which the last one is the pole: z, or y of a camera."""
    middle = np.abs(directions.mean(axis=0))
    return [2, 0, 1] if middle[2] > _ALONG_Z else [0, 1, 2]


def _numbered_rings(
    directions: _Floats, rows: npt.NDArray[Any], to_pole: _Floats
) -> tuple[_Indices | None, _Floats]:
    """Return the rings (N,) of rows (N,) with a number each, and the axes, the pole last, (3, 3).

    The pole is that of `to_pole`, or in a cloud that is tilted against its laser another one, about
    which the rows are circles. No rings if there is none: not all lasers scan line by line.
    """
    rings: _Indices = np.unique(rows, return_inverse=True)[1]
    counts = np.bincount(rings)
    middles = np.stack([np.bincount(rings, axis) for axis in directions.T], axis=1)
    apart = directions - (middles / counts[:, None])[rings]
    turned = _axes_across(apart)
    for found, width in ((to_pole, _ROW_WIDTH), (turned, _TURNED_ROW_WIDTH)):
        off = np.abs(product(apart, found[2:].T))
        if float(np.median(off)) <= width:
            return rings, found
    return None, to_pole


def _axes_across(vectors: _Floats) -> _Floats:
    """Return axes (3, 3) of which the last, the pole, is square to vectors (N, 3) at the best."""
    _, axes = np.linalg.eigh(product(vectors.T, vectors))
    pole = axes[:, 0] * (1.0 if axes[np.abs(axes[:, 0]).argmax(), 0] > 0.0 else -1.0)
    ahead = np.cross(axes[:, 2], pole)
    return np.stack((ahead, np.cross(pole, ahead), pole))


def _turned_rings(
    directions: _Floats, tree: Any, to_pole: _Floats
) -> tuple[_Indices | None, _Floats]:
    """Return the rings (N,) by elevation about another pole than that of `to_pole`, and its axes.

    In a cloud that is tilted against its laser a point and the nearest one, mostly of its own ring,
    are at the same elevation about the laser's axis. No rings if there are none.
    """
    some = slice(None, None, max(1, len(directions) // _SAMPLE))
    along = directions[tree.query(directions[some], k=[2])[1][:, 0]] - directions[some]
    along = along[np.abs(along).max(axis=1) > 0.0]
    if len(along) < _FEWEST:
        return None, to_pole
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    turned = _axes_across(along)
    for _ in range(_ROUNDS):  # some of the nearest are of another ring
        off = np.abs(product(along, turned[2:].T))[:, 0]
        turned = _axes_across(along[off <= np.quantile(off, _OF_OWN_RING)])
    rings = _rings(_laser_angles(product(directions, turned.T))[:, 1])
    return rings, to_pole if rings is None else turned


def _rings(elevations: _Floats) -> _Indices | None:
    """Return the rings (N,) of a turning laser, numbered by elevation; None if there are none."""
    order = np.argsort(elevations)
    ascending = elevations[order]
    ring_of = np.cumsum(np.diff(ascending, prepend=ascending[0]) > _RING_GAP_RAD)
    counts = np.bincount(ring_of)
    low = ascending[np.concatenate(([0], np.cumsum(counts)[:-1]))]
    high = ascending[np.cumsum(counts) - 1]
    is_ring = (high - low < _RING_WIDTH_RAD) & (counts >= _FEWEST_ON_RING)
    if counts[is_ring].sum() < 0.9 * len(elevations):
        return None
    rings = np.empty(len(elevations), np.int64)
    rings[order] = ring_of
    return rings


def _spacing(directions: _Floats, tree: Any) -> float:
    """Return the angle [rad] between neighbours in a lattice as dense as directions (N, 3).

    The tree holds these.
    """
    some = directions[:: max(1, len(directions) // _SAMPLE)]
    count = min(_NEAREST, len(directions) - 1)
    apart, _ = tree.query(some, k=[1 + count])
    return float(max(np.median(apart) * np.sqrt(np.pi / count), 1e-4))


def _usual_step(azimuths: _Floats) -> float:
    """Return the usual step [rad] between the azimuths (N,) of a row, ascending."""
    steps = np.diff(azimuths)
    steps = steps[steps > 1e-6]
    return float(np.median(steps)) if len(steps) else _TURN


def _in_gaps(azimuths: _Floats, step: float, wide: float) -> tuple[_Indices, _Floats]:
    """Return azimuths (K,) evenly in wide gaps of ascending ones (N,), and who is before each."""
    gaps = np.diff(azimuths, append=azimuths[0] + _TURN)
    counts = np.where(gaps > wide * step, np.rint(gaps / step) - 1, 0).astype(np.int64)
    before = np.repeat(np.arange(len(azimuths)), counts)
    number = np.arange(len(before)) - np.repeat(np.cumsum(counts) - counts, counts) + 1
    return before, _wrapped(azimuths[before] + number * (gaps / (counts + 1))[before])


def _looked_at(rays: _Floats, azimuths: _Floats) -> npt.NDArray[np.bool_]:
    """Return which azimuths of rays (K,) the sensor looks at, with returns at some (N,)."""
    ascending = np.sort(azimuths)
    gaps = np.diff(ascending, append=ascending[0] + _TURN)
    is_narrow: npt.NDArray[np.bool_] = gaps <= WIDEST_GAP_RAD
    return is_narrow[np.searchsorted(ascending, rays) - 1]
