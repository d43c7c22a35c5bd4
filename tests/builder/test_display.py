"""The artefacts drawn: subjects, and what reaches the board."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from are_ros.artefacts.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.builder.display import Display, marker_subject
from are_ros.builder.markers import Marker, MarkerAction, MarkerBoard, MarkerKind
from are_ros.builder.mesh_bank import MeshBank
from are_ros.builder.states import artefact_state
from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import Shape

HERE = GroundPose(1.0, 2.0, 0.5, 0.7)


@pytest.fixture
def row(make_scene: Callable[..., Any]) -> CatalogueRow:
    """Return a crate whose centre of mass is not its box's centre."""
    crate: CatalogueRow = make_scene().row(1)
    return replace(crate, box_centre_in_artefact_m=(0.1, 0.0, 0.05))


def an_artefact(row: CatalogueRow) -> Artefact:
    """Return an artefact that stands since 100."""
    return Artefact(7, row, Origin.SCRIPTED, 100, PoseHistory(100, HERE), 900)


def bodies(markers: tuple[Marker, ...]) -> list[tuple[MarkerKind, MarkerAction, float]]:
    """Return kind, action and alpha of the bodies among markers."""
    return [
        (m.kind, m.action, float(m.colours[0, 3]) if len(m.colours) else m.colour[3])
        for m in markers
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
    assert display.update(NS_PER_S // 2, [state], [row], {7}) == ()
    lost = bodies(display.update(NS_PER_S // 2, [state], [row], set()))
    assert [entry[:2] for entry in lost] == [(kind, MarkerAction.ADD)]
    assert 0.0 < lost[0][2] < 1.0
    gone = display.update(NS_PER_S // 2, [], [], set())
    assert {marker.action for marker in gone} == {MarkerAction.DELETE}
