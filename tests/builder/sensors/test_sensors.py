"""The sensor path: what waits, for what and how long; and the scans of several topics."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.builder.sensors.sensor_path import SensorPath, SensorPathCounts
from are_ros.conventions import NS_PER_S
from are_ros.errors import InputError
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.transforms.tree import FrameTree

WAIT_NS = 50
HISTORY_NS = 1000
NO_TURN = (0.0, 0.0, 0.0, 1.0)
NONE = np.empty(0, dtype=np.float32)
SCAN = LaserScan("laser", 0, 0.0, 1.0, 1.0, 0.0, 0.1, 0.1, 10.0, np.full(2, 5.0, np.float32), NONE)


class Path:
    """A sensor path whose augmentation writes the laser's x into the ranges; x is its stamp."""

    def __init__(self) -> None:
        self.frames = FrameTree()
        self.frames.set_static("base", "laser", (0.25, 0.0, 0.0), NO_TURN)
        self.queue = SensorPath(
            self.frames, "map", self._odometry_frame, WAIT_NS, HISTORY_NS, self._marked
        )

    def _odometry_frame(self) -> str:
        return "odom" if self.frames.has_frame("odom") else ""

    @staticmethod
    def _marked(scan: LaserScan, pose: RigidTransform) -> LaserScan:
        x = np.full(2, pose.translation_m[0], dtype=np.float32)
        return scan.with_ranges(x, scan.intensities)

    def odom(self, stamp_ns: int) -> None:
        """Take odometry: the robot is at x = stamp."""
        self.frames.set_transform("odom", "base", stamp_ns, (float(stamp_ns), 0, 0), NO_TURN)

    def correction(self, stamp_ns: int, x: float = 0.0) -> None:
        """Take map -> odom."""
        self.frames.set_transform("map", "odom", stamp_ns, (x, 0, 0), NO_TURN)

    def push(self, stamp_ns: int, received_ns: int) -> None:
        """Take a scan."""
        self.queue.push("scan", replace(SCAN, stamp_ns=stamp_ns), received_ns)

    def out(self) -> list[tuple[int, float, int, bool]]:
        """Return stamp, x, release and whether augmented, of all that was released."""
        return [
            (r.reading.stamp_ns, float(r.reading.ranges[0]), r.released_ns, r.is_augmented)
            for r in self.queue.take()
        ]

    def counts(self) -> tuple[int, int, int]:
        """Return exact, held, passed through."""
        counts = self.queue.counts
        return counts.exact, counts.held, counts.passed_through


def left_without_transform() -> Path:
    """Return the path of a scan of 10 ns that came at 20 ns, and left after its wait, at 70 ns."""
    path = Path()
    path.correction(0)
    path.odom(0)
    path.push(10, 20)
    path.queue.deadline_passed(70)
    return path


def test_how_late_the_transform_was_of_a_scan_that_left() -> None:
    """A scan leaves after its wait; its transform comes 130 ns after it, and that is known."""
    path = left_without_transform()
    assert path.queue.late_ns == 0
    path.correction(200)
    path.odom(200)
    path.queue.transforms_came(150)
    assert path.queue.late_ns == 130
    path.queue.wait_ns = 130
    assert path.queue.late_ns == 0
    path.queue.wait_ns = 50
    path.queue.transforms_came(150 + 10 * NS_PER_S)
    assert path.queue.late_ns == 130
    path.queue.transforms_came(151 + 10 * NS_PER_S)
    assert path.queue.late_ns == 0  # that was long ago


def test_transforms_that_failed_to_come_for_a_while_are_no_late_ones() -> None:
    """No wait would have been long enough: poses of artefacts are kept for 1000 ns."""
    path = left_without_transform()
    path.correction(900)
    path.odom(900)
    path.queue.transforms_came(800)
    assert path.queue.late_ns == 0


