"""Map files of nav2_map_server: a YAML file beside an image, read as Jazzy's map_io reads them."""

import math
import re
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, cast

import numpy as np
import numpy.typing as npt

from are_ros.conventions import FREE, OCCUPIED, UNKNOWN
from are_ros.errors import InputError, MapError
from are_ros.wording import percent
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.yaml_text import read_yaml

_GAP: Final = rb"(?:\s|#[^\n]*\n)+"
_PGM_HEADER: Final = re.compile(
    rb"P([25])" + 3 * (_GAP + rb"(\d{1,9})") + rb"\s",
)
_PNG_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_BMP_SIGNATURE: Final = b"BM"
_IMAGE_SUFFIXES: Final = (".pgm", ".png", ".bmp")


@dataclass(frozen=True, eq=False)
class MapImage:
    """An image, row 0 at the top.

    `sums` is int64 (height, width), the sum of the colour channels, of which `full` is white;
    `opacity` is int64 (height, width), `opaque` where it hides, or None where there is no alpha.
    """

    sums: npt.NDArray[np.int64]
    full: int
    opacity: npt.NDArray[np.int64] | None = None
    opaque: int = 255


def read_map_image(path: Path) -> MapImage:
    """Return the image of a pgm, png or bmp file; MapError if it is anything else."""
    try:
        data = path.read_bytes()
    except OSError as error:
        message = f"{path}: the image cannot be read ({error.strerror})"
        raise MapError(message) from error
    if data.startswith(_PNG_SIGNATURE):
        return _raster(path, data, "png", _png_chunks(path, data))
    if data[:2] in {b"P2", b"P5"}:
        return _pgm(path, data)
    if data.startswith(_BMP_SIGNATURE):
        if len(data) < int.from_bytes(data[2:6], "little"):
            raise MapError(f"{path}: the bmp is truncated")
        return _raster(path, data, "bmp")
    raise MapError(f"{path}: the image is neither pgm (P2, P5) nor png nor bmp")


