"""Constraints on arrival poses, beside room for the box, so that the artefact can depart from them.

A body that rotates on the spot needs a free disc. A vehicle needs free space that is connected over
some metres, and a free first arc; between two walls it could never move.
"""

from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, compiled
from are_ros.agents.behaviours.situation import Standing
from are_ros.agents.body import TIGHTEST, Body
from are_ros.agents.mdp.coarse_kernels import COL_STEPS, ROW_STEPS, disc_fits_in
from are_ros.agents.mdp.coarse_map import rounded_up_m
from are_ros.agents.navigation.destinations import APART_M
from are_ros.agents.navigation.profile import NavigationProfile
from are_ros.agents.navigation.terrain import Terrain, Terrains, disc_fits, rolls
from are_ros.population.catalogue import CatalogueRow
from are_ros.world.boxes import TOUCH_TOLERANCE_M
from are_ros.world.environment import Environment
from are_ros.world.lattice_cover import TWO_HALF_DIAGONALS, meets

_Mask = npt.NDArray[np.bool_]
_Floats = npt.NDArray[np.float64]

FIRST_TURN_RAD: Final = 1.0
"""Angle of the first arc at full steering lock; the straight one has the same length."""

LEAST_PART_M: Final = APART_M + 1.0
"""A smaller part of the map has no two destinations far enough apart for a trip."""

_HALF_CELL: Final = 0.5
_CERTAIN_HIT: Final = 0.25
"""As in `terrain.rolls` [cells]."""
_HIT: Final = -1.0

_UNSEEN: Final = np.uint8(0)
_LEADS_NOWHERE: Final = np.uint8(1)
_LEADS_ON: Final = np.uint8(2)
"""What is known of a cell: unseen; closed, or in a part that is too small or has no cell of the
region (or, for as long as a part is followed, met there); in a large part of the region."""


