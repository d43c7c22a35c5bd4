"""Map files: the modes against a pixel-by-pixel twin, real maps, and every bad input."""

import math
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.errors import MapError
from are_ros.world.map_io import doubt_about_unknown, read_map_file
from are_ros.world.occupancy_grid import OccupancyGrid, classify

FIELDS = {
    "image": "a.pgm",
    "resolution": "0.05",
    "origin": "[1.0, -2.0, 0.5]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}
PGM = b"P5\n# a comment\n3 2\n255\n" + bytes([0, 205, 254, 254, 100, 60])


def write_map(
    folder: Path, content: bytes = PGM, fields: Mapping[str, str | None] | None = None
) -> Path:
    """Write a map file and its image, with fields changed or (None) left out."""
    (folder / "a.pgm").write_bytes(content)
    path = folder / "a.yaml"
    lines = {**FIELDS, **(fields or {})}.items()
    path.write_text("".join(f"{key}: {value}\n" for key, value in lines if value is not None))
    return path


def write_png(folder: Path, pixels: npt.NDArray[Any], **fields: str) -> Path:
    """Write a map file whose image is a png of these pixels (grey, BGR or BGRA)."""
    assert cv2.imwrite(str(folder / "b.png"), pixels)
    return write_map(folder, fields={**fields, "image": "b.png"})


def brightness(values: list[int], mode: str) -> float:
    """Return how bright a pixel is in 0..1; trinary counts opacity as one more channel."""
    colours = values[:3] if len(values) > 1 else values * 3
    channels = colours + values[3:] if mode == "trinary" else colours
    return sum(channels) / len(channels) / 255


def twin(shade: float, mode: str, negate: bool, *, opaque: bool = True) -> int:
    """Return one cell as map_io's loop over the pixels makes it, thresholds 0.196 and 0.65."""
    if mode == "raw":
        value = math.floor(shade * 255 + 0.5)
        return value if value <= 100 else -1
    occ = shade if negate else 1 - shade
    if mode == "scale" and not opaque:
        return -1
    if occ > 0.65:
        return 100
    if occ < 0.196:
        return 0
    return -1 if mode == "trinary" else round((occ - 0.196) / (0.65 - 0.196) * 100)


def test_the_lowest_row_of_the_image_is_row_0(tmp_path: Path) -> None:
    """Black is occupied, white free, 205 unknown at the usual thresholds."""
    grid = read_map_file(write_map(tmp_path), "world")
    assert grid.cells.tolist() == [[0, -1, 100], [100, -1, 0]]
    assert (grid.resolution_m, grid.frame_id) == (float(np.float32(0.05)), "world")
    assert grid.origin.translation_m.tolist() == [1.0, -2.0, 0.0]
    assert grid.origin.yaw_rad() == pytest.approx(0.5)


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", ["0", "1", "true", "false"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_every_pixel_is_what_map_io_makes_of_it(
    tmp_path: Path, mode: str, negate: str, channels: int
) -> None:
    """All grey levels, colours and opacities agree with the loop over pixels."""
    pixels = np.random.default_rng(5).integers(0, 256, (16, 16, channels), dtype=np.uint8)
    pixels[:, :8, 3:] = 255
    if channels == 1:
        pixels = np.arange(256, dtype=np.uint8).reshape(16, 16, 1)
    path = write_png(tmp_path, pixels, mode=mode, negate=negate)
    grid = read_map_file(path, "map")
    for row in range(16):
        for col in range(16):
            values = [int(value) for value in pixels[15 - row, col]]
            shade, opaque = brightness(values, mode), values[3:] in ([], [255])
            expected = twin(shade, mode, negate in {"1", "true"}, opaque=opaque)
            assert grid.cells[row, col] == expected, values


@settings(deadline=None)
@given(width=st.integers(1, 9), height=st.integers(1, 9), full=st.integers(1, 255), data=st.data())
def test_plain_and_binary_pgm_agree(
    tmp_path_factory: pytest.TempPathFactory,
    width: int,
    height: int,
    full: int,
    data: st.DataObject,
) -> None:
    """P2 and P5 of the same samples, also with another maximum than 255, are one map."""
    size = width * height
    samples = data.draw(st.lists(st.integers(0, full), min_size=size, max_size=size))
    head = f"{width} # w\n{height}\n{full}\n"
    folder = tmp_path_factory.mktemp("pgm")
    plain = f"P2 {head}" + "\n".join(f"{value} # v" for value in samples)
    binary = f"P5\n# c\n{head}".encode() + bytes(samples)
    grids = [
        read_map_file(write_map(folder, image, {"mode": "scale"}), "map")
        for image in (plain.encode(), binary)
    ]
    assert np.array_equal(grids[0].cells, grids[1].cells)
    expected = [twin(value / full, "scale", negate=False) for value in samples]
    assert np.flipud(grids[0].cells).ravel().tolist() == expected


