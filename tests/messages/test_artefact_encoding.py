"""The list of artefacts as bytes, against the objects that a serialiser takes."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.agents.events import ArtefactState
from are_ros.bag.types import RosbagsFactory, jazzy_typestore
from are_ros.messages import artefacts as artefact_encoding
from are_ros.messages.artefacts import ArtefactEncoder
from are_ros.messages.common import (
    make_header,
    make_point,
    make_pose,
    make_quaternion,
    make_time,
    make_vector,
)
from are_ros.population.artefact import GroundPose, Origin
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.making import make_twist

ARRAY = "are_msgs/msg/ArtefactArray"
STATE = ArtefactState(
    7, 3, "adult", "person", RigidTransform.planar(1.0, 2.0, 0.5, z=0.9),
    GroundPose(1.0, 2.0, 0.25, 0.5), (0.0, 0.1, -0.05), (0.5, 0.6, 1.7), (1.2, 0.0, 0.0),
    (0.0, 0.0, 0.3), "walking", 5_000_000_001, 0, Origin.SERVICE, {"age": "30", "hat": "no"},
)  # fmt: skip

TEXTS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9)
NUMBERS = st.floats(allow_nan=False)
TRIPLES = st.tuples(NUMBERS, NUMBERS, NUMBERS)
TIMES = st.integers(0, 2**31 * 10**9 - 1)
TRANSFORMS = st.builds(
    RigidTransform.from_xyz_ypr, *[st.floats(-1e6, 1e6)] * 3, *[st.floats(-4, 4)] * 3
)
STATES = st.builds(
    ArtefactState,
    st.integers(0, 2**64 - 1), st.integers(0, 2**32 - 1), TEXTS, TEXTS, TRANSFORMS,
    st.builds(GroundPose, NUMBERS, NUMBERS, NUMBERS, st.floats(-4.0, 4.0)), TRIPLES, TRIPLES,
    TRIPLES, TRIPLES, TEXTS, TIMES, TIMES, st.sampled_from(Origin),
    st.dictionaries(TEXTS, TEXTS, max_size=3),
)  # fmt: skip


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
    states=st.lists(STATES, max_size=5, unique_by=lambda state: state.artefact_id),
)  # fmt: skip
def test_the_bytes_are_those_of_the_message(
    on_the_wire: Callable[[Any], bytes],
    factory: RosbagsFactory,
    frame_id: str,
    stamp_ns: int,
    states: list[ArtefactState],
) -> None:
    """Encoding directly and serialising the objects give the same, whatever the padding."""
    expected = on_the_wire(make_artefacts(factory, frame_id, stamp_ns, states))
    encoder = ArtefactEncoder()
    assert encoder.encode(frame_id, stamp_ns, states) == expected
    assert encoder.encode(frame_id, stamp_ns, states) == expected


CHANGES: tuple[dict[str, Any], ...] = (
    {"row": 4}, {"label": "child"}, {"class_name": "people"}, {"behaviour": "standing"},
    {"map_from_artefact": RigidTransform.planar(2.0, 2.0, 0.5)}, {"size_m": (1.0, 1.0, 1.0)},
    {"ground_pose": GroundPose(3.0, 2.0, 0.0, 0.0)}, {"box_centre_m": (0.0, 0.0, 0.0)},
    {"linear_velocity_m_s": (0.0, 0.0, 0.0)}, {"angular_velocity_rad_s": (0.0, 0.0, 0.0)},
    {"arrival_ns": 4}, {"departure_ns": 9}, {"origin": Origin.RANDOM}, {"features": {}},
)  # fmt: skip


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: next(iter(change)))
def test_a_change_is_seen(
    on_the_wire: Callable[[Any], bytes], factory: RosbagsFactory, change: dict[str, Any]
) -> None:
    """Whatever is kept of an artefact, each of its fields is that of its state."""
    changed, encoder = replace(STATE, **change), ArtefactEncoder()
    before = encoder.encode("map", 9, [STATE])
    after = encoder.encode("map", 9, [changed])
    assert after != before
    assert after == on_the_wire(make_artefacts(factory, "map", 9, [changed]))


def test_states_that_are_kept_are_encoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The numbers of a state are packed again only for a new state, and forgotten with it."""
    packed: list[int] = []
    pack = artefact_encoding._numbers

    def counting(state: ArtefactState) -> bytes:
        packed.append(state.artefact_id)
        return pack(state)

    monkeypatch.setattr(artefact_encoding, "_numbers", counting)
    one, two = replace(STATE, artefact_id=1), replace(STATE, artefact_id=2)
    moved, encoder = replace(one, ground_pose=GroundPose(7.0, 2.0, 0.0, 0.5)), ArtefactEncoder()
    scenes = ((one,), (one, two), (moved, two), (two,), (one, two))
    read = jazzy_typestore().deserialize_cdr
    lists = [read(encoder.encode("map", 0, scene), ARRAY).artefacts for scene in scenes]
    assert [[(a.id, a.ground_pose.position.x) for a in artefacts] for artefacts in lists] == [
        [(state.artefact_id, state.ground_pose.x_m) for state in scene] for scene in scenes
    ]
    assert packed == [1, 2, 1, 1]


def test_rclpy_reads_it(both_readings: Callable[[bytes, str], tuple[Any, Any]]) -> None:
    """Field by field what rosbags reads, of none and of several."""
    for count in range(3):
        states = [replace(STATE, artefact_id=k, label="x" * k) for k in range(count)]
        by_rclpy, by_rosbags = both_readings(ArtefactEncoder().encode("map", 9, states), ARRAY)
        assert by_rclpy == by_rosbags
        assert [artefact["label"] for artefact in by_rclpy["artefacts"]] == ["", "x"][:count]


def test_the_constants_are_those_of_the_core() -> None:
    """Names and numbers of the enum are those of the message."""
    constants = {n: v for n, _, v in jazzy_typestore().fielddefs["are_msgs/msg/Artefact"][0]}
    assert constants == {member.name: member.value for member in Origin}
