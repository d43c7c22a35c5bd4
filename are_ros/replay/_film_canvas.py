"""Where a film draws: a map seen from above in pixels, and what is drawn on it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.replay._picture_map import KnownPart, Window, map_from_part, shaded
from are_ros.world.occupancy_grid import OccupancyGrid

Floats = npt.NDArray[np.float64]
Picture = npt.NDArray[np.uint8]
Rgb = tuple[int, int, int]

PAPER: Final[Rgb] = (236, 238, 240)
FLOOR: Final[Rgb] = (252, 252, 251)
INK: Final[Rgb] = (35, 40, 46)
HEADER_PX, FOOTER_PX = 30, 26
_SHIFT: Final = 4
_DASH_PX: Final = (7.0, 4.0)
"""From dash to dash, and how long one is."""
_FINE: Final = 3
"""The map is drawn so many times larger, and then reduced."""


@dataclass(frozen=True)
class Stage:
    """The rectangle of the map's frame that is shown, below a header and above a footer."""

    window: Window
    px_per_m: float

    @classmethod
    def of(cls, window: Window, largest_px: tuple[int, int]) -> "Stage":
        """Show a window as large as fits into so many pixels."""
        scale = min(largest_px[0] / window.width_m, largest_px[1] / window.height_m)
        return cls(window, scale)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the whole picture, both even, as films want them."""
        width = max(round(self.window.width_m * self.px_per_m), 360)
        height = round(self.window.height_m * self.px_per_m) + HEADER_PX + FOOTER_PX
        return width + width % 2, height + height % 2

    def pixels(self, points_m: npt.ArrayLike) -> Floats:
        """Return where points (..., 2) of the map are: x right, y down."""
        points = np.asarray(points_m, dtype=np.float64)
        corner = np.array((self.window.left, self.window.top))
        pixels: Floats = (points - corner) * (self.px_per_m, -self.px_per_m)
        pixels[..., 1] += HEADER_PX
        return pixels

    def background(self, grid: OccupancyGrid, part: KnownPart) -> Picture:
        """Return the map on the paper, with header and footer left free."""
        import cv2

        width, height = self.size
        image, factor = shaded(part, 72.0 / 100.0 * self.px_per_m * grid.resolution_m)
        corners = self.pixels(map_from_part(grid, part, [(0, 0), (factor, 0), (0, factor)]))
        columns = np.column_stack((corners[1] - corners[0], corners[2] - corners[0], corners[0]))
        # Centres of pixels lie at whole numbers for OpenCV, and at halves for us.
        columns[:, 2] += 0.5 * (columns[:, 0] + columns[:, 1])
        columns = _FINE * columns
        columns[:, 2] -= 0.5
        size = (width * _FINE, height * _FINE)
        fine = cv2.warpAffine(image, columns, size, flags=cv2.INTER_NEAREST)
        paper = np.array(PAPER, dtype=np.uint8)
        laid = np.where(fine[..., 3:] > 0, fine[..., :3], paper)
        reduced: Picture = cv2.resize(laid, (width, height), interpolation=cv2.INTER_AREA)
        reduced[:HEADER_PX], reduced[height - FOOTER_PX :] = 255, 255
        return reduced


def mixed(colour: Rgb, share: float, ground: Rgb = FLOOR) -> Rgb:
    """Return a colour laid over a ground with an opacity of `share`."""
    pairs = zip(colour, ground, strict=True)
    red, green, blue = (round(share * a + (1.0 - share) * b) for a, b in pairs)
    return red, green, blue


def fill(picture: Picture, corners_px: Floats, colour: Rgb, share: float = 1.0) -> None:
    """Fill a polygon (N, 2) with an opacity."""
    import cv2

    low = np.floor(corners_px.min(axis=0)).astype(int) - 1
    high = np.ceil(corners_px.max(axis=0)).astype(int) + 2
    (left, top), (right, bottom) = np.clip((low, high), 0, picture.shape[1::-1])
    if right <= left or bottom <= top:
        return
    mask = np.zeros((bottom - top, right - left), dtype=np.uint8)
    cv2.fillPoly(mask, [_fixed(corners_px - (left, top))], 255, cv2.LINE_AA, _SHIFT)
    _blend(picture[top:bottom, left:right], mask, colour, share)


def line(
    picture: Picture, points_px: Floats, colour: Rgb, width_px: int = 1, *, closed: bool = False
) -> None:
    """Draw a line through points (N, 2)."""
    import cv2

    cv2.polylines(picture, [_fixed(points_px)], closed, colour, width_px, cv2.LINE_AA, _SHIFT)


def dashed(picture: Picture, start_px: Floats, end_px: Floats, colour: Rgb) -> None:
    """Draw a dashed line between two points (2,)."""
    length = float(np.linalg.norm(end_px - start_px))
    for begin in np.arange(0.0, length, _DASH_PX[0]).tolist():
        shares = (begin / length, min((begin + _DASH_PX[1]) / length, 1.0))
        line(picture, np.array([start_px + a * (end_px - start_px) for a in shares]), colour)


def ring(picture: Picture, centre_px: Floats, radius_px: float, colour: Rgb, width_px: int) -> None:
    """Draw a circle."""
    import cv2

    x, y = (int(value) for value in _fixed(centre_px[np.newaxis])[0])
    radius = round(radius_px * 2**_SHIFT)
    cv2.circle(picture, (x, y), radius, colour, width_px, cv2.LINE_AA, _SHIFT)


def write(
    picture: Picture, text: str, place_px: Sequence[float], size_px: int, colour: Rgb
) -> None:
    """Write a text with a light halo, its left upper corner at a place."""
    import cv2

    mask = np.pad(text_mask(text, size_px), 1)
    x, y = round(place_px[0]) - 1, round(place_px[1]) - 1
    left, top = max(x, 0), max(y, 0)
    part = picture[top : y + mask.shape[0], left : x + mask.shape[1]]
    mask = mask[top - y :, left - x :][: part.shape[0], : part.shape[1]]
    if mask.size:
        halo = cv2.dilate(mask, np.ones((3, 3), dtype=np.uint8))
        _blend(part, halo, FLOOR, 0.85)
        _blend(part, mask, colour, 1.0)


@lru_cache(maxsize=2048)
def text_mask(text: str, size_px: int, *, bold: bool = False) -> Picture:
    """Return the coverage (h, w) of a text in DejaVu Sans; of equal texts the same array."""
    font = _font(size_px, bold=bold)
    left, _, right, _ = font.getbbox(text)
    ascent, descent = font.getmetrics()
    from PIL import Image, ImageDraw

    image = Image.new("L", (max(int(right - left), 1), ascent + descent))
    ImageDraw.Draw(image).text((-left, 0), text, fill=255, font=font)
    mask: Picture = np.asarray(image)
    return mask


@lru_cache(maxsize=8)
def _font(size_px: int, *, bold: bool) -> Any:
    """Return the font that matplotlib brings along."""
    import matplotlib as mpl
    from PIL import ImageFont

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    path = f"{mpl.get_data_path()}/fonts/ttf/{name}"
    return ImageFont.truetype(path, size_px, layout_engine=ImageFont.Layout.BASIC)


def _fixed(points_px: Floats) -> npt.NDArray[np.int32]:
    """Return points as OpenCV wants them: in sixteenths, centres of pixels at whole numbers."""
    clipped = np.clip(points_px - 0.5, -1e4, 1e4)
    fixed: npt.NDArray[np.int32] = np.rint(clipped * 2**_SHIFT).astype(np.int32)
    return fixed


def _blend(part: Picture, mask: Picture, colour: Rgb, share: float) -> None:
    weight = mask.astype(np.float32)[..., np.newaxis] * (share / 255.0)
    laid = part + weight * (np.array(colour, dtype=np.float32) - part)
    part[:] = np.rint(laid).astype(np.uint8)
