"""Meshes in F_A, built-in ones and those of the user's files."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from are_ros.errors import CatalogueError
from are_ros.population.catalogue import CatalogueRow, MeshFile
from are_ros.population.meshes.appearance import drawn_mesh
from are_ros.population.meshes.geometry import MESH_SUFFIXES, file_geometry, mesh_of, shape_geometry
from are_ros.population.meshes.shapes import Shape


def row_of(
    surface: Shape | MeshFile, size_m: tuple[float, float, float] = (1, 1, 1)
) -> CatalogueRow:
    """Make a row round a surface, with the box that the module measures."""
    geometry = (
        file_geometry(surface) if isinstance(surface, MeshFile) else shape_geometry(surface, size_m)
    )
    return CatalogueRow(0, "thing", "class", *geometry, surface, (0.2, 0.4, 0.6, 1.0))


def saved_wedge(path: Path) -> trimesh.Trimesh:
    """Save a wedge, its centre of mass off the middle of its box, and return it."""
    points = [(0, 0, 0), (4, 0, 0), (0, 2, 0), (0, 0, 1), (4, 0, 0.5), (0, 2, 1)]
    wedge = trimesh.convex.convex_hull(np.array(points, dtype=float))
    wedge.export(path)
    return wedge


@pytest.mark.parametrize("shape", Shape)
def test_a_built_in_mesh_has_its_centre_of_mass_at_the_origin(shape: Shape) -> None:
    """F_A is at the centre of mass, and the box that the row states is the mesh's bounds."""
    row = row_of(shape, (1.5, 0.7, 1.2))
    mesh = mesh_of(row)
    np.testing.assert_allclose(mesh.center_mass, 0.0, atol=1e-9)
    np.testing.assert_allclose(mesh.extents, row.size_m, atol=1e-9)
    np.testing.assert_allclose(mesh.bounds.mean(axis=0), row.box_centre_in_artefact_m, atol=1e-9)
    assert row.com_height_m == pytest.approx(-mesh.bounds[0, 2])
    assert mesh.visual.face_colors.shape == (len(mesh.faces), 4)
    assert mesh.face_normals.shape == (len(mesh.faces), 3)
    assert mesh.vertex_normals.shape == (len(mesh.vertices), 3)


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_a_users_mesh_is_read_from_every_format(suffix: str, tmp_path: Path) -> None:
    """Box, volume and centre of mass are those of the mesh that was saved."""
    wedge = saved_wedge(tmp_path / f"wedge{suffix}")
    row = row_of(MeshFile(tmp_path / f"wedge{suffix}"))
    mesh = mesh_of(row)
    np.testing.assert_allclose(row.size_m, (4, 2, 1), atol=1e-6)
    expected = wedge.bounds.mean(axis=0) - wedge.center_mass
    np.testing.assert_allclose(row.box_centre_in_artefact_m, expected, atol=1e-6)
    np.testing.assert_allclose(mesh.bounds.mean(axis=0), expected, atol=1e-6)
    np.testing.assert_allclose(mesh.center_mass, 0.0, atol=1e-6)
    assert mesh.volume == pytest.approx(wedge.volume, rel=1e-5)


def test_unit_scale_and_axes_are_applied(tmp_path: Path) -> None:
    """A mesh in millimetres, up along y and facing -z, comes out in metres, upright, facing +x."""
    box = trimesh.creation.box((2000.0, 1000.0, 4000.0))
    spike = trimesh.creation.cone(100.0, 500.0)
    spike.apply_transform(trimesh.transformations.rotation_matrix(np.pi, (1, 0, 0), (0, 0, 0)))
    spike.apply_translation((0.0, 300.0, -2000.0))
    trimesh.util.concatenate([box, spike]).export(tmp_path / "m.stl")
    row = row_of(MeshFile(tmp_path / "m.stl", 0.001, up="y", forward="-z"))
    np.testing.assert_allclose(row.size_m, (4.5, 2.0, 1.0), atol=1e-6)
    mesh = mesh_of(row)
    tip = mesh.vertices[np.argmax(mesh.vertices[:, 0])]
    assert tip[2] - mesh.bounds[0, 2] == pytest.approx(0.8, abs=1e-5)
    assert mesh.volume > 0.0


