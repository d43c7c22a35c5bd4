"""First hits of rays on a triangle mesh, through a complete binary tree of bounding boxes."""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

LEAF_TRIANGLES: Final = 4
MAX_LEVELS: Final = 48
_EDGE: Final = 1e-9
"""Slack on barycentric coordinates: no ray slips between two triangles that share an edge."""
_DEGENERATE: Final = 1e-300
_FARTHEST: Final = 1e300
"""Every hit is nearer than this, and no miss is: misses are at infinity."""

Tree = tuple[
    npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.int64]
]
"""Boxes (nodes, 6), triangles (M, 9), first node and level count and first triangle per mesh
(meshes, 3), and the triangles' own numbers (M,); see `mesh_casting.MeshPool`."""


@compiled
def cast(
    tree: Tree,
    mesh: int,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    limit_m: float,
) -> tuple[float, int]:
    """Return the first hit in [0, limit] along a unit ray, and its triangle; (inf, -1) if none.

    Origin and direction are in the frame of the mesh. Nodes lie as in a heap: the children of
    node i are 2 i + 1 and 2 i + 2, and all leaves are on the last level.
    """
    boxes, _, meshes, _ = tree
    first_node, levels = meshes[mesh, 0], meshes[mesh, 1]
    first_leaf = (1 << levels) - 1
    ix, iy, iz = inverse(dx), inverse(dy), inverse(dz)
    waiting = np.empty(MAX_LEVELS, dtype=np.int64)
    waiting[0], count = 0, 1
    best, triangle = min(limit_m, _FARTHEST), -1
    while count > 0:
        count -= 1
        node = waiting[count]
        if not enters(boxes[first_node + node], ox, oy, oz, ix, iy, iz) <= best:
            continue
        if node >= first_leaf:
            best, triangle = _cast_leaf(
                tree, mesh, node - first_leaf, ox, oy, oz, dx, dy, dz, best, triangle
            )
            continue
        left, right = 2 * node + 1, 2 * node + 2
        left_m = enters(boxes[first_node + left], ox, oy, oz, ix, iy, iz)
        right_m = enters(boxes[first_node + right], ox, oy, oz, ix, iy, iz)
        near, far = (left, right) if left_m <= right_m else (right, left)
        if max(left_m, right_m) <= best:
            waiting[count] = far
            count += 1
        if min(left_m, right_m) <= best:
            waiting[count] = near
            count += 1
    return (best if triangle >= 0 else np.inf), triangle


@compiled
def inverse(component: float) -> float:
    """Return 1 / component, finite also for zero."""
    return 1.0 / (component if abs(component) > 1e-30 else 1e-30)


@compiled
def enters(
    box: npt.NDArray[np.float64], ox: float, oy: float, oz: float, ix: float, iy: float, iz: float
) -> float:
    """Return where a ray enters a closed box [m], 0 from inside, inf if it misses."""
    ax, bx = (box[0] - ox) * ix, (box[3] - ox) * ix
    ay, by = (box[1] - oy) * iy, (box[4] - oy) * iy
    az, bz = (box[2] - oz) * iz, (box[5] - oz) * iz
    near = max(min(ax, bx), min(ay, by), min(az, bz), 0.0)
    far = min(max(ax, bx), max(ay, by), max(az, bz))
    return near if near <= far else np.inf


@compiled
def _cast_leaf(
    tree: Tree,
    mesh: int,
    leaf: int,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    best: float,
    triangle: int,
) -> tuple[float, int]:
    """Return the nearer of the best hit so far and a leaf's (Moeller and Trumbore, two-sided)."""
    _, triangles, meshes, numbers = tree
    start = meshes[mesh, 2] + leaf * LEAF_TRIANGLES
    for index in range(start, start + LEAF_TRIANGLES):
        t = _meet(triangles[index], ox, oy, oz, dx, dy, dz)
        if t < best or (t == best and triangle < 0):
            best, triangle = t, numbers[index]
    return best, triangle


@compiled
def _meet(
    triangle: npt.NDArray[np.float64],
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
) -> float:
    """Return where a ray meets a triangle (corner, edge, edge) [m], inf if it does not."""
    ax, ay, az = triangle[3], triangle[4], triangle[5]
    bx, by, bz = triangle[6], triangle[7], triangle[8]
    px, py, pz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
    determinant = ax * px + ay * py + az * pz
    if abs(determinant) < _DEGENERATE:
        return np.inf
    sx, sy, sz = ox - triangle[0], oy - triangle[1], oz - triangle[2]
    u = (sx * px + sy * py + sz * pz) / determinant
    qx, qy, qz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
    v = (dx * qx + dy * qy + dz * qz) / determinant
    t = (bx * qx + by * qy + bz * qz) / determinant
    inside = u >= -_EDGE and v >= -_EDGE and u + v <= 1.0 + _EDGE
    return t if inside and t >= 0.0 else np.inf


@compiled
def cast_all(
    tree: Tree,
    mesh: int,
    origin: npt.NDArray[np.float64],
    directions: npt.NDArray[np.float64],
    limit_m: float,
    hits_m: npt.NDArray[np.float64],
    triangles: npt.NDArray[np.int64],
) -> None:
    """Write the first hit [m] and the triangle for each unit direction (N, 3)."""
    ox, oy, oz = origin[0], origin[1], origin[2]
    for ray in range(directions.shape[0]):
        dx, dy, dz = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        if dx == 0.0 and dy == 0.0 and dz == 0.0:
            hits_m[ray], triangles[ray] = np.inf, -1
        else:
            hits_m[ray], triangles[ray] = cast(tree, mesh, ox, oy, oz, dx, dy, dz, limit_m)
