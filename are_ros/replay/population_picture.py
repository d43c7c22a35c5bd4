"""population.png: what a configuration means, with a simulated sample of the population alone."""

from pathlib import Path
from typing import Final

from are_ros.artefacts.catalogue import Catalogue
from are_ros.description.population_trial import run_trial
from are_ros.description.site import Site
from are_ros.draw.population import draw_population
from are_ros.errors import InputError
from are_ros.parameters.model import Parameters
from are_ros.wording import why_refused

FILE_NAME: Final = "population.png"


def plot_population(parameters: Parameters, catalogue: Catalogue, site: Site, out: Path) -> Path:
    """Run the population of a configuration alone, draw it, and return the picture's path.

    `out` is a file if its name ends in .png, else a folder; folders are made if need be. Raises
    InputError where nothing can be written there, ParameterError where nobody ever comes.
    """
    is_file = out.suffix.lower() == ".png" and not out.is_dir()
    path = out if is_file else out / FILE_NAME
    trial = run_trial(parameters, catalogue, site)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draw_population(trial, parameters, catalogue, site, path)
    except OSError as cause:
        reason = why_refused(cause)
        raise InputError(f"--plot {out}: {path.name} cannot be written ({reason})") from cause
    return path
