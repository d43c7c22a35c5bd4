"""Markers: lawful ones, and a display that keeps a viewer up to date with the least traffic."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.builder.markers import (
    LIFETIME_NS,
    MarkerAction,
    MarkerBatch,
    MarkerDisplay,
    MarkerKind,
    MarkerLook,
    speed_steps,
)
from are_ros.builder.occlusion.meshes import MeshBank
from are_ros.builder.scene import Scene
from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import Labels
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.shapes import Shape

MS = 1_000_000
SIZE_M, BOX_CENTRE_M, COLOUR = (0.5, 0.6, 1.8), (0.05, 0.0, -0.1), (0.2, 0.4, 0.6, 0.5)
ROW = CatalogueRow(0, "person", "person", SIZE_M, BOX_CENTRE_M, Shape.WALL, COLOUR)


class Walk(PoseHistory):
    """The history of an artefact that moves ahead at a constant speed, seen where it is at 0."""

    def __init__(self, pose: GroundPose, speed_mps: float) -> None:
        super().__init__(0, pose)
        self._speed_mps = speed_mps

    def velocity_at(self, t_ns: int) -> tuple[float, float, float]:
        """Return the speed along the yaw."""
        yaw_rad = self.pose_at(t_ns).yaw_rad
        return self._speed_mps * math.cos(yaw_rad), self._speed_mps * math.sin(yaw_rad), 0.0


@dataclass(frozen=True)
class Person:
    """One of 0.5 x 0.6 x 1.8 m whose centre of mass is 0.1 m above the box's.

    They stand 2 m apart, so that no label meets another.
    """

    artefact_id: int = 1
    x: float = 0.0
    yaw: float = 0.0
    label: str = "person"
    perceived: bool = True
    speed_steps: int = 0

    def artefact(self) -> Artefact:
        """Return the artefact, another object each time."""
        pose = GroundPose(self.x, 2.0 * (self.artefact_id % 1000), 0.0, self.yaw)
        history = Walk(pose, 0.5 * self.speed_steps)
        row = replace(ROW, label=self.label)
        return Artefact(self.artefact_id, row, Origin.RANDOM, 0, history)


@cache
def kept_scene(people: tuple[Person, ...]) -> Scene:
    """Return a scene, the same object each time."""
    return Scene.of([person.artefact() for person in people], 0)


def update(
    display: MarkerDisplay,
    now_ns: int,
    people: Sequence[Person],
    *,
    everything: bool = False,
    keep: bool = False,
) -> MarkerBatch:
    """Return what a display gives out for people, of a scene that is kept or made anew."""
    make = kept_scene if keep else kept_scene.__wrapped__
    perceived = {person.artefact_id for person in people if person.perceived}
    return display.update(now_ns, make(tuple(people)), perceived, everything=everything)


def assert_lawful(marker: MarkerLook, marker_id: int, pose: Sequence[float]) -> None:
    """Assert the rules of visualization_msgs/Marker and of rviz's own check of each message."""
    assert -(2**31) <= marker_id < 2**31
    assert marker.action in {0, 2, 3}
    assert all(math.isfinite(number) for number in (*pose, *marker.scale, *marker.colour))
    assert np.linalg.norm(pose[3:]) == pytest.approx(1.0, abs=1e-6)
    if marker.action is not MarkerAction.ADD:
        return
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
        for marker, number, pose in zip(
            batch.looks, batch.ids.tolist(), batch.poses.tolist(), strict=True
        ):
            assert_lawful(marker, number, pose)
            key = (marker.namespace, number)
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
            if now_ns - since_ns < LIFETIME_NS
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
    return set(batch.ids.tolist())


def test_person_is_a_box_with_a_label_above_and_an_arrow_ahead() -> None:
    """The parts stand where the pose, turned by 90 degrees, puts them."""
    parts = added(update(MarkerDisplay(), 0, [Person(x=3.0, yaw=math.pi / 2)]))
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


