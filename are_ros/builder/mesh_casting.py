"""First hits of rays on the artefacts' rigid meshes, as occluders and as what a laser sees."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.builder._mesh_kernels import LEAF_TRIANGLES, Tree, cast_all
from are_ros.errors import InputError


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
        none = (
            np.empty((0, 6)),
            np.empty((0, 9)),
            np.empty((0, 3), dtype=np.int64),
            np.empty(0, dtype=np.int64),
        )
        return cls(none).extended(meshes)

    def extended(
        self, meshes: Sequence[tuple[npt.NDArray[np.floating], npt.NDArray[np.integer]]]
    ) -> "MeshPool":
        """Return a pool that has these meshes after its own, which keep their numbers.

        Arguments and errors as in `of`.
        """
        boxes, corners = [self.tree[0]], [self.tree[1]]
        rows, numbers = [self.tree[2]], [self.tree[3]]
        node, triangle = len(self.tree[0]), len(self.tree[1])
        for number, mesh in enumerate(meshes, start=len(self)):
            own_boxes, own_corners, own_numbers = _tree(number, *mesh)
            row = (node, (len(own_boxes) + 1).bit_length() - 2, triangle)
            rows.append(np.array([row], dtype=np.int64))
            boxes.append(own_boxes)
            corners.append(own_corners)
            numbers.append(own_numbers)
            node, triangle = node + len(own_boxes), triangle + len(own_corners)
        tree = (
            np.concatenate(boxes),
            np.concatenate(corners),
            np.concatenate(rows),
            np.concatenate(numbers),
        )
        for array in tree:
            array.flags.writeable = False
        return MeshPool(tree)

    def __len__(self) -> int:
        """Return the number of meshes."""
        return len(self.tree[2])

    def first_hits(
        self,
        mesh: int,
        origin_m: npt.NDArray[np.floating],
        directions: npt.NDArray[np.floating],
        max_range_m: float,
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
        """Return the distance [m] to a mesh along rays, and the triangle hit: (N,) each.

        `origin_m` (3,) and the unit `directions` (N, 3) are in the frame of the mesh's box; the
        range is closed. Without a hit they are inf and -1, as they are for a direction of zeros.
        """
        rays = np.ascontiguousarray(directions, dtype=np.float64)
        hits, triangles = np.empty(len(rays)), np.empty(len(rays), dtype=np.int64)
        origin = np.asarray(origin_m, dtype=np.float64)
        cast_all(self.tree, mesh, origin, rays, max_range_m, hits, triangles)
        return hits, triangles


@dataclass(frozen=True, eq=False)
class MeshSelection:
    """Which mesh of a pool stands in each box: `indices` int64 (N,), -1 where the box itself does.

    Raises InputError for an index outside the pool.
    """

    pool: MeshPool
    indices: npt.NDArray[np.int64]

    def __post_init__(self) -> None:
        indices = np.ascontiguousarray(self.indices, dtype=np.int64).view()
        indices.flags.writeable = False
        object.__setattr__(self, "indices", indices)
        outside = (self.indices < -1) | (self.indices >= len(self.pool))
        if outside.any():
            index = int(self.indices[outside][0])
            message = f"mesh {index} is asked for, and the pool has {len(self.pool)}"
            raise InputError(message)

    @classmethod
    def boxes_only(cls, count: int) -> "MeshSelection":
        """Return a selection in which every one of `count` boxes is its own shape."""
        return cls(MeshPool.of([]), np.full(count, -1, dtype=np.int64))


def _tree(
    number: int, vertices_m: npt.NDArray[np.floating], triangles: npt.NDArray[np.integer]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Return boxes, (corner, edge, edge) and numbers of a mesh's triangles, in the tree's order."""
    corners = _checked_corners(number, vertices_m, triangles)
    levels = max(0, (len(corners) - 1) // LEAF_TRIANGLES).bit_length()
    order = _median_order(corners.mean(axis=1), levels)
    ordered = corners[order]
    edges = ordered[:, 1:] - ordered[:, :1]
    flat = np.concatenate((ordered[:, 0], edges[:, 0], edges[:, 1]), axis=1)
    return _heap_of_boxes(ordered, levels), flat, order


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
