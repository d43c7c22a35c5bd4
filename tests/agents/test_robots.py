"""The robot in the map: its frame, the age of its pose, its footprint there."""

import numpy as np
import pytest

from are_ros.agents.robots import RobotTracker
from are_ros.world.cameras import Camera, Observer, PinholeView, mounted_camera
from are_ros.world.footprint import Footprint
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.transforms.tree import FrameTree

NO_TURN = (0.0, 0.0, 0.0, 1.0)
VIEW = PinholeView.from_field_of_view(8, 6, 1.5)


def tracker(base: str = "", max_age_ns: int = 50) -> tuple[RobotTracker, FrameTree]:
    """Return a tracker of a disc, and its frames."""
    frames = FrameTree()
    observer = Observer("robot", base, Footprint.disc(0.3))
    return RobotTracker(observer, frames, "map", max_age_ns), frames


@pytest.mark.parametrize(
    ("configured", "frames_there", "expected"),
    [
        ("", (), "base_footprint"),
        ("", ("base_link",), "base_link"),
        ("", ("base_link", "base_footprint"), "base_footprint"),
        ("chassis", ("base_link",), "chassis"),
    ],
)
def test_the_base_frame(configured: str, frames_there: tuple[str, ...], expected: str) -> None:
    """The one configured, else base_footprint, else base_link, whichever there is."""
    robots, frames = tracker(configured)
    for name in frames_there:
        frames.set_static("odom", name, (0.0, 0.0, 0.0), NO_TURN)
    assert robots.base_frame() == expected


def test_bases_within_namespaces_are_told_with_what_helps() -> None:
    """Which of them is the robot's nobody can tell, for others may join later."""
    robots, frames = tracker()
    for name in ("robot1/base_link", "robot2/base_footprint", "robot1/base_link_inertia"):
        frames.set_static("map", name, (0.0, 0.0, 0.0), NO_TURN)
    assert robots.pose(10) is None
    assert robots.missing.endswith(
        "; set frames.base, to robot1/base_link or robot2/base_footprint"
    )
    configured, _ = tracker("chassis")
    assert configured.pose(10) is None
    assert "set frames.base" not in configured.missing


def test_the_odometry_frame_is_that_in_which_the_base_moves() -> None:
    """Unless there is one of the name; joints do not move, and the map is none."""
    robots, frames = tracker("base_link")
    assert robots.odometry_frame("odom") == ""
    frames.set_static("base_footprint", "base_link", (0.0, 0.0, 0.1), NO_TURN)
    assert robots.odometry_frame("odom") == ""
    frames.set_transform("map", "base_footprint", 100, (1.0, 2.0, 0.0), NO_TURN)
    assert robots.odometry_frame("odom") == ""
    frames.set_transform("odom_combined", "base_footprint", 200, (1.0, 2.0, 0.0), NO_TURN)
    frames.set_transform("map", "odom_combined", 200, (0.0, 0.0, 0.0), NO_TURN)
    assert robots.odometry_frame("odom") == "odom_combined"
    frames.set_transform("world", "odom", 200, (0.0, 0.0, 0.0), NO_TURN)
    assert robots.odometry_frame("odom") == "odom"


def test_a_pose_is_as_old_as_max_age_at_the_most() -> None:
    """At the bound it is taken, a nanosecond later not, and the reason is told."""
    robots, frames = tracker()
    assert robots.pose(10) is None
    assert "not seen so far" in robots.missing
    frames.set_transform("map", "base_link", 100, (1.0, 2.0, 0.0), NO_TURN)
    assert robots.pose(99) is None
    found = robots.pose(150)
    assert found is not None
    assert found.stamp_ns == 100
    assert robots.missing == ""
    assert robots.pose(151) is None
    assert "old" in robots.missing
    assert robots.last is found
    robots.forget()
    assert robots.last is None


