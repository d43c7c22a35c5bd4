"""Markers: lawful ones, and a board that keeps a viewer up to date with the least traffic."""

import math
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.builder.markers import (
    Marker,
    MarkerAction,
    MarkerBoard,
    MarkerKind,
    MarkerSubject,
)
from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import Shape
from are_ros.world.rigid_transform import RigidTransform

MS = 1_000_000
TRIANGLES = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 0, 1], [0, 1, 1]]], float)
FACES = np.array([[1, 0, 0, 1], [0, 0, 1, 1]], np.float32)


def a_subject(
    artefact_id: int = 1,
    *,
    x: float = 0.0,
    yaw: float = 0.0,
    label: str = "person",
    perceived: bool = True,
    mesh: bool = False,
) -> MarkerSubject:
    """Return a person of 0.5 x 0.6 x 1.8 m whose centre of mass is 0.1 m above the box's."""
    return MarkerSubject(
        artefact_id,
        label,
        RigidTransform.planar(x, 2.0, yaw, z=1.0),
        (0.05, 0.0, -0.1),
        (0.5, 0.6, 1.8),
        (0.2, 0.4, 0.6, 0.5),
        perceived,
        TRIANGLES if mesh else None,
        FACES if mesh else None,
    )


def assert_lawful(marker: Marker) -> None:
    """Assert the rules of visualization_msgs/Marker and of rviz's own check of each message."""
    assert -(2**31) <= marker.marker_id < 2**31
    assert marker.action in {0, 2, 3}
    numbers = (*marker.map_from_marker.translation_m, *marker.scale, *marker.colour)
    assert all(math.isfinite(number) for number in numbers)
    assert np.linalg.norm(marker.map_from_marker.rotation_xyzw) == pytest.approx(1.0, abs=1e-6)
    if marker.action is not MarkerAction.ADD:
        return
    assert marker.lifetime_ns == 3 * NS_PER_S
    assert all(0.0 <= channel <= 1.0 for channel in marker.colour)
    assert marker.colour[3] > 0.0
    assert all(component > 0.0 for component in marker.scale)
    assert bool(marker.text.strip()) == (marker.kind is MarkerKind.TEXT_VIEW_FACING)
    assert_lawful_points(marker)


def assert_lawful_points(marker: Marker) -> None:
    """Assert that a TRIANGLE_LIST has whole triangles and fitting colours, the others no points."""
    if marker.kind is MarkerKind.TRIANGLE_LIST:
        assert marker.scale == (1.0, 1.0, 1.0)
        assert len(marker.points) > 0
        assert len(marker.points) % 3 == 0
        assert len(marker.colours) in {0, len(marker.points)}
    else:
        assert len(marker.points) == len(marker.colours) == 0


class Viewer:
    """What rviz shows: markers by namespace and id, until deleted or faded."""

    def __init__(self) -> None:
        self.shown: dict[tuple[str, int], tuple[Marker, int]] = {}

    def receive(self, now_ns: int, markers: Iterable[Marker]) -> None:
        """Obey each marker in turn."""
        for marker in markers:
            assert_lawful(marker)
            key = (marker.namespace, marker.marker_id)
            if marker.action is MarkerAction.DELETEALL:
                self.shown.clear()
            elif marker.action is MarkerAction.DELETE:
                assert self.shown.pop(key, None) is not None, "deletes only what is shown"
            else:
                self.shown[key] = (marker, now_ns)

    def content(self, now_ns: int) -> dict[tuple[str, int], tuple[object, ...]]:
        """Return how each marker looks that has not faded by now."""
        return {
            key: looks(marker)
            for key, (marker, since_ns) in self.shown.items()
            if now_ns - since_ns < marker.lifetime_ns
        }


def looks(marker: Marker) -> tuple[object, ...]:
    """Return a comparable value of all that is drawn."""
    return (
        marker.kind,
        tuple(marker.map_from_marker.translation_m.tolist()),
        tuple(marker.map_from_marker.rotation_xyzw.tolist()),
        marker.scale,
        marker.colour,
        marker.text,
        marker.points.tobytes(),
        marker.colours.tobytes(),
    )


def added(markers: Iterable[Marker]) -> dict[str, Marker]:
    """Return the markers to add, by namespace."""
    return {m.namespace: m for m in markers if m.action is MarkerAction.ADD}


