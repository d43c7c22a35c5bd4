"""Texts in the scene, upright and facing the viewer, as large as their height in metres says."""

from functools import lru_cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.replay.rviz_canvas import Canvas, Rgb

Floats = npt.NDArray[np.float64]

_SHIFT: Final = 4
_SMALLEST_PX: Final = 3.0


def draw_text(
    canvas: Canvas, text: str, place_m: Floats, height_m: float, colour: Rgb, alpha: float
) -> None:
    """Write a text centred at a point (3,); what stands nearer hides it."""
    import cv2

    pixels, near = canvas.camera.project(place_m[np.newaxis])
    size_px = height_m * float(canvas.camera.pixels_per_m(place_m[np.newaxis])[0])
    outlines = _outlines(text)
    if not np.isfinite(near[0]) or size_px < _SMALLEST_PX or not outlines:
        return
    everything = np.concatenate(outlines) * size_px + pixels[0]
    low = np.floor(everything.min(axis=0)).astype(np.int64) - 1
    high = np.ceil(everything.max(axis=0)).astype(np.int64) + 2
    sides = (canvas.camera.width, canvas.camera.height)
    (x0, y0), (x1, y1) = np.clip(low, 0, sides), np.clip(high, 0, sides)
    if x1 <= x0 or y1 <= y0:
        return
    mask = np.zeros((y1 - y0, x1 - x0), np.uint8)
    shifted = [
        np.rint((part * size_px + pixels[0] - (x0, y0)) * 2**_SHIFT).astype(np.int32)
        for part in outlines
    ]
    cv2.fillPoly(mask, shifted, 255, cv2.LINE_AA, _SHIFT)
    canvas.blend(mask, (slice(y0, y1), slice(x0, x1)), colour, alpha, float(near[0]))


@lru_cache(maxsize=256)
def _outlines(text: str) -> list[Floats]:
    """Return the closed lines (N, 2) of a text of height 1, centred, x right and y down."""
    from matplotlib.textpath import TextPath

    text = " ".join(text.split()).replace("$", r"\$")  # a dollar would begin a formula
    if not text:
        return []
    path: Any = TextPath((0.0, 0.0), text, size=1.0, prop=_font())
    parts = [np.asarray(part, np.float64) for part in path.to_polygons() if len(part) > 2]
    if not parts:
        return []
    points = np.concatenate(parts)
    middle = 0.5 * (points[:, 0].min() + points[:, 0].max())
    return [(part - (middle, 0.36)) * (1.0, -1.0) for part in parts]


def _font() -> Any:
    from matplotlib.font_manager import FontProperties

    return FontProperties(family="DejaVu Sans")
