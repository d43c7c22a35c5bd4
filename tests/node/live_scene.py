"""What a robot in a small room says, as messages of rclpy; times in seconds, metres, radians."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.conventions import NS_PER_S
from are_ros.messages.goals import StampedPoints
from are_ros.messages.transforms import StampedTransform
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.making import (
    OdometryReading,
    make_clicked_point,
    make_cloud,
    make_grid,
    make_header,
    make_odometry,
    make_path,
    make_pose,
    make_scan,
    make_transforms,
)
from tests.node.rclpy_factory import RclpyFactory

FACTORY: Final = RclpyFactory()
SIDE: Final = 40
CATALOGUE: Final = """
classes:
  thing: {shape: crate}
  part: {shape: crate}
rows:
  - {label: post, class: thing, size_m: [0.4, 0.4, 1.6]}
  - {label: crate, class: thing, size_m: [0.6, 0.3, 0.3]}
  - {label: pillar, class: part, size_m: [0.3, 0.3, 2.2], forever: true}
"""
QUIET: Final = {
    "population.arrival_rate": 0.0,
    "mixture.weights": [1.0],
    "mixture.rates": [0.5],
    "robot.radius": 0.2,
    "robot.clearance": 0.1,
    "camera.model": "pinhole",
    "camera.width": 64,
    "camera.height": 48,
    "occlusion.tau": 0,
    "occlusion.shape": "box",
    "sensors.shape": "box",
    "markers.shape": "box",
    "augmented_map.max_rate": 10.0,
}
"""Nobody arrives by chance; a small camera on the robot sees whatever shows in a pixel."""


def write_catalogue(folder: Path) -> Path:
    """Write the catalogue of three boxes, and return its path."""
    path = folder / "catalogue.yaml"
    path.write_text(CATALOGUE, encoding="utf-8")
    return path


def ns(t_s: float) -> int:
    """Return a time in nanoseconds."""
    return round(t_s * NS_PER_S)


def room(*blocks: tuple[int, int, int, int], frame_id: str = "map", stamp_s: float = 0.0) -> Any:
    """Return a map: free cells of 0.1 m from (0, 0) within walls one cell thick, 4 x 4 m.

    `blocks` are more occupied cells: row0, row1, col0, col1, half-open.
    """
    cells = np.zeros((SIDE, SIDE), dtype=np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    for row0, row1, col0, col1 in blocks:
        cells[row0:row1, col0:col1] = 100
    grid = OccupancyGrid(cells, 0.1, RigidTransform.identity(), frame_id, ns(stamp_s))
    return make_grid(FACTORY, grid)


def transforms(*edges: tuple[str, str, float, tuple[float, float, float], float]) -> Any:
    """Return a TFMessage of (parent, child, stamp, x y z, yaw)."""
    return make_transforms(
        FACTORY,
        [
            StampedTransform(parent, child, ns(t_s), at, (0.0, 0.0, *_half_turn(yaw)))
            for parent, child, t_s, at, yaw in edges
        ],
    )


def robot_at(t_s: float, x: float = 1.0, y: float = 2.0, yaw: float = 0.0) -> Any:
    """Return the TFMessage of the robot's pose in the map."""
    return transforms(("map", "base_link", t_s, (x, y, 0.0), yaw))


def laser_mount() -> Any:
    """Return the TFMessage of where the laser is: 0.3 m above the base."""
    return transforms(("base_link", "laser", 0.0, (0.0, 0.0, 0.3), 0.0))


def odometry(t_s: float, x: float, y: float, child: str = "base_link") -> Any:
    """Return an Odometry of the robot in `odom`."""
    pose, rest = RigidTransform.planar(x, y, 0.0), (0.0, 0.0, 0.0)
    return make_odometry(FACTORY, OdometryReading("odom", child, ns(t_s), pose, rest, rest))


def scan(t_s: float, range_m: float = 3.5, beams: int = 90, frame_id: str = "laser") -> Any:
    """Return a LaserScan of a whole turn from straight behind, the same range everywhere."""
    step = 2.0 * math.pi / beams
    ranges = np.full(beams, range_m, dtype=np.float32)
    none = np.empty(0, dtype=np.float32)
    angles = -math.pi, math.pi - step, step
    return make_scan(
        FACTORY, LaserScan(frame_id, ns(t_s), *angles, 0.0, 0.1, 0.05, 10.0, ranges, none)
    )


def sonar(t_s: float, range_m: float = 3.5) -> Any:
    """Return a Range of a sonar where the laser is."""
    return FACTORY.make(
        "sensor_msgs/msg/Range",
        header=make_header(FACTORY, "laser", ns(t_s)),
        radiation_type=0,
        field_of_view=0.3,
        min_range=0.05,
        max_range=10.0,
        range=range_m,
        variance=0.0,
    )


def cloud(centres_m: Sequence[tuple[float, float, float]], frame_id: str = "map") -> Any:
    """Return a PointCloud2 of voxel centres."""
    return make_cloud(FACTORY, frame_id, 0, np.array(centres_m, dtype=np.float32))


def wall_voxels(x: float = 3.05) -> list[tuple[float, float, float]]:
    """Return the centres of a wall of voxels of 0.1 m across the room, 1 m high."""
    return [(x, 0.05 + 0.1 * j, 0.05 + 0.1 * k) for j in range(40) for k in range(10)]


def path_to(x: float, y: float, frame_id: str = "map") -> Any:
    """Return a Path of two poses."""
    return make_path(FACTORY, StampedPoints(frame_id, 0, np.array([[1.0, 2.0, 0.0], [x, y, 0.0]])))


def click_at(x: float, y: float, frame_id: str = "map") -> Any:
    """Return the PointStamped of a click."""
    return make_clicked_point(FACTORY, StampedPoints(frame_id, 0, np.array([[x, y, 0.0]])))


def pose_at(x: float, y: float, yaw: float = 0.0, frame_id: str = "map") -> Any:
    """Return a PoseStamped."""
    header = make_header(FACTORY, frame_id, 0)
    pose = make_pose(FACTORY, RigidTransform.planar(x, y, yaw))
    return FACTORY.make("geometry_msgs/msg/PoseStamped", header=header, pose=pose)


def camera_info(t_s: float, width: int = 64, height: int = 48, frame_id: str = "camera") -> Any:
    """Return the CameraInfo of a pinhole of 90 degrees without distortion."""
    f, cx, cy = width / 2, width / 2, height / 2
    return FACTORY.make(
        "sensor_msgs/msg/CameraInfo",
        header=make_header(FACTORY, frame_id, ns(t_s)),
        width=width,
        height=height,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array([f, 0, cx, 0, f, cy, 0, 0, 1.0]),
        r=np.eye(3).reshape(-1),
        p=np.array([f, 0, cx, 0, 0, f, cy, 0, 0, 0, 1.0, 0]),
    )


def _half_turn(yaw: float) -> tuple[float, float]:
    return math.sin(yaw / 2), math.cos(yaw / 2)
