"""What the kernels of the planner work on: the records of the agent table, and what surrounds them.

A row of the records is an agent's; the rows are in the order of the ids.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.agents.body import PLANNERS, STAND, Body, MotionCommand

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Records = npt.NDArray[Any]

X, Y, YAW, COS, SIN, SPEED = range(6)
"""Columns of a path: the pose of F_A's ground point, and the speed along its heading."""

NOBODY: Final = -1
UNOBSTRUCTED, BY_WALL, BY_ARTEFACT, BY_ROBOT = range(4)
NEVER: Final = 1 << 60
STAYS: Final = -(1 << 62)

DYNAMIC_WINDOW, SOCIAL_FORCE, PATH_FOLLOWING, WISHES = range(len(PLANNERS) + 1)
"""The planner of a command: those of `PLANNERS`, or the wishes of a user's."""
MOST_WISHES: Final = 16

LEG_POSES: Final = 8
"""So many poses of a leg are looked at in the search for a manoeuvre, in the scratch of a path."""

_WALK_S: Final = 1.0
_DRIVE_S: Final = 1.5
_BRAKE_S: Final = 2.5

PLACE = np.dtype(
    [
        ("id", "i8"),
        ("begin", "i8"),  # the sub-step of the path's first pose
        ("last", "i8"),  # index of the path's last pose; it is held for ever
        ("x", "f8"),  # a circle that holds the body on all of the path
        ("y", "f8"),
        ("reach", "f8"),
        ("pace", "f8"),  # the highest speed of any point of the box on the path
        ("must_plan", "i8"),  # its path was broken
        ("is_scripted", "i8"),
        ("is_news", "i8"),  # its path was changed from outside: the others look at theirs
    ]
)
BODY = np.dtype(
    [
        ("half_x", "f8"),
        ("half_y", "f8"),
        ("centre_x", "f8"),
        ("centre_y", "f8"),
        ("radius", "f8"),
        ("speed", "f8"),
        ("acceleration", "f8"),
        ("turn_rate", "f8"),
        ("turn_radius", "f8"),
        ("discs", "i8"),
        ("disc_x", "f8"),  # from one disc's centre to the next, in F_A
        ("disc_y", "f8"),
        ("disc_radius", "f8"),
        ("terrain", "i8"),
    ]
)
COMMAND = np.dtype(
    [
        ("has_goal", "i8"),
        ("x", "f8"),
        ("y", "f8"),
        ("speed", "f8"),
        ("stops", "i8"),  # 1: the way ends at (x, y), 2: it goes on, the next sub-goal is unknown
        ("face", "f8"),  # nan: none
        ("comfort", "f8"),
        ("robot_comfort", "f8"),
        ("wall_comfort", "f8"),
        ("planner", "i8"),
        ("beyond_x", "f8"),  # where the way goes on once the sub-goal is passed; nan: not known
        ("beyond_y", "f8"),
    ]
)
MEMORY = np.dtype(
    [
        ("blocked", "f8"),  # for how long it wants to move and makes no progress [s]
        ("credit", "f8"),  # progress ahead of what counts as none [m]
        ("detour_after", "f8"),  # it tries a detour when it is blocked for this long [s]
        ("detour_until", "i8"),  # the sub-step at which the detour ends
        ("detour", "f8"),  # angle of the detour from the direction of the goal
        ("pushed_until", "i8"),
        ("push_by", "i8"),  # id of the agent that pushes it
        ("push_rank", "f8"),  # the priority that it inherits, until priorities change
        ("push_x", "f8"),  # where that agent is, and where it wants to go
        ("push_y", "f8"),
        ("push_cos", "f8"),
        ("push_sin", "f8"),
        ("push_room", "f8"),  # how far to the side it is out of the way [m]
        ("chosen", "f8"),  # heading [rad] or curvature [1/m] of the last primitive; nan: none
        ("gear", "i8"),  # 1 forward, -1 in reverse
        ("leg", "i8"),  # the gear of the leg of a manoeuvre that it drives, 0: none
        ("leg_bend", "f8"),  # its curvature [1/m], and where it ends
        ("leg_x", "f8"),
        ("leg_y", "f8"),
        ("leg_yaw", "f8"),
        ("leg_heading", "f8"),  # where its goal was when it was found
        ("manoeuvre", "i8"),  # the steps after that leg, as digits to the base of 6
        ("steps", "i8"),  # how many they are
        ("leg_search", "i8"),  # the first sub-step at which another one is searched for
        ("is_boxed_in", "i8"),  # those that stand left it no manoeuvre
        ("passed_at", "i8"),  # the sub-step at which it passed its sub-goal
        ("obstruction", "i8"),
        ("obstructed_by", "i8"),
        ("swerves_until", "i8"),  # path_following: it passes another one by the dynamic window
        ("can_yield", "i8"),  # whether that agent can move out of the way
    ]
)
"""The planner's memory of one agent: progress, detour, push, last primitive, obstruction."""
STATUS = np.dtype(
    [
        ("phase", "i8"),  # in which sub-steps of a decision period it decides, -1: never
        ("behaviour", "i8"),  # the number of its behaviour
        ("leaving", "i8"),  # since when [ns] it leaves; STAYS: it does not
    ]
)
"""When an agent decides, by which behaviour, and since when it leaves; no kernel reads it."""


