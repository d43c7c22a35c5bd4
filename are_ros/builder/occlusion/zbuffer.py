"""Which artefacts a camera sees: Z_a against Z_S, pixel by pixel (equation 2 and A_f)."""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder.occlusion.kernels import Boxes, Scratch, Visibility, Voxels, render
from are_ros.builder.occlusion.meshes import MeshSelection
from are_ros.builder.occlusion.rays import PIXELS, VoxelField, aligned, tiled
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import ViewModel
from are_ros.world.rigid_transform import RigidTransform

_Floats = npt.NDArray[np.float32]

_FARTHEST_M: Final = 1e30
"""In place of an endless range: misses are at infinity, and stay beyond it."""


class ZBuffer:
    """Tells which artefacts a view model sees within a range.

    Distances are Euclidean along the ray, in [0, max_range_m]. Z_a is the first hit on a's bounding
    box, Z_S the first hit on the environment and on the shapes of the other artefacts; a is visible
    at a pixel where Z_a is finite and Z_a <= Z_S + 1 mm. A camera inside a's box has Z_a = 0 in
    every pixel that has a ray, and that box, as a shape, hides all others. A camera inside an
    occupied voxel looks out of that one voxel. Rays are float32: a decision within a few
    micrometres of an edge may fall either way. With a `stride`, only every n-th row and column of
    pixels is looked at.
    """

    def __init__(self, view: ViewModel, max_range_m: float, stride: int = 1) -> None:
        self._tiles = tiled(view.directions()[::stride, ::stride])
        self._max_range_m = np.float32(min(max_range_m, _FARTHEST_M))

    def visibility(
        self,
        map_from_camera: RigidTransform,
        boxes: OrientedBoxes,
        environment: VoxelField,
        shapes: MeshSelection | None = None,
        mutual: bool = True,
        *,
        by_mesh: bool = False,
    ) -> Visibility:
        """Return what the camera sees of the artefacts with these boxes in the map frame.

        `map_from_camera` is the pose of the optical frame. `shapes` are the artefacts as occluders
        of each other, in the order of the boxes (None: the boxes themselves); `mutual` False lets
        artefacts hide nothing from each other. `by_mesh` lets Z_a be the hit on the artefact's
        shape, not on its box.
        """
        selection = MeshSelection.boxes_only(len(boxes)) if shapes is None else shapes
        count = len(boxes)
        seen = _nothing_seen(count)
        render(
            self._tiles,
            map_from_camera.rotation_matrix().astype(np.float32),
            boxes_seen_from(map_from_camera.translation_m, boxes, selection.indices),
            _voxels(map_from_camera.translation_m, environment),
            selection.pool.tree,
            mutual,
            by_mesh,
            self._max_range_m,
            seen,
            _scratch(count),
        )
        seen.rois[:, 2:] += 1 - seen.rois[:, :2]
        seen.rois[seen.visible_pixels == 0] = 0
        for array in seen:
            array.flags.writeable = False
        return seen


def boxes_seen_from(
    camera_m: npt.NDArray[np.float64], boxes: OrientedBoxes, meshes: npt.NDArray[np.int64]
) -> Boxes:
    """Return the boxes as seen from the camera; differences are taken before rounding."""
    return Boxes(*_seen_from(camera_m, boxes.packed), meshes)


@compiled
def _seen_from(
    camera_m: npt.NDArray[np.float64], packed: npt.NDArray[np.float64]
) -> tuple[_Floats, _Floats, _Floats, _Floats]:
    """Return cameras, turns, halves and the distance of the farthest corner, as in `Boxes`."""
    count = packed.shape[0]
    cameras, turns = np.empty((3, count), np.float32), np.empty((2, count), np.float32)
    halves, far = np.empty((3, count), np.float32), np.empty(count, np.float32)
    for box in range(count):
        x_m, y_m = camera_m[0] - packed[box, 0], camera_m[1] - packed[box, 1]
        z_m, cosine, sine = camera_m[2] - packed[box, 2], packed[box, 3], packed[box, 4]
        a_m, b_m, c_m = packed[box, 5], packed[box, 6], packed[box, 7]
        cameras[0, box] = cosine * x_m + sine * y_m
        cameras[1, box] = cosine * y_m - sine * x_m
        cameras[2, box] = z_m
        turns[0, box], turns[1, box] = cosine, sine
        halves[0, box], halves[1, box], halves[2, box] = a_m, b_m, c_m
        far[box] = np.sqrt(x_m * x_m + y_m * y_m + z_m * z_m) + np.sqrt(
            a_m * a_m + b_m * b_m + c_m * c_m
        )
    return cameras, turns, halves, far


def _voxels(camera_m: npt.NDArray[np.float64], environment: VoxelField) -> Voxels:
    origin, ignored, matrix = environment.lattice_rays(camera_m)
    return Voxels(environment.distances, origin, ignored, matrix, environment.voxels_per_m)


def _nothing_seen(count: int) -> Visibility:
    bounds = np.empty((count, 4), dtype=np.int64)
    bounds[:, :2], bounds[:, 2:] = 2**31, -1
    nearest = np.full(count, np.inf, dtype=np.float32)
    return Visibility(
        np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64), bounds, nearest
    )


def _scratch(count: int) -> Scratch:
    """Return room for one tile; one candidate more than boxes, as it is written before counted."""
    rows = aligned(16 + count + 1, PIXELS)  # sixteen of the tile, then a depth per candidate
    return Scratch(
        axes=np.empty((3, 3), dtype=np.float32),
        rays=rows[:3],
        depths=rows[16:],
        candidates=np.empty(count + 1, dtype=np.int64),
        nearest_bits=np.empty(count + 1, dtype=np.int32),
        order=np.empty(count + 1, dtype=np.int64),
        last_m=rows[3],
        front_m=rows[4],
        mesh_rays=rows[5:8],
        limits_m=rows[8],
        environment_m=rows[9],
        lattice_rays=rows[10:13],
        inverses_z=rows[13],
        nearest_m=rows[14],
        guesses=rows[15].view(np.int32),
        to_trace=np.empty(PIXELS + 1, dtype=np.int64),
        farthest_m=np.empty(1, dtype=np.float32),
    )
