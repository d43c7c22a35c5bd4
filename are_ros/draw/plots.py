"""Plots by matplotlib: fit.png of the rows of a fit (the paper's Fig. 2), and population.png."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.describe.population_trial import Trial
from are_ros.describe.site import Site, Survey
from are_ros.draw.map import Window, known_part, map_image, window_of
from are_ros.draw.palette import (
    BAND,
    BAR,
    EDGE,
    FAINT_INK,
    INK,
    LAW,
    SERIES,
    TINT,
    class_colours,
    hex_of,
    mixed,
)
from are_ros.parameters.choices import Departures
from are_ros.parameters.model import Parameters, PopulationParameters
from are_ros.population.birth_death import BirthDeath
from are_ros.population.catalogue import Catalogue
from are_ros.population.mixture import mixture_of
from are_ros.wording import counted, time_unit

if TYPE_CHECKING:
    from are_ros.population.mixture_fit import MixtureFit  # takes scipy.special with it

_DPI: Final = 120
_SIZE_IN: Final = (11.5, 5.2)
_SMALLEST_GAP: Final = 1e-12
_STRAIGHT_TO: Final = 10.0
_MOST_TICKS: Final = 7
_NAMED_SHARE: Final = 0.05
"""A class's block of rows is named if it is at least so wide, as a share of all rows."""
INK_HEX, FAINT_INK_HEX, EDGE_HEX, BAR_HEX = map(hex_of, (INK, FAINT_INK, EDGE, BAR))
_COMPONENTS: Final = [hex_of(colour) for colour in SERIES]


