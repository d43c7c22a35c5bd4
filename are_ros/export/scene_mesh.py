"""S_E with the artefacts in it (section 3.3) as meshes, and the files that hold them: GLB, PLY."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.draw.palette import FLOOR, Rgb
from are_ros.draw.scene import Moment
from are_ros.draw.viewer import WALL, ArtefactBodies, ViewedPlace
from are_ros.errors import BagError
from are_ros.parameters.choices import GroundKind
from are_ros.parameters.model import WorldParameters
from are_ros.population.artefact import map_from_artefact
from are_ros.whole_file import write_whole
from are_ros.wording import why_refused
from are_ros.world.occupancy_grid import classify
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.surface import exposed_surface, level_surface

ENVIRONMENT, GROUND = "environment", "floor"
"""The names of what is no artefact."""

_BESIDE_M: Final = 1e-3
_GLTF_FROM_MAP: Final = np.array(
    ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, -1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
)
"""glTF's y is up: it is z of the map's frame."""


class Part(NamedTuple):
    """A mesh of the scene: vertices (V, 3) [m] and faces (F, 3), anticlockwise from outside.

    Parts of the same `shape` have the same mesh, at poses of their own.
    """

    name: str
    shape: str
    vertices_m: npt.NDArray[np.floating]
    faces: npt.NDArray[np.integer]
    colour: Rgb
    map_from_part: RigidTransform


def scene_parts(place: ViewedPlace, world: WorldParameters, moment: Moment) -> list[Part]:
    """Return the environment, its floor, and each artefact of a tick, named "label id".

    The environment is the exposed faces of the place's voxels. The floor is the free cells of the
    map at the height of the ground, but for those where voxels reach that height; there is none
    where the ground is looked for among the voxels. Parts without a triangle are left out.
    """
    identity, bodies = RigidTransform.identity(), ArtefactBodies(place.catalogue)
    surface = exposed_surface(place.voxels)
    parts = [Part(ENVIRONMENT, ENVIRONMENT, *surface, WALL, identity)]
    if place.voxels.is_extruded or world.ground is GroundKind.PLANE:
        sheet = level_surface(place.grid, _bare_floor(place, world), place.ground_m)
        parts.append(Part(GROUND, GROUND, *sheet, FLOOR, identity))
    for one in moment.artefacts:
        row, name = one.row, f"{one.row.label} {one.artefact_id}"
        shape, colour = f"{row.label} of row {row.index}", bodies.colour(row.class_name)
        pose = map_from_artefact(row, one.pose)
        parts.append(Part(name, shape, *bodies.mesh(row), colour, pose))
    return [part for part in parts if len(part.faces)]


def _bare_floor(place: ViewedPlace, world: WorldParameters) -> npt.NDArray[np.bool_]:
    """Return the free cells (height, width) at whose middle no voxel touches the ground's plane."""
    grid = place.grid
    classes = classify(grid, world.occupied_threshold, world.free_threshold)
    floor: npt.NDArray[np.bool_] = classes.free.copy()
    cells = np.argwhere(floor)
    middles_m = grid.cells_to_points(cells)
    for height_m in (place.ground_m - _BESIDE_M, place.ground_m + _BESIDE_M):
        points_m = np.column_stack((middles_m, np.full(len(cells), height_m)))
        floor[tuple(cells.T)] &= ~place.voxels.are_occupied(points_m)
    return floor


def write_scene(path: Path, parts: Sequence[Part]) -> int:
    """Write the parts into a file, and return its length in bytes; its name's end is the format.

    A GLB has a node for each part, with its name, below one that turns z up to y up, as glTF wants
    it. A PLY is one mesh in the map's frame, z up, with colours at its vertices. Raises BagError
    for another format, without parts, or where the system refuses to write.
    """
    write = writer_of(path)
    if not parts:
        raise BagError(f"--mesh {path}: there is nothing in the scene, no voxel and no floor")
    data = write(parts)
    try:
        write_whole(path, data)
    except OSError as cause:
        message = f"--mesh {path}: the file cannot be written ({why_refused(cause)})"
        raise BagError(message) from cause
    return len(data)


def writer_of(path: Path) -> Callable[[Sequence[Part]], bytes]:
    """Return what makes the bytes of a file of this name; BagError where its format is unknown."""
    found = _WRITERS.get(path.suffix.lower())
    if found is None:
        raise BagError(f"--mesh {path}: its name must end in {' or '.join(_WRITERS)}")
    return found


def _glb(parts: Sequence[Part]) -> bytes:
    import trimesh

    scene = trimesh.Scene(base_frame="world")
    scene.graph.update(frame_from="world", frame_to="map", matrix=_GLTF_FROM_MAP)
    for part in parts:
        if part.shape not in scene.geometry:
            scene.geometry[part.shape] = _painted(part)
        matrix = part.map_from_part.matrix()
        scene.graph.update(part.name, frame_from="map", geometry=part.shape, matrix=matrix)
    return bytes(scene.export(file_type="glb"))


def _painted(part: Part) -> Any:
    """Return a trimesh.Trimesh of one material."""
    import trimesh

    material = trimesh.visual.material.PBRMaterial(
        name=part.shape,
        baseColorFactor=_linear(part.colour),
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )
    visual = trimesh.visual.TextureVisuals(material=material)
    return trimesh.Trimesh(part.vertices_m, part.faces, visual=visual, process=False)


def _linear(colour: Rgb) -> npt.NDArray[np.float64]:
    """Return an sRGB colour as glTF has it, (4,): linear, from 0 to 1, opaque."""
    value = np.array(colour) / 255.0
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return np.append(linear, 1.0)


def _ply(parts: Sequence[Part]) -> bytes:
    import trimesh

    vertices_m = [part.map_from_part.apply(part.vertices_m) for part in parts]
    starts = np.cumsum([0, *map(len, vertices_m)])
    faces = [part.faces + start for part, start in zip(parts, starts[:-1], strict=True)]
    colours = [
        np.tile((*part.colour, 255), (len(points), 1))
        for part, points in zip(parts, vertices_m, strict=True)
    ]
    mesh = trimesh.Trimesh(
        np.concatenate(vertices_m),
        np.concatenate(faces),
        vertex_colors=np.concatenate(colours).astype(np.uint8),
        process=False,
    )
    return bytes(mesh.export(file_type="ply"))


_WRITERS: Final[Mapping[str, Callable[[Sequence[Part]], bytes]]] = {".glb": _glb, ".ply": _ply}
