"""Message types beyond ROS 2 Jazzy's own: read from the .msg texts of the installed packages."""

import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rosbags.typesys import get_types_from_msg

from are_ros.errors import InputError
from are_ros.replay.message_types import new_typestore

_MESSAGE_FIELD = 2
"""The node type of a nested message in rosbags' field descriptions; arrays are 3 and 4."""


class InstalledTypes:
    """A typestore that learns from share/<package>/msg what it does not know yet.

    `prefixes` are the installations looked through, the first that has a text counts; None means
    those of AMENT_PREFIX_PATH, then Python's own environment.
    """

    def __init__(self, prefixes: Sequence[Path] | None = None) -> None:
        self.store = new_typestore()
        self._prefixes = _ament_prefixes() if prefixes is None else tuple(prefixes)

    def learn(self, type_name: str) -> None:
        """Make the store know a type and all that it is made of; "my_msgs/msg/Thing".

        InputError, naming the definition that is missing or malformed; the store is unchanged.
        """
        learnt: dict[str, Any] = {}
        wanted = [type_name]
        while wanted:
            name = wanted.pop()
            if name not in self.store.fielddefs and name not in learnt:
                learnt |= self._parse(name)
                wanted += _nested(learnt[name])
        if learnt:
            self.store.register(learnt)

    def _parse(self, type_name: str) -> dict[str, Any]:
        text = self._text_of(type_name)
        try:
            return dict(get_types_from_msg(text, type_name))
        except Exception as cause:  # its grammar raises errors of several families
            message = f"the installed definition of {type_name} cannot be understood"
            raise InputError(message) from cause

    def _text_of(self, type_name: str) -> str:
        package, _, name = type_name.partition("/msg/")
        for prefix in self._prefixes if name else ():
            file = prefix / "share" / package / "msg" / f"{name}.msg"
            if file.is_file():
                return file.read_text("utf-8")
        raise InputError(f"no definition of {type_name} is installed")


def _ament_prefixes() -> tuple[Path, ...]:
    listed = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return tuple(Path(prefix) for prefix in (*filter(None, listed), sys.prefix))


def _nested(definition: tuple[Any, Any]) -> Iterator[str]:
    """Yield the names of the messages that a message has as fields or in arrays."""
    for _, (kind, detail) in definition[1]:
        element = (kind, detail) if int(kind) <= _MESSAGE_FIELD else detail[0]
        if int(element[0]) == _MESSAGE_FIELD:
            yield element[1]