@pytest.mark.parametrize("meshes", [None, MeshBank()], ids=["boxes", "meshes"])
def test_perceived_is_opaque_and_the_rest_translucent(meshes: MeshBank | None) -> None:
    """The row's colour, its own alpha aside."""
    for perceived in (True, False):
        drawn = body(update(MarkerDisplay(meshes=meshes), 0, [Person(perceived=perceived)]))
        alphas = {drawn.colour[3], *drawn.colours[:, 3].tolist()}
        assert (min(alphas) == 1.0) is perceived
        assert drawn.colour[:3] == (0.2, 0.4, 0.6)


def test_mesh_is_a_list_of_triangles_in_the_artefacts_frame() -> None:
    """Corners as they are, each with its face's colour; they fill the box about F_A."""
    bank, person = MeshBank(), Person(x=3.0, yaw=0.3)
    display = MarkerDisplay(meshes=bank)
    drawn, pose = added(update(display, 0, [person]))["body"]
    assert drawn.kind is MarkerKind.TRIANGLE_LIST
    triangles_m, face_colours = bank.drawing(ROW)
    assert np.array_equal(drawn.points, triangles_m.reshape(-1, 3))
    assert np.array_equal(drawn.colours[:, :3], np.repeat(face_colours[:, :3], 3, axis=0))
    np.testing.assert_allclose(np.ptp(drawn.points, axis=0), SIZE_M, atol=1e-6)
    np.testing.assert_array_equal(pose, Scene.of([person.artefact()], 0).poses[0])
    assert bank.drawing(ROW)[0] is triangles_m


def test_first_update_begins_with_deleteall() -> None:
    """Whatever an earlier run left on the topic is gone."""
    markers = update(MarkerDisplay(), 0, [Person()])
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
    """Equal scenes are silent; a new pose, state or label is given, for that artefact alone."""
    display = MarkerDisplay()
    update(display, 0, [Person(), Person(2)], keep=keep)
    assert not update(display, 100 * MS, [Person(), Person(2)], keep=keep)
    assert given_ids(update(display, 200 * MS, [changed, Person(2)], keep=keep)) == {1}
    assert not update(display, 220 * MS, [changed, Person(2)], keep=keep)


def test_who_only_moves_keeps_its_looks() -> None:
    """The very same objects, so that what was encoded of them can be kept; not the order counts."""
    display = MarkerDisplay()
    first = update(display, 0, [Person(), Person(2, label="car")])
    second = update(display, 1, [Person(x=1.0), Person(2, x=1.0, label="car")])
    assert all(one is other for one, other in zip(first.looks[1:], second.looks, strict=True))
    third = update(display, 2, [Person(2, x=2.0, label="car"), Person(3), Person(x=2.0)])
    assert third.looks[:3] == second.looks[3:]
    assert third.looks[6:] == second.looks[:3]


def test_departed_are_deleted_and_leave_nothing() -> None:
    """One DELETE for each part, once."""
    display, viewer = MarkerDisplay(), Viewer()
    viewer.receive(0, update(display, 0, [Person(), Person(2)]))
    markers = update(display, 1, [Person(2)])
    assert set(actions(markers)) == {MarkerAction.DELETE}
    viewer.receive(1, markers)
    assert {number for _, number in viewer.shown} == {2}
    assert not update(display, 2, [Person(2)])


def test_standing_artefact_is_refreshed_each_second_and_fades_when_all_is_dead() -> None:
    """At 10 Hz for 10 s it is given every 10th tick, always shown, and gone 3 s after the last."""
    display, viewer = MarkerDisplay(), Viewer()
    given_at = []
    for tick in range(101):
        markers = update(display, tick * 100 * MS, [Person()])
        viewer.receive(tick * 100 * MS, markers)
        given_at += [tick] if markers else []
        assert len(viewer.content(tick * 100 * MS)) == 3
    assert given_at == [0, *range(given_at[1], 101, 10)]
    assert given_at[1] <= 10
    assert viewer.content(13 * NS_PER_S) == {}


