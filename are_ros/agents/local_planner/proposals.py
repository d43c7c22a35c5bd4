"""What the planners propose: primitives with costs, of which the search commits to one.

Every planner may propose anything, for a primitive is committed to only if it meets no wall, no
other's trajectory and not the robot; braking is always among the proposals. `dynamic_window` is
`primitives`. `social_force` is an acceleration [1], here with ellipses of the relative motion [2]
between the edges of bodies, whose velocity a moment later is proposed:

    dv/dt = (v0 e - v) / tau + sum of w A exp((r - b) / B) grad b + A' exp((r' - d) / B') grad d

with the speed wanted v0 towards the sub-goal e, the radii r of both bodies, the semi-minor axis b
of the ellipse, 2 b = sqrt((|x| + |x - y|)^2 - |y|^2), of the place x from the other and the way y
that the other goes relatively in a step, the sight w = l + (1 - l) (1 + cos phi) / 2 at the angle
phi between heading and other, and the distance d of the nearest closed cell. The robot is one of
the others. `path_following` keeps to the straight way to its sub-goal, and brakes for whatever is
on it.

[1] Helbing, Molnar: Social force model for pedestrian dynamics. Physical Review E 51(5), 1995.
[2] Johansson, Helbing, Shukla: Specification of the social force pedestrian model by evolutionary
    adjustment to video tracking data. Advances in Complex Systems 10(supp02), 2007.
"""

import math
from typing import Any

import numpy as np

from are_ros._compiled import borrowing
from are_ros.agents.local_planner.manoeuvres import begin_leg, leg_options
from are_ros.agents.local_planner.primitives import (
    PLAIN_STOP,
    REVERSE_SHARE,
    STOPS_WITHIN,
    add_braking,
    gain_of,
    set_option,
    vehicle_options,
    walker_options,
)
from are_ros.agents.local_planner.rollouts import (
    BRAKE,
    CURVE,
    GOING,
    HEADING,
    POINT,
    PUSHED,
    RETREAT,
    PlanningGoal,
    wrapped,
)
from are_ros.agents.local_planner.state import (
    COS,
    DYNAMIC_WINDOW,
    PATH_FOLLOWING,
    SIN,
    SOCIAL_FORCE,
    SPEED,
    WISHES,
    YAW,
    AgentArrays,
    ClearanceLayer,
    Floats,
    PlannerTiming,
    RobotPath,
    Workspace,
    X,
    Y,
)
from are_ros.agents.local_planner.walls import layer_of

_BACK_MPS = 0.4
_BACK = 0.1  # for walking back


@borrowing
def propose(
    agents: AgentArrays,
    i: int,
    aim: PlanningGoal,
    pose: Floats,
    now: int,
    timing: PlannerTiming,
    floor: ClearanceLayer,
    robot: RobotPath,
    workspace: Workspace,
    near: int,
    backs_off: bool,
) -> int:
    """Write what the planner of agent i proposes at a pose; return how many options there are.

    The first `near` rows of `workspace.near` are the others. These plan by the dynamic
    window, whatever their planner: an agent that is pushed or has to stand; a vehicle whose planner
    is for agents that turn on the spot; an agent that the forces hold between walls.
    """
    body, memory, options = agents.body[i], agents.memory[i], workspace.options
    planner = agents.command[i].planner
    if aim.speed <= 0.0:
        return add_braking(options, 0, aim, 0.0, 0.0)
    is_held = planner == SOCIAL_FORCE and memory.blocked > FORCES_FAIL_AFTER
    if is_held or aim.kind == PUSHED or now < memory.swerves_until:
        planner = DYNAMIC_WINDOW
    if planner == WISHES:
        memory.leg = 0  # such a planner drives no manoeuvre
        return _wished(options, workspace.wishes[i], aim, pose, body, timing)
    if body.turn_radius > 0.0:
        left, may_back = begin_leg(agents, i, aim, pose, now, timing, floor, workspace)
        if left > 0.0:
            return leg_options(options, memory, aim, left, body, workspace)
        command = agents.command[i]
        return vehicle_options(options, aim, pose, body, command, memory, timing, may_back)
    if planner == DYNAMIC_WINDOW:
        count = walker_options(options, aim, memory, pose[YAW])
    elif planner == PATH_FOLLOWING:
        count = _straight_on(options, aim, pose, backs_off)
    else:
        x, y = social_force(agents, i, aim, pose, now, floor, robot, workspace, near)
        count = _by_force(options, aim, pose, x, y)
    if backs_off:  # straight back, where a walker met another and cannot turn
        heading = math.atan2(-pose[SIN], -pose[COS])
        delta, speed = wrapped(heading - aim.heading), min(aim.speed, _BACK_MPS)
        cost = 1.0 + _BACK - gain_of(aim, delta, np.cos(delta), speed)
        count = set_option(options, count, RETREAT, heading, -speed, cost, heading)
    return count


