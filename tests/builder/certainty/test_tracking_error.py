"""The errors of tracks: their covariances are those that a filter states, and they are kept."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from are_ros.agents.events import PerceivedArtefact
from are_ros.builder.certainty.track import Process, TrackingError
from are_ros.builder.scene import Scene
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import CertaintyParameters
from tests.builder.certainty.hall import detector, ns, scene, seeing, sight, walkers

LEVEL = 1e-3
SETTINGS = CertaintyParameters(acceleration=0.8, turn_acceleration=0.3)
FIRST = np.diag((0.2, 0.1, 0.3))
RATES = np.diag((0.7, 0.6, 0.5))


def planar(covariance: tuple[float, ...]) -> Any:
    """Return the covariance (3, 3) of x, y and the turn about z."""
    return np.array(covariance).reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))]


def squares(one: PerceivedArtefact, truth: Scene, k: int) -> tuple[float, float]:
    """Return the normalised squared errors of the pose and of the velocity, from the messages."""
    x, y, _, yaw, *rates = truth.motions[k].tolist()
    told_x, told_y, _ = one.map_from_artefact.translation_m.tolist()
    told_yaw = 2.0 * math.atan2(*one.map_from_artefact.rotation_xyzw[2:].tolist())
    error = np.array((told_x - x, told_y - y, math.remainder(told_yaw - yaw, math.tau)))
    cos, sin = math.cos(told_yaw), math.sin(told_yaw)
    turn = np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))
    along, across, _ = one.linear_velocity_m_s
    told_rates = turn @ np.array((along, across, one.angular_velocity_rad_s[2]))
    of_rates = turn @ planar(one.twist_covariance) @ turn.T
    apart = told_rates - np.array(rates)
    return (
        float(error @ np.linalg.solve(planar(one.pose_covariance), error)),
        float(apart @ np.linalg.solve(of_rates, apart)),
    )


@pytest.mark.long
def test_errors_of_10000_sightings_follow_chi_square() -> None:
    """Kolmogorov and Smirnov at the level 1e-3, and the means; detections, misses and coasting.

    The artefacts are independent, so each gives one sighting: after some looks at which more or
    less of it is visible, from near and far.
    """
    eye, crowd = (
        detector({"certainty.coast": 100.0}),
        walkers(10_000),
    )
    random = np.random.default_rng(5)
    for k in range(4):
        t_s, truth = 0.1 * k, scene(crowd, 0.1 * k)
        fractions, ranges_m = random.uniform(0.1, 1.0, 10_000), random.uniform(0.5, 14.0, 10_000)
        both = zip(crowd, fractions, ranges_m, strict=True)
        seen = {one.id: sight(fraction, range_m) for one, fraction, range_m in both}
        perception = eye.observe(ns(t_s), truth, seeing(seen))
    places = {number: k for k, number in enumerate(truth.ids.tolist())}
    found = [squares(one, truth, places[one.artefact_id]) for one in perception.artefacts]
    assert len(found) > 9_000
    assert 0.05 < np.mean([one.sighting.seen_ns < ns(0.3) for one in perception.artefacts]) < 0.5
    for values in zip(*found, strict=True):
        assert np.mean(values) == pytest.approx(3.0, abs=4.0 * math.sqrt(6.0 / len(found)))
        assert kstest(values, chi2(3).cdf).pvalue > LEVEL


def test_the_covariance_is_that_of_the_joint_law() -> None:
    """A twin without a filter: the state given the detections, from one covariance of all."""
    generator = np.random.default_rng(3)
    track = TrackingError(generator, FIRST, RATES)
    times_s, noises = (0.1, 0.25, 0.7), (np.diag((0.1, 0.2, 0.1)), None, np.diag((0.3, 0.1, 0.2)))
    state = np.zeros((6, 6))
    state[:3, :3], state[3:, 3:] = FIRST @ FIRST, RATES @ RATES
    joint, seen, kept = state, np.zeros((0, 0)), np.zeros((0, 6))
    for dt_s, noise in zip(times_s, noises, strict=True):
        process = Process.of(SETTINGS, dt_s)
        track.predict(process)
        carried = np.eye(6)
        carried[:3, 3:] = dt_s * np.eye(3)
        q = np.array((0.8, 0.8, 0.3)) ** 2
        grown = np.block(
            [
                [np.diag(q * dt_s**3 / 3), np.diag(q * dt_s**2 / 2)],
                [np.diag(q * dt_s**2 / 2), np.diag(q * dt_s)],
            ]
        )
        joint, kept = carried @ joint @ carried.T + grown, kept @ carried.T
        if noise is not None:
            track.correct(noise)
            detection = joint[:3, :3] + noise @ noise
            seen = np.block([[seen, kept[:, :3]], [kept[:, :3].T, detection]])
            kept = np.vstack((kept, joint[:3]))
    wanted = joint - kept.T @ np.linalg.solve(seen, kept)
    np.testing.assert_allclose(track.covariance, wanted, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("rate_hz", [5, 20])
def test_the_growth_of_a_second_does_not_depend_on_the_rate(rate_hz: int) -> None:
    """Many small steps are one large one."""
    covariance = np.diag((0.1, 0.2, 0.3, 0.4, 0.5, 0.6))
    whole = Process.of(SETTINGS, 1.0).grown(covariance)
    for _ in range(rate_hz):
        covariance = Process.of(SETTINGS, 1.0 / rate_hz).grown(covariance)
    np.testing.assert_allclose(covariance, whole, rtol=1e-12)


@pytest.mark.long
def test_errors_are_correlated_in_time() -> None:
    """As a tracker's: from one tick to the next they hardly change, over seconds they do."""
    many = [TrackingError(np.random.default_rng(k), FIRST, RATES) for k in range(2_000)]
    noise, process = np.diag((0.2, 0.2, 0.2)), Process.of(SETTINGS, 0.1)
    errors = []
    for _ in range(60):
        for track in many:
            track.predict(process)
            track.correct(noise)
        errors.append([track.error[0] for track in many])
    soon = np.corrcoef(errors[29], errors[30])[0, 1]
    late = np.corrcoef(errors[29], errors[59])[0, 1]
    assert soon > 0.7
    assert abs(late) < 0.1


