"""Octomap files against a recursive reader, written and real trees, and every bad input."""

import itertools
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.errors import MapError
from are_ros.world import octomap_io
from are_ros.world.octomap_io import read_octomap_file
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

HEADER = "# Octomap OcTree binary file\n# more words\nid OcTree\nsize {}\nres {}\ndata\n"
Cube = tuple[int, int, int, int]


def encoded(rng: np.random.Generator, level: int, depth: int) -> tuple[bytes, int]:
    """Return the bytes and the number of nodes of a random subtree; `level` is its size's log."""
    weights = (0.4, 0.2, 0.2, 0.2) if depth < 15 and level > 1 else (0.4, 0.3, 0.3, 0.0)
    codes = [int(code) for code in rng.choice(4, size=8, p=weights)]
    word = sum(code << (2 * number) for number, code in enumerate(codes))
    data, nodes = word.to_bytes(2, "little"), 1
    for code in codes:
        child, count = encoded(rng, level - 1, depth + 1) if code == 3 else (b"", code != 0)
        data, nodes = data + child, nodes + count
    return data, nodes


def chain_down(rng: np.random.Generator, level: int) -> tuple[bytes, int]:
    """Return a tree whose root leads down to a random subtree of 2**level finest voxels."""
    data, nodes = encoded(rng, level, 16 - level)
    for _ in range(16 - level):
        number = int(rng.integers(8))
        data, nodes = (3 << (2 * number)).to_bytes(2, "little") + data, nodes + 1
    return data, nodes


def slow_leaves(data: list[int], corner: tuple[int, int, int], width: int) -> list[Cube]:
    """Return (x, y, z, width) of the occupied leaves, eating the bytes of one node."""
    bits = f"{data.pop(0):08b}"[::-1] + f"{data.pop(0):08b}"[::-1]
    half = width // 2
    leaves: list[Cube] = []
    inner: list[tuple[int, int, int]] = []
    for number in range(8):
        x, y, z = (c + half * (number >> a & 1) for a, c in enumerate(corner))
        code = bits[2 * number : 2 * number + 2]
        if code == "01":
            leaves.append((x, y, z, half))
        elif code == "11":
            inner.append((x, y, z))
    for child in inner:
        leaves += slow_leaves(data, child, half)
    return leaves


def slow_centres(leaves: list[Cube]) -> list[tuple[int, ...]]:
    """Return the centres of all finest voxels in half voxels, sorted."""
    centres = []
    for x, y, z, width in leaves:
        voxels = itertools.product(range(width), repeat=3)
        centres += [(2 * (x + i) + 1, 2 * (y + j) + 1, 2 * (z + k) + 1) for i, j, k in voxels]
    return sorted(centres)


def doubled(centres: npt.NDArray[np.float32], size: float) -> list[tuple[int, ...]]:
    """Return centres in half voxels, sorted."""
    return sorted(map(tuple, np.rint(centres.astype(float) * 2 / size).astype(int).tolist()))


def write(folder: Path, data: bytes, nodes: int, size: float = 0.25) -> Path:
    """Write a file with this data part."""
    path = folder / "tree.bt"
    path.write_bytes(HEADER.format(nodes, size).encode() + data)
    return path


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1), level=st.integers(1, 4))
def test_random_trees_agree_with_the_recursive_reader(
    tmp_path_factory: pytest.TempPathFactory, seed: int, level: int
) -> None:
    """Leaves of every size, anywhere in the tree's 16 levels, expand to the same voxels."""
    data, nodes = chain_down(np.random.default_rng(seed), level)
    path = write(tmp_path_factory.getbasetemp(), data, nodes)
    centres, size = read_octomap_file(path)
    assert size == 0.25
    assert centres.dtype == np.float32
    expected = slow_leaves(list(data), (-32768, -32768, -32768), 65536)
    assert doubled(centres, size) == slow_centres(expected)


def test_one_leaf_in_the_first_octant_touches_the_origin(tmp_path: Path) -> None:
    """Voxel corners are multiples of the size: the first voxel's centre is half of it."""
    data = (3 << 14).to_bytes(2, "little") + (3).to_bytes(2, "little") * 14 + b"\x02\x00"
    centres, _ = read_octomap_file(write(tmp_path, data, 17, 0.5))
    assert centres.tolist() == [[0.25, 0.25, 0.25]]


def test_an_empty_tree_has_no_centres(tmp_path: Path) -> None:
    """A size of 0 is followed by no data."""
    centres, _ = read_octomap_file(write(tmp_path, b"", 0))
    assert centres.shape == (0, 3)


