"""`are fit` without the shell: observed rows in, the mixture that explains them out."""

from dataclasses import dataclass
from pathlib import Path

from are_ros.bag.recording import find_recording
from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.draw.plots import draw_fit
from are_ros.errors import InputError, ParameterError
from are_ros.fit.observed import ObservedRows, RowSpace, is_recording, read_observed
from are_ros.fit.results import (
    PARAMETERS,
    PICTURE,
    RECORD,
    RESULTS,
    FitOutcome,
    fitted_yaml,
    outcome_lines,
    record_content,
)
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import with_file
from are_ros.population.mixture_fit import best_by_bic, fit_by_bic, fit_mixture
from are_ros.replay.command import is_given
from are_ros.replay.output_folder import all_or_nothing, no_empty_folders
from are_ros.replay.progress import CountBar, ProgressBar, Say
from are_ros.replay.results import write_json


@dataclass(frozen=True)
class FitOptions:
    """What the command line asks for.

    The rows are those of `rows`, else of the catalogue `catalogue_file`, else of that which
    `parameter_files` name, else of the parameters of a recording, else of the shipped one.
    `components` None: the number of least BIC, of at most `max_components`.
    """

    source: Path
    out: Path
    rows: int | None = None
    catalogue_file: Path | None = None
    components: int | None = None
    max_components: int = 8
    seed: int = 0
    parameter_files: tuple[Path, ...] = ()


def fit_command(echo: Say, say: Say, options: FitOptions) -> None:
    """Run `are fit`: tables by `echo`, files into the folder. Raises AreError."""
    space, catalogue_file = row_space(options)
    with ProgressBar("read") as bar:
        observed = read_observed(options.source, space, bar.open)
    outcome = fitted(options, observed, space, catalogue_file)
    write_outcome(outcome, options.out)
    for line in outcome_lines(outcome):
        echo(line)
    say(f"results in {options.out}: {', '.join(RESULTS)}")


def row_space(options: FitOptions) -> tuple[RowSpace, Path | None]:
    """Return the rows that can occur, and the file of a catalogue that is not the shipped one."""
    if options.rows is not None:
        return RowSpace(options.rows), None
    if options.catalogue_file is not None:
        return RowSpace.of(read_catalogue(options.catalogue_file)), options.catalogue_file
    parameters = Parameters()
    for path in options.parameter_files:
        parameters = with_file(parameters, path)
    if is_recording(options.source) and not is_given("catalogue", options.parameter_files, ()):
        parameters = find_recording(options.source).effective()
    if not parameters.catalogue:
        return RowSpace.of(read_catalogue()), None
    return RowSpace.of(read_catalogue(Path(parameters.catalogue))), Path(parameters.catalogue)


def fitted(
    options: FitOptions, observed: ObservedRows, space: RowSpace, catalogue_file: Path | None
) -> FitOutcome:
    """Fit the mixture; an error of the rows names their source."""
    counts, seed = observed.counts, options.seed
    try:
        with CountBar("fit") as bar:
            if options.components is None:
                fits = fit_by_bic(counts, options.max_components, seed=seed, progress=bar.count)
            else:
                fits = (fit_mixture(counts, options.components, seed=seed, progress=bar.count),)
    except (InputError, ParameterError) as cause:
        told = f" ({'; '.join(observed.notes)})" if observed.notes else ""
        raise type(cause)(f"{options.source}: {cause}{told}") from cause
    return FitOutcome(
        source=options.source.name or str(options.source),
        observed=observed,
        space=space,
        fits=fits,
        chosen=best_by_bic(fits),
        is_by_bic=options.components is None,
        seed=options.seed,
        catalogue_file=catalogue_file,
    )


def write_outcome(outcome: FitOutcome, folder: Path) -> None:
    """Write fitted.yaml, fit.json and fit.png, all or none; BagError if they cannot be."""
    with no_empty_folders(folder), all_or_nothing(folder, RESULTS):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / PARAMETERS).write_text(fitted_yaml(outcome), encoding="utf-8")
        write_json(folder / RECORD, record_content(outcome))
        draw_fit(
            outcome.fits,
            outcome.chosen,
            outcome.observed.counts,
            folder / PICTURE,
            source=outcome.source,
            is_by_bic=outcome.is_by_bic,
            catalogue=outcome.space.catalogue,
        )
