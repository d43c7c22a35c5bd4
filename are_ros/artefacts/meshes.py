"""The polygonal meshes S_A of the artefacts (section 3.2), built only when asked for."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.artefacts._mesh_file import read_mesh_file
from are_ros.artefacts.catalogue import CatalogueRow, MeshFile
from are_ros.artefacts.shapes import Shape, build_shape

if TYPE_CHECKING:
    import trimesh

Triple = tuple[float, float, float]


class BoxGeometry(NamedTuple):
    """The bounding box in F_A: its size (x, y, z) and its centre [m]."""

    size_m: Triple
    box_centre_in_artefact_m: Triple


def shape_geometry(shape: Shape, size_m: Triple) -> BoxGeometry:
    """Place the box of a built-in shape round its centre of mass; needs no trimesh."""
    solid = build_shape(shape, size_m, (0.0, 0.0, 0.0, 1.0))
    x, y, z = solid.centre_of_mass_m()
    return BoxGeometry(size_m, (float(-x), float(-y), float(0.5 * size_m[2] - z)))


def file_geometry(source: MeshFile) -> BoxGeometry:
    """Read a mesh of the user's for its box; `CatalogueError` as `mesh_of`."""
    low, high = read_mesh_file(source, (0.0, 0.0, 0.0, 1.0)).bounds
    return BoxGeometry(_triple(high - low), _triple(0.5 * (low + high)))


def surface_of(
    row: CatalogueRow,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Return the row's mesh in F_A as plain arrays; a built-in shape needs no trimesh for it.

    Vertices (V, 3) [m], faces (F, 3) of vertex indices, and the faces' colours (F, 4) in [0, 1].
    """
    if isinstance(row.surface, MeshFile):
        mesh = mesh_of(row)
        colours = np.asarray(mesh.visual.face_colors, dtype=np.float64) / 255.0
        return np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64), colours
    solid = build_shape(row.surface, row.size_m, row.colour)
    vertices_m = solid.vertices_m - solid.centre_of_mass_m()
    return vertices_m, np.asarray(solid.faces, dtype=np.int64), np.asarray(solid.colours)


def mesh_of(row: CatalogueRow) -> "trimesh.Trimesh":
    """Build the row's mesh in F_A, in metres: triangles, normals outwards, a colour per face.

    A mesh of the user's has the colours of its file (a texture's, at the corners), and takes the
    row's colour where that gives none. `CatalogueError` if the file is missing, cannot be read,
    holds no triangles, has a corner that is not finite, or is flat.
    """
    if isinstance(row.surface, MeshFile):
        return read_mesh_file(row.surface, row.colour)
    import trimesh

    solid = build_shape(row.surface, row.size_m, row.colour)
    return trimesh.Trimesh(
        solid.vertices_m - solid.centre_of_mass_m(),
        solid.faces,
        face_colors=np.rint(255.0 * solid.colours).astype(np.uint8),
        process=False,
    )


def _triple(values: npt.NDArray[np.float64]) -> Triple:
    """Return an array (3,) as plain numbers."""
    return (float(values[0]), float(values[1]), float(values[2]))
