"""The robot in a picture: its outline and path, and what its camera could see.

A field of view is a fan of level rays that end at walls and at artefacts that are tall enough.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.occlusion.rays import VoxelField
from are_ros.conventions import NS_PER_S
from are_ros.draw.canvas import Canvas
from are_ros.draw.map import View
from are_ros.draw.palette import SEEN, WHITE, Rgb, time_colour
from are_ros.draw.scene import Life, SceneRecord, Track
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
_PARALLEL: Final = 1e-12
_TURN_WEIGHT_M: Final = 0.4
_SHORTEST_PART_M: Final = 0.2
_ALL_AROUND_RAD: Final = math.radians(340.0)
_SMALLEST_PX: Final = 9.0
_MOST_VERTICES: Final = 2000
_TIME_STEPS: Final = 64
_SEEN_ALPHA: Final = 0.13
_FAN_ALPHA: Final = 0.2


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


def fan_at(record: SceneRecord, walls: VoxelField, index: int) -> Floats | None:
    """Return the fan of one camera pose of the record, None if it does not look sideways.

    A fan is its outline (N, 2) in the map's frame.
    """
    pose, stamp_ns = record.camera.poses[index], int(record.camera.stamps_ns[index])
    camera = record.views[int(record.view_of_pose[index])]
    return _fan(record, walls, stamp_ns, camera, RigidTransform(pose[:3], pose[3:]))


def other_fans(record: SceneRecord, walls: VoxelField, stamp_ns: int) -> list[Floats]:
    """Return the fans of the other cameras at a tick, of those that look sideways."""
    found = (
        _fan(record, walls, stamp_ns, other.view, other.map_from_camera)
        for other in record.others.get(stamp_ns, ())
    )
    return [fan for fan in found if fan is not None]


def _fan(
    record: SceneRecord,
    walls: VoxelField,
    stamp_ns: int,
    camera: ViewModel,
    map_from_camera: RigidTransform,
) -> Floats | None:
    count, here_m = min(_RAYS, camera.width), map_from_camera.translation_m
    rays, reach_m = level_sight(camera, map_from_camera, walls, record.max_range_m, count)
    if len(rays) < 2:
        return None
    hiding = [life for life in record.lives if _may_hide(life, stamp_ns, float(here_m[2]))]
    reach_m = np.minimum(reach_m, _far_sides(hiding, stamp_ns, here_m[:2], rays))
    outline: Floats = here_m[:2] + rays * reach_m[:, np.newaxis]
    azimuths = np.unwrap(np.arctan2(rays[:, 1], rays[:, 0]))
    is_closed = abs(azimuths[-1] - azimuths[0]) > _ALL_AROUND_RAD
    return outline if is_closed else np.vstack((here_m[:2], outline))


def spread_indices(record: SceneRecord, count: int) -> list[int]:
    """Return at most `count` camera poses, evenly spread over what the robot drove and turned.

    The last is among them: what was seen at the end of the path is to be in view there.
    """
    if not len(record.camera):
        return []
    travelled = _travelled(record)
    spread = np.searchsorted(travelled, _middles(travelled, count - 1)).tolist()
    return sorted({*spread, len(travelled) - 1})


def _travelled(record: SceneRecord) -> Floats:
    """Return what was driven [m] and, of less weight, turned up to each camera pose."""
    x, y, z, w = record.camera.poses[:, 3:].T
    forward = 2.0 * np.column_stack((x * z + w * y, y * z - w * x))
    driven = np.linalg.norm(np.diff(record.camera.poses[:, :2], axis=0), axis=1)
    turned = np.linalg.norm(np.diff(forward, axis=0), axis=1)
    return np.concatenate(((0.0,), np.cumsum(driven + _TURN_WEIGHT_M * turned)))


def _middles(travelled: Floats, count: int) -> Floats:
    """Return the middles of so many equal parts of the path, fewer if it is short."""
    count = max(1, min(count, int(travelled[-1] / _SHORTEST_PART_M) + 1))
    middles: Floats = (np.arange(count) + 0.5) / count * travelled[-1]
    return middles


def _may_hide(life: Life, stamp_ns: int, camera_height_m: float) -> bool:
    """Say whether an artefact stands there then and reaches up to the camera."""
    is_there = len(life.footprints) > 0 and life.is_present_at(stamp_ns)
    return is_there and life.row.size_m[2] > camera_height_m


def _far_sides(lives: Sequence[Life], stamp_ns: int, start_m: Floats, rays: Floats) -> Floats:
    """Return where rays (N, 2) leave the first footprint that they meet (N,), else infinity.

    The far side, so that the picture does not cut off what it shows as seen.
    """
    if not lives:
        return np.full(len(rays), np.inf)
    x_m, y_m, yaw_rad = np.array([life.footprint_at(stamp_ns) for life in lives]).T
    half = 0.5 * np.array([life.row.size_m[:2] for life in lives])[:, :, np.newaxis]
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    box_from_map = np.array(((cos, sin), (-sin, cos))).transpose(2, 0, 1)
    offsets = np.column_stack((start_m[0] - x_m, start_m[1] - y_m))[:, :, np.newaxis]
    starts, directions = box_from_map @ offsets, box_from_map @ rays.T
    directions = np.where(np.abs(directions) < _PARALLEL, _PARALLEL, directions)
    low, high = (-half - starts) / directions, (half - starts) / directions
    near, far = np.minimum(low, high).max(axis=1), np.maximum(low, high).min(axis=1)
    ends: Floats = np.where((near <= far) & (far > 0.0), far, np.inf).min(axis=0)
    return ends


def draw_view(canvas: Canvas, view: View, fan: Floats) -> None:
    """Tint a field of view, and draw its edge."""
    outline = view.pixels(fan)
    canvas.fill(outline, SEEN, _FAN_ALPHA)
    canvas.line(outline, SEEN, 1.0, 2.25 * _FAN_ALPHA, closed=True)


def draw_ever_seen(canvas: Canvas, view: View, fans: Sequence[Floats]) -> None:
    """Tint what was in any of the fields of view, evenly however many overlap."""
    canvas.tint([view.pixels(fan) for fan in fans], SEEN, _SEEN_ALPHA)


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


def draw_robot_path(canvas: Canvas, view: View, track: Track, fractions: Floats) -> None:
    """Draw the path in the colours of time; `fractions` (N,) are the poses' shares of the time.

    Nothing is drawn across a gap of the recording.
    """
    kept = np.linspace(0, len(track) - 1, min(len(track), _MOST_VERTICES)).astype(np.int64)
    some = np.unique(kept)
    points, drives = view.pixels(track.poses[some, :2]), track.drives()[some]
    for drive in np.unique(drives).tolist():
        if (drives == drive).sum() > 1:
            canvas.line(points[drives == drive], WHITE, 7.0)
    steps = np.where(np.diff(drives) == 0, np.rint(fractions[some][1:] * _TIME_STEPS), -1.0)
    for step in np.unique(steps[steps >= 0.0]).tolist():
        chosen = np.flatnonzero(steps == step)
        for run in np.split(chosen, np.flatnonzero(np.diff(chosen) > 1) + 1):
            canvas.line(points[run[0] : run[-1] + 2], time_colour(step / _TIME_STEPS), 3.7)


def time_fractions(record: SceneRecord, stamps_ns: npt.ArrayLike) -> Floats:
    """Return the stamps as fractions of the record's duration, which has no gaps."""
    ticks_ns, passed_ns = record.series.stamps_ns, record.series.passed_ns()
    since_ns = np.asarray(stamps_ns, dtype=np.int64) - ticks_ns[0]
    shortest_ns = NS_PER_S // 1000
    fractions: Floats = np.interp(since_ns, ticks_ns - ticks_ns[0], passed_ns) / max(
        record.duration_ns, shortest_ns
    )
    return fractions
