"""Tests of the p-values: they pass what follows the law, and not what does not."""

import math

import numpy as np
import pytest
from scipy import stats

from are_ros.description import trial_statistics as statistics
from are_ros.description.birth_death import BirthDeath
from are_ros.description.population_trial import Trial
from are_ros.parameters.choices import Departures

INDEPENDENT, CONSTANT = Departures.INDEPENDENT, Departures.CONSTANT_RATE


def _path(
    chain: BirthDeath, jumps: int, seed: int
) -> tuple[statistics.Floats, statistics.Integers, float]:
    """Walk the chain by its rates, one jump after the other."""
    rng, n, now_s = np.random.default_rng(seed), 0, 0.0
    times, levels = [0.0], [0]
    for _ in range(jumps):
        leavers = n if chain.departures is INDEPENDENT else min(n, 1)
        death_per_s = leavers / chain.mean_life_s
        total_per_s = chain.groups_per_s + death_per_s
        now_s += rng.exponential(1.0 / total_per_s)
        members = 1 + rng.poisson(chain.mean_group_size - 1.0)
        is_death = rng.random() < death_per_s / total_per_s
        after = n - 1 if is_death else min(n + members, chain.max_alive)
        if after != n:
            times.append(now_s)
            levels.append(after)
        n = after
    return np.array(times), np.array(levels), now_s


def test_time_shares_weigh_by_time() -> None:
    """1 s at 0, 3 s at 2, 4 s at 1."""
    shares = statistics.time_shares(np.array([0.0, 1.0, 4.0]), np.array([0, 2, 1]), 8.0, 4)
    assert shares.tolist() == [0.125, 0.5, 0.375, 0.0]


@pytest.mark.parametrize(
    "chain",
    [
        BirthDeath(1.5, 1.0, 2.0, INDEPENDENT, 200),
        BirthDeath(1.5, 1.0, 2.0, INDEPENDENT, 4),
        BirthDeath(0.5, 3.0, 2.0, INDEPENDENT, 200),
        BirthDeath(0.5, 1.0, 1.0, CONSTANT, 200),
        BirthDeath(0.2, 2.5, 1.0, CONSTANT, 12),
    ],
)
def test_a_path_passes_its_own_law_only(chain: BirthDeath) -> None:
    """At level 1/1,000 the chain's own path passes, and one with 15 % more arrivals does not."""
    path = _path(chain, 60_000, 1)
    assert statistics.path_p_value(*path, chain.law, chain.correlation_s) > 1e-3
    busier = BirthDeath(
        1.15 * chain.groups_per_s,
        chain.mean_group_size,
        chain.mean_life_s,
        chain.departures,
        chain.max_alive,
    )
    assert statistics.path_p_value(*path, busier.law, chain.correlation_s) < 1e-3


def test_false_alarms_are_as_rare_as_stated() -> None:
    """Of 60 paths of 400 correlation times, fewer than a fifth have p < 0.1, and none p < 1e-3."""
    chain = BirthDeath(1.5, 1.0, 2.0, INDEPENDENT, 6)
    values = [
        statistics.path_p_value(*_path(chain, 2000, seed), chain.law, chain.correlation_s)
        for seed in range(60)
    ]
    assert np.mean(np.array(values) < 0.1) < 0.2
    assert min(values) > 1e-3


def test_a_short_path_has_no_p_value() -> None:
    """Less than 200 correlation times tell nothing."""
    chain = BirthDeath(1.5, 1.0, 2.0, INDEPENDENT, 200)
    assert math.isnan(
        statistics.path_p_value(*_path(chain, 600, 1), chain.law, chain.correlation_s)
    )


def test_a_law_of_one_level_has_no_p_value() -> None:
    """Where N is always at its bound there is nothing to compare."""
    chain = BirthDeath(1e6, 1.0, 1e3, CONSTANT, 3)
    path = np.array([0.0, 1e-6]), np.array([0, 3]), 1e3
    assert math.isnan(statistics.path_p_value(*path, chain.law, chain.correlation_s))


def test_counts_are_chi_squared() -> None:
    """The same as scipy's where all are often expected; rare ones are taken together."""
    counted, law = np.array([30, 18, 12]), np.array([0.5, 0.3, 0.2])
    expected = stats.chisquare(counted, 60 * law).pvalue
    assert statistics.counts_p_value(counted, law) == pytest.approx(expected)
    rare = np.array([0.48, 0.28, 0.18, 0.05, 0.01])
    pooled = stats.chisquare([30, 18, 12], [48 * 0.6, 28 * 0.6, 24 * 0.6]).pvalue
    given = np.array([30, 18, 8, 3, 1])
    assert statistics.counts_p_value(given, rare) == pytest.approx(pooled)
    assert math.isnan(statistics.counts_p_value(np.array([1, 1]), np.array([0.5, 0.5])))


def test_points_in_a_square() -> None:
    """Uniform points pass, and points that keep to one side do not; level 1/1,000."""
    points_m = 10.0 * np.random.default_rng(3).random((1500, 2))
    assert statistics.square_p_value(points_m, 10.0) > 1e-3
    assert statistics.square_p_value(points_m**1.15 / 10.0**0.15, 10.0) < 1e-3


def test_lives_that_are_not_over_have_no_p_value() -> None:
    """Where a run is shorter than the lives, those that ended are the short ones."""
    chain, nothing = BirthDeath(1.0, 1.0, 2.0, INDEPENDENT, 200), np.zeros(0)
    lives_s = np.random.default_rng(1).exponential(2.0, 900)

    def trial(unfinished: int) -> Trial:
        ints = np.zeros(0, np.int64)
        times = (nothing, ints, nothing, ints, lives_s, unfinished, nothing)
        return Trial(chain, 1.0, *times, np.zeros((0, 2)), nothing, 0)

    assert statistics.lives_p_value(trial(1)) > 1e-3
    assert math.isnan(statistics.lives_p_value(trial(9)))
