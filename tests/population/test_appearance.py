"""What a camera sees of artefacts: persons that differ, and the textures of mesh files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.builder.rendering.surface import SurfaceBank
from are_ros.population.catalogue import CatalogueRow, MeshFile
from are_ros.population.meshes.appearance import DrawnMesh, drawn_mesh
from are_ros.population.meshes.geometry import file_geometry

PERSONS = [row for row in read_catalogue().rows if row.class_name == "person"]


def drawn(source: MeshFile) -> DrawnMesh:
    """Return what is drawn of a mesh file."""
    size_m, centre_m = file_geometry(source)
    row = CatalogueRow(0, "thing", "thing", size_m, centre_m, source, (0.2, 0.4, 0.6, 1.0))
    return drawn_mesh(row, np.random.default_rng(0))


@pytest.mark.parametrize("row", PERSONS, ids=lambda row: row.label)
def test_a_person_stands_in_its_box(row: CatalogueRow) -> None:
    """Feet on the ground, as tall as the box; each part closed, its faces and normals outwards."""
    half = 0.5 * np.array(row.size_m)
    for seed in range(3):
        mesh = drawn_mesh(row, np.random.default_rng(seed))
        low, high = mesh.corners_m.min(axis=(0, 1)), mesh.corners_m.max(axis=(0, 1))
        assert (low >= -half - 1e-9).all()
        assert (high <= half + 1e-9).all()
        np.testing.assert_allclose((low[2], high[2]), (-half[2], half[2]), atol=0.005)
        assert (high - low)[1] > 0.8 * row.size_m[1]
        assert (mesh.colours >= 0.0).all()
        assert (mesh.colours <= 1.0).all()
        points = mesh.corners_m.reshape(-1, 3)
        body = trimesh.Trimesh(points, np.arange(len(points)).reshape(-1, 3))
        assert body.is_watertight
        assert min(part.volume for part in body.split()) > 0.0
        assert mesh.normals is not None
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=2), 1.0, atol=1e-9)
        flat = np.cross(
            mesh.corners_m[:, 1] - mesh.corners_m[:, 0], mesh.corners_m[:, 2] - mesh.corners_m[:, 0]
        )
        area = np.linalg.norm(flat, axis=1)
        agreement = np.einsum("fi,fci->f", flat, mesh.normals) / (3.0 * np.maximum(area, 1e-12))
        assert (agreement[area > 1e-7] > 0.0).mean() > 0.98


def test_no_two_persons_look_alike() -> None:
    """Forty of one row differ in colours, and in shape; the same seed and id give the same one."""
    bank, again = SurfaceBank(7), SurfaceBank(7)
    row = PERSONS[4]
    surfaces = [bank.of(row, number) for number in range(40)]
    assert len({surface.colours.tobytes() for surface in surfaces}) == 40
    assert len({surface.corners_m.tobytes() for surface in surfaces}) == 40
    assert again.of(row, 12).corners_m.tobytes() == surfaces[12].corners_m.tobytes()
    assert SurfaceBank(8).of(row, 12).corners_m.tobytes() != surfaces[12].corners_m.tobytes()


def test_a_thing_has_one_look() -> None:
    """Artefacts of a row that is no person share a surface."""
    row = next(row for row in read_catalogue().rows if row.class_name == "pallet")
    bank = SurfaceBank(7)
    assert bank.of(row, 1) is bank.of(row, 2)


def picture(*tones: tuple[int, int, int]) -> Any:
    """Return an image of 8 x 8 pixels with these rows of colours, from the top."""
    image = pytest.importorskip("PIL.Image", reason="Pillow is not there to read textures")
    rows = np.repeat(np.array(tones, dtype=np.uint8), 8 // len(tones), axis=0)
    return image.fromarray(np.ascontiguousarray(np.repeat(rows[:, np.newaxis], 8, axis=1)))


def laid(uv: Any, image: Any, factor: tuple[int, int, int, int] | None = None) -> Any:
    """Return a glTF material with a picture."""
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image, baseColorFactor=factor)
    return trimesh.visual.TextureVisuals(uv=uv, material=material)


def test_the_factor_of_a_material_dims_its_texture(tmp_path: Path) -> None:
    """As glTF says: factors multiply intensities."""
    body = trimesh.creation.box((1, 1, 1))
    uv = np.tile((0.5, 0.5), (8, 1))
    body.visual = laid(uv, picture((250, 250, 250)), (255, 128, 0, 255))
    body.export(tmp_path / "dim.glb")
    texture = drawn(MeshFile(tmp_path / "dim.glb")).texture
    np.testing.assert_allclose(texture.reshape(-1, 3), [(250, 184, 0)] * 64, atol=3)


def looked_up(mesh: DrawnMesh) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return the texture's colours in the middles of faces, one by one."""
    height, width = mesh.texture.shape[:2]
    middles = mesh.uvs.mean(axis=1)
    return np.array([mesh.texture[int((1.0 - v) * height), int(u * width)] for u, v in middles])


