"""The whole node beside a robot, against a bare rclpy node that republishes scan and map unchanged.

Both listen to the same topics in one run: a map of 1000 x 1000 cells once a second, 100,000 voxels
latched, tf and odometry at 50 Hz, a scan of 360 beams and a CameraInfo of 640 x 480 at 10 Hz; the
robot drives in a circle. The node has 20 artefacts standing and every output subscribed to; the
bare node is `rclpy.spin` with callbacks that publish what they got. Printed are the processor time
of both, their ratio (aim: at most 2), and how long a scan takes from in to out (aim: the 99th
percentile within one period of the scan beyond sensors.tf_wait).

With --sensors there are, besides, a second scan, a cloud of 60,000 points at 10 Hz, and at 16.7 Hz
an image and a depth image of 640 x 480, which both nodes give out again; the artefacts walk (aim:
at most 3). With --empty there are no artefacts: all passes unchanged (aim: at most 1.3).

Messages go through shared memory, by config/fastdds_large_messages.xml.

    .venv/bin/python benchmarks/node.py [--seconds 20] [--sensors] [--empty]
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
from struct import Struct
from typing import Any

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ.setdefault("ROS_DOMAIN_ID", str(41 + os.getpid() % 60))
CONFIG = Path(__file__).resolve().parents[1] / "config"
os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(CONFIG / "fastdds_large_messages.xml"))

SIDE, CELL_M = 1000, 0.05
VOXEL_M, VOXELS = 0.1, 100_000
BEAMS, SCAN_HZ, TF_HZ = 360, 10, 50
RADIUS_M, SPEED_MPS = 3.0, 0.4
ARTEFACTS = 20
POINTS, WIDTH, HEIGHT = 60_000, 640, 480
IMAGES_EVERY = 3
POLL_S = 5e-4
SCANS = {"scan": "LaserScan"}
SENSORS = {
    **SCANS,
    "scan_rear": "LaserScan",
    "points": "PointCloud2",
    "image": "Image",
    "depth": "Image",
}
"""The inputs that both nodes give out again, and their types."""
OUTPUTS = {"image": "camera/image", "depth": "depth/image"}
"""Those of the node that are named otherwise than its inputs."""
NODE = [sys.executable, "-m", "are_ros", "node", "--set", "population.arrival_rate:=0.0"]
SEVERAL_SCANS = ["--set", "sensors.scans:=[scan, scan_rear]"]
BARE = [sys.executable, __file__, "--bare"]
STAMP = Struct("<iI")
TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def run_bare(sensors: dict[str, str]) -> None:
    """Be the peer: subscribe to everything, republish sensors and map."""
    import rclpy
    import sensor_msgs.msg
    from geometry_msgs.msg import PointStamped
    from nav_msgs.msg import OccupancyGrid, Odometry
    from nav_msgs.msg import Path as Plan
    from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
    from sensor_msgs.msg import CameraInfo, PointCloud2
    from tf2_msgs.msg import TFMessage

    rclpy.init()
    node = rclpy.create_node("bare")
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    grids = node.create_publisher(OccupancyGrid, "~/augmented_map", latched)
    for name, type_name in sensors.items():
        kind = getattr(sensor_msgs.msg, type_name)
        publisher = node.create_publisher(kind, f"~/{name}", 10)
        node.create_subscription(kind, name, publisher.publish, qos_profile_sensor_data)
    for kind, topic, take, qos in (
        (OccupancyGrid, "map", grids.publish, latched),
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
    """Publishes what a robot would, and notes how long readings of sensors take to come back."""

    def __init__(self, context: Any, sensors: dict[str, str]) -> None:
        import rclpy
        import sensor_msgs.msg
        from nav_msgs.msg import OccupancyGrid, Odometry
        from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
        from rclpy.serialization import serialize_message
        from sensor_msgs.msg import CameraInfo, PointCloud2
        from tf2_msgs.msg import TFMessage

        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.node = node = rclpy.create_node("robot", context=context)
        self.map = node.create_publisher(OccupancyGrid, "map", latched)
        self.cloud = node.create_publisher(PointCloud2, "octomap_point_cloud_centers", latched)
        self.odom = node.create_publisher(Odometry, "odom", 10)
        self.camera = node.create_publisher(
            CameraInfo, "camera/camera_info", qos_profile_sensor_data
        )
        self.tf = node.create_publisher(TFMessage, "/tf", 100)
        self.tf_static = node.create_publisher(TFMessage, "/tf_static", latched)
        self.info = node.create_publisher(CameraInfo, "camera_info", qos_profile_sensor_data)
        self.number = -1
        self.sent_s: dict[tuple[str, int], float] = {}
        self.latencies_s: dict[tuple[str, str], list[float]] = {}
        self._sensors = {}
        self._taken: list[tuple[Any, Any]] = []
        for name, type_name in sensors.items():
            kind = getattr(sensor_msgs.msg, type_name)
            self._sensors[name] = node.create_publisher(kind, name, qos_profile_sensor_data)
            for who, output in (("bare", name), ("ar_builder", OUTPUTS.get(name, name))):
                self.listen(kind, f"/{who}/{output}", self._noting(who, name))
        self._messages = _messages()
        self._bytes = {name: bytearray(serialize_message(self._messages[name])) for name in sensors}

    def listen(self, kind: Any, topic: str, note: Any) -> None:
        """Let `note` take the bytes of a topic's messages at each `take`."""
        self._taken.append((self.node.create_subscription(kind, topic, note, 10, raw=True), note))

    def take(self) -> None:
        """Take what has come: an executor would spend more time than both nodes together."""
        for subscription, note in self._taken:
            while True:
                with subscription.handle:
                    taken = subscription.handle.take_message(subscription.msg_type, True)
                if taken is None:
                    break
                note(taken[0])

    def _noting(self, who: str, name: str) -> Any:
        times_s = self.latencies_s[who, name] = []

        def note(data: bytes) -> None:
            came_s = time.perf_counter()
            _, nanosec = STAMP.unpack_from(data, 4)  # after the encapsulation
            sent_s = self.sent_s.get((name, nanosec))
            if sent_s is not None:
                times_s.append(came_s - sent_s)

        return note

    def _send(self, names: tuple[str, ...], stamp: Any) -> None:
        """Publish readings of those sensors that there are."""
        for name in names:
            if name in self._sensors:
                data = self._bytes[name]  # large ones are not serialised again and again
                STAMP.pack_into(data, 4, stamp.sec, stamp.nanosec)
                self.sent_s[name, stamp.nanosec] = time.perf_counter()
                self._sensors[name].publish(bytes(data))

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
            self._messages["camera"].header.stamp = stamp
            self.camera.publish(self._messages["camera"])
            self._send(("scan", "scan_rear", "points"), stamp)
        if number % IMAGES_EVERY == 0 and "image" in self._sensors:
            self._messages["camera"].header.stamp = stamp
            self.info.publish(self._messages["camera"])
            self._send(("depth", "image"), stamp)
        if number % TF_HZ == 0:
            self._messages["map"].header.stamp = stamp
            self.map.publish(self._messages["map"])


