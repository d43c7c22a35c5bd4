"""One artefact: a row of the catalogue with a life, and a pose as a function of time."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from are_ros.conventions import NS_PER_S
from are_ros.population.catalogue import CatalogueRow
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment
from are_ros.world.rigid_transform import RigidTransform

_JUMP_NS = 1_000_000


class Origin(IntEnum):
    """Where an artefact comes from; the numbers are those of are_msgs/Artefact."""

    RANDOM = 0
    SCRIPTED = 1
    SERVICE = 2


class GroundPose(NamedTuple):
    """F_A projected vertically on the ground, in the map frame: metres and radians."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float


class PoseHistory:
    """The pose of an artefact over time (p(., t), q(., t) of the paper); here it stands still."""

    def __init__(self, t_ns: int, pose: GroundPose) -> None:
        self._arrival_ns, self._pose = t_ns, pose

    @property
    def latest_ns(self) -> int:
        """Time of the newest pose."""
        return self._arrival_ns

    @property
    def latest(self) -> GroundPose:
        """The newest pose."""
        return self._pose

    def pose_at(self, t_ns: int) -> GroundPose:  # noqa: ARG002 - it stands still
        """Return the pose at `t_ns`."""
        return self._pose

    def velocity_at(self, t_ns: int) -> tuple[float, float, float]:  # noqa: ARG002 - it stands still
        """Return the rates of x, y [m/s] and yaw [rad/s] in the map frame as of `t_ns`."""
        return 0.0, 0.0, 0.0

    def close(self) -> None:
        """Note that no further pose will come."""


def between(start: GroundPose, end: GroundPose, fraction: float) -> GroundPose:
    """Interpolate from `start` (0) to `end` (1): yaw by the shorter arc, in [-pi, pi]."""
    x_m, y_m, z_m, yaw_rad = start
    turn_rad = math.remainder(end.yaw_rad - yaw_rad, math.tau)
    return GroundPose(
        x_m + fraction * (end.x_m - x_m),
        y_m + fraction * (end.y_m - y_m),
        z_m + fraction * (end.z_m - z_m),
        math.remainder(yaw_rad + fraction * turn_rad, math.tau),
    )


def rates_between(
    start_ns: int, start: GroundPose, end_ns: int, end: GroundPose
) -> tuple[float, float, float]:
    """Return the rates of x, y [m/s] and yaw [rad/s] from one pose to the next; none in a jump."""
    if end_ns - start_ns < _JUMP_NS:
        return 0.0, 0.0, 0.0
    per_s = NS_PER_S / (end_ns - start_ns)
    turn_rad = math.remainder(end.yaw_rad - start.yaw_rad, math.tau)
    return (end.x_m - start.x_m) * per_s, (end.y_m - start.y_m) * per_s, turn_rad * per_s


@dataclass(eq=False, slots=True)
class Artefact:
    """An artefact that is alive in the half-open interval [arrival, departure) [ns].

    `departure_ns` is None while the end is not known in advance. Ids are never reused. `behaviour`
    names its behaviour, `activity` what it does at present (empty: the same), `planner` the motion
    planner in use (empty: it does not plan). One that `may_change` chooses among the behaviours of
    its row again and again; else its behaviour was given. `options` are the arguments of its
    behaviour.
    """

    id: int
    row: CatalogueRow
    origin: Origin
    arrival_ns: int
    history: PoseHistory
    departure_ns: int | None = None
    behaviour: str = "standing"
    activity: str = ""
    planner: str = ""
    may_change: bool = False
    options: Mapping[str, Any] | None = None

    def ground_pose_at(self, t_ns: int) -> GroundPose:
        """Return the pose on the ground at `t_ns`, in the map frame."""
        return self.history.pose_at(t_ns)


def map_from_artefact(row: CatalogueRow, pose: GroundPose) -> RigidTransform:
    """Return the pose of F_A (the centre of mass) over the pose on the ground."""
    return RigidTransform.planar(pose.x_m, pose.y_m, pose.yaw_rad, z=pose.z_m + row.com_height_m)


def on_ground(row: CatalogueRow, pose: GroundPose, environment: Environment) -> GroundPose:
    """Return the pose with z set to the height of the ground under the footprint."""
    (height_m,) = environment.ground_heights_m(boxes_of([row], [pose])).tolist()
    return pose._replace(z_m=height_m)


def shape_of(row: CatalogueRow) -> tuple[float, float, float, float, float]:
    """Return the shape of a row's box as `OrientedBoxes.standing` takes it [m]."""
    (x_m, y_m, z_m), (offset_x_m, offset_y_m, _) = row.size_m, row.box_centre_in_artefact_m
    return 0.5 * x_m, 0.5 * y_m, 0.5 * z_m, offset_x_m, offset_y_m


def boxes_of(rows: Sequence[CatalogueRow], poses: Sequence[Sequence[float]]) -> OrientedBoxes:
    """Return the bounding boxes, in the map frame, of `rows` standing at `poses` (same length)."""
    unique = {id(row): row for row in rows}
    index = {key: k for k, key in enumerate(unique)}
    shapes = np.array([shape_of(row) for row in unique.values()]).reshape(-1, 5)
    of_each = shapes[np.array([index[id(row)] for row in rows], dtype=np.int64)]
    numbers = np.fromiter(chain.from_iterable(poses), np.float64, 4 * len(poses))
    return OrientedBoxes.standing(numbers.reshape(-1, 4), of_each)
