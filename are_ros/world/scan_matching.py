"""Where on a map laser scans were taken: a correlative search over the whole map and all headings.

The cloud of scan endpoints is laid onto the map at every pose of a fine lattice; the pose at which
most endpoints lie on walls, and no beam passes through one, is the answer. Branch and bound (Hess
et al. 2016, after Olson 2009) finds the best pose of the lattice without trying them all; a
local search then refines it below a cell.

Poses are (x, y, yaw) of the cloud's reference point, in cells of the search grid and in radians.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.world.occupancy_grid import CellClasses, OccupancyGrid

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

FULL: Final = 255
"""The value of an endpoint on a wall, in the fields of the search."""

FREE_CELL: Final = 0
WALL_CELL: Final = 1
UNKNOWN_CELL: Final = 2

_CHECK_EVERY: Final = 8
_STEP_CELLS: Final = 0.5
_LEAF_EFFORT: Final = 60
"""What expanding a node to leaves costs, whose beams are followed, in nodes of other levels."""


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


@compiled
def bound_at(
    field: Bytes, pad: int, outside: int, points: Floats, x: float, y: float, yaw: float, floor: int
) -> int:
    """Return the sum of the field over the points (N, 2) at a pose; -1 if not above `floor`.

    `field` is the map's with `pad` cells around; beyond it the value is `outside`.
    """
    cosine, sine = np.cos(yaw), np.sin(yaw)
    total, left = 0, FULL * points.shape[0]
    x, y = x + pad, y + pad
    for k in range(points.shape[0]):
        col = cosine * points[k, 0] - sine * points[k, 1] + x
        row = sine * points[k, 0] + cosine * points[k, 1] + y
        if 0.0 <= col < field.shape[1] and 0.0 <= row < field.shape[0]:
            total += int(field[int(row), int(col)])
        else:
            total += outside
        left -= FULL
        if k % _CHECK_EVERY == 0 and total + left <= floor:
            return -1
    return total if total > floor else -1


@compiled
def score_at(
    field: Bytes,
    pad: int,
    outside: int,
    clear: Bytes,
    points: Floats,
    origins: Floats,
    margin_cells: float,
    x: float,
    y: float,
    yaw: float,
    bound: int,
    floor: int,
) -> int:
    """Return the score of a pose: its `bound_at`, but an endpoint behind a wall counts -`FULL`.

    `clear` is the clearance without padding, `origins` (N, 2) are the beams' beginnings.
    """
    cosine, sine = np.cos(yaw), np.sin(yaw)
    for k in range(points.shape[0]):
        col = cosine * points[k, 0] - sine * points[k, 1] + x
        row = sine * points[k, 0] + cosine * points[k, 1] + y
        x0 = cosine * origins[k, 0] - sine * origins[k, 1] + x
        y0 = sine * origins[k, 0] + cosine * origins[k, 1] + y
        if crosses_wall(clear, x0, y0, col, row, margin_cells):
            value = outside
            if -pad <= col < field.shape[1] - pad and -pad <= row < field.shape[0] - pad:
                value = int(field[int(row + pad), int(col + pad)])
            bound -= value + FULL
            if bound <= floor:
                return -1
    return bound


@compiled
def top_bounds(
    field: Bytes,
    pad: int,
    outside: int,
    points: Floats,
    level: int,
    yaw_step: float,
    floor: int,
    out: npt.NDArray[np.int32],
) -> None:
    """Write the bound of each node (yaw, y, x) of a level into `out`, -1 if not above `floor`."""
    size = float(1 << level)
    for it in range(out.shape[0]):
        yaw = (it + 0.5) * size * yaw_step
        for iy in range(out.shape[1]):
            for ix in range(out.shape[2]):
                x, y = (ix + 0.5) * size, (iy + 0.5) * size
                out[it, iy, ix] = bound_at(field, pad, outside, points, x, y, yaw, floor)


@compiled
def _push_children(
    fields: Bytes,
    pad: int,
    outside: int,
    clear: Bytes,
    points: Floats,
    origins: Floats,
    margin_cells: float,
    node: Ints,
    sides: Ints,
    yaw_step: float,
    excluded: Floats,
    radius: float,
    turn: float,
    best: int,
    children: Ints,
) -> int:
    """Write the children of a node that may exceed `best`, the lowest first; return how many."""
    below = node[0] - 1
    size = float(1 << below)
    # How far the poses of a child lie from its middle, the turn in the measure of the exclusion.
    wide = max(0.71 * (size - 1.0), 0.5 * (size - 1.0) * yaw_step / turn * radius)
    found = 0
    for number in range(8):
        ix, iy = 2 * node[1] + (number & 1), 2 * node[2] + ((number >> 1) & 1)
        it = 2 * node[3] + (number >> 2)
        x, y, yaw = (ix + 0.5) * size, (iy + 0.5) * size, (it + 0.5) * size * yaw_step
        if (ix << below) >= sides[0] or (iy << below) >= sides[1]:
            continue
        is_left_out = False  # where all poses of the child are near an excluded one
        for m in range(excluded.shape[0]):
            dx, dy = x - excluded[m, 0], y - excluded[m, 1]
            away = abs(yaw - excluded[m, 2]) % (2.0 * np.pi)
            away = min(away, 2.0 * np.pi - away)
            is_near = np.sqrt(dx * dx + dy * dy) + wide < radius
            is_left_out |= is_near and away + wide / radius * turn < turn
        if is_left_out:
            continue
        value = bound_at(fields[below], pad, outside, points, x, y, yaw, best)
        if below == 0 and value > best:
            value = score_at(
                fields[0], pad, outside, clear, points, origins, margin_cells, x, y, yaw, value,
                best,
            )  # fmt: skip
        if value <= best:
            continue
        k = found
        while k > 0 and children[k - 1, 4] > value:
            children[k] = children[k - 1]
            k -= 1
        children[k, 0], children[k, 1], children[k, 2] = below, ix, iy
        children[k, 3], children[k, 4] = it, value
        found += 1
    return found


@compiled
def search_nodes(
    fields: Bytes,
    pad: int,
    outside: int,
    clear: Bytes,
    points: Floats,
    origins: Floats,
    margin_cells: float,
    level: int,
    nodes: Ints,
    bounds: npt.NDArray[np.int32],
    sides: Ints,
    yaw_step: float,
    excluded: Floats,
    radius: float,
    turn: float,
    best: int,
    best_leaf: Ints,
    left: Ints,
) -> int:
    """Search below nodes (N, 3) of one level for the leaf with the highest score above `best`.

    Depth first, the child with the highest bound first. `fields` (levels, H, W) holds for each
    level the highest value within 2^level - 1 cells, padded; `sides` is the number of leaves along
    x, y and yaw. Leaves that lie near an `excluded` pose are left out. Writes the leaf (x, y, yaw)
    and returns its score, or `best` where there is none. `left[0]` counts down the effort that may
    be spent; where nothing is left, the search is given up.
    """
    stack = np.empty((8 * (level + 1) + 8, 5), np.int64)
    children = np.empty((8, 5), np.int64)
    for n in range(nodes.shape[0]):
        if bounds[n] <= best:
            continue
        stack[0, 0], stack[0, 4] = level, bounds[n]
        stack[0, 1], stack[0, 2], stack[0, 3] = nodes[n, 0], nodes[n, 1], nodes[n, 2]
        depth = 1
        while depth > 0 and left[0] > 0:
            depth -= 1
            node = stack[depth].copy()
            if node[4] <= best:
                continue
            if node[0] == 0:
                best = node[4]
                best_leaf[:] = node[1:4]
                continue
            left[0] -= _LEAF_EFFORT if node[0] == 1 else 1
            found = _push_children(
                fields, pad, outside, clear, points, origins, margin_cells, node, sides, yaw_step,
                excluded, radius, turn, best, children,
            )  # fmt: skip
            stack[depth : depth + found] = children[:found]
            depth += found
    return best


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

_SEARCH_CELL_M: Final = 0.05
_MOST_CELLS: Final = 2**24
_SEARCH_POINTS: Final = 500
_FINE_POINTS: Final = 4000
_SEARCH_SIGMA_M: Final = 0.15
_FINE_SIGMA_M: Final = 0.05
_SCORE_SIGMA_M: Final = 0.1
_MARGIN_M: Final = 0.3
_TOP_LEVEL: Final = 5
_UNKNOWN: Final = 25
"""What an endpoint in an unknown place counts, of `FULL`: about as much as one at random."""
_RIVAL_FLOOR: Final = 0.88
"""Of the best score on the lattice: on its lattice a rival may lose more than the best did."""
_MOST_RIVALS: Final = 3
_FLOORS: Final = (0.8, 0.65, 0.5, 0.4, 0.32, 0.25)
"""Scores above which the best pose is looked for in turn: a high floor makes a quick search. With
less than the last the search takes long, and what it finds tells nothing."""
_MOST_EFFORT: Final = 10**7
"""Nodes that a search may look at: some ten seconds."""
_BATCH: Final = 4096
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
        self._cell_m = self._fine_m * factor
        self._fields = _Fields.of(_pooled(self._fine, factor), self._cell_m)

    def align(self, cloud: ScanCloud) -> Alignment | None:
        """Return the pose at which the cloud fits the map best, anywhere on it, and its rivals.

        The place of the laser that is nearest to the middle of the cloud lies within the map's
        known part. None where no pose has a score worth a word, or too many have about the same; a
        poor best has no rivals.
        """
        search = _Search(self._fields, cloud)
        first = search.first()
        if first is None:
            return None
        found, middle = [first], cloud.origins_m.mean(axis=0)
        matches = [self._climbed(cloud, self._map_from_part.after(search.pose(first.leaf)))]
        floor = int(_RIVAL_FLOOR * first.score)
        while len(matches) <= _MOST_RIVALS and not matches[0].is_poor:
            rival = search.best(found, floor)
            if rival is None:
                return None
            if rival.score <= floor:
                break
            found.append(rival)
            pose = self._map_from_part.after(search.pose(rival.leaf))
            climbed = self._climbed(cloud, pose)
            is_new = all(_are_distinct(climbed.pose, match.pose, middle) for match in matches)
            # From a ridge the climb may end where another did; the ridge is there all the same.
            matches.append(climbed if is_new else self.match(cloud, pose))
        matches.sort(key=lambda match: -match.score)
        return Alignment(matches[0], tuple(matches[1:]), self._slide(cloud, matches))

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
        values = np.where(flags == UNKNOWN_CELL, np.maximum(values, _UNKNOWN / FULL), values)
        score = float(np.where(flags == WALL_CELL, -1.0, values).mean())
        away_m, flags = self.judged(cloud, pose)
        near = float((away_m <= NEAR_M).mean())
        unknown = float(((flags == UNKNOWN_CELL) & (away_m > NEAR_M)).mean())
        return Match(pose, score, near, unknown, float((flags == WALL_CELL).mean()))

    def _sigma(self, sigma_m: float) -> float:
        return max(sigma_m, self._fine_m)

    def _climbed(self, cloud: ScanCloud, pose: PlanarPose) -> Match:
        """Climb from a pose by ever smaller steps along x, y and yaw, about the cloud's middle."""
        thin = cloud.thinned(0.5 * NEAR_M, _FINE_POINTS)
        middle = thin.endpoints_m.mean(axis=0)
        about = PlanarPose(float(middle[0]), float(middle[1]), 0.0)
        points = thin.endpoints_m - middle
        radius_m = max(float(np.hypot(*points.T).mean()), self._cell_m)
        at = np.array(self._map_from_part.inverse().after(pose).after(about))
        step_m, sigma_m = 0.5 * self._cell_m, _SEARCH_SIGMA_M

        def value(x_m: float, y_m: float, yaw: float) -> float:
            sigma = self._sigma(sigma_m)
            return likelihood(self._distances, self._fine_m, points, x_m, y_m, yaw, sigma)

        units = np.diag((1.0, 1.0, 1.0 / radius_m))
        score = value(*at)
        while step_m > 0.0005:
            tried = [at + sign * step_m * unit for unit in units for sign in (-1.0, 1.0)]
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

    def _slide(self, cloud: ScanCloud, matches: Sequence[Match]) -> float | None:
        """Return the direction from the best to a rival beside it, if what lies between fits."""
        best, *rivals = matches
        middle = cloud.origins_m.mean(axis=0)[np.newaxis]
        for rival in rivals:
            turned = abs(wrapped(rival.pose.yaw_rad - best.pose.yaw_rad))
            dx, dy = (rival.pose.apply(middle) - best.pose.apply(middle))[0].tolist()
            if turned > DISTINCT_RAD or rival.score < AMBIGUOUS * best.score:
                continue
            between = [_between(best.pose, rival.pose, part) for part in (0.25, 0.5, 0.75)]
            scores = [self.match(cloud, pose).score for pose in between]
            if min(scores) >= AMBIGUOUS * rival.score and math.hypot(dx, dy) > DISTINCT_M / 2:
                return math.atan2(dy, dx)
        return None


