"""Where the search for a mixture begins: the same places for the same histogram and seed."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


class Start(NamedTuple):
    """Weights and rates (n,) to begin with, and what they rest on, in a word or two."""

    name: str
    weights: Floats
    rates: Floats


def starts_for(
    counts: Floats,
    components: int,
    limits: tuple[float, float],
    generator: np.random.Generator,
    random_starts: int,
) -> Iterator[Start]:
    """Yield a start at the quantiles of the histogram (rows,), and then random ones."""
    weights = np.full(components, 1.0 / components)
    yield Start("quantiles", weights, np.clip(quantile_means(counts, components), *limits))
    for number in range(random_starts):
        rates = np.clip(_spread_rows(counts, components, generator), *limits)
        yield Start(f"random {number + 1}", generator.dirichlet(np.full(components, 2.0)), rates)


def grown(weights: Floats, rates: Floats, rate: float) -> Start:
    """Return a mixture with one component more, of the rate that gains fastest."""
    share = 1.0 / (len(weights) + 1)
    return Start("grown", np.append(weights * (1.0 - share), share), np.append(rates, rate))


def quantile_means(counts: Floats, parts: int) -> Floats:
    """Return the means of so many parts, equal in number, of the ordered samples."""
    edges = np.linspace(0.0, counts.sum(), parts + 1)
    below = np.concatenate(((0.0,), np.cumsum(counts)))
    moments = np.concatenate(((0.0,), np.cumsum(counts * np.arange(len(counts)))))
    # Samples of one row may belong to two parts: the sum of rows is then divided in proportion.
    reached = np.interp(edges, below, moments)
    # Coinciding components would stay together for ever.
    apart = 1e-3 * np.arange(parts)
    means: Floats = np.maximum(np.diff(reached) / np.diff(edges), 0.1) + apart
    return means


def _spread_rows(counts: Floats, components: int, generator: np.random.Generator) -> Floats:
    """Draw rows far from each other, each by its share and its squared distance to the others.

    Distances are between square roots, where every Poisson law is equally wide (k-means++).
    """
    roots = np.sqrt(np.arange(len(counts)) + 0.25)
    odds, chosen = counts.copy(), []
    nearest = np.full(len(counts), np.inf)
    for _ in range(components):
        chosen.append(int(generator.choice(len(counts), p=odds / odds.sum())))
        nearest = np.minimum(nearest, (roots - roots[chosen[-1]]) ** 2)
        odds = counts * nearest
    return np.maximum(np.array(chosen, dtype=np.float64), 0.1)
