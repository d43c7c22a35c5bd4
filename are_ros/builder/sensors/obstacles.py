"""What sensors meet: the artefacts, and the surface of the environment; first hits of rays."""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder.occlusion.meshes import MeshSelection, Tree, cast, enters
from are_ros.builder.occlusion.rays import VoxelField, inverse
from are_ros.builder.scene import Scene
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.rigid_transform import RigidTransform, product

_Floats = npt.NDArray[np.float64]

_SLACK: Final = 1e-9
"""Relative slack of the ball around a box, for rounding."""


@dataclass(frozen=True, eq=False)
class Obstacles:
    """What a sensor can hit, in the map frame: `boxes` of N >= 1 artefacts.

    `shapes` are the N meshes, or the boxes themselves; `surface` is the surface of the environment,
    None if there is none. Depth cameras see as far as `depth_range_m`. `scene` are the artefacts,
    and `studio` paints them. Rays are unit vectors (K, 3) in the sensor's frame, from its origin.
    """

    boxes: OrientedBoxes
    shapes: MeshSelection
    surface: VoxelField | None = None
    depth_range_m: float = math.inf
    scene: Scene | None = None
    studio: Any = None

    def first_hits(
        self, map_from_sensor: RigidTransform, rays: _Floats, limits_m: _Floats | float
    ) -> _Floats:
        """Return the distance [m] to the first artefact along rays, float64 (K,); inf for none.

        Hits beyond the limits, (K,) or one for all, are left out. A ray that starts inside a box
        hits it at 0; a mesh has only its surface.
        """
        hits_m, by_axis = np.full(len(rays), np.inf), np.ascontiguousarray(rays.T).view()
        by_axis.flags.writeable = False  # of one type for the compiler, whoever made the rays
        _first_hits(
            map_from_sensor.translation_m,
            map_from_sensor.rotation_matrix(),
            by_axis,
            np.full(len(rays), limits_m, dtype=np.float64),
            self.boxes.packed,
            self.shapes.indices,
            self.shapes.pool.tree,
            hits_m,
        )
        return hits_m

    def are_hidden(
        self, map_from_sensor: RigidTransform, rays: _Floats, hits_m: npt.NDArray[np.floating]
    ) -> npt.NDArray[np.bool_]:
        """Return which hits (K,) [m] along rays the environment hides: it is met before."""
        if self.surface is None or not len(rays):
            return np.zeros(len(rays), np.bool_)
        directions = product(rays, map_from_sensor.rotation_matrix().T)
        origin_m, farthest_m = map_from_sensor.translation_m, float(hits_m.max())
        return self.surface.first_hits(origin_m, directions, farthest_m) < hits_m


@compiled
def _first_hits(
    sensor_m: _Floats,
    map_from_sensor: _Floats,
    rays: _Floats,
    limits_m: _Floats,
    boxes: _Floats,
    meshes: npt.NDArray[np.int64],
    tree: Tree,
    hits_m: _Floats,
) -> None:
    """Lower each hit [m] of rays (3, K) to the first on any box or mesh.

    `boxes` as `OrientedBoxes.packed`. Only rays that meet the ball around a box are cast, if their
    limits reach it; all are tested first, in a loop without branches, which the compiler
    vectorises.
    """
    xs, ys, zs = rays[0], rays[1], rays[2]
    may_meet, corners = np.empty(xs.size, np.bool_), np.empty(6)
    for box in range(boxes.shape[0]):
        apart = boxes[box, :3] - sensor_m
        middle = map_from_sensor.T @ apart
        for side in range(3):
            corners[side], corners[3 + side] = -boxes[box, 5 + side], boxes[box, 5 + side]
        away2 = apart[0] ** 2 + apart[1] ** 2 + apart[2] ** 2
        radius2 = corners[3] ** 2 + corners[4] ** 2 + corners[5] ** 2
        tangent2 = away2 - radius2 * (1.0 + _SLACK) - _SLACK * away2
        least = np.sqrt(tangent2) if tangent2 > 0.0 else -np.inf
        near = np.sqrt(away2) * (1.0 - _SLACK) - np.sqrt(radius2)
        for ray in range(xs.size):
            along = xs[ray] * middle[0] + ys[ray] * middle[1] + zs[ray] * middle[2]
            may_meet[ray] = (along >= least) & (limits_m[ray] >= near)
        cosine, sine, oz = boxes[box, 3], boxes[box, 4], -apart[2]
        ox = -cosine * apart[0] - sine * apart[1]
        oy = sine * apart[0] - cosine * apart[1]
        for ray in range(xs.size):
            if not may_meet[ray]:
                continue
            a, b, c = xs[ray], ys[ray], zs[ray]
            x = a * map_from_sensor[0, 0] + b * map_from_sensor[0, 1] + c * map_from_sensor[0, 2]
            y = a * map_from_sensor[1, 0] + b * map_from_sensor[1, 1] + c * map_from_sensor[1, 2]
            dz = a * map_from_sensor[2, 0] + b * map_from_sensor[2, 1] + c * map_from_sensor[2, 2]
            dx, dy = cosine * x + sine * y, cosine * y - sine * x
            limit = min(limits_m[ray], hits_m[ray])
            if meshes[box] >= 0:
                hit = cast(tree, meshes[box], ox, oy, oz, dx, dy, dz, limit)
            else:
                hit = enters(corners, ox, oy, oz, inverse(dx), inverse(dy), inverse(dz))
            if hit <= limit:
                hits_m[ray] = hit