# Path following.


_TURNS_FIRST = 0.5  # from this angle on it turns on the spot
_PACES = np.array([1.0, 0.75, 0.5, 0.25])


@borrowing
def _straight_on(options: Floats, aim: PlanningGoal, pose: Floats, backs_off: bool) -> int:
    """Write the way ahead at several speeds, after a turn where it leads elsewhere."""
    if abs(wrapped(aim.heading - pose[YAW])) > _TURNS_FIRST:
        count = set_option(options, 0, BRAKE, aim.heading, 0.0, 0.0, np.nan)
        return set_option(options, count, BRAKE, np.nan, 0.0, aim.stop_cost, np.nan)
    count, kind = 0, POINT if aim.ends else HEADING
    for pace in _PACES:
        speed, cost = pace * aim.speed, 1.0 - pace
        count = set_option(options, count, kind, aim.heading, speed, cost, aim.heading)
        if kind == HEADING and aim.kind == GOING and aim.distance < STOPS_WITHIN:
            cost += PLAIN_STOP  # to stop there, should there be no room to go on
            count = set_option(options, count, POINT, aim.heading, speed, cost, aim.heading)
    return add_braking(options, count, aim, aim.stop_cost if backs_off else 1.0, 0.0)


@borrowing
def keep_to_way(options: Floats, count: int, chosen: int, may_reverse: bool) -> None:
    """Drop the arcs of a vehicle that follows its path but the one chosen, at any lower speed."""
    arc = options[chosen]
    for n in range(count):
        other = options[n]
        is_same = other[1] == arc[1] and other[2] * arc[2] > 0.0
        if other[0] != BRAKE and not is_same and not (may_reverse and other[2] < 0.0):
            other[3] = np.inf


# The wishes of a user-defined planner.


_NEXT_WISH = 0.04


@borrowing
def _wished(
    options: Floats,
    wishes: Floats,
    aim: PlanningGoal,
    pose: Floats,
    body: Any,
    timing: PlannerTiming,
) -> int:
    """Write the wishes (heading, speed) in their order, then braking; a vehicle steers by an arc.

    The arc turns the vehicle to that heading while the manoeuvre lasts, or as far as it can.
    """
    count = 0
    for n in range(wishes.shape[0]):
        heading, speed = wishes[n, 0], wishes[n, 1]
        if np.isnan(heading):
            break
        speed = min(max(speed, -REVERSE_SHARE * aim.speed), aim.speed)
        kind, direction = HEADING, heading
        if body.turn_radius > 0.0:
            way = speed * timing.drive * timing.step_s
            kind, direction = CURVE, 0.0
            if way != 0.0:
                tightest = 1.0 / body.turn_radius
                direction = min(max(wrapped(heading - pose[YAW]) / way, -tightest), tightest)
        else:
            speed = max(speed, 0.0)
        count = set_option(options, count, kind, direction, speed, _NEXT_WISH * count, heading)
    return set_option(options, count, BRAKE, np.nan, 0.0, 1.0, np.nan)


# The social force.


RELAXATION_S = 0.5
OTHERS_MPS2, OTHERS_M = 2.0, 0.3
AHEAD_S = 0.5
"""The time step of the ellipses: the others' motion is seen so far ahead."""
BEHIND = 0.1
"""The weight of an agent right behind; one right ahead has 1."""
WALLS_MPS2, WALLS_M = 3.0, 0.1
FORCES_FAIL_AFTER = 3.0
"""An agent without progress for so long [s] plans by the dynamic window until it moves on."""
HORIZON_S = 0.5
"""The velocity proposed is that after this time."""
_LEAST_AXIS = 0.05
_MOST_DEFLECTION = 1.3
_SLOWEST = 0.6
_TURNS = np.array([0.0, -0.35, 0.35, 0.0, -0.8, 0.8, -0.35, 0.35, -1.3, 1.3, 0.0])
_SHARES = np.array([1.0, 1.0, 1.0, 0.6, 0.8, 0.8, 0.5, 0.5, 0.6, 0.6, 0.3])
_COSTS = np.array([0.0, 0.1, 0.12, 0.2, 0.3, 0.32, 0.4, 0.42, 0.5, 0.52, 0.6])
_STRAIGHT = 0.7