def test_a_detection_corrects_as_a_kalman_filter_does() -> None:
    """The covariance is P - P H' (H P H' + N)^-1 H P, for correlated noise, too."""
    random = np.random.default_rng(5)
    for _ in range(50):
        track = TrackingError(random, random.normal(size=(3, 3)), random.normal(size=(3, 3)))
        track.predict(Process.of(SETTINGS, 0.3))
        before, detection = track.covariance, np.tril(random.normal(size=(3, 3)))
        track.correct(detection)
        gain = before[:, :3] @ np.linalg.inv(before[:3, :3] + detection @ detection.T)
        np.testing.assert_allclose(track.covariance, before - gain @ before[:3], atol=1e-9)


def test_without_noise_the_error_is_nothing() -> None:
    """Neither inverse nor draw brings one in."""
    nothing = np.zeros((3, 3))
    still = with_values(SETTINGS, {"acceleration": 0.0, "turn_acceleration": 0.0})
    track = TrackingError(np.random.default_rng(1), nothing, nothing)
    track.predict(Process.of(still, 0.1))
    track.correct(nothing)
    assert not track.error.any()
    assert not track.covariance.any()


def test_a_detection_without_noise_leaves_no_error_of_the_place() -> None:
    """The velocity stays uncertain, and the covariance stays sensible."""
    track = TrackingError(np.random.default_rng(1), FIRST, RATES)
    track.predict(Process.of(SETTINGS, 0.1))
    track.correct(np.zeros((3, 3)))
    np.testing.assert_allclose(track.error[:3], 0.0, atol=1e-12)
    np.testing.assert_allclose(track.covariance[:3, :3], 0.0, atol=1e-12)
    assert np.linalg.eigvalsh(track.covariance).min() > -1e-12
    assert track.covariance[3, 3] > 0.01
