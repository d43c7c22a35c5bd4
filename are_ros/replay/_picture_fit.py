"""fit.png: observed rows, the mixture and its components (the paper's Fig. 2), and the climb."""

import math
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.catalogue import Catalogue
from are_ros.replay._picture_artefacts import class_colours
from are_ros.replay.fit_results import FitOutcome

_SIZE_IN: Final = (11.5, 5.2)
_DPI: Final = 120
_INK: Final = "#23282e"
_FAINT_INK: Final = "#66707a"
_BARS: Final = "#c9d1d9"
_COMPONENTS: Final = ("#e8590c", "#0b7285", "#5c940d", "#c2255c", "#1864ab", "#862e9c", "#5f3d11")
_SMALLEST_GAP: Final = 1e-12
_STRAIGHT_TO: Final = 10.0
_MOST_TICKS: Final = 7
_NAMED_SHARE: Final = 0.05
"""A class's block of rows is named if it is at least so wide, as a share of all rows."""


def draw_fit(outcome: FitOutcome, path: Path) -> None:
    """Write the picture of a fit as PNG; the same fit gives the same bytes.

    Settings of matplotlib in force change nothing.
    """
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update({"font.family": "DejaVu Sans", "font.size": 9})
        figure = _figure(outcome)
        figure.savefig(path, format="png", metadata={"Software": None})


def _figure(outcome: FitOutcome) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE_IN, dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    fit = outcome.chosen
    word = "component" if fit.components == 1 else "components"
    title = f"Poisson mixture of {fit.components} {word}, fitted to {fit.samples:,} rows"
    figure.text(0.055, 0.955, title, size=15, weight="bold", color=_INK, va="center")
    subtitle = f"{outcome.source}   ·   log-likelihood per sample "
    subtitle += f"{fit.log_likelihood_per_sample:.5f}   ·   BIC {fit.bic:.1f}"
    figure.text(0.055, 0.895, subtitle, size=9, color=_FAINT_INK, va="center")
    _draw_laws(figure.add_axes((0.055, 0.105, 0.58, 0.73)), outcome)
    if len(outcome.fits) > 1 and outcome.is_by_bic:
        _draw_climb(figure.add_axes((0.71, 0.55, 0.27, 0.285)), outcome)
        _draw_bic(figure.add_axes((0.71, 0.105, 0.27, 0.285)), outcome)
    else:
        _draw_climb(figure.add_axes((0.71, 0.105, 0.27, 0.73)), outcome)
    return figure


def _draw_laws(axes: Any, outcome: FitOutcome) -> None:
    """Draw the shares of the rows as bars, the mixture over them, and each component."""
    counts, law = outcome.observed.counts, outcome.chosen.law
    rows = np.arange(len(counts))
    shares = counts / counts.sum()
    probabilities = law.probabilities()
    top = 1.12 * float(max(shares.max(), probabilities.max()))
    axes.set(xlim=(-0.7, len(rows) - 0.3), ylim=(0.0, top))
    if outcome.space.catalogue is not None:
        _draw_classes(axes, outcome.space.catalogue)
    axes.bar(rows, shares, width=0.86, color=_BARS, label="observed", zorder=2)
    for i, component in enumerate(law.component_probabilities()):
        text = f"{law.weights[i]:.3f} Poisson({law.rates[i]:.4g})"
        colour = _COMPONENTS[i % len(_COMPONENTS)]
        axes.plot(rows, law.weights[i] * component, color=colour, lw=1.3, label=text, zorder=3)
    style = {"color": _INK, "lw": 1.6, "marker": "o", "ms": 2.8, "zorder": 4}
    axes.plot(rows, probabilities, label="mixture", **style)
    _label(axes, "row of the catalogue", "probability")
    axes.legend(frameon=False, fontsize=8, labelcolor=_INK, loc="upper right")


def _draw_classes(axes: Any, catalogue: Catalogue) -> None:
    """Tint the block of rows of each class, and name it along the upper edge."""
    colours = class_colours(catalogue.class_names)
    for name in catalogue.class_names:
        rows = [row.index for row in catalogue.rows if row.class_name == name]
        left, right = rows[0] - 0.5, rows[-1] + 0.5
        axes.axvspan(left, right, color=colours[name], alpha=0.07, lw=0, zorder=0)
        if right - left >= _NAMED_SHARE * len(catalogue.rows):
            _name_block(axes, 0.5 * (left + right), name, colours[name])


def _name_block(axes: Any, middle: float, name: str, colour: str) -> None:
    place = axes.get_xaxis_transform()
    style = {"color": colour, "size": 8, "ha": "center", "va": "bottom", "transform": place}
    axes.text(middle, 1.01, name, **style)


def _draw_climb(axes: Any, outcome: FitOutcome) -> None:
    """Draw how far below its end the log-likelihood was at each point of the best climb.

    It ends where nothing was gained any more; the name of the axis says how many there were.
    """
    from matplotlib.ticker import MaxNLocator

    trace = outcome.chosen.trace
    below = np.maximum(trace[-1] - trace, _SMALLEST_GAP)
    shown = climb_length(below)
    axes.semilogy(np.arange(1, shown + 1), below[:shown], color=_INK, lw=1.3)
    if shown > 100:
        axes.set_xscale("log")
    else:
        axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    axes.set_ylim(0.5 * _SMALLEST_GAP, 3.0 * max(float(below.max()), 10.0 * _SMALLEST_GAP))
    _label(axes, f"point of the search, of {len(below)}", "below the end, per sample")
    axes.set_title("convergence", size=9, color=_INK, loc="left")


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


def _draw_bic(axes: Any, outcome: FitOutcome) -> None:
    """Draw by how much the BIC of each number of components lies above the least."""
    numbers = [fit.components for fit in outcome.fits]
    above = [fit.bic - outcome.chosen.bic for fit in outcome.fits]
    axes.plot(numbers, above, color=_INK, lw=1.0, marker="o", ms=3.5)
    axes.plot([outcome.chosen.components], [0.0], "o", color=_COMPONENTS[0], ms=7.0)
    if max(above) > _STRAIGHT_TO:
        axes.set_yscale("symlog", linthresh=_STRAIGHT_TO)
        ticks = bic_ticks(max(above))
        axes.set_yticks(ticks, [f"{tick:,}" for tick in ticks])
    axes.set_xticks(numbers)
    _label(axes, "components", "BIC above the least")
    axes.set_title("number of components", size=9, color=_INK, loc="left")


def _label(axes: Any, across: str, up: str) -> None:
    axes.set_xlabel(across, color=_INK)
    axes.set_ylabel(up, color=_INK)
    axes.tick_params(colors=_FAINT_INK, labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#b9c0c7")
