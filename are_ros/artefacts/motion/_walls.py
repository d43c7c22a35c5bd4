"""How near a path comes to what is closed: exact, quick where a field says that it is far."""

from typing import Any

import numpy as np

from are_ros._compiled import compiled
from are_ros.artefacts.motion._gaps import leap
from are_ros.artefacts.motion._state import COS, NEVER, SIN, Floats, Floor, X, Y
from are_ros.world._wall_kernels import are_free, hits_cells
from are_ros.world.lattice_cover import covered
from are_ros.world.oriented_boxes import TOUCH_TOLERANCE_M

_TWO_HALF_DIAGONALS = 1.42


@compiled
def lay_box(pose: Floats, body: Any, grow: float, box: Floats) -> None:
    """Write the packed box of a body, grown on each side, at a pose."""
    box[0, 0] = pose[X] + pose[COS] * body.centre_x - pose[SIN] * body.centre_y
    box[0, 1] = pose[Y] + pose[SIN] * body.centre_x + pose[COS] * body.centre_y
    box[0, 3], box[0, 4] = pose[COS], pose[SIN]
    box[0, 5], box[0, 6] = body.half_x + grow, body.half_y + grow


@compiled
def layer_of(body: Any, floor: Floor) -> int:
    """Return which layer of the floor is a body's; there may be one for all."""
    return int(min(body.terrain, floor.clearance.shape[0] - 1))


@compiled
def disc_room(pose: Floats, body: Any, floor: Floor) -> float:
    """Return how much each disc of a body could surely grow before it met a closed cell."""
    lattice = floor.lattice
    field = floor.clearance[layer_of(body, floor)]
    x0 = pose[X] - lattice[0] + pose[COS] * body.centre_x - pose[SIN] * body.centre_y
    y0 = pose[Y] - lattice[1] + pose[SIN] * body.centre_x + pose[COS] * body.centre_y
    step_x = pose[COS] * body.disc_x - pose[SIN] * body.disc_y
    step_y = pose[SIN] * body.disc_x + pose[COS] * body.disc_y
    least = np.inf
    for n in range(body.discs):
        offset = n - 0.5 * (body.discs - 1)
        x, y = x0 + offset * step_x, y0 + offset * step_y
        col = (x * lattice[2] + y * lattice[3]) / floor.unit
        row = (y * lattice[2] - x * lattice[3]) / floor.unit
        if not (0.0 <= col < field.shape[1] and 0.0 <= row < field.shape[0]):
            return -1.0
        least = min(least, field[int(row), int(col)])
    return float(least - _TWO_HALF_DIAGONALS * floor.unit - body.disc_radius)


@compiled
def is_free(pose: Floats, body: Any, grow: float, floor: Floor, box: Floats) -> bool:
    """Tell whether a body, grown on each side, covers open cells of the grid only: exact."""
    lay_box(pose, body, grow, box)
    field = floor.clearance[layer_of(body, floor)]
    return bool(are_free(box, floor.lattice, field, floor.unit, TOUCH_TOLERANCE_M)[0])


@compiled
def turns_freely(pose: Floats, body: Any, floor: Floor) -> bool:
    """Tell whether the disc that a body sweeps, turning on the spot, covers open cells only."""
    lattice, unit = floor.lattice, floor.unit
    field = floor.clearance[layer_of(body, floor)]
    dx, dy = pose[X] - lattice[0], pose[Y] - lattice[1]
    x = (dx * lattice[2] + dy * lattice[3]) / unit
    y = (dy * lattice[2] - dx * lattice[3]) / unit
    radius = body.radius / unit - TOUCH_TOLERANCE_M
    first_row, last_row = int(np.floor(y - radius)), int(np.floor(y + radius))
    first_col, last_col = int(np.floor(x - radius)), int(np.floor(x + radius))
    if min(first_row, first_col) < 0 or last_row >= field.shape[0] or last_col >= field.shape[1]:
        return False
    if field[int(y), int(x)] >= (radius + _TWO_HALF_DIAGONALS) * unit:
        return True
    for row in range(first_row, last_row + 1):
        v = max(row - y, y - row - 1.0, 0.0)
        for col in range(first_col, last_col + 1):
            u = max(col - x, x - col - 1.0, 0.0)
            if field[row, col] == 0.0 and u * u + v * v < radius * radius:
                return False
    return True


@compiled
def _solid_cells(pose: Floats, body: Any, floor: Floor, box: Floats) -> int:
    """Count the solid cells that a body covers; a huge number if it reaches outside the grid."""
    lay_box(pose, body, 0.0, box)
    layer = layer_of(body, floor)
    field, solid = floor.clearance[layer], floor.solid[layer]
    if not hits_cells(box, floor.lattice, solid, field, floor.unit, TOUCH_TOLERANCE_M)[0]:
        return 0
    row, col, mask = covered(box, 0, floor.lattice, solid.shape, TOUCH_TOLERANCE_M)
    count = 0
    for i in range(mask.shape[0]):
        for j in range(mask.shape[1]):
            if mask[i, j] and solid[row + i, col + j]:
                count += 1
    return count if count > 0 else NEVER


@compiled
def wall_conflict(
    plan: Floats,
    last: int,
    body: Any,
    comfort: float,
    pace: float,
    floor: Floor,
    box: Floats,
    home: Floats,
) -> tuple[bool, int]:
    """Tell whether a plan leaves the walls their comfort, and when it first runs into one.

    Who starts on free cells stays on such, and who turns on the spot does not end where it
    cannot, unless it was so at `home`, where the plan before this one ends.
    Who does not start so (a new map) may go over all that is not
    solid, and covers no more solid cells than at the start.
    """
    room = disc_room(plan[0], body, floor)
    if room < 0.0 and not is_free(plan[0], body, 0.0, floor, box):
        limit = _solid_cells(plan[0], body, floor, box)
        for k in range(1, last + 1):
            if _solid_cells(plan[k], body, floor, box) > limit:
                return False, k
        return False, NEVER
    comfortable = room >= comfort or is_free(plan[0], body, comfort, floor, box)
    wanted, k = comfort if comfortable else 0.0, 1
    kept = True
    while k <= last:
        room = disc_room(plan[k], body, floor)
        if room >= wanted:
            k += leap(room - wanted, pace)
            continue
        if not (wanted > 0.0 and is_free(plan[k], body, wanted, floor, box)):
            kept, wanted = kept and wanted == 0.0, 0.0
            if room < 0.0 and not is_free(plan[k], body, 0.0, floor, box):
                return False, k
        k += 1
    if body.turn_radius == 0.0 and last > 0 and not turns_freely(plan[last], body, floor):
        return kept, last if turns_freely(home, body, floor) else NEVER
    return kept, NEVER
