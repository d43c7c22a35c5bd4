"""The sensor path: each scan augmented at its own stamp, once its transform is there.

A scan waits up to `wait_ns` for the transform at its stamp. Then it takes the last map->odom with
the interpolated odom->sensor (a slow correction may be held, odometry may not), else it passes
through unaugmented and is counted. So does a scan from before all poses that are kept: its stamps
are those of another clock than the other inputs', or it was held up for long.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from are_ros.conventions import NS_PER_S
from are_ros.errors import FrameError
from are_ros.world.frame_tree import FrameTree
from are_ros.world.laser_scan import LaserScan
from are_ros.world.rigid_transform import RigidTransform

_WATCHED: Final = 50
"""Of so many scans that left too early it is known how late their transforms came."""

Augment = Callable[[LaserScan, RigidTransform], LaserScan]


@dataclass(frozen=True, eq=False)
class ReleasedScan:
    """A scan that leaves the sensor path at `released_ns`, for the output of its topic.

    `received` is what came in, None where that is not told.
    """

    topic: str
    scan: LaserScan
    released_ns: int
    is_augmented: bool
    received: LaserScan | None = None


@dataclass(frozen=True, eq=False)
class _Waiting:
    topic: str
    scan: LaserScan
    received_ns: int
    deadline_ns: int


@dataclass
class SensorPathCounts:
    """How scans left: with their exact transform, with map->odom held, or as they came."""

    exact: int = 0
    held: int = 0
    passed_through: int = 0


class SensorPath:
    """The queue of scans that wait, in the order of arrival."""

    def __init__(
        self,
        frames: FrameTree,
        map_frame: str,
        odom_frame: str,
        wait_ns: int,
        history_ns: int,
        augment: Augment,
    ) -> None:
        self.wait_ns = wait_ns
        self._history_ns = history_ns
        self.counts = SensorPathCounts()
        self.last_problem = ""
        self._frames = frames
        self._map_frame = map_frame
        self._odom_frame = odom_frame
        self._augment = augment
        self._waiting: deque[_Waiting] = deque()
        self._too_early: deque[_Waiting] = deque(maxlen=_WATCHED)
        self._late_ns: deque[int] = deque(maxlen=_WATCHED)
        self._released: list[ReleasedScan] = []

    def push(self, topic: str, scan: LaserScan, received_ns: int) -> None:
        """Take a scan in; it leaves at once if its transform is there already."""
        self._waiting.append(_Waiting(topic, scan, received_ns, received_ns + self.wait_ns))
        self.transforms_came(received_ns)

    @property
    def late_ns(self) -> int:
        """How long after a scan its transform came at most, of those that came too late lately.

        It is 0 where none did: a longer wait would have helped nobody.
        """
        return max((late_ns for late_ns in self._late_ns if late_ns > self.wait_ns), default=0)

    def next_deadline_ns(self) -> int | None:
        """Return when the scan that waits longest must leave, None if none waits."""
        return self._waiting[0].deadline_ns if self._waiting else None

    def transforms_came(self, now_ns: int) -> None:
        """Release the scans whose transform has become known; none overtakes another."""
        self._watch_too_early(now_ns)
        while self._waiting:
            if self._is_too_old(self._waiting[0].scan, now_ns):
                self._release(self._waiting.popleft(), now_ns, None)
                continue
            pose = self._exact_pose(self._waiting[0].scan)
            if pose is None:
                return
            self._release(self._waiting.popleft(), now_ns, pose)

    def deadline_passed(self, now_ns: int) -> None:
        """Release the scans whose deadline is not after `now_ns`, as well as it can be done.

        The last map->odom may be held, the motion since then may not.
        """
        while self._waiting and self._waiting[0].deadline_ns <= now_ns:
            self._release_head(now_ns)
            self.transforms_came(now_ns)

    def take(self) -> list[ReleasedScan]:
        """Return what was released since the last call."""
        released, self._released = self._released, []
        return released

    def flush(self, now_ns: int) -> None:
        """Release all that still waits: the input has ended."""
        while self._waiting:
            self._release_head(now_ns)

    def clear(self) -> None:
        """Drop what waits: the clock jumped back."""
        self._waiting.clear()
        self._too_early.clear()
        self._late_ns.clear()

    def _watch_too_early(self, now_ns: int) -> None:
        """Note how late the transforms are of scans that have left without them."""
        while self._too_early:
            item, age_ns = self._too_early[0], now_ns - self._too_early[0].received_ns
            frames = self._map_frame, item.scan.frame_id
            if self._frames.try_lookup(*frames, item.scan.stamp_ns) is not None:
                self._late_ns.append(age_ns)
            elif age_ns < self._history_ns:
                return
            self._too_early.popleft()

    def _release_head(self, now_ns: int) -> None:
        """Let the scan go that has waited longest, with the best pose that there is."""
        item = self._waiting.popleft()
        if self._is_too_old(item.scan, now_ns):
            self._release(item, now_ns, None)
            return
        pose = self._exact_pose(item.scan)
        if pose is None:
            self._too_early.append(item)
            pose = self._held_pose(item.scan)
        self._release(item, now_ns, pose)

    def _is_too_old(self, scan: LaserScan, now_ns: int) -> bool:
        """Count a scan that is older than the poses of the artefacts."""
        age_ns = now_ns - scan.stamp_ns
        if age_ns <= self._history_ns:
            return False
        self.counts.passed_through += 1
        self.last_problem = (
            f"its stamp is {age_ns / NS_PER_S:.1f} s old, but the artefacts' poses are kept for "
            f"{self._history_ns / NS_PER_S:g} s only (poses.history); most often clocks differ"
        )
        return True

    def _exact_pose(self, scan: LaserScan) -> RigidTransform | None:
        pose = self._frames.try_lookup(self._map_frame, scan.frame_id, scan.stamp_ns)
        self.counts.exact += pose is not None
        return pose

    def _held_pose(self, scan: LaserScan) -> RigidTransform | None:
        has_odometry = self._frames.has_frame(self._odom_frame)
        try:
            if not has_odometry:
                return self._frames.lookup(self._map_frame, scan.frame_id, scan.stamp_ns)
            pose = self._frames.lookup_held(
                self._map_frame, self._odom_frame, scan.frame_id, scan.stamp_ns
            )
        except FrameError as cause:
            self.counts.passed_through += 1
            self.last_problem = str(cause)
            return None
        self.counts.held += 1
        return pose

    def _release(self, item: _Waiting, now_ns: int, map_from_sensor: RigidTransform | None) -> None:
        scan = item.scan if map_from_sensor is None else self._augment(item.scan, map_from_sensor)
        is_augmented = map_from_sensor is not None
        self._released.append(ReleasedScan(item.topic, scan, now_ns, is_augmented, item.scan))
