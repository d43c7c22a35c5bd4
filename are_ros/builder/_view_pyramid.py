"""An image's tiles under cones of ever more tiles: what a box cannot show in is passed over."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.builder._ray_tiles import TILE, TiledRays, Tiles
from are_ros.world.view_models import ViewModel

NONE: Final = -1
_Floats = npt.NDArray[np.float64]
_Indices = npt.NDArray[np.int64]


class ViewPyramid(NamedTuple):
    """A view's T tiles as the leaves of a quadtree of M nodes.

    Nodes 0 to T - 1 are the tiles; the last node, if there is any, holds all. `axes` float32 (M, 3)
    and `spreads` float32 (M,) are cones in the optical frame, as in `Tiles`: a ray of a tile below
    a node differs from the node's axis by a vector no longer than its spread. `children` int32
    (M, 4) and `parents` int32 (M,) hold NONE where there is none.
    """

    tiles: Tiles
    axes: npt.NDArray[np.float32]
    spreads: npt.NDArray[np.float32]
    children: npt.NDArray[np.int32]
    parents: npt.NDArray[np.int32]


def pyramid_of(view: ViewModel) -> ViewPyramid:
    """Return the pyramid of a view; to be made once per view."""
    tiles = TiledRays.of(view.directions()).tiles
    count = len(tiles.axes)
    axes, spreads = [tiles.axes.astype(np.float64)], [tiles.spreads.astype(np.float64)]
    children, first = [np.full((count, 4), NONE)], 0
    places = tiles.first_pixels // TILE
    while len(places) > 1:
        places, above = np.unique(places // 2, axis=0, return_inverse=True)
        above = above.reshape(-1)
        cones = _cones_above(axes[-1], spreads[-1], above, len(places))
        axes.append(cones[0])
        spreads.append(cones[1])
        children.append(_children(above, len(places), first))
        first += len(above)
    table = np.concatenate(children).astype(np.int32)
    return ViewPyramid(
        tiles,
        np.concatenate(axes).astype(np.float32),
        np.concatenate(spreads).astype(np.float32),
        table,
        _parents(table),
    )


def _cones_above(
    axes: _Floats, spreads: _Floats, above: _Indices, count: int
) -> tuple[_Floats, _Floats]:
    """Return the cones of `count` nodes, `above[i]` that of cone i; room for rounding included."""
    sums = np.zeros((count, 3))
    np.add.at(sums, above, axes)
    means = sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)
    apart = np.linalg.norm(axes - means[above], axis=1) + spreads
    widest = np.zeros(count)
    np.maximum.at(widest, above, apart)
    return means, widest * 1.0001 + 1e-5


def _children(above: _Indices, count: int, first: int) -> _Indices:
    """Return the table (count, 4) of the nodes first, first + 1, ... below each node."""
    order = np.argsort(above, kind="stable")
    starts = np.searchsorted(above[order], np.arange(count))
    slots = np.arange(len(above)) - starts[above[order]]
    table = np.full((count, 4), NONE)
    table[above[order], slots] = order + first
    return table


def _parents(children: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    parents = np.full(len(children), NONE, np.int32)
    nodes, slots = np.nonzero(children != NONE)
    parents[children[nodes, slots]] = nodes
    return parents
