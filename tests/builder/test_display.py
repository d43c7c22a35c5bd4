"""The artefacts drawn: subjects, and what reaches the board."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from are_ros.builder.markers import (
    Display,
    MarkerAction,
    MarkerBatch,
    MarkerBoard,
    MarkerKind,
    marker_subject,
    poses_of,
)
from are_ros.builder.occlusion.meshes import MeshBank
from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import Labels, Shape
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow
from are_ros.world.rigid_transform import RigidTransform
from tests.builder.truth import artefact_state

HERE = GroundPose(1.0, 2.0, 0.5, 0.7)


@pytest.fixture
def row(make_scene: Callable[..., Any]) -> CatalogueRow:
    """Return a crate whose centre of mass is not its box's centre."""
    crate: CatalogueRow = make_scene().row(1)
    return replace(crate, box_centre_in_artefact_m=(0.1, 0.0, 0.05))


def an_artefact(row: CatalogueRow) -> Artefact:
    """Return an artefact that stands since 100."""
    return Artefact(7, row, Origin.SCRIPTED, 100, PoseHistory(100, HERE), 900)


def bodies(markers: MarkerBatch) -> list[tuple[MarkerKind, MarkerAction, float]]:
    """Return kind, action and alpha of the bodies among markers."""
    return [
        (m.kind, m.action, float(m.colours[0, 3]) if len(m.colours) else m.colour[3])
        for m in markers.looks
        if m.namespace == "body"
    ]


def test_a_marker_shows_the_mesh_or_the_box(row: CatalogueRow) -> None:
    """The mesh fills the box about F_A; the arrays are the same each time."""
    state, bank = artefact_state(an_artefact(row), 500), MeshBank()
    box = marker_subject(state, row, None, is_perceived=True)
    assert box.mesh_triangles_m is None
    assert (box.size_m, box.box_centre_m, box.is_perceived) == (row.size_m, (0.1, 0.0, 0.05), True)
    mesh = marker_subject(state, row, bank, is_perceived=False)
    again = marker_subject(state, row, bank, is_perceived=False)
    assert mesh.mesh_triangles_m is not None
    assert mesh.mesh_triangles_m is again.mesh_triangles_m
    assert mesh.mesh_colours is again.mesh_colours
    corners = mesh.mesh_triangles_m.reshape(-1, 3)
    assert mesh.mesh_colours is not None
    assert len(mesh.mesh_colours) == len(mesh.mesh_triangles_m)
    np.testing.assert_allclose(np.ptp(corners, axis=0), row.size_m, atol=1e-6)


