"""Tests of the population alone: its books, its places, and who is left out."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from are_ros.describe import population_trial
from are_ros.describe.population_trial import (
    AT_BOUND,
    ENDLESS,
    MISFIT,
    NO_PLACE,
    Trial,
    run_trial,
)
from are_ros.describe.site import Site, surveyed
from are_ros.errors import ParameterError
from are_ros.parameters.choices import Departures
from are_ros.parameters.model import Parameters
from are_ros.population.birth_death import BirthDeath
from are_ros.population.catalogue import Catalogue
from are_ros.world.occupancy_grid import OccupancyGrid

GridOf = Callable[[str], OccupancyGrid]
ParametersOf = Callable[..., Parameters]
HALL = "\n".join(["." * 16] * 16)


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(population_trial, "MOST_MEMBERS", 300)


def _trial(parameters: Parameters, catalogue: Catalogue, site: Site) -> Trial:
    return run_trial(parameters, catalogue, site)


@pytest.mark.parametrize("kind", ["independent", "constant_rate"])
@pytest.mark.parametrize("group", [1.0, 2.5])
def test_the_books_agree(
    kind: str, group: float, parameters_of: ParametersOf, catalogue: Catalogue
) -> None:
    """N(t) is what came less what went, whatever the law and the groups."""
    parameters = parameters_of(
        population__departures=kind, population__group_size=group, population__max_alive=4
    )
    trial = _trial(parameters, catalogue, Site())
    assert trial.changes_s[0] == trial.alive[0] == 0
    assert (np.diff(trial.changes_s) > 0.0).all()
    assert trial.alive.max() == 4
    assert trial.alive.min() == 0
    assert trial.offers_s[-1] <= trial.end_s
    assert trial.waits_s.sum() == pytest.approx(trial.offers_s[-1])
    assert len(trial.rows) >= len(trial.offers_s) >= len(trial.points_m) > 30
    assert (np.diff(trial.placed_s) > 0.0).all()
    assert trial.absent[AT_BOUND] > 0
    assert trial.appeared == np.maximum(np.diff(trial.alive), 0).sum()
    assert trial.time_shares().sum() == pytest.approx(1.0)


def test_shares_of_time_weigh_by_time() -> None:
    """A level that lasts twice as long has twice the share, and one never reached has none."""
    chain, none = BirthDeath(0.5, 1.0, 8.0, Departures.INDEPENDENT, 3), np.empty(0)
    path = np.array([0.0, 1.0, 4.0]), np.array([0, 2, 1])
    trial = Trial(chain, 8.0, none, np.empty(0, np.int64), *path, none, none, none, {})
    assert trial.time_shares().tolist() == [0.125, 0.5, 0.375, 0.0]


def test_the_same_seed_gives_the_same_trial(
    parameters_of: ParametersOf, catalogue: Catalogue
) -> None:
    """Nothing else is random."""
    one, two = (_trial(parameters_of(seed=3), catalogue, Site()) for _ in range(2))
    other = _trial(parameters_of(seed=4), catalogue, Site())
    assert np.array_equal(one.changes_s, two.changes_s)
    assert np.array_equal(one.points_m, two.points_m)
    assert not np.array_equal(one.rows[:50], other.rows[:50])


def test_on_a_map_everybody_stands_in_the_region_and_in_nobodys_way(
    grid_of: GridOf, parameters_of: ParametersOf, catalogue: Catalogue
) -> None:
    """In a crowd some find no place; those who fit nowhere do not count as such."""
    parameters = parameters_of(population__arrival_rate=0.02, population__mean_life=600.0)
    site = surveyed(grid_of("....\n....\n....\n...."), parameters, catalogue)
    trial = _trial(parameters, catalogue, site)
    assert site.misfits == {2}
    assert ((trial.points_m > 0.0) & (trial.points_m < 2.0)).all()
    misfits = int((trial.rows == 2).sum())
    assert 0 < trial.absent[NO_PLACE] <= len(trial.rows) - misfits - len(trial.points_m)
    assert (trial.absent[MISFIT], trial.absent.get(ENDLESS, 0)) == (misfits, 0)
    assert trial.appeared == len(trial.points_m)


def test_members_of_a_group_stand_near_their_first(
    parameters_of: ParametersOf, catalogue: Catalogue, grid_of: GridOf
) -> None:
    """A place is told for the first of each group only, with a map and without."""
    parameters = parameters_of(population__group_size=3.0, population__arrival_rate=0.002)
    for site in (Site(), surveyed(grid_of(HALL), parameters, catalogue)):
        trial = _trial(parameters, catalogue, site)
        assert len(trial.points_m) <= len(trial.offers_s)
        assert set(trial.placed_s) <= set(trial.offers_s)
        assert len(trial.rows) > 2 * len(trial.offers_s)


def test_who_never_leaves_is_left_out(parameters_of: ParametersOf, catalogue: Catalogue) -> None:
    """A row that lives for ever is drawn, but nobody of it fills the place."""
    rows = (replace(catalogue.rows[0], forever=True), *catalogue.rows[1:])
    trial = _trial(parameters_of(), Catalogue(rows), Site())
    assert (trial.rows == 0).sum() > 50
    assert len(trial.points_m) == (trial.rows != 0).sum()
    assert trial.absent == {ENDLESS: (trial.rows == 0).sum()}
    assert trial.chain.share < 1.0


@pytest.mark.parametrize(
    "values",
    [
        {"population__arrival_rate": 0.0},
        {"population__arrival_rate": 1e-12},
        {"population__max_alive": 0},
    ],
)
def test_nobody_comes(
    values: dict[str, float], parameters_of: ParametersOf, catalogue: Catalogue
) -> None:
    """What would never end, or not before the end of time, is refused."""
    with pytest.raises(ParameterError, match="nobody ever comes"):
        _trial(parameters_of(**values), catalogue, Site())


@pytest.mark.long
@pytest.mark.parametrize("group", [1.0, 2.0])
def test_lives_at_a_constant_rate_are_those_of_the_tagged_chain(
    group: float,
    monkeypatch: pytest.MonkeyPatch,
    parameters_of: ParametersOf,
    catalogue: Catalogue,
) -> None:
    """KS of every 40th life, several correlation times apart; level 1/1,000, and no exponential."""
    monkeypatch.setattr(population_trial, "MOST_MEMBERS", 8000)
    monkeypatch.setattr(population_trial, "CORRELATIONS", 5000)
    parameters = parameters_of(
        population__departures="constant_rate",
        population__group_size=group,
        population__arrival_rate=0.5 / group / 60.0 / 100.0,
    )
    trial = _trial(parameters, catalogue, Site())
    lives_s = trial.lives_s[::40]
    times_s = np.linspace(0.0, 60_000.0, 6001)
    died = 1.0 - trial.chain.survival(times_s[-1], len(times_s))
    assert len(lives_s) > 150
    assert stats.kstest(lives_s, lambda at_s: np.interp(at_s, times_s, died)).pvalue > 1e-3
    assert stats.kstest(lives_s, "expon", args=(0.0, 60.0)).pvalue < 1e-3
