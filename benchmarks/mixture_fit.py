"""EM for the Poisson mixture of Eq. 1: on the histogram, against numpy on each sample.

The paper's example: rates 15, 7, 3, 21, 5 on 42 rows. The peers take the same steps from the same
start and end at the same point to 1e-9: one has a responsibility for each sample, one works on the
histogram in numpy. Then the whole search: how long it takes. Run:
OMP_NUM_THREADS=1 python benchmarks/mixture_fit.py [rounds [samples [steps]]]
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln

from are_ros.population.mixture import TruncatedPoissonMixture
from are_ros.population.mixture_fit import climb, count_rows, fit_by_bic, fit_mixture, rate_limits

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

ROWS = 42
WEIGHTS, RATES = (0.7, 0.12, 0.08, 0.02, 0.08), (15.0, 7.0, 3.0, 21.0, 5.0)
START = np.array([1.0, 4.0, 8.0, 16.0, 25.0])
LOG_FACTORIALS = gammaln(np.arange(ROWS) + 1.0)
Point = tuple[Floats, Floats]


def drawn(count: int) -> Ints:
    """Return samples of the paper's mixture."""
    law = TruncatedPoissonMixture(WEIGHTS, RATES, ROWS).probabilities()
    return np.asarray(np.random.default_rng(1).choice(ROWS, count, p=law / law.sum()))


def solved(means: Floats, rates: Floats) -> Floats:
    """Return the rates of conditional means, by Newton's method from the rates before."""
    k = np.arange(ROWS)
    for _ in range(50):
        masses = np.exp(np.outer(np.log(rates), k) - LOG_FACTORIALS)
        masses /= masses.sum(axis=1, keepdims=True)
        found = masses @ k
        step = (means - found) * rates / (masses @ k**2 - found**2)
        rates = rates + step
        if np.abs(step / rates).max() < 1e-14:
            break
    return rates


def by_sample(samples: Ints, steps: int) -> Point:
    """Take steps of EM with a responsibility for each sample."""
    weights, rates = np.full(len(START), 1.0 / len(START)), START
    values, factorials = samples.astype(np.float64), LOG_FACTORIALS[samples]
    rows = np.arange(ROWS)
    for _ in range(steps):
        kept = np.exp(np.outer(np.log(rates), rows) - rates[:, None] - LOG_FACTORIALS).sum(axis=1)
        heads = np.log(weights / kept) - rates
        shares = np.exp(np.outer(np.log(rates), values) + heads[:, None] - factorials)
        shares /= shares.sum(axis=0)
        totals = shares.sum(axis=1)
        weights, rates = totals / len(samples), solved(shares @ values / totals, rates)
    return weights, rates


def by_histogram(counts: Ints, steps: int) -> Point:
    """Take steps of EM on the histogram, in numpy."""
    weights, rates, rows = np.full(len(START), 1.0 / len(START)), START, np.arange(ROWS)
    for _ in range(steps):
        laws = np.exp(np.outer(np.log(rates), rows) - rates[:, None] - LOG_FACTORIALS)
        shares = weights[:, None] * laws / laws.sum(axis=1, keepdims=True)
        shares *= counts / shares.sum(axis=0)
        totals = shares.sum(axis=1)
        weights, rates = totals / counts.sum(), solved(shares @ rows / totals, rates)
    return weights, rates


def ours(samples: Ints, steps: int) -> Point:
    """Take steps of EM by the kernel, the making of the histogram included."""
    counts = count_rows(samples, ROWS).astype(np.float64)
    point = start()
    climb(counts, LOG_FACTORIALS, rate_limits(ROWS), point, np.empty(steps + 1), -np.inf)
    return np.exp(point[: len(START)]), np.exp(point[len(START) :])


def start() -> Floats:
    """Return the point where all begin."""
    return np.concatenate((np.full(len(START), -np.log(len(START))), np.log(START)))


def milliseconds(action: Callable[[], object], calls: int = 1) -> float:
    """Return the CPU time of one call [ms], the median of several: other programs do not count."""
    took = []
    for _ in range(calls):
        begun = time.process_time()
        action()
        took.append(1e3 * (time.process_time() - begun))
    return float(np.median(took))


def compare(samples: Ints, rounds: int, steps: int) -> None:
    """Print medians of interleaved rounds; all must end at the same point."""
    counts = count_rows(samples, ROWS)
    points = [by_sample(samples, steps), by_histogram(counts, steps), ours(samples, steps)]
    off = max(
        float(np.abs(a - b).max())
        for one in points[:2]
        for a, b in zip(one, points[2], strict=True)
    )
    if off > 1e-9:
        raise SystemExit(f"the results differ by {off:.1e}")
    # A call of the kernel is so short that another process's turn would multiply it.
    actions = (
        (lambda: by_sample(samples, steps), 1),
        (lambda: by_histogram(counts, steps), 3),
        (lambda: ours(samples, steps), 21),
    )
    peer, histogram, kernel = np.median(
        [[milliseconds(*action) for action in actions] for _ in range(rounds)], axis=0
    )
    print(f"{len(samples)} samples, {steps} steps of EM, ends differ by at most {off:.1e}")
    print(f"  numpy, each sample   {peer:10.1f} ms")
    print(f"  numpy, histogram     {histogram:10.1f} ms")
    print(f"  kernel, histogram    {kernel:10.2f} ms")
    print(f"  {peer / kernel:.0f}x each sample, {histogram / kernel:.1f}x the histogram in numpy")


def search(counts: Ints) -> None:
    """Print how long whole searches take."""
    print(f"fit of 5 components, 10 starts: {milliseconds(lambda: fit_mixture(counts, 5)):.0f} ms")
    print(f"fits of 1 to 8 components: {milliseconds(lambda: fit_by_bic(counts, 8)):.0f} ms")


def main(rounds: int, count: int, steps: int) -> None:
    """Compare, then search."""
    samples = drawn(count)
    ours(samples, 10)
    compare(samples, rounds, steps)
    search(count_rows(samples, ROWS))
    for number in (100_000, 1_000_000, 10_000_000):
        many = drawn(number)
        counts = count_rows(many, ROWS)
        counting = milliseconds(lambda: count_rows(many, ROWS))  # noqa: B023
        fitting = milliseconds(lambda: fit_mixture(counts, 3))  # noqa: B023
        print(
            f"{number:10d} samples: counted in {counting:.1f} ms, 3 components in {fitting:.1f} ms"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, usual in (("rounds", 5), ("samples", 100_000), ("steps", 200)):
        parser.add_argument(name, nargs="?", type=int, default=usual)
    given = parser.parse_args()
    main(given.rounds, given.samples, given.steps)