def test_numbers_are_read_as_yaml_cpp_reads_them(tmp_path: Path) -> None:
    """5e-2 is a number for map_server, though YAML 1.1 calls it a string; modes ignore case."""
    grid = read_map_file(
        write_map(tmp_path, fields={"resolution": "5e-2", "mode": "Trinary"}), "map"
    )
    assert grid.resolution_m == float(np.float32(0.05))


@pytest.mark.parametrize(
    ("fields", "pixels", "is_said"),
    [
        ({"free_thresh": "0.25"}, (0, 205, 254, 205, 254, 254), True),
        ({"free_thresh": "0.196"}, (0, 205, 254, 205, 254, 254), False),
        ({"free_thresh": "0.25"}, (0, 205, 254, 150, 254, 254), False),
        ({"free_thresh": "0.25"}, (0, 254, 254, 254, 254, 254), False),
        ({"free_thresh": "0.25", "mode": "scale"}, (0, 205, 254, 205, 254, 254), False),
    ],
)
def test_a_grey_of_unknown_cells_that_becomes_free_is_said(
    tmp_path: Path, fields: dict[str, str], pixels: tuple[int, ...], is_said: bool
) -> None:
    """With map_saver's own default of 0.25; not where anything is unknown."""
    doubt = doubt_about_unknown(write_map(tmp_path, PGM[:-6] + bytes(pixels), fields))
    assert bool(doubt) == is_said
    if is_said:
        assert "makes the grey of unknown cells free, 33.3 % of the map" in doubt


def test_an_alpha_channel_that_makes_unknown_cells_free_is_said(tmp_path: Path) -> None:
    """As of a map that went through a drawing program: map_server counts opacity as brightness."""
    grey = np.array([[0, 205, 254], [205, 254, 254]], np.uint8)
    opaque = np.dstack((grey, grey, grey, np.full_like(grey, 255)))
    path = write_png(tmp_path, opaque)
    assert (read_map_file(path, "map").cells == 0).sum() == 5
    doubt = doubt_about_unknown(path)
    assert "the alpha channel of b.png counts as brightness, and makes the grey" in doubt
    assert doubt.endswith("nothing is unknown: without the channel they stay unknown")
    assert not doubt_about_unknown(write_png(tmp_path, opaque[:, :, :3]))