def _messages() -> dict[str, Any]:
    """Return the messages of the robot, complete but for stamps and poses."""
    import numpy as np
    from geometry_msgs.msg import TransformStamped
    from nav_msgs.msg import OccupancyGrid, Odometry
    from sensor_msgs.msg import CameraInfo, Image, LaserScan, PointCloud2, PointField
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
    generator = np.random.default_rng(1)
    angles = np.arange(POINTS) // 16 * (16 * 2 * math.pi / POINTS)
    up = np.radians(np.arange(POINTS) % 16 * 2.0 - 15.0)
    flat_m = 7.0 * np.cos(up)
    ring = np.column_stack((flat_m * np.cos(angles), flat_m * np.sin(angles), 7.0 * np.sin(up)))
    ring = np.column_stack((ring, np.ones(POINTS))).astype(np.float32)
    lidar = PointCloud2(height=1, width=POINTS, point_step=16, row_step=16 * POINTS)
    lidar.header.frame_id = "laser"
    lidar.fields = [
        PointField(name=name, offset=4 * i, datatype=7, count=1)
        for i, name in enumerate(("x", "y", "z", "intensity"))
    ]
    lidar.data = array("B", ring.tobytes())
    image = Image(width=WIDTH, height=HEIGHT, encoding="rgb8", step=3 * WIDTH)
    image.data = array("B", generator.integers(90, 140, 3 * WIDTH * HEIGHT, np.uint8).tobytes())
    depth = Image(width=WIDTH, height=HEIGHT, encoding="16UC1", step=2 * WIDTH)
    depth.data = array("B", np.full(WIDTH * HEIGHT, 7000, "<u2").tobytes())
    image.header.frame_id = depth.header.frame_id = "camera"
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
        "scan_rear": scan,
        "points": lidar,
        "image": image,
        "depth": depth,
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


