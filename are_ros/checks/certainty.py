"""What a detector and a tracker told, compared with the truth by the covariances they told."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainccinv, gammaincinv

from are_ros.bag.decoded import Perceived, Scene, Sighting
from are_ros.checks.oracle.plane import PlainBoxes, about_z
from are_ros.checks.oracle.solids import Cover, Covers, RealMap
from are_ros.checks.record import Record
from are_ros.checks.result import CheckResult, Tally, at_s, skipped
from are_ros.checks.sightings import FIRST_FALSE_ALARM
from are_ros.conventions import seconds_to_ns

Floats = NDArray[np.float64]

_PLANAR: Final = np.ix_((0, 1, 5), (0, 1, 5))
_LEVEL: Final = 1e-9
"""The probability with which the check of a right recording fails, for each thing tested."""
_CERTAIN_M: Final = 1e-9
"""What is stated without any variance is right to this."""


class PerceivedPlaces:
    """The cells that what is perceived covers where it is perceived."""

    def __init__(self) -> None:
        self._offsets_m: dict[int, Floats] = {}
        self._covers: Covers | None = None

    def learn(self, scene: Scene) -> None:
        """Learn where the boxes of artefacts sit in F_A: those of false alarms, in the middle."""
        self._offsets_m |= dict(zip(scene.ids.tolist(), scene.box_centres_m, strict=True))

    def covers(self, message: Perceived, real: RealMap) -> dict[int, Cover]:
        """Return the cells of each, by id."""
        if self._covers is None or self._covers.real is not real:
            self._covers = Covers(real)
        found = self._covers.of(self._boxes(message))
        return dict(zip((one.artefact_id for one in message.sightings), found, strict=True))

    def _boxes(self, message: Perceived) -> PlainBoxes:
        nothing = np.zeros(3)
        seen = message.sightings
        poses = np.array([one.pose for one in seen]).reshape(-1, 7)
        sizes_m = np.array([one.size_m for one in seen]).reshape(-1, 3)
        offsets_m = [self._offsets_m.get(one.artefact_id, nothing) for one in seen]
        yaws = 2.0 * np.arctan2(poses[:, 5], poses[:, 6])
        return PlainBoxes.standing(poses[:, :3], yaws, np.array(offsets_m).reshape(-1, 3), sizes_m)


class _Deviation(NamedTuple):
    """The normalised square of an error, and how many components had a variance."""

    square: float
    dimensions: int


class _Squares:
    """Sums the normalised squared errors of the first reports of tracks: these are independent."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._sum, self._dimensions = 0.0, 0

    def take(self, tally: Tally, where: str, found: _Deviation, *, is_first: bool) -> None:
        """Judge a deviation, and add it if it is that of a first report."""
        limit = 2.0 * gammainccinv(0.5 * found.dimensions, _LEVEL) if found.dimensions else 0.0
        text = f"{where} is off by a normalised square of {found.square:.3g} in its {self.name}"
        tally.require(found.square <= limit, text)
        if is_first:
            self._sum += found.square
            self._dimensions += found.dimensions

    def judge(self, tally: Tally) -> None:
        """Compare the sum with chi-square of as many degrees of freedom."""
        if not self._dimensions:
            return
        half = 0.5 * self._dimensions
        low, high = 2.0 * gammaincinv(half, _LEVEL), 2.0 * gammainccinv(half, _LEVEL)
        mean = self._sum / self._dimensions
        text = f"normalised squared errors of the {self.name} are {mean:.2f} in the mean, not 1"
        tally.look()
        tally.require(low <= self._sum <= high, text)
        tally.note(f"squared errors of the {self.name}: {mean:.2f} of those stated")


class _FirstBehaviours:
    """Compares the behaviours of the first reports of tracks with the truth.

    Where the most probable one is said with p, it is the true one with the probability p. The sum
    over independent tracks is within Hoeffding's bound, whatever the probabilities are.
    """

    def __init__(self) -> None:
        self._said, self._right, self._tracks = 0.0, 0, 0

    def take(self, one: Sighting, truth: str) -> None:
        """Add the first report of a track."""
        if one.behaviours:
            self._said += one.behaviour_probabilities[0]
            self._right += one.behaviours[0] == truth
            self._tracks += 1

    def judge(self, tally: Tally) -> None:
        """Compare the sums."""
        if not self._tracks:
            return
        tally.look()
        tally.require(
            abs(self._right - self._said) <= np.sqrt(0.5 * self._tracks * np.log(2.0 / _LEVEL)),
            f"of {self._tracks} behaviours {self._right} are true, and {self._said:.1f} are said",
        )
        tally.note(f"behaviours: {self._right} of {self._tracks} true, {self._said:.1f} said")


