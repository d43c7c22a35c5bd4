"""The messages as they were built: their fields and constants, and the way through the middleware.

With its neighbours in this folder it is what `colcon test` runs on a robot: nothing here needs more
than package.xml names.
"""

import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

MSG_DEFS = Path(__file__).resolve().parents[2] / "msg_defs"
FILES = sorted([*MSG_DEFS.rglob("*.msg"), *MSG_DEFS.rglob("*.srv")])

pytestmark = pytest.mark.usefixtures("ros_available")


def parts_of(path: Path) -> Iterator[tuple[Any, str]]:
    """Yield the classes that a definition became, each with its part of the text."""
    package, folder = path.parent.parent.name, path.parent.name
    made = getattr(importlib.import_module(f"{package}.{folder}"), path.stem)
    kinds = (made.Request, made.Response) if folder == "srv" else (made,)
    return zip(kinds, path.read_text(encoding="utf-8").split("\n---\n"), strict=True)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_fields_and_constants_are_those_of_the_definition(path: Path) -> None:
    """In their order: the bytes on the wire depend on it. A number after a name is its default."""
    for kind, text in parts_of(path):
        bare = re.sub(r"#.*", "", text)
        found = re.findall(r"^[\w/]+(?:\[\])?\s+(\w+)(?:\s+(-?\d+))?\s*$", bare, re.MULTILINE)
        fields = [name for name, _ in found]
        assert all(getattr(kind(), name) == int(default) for name, default in found if default)
        constants = re.findall(r"^\w+\s+(\w+)=(\d+)\s*$", bare, re.MULTILINE)
        made = [*kind.get_fields_and_field_types()]
        assert made == fields or (made, fields) == (["structure_needs_at_least_one_member"], [])
        assert all(getattr(kind, name) == int(value) for name, value in constants)


def test_a_message_comes_back_from_the_middleware_as_it_was() -> None:
    """Nested messages, arrays and numbers of every size."""
    from are_msgs.msg import PerceivedArtefact, PerceivedArtefactArray
    from rclpy.serialization import deserialize_message, serialize_message

    artefact = PerceivedArtefact(
        id=2**63 + 1, label="forklift", classes=["vehicle", "person"], probabilities=[0.75, 0.25]
    )
    artefact.pose.covariance[35] = 0.5
    artefact.roi.width = 64
    sent = PerceivedArtefactArray(observer="robot", artefacts=[artefact, PerceivedArtefact(id=3)])
    sent.header.stamp.sec, sent.header.frame_id = 12, "map"
    received = deserialize_message(serialize_message(sent), PerceivedArtefactArray)
    assert received == sent
    assert received.artefacts[0].id == 2**63 + 1
    assert list(received.artefacts[0].probabilities) == [0.75, 0.25]
