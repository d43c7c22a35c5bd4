"""PCD files against a slow writer, one of another program, and every bad input."""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.errors import MapError
from are_ros.world.voxel_files import clouds
from are_ros.world.voxel_files.clouds import read_pcd_file

Floats = npt.NDArray[np.float64]
ENCODINGS = ("ascii", "binary", "binary_compressed")
HEADER = (
    "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {}\nSIZE {}\nTYPE {}\n"
    "COUNT {}\nWIDTH {}\nHEIGHT 1\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS {}\nDATA {}\n"
)
CODES = {("F", 4): "f", ("F", 8): "d", ("U", 1): "B", ("I", 2): "h", ("U", 4): "I", ("I", 8): "q"}


class Column(NamedTuple):
    """A field: its name, type, size and count, and the values of each point."""

    name: str
    kind: str
    size: int
    values: Sequence[Sequence[float]]

    @property
    def is_whole(self) -> bool:
        """Whether it has integers."""
        return self.kind != "F"

    def packed(self, point: int) -> bytes:
        """Return the bytes of one point."""
        numbers = [int(v) if self.is_whole else float(v) for v in self.values[point]]
        return struct.pack(f"<{len(numbers)}{CODES[self.kind, self.size]}", *numbers)


def packed_slowly(data: bytes) -> bytes:
    """Pack by LZF: at each byte the longest of the repetitions, else a run of one byte."""
    out, at = b"", 0
    while at < len(data):
        best, back = 0, 0
        for start in range(max(0, at - 200), at):
            length = 0
            while length < 264 and at + length < len(data):
                if data[start + length] != data[at + length]:
                    break
                length += 1
            if length > best:
                best, back = length, at - start - 1
        if best < 3:
            out, at = out + bytes([0, data[at]]), at + 1
            continue
        long = bytes([best - 9]) if best >= 9 else b""
        out += bytes([min(best - 2, 7) << 5 | back >> 8]) + long + bytes([back & 255])
        at += best
    return out


def written(columns: Sequence[Column], encoding: str) -> bytes:
    """Return a file of these fields."""
    count = len(columns[0].values)
    entries = [
        " ".join(str(getattr(c, name)) for c in columns) for name in ("name", "size", "kind")
    ]
    counts = " ".join(str(len(c.values[0])) for c in columns)
    head = HEADER.format(*entries, counts, count, count, encoding).encode()
    if encoding == "ascii":
        rows = [
            " ".join(repr(int(v) if c.is_whole else float(v)) for c in columns for v in c.values[i])
            for i in range(count)
        ]
        return head + "\n".join(rows).encode() + b"\n"
    if encoding == "binary":
        return head + b"".join(c.packed(i) for i in range(count) for c in columns)
    blocks = b"".join(c.packed(i) for c in columns for i in range(count))
    data = packed_slowly(blocks)
    return head + struct.pack("<2I", len(data), len(blocks)) + data


def of_points(points_m: Floats, kind: str = "F", size: int = 4) -> list[Column]:
    """Return the fields of points, with others before, between and behind."""
    count = len(points_m)
    x, y, z = ([[v] for v in points_m[:, axis].tolist()] for axis in range(3))
    return [
        Column("rgb", "U", 1, [[i % 7] for i in range(count)]),
        Column("y", kind, size, y),
        Column("normal", "F", 8, [[0.5, i, -1.0] for i in range(count)]),
        Column("x", kind, size, x),
        Column("z", kind, size, z),
        Column("_", "I", 2, [[-3, 4] for _ in range(count)]),
    ]


def put(folder: Path, data: bytes) -> Path:
    """Write a file."""
    path = folder / "cloud.pcd"
    path.write_bytes(data)
    return path


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 40),
    encoding=st.sampled_from(ENCODINGS),
    number=st.sampled_from([("F", 4), ("F", 8), ("I", 2), ("I", 8)]),
)
def test_points_are_those_written(
    tmp_path_factory: pytest.TempPathFactory,
    seed: int,
    count: int,
    encoding: str,
    number: tuple[str, int],
) -> None:
    """Of any number type, between other fields, in each encoding."""
    points = np.random.default_rng(seed).integers(-40, 40, (count, 3)) / 4.0
    if number[0] == "I":
        points = np.round(points)
    path = put(tmp_path_factory.getbasetemp(), written(of_points(points, *number), encoding))
    found = read_pcd_file(path)
    assert found.dtype == np.float32
    assert found.tolist() == points.tolist()