@pytest.mark.parametrize("up", ["x", "-x", "y", "-y", "z", "-z"])
@pytest.mark.parametrize("forward", ["x", "-x", "y", "-y", "z", "-z"])
def test_every_pair_of_axes_is_a_rotation(up: str, forward: str, tmp_path: Path) -> None:
    """No choice of axes mirrors the mesh: a corner tetrahedron keeps its handedness."""
    if up[-1] == forward[-1]:
        return
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3)], dtype=float)
    faces = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
    trimesh.Trimesh(points, faces).export(tmp_path / "t.ply")
    mesh = mesh_of(row_of(MeshFile(tmp_path / "t.ply", up=up, forward=forward)))
    edges = mesh.vertices[1:] - mesh.vertices[0]
    assert np.linalg.det(edges) == pytest.approx(6.0)
    length = {"x": 1.0, "y": 2.0, "z": 3.0}
    assert mesh.extents[2] == pytest.approx(length[up[-1]])
    assert mesh.extents[0] == pytest.approx(length[forward[-1]])


def test_an_open_mesh_balances_at_the_centre_of_its_hull(tmp_path: Path) -> None:
    """A box without lid has the centre of mass of the full box."""
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    box.update_faces(box.face_normals[:, 2] < 0.5)
    box.export(tmp_path / "open.ply")
    mesh = mesh_of(row_of(MeshFile(tmp_path / "open.ply")))
    assert not mesh.is_watertight
    np.testing.assert_allclose(mesh.bounds.mean(axis=0), 0.0, atol=1e-6)


def test_the_hull_of_an_open_wedge_balances_as_the_wedge(tmp_path: Path) -> None:
    """Without one face a convex mesh keeps the centre of mass that trimesh gives the whole."""
    wedge = saved_wedge(tmp_path / "whole.ply")
    expected = wedge.bounds.mean(axis=0) - wedge.center_mass
    wedge.update_faces(np.arange(len(wedge.faces)) > 0)
    wedge.export(tmp_path / "open.ply")
    row = row_of(MeshFile(tmp_path / "open.ply"))
    np.testing.assert_allclose(row.box_centre_in_artefact_m, expected, atol=1e-6)


def test_faces_that_point_inwards_are_turned(tmp_path: Path) -> None:
    """A closed surface turned inside out comes out with outward normals."""
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    box.invert()
    box.export(tmp_path / "inside_out.ply")
    assert mesh_of(row_of(MeshFile(tmp_path / "inside_out.ply"))).volume == pytest.approx(6.0)


def test_a_mirrored_part_counts_as_a_part(tmp_path: Path) -> None:
    """Of two closed boxes of which one is wound inwards, the centre of mass is between both."""
    boxes = [trimesh.creation.box((side_m,) * 3) for side_m in (1.0, 0.9)]
    boxes[1].apply_translation((3.0, 0.0, 0.0))
    boxes[1].invert()
    trimesh.util.concatenate(boxes).export(tmp_path / "mirrored.stl")
    mesh = mesh_of(row_of(MeshFile(tmp_path / "mirrored.stl")))
    assert mesh.bounds[0, 0] == pytest.approx(-0.5 - 3.0 * 0.729 / 1.729, abs=1e-6)
    assert mesh.volume == pytest.approx(1.729, rel=1e-6)


def test_a_hole_in_a_closed_part_stays_a_hole(tmp_path: Path) -> None:
    """The inner surface of a tank, not in its middle, moves the centre of mass away."""
    tank, hole = trimesh.creation.box((3.0, 2.0, 2.0)), trimesh.creation.box((1.0, 1.0, 1.0))
    hole.apply_translation((0.8, 0.0, 0.0))
    hole.invert()
    trimesh.util.concatenate([tank, hole]).export(tmp_path / "tank.stl")
    mesh = mesh_of(row_of(MeshFile(tmp_path / "tank.stl")))
    assert mesh.volume == pytest.approx(11.0, rel=1e-6)
    assert mesh.bounds[0, 0] == pytest.approx(-1.5 + 0.8 / 11.0, abs=1e-6)


