"""Where tracked bodies will be if they go on as estimated, and how sure that is."""

import math
from collections.abc import Sequence

import numpy as np

from are_ros.agents.events import PredictedPath
from are_ros.builder.certainty.track import Track
from are_ros.builder.certainty.tracking_error import AXES, Floats, Process
from are_ros.parameters.model import CertaintyParameters

_X, _Y, _YAW = 0, 1, 2
_FIELDS = 7 + 36
_PLANAR = (7, 8, 12, 13, 14, 18, 37, 38, 42)
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
    numbers[:, _PLANAR] = covariances[:, :AXES, :AXES].reshape(-1, AXES * AXES)
