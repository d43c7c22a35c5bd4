"""The builder composed: the order of inputs and ticks, and what reaches which output when."""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.agents.events import ArtefactEvent, EventKind
from are_ros.builder.markers import MarkerAction
from are_ros.builder.tick import Demand, Tick
from are_ros.errors import FrameError, InputError, ParameterError
from are_ros.parameters.declaration import with_values
from are_ros.world.cameras import Camera, PinholeView
from are_ros.world.rigid_transform import RigidTransform

Scene = Any
"""The `Scene` of conftest, which tests cannot import."""
Make = Callable[..., Scene]
BUSY = {"population.arrival_rate": 0.2, "population.mean_life": 1.0}
NO_TURN = (0.0, 0.0, 0.0, 1.0)
SIGHT = (EventKind.PERCEIVED, EventKind.LOST)


def ids(tick: Tick) -> list[int]:
    """Return who lives."""
    return [state.artefact_id for state in tick.artefacts]


def seen(tick: Tick) -> list[int]:
    """Return who is perceived."""
    return [artefact.artefact_id for artefact in tick.perceived]


def drawn(tick: Tick, action: MarkerAction) -> set[int]:
    """Return the ids of the markers with this action."""
    markers = zip(tick.markers.looks, tick.markers.ids.tolist(), strict=True)
    return {number for look, number in markers if look.action is action}


def kinds(tick: Tick) -> list[EventKind]:
    """Return the kinds of the tick's events."""
    return [event.kind for event in tick.events]


def added_cells(tick: Tick, scene: Scene) -> int:
    """Return how many cells of the augmented map are not the real map's."""
    assert tick.grids.augmented_map is not None
    return int((tick.grids.augmented_map.cells != scene.builder.world.grid.cells).sum())


# --- what is there before anything else


def test_the_real_map_is_relayed_before_anything_else(make_scene: Make) -> None:
    """With nothing but a map, the first tick gives it out byte for byte, and its costmap."""
    scene = make_scene()
    grid = scene.map(0.0, (10, 12, 10, 20))
    tick = scene.tick(0.1)
    assert tick.grids.augmented_map.cells.tobytes() == grid.cells.tobytes()
    assert tick.grids.costmap.cells.shape == grid.cells.shape
    assert tick.grids.update is None
    assert (tick.map_from_base, tick.map_from_camera) == (None, None)
    assert (tick.artefacts, tick.perceived, tick.events) == ((), (), ())


def test_a_tick_without_any_input_says_that_nothing_is_known(make_scene: Make) -> None:
    """No map, no robot: no grids, no area, and nu is not a number."""
    tick = make_scene().tick(0.0)
    assert tick.grids.augmented_map is None
    assert tick.metrics.area_m2 == 0.0
    assert np.isnan(tick.metrics.clutter_ratio)
    assert tick.frame_id == "map"


def test_a_new_map_is_relayed_too(scene: Scene) -> None:
    """The next map replaces the first, also one of another size; an equal one is not repeated."""
    scene.tick(0.1)
    grid = scene.map(0.2, (10, 12, 10, 20))
    tick = scene.tick(0.5)
    assert tick.grids.augmented_map.cells.tobytes() == grid.cells.tobytes()
    assert tick.grids.update is None
    scene.map(0.6, (10, 12, 10, 20))
    assert scene.tick(0.9).grids.augmented_map is None


# --- bad input


@pytest.mark.parametrize(
    "change", [{"frames.map": "world"}, {"motion.step": 0.1}, {"seed": 3}, {"world.wall_height": 1}]
)
def test_only_live_parameters_change_during_a_run(scene: Scene, change: dict[str, Any]) -> None:
    """The others were half in force: with another `frames.map` each further map was refused."""
    builder, before = scene.builder, scene.builder.parameters
    values = with_values(before, {**change, "population.arrival_rate": 0.1})
    (path,) = change
    with pytest.raises(ParameterError, match=f"'{path}': it cannot change during a run"):
        builder.reconfigure(values, scene.ns(0.1))
    assert builder.parameters is before
    builder.receive_map(scene.room((5, 9, 5, 9)), scene.ns(0.2))


def test_a_map_in_another_frame_is_refused_and_changes_nothing(scene: Scene) -> None:
    """The sentence names both frames; the last good map stays in force."""
    environment = scene.builder.world.environment
    with pytest.raises(InputError, match=r"map: its frame is 'odom', but frames\.map is 'map'"):
        scene.builder.receive_map(scene.room((5, 9, 5, 9), frame_id="odom"), scene.ns(0.1))
    assert scene.builder.world.environment is environment
    assert added_cells(scene.tick(0.1), scene) == 0


@pytest.mark.parametrize(
    ("child", "translation_m", "rotation_xyzw"),
    [
        ("base_link", (float("nan"), 0.0, 0.0), NO_TURN),
        ("base_link", (2.0, 2.0, 0.0), (0.0, 0.0, 0.0, 0.0)),
        ("map", (2.0, 2.0, 0.0), NO_TURN),
        ("", (2.0, 2.0, 0.0), NO_TURN),
    ],
)
def test_a_bad_transform_is_refused_and_a_good_one_after_it_works(
    scene: Scene, child: str, translation_m: tuple[float, ...], rotation_xyzw: tuple[float, ...]
) -> None:
    """The robot stays where the last good one put it, until the next good one."""
    args = (scene.ns(0.1), translation_m, rotation_xyzw, scene.ns(0.1))
    with pytest.raises(FrameError):
        scene.builder.receive_transform("map", child, *args)
    assert scene.tick(0.1).map_from_base.translation_m.tolist() == [1.0, 2.0, 0.0]
    scene.robot(0.15, 3.0, 2.0)
    assert scene.tick(0.2).map_from_base.translation_m.tolist() == [3.0, 2.0, 0.0]


