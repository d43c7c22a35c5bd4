"""The mesh of a made scene: what rays hit, what the files hold, and which cells are floor."""

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import trimesh

from are_ros.draw.palette import class_colours
from are_ros.draw.scene import ArtefactAt, Moment
from are_ros.draw.viewer import ViewedPlace
from are_ros.errors import BagError
from are_ros.export.scene_mesh import Part, scene_parts, write_scene
from are_ros.parameters.choices import GroundKind
from are_ros.parameters.model import WorldParameters
from are_ros.population.artefact import GroundPose
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.world.footprint import Footprint
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap
from tests.oracles.lattices import Lattice
from tests.oracles.rays import ray_hits_m

Floats = npt.NDArray[np.float64]
WORLD = WorldParameters()
UPRIGHT = np.array(((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)))
"""From glTF's axes to the map's: z is glTF's y, y is its -z."""


def place(
    voxels: VoxelMap | None = None,
    catalogue: Catalogue = Catalogue(()),  # noqa: B008
) -> ViewedPlace:
    """Return a room of 4 m by 3 m with walls around it, and half a metre of unknown at one end.

    Without voxels the walls are extruded.
    """
    cells = np.zeros((30, 40), dtype=np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    cells[1:-1, 1:6] = -1
    grid = OccupancyGrid(cells, 0.1, RigidTransform.planar(-1.0, 0.5, 0.0), "map")
    voxels = voxels or VoxelMap.extruded(grid, cells >= 65, 2.5, 0.0)
    return ViewedPlace(grid, voxels, catalogue, Footprint(np.zeros((1, 2)), 0.3), None, 10.0, 0.0)


def blocks(seed: int) -> VoxelMap:
    """Return voxels that stand about in the room, above the floor and one of them on it."""
    occupied = (np.random.default_rng(seed).random((20, 15, 10)) < 0.04).astype(np.uint8)
    occupied[:, :, 0] = 0
    occupied[4, 5, 0] = 1
    return VoxelMap(RigidTransform.planar(-1.0, 0.5, 0.0), (0.2, 0.2, 0.2), occupied)


def artefact(number: int, class_name: str, pose: GroundPose) -> ArtefactAt:
    """Return a box whose centre is not that of mass."""
    row = CatalogueRow(
        number, f"{class_name}_a", class_name, (0.6, 0.4, 1.2), (0.1, 0.0, 0.2), Shape.WALL
    )
    return ArtefactAt(number, row, pose, "walking", "", 0)


ARTEFACTS = (
    artefact(7, "person", GroundPose(0.5, 1.5, 0.0, 0.3)),
    artefact(17, "car", GroundPose(1.7, 2.2, 0.1, -2.0)),
)


def moment(artefacts: Sequence[ArtefactAt] = ARTEFACTS) -> Moment:
    """Return a tick."""
    return Moment(0, artefacts, frozenset(), None, None)


def written(folder: Path, suffix: str, parts: Sequence[Part]) -> Any:
    """Return what trimesh reads of a file of these parts."""
    path = folder / f"scene{suffix}"
    assert write_scene(path, parts) == path.stat().st_size
    return trimesh.load(path, process=False)


def gltf(path: Path) -> dict[str, Any]:
    """Return the JSON of a GLB."""
    data = path.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    content: dict[str, Any] = json.loads(data[20 : 20 + length])
    return content


@pytest.mark.parametrize("suffix", [".glb", ".ply"])
def test_rays_hit_the_file_where_voxels_boxes_and_floor_are(tmp_path: Path, suffix: str) -> None:
    """The first hits of random rays are those of a walk over the lattice, and of slabs."""
    voxels = blocks(3)
    scene = written(tmp_path, suffix, scene_parts(place(voxels), WORLD, moment()))
    mesh = scene.to_mesh() if suffix == ".glb" else scene
    if suffix == ".glb":
        mesh.vertices = mesh.vertices @ UPRIGHT.T
    rng = np.random.default_rng(1)
    start = np.array((1.3, 1.9, 1.05))
    ways = rng.normal(size=(3000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    starts = np.tile(start, (len(ways), 1))
    points, rays, _ = mesh.ray.intersects_location(starts, ways, multiple_hits=False)
    found = np.full(len(ways), np.inf)
    found[rays] = np.linalg.norm(points - start, axis=1)
    corner = voxels.map_from_lattice.translation_m
    lattice = Lattice(voxels.occupied.astype(bool), corner, np.full(3, 0.2))
    expected = lattice.first_solid(starts, ways, np.full(len(ways), 20.0))
    for one in ARTEFACTS:
        x, y, z, yaw = one.pose
        ahead = 0.1 * np.array((math.cos(yaw), math.sin(yaw)))
        centre = np.array((x + ahead[0], y + ahead[1], z + 0.6))
        expected = np.minimum(
            expected, ray_hits_m(start, ways, centre, yaw, np.array((0.3, 0.2, 0.6)))
        )
    to_floor = np.where(ways[:, 2] < 0.0, -start[2] / ways[:, 2], np.inf)
    cells = np.floor((start + to_floor[:, None] * ways)[:, :2] / 0.1 - (-10.0, 5.0))
    with np.errstate(invalid="ignore"):
        is_floor = ((cells >= (6, 1)) & (cells < (39, 29))).all(axis=1)
    expected = np.minimum(expected, np.where(is_floor, to_floor, np.inf))
    assert np.isfinite(expected).mean() > 0.5
    assert np.isclose(found, expected, atol=1e-4).mean() > 0.995  # but where a ray grazes an edge


def test_a_glb_has_a_named_node_for_each_part_in_the_colour_of_its_class(tmp_path: Path) -> None:
    """Colours are linear, as the standard wants them; equal shapes are written once."""
    two = (*ARTEFACTS, replace_pose(ARTEFACTS[1], 23, GroundPose(2.0, 3.0, 0.0, 0.0)))
    parts = scene_parts(place(blocks(3)), WORLD, moment(two))
    scene = written(tmp_path, ".glb", parts)
    names = ["environment", "floor", "person_a 7", "car_a 17", "car_a 23"]
    assert [part.name for part in parts] == names
    assert sorted(scene.graph.nodes_geometry) == sorted(names)
    content = gltf(tmp_path / "scene.glb")
    assert len(content["meshes"]) == 4
    (turned,) = (node for node in content["nodes"] if node["name"] == "map")
    assert sorted(content["nodes"][i]["name"] for i in turned["children"]) == sorted(names)
    colours = {
        material["name"]: material["pbrMetallicRoughness"]["baseColorFactor"]
        for material in content["materials"]
    }
    person = np.array(class_colours([])["person"]) / 255.0
    assert colours["person_a of row 7"][:3] == pytest.approx(person**2.2, abs=0.02)
    assert colours["person_a of row 7"][3] == 1.0


def replace_pose(one: ArtefactAt, number: int, pose: GroundPose) -> ArtefactAt:
    """Return another artefact of the same row."""
    return one._replace(artefact_id=number, pose=pose)


def test_both_files_have_the_same_bounds_one_with_y_up(tmp_path: Path) -> None:
    """A GLB's bounds are the PLY's: x, z, -y."""
    parts = scene_parts(place(blocks(5)), WORLD, moment())
    points = np.concatenate([part.map_from_part.apply(part.vertices_m) for part in parts])
    low, high = points.min(axis=0), points.max(axis=0)
    ply, glb = written(tmp_path, ".ply", parts), written(tmp_path, ".glb", parts)
    assert ply.bounds == pytest.approx(np.stack((low, high)), abs=1e-5)
    turned = np.array(((low[0], low[2], -high[1]), (high[0], high[2], -low[1])))
    assert glb.bounds == pytest.approx(turned, abs=1e-5)
    for part in parts:
        world_from_part = glb.graph[part.name][0]
        node = trimesh.transform_points(glb.geometry[part.shape].vertices, world_from_part)
        expected = part.map_from_part.apply(part.vertices_m)
        assert node @ UPRIGHT.T == pytest.approx(expected, abs=1e-5)


def test_a_ply_has_the_colours_at_its_vertices(tmp_path: Path) -> None:
    """As people know them, from 0 to 255."""
    parts = scene_parts(place(), WORLD, moment())
    mesh = written(tmp_path, ".ply", parts)
    expected = np.concatenate([np.tile((*p.colour, 255), (len(p.vertices_m), 1)) for p in parts])
    assert np.array_equal(mesh.visual.vertex_colors, expected)
    assert {(209, 73, 91, 255), (106, 76, 147, 255)} < {*map(tuple, expected.tolist())}


def test_the_floor_is_the_free_cells_that_no_voxel_covers() -> None:
    """Neither the unknown ones, nor those where a voxel stands on the ground or is the ground."""
    parts = {part.name: part for part in scene_parts(place(blocks(3)), WORLD, moment(()))}
    floor = parts["floor"]
    mesh = trimesh.Trimesh(floor.vertices_m, floor.faces)
    assert mesh.area == pytest.approx((33 * 28 - 4) * 0.01)
    assert mesh.bounds[:, 2].tolist() == [0.0, 0.0]
    assert np.allclose(mesh.face_normals, (0.0, 0.0, 1.0))
    slab = np.ones((10, 15, 1), np.uint8)
    ground = VoxelMap(RigidTransform.planar(-1.0, 0.5, 0.0, -0.2), (0.2,) * 3, slab)
    half = scene_parts(place(ground), WORLD, moment(()))[1]
    assert half.name == "floor"
    assert trimesh.Trimesh(half.vertices_m, half.faces).area == pytest.approx(19 * 28 * 0.01)


def test_there_is_no_plane_where_the_ground_is_looked_for_among_the_voxels() -> None:
    """But for walls that were extruded, which have no ground."""
    world = replace(WORLD, ground=GroundKind.VOXELS)
    names = [part.name for part in scene_parts(place(blocks(3)), world, moment(()))]
    assert names == ["environment"]
    names = [part.name for part in scene_parts(place(), world, moment(()))]
    assert names == ["environment", "floor"]


def test_artefacts_of_the_catalogue_have_their_meshes() -> None:
    """Others are boxes."""
    size, shape = (0.5, 0.5, 1.7), Shape.PERSON
    row = CatalogueRow(0, "person_a", "person", size, (0.0, 0.0, 0.05), shape)
    one = ArtefactAt(3, row, GroundPose(1.0, 1.0, 0.0, 0.0), "", "", 0)
    known, unknown = (
        scene_parts(place(None, Catalogue(rows)), WORLD, moment([one]))[-1] for rows in ((row,), ())
    )
    assert (len(unknown.faces), len(known.faces) > 50) == (12, True)
    for part in (known, unknown):
        heights_m = part.map_from_part.apply(part.vertices_m)[:, 2]
        assert (heights_m.min(), heights_m.max()) == pytest.approx((0.0, 1.7), abs=0.1)


def test_the_same_scene_has_the_same_bytes(tmp_path: Path) -> None:
    """No date, no path and no number of this run."""
    parts = scene_parts(place(blocks(3)), WORLD, moment())
    for suffix in (".glb", ".ply"):
        files = [tmp_path / f"{name}{suffix}" for name in "ab"]
        for path in files:
            write_scene(path, parts)
        assert files[0].read_bytes() == files[1].read_bytes()


def test_a_scene_of_nothing_is_refused(tmp_path: Path) -> None:
    """There is nothing to write."""
    with pytest.raises(BagError, match="nothing"):
        write_scene(tmp_path / "a.glb", [])
