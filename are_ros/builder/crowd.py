"""The artefacts alive as arrays in the order of their ids: shapes, poses on the ground, boxes."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.artefact import GroundPose
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.parameters.choices import GroundKind
from are_ros.world.environment import Environment
from are_ros.world.oriented_boxes import OrientedBoxes

_Floats = npt.NDArray[np.float64]


class Crowd:
    """N artefacts, in the order of their ids.

    `ids` int64 (N,), ascending; `poses` float64 (N, 4), x, y, z, yaw in the map; `radii_m` float64
    (N,), of the circles about (x, y) that hold the boxes. All are replaced, never written into, so
    that what was taken stays what it was.
    """

    def __init__(self, ground: GroundKind) -> None:
        self._is_plane = ground is GroundKind.PLANE
        self.clear()

    def clear(self) -> None:
        """Let nobody be there."""
        self.ids = np.empty(0, np.int64)
        self.poses = np.empty((0, 4))
        self._half_sizes_m = np.empty((0, 3))
        self._offsets_m = np.empty((0, 2))
        self.radii_m = np.empty(0)
        self._boxes: OrientedBoxes | None = None

    def add(self, artefact_id: int, row: CatalogueRow, pose: GroundPose) -> None:
        """Let one more be there, of an id that is none of those alive."""
        at = int(np.searchsorted(self.ids, artefact_id))
        self.ids = np.insert(self.ids, at, artefact_id)
        self.poses = np.insert(self.poses, at, pose, axis=0)
        self._half_sizes_m = np.insert(self._half_sizes_m, at, 0.5 * np.array(row.size_m), axis=0)
        offset = row.box_centre_in_artefact_m[:2]
        self._offsets_m = np.insert(self._offsets_m, at, offset, axis=0)
        half_x_m, half_y_m = (0.5 * row.size_m[k] + abs(offset[k]) for k in range(2))
        self.radii_m = np.insert(self.radii_m, at, np.hypot(half_x_m, half_y_m))
        self._boxes = None  # the next member of a group keeps clear of this one

    def remove(self, artefact_id: int) -> None:
        """Let one be gone."""
        at = self.index_of(artefact_id)
        self.ids = np.delete(self.ids, at)
        self.poses = np.delete(self.poses, at, axis=0)
        self._half_sizes_m = np.delete(self._half_sizes_m, at, axis=0)
        self._offsets_m = np.delete(self._offsets_m, at, axis=0)
        self.radii_m = np.delete(self.radii_m, at)
        self._boxes = None

    def index_of(self, artefact_id: int) -> int:
        """Return where in the arrays an artefact stands that is there."""
        return int(np.searchsorted(self.ids, artefact_id))

    @property
    def boxes(self) -> OrientedBoxes:
        """The boxes (N) where they are; the same object while nobody comes, goes or moves."""
        if self._boxes is None:
            self._boxes = self._boxes_at(self.poses)
        return self._boxes

    def proposed(
        self, planar: _Floats, moved: npt.NDArray[np.bool_], environment: Environment
    ) -> tuple[_Floats, OrientedBoxes]:
        """Return the poses (N, 4) and boxes if those `moved` (N,) were at `planar` (N, 3)."""
        if not moved.any():
            return self.poses, self.boxes
        poses = self.poses.copy()
        poses[moved, :2], poses[moved, 3] = planar[moved, :2], planar[moved, 2]
        boxes = self._boxes_at(poses)
        if self._is_plane:
            return poses, boxes
        poses[moved, 2] = environment.ground_heights_m(boxes.take(moved))
        return poses, self._boxes_at(poses)

    def with_poses(
        self, poses: _Floats, which: npt.NDArray[np.intp], others: _Floats
    ) -> tuple[_Floats, OrientedBoxes]:
        """Return poses (N, 4), and the boxes there, where those of some are `others` (M, 4)."""
        poses = poses.copy()
        poses[which] = others
        return poses, self._boxes_at(poses)

    def move(self, poses: _Floats, boxes: OrientedBoxes | None = None) -> None:
        """Let all be at `poses` (N, 4), and their boxes be `boxes` where these are known."""
        self.poses, self._boxes = poses, boxes

    def put(self, artefact_ids: Sequence[int], poses: Sequence[GroundPose]) -> None:
        """Let some be elsewhere."""
        moved = self.poses.copy()
        for artefact_id, pose in zip(artefact_ids, poses, strict=True):
            moved[self.index_of(artefact_id)] = pose
        self.move(moved)

    def _boxes_at(self, poses: _Floats) -> OrientedBoxes:
        cos, sin = np.cos(poses[:, 3]), np.sin(poses[:, 3])
        x, y = self._offsets_m[:, 0], self._offsets_m[:, 1]
        centres_m = np.empty((len(poses), 3))
        centres_m[:, 0] = poses[:, 0] + cos * x - sin * y
        centres_m[:, 1] = poses[:, 1] + sin * x + cos * y
        centres_m[:, 2] = poses[:, 2] + self._half_sizes_m[:, 2]
        return OrientedBoxes(centres_m, poses[:, 3], self._half_sizes_m)
