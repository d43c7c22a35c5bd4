"""S_E: the surface of the environment (section 3.1), the exposed faces of the occupied voxels."""

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.world.voxel_map import VoxelMap

if TYPE_CHECKING:
    import trimesh


def exposed_faces(voxels: VoxelMap) -> "trimesh.Trimesh":
    """Return the surface in the map frame [m], two triangles a face, normals outward.

    A face is exposed where the neighbour is not occupied or outside the lattice. Corners are
    shared, so the mesh is watertight unless two voxels touch in an edge alone (four faces meet
    there; volume and normals still hold). Vertices and faces are in the lattice's C order.
    """
    import trimesh

    corners, quads = exposed_quads(voxels.occupied)
    vertices = voxels.map_from_lattice.apply(corners * np.array(voxels.voxel_size_m))
    faces = quads[:, (0, 1, 2, 0, 2, 3)].reshape(-1, 3)
    return trimesh.Trimesh(vertices, faces, process=False, validate=False)


def exposed_quads(
    occupied: npt.NDArray[np.uint8],
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return distinct lattice corners (V, 3) and quads (F, 4) of them, anticlockwise from outside.

    `occupied` is uint8 (nx, ny, nz) of 0 and 1.
    """
    count = _count_faces(occupied)
    corners = np.empty((4 * count, 3), dtype=np.int32)
    quads = np.empty((count, 4), dtype=np.int32)
    used = _fill_quads(occupied, _QUADS, corners, quads)
    return corners[:used].copy(), quads


def _quad_corners() -> npt.NDArray[np.int64]:
    """Return the corners (6, 4, 3) of a voxel's faces -x, +x, -y, +y, -z, +z."""
    quads = np.zeros((6, 4, 3), dtype=np.int64)
    for axis in range(3):
        following, last = (axis + 1) % 3, (axis + 2) % 3
        quads[2 * axis + 1, :, axis] = 1
        quads[2 * axis + 1, :, following] = (0, 1, 1, 0)
        quads[2 * axis + 1, :, last] = (0, 0, 1, 1)
        quads[2 * axis, :, following] = (0, 0, 1, 1)
        quads[2 * axis, :, last] = (0, 1, 1, 0)
    return quads


_QUADS: Final = _quad_corners()


@compiled
def _is_exposed(occupied: npt.NDArray[np.uint8], i: int, j: int, k: int, side: int) -> bool:
    step = 2 * (side & 1) - 1
    axis = side >> 1
    i += step if axis == 0 else 0
    j += step if axis == 1 else 0
    k += step if axis == 2 else 0
    nx, ny, nz = occupied.shape
    inside = 0 <= i < nx and 0 <= j < ny and 0 <= k < nz
    return not inside or occupied[i, j, k] == 0


@compiled
def _count_faces(occupied: npt.NDArray[np.uint8]) -> int:
    nx, ny, nz = occupied.shape
    count = 0
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if occupied[i, j, k]:
                    for side in range(6):
                        count += _is_exposed(occupied, i, j, k, side)
    return count


@compiled
def _fill_quads(
    occupied: npt.NDArray[np.uint8],
    shape_of_quads: npt.NDArray[np.int64],
    corners: npt.NDArray[np.int32],
    quads: npt.NDArray[np.int32],
) -> int:
    """Write corners and quads, return the number of corners.

    Only two planes of corners are open at a time: `number[i & 1]` holds those of plane i.
    """
    nx, ny, nz = occupied.shape
    number = np.full((2, ny + 1, nz + 1), -1, dtype=np.int32)
    used, face = 0, 0
    for i in range(nx):
        number[(i + 1) & 1] = -1
        for j in range(ny):
            for k in range(nz):
                if not occupied[i, j, k]:
                    continue
                for side in range(6):
                    if not _is_exposed(occupied, i, j, k, side):
                        continue
                    for n in range(4):
                        a = i + shape_of_quads[side, n, 0]
                        b = j + shape_of_quads[side, n, 1]
                        c = k + shape_of_quads[side, n, 2]
                        if number[a & 1, b, c] < 0:
                            number[a & 1, b, c] = used
                            corners[used, 0], corners[used, 1], corners[used, 2] = a, b, c
                            used += 1
                        quads[face, n] = number[a & 1, b, c]
                    face += 1
    return used
