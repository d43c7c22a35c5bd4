"""The robot in a picture: its outline and path, and what its camera could see.

A field of view is a fan of level rays that end at walls.
"""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.occlusion.rays import VoxelField
from are_ros.draw.canvas import Canvas
from are_ros.draw.map import View
from are_ros.draw.palette import ROBOT, WHITE, Rgb
from are_ros.draw.scene import SceneRecord, Track
from are_ros.world.cameras import ViewModel
from are_ros.world.footprint import Footprint
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]

_RAYS: Final = 360
_LEAST_LEVEL: Final = 0.1
"""A unit ray whose level part is shorter looks up or down."""
_ENDLESS_M: Final = 1000.0
_ALL_AROUND_RAD: Final = math.radians(340.0)
_SMALLEST_PX: Final = 9.0
ROBOT_PATH_PX: Final = 3.7
_FADE: Final = (0.3, 1.0)


def walls_of(
    grid: OccupancyGrid, occupied_threshold: int, voxels: VoxelMap | None = None
) -> VoxelField:
    """Return what ends a camera's view: the octomap, else the walls of the map, of any height."""
    if voxels is None:
        walls = grid.cells >= occupied_threshold
        voxels = VoxelMap.extruded(grid, walls, 2.0 * _ENDLESS_M, -_ENDLESS_M)
    return VoxelField.of(voxels)


def level_sight(
    camera: ViewModel,
    map_from_camera: RigidTransform,
    walls: VoxelField,
    max_range_m: float,
    count: int,
) -> tuple[Floats, Floats]:
    """Return what the image's middle row sees: level unit rays (N, 2), and their lengths (N,) [m].

    At most `count` rays, in the map's frame; rays that look steeply up or down are left out. A ray
    ends at the first wall at the camera's height, or where the camera's range ends.
    """
    row = camera.directions()[camera.height // 2]
    columns = np.linspace(0, camera.width - 1, count).astype(np.int64)
    rays = row[columns].astype(np.float64) @ map_from_camera.rotation_matrix().T
    level = np.linalg.norm(rays[:, :2], axis=1)
    is_kept = level > _LEAST_LEVEL
    rays, level = rays[is_kept] * (1.0, 1.0, 0.0), level[is_kept]
    rays /= level[:, np.newaxis]
    hits_m = walls.first_hits(map_from_camera.translation_m, rays, max_range_m)
    return rays[:, :2], np.minimum(hits_m, max_range_m * level)


def fans_at(record: SceneRecord, walls: VoxelField, stamp_ns: int) -> list[Floats]:
    """Return what each camera sees at a tick, as outlines (N, 2) in the map's frame.

    The first camera comes first; cameras that do not look sideways are left out.
    """
    cameras = [(other.view, other.map_from_camera) for other in record.others.get(stamp_ns, ())]
    if (map_from_camera := record.camera.transform_at(stamp_ns)) is not None:
        index = int(np.searchsorted(record.camera.stamps_ns, stamp_ns))
        view = record.views[int(record.view_of_pose[index])]
        cameras.insert(0, (view, map_from_camera))
    fans = (_fan(walls, record.max_range_m, *camera) for camera in cameras)
    return [fan for fan in fans if fan is not None]


def _fan(
    walls: VoxelField, max_range_m: float, camera: ViewModel, map_from_camera: RigidTransform
) -> Floats | None:
    count, here_m = min(_RAYS, camera.width), map_from_camera.translation_m
    rays, reach_m = level_sight(camera, map_from_camera, walls, max_range_m, count)
    if len(rays) < 2:
        return None
    outline: Floats = here_m[:2] + rays * reach_m[:, np.newaxis]
    azimuths = np.unwrap(np.arctan2(rays[:, 1], rays[:, 0]))
    is_closed = abs(azimuths[-1] - azimuths[0]) > _ALL_AROUND_RAD
    return outline if is_closed else np.vstack((here_m[:2], outline))


def robot_outline(footprint: Footprint) -> Floats:
    """Return the corners of a rounded polygon: the hull of discs at its vertices."""
    import cv2

    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    circle = footprint.radius_m * np.column_stack((np.cos(angles), np.sin(angles)))
    points = (footprint.vertices_m[:, np.newaxis] + circle).reshape(-1, 2).astype(np.float32)
    hull: Floats = cv2.convexHull(points)[:, 0].astype(np.float64)
    return hull


def draw_robot(
    canvas: Canvas, view: View, footprint: Footprint, pose: Floats, colour: Rgb
) -> Floats:
    """Draw the robot at a pose (x, y, yaw), with a line to its front; return its outline [px].

    It is enlarged about its middle where it would be too small to be seen.
    """
    x_m, y_m, yaw_rad = pose.tolist()
    outline_m = robot_outline(footprint.at(x_m, y_m, yaw_rad))
    middle, size_m = outline_m.mean(axis=0), float(np.ptp(outline_m, axis=0).max())
    outline_m = middle + max(1.0, _SMALLEST_PX / view.px_per_m / size_m) * (outline_m - middle)
    forward = np.array((math.cos(yaw_rad), math.sin(yaw_rad)))
    centre = np.array((x_m, y_m))
    front = centre + forward * ((outline_m - centre) @ forward).max()
    outline = view.pixels(outline_m)
    canvas.fill(outline, WHITE, 0.8)
    canvas.line(outline, colour, 2.2, closed=True)
    canvas.line(view.pixels(np.array((centre, front))), colour, 2.2)
    return outline


def draw_robot_path(canvas: Canvas, view: View, track: Track) -> None:
    """Draw the path, which fades in from its beginning; nothing across a gap of the recording."""
    first = 0
    for poses in track.drives():
        alphas = np.interp(np.arange(first + 1, first + len(poses)), (0, len(track)), _FADE)
        first += len(poses)
        if len(poses) > 1:
            points = view.pixels(poses[:, :2])
            canvas.line(points, WHITE, ROBOT_PATH_PX + 3.0)
            canvas.fading(points, ROBOT, np.full(len(alphas), ROBOT_PATH_PX), alphas)
