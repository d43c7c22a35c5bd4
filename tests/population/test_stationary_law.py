"""Tests of the stationary law of the number alive."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.linalg import expm

from are_ros.parameters.choices import Departures
from are_ros.population.birth_death import BirthDeath

INDEPENDENT, CONSTANT = Departures.INDEPENDENT, Departures.CONSTANT_RATE


def _generator_matrix(
    groups_per_s: float, mean_size: float, life_s: float, kind: Departures, bound: int
) -> npt.NDArray[np.float64]:
    """Return the chain's rates [1/s] from level to level."""
    rates = np.zeros((bound + 1, bound + 1))
    chances = stats.poisson.pmf(np.arange(100), mean_size - 1.0).tolist()
    for n in range(bound + 1):
        for size, chance in enumerate(chances, start=1):
            rates[n, min(n + size, bound)] += groups_per_s * chance
        if n:
            rates[n, n - 1] += (n if kind is INDEPENDENT else 1) / life_s
    generator: npt.NDArray[np.float64] = rates - np.diag(rates.sum(axis=1))
    return generator


def _by_generator_matrix(
    groups_per_s: float, mean_size: float, life_s: float, kind: Departures, bound: int
) -> npt.NDArray[np.float64]:
    """Return the law as the null vector of the chain's generator matrix."""
    generator = _generator_matrix(groups_per_s, mean_size, life_s, kind, bound)
    equations = np.vstack((generator.T, np.ones(bound + 1)))
    target = np.append(np.zeros(bound + 1), 1.0)
    law: npt.NDArray[np.float64] = np.linalg.lstsq(equations, target, rcond=None)[0]
    return law


@given(
    groups_per_s=st.floats(0.01, 2.0),
    mean_size=st.floats(1.0, 6.0),
    life_s=st.floats(0.2, 5.0),
    kind=st.sampled_from(Departures),
    bound=st.integers(0, 9),
)
def test_balance_of_the_chain(
    groups_per_s: float, mean_size: float, life_s: float, kind: Departures, bound: int
) -> None:
    """The law is the one in which the chain's generator changes nothing, groups or not."""
    law = BirthDeath(groups_per_s, mean_size, life_s, kind, bound).law
    oracle = _by_generator_matrix(groups_per_s, mean_size, life_s, kind, bound)
    assert law == pytest.approx(oracle, abs=1e-9)


@pytest.mark.parametrize(
    "chain",
    [
        BirthDeath(0.1, 1.0, 60.0, INDEPENDENT, 100),
        BirthDeath(0.1, 1.0, 1e6, INDEPENDENT, 50),
        BirthDeath(2.0, 1.0, 60.0, INDEPENDENT, 40),
        BirthDeath(0.1, 3.0, 30.0, INDEPENDENT, 100),
        BirthDeath(0.5, 1.0, 4.0, CONSTANT, 30),
        BirthDeath(0.1, 1.0, 20.0, CONSTANT, 40),
        BirthDeath(0.1, 1.0, 10.0, CONSTANT, 30),
    ],
)
def test_a_run_has_settled_when_it_is_said(chain: BirthDeath) -> None:
    """By the chain's own generator, from nobody on: about 95 % of the mean are there then."""
    generator = _generator_matrix(
        chain.groups_per_s,
        chain.mean_group_size,
        chain.mean_life_s,
        chain.departures,
        chain.max_alive,
    )
    there = expm(chain.settles_s * generator)[0] @ np.arange(chain.max_alive + 1)
    assert 0.85 < there / chain.mean < 1.0
    half = expm(0.5 * chain.settles_s * generator)[0] @ np.arange(chain.max_alive + 1)
    assert half / chain.mean < 0.9


def test_poisson_when_independent() -> None:
    """Independent lives of single arrivals: the truncated Poisson law of rate*life."""
    law = BirthDeath(0.5, 1.0, 8.0, INDEPENDENT, 12).law
    poisson = stats.poisson.pmf(np.arange(13), 4.0)
    assert law == pytest.approx(poisson / poisson.sum())


def test_geometric_at_constant_rate() -> None:
    """Departures at a constant rate: the truncated geometric law, also beyond its balance."""
    for load in (0.5, 1.0, 3.0):
        powers = load ** np.arange(21.0)
        law = BirthDeath(load, 1.0, 1.0, CONSTANT, 20).law
        assert law == pytest.approx(powers / powers.sum())


def test_groups_keep_the_mean() -> None:
    """With groups and no bound in reach the mean alive is groups times size times life."""
    law = BirthDeath(0.1, 3.0, 20.0, INDEPENDENT, 200).law
    assert law @ np.arange(201) == pytest.approx(6.0)


@pytest.mark.parametrize("kind", Departures)
def test_extreme_loads(kind: Departures) -> None:
    """Loads far beyond the bound, or none at all, neither overflow nor fail."""
    crowded = BirthDeath(1e5, 100.0, 1e7, kind, 3000).law
    assert math.isclose(crowded.sum(), 1.0)
    assert crowded[-1] > 0.9
    assert BirthDeath(0.0, 1.0, 60.0, kind, 5).law.tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert BirthDeath(1.0, 1.0, 60.0, kind, 0).law.tolist() == [1.0]
