"""Markers as messages and as bytes."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from are_ros.builder.markers import Marker, MarkerAction, MarkerKind
from are_ros.errors import InputError
from are_ros.messages.marker_encoding import encode_markers
from are_ros.messages.markers import make_markers
from are_ros.messages.poses import read_pose
from are_ros.messages.times import read_time
from are_ros.replay.message_types import RosbagsFactory, jazzy_typestore
from are_ros.world.rigid_transform import RigidTransform

POSE = RigidTransform.from_xyz_ypr(1.0, 2.0, 3.0, 0.3, 0.2, 0.1)
MESH = Marker(
    "body",
    7,
    MarkerKind.TRIANGLE_LIST,
    MarkerAction.ADD,
    POSE,
    points=np.arange(18.0).reshape(6, 3),
    colours=np.linspace(0, 1, 24, dtype=np.float32).reshape(6, 4),
    lifetime_ns=2_500_000_000,
)


def label(text: str, namespace: str = "label") -> Marker:
    """Return a marker with a text."""
    kind = MarkerKind.TEXT_VIEW_FACING
    return Marker(namespace, 1, kind, MarkerAction.ADD, POSE, (0.1, 0.2, 0.3), text=text)


def test_a_marker_is_all_there(
    factory: RosbagsFactory, over_the_wire: Callable[[Any], Any]
) -> None:
    """Each field of a marker stands in its message."""
    array = over_the_wire(make_markers(factory, "map", 9, [MESH, label("person")]))
    mesh, text = array.markers
    assert (mesh.header.frame_id, read_time(mesh.header.stamp)) == ("map", 9)
    assert (mesh.ns, mesh.id, mesh.type, mesh.action) == ("body", 7, 11, 0)
    np.testing.assert_array_equal(read_pose(mesh.pose, "", "").matrix(), POSE.matrix())
    assert [(p.x, p.y, p.z) for p in mesh.points] == [tuple(row) for row in MESH.points.tolist()]
    assert [(c.r, c.g, c.b, c.a) for c in mesh.colors] == [
        tuple(row) for row in MESH.colours.tolist()
    ]
    assert read_time(mesh.lifetime) == 2_500_000_000
    assert (text.text, text.scale.x, text.scale.z) == ("person", 0.1, 0.3)
    assert (text.color.r, text.color.a) == (1.0, 1.0)


@pytest.mark.parametrize("frame_id", ["map", "odom", "m", "a_map"])
@pytest.mark.parametrize(
    "markers",
    [
        [],
        [Marker.delete_all()],
        [label(text) for text in ("", "a", "ab", "abc", "abcd", "Fußgänger")],
        [label("x", "n" * length) for length in range(9)] + [MESH] * 2,
        [MESH, label("abc"), MESH],
    ],
)
def test_the_bytes_are_those_of_the_message(
    factory: RosbagsFactory, frame_id: str, markers: list[Marker]
) -> None:
    """Encoding directly and serialising the object give the same bytes, whatever the padding."""
    array = make_markers(factory, frame_id, 1_700_000_000_123_456_789, markers)
    expected = jazzy_typestore().serialize_cdr(array, "visualization_msgs/msg/MarkerArray")
    assert encode_markers(frame_id, 1_700_000_000_123_456_789, markers) == bytes(expected)


def test_a_nul_is_refused() -> None:
    """A text that CDR cannot carry is an error, not a damaged message."""
    with pytest.raises(InputError, match="NUL"):
        encode_markers("map", 0, [label("a\0b")])
