"""The polygonal meshes S_A of the artefacts (section 3.2), computed on demand.

User-defined mesh files are read, coloured, rotated, scaled, and moved to their centre of mass.
"""

import json
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.errors import CatalogueError
from are_ros.population.catalogue import CatalogueRow, MeshFile
from are_ros.population.meshes.shapes import Colour, Shape, build_shape
from are_ros.world.rigid_transform import product

if TYPE_CHECKING:
    import trimesh


Triple = tuple[float, float, float]


class BoxGeometry(NamedTuple):
    """The bounding box in F_A: its size (x, y, z) and its centre [m]."""

    size_m: Triple
    box_centre_in_artefact_m: Triple


def shape_geometry(shape: Shape, size_m: Triple) -> BoxGeometry:
    """Return the box of a built-in shape about its centre of mass; needs no trimesh."""
    solid = build_shape(shape, size_m, (0.0, 0.0, 0.0, 1.0))
    x, y, z = solid.centre_of_mass_m()
    return BoxGeometry(size_m, (float(-x), float(-y), float(0.5 * size_m[2] - z)))


def file_geometry(source: MeshFile) -> BoxGeometry:
    """Return the box of a user-defined mesh; `CatalogueError` as `mesh_of`."""
    low, high = read_mesh_file(source, (0.0, 0.0, 0.0, 1.0)).bounds
    return BoxGeometry(_triple(high - low), _triple(0.5 * (low + high)))


