"""Films as files, picture by picture: GIF, WebP (lossless) and MP4, by the suffix."""

from collections.abc import Callable, Mapping
from pathlib import Path
from struct import Struct
from types import TracebackType
from typing import Any, BinaryIO, Final, Protocol

import numpy as np
import numpy.typing as npt

from are_ros.errors import BagError
from are_ros.replay._film_lzw import compressed
from are_ros.replay._film_palette import TRANSPARENT, Palette

Picture = npt.NDArray[np.uint8]
Box = tuple[int, int, int, int]

_SHORT2, _SHORT4 = Struct("<2H"), Struct("<4H")
_GIF_CONTROL, _GIF_KEEP = b"\x21\xf9\x04", 0b0000_0101
"""Each picture stays under the next, whose index `TRANSPARENT` lets it through."""

_GIF_FOR_EVER: Final = b"\x21\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00"
_NOTICEABLE: Final = 3
"""A pixel whose colour changes by no more than this keeps the old one."""

_WEBP_HEAD: Final = 12
_WEBP_LOSSLESS: Final = 101


class FilmWriter(Protocol):
    """Takes the pictures of a film, RGB (h, w, 3), all of one size; closed by `close`."""

    def add(self, picture: Picture) -> None:
        """Append a picture."""

    def close(self) -> None:
        """Finish the file."""

    @property
    def written_bytes(self) -> int:
        """How long the file is so far."""


class _Changes:
    """What changes from picture to picture, in a palette."""

    def __init__(self, palette: Palette) -> None:
        self._palette = palette
        self._shown: Picture | None = None
        colours = palette.colours.astype(np.int16)
        apart = np.abs(colours[:, np.newaxis] - colours).max(axis=2)
        self._is_change = (apart > _NOTICEABLE).reshape(-1)

    def next(self, picture: Picture) -> tuple[Picture, Box]:
        """Return the indices (h, w) of what changed, and where: x, y, width, height.

        What did not is `TRANSPARENT`; of a picture that is like the last a pixel is given.
        """
        indices = self._palette.indices(picture)
        if self._shown is None:
            self._shown = indices
            return indices, (0, 0, indices.shape[1], indices.shape[0])
        changed = self._is_change[(self._shown.astype(np.uint16) << 8) | indices]
        self._shown = np.where(changed, indices, self._shown)
        x, y, width, height = _box_of(changed)
        part = (slice(y, y + height), slice(x, x + width))
        return np.where(changed[part], indices[part], np.uint8(TRANSPARENT)), (x, y, width, height)


class GifWriter:
    """A GIF that repeats for ever."""

    def __init__(self, file: BinaryIO, size: tuple[int, int], fps: int, palette: Palette) -> None:
        self._file = file
        self._delay = round(100 / fps)
        self._changes = _Changes(palette)
        file.write(b"GIF89a" + _SHORT2.pack(*size) + b"\xf7\0\0")
        file.write(palette.colours.tobytes() + _GIF_FOR_EVER)

    @property
    def written_bytes(self) -> int:
        """How long the file is so far."""
        return self._file.tell()

    def add(self, picture: Picture) -> None:
        """Append what is new in a picture."""
        indices, box = self._changes.next(picture)
        control = bytes((_GIF_KEEP, *divmod(self._delay, 256)[::-1], TRANSPARENT, 0))
        self._file.write(_GIF_CONTROL + control + b"," + _SHORT4.pack(*box) + b"\0")
        self._file.write(compressed(indices))

    def close(self) -> None:
        """Write the end."""
        self._file.write(b";")


