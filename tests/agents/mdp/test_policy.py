"""The policy: the prior's shares and durations, Boltzmann's law, slips."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from are_ros.agents.mdp.policy import (
    STAY,
    boltzmann,
    drawn,
    persistence_of,
    prior_of,
    slipped,
    surely_drawn,
)

SHARES = (0.5, 0.3, 0.15, 0.05)
EPOCHS = 40_000
LEVEL = 1e-3


def chain(temperature: float, mean_time_s: float, seed: int) -> npt.NDArray[np.int64]:
    """Run a chain of behaviours with values that would favour the last one."""
    random, stays = np.random.default_rng(seed), persistence_of(1.0, mean_time_s)
    values, in_force, visited = (0.0, 0.1, 0.2, 5.0), 0, np.empty(EPOCHS, np.int64)
    for epoch in range(EPOCHS):
        weights = boltzmann(prior_of(SHARES, in_force, stays), values, temperature)
        visited[epoch] = in_force = drawn(weights, random.random())
    return visited


def test_at_infinite_temperature_the_shares_are_those_of_the_catalogue() -> None:
    """For T to infinity the catalogue decides (chi-square)."""
    visited = chain(math.inf, 8.0, 1)[::80]  # far enough apart to be independent
    counts = np.bincount(visited, minlength=4)
    assert stats.chisquare(counts, np.array(SHARES) * len(visited)).pvalue > LEVEL


def test_at_infinite_temperature_the_durations_are_geometric() -> None:
    """A behaviour ends with the same probability in each epoch."""
    visited, stays = chain(math.inf, 8.0, 2), persistence_of(1.0, 8.0)
    ends = np.flatnonzero(np.diff(visited)) + 1
    runs, of_first = np.diff(ends), visited[ends[:-1]] == 0
    lengths = runs[of_first]
    leaves = (1.0 - stays) * (1.0 - SHARES[0])
    edges = np.array([1, 2, 3, 5, 8, 12, 20, 30])
    below = 1.0 - (1.0 - leaves) ** (edges - 1)
    expected = np.diff(np.append(below, 1.0)) * len(lengths)
    counts, _ = np.histogram(lengths, np.append(edges, 10**9))
    assert expected.min() > 5.0
    assert stats.chisquare(counts, expected).pvalue > LEVEL


@pytest.mark.parametrize("mean_time_s", [0.0, 5.0, 30.0])
def test_persistence_is_the_mean_time_between_draws(mean_time_s: float) -> None:
    """It is the mean time between draws of an exponential clock."""
    stays = persistence_of(0.01, mean_time_s)
    assert 0.01 / (1.0 - stays) == pytest.approx(max(mean_time_s, 0.01), rel=2e-3)


@pytest.mark.parametrize("temperature", [0.02, 0.1, 1.0, 100.0])
def test_actions_follow_boltzmanns_law(temperature: float) -> None:
    """Frequencies are those of prior * exp(value / T)."""
    values, prior = (-0.2, 0.0, -0.05, -0.4, -0.1), (0.1, 0.2, 0.3, 0.3, 0.1)
    random = np.random.default_rng(3)
    weights = boltzmann(prior, values, temperature)
    counts = np.bincount([drawn(weights, random.random()) for _ in range(20_000)], minlength=5)
    expected_weights = [p * math.exp(v / temperature) for p, v in zip(prior, values, strict=True)]
    expected = 20_000 * np.array(expected_weights) / sum(expected_weights)
    often = expected > 5.0
    rest = (counts[~often].sum(), expected[~often].sum())
    assert rest[0] <= stats.poisson.ppf(1.0 - LEVEL, rest[1])
    assert (
        stats.chisquare(
            counts[often], expected[often] * counts[often].sum() / expected[often].sum()
        ).pvalue
        > LEVEL
    )


def test_at_zero_temperature_only_the_best_possible_actions_are_taken() -> None:
    """The others have no chance."""
    prior, values = (0.2, 0.2, 0.6, 0.0), (1.0, 0.5, 1.0, 9.0)
    assert boltzmann(prior, values, 0.0) == [0.2, 0.0, 0.6, 0.0]


def test_what_the_prior_excludes_is_never_drawn() -> None:
    """However good its value is."""
    weights = boltzmann((0.0, 1.0, 0.0), (700.0, -700.0, 0.0), 0.01)
    assert {drawn(weights, uniform) for uniform in (0.0, 0.5, 1.0 - 2**-53)} == {1}


def test_without_slip_all_moves_succeed() -> None:
    """A move is what was intended."""
    assert [slipped(move, 0.0, uniform) for move in range(5) for uniform in (0.0, 0.9)] == [
        move for move in range(5) for _ in range(2)
    ]


@pytest.mark.parametrize("slip", [0.1, 0.6, 1.0])
def test_moves_slip_with_their_probabilities(slip: float) -> None:
    """Half of the slips fail, a quarter each go to a side."""
    random, move, count = np.random.default_rng(4), 1, 20_000
    became = np.bincount([slipped(move, slip, random.random()) for _ in range(count)], minlength=5)
    expected = count * np.array([slip / 2.0, 1.0 - slip, slip / 4.0, 0.0, slip / 4.0])
    assert (became[expected == 0.0] == 0).all()
    possible = expected > 0.0
    assert stats.chisquare(became[possible], expected[possible]).pvalue > LEVEL


def test_staying_never_slips() -> None:
    """There is nothing to slip."""
    assert slipped(STAY, 1.0, 0.1) == STAY


@pytest.mark.parametrize("temperature", [0.025, 1.0, math.inf])
def test_what_is_surely_drawn_is_drawn_whatever_the_rewards(temperature: float) -> None:
    """And with rewards that are known it is told for all draws, but for rounding."""
    random, told = np.random.default_rng(3), 0
    for _ in range(3_000):
        shares, in_force = random.dirichlet(np.ones(4)).tolist(), int(random.integers(4))
        prior = prior_of(shares, in_force, random.choice([0.0, 0.5, 0.97]))
        low = random.uniform(-0.05, 0.05, 4)
        high = low + random.choice([0.0, 0.03]) * random.random(4)
        advantages, uniform = (-0.1 * random.random(4)).tolist(), float(random.random())
        ranges = list(zip(low.tolist(), high.tolist(), strict=True))
        surely = surely_drawn(prior, ranges, advantages, 1.0, temperature, uniform)
        assert surely is not None or (low < high).any()
        told += surely is not None and (low < high).any()
        for share in (0.0, 1.0, *random.random((6, 4))):
            rewards = low + share * (high - low)
            weights = boltzmann(prior, (rewards + advantages).tolist(), temperature)
            assert surely in {None, drawn(weights, uniform)}
    assert told > 500


def test_nothing_is_surely_drawn_by_weights_that_are_lost_in_rounding() -> None:
    """They are then found in another way."""
    ranges = ((-1.0, 1.0), (-1.0, 1.0))
    assert surely_drawn((0.5, 0.5), ranges, (0.0, 0.0), 1.0, 1e-4, 0.5) is None