def test_a_cloud_compressed_by_liblzf() -> None:
    """The file was written by pypcd4 1.5.1, of these points and their numbers as intensity."""
    points = np.random.default_rng(5).uniform(-2.0, 3.0, (300, 3))
    points = np.round(points * 4.0) / 4.0
    points = points[np.lexsort(points.T)]
    found = read_pcd_file(Path(__file__).parent / "data" / "by_liblzf.pcd")
    assert found.tolist() == np.delete(points, 7, axis=0).tolist()  # its seventh is not a number


@settings(deadline=None)
@given(data=st.lists(st.sampled_from(b"abc"), min_size=1, max_size=700).map(bytes))
def test_what_was_packed_is_unpacked(data: bytes) -> None:
    """Runs, near and far repetitions, such that overlap themselves, and long ones."""
    unpacked = np.empty(len(data), np.uint8)
    assert clouds._unpack(np.frombuffer(packed_slowly(data), np.uint8), unpacked)
    assert unpacked.tobytes() == data


@settings(deadline=None, max_examples=300)
@given(data=st.binary(max_size=60), size=st.integers(0, 200))
def test_unpacking_anything_stays_within_its_arrays(data: bytes, size: int) -> None:
    """It fails, or fills the array; what lies behind it is untouched."""
    room = np.full(size + 400, 85, np.uint8)
    is_full = clouds._unpack(np.frombuffer(data, np.uint8), room[:size])
    assert (room[size:] == 85).all()
    if is_full:
        by_hand, at = bytearray(), 0
        while at < len(data):
            token, at = data[at], at + 1
            if token < 32:
                by_hand += data[at : at + token + 1]
                at += token + 1
                continue
            length = (token >> 5) + 2
            if length == 9:
                length, at = length + data[at], at + 1
            back, at = ((token & 31) << 8) + data[at] + 1, at + 1
            for _ in range(length):
                by_hand.append(by_hand[-back])
        assert room[:size].tobytes() == bytes(by_hand)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_points_without_a_return_are_left_out(tmp_path: Path, encoding: str) -> None:
    """An organised cloud has NaN there."""
    points = np.array([(1.0, 2.0, 3.0), (np.nan,) * 3, (np.inf, 0.0, 0.0), (4.0, 5.0, 6.0)])
    found = read_pcd_file(put(tmp_path, written(of_points(points), encoding)))
    assert found.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_every_truncation_is_refused(tmp_path: Path, encoding: str) -> None:
    """No prefix is a cloud; in ascii the last number may lose digits, which nobody can tell."""
    fields = of_points(np.arange(9.0).reshape(3, 3))
    whole = written([fields[3], fields[1], fields[4]], encoding)
    end = whole.rindex(b" ") if encoding == "ascii" else len(whole)
    for length in range(end):
        with pytest.raises(MapError, match=r"cloud\.pcd: ") as caught:
            read_pcd_file(put(tmp_path, whole[:length]))
        assert "\n" not in str(caught.value)


@settings(deadline=None, max_examples=300)
@given(
    encoding=st.sampled_from(ENCODINGS),
    changes=st.lists(st.tuples(st.integers(0, 600), st.integers(0, 255)), min_size=1, max_size=6),
)
def test_a_changed_file_is_refused_or_read_but_never_crashes(
    tmp_path_factory: pytest.TempPathFactory, encoding: str, changes: list[tuple[int, int]]
) -> None:
    """Whatever bytes change, the answer is a cloud or a MapError."""
    data = bytearray(written(of_points(np.arange(12.0).reshape(4, 3)), encoding))
    for at, value in changes:
        data[at % len(data)] = value
    try:
        found = read_pcd_file(put(tmp_path_factory.getbasetemp(), bytes(data)))
    except MapError:
        return
    assert np.isfinite(found).all()
    assert len(found) >= 1


