"""An image's rays in square tiles, each with the cone that holds its rays."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

TILE: Final = 16
"""Pixels along a tile's side."""

PIXELS: Final = TILE * TILE


class Tiles(NamedTuple):
    """What the kernels take of T tiles.

    `rays` float32 (T, 3, PIXELS), `valid` uint8 (T, PIXELS), `axes` float32 (T, 3), `spreads`
    float32 (T,), `first_pixels` int64 (T, 2) of x and y. A ray differs from its tile's axis by a
    vector no longer than the spread: at t metres it is at most `spread` t metres away from the
    axis' point at t. Tiles without a valid ray are left out; an invalid ray is zero.
    """

    rays: npt.NDArray[np.float32]
    valid: npt.NDArray[np.uint8]
    axes: npt.NDArray[np.float32]
    spreads: npt.NDArray[np.float32]
    first_pixels: npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class TiledRays:
    """The rays (H, W, 3) of a view, in the optical frame, ready for the occlusion kernel."""

    tiles: Tiles

    @classmethod
    def of(cls, directions: npt.NDArray[np.float32]) -> "TiledRays":
        """Return unit rays (H, W, 3), zero where a pixel has none, in tiles."""
        rows, columns = -(-directions.shape[0] // TILE), -(-directions.shape[1] // TILE)
        padded = np.zeros((rows * TILE, columns * TILE, 3), dtype=np.float32)
        padded[: directions.shape[0], : directions.shape[1]] = directions
        blocks = padded.reshape(rows, TILE, columns, TILE, 3).transpose(0, 2, 4, 1, 3)
        rays = np.ascontiguousarray(blocks).reshape(rows * columns, 3, PIXELS)
        valid = np.any(rays != 0.0, axis=1)
        y, x = np.divmod(np.arange(rows * columns), columns)
        first_pixels = np.stack((x, y), axis=1) * TILE
        used = valid.any(axis=1)
        return cls(_with_cones(rays[used], valid[used], first_pixels[used]))


def _with_cones(
    rays: npt.NDArray[np.float32],
    valid: npt.NDArray[np.bool_],
    first_pixels: npt.NDArray[np.int64],
) -> Tiles:
    """Return tiles with axes through their mean ray; the spread has room for rounding."""
    axes = rays.sum(axis=2, dtype=np.float64)
    axes /= np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-12)
    apart = np.linalg.norm(rays - axes[:, :, np.newaxis], axis=1)
    spreads = np.max(apart, axis=1, where=valid, initial=0.0) * 1.0001 + 1e-5
    return Tiles(
        rays,
        valid.astype(np.uint8),
        axes.astype(np.float32),
        spreads.astype(np.float32),
        first_pixels,
    )