@given(artefact_id=st.integers(0, 2**64 - 1), gaps_ms=st.lists(st.integers(1, 700), max_size=30))
def test_standing_artefact_is_given_in_each_second(artefact_id: int, gaps_ms: list[int]) -> None:
    """At any ticks, what was last given a second ago or more is given."""
    display, now_ns = MarkerDisplay(), 0
    update(display, now_ns, [Person(artefact_id)])
    given_ns = now_ns
    for gap_ms in gaps_ms:
        now_ns += gap_ms * MS
        is_given = bool(update(display, now_ns, [Person(artefact_id)]))
        assert is_given or now_ns - given_ns < NS_PER_S
        given_ns = now_ns if is_given else given_ns


def test_refreshes_are_spread_over_the_ticks() -> None:
    """Of 100 who came at once, each tick of 10 Hz refreshes about ten, and each of them once."""
    display, people = MarkerDisplay(), [Person(number) for number in range(1, 101)]
    update(display, 0, people, keep=True)
    refreshed = [
        given_ids(update(display, tick * 100 * MS, people, keep=True)) for tick in range(1, 11)
    ]
    assert all(8 <= len(ids) <= 12 for ids in refreshed)
    assert Counter(number for ids in refreshed for number in ids) == dict.fromkeys(range(1, 101), 1)


def test_new_subscriber_gets_everything_after_a_deleteall() -> None:
    """What a viewer that just came sees is what the others see, with what changed just now."""
    display, old, new = MarkerDisplay(), Viewer(), Viewer()
    old.receive(0, update(display, 0, [Person(), Person(2, x=1.0), Person(3)]))
    old.receive(1, update(display, 1, [Person(x=0.5), Person(2, x=1.0), Person(3)]))
    markers = update(display, 2, [Person(x=0.7), Person(2, x=1.0)], everything=True)
    assert actions(markers) == [MarkerAction.DELETEALL] + [MarkerAction.ADD] * 6
    old.receive(2, markers)
    new.receive(2, markers)
    assert new.content(2) == old.content(2)
    assert {number for _, number in new.shown} == {1, 2}
    assert not update(display, 3, [Person(x=0.7), Person(2, x=1.0)])


def test_delete_all_clears_viewers_and_starts_anew() -> None:
    """After it the next update gives everything again."""
    display = MarkerDisplay()
    update(display, 0, [Person()])
    assert actions(display.delete_all()) == [MarkerAction.DELETEALL]
    assert len(update(display, 1, [Person()])) == 4
    assert actions(update(MarkerDisplay(), 0, [])) == [MarkerAction.DELETEALL]


def test_clock_that_jumps_back_gives_everything_anew() -> None:
    """A bag that loops: no artefact of the old time remains."""
    display = MarkerDisplay()
    update(display, 9 * NS_PER_S, [Person(), Person(2)])
    markers = update(display, 1 * NS_PER_S, [Person(3)])
    assert actions(markers)[0] is MarkerAction.DELETEALL
    assert set(markers.ids[1:].tolist()) == {3}


def test_ids_beyond_int32_are_wrapped() -> None:
    """A uint64 id still makes a lawful marker, and the DELETE finds it."""
    display, viewer = MarkerDisplay(), Viewer()
    viewer.receive(0, update(display, 0, [Person(2**63 + 5)]))
    assert {number for _, number in viewer.shown} == {5}
    viewer.receive(1, update(display, 1, []))
    assert viewer.shown == {}


@pytest.mark.parametrize(
    ("labels", "labelled"),
    [(Labels.PERCEIVED, {1, 3}), (Labels.ALL, {1, 2, 3}), (Labels.NONE, set[int]())],
)
def test_labels_are_those_that_are_wanted(labels: Labels, labelled: set[int]) -> None:
    """Of the perceived, of all or of nobody; bodies and headings are everybody's."""
    people = [Person(1), Person(2, perceived=False, x=1.0), Person(3, x=2.0)]
    display, viewer = MarkerDisplay(labels), Viewer()
    viewer.receive(0, update(display, 0, people))
    for namespace, wanted in (("body", {1, 2, 3}), ("heading", {1, 2, 3}), ("label", labelled)):
        assert {number for name, number in viewer.shown if name == namespace} == wanted
    for (name, number), (_, pose, _) in viewer.shown.items():
        assert pose[0] == pytest.approx(number - 1 + 0.05, abs=1e-9), name


