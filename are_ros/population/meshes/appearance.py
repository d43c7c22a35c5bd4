"""What a camera sees of an artefact: triangles with normals, colours and a texture.

Built-in shapes are finer here than for the sensors, and differ by seed and id. A mesh file keeps
its texture coordinates, textures and normals.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.errors import CatalogueError
from are_ros.population.catalogue import CatalogueRow, MeshFile
from are_ros.population.meshes.detail import BodySpec
from are_ros.population.meshes.figure import Appearance, person_figure
from are_ros.population.meshes.geometry import axes_of, corner_colours, read_bodies
from are_ros.population.meshes.robots import cart_robot, disc_robot, serving_robot
from are_ros.population.meshes.shapes import Shape, Solid
from are_ros.population.meshes.things import (
    barrier,
    cone,
    crate,
    door,
    loaded_pallet,
    pallet,
    pillar,
    wall,
)
from are_ros.population.meshes.vehicles import buggy, car, lorry, scooter, van
from are_ros.world.rigid_transform import product

if TYPE_CHECKING:
    import trimesh

Floats = npt.NDArray[np.float64]
Pixels = npt.NDArray[np.uint8]

_MAKERS: Final[Mapping[Shape, Callable[[BodySpec], Solid]]] = {
    Shape(maker.__name__): maker
    for maker in (
        *(disc_robot, cart_robot, serving_robot, car, van, lorry, buggy, scooter),
        *(pallet, loaded_pallet, wall, door, barrier, cone, pillar, crate),
    )
}
"""What makes the body of each built-in shape but the person, at a size, in a colour."""
_LARGEST: Final = 2048
"""Textures are not larger than this, in pixels along a side."""
_MOST_TIMES: Final = 8
"""A picture is laid out so many times along a side at most."""
_MOST_CUT: Final = 20_000
"""A body from which something is cut out is divided into so many triangles at most."""


@dataclass(frozen=True, eq=False)
class DrawnMesh:
    """F triangles in the frame of the artefact's box, whose origin is the box's centre.

    `corners_m` float64 (F, 3, 3) [m]; `colours` float64 (F, 3, 3), sRGB in [0, 1], at the corners;
    `normals` (F, 3, 3), unit, None where the source has none. `uvs` (F, 3, 2) are places in [0, 1]
    in the `texture` uint8 (H, W, 3), sRGB, from its lower left corner, NaN for faces without. A
    surface that `is_closed` has its corners anticlockwise as seen from outside.
    """

    corners_m: Floats
    colours: Floats
    normals: Floats | None
    uvs: Floats
    texture: Pixels
    is_closed: bool

    @classmethod
    def plain(
        cls, corners_m: Floats, colours: Floats, normals: Floats | None = None
    ) -> "DrawnMesh":
        """Return a closed mesh without texture."""
        none = np.full((len(corners_m), 3, 2), np.nan)
        return cls(corners_m, colours, normals, none, np.zeros((1, 1, 3), dtype=np.uint8), True)


def differs(row: CatalogueRow) -> bool:
    """Return whether the artefacts of a row look different from each other."""
    return isinstance(row.surface, Shape)


def drawn_mesh(row: CatalogueRow, random: np.random.Generator) -> DrawnMesh:
    """Return what is drawn of an artefact of a row; `random` chooses how it looks.

    It has exactly the size of the row's box; a person is up to an eighth narrower.
    `CatalogueError` as `geometry.mesh_of`.
    """
    if isinstance(row.surface, MeshFile):
        return _of_file(row.surface, row.colour)
    if row.surface is Shape.PERSON:
        looks = Appearance.drawn(
            random,
            row.colour,
            is_senior=row.features.get("age") == "senior",
            has_vest=row.features.get("clothing") == "high visibility",
        )
        figure = person_figure(row.size_m, looks)
        return DrawnMesh.plain(figure.corners_m, figure.colours, figure.normals)
    spec = BodySpec(row.size_m, row.colour, random, row.features)
    body = _MAKERS[row.surface](spec).fitted(row.size_m)
    corners = (body.vertices_m - (0.0, 0.0, 0.5 * row.size_m[2]))[body.faces]
    return DrawnMesh.plain(corners, np.repeat(body.colours[:, np.newaxis, :3], 3, axis=1))


def _of_file(source: MeshFile, colour: tuple[float, float, float, float]) -> DrawnMesh:
    """Return the bodies of a file, with all their textures in one."""
    whole = read_bodies(source)
    turn = axes_of(source)
    used = np.concatenate([body.vertices[np.unique(body.faces)] for body in whole])
    centre = 0.5 * (used.min(axis=0) + used.max(axis=0))
    bodies = [_divided(body) for body in map(_cut_out, whole) if len(body.faces)]
    if not bodies:
        msg = f"the mesh file {source.path} shows nothing: its materials are transparent everywhere"
        raise CatalogueError(msg)
    corners = np.concatenate(
        [source.metres_per_unit * (body.vertices - centre)[body.faces] for body in bodies]
    )
    colours = np.concatenate([corner_colours(body, colour)[:, :, :3] for body in bodies]) / 255.0
    normals = product(np.concatenate([_normals(body) for body in bodies]), turn.T)
    uvs, texture = _atlas(bodies)
    return DrawnMesh(
        product(corners, turn.T), colours, normals if normals.any() else None, uvs, texture, False
    )


def _cut_out(body: "trimesh.Trimesh") -> "trimesh.Trimesh":
    """Return a body without what its material cuts out (alphaMode MASK of glTF).

    Its triangles are divided until they are as small as two pixels of the picture, or too many.
    """
    material = getattr(body.visual, "material", None)
    if getattr(material, "alphaMode", None) != "MASK" or material is None:
        return body
    import trimesh

    factor = 1.0 if material.baseColorFactor is None else material.baseColorFactor[3] / 255.0
    cutoff = 0.5 if material.alphaCutoff is None else material.alphaCutoff
    picture = material.baseColorTexture
    if picture is None or body.visual.uv is None:
        return body if factor >= cutoff else trimesh.Trimesh()
    alpha = factor * np.asarray(picture.convert("RGBA"), dtype=np.float64)[:, :, 3] / 255.0
    if (alpha >= cutoff).all():
        return body
    height, width = alpha.shape
    vertices, faces, uvs = body.vertices, body.faces, np.asarray(body.visual.uv)[:, :2]
    while 4 * len(faces) <= _MOST_CUT and _longest_px(uvs[faces] * (width, height)) > 2.0:
        vertices, faces, found = trimesh.remesh.subdivide(
            vertices, faces, vertex_attributes={"uv": uvs}
        )
        uvs = found["uv"]
    u, v = uvs[faces].mean(axis=1).T % 1.0
    kept = alpha[((1.0 - v) * height).astype(int) % height, (u * width).astype(int)] >= cutoff
    visual = trimesh.visual.TextureVisuals(uv=uvs, material=material)
    return trimesh.Trimesh(vertices, faces[kept], visual=visual, process=False)


def _divided(body: "trimesh.Trimesh") -> "trimesh.Trimesh":
    """Return a body of which no face reaches over more repetitions of its picture than are laid.

    Faces that do are divided, unless they become too many.
    """
    import trimesh

    if _picture_of(body) is None:
        return body
    vertices, faces, uvs = body.vertices, body.faces, np.asarray(body.visual.uv)[:, :2]
    looks = {"uv": uvs}
    if "vertex_normals" in body._cache.cache:  # noqa: SLF001 - as in `_normals`
        looks["normals"] = np.asarray(body.vertex_normals)
    while True:
        # What begins within a repetition reaches over one more than it is long.
        wide = np.flatnonzero(np.ptp(looks["uv"][faces], axis=1).max(axis=1) > _MOST_TIMES - 1)
        if not len(wide) or len(faces) + 3 * len(wide) > _MOST_CUT:
            break
        vertices, faces, looks = trimesh.remesh.subdivide(
            vertices, faces, face_index=wide, vertex_attributes=looks
        )
    if looks["uv"] is uvs:
        return body
    visual = trimesh.visual.TextureVisuals(uv=looks["uv"], material=body.visual.material)
    divided = trimesh.Trimesh(vertices, faces, visual=visual, process=False)
    if "normals" in looks:
        divided.vertex_normals = looks["normals"]
    return divided


def _longest_px(corners_px: Floats) -> float:
    """Return the longest side of triangles (F, 3, 2)."""
    sides = corners_px - np.roll(corners_px, 1, axis=1)
    return float(np.linalg.norm(sides, axis=2).max())


def _normals(body: "trimesh.Trimesh") -> Floats:
    """Return the normals (F, 3, 3) that the file has for a body's corners, 0 if it has none."""
    if "vertex_normals" not in body._cache.cache:  # noqa: SLF001 - else trimesh computes them
        return np.zeros((len(body.faces), 3, 3))
    found = np.asarray(body.vertex_normals, dtype=np.float64)[body.faces]
    lengths = np.linalg.norm(found, axis=2, keepdims=True)
    unit: Floats = found / np.where(lengths > 0.0, lengths, 1.0)  # some files have them in integers
    return unit


