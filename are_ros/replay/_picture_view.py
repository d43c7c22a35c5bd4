"""What the camera could see, from above: fans of level rays that end at walls and artefacts."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.replay._picture_map import KnownPart
from are_ros.replay.life_record import Life
from are_ros.replay.scene_record import SceneRecord
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

Floats = npt.NDArray[np.float64]

_RAYS = 360
_MARCH_STEPS = 120
_ALL_AROUND_RAD = np.deg2rad(340.0)


@dataclass(frozen=True, eq=False)
class Fan:
    """What one camera pose sees: the outline (N, 2) in the map's frame, and when."""

    stamp_ns: int
    outline_m: Floats


class Sight:
    """Casts level rays over a map, by marching through the distance to the nearest wall."""

    def __init__(self, grid: OccupancyGrid, part: KnownPart, occupied_threshold: int) -> None:
        import cv2

        open_cells = (part.cells < occupied_threshold).astype(np.uint8)
        self._clearance = np.asarray(cv2.distanceTransform(open_cells, cv2.DIST_L2, 5))
        if open_cells.all():
            self._clearance = np.full(open_cells.shape, 1e6, dtype=np.float32)
        self._part = part
        self._cell_m = grid.resolution_m
        self._part_from_map = grid.origin.inverse().matrix()

    def free_lengths(self, start_m: Floats, rays: Floats, longest_m: Floats) -> Floats:
        """Return how far level unit rays (N, 2) go from a point (2,), at most `longest_m` (N,)."""
        turn = self._part_from_map[:2, :2]
        corner = (self._part.col0, self._part.row0)
        start = (turn @ start_m + self._part_from_map[:2, 3]) / self._cell_m - corner
        steps, longest = rays @ turn.T, longest_m / self._cell_m
        height, width = self._clearance.shape
        travelled, moving = np.zeros(len(rays)), np.arange(len(rays))
        for _ in range(_MARCH_STEPS):
            at = np.floor(start + steps[moving] * travelled[moving, np.newaxis]).astype(np.int64)
            inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
            travelled[moving[~inside]] += 4.0
            ahead = np.where(inside, self._clearance[at[:, 1] * inside, at[:, 0] * inside], 4.0)
            travelled[moving[inside]] += np.maximum(ahead[inside] - 0.7, 0.5) * (ahead[inside] > 0)
            moving = moving[(ahead > 0) & (travelled[moving] < longest[moving])]
            if not len(moving):
                break
        return np.minimum(travelled, longest) * self._cell_m


def fan_at(record: SceneRecord, sight: Sight, index: int) -> Fan | None:
    """Return the fan of one camera pose of the record, None if it does not look sideways."""
    pose, stamp_ns = record.camera.poses[index], int(record.camera.stamps_ns[index])
    rays = _level_rays(record, index, pose)
    lengths = np.linalg.norm(rays, axis=1)
    rays, lengths = rays[lengths > 0.1], lengths[lengths > 0.1]
    if len(rays) < 2:
        return None
    rays /= lengths[:, np.newaxis]
    longest_m = record.max_range_m * lengths
    reach_m = sight.free_lengths(pose[:2], rays, longest_m)
    for life in record.lives:
        if _may_hide(life, stamp_ns, pose[2]):
            reach_m = np.minimum(reach_m, _far_side(life, stamp_ns, pose[:2], rays))
    outline = pose[:2] + rays * reach_m[:, np.newaxis]
    is_closed = _spread_rad(rays) > _ALL_AROUND_RAD
    return Fan(stamp_ns, outline if is_closed else np.vstack((pose[:2], outline)))


def spread_indices(record: SceneRecord, count: int) -> list[int]:
    """Return at most `count` camera poses, evenly spread over what the robot drove and turned."""
    if not len(record.camera):
        return []
    x, y, z, w = record.camera.poses[:, 3:].T
    forward = 2.0 * np.column_stack((x * z + w * y, y * z - w * x))
    driven = np.linalg.norm(np.diff(record.camera.poses[:, :2], axis=0), axis=1)
    turned = np.linalg.norm(np.diff(forward, axis=0), axis=1)
    travelled = np.concatenate(((0.0,), np.cumsum(driven + turned)))
    count = max(1, min(count, int(travelled[-1] / 0.2) + 1))
    wanted = (np.arange(count) + 0.5) / count * travelled[-1]
    return sorted(set(np.searchsorted(travelled, wanted).tolist()))


def _level_rays(record: SceneRecord, index: int, pose: Floats) -> Floats:
    """Return the rays of the image's middle row in the map's frame, without their rise (N, 2)."""
    view = record.views[int(record.view_of_pose[index])]
    row = view.directions()[view.height // 2]
    columns = np.linspace(0, view.width - 1, min(_RAYS, view.width)).astype(np.int64)
    turn = RigidTransform(pose[:3], pose[3:]).rotation_matrix()
    rays: Floats = (row[columns].astype(np.float64) @ turn.T)[:, :2]
    return rays


def _spread_rad(rays: Floats) -> float:
    """Return the angle that unit rays, in their order, cover."""
    azimuths = np.unwrap(np.arctan2(rays[:, 1], rays[:, 0]))
    return float(abs(azimuths[-1] - azimuths[0]))


def _may_hide(life: Life, stamp_ns: int, camera_height_m: float) -> bool:
    """Say whether an artefact stands there then and reaches up to the camera."""
    is_there = len(life.footprints) > 0 and life.is_present_at(stamp_ns)
    return is_there and life.row.size_m[2] > camera_height_m


def _far_side(life: Life, stamp_ns: int, start_m: Floats, rays: Floats) -> Floats:
    """Return where rays leave a footprint again (N,), infinite for those that miss it.

    The far side, so that the picture does not cut off what it shows as seen.
    """
    x_m, y_m, yaw_rad = life.footprint_at(stamp_ns)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    box_from_map = np.array(((cos, sin), (-sin, cos)))
    start, directions = box_from_map @ (start_m - (x_m, y_m)), rays @ box_from_map.T
    half = 0.5 * np.array(life.row.size_m[:2])
    with np.errstate(divide="ignore", invalid="ignore"):
        slabs = np.stack(((-half - start) / directions, (half - start) / directions))
    near, far = np.nanmin(slabs, axis=0).max(axis=1), np.nanmax(slabs, axis=0).min(axis=1)
    return np.where((near <= far) & (far > 0.0), far, np.inf)
