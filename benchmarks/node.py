"""The whole node beside a robot, against a bare rclpy node that republishes scan and map unchanged.

Both listen to the same topics in one run: a map of 1000 x 1000 cells once a second, 100,000 voxels
latched, tf and odometry at 50 Hz, a scan of 360 beams and a CameraInfo of 640 x 480 at 10 Hz; the
robot drives in a circle. The node has 20 artefacts standing and every output subscribed to; the
bare node is `rclpy.spin` with callbacks that publish what they got. Printed are the processor time
of both, their ratio (aim: at most 2), and how long a scan takes from in to out (aim: the 99th
percentile within one period of the scan beyond sensors.tf_wait).

    .venv/bin/python benchmarks/node.py [--seconds 20]
"""

import argparse
import math
import os
import subprocess
import sys
import time
from array import array
from contextlib import suppress
from pathlib import Path
from typing import Any

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ.setdefault("ROS_DOMAIN_ID", str(41 + os.getpid() % 60))

SIDE, CELL_M = 1000, 0.05
VOXEL_M, VOXELS = 0.1, 100_000
BEAMS, SCAN_HZ, TF_HZ = 360, 10, 50
RADIUS_M, SPEED_MPS = 3.0, 0.4
ARTEFACTS = 20
NODE = [sys.executable, "-m", "are_ros", "node", "--set", "population.arrival_rate:=0.0"]
BARE = [sys.executable, __file__, "--bare"]
TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def run_bare() -> None:
    """Be the peer: subscribe to everything, republish scan and map."""
    import rclpy
    from geometry_msgs.msg import PointStamped
    from nav_msgs.msg import OccupancyGrid, Odometry
    from nav_msgs.msg import Path as Plan
    from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
    from sensor_msgs.msg import CameraInfo, LaserScan, PointCloud2
    from tf2_msgs.msg import TFMessage

    rclpy.init()
    node = rclpy.create_node("bare")
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    grids = node.create_publisher(OccupancyGrid, "~/augmented_map", latched)
    scans = node.create_publisher(LaserScan, "~/scan", 10)
    for kind, topic, take, qos in (
        (OccupancyGrid, "map", grids.publish, latched),
        (LaserScan, "scan", scans.publish, qos_profile_sensor_data),
        (PointCloud2, "octomap_point_cloud_centers", _ignore, latched),
        (Odometry, "odom", _ignore, qos_profile_sensor_data),
        (CameraInfo, "camera/camera_info", _ignore, qos_profile_sensor_data),
        (TFMessage, "/tf", _ignore, 100),
        (TFMessage, "/tf_static", _ignore, latched),
        (Plan, "plan", _ignore, 10),
        (PointStamped, "clicked_point", _ignore, 10),
    ):
        node.create_subscription(kind, topic, take, qos)
    with suppress(rclpy.executors.ExternalShutdownException):
        rclpy.spin(node)


def _ignore(message: Any) -> None:
    del message