def test_an_absolute_image_path_is_taken_as_it_is(tmp_path: Path) -> None:
    """Only a relative path starts at the map file's folder."""
    (tmp_path / "deep").mkdir()
    path = write_map(tmp_path / "deep", b"", {"image": str(tmp_path / "c.pgm")})
    (tmp_path / "c.pgm").write_bytes(PGM)
    assert read_map_file(path, "map").width == 3


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        *[({key: None}, f"field {key} is missing") for key in FIELDS],
        ({"resolution": ".nan"}, "resolution must be a finite number"),
        ({"resolution": "fine"}, "resolution must be a finite number"),
        ({"resolution": "true"}, "resolution must be a finite number"),
        ({"resolution": "[1]"}, "resolution must be a finite number"),
        ({"resolution": "1" * 400}, "is too large a number"),
        ({"resolution": "1e400"}, "resolution must be a finite number"),
        ({"resolution": "0"}, ": resolution is 0, it must"),
        ({"origin": "[0, 0]"}, "origin must be three numbers"),
        ({"origin": "3"}, "origin must be three numbers"),
        ({"origin": "[0, 0, .inf]"}, "origin must be a finite number"),
        ({"origin": "[0, x, 0]"}, "origin must be a finite number"),
        ({"negate": "maybe"}, "negate must be 0 or 1"),
        ({"negate": "0.5"}, "negate must be 0 or 1"),
        ({"negate": "2"}, "negate must be 0 or 1, it is 2"),
        ({"negate": "-1"}, "negate must be 0 or 1, it is -1"),
        ({"mode": "quaternary"}, "mode must be trinary, scale or raw"),
        ({"mode": "[raw]"}, "mode must be trinary, scale or raw"),
        ({"occupied_thresh": "high"}, "occupied_thresh must be a finite number"),
        ({"free_thresh": "0.7"}, "free_thresh 0.7 is not below"),
        ({"free_thresh": "0.65", "mode": "scale"}, "free_thresh 0.65 is not below"),
        ({"image": "''"}, "image must name a file"),
        ({"image": "7"}, "image must name a file"),
        ({"image": "gone.pgm"}, "gone.pgm: the image cannot be read"),
        ({"image": "."}, "the image cannot be read"),
    ],
)
def test_bad_fields_are_refused_by_name(
    tmp_path: Path, changes: dict[str, str | None], reason: str
) -> None:
    """Each refusal names the file, the field and the reason, in one line."""
    with pytest.raises(MapError) as caught:
        read_map_file(write_map(tmp_path, fields=changes), "map")
    assert reason in str(caught.value)
    assert str(caught.value).startswith(f"{tmp_path / 'a.yaml'}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"image: [", "is no valid YAML"),
        (b"\xff\xfe\x00", "cannot be read .not UTF-8 text"),
        (b"", "is no mapping"),
        (b"- 1\n- 2\n", "is no mapping"),
        (b"just words", "is no mapping"),
        (b"a: !!python/object:os.system {}", "is no valid YAML"),
    ],
)
def test_files_that_are_no_yaml_mapping_are_refused(
    tmp_path: Path, text: bytes, reason: str
) -> None:
    """Broken YAML, other encodings and other documents give one sentence."""
    path = tmp_path / "m.yaml"
    path.write_bytes(text)
    with pytest.raises(MapError, match=reason):
        read_map_file(path, "map")


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    """The sentence names the path."""
    with pytest.raises(MapError, match=r"none\.yaml: the map file cannot be read"):
        read_map_file(tmp_path / "none.yaml", "map")


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        (b"", "neither pgm"),
        (b"P6\n1 1\n255\nabc", "neither pgm"),
        (b"P5\n3 2\n", "header is malformed"),
        (b"P5\nthree 2\n255\n", "header is malformed"),
        (b"P5\n3 2\n255\nabc", "truncated, 3 pixels of 6"),
        (b"P5\n99999 99999\n255\nabc", "truncated"),
        (b"P5\n40000 1\n255\n" + bytes(40000), ": width is 40000"),
        (b"P5\n1 2\n65535\nabc", "truncated, 1 pixels of 2"),
        (b"P5\n1 1\n256\n\x01\x01", "a pixel of 257 exceeds"),
        (b"P5\n1 1\n65536\nabc", "up to 65536"),
        (b"P5\n0 1\n255\n", "0 x 1 pixels"),
        (b"P5\n1 1\n0\n\0", "up to 0"),
        (b"P5\n1 1\n100\n\xff", "a pixel of 255 exceeds"),
        (b"P2\n2 1\n255\n1", "truncated, 1 pixels of 2"),
        (b"P2\n2 1\n255\n1 x", "no number"),
        (b"P2\n2 1\n255\n1 -1", "no number"),
        (b"\x89PNG\r\n\x1a\n", "truncated"),
        (b"BM\x40\0\0\0abc", "bmp is truncated"),
        (b"BM\x09\0\0\0abc", "bmp cannot be decoded"),
    ],
)
def test_bad_images_are_refused(tmp_path: Path, image: bytes, reason: str) -> None:
    """A wrong or truncated image never becomes a map."""
    with pytest.raises(MapError, match=reason):
        read_map_file(write_map(tmp_path, image), "map")


def test_every_truncation_and_damage_of_a_png_is_refused(tmp_path: Path) -> None:
    """Decoders fill up what is missing; the chunks' lengths and checksums tell."""
    assert cv2.imwrite(str(tmp_path / "b.png"), np.full((4, 4), 254, np.uint8))
    whole = (tmp_path / "b.png").read_bytes()
    damaged = [whole[:n] for n in range(len(whole))]
    damaged += [whole[:n] + bytes([whole[n] ^ 1]) + whole[n + 1 :] for n in range(8, len(whole))]
    for image in damaged:
        with pytest.raises(MapError):
            read_map_file(write_map(tmp_path, image), "map")
    assert (read_map_file(write_map(tmp_path, whole), "map").cells == 0).all()


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_images_of_16_bits_are_read_to_the_last_bit(
    tmp_path: Path, mode: str, channels: int
) -> None:
    """As GIMP saves them: brightness is of 65535, and so is opacity."""
    pixels = np.random.default_rng(6).integers(0, 65536, (16, 16, channels), dtype=np.uint16)
    pixels[:, :8, 3:] = 65535
    grid = read_map_file(write_png(tmp_path, pixels, mode=mode))
    for row in range(16):
        for col in range(16):
            values = [int(value) for value in pixels[15 - row, col]]
            shade, opaque = brightness(values, mode) * 255 / 65535, values[3:] in ([], [65535])
            assert grid.cells[row, col] == twin(shade, mode, negate=False, opaque=opaque), values
    if channels == 1:
        image = b"P5\n16 16\n65535\n" + pixels.astype(">u2").tobytes()
        same = read_map_file(write_map(tmp_path, image, {"mode": mode}))
        assert np.array_equal(same.cells, grid.cells)


