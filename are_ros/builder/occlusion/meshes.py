"""First hits of rays on the meshes of artefacts, through binary trees of bounding boxes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, compiled, owning
from are_ros.builder.occlusion.rays import PIXELS, inverse
from are_ros.errors import InputError
from are_ros.parameters.choices import Shape
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.geometry import surface_of

LEAF_TRIANGLES: Final = 4
MAX_LEVELS: Final = 48
_EDGE: Final = 1e-9
"""Slack on barycentric coordinates: no ray slips between two triangles that share an edge."""
_DEGENERATE: Final = 1e-300
_FARTHEST: Final = 1e300
"""Every hit is nearer than this, and no miss is: misses are at infinity."""

Tree = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.int64]]
"""Boxes (nodes, 6), triangles (M, 9), and first node, level count and first triangle per mesh
(meshes, 3); see `MeshPool`."""


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
) -> float:
    """Return the first hit in [0, limit] along a unit ray [m], inf if there is none.

    Origin and direction are in the frame of the mesh. Nodes lie as in a heap: the children of
    node i are 2 i + 1 and 2 i + 2, and all leaves are on the last level.
    """
    boxes, triangles, meshes = tree
    first_node, levels = meshes[mesh, 0], meshes[mesh, 1]
    first_leaf = (1 << levels) - 1
    ix, iy, iz = inverse(dx), inverse(dy), inverse(dz)
    waiting = np.empty(MAX_LEVELS, dtype=np.int64)
    waiting[0], count = 0, 1
    best, is_hit = min(limit_m, _FARTHEST), False
    while count > 0:
        count -= 1
        node = waiting[count]
        if not enters(boxes[first_node + node], ox, oy, oz, ix, iy, iz) <= best:
            continue
        if node >= first_leaf:
            start = meshes[mesh, 2] + (node - first_leaf) * LEAF_TRIANGLES
            for index in range(start, start + LEAF_TRIANGLES):
                t = _meet(triangles[index], ox, oy, oz, dx, dy, dz)
                if t <= best:
                    best, is_hit = t, True
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
    return best if is_hit else np.inf


@borrowing
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
def _meet(
    triangle: npt.NDArray[np.float64],
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
) -> float:
    """Return where a ray meets a triangle (corner, edge, edge) [m], inf if it does not.

    Moeller and Trumbore (1997), from either side.
    """
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


_TILE_EDGE: Final = np.float32(1e-5)
"""Slack on barycentric coordinates of tiles: no crack between triangles that share an edge."""
_ZERO: Final = np.float32(0.0)
_ONE: Final = np.float32(1.0)


@owning
def cast_tile(
    tree: Tree,
    mesh: int,
    camera_m: npt.NDArray[np.floating],
    axis: npt.NDArray[np.floating],
    grown_m: float,
    rays: npt.NDArray[np.floating],
    depths_m: npt.NDArray[np.floating],
) -> None:
    """Lower depths (PIXELS,) to the first hit on the mesh where that is nearer.

    Camera (3,) [m], axis (3,) and rays (3, PIXELS) are in the mesh's frame; within the mesh no ray
    of the tile is farther than `grown_m` from the axis. A depth is in lengths of its ray. The
    precision is that of the rays.
    """
    boxes, triangles, meshes = tree
    first_node, first_triangle = meshes[mesh, 0], meshes[mesh, 2]
    first_leaf = (1 << meshes[mesh, 1]) - 1
    ix, iy, iz = inverse(float(axis[0])), inverse(float(axis[1])), inverse(float(axis[2]))
    box, waiting = np.empty(6), np.empty(MAX_LEVELS, dtype=np.int64)
    waiting[0], count = 0, 1
    while count > 0:
        count -= 1
        node = waiting[count]
        for axis_number in range(3):
            box[axis_number] = boxes[first_node + node, axis_number] - grown_m
            box[3 + axis_number] = boxes[first_node + node, 3 + axis_number] + grown_m
        if enters(box, camera_m[0], camera_m[1], camera_m[2], ix, iy, iz) == np.inf:
            continue
        if node < first_leaf:
            waiting[count], waiting[count + 1] = 2 * node + 2, 2 * node + 1
            count += 2
            continue
        start = first_triangle + (node - first_leaf) * LEAF_TRIANGLES
        for triangle in range(start, start + LEAF_TRIANGLES):
            _meet_all(triangles[triangle], camera_m, rays[0], rays[1], rays[2], depths_m)


@borrowing
def _meet_all(
    triangle: npt.NDArray[np.float64],
    camera_m: npt.NDArray[np.floating],
    rays_x: npt.NDArray[np.floating],
    rays_y: npt.NDArray[np.floating],
    rays_z: npt.NDArray[np.floating],
    depths_m: npt.NDArray[np.floating],
) -> None:
    """Lower depths to where the rays meet one triangle (corner, edge, edge), from either side."""
    sx, sy, sz = camera_m[0] - triangle[0], camera_m[1] - triangle[1], camera_m[2] - triangle[2]
    ax, ay, az = triangle[3], triangle[4], triangle[5]
    bx, by, bz = triangle[6], triangle[7], triangle[8]
    number = rays_x.dtype.type
    # the cross products b x a, b x s and s x a
    nx, ny = number(by * az - bz * ay), number(bz * ax - bx * az)
    nz = number(bx * ay - by * ax)
    ux, uy = number(by * sz - bz * sy), number(bz * sx - bx * sz)
    uz = number(bx * sy - by * sx)
    vx, vy = number(sy * az - sz * ay), number(sz * ax - sx * az)
    vz = number(sx * ay - sy * ax)
    above = number(bx * (sy * az - sz * ay) + by * (sz * ax - sx * az) + bz * (sx * ay - sy * ax))
    for pixel in range(PIXELS):
        x, y, z = rays_x[pixel], rays_y[pixel], rays_z[pixel]
        scale = _ONE / (x * nx + y * ny + z * nz)
        u = (x * ux + y * uy + z * uz) * scale
        v = (x * vx + y * vy + z * vz) * scale
        t = above * scale
        inside = (u >= -_TILE_EDGE) & (v >= -_TILE_EDGE) & (u + v <= _ONE + _TILE_EDGE)
        nearer = inside & (t >= _ZERO) & (t < depths_m[pixel])
        depths_m[pixel] = t if nearer else depths_m[pixel]


@dataclass(frozen=True, eq=False)
class MeshPool:
    """The meshes of a catalogue, each in the frame of its bounding box, made ready for rays.

    That frame has its origin in the box's centre and its axes along the box. A mesh must lie within
    its box: elsewhere it is never looked for. `tree` is what the kernels take.
    """

    tree: Tree

    @classmethod
    def of(
        cls, meshes: Sequence[tuple[npt.NDArray[np.floating], npt.NDArray[np.integer]]]
    ) -> "MeshPool":
        """Return the pool of (vertices (V, 3) [m], triangles (F, 3) vertex indices) pairs.

        Raises InputError for a mesh without triangles, with a vertex that is not finite, or with an
        index that names no vertex.
        """
        none = np.empty((0, 6)), np.empty((0, 9)), np.empty((0, 3), dtype=np.int64)
        return cls(none).extended(meshes)

    def extended(
        self, meshes: Sequence[tuple[npt.NDArray[np.floating], npt.NDArray[np.integer]]]
    ) -> "MeshPool":
        """Return a pool that has these meshes after its own, which keep their numbers.

        Arguments and errors as in `of`.
        """
        boxes, corners, rows = [self.tree[0]], [self.tree[1]], [self.tree[2]]
        node, triangle = len(self.tree[0]), len(self.tree[1])
        for number, mesh in enumerate(meshes, start=len(self)):
            own_boxes, own_corners = _tree(number, *mesh)
            row = (node, (len(own_boxes) + 1).bit_length() - 2, triangle)
            rows.append(np.array([row], dtype=np.int64))
            boxes.append(own_boxes)
            corners.append(own_corners)
            node, triangle = node + len(own_boxes), triangle + len(own_corners)
        tree = np.concatenate(boxes), np.concatenate(corners), np.concatenate(rows)
        for array in tree:
            array.flags.writeable = False
        return MeshPool(tree)

    def triangles(self, mesh: int) -> npt.NDArray[np.float64]:
        """Return a mesh's triangles (T, 9), each a corner and two edges [m], some of them twice."""
        _, levels, first = self.tree[2][mesh].tolist()
        return self.tree[1][first : first + (LEAF_TRIANGLES << levels)]

    def __len__(self) -> int:
        """Return the number of meshes."""
        return len(self.tree[2])


