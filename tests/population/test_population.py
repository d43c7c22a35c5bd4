"""The population: its laws, its bookkeeping, and that nothing depends on how time is cut."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from are_ros.conventions import NS_PER_S
from are_ros.errors import InputError, ParameterError, PlacementError
from are_ros.parameters.choices import Departures
from are_ros.population.arrivals import FIRST_ID, RandomSource
from are_ros.population.artefact import Artefact, GroundPose, Origin
from are_ros.population.catalogue import CatalogueRow, MeshFile
from are_ros.population.departures import (
    Cause,
    ConstantRateDepartures,
    IndependentLives,
    departure_law,
)
from are_ros.population.mixture import TruncatedPoissonMixture
from are_ros.population.population import Counts, EventKind, Place, Population, PopulationEvent
from are_ros.population.randomness import Purpose, generator
from are_ros.population.scenario import FIRST_ADMITTED_ID

EPOCH_NS = 1_700_000_000 * NS_PER_S
Record = tuple[int, str, int, int, str | None]


def _row(index: int, *, forever: bool = False) -> CatalogueRow:
    surface = MeshFile(Path("none.obj"))
    size_m, centre_m = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    return CatalogueRow(index, f"row {index}", "point", size_m, centre_m, surface, forever=forever)


ROWS = tuple(_row(index) for index in range(6))
MIXTURE = TruncatedPoissonMixture((0.5, 0.5), (1.0, 2.0), len(ROWS))


def _anywhere(
    row: CatalogueRow, stream: np.random.Generator, near: tuple[float, float] | None
) -> GroundPose:
    """Place a point on an unobstructed map of 10 m x 10 m."""
    del row, near
    x_m, y_m = 10.0 * stream.random(2)
    return GroundPose(float(x_m), float(y_m), 0.0, 0.0)


def _population(
    seed: int = 1,
    kind: Departures = Departures.INDEPENDENT,
    *,
    per_s: float = 1.0,
    mean_life_s: float = 5.0,
    max_alive: int = 200,
    group: float = 1.0,
    rows: tuple[CatalogueRow, ...] = ROWS,
    stays_on: Callable[[Artefact], bool] = lambda *_: False,
    begun: Callable[[Artefact, object], object] = lambda *_: None,
) -> Population:
    source = RandomSource(seed, rows, MIXTURE, group)
    law = departure_law(kind, seed, mean_life_s)
    population = Population(seed, source, law, max_alive=max_alive, stays_on=stays_on, begun=begun)
    population.start(EPOCH_NS)
    population.set_rates(per_s / 100.0, 100.0, mean_life_s, EPOCH_NS)
    return population


def _advance(
    population: Population, until_ns: int, place: Place = _anywhere
) -> list[PopulationEvent]:
    events: list[PopulationEvent] = []
    while (time_ns := population.next_event_ns()) is not None and time_ns <= until_ns:
        happened = population.handle_next(place)
        assert {event.time_ns for event in happened} == {time_ns}
        events += happened
    return events


def _records(events: list[PopulationEvent]) -> list[Record]:
    return [
        (e.time_ns, e.kind.value, e.artefact_id, e.row.index, e.cause and e.cause.value)
        for e in events
    ]


def _seconds(number: float) -> int:
    return EPOCH_NS + round(number * NS_PER_S)


both_kinds = pytest.mark.parametrize("kind", list(Departures))


def test_arrivals_and_lives_are_exponential() -> None:
    """Kolmogorov-Smirnov on gaps (mean 0.5 s) and whole lives (5 s), each at level 1/1,000."""
    population = _population(7, per_s=2.0)
    events = _advance(population, _seconds(700))
    arrived = {e.artefact_id: e.time_ns for e in events if e.kind is EventKind.ARRIVED}
    left = {e.artefact_id: e.time_ns for e in events if e.kind is EventKind.DEPARTED}
    gaps_s = np.diff([EPOCH_NS, *arrived.values()]) / NS_PER_S
    complete = [i for i in arrived if i in left and i <= 1200]
    lives_s = [(left[i] - arrived[i]) / NS_PER_S for i in complete]
    assert len(complete) == 1200
    assert stats.kstest(gaps_s, "expon", args=(0.0, 0.5)).pvalue > 1e-3
    assert stats.kstest(lives_s, "expon", args=(0.0, 5.0)).pvalue > 1e-3


def test_rows_follow_the_mixture_and_groups_their_law() -> None:
    """Chi-square of 2,000 rows against Eq. 1, and of the group sizes against 1 + Poisson(1.5)."""
    source = RandomSource(3, ROWS, MIXTURE, 2.5)
    source.set_rate(1.0, 0)
    offers = [source.take() for _ in range(800)]
    rows = np.bincount([row.index for offer in offers for _, row in offer.members], minlength=6)
    assert stats.chisquare(rows, MIXTURE.probabilities() * rows.sum()).pvalue > 1e-3
    sizes = np.minimum(np.bincount([len(offer.members) - 1 for offer in offers], minlength=6), 800)
    law = stats.poisson(1.5).pmf(np.arange(5))
    counted = [*sizes[:5], sizes[5:].sum()]
    assert stats.chisquare(counted, 800 * np.array([*law, 1.0 - law.sum()])).pvalue > 1e-3
    ids = [member for offer in offers for member, _ in offer.members]
    assert ids == list(range(FIRST_ID, FIRST_ID + len(ids)))


def _stationary_sample(
    kind: Departures, runs: int, per_s: float, mean_life_s: float, max_alive: int
) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return how often N was 0, 1, ... max_alive, each time read in a run of its own seed."""
    numbers = []
    for seed in range(runs):
        population = _population(
            seed, kind, per_s=per_s, mean_life_s=mean_life_s, max_alive=max_alive
        )
        _advance(population, _seconds(30.0))
        numbers.append(len(population.living))
    return np.bincount(numbers, minlength=max_alive + 1)


