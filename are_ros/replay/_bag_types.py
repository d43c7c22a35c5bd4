"""The message types that a recording itself describes, learnt when they are first needed."""

from typing import Any

from rosbags.interfaces import MessageDefinitionFormat
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from are_ros.errors import BagError
from are_ros.replay._bag_errors import sentence_of
from are_ros.replay.message_types import jazzy_typestore

_IDL_SEPARATOR = "=" * 80 + "\n"


class BagTypes:
    """Typestores by connection: one odd type in a recording does not spoil the others."""

    def __init__(self, *, is_ros1: bool) -> None:
        self._is_ros1 = is_ros1
        self._stores: dict[tuple[str, str], Any] = {}

    def store_of(self, connection: Any) -> Any:
        """Return the typestore that knows the connection's type.

        Types without a definition are taken from ROS 2 Jazzy or ROS 1 Noetic. BagError if the type
        is not known there, cannot be understood, or the messages are not CDR.
        """
        key = (connection.msgtype, connection.msgdef.data)
        if key not in self._stores:
            self._stores[key] = self._make_store(connection)
        return self._stores[key]

    def _make_store(self, connection: Any) -> Any:
        encoding = getattr(connection.ext, "serialization_format", "cdr")
        if encoding != "cdr":
            message = f"{connection.topic}: its messages are encoded as {encoding}, not as CDR"
            raise BagError(message)
        if connection.msgdef.format == MessageDefinitionFormat.NONE or not connection.msgdef.data:
            return self._default_store(connection)
        store = get_typestore(Stores.EMPTY)
        try:
            store.register(_types_of(connection))
            store.get_msgdef(connection.msgtype)
        except Exception as cause:
            message = (
                f"{connection.topic}: the recording's definition of {connection.msgtype}"
                f" cannot be understood: {sentence_of(cause)}"
            )
            raise BagError(message) from cause
        return store

    def _default_store(self, connection: Any) -> Any:
        store = get_typestore(Stores.ROS1_NOETIC) if self._is_ros1 else jazzy_typestore()
        if connection.msgtype not in store.fielddefs:
            message = (
                f"{connection.topic}: the recording does not define its type,"
                f" {connection.msgtype}, and it is none of ROS's own"
            )
            raise BagError(message)
        return store


def _types_of(connection: Any) -> dict[str, Any]:
    definition = connection.msgdef
    if definition.format == MessageDefinitionFormat.MSG:
        return dict(get_types_from_msg(definition.data, connection.msgtype))
    if not definition.data.startswith(f"{_IDL_SEPARATOR}IDL: "):
        return dict(get_types_from_idl(definition.data))
    types: dict[str, Any] = {}
    for part in definition.data.split(_IDL_SEPARATOR)[1:]:
        types |= get_types_from_idl(part.split("\n", 1)[1])
    return types
