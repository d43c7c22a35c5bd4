"""Inspecting recordings, small ones and real ones."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from are_ros.bag.reader import BagReader
from are_ros.bag.roles import left_as_they_are
from are_ros.bag.types import jazzy_typestore
from are_ros.errors import BagError, ParameterError
from are_ros.messages.transforms import StampedTransform
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.replay.survey.inspection import Inspection, inspect_bag, inspection_lines
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.making import (
    OdometryReading,
    RosbagsFactory,
    make_grid,
    make_header,
    make_odometry,
    make_transforms,
)

WriteBag = Callable[[Path, list[tuple[str, int, Any]]], Path]
S = 1_000_000_000
EARTH = with_values(Parameters(), {"frames.map": "earth"})


def transform(parent: str, child: str, stamp_ns: int) -> StampedTransform:
    """Return an edge that does not move."""
    return StampedTransform(parent, child, stamp_ns, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def odometry(factory: RosbagsFactory, stamp_ns: int, child: str = "base_link") -> Any:
    """Return an odometry message of a robot at rest."""
    still = (0.0, 0.0, 0.0)
    pose = RigidTransform.identity()
    return make_odometry(factory, OdometryReading("odom", child, stamp_ns, pose, still, still))


PIXEL = {
    "width": 1,
    "height": 1,
    "encoding": "16UC1",
    "step": 2,
    "data": np.zeros(2, np.uint8),
}
LENS = {
    "width": 4,
    "height": 6,
    "binning_x": 2,
    "binning_y": 2,
    "k": np.array([9.0, 0.0, 2.0, 0.0, 9.0, 3.0, 0.0, 0.0, 1.0]),
}
TWO_BEAMS = {
    "angle_max": 0.5,
    "angle_increment": 0.5,
    "range_max": 9.0,
    "ranges": np.full(2, 3.0, np.float32),
}


def scan(factory: RosbagsFactory, stamp_ns: int) -> Any:
    """Return a scan of two beams, of which only the header matters."""
    header = make_header(factory, "laser", stamp_ns)
    return factory.make("sensor_msgs/msg/LaserScan", header=header, **TWO_BEAMS)


@pytest.fixture
def complete(tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag) -> Path:
    """Return a recording of two seconds that lacks nothing."""
    grid = OccupancyGrid(np.zeros((2, 2), np.int8), 0.5, RigidTransform.identity(), "earth")
    mounts = [transform("base_link", "laser", 0), transform("earth", "odom", 0)]
    records = [
        ("/map", 0, make_grid(factory, grid)),
        ("/tf_static", 0, make_transforms(factory, mounts)),
    ]
    records += [("/odom", k * S // 10, odometry(factory, k * S // 10)) for k in range(21)]
    records += [("/front", k * S // 10, scan(factory, k * S // 10)) for k in range(20)]
    return write_bag(tmp_path / "bag.mcap", records)


def inspected(
    path: Path,
    map_frame: str = "map",
    static_transforms: Sequence[str] = (),
    values: Mapping[str, Any] = MappingProxyType({}),
    **options: Any,
) -> Inspection:
    """Inspect one recording, with `values` of parameters."""
    given = {"frames.map": map_frame, "frames.static": static_transforms, **values}
    with BagReader([path]) as reader:
        return inspect_bag(reader, parameters=with_values(Parameters(), given), **options)


def test_a_complete_recording_lacks_nothing(complete: Path) -> None:
    """Topics, rates, roles and frames are found, and nothing is missing."""
    inspection = inspected(complete, map_frame="earth")
    front, _, odom, _ = inspection.topics
    assert (front.topic.name, front.frame_id, round(front.rate_hz)) == ("/front", "laser", 10)
    assert (odom.topic.count, odom.frame_id) == (21, "odom")
    assert (inspection.map_frame, inspection.base_frame) == ("earth", "base_link")
    assert (inspection.start_ns, inspection.end_ns) == (0, 2 * S + 1)
    assert inspection.roles.topic("scan") == "/front"
    assert inspection.missing == ()
    assert inspection.frames.tree_lines() == (
        "earth",
        "  odom (static, /tf_static)",
        "    base_link (10.0 Hz, /odom)",
        "      laser (static, /tf_static)",
    )


def test_what_is_not_cdr_is_no_input(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """It places no cloud, tells no time, and is not offered to be augmented."""
    lidar = make_header(factory, "lidar", S)
    cloud = factory.make("sensor_msgs/msg/PointCloud2", header=lidar)
    records = [("/points", 0, cloud)]
    records += [("/odom", k * S // 10, odometry(factory, k * S // 10)) for k in range(20)]
    bag = write_bag(tmp_path / "bag.mcap", records)
    kinds = {"/tf": "tf2_msgs/msg/TFMessage", "/rear": "sensor_msgs/msg/LaserScan"}
    kinds["/deep"] = "sensor_msgs/msg/PointCloud2"
    with Writer(tmp_path / "odd", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, kind in kinds.items():
            options = {"typestore": jazzy_typestore(), "serialization_format": "json"}
            connection = writer.add_connection(topic, kind, **options)
            for k in range(20):
                writer.write(connection, k * S // 10, b'{"header": {"stamp": {"sec": 9}}}')
    with BagReader([bag, tmp_path / "odd" / "odd.mcap"]) as reader:
        inspection = inspect_bag(reader)
        said = left_as_they_are(reader.topics, inspection.roles, {})
        assert not [sentence for sentence in said if "/deep" in sentence]
    assert inspection.roles.topic("points") == "/points"
    assert "/rear" not in inspection.times.scans
    assert not inspection.clock.apart


def test_a_scan_whose_angles_do_not_fit_is_said_and_can_be_replayed(
    complete: Path, tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """SLAM Toolbox drops what Nav2 takes: the user is told, and nothing is missing."""
    assert inspected(complete, map_frame="earth").misfits == ()
    odd = scan(factory, S)
    odd.angle_max = 3.0
    inspection = inspected(write_bag(tmp_path / "odd.mcap", [("/front", S, odd)]))
    (sentence,) = inspection.misfits
    assert sentence.startswith(
        "the first scan of /front: ranges has 2 values, and 0 to 3 by 0.5 gives 7.0; its beams go"
    )
    assert any(sentence in line for line in inspection_lines(inspection))
    assert not any("of no use" in missing for missing in inspection.missing)


def test_a_map_in_another_frame_is_said(complete: Path) -> None:
    """A replay would refuse it: the option that names its frame is given, and ends the word."""
    (sentence,) = inspected(complete).missing
    assert sentence.startswith(
        "the map of /map is in earth, not in map: give --map-frame earth; if it moves with"
    )
    missing = inspected(complete, has_map_file=True).missing
    assert missing[0].startswith("nothing joins map to base_link")


def test_a_map_of_no_use_is_said(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """A map without a cell is none; a file in its place ends the word."""
    empty = make_grid(
        factory, OccupancyGrid(np.zeros((0, 0), np.int8), 0.5, RigidTransform.identity(), "map")
    )
    edges = make_transforms(factory, [transform("map", "base_link", 0)])
    path = write_bag(tmp_path / "bag.mcap", [("/map", 0, empty), ("/tf_static", 0, edges)])
    (useless,) = inspected(path).missing
    assert useless.startswith("the first map is of no use: /map: width is 0")
    assert inspected(path, has_map_file=True).missing == ()


def test_a_map_that_comes_late_is_said(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """As a replay says it; within a second it is not late, nor where a file takes its place."""
    grid = OccupancyGrid(np.zeros((2, 2), np.int8), 0.5, RigidTransform.identity(), "odom")
    records = [("/odom", k * S // 10, odometry(factory, k * S // 10)) for k in range(40)]
    for at_ns, is_late in ((S, False), (3 * S, True)):
        late = sorted([*records, ("/map", at_ns, make_grid(factory, grid))], key=lambda r: r[1])
        path = write_bag(tmp_path / f"bag{at_ns}.mcap", late)
        said = inspected(path, map_frame="odom").missing
        assert len(said) == is_late
        assert all(text.startswith("/map begins 3.0 s after what moves") for text in said)
        assert inspected(path, map_frame="odom", has_map_file=True).missing == ()


def test_messages_of_another_type_on_a_topic_are_passed_over(
    complete: Path, tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """Somebody published texts on the names of scan, odometry and transforms, before all else."""
    with BagReader([complete]) as reader:
        records = [(m.topic, m.log_time_ns, reader.deserialize(m)) for m in reader.messages()]
        expected = inspect_bag(reader, parameters=EARTH)
    folder = tmp_path / "both"
    texts = [(topic, 0, factory.make("std_msgs/msg/String")) for topic in ("/front", "/odom")]
    first, second = (
        write_bag(folder / name, part) for name, part in (("a.mcap", texts), ("b.mcap", records))
    )
    with BagReader([first, second]) as reader:
        inspection = inspect_bag(reader, parameters=EARTH, overrides={"scan": "/front"})
    assert inspection.missing == ()
    assert inspection.frames == expected.frames
    assert inspection.time == expected.time


def test_rates_read_well(tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag) -> None:
    """A single message has none, and a rare one is not said to come at 0.0 Hz."""
    records = [("/odom", k * S // 10, odometry(factory, k * S // 10)) for k in range(1001)]
    records += [("/scan", 0, scan(factory, 0))]
    records += [("/rare", k * S, scan(factory, k * S)) for k in (0, 50)]
    lines = inspection_lines(inspected(write_bag(tmp_path / "bag.db3", records)))
    texts = {line.split()[0]: " ".join(line.split()[2:]) for line in lines[2:5]}
    assert texts == {
        "/odom": "1001 10.0 Hz odom",
        "/rare": "2 0.02 Hz laser",
        "/scan": "1 once laser",
    }
    assert lines[0] == "100.0 s, 1004 messages"


def test_rates_leave_gaps_out(tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag) -> None:
    """Ten messages a second in two drives, an hour apart: of the topic and of the edge."""
    ticks = [at for begin_s in (0, 3600) for at in range(10 * begin_s, 10 * begin_s + 101)]
    records = [("/odom", k * S // 10, odometry(factory, k * S // 10)) for k in ticks]
    found = inspected(write_bag(tmp_path / "bag.mcap", records))
    (edge,) = found.frames.edges
    assert found.topics[0].rate_hz == pytest.approx(10.0, rel=0.02)
    assert edge.rate_hz == pytest.approx(10.0, rel=0.02)


def test_stamps_of_another_clock_are_said_once(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """The sentence on the time names the edge; those on frames do not repeat it."""
    records = [("/odom", k * S // 10, odometry(factory, k * S // 10)) for k in range(50)]
    ahead = [
        transform("map", "odom", k * S // 10 + 5 * S)._replace(translation_m=(0.01 * k, 0.0, 0.0))
        for k in range(50)
    ]
    records += [("/tf", k * S // 10, make_transforms(factory, [ahead[k]])) for k in range(50)]
    records += [("/scan", k * S // 10, scan(factory, k * S // 10)) for k in range(50)]
    found = inspected(write_bag(tmp_path / "bag.mcap", records))
    (said,) = [line for line in (*found.frames.oddities, *found.time) if "stamped" in line]
    assert said.startswith("map -> odom is stamped up to 5.00 s later than /odom"), said


@pytest.mark.parametrize(("late_s", "ahead_s"), [(6, 0), (0, 5), (0, -5)])
def test_without_a_common_clock_it_cannot_be_replayed_as_it_is(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag, late_s: int, ahead_s: int
) -> None:
    """Odometry that was recorded late, and scans stamped ahead or behind, as a replay says."""
    mounts = [transform("base_link", "laser", 0), transform("map", "odom", 0)]
    records = [("/tf_static", 10 * S, make_transforms(factory, mounts))]
    for k in range(100, 200):
        at_ns = k * S // 10
        records.append(("/odom", at_ns + late_s * S, odometry(factory, at_ns)))
        records.append(("/scan", at_ns, scan(factory, at_ns + ahead_s * S)))
    path = write_bag(tmp_path / "bag.mcap", sorted(records, key=lambda record: record[1]))
    (missing,) = inspected(path, has_map_file=True).missing
    assert missing.startswith("a common clock: the stamps of /scan go by another one")


def test_transforms_that_never_come_in_time_are_missing(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """Those of all scans: the robot's pose is recorded after the last one only."""
    mounts = [transform("base_link", "laser", 0), transform("map", "odom", 0)]
    records = [("/tf_static", 0, make_transforms(factory, mounts))]
    records += [("/scan", k * S // 10, scan(factory, k * S // 10)) for k in range(10)]
    records += [("/odom", k * S // 10, odometry(factory, k * S // 10)) for k in range(20, 40)]
    (never,) = inspected(write_bag(tmp_path / "b.mcap", records), has_map_file=True).missing
    assert never == "/scan: 10 of 10 scans never get their transform"


def test_what_is_missing_is_said_with_its_option(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """Map, pose and mount are asked for, until they are given."""
    records = [("/odom", 0, odometry(factory, 0)), ("/scan", 0, scan(factory, 0))]
    path = write_bag(tmp_path / "bag.db3", records)
    no_map, no_pose, no_mount = inspected(path).missing
    assert "--map FILE.yaml" in no_map
    assert no_pose.startswith("nothing joins map to base_link, which hangs together with odom:")
    assert '--static-tf "X Y Z YAW PITCH ROLL map odom", which `are align` finds' in no_pose
    assert no_mount.startswith("nothing joins laser, the frame of /scan, to base_link:")
    assert "--static-tf" in no_mount
    given = ["0 0 0 0 0 0 map odom", "0 0 0 0 0 0 base_link laser"]
    assert inspected(path, has_map_file=True, static_transforms=given).missing == ()


def test_a_missing_base_is_said(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """Frames that are there are listed."""
    edges = [transform("map", "robot", 0)]
    path = write_bag(tmp_path / "bag.mcap", [("/tf", 0, make_transforms(factory, edges))])
    assert "(frames: map, robot)" in inspected(path, has_map_file=True).missing[0]
    edges = [transform("map", f"robot{k}/base_link", 0) for k in (1, 2)]
    path = write_bag(tmp_path / "two.mcap", [("/tf", 0, make_transforms(factory, edges))])
    missing = inspected(path, has_map_file=True).missing[0]
    assert missing.endswith("(it may be robot1/base_link or robot2/base_link)")


def test_odometry_without_child_gives_no_edge(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """An empty child frame makes no frame with an empty name."""
    path = write_bag(tmp_path / "bag.mcap", [("/odom", 0, odometry(factory, 0, child=""))])
    assert inspected(path).frames.edges == ()


def test_both_of_two_lasers_are_inspected(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """The second one, too, is listed, asked where it is mounted, and refused if it is no scan."""
    mounts = make_transforms(factory, [transform("base_link", "laser", 0)])
    header = make_header(factory, "rear_laser", 0)
    rear = factory.make("sensor_msgs/msg/LaserScan", header=header, **TWO_BEAMS)
    records = [("/tf_static", 0, mounts), ("/front", 0, scan(factory, 0)), ("/rear", 0, rear)]
    path = write_bag(tmp_path / "bag.mcap", records)
    options: dict[str, Any] = {"overrides": {"scan": "/front"}, "has_map_file": True}
    inspection = inspected(path, **options, sensors={"scan": ("/front", "/rear")})
    assert any(
        line.split() == ["scan", "/front,", "/rear"] for line in inspection_lines(inspection)
    )
    assert "nothing joins rear_laser, the frame of /rear, to base_link" in inspection.missing[-1]
    with pytest.raises(BagError, match="scan:=/tf_static: that topic is of type"):
        inspected(path, **options, sensors={"scan": ("/front", "/tf_static")})


def test_both_of_two_depth_cameras_are_inspected(
    complete: Path, tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """The second one, too, is listed, and its mount, its CameraInfo and its waits are told."""
    with BagReader([complete]) as reader:
        records = [(m.topic, m.log_time_ns, reader.deserialize(m)) for m in reader.messages()]
    for topic, frame in (("/left/depth", "laser"), ("/right/depth", "stray")):
        header = make_header(factory, frame, S)
        records.append((topic, S, factory.make("sensor_msgs/msg/Image", header=header, **PIXEL)))
    records.sort(key=lambda record: record[1])
    path = write_bag(tmp_path / "both.mcap", records)
    topics = ("/right/depth", "/left/depth")
    inspection = inspected(
        path, overrides={"depth": topics[0]}, sensors={"depth": topics}, map_frame="earth"
    )
    lines = [line.split() for line in inspection_lines(inspection, Path("hall.yaml"))]
    assert ["depth", "/right/depth,", "/left/depth"] in lines
    assert ["map", "hall.yaml"] in lines
    stray, *lenses = inspection.missing
    assert "nothing joins stray, the frame of /right/depth, to base_link" in stray
    assert [lens.split()[0] for lens in lenses] == list(topics)
    assert "/left/depth: depth images need not wait for their transforms" in inspection.time


def test_a_sensor_whose_first_reading_cannot_be_read_is_told(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """As the replay will refuse it."""
    header = make_header(factory, "lens", S)
    image = factory.make("sensor_msgs/msg/Image", header=header, **(PIXEL | {"encoding": "8UC1"}))
    path = write_bag(tmp_path / "bag.mcap", [("/image", S, image)])
    (said,) = (one for one in inspected(path).missing if "first image" in one)
    assert said.startswith("the first image is of no use: /image: encoding '8UC1' is not painted")


def test_the_rate_of_an_odometry_is_that_of_its_clock(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """A simulation that runs at twice the time of the log, decades behind it: 10 Hz is 10 Hz."""
    edges = [transform("odom", "base_link", 0)]
    records = []
    for k in range(40):
        log_ns, stamp_ns = 10**18 + k * S // 20, k * S // 10
        edges = [transform("odom", "base_link", stamp_ns)]
        records.append(("/odom", log_ns, odometry(factory, stamp_ns)))
        records.append(("/tf", log_ns + 1, make_transforms(factory, edges)))
    (edge,) = inspected(write_bag(tmp_path / "bag.mcap", records)).frames.edges
    assert edge.rate_hz == pytest.approx(20.0, rel=0.1)  # that of both topics together


def test_of_two_robots_with_their_own_tf_one_is_to_be_chosen(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """Without the choice no frame is known, and none can be given for the base."""
    records = []
    for k in range(20):
        for name in ("one", "two"):
            edges = [transform("map", f"{name}/base_link", k * S // 10)]
            records.append((f"/{name}/tf", k * S // 10, make_transforms(factory, edges)))
    path = write_bag(tmp_path / "bag.mcap", records)
    assert inspected(path).missing[1:] == ("a choice of transforms: --topic tf:=/NAME (see roles)",)
    with BagReader([path]) as reader:
        chosen = inspect_bag(reader, {"tf": "/two/tf"})
    assert len(chosen.missing) == 1


def test_the_real_hall_is_understood(real_data: Path) -> None:
    """A drive with two scans, no map and slashes in its frames."""
    inspection = inspected(real_data / "drl-jarvis-hall/jarvis_complex_path_fast.bag")
    assert inspection.roles.topic("tf") == "/tf"
    assert inspection.roles.topic("scan") is None
    assert "/driver_laser_navigation/laser_scan" in inspection.roles.sentences()[0]
    assert inspection.base_frame == "base_footprint"
    assert "map" in inspection.frames.connected_to("base_footprint")
    assert inspection.frames.oddities[0].startswith("4 frame names begin with a slash")
    no_map, no_scan = inspection.missing
    assert "--map" in no_map
    assert no_scan == "a choice of scans: --topic scan:=/NAME (see roles)"


def test_the_real_ship_is_understood(real_data: Path) -> None:
    """The map is a child of the robot under another name, and fixed joints come from the future."""
    inspection = inspected(
        real_data / "drl-ship-interior-gazebo/ship_interior_with_tilting_laser.bag"
    )
    assert "map_ground_truth" in inspection.frames.connected_to("base_footprint")
    assert any("nothing joins map to base_footprint" in text for text in inspection.missing)
    (ahead,) = (one for one in inspection.frames.oddities if "0.50 s after being recorded" in one)
    assert ahead.count("->") == 5


def test_a_base_that_hangs_alone_hangs_together_with_nothing(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """Its own name is not said twice."""
    edges = [transform("map", "odom", 0), transform("base_link", "base_link", 0)]
    path = write_bag(tmp_path / "bag.mcap", [("/tf", 0, make_transforms(factory, edges))])
    (no_pose,) = inspected(path, has_map_file=True).missing
    assert no_pose.startswith("nothing joins map to base_link: give the transform")


def test_a_base_that_stands_beside_what_moves_is_joined_to_that(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """Below the map itself the robot would stand still, whatever its wheels do."""
    edges = [transform("odom", "chassis", k * S) for k in range(5)]
    edges += [transform("base_link", "wheel", k * S) for k in range(5)]
    records = [("/tf", e.stamp_ns, make_transforms(factory, [e])) for e in edges]
    joint = make_transforms(factory, [transform("base_footprint", "base_link", 0)])
    records.append(("/tf_static", 0, joint))
    path = write_bag(tmp_path / "bag.mcap", sorted(records, key=lambda record: record[1]))
    no_base, no_pose = inspected(path, has_map_file=True).missing
    assert no_base.startswith("nothing joins base_footprint to chassis, which moves")
    assert '--static-tf "X Y Z YAW PITCH ROLL chassis base_footprint"' in no_base
    assert no_pose.startswith("nothing joins map to chassis, which hangs together with odom:")
    assert '--static-tf "X Y Z YAW PITCH ROLL map odom"' in no_pose


@pytest.mark.parametrize("stamp_ns", [0, -S])
def test_what_is_stamped_0_or_before_is_missing_its_stamps(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag, stamp_ns: int
) -> None:
    """A driver that does not stamp, and transforms from one; a static one may have stamp 0."""
    statics = [transform("base_link", "laser", 0), transform("map", "odom", 0)]
    records = [("/tf_static", 0, make_transforms(factory, statics))]
    records += [("/odom", k * S // 10, odometry(factory, k * S // 10)) for k in range(20)]
    records += [("/scan", k * S // 10, scan(factory, stamp_ns)) for k in range(20)]
    arm = [transform("base_link", "arm", stamp_ns)]
    records += [("/tf", k * S // 10, make_transforms(factory, arm)) for k in range(20)]
    path = write_bag(tmp_path / "bag.mcap", sorted(records, key=lambda record: record[1]))
    (unstamped,) = inspected(path, has_map_file=True).missing
    assert unstamped.startswith("no message of /scan and base_link -> arm has a stamp,")


def test_what_is_stamped_0_for_a_time_is_told(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """As of a driver that waits for the first /clock; its transforms have the rate of the rest."""
    statics = [transform("base_link", "laser", 0), transform("map", "odom", 0)]
    records = [("/tf_static", S, make_transforms(factory, statics))]
    for k in range(10, 40):
        stamp_ns = k * S // 10 if k >= 15 else 0
        records.append(("/odom", k * S // 10, odometry(factory, k * S // 10)))
        records.append(("/scan", k * S // 10, scan(factory, stamp_ns)))
        arm = [transform("base_link", "arm", stamp_ns)]
        records.append(("/tf", k * S // 10, make_transforms(factory, arm)))
    inspection = inspected(write_bag(tmp_path / "bag.mcap", records), has_map_file=True)
    assert [text.split(" have no stamp")[0] for text in inspection.missing] == [
        "5 of 30 messages of /scan",
        "5 of 30 messages of base_link -> arm",
    ]
    (edge,) = (edge for edge in inspection.frames.edges if edge.child == "arm")
    assert edge.rate_text() == "10.0 Hz"


def test_transforms_in_a_ring_are_told(
    complete: Path, tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """A tree has none, and which parent holds would be a matter of who came last."""
    with BagReader([complete]) as reader:
        records = [(m.topic, m.log_time_ns, reader.deserialize(m)) for m in reader.messages()]
    back = [
        transform(*pair, second * S)
        for second in (1, 2)
        for pair in (("base_link", "odom"), ("odom", "base_link"))
    ]
    records += [("/tf", t.stamp_ns, make_transforms(factory, [t])) for t in back]
    path = write_bag(tmp_path / "ring.mcap", sorted(records, key=lambda record: record[1]))
    (ring,) = inspected(path, map_frame="earth").missing
    assert "odom -> base_link -> odom is a ring" in ring or "base_link -> odom -> base_l" in ring


def test_scans_that_stay_as_they_are_are_told(
    complete: Path, tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """One topic plays the role; a robot with two lasers sees artefacts with that one alone."""
    with BagReader([complete]) as reader:
        records = [(m.topic, m.log_time_ns, reader.deserialize(m)) for m in reader.messages()]
    records.append(("/rear", 2 * S, scan(factory, 2 * S)))
    path = write_bag(tmp_path / "two.mcap", records)
    lines = inspection_lines(inspected(path, overrides={"scan": "/front"}))
    options = "--topic scan:=/front --topic scan:=/rear"
    assert f"left as they are: /rear; to augment all, give {options}" in lines
    both = inspection_lines(inspected(path, sensors={"scan": ("/front", "/rear")}))
    assert not any("left as they are" in line for line in both)


@pytest.mark.parametrize("names", [["/range"], ["/sonar"], ["/sonar", "/range"]])
def test_range_sensors_are_augmented_by_name_only(
    complete: Path, tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag, names: list[str]
) -> None:
    """As in a replay: no topic plays the role by itself, and none is missing a choice."""
    with BagReader([complete]) as reader:
        records = [(m.topic, m.log_time_ns, reader.deserialize(m)) for m in reader.messages()]
    header = make_header(factory, "laser", 2 * S)
    values = {"field_of_view": 0.5, "min_range": 0.1, "max_range": 4.0, "range": 2.0}
    reading = factory.make("sensor_msgs/msg/Range", header=header, **values)
    path = write_bag(
        tmp_path / "more.mcap", [*records, *((name, 2 * S, reading) for name in names)]
    )
    unnamed = inspected(path, map_frame="earth")
    found = inspected(path, map_frame="earth", sensors={"range": ()})  # as of sensors.ranges: []
    assert found.missing == ()
    found_lines = inspection_lines(found)
    assert found_lines == inspection_lines(unnamed)
    assert ["range", "-"] in [line.split() for line in found_lines]
    (said,) = [line for line in found_lines if "left as they are" in line]
    options = " ".join(f"--topic range:={name}" for name in sorted(names))
    assert said.endswith(f"; to augment all, give {options}")
    assert not any(line.startswith("range:") for line in found_lines)
    name = names[-1]
    chosen = inspected(path, overrides={"range": name}, sensors={"range": (name,)})
    assert ["range", name] in [line.split() for line in inspection_lines(chosen)]


@pytest.mark.parametrize(("frame", "is_sensor"), [("map", False), ("odom", False), ("laser", True)])
def test_a_cloud_in_the_frame_of_the_map_or_of_odometry_is_no_reading(
    complete: Path,
    tmp_path: Path,
    factory: RosbagsFactory,
    write_bag: WriteBag,
    *,
    frame: str,
    is_sensor: bool,
) -> None:
    """As scans matched to the map, and marked voxels: their rays would begin at its origin."""
    with BagReader([complete]) as reader:
        records = [(m.topic, m.log_time_ns, reader.deserialize(m)) for m in reader.messages()]
    cloud = factory.make("sensor_msgs/msg/PointCloud2", header=make_header(factory, frame, S))
    path = write_bag(tmp_path / "cloud.mcap", [*records, ("/matched", S, cloud)])
    roles = inspected(path).roles
    assert roles.topic("points") == ("/matched" if is_sensor else None)
    assert any(f"it is in {frame}, where no sensor is" in s for s in roles.sentences()) != is_sensor


@pytest.mark.parametrize(
    ("frame", "is_moving", "is_sensor"),
    [
        ("camera_init", True, False),
        ("map", True, False),
        ("camera_init", False, True),
        ("body", True, True),
        ("lidar", True, True),
    ],
)
def test_a_cloud_in_a_frame_in_which_tf_moves_the_robot_is_no_reading(
    tmp_path: Path,
    factory: RosbagsFactory,
    write_bag: WriteBag,
    *,
    frame: str,
    is_moving: bool,
    is_sensor: bool,
) -> None:
    """As the registered cloud of a lidar odometry; without odometry, tf alone knows that frame.

    A lidar above the base by a joint that /tf repeats is on the robot.
    """
    edges = [("map", "camera_init"), ("body", "base_link"), ("body", "lidar")]
    joints = [transform(parent, child, 0) for parent, child in edges]
    records = [("/tf_static", 0, make_transforms(factory, joints[:1]))]
    for k in range(80):
        place = (0.1 * k * is_moving, 0.0, 0.0)
        moved = StampedTransform("camera_init", "body", k * S // 10, place, (0.0, 0.0, 0.0, 1.0))
        now = [one._replace(stamp_ns=moved.stamp_ns) for one in joints[1:]]
        records.append(("/tf", k * S // 10, make_transforms(factory, [moved, *now])))
    cloud = factory.make("sensor_msgs/msg/PointCloud2", header=make_header(factory, frame, S))
    path = write_bag(tmp_path / "cloud.mcap", [*records, ("/cloud_registered", S, cloud)])
    roles = inspected(path).roles
    assert roles.topic("points") == ("/cloud_registered" if is_sensor else None)
    assert any(f"it is in {frame}, where no sensor is" in s for s in roles.sentences()) != is_sensor


def test_messages_without_a_frame_are_told(
    complete: Path, tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """Of a scan, and of the CameraInfo beside an image; the image itself needs none."""
    with BagReader([complete]) as reader:
        records = [(m.topic, m.log_time_ns, reader.deserialize(m)) for m in reader.messages()]
    for topic, _, message in records:
        if topic == "/front":
            message.header.frame_id = ""
    header = make_header(factory, "", S)
    records += [
        ("/c/depth", S, factory.make("sensor_msgs/msg/Image", header=header, **PIXEL)),
        ("/c/camera_info", S, factory.make("sensor_msgs/msg/CameraInfo", header=header, **LENS)),
    ]
    path = write_bag(tmp_path / "bare.mcap", sorted(records, key=lambda record: record[1]))
    missing = inspected(path, sensors={"depth": ("/c/depth",)}).missing
    assert [text for text in missing if "names no frame" in text] == [
        f"the first message of {topic} names no frame, and is of no use: let its publisher set"
        " header.frame_id"
        for topic in ("/c/camera_info", "/front")
    ]
    assert any("has 1x1 pixels, its CameraInfo on /c/camera_info is of 2x3" in t for t in missing)


def test_a_fixed_transform_that_came_once_on_tf_is_told(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """It has to be static to last."""
    records = [("/tf_static", 0, make_transforms(factory, [transform("map", "odom", 0)]))]
    records += [("/odom", k * S // 10, odometry(factory, k * S // 10)) for k in range(30)]
    lasers = [transform("base_link", "laser", S), transform("base_link", "rear", S)]
    records.append(("/tf", S, make_transforms(factory, lasers)))
    path = write_bag(tmp_path / "bag.mcap", sorted(records, key=lambda record: record[1]))
    (once,) = inspected(path, has_map_file=True).missing
    assert once == (
        "base_link -> laser and base_link -> rear came once on /tf, which holds for that time only:"
        " publish it on /tf_static, or give it with"
        ' --static-tf "X Y Z YAW PITCH ROLL base_link laser"'
    )


def test_parameters_count_as_in_a_replay(
    complete: Path, tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """The base that they name, what odometry is for, and which topics a sensor has."""
    usual = inspected(complete, map_frame="earth")
    assert (usual.base_frame, usual.missing) == ("base_link", ())
    named = inspected(complete, map_frame="earth", values={"frames.base": "laser"})
    assert (named.base_frame, named.missing) == ("laser", ())
    (missing,) = inspected(complete, map_frame="earth", values={"frames.base": "lasr"}).missing
    known = "base_link, earth, laser, odom"
    assert missing == f"there is no frame lasr, which frames.base names (frames: {known})"
    ignored = inspected(complete, map_frame="earth", values={"frames.odometry": "ignore"})
    assert ignored.frames.connected_to("earth") == {"earth", "odom"}
    assert ignored.missing[0].startswith("nothing joins earth to base_link")
    preferred = inspected(complete, map_frame="earth", values={"frames.odometry": "use"})
    assert preferred.missing == ()
    lens = ("/image:=/lens",)
    with pytest.raises(ParameterError, match="/image is no topic of images"):
        inspected(complete, values={"sensors.camera_infos": lens})
    image = factory.make("sensor_msgs/msg/Image", header=make_header(factory, "laser", 0), **PIXEL)
    path = write_bag(tmp_path / "image.mcap", [("/image", 0, image)])
    with pytest.raises(BagError, match="the recording has no CameraInfo '/lens'; it has: none"):
        inspected(path, values={"sensors.camera_infos": lens})


@pytest.mark.parametrize("topic", ["/tf_static", "/tf"])
def test_odometry_of_a_part_needs_a_joint_that_stands(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag, topic: str
) -> None:
    """A tracking camera on the base: a static joint is turned round by itself, one of tf is not."""
    joint_m, turn = (0.1, 0.2, 0.3), (0.0, 0.0, math.sin(0.25), math.cos(0.25))
    camera = StampedTransform("base_link", "tracking", 0, joint_m, turn)
    records = [("/tf_static", 0, make_transforms(factory, [transform("map", "odom", 0)]))]
    for k in range(20):
        at_ns = k * S // 10
        records.append(("/odom", at_ns, odometry(factory, at_ns, "tracking")))
        records.append((topic, at_ns, make_transforms(factory, [camera._replace(stamp_ns=at_ns)])))
    path = write_bag(tmp_path / "bag.mcap", records)
    survey = inspected(path, has_map_file=True)
    if topic == "/tf_static":
        assert survey.missing == ()
        return
    (said,) = survey.missing
    advised = RigidTransform.from_xyz_ypr(*joint_m, 0.5, 0.0, 0.0).inverse()
    x_m, y_m, z_m = advised.translation_m.round(4).tolist()
    given = f"{x_m:g} {y_m:g} {z_m:g} -0.5 0 0 tracking base_link"
    assert said == (
        "odometry tells the pose of tracking, which tf hangs below base_link, so it moves nothing:"
        f' if that joint is rigid, turn it round with --static-tf "{given}"'
    )
    assert inspected(path, has_map_file=True, static_transforms=[given]).missing == ()


@pytest.mark.parametrize("has_poses", [False, True])
def test_the_map_hangs_below_odometry_that_tf_hangs_below_the_robot(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag, *, has_poses: bool
) -> None:
    """As a legged robot's tf: body -> odom and body -> vision; a map above the body would walk."""
    records = [("/tf_static", 0, make_transforms(factory, [transform("body", "rail", 0)]))]
    for k in range(40):
        at_ns = k * S // 10
        records.append(("/odom", at_ns, odometry(factory, at_ns, "body")))
        turned = StampedTransform("body", "odom", at_ns, (-0.1 * k, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        records.append(("/tf", at_ns, make_transforms(factory, [turned])))
    if has_poses:
        records += poses_on_the_map(factory, "/amcl_pose", "map", 2.0)
    path = write_bag(tmp_path / "bag.mcap", sorted(records, key=lambda record: record[1]))
    survey = inspected(path, has_map_file=True)
    (said,) = survey.missing
    assert survey.frames.oddities == (
        "body -> odom is there in both directions; tf holds, not odometry",
    )
    assert survey.base_frame == "body"
    # at 2 s the robot is 2 m ahead in odom: odom is at (2, 0) + turn (-2, 0) on the map
    x_m, y_m = 2.0 - 2.0 * math.cos(0.5), -2.0 * math.sin(0.5)
    inverse = RigidTransform.planar(x_m, y_m, 0.5).inverse()
    x_m, y_m, _ = inverse.translation_m.round(4).tolist()
    option = '--static-tf "X Y Z YAW PITCH ROLL odom map"'
    if has_poses:
        option = f'/amcl_pose tells it: give --static-tf "{x_m:g} {y_m:g} 0 -0.5 0 0 odom map"'
    assert option in said
    for given in ("0 0 0 0 0 0 odom map", "0 0 0 0 0 0 map odom"):
        assert inspected(path, has_map_file=True, static_transforms=[given]).missing == ()


def test_what_tf_moves_itself_is_no_part_that_odometry_tells_of(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """Wheels' odometry beside a filter's tf: the map is joined to the filter's frame."""
    records = [("/tf_static", 0, make_transforms(factory, [transform("base_link", "laser", 0)]))]
    for k in range(20):
        at_ns = k * S // 10
        records.append(("/odom", at_ns, odometry(factory, at_ns)))
        pose = (0.1 * k, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
        moved = StampedTransform("odom_combined", "base_link", at_ns, *pose)
        records.append(("/tf", at_ns, make_transforms(factory, [moved])))
    path = write_bag(tmp_path / "bag.mcap", records)
    (said,) = inspected(path, has_map_file=True).missing
    assert said == (
        "nothing joins map to base_link, which hangs together with laser, odom_combined: give the"
        ' transform with --static-tf "X Y Z YAW PITCH ROLL map odom_combined" or the map\'s frame'
        " with --map-frame"
    )


def test_a_robot_that_nothing_moves_is_told(
    complete: Path, tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """Its laser may be on a robot that drove: without odometry nobody knows."""
    static = [transform("map", "odom", 0), transform("odom", "base_link", 0)]
    records = [("/tf_static", 0, make_transforms(factory, static)), ("/scan", S, scan(factory, S))]
    bare = inspected(write_bag(tmp_path / "still.mcap", records), has_map_file=True)
    (said,) = bare.frames.oddities
    assert said == (
        "static transforms alone join base_link to map: the robot stands still in a replay;"
        " if it drove, its odometry or the /tf of its localization is missing"
    )
    assert inspected(complete, map_frame="earth").frames.oddities == ()


def poses_on_the_map(
    factory: RosbagsFactory,
    topic: str,
    frame: str,
    x_m: float,
    kind: str = "PoseWithCovarianceStamped",
) -> list[Any]:
    """Return three poses, at 1, 2 and 3 s: at x in a frame, turned by 0.5."""
    records = []
    for second in (1, 2, 3):
        pose = factory.make(f"geometry_msgs/msg/{kind}")
        pose.header = make_header(factory, frame, second * S)
        place = pose.pose if kind == "PoseStamped" else pose.pose.pose
        place.position.x = x_m
        turn = place.orientation
        turn.z, turn.w = math.sin(0.25), math.cos(0.25)
        records.append((topic, second * S, pose))
    return records


@pytest.mark.parametrize(
    ("topic", "kind"), [("/amcl_pose", "PoseWithCovarianceStamped"), ("/robot_pose", "PoseStamped")]
)
def test_recorded_poses_give_the_transform_of_the_map(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag, topic: str, kind: str
) -> None:
    """The robot, 4 m down the odometry's x axis, stands on the map at x = 3, turned by 0.5."""
    records = poses_on_the_map(factory, topic, "map", 3.0, kind)
    records += poses_on_the_map(factory, "/goal_pose", "map", 9.0, "PoseStamped")
    records += poses_on_the_map(factory, "/initialpose", "map", 9.0)
    records += poses_on_the_map(factory, "/another_pose", "odom", 9.0)
    ahead = [
        StampedTransform("odom", "base_link", k * S, (4.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        for k in range(5)
    ]
    records += [("/tf", t.stamp_ns, make_transforms(factory, [t])) for t in ahead]
    path = write_bag(tmp_path / "bag.mcap", sorted(records, key=lambda record: record[1]))
    (no_pose,) = inspected(path, has_map_file=True).missing
    x_m, y_m = 3.0 - 4.0 * math.cos(0.5), -4.0 * math.sin(0.5)
    assert no_pose == (
        "nothing joins map to base_link, which hangs together with odom:"
        f' {topic} tells it: give --static-tf "{x_m:.4f} {y_m:.4f} 0 0.5 0 0 map odom", which is'
        " within 0.00 m of all 3 poses"
    )


def test_recorded_poses_go_by_what_is_given_and_by_the_clock_of_the_stamps(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """Odometry moves a laser that --static-tf mounts on the base; a simulation 20 times as fast."""
    records = poses_on_the_map(factory, "/amcl_pose", "map", 3.0)
    ahead = [
        StampedTransform("odom", "laser", k * S, (4.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        for k in range(100)
    ]
    records += [("/tf", t.stamp_ns, make_transforms(factory, [t])) for t in ahead]
    quick = [(topic, at_ns // 20, message) for topic, at_ns, message in records]
    path = write_bag(tmp_path / "bag.mcap", sorted(quick, key=lambda record: record[1]))
    given = ("-1 0 0 0 0 0 laser base_link",)
    (no_pose,) = inspected(path, static_transforms=given, has_map_file=True).missing
    x_m, y_m = 3.0 - 3.0 * math.cos(0.5), -3.0 * math.sin(0.5)
    assert f'--static-tf "{x_m:.4f} {y_m:.4f} 0 0.5 0 0 map odom", which is within' in no_pose


def test_a_depth_image_without_its_camera_info_is_said(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag
) -> None:
    """It could be nowhere but beside the image, its transport aside."""
    image = factory.make("sensor_msgs/msg/CompressedImage", header=make_header(factory, "d", 0))
    info = factory.make("sensor_msgs/msg/CameraInfo", header=make_header(factory, "d", 0))
    topic = "/d/depth/compressedDepth"
    sentence = f"{topic} has no CameraInfo beside it, on /d/camera_info: it is not augmented"
    bare = write_bag(tmp_path / "bare.mcap", [(topic, 0, image)])
    option = f'--set "sensors.camera_infos:=[{topic}:=/NAME]" takes one from elsewhere'
    assert f"{sentence}; {option}" in inspected(bare).missing
    other = "/e/depth/compressedDepth"
    two = write_bag(tmp_path / "two.mcap", [(topic, 0, image), (other, 0, image)])
    sensors = {"depth": (topic, other)}
    said = [text for text in inspected(two, sensors=sensors).missing if "beside" in text]
    option = f'--set "sensors.camera_infos:=[{topic}:=/NAME, {other}:=/NAME]"'  # one has them all
    assert [option in text for text in said] == [True, True]
    both = write_bag(tmp_path / "both.mcap", [(topic, 0, image), ("/d/camera_info", 1, info)])
    assert not [said for said in inspected(both).missing if "beside" in said]