def test_the_last_scans_before_an_outage_ended_do_not_ask_for_a_longer_wait() -> None:
    """Transforms fail to come for 800 ns; the scan of its last 300 ns is found with the first."""
    path = left_without_transform()
    path.push(510, 520)
    path.queue.deadline_passed(570)
    path.correction(900)
    path.odom(900)
    path.queue.transforms_came(820)
    assert path.queue.late_ns == 0


def test_nor_do_they_where_localization_is_one_message_behind_odometry() -> None:
    """Odometry fails to come for 800 ns; of the last scan map->odom is still awaited then."""
    path = left_without_transform()
    path.push(510, 520)
    path.queue.deadline_passed(570)
    path.correction(400)
    path.odom(900)
    path.queue.transforms_came(820)
    path.correction(600)
    path.queue.transforms_came(830)
    assert path.queue.late_ns == 0
    path.push(1000, 1010)
    path.queue.deadline_passed(1060)
    path.correction(1100)
    path.odom(1100)
    path.queue.transforms_came(1140)
    assert path.queue.late_ns == 130  # of a later scan it is told


def test_a_scan_older_than_the_kept_poses_passes_through() -> None:
    """Nobody knows any more where the artefacts were, though the transform is known."""
    path = Path()
    for stamp_ns in (0, 2000):
        path.correction(stamp_ns)
        path.odom(stamp_ns)
    path.push(1000, 2000)
    path.push(999, 2000)
    assert path.out() == [(1000, 1000.25, 2000, True), (999, 5.0, 2000, False)]
    assert path.counts() == (1, 0, 1)
    assert "poses.history" in path.queue.last_problem


def test_a_late_scan_older_than_the_kept_poses_passes_through() -> None:
    """It waited, and the correction could be held; but where artefacts were is not known."""
    path = Path()
    path.correction(0)
    for stamp_ns in (0, 2000):
        path.odom(stamp_ns)
    path.push(500, 1480)
    path.queue.deadline_passed(1530)
    assert path.counts() == (0, 0, 1)
    assert "poses.history" in path.queue.last_problem


def test_a_transform_that_never_comes_hides_no_late_one() -> None:
    """The first scan is of before all transforms, and given up; that of the second comes late."""
    path = Path()
    path.correction(0)
    path.odom(0)
    path.push(-5, 10)
    path.queue.deadline_passed(60)
    path.push(1100, 1110)
    path.queue.deadline_passed(1160)
    path.correction(1200)
    path.odom(1200)
    path.queue.transforms_came(1240)
    assert path.queue.late_ns == 130
    path.queue.clear()
    assert path.queue.late_ns == 0


def test_a_scan_whose_transform_is_there_leaves_at_once() -> None:
    """At the pose of its own stamp, interpolated."""
    path = Path()
    for stamp_ns in (0, 100):
        path.correction(stamp_ns)
        path.odom(stamp_ns)
    path.push(40, 105)
    assert path.out() == [(40, 40.25, 105, True)]
    assert path.out() == []
    assert path.counts() == (1, 0, 0)
    assert path.queue.next_deadline_ns() is None


def test_a_scan_waits_for_its_transform() -> None:
    """It leaves when that comes, still at its own stamp."""
    path = Path()
    path.correction(0)
    path.odom(0)
    path.push(40, 42)
    assert path.queue.next_deadline_ns() == 92
    path.odom(100)
    path.queue.transforms_came(60)
    assert path.out() == []
    path.correction(100)
    path.queue.transforms_came(80)
    assert path.out() == [(40, 40.25, 80, True)]


def test_after_the_wait_the_last_correction_is_held() -> None:
    """The latest map->odom not after the stamp, with odometry of the very stamp."""
    path = Path()
    path.correction(0, x=1000.0)
    path.correction(30, x=2000.0)
    path.odom(0)
    path.odom(100)
    path.push(40, 42)
    path.queue.deadline_passed(91)
    assert path.out() == []
    path.queue.deadline_passed(92)
    assert path.out() == [(40, 2040.25, 92, True)]
    assert path.counts() == (0, 1, 0)


