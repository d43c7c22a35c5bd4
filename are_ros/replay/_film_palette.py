"""256 colours for a film, and the way from a picture to them."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

Picture = npt.NDArray[np.uint8]

TRANSPARENT: Final = 255
_COLOURS: Final = 255
_BITS: Final = 6
_RARE_WEIGHT: Final = 0.35
"""Counts are raised to this power: a small red footprint matters as much as a white floor."""


@dataclass(frozen=True, eq=False)
class Palette:
    """RGB uint8 (256, 3), the last for transparency, and the index of each colour by six bits."""

    colours: Picture
    index_of: Picture

    @classmethod
    def of(cls, pictures: Iterable[Picture]) -> "Palette":
        """Choose colours for pictures (h, w, 3); the same pictures give the same palette."""
        sums = np.zeros((1 << (3 * _BITS), 4))
        for picture in pictures:
            keys = _keys(picture).ravel()
            for part, values in enumerate((*picture.reshape(-1, 3).T, np.ones(len(keys)))):
                sums[:, part] += np.bincount(keys, values, minlength=len(sums))
        known = np.flatnonzero(sums[:, 3])
        every = _colours_of(np.arange(len(sums), dtype=np.int64))
        every[known] = np.rint(sums[known, :3] / sums[known, 3:])
        colours = _chosen(every[known], sums[known, 3])
        return cls(colours, _nearest(colours[:_COLOURS], every))

    def indices(self, picture: Picture) -> Picture:
        """Return the index (h, w) of the nearest colour of each pixel."""
        indices: Picture = self.index_of[_keys(picture)]
        return indices


def _keys(picture: Picture) -> npt.NDArray[np.int32]:
    """Return each pixel's six upper bits of red, green and blue as one number (h, w)."""
    reduced = (picture >> (8 - _BITS)).astype(np.int32)
    keys: npt.NDArray[np.int32]
    keys = (reduced[..., 0] << (2 * _BITS)) | (reduced[..., 1] << _BITS) | reduced[..., 2]
    return keys


def _colours_of(keys: npt.NDArray[np.int64]) -> Picture:
    """Return the middle colour (N, 3) of each key."""
    mask, rest = (1 << _BITS) - 1, 8 - _BITS
    parts = np.stack((keys >> (2 * _BITS), (keys >> _BITS) & mask, keys & mask), axis=-1)
    middles: Picture = ((parts << rest) + (1 << (rest - 1))).astype(np.uint8)
    return middles


def _chosen(colours: Picture, counts: npt.NDArray[np.float64]) -> Picture:
    """Return up to 255 of colours (N, 3) by median cut, padded to 256 with black."""
    from PIL import Image

    palette = np.zeros((256, 3), dtype=np.uint8)
    if len(colours) <= _COLOURS:
        palette[: len(colours)] = colours
        return palette
    repeats = np.ceil(counts**_RARE_WEIGHT).astype(np.int64)
    pixels = np.repeat(colours, repeats, axis=0)[np.newaxis]
    image = Image.fromarray(np.ascontiguousarray(pixels))
    cut = image.quantize(_COLOURS, method=Image.Quantize.MEDIANCUT, kmeans=1)
    found = np.array(cut.getpalette(), dtype=np.uint8).reshape(-1, 3)[:_COLOURS]
    palette[: len(found)] = found
    return palette


def _nearest(colours: Picture, every: Picture) -> Picture:
    """Return for each of the colours (N, 3) of all keys the index of the nearest chosen one."""
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(colours.astype(np.float64)).query(every.astype(np.float64))
    indices: Picture = nearest.astype(np.uint8)
    return indices
