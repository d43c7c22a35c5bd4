"""What a recording says, for the judge of scans: scans, frames, truth; no code of are_ros."""

import math
from collections import defaultdict, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_types_from_msg
from scipy.spatial.transform import Rotation, Slerp

from tests.oracles.recordings import NS_PER_S, SCAN, TRANSFORMS, store

Floats = npt.NDArray[np.float64]
Pose = tuple[Floats, Floats]
"""A rotation matrix (3, 3) and a translation (3,) [m]."""
ODOMETRY = "nav_msgs/msg/Odometry"
GRID = "nav_msgs/msg/OccupancyGrid"
CLOUD = "sensor_msgs/msg/PointCloud2"
DEPARTED, DISPLACED = 1, 3
MESSAGES = Path(__file__).resolve().parents[2] / "msg_defs" / "are_msgs" / "msg"


@dataclass(frozen=True, eq=False)
class Scan:
    """A laser scan as it was recorded."""

    stamp_ns: int
    log_ns: int
    message: Any
    ranges: npt.NDArray[np.float32]

    def ways(self) -> Floats:
        """Return the unit vectors (N, 3) of the beams in the laser's frame."""
        turns = self.message.angle_min + self.message.angle_increment * np.arange(len(self.ranges))
        return np.stack((np.cos(turns), np.sin(turns), np.zeros(len(turns))), axis=1)