def check_certainty(record: Record) -> CheckResult:
    """Compare errors of poses and velocities with the covariances stated with them.

    No single error is beyond what happens once in 10^9, and the first reports of the tracks follow
    chi-square together; so many behaviours are true as their probabilities say. False alarms and
    departed artefacts have no truth to compare with.
    """
    tally = Tally("certainty", "sighting")
    scenes = {scene.stamp_ns: scene for scene in record.scenes}
    poses, twists = _Squares("pose"), _Squares("velocity")
    behaviours, before = _FirstBehaviours(), frozenset[int]()
    for message in record.perceived:
        scene = scenes.get(message.stamp_ns)
        places = {} if scene is None else {i: k for k, i in enumerate(scene.ids.tolist())}
        for one in message.sightings:
            k = places.get(one.artefact_id)
            if scene is None or k is None:
                is_false = one.artefact_id >= FIRST_FALSE_ALARM
                what = "of a false alarm" if is_false else "of what is not there then"
                tally.leave_out("sighting", what)
                continue
            tally.look()
            where = f"{at_s(message.at_ns)} id {one.artefact_id}"
            is_first = one.artefact_id not in before
            poses.take(tally, where, _of_pose(one, scene, k), is_first=is_first)
            twists.take(tally, where, _of_twist(one, scene, k), is_first=is_first)
            if is_first:
                behaviours.take(one, scene.behaviours[k])
        before = message.ids
    for judged in (poses, twists, behaviours):
        judged.judge(tally)
    return tally.result()


def _of_pose(one: Sighting, scene: Scene, k: int) -> _Deviation:
    """Compare x, y and yaw with the truth."""
    yaw = 2.0 * np.arctan2(one.pose[5], one.pose[6])
    turn = np.remainder(yaw - scene.yaws_rad[k] + np.pi, 2.0 * np.pi) - np.pi
    error = np.array((*(np.array(one.pose[:2]) - scene.poses[k, :2]), turn))
    return _normalised(error, np.array(one.pose_covariance).reshape(6, 6)[_PLANAR])


def _of_twist(one: Sighting, scene: Scene, k: int) -> _Deviation:
    """Compare the rates in the map; the twist is in the axes of the pose that was told."""
    turn = about_z(2.0 * np.arctan2(one.pose[5], one.pose[6]))
    told = turn @ np.array((one.twist[0], one.twist[1], one.twist[5]))
    covariance = np.array(one.twist_covariance).reshape(6, 6)[_PLANAR]
    return _normalised(told - scene.rates[k], turn @ covariance @ turn.T)


def _normalised(error: Floats, covariance: Floats) -> _Deviation:
    """Return e^T C^-1 e over the axes with a variance; infinite where one without is wrong."""
    values, axes = np.linalg.eigh(covariance)
    parts = axes.T @ error
    is_open = values > _CERTAIN_M**2
    if (np.abs(parts[~is_open]) > _CERTAIN_M).any() or not np.isfinite(parts).all():
        return _Deviation(float("inf"), 0)
    square = float(np.sum(parts[is_open] ** 2 / values[is_open]))
    return _Deviation(square, int(is_open.sum()))


def check_predicted(record: Record) -> CheckResult:
    """Each list of paths is that of the perceived of its stamp, and ever less sure."""
    name = "predicted paths"
    if not record.predicted:
        return skipped(name, "there is no ~/predicted")
    tally, settings = Tally(name, "path"), record.settings.certainty
    lists = {message.stamp_ns: message.ids for message in record.perceived}
    step_ns = seconds_to_ns(settings.prediction_step)
    count = int(settings.prediction_horizon / settings.prediction_step + 1e-9)
    for message in record.predicted:
        where = at_s(message.at_ns)
        if message.stamp_ns not in lists and record.is_live:
            tally.leave_out("message", "without its list of the perceived")
            continue
        ids = lists.get(message.stamp_ns, frozenset())
        tally.require(ids == frozenset(message.paths), f"{where} the ids are not the perceived")
        tally.require(message.step_ns == step_ns, f"{where} the step is {message.step_ns} ns")
        for number, path in message.paths.items():
            tally.look()
            tally.require(len(path) == count, f"{where} id {number} has {len(path)} poses")
            spreads = path[:, 7] + path[:, 14]  # the variances of x and y
            is_sensible = np.isfinite(path).all() and (np.diff(spreads) >= 0.0).all()
            tally.require(bool(is_sensible), f"{where} id {number} becomes more sure ahead")
    return tally.result()