def test_bad_odometry_and_bad_clouds_are_refused(scene: Scene) -> None:
    """Each by an error of the family, and the tick goes on as before."""
    environment = scene.builder.world.environment
    with pytest.raises(FrameError):
        scene.builder.receive_odometry("map", "", 0, (np.inf, 0.0, 0.0), NO_TURN, scene.ns(0.1))
    with pytest.raises(InputError):
        scene.builder.receive_cloud(np.full((3, 3), np.nan), "map", scene.ns(0.1))
    with pytest.raises(InputError):
        scene.builder.receive_cloud(np.zeros((0, 3)), "nowhere", scene.ns(0.1), 0.1)
    assert scene.builder.world.environment is environment
    assert scene.tick(0.1).map_from_base is not None


# --- the robot and its camera


def test_a_robot_pose_that_is_too_old_perceives_nothing(scene: Scene) -> None:
    """Half a second is accepted, more is not: no poses, nothing seen, until there is a new one."""
    artefact_id = scene.place(0, (2.5, 2.0), 0.0)
    fresh, stale = scene.tick(0.5), scene.tick(0.6)
    assert seen(fresh) == [artefact_id]
    assert (seen(stale), stale.map_from_base, stale.map_from_camera) == ([], None, None)
    assert EventKind.LOST in kinds(stale)
    assert "0.600 s old" in scene.builder.robots.missing
    assert ids(stale) == [artefact_id]
    scene.robot(0.65, 1.0, 2.0)
    again = scene.tick(0.7)
    assert seen(again) == [artefact_id]
    assert again.map_from_base is not None
    assert scene.builder.robots.missing == ""


def test_a_tick_takes_the_latest_pose_not_after_itself(scene: Scene) -> None:
    """Of transforms stamped before and after it, it takes the one in between."""
    turn = (0.0, 0.0, 0.0, 1.0)
    scene.builder.receive_transform(
        "map", "base_link", scene.ns(0.2), (3.0, 2.0, 0.0), turn, scene.ns(0.05)
    )
    tick = scene.tick(0.1)
    assert tick.map_from_base.translation_m[0] == pytest.approx(2.0)


def test_perception_turns_with_the_robot(scene: Scene) -> None:
    """What stands behind is not seen; after a turn, it is: perceived, then lost."""
    artefact_id = scene.place(0, (2.5, 2.0), 0.0)
    first = scene.tick(0.1)
    scene.robot(0.15, 1.0, 2.0, yaw=np.pi)
    second = scene.tick(0.2)
    assert seen(first) == [artefact_id]
    assert [e.kind for e in first.events] == [EventKind.ARRIVED, EventKind.PERCEIVED]
    assert seen(second) == []
    assert [(e.kind, e.artefact_id) for e in second.events] == [(EventKind.LOST, artefact_id)]
    assert (first.metrics.perceived, second.metrics.perceived) == (1, 0)


def test_camera_info_replaces_the_default_camera(scene: Scene) -> None:
    """It sits in its own frame, here looking back; before that frame is known nothing is seen."""
    behind, ahead = scene.place(0, (0.4, 2.0), 0.0), scene.place(0, (2.5, 2.0), 0.0)
    assert seen(scene.tick(0.1)) == [ahead]
    view = PinholeView.from_field_of_view(32, 24, 1.0)
    scene.builder.receive_camera(Camera(view, "camera", RigidTransform.identity()), scene.ns(0.1))
    assert seen(scene.tick(0.2)) == []
    back = RigidTransform(np.array([0.0, 0.0, 0.5]), np.array([-0.5, 0.5, -0.5, 0.5]))
    back = RigidTransform.planar(0.0, 0.0, np.pi) @ back
    scene.builder.receive_transform(
        "base_link",
        "camera",
        0,
        back.translation_m.tolist(),
        back.rotation_xyzw.tolist(),
        scene.ns(0.2),
        is_static=True,
    )
    tick = scene.tick(0.3)
    assert seen(tick) == [behind]
    assert tick.map_from_camera.translation_m.tolist() == pytest.approx([1.0, 2.0, 0.5])
    assert max(tick.perceived[0].sighting.roi_px) <= 32


def test_parameters_can_overrule_camera_info(make_scene: Make) -> None:
    """With camera.model pinhole, what CameraInfo says does not count."""
    scene = make_scene({"camera.model": "pinhole"})
    scene.map(0.0)
    scene.robot(0.0, 1.0, 2.0)
    artefact_id = scene.place(0, (2.5, 2.0), 0.0)
    view = PinholeView.from_field_of_view(32, 24, 1.0)
    scene.builder.receive_camera(Camera(view, "camera", RigidTransform.identity()), scene.ns(0.1))
    assert seen(scene.tick(0.2)) == [artefact_id]


def test_an_omnidirectional_camera_sees_behind(make_scene: Make) -> None:
    """All round the robot, whatever its heading."""
    scene = make_scene({"camera.model": "omnidirectional"})
    scene.map(0.0)
    scene.robot(0.0, 2.0, 2.0)
    placed = [scene.place(0, at, 0.0) for at in ((0.8, 2.0), (3.2, 2.0), (2.0, 3.2))]
    assert seen(scene.tick(0.1)) == placed


