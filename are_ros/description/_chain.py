"""The birth-death chain on a stretch of levels as sparse matrices, and what they solve."""

from typing import Any

import numpy as np
import numpy.typing as npt

Numbers = npt.NDArray[np.float64]

_DENSE = 600
"""Up to so many levels the exponential of a step is computed once and applied again and again."""


def jumps_per_s(count: int, beyond_per_s: Numbers) -> Any:
    """Return the sparse rates (count, count) [1/s] of jumps up between neighbouring levels.

    `beyond_per_s[j]` is the rate of jumps by more than j; what would leave the stretch ends at its
    last level.
    """
    from scipy.sparse import csr_array, diags_array, hstack

    if count == 1:
        return csr_array((1, 1))
    reach = min(len(beyond_per_s), count - 1)
    by_exactly = -np.diff(np.append(beyond_per_s, 0.0))
    offsets = np.arange(1, reach + 1)
    inner = diags_array(by_exactly[:reach], offsets=offsets, shape=(count, count))
    last = np.zeros((count, 1))
    last[count - 1 - reach : count - 1, 0] = beyond_per_s[:reach][::-1]
    return csr_array(hstack((inner.tocsc()[:, :-1], last)))


def poisson_solution(jumps: Any, deaths_per_s: Numbers, rewards: Numbers, law: Numbers) -> Numbers:
    """Return h with Q h = -rewards and (law, h) = 0; the rewards have mean 0 under the law.

    Q is singular: its equation at the likeliest level follows from the others and is left out.
    """
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import spsolve

    falls = np.append(0.0, deaths_per_s[1:])
    rests = diags_array(jumps.sum(axis=1) + falls)
    generator = jumps - rests + _one_down(falls)
    kept = np.flatnonzero(np.arange(len(law)) != np.argmax(law))
    h = np.zeros(len(law))
    h[kept] = spsolve(generator.tocsr()[kept][:, kept].tocsc(), -rewards[kept])
    return h - law @ h


def tagged_survival(
    jumps: Any, deaths_per_s: Numbers, levels: npt.NDArray[np.int64], met: Numbers, times_s: Numbers
) -> Numbers:
    """Return Pr(life > t) of one among n >= 1 alive, who leaves with chance 1/n at each departure.

    `met` is the law of the level at its beginning, `times_s` are equally spaced from 0 on.
    """
    from scipy.linalg import expm
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import expm_multiply

    drawn = deaths_per_s / levels
    falls = np.append(0.0, (deaths_per_s - drawn)[1:])
    rests = diags_array(jumps.sum(axis=1) + falls + drawn)
    forward = (jumps - rests + _one_down(falls)).T
    if len(levels) > _DENSE:
        paths = expm_multiply(forward.tocsc(), met, times_s[0], times_s[-1], len(times_s))
        survival: Numbers = np.asarray(paths).sum(axis=1)
        return survival
    step = expm((times_s[1] - times_s[0]) * forward.toarray())
    survival = np.empty(len(times_s))
    for i in range(len(times_s)):
        survival[i] = met.sum()
        met = step @ met
    return survival


def _one_down(falls_per_s: Numbers) -> Any:
    """Return the sparse rates of falls from each level to the one below."""
    from scipy.sparse import csr_array

    levels = np.arange(1, len(falls_per_s))
    return csr_array((falls_per_s[1:], (levels, levels - 1)), shape=(len(falls_per_s),) * 2)
