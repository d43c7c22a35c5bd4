"""Markers: lawful ones, and a board that keeps a viewer up to date with the least traffic."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.builder.markers import (
    MarkerAction,
    MarkerBatch,
    MarkerBoard,
    MarkerKind,
    MarkerLook,
    MarkerSubject,
    speed_steps,
)
from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import Labels, Shape
from are_ros.world.rigid_transform import RigidTransform

MS = 1_000_000
TRIANGLES = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 0, 1], [0, 1, 1]]], float)
FACES = np.array([[1, 0, 0, 1], [0, 0, 1, 1]], np.float32)


@dataclass(frozen=True)
class Person:
    """One of 0.5 x 0.6 x 1.8 m whose centre of mass is 0.1 m above the box's."""

    artefact_id: int = 1
    x: float = 0.0
    yaw: float = 0.0
    label: str = "person"
    perceived: bool = True
    mesh: bool = False
    speed_steps: int = 0

    @property
    def pose(self) -> list[float]:
        """Where it stands."""
        pose = RigidTransform.planar(self.x, 2.0, self.yaw, z=1.0)
        return [*pose.translation_m.tolist(), *pose.rotation_xyzw.tolist()]

    def subject(self) -> MarkerSubject:
        """Return it as the board takes it, another object each time."""
        return MarkerSubject(
            self.artefact_id,
            self.label,
            (0.05, 0.0, -0.1),
            (0.5, 0.6, 1.8),
            (0.2, 0.4, 0.6, 0.5),
            self.perceived,
            TRIANGLES if self.mesh else None,
            FACES if self.mesh else None,
            self.speed_steps,
        )


@cache
def kept_subject(
    artefact_id: int, label: str, perceived: bool, mesh: bool, speed_steps: int
) -> MarkerSubject:
    """Return a subject, the same object each time."""
    look = {"label": label, "perceived": perceived, "mesh": mesh, "speed_steps": speed_steps}
    return Person(artefact_id, **look).subject()  # type: ignore[arg-type]


def update(
    board: MarkerBoard,
    now_ns: int,
    people: Sequence[Person],
    *,
    everything: bool = False,
    keep: bool = False,
) -> MarkerBatch:
    """Return what a board gives out for people, with subjects that are kept or made anew."""
    subjects = [
        kept_subject(p.artefact_id, p.label, p.perceived, p.mesh, p.speed_steps)
        if keep
        else p.subject()
        for p in people
    ]
    poses = np.array([person.pose for person in people]).reshape(-1, 7)
    return board.update(now_ns, subjects, poses, everything=everything)


def assert_lawful(marker: MarkerLook, pose: Sequence[float]) -> None:
    """Assert the rules of visualization_msgs/Marker and of rviz's own check of each message."""
    assert -(2**31) <= marker.marker_id < 2**31
    assert marker.action in {0, 2, 3}
    assert all(math.isfinite(number) for number in (*pose, *marker.scale, *marker.colour))
    assert np.linalg.norm(pose[3:]) == pytest.approx(1.0, abs=1e-6)
    if marker.action is not MarkerAction.ADD:
        return
    assert marker.lifetime_ns == 3 * NS_PER_S
    assert all(0.0 <= channel <= 1.0 for channel in marker.colour)
    assert marker.colour[3] > 0.0
    assert all(component > 0.0 for component in marker.scale)
    assert bool(marker.text.strip()) == (marker.kind is MarkerKind.TEXT_VIEW_FACING)
    assert_lawful_points(marker)


def assert_lawful_points(marker: MarkerLook) -> None:
    """Assert that a TRIANGLE_LIST has whole triangles and fitting colours, the others no points."""
    if marker.kind is MarkerKind.TRIANGLE_LIST:
        assert marker.scale == (1.0, 1.0, 1.0)
        assert len(marker.points) > 0
        assert len(marker.points) % 3 == 0
        assert len(marker.colours) in {0, len(marker.points)}
    else:
        assert len(marker.points) == len(marker.colours) == 0