@contextmanager
def written_figure(path: Path, size_in: tuple[float, float]) -> Iterator[Any]:
    """Give a figure to draw on, and write it as PNG; the same drawing gives the same bytes.

    Settings of matplotlib in force change nothing. Raises OSError.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update({"font.family": "DejaVu Sans", "font.size": 9})
        figure = Figure(figsize=size_in, dpi=_DPI, facecolor="white")
        FigureCanvasAgg(figure)
        yield figure
        figure.savefig(path, format="png", metadata={"Software": None})


def plain(text: str) -> str:
    """Return a text for matplotlib in which no $ begins a formula: names of files have some."""
    return text.replace("$", r"\$")


def write_head(figure: Any, left_in: float, title: str, subtitle: Sequence[str]) -> None:
    """Write a title and, in parts, what is said below it; empty parts are left out."""
    width, height = figure.get_size_inches()
    left, text = left_in / width, plain("   ·   ".join(part for part in subtitle if part))
    look = {"size": 15, "weight": "bold", "color": INK_HEX, "va": "top"}
    figure.text(left, 1.0 - 0.16 / height, plain(title), **look)
    figure.text(left, 1.0 - 0.49 / height, text, size=9, color=FAINT_INK_HEX, va="top")


def name_axes(axes: Any, title: str, across: str = "", up: str = "") -> None:
    """Write the title of a plot and what its axes are, and leave out the lines around it."""
    axes.set_title(title, fontsize=10, color=INK_HEX, loc="left", weight="bold", pad=6)
    axes.set(xlabel=across, ylabel=up)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(EDGE_HEX)
    axes.tick_params(labelsize=8.5, colors=FAINT_INK_HEX, length=3)
    for axis in (axes.xaxis, axes.yaxis):
        axis.label.set(size=8.5, color=FAINT_INK_HEX)


def draw_colour_bar(axes: Any, colours: Any, limits: tuple[float, float], title: str) -> None:
    """Draw which colour is which number, as an upright bar."""
    shades = np.linspace(0.0, 1.0, 256)[:, np.newaxis]
    look = {"aspect": "auto", "origin": "lower", "extent": (0.0, 1.0, *limits)}
    axes.imshow(shades, cmap=colours, **look)
    axes.set_xticks([])
    axes.yaxis.tick_right()
    axes.tick_params(labelsize=8.5, colors=FAINT_INK_HEX, length=3)
    axes.spines[:].set_visible(False)
    axes.set_title(title, fontsize=8.5, color=FAINT_INK_HEX, pad=4)


def draw_fit(
    fits: Sequence["MixtureFit"],
    chosen: "MixtureFit",
    counts: npt.NDArray[np.int64],
    path: Path,
    *,
    source: str,
    is_by_bic: bool,
    catalogue: Catalogue | None,
) -> None:
    """Write the picture of a fit as PNG; the same fit gives the same bytes.

    `counts` (K,) are those of the observed rows, of a catalogue or of none. `fits` have 1 to m
    components, of which one was chosen. Raises OSError.
    """
    word = "component" if chosen.components == 1 else "components"
    title = f"Poisson mixture of {chosen.components} {word}, fitted to {chosen.samples:,} rows"
    likelihood = f"log-likelihood per sample {chosen.log_likelihood_per_sample:.5f}"
    with written_figure(path, _SIZE_IN) as figure:
        write_head(figure, 0.63, title, [source, likelihood, f"BIC {chosen.bic:.1f}"])
        _draw_laws(figure.add_axes((0.055, 0.105, 0.58, 0.72)), counts, chosen, catalogue)
        if len(fits) > 1 and is_by_bic:
            _draw_climb(figure.add_axes((0.71, 0.56, 0.27, 0.265)), chosen)
            _draw_bic(figure.add_axes((0.71, 0.105, 0.27, 0.275)), fits, chosen)
        else:
            _draw_climb(figure.add_axes((0.71, 0.105, 0.27, 0.72)), chosen)


def _draw_laws(
    axes: Any,
    counts: npt.NDArray[np.int64],
    chosen: "MixtureFit",
    catalogue: Catalogue | None,
) -> None:
    """Draw the shares of the rows as bars, the mixture over them, and each component."""
    law = chosen.law
    rows = np.arange(len(counts))
    shares = counts / counts.sum()
    probabilities = law.probabilities()
    top = 1.12 * float(max(shares.max(), probabilities.max()))
    axes.set(xlim=(-0.7, len(rows) - 0.3), ylim=(0.0, top))
    if catalogue is not None:
        _draw_classes(axes, catalogue)
    axes.bar(rows, shares, width=0.86, color=BAR_HEX, label="observed", zorder=2)
    for i, component in enumerate(law.component_probabilities()):
        text = f"{law.weights[i]:.3f} Poisson({law.rates[i]:.4g})"
        colour = _COMPONENTS[i % len(_COMPONENTS)]
        axes.plot(rows, law.weights[i] * component, color=colour, lw=1.3, label=text, zorder=3)
    style = {"color": INK_HEX, "lw": 1.6, "marker": "o", "ms": 2.8, "zorder": 4}
    axes.plot(rows, probabilities, label="mixture", **style)
    name_axes(axes, "", "row of the catalogue", "probability")
    axes.legend(frameon=False, fontsize=8, labelcolor=INK_HEX, loc="upper right")


def _draw_classes(axes: Any, catalogue: Catalogue) -> None:
    """Tint the block of rows of each class, and name it along the upper edge."""
    colours = class_colours(catalogue.class_names)
    for name in catalogue.class_names:
        rows = [row.index for row in catalogue.rows if row.class_name == name]
        left, right = rows[0] - 0.5, rows[-1] + 0.5
        colour = hex_of(colours[name])
        axes.axvspan(left, right, color=colour, alpha=0.07, lw=0, zorder=0)
        if right - left >= _NAMED_SHARE * len(catalogue.rows):
            place = axes.get_xaxis_transform()
            style = {"color": colour, "size": 8, "ha": "center", "va": "bottom", "transform": place}
            axes.text(0.5 * (left + right), 1.01, plain(name), **style)


def _draw_climb(axes: Any, chosen: "MixtureFit") -> None:
    """Draw how far below its end the log-likelihood was at each point of the best climb.

    It ends where nothing was gained any more; the name of the axis says how many there were.
    """
    from matplotlib.ticker import MaxNLocator

    trace = chosen.trace
    below = np.maximum(trace[-1] - trace, _SMALLEST_GAP)
    shown = climb_length(below)
    axes.semilogy(np.arange(1, shown + 1), below[:shown], color=INK_HEX, lw=1.3)
    if shown > 100:
        axes.set_xscale("log")
    else:
        axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    axes.set_ylim(0.5 * _SMALLEST_GAP, 3.0 * max(float(below.max()), 10.0 * _SMALLEST_GAP))
    across = f"point of the search, of {len(below)}"
    name_axes(axes, "convergence", across, "below the end, per sample")


def climb_length(below: npt.NDArray[np.float64]) -> int:
    """Return how many points (N,) show all of a climb: a few of those that gained nothing more."""
    last = np.flatnonzero(below > _SMALLEST_GAP)
    climbing = int(last[-1]) + 1 if len(last) else 0
    return min(len(below), climbing + max(2, climbing // 10))


def bic_ticks(most: float) -> list[int]:
    """Return 0 and round numbers up to a height above 10, for an axis that is straight to there.

    They are few: without twos and fives where there would be more than seven.
    """
    decades = range(1, math.floor(math.log10(most)) + 1)
    for factors in ((1, 2, 5), (1, 5), (1,)):
        above = [factor * 10**decade for decade in decades for factor in factors]
        half = [5] if len(factors) > 1 else []
        ticks = [0, *half, *(tick for tick in above if tick <= most)]
        if len(ticks) <= _MOST_TICKS:
            break
    return ticks


def _draw_bic(axes: Any, fits: Sequence["MixtureFit"], chosen: "MixtureFit") -> None:
    """Draw by how much the BIC of each number of components lies above the least."""
    numbers = [fit.components for fit in fits]
    above = [fit.bic - chosen.bic for fit in fits]
    axes.plot(numbers, above, color=INK_HEX, lw=1.0, marker="o", ms=3.5)
    axes.plot([chosen.components], [0.0], "o", color=_COMPONENTS[0], ms=7.0)
    if max(above) > _STRAIGHT_TO:
        axes.set_yscale("symlog", linthresh=_STRAIGHT_TO)
        ticks = bic_ticks(max(above))
        axes.set_yticks(ticks, [f"{tick:,}" for tick in ticks])
    axes.set_xticks(numbers)
    name_axes(axes, "number of components", "components", "BIC above the least")


Floats = npt.NDArray[np.float64]

_HEIGHTS_IN: Final = (4.3, 2.5)
_LEFT_IN: Final = 8.2
_MARGIN_IN: Final = 0.7
_LEGEND_COLUMNS: Final = 3
_TEXT_SHARE, _LEGEND_LINE_SHARE = 0.16, 0.085
"""How much of the height of a lower panel a line of text takes, and a line of the legend."""
_NARROWEST, _WIDEST = 0.55, 1.7
_LAW: Final = hex_of(LAW)
_PATH: Final = hex_of(TINT)
_BINS: Final = 40
_LEAST_UNITS: Final = 4.0
"""A time axis is in a unit of which it has at least so many."""
_QUANTILE: Final = 0.995
_SEPARATE_BARS: Final = 40
_CUT_FROM: Final = 0.001
_SHOWN_CORRELATIONS: Final = 25.0
_SHOWN_GROUPS: Final = (60.0, 250.0)
_PANEL_PX_PER_IN: Final = 240.0
_MOST_TINT: Final = 0.16


def draw_population(
    trial: Trial, parameters: Parameters, catalogue: Catalogue, site: Site, path: Path
) -> None:
    """Write the picture of a trial as PNG; the same input gives the same bytes.

    N(t) and the share of time at each level against the stationary law; the arrivals in space
    (Fig. 3b); waiting times (Fig. 3a), lives and rows against theirs. Raises OSError.
    """
    window = _shown_window(site)
    shape = min(max(window.width_m / window.height_m, _NARROWEST), _WIDEST)
    size_in = (_LEFT_IN + _HEIGHTS_IN[0] * shape + 1.9, sum(_HEIGHTS_IN) + 2.2)
    with written_figure(path, size_in) as figure:
        draw_trial(figure, trial, parameters, catalogue, site)


def draw_trial(
    figure: Any, trial: Trial, parameters: Parameters, catalogue: Catalogue, site: Site
) -> None:
    """Draw all plots of a trial on a figure."""
    numbers, shares, space, *below = _axes(figure)
    colours, end_s = _time_colours(), _shown_s(trial)
    _draw_numbers(numbers, trial, end_s, colours)
    _draw_shares(shares, trial)
    _draw_arrivals(space, trial, site, end_s, colours)
    _draw_waits(below[0], trial)
    _draw_lives(below[1], trial)
    _draw_rows(below[2], trial, catalogue, mixture_of(parameters, catalogue).probabilities())
    settings, chain = parameters.population, trial.chain
    noun = f"groups of {settings.group_size:g}" if chain.is_grouped else "arrivals"
    title = f"{60.0 * chain.groups_per_s:.3g} {noun} per minute, {chain.mean:.3g} alive on average"
    unit_s, unit = time_unit(trial.end_s, _LEAST_UNITS)
    subtitle = [
        f"{site.area_m2:.4g} m²" + ("" if site.survey else ", a square without obstacles"),
        _lives_text(settings),
        f"at most {chain.max_alive} alive",
        f"{trial.end_s / unit_s:.3g} {unit} simulated, nobody moves, seed {parameters.seed}",
        appeared_text(trial),
    ]
    write_head(figure, _MARGIN_IN, title, subtitle)


def appeared_text(trial: Trial) -> str:
    """Return how many of the arrivals appeared, and why the others did not."""
    others = ", ".join(f"{count} {reason}" for reason, count in trial.absent.items())
    if not others:
        return f"all {len(trial.rows)} arrivals appeared"
    return f"{trial.appeared} of {len(trial.rows)} arrivals appeared: {others}"


def _lives_text(settings: PopulationParameters) -> str:
    if settings.departures is Departures.INDEPENDENT:
        return f"independent lives, mean {settings.mean_life:g} s"
    return f"constant_rate, one leaves every {settings.mean_life:g} s"


def _axes(figure: Any) -> list[Any]:
    """Return the axes of N(t), of its shares and of the map; and three below."""
    width, height = figure.get_size_inches()
    margins = {"left": _MARGIN_IN / width, "right": 1.0 - 0.65 / width}
    high, low = _HEIGHTS_IN
    top = figure.add_gridspec(
        1,
        3,
        width_ratios=(_LEFT_IN - 1.9, 1.9, width - _LEFT_IN - 1.9),
        wspace=0.10,
        top=1.0 - 0.95 / height,
        bottom=1.0 - (0.95 + high) / height,
        **margins,
    )
    bottom = figure.add_gridspec(
        1, 3, wspace=0.2, top=(0.5 + low) / height, bottom=0.5 / height, **margins
    )
    numbers = figure.add_subplot(top[0, 0])
    shares = figure.add_subplot(top[0, 1], sharey=numbers)
    space = figure.add_subplot(top[0, 2])
    return [numbers, shares, space, *(figure.add_subplot(bottom[0, i]) for i in range(3))]


def _time_colours() -> Any:
    """Return colours from the first time to the last that stand out on a pale map."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["plasma"](range(226)), name="arrival times")


