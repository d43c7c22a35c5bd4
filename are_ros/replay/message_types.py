"""Message types and objects without a middleware: rosbags' typestore of ROS 2 Jazzy, and ours."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from are_ros.messages.definitions import message_texts

_DEFAULTS: dict[str, Any] = {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}
_BASE, _NAME, _ARRAY = 1, 2, 3
"""The node types of rosbags' field descriptions; the fourth is a sequence."""


@cache
def jazzy_typestore() -> Any:
    """Return the types of ROS 2 Jazzy with are_msgs, tf2_msgs and map_msgs, built once.

    It is shared: whoever learns further types takes a `new_typestore()`. InputError if the message
    definitions of ARE are not installed.
    """
    return new_typestore()


def new_typestore() -> Any:
    """Return a typestore of one's own with the same types; InputError as in `jazzy_typestore`."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for name, text in message_texts().items():
        types |= get_types_from_msg(text, name)
    store.register(types)
    return store


class RosbagsFactory:
    """A `MessageFactory` of rosbags objects; a field left out is zero, empty or unturned."""

    def __init__(self, typestore: Any = None) -> None:
        self._store = jazzy_typestore() if typestore is None else typestore
        self._makers: dict[str, dict[str, Callable[[], Any]]] = {}

    def make(self, type_name: str, /, **fields: Any) -> Any:
        """Return a new message object; KeyError for a type, TypeError for a field of no such name.

        Arrays are kept, not copied: change none before it is serialised.
        """
        makers = self._makers.get(type_name)
        if makers is None:
            makers = self._makers[type_name] = self._makers_of(type_name)
        if len(fields) < len(makers):
            fields = {name: make() for name, make in makers.items() if name not in fields} | fields
        return self._store.types[type_name](**fields)

    def _makers_of(self, type_name: str) -> dict[str, Callable[[], Any]]:
        """Return what makes the default of each field."""
        fields = self._store.fielddefs[type_name][1]
        makers = {name: self._maker_of(description) for name, description in fields}
        if type_name == "geometry_msgs/msg/Quaternion":
            makers["w"] = partial(float, 1.0)
        return makers

    def _maker_of(self, description: tuple[int, Any]) -> Callable[[], Any]:
        kind, detail = int(description[0]), description[1]
        if kind == _BASE:
            return partial(_itself, _DEFAULTS.get(detail[0], 0))
        if kind == _NAME:
            return partial(self.make, detail)
        (element_kind, element), count = detail
        count = count if kind == _ARRAY else 0
        if int(element_kind) == _BASE and element[0] != "string":
            return partial(np.zeros, count, _dtype(element[0]))
        element_maker = self._maker_of((int(element_kind), element))
        return lambda: [element_maker() for _ in range(count)]


def _dtype(base: str) -> np.dtype[Any]:
    return np.dtype({"octet": "uint8", "byte": "uint8", "char": "uint8"}.get(base, base))


def _itself(value: Any) -> Any:
    return value