PLAIN = HEADER.format("x y z", "4 4 4", "F F F", "1 1 1", 1, 1, "ascii") + "1 2 3\n"


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (PLAIN, "", "header is truncated"),
        (PLAIN, "ply\nformat ascii 1.0\n", "this is no PCD, its header has a line 'ply'"),
        (PLAIN, "\0" * 500 + "\n", "no PCD"),
        ("DATA ascii\n1 2 3\n", "", "it has no line DATA"),
        ("DATA ascii", "DATA zipped", "DATA is 'zipped'"),
        ("FIELDS x y z", "FIELDS x y", "not equally many"),
        ("FIELDS x y z", "FIELDS x y w", "no field z"),
        ("COUNT 1 1 1", "COUNT 1 1 2", "no field z of one number"),
        ("SIZE 4 4 4", "SIZE 4 4 x", "SIZE has 'x'"),
        ("SIZE 4 4 4", "SIZE 4 4 3", "field z is F3"),
        ("TYPE F F F", "TYPE F F Q", "field z is Q4"),
        ("POINTS 1", "POINTS -1", "POINTS has '-1'"),
        ("POINTS 1", "POINTS 7", "says 7 POINTS, but its WIDTH and HEIGHT 1"),
        ("POINTS 1\n", "", ""),
        ("WIDTH 1\nHEIGHT 1\n", "", ""),
        ("COUNT 1 1 1\n", "", ""),
        ("FIELDS", "COLUMNS", ""),
        ("WIDTH 1\nHEIGHT 1\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS 1\n", "", "how many POINTS"),
        ("WIDTH 1\nHEIGHT 1\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS 1\n", "POINTS 0\n", "no points"),
        (
            "WIDTH 1\nHEIGHT 1\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS 1\n",
            "POINTS 99999999999\n",
            "more than 67108864",
        ),
        ("1 2 3\n", "1 2\n", "points are malformed"),
        ("1 2 3\n", "1 two 3\n", "points are malformed"),
        ("1 2 3\n", "\n", "holds 0 points of 1"),
        ("1 2 3\n", "nan nan nan\n", "no finite point among 1"),
        ("1 2 3\n", "1e9 2 3.1e8\n", ""),
        ("1 2 3\n", "500000.14 2 3\n", "500000 m from the origin"),
        ("1 2 3\n", "1e300 2 3\n", "1e.300 m from the origin"),
    ],
)
def test_headers_and_points(tmp_path: Path, old: str, new: str, reason: str) -> None:
    """One sentence names the file and the reason; old files lack what follows from the rest."""
    assert old in PLAIN
    path = put(tmp_path, PLAIN.replace(old, new).encode("latin-1"))
    if not reason:
        assert len(read_pcd_file(path)) == 1
        return
    with pytest.raises(MapError, match=rf"^\S+cloud\.pcd: .*{reason}") as caught:
        read_pcd_file(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("packed_bytes", "unpacked_bytes", "points", "reason"),
    [
        (2, 12, 1, "compressed data are corrupt"),
        (9, 12, 1, "truncated, 2 bytes of 9"),
        (2, 13, 1, "2 bytes cannot be 1 points of 12 bytes"),
        (2, 12_000, 1000, "cannot be 1000 points"),
    ],
)
def test_bad_compressed_data_are_refused(
    tmp_path: Path, packed_bytes: int, unpacked_bytes: int, points: int, reason: str
) -> None:
    """Also sizes that nothing so short can be unpacked to: no memory is taken for them."""
    head = HEADER.format(
        "x y z", "4 4 4", "F F F", "1 1 1", points, points, "binary_compressed"
    ).encode()
    data = head + struct.pack("<2I", packed_bytes, unpacked_bytes) + b"\x01a"
    with pytest.raises(MapError, match=reason):
        read_pcd_file(put(tmp_path, data))


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    """The sentence names the path."""
    with pytest.raises(MapError, match=r"gone\.pcd: the file cannot be read \(no such file"):
        read_pcd_file(tmp_path / "gone.pcd")
