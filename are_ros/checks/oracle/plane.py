"""The oracle's plane geometry: what overlaps what, and how far.

Shares no code with what it judges: numpy and scipy only. `are check`, the judge of soaks and the
tests use it. Everything is in metres and radians; boxes are upright, turned about the vertical.
"""

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

TOUCHING_M: Final = 1e-6
"""Boxes that overlap by at most this, or are at most this far apart, may count as either."""


class Boxes(Protocol):
    """N boxes: centres and half sizes float64 (N, 3), headings float64 (N,)."""

    @property
    def centres_m(self) -> Floats:
        """The centres (N, 3)."""

    @property
    def yaws_rad(self) -> Floats:
        """The headings (N,)."""

    @property
    def half_sizes_m(self) -> Floats:
        """Half the lengths, widths and heights (N, 3)."""


@dataclass(frozen=True, eq=False)
class PlainBoxes:
    """Boxes as plain arrays."""

    centres_m: Floats
    yaws_rad: Floats
    half_sizes_m: Floats

    @classmethod
    def standing(
        cls, feet_m: Floats, yaws_rad: Floats, offsets_m: Floats, sizes_m: Floats
    ) -> "PlainBoxes":
        """Return boxes that stand on (N, 3), beside it by offsets (N, 2 or more) of their own."""
        c, s = np.cos(yaws_rad), np.sin(yaws_rad)
        x, y = offsets_m[:, 0], offsets_m[:, 1]
        aside = np.column_stack((c * x - s * y, s * x + c * y, 0.5 * sizes_m[:, 2]))
        return cls(feet_m + aside, yaws_rad, 0.5 * sizes_m)


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

    def depths_m(self, x_m: float, y_m: float, yaw_rad: float, boxes: Boxes) -> Floats:
        """Return how deep (N,) the outline at a pose reaches into boxes; negative where apart.

        The depth where they overlap is exact; where apart only the sign is.
        """
        cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
        corners = self.corners_m @ np.array([[cos, sin], [-sin, cos]]) + (x_m, y_m)
        return np.array([self._depth(corners, boxes, i) for i in range(len(boxes.yaws_rad))])

    def _depth(self, corners: Floats, boxes: Boxes, index: int) -> float:
        yaw = boxes.yaws_rad[index]
        cos, sin = np.cos(yaw), np.sin(yaw)
        local = (corners - boxes.centres_m[index, :2]) @ np.array([[cos, -sin], [sin, cos]])
        half = boxes.half_sizes_m[index, :2]
        if len(local) == 1:
            return self.radius_m - _distance(local[0], half)
        return _polygon_depth(local, half)


def overlap_depths_m(boxes: Boxes, first: Indices, second: Indices) -> Floats:
    """Return how deep (P,) boxes `first` and `second` (P,) overlap; negative where apart."""
    centres, yaws, halves = boxes.centres_m, boxes.yaws_rad, boxes.half_sizes_m
    apart = centres[second] - centres[first]
    in_height = halves[first, 2] + halves[second, 2] - np.abs(apart[:, 2])
    in_plane = rectangle_depths_m(
        apart[:, :2], yaws[first], halves[first], yaws[second], halves[second]
    )
    deepest: Floats = np.minimum(in_height, in_plane)
    return deepest


def overlapping(boxes: Boxes) -> list[tuple[int, int, float]]:
    """Return the pairs of boxes that overlap by more than a touch, and how deep each does."""
    radii = np.hypot(boxes.half_sizes_m[:, 0], boxes.half_sizes_m[:, 1])
    if len(radii) < 2 or not np.isfinite(boxes.centres_m).all():
        first, second = np.triu_indices(len(radii), 1)
    else:
        tree = cKDTree(boxes.centres_m[:, :2])
        near = tree.query_pairs(2.0 * float(radii.max()), output_type="ndarray")
        first, second = near[np.lexsort((near[:, 1], near[:, 0]))].T
    depths = overlap_depths_m(boxes, first, second)
    deep = np.flatnonzero(depths > TOUCHING_M)
    return [(int(first[i]), int(second[i]), float(depths[i])) for i in deep]


def rectangle_depths_m(
    apart_m: Floats,
    yaws: Floats | float,
    halves: Floats,
    other_yaws: Floats | float,
    other_halves: Floats,
) -> Floats:
    """Return how deep rectangles overlap others `apart_m` (P, 2) from them; negative where apart.

    By separating axes: the least overlap along the sides of both. `halves` are (P, 2 or more) or
    the same for all.
    """
    depths = []
    for angles in (yaws, other_yaws):
        cos, sin = np.cos(angles), np.sin(angles)
        for x, y in ((cos, sin), (-sin, cos)):
            reach = _reach(yaws, halves, x, y) + _reach(other_yaws, other_halves, x, y)
            depths.append(reach - np.abs(apart_m[:, 0] * x + apart_m[:, 1] * y))
    deepest: Floats = np.min(np.broadcast_arrays(*depths), axis=0)
    return deepest


def _reach(yaws: Floats | float, halves: Floats, x: Floats, y: Floats) -> Floats:
    """Return half the extent of rectangles along directions (x, y)."""
    cos, sin = np.cos(yaws), np.sin(yaws)
    along, across = np.abs(cos * x + sin * y), np.abs(cos * y - sin * x)
    reach: Floats = halves[..., 0] * along + halves[..., 1] * across
    return reach


def distances_m(points_m: Floats, centre_m: Floats, yaw_rad: float, half_m: Floats) -> Floats:
    """Return the distances (M,) of points (M, 3) from a solid box, 0 inside."""
    return np.maximum(signed_distances_m(points_m, centre_m, yaw_rad, half_m), 0.0)


def signed_distances_m(
    points_m: Floats, centre_m: Floats, yaw_rad: float, half_m: Floats
) -> Floats:
    """Return the distances (M,) of points (M, 3) from a box's surface, negative inside."""
    beyond = np.abs(in_box(points_m - centre_m, yaw_rad)) - half_m
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    signed: Floats = np.where(outside > 0.0, outside, beyond.max(axis=1))
    return signed


def slab(starts: Floats, ways: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Return where rays enter and leave the slabs between `low` and `high`, along each axis.

    All broadcast to (N, 3). A ray along a slab is in it for ever (-inf, inf) or never (inf, -inf).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (low - starts) / ways, (high - starts) / ways
    inside = (starts >= low) & (starts <= high)
    still = ways == 0.0
    enter = np.where(still, np.where(inside, -np.inf, np.inf), np.minimum(one, other))
    leave = np.where(still, np.where(inside, np.inf, -np.inf), np.maximum(one, other))
    return enter, leave


def about_z(yaw_rad: float) -> Floats:
    """Return the rotation (3, 3) by a yaw."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))


def in_box(vectors_m: Floats, yaw_rad: float) -> Floats:
    """Return vectors (N, 3) along the axes of what is turned by a yaw."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y = vectors_m[:, 0], vectors_m[:, 1]
    turned: Floats = np.column_stack((cos * x + sin * y, cos * y - sin * x, vectors_m[:, 2]))
    return turned


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
