"""Surfaces without textures, for tests."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from are_ros.builder.rendering.surface import Surface
from are_ros.population.meshes.appearance import DrawnMesh


def plain_surface(
    corners_m: npt.NDArray[np.float64],
    colours: npt.NDArray[np.float64],
    *,
    is_closed: bool = False,
) -> Surface:
    """Return a surface of corners (F, 3, 3) [m] and sRGB colours (F, 3) of faces in [0, 1]."""
    plain = DrawnMesh.plain(corners_m, np.repeat(colours[:, np.newaxis], 3, axis=1))
    return Surface.of_mesh(replace(plain, is_closed=is_closed))
