"""The ground truth of a recording in its order: ticks with their artefacts, sightings and poses."""

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.bag.decoded import Scene, Sighting
from are_ros.bag.recording import PREFIX, RecordedMessage, Recording, find_recording
from are_ros.bag.roles import CAMERA, find_roles
from are_ros.errors import BagError, InputError
from are_ros.replay.progress import OpenProgress
from are_ros.replay.recorded_frames import ROBOT_ROLES, RecordedRobot
from are_ros.replay.recorded_scene import LATEST_TICKS, WAITING_TICKS
from are_ros.world.rigid_transform import RigidTransform

Sightings = Mapping[int, Sighting]

_ARTEFACTS, _PERCEIVED = PREFIX + "artefacts", PREFIX + "perceived"


@dataclass(frozen=True, eq=False)
class TrueTick:
    """The artefacts of a tick, how those that are perceived were seen, by id, and the robot."""

    scene: Scene
    sightings: Sightings
    map_from_base: RigidTransform | None


@dataclass(frozen=True, eq=False)
class Interval:
    """Two ticks that follow each other: between them is known where all were."""

    before: TrueTick
    after: TrueTick

    def poses_at(self, stamp_ns: int) -> dict[int, tuple[int, npt.NDArray[np.float64]]]:
        """Return place in `after.scene` and x, y, z, yaw (4,) of all that are in both ticks, by id.

        Positions and headings change evenly from tick to tick.
        """
        old, new = self.before.scene, self.after.scene
        share = (stamp_ns - old.stamp_ns) / max(new.stamp_ns - old.stamp_ns, 1)
        places = {number: k for k, number in enumerate(old.ids.tolist())}
        found = {}
        for k, number in enumerate(new.ids.tolist()):
            was = places.get(number)
            # a node that was started again gives ids another time
            if was is not None and old.arrivals_ns[was] == new.arrivals_ns[k]:
                there, here = old.poses[was, :3], new.poses[k, :3]
                turn = math.remainder(new.yaws_rad[k] - old.yaws_rad[was], math.tau)
                yaw = old.yaws_rad[was] + share * turn
                found[number] = k, np.array((*(there + share * (here - there)), yaw))
        return found


def chosen_topic(known: Sequence[str], name: str, data_set: str, option: str, without: str) -> str:
    """Return the known topic of this name, the only one if it is empty, or raise BagError.

    `without` is the reason where none is known.
    """
    if not known:
        raise BagError(f"{data_set}: {without}")
    wanted = [topic for topic in known if name.strip("/") in {topic.strip("/"), ""}]
    if len(wanted) != 1:
        reason = f"there is no {name}" if name else "there are several topics for it"
        raise BagError(f"{data_set}: {reason}; choose one with {option}: {', '.join(known)}")
    return wanted[0]


class _TickQueue:
    """Ticks that wait until all that belongs to the first of them has come."""

    def __init__(self, robot: RecordedRobot, map_frame: str, *, has_perceived: bool) -> None:
        self._robot, self._map_frame, self._has_perceived = robot, map_frame, has_perceived
        self._waiting: deque[tuple[Scene, RigidTransform | None]] = deque()
        self._sightings: dict[int, Sightings] = {}
        self._listed_ns = -1

    def add(self, scene: Scene) -> None:
        """Take the artefacts of a tick."""
        self._waiting.append((scene, self._robot.poses(scene.stamp_ns)[0]))

    def add_sightings(self, stamp_ns: int, sightings: Sequence[Sighting]) -> None:
        """Take the list of the perceived of a tick."""
        self._sightings[stamp_ns] = {one.artefact_id: one for one in sightings}
        self._listed_ns = stamp_ns

    def whole(self) -> Iterator[TrueTick]:
        """Yield the ticks that are whole, before the last one."""
        while len(self._waiting) > 1 and self._is_whole():
            yield self._first()

    def rest(self) -> Iterator[TrueTick]:
        """Yield the other ticks, at the end."""
        while self._waiting:
            yield self._first()

    def _is_whole(self) -> bool:
        count, stamp_ns = len(self._waiting), self._waiting[0][0].stamp_ns
        is_listed = not self._has_perceived or stamp_ns <= self._listed_ns or count > LATEST_TICKS
        return is_listed and (count > WAITING_TICKS or self._exact_pose() is not None)

    def _exact_pose(self) -> RigidTransform | None:
        frames = self._map_frame, self._robot.base_frame()
        return self._robot.tree.try_lookup(*frames, self._waiting[0][0].stamp_ns)

    def _first(self) -> TrueTick:
        exact = self._exact_pose()
        scene, base = self._waiting.popleft()
        for at_ns in [one for one in self._sightings if one < scene.stamp_ns]:
            del self._sightings[at_ns]
        seen = self._sightings.pop(scene.stamp_ns, {})
        return TrueTick(scene, seen, base if exact is None else exact)


class TruthReader:
    """Reads a recording of the node's outputs once, in its order. Raises BagError without truth."""

    def __init__(self, path: Path) -> None:
        found = find_recording(path)
        self.parameters = found.effective()
        self.left_out: tuple[str, ...] = ()
        """What `read` left out, as a sentence; none for nothing."""
        self.recording, self.untold = Recording(found), found.untold
        with self.recording as recording:
            self._types = {one.name: one.type_name for one in recording.topics if one.count}
            self._roles = find_roles(recording.topics, {}).by_topic(ROBOT_ROLES)
        if _ARTEFACTS not in self._types:
            raise BagError(f"{path}: it holds no {_ARTEFACTS}, so nothing is known of artefacts")
        has_camera_info = CAMERA in self._roles.values()
        self.robot = RecordedRobot(self.parameters, has_camera_info=has_camera_info)

    def outputs(self, type_name: str = "") -> list[str]:
        """Return the node's own topics, all or those of a type, in alphabetical order."""
        return sorted(
            topic
            for topic, one in self._types.items()
            if topic.startswith(PREFIX) and type_name in {one, ""}
        )

    def read(
        self, open_progress: OpenProgress, also: Mapping[str, Callable[[Any], None]]
    ) -> Iterator[TrueTick]:
        """Yield the ticks; `also` takes rosbags' objects of further topics, in their order.

        A tick is yielded after the next one has begun, and after the list of the perceived of it or
        of a later one has come, which the latency of a detector delays. The robot's pose is that at
        its stamp, which transforms tell that may come ticks later, else as the tick knew it.
        """
        has_perceived = _PERCEIVED in self._types
        topics = {*self._roles, *also, _ARTEFACTS, *([_PERCEIVED] if has_perceived else [])}
        queue = _TickQueue(self.robot, self.parameters.frames.map, has_perceived=has_perceived)
        with self.recording as recording:
            self.left_out = tuple(filter(None, [recording.left_out]))
            for message in recording.messages(topics, open_progress):
                if message.topic in also:
                    also[message.topic](recording.deserialize(message))
                    continue
                value = recording.decode(message)
                if message.topic == _ARTEFACTS:
                    queue.add(value)
                elif message.topic == _PERCEIVED:
                    queue.add_sightings(value.stamp_ns, value.sightings)
                else:
                    self._take(message, value)
                yield from queue.whole()
            yield from queue.rest()

    def _take(self, message: RecordedMessage, value: Any) -> None:
        """Take a transform, an odometry or a CameraInfo."""
        try:
            self.robot.take(self._roles[message.topic], value)
        except InputError as cause:
            raise BagError(f"{message.topic}: {cause}") from cause
