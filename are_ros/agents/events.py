"""The outputs of a tick as plain values; `messages` converts them to ROS messages."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from are_ros.population.artefact import GroundPose, Origin
from are_ros.world.rigid_transform import RigidTransform


class EventKind(IntEnum):
    """Kinds of event, numbered as the constants of are_msgs/ArtefactEvent."""

    ARRIVED = 0
    DEPARTED = 1
    BLOCKED = 2
    DISPLACED = 3
    PERCEIVED = 4
    LOST = 5
    ROBOT_CONTACT = 6
    CHANGED = 7


@dataclass(frozen=True)
class ArtefactEvent:
    """One event of one artefact, at `stamp_ns`, in the map's frame.

    `detail` names a cause or a reason. `value` is the penetration of a robot contact or the
    distance of a displacement [m]; else 0.
    """

    stamp_ns: int
    kind: EventKind
    artefact_id: int
    label: str
    detail: str = ""
    value: float = 0.0


Vector3 = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class ArtefactState:
    """Ground truth of one living artefact at a tick (are_msgs/Artefact).

    Poses are in the map frame; `box_centre_m` and the twist are in F_A; `departure_ns` is 0 if it
    is not known in advance. `activity`, what it does at present, is one of the features, too.
    """

    artefact_id: int
    row: int
    label: str
    class_name: str
    map_from_artefact: RigidTransform
    ground_pose: GroundPose
    box_centre_m: Vector3
    size_m: Vector3
    linear_velocity_m_s: Vector3
    angular_velocity_rad_s: Vector3
    behaviour: str
    arrival_ns: int
    departure_ns: int
    origin: Origin
    features: Mapping[str, str]
    activity: str


@dataclass(frozen=True)
class Sighting:
    """How one member of A_f was last seen, at `seen_ns`.

    `cameras` are the names of those that saw it; all else is of the first: `roi_px` is (x, y,
    width, height) of the visible pixels, `range_m` the distance from the camera's centre to the
    nearest visible point.
    """

    visible_pixels: int
    unoccluded_pixels: int
    roi_px: tuple[int, int, int, int]
    range_m: float
    seen_ns: int = 0
    cameras: tuple[str, ...] = ()

    @property
    def visible_fraction(self) -> float:
        """The share of its pixels that are visible."""
        return self.visible_pixels / max(self.unoccluded_pixels, 1)


@dataclass(frozen=True, eq=False)
class PerceivedArtefact:
    """One member of A_f: a perceived artefact (are_msgs/PerceivedArtefact).

    The pose is that of F_A in the map's frame, with a 6x6 row-major covariance as ROS orders it
    (x, y, z, rotation about x, y, z). `behaviours` are those that it may have, the most probable
    first, and their probabilities, if it is there; empty where none is told.
    """

    artefact_id: int
    label: str
    classes: tuple[str, ...]
    probabilities: tuple[float, ...]
    map_from_artefact: RigidTransform
    pose_covariance: tuple[float, ...]
    size_m: Vector3
    linear_velocity_m_s: Vector3
    angular_velocity_rad_s: Vector3
    twist_covariance: tuple[float, ...]
    sighting: Sighting
    existence: float
    behaviours: tuple[str, ...] = ()
    behaviour_probabilities: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class PredictedPath:
    """Where a perceived artefact will be (are_msgs/PredictedPath).

    `numbers` float64 (K, 43) are poses of F_A in the map's frame, x, y, z [m] and the quaternion
    x, y, z, w, each followed by its covariance as in `PerceivedArtefact`. The first is one step
    after the list's stamp, the others are one step apart.
    """

    artefact_id: int
    numbers: npt.NDArray[np.float64]


@dataclass(frozen=True)
class SceneMetrics:
    """Counts since the start, and clutter, nu of Eq. 4, at one tick (are_msgs/SceneMetrics)."""

    alive: int
    perceived: int
    arrivals: int
    departures: int
    blocked: int
    displaced: int
    robot_contacts: int
    area_m2: float
    clutter_ratio: float
