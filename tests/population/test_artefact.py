"""Poses as a function of time, lives, and boxes of artefacts."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.conventions import NS_PER_S
from are_ros.population.artefact import (
    Artefact,
    GroundPose,
    Origin,
    PoseHistory,
    boxes_of,
    map_from_artefact,
)
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.shapes import Shape
from tests.agents.histories import GivenPoses

MS = 1_000_000
HERE = GroundPose(1.0, 2.0, 0.0, 0.5)
THERE = GroundPose(3.0, 0.0, 0.2, 1.5)


def row() -> CatalogueRow:
    """Make a row whose centre of mass lies low, behind and left of its box's centre."""
    return CatalogueRow(0, "a_car", "car", (4.0, 2.0, 1.5), (0.3, -0.1, 0.25), Shape.CAR)


def test_a_standing_artefact_keeps_one_pose_for_ever() -> None:
    """With a single pose every instant has that pose."""
    history = PoseHistory(5 * MS, HERE)
    assert [history.pose_at(t) for t in (-1, 0, 5 * MS, 10**18)] == [HERE] * 4
    assert (history.latest, history.latest_ns) == (HERE, 5 * MS)
    assert history.velocity_at(5 * MS) == (0.0, 0.0, 0.0)


def test_between_two_poses_position_and_yaw_are_linear() -> None:
    """Half way in time is half way in space and turn; outside, the ends are held."""
    history = GivenPoses(0, HERE)
    history.append(50 * MS, THERE)
    half = history.pose_at(25 * MS)
    assert (half.x_m, half.y_m, half.z_m, half.yaw_rad) == pytest.approx((2.0, 1.0, 0.1, 1.0))
    assert history.pose_at(-1) == HERE
    assert history.pose_at(50 * MS) == history.pose_at(51 * MS) == THERE


def test_yaw_takes_the_shorter_arc_across_the_seam() -> None:
    """From 170 to -170 degrees the way leads over 180, not over 0."""
    history = GivenPoses(0, GroundPose(0.0, 0.0, 0.0, math.radians(170)))
    history.append(100 * MS, GroundPose(0.0, 0.0, 0.0, math.radians(-170)))
    assert history.pose_at(25 * MS).yaw_rad == pytest.approx(math.radians(175))
    assert history.pose_at(75 * MS).yaw_rad == pytest.approx(math.radians(-175))


angles = st.floats(-10.0, 10.0)


@given(angles, angles, st.integers(1, 99))
def test_interpolated_yaw_is_that_of_the_interpolated_quaternion(
    start: float, end: float, percent: int
) -> None:
    """The turn is the fraction of the shorter arc between the two directions."""
    arc = math.remainder(end - start, math.tau)
    if abs(arc) > math.pi - 1e-6:
        return
    history = GivenPoses(0, GroundPose(0.0, 0.0, 0.0, start))
    history.append(100, GroundPose(0.0, 0.0, 0.0, end))
    yaw = history.pose_at(percent).yaw_rad
    a, b = np.exp(0.5j * start), np.exp(0.5j * end)
    b = b if (a.conjugate() * b).real >= 0.0 else -b
    half, fraction = abs(np.angle(a.conjugate() * b)), percent / 100
    blend = (a, b)
    if half > 1e-9:
        blend = (a * np.sin((1 - fraction) * half), b * np.sin(fraction * half))
    turned = np.exp(1j * yaw) / (np.sum(blend) / abs(np.sum(blend))) ** 2
    assert abs(turned - 1.0) < 1e-6


@given(st.lists(st.tuples(st.integers(0, 3_000), st.floats(-5, 5)), max_size=40), st.data())
def test_poses_are_those_of_numpys_interpolation(
    steps: list[tuple[int, float]], data: st.DataObject
) -> None:
    """X is numpy's linear interpolation of all poses."""
    times, xs = [0], [0.0]
    history = GivenPoses(0, GroundPose(0.0, 0.0, 0.0, 0.0))
    for wait, x in steps:
        times.append(times[-1] + wait + 1)
        xs.append(x)
        history.append(times[-1], GroundPose(x, 0.0, 0.0, 0.0))
    asked = data.draw(st.integers(times[-1] - 2_000, times[-1] + 10))
    assert history.pose_at(asked).x_m == pytest.approx(float(np.interp(asked, times, xs)))


def test_one_that_stands_is_where_it_came() -> None:
    """At any time."""
    artefact = Artefact(4, row(), Origin.SERVICE, 100, PoseHistory(100, HERE), departure_ns=200)
    assert artefact.ground_pose_at(150) == HERE
    assert artefact.behaviour == "standing"


def test_the_numbers_of_the_origins_are_those_of_the_message() -> None:
    """are_msgs/Artefact names the same three."""
    assert [(o.name, o.value) for o in Origin] == [("RANDOM", 0), ("SCRIPTED", 1), ("SERVICE", 2)]


def test_the_centre_of_mass_stands_above_the_ground_pose() -> None:
    """F_A has the pose's x, y and yaw, and the height at which the box stands on the ground."""
    transform = map_from_artefact(row(), THERE)
    np.testing.assert_allclose(transform.translation_m, (3.0, 0.0, 0.2 + 0.75 - 0.25))
    assert transform.yaw_rad() == pytest.approx(1.5)


def test_boxes_stand_on_the_ground_round_the_centre_given_in_the_artefacts_frame() -> None:
    """Box centres are F_A applied to the row's box centre; their bottoms are at the poses' z."""
    rows, poses = [row(), row()], [HERE, THERE]
    boxes = boxes_of(rows, poses)
    expected = [
        map_from_artefact(r, pose).apply(np.array([r.box_centre_in_artefact_m]))[0]
        for r, pose in zip(rows, poses, strict=True)
    ]
    np.testing.assert_allclose(boxes.centres_m, expected, atol=1e-12)
    np.testing.assert_allclose(boxes.centres_m[:, 2] - boxes.half_sizes_m[:, 2], (0.0, 0.2))
    np.testing.assert_allclose(boxes.half_sizes_m, [(2.0, 1.0, 0.75)] * 2)
    np.testing.assert_allclose(boxes.yaws_rad, (0.5, 1.5))


def test_no_artefacts_have_no_boxes() -> None:
    """An empty population is no special case."""
    assert len(boxes_of([], [])) == 0


def test_velocity_is_that_of_the_motion_under_way() -> None:
    """Between two poses their slope, at rest and outside the poses nothing, a jump is no motion."""
    history = GivenPoses(0, GroundPose(0.0, 0.0, 0.0, 3.0))
    history.append(NS_PER_S // 2, GroundPose(1.0, -0.5, 0.0, -3.0))
    turn_rad_s = 2.0 * (math.tau - 6.0)
    assert history.velocity_at(NS_PER_S // 4) == pytest.approx((2.0, -1.0, turn_rad_s))
    assert history.velocity_at(NS_PER_S // 2) == pytest.approx((2.0, -1.0, turn_rad_s))
    assert history.velocity_at(0) == (0.0, 0.0, 0.0)
    assert history.velocity_at(NS_PER_S // 2 + 1) == (0.0, 0.0, 0.0)
    history.append(NS_PER_S - 1, history.latest)
    history.append(NS_PER_S, GroundPose(9.0, 9.0, 0.0, -3.0))
    assert history.velocity_at(NS_PER_S) == (0.0, 0.0, 0.0)
