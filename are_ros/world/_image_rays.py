"""Steps that the view models share: the image plane, and rays of length one."""

import numpy as np
import numpy.typing as npt

Rays = npt.NDArray[np.float32]


def image_plane(
    width: int, height: int, fx: float, fy: float, cx: float, cy: float
) -> npt.NDArray[np.float64]:
    """Return (u - cx) / fx and (v - cy) / fy per pixel, (height, width, 2)."""
    columns, rows = (np.arange(width) - cx) / fx, (np.arange(height) - cy) / fy
    plane: npt.NDArray[np.float64] = np.stack(np.meshgrid(columns, rows), axis=2)
    return plane


def unit_rays(rays: npt.NDArray[np.float64]) -> Rays:
    """Return rays (H, W, 3) scaled to length 1, float32 and read-only; NaN becomes zero."""
    unit = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    unit[~np.isfinite(unit).all(axis=2)] = 0.0
    result: Rays = unit.astype(np.float32)
    result.flags.writeable = False
    return result
