"""Plane geometry of upright boxes by separating axes: depths of overlap, with their sign."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import yaml
from numpy.typing import NDArray

Floats = NDArray[np.float64]

TOUCHING_M: Final = 1e-6
"""What overlaps by no more than this, or is no farther apart, may count as either."""


@dataclass(frozen=True, eq=False)
class Outline:
    """A robot on the ground: all within `radius_m` of the convex polygon `corners_m` (K, 2)."""

    corners_m: Floats
    radius_m: float

    @classmethod
    def of(cls, text: str, radius_m: float) -> "Outline":
        """Return the polygon of Nav2's text, or a disc where the text is empty."""
        if not text:
            return cls(np.zeros((1, 2)), radius_m)
        from scipy.spatial import ConvexHull

        points = np.array(yaml.safe_load(text), np.float64)
        return cls(points[ConvexHull(points).vertices], 0.0)

    def inscribed_m(self) -> float:
        """Return the radius of the largest disc about the origin inside, 0 if there is none."""
        if len(self.corners_m) == 1:
            return self.radius_m
        edges = np.roll(self.corners_m, -1, axis=0) - self.corners_m
        cross = self.corners_m[:, 0] * edges[:, 1] - self.corners_m[:, 1] * edges[:, 0]
        return max(0.0, float((cross / np.hypot(*edges.T)).min()))

    def depths_m(self, x_m: float, y_m: float, yaw_rad: float, boxes: Any) -> Floats:
        """Return how deep (N,) the outline at a pose reaches into boxes; negative where apart.

        The depth where they overlap is exact; where apart only the sign is.
        """
        cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
        corners = self.corners_m @ np.array([[cos, sin], [-sin, cos]]) + (x_m, y_m)
        return np.array([self._depth(corners, boxes, i) for i in range(len(boxes.ids))])

    def _depth(self, corners: Floats, boxes: Any, index: int) -> float:
        yaw = boxes.yaws_rad[index]
        cos, sin = np.cos(yaw), np.sin(yaw)
        local = (corners - boxes.centres_m[index, :2]) @ np.array([[cos, -sin], [sin, cos]])
        half = boxes.half_sizes_m[index, :2]
        if len(local) == 1:
            return self.radius_m - _distance(local[0], half)
        return _polygon_depth(local, half)


def overlap_depths_m(boxes: Any, first: NDArray[np.int64], second: NDArray[np.int64]) -> Floats:
    """Return how deep (P,) boxes `first` and `second` (P,) overlap; negative where apart."""
    apart = boxes.centres_m[second] - boxes.centres_m[first]
    halves = boxes.half_sizes_m
    depths = [halves[first, 2] + halves[second, 2] - np.abs(apart[:, 2])]
    for angles in (boxes.yaws_rad[first], boxes.yaws_rad[second]):
        for quarter in (0.0, 0.5 * np.pi):
            x, y = np.cos(angles + quarter), np.sin(angles + quarter)
            reach = _reach(boxes, first, x, y) + _reach(boxes, second, x, y)
            depths.append(reach - np.abs(apart[:, 0] * x + apart[:, 1] * y))
    deepest: Floats = np.min(depths, axis=0)
    return deepest


def distances_m(points_m: Floats, centre_m: Floats, yaw_rad: float, half_m: Floats) -> Floats:
    """Return the distances (M,) of points (M, 3) from a solid box, 0 inside."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    apart = points_m - centre_m
    x = apart[:, 0] * cos + apart[:, 1] * sin
    y = apart[:, 1] * cos - apart[:, 0] * sin
    outside = np.maximum(np.abs(np.column_stack((x, y, apart[:, 2]))) - half_m, 0.0)
    distances: Floats = np.linalg.norm(outside, axis=1)
    return distances


def _reach(boxes: Any, which: NDArray[np.int64], x: Floats, y: Floats) -> Floats:
    """Return half the extent of boxes along directions (x, y)."""
    yaws, halves = boxes.yaws_rad[which], boxes.half_sizes_m[which]
    cos, sin = np.cos(yaws), np.sin(yaws)
    along, across = np.abs(cos * x + sin * y), np.abs(cos * y - sin * x)
    reach: Floats = halves[:, 0] * along + halves[:, 1] * across
    return reach


def _distance(point: Floats, half: Floats) -> float:
    """Return the signed distance of a point from a rectangle about the origin."""
    beyond = np.abs(point) - half
    outside = float(np.hypot(*np.maximum(beyond, 0.0)))
    return outside if outside > 0.0 else float(beyond.max())


def _polygon_depth(corners: Floats, half: Floats) -> float:
    """Return the least overlap of a polygon and a rectangle over the normals of their edges."""
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack((edges[:, 1], -edges[:, 0]))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    axes = np.vstack((normals, np.eye(2), -np.eye(2)))
    farthest = (corners @ axes.T).max(axis=0)
    nearest = -(np.abs(axes) @ half)
    return float((farthest - nearest).min())
