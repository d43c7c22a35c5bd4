"""Where on a map laser scans were taken: a correlative search over the whole map and all headings.

The cloud of scan endpoints is laid onto the map at every pose of a coarse lattice, whose scores are
correlations (Olson 2009), one for each heading, by the fast Fourier transform. A local search
refines the best of them below a cell; there, a beam that passes through a wall speaks against a
pose, too.
"""

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.world.occupancy_grid import CellClasses, OccupancyGrid, distances_in_cells

Bytes = npt.NDArray[np.uint8]
Progress = Callable[[int, int], None]
"""Is called with how many of how many are done."""
Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


FREE_CELL: Final = 0
WALL_CELL: Final = 1
UNKNOWN_CELL: Final = 2

_STEP_CELLS: Final = 0.5


@compiled
def crosses_wall(
    clear: Bytes, x0: float, y0: float, x1: float, y1: float, margin_cells: float
) -> bool:
    """Tell whether a beam from (x0, y0) to (x1, y1) [cells] meets a wall before its last part.

    `clear` is how many cells away a wall may begin, 0 in a wall (`clearance`). The last
    `margin_cells` are left out: there the wall that the beam hits begins.
    """
    dx, dy = x1 - x0, y1 - y0
    length = np.sqrt(dx * dx + dy * dy)
    reach = length - margin_cells
    along = 0.0
    while along < reach:
        x, y = x0 + along / length * dx, y0 + along / length * dy
        leap = _STEP_CELLS
        if 0.0 <= x < clear.shape[1] and 0.0 <= y < clear.shape[0]:
            cells = clear[int(y), int(x)]
            if cells == 0:
                return True
            leap = max(_STEP_CELLS, cells - 1.5)
        along += leap
    return False


def likelihood(
    distances: npt.NDArray[np.float32],
    resolution_m: float,
    points_m: Floats,
    x_m: float,
    y_m: float,
    yaw: float,
    sigma_m: float,
) -> float:
    """Return the mean of exp(-d^2 / 2 sigma^2) over the points (N, 2) [m] at a pose.

    d is the distance between the cells' centres, bilinear; a point beyond the map counts 0.
    """
    cosine, sine = np.cos(yaw), np.sin(yaw)
    x = cosine * points_m[:, 0] - sine * points_m[:, 1] + x_m
    y = sine * points_m[:, 0] + cosine * points_m[:, 1] + y_m
    col, row = x / resolution_m - 0.5, y / resolution_m - 0.5
    height, width = distances.shape
    is_inside = (col >= 0.0) & (col < width - 1) & (row >= 0.0) & (row < height - 1)
    col, row = col[is_inside], row[is_inside]
    i, j = row.astype(np.int64), col.astype(np.int64)
    fy, fx = row - i, col - j
    low = distances[i, j] * (1.0 - fx) + distances[i, j + 1] * fx
    high = distances[i + 1, j] * (1.0 - fx) + distances[i + 1, j + 1] * fx
    d = low * (1.0 - fy) + high * fy
    near = d[d < 5.0 * sigma_m]
    return float(np.exp(-0.5 * (near / sigma_m) ** 2).sum() / len(points_m))


@compiled
def judge_points(
    distances: npt.NDArray[np.float32],
    kinds: Bytes,
    clear: Bytes,
    resolution_m: float,
    points_m: Floats,
    origins_m: Floats,
    x_m: float,
    y_m: float,
    yaw: float,
    margin_m: float,
    away_m: Floats,
    flags: Bytes,
) -> None:
    """Write for each endpoint how far from an occupied cell it lies [m], and `flags`.

    A flag is UNKNOWN_CELL or FREE_CELL, that of the endpoint's cell (unknown beyond the map), or
    WALL_CELL where the beam meets a wall more than `margin_m` before its end.
    """
    cosine, sine = np.cos(yaw), np.sin(yaw)
    for k in range(points_m.shape[0]):
        col = (cosine * points_m[k, 0] - sine * points_m[k, 1] + x_m) / resolution_m
        row = (sine * points_m[k, 0] + cosine * points_m[k, 1] + y_m) / resolution_m
        x0 = (cosine * origins_m[k, 0] - sine * origins_m[k, 1] + x_m) / resolution_m
        y0 = (sine * origins_m[k, 0] + cosine * origins_m[k, 1] + y_m) / resolution_m
        away_m[k], flags[k] = np.inf, UNKNOWN_CELL
        if 0.0 <= col < kinds.shape[1] and 0.0 <= row < kinds.shape[0]:
            kind = kinds[int(row), int(col)]
            if kind == WALL_CELL:
                away_m[k] = 0.0
            else:
                away_m[k] = distances[int(row), int(col)]
            flags[k] = FREE_CELL if kind == WALL_CELL else kind
        if crosses_wall(clear, x0, y0, col, row, margin_m / resolution_m):
            flags[k] = WALL_CELL


