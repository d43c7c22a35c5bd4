"""A simulated sample of the population alone: arrivals, departures and places, no motion."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.spawning.placement import PlacementConstraints, Placer
from are_ros.conventions import NS_PER_S
from are_ros.describe.birth_death import BirthDeath
from are_ros.describe.configuration import staying_share
from are_ros.describe.site import Site
from are_ros.errors import ParameterError
from are_ros.parameters.model import Parameters
from are_ros.population.arrivals import RandomSource
from are_ros.population.artefact import GroundPose, boxes_of
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.departures import Cause, departure_law
from are_ros.population.mixture import mixture_of
from are_ros.population.population import EventKind, Place, Population, PopulationEvent

CORRELATIONS: Final = 100
"""How many correlation times of N a trial lasts, once N has come to its likeliest level."""
LEAST_GROUPS: Final = 500
MOST_MEMBERS: Final = 3_000

NO_PLACE, MISFIT = "found no place", "fit nowhere"
AT_BOUND, ENDLESS = "met a full population", "would never leave"

_Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trial:
    """What happened, in seconds from the beginning, when nobody was alive.

    `offers_s` (G,) are the instants of the groups; `rows` int64 (M,) of all members offered, in
    order. N(t) is `alive` int64 (K,) from `changes_s` (K,) on, the first at 0. `lives_s` are those
    of all who came in the first nine tenths and left. `points_m` (P, 2) is where, at `placed_s`
    (P,), the first of each group appeared. `absent` counts those who did not appear, by the reason:
    NO_PLACE of those that fit on the empty map, MISFIT, AT_BOUND, ENDLESS.
    """

    chain: BirthDeath
    end_s: float
    offers_s: _Floats
    rows: npt.NDArray[np.int64]
    changes_s: _Floats
    alive: npt.NDArray[np.int64]
    lives_s: _Floats
    points_m: _Floats
    placed_s: _Floats
    absent: Mapping[str, int]

    @property
    def appeared(self) -> int:
        """How many of those offered appeared."""
        return len(self.rows) - sum(self.absent.values())

    def time_shares(self) -> _Floats:
        """Return the shares of time that N(t) spent at 0, 1, ..., as long as `chain.law`."""
        lasted_s = np.diff(np.append(self.changes_s, self.end_s))
        spent_s = np.bincount(self.alive, weights=lasted_s, minlength=len(self.chain.law))
        shares: _Floats = spent_s / self.end_s
        return shares

    @property
    def waits_s(self) -> _Floats:
        """The times between offers (G,), the first from the beginning."""
        return np.diff(self.offers_s, prepend=0.0)


def run_trial(parameters: Parameters, catalogue: Catalogue, site: Site) -> Trial:
    """Run the population of a configuration on a site for a while.

    Those who would never leave are left out: they would fill the place. On a map everybody stands
    where he appeared, and is in the way of the others; on a site without one nobody is. Raises
    ParameterError where nobody ever comes or stays.
    """
    settings = parameters.population
    law = mixture_of(parameters, catalogue)
    share = staying_share(law.probabilities(), catalogue, site)
    chain = BirthDeath.of(settings, site.area_m2, share)
    if chain.members_per_s <= 0.0 or settings.max_alive == 0:
        raise ParameterError("nobody ever comes with these parameters: there is nothing to plot")
    population = Population(
        parameters.seed,
        RandomSource(parameters.seed, catalogue.rows, law, settings.group_size),
        departure_law(settings.departures, parameters.seed, settings.mean_life),
        max_alive=settings.max_alive,
        history_ns=0,
    )
    population.start(0)
    population.set_rates(settings.arrival_rate, site.area_m2, settings.mean_life, 0)
    book = _Book(chain, site.misfits)
    place = _place_on(site, population, settings.group_radius)
    while (now_ns := population.next_event_ns()) is not None and not book.is_full:
        before = len(population.living)
        for event in population.handle_next(place):
            book.note(event, population)
        book.count(now_ns / NS_PER_S, before, len(population.living))
    return book.closed()


@dataclass(eq=False)
class _Book:
    """Notes events as they come."""

    chain: BirthDeath
    misfits: frozenset[int]
    now_s: float = 0.0
    settled_s: float = math.inf
    offers_s: list[float] = field(default_factory=list)
    rows: list[int] = field(default_factory=list)
    changes_s: list[float] = field(default_factory=lambda: [0.0])
    alive: list[int] = field(default_factory=lambda: [0])
    arrived_s: dict[int, float] = field(default_factory=dict)
    lives: list[tuple[float, float]] = field(default_factory=list)
    places: list[tuple[float, float, float]] = field(default_factory=list)
    absent: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self._mode = int(np.argmax(self.chain.law))
        self._wanted_s = max(
            CORRELATIONS * self.chain.correlation_s, LEAST_GROUPS / self.chain.groups_per_s
        )

    @property
    def is_full(self) -> bool:
        """Whether it lasted long enough."""
        lasted_s = max(self.now_s - self.settled_s, 0.0)
        return lasted_s >= self._wanted_s or len(self.rows) >= MOST_MEMBERS

    def note(self, event: PopulationEvent, population: Population) -> None:
        """Note what became of one artefact."""
        at_s = event.time_ns / NS_PER_S
        if event.kind is EventKind.DEPARTED:
            arrived_s = self.arrived_s.pop(event.artefact_id)
            self.lives.append((arrived_s, at_s - arrived_s))
            return
        is_first = not self.offers_s or self.offers_s[-1] < at_s
        if is_first:
            self.offers_s.append(at_s)
        self.rows.append(event.row.index)
        if event.kind is EventKind.ARRIVED:
            self._note_place(event, population, at_s)
        else:
            self.absent[self._why_not(event)] += 1

    def count(self, now_s: float, before: int, alive: int) -> None:
        """Note how many are alive from now on."""
        self.now_s = now_s
        if alive != before:
            self.changes_s.append(now_s)
            self.alive.append(alive)
        if alive == self._mode:
            self.settled_s = min(self.settled_s, now_s)

    def closed(self) -> Trial:
        """Return what was noted."""
        early_s = 0.9 * self.now_s
        places = np.array(self.places).reshape(-1, 3)
        return Trial(
            self.chain,
            self.now_s,
            np.array(self.offers_s),
            np.array(self.rows, np.int64),
            np.array(self.changes_s),
            np.array(self.alive, np.int64),
            np.array([life_s for arrived_s, life_s in self.lives if arrived_s < early_s]),
            places[:, :2],
            places[:, 2],
            self.absent,
        )

    def _why_not(self, event: PopulationEvent) -> str:
        """Return the reason why an artefact did not appear."""
        if event.cause is Cause.MAX_ALIVE:
            return AT_BOUND
        if event.row.forever:
            return ENDLESS
        return MISFIT if event.row.index in self.misfits else NO_PLACE

    def _note_place(self, event: PopulationEvent, population: Population, at_s: float) -> None:
        self.arrived_s[event.artefact_id] = at_s
        if not self.places or self.places[-1][2] < at_s:
            pose = population.living[event.artefact_id].ground_pose_at(event.time_ns)
            self.places.append((pose.x_m, pose.y_m, at_s))


def _place_on(site: Site, population: Population, group_radius_m: float) -> Place:
    """Return what finds a place on a site for artefacts that leave some time."""
    place = _in_the_open(math.sqrt(site.area_m2), group_radius_m)
    if site.survey is not None:
        placer = Placer(site.survey.environment, site.survey.region)
        place = _on_the_map(placer, population, group_radius_m)

    def place_mortal(
        artefact_id: int,
        row: CatalogueRow,
        stream: np.random.Generator,
        near: tuple[float, float] | None,
    ) -> GroundPose | Cause | None:
        return None if row.forever else place(artefact_id, row, stream, near)

    return place_mortal


def _on_the_map(placer: Placer, population: Population, radius_m: float) -> Place:
    def place(
        _: int,
        row: CatalogueRow,
        stream: np.random.Generator,
        near: tuple[float, float] | None,
    ) -> GroundPose | None:
        living = population.living.values()
        rows = [artefact.row for artefact in living]
        poses = [artefact.ground_pose_at(artefact.arrival_ns) for artefact in living]
        within = None if near is None else (*near, radius_m)
        around = PlacementConstraints(boxes_of(rows, poses), within=within)
        return placer.place(row, stream, around)

    return place


def _in_the_open(side_m: float, radius_m: float) -> Place:
    """Return what places points in a square, members of a group in a disc about their first."""

    def place(
        _: int,
        __: CatalogueRow,
        stream: np.random.Generator,
        near: tuple[float, float] | None,
    ) -> GroundPose | None:
        while True:
            x_m, y_m = (side_m * stream.random(2)).tolist()
            if near is None or math.hypot(x_m - near[0], y_m - near[1]) <= radius_m:
                return GroundPose(x_m, y_m, 0.0, 0.0)

    return place
