"""The laws of the population where things change, come in groups, or are seen for long.

Each test has a fixed seed and a false-alarm level of 1 in 1,000. Without a bound and with rates
that change, the integrated rates between events are unit exponentials: the time change theorem.
"""

import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import Departures
from are_ros.population.arrivals import RandomSource
from are_ros.population.artefact import Artefact, GroundPose
from are_ros.population.birth_death import BirthDeath
from are_ros.population.catalogue import CatalogueRow, MeshFile
from are_ros.population.departures import Cause, departure_law
from are_ros.population.mixture import MixtureAmong, TruncatedPoissonMixture
from are_ros.population.population import EventKind, Population, PopulationEvent

INDEPENDENT, CONSTANT = Departures.INDEPENDENT, Departures.CONSTANT_RATE
LEVEL = 1e-3
EPOCH_NS = 1_700_000_000 * NS_PER_S
Floats = npt.NDArray[np.float64]


def _row(index: int) -> CatalogueRow:
    surface, nothing = MeshFile(Path("none.obj")), (0.0, 0.0, 0.0)
    return CatalogueRow(index, f"row {index}", "point", nothing, nothing, surface)


ROWS = tuple(_row(index) for index in range(6))
MIXTURE = TruncatedPoissonMixture((0.5, 0.5), (1.0, 2.0), len(ROWS))
SPOT = GroundPose(1.0, 1.0, 0.0, 0.0)


def _nobody(_: Artefact) -> bool:
    return False


def _population(
    seed: int,
    kind: Departures,
    *,
    group: float = 1.0,
    max_alive: int = 10**9,
    stays_on: Callable[[Artefact], bool] = _nobody,
) -> Population:
    source = RandomSource(seed, ROWS, MIXTURE, group)
    law = departure_law(kind, seed, 1.0)
    population = Population(seed, source, law, max_alive=max_alive, stays_on=stays_on)
    population.start(EPOCH_NS)
    return population


@dataclass
class _History:
    """Seconds since the beginning of arrivals, and of departures by id; N after each change."""

    offers_s: list[float] = field(default_factory=list)
    arrivals_s: dict[int, float] = field(default_factory=dict)
    departures_s: dict[int, float] = field(default_factory=dict)
    times_s: list[float] = field(default_factory=lambda: [0.0])
    alive: list[int] = field(default_factory=lambda: [0])
    offered: int = 0

    def note(self, events: Sequence[PopulationEvent], alive: int) -> None:
        """Note what happened at one instant."""
        at_s = (events[0].time_ns - EPOCH_NS) / NS_PER_S
        if events[0].kind is not EventKind.DEPARTED:
            self.offers_s.append(at_s)
            self.offered += len(events)
        for event in events:
            if event.kind is EventKind.ARRIVED:
                self.arrivals_s[event.artefact_id] = at_s
            elif event.kind is EventKind.DEPARTED:
                self.departures_s[event.artefact_id] = at_s
        self.times_s.append(at_s)
        self.alive.append(alive)

    def lives(self, before_s: float) -> Floats:
        """Return (arrival, departure) of those who came before, all of whom have left (L, 2)."""
        early = [i for i, at_s in self.arrivals_s.items() if at_s < before_s]
        assert all(i in self.departures_s for i in early)
        return np.array([(self.arrivals_s[i], self.departures_s[i]) for i in early])

    def shares(self, edges_s: Floats, levels: int) -> Floats:
        """Return the shares of time (B, levels) between edges; the last level is "or more"."""
        ends_s = np.append(self.times_s[1:], np.inf)
        shares = np.zeros((len(edges_s) - 1, levels))
        pairs = zip(edges_s[:-1], edges_s[1:], shares, strict=True)
        for low_s, high_s, row in pairs:
            inside_s = np.minimum(ends_s, high_s) - np.maximum(self.times_s, low_s)
            np.add.at(row, np.minimum(self.alive, levels - 1), np.maximum(inside_s, 0.0))
        return shares / np.diff(edges_s)[:, np.newaxis]


def _ns(at_s: float) -> int:
    return EPOCH_NS + round(at_s * NS_PER_S)


