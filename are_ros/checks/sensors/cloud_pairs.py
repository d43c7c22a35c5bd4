"""Augmented point clouds beside their inputs: which points changed, and whether they may."""

from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from are_ros.bag.decoded import time_ns
from are_ros.checks.oracle.solids import Cloud
from are_ros.checks.sensors.beams import Changes, Sample

_FREE: Final = frozenset(
    (
        *("x", "y", "z", "range", "distance"),
        *("intensity", "intensities", "reflectivity", "reflectance", "signal"),
    )
)
"""Fields that are others where a point moved onto an artefact."""

_SIZES: Final = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 8: 8}
"""Bytes of a number by the datatype of its PointField; of others nothing may change."""
_NOTHING_M: Final = 1e-3
_SAME_RAY: Final = 1e-5


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
            time_ns(message.header.stamp),
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
