"""What others expect of the robot: its velocity from the poses of the last quarter second."""

import math

import pytest

from are_ros.agents.local_planner.robot import RobotMotion
from are_ros.agents.robots import RobotPose, RobotWatch
from are_ros.conventions import NS_PER_S
from are_ros.world.footprint import Footprint
from are_ros.world.rigid_transform import RigidTransform

DISC = Footprint.disc(0.2)


def pose(t_s: float, x_m: float, y_m: float = 0.0, yaw_rad: float = 0.0) -> RobotPose:
    """Return the robot, seen at a time."""
    place = RigidTransform.planar(x_m, y_m, yaw_rad)
    return RobotPose(round(t_s * NS_PER_S), place, DISC.at(x_m, y_m, yaw_rad))


def seen(watch: RobotWatch, robot: RobotPose, t_s: float | None = None) -> RobotMotion:
    """Let the watch see a pose, at its stamp if nothing else is said."""
    return watch.see(robot, robot.stamp_ns if t_s is None else round(t_s * NS_PER_S))


def test_a_first_pose_stands() -> None:
    """Where it is, with its footprint, and no velocity."""
    motion = seen(RobotWatch(), pose(1.0, 3.0, 2.0, 0.5))
    assert (motion.x_m, motion.y_m, motion.yaw_rad) == pytest.approx((3.0, 2.0, 0.5))
    assert (motion.vx_mps, motion.vy_mps, motion.yaw_rate) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("rate_hz", [5.0, 20.0, 100.0])
def test_steady_motion_is_measured_whatever_the_rate(rate_hz: float) -> None:
    """Half a metre per second along y, turning at 1 rad/s through pi."""
    watch = RobotWatch()
    for k in range(1, round(2.0 * rate_hz) + 1):
        t_s = k / rate_hz
        motion = seen(watch, pose(t_s, 1.0, 0.5 * t_s, math.remainder(2.0 + t_s, math.tau)))
    assert (motion.vx_mps, motion.vy_mps) == pytest.approx((0.0, 0.5), abs=1e-6)
    assert motion.yaw_rate == pytest.approx(1.0, abs=1e-6)


def test_noise_of_poses_is_averaged() -> None:
    """Poses at 100 Hz that jitter by 2 mm make no more than 2 cm/s."""
    watch = RobotWatch()
    for k in range(100):
        motion = seen(watch, pose(0.01 * k, 0.002 * (k % 2)))
    assert abs(motion.vx_mps) < 0.02


def test_a_pose_that_is_not_renewed_stands_after_half_a_second() -> None:
    """Until then it goes on as it did."""
    watch = RobotWatch()
    for k in range(10):
        last = pose(0.1 * k, 0.05 * k)
        seen(watch, last)
    assert seen(watch, last, 1.4).vx_mps == pytest.approx(0.5)
    assert seen(watch, last, 1.41).vx_mps == 0.0


def test_a_jump_is_no_motion() -> None:
    """A correction by more than a metre; soon after, the motion from there counts."""
    watch = RobotWatch()
    for k in range(5):
        seen(watch, pose(0.1 * k, 0.05 * k))
    assert seen(watch, pose(0.5, 9.0)).vx_mps == 0.0
    for k in range(1, 5):
        motion = seen(watch, pose(0.5 + 0.1 * k, 9.0 + 0.05 * k))
    assert motion.vx_mps == pytest.approx(0.5)


def test_poses_that_go_back_in_time_begin_anew() -> None:
    """The clock jumped: what came before says nothing."""
    watch = RobotWatch()
    seen(watch, pose(5.0, 0.0))
    assert seen(watch, pose(4.9, 0.3)).vx_mps == 0.0
    watch.forget()
    assert seen(watch, pose(5.1, 0.6)).vx_mps == 0.0


@pytest.mark.parametrize(("speed_mps", "rate_hz"), [(6.0, 50.0), (9.0, 10.0), (1.2, 1.0)])
def test_a_fast_robot_is_no_jump(speed_mps: float, rate_hz: float) -> None:
    """It drives more than a metre while its velocity is measured, or between two poses."""
    watch = RobotWatch()
    for k in range(round(2.0 * rate_hz) + 1):
        motion = seen(watch, pose(k / rate_hz, speed_mps * k / rate_hz))
    assert motion.vx_mps == pytest.approx(speed_mps)


def test_another_pose_at_the_same_stamp_begins_anew() -> None:
    """Localization corrected it: how the robot moved between the two is not known."""
    watch = RobotWatch()
    seen(watch, pose(1.0, 0.0))
    seen(watch, pose(1.2, 0.1))
    assert seen(watch, pose(1.2, 0.2)).vx_mps == 0.0
    assert seen(watch, pose(1.3, 0.25)).vx_mps == pytest.approx(0.5)


def test_the_velocity_is_that_of_the_last_quarter_second() -> None:
    """Whatever it was before."""
    watch = RobotWatch()
    seen(watch, pose(0.75, 0.4))
    seen(watch, pose(1.0, 0.0))
    assert seen(watch, pose(1.25, 0.1)).vx_mps == pytest.approx(0.4)