def test_odometry_is_never_held() -> None:
    """Where it is missing the scan passes through as it came, is counted, and the reason told."""
    path = Path()
    path.correction(0)
    path.correction(100)
    path.odom(0)
    path.odom(30)
    path.push(40, 42)
    path.queue.deadline_passed(92)
    assert path.out() == [(40, 5.0, 92, False)]
    assert path.counts() == (0, 0, 1)
    assert path.queue.last_problem


def test_the_usual_reason_is_told_apart_from_the_last_one() -> None:
    """Three scans came before map -> odom began, the last one after the odometry had ended."""
    path = Path()
    path.odom(0)
    path.odom(30)
    for stamp_ns in (1, 2, 3):
        path.push(stamp_ns, 30)
    path.queue.deadline_passed(80)
    path.correction(10)
    path.push(40, 85)
    path.queue.deadline_passed(135)
    assert path.counts() == (0, 0, 4)
    usual = path.queue.usual_problem
    assert usual.readings == 3
    assert "map" in usual.text
    assert usual.text != path.queue.last_problem


def test_nobody_overtakes() -> None:
    """A scan that waits holds back the ones behind it, though theirs is known."""
    path = Path()
    path.correction(0)
    path.correction(100)
    path.odom(50)
    path.odom(100)
    path.push(40, 55)
    path.push(60, 65)
    assert path.out() == []
    path.queue.deadline_passed(105)
    path.queue.transforms_came(105)
    assert path.out() == [(40, 5.0, 105, False), (60, 60.25, 105, True)]


def test_the_end_releases_everything() -> None:
    """As well as it can be done then."""
    path = Path()
    path.correction(0)
    path.odom(0)
    path.odom(50)
    path.push(40, 42)
    path.push(60, 62)
    path.queue.flush(63)
    assert path.out() == [(40, 40.25, 63, True), (60, 5.0, 63, False)]
    assert path.queue.next_deadline_ns() is None


def test_what_waits_can_be_dropped() -> None:
    """As when the clock jumps back."""
    path = Path()
    path.push(40, 42)
    path.queue.clear()
    path.queue.flush(99)
    assert path.out() == []
    assert path.counts() == (0, 0, 0)


# --- the scans of a builder


def with_odometry(scene: Any, frame: str = "odom") -> None:
    """Receive the room, map -> odom and odom -> base_link at 0 s, and the laser."""
    scene.map(0.0)
    scene.laser(0.0)
    for parent, child in (("map", frame), (frame, "base_link")):
        scene.builder.receive_transform(
            parent, child, scene.ns(0.0), (1.0, 1.0, 0.0), NO_TURN, scene.ns(0.0)
        )


def odometry(scene: Any, t_s: float, frame: str = "odom") -> None:
    """Receive odom -> base_link, now: the robot stands still at (2, 2)."""
    now_ns = scene.ns(t_s)
    scene.builder.receive_transform(frame, "base_link", now_ns, (1.0, 1.0, 0.0), NO_TURN, now_ns)


@pytest.mark.parametrize("frame", ["odom", "odom_combined", "robot1/odom"])
def test_a_late_correction_is_held_in_the_builder(
    make_scene: Callable[..., Any], frame: str
) -> None:
    """Released at its deadline exactly, whatever comes when after it; and augmented."""
    scene = make_scene({"sensors.tf_wait": 0.05})
    with_odometry(scene, frame)
    scene.place(0, (3.0, 2.0), 0.0)
    scene.scan(0.103, stamp_s=0.1)
    odometry(scene, 0.12, frame)
    assert scene.builder.take_readings() == []
    scene.builder.advance(scene.ns(0.5))
    (released,) = scene.builder.take_readings()
    assert released.released_ns == scene.ns(0.153)
    assert released.is_augmented
    assert released.reading.ranges[180] == pytest.approx(0.8)
    counts = scene.builder.sensors.counts()["scan"]
    assert (counts.exact, counts.held, counts.passed_through) == (0, 1, 0)
    assert scene.builder.sensors.problems() == {}


