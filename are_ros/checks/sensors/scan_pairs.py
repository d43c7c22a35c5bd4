"""Each augmented reading of a sensor beside its input: what changed, and whether it may."""

import math
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from are_ros.bag.decoded import Scan
from are_ros.bag.recording import PREFIX
from are_ros.checks.sensors.cloud_pairs import SensorCloud, changed_points
from are_ros.checks.sensors.depth_images import (
    DepthFrame,
    DepthPair,
    changed_pixels,
    info_topic,
    name_parts,
    rays_of,
)

_MOST_WAITING: Final = 2000
_MOST_IMAGES: Final = 40
_MOST_LENSES: Final = 4
_MOST_CLOUDS: Final = 100
_MOST_ENDS: Final = 2000
"""Of the changed pixels of an image, so many are looked at where they end."""
_TOO_NEAR_M: Final = 1e-3
_CONE_STEP_RAD: Final = 0.02
_GAP: Final = 1.5
"""In usual distances of scans: farther apart, there was one in between."""


_Key = tuple[int, str, type]
_Pair = tuple[str, Any, str, Any]
"""Topic and reading of an input, and of the output that was made of it."""


@dataclass(frozen=True, eq=False)
class Released:
    """An augmented reading: its topic and frame, its stamp, and when it went out [ns]."""

    topic: str
    stamp_ns: int
    released_ns: int
    frame_id: str


@dataclass(frozen=True, eq=False)
class ChangedScan(Released):
    """An augmented scan that differs from its input, or that is at fault without geometry.

    `points_m` (M, K, 3) are where the M changed beams may end, in the sensor's frame: one place for
    a beam of a laser, places `spacing_m` apart on its cap for a cone. A beam that came out as -inf
    ends where `range_min` does, and `too_close` (M,) is set. `unreturned` (M,) are the beams of a
    laser that had no return before.
    """

    points_m: NDArray[np.float64]
    too_close: NDArray[np.bool_]
    unreturned: NDArray[np.bool_]
    spacing_m: float
    fault: str


_Kind = TypeVar("_Kind")


class Kept(Generic[_Kind]):
    """Some of what came, at most so many, spread evenly: of too many, each second is dropped."""

    def __init__(self, most: int) -> None:
        self.kept: list[_Kind] = []
        self._most, self._every, self._seen = most, 1, 0

    def add(self, one: _Kind) -> None:
        """Keep one, or not."""
        if self._seen % self._every == 0:
            self.kept.append(one)
            if len(self.kept) > self._most:
                self.kept = self.kept[::2]
                self._every *= 2
        self._seen += 1


class Pairs:
    """Finds the input of each augmented reading by stamp, frame and kind, whichever comes first."""

    def __init__(self) -> None:
        self.pairs = 0
        self.input_topics: dict[str, type] = {}
        self._inputs: dict[_Key, list[tuple[str, Any]]] = {}
        self._outputs: dict[_Key, list[tuple[str, Any]]] = {}

    def unmatched(self) -> list[tuple[str, int]]:
        """Return topic and stamp of the augmented readings that have no input."""
        return [(topic, key[0]) for key, all_ in self._outputs.items() for topic, _ in all_]

    def matched(self, topic: str, reading: Any, most_waiting: int) -> list[_Pair]:
        """Take a reading, and return the pairs that it completes; the oldest inputs are dropped."""
        key = (reading.stamp_ns, reading.frame_id, type(reading))
        if topic.startswith(PREFIX):
            self._outputs.setdefault(key, []).append((topic, reading))
        else:
            self.input_topics[topic] = type(reading)
            self._inputs.setdefault(key, []).append((topic, reading))
            while len(self._inputs) > most_waiting:  # the node does not augment this sensor
                del self._inputs[next(iter(self._inputs))]
        inputs, outputs = self._inputs.pop(key, []), self._outputs.pop(key, [])
        is_only = list(self.input_topics.values()).count(key[2]) == 1
        found: list[_Pair] = []
        for output in list(outputs):
            own = [i for i, each in enumerate(inputs) if _is_of(output[0], each[0])]
            if own or (inputs and is_only):
                found.append((*inputs.pop(own[0] if own else 0), *output))
                outputs.remove(output)
        if inputs:
            self._inputs[key] = inputs
        if outputs:
            self._outputs[key] = outputs
        self.pairs += len(found)
        return found


