"""How the parameters become the population: rows by Eq. 1, lives by the law of departures."""

from collections.abc import Callable
from pathlib import Path

from are_ros.builder.files.scenario_file import read_scenario
from are_ros.conventions import seconds_to_ns
from are_ros.parameters.model import Parameters
from are_ros.population.arrivals import RandomSource
from are_ros.population.artefact import Artefact
from are_ros.population.catalogue import Catalogue
from are_ros.population.departures import departure_law
from are_ros.population.mixture import mixture_of
from are_ros.population.population import Population
from are_ros.population.scenario import Scenario, ScriptedOffer, ScriptedSource


def random_population(
    parameters: Parameters,
    catalogue: Catalogue,
    *,
    begun: Callable[[Artefact, ScriptedOffer | None], object],
    stays_on: Callable[[Artefact], bool],
) -> Population:
    """Return the population of the random source; ParameterError where the mixture is bad.

    `begun` is told of each artefact as soon as it lives; `stays_on` tells whether an
    artefact whose life is over departs later. ScenarioError where the scenario is bad.
    """
    settings, law = parameters.population, mixture_of(parameters, catalogue)
    return Population(
        parameters.seed,
        RandomSource(parameters.seed, catalogue.rows, law, settings.group_size),
        departure_law(settings.departures, parameters.seed, settings.mean_life),
        max_alive=settings.max_alive,
        history_ns=seconds_to_ns(parameters.poses.history),
        begun=begun,
        stays_on=stays_on,
        scripted=ScriptedSource(scenario_of(parameters, catalogue)),
    )


def scenario_of(parameters: Parameters, catalogue: Catalogue) -> Scenario:
    """Return the scenario that the parameters name, or the one in which nobody is scripted."""
    path = parameters.population.scenario
    return read_scenario(Path(path), catalogue) if path else Scenario()
