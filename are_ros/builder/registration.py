"""Registration: an artefact's footprint in M2D and its mesh's surface in M3D (section 3.3)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from are_ros.builder import _surface_kernels
from are_ros.world.lattice_cover import count_new, covered, lattice_row
from are_ros.world.occupancy_grid import CellClasses, OccupancyGrid
from are_ros.world.oriented_boxes import TOUCH_TOLERANCE_M, OrientedBoxes
from are_ros.world.rigid_transform import RigidTransform

_SURFACE_TOLERANCE_M = 1e-6  # meshes come with coordinates of single precision


@dataclass(frozen=True, eq=False)
class CellPatch:
    """The cells of a grid that one artefact covers: `mask` bool (r, c), read-only.

    `mask[0, 0]` is the cell (row0, col0); all lies inside the grid. An artefact wholly outside
    has an empty mask.
    """

    row0: int
    col0: int
    mask: NDArray[np.bool_]

    def __post_init__(self) -> None:
        self.mask.flags.writeable = False

    @property
    def window(self) -> tuple[slice, slice]:
        """The slices (rows, columns) of the grid that the mask lies on."""
        rows, columns = self.mask.shape
        return slice(self.row0, self.row0 + rows), slice(self.col0, self.col0 + columns)


def covered_cells(boxes: OrientedBoxes, grid: OccupancyGrid) -> tuple[CellPatch, ...]:
    """Return for each box the cells that the projection of the box covers, clipped to the grid.

    A cell is covered if its open square meets the open footprint: a footprint that ends on a
    cell's edge does not cover the next cell. Against rounding, the footprint is shrunk by
    `TOUCH_TOLERANCE_M` on each side; one without area covers the cell that holds it.
    """
    lattice = lattice_row(grid.origin, grid.resolution_m, grid.resolution_m)
    shape = (grid.height, grid.width)
    return tuple(
        CellPatch(*covered(boxes.packed, i, lattice, shape, TOUCH_TOLERANCE_M))
        for i in range(len(boxes))
    )


def covered_count(patches: Sequence[CellPatch]) -> int:
    """Return n_A, the number of cells in the union of patches of one grid."""
    patches = [patch for patch in patches if patch.mask.size]
    if not patches:
        return 0
    rows = max(patch.window[0].stop for patch in patches)
    columns = max(patch.window[1].stop for patch in patches)
    is_counted = np.zeros((rows, columns), dtype=np.bool_)
    count = 0
    for patch in patches:
        count += count_new(patch.mask, patch.row0, patch.col0, is_counted)
    return count


def clutter_ratio(patches: Sequence[CellPatch], classes: CellClasses) -> float:
    """Return nu = n_A / n_free (Eq. 4): all artefacts' cells over the real map's free ones.

    NaN where the map has no free cell.
    """
    free = classes.free_count
    return covered_count(patches) / free if free else float("nan")


def surface_voxels(
    vertices_m: NDArray[np.floating],
    faces: NDArray[np.integer],
    map_from_lattice: RigidTransform,
    voxel_size_m: tuple[float, float, float],
) -> NDArray[np.int64]:
    """Return the voxels (N, 3), sorted, each once, that a mesh's surface meets.

    `vertices_m` (V, 3) in the map frame, `faces` (F, 3) indices into them, counter-clockwise seen
    from outside; the lattice as in VoxelMap. Indices may be negative or beyond that map: the
    lattice has no end. A face that lies in the boundary of voxels belongs to those on its inner
    side: to that end the surface is moved inwards by 2 um, and voxels are open by 1 um.
    """
    triangles_m = np.asarray(vertices_m, dtype=np.float64)[np.asarray(faces)]
    if not len(triangles_m):
        return np.empty((0, 3), dtype=np.int64)
    size_m = np.array(voxel_size_m)
    inset_m = _moved_inwards(triangles_m, 2.0 * _SURFACE_TOLERANCE_M)
    local_m = map_from_lattice.inverse().apply(inset_m.reshape(-1, 3))
    triangles = (local_m / size_m).reshape(-1, 3, 3)
    low = np.floor(triangles.min(axis=(0, 1))).astype(np.int64) - 1
    high = np.floor(triangles.max(axis=(0, 1))).astype(np.int64) + 2
    marks = np.zeros(tuple(high - low), dtype=np.bool_)
    half = 0.5 - _SURFACE_TOLERANCE_M / size_m
    _surface_kernels.mark_triangles(triangles, half, low, marks)
    voxels: NDArray[np.int64] = np.argwhere(marks) + low
    return voxels


def _moved_inwards(triangles_m: NDArray[np.float64], distance_m: float) -> NDArray[np.float64]:
    """Return triangles (F, 3, 3) moved against their normals; those without area stay."""
    a, b, c = triangles_m[:, 0], triangles_m[:, 1], triangles_m[:, 2]
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    units = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
    moved_m: NDArray[np.float64] = triangles_m - distance_m * units[:, None, :]
    return moved_m
