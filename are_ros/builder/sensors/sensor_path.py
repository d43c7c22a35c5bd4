"""The sensor path: each reading is augmented at its own stamp, when its transform is known.

A reading is one message of a sensor, for example a laser scan. It waits up to `wait_ns` for the
transform at its stamp. After that, the last map->odom is combined with the interpolated
odom->sensor (a slow correction may be held, odometry may not); if that is not possible either, the
reading passes through unaugmented and is counted. A reading that is older than the kept poses
passes through, too: its stamps are of another clock, or it was delayed. An image waits for the
first CameraInfo beside it in the same way.
"""

import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Protocol

from are_ros.agents.robots import without_stamp
from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.conventions import NEVER_NS, NS_PER_S
from are_ros.errors import FrameError, InputError
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.transforms.tree import FrameTree

CLOCKS_DIFFER: Final = "clocks differ, or the node does not keep up"
_WATCHED: Final = 50
"""The delays of transforms are kept for this many readings that did not wait long enough."""
_RECENT_NS: Final = 10 * NS_PER_S
"""And for so long."""
_NUMBERS: Final = re.compile(r"\d[\d.]*")
"""In these the reasons of one kind differ: the stamps."""
REACH: Final = 0.75
"""A reading may wait for this share of `poses.history`; the rest is for its own delay."""


class Reading(Protocol):
    """One message of a sensor; each kind of sensor implements this class."""

    @property
    def frame_id(self) -> str:
        """The sensor's frame."""

    @property
    def stamp_ns(self) -> int:
        """The time of measurement [ns]."""

    def augmented(self, map_from_sensor: RigidTransform, obstacles: Obstacles) -> Any:
        """Return the reading that the sensor would give if the artefacts were real.

        It is called once per reading, with the sensor's pose at the stamp. It returns the same
        object if no artefact changes the reading. If it raises InputError, the reading passes
        through as it is. Of an image, `seen_through(lens)` is called before.
        """


MakeReading = Callable[[str, int], Reading]
"""Makes a small reading of a kind of sensor, of a frame and a stamp [ns], for `warm_up`.

Its augmentation needs all kernels of the kind.
"""

Augment = Callable[[Any, RigidTransform], Any]


@dataclass(frozen=True, eq=False)
class ReleasedReading:
    """A reading that leaves the sensor path at `released_ns`, for the output of its topic.

    `received` is the reading as it was received, None if not known.
    """

    topic: str
    reading: Any
    released_ns: int
    is_augmented: bool
    received: Any = None


@dataclass(frozen=True, eq=False)
class _Waiting:
    topic: str
    reading: Reading
    received_ns: int
    deadline_ns: int


@dataclass
class SensorPathCounts:
    """Counts of readings: with the exact transform, with map->odom held, unaugmented."""

    exact: int = 0
    held: int = 0
    passed_through: int = 0


class Problem(NamedTuple):
    """A reason for which readings passed through: in its last words, and how many had it."""

    text: str
    readings: int