class DepartureConstraint:
    """Tells from which poses an artefact can depart, according to the static map.

    The disc of `radius_m` about F_A is free: a body that rotates on the spot sweeps it. `region`
    bool (H, W) are the cells that the artefact may be in.
    """

    is_searched_for = True
    """Whether the whole pose lattice is searched; then a free disc is sufficient."""

    def __init__(self, terrain: Terrain, radius_m: float, region: _Mask) -> None:
        self.radius_m = radius_m
        self._terrain = terrain
        self._region = region

    @property
    def key(self) -> tuple[float, ...]:
        """What distinguishes two constraints in one environment, except the shape of the box."""
        return (self.radius_m, self._terrain.height_m)

    @cached_property
    def is_anywhere(self) -> bool:
        """Whether any place of the map meets the constraint."""
        field, unit_m = self._terrain.clearance_m, self._terrain.grid.resolution_m
        return disc_fits_in(field, self._region, self.radius_m, unit_m)

    def is_free_at(self, points_m: _Floats) -> _Mask:
        """Tell at which points (N, >= 2) the disc is free, in a large enough part: bool (N,)."""
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

    The disc is in a connected part of the free space that is large enough for a trip: it is at
    least `LEAST_PART_M` long, along the grid's axes, and has a cell of `region`. The pose lattice
    is not searched: that would take seconds where no vehicle can depart.
    """

    is_searched_for = False

    def __init__(self, terrain: Terrain, body: Body, way_radius_m: float, region: _Mask) -> None:
        super().__init__(terrain, rounded_up_m(way_radius_m), region)
        self._turn_radius_m = body.turn_radius_m
        self._body = _row_of(body)

    @property
    def key(self) -> tuple[float, ...]:
        return (*super().key, self._turn_radius_m)

    @cached_property
    def is_anywhere(self) -> bool:
        cols = (np.flatnonzero(one) for one in self._region)
        cells = (np.column_stack((np.full_like(c, row), c)) for row, c in enumerate(cols))
        return any(self._leads_on(some).any() for some in cells)

    def is_free_at(self, points_m: _Floats) -> _Mask:
        free = super().is_free_at(points_m)
        free[free] = self._leads_on(self._terrain.grid.points_to_cells(points_m[free, :2]))
        return free

    def leads_out(self, poses: _Floats) -> _Mask:
        """Tell at which poses (N, 4), x, y, 0, yaw, one of six first arcs is free: bool (N,).

        Straight or at full lock to the left or right, forward or in reverse; the box is checked
        every half cell or less.
        """
        terrain, unit_m = self._terrain, self._terrain.grid.resolution_m
        field, lattice = terrain.clearance_m, terrain.lattice
        return some_arc_is_free(field, lattice, unit_m, self._body, poses)

    def _leads_on(self, cells: npt.NDArray[np.int64]) -> _Mask:
        """Tell which cells (N, 2) are in large parts, or beside: centres may lie there: bool (N,).

        A part is followed only until it is known to be large, as a map may have millions of cells.
        """
        terrain, disc_m = self._terrain, (self.radius_m, self._terrain.grid.resolution_m)
        return lead_on(cells, terrain.clearance_m, disc_m, self._region, self._known, self._queue)

    @cached_property
    def _known(self) -> npt.NDArray[np.uint8]:
        return np.zeros(self._region.shape, np.uint8)

    @cached_property
    def _queue(self) -> npt.NDArray[np.int64]:
        return np.empty((self._region.size, 2), np.int64)  # memory that is never used costs nothing


@compiled
def lead_on(
    cells: npt.NDArray[np.int64],
    field: npt.NDArray[np.float32],
    disc_m: tuple[float, float],
    region: _Mask,
    known: npt.NDArray[np.uint8],
    queue: npt.NDArray[np.int64],
) -> _Mask:
    """Tell which cells (N, 2), row and col, have one of a large part in the 3 x 3 about them.

    Parts are those of the cells where a disc, of this radius on cells of this size, fits. `known`
    uint8 (H, W) keeps what is found; `queue` has room for all cells.
    """
    found = np.zeros(cells.shape[0], np.bool_)
    for k in range(cells.shape[0]):
        for row in range(max(cells[k, 0] - 1, 0), min(cells[k, 0] + 2, known.shape[0])):
            for col in range(max(cells[k, 1] - 1, 0), min(cells[k, 1] + 2, known.shape[1])):
                if known[row, col] == _UNSEEN:
                    _follow_part(row, col, field, disc_m, region, known, queue)
                found[k] |= known[row, col] == _LEADS_ON
    return found


@borrowing
def _follow_part(
    row: int,
    col: int,
    field: npt.NDArray[np.float32],
    disc_m: tuple[float, float],
    region: _Mask,
    known: npt.NDArray[np.uint8],
    queue: npt.NDArray[np.int64],
) -> None:
    """Find out about the part of an unseen cell, up to where it is known to be large or ends."""
    known[row, col] = _LEADS_NOWHERE
    if not disc_fits(field, row, col, disc_m[0], disc_m[1]):
        return
    queue[0, 0], queue[0, 1] = row, col
    done, count, leads_on, has_cell = 0, 1, False, False
    low_row, high_row, low_col, high_col = row, row, col, col
    while done < count and not leads_on:
        row, col = queue[done, 0], queue[done, 1]
        low_row, high_row = min(low_row, row), max(high_row, row)
        low_col, high_col = min(low_col, col), max(high_col, col)
        has_cell |= region[row, col]
        side = 1 + max(high_row - low_row, high_col - low_col)
        leads_on = has_cell and side * disc_m[1] >= LEAST_PART_M
        for direction in range(4):
            r, c = row + ROW_STEPS[direction], col + COL_STEPS[direction]
            if not (0 <= r < known.shape[0] and 0 <= c < known.shape[1]):
                continue
            leads_on |= known[r, c] == _LEADS_ON
            if known[r, c] == _UNSEEN:
                known[r, c] = _LEADS_NOWHERE
                if disc_fits(field, r, c, disc_m[0], disc_m[1]):
                    queue[count, 0], queue[count, 1] = r, c
                    count += 1
        done += 1
    for k in range(count if leads_on else 0):
        known[queue[k, 0], queue[k, 1]] = _LEADS_ON


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
