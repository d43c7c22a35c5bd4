"""A picture in pixels, and the antialiased shapes and texts that are drawn on it.

Places are in pixels of the finished picture, x right and y down, a pixel's middle at halves. A
canvas may be finer than that: it is drawn so many times larger, and `finished` reduces it.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.draw.palette import EDGE, FLOOR, INK, WHITE, Rgb, mark_outline

Floats = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]
Rectangle = tuple[float, float, float, float]
"""Left, top, right, bottom."""

_SHIFT: Final = 4
_ALPHA_STEPS: Final = 32
"""Pieces of a line whose opacity differs by less than one such step are drawn as one."""
_HALO: Final = 0.85


class Canvas:
    """RGB uint8 (height, width, 3), white at first; `fine` pixels are drawn for each, per axis."""

    def __init__(self, size_px: tuple[int, int], fine: int = 1) -> None:
        width, height = size_px
        self.fine = fine
        self.pixels: Image = np.full((height * fine, width * fine, 3), 255, dtype=np.uint8)

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the finished picture."""
        height, width = self.pixels.shape[:2]
        return width // self.fine, height // self.fine

    def copy(self) -> "Canvas":
        """Return a canvas with the same on it."""
        other = Canvas((0, 0), self.fine)
        other.pixels = self.pixels.copy()
        return other

    def finished(self) -> Image:
        """Return the picture (height, width, 3), RGB."""
        import cv2

        if self.fine == 1:
            return self.pixels
        reduced: Image = cv2.resize(self.pixels, self.size_px, interpolation=cv2.INTER_AREA)
        return reduced

    def fill(self, corners_px: Floats, colour: Rgb, alpha: float = 1.0) -> None:
        """Fill a polygon (N, 2) with an opacity."""
        import cv2

        if alpha >= 1.0:
            corners = [self._fixed(corners_px)]
            cv2.fillPoly(self.pixels, corners, colour, cv2.LINE_AA, _SHIFT)
            return
        part, offset_px = self._part(corners_px, 0.0)
        if not part.size:
            return
        mask: Image = np.zeros(part.shape[:2], dtype=np.uint8)
        cv2.fillPoly(mask, [self._fixed(corners_px - offset_px)], 255, cv2.LINE_AA, _SHIFT)
        _blend(part, mask, colour, alpha)

    def tint(self, outlines_px: Sequence[Floats], colour: Rgb, alpha: float) -> None:
        """Fill the union of polygons (N, 2), evenly however many overlap."""
        import cv2

        mask: Image = np.zeros(self.pixels.shape[:2], dtype=np.uint8)
        for outline in outlines_px:
            cv2.fillPoly(mask, [self._fixed(outline)], 255, cv2.LINE_8, _SHIFT)
        left, top, width, height = cv2.boundingRect(mask)
        part = np.s_[top : top + height, left : left + width]
        _blend(self.pixels[part], mask[part], colour, alpha)

    def line(
        self,
        points_px: Floats,
        colour: Rgb,
        width_px: float = 1.0,
        alpha: float = 1.0,
        *,
        closed: bool = False,
    ) -> None:
        """Draw a line through points (N, 2), evenly opaque also where it crosses itself."""
        import cv2

        thick = self._thickness(width_px)
        if alpha >= 1.0:
            points = [self._fixed(points_px)]
            cv2.polylines(self.pixels, points, closed, colour, thick, cv2.LINE_AA, _SHIFT)
            return
        part, offset_px = self._part(points_px, width_px)
        mask: Image = np.zeros(part.shape[:2], dtype=np.uint8)
        points = [self._fixed(points_px - offset_px)]
        cv2.polylines(mask, points, closed, 255, thick, cv2.LINE_AA, _SHIFT)
        _blend(part, mask, colour, alpha)

    def fading(self, points_px: Floats, colour: Rgb, widths_px: Floats, alphas: Floats) -> None:
        """Draw a line through points (N, 2) whose pieces (N - 1,) have own widths and opacities.

        Pieces of width 0 are left out.
        """
        import cv2

        part, offset_px = self._part(points_px, float(widths_px.max()))
        mask: Image = np.zeros(part.shape[:2], dtype=np.uint8)
        steps = np.rint(alphas * _ALPHA_STEPS)
        is_other = (np.diff(steps) != 0) | (np.diff(widths_px) != 0)
        starts = [0, *(np.flatnonzero(is_other) + 1).tolist(), len(widths_px)]
        for first, stop in pairwise(starts):
            if widths_px[first] <= 0.0:
                continue
            points = [self._fixed(points_px[first : stop + 1] - offset_px)]
            strength = round(255.0 * float(steps[first]) / _ALPHA_STEPS)
            thick = self._thickness(float(widths_px[first]))
            cv2.polylines(mask, points, False, strength, thick, cv2.LINE_AA, _SHIFT)
        _blend(part, mask, colour, 1.0)

    def dashes(
        self,
        start_px: Floats,
        end_px: Floats,
        colour: Rgb,
        width_px: float = 1.0,
        alpha: float = 1.0,
        pattern_px: tuple[float, float] = (4.0, 3.0),
    ) -> None:
        """Draw a dashed line between two points (2,); the pattern is a dash and a gap."""
        length = float(np.linalg.norm(end_px - start_px))
        for begin in np.arange(0.0, length, sum(pattern_px)).tolist():
            shares = (begin / length, min((begin + pattern_px[0]) / length, 1.0))
            ends = np.array([start_px + share * (end_px - start_px) for share in shares])
            self.line(ends, colour, width_px, alpha)

    def ring(self, centre_px: Floats, radius_px: float, colour: Rgb, width_px: float) -> None:
        """Draw a circle."""
        import cv2

        x, y = (int(value) for value in self._fixed(centre_px[np.newaxis])[0])
        radius = round(radius_px * self.fine * 2**_SHIFT)
        thick = self._thickness(width_px)
        cv2.circle(self.pixels, (x, y), radius, colour, thick, cv2.LINE_AA, _SHIFT)

    def mark(
        self,
        name: str,
        centre_px: Floats,
        size_px: float,
        face: Rgb,
        edge: Rgb,
        edge_px: float = 1.4,
        alpha: float = 1.0,
    ) -> None:
        """Draw a mark of `mark_outline` about a point (2,)."""
        outline = centre_px + size_px * mark_outline(name)
        self.fill(outline, face, alpha)
        self.line(outline, edge, edge_px, alpha, closed=True)

    def text(
        self,
        text: str,
        place_px: Sequence[float],
        size_px: int,
        colour: Rgb = INK,
        *,
        anchor: tuple[float, float] = (0.0, 0.0),
        bold: bool = False,
        halo: bool = True,
    ) -> Rectangle:
        """Write a text; its rectangle, which is returned, has its share `anchor` at a place."""
        import cv2

        mask = np.pad(_text_mask(text, size_px * self.fine, bold=bold), self.fine)
        width, height = text_size(text, size_px, bold=bold)
        left = place_px[0] - anchor[0] * width
        top = place_px[1] - anchor[1] * height
        x, y = (round(value * self.fine) - self.fine for value in (left, top))
        part = self.pixels[max(y, 0) : y + mask.shape[0], max(x, 0) : x + mask.shape[1]]
        mask = mask[max(-y, 0) :, max(-x, 0) :][: part.shape[0], : part.shape[1]]
        if mask.size and min(part.shape[:2]):
            if halo:
                around: Any = np.ones((2 * self.fine + 1,) * 2, dtype=np.uint8)
                _blend(part, np.asarray(cv2.dilate(mask, around), dtype=np.uint8), FLOOR, _HALO)
            _blend(part, mask, colour, 1.0)
        return left, top, left + width, top + height

    def tag(self, text: str, place: Rectangle, size_px: int, colour: Rgb) -> None:
        """Write a text in white on a coloured plate that fills a rectangle."""
        left, top, right, bottom = place
        plate = _rounded(place, 3.0)
        self.fill(plate, colour)
        self.line(plate, WHITE, 1.0, closed=True)
        middle = (0.5 * (left + right), 0.5 * (top + bottom))
        self.text(text, middle, size_px, WHITE, anchor=(0.5, 0.5), halo=False)

    def keep_only(self, place: Rectangle) -> None:
        """Make all white again but for a rectangle."""
        left, top, right, bottom = (round(side * self.fine) for side in place)
        kept = self.pixels[top:bottom, left:right].copy()
        self.pixels[:] = 255
        self.pixels[top:bottom, left:right] = kept

    def frame(self, place: Rectangle) -> None:
        """Draw the edge of a rectangle."""
        left, top, right, bottom = place
        corners = np.array(((left, top), (right, top), (right, bottom), (left, bottom)))
        self.line(corners, EDGE, 1.0, closed=True)

    def _part(self, points_px: Floats, width_px: float) -> tuple[Image, Floats]:
        """Return the part of the canvas about points (N, 2), and where its corner lies (2,)."""
        margin = width_px + 2.0
        low = np.floor((points_px.min(axis=0) - margin) * self.fine).astype(int)
        high = np.ceil((points_px.max(axis=0) + margin) * self.fine).astype(int)
        (left, top), (right, bottom) = np.clip((low, high), 0, self.pixels.shape[1::-1])
        part: Image = self.pixels[top:bottom, left:right]
        return part, np.array((left, top), dtype=np.float64) / self.fine

    def _thickness(self, width_px: float) -> int:
        return max(1, round(width_px * self.fine))

    def _fixed(self, points_px: Floats) -> npt.NDArray[np.int32]:
        """Return points as OpenCV wants them: in sixteenths, middles of pixels at whole numbers."""
        clipped = np.clip(points_px * self.fine - 0.5, -1e4, 1e4)
        fixed: npt.NDArray[np.int32] = np.rint(clipped * 2**_SHIFT).astype(np.int32)
        return fixed


