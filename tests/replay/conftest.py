"""Fixtures of the replay tests: small recordings of every kind."""

from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from are_ros.cli import main
from are_ros.conventions import NS_PER_S
from are_ros.replay.bag_reader import BagReader
from are_ros.replay.message_types import RosbagsFactory, jazzy_typestore

Records = Sequence[tuple[str, int, Any]]
WriteBag = Callable[[Path, Records], Path]
RunAre = Callable[..., CompletedProcess[str]]
ReplaySample = Callable[..., Path]

MANY = ("--set", "population.arrival_rate:=0.006", "--set", "population.mean_life:=8")


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
    """Return a replayer of 12 seconds of the sample among many artefacts, into a new folder.

    Words are options after those; the folder is returned.
    """

    def replay(*words: object) -> Path:
        out = tmp_path_factory.mktemp("replay")
        window = ("--start", 20, "--duration", 12)
        done = run_are("replay", sample_bag, *window, *MANY, "--seed", 3, *words, "--out", out)
        assert done.returncode == 0, done.stderr
        return out

    return replay


@pytest.fixture(scope="session")
def sample_replay(replay_sample: ReplaySample) -> Path:
    """Return the results of the sample's twelve seconds with its inputs."""
    return replay_sample("--with-inputs")


@pytest.fixture(scope="session")
def sample_records(sample_bag: Path) -> Records:
    """Return the first five seconds of the sample, as (topic, log time, message object)."""
    with BagReader([sample_bag]) as reader:
        messages = reader.messages(stop_ns=reader.start_ns + 5 * NS_PER_S)
        return [(m.topic, m.log_time_ns, reader.deserialize(m)) for m in messages]
