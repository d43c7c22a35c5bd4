"""Images of depths computed anew, pixel by pixel and triangle by triangle, and compared.

Shares no code with what it judges: numpy only. It is slow, and there is nothing in it that could
be quick: each triangle against each pixel whose ray could meet it.
"""

import itertools
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.images.depths import DepthFrame
from are_ros.checks.oracle.frames import Pose
from are_ros.checks.oracle.solids import Walls

Floats = NDArray[np.float64]

_NEAR_M: Final = 1e-3
_GRAZING_M: Final = 1e-4

_BESIDE: Final = 2e-5
"""Rays so far beside one of a pixel, per metre of depth, are as good: about a hundredth of a pixel.
At an edge they may meet something else, and rounding decides."""

_ALIKE: Final = 1e-4
"""Depths on a slope that such rays meet differ by such a share."""


class Difference(NamedTuple):
    """How an image differs from the one computed anew: numbers of pixels.

    `tested` of them have a ray. `by_a_step` differ by one step of the encoding. `at_edges` are as
    a ray has it that is a hundredth of a pixel beside theirs; `others` differ though not.
    The first of those is at `place` (row, column), (-1, -1) if there is none.
    """

    tested: int
    by_a_step: int
    at_edges: int
    others: int
    place: tuple[int, int] = (-1, -1)


def nearest_depths(rays: Floats, camera: Pose, shapes: Sequence[Floats]) -> Floats:
    """Return the depth (H, W) [m] at which rays (H, W, 3) meet triangles (F, 3, 3) first, or inf.

    The triangles are in the map; `camera` is its pose there.
    """
    flat = rays.reshape(-1, 3)
    depths = np.full(len(flat), np.inf)
    for triangles in shapes:
        corners = (triangles - camera.translation_m) @ camera.rotation
        near = _within(flat, corners.reshape(-1, 3))
        rays_near, depths_near = flat[near], depths[near]
        for corner in corners if len(near) else ():
            which = _within(rays_near, corner)
            met = _met(rays_near[which], corner)
            depths_near[which] = np.minimum(depths_near[which], met)
        depths[near] = depths_near
    return depths.reshape(rays.shape[:2])


def _within(rays: Floats, corners: Floats) -> NDArray[np.int64]:
    """Return which rays (N, 3) may meet what has these corners (M, 3), all of the camera's frame.

    None of what is behind the camera. All where a corner is, or rays do not go along the axis.
    """
    if (rays[:, 2] == 1.0).all() and corners[:, 2].max() <= 0.0:
        return np.empty(0, np.int64)
    if corners[:, 2].min() <= _NEAR_M or (rays[:, 2] != 1.0).any():
        return np.arange(len(rays))
    seen = corners[:, :2] / corners[:, 2:]
    low, high = seen.min(axis=0) - 1e-6, seen.max(axis=0) + 1e-6
    x, y = rays[:, 0], rays[:, 1]
    return np.flatnonzero((x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]))


def _met(rays: Floats, corner: Floats) -> Floats:
    """Return the depths at which rays (N, 3) from 0 meet a triangle (3, 3), inf if they do not.

    By solving for the corners' weights: a ray times its depth is the weighted sum of the corners.
    """
    volume = np.linalg.det(corner)
    if abs(volume) < 1e-15:
        return np.full(len(rays), np.inf)
    weights = rays @ np.linalg.inv(corner)
    total = weights.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        is_met = (weights >= 0.0).all(axis=1) & (total > 0.0)
        return np.where(is_met, 1.0 / total, np.inf)


def box_triangles() -> Floats:
    """Return the triangles (12, 3, 3) of a cube from -1 to 1."""
    found = []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for side in (-1.0, 1.0):
            square = np.zeros((4, 3))
            square[:, axis] = side
            square[:, others] = ((-1, -1), (1, -1), (1, 1), (-1, 1))
            found += [square[[0, 1, 2]], square[[0, 2, 3]]]
    return np.array(found)


