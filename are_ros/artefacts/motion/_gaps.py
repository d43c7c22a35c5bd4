"""How near a path comes to walls, to others where they will be, and to the robot.

Paths (K, 6) are compared sub-step by sub-step; where discs are far enough apart, the sub-steps are
leapt over in which they cannot meet. `k` counts sub-steps from now; a path's last pose is held.
"""

from typing import Any

import numpy as np

from are_ros._compiled import compiled
from are_ros.artefacts.motion._state import (
    COS,
    NEVER,
    SIN,
    Floats,
    Floor,
    RobotPath,
    X,
    Y,
)
from are_ros.world._footprint_kernels import signed_distances
from are_ros.world._wall_kernels import are_free, hits_cells
from are_ros.world.lattice_cover import covered
from are_ros.world.oriented_boxes import TOUCH_TOLERANCE_M

_TOUCH = 0.5 * TOUCH_TOLERANCE_M  # half of what counts as touching is left for rounding
_TWO_HALF_DIAGONALS = 1.42
_FARTHEST_LEAP = 1e4
ROBOT_CLEARANCE = 0.01


@compiled
def leap(room: float, pace: float) -> int:
    """Return after how many sub-steps, at least one, `room` may be used up at `pace` per step."""
    return 1 + int(min(room / max(pace, 1e-9), _FARTHEST_LEAP))


@compiled
def separation(p: Floats, a: Any, q: Floats, b: Any) -> float:
    """Return the largest gap between boxes a at pose p and b at pose q along their edges' axes.

    Not above the distance where it is positive; negative exactly if the open boxes overlap.
    """
    dx = q[X] - p[X]
    dx += q[COS] * b.centre_x - q[SIN] * b.centre_y - p[COS] * a.centre_x + p[SIN] * a.centre_y
    dy = q[Y] - p[Y]
    dy += q[SIN] * b.centre_x + q[COS] * b.centre_y - p[SIN] * a.centre_x - p[COS] * a.centre_y
    c = abs(p[COS] * q[COS] + p[SIN] * q[SIN])
    s = abs(p[COS] * q[SIN] - p[SIN] * q[COS])
    ahead = abs(dx * p[COS] + dy * p[SIN]) - a.half_x - b.half_x * c - b.half_y * s
    aside = abs(dy * p[COS] - dx * p[SIN]) - a.half_y - b.half_x * s - b.half_y * c
    along = abs(dx * q[COS] + dy * q[SIN]) - b.half_x - a.half_x * c - a.half_y * s
    across = abs(dy * q[COS] - dx * q[SIN]) - b.half_y - a.half_x * s - a.half_y * c
    return float(max(ahead, aside, along, across))


@compiled
def _room_to_turn(p: Floats, a: Any, q: Floats, b: Any) -> float:
    """Return how far the disc that body a sweeps, turning at pose p, is from box b at pose q."""
    dx = p[X] - q[X] - q[COS] * b.centre_x + q[SIN] * b.centre_y
    dy = p[Y] - q[Y] - q[SIN] * b.centre_x - q[COS] * b.centre_y
    ahead = max(abs(dx * q[COS] + dy * q[SIN]) - b.half_x, 0.0)
    aside = max(abs(dy * q[COS] - dx * q[SIN]) - b.half_y, 0.0)
    return float(np.hypot(ahead, aside) - a.radius)


@compiled
def _jams(p: Floats, a: Any, q: Floats, b: Any) -> bool:
    """Tell whether one of two that stand so, and could turn on the spot, cannot turn any more."""
    if a.turn_radius == 0.0 and _room_to_turn(p, a, q, b) < 0.0:
        return True
    return bool(b.turn_radius == 0.0 and b.speed > 0.0 and _room_to_turn(q, b, p, a) < 0.0)


@compiled
def gap_between(
    plan: Floats,
    last: int,
    body: Any,
    path: Floats,
    start: int,
    end: int,
    other: Any,
    comfort: float,
    pace: float,
    until: int,
) -> tuple[float, int]:
    """Return the least gap, at most `comfort`, of a plan from a path, and when they first overlap.

    The path is at index `start` now and ends at `end`; `pace` is the highest closing speed per
    sub-step. Looks at sub-steps 1..until; NEVER: they do not overlap in these. To stand so near in
    the end that one cannot turn on the spot is like an overlap, unless staying here is no better:
    who walks cannot step back, and would be stuck for ever.
    """
    radii = body.radius + other.radius
    final = max(last, end - start)
    if final <= until and last > 0:
        p, q = plan[last], path[end]
        near = np.hypot(q[X] - p[X], q[Y] - p[Y]) < radii
        if near and _jams(p, body, q, other) and not _jams(plan[0], body, q, other):
            until = final - 1
    jammed = until == final - 1
    until = min(until, final)
    least, k = comfort, 1
    while k <= until:
        p, q = plan[min(k, last)], path[min(start + k, end)]
        far = np.hypot(q[X] - p[X], q[Y] - p[Y]) - radii
        if far >= least:
            k += leap(far - least, pace)
            continue
        gap = max(far, separation(p, body, q, other))
        if gap < -_TOUCH:
            return gap, k
        least = min(least, gap)
        k += 1
    return least, (final if jammed else NEVER)


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
    return min(body.terrain, floor.clearance.shape[0] - 1)


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
    plan: Floats, last: int, body: Any, comfort: float, pace: float, floor: Floor, box: Floats
) -> tuple[bool, int]:
    """Tell whether a plan leaves the walls their comfort, and when it first runs into one.

    Who starts on free cells stays on such, and who turns on the spot does not end where it cannot.
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
        return kept, last if turns_freely(plan[0], body, floor) else NEVER
    return kept, NEVER


@compiled
def robot_gap(pose: Floats, body: Any, robot: RobotPath, k: int, box: Floats) -> float:
    """Return the distance of a body at a pose from the robot at sub-step k; negative: overlap."""
    lay_box(pose, body, 0.0, box)
    outline = robot.outlines[min(k, robot.outlines.shape[0] - 1)]
    return float(signed_distances(outline, robot.radius, box)[0])


@compiled
def robot_conflict(
    path: Floats,
    start: int,
    end: int,
    body: Any,
    robot: RobotPath,
    comfort: float,
    pace: float,
    box: Floats,
) -> tuple[float, int, int]:
    """Return the least gap from the robot, at most `comfort`, and when a path first meets it.

    Twice: where it is predicted to be, and where it is now. Who is too near already comes no nearer
    to where it is now, and as to where it will be, nothing can be asked.
    """
    first = robot_gap(path[start], body, robot, 0, box)
    least = max(min(first, comfort), 0.0)
    allowed = min(first, ROBOT_CLEARANCE) - _TOUCH
    until = max(end - start, robot.outlines.shape[0] - 1)
    predicted, present, k = NEVER, NEVER, 1
    while k <= until:
        pose = path[min(start + k, end)]
        still = robot_gap(pose, body, robot, 0, box)
        ahead = robot_gap(pose, body, robot, k, box)
        if present == NEVER and still < allowed:
            present = k
        if predicted == NEVER and ahead < allowed:
            predicted = k
        near = min(still, ahead)
        least = min(least, max(near, 0.0))
        k += leap(max(near - comfort, 0.0), pace)
    return least, predicted, present
