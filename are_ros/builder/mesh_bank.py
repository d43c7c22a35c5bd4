"""The meshes of the rows that have arrived: for rays, and for markers."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.meshes import surface_of
from are_ros.builder.mesh_casting import MeshPool, MeshSelection

Triangles = npt.NDArray[np.float64]


class MeshBank:
    """Makes the mesh of a row when it is first asked for, and keeps it."""

    def __init__(self) -> None:
        self._pool = MeshPool.of([])
        self._number_of_row: dict[int, int] = {}
        self._selected: tuple[Sequence[CatalogueRow] | None, MeshSelection]
        self._selected = (None, MeshSelection.boxes_only(0))
        self._drawings: dict[int, tuple[Triangles, npt.NDArray[np.float32]]] = {}

    def selection(self, rows: Sequence[CatalogueRow]) -> MeshSelection:
        """Return the meshes that stand in the boxes of artefacts of these rows.

        Asked again with the very same sequence, it gives the very same answer.
        """
        if rows is self._selected[0]:
            return self._selected[1]
        newcomers = {row.index: row for row in rows if row.index not in self._number_of_row}
        if newcomers:
            self._add([*newcomers.values()])
        indices = np.array([self._number_of_row[row.index] for row in rows], dtype=np.int64)
        self._selected = (rows, MeshSelection(self._pool, indices))
        return self._selected[1]

    def drawing(self, row: CatalogueRow) -> tuple[Triangles, npt.NDArray[np.float32]]:
        """Return a row's triangles (T, 3, 3) in F_A and their colours (T, 4) in [0, 1].

        The same arrays each time, so that a comparison of identities tells whether they changed.
        """
        if row.index not in self._drawings:
            vertices_m, faces, colours = surface_of(row)
            self._drawings[row.index] = (vertices_m[faces], colours.astype(np.float32))
        return self._drawings[row.index]

    def _add(self, newcomers: Sequence[CatalogueRow]) -> None:
        for number, row in enumerate(newcomers, start=len(self._pool)):
            self._number_of_row[row.index] = number
        self._pool = self._pool.extended([_solid(row) for row in newcomers])


def _solid(row: CatalogueRow) -> tuple[Triangles, npt.NDArray[np.int64]]:
    """Return vertices in the frame of the row's box, and faces."""
    vertices_m, faces, _ = surface_of(row)
    return vertices_m - np.array(row.box_centre_in_artefact_m), faces
