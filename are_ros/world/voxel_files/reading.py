"""One reader for all files that M3D may come from."""

from pathlib import Path

from are_ros.world.voxel_files.clouds import Points, read_pcd_file, read_ply_file
from are_ros.world.voxel_files.octomap import read_octomap_file


def read_voxel_file(path: Path, voxel_size_m: float | None) -> tuple[Points, float | None]:
    """Return points (N, 3) [m], float32, in the map's frame, and the size of their voxels [m].

    The name's end tells the format: .pcd, .ply, and an octomap otherwise. The points are the
    centres of occupied voxels if the size is known; it is None for a point cloud, which may have
    any number of points in a voxel. `voxel_size_m` is what a mesh becomes voxels of, None if that
    is not chosen. Raises MapError.
    """
    suffix = path.suffix.lower()
    if suffix == ".ply":
        return read_ply_file(path, voxel_size_m)
    if suffix == ".pcd":
        return read_pcd_file(path), None
    return read_octomap_file(path)