class Viewer:
    """What rviz shows: markers and poses by namespace and id, until deleted or faded."""

    def __init__(self) -> None:
        self.shown: dict[tuple[str, int], tuple[MarkerLook, list[float], int]] = {}

    def receive(self, now_ns: int, batch: MarkerBatch) -> None:
        """Obey each marker in turn."""
        assert batch.poses.shape == (len(batch), 7)
        for marker, pose in zip(batch.looks, batch.poses.tolist(), strict=True):
            assert_lawful(marker, pose)
            key = (marker.namespace, marker.marker_id)
            if marker.action is MarkerAction.DELETEALL:
                self.shown.clear()
            elif marker.action is MarkerAction.DELETE:
                assert self.shown.pop(key, None) is not None, "deletes only what is shown"
            else:
                self.shown[key] = (marker, pose, now_ns)

    def content(self, now_ns: int) -> dict[tuple[str, int], tuple[object, ...]]:
        """Return how each marker looks that has not faded by now."""
        return {
            key: (*pose, *looks(marker))
            for key, (marker, pose, since_ns) in self.shown.items()
            if now_ns - since_ns < marker.lifetime_ns
        }


def looks(marker: MarkerLook) -> tuple[object, ...]:
    """Return a comparable value of all that is drawn."""
    return (
        marker.kind,
        marker.scale,
        marker.colour,
        marker.text,
        marker.points.tobytes(),
        marker.colours.tobytes(),
    )


def added(batch: MarkerBatch) -> dict[str, tuple[MarkerLook, list[float]]]:
    """Return the markers to add and their poses, by namespace."""
    return {
        look.namespace: (look, pose)
        for look, pose in zip(batch.looks, batch.poses.tolist(), strict=True)
        if look.action is MarkerAction.ADD
    }


def body(batch: MarkerBatch) -> MarkerLook:
    """Return the one body among markers."""
    return added(batch)["body"][0]


def actions(batch: MarkerBatch) -> list[MarkerAction]:
    """Return what the markers do."""
    return [look.action for look in batch.looks]


def given_ids(batch: MarkerBatch) -> set[int]:
    """Return whose markers there are."""
    return {look.marker_id for look in batch.looks}


def test_person_is_a_box_with_a_label_above_and_an_arrow_ahead() -> None:
    """The parts stand where the pose, turned by 90 degrees, puts them."""
    parts = added(update(MarkerBoard(), 0, [Person(x=3.0, yaw=math.pi / 2)]))
    (box, box_at), (label, label_at), (arrow, arrow_at) = (
        parts[name] for name in ("body", "label", "heading")
    )
    assert box.kind is MarkerKind.CUBE
    assert box.scale == (0.5, 0.6, 1.8)
    assert box_at[:3] == pytest.approx([3.0, 2.05, 0.9])
    assert label.text == "person"
    assert label_at[2] - 0.5 * label.scale[2] > 1.8
    assert arrow_at[3:] == pytest.approx([0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)])
    assert arrow.scale[0] > 0.25


def test_perceived_is_opaque_and_the_rest_translucent() -> None:
    """The row's colour, its own alpha aside."""
    for perceived in (True, False):
        for shape in Shape:
            person = Person(perceived=perceived, mesh=True)
            drawn = body(update(MarkerBoard(shape), 0, [person]))
            alphas = {drawn.colour[3], *drawn.colours[:, 3].tolist()}
            assert (min(alphas) == 1.0) is perceived
            assert drawn.colour[:3] == (0.2, 0.4, 0.6)


def test_mesh_is_a_list_of_triangles_in_the_artefacts_frame() -> None:
    """Corners as they are, each with its face's colour; a row without a mesh keeps its box."""
    board = MarkerBoard(Shape.MESH)
    person = Person(x=3.0, yaw=0.3, mesh=True)
    drawn, pose = added(update(board, 0, [person]))["body"]
    assert drawn.kind is MarkerKind.TRIANGLE_LIST
    assert np.array_equal(drawn.points, TRIANGLES.reshape(6, 3))
    assert np.array_equal(drawn.colours, FACES[[0, 0, 0, 1, 1, 1]])
    assert pose == person.pose
    assert body(update(board, 1, [Person(2)])).kind is MarkerKind.CUBE


