"""Message types and objects without a middleware: rosbags' typestore, and our definitions."""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

import numpy as np
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


_DEFAULTS: dict[str, Any] = {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}
_RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
_BASE, _NAME, _ARRAY = 1, 2, 3
"""The node types of rosbags' field descriptions; the fourth is a sequence."""


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


class RosbagsFactory:
    """Makes message objects of rosbags; a field left out is zero, empty or unturned."""

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
            return lambda: _DEFAULTS.get(detail[0], 0)
        if kind == _NAME:
            return partial(self.make, detail)
        (element_kind, element), count = detail
        count = count if kind == _ARRAY else 0
        if int(element_kind) == _BASE and element[0] != "string":
            name = {"octet": "uint8", "byte": "uint8", "char": "uint8"}.get(element[0], element[0])
            return partial(np.zeros, count, np.dtype(name))
        element_maker = self._maker_of((int(element_kind), element))
        return lambda: [element_maker() for _ in range(count)]


def ros2_type(type_name: str) -> str:
    """Return the type of ROS 2 that a type of ROS 1 has become; others are their own."""
    return _RENAMED.get(type_name, type_name)


@cache
def _jazzy_factory() -> RosbagsFactory:
    return RosbagsFactory()


def as_ros2(original: Any, type_name: str) -> bytes:
    """Return a ROS 1 message object as the bytes of a ROS 2 type of Jazzy or of ours."""
    return bytes(jazzy_typestore().serialize_cdr(converted(original, type_name), type_name))


def converted(original: Any, type_name: str) -> Any:
    """Return a ROS 1 message object as the ROS 2 type of its name, field by field.

    Fields that ROS 2 lacks (Header.seq) are dropped, new fields have their defaults, and D, K, R, P
    of CameraInfo become lower case.
    """
    fields = {}
    for name, description in jazzy_typestore().fielddefs[type_name][1]:
        source = name if hasattr(original, name) else name.upper()
        if hasattr(original, source):
            fields[name] = _converted_field(getattr(original, source), description)
    return _jazzy_factory().make(type_name, **fields)


def _converted_field(value: Any, description: Any) -> Any:
    kind, detail = int(description[0]), description[1]
    if kind == _BASE:
        return value
    if kind == _NAME:
        return converted(value, detail)
    element = detail[0]
    if int(element[0]) == _NAME:
        return [converted(one, element[1]) for one in value]
    return value


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
