"""What touches what, by arithmetic of the judge's own: boxes, discs and the cells of a map."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from are_ros.builder.outputs import ArtefactState

_TOUCH_M = 1e-6
_SIGNS = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])

_Floats = npt.NDArray[np.float64]


def boxes_of(states: Sequence[ArtefactState]) -> _Floats:
    """Return rows x, y, yaw, half length, half width, low z, high z of the boxes, (N, 7)."""
    rows = []
    for state in states:
        pose, (bx, by, _), (lx, ly, lz) = state.ground_pose, state.box_centre_m, state.size_m
        c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        x_m, y_m = pose.x_m + c * bx - s * by, pose.y_m + s * bx + c * by
        rows.append((x_m, y_m, pose.yaw_rad, lx / 2, ly / 2, pose.z_m, pose.z_m + lz))
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def overlapping(boxes: _Floats) -> list[tuple[int, int]]:
    """Return the pairs whose footprints share more than a touch, and whose heights do."""
    if len(boxes) < 2:
        return []
    reach = np.hypot(boxes[:, 3], boxes[:, 4])
    pairs = cKDTree(boxes[:, :2]).query_pairs(2.0 * float(reach.max()))
    corners, found = _corners(boxes), []
    for i, j in sorted(pairs):
        is_high = min(boxes[i, 6], boxes[j, 6]) - max(boxes[i, 5], boxes[j, 5]) > _TOUCH_M
        if is_high and _share_area(corners[i], corners[j]):
            found.append((i, j))
    return found


def met_by_disc(boxes: _Floats, x_m: float, y_m: float, radius_m: float) -> list[int]:
    """Return which boxes a disc on the ground overlaps by more than a touch."""
    dx, dy = x_m - boxes[:, 0], y_m - boxes[:, 1]
    c, s = np.cos(boxes[:, 2]), np.sin(boxes[:, 2])
    along = np.maximum(np.abs(c * dx + s * dy) - boxes[:, 3], 0.0)
    across = np.maximum(np.abs(c * dy - s * dx) - boxes[:, 4], 0.0)
    return [int(i) for i in np.flatnonzero(np.hypot(along, across) < radius_m - _TOUCH_M)]


class Walls:
    """The occupied cells of a map, as squares that footprints are tested against."""

    def __init__(
        self, occupied: npt.NDArray[np.bool_], cell_m: float, origin: tuple[float, float, float]
    ) -> None:
        """Take which cells (rows along y, columns along x) are walls, and x, y, yaw of the map.

        The origin is that of the outer corner of the cell (0, 0), as in nav_msgs/OccupancyGrid.
        """
        rows, columns = np.nonzero(occupied)
        x_m, y_m, yaw_rad = origin
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        along, across = (columns + 0.5) * cell_m, (rows + 0.5) * cell_m
        self._centres_m = np.column_stack(
            (x_m + c * along - s * across, y_m + s * along + c * across)
        )
        self._tree = cKDTree(self._centres_m) if len(self._centres_m) else None
        self._half_m, self._yaw_rad = 0.5 * cell_m, yaw_rad
        self._reach_m = 0.5 * cell_m * math.sqrt(2.0)

    def met(self, boxes: _Floats) -> list[int]:
        """Return which footprints overlap an occupied cell by more than a touch."""
        if not len(boxes) or self._tree is None:
            return []
        reach = np.hypot(boxes[:, 3], boxes[:, 4]) + self._reach_m
        distances, _ = self._tree.query(boxes[:, :2])
        near = np.flatnonzero(distances < reach).tolist()
        return [i for i in near if self._meets(self._tree, boxes[i], reach[i])]

    def _meets(self, tree: cKDTree, box: _Floats, reach_m: float) -> bool:
        """Tell whether no axis of the box, nor of the cells, separates it from one of them."""
        offsets_m = self._centres_m[tree.query_ball_point(box[:2], reach_m)] - box[:2]
        turn_rad = self._yaw_rad - box[2]
        c, s, half_m = abs(math.cos(turn_rad)), abs(math.sin(turn_rad)), self._half_m
        cell_m = half_m * (c + s)
        reaches_m = (
            (box[3] + cell_m, box[4] + cell_m),
            (c * box[3] + s * box[4] + half_m, s * box[3] + c * box[4] + half_m),
        )
        depths_m = [
            np.array(reach) - np.abs(_turned(offsets_m, -yaw))
            for yaw, reach in zip((box[2], self._yaw_rad), reaches_m, strict=True)
        ]
        return bool((np.hstack(depths_m) > _TOUCH_M).all(axis=1).any())


def _turned(points_m: _Floats, angle_rad: float) -> _Floats:
    """Return points (N, 2) turned about (0, 0)."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    turned: _Floats = points_m @ np.array([(c, s), (-s, c)])
    return turned


def _corners(boxes: _Floats) -> _Floats:
    """Return the corners (N, 4, 2) of the footprints."""
    local = _SIGNS * boxes[:, None, 3:5]
    c, s = np.cos(boxes[:, 2])[:, None], np.sin(boxes[:, 2])[:, None]
    x, y = c * local[..., 0] - s * local[..., 1], s * local[..., 0] + c * local[..., 1]
    corners: _Floats = boxes[:, None, :2] + np.stack((x, y), axis=-1)
    return corners


def _share_area(one: _Floats, other: _Floats) -> bool:
    """Tell whether two convex polygons (K, 2) overlap by more than a touch: separating axes."""
    for polygon in (one, other):
        edges = np.roll(polygon, -1, axis=0) - polygon
        normals = np.column_stack((edges[:, 1], -edges[:, 0]))
        normals /= np.hypot(normals[:, 0], normals[:, 1])[:, None]
        a, b = one @ normals.T, other @ normals.T
        depth = np.minimum(a.max(axis=0), b.max(axis=0)) - np.maximum(a.min(axis=0), b.min(axis=0))
        if (depth <= _TOUCH_M).any():
            return False
    return True