NEAR_M: Final = 0.1
"""An endpoint within this of an occupied cell fits."""
DISTINCT_M: Final = 0.5
DISTINCT_RAD: Final = math.radians(10.0)
"""Two poses farther apart than one of these are two answers."""
AMBIGUOUS: Final = 0.95
"""A rival with this share of the best score fits as well: a few people or chairs that are not on
the map, or that were when it was made, change the score of the right pose by as much."""
POOR_SHARE: Final = 0.5
"""With a smaller share of endpoints on walls, map and recording do not belong together."""

_SEARCH_CELL_M: Final = 0.2
_MOST_CELLS: Final = 2**24
_SEARCH_POINTS: Final = 500
_FINE_POINTS: Final = 4000
_SEARCH_SIGMA_M: Final = 0.15
_FINE_SIGMA_M: Final = 0.05
_SCORE_SIGMA_M: Final = 0.1
_MARGIN_M: Final = 0.3
_UNKNOWN: Final = 0.1
"""What an endpoint in an unknown place counts: about as much as one at random."""
_MOST_RIVALS: Final = 3
_RIVAL_SHARE: Final = 0.88
"""Of the best score: before the last climb a rival may lose more than the best does."""
_SCALES: Final = tuple(1.0 + percent / 100.0 for percent in (-4, -3, -2, -1, 1, 2, 3, 4))
_SCALED_REACH_M: Final = 0.3
_UNSCALED_SHARE: Final = 0.95
"""A map of the right scale has this share of the score of any other one at least."""

_CANDIDATES: Final = 150
"""Poses of the coarse lattice that are looked at closely."""
_OF_A_HEADING: Final = 60
_MOST_THREADS: Final = 4
"""So many headings are searched at a time, on as many cores: each takes room for the map."""
_LEAST_SCORE: Final = 0.25
"""What fits worse tells nothing."""
_SEED: Final = 20


class PlanarPose(NamedTuple):
    """map_from_cloud in the plane [m, rad], the yaw in [-pi, pi)."""

    x_m: float
    y_m: float
    yaw_rad: float

    def apply(self, points_m: Floats) -> Floats:
        """Return points (N, 2) of the cloud's frame in the map's."""
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        moved: Floats = points_m @ np.array(((cosine, sine), (-sine, cosine)))
        moved += (self.x_m, self.y_m)
        return moved

    def after(self, other: "PlanarPose") -> "PlanarPose":
        """Return the composition: first `other`, then this."""
        ((x_m, y_m),) = self.apply(np.array([[other.x_m, other.y_m]])).tolist()
        return PlanarPose(x_m, y_m, wrapped(self.yaw_rad + other.yaw_rad))

    def inverse(self) -> "PlanarPose":
        """Return cloud_from_map."""
        back = PlanarPose(0.0, 0.0, -self.yaw_rad)
        ((x_m, y_m),) = back.apply(np.array([[self.x_m, self.y_m]])).tolist()
        return PlanarPose(-x_m, -y_m, wrapped(-self.yaw_rad))