def test_a_slow_camera_says_when_it_saw(make_scene: Make) -> None:
    """At 2 Hz, what was seen stands for half a second, with the time of the look."""
    scene = make_scene({"camera.rate": 2.0})
    scene.map(0.0)
    for step in range(12):
        scene.robot(0.1 * step, 1.0, 2.0)
    ticks = []
    scene.place(0, (2.5, 2.0), 1.2)
    for step in range(12, 22):
        scene.robot(0.1 * step, 1.0, 2.0)
        ticks.append(scene.tick(0.1 * step))
    looks = [tick.perceived[0].sighting.seen_ns for tick in ticks if tick.perceived]
    assert looks == [scene.ns(1.2)] * 3 + [scene.ns(1.5)] * 5 + [scene.ns(2.0)] * 2


# --- odometry and static frames


def odometry(scene: Scene, t_s: float, x: float, child: str = "") -> None:
    """Receive odometry of a robot at (x, 2)."""
    t_ns = scene.ns(t_s)
    scene.builder.receive_odometry("odom", child, t_ns, (x, 2.0, 0.0), NO_TURN, t_ns)


@pytest.mark.parametrize(("use", "x"), [("auto", 1.0), ("use", 3.0), ("ignore", 1.0)])
def test_odometry_against_tf(make_scene: Make, use: str, x: float) -> None:
    """Auto lets tf win, use prefers odometry, ignore drops it."""
    scene = make_scene({"frames.odometry": use, "frames.static": ("0 0 0 0 0 0 map odom",)})
    odometry(scene, 0.0, 3.0, "base_link")
    args = (scene.ns(0.0), (1.0, 2.0, 0.0), NO_TURN, scene.ns(0.0))
    scene.builder.receive_transform("odom", "base_link", *args)
    assert scene.tick(0.1).map_from_base.translation_m[0] == x


def test_odometry_without_a_child_frame_means_the_base(make_scene: Make) -> None:
    """Its base is base_footprint where nothing says otherwise."""
    scene = make_scene({"frames.static": ("0 0 0 0 0 0 map odom",)})
    odometry(scene, 0.0, 3.0)
    assert scene.tick(0.1).map_from_base.translation_m[0] == 3.0
    assert scene.builder.frames.has_frame("base_footprint")
    ignoring = make_scene({"frames.odometry": "ignore"})
    odometry(ignoring, 0.0, 3.0)
    assert ignoring.builder.frames.edges() == []


@pytest.mark.parametrize(
    "text", ["0 0 0 map odom", "a 0 0 0 0 0 map odom", "0 0 0 0 0 inf map odom", "0 0 0 0 0 0 m m"]
)
def test_bad_static_frames_are_refused_at_once(make_scene: Make, text: str) -> None:
    """The error quotes the text."""
    with pytest.raises(ParameterError, match=text):
        make_scene({"frames.static": (text,)})


# --- what is hidden


def test_a_wall_of_the_map_hides_what_is_behind_it(scene: Scene) -> None:
    """Walls are extruded; beside the wall, the same artefact is seen."""
    scene.map(0.0, (15, 25, 20, 22))
    hidden, beside = scene.place(0, (2.8, 2.0), 0.0), scene.place(0, (2.8, 3.4), 0.0)
    assert seen(scene.tick(0.1)) == [beside]
    scene.map(0.1)
    assert seen(scene.tick(0.2)) == [hidden, beside]


def voxel_wall(x: float) -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
    """Return the centres of a wall at this x, 1 m wide and 1.5 m high, in voxels of 0.1 m."""
    y, z = np.meshgrid(np.arange(15, 25) * 0.1 + 0.05, np.arange(15) * 0.1 + 0.05)
    return np.column_stack((np.full(y.size, x + 0.05), y.ravel(), z.ravel()))


def test_a_cloud_hides_what_the_map_does_not(scene: Scene) -> None:
    """A wall of voxels on free cells hides the artefact behind it, and nothing is placed in it."""
    hidden = scene.place(1, (2.8, 2.0), 0.0)
    assert seen(scene.tick(0.1)) == [hidden]
    scene.builder.receive_cloud(voxel_wall(2.0), "map", scene.ns(0.1), 0.1)
    assert seen(scene.tick(0.2)) == []
    with pytest.raises(Exception, match="in a wall"):
        scene.place(0, (2.1, 2.2), 0.2)


def test_a_cloud_waits_for_its_frame(scene: Scene) -> None:
    """The walls of the map serve until the cloud's frame is known; then the cloud does."""
    hidden = scene.place(1, (2.8, 2.0), 0.0)
    scene.builder.receive_cloud(voxel_wall(0.0), "octomap", scene.ns(0.05), 0.1)
    assert scene.builder.world.missing_frame() == "octomap"
    assert seen(scene.tick(0.1)) == [hidden]
    scene.builder.receive_transform(
        "map", "octomap", 0, (2.0, 0.0, 0.0), NO_TURN, scene.ns(0.12), is_static=True
    )
    assert seen(scene.tick(0.2)) == []
    assert scene.builder.world.missing_frame() == ""
    assert not scene.builder.world.environment.voxels.is_extruded


