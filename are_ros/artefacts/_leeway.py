"""What an artefact needs beside the room for its box, to set out from where it arrives.

A body that turns on the spot needs the disc that it sweeps. A vehicle needs a way that leads on,
and first metres that meet no wall: between two walls, or in a part of the map that is as wide as
the vehicle, it would stand for life.
"""

from functools import cached_property
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.artefacts._coarse_kernels import exact_room
from are_ros.artefacts.behaviours.standing import Standing
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.coarse_map import rounded_up_m
from are_ros.artefacts.motion.body import TIGHTEST, Body
from are_ros.artefacts.reach import APART_M
from are_ros.artefacts.terrain import Terrain, Terrains, rolls
from are_ros.artefacts.traveller import Traveller
from are_ros.world.boxes import TOUCH_TOLERANCE_M
from are_ros.world.environment import Environment
from are_ros.world.lattice_cover import TWO_HALF_DIAGONALS, is_free

_Mask = npt.NDArray[np.bool_]


class Roaming:
    """A disc about F_A's point on the ground, and the terrain that it can roam.

    It can roam the parts of it that are at least `extent_m` long, along the grid's axes, and have
    a cell of `region`, bool (H, W).
    """

    def __init__(self, terrain: Terrain, radius_m: float, region: _Mask, extent_m: float) -> None:
        self.radius_m = radius_m
        self._terrain = terrain
        self._region = region
        self._extent_m = extent_m

    @property
    def key(self) -> tuple[float, ...]:
        """What tells two of them apart in one environment, beside the shape of the box."""
        return (self.radius_m, self._terrain.height_m)

    @property
    def is_anywhere(self) -> bool:
        """Whether there is a part of the map at all that it can roam."""
        return bool(self._roomy.any())

    def is_free_at(self, points_m: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        """Tell at which points (N, >= 2) of the map it is free, and can roam a part: bool (N,).

        It can in those cells from whose centres it can, and in those beside them.
        """
        terrain = self._terrain
        free = discs_are_free(terrain.clearance_m, terrain.lattice, points_m, self.radius_m)
        rows, cols = terrain.grid.points_to_cells(points_m[free, :2]).T
        free[free] = self._roomy[rows, cols]
        return free

    @cached_property
    def _roomy(self) -> _Mask:
        """The cells (H, W) of such parts, and those beside them, whose centres may be too near."""
        import cv2

        field, unit_m = self._terrain.clearance_m, self._terrain.grid.resolution_m
        open_cells = (exact_room(field, self.radius_m, unit_m) > 0.0).view(np.uint8)
        count, labels, boxes, _ = cv2.connectedComponentsWithStats(open_cells, connectivity=4)
        sides = boxes[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
        is_roomy = np.bincount(labels[self._region], minlength=count) > 0
        is_roomy &= sides * unit_m >= self._extent_m
        is_roomy[0] = False
        mask = is_roomy[labels].view(np.uint8)
        roomy: _Mask = cv2.dilate(mask, np.ones((3, 3), np.uint8)).view(np.bool_)
        return roomy


@compiled
def discs_are_free(
    field: npt.NDArray[np.float32],
    lattice: npt.NDArray[np.float64],
    points_m: npt.NDArray[np.float64],
    radius_m: float,
) -> _Mask:
    """Tell for each point (N, >= 2) whether the disc about it covers open cells only: bool (N,).

    As the traffic has it, which lets nobody end a move elsewhere: `Terrain.sees` from a point to
    itself, exactly.
    """
    free = np.empty(len(points_m), np.bool_)
    for k in range(len(points_m)):
        point_m = (points_m[k, 0], points_m[k, 1])
        free[k] = rolls(field, lattice, point_m, point_m, radius_m)
    return free


class Turning:
    """The disc about F_A's point on the ground that holds a row's box, on the terrain it is on.

    `region` bool (H, W) are the cells that it may be in.
    """

    is_searched_for = True

    def __init__(self, terrain: Terrain, radius_m: float, region: _Mask) -> None:
        self.radius_m = radius_m
        self._terrain = terrain
        self._region = region

    @property
    def key(self) -> tuple[float, ...]:
        """What tells two of them apart in one environment, beside the shape of the box."""
        return (self.radius_m, self._terrain.height_m)

    @cached_property
    def is_anywhere(self) -> bool:
        """Whether it is free about the centre of any cell of the region."""
        field, unit_m = self._terrain.clearance_m, self._terrain.grid.resolution_m
        return bool((exact_room(field, self.radius_m, unit_m)[self._region] > 0.0).any())

    def is_free_at(self, points_m: npt.NDArray[np.float64]) -> _Mask:
        """Tell at which points (N, >= 2) of the map it is free: bool (N,)."""
        terrain = self._terrain
        return discs_are_free(terrain.clearance_m, terrain.lattice, points_m, self.radius_m)

    def leads_out(self, poses: npt.NDArray[np.float64]) -> _Mask:
        """Tell at which poses (N, 4) it can leave the free disc: bool (N,), all."""
        return np.ones(len(poses), np.bool_)


FIRST_TURN_RAD: Final = 1.0
"""How far a vehicle turns on its first metres at full lock; straight on they are as long."""

LEAST_PART_M: Final = APART_M + 1.0
"""So long a part of the map has two places that are far enough apart for a trip, each within half a
metre of its end. Where no part is, nothing can set out."""

_HALF_CELL: Final = 0.5
_SURELY_MET: Final = 0.25
"""As in `terrain.rolls`, in cells."""
_MET: Final = -1.0

_Floats = npt.NDArray[np.float64]


class SettingOut:
    """The disc of a vehicle's coarse way, which is narrower than the box is long, and its arcs.

    `region` bool (H, W) are the cells that it may be in. Poses are
    drawn only: where vehicles fit and can nowhere set out, to ask all of a lattice takes seconds.
    """

    is_searched_for = False

    def __init__(self, terrain: Terrain, body: Body, way_radius_m: float, region: _Mask) -> None:
        self._terrain = terrain
        self._roaming = Roaming(terrain, rounded_up_m(way_radius_m), region, LEAST_PART_M)
        self._turn_radius_m = body.turn_radius_m
        self._body = _row_of(body)

    @property
    def radius_m(self) -> float:
        """Radius of the disc about F_A that every pose has room for."""
        return self._roaming.radius_m

    @property
    def key(self) -> tuple[float, ...]:
        """What tells two of them apart in one environment, beside the shape of the box."""
        return (*self._roaming.key, self._turn_radius_m)

    @property
    def is_anywhere(self) -> bool:
        """Whether there is a part of the map at all that a way leads through."""
        return self._roaming.is_anywhere

    def is_free_at(self, points_m: _Floats) -> _Mask:
        """Tell from which points (N, >= 2) of the map a way leads on: bool (N,)."""
        return self._roaming.is_free_at(points_m)

    def leads_out(self, poses: _Floats) -> _Mask:
        """Tell at which poses (N, 4), x, y, 0, yaw, the first metres are free: bool (N,).

        Straight, or along its tightest arc to the left or right, ahead or in reverse, the box
        covers open cells only on at least one of these six ways, every half a cell or less.
        """
        terrain, unit_m = self._terrain, self._terrain.grid.resolution_m
        field, lattice = terrain.clearance_m, terrain.lattice
        return some_arc_is_free(field, lattice, unit_m, self._body, poses)


def _row_of(body: Body) -> _Floats:
    """Return half sizes, centre, turning radius, way of the first metres, and the discs (9,)."""
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
    """Tell for each pose (N, 4), x, y, 0, yaw, whether one of six arcs is free: bool (N,)."""
    out = np.zeros(len(poses), np.bool_)
    box = np.zeros((1, 8))
    box[0, 5], box[0, 6] = body[0], body[1]
    for k in range(len(poses)):
        for direction in (1.0, -1.0):
            for bend in (0.0, 1.0, -1.0):
                if not out[k]:
                    curvature = bend / body[4]
                    out[k] = _is_arc_free(
                        field, lattice, unit_m, body, poses[k], direction, curvature, box
                    )
    return out


@compiled
def _is_arc_free(
    field: npt.NDArray[np.float32],
    lattice: _Floats,
    unit_m: float,
    body: _Floats,
    pose: _Floats,
    direction: float,
    curvature: float,
    box: _Floats,
) -> bool:
    """Tell whether the box is free at the end of an arc, and then all along it, in leaps."""
    steps = int(np.ceil(body[5] / (_HALF_CELL * unit_m)))
    step_m = body[5] / steps
    far_m = np.hypot(abs(body[2]) + body[0], abs(body[3]) + body[1])
    pace = 1.0 + abs(curvature) * far_m  # of the fastest point of the box
    _lay(pose, direction * body[5], curvature, body, box)
    if _room_m(field, lattice, unit_m, body, box) < 0.0:
        return False
    k = 0
    while k < steps:
        _lay(pose, direction * k * step_m, curvature, body, box)
        room_m = _room_m(field, lattice, unit_m, body, box)
        if room_m < 0.0:
            return False
        k += max(1, int(room_m / (pace * step_m)))
    return True


@compiled
def _lay(pose: _Floats, way_m: float, curvature: float, body: _Floats, box: _Floats) -> None:
    """Write the box's centre and heading where it is after a signed way along an arc."""
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


@compiled
def _room_m(
    field: npt.NDArray[np.float32],
    lattice: _Floats,
    unit_m: float,
    body: _Floats,
    box: _Floats,
) -> float:
    """Return how far the box surely is from closed cells; negative if it covers any: exact."""
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
            return _MET
        least_m = min(least_m, field[int(row), int(col)])
    filled_m = min(0.5 * body[7], body[0], body[1])  # a disc about any of them lies in the box
    if least_m + _SURELY_MET * unit_m < filled_m:
        return _MET
    room_m = least_m - TWO_HALF_DIAGONALS * unit_m - body[8]
    if room_m < 0.0 and not is_free(box, 0, lattice, field, unit_m, TOUCH_TOLERANCE_M):
        return _MET
    return float(max(room_m, 0.0))


class Leeway(Protocol):
    """Tells from where an artefact can set out, as far as the static map decides."""

    @property
    def is_searched_for(self) -> bool:
        """Whether all of the lattice is searched for such a pose; then they lead out at once."""

    @property
    def radius_m(self) -> float:
        """Radius of a disc about F_A that is free at every such pose."""

    @property
    def key(self) -> tuple[float, ...]:
        """What tells two of them apart in one environment, beside the shape of the box."""

    @property
    def is_anywhere(self) -> bool:
        """Whether there is any place on the map where one could set out."""

    def is_free_at(self, points_m: _Floats) -> _Mask:
        """Tell at which points (N, >= 2) the disc is free, and can leave: bool (N,)."""

    def leads_out(self, poses: _Floats) -> _Mask:
        """Tell of poses (N, 4), x, y, 0, yaw, at such points which lead out of it: bool (N,)."""


def leeway_of(
    row: CatalogueRow, environment: Environment, terrains: Terrains, region: _Mask
) -> Leeway | None:
    """Return what a row's artefacts need to set out; None if they only stand.

    `region` bool (H, W) are the cells that they may be in.
    """
    if row.motion.speed_mps <= 0.0 or set(row.behaviours) <= {Standing.name}:
        return None
    body = Body.of(row)
    terrain = terrains.of(environment, body.height_m)
    if body.turn_radius_m <= 0.0:
        return Turning(terrain, body.radius_m, region)
    return SettingOut(terrain, body, Traveller.of(row, body).radius_m, region)
