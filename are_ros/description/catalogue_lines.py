"""Of which kind the artefacts are, and what they do: the mixture and the catalogue in figures."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from are_ros.artefacts.catalogue import Catalogue, CatalogueRow
from are_ros.artefacts.mixture import Numbers, TruncatedPoissonMixture
from are_ros.description._tables import aligned, section
from are_ros.wording import counted

_A_LINE: Final = 5


def mixture_lines(law: TruncatedPoissonMixture, catalogue: Catalogue) -> list[str]:
    """Return the components of Eq. 1: weights, rates, and the rows that each stands for."""
    components = [("component", "weight pi", "rate lambda", "rows", "mostly")]
    for i, of_rows in enumerate(law.component_probabilities()):
        by_class = catalogue.class_probabilities(of_rows)
        best = int(np.argmax(by_class))
        mostly = f"{catalogue.class_names[best]} ({percent(by_class[best])})"
        low, high = np.searchsorted(np.cumsum(of_rows), (0.05, 0.95)).tolist()
        weight, rate = f"{law.weights[i]:.3f}", f"{law.rates[i]:g}"
        components.append((str(i), weight, rate, f"{low} to {high}", mostly))
    return section("Mixture (Eq. 1)", aligned(components, numbers=(0, 1, 2)))


def class_lines(probabilities: Numbers, catalogue: Catalogue) -> list[str]:
    """Return the classes, likeliest first: their rows in numbers, and the likeliest of them."""
    by_class = catalogue.class_probabilities(probabilities).tolist()
    shares = dict(zip(catalogue.class_names, by_class, strict=True))
    lines = [("class", "probability", "rows", "length [m]", "speed [m/s]", "likeliest")]
    for name, share in sorted(shares.items(), key=lambda pair: -pair[1]):
        rows = [row for row in catalogue.rows if row.class_name == name]
        best = max(rows, key=lambda row: float(probabilities[row.index]))
        likeliest = f"{best.label} ({percent(probabilities[best.index])})"
        numbers = _range([row.index for row in rows], "{}")
        lengths_m = _range([row.size_m[0] for row in rows], "{:.2f}")
        speeds_mps = _range([row.motion.speed_mps for row in rows], "{:g}")
        lines.append((name, percent(share), numbers, lengths_m, speeds_mps, likeliest))
    title = f"Classes, of {counted(len(catalogue.rows), 'row')} in the catalogue"
    return section(title, aligned(lines, numbers=(1,)))


def behaviour_lines(probabilities: Numbers, catalogue: Catalogue, *, of_rows: bool) -> list[str]:
    """Return what artefacts do, and how likely: all, and each class.

    With `of_rows` also the rows of a class, where they differ.
    """
    rows = [("who", "probability", "behaviours")]
    rows += _habits("all", 1.0, _behaviours(catalogue.rows, probabilities))
    by_class = catalogue.class_probabilities(probabilities)
    for name, share in zip(catalogue.class_names, by_class.tolist(), strict=True):
        of_class = tuple(row for row in catalogue.rows if row.class_name == name)
        rows += _habits(name, share, _behaviours(of_class, probabilities))
        alike = _alike(of_class) if of_rows else []
        for group in alike if len(alike) > 1 else ():
            chance = float(probabilities[[row.index for row in group]].sum())
            rows += _habits(f"  {_span(group)}", chance, dict(group[0].behaviours))
    return section("Behaviours, one for each life", aligned(rows, numbers=(1,)))


def catalogue_lines(probabilities: Numbers, catalogue: Catalogue) -> list[str]:
    """Return the whole catalogue: row, label, class, size, speed and probability of each."""
    rows = [("row", "label", "class", "size [m]", "speed", "probability", "")]
    for row in catalogue.rows:
        size = " x ".join(f"{length:.2f}" for length in row.size_m)
        share, speed = percent(probabilities[row.index]), f"{row.motion.speed_mps:g} m/s"
        note = "for ever" if row.forever else ""
        rows.append((str(row.index), row.label, row.class_name, size, speed, share, note))
    return section(
        f"Catalogue ({counted(len(catalogue.rows), 'row')})", aligned(rows, numbers=(0, 3, 4, 5))
    )


def percent(share: float) -> str:
    """Return a share in per cent, with one digit."""
    number = 100.0 * share
    return f"{number:.1f} %" if number >= 0.05 or number == 0.0 else "< 0.1 %"


def _range(numbers: Sequence[float], layout: str) -> str:
    """Return the least and the greatest, one number where they are alike."""
    low, high = layout.format(min(numbers)), layout.format(max(numbers))
    return low if low == high else f"{low} to {high}"


def _behaviours(rows: tuple[CatalogueRow, ...], probabilities: Numbers) -> dict[str, float]:
    """Return the probability of each behaviour of one that is of these rows."""
    shares: dict[str, float] = {}
    for row in rows:
        for name, chance in row.behaviours.items():
            shares[name] = shares.get(name, 0.0) + float(probabilities[row.index]) * chance
    total = sum(shares.values())
    return {name: share / total for name, share in shares.items()} if total > 0.0 else {}


def _alike(rows: tuple[CatalogueRow, ...]) -> list[list[CatalogueRow]]:
    """Return the rows in runs of the same behaviours."""
    runs: list[list[CatalogueRow]] = []
    for row in rows:
        if runs and dict(runs[-1][-1].behaviours) == dict(row.behaviours):
            runs[-1].append(row)
        else:
            runs.append([row])
    return runs


def _span(rows: Sequence[CatalogueRow]) -> str:
    first, last = rows[0].index, rows[-1].index
    return f"row {first}" if first == last else f"rows {first} to {last}"


def _habits(who: str, chance: float, shares: Mapping[str, float]) -> list[tuple[str, str, str]]:
    """Return the lines of one entry: the behaviours, likeliest first, wrapped."""
    ordered = sorted(shares.items(), key=lambda pair: -pair[1])
    words = [f"{name} {percent(share)}" for name, share in ordered if share > 0.0]
    return [
        (
            who if i == 0 else "",
            percent(chance) if i == 0 else "",
            ", ".join(words[i : i + _A_LINE]),
        )
        for i in range(0, max(len(words), 1), _A_LINE)
    ]
