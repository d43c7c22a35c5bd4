"""The octomap in the views: its voxels, opaque and coloured by height, as rviz shows boxes.

Only what stands above the floor and reaches up to the hips is drawn: walls and ceilings would hide
the whole scene from a viewer above it.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.occlusion.rays import VoxelField
from are_ros.replay.rviz_canvas import Canvas
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]

LOWEST_M: Final = 0.1
HIGHEST_M: Final = 1.2
_ROWS_AT_ONCE: Final = 256
_FARTHEST_M: Final = 1e4
_LOW_RGB: Final = np.array((0.27, 0.38, 0.47))
_HIGH_RGB: Final = np.array((0.68, 0.62, 0.46))
_SHINES: Final = np.array((0.80, 0.66, 1.0))
"""Of faces across x, across y, and of tops."""
_BEHIND_VOXELS: Final = 1.5
"""So far behind its face a voxel begins to hide: scans that end in a wall stay seen."""


def standing_part(voxels: VoxelMap, ground_m: float) -> VoxelMap | None:
    """Return what is drawn of a map whose ground is at a height, None if that is nothing."""
    height_m = voxels.voxel_size_m[2]
    middles_m = voxels.map_from_lattice.translation_m[2] - ground_m
    middles_m = middles_m + (np.arange(voxels.occupied.shape[2]) + 0.5) * height_m
    layers = np.flatnonzero((middles_m > LOWEST_M) & (middles_m < HIGHEST_M))
    if not len(layers):
        return None
    part = voxels.occupied[:, :, layers[0] : layers[-1] + 1]
    if not part.any():
        return None
    lift = np.array((0.0, 0.0, layers[0] * height_m))
    pose = voxels.map_from_lattice
    lifted = RigidTransform(pose.translation_m + lift, pose.rotation_xyzw)
    return VoxelMap(lifted, voxels.voxel_size_m, part)


def draw_voxels(canvas: Canvas, voxels: VoxelMap) -> None:
    """Draw voxels of the fixed frame into a view, with what they hide from then on."""
    camera = canvas.camera
    reach = _Perspective(voxels) if camera.is_perspective else _FromAbove(voxels)
    for row in range(0, camera.height, _ROWS_AT_ONCE):
        rows = slice(row, min(row + _ROWS_AT_ONCE, camera.height))
        starts, ways = camera.rays(rows)
        reaches = reach(starts, ways)
        hit = np.isfinite(reaches)
        points = starts[hit] + reaches[hit][:, np.newaxis] * ways[hit]
        if not len(points):
            continue
        _, near = camera.project(points + _BEHIND_VOXELS * voxels.voxel_size_m[0] * ways[hit])
        seen = near > canvas.nearness[rows][hit]
        colours = _colours(voxels, points)
        part, depths = canvas.colours[rows], canvas.nearness[rows]
        part[hit] = np.where(seen[:, np.newaxis], colours, part[hit])
        depths[hit] = np.where(seen, near, depths[hit])


class _Perspective:
    """How many of its ways (h, w, 3) each ray from one point goes until it hits, inf if never."""

    def __init__(self, voxels: VoxelMap) -> None:
        self._field = VoxelField.of(voxels)

    def __call__(self, starts: Floats, ways: Floats) -> Floats:
        lengths = np.linalg.norm(ways, axis=-1)
        units = (ways / lengths[..., np.newaxis]).reshape(-1, 3)
        hits = self._field.first_hits(starts[0, 0].copy(), units, _FARTHEST_M)
        reaches: Floats = hits.reshape(lengths.shape).astype(np.float64) / lengths
        return reaches


class _FromAbove:
    """How far down rays from starts (h, w, 3) above all voxels go until they hit, inf if never."""

    def __init__(self, voxels: VoxelMap) -> None:
        self._voxels = voxels
        highest = voxels.occupied.shape[2] - np.argmax(voxels.occupied[:, :, ::-1], axis=2)
        base_m = float(voxels.map_from_lattice.translation_m[2])
        tops_m = base_m + highest * voxels.voxel_size_m[2]
        self._tops_m = np.where(voxels.occupied.any(axis=2), tops_m, -np.inf)

    def __call__(self, starts: Floats, ways: Floats) -> Floats:
        del ways
        found = self._voxels.points_to_voxels(starts.reshape(-1, 3))[:, :2]
        inside = ((found >= 0) & (found < self._tops_m.shape)).all(axis=1)
        heights_m = np.full(len(found), -np.inf)
        heights_m[inside] = self._tops_m[found[inside, 0], found[inside, 1]]
        reaches: Floats = starts[..., 2] - heights_m.reshape(starts.shape[:2])
        return reaches


def _colours(voxels: VoxelMap, points_m: Floats) -> npt.NDArray[np.float32]:
    """Return colours (N, 3) of points on faces: by height, and by how the face is turned."""
    pose = voxels.map_from_lattice
    local = (points_m - pose.translation_m) @ pose.rotation_matrix() / np.array(voxels.voxel_size_m)
    face = np.abs(local - np.rint(local)).argmin(axis=1)
    low_m = float(pose.translation_m[2])
    span_m = max(voxels.occupied.shape[2] * voxels.voxel_size_m[2], 1e-9)
    share = np.clip((points_m[:, 2] - low_m) / span_m, 0.0, 1.0)[:, np.newaxis]
    colours = (_LOW_RGB + share * (_HIGH_RGB - _LOW_RGB)) * _SHINES[face][:, np.newaxis]
    shown: npt.NDArray[np.float32] = colours.astype(np.float32)
    return shown
