"""The spacing of a lattice, from noisy coordinates of some of its points."""

from typing import Final

import numpy as np
import numpy.typing as npt

_FLOAT32_NOISE: Final = 8.0 * float(np.finfo(np.float32).eps)
_MIN_NOISE_M: Final = 1e-6
_MIN_SPACING_M: Final = 1e-3
_MAX_STEPS: Final = 64


def coordinate_noise_m(points_m: npt.NDArray[np.floating]) -> float:
    """Return how far coordinates of points (N, 3) may be off by having been float32."""
    return max(_MIN_NOISE_M, _FLOAT32_NOISE * float(np.abs(points_m).max()))


def common_spacing(points_m: npt.NDArray[np.floating]) -> float | None:
    """Return the largest spacing [m] of which all gaps of points (N, 3) are multiples, or None.

    The gaps are those between neighbouring distinct coordinates of one axis, pooled over the
    axes; coordinates carry the noise of float32. None if there is no gap at all, or if the gaps
    have no divisor of a millimetre that stands out of the noise (the points lie on no lattice).
    """
    noise = coordinate_noise_m(points_m)
    axes = [_distinct(points_m[:, axis], noise) for axis in range(3)]
    gaps = np.concatenate([np.diff(values) for values in axes])
    if not gaps.size:
        return None
    spacing = _approximate_divisor(_distinct(gaps, noise), noise)
    return None if spacing is None else _refined(spacing, axes, noise)


def usual_gap(points_m: npt.NDArray[np.floating]) -> float | None:
    """Return the most frequent gap [m] between neighbouring distinct coordinates, or None.

    The least of several that are equally frequent; None where there is no gap at all.
    """
    noise = coordinate_noise_m(points_m)
    gaps = np.concatenate([np.diff(_distinct(points_m[:, axis], noise)) for axis in range(3)])
    if not gaps.size:
        return None
    gaps.sort()
    group = np.concatenate(([0], np.cumsum(np.diff(gaps) > noise)))
    counts = np.bincount(group)
    most = int(counts.argmax())
    return float(gaps[group == most].mean())


def _distinct(values: npt.NDArray[np.floating], noise: float) -> npt.NDArray[np.float64]:
    """Return the sorted means of values that lie within a chain of steps of at most noise."""
    unique = np.unique(values).astype(np.float64)
    group = np.concatenate(([0], np.cumsum(np.diff(unique) > noise)))
    sums = np.bincount(group, weights=unique)
    return np.asarray(sums / np.bincount(group), dtype=np.float64)


def _approximate_divisor(gaps: npt.NDArray[np.float64], noise: float) -> float | None:
    """Return Euclid's divisor of sorted gaps, where remainders within noise count as none."""
    divisor = float(gaps[0])
    for _ in range(_MAX_STEPS):
        counts = np.round(gaps / divisor)
        remainders = np.abs(gaps - counts * divisor)
        wrong = remainders > 2.0 * noise * (counts + 1.0)
        if not wrong.any():
            return divisor
        divisor = float(remainders[wrong].min())
        if divisor < max(_MIN_SPACING_M, 8.0 * noise):
            return None
    return None


def _refined(spacing: float, axes: list[npt.NDArray[np.float64]], noise: float) -> float:
    """Return the spacing averaged over the extents, rounded to a micrometre if that fits."""
    extent, steps = 0.0, 0.0
    for values in axes:
        extent += float(values[-1] - values[0])
        steps += float(np.round(np.diff(values) / spacing).sum())
    refined = extent / steps
    rounded = round(refined, 6)
    return rounded if abs(rounded - refined) * steps <= 3.0 * noise else refined
