"""A simulated sample of the population alone: arrivals, departures and places, no motion."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.spawning.placement import PlacementConstraints, Placer
from are_ros.conventions import NS_PER_S
from are_ros.describe.configuration import staying_share
from are_ros.describe.site import Site
from are_ros.errors import ParameterError
from are_ros.parameters.model import Parameters
from are_ros.population.arrivals import RandomSource
from are_ros.population.artefact import GroundPose, boxes_of
from are_ros.population.birth_death import BirthDeath
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
_NOBODY: Final = "nobody ever comes with these parameters: there is nothing to plot"

_Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trial:
    """What happened, in seconds from an empty beginning.

    `offers_s` (G,) are the instants of the groups; `rows` int64 (M,) of all members offered, in
    order. N(t) is `alive` int64 (K,) from `changes_s` (K,) on, the first at 0. `lives_s` are the
    lives of the artefacts that came in the first nine tenths of the time and left. `points_m`
    (P, 2) are the places where the first member of each group appeared, at `placed_s` (P,).
    `absent` counts the members that did not appear, by the reason: NO_PLACE, MISFIT, AT_BOUND,
    ENDLESS.
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

    Artefacts that never leave are left out: they would fill the place. On a map each artefact
    stands where it appeared, and the others keep clear of it; without a map they do not. Raises
    ParameterError where no artefact ever comes or stays.
    """
    settings = parameters.population
    law = mixture_of(parameters, catalogue)
    share = staying_share(law.probabilities(), catalogue, site)
    chain = BirthDeath.of(settings, site.area_m2, share)
    if chain.members_per_s <= 0.0 or settings.max_alive == 0:
        raise ParameterError(_NOBODY)
    population = Population(
        parameters.seed,
        RandomSource(parameters.seed, catalogue.rows, law, settings.group_size),
        departure_law(settings.departures, parameters.seed, settings.mean_life),
        max_alive=settings.max_alive,
        history_ns=0,
    )
    population.start(0)
    population.set_rates(settings.arrival_rate, site.area_m2, settings.mean_life, 0)
    place = _place_on(site, population, settings.group_radius)
    trial = _sampled(chain, population, place, site.misfits)
    if not len(trial.offers_s):  # before the end of time
        raise ParameterError(_NOBODY)
    return trial


def _sampled(
    chain: BirthDeath, population: Population, place: Place, misfits: frozenset[int]
) -> Trial:
    """Let the population live until there is enough to see, and return what happened."""
    likeliest = int(np.argmax(chain.law))
    wanted_s = max(CORRELATIONS * chain.correlation_s, LEAST_GROUPS / chain.groups_per_s)
    offered: list[PopulationEvent] = []
    arrived_s: dict[int, float] = {}
    points_m: list[tuple[float, float]] = []
    lives: list[tuple[float, float]] = []
    changes_s, alive = [0.0], [0]
    now_s, settled_s = 0.0, math.inf
    while now_s - settled_s < wanted_s and len(offered) < MOST_MEMBERS:
        now_ns = population.next_event_ns()
        if now_ns is None:
            break
        now_s = now_ns / NS_PER_S
        for event in population.handle_next(place):
            number = event.artefact_id
            if event.kind is EventKind.DEPARTED:
                lives.append((arrived_s[number], now_s - arrived_s[number]))
                continue
            offered.append(event)
            if event.kind is EventKind.ARRIVED:
                pose = population.living[number].ground_pose_at(now_ns)
                arrived_s[number] = now_s
                points_m.append((pose.x_m, pose.y_m))
        if len(population.living) != alive[-1]:
            changes_s.append(now_s)
            alive.append(len(population.living))
        if alive[-1] == likeliest:
            settled_s = min(settled_s, now_s)
    # The members of a group share their instant: the first of each is kept.
    placed_s, first = np.unique(np.array([*arrived_s.values()], np.float64), return_index=True)
    return Trial(
        chain,
        now_s,
        np.unique([event.time_ns / NS_PER_S for event in offered]),
        np.array([event.row.index for event in offered], np.int64),
        np.array(changes_s),
        np.array(alive, np.int64),
        np.array([life_s for came_s, life_s in lives if came_s < 0.9 * now_s]),
        np.array(points_m, np.float64).reshape(-1, 2)[first],
        placed_s,
        Counter(_why_absent(e, misfits) for e in offered if e.kind is not EventKind.ARRIVED),
    )


def _why_absent(event: PopulationEvent, misfits: frozenset[int]) -> str:
    """Return the reason why an artefact did not appear."""
    if event.cause is Cause.MAX_ALIVE:
        return AT_BOUND
    if event.row.forever:
        return ENDLESS
    return MISFIT if event.row.index in misfits else NO_PLACE


def _place_on(site: Site, population: Population, group_radius_m: float) -> Place:
    """Return what finds a place on a site for artefacts that leave some time."""
    place = _in_the_open(math.sqrt(site.area_m2), group_radius_m)
    if site.survey is not None:
        placer = Placer(site.survey.environment, site.survey.region)
        place = _on_the_map(placer, population, group_radius_m)

    def place_mortal(
        row: CatalogueRow, stream: np.random.Generator, near: tuple[float, float] | None
    ) -> GroundPose | Cause:
        return Cause.NO_PLACE if row.forever else place(row, stream, near)

    return place_mortal


def _on_the_map(placer: Placer, population: Population, radius_m: float) -> Place:
    def place(
        row: CatalogueRow, stream: np.random.Generator, near: tuple[float, float] | None
    ) -> GroundPose | Cause:
        living = population.living.values()
        rows = [artefact.row for artefact in living]
        poses = [artefact.ground_pose_at(artefact.arrival_ns) for artefact in living]
        within = None if near is None else (*near, radius_m)
        around = PlacementConstraints(boxes_of(rows, poses), within=within)
        return placer.place(row, stream, around) or Cause.NO_PLACE

    return place


def _in_the_open(side_m: float, radius_m: float) -> Place:
    """Return what places points in a square, members of a group in a disc about their first."""

    def place(
        _: CatalogueRow, stream: np.random.Generator, near: tuple[float, float] | None
    ) -> GroundPose:
        while True:
            x_m, y_m = (side_m * stream.random(2)).tolist()
            if near is None or math.hypot(x_m - near[0], y_m - near[1]) <= radius_m:
                return GroundPose(x_m, y_m, 0.0, 0.0)

    return place
