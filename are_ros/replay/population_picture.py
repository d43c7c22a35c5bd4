"""`are describe --plot`: the population of a configuration alone, run for long and drawn."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from tqdm import tqdm

from are_ros.artefacts.catalogue import Catalogue
from are_ros.description.population_trial import Progress, run_trial
from are_ros.description.site import Site
from are_ros.draw.population import draw_population
from are_ros.errors import InputError
from are_ros.parameters.model import Parameters
from are_ros.wording import why_refused

FILE_NAME: Final = "population.png"
_QUICK_S: Final = 1.0


def plot_population(parameters: Parameters, catalogue: Catalogue, site: Site, out: Path) -> Path:
    """Run the population of a configuration alone, draw it, and return the picture's path.

    `out` is a file if its name ends in .png, else a folder; folders are made if need be. A bar
    shows progress on a terminal's stderr when the run takes longer than a second. Raises InputError
    where nothing can be written there, ParameterError where nobody ever comes.
    """
    is_file = out.suffix.lower() == ".png" and not out.is_dir()
    path = out if is_file else out / FILE_NAME
    with _progress() as progress:
        trial = run_trial(parameters, catalogue, site, progress)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draw_population(trial, parameters, catalogue, site, path)
    except OSError as cause:
        reason = why_refused(cause)
        raise InputError(f"--plot {out}: {path.name} cannot be written ({reason})") from cause
    return path


@contextmanager
def _progress() -> Iterator[Progress]:
    """Give what moves a bar on stderr, which appears after a second, on a terminal only."""
    layout = "population {percentage:3.0f}%|{bar}| [{elapsed}<{remaining}]"
    with tqdm(total=1.0, bar_format=layout, delay=_QUICK_S, disable=None) as bar:

        def show(done: float) -> None:
            bar.update(done - bar.n)

        yield show