def text_size(text: str, size_px: int, *, bold: bool = False) -> tuple[int, int]:
    """Return the width and height of a text in DejaVu Sans [px]."""
    height, width = _text_mask(text, size_px, bold=bold).shape
    return width, height


def bounds_of(points_px: Floats) -> Rectangle:
    """Return the smallest rectangle about points (N, 2)."""
    (left, top), (right, bottom) = points_px.min(axis=0), points_px.max(axis=0)
    return float(left), float(top), float(right), float(bottom)


@lru_cache(maxsize=2048)
def _text_mask(text: str, size_px: int, *, bold: bool) -> Image:
    """Return the coverage (h, w) of a text; of equal texts the same array."""
    from PIL import Image as Pil
    from PIL import ImageDraw

    font = _font(size_px, bold=bold)
    left, _, right, _ = font.getbbox(text)
    ascent, descent = font.getmetrics()
    image = Pil.new("L", (max(int(right - left), 1), ascent + descent))
    ImageDraw.Draw(image).text((-left, 0), text, fill=255, font=font)
    mask: Image = np.asarray(image)
    return mask


@lru_cache(maxsize=16)
def _font(size_px: int, *, bold: bool) -> Any:
    """Return the font that matplotlib brings along."""
    import matplotlib as mpl
    from PIL import ImageFont

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    path = f"{mpl.get_data_path()}/fonts/ttf/{name}"
    return ImageFont.truetype(path, size_px, layout_engine=ImageFont.Layout.BASIC)


def _rounded(place: Rectangle, radius_px: float) -> Floats:
    """Return a rectangle with rounded corners as a polygon (N, 2)."""
    left, top, right, bottom = place
    turns = np.linspace(0.0, 0.5 * np.pi, 7)
    corners = [
        (x + dx * radius_px, y + dy * radius_px, start)
        for x, y, dx, dy, start in (
            (right, top, -1, 1, -0.5),
            (right, bottom, -1, -1, 0.0),
            (left, bottom, 1, -1, 0.5),
            (left, top, 1, 1, 1.0),
        )
    ]
    arcs = [
        np.column_stack((x + radius_px * np.cos(angles), y + radius_px * np.sin(angles)))
        for x, y, start in corners
        for angles in [start * np.pi + turns]
    ]
    outline: Floats = np.concatenate(arcs)
    return outline


def _blend(part: Image, mask: Image, colour: Rgb, alpha: float) -> None:
    """Lay a colour over a part (h, w, 3), as strongly as the mask (h, w) says, times `alpha`."""
    weight = mask.astype(np.float32)[..., np.newaxis] * (alpha / 255.0)
    laid = np.array(colour, dtype=np.float32) - part
    laid *= weight
    laid += part
    np.rint(laid, out=laid)
    part[:] = laid
