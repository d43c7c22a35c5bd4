"""The rules of visualization_msgs/Marker, each with markers that break it; and the decoding."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from are_ros.bag import marker_decoding as kinds
from are_ros.bag.marker_decoding import ADD, DELETE, DELETE_ALL, MarkerFields
from are_ros.bag.types import jazzy_typestore
from are_ros.checks.marker_rules import change_of
from bags.simulation.making import RosbagsFactory

NO_POINTS, NO_COLOURS = np.zeros((0, 3)), np.zeros((0, 4), np.float32)
SECOND = 1_000_000_000


def marker(kind: int = kinds.CUBE, **fields: Any) -> MarkerFields:
    """Return a marker that breaks no rule, but for the fields given."""
    count = 3 if kind == kinds.TRIANGLES else 0
    right = MarkerFields(
        stamp_ns=5,
        frame_id="map",
        namespace="body",
        number=7,
        kind=kind,
        action=ADD,
        position=np.zeros(3),
        rotation_xyzw=np.array((0.0, 0.0, 0.0, 1.0)),
        scale=np.ones(3),
        colour=np.array((0.2, 0.4, 0.6, 1.0)),
        lifetime_ns=3 * SECOND,
        is_frame_locked=False,
        points=np.arange(3.0 * count).reshape(-1, 3),
        colours=NO_COLOURS,
        texture_points=0,
        text="person" if kind == kinds.TEXT else "",
        mesh="",
        keeps_materials=False,
    )
    return right._replace(**fields)


@dataclass(frozen=True)
class Case:
    """A kind, fields that break a rule, and a part of what is said of it."""

    kind: int
    fields: dict[str, Any]
    text: str


def colours(count: int, alpha: float = 1.0, red: float = 0.5) -> Any:
    """Return so many colours."""
    return np.tile(np.array((red, 0.5, 0.5, alpha), np.float32), (count, 1))


BROKEN = {
    "no frame": Case(kinds.CUBE, {"frame_id": ""}, "names no frame"),
    "action": Case(kinds.CUBE, {"action": 1}, "has the action 1"),
    "type": Case(13, {}, "is of type 13"),
    "negative type": Case(-1, {}, "is of type -1"),
    "a line": Case(4, {}, "is of type 4, which the node does not write"),
    "inside out": Case(kinds.CUBE, {"scale": np.array((-1.0, 1.0, 1.0))}, "has the scale"),
    "too red a point": Case(kinds.TRIANGLES, {"colours": colours(3, red=2.0)}, "outside of 0 to 1"),
    "only clear": Case(kinds.TRIANGLES, {"colours": colours(3, alpha=0.0)}, "an alpha of 0"),
    "position": Case(kinds.CUBE, {"position": np.array((0, math.nan, 0))}, "in its position"),
    "rotation of nan": Case(
        kinds.CUBE, {"rotation_xyzw": np.array((0, 0, math.nan, 1))}, "in its rotation"
    ),
    "endless scale": Case(kinds.CUBE, {"scale": np.array((1, math.inf, 1))}, "in its scale"),
    "colour of nan": Case(kinds.CUBE, {"colour": np.array((math.nan, 0, 0, 1))}, "in its colour"),
    "endless point": Case(kinds.TRIANGLES, {"points": np.full((3, 3), math.inf)}, "in its points"),
    "point colour of nan": Case(
        kinds.TRIANGLES, {"colours": colours(3, red=math.nan)}, "in its colours"
    ),
    "no rotation": Case(kinds.CUBE, {"rotation_xyzw": np.zeros(4)}, "no unit quaternion"),
    "long rotation": Case(
        kinds.ARROW, {"rotation_xyzw": np.array((0, 0, 0, 1.001))}, "no unit quaternion"
    ),
    "flat": Case(kinds.CUBE, {"scale": np.array((1.0, 1.0, 0.0))}, "has the scale [1.0, 1.0, 0.0]"),
    "low text": Case(kinds.TEXT, {"scale": np.array((1.0, 1.0, 0.0))}, "has the scale"),
    "thin arrow": Case(kinds.ARROW, {"scale": np.array((1.0, 0.0, 1.0))}, "has the scale"),
    "low arrow": Case(kinds.ARROW, {"scale": np.array((1.0, 1.0, 0.0))}, "has the scale"),
    "scaled to nothing": Case(kinds.TRIANGLES, {"scale": np.zeros(3)}, "has the scale"),
    "too red": Case(kinds.CUBE, {"colour": np.array((1.5, 0, 0, 1))}, "has the colour"),
    "less than black": Case(kinds.CUBE, {"colour": np.array((0, -0.1, 0, 1))}, "has the colour"),
    "invisible": Case(kinds.CUBE, {"colour": np.array((1, 1, 1, 0.0))}, "has the colour"),
    "hidden by its own alpha": Case(
        kinds.TRIANGLES,
        {"colour": np.array((1, 1, 1, 0.0)), "colours": colours(3)},
        "has the colour",
    ),
    "negative lifetime": Case(kinds.CUBE, {"lifetime_ns": -1}, "a negative lifetime"),
    "too short a life": Case(kinds.CUBE, {"lifetime_ns": 100_000}, "which rviz takes as endless"),
    "half an arrow": Case(kinds.ARROW, {"points": np.ones((1, 3))}, "has 1 point"),
    "three points of an arrow": Case(kinds.ARROW, {"points": np.ones((3, 3))}, "has 3 points"),
    "a cube of points": Case(kinds.CUBE, {"points": np.ones((2, 3))}, "has 2 points"),
    "a text of points": Case(kinds.TEXT, {"points": np.ones((2, 3))}, "has 2 points"),
    "no triangle": Case(kinds.TRIANGLES, {"points": NO_POINTS}, "has 0 points"),
    "a triangle and a half": Case(kinds.TRIANGLES, {"points": np.ones((4, 3))}, "has 4 points"),
    "two colours": Case(kinds.TRIANGLES, {"colours": colours(2)}, "has 2 colours for 3 points"),
    "a cube's colours": Case(kinds.CUBE, {"colours": colours(1)}, "has 1 colour"),
    "texture": Case(kinds.TRIANGLES, {"texture_points": 2}, "has 2 coordinates of a texture"),
    "a cube's texture": Case(kinds.CUBE, {"texture_points": 1}, "has 1 coordinate"),
    "no text": Case(kinds.TEXT, {"text": ""}, "has no text"),
    "blank text": Case(kinds.TEXT, {"text": " \t\n"}, "has no text"),
    "a cube's text": Case(kinds.CUBE, {"text": "crate"}, "has the text 'crate'"),
    "a cube's mesh": Case(kinds.CUBE, {"mesh": "package://a"}, "names a mesh"),
    "a cube's materials": Case(kinds.CUBE, {"keeps_materials": True}, "names a mesh"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_each_rule_is_broken_by_some_marker(name: str) -> None:
    """The fault is named; the marker as it should be has none."""
    case = BROKEN[name]
    assert case.text in change_of(marker(case.kind, **case.fields)).fault
    if case.kind in {kinds.ARROW, kinds.CUBE, kinds.TEXT, kinds.TRIANGLES}:
        assert change_of(marker(case.kind)).fault == ""


RIGHT = {
    "unused scales of a text": (kinds.TEXT, {"scale": np.array((0.0, 0.0, 0.3))}),
    "arrow between points": (
        kinds.ARROW,
        {"points": np.ones((2, 3)), "scale": np.array((0.1, 0.2, 0.0))},
    ),
    "a colour for each corner": (kinds.TRIANGLES, {"colours": colours(3, alpha=0.4)}),
    "a colour for each face": (kinds.TRIANGLES, {"colours": colours(1)}),
    "endless": (kinds.CUBE, {"lifetime_ns": 0}),
    "nearly unit": (kinds.CUBE, {"rotation_xyzw": np.array((0, 0, 0, 1.0001))}),
    "what a DELETE leaves out": (
        kinds.CUBE,
        {"action": DELETE, "scale": np.zeros(3), "rotation_xyzw": np.zeros(4)},
    ),
    "what a DELETEALL leaves out": (kinds.CUBE, {"action": DELETE_ALL, "colour": np.zeros(4)}),
}


@pytest.mark.parametrize("name", RIGHT)
def test_what_rviz_takes_breaks_no_rule(name: str) -> None:
    """What a kind does not use may be anything; a DELETE needs no looks."""
    kind, fields = RIGHT[name]
    assert change_of(marker(kind, **fields)).fault == ""


def test_a_delete_with_nan_is_no_delete() -> None:
    """Rviz looks at the numbers of every marker before it looks at its action."""
    assert change_of(marker(action=DELETE, position=np.full(3, math.nan))).fault


def test_markers_are_decoded_as_a_serialiser_wrote_them() -> None:
    """Every field comes back from the bytes that rosbags makes of the message."""
    make = RosbagsFactory().make
    point = make("geometry_msgs/msg/Point", x=1.0, y=2.0, z=3.0)
    red = make("std_msgs/msg/ColorRGBA", r=1.0, a=0.5)
    uv = make("visualization_msgs/msg/UVCoordinate", u=0.5, v=0.25)
    full = make(
        "visualization_msgs/msg/Marker",
        header=make(
            "std_msgs/msg/Header",
            stamp=make("builtin_interfaces/msg/Time", sec=3, nanosec=4),
            frame_id="odom",
        ),
        ns="a",
        id=-5,
        type=11,
        pose=make("geometry_msgs/msg/Pose", position=point),
        scale=make("geometry_msgs/msg/Vector3", x=4.0, y=5.0, z=6.0),
        color=red,
        lifetime=make("builtin_interfaces/msg/Duration", sec=-1, nanosec=5),
        frame_locked=True,
        points=[point, point, point],
        colors=[red],
        texture_resource="embedded://x",
        texture=make(
            "sensor_msgs/msg/CompressedImage", format="png", data=np.arange(5, dtype=np.uint8)
        ),
        uv_coordinates=[uv, uv],
        text="label",
        mesh_resource="package://m",
        mesh_file=make(
            "visualization_msgs/msg/MeshFile", filename="f", data=np.arange(3, dtype=np.uint8)
        ),
        mesh_use_embedded_materials=True,
    )
    plain = make("visualization_msgs/msg/Marker", id=6)
    array = make("visualization_msgs/msg/MarkerArray", markers=[full, plain, full])
    data = jazzy_typestore().serialize_cdr(array, "visualization_msgs/msg/MarkerArray")
    first, second, third = kinds.decode_markers(bytes(data))
    assert first[:6] == (3 * SECOND + 4, "odom", "a", -5, 11, 0)
    np.testing.assert_array_equal(first.position, (1.0, 2.0, 3.0))
    np.testing.assert_array_equal(first.rotation_xyzw, (0.0, 0.0, 0.0, 1.0))
    np.testing.assert_array_equal(first.scale, (4.0, 5.0, 6.0))
    np.testing.assert_array_equal(first.colour, (1.0, 0.0, 0.0, 0.5))
    assert first.lifetime_ns == -SECOND + 5
    assert first.is_frame_locked
    assert first.points.tolist() == [[1.0, 2.0, 3.0]] * 3
    assert first.colours.tolist() == [[1.0, 0.0, 0.0, 0.5]]
    assert first[14:] == (2, "label", "package://m", True)
    assert second.number == 6
    assert not second.keeps_materials
    assert third.text == "label"