def test_plain_mesh_has_the_rows_colour() -> None:
    """Without colours of faces the list of colours is empty."""
    plain = MarkerSubject(
        1, "car", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.1, 0.2, 0.3, 1.0), False, TRIANGLES
    )
    pose = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    drawn, at = added(MarkerBoard(Shape.MESH).update(0, [plain], pose))["body"]
    assert_lawful(drawn, at)
    assert drawn.colours.shape == (0, 4)
    assert 0.0 < drawn.colour[3] < 1.0


def test_first_update_begins_with_deleteall() -> None:
    """Whatever an earlier run left on the topic is gone."""
    markers = update(MarkerBoard(), 0, [Person()])
    assert actions(markers) == [MarkerAction.DELETEALL] + [MarkerAction.ADD] * 3


@pytest.mark.parametrize("keep", [True, False])
@pytest.mark.parametrize(
    "changed",
    [
        Person(x=0.1),
        Person(yaw=0.1),
        Person(perceived=False),
        Person(label="woman"),
        Person(speed_steps=3),
    ],
)
def test_only_what_changed_is_given(changed: Person, keep: bool) -> None:
    """Equal subjects are silent; a new pose, state or label is given, for that artefact alone."""
    board = MarkerBoard()
    update(board, 0, [Person(), Person(2)], keep=keep)
    assert not update(board, 100 * MS, [Person(), Person(2)], keep=keep)
    assert given_ids(update(board, 200 * MS, [changed, Person(2)], keep=keep)) == {1}
    assert not update(board, 220 * MS, [changed, Person(2)], keep=keep)


def test_who_only_moves_keeps_its_looks() -> None:
    """The very same objects, so that what was encoded of them can be kept; not the order counts."""
    board = MarkerBoard()
    first = update(board, 0, [Person(), Person(2)])
    second = update(board, 1, [Person(x=1.0), Person(2, x=1.0)])
    assert all(one is other for one, other in zip(first.looks[1:], second.looks, strict=True))
    third = update(board, 2, [Person(2, x=2.0), Person(3), Person(x=2.0)])
    assert third.looks[:3] == second.looks[3:]
    assert third.looks[6:] == second.looks[:3]


def test_departed_are_deleted_and_leave_nothing() -> None:
    """One DELETE for each part, once."""
    board, viewer = MarkerBoard(), Viewer()
    viewer.receive(0, update(board, 0, [Person(), Person(2)]))
    markers = update(board, 1, [Person(2)])
    assert set(actions(markers)) == {MarkerAction.DELETE}
    viewer.receive(1, markers)
    assert {number for _, number in viewer.shown} == {2}
    assert not update(board, 2, [Person(2)])


def test_standing_artefact_is_refreshed_each_second_and_fades_when_all_is_dead() -> None:
    """At 10 Hz for 10 s it is given every 10th tick, always shown, and gone 3 s after the last."""
    board, viewer = MarkerBoard(), Viewer()
    given_at = []
    for tick in range(101):
        markers = update(board, tick * 100 * MS, [Person()])
        viewer.receive(tick * 100 * MS, markers)
        given_at += [tick] if markers else []
        assert len(viewer.content(tick * 100 * MS)) == 3
    assert given_at == [0, *range(given_at[1], 101, 10)]
    assert given_at[1] <= 10
    assert viewer.content(13 * NS_PER_S) == {}


@given(artefact_id=st.integers(0, 2**64 - 1), gaps_ms=st.lists(st.integers(1, 700), max_size=30))
def test_standing_artefact_is_given_in_each_second(artefact_id: int, gaps_ms: list[int]) -> None:
    """At any ticks, what was last given a second ago or more is given."""
    board, now_ns = MarkerBoard(), 0
    update(board, now_ns, [Person(artefact_id)])
    given_ns = now_ns
    for gap_ms in gaps_ms:
        now_ns += gap_ms * MS
        is_given = bool(update(board, now_ns, [Person(artefact_id)]))
        assert is_given or now_ns - given_ns < NS_PER_S
        given_ns = now_ns if is_given else given_ns


