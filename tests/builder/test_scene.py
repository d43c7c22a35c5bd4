"""The artefacts as they go out: ground truth, and what is perceived of it."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from are_ros.agents.events import Sighting
from are_ros.agents.trajectory_buffer import TrajectoryBuffer
from are_ros.builder.observation import perceived_artefact
from are_ros.builder.occlusion.meshes import MeshBank
from are_ros.builder.scene import Scene
from are_ros.conventions import NS_PER_S
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow
from tests.agents.histories import GivenPoses
from tests.builder.truth import artefact_state

HERE = GroundPose(1.0, 2.0, 0.5, math.pi / 2)


@pytest.fixture
def row(make_scene: Callable[..., Any]) -> CatalogueRow:
    """Return a crate whose centre of mass is not its box's centre."""
    crate: CatalogueRow = make_scene().row(1)
    return replace(crate, box_centre_in_artefact_m=(0.1, 0.0, 0.05), features={"mass_kg": "4"})


def an_artefact(row: CatalogueRow, departure_ns: int | None = 900) -> Artefact:
    """Return an artefact that stands since 0."""
    return Artefact(7, row, Origin.SCRIPTED, 100, PoseHistory(100, HERE), departure_ns)


def test_the_ground_truth_of_one_that_stands(row: CatalogueRow) -> None:
    """F_A is the centre of mass, over the pose on the ground; the twist is 0."""
    state = artefact_state(an_artefact(row), 500)
    assert (state.artefact_id, state.row, state.label) == (7, 1, "crate")
    np.testing.assert_allclose(state.map_from_artefact.translation_m, (1.0, 2.0, 0.5 + 0.15 - 0.05))
    assert state.map_from_artefact.yaw_rad() == pytest.approx(math.pi / 2)
    assert state.ground_pose == HERE
    assert (state.arrival_ns, state.departure_ns, state.origin) == (100, 900, Origin.SCRIPTED)
    assert state.linear_velocity_m_s == state.angular_velocity_rad_s == (0.0, 0.0, 0.0)
    assert state.features == {"mass_kg": "4"}
    assert (state.class_name, state.size_m) == ("thing", (0.6, 0.3, 0.3))


def test_an_end_that_is_not_known_is_0(row: CatalogueRow) -> None:
    """As are_msgs/Artefact says it."""
    assert artefact_state(an_artefact(row, None), 500).departure_ns == 0


