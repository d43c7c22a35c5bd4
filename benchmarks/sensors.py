"""Augmented sensors and octomap against numpy and against doing it all anew, side by side.

    python benchmarks/sensors.py [repetitions] [octomap.bt]

- A scan of 360 beams among 100 artefacts, boxes, against slab tests of all beams and all boxes at
  once in numpy (float64, no loop).
- A cloud of 500,000 points with nothing near, against a copy of its bytes; the reading goes through
  `augmented`, as it does when a message came. And with 20 persons around.
- The octomap with one more artefact of about 1,000 voxels, against building the voxel map of all
  centres anew; with the octomap of a file, if one is given, beside a made-up hall.

One thread. Medians of interleaved runs, and their ratio.
"""

import argparse
import math
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
import numpy.typing as npt

from are_ros.builder.costmap.augmented_octomap import box_triangles, surface_voxels, unpacked
from are_ros.builder.occlusion.meshes import MeshSelection
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.builder.sensors.point_cloud import CloudField, PointCloud
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_files.octomap import read_voxel_file
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]
LASER = RigidTransform.planar(0.0, 0.0, 0.3, 0.3)


def crowd(count: int, nearest_m: float) -> OrientedBoxes:
    """Return persons around the origin, on the floor, in their boxes."""
    generator = np.random.default_rng(count)
    ranges_m = generator.uniform(nearest_m, nearest_m + 8.0, count)
    bearings = generator.uniform(-math.pi, math.pi, count)
    x, y = ranges_m * np.cos(bearings), ranges_m * np.sin(bearings)
    centres_m = np.column_stack((x, y, np.full(count, 0.9)))
    halves_m = np.tile((0.25, 0.25, 0.9), (count, 1))
    return OrientedBoxes(centres_m, generator.uniform(-3.1, 3.1, count), halves_m)


def obstacles(boxes: OrientedBoxes) -> Obstacles:
    """Return the boxes as what sensors meet, with no walls."""
    return Obstacles(boxes, MeshSelection.boxes_only(len(boxes)), None)


def scan() -> LaserScan:
    """Return a scan of 360 beams, walls all around at 9 m."""
    ranges, none = np.full(360, 9.0, np.float32), np.empty(0, np.float32)
    step = 2.0 * math.pi / 360
    return LaserScan("laser", 0, -math.pi, math.pi - step, step, 0.0, 0.1, 0.05, 12.0, ranges, none)


