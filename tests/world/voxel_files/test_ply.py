"""PLY files against trimesh's writer and by hand, meshes against their triangles, bad input."""

import math
import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.errors import MapError
from are_ros.world.voxel_files.clouds import read_ply_file

Floats = npt.NDArray[np.float64]
FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
HEADER = (
    "ply\nformat {} 1.0\ncomment by hand\nelement vertex {}\nproperty uchar red\n"
    "property {} x\nproperty float nx\nproperty {} y\nproperty {} z\n{}end_header\n"
)
FACES = "element face {}\nproperty list uchar int vertex_indices\n"


def put(folder: Path, data: bytes) -> Path:
    """Write a file."""
    path = folder / "cloud.ply"
    path.write_bytes(data)
    return path


def cloud(points_m: Floats, encoding: str, number: str = "float") -> bytes:
    """Return a point cloud by hand, with a colour and a part of a normal."""
    head = HEADER.format(encoding, len(points_m), number, number, number, "").encode()
    rows = points_m.tolist()
    if encoding == "ascii":
        return (
            head
            + "".join(f"{i % 9} {x} 0.5 {y} {z}\n" for i, (x, y, z) in enumerate(rows)).encode()
        )
    code = FORMATS[encoding] + ("Bffff" if number == "float" else "Bdfdd")
    return head + b"".join(
        struct.pack(code, i % 9, x, 0.5, y, z) for i, (x, y, z) in enumerate(rows)
    )


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 40),
    encoding=st.sampled_from([*FORMATS]),
    number=st.sampled_from(["float", "double"]),
)
def test_points_are_those_written_by_hand(
    tmp_path_factory: pytest.TempPathFactory, seed: int, count: int, encoding: str, number: str
) -> None:
    """In text and in either byte order, between other properties."""
    points = np.random.default_rng(seed).integers(-400, 400, (count, 3)) / 8.0
    path = put(tmp_path_factory.getbasetemp(), cloud(points, encoding, number))
    found, size = read_ply_file(path, None)
    assert size is None
    assert found.dtype == np.float32
    assert found.tolist() == points.tolist()


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_points_are_those_that_trimesh_wrote(tmp_path: Path, encoding: str) -> None:
    """With colours; ascii rounds to eight digits."""
    points = np.random.default_rng(3).uniform(-9.0, 9.0, (500, 3)).astype(np.float32)
    colours = np.random.default_rng(4).integers(0, 255, (500, 4), dtype=np.uint8)
    path = tmp_path / "cloud.PLY"
    path.write_bytes(trimesh.PointCloud(points, colours).export(file_type="ply", encoding=encoding))
    found, _ = read_ply_file(path, 0.1)
    assert np.allclose(found, points, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("encoding", FORMATS)
def test_vertices_that_are_not_finite_are_left_out(tmp_path: Path, encoding: str) -> None:
    """As in a cloud of a sensor."""
    points = np.array([(1.0, 2.0, 3.0), (math.nan,) * 3, (math.inf, 0.0, 0.0), (4.0, 5.0, 6.0)])
    found, _ = read_ply_file(put(tmp_path, cloud(points, encoding)), None)
    assert found.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


@pytest.mark.parametrize("encoding", FORMATS)
def test_every_truncation_of_a_cloud_is_refused(tmp_path: Path, encoding: str) -> None:
    """No prefix is a cloud; in ascii the last number may lose digits, which nobody can tell."""
    whole = cloud(np.arange(9.0).reshape(3, 3), encoding)
    end = whole.rindex(b" ") if encoding == "ascii" else len(whole)
    for length in range(end):
        with pytest.raises(MapError, match=r"cloud\.ply: ") as caught:
            read_ply_file(put(tmp_path, whole[:length]), None)
        assert "\n" not in str(caught.value)


@settings(deadline=None, max_examples=300)
@given(
    encoding=st.sampled_from([*FORMATS, "mesh"]),
    changes=st.lists(st.tuples(st.integers(0, 600), st.integers(0, 255)), min_size=1, max_size=6),
)
def test_a_changed_file_is_refused_or_read_but_never_crashes(
    tmp_path_factory: pytest.TempPathFactory, encoding: str, changes: list[tuple[int, int]]
) -> None:
    """Whatever bytes change, the answer is a cloud or a MapError."""
    if encoding == "mesh":
        whole = trimesh.creation.box((1.0, 1.0, 1.0)).export(file_type="ply")
    else:
        whole = cloud(np.arange(12.0).reshape(4, 3), encoding)
    data = bytearray(whole)
    for at, value in changes:
        data[at % len(data)] = value
    try:
        found, _ = read_ply_file(put(tmp_path_factory.getbasetemp(), bytes(data)), 0.5)
    except MapError:
        return
    assert np.isfinite(found).all()


def triangle_distances_m(triangles: Floats, points_m: npt.NDArray[np.floating]) -> Floats:
    """Return how far each point (N, 3) is from the nearest of the triangles."""
    distances = [
        np.linalg.norm(
            trimesh.triangles.closest_point(np.repeat(one[None], len(points_m), axis=0), points_m)
            - points_m,
            axis=1,
        )
        for one in triangles
    ]
    return np.asarray(np.min(distances, axis=0))


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), size_m=st.sampled_from([0.1, 0.25, 0.7]))
def test_a_mesh_becomes_the_voxels_of_its_surface(
    tmp_path_factory: pytest.TempPathFactory, seed: int, size_m: float
) -> None:
    """Each voxel meets the surface, and no point of the surface is far from a voxel's middle."""
    rng = np.random.default_rng(seed)
    triangles = rng.uniform(-2.0, 2.0, (5, 3, 3)) * rng.choice([0.01, 1.0], (5, 1, 1))
    mesh = trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(15).reshape(-1, 3), process=False)
    path = put(tmp_path_factory.getbasetemp(), mesh.export(file_type="ply"))
    centres, size = read_ply_file(path, size_m)
    assert size == size_m
    indices = np.rint(centres / size_m - 0.5)
    assert np.abs(centres - (indices + 0.5) * size_m).max() < 1e-5
    assert len(np.unique(indices, axis=0)) == len(indices)
    assert triangle_distances_m(triangles, centres).max() <= 0.5 * math.sqrt(3.0) * size_m + 1e-5
    weights = rng.dirichlet((1.0, 1.0, 1.0), 60)
    on_surface = np.concatenate([weights @ one for one in triangles])
    gaps = np.abs(on_surface[:, None] - centres[None]).max(axis=2).min(axis=1)
    assert gaps.max() <= size_m  # half a voxel, and half a step of the grid


