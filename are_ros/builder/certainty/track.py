"""One track: what it follows, its error, what is known of it, and where it will be by that.

The error is that of a Kalman filter whose model is right. The artefacts do not move as a filter
believes, so the errors of a real filter on them would not have the covariance that it states. Here
the error itself is the random process: it is driven by the noise of the model and of the
detections, and its covariance is the filter's own. So an estimate is the truth plus an error that
is normal with exactly the stated covariance, at every instant, and correlated in time as a
tracker's is.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import PerceivedArtefact, PredictedPath, Sighting
from are_ros.builder.certainty.belief import Belief, Existence
from are_ros.builder.scene import Scene
from are_ros.conventions import NS_PER_S
from are_ros.parameters.model import CertaintyParameters
from are_ros.population.artefact import shape_of
from are_ros.population.catalogue import CatalogueRow
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.rigid_transform import RigidTransform, product

Motion = Sequence[float]
"""x, y, z [m] and yaw [rad] on the ground in the map frame, the rates of x, y [m/s] and yaw."""

Shape = tuple[float, float, float, float, float]
"""Half sizes of the box, and its centre's x, y in F_A [m]."""


class Body(NamedTuple):
    """A body of a row's type with its motion as of `at_ns`; F_A is `height_m` above the ground.

    `behaviour` is what an artefact does; a false alarm does nothing.
    """

    row: CatalogueRow
    shape: Shape
    height_m: float
    motion: Motion
    at_ns: int
    behaviour: str = ""

    @classmethod
    def of_scene(cls, scene: Scene, k: int, at_ns: int) -> "Body":
        """Return artefact k of a scene."""
        row, motion = scene.rows[k], scene.motions[k].tolist()
        behaviour = scene.status[k][1]
        return cls(row, shape_of(row), row.com_height_m, motion, at_ns, behaviour)

    @classmethod
    def box(cls, row: CatalogueRow, motion: Motion, at_ns: int) -> "Body":
        """Return a box of a row's size; its F_A sits in the middle."""
        half_x_m, half_y_m, half_z_m = (0.5 * side_m for side_m in row.size_m)
        return cls(row, (half_x_m, half_y_m, half_z_m, 0.0, 0.0), half_z_m, motion, at_ns)

    def coasted(self, now_ns: int) -> "Body":
        """Return the body after it has moved on in a straight line."""
        dt_s = (now_ns - self.at_ns) / NS_PER_S
        x, y, z, yaw, vx, vy, turn = self.motion
        motion = (x + vx * dt_s, y + vy * dt_s, z, yaw, vx, vy, turn)
        return self._replace(motion=motion, at_ns=now_ns)


def boxes_at(
    motions: Sequence[Sequence[float]] | npt.NDArray[np.float64], shapes: Sequence[Shape]
) -> OrientedBoxes:
    """Return the boxes of these shapes, N, whose bodies are where the motions (N, 7) say."""
    poses = np.array(motions, dtype=np.float64).reshape(-1, 7)[:, :4]
    return OrientedBoxes.standing(poses, np.array(shapes, dtype=np.float64).reshape(-1, 5))


Floats = npt.NDArray[np.float64]

AXES: Final = 3
"""x, y and yaw; their rates follow in a state."""

_UNIT: Final[Floats] = np.eye(2 * AXES)


class TrackingError:
    """The error (6,) of x, y [m], yaw [rad] and their rates in the map frame, and its covariance.

    Factors L stand for covariances L L^T. All draws come from `generator`.
    """

    def __init__(self, generator: np.random.Generator, detection: Floats, rates: Floats) -> None:
        """Begin a track with a detection: factors (3, 3) of its noise and of the unknown rates."""
        self._generator = generator
        factor = np.zeros((2 * AXES, 2 * AXES))
        factor[:AXES, :AXES], factor[AXES:, AXES:] = detection, rates
        self.error: Floats = product(factor, generator.standard_normal(2 * AXES))
        self.covariance: Floats = product(factor, factor.T)

    def predict(self, process: "Process") -> None:
        """Go on by the time of a process."""
        drawn = product(process.noise, self._generator.standard_normal(2 * AXES))
        self.error = product(process.step, self.error) + drawn
        self.covariance = process.grown(self.covariance)

    def correct(self, detection: Floats) -> None:
        """Take a detection whose noise has this factor (3, 3)."""
        noise = product(detection, detection.T)
        innovation = self.covariance[:AXES, :AXES] + noise
        gain = product(self.covariance[:, :AXES], _inverse(innovation, detection))
        drawn = product(detection, self._generator.standard_normal(AXES))
        self.error = self.error + product(gain, drawn - self.error[:AXES])
        kept = _UNIT.copy()
        kept[:, :AXES] -= gain
        self.covariance = _spread(kept, self.covariance) + _spread(gain, noise)