def _pgm(path: Path, data: bytes) -> MapImage:
    header = _PGM_HEADER.match(data)
    if header is None:
        raise MapError(f"{path}: the pgm header is malformed or truncated")
    kind, width, height, full = (int(text) for text in header.groups())
    if not (width and height and 0 < full < 65536):
        raise MapError(f"{path}: the pgm header says {width} x {height} pixels up to {full}")
    body, count = data[header.end() :], width * height
    samples: npt.NDArray[np.integer]
    if kind == 5:
        sample = np.dtype(np.uint8 if full < 256 else ">u2")
        held = min(count, len(body) // sample.itemsize)
        samples = np.frombuffer(body, sample, count=held)
    else:
        samples = _plain_samples(path, body, count)
    if len(samples) < count:
        raise MapError(f"{path}: the image is truncated, {len(samples)} pixels of {count}")
    if int(samples.max()) > full:
        raise MapError(f"{path}: a pixel of {int(samples.max())} exceeds the maximum of {full}")
    return MapImage(samples.reshape(height, width).astype(np.int64), full)


def _plain_samples(path: Path, body: bytes, count: int) -> npt.NDArray[np.integer]:
    words = re.sub(rb"#[^\n]*", b"", body).split(maxsplit=count)[:count]
    if not all(word.isdigit() and len(word) <= 5 for word in words):
        raise MapError(f"{path}: the plain pgm holds a pixel that is no number")
    return np.array([int(word) for word in words], dtype=np.int64)


def _raster(
    path: Path, data: bytes, kind: str, chunks: Mapping[bytes, bytes] = MappingProxyType({})
) -> MapImage:
    """Return the image of a png, by its chunks, or of a bmp.

    The fourth byte of a bmp's pixel is mostly no alpha.
    """
    image = _decoded(path, data, kind)
    channels, white = image.reshape(*image.shape[:2], -1), int(np.iinfo(image.dtype).max)
    clear = _transparent_grey(chunks)
    if clear is not None and channels.shape[2] == 1:
        alpha = np.where(channels == clear, 0, white)
        channels = np.concatenate((channels, channels, channels, alpha), axis=2)
    colours = channels[:, :, :3]
    sums = colours.sum(axis=2, dtype=np.int64)
    has_alpha = kind == "png" and channels.shape[2] == 4
    opacity = channels[:, :, 3].astype(np.int64) if has_alpha else None
    return MapImage(sums, white * colours.shape[2], opacity, white)


def _decoded(path: Path, data: bytes, kind: str) -> npt.NDArray[np.integer]:
    import cv2

    image = None
    with suppress(cv2.error):
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise MapError(f"{path}: the {kind} cannot be decoded")
    return cast("npt.NDArray[np.integer]", image)


def _transparent_grey(chunks: Mapping[bytes, bytes]) -> int | None:
    """Return the grey, as it is decoded, that stands for no opacity, None where none does.

    OpenCV heeds it in a png of colours, not in one of greys.
    """
    header, key = chunks.get(b"IHDR", b""), chunks.get(b"tRNS", b"")
    if len(header) < 10 or header[9] or len(key) != 2:
        return None
    full = (1 << header[8]) - 1
    grey = int.from_bytes(key, "big") & full
    return grey if full > 255 else grey * 255 // full


def _png_chunks(path: Path, data: bytes) -> dict[bytes, bytes]:
    """Return the first chunk of each name; MapError where one is damaged or missing.

    A decoder may fill up what is missing without a word.
    """
    chunks: dict[bytes, bytes] = {}
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
        chunks.setdefault(name, body)
        position = end
    return chunks


class MapMode(Enum):
    """How brightness becomes occupancy; the names are those of the YAML field `mode`."""

    TRINARY = "trinary"
    SCALE = "scale"
    RAW = "raw"


@dataclass(frozen=True)
class _Metadata:
    image: Path
    resolution_m: float
    origin: tuple[float, float, float]
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: MapMode


def read_map_file(path: Path, frame_id: str = "map") -> OccupancyGrid:
    """Return the grid of a YAML map file; the image's lowest row becomes row 0.

    With `occ` the darkness of a pixel (its brightness where `negate` is set) in 0..1, trinary
    maps occ > occupied_thresh to occupied, occ < free_thresh to free, the rest to unknown; an
    alpha channel is averaged in with the colours, as map_io does. Scale spreads what lies
    between the thresholds over 0..100, and takes what is not opaque as unknown. Raw takes the
    brightness 0..100 of 255 as the value itself. The resolution is in single precision, as in the
    messages of map_server. Raises MapError: file, field and reason.
    """
    metadata = _read_metadata(path)
    try:
        image = read_map_image(metadata.image)
    except MapError as error:
        raise MapError(f"{path}: {error}") from error
    x, y, yaw = metadata.origin
    try:
        return OccupancyGrid.checked(
            np.flipud(_cells(image, metadata)),
            width=image.sums.shape[1],
            height=image.sums.shape[0],
            resolution_m=metadata.resolution_m,
            origin_xyz_m=(x, y, 0.0),
            origin_rotation_xyzw=(0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)),
            frame_id=frame_id,
            source=str(path),
        )
    except InputError as error:
        raise MapError(str(error)) from error


_GREY: Final = 205
"""What map_saver and slam_toolbox write for unknown cells."""


def doubt_about_unknown(path: Path) -> str:
    """Return a sentence if a trinary map file makes the grey of unknown cells free; else "".

    `free_thresh: 0.25`, the default of map_saver, does so, and map_io reads it so; as does an
    opaque alpha channel, which counts as brightness. Raises MapError.
    """
    metadata = _read_metadata(path)
    if metadata.mode is not MapMode.TRINARY:
        return ""
    image = read_map_image(metadata.image)
    cells, is_grey = _cells(image, metadata), image.sums * 255 == _GREY * image.full
    if not is_grey.any() or (cells == UNKNOWN).any() or (cells[is_grey] != FREE).any():
        return ""
    of_grey = _table(np.array([_GREY / 255.0]), metadata)
    cause, remedy = f"free_thresh {metadata.free_thresh:g} makes", "with 0.196"
    if of_grey[0] != FREE:
        cause = f"the alpha channel of {metadata.image.name} counts as brightness, and makes"
        remedy = "without the channel"
    return (
        f"{path}: {cause} the grey of unknown cells free, "
        f"{percent(float(is_grey.mean()))} of the map, and nothing is unknown: {remedy} they stay "
        "unknown"
    )


