"""Plots by matplotlib: how they look, and fit.png of the rows of a fit (the paper's Fig. 2)."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.catalogue import Catalogue
from are_ros.artefacts.mixture_fit import MixtureFit
from are_ros.draw.palette import BAR, EDGE, FAINT_INK, INK, SERIES, class_colours, hex_of

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


def write_head(figure: Any, left_in: float, title: str, subtitle: Sequence[str]) -> None:
    """Write a title and, in parts, what is said below it; empty parts are left out."""
    width, height = figure.get_size_inches()
    left, text = left_in / width, "   ·   ".join(part for part in subtitle if part)
    figure.text(left, 1.0 - 0.16 / height, title, size=15, weight="bold", color=INK_HEX, va="top")
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


def draw_fit(
    fits: Sequence[MixtureFit],
    chosen: MixtureFit,
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
    chosen: MixtureFit,
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
            _name_block(axes, 0.5 * (left + right), name, colour)


def _name_block(axes: Any, middle: float, name: str, colour: str) -> None:
    place = axes.get_xaxis_transform()
    style = {"color": colour, "size": 8, "ha": "center", "va": "bottom", "transform": place}
    axes.text(middle, 1.01, name, **style)


def _draw_climb(axes: Any, chosen: MixtureFit) -> None:
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


def _draw_bic(axes: Any, fits: Sequence[MixtureFit], chosen: MixtureFit) -> None:
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
