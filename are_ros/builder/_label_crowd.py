"""Whose labels would run into each other: of these rviz shows the ids, which are short."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

NEAR_M: Final = 1.4
"""As wide as most labels are."""

FAR_M: Final = 1.8
"""Who had an id beside another one keeps it up to here, lest the texts change to and fro."""

MOST_LABELS: Final = 100
"""Of more than these all are ids."""


def crowded_ids(
    ids: Sequence[int], places_m: npt.NDArray[np.float64], before: frozenset[int]
) -> frozenset[int]:
    """Return which of `ids` (N,), distinct, at places (N, 2) in the map, stand close to another.

    `before` are those who did at the last tick.
    """
    if len(ids) < 2:
        return frozenset()
    if len(ids) > MOST_LABELS:
        return frozenset(ids)
    x_m, y_m = places_m.T
    apart_m = np.hypot(x_m[:, np.newaxis] - x_m, y_m[:, np.newaxis] - y_m)
    np.fill_diagonal(apart_m, np.inf)
    was = np.array([number in before for number in ids])
    limit_m = np.where(was[:, np.newaxis] & was, FAR_M, NEAR_M)
    close = (apart_m < limit_m).any(axis=1).tolist()
    return frozenset(number for number, is_close in zip(ids, close, strict=True) if is_close)
