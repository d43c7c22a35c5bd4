"""One observer's looks: how often, at what, and what they say; and the z-buffer behind them."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from are_ros.agents.events import EventKind, Sighting
from are_ros.agents.robots import RobotTracker
from are_ros.builder.assembly import catalogue_of
from are_ros.builder.observation import (
    CameraObserver,
    Observation,
    Watch,
    joined,
    sight_events,
)
from are_ros.builder.occlusion.meshes import MeshBank
from are_ros.builder.scene import Scene
from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import Shape
from are_ros.parameters.model import OcclusionParameters, Parameters
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow
from are_ros.world.cameras import (
    FORWARD_FROM_OPTICAL,
    Camera,
    Observer,
    PinholeView,
    mounted_camera,
)
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.footprint import Footprint
from are_ros.world.occupancy_grid import classify
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.transforms.tree import FrameTree
from are_ros.world.voxel_map import VoxelMap

NO_TURN = (0.0, 0.0, 0.0, 1.0)
MS = NS_PER_S // 1000
CAMERA = mounted_camera(
    PinholeView.from_field_of_view(64, 48, np.pi / 2), (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
)
BOXES = OcclusionParameters(tau=0, shape=Shape.BOX)


@pytest.fixture
def post(make_scene: Callable[..., Any]) -> CatalogueRow:
    """Return a row: a post of 0.4 x 0.4 x 1.6 m."""
    row: CatalogueRow = make_scene().row(0)
    return row


@pytest.fixture
def environment(make_scene: Callable[..., Any]) -> Environment:
    """Return the room, its walls extruded."""
    grid = make_scene().room()
    classes = classify(grid, 65, 25)
    voxels = VoxelMap.extruded(grid, classes.occupied, 2.5, 0.0)
    return Environment(grid, classes, voxels, PlaneGround(0.0), 0.01)


def standing(row: CatalogueRow, *places: tuple[float, float]) -> Scene:
    """Return a scene of artefacts 1, 2, ... of one row."""
    artefacts = [
        Artefact(i + 1, row, Origin.SCRIPTED, 0, PoseHistory(0, GroundPose(x, y, 0.0, 0.0)))
        for i, (x, y) in enumerate(places)
    ]
    return Scene.of(artefacts, 0)


def watches(*rates_hz: float, tick_rate_hz: float = 10.0) -> tuple[Watch, FrameTree]:
    """Return the cameras of a robot at (1, 2) since 0, and its frames."""
    frames = FrameTree()
    frames.set_transform("map", "base_link", 0, (1.0, 2.0, 0.0), NO_TURN)
    robots = RobotTracker(Observer("robot", "", Footprint.disc(0.2)), frames, "map", 500 * MS)
    return Watch(robots, MeshBank(), rates_hz, tick_rate_hz), frames


def watch(rate_hz: float, tick_rate_hz: float = 10.0) -> tuple[CameraObserver, FrameTree]:
    """Return the only camera of such a robot, and its frames."""
    eyes, frames = watches(rate_hz, tick_rate_hz=tick_rate_hz)
    return eyes.eyes[0], frames


def test_a_look_tells_pose_and_sightings(post: CatalogueRow, environment: Environment) -> None:
    """Who stands ahead, with pixels, the rectangle around them and the distance of the face."""
    eye, _ = watch(10.0)
    seen = eye.observe(100, CAMERA, environment, standing(post, (2.5, 2.0), (0.5, 2.0)), BOXES)
    assert list(seen.sightings) == [1]
    sight = seen.sightings[1]
    assert sight.range_m == pytest.approx(1.3, abs=0.01)
    assert sight.visible_pixels == sight.unoccluded_pixels
    x, y, width, height = sight.roi_px
    assert sight.visible_pixels == width * height
    assert x + 0.5 * width == pytest.approx(32.0, abs=0.5)
    focal_px, depth_m = 32.0, 1.3
    assert width == pytest.approx(0.4 / depth_m * focal_px, abs=1.01)
    assert y == pytest.approx(24.0 - 0.6 / depth_m * focal_px, abs=1.01)
    assert seen.map_from_camera is not None
    np.testing.assert_allclose(seen.map_from_camera.translation_m, (1.0, 2.0, 1.0))
    assert (seen.seen_ns, eye.looks) == (100, 1)


@pytest.mark.parametrize(
    ("rate_hz", "looks"), [(2.0, [0, 5]), (5.0, [0, 2, 4, 6, 8]), (10.0, list(range(10)))]
)
def test_looks_come_at_the_cameras_rate(
    post: CatalogueRow, environment: Environment, rate_hz: float, looks: list[int]
) -> None:
    """On the first tick of each period; in between the last look stands."""
    eye, frames = watch(rate_hz)
    seen_ns = []
    for tick in range(10):
        now_ns = tick * 100 * MS
        frames.set_transform("map", "base_link", now_ns + 1, (1.0, 2.0, 0.0), NO_TURN)
        seen = eye.observe(now_ns, CAMERA, environment, standing(post, (2.5, 2.0)), BOXES)
        seen_ns.append(seen.seen_ns // (100 * MS))
    assert sorted(set(seen_ns)) == looks
    assert seen_ns == sorted(seen_ns)


def test_who_departed_between_looks_is_not_seen(
    post: CatalogueRow, environment: Environment
) -> None:
    """Nor is who has come since the last look."""
    eye, _ = watch(2.0)
    both = standing(post, (2.5, 1.5), (2.5, 2.5))
    assert list(eye.observe(0, CAMERA, environment, both, BOXES).sightings) == [1, 2]
    held = eye.observe(100 * MS, CAMERA, environment, both.only(frozenset({2})), BOXES)
    assert list(held.sightings) == [2]
    assert held.seen_ns == 0


def test_without_a_pose_nothing_is_seen_and_no_look_is_counted(
    post: CatalogueRow, environment: Environment
) -> None:
    """Too old a pose is none."""
    eye, _ = watch(10.0)
    seen = eye.observe(501 * MS, CAMERA, environment, standing(post, (2.5, 2.0)), BOXES)
    assert seen.map_from_camera is None
    assert dict(seen.sightings) == {}
    assert eye.looks == 0
    assert "0.501 s old" in eye.missing


def test_standing_by_tells_only_where_the_robot_is() -> None:
    """No look, no camera."""
    eyes, _ = watches(10.0)
    seen = eyes.stand_by(100)
    assert seen.map_from_base is not None
    assert seen.map_from_camera is None
    assert dict(seen.sightings) == {}


def test_what_was_seen_can_be_forgotten(post: CatalogueRow, environment: Environment) -> None:
    """After a jump of the clock, the next tick looks anew."""
    eye, _ = watch(2.0)
    eye.observe(100 * MS, CAMERA, environment, standing(post, (2.5, 2.0)), BOXES)
    eye.forget()
    seen = eye.observe(200 * MS, CAMERA, environment, standing(post, (2.5, 2.0)), BOXES)
    assert seen.seen_ns == 200 * MS
    assert Observation().sightings == {}


REAR = Camera(CAMERA.view, "rear", RigidTransform.identity())


def test_what_several_cameras_see_is_one_list_that_says_which_saw_it(
    post: CatalogueRow, environment: Environment
) -> None:
    """The one looks ahead, the other back, at a rate of its own; each keeps what it saw."""
    eyes, frames = watches(10.0, 2.0)
    turned = RigidTransform.planar(0.0, 0.0, np.pi, 1.0) @ FORWARD_FROM_OPTICAL
    pose = turned.translation_m.tolist(), turned.rotation_xyzw.tolist()
    frames.set_static("base_link", "rear", *pose)
    both = standing(post, (2.5, 2.0), (0.4, 2.0))
    first = eyes.observe(0, [CAMERA, REAR], environment, both, BOXES)
    assert {i: one.cameras for i, one in first.sightings.items()} == {1: ("camera",), 2: ("rear",)}
    assert [look.number for look in first.looks or ()] == [0, 1]
    later = eyes.observe(100 * MS, [CAMERA, REAR], environment, both, BOXES)
    assert [one.seen_ns for _, one in sorted(later.sightings.items())] == [100 * MS, 0]
    assert [look.number for look in later.looks or ()] == [0]
    gone = eyes.observe(200 * MS, [CAMERA, REAR], environment, both.only(frozenset({1})), BOXES)
    assert list(gone.sightings) == [1]
    assert (eyes.looks, eyes.missing) == (4, "")


def test_a_camera_without_a_pose_or_a_camera_info_leaves_the_others_alone(
    post: CatalogueRow, environment: Environment
) -> None:
    """The sentence names its frame."""
    eyes, _ = watches(10.0, 10.0)
    alone = standing(post, (2.5, 2.0))
    assert list(eyes.observe(0, [CAMERA, None], environment, alone, BOXES).sightings) == [1]
    assert eyes.missing == ""
    assert list(eyes.observe(100 * MS, [CAMERA, REAR], environment, alone, BOXES).sightings) == [1]
    assert "rear" in eyes.missing
    assert eyes.observe(200 * MS, [None, REAR], environment, alone, BOXES).map_from_camera is None


def test_the_camera_that_sees_more_tells_the_numbers() -> None:
    """With equal numbers the first one does."""
    one, other = (
        Sighting(5, 9, (0, 0, 3, 3), 2.0, 7, ("a",)),
        Sighting(6, 9, (1, 1, 3, 3), 3.0, 8, ("b",)),
    )
    assert joined(one, other) == Sighting(6, 9, (1, 1, 3, 3), 3.0, 8, ("b", "a"))
    assert joined(other, one) == joined(one, other)
    same = Sighting(5, 9, (2, 2, 3, 3), 2.5, 9, ("c",))
    assert joined(one, same) == Sighting(5, 9, (0, 0, 3, 3), 2.0, 7, ("a", "c"))


def look(
    environment: Environment, scene: Scene, settings: OcclusionParameters, eye: CameraObserver
) -> list[int]:
    """Return who is perceived from (1, 2)."""
    pose = RigidTransform.planar(1.0, 2.0, 0.0) @ CAMERA.base_from_optical
    return list(eye.look(0, CAMERA, pose, environment, scene, settings))


def test_the_newest_environment_and_settings_count(
    post: CatalogueRow, environment: Environment, make_scene: Callable[..., Any]
) -> None:
    """One observer serves them all in turn: a wall, then none, a range too short, a high tau."""
    grid = make_scene().room((10, 30, 20, 22))
    classes = classify(grid, 65, 25)
    voxels = VoxelMap.extruded(grid, classes.occupied, 2.5, 0.0)
    walled = Environment(grid, classes, voxels, PlaneGround(0.0), 0.01)
    (eye, _), scene = watch(10.0), standing(post, (2.8, 2.0))
    near = OcclusionParameters(tau=0, shape=Shape.BOX, max_range=1.5)
    strict = OcclusionParameters(tau=3000, shape=Shape.BOX)
    meshes = OcclusionParameters(tau=0, shape=Shape.MESH)
    assert look(walled, scene, BOXES, eye) == []
    assert look(environment, scene, BOXES, eye) == [1]
    assert look(environment, scene, near, eye) == []
    assert look(environment, scene, strict, eye) == []
    assert look(environment, scene, meshes, eye) == [1]
    assert look(environment, standing(post), BOXES, eye) == []


def test_an_environment_without_voxels_hides_nothing(
    post: CatalogueRow, environment: Environment
) -> None:
    """Only other artefacts do."""
    bare = Environment(environment.grid, environment.classes, None, PlaneGround(0.0), 0.01)
    scene = standing(post, (6.0, 2.0), (2.0, 2.9))
    assert look(bare, scene, BOXES, watch(10.0)[0]) == [1, 2]


def test_sight_events_in_the_order_of_ids() -> None:
    """First who came into sight, then who was lost; the departed are not lost."""
    before, now, living = {1: "a", 4: "b", 9: "c"}, {4: "b", 7: "d"}, {4: "b", 7: "d", 9: "c"}
    events = sight_events(5, before, now, living)
    assert [(e.kind, e.artefact_id, e.label, e.stamp_ns) for e in events] == [
        (EventKind.PERCEIVED, 7, "d", 5),
        (EventKind.LOST, 9, "c", 5),
    ]


def test_a_body_is_perceived_by_its_own_pixels_if_the_target_is_its_mesh(
    environment: Environment,
) -> None:
    """Its box has more pixels; both count what is visible of them."""
    row = next(r for r in catalogue_of(Parameters()).rows if r.label == "person_adult")
    eye, _ = watch(10.0)
    scene, pose = standing(row, (2.5, 2.0)), RigidTransform.from_xyz_ypr(1, 2, 1, 0, 0, 0)
    found = [
        eye.look(0, CAMERA, pose @ FORWARD_FROM_OPTICAL, environment, scene, settings)[1]
        for settings in (OcclusionParameters(tau=0), OcclusionParameters(tau=0, target=Shape.MESH))
    ]
    assert 0.2 < found[1].unoccluded_pixels / found[0].unoccluded_pixels < 0.8
    assert [one.visible_fraction for one in found] == [1.0, 1.0]
    assert found[1].range_m >= found[0].range_m