def test_a_box_whose_faces_lie_between_voxels_has_one_layer_of_them(tmp_path: Path) -> None:
    """A face at a multiple of the size belongs to the voxel above it, whatever its last digit."""
    box = trimesh.creation.box(bounds=((0.3, 0.3, 0.3), (0.7, 0.7, 0.7)))
    centres, _ = read_ply_file(put(tmp_path, box.export(file_type="ply")), 0.1)
    shell = [
        (x, y, z)
        for x in range(3, 8)
        for y in range(3, 8)
        for z in range(3, 8)
        if {3, 7} & {x, y, z}
    ]
    assert sorted(map(tuple, np.rint(centres / 0.1 - 0.5).astype(int).tolist())) == shell


QUADS = (
    HEADER.format("ascii", 5, "float", "float", "float", FACES.format(2))
    + "0 0 0 0 0\n0 1 0 0 0\n0 1 0 1 0\n0 0 0 1 0\n0 2 0 2 0\n4 0 1 2 3\n3 2 4 3\n"
)
PLAIN = HEADER.format("ascii", 1, "float", "float", "float", "") + "0 1 0.5 2 3\n"


def test_faces_of_three_and_four_corners_may_be_mixed_in_text(tmp_path: Path) -> None:
    """The square becomes two triangles."""
    centres, _ = read_ply_file(put(tmp_path, QUADS.encode()), 1.0)
    assert sorted(centres.tolist()) == [[x, y, 0.5] for x in (0.5, 1.5) for y in (0.5, 1.5)] + [
        [2.5, 2.5, 0.5]
    ]


@pytest.mark.parametrize(
    ("text", "size_m", "reason"),
    [
        ("", None, "this is no PLY"),
        ("plywood", None, "this is no PLY"),
        (PLAIN.replace("end_header", ""), None, "no line 'end_header'"),
        (PLAIN.replace("vertex 1", "vertex many"), None, "has 'many' of an element"),
        (PLAIN.replace("vertex 1", "vertex 0"), None, "holds no vertices"),
        (PLAIN.replace("vertex 1", "vertex 2"), None, "truncated, .* announces 2 of 'vertex'"),
        (PLAIN.replace("vertex 1", "vertex 99999999999"), None, "more than 67108864"),
        (PLAIN.replace("element vertex", "element point"), None, "holds no vertices"),
        (PLAIN.replace("float z", "float w"), None, "cannot be read"),
        (PLAIN.replace("float z", "string z"), None, "cannot be read"),
        (PLAIN.replace("2 3\n", "2 three\n"), None, "cannot be read"),
        (PLAIN.replace("1 0.5 2 3", "nan nan nan nan"), None, "no finite point among 1"),
        (PLAIN.replace("1 0.5 2 3", "5e7 0.5 2 3.14"), None, ""),
        (QUADS, None, "mesh of 3 triangles; set world.voxel_size"),
        (QUADS.replace("3 2 4 3", "3 2 9 3"), 1.0, "a corner that is none of 5"),
        (QUADS.replace("3 2 4 3", "3 2 -1 3"), 1.0, "a corner that is none of 5"),
        (QUADS.replace("0 2 0 2 0", "0 nan 0 2 0"), 1.0, "a vertex that is not finite"),
        (QUADS, 1e-5, "3 triangles over 2 x 2 x 0 m are too many for voxels of 1e-05 m"),
        (QUADS.replace("0 2 0 2 0", "0 1e30 0 2 0"), 1.0, "too many for voxels"),
    ],
)
def test_headers_and_meshes(tmp_path: Path, text: str, size_m: float | None, reason: str) -> None:
    """One sentence names the file and the reason."""
    path = put(tmp_path, text.encode())
    if not reason:
        assert len(read_ply_file(path, size_m)[0]) == 1
        return
    with pytest.raises(MapError, match=rf"^\S+cloud\.ply: .*{reason}") as caught:
        read_ply_file(path, size_m)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", ["box", "sphere"])
def test_every_truncation_of_a_mesh_is_refused(tmp_path: Path, suffix: str) -> None:
    """No prefix is a mesh."""
    mesh = trimesh.creation.box() if suffix == "box" else trimesh.creation.icosphere(1)
    whole = mesh.export(file_type="ply")
    for length in range(0, len(whole), 1 if suffix == "box" else 7):
        with pytest.raises(MapError):
            read_ply_file(put(tmp_path, whole[:length]), 0.5)
