"""Readings of sensors: what changed in them, and whether it may.

A kind of sensor with a message type of its own is a class here, named in `BEAMS`.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.oracle.solids import Cloud
from are_ros.messages.common import read_time

_CONE_STEP_RAD: Final = 0.02

_FREE: Final = frozenset(
    (
        *("x", "y", "z", "range", "distance"),
        *("intensity", "intensities", "reflectivity", "reflectance", "signal"),
    )
)
"""Fields that are others where a point moved onto an artefact."""

_SIZES: Final = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 8: 8}
"""Bytes of a number by the datatype of its PointField; of others nothing may change."""
_MOST_RAYS: Final = 2000
"""Of the rays of a reading that did not change, so many are looked at."""
_NOTHING_M: Final = 1e-3
_SAME_RAY: Final = 1e-5


def _no_flags() -> NDArray[np.bool_]:
    return np.empty(0, np.bool_)


@dataclass(frozen=True, eq=False)
class Changes:
    """How an augmented reading differs from its input.

    `fault` is what is wrong with it whatever the geometry is, else empty. `points_m` (M, K, 3) are
    where the M changed beams may end, in the sensor's frame: one place for a beam of a laser, some
    for a pixel, places `spacing_m` apart on its cap for a cone. A beam that came out as too close
    ends at the least range, and `too_close` (M,) is set. `unreturned` (M,) are the beams of a laser
    that had no return before.
    """

    fault: str = ""
    points_m: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 1, 3)))
    too_close: NDArray[np.bool_] = field(default_factory=_no_flags)
    unreturned: NDArray[np.bool_] = field(default_factory=_no_flags)
    spacing_m: float = 0.0


class Rays(NamedTuple):
    """The rays of a reading that came out as they had come in: unit vectors `ways` (N, 3).

    `limits_m` (N,) is up to where an artefact would be seen on them: the return, and where there
    was none (`unreturned`), the farthest that the sensor measures.
    """

    ways: NDArray[np.float64]
    limits_m: NDArray[np.float64]
    unreturned: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Sample(ABC):
    """A reading of a sensor as the checks decode it: its stamp, when it counts, and its frame.

    `noun` is what sentences call it.
    """

    noun: ClassVar[str]

    stamp_ns: int
    at_ns: int
    frame_id: str

    @classmethod
    @abstractmethod
    def of_message(cls, message: Any, at_ns: int) -> "Sample":
        """Return the sample of a message; ValueError where it is malformed."""

    @abstractmethod
    def changes(self, output: Any) -> Changes:
        """Return how an output of the same class differs from this input."""

    def unchanged(self, output: Any) -> Rays | None:  # noqa: ARG002 - of those that have rays
        """Return rays of the output that did not change; None of what has no single rays."""
        return None


@dataclass(frozen=True, eq=False)
class LaserSample(Sample):
    """A sensor_msgs/LaserScan; `ranges` and `intensities` float32, `numbers` the other fields."""

    noun: ClassVar[str] = "scan"

    numbers: Mapping[str, float]
    ranges: NDArray[np.float32]
    intensities: NDArray[np.float32]

    @classmethod
    def of_message(cls, message: Any, at_ns: int) -> "LaserSample":
        """Return the scan of a message."""
        names = (
            *("angle_min", "angle_max", "angle_increment"),
            *("time_increment", "scan_time", "range_min", "range_max"),
        )
        head, numbers = _head(message, at_ns), _numbers(message, names)
        return cls(*head, numbers, message.ranges, message.intensities)

    def changes(self, output: "LaserSample") -> Changes:
        """Return which beams changed, and whether they may: only nearer, the rest bit for bit."""
        fault = _differing_number(self.numbers, output.numbers) or self._length_fault(output)
        if fault:
            return Changes(fault)
        which, limits_m = _differing(self.ranges, output.ranges), self._limits_m
        fault = _range_fault(self.ranges, output.ranges, which, limits_m)
        if fault := fault or self._intensity_fault(output, which):
            return Changes(fault)
        ends_m, too_close = _ends(output.ranges[which], limits_m)
        ways = self._ways(which)
        unreturned = ~_are_returns(self.ranges[which], limits_m)
        return Changes("", (ends_m[:, None] * ways)[:, None], too_close, unreturned)

    def unchanged(self, output: "LaserSample") -> Rays:
        """Return the beams that did not change, but those that said "too close"."""
        is_same = self.ranges.view(np.uint32) == output.ranges.view(np.uint32)
        which = _spread(np.flatnonzero(is_same & ~np.isneginf(self.ranges)))
        unreturned = ~_are_returns(self.ranges[which], self._limits_m)
        limits_m = np.where(unreturned, self._limits_m[1], self.ranges[which])
        return Rays(self._ways(which), limits_m.astype(np.float64), unreturned)

    def _ways(self, which: NDArray[np.int64]) -> NDArray[np.float64]:
        # the increment of a single beam may be anything, as NaN in Gazebo
        step = self.numbers["angle_increment"] if len(self.ranges) > 1 else 0.0
        angles = self.numbers["angle_min"] + which * step
        return np.column_stack((np.cos(angles), np.sin(angles), np.zeros(len(angles))))

    @property
    def _limits_m(self) -> tuple[float, float]:
        return self.numbers["range_min"], self.numbers["range_max"]

    def _length_fault(self, output: "LaserSample") -> str:
        ours, theirs = ((len(s.ranges), len(s.intensities)) for s in (output, self))
        return "" if ours == theirs else f"has {ours} ranges and intensities, its input {theirs}"

    def _intensity_fault(self, output: "LaserSample", which: NDArray[np.int64]) -> str:
        if len(self.intensities) != len(self.ranges):
            return ""
        kept = np.ones(len(self.ranges), np.bool_)
        kept[which] = False
        dimmed = _differing(self.intensities, output.intensities)
        wrong = dimmed[kept[dimmed]]
        return f"changed the intensity of beam {wrong[0]}, but not its range" if len(wrong) else ""


@dataclass(frozen=True, eq=False)
class RangeSample(Sample):
    """A sensor_msgs/Range: `ranges` float32 (1,), `numbers` the other fields."""

    noun: ClassVar[str] = "range"

    numbers: Mapping[str, float]
    ranges: NDArray[np.float32]

    @classmethod
    def of_message(cls, message: Any, at_ns: int) -> "RangeSample":
        """Return the reading of a message."""
        names = ("radiation_type", "field_of_view", "min_range", "max_range")
        variance = float(getattr(message, "variance", 0.0))  # ROS 1 and Humble have none
        numbers = {**_numbers(message, names), "variance": variance}
        return cls(*_head(message, at_ns), numbers, np.array([message.range], np.float32))

    def changes(self, output: "RangeSample") -> Changes:
        """Return whether it changed, and may: only nearer, to anything in its cone."""
        limits_m = self.numbers["min_range"], self.numbers["max_range"]
        which = _differing(self.ranges, output.ranges)
        fault = _differing_number(self.numbers, output.numbers)
        fault = fault or _range_fault(self.ranges, output.ranges, which, limits_m)
        if not fault and len(which) and 0.0 < self.ranges[0] < np.float32(limits_m[0]):
            fault = f"has {output.ranges[0]} m, where its input has {self.ranges[0]} m, too close"
        if fault:
            return Changes(fault)
        ends_m, too_close = _ends(output.ranges[which], limits_m)
        points_m = ends_m[:, None, None] * _cone(self.numbers["field_of_view"])
        spacing_m = _CONE_STEP_RAD * float(ends_m.max(initial=0.0))
        return Changes("", points_m, too_close, np.zeros(len(which), np.bool_), spacing_m)


BEAMS: Final[Mapping[str, type[Sample]]] = MappingProxyType(
    {"sensor_msgs/msg/LaserScan": LaserSample, "sensor_msgs/msg/Range": RangeSample}
)
"""The samples by the type of their messages, of which nothing else is sent."""


def _head(message: Any, at_ns: int) -> tuple[int, int, str]:
    header = message.header
    return read_time(header.stamp), at_ns, str(header.frame_id).lstrip("/")


def _numbers(message: Any, names: tuple[str, ...]) -> Mapping[str, float]:
    return {name: float(getattr(message, name)) for name in names}


def _differing_number(real: Mapping[str, float], output: Mapping[str, float]) -> str:
    """Return a fault if a number is another one, else ""."""
    for name, theirs in real.items():
        ours = output[name]
        if ours != theirs and not (np.isnan(ours) and np.isnan(theirs)):
            return f"has {name} {ours}, its input {theirs}"
    return ""


def _spread(which: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return some of the indices, spread evenly."""
    count = min(len(which), _MOST_RAYS)
    return which[np.linspace(0, len(which) - 1, count).astype(np.int64)]