def surface_of(
    row: CatalogueRow,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Return the row's mesh in F_A as plain arrays; a built-in shape needs no trimesh for it.

    Vertices (V, 3) [m], faces (F, 3) of vertex indices, and the faces' colours (F, 4) in [0, 1].
    """
    if isinstance(row.surface, MeshFile):
        mesh = mesh_of(row)
        colours = np.asarray(mesh.visual.face_colors, dtype=np.float64) / 255.0
        return np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64), colours
    solid = build_shape(row.surface, row.size_m, row.colour)
    vertices_m = solid.vertices_m - solid.centre_of_mass_m()
    return vertices_m, np.asarray(solid.faces, dtype=np.int64), np.asarray(solid.colours)


def mesh_of(row: CatalogueRow) -> "trimesh.Trimesh":
    """Build the row's mesh in F_A, in metres: triangles, normals outwards, a colour per face.

    A mesh of the user's has the colours of its file (a texture's, at the corners), and takes the
    row's colour where that gives none. `CatalogueError` if the file is missing, cannot be read,
    holds no triangles, has a corner that is not finite, or is flat.
    """
    if isinstance(row.surface, MeshFile):
        return read_mesh_file(row.surface, row.colour)
    import trimesh

    vertices_m, faces, colours = surface_of(row)
    pixels = np.rint(255.0 * colours).astype(np.uint8)
    return trimesh.Trimesh(vertices_m, faces, face_colors=pixels, process=False)


def _triple(values: npt.NDArray[np.float64]) -> Triple:
    """Return an array (3,) as plain numbers."""
    return (float(values[0]), float(values[1]), float(values[2]))


MESH_SUFFIXES: Final = (".obj", ".stl", ".ply", ".glb")


def read_mesh_file(source: MeshFile, colour: Colour) -> "trimesh.Trimesh":
    """Return the file's bodies as one mesh in F_A, in metres, with a colour for each face.

    `colour` is for bodies to which the file gives none; a texture becomes its colour at the
    corners. `CatalogueError` if the file is missing, cannot be read, holds no triangles, has a
    corner that is not finite, or is flat.
    """
    import trimesh

    bodies = read_bodies(source)
    vertices = np.concatenate([body.vertices for body in bodies])
    if not np.isfinite(vertices).all():
        raise CatalogueError(f"the mesh file {source.path} has a vertex that is not finite")
    starts = np.cumsum([0] + [len(body.vertices) for body in bodies[:-1]])
    # Files repeat a vertex for each normal and texture coordinate. Without those, trimesh merges
    # what is one point in space, so that a closed surface is seen to be closed.
    mesh = trimesh.Trimesh(
        product(source.metres_per_unit * vertices, axes_of(source).T),
        np.concatenate([body.faces + start for body, start in zip(bodies, starts, strict=True)]),
        face_colors=np.concatenate([face_colours(body, colour) for body in bodies]),
    )
    return _balanced(mesh, source)


def read_bodies(source: MeshFile) -> list[Any]:
    """Return the bodies (trimesh.Trimesh) of a file, each where the file has it."""
    import trimesh

    if not source.path.is_file():
        what = "is a folder" if source.path.is_dir() else "does not exist"
        raise CatalogueError(f"the mesh file {source.path} {what}")
    if source.path.suffix.lower() not in MESH_SUFFIXES:
        known = ", ".join(suffix[1:].upper() for suffix in MESH_SUFFIXES)
        raise CatalogueError(f"the mesh file {source.path} is none of {known}")
    if reason := _why_packed(source.path):
        raise CatalogueError(
            f"the mesh file {source.path} {reason}, which is not read here: save it without"
        )
    try:
        # Unprocessed: trimesh would drop what is not finite without a word.
        scene = trimesh.load(source.path, force="scene", process=False)
        parts = [_placed(scene, node) for node in scene.graph.nodes_geometry]
    except Exception as cause:  # a broken file fails anywhere in trimesh's readers
        reason = " ".join(str(cause).split())
        message = f"cannot be read: it is truncated or malformed ({reason})"
        raise CatalogueError(f"the mesh file {source.path} {message}") from cause
    bodies = [part for part in parts if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    if not bodies:
        raise CatalogueError(f"the mesh file {source.path} holds no triangles, or is cut short")
    is_linear = source.path.suffix.lower() == ".glb"
    for body in bodies:
        if is_linear and body.visual.kind == "vertex":
            colours = np.asarray(body.visual.vertex_colors) / 255.0
            body.visual.vertex_colors = np.rint(255.0 * _srgb(colours)).astype(np.uint8)
        places = getattr(body.visual, "uv", None)
        if places is not None and not np.isfinite(places).all():  # as in some scanned meshes
            body.visual.uv = np.where(np.isfinite(places), places, 0.0)
        count, numbers = body.vertices.shape
        if numbers != 3 or body.faces.min() < 0 or body.faces.max() >= count:
            raise CatalogueError(
                f"the mesh file {source.path} is malformed: a triangle has a corner that is none of"
                f" its {count} vertices, or these have not three coordinates"
            )
    return bodies


_COMPRESSIONS: Final = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")
_NUMBERS: Final = ("POSITION", "TEXCOORD_0")


def _why_packed(path: Path) -> str:
    """Return how a GLB packs its numbers so that trimesh takes them for others; "" if it does not.

    What is no GLB, or a damaged one, is not judged here.
    """
    with path.open("rb") as file, suppress(ValueError, LookupError, TypeError, AttributeError):
        magic, length = file.read(4), int.from_bytes(file.read(16)[8:12], "little")
        tree = json.loads(file.read(length)) if magic == b"glTF" else {}
        required = tree.get("extensionsRequired", ())
        for name in _COMPRESSIONS:
            if name in required and not (name == _COMPRESSIONS[0] and find_spec("DracoPy")):
                return f"is compressed ({name})"
        for mesh in tree.get("meshes", ()):
            for primitive in mesh["primitives"]:
                for name in _NUMBERS:
                    accessor = primitive["attributes"].get(name)
                    if accessor is not None and tree["accessors"][accessor].get("normalized"):
                        return f"has its {name} in normalised integers (KHR_mesh_quantization)"
    return ""


def _placed(scene: Any, node: str) -> Any:
    """Return the body of a node where the scene has it; `Scene.dump` would lose its normals."""
    transform, name = scene.graph[node]
    body = scene.geometry[name]
    if hasattr(body, "faces"):
        visual = body.visual
        # A copy of a texture would lose the colours of corners, and fill the memory.
        visual = visual if visual.kind == "texture" else visual.copy()
        body = body.copy(include_cache=True, include_visual=False)
        body.visual = visual
        body.apply_transform(transform)
    return body


def face_colours(body: "trimesh.Trimesh", colour: Colour) -> npt.NDArray[np.uint8]:
    """Return the colours (F, 4) that the file gives to a body's faces, or else `colour`."""
    colours: npt.NDArray[np.uint8] = corner_colours(body, colour).mean(axis=1).astype(np.uint8)
    return colours


def corner_colours(body: "trimesh.Trimesh", colour: Colour) -> npt.NDArray[np.float64]:
    """Return the colours (F, 3, 4), sRGB from 0 to 255, at the corners of a body's faces.

    They are those of the file, or else `colour`.
    """
    visual = body.visual
    if visual.kind == "texture":
        own = _material_colours(visual)
        own = own[body.faces] if own.ndim > 1 else own
    elif visual.kind == "vertex":
        own = np.asarray(visual.vertex_colors)[body.faces]
    elif visual.defined:
        own = np.asarray(visual.face_colors)[:, np.newaxis]
    else:
        own = np.rint(255.0 * np.array(colour))
    colours: npt.NDArray[np.float64] = np.broadcast_to(own, (len(body.faces), 3, 4)).astype(float)
    return colours


def _material_colours(visual: Any) -> npt.NDArray[Any]:
    """Return the colours of a material at all vertices (V, 4), or its only one (4,)."""
    material = visual.material
    picture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if picture is not None and visual.uv is not None:
        return np.asarray(material.to_color(visual.uv))
    if not hasattr(material, "baseColorFactor"):
        return np.asarray(material.main_color)
    # In glTF a material is white without a factor; the colours of corners are factors, too.
    factor = np.full(4, 255.0) if material.baseColorFactor is None else material.baseColorFactor
    tint, corners = factor / 255.0, visual.vertex_attributes.get("color")
    if corners is not None:
        most = np.iinfo(corners.dtype).max if corners.dtype.kind == "u" else 1.0
        tint = np.tile(tint, (len(corners), 1))
        tint[:, : corners.shape[1]] *= corners / most
    return np.asarray(np.rint(255.0 * _srgb(tint)))