def test_numbers_are_those_of_visualization_msgs() -> None:
    """Kinds and actions carry the message's constants."""
    assert [kind.value for kind in MarkerKind] == [0, 1, 9, 11]
    assert [action.value for action in MarkerAction] == [0, 2, 3]


def test_person_is_a_box_with_a_label_above_and_an_arrow_ahead() -> None:
    """The parts stand where the pose, turned by 90 degrees, puts them."""
    parts = added(MarkerBoard().update(0, [a_subject(x=3.0, yaw=math.pi / 2)]))
    body, label, heading = parts["body"], parts["label"], parts["heading"]
    assert body.kind is MarkerKind.CUBE
    assert body.scale == (0.5, 0.6, 1.8)
    assert body.map_from_marker.translation_m == pytest.approx([3.0, 2.05, 0.9])
    assert label.text == "person"
    assert label.map_from_marker.translation_m[2] - 0.5 * label.scale[2] > 1.8
    assert heading.map_from_marker.yaw_rad() == pytest.approx(math.pi / 2)
    assert heading.scale[0] > 0.25


def test_perceived_is_opaque_and_the_rest_translucent() -> None:
    """The row's colour, its own alpha aside."""
    for perceived in (True, False):
        for shape in Shape:
            subject = a_subject(perceived=perceived, mesh=True)
            body = added(MarkerBoard(shape).update(0, [subject]))["body"]
            alphas = {body.colour[3], *body.colours[:, 3].tolist()}
            assert (min(alphas) == 1.0) is perceived
            assert body.colour[:3] == (0.2, 0.4, 0.6)


def test_mesh_is_a_list_of_triangles_in_the_artefacts_frame() -> None:
    """Corners as they are, each with its face's colour; a row without a mesh keeps its box."""
    board = MarkerBoard(Shape.MESH)
    subject = a_subject(x=3.0, mesh=True)
    body = added(board.update(0, [subject]))["body"]
    assert body.kind is MarkerKind.TRIANGLE_LIST
    assert np.array_equal(body.points, TRIANGLES.reshape(6, 3))
    assert np.array_equal(body.colours, FACES[[0, 0, 0, 1, 1, 1]])
    assert body.map_from_marker is subject.map_from_artefact
    assert added(board.update(1, [a_subject(2)]))["body"].kind is MarkerKind.CUBE