def _shown_s(trial: Trial) -> float:
    """Return how long the beginning of a trial is that is shown [s]."""
    chain = trial.chain
    least_s, most_s = (groups / chain.groups_per_s for groups in _SHOWN_GROUPS)
    wanted_s = min(max(_SHOWN_CORRELATIONS * chain.correlation_s, least_s), most_s)
    return min(wanted_s, trial.end_s)


def _draw_numbers(axes: Any, trial: Trial, end_s: float, colours: Any) -> None:
    """Draw N(t) from the beginning, its stationary mean and band, and a tick for each arrival."""
    from matplotlib.ticker import MaxNLocator

    unit_s, name = time_unit(end_s, _LEAST_UNITS)
    chain, (low, high) = trial.chain, trial.chain.band()
    shown = trial.changes_s <= end_s
    times = np.append(trial.changes_s[shown], end_s) / unit_s
    levels = np.append(trial.alive[shown], trial.alive[shown][-1])
    band = f"nine tenths of the time: {low} to {high}"
    axes.axhspan(low, high, color=hex_of(BAND), lw=0, label=band)
    axes.axhline(chain.mean, color=_LAW, lw=1.4, label=f"stationary mean {chain.mean:.3g}")
    axes.step(times, levels, where="post", color=_PATH, lw=1.1, label="alive")
    offers_s = trial.offers_s[trial.offers_s <= end_s]
    top = max(float(levels.max()), high) * 1.24 + 0.6
    tick = 0.035 * top
    marks = {"colors": colours(offers_s / end_s), "lw": 1.3}
    axes.vlines(offers_s / unit_s, -1.6 * tick, -0.4 * tick, **marks)
    axes.set(xlim=(0.0, end_s / unit_s), ylim=(-2.1 * tick, top))
    axes.legend(loc="upper left", ncol=3, frameon=False, fontsize=8.5, labelcolor=INK_HEX)
    axes.yaxis.set_major_locator(MaxNLocator(8, integer=True))
    name_axes(axes, "N(t): how many are alive, and when they arrive", f"time [{name}]", "alive")