def test_a_label_is_taken_away_when_its_artefact_is_lost_from_sight() -> None:
    """Once, and given again when it is perceived anew."""
    display, viewer = MarkerDisplay(), Viewer()
    viewer.receive(0, update(display, 0, [Person()]))
    lost = update(display, 1, [Person(perceived=False)])
    assert [(m.namespace, m.action) for m in lost.looks] == [
        ("label", MarkerAction.DELETE),
        ("body", MarkerAction.ADD),
        ("heading", MarkerAction.ADD),
    ]
    viewer.receive(1, lost)
    assert {name for name, _ in viewer.shown} == {"body", "heading"}
    assert not update(display, 2, [Person(perceived=False)])
    found = update(display, 3, [Person()])
    assert len(added(found)) == 3
    viewer.receive(3, found)
    viewer.receive(4, update(display, 4, []))
    assert not viewer.shown


def test_the_faster_the_longer_the_arrow() -> None:
    """In proportion, up to a bound; who changes its speed keeps its other looks."""
    display = MarkerDisplay()
    drawn = [
        added(update(display, now, [Person(speed_steps=steps)]))
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
    label, _ = added(update(MarkerDisplay(), 0, [Person(4, label="  ")]))["label"]
    assert label.text == "4"


PEOPLE = st.builds(
    Person,
    st.integers(0, 4),
    x=st.sampled_from([0.0, 1.5]),
    yaw=st.floats(-4.0, 4.0),
    label=st.sampled_from(["person", "car", ""]),
    perceived=st.booleans(),
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
    meshes=st.sampled_from([None, MeshBank()]),
    labels=st.sampled_from(Labels),
    scenes=SCENES,
    keep=st.booleans(),
)
def test_viewer_that_obeys_sees_exactly_the_scene(
    meshes: MeshBank | None,
    labels: Labels,
    scenes: list[tuple[int, list[Person], bool]],
    keep: bool,
) -> None:
    """After any sequence of scenes, all markers being lawful, the viewer holds the last one."""
    display, viewer = MarkerDisplay(labels, meshes), Viewer()
    now_ns = 0
    for step_ms, people, everything in scenes:
        now_ns += step_ms * MS
        markers = update(display, now_ns, people, everything=everything, keep=keep)
        viewer.receive(now_ns, markers)
        fresh = Viewer()
        fresh.receive(now_ns, update(MarkerDisplay(labels, meshes), now_ns, people))
        assert viewer.content(now_ns) == fresh.content(now_ns)


@pytest.fixture
def row(make_scene: Callable[..., Any]) -> CatalogueRow:
    """Return a crate whose centre of mass is not its box's centre."""
    crate: CatalogueRow = make_scene().row(1)
    return replace(crate, box_centre_in_artefact_m=(0.1, 0.0, 0.05))


def scene_of(row: CatalogueRow, *places_m: tuple[float, float], speed_mps: float = 0.0) -> Scene:
    """Return a scene of artefacts 7, 8, ... of a row."""
    walks = [Walk(GroundPose(x, y, 0.5, 0.7), speed_mps) for x, y in places_m]
    return Scene.of([Artefact(7 + k, row, Origin.SCRIPTED, 0, w) for k, w in enumerate(walks)], 0)


@pytest.mark.parametrize("meshes", [None, MeshBank()], ids=["boxes", "meshes"])
def test_a_display_draws_only_what_changed(row: CatalogueRow, meshes: MeshBank | None) -> None:
    """All at first; then nothing while it stands; then it fades from opaque as it is lost."""
    display, scene = MarkerDisplay(meshes=meshes), scene_of(row, (1.0, 2.0))
    kind = MarkerKind.TRIANGLE_LIST if meshes else MarkerKind.CUBE
    seen = body(display.update(0, scene, {7}))
    assert (seen.kind, seen.action) == (kind, MarkerAction.ADD)
    assert not display.update(NS_PER_S // 4, scene, {7})
    lost = body(display.update(NS_PER_S // 4, scene, set()))
    assert (lost.kind, lost.action) == (kind, MarkerAction.ADD)
    assert 0.0 < (lost.colours[0, 3] if meshes else lost.colour[3]) < 1.0
    gone = display.update(NS_PER_S // 4, scene_of(row), set())
    assert {marker.action for marker in gone.looks} == {MarkerAction.DELETE}


def test_who_moves_is_somewhere_else_and_looks_the_same(row: CatalogueRow) -> None:
    """Another pose keeps the looks, and those of an artefact that stands go out no more."""
    display, there = MarkerDisplay(), scene_of(row, (4.0, 5.0), (9.0, 9.0))
    first = display.update(0, scene_of(row, (1.0, 2.0), (9.0, 9.0)), {7})
    second = display.update(1, there, {7})
    assert [id(look) for look in second.looks] == [id(look) for look in first.looks[1:4]]
    pose = there.state(0).map_from_artefact
    np.testing.assert_array_equal(second.poses[0, :3], pose.apply(np.array([[0.1, 0.0, 0.05]]))[0])
    np.testing.assert_array_equal(second.poses[0, 3:], pose.rotation_xyzw)


@pytest.mark.parametrize(
    "change",
    [
        {"label": "else"},
        {"size_m": (1.0, 1.0, 1.0)},
        {"box_centre_in_artefact_m": (0.0, 0.0, 0.0)},
        {"colour": (0.0, 0.0, 1.0, 1.0)},
    ],
)
def test_another_look_is_drawn(row: CatalogueRow, change: dict[str, Any]) -> None:
    """Other words, another size, centre, colour or speed go out."""
    display, place_m = MarkerDisplay(Labels.ALL), (1.0, 2.0)
    display.update(0, scene_of(row, place_m), ())
    other = replace(row, index=6, **change)
    markers = display.update(1, scene_of(other, place_m), ())
    assert len(markers) == 3
    assert markers.looks[0].colour[:3] == other.colour[:3]
    assert len(display.update(2, scene_of(other, place_m, speed_mps=0.6), ())) == 3


def texts(markers: MarkerBatch) -> dict[int, str]:
    """Return the labels among markers."""
    return {
        number: look.text
        for number, look in zip(markers.ids.tolist(), markers.looks, strict=True)
        if look.namespace == "label" and look.text
    }


def test_labels_that_would_meet_are_ids(row: CatalogueRow) -> None:
    """Of the perceived, while they stand close; the words come back a little farther apart."""
    display, word = MarkerDisplay(), row.label

    def shown(now_ns: int, xs: tuple[float, ...], perceived: set[int]) -> dict[int, str]:
        placed = scene_of(row, *[(x, 0.0) for x in xs])
        return texts(display.update(now_ns, placed, perceived, everything=True))

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
    scene = scene_of(row, (1.0, 2.0), (1.0, 2.0))
    assert [*texts(MarkerDisplay(labels).update(0, scene, ())).values()] == wanted


def test_a_new_viewer_gets_everything(row: CatalogueRow) -> None:
    """A DELETEALL and all, with what changed just now; also after one that took all away."""
    display = MarkerDisplay()
    display.update(0, scene_of(row), ())
    for everything in (True, False):
        markers = display.update(1, scene_of(row, (1.0, 2.0)), (), everything=everything)
        assert actions(markers) == [MarkerAction.DELETEALL] + [MarkerAction.ADD] * 2
        assert actions(display.delete_all()) == [MarkerAction.DELETEALL]
