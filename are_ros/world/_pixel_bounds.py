"""Which rectangle of an image can show a box: conservative for every view model."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt


class PixelRectangle(NamedTuple):
    """Half-open rectangle of pixels: columns x0 <= x < x1, rows y0 <= y < y1; may be empty."""

    x0: int
    y0: int
    x1: int
    y1: int


Interval = tuple[float, float]


class PixelBounds:
    """Two coordinates of the rays of an image, and their range per row and per column.

    `charted` is (H, W, 2): plane coordinates of each pixel's ray, NaN where a pixel has none. A
    region within [a0, a1] x [b0, b1] of the plane shows only in columns whose range of the first
    coordinate meets [a0, a1], and in rows whose range of the second meets [b0, b1].
    """

    def __init__(self, charted: npt.NDArray[np.float64]) -> None:
        self._columns = _ranges(charted[:, :, 0], axis=0)
        self._rows = _ranges(charted[:, :, 1], axis=1)

    def whole(self) -> PixelRectangle:
        """Return all pixels."""
        return PixelRectangle(0, 0, len(self._columns[0]), len(self._rows[0]))

    def rectangle(self, first: Interval, second: Interval) -> PixelRectangle:
        """Return the pixels that can show what lies within two closed intervals of the plane."""
        x0, x1 = _meeting(self._columns, first)
        y0, y1 = _meeting(self._rows, second)
        return PixelRectangle(x0, y0, x1, y1)


def _ranges(
    values: npt.NDArray[np.float64], axis: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return least and greatest values along an axis, (inf, -inf) where all are NaN."""
    finite = np.isfinite(values)
    low = np.min(values, axis=axis, where=finite, initial=np.inf)
    return low, np.max(values, axis=axis, where=finite, initial=-np.inf)


def _meeting(
    ranges: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]], interval: Interval
) -> tuple[int, int]:
    """Return first and one past the last index whose range meets the interval, with slack."""
    slack = 1e-6 * (1.0 + abs(interval[0]) + abs(interval[1]))
    meeting = (ranges[0] <= interval[1] + slack) & (ranges[1] >= interval[0] - slack)
    indices = np.flatnonzero(meeting)
    return (int(indices[0]), int(indices[-1]) + 1) if indices.size else (0, 0)