def _srgb(linear: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """Return linear colours (..., 4) as sRGB (IEC 61966-2-1), all from 0 to 1; alpha stays."""
    clipped = np.clip(linear, 0.0, 1.0)
    bent = 1.055 * clipped ** (1 / 2.4) - 0.055
    encoded: npt.NDArray[np.floating] = np.where(clipped <= 0.0031308, 12.92 * clipped, bent)
    encoded[..., 3] = clipped[..., 3]
    return encoded


def axes_of(source: MeshFile) -> npt.NDArray[np.float64]:
    """Return the rotation (3, 3) that takes the file's forward and up axes to +x and +z."""
    forward, up = _axis(source.forward), _axis(source.up)
    return np.stack((forward, np.cross(up, forward), up))


def _axis(name: str) -> npt.NDArray[np.float64]:
    """Return the unit vector (3,) of an axis `x`, `-x`, `y`, ..."""
    vector = np.zeros(3)
    vector["xyz".index(name[-1])] = -1.0 if name.startswith("-") else 1.0
    return vector


def _balanced(mesh: "trimesh.Trimesh", source: MeshFile) -> "trimesh.Trimesh":
    """Move the origin to the centre of mass, and turn a closed surface's faces outwards."""
    centre_m = _hull_centre_m(mesh, source)
    if mesh.is_watertight and mesh.is_winding_consistent:
        if mesh.volume < 0.0:
            mesh.invert()
        _turn_mirrored(mesh)
        if mesh.volume > 0.0:
            centre_m = mesh.center_mass
    mesh.apply_translation(-centre_m)
    return mesh


def _turn_mirrored(mesh: "trimesh.Trimesh") -> None:
    """Turn the faces of closed parts that are wound inwards, unless they bound a hole in another.

    A part that was mirrored without its winding, as a wheel on the other side, would count as a
    hole where nothing is.
    """
    from trimesh.graph import connected_component_labels

    corners_m = np.asarray(mesh.triangles) - mesh.bounds[0]
    labels = connected_component_labels(mesh.face_adjacency, node_count=len(corners_m))
    order = np.argsort(labels, kind="stable")
    parts = np.split(corners_m[order], np.flatnonzero(np.diff(labels[order])) + 1)
    lows_m = np.array([part.min(axis=(0, 1)) for part in parts])
    highs_m = np.array([part.max(axis=(0, 1)) for part in parts])
    are_mirrored = np.array([np.linalg.det(part).sum() < 0.0 for part in parts])
    for k in np.flatnonzero(are_mirrored).tolist():
        middle_m = parts[k].mean(axis=(0, 1))
        are_around = ((lows_m < middle_m) & (middle_m < highs_m)).all(axis=1)
        are_around[k] = False
        around = [parts[other] for other in np.flatnonzero(are_around).tolist()]
        are_mirrored[k] = not (around and _is_within(middle_m, np.concatenate(around)))
    is_mirrored = are_mirrored[labels]
    if is_mirrored.any():
        faces = np.array(mesh.faces)
        faces[is_mirrored] = faces[is_mirrored][:, ::-1]
        mesh.faces = faces


def _is_within(point_m: npt.NDArray[np.float64], corners_m: npt.NDArray[np.float64]) -> bool:
    """Return whether a point (3,) is within a closed surface of triangles (F, 3, 3).

    By the solid angles under which it sees them (van Oosterom and Strackee 1983).
    """
    a, b, c = np.moveaxis(corners_m - point_m, 1, 0)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    above = (a * np.cross(b, c)).sum(axis=1)
    below = la * lb * lc + (a * b).sum(axis=1) * lc
    below += (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    return bool(np.arctan2(above, below).sum() > np.pi)


def _hull_centre_m(mesh: "trimesh.Trimesh", source: MeshFile) -> npt.NDArray[np.float64]:
    """Return the centre of mass (3,) of the convex hull; CatalogueError for a mesh in a plane."""
    # trimesh's own hull needs networkx whenever qhull's triangles are wound unequally.
    from scipy.spatial import ConvexHull, QhullError

    flat = f"the mesh file {source.path} is flat, but an artefact is not"
    try:
        hull = ConvexHull(mesh.vertices)
    except QhullError as cause:
        raise CatalogueError(flat) from cause
    if hull.volume < 1e-9 * mesh.extents.max() ** 3:
        raise CatalogueError(flat)
    inside = mesh.vertices.mean(axis=0)
    corners = mesh.vertices[hull.simplices] - inside
    volumes = np.abs(np.linalg.det(corners))
    return np.asarray(inside + product(volumes, corners.sum(axis=1)) / (4.0 * volumes.sum()))
