"""Boxes that no camera sees: for artefacts that arrive and vanish unseen (section 3.2)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.occlusion.zbuffer import ZBuffer
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import ViewModel
from are_ros.world.environment import Environment
from are_ros.world.rigid_transform import RigidTransform

_GROWN_M: Final = 1e-3


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A camera: its view model, and the pose of its optical frame in the map frame."""

    view: ViewModel
    map_from_camera: RigidTransform


class OutOfView:
    """Tells which boxes no camera sees.

    A box is in view if a pixel of a camera shows it within the range, in front of the environment.
    Other artefacts do not hide it, because they move. The test is the z-buffer (equation 2) without
    mutual occlusion. Boxes are enlarged by a millimetre, so that rounding errors count as in view.
    Without a viewpoint, every box is hidden.
    """

    def __init__(self, max_range_m: float) -> None:
        self._max_range_m = max_range_m
        self._environment: Environment | None = None
        self._viewpoints: tuple[Viewpoint, ...] = ()
        self._buffers: list[tuple[ViewModel, ZBuffer]] = []

    def look(self, environment: Environment, viewpoints: Sequence[Viewpoint]) -> None:
        """Set the environment and the viewpoints; nothing is computed before `hides`."""
        self._environment, self._viewpoints = environment, tuple(viewpoints)

    def hides(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell which of N boxes in the map frame no camera sees: bool (N,)."""
        hidden = np.ones(len(boxes), np.bool_)
        if self._environment is None or not self._viewpoints:
            return hidden
        field = VoxelField.of(self._environment.voxels)
        grown = OrientedBoxes(boxes.centres_m, boxes.yaws_rad, boxes.half_sizes_m + _GROWN_M)
        self._buffers = [(point.view, self._buffer(point.view)) for point in self._viewpoints]
        for point, (_, buffer) in zip(self._viewpoints, self._buffers, strict=True):
            left = np.flatnonzero(hidden)
            shown = buffer.visibility(point.map_from_camera, grown.take(left), field, mutual=False)
            hidden[left] = shown.visible_pixels == 0
        return hidden

    def _buffer(self, view: ViewModel) -> ZBuffer:
        """Return the z-buffer of a view; that of the last call if the view is the same."""
        known = (buffer for other, buffer in self._buffers if other == view)
        return next(known, None) or ZBuffer(view, self._max_range_m)
