"""Where the pixels of an image look, from its CameraInfo: the lens models turned round slowly.

Shares no code with what it judges: numpy only. The models are those of OpenCV.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_ROUNDS: Final = 400
_CLOSE_PX: Final = 1e-6
_FARTHEST_RAD: Final = 1.56
_TRANSPORTS: Final = frozenset(("compressed", "compressedDepth", "theora", "zstd", "ffmpeg"))


def name_parts(topic: str) -> tuple[str, str]:
    """Return the namespace of an image's topic, and its name without the transport."""
    parts = topic.split("/")
    if parts[-1] in _TRANSPORTS:
        parts.pop()
    return "/".join(parts[:-1]), parts[-1]


def info_topic(topic: str) -> str:
    """Return the topic of the CameraInfo beside an image."""
    return f"{name_parts(topic)[0]}/camera_info"


def rays_of(info: Any, *, rectified: bool) -> Floats:
    """Return the rays (H, W, 3) of a CameraInfo's image to a depth of 1 m; NaN where none is known.

    ValueError for a lens that is not known.
    """
    number = {name: np.asarray(getattr(info, name), np.float64) for name in "dkrp"}
    x_off, y_off = info.roi.x_offset, info.roi.y_offset
    across, down = max(info.binning_x, 1), max(info.binning_y, 1)
    width = (info.roi.width or info.width - x_off) // across
    height = (info.roi.height or info.height - y_off) // down
    matrix = number["p"].reshape(3, 4)[:, :3] if rectified else number["k"].reshape(3, 3)
    fx, fy = matrix[0, 0] / across, matrix[1, 1] / down
    cx, cy = (matrix[0, 2] - x_off) / across, (matrix[1, 2] - y_off) / down
    v, u = np.mgrid[:height, :width].astype(np.float64)
    flat = np.stack(((u - cx) / fx, (v - cy) / fy), axis=2)
    if rectified:
        rays = np.concatenate((flat, np.ones((height, width, 1))), axis=2)
        return np.asarray(rays @ number["r"].reshape(3, 3))
    slopes = _undistorted(flat, info.distortion_model, number["d"], _CLOSE_PX / max(fx, fy))
    return np.concatenate((slopes, np.ones((height, width, 1))), axis=2)


def _undistorted(flat: Floats, model: str, d: Floats, close: float) -> Floats:
    """Return the slopes (H, W, 2) that a lens shows at `flat`; NaN where none is that `close`."""
    if model == "equidistant":
        return _from_angles(flat, np.resize(d, 4) if len(d) else np.zeros(4), close)
    if not d.any():
        return flat
    if model not in {"plumb_bob", "rational_polynomial"}:
        raise ValueError(f"the lens {model!r} is not known here")
    k = np.zeros(14)
    k[: len(d)] = d
    slopes: Floats = flat.copy()
    for _ in range(_ROUNDS):
        shown = _shown(slopes, k)
        slopes += 0.7 * (flat - shown)
    slopes[~(np.abs(_shown(slopes, k) - flat).max(axis=2) < close)] = np.nan
    return slopes


def _shown(slopes: Floats, k: Floats) -> Floats:
    """Return where a lens shows slopes (H, W, 2)."""
    x, y = slopes[..., 0], slopes[..., 1]
    with np.errstate(over="ignore", invalid="ignore"):
        r2 = x * x + y * y
        upper = 1.0 + k[0] * r2 + k[1] * r2**2 + k[4] * r2**3
        lower = 1.0 + k[5] * r2 + k[6] * r2**2 + k[7] * r2**3
        aside_x = 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x) + k[8] * r2 + k[9] * r2**2
        aside_y = k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y + k[10] * r2 + k[11] * r2**2
        return np.stack((x * upper / lower + aside_x, y * upper / lower + aside_y), axis=2)


def _from_angles(flat: Floats, k: Floats, close: float) -> Floats:
    """Return the slopes (H, W, 2) of a fisheye's image; NaN from 89.4 degrees off the axis on."""

    def shown(angle: Floats) -> Floats:
        return np.asarray(angle * (1.0 + sum(k[i] * angle ** (2 * i + 2) for i in range(4))))

    radius = np.hypot(flat[..., 0], flat[..., 1])
    low, high = np.zeros_like(radius), np.full_like(radius, _FARTHEST_RAD)
    for _ in range(60):
        middle = 0.5 * (low + high)
        is_less = shown(middle) < radius
        low, high = np.where(is_less, middle, low), np.where(is_less, high, middle)
    angle = np.where(np.abs(shown(low) - radius) < close, low, np.nan)
    scale = np.where(radius > 0.0, np.tan(angle) / np.maximum(radius, 1e-300), 1.0)
    return flat * scale[..., None]