def test_corners_repeated_for_their_normals_still_close(tmp_path: Path) -> None:
    """A file with own vertices for each face is judged as a surface in space, not as an index."""
    wedge = saved_wedge(tmp_path / "unused.ply")
    wedge.unmerge_vertices()
    wedge.export(tmp_path / "hard_edges.glb", include_normals=True)
    row = row_of(MeshFile(tmp_path / "hard_edges.glb"))
    expected = wedge.bounds.mean(axis=0) - wedge.center_mass
    np.testing.assert_allclose(row.box_centre_in_artefact_m, expected, atol=1e-6)


def test_a_file_of_several_bodies_is_one_mesh(tmp_path: Path) -> None:
    """The bodies of a GLB scene are put together, each where the scene has it."""
    away = trimesh.transformations.translation_matrix((5.0, 0.0, 0.0))
    scene = trimesh.Scene([trimesh.creation.box((1, 1, 1)), trimesh.creation.box((1, 1, 1), away)])
    scene.export(tmp_path / "scene.glb")
    row = row_of(MeshFile(tmp_path / "scene.glb"))
    np.testing.assert_allclose(row.size_m, (6, 1, 1), atol=1e-6)


def test_colours_of_the_file_win_over_the_rows(tmp_path: Path) -> None:
    """A coloured PLY keeps its colours; a bare one takes the row's."""
    box = trimesh.creation.box((1, 1, 1))
    box.export(tmp_path / "bare.ply")
    box.visual.vertex_colors = np.tile((250, 128, 0, 255), (8, 1))
    box.export(tmp_path / "orange.ply")
    bare = mesh_of(row_of(MeshFile(tmp_path / "bare.ply")))
    orange = mesh_of(row_of(MeshFile(tmp_path / "orange.ply")))
    assert (bare.visual.face_colors == (51, 102, 153, 255)).all()
    assert (orange.visual.face_colors == (250, 128, 0, 255)).all()


def plain_material(colour: tuple[int, int, int, int]) -> trimesh.visual.TextureVisuals:
    """Make the material of a GLB that has a colour and no texture."""
    material = trimesh.visual.material.PBRMaterial(baseColorFactor=colour)
    return trimesh.visual.TextureVisuals(material=material)


def test_the_materials_of_a_scene_become_colours_of_faces(tmp_path: Path) -> None:
    """Two bodies of a GLB keep a colour each; a third without material takes the row's."""
    bodies = [trimesh.creation.box((1, 1, 1)) for _ in range(3)]
    for number, body in enumerate(bodies):
        body.apply_translation((3.0 * number, 0.0, 0.0))
    bodies[0].visual = plain_material((255, 0, 0, 255))
    bodies[1].visual = plain_material((0, 255, 0, 255))
    trimesh.Scene(bodies).export(tmp_path / "scene.glb")
    mesh = mesh_of(row_of(MeshFile(tmp_path / "scene.glb", forward="x", up="y")))
    order = np.argsort(mesh.triangles_center[:, 0])
    expected = np.repeat([(255, 0, 0, 255), (0, 255, 0, 255), (51, 102, 153, 255)], 12, axis=0)
    np.testing.assert_array_equal(mesh.visual.face_colors[order], expected)


