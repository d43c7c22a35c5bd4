"""The robot's camera: what it would see of a building, in colour and in depth.

Colours are painted with the package's own painter, shaded and smoothed; depths are cast ray by ray.
"""

import math
import struct
from collections.abc import Sequence
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from are_ros.builder.occlusion.meshes import MeshPool, MeshSelection
from are_ros.builder.rendering.painter import Lighting, PaintedBody, Painter
from are_ros.builder.rendering.surface import Surface
from are_ros.builder.sensors.lens import Lens
from are_ros.messages.common import Header
from are_ros.population.meshes.appearance import DrawnMesh
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import CameraInfo
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.building import Building, Cuboid, Cylinder, Solid
from bags.simulation.making import MessageFactory, make_header

Floats = npt.NDArray[np.float64]
Pixels = npt.NDArray[np.uint8]

_CEILING_M: Final = 2.6
_SIDES: Final = 16
"""Of a cylinder, as it is drawn."""
_TILE_M: Final = 0.5
_WALL_M: Final = 2.0
"""What is higher is a wall, and of one colour."""
_WALL: Final = (0.87, 0.86, 0.82)
_SKIRTING: Final = (0.42, 0.40, 0.38)
_CEILING: Final = (0.93, 0.93, 0.92)
_WOODS: Final = ((0.62, 0.47, 0.33), (0.55, 0.41, 0.30), (0.70, 0.58, 0.44), (0.46, 0.50, 0.53))
_SKIRTING_M: Final = 0.08
_FARTHEST_M: Final = 8.0
_NEAREST_M: Final = 0.4
_STEP_MM: Final = 4
"""A depth is known to so much at 1 m, and to less farther away, as its square."""
_COMPRESSED: Final = struct.Struct("<iff")
_JPEG_QUALITY: Final = 80


class OfficeCamera:
    """Takes pictures of a building; the noise comes from `seed` and the number of the picture."""

    def __init__(self, building: Building, frame_id: str, info: CameraInfo, seed: int = 0) -> None:
        self._lens = Lens(frame_id, info, info.view(rectified=False))
        self._painter = Painter(self._lens.view)
        self._body = _body(building)
        self._boxes, self._shapes = _shapes(building)
        self._seed = seed

    def colours(self, map_from_camera: RigidTransform, number: int) -> Pixels:
        """Return picture `number`, uint8 (H, W, 3), RGB."""
        size = (self._lens.view.height, self._lens.view.width)
        lighting = Lighting(is_estimated=False, brightness=1.0, shadow=0.0, noise=0.0)
        nothing = np.full(size, np.inf, dtype=np.float32)
        random = np.random.default_rng((self._seed, number))
        painting = self._painter.paint(
            np.zeros((*size, 3), dtype=np.uint8),
            *(map_from_camera, [self._body], nothing, lighting, random),
        )
        pixels = np.zeros((*size, 3), np.uint8) if painting.pixels is None else painting.pixels
        noisy = pixels + random.normal(0.0, 1.5, pixels.shape)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

    def depths_mm(self, map_from_camera: RigidTransform) -> npt.NDArray[np.uint16]:
        """Return the depths (H, W) along the axis [mm]; 0 where nothing is between 0.4 and 8 m."""
        tiles = self._lens.tiles
        which = np.arange(len(tiles.spreads))
        depths_m = np.full(tiles.rows.shape, np.inf)
        self._lens.lower_depths(map_from_camera, which, self._boxes, self._shapes, depths_m)
        is_known = (depths_m >= _NEAREST_M) & (depths_m <= _FARTHEST_M)
        known_mm = 1000.0 * np.where(is_known, depths_m, 1.0)
        steps_mm = _STEP_MM * np.maximum((known_mm / 1000.0) ** 2, 1.0)
        numbers = np.where(is_known, np.rint(known_mm / steps_mm) * steps_mm, 0.0)
        image = np.zeros((self._lens.view.height, self._lens.view.width), dtype=np.uint16)
        valid = tiles.valid
        image[tiles.rows[valid], tiles.columns[valid]] = np.rint(numbers[valid]).astype(np.uint16)
        return image


