"""First hits of a tile of rays on a mesh: one walk through its tree, then whole tiles per triangle.

All rays of a tile start at one point, so that for each triangle the determinants of Moeller and
Trumbore are dot products of the direction with constant vectors: SIMD code over the pixels.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder._mesh_kernels import LEAF_TRIANGLES, MAX_LEVELS, Tree, enters, inverse
from are_ros.builder._ray_tiles import PIXELS

_EDGE: Final = np.float32(1e-5)
"""Slack on barycentric coordinates in float32: no crack between triangles that share an edge."""
_ZERO: Final = np.float32(0.0)
_ONE: Final = np.float32(1.0)


@compiled
def cast_tile(
    tree: Tree,
    mesh: int,
    camera_m: npt.NDArray[np.float32],
    axis: npt.NDArray[np.float32],
    grown_m: float,
    rays: npt.NDArray[np.float32],
    depths_m: npt.NDArray[np.float32],
) -> None:
    """Lower depths (PIXELS,) [m] to the first hit on the mesh where that is nearer.

    Camera (3,), axis (3,) and rays (3, PIXELS) are in the mesh's frame; within the mesh no ray of
    the tile is farther than `grown_m` from the axis.
    """
    boxes, triangles, meshes, _ = tree
    first_node, first_triangle = meshes[mesh, 0], meshes[mesh, 2]
    first_leaf = (1 << meshes[mesh, 1]) - 1
    ix, iy, iz = inverse(float(axis[0])), inverse(float(axis[1])), inverse(float(axis[2]))
    box, waiting = np.empty(6), np.empty(MAX_LEVELS, dtype=np.int64)
    waiting[0], count = 0, 1
    while count > 0:
        count -= 1
        node = waiting[count]
        box[:3], box[3:] = boxes[first_node + node, :3], boxes[first_node + node, 3:]
        box[:3] -= grown_m
        box[3:] += grown_m
        if enters(box, camera_m[0], camera_m[1], camera_m[2], ix, iy, iz) == np.inf:
            continue
        if node < first_leaf:
            waiting[count], waiting[count + 1] = 2 * node + 2, 2 * node + 1
            count += 2
            continue
        start = first_triangle + (node - first_leaf) * LEAF_TRIANGLES
        for triangle in range(start, start + LEAF_TRIANGLES):
            _meet_all(triangles[triangle], camera_m, rays[0], rays[1], rays[2], depths_m)


@compiled
def _meet_all(
    triangle: npt.NDArray[np.float64],
    camera_m: npt.NDArray[np.float32],
    rays_x: npt.NDArray[np.float32],
    rays_y: npt.NDArray[np.float32],
    rays_z: npt.NDArray[np.float32],
    depths_m: npt.NDArray[np.float32],
) -> None:
    """Lower depths to where the rays meet one triangle (corner, edge, edge), from either side."""
    sx, sy, sz = camera_m[0] - triangle[0], camera_m[1] - triangle[1], camera_m[2] - triangle[2]
    ax, ay, az = triangle[3], triangle[4], triangle[5]
    bx, by, bz = triangle[6], triangle[7], triangle[8]
    nx, ny, nz = _cross(bx, by, bz, ax, ay, az)
    ux, uy, uz = _cross(bx, by, bz, sx, sy, sz)
    vx, vy, vz = _cross(sx, sy, sz, ax, ay, az)
    above = np.float32(
        bx * (sy * az - sz * ay) + by * (sz * ax - sx * az) + bz * (sx * ay - sy * ax)
    )
    for pixel in range(PIXELS):
        x, y, z = rays_x[pixel], rays_y[pixel], rays_z[pixel]
        scale = _ONE / (x * nx + y * ny + z * nz)
        u = (x * ux + y * uy + z * uz) * scale
        v = (x * vx + y * vy + z * vz) * scale
        t = above * scale
        inside = (u >= -_EDGE) & (v >= -_EDGE) & (u + v <= _ONE + _EDGE)
        nearer = inside & (t >= _ZERO) & (t < depths_m[pixel])
        depths_m[pixel] = t if nearer else depths_m[pixel]


@compiled
def _cross(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float
) -> tuple[np.float32, np.float32, np.float32]:
    return (
        np.float32(ay * bz - az * by),
        np.float32(az * bx - ax * bz),
        np.float32(ax * by - ay * bx),
    )
