"""Clearance of a path from closed ground: exact, and quick where a distance field allows it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, owning
from are_ros.agents.local_planner.gaps import leap
from are_ros.agents.local_planner.state import COS, NEVER, SIN, ClearanceLayer, Floats, X, Y
from are_ros.agents.navigation.terrain import HEIGHT_STEP_M, Terrains, rolls
from are_ros.world.boxes import TOUCH_TOLERANCE_M
from are_ros.world.environment import Environment
from are_ros.world.lattice_cover import (
    HALF_DIAGONAL,
    covered,
    lattice_row,
    meets,
)

_NOT_FREE = -1.0


@borrowing
def lay_box(pose: Floats, body: Any, grow: float, box: Floats) -> None:
    """Write the packed box of a body, grown on each side, at a pose."""
    box[0, 0] = pose[X] + pose[COS] * body.centre_x - pose[SIN] * body.centre_y
    box[0, 1] = pose[Y] + pose[SIN] * body.centre_x + pose[COS] * body.centre_y
    box[0, 3], box[0, 4] = pose[COS], pose[SIN]
    box[0, 5], box[0, 6] = body.half_x + grow, body.half_y + grow


@borrowing
def layer_of(body: Any, floor: ClearanceLayer) -> int:
    """Return which layer of the floor is a body's; there may be one for all."""
    return int(min(body.terrain, floor.clearance.shape[0] - 1))


@borrowing
def point_room(x: float, y: float, body: Any, floor: ClearanceLayer) -> float:
    """Return the radius [m] of a disc about a point that surely meets no closed cell."""
    lattice, field, scale = floor.lattice, floor.clearance, 1.0 / floor.unit
    dx, dy = x - lattice[0], y - lattice[1]
    col = (dx * lattice[2] + dy * lattice[3]) * scale
    row = (dy * lattice[2] - dx * lattice[3]) * scale
    if not (0.0 <= col < field.shape[2] and 0.0 <= row < field.shape[1]):
        return -np.inf
    i, j = int(row), int(col)
    dx, dy = col - j - 0.5, row - i - 0.5
    away = np.sqrt(dx * dx + dy * dy) + HALF_DIAGONAL
    return float(field[layer_of(body, floor), i, j] - away * floor.unit)


@borrowing
def disc_room(pose: Floats, body: Any, floor: ClearanceLayer) -> float:
    """Return how much [m] each disc of a body can surely grow before it meets a closed cell."""
    x = pose[X] + pose[COS] * body.centre_x - pose[SIN] * body.centre_y
    y = pose[Y] + pose[SIN] * body.centre_x + pose[COS] * body.centre_y
    step_x = pose[COS] * body.disc_x - pose[SIN] * body.disc_y
    step_y = pose[SIN] * body.disc_x + pose[COS] * body.disc_y
    least = np.inf
    for n in range(body.discs):
        offset = n - 0.5 * (body.discs - 1)
        least = min(least, point_room(x + offset * step_x, y + offset * step_y, body, floor))
    return float(least - body.disc_radius)


@borrowing
def is_free(pose: Floats, body: Any, grow: float, floor: ClearanceLayer, box: Floats) -> bool:
    """Tell whether a body, grown on each side, covers open cells of the grid only: exact."""
    lay_box(pose, body, grow, box)
    field = floor.clearance[layer_of(body, floor)]
    return not meets(box, 0, floor.lattice, field, 0.0, field, floor.unit, TOUCH_TOLERANCE_M)


@borrowing
def turns_freely(pose: Floats, body: Any, floor: ClearanceLayer) -> bool:
    """Tell whether the disc that a body sweeps, turning on the spot, covers open cells only."""
    field, here_m = floor.clearance[layer_of(body, floor)], (pose[X], pose[Y])
    return rolls(field, floor.lattice, here_m, here_m, body.radius)


