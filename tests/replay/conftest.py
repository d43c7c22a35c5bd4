"""Fixtures of the replay tests: small recordings of every kind."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from are_ros.replay.message_types import RosbagsFactory, jazzy_typestore

Records = Sequence[tuple[str, int, Any]]
WriteBag = Callable[[Path, Records], Path]


@pytest.fixture(scope="session")
def factory() -> RosbagsFactory:
    """Return a factory of rosbags message objects."""
    return RosbagsFactory()


@pytest.fixture(scope="session")
def ros1_factory() -> RosbagsFactory:
    """Return a factory of messages as ROS 1 has them."""
    return RosbagsFactory(get_typestore(Stores.ROS1_NOETIC))


@pytest.fixture(scope="session")
def write_bag() -> WriteBag:
    """Return a writer of (topic, log time, message) to .bag, .mcap or .db3, by the suffix.

    A recording of ROS 2 is a folder; the path of the file in it is returned.
    """

    def write(path: Path, records: Records) -> Path:
        if path.suffix == ".bag":
            return _write_ros1(path, records)
        plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
        _write_ros2(path.with_suffix(""), records, plugin)
        return path.with_suffix("") / path.name

    return write


def _write_ros1(path: Path, records: Records) -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    connections: dict[str, Any] = {}
    with Ros1Writer(path) as writer:
        for topic, log_time_ns, message in records:
            name = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            data = store.serialize_ros1(message, name)
            writer.write(connections[topic], log_time_ns, data)
    return path


def _write_ros2(folder: Path, records: Records, plugin: StoragePlugin) -> None:
    store = jazzy_typestore()
    connections: dict[str, Any] = {}
    with Ros2Writer(folder, version=9, storage_plugin=plugin) as writer:
        for topic, log_time_ns, message in records:
            name = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            writer.write(connections[topic], log_time_ns, store.serialize_cdr(message, name))
