"""What rviz would show of a recording, against what the recording's lists say."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from are_ros.bag.reader import BagReader
from are_ros.bag.types import RosbagsFactory
from are_ros.bag.writer import BagWriter
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError
from are_ros.messages.cloud import make_cloud
from are_ros.replay.film_command import without_robot
from are_ros.replay.rviz_scene import RvizScene, read_scene
from are_ros.replay.rviz_topics import NEAR_M
from are_ros.replay.rviz_window import status_lines

MAKE = RosbagsFactory().make
START_NS = 1000 * NS_PER_S
OUT = "/ar_builder/"
Entry = tuple[str, float, Any]


def header(second: float, frame_id: str = "map") -> Any:
    """Return a Header of some seconds after the start."""
    seconds, nanoseconds = divmod(START_NS + round(second * NS_PER_S), NS_PER_S)
    stamp = MAKE("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    return MAKE("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


def pose(x: float, y: float, yaw: float = 0.0) -> Any:
    """Return a Pose on the floor."""
    turn = MAKE("geometry_msgs/msg/Quaternion", z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    place = MAKE("geometry_msgs/msg/Point", x=x, y=y)
    return MAKE("geometry_msgs/msg/Pose", position=place, orientation=turn)


def edge(second: float, parent: str, child: str, x: float, yaw: float = 0.0) -> Any:
    """Return a TFMessage of one edge."""
    at = pose(x, 0.0, yaw)
    shift = MAKE("geometry_msgs/msg/Vector3", x=x)
    change = MAKE("geometry_msgs/msg/Transform", translation=shift, rotation=at.orientation)
    stamped = MAKE(
        "geometry_msgs/msg/TransformStamped",
        header=header(second, parent),
        child_frame_id=child,
        transform=change,
    )
    return MAKE("tf2_msgs/msg/TFMessage", transforms=[stamped])


def markers(second: float, frame_id: str, *numbers: int, **fields: Any) -> Any:
    """Return a MarkerArray of cubes at (1, 2)."""
    made = [
        MAKE(
            "visualization_msgs/msg/Marker",
            header=header(second, frame_id),
            id=number,
            type=1,
            pose=pose(1.0, 2.0),
            color=MAKE("std_msgs/msg/ColorRGBA", a=1.0),
            **fields,
        )
        for number in numbers
    ]
    return MAKE("visualization_msgs/msg/MarkerArray", markers=made)


def scan(second: float, ranges: Sequence[float]) -> Any:
    """Return a scan whose beams look ahead, to the left, and back."""
    return MAKE(
        "sensor_msgs/msg/LaserScan",
        header=header(second, "base_link"),
        angle_max=math.pi,
        angle_increment=math.pi / 2,
        range_min=0.1,
        range_max=10.0,
        ranges=np.array(ranges, np.float32),
    )


def grid(second: float, cells: Any) -> Any:
    """Return a map of 0.5 m cells from (-1, -1) on."""
    data = np.array(cells, np.int8)
    info = MAKE(
        "nav_msgs/msg/MapMetaData",
        resolution=0.5,
        width=data.shape[1],
        height=data.shape[0],
        origin=pose(-1.0, -1.0),
    )
    return MAKE(
        "nav_msgs/msg/OccupancyGrid", header=header(second), info=info, data=data.reshape(-1)
    )


def write(folder: Path, entries: Sequence[Entry]) -> Path:
    """Write (topic, second, message) as a recording."""
    path = folder / "some.mcap"
    with BagWriter(path) as writer:
        for topic, name in {topic: m.__msgtype__ for topic, _, m in entries}.items():
            writer.add_topic(topic, name)
        for topic, second, message in entries:
            writer.write(topic, START_NS + round(second * NS_PER_S), message)
    return path


FRAMES: list[Entry] = [
    ("/tf_static", 0.0, edge(0.0, "odom", "base_link", 0.0)),
    ("/tf", 0.0, edge(0.0, "map", "odom", 0.0)),
    ("/tf", 4.0, edge(4.0, "map", "odom", 4.0, math.pi / 2)),
    ("/map", 9.0, grid(0.0, [[0, 0], [0, 100]])),
]


@pytest.fixture(scope="module")
def sample_scene(sample_replay: Path) -> RvizScene:
    """Return the fullest moment of eight seconds among many artefacts."""
    return read_scene(sample_replay)


def test_the_fullest_moment_is_chosen(sample_scene: RvizScene, sample_replay: Path) -> None:
    """At no tick are more artefacts perceived near the camera."""
    counts = {}
    with BagReader([sample_replay / "augmented.mcap"]) as reader:
        for message in reader.messages({OUT + "perceived"}):
            perceived = reader.deserialize(message).artefacts
            counts[message.log_time_ns] = sum(one.range <= NEAR_M for one in perceived)
    tick_ns = max(t for t in counts if t <= sample_scene.now_ns)
    assert counts[tick_ns] == max(counts.values()) > 0
    assert sample_scene.now_ns - tick_ns <= NS_PER_S // 20


def test_the_markers_are_those_of_the_living(sample_replay: Path) -> None:
    """Body and heading of each artefact that the list of that tick tells of, where it is.

    Labels are those of the perceived.
    """
    with BagReader([sample_replay / "augmented.mcap"]) as reader:
        lists = [*reader.messages({OUT + "artefacts"})]
        perceived = {
            message.log_time_ns: {one.id for one in reader.deserialize(message).artefacts}
            for message in reader.messages({OUT + "perceived"})
        }
        for message in (lists[20], lists[55], lists[-1]):
            listed = reader.deserialize(message).artefacts
            at_s = (message.log_time_ns - reader.start_ns) / NS_PER_S
            shown = read_scene(sample_replay, at_s).markers
            ids = {artefact.id: artefact.pose.position for artefact in listed}
            for namespace in ("body", "label", "heading"):
                found = [m for m in shown if m.fields.namespace == namespace]
                labelled = perceived[message.log_time_ns]
                wanted = labelled if namespace == "label" else set(ids)
                assert {m.fields.number for m in found} == wanted
            for marker in shown:
                if marker.fields.namespace == "body":
                    place = ids[marker.fields.number]
                    where = marker.fixed_from_marker.translation_m
                    np.testing.assert_allclose(where, (place.x, place.y, place.z), atol=1e-9)


def test_the_map_is_the_last_one(sample_scene: RvizScene, sample_replay: Path) -> None:
    """Its updates, which say the same again, change nothing more."""
    with BagReader([sample_replay / "augmented.mcap"]) as reader:
        last = {
            message.topic: reader.deserialize(message)
            for message in reader.messages(
                {OUT + "augmented_map", OUT + "augmented_costmap"}, stop_ns=sample_scene.now_ns + 1
            )
        }
    for shown, name in ((sample_scene.grid, "map"), (sample_scene.costmap, "costmap")):
        assert shown is not None
        data = last[f"{OUT}augmented_{name}"].data
        np.testing.assert_array_equal(shown[0].cells.reshape(-1), data)


def test_scans_end_at_walls(sample_scene: RvizScene) -> None:
    """Of the real scan nearly all points lie in or beside occupied cells of the map."""
    (_, augmented), (topic, real) = sample_scene.scans
    assert topic == "/scan"
    assert len(augmented) > 100
    assert sample_scene.grid is not None
    grid_shown, fixed_from_grid = sample_scene.grid
    places = fixed_from_grid.inverse().apply(real)[:, :2] / grid_shown.resolution_m
    cols, rows = np.floor(places).astype(np.int64).T
    occupied = np.pad(grid_shown.cells >= 65, 3)
    hits = sum(occupied[rows + 3 + dy, cols + 3 + dx] for dy in range(-2, 3) for dx in range(-2, 3))
    assert np.mean(hits > 0) > 0.95


def test_the_robot_is_there_with_its_outline(sample_scene: RvizScene) -> None:
    """A disc of the configured radius about its base."""
    assert sample_scene.base_frame == "base_footprint"
    assert sample_scene.robot is not None
    assert sample_scene.outline_m is not None
    np.testing.assert_allclose(np.hypot(*sample_scene.outline_m.T), 0.22)
    assert {"map", "odom", "base_link"} <= set(sample_scene.axes)


def test_a_marker_stays_where_its_frame_was_at_its_stamp(tmp_path: Path) -> None:
    """Unless it is locked to the frame: then it goes with it."""
    entries = [
        *FRAMES,
        ("/shapes", 4.0, markers(2.0, "odom", 1)),
        ("/shapes", 4.0, markers(2.0, "odom", 2, frame_locked=True)),
        ("/shapes", 4.0, markers(2.0, "/map", 3)),
    ]
    scene = read_scene(write(tmp_path, entries), 5.0)
    places = {m.fields.number: m.fixed_from_marker.translation_m for m in scene.markers}
    half = math.sqrt(0.5)
    np.testing.assert_allclose(places[1][:2], (2.0 + half - 2 * half, half + 2 * half), atol=1e-9)
    np.testing.assert_allclose(places[2][:2], (4.0 - 2.0, 1.0), atol=1e-9)
    np.testing.assert_allclose(places[3][:2], (1.0, 2.0))
    assert scene.complaints == ()


def test_a_marker_whose_frame_is_not_known_is_not_shown(tmp_path: Path) -> None:
    """Neither in an unknown frame nor at a stamp beyond the transforms; both are complaints."""
    entries = [
        *FRAMES,
        ("/shapes", 4.0, markers(4.0, "nowhere", 1, frame_locked=True)),
        ("/shapes", 4.0, markers(8.0, "odom", 2)),
    ]
    scene = read_scene(write(tmp_path, entries), 5.0)
    assert scene.markers == ()
    assert len(scene.complaints) == 2


def test_lifetimes_go_by_the_time_of_the_picture(tmp_path: Path) -> None:
    """A marker of three seconds is gone after three."""
    life = MAKE("builtin_interfaces/msg/Duration", sec=3)
    path = write(tmp_path, [*FRAMES, ("/shapes", 1.0, markers(1.0, "map", 1, lifetime=life))])
    shown = [len(read_scene(path, at_s).markers) for at_s in (0.5, 1.0, 3.9, 4.0)]
    assert shown == [0, 1, 1, 0]


def test_of_scans_the_newest_with_a_pose_is_shown(tmp_path: Path) -> None:
    """Only returns are points; a scan that is newer than the transforms waits."""
    entries = [
        *FRAMES,
        ("/scan", 4.1, scan(4.0, (2.0, 3.0, math.inf))),
        ("/scan", 4.5, scan(4.4, (9.0, 9.0, 9.0))),
    ]
    scene = read_scene(write(tmp_path, entries), 5.0)
    ((topic, points),) = scene.scans
    assert topic == "/scan"
    np.testing.assert_allclose(points, ((4.0, 2.0, 0.0), (1.0, 0.0, 0.0)), atol=1e-6)


def test_a_patched_map_is_shown_patched(tmp_path: Path) -> None:
    """Of the topic that ARE gives out, before any other map."""
    update = MAKE(
        "map_msgs/msg/OccupancyGridUpdate",
        header=header(2.0),
        x=1,
        y=0,
        width=1,
        height=2,
        data=np.array((50, 60), np.int8),
    )
    entries = [
        *FRAMES,
        (OUT + "augmented_map", 1.0, grid(1.0, [[1, 2], [3, 4]])),
        (OUT + "augmented_map_updates", 2.0, update),
    ]
    path = write(tmp_path, entries)
    cells = [
        shown.grid[0].cells.tolist()
        for shown in (read_scene(path, 1.5), read_scene(path, 3))
        if shown.grid
    ]
    assert cells == [[[1, 2], [3, 4]], [[1, 50], [3, 60]]]


def perceived(second: float, *ranges_m: float) -> Entry:
    """Return a list of the perceived at these distances from the camera."""
    artefacts = [MAKE("are_msgs/msg/PerceivedArtefact", range=range_m) for range_m in ranges_m]
    name = "are_msgs/msg/PerceivedArtefactArray"
    return OUT + "perceived", second, MAKE(name, header=header(second), artefacts=artefacts)


def test_one_near_the_camera_goes_before_many_far_away(tmp_path: Path) -> None:
    """The view from behind the robot would show them nothing but floor."""
    lists = [perceived(1.0, 30.0, 31.0, 32.0), perceived(2.0, 3.0, 40.0), perceived(3.0, 3.0)]
    assert read_scene(write(tmp_path, [*FRAMES, *lists])).elapsed_s == pytest.approx(2.05)
    far = [perceived(1.0, 30.0), perceived(2.0, 30.0, 31.0), perceived(3.0)]
    assert read_scene(write(tmp_path, [*FRAMES, *far])).elapsed_s == pytest.approx(2.05)


def test_the_octomap_is_shown_where_it_is(tmp_path: Path) -> None:
    """The newest cloud, at the place of its frame, between floor and hips; a bad one is said."""
    z_m = (0.05, 0.45, 2.45)
    points = np.array([(0.05, 0.05, z) for z in z_m] + [(0.15, 0.05, z) for z in z_m], np.float32)
    cloud = make_cloud(RosbagsFactory(), "odom", START_NS, points)
    path = write(tmp_path, [*FRAMES, ("/octomap_point_cloud_centers", 1.0, cloud)])
    shown = read_scene(path, 2.0).voxels
    assert shown is not None
    assert shown.centres_m() == pytest.approx(np.array([(0.05, 0.05, 0.45), (0.15, 0.05, 0.45)]))
    shown = read_scene(path).voxels
    assert shown is not None
    expected = np.array([(3.95, 0.05, 0.45), (3.95, 0.15, 0.45)])
    assert sorted(map(tuple, shown.centres_m().round(6).tolist())) == sorted(
        map(tuple, expected.tolist())
    )
    cloud.row_step = 1
    bad = read_scene(write(tmp_path, [*FRAMES, ("/octomap_point_cloud_centers", 1.0, cloud)]))
    assert bad.voxels is None
    assert "/octomap_point_cloud_centers: row_step 1" in bad.complaints[0]


def test_without_lists_the_most_markers_are_the_fullest_moment(tmp_path: Path) -> None:
    """And without markers, the end."""
    path = write(
        tmp_path,
        [
            *FRAMES,
            ("/shapes", 1.0, markers(1.0, "map", 1)),
            ("/shapes", 2.0, markers(1.0, "map", 1, 2, 3)),
            ("/shapes", 3.0, markers(1.0, "map", 1, 2, action=2)),
        ],
    )
    assert read_scene(path).elapsed_s == 2.0
    assert read_scene(write(tmp_path, FRAMES)).elapsed_s == 9.0


def test_a_time_beyond_the_recording_is_refused(tmp_path: Path) -> None:
    """The sentence says how long it is."""
    path = write(tmp_path, FRAMES)
    with pytest.raises(BagError, match=r"--at 9\.5 s is beyond the recording, which is 9\.000 s"):
        read_scene(path, 9.5)
    assert read_scene(path, 9.0).grid is not None


# --------------------------------------------------------------------- without tf: odometry


def odometry(second: float, x: float, child: str = "base_link") -> Any:
    """Return an Odometry of the robot in odom."""
    whole = MAKE("geometry_msgs/msg/PoseWithCovariance", pose=pose(x, 0.0), covariance=np.zeros(36))
    return MAKE(
        "nav_msgs/msg/Odometry", header=header(second, "odom"), child_frame_id=child, pose=whole
    )


DRIVING: list[Entry] = [
    ("/map", 9.0, grid(0.0, [[0, 0], [0, 100]])),
    ("/odom", 2.0, odometry(2.0, 2.0)),
    ("/scan", 3.1, scan(3.0, (2.0, 3.0, math.inf))),
    ("/odom", 4.0, odometry(4.0, 4.0)),
]
JOINED = 'ar_builder:\n  ros__parameters:\n    frames: {static: ["1 0 0 0 0 0 map odom"]}\n'


def test_odometry_tells_where_the_robot_is_where_tf_does_not(tmp_path: Path) -> None:
    """Over the static transform of the parameters, as in the replay; scans are shown from there."""
    (tmp_path / "effective.yaml").write_text(JOINED, encoding="utf-8")
    scene = read_scene(write(tmp_path, DRIVING), 5.0)
    assert scene.robot is not None
    np.testing.assert_allclose(scene.robot.translation_m, (5.0, 0.0, 0.0))
    ((_, points),) = scene.scans
    np.testing.assert_allclose(points, ((6.0, 0.0, 0.0), (4.0, 3.0, 0.0)), atol=1e-6)
    assert (scene.complaints, scene.robot_problem) == ((), "")


def test_tf_goes_before_odometry(tmp_path: Path) -> None:
    """As in the replay, by default; with frames.odometry off nobody asks it."""
    entries = [*FRAMES, ("/odom", 4.0, odometry(4.0, 7.0))]
    scene = read_scene(write(tmp_path, entries), 5.0)
    assert scene.robot is not None
    np.testing.assert_allclose(scene.robot.translation_m, (4.0, 0.0, 0.0))
    (tmp_path / "effective.yaml").write_text(
        JOINED.replace("frames: {", "frames: {odometry: ignore, "), encoding="utf-8"
    )
    assert read_scene(write(tmp_path, DRIVING), 5.0).robot is None


def test_why_there_is_no_robot_is_said(tmp_path: Path) -> None:
    """What is missing between the frames; nothing where no input could tell."""
    scene = read_scene(write(tmp_path, DRIVING), 5.0)
    assert scene.robot is None
    assert scene.robot_problem == "frame 'map' was never seen; known frames: base_link, odom"
    assert without_robot(scene.robot_problem) == f"the robot is not shown: {scene.robot_problem}"
    scene = read_scene(write(tmp_path, DRIVING[:1]), 0.0)
    assert scene.robot_problem == ""
    assert "--with-inputs" in without_robot(scene.robot_problem)


def test_the_status_is_never_cut_off() -> None:
    """Whole complaints as there is room for, and how many more; one too long ends in dots."""
    assert status_lines(()) == ["Status: OK"]
    assert status_lines(("no map", "no scan")) == ["no map; no scan"]
    long = [f"no chain of transforms joins 'map' to 'frame_{number}'" for number in range(40)]
    lines = status_lines(long)
    assert len(lines) == 2
    assert all(len(line) <= 185 for line in lines)
    shown = " ".join(lines).partition("; and ")[0].split("; ")
    assert shown == long[: len(shown)]
    assert lines[-1].endswith(f"; and {40 - len(shown)} more")
    (_, last) = status_lines(("so long " * 60, "another"))
    assert last.endswith(" ...; and 1 more")
    assert len(last) <= 185