@dataclass(frozen=True, eq=False)
class _Fields:
    """The map as the search sees it; `clear` without, `levels` with `pad` cells around."""

    clear: npt.NDArray[np.uint8]
    levels: npt.NDArray[np.uint8]
    pad: int
    cell_m: float

    @classmethod
    def of(cls, kinds: npt.NDArray[np.uint8], cell_m: float) -> "_Fields":
        """Return the fields of uint8 (levels, h + 2 pad, w + 2 pad) for kinds (h, w).

        Level 0 is the likelihood of an endpoint in each cell; level n the highest of the cells
        within 2^n - 1 rows and columns.
        """
        pad = (1 << _TOP_LEVEL) - 1
        sigma_m = max(_SEARCH_SIGMA_M, 1.5 * cell_m)
        away = _distance_m(kinds, cell_m) / sigma_m
        values = np.rint(FULL * np.exp(-0.5 * away**2)).astype(np.uint8)
        unknown = kinds == UNKNOWN_CELL
        values[unknown] = np.maximum(values[unknown], _UNKNOWN)
        sides = (side + 2 * pad for side in kinds.shape)
        levels = np.empty((_TOP_LEVEL + 1, *sides), dtype=np.uint8)
        levels[0] = np.pad(values, pad, constant_values=_UNKNOWN)
        for level in range(1, _TOP_LEVEL + 1):
            shift = 1 << (level - 1)
            levels[level] = _spread(_spread(levels[level - 1], shift).T, shift).T
        return cls(_clearance(kinds), levels, pad, cell_m)