def _anywhere(*_: object) -> GroundPose:
    return SPOT


def _advance(population: Population, history: _History, until_s: float) -> None:
    while (at_ns := population.next_event_ns()) is not None and at_ns <= _ns(until_s):
        history.note(population.handle_next(_anywhere), len(population.living))


def _is_unit_exponential(sample: Floats) -> bool:
    return bool(stats.kstest(sample, "expon").pvalue > LEVEL)


@dataclass
class _Regime:
    """From an instant [s] on: lambda [1/(m^2 s)], area [m^2] and mean life [s]."""

    begin_s: float
    arrival_rate: float
    area_m2: float
    mean_life_s: float


def _regimes(count: int, length_s: float) -> list[_Regime]:
    """Return changes at times that fall upon no event, of one quantity or of several at once."""
    rates, areas, means_s = (
        (0.01, 0.03, 0.0, 0.02),
        (100.0, 40.0, 250.0),
        (2.0, 20.0, 0.4, 6.0, 1.0),
    )
    return [_Regime(k * length_s, rates[k % 4], areas[k % 3], means_s[k % 5]) for k in range(count)]


def _integrated(
    regimes: Sequence[_Regime], per_s: Callable[[_Regime], float], at_s: Floats
) -> Floats:
    """Return the integral of a rate from 0 to each time, the last regime without an end."""
    begins_s = np.array([regime.begin_s for regime in regimes])
    rates = np.array([per_s(regime) for regime in regimes])
    reached = np.concatenate(([0.0], np.cumsum(rates[:-1] * np.diff(begins_s))))
    k = np.searchsorted(begins_s, at_s, side="right") - 1
    integrals: Floats = reached[k] + rates[k] * (at_s - begins_s[k])
    return integrals


def _offers_per_s(regime: _Regime) -> float:
    return regime.arrival_rate * regime.area_m2


def _leaving_per_s(regime: _Regime) -> float:
    return 1.0 / regime.mean_life_s


def _run(population: Population, regimes: Sequence[_Regime], end_s: float) -> _History:
    history = _History()
    ends_s = [*(regime.begin_s for regime in regimes[1:]), end_s]
    for regime, until_s in zip(regimes, ends_s, strict=True):
        population.set_rates(
            regime.arrival_rate, regime.area_m2, regime.mean_life_s, _ns(regime.begin_s)
        )
        _advance(population, history, until_s)
    return history


@pytest.mark.parametrize("kind", Departures)
@pytest.mark.parametrize("group", [1.0, 2.5])
def test_under_changing_rates_the_integrated_rates_are_unit_exponentials(
    kind: Departures, group: float
) -> None:
    """KS on 1,000 waits and on the lives, or the departures' gaps, over 160 changes of them."""
    regimes = _regimes(160, 7.3)
    population = _population(5, kind, group=group, max_alive=10_000)
    history = _run(population, regimes, regimes[-1].begin_s + 7.3)
    consumed = _integrated(regimes, _offers_per_s, np.array([0.0, *history.offers_s]))
    assert len(consumed) > 1000
    assert _is_unit_exponential(np.diff(consumed))
    if kind is INDEPENDENT:
        spans = _integrated(regimes, _leaving_per_s, history.lives(1000.0).ravel()).reshape(-1, 2)
        assert _is_unit_exponential(spans[:, 1] - spans[:, 0])
        return
    # At a constant rate nobody leaves while nobody is alive, so that the clock stands then.
    clock = _integrated(regimes, _leaving_per_s, np.array(history.times_s))
    busy = np.cumsum(np.diff(clock) * (np.array(history.alive[:-1]) > 0))
    left = np.isin(history.times_s[1:], list(history.departures_s.values()))
    assert left.sum() > 600
    assert _is_unit_exponential(np.diff(busy[left], prepend=0.0))


