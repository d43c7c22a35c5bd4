"""Images of map files: pgm (P2, P5) and png, as the sums of their channels."""

import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import MapError

_GAP: Final = rb"(?:\s|#[^\n]*\n)+"
_PGM_HEADER: Final = re.compile(
    rb"P([25])" + 3 * (_GAP + rb"(\d{1,9})") + rb"\s",
)
_PNG_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True, eq=False)
class MapImage:
    """An image, row 0 at the top.

    `sums` is int64 (height, width), the sum of the colour channels, of which `full` is white;
    `opacity` is uint8 (height, width), 255 opaque, or None where the image has no alpha.
    """

    sums: npt.NDArray[np.int64]
    full: int
    opacity: npt.NDArray[np.uint8] | None = None


def read_map_image(path: Path) -> MapImage:
    """Return the image of a pgm or png file, 8 bits a channel; MapError if it is anything else."""
    try:
        data = path.read_bytes()
    except OSError as error:
        message = f"{path}: the image cannot be read ({error.strerror})"
        raise MapError(message) from error
    if data.startswith(_PNG_SIGNATURE):
        return _png(path, data)
    if data[:2] in {b"P2", b"P5"}:
        return _pgm(path, data)
    raise MapError(f"{path}: the image is neither pgm (P2, P5) nor png")


def _pgm(path: Path, data: bytes) -> MapImage:
    header = _PGM_HEADER.match(data)
    if header is None:
        raise MapError(f"{path}: the pgm header is malformed or truncated")
    kind, width, height, full = (int(text) for text in header.groups())
    if full > 255:
        raise MapError(f"{path}: samples up to {full} are 16 bit, only 8 bit images are supported")
    if not (width and height and full):
        raise MapError(f"{path}: the pgm header says {width} x {height} pixels up to {full}")
    body, count = data[header.end() :], width * height
    samples = _binary_samples(body, count) if kind == 5 else _plain_samples(path, body, count)
    if len(samples) < count:
        raise MapError(f"{path}: the image is truncated, {len(samples)} pixels of {count}")
    if int(samples.max()) > full:
        raise MapError(f"{path}: a pixel of {int(samples.max())} exceeds the maximum of {full}")
    return MapImage(samples.reshape(height, width).astype(np.int64), full)


def _binary_samples(body: bytes, count: int) -> npt.NDArray[np.integer]:
    return np.frombuffer(body[:count], dtype=np.uint8)


def _plain_samples(path: Path, body: bytes, count: int) -> npt.NDArray[np.integer]:
    words = re.sub(rb"#[^\n]*", b"", body).split(maxsplit=count)[:count]
    if not all(word.isdigit() and len(word) <= 5 for word in words):
        raise MapError(f"{path}: the plain pgm holds a pixel that is no number")
    return np.array([int(word) for word in words], dtype=np.int64)


def _png(path: Path, data: bytes) -> MapImage:
    _check_png(path, data)
    import cv2

    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        message = f"{path}: the png cannot be decoded"
        raise MapError(message) from error
    if image is None:
        raise MapError(f"{path}: the png cannot be decoded")
    channels = image.reshape(*image.shape[:2], -1)
    colours = channels[:, :, :3]
    sums = colours.sum(axis=2, dtype=np.int64)
    opacity = channels[:, :, 3] if channels.shape[2] == 4 else None
    return MapImage(sums, 255 * colours.shape[2], opacity)


def _check_png(path: Path, data: bytes) -> None:
    """Walk the chunks: a decoder may fill up what is missing without a word."""
    position = len(_PNG_SIGNATURE)
    name = b""
    while name != b"IEND":
        length = int.from_bytes(data[position : position + 4], "big")
        end = position + 12 + length
        if end > len(data):
            raise MapError(f"{path}: the png is truncated")
        name, body = data[position + 4 : position + 8], data[position + 8 : end - 4]
        if zlib.crc32(name + body) != int.from_bytes(data[end - 4 : end], "big"):
            raise MapError(f"{path}: the png is corrupt (checksum)")
        if name == b"IHDR" and body[8:9] == b"\x10":
            raise MapError(f"{path}: the png has 16 bits a channel, only 8 are supported")
        position = end
