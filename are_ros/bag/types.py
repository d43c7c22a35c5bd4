"""Message types and objects without a middleware: rosbags' typestore, and our definitions."""

import os
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from are_ros.errors import InputError

# The texts of ARE's message definitions, from msg_defs/.


_PACKAGES = ("are_msgs", "compat/map_msgs", "compat/tf2_msgs", "compat/vision_msgs")


def message_texts(folder: Path | None = None) -> dict[str, str]:
    """Return the .msg texts by full type name ("are_msgs/msg/Artefact"), in order of name.

    `folder` is `definitions_folder()` unless given. InputError if a package is not in it.
    """
    root = definitions_folder() if folder is None else folder
    texts: dict[str, str] = {}
    for package in _PACKAGES:
        files = sorted((root / package / "msg").glob("*.msg"))
        if not files:
            raise InputError(f"{root}: the message definitions of {package} are missing")
        texts |= {
            f"{Path(package).name}/msg/{file.stem}": file.read_text("utf-8") for file in files
        }
    return dict(sorted(texts.items()))


_OCTOMAP: Final = """
std_msgs/Header header
bool binary
string id
float64 resolution
int8[] data
"""
"""octomap_msgs/Octomap, for recordings that do not define it; it is only read."""
OCTOMAP_TYPE: Final = "octomap_msgs/msg/Octomap"


def definitions_folder(module: Path = Path(__file__)) -> Path:
    """Return the folder msg_defs: in a source checkout, else share/are_ros/msg_defs.

    An installation puts share/ beside lib/ at its prefix, so it is sought above this module.
    InputError if there is none.
    """
    above = module.resolve().parents
    candidates = [above[2] / "msg_defs", *(up / "share/are_ros/msg_defs" for up in above)]
    for candidate in candidates:
        if (candidate / _PACKAGES[0]).is_dir():
            return candidate
    raise InputError("the message definitions (share/are_ros/msg_defs) are not installed")


_RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
_NAME = 2
"""The node type of a message among rosbags' field descriptions; 1 is a number or a string."""


@cache
def jazzy_typestore() -> Any:
    """Return the types of ROS 2 Jazzy with are_msgs and the stand-ins, built once.

    It is shared: take a `new_typestore()` to register further types. InputError if the message
    definitions of ARE are not installed.
    """
    return new_typestore()


def new_typestore() -> Any:
    """Return a new typestore with the same types; InputError as in `jazzy_typestore`."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = dict(get_types_from_msg(_OCTOMAP, OCTOMAP_TYPE))
    for name, text in message_texts().items():
        types |= get_types_from_msg(text, name)
    store.register(types)
    return store


def ros2_type(type_name: str) -> str:
    """Return the type of ROS 2 that a type of ROS 1 has become; others are their own."""
    return _RENAMED.get(type_name, type_name)


# Message types beyond ROS 2 Jazzy's own: read from the .msg texts of the installed packages.


class InstalledTypes:
    """A typestore that reads unknown types from share/<package>/msg.

    `prefixes` are the installations in order of preference; None means those of AMENT_PREFIX_PATH,
    then Python's environment.
    """

    def __init__(self, prefixes: Sequence[Path] | None = None) -> None:
        self.store = new_typestore()
        self._prefixes = _ament_prefixes() if prefixes is None else tuple(prefixes)

    def learn(self, type_name: str) -> None:
        """Register a type, as "my_msgs/msg/Thing", and the types of its fields.

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
        element = (kind, detail) if int(kind) <= _NAME else detail[0]
        if int(element[0]) == _NAME:
            yield element[1]