def test_artefacts_hide_each_other_if_they_may(make_scene: Make) -> None:
    """A screen hides the crate behind it, unless occlusion.mutual is off."""
    for mutual in (True, False):
        scene = make_scene({"occlusion.mutual": mutual})
        scene.map(0.0)
        scene.robot(0.0, 1.0, 2.0)
        screen, crate = scene.place(2, (2.0, 2.0), 0.0), scene.place(1, (2.8, 2.0), 0.0)
        assert seen(scene.tick(0.1)) == ([screen] if mutual else [screen, crate])


def test_tau_is_the_most_pixels_that_do_not_count(make_scene: Make) -> None:
    """With as many pixels as tau an artefact is not perceived, with one more it is."""
    scene = make_scene()
    scene.map(0.0)
    scene.robot(0.0, 1.0, 2.0)
    scene.place(0, (2.5, 2.0), 0.0)
    pixels = scene.tick(0.1).perceived[0].sighting.visible_pixels
    assert pixels > 100
    for tau in (pixels - 1, pixels):
        other = make_scene({"occlusion.tau": tau})
        other.map(0.0)
        other.robot(0.0, 1.0, 2.0)
        other.place(0, (2.5, 2.0), 0.0)
        assert len(other.tick(0.1).perceived) == (tau < pixels)


# --- gates


def test_the_grid_holds_what_is_perceived_or_all(make_scene: Make) -> None:
    """Of one before and one behind the robot, the gate perceived admits the first only."""
    for gate, count in (("perceived", 1), ("all", 2)):
        scene = make_scene({"costmap.gate": gate})
        scene.map(0.0)
        scene.robot(0.0, 1.5, 2.0)
        scene.place(0, (2.8, 2.0), 0.0)
        scene.place(0, (0.6, 2.0), 0.0)
        tick = scene.tick(0.1)
        assert len(tick.artefacts) == 2
        assert added_cells(tick, scene) == 16 * count
        assert drawn(tick, MarkerAction.ADD) == set(ids(tick))


def test_memory_keeps_in_the_grid_what_is_out_of_sight(make_scene: Make) -> None:
    """For costmap.memory after the last look, and no longer."""
    scene = make_scene({"costmap.memory": 0.3, "augmented_map.max_rate": 100.0})
    scene.map(0.0)
    scene.robot(0.0, 1.0, 2.0)
    scene.place(0, (2.5, 2.0), 0.0)
    assert added_cells(scene.tick(0.1), scene) == 16
    still = []
    for step in range(2, 7):
        scene.robot(0.1 * step - 0.05, 1.0, 2.0, yaw=np.pi)
        cells = scene.tick(0.1 * step).grids.augmented_map
        still.append(None if cells is None else int(cells.cells.max(initial=0, where=INNER)))
    assert still == [None, None, None, 0, None]


def remembered(make_scene: Make, life_s: float, max_rate_hz: float) -> Scene:
    """Return a scene in which the robot has seen an artefact, and turned away from it."""
    values = {"costmap.memory": 5.0, "augmented_map.max_rate": max_rate_hz}
    scene = make_scene(values | {"collisions.on_robot_contact": "displace"})
    scene.map(0.0)
    scene.robot(0.0, 1.0, 2.0)
    scene.place(0, (2.5, 2.0), 0.0, life_s=life_s)
    assert seen(scene.tick(0.1)) == [10**9]
    scene.robot(0.15, 1.0, 2.0, yaw=np.pi)
    tick = scene.tick(0.2)
    assert (seen(tick), tick.grids.artefact_map) == ([], None)
    return scene


@pytest.mark.parametrize(
    "changes",
    [[{"costmap.memory": 8.0}], [{"costmap.gate": "all"}, {"costmap.gate": "perceived"}]],
)
def test_what_is_remembered_outlasts_a_change_of_the_gate(
    make_scene: Make, changes: list[dict[str, Any]]
) -> None:
    """A memory that grows, or all artefacts shown for a while, takes nothing off the maps."""
    scene = remembered(make_scene, 1000.0, 100.0)
    for k, change in enumerate(changes):
        t_s = 0.3 + 0.1 * k
        scene.robot(t_s - 0.05, 1.0, 2.0, yaw=np.pi)
        values = with_values(scene.builder.parameters, change)
        scene.builder.reconfigure(values, scene.ns(t_s - 0.02))
        assert scene.tick(t_s).grids.artefact_map is None, "no cell changes"
    memory_s = scene.builder.parameters.costmap.memory
    cells = []
    for t_s in (0.1 + memory_s, 0.2 + memory_s):
        scene.robot(t_s - 0.05, 1.0, 2.0, yaw=np.pi)
        cells.append(scene.tick(t_s).grids.artefact_map)
    assert cells[0] is None
    assert cells[1] is not None
    assert not cells[1].cells.any()


def test_what_is_seen_while_all_are_shown_is_remembered_later(make_scene: Make) -> None:
    """When only the perceived are shown again."""
    scene = make_scene({"costmap.memory": 5.0, "costmap.gate": "all"})
    scene.map(0.0)
    scene.robot(0.0, 1.0, 2.0)
    scene.place(0, (2.5, 2.0), 0.0)
    assert added_cells(scene.tick(0.1), scene) == 16
    scene.robot(0.15, 1.0, 2.0, yaw=np.pi)
    values = with_values(scene.builder.parameters, {"costmap.gate": "perceived"})
    scene.builder.reconfigure(values, scene.ns(0.16))
    assert scene.tick(0.4).grids.artefact_map is None