def _draw_shares(axes: Any, trial: Trial) -> None:
    """Draw which share of the whole time N(t) was at each level, beside the stationary law."""
    from matplotlib.ticker import MaxNLocator

    law, levels = trial.chain.law, np.arange(len(trial.chain.law))
    shares = trial.time_shares()
    likely = np.flatnonzero((law > 2e-3 * law.max()) | (shares > 2e-3))
    shown = levels[likely[0] : likely[-1] + 1]
    is_short = len(shown) <= _SEPARATE_BARS
    if is_short:
        axes.barh(shown, shares[shown], height=0.86, color=BAR_HEX)
    else:
        edges = np.append(shown, shown[-1] + 1) - 0.5
        axes.stairs(shares[shown], edges, orientation="horizontal", fill=True, color=BAR_HEX)
    axes.plot(law[shown], shown, "o-" if is_short else "-", color=_LAW, ms=3.2, lw=1.2)
    axes.set_xlim(0.0, 1.2 * float(max(law.max(), shares.max())))
    _write(axes, [_law_name(trial.chain)])
    axes.xaxis.set_major_locator(MaxNLocator(4))
    name_axes(axes, "share of the time", "share")
    axes.tick_params(labelleft=False)


def _draw_waits(axes: Any, trial: Trial) -> None:
    """Draw the waiting times between arrivals and their exponential density (the Fig. 3a)."""
    law_mean_s, mean_s = 1.0 / trial.chain.groups_per_s, float(trial.waits_s.mean())
    reach_s, unit_s, name = _reach(trial.waits_s)
    times_s = np.linspace(0.0, reach_s, 200)
    _draw_density(axes, trial.waits_s, times_s, np.exp(-times_s / law_mean_s) / law_mean_s, unit_s)
    noun = "groups" if trial.chain.is_grouped else "arrivals"
    count = f"{len(trial.waits_s)} {noun}, mean {mean_s / unit_s:.3g} {name}"
    _write(axes, [count])
    title = f"waiting times between {noun}"
    name_axes(axes, title, f"time [{name}]", f"density [1/{name}]")


