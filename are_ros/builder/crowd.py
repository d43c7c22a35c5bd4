"""The artefacts alive as arrays in the order of their ids: shapes, poses on the ground, boxes."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.artefact import GroundPose, shape_of
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.rows import with_row, without_row
from are_ros.builder import _crowd_kernels
from are_ros.parameters.choices import GroundKind
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment

_Floats = npt.NDArray[np.float64]


class Crowd:
    """N artefacts, in the order of their ids.

    `ids` int64 (N,), ascending; `poses` float64 (N, 4), x, y, z, yaw in the map, as of the last
    sub-step, or of an arrival since; `ends` float64 (N, 4), where they will be when the next one
    begins (the same array where nobody moves), and `end_boxes` there; `radii_m` float64 (N,), of
    the circles about (x, y) that hold the boxes. All are replaced, never written into, so that what
    was taken stays what it was.
    """

    def __init__(self, ground: GroundKind) -> None:
        self._is_plane = ground is GroundKind.PLANE
        self.clear()

    def clear(self) -> None:
        """Let nobody be there."""
        self.ids = np.empty(0, np.int64)
        self.poses = np.empty((0, 4))
        self.ends = self.poses
        self.radii_m = np.empty(0)
        self._shapes = np.empty((0, 5))
        self._packed = np.empty((0, 8))
        self._boxes: OrientedBoxes | None = None
        self._end_boxes: OrientedBoxes | None = None

    def add(
        self, artefact_id: int, row: CatalogueRow, pose: GroundPose, end: GroundPose | None = None
    ) -> None:
        """Let one more be there, who stands or goes to `end`; its id is none of those alive."""
        at = self.index_of(artefact_id)
        half_x_m, half_y_m, _, offset_x_m, offset_y_m = shape = shape_of(row)
        radius_m = math.hypot(half_x_m + abs(offset_x_m), half_y_m + abs(offset_y_m))
        self.ids = with_row(self.ids, at, artefact_id)
        goes = self.ends is not self.poses or (end is not None and end != pose)
        ends = with_row(self.ends, at, end or pose) if goes else None
        self.poses = with_row(self.poses, at, pose)
        self.ends = self.poses if ends is None else ends
        self.radii_m = with_row(self.radii_m, at, radius_m)
        self._shapes = with_row(self._shapes, at, shape)
        box = OrientedBoxes.standing(np.array([pose]), np.array([shape]))
        self._packed = with_row(self._packed, at, box.packed)
        self._boxes = self._end_boxes = None  # the next of a group sees this one

    def remove(self, artefact_id: int) -> None:
        """Let one be gone."""
        at = self.index_of(artefact_id)
        ends = without_row(self.ends, at) if self.ends is not self.poses else None
        self.ids, self.poses = without_row(self.ids, at), without_row(self.poses, at)
        self.ends = self.poses if ends is None else ends
        self.radii_m = without_row(self.radii_m, at)
        self._shapes, self._packed = without_row(self._shapes, at), without_row(self._packed, at)
        self._boxes = self._end_boxes = None

    def index_of(self, artefact_id: int) -> int:
        """Return where in the arrays an artefact stands that is there."""
        return int(self.ids.searchsorted(artefact_id))

    @property
    def boxes(self) -> OrientedBoxes:
        """The boxes (N) where they are; the same object while nobody comes, goes or moves."""
        if self._boxes is None:
            self._boxes = OrientedBoxes.of_packed(self._packed, self.poses[:, 3])
        return self._boxes

    @property
    def end_boxes(self) -> OrientedBoxes:
        """The boxes (N) where they will be; `boxes` itself where nobody moves."""
        if self.ends is self.poses:
            return self.boxes
        if self._end_boxes is None:
            self._end_boxes = OrientedBoxes.standing(self.ends, self._shapes)
        return self._end_boxes

    @property
    def taken(self) -> OrientedBoxes:
        """The boxes (N or 2 N) where they are and where they will be: there nobody may arrive."""
        if self.ends is self.poses:
            return self.boxes
        packed = np.concatenate((self.boxes.packed, self.end_boxes.packed))
        yaws_rad = np.concatenate((self.poses[:, 3], self.ends[:, 3]))
        return OrientedBoxes.of_packed(packed, yaws_rad)

    def set_out(self, ends: _Floats, boxes: OrientedBoxes) -> None:
        """Let all be bound for `ends` (N, 4), which is `poses` where nobody moves, with boxes."""
        self.ends, self._end_boxes = ends, boxes

    def proposed(
        self, planar: _Floats, moved: npt.NDArray[np.bool_], environment: Environment
    ) -> tuple[_Floats, OrientedBoxes]:
        """Return the poses (N, 4) and boxes if those `moved` (N,) were at `planar` (N, 3)."""
        if not moved.any():
            return self.poses, self.boxes
        planar = np.ascontiguousarray(planar)  # of one layout, or the kernel is compiled anew
        poses, packed = _crowd_kernels.moved_to(
            self.poses, self.boxes.packed, self._shapes, planar, moved
        )
        if self._is_plane:
            return poses, OrientedBoxes.of_packed(packed, poses[:, 3])
        flat = OrientedBoxes.of_packed(packed[moved], poses[moved, 3])
        poses[moved, 2] = environment.ground_heights_m(flat)
        return poses, OrientedBoxes.standing(poses, self._shapes)

    def with_poses(
        self, poses: _Floats, which: npt.NDArray[np.intp], others: _Floats
    ) -> tuple[_Floats, OrientedBoxes]:
        """Return poses (N, 4), and the boxes there, where those of some are `others` (M, 4)."""
        poses = poses.copy()
        poses[which] = others
        return poses, OrientedBoxes.standing(poses, self._shapes)

    def move(self, poses: _Floats, boxes: OrientedBoxes | None = None) -> None:
        """Let all be at `poses` (N, 4), and their boxes be `boxes` where these are known."""
        self.poses, self._boxes = poses, boxes or OrientedBoxes.standing(poses, self._shapes)
        self._packed = self._boxes.packed
        self.ends, self._end_boxes = poses, self._boxes

    def put(self, artefact_ids: Sequence[int], poses: Sequence[GroundPose]) -> None:
        """Let some be elsewhere."""
        moved = self.poses.copy()
        for artefact_id, pose in zip(artefact_ids, poses, strict=True):
            moved[self.index_of(artefact_id)] = pose
        self.move(moved)
