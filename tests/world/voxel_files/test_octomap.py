"""Octomap files against a recursive reader, written and real trees, and every bad input."""

import itertools
import math
import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.errors import MapError
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_files import octomap
from are_ros.world.voxel_files.clouds import MAX_CENTRES
from are_ros.world.voxel_files.octomap import OctreeHeader, read_octomap_file, read_octree
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
    assert len(centres) <= MAX_CENTRES


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "no octomap"),
        ("# Octomap OcTree file\nid OcTree\n", "no line 'data'"),
        (HEADER.format("many", 0.1), "size is 'many'"),
        (HEADER.format("-1", 0.1), "size is '-1'"),
        (HEADER.format("9" * 50, 0.1), "not a number of nodes"),
        (HEADER.format(1, "fine"), "res is 'fine'"),
        (HEADER.format(1, "nan"), "res is 'nan'"),
        (HEADER.format(1, 0.0), "res is '0.0'"),
        (HEADER.format(1, 1e-9), "res is '1e-09', not a positive length of a voxel"),
        (HEADER.format(1, 1e308), "res is '1e+308', not a positive length of a voxel"),
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
    with pytest.raises(MapError, match=r"gone\.bt: the file cannot be read"):
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
    header = octomap._parsed_header(path, data)
    found = octomap._occupied_leaves(str(path), data[header.data_start :], header)
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


FULL_HEADER = "# Octomap OcTree file\n# more words\nid {}\nsize {}\nres {}\ndata\n"
FREE, OCCUPIED = -0.4, 0.85
NODE_BYTES = {"OcTree": 5, "ColorOcTree": 8}


def as_full(codes: bytes, kind: str) -> bytes:
    """Return the data of a binary tree as those of a full one, node by node."""
    data = iter(codes)
    colour = {"OcTree": b"", "ColorOcTree": b"\x01\x80\xff"}[kind]

    def written(log_odds: float, children: list[bytes | None]) -> bytes:
        there = sum((child is not None) << number for number, child in enumerate(children))
        head = struct.pack("<f", log_odds) + colour + bytes([there])
        return head + b"".join(child for child in children if child is not None)

    def subtree() -> bytes:
        word = next(data) | next(data) << 8
        kinds = [word >> (2 * number) & 3 for number in range(8)]
        inner = {number: subtree() for number, code in enumerate(kinds) if code == 3}
        leaves = {1: written(FREE, []), 2: written(OCCUPIED, [])}
        # Those of an inner node must not count, but one without children is a leaf of a full tree.
        log_odds = OCCUPIED if any(kinds) else FREE
        return written(log_odds, [inner.get(n, leaves.get(k)) for n, k in enumerate(kinds)])

    return subtree()


def write_full(folder: Path, data: bytes, nodes: int, size: float, kind: str = "OcTree") -> Path:
    """Write a full octomap with this data part."""
    path = folder / "tree.ot"
    path.write_bytes(FULL_HEADER.format(kind, nodes, size).encode() + data)
    return path


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1), level=st.integers(1, 4), kind=st.sampled_from([*NODE_BYTES]))
def test_a_full_tree_has_the_voxels_of_the_binary_one(
    tmp_path_factory: pytest.TempPathFactory, seed: int, level: int, kind: str
) -> None:
    """Random trees, written as both by slow writers; colours are passed over."""
    data, nodes = chain_down(np.random.default_rng(seed), level)
    folder = tmp_path_factory.getbasetemp()
    full = as_full(data, kind)
    assert len(full) == nodes * NODE_BYTES[kind]
    centres, size = read_octomap_file(write_full(folder, full, nodes, 0.25, kind))
    expected, _ = read_octomap_file(write(folder, data, nodes))
    assert size == 0.25
    assert doubled(centres, size) == doubled(expected, size)


@pytest.mark.parametrize(
    ("log_odds", "count"), [(-1e-6, 0), (-0.0, 8), (0.0, 8), (3.5, 8), (-2.0, 0)]
)
def test_a_leaf_is_occupied_from_even_odds_on(tmp_path: Path, log_odds: float, count: int) -> None:
    """A probability of 0.5 is occupied, as in OctoMap; this leaf is two voxels wide."""
    inner = b"".join(struct.pack("<fB", 9.0, 1 << 7 if depth == 0 else 1) for depth in range(15))
    data = inner + struct.pack("<fB", log_odds, 0)
    centres, _ = read_octomap_file(write_full(tmp_path, data, 16, 0.5))
    assert len(centres) == count
    if count:
        assert sorted(centres.tolist()) == [
            list(p) for p in itertools.product((0.25, 0.75), repeat=3)
        ]