def _expected_alive(regimes: Sequence[_Regime], at_s: float) -> float:
    """Return the mean of N at a time: what came, thinned by the chance to be still there."""
    grid_s = np.linspace(0.0, at_s, 200_001)
    middles_s = 0.5 * (grid_s[1:] + grid_s[:-1])
    k = np.searchsorted([regime.begin_s for regime in regimes], middles_s, side="right") - 1
    came = np.array([_offers_per_s(regime) for regime in regimes])[k]
    left = _integrated(regimes, _leaving_per_s, np.append(middles_s, at_s))
    return float((came * np.exp(left[:-1] - left[-1])).sum() * (grid_s[1] - grid_s[0]))


def _chi_square(numbers: Sequence[int], law: Floats) -> float:
    """Return the p-value of numbers under a law on 0, 1, ..., rare ones taken together."""
    counted = np.bincount(np.minimum(numbers, len(law) - 1), minlength=len(law)).astype(float)
    expected = law / law.sum() * len(numbers)
    while expected[0] < 5.0:
        expected, counted = _merged(expected, 0), _merged(counted, 0)
    while expected[-1] < 5.0:
        expected, counted = _merged(expected, -2), _merged(counted, -2)
    return float(stats.chisquare(counted, expected).pvalue)


def _merged(values: Floats, at: int) -> Floats:
    """Return the values with two neighbours in one: the first two (0) or the last two (-2)."""
    both = values[at : at + 2 or None].sum()
    return np.append(both, values[2:]) if at == 0 else np.append(values[:-2], both)


def _alive_after_changes(runs: int) -> tuple[list[int], float]:
    regimes, end_s = _regimes(9, 2.1), 18.3
    numbers = []
    for seed in range(runs):
        population = _population(seed, INDEPENDENT)
        _run(population, regimes, end_s)
        numbers.append(len(population.living))
    return numbers, _expected_alive(regimes, end_s)


def test_in_transit_the_number_alive_is_poisson() -> None:
    """N right after nine changes, in 250 runs: Poisson with the mean that the changes make."""
    numbers, mean = _alive_after_changes(250)
    assert _chi_square(numbers, stats.poisson.pmf(np.arange(40), mean)) > LEVEL


@pytest.mark.long
def test_in_transit_the_number_alive_is_poisson_in_many_runs() -> None:
    """The same in 5,000 runs."""
    numbers, mean = _alive_after_changes(5000)
    assert _chi_square(numbers, stats.poisson.pmf(np.arange(40), mean)) > LEVEL


def _batch_laws(
    groups_per_s: float, group: float, life_s: float, kind: Departures, bound: int
) -> Floats:
    """Return the stationary law as the null vector of the chain's generator."""
    rates = np.zeros((bound + 1, bound + 1))
    sizes = 1 + np.arange(80)
    chances = stats.poisson.pmf(sizes - 1, group - 1.0)
    for n in range(bound + 1):
        np.add.at(rates[n], np.minimum(n + sizes, bound), groups_per_s * chances)
        if n:
            rates[n, n - 1] += (n if kind is INDEPENDENT else 1) / life_s
    generator = rates - np.diag(rates.sum(axis=1))
    target = np.append(np.zeros(bound + 1), 1.0)
    law: Floats = np.linalg.lstsq(np.vstack((generator.T, np.ones(bound + 1))), target, rcond=None)[
        0
    ]
    return law


CHAINS = [
    # groups [1/s], mean size, mean life [s], departures, bound, correlation time [s] at most
    (1.5, 1.0, 2.0, INDEPENDENT, 40, 2.0),
    (1.5, 1.0, 2.0, INDEPENDENT, 4, 2.0),
    (0.6, 2.5, 2.0, INDEPENDENT, 60, 2.0),
    (0.6, 2.5, 2.0, INDEPENDENT, 5, 2.0),
    (1.0, 1.0, 0.5, CONSTANT, 60, 3.0),
    (2.4, 1.0, 0.5, CONSTANT, 6, 2.5),
    (0.5, 2.0, 0.5, CONSTANT, 60, 5.5),
    (1.4, 2.0, 0.5, CONSTANT, 6, 2.0),
]


