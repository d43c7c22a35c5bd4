"""What a camera sees of artefacts: persons that differ, and the textures of mesh files."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.builder.rendering.surface import SurfaceBank
from are_ros.errors import CatalogueError
from are_ros.population.catalogue import CatalogueRow, MeshFile
from are_ros.population.meshes import appearance, detail
from are_ros.population.meshes.appearance import DrawnMesh, drawn_mesh
from are_ros.population.meshes.detail import BodySpec
from are_ros.population.meshes.geometry import file_geometry, shape_geometry, surface_of
from are_ros.population.meshes.shapes import Shape

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


def test_another_seed_changes_the_looks_of_later_ones_alone() -> None:
    """Who is there keeps its looks, though it is painted again."""
    bank, row = SurfaceBank(7), PERSONS[4]
    present = bank.of(row, 12)
    bank.seed = 8
    assert bank.of(row, 12) is present
    assert bank.of(row, 13).corners_m.tobytes() == SurfaceBank(8).of(row, 13).corners_m.tobytes()


THINGS = [row for row in read_catalogue().rows if row.class_name != "person"]


@pytest.mark.parametrize("row", THINGS, ids=lambda row: row.label)
def test_a_thing_fills_its_box(row: CatalogueRow) -> None:
    """Its bounds are the row's box, it is closed, faces outwards, and has few triangles."""
    half = 0.5 * np.array(row.size_m)
    for seed in range(3):
        mesh = drawn_mesh(row, np.random.default_rng(seed))
        np.testing.assert_allclose(mesh.corners_m.min(axis=(0, 1)), -half, atol=1e-9)
        np.testing.assert_allclose(mesh.corners_m.max(axis=(0, 1)), half, atol=1e-9)
        assert 200 < len(mesh.corners_m) < 4000
        assert 0.0 <= mesh.colours.min() <= mesh.colours.max() <= 1.0
        spec = BodySpec(row.size_m, row.colour, np.random.default_rng(seed), row.features)
        solid = appearance._MAKERS[Shape(row.surface)](spec)
        body = trimesh.Trimesh(solid.vertices_m, solid.faces, process=False)
        assert body.is_watertight
        assert body.is_winding_consistent
        assert min(part.volume for part in body.split(only_watertight=False)) > 0.0
        assert np.ptp(solid.vertices_m, axis=0) == pytest.approx(row.size_m, rel=0.08)


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape is not Shape.PERSON])
def test_a_finer_body_is_seen_where_the_coarse_one_is(shape: Shape) -> None:
    """From the side, its silhouette and that of the shape that sensors see are mostly the same."""
    row = next((row for row in THINGS if row.surface is shape), None)
    size_m = (1.0, 0.8, 0.6) if row is None else row.size_m
    features = {} if row is None else row.features
    made = CatalogueRow(
        *(0, "thing", "thing", *shape_geometry(shape, size_m), shape), features=features
    )
    fine = drawn_mesh(made, np.random.default_rng(3)).corners_m
    vertices_m, faces, _ = surface_of(made)
    coarse = (vertices_m - np.array(made.box_centre_in_artefact_m))[faces]
    side = 1 if size_m[0] >= size_m[1] else 0
    seen, expected = (silhouette(corners, 1 - side, size_m) for corners in (fine, coarse))
    assert (seen & expected).sum() > 0.6 * (seen | expected).sum()


def silhouette(corners_m: Any, axis: int, size_m: tuple[float, float, float]) -> Any:
    """Return which of 60 x 60 cells of the box's side (along the axis, upwards) are covered."""
    image = np.zeros((60, 60), dtype=np.uint8)
    scale = 60.0 / np.array((size_m[axis], size_m[2]))
    for triangle in (corners_m[:, :, [axis, 2]] * scale + 30.0) * 16.0:
        cv2.fillConvexPoly(image, np.rint(triangle).astype(np.int32), 1, shift=4)
    return image > 0