def _p_value(counted: np.ndarray[tuple[int], np.dtype[np.int64]], law: list[float]) -> float:
    expected = np.array(law) / sum(law) * counted.sum()
    assert expected.min() > 5.0
    return float(stats.chisquare(counted, expected).pvalue)


POISSON_3 = [3.0**n / math.factorial(n) for n in range(6)]
GEOMETRIC = [0.6**n for n in range(6)]
FULL = [1.2**n for n in range(6)]


@pytest.mark.parametrize(
    ("kind", "per_s", "mean_life_s", "law"),
    [
        (Departures.INDEPENDENT, 1.5, 2.0, POISSON_3),
        (Departures.CONSTANT_RATE, 1.2, 0.5, GEOMETRIC),
        (Departures.CONSTANT_RATE, 2.4, 0.5, FULL),
    ],
)
def test_the_stationary_law_is_the_truncated_one(
    kind: Departures, per_s: float, mean_life_s: float, law: list[float]
) -> None:
    """N after 30 s of 250 runs: Poisson(3) or geometric, cut at max_alive 5; level 1/1,000."""
    assert _p_value(_stationary_sample(kind, 250, per_s, mean_life_s, 5), law) > 1e-3


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "per_s", "mean_life_s", "law"),
    [
        (Departures.INDEPENDENT, 1.5, 2.0, POISSON_3),
        (Departures.INDEPENDENT, 2.0, 2.0, [4.0**n / math.factorial(n) for n in range(12)]),
        (Departures.CONSTANT_RATE, 1.2, 0.5, GEOMETRIC),
        (Departures.CONSTANT_RATE, 2.4, 0.5, FULL),
        (Departures.CONSTANT_RATE, 1.0, 0.5, [0.5**n for n in range(9)]),
    ],
)
def test_the_stationary_law_holds_in_many_runs(
    kind: Departures, per_s: float, mean_life_s: float, law: list[float]
) -> None:
    """The same with 6,000 runs and wider bounds; level 1/1,000."""
    sample = _stationary_sample(kind, 6000, per_s, mean_life_s, len(law) - 1)
    assert _p_value(sample, law) > 1e-3