def save_glb(path: Path, material: dict[str, Any] | None, colours: Any = None) -> None:
    """Save a box as other programs do: a material as given, colours at the corners or none."""
    box = trimesh.creation.box((1, 1, 1))
    arrays = {"POSITION": (box.vertices.astype("<f4"), 5126, "VEC3")}
    if colours is not None:
        kind = {"f": 5126, "u": 5123}[colours.dtype.kind]
        arrays["COLOR_0"] = (np.tile(colours, (8, 1)), kind, f"VEC{len(colours)}")
    numbers = box.faces.reshape(-1).astype("<u4")
    parts = [*arrays.values(), (numbers, 5125, "SCALAR")]
    starts = np.cumsum([0, *(part[0].nbytes for part in parts)]).tolist()
    views = [
        {"buffer": 0, "byteOffset": start, "byteLength": part[0].nbytes}
        for start, part in zip(starts, parts, strict=False)
    ]
    accessors = [
        {"bufferView": k, "componentType": kind, "count": len(values), "type": shape}
        | ({"normalized": True} if kind == 5123 else {})
        for k, (values, kind, shape) in enumerate(parts)
    ]
    primitive = {"attributes": {name: k for k, name in enumerate(arrays)}, "indices": len(arrays)}
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "bufferViews": views,
        "accessors": accessors,
        "meshes": [{"primitives": [primitive | ({} if material is None else {"material": 0})]}],
        "buffers": [{"byteLength": starts[-1]}],
        **({} if material is None else {"materials": [material]}),
    }
    text, data = json.dumps(tree).encode(), b"".join(part[0].tobytes() for part in parts)
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4s4I", b"glTF", 2, 28 + len(text) + len(data), len(text), 0x4E4F534A)
    path.write_bytes(head + text + struct.pack("<2I", len(data), 0x004E4942) + data)


@pytest.mark.parametrize(
    ("material", "colours", "expected"),
    [
        ({}, None, (255, 255, 255)),
        ({"pbrMetallicRoughness": {"metallicFactor": 0.0}}, None, (255, 255, 255)),
        ({"pbrMetallicRoughness": {"baseColorFactor": [1, 0.2159, 0, 1]}}, None, (255, 128, 0)),
        (None, np.array((1.0, 0.2159, 0.0, 1.0), "<f4"), (255, 128, 0)),
        (None, np.array((1.0, 0.2159, 0.0), "<f4"), (255, 128, 0)),
        ({}, np.array((65535, 14149, 0, 65535), "<u2"), (255, 128, 0)),
        (
            {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 1]}},
            np.array((1.0, 0.2159, 0.0, 1.0), "<f4"),
            (255, 128, 0),
        ),
        (
            {"pbrMetallicRoughness": {"baseColorFactor": [0.498, 1, 1, 1]}},
            np.array((1.0, 0.2159, 0.0, 1.0), "<f4"),
            (188, 128, 0),
        ),
    ],
)
def test_the_colours_of_a_glb_are_as_gltf_says(
    material: dict[str, Any] | None,
    colours: Any,
    expected: tuple[int, int, int],
    tmp_path: Path,
) -> None:
    """Factors are linear, and 1 where none is given; those of corners multiply the material's."""
    save_glb(tmp_path / "box.glb", material, colours)
    source = MeshFile(tmp_path / "box.glb", forward="z", up="y")
    mesh = mesh_of(row_of(source))
    np.testing.assert_allclose(mesh.visual.face_colors, [(*expected, 255)] * 12, atol=1)
    drawn = drawn_mesh(row_of(source), np.random.default_rng(0))
    np.testing.assert_allclose(255.0 * drawn.colours, np.full((12, 3, 3), expected), atol=1)


@pytest.mark.parametrize(
    ("required", "normalised", "expected"),
    [
        ("KHR_draco_mesh_compression", "", "is compressed .KHR_draco_mesh_compression."),
        ("EXT_meshopt_compression", "", "is compressed .EXT_meshopt_compression."),
        ("KHR_mesh_quantization", "POSITION", "has its POSITION in normalised integers"),
    ],
)
def test_a_packed_glb_is_refused_with_the_remedy(
    required: str, normalised: str, expected: str, tmp_path: Path
) -> None:
    """Trimesh reads zeros, damage or integers where numbers are packed."""
    path = tmp_path / "packed.glb"
    save_glb(path, None)
    data = path.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    tree = json.loads(data[20 : 20 + length])
    tree["extensionsRequired"] = tree["extensionsUsed"] = [required]
    if normalised:
        number = tree["meshes"][0]["primitives"][0]["attributes"][normalised]
        tree["accessors"][number]["normalized"] = True
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    sizes = struct.pack("<2I", len(data) - length + len(text), len(text))
    path.write_bytes(data[:8] + sizes + data[16:20] + text + data[20 + length :])
    with pytest.raises(CatalogueError, match=f"packed.glb {expected}.* not read here: save it"):
        file_geometry(MeshFile(path))