class ScanPairs(Pairs):
    """The augmented scans, ranges, clouds and images of depths beside their inputs."""

    def __init__(self) -> None:
        super().__init__()
        self.changed: list[ChangedScan] = []
        self.clouds = self.depths = self.pixels = 0
        self.kept_depths = Kept[DepthPair](_MOST_IMAGES)
        self.infos: dict[str, Any] = {}
        """The last CameraInfo by topic; `add_info` takes it."""
        self._rays: deque[tuple[Any, bool, NDArray[np.float64]]] = deque(maxlen=_MOST_LENSES)
        self._input_stamps: dict[str, list[int]] = {}

    def add_info(self, topic: str, message: Any) -> None:
        """Take a CameraInfo; those beside images belong to the ones that come after."""
        self.infos[topic] = message

    def rays(self, info: Any, *, rectified: bool) -> NDArray[np.float64]:
        """Return the rays (H, W, 3) of images of a CameraInfo; ValueError for an unknown lens."""
        for known, is_rectified, rays in self._rays:
            if is_rectified == rectified and _are_alike(known, info):
                return rays
        rays = rays_of(info, rectified=rectified)
        self._rays.append((info, rectified, rays))
        return rays

    def add(self, topic: str, scan: Scan | SensorCloud | DepthFrame) -> None:
        """Take a scan, a range, a cloud or an image of depths of any topic."""
        if not topic.startswith(PREFIX):
            self._input_stamps.setdefault(topic, []).append(scan.stamp_ns)
        most = _MOST_WAITING if isinstance(scan, Scan) else _MOST_CLOUDS
        for source, real, name, output in self.matched(topic, scan, most):
            if isinstance(real, Scan):
                self._compare_scans(real, name, output)
            elif isinstance(real, SensorCloud):
                self._compare_clouds(real, name, output)
            else:
                self._compare_depths(source, real, name, output)

    def may_be_lost(self, output: str, stamp_ns: int) -> bool:
        """Tell whether the input of an augmented scan may be missing in the recording.

        It is if its laser is not known, or there is a gap about its stamp.
        """
        topics = [t for t in self._input_stamps if _is_of(output, t)] or [*self._input_stamps]
        if len(topics) != 1:
            return True
        stamps = sorted(self._input_stamps[topics[0]])
        place = bisect_left(stamps, stamp_ns)
        if place in {0, len(stamps)}:
            return True
        usual_ns = float(np.median(np.diff(stamps)))
        return stamps[place] - stamps[place - 1] > _GAP * usual_ns

    def _compare_depths(
        self, source: str, real: DepthFrame, topic: str, output: DepthFrame
    ) -> None:
        self.depths += 1
        self.pixels += real.numbers.size
        fault, which, unreturned = changed_pixels(real, output)
        info = self.infos.get(info_topic(source))
        if info is not None:
            is_rectified = "rect" in name_parts(source)[1]
            self.kept_depths.add(DepthPair(topic, real, output, info, is_rectified))
            if not _are_alike(info, self.infos.get(info_topic(topic))):
                fault = fault or "has a CameraInfo beside it that is not its input's"
        elif len(which):
            fault = "was changed, and no CameraInfo had come beside its input"
        if not fault and not len(which):
            return
        points_m, too_close = np.empty((0, 1, 3)), np.empty(0, np.bool_)
        if not fault:
            some = np.linspace(0, len(which) - 1, min(len(which), _MOST_ENDS)).astype(int)
            which, unreturned = which[some], unreturned[some]
            depths_m = output.depths_m.ravel()[which]
            too_close = ~np.isfinite(depths_m)
            depths_m[too_close] = _TOO_NEAR_M
            depths_m = depths_m - output.half_steps_m(depths_m)
            rays = self.rays(info, rectified=is_rectified).reshape(-1, 3)[which]
            points_m = (rays * depths_m[:, None])[:, None]
        when = output.stamp_ns, output.at_ns, output.frame_id
        self.changed.append(ChangedScan(topic, *when, points_m, too_close, unreturned, 0.0, fault))

    def _compare_clouds(self, real: SensorCloud, topic: str, output: SensorCloud) -> None:
        self.clouds += 1
        fault, which, unreturned = changed_points(real, output)
        if not fault and not len(which):
            return
        ends_m, too_close = output.points_m[which][:, None], np.zeros(len(which), np.bool_)
        when = output.stamp_ns, output.at_ns, output.frame_id
        self.changed.append(ChangedScan(topic, *when, ends_m, too_close, unreturned, 0.0, fault))

    def _compare_scans(self, real: Scan, topic: str, output: Scan) -> None:
        fault = _shape_fault(real, output)
        which = np.empty(0, np.int64) if fault else _differing(real.ranges, output.ranges)
        fault = fault or _values_fault(real, output, which)
        if not fault and not which.size:
            return
        ranges = output.ranges[which].astype(np.float64)
        too_close = np.isneginf(ranges)
        ranges[~np.isfinite(ranges)] = output.numbers["range_min"]
        cone_rad = output.numbers.get("field_of_view")
        if cone_rad is None:
            angles = output.numbers["angle_min"] + which * output.numbers["angle_increment"]
            ways = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(len(angles))))
            points = (ranges[:, None] * ways)[:, None]
            unreturned, spacing_m = ~_are_returns(real, real.ranges[which]), 0.0
        else:
            points = ranges[:, None, None] * _cone(cone_rad)
            unreturned = np.zeros(len(which), np.bool_)
            spacing_m = _CONE_STEP_RAD * float(ranges.max(initial=0.0))
        when = output.stamp_ns, output.at_ns, output.frame_id
        changed = ChangedScan(topic, *when, points, too_close, unreturned, spacing_m, fault)
        self.changed.append(changed)