def test_a_remembered_artefact_that_moved_is_where_it_is(make_scene: Make) -> None:
    """Not where it was seen: nothing stays there, and its cells are those of its box now."""
    scene = remembered(make_scene, 1000.0, 100.0)
    scene.robot(0.25, 2.2, 2.0, yaw=np.pi)  # backwards into it
    tick = scene.tick(0.3)
    assert seen(tick) == []
    (state,) = tick.artefacts
    x_m, y_m = state.ground_pose.x_m, state.ground_pose.y_m
    assert np.hypot(x_m - 2.5, y_m - 2.0) > 0.05, "it was moved aside"
    rows, cols = np.nonzero(tick.grids.artefact_map.cells)
    centres_m = 0.1 * (np.column_stack((cols, rows)) + 0.5)
    assert np.abs(centres_m.mean(axis=0) - (x_m, y_m)).max() < 0.1
    assert np.hypot(*(centres_m - (x_m, y_m)).T).max() < 0.4


def test_a_remembered_artefact_that_left_is_gone_at_once(make_scene: Make) -> None:
    """At the tick of its departure, though nobody looks, and long before its memory ends."""
    scene = remembered(make_scene, 0.55, 0.5)
    assert scene.tick(0.5).grids.artefact_map is None
    tick = scene.tick(0.6)
    assert not tick.grids.artefact_map.cells.any()
    assert added_cells(tick, scene) == 0


INNER = np.pad(np.ones((38, 38), dtype=np.bool_), 1)


# --- arrivals and departures reach all outputs at once


def test_an_arrival_is_in_all_outputs_from_the_first_tick_not_before_it(make_scene: Make) -> None:
    """At random times within ticks: state, event, marker, grid and sight come together."""
    scene = make_scene(
        BUSY | {"costmap.gate": "all", "augmented_map.max_rate": 100.0, "camera.rate": 100.0}
    )
    scene.map(0.0)
    known: set[int] = set()
    for step in range(60):
        scene.robot(0.1 * step, 1.0, 2.0)
        tick = scene.tick(0.1 * step)
        came = {e.artefact_id for e in tick.events if e.kind is EventKind.ARRIVED}
        alive = set(ids(tick))
        assert came - known >= alive - known
        assert all(
            scene.ns(0.1 * (step - 1)) < e.stamp_ns <= tick.stamp_ns
            for e in tick.events
            if e.kind not in SIGHT
        )
        assert all(
            s.arrival_ns <= tick.stamp_ns < (s.departure_ns or 2**63) for s in tick.artefacts
        )
        assert alive - known <= drawn(tick, MarkerAction.ADD)
        assert known - alive == drawn(tick, MarkerAction.DELETE)
        assert set(seen(tick)) <= alive
        assert tick.metrics.alive == len(alive)
        if tick.grids.augmented_map is not None:
            assert (added_cells(tick, scene) > 0) == bool(alive)
        known = alive
    assert scene.builder.lives.population.counts.departed > 5


def test_a_departed_artefact_leaves_nothing_behind(make_scene: Make) -> None:
    """Not in the grids, the markers, the lists or a scan of after its end."""
    scene = make_scene({"augmented_map.max_rate": 100.0})
    scene.map(0.0)
    scene.robot(0.0, 1.0, 2.0)
    scene.laser(0.0)
    before = scene.tick(0.1)
    artefact_id = scene.place(0, (2.5, 2.0), 0.1, life_s=0.25)
    scene.robot(0.15, 1.0, 2.0)
    with_it = scene.tick(0.2)
    scene.robot(0.3, 1.0, 2.0)
    scene.scan(0.3)
    scene.robot(0.4, 1.0, 2.0)
    scene.scan(0.4)
    without = scene.tick(0.4)
    assert added_cells(with_it, scene) == 16
    assert drawn(without, MarkerAction.DELETE) == {artefact_id}
    assert (without.artefacts, without.perceived) == ((), ())
    assert [(e.kind, e.artefact_id) for e in without.events] == [(EventKind.DEPARTED, artefact_id)]
    for name in ("augmented_map", "costmap"):
        clean, empty = getattr(without.grids, name), getattr(before.grids, name)
        assert clean.cells.tobytes() == empty.cells.tobytes()
    met, clear = scene.builder.take_readings()
    assert (met.reading.ranges < 3.5).any()
    assert (clear.reading.ranges == 3.5).all()


def test_the_update_tells_the_smallest_rectangle_that_changed(scene: Scene) -> None:
    """Applied to the map before, it gives the map of now."""
    before = scene.tick(0.1)
    scene.place(0, (2.5, 2.0), 0.1)
    tick = scene.tick(0.3)
    update, cells = tick.grids.update, before.grids.augmented_map.cells.copy()
    where = update.rectangle
    rows = slice(where.row0, where.row0 + where.height)
    cells[rows, where.col0 : where.col0 + where.width] = update.cells
    assert cells.tobytes() == tick.grids.augmented_map.cells.tobytes()
    assert (where.row0, where.col0, where.height, where.width) == (18, 23, 4, 4)


# --- time


def outline(events: Iterable[ArtefactEvent]) -> list[ArtefactEvent]:
    """Return the events that do not depend on when somebody looked."""
    return [event for event in events if event.kind not in SIGHT]


def change_map(scene: Scene, block: tuple[int, int, int, int], t_s: float) -> None:
    """Receive a map with a block in it."""
    scene.map(t_s, block)