def test_an_unbounded_population_has_the_poisson_mean() -> None:
    """Without a bound, N after 30 s over 200 runs has mean and variance 6, within 4 sigma."""
    numbers = np.repeat(np.arange(201), _stationary_sample(Departures.INDEPENDENT, 200, 3, 2, 200))
    assert abs(numbers.mean() - 6.0) < 4.0 * math.sqrt(6.0 / 200)
    assert abs(numbers.var(ddof=1) - 6.0) < 4.0 * 6.0 * math.sqrt(2.2 / 200)


@both_kinds
@settings(max_examples=40)
@given(cuts=st.lists(st.integers(0, 60 * NS_PER_S), max_size=30), again=st.booleans())
def test_lives_do_not_depend_on_how_time_is_cut(
    kind: Departures, cuts: list[int], *, again: bool
) -> None:
    """Advancing in random pieces, with the same rates set between them, gives the same records."""
    whole = _records(_advance(_population(5, kind, group=1.5), _seconds(60)))
    population = _population(5, kind, group=1.5)
    pieces: list[PopulationEvent] = []
    for cut_ns in [*sorted(cuts), 60 * NS_PER_S]:
        pieces += _advance(population, EPOCH_NS + cut_ns)
        if again:
            population.set_rates(0.01, 100.0, 5.0, EPOCH_NS + cut_ns)
    assert _records(pieces) == whole
    assert len(whole) > 60


@both_kinds
def test_blocked_arrivals_shift_no_later_draw(kind: Departures) -> None:
    """Where every third artefact finds no place, all others arrive when and as they did."""
    ids = count(1)

    def place_two_of_three(
        row: CatalogueRow, stream: np.random.Generator, near: tuple[float, float] | None
    ) -> GroundPose | Cause:
        return _anywhere(row, stream, near) if next(ids) % 3 else Cause.NO_PLACE

    free, crowded = _population(2, kind), _population(2, kind)
    expected = _advance(free, _seconds(60))
    happened = _advance(crowded, _seconds(60), place_two_of_three)
    offered = [(e.time_ns, e.artefact_id, e.row) for e in expected if e.cause is None]
    assert offered == [
        (e.time_ns, e.artefact_id, e.row) for e in happened if e.kind is not EventKind.DEPARTED
    ]
    blocked = [e for e in happened if e.kind is EventKind.BLOCKED]
    assert blocked
    assert all(e.artefact_id % 3 == 0 and e.cause is Cause.NO_PLACE for e in blocked)
    if kind is Departures.INDEPENDENT:
        ends = {e.artefact_id: e.time_ns for e in expected if e.kind is EventKind.DEPARTED}
        for event in happened:
            if event.kind is EventKind.DEPARTED:
                assert ends[event.artefact_id] == event.time_ns


def test_at_the_bound_an_arrival_is_blocked_with_its_reason() -> None:
    """With room for two, the third is offered, takes an id, is blocked, and is not placed."""
    asked: list[CatalogueRow] = []

    def place(
        row: CatalogueRow, stream: np.random.Generator, near: tuple[float, float] | None
    ) -> GroundPose:
        asked.append(row)
        return _anywhere(row, stream, near)

    population = _population(max_alive=2, mean_life_s=1e6)
    events = [event for _ in range(3) for event in population.handle_next(place)]
    assert asked == [event.row for event in events[:2]]
    assert [event.artefact_id for event in events[:2]] == [1, 2]
    assert events[2].kind is EventKind.BLOCKED
    assert events[2].cause is Cause.MAX_ALIVE
    assert events[2].artefact_id == 3
    assert population.counts == Counts(arrived=2, blocked=1)


