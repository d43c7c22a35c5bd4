"""One track: what a detector and a tracker know of one body, and where it will be by that."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import PerceivedArtefact, PredictedPath
from are_ros.builder.certainty.belief import Belief, Existence
from are_ros.builder.certainty.body import Body, Motion
from are_ros.builder.certainty.tracking_error import AXES, Floats, Process, TrackingError
from are_ros.builder.observation import Sighting
from are_ros.parameters.model import CertaintyParameters
from are_ros.world.rigid_transform import RigidTransform

_PLANAR: Final = np.ix_((0, 1, 5), (0, 1, 5))
"""Where x, y and the rotation about z stand in a covariance (6, 6) of ROS."""


class Track:
    """A body that was detected: `body` is the truth, all else what is believed of it.

    `sighting` and `seen_ns` are those of the last detection.
    """

    def __init__(
        self,
        artefact_id: int,
        body: Body,
        error: TrackingError,
        existence: Existence,
        classes: Belief,
    ) -> None:
        self.artefact_id = artefact_id
        self.body = body
        self.error = error
        self.existence = existence
        self.classes = classes
        self.sighting = Sighting(0, 0, (0, 0, 0, 0), math.inf)
        self.seen_ns = 0
        self.behaviours: Belief | None = None

    @property
    def estimate(self) -> Motion:
        """The estimated motion, as `Body.motion` has it."""
        x, y, z, yaw, vx, vy, turn = self.body.motion
        if not self.error.covariance.any():
            return self.body.motion  # the same bits, the sign of a zero included
        dx, dy, dyaw, dvx, dvy, dturn = self.error.error.tolist()
        return (x + dx, y + dy, z, yaw + dyaw, vx + dvx, vy + dvy, turn + dturn)

    def report(
        self, class_names: Sequence[str], behaviour_names: Sequence[str] = ()
    ) -> PerceivedArtefact:
        """Return what is known, for the list; of behaviours if their names are given.

        The twist is in the axes of the estimated pose: the errors of its velocity do not depend on
        that of the heading.
        """
        x, y, z, yaw, vx, vy, turn = self.estimate
        classes, probabilities = self.classes.ranked(class_names)
        behaviours: tuple[tuple[str, ...], tuple[float, ...]] = (), ()
        if behaviour_names and self.behaviours is not None:
            behaviours = self.behaviours.ranked(behaviour_names)
        row, sighting, covariance = self.body.row, self.sighting, self.error.covariance
        cos, sin = math.cos(yaw), math.sin(yaw)
        return PerceivedArtefact(
            artefact_id=self.artefact_id,
            label=row.label if len(classes) == 1 else classes[0],
            classes=classes,
            probabilities=probabilities,
            map_from_artefact=RigidTransform.planar(x, y, yaw, z + self.body.height_m),
            pose_covariance=_as_ros(covariance[:3, :3]),
            size_m=row.size_m,
            linear_velocity_m_s=(cos * vx + sin * vy, cos * vy - sin * vx, 0.0),
            angular_velocity_rad_s=(0.0, 0.0, turn),
            twist_covariance=_as_ros(_turned(covariance[3:, 3:], -yaw)),
            visible_pixels=sighting.visible_pixels,
            unoccluded_pixels=sighting.unoccluded_pixels,
            visible_fraction=sighting.visible_fraction,
            range_m=sighting.range_m,
            existence=self.existence.artefact,
            roi_px=sighting.roi_px,
            last_seen_ns=self.seen_ns,
            cameras=sighting.cameras,
            behaviours=behaviours[0],
            behaviour_probabilities=behaviours[1],
        )


def _turned(covariance: Floats, angle_rad: float) -> Floats:
    """Return a covariance (3, 3) of x, y and yaw in axes from which the old ones are turned so."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    turn = np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))
    turned: Floats = turn @ covariance @ turn.T
    return turned


def _as_ros(planar: npt.NDArray[np.float64]) -> tuple[float, ...]:
    """Return a covariance (3, 3) of x, y and yaw as the 36 numbers of ROS; the rest is 0."""
    covariance = np.zeros((6, 6))
    covariance[_PLANAR] = 0.5 * (planar + planar.T) + 0.0  # no negative zero
    return tuple(covariance.reshape(-1).tolist())


_X, _Y, _YAW = 0, 1, 2
_FIELDS = 7 + 36
_PATH_PLANAR = (7, 8, 12, 13, 14, 18, 37, 38, 42)
"""Where the covariance (3, 3) of x, y and yaw stands among the numbers of a pose of a path."""


def predicted_paths(
    tracks: Sequence[Track], settings: CertaintyParameters
) -> tuple[PredictedPath, ...]:
    """Return the path of each track, by the tracker's own model: constant rates, white noise."""
    count = math.floor(settings.prediction_horizon / settings.prediction_step + 1e-9)
    if not tracks or not count:
        return tuple(PredictedPath(track.artefact_id, np.empty((0, _FIELDS))) for track in tracks)
    motions = np.array([track.estimate for track in tracks])
    states = np.concatenate((motions[:, [0, 1, 3]], motions[:, 4:]), axis=1)
    heights_m = motions[:, 2] + [track.body.height_m for track in tracks]
    covariances = np.array([track.error.covariance for track in tracks])
    paths = np.zeros((len(tracks), count, _FIELDS))
    paths[:, :, 2] = heights_m[:, np.newaxis]
    for k in range(count):
        ahead = Process.of(settings, (k + 1) * settings.prediction_step)
        _write(paths[:, k], states @ ahead.step.T, ahead.grown(covariances))
    paths.setflags(write=False)
    both = zip(tracks, paths, strict=True)
    return tuple(PredictedPath(track.artefact_id, path) for track, path in both)


def _write(numbers: Floats, states: Floats, covariances: Floats) -> None:
    """Write poses and covariances (N, 43) of states (N, 6) with covariances (N, 6, 6)."""
    numbers[:, :2] = states[:, [_X, _Y]]
    numbers[:, 5], numbers[:, 6] = np.sin(0.5 * states[:, _YAW]), np.cos(0.5 * states[:, _YAW])
    numbers[:, _PATH_PLANAR] = covariances[:, :AXES, :AXES].reshape(-1, AXES * AXES)