def run(scene: Scene, tick_times_s: Iterable[float]) -> tuple[list[Any], list[Any]]:
    """Drive for two seconds with maps and scans; return events and scans, and final poses.

    The robot meanders among arrivals; walls come and go, and the ticks fall in between.
    """
    inputs: list[tuple[float, Callable[[float], object]]] = []
    for step in range(40):
        x, y = 1.0 + 0.04 * step, 2.0 + 0.5 * np.sin(0.3 * step)
        inputs.append((0.0503 * step, partial(scene.robot, x=x, y=y)))
        inputs.append((0.0503 * step + 0.0201, scene.scan))
    for step in range(7):
        block = (3 * step + 5, 3 * step + 15, 12, 28)
        inputs.append((0.27 * step + 0.013, partial(change_map, scene, block)))
    inputs += [(t_s, scene.tick) for t_s in tick_times_s]
    events: list[ArtefactEvent] = []
    scene.map(0.0)
    scene.laser(0.0)
    for t_s, act in sorted(inputs, key=lambda item: item[0]):
        result = act(t_s)
        events += result.events if isinstance(result, Tick) else ()
    last = scene.tick(2.1)
    events += last.events
    scans = [(s.released_ns, s.reading.ranges.tobytes()) for s in scene.builder.take_readings()]
    poses = [(state.artefact_id, state.ground_pose) for state in last.artefacts]
    return [*outline(events), *scans], poses


MANY = {
    "population.arrival_rate": 0.6,
    "population.mean_life": 1.0,
    "population.group_size": 1.5,
    "robot.clearance": 0.0,
    "collisions.on_robot_contact": "displace",
    "camera.width": 8,
    "camera.height": 6,
}


@pytest.fixture(scope="module")
def reference(make_scene: Make) -> tuple[list[Any], list[Any]]:
    """Return what happens when nobody asks before the end."""
    outcome = run(make_scene(MANY), [])
    happened = {event.kind for event in outcome[0] if isinstance(event, ArtefactEvent)}
    assert {EventKind.ARRIVED, EventKind.DEPARTED, EventKind.DISPLACED} <= happened
    return outcome


@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 20.0, 33.0])
def test_what_happens_does_not_depend_on_the_tick_rate(
    make_scene: Make, reference: tuple[list[Any], list[Any]], rate_hz: float
) -> None:
    """The same lives, ids, poses, events and scans; only sight is a matter of looking."""
    times_s = [tick / rate_hz for tick in range(int(2.1 * rate_hz))]
    assert run(make_scene(MANY), times_s) == reference


@settings(max_examples=15, deadline=None)
@given(times_s=st.lists(st.floats(0.0, 2.1), max_size=40))
def test_nor_on_when_ticks_come(
    make_scene: Make, reference: tuple[list[Any], list[Any]], times_s: list[float]
) -> None:
    """Ticks at any times at all."""
    assert run(make_scene(MANY), times_s) == reference


def everything(tick: Tick) -> tuple[Any, ...]:
    """Return all that a tick says, comparable."""
    grids = tick.grids
    return (
        [(s.artefact_id, s.row, s.ground_pose, s.departure_ns) for s in tick.artefacts],
        [(p.artefact_id, p.sighting) for p in tick.perceived],
        tick.events,
        repr(tick.metrics),
        [(m.namespace, m.action, m.scale, m.colour) for m in tick.markers.looks],
        tick.markers.ids.tolist(),
        None if grids.augmented_map is None else grids.augmented_map.cells.tobytes(),
        None if grids.costmap is None else grids.costmap.cells.tobytes(),
    )


def test_the_seed_decides_everything(make_scene: Make) -> None:
    """The same seed gives the same outputs bit for bit, another seed others."""

    def play(seed: int) -> list[tuple[Any, ...]]:
        scene = make_scene(BUSY | {"seed": seed})
        scene.map(0.0)
        told = []
        for step in range(25):
            scene.robot(0.1 * step, 1.0 + 0.02 * step, 2.0)
            told.append(everything(scene.tick(0.1 * step + 0.05)))
        return told

    assert play(7) == play(7)
    assert play(7) != play(8)


def test_to_prepare_changes_nothing_but_time(make_scene: Make) -> None:
    """Whether the builder was warmed for a map or not, the tick says the same."""
    told = []
    for prepares in (True, False):
        scene = make_scene()
        scene.map(0.0)
        scene.robot(0.0, 1.0, 2.0)
        scene.place(0, (2.5, 2.0), 0.0)
        if prepares:
            scene.builder.prepare()
        told.append(everything(scene.tick(0.1)))
    assert told[0] == told[1]


def test_a_clock_that_jumps_back_starts_anew(make_scene: Make) -> None:
    """All artefacts depart, said once; the map stays, later poses are forgotten; ids go on."""
    scene = make_scene(BUSY)
    scene.map(10.0)
    scene.robot(10.0, 1.0, 2.0)
    placed = scene.place(0, (2.5, 2.0), 10.0)
    old = ids(scene.tick(10.4))
    assert placed in old
    back = scene.tick(5.0)
    (sentence,) = scene.builder.notices
    assert "5.400 s" in sentence
    assert (back.artefacts, back.perceived, back.map_from_base) == ((), (), None)
    gone = [e.artefact_id for e in back.events if e.detail == "clock_jumped_back"]
    assert gone == old
    assert EventKind.LOST not in kinds(back)
    assert back.markers.looks[0].action is MarkerAction.DELETEALL
    fresh: set[int] = set()
    for step in range(1, 30):
        scene.robot(5.0 + 0.1 * step, 1.0, 2.0)
        tick = scene.tick(5.0 + 0.1 * step)
        fresh |= set(ids(tick))
        assert tick.map_from_base is not None
    assert fresh
    assert not fresh & set(old)
    assert len(scene.builder.notices) == 1