class Process(NamedTuple):
    """What a time does to a state (6,): `step` (6, 6) carries it on at constant rates.

    `noise` (6, 6) is a factor of what white noise as accelerations adds.
    """

    step: Floats
    noise: Floats

    @classmethod
    def of(cls, settings: CertaintyParameters, dt_s: float) -> "Process":
        """Return the process of a time.

        Per axis, noise of density q adds q^2 ((dt^3 / 3, dt^2 / 2), (dt^2 / 2, dt)): however a time
        is cut into steps, the law is the same.
        """
        moves, turns = settings.acceleration, settings.turn_acceleration
        densities = math.sqrt(dt_s) * np.diag((moves, moves, turns))
        step, noise = _UNIT.copy(), np.zeros((2 * AXES, 2 * AXES))
        step[:AXES, AXES:] = dt_s * _UNIT[:AXES, :AXES]
        noise[:AXES, :AXES] = densities * dt_s / math.sqrt(3.0)
        noise[AXES:, :AXES] = densities * math.sqrt(0.75)
        noise[AXES:, AXES:] = densities * 0.5
        return cls(step, noise)

    def grown(self, covariance: Floats) -> Floats:
        """Return what a covariance (6, 6), or each of (N, 6, 6), has become after the time."""
        grown: Floats = _spread(self.step, covariance) + product(self.noise, self.noise.T)
        return grown


def _spread(step: Floats, covariance: Floats) -> Floats:
    """Return the covariance (..., n, n) of what a matrix (n, m) makes of (..., m, m)."""
    return np.asarray(np.einsum("ij,...jk,lk->...il", step, covariance, step))


def _inverse(innovation: Floats, detection: Floats) -> Floats:
    """Return the inverse; the pseudo-inverse where a component is detected without any noise.

    Such a component may be known exactly, and is then not corrected. The inverse is by cofactors:
    LAPACK's has other last bits on other processors.
    """
    (a, b, c), (_, d, e), (_, _, f) = innovation.tolist()
    aa, ab, ac = d * f - e * e, c * e - b * f, b * e - c * d
    bb, bc, cc = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * aa + b * ab + c * ac
    if determinant > 0.0 and np.linalg.det(detection):
        inverse: Floats = np.array(((aa, ab, ac), (ab, bb, bc), (ac, bc, cc))) / determinant
        return inverse
    return np.asarray(np.linalg.pinv(innovation, hermitian=True), np.float64)


_PLANAR: Final = np.ix_((0, 1, 5), (0, 1, 5))
"""Where x, y and the rotation about z stand in a covariance (6, 6) of ROS."""


class Track:
    """A body that was detected: `body` is the truth, all else what is believed of it.

    `sighting` is that of the last detection.
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
        row, covariance = self.body.row, self.error.covariance
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
            sighting=self.sighting,
            existence=self.existence.artefact,
            behaviours=behaviours[0],
            behaviour_probabilities=behaviours[1],
        )


def _turned(covariance: Floats, angle_rad: float) -> Floats:
    """Return a covariance (3, 3) of x, y and yaw, rotated by an angle about z."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    turn = np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))
    return _spread(turn, covariance)


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
        _write(paths[:, k], product(states, ahead.step.T), ahead.grown(covariances))
    paths.setflags(write=False)
    both = zip(tracks, paths, strict=True)
    return tuple(PredictedPath(track.artefact_id, path) for track, path in both)


def _write(numbers: Floats, states: Floats, covariances: Floats) -> None:
    """Write poses and covariances (N, 43) of states (N, 6) with covariances (N, 6, 6)."""
    numbers[:, :2] = states[:, [_X, _Y]]
    numbers[:, 5], numbers[:, 6] = np.sin(0.5 * states[:, _YAW]), np.cos(0.5 * states[:, _YAW])
    numbers[:, _PATH_PLANAR] = covariances[:, :AXES, :AXES].reshape(-1, AXES * AXES)
