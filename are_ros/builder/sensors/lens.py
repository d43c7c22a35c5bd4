"""Where the pixels of an image look: made once per CameraInfo, for all images taken with it."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder.occlusion.kernels import Boxes, find_candidates
from are_ros.builder.occlusion.meshes import MeshSelection, Tree, cast_tile, enters
from are_ros.builder.occlusion.rays import PIXELS, TILE, inverse, tiled
from are_ros.builder.occlusion.zbuffer import boxes_seen_from
from are_ros.builder.sensors.image import MINIATURE_PX
from are_ros.errors import InputError
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import CameraInfo, FisheyeView, PinholeView
from are_ros.world.rigid_transform import RigidTransform, product

_SLACK: Final = 1e-5
"""Of distances that are found in single precision, as a share of the farthest."""

_Floats = npt.NDArray[np.float64]
_Indices = npt.NDArray[np.int64]


class DepthTiles(NamedTuple):
    """The rays of a view in T tiles, for the kernels.

    `rays` float64 (T, 3, PIXELS) go to 1 m of depth; none is longer than `longest_m` (T,). `rows`
    and `columns` int64 (T, PIXELS) are those of their pixels, and `valid` bool (T, PIXELS) tells
    which have such a ray: a pixel of a fisheye that looks aside or back has none. `axes` float32
    (T, 3) and `spreads` float32 (T,) are as in `rays.Tiles`, of all pixels that look anywhere.
    """

    rays: _Floats
    longest_m: _Floats
    rows: _Indices
    columns: _Indices
    valid: npt.NDArray[np.bool_]
    axes: npt.NDArray[np.float32]
    spreads: npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Lens:
    """What a CameraInfo says about the images beside it.

    `frame_id` and `info` are those of the message; `view` is the model of the images, rectified or
    not. Depth is the coordinate along the axis of the (rectified) image, not the distance.
    """

    frame_id: str
    info: CameraInfo
    view: PinholeView | FisheyeView

    @classmethod
    def miniature(cls, frame_id: str) -> "Lens":
        """Return a lens for small images that looks along x, as a rectified one may."""
        width, height = MINIATURE_PX
        k, r = (16.0, 0.0, 15.5, 0.0, 16.0, 11.5, 0.0, 0.0, 1.0), (0, -1, 0, 0, 0, -1, 1, 0, 0)
        p = (*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0)
        info = CameraInfo(width, height, "plumb_bob", (), k, tuple(map(float, r)), p)
        return cls(frame_id, info, info.view(rectified=True))

    def check_size(self, height: int, width: int) -> None:
        """Raise InputError for an image of another size than the view's."""
        view = self.view
        if (view.width, view.height) != (width, height):
            raise InputError(
                f"it has {width} x {height} pixels, and {self.info.source} is of"
                f" {view.width} x {view.height}"
            )

    def is_like(self, other: "Lens") -> bool:
        """Return whether both lenses have the same numbers, from whatever topic."""
        return replace(self.info, source="") == replace(other.info, source="")

    @cached_property
    def tiles(self) -> DepthTiles:
        """The rays of all pixels; computed at the first use."""
        rays = self.view.rays_to_depth()
        is_valid = ~np.isnan(rays[:, :, 0])
        rays[~is_valid] = 0.0
        cones = tiled(self.view.directions())
        down, right = np.divmod(np.arange(PIXELS), TILE)
        rows = cones.first_pixels[:, 1:] + down
        columns = cones.first_pixels[:, :1] + right
        is_inside = (rows < self.view.height) & (columns < self.view.width)
        rows, columns = np.where(is_inside, rows, 0), np.where(is_inside, columns, 0)
        in_tiles = np.ascontiguousarray(rays[rows, columns].transpose(0, 2, 1))
        return DepthTiles(
            in_tiles,
            np.maximum(np.linalg.norm(in_tiles, axis=1).max(axis=1), 1.0),
            rows,
            columns,
            is_inside & is_valid[rows, columns],
            cones.axes,
            cones.spreads,
        )

    @cached_property
    def lengths(self) -> npt.NDArray[np.float32]:
        """How long rays are that end at 1 m of depth, float32 (H, W) [m], NaN where there is none.

        They turn depths into distances.
        """
        lengths: npt.NDArray[np.float32]
        lengths = np.linalg.norm(self.view.rays_to_depth(), axis=2).astype(np.float32)
        return lengths

    @cached_property
    def _looks(self) -> npt.NDArray[np.bool_]:
        """Which pixels look anywhere, bool (H, W)."""
        return np.asarray(self.view.directions().any(axis=2))

    def in_tiles(self, which: _Indices) -> npt.NDArray[np.bool_]:
        """Return which pixels (H, W) that look anywhere are in some tiles (K,)."""
        rows, columns = self.tiles.rows[which, 0] // TILE, self.tiles.columns[which, 0] // TILE
        height, width = self.view.height, self.view.width
        chosen = np.zeros((-(-height // TILE), -(-width // TILE)), dtype=np.bool_)
        chosen[rows, columns] = True
        pixels = chosen.repeat(TILE, axis=0).repeat(TILE, axis=1)[:height, :width]
        are_in: npt.NDArray[np.bool_] = pixels & self._looks
        return are_in

    def tiles_towards(self, map_from_camera: RigidTransform, boxes: OrientedBoxes) -> _Indices:
        """Return the tiles (K,) in which a ray may meet one of the boxes, int64."""
        axes = self._axes_in_map(map_from_camera)
        no_meshes = MeshSelection.boxes_only(len(boxes))
        seen = boxes_seen_from(map_from_camera.translation_m, boxes, no_meshes.indices)
        return np.flatnonzero(_are_met(axes, self.tiles.spreads, seen))

    def _axes_in_map(self, map_from_camera: RigidTransform) -> npt.NDArray[np.float32]:
        matrix = map_from_camera.rotation_matrix()
        axes: npt.NDArray[np.float32] = product(self.tiles.axes, matrix.T).astype(np.float32)
        return axes

    def lower_depths(
        self,
        map_from_camera: RigidTransform,
        which: _Indices,
        boxes: OrientedBoxes,
        shapes: MeshSelection,
        depths_m: _Floats,
    ) -> None:
        """Lower depths (K, PIXELS) [m] of some tiles (K,) to the first hit on any shape.

        A depth is lowered only to a nearer one, and that of a pixel without a ray never. From
        inside a box its depth is 0.
        """
        tiles = self.tiles
        seen = boxes_seen_from(map_from_camera.translation_m, boxes, shapes.indices)
        beside_m = np.maximum(np.abs(seen.cameras_m) - seen.halves_m, 0.0)
        _lower_depths(
            tiles.rays,
            self._axes_in_map(map_from_camera),
            tiles.spreads,
            which,
            map_from_camera.rotation_matrix(),
            map_from_camera.translation_m,
            boxes.packed,
            seen,
            np.linalg.norm(beside_m, axis=0) - _SLACK * seen.far_m,
            tiles.longest_m[which] * depths_m.max(axis=1),
            shapes.pool.tree,
            depths_m,
        )


def known_lens(lens: Lens | None) -> Lens:
    """Return the lens of an image; InputError if there is none yet."""
    if lens is None:
        raise InputError("its CameraInfo is not known")
    return lens


@compiled
def _are_met(
    axes: npt.NDArray[np.float32], spreads: npt.NDArray[np.float32], boxes: Boxes
) -> npt.NDArray[np.bool_]:
    """Return which tiles, whose axes (T, 3) are in the map frame, may meet a box."""
    found = np.empty(boxes.far_m.size + 1, dtype=np.int64)
    met = np.empty(spreads.size, dtype=np.bool_)
    for tile in range(spreads.size):
        met[tile] = find_candidates(axes[tile], spreads[tile], boxes, found) > 0
    return met


@compiled
def _lower_depths(
    rays: _Floats,
    axes: npt.NDArray[np.float32],
    spreads: npt.NDArray[np.float32],
    which: _Indices,
    map_from_camera: _Floats,
    camera_m: _Floats,
    packed: _Floats,
    boxes: Boxes,
    near_m: npt.NDArray[np.float32],
    reach_m: _Floats,
    tree: Tree,
    depths_m: _Floats,
) -> None:
    """Lower the depths of the tiles `which` (K,), tile by tile and box by box.

    `axes` (T, 3) are those of all tiles, in the map frame. `boxes` are as in `Boxes`, and `packed`
    the same with the full precision. No box (N,) is nearer than `near_m`, and no depth of a tile
    (K,) lies farther than `reach_m`: most boxes behind walls are left out.
    """
    found = np.empty(packed.shape[0] + 1, dtype=np.int64)
    camera, turned_axis, turned = np.empty(3), np.empty(3), np.empty((3, PIXELS))
    corners, matrix = np.empty(6), np.empty((3, 3))
    for k in range(which.size):
        tile = which[k]
        axis = axes[tile]
        for candidate in range(find_candidates(axis, spreads[tile], boxes, found)):
            box = found[candidate]
            if near_m[box] > reach_m[k]:
                continue
            cosine, sine = packed[box, 3], packed[box, 4]
            x, y = camera_m[0] - packed[box, 0], camera_m[1] - packed[box, 1]
            camera[0], camera[1] = cosine * x + sine * y, cosine * y - sine * x
            camera[2] = camera_m[2] - packed[box, 2]
            turned_axis[0] = cosine * axis[0] + sine * axis[1]
            turned_axis[1] = cosine * axis[1] - sine * axis[0]
            turned_axis[2] = axis[2]
            for column in range(3):
                a, b = map_from_camera[0, column], map_from_camera[1, column]
                matrix[0, column] = cosine * a + sine * b
                matrix[1, column] = cosine * b - sine * a
                matrix[2, column] = map_from_camera[2, column]
            for row in range(3):
                a, b, c = matrix[row, 0], matrix[row, 1], matrix[row, 2]
                for pixel in range(PIXELS):
                    turned[row, pixel] = (
                        a * rays[tile, 0, pixel]
                        + b * rays[tile, 1, pixel]
                        + c * rays[tile, 2, pixel]
                    )
            if boxes.meshes[box] >= 0:
                grown = spreads[tile] * boxes.far_m[box]
                cast_tile(tree, boxes.meshes[box], camera, turned_axis, grown, turned, depths_m[k])
                continue
            for side in range(3):
                corners[side], corners[3 + side] = -packed[box, 5 + side], packed[box, 5 + side]
            for pixel in range(PIXELS):
                near = enters(
                    corners,
                    camera[0],
                    camera[1],
                    camera[2],
                    inverse(turned[0, pixel]),
                    inverse(turned[1, pixel]),
                    inverse(turned[2, pixel]),
                )
                depths_m[k, pixel] = min(depths_m[k, pixel], near)