@pytest.mark.parametrize(
    ("odom_ns", "base_ns", "awaited"),
    [(100, 900, "map -> odom"), (900, 100, "odom -> base_link"), (100, 100, "odom -> base_link")],
)
def test_a_pose_that_is_too_old_names_the_transform_that_has_ended(
    odom_ns: int, base_ns: int, awaited: str
) -> None:
    """Localization or odometry: of two that have, that of the robot."""
    robots, frames = tracker()
    for parent, child, newest_ns in (("map", "odom", odom_ns), ("odom", "base_link", base_ns)):
        for stamp_ns in (90, newest_ns):
            frames.set_transform(parent, child, stamp_ns, (1.0, 2.0, 0.0), NO_TURN)
    assert robots.pose(900) is None
    assert robots.missing.startswith(f"for want of a newer {awaited}, the latest transform from")


@pytest.mark.parametrize(("stamp_ns", "word"), [(0, "0"), (-5, "before 1970")])
def test_a_transform_without_a_stamp_is_told_as_such(stamp_ns: int, word: str) -> None:
    """Where the clock is that of a calendar; in simulated time it is only old."""
    robots, frames = tracker()
    frames.set_transform("map", "base_link", stamp_ns, (1.0, 2.0, 0.0), NO_TURN)
    assert robots.pose(60) is None
    assert robots.missing.endswith("s old")
    assert robots.pose(1_700_000_000_000_000_000) is None
    said = f"'base_link' to 'map' is stamped {word}, so nobody knows when it was"
    assert said in robots.missing


def test_the_footprint_lies_where_the_robot_stands() -> None:
    """Moved and turned with the base; the same value while the pose is the same."""
    robots, frames = tracker()
    turn = RigidTransform.planar(0.0, 0.0, 0.5).rotation_xyzw
    frames.set_transform("map", "base_link", 100, (1.0, 2.0, 0.4), turn)
    found = robots.pose(110)
    assert found is not None
    np.testing.assert_allclose(found.footprint.vertices_m, [[1.0, 2.0]])
    assert found.map_from_base.yaw_rad() == pytest.approx(0.5)
    assert robots.pose(120) is found


def test_a_pose_that_is_corrected_at_the_same_stamp_is_taken() -> None:
    """A static base that is given anew, for instance."""
    robots, frames = tracker()
    for x in (1.0, 2.0):
        frames.set_static("map", "base_link", (x, 0.0, 0.0), NO_TURN)
        found = robots.pose(7)
        assert found is not None
        assert found.map_from_base.translation_m[0] == x
        np.testing.assert_allclose(found.footprint.vertices_m, [[x, 0.0]])


def test_a_camera_is_found_by_its_frame_or_by_its_mount() -> None:
    """A mounted one sits on the base and looks along +x; one with a frame is where that is."""
    robots, frames = tracker()
    mounted = mounted_camera(VIEW, (0.1, 0.0, 1.0, 0.0, 0.0, 0.0))
    framed = Camera(VIEW, "lens", RigidTransform.planar(9.0, 9.0, 0.0))
    assert robots.map_from_camera(mounted, 100) is None
    frames.set_transform("map", "base_link", 100, (1.0, 2.0, 0.0), NO_TURN)
    on_base = robots.map_from_camera(mounted, 120)
    assert on_base is not None
    np.testing.assert_allclose(on_base.translation_m, (1.1, 2.0, 1.0))
    np.testing.assert_allclose(on_base.rotation_matrix()[:, 2], (1.0, 0.0, 0.0), atol=1e-12)
    assert robots.map_from_camera(framed, 120) is None
    assert "lens" in robots.camera_missing
    frames.set_static("base_link", "lens", (0.0, 0.0, 0.7), NO_TURN)
    in_frame = robots.map_from_camera(framed, 120)
    assert in_frame is not None
    np.testing.assert_allclose(in_frame.translation_m, (1.0, 2.0, 0.7))


def test_the_base_is_the_usual_frame_that_is_joined_to_the_map() -> None:
    """A base_footprint that hangs on nothing is not it, and the choice is kept."""
    frames = FrameTree()
    observer = Observer("robot", "", Footprint.disc(0.2))
    robots = RobotTracker(observer, frames, "map", 10**9)
    frames.set_transform("map", "base_link", 100, (1.0, 2.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    frames.set_static("base_footprint", "imu", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    assert robots.pose(100) is not None
    assert robots.base_frame() == "base_link"
    frames.set_static("base_link", "base_footprint", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    assert robots.base_frame() == "base_link"