def test_a_group_arrives_together_and_near_its_first_member() -> None:
    """One event, one instant; the first that finds a place is the others' neighbour."""
    asked: list[tuple[int, tuple[float, float] | None]] = []

    def place(
        row: CatalogueRow, stream: np.random.Generator, near: tuple[float, float] | None
    ) -> GroundPose | Cause:
        del row, stream
        number = len(asked) + 1
        asked.append((number, near))
        assert len(population.living) == max(number - 2, 0)
        return Cause.NO_PLACE if number == 1 else GroundPose(float(number), 0.5, 0.0, 0.0)

    population = _population(4, group=8.0)
    events = population.handle_next(place)
    assert len(events) > 3
    assert [event.artefact_id for event in events] == list(range(1, len(events) + 1))
    assert asked == [(1, None), (2, None), *((i, (2.0, 0.5)) for i in range(3, len(events) + 1))]


@both_kinds
def test_displaced_lives_are_censored(kind: Departures) -> None:
    """Who is removed does not leave again, and stays known for two seconds."""
    population = _population(3, kind, per_s=2.0)
    _advance(population, _seconds(20))
    now_ns = _seconds(20)
    victim = next(iter(population.living))
    before = population.counts
    event = population.remove(victim, now_ns, Cause.DISPLACED)
    assert (event.kind, event.cause, event.time_ns) == (
        EventKind.DEPARTED,
        Cause.DISPLACED,
        now_ns,
    )
    assert population.counts.departed == before.departed + 1
    assert victim not in population.living
    assert victim in [artefact.id for artefact in population.present_at(now_ns - 1)]
    assert victim not in [artefact.id for artefact in population.present_at(now_ns)]
    later = _advance(population, _seconds(60))
    assert victim not in [event.artefact_id for event in later]
    with pytest.raises(InputError, match=f"id {victim} "):
        population.remove(victim, _seconds(60), Cause.REMOVED)


@both_kinds
def test_the_books_balance_and_the_history_is_what_happened(kind: Departures) -> None:
    """Alive = arrived - departed at every event; present_at agrees with a list of all lives."""
    population = _population(6, kind, per_s=4.0, mean_life_s=1.0, group=2.0, max_alive=9)
    lives: dict[int, list[int]] = {}
    offered = 0
    while (now_ns := population.next_event_ns()) is not None and now_ns < _seconds(15):
        for event in population.handle_next(_anywhere):
            offered += event.kind is not EventKind.DEPARTED
            if event.kind is EventKind.ARRIVED:
                lives[event.artefact_id] = [now_ns]
            elif event.kind is EventKind.DEPARTED:
                lives[event.artefact_id].append(now_ns)
        counts = population.counts
        assert offered == counts.arrived + counts.blocked
        assert len(population.living) == counts.arrived - counts.departed
        for t_ns in (now_ns, now_ns - NS_PER_S, now_ns - 2 * NS_PER_S + 1):
            there = [
                i
                for i, life in lives.items()
                if life[0] <= t_ns and (life[1:] or [t_ns + 1])[0] > t_ns
            ]
            assert [artefact.id for artefact in population.present_at(t_ns)] == there
    assert population.counts.blocked > 0


@both_kinds
def test_structures_live_for_ever(kind: Departures) -> None:
    """Rows that live for ever never leave, and in neither law keep others alive or hurry them."""
    forever = tuple(_row(index, forever=index < 2) for index in range(6))
    population = _population(6, kind, per_s=2.0, mean_life_s=0.5, rows=forever)
    events = _advance(population, _seconds(40))
    left = [event.row.index for event in events if event.kind is EventKind.DEPARTED]
    structures = [a for a in population.living.values() if a.row.forever]
    assert len(left) > 20
    assert min(left) == 2
    assert len(structures) == sum(e.row.forever for e in events)
    assert all(artefact.departure_ns is None for artefact in structures)
    if kind is Departures.INDEPENDENT:
        plain = _advance(_population(6, kind, per_s=2.0, mean_life_s=0.5), _seconds(40))
        expected = {e.artefact_id: e.time_ns for e in plain if e.kind is EventKind.DEPARTED}
        gone = {e.artefact_id: e.time_ns for e in events if e.kind is EventKind.DEPARTED}
        assert gone == {i: t for i, t in expected.items() if i in gone}