def test_textures_of_a_file_are_kept(tmp_path: Path) -> None:
    """Two bodies with a picture each, beyond its edge in one, and a third of plain colour."""
    bodies = [trimesh.creation.box((1, 1, 1)) for _ in range(3)]
    for number, body in enumerate(bodies):
        body.apply_translation((2.0 * number, 0.0, 0.0))
    bodies[0].visual = laid(np.tile((0.5, 0.25), (8, 1)), picture((9, 8, 7), (200, 0, 0)))
    bodies[1].visual = laid(np.tile((3.5, -1.25), (8, 1)), picture((0, 0, 250), (1, 2, 3)))
    trimesh.Scene(bodies).export(tmp_path / "scene.glb")
    mesh = drawn(MeshFile(tmp_path / "scene.glb"))
    is_plain = np.isnan(mesh.uvs).all(axis=(1, 2))
    assert np.isnan(mesh.uvs).any(axis=(1, 2)).sum() == is_plain.sum() == 12
    place = mesh.corners_m.mean(axis=1)[:, 0]
    for middle, expected in ((-2.0, (200, 0, 0)), (0.0, (0, 0, 250))):
        is_there = (np.abs(place - middle) < 0.9) & ~is_plain
        colours = looked_up(
            DrawnMesh(
                *(mesh.corners_m[is_there], mesh.colours[is_there], None),
                *(mesh.uvs[is_there], mesh.texture, False),
            )
        )
        assert len(colours) == 12
        assert (colours == expected).all()


def test_a_repeated_texture_is_repeated(tmp_path: Path) -> None:
    """A face that spans four repetitions shows the picture four times."""
    body = trimesh.creation.box((1, 1, 1))
    uv = np.where(body.vertices[:, [0, 1]] > 0.0, (1.0, 4.0), (0.0, 0.0))
    body.visual = laid(uv, picture((255, 0, 0), (0, 0, 255)))
    body.export(tmp_path / "tiled.glb")
    mesh = drawn(MeshFile(tmp_path / "tiled.glb"))
    assert mesh.texture.shape == (32, 8, 3)
    reds = mesh.texture[:, 0, 0] > 0
    assert reds.tolist() == [row % 8 < 4 for row in range(32)]
    assert np.ptp(mesh.uvs[:, :, 1]) > 0.9


def test_normals_of_a_file_are_kept(tmp_path: Path) -> None:
    """A GLB's own normals come with it, turned as the file's axes are."""
    body = trimesh.creation.icosphere(subdivisions=1)
    body.export(tmp_path / "ball.glb", include_normals=True)
    for up, forward in (("z", "x"), ("y", "z")):
        mesh = drawn(MeshFile(tmp_path / "ball.glb", up=up, forward=forward))
        assert mesh.normals is not None
        np.testing.assert_allclose(mesh.normals, mesh.corners_m, atol=0.05)


def test_vertex_colours_of_a_file_are_kept_at_the_corners(tmp_path: Path) -> None:
    """Of a PLY with a colour for each vertex, faces are shaded from corner to corner."""
    body = trimesh.creation.box((1, 1, 1))
    body.visual.vertex_colors = np.where(body.vertices[:, 2:] > 0, (250, 0, 0, 255), (0, 0, 0, 255))
    body.export(tmp_path / "shaded.ply")
    mesh = drawn(MeshFile(tmp_path / "shaded.ply"))
    is_high = mesh.corners_m[:, :, 2] > 0.0
    np.testing.assert_allclose(mesh.colours[:, :, 0], np.where(is_high, 250 / 255, 0.0))