@pytest.mark.parametrize("shape", [Shape.BOX, Shape.MESH])
def test_a_display_draws_only_what_changed(row: CatalogueRow, shape: Shape) -> None:
    """All at first; then nothing while it stands; then it fades from opaque as it is lost."""
    meshes = MeshBank() if shape is Shape.MESH else None
    display, state = Display(MarkerBoard(shape), meshes), artefact_state(an_artefact(row), 200)
    kind = MarkerKind.TRIANGLE_LIST if meshes else MarkerKind.CUBE
    seen = bodies(display.update(0, [state], [row], {7}))
    assert seen == [(kind, MarkerAction.ADD, 1.0)]
    assert not display.update(NS_PER_S // 4, [state], [row], {7})
    lost = bodies(display.update(NS_PER_S // 4, [state], [row], set()))
    assert [entry[:2] for entry in lost] == [(kind, MarkerAction.ADD)]
    assert 0.0 < lost[0][2] < 1.0
    gone = display.update(NS_PER_S // 4, [], [], set())
    assert {marker.action for marker in gone.looks} == {MarkerAction.DELETE}


def test_who_moves_is_somewhere_else_and_looks_the_same(row: CatalogueRow) -> None:
    """A new state with another pose keeps the looks, and those of one who stands go out no more."""
    display = Display(MarkerBoard(), None)
    mover, other = (artefact_state(replace(an_artefact(row), id=i), 200) for i in (7, 8))
    first = display.update(0, [mover, other], [row, row], {7})
    there = RigidTransform.planar(4.0, 5.0, 0.1, z=2.0)
    moved = replace(mover, map_from_artefact=there)
    second = display.update(1, [moved, other], [row, row], {7})
    assert [id(look) for look in second.looks] == [id(look) for look in first.looks[1:4]]
    np.testing.assert_array_equal(second.poses[0, :3], there.apply(np.array([[0.1, 0.0, 0.05]]))[0])
    np.testing.assert_array_equal(second.poses[0, 3:], there.rotation_xyzw)


@pytest.mark.parametrize(
    "change",
    [
        {"label": "else"},
        {"size_m": (1.0, 1.0, 1.0)},
        {"box_centre_m": (0.0, 0.0, 0.0)},
        {"linear_velocity_m_s": (0.6, 0.0, 0.0)},
    ],
)
def test_another_look_is_drawn(row: CatalogueRow, change: dict[str, Any]) -> None:
    """A state with other words, size, centre or speed goes out, and so does one of another row."""
    display, state = Display(MarkerBoard(), None), artefact_state(an_artefact(row), 200)
    display.update(0, [state], [row], ())
    assert len(display.update(1, [replace(state, **change)], [row], ())) == 2
    repainted = replace(row, colour=(0.0, 0.0, 1.0, 1.0))
    markers = display.update(2, [replace(state, **change)], [repainted], ())
    assert markers.looks[0].colour[:3] == (0.0, 0.0, 1.0)


def texts(markers: MarkerBatch) -> dict[int, str]:
    """Return the labels among markers."""
    return {m.marker_id: m.text for m in markers.looks if m.namespace == "label" and m.text}


def test_labels_that_would_meet_are_ids(row: CatalogueRow) -> None:
    """Of the perceived, while they stand close; the words come back a little farther apart."""
    display = Display(MarkerBoard(), None)
    states = [artefact_state(replace(an_artefact(row), id=i), 200) for i in (7, 8, 9)]
    word = states[0].label

    def shown(now_ns: int, xs: tuple[float, ...], perceived: set[int]) -> dict[int, str]:
        placed = [
            replace(state, map_from_artefact=RigidTransform.planar(x, 0.0, 0.0))
            for state, x in zip(states, xs, strict=True)
        ]
        rows = [row] * len(placed)
        return texts(display.update(now_ns, placed, rows, perceived, everything=True))

    everybody = {7, 8, 9}
    assert shown(0, (0.0, 1.6, 9.0), everybody) == {7: word, 8: word, 9: word}
    assert shown(1, (0.0, 1.3, 9.0), everybody) == {7: "7", 8: "8", 9: word}
    assert shown(2, (0.0, 1.6, 9.0), everybody) == {7: "7", 8: "8", 9: word}
    assert shown(3, (0.0, 1.9, 9.0), everybody) == {7: word, 8: word, 9: word}
    assert shown(4, (0.0, 0.5, 9.0), {7, 9}) == {7: word, 9: word}
    assert shown(5, (0.0, 0.5, 9.0), everybody) == {7: "7", 8: "8", 9: word}
    assert shown(4, (0.0, 1.6, 9.0), everybody) == {7: word, 8: word, 9: word}


@pytest.mark.parametrize(("labels", "wanted"), [(Labels.ALL, ["7", "8"]), (Labels.NONE, [])])
def test_labels_of_all_and_of_nobody(row: CatalogueRow, labels: Labels, wanted: list[str]) -> None:
    """Who is labelled counts, perceived or not."""
    display = Display(MarkerBoard(Shape.BOX, labels), None)
    states = [artefact_state(replace(an_artefact(row), id=i), 200) for i in (7, 8)]
    assert [*texts(display.update(0, states, [row, row], ())).values()] == wanted


def test_a_new_viewer_gets_everything(row: CatalogueRow) -> None:
    """A DELETEALL and all, with what changed just now; also after one that took all away."""
    display, state = Display(MarkerBoard(), None), artefact_state(an_artefact(row), 200)
    display.update(0, [], [], ())
    for everything in (True, False):
        markers = display.update(1, [state], [row], (), everything=everything)
        assert [m.action for m in markers.looks] == [MarkerAction.DELETEALL] + [
            MarkerAction.ADD
        ] * 2
        assert [m.action for m in display.delete_all().looks] == [MarkerAction.DELETEALL]


def test_poses_are_those_of_the_states(row: CatalogueRow) -> None:
    """One line for each state, the translation and the quaternion; none for none."""
    states = [artefact_state(replace(an_artefact(row), id=i), 200) for i in (7, 8)]
    expected = [
        [*s.map_from_artefact.translation_m, *s.map_from_artefact.rotation_xyzw] for s in states
    ]
    np.testing.assert_array_equal(poses_of(states), expected)
    assert poses_of([]).shape == (0, 7)