def _draw_lives(axes: Any, trial: Trial) -> None:
    """Draw the lives and their density: exponential, or that of lives drawn at random."""
    chain, lives_s = trial.chain, trial.lives_s
    if not len(lives_s):
        _write(axes, ["no artefact has left yet"])
        name_axes(axes, "lives")
        return
    reach_s, unit_s, name = _reach(lives_s)
    times_s = np.linspace(0.0, reach_s, 201)
    density = -np.diff(chain.survival(reach_s, len(times_s))) / np.diff(times_s)
    middles_s = 0.5 * (times_s[1:] + times_s[:-1])
    _draw_density(axes, lives_s, middles_s, density, unit_s)
    lines = [
        f"{len(lives_s)} lives, mean {float(lives_s.mean()) / unit_s:.3g} {name},",
        "of artefacts that came in the",
        "first nine tenths of the time",
    ]
    if chain.departures is not Departures.INDEPENDENT:
        lines.append("the next to leave is drawn at random")
    _write(axes, lines)
    name_axes(axes, "lives", f"time [{name}]", f"density [1/{name}]")


def _draw_rows(axes: Any, trial: Trial, catalogue: Catalogue, probabilities: Floats) -> None:
    """Draw how often each row of the catalogue was drawn, in its class's colour, and Eq. 1."""
    drawn = np.bincount(trial.rows, minlength=len(probabilities)) / len(trial.rows)
    rows, colours = np.arange(len(probabilities)), class_colours(catalogue.class_names)
    for name in catalogue.class_names:
        own = np.array([row.index for row in catalogue.rows if row.class_name == name])
        colour = hex_of(colours[name])
        axes.bar(own, drawn[own], width=0.86, color=colour, alpha=0.55, label=plain(name))
    axes.plot(rows, probabilities, "o-", color=INK_HEX, ms=2.4, lw=0.9)
    _write(axes, [f"{len(trial.rows)} artefacts"])
    look = {"frameon": False, "fontsize": 8.5, "labelcolor": INK_HEX, "handlelength": 1.0}
    lines = math.ceil(len(catalogue.class_names) / _LEGEND_COLUMNS)
    axes.legend(loc="upper right", bbox_to_anchor=(1.0, 0.91), ncol=_LEGEND_COLUMNS, **look)
    room = min(_TEXT_SHARE + lines * _LEGEND_LINE_SHARE, 0.6)
    top = float(max(drawn.max(), probabilities.max())) / (1.0 - room)
    axes.set(xlim=(-0.8, len(rows) - 0.2), ylim=(0.0, top))
    name_axes(axes, "rows of the catalogue, by Eq. 1", "row", "share")


