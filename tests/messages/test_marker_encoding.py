"""Markers as bytes, against the objects that a serialiser takes."""

import gc
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.builder.markers import (
    DELETE_ALL,
    NO_COLOURS,
    NO_MARKERS,
    MarkerAction,
    MarkerBatch,
    MarkerKind,
    MarkerLook,
)
from are_ros.errors import InputError
from are_ros.messages import markers as marker_encoding
from are_ros.messages.markers import MarkerEncoder
from bags.simulation.making import (
    RosbagsFactory,
    make_header,
    make_point,
    make_quaternion,
    make_vector,
)

ARRAY = "visualization_msgs/msg/MarkerArray"
NOW_NS = 1_700_000_000_123_456_789
MESH = MarkerLook(
    "body",
    MarkerKind.TRIANGLE_LIST,
    points=np.arange(18.0).reshape(6, 3),
    colours=np.linspace(0, 1, 24, dtype=np.float32).reshape(6, 4),
)
TEXTS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9)
LOOKS = st.builds(
    MarkerLook,
    TEXTS,
    st.sampled_from(MarkerKind),
    st.sampled_from(MarkerAction),
    st.tuples(*[st.floats()] * 3),
    st.tuples(*[st.floats(width=32)] * 4),
    TEXTS,
    st.integers(0, 3).map(lambda count: np.arange(9.0 * count).reshape(-1, 3)),
    st.integers(0, 3).map(lambda count: np.arange(4 * count, dtype=np.float32).reshape(-1, 4)),
)


def label(text: str, namespace: str = "label") -> MarkerLook:
    """Return a marker with a text."""
    return MarkerLook(
        namespace, MarkerKind.TEXT_VIEW_FACING, MarkerAction.ADD, (0.1, 0.2, 0.3), text=text
    )


def posed(*looks: MarkerLook, seed: int = 0) -> MarkerBatch:
    """Return looks with ids and poses of their own."""
    random = np.random.default_rng(seed)
    ids = random.integers(0, 2**31, len(looks))
    return MarkerBatch(looks, ids, random.normal(size=(len(looks), 7)))


def make_markers(factory: RosbagsFactory, frame_id: str, stamp_ns: int, batch: MarkerBatch) -> Any:
    """Return the message, object by object."""
    header = make_header(factory, frame_id, stamp_ns)
    markers = [
        make_marker(factory, header, look, number, pose)
        for look, number, pose in zip(
            batch.looks, batch.ids.tolist(), batch.poses.tolist(), strict=True
        )
    ]
    return factory.make(ARRAY, markers=markers)


def make_marker(
    factory: RosbagsFactory, header: Any, look: MarkerLook, number: int, pose: list[float]
) -> Any:
    """Return one marker."""
    return factory.make(
        "visualization_msgs/msg/Marker",
        header=header,
        ns=look.namespace,
        id=number,
        type=int(look.kind),
        action=int(look.action),
        pose=factory.make(
            "geometry_msgs/msg/Pose",
            position=make_point(factory, pose[:3]),
            orientation=make_quaternion(factory, pose[3:]),
        ),
        scale=make_vector(factory, look.scale),
        color=make_colour(factory, look.colour),
        lifetime=factory.make("builtin_interfaces/msg/Duration", sec=3, nanosec=0),
        points=[make_point(factory, point) for point in look.points.tolist()],
        colors=[make_colour(factory, colour) for colour in look.colours.tolist()],
        text=look.text,
    )


def make_colour(factory: RosbagsFactory, rgba: Any) -> Any:
    """Return a colour."""
    red, green, blue, alpha = rgba
    return factory.make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=alpha)


@given(
    frame_id=TEXTS,
    stamp_ns=st.integers(0, 2**31 * 10**9 - 1),
    looks=st.lists(LOOKS, max_size=5),
    seed=st.integers(0, 99),
)
def test_the_bytes_are_those_of_the_message(
    on_the_wire: Callable[[Any], bytes],
    factory: RosbagsFactory,
    frame_id: str,
    stamp_ns: int,
    looks: list[MarkerLook],
    seed: int,
) -> None:
    """Encoding directly and serialising the objects give the same, whatever the padding."""
    batch = posed(*looks, seed=seed)
    expected = on_the_wire(make_markers(factory, frame_id, stamp_ns, batch))
    assert MarkerEncoder().encode(frame_id, stamp_ns, batch) == expected


POOL = (MESH, *(label(text) for text in ("", "a", "ab", "Fußgänger")), *DELETE_ALL.looks)


@given(
    batches=st.lists(
        st.tuples(
            st.lists(st.sampled_from(POOL), max_size=6),
            st.integers(0, 9),
            st.sampled_from(["map", "odom"]),
        ),
        max_size=6,
    )
)
def test_what_is_kept_does_no_harm(
    on_the_wire: Callable[[Any], bytes],
    factory: RosbagsFactory,
    batches: list[tuple[list[MarkerLook], int, str]],
) -> None:
    """Each of a sequence of batches has the bytes that it would have as the first."""
    encoder = MarkerEncoder()
    for looks, seed, frame_id in batches:
        batch = posed(*looks, seed=seed)
        expected = on_the_wire(make_markers(factory, frame_id, NOW_NS + seed, batch))
        assert encoder.encode(frame_id, NOW_NS + seed, batch) == expected


def test_a_look_is_encoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not again for another pose, nor in other company; and it is forgotten with its marker."""
    encoded: list[str] = []
    tail = marker_encoding._tail

    def counting(look: MarkerLook) -> bytes:
        encoded.append(look.text)
        return tail(look)

    monkeypatch.setattr(marker_encoding, "_tail", counting)
    encoder, one, two = MarkerEncoder(), label("one"), label("two")
    for looks in ((one,), (one,), (two, one), (one, two), (two,)):
        encoder.encode("map", 0, posed(*looks))
    assert encoded == ["one", "two"]
    assert len(encoder._tails) == 2
    encoder.encode("map", 0, NO_MARKERS)
    del one, two, looks
    gc.collect()
    assert len(encoder._tails) == 0


def test_a_message_given_out_does_not_change() -> None:
    """The next one of the same looks is another object, with other poses."""
    encoder = MarkerEncoder()
    first = encoder.encode("map", 1, posed(MESH))
    copy = bytes(bytearray(first))
    second = encoder.encode("map", 2, posed(MESH, seed=1))
    assert first == copy
    assert second != first


def test_rclpy_reads_it(both_readings: Callable[[bytes, str], tuple[Any, Any]]) -> None:
    """Field by field what rosbags reads."""
    plain_mesh = replace(MESH, colours=NO_COLOURS)
    batch = DELETE_ALL.followed_by(posed(MESH, label("ab"), plain_mesh, label("abc"), MESH))
    encoder = MarkerEncoder()
    for markers in (NO_MARKERS, batch, batch):
        by_rclpy, by_rosbags = both_readings(encoder.encode("map", NOW_NS, markers), ARRAY)
        assert by_rclpy == by_rosbags
        assert len(by_rclpy["markers"]) == len(markers)


def test_a_nul_is_refused() -> None:
    """A text that CDR cannot carry is an error, not a damaged message."""
    with pytest.raises(InputError, match="NUL"):
        MarkerEncoder().encode("map", 0, posed(label("a\0b")))