@both_kinds
def test_an_admitted_artefact_ends_on_its_own_and_shifts_nothing(kind: Departures) -> None:
    """A requested life of 3 s ends after 3 s; the random artefacts live as they did without it."""
    alone, visited = _population(8, kind), _population(8, kind)
    expected = _records(_advance(alone, _seconds(30)))
    events = _advance(visited, _seconds(4))
    pose = GroundPose(1.0, 2.0, 0.0, 0.5)
    event = visited.admit(ROWS[0], pose, _seconds(4), life_ns=3 * NS_PER_S)
    guest = visited.living[event.artefact_id]
    assert event.artefact_id == FIRST_ADMITTED_ID
    assert guest.origin is Origin.SERVICE
    assert guest.ground_pose_at(_seconds(5)) == pose
    assert guest.departure_ns == _seconds(7)
    view = visited.living
    events += _advance(visited, _seconds(30))
    assert list(view) == sorted(visited.living)
    (end,) = [e for e in events if e.artefact_id == FIRST_ADMITTED_ID]
    assert (end.time_ns, end.cause) == (_seconds(7), Cause.LIFE_OVER)
    assert _records([e for e in events if e is not end]) == expected


def test_given_and_drawn_ends_come_in_the_order_of_time() -> None:
    """Of two at one instant, the lower id first; an artefact with a given end takes no part."""
    population = _population(1, per_s=1.0)
    _advance(population, _seconds(2))
    drawn_ns = min(one.departure_ns or 0 for one in population.living.values())
    (first,) = [i for i, one in population.living.items() if one.departure_ns == drawn_ns]
    population.set_rates(0.0, 100.0, 5.0, _seconds(2))
    lives_ns = [drawn_ns - 10 - _seconds(2), drawn_ns - _seconds(2)]
    early, same = [
        population.admit(
            ROWS[0],
            GroundPose(1.0, 1.0, 0.0, 0.0),
            _seconds(2),
            life_ns=life_ns,
        ).artefact_id
        for life_ns in lives_ns
    ]
    ends = [(e.time_ns, e.artefact_id) for e in _advance(population, drawn_ns)]
    assert ends == [(drawn_ns - 10, early), (drawn_ns, first), (drawn_ns, same)]


def test_only_given_ends_are_postponed_and_a_restart_forgets_all() -> None:
    """The law of departures has its own way to stand still: an infinite mean life."""
    population = _population(1, per_s=1.0)
    _advance(population, _seconds(2))
    drawn = {i: one.departure_ns for i, one in population.living.items()}
    guest = population.admit(
        ROWS[0],
        GroundPose(1.0, 1.0, 0.0, 0.0),
        _seconds(2),
        life_ns=NS_PER_S,
    ).artefact_id
    population.postpone(_seconds(2), _seconds(2) + 500)
    assert population.living[guest].departure_ns == _seconds(3) + 500
    population.postpone(_seconds(1), _seconds(2) + 200)  # of which it was there for 200 ns
    assert population.living[guest].departure_ns == _seconds(3) + 700
    assert {i: population.living[i].departure_ns for i in drawn} == drawn
    population.start(_seconds(2))
    population.set_rates(0.0, 100.0, 5.0, _seconds(2))
    assert population.next_event_ns() is None


def test_living_artefacts_are_in_the_order_of_their_ids() -> None:
    """An admitted artefact has a high id, and later random ones come before it."""
    population = _population(8, mean_life_s=1e5)
    view = population.living
    pose = GroundPose(1.0, 2.0, 0.0, 0.5)
    for _ in range(3):
        population.handle_next(_anywhere)
        population.admit(ROWS[0], pose, EPOCH_NS + 10**12)
    assert list(view) == [1, 2, 3, *range(FIRST_ADMITTED_ID, FIRST_ADMITTED_ID + 3)]


