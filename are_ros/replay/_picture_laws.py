"""The laws of a population in its picture: N(t), waiting times, lives and rows, with densities."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.catalogue import Catalogue
from are_ros.description.birth_death import BirthDeath
from are_ros.description.population_trial import Trial
from are_ros.parameters.choices import Departures

INK: Final = "#23282e"
FAINT_INK: Final = "#66707a"
_BAR: Final = "#b9c8d8"
_PATH: Final = "#2f5d8a"
_LAW: Final = "#d1495b"
_BAND: Final = "#e9eef3"
_BINS: Final = 40
_QUANTILE: Final = 0.995
_SEPARATE_BARS: Final = 40
_CUT_FROM: Final = 0.001
_SHOWN_CORRELATIONS: Final = 25.0
_SHOWN_GROUPS: Final = (60.0, 250.0)

Floats = npt.NDArray[np.float64]


def shown_s(trial: Trial) -> float:
    """Return how long the beginning of a trial is that is shown [s]."""
    chain = trial.chain
    least_s, most_s = (groups / chain.groups_per_s for groups in _SHOWN_GROUPS)
    wanted_s = min(max(_SHOWN_CORRELATIONS * chain.correlation_s, least_s), most_s)
    return min(wanted_s, trial.end_s)


def time_unit(span_s: float) -> tuple[float, str]:
    """Return the length [s] and the name of the unit in which a span reads well."""
    for length_s, name in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if span_s >= 4.0 * length_s:
            return length_s, name
    return 1.0, "s"


def draw_path(axes: Any, trial: Trial, end_s: float, colours: Any) -> None:
    """Draw N(t) from the beginning, its stationary mean and band, and a tick for each arrival."""
    from matplotlib.ticker import MaxNLocator

    unit_s, name = time_unit(end_s)
    chain, (low, high) = trial.chain, trial.chain.band()
    shown = trial.changes_s <= end_s
    times = np.append(trial.changes_s[shown], end_s) / unit_s
    levels = np.append(trial.alive[shown], trial.alive[shown][-1])
    axes.axhspan(low, high, color=_BAND, lw=0, label=f"nine tenths of the time: {low} to {high}")
    axes.axhline(chain.mean, color=_LAW, lw=1.4, label=f"stationary mean {chain.mean:.3g}")
    axes.step(times, levels, where="post", color=_PATH, lw=1.1, label="alive")
    offers_s = trial.offers_s[trial.offers_s <= end_s]
    top = max(float(levels.max()), high) * 1.24 + 0.6
    tick = 0.035 * top
    axes.vlines(
        offers_s / unit_s, -1.6 * tick, -0.4 * tick, colors=colours(offers_s / end_s), lw=1.3
    )
    axes.set(
        xlim=(0.0, end_s / unit_s), ylim=(-2.1 * tick, top), xlabel=f"time [{name}]", ylabel="alive"
    )
    axes.set_title("N(t): how many are alive, and when they arrive", **_title_look())
    axes.legend(loc="upper left", ncol=3, frameon=False, fontsize=8.5, labelcolor=INK)
    axes.yaxis.set_major_locator(MaxNLocator(8, integer=True))
    _tidy(axes)


def draw_shares(axes: Any, trial: Trial) -> None:
    """Draw which share of the whole time N(t) was at each level, beside the stationary law."""
    from matplotlib.ticker import MaxNLocator

    law, levels = trial.chain.law, np.arange(len(trial.chain.law))
    shares = trial.time_shares()
    likely = np.flatnonzero((law > 2e-3 * law.max()) | (shares > 2e-3))
    shown = levels[likely[0] : likely[-1] + 1]
    is_short = len(shown) <= _SEPARATE_BARS
    if is_short:
        axes.barh(shown, shares[shown], height=0.86, color=_BAR)
    else:
        edges = np.append(shown, shown[-1] + 1) - 0.5
        axes.stairs(shares[shown], edges, orientation="horizontal", fill=True, color=_BAR)
    dots = "o-" if is_short else "-"
    axes.plot(law[shown], shown, dots, color=_LAW, ms=3.2, lw=1.2)
    axes.set_xlim(0.0, 1.2 * float(max(law.max(), shares.max())))
    _write(axes, [_law_name(trial.chain)])
    axes.set_title("share of the time", **_title_look())
    axes.set_xlabel("share")
    axes.xaxis.set_major_locator(MaxNLocator(4))
    _tidy(axes)
    axes.tick_params(labelleft=False)


def draw_waits(axes: Any, trial: Trial) -> None:
    """Draw the waiting times between arrivals and their exponential density (the Fig. 3a)."""
    law_mean_s, mean_s = 1.0 / trial.chain.groups_per_s, float(trial.waits_s.mean())
    reach_s, unit_s, name = _reach(trial.waits_s)
    times_s = np.linspace(0.0, reach_s, 200)
    _draw_density(axes, trial.waits_s, times_s, np.exp(-times_s / law_mean_s) / law_mean_s, unit_s)
    noun = "groups" if trial.chain.is_grouped else "arrivals"
    count = f"{len(trial.waits_s)} {noun}, mean {mean_s / unit_s:.3g} {name}"
    _write(axes, [count])
    axes.set_title(f"waiting times between {noun}", **_title_look())
    axes.set(xlabel=f"time [{name}]", ylabel=f"density [1/{name}]")


def draw_lives(axes: Any, trial: Trial) -> None:
    """Draw the lives and their density: exponential, or that of who is drawn at random."""
    chain, lives_s = trial.chain, trial.lives_s
    axes.set_title("lives", **_title_look())
    if not len(lives_s):
        _write(axes, ["nobody who came has left yet"])
        _tidy(axes)
        return
    reach_s, unit_s, name = _reach(lives_s)
    times_s = np.linspace(0.0, reach_s, 201)
    density = -np.diff(chain.survival(reach_s, len(times_s))) / np.diff(times_s)
    middles_s = 0.5 * (times_s[1:] + times_s[:-1])
    _draw_density(axes, lives_s, middles_s, density, unit_s)
    lines = [
        f"{len(lives_s)} lives, mean {float(lives_s.mean()) / unit_s:.3g} {name},",
        "of who appeared in the first",
        "nine tenths of the time",
    ]
    if chain.departures is not Departures.INDEPENDENT:
        lines.append("who leaves is drawn at random")
    _write(axes, lines)
    axes.set(xlabel=f"time [{name}]", ylabel=f"density [1/{name}]")


def draw_rows(
    axes: Any,
    trial: Trial,
    catalogue: Catalogue,
    probabilities: Floats,
    colours: Mapping[str, str],
) -> None:
    """Draw how often each row of the catalogue was drawn, in its class's colour, and Eq. 1."""
    counted = np.bincount(trial.rows, minlength=len(probabilities)) / len(trial.rows)
    rows = np.arange(len(probabilities))
    for name in catalogue.class_names:
        own = np.array([row.index for row in catalogue.rows if row.class_name == name])
        axes.bar(own, counted[own], width=0.86, color=colours[name], alpha=0.55, label=name)
    axes.plot(rows, probabilities, "o-", color=INK, ms=2.4, lw=0.9)
    top = 1.3 * float(max(counted.max(), probabilities.max()))
    axes.set(xlim=(-0.8, len(rows) - 0.2), ylim=(0.0, top))
    _write(axes, [f"{len(trial.rows)} artefacts"])
    axes.set_title("rows of the catalogue, by Eq. 1", **_title_look())
    axes.legend(loc="center right", frameon=False, fontsize=8.5, labelcolor=INK, handlelength=1.0)
    axes.set(xlabel="row", ylabel="share")
    _tidy(axes)


