"""What is drawn of an artefact: triangles with normals, colours and a texture."""

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.rendering.decimation import decimate
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.appearance import DrawnMesh, differs, drawn_mesh
from are_ros.population.randomness import Purpose, generator

Floats = npt.NDArray[np.float32]

_CREASE: Final = 0.6
"""Faces that meet at less than the angle of this cosine, 53 degrees, are one rounded surface."""
_KEPT: Final = 200
"""So many surfaces are kept; a person's takes half a megabyte, and as much for its coarser ones."""
_FINEST_M: Final = 0.00125
"""The tolerance of the finest of the coarser surfaces. That of the next is twice as large."""
_LEVELS: Final = 8


@dataclass(frozen=True, eq=False)
class Surface:
    """F triangles in the frame of the artefact's bounding box, as the kernels take them.

    `points_m` float32 (V, 3) [m], no two alike, and `indices` int32 (F, 3), which of them the
    corners are; `normals` float32 (F, 3, 3), unit, at the corners; `colours`
    float32 (F, 3, 3), linear red, green and blue at the corners. `uvs` float32 (F, 3, 2) are places
    in the `texture` uint8 (H, W, 3), sRGB, from its lower left corner; NaN where a face has none.
    The far side of a surface that `is_closed`, with corners anticlockwise from outside, is hidden.
    """

    points_m: Floats
    indices: npt.NDArray[np.int32]
    normals: Floats
    colours: Floats
    uvs: Floats
    texture: npt.NDArray[np.uint8]
    is_closed: bool
    _coarser: dict[int, "Surface"] = field(default_factory=dict, init=False, repr=False)

    def within(self, tolerance_m: float) -> "Surface":
        """Return a surface of fewer triangles; no removed point is farther from it than this.

        It is made when it is first asked for, for tolerances of 1.25, 2.5, 5 mm and so on.
        """
        level = min(math.frexp(max(tolerance_m, 0.0) / _FINEST_M)[1], _LEVELS)
        if level < 1:
            return self
        if level not in self._coarser:
            self._coarser[level] = self._decimated(math.ldexp(_FINEST_M, level - 1))
        return self._coarser[level]

    def _decimated(self, tolerance_m: float) -> "Surface":
        looks = np.concatenate((self.normals, self.colours, self.uvs), axis=2)
        indices, corners = decimate(
            self.points_m.astype(np.float64), self.indices, looks.astype(np.float64), tolerance_m
        )
        used, numbers = np.unique(indices, return_inverse=True)
        kept = looks.reshape(-1, 8)[corners]
        return replace(
            self,
            points_m=self.points_m[used],
            indices=numbers.reshape(-1, 3).astype(np.int32),
            normals=np.ascontiguousarray(kept[:, :, :3]),
            colours=np.ascontiguousarray(kept[:, :, 3:6]),
            uvs=np.ascontiguousarray(kept[:, :, 6:]),
        )

    @classmethod
    def of_mesh(cls, mesh: DrawnMesh) -> "Surface":
        """Return the surface of a mesh; corners without normals take those of the faces there."""
        normals = mesh.normals
        if normals is None or not normals.any(axis=2).all():
            own = corner_normals(mesh.corners_m)
            normals = (
                own
                if normals is None
                else np.where(normals.any(axis=2, keepdims=True), normals, own)
            )
        corners_m = np.ascontiguousarray(mesh.corners_m, dtype=np.float32).reshape(-1, 3)
        points_m, indices = np.unique(corners_m, axis=0, return_inverse=True)
        return cls(
            points_m,
            indices.reshape(-1, 3).astype(np.int32),
            np.ascontiguousarray(normals, dtype=np.float32),
            np.ascontiguousarray(to_linear(mesh.colours), dtype=np.float32),
            np.ascontiguousarray(mesh.uvs, dtype=np.float32),
            np.ascontiguousarray(mesh.texture),
            mesh.is_closed,
        )

    @property
    def corners_m(self) -> Floats:
        """The corners, float32 (F, 3, 3) [m]; the array is new."""
        corners_m: Floats = self.points_m[self.indices]
        return corners_m


def to_linear(srgb: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """Return linear intensities of sRGB values in [0, 1] (IEC 61966-2-1)."""
    bent = ((srgb + 0.055) / 1.055) ** 2.4
    linear: npt.NDArray[np.floating] = np.where(srgb <= 0.04045, srgb / 12.92, bent)
    return linear


def to_srgb(linear: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """Return sRGB values in [0, 1] of linear intensities."""
    clipped = np.clip(linear, 0.0, 1.0)
    bent = 1.055 * clipped ** (1 / 2.4) - 0.055
    srgb: npt.NDArray[np.floating] = np.where(clipped <= 0.0031308, clipped * 12.92, bent)
    return srgb


def corner_normals(corners_m: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return unit normals (F, 3, 3) at the corners (F, 3, 3) of triangles.

    A corner has the mean normal, by area, of the faces that meet there and bend less than the
    crease from its own face.
    """
    across = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    lengths = np.linalg.norm(across, axis=1, keepdims=True)
    faces = across / np.maximum(lengths, 1e-30)
    places = np.rint(corners_m.reshape(-1, 3) * 1e5).astype(np.int64)
    _, points = np.unique(places, axis=0, return_inverse=True)
    points = points.reshape(-1)
    order = np.argsort(points, kind="stable")
    points = points[order]
    normals = np.repeat(across, 3, axis=0)
    # Each corner with the next at the same point, then with the one after that, and so on.
    for step in range(1, len(points)):
        here = np.flatnonzero(points[step:] == points[:-step])
        if not here.size:
            break
        one, other = order[here], order[here + step]
        is_near = (faces[one // 3] * faces[other // 3]).sum(axis=1) >= _CREASE
        one, other = one[is_near], other[is_near]
        normals[one] += across[other // 3]
        normals[other] += across[one // 3]
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return normals.reshape(-1, 3, 3)


class SurfaceBank:
    """Makes the surface of an artefact when it is first asked for, and keeps the newest.

    How an artefact looks depends on the seed and its id, not on when it is seen.
    """

    def __init__(self, seed: int) -> None:
        self.seed = seed
        """That of the surfaces that are not made yet."""
        self._surfaces: dict[tuple[int, int], Surface] = {}

    def of(self, row: CatalogueRow, artefact_id: int = 0) -> Surface:
        """Return the surface of an artefact of a row."""
        key = row.index, artefact_id if differs(row) else 0
        if key not in self._surfaces:
            while len(self._surfaces) >= _KEPT:
                self._surfaces.pop(next(iter(self._surfaces)))
            random = generator(self.seed, Purpose.APPEARANCE, artefact_id)
            self._surfaces[key] = Surface.of_mesh(drawn_mesh(row, random))
        return self._surfaces[key]
