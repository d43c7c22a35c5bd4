"""Groups of arrays that the occlusion kernels hand to each other."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

TIE_M: Final = np.float32(1e-3)
"""What is behind by no more than this is not hidden: a box stands exactly on the floor."""

INFINITE: Final = np.float32(np.inf)


class Boxes(NamedTuple):
    """N boxes as the camera sees them.

    `cameras_m` float32 (N, 3) is the camera's centre in the frame of each box; `turns` float32
    (N, 2) cosine and sine of the box's yaw in the map; `halves_m` float32 (N, 3); `far_m` float32
    (N,) no corner is farther from the camera; `meshes` int64 (N,) as in `MeshSelection`.
    """

    cameras_m: npt.NDArray[np.float32]
    turns: npt.NDArray[np.float32]
    halves_m: npt.NDArray[np.float32]
    far_m: npt.NDArray[np.float32]
    meshes: npt.NDArray[np.int64]


class Voxels(NamedTuple):
    """The environment as the camera sees it; see `VoxelField.lattice_rays`.

    `voxels_per_m` float32 (3,) are the reciprocals of the voxel's sizes.
    """

    field: npt.NDArray[np.uint8]
    origin: npt.NDArray[np.float32]
    ignored: int
    lattice_from_map: npt.NDArray[np.float32]
    voxels_per_m: npt.NDArray[np.float32]


class Tallies(NamedTuple):
    """What is counted per box.

    Visible and unoccluded pixels int64 (N,); the visible rectangle int64 (N, 4), least and greatest
    x and y; the nearest visible distance [m] float32 (N,).
    """

    visible: npt.NDArray[np.int64]
    unoccluded: npt.NDArray[np.int64]
    bounds: npt.NDArray[np.int64]
    nearest_m: npt.NDArray[np.float32]


class Scratch(NamedTuple):
    """Room for one tile, with a row for each of N boxes and one more.

    `rays` float32 (3, PIXELS) in the map frame; `depths` float32 (N + 1, PIXELS) is Z_a of the
    boxes in `candidates`, inf where a ray misses and where another artefact hides the box.
    """

    rays: npt.NDArray[np.float32]
    depths: npt.NDArray[np.float32]
    candidates: npt.NDArray[np.int64]
    nearest_m: npt.NDArray[np.float32]
    last_m: npt.NDArray[np.float32]
    front_m: npt.NDArray[np.float32]
    mesh_rays: npt.NDArray[np.float32]
    limits_m: npt.NDArray[np.float32]
    environment_m: npt.NDArray[np.float32]
    lattice_rays: npt.NDArray[np.float32]
    hits_m: npt.NDArray[np.float32]
    traced: npt.NDArray[np.int64]