def test_every_truncation_is_refused(tmp_path: Path) -> None:
    """No prefix of a file is a map."""
    data, nodes = chain_down(np.random.default_rng(2), 3)
    whole = write(tmp_path, data, nodes).read_bytes()
    path = tmp_path / "cut.bt"
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        with pytest.raises(MapError):
            read_octomap_file(path)


@settings(deadline=None)
@given(data=st.binary(max_size=60), nodes=st.integers(0, 40))
def test_random_bytes_are_refused_or_read_but_never_crash(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, nodes: int
) -> None:
    """Whatever follows the header, the answer is a map or a MapError."""
    path = write(tmp_path_factory.getbasetemp(), data, nodes)
    try:
        centres, _ = read_octomap_file(path)
    except MapError:
        return
    assert len(centres) <= octomap_io.MAX_CENTRES


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "no octomap"),
        ("# Octomap OcTree file\nid OcTree\n", "convert_octree tree.bt"),
        (HEADER.format("many", 0.1), "size is 'many'"),
        (HEADER.format("-1", 0.1), "size is '-1'"),
        (HEADER.format("9" * 50, 0.1), "not a number of nodes"),
        (HEADER.format(1, "fine"), "res is 'fine'"),
        (HEADER.format(1, "nan"), "res is 'nan'"),
        (HEADER.format(1, 0.0), "res is '0.0'"),
        (HEADER.format(1, 0.1).replace("id OcTree\n", ""), "id is None"),
        (HEADER.format(1, 0.1).replace("id OcTree", "id Elevation"), "id is Elevation"),
        (HEADER.format(1, 0.1).replace("res 0.1\n", ""), "res is ''"),
        (HEADER.format(1, 0.1).replace("data\n", ""), "no line 'data'"),
        (HEADER.format(5, 0.1) + "\0\0", "holds 1 nodes, but its size says 5"),
        (HEADER.format(2, 0.1) + "\x02\0", "more than 67108864"),
        (HEADER.format(18, 0.1) + "\x03\0" * 16, "deeper than 16 levels"),
    ],
)
def test_bad_files_are_refused(tmp_path: Path, text: str, reason: str) -> None:
    """One sentence names the file and the reason."""
    path = tmp_path / "tree.bt"
    path.write_text(text)
    with pytest.raises(MapError) as caught:
        read_octomap_file(path)
    assert reason in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    """The sentence names the path."""
    with pytest.raises(MapError, match=r"gone\.bt: the octomap cannot be read"):
        read_octomap_file(tmp_path / "gone.bt")


@pytest.mark.parametrize(
    ("name", "size", "leaves", "voxels", "low", "high"),
    [
        ("octomap-geb079/geb079.bt", 0.08, 143_729, 185_673, (-8.0, -7.5, -0.3), (30.9, 7.4, 2.8)),
        (
            "drl-ship-interior-gazebo/ship_interior_20mm.bt",
            0.02,
            899_575,
            1_350_893,
            (-5.4, -4.2, 0.0),
            (6.6, 8.2, 2.6),
        ),
    ],
)
def test_real_octomaps(
    real_data: Path,
    name: str,
    size: float,
    leaves: int,
    voxels: int,
    low: tuple[float, float, float],
    high: tuple[float, float, float],
) -> None:
    """Counts and extents are those that other readers found, and the voxel map keeps them all."""
    path = real_data / name
    data = path.read_bytes()
    header = octomap_io._parsed_header(path, data)
    codes = np.frombuffer(data[header.data_start :], np.uint8)
    found = octomap_io._occupied_leaves(path, codes, header)
    assert len(found) == leaves
    centres, resolution = read_octomap_file(path)
    assert (resolution, len(centres)) == (size, voxels)
    assert centres.min(axis=0) == pytest.approx(low, abs=0.06)
    assert centres.max(axis=0) == pytest.approx(high, abs=0.06)
    built = VoxelMap.from_centres(centres, None, RigidTransform.identity())
    assert built.occupied_count == voxels
    as_published = (found[:, :3] + (1 << found[:, 3:]) / 2) * size
    pruned = VoxelMap.from_centres(as_published.astype(np.float32), None, RigidTransform.identity())
    assert np.array_equal(pruned.occupied, built.occupied)
    assert pruned.map_from_lattice.translation_m == pytest.approx(
        built.map_from_lattice.translation_m, abs=1e-6
    )