class SensorPath:
    """The queue of the waiting readings of one topic, in the order of reception.

    Readings of images also wait for the `lens`, from the CameraInfo on `lens_topic`.
    `odometry_frame` returns the frame whose pose in the map may be held, "" without one.
    """

    def __init__(
        self,
        frames: FrameTree,
        map_frame: str,
        odometry_frame: Callable[[], str],
        wait_ns: int,
        history_ns: int,
        augment: Augment,
        lens_topic: str = "",
        lacks_partner: Callable[[Reading], bool] = lambda _: False,
    ) -> None:
        self.wait_ns = wait_ns
        self.lens: Any = None
        self._lens_topic = lens_topic
        self._lacks_partner = lacks_partner
        self._history_ns = history_ns
        self.counts = SensorPathCounts()
        self.last_problem = ""
        self._problems: dict[str, Problem] = {}
        self._frames = frames
        self._map_frame = map_frame
        self._odometry_frame = odometry_frame
        self._augment = augment
        self._waiting: deque[_Waiting] = deque()
        self._too_early: deque[_Waiting] = deque(maxlen=_WATCHED)
        self._delays: deque[tuple[int, int]] = deque(maxlen=_WATCHED)
        """When a transform came too late, and how late [ns]."""
        self._outage_ended_ns = NEVER_NS
        self._released: list[ReleasedReading] = []

    def push(self, topic: str, reading: Reading, received_ns: int) -> None:
        """Take a reading; it is released at once if its transform is known already."""
        self._waiting.append(_Waiting(topic, reading, received_ns, received_ns + self.wait_ns))
        self.transforms_came(received_ns)

    @property
    def late_ns(self) -> int:
        """The longest delay [ns] of a transform among recent readings that waited too briefly.

        It is 0 if there was none: a longer wait would not have helped. Neither would it where the
        delay is about as long as poses are kept: then transforms had failed to come for a while.
        """
        most_ns = REACH * self._history_ns
        late_ns = (delay_ns for _, delay_ns in self._delays)
        return max((one for one in late_ns if self.wait_ns < one < most_ns), default=0)

    def next_deadline_ns(self) -> int | None:
        """Return the deadline of the first reading [ns], None if none waits."""
        return self._waiting[0].deadline_ns if self._waiting else None

    def transforms_came(self, now_ns: int) -> None:
        """Release the readings whose transform is known now, in order."""
        self._watch_too_early(now_ns)
        while self._waiting:
            head = self._waiting[0].reading
            if self._is_too_old(head, now_ns):
                self._release(self._waiting.popleft(), now_ns, None)
                continue
            pose = self._exact_pose(head)
            if pose is None or self._lacks_lens() or self._lacks_partner(head):
                return
            self._release(self._waiting.popleft(), now_ns, pose)

    def deadline_passed(self, now_ns: int) -> None:
        """Release the readings whose deadline is not after `now_ns`; map->odom may be held."""
        while self._waiting and self._waiting[0].deadline_ns <= now_ns:
            self._release_head(now_ns)
            self.transforms_came(now_ns)

    def take(self) -> list[ReleasedReading]:
        """Return the readings released since the last call."""
        released, self._released = self._released, []
        return released

    def flush(self, now_ns: int) -> None:
        """Release all that still waits: the input has ended."""
        while self._waiting:
            self._release_head(now_ns)

    def clear(self) -> None:
        """Drop the waiting readings: the clock jumped back."""
        self._waiting.clear()
        self._too_early.clear()
        self._delays.clear()
        self._outage_ended_ns = NEVER_NS

    def _watch_too_early(self, now_ns: int) -> None:
        """Measure the delay of transforms for readings that were released without them."""
        while self._delays and self._delays[0][0] < now_ns - _RECENT_NS:
            self._delays.popleft()
        found_ns = []
        while self._too_early:
            item, age_ns = self._too_early[0], now_ns - self._too_early[0].received_ns
            frames = self._map_frame, item.reading.frame_id
            if self._frames.try_lookup(*frames, item.reading.stamp_ns) is not None:
                found_ns.append(age_ns)
            elif age_ns < self._history_ns:
                break
            self._too_early.popleft()
        if max(found_ns, default=0) >= REACH * self._history_ns:
            self._outage_ended_ns = now_ns
        # What came before an outage ended is not late, also where another edge of the chain is
        # one message behind, so that its transform is found a little later.
        self._delays.extend(
            (now_ns, delay_ns) for delay_ns in found_ns if now_ns - delay_ns > self._outage_ended_ns
        )

    def _release_head(self, now_ns: int) -> None:
        """Release the first reading, with the best pose available."""
        item = self._waiting.popleft()
        if self._is_too_old(item.reading, now_ns):
            self._release(item, now_ns, None)
            return
        if self._lacks_lens():
            self._pass_through(
                f"no CameraInfo that can be used has come on {self._lens_topic}"
                " (sensors.camera_infos takes one from elsewhere)"
            )
            self._release(item, now_ns, None)
            return
        pose = self._exact_pose(item.reading)
        is_held = pose is None
        if pose is None:
            self._too_early.append(item)
            pose = self._held_pose(item.reading)
        self._release(item, now_ns, pose, is_held=is_held)

    def _lacks_lens(self) -> bool:
        return bool(self._lens_topic) and self.lens is None

    def _pass_through(self, problem: str) -> None:
        """Count a reading that is released unaugmented."""
        self.counts.passed_through += 1
        self.last_problem = problem
        kind = _NUMBERS.sub("", problem)
        before = self._problems[kind].readings if kind in self._problems else 0
        self._problems[kind] = Problem(problem, before + 1)

    @property
    def usual_problem(self) -> Problem:
        """The reason that most readings had that passed through; "" where none did."""
        return max(self._problems.values(), key=lambda one: one.readings, default=Problem("", 0))

    def _is_too_old(self, reading: Reading, now_ns: int) -> bool:
        """Return whether a reading is older than the kept poses of artefacts, and count it."""
        age_ns = now_ns - reading.stamp_ns
        if age_ns <= self._history_ns:
            return False
        problem = f"it {without_stamp(reading.stamp_ns)}: let its driver stamp it"
        if reading.stamp_ns > 0:
            problem = (
                f"its stamp is {age_ns / NS_PER_S:.1f} s old, but the artefacts' poses are kept for"
                f" {self._history_ns / NS_PER_S:g} s only (poses.history); {CLOCKS_DIFFER}"
            )
        self._pass_through(problem)
        return True

    def _exact_pose(self, reading: Reading) -> RigidTransform | None:
        return self._frames.try_lookup(self._map_frame, reading.frame_id, reading.stamp_ns)

    def _held_pose(self, reading: Reading) -> RigidTransform | None:
        odometry_frame = self._odometry_frame()
        try:
            if not odometry_frame:
                return self._frames.lookup(self._map_frame, reading.frame_id, reading.stamp_ns)
            return self._frames.lookup_held(
                self._map_frame, odometry_frame, reading.frame_id, reading.stamp_ns
            )
        except FrameError as cause:
            self._pass_through(str(cause))
            return None

    def _release(
        self,
        item: _Waiting,
        now_ns: int,
        map_from_sensor: RigidTransform | None,
        *,
        is_held: bool = False,
    ) -> None:
        """Release a reading, augmented if the sensor's pose is known."""
        reading: Any = item.reading
        if self._lens_topic and self.lens is not None:
            reading = reading.seen_through(self.lens)
        is_augmented = map_from_sensor is not None
        if map_from_sensor is not None:
            try:
                reading = self._augment(reading, map_from_sensor)
            except InputError as cause:
                self._pass_through(str(cause))
                is_augmented = False
        self.counts.held += is_augmented and is_held
        self.counts.exact += is_augmented and not is_held
        self._released.append(
            ReleasedReading(item.topic, reading, now_ns, is_augmented, item.reading)
        )