def spawn_artefacts(node: Any, executor: Any, behaviour: str) -> None:
    """Let the artefacts stand around the circle, or begin to walk there."""
    from are_msgs.srv import SpawnArtefact

    client = node.create_client(SpawnArtefact, "/ar_builder/spawn")
    standing, number = 0, 0
    while standing < ARTEFACTS:
        number += 1
        angle = 2.4 * number
        request = SpawnArtefact.Request(label="person", row=-1, behaviour=behaviour)
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
    if not values_s:
        return math.nan
    ordered = sorted(values_s)
    return 1e3 * ordered[min(len(ordered) - 1, int(percent / 100 * len(ordered)))]


def measure(seconds: float, sensors: dict[str, str], artefacts: str | None) -> None:
    """Run both beside each other, and print; `artefacts` is their behaviour, if there are any."""
    import rclpy
    from are_msgs.msg import ArtefactArray, ArtefactEvent, PerceivedArtefactArray, SceneMetrics
    from nav_msgs.msg import OccupancyGrid
    from rclpy.executors import SingleThreadedExecutor
    from visualization_msgs.msg import MarkerArray

    several = len(sensors) > 1
    bare, node = [*BARE, *["--sensors"] * several], [*NODE, *SEVERAL_SCANS * several]
    processes = {"bare": subprocess.Popen(bare), "ar_builder": subprocess.Popen(node)}
    try:
        rclpy.init()
        robot = Robot(rclpy.utilities.get_default_context(), sensors)
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
            robot.listen(kind, f"/ar_builder/{name}", _ignore)
        _drive(robot, 8.0)
        wait_for_node(robot)
        if artefacts is not None:
            spawn_artefacts(robot.node, executor, artefacts)
        _drive(robot, 4.0)
        for values in robot.latencies_s.values():
            values.clear()
        before = {name: cpu_s(process.pid) for name, process in processes.items()}
        began_s = time.perf_counter()
        _drive(robot, seconds)
        took_s = time.perf_counter() - began_s
        spent = {name: cpu_s(process.pid) - before[name] for name, process in processes.items()}
    finally:
        for process in processes.values():
            process.terminate()
    for who, cost_s in spent.items():
        print(f"{who:11s} {100 * cost_s / took_s:5.1f} % of a core")
        for name in sensors:
            latencies_s = robot.latencies_s[who, name]
            middle_ms, late_ms = percentile_ms(latencies_s, 50), percentile_ms(latencies_s, 99)
            print(
                f"  {name:9s} {len(latencies_s):4d} messages, "
                f"p50 {middle_ms:.1f} ms, p99 {late_ms:.1f} ms"
            )
    print(f"ratio of processor time: {spent['ar_builder'] / spent['bare']:.2f}")


def wait_for_node(robot: Robot) -> None:
    """Drive on until the node offers its services and is active."""
    deadline_s = time.monotonic() + 120.0
    while not robot.latencies_s["ar_builder", "scan"]:
        if time.monotonic() > deadline_s:
            raise RuntimeError("the node gives no scans")
        _drive(robot, 1.0)


def _drive(robot: Robot, seconds: float) -> None:
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
        while next_s > time.perf_counter():
            robot.take()
            time.sleep(POLL_S)


def main() -> None:
    """Measure, or be the peer."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--sensors", action="store_true")
    parser.add_argument("--empty", action="store_true")
    parser.add_argument("--bare", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    sensors = SENSORS if options.sensors else SCANS
    if options.bare:
        run_bare(sensors)
        return
    moves = "walking" if options.sensors else ""
    measure(options.seconds, sensors, None if options.empty else moves)


if __name__ == "__main__":
    main()