@borrowing
def repulsion(
    dx: float, dy: float, vx: float, vy: float, radii: float, cos: float, sin: float
) -> tuple[float, float]:
    """Return the acceleration away from another, from which a body is (dx, dy) away.

    The other goes at (vx, vy) relatively to the body, whose heading is (cos, sin).
    """
    x, y = dx - AHEAD_S * vx, dy - AHEAD_S * vy
    now, then = max(np.sqrt(dx * dx + dy * dy), 1e-6), max(np.sqrt(x * x + y * y), 1e-6)
    square = (now + then) ** 2 - AHEAD_S * AHEAD_S * (vx * vx + vy * vy)
    axis = max(0.5 * np.sqrt(max(square, 0.0)), _LEAST_AXIS)
    sight = BEHIND + (1.0 - BEHIND) * 0.5 * (1.0 - (dx * cos + dy * sin) / now)
    force = sight * OTHERS_MPS2 * np.exp(min((radii - axis) / OTHERS_M, 0.0))
    force *= (now + then) / (4.0 * axis)
    return force * (dx / now + x / then), force * (dy / now + y / then)


@borrowing
def social_force(
    agents: AgentArrays,
    i: int,
    aim: PlanningGoal,
    pose: Floats,
    now: int,
    floor: ClearanceLayer,
    robot: RobotPath,
    workspace: Workspace,
    near: int,
) -> tuple[float, float]:
    """Return the acceleration of agent i: driving force, others, robot, walls (see above)."""
    body = agents.body[i]
    vx, vy = pose[SPEED] * pose[COS], pose[SPEED] * pose[SIN]
    wanted = min(aim.speed, aim.distance / RELAXATION_S) if aim.ends else aim.speed
    ax = (wanted * np.cos(aim.heading) - vx) / RELAXATION_S
    ay = (wanted * np.sin(aim.heading) - vy) / RELAXATION_S
    has_robot = robot.outlines.shape[0] > 0
    for n in range(near + 1):
        if n < near:
            j = workspace.near[n]
            place, radius = agents.place[j], agents.body[j].radius
            other = agents.path[j, min(now - place.begin, place.last)]
            x, y = other[X], other[Y]
            ux, uy = other[SPEED] * other[COS], other[SPEED] * other[SIN]
        elif has_robot:
            x, y, ux, uy, radius = robot.disc
        else:
            break
        fx, fy = repulsion(
            pose[X] - x, pose[Y] - y, ux - vx, uy - vy, body.radius + radius, pose[COS], pose[SIN]
        )
        ax, ay = ax + fx, ay + fy
    # walls push along the gradient, by central differences: none half-way between two of them
    lattice, unit, field = floor.lattice, floor.unit, floor.clearance[layer_of(body, floor)]
    dx, dy = pose[X] - lattice[0], pose[Y] - lattice[1]
    col = int(np.floor((dx * lattice[2] + dy * lattice[3]) / unit))
    row = int(np.floor((dy * lattice[2] - dx * lattice[3]) / unit))
    if 0 < col < field.shape[1] - 1 and 0 < row < field.shape[0] - 1:
        along = 0.5 * float(field[row, col + 1] - field[row, col - 1]) / unit
        across = 0.5 * float(field[row + 1, col] - field[row - 1, col]) / unit
        room = float(field[row, col]) - 0.5 * unit
        force = WALLS_MPS2 * np.exp(min((body.radius - room) / WALLS_M, 0.0))
        ax += force * (along * lattice[2] - across * lattice[3])
        ay += force * (along * lattice[3] + across * lattice[2])
    return ax, ay


@borrowing
def _by_force(options: Floats, aim: PlanningGoal, pose: Floats, ax: float, ay: float) -> int:
    """Write the velocity that an acceleration leads to, slower ones, and turns to both sides.

    It leads forward: people hardly walk backward.
    """
    vx = pose[SPEED] * pose[COS] + HORIZON_S * ax
    vy = pose[SPEED] * pose[SIN] + HORIZON_S * ay
    slowest = _SLOWEST * aim.speed
    speed = min(max(np.sqrt(vx * vx + vy * vy), slowest), aim.speed)
    aside = wrapped(math.atan2(vy, vx) - aim.heading)
    heading = aim.heading + min(max(aside, -_MOST_DEFLECTION), _MOST_DEFLECTION)
    count, is_near = 0, aim.kind == GOING and aim.distance < STOPS_WITHIN
    if is_near:
        cost = 0.0 if aim.ends else PLAIN_STOP
        count = set_option(options, count, POINT, aim.heading, speed, cost, aim.heading)
    first = PLAIN_STOP if is_near and aim.ends else 0.0
    for n in range(_TURNS.shape[0]):
        direction, share = heading + _TURNS[n], _SHARES[n]
        cost = first + _COSTS[n]
        count = set_option(options, count, HEADING, direction, share * speed, cost, direction)
    count = set_option(options, count, HEADING, aim.heading, slowest, _STRAIGHT, aim.heading)
    return add_braking(options, count, aim, aim.stop_cost, 0.0)
