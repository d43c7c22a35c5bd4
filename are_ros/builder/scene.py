"""The artefacts of one instant as columns: what the grids, the camera and the messages read."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import ArtefactState
from are_ros.agents.trajectory_buffer import motions_at
from are_ros.population.artefact import Artefact, GroundPose, boxes_of, map_from_artefact
from are_ros.population.catalogue import TOLD, CatalogueRow
from are_ros.world.boxes import OrientedBoxes

_Columns = npt.NDArray[np.float64]
Status = tuple[int | None, str, str, str]
"""What changes in a life besides the pose: the departure if it is known [ns], the behaviour, the
activity, and the motion planner."""


@dataclass(frozen=True, eq=False)
class Scene:
    """N artefacts in the order of their ids; all poses and boxes are in the map frame.

    `motions` float64 (N, 7) are the poses on the ground, x, y, z [m] and yaw [rad], and the rates
    of x, y [m/s] and yaw [rad/s]. `status` is that of the instant at which the scene was made.
    """

    artefacts: tuple[Artefact, ...]
    motions: _Columns
    boxes: OrientedBoxes
    status: tuple[Status, ...]

    @classmethod
    def of(cls, artefacts: Sequence[Artefact], t_ns: int) -> "Scene":
        """Return the scene of these artefacts at `t_ns`."""
        poses, rates = motions_at([artefact.history for artefact in artefacts], t_ns)
        boxes = boxes_of([artefact.row for artefact in artefacts], poses.tolist())
        motions = np.concatenate((poses, rates), axis=1)
        return cls(tuple(artefacts), motions, boxes, _status_of(artefacts))

    def shows(self, artefacts: Sequence[Artefact]) -> bool:
        """Return whether these are the scene's artefacts, and their status has not changed."""
        return self.artefacts == tuple(artefacts) and self.status == _status_of(artefacts)

    @cached_property
    def ids(self) -> npt.NDArray[np.int64]:
        """The ids (N,), ascending."""
        return np.array([artefact.id for artefact in self.artefacts], dtype=np.int64)

    @cached_property
    def rows(self) -> tuple[CatalogueRow, ...]:
        """The rows of the artefacts."""
        return tuple([artefact.row for artefact in self.artefacts])

    @property
    def ground_poses(self) -> tuple[GroundPose, ...]:
        """The poses on the ground."""
        return tuple(map(GroundPose._make, self.motions[:, :4].tolist()))

    @cached_property
    def poses(self) -> _Columns:
        """The poses of F_A (N, 7): x, y, z [m] and the quaternion x, y, z, w."""
        poses = np.zeros((len(self), 7))
        poses[:, :3] = self.motions[:, :3]
        poses[:, 2] += [row.com_height_m for row in self.rows]
        halves_rad = (0.5 * self.motions[:, 3]).tolist()
        poses[:, 5] = [math.sin(half) for half in halves_rad]
        poses[:, 6] = [math.cos(half) for half in halves_rad]
        return poses

    @cached_property
    def twists(self) -> _Columns:
        """The twists (N, 3): the velocity along x and y of F_A [m/s], the yaw's rate [rad/s]."""
        yaws_rad = self.motions[:, 3].tolist()
        cosines = np.array([math.cos(yaw) for yaw in yaws_rad])
        sines = np.array([math.sin(yaw) for yaw in yaws_rad])
        vx, vy, turns = self.motions[:, 4], self.motions[:, 5], self.motions[:, 6]
        return np.stack((cosines * vx + sines * vy, cosines * vy - sines * vx, turns), axis=1)

    def __len__(self) -> int:
        """Count the artefacts."""
        return len(self.artefacts)

    def only(self, ids: Collection[int]) -> "Scene":
        """Return the scene of the artefacts with these ids."""
        chosen = [k for k, artefact in enumerate(self.artefacts) if artefact.id in ids]
        rows = np.array(chosen, dtype=np.int64)
        return Scene(
            tuple([self.artefacts[k] for k in chosen]),
            self.motions[rows],
            self.boxes.take(rows),
            tuple([self.status[k] for k in chosen]),
        )

    def state(self, k: int) -> ArtefactState:
        """Return the ground truth of artefact `k` of the scene."""
        artefact, (departure_ns, behaviour, activity, planner) = self.artefacts[k], self.status[k]
        row, pose = artefact.row, GroundPose._make(self.motions[k, :4].tolist())
        vx_m_s, vy_m_s, turn_rad_s = self.twists[k].tolist()
        return ArtefactState(
            artefact_id=artefact.id,
            row=row.index,
            label=row.label,
            class_name=row.class_name,
            map_from_artefact=map_from_artefact(row, pose),
            ground_pose=pose,
            box_centre_m=row.box_centre_in_artefact_m,
            size_m=row.size_m,
            linear_velocity_m_s=(vx_m_s, vy_m_s, 0.0),
            angular_velocity_rad_s=(0.0, 0.0, turn_rad_s),
            behaviour=behaviour,
            activity=activity,
            arrival_ns=artefact.arrival_ns,
            departure_ns=departure_ns or 0,
            origin=artefact.origin,
            features=features_of(row, activity, planner),
        )


def features_of(row: CatalogueRow, activity: str, planner: str) -> dict[str, str]:
    """Return a row's features with the activity and the planner among them, if there are."""
    said = zip(TOLD, (activity, planner), strict=True)
    return {**row.features, **{key: value for key, value in said if value}}


def _status_of(artefacts: Sequence[Artefact]) -> tuple[Status, ...]:
    return tuple(
        [(one.departure_ns, one.behaviour, one.activity, one.planner) for one in artefacts]
    )
