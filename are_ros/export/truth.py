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
from are_ros.replay.recorded_scene import LATEST_TICKS
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
            if number in places:
                was = places[number]
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
        its stamp, else as the tick knew it.
        """
        has_perceived = _PERCEIVED in self._types
        topics = {*self._roles, *also, _ARTEFACTS, *([_PERCEIVED] if has_perceived else [])}
        waiting: deque[tuple[Scene, RigidTransform | None]] = deque()
        sightings: dict[int, Sightings] = {}
        listed_ns = -1

        def first() -> TrueTick:
            scene, base = waiting.popleft()
            frames = self.parameters.frames.map, self.robot.base_frame()
            exact = self.robot.tree.try_lookup(*frames, scene.stamp_ns)
            base = base if exact is None else exact
            for at_ns in [one for one in sightings if one < scene.stamp_ns]:
                del sightings[at_ns]
            return TrueTick(scene, sightings.pop(scene.stamp_ns, {}), base)

        with self.recording as recording:
            self.left_out = tuple(filter(None, [recording.left_out]))
            for message in recording.messages(topics, open_progress):
                if message.topic in also:
                    also[message.topic](recording.deserialize(message))
                    continue
                value = recording.decode(message)
                if message.topic == _ARTEFACTS:
                    waiting.append((value, self.robot.poses(value.stamp_ns)[0]))
                elif message.topic == _PERCEIVED:
                    sightings[value.stamp_ns] = {one.artefact_id: one for one in value.sightings}
                    listed_ns = value.stamp_ns
                else:
                    self._take(message, value)
                while len(waiting) > 1 and (
                    not has_perceived
                    or waiting[0][0].stamp_ns <= listed_ns
                    or len(waiting) > LATEST_TICKS
                ):
                    yield first()
            while waiting:
                yield first()

    def _take(self, message: RecordedMessage, value: Any) -> None:
        """Take a transform, an odometry or a CameraInfo."""
        try:
            self.robot.take(self._roles[message.topic], value)
        except InputError as cause:
            raise BagError(f"{message.topic}: {cause}") from cause
