"""Markers for rviz as a visualization_msgs/MarkerArray."""

from collections.abc import Iterable
from typing import Any

from are_ros.builder.markers import Marker
from are_ros.messages.factory import MessageFactory
from are_ros.messages.geometry import Values, make_point, make_vector
from are_ros.messages.headers import make_header
from are_ros.messages.poses import make_pose
from are_ros.messages.times import make_duration


def make_markers(
    factory: MessageFactory, frame_id: str, stamp_ns: int, markers: Iterable[Marker]
) -> Any:
    """Return a MarkerArray in the map's frame; an empty one is an empty list of markers."""
    header = make_header(factory, frame_id, stamp_ns)
    return factory.make(
        "visualization_msgs/msg/MarkerArray",
        markers=[_make_marker(factory, header, marker) for marker in markers],
    )


def _make_marker(factory: MessageFactory, header: Any, marker: Marker) -> Any:
    return factory.make(
        "visualization_msgs/msg/Marker",
        header=header,
        ns=marker.namespace,
        id=marker.marker_id,
        type=int(marker.kind),
        action=int(marker.action),
        pose=make_pose(factory, marker.map_from_marker),
        scale=make_vector(factory, marker.scale),
        color=_make_colour(factory, marker.colour),
        lifetime=make_duration(factory, marker.lifetime_ns),
        points=[make_point(factory, point) for point in marker.points.tolist()],
        colors=[_make_colour(factory, colour) for colour in marker.colours.tolist()],
        text=marker.text,
    )


def _make_colour(factory: MessageFactory, rgba: Values) -> Any:
    red, green, blue, alpha = rgba
    return factory.make(
        "std_msgs/msg/ColorRGBA", r=float(red), g=float(green), b=float(blue), a=float(alpha)
    )
