"""What `are fit` says and writes: tables, parameters that node and replay take, and the record."""

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import yaml

from are_ros.fit.observed import ObservedRows, RowSpace
from are_ros.population.catalogue import Catalogue
from are_ros.population.mixture import GoodnessOfFit
from are_ros.population.mixture_fit import MixtureFit, Stop
from are_ros.wording import aligned, counted, section
from are_ros.yaml_text import Dumper

PARAMETERS: Final = "fitted.yaml"
RECORD: Final = "fit.json"
PICTURE: Final = "fit.png"
RESULTS: Final = (PARAMETERS, RECORD, PICTURE)

_RECORDED_STEPS: Final = 200
_UNLIKELY: Final = 0.01
"""Below this p-value a fit is said to be a bad one."""


@dataclass(frozen=True, eq=False)
class FitOutcome:
    """The observed rows, the fits that were made (1 to m components), and the one chosen.

    `source` names the input. `catalogue_file` is that of a catalogue which is not the shipped one,
    `seed` that of the random starts.
    """

    source: str
    observed: ObservedRows
    space: RowSpace
    fits: tuple[MixtureFit, ...]
    chosen: MixtureFit
    is_by_bic: bool
    seed: int
    catalogue_file: Path | None

    @cached_property
    def goodness(self) -> GoodnessOfFit | None:
        """How well the chosen mixture explains the rows, None where they are too few to tell."""
        return GoodnessOfFit.of(self.observed.counts, self.chosen.law)


def outcome_lines(outcome: FitOutcome) -> list[str]:
    """Return what a person wants to know of a fit, as aligned lines of text."""
    chosen, space = outcome.chosen, outcome.space
    distinct = int(np.count_nonzero(outcome.observed.counts))
    head = f"{chosen.samples:,} rows in {outcome.source}: {distinct} different ones"
    how = f"n = {chosen.components}, {'chosen by BIC' if outcome.is_by_bic else 'as given'}"
    lines = [f"{head} of {space.rows}", *outcome.observed.notes, ""]
    lines += section(f"Mixture ({how})", _component_lines(chosen, space.catalogue))
    told = cautions(chosen, outcome.goodness)
    lines += [*told, ""] if told else []
    if space.catalogue is not None:
        lines += section("Classes", _class_lines(outcome, space.catalogue))
    if outcome.is_by_bic:
        lines += section("Number of components", _bic_lines(outcome))
    return [*lines, _goodness_line(outcome), *_search_lines(chosen)]


def cautions(fit: MixtureFit, goodness: GoodnessOfFit | None) -> list[str]:
    """Return a sentence for whatever about a fit must not be overlooked."""
    numbers = [f"{rate:.4g}" for rate in fit.law.rates]
    highest = [number for number, at in zip(numbers, fit.at_highest, strict=True) if at]
    lowest = [number for number, at in zip(numbers, fit.at_lowest, strict=True) if at]
    rows = counted(len(fit.law.probabilities()), "row")
    sentences = []
    if highest:
        what = f"rate {', '.join(highest)} lies at its bound: a higher one would keep less than "
        sentences.append(f"{what}half of its mass on the {rows}")
    if lowest:
        sentences.append("a rate lies at its lower bound: that component gives row 0 only")
    if fit.components > 1 and np.isnan(fit.precision.rate_errors[_free(fit)]).any():
        what = "no standard errors: components coincide, or the rows do not tell them apart"
        sentences.append(f"{what}; fewer may do")
    if fit.searches[0].stop is Stop.LIMIT:
        sentences.append(f"the search did not end by itself: {fit.searches[0].stop.value}")
    if goodness is not None and goodness.most_p < _UNLIKELY:
        what = "such rows hardly come from this mixture"
        sentences.append(f"{what} ({_p_text(goodness)}): {PICTURE} shows where they differ")
    return sentences


def fitted_yaml(outcome: FitOutcome) -> str:
    """Return the text of a parameter file with the mixture, for node and replay (--params)."""
    chosen = outcome.chosen
    mixture = {"weights": chosen.law.weights.tolist(), "rates": chosen.law.rates.tolist()}
    values: dict[str, Any] = {"mixture": mixture}
    if outcome.catalogue_file is not None:
        values = {"catalogue": str(outcome.catalogue_file.resolve()), **values}
    content = {"ar_builder": {"ros__parameters": values}}
    head = (
        f"# The Poisson mixture (Eq. 1) most likely for {chosen.samples} observed rows, by are fit"
        f"\n# (n = {chosen.components}, log-likelihood per sample "
        f"{chosen.log_likelihood_per_sample:.6f}). Made for a catalogue of {outcome.space.rows} "
        "rows.\n"
    )
    return head + yaml.dump(
        content, Dumper=Dumper, sort_keys=False, default_flow_style=None, width=10_000
    )