def _cells(image: MapImage, metadata: _Metadata) -> npt.NDArray[np.int8]:
    """Return the cells by a table over every sum of channels that can occur."""
    sums, full = image.sums, image.full
    if image.opacity is not None and metadata.mode is MapMode.TRINARY:
        sums, full = sums + image.opacity, full + image.opaque
    cells = _table(np.arange(full + 1) / full, metadata)[sums]
    if image.opacity is not None and metadata.mode is MapMode.SCALE:
        cells[image.opacity != image.opaque] = UNKNOWN
    return cells


def _table(shade: npt.NDArray[np.float64], metadata: _Metadata) -> npt.NDArray[np.int8]:
    """Return the cell value of each brightness in 0..1."""
    if metadata.mode is MapMode.RAW:
        # C++ rounds a half away from zero, numpy to the even one
        value = np.floor(shade * 255.0 + 0.5)
        return np.where(value <= OCCUPIED, value, UNKNOWN).astype(np.int8)
    occ = shade if metadata.negate else 1.0 - shade
    low, high = metadata.free_thresh, metadata.occupied_thresh
    between = np.full(occ.shape, float(UNKNOWN))
    if metadata.mode is MapMode.SCALE:
        between = np.rint((occ - low) / (high - low) * 100.0)
    cells = np.where(occ > high, OCCUPIED, np.where(occ < low, FREE, between))
    return cells.astype(np.int8)


def _read_metadata(path: Path) -> _Metadata:
    fields = _read_yaml(path)
    origin = fields.get("origin")
    if not isinstance(origin, list) or len(origin) != 3:
        raise MapError(f"{path}: origin must be three numbers [x, y, yaw], it is {origin!r}")
    x_m, y_m, yaw_rad = (_number(path, "origin", value) for value in origin)
    metadata = _Metadata(
        image=_image_path(path, fields),
        resolution_m=_single(_number(path, "resolution", fields.get("resolution"))),
        origin=(x_m, y_m, yaw_rad),
        negate=_negate(path, fields.get("negate")),
        occupied_thresh=_number(path, "occupied_thresh", fields.get("occupied_thresh")),
        free_thresh=_number(path, "free_thresh", fields.get("free_thresh")),
        mode=_mode(path, fields.get("mode", MapMode.TRINARY.value)),
    )
    _check_thresholds(path, metadata)
    return metadata


def _read_yaml(path: Path) -> Mapping[str, Any]:
    if path.suffix.lower() in _IMAGE_SUFFIXES:
        raise MapError(
            f"{path}: this is the map's image; give the .yaml file that names it, with its"
            " resolution and origin"
        )
    fields = read_yaml(path, f"{path}: the map file", MapError)
    if not isinstance(fields, dict):
        raise MapError(f"{path}: the map file is no mapping of fields to values")
    for key in ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh"):
        if key not in fields:
            raise MapError(f"{path}: the field {key} is missing")
    return fields


def _image_path(path: Path, fields: Mapping[str, Any]) -> Path:
    image = fields.get("image")
    if not isinstance(image, str) or not image or "\0" in image:
        raise MapError(f"{path}: image must name a file, it is {image!r}")
    return path.parent / image


def _number(path: Path, field: str, value: object) -> float:
    """Return a finite number; a quoted one is a string for YAML, and a number for yaml-cpp."""
    number = math.nan
    if isinstance(value, int | float | str) and not isinstance(value, bool):
        try:
            number = float(value)
        except (ValueError, OverflowError):
            number = math.nan
    if not math.isfinite(number):
        raise MapError(f"{path}: {field} must be a finite number, it is or holds {value!r}")
    return number


def _single(number: float) -> float:
    """Return the number in the precision of nav_msgs/MapMetaData: cells lie where others see them.

    A hundred metres from the origin they are a micrometre aside.
    """
    with np.errstate(over="ignore"):
        return float(np.float32(number))


def _negate(path: Path, value: object) -> bool:
    if not isinstance(value, int) or value not in {0, 1}:
        raise MapError(f"{path}: negate must be 0 or 1, it is {value!r}")
    return bool(value)


def _mode(path: Path, value: object) -> MapMode:
    try:
        return MapMode(str(value).lower())
    except ValueError as error:
        message = f"{path}: mode must be trinary, scale or raw, it is {value!r}"
        raise MapError(message) from error


def _check_thresholds(path: Path, metadata: _Metadata) -> None:
    low, high = metadata.free_thresh, metadata.occupied_thresh
    if low > high or (low == high and metadata.mode is MapMode.SCALE):
        raise MapError(f"{path}: free_thresh {low} is not below occupied_thresh {high}")
