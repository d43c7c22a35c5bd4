"""Placement: a pose for an arrival, uniform over the feasible poses (section 3.2).

`Placer` draws random poses until one is feasible; where none is found, it searches a lattice of
poses. Both prefer poses from which the artefact can depart.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.agents.navigation.terrain import Terrains
from are_ros.builder.spawning._departure_constraint import (
    DepartureConstraint,
    departure_constraint_of,
)
from are_ros.population.artefact import GroundPose, shape_of
from are_ros.population.catalogue import CatalogueRow
from are_ros.world.boxes import OrientedBoxes, overlaps_any
from are_ros.world.environment import Environment
from are_ros.world.footprint import Footprint, signed_distance_m
from are_ros.world.lattice_cover import lattice_row
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.regions import SpawnRegion

_LEVELS_PER_CELL: Final = 4
_HIGHEST_LEVEL: Final = 2**16 - 1
_SLACK_CELLS: Final = math.sqrt(0.5) - 0.5 + 1e-3
"""Clearance is measured between cell centres. A free disc about a point of a cell may be wider than
that by half a diagonal less half an edge, and rounding."""


@dataclass(frozen=True, eq=False)
class CandidateCells:
    """Cells in descending order of clearance: the cells with room for a disc are a prefix.

    `flat` is int32 (N,), row * width + col. `depths` is uint16 (N,), ascending: the highest
    clearance that is distinguished less the cell's own, in quarters of a cell, rounded up.
    `cumulative` is None or float64 (N,), the running sum of the cells' weights.
    """

    flat: npt.NDArray[np.int32]
    depths: npt.NDArray[np.uint16]
    cumulative: npt.NDArray[np.float64] | None

    @classmethod
    def ordered(
        cls, flat: npt.NDArray[np.int32], clearance_cells: npt.NDArray[np.float32]
    ) -> "CandidateCells":
        """Order cells (N,) with their clearance in cells (N,); of equal ones the first is first."""
        return cls(*sorted_by_depth(flat, clearance_cells), None)

    def with_room(self, radius_cells: float) -> "CandidateCells":
        """Return the cells with a point about which a disc may be clear (a superset)."""
        level = math.floor(needed_cells(radius_cells) * _LEVELS_PER_CELL)
        depth = np.uint16(min(max(_HIGHEST_LEVEL - level, 0), _HIGHEST_LEVEL))
        count = int(np.searchsorted(self.depths, depth, side="right"))
        cumulative = None if self.cumulative is None else self.cumulative[:count]
        return CandidateCells(self.flat[:count], self.depths[:count], cumulative)

    def draw(self, uniforms: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
        """Return the cells (n,) that uniform numbers (n,) in [0, 1) choose by weight."""
        if self.cumulative is None:
            chosen = (uniforms * len(self.flat)).astype(np.int64)
        else:
            quantile = uniforms * self.cumulative[-1]
            chosen = np.searchsorted(self.cumulative, quantile, side="right")
        return self.flat[np.minimum(chosen, len(self.flat) - 1)].astype(np.int64)


@compiled
def sorted_by_depth(
    flat: npt.NDArray[np.int32], clearance_cells: npt.NDArray[np.float32]
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.uint16]]:
    """Return cells (N,) and their depths, as in `CandidateCells`: a stable counting sort."""
    unsorted, starts = np.empty(flat.shape[0], np.uint16), np.zeros(_HIGHEST_LEVEL + 2, np.int64)
    for k in range(flat.shape[0]):
        level = min(clearance_cells[k] * np.float32(_LEVELS_PER_CELL), np.float32(_HIGHEST_LEVEL))
        unsorted[k] = _HIGHEST_LEVEL - np.int64(level)
        starts[unsorted[k] + 1] += 1
    starts = np.cumsum(starts)
    cells, depths = np.empty_like(flat), np.empty_like(unsorted)
    for k in range(flat.shape[0]):
        at = starts[unsorted[k]]
        cells[at], depths[at] = flat[k], unsorted[k]
        starts[unsorted[k]] = at + 1
    return cells, depths


def poses_in_cells(
    flat: npt.NDArray[np.int64],
    width: int,
    uniforms: npt.NDArray[np.float64],
    lattice: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Return poses (n, 4), x, y, 0, yaw in the map frame, anywhere in the cells (n,), row * width.

    The columns of `uniforms` (n, 4), in [0, 1), after the first say where in a cell, along its
    rows and columns, and the heading; `lattice` is the grid's row of `lattice_cover`.
    """
    x_m, y_m, cos, sin, cell_m, _ = lattice
    along_y_m = (flat // width + uniforms[:, 1]) * cell_m
    along_x_m = (flat % width + uniforms[:, 2]) * cell_m
    poses = np.zeros((len(flat), 4))
    poses[:, 0] = x_m + along_x_m * cos - along_y_m * sin
    poses[:, 1] = y_m + along_x_m * sin + along_y_m * cos
    poses[:, 3] = (2.0 * uniforms[:, 3] - 1.0) * np.pi
    return poses


@compiled
def spines_are_clear(
    flat: npt.NDArray[np.int32],
    clearance_cells: npt.NDArray[np.float32],
    spine: npt.NDArray[np.float64],
    turns: npt.NDArray[np.float64],
    needed_cells: float,
) -> npt.NDArray[np.int64]:
    """Return the lattice poses where a box may be clear, as cell * headings + heading.

    A box at the centre of a cell, turned by one of `turns` (H, 2) (cos, sin), is filled by discs
    about the points `spine` (K, 2) [cells]; each needs the clearance. A necessary condition.
    """
    height, width = clearance_cells.shape
    headings = len(turns)
    found = np.empty(len(flat) * headings, np.int64)
    count = 0
    for cell in flat.astype(np.int64):
        row, col = cell // width, cell % width
        for heading in range(headings):
            c, s = turns[heading]
            clear = True
            for x, y in spine:
                i = int(np.floor(row + 0.5 + s * x + c * y))
                j = int(np.floor(col + 0.5 + c * x - s * y))
                inside = 0 <= i < height and 0 <= j < width
                clear = (clearance_cells[i, j] if inside else 0.0) >= needed_cells
                if not clear:
                    break
            if clear:
                found[count] = cell * headings + heading
                count += 1
    return found[:count]


@compiled
def cells_near_boxes(
    shape: tuple[int, int],
    packed: npt.NDArray[np.float64],
    lattice: npt.NDArray[np.float64],
    radius_m: float,
) -> npt.NDArray[np.bool_]:
    """Tell which cells of a grid have their centre less than a radius from one of the boxes.

    The boxes are packed ones, seen from above; none is near if the radius is not positive.
    """
    near = np.zeros(shape, np.bool_)
    cell_m = lattice[4]
    for i in range(packed.shape[0] if radius_m > 0.0 else 0):
        reach_m = np.hypot(packed[i, 5], packed[i, 6]) + radius_m
        dx_m, dy_m = packed[i, 0] - lattice[0], packed[i, 1] - lattice[1]
        x_m, y_m = dx_m * lattice[2] + dy_m * lattice[3], dy_m * lattice[2] - dx_m * lattice[3]
        cos = packed[i, 3] * lattice[2] + packed[i, 4] * lattice[3]
        sin = packed[i, 4] * lattice[2] - packed[i, 3] * lattice[3]
        low_row = max(0, int(np.floor((y_m - reach_m) / cell_m)))
        low_col = max(0, int(np.floor((x_m - reach_m) / cell_m)))
        for row in range(low_row, min(shape[0], int(np.ceil((y_m + reach_m) / cell_m)))):
            for col in range(low_col, min(shape[1], int(np.ceil((x_m + reach_m) / cell_m)))):
                dx_m, dy_m = (col + 0.5) * cell_m - x_m, (row + 0.5) * cell_m - y_m
                ahead_m = max(abs(dx_m * cos + dy_m * sin) - packed[i, 5], 0.0)
                aside_m = max(abs(dy_m * cos - dx_m * sin) - packed[i, 6], 0.0)
                if ahead_m * ahead_m + aside_m * aside_m < radius_m * radius_m:
                    near[row, col] = True
    return near


def spine_of(
    half_length: float, half_width: float, offset: tuple[float, float]
) -> tuple[npt.NDArray[np.float64], float]:
    """Return points (K, 2) on a box's long axis, the ends first, and the radius of their discs.

    The discs lie in the box; `offset` is its centre, all lengths are in one unit.
    """
    radius = min(half_length, half_width)
    reach = max(half_length, half_width) - radius
    along = reach * np.array([-1.0, 1.0, 0.0, -0.5, 0.5] if reach > 0.0 else [0.0])
    zeros = np.zeros_like(along)
    points = (along, zeros) if half_length >= half_width else (zeros, along)
    return np.column_stack(points) + offset, radius


def needed_cells(radius_cells: float) -> float:
    """Return the least clearance between centres that leaves room for a disc (a lower bound)."""
    return radius_cells - _SLACK_CELLS


@dataclass(frozen=True, eq=False)
class PlacementConstraints:
    """What an arrival keeps away from, in the map frame.

    `others` are the boxes of the other artefacts. `keep_out` are footprints, each with a distance
    [m]: a robot at its pose, or a goal as a footprint of one vertex. `allowed` may refuse more: it
    tells for N boxes which may stand there, bool (N,). `within` is a disc (x, y, radius) [m] for
    F_A's point on the ground.
    """

    others: OrientedBoxes = field(default_factory=OrientedBoxes.empty)
    keep_out: tuple[tuple[Footprint, float], ...] = ()
    allowed: Callable[[OrientedBoxes], npt.NDArray[np.bool_]] | None = None
    within: tuple[float, float, float] | None = None

    def are_clear(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell which boxes keep away from the others and the footprints: bool (N,)."""
        clear = ~overlaps_any(boxes, self.others)
        for footprint, distance_m in self.keep_out:
            left = boxes.take(clear)  # distances take the most time
            clear[clear] = signed_distance_m(footprint, left) >= distance_m
        return clear

    def are_allowed(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell which boxes `allowed` does not refuse: bool (N,)."""
        if self.allowed is None or not len(boxes):
            return np.ones(len(boxes), np.bool_)
        return self.allowed(boxes)

    def are_within(self, poses: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        """Tell which poses (N, >= 2) lie in the closed disc `within`, if given: bool (N,)."""
        if self.within is None:
            return np.ones(len(poses), np.bool_)
        x_m, y_m, radius_m = self.within
        return np.hypot(poses[:, 0] - x_m, poses[:, 1] - y_m) <= radius_m


HEADINGS: Final = 16
"""Headings of the lattice that is searched where drawing at random found nothing."""
LATTICE_CELLS: Final = 1 << 18
_PITCH_M: Final = 0.05

_Cells = npt.NDArray[np.int32]
_Poses = npt.NDArray[np.int64]
"""Lattice poses as numbers: (row * width + col) * `HEADINGS` + heading."""
_Floats = npt.NDArray[np.float64]
_Mask = npt.NDArray[np.bool_]


def lattice_cells(grid: OccupancyGrid, flat: _Cells) -> _Cells:
    """Return those of the cells (N,) that are on the lattice: all, or every n-th row and column."""
    if 2 * flat.size <= LATTICE_CELLS:
        return flat
    at_pitch = int(_PITCH_M / grid.resolution_m + 1e-6)
    stride = max(1, at_pitch, math.ceil(math.sqrt(flat.size / LATTICE_CELLS)))
    rows, cols = flat // grid.width, flat % grid.width
    is_on = (rows % stride == stride // 2) & (cols % stride == stride // 2)
    return np.compress(is_on, flat)


def _centres_m(grid: OccupancyGrid, flat: _Cells | _Poses) -> _Floats:
    """Return the centres (N, 2) of cells (N,), row * width + col, in the map frame."""
    return grid.cells_to_points(np.column_stack((flat // grid.width, flat % grid.width)))


def lattice_poses(grid: OccupancyGrid, numbers: _Poses) -> _Floats:
    """Return poses (N, 4), x, y, 0, yaw in the map frame, by their numbers (N,)."""
    flat, heading = numbers // HEADINGS, numbers % HEADINGS
    poses = np.zeros((flat.size, 4))
    poses[:, :2] = _centres_m(grid, flat)
    poses[:, 3] = grid.origin.yaw_rad() + heading * (math.tau / HEADINGS)
    return poses


class PlacementQuery(NamedTuple):
    """One search for a pose: of which row, under which constraints, and how it has to depart.

    Without a `departure` the artefact need not be able to leave the pose.
    """

    row: CatalogueRow
    around: PlacementConstraints
    departure: DepartureConstraint | None = None

    @property
    def key(self) -> tuple[float, ...]:
        """What decides, of all this, where the static map has room."""
        row, departure = self.row, self.departure
        shape = (*row.size_m, *row.box_centre_in_artefact_m[:2])
        return shape if departure is None else shape + departure.key

    @property
    def radius_m(self) -> float:
        """Radius of a disc about F_A that is clear of walls at every such pose."""
        return _inscribed_radius_m(self.row) if self.departure is None else self.departure.radius_m


def _inscribed_radius_m(row: CatalogueRow) -> float:
    """Return the radius of the largest disc about F_A within the box's footprint, at least 0."""
    offset_x_m, offset_y_m, _ = row.box_centre_in_artefact_m
    room_x_m = 0.5 * row.size_m[0] - abs(offset_x_m)
    room_y_m = 0.5 * row.size_m[1] - abs(offset_y_m)
    return max(0.0, min(room_x_m, room_y_m))


_BATCHES: Final = (32, 256, 1024, 4096)
_FEW: Final = 4
"""The first poses of a batch are tested on their own: mostly one of them is feasible."""
_CHUNK_CELLS: Final = 1 << 11
_CHUNK_POSES: Final = 1 << 14
_KEPT_POSES: Final = LATTICE_CELLS * HEADINGS
_OVERLAP_M: Final = 1e-6
"""Boxes that overlap by less, as far as discs in them tell, are compared exactly."""


class _Static(NamedTuple):
    """The lattice poses of a footprint that the static map allows, and those not yet checked."""

    allowed: _Poses
    unchecked: _Poses

    @property
    def size(self) -> int:
        """The number of both."""
        return self.allowed.size + self.unchecked.size


class Placer:
    """Draws poses in one environment and one spawn region of it.

    A pose is feasible if F_A's point on the ground lies in the region, the box covers free cells
    only and hits no wall, and the constraints leave room for it. Poses are uniform over the
    feasible ones (position continuous, heading in [-pi, pi)), or by the region's weights.

    An artefact that can move has a `DepartureConstraint`. It is placed, by the same law, among the
    feasible poses that meet it; only if none is found, among all feasible poses.

    At most some thousand poses are drawn. Then a lattice decides: cell centres times `HEADINGS`
    headings. (Where more than 2**17 cells have room, it has every n-th row and column, 5 cm apart
    or more, so that about 2**18 cells remain.) The pose is uniform, or by weight, over the feasible
    poses of the lattice; None if there is none. What the static map decides there is kept per
    footprint; each search adds some thousand poses.
    """

    def __init__(
        self, environment: Environment, region: SpawnRegion, terrains: Terrains | None = None
    ) -> None:
        self._environment = environment
        self._region = region
        self._terrains = terrains or Terrains()
        self._grid = environment.grid
        resolution_m = environment.grid.resolution_m
        self._lattice = lattice_row(environment.grid.origin, resolution_m, resolution_m)
        self._static: dict[tuple[float, ...], _Static] = {}
        self._departures: dict[CatalogueRow, DepartureConstraint | None] = {}
        self._roomy: dict[float, CandidateCells] = {}
        self._taken_of: tuple[CatalogueRow | None, OrientedBoxes | None] = None, None
        self._taken: dict[float, _Mask] = {}
        """The cells taken for the last row among the last others, by `away_cells`."""

    def place(
        self,
        row: CatalogueRow,
        generator: np.random.Generator,
        constraints: PlacementConstraints | None = None,
    ) -> GroundPose | None:
        """Draw a feasible pose for an artefact of this row, None if the lattice has none.

        All draws come from `generator`; their number depends only on this artefact's attempts.
        """
        around = constraints or PlacementConstraints()
        query = PlacementQuery(row, around)
        static = self._static.get(query.key)
        if static is not None and not static.size:
            return None
        cells = self._cells if around.within is None else self._cells_near(*around.within)
        departure = self._departure_of(row)
        pose = None
        if departure is not None:
            pose = self._found(PlacementQuery(row, around, departure), cells, generator)
        return pose or self._found(query, cells, generator)

    def _departure_of(self, row: CatalogueRow) -> DepartureConstraint | None:
        """Return the constraint of a row; None too where no place on the map meets it."""
        if row not in self._departures:
            departure = departure_constraint_of(
                row, self._environment, self._terrains, self._region.mask
            )
            self._departures[row] = departure if departure and departure.is_anywhere else None
        return self._departures[row]

    def _found(
        self, query: PlacementQuery, cells: CandidateCells, generator: np.random.Generator
    ) -> GroundPose | None:
        """Draw some thousands of poses, then search the lattice, unless that would take long."""
        cells = self._with_room(cells, query.radius_m)
        if not cells.flat.size:
            return None
        free: _Mask | None = None
        for size in _BATCHES:
            uniforms = generator.random((size, 4))
            flat = cells.draw(uniforms[:, 0])
            if size > _BATCHES[0]:  # where it is crowded: most poses are taken
                free = ~self._taken_cells(query, 0.5 * math.sqrt(2.0)) if free is None else free
                left = free.ravel()[flat]
                uniforms, flat = uniforms[left], flat[left]
            poses = poses_in_cells(flat, self._grid.width, uniforms, self._lattice)
            for piece in (poses[:_FEW], poses[_FEW:]):
                found = self._first_feasible(query, piece)
                if found is not None:
                    return found
        is_searched = query.departure is None or query.departure.is_searched_for
        return self._searched(query, cells, generator) if is_searched else None

    def _with_room(self, cells: CandidateCells, radius_m: float) -> CandidateCells:
        """Return the cells that may have room for a disc; the result for all cells is kept."""
        known = self._roomy.get(radius_m) if cells is self._cells else None
        if known is None:
            known = cells.with_room(radius_m / self._grid.resolution_m)
            if cells is self._cells:
                self._roomy[radius_m] = known
        return known

    def _first_feasible(self, query: PlacementQuery, poses: _Floats) -> GroundPose | None:
        """Return the first of the poses (N, 4) that is feasible, None if none is.

        Expensive tests get one pose first, then ever more: mostly the first one passes.
        """
        if query.departure is not None:
            poses = poses[query.departure.is_free_at(poses)]
        boxes, heights_m = self._standing(query.row, poses)
        is_allowed = self._environment.is_placeable(boxes) & query.around.are_within(poses)
        allowed = np.flatnonzero(is_allowed)
        start, size = 0, 1
        while start < allowed.size:
            piece = allowed[start : start + size]
            piece = piece[query.around.are_clear(boxes.take(piece))]
            piece = piece[query.around.are_allowed(boxes.take(piece))]
            if query.departure is not None:  # last, as it takes the most time
                piece = piece[query.departure.leads_out(poses[piece])]
            if piece.size:
                return _ground_pose(poses[piece[0]], heights_m[piece[0]])
            start, size = start + size, 4 * size
        return None

    def _standing(self, row: CatalogueRow, poses: _Floats) -> tuple[OrientedBoxes, _Floats]:
        """Return the boxes at poses (N, 4), x, y, 0, yaw, on the ground, and its heights (N,)."""
        shape = np.array([shape_of(row)])
        flat = OrientedBoxes.standing(poses, shape)
        heights_m = self._environment.ground_heights_m(flat)
        if not heights_m.any():
            return flat, heights_m
        x_m, y_m, _, yaws_rad = poses.T
        ground = np.column_stack((x_m, y_m, heights_m, yaws_rad))
        return OrientedBoxes.standing(ground, shape), heights_m

    def _searched(
        self, query: PlacementQuery, cells: CandidateCells, generator: np.random.Generator
    ) -> GroundPose | None:
        """Search the lattice: each feasible pose draws an exponential clock, the first one wins."""
        best: tuple[float, _Floats, float] | None = None
        for piece, is_checked in self._lattice_poses(query, cells):
            poses = lattice_poses(self._grid, piece)
            found, heights_m = self._feasible(query, poses, is_checked=is_checked)
            weights = self._weights(piece[found] // HEADINGS)
            clocks = generator.standard_exponential(found.size) / weights
            first = int(np.argmin(clocks)) if found.size else -1
            if first >= 0 and (best is None or clocks[first] < best[0]):
                best = (float(clocks[first]), poses[found[first]], heights_m[found[first]])
        return None if best is None else _ground_pose(best[1], best[2])

    def _feasible(
        self, query: PlacementQuery, poses: _Floats, *, is_checked: bool
    ) -> tuple[_Poses, _Floats]:
        """Return the indices of the feasible poses, and the ground's height (N,) under all.

        The other artefacts are tested before the map, as the lattice is searched where it is
        crowded. Poses that are checked are allowed by the map already.
        """
        boxes, heights_m = self._standing(query.row, poses)
        found = np.flatnonzero(query.around.are_clear(boxes) & query.around.are_within(poses))
        if not is_checked:
            found = found[self._environment.is_placeable(boxes.take(found))]
        return found[query.around.are_allowed(boxes.take(found))], heights_m

    def _lattice_poses(
        self, query: PlacementQuery, cells: CandidateCells
    ) -> Iterator[tuple[_Poses, bool]]:
        """Yield pieces of the lattice with all feasible poses, and if the map allows each.

        Poses where a disc in the box already meets another artefact are left out.
        """
        taken = self._taken_cells(query).ravel()
        if query.around.within is not None:
            for piece in self._scan(query, lattice_cells(self._grid, cells.flat), taken):
                yield piece, False
            return
        known = self._static.get(query.key)
        if known is None:
            flat = lattice_cells(self._grid, cells.flat)
            if 2 * np.count_nonzero(taken[flat]) > flat.size:  # less work than to know them all
                for piece in self._scan(query, flat, taken):
                    yield piece, False
                return
            pieces = [np.empty(0, np.int64), *self._scan(query, flat)]
            known = _Static(np.empty(0, np.int64), np.concatenate(pieces))
        known = self._checked_on(query, known)
        self._remember(query.key, known)
        for poses, is_checked in ((known.allowed, True), (known.unchecked, False)):
            left = poses[~taken[poses // HEADINGS]]
            for start in range(0, left.size, _CHUNK_POSES):
                yield left[start : start + _CHUNK_POSES], is_checked

    def _taken_cells(self, query: PlacementQuery, away_cells: float = 0.0) -> _Mask:
        """Tell at which cells (H, W) the box, however turned, overlaps another artefact.

        It stands at the centre of the cell, or up to `away_cells` from there. A sufficient
        condition: the disc in it meets another box by some 1e-6 m, and so do the heights, wherever
        on the map the ground is.
        """
        row, others = query.row, query.around.others
        if row is not self._taken_of[0] or others is not self._taken_of[1]:
            self._taken_of, self._taken = (row, others), {}
        if away_cells not in self._taken:  # an arrival without a place asks up to eight times
            self._taken[away_cells] = self._find_taken_cells(query, away_cells)
        return self._taken[away_cells]

    def _find_taken_cells(self, query: PlacementQuery, away_cells: float) -> _Mask:
        """Compute `_taken_cells`."""
        away_m = away_cells * self._grid.resolution_m
        radius_m = _inscribed_radius_m(query.row) - away_m - _OVERLAP_M
        packed, half_height_m = query.around.others.packed, 0.5 * query.row.size_m[2]
        ground = self._environment.ground
        centres_m = np.array([[ground.lowest_m()], [ground.highest_m()]]) + half_height_m
        apart_m = np.abs(packed[:, 2] - centres_m).max(axis=0)
        is_level = packed[:, 7] + half_height_m - apart_m > _OVERLAP_M
        return cells_near_boxes(self._region.mask.shape, packed[is_level], self._lattice, radius_m)

    def _checked_on(self, query: PlacementQuery, known: _Static) -> _Static:
        """Check some thousand more poses of a footprint; all would take longer than the search."""
        piece = known.unchecked[:_CHUNK_POSES]
        boxes, _ = self._standing(query.row, lattice_poses(self._grid, piece))
        allowed = piece[self._environment.is_placeable(boxes)]
        allowed = np.concatenate((known.allowed, allowed))
        return _Static(allowed, known.unchecked[_CHUNK_POSES:])

    def _remember(self, key: tuple[float, ...], static: _Static) -> None:
        """Keep the poses. If there are too many, forget those of other footprints that have any."""
        if static.size + sum(known.size for known in self._static.values()) > _KEPT_POSES:
            self._static = {none: known for none, known in self._static.items() if not known.size}
        self._static[key] = static

    def _scan(
        self, query: PlacementQuery, flat: _Cells, taken: _Mask | None = None
    ) -> Iterator[_Poses]:
        """Yield the lattice poses over some cells that the static map may allow.

        Those of the cells that are `taken`, bool (H * W,), are left out.
        """
        row, departure = query.row, query.departure
        flat = flat if taken is None else flat[~taken[flat]]
        resolution_m = self._grid.resolution_m
        half_m = (0.5 * row.size_m[0], 0.5 * row.size_m[1])
        spine_m, radius_m = spine_of(*half_m, row.box_centre_in_artefact_m[:2])
        angles = np.arange(HEADINGS) * (math.tau / HEADINGS)
        turns = np.column_stack((np.cos(angles), np.sin(angles)))
        least = needed_cells(radius_m / resolution_m)
        for start in range(0, flat.size, _CHUNK_CELLS):
            piece = flat[start : start + _CHUNK_CELLS]
            if departure is not None:
                piece = piece[departure.is_free_at(_centres_m(self._grid, piece))]
            yield spines_are_clear(
                piece, self._clearance_cells, spine_m / resolution_m, turns, least
            )

    def _weights(self, flat: _Cells | _Poses) -> _Floats:
        if self._region.weight is None:
            return np.ones(flat.size)
        return self._region.weight.ravel()[flat].astype(np.float64)

    @cached_property
    def _clearance_cells(self) -> npt.NDArray[np.float32]:
        clearance_m = self._environment.clearance_m
        return np.divide(clearance_m, self._grid.resolution_m, dtype=np.float32)

    @cached_property
    def _cells(self) -> CandidateCells:
        return self._ordered(np.flatnonzero(self._region.mask))

    def _ordered(self, flat: _Poses) -> CandidateCells:
        clearance_m = self._environment.clearance_m.ravel().take(flat)
        clearance_cells = np.divide(clearance_m, self._grid.resolution_m, dtype=np.float32)
        cells = CandidateCells.ordered(flat.astype(np.int32), clearance_cells)
        if self._region.weight is None:
            return cells
        return replace(cells, cumulative=np.cumsum(self._weights(cells.flat)))

    def _cells_near(self, x_m: float, y_m: float, radius_m: float) -> CandidateCells:
        """Return the region's cells that meet a disc, and perhaps some beside it."""
        centre = self._grid.points_to_cells(np.array([(x_m, y_m)]))[0]
        reach = math.ceil(radius_m / self._grid.resolution_m) + 1
        low = np.clip(centre - reach, 0, self._region.mask.shape)
        high = np.clip(centre + reach + 1, 0, self._region.mask.shape)
        rows, cols = np.nonzero(self._region.mask[low[0] : high[0], low[1] : high[1]])
        return self._ordered((rows + low[0]) * self._grid.width + cols + low[1])


def _ground_pose(pose: _Floats, height_m: float) -> GroundPose:
    return GroundPose(float(pose[0]), float(pose[1]), float(height_m), float(pose[3]))
