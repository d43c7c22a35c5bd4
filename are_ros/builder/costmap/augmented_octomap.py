"""The augmented octomap: M3D with the voxels at the artefacts' surfaces (section 3.3, Fig. 4b).

A voxel is added if the surface of an artefact meets it: tested exactly, triangle by triangle, with
separating axes (Akenine-Moeller 2001). Surfaces are shrunk by `TOUCH_TOLERANCE_M`, as footprints
are: what stands on the border of a voxel adds none beyond.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros._compiled import compiled
from are_ros.builder.costmap.augmented_map import RateLimit
from are_ros.builder.occlusion.meshes import MeshPool
from are_ros.builder.sensors.point_cloud import PointCloud
from are_ros.world.boxes import TOUCH_TOLERANCE_M
from are_ros.world.rigid_transform import cosine_and_sine
from are_ros.world.voxel_map import VoxelMap

_Floats = NDArray[np.float64]
_Voxels = NDArray[np.int64]

_BITS: Final = 21
_HALF: Final = 1 << (_BITS - 1)
"""Indices of voxels are packed into one number: they lie within this of 0, see `VoxelMap`."""


class Solid(NamedTuple):
    """An artefact's box, a row of `OrientedBoxes.packed`, and the mesh in it, -1 for the box."""

    artefact_id: int
    box: _Floats
    mesh: int


def box_triangles(half_sizes_m: _Floats) -> _Floats:
    """Return the faces of a box as 12 triangles (12, 9), each a corner and two edges."""
    rows = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1.0, 1.0):
            for corner in (-1.0, 1.0):
                triangle = np.zeros((3, 3))
                triangle[0, [axis, u, v]] = side, corner, corner
                triangle[1, u] = triangle[2, v] = -2.0 * corner
                rows.append((triangle * half_sizes_m).ravel())
    return np.array(rows)


class AugmentedOctomap:
    """Keeps the voxels of M3D and of the artefacts' surfaces as one cloud of centres.

    The rate is limited for artefacts that move, as that of the grids is. An artefact that stands
    still costs nothing.
    """

    def __init__(self, max_rate_hz: float) -> None:
        self.has_gone_out = False
        """Whether a cloud went out before."""
        self._bare: VoxelMap | None = None
        self._limit = RateLimit(max_rate_hz)
        self._voxels: VoxelMap | None = None
        self._real = np.empty((0, 3), np.float32)
        self._parts: dict[int, tuple[tuple[bytes, int], _Voxels]] = {}
        self._added: _Voxels | None = None

    def limit_rate(self, max_rate_hz: float) -> None:
        """Let the moves of artefacts out at most so often from now on."""
        self._limit.set_rate(max_rate_hz)

    def prepare(self, voxels: VoxelMap) -> None:
        """Compute the real centres now, if these are other voxels than before."""
        if voxels is not self._voxels:
            self._voxels, self._real = voxels, voxels.centres_m().astype(np.float32)
            self.forget()

    def forget(self) -> None:
        """Give the whole cloud again at the next update: nobody has asked for it for a while."""
        self._parts, self._added = {}, None

    def is_bare(self, voxels: VoxelMap) -> bool:
        """Return whether the cloud that went out last holds these voxels, and no artefact."""
        return self._bare is voxels

    def update(
        self,
        now_ns: int,
        frame_id: str,
        voxels: VoxelMap,
        solids: Sequence[Solid],
        pool: MeshPool,
    ) -> PointCloud | None:
        """Return the cloud of centres if it goes out at `now_ns`, with the solids, each of its id.

        It holds the real voxels first, then those that only the artefacts occupy, each once and in
        the order of their indices; float32, in the map frame.
        """
        self.prepare(voxels)
        ids = {solid.artefact_id for solid in solids}
        is_new = self._added is None or self._parts.keys() != ids
        self._parts = {one.artefact_id: self._part(one, pool, voxels) for one in solids}
        parts = [part for _, part in self._parts.values()]
        added = np.unique(np.concatenate(parts)) if parts else np.empty(0, np.int64)
        is_changed = self._added is None or not np.array_equal(added, self._added)
        self._added = added
        if not self._limit.allows(now_ns, is_changed, at_once=is_new):
            return None
        self.has_gone_out, self._bare = True, None if len(added) else voxels
        centres = np.concatenate((self._real, _centres_m(added, voxels)))
        return PointCloud.of_points(frame_id, now_ns, centres)

    def _part(
        self, solid: Solid, pool: MeshPool, voxels: VoxelMap
    ) -> tuple[tuple[bytes, int], _Voxels]:
        """Return the voxels of a solid, with what they depend on."""
        box, mesh = solid.box, solid.mesh
        key, known = (box.tobytes(), mesh), self._parts.get(solid.artefact_id)
        if known is not None and known[0] == key:
            return known
        triangles = box_triangles(box[5:]) if mesh < 0 else pool.triangles(mesh)
        return key, surface_voxels(box, triangles, voxels)


def surface_voxels(box: _Floats, triangles: _Floats, voxels: VoxelMap) -> _Voxels:
    """Return the voxels (M,), packed, that a surface meets and that are free in the map.

    `box` is a row of `OrientedBoxes.packed`; triangles (T, 9), each a corner and two edges [m], are
    in its frame. The voxels may lie outside the map's array. `unpacked` gives the indices.
    """
    return _surface_voxels(_in_voxels(box, triangles, voxels), voxels.occupied)


def unpacked(packed: _Voxels) -> _Voxels:
    """Return the indices (M, 3) of packed voxels (M,)."""
    mask = (1 << _BITS) - 1
    columns = (packed >> 2 * _BITS, packed >> _BITS & mask, packed & mask)
    return np.stack(columns, axis=1) - _HALF