def _cone(angle_rad: float) -> NDArray[np.float64]:
    """Return unit vectors (K, 3) all over a cone about the x-axis; the angle is the full one."""
    off_rad = np.linspace(0.0, 0.5 * angle_rad, math.ceil(0.5 * angle_rad / _CONE_STEP_RAD) + 1)
    rings = []
    for angle in off_rad.tolist():
        count = math.ceil(math.tau * math.sin(angle) / _CONE_STEP_RAD) or 1
        about = np.linspace(0.0, math.tau, count, endpoint=False)
        y, z = math.sin(angle) * np.cos(about), math.sin(angle) * np.sin(about)
        rings.append(np.column_stack((np.full(count, math.cos(angle)), y, z)))
    return np.concatenate(rings)


def _are_alike(one: Any, other: Any) -> bool:
    """Tell whether two CameraInfos have the same numbers, whatever their stamps are."""
    if one is other or other is None:
        return one is other
    names = ("height", "width", "distortion_model", "binning_x", "binning_y", "roi")
    plain = all(getattr(one, name) == getattr(other, name) for name in names)
    return plain and all(np.array_equal(getattr(one, k), getattr(other, k)) for k in "dkrp")


def _is_of(output: str, source: str) -> bool:
    """Tell whether an output's name is that of an input under the prefix."""
    return output.removeprefix(PREFIX) == source.lstrip("/")


def _shape_fault(real: Scan, output: Scan) -> str:
    for name, theirs in real.numbers.items():
        ours = output.numbers[name]
        if ours != theirs and not (np.isnan(ours) and np.isnan(theirs)):
            return f"has {name} {ours}, its input {theirs}"
    lengths = len(output.ranges), len(output.intensities)
    wanted = len(real.ranges), len(real.intensities)
    return "" if lengths == wanted else f"has {lengths} ranges and intensities, its input {wanted}"


def _differing(real: NDArray[np.float32], output: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return the beams whose bits differ."""
    return np.flatnonzero(real.view(np.uint32) != output.view(np.uint32))


def _values_fault(real: Scan, output: Scan, which: NDArray[np.int64]) -> str:
    """Check what needs no geometry: only shorter, valid or too close; the rest bit for bit."""
    before, after = real.ranges[which], output.ranges[which]
    returned = _are_returns(real, before)
    valid = np.isneginf(after) | _are_returns(real, after)
    wrong = ~valid | (returned & ~(after < before)) | np.isneginf(before)
    if wrong.any():
        first = int(np.argmax(wrong))
        return f"has {after[first]} m in beam {which[first]}, where its input has {before[first]} m"
    if len(real.intensities):
        kept = np.ones(len(real.ranges), np.bool_)
        kept[which] = False
        dimmed = _differing(real.intensities, output.intensities)
        if len(real.intensities) == len(real.ranges) and kept[dimmed].any():
            return f"changed the intensity of beam {dimmed[kept[dimmed]][0]}, but not its range"
    return ""


def _are_returns(scan: Scan, ranges: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Tell which ranges are returns that the laser measures."""
    low, high = (np.float32(scan.numbers[name]) for name in ("range_min", "range_max"))
    returned: NDArray[np.bool_] = (ranges >= low) & (ranges <= high)
    return returned