def _draw_density(
    axes: Any, sample_s: Floats, times_s: Floats, density: Floats, unit_s: float
) -> None:
    reach_s = float(times_s[-1])
    edges_s = np.linspace(0.0, reach_s, _BINS + 1)
    counted = np.histogram(sample_s, edges_s)[0]
    heights = counted / (len(sample_s) * np.diff(edges_s))
    axes.stairs(heights * unit_s, edges_s / unit_s, fill=True, color=_BAR)
    axes.plot(times_s / unit_s, density * unit_s, color=_LAW, lw=1.5)
    top = 1.12 * unit_s * max(float(heights.max()), float(density.max()))
    axes.set(xlim=(0.0, reach_s / unit_s), ylim=(0.0, top))
    _tidy(axes)


def _reach(times_s: Floats) -> tuple[float, float, str]:
    """Return how far times are drawn [s], and their unit."""
    reach_s = float(np.quantile(times_s, _QUANTILE))
    return (reach_s, *time_unit(reach_s))


def _law_name(chain: BirthDeath) -> str:
    if chain.is_grouped:
        return "law of the batch chain"
    name = "Poisson" if chain.departures is Departures.INDEPENDENT else "geometric"
    cut = f", cut at {chain.max_alive}" if chain.law[-1] > _CUT_FROM else ""
    return f"{name}({chain.load:.3g}){cut}"


def _write(axes: Any, lines: list[str]) -> None:
    look = {"ha": "right", "va": "top", "fontsize": 8.5, "color": INK, "linespacing": 1.35}
    box = {"facecolor": "#ffffffc8", "edgecolor": "none", "pad": 2.0}
    axes.text(0.97, 0.965, "\n".join(lines), transform=axes.transAxes, bbox=box, **look)


def _title_look() -> dict[str, Any]:
    return {"fontsize": 10, "color": INK, "loc": "left", "weight": "bold", "pad": 6}


def _tidy(axes: Any) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#c3c9cf")
    axes.tick_params(labelsize=8.5, colors=FAINT_INK, length=3)
    for axis in (axes.xaxis, axes.yaxis):
        axis.label.set(size=8.5, color=FAINT_INK)
