"""The table of agents: one row per artefact alive, in the order of their ids.

It is the only place of an artefact's columns: pose, velocity, shape, plan, obstruction, history,
and the objects beside them. An arrival calls `add`, a departure calls `remove`. Kernels take the
arrays; everything else reads them.
"""

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.body import Body
from are_ros.agents.local_planner import state as _state
from are_ros.agents.local_planner.deadlock import forget_blockade
from are_ros.agents.local_planner.state import STAND_ROW, STAYS, AgentArrays, PlannerTiming
from are_ros.agents.navigation.terrain import HEIGHT_STEP_M
from are_ros.agents.track_player import FollowedTrack
from are_ros.agents.trajectory_buffer import TrajectoryBuffer
from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import GroundKind
from are_ros.population.artefact import Artefact, GroundPose, shape_of
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment

if TYPE_CHECKING:
    from are_ros.agents.decision import AgentState

_FIRST_CAPACITY: Final = 64

_Floats = npt.NDArray[np.float64]
_Mask = npt.NDArray[np.bool_]


class AgentTable:
    """N agents, in the ascending order of their ids.

    `ids` int64 (N,). `poses` float64 (N, 4) are x, y, z, yaw in the map frame at the beginning of
    the present sub-step, or at an arrival since; `ends` float64 (N, 4) those at the beginning of
    the next one (the same array if no agent moves). `radii_m` float64 (N,) are the radii of circles
    about (x, y) that contain the boxes. These arrays are replaced, never written into, so a
    reference to one stays valid.

    `arrays` are the records that the kernels of the local planner write into (body, command,
    committed trajectory, obstruction). `artefacts` (N) are the objects. `states` (N) are the states
    of the decision layer, None for agents that stand or follow a track. `history` keeps past poses.
    `now` counts the sub-steps planned; `heights` are the body heights, in steps of 0.25 m.
    """

    def __init__(
        self,
        step_s: float,
        ground: GroundKind = GroundKind.PLANE,
        history_ns: int = 2 * NS_PER_S,
    ) -> None:
        """Take the length of a sub-step [s], the kind of ground, and how long poses are kept."""
        self._is_plane = ground is GroundKind.PLANE
        self.timing: Final[PlannerTiming] = _state.timing_of(step_s)
        self.history = TrajectoryBuffer(history_ns)
        self.now = 0
        self.heights: list[int] = []
        self.artefacts: list[Artefact] = []
        self.states: list[AgentState | None] = []
        self._tracks: list[FollowedTrack | None] = []
        self._behaviours: list[str] = []
        self.ids = np.empty(0, np.int64)
        self.poses = self.ends = np.empty((0, 4))
        self.radii_m = np.empty(0)
        self.boxes = self.end_boxes = OrientedBoxes.empty()
        self._shapes = np.empty((0, 5))
        self._records = _state.agent_arrays(_FIRST_CAPACITY, _state.path_length(self.timing))
        self._lives = np.zeros(_FIRST_CAPACITY, _state.STATUS)

    def __len__(self) -> int:
        """Count the agents."""
        return len(self.ids)

    def add(
        self,
        artefact: Artefact,
        body: Body | None = None,
        goes_to: tuple[int, GroundPose] | None = None,
        track: FollowedTrack | None = None,
    ) -> None:
        """Add an artefact that has just arrived; ValueError if its id is in the table.

        It stands at the pose of its history. With `goes_to`, (instant [ns], pose), it moves
        straight there. From then on its history is a view of the table's. Without a `body`, it has
        the one of its row.
        """
        row = self.row_of(artefact.id)
        if row < len(self) and self.ids[row] == artefact.id:
            raise ValueError(f"agent {artefact.id} is in the table already")
        pose, body = artefact.history.latest, body or Body.of(artefact.row)
        end = goes_to[1] if goes_to else pose
        artefact.history = self.history.begin(artefact.id, artefact.arrival_ns, pose, goes_to)
        self.artefacts.insert(row, artefact)
        self.states.insert(row, None)
        self._tracks.insert(row, track)
        self._add_pose(row, artefact, pose, end)
        self._add_record(row, artefact.id, body)
        self.arrays.place["is_scripted"][row] = track is not None
        self.set_behaviour(row, artefact.behaviour)
        self.stand(row, end)

    def remove(self, agent_id: int) -> None:
        """Remove an agent; KeyError if it is not there. Its history stays valid."""
        (row,) = self.rows_of([agent_id]).tolist()
        self.artefacts.pop(row).history.close()
        del self.states[row], self._tracks[row]
        is_moving = self.ends is not self.poses
        ends, end_packed = without_row(self.ends, row), without_row(self.end_boxes.packed, row)
        self.ids, self.radii_m = without_row(self.ids, row), without_row(self.radii_m, row)
        self._shapes = without_row(self._shapes, row)
        self.poses = without_row(self.poses, row)
        self.boxes = _boxes_at(self.poses, without_row(self.boxes.packed, row))
        self.ends = ends if is_moving else self.poses
        self.end_boxes = _boxes_at(ends, end_packed) if is_moving else self.boxes
        count = len(self)
        for array in (*self._records, self._lives):
            _move_rows(array, row + 1, count + 1, row)

    def row_of(self, agent_id: int) -> int:
        """Return the row of an agent, or where it would be inserted."""
        return int(self.ids.searchsorted(agent_id))

    def rows_of(self, agent_ids: Sequence[int]) -> npt.NDArray[np.int64]:
        """Return the rows (M,) of agents; KeyError if one is not there."""
        ids = np.array(agent_ids, np.int64)
        rows = self.ids.searchsorted(ids)
        if (self.ids.searchsorted(ids, "right") == rows).any():
            raise KeyError(f"not all of the agents {ids.tolist()} are there")
        return rows

    def state_of(self, agent_id: int) -> "AgentState | None":
        """Return the decision state of an agent, None if it has none; KeyError if not there."""
        return self.states[int(self.rows_of([agent_id])[0])]

    def set_behaviour(self, row: int, behaviour: str) -> None:
        """Set the behaviour of the agent of a row."""
        if behaviour not in self._behaviours:
            self._behaviours.append(behaviour)
        self._lives["behaviour"][row] = self._behaviours.index(behaviour)
        self.artefacts[row].behaviour = behaviour

    def doing_now(self) -> Callable[[str], npt.NDArray[np.int64]]:
        """Return a function of a behaviour: the rows of the agents that have it now, ascending."""
        numbers, known = self._lives["behaviour"][: len(self)].copy(), self._behaviours.copy()

        def rows_of(behaviour: str) -> npt.NDArray[np.int64]:
            number = known.index(behaviour) if behaviour in known else -1
            return np.flatnonzero(numbers == number)

        return rows_of

    @property
    def tracks(self) -> list[tuple[int, FollowedTrack]]:
        """The tracks, with the rows of the agents that follow them."""
        rows = np.flatnonzero(self.arrays.place["is_scripted"]).tolist()
        tracks = [(row, self._tracks[row]) for row in rows]
        return [(row, track) for row, track in tracks if track is not None]

    @property
    def leaving_ns(self) -> npt.NDArray[np.int64]:
        """When each agent began to leave [ns], (N,); STAYS for the others."""
        since_ns: npt.NDArray[np.int64] = self._lives["leaving"][: len(self)]
        return since_ns

    def postpone(self, from_ns: int, until_ns: int) -> None:
        """Let a time not count: tracks, patience on the way out, and being stuck go on after it.

        For an agent that arrived meanwhile the rest of it counts. The waiting times that behaviours
        keep themselves are not moved.
        """
        arrivals_ns = np.array([one.arrival_ns for one in self.artefacts], np.int64)
        by_ns = until_ns - np.maximum(arrivals_ns, from_ns)
        leaving_ns = self.leaving_ns
        is_leaving = leaving_ns != STAYS
        leaving_ns[is_leaving] += by_ns[is_leaving]
        rows = zip(self._tracks, self.states, by_ns.tolist(), strict=True)
        for track, state, own_ns in rows:
            if track is not None:
                track.postpone(own_ns)
            if state is not None:
                state.postpone(own_ns)

    @property
    def phases(self) -> npt.NDArray[np.int64]:
        """The sub-step of a decision period in which each agent decides, (N,); -1 for never."""
        phases: npt.NDArray[np.int64] = self._lives["phase"][: len(self)]
        return phases

    @property
    def taken(self) -> OrientedBoxes:
        """The boxes (N or 2 N) at the present and end poses, which arrivals must not overlap."""
        if self.ends is self.poses:
            return self.boxes
        packed = np.concatenate((self.boxes.packed, self.end_boxes.packed))
        return _boxes_at(np.concatenate((self.poses, self.ends)), packed)

    @property
    def motion(self) -> _Floats:
        """Poses and speeds of all now, float64 (N, 6), in the map frame.

        x, y [m], yaw [rad], cos, sin, speed along yaw [m/s].
        """
        return self.committed(0)

    def committed(self, ahead: int) -> _Floats:
        """Return `motion` as it will be in `ahead` sub-steps: committed paths end in a stand."""
        arrays = self.arrays
        steps = np.minimum(self.now + ahead - arrays.place["begin"], arrays.place["last"])
        motion: _Floats = arrays.path[np.arange(len(steps)), steps]
        return motion

    def stand(self, row: int, pose: GroundPose) -> None:
        """Stop the agent of a row at a pose, without a trajectory; others plan anew."""
        place, yaw = self.arrays.place[row], pose.yaw_rad
        self.arrays.path[row, 0] = pose.x_m, pose.y_m, yaw, np.cos(yaw), np.sin(yaw), 0.0
        place["begin"], place["last"], place["pace"] = self.now, 0, 0.0
        place["x"], place["y"] = pose.x_m, pose.y_m
        place["reach"] = self.arrays.body["radius"][row]
        place["must_plan"], place["is_news"], self.arrays.due[row] = 0, 1, self.now

    def proposed(
        self, planar: _Floats, moved: _Mask, environment: Environment
    ) -> tuple[_Floats, OrientedBoxes]:
        """Return poses (N, 4) and boxes with the agents `moved` (N,) at `planar` (N, 3): x, y, yaw.

        The other agents keep their numbers, to the bit.
        """
        if not moved.any():
            return self.poses, self.boxes
        poses, packed = self.poses.copy(), self.boxes.packed.copy()
        poses[moved, :2], poses[moved, 3] = planar[moved, :2], planar[moved, 2]
        boxes = OrientedBoxes.standing(poses[moved], self._shapes[moved])
        if not self._is_plane:
            poses[moved, 2] = environment.ground_heights_m(boxes)
            boxes = OrientedBoxes.standing(poses[moved], self._shapes[moved])
        packed[moved] = boxes.packed
        return poses, _boxes_at(poses, packed)

    def with_poses(
        self, poses: _Floats, rows: npt.NDArray[np.int64], others: _Floats
    ) -> tuple[_Floats, OrientedBoxes]:
        """Return poses (N, 4) with those of some rows replaced (M, 4), and the boxes there."""
        poses = poses.copy()
        poses[rows] = others
        return poses, self.boxes_at(poses)

    def boxes_at(self, poses: _Floats) -> OrientedBoxes:
        """Return the boxes (N) of the agents at poses (N, 4)."""
        return OrientedBoxes.standing(poses, self._shapes)

    def move(self, poses: _Floats, boxes: OrientedBoxes) -> None:
        """Set all poses (N, 4) and boxes; the end poses are the same."""
        self.poses = self.ends = poses
        self.boxes = self.end_boxes = boxes

    def set_ends(self, ends: _Floats, boxes: OrientedBoxes) -> None:
        """Set the end poses (N, 4) and boxes; `ends` is `poses` if no agent moves."""
        self.ends, self.end_boxes = ends, boxes

    def _add_pose(self, row: int, artefact: Artefact, pose: GroundPose, end: GroundPose) -> None:
        """Insert a row into the arrays that are replaced."""
        half_x_m, half_y_m, _, offset_x_m, offset_y_m = shape = shape_of(artefact.row)
        radius_m = math.hypot(half_x_m + abs(offset_x_m), half_y_m + abs(offset_y_m))
        box, end_box = (
            OrientedBoxes.standing(np.array([one]), np.array([shape])) for one in (pose, end)
        )
        is_moving = self.ends is not self.poses or end != pose
        ends, end_packed = with_row(self.ends, row, end), self.end_boxes.packed
        self.ids = with_row(self.ids, row, artefact.id)
        self.radii_m = with_row(self.radii_m, row, radius_m)
        self._shapes = with_row(self._shapes, row, shape)
        self.poses = with_row(self.poses, row, pose)
        self.boxes = _boxes_at(self.poses, with_row(self.boxes.packed, row, box.packed))
        self.ends = ends if is_moving else self.poses
        self.end_boxes = self.boxes
        if is_moving:
            self.end_boxes = _boxes_at(ends, with_row(end_packed, row, end_box.packed))

    def _add_record(self, row: int, agent_id: int, body: Body) -> None:
        """Insert a row into the arrays that kernels write into."""
        count = len(self)
        if count > len(self._lives):
            self._lives = np.concatenate((self._lives, np.zeros_like(self._lives)))
            self._records = AgentArrays(
                *(np.concatenate((array, np.zeros_like(array))) for array in self._records)
            )
        for array in (*self._records, self._lives):
            _move_rows(array, row, count - 1, row + 1)
            array[row] = np.zeros((), array.dtype)
        self._lives["phase"][row], self._lives["leaving"][row] = -1, STAYS
        place, memory = self.arrays.place[row], self.arrays.memory[row]
        _state.write_body(self.arrays.body[row], body, self._height_step(body.height_m))
        place["id"], memory["passed_at"], memory["chosen"] = agent_id, _state.NEVER, np.nan
        self.arrays.command[row] = STAND_ROW
        forget_blockade(memory)

    def _height_step(self, height_m: float) -> int:
        """Return the index in `heights` of a body's height, rounded up to 0.25 m."""
        steps = math.ceil(height_m / HEIGHT_STEP_M)
        if steps not in self.heights:
            self.heights.append(steps)
        return self.heights.index(steps)

    @property
    def arrays(self) -> AgentArrays:
        """The kernels' view of the records of all."""
        (place, body, command, memory, due, path), count = self._records, len(self)
        return AgentArrays(
            place[:count], body[:count], command[:count], memory[:count], due[:count], path[:count]
        )


def _move_rows(array: npt.NDArray[Any], start: int, stop: int, to: int) -> None:
    """Move rows [start, stop) to another index, as bytes: numpy then makes no extra copy."""
    data = array.reshape(-1).view(np.uint8)
    size = data.size // len(array)
    data[to * size : (to + stop - start) * size] = data[start * size : stop * size]


def with_row(rows: npt.NDArray[Any], index: int, row: npt.ArrayLike) -> npt.NDArray[Any]:
    """Return rows with one inserted before an index; much faster than `np.insert`."""
    wider = np.empty((len(rows) + 1, *rows.shape[1:]), rows.dtype)
    wider[:index], wider[index], wider[index + 1 :] = rows[:index], row, rows[index:]
    return wider


def without_row(rows: npt.NDArray[Any], index: int) -> npt.NDArray[Any]:
    """Return rows without the one at an index; much faster than by a mask."""
    return np.concatenate((rows[:index], rows[index + 1 :]))


def _boxes_at(poses: _Floats, packed: _Floats) -> OrientedBoxes:
    """Return packed boxes (N, 8) of bodies at poses (N, 4)."""
    return OrientedBoxes.of_packed(packed, poses[:, 3])
