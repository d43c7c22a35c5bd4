"""Chessboard distance to the nearest occupied voxel, for leaping along rays."""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

FAR: Final = 250
"""Largest distance kept: room above it, so that adding one never wraps around."""


def chessboard_distance(occupied: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return the chessboard distance [voxels] to the nearest occupied voxel, at most `FAR`.

    `occupied` is uint8 (nx, ny, nz) of 0 and 1; the answer is uint8 (nz, nx, ny), so that a map of
    one layer has its long axis innermost. A shortest chessboard path can be walked along y, then
    with a step in x each, then with a step in z each; so a sweep there and back per axis is exact.
    """
    field = np.empty((occupied.shape[2], occupied.shape[0], occupied.shape[1]), dtype=np.uint8)
    np.multiply(occupied.transpose(2, 0, 1) == 0, np.uint8(FAR), out=field)
    if field.size:
        _sweep_rows(field)
        _sweep_planes(field)
        _sweep_layers(field, np.empty_like(field[0]))
    return field


@compiled
def _sweep_rows(field: npt.NDArray[np.uint8]) -> None:
    """Relax along the innermost axis, forward and back."""
    for z in range(field.shape[0]):
        for x in range(field.shape[1]):
            row = field[z, x]
            nearest = FAR
            for y in range(row.size):
                nearest = min(nearest + 1, int(row[y]))
                row[y] = nearest
            for y in range(row.size - 1, -1, -1):
                nearest = min(nearest + 1, int(row[y]))
                row[y] = nearest


@compiled
def _sweep_planes(field: npt.NDArray[np.uint8]) -> None:
    """Relax from row to row within each layer, forward and back."""
    for z in range(field.shape[0]):
        for x in range(1, field.shape[1]):
            _relax_from(field[z, x], field[z, x - 1])
        for x in range(field.shape[1] - 2, -1, -1):
            _relax_from(field[z, x], field[z, x + 1])


@compiled
def _sweep_layers(field: npt.NDArray[np.uint8], scratch: npt.NDArray[np.uint8]) -> None:
    """Relax from layer to layer, forward and back."""
    for z in range(1, field.shape[0]):
        _relax_layer(field[z], field[z - 1], scratch)
    for z in range(field.shape[0] - 2, -1, -1):
        _relax_layer(field[z], field[z + 1], scratch)


@compiled
def _relax_layer(
    layer: npt.NDArray[np.uint8],
    previous: npt.NDArray[np.uint8],
    scratch: npt.NDArray[np.uint8],
) -> None:
    """Take one step from the 3 x 3 neighbours in the previous layer."""
    last = layer.shape[0] - 1
    for x in range(layer.shape[0]):
        _least(previous[max(x - 1, 0)], previous[x], previous[min(x + 1, last)], scratch[x])
    for x in range(layer.shape[0]):
        _relax_from(layer[x], scratch[x])


@compiled
def _least(
    a: npt.NDArray[np.uint8],
    b: npt.NDArray[np.uint8],
    c: npt.NDArray[np.uint8],
    out: npt.NDArray[np.uint8],
) -> None:
    for y in range(out.shape[0]):
        out[y] = min(a[y], b[y], c[y])


@compiled
def _relax_from(row: npt.NDArray[np.uint8], previous: npt.NDArray[np.uint8]) -> None:
    """Take one step from the three neighbours in the previous row."""
    last = row.shape[0] - 1
    row[0] = min(row[0], min(previous[0], previous[min(1, last)]) + 1)
    row[last] = min(row[last], min(previous[last], previous[max(last - 1, 0)]) + 1)
    left, middle, right, inner = previous[:-2], previous[1:-1], previous[2:], row[1:-1]
    for y in range(inner.shape[0]):
        inner[y] = min(inner[y], np.uint8(min(left[y], middle[y], right[y]) + np.uint8(1)))
