"""What a track follows: an artefact, or the box of a false alarm, and how it moves."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.builder.scene import Scene
from are_ros.conventions import NS_PER_S
from are_ros.population.artefact import shape_of
from are_ros.population.catalogue import CatalogueRow
from are_ros.world.boxes import OrientedBoxes

Motion = Sequence[float]
"""x, y, z [m] and yaw [rad] on the ground in the map frame, the rates of x, y [m/s] and yaw."""

Shape = tuple[float, float, float, float, float]
"""Half sizes of the box, and its centre's x, y in F_A [m]."""


class Body(NamedTuple):
    """A body of a row's type with its motion as of `at_ns`; F_A is `height_m` above the ground.

    `behaviour` is what an artefact does; a false alarm does nothing.
    """

    row: CatalogueRow
    shape: Shape
    height_m: float
    motion: Motion
    at_ns: int
    behaviour: str = ""

    @classmethod
    def of_scene(cls, scene: Scene, k: int, at_ns: int) -> "Body":
        """Return artefact k of a scene."""
        row, motion = scene.rows[k], scene.motions[k].tolist()
        behaviour = scene.status[k][1]
        return cls(row, shape_of(row), row.com_height_m, motion, at_ns, behaviour)

    @classmethod
    def box(cls, row: CatalogueRow, motion: Motion, at_ns: int) -> "Body":
        """Return a box of a row's size; its F_A sits in the middle."""
        half_x_m, half_y_m, half_z_m = (0.5 * side_m for side_m in row.size_m)
        return cls(row, (half_x_m, half_y_m, half_z_m, 0.0, 0.0), half_z_m, motion, at_ns)

    def coasted(self, now_ns: int) -> "Body":
        """Return the body after it has moved on in a straight line."""
        dt_s = (now_ns - self.at_ns) / NS_PER_S
        x, y, z, yaw, vx, vy, turn = self.motion
        motion = (x + vx * dt_s, y + vy * dt_s, z, yaw, vx, vy, turn)
        return self._replace(motion=motion, at_ns=now_ns)


def boxes_at(
    motions: Sequence[Sequence[float]] | npt.NDArray[np.float64], shapes: Sequence[Shape]
) -> OrientedBoxes:
    """Return the boxes of these shapes, N, whose bodies are where the motions (N, 7) say."""
    poses = np.array(motions, dtype=np.float64).reshape(-1, 7)[:, :4]
    return OrientedBoxes.standing(poses, np.array(shapes, dtype=np.float64).reshape(-1, 5))
