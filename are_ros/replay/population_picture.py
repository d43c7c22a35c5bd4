"""population.png: what a configuration means, with a simulated sample of the population alone."""

from pathlib import Path
from typing import Any, Final

from are_ros.artefacts.catalogue import Catalogue
from are_ros.artefacts.mixture import mixture_of
from are_ros.description.population_trial import Trial, run_trial
from are_ros.description.site import Site
from are_ros.errors import InputError
from are_ros.parameters.choices import Departures
from are_ros.parameters.model import Parameters, PopulationParameters
from are_ros.replay._picture_arrivals import draw_arrivals, shape_of, shown_window
from are_ros.replay._picture_artefacts import class_colours
from are_ros.replay._picture_laws import (
    FAINT_INK,
    INK,
    draw_lives,
    draw_path,
    draw_rows,
    draw_shares,
    draw_waits,
    shown_s,
    time_unit,
)
from are_ros.wording import why_refused

FILE_NAME: Final = "population.png"
_HEIGHTS: Final = (4.3, 2.5)
_LEFT_IN: Final = 8.2
_MARGIN_IN: Final = 0.7
_DPI: Final = 120


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


def draw_population(
    trial: Trial, parameters: Parameters, catalogue: Catalogue, site: Site, path: Path
) -> None:
    """Write the picture of a trial as PNG; the same input gives the same bytes.

    N(t) and the share of time at each level against the stationary law; the arrivals in space
    (Fig. 3b); waiting times (Fig. 3a), lives and rows against theirs.
    """
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update({"font.family": "DejaVu Sans"})
        figure = _figure(trial, parameters, catalogue, site)
        figure.savefig(path, format="png", metadata={"Software": None})


def _figure(trial: Trial, parameters: Parameters, catalogue: Catalogue, site: Site) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    map_in = _HEIGHTS[0] * shape_of(shown_window(site))
    size = (_LEFT_IN + map_in + 1.9, sum(_HEIGHTS) + 2.2)
    figure = Figure(figsize=size, dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    path, shares, space, *below = _axes(figure, map_in)
    colours, end_s = _time_colours(), shown_s(trial)
    draw_path(path, trial, end_s, colours)
    draw_shares(shares, trial)
    draw_arrivals(space, trial, site, end_s, colours)
    draw_waits(below[0], trial)
    draw_lives(below[1], trial)
    by_class = class_colours(catalogue.class_names)
    probabilities = mixture_of(parameters, catalogue).probabilities()
    draw_rows(below[2], trial, catalogue, probabilities, by_class)
    _write_head(figure, trial, parameters, site)
    return figure


def _axes(figure: Any, map_in: float) -> list[Any]:
    """Return the axes of N(t), of its shares and of the map; and three below."""
    width, height = figure.get_size_inches()
    margins = {"left": _MARGIN_IN / width, "right": 1.0 - 0.65 / width}
    low, high = _HEIGHTS[1], _HEIGHTS[0]
    top = figure.add_gridspec(
        1,
        3,
        width_ratios=(_LEFT_IN - 1.9, 1.9, map_in),
        wspace=0.10,
        top=1.0 - 0.95 / height,
        bottom=1.0 - (0.95 + high) / height,
        **margins,
    )
    bottom = figure.add_gridspec(
        1, 3, wspace=0.2, top=(0.5 + low) / height, bottom=0.5 / height, **margins
    )
    path = figure.add_subplot(top[0, 0])
    shares = figure.add_subplot(top[0, 1], sharey=path)
    space = figure.add_subplot(top[0, 2])
    return [path, shares, space, *(figure.add_subplot(bottom[0, i]) for i in range(3))]


def _write_head(figure: Any, trial: Trial, parameters: Parameters, site: Site) -> None:
    width, height = figure.get_size_inches()
    settings, chain = parameters.population, trial.chain
    per_minute = 60.0 * chain.groups_per_s
    noun = f"groups of {settings.group_size:g}" if chain.is_grouped else "arrivals"
    title = f"{per_minute:.3g} {noun} per minute, {chain.mean:.3g} alive on average"
    unit_s, unit = time_unit(trial.end_s)
    parts = [
        f"{site.area_m2:.4g} m²" + ("" if site.survey else ", a square without obstacles"),
        _lives_text(settings),
        f"at most {chain.max_alive} alive",
        f"{trial.end_s / unit_s:.3g} {unit} simulated, nobody moves, seed {parameters.seed}",
        _appeared_text(trial),
    ]
    left = _MARGIN_IN / width
    figure.text(left, 1.0 - 0.16 / height, title, size=15, weight="bold", color=INK, va="top")
    text = "   ·   ".join(part for part in parts if part)
    figure.text(left, 1.0 - 0.49 / height, text, size=9, color=FAINT_INK, va="top")


def _appeared_text(trial: Trial) -> str:
    """Return how many of those who arrived appeared, and why the others did not."""
    others = ", ".join(f"{count} {reason}" for reason, count in trial.absent.items())
    if not others:
        return f"all {len(trial.rows)} who arrived appeared"
    return f"{trial.appeared} of {len(trial.rows)} who arrived appeared: {others}"


def _lives_text(settings: PopulationParameters) -> str:
    if settings.departures is Departures.INDEPENDENT:
        return f"independent lives, mean {settings.mean_life:g} s"
    return f"constant_rate, one leaves every {settings.mean_life:g} s"


def _time_colours() -> Any:
    """Return colours from the first time to the last that stand out on a pale map."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["plasma"](range(226)), name="arrival times")