def _centres_m(packed: _Voxels, voxels: VoxelMap) -> NDArray[np.float32]:
    local = (unpacked(packed) + 0.5) * np.array(voxels.voxel_size_m)
    return voxels.map_from_lattice.apply(local).astype(np.float32)


def _in_voxels(box: _Floats, triangles: _Floats, voxels: VoxelMap) -> _Floats:
    """Return the corners (T, 9) of triangles on the lattice, in voxels, shrunk a little."""
    lattice = voxels.map_from_lattice
    turn, (x0, y0, z0) = cosine_and_sine(lattice.rotation_xyzw), lattice.translation_m
    c, s = box[3] * turn[0] + box[4] * turn[1], box[4] * turn[0] - box[3] * turn[1]
    dx, dy = box[0] - x0, box[1] - y0
    x, y = dx * turn[0] + dy * turn[1], dy * turn[0] - dx * turn[1]
    corners = triangles.reshape(-1, 3, 3).copy()
    corners[:, 1:] += corners[:, :1]
    shrink_m = np.minimum(TOUCH_TOLERANCE_M / np.maximum(box[5:], TOUCH_TOLERANCE_M), 1.0)
    px, py, pz = (corners * (1.0 - shrink_m)).transpose(2, 0, 1)
    placed = np.stack((x + px * c - py * s, y + px * s + py * c, box[2] - z0 + pz), axis=2)
    in_voxels: _Floats = placed / np.array(voxels.voxel_size_m)
    return in_voxels.reshape(-1, 9)


@compiled
def _surface_voxels(corners: _Floats, occupied: NDArray[np.uint8]) -> _Voxels:
    """Return the packed voxels that triangles (T, 9) meet, the occupied ones left out.

    In the order of their indices.
    """
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for axis in range(3):
        low[axis] = np.int64(np.floor(corners[:, axis::3].min()))
        high[axis] = np.int64(np.floor(corners[:, axis::3].max()))
    marks = np.zeros((high[0] - low[0] + 1, high[1] - low[1] + 1, high[2] - low[2] + 1), np.uint8)
    for t in range(corners.shape[0]):
        _mark(corners[t], low, marks)
    nx, ny, nz = occupied.shape
    found = np.empty(np.count_nonzero(marks), np.int64)
    count = 0
    for i in range(marks.shape[0]):
        for j in range(marks.shape[1]):
            for k in range(marks.shape[2]):
                if not marks[i, j, k]:
                    continue
                x, y, z = i + low[0], j + low[1], k + low[2]
                inside = 0 <= x < nx and 0 <= y < ny and 0 <= z < nz
                if inside and occupied[x, y, z]:
                    continue
                found[count] = (((x + _HALF) << _BITS) + y + _HALF << _BITS) + z + _HALF
                count += 1
    return found[:count]


@compiled
def _mark(corners: _Floats, low: _Voxels, marks: NDArray[np.uint8]) -> None:
    """Mark the voxels that a triangle (9,) meets.

    Along the axis w that its normal is nearest to, each column of voxels has few of them.
    """
    ux, uy, uz = corners[3] - corners[0], corners[4] - corners[1], corners[5] - corners[2]
    vx, vy, vz = corners[6] - corners[0], corners[7] - corners[1], corners[8] - corners[2]
    normal = (uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx)
    w = 0
    for axis in range(1, 3):
        if abs(normal[axis]) > abs(normal[w]):
            w = axis
    if normal[w] == 0.0:
        return
    u, v = (w + 1) % 3, (w + 2) % 3
    slope_u, slope_v = normal[u] / normal[w], normal[v] / normal[w]
    reach = 0.5 * (abs(slope_u) + abs(slope_v))
    least, most = _extent(corners, w)
    low_u, high_u = _extent(corners, u)
    low_v, high_v = _extent(corners, v)
    at = np.empty(3, np.int64)
    for i in range(int(np.floor(low_u)), int(np.floor(high_u)) + 1):
        for j in range(int(np.floor(low_v)), int(np.floor(high_v)) + 1):
            if not _meets_square(corners, u, v, i, j):
                continue
            rise = slope_u * (i + 0.5 - corners[u]) + slope_v * (j + 0.5 - corners[v])
            middle = corners[w] - rise
            first = np.int64(np.floor(max(middle - reach, least)))
            last = np.int64(np.floor(min(middle + reach, most)))
            at[u], at[v] = i, j
            for k in range(first, last + 1):
                at[w] = k
                if marks[at[0] - low[0], at[1] - low[1], at[2] - low[2]]:
                    continue
                if _meets_square(corners, v, w, j, k) and _meets_square(corners, w, u, k, i):
                    marks[at[0] - low[0], at[1] - low[1], at[2] - low[2]] = 1


@compiled
def _extent(corners: _Floats, axis: int) -> tuple[float, float]:
    a, b, c = corners[axis], corners[3 + axis], corners[6 + axis]
    return min(a, b, c), max(a, b, c)


@compiled
def _meets_square(corners: _Floats, u: int, v: int, i: int, j: int) -> bool:
    """Tell whether a triangle's shadow along an axis meets the square [i, i + 1] x [j, j + 1].

    No normal of one of its sides separates the two; the square's own sides are tested elsewhere.
    """
    for side in range(3):
        a, b, c = 3 * side, 3 * ((side + 1) % 3), 3 * ((side + 2) % 3)
        nu, nv = corners[a + v] - corners[b + v], corners[b + u] - corners[a + u]
        here = nu * (corners[a + u] - i - 0.5) + nv * (corners[a + v] - j - 0.5)
        there = nu * (corners[c + u] - i - 0.5) + nv * (corners[c + v] - j - 0.5)
        reach = 0.5 * (abs(nu) + abs(nv))
        if min(here, there) > reach or max(here, there) < -reach:
            return False
    return True