def test_admitting_without_a_life_draws_one_or_none() -> None:
    """A row of its own draws from the law, a structure stays; at the bound it is refused."""
    population = _population(8, per_s=0.0, max_alive=2)
    pose = GroundPose(0.0, 0.0, 0.0, 0.0)
    drawn = population.admit(ROWS[0], pose, EPOCH_NS).artefact_id
    life = generator(8, Purpose.LIFE, drawn).standard_exponential()
    assert population.living[drawn].departure_ns == EPOCH_NS + math.ceil(life / 0.2 * NS_PER_S)
    wall = _row(1, forever=True)
    standing = population.admit(wall, pose, EPOCH_NS).artefact_id
    assert population.living[standing].departure_ns is None
    with pytest.raises(PlacementError, match="2 artefacts live"):
        population.admit(wall, pose, EPOCH_NS)
    population.remove(standing, EPOCH_NS + 1, Cause.REMOVED)
    assert _advance(population, _seconds(1000))[0].artefact_id == drawn
    assert population.next_event_ns() is None


def test_a_changed_mean_life_moves_the_known_ends() -> None:
    """Half the mean halves what is left of each life, and the artefacts know it."""
    population = _population(8, mean_life_s=100.0)
    _advance(population, _seconds(10))
    before = {i: artefact.departure_ns for i, artefact in population.living.items()}
    population.set_rates(0.01, 100.0, 50.0, _seconds(10))
    for artefact_id, end_ns in before.items():
        assert end_ns is not None
        expected_ns = _seconds(10) + (end_ns - _seconds(10)) / 2
        after_ns = population.living[artefact_id].departure_ns
        assert after_ns == pytest.approx(expected_ns, abs=2)


def test_refused_rates_change_nothing() -> None:
    """Numbers out of their domain leave all as it was."""
    population = _population(8, Departures.CONSTANT_RATE, mean_life_s=0.5)
    expected_ns = population.next_event_ns()
    for rate, mean_life_s in ((-0.01, 0.5), (0.01, 0.0), (math.nan, 0.5)):
        with pytest.raises(ParameterError):
            population.set_rates(rate, 100.0, mean_life_s, EPOCH_NS + 10)
    assert population.next_event_ns() == expected_ns


@both_kinds
def test_a_new_start_forgets_the_living_and_no_id_comes_twice(kind: Departures) -> None:
    """After a jump back nobody lives, events come after the new instant, ids go on."""
    population = _population(8, kind, per_s=2.0)
    first = _advance(population, _seconds(20))
    population.start(EPOCH_NS)
    assert not population.living
    assert population.present_at(_seconds(20)) == []
    second = _advance(population, _seconds(20))
    assert all(event.time_ns >= EPOCH_NS for event in second)
    assert not {e.artefact_id for e in first} & {e.artefact_id for e in second}


def test_the_departed_are_known_for_the_length_of_the_history() -> None:
    """Two seconds; then the next departure has them forgotten."""
    population = _population(per_s=0.0, mean_life_s=1e6)
    pose = GroundPose(1.0, 1.0, 0.0, 0.0)
    first, second = (population.admit(ROWS[0], pose, EPOCH_NS).artefact_id for _ in range(2))
    population.remove(first, _seconds(10.0), Cause.REMOVED)
    assert [one.id for one in population.present_at(_seconds(9.0))] == [first, second]
    population.remove(second, _seconds(13.0), Cause.REMOVED)
    assert [one.id for one in population.present_at(_seconds(9.0))] == [second]


@both_kinds
@pytest.mark.parametrize("waited_s", [0.0, 2.0])
def test_a_life_after_a_jump_of_the_clock_is_as_long_as_any(
    kind: Departures, waited_s: float
) -> None:
    """One lives, the clock leaps by an hour, the next one lives: exponential, mean 1 s."""
    lives_s = []
    for seed in range(1000):
        population = _population(seed, kind, per_s=0.0, mean_life_s=1.0)
        population.admit(ROWS[0], GroundPose(1.0, 1.0, 0.0, 0.0), EPOCH_NS)
        _advance(population, _seconds(waited_s))
        population.halt(_seconds(waited_s))
        for artefact_id in list(population.living):
            population.remove(artefact_id, _seconds(3600), Cause.CLOCK_LEAPT)
        population.start(_seconds(3600))
        population.set_rates(0.0, 100.0, 1.0, _seconds(3600))
        pose, now_ns = GroundPose(2.0, 2.0, 0.0, 0.0), _seconds(3600)
        population.admit(ROWS[0], pose, now_ns)
        lives_s.append(((population.next_event_ns() or now_ns) - now_ns) / NS_PER_S)
    assert stats.kstest(lives_s, "expon").pvalue > 0.001


