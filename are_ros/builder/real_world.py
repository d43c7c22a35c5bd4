"""The real environment as it arrives, kept up to date: M2D, M3D and the ground (section 3.1)."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.errors import FrameError, InputError
from are_ros.parameters.choices import GroundKind
from are_ros.parameters.model import WorldParameters
from are_ros.world.environment import Environment, Ground, PlaneGround, VoxelGround
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.transforms.tree import FrameTree
from are_ros.world.voxel_map import VoxelMap

_FLOOR_MARGIN_M = 0.01


@dataclass(frozen=True, eq=False)
class _Cloud:
    centres_m: npt.NDArray[np.floating]
    voxel_size_m: float | None
    frame_id: str
    stamp_ns: int | None = None


class RealWorld:
    """Holds the newest map and cloud, and makes an `Environment` of them when one changed.

    The environment is in the map's frame F_E. Without a cloud the walls of the map are extruded.
    `notices` takes a sentence where a cloud that waited for its pose turns out to be useless, and
    where a map has no free cell or no voxel of the cloud lies in it, once until that is mended.
    `dropped` is the last sentence about a cloud that was useless, empty if there was none.
    """

    def __init__(
        self,
        parameters: WorldParameters,
        map_frame: str,
        frames: FrameTree,
        notices: list[str] | None = None,
    ) -> None:
        self.environment: Environment | None = None
        self.grid: OccupancyGrid | None = None
        """The newest map, None before the first."""
        self.notices: list[str] = [] if notices is None else notices
        self.dropped = ""
        self._parameters = parameters
        self._map_frame = map_frame
        self._frames = frames
        self._voxels: VoxelMap | None = None
        self._last_cloud: _Cloud | None = None
        self._pending_cloud: _Cloud | None = None
        self._map_from_cloud: RigidTransform | None = None
        self._coarsened_m: float | None = None
        self._is_apart = False

    @property
    def has_free_cells(self) -> bool:
        """Whether there is a map with a free cell: without one no artefact can arrive."""
        return self.environment is not None and bool(self.environment.classes.free.any())

    def set_grid(self, grid: OccupancyGrid) -> None:
        """Take a map; one equal to the last changes nothing but its stamp."""
        if self.grid is None or not self.grid.is_same_map(grid):
            had_room = self.has_free_cells
            self.environment = self._built(grid, self._voxels)
            self._note_apart(grid, self._voxels)
            if not self.has_free_cells and (had_room or self.grid is None):
                self.notices.append(self._no_free_cell(grid))
        self.grid = grid

    def _no_free_cell(self, grid: OccupancyGrid) -> str:
        unknown = np.count_nonzero(grid.cells < 0)
        return (
            f"the map has no free cell, so nobody can arrive: of {grid.cells.size} cells {unknown} "
            f"are unknown, the others above world.free_threshold, {self._parameters.free_threshold}"
        )

    def _note_apart(self, grid: OccupancyGrid, voxels: VoxelMap | None) -> None:
        """Say so if a cloud lies wholly beside the map: it hides nobody then."""
        if voxels is None:
            return
        was_apart = self._is_apart
        corners = np.array([(i * grid.height, j * grid.width) for i in (0, 1) for j in (0, 1)])
        corners_m = grid.cells_to_points(corners - 0.5)
        low_m, high_m = voxels.bounds_m()[:, :2]
        beyond = (corners_m.max(axis=0) < low_m) | (corners_m.min(axis=0) > high_m)
        self._is_apart = bool(beyond.any())
        if self._is_apart and not was_apart:
            (x0_m, y0_m), (x1_m, y1_m) = low_m.tolist(), high_m.tolist()
            self.notices.append(
                f"no voxel of the octomap lies in the map: it is at x {x0_m:.1f} to {x1_m:.1f} m, "
                f"y {y0_m:.1f} to {y1_m:.1f} m of the frame '{self._map_frame}', so that no wall "
                "hides an artefact; is its frame right?"
            )

    def set_cloud(
        self,
        centres_m: npt.NDArray[np.floating],
        voxel_size_m: float | None,
        frame_id: str,
        stamp_ns: int | None = None,
    ) -> None:
        """Take the occupied voxels' centres (N, 3) in `frame_id`; used once its pose is known.

        `voxel_size_m` is their own size, None if it is not known; the map's is world.voxel_size.

        Raises InputError where they make no voxel map; the last good cloud stays then.
        """
        cloud = _Cloud(centres_m, voxel_size_m, frame_id, stamp_ns)
        map_from_cloud = self._map_from(cloud)
        if self._is_known(cloud, map_from_cloud):
            return
        if map_from_cloud is None:
            self._voxels_of(cloud, RigidTransform.identity())
            self._last_cloud = self._pending_cloud = cloud
            return
        self._use_cloud(cloud, map_from_cloud)
        self._last_cloud = cloud

    def _is_known(self, cloud: _Cloud, map_from_cloud: RigidTransform | None) -> bool:
        """Say whether this is the last cloud again, at the same place."""
        if self._last_cloud is None or not _same_cloud(self._last_cloud, cloud):
            return False
        placed = self._map_from_cloud
        if map_from_cloud is None or placed is None:
            return map_from_cloud is None
        return np.array_equal(placed.matrix(), map_from_cloud.matrix())

    def missing_frame(self) -> str:
        """Return the frame of a cloud that waits for its pose, empty if none does."""
        return self._pending_cloud.frame_id if self._pending_cloud else ""

    def retry_cloud(self) -> None:
        """Place the cloud that waits, if its frame is known by now."""
        cloud = self._pending_cloud
        map_from_cloud = self._map_from(cloud) if cloud else None
        if cloud is None or map_from_cloud is None:
            return
        self._pending_cloud = None
        try:
            self._use_cloud(cloud, map_from_cloud)
        except InputError as cause:
            self.dropped = f"the cloud in '{cloud.frame_id}' that waited is dropped: {cause}"
            self.notices.append(self.dropped)

    def _use_cloud(self, cloud: _Cloud, map_from_cloud: RigidTransform) -> None:
        voxels = self._voxels_of(cloud, map_from_cloud)
        if voxels.cloud_voxel_m is not None and voxels.cloud_voxel_m != self._coarsened_m:
            self.notices.append(_said_of_size(voxels, voxels.cloud_voxel_m))
        self._coarsened_m = voxels.cloud_voxel_m
        if self.grid is not None:
            self.environment = self._built(self.grid, voxels)
            self._note_apart(self.grid, voxels)
        self._voxels, self._pending_cloud = voxels, None
        self._map_from_cloud = map_from_cloud

    def _voxels_of(self, cloud: _Cloud, map_from_cloud: RigidTransform) -> VoxelMap:
        wanted_m = self._parameters.voxel_size or None
        return VoxelMap.from_centres(
            cloud.centres_m, cloud.voxel_size_m, map_from_cloud, wanted_m=wanted_m
        )

    def _map_from(self, cloud: _Cloud) -> RigidTransform | None:
        """Return the pose of a cloud's frame in the map's, None if it is not known yet."""
        frame_id = cloud.frame_id
        if frame_id == self._map_frame:
            return RigidTransform.identity()
        if cloud.stamp_ns is not None:
            found = self._frames.try_lookup(self._map_frame, frame_id, cloud.stamp_ns)
            if found is not None:
                return found
        try:
            return self._frames.lookup_latest(self._map_frame, frame_id)
        except FrameError:
            return None

    def _built(self, grid: OccupancyGrid, voxels: VoxelMap | None) -> Environment:
        settings = self._parameters
        classes = classify(grid, settings.occupied_threshold, settings.free_threshold)
        if voxels is None:
            voxels = VoxelMap.extruded(
                grid, classes.occupied, settings.wall_height, settings.ground_height
            )
        version = 0 if self.environment is None else self.environment.version + 1
        return Environment(
            grid, classes, voxels, self._ground(voxels), self._clearance_m(voxels), version
        )

    def _ground(self, voxels: VoxelMap) -> Ground:
        height_m = self._parameters.ground_height
        if self._parameters.ground is GroundKind.VOXELS and not voxels.is_extruded:
            return VoxelGround.from_voxels(voxels, height_m)
        return PlaneGround(height_m)

    def _clearance_m(self, voxels: VoxelMap) -> float:
        """Return how far above the ground a voxel's top may be and still be floor."""
        if self._parameters.ground_clearance > 0.0:
            return self._parameters.ground_clearance
        return _FLOOR_MARGIN_M + (0.0 if voxels.is_extruded else voxels.voxel_size_m[2])


def _said_of_size(voxels: VoxelMap, cloud_voxel_m: float) -> str:
    """Say what became of a cloud's voxels that were made coarser."""
    size_m = voxels.voxel_size_m[0]
    said = (
        f"world.voxel_size: the cloud's voxels of {cloud_voxel_m:g} m become "
        f"{voxels.occupied_count} of {size_m:g} m"
    )
    times = size_m / cloud_voxel_m
    if math.isclose(times, round(times)):
        return said
    return f"{said}; that is no multiple, so that walls are off by up to {cloud_voxel_m / 2:g} m"


def _same_cloud(one: _Cloud, other: _Cloud) -> bool:
    is_same = one.centres_m is other.centres_m or np.array_equal(one.centres_m, other.centres_m)
    return one.frame_id == other.frame_id and is_same