class _Found(NamedTuple):
    """A leaf (x, y, yaw) of the search, and its score there."""

    leaf: tuple[int, int, int]
    score: int


class _Search:
    """The search for one cloud: a lattice of poses, coarse nodes above it, and their bounds.

    The lattice is that of the cells of the search, and so fine in yaw that no endpoint moves by
    more than a cell from one yaw to the next. Its poses are those of `reference`, a place of the
    laser near the middle of the cloud.
    """

    def __init__(self, fields: _Fields, cloud: ScanCloud) -> None:
        thin = cloud.thinned(2.0 * _SEARCH_CELL_M, _SEARCH_POINTS)
        # Long beams first: they are the likeliest to pass through a wall where a pose is wrong.
        lengths = np.hypot(*(thin.endpoints_m - thin.origins_m).T)
        thin = thin.part(np.argsort(-lengths, kind="stable"))
        middle = 0.5 * (thin.endpoints_m.min(axis=0) + thin.endpoints_m.max(axis=0))
        nearest = np.argmin(np.hypot(*(cloud.origins_m - middle).T))
        self.reference_m = cloud.origins_m[nearest]
        self.fields = fields
        self.points = (thin.endpoints_m - self.reference_m) / fields.cell_m
        self.origins = (thin.origins_m - self.reference_m) / fields.cell_m
        height, width = fields.clear.shape
        self.level = min(_TOP_LEVEL, max(1, int(math.log2(max(height, width))) - 1))
        reach = max(float(np.hypot(*self.points.T).max()), 1.0)
        yaws = math.ceil(2.0 * math.pi * reach / (1 << self.level)) << self.level
        self.yaw_step = 2.0 * math.pi / yaws
        self.sides = np.array((width, height, yaws), dtype=np.int64)

    def at(self, leaf: tuple[int, int, int]) -> tuple[float, float, float]:
        """Return the pose [cells, rad] of the reference point at a leaf."""
        x, y, yaw = leaf
        return x + 0.5, y + 0.5, (yaw + 0.5) * self.yaw_step

    def pose(self, leaf: tuple[int, int, int]) -> PlanarPose:
        """Return the pose of the cloud's frame in that of the fields."""
        x, y, yaw = self.at(leaf)
        cell_m = self.fields.cell_m
        back = PlanarPose(-self.reference_m[0], -self.reference_m[1], 0.0)
        return PlanarPose(x * cell_m, y * cell_m, wrapped(yaw)).after(back)

    def first(self) -> _Found | None:
        """Return the best leaf of all, None if it is not worth a word or the search is given up."""
        for share in _FLOORS:
            floor = int(share * FULL * len(self.points))
            found = self.best((), floor)
            if found is None or found.score > floor:
                return found
        return None

    def best(self, excluded: Sequence[_Found], floor: int) -> _Found | None:
        """Return the best leaf with a score above `floor` that is far from the excluded ones.

        Where there is none, the score is `floor`; None where the search is given up, for too many
        poses are about as good.
        """
        fields = self.fields
        away = np.array([self.at(found.leaf) for found in excluded]).reshape(-1, 3)
        nodes, bounds = self._top(floor)
        leaf, best = np.zeros(3, dtype=np.int64), floor
        left = np.array((_MOST_EFFORT,), dtype=np.int64)
        for begin in range(0, len(nodes), _BATCH):
            batch = np.s_[begin : begin + _BATCH]
            if bounds[batch][0] <= best:
                break
            best = search_nodes(
                fields.levels, fields.pad, _UNKNOWN, fields.clear, self.points, self.origins,
                _MARGIN_M / fields.cell_m, self.level, nodes[batch], bounds[batch], self.sides,
                self.yaw_step, away, DISTINCT_M / fields.cell_m, DISTINCT_RAD, best, leaf, left,
            )  # fmt: skip
        if left[0] <= 0:
            return None
        x, y, yaw = leaf.tolist()
        return _Found((x, y, yaw), int(best))

    def _top(self, floor: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int32]]:
        """Return the nodes (N, 3) of the coarsest level with bounds above `floor`, best first."""
        fields, size = self.fields, 1 << self.level
        counts = -(-self.sides[:2] // size)
        yaws = int(self.sides[2]) // size
        bounds = np.empty((yaws, counts[1], counts[0]), dtype=np.int32)
        top_bounds(
            fields.levels[self.level], fields.pad, _UNKNOWN, self.points, self.level,
            self.yaw_step, floor, bounds,
        )  # fmt: skip
        order = np.argsort(-bounds, axis=None, kind="stable")
        order = order[bounds.ravel()[order] > floor]
        yaw, y, x = np.unravel_index(order, bounds.shape)
        return np.column_stack((x, y, yaw)).astype(np.int64), bounds.ravel()[order]


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
    distances = cv2.distanceTransform(1 - surface, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    metres: npt.NDArray[np.float32] = np.asarray(distances, dtype=np.float32) * np.float32(cell_m)
    return metres


def _clearance(kinds: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return the distance to the nearest wall's centre in whole cells, 0 in walls, 255 at most."""
    import cv2

    walls = (kinds == WALL_CELL).astype(np.uint8)
    distances = cv2.distanceTransform(1 - walls, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    clear: npt.NDArray[np.uint8] = np.clip(np.asarray(distances), 0.0, 255.0).astype(np.uint8)
    return clear


def _spread(field: npt.NDArray[np.uint8], shift: int) -> npt.NDArray[np.uint8]:
    """Return the highest of each value and those `shift` rows before and after it."""
    spread: npt.NDArray[np.uint8] = field.copy()
    np.maximum(spread[shift:], field[:-shift], out=spread[shift:])
    np.maximum(spread[:-shift], field[shift:], out=spread[:-shift])
    return spread