def _differing(real: NDArray[np.float32], output: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return where the bits differ."""
    return np.flatnonzero(real.view(np.uint32) != output.view(np.uint32))


def _range_fault(
    real: NDArray[np.float32],
    output: NDArray[np.float32],
    which: NDArray[np.int64],
    limits_m: tuple[float, float],
) -> str:
    """Return a fault unless the changed ranges are shorter, and valid or too close; else ""."""
    before, after = real[which], output[which]
    returned = _are_returns(before, limits_m)
    valid = np.isneginf(after) | _are_measured(after, limits_m)
    wrong = ~valid | (returned & ~(after < before)) | np.isneginf(before)
    if not wrong.any():
        return ""
    first = int(np.argmax(wrong))
    return f"has {after[first]} m in beam {which[first]}, where its input has {before[first]} m"


def _are_returns(ranges: NDArray[np.float32], limits_m: tuple[float, float]) -> NDArray[np.bool_]:
    """Tell which ranges are returns: those that the sensor measures, but for 0."""
    returned: NDArray[np.bool_] = _are_measured(ranges, limits_m) & (ranges > 0.0)
    return returned


def _are_measured(ranges: NDArray[np.float32], limits_m: tuple[float, float]) -> NDArray[np.bool_]:
    """Tell which ranges are finite and within the limits, of which the farther may be infinite."""
    low, high = np.float32(limits_m[0]), np.float32(limits_m[1])
    measured: NDArray[np.bool_] = np.isfinite(ranges) & (ranges >= low) & (ranges <= high)
    return measured


def _ends(
    ranges: NDArray[np.float32], limits_m: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return how far changed beams go [m], to the least range if too close, and which are that."""
    ends_m = ranges.astype(np.float64)
    too_close = np.isneginf(ends_m)
    ends_m[~np.isfinite(ends_m)] = limits_m[0]
    return ends_m, too_close


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


@dataclass(frozen=True, eq=False)
class SensorCloud(Sample):
    """A sensor_msgs/PointCloud2 of a sensor: points (N, 3) in its frame, and the bytes of each."""

    noun: ClassVar[str] = "point cloud"

    points_m: NDArray[np.float64]
    rows: NDArray[np.uint8]
    layout: tuple[Any, ...]
    height: int
    is_kept: NDArray[np.bool_]

    @classmethod
    def of_message(cls, message: Any, at_ns: int) -> "SensorCloud":
        """Return the cloud of a message; ValueError where x, y and z are not plain numbers."""
        cloud = Cloud.of_message(message, at_ns)
        used = np.asarray(message.data, np.uint8).reshape(message.height, message.row_step)
        rows = used[:, : message.width * message.point_step].reshape(-1, message.point_step)
        fields = [(one.name, one.offset, one.datatype, one.count) for one in message.fields]
        is_kept = np.ones(message.point_step, np.bool_)
        for name, offset, datatype, _ in fields:
            if name in _FREE:
                is_kept[offset : offset + _SIZES.get(datatype, 0)] = False
        return cls(
            read_time(message.header.stamp),
            at_ns,
            cloud.frame_id,
            cloud.centres_m,
            rows,
            (*fields, bool(message.is_bigendian), bool(message.is_dense), message.point_step),
            int(message.height),
            is_kept,
        )

    def changes(self, output: "SensorCloud") -> Changes:
        """Return which points changed, and whether they may.

        Points may only come nearer on their rays, keep all that does not depend on that, and follow
        the others where the cloud is not organised.
        """
        if fault := _layout_fault(self, output):
            return Changes(fault)
        count = len(self.rows)
        changed = np.flatnonzero((output.rows[:count] != self.rows).any(axis=1))
        which = np.concatenate((changed, np.arange(count, len(output.rows))))
        had = np.zeros(len(which), np.bool_)
        had[: len(changed)] = self.is_return[changed]
        if fault := _points_fault(self, output, changed, which[had]):
            return Changes(fault)
        ends_m = output.points_m[which][:, None]
        return Changes("", ends_m, np.zeros(len(which), np.bool_), ~had)

    def unchanged(self, output: "SensorCloud") -> Rays:
        """Return the rays of points that did not move; nothing tells where the others went."""
        is_same = (output.rows[: len(self.rows)] == self.rows).all(axis=1)
        points_m = self.points_m[_spread(np.flatnonzero(is_same & self.is_return))]
        limits_m = np.linalg.norm(points_m, axis=1)
        return Rays(points_m / limits_m[:, None], limits_m, np.zeros(len(limits_m), np.bool_))

    @property
    def is_return(self) -> NDArray[np.bool_]:
        """Which points (N,) came back: finite ones that are not at the sensor."""
        is_finite = np.isfinite(self.points_m).all(axis=1)
        away: NDArray[np.bool_] = np.linalg.norm(self.points_m, axis=1) > _NOTHING_M
        return is_finite & away


def _layout_fault(real: SensorCloud, output: SensorCloud) -> str:
    """Return what is wrong with fields and sizes, empty if nothing is."""
    ours, theirs = len(output.rows), len(real.rows)
    if output.layout != real.layout:
        return "has other fields than its input"
    is_organised = real.height > 1
    if output.height != real.height or ours < theirs or (is_organised and ours > theirs):
        return f"has {ours} points in {output.height} rows, its input {theirs} in {real.height}"
    return ""


def _points_fault(
    real: SensorCloud,
    output: SensorCloud,
    changed: NDArray[np.int64],
    returns: NDArray[np.int64],
) -> str:
    """Return what is wrong with changed points of the input (K,), of which some (R,) had a return.

    Empty if nothing is.
    """
    before_m, after_m = real.points_m[returns], output.points_m[returns]
    far_m, near_m = np.linalg.norm(before_m, axis=1), np.linalg.norm(after_m, axis=1)
    aside = np.linalg.norm(np.cross(before_m, after_m), axis=1) > _SAME_RAY * far_m * far_m
    wrong = ~(near_m <= far_m) | aside
    if wrong.any():
        return f"moved point {returns[np.argmax(wrong)]} away, or off its ray"
    is_kept = (output.rows[changed] == real.rows[changed])[:, real.is_kept].all(axis=1)
    if not is_kept.all():
        return f"changed more of point {changed[np.argmin(is_kept)]} than where it is"
    return ""
