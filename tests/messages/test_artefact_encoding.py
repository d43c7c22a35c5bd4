"""The list of artefacts as bytes, against the objects that a serialiser takes."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.agents.events import ArtefactState
from are_ros.bag.types import jazzy_typestore
from are_ros.builder.scene import Scene
from are_ros.messages import artefacts as artefact_encoding
from are_ros.messages.artefacts import ArtefactEncoder
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.shapes import Shape
from bags.simulation.making import (
    RosbagsFactory,
    make_header,
    make_point,
    make_pose,
    make_quaternion,
    make_time,
    make_twist,
    make_vector,
)

ARRAY = "are_msgs/msg/ArtefactArray"
ROW = CatalogueRow(
    3, "adult", "person", (0.5, 0.6, 1.7), (0.0, 0.1, -0.05), Shape.WALL,
    features={"age": "30", "hat": "no"},
)  # fmt: skip


class Still(PoseHistory):
    """The history of an artefact that is seen at one pose and with one velocity."""

    def __init__(self, pose: GroundPose, rates: tuple[float, float, float]) -> None:
        super().__init__(0, pose)
        self._rates = rates

    def velocity_at(self, t_ns: int) -> tuple[float, float, float]:  # noqa: ARG002 - it is one
        """Return the rates of x, y and yaw."""
        return self._rates


HISTORY = Still(GroundPose(1.0, 2.0, 0.25, 0.5), (1.2, 0.1, 0.3))
ARTEFACT = Artefact(7, ROW, Origin.SERVICE, 5_000_000_001, HISTORY, None, "walking")

TEXTS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9)
NUMBERS = st.floats(-1e6, 1e6)
TRIPLES = st.tuples(NUMBERS, NUMBERS, NUMBERS)
TIMES = st.integers(0, 2**31 * 10**9 - 1)
ROWS = st.builds(
    CatalogueRow, st.integers(0, 2**32 - 1), TEXTS, TEXTS, TRIPLES, TRIPLES, st.just(Shape.WALL),
    features=st.dictionaries(TEXTS, TEXTS, max_size=3),
)  # fmt: skip
HISTORIES = st.builds(
    Still, st.builds(GroundPose, NUMBERS, NUMBERS, NUMBERS, st.floats(-4.0, 4.0)), TRIPLES
)
ARTEFACTS = st.builds(
    Artefact, st.integers(0, 2**64 - 1), ROWS, st.sampled_from(Origin), TIMES, HISTORIES,
    st.none() | TIMES, TEXTS, TEXTS,
)  # fmt: skip


def states_of(scene: Scene) -> list[ArtefactState]:
    """Return the ground truth, artefact by artefact."""
    return [scene.state(k) for k in range(len(scene))]


def make_artefacts(
    factory: RosbagsFactory, frame_id: str, stamp_ns: int, states: Sequence[ArtefactState]
) -> Any:
    """Return the message, object by object."""
    return factory.make(
        ARRAY,
        header=make_header(factory, frame_id, stamp_ns),
        artefacts=[make_artefact(factory, state) for state in states],
    )


def make_artefact(factory: RosbagsFactory, state: ArtefactState) -> Any:
    """Return one artefact."""
    ground, half_rad = state.ground_pose, 0.5 * state.ground_pose.yaw_rad
    return factory.make(
        "are_msgs/msg/Artefact",
        id=state.artefact_id,
        row=state.row,
        label=state.label,
        class_name=state.class_name,
        pose=make_pose(factory, state.map_from_artefact),
        ground_pose=factory.make(
            "geometry_msgs/msg/Pose",
            position=make_point(factory, (ground.x_m, ground.y_m, ground.z_m)),
            orientation=make_quaternion(factory, (0, 0, math.sin(half_rad), math.cos(half_rad))),
        ),
        box_centre=make_point(factory, state.box_centre_m),
        size=make_vector(factory, state.size_m),
        twist=make_twist(factory, state.linear_velocity_m_s, state.angular_velocity_rad_s),
        behaviour=state.behaviour,
        arrival=make_time(factory, state.arrival_ns),
        departure=make_time(factory, state.departure_ns),
        origin=int(state.origin),
        features=[
            factory.make("diagnostic_msgs/msg/KeyValue", key=key, value=value)
            for key, value in state.features.items()
        ],
    )


@given(
    frame_id=TEXTS, stamp_ns=TIMES,
    artefacts=st.lists(ARTEFACTS, max_size=5, unique_by=lambda artefact: artefact.id),
)  # fmt: skip
def test_the_bytes_are_those_of_the_message(
    on_the_wire: Callable[[Any], bytes],
    factory: RosbagsFactory,
    frame_id: str,
    stamp_ns: int,
    artefacts: list[Artefact],
) -> None:
    """Encoding directly and serialising the objects give the same, whatever the padding."""
    scene = Scene.of(artefacts, 0)
    expected = on_the_wire(make_artefacts(factory, frame_id, stamp_ns, states_of(scene)))
    encoder = ArtefactEncoder()
    assert encoder.encode(frame_id, stamp_ns, scene) == expected
    assert encoder.encode(frame_id, stamp_ns, scene) == expected


CHANGES: tuple[dict[str, Any], ...] = (
    {"row": replace(ROW, index=4)}, {"row": replace(ROW, label="child")},
    {"row": replace(ROW, class_name="people")}, {"row": replace(ROW, size_m=(1.0, 1.0, 1.0))},
    {"row": replace(ROW, box_centre_in_artefact_m=(0.0, 0.0, 0.0))},
    {"row": replace(ROW, features={})}, {"behaviour": "standing"}, {"activity": "talking"},
    {"history": Still(GroundPose(3.0, 2.0, 0.0, 0.0), (1.2, 0.1, 0.3))},
    {"history": Still(HISTORY.latest, (0.0, 0.0, 0.0))},
    {"arrival_ns": 4}, {"departure_ns": 9}, {"origin": Origin.RANDOM},
)  # fmt: skip


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: next(iter(change)))
@pytest.mark.parametrize("is_same", [True, False], ids=["the same", "another"])
def test_a_change_is_seen(
    on_the_wire: Callable[[Any], bytes],
    factory: RosbagsFactory,
    change: dict[str, Any],
    is_same: bool,
) -> None:
    """Whatever is kept of an artefact, what changes in its life is told; of another one, all."""
    one, encoder = replace(ARTEFACT), ArtefactEncoder()
    before = encoder.encode("map", 9, Scene.of([one], 0))
    changed = replace(one, **change)
    if is_same and set(change) <= {"behaviour", "activity", "history", "departure_ns"}:
        for name, value in change.items():
            setattr(one, name, value)
        changed = one
    scene = Scene.of([changed], 0)
    after = encoder.encode("map", 9, scene)
    assert after != before
    assert after == on_the_wire(make_artefacts(factory, "map", 9, states_of(scene)))


def test_what_stays_is_encoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The words of an artefact are encoded again only when they change, and forgotten with it."""
    encoded: list[int] = []
    head = artefact_encoding._head

    def counting(artefact: Artefact) -> bytes:
        encoded.append(artefact.id)
        return head(artefact)

    monkeypatch.setattr(artefact_encoding, "_head", counting)
    one, two = replace(ARTEFACT, id=1), replace(ARTEFACT, id=2)
    encoder, read = ArtefactEncoder(), jazzy_typestore().deserialize_cdr
    for artefacts in ((one,), (one, two), (two,), (one, two)):
        message = read(encoder.encode("map", 0, Scene.of(artefacts, 0)), ARRAY)
        assert [a.id for a in message.artefacts] == [artefact.id for artefact in artefacts]
    assert encoded == [1, 2, 1]