def test_two_things_of_a_row_differ() -> None:
    """Paint, plates, wood and loads follow from the seed and the id, and are the same again."""
    bank, again = SurfaceBank(7), SurfaceBank(7)
    for label in ("car_city_red", "pallet_euro", "pallet_loaded", "structure_cone"):
        row = next(row for row in THINGS if row.label == label)
        looks = [bank.of(row, number).colours.tobytes() for number in range(10)]
        assert len(set(looks)) == 10
        assert again.of(row, 4).colours.tobytes() == looks[4]


def test_the_paint_of_a_car_stays_near_the_colour_of_its_row() -> None:
    """A red car is a red one in every shade: most of its surface has the row's hue."""
    row = next(row for row in THINGS if row.label == "car_city_red")
    for seed in range(10):
        mesh = drawn_mesh(row, np.random.default_rng(seed))
        sides = mesh.corners_m[:, 1:] - mesh.corners_m[:, :1]
        area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
        red, green, blue = mesh.colours[:, 0].T
        assert area[(red > 2.0 * green) & (red > 2.0 * blue)].sum() > 0.35 * area.sum()


def test_cars_show_their_lights_and_wheels_where_they_are() -> None:
    """Headlights in front, tail lights behind, and tyres on the ground at four corners."""
    row = next(row for row in THINGS if row.label == "car_saloon_grey")
    mesh = drawn_mesh(row, np.random.default_rng(0))
    middles, tones = mesh.corners_m.mean(axis=1), mesh.colours[:, 0]
    for tone, is_in_front in ((detail.HEADLIGHT, True), (detail.TAIL_LIGHT, False)):
        places = middles[(np.abs(tones - tone[:3]) < 1e-9).all(axis=1)]
        assert len(places) > 0
        assert ((places[:, 0] > 1.5) == is_in_front).all()
        assert ((places[:, 0] < -1.5) != is_in_front).all()
    tyres = middles[(np.abs(tones - detail.TYRE[:3]) < 1e-9).all(axis=1)]
    assert {(x > 0, y > 0) for x, y, _ in tyres.tolist()} == {
        (front, left) for front in (False, True) for left in (False, True)
    }


def test_a_mesh_of_the_users_has_one_look(tmp_path: Path) -> None:
    """Artefacts of a row with a file share a surface."""
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "box.ply")
    source = MeshFile(tmp_path / "box.ply")
    row = CatalogueRow(0, "thing", "thing", *file_geometry(source), source)
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


def cut(image: Any, **properties: Any) -> Any:
    """Return a square plate of 1 x 0.1 x 1 m that shows an image with a material's properties."""
    body = trimesh.creation.box((1.0, 0.1, 1.0))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image, **properties)
    uv = body.vertices[:, [0, 2]] + 0.5
    body.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    return body


def half_clear() -> Any:
    """Return a green image of 16 x 16 pixels whose upper half is transparent."""
    image = pytest.importorskip("PIL.Image", reason="Pillow is not there to read textures")
    pixels = np.full((16, 16, 4), (0, 200, 0, 255), dtype=np.uint8)
    pixels[:8, :, 3] = 0
    return image.fromarray(pixels)


def area_above(mesh: DrawnMesh, low_m: float) -> float:
    """Return the area of the triangles of a mesh whose middle is higher [m^2]."""
    sides = mesh.corners_m[:, 1:] - mesh.corners_m[:, :1]
    areas = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return float(areas[mesh.corners_m.mean(axis=1)[:, 2] > low_m].sum())


def test_what_a_material_cuts_out_is_not_drawn(tmp_path: Path) -> None:
    """Of a plate whose upper half is masked the lower is left, in its place in the box."""
    cut(half_clear(), alphaMode="MASK", alphaCutoff=0.5).export(tmp_path / "cut.glb")
    mesh = drawn(MeshFile(tmp_path / "cut.glb"))
    assert area_above(mesh, 0.0) < 0.02 * area_above(mesh, -1.0)
    assert mesh.corners_m[:, :, 2].min() == pytest.approx(-0.5)
    assert area_above(mesh, -1.0) == pytest.approx(1.2, rel=0.1)


