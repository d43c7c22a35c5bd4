"""The map and the octomap that come from files beside the recording."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from are_ros.builder.ar_builder import ArBuilder
from are_ros.errors import InputError, MapError
from are_ros.replay.options import ReplayOptions
from are_ros.world.map_file import read_map_file
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.octomap_file import read_octomap_file


@dataclass(frozen=True, eq=False)
class MapFiles:
    """What was read of the files, None where there is none, both in the map's frame.

    The cloud is the centres (N, 3) of the occupied voxels [m] and the size of a voxel [m], from
    `octomap_file`.
    """

    grid: OccupancyGrid | None
    cloud: tuple[npt.NDArray[np.floating], float] | None
    octomap_file: Path | None = None

    @classmethod
    def read(cls, options: ReplayOptions) -> "MapFiles":
        """Read the files that the options name; MapError if one cannot be."""
        frame_id = options.parameters.frames.map
        return cls(
            None if options.map_file is None else read_map_file(options.map_file, frame_id),
            None if options.octomap_file is None else read_octomap_file(options.octomap_file),
            options.octomap_file,
        )

    def feed(self, builder: ArBuilder, now_ns: int) -> None:
        """Give the builder what was read, as received at `now_ns`.

        MapError, naming the file, where the voxels cannot be used.
        """
        if self.grid is not None:
            builder.receive_map(self.grid, now_ns)
        if self.cloud is not None:
            centres_m, voxel_size_m = self.cloud
            frame_id = builder.parameters.frames.map
            try:
                builder.receive_cloud(centres_m, frame_id, now_ns, voxel_size_m)
            except InputError as cause:
                reason = str(cause).removeprefix("voxel cloud: ")
                raise MapError(f"{self.octomap_file}: {reason}") from cause
        builder.prepare()