def _atlas(bodies: list[Any]) -> tuple[Floats, Pixels]:
    """Return places (F, 3, 2) and the texture: the tiles of the bodies, one above the other.

    Bodies that show the same picture in the same way share its tile.
    """
    tiles = [_tile(body) for body in bodies]
    pictures: dict[_Look, Pixels] = {}
    for body, tile in zip(bodies, tiles, strict=True):
        if tile is not None and tile[0] not in pictures:
            pictures[tile[0]] = _picture(body, tile[0])
    sizes = [one.shape for one in pictures.values()]
    width, height = max((s[1] for s in sizes), default=1), max(1, sum(s[0] for s in sizes))
    texture = np.zeros((height, width, 3), dtype=np.uint8)
    tops, top = dict[_Look, int](), 0
    for look, picture in pictures.items():
        tops[look], end = top, top + picture.shape[0]
        texture[top:end, : picture.shape[1]] = picture
        top = end
    places: list[Floats] = []
    for body, tile in zip(bodies, tiles, strict=True):
        if tile is None:
            places.append(np.full((len(body.faces), 3, 2), np.nan))
            continue
        look, uvs = tile
        rows, columns = pictures[look].shape[:2]
        size = np.array((columns / width, rows / height))
        low = np.array((0.0, 1.0 - (tops[look] + rows) / height))
        # Half a pixel inside, so that a neighbour of the atlas does not shine through.
        inside = 0.5 / np.array((columns, rows))
        places.append(low + np.clip(uvs, inside, 1.0 - inside) * size)
    return np.concatenate(places), texture


