"""What came over DDS: bytes with their topic, and what they say."""

from struct import error as StructError  # noqa: N812
from typing import Any, NamedTuple

from rclpy.serialization import deserialize_message

from are_ros.errors import InputError
from are_ros.messages.odometry import OdometryNumbers, read_odometry_numbers
from are_ros.messages.transform_decoding import decode_transforms_cdr, is_plain_cdr
from are_ros.messages.transforms import StampedTransform, read_transforms
from are_ros.node.message_classes import message_class


class WireMessage(NamedTuple):
    """A message as DDS delivered it: the full name of its topic, its type, its CDR bytes."""

    topic: str
    type_name: str
    data: bytes


class WireDecoding:
    """Makes values of the bytes; InputError, naming the topic, where they are malformed."""

    def deserialize(self, message: WireMessage) -> Any:
        """Return the message object of rclpy."""
        try:
            return deserialize_message(message.data, message_class(message.type_name))
        except Exception as cause:  # rclpy raises RCLError, MemoryError, ...
            raise _malformed(message) from cause

    def transforms(self, message: WireMessage) -> list[StampedTransform]:
        """Return the transforms of a TFMessage; as `deserialize`, quicker."""
        if not is_plain_cdr(message.data):
            return read_transforms(self.deserialize(message))
        try:
            return decode_transforms_cdr(message.data)
        except (StructError, UnicodeDecodeError) as cause:
            raise _malformed(message) from cause

    def odometry(self, message: WireMessage) -> OdometryNumbers:
        """Return the numbers of an Odometry."""
        return read_odometry_numbers(self.deserialize(message))


def _malformed(message: WireMessage) -> InputError:
    size = len(message.data)
    return InputError(f"{message.topic}: {size} bytes that are no {message.type_name}")