def compared(
    real: DepthFrame,
    output: DepthFrame,
    rays: Floats,
    camera: Pose,
    shapes: Sequence[Floats],
    range_m: float,
    walls: Walls | None,
) -> Difference:
    """Return how an output differs from what follows from its input and the artefacts' triangles.

    Pixels without a return, where artefacts are met, are left out if the walls are not known.
    """
    scene = _Scene(camera, shapes, min(range_m, real.farthest_m), walls)
    hits_m, is_doubtful = scene.hits(rays, real.depths_m)
    is_hit = np.isfinite(hits_m)
    is_doubtful |= np.isnan(rays).any(axis=2)
    with np.errstate(invalid="ignore"):
        wanted = np.where(is_hit, real.numbers_of(np.where(is_hit, hits_m, 1.0)), np.nan)
        found = output.numbers.astype(np.float64)
        kept = real.numbers.astype(np.float64)
        step = 4e-7 * np.abs(wanted) if real.numbers.dtype.kind == "f" else 0.5 + 1e-6
        is_same = np.where(is_hit, np.abs(found - wanted) <= step, found == kept)
        is_same |= ~is_hit & np.isnan(kept) & np.isnan(found)
        is_near = is_hit & (np.abs(found - wanted) <= 3.0 * step)
    differs = ~is_same & ~is_doubtful
    by_a_step, others = differs & is_near, differs & ~is_near
    at_edges = np.zeros_like(others)
    at_edges[others] = _is_beside(real, output, rays, scene, others)
    others &= ~at_edges
    place = (-1, -1)
    if others.any():
        row, column = np.argwhere(others)[0].tolist()
        place = row, column
    counts = [int(np.count_nonzero(one)) for one in (~is_doubtful, by_a_step, at_edges, others)]
    return Difference(counts[0], counts[1], counts[2], counts[3], place)


class _Scene(NamedTuple):
    """What rays of a camera meet: the artefacts' triangles, up to a depth, and walls if known."""

    camera: Pose
    shapes: Sequence[Floats]
    farthest_m: float
    walls: Walls | None

    def hits(self, rays: Floats, depths_m: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the depths (H, W) at which rays meet artefacts, inf where depths (H, W) stay.

        The second array tells where that is doubtful.
        """
        hits_m, is_none = nearest_depths(rays, self.camera, self.shapes), np.isnan(depths_m)
        limits_m = np.where(is_none, self.farthest_m, depths_m)
        is_hit = hits_m < limits_m
        is_doubtful = is_none & (np.abs(hits_m - limits_m) < _GRAZING_M)
        if (is_hit & is_none).any():
            _hide(is_hit, is_doubtful, is_none, hits_m, rays, self.camera, self.walls)
        return np.where(is_hit, hits_m, np.inf), is_doubtful


def _is_beside(
    real: DepthFrame,
    output: DepthFrame,
    rays: Floats,
    scene: _Scene,
    which: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Return which of some pixels (M,) have the number that a ray close beside theirs has."""
    depths_m, found = real.depths_m[which][None], output.numbers[which].astype(np.float64)
    is_kept = found == real.numbers[which]
    is_beside = np.zeros(len(found), np.bool_)
    if not len(found):
        return is_beside
    for x, y in itertools.product((-_BESIDE, 0.0, _BESIDE), repeat=2):
        hits_m = scene.hits(rays[which][None] + (x, y, 0.0), depths_m)[0][0]
        is_hit = np.isfinite(hits_m)
        numbers = real.numbers_of(np.where(is_hit, hits_m, 1.0))
        step = 0.0 if real.numbers.dtype.kind == "f" else 0.5
        is_alike = np.abs(found - numbers) <= step + _ALIKE * np.abs(numbers)
        is_beside |= np.where(is_hit, is_alike, is_kept)
    return is_beside


def _hide(
    is_hit: NDArray[np.bool_],
    is_doubtful: NDArray[np.bool_],
    is_none: NDArray[np.bool_],
    hits_m: Floats,
    rays: Floats,
    camera: Pose,
    walls: Walls | None,
) -> None:
    """Take away hits (H, W) of pixels without a return that are behind walls, in place."""
    which = np.nonzero(is_hit & is_none)
    if walls is None:
        is_doubtful[which] = True
        return
    ways = rays[which] @ camera.rotation.T
    lengths = np.linalg.norm(ways, axis=1)
    reaches_m = hits_m[which] * lengths
    starts_m = np.broadcast_to(camera.translation_m, ways.shape)
    solid_m = walls.first_solid(starts_m, ways / lengths[:, None], reaches_m + 1.0)
    is_hit[which] = solid_m >= reaches_m
    is_doubtful[which] |= np.abs(solid_m - reaches_m) < _GRAZING_M