def test_a_jump_back_after_a_scan_is_a_jump_too(scene: Scene) -> None:
    """An input of before the last tick resets as well, and is itself taken."""
    scene.place(0, (2.5, 2.0), 0.0)
    scene.laser(1.3)
    scene.scan(1.3)
    scene.robot(0.1, 1.5, 2.0)
    assert len(scene.builder.notices) == 1
    assert scene.builder.sensors.counts()["scan"].passed_through == 0
    tick = scene.tick(0.2)
    assert tick.artefacts == ()
    assert tick.map_from_base.translation_m[0] == 1.5


def test_a_clock_set_back_by_a_fraction_of_a_second_changes_nothing(scene: Scene) -> None:
    """As machines' clocks are: nobody departs, and life goes on."""
    artefact_id = scene.place(0, (2.5, 2.0), 0.0)
    scene.tick(1.0)
    scene.robot(0.2, 1.5, 2.0)
    assert scene.builder.notices == []
    assert ids(scene.tick(1.1)) == [artefact_id]


def test_a_clock_that_leaps_ahead_starts_anew(make_scene: Make) -> None:
    """Nobody lived through years that nobody saw: all depart at once, with an event each."""
    scene = make_scene(BUSY)
    scene.map(10.0)
    scene.robot(10.0, 1.0, 2.0)
    old = ids(scene.tick(14.0))
    assert old
    later_s = 14.0 + 5 * 365 * 86_400.0
    tick = scene.tick(later_s)
    assert (tick.artefacts, tick.map_from_base) == ((), None)
    gone = [e.artefact_id for e in tick.events if e.detail == "clock_leapt"]
    assert gone == old
    (sentence,) = scene.builder.notices
    assert "leapt ahead by 157680000 s" in sentence
    scene.robot(later_s + 0.1, 1.0, 2.0)
    fresh = {i for step in range(2, 50) for i in ids(scene.tick(later_s + 0.1 * step))}
    assert fresh
    assert not fresh & set(old)


# --- scans through the builder


def test_a_scan_meets_the_artefacts_of_its_own_stamp(scene: Scene) -> None:
    """The beam straight ahead ends at the post's face; the others stay, and it is dimmed."""
    scene.laser(0.0)
    scene.place(0, (2.5, 2.0), 0.1)
    early = scene.scan(0.12, stamp_s=0.09)
    late = scene.scan(0.14, stamp_s=0.11)
    scene.robot(0.15, 1.0, 2.0)
    one, other = scene.builder.take_readings()
    assert (one.topic, one.is_augmented, one.released_ns) == ("scan", True, scene.ns(0.15))
    assert one.reading is early
    assert other.reading.ranges[180] == pytest.approx(1.3)
    changed = np.flatnonzero(other.reading.ranges != late.ranges)
    assert 0 < len(changed) < 30
    assert (other.reading.intensities[changed] == 0.0).all()
    assert scene.builder.sensors.counts()["scan"].exact == 2


@pytest.mark.parametrize(
    ("gate", "meets"), [("geometry", True), ("all", True), ("perceived", False)]
)
def test_the_gate_of_the_sensors(make_scene: Make, gate: str, meets: bool) -> None:
    """An artefact behind the camera is met by a laser, unless only the perceived count."""
    scene = make_scene({"sensors.gate": gate})
    scene.map(0.0)
    scene.laser(0.0)
    scene.robot(0.0, 2.0, 2.0)
    scene.place(0, (0.8, 2.0), 0.0)
    ahead = scene.place(0, (3.2, 2.0), 0.0)
    assert seen(scene.tick(0.1)) == [ahead]
    scene.robot(0.15, 2.0, 2.0)
    scene.scan(0.15)
    (released,) = scene.builder.take_readings()
    assert (released.reading.ranges[0] < 3.0) == meets
    assert released.reading.ranges[180] < 3.0


def test_the_inputs_end_and_what_waits_is_released(scene: Scene) -> None:
    """A scan whose frame never came passes through, and the reason is told."""
    scan = scene.scan(0.1)
    scene.builder.finish(scene.ns(0.11))
    (released,) = scene.builder.take_readings()
    assert released.reading is scan
    assert not released.is_augmented
    assert "not seen so far" in scene.builder.sensors.problems()["scan"]


# --- what nobody wants


def test_what_nobody_wants_is_not_computed(make_scene: Make) -> None:
    """Each switch empties its part and leaves the ground truth."""
    for demand in (Demand(perception=False), Demand(grids=False), Demand(markers=False)):
        scene = make_scene({"costmap.gate": "all"}, demand)
        scene.map(0.0)
        scene.robot(0.0, 1.0, 2.0)
        artefact_id = scene.place(0, (2.5, 2.0), 0.0)
        tick = scene.tick(0.1)
        assert ids(tick) == [artefact_id]
        assert bool(tick.perceived) == demand.perception
        assert (EventKind.PERCEIVED in kinds(tick)) == demand.perception
        assert (tick.map_from_camera is not None) == demand.perception
        assert tick.map_from_base is not None
        assert (tick.grids.augmented_map is not None) == demand.grids
        assert (tick.grids.costmap is not None) == demand.grids
        assert bool(tick.markers) == demand.markers


