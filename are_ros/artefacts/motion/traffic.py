"""The traffic: everybody on a committed trajectory that ends in a stand and meets nobody's.

A trajectory is a manoeuvre of about a second and then braking. It is taken only if, sub-step by
sub-step, its boxes overlap neither closed ground nor anybody on the trajectory that he is committed
to (open boxes, exact); else the old one goes on, which was free and still is, for all the others
have kept clear of it. So nobody ever overlaps, unless something breaks in from outside: an arrival,
a displaced one, a new map, the robot. Those who are due in a sub-step plan one after the other, by
id, so each knows what the ones before it have decided.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.artefact import GroundPose
from are_ros.artefacts.motion import _orders, _state, _steps
from are_ros.artefacts.motion._floors import Floors
from are_ros.artefacts.motion._patience import forget_blockade
from are_ros.artefacts.motion._robot_gaps import robot_path
from are_ros.artefacts.motion._scripts import Scripts
from are_ros.artefacts.motion._state import COS, NOBODY, SIN, YAW, X, Y
from are_ros.artefacts.motion.body import Body
from are_ros.artefacts.motion.hindrance import Hindrance
from are_ros.artefacts.motion.order import STAND, Order
from are_ros.artefacts.motion.robot import RobotMotion
from are_ros.artefacts.rows import with_row, without_row
from are_ros.artefacts.terrain import Terrains
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment

_WALK_S: Final = 1.0
_DRIVE_S: Final = 1.5
_BRAKE_S: Final = 2.5
_FIRST_CAPACITY: Final = 64
_UNHINDERED: Final = (Hindrance.NONE, NOBODY, 0.0)

_Floats = npt.NDArray[np.float64]
_Row = tuple[float, ...]


@dataclass(frozen=True)
class TrafficCounters:
    """How often so far a plan was made, an old one kept, a broken one found no way out."""

    plans_made: int
    plans_kept: int
    emergency_stops: int


class Traffic:
    """Moves artefacts by their orders; ids are any integers >= 0, slots and order do not matter."""

    def __init__(self, step_s: float, terrains: Terrains | None = None) -> None:
        """Take the length of a sub-step [s], and the terrains where others need them, too."""
        walk, drive = round(_WALK_S / step_s), round(_DRIVE_S / step_s)
        self._tempo = _state.Tempo(step_s, walk, drive, round(1.0 / step_s))
        self._length = drive + round(_BRAKE_S / step_s) + 3
        self._floors = Floors(terrains or Terrains())
        self.clear()

    def clear(self) -> None:
        """Let nobody be there; counters go back to 0."""
        self._fleet = _state.fleet_of(_FIRST_CAPACITY, self._length)
        self._desk = _state.desk_of(_FIRST_CAPACITY, self._length)
        self._columns = _state.columns_of(self._fleet)
        self._slot_of: dict[int, int] = {}
        self._free = list(range(_FIRST_CAPACITY))[::-1]
        self._ids = np.empty(0, np.int64)
        self._slots = np.empty(0, np.int64)
        """The slots (N,) in the order of ids, which ascend."""
        self._scripts = Scripts()
        self._intruders: list[int] = []
        self._now = 0
        self._survey: tuple[_Floats, _Floats] | None = None
        self._moved: npt.NDArray[np.bool_] | None = None

    def add(self, artefact_id: int, pose: GroundPose, body: Body) -> None:
        """Let one more stand at a pose, with nothing to do."""
        if artefact_id in self._slot_of:
            raise ValueError(f"artefact {artefact_id} is in the traffic already")
        if not self._free:
            self._grow()
        slot = self._free.pop()
        fleet = self._fleet
        for table in fleet[:4]:
            table[slot] = 0
        self._slot_of[artefact_id] = slot
        index = int(self._ids.searchsorted(artefact_id))
        self._ids = with_row(self._ids, index, artefact_id)
        self._slots = with_row(self._slots, index, slot)
        level = self._floors.level_of(body.height_m)
        top_speed = body.acceleration_mps2 * _BRAKE_S
        _state.write_body(fleet.body[slot], body, top_speed, level)
        fleet.place["id"][slot] = artefact_id
        fleet.mind["passed_at"][slot] = _state.NEVER
        fleet.mind["chosen"][slot] = np.nan
        fleet.order[slot] = _state.order_record(STAND)
        forget_blockade(fleet.mind[slot])
        self._moved = None
        row, circle = self._stand(artefact_id, slot, pose)
        if self._survey is not None:
            poses, circles = self._survey
            self._survey = with_row(poses, index, row), with_row(circles, index, circle)

    def remove(self, artefact_id: int) -> None:
        """Let one be gone."""
        slot = self._slot_of.pop(artefact_id)
        index = int(self._ids.searchsorted(artefact_id))
        self._ids, self._slots = without_row(self._ids, index), without_row(self._slots, index)
        if self._survey is not None:
            poses, circles = self._survey
            self._survey = without_row(poses, index), without_row(circles, index)
        self._free.append(slot)
        self._scripts.cancel(artefact_id)
        self._intruders = [other for other in self._intruders if other != slot]
        self._moved = None

    def order(self, artefact_id: int, order: Order) -> None:
        """Tell one what to do from the next sub-step on, unless it is scripted."""
        self.give_orders([artefact_id], [order])

    def give_orders(self, artefact_ids: Sequence[int], orders: Sequence[Order]) -> None:
        """Tell some what to do from the next sub-step on, each its own order."""
        rows = np.array([_state.order_record(order) for order in orders], np.float64)
        ids = np.array(artefact_ids, np.int64)
        self.give_rows(self.slots_of(ids), rows.reshape(-1, 9))

    def give_rows(self, slots: npt.NDArray[np.int64], rows: _Floats) -> None:
        """Tell those of some slots (M,) what to do, by rows (M, 9) as `order_record` makes them."""
        fleet = self._fleet
        _orders.give(fleet.order, fleet.mind, fleet.due, slots, rows, self._now)

    @property
    def minds(self) -> _state.Records:
        """What hinders them and for how long, by slot: records of `_state.MIND`, to be read."""
        return self._fleet.mind

    def put(self, artefact_id: int, pose: GroundPose) -> None:
        """Let one stand at another pose; who is on the way there plans anew at once."""
        row, circle = self._stand(artefact_id, self._slot_of[artefact_id], pose)
        if self._survey is not None:
            poses, circles = self._survey[0].copy(), self._survey[1].copy()
            index = self._ids.searchsorted(artefact_id)
            poses[index], circles[index] = row, circle
            self._survey = poses, circles

    def _stand(self, artefact_id: int, slot: int, pose: GroundPose) -> tuple[_Row, _Row]:
        """Let one stand at a pose; return what `_steps.survey` has of it: the pose, its circle."""
        yaw = pose.yaw_rad
        row = (pose.x_m, pose.y_m, yaw, np.cos(yaw), np.sin(yaw), 0.0)
        self._fleet.path[slot, 0] = row
        place = self._fleet.place[slot]
        place["begin"], place["last"], place["pace"] = self._now, 0, 0.0
        place["x"], place["y"] = pose.x_m, pose.y_m
        place["reach"] = self._fleet.body["radius"][slot]
        place["must_plan"], self._fleet.due[slot] = 0, self._now
        self._scripts.repeat(artefact_id)
        self._intruders.append(slot)
        return row, (pose.x_m, pose.y_m, float(place["reach"]))

    def prescribe(self, artefact_id: int, poses: npt.NDArray[np.float64]) -> None:
        """Let one follow x, y, yaw float64 (K, 3) in the next K sub-steps; no poses cancel that.

        Nothing is tested; the others plan around it. Afterwards its order holds again.
        """
        slot = self._slot_of[artefact_id]
        self._scripts.begin(artefact_id, np.array(poses, dtype=np.float64), self._now)
        self._fleet.place["is_scripted"][slot] = len(poses) > 0
        if not len(poses):
            self.put(artefact_id, GroundPose(*self._pose(slot)[:2], 0.0, self._pose(slot)[2]))

    def step(self, index: int, environment: Environment, robot: RobotMotion | None) -> None:
        """Let those plan who are due, and everybody go one sub-step on.

        `index` is the number of the sub-step since the epoch: it fixes who is due.
        """
        is_new, floor = self._floors.of(environment)
        laid = self._scripts.lay(self._slot_of, self._fleet, self._now, self._tempo)
        if laid:
            self._intruders += laid
            self._survey = None
        circles = self._surveyed()[1]
        if is_new:
            _steps.mark_closed(self._fleet, self._slots, self._now, floor, self._desk.box)
        if self._intruders:
            intruders = np.array(self._intruders, np.int64)
            _steps.mark_broken(self._fleet, self._slots, circles, intruders, self._now)
        self._intruders = []
        path = robot_path(robot, self._tempo.step_s)
        self._moved, *survey = _steps.run(
            self._fleet,
            self._slots,
            circles,
            self._now,
            index,
            self._tempo,
            floor,
            path,
            self._desk,
        )
        self._now += 1
        self._survey = survey[0], survey[1]

    @property
    def ids(self) -> npt.NDArray[np.int64]:
        """The ids (N,) of who is there, ascending."""
        return np.array(self._ids)

    @property
    def poses(self) -> npt.NDArray[np.float64]:
        """Where they are now: x, y [m], yaw [rad] in the map frame, float64 (N, 3)."""
        return self._surveyed()[0][:, :3]

    @property
    def speeds(self) -> npt.NDArray[np.float64]:
        """The speeds (N,) [m/s] along their headings; negative in reverse."""
        return self._surveyed()[0][:, _state.SPEED]

    @property
    def moved(self) -> npt.NDArray[np.bool_]:
        """Whose pose changed in the last sub-step, bool (N,)."""
        if self._moved is None:
            self._moved = np.zeros(len(self._ids), np.bool_)
        return self._moved

    @property
    def counters(self) -> TrafficCounters:
        """What planning has come to so far."""
        made, kept, emergencies, _ = self._desk.counters.tolist()
        return TrafficCounters(made, kept, emergencies)

    def trajectory(self, artefact_id: int) -> npt.NDArray[np.float64]:
        """Return x, y, yaw float64 (K, 3), K >= 1, at the next sub-steps; it holds the last."""
        slot = self._slot_of[artefact_id]
        place = self._fleet.place[slot]
        first = min(self._now + 1 - int(place["begin"]), int(place["last"]))
        return np.array(self._fleet.path[slot, first : int(place["last"]) + 1, :3])

    def is_clear(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell which boxes (M,), standing from now on, nobody meets on his trajectory."""
        packed = boxes.packed
        poses = np.zeros((len(packed), 6))
        poses[:, X], poses[:, Y], poses[:, YAW] = packed[:, 0], packed[:, 1], boxes.yaws_rad
        poses[:, COS], poses[:, SIN] = packed[:, 3], packed[:, 4]
        bodies = np.zeros(len(packed), _state.BODY)
        bodies["half_x"], bodies["half_y"] = packed[:, 5], packed[:, 6]
        bodies["radius"] = np.hypot(packed[:, 5], packed[:, 6])
        circles = self._surveyed()[1]
        clear = np.ones(len(packed), np.bool_)
        _steps.mark_clear(clear, self._fleet, self._slots, circles, self._now, poses, bodies)
        return clear

    def hindrance(self, artefact_id: int) -> tuple[Hindrance, int, float]:
        """Tell what is in an artefact's way, whose id that is (or -1), and since when [s].

        The time is that in which it wanted to move and came nearer to its sub-goal by less than
        0.1 m/s; 0: nothing is in its way.
        """
        return self.hindrances([artefact_id])[0]

    def hindrances(self, artefact_ids: Sequence[int]) -> list[tuple[Hindrance, int, float]]:
        """Tell what is in the way of each of some artefacts, as `hindrance`."""
        slots, columns = self.slots_of(np.array(artefact_ids, np.int64)), self._columns
        blocked_s, kinds = columns.blocked[slots].tolist(), columns.hindrance[slots].tolist()
        by = columns.hindered_by[slots].tolist()
        return [
            (Hindrance(kind), who, since_s) if since_s > 0.0 else _UNHINDERED
            for kind, who, since_s in zip(kinds, by, blocked_s, strict=True)
        ]

    def slots_of(self, ids: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Return the slots (M,) of some (M,) who are there; KeyError if one is not."""
        places = self._ids.searchsorted(ids)
        if (self._ids.searchsorted(ids, "right") == places).any():
            raise KeyError(f"not all of the artefacts {ids.tolist()} are in the traffic")
        return self._slots[places]

    def _surveyed(self) -> tuple[_Floats, _Floats]:
        """Return where all are now, and the circles of their paths; see `_steps.survey`."""
        if self._survey is None:
            self._survey = _steps.survey(self._fleet, self._slots, self._now)
        return self._survey

    def _pose(self, slot: int) -> tuple[float, float, float]:
        place = self._fleet.place[slot]
        index = min(self._now - int(place["begin"]), int(place["last"]))
        x, y, yaw = self._fleet.path[slot, index, :3].tolist()
        return x, y, yaw

    def _grow(self) -> None:
        """Double the number of slots."""
        old = len(self._fleet.place)
        fleet = _state.fleet_of(2 * old, self._length)
        for table, before in zip(fleet, self._fleet, strict=True):
            table[:old] = before
        counters = self._desk.counters
        self._fleet, self._columns = fleet, _state.columns_of(fleet)
        self._desk = _state.desk_of(2 * old, self._length)._replace(counters=counters)
        self._free = list(range(old, 2 * old))[::-1]