class _Look(NamedTuple):
    """Which picture a body shows, the shares of red, green and blue, and how often, both ways."""

    picture: int
    shares: tuple[float, ...]
    times: tuple[int, int]


def _tile(body: "trimesh.Trimesh") -> tuple[_Look, Floats] | None:
    """Return how a body shows its picture, and the places (F, 3, 2) in that; None without one.

    A picture is repeated as its faces need.
    """
    picture = _picture_of(body)
    if picture is None:
        return None
    # A face that begins beyond the picture begins in its repetition; what it reaches over
    # is laid out as often as needed.
    uvs = np.asarray(body.visual.uv, dtype=np.float64)[body.faces][:, :, :2]
    uvs = uvs - np.floor(uvs.min(axis=1, keepdims=True) + 1e-9)
    across, up = (
        np.clip(np.ceil(uvs.max(axis=(0, 1)) - 1e-6), 1.0, _MOST_TIMES).astype(int).tolist()
    )
    shares = (1.0, 1.0, 1.0)
    factor = getattr(body.visual.material, "baseColorFactor", None)
    if factor is not None:
        # The factor is one of intensities; sRGB is nearly their power of 1 / 2.2.
        shares = tuple(((np.asarray(factor, np.float64)[:3] / 255.0) ** (1.0 / 2.2)).tolist())
    return _Look(id(picture), shares, (across, up)), uvs / (across, up)


def _picture_of(body: "trimesh.Trimesh") -> Any:
    """Return the image of a body's texture, None where it has none."""
    if body.visual.kind != "texture" or body.visual.uv is None:
        return None
    material = body.visual.material
    return getattr(material, "baseColorTexture", None) or getattr(material, "image", None)


def _picture(body: "trimesh.Trimesh", look: _Look) -> Pixels:
    """Return the texture of a body as it looks, (H, W, 3)."""
    pixels = np.asarray(_picture_of(body).convert("RGB"), dtype=np.uint8)
    longest = max(pixels.shape[1] * look.times[0], pixels.shape[0] * look.times[1])
    step = max(1, -(-longest // _LARGEST))
    pixels = pixels[::step, ::step]
    if look.shares != (1.0, 1.0, 1.0):
        pixels = np.rint(pixels * look.shares).astype(np.uint8)
    return np.tile(pixels, (look.times[1], look.times[0], 1))
