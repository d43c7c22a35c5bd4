"""Placement: uniform over the feasible poses of an artefact (section 3.2)."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.artefacts._candidates import (
    CandidateCells,
    needed_cells,
    poses_in_cells,
    spine_of,
    spines_are_clear,
)
from are_ros.artefacts._leeway import Leeway, leeway_of
from are_ros.artefacts.artefact import GroundPose, shape_of
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.terrain import Terrains
from are_ros.world.boxes import OrientedBoxes, overlaps_any
from are_ros.world.environment import Environment
from are_ros.world.footprint import Footprint, signed_distance_m
from are_ros.world.lattice_cover import lattice_row
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.regions import SpawnRegion


@dataclass(frozen=True, eq=False)
class KeepOut:
    """A shape on the ground, in the map frame, that stays `distance_m` away from artefacts.

    A robot is its footprint at its pose; a goal is a footprint of one vertex.
    """

    footprint: Footprint
    distance_m: float


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What moves: the boxes of the other artefacts, and what they keep away from.

    `allowed` may refuse more: it tells for N boxes which may stand there, bool (N,).
    """

    others: OrientedBoxes = field(default_factory=OrientedBoxes.empty)
    keep_out: tuple[KeepOut, ...] = ()
    allowed: Callable[[OrientedBoxes], npt.NDArray[np.bool_]] | None = None

    def leave_room_for(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell which boxes are clear of all that, each on its own: bool (N,)."""
        clear = self.are_clear(boxes)
        clear[clear] = self.are_allowed(boxes.take(clear))
        return clear

    def are_clear(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell which boxes keep away from the others, robots and goals: bool (N,)."""
        clear = ~overlaps_any(boxes, self.others)
        for keep in self.keep_out:
            left = boxes.take(clear)  # distances take the most time
            clear[clear] = signed_distance_m(keep.footprint, left) >= keep.distance_m
        return clear

    def are_allowed(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell which boxes `allowed` does not refuse: bool (N,)."""
        if self.allowed is None or not len(boxes):
            return np.ones(len(boxes), np.bool_)
        return self.allowed(boxes)


@dataclass(frozen=True)
class Disc:
    """The points within `radius_m` of (x, y) in the map frame."""

    x_m: float
    y_m: float
    radius_m: float

    def contains(self, points_m: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        """Tell which of the points (N, 2) lie in the closed disc: bool (N,)."""
        return np.hypot(points_m[:, 0] - self.x_m, points_m[:, 1] - self.y_m) <= self.radius_m


HEADINGS: Final = 16
"""Headings of the lattice that is searched where drawing at random found nothing."""
LATTICE_CELLS: Final = 1 << 18
_PITCH_M: Final = 0.05

_Cells = npt.NDArray[np.int32]
_Poses = npt.NDArray[np.int64]
_Floats = npt.NDArray[np.float64]


class PoseLattice:
    """Poses of one grid as numbers: (row * width + col) * `HEADINGS` + heading."""

    def __init__(self, grid: OccupancyGrid) -> None:
        self._grid = grid
        self._grid_yaw_rad = grid.origin.yaw_rad()

    def thinned(self, flat: _Cells) -> _Cells:
        """Return the cells (N,) on the lattice: all, or of very many every n-th row and column."""
        if 2 * flat.size <= LATTICE_CELLS:
            return flat
        at_pitch = int(_PITCH_M / self._grid.resolution_m + 1e-6)
        stride = max(1, at_pitch, math.ceil(math.sqrt(flat.size / LATTICE_CELLS)))
        rows, cols = flat // self._grid.width, flat % self._grid.width
        is_on = (rows % stride == stride // 2) & (cols % stride == stride // 2)
        return np.compress(is_on, flat)

    def poses(self, numbers: _Poses) -> _Floats:
        """Return poses (N, 4), x, y, 0, yaw in the map frame, by their numbers (N,)."""
        flat, heading = numbers // HEADINGS, numbers % HEADINGS
        poses = np.zeros((flat.size, 4))
        poses[:, :2] = self.centres_m(flat)
        poses[:, 3] = self._grid_yaw_rad + heading * (math.tau / HEADINGS)
        return poses

    def centres_m(self, flat: _Cells | _Poses) -> _Floats:
        """Return the centres (N, 2) of cells (N,), row * width + col, in the map frame."""
        cells = np.column_stack((flat // self._grid.width, flat % self._grid.width))
        return self._grid.cells_to_points(cells)


@dataclass(frozen=True, eq=False)
class Sought:
    """What a pose is sought for: a row, what is about it, a disc to be in, room to set out.

    Without a `leeway` the artefact need not be able to set out from there.
    """

    row: CatalogueRow
    around: Surroundings
    within: Disc | None
    leeway: Leeway | None

    @property
    def key(self) -> tuple[float, ...]:
        """What decides, of all this, where the static map has room."""
        row, leeway = self.row, self.leeway
        shape = (*row.size_m, *row.box_centre_in_artefact_m[:2])
        return shape if leeway is None else shape + leeway.key

    @property
    def radius_m(self) -> float:
        """Radius of a disc about F_A that is clear of walls in every pose sought."""
        return _inscribed_radius_m(self.row) if self.leeway is None else self.leeway.radius_m

    def leading_out(
        self, poses: npt.NDArray[np.float64], which: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.int64]:
        """Return those indices, of some, of poses (N, 4), x, y, 0, yaw, that lead out."""
        return which if self.leeway is None else which[self.leeway.leads_out(poses[which])]


def _inscribed_radius_m(row: CatalogueRow) -> float:
    """Return the radius of the largest disc about F_A within the box's footprint, at least 0."""
    offset_x_m, offset_y_m, _ = row.box_centre_in_artefact_m
    room_x_m = 0.5 * row.size_m[0] - abs(offset_x_m)
    room_y_m = 0.5 * row.size_m[1] - abs(offset_y_m)
    return max(0.0, min(room_x_m, room_y_m))


_BATCHES: Final = (32, 256, 1024, 4096)
_FEW: Final = 4
"""So many of a batch are looked at first: mostly one of them is feasible."""
_CHUNK_CELLS: Final = 1 << 11
_CHUNK_POSES: Final = 1 << 14
_KEPT_POSES: Final = LATTICE_CELLS * HEADINGS


class _Static(NamedTuple):
    """The lattice poses of a footprint that the static map allows, and those it may allow."""

    allowed: _Poses
    unchecked: _Poses

    @property
    def size(self) -> int:
        """How many there are of both."""
        return self.allowed.size + self.unchecked.size


class Placer:
    """Draws poses in one environment and one spawn region of it.

    A pose is feasible if F_A's point on the ground lies in the region, the box covers free cells
    only and hits no wall, and the surroundings leave room for it. Poses are uniform over the
    feasible ones (position continuous, heading in [-pi, pi)), or by the region's weights.

    What turns on the spot could hardly leave a place where the disc that it sweeps meets a closed
    cell, and a vehicle none where its first metres do, straight or at full lock, or no way leads
    on. It is placed, by the same law, among the feasible poses from which it can set out
    (`Leeway`); only if what is said below finds none of these, for vehicles without the lattice,
    among all feasible ones.

    Poses are drawn until one is feasible, some thousands at most. Then a lattice decides: the
    centres of cells times `HEADINGS` headings. (Where more than 2**17 cells have room, it takes
    every n-th row and column, 5 cm apart, or so many that at most about 2**18 remain.) The pose
    is uniform, or by weight, over those that are feasible; None only if none is. What the static
    map alone decides there is remembered per footprint, some thousand poses more at each search.
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
        self._poses = PoseLattice(environment.grid)
        self._static: dict[tuple[float, ...], _Static] = {}
        self._leeways: dict[CatalogueRow, Leeway | None] = {}
        self._roomy: dict[float, CandidateCells] = {}

    def place(
        self,
        row: CatalogueRow,
        generator: np.random.Generator,
        surroundings: Surroundings | None = None,
        within: Disc | None = None,
    ) -> GroundPose | None:
        """Draw a feasible pose for an artefact of this row, None if the lattice holds none.

        `within` restricts its point on the ground. All draws come from `generator`; how many
        depends on nothing but this artefact's own attempts.
        """
        around = surroundings or Surroundings()
        sought = Sought(row, around, within, None)
        static = self._static.get(sought.key)
        if static is not None and not static.size:
            return None
        cells = self._cells if within is None else self._cells_near(within)
        leeway = self._leeway_of(row)
        pose = None
        if leeway is not None:
            pose = self._found(Sought(row, around, within, leeway), cells, generator)
        return pose or self._found(sought, cells, generator)

    def _leeway_of(self, row: CatalogueRow) -> Leeway | None:
        """Return what a row's artefacts need to set out; None too where the map has it nowhere."""
        if row not in self._leeways:
            leeway = leeway_of(row, self._environment, self._terrains, self._region.mask)
            self._leeways[row] = leeway if leeway and leeway.is_anywhere else None
        return self._leeways[row]

    def _found(
        self, sought: Sought, cells: CandidateCells, generator: np.random.Generator
    ) -> GroundPose | None:
        """Draw some thousands of poses, then search the lattice, unless that would take long."""
        cells = self._with_room(cells, sought.radius_m)
        if not cells.flat.size:
            return None
        for size in _BATCHES:
            poses = self._drawn(cells, generator.random((size, 4)))
            for piece in (poses[:_FEW], poses[_FEW:]):
                found = self._first_feasible(sought, piece)
                if found is not None:
                    return found
        is_searched = sought.leeway is None or sought.leeway.is_searched_for
        return self._searched(sought, cells, generator) if is_searched else None

    def _with_room(self, cells: CandidateCells, radius_m: float) -> CandidateCells:
        """Return the cells that may have room for a disc; of all cells, once for each radius."""
        known = self._roomy.get(radius_m) if cells is self._cells else None
        if known is None:
            known = cells.with_room(radius_m / self._grid.resolution_m)
            if cells is self._cells:
                self._roomy[radius_m] = known
        return known

    def _drawn(self, cells: CandidateCells, uniforms: _Floats) -> _Floats:
        """Return poses (N, 4), x, y, 0, yaw in the map frame, from uniform numbers (N, 4)."""
        flat = cells.draw(uniforms[:, 0])
        return poses_in_cells(flat, self._grid.width, uniforms, self._lattice)

    def _first_feasible(self, sought: Sought, poses: _Floats) -> GroundPose | None:
        """Return the first feasible one of poses (N, 4), None if none is.

        What moves is asked about few at once: mostly the first that the map allows is free.
        """
        if sought.leeway is not None:
            poses = poses[sought.leeway.is_free_at(poses)]
        boxes, heights_m = self._standing(sought.row, poses)
        allowed = self._allowed_by_map(sought, boxes, poses)
        start, size = 0, 1
        while start < allowed.size:
            piece = allowed[start : start + size]
            piece = piece[sought.around.leave_room_for(boxes.take(piece))]
            free = sought.leading_out(poses, piece)  # last, as it takes the most time
            if free.size:
                first = free[0]
                return _ground_pose(poses[first], heights_m[first])
            start, size = start + size, 4 * size
        return None

    def _allowed_by_map(
        self, sought: Sought, boxes: OrientedBoxes, poses: _Floats
    ) -> npt.NDArray[np.int64]:
        """Return the indices of the poses that the map, and the disc to be in, leave."""
        allowed = self._environment.is_placeable(boxes)
        if sought.within is not None:
            allowed &= sought.within.contains(poses)
        return np.flatnonzero(allowed)

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
        self, sought: Sought, cells: CandidateCells, generator: np.random.Generator
    ) -> GroundPose | None:
        """Visit the whole lattice; the feasible pose with the least exponential clock wins."""
        best: tuple[float, _Floats, float] | None = None
        for piece, is_checked in self._lattice_poses(sought, cells):
            poses = self._poses.poses(piece)
            found, heights_m = self._feasible(sought, poses, is_checked=is_checked)
            weights = self._weights(piece[found] // HEADINGS)
            clocks = generator.standard_exponential(found.size) / weights
            first = int(np.argmin(clocks)) if found.size else -1
            if first >= 0 and (best is None or clocks[first] < best[0]):
                best = (float(clocks[first]), poses[found[first]], heights_m[found[first]])
        return None if best is None else _ground_pose(best[1], best[2])

    def _feasible(
        self, sought: Sought, poses: _Floats, *, is_checked: bool
    ) -> tuple[_Poses, _Floats]:
        """Return the indices of the feasible poses, and the ground's height (N,) under all.

        The map is asked about those only that the others leave, and not of poses that are checked:
        where the lattice is searched it is crowded.
        """
        boxes, heights_m = self._standing(sought.row, poses)
        left = sought.around.are_clear(boxes)
        if sought.within is not None:
            left &= sought.within.contains(poses)
        found = np.flatnonzero(left)
        if not is_checked:
            found = found[self._environment.is_placeable(boxes.take(found))]
        return found[sought.around.are_allowed(boxes.take(found))], heights_m

    def _lattice_poses(
        self, sought: Sought, cells: CandidateCells
    ) -> Iterator[tuple[_Poses, bool]]:
        """Yield, in pieces, lattice poses, all that the map allows among them; whether all are."""
        if sought.within is not None:
            yield from ((piece, False) for piece in self._scan(sought, cells))
            return
        known = self._static.get(sought.key)
        if known is None:
            pieces = [np.empty(0, np.int64), *self._scan(sought, cells)]
            known = _Static(np.empty(0, np.int64), np.concatenate(pieces))
        known = self._checked_on(sought, known)
        self._remember(sought.key, known)
        for poses, is_checked in ((known.allowed, True), (known.unchecked, False)):
            for start in range(0, poses.size, _CHUNK_POSES):
                yield poses[start : start + _CHUNK_POSES], is_checked

    def _checked_on(self, sought: Sought, known: "_Static") -> "_Static":
        """Return what is known of a footprint's poses once the map is asked about some more.

        All at once would take longer than the search itself.
        """
        piece = known.unchecked[:_CHUNK_POSES]
        boxes, _ = self._standing(sought.row, self._poses.poses(piece))
        allowed = piece[self._environment.is_placeable(boxes)]
        allowed = np.concatenate((known.allowed, allowed))
        return _Static(allowed, known.unchecked[_CHUNK_POSES:])

    def _remember(self, key: tuple[float, ...], static: "_Static") -> None:
        """Keep the poses; of others only that there are none, if all together are too many."""
        if static.size + sum(known.size for known in self._static.values()) > _KEPT_POSES:
            self._static = {none: known for none, known in self._static.items() if not known.size}
        self._static[key] = static

    def _scan(self, sought: Sought, cells: CandidateCells) -> Iterator[_Poses]:
        """Yield the lattice poses over some cells that the static map may allow."""
        row, leeway, flat = sought.row, sought.leeway, self._poses.thinned(cells.flat)
        resolution_m = self._grid.resolution_m
        half_m = (0.5 * row.size_m[0], 0.5 * row.size_m[1])
        spine_m, radius_m = spine_of(*half_m, row.box_centre_in_artefact_m[:2])
        angles = np.arange(HEADINGS) * (math.tau / HEADINGS)
        turns = np.column_stack((np.cos(angles), np.sin(angles)))
        least = needed_cells(radius_m / resolution_m)
        for start in range(0, flat.size, _CHUNK_CELLS):
            piece = flat[start : start + _CHUNK_CELLS]
            if leeway is not None:
                piece = piece[leeway.is_free_at(self._poses.centres_m(piece))]
            yield spines_are_clear(
                piece, self._clearance_cells, spine_m / resolution_m, turns, least
            )

    def _weights(self, flat: _Poses) -> _Floats:
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
        clearance_cells = self._clearance_cells.ravel()[flat]
        weights = None if self._region.weight is None else self._weights(flat)
        return CandidateCells.ordered(flat.astype(np.int32), clearance_cells, weights)

    def _cells_near(self, disc: Disc) -> CandidateCells:
        """Return the region's cells that meet the disc, and perhaps some beside it."""
        centre = self._grid.points_to_cells(np.array([(disc.x_m, disc.y_m)]))[0]
        reach = math.ceil(disc.radius_m / self._grid.resolution_m) + 1
        low = np.clip(centre - reach, 0, self._region.mask.shape)
        high = np.clip(centre + reach + 1, 0, self._region.mask.shape)
        rows, cols = np.nonzero(self._region.mask[low[0] : high[0], low[1] : high[1]])
        return self._ordered((rows + low[0]) * self._grid.width + cols + low[1])


def _ground_pose(pose: _Floats, height_m: float) -> GroundPose:
    return GroundPose(float(pose[0]), float(pose[1]), float(height_m), float(pose[3]))
