"""Writing the augmented recording."""

import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.interfaces import QosDurability, QosHistory, QosReliability
from rosbags.rosbag2 import Reader as Ros2Reader

from are_ros.bag.reader import BagReader, BagTopic
from are_ros.bag.writer import BagWriter
from are_ros.builder.markers import DELETE_ALL
from are_ros.errors import BagError
from are_ros.messages.maps import read_grid
from are_ros.messages.markers import MarkerEncoder
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.making import RosbagsFactory, make_grid

GRID, ARRAY = "nav_msgs/msg/OccupancyGrid", "are_msgs/msg/ArtefactArray"
MARKERS = "visualization_msgs/msg/MarkerArray"


def grid(value: int) -> OccupancyGrid:
    """Return a grid of one value."""
    cells = np.full((300, 400), value, np.int8)
    return OccupancyGrid(cells, 0.05, RigidTransform.identity(), "map", value)


def write_sample(path: Path, factory: RosbagsFactory) -> None:
    """Write three topics, one of them without a message."""
    with BagWriter(path) as writer:
        writer.add_topic("/are/map", GRID, is_latched=True, depth=1)
        writer.add_topic("/are/artefacts", ARRAY)
        writer.add_topic("/are/scan", "sensor_msgs/msg/LaserScan", is_reliable=False)
        writer.add_topic("/are/markers", MARKERS)
        for k in range(40):
            writer.write("/are/map", 100 * k, make_grid(factory, grid(k)))
            artefacts = [factory.make("are_msgs/msg/Artefact", id=k, label="person")]
            writer.write("/are/artefacts", 100 * k, factory.make(ARRAY, artefacts=artefacts))
            writer.write_raw("/are/markers", 100 * k, MarkerEncoder().encode("map", k, DELETE_ALL))
        assert writer.counts()["/are/map"] == 40


def test_our_own_reader_reads_it(tmp_path: Path, factory: RosbagsFactory) -> None:
    """A bare file is read, with topics, qualities of service and all messages."""
    write_sample(tmp_path / "out.mcap", factory)
    with BagReader([tmp_path / "out.mcap"]) as reader:
        assert reader.topics == (
            BagTopic("/are/artefacts", ARRAY, 40, False),
            BagTopic("/are/map", GRID, 40, True),
            BagTopic("/are/markers", MARKERS, 40, False),
            BagTopic("/are/scan", "sensor_msgs/msg/LaserScan", 0, False, False),
        )
        assert (reader.start_ns, reader.end_ns) == (0, 3901)
        messages = list(reader.messages())
        objects = [reader.deserialize(message) for message in messages]
    topics = [message.topic for message in messages[:3]]
    assert topics == ["/are/map", "/are/artefacts", "/are/markers"]
    np.testing.assert_array_equal(read_grid(objects[3 * 7]).cells, grid(7).cells)
    assert objects[3 * 7 + 1].artefacts[0].id == 7
    assert objects[3 * 7 + 2].markers[0].action == 3


def test_mcap_reads_it(tmp_path: Path, factory: RosbagsFactory) -> None:
    """Profile, schemas, channels in order of announcement and counts are as ROS 2 has them."""
    write_sample(tmp_path / "out.mcap", factory)
    with (tmp_path / "out.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert [channel.topic for channel in summary.channels.values()] == [
            "/are/map", "/are/artefacts", "/are/scan", "/are/markers",
        ]  # fmt: skip
        assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        assert summary.schemas[1].name == GRID
        hashes = [channel.metadata["topic_type_hash"] for channel in summary.channels.values()]
        assert all(text.startswith("RIHS01_") and len(text) == 71 for text in hashes)
        assert sum(1 for _ in reader.iter_messages()) == 120


def test_players_get_the_quality_of_service(tmp_path: Path, factory: RosbagsFactory) -> None:
    """The map is latched with depth 1, the scan best effort, as rosbag2 writes it."""
    write_sample(tmp_path / "out.mcap", factory)
    with Ros2Reader(tmp_path / "out.mcap") as reader:
        profiles = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
    latched, best_effort = profiles["/are/map"], profiles["/are/scan"]
    assert (latched.history, latched.depth) == (QosHistory.KEEP_LAST, 1)
    assert latched.durability == QosDurability.TRANSIENT_LOCAL
    assert latched.reliability == QosReliability.RELIABLE
    assert latched.deadline == (9223372036, 854775807)
    assert best_effort.reliability == QosReliability.BEST_EFFORT
    assert best_effort.durability == QosDurability.VOLATILE


def test_the_same_calls_give_the_same_bytes(tmp_path: Path, factory: RosbagsFactory) -> None:
    """Neither clock nor path enter the file."""
    (tmp_path / "elsewhere").mkdir()
    write_sample(tmp_path / "a.mcap", factory)
    write_sample(tmp_path / "elsewhere/b.mcap", RosbagsFactory())
    one, other = (tmp_path / "a.mcap").read_bytes(), (tmp_path / "elsewhere/b.mcap").read_bytes()
    assert one == other
    assert str(tmp_path).encode() not in one


