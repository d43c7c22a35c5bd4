"""Placement: a pose for an arrival, uniform over the feasible poses (section 3.2).

`Placer` draws random poses until one is feasible. It prefers poses from which the artefact can
depart: a body that rotates on the spot needs a free disc; a vehicle needs free space that is
connected over some metres, and a free first arc, for between two walls it could never move.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.agents.behaviours.situation import Standing
from are_ros.agents.local_planner.body import TIGHTEST, Body
from are_ros.agents.mdp.coarse_kernels import exact_room
from are_ros.agents.mdp.coarse_map import rounded_up_m
from are_ros.agents.navigation.destinations import APART_M
from are_ros.agents.navigation.profile import NavigationProfile
from are_ros.agents.navigation.terrain import Terrain, Terrains, rolls
from are_ros.population.artefact import GroundPose, shape_of
from are_ros.population.catalogue import CatalogueRow
from are_ros.world.boxes import TOUCH_TOLERANCE_M, OrientedBoxes, overlaps_any
from are_ros.world.environment import Environment
from are_ros.world.footprint import Footprint, signed_distance_m
from are_ros.world.lattice_cover import TWO_HALF_DIAGONALS, lattice_row, meets
from are_ros.world.regions import SpawnRegion

_Mask = npt.NDArray[np.bool_]
_Floats = npt.NDArray[np.float64]

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
        cls,
        flat: npt.NDArray[np.int32],
        clearance_cells: npt.NDArray[np.float32],
        weights: npt.NDArray[np.float64] | None,
    ) -> "CandidateCells":
        """Order cells (N,) with their clearance in cells (N,) and their weights (N,)."""
        levels = np.minimum(clearance_cells * _LEVELS_PER_CELL, _HIGHEST_LEVEL).astype(np.int64)
        depths = (_HIGHEST_LEVEL - levels).astype(np.uint16)
        order = np.argsort(depths, kind="stable")
        cumulative = None if weights is None else np.cumsum(weights[order])
        return cls(flat[order], depths[order], cumulative)

    def with_room(self, radius_cells: float) -> "CandidateCells":
        """Return the cells with a point about which a disc may be clear (a superset)."""
        level = math.floor((radius_cells - _SLACK_CELLS) * _LEVELS_PER_CELL)
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


FIRST_TURN_RAD: Final = 1.0
"""Angle of the first arc at full steering lock; the straight one has the same length."""

LEAST_PART_M: Final = APART_M + 1.0
"""A smaller part of the map has no two destinations far enough apart for a trip."""

_HALF_CELL: Final = 0.5
_CERTAIN_HIT: Final = 0.25
"""As in `terrain.rolls` [cells]."""
_HIT: Final = -1.0


class DepartureConstraint:
    """Tells from which poses an artefact can depart, according to the static map.

    The disc of `radius_m` about F_A is free: a body that rotates on the spot sweeps it. `region`
    bool (H, W) are the cells that the artefact may be in.
    """

    def __init__(self, terrain: Terrain, radius_m: float, region: _Mask) -> None:
        self.radius_m = radius_m
        self._terrain = terrain
        self._region = region

    @cached_property
    def is_anywhere(self) -> bool:
        """Whether any place of the map meets the constraint."""
        field, unit_m = self._terrain.clearance_m, self._terrain.grid.resolution_m
        return bool((exact_room(field, self.radius_m, unit_m)[self._region] > 0.0).any())

    def is_free_at(self, points_m: _Floats) -> _Mask:
        """Tell at which points (N, >= 2) the disc is free: bool (N,)."""
        terrain = self._terrain
        return discs_are_free(terrain.clearance_m, terrain.lattice, points_m, self.radius_m)

    def leads_out(self, poses: _Floats) -> _Mask:
        """Tell from which poses (N, 4), x, y, 0, yaw, at such points it can depart: bool (N,)."""
        return np.ones(len(poses), np.bool_)


@compiled
def discs_are_free(
    field: npt.NDArray[np.float32],
    lattice: npt.NDArray[np.float64],
    points_m: npt.NDArray[np.float64],
    radius_m: float,
) -> _Mask:
    """Tell for each point (N, >= 2) whether the disc about it covers open cells only: bool (N,).

    The local planner has the same condition for the end of a motion: `Terrain.sees` from a point
    to itself.
    """
    free = np.empty(len(points_m), np.bool_)
    for k in range(len(points_m)):
        point_m = (points_m[k, 0], points_m[k, 1])
        free[k] = rolls(field, lattice, point_m, point_m, radius_m)
    return free


class VehicleDepartureCheck(DepartureConstraint):
    """The disc of a vehicle's coarse route, narrower than its box is long, and a free first arc.

    The disc is in a connected part of the free space that is large enough for a trip: such a part
    is at least `LEAST_PART_M` long, along the grid's axes, and has a cell of `region`.
    """

    def __init__(self, terrain: Terrain, body: Body, way_radius_m: float, region: _Mask) -> None:
        super().__init__(terrain, rounded_up_m(way_radius_m), region)
        self._body = _row_of(body)

    @cached_property
    def is_anywhere(self) -> bool:
        """Whether there is such a part."""
        return bool(self._roomy.any())

    def is_free_at(self, points_m: _Floats) -> _Mask:
        """Tell at which points (N, >= 2) the disc is free, in such a part: bool (N,)."""
        free = super().is_free_at(points_m)
        rows, cols = self._terrain.grid.points_to_cells(points_m[free, :2]).T
        free[free] = self._roomy[rows, cols]
        return free

    @cached_property
    def _roomy(self) -> _Mask:
        """The cells (H, W) of such parts, and their neighbours: centres may lie beside them."""
        import cv2

        field, unit_m = self._terrain.clearance_m, self._terrain.grid.resolution_m
        open_cells = (exact_room(field, self.radius_m, unit_m) > 0.0).view(np.uint8)
        count, labels, boxes, _ = cv2.connectedComponentsWithStats(open_cells, connectivity=4)
        sides = boxes[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
        is_roomy = np.bincount(labels[self._region], minlength=count) > 0
        is_roomy &= sides * unit_m >= LEAST_PART_M
        is_roomy[0] = False
        mask = is_roomy[labels].view(np.uint8)
        roomy: _Mask = cv2.dilate(mask, np.ones((3, 3), np.uint8)).view(np.bool_)
        return roomy

    def leads_out(self, poses: _Floats) -> _Mask:
        """Tell at which poses (N, 4), x, y, 0, yaw, one of six first arcs is free: bool (N,).

        Straight or at full lock to the left or right, forward or in reverse; the box is checked
        every half cell or less.
        """
        terrain, unit_m = self._terrain, self._terrain.grid.resolution_m
        field, lattice = terrain.clearance_m, terrain.lattice
        return some_arc_is_free(field, lattice, unit_m, self._body, poses)


def _row_of(body: Body) -> _Floats:
    """Return half sizes, centre, turning radius, length of the first arc, discs: (9,)."""
    radius_m = TIGHTEST * body.turn_radius_m
    way_m = FIRST_TURN_RAD * body.turn_radius_m
    count, gap_m, disc_m = body.discs()
    return np.array([*body.half_size_m, *body.centre_m, radius_m, way_m, count, gap_m, disc_m])


@compiled
def some_arc_is_free(
    field: npt.NDArray[np.float32],
    lattice: _Floats,
    unit_m: float,
    body: _Floats,
    poses: _Floats,
) -> _Mask:
    """Tell for each pose (N, 4), x, y, 0, yaw, whether one of six arcs is free: bool (N,).

    An arc is if the box is free at its end, and along it, where it goes in safe leaps.
    """
    out = np.zeros(len(poses), np.bool_)
    box = np.zeros((1, 8))
    box[0, 5], box[0, 6] = body[0], body[1]
    steps = int(np.ceil(body[5] / (_HALF_CELL * unit_m)))
    step_m = body[5] / steps
    far_m = np.hypot(abs(body[2]) + body[0], abs(body[3]) + body[1])
    for k in range(len(poses)):
        for arc in range(6):
            direction = 1.0 if arc < 3 else -1.0
            curvature = (0.0, 1.0, -1.0)[arc % 3] / body[4]
            pace = 1.0 + abs(curvature) * far_m  # of the fastest point of the box
            way_m, step = body[5], -1  # the end comes first
            while step < steps:
                room_m = _room_m(
                    field, lattice, unit_m, body, poses[k], direction * way_m, curvature, box
                )
                if room_m < 0.0:
                    break
                step = 0 if step < 0 else step + max(1, int(room_m / (pace * step_m)))
                way_m = step * step_m
            out[k] = step >= steps
            if out[k]:
                break
    return out


@compiled
def _room_m(
    field: npt.NDArray[np.float32],
    lattice: _Floats,
    unit_m: float,
    body: _Floats,
    pose: _Floats,
    way_m: float,
    curvature: float,
    box: _Floats,
) -> float:
    """Return a lower bound of the distance to closed cells; negative if the box covers one.

    The box is that of the body after a signed length along an arc from `pose`; it is written to
    `box`.
    """
    turn = curvature * way_m
    ahead_m, aside_m = way_m, 0.0
    if turn != 0.0:
        ahead_m, aside_m = np.sin(turn) / curvature, (1.0 - np.cos(turn)) / curvature
    cos, sin = np.cos(pose[3]), np.sin(pose[3])
    x_m = pose[0] + cos * ahead_m - sin * aside_m
    y_m = pose[1] + sin * ahead_m + cos * aside_m
    cos, sin = np.cos(pose[3] + turn), np.sin(pose[3] + turn)
    box[0, 0] = x_m + cos * body[2] - sin * body[3]
    box[0, 1] = y_m + sin * body[2] + cos * body[3]
    box[0, 3], box[0, 4] = cos, sin
    least_m = np.inf
    is_long = body[0] >= body[1]
    along_x, along_y = (box[0, 3], box[0, 4]) if is_long else (-box[0, 4], box[0, 3])
    for n in range(int(body[6])):
        offset_m = (n - 0.5 * (body[6] - 1.0)) * body[7]
        dx_m = box[0, 0] + offset_m * along_x - lattice[0]
        dy_m = box[0, 1] + offset_m * along_y - lattice[1]
        col = (dx_m * lattice[2] + dy_m * lattice[3]) / unit_m
        row = (dy_m * lattice[2] - dx_m * lattice[3]) / unit_m
        if not (0.0 <= col < field.shape[1] and 0.0 <= row < field.shape[0]):
            return _HIT
        least_m = min(least_m, field[int(row), int(col)])
    filled_m = min(0.5 * body[7], body[0], body[1])  # such a disc about each point lies in the box
    if least_m + _CERTAIN_HIT * unit_m < filled_m:
        return _HIT
    room_m = least_m - TWO_HALF_DIAGONALS * unit_m - body[8]
    if room_m < 0.0 and meets(box, 0, lattice, field, 0.0, field, unit_m, TOUCH_TOLERANCE_M):
        return _HIT
    return float(max(room_m, 0.0))


def departure_constraint_of(
    row: CatalogueRow, environment: Environment, terrains: Terrains, region: _Mask
) -> DepartureConstraint | None:
    """Return the constraint of a row's artefacts; None if they only stand.

    `region` bool (H, W) are the cells in which they may be.
    """
    if row.motion.speed_mps <= 0.0 or set(row.behaviours) <= {Standing.name}:
        return None
    body = Body.of(row)
    terrain = terrains.of(environment, body.height_m)
    if body.turn_radius_m <= 0.0:
        return DepartureConstraint(terrain, body.radius_m, region)
    return VehicleDepartureCheck(terrain, body, NavigationProfile.of(row, body).radius_m, region)


class PlacementQuery(NamedTuple):
    """One search for a pose: of which row, under which constraints, and how it has to depart.

    Without a `departure` the artefact need not be able to leave the pose.
    """

    row: CatalogueRow
    around: PlacementConstraints
    departure: DepartureConstraint | None = None

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
"""So many poses are drawn: where none of 5,408 is feasible, there is hardly one."""
_FEW: Final = 4
"""The first poses of a batch are tested on their own: mostly one of them is feasible."""


class Placer:
    """Draws poses in one environment and one spawn region of it.

    A pose is feasible if F_A's point on the ground lies in the region, the box covers free cells
    only and hits no wall, and the constraints leave room for it. Poses are uniform over the
    feasible ones (position continuous, heading in [-pi, pi)), or by the region's weights.

    An artefact that can move has a `DepartureConstraint`. It is placed, by the same law, among the
    feasible poses that meet it; only if none is found, among all feasible poses.

    At most 5,408 poses are drawn of each kind; None if none of them is feasible.
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
        self._departures: dict[CatalogueRow, DepartureConstraint | None] = {}
        self._roomy: dict[float, CandidateCells] = {}

    def place(
        self,
        row: CatalogueRow,
        generator: np.random.Generator,
        constraints: PlacementConstraints | None = None,
    ) -> GroundPose | None:
        """Draw a feasible pose for an artefact of this row, None if none was found.

        All draws come from `generator`; their number depends only on this artefact's attempts.
        """
        around = constraints or PlacementConstraints()
        cells = self._cells if around.within is None else self._cells_near(*around.within)
        departure = self._departure_of(row)
        pose = None
        if departure is not None:
            pose = self._found(PlacementQuery(row, around, departure), cells, generator)
        return pose or self._found(PlacementQuery(row, around), cells, generator)

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
        """Draw some thousands of poses; return the first that is feasible."""
        cells = self._with_room(cells, query.radius_m)
        if not cells.flat.size:
            return None
        for size in _BATCHES:
            uniforms = generator.random((size, 4))
            flat = cells.draw(uniforms[:, 0])
            poses = poses_in_cells(flat, self._grid.width, uniforms, self._lattice)
            for piece in (poses[:_FEW], poses[_FEW:]):
                found = self._first_feasible(query, piece)
                if found is not None:
                    return found
        return None

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

    @cached_property
    def _cells(self) -> CandidateCells:
        return self._ordered(np.flatnonzero(self._region.mask))

    def _ordered(self, flat: npt.NDArray[np.int64]) -> CandidateCells:
        clearance_m, weight = self._environment.clearance_m.ravel()[flat], self._region.weight
        clearance_cells = np.divide(clearance_m, self._grid.resolution_m, dtype=np.float32)
        weights = None if weight is None else weight.ravel()[flat].astype(np.float64)
        return CandidateCells.ordered(flat.astype(np.int32), clearance_cells, weights)

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