def test_refreshes_are_spread_over_the_ticks() -> None:
    """Of 100 who came at once, each tick of 10 Hz refreshes about ten, and each of them once."""
    board, people = MarkerBoard(), [Person(number) for number in range(1, 101)]
    update(board, 0, people, keep=True)
    refreshed = [
        given_ids(update(board, tick * 100 * MS, people, keep=True)) for tick in range(1, 11)
    ]
    assert all(8 <= len(ids) <= 12 for ids in refreshed)
    assert Counter(number for ids in refreshed for number in ids) == dict.fromkeys(range(1, 101), 1)


def test_new_subscriber_gets_everything_after_a_deleteall() -> None:
    """What a viewer that just came sees is what the others see, with what changed just now."""
    board, old, new = MarkerBoard(), Viewer(), Viewer()
    old.receive(0, update(board, 0, [Person(), Person(2, x=1.0), Person(3)]))
    old.receive(1, update(board, 1, [Person(x=0.5), Person(2, x=1.0), Person(3)]))
    markers = update(board, 2, [Person(x=0.7), Person(2, x=1.0)], everything=True)
    assert actions(markers) == [MarkerAction.DELETEALL] + [MarkerAction.ADD] * 6
    old.receive(2, markers)
    new.receive(2, markers)
    assert new.content(2) == old.content(2)
    assert {number for _, number in new.shown} == {1, 2}
    assert not update(board, 3, [Person(x=0.7), Person(2, x=1.0)])


def test_delete_all_clears_viewers_and_starts_anew() -> None:
    """After it the next update gives everything again."""
    board = MarkerBoard()
    update(board, 0, [Person()])
    assert actions(board.delete_all()) == [MarkerAction.DELETEALL]
    assert len(update(board, 1, [Person()])) == 4
    assert actions(update(MarkerBoard(), 0, [])) == [MarkerAction.DELETEALL]


def test_clock_that_jumps_back_gives_everything_anew() -> None:
    """A bag that loops: no artefact of the old time remains."""
    board = MarkerBoard()
    update(board, 9 * NS_PER_S, [Person(), Person(2)])
    markers = update(board, 1 * NS_PER_S, [Person(3)])
    assert actions(markers)[0] is MarkerAction.DELETEALL
    assert {look.marker_id for look in markers.looks[1:]} == {3}


def test_poses_given_are_the_callers_own() -> None:
    """An array that is written to later does not change what was given out, or is known."""
    board, poses = MarkerBoard(), np.array([Person().pose])
    first = board.update(0, [Person().subject()], poses)
    places = first.poses.copy()
    poses[0, 0] = 5.0
    np.testing.assert_array_equal(first.poses, places)
    assert given_ids(board.update(1, [Person().subject()], poses)) == {1}


def test_ids_beyond_int32_are_wrapped() -> None:
    """A uint64 id still makes a lawful marker, and the DELETE finds it."""
    board, viewer = MarkerBoard(), Viewer()
    viewer.receive(0, update(board, 0, [Person(2**63 + 5)]))
    assert {number for _, number in viewer.shown} == {5}
    viewer.receive(1, update(board, 1, []))
    assert viewer.shown == {}


@pytest.mark.parametrize(
    ("labels", "labelled"),
    [(Labels.PERCEIVED, {1, 3}), (Labels.ALL, {1, 2, 3}), (Labels.NONE, set[int]())],
)
def test_labels_are_those_that_are_wanted(labels: Labels, labelled: set[int]) -> None:
    """Of the perceived, of all or of nobody; bodies and headings are everybody's."""
    people = [Person(1), Person(2, perceived=False, x=1.0), Person(3, x=2.0)]
    board, viewer = MarkerBoard(Shape.BOX, labels), Viewer()
    viewer.receive(0, update(board, 0, people))
    for namespace, wanted in (("body", {1, 2, 3}), ("heading", {1, 2, 3}), ("label", labelled)):
        assert {number for name, number in viewer.shown if name == namespace} == wanted
    for (name, number), (_, pose, _) in viewer.shown.items():
        assert pose[0] == pytest.approx(number - 1 + 0.05, abs=1e-9), name