def test_a_failed_run_leaves_no_file(tmp_path: Path, factory: RosbagsFactory) -> None:
    """What an exception interrupts leaves the folder, and an older result, as they were."""
    path = tmp_path / "out.mcap"
    path.write_bytes(b"older")
    with pytest.raises(KeyError, match="never added"), BagWriter(path) as writer:  # noqa: PT012
        writer.add_topic("/are/map", GRID)
        writer.write("/are/map", 0, make_grid(factory, grid(0)))
        assert sorted(file.name for file in tmp_path.iterdir()) == ["out.mcap", "out.mcap.part"]
        writer.write_raw("never added", 0, b"")
    assert [file.name for file in tmp_path.iterdir()] == ["out.mcap"]
    assert path.read_bytes() == b"older"


def test_a_place_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    """The sentence names path and reason."""
    with pytest.raises(BagError, match=r"nix/out\.mcap cannot be written: No such file"):
        BagWriter(tmp_path / "nix/out.mcap").__enter__()


@contextmanager
def files_of_at_most(limit_bytes: int) -> Iterator[None]:
    """Have this process write no larger files."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize("count", [1, 3, 30])
def test_a_file_that_grows_too_large_is_said(tmp_path: Path, count: int) -> None:
    """Whether a thread finds it while more messages come, or at the end, and nothing is left."""
    noise = np.random.default_rng(1).bytes(2**20)
    path = tmp_path / "out.mcap"

    def write() -> None:
        with files_of_at_most(100_000), BagWriter(path) as writer:
            writer.add_topic("/noise", "std_msgs/msg/String")
            for k in range(count):
                writer.write_raw("/noise", k, noise)

    with pytest.raises(BagError, match=r"out\.mcap cannot be written: File too large"):
        write()
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_written_after_what_could_not_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where batches wait for the thread already: a partial file that is kept has no hole."""
    asked: list[int] = []

    def add_message(_: Writer, __: int, log_time: int, *___: object, **____: object) -> None:
        asked.append(log_time)
        if log_time == 1:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(Writer, "add_message", add_message)

    def write() -> None:
        with BagWriter(tmp_path / "out.mcap", keeps_partial=True) as writer:
            writer.add_topic("/noise", "std_msgs/msg/String")
            for k in range(30):
                writer.write_raw("/noise", k, bytes(3 * 2**20))  # a batch each

    with pytest.raises(BagError, match=r"out\.mcap cannot be written: No space left"):
        write()
    assert asked == [0, 1]


def test_a_file_that_another_process_writes_is_left_alone(
    tmp_path: Path, factory: RosbagsFactory
) -> None:
    """Both would write into one, and the first would name it when the second is in the middle."""
    path = tmp_path / "out.mcap"
    with BagWriter(path) as first:
        first.add_topic("/map", GRID)
        with pytest.raises(
            BagError, match=r"out\.mcap cannot be written: another process writes it"
        ):
            BagWriter(path).__enter__()
        first.write("/map", 1, make_grid(factory, grid(1)))
    with BagReader([path]) as reader:
        assert len(list(reader.messages())) == 1
    write_sample(path, factory)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("fails", [False, True])
def test_no_other_process_has_the_file_until_it_is_named_or_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, fails: bool
) -> None:
    """Else the other one would empty what is about to get its name, or lose its own file."""
    path = tmp_path / "out.mcap"
    name = "unlink" if fails else "replace"
    act = getattr(Path, name)

    def meanwhile(*arguments: Path, **options: bool) -> Any:
        monkeypatch.setattr(Path, name, act)
        with pytest.raises(BagError, match="another process writes it"):
            BagWriter(path).__enter__()
        return act(*arguments, **options)

    monkeypatch.setattr(Path, name, meanwhile)
    with suppress(RuntimeError), BagWriter(path) as writer:
        writer.add_topic("/map", GRID)
        if fails:
            raise RuntimeError
    assert getattr(Path, name) is act, "it was called"
    assert [file.name for file in tmp_path.iterdir()] == ([] if fails else [path.name])


def test_what_a_recording_outdates_goes_when_it_appears(
    tmp_path: Path, factory: RosbagsFactory
) -> None:
    """Neither earlier, when it may still fail, nor later, when the process may have been killed."""
    path, other = tmp_path / "out.mcap", tmp_path / "metrics.json"
    path.write_bytes(b"earlier")
    other.write_text("{}")
    outdates = [other, tmp_path / "not_there.json"]
    with pytest.raises(RuntimeError), BagWriter(path, outdates=outdates):
        raise RuntimeError
    assert other.exists()
    assert path.read_bytes() == b"earlier"
    with BagWriter(path, outdates=outdates) as writer:
        writer.add_topic("/map", GRID)
        writer.write("/map", 1, make_grid(factory, grid(1)))
        assert other.exists()
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_a_folder_that_goes_meanwhile_is_said(tmp_path: Path, factory: RosbagsFactory) -> None:
    """It is removed, or a file takes its place."""
    for number, name in enumerate(("No such file or directory", "Not a directory")):
        folder = tmp_path / str(number)
        folder.mkdir()
        writer = BagWriter(folder / "out.mcap").__enter__()
        writer.add_topic("/map", GRID)
        writer.write("/map", 1, make_grid(factory, grid(1)))
        (folder / "out.mcap.part").unlink()
        folder.rmdir()
        if number:
            folder.write_text("")
        with pytest.raises(BagError, match=rf"out\.mcap cannot be written: {name}"):
            writer.__exit__(None, None, None)


def test_maps_compress_to_almost_nothing(tmp_path: Path, factory: RosbagsFactory) -> None:
    """Forty maps of 120,000 cells take less room than one."""
    write_sample(tmp_path / "out.mcap", factory)
    assert (tmp_path / "out.mcap").stat().st_size < 120_000