@both_kinds
def test_another_seed_gives_another_future(kind: Departures) -> None:
    """Reseeding keeps the living and their known ends; the same new seed gives the same gaps."""
    population = _population(8, kind, per_s=2.0)
    _advance(population, _seconds(20))
    ends = {i: a.departure_ns for i, a in population.living.items()}
    population.reseed(99, _seconds(20))
    assert {i: a.departure_ns for i, a in population.living.items()} == ends
    gap_s = generator(99, Purpose.ARRIVAL, 0).standard_exponential() / 2.0
    arrivals = [e.time_ns for e in _advance(population, _seconds(40)) if e.cause is None]
    assert arrivals[0] == pytest.approx(_seconds(20) + gap_s * NS_PER_S, abs=2)


@pytest.mark.parametrize("mean", [0.5, math.nan, math.inf])
def test_a_group_has_at_least_one_member(mean: float) -> None:
    """A mean group size below 1 is refused."""
    with pytest.raises(ParameterError, match="group_size"):
        RandomSource(1, ROWS, MIXTURE, mean)


@pytest.mark.parametrize(
    ("kind", "law"),
    [
        (Departures.INDEPENDENT, IndependentLives),
        (Departures.CONSTANT_RATE, ConstantRateDepartures),
    ],
)
def test_the_parameter_chooses_the_law(kind: Departures, law: Callable[..., object]) -> None:
    """Each choice of population.departures has its class."""
    assert type(departure_law(kind, 1, 2.0)) is law


# --- leaving


def _walked_out(
    population: Population, until_ns: int, takes_ns: int
) -> tuple[list[PopulationEvent], list[PopulationEvent]]:
    """Run it, each who leaves being gone after so long; return all but departures, and those."""
    told: list[PopulationEvent] = []
    gone: list[PopulationEvent] = []
    leaving: list[tuple[int, int]] = []
    while True:
        next_ns = population.next_event_ns() or until_ns + 1
        if leaving and leaving[0][0] < next_ns:
            at_ns, artefact_id = leaving.pop(0)
            gone.append(population.remove(artefact_id, at_ns, Cause.LIFE_OVER))
            continue
        if next_ns > until_ns:
            return told, gone
        for event in population.handle_next(_anywhere):
            told.append(event)
            if event.kind is EventKind.LEAVING:
                leaving.append((event.time_ns + takes_ns, event.artefact_id))


@both_kinds
def test_the_way_out_is_no_business_of_the_law(kind: Departures) -> None:
    """Arrivals, rows and ends of lives are bit-identical, whether 0, 1 or 7 s are walked out."""
    mean_life_s = 5.0 if kind is Departures.INDEPENDENT else 0.5
    vanishing = _population(6, kind, mean_life_s=mean_life_s)
    expected = _records(_advance(vanishing, _seconds(60)))
    for takes_s in (0, 1, 7):
        walking = _population(6, kind, mean_life_s=mean_life_s, stays_on=lambda *_: True)
        told, gone = _walked_out(walking, _seconds(60), takes_s * NS_PER_S)
        same = [replace(e, kind=EventKind.DEPARTED) if e.cause else e for e in told]
        assert _records(same) == expected
        assert len(gone) > 30
        assert {event.cause for event in gone} == {Cause.LIFE_OVER}