def test_the_twist_of_one_that_moves_is_in_its_own_frame(row: CatalogueRow) -> None:
    """Heading +y at 2 m/s along +y is 2 m/s forward; a turn is about z."""
    artefact = an_artefact(row, None)
    start_ns, end_ns = NS_PER_S, 2 * NS_PER_S
    artefact.history = moved = GivenPoses(100, HERE)
    moved.append(start_ns, HERE)
    moved.append(end_ns, GroundPose(1.0, 4.0, 0.5, math.pi / 2))
    state = artefact_state(artefact, NS_PER_S * 3 // 2)
    assert state.linear_velocity_m_s == pytest.approx((2.0, 0.0, 0.0), abs=1e-6)
    turning = an_artefact(row, None)
    turning.history = turned = GivenPoses(100, HERE)
    turned.append(start_ns, HERE)
    turned.append(end_ns, GroundPose(1.0, 2.0, 0.5, math.pi / 2 + 0.8))
    assert artefact_state(turning, NS_PER_S * 3 // 2).angular_velocity_rad_s == pytest.approx(
        (0.0, 0.0, 0.8)
    )


def test_a_scene_tells_the_status_of_its_instant(row: CatalogueRow) -> None:
    """Also when the artefacts have gone on since; and whether they have."""
    artefact = an_artefact(row)
    scene = Scene.of([artefact], 200)
    assert scene.shows([artefact])
    assert not scene.shows([])
    artefact.departure_ns, artefact.behaviour, artefact.activity = 800, "stopping", "waiting"
    assert not scene.shows([artefact])
    then, now = scene.state(0), artefact_state(artefact, 300)
    assert (then.departure_ns, then.behaviour, then.activity) == (900, "standing", "")
    assert (now.departure_ns, now.behaviour, now.activity) == (800, "stopping", "waiting")
    assert now.features == {"mass_kg": "4", "activity": "waiting"}


def test_the_columns_are_those_of_the_states(row: CatalogueRow) -> None:
    """Poses of F_A and twists to the bit; none for none."""
    pushed = GivenPoses(100, HERE)
    pushed.append(2 * NS_PER_S, GroundPose(4.0, 1.0, 0.7, -2.0))
    artefacts = [an_artefact(row), replace(an_artefact(row), id=8, history=pushed)]
    scene = Scene.of(artefacts, NS_PER_S)
    states = [scene.state(k) for k in range(2)]
    poses = [
        (*s.map_from_artefact.translation_m, *s.map_from_artefact.rotation_xyzw) for s in states
    ]
    np.testing.assert_array_equal(scene.poses, poses)
    twists = [(*s.linear_velocity_m_s[:2], s.angular_velocity_rad_s[2]) for s in states]
    np.testing.assert_array_equal(scene.twists, twists)
    assert scene.ground_poses == tuple(s.ground_pose for s in states)
    assert scene.only({8}).ids.tolist() == [8]
    empty = Scene.of([], 0)
    assert (empty.poses.shape, empty.twists.shape, len(empty.boxes)) == ((0, 7), (0, 3), 0)


def test_who_turns_away_and_back_moves_where_it_is_as_before(row: CatalogueRow) -> None:
    """The same pose again is not the same velocity: that of the motion to come."""
    step_ns = NS_PER_S // 20
    buffer, ids = TrajectoryBuffer(), np.array([7])
    artefact = replace(an_artefact(row), history=buffer.begin(7, 0, HERE))
    standing = artefact_state(artefact, 100)
    here, away = np.array([HERE]), np.array([HERE._replace(yaw_rad=HERE.yaw_rad + 0.1)])
    buffer.record(step_ns, 2 * step_ns, ids, here, away)
    buffer.record(2 * step_ns, 3 * step_ns, ids, away, here)
    buffer.record(3 * step_ns, 4 * step_ns, ids, here, away)
    found = [artefact_state(artefact, k * step_ns) for k in (1, 3, 4)]
    assert found[0].ground_pose == found[1].ground_pose == standing.ground_pose
    turns = [state.angular_velocity_rad_s[2] for state in (standing, *found)]
    assert turns == pytest.approx([0.0, 2.0, 2.0, 0.0])


def test_what_is_perceived_holds_no_uncertainty_of_its_own(row: CatalogueRow) -> None:
    """One class, certain; the fraction is visible over unoccluded pixels."""
    state = artefact_state(an_artefact(row), 500)
    sighting = Sighting(30, 120, (4, 5, 6, 7), 2.5, 450, ("eye",))
    seen = perceived_artefact(state, sighting)
    assert (seen.artefact_id, seen.label) == (7, "crate")
    assert (seen.classes, seen.probabilities, seen.existence) == (("thing",), (1.0,), 1.0)
    assert seen.sighting == sighting
    assert seen.sighting.visible_fraction == 0.25
    assert set(seen.pose_covariance) == set(seen.twist_covariance) == {0.0}
    assert seen.map_from_artefact is state.map_from_artefact
    assert not hasattr(seen, "departure_ns")


def test_the_bank_selects_a_mesh_for_each_artefact(make_scene: Callable[..., Any]) -> None:
    """Rows of the same type share theirs; a newcomer moves nobody."""
    scene, bank = make_scene(), MeshBank()
    post, crate, screen = (scene.row(i) for i in range(3))
    first = bank.selection((post, crate, post))
    assert first.indices.tolist() == [0, 1, 0]
    assert bank.selection((screen, crate)).indices.tolist() == [2, 1]
    assert bank.selection((post, crate, post)).indices.tolist() == [0, 1, 0]