def test_missing_odometry_passes_through_in_the_builder(make_scene: Callable[..., Any]) -> None:
    """Byte for byte, whoever stands in the way; the problem is told by topic."""
    scene = make_scene({"sensors.tf_wait": 0.05})
    with_odometry(scene)
    scene.place(0, (3.0, 2.0), 0.0)
    scan = scene.scan(0.103, stamp_s=0.1)
    scene.tick(0.2)
    (released,) = scene.builder.take_readings()
    assert released.reading is scan
    assert scene.builder.sensors.counts()["scan"].passed_through == 1
    assert list(scene.builder.sensors.problems()) == ["scan"]


def test_topics_do_not_wait_for_each_other(make_scene: Callable[..., Any]) -> None:
    """A scan in an unknown frame holds up its own topic only."""
    scene = make_scene({"sensors.tf_wait": 0.05})
    with_odometry(scene)
    scene.builder.receive_transform(
        "map", "odom", scene.ns(0.2), (1.0, 1.0, 0.0), NO_TURN, scene.ns(0.05)
    )
    odometry(scene, 0.2)
    scan = scene.scan(0.2, stamp_s=0.1)
    scene.builder.receive_reading("rear", replace(scan, frame_id="nowhere"), scene.ns(0.21))
    scene.builder.receive_reading("front", scan, scene.ns(0.22))
    assert [r.topic for r in scene.builder.take_readings()] == ["scan", "front"]
    scene.builder.advance(scene.ns(0.3))
    assert [r.topic for r in scene.builder.take_readings()] == ["rear"]


def test_a_moved_artefact_is_met_where_it_was_at_the_stamp(make_scene: Callable[..., Any]) -> None:
    """A scan from before the move that is released after it sees the old place."""
    scene = make_scene()
    with_odometry(scene)
    scene.place(0, (3.0, 2.0), 0.0)
    scene.map(0.11, (18, 22, 31, 33))
    scene.scan(0.149, stamp_s=0.1)
    scene.builder.advance(scene.ns(0.18))
    (state,) = scene.tick(0.18).artefacts
    assert state.ground_pose.x_m < 3.0
    scene.builder.receive_transform(
        "map", "odom", scene.ns(0.2), (1.0, 1.0, 0.0), NO_TURN, scene.ns(0.185)
    )
    odometry(scene, 0.19)
    (released,) = scene.builder.take_readings()
    assert released.reading.ranges[180] == pytest.approx(0.8)


@pytest.mark.parametrize("shape", ["box", "mesh"])
def test_the_shape_that_a_laser_meets(make_scene: Callable[..., Any], shape: str) -> None:
    """A crate's mesh fills its box, so that both are met at the same distance."""
    scene = make_scene({"sensors.shape": shape})
    scene.map(0.0)
    scene.laser(0.0)
    scene.robot(0.0, 2.0, 2.0)
    scene.robot(0.2, 2.0, 2.0)
    scene.place(0, (3.0, 2.0), 0.2)
    scene.scan(0.2)
    (released,) = scene.builder.take_readings()
    assert released.reading.ranges[180] == pytest.approx(0.8, abs=0.03)


def test_one_that_is_stuck_does_not_spoil_those_behind_it() -> None:
    """When the first has to go as it came, the next leaves at once, at its exact pose."""
    path = Path()
    path.correction(0)
    path.odom(0)
    path.push(900, 10)
    for stamp_ns in (30, 40):
        path.correction(stamp_ns)
        path.odom(stamp_ns)
    path.push(30, 41)
    assert path.out() == []
    path.queue.deadline_passed(60)
    assert path.out() == [(900, 5.0, 60, False), (30, 30.25, 60, True)]
    assert path.counts() == (1, 0, 1)


