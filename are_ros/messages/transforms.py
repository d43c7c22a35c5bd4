"""tf2_msgs/TFMessage <-> stamped transforms between named frames."""

from collections.abc import Iterable
from typing import Any, NamedTuple

from are_ros.messages.factory import MessageFactory
from are_ros.messages.geometry import make_quaternion, make_vector
from are_ros.messages.headers import make_header
from are_ros.messages.times import read_time


class StampedTransform(NamedTuple):
    """One edge of the frame tree at one stamp: `parent_from_child`, with names as they came.

    Metres and a quaternion; nothing is checked here, the frame tree does that.
    """

    parent: str
    child: str
    stamp_ns: int
    translation_m: tuple[float, float, float]
    rotation_xyzw: tuple[float, float, float, float]


def read_transforms(message: Any) -> list[StampedTransform]:
    """Return the transforms of a TFMessage in their order."""
    return [_read_transform(stamped) for stamped in message.transforms]


def make_transforms(factory: MessageFactory, transforms: Iterable[StampedTransform]) -> Any:
    """Return a TFMessage."""
    return factory.make(
        "tf2_msgs/msg/TFMessage",
        transforms=[_make_transform(factory, transform) for transform in transforms],
    )


def _read_transform(stamped: Any) -> StampedTransform:
    header, transform = stamped.header, stamped.transform
    shift, turn = transform.translation, transform.rotation
    return StampedTransform(
        header.frame_id,
        stamped.child_frame_id,
        read_time(header.stamp),
        (shift.x, shift.y, shift.z),
        (turn.x, turn.y, turn.z, turn.w),
    )


def _make_transform(factory: MessageFactory, transform: StampedTransform) -> Any:
    return factory.make(
        "geometry_msgs/msg/TransformStamped",
        header=make_header(factory, transform.parent, transform.stamp_ns),
        child_frame_id=transform.child,
        transform=factory.make(
            "geometry_msgs/msg/Transform",
            translation=make_vector(factory, transform.translation_m),
            rotation=make_quaternion(factory, transform.rotation_xyzw),
        ),
    )