def record_content(outcome: FitOutcome) -> dict[str, Any]:
    """Return the record of a fit, for fit.json: numbers, where they come from, how it converged."""
    chosen = outcome.chosen
    return {
        "input": {
            "source": outcome.source,
            "notes": list(outcome.observed.notes),
            "rows": outcome.space.rows,
            "samples": chosen.samples,
            "counts": outcome.observed.counts.tolist(),
        },
        "mixture": {
            "components": _component_content(chosen),
            "log_likelihood": chosen.log_likelihood,
            "log_likelihood_per_sample": chosen.log_likelihood_per_sample,
            "bic": chosen.bic,
            "chosen_by": "bic" if outcome.is_by_bic else "user",
            "probabilities": chosen.law.probabilities().tolist(),
            "classes": _class_content(outcome),
            "goodness": None if outcome.goodness is None else outcome.goodness._asdict(),
            "cautions": cautions(chosen, outcome.goodness),
        },
        "convergence": {
            "seed": outcome.seed,
            "searches": [
                {
                    "start": search.start,
                    "steps": search.steps,
                    "log_likelihood_per_sample": search.log_likelihood,
                    "stop": search.stop.value,
                }
                for search in chosen.searches
            ],
            "log_likelihood_per_sample": _thinned(chosen.trace),
        },
        "fits": [
            {
                "components": fit.components,
                "log_likelihood_per_sample": fit.log_likelihood_per_sample,
                "bic": fit.bic,
                "weights": fit.law.weights.tolist(),
                "rates": fit.law.rates.tolist(),
            }
            for fit in outcome.fits
        ],
    }


def _free(fit: MixtureFit) -> Any:
    """Return which components have weight and a rate that could move."""
    return (fit.law.weights > 1e-6) & ~fit.at_highest & ~fit.at_lowest


def _component_lines(fit: MixtureFit, catalogue: Catalogue | None) -> list[str]:
    errors = fit.precision
    table = [("weight pi", "", "rate lambda", "", "mostly" if catalogue else "")]
    for i in range(fit.components):
        weight, rate = fit.law.weights[i], fit.law.rates[i]
        mostly = _mostly(fit.law.component_probabilities()[i], catalogue) if catalogue else ""
        pair = (errors.weight_errors[i], errors.rate_errors[i])
        cells = (f"{weight:.4f}", _error_text(pair[0]), f"{rate:.4g}", _error_text(pair[1]), mostly)
        table.append(cells)
    return aligned(table, numbers=(0, 2))


def _mostly(probabilities: Any, catalogue: Catalogue) -> str:
    by_class = catalogue.class_probabilities(probabilities)
    best = int(np.argmax(by_class))
    return f"{catalogue.class_names[best]} ({100.0 * by_class[best]:.1f} %)"


def _error_text(error: float) -> str:
    return "" if math.isnan(error) else f"± {error:.2g}"


def _class_lines(outcome: FitOutcome, catalogue: Catalogue) -> list[str]:
    counts = outcome.observed.counts
    observed = catalogue.class_probabilities(counts / counts.sum())
    fitted = catalogue.class_probabilities(outcome.chosen.law.probabilities())
    table = [("class", "fitted", "observed")]
    table += [
        (name, f"{100.0 * law:.1f} %", f"{100.0 * seen:.1f} %")
        for name, law, seen in zip(catalogue.class_names, fitted, observed, strict=True)
    ]
    return aligned(table, numbers=(1, 2))


def _bic_lines(outcome: FitOutcome) -> list[str]:
    least = outcome.chosen.bic
    table = [("n", "log-likelihood per sample", "BIC", "above the least")]
    table += [
        (
            str(fit.components),
            f"{fit.log_likelihood_per_sample:.6f}",
            f"{fit.bic:.1f}",
            f"{fit.bic - least:.1f}",
        )
        for fit in outcome.fits
    ]
    return aligned(table, numbers=(0, 1, 2, 3))


def _goodness_line(outcome: FitOutcome) -> str:
    if outcome.goodness is None:
        return "too few rows to tell how well the mixture explains them"
    found = outcome.goodness
    cells = f"chi-square {found.chi_square:.4g} in {found.cells} cells of neighbouring rows"
    return f"goodness of fit: {cells}, {_p_text(found)}"


def _p_text(goodness: GoodnessOfFit) -> str:
    low, high = f"{goodness.least_p:.2g}", f"{goodness.most_p:.2g}"
    return f"p {low}" if low == high else f"p {low} to {high}"


def _search_lines(fit: MixtureFit) -> list[str]:
    best, others = fit.searches[0], len(fit.searches) - 1
    steps = f"{best.steps} steps of EM from the start '{best.start}'"
    beside = f", the best of {others + 1} starts" if others else ""
    return [
        f"log-likelihood per sample {fit.log_likelihood_per_sample:.6f}, BIC {fit.bic:.1f}",
        f"{steps}{beside}; it ended when {best.stop.value}"
        if best.stop is Stop.CONVERGED
        else f"{steps}{beside}; {best.stop.value}",
    ]


def _component_content(fit: MixtureFit) -> list[dict[str, Any]]:
    return [
        {
            "weight": float(fit.law.weights[i]),
            "weight_error": _number(fit.precision.weight_errors[i]),
            "rate": float(fit.law.rates[i]),
            "rate_error": _number(fit.precision.rate_errors[i]),
            "is_at_bound": bool(fit.at_highest[i] or fit.at_lowest[i]),
        }
        for i in range(fit.components)
    ]


def _class_content(outcome: FitOutcome) -> dict[str, float]:
    catalogue = outcome.space.catalogue
    if catalogue is None:
        return {}
    shares = catalogue.class_probabilities(outcome.chosen.law.probabilities())
    return dict(zip(catalogue.class_names, shares.tolist(), strict=True))


def _thinned(trace: npt.NDArray[np.float64]) -> list[list[float]]:
    """Return the numbers of steps, ever farther apart, and the log-likelihood after each."""
    steps = np.unique(np.geomspace(1, len(trace), _RECORDED_STEPS).astype(np.int64)) - 1
    return [[int(step), float(trace[step])] for step in steps]


def _number(value: float) -> float | None:
    """Return a number that JSON has: none for nan."""
    return None if math.isnan(value) else float(value)
