"""Histories on a tape are the legs that each artefact was given."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from are_ros.agents.trajectory_buffer import BufferedHistory, TrajectoryBuffer, motions_at
from are_ros.conventions import NS_PER_S
from are_ros.population.artefact import GroundPose, between, rates_between
from tests.agents.histories import GivenPoses

STEP_NS = NS_PER_S // 20
HISTORY_NS = NS_PER_S


@dataclass
class NavigationResult:
    """From when and where to when and where one goes."""

    start_ns: int
    start: GroundPose
    until_ns: int
    end: GroundPose


class Twins:
    """Random lives, kept on a tape, and beside it each by itself, as plainly as can be: in legs."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.buffer = TrajectoryBuffer(HISTORY_NS)
        self.now_ns = 40 * STEP_NS
        self.living: list[int] = []
        self.taped: dict[int, BufferedHistory] = {}
        self.plain: dict[int, list[NavigationResult]] = {}

    def arrive(self, artefact_id: int, t_ns: int, until_ns: int) -> None:
        """Let one come, that may be on its way to where it will be at the next sub-step."""
        pose = self._pose()
        goes = self.random.random() < 0.5
        result = NavigationResult(t_ns, pose, until_ns, self._pose() if goes else pose)
        self.living = sorted([*self.living, artefact_id])
        goes_to = (result.until_ns, result.end) if goes else None
        self.taped[artefact_id] = self.buffer.begin(artefact_id, t_ns, pose, goes_to)
        self.plain[artefact_id] = [result]

    def depart(self, artefact_id: int) -> None:
        """Let one go."""
        self.living.remove(artefact_id)
        self.taped[artefact_id].close()

    def sub_step(self, t_ns: int) -> None:
        """Let some stand, some move and some jump."""
        for artefact_id in self.living:
            was, what = self.plain[artefact_id][-1].end, self.random.random()
            start = self._pose() if what < 0.1 else was
            end = start if what < 0.4 else self._pose()
            end = start._replace(y_m=-0.0) if what > 0.9 else end
            self.plain[artefact_id].append(NavigationResult(t_ns, start, t_ns + STEP_NS, end))
        results = [self.plain[artefact_id][-1] for artefact_id in self.living]
        poses = [
            _rows([result.start for result in results]),
            _rows([result.end for result in results]),
        ]
        ids = np.array(self.living, np.int64)
        self.buffer.record(t_ns, t_ns + STEP_NS, ids, *poses)

    def live_on(self) -> None:
        """Let some come and go at instants of their own, and then the next sub-step begin."""
        steps = int(self.random.integers(2, 6)) if self.random.random() < 0.1 else 1
        end_ns = self.now_ns + steps * STEP_NS
        for t_ns in sorted(self.random.integers(self.now_ns, end_ns, 3).tolist()):
            what = self.random.random()
            if what < 0.15:
                free = set(range(12)) - set(self.plain)
                if free:
                    self.arrive(int(self.random.choice(list(free))), t_ns, end_ns)
            elif what < 0.2 and self.living:
                self.depart(int(self.random.choice(self.living)))
        self.now_ns = end_ns
        if self.living:
            self.sub_step(end_ns)

    def check(self, t_ns: int) -> None:
        """Compare all that have come by `t_ns`, one by one and all at once."""
        there = [i for i, results in self.plain.items() if results[0].start_ns <= t_ns]
        for i in there:
            result = [result for result in self.plain[i] if result.start_ns <= t_ns][-1]
            if i in self.living or t_ns > self.now_ns - HISTORY_NS // 2:
                assert self.taped[i].pose_at(t_ns) == _pose_on(result, t_ns)
                assert self.taped[i].velocity_at(t_ns) == _velocity_on(result, t_ns)
            assert self.taped[i].latest == self.plain[i][-1].end
            if i in self.living:
                assert self.taped[i].latest_ns == self.plain[i][-1].until_ns or not any(
                    self.taped[i].velocity_at(self.plain[i][-1].start_ns)
                )
        poses, rates = motions_at([self.taped[i] for i in there], t_ns)
        alone = [self.taped[i].pose_at(t_ns) for i in there]
        assert poses.tobytes() == np.array(alone, np.float64).tobytes()
        own_rates = [self.taped[i].velocity_at(t_ns) for i in there]
        assert rates.tobytes() == np.array(own_rates, np.float64).tobytes()

    def _pose(self) -> GroundPose:
        x_m, y_m, z_m = self.random.normal(size=3).tolist()
        return GroundPose(x_m, y_m, z_m, 4.0 * float(self.random.normal()))


def _rows(poses: list[GroundPose]) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array(poses, np.float64).reshape(-1, 4)


def _pose_on(result: NavigationResult, t_ns: int) -> GroundPose:
    if t_ns >= result.until_ns or result.start == result.end:
        return result.end
    if t_ns == result.start_ns:
        return result.start
    return between(
        result.start, result.end, (t_ns - result.start_ns) / (result.until_ns - result.start_ns)
    )


def _velocity_on(result: NavigationResult, t_ns: int) -> tuple[float, float, float]:
    if t_ns >= result.until_ns:
        return 0.0, 0.0, 0.0
    return rates_between(result.start_ns, result.start, result.until_ns, result.end)