@owning
def _solid_cells(pose: Floats, body: Any, floor: ClearanceLayer, box: Floats) -> int:
    """Count the solid cells that a body covers; a huge number if it reaches outside the grid."""
    lay_box(pose, body, 0.0, box)
    layer = layer_of(body, floor)
    field, solid = floor.clearance[layer], floor.solid[layer]
    if not meets(box, 0, floor.lattice, solid, True, field, floor.unit, TOUCH_TOLERANCE_M):
        return 0
    row, col, mask = covered(box, 0, floor.lattice, solid.shape, TOUCH_TOLERANCE_M)
    count = 0
    for i in range(mask.shape[0]):
        for j in range(mask.shape[1]):
            if mask[i, j] and solid[row + i, col + j]:
                count += 1
    return count if count > 0 else NEVER


@borrowing
def wall_gap_wanted(
    pose: Floats, body: Any, comfort: float, floor: ClearanceLayer, box: Floats
) -> float:
    """Return the comfort, 0 if a pose does not leave the walls that, or less if it is not free."""
    room = disc_room(pose, body, floor)
    if room >= comfort:
        return comfort
    if room < 0.0 and not is_free(pose, body, 0.0, floor, box):
        return _NOT_FREE
    return comfort if is_free(pose, body, comfort, floor, box) else 0.0


@borrowing
def wall_conflict(
    plan: Floats,
    last: int,
    body: Any,
    wanted: float,
    pace: float,
    floor: ClearanceLayer,
    box: Floats,
    home: Floats,
    must_keep: bool,
) -> tuple[bool, int]:
    """Tell whether a plan leaves the walls the gap wanted, and when it first runs into one.

    `wanted` is `wall_gap_wanted` of its first pose. With `must_keep` the search ends once the gap
    is not kept. A plan that starts in free space stays in it and, for a body that turns on the
    spot, ends where the body can turn, unless it cannot at `home`, where the plan before this one
    ends. A plan that starts elsewhere (on a new map) may cross what is not solid, and covers no
    more solid cells than at its start.
    """
    if wanted < 0.0:
        limit = _solid_cells(plan[0], body, floor, box)
        for k in range(1, last + 1):
            if _solid_cells(plan[k], body, floor, box) > limit:
                return False, k
        return False, NEVER
    kept, k = True, 1
    while k <= last:
        room = disc_room(plan[k], body, floor)
        if room >= wanted:
            k += leap(room - wanted, pace)
            continue
        if not (wanted > 0.0 and is_free(plan[k], body, wanted, floor, box)):
            kept, wanted = kept and wanted == 0.0, 0.0
            if must_keep and not kept:
                return False, NEVER
            if room < 0.0 and not is_free(plan[k], body, 0.0, floor, box):
                return False, k
        k += 1
    if body.turn_radius == 0.0 and last > 0 and not turns_freely(plan[last], body, floor):
        return kept, last if turns_freely(home, body, floor) else NEVER
    return kept, NEVER


# The ground of the newest environment for the kernels, one layer for each height of bodies.


class ClearanceLayers:
    """Lays the floor of an environment for the heights that there are."""

    def __init__(self, terrains: Terrains) -> None:
        self._terrains = terrains
        self._environment: Environment | None = None
        self._levels: list[int] = []
        self._floor: ClearanceLayer | None = None

    def of(self, environment: Environment, levels: Sequence[int]) -> tuple[bool, ClearanceLayer]:
        """Return whether the environment is new, and its floor, a layer for each level of height.

        Levels are heights in steps of `HEIGHT_STEP_M`.
        """
        is_new = environment is not self._environment
        if is_new or self._floor is None or self._levels != levels:
            self._environment, self._levels = environment, list(levels)
            self._floor = self._lay(environment, levels or [1])
        return is_new, self._floor

    def _lay(self, environment: Environment, levels: Sequence[int]) -> ClearanceLayer:
        grid = environment.grid
        terrains = [self._terrains.of(environment, HEIGHT_STEP_M * level) for level in levels]
        if environment.own_voxels is None:  # all layers are one
            del terrains[1:]
        clearance, solid = terrains[0].clearance_m[None], terrains[0].solid[None]
        if len(terrains) > 1:
            clearance = _frozen(np.stack([terrain.clearance_m for terrain in terrains]))
            solid = _frozen(np.stack([terrain.solid for terrain in terrains]))
        unit = grid.resolution_m
        return ClearanceLayer(clearance, solid, lattice_row(grid.origin, unit, unit), unit)


def _frozen(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    array.flags.writeable = False
    return array