def make_jpeg(factory: MessageFactory, header: Header, pixels: Pixels) -> Any:
    """Return a sensor_msgs/CompressedImage of colours (H, W, 3), RGB."""
    how = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    _, data = cv2.imencode(".jpg", np.ascontiguousarray(pixels[:, :, ::-1]), how)
    return _compressed(factory, header, "rgb8; jpeg compressed bgr8", data.reshape(-1))


def make_depth_png(
    factory: MessageFactory, header: Header, depths_mm: npt.NDArray[np.uint16]
) -> Any:
    """Return a sensor_msgs/CompressedImage as compressed_depth_image_transport makes it."""
    _, png = cv2.imencode(".png", depths_mm, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    head = np.frombuffer(_COMPRESSED.pack(0, 0.0, 0.0), dtype=np.uint8)
    data = np.concatenate((head, png.reshape(-1)))
    return _compressed(factory, header, "16UC1; compressedDepth png", data)


def _compressed(factory: MessageFactory, header: Header, kind: str, data: Pixels) -> Any:
    return factory.make(
        "sensor_msgs/msg/CompressedImage",
        header=make_header(factory, header.frame_id, header.stamp_ns),
        format=kind,
        data=data,
    )


def _body(building: Building) -> PaintedBody:
    """Return everything there is as one body: floor, ceiling, and the sides and tops of solids."""
    quads = _Quads()
    floor = building.floor
    low_x, high_x = floor.x_m - 0.5 * floor.length_m, floor.x_m + 0.5 * floor.length_m
    low_y, high_y = floor.y_m - 0.5 * floor.width_m, floor.y_m + 0.5 * floor.width_m
    ring = np.array(((low_x, low_y), (high_x, low_y), (high_x, high_y), (low_x, high_y)))
    quads.add_level(ring, 0.0, _WALL, tile_m=_TILE_M)
    quads.add_level(ring[::-1], _CEILING_M, _CEILING)
    for number, solid in enumerate(building.solids):
        is_wall = solid.top_m >= _WALL_M
        colour = _WALL if is_wall else _WOODS[number % len(_WOODS)]
        top_m = _CEILING_M if is_wall and solid.top_m > _WALL_M + 0.2 else solid.top_m
        outline = _outline(solid)
        foot_m = solid.bottom_m + (_SKIRTING_M if is_wall and solid.bottom_m == 0.0 else 0.0)
        if foot_m > solid.bottom_m:
            quads.add_sides(outline, solid.bottom_m, foot_m, _SKIRTING, _SKIRTING)
        darker = tuple(0.86 * channel for channel in colour)
        quads.add_sides(outline, foot_m, top_m, darker, colour)
        quads.add_level(outline, top_m, colour)
    surface = quads.surface()
    reach = np.array((floor.length_m, floor.width_m, 4.0))
    return PaintedBody(surface, RigidTransform.identity(), reach, -10.0)


class _Quads:
    """Gathers triangles with their colours and places in the floor's texture."""

    def __init__(self) -> None:
        self._corners: list[Floats] = []
        self._colours: list[Floats] = []
        self._uvs: list[Floats] = []

    def add_sides(
        self,
        outline: Floats,
        low_m: float,
        high_m: float,
        low: Sequence[float],
        high: Sequence[float],
    ) -> None:
        """Add upright quads over an outline (N, 2), anticlockwise; colours below and above."""
        for here, there in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            a, b = np.append(here, low_m), np.append(there, low_m)
            c, d = np.append(there, high_m), np.append(here, high_m)
            self._add((a, b, c), (low, low, high))
            self._add((a, c, d), (low, high, high))

    def add_level(
        self, outline: Floats, height_m: float, colour: Sequence[float], tile_m: float = 0.0
    ) -> None:
        """Add a level polygon (N, 2) as a fan; with tiles it shows the texture."""
        points = np.column_stack((outline, np.full(len(outline), height_m)))
        for k in range(1, len(points) - 1):
            corners = (points[0], points[k], points[k + 1])
            uvs = np.array([p[:2] / (4.0 * tile_m) for p in corners]) if tile_m else None
            self._add(corners, (colour,) * 3, uvs)

    def _add(
        self,
        corners: Sequence[Floats],
        colours: Sequence[Sequence[float]],
        uvs: Floats | None = None,
    ) -> None:
        self._corners.append(np.array(corners))
        self._colours.append(np.array(colours, dtype=np.float64))
        self._uvs.append(np.full((3, 2), np.nan) if uvs is None else uvs)

    def surface(self) -> Surface:
        """Return all of it, with flat faces."""
        corners = np.array(self._corners)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = across / np.linalg.norm(across, axis=1, keepdims=True)
        return Surface.of_mesh(
            DrawnMesh(
                corners_m=corners,
                colours=np.array(self._colours),
                uvs=np.array(self._uvs),
                texture=_carpet(),
                normals=np.repeat(normals[:, np.newaxis], 3, axis=1),
                is_closed=False,
            )
        )


def _carpet() -> Pixels:
    """Return 4 x 4 tiles of a carpet, each a little different, with seams."""
    random, side = np.random.default_rng(11), 64
    shades = 92.0 + 10.0 * random.random((4, 4))
    carpet = np.kron(shades, np.ones((side, side))) + random.normal(0.0, 5.0, (4 * side, 4 * side))
    carpet[::side], carpet[:, ::side] = 62.0, 62.0
    colours = carpet[:, :, np.newaxis] * (1.0, 1.02, 1.08)
    return np.clip(colours, 0, 255).astype(np.uint8)


def _outline(solid: Solid) -> Floats:
    """Return the outline (N, 2) of a solid on the floor, anticlockwise."""
    if isinstance(solid, Cuboid):
        cosine, sine = math.cos(solid.yaw_rad), math.sin(solid.yaw_rad)
        half = 0.5 * np.array((solid.length_m, solid.width_m))
        square = np.array(((-1, -1), (1, -1), (1, 1), (-1, 1))) * half
        turned: Floats = square @ np.array(((cosine, sine), (-sine, cosine)))
        turned += np.array((solid.x_m, solid.y_m))
        return turned
    if not isinstance(solid, Cylinder):
        raise TypeError(f"{solid} is neither a cuboid nor a cylinder")
    angles = np.linspace(0.0, math.tau, _SIDES, endpoint=False)
    ring = np.column_stack((np.cos(angles), np.sin(angles)))
    around: Floats = solid.radius_m * ring + (solid.x_m, solid.y_m)
    return around


def _shapes(building: Building) -> tuple[OrientedBoxes, MeshSelection]:
    """Return all solids, the floor and the ceiling as boxes, cylinders as meshes in theirs."""
    rows, meshes, prisms = list[tuple[float, ...]](), list[int](), list[tuple[Floats, Any]]()
    floor = building.floor
    for solid in (
        Cuboid(floor.x_m, floor.y_m, floor.length_m, floor.width_m, 0.0, -0.1),
        Cuboid(floor.x_m, floor.y_m, floor.length_m, floor.width_m, _CEILING_M + 0.1, _CEILING_M),
        *building.solids,
    ):
        is_wall = solid.top_m > _WALL_M + 0.2 and solid.bottom_m < _CEILING_M
        top_m = _CEILING_M if is_wall else solid.top_m
        middle, half = 0.5 * (solid.bottom_m + top_m), 0.5 * (top_m - solid.bottom_m)
        if isinstance(solid, Cuboid):
            sides = (0.5 * solid.length_m, 0.5 * solid.width_m)
            rows.append((solid.x_m, solid.y_m, middle, solid.yaw_rad, *sides, half))
            meshes.append(-1)
        elif isinstance(solid, Cylinder):
            rows.append((solid.x_m, solid.y_m, middle, 0.0, *(solid.radius_m,) * 2, half))
            meshes.append(len(prisms))
            prisms.append(_prism(_outline(solid) - (solid.x_m, solid.y_m), half))
    table = np.array(rows)
    boxes = OrientedBoxes(table[:, :3], table[:, 3], table[:, 4:])
    return boxes, MeshSelection(MeshPool.of(prisms), np.array(meshes, dtype=np.int64))


def _prism(outline: Floats, half_m: float) -> tuple[Floats, npt.NDArray[np.int64]]:
    """Return vertices and faces of an upright prism about 0."""
    count = len(outline)
    rings = [np.column_stack((outline, np.full(count, z))) for z in (-half_m, half_m)]
    faces = []
    for k in range(count):
        after = (k + 1) % count
        faces += [(k, after, count + after), (k, count + after, count + k)]
        faces += [(0, after, k), (count, count + k, count + after)]
    return np.concatenate(rings), np.array(faces)