def test_the_colour_of_an_obj_material_is_kept(tmp_path: Path) -> None:
    """A material library beside an OBJ file, without texture, paints the faces."""
    (tmp_path / "m.mtl").write_text("newmtl red\nKd 1 0 0\n")
    body = trimesh.creation.box((1, 1, 1)).export(file_type="obj")
    (tmp_path / "m.obj").write_text(f"mtllib m.mtl\nusemtl red\n{body}")
    mesh = mesh_of(row_of(MeshFile(tmp_path / "m.obj")))
    assert (mesh.visual.face_colors == (255, 0, 0, 255)).all()


def test_a_texture_becomes_its_colour_at_the_corners(tmp_path: Path) -> None:
    """Where an image is laid on the mesh, each face has the mean of its corners' colours."""
    image = pytest.importorskip("PIL.Image", reason="Pillow is not there to read textures")
    box = trimesh.creation.box((1, 1, 1))
    picture = image.new("RGB", (8, 8), (10, 200, 30))
    box.visual = trimesh.visual.TextureVisuals(uv=np.full((8, 2), 0.5), image=picture)
    box.export(tmp_path / "textured.glb")
    mesh = mesh_of(row_of(MeshFile(tmp_path / "textured.glb")))
    assert (mesh.visual.face_colors == (10, 200, 30, 255)).all()


WITH_INDEX = b"""ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 1
3 0 1 INDEX
"""


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("missing.stl", None, "does not exist"),
        ("notes.txt", b"hello", "is none of OBJ, STL, PLY, GLB"),
        ("empty.obj", b"# nothing\n", "holds no triangles"),
        ("short.stl", bytes(80) + b"\x0c\0\0\0" + bytes(70), "or is cut short"),
        ("broken.glb", b"glTFxxxxxxxxx", "cannot be read: it is truncated or malformed"),
        ("broken.ply", b"ply\nformat nonsense\n", "cannot be read: it is truncated or malformed"),
        ("far.ply", WITH_INDEX.replace(b"INDEX", b"3"), "none of its 3 vertices"),
        ("negative.ply", WITH_INDEX.replace(b"INDEX", b"-1"), "none of its 3 vertices"),
        ("level.obj", b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "have not three coordinates"),
        ("nan.obj", b"v 0 0 1\nv 0 0 0\nv 1 0 0\nv 0 nan 1\nf 1 2 3\nf 2 3 4\n", "not finite"),
    ],
)
def test_a_file_that_is_no_mesh_is_refused(
    name: str, content: bytes | None, words: str, tmp_path: Path
) -> None:
    """The refusal names the file and the reason."""
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(CatalogueError, match=words) as refusal:
        file_geometry(MeshFile(tmp_path / name))
    assert name in str(refusal.value)


@pytest.mark.parametrize("height", [0.0, 1.0])
def test_a_flat_mesh_is_refused(height: float, tmp_path: Path) -> None:
    """A sheet, level or tilted, has no centre of mass and no box."""
    corners = [(0, 0, 0), (1, 0, height), (0, 1, height), (1, 1, 2 * height)]
    trimesh.Trimesh(corners, [(0, 1, 2), (1, 3, 2)]).export(tmp_path / "flat.ply")
    with pytest.raises(CatalogueError, match="is flat"):
        file_geometry(MeshFile(tmp_path / "flat.ply"))