@pytest.mark.parametrize("mode", ["BLEND", "OPAQUE", None])
def test_other_materials_are_drawn_opaque(mode: str | None, tmp_path: Path) -> None:
    """The same plate, half transparent or with an alpha that counts for nothing."""
    cut(half_clear(), alphaMode=mode).export(tmp_path / "whole.glb")
    assert area_above(drawn(MeshFile(tmp_path / "whole.glb")), -1.0) == pytest.approx(2.4)


def test_a_mesh_of_which_nothing_is_left_is_refused(tmp_path: Path) -> None:
    """A factor below the cutoff hides all of a body."""
    plate = cut(half_clear(), alphaMode="MASK", alphaCutoff=0.5, baseColorFactor=(255, 255, 255, 9))
    plate.export(tmp_path / "clear.glb")
    with pytest.raises(CatalogueError, match="shows nothing: its materials are transparent"):
        drawn(MeshFile(tmp_path / "clear.glb"))


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


@pytest.mark.parametrize("has_normals", [False, True])
def test_a_texture_repeated_many_times_is_repeated_everywhere(
    tmp_path: Path, has_normals: bool
) -> None:
    """Of a wall of 30 rows of bricks, each row has the picture's colours at its height."""
    body = trimesh.creation.box((1, 1, 1))
    body.visual = laid(30.0 * body.vertices[:, [0, 2]], picture((255, 0, 0), (0, 0, 255)))
    body.export(tmp_path / "bricks.glb", include_normals=has_normals)
    mesh = drawn(MeshFile(tmp_path / "bricks.glb", up="z", forward="x"))
    shares = np.random.default_rng(1).dirichlet((1.0, 1.0, 1.0), 50)
    heights_m = 30.0 * np.einsum("sk,fk->fs", shares, mesh.corners_m[:, :, 2])
    u, v = np.einsum("sk,fka->afs", shares, mesh.uvs)
    rows, columns = mesh.texture.shape[:2]
    found = mesh.texture[((1.0 - v) * rows).astype(int), (u * columns).astype(int)]
    is_between = np.abs(heights_m * 2.0 - np.rint(heights_m * 2.0)) > 0.1
    is_red = found[..., 0] > 0
    assert (is_red == (heights_m % 1.0 > 0.5))[is_between].all()
    if has_normals:
        assert mesh.normals is not None
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=2), 1.0, atol=1e-6)
    else:
        assert mesh.normals is None


def test_bodies_with_one_picture_share_it(tmp_path: Path) -> None:
    """A file of many parts with a common texture does not fill the memory with copies."""
    bodies = [trimesh.creation.box((1, 1, 1)) for _ in range(20)]
    visual = laid(np.tile((0.5, 0.5), (8, 1)), picture((255, 0, 0), (0, 0, 255)))
    for number, body in enumerate(bodies):
        body.apply_translation((2.0 * number, 0.0, 0.0))
        body.visual = visual
    trimesh.Scene(bodies).export(tmp_path / "parts.glb")
    mesh = drawn(MeshFile(tmp_path / "parts.glb"))
    assert mesh.texture.shape == (8, 8, 3)
    assert len(mesh.corners_m) == 20 * 12


def test_places_in_a_texture_that_are_no_numbers_are_taken_for_0(tmp_path: Path) -> None:
    """Some scanned meshes have them."""
    body = trimesh.creation.box((1, 1, 1))
    uv = np.full((8, 2), 0.5)
    uv[0] = np.nan
    body.visual = laid(uv, picture((255, 0, 0)))
    body.export(tmp_path / "nan.glb")
    mesh = drawn(MeshFile(tmp_path / "nan.glb"))
    assert np.isfinite(mesh.uvs).all()


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