class Frames:
    """The tree of frames over the whole recording; poses between samples are interpolated."""

    def __init__(self) -> None:
        self._samples: dict[tuple[str, str], list[tuple[float, ...]]] = defaultdict(list)
        self._stamps: dict[tuple[str, str], list[int]] = defaultdict(list)
        self._static: dict[tuple[str, str], Pose] = {}
        self._edges: dict[tuple[str, str], tuple[npt.NDArray[np.int64], Floats, Slerp | None]] = {}
        self._paths: dict[tuple[str, str], list[tuple[str, str, bool]] | None] = {}

    def add(self, parent: str, child: str, stamp_ns: int, shift: Any, turn: Any) -> None:
        """Take one sample of an edge: messages of a vector and a quaternion."""
        edge = (parent.lstrip("/"), child.lstrip("/"))
        self._stamps[edge].append(stamp_ns)
        self._samples[edge].append((shift.x, shift.y, shift.z, turn.x, turn.y, turn.z, turn.w))

    def add_static(self, parent: str, child: str, pose: Pose) -> None:
        """Take an edge that never changes."""
        self._static[parent.lstrip("/"), child.lstrip("/")] = pose

    def children(self) -> set[str]:
        """Return the frames that have a parent."""
        return {child for _, child in (*self._stamps, *self._static)}

    def lookup(
        self, target: str, source: str, stamp_ns: int, held: tuple[str, ...] = ()
    ) -> Pose | None:
        """Return the pose of `source` in `target` at a stamp, None where it is not known.

        After its last sample the edge between the frames `held` stays what it was.
        """
        path = self._path(target, source.lstrip("/"))
        if path is None:
            return None
        rotation, shift = np.eye(3), np.zeros(3)
        for parent, child, is_down in path:
            pose = self._edge_at((parent, child), stamp_ns, {parent, child} == {*held})
            if pose is None:
                return None
            turn, move = pose if is_down else (pose[0].T, -pose[0].T @ pose[1])
            rotation, shift = rotation @ turn, rotation @ move + shift
        return rotation, shift

    def _edge_at(self, edge: tuple[str, str], stamp_ns: int, is_held: bool) -> Pose | None:
        if edge in self._static:
            return self._static[edge]
        if edge not in self._edges:
            self._edges[edge] = self._sorted(edge)
        stamps, values, slerp = self._edges[edge]
        stamp_ns = min(stamp_ns, int(stamps[-1])) if is_held else stamp_ns
        after = int(np.searchsorted(stamps, stamp_ns))
        if after < len(stamps) and stamps[after] == stamp_ns:
            return Rotation.from_quat(values[after, 3:]).as_matrix(), values[after, :3]
        if after in {0, len(stamps)} or slerp is None:
            return None
        share = (stamp_ns - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
        shift = (1.0 - share) * values[after - 1, :3] + share * values[after, :3]
        return slerp((stamp_ns - stamps[0]) / NS_PER_S).as_matrix(), shift

    def _sorted(self, edge: tuple[str, str]) -> tuple[npt.NDArray[np.int64], Floats, Slerp | None]:
        stamps, last = np.unique(np.array(self._stamps[edge])[::-1], return_index=True)
        values = np.array(self._samples[edge])[::-1][last]
        if len(stamps) < 2:
            return stamps, values, None
        seconds = (stamps - stamps[0]) / NS_PER_S
        return stamps, values, Slerp(seconds, Rotation.from_quat(values[:, 3:]))

    def _path(self, target: str, source: str) -> list[tuple[str, str, bool]] | None:
        """Return the edges from target to source, each with whether it is gone down."""
        if (target, source) not in self._paths:
            self._paths[target, source] = self._found_path(target, source)
        return self._paths[target, source]

    def _found_path(self, target: str, source: str) -> list[tuple[str, str, bool]] | None:
        paths: dict[str, list[tuple[str, str, bool]]] = {target: []}
        queue = deque([target])
        while queue:
            frame = queue.popleft()
            for parent, child in (*self._stamps, *self._static):
                other = child if frame == parent else parent if frame == child else None
                if other is not None and other not in paths:
                    paths[other] = [*paths[frame], (parent, child, frame == parent)]
                    queue.append(other)
        return paths.get(source)


@dataclass(eq=False)
class Inputs:
    """The real side of a recording."""

    frames: Frames = field(default_factory=Frames)
    scans: dict[str, list[Scan]] = field(default_factory=lambda: defaultdict(list))
    grid: Any = None
    cloud: Any = None


@dataclass(eq=False)
class Tick:
    """The artefacts' truth at a stamp: by id, poses x, y, z, yaw and rates x, y, yaw in F_A."""

    stamp_ns: int
    poses: dict[int, Floats]
    rates: dict[int, Floats]


@dataclass(eq=False)
class Outputs:
    """What a run says: its ticks, its scans by topic, and who departed or was displaced when."""

    ticks: list[Tick] = field(default_factory=list)
    scans: dict[str, list[Scan]] = field(default_factory=lambda: defaultdict(list))
    departed_ns: dict[int, int] = field(default_factory=dict)
    displaced_ns: dict[int, list[int]] = field(default_factory=lambda: defaultdict(list))
    kinds: dict[int, Any] = field(default_factory=dict)


def read_inputs(
    recording: Path,
    static: Iterable[str] = (),
    odometry: Sequence[str] = (),
    base: str = "base_footprint",
    duration_s: float | None = None,
) -> Inputs:
    """Read a recording; `static` are lines "X Y Z YAW PITCH ROLL PARENT CHILD".

    `odometry` are topics that give an edge where tf gives its child no parent. What was logged
    after `duration_s` is not known.
    """
    found, moves = Inputs(), []
    for line in static:
        _take_line(found.frames, line)
    for topic, kind, log_ns, message in _messages(recording, duration_s=duration_s):
        if kind == TRANSFORMS:
            for one in message.transforms:
                _take_transform(found.frames, one, is_static=topic.endswith("tf_static"))
        elif kind == SCAN:
            found.scans[topic].append(_scan(log_ns, message))
        elif kind == ODOMETRY and topic in odometry:
            moves.append(message)
        elif kind == GRID:
            found.grid = message
        elif kind == CLOUD:
            found.cloud = message
    _take_odometry(found.frames, moves, base)
    return found


def _take_odometry(frames: Frames, messages: Iterable[Any], base: str) -> None:
    """Take the edges to children that have no parent in tf."""
    known = frames.children()
    for message in messages:
        child, pose = message.child_frame_id or base, message.pose.pose
        if child not in known:
            stamp_ns, parent = stamp_of(message), message.header.frame_id
            frames.add(parent, child, stamp_ns, pose.position, pose.orientation)


def read_outputs(results: Path) -> Outputs:
    """Read what a run wrote: artefacts, events and augmented scans; else nothing."""
    found = Outputs()
    for topic, kind, log_ns, message in _messages(results, "/ar_builder/"):
        if kind == "are_msgs/msg/ArtefactArray":
            found.ticks.append(_tick(message, found.kinds))
        elif kind == "are_msgs/msg/ArtefactEvent":
            if message.kind == DEPARTED:
                found.departed_ns[message.id] = stamp_of(message)
            elif message.kind == DISPLACED:
                found.displaced_ns[message.id].append(stamp_of(message))
        elif kind == SCAN:
            found.scans[topic].append(_scan(log_ns, message))
    found.ticks.sort(key=lambda tick: tick.stamp_ns)
    return found


def stamp_of(message: Any) -> int:
    """Return the stamp of a message's header [ns]."""
    stamp = message.header.stamp
    return int(stamp.sec * NS_PER_S + stamp.nanosec)


def _scan(log_ns: int, message: Any) -> Scan:
    return Scan(stamp_of(message), log_ns, message, np.asarray(message.ranges, dtype=np.float32))


def _tick(message: Any, kinds: dict[int, Any]) -> Tick:
    poses, rates = {}, {}
    for one in message.artefacts:
        at, turn = one.pose.position, one.pose.orientation
        if max(abs(turn.x), abs(turn.y)) > 1e-9:
            raise AssertionError(f"artefact {one.id} is not upright")
        poses[one.id] = np.array((at.x, at.y, at.z, 2.0 * math.atan2(turn.z, turn.w)))
        speed = one.twist.linear
        rates[one.id] = np.array((speed.x, speed.y, one.twist.angular.z))
        kinds.setdefault(one.id, one)
    return Tick(stamp_of(message), poses, rates)


def _take_line(frames: Frames, line: str) -> None:
    *numbers, parent, child = line.split()
    x, y, z, *angles = map(float, numbers)
    turn = Rotation.from_euler("ZYX", angles).as_matrix()
    frames.add_static(parent, child, (turn, np.array((x, y, z))))


def _take_transform(frames: Frames, one: Any, *, is_static: bool) -> None:
    shift, turn = one.transform.translation, one.transform.rotation
    parent, child = one.header.frame_id, one.child_frame_id
    if is_static:
        rotation = Rotation.from_quat((turn.x, turn.y, turn.z, turn.w)).as_matrix()
        frames.add_static(parent, child, (rotation, np.array((shift.x, shift.y, shift.z))))
    else:
        frames.add(parent, child, stamp_of(one), shift, turn)


def _messages(
    recording: Path, prefix: str = "", duration_s: float | None = None
) -> Iterable[tuple[str, str, int, Any]]:
    """Yield (topic, type, log time, message) of the types that are read here."""
    types = store()
    for text in MESSAGES.glob("*.msg"):
        types.register(get_types_from_msg(text.read_text(), f"are_msgs/msg/{text.stem}"))
    read = {TRANSFORMS, SCAN, ODOMETRY, GRID, CLOUD}
    if prefix:
        read = {SCAN, "are_msgs/msg/ArtefactArray", "are_msgs/msg/ArtefactEvent"}
    with AnyReader([recording], default_typestore=types) as reader:
        wanted = [c for c in reader.connections if c.msgtype in read and c.topic.startswith(prefix)]
        stop = None if duration_s is None else reader.start_time + round(duration_s * NS_PER_S)
        for connection, log_ns, data in reader.messages(connections=wanted, stop=stop):
            message = reader.deserialize(data, connection.msgtype)
            yield connection.topic, connection.msgtype, log_ns, message