def _chunk(name: bytes, body: bytes) -> bytes:
    return len(body).to_bytes(4, "big") + name + body + zlib.crc32(name + body).to_bytes(4, "big")


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("depth", [2, 8, 16])
def test_a_grey_that_stands_for_no_opacity_is_as_an_alpha_channel(
    tmp_path: Path, mode: str, depth: int
) -> None:
    """As programs that make a png smaller write the unknown cells of a map of greys."""
    full = 2**depth - 1
    greys = np.random.default_rng(8).integers(0, 4, (5, 8)) * (full // 3)
    clear = full // 3
    bits = (greys[:, :, np.newaxis] >> np.arange(depth)[::-1]) & 1
    rows = np.packbits(bits.reshape(5, -1).astype(np.uint8), axis=1)
    data = zlib.compress(b"".join(b"\0" + row.tobytes() for row in rows))
    header = struct.pack(">IIBBBBB", 8, 5, depth, 0, 0, 0, 0)
    chunks = [
        (b"IHDR", header),
        (b"tRNS", clear.to_bytes(2, "big")),
        (b"IDAT", data),
        (b"IEND", b""),
    ]
    image = b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(*one) for one in chunks)
    found = read_map_file(write_map(tmp_path, image, {"mode": mode})).cells
    colour, opacity = greys * 255 // full, np.where(greys == clear, 0, 255)
    pixels = np.stack((colour, colour, colour, opacity), axis=2).astype(np.uint8)
    assert np.array_equal(found, read_map_file(write_png(tmp_path, pixels, mode=mode)).cells)
    is_unknown = np.flipud(greys == clear)
    assert mode != "scale" or np.array_equal(found == -1, is_unknown)


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_a_bmp_is_the_same_map_as_a_png(tmp_path: Path, channels: int) -> None:
    """The fourth byte of its pixels hides nothing, whatever it holds."""
    pixels = np.random.default_rng(7).integers(0, 256, (9, 7, channels), dtype=np.uint8)
    colours = pixels[:, :, :3]
    expected = read_map_file(write_png(tmp_path, colours, mode="scale")).cells
    assert cv2.imwrite(str(tmp_path / "c.bmp"), pixels)
    grid = read_map_file(write_map(tmp_path, fields={"image": "c.bmp", "mode": "scale"}))
    assert np.array_equal(grid.cells, expected)


def test_an_image_in_place_of_the_map_file_is_told_as_such(tmp_path: Path) -> None:
    """Its resolution is not known."""
    write_map(tmp_path)
    with pytest.raises(MapError, match=r"a\.pgm: this is the map's image; give the \.yaml file"):
        read_map_file(tmp_path / "a.pgm")


@pytest.mark.parametrize(
    ("name", "shape", "free_m2"),
    [
        ("nav2-maps/depot.yaml", (307, 604), 448.7),
        ("nav2-maps/tb3_sandbox.yaml", (384, 384), 19.8),
        ("nav2-maps/warehouse.yaml", (1674, 1006), 1280.1),
        ("nav2-maps/depot_keepout.yaml", (307, 604), 385.5),
        ("drl-jarvis-hall/i-108_10mm.yaml", (765, 2051), 147.0),
        ("drl-ship-interior-gazebo/ship_interior_10mm.yaml", (1240, 840), 91.2),
    ],
)
def test_real_maps(real_data: Path, name: str, shape: tuple[int, int], free_m2: float) -> None:
    """Real maps have the size and the free area that were measured by other means."""
    grid: OccupancyGrid = read_map_file(real_data / name, "map")
    assert grid.cells.shape == shape
    free = np.count_nonzero(classify(grid, 65, 25).free) * grid.cell_area_m2
    assert free == pytest.approx(free_m2, abs=0.06)