def test_a_label_is_taken_away_when_its_artefact_is_lost_from_sight() -> None:
    """Once, and given again when it is perceived anew."""
    board, viewer = MarkerBoard(), Viewer()
    viewer.receive(0, update(board, 0, [Person()]))
    lost = update(board, 1, [Person(perceived=False)])
    assert [(m.namespace, m.action) for m in lost.looks] == [
        ("label", MarkerAction.DELETE),
        ("body", MarkerAction.ADD),
        ("heading", MarkerAction.ADD),
    ]
    viewer.receive(1, lost)
    assert {name for name, _ in viewer.shown} == {"body", "heading"}
    assert not update(board, 2, [Person(perceived=False)])
    found = update(board, 3, [Person()])
    assert len(added(found)) == 3
    viewer.receive(3, found)
    viewer.receive(4, update(board, 4, []))
    assert not viewer.shown


def test_the_faster_the_longer_the_arrow() -> None:
    """In proportion, up to a bound; who changes its speed keeps its other looks."""
    board = MarkerBoard()
    drawn = [
        added(update(board, now, [Person(speed_steps=steps, mesh=True)]))
        for now, steps in enumerate((0, 1, 2, 4, 100, 200))
    ]
    past = [parts["heading"][0].scale[0] - 0.25 for parts in drawn]
    assert past[:4] == pytest.approx([0.1, 0.4, 0.7, 1.3])
    assert past[4] == past[5] == 2.0
    for one, other in pairwise(drawn):
        assert one["body"][0] is other["body"][0]
        assert one["label"][0] is other["label"][0]


def test_speeds_are_drawn_in_steps() -> None:
    """Of half a metre per second, whichever the direction."""
    assert [speed_steps(v, 0.0) for v in (0.0, 0.24, 0.26, 1.0, -1.0, 1.3)] == [0, 0, 1, 2, 2, 3]
    assert speed_steps(0.6, -0.8) == 2


def test_blank_label_shows_the_id() -> None:
    """A text of spaces would be refused by rviz."""
    label, _ = added(update(MarkerBoard(), 0, [Person(4, label="  ")]))["label"]
    assert label.text == "4"


PEOPLE = st.builds(
    Person,
    st.integers(0, 4),
    x=st.sampled_from([0.0, 1.5]),
    yaw=st.floats(-4.0, 4.0),
    label=st.sampled_from(["person", "car", ""]),
    perceived=st.booleans(),
    mesh=st.booleans(),
    speed_steps=st.integers(0, 2),
)
SCENES = st.lists(
    st.tuples(
        st.integers(0, 1_500),
        st.lists(PEOPLE, unique_by=lambda person: person.artefact_id, max_size=4),
        st.booleans(),
    ),
    max_size=8,
)


@settings(max_examples=100, deadline=None)
@given(
    shape=st.sampled_from(Shape),
    labels=st.sampled_from(Labels),
    scenes=SCENES,
    keep=st.booleans(),
)
def test_viewer_that_obeys_sees_exactly_the_scene(
    shape: Shape, labels: Labels, scenes: list[tuple[int, list[Person], bool]], keep: bool
) -> None:
    """After any sequence of scenes, all markers being lawful, the viewer holds the last one."""
    board, viewer = MarkerBoard(shape, labels), Viewer()
    now_ns = 0
    for step_ms, people, everything in scenes:
        now_ns += step_ms * MS
        markers = update(board, now_ns, people, everything=everything, keep=keep)
        viewer.receive(now_ns, markers)
        fresh = Viewer()
        fresh.receive(now_ns, update(MarkerBoard(shape, labels), now_ns, people))
        assert viewer.content(now_ns) == fresh.content(now_ns)