# --- what an artefact has to do with the stamp, and what walls hide


def released(scene: Any) -> Any:
    """Return the one scan that has left."""
    (one,) = scene.builder.take_readings()
    return one.reading


@pytest.mark.parametrize("rate_hz", [10.0, 5.0, 3.0])
def test_a_scan_shows_nobody_before_the_first_tick_of_its_life(
    make_scene: Callable[..., Any], rate_hz: float
) -> None:
    """An artefact is visible from the first tick not before its arrival, in all outputs alike."""
    scene, period_ns = make_scene({"builder.tick_rate": rate_hz}), round(1e9 / rate_hz)
    scene.map(0.0)
    scene.laser(0.0)
    scene.robot(0.0, 2.0, 2.0)
    arrival_ns = scene.ns(0.0) // period_ns * period_ns + 2 * period_ns - period_ns // 3
    scene.place(0, (3.0, 2.0), (arrival_ns - scene.ns(0.0)) / 1e9)
    first_tick_ns = -(-arrival_ns // period_ns) * period_ns
    for stamp_ns, is_shown in (
        (arrival_ns, False),
        (first_tick_ns - 1, False),
        (first_tick_ns, True),
        (first_tick_ns + period_ns // 2, True),
    ):
        t_s = (stamp_ns - scene.ns(0.0)) / 1e9
        scene.robot(t_s, 2.0, 2.0)
        scene.scan(t_s)
        assert (released(scene).ranges[180] < 1.0) == is_shown
    assert len(scene.builder.step(first_tick_ns + period_ns).artefacts) == 1


def test_nobody_is_in_a_scan_from_its_departure_on(make_scene: Callable[..., Any]) -> None:
    """Not even between the departure and the next tick; a nanosecond before it still is."""
    scene = make_scene()
    scene.map(0.0)
    scene.laser(0.0)
    scene.robot(0.0, 2.0, 2.0)
    scene.place(0, (3.0, 2.0), 0.05, life_s=0.4)
    for t_s, is_shown in ((0.45 - 1e-9, True), (0.45, False), (0.46, False)):
        scene.robot(t_s, 2.0, 2.0)
        scene.scan(t_s)
        assert (released(scene).ranges[180] < 1.0) == is_shown


@pytest.mark.parametrize(
    ("real", "expected"),
    [
        (np.inf, np.inf),
        (np.nan, np.nan),
        (0.0, 0.0),
        (0.02, 0.02),
        (30.0, 30.0),
        (-np.inf, -np.inf),
        (3.0, 1.1),
        (1.05, 1.05),
    ],
)
def test_walls_hide_artefacts_where_nothing_says_that_they_are_gone(
    make_scene: Callable[..., Any], real: float, expected: float
) -> None:
    """A beam without a return ends before the wall of the map; one that has passed it does not."""
    scene = make_scene()
    scene.map(0.0, (10, 30, 26, 27))
    scene.laser(0.0)
    scene.robot(0.0, 2.0, 2.0)
    scene.robot(0.2, 2.0, 2.0)
    scene.place(0, (3.3, 2.0), 0.1)
    scene.scan(0.2, ranges=(real,) * 360)
    assert released(scene).ranges[180] == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize(
    ("blocks", "values", "is_met"),
    [
        ((), {}, True),
        (((10, 30, 36, 37),), {}, True),  # a wall behind it
        (((10, 30, 26, 27),), {"world.wall_height": 0.29}, True),  # the laser looks over it
        (((10, 30, 26, 27),), {"world.wall_height": 0.31}, False),
        (((19, 21, 20, 21),), {}, True),  # the laser stands in that very cell
        (((20, 21, 20, 22),), {}, False),  # and in this one, but the next is occupied, too
    ],
)
def test_the_surface_of_the_environment_is_what_hides(
    make_scene: Callable[..., Any],
    blocks: Any,
    values: dict[str, float],
    is_met: bool,
) -> None:
    """Walls before the hit alone, as high as they are; the laser looks out of its own voxel."""
    scene = make_scene(values)
    scene.map(0.0, *blocks)
    scene.laser(0.0)
    for t_s in (0.0, 0.2):
        scene.robot(t_s, 2.05, 2.05)
    scene.place(0, (3.3, 2.05), 0.1)
    scene.scan(0.2, ranges=(np.inf,) * 360)
    assert np.isfinite(released(scene).ranges[180]) == is_met


def test_a_cloud_hides_as_the_camera_sees_it(make_scene: Callable[..., Any]) -> None:
    """Where there are voxels, they are the surface, and not the walls of the map."""
    for heights_m, is_met in (((0.25, 0.35), False), ((0.05, 1.05), True)):
        scene = make_scene()
        scene.map(0.0, (10, 30, 26, 27))
        y, z = np.meshgrid(np.arange(1.05, 3.0, 0.1), heights_m)
        wall = np.stack((np.full(y.size, 2.65), y.ravel(), z.ravel()), axis=1)
        scene.builder.receive_cloud(wall, "map", scene.ns(0.0), 0.1)
        scene.laser(0.0)
        for t_s in (0.0, 0.2):
            scene.robot(t_s, 2.05, 2.05)
        scene.place(0, (3.3, 2.05), 0.1)
        scene.scan(0.2, ranges=(np.inf,) * 360)
        assert np.isfinite(released(scene).ranges[180]) == is_met


class Picture:
    """An image whose augmentation needs a lens of the right size."""

    frame_id, stamp_ns = "laser", 40

    def __init__(self, lens: int = 0) -> None:
        self.lens = lens

    def seen_through(self, lens: int) -> "Picture":
        """Return it with a lens."""
        return Picture(lens)

    def augmented(self, _: RigidTransform, obstacles: Obstacles) -> "Picture":
        """Return it as it is."""
        del obstacles
        return self


def picture_path() -> SensorPath:
    """Return a path of images whose transform is known."""
    frames = FrameTree()
    frames.set_static("map", "laser", (0.0, 0.0, 0.0), NO_TURN)

    def augment(image: Picture, _pose: RigidTransform) -> Picture:
        if image.lens != 640:
            raise InputError(f"it has 640 columns, and /d/camera_info {image.lens}")
        return image

    return SensorPath(frames, "map", lambda: "", WAIT_NS, HISTORY_NS, augment, "/d/camera_info")


def test_an_image_waits_for_its_lens() -> None:
    """It leaves when the first CameraInfo comes, later ones at once."""
    path = picture_path()
    path.push("/d/image", Picture(), 42)
    assert path.take() == []
    path.lens = 640
    path.transforms_came(60)
    path.push("/d/image", Picture(), 70)
    assert [(r.reading.lens, r.released_ns, r.is_augmented) for r in path.take()] == [
        (640, 60, True),
        (640, 70, True),
    ]
    assert path.counts == SensorPathCounts(exact=2)


def test_an_image_whose_lens_never_comes_passes_through() -> None:
    """After its wait, counted, and with the reason; so does one that does not fit its lens."""
    path = picture_path()
    image = Picture()
    path.push("/d/image", image, 42)
    path.deadline_passed(92)
    (released,) = path.take()
    assert (released.reading, released.is_augmented) == (image, False)
    assert path.last_problem == (
        "no CameraInfo that can be used has come on /d/camera_info"
        " (sensors.camera_infos takes one from elsewhere)"
    )
    path.lens = 320
    path.push("/d/image", Picture(), 100)
    (released,) = path.take()
    assert (released.reading.lens, released.is_augmented) == (320, False)
    assert path.last_problem == "it has 640 columns, and /d/camera_info 320"
    assert path.counts == SensorPathCounts(passed_through=2)