def _long_run(case: tuple[float, float, float, Departures, int, float], batches: int) -> None:
    """Compare the time at each level, by batch means, and N read now and then, by chi-square."""
    groups_per_s, group, life_s, kind, bound, memory_s = case
    law = _batch_laws(groups_per_s, group, life_s, kind, bound)
    population = _population(17, kind, group=group, max_alive=bound)
    population.set_rates(groups_per_s / 50.0, 50.0, life_s, EPOCH_NS)
    history, length_s = _History(), 40.0 * memory_s
    edges_s: Floats = 20.0 * memory_s + length_s * np.arange(batches + 1, dtype=np.float64)
    _advance(population, history, edges_s[-1])
    # Batches of 40 correlation times are as good as independent; a class has a sixth of the time.
    classes = np.minimum(np.searchsorted(np.cumsum(law)[:-1], np.arange(1.0, 6.0) / 6.0), bound)
    cuts = np.unique(classes[classes < bound] + 1)
    joined = np.add.reduceat(history.shares(edges_s, bound + 1), [0, *cuts], axis=1)[:, :-1]
    excess = joined - np.add.reduceat(law, [0, *cuts])[:-1]
    mean, spread = excess.mean(axis=0), np.cov(excess, rowvar=False).reshape((len(cuts),) * 2)
    squared = batches * float(mean @ np.linalg.solve(spread, mean))
    freedom = (len(cuts), batches - len(cuts))
    scaled = squared * freedom[1] / (freedom[0] * (batches - 1))
    assert stats.f.sf(scaled, *freedom) > LEVEL
    # N read every 8 correlation times: at most exp(-8) of it is left of the last time.
    reads_s = np.arange(20.0 * memory_s, edges_s[-1], 8.0 * memory_s)
    read = np.array(history.alive)[np.searchsorted(history.times_s, reads_s, side="right") - 1]
    assert _chi_square(read.tolist(), law) > LEVEL
    # Offers see the law as time does: what is blocked is what finds no room under it.
    room = bound - np.arange(bound + 1)
    sizes = np.arange(1, 80)[:, np.newaxis]
    excess_of = np.maximum(sizes - room, 0) * stats.poisson.pmf(sizes - 1, group - 1.0)
    expected = float(law @ excess_of.sum(axis=0)) / group
    blocked = history.offered - len(history.arrivals_s)
    assert blocked / history.offered == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("case", CHAINS)
def test_a_long_run_spends_its_time_by_the_stationary_law(
    case: tuple[float, float, float, Departures, int, float],
) -> None:
    """Both departure models, bounded and not, alone and in groups: 40 batches of one run."""
    _long_run(case, 40)


@pytest.mark.long
@pytest.mark.parametrize("case", CHAINS)
def test_a_very_long_run_spends_its_time_by_the_stationary_law(
    case: tuple[float, float, float, Departures, int, float],
) -> None:
    """The same in 250 batches, six times as long."""
    _long_run(case, 250)


@pytest.mark.parametrize("case", CHAINS)
def test_a_run_that_begins_by_the_stationary_law_keeps_it(
    case: tuple[float, float, float, Departures, int, float],
) -> None:
    """N at the beginning, and 1.3 s later, in 250 runs: lives that are under way have no memory."""
    groups_per_s, group, life_s, kind, bound, _ = case
    chain = BirthDeath(groups_per_s, group, life_s, kind, bound)
    law = _batch_laws(groups_per_s, group, life_s, kind, bound)
    first, later = list[int](), list[int]()
    for seed in range(250):
        population = _population(seed, kind, group=group, max_alive=bound)
        population.set_rates(groups_per_s / 50.0, 50.0, life_s, EPOCH_NS)
        count = chain.drawn(np.random.default_rng(seed))
        events = population.populate(count, EPOCH_NS, lambda *_: SPOT, MIXTURE)
        assert len(events) == len(population.living) == count
        first.append(count)
        _advance(population, _History(), 1.3)
        later.append(len(population.living))
    assert _chi_square(first, law) > LEVEL
    assert _chi_square(later, law) > LEVEL


