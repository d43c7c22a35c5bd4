"""The environment's surface in the markers: when it is sent, and what of."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh

from are_ros.builder.markers import (
    DELETE_ALL,
    ENVIRONMENT,
    NO_MARKERS,
    EnvironmentDisplay,
    MarkerAction,
    MarkerBatch,
    MarkerKind,
    MarkerLook,
)
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

Make = Callable[..., Any]
BODY = MarkerBatch.unposed([MarkerLook("body", MarkerKind.CUBE)], [4])


def voxels(count: int) -> VoxelMap:
    """Return a row of voxels, turned."""
    row = np.ones((count, 1, 1), np.uint8)
    return VoxelMap(RigidTransform.planar(1.0, 2.0, 0.7, 0.1), (0.2, 0.2, 0.3), row)


def actions(batch: MarkerBatch) -> list[MarkerAction]:
    """Return the actions of the environment's markers."""
    return [look.action for look in batch.looks if look.namespace == ENVIRONMENT]


def test_it_is_sent_once_and_again_to_a_new_viewer() -> None:
    """A DELETEALL means that the viewers have nothing; other markers stay before it."""
    display, row = EnvironmentDisplay(), voxels(3)
    first = display.added_to(DELETE_ALL.followed_by(BODY), row)
    assert [look.namespace for look in first.looks] == ["", "body", ENVIRONMENT]
    assert first.ids.tolist() == [0, 4, 0]
    assert display.added_to(BODY, row) is BODY
    again = display.added_to(DELETE_ALL, row)
    assert again.looks[1] is first.looks[2]
    assert display.added_to(NO_MARKERS, row) is NO_MARKERS


def test_other_voxels_are_another_surface() -> None:
    """They replace the first, which has the same id; where there are none, it is deleted once."""
    display = EnvironmentDisplay()
    none = VoxelMap(RigidTransform.identity(), (1.0,) * 3, np.zeros((2, 2, 2), np.uint8))
    before = display.added_to(NO_MARKERS, voxels(3)).looks
    after = display.added_to(NO_MARKERS, voxels(5)).looks
    assert [look.action for look in (*before, *after)] == [MarkerAction.ADD] * 2
    assert np.ptp(after[0].points, axis=0).max() > np.ptp(before[0].points, axis=0).max()
    display.prepare(none)
    assert actions(display.added_to(NO_MARKERS, none)) == [MarkerAction.DELETE]
    assert display.added_to(NO_MARKERS, none) is NO_MARKERS
    assert display.added_to(DELETE_ALL, None) is DELETE_ALL
    assert actions(display.added_to(NO_MARKERS, voxels(3))) == [MarkerAction.ADD]


def test_its_triangles_enclose_the_voxels_in_the_maps_frame() -> None:
    """Three points each, anticlockwise from outside; one colour for all, and no end."""
    row = voxels(4)
    (look,) = EnvironmentDisplay().added_to(NO_MARKERS, row).looks
    assert (look.kind, look.lifetime_ns, len(look.colours)) == (MarkerKind.TRIANGLE_LIST, 0, 0)
    faces = np.arange(len(look.points)).reshape(-1, 3)
    mesh = trimesh.Trimesh(look.points, faces)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 * 0.2 * 0.2 * 0.3)
    assert mesh.bounds == pytest.approx(row.bounds_m())


def surfaces(scene: Any, times_s: Sequence[float]) -> list[list[MarkerAction]]:
    """Return the actions of the environment's markers at ticks."""
    return [actions(scene.tick(t_s).markers) for t_s in times_s]


def test_the_builder_sends_it_when_the_map_changes_and_to_new_viewers(make_scene: Make) -> None:
    """Not before there is a map, not for the same map again, and after a pause."""
    scene = make_scene({"markers.environment": True})
    added, nothing = [MarkerAction.ADD], list[MarkerAction]()
    assert surfaces(scene, [0.1]) == [nothing]
    scene.map(0.1)
    assert surfaces(scene, [0.2, 0.3]) == [added, nothing]
    scene.map(0.3)
    assert surfaces(scene, [0.4]) == [nothing]
    scene.map(0.4, (10, 12, 10, 12))
    assert surfaces(scene, [0.5, 0.6]) == [added, nothing]
    scene.builder.show_everything()
    assert surfaces(scene, [0.7, 0.8]) == [added, nothing]
    scene.builder.farewell(scene.ns(0.85))
    assert surfaces(scene, [0.9, 1.0]) == [added, nothing]
    assert surfaces(scene, [0.5]) == [added]  # the clock jumped back


def test_it_is_off_unless_asked_for_and_can_be_switched(make_scene: Make) -> None:
    """Switched off, a DELETEALL takes it away."""
    scene = make_scene()
    scene.map(0.0)
    assert surfaces(scene, [0.1]) == [[]]
    parameters = scene.builder.parameters
    shown = replace(parameters, markers=replace(parameters.markers, environment=True))
    scene.builder.reconfigure(shown, scene.ns(0.15))
    assert surfaces(scene, [0.2]) == [[MarkerAction.ADD]]
    scene.builder.reconfigure(parameters, scene.ns(0.25))
    off = scene.tick(0.3).markers
    assert off.looks[0].action is MarkerAction.DELETEALL
    assert actions(off) == []