def each_has_its_legs(seed: int) -> None:
    """At the sub-steps, next to them and in between, as far back as is kept, and on to the next."""
    twins = Twins(seed)
    for _ in range(70):
        twins.live_on()
        now_ns = twins.now_ns
        instants = [now_ns, now_ns - 1, now_ns + 7, now_ns - STEP_NS, now_ns - HISTORY_NS]
        instants += [now_ns + STEP_NS - 1, now_ns + STEP_NS, now_ns + 2 * STEP_NS]
        for t_ns in (*instants, int(now_ns - twins.random.integers(HISTORY_NS))):
            twins.check(t_ns)
    assert len(twins.buffer.times_ns) <= 2 + HISTORY_NS // STEP_NS


# A seed does not shrink to anything simpler.
PHASES = [Phase.explicit, Phase.generate]


@settings(max_examples=12, deadline=None, phases=PHASES)
@given(seed=st.integers(0, 10**6))
def test_a_tape_gives_the_legs_that_each_was_given(seed: int) -> None:
    """In a dozen lives of three and a half seconds."""
    each_has_its_legs(seed)


@pytest.mark.long
@settings(max_examples=60, deadline=None, phases=PHASES)
@given(seed=st.integers(0, 10**6))
def test_a_tape_gives_the_legs_of_many(seed: int) -> None:
    """In many more."""
    each_has_its_legs(seed)


def _march(buffer: TrajectoryBuffer, steps: int, ways_m: Mapping[int, float]) -> None:
    """Let each go its way in each sub-step."""
    ids = np.array(sorted(ways_m), np.int64)
    for k in range(steps):
        before, after = (
            np.array([[ways_m[i] * n, 0.0, 0.0, 0.0] for i in ids.tolist()]) for n in (k, k + 1)
        )
        buffer.record(k * STEP_NS, (k + 1) * STEP_NS, ids, before, after)


def test_the_tape_knows_since_when_all_stand() -> None:
    """Who moves, comes on his way or jumps moves; who stands does not."""
    buffer, ids = TrajectoryBuffer(HISTORY_NS), np.array([1])
    rows, others = np.zeros((1, 4)), np.ones((1, 4))
    buffer.begin(1, 5, GroundPose(0.0, 0.0, 0.0, 0.0))
    assert buffer.still_since_ns == 0
    buffer.record(STEP_NS, 2 * STEP_NS, ids, rows, rows)
    buffer.record(2 * STEP_NS, 3 * STEP_NS, ids, rows, rows)
    assert buffer.still_since_ns == STEP_NS
    buffer.record(3 * STEP_NS, 4 * STEP_NS, ids, rows, others)
    assert buffer.still_since_ns == 4 * STEP_NS
    buffer.record(4 * STEP_NS, 5 * STEP_NS, ids, others, others)
    assert buffer.still_since_ns == 4 * STEP_NS
    buffer.record(5 * STEP_NS, 6 * STEP_NS, ids, rows, rows)
    assert buffer.still_since_ns == 5 * STEP_NS
    far = GroundPose(1.0, 0.0, 0.0, 0.0)
    buffer.begin(2, 5 * STEP_NS + 7, GroundPose(0.0, 0.0, 0.0, 0.0), (6 * STEP_NS, far))
    assert buffer.still_since_ns == 6 * STEP_NS
    buffer.clear()
    buffer.record(2 * STEP_NS, 3 * STEP_NS, ids, rows, rows)
    assert buffer.still_since_ns == 2 * STEP_NS


def test_the_departed_keep_what_they_had() -> None:
    """While the tape has it; then where they were last."""
    buffer = TrajectoryBuffer(HISTORY_NS)
    gone, _ = (buffer.begin(i, 0, GroundPose(0.0, 0.0, 0.0, 0.0)) for i in (1, 2))
    _march(buffer, 4, {1: 1.0, 2: 0.1})
    gone.close()
    ids, rows = np.array([2]), np.zeros((1, 4))
    for k in range(4, 50):
        buffer.record(k * STEP_NS, (k + 1) * STEP_NS, ids, rows, rows)
        assert gone.pose_at((k + 1) * STEP_NS).x_m == 4.0
        if k < 15:
            assert gone.pose_at(7 * STEP_NS // 2).x_m == pytest.approx(3.5)
            assert gone.velocity_at(7 * STEP_NS // 2)[0] == pytest.approx(20.0)
    assert gone.velocity_at(7 * STEP_NS // 2) == (0.0, 0.0, 0.0)
    buffer.clear()
    assert gone.latest.x_m == 4.0


def test_histories_of_no_tape_are_read_beside() -> None:
    """As those of artefacts that go by a track."""
    buffer, pose = TrajectoryBuffer(HISTORY_NS), GroundPose(0.0, 0.0, 0.0, 0.0)
    walking, plain = buffer.begin(1, 0, pose), GivenPoses(0, pose)
    assert [array.tolist() for array in motions_at([], 5)] == [[], []]
    assert motions_at([plain, walking], 5)[0].tolist() == [[*pose], [*pose]]
    _march(buffer, 2, {1: 1.0})
    plain.append(2 * STEP_NS, pose._replace(yaw_rad=1.0))
    halves, rates = motions_at([plain, walking], STEP_NS)
    assert halves.tolist() == [[0.0, 0.0, 0.0, 0.5], [1.0, 0.0, 0.0, 0.0]]
    assert rates[1].tolist() == [1.0 / (STEP_NS / NS_PER_S), 0.0, 0.0]
    assert math.isclose(motions_at([walking], 3 * STEP_NS // 2)[0][0, 0], 1.5)