def test_plain_mesh_has_the_rows_colour() -> None:
    """Without colours of faces the list of colours is empty."""
    plain = MarkerSubject(
        *(1, "car", RigidTransform.identity(), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
        *((0.1, 0.2, 0.3, 1.0), False, TRIANGLES),
    )
    body = added(MarkerBoard(Shape.MESH).update(0, [plain]))["body"]
    assert_lawful(body)
    assert body.colours.shape == (0, 4)
    assert 0.0 < body.colour[3] < 1.0


def test_first_update_begins_with_deleteall() -> None:
    """Whatever an earlier run left on the topic is gone."""
    markers = MarkerBoard().update(0, [a_subject()])
    assert [marker.action for marker in markers] == [MarkerAction.DELETEALL] + [
        MarkerAction.ADD
    ] * 3


@pytest.mark.parametrize(
    "changed",
    [a_subject(x=0.1), a_subject(yaw=0.1), a_subject(perceived=False), a_subject(label="woman")],
)
def test_only_what_changed_is_given(changed: MarkerSubject) -> None:
    """Equal subjects are silent; a new pose, state or label is given, for that artefact alone."""
    board = MarkerBoard()
    board.update(0, [a_subject(), a_subject(2)])
    assert board.update(100 * MS, [a_subject(), a_subject(2)]) == []
    markers = board.update(200 * MS, [changed, a_subject(2)])
    assert {marker.marker_id for marker in markers} == {1}
    assert board.update(300 * MS, [changed, a_subject(2)]) == []


def test_departed_are_deleted_and_leave_nothing() -> None:
    """One DELETE for each part, once."""
    board, viewer = MarkerBoard(), Viewer()
    viewer.receive(0, board.update(0, [a_subject(), a_subject(2)]))
    markers = board.update(1, [a_subject(2)])
    assert {marker.action for marker in markers} == {MarkerAction.DELETE}
    viewer.receive(1, markers)
    assert {number for _, number in viewer.shown} == {2}
    assert board.update(2, [a_subject(2)]) == []


def test_standing_artefact_is_refreshed_each_second_and_fades_when_all_is_dead() -> None:
    """At 10 Hz for 10 s it is given every 10th tick, always shown, and gone 3 s after the last."""
    board, viewer = MarkerBoard(), Viewer()
    given_at = []
    for tick in range(101):
        markers = board.update(tick * 100 * MS, [a_subject()])
        viewer.receive(tick * 100 * MS, markers)
        given_at += [tick] if markers else []
        assert len(viewer.content(tick * 100 * MS)) == 3
    assert given_at == list(range(0, 101, 10))
    assert viewer.content(13 * NS_PER_S) == {}


def test_new_subscriber_gets_everything_after_a_deleteall() -> None:
    """What a viewer that just came sees is what the others see."""
    board, old, new = MarkerBoard(), Viewer(), Viewer()
    old.receive(0, board.update(0, [a_subject(), a_subject(2, x=1.0)]))
    old.receive(1, board.update(1, [a_subject(x=0.5), a_subject(2, x=1.0)]))
    markers = board.everything(2)
    assert markers[0].action is MarkerAction.DELETEALL
    new.receive(2, markers)
    assert new.content(2) == old.content(2)


def test_delete_all_clears_viewers_and_starts_anew() -> None:
    """After it the next update gives everything again."""
    board = MarkerBoard()
    board.update(0, [a_subject()])
    assert [marker.action for marker in board.delete_all()] == [MarkerAction.DELETEALL]
    assert len(board.update(1, [a_subject()])) == 4
    assert [marker.action for marker in MarkerBoard().everything(0)] == [MarkerAction.DELETEALL]


def test_clock_that_jumps_back_gives_everything_anew() -> None:
    """A bag that loops: no artefact of the old time remains."""
    board = MarkerBoard()
    board.update(9 * NS_PER_S, [a_subject(), a_subject(2)])
    markers = board.update(1 * NS_PER_S, [a_subject(3)])
    assert markers[0].action is MarkerAction.DELETEALL
    assert {marker.marker_id for marker in markers[1:]} == {3}


def test_ids_beyond_int32_are_wrapped() -> None:
    """A uint64 id still makes a lawful marker, and the DELETE finds it."""
    board, viewer = MarkerBoard(), Viewer()
    viewer.receive(0, board.update(0, [a_subject(2**63 + 5)]))
    assert {number for _, number in viewer.shown} == {5}
    viewer.receive(1, board.update(1, []))
    assert viewer.shown == {}


def test_blank_label_shows_the_id() -> None:
    """A text of spaces would be refused by rviz."""
    label = added(MarkerBoard().update(0, [a_subject(4, label="  ")]))["label"]
    assert label.text == "4"


SUBJECTS = st.builds(
    a_subject,
    st.integers(0, 4),
    x=st.sampled_from([0.0, 1.5]),
    yaw=st.floats(-4.0, 4.0),
    label=st.sampled_from(["person", "car", ""]),
    perceived=st.booleans(),
    mesh=st.booleans(),
)
SCENES = st.lists(
    st.tuples(
        st.integers(0, 1_500), st.lists(SUBJECTS, unique_by=lambda s: s.artefact_id, max_size=4)
    ),
    max_size=8,
)


@settings(max_examples=100, deadline=None)
@given(shape=st.sampled_from(Shape), scenes=SCENES)
def test_viewer_that_obeys_sees_exactly_the_scene(
    shape: Shape, scenes: list[tuple[int, list[MarkerSubject]]]
) -> None:
    """After any sequence of scenes, all markers being lawful, the viewer holds the last one."""
    board, viewer = MarkerBoard(shape), Viewer()
    now_ns = 0
    for step_ms, subjects in scenes:
        now_ns += step_ms * MS
        viewer.receive(now_ns, board.update(now_ns, subjects))
        fresh = Viewer()
        fresh.receive(now_ns, MarkerBoard(shape).update(now_ns, subjects))
        assert viewer.content(now_ns) == fresh.content(now_ns)
