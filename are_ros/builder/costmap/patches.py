"""Which patches came, went or stayed between two updates of a grid."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import compress
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from are_ros.builder.costmap.registration import CellPatch

MaskKey = tuple[tuple[int, ...], bytes]
Cell = TypeVar("Cell", bound=np.generic)
Rectangles = npt.NDArray[np.int64]


@dataclass(frozen=True)
class PlacedPatch:
    """A patch as a comparable value: its first cell, and its mask's shape and bytes."""

    row0: int
    col0: int
    key: MaskKey

    @classmethod
    def at(cls, patch: CellPatch) -> "PlacedPatch":
        """Return the value of a patch; equal masks give equal keys."""
        return cls(patch.row0, patch.col0, (patch.mask.shape, patch.mask.tobytes()))

    @property
    def mask(self) -> npt.NDArray[np.bool_]:
        """The covered cells, bool (r, c), read-only."""
        shape, cells = self.key
        return np.frombuffer(cells, np.bool_).reshape(shape)

    def of(self, cells: npt.NDArray[Cell]) -> npt.NDArray[Cell]:
        """Return the view of a grid (h, w) under the mask."""
        rows, cols = self.key[0]
        return cells[self.row0 : self.row0 + rows, self.col0 : self.col0 + cols]


@dataclass(frozen=True)
class PatchChanges:
    """Patches that left their place, that came to one, and that stayed."""

    vacated: tuple[PlacedPatch, ...]
    arrived: tuple[PlacedPatch, ...]
    standing: tuple[PlacedPatch, ...]

    def to_stamp(self, margin_cells: int, shape: tuple[int, int]) -> list[PlacedPatch]:
        """Return the patches to write once the vacated places are restored.

        Those that arrived, and those that stood by and lost cells, each widened by the margin.
        """
        vacated = rectangles(self.vacated, margin_cells, shape)
        bared = meeting(rectangles(self.standing, margin_cells, shape), vacated)
        return [*self.arrived, *compress(self.standing, bared)]


class PatchLedger:
    """Remembers the last update's patches by artefact id."""

    def __init__(self) -> None:
        self._placed: dict[int, PlacedPatch] = {}

    def exchange(self, patches: Mapping[int, CellPatch]) -> PatchChanges:
        """Take the patches of now, and return how they differ from those before."""
        before, now = self._placed, {i: PlacedPatch.at(patch) for i, patch in patches.items()}
        self._placed = now
        standing = {i for i, placed in now.items() if before.get(i) == placed}
        return PatchChanges(
            vacated=tuple(placed for i, placed in before.items() if i not in standing),
            arrived=tuple(placed for i, placed in now.items() if i not in standing),
            standing=tuple(now[i] for i in now if i in standing),
        )


def rectangles(
    placed: Iterable[PlacedPatch], margin_cells: int, shape: tuple[int, int]
) -> Rectangles:
    """Return int64 (N, 4): row0, col0, row1, col1 (half-open) of each patch widened by the margin.

    Clipped to a grid of `shape` (h, w); a patch outside of it gives an empty rectangle.
    """
    corners = [
        (each.row0, each.col0, each.row0 + each.key[0][0], each.col0 + each.key[0][1])
        for each in placed
    ]
    widened = np.array(corners, np.int64).reshape(-1, 4)
    widened += np.array((-margin_cells, -margin_cells, margin_cells, margin_cells))
    return np.clip(widened, 0, np.array((*shape, *shape)))


def meeting(ours: Rectangles, theirs: Rectangles) -> npt.NDArray[np.bool_]:
    """Return for each of our rectangles (N, 4) whether it shares a cell with one of theirs."""
    low = np.maximum(ours[:, None, :2], theirs[:, :2])
    high = np.minimum(ours[:, None, 2:], theirs[:, 2:])
    shares = np.logical_and.reduce(high > low, axis=2)
    met: npt.NDArray[np.bool_] = np.logical_or.reduce(shares, axis=1)
    return met