def test_rclpy_reads_it(both_readings: Callable[[bytes, str], tuple[Any, Any]]) -> None:
    """Field by field what rosbags reads, of none and of several."""
    for count in range(3):
        artefacts = [replace(ARTEFACT, id=k, row=replace(ROW, label="x" * k)) for k in range(count)]
        data = ArtefactEncoder().encode("map", 9, Scene.of(artefacts, 0))
        by_rclpy, by_rosbags = both_readings(data, ARRAY)
        assert by_rclpy == by_rosbags
        assert [artefact["label"] for artefact in by_rclpy["artefacts"]] == ["", "x"][:count]


def test_a_life_that_ends_after_2038_ends_as_late_as_a_time_can(
    both_readings: Callable[[bytes, str], tuple[Any, Any]],
) -> None:
    """Its seconds are an int32."""
    forty_years_ns = 40 * 366 * 86_400 * 10**9
    late = replace(ARTEFACT, arrival_ns=forty_years_ns, departure_ns=2 * forty_years_ns)
    data = ArtefactEncoder().encode("map", 9, Scene.of([late], 0))
    (artefact,) = both_readings(data, ARRAY)[0]["artefacts"]
    assert artefact["departure"] == {"sec": f"{2**31 - 1}.0", "nanosec": "999999999.0"}


def test_the_constants_are_those_of_the_core() -> None:
    """Names and numbers of the enum are those of the message."""
    constants = {n: v for n, _, v in jazzy_typestore().fielddefs["are_msgs/msg/Artefact"][0]}
    assert constants == {member.name: member.value for member in Origin}