_NO_MESHES: Final = MeshPool.of([])


@dataclass(frozen=True, eq=False)
class MeshSelection:
    """Which mesh of a pool stands in each box: `indices` int64 (N,), -1 where it is the box."""

    pool: MeshPool
    indices: npt.NDArray[np.int64]

    @classmethod
    def boxes_only(cls, count: int) -> "MeshSelection":
        """Return a selection in which every one of `count` boxes is its own shape."""
        return cls(_NO_MESHES, np.full(count, -1, dtype=np.int64))


def _tree(
    number: int, vertices_m: npt.NDArray[np.floating], triangles: npt.NDArray[np.integer]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return boxes, and (corner, edge, edge) of a mesh's triangles, in the tree's order."""
    corners = _checked_corners(number, vertices_m, triangles)
    levels = max(0, (len(corners) - 1) // LEAF_TRIANGLES).bit_length()
    ordered = corners[_median_order(corners.mean(axis=1), levels)]
    edges = ordered[:, 1:] - ordered[:, :1]
    flat = np.concatenate((ordered[:, 0], edges[:, 0], edges[:, 1]), axis=1)
    return _heap_of_boxes(ordered, levels), flat


def _checked_corners(
    number: int, vertices_m: npt.NDArray[np.floating], triangles: npt.NDArray[np.integer]
) -> npt.NDArray[np.float64]:
    """Return the triangles' corners, float64 (F, 3, 3)."""
    vertices, faces = np.asarray(vertices_m, dtype=np.float64), np.asarray(triangles)
    if not len(faces):
        raise InputError(f"mesh {number} has no triangle")
    if not np.isfinite(vertices).all():
        raise InputError(f"mesh {number} has a vertex that is not finite")
    if faces.min() < 0 or faces.max() >= len(vertices):
        message = f"mesh {number} has {len(vertices)} vertices, and a triangle names another"
        raise InputError(message)
    corners: npt.NDArray[np.float64] = vertices[faces]
    return corners


def _median_order(centroids: npt.NDArray[np.float64], levels: int) -> npt.NDArray[np.int64]:
    """Return an order of the triangles whose 2^levels equal parts are near together.

    Each part is halved at the median along its longest side, all parts of a level at once. The last
    triangle is repeated until the parts are full.
    """
    full = np.minimum(np.arange(LEAF_TRIANGLES << levels), len(centroids) - 1)
    parts = full[np.newaxis]
    for _ in range(levels):
        points = centroids[parts]
        axis = np.argmax(np.ptp(points, axis=1), axis=1)
        keys = np.take_along_axis(points, axis[:, np.newaxis, np.newaxis], axis=2)[:, :, 0]
        ranks = np.argsort(keys, axis=1, kind="stable")
        parts = np.take_along_axis(parts, ranks, axis=1).reshape(2 * len(parts), -1)
    return parts.reshape(-1)


def _heap_of_boxes(corners: npt.NDArray[np.float64], levels: int) -> npt.NDArray[np.float64]:
    """Return the boxes (low, high) of a complete tree over ordered triangles, root first."""
    low = corners.min(axis=1).reshape(1 << levels, -1, 3).min(axis=1)
    high = corners.max(axis=1).reshape(1 << levels, -1, 3).max(axis=1)
    boxes = [np.concatenate((low, high), axis=1)]
    for _ in range(levels):
        low, high = low.reshape(-1, 2, 3).min(axis=1), high.reshape(-1, 2, 3).max(axis=1)
        boxes.insert(0, np.concatenate((low, high), axis=1))
    return np.concatenate(boxes)


Triangles = npt.NDArray[np.float64]


class MeshBank:
    """Makes the mesh of a row when it is first asked for, and keeps it."""

    def __init__(self) -> None:
        self._pool = MeshPool.of([])
        self._number_of_row: dict[int, int] = {}
        self._drawings: dict[int, tuple[Triangles, npt.NDArray[np.float32]]] = {}

    def selection(self, rows: Sequence[CatalogueRow]) -> MeshSelection:
        """Return the meshes that stand in the boxes of artefacts of these rows."""
        newcomers = {row.index: row for row in rows if row.index not in self._number_of_row}
        if newcomers:
            self._add([*newcomers.values()])
        indices = np.array([self._number_of_row[row.index] for row in rows], dtype=np.int64)
        return MeshSelection(self._pool, indices)

    def shapes(self, rows: Sequence[CatalogueRow], shape: Shape) -> MeshSelection:
        """Return what stands in the boxes of artefacts of these rows: meshes, or the boxes."""
        if shape is Shape.MESH:
            return self.selection(rows)
        return MeshSelection.boxes_only(len(rows))

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