def scan_by_numpy(reading: LaserScan, boxes: OrientedBoxes) -> npt.NDArray[np.float32]:
    """Return the ranges by slabs of all beams (B,) and all boxes (N,) at once."""
    angles = reading.angle_min_rad + reading.angle_increment_rad * np.arange(360) + LASER.yaw_rad()
    rays = np.stack((np.cos(angles), np.sin(angles), np.zeros(360)), axis=1)
    cosine, sine = boxes.packed[:, 3:5].T
    dx, dy, dz = (LASER.translation_m - boxes.packed[:, :3]).T
    starts = np.stack((dx * cosine + dy * sine, dy * cosine - dx * sine, dz), axis=1)
    ways = np.stack(
        (
            np.outer(rays[:, 0], cosine) + np.outer(rays[:, 1], sine),
            np.outer(rays[:, 1], cosine) - np.outer(rays[:, 0], sine),
            np.repeat(rays[:, 2:], len(boxes), axis=1),
        ),
        axis=2,
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / ways
        a = (-boxes.half_sizes_m - starts) * inverse
        b = (boxes.half_sizes_m - starts) * inverse
    near = np.nanmax(np.minimum(a, b), axis=2)
    far = np.nanmin(np.maximum(a, b), axis=2)
    hits = np.where((near <= far) & (near >= 0.0), near, np.inf).min(axis=1)
    nearest: npt.NDArray[np.float32] = np.minimum(reading.ranges, hits).astype(np.float32)
    return nearest


def cloud(count: int) -> PointCloud:
    """Return points of a lidar 6 to 12 m around, with an intensity: 16 bytes each."""
    generator = np.random.default_rng(1)
    ways = generator.normal(size=(count, 3)) * (1.0, 1.0, 0.15)
    ways *= (generator.uniform(6.0, 12.0, count) / np.linalg.norm(ways, axis=1))[:, None]
    numbers = np.column_stack((ways, np.ones(count))).astype("<f4")
    names = ("x", "y", "z", "intensity")
    fields = tuple(CloudField(name, 4 * k, 7) for k, name in enumerate(names))
    data = numbers.view(np.uint8).reshape(1, -1)
    return PointCloud("laser", 0, fields, False, True, count, 16, data)


def hall() -> Floats:
    """Return the voxel centres of 20 x 15 m of floor and walls, 0.05 m each."""
    occupied = np.zeros((400, 300, 50), np.bool_)
    occupied[:, :, 0] = True
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    occupied[100:300:40, 50:250] = True
    return np.asarray((np.argwhere(occupied) + 0.5) * 0.05, np.float64)


def milliseconds(action: Callable[[], object]) -> float:
    """Return how long one call takes [ms]."""
    start = time.perf_counter()
    action()
    return 1e3 * (time.perf_counter() - start)


def compare(name: str, ours: Callable[[], object], peer: Callable[[], object], runs: int) -> None:
    """Print the medians of interleaved runs, and their ratio."""
    ours()
    times = [(milliseconds(ours), milliseconds(peer)) for _ in range(runs)]
    mine, theirs = median(t for t, _ in times), median(t for _, t in times)
    print(f"{name:<58}{mine:9.3f} ms {theirs:10.3f} ms {theirs / mine:8.2f}x")


def scans(runs: int) -> None:
    """Compare scans, after showing that both give the same."""
    reading, boxes = scan(), crowd(100, 1.0)
    there = obstacles(boxes)
    ours = reading.augmented(LASER, there).ranges
    apart_m = float(np.abs(ours - scan_by_numpy(reading, boxes)).max())
    print(f"{np.count_nonzero(ours < 9.0)} of 360 beams end nearer; at most {apart_m:.1e} m apart")
    compare(
        "scan, 360 beams, 100 artefacts, against numpy",
        lambda: reading.augmented(LASER, there),
        lambda: scan_by_numpy(reading, boxes),
        runs,
    )


def clouds(runs: int) -> None:
    """Compare clouds with copies of their bytes; with artefacts this is no race, but a figure."""
    reading = cloud(500_000)
    for text, boxes in (("nothing near", crowd(20, 40.0)), ("20 persons around", crowd(20, 2.0))):
        there = obstacles(boxes)
        compare(
            f"cloud, 500,000 points, {text}, against a copy",
            lambda there=there: reading.augmented(LASER, there),  # type: ignore[misc]
            reading.data.copy,
            runs,
        )


def octomaps(title: str, centres_m: npt.NDArray[np.floating], runs: int) -> None:
    """Compare one more artefact with all voxels anew."""
    here = RigidTransform.identity()
    voxels = VoxelMap.from_centres(centres_m, None, here)
    low_m, high_m = voxels.bounds_m()
    size_m = voxels.voxel_size_m[0]
    half_m = size_m * math.sqrt(1000 / 24)  # six faces of (2 half / size)^2 voxels
    at_m = 0.5 * (low_m + high_m)
    box = np.array((*at_m, math.cos(0.4), math.sin(0.4), half_m, half_m, half_m))
    triangles = box_triangles(box[5:])
    count = len(unpacked(surface_voxels(box, triangles, voxels)))
    compare(
        f"octomap of {title}: {voxels.occupied_count} voxels, {count} more",
        lambda: surface_voxels(box, triangles, voxels),
        lambda: VoxelMap.from_centres(centres_m, None, here),
        runs,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("repetitions", nargs="?", type=int, default=15)
    parser.add_argument("octomap", nargs="?", type=Path)
    given = parser.parse_args()
    scans(given.repetitions)
    clouds(given.repetitions)
    octomaps("a hall", hall().astype(np.float32), given.repetitions)
    if given.octomap:
        octomaps("the file", read_voxel_file(given.octomap, None)[0], given.repetitions)