def test_those_who_leave_fill_the_place() -> None:
    """They are alive and counted by the bound until they are removed; then the next may come."""
    population = _population(2, max_alive=1, mean_life_s=0.5, stays_on=lambda *_: True)
    told = _advance(population, _seconds(20))
    (leaving,) = [event for event in told if event.kind is EventKind.LEAVING]
    after = [event for event in told if event.time_ns > leaving.time_ns]
    assert after
    assert {event.cause for event in after} == {Cause.MAX_ALIVE}
    one = population.living[leaving.artefact_id]
    assert one.departure_ns is None
    assert population.counts.departed == 0
    population.remove(one.id, _seconds(20), Cause.LIFE_OVER)
    assert population.counts.departed == 1
    assert _advance(population, _seconds(30))[0].kind is EventKind.ARRIVED


def test_rates_that_change_do_not_touch_those_who_leave() -> None:
    """No new end is given to a life that is over."""
    population = _population(2, mean_life_s=2.0, stays_on=lambda *_: True)
    told = _advance(population, _seconds(20))
    ids = [event.artefact_id for event in told if event.kind is EventKind.LEAVING]
    leaving = [population.living[artefact_id] for artefact_id in ids]
    assert leaving
    population.set_rates(0.01, 100.0, 50.0, _seconds(20))
    population.postpone(_seconds(20), _seconds(21))
    assert all(one.departure_ns is None for one in leaving)


def test_each_stays_on_or_not_on_its_own() -> None:
    """Those of even ids vanish, the others are leaving."""
    population = _population(3, mean_life_s=1.0, stays_on=lambda one: one.id % 2 == 1)
    told = _advance(population, _seconds(20))
    ends = {e.artefact_id: e.kind for e in told if e.cause is Cause.LIFE_OVER}
    assert len(ends) > 10
    for artefact_id, kind in ends.items():
        assert kind is (EventKind.LEAVING if artefact_id % 2 else EventKind.DEPARTED)


# --- behaviours


def test_behaviours_are_drawn_by_their_weights() -> None:
    """Chi-square of 600 against 5:3:2, at level 1/1,000; each by its id alone."""
    weights = {"walking": 5.0, "standing": 3.0, "running": 2.0}
    rows = tuple(replace(row, behaviours=weights) for row in ROWS)
    drawn: dict[int, str] = {}
    population = _population(
        4,
        per_s=10.0,
        max_alive=100_000,
        rows=rows,
        begun=lambda one, _: drawn.update({one.id: one.behaviour}),
    )
    _advance(population, _seconds(60))
    counted = [sum(name == own for own in drawn.values()) for name in weights]
    assert sum(counted) > 500
    assert stats.chisquare(counted, np.array([0.5, 0.3, 0.2]) * sum(counted)).pvalue > 1e-3
    alone = _population(4, per_s=1.0, rows=rows)
    _advance(alone, _seconds(20))
    assert alone.living
    assert all(one.behaviour == drawn[one.id] for one in alone.living.values())


def test_a_given_behaviour_is_kept_and_all_are_told_of() -> None:
    """`begun` hears of each artefact when it lives, with its behaviour and where it is."""
    told: list[Artefact] = []
    population = _population(4, begun=lambda one, _: told.append(one))
    pose = GroundPose(1.0, 2.0, 0.0, 0.5)
    event = population.admit(ROWS[0], pose, EPOCH_NS, behaviour="somebody:Else")
    assert [(one.id, one.behaviour) for one in told] == [(event.artefact_id, "somebody:Else")]
    assert told[0] is population.living[event.artefact_id]
    assert told[0].history.latest == pose
    _advance(population, _seconds(5))
    assert {one.id for one in told} >= set(population.living)


@pytest.mark.parametrize("cause", [Cause.NO_PLACE, Cause.NO_HIDDEN_PLACE])
def test_why_there_is_no_place_is_said(cause: Cause) -> None:
    """The reason of the placement becomes that of the event."""
    events = _advance(_population(4), _seconds(10), lambda *_: cause)
    assert len(events) > 3
    assert {(event.kind, event.cause) for event in events} == {(EventKind.BLOCKED, cause)}