class Robot:
    """Publishes what a robot would, and notes how long scans take to come back."""

    def __init__(self, context: Any) -> None:
        import rclpy
        from nav_msgs.msg import OccupancyGrid, Odometry
        from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
        from sensor_msgs.msg import CameraInfo, LaserScan, PointCloud2
        from tf2_msgs.msg import TFMessage

        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.node = node = rclpy.create_node("robot", context=context)
        self.map = node.create_publisher(OccupancyGrid, "map", latched)
        self.cloud = node.create_publisher(PointCloud2, "octomap_point_cloud_centers", latched)
        self.odom = node.create_publisher(Odometry, "odom", 10)
        self.scan = node.create_publisher(LaserScan, "scan", qos_profile_sensor_data)
        self.camera = node.create_publisher(
            CameraInfo, "camera/camera_info", qos_profile_sensor_data
        )
        self.tf = node.create_publisher(TFMessage, "/tf", 100)
        self.tf_static = node.create_publisher(TFMessage, "/tf_static", latched)
        self.number = -1
        self.sent_s: dict[int, float] = {}
        self.latencies_s: dict[str, list[float]] = {"bare": [], "ar_builder": []}
        for name in self.latencies_s:
            node.create_subscription(LaserScan, f"/{name}/scan", self._noting(name), 10)
        self._messages = _messages()

    def _noting(self, name: str) -> Any:
        def note(scan: Any) -> None:
            came_s = time.perf_counter()
            sent_s = self.sent_s.get(scan.header.stamp.nanosec)
            if sent_s is not None:
                self.latencies_s[name].append(came_s - sent_s)

        return note

    def start(self) -> None:
        """Publish what is published once."""
        self.cloud.publish(self._messages["cloud"])
        self.tf_static.publish(self._messages["static"])

    def turn(self, number: int) -> None:
        """Publish what is due in the `number`-th fiftieth of a second."""
        stamp = self.node.get_clock().now().to_msg()
        angle = SPEED_MPS / RADIUS_M * number / TF_HZ
        transforms, odometry = self._messages["tf"], self._messages["odom"]
        for one in transforms.transforms:
            one.header.stamp = stamp
        pose = transforms.transforms[1].transform
        pose.translation.x, pose.translation.y = (
            RADIUS_M * math.cos(angle),
            RADIUS_M * math.sin(angle),
        )
        heading = angle + math.pi / 2
        pose.rotation.z, pose.rotation.w = math.sin(heading / 2), math.cos(heading / 2)
        odometry.header.stamp = stamp
        odometry.pose.pose.position.x = pose.translation.x
        odometry.pose.pose.position.y = pose.translation.y
        odometry.pose.pose.orientation = pose.rotation
        self.tf.publish(transforms)
        self.odom.publish(odometry)
        if number % (TF_HZ // SCAN_HZ) == 0:
            for publisher, name in ((self.camera, "camera"), (self.scan, "scan")):
                self._messages[name].header.stamp = stamp
                publisher.publish(self._messages[name])
            self.sent_s[stamp.nanosec] = time.perf_counter()
        if number % TF_HZ == 0:
            self._messages["map"].header.stamp = stamp
            self.map.publish(self._messages["map"])


def _messages() -> dict[str, Any]:
    """Return the messages of the robot, complete but for stamps and poses."""
    import numpy as np
    from geometry_msgs.msg import TransformStamped
    from nav_msgs.msg import OccupancyGrid, Odometry
    from sensor_msgs.msg import CameraInfo, LaserScan, PointCloud2, PointField
    from tf2_msgs.msg import TFMessage

    cells = np.zeros((SIDE, SIDE), dtype=np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    cells[300:700:40, 300:700:40] = 100
    grid = OccupancyGrid(data=array("b", cells.tobytes()))
    grid.header.frame_id, grid.info.resolution = "map", CELL_M
    grid.info.width = grid.info.height = SIDE
    grid.info.origin.position.x = grid.info.origin.position.y = -SIDE * CELL_M / 2
    points = _walls(np.random.default_rng(0)).astype(np.float32)
    cloud = PointCloud2(height=1, width=len(points), point_step=12, row_step=12 * len(points))
    cloud.header.frame_id = "map"
    cloud.fields = [
        PointField(name=name, offset=4 * i, datatype=7, count=1) for i, name in enumerate("xyz")
    ]
    cloud.data = array("B", points.tobytes())
    scan = LaserScan(angle_min=-math.pi, angle_max=math.pi * (1 - 2 / BEAMS), range_max=12.0)
    scan.angle_increment, scan.range_min, scan.header.frame_id = 2 * math.pi / BEAMS, 0.1, "laser"
    scan.ranges = array("f", [8.0] * BEAMS)
    camera = CameraInfo(width=640, height=480, distortion_model="plumb_bob", d=[0.0] * 5)
    camera.header.frame_id = "camera"
    camera.k = [320.0, 0.0, 320.0, 0.0, 320.0, 240.0, 0.0, 0.0, 1.0]
    camera.p = [320.0, 0.0, 320.0, 0.0, 0.0, 320.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    camera.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    odometry = Odometry(child_frame_id="base_link")
    odometry.header.frame_id = "odom"
    moving = [
        _edge(TransformStamped(), "map", "odom"),
        _edge(TransformStamped(), "odom", "base_link"),
    ]
    fixed = [_edge(TransformStamped(), "base_link", "laser", 0.3)]
    fixed.append(_edge(TransformStamped(), "base_link", "camera", 1.0))
    half = 0.5
    turn = fixed[1].transform.rotation
    turn.x, turn.y, turn.z, turn.w = -half, half, -half, half
    return {
        "map": grid,
        "cloud": cloud,
        "scan": scan,
        "camera": camera,
        "odom": odometry,
        "tf": TFMessage(transforms=moving),
        "static": TFMessage(transforms=fixed),
    }


def _edge(edge: Any, parent: str, child: str, z_m: float = 0.0) -> Any:
    edge.header.frame_id, edge.child_frame_id = parent, child
    edge.transform.translation.z = z_m
    return edge


def _walls(generator: Any) -> Any:
    """Return the centres (N, 3) of voxels: four walls, and clutter under the ceiling."""
    import numpy as np

    side = np.arange(-240, 240) * VOXEL_M + VOXEL_M / 2
    height = np.arange(0, 25) * VOXEL_M + VOXEL_M / 2
    walls = [np.array([(x, y, z) for x in side for z in height]) for y in (side[0], side[-1])]
    walls += [wall[:, [1, 0, 2]] for wall in walls]
    places = np.concatenate(walls)
    rest = VOXELS - len(places)
    lattice = generator.choice(480 * 480 * 8, size=rest, replace=False)
    clutter = np.column_stack((lattice % 480, lattice // 480 % 480, lattice // (480 * 480) + 24))
    return np.concatenate((places, (clutter - (240, 240, 0)) * VOXEL_M + VOXEL_M / 2))


def cpu_s(pid: int) -> float:
    """Return the processor time that a process has taken."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def spawn_artefacts(node: Any, executor: Any) -> None:
    """Let the artefacts stand around the circle."""
    from are_msgs.srv import SpawnArtefact

    client = node.create_client(SpawnArtefact, "/ar_builder/spawn")
    standing, number = 0, 0
    while standing < ARTEFACTS:
        number += 1
        angle = 2.4 * number
        request = SpawnArtefact.Request(label="person", row=-1)
        request.life.sec = 100_000
        request.pose.header.frame_id = "map"
        radius_m = 5.0 + 0.05 * number
        request.pose.pose.position.x = radius_m * math.cos(angle)
        request.pose.pose.position.y = radius_m * math.sin(angle)
        request.pose.pose.orientation.w = 1.0
        future = client.call_async(request)
        executor.spin_until_future_complete(future, timeout_sec=10.0)
        standing += future.result().success


def percentile_ms(values_s: list[float], percent: float) -> float:
    """Return a percentile by nearest rank."""
    ordered = sorted(values_s)
    return 1e3 * ordered[min(len(ordered) - 1, int(percent / 100 * len(ordered)))]


def measure(seconds: float) -> None:
    """Run both beside each other, and print."""
    import rclpy
    from are_msgs.msg import ArtefactArray, ArtefactEvent, PerceivedArtefactArray, SceneMetrics
    from nav_msgs.msg import OccupancyGrid
    from rclpy.executors import SingleThreadedExecutor
    from visualization_msgs.msg import MarkerArray

    processes = {"bare": subprocess.Popen(BARE), "ar_builder": subprocess.Popen(NODE)}
    try:
        rclpy.init()
        robot = Robot(rclpy.utilities.get_default_context())
        executor = SingleThreadedExecutor()
        executor.add_node(robot.node)
        for kind, name in (
            (ArtefactArray, "artefacts"),
            (PerceivedArtefactArray, "perceived"),
            (ArtefactEvent, "events"),
            (SceneMetrics, "metrics"),
            (MarkerArray, "markers"),
            (OccupancyGrid, "augmented_map"),
            (OccupancyGrid, "augmented_costmap"),
        ):
            robot.node.create_subscription(kind, f"/ar_builder/{name}", _ignore, 10, raw=True)
        _drive(robot, executor, 8.0)
        wait_for_node(robot, executor)
        spawn_artefacts(robot.node, executor)
        _drive(robot, executor, 4.0)
        for values in robot.latencies_s.values():
            values.clear()
        before = {name: cpu_s(process.pid) for name, process in processes.items()}
        began_s = time.perf_counter()
        _drive(robot, executor, seconds)
        took_s = time.perf_counter() - began_s
        spent = {name: cpu_s(process.pid) - before[name] for name, process in processes.items()}
    finally:
        for process in processes.values():
            process.terminate()
    for name, cost_s in spent.items():
        latencies_s = robot.latencies_s[name]
        middle_ms, late_ms = percentile_ms(latencies_s, 50), percentile_ms(latencies_s, 99)
        print(
            f"{name:11s} {100 * cost_s / took_s:5.1f} % of a core; {len(latencies_s)} scans, "
            f"p50 {middle_ms:.1f} ms, p99 {late_ms:.1f} ms"
        )
    print(f"ratio of processor time: {spent['ar_builder'] / spent['bare']:.2f} (aim: at most 2)")


def wait_for_node(robot: Robot, executor: Any) -> None:
    """Drive on until the node offers its services and is active."""
    deadline_s = time.monotonic() + 120.0
    while not robot.latencies_s["ar_builder"]:
        if time.monotonic() > deadline_s:
            raise RuntimeError("the node gives no scans")
        _drive(robot, executor, 1.0)


def _drive(robot: Robot, executor: Any, seconds: float) -> None:
    """Publish as the clock says, and take what comes in between."""
    if robot.number < 0:
        robot.number = 0
        robot.start()
    end_s = time.perf_counter() + seconds
    next_s = time.perf_counter()
    while next_s < end_s:
        robot.turn(robot.number)
        robot.number += 1
        next_s += 1 / TF_HZ
        while (rest_s := next_s - time.perf_counter()) > 0:
            executor.spin_once(timeout_sec=rest_s)


def main() -> None:
    """Measure, or be the peer."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--bare", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    run_bare() if options.bare else measure(options.seconds)


if __name__ == "__main__":
    main()