def test_who_is_there_at_the_beginning_leaves_some_time() -> None:
    """Rows that live for ever are left out, the others come by their shares; ids go on."""
    rows = tuple(replace(row, forever=row.index == 1) for row in ROWS)
    population = Population(
        3, RandomSource(3, rows, MIXTURE, 1.0), departure_law(INDEPENDENT, 3, 1.0), max_alive=3000
    )
    population.start(EPOCH_NS)
    among = MixtureAmong(MIXTURE, np.array([not row.forever for row in rows]))
    events = population.populate(2000, EPOCH_NS, lambda *_: SPOT, among)
    assert [event.artefact_id for event in events] == [*range(1, 2001)]
    assert {(event.kind, event.time_ns) for event in events} == {(EventKind.ARRIVED, EPOCH_NS)}
    shares = MIXTURE.probabilities() * [not row.forever for row in rows]
    counts = np.bincount([event.row.index for event in events], minlength=len(rows))
    assert counts[1] == 0
    expected = 2000 * np.delete(shares, 1) / shares.sum()
    assert stats.chisquare(np.delete(counts, 1), expected).pvalue > LEVEL


def test_lives_of_one_group_are_independent() -> None:
    """Of 700 groups, the first two lives: each exponential, uncorrelated in their ranks."""
    population = _population(9, INDEPENDENT, group=3.0)
    population.set_rates(0.01, 100.0, 4.0, EPOCH_NS)
    history = _History()
    _advance(population, history, 900.0)
    life_s = {i: left - history.arrivals_s[i] for i, left in history.departures_s.items()}
    pairs = [
        (life_s[i], life_s[i + 1])
        for i, at_s in history.arrivals_s.items()
        if at_s < 800.0
        and history.arrivals_s.get(i + 1) == at_s
        and history.arrivals_s.get(i - 1) != at_s
    ]
    first_s, second_s = np.array(pairs).T
    assert len(pairs) > 600
    assert _is_unit_exponential(first_s / 4.0)
    assert _is_unit_exponential(second_s / 4.0)
    assert stats.spearmanr(first_s, second_s).pvalue > LEVEL


def _alive_with_a_way_out(seed: int, way_out_s: float) -> int:
    """Return N after 40 s where everybody, his life over, takes so long to be gone."""
    population = _population(seed, INDEPENDENT, stays_on=lambda *_: True)
    population.set_rates(0.015, 100.0, 2.0, EPOCH_NS)
    walking: list[tuple[int, int]] = []
    end_ns = _ns(40.0)
    while True:
        event_ns = population.next_event_ns()
        assert event_ns is not None
        if walking and walking[0][0] <= min(event_ns, end_ns):
            gone_ns, artefact_id = heapq.heappop(walking)
            population.remove(artefact_id, gone_ns, Cause.LIFE_OVER)
        elif event_ns <= end_ns:
            for event in population.handle_next(_anywhere):
                if event.kind is EventKind.LEAVING:
                    gone_ns = event.time_ns + round(way_out_s * NS_PER_S)
                    heapq.heappush(walking, (gone_ns, event.artefact_id))
        else:
            return len(population.living)


def test_walking_out_adds_to_the_life_in_the_law() -> None:
    """A way out of 3 s after lives of 2 s: Poisson(1.5 * 5), in 250 runs; not Poisson(1.5 * 2)."""
    numbers = [_alive_with_a_way_out(seed, 3.0) for seed in range(250)]
    assert _chi_square(numbers, stats.poisson.pmf(np.arange(60), 7.5)) > LEVEL
    assert _chi_square(numbers, stats.poisson.pmf(np.arange(60), 3.0)) < LEVEL


def test_rows_follow_the_mixture_whatever_becomes_of_them() -> None:
    """Chi-square of the rows of those admitted at a tight bound: the mark is independent of it."""
    population = _population(23, INDEPENDENT, group=2.0, max_alive=3)
    population.set_rates(0.02, 100.0, 2.0, EPOCH_NS)
    rows: list[int] = []
    while len(rows) < 1500:
        events = population.handle_next(_anywhere)
        rows += [event.row.index for event in events if event.kind is EventKind.ARRIVED]
    assert population.counts.blocked > 1000
    expected = MIXTURE.probabilities() * len(rows)
    assert stats.chisquare(np.bincount(rows, minlength=6), expected).pvalue > LEVEL
    assert math.isclose(expected.sum(), len(rows))