class WebpWriter:
    """An animated WebP that repeats for ever, its pictures lossless."""

    def __init__(self, file: BinaryIO, size: tuple[int, int], fps: int, palette: Palette) -> None:
        self._file, self._palette = file, palette
        self._duration_ms = round(1000 / fps)
        self._changes = _Changes(palette)
        animated_with_alpha = b"\x12\0\0\0"
        extent = _three(size[0] - 1) + _three(size[1] - 1)
        file.write(b"RIFF\0\0\0\0WEBP" + _chunk(b"VP8X", animated_with_alpha + extent))
        file.write(_chunk(b"ANIM", b"\xff\xff\xff\xff\0\0"))

    @property
    def written_bytes(self) -> int:
        """How long the file is so far."""
        return self._file.tell()

    def add(self, picture: Picture) -> None:
        """Append what is new in a picture; its corner must be at even pixels."""
        indices, (x, y, width, height) = self._changes.next(picture)
        padded = np.pad(indices, ((y % 2, 0), (x % 2, 0)), constant_values=TRANSPARENT)
        corner = _three(x // 2) + _three(y // 2)
        extent = _three(width + x % 2 - 1) + _three(height + y % 2 - 1)
        head = corner + extent + _three(self._duration_ms) + b"\0"
        self._file.write(_chunk(b"ANMF", head + self._encoded(padded)))

    def close(self) -> None:
        """Write the length into the head."""
        length = self._file.tell()
        self._file.seek(4)
        self._file.write((length - 8).to_bytes(4, "little"))
        self._file.seek(length)

    def _encoded(self, indices: Picture) -> bytes:
        """Return the chunks of a still picture."""
        import cv2

        bgra = np.zeros((*indices.shape, 4), dtype=np.uint8)
        bgra[..., :3] = self._palette.colours[indices][..., ::-1]
        bgra[..., 3] = np.where(indices == TRANSPARENT, 0, 255)
        _, data = cv2.imencode(".webp", bgra, (cv2.IMWRITE_WEBP_QUALITY, _WEBP_LOSSLESS))
        return _image_chunks(data.tobytes()[_WEBP_HEAD:])


class Mp4Writer:
    """An MP4 (MPEG-4 part 2): for players, web browsers do not show it."""

    def __init__(self, path: Path, size: tuple[int, int], fps: int) -> None:
        import cv2

        self._path = path
        self._video: Any = cv2.VideoWriter(
            str(path), cv2.VideoWriter.fourcc(*"mp4v"), float(fps), size
        )
        if not self._video.isOpened():
            raise BagError(f"{path}: OpenCV cannot write MP4 here; .gif and .webp always work")

    @property
    def written_bytes(self) -> int:
        """How long the file is so far."""
        return self._path.stat().st_size

    def add(self, picture: Picture) -> None:
        """Append a picture."""
        self._video.write(np.ascontiguousarray(picture[..., ::-1]))

    def close(self) -> None:
        """Finish the file."""
        self._video.release()


class OpenFilm:
    """A film being written, a context manager: closed in the end, and removed on failure."""

    def __init__(self, path: Path, size: tuple[int, int], fps: int, palette: Palette) -> None:
        self._path, self._arguments = path, (size, fps, palette)
        self._file: BinaryIO | None = None
        self._writer: FilmWriter | None = None

    def __enter__(self) -> FilmWriter:
        """Open the file. Raises OSError, or BagError where there is no encoder."""
        size, fps, palette = self._arguments
        if self._path.suffix == ".mp4":
            self._path.write_bytes(b"")  # what the system refuses is said by itself, not by OpenCV
            self._writer = Mp4Writer(self._path, size, fps)
        else:
            self._file = self._path.open("wb")
            kind = _STREAMED[self._path.suffix]
            self._writer = kind(self._file, size, fps, palette)
        return self._writer

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._writer is not None:
            self._writer.close()
        if self._file is not None:
            self._file.close()
        if kind is not None:
            self._path.unlink(missing_ok=True)


_STREAMED: Final[Mapping[str, Callable[[BinaryIO, tuple[int, int], int, Palette], FilmWriter]]] = {
    ".gif": GifWriter,
    ".webp": WebpWriter,
}


def _box_of(changed: npt.NDArray[np.bool_]) -> Box:
    """Return x, y, width and height of what changed, at least one pixel."""
    rows, cols = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
    if not len(rows):
        return 0, 0, 1, 1
    x, y = int(cols[0]), int(rows[0])
    return x, y, int(cols[-1]) + 1 - x, int(rows[-1]) + 1 - y


def _three(value: int) -> bytes:
    return value.to_bytes(3, "little")


def _chunk(name: bytes, content: bytes) -> bytes:
    padding = b"\0" * (len(content) % 2)
    return name + len(content).to_bytes(4, "little") + content + padding


def _image_chunks(data: bytes) -> bytes:
    """Return the chunks of a still WebP that hold its picture, without the extended head."""
    found, at = b"", 0
    while at + 8 <= len(data):
        length = int.from_bytes(data[at + 4 : at + 8], "little")
        end = at + 8 + length + length % 2
        if data[at : at + 4] in {b"ALPH", b"VP8 ", b"VP8L"}:
            found += data[at:end]
        at = end
    return found
