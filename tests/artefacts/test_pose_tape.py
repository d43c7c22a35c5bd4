"""Histories on a tape are those that appending pose by pose gives."""

import math
import struct
from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from are_ros.artefacts.artefact import GroundPose, PoseHistory
from are_ros.artefacts.pose_tape import PoseTape, TapeHistory, poses_at
from are_ros.conventions import NS_PER_S

STEP_NS = NS_PER_S // 20
HISTORY_NS = NS_PER_S


class Twins:
    """Random lives, kept on a tape, and beside it each by itself, as plainly as can be."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.tape = PoseTape(HISTORY_NS)
        self.now_ns = 40 * STEP_NS
        self.poses: dict[int, GroundPose] = {}
        self.arrived_ns: dict[int, int] = {}
        self.taped: dict[int, TapeHistory] = {}
        self.plain: dict[int, PoseHistory] = {}

    def arrive(self, artefact_id: int, t_ns: int) -> None:
        """Let one come."""
        pose = self._pose()
        self.poses = dict(sorted((self.poses | {artefact_id: pose}).items()))
        self.arrived_ns[artefact_id] = t_ns
        self.taped[artefact_id] = self.tape.begin(artefact_id, t_ns, pose)
        self.plain[artefact_id] = PoseHistory(t_ns, pose, HISTORY_NS)

    def depart(self, artefact_id: int) -> None:
        """Let one go."""
        del self.poses[artefact_id]
        self.tape.stop(artefact_id)

    def sub_step(self, t_ns: int) -> None:
        """Let some stand, some move and some jump."""
        before, since_ns = self._rows(), t_ns - STEP_NS
        for artefact_id, was in self.poses.items():
            plain, what = self.plain[artefact_id], self.random.random()
            if what < 0.3:
                continue
            pose = was._replace(y_m=-0.0) if what > 0.9 else self._pose()
            if what < 0.4:
                self.taped[artefact_id].append(t_ns - 1, was)
                plain.append(t_ns - 1, was)
            elif plain.latest_ns < since_ns:
                plain.append(since_ns, plain.latest)
            plain.append(t_ns, pose)
            self.poses[artefact_id] = pose
        ids = np.array(list(self.poses), np.int64)
        self.tape.record(since_ns, t_ns, ids, before, self._rows())

    def live_on(self) -> None:
        """Let some come and go at instants of their own, and then the next sub-step end."""
        steps = int(self.random.integers(2, 6)) if self.random.random() < 0.1 else 1
        end_ns = self.now_ns + steps * STEP_NS
        for t_ns in sorted(self.random.integers(self.now_ns, end_ns, 3, endpoint=True).tolist()):
            what = self.random.random()
            if what < 0.15:
                free = set(range(12)) - set(self.plain)
                on_step = self.random.random() < 0.3
                if free:
                    self.arrive(int(self.random.choice(list(free))), end_ns if on_step else t_ns)
            elif what < 0.2 and self.poses:
                self.depart(int(self.random.choice(list(self.poses))))
        self.now_ns = end_ns
        if self.poses:
            self.sub_step(end_ns)

    def check(self, t_ns: int) -> None:
        """Compare all that have come by `t_ns`, one by one and all at once."""
        there = [i for i, arrival_ns in self.arrived_ns.items() if arrival_ns <= t_ns]
        for i in there:
            taped, plain = self.taped[i], self.plain[i]
            assert taped.pose_at(t_ns) == plain.pose_at(t_ns)
            if t_ns > self.now_ns - HISTORY_NS:  # the motion that ends there may be forgotten
                assert taped.velocity_at(t_ns) == plain.velocity_at(t_ns)
            assert taped.latest == plain.latest
        together = poses_at([self.taped[i] for i in there], t_ns)
        alone = [self.taped[i].pose_at(t_ns) for i in there]
        assert [struct.pack("4d", *pose) for pose in together] == [
            struct.pack("4d", *pose) for pose in alone
        ]

    def _pose(self) -> GroundPose:
        x_m, y_m, z_m = self.random.normal(size=3).tolist()
        return GroundPose(x_m, y_m, z_m, 4.0 * float(self.random.normal()))

    def _rows(self) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        return np.array(list(self.poses.values()), np.float64).reshape(-1, 4)


# A seed does not shrink to anything simpler.
@settings(max_examples=60, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(seed=st.integers(0, 10**6))
def test_a_tape_gives_the_histories_that_appending_gives(seed: int) -> None:
    """At the sub-steps, next to them and in between, as far back as is kept."""
    twins = Twins(seed)
    for _ in range(70):
        twins.live_on()
        now_ns = twins.now_ns
        instants = [now_ns, now_ns - 1, now_ns + 7, now_ns - STEP_NS, now_ns - HISTORY_NS]
        for t_ns in (*instants, int(now_ns - twins.random.integers(HISTORY_NS))):
            twins.check(t_ns)
    assert len(twins.tape.times_ns) <= 2 + HISTORY_NS // STEP_NS


def _march(tape: PoseTape, steps: int, ways_m: Mapping[int, float]) -> None:
    """Let each go its way in each sub-step."""
    ids = np.array(sorted(ways_m), np.int64)
    for k in range(steps):
        before, after = (
            np.array([[ways_m[i] * n, 0.0, 0.0, 0.0] for i in ids.tolist()]) for n in (k, k + 1)
        )
        tape.record(k * STEP_NS, (k + 1) * STEP_NS, ids, before, after)


def test_who_stands_has_the_same_pose_object_for_ever() -> None:
    """Though others move, and however it is asked for; another pose is another object."""
    tape = PoseTape(HISTORY_NS)
    standing, walking = (tape.begin(i, 0, GroundPose(0.0, 0.0, 0.0, 0.0)) for i in (1, 2))
    pose, start = standing.latest, walking.latest
    _march(tape, 50, {1: 0.0, 2: 0.1})
    end_ns = 50 * STEP_NS
    assert standing.latest is pose
    assert standing.pose_at(end_ns - 5) is pose
    for t_ns in (end_ns, end_ns - 5):
        assert poses_at([standing, walking], t_ns)[0] is pose
    assert walking.latest is not start
    assert walking.latest is walking.latest is poses_at([standing, walking], end_ns)[1]
    assert walking.latest_ns == end_ns


def test_the_departed_keep_what_they_had() -> None:
    """While the tape has it; then where they were last."""
    tape = PoseTape(HISTORY_NS)
    gone, _ = (tape.begin(i, 0, GroundPose(0.0, 0.0, 0.0, 0.0)) for i in (1, 2))
    _march(tape, 4, {1: 1.0, 2: 0.1})
    tape.stop(1)
    ids, rows = np.array([2]), np.zeros((1, 4))
    for k in range(4, 50):
        tape.record(k * STEP_NS, (k + 1) * STEP_NS, ids, rows, rows)
        assert gone.pose_at((k + 1) * STEP_NS).x_m == 4.0
        if k < 15:
            assert gone.pose_at(7 * STEP_NS // 2).x_m == pytest.approx(3.5)
            assert gone.velocity_at(7 * STEP_NS // 2)[0] == pytest.approx(20.0)
    assert gone.velocity_at(7 * STEP_NS // 2) == (0.0, 0.0, 0.0)
    tape.clear()
    assert gone.latest.x_m == 4.0


def test_histories_of_no_tape_are_read_beside() -> None:
    """As those of artefacts that go by a track."""
    tape, pose = PoseTape(HISTORY_NS), GroundPose(0.0, 0.0, 0.0, 0.0)
    walking, plain = tape.begin(1, 0, pose), PoseHistory(0, pose)
    assert poses_at([], 5) == []
    assert poses_at([plain, walking], 5) == [pose, pose]
    _march(tape, 2, {1: 1.0})
    plain.append(2 * STEP_NS, pose._replace(yaw_rad=1.0))
    halves = poses_at([plain, walking], STEP_NS)
    assert halves == [pose._replace(yaw_rad=0.5), pose._replace(x_m=1.0)]
    assert math.isclose(poses_at([walking], 3 * STEP_NS // 2)[0].x_m, 1.5)
