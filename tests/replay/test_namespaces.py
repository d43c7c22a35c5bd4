"""Recordings of a node in a namespace: all commands take them as those of a node without one."""

from collections.abc import Callable
from pathlib import Path
from shutil import copyfile
from subprocess import CompletedProcess

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from are_ros.bag.recording import home_of
from are_ros.errors import BagError

RunAre = Callable[..., CompletedProcess[str]]

SHARED = ("/tf", "/tf_static")


def renamed(source: Path, target: Path, name_of: Callable[[str], str]) -> None:
    """Copy a recording with other names of topics."""
    with source.open("rb") as read, target.open("wb") as written:
        reader, writer = make_reader(read), Writer(written)
        summary = reader.get_summary()
        assert summary is not None
        writer.start(profile="ros2", library="tests")
        schemas = {
            number: writer.register_schema(one.name, one.encoding, one.data)
            for number, one in summary.schemas.items()
        }
        channels = {
            number: writer.register_channel(
                name_of(one.topic), one.message_encoding, schemas[one.schema_id], one.metadata
            )
            for number, one in summary.channels.items()
        }
        for _, channel, message in reader.iter_messages(log_time_order=False):
            times_ns = message.log_time, message.publish_time
            number = channels[channel.id]
            writer.add_message(number, times_ns[0], message.data, times_ns[1], message.sequence)
        writer.finish()


@pytest.fixture(scope="module")
def judged(
    sample_replay: Path, run_are: RunAre, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[Callable[[str], str]], tuple[str, bytes]]:
    """Return what `are check` says and what `are export` writes, topics named anew."""

    def judge(name_of: Callable[[str], str]) -> tuple[str, bytes]:
        folder = tmp_path_factory.mktemp("renamed")
        renamed(sample_replay / "augmented.mcap", folder / "live.mcap", name_of)
        copyfile(sample_replay / "effective.yaml", folder / "effective.yaml")
        checked = run_are("check", folder)
        assert checked.returncode == 0, checked.stdout
        exported = run_are("export", folder, "--tracks", folder / "tracks")
        assert exported.returncode == 0, exported.stderr
        return checked.stdout, (folder / "tracks" / "tracks.csv").read_bytes()

    return judge


def test_a_namespace_changes_neither_checks_nor_tracks(
    judged: Callable[[Callable[[str], str]], tuple[str, bytes]],
) -> None:
    """With the transforms in the namespace, and with those that robots share."""
    plain = judged(lambda topic: topic)
    assert "ticks: passed" in plain[0]
    assert judged(lambda topic: f"/fleet/robot1{topic}") == plain
    assert judged(lambda topic: topic if topic in SHARED else f"/robot1{topic}") == plain


def test_of_several_nodes_one_is_to_be_recorded(
    sample_replay: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """A recording of two robots names them; beside a node without a namespace others are inputs."""
    numbers: dict[str, int] = {}

    def robot_of(topic: str) -> str:
        return f"/robot{numbers.setdefault(topic, len(numbers)) % 2}{topic}"

    both = tmp_path / "both.mcap"
    renamed(sample_replay / "augmented.mcap", both, robot_of)
    done = run_are("view", both)
    nodes = "it holds topics of several nodes, /robot0/ar_builder and /robot1/ar_builder"
    assert done.returncode == 1
    assert f"{both}: {nodes}: record one alone" in done.stderr
    assert home_of(["/ar_builder/a", "/robot1/ar_builder/a"], "it") == ""
    with pytest.raises(BagError):
        home_of(["/robot2/ar_builder/a", "/robot1/ar_builder/a"], "it")