def _draw_density(
    axes: Any, sample_s: Floats, times_s: Floats, density: Floats, unit_s: float
) -> None:
    reach_s = float(times_s[-1])
    edges_s = np.linspace(0.0, reach_s, _BINS + 1)
    heights = np.histogram(sample_s, edges_s)[0] / (len(sample_s) * np.diff(edges_s))
    axes.stairs(heights * unit_s, edges_s / unit_s, fill=True, color=BAR_HEX)
    axes.plot(times_s / unit_s, density * unit_s, color=_LAW, lw=1.5)
    top = 1.12 * unit_s * max(float(heights.max()), float(density.max()))
    axes.set(xlim=(0.0, reach_s / unit_s), ylim=(0.0, top))


def _reach(times_s: Floats) -> tuple[float, float, str]:
    """Return how far times are drawn [s], and their unit."""
    reach_s = float(np.quantile(times_s, _QUANTILE))
    return (reach_s, *time_unit(reach_s, _LEAST_UNITS))


def _law_name(chain: BirthDeath) -> str:
    if chain.is_grouped:
        return "law of the batch chain"
    name = "Poisson" if chain.departures is Departures.INDEPENDENT else "geometric"
    cut = f", cut at {chain.max_alive}" if chain.law[-1] > _CUT_FROM else ""
    return f"{name}({chain.load:.3g}){cut}"


def _write(axes: Any, lines: list[str]) -> None:
    look = {"ha": "right", "va": "top", "fontsize": 8.5, "color": INK_HEX, "linespacing": 1.35}
    box = {"facecolor": "#ffffffc8", "edgecolor": "none", "pad": 2.0}
    axes.text(0.97, 0.965, "\n".join(lines), transform=axes.transAxes, bbox=box, **look)


def _shown_window(site: Site) -> Window:
    """Return the rectangle [m] that holds what is known of the site."""
    if site.survey is None:
        side_m = math.sqrt(site.area_m2)
        return Window(-0.02 * side_m, 1.02 * side_m, -0.02 * side_m, 1.02 * side_m)
    grid = site.survey.environment.grid
    return window_of(grid, known_part(grid), np.empty((0, 2)))


def _draw_arrivals(axes: Any, trial: Trial, site: Site, end_s: float, colours: Any) -> None:
    """Draw all places where an artefact appeared, those until `end_s` in their time's colour."""
    window = _shown_window(site)
    extent = (window.left, window.right, window.bottom, window.top)
    if site.survey is not None:
        axes.imshow(_map_image(site.survey, window), extent=extent, zorder=0)
    else:
        axes.set_facecolor(hex_of(mixed(TINT, _MOST_TINT)))
    axes.set(xlim=extent[:2], ylim=extent[2:], aspect="equal", anchor="N")
    early = trial.placed_s <= end_s
    dots = {"ms": 2.4, "color": "#8b97a3", "alpha": 0.55, "mew": 0}
    axes.plot(*trial.points_m.T, ".", zorder=2, **dots)
    look = {"s": 26, "edgecolors": "white", "linewidths": 0.6}
    points = trial.points_m[early].T
    axes.scatter(*points, c=colours(trial.placed_s[early] / end_s), zorder=3, **look)
    whose = "the first of each group" if trial.chain.is_grouped else "all that appeared"
    count = f"[m]   {counted(len(trial.points_m), 'place')}, of {whose}"
    name_axes(axes, "arrivals in space", f"{count}; in colour: in the time shown")
    axes.spines[:].set_visible(True)
    axes.spines[:].set_color(EDGE_HEX)
    unit_s, name = time_unit(end_s, _LEAST_UNITS)
    bar = axes.inset_axes((1.015, 0.0, 0.02, 1.0))
    draw_colour_bar(bar, colours, (0.0, end_s / unit_s), f"[{name}]")


def _map_image(survey: Survey, window: Window) -> npt.NDArray[np.uint8]:
    """Return the map of a window, its region tinted as strongly as its weight."""
    grid, region = survey.environment.grid, survey.region
    part = known_part(grid)
    height, width = part.cells.shape
    weight = region.mask if region.weight is None else region.weight
    cut = weight[part.row0 : part.row0 + height, part.col0 : part.col0 + width]
    strength = cut.astype(np.float64)
    tint = strength * (_MOST_TINT / max(float(strength.max(initial=0.0)), 1e-9))
    longest_px = _HEIGHTS_IN[0] * _PANEL_PX_PER_IN
    px_per_m = longest_px / max(window.height_m, window.width_m / _WIDEST)
    return map_image(grid, window, px_per_m, tint)
