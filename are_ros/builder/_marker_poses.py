"""Where the markers of figures stand, all of them at once."""

import numpy as np
import numpy.typing as npt

Poses = npt.NDArray[np.float64]


def marker_poses(poses: Poses, offsets_m: npt.NDArray[np.float64]) -> Poses:
    """Return the poses (K * M, 7) of the M markers of each of K figures.

    `poses` (K, 7) are the figures', x y z [m] and the quaternion q as x y z w; `offsets_m` (K, M,
    3) the markers' places o from there. A marker is at p + R(q) o, turned as its figure is.
    """
    count, markers = offsets_m.shape[:2]
    placed = np.empty((count, markers, 7))
    # A product of small matrices for each figure: the very numbers of RigidTransform.apply.
    turned_m = offsets_m @ _rotation_matrices(poses[:, 3:]).transpose(0, 2, 1)
    placed[:, :, :3] = turned_m + poses[:, None, :3]
    placed[:, :, 3:] = poses[:, None, 3:]
    return placed.reshape(count * markers, 7)


def _rotation_matrices(rotations_xyzw: Poses) -> npt.NDArray[np.float64]:
    """Return unit quaternions (K, 4) as matrices (K, 3, 3)."""
    x, y, z, w = rotations_xyzw.T
    matrices = np.empty((len(rotations_xyzw), 3, 3))
    matrices[:, 0, 0] = 1 - 2 * (y * y + z * z)
    matrices[:, 0, 1] = 2 * (x * y - z * w)
    matrices[:, 0, 2] = 2 * (x * z + y * w)
    matrices[:, 1, 0] = 2 * (x * y + z * w)
    matrices[:, 1, 1] = 1 - 2 * (x * x + z * z)
    matrices[:, 1, 2] = 2 * (y * z - x * w)
    matrices[:, 2, 0] = 2 * (x * z - y * w)
    matrices[:, 2, 1] = 2 * (y * z + x * w)
    matrices[:, 2, 2] = 1 - 2 * (x * x + y * y)
    return matrices
