"""Where no camera sees: for artefacts that come and go unseen (section 3.2)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.builder._occlusion_types import Voxels
from are_ros.builder._outlook import Outlook
from are_ros.builder._view_kernels import seen_boxes
from are_ros.builder._view_pyramid import ViewPyramid, pyramid_of
from are_ros.builder.ray_casting import VoxelField
from are_ros.world.environment import Environment
from are_ros.world.oriented_boxes import OrientedBoxes
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.view_models import ViewModel


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A camera that looks: its view model, and the pose of its optical frame."""

    view: ViewModel
    map_from_camera: RigidTransform


class OutOfView:
    """Tells which boxes no camera sees, whoever else stands in the way.

    A box is in view if any pixel of a camera shows it within the range, before the environment.
    Other artefacts are no cover: they walk away. It is the z-buffer's test (equation 2 without
    the other artefacts) on boxes grown by a millimetre, so an error is one towards "in view". With
    no viewpoint at all, every box is hidden.

    A tile of an image is traced when a box is first looked for in it, so that the first question
    costs what it needs; all further ones from the same viewpoints profit.
    """

    def __init__(self, max_range_m: float) -> None:
        self._max_range_m = max_range_m
        self._environment: Environment | None = None
        self._viewpoints: tuple[Viewpoint, ...] = ()
        self._pyramids: list[tuple[ViewModel, ViewPyramid]] = []
        self._outlooks: list[tuple[ViewPyramid, Outlook]] | None = None

    def look(self, environment: Environment, viewpoints: Sequence[Viewpoint]) -> None:
        """Look from these viewpoints from now on; costs nothing until there is a question."""
        same_place = environment is self._environment and len(viewpoints) == len(self._viewpoints)
        if same_place and all(map(_are_equal, viewpoints, self._viewpoints)):
            return
        self._environment, self._viewpoints = environment, tuple(viewpoints)
        self._outlooks = None

    def hides(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell which of N boxes in the map frame no camera sees: bool (N,)."""
        hidden = np.ones(len(boxes), np.bool_)
        if self._outlooks is None:
            self._outlooks = self._prepared()
        for pyramid, outlook in self._outlooks:
            left = np.flatnonzero(hidden)
            hidden[left] = ~seen_boxes(pyramid, outlook, boxes.packed[left])
        return hidden

    def _prepared(self) -> list[tuple[ViewPyramid, Outlook]]:
        if self._environment is None or not self._viewpoints:
            return []
        field = VoxelField.of(self._environment.voxels)
        known, self._pyramids = self._pyramids, []
        for viewpoint in self._viewpoints:
            self._pyramids.append((viewpoint.view, _pyramid_among(known, viewpoint.view)))
        return [
            (pyramid, _outlook(pyramid, viewpoint, field, self._max_range_m))
            for (_, pyramid), viewpoint in zip(self._pyramids, self._viewpoints, strict=True)
        ]


def _pyramid_among(known: list[tuple[ViewModel, ViewPyramid]], view: ViewModel) -> ViewPyramid:
    for other, pyramid in known:
        if other == view:
            return pyramid
    return pyramid_of(view)


def _outlook(
    pyramid: ViewPyramid, viewpoint: Viewpoint, field: VoxelField, max_range_m: float
) -> Outlook:
    camera_m = viewpoint.map_from_camera.translation_m
    origin, ignored, matrix = field.lattice_rays(camera_m)
    per_m = (1.0 / np.array(field.voxel_size_m)).astype(np.float32)
    tiles, limit = pyramid.tiles.valid.shape, np.float32(max_range_m)
    return Outlook(
        viewpoint.map_from_camera.rotation_matrix().astype(np.float32),
        np.ascontiguousarray(camera_m, dtype=np.float64),
        limit,
        Voxels(field.distances, origin, ignored, matrix, per_m),
        np.zeros(tiles[0], np.uint8),
        np.empty(tiles, np.float32),
        np.full(len(pyramid.axes), limit, np.float32),
    )


def _are_equal(one: Viewpoint, other: Viewpoint) -> bool:
    """Tell whether two viewpoints are the same, number by number."""
    a, b = one.map_from_camera, other.map_from_camera
    same_pose = a.translation_m.tolist() == b.translation_m.tolist() and (
        a.rotation_xyzw.tolist() == b.rotation_xyzw.tolist()
    )
    return bool(same_pose and one.view == other.view)