def wrapped(angle_rad: float) -> float:
    """Return the angle in [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


@dataclass(frozen=True, eq=False)
class ScanCloud:
    """Endpoints of planar scans in one level frame, float64 (N, 2) [m], N > 0.

    `origins_m` (N, 2) is where the laser was for each, `scans` int64 (N,) the number of its scan.
    """

    endpoints_m: Floats
    origins_m: Floats
    scans: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.scans)

    def scaled(self, scale: float) -> "ScanCloud":
        """Return the cloud, larger by a factor about its middle."""
        middle = self.endpoints_m.mean(axis=0)
        endpoints_m = middle + scale * (self.endpoints_m - middle)
        return ScanCloud(endpoints_m, middle + scale * (self.origins_m - middle), self.scans)

    def part(self, chosen: npt.NDArray[np.bool_] | npt.NDArray[np.int64]) -> "ScanCloud":
        """Return the endpoints that a mask or indices choose."""
        return ScanCloud(self.endpoints_m[chosen], self.origins_m[chosen], self.scans[chosen])

    def thinned(self, cell_m: float, most: int) -> "ScanCloud":
        """Return one endpoint of each scan per square of this side, in random order.

        At most `most` of them; the same cloud gives the same endpoints. So the wall right beside
        the laser, which takes most of its beams, does not outweigh the rest.
        """
        dice = np.random.Generator(np.random.PCG64(_SEED))
        squares = np.floor(self.endpoints_m / cell_m).astype(np.int64)
        squares = np.column_stack((self.scans, squares))
        _, firsts = np.unique(squares, axis=0, return_index=True)
        return self.part(dice.permutation(firsts)[:most])


@dataclass(frozen=True)
class Match:
    """A pose, and how well the cloud fits there.

    `score` is the mean over endpoints (thinned, see `ScanCloud.thinned`) of how near a wall each
    lies, in 0..1, and of -1 for each whose beam passes through a wall. `near` is the share of all
    endpoints within `NEAR_M` of an occupied cell, `unknown` that of those which lie in unknown
    cells or beyond the map, `through` that of beams that pass through a wall on their way.
    """

    pose: PlanarPose
    score: float
    near: float
    unknown: float
    through: float

    @property
    def is_poor(self) -> bool:
        """Whether it is no match: the map seems to be of another place."""
        return self.near < POOR_SHARE


@dataclass(frozen=True)
class Alignment:
    """The best match, and rivals that fit as well, best first.

    `slides_rad` is the direction in the map along which the cloud can be moved without loss (a
    corridor), None where there is none.
    """

    best: Match
    rivals: tuple[Match, ...]
    slides_rad: float | None

    @property
    def equals(self) -> tuple[Match, ...]:
        """The rivals that fit about as well."""
        least = AMBIGUOUS * self.best.score
        return tuple(rival for rival in self.rivals if rival.score >= least)

    @property
    def is_ambiguous(self) -> bool:
        """Whether another pose fits as well."""
        return bool(self.equals)


class ScanMatcher:
    """Finds clouds on one map."""

    def __init__(self, grid: OccupancyGrid, classes: CellClasses) -> None:
        """Take a grid and the classes of its cells, with an occupied cell at least."""
        known = classes.occupied | classes.free
        rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
        part = np.s_[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
        kinds = _kinds(classes.occupied[part], classes.free[part])
        corner = grid.cells_to_points([[rows[0] - 0.5, cols[0] - 0.5]])[0]
        self._map_from_part = PlanarPose(corner[0], corner[1], grid.origin.yaw_rad())
        coarse = math.ceil(math.sqrt(kinds.size / _MOST_CELLS))
        self._fine_m = grid.resolution_m * coarse
        self._fine = _pooled(kinds, coarse)
        self._distances = _distance_m(self._fine, self._fine_m)
        self._clear = _clearance(self._fine)
        factor = max(1, math.floor(_SEARCH_CELL_M / self._fine_m + 1e-6))
        self._coarse = _CoarseMap.of(_pooled(self._fine, factor), self._fine_m * factor)

    def align(self, cloud: ScanCloud, progress: Progress | None = None) -> Alignment | None:
        """Return the pose at which the cloud fits the map best, anywhere on it, and its rivals.

        The place of the laser that is nearest to the middle of the cloud lies within the map's
        known part. None where no pose has a score worth a word, or too many have about the same; a
        poor best has no rivals. `progress` is called with how many headings are done, and of how
        many.
        """
        thin = cloud.thinned(0.5 * _SEARCH_CELL_M, _SEARCH_POINTS)
        middle = cloud.origins_m.mean(axis=0)
        poses = [
            self._map_from_part.after(pose) for pose in self._coarse.candidates(thin, progress)
        ]
        near = [self._climbed(thin, pose, self._coarse.cell_m) for pose in poses]
        near.sort(key=lambda match: -match.score)
        if near[0].score < _LEAST_SCORE:
            return None
        matches: list[Match] = []
        for match in near:
            if len(matches) > _MOST_RIVALS or match.score < _RIVAL_SHARE * near[0].score:
                break
            if all(_are_distinct(match.pose, other.pose, middle) for other in matches):
                reach_m = self._coarse.cell_m if matches else math.inf
                matches.append(self._climbed(cloud, match.pose, reach_m))
        matches.sort(key=lambda match: -match.score)
        if matches[0].is_poor:
            return Alignment(matches[0], (), None)
        return Alignment(matches[0], tuple(matches[1:]), self._slide(cloud, matches[0], near))

    def judged(self, cloud: ScanCloud, pose: PlanarPose) -> tuple[Floats, npt.NDArray[np.uint8]]:
        """Return how far each endpoint lies from an occupied cell [m] (N,), and its flag (N,).

        Infinite beyond the map; the flags are those of `judge_points`.
        """
        x_m, y_m, yaw = self._map_from_part.inverse().after(pose)
        away_m, flags = np.empty(len(cloud)), np.empty(len(cloud), np.uint8)
        judge_points(
            self._distances, self._fine, self._clear, self._fine_m, cloud.endpoints_m,
            cloud.origins_m, x_m, y_m, yaw, _MARGIN_M, away_m, flags,
        )  # fmt: skip
        return away_m, flags

    def match(self, cloud: ScanCloud, pose: PlanarPose) -> Match:
        """Return how well a cloud fits at a pose."""
        thin = cloud.thinned(NEAR_M, _FINE_POINTS)
        away_m, flags = self.judged(thin, pose)
        values = np.exp(-0.5 * (np.minimum(away_m, 1.0) / self._sigma(_SCORE_SIGMA_M)) ** 2)
        values = np.where(flags == UNKNOWN_CELL, np.maximum(values, _UNKNOWN), values)
        score = float(np.where(flags == WALL_CELL, -1.0, values).mean())
        away_m, flags = self.judged(cloud, pose)
        near = float((away_m <= NEAR_M).mean())
        unknown = float(((flags == UNKNOWN_CELL) & (away_m > NEAR_M)).mean())
        return Match(pose, score, near, unknown, float((flags == WALL_CELL).mean()))

    def best_scale(self, cloud: ScanCloud, match: Match) -> float:
        """Return the factor by which a cloud is to be larger to fit best near a pose.

        It is 1 unless another one makes the score clearly better: then the map, or the odometry
        that joins the scans, is of another scale than the ranges.
        """
        scores = {
            scale: self._climbed(cloud.scaled(scale), match.pose, _SCALED_REACH_M).score
            for scale in _SCALES
        }
        best = max(scores, key=scores.__getitem__)
        return best if match.score < _UNSCALED_SHARE * scores[best] else 1.0

    def _sigma(self, sigma_m: float) -> float:
        return max(sigma_m, self._fine_m)

    def _climbed(self, cloud: ScanCloud, pose: PlanarPose, reach_m: float) -> Match:
        """Climb from a pose by ever smaller steps along x, y and yaw, about the cloud's middle.

        The way is bounded by `reach_m` along each: on a ridge, as in a corridor, rivals stay apart.
        """
        thin = cloud.thinned(0.5 * NEAR_M, _FINE_POINTS)
        middle = thin.endpoints_m.mean(axis=0)
        about = PlanarPose(float(middle[0]), float(middle[1]), 0.0)
        points = thin.endpoints_m - middle
        radius_m = max(float(np.hypot(*points.T).mean()), _SEARCH_CELL_M)
        begin = np.array(self._map_from_part.inverse().after(pose).after(about))
        at, step_m, sigma_m = begin, 0.25 * self._coarse.cell_m, _SEARCH_SIGMA_M

        def value(x_m: float, y_m: float, yaw: float) -> float:
            sigma = self._sigma(sigma_m)
            return likelihood(self._distances, self._fine_m, points, x_m, y_m, yaw, sigma)

        units = np.diag((1.0, 1.0, 1.0 / radius_m))
        score = value(*at)
        while step_m > 0.0005:
            steps = [at + sign * step_m * unit for unit in units for sign in (-1.0, 1.0)]
            tried = [one for one in steps if (abs(one - begin) <= reach_m * units.diagonal()).all()]
            values = [value(*one) for one in tried]
            k = int(np.argmax(values))
            if values[k] > score:
                at, score = tried[k], values[k]
            else:
                step_m *= 0.5
                sigma_m = max(_FINE_SIGMA_M, min(sigma_m, 6.0 * step_m))
                score = value(*at)
        found = self._map_from_part.after(PlanarPose(*at.tolist())).after(about.inverse())
        return self.match(cloud, found)

    def _slide(self, cloud: ScanCloud, best: Match, others: Sequence[Match]) -> float | None:
        """Return the direction from the best to another pose, if what lies between fits.

        Of all candidates, for which few rivals are named is a matter of rounding where many are
        alike, as in a corridor.
        """
        middle = cloud.origins_m.mean(axis=0)[np.newaxis]
        for other in others:
            turned = abs(wrapped(other.pose.yaw_rad - best.pose.yaw_rad))
            dx, dy = (other.pose.apply(middle) - best.pose.apply(middle))[0].tolist()
            is_beside = math.hypot(dx, dy) > DISTINCT_M / 2 and turned <= DISTINCT_RAD
            if not is_beside or other.score < AMBIGUOUS * best.score:
                continue
            between = [_between(best.pose, other.pose, part) for part in (0.25, 0.5, 0.75)]
            scores = [self.match(cloud, pose).score for pose in between]
            if min(scores) >= AMBIGUOUS * other.score:
                return math.atan2(dy, dx)
        return None


@dataclass(frozen=True, eq=False)
class _CoarseMap:
    """The map as the search sees it: what an endpoint in each cell counts beyond `_UNKNOWN`."""

    values: npt.NDArray[np.float32]
    cell_m: float

    @classmethod
    def of(cls, kinds: npt.NDArray[np.uint8], cell_m: float) -> "_CoarseMap":
        """Return the map of kinds (h, w)."""
        away = _distance_m(kinds, cell_m) / max(_SEARCH_SIGMA_M, cell_m)
        values = np.exp(-0.5 * away**2)
        values[kinds == UNKNOWN_CELL] = np.maximum(values[kinds == UNKNOWN_CELL], _UNKNOWN)
        return cls((values - _UNKNOWN).astype(np.float32), cell_m)

    def candidates(self, cloud: ScanCloud, progress: Progress | None) -> list[PlanarPose]:
        """Return poses at which the cloud scores high, the best first, distinct from each other.

        The place of the laser that is nearest to the middle of the cloud lies within the map.
        """
        middle = 0.5 * (cloud.endpoints_m.min(axis=0) + cloud.endpoints_m.max(axis=0))
        reference_m = cloud.origins_m[np.argmin(np.hypot(*(cloud.origins_m - middle).T))]
        points = (cloud.endpoints_m - reference_m) / self.cell_m
        back = PlanarPose(-reference_m[0], -reference_m[1], 0.0)
        return [
            PlanarPose((x + 0.5) * self.cell_m, (y + 0.5) * self.cell_m, wrapped(yaw)).after(back)
            for x, y, yaw in self._peaks(points, progress)
        ]

    def _peaks(
        self, points: Floats, progress: Progress | None = None
    ) -> list[tuple[float, float, float]]:
        """Return distinct poses [cells, rad] of points (N, 2) with high scores, the best first.

        Points farther away than the map is long lie beyond it at each pose, and count nothing: a
        wild return far outside shall not make the search as large as it is far.
        """
        from scipy import fft

        (height, width), away = self.values.shape, np.hypot(*points.T)
        is_near = away <= math.hypot(height, width)
        points, reach = points[is_near], float(away[is_near].max(initial=1.0))
        yaws = np.arange(0.0, 2.0 * math.pi, 1.0 / reach)
        room = 2 * math.ceil(reach) + 1
        shape = fft.next_fast_len(height + room), fft.next_fast_len(width + room)
        spectrum: Any = fft.rfft2(self.values, shape)

        def best_at(yaw: float) -> Floats:
            turned = np.rint(PlanarPose(0.0, 0.0, yaw).apply(points)).astype(np.int64)
            hits = np.zeros(shape, dtype=np.float32)
            np.add.at(hits, (turned[:, 1], turned[:, 0]), 1.0)  # negative ones count from the end
            scores = fft.irfft2(spectrum * np.conj(fft.rfft2(hits)), shape)[:height, :width]
            most = min(_OF_A_HEADING, scores.size)
            best = np.argpartition(scores, -most, axis=None)[-most:]
            rows, cols = np.unravel_index(best, scores.shape)
            return np.column_stack((cols, rows, np.full(len(best), yaw), scores[rows, cols]))

        found = []
        with ThreadPoolExecutor(min(_MOST_THREADS, os.cpu_count() or 1)) as pool:
            for heading in pool.map(best_at, yaws.tolist()):
                found.append(heading)
                if progress is not None:
                    progress(len(found), len(yaws))
        return self._distinct(np.concatenate(found))

    def _distinct(self, found: Floats) -> list[tuple[float, float, float]]:
        """Return poses (x, y, yaw, score), best first, each far from those before it."""
        left = found[np.argsort(-found[:, 3], kind="stable")]
        chosen: list[tuple[float, float, float]] = []
        while len(left) and len(chosen) < _CANDIDATES:
            x, y, yaw = left[0, :3].tolist()
            chosen.append((x, y, yaw))
            turned = np.abs(wrapped(left[:, 2] - yaw))
            away = np.hypot(left[:, 0] - x, left[:, 1] - y)
            left = left[(away * self.cell_m >= DISTINCT_M) | (turned >= DISTINCT_RAD)]
        return chosen


def _are_distinct(a: PlanarPose, b: PlanarPose, at_m: Floats) -> bool:
    """Tell whether two poses put a point of the cloud, or its heading, in different places."""
    dx, dy = (a.apply(at_m[np.newaxis]) - b.apply(at_m[np.newaxis]))[0].tolist()
    turned = abs(wrapped(a.yaw_rad - b.yaw_rad))
    return math.hypot(dx, dy) > 0.5 * DISTINCT_M or turned > 0.5 * DISTINCT_RAD


def _between(a: PlanarPose, b: PlanarPose, part: float) -> PlanarPose:
    x_m, y_m = a.x_m + part * (b.x_m - a.x_m), a.y_m + part * (b.y_m - a.y_m)
    return PlanarPose(x_m, y_m, wrapped(a.yaw_rad + part * wrapped(b.yaw_rad - a.yaw_rad)))


def _kinds(occupied: npt.NDArray[np.bool_], free: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint8]:
    kinds = np.full(occupied.shape, UNKNOWN_CELL, dtype=np.uint8)
    kinds[free] = FREE_CELL
    kinds[occupied] = WALL_CELL
    return kinds


def _pooled(kinds: npt.NDArray[np.uint8], factor: int) -> npt.NDArray[np.uint8]:
    """Return coarser cells: a wall where any is one, else free where any is."""
    if factor == 1:
        return kinds
    sides = tuple(-(-side // factor) for side in kinds.shape)
    padded = np.full((sides[0] * factor, sides[1] * factor), UNKNOWN_CELL, dtype=np.uint8)
    padded[: kinds.shape[0], : kinds.shape[1]] = kinds
    blocks = padded.reshape(sides[0], factor, sides[1], factor)
    return _kinds((blocks == WALL_CELL).any(axis=(1, 3)), (blocks == FREE_CELL).any(axis=(1, 3)))


def _distance_m(kinds: npt.NDArray[np.uint8], cell_m: float) -> npt.NDArray[np.float32]:
    """Return the distance to the surface of the walls, float32 of the same shape [m].

    The surface is the occupied cells beside one that is not: within a thick wall an endpoint fits
    no better than before it.
    """
    import cv2

    walls = (kinds == WALL_CELL).astype(np.uint8)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    inner = cv2.erode(walls, cross, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    surface = walls & ~inner
    metres: npt.NDArray[np.float32] = distances_in_cells(surface == 0) * np.float32(cell_m)
    return metres


def _clearance(kinds: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return the distance to the nearest wall's centre in whole cells, 0 in walls, 255 at most."""
    return np.clip(distances_in_cells(kinds != WALL_CELL), 0.0, 255.0).astype(np.uint8)