class AgentArrays(NamedTuple):
    """Records of N agents, in the order of their ids; `path` float64 (N, K, 6).

    `due`: the sub-steps at which they plan next, if there is anything to do.
    """

    place: Records
    body: Records
    command: Records
    memory: Records
    due: Integers
    path: Floats


class PlannerTiming(NamedTuple):
    """The sub-step [s], and in sub-steps: manoeuvres on foot and of vehicles, pushes."""

    step_s: float
    walk: int
    drive: int
    second: int


class ClearanceLayer(NamedTuple):
    """Clearance float32 (T, height, width) and solid cells, bool, of T terrains; the lattice."""

    clearance: npt.NDArray[np.float32]
    solid: npt.NDArray[np.bool_]
    lattice: Floats
    unit: float


class RobotPath(NamedTuple):
    """The robot's outlines (K, V, 2) now (0) and later, K = 0: none; rounded by `radius`.

    All lie in the circle x, y, reach; `pace` bounds the speed of any point of it. `disc`: x, y and
    velocity of the middle of its corners now, and the radius about it that holds the robot.
    """

    outlines: Floats
    radius: float
    x: float
    y: float
    reach: float
    pace: float
    disc: tuple[float, float, float, float, float]


class SpatialHash(NamedTuple):
    """A spatial hash: where the rows of each bucket start, and the rows in the order of ids."""

    starts: Integers
    rows: Integers
    bits: int


class Workspace(NamedTuple):
    """Scratch: two paths (2, K, 6), neighbours and the gaps wanted from them, primitives (M, 5).

    And marks of the rows that a search has met, rows that stand, counters, a packed box, a point;
    and the wishes of user-defined planners by row (N, MOST_WISHES, 2): heading [rad] and speed
    [m/s], nan: no more.
    """

    paths: Floats
    near: Integers
    wanted: Floats
    seen: Integers
    standing: Integers
    options: Floats
    counters: Integers
    box: Floats
    goal: Floats
    wishes: Floats


PLANS, KEPT, EMERGENCIES, STAMP = range(4)
"""Counters: accepted, old trajectory kept, broken ones with no way out, marks given so far."""


def timing_of(step_s: float) -> PlannerTiming:
    """Return the times of manoeuvres for the length of a sub-step [s]."""
    return PlannerTiming(
        step_s, round(_WALK_S / step_s), round(_DRIVE_S / step_s), round(1.0 / step_s)
    )


def path_length(timing: PlannerTiming) -> int:
    """Return how many poses the longest path has: a manoeuvre, and braking to a stand.

    With long sub-steps a leg of the search for a manoeuvre has more.
    """
    return max(timing.drive + round(_BRAKE_S / timing.step_s) + 3, LEG_POSES + 1)


def agent_arrays(capacity: int, length: int) -> AgentArrays:
    """Return the records of so many agents, for paths of `length` poses.

    Each kind is an array of its own: a column of a record is contiguous for one agent only, and
    kernels would be compiled for both.
    """
    place, body, command, memory = (
        np.zeros(capacity, kind) for kind in (PLACE, BODY, COMMAND, MEMORY)
    )
    due = np.zeros(capacity, np.int64)
    return AgentArrays(place, body, command, memory, due, np.zeros((capacity, length, 6)))


def workspace_of(capacity: int, length: int) -> Workspace:
    """Return scratch for that many agents."""
    return Workspace(
        np.zeros((2, length, 6)),
        np.zeros(capacity, np.int64),
        np.zeros(capacity),
        np.zeros(capacity, np.int64),
        np.zeros(capacity, np.int64),
        np.zeros((160, 5)),
        np.zeros(4, np.int64),
        np.zeros((1, 8)),
        np.zeros(2),
        np.full((capacity, MOST_WISHES, 2), np.nan),
    )


def write_body(record: Any, body: Body, terrain: int) -> None:
    """Write a body into its record; it goes no faster than it can brake within a path."""
    count, gap, radius = body.discs()
    lengthwise = body.half_size_m[0] >= body.half_size_m[1]
    record["half_x"], record["half_y"] = body.half_size_m
    record["centre_x"], record["centre_y"] = body.centre_m
    record["radius"] = body.radius_m
    record["speed"] = min(body.speed_mps, body.acceleration_mps2 * _BRAKE_S)
    record["acceleration"] = body.acceleration_mps2
    record["turn_rate"] = body.turn_rate_radps
    record["turn_radius"] = body.turn_radius_m
    record["discs"], record["disc_radius"] = count, radius
    record["disc_x"] = gap if lengthwise else 0.0
    record["disc_y"] = 0.0 if lengthwise else gap
    record["terrain"] = terrain


def command_record(command: MotionCommand) -> tuple[float, ...]:
    """Return a command as a record of `COMMAND`; to write it whole is much the fastest.

    A user-defined planner keeps the comfort distances itself, or not: its order of wishes counts.
    """
    goal = command.subgoal_m
    planner = PLANNERS.index(command.planner) if command.planner in PLANNERS else WISHES
    distances = (command.comfort_m, command.robot_comfort_m, command.wall_comfort_m)
    x_m, y_m = goal or (0.0, 0.0)
    return (
        int(goal is not None),
        x_m,
        y_m,
        command.speed_mps,
        int(command.stop_there),
        math.nan if command.face_rad is None else command.face_rad,
        *(distances if planner != WISHES else (0.0, 0.0, 0.0)),
        planner,
        *(command.beyond_m or (math.nan, math.nan)),
    )


STAND_ROW: Final = command_record(STAND)