def test_an_empty_full_tree_has_no_centres(tmp_path: Path) -> None:
    """A size of 0 is followed by no data."""
    centres, _ = read_octomap_file(write_full(tmp_path, b"", 0, 0.1))
    assert centres.shape == (0, 3)


def test_every_truncation_of_a_full_tree_is_refused(tmp_path: Path) -> None:
    """No prefix of a file is a map."""
    data, nodes = chain_down(np.random.default_rng(2), 2)
    whole = write_full(tmp_path, as_full(data, "OcTree"), nodes, 0.1).read_bytes()
    path = tmp_path / "cut.ot"
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        with pytest.raises(MapError, match=r"^\S+cut\.ot: "):
            read_octomap_file(path)


@settings(deadline=None)
@given(data=st.binary(max_size=100), nodes=st.integers(0, 20), kind=st.sampled_from([*NODE_BYTES]))
def test_random_bytes_of_a_full_tree_never_crash(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, nodes: int, kind: str
) -> None:
    """Whatever follows the header, the answer is a map or a MapError."""
    path = write_full(tmp_path_factory.getbasetemp(), data, nodes, 0.1, kind)
    try:
        centres, _ = read_octomap_file(path)
    except MapError:
        return
    assert len(centres) <= MAX_CENTRES


@pytest.mark.parametrize(
    ("data", "nodes", "reason"),
    [
        (struct.pack("<fB", math.nan, 0), 1, "log odds are not finite"),
        (struct.pack("<fB", -1.0, 0), 2, "holds 1 nodes, but its size says 2"),
        (struct.pack("<fB", -1.0, 1), 1, "truncated"),
        (struct.pack("<fB", -1.0, 1) * 17 + struct.pack("<fB", -1.0, 0), 18, "deeper than 16"),
        (struct.pack("<fB", 1.0, 0), 1, "more than 67108864"),
    ],
)
def test_bad_full_trees_are_refused(tmp_path: Path, data: bytes, nodes: int, reason: str) -> None:
    """One sentence names the file and the reason."""
    with pytest.raises(MapError, match=rf"^\S+tree\.ot: .*{reason}"):
        read_octomap_file(write_full(tmp_path, data, nodes, 0.1))


def test_a_real_octomap_is_the_same_as_a_full_tree(tmp_path: Path, real_data: Path) -> None:
    """The corridor of building 079, converted node by node."""
    path = real_data / "octomap-geb079/geb079.bt"
    data = path.read_bytes()
    header = octomap._parsed_header(path, data)
    full = as_full(data[header.data_start :], "OcTree")
    assert header.node_count is not None
    converted = write_full(tmp_path, full, header.node_count, header.resolution_m)
    centres, size = read_octomap_file(converted)
    expected, _ = read_octomap_file(path)
    assert size == 0.08
    assert {*map(tuple, centres.tolist())} == {*map(tuple, expected.tolist())}


def test_data_of_a_message_that_outlast_the_tree_are_refused() -> None:
    """A message counts no nodes; of a full tree that is called binary the walk ends too early."""
    leaf, root = struct.pack("<fB", 2.0, 0), struct.pack("<fB", 2.0, 1)
    full = root + b"".join(struct.pack("<fB", 2.0, 1) for _ in range(15)) + leaf
    binary = b"\x03\0" * 15 + b"\x02\0"
    for data, is_full in ((full, True), (binary, False)):
        assert len(read_octree("octomap", data, OctreeHeader("OcTree", is_full, 0.1))) == 1
    for data, is_full, said in (
        (full, False, "read as a binary one, ends 83 bytes before them; is it a full one"),
        (full + b"1234", True, "read as a full one, ends 4 bytes before them; is it a binary one"),
        (binary + b"\0\0\0", False, "ends 3 bytes before them"),
    ):
        with pytest.raises(MapError, match=said):
            read_octree("octomap", data, OctreeHeader("OcTree", is_full, 0.1))