def test_demand_may_change_while_it_runs(scene: Scene) -> None:
    """What was switched off is complete again at the next tick that wants it."""
    scene.tick(0.1)
    scene.builder.demand = Demand(perception=True, grids=False, markers=False)
    artefact_id = scene.place(0, (2.5, 2.0), 0.1)
    assert scene.tick(0.3).grids.augmented_map is None
    scene.builder.demand = Demand()
    tick = scene.tick(0.5)
    assert added_cells(tick, scene) == 16
    assert drawn(tick, MarkerAction.ADD) == {artefact_id}


def test_a_little_disorder_is_no_jump_of_the_clock(scene: Scene) -> None:
    """An input 50 ms late is taken as if it came now; nobody leaves for it."""
    artefact_id = scene.place(0, (3.0, 2.0), 0.1)
    scene.tick(0.5)
    scene.robot(0.45, 1.0, 2.0)
    assert [state.artefact_id for state in scene.tick(0.6).artefacts] == [artefact_id]
    assert scene.builder.notices == []


def test_a_cloud_is_placed_where_its_frame_was_at_its_stamp(scene: Scene) -> None:
    """And the same points again, from where the robot is later, make another map."""
    points = np.array([(1.0, 0.0, 0.5), (1.1, 0.0, 0.5)])
    for t_s in (0.2, 0.4):
        scene.robot(t_s, 5.0 * t_s, 2.0)
    builder = scene.builder
    lows = []
    for t_s in (0.3, 0.4):
        builder.receive_cloud(points, "base_link", scene.ns(0.5), 0.1, stamp_ns=scene.ns(t_s))
        environment = builder.world.environment
        assert environment is not None
        assert environment.voxels is not None
        lows.append(float(environment.voxels.bounds_m()[0, 0]))
    assert lows == pytest.approx([1.5 + 0.95, 2.0 + 0.95])


def test_nothing_is_perceived_before_the_camera_that_is_awaited(scene: Scene) -> None:
    """Until CameraInfo comes there is no view model, and none of the parameters steps in."""
    scene.robot(0.0, 1.0, 2.0)
    scene.place(0, (3.0, 2.0), 0.0)
    camera = scene.builder.camera
    scene.builder.await_camera()
    assert scene.tick(0.1).perceived == ()
    assert camera is not None
    scene.builder.receive_camera(camera, scene.ns(0.15))
    scene.robot(0.2, 1.0, 2.0)
    assert len(scene.tick(0.2).perceived) == 1
    assert scene.builder.looks == 1


# --- the augmented octomap


def wall_cloud(scene: Scene) -> None:
    """Receive an octomap: a wall of voxels of 0.1 m at x = 3.5 m."""
    side = np.arange(10) * 0.1 + 0.05
    wall = np.array([(3.55, y, z) for y in side for z in side])
    scene.builder.receive_cloud(wall.astype(np.float32), "map", scene.ns(0.0), 0.1)


def octomap_points(tick: Tick) -> npt.NDArray[Any]:
    """Return the centres of the octomap that goes out."""
    assert tick.octomap is not None
    return tick.octomap.points_m()


def test_the_octomap_shows_whom_the_gate_admits(make_scene: Make) -> None:
    """The box of the artefact adds voxels at its faces, and goes with it; a farewell is bare."""
    scene = make_scene({"costmap.gate": "all", "sensors.shape": "box"}, Demand(octomap=True))
    scene.map(0.0)
    scene.robot(0.0, 1.0, 2.0)
    wall_cloud(scene)
    assert len(octomap_points(scene.tick(0.1))) == 100
    scene.place(0, (2.5, 2.0), 0.1, life_s=0.5)
    points = octomap_points(scene.tick(0.2))
    (state,) = scene.tick(0.3).artefacts
    middle_m = state.map_from_artefact.apply(np.array([state.box_centre_m]))[0]
    low_m, high_m = middle_m - 0.5 * np.array(state.size_m), middle_m + 0.5 * np.array(state.size_m)
    added = points[100:]
    assert ((added > low_m - 0.06) & (added < high_m + 0.06)).all()
    assert (np.abs(added.max(axis=0) - high_m) <= 0.1).all()
    bare = scene.builder.farewell(scene.ns(0.35))
    assert len(octomap_points(bare)) == 100
    assert (bare.metrics.alive, bare.metrics.clutter_ratio) == (0, 0.0)
    assert scene.builder.farewell(scene.ns(0.36)).octomap is None
    assert len(octomap_points(scene.tick(0.4))) == len(points)
    assert len(octomap_points(scene.tick(0.9))) == 100


def test_without_an_octomap_or_a_wish_there_is_none(make_scene: Make) -> None:
    """The walls of a map are no octomap; and what nobody asks for is not computed."""
    wanted = make_scene({}, Demand(octomap=True))
    wanted.map(0.0)
    wanted.robot(0.0, 1.0, 2.0)
    assert wanted.tick(0.1).octomap is None
    plain = make_scene({})
    plain.map(0.0)
    plain.robot(0.0, 1.0, 2.0)
    wall_cloud(plain)
    assert plain.tick(0.1).octomap is None
    plain.builder.demand = Demand(octomap=True)
    assert plain.tick(0.2).octomap is not None
