"""Fixtures of the replay tests: small recordings of every kind."""

from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from io import StringIO
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from are_ros.bag.reader import BagReader
from are_ros.bag.types import jazzy_typestore
from are_ros.cli import main
from are_ros.conventions import NS_PER_S
from bags.simulation.making import RosbagsFactory

Records = Sequence[tuple[str, int, Any]]
WriteBag = Callable[[Path, Records], Path]
RunAre = Callable[..., CompletedProcess[str]]
ReplaySample = Callable[..., Path]

MANY = ("--set", "population.arrival_rate:=0.012", "--set", "population.mean_life:=4")


@pytest.fixture(scope="session")
def factory() -> RosbagsFactory:
    """Return a factory of rosbags message objects."""
    return RosbagsFactory()


@pytest.fixture(scope="session")
def ros1_factory() -> RosbagsFactory:
    """Return a factory of messages as ROS 1 has them."""
    return RosbagsFactory(_ros1_store())


@pytest.fixture(scope="session")
def as_ros1(ros1_factory: RosbagsFactory) -> Callable[[Any], Any]:
    """Return what makes of a ROS 2 message the ROS 1 message of its name, field by field."""
    types = _ros1_store().fielddefs

    def element(value: Any) -> Any:
        return convert(value) if hasattr(value, "__msgtype__") else value

    def convert(message: Any) -> Any:
        fields = {}
        for name, _ in types[message.__msgtype__][1]:
            source = name if hasattr(message, name) else name.lower()
            value = getattr(message, source, None)
            if value is not None:
                parts = isinstance(value, list)
                fields[name] = [element(one) for one in value] if parts else element(value)
        return ros1_factory.make(message.__msgtype__, **fields)

    return convert


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


@cache
def _ros1_store() -> Any:
    """Return the types of ROS 1, with the one of tf2_msgs that rosbags leaves out."""
    store = get_typestore(Stores.ROS1_NOETIC)
    text = "geometry_msgs/TransformStamped[] transforms\n"
    store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
    return store


def _write_ros1(path: Path, records: Records) -> Path:
    store = _ros1_store()
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


@pytest.fixture(scope="session")
def run_are() -> RunAre:
    """Return a runner of `are` in this process: what it printed, and its exit status.

    A traceback would come out of it as the exception itself.
    """

    def run(*words: object) -> CompletedProcess[str]:
        arguments = ["are", *map(str, words)]
        out, err = StringIO(), StringIO()
        status: Any = None
        with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
            patch.setattr("sys.argv", arguments)
            with pytest.raises(SystemExit) as ended:
                main()
            status = ended.value.code
        return CompletedProcess(arguments, int(status or 0), out.getvalue(), err.getvalue())

    return run


@pytest.fixture(scope="session")
def sample_bag() -> Path:
    """Return the recording of a robot in a made-up office that the repository ships."""
    return Path(__file__).resolve().parents[2] / "bags" / "sample_office.mcap"


@pytest.fixture(scope="session")
def replay_sample(
    run_are: RunAre, sample_bag: Path, tmp_path_factory: pytest.TempPathFactory
) -> ReplaySample:
    """Return a replayer of 8 seconds of the sample among many artefacts, into a new folder.

    Words are options after those; the folder is returned.
    """

    def replay(*words: object) -> Path:
        out = tmp_path_factory.mktemp("replay")
        window = ("--start", 20, "--duration", 8)
        seed = () if "--seed" in words else ("--seed", 3)
        done = run_are("replay", sample_bag, *window, *MANY, *seed, *words, "--out", out)
        assert done.returncode == 0, done.stderr
        return out

    return replay


@pytest.fixture(scope="session")
def sample_replay(replay_sample: ReplaySample) -> Path:
    """Return the results of the sample's eight seconds with its inputs."""
    return replay_sample("--with-inputs")


@pytest.fixture(scope="session")
def sample_records(sample_bag: Path) -> Records:
    """Return the first five seconds of the sample, as (topic, log time, message object).

    Without its images, which have tests of their own.
    """
    with BagReader([sample_bag]) as reader:
        messages = reader.messages(stop_ns=reader.start_ns + 5 * NS_PER_S)
        return [
            (m.topic, m.log_time_ns, reader.deserialize(m))
            for m in messages
            if "compressed" not in m.topic
        ]
