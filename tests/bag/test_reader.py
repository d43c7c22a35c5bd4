"""Reading recordings of every kind, and saying what is wrong with bad ones."""

import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from mcap.writer import IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

from are_ros.bag.reader import BagReader, BagTopic
from are_ros.bag.types import jazzy_typestore
from are_ros.checks.file import check_files
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError, InputError
from are_ros.messages.transforms import StampedTransform
from bags.simulation.making import RosbagsFactory, make_transforms

WriteBag = Callable[[Path, list[tuple[str, int, Any]]], Path]
STRING = "std_msgs/msg/String"
KINDS = [".bag", ".mcap", ".db3"]


def strings(factory: RosbagsFactory, *records: tuple[str, int, str]) -> list[tuple[str, int, Any]]:
    """Return records of String messages."""
    return [(topic, at, factory.make(STRING, data=text)) for topic, at, text in records]


@pytest.fixture
def words(factory: RosbagsFactory) -> list[tuple[str, int, Any]]:
    """Return four messages on two topics."""
    return strings(
        factory, ("/b", 10, "one"), ("/a", 20, "two"), ("/b", 20, "three"), ("/a", 30, "four")
    )


def texts(reader: BagReader, **selection: Any) -> list[tuple[str, int, str]]:
    """Return what a reader yields as topic, time and text."""
    return [
        (message.topic, message.log_time_ns, reader.deserialize(message).data)
        for message in reader.messages(**selection)
    ]


@pytest.mark.parametrize("suffix", KINDS)
def test_every_kind_is_read(
    tmp_path: Path, write_bag: WriteBag, words: list[tuple[str, int, Any]], suffix: str
) -> None:
    """Topics, bounds and messages are the same, whatever the format."""
    with BagReader([write_bag(tmp_path / f"bag{suffix}", words)]) as reader:
        assert reader.topics == (BagTopic("/a", STRING, 2, False), BagTopic("/b", STRING, 2, False))
        assert (reader.start_ns, reader.end_ns) == (10, 31)
        assert sorted(texts(reader)) == [
            ("/a", 20, "two"), ("/a", 30, "four"), ("/b", 10, "one"), ("/b", 20, "three"),
        ]  # fmt: skip
        assert [at for _, at, _ in texts(reader)] == [10, 20, 20, 30]
        assert texts(reader, topics=("/a",), start_ns=20, stop_ns=30) == [("/a", 20, "two")]
        assert texts(reader, topics=("/nix",)) == []


def test_messages_that_are_promised_and_missing_are_said(
    tmp_path: Path, write_bag: WriteBag, words: list[tuple[str, int, Any]]
) -> None:
    """The reader of mcap ends in silence at what it cannot read."""
    with BagReader([write_bag(tmp_path / "bag.mcap", words)]) as reader:
        (part,) = reader._parts
        cut = SimpleNamespace(
            connections=part.reader.connections,
            messages=lambda *selection: list(part.reader.messages(*selection))[:-1],
        )
        reader._parts = [replace(part, reader=cut)]
        with pytest.raises(BagError, match=r"bag\.mcap: damaged: 3 of 4 messages can be read"):
            list(reader.messages())
        assert len(list(reader.messages(start_ns=0, stop_ns=31))) == 3


def test_a_message_of_another_type_than_expected_is_refused(
    tmp_path: Path, write_bag: WriteBag, words: list[tuple[str, int, Any]]
) -> None:
    """What reads the others would not understand it; other topics are read."""
    with BagReader([write_bag(tmp_path / "bag.mcap", words)]) as reader:
        reader.expect({"/a": ("std_msgs/msg/Int32", "std_msgs/msg/Int8"), "/b": (STRING,)})
        assert [text for _, _, text in texts(reader, topics=("/b",))] == ["one", "three"]
        refused = r"^/a: a message is of type std_msgs/msg/String, not std_msgs/msg/Int32 or std"
        with pytest.raises(InputError, match=refused):
            texts(reader, topics=("/a",))


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_a_folder_is_read_as_its_file(
    tmp_path: Path, write_bag: WriteBag, words: list[tuple[str, int, Any]], suffix: str
) -> None:
    """The folder with metadata.yaml and the file alone hold the same."""
    file = write_bag(tmp_path / f"bag{suffix}", words)
    with BagReader([file]) as one, BagReader([file.parent]) as other:
        assert texts(one) == texts(other)
        assert one.topics == other.topics


@pytest.mark.parametrize("suffix", KINDS)
def test_several_recordings_are_one_stream(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag, suffix: str
) -> None:
    """Messages of two recordings come in order of time, counted together."""
    one = write_bag(tmp_path / f"one{suffix}", strings(factory, ("/a", 10, "1"), ("/a", 30, "3")))
    two = write_bag(tmp_path / f"two{suffix}", strings(factory, ("/a", 20, "2"), ("/b", 40, "4")))
    with BagReader([two, one]) as reader:
        assert [text for _, _, text in texts(reader)] == ["1", "2", "3", "4"]
        assert (reader.start_ns, reader.end_ns) == (10, 41)
        assert reader.topics[0].count == 3


def test_compressed_recordings_are_read(tmp_path: Path, words: list[tuple[str, int, Any]]) -> None:
    """Files and messages that rosbag2 compressed with zstd are read as others.

    Messages of a file alone, without the metadata that tell of it, too.
    """
    store = jazzy_typestore()
    for mode in (CompressionMode.FILE, CompressionMode.MESSAGE):
        folder = tmp_path / mode.name
        writer = Ros2Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3)
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            connection = writer.add_connection("/a", STRING, typestore=store)
            for _, at, message in words:
                writer.write(connection, at, store.serialize_cdr(message, STRING))
        with pytest.raises(BagError, match="this recording is given twice"):
            BagReader([folder, folder]).__enter__()
        alone = folder.glob("*.db3") if mode is CompressionMode.MESSAGE else ()
        for path in (folder, *alone):
            with BagReader([path]) as reader:
                assert [text for _, _, text in texts(reader)] == ["one", "two", "three", "four"]
    assert path.suffix == ".db3"


@pytest.mark.parametrize("name", ["a#b", "a?b", "a%20b"])
def test_a_compressed_database_may_have_any_name(
    tmp_path: Path, words: list[tuple[str, int, Any]], name: str
) -> None:
    """What is read is a copy of it, which rosbags names after it."""
    store = jazzy_typestore()
    writer = Ros2Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/a", STRING, typestore=store)
        writer.write(connection, 1, store.serialize_cdr(words[0][2], STRING))
    (file,) = (tmp_path / "bag").glob("*.zstd")
    renamed = file.rename(file.with_name(f"{name}.db3.zstd"))
    metadata = tmp_path / "bag" / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(file.name, renamed.name))
    with BagReader([tmp_path / "bag"]) as reader:
        assert texts(reader) == [("/a", 1, "one")]


@pytest.fixture
def in_two_files(tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag) -> Path:
    """Return a folder of two files, the later one first, that overlap by seconds."""
    s = NS_PER_S
    late = strings(factory, ("/a", 4 * s, "4"), ("/a", 8 * s, "8 late"), ("/b", 20 * s, "20"))
    early = strings(factory, ("/a", 1, "0"), ("/b", 5 * s, "5"), ("/a", 8 * s, "8 early"))
    first = write_bag(tmp_path / "late.mcap", late)
    second = write_bag(tmp_path / "early.mcap", early)
    name = second.name if second.name != first.name else "early.mcap"
    second.rename(first.parent / name)
    metadata = yaml.safe_load((first.parent / "metadata.yaml").read_text())
    metadata["rosbag2_bagfile_information"]["relative_file_paths"] = [first.name, name]
    (first.parent / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    return first.parent


def test_files_that_overlap_are_read_in_order_of_time(in_two_files: Path) -> None:
    """Whatever their order in metadata.yaml, which is that of the first file alone here."""
    with BagReader([in_two_files]) as reader:
        said = [text for _, _, text in texts(reader)]
        assert said == ["0", "4", "5", "8 late", "8 early", "20"]
        assert (reader.start_ns, reader.end_ns) == (1, 20 * NS_PER_S + 1)
        assert [topic.count for topic in reader.topics] == [4, 2]


@pytest.mark.parametrize("suffix", KINDS)
def test_a_clock_that_jumped_back_shows_in_the_order_of_the_file(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag, suffix: str
) -> None:
    """In order of log time it does not. Another topic that was written later is no jump."""
    s = NS_PER_S
    times = [("/a", at) for at in (2, 4, 6, 3, 5, 7)] + [("/b", at) for at in (2, 3, 8)]
    records = strings(factory, *((topic, at * s, f"{k}") for k, (topic, at) in enumerate(times)))
    with BagReader([write_bag(tmp_path / f"bag{suffix}", records)]) as reader:
        assert reader.jump_back(["/a", "/b"], 0, 9 * s) == ("/a", 3 * s, 6 * s, ())
        assert reader.jump_back(["/b"], 0, 9 * s) is None
        assert reader.jump_back(["/a"], 0, 3 * s) is None, "before it"
        assert reader.jump_back(["/a"], 6 * s + 1, 9 * s) is None, "after it"
        assert reader.jump_back(["/a"], 5 * s, 9 * s) == ("/a", 3 * s, 6 * s, ())
        written = [reader.deserialize(one).data for one in reader.in_file_order(["/a"])]
        if suffix != ".bag":
            assert written == ["0", "1", "2", "3", "4", "5"]


@pytest.mark.parametrize("back_s", [0.5, 3.0])
def test_a_jump_of_many_chunks_is_found(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag, back_s: float
) -> None:
    """By the times of the chunks, before their indexes are read; half a second is none."""
    text, back_ns = "x" * 100_000, round(back_s * NS_PER_S)
    times = [k * NS_PER_S // 2 for k in range(1, 80)]
    times += [times[-1] - back_ns + NS_PER_S // 10 * k for k in range(20)]
    records = strings(factory, *(("/a", at, text) for at in times))
    with BagReader([write_bag(tmp_path / "bag.mcap", records)]) as reader:
        jump = reader.jump_back(["/a"], reader.start_ns, reader.end_ns)
        assert (jump and jump[:3]) == (("/a", times[79], times[78]) if back_s > 1.0 else None)


@pytest.mark.parametrize("suffix", KINDS)
def test_parts_that_are_not_mixed_can_be_read_one_by_one(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag, suffix: str
) -> None:
    """A clock that was an hour ahead, until it was set: no log time is one of both parts.

    One that is an hour ahead only for a while parts what came before from what comes after.
    """
    s, hour = NS_PER_S, 3600 * NS_PER_S
    ahead = [hour + k * s for k in range(1, 9)]
    right = [k * s for k in range(1, 61)]
    for times, lone in (
        (ahead + right, ((s, 60 * s), (hour + s, hour + 8 * s))),
        (
            right[:30] + ahead + right[30:],
            ((s, 30 * s), (31 * s, 60 * s), (hour + s, hour + 8 * s)),
        ),
    ):
        records = strings(factory, *(("/a", at, f"{at}") for at in times))
        with BagReader([write_bag(tmp_path / f"{len(lone)}{suffix}", records)]) as reader:
            jump = reader.jump_back(["/a"], 0, 2 * hour)
            assert jump is not None
            assert (jump.until_ns, jump.lone) == (hour + 8 * s, lone)
            for first_ns, last_ns in lone:
                assert reader.jump_back(["/a"], first_ns, last_ns + 1) is None
            assert reader.jump_back(["/a"], 0, 61 * s) is None, "in order"
            assert reader.jump_back(["/a"], 55 * s, hour + 3 * s) is not None


def test_a_file_that_is_named_twice_is_read_once(in_two_files: Path) -> None:
    """As by a metadata.yaml that was put together by hand."""
    metadata = in_two_files / "metadata.yaml"
    content = yaml.safe_load(metadata.read_text())
    content["rosbag2_bagfile_information"]["relative_file_paths"] *= 2
    metadata.write_text(yaml.safe_dump(content))
    with BagReader([in_two_files]) as reader:
        assert len(texts(reader)) == 6


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_other_qos_in_metadata_is_no_matter(
    tmp_path: Path, write_bag: WriteBag, words: list[tuple[str, int, Any]], suffix: str
) -> None:
    """Some change it by hand."""
    none = {"sec": 0, "nsec": 0}
    profile = {
        **dict.fromkeys(("deadline", "lifespan", "liveliness_lease_duration"), none),
        "history": "keep_last",
        "depth": 1,
        "reliability": "reliable",
        "durability": "transient_local",
        "liveliness": "automatic",
        "avoid_ros_namespace_conventions": False,
    }
    folder = write_bag(tmp_path / f"bag{suffix}", words).parent
    metadata = yaml.safe_load((folder / "metadata.yaml").read_text())
    for topic in metadata["rosbag2_bagfile_information"]["topics_with_message_count"]:
        topic["topic_metadata"]["offered_qos_profiles"] = [profile]
    (folder / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    with BagReader([folder]) as reader:
        assert len(texts(reader)) == 4


def test_a_database_that_is_not_complete_is_refused(
    tmp_path: Path, write_bag: WriteBag, words: list[tuple[str, int, Any]]
) -> None:
    """The recorder was killed: the last messages are in a file of SQLite's beside it."""
    file = write_bag(tmp_path / "bag.db3", words)
    Path(f"{file}-wal").write_bytes(b"rest")
    for path in (file, file.parent):
        with pytest.raises(BagError, match=r"db3-wal still .* `sqlite3 .*wal_checkpoint"):
            BagReader([path]).__enter__()


@pytest.mark.parametrize("rest", ["wal", "journal"])
def test_a_link_to_a_database_that_is_not_complete_is_refused(
    tmp_path: Path, write_bag: WriteBag, words: list[tuple[str, int, Any]], rest: str
) -> None:
    """What is missing lies beside the database itself, not beside the link."""
    file = write_bag(tmp_path / "bag.db3", words)
    (link := tmp_path / "link.db3").symlink_to(file)
    Path(f"{file}-{rest}").write_bytes(b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7")
    with pytest.raises(BagError, match=rf"link\.db3: .* bag\.db3-{rest} .* `sqlite3 bag\.db3 "):
        BagReader([link]).__enter__()


def test_what_is_beside_a_database_has_to_be_readable(
    tmp_path: Path,
    write_bag: WriteBag,
    words: list[tuple[str, int, Any]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As where the recorder ran as root; else nobody knows whether messages are there."""
    file = write_bag(tmp_path / "bag.db3", words)
    Path(f"{file}-wal").write_bytes(b"rest")
    opened = Path.open

    def refused(path: Path, *arguments: Any, **options: Any) -> Any:
        if path.name.endswith("-wal"):
            raise PermissionError(13, "Permission denied")
        return opened(path, *arguments, **options)

    monkeypatch.setattr(Path, "open", refused)
    with pytest.raises(BagError, match=r"bag\.db3-wal: there is no permission to read it"):
        BagReader([file]).__enter__()


def test_a_database_in_the_midst_of_a_transaction_is_refused(
    tmp_path: Path, write_bag: WriteBag, words: list[tuple[str, int, Any]]
) -> None:
    """Its journal, which is still needed, lies beside it; one that is not is no matter."""
    file = write_bag(tmp_path / "bag.db3", words)
    journal = Path(f"{file}-journal")
    journal.write_bytes(bytes(512))
    with BagReader([file]) as reader:
        assert len(list(reader.messages())) == 4
    journal.write_bytes(b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7")
    for path in (file, file.parent):
        with pytest.raises(BagError, match=r"db3-journal tells .* `sqlite3 bag\.db3 \.tables`"):
            BagReader([path]).__enter__()


@pytest.mark.parametrize("suffix", KINDS)
def test_a_file_that_is_written_to_while_it_is_read_is_said(
    tmp_path: Path, write_bag: WriteBag, words: list[tuple[str, int, Any]], suffix: str
) -> None:
    """A recorder or a copy is at work; one that was replaced as a whole is read as it was."""
    file = write_bag(tmp_path / f"bag{suffix}", words)
    said = rf"bag\{suffix}: it was written to while it was read"
    with BagReader([file]) as reader:
        messages = reader.messages(start_ns=0, stop_ns=100)
        assert next(messages).log_time_ns == 10
        with file.open("ab") as end:
            end.write(b"more")
        with pytest.raises(BagError, match=said):
            list(messages)
        with pytest.raises(BagError, match=said):
            reader.jump_back(["/a"], 0, 100)
    file = write_bag(tmp_path / f"other{suffix}", words)
    with BagReader([file]) as reader:
        (tmp_path / "new").write_bytes(b"new")
        (tmp_path / "new").rename(file)
        assert len(list(reader.messages())) == 4


def test_a_database_all_of_which_is_in_the_file_beside_it_is_no_damaged_one(
    tmp_path: Path,
) -> None:
    """The recorder was killed before the first checkpoint: the database itself has no tables."""
    file = tmp_path / "bag.db3"
    file.write_bytes(b"")
    Path(f"{file}-wal").write_bytes(b"rest")
    with pytest.raises(BagError, match=r"bag\.db3: the last messages are in bag\.db3-wal still"):
        BagReader([file]).__enter__()


@pytest.mark.parametrize("name", ["a#b.db3", "a?b.db3", "a%20b.db3", "a%20b"])
def test_names_with_signs_of_an_address_are_names(
    tmp_path: Path, write_bag: WriteBag, words: list[tuple[str, int, Any]], name: str
) -> None:
    """A database beside it, which the name read as an address would mean, is not read."""
    for number, other in enumerate(("a", "a b.db3")):
        write_bag(tmp_path / f"{number}.db3", words[:1]).rename(tmp_path / other)
    file = write_bag(tmp_path / "bag.db3", words)
    path = (file if name.endswith(".db3") else file.parent).rename(tmp_path / name)
    with BagReader([path]) as reader:
        assert len(list(reader.messages())) == 4
        assert len(list(reader.in_file_order(["/a", "/b"]))) == 4


def test_files_that_the_metadata_do_not_name_are_told(in_two_files: Path) -> None:
    """A recorder that was killed leaves such; the results of a replay there are none of them."""
    with BagReader([in_two_files]) as reader:
        assert reader.unnamed == []
    metadata = in_two_files / "metadata.yaml"
    content = yaml.safe_load(metadata.read_text())
    names = content["rosbag2_bagfile_information"]["relative_file_paths"]
    late = names.pop()
    metadata.write_text(yaml.safe_dump(content))
    (in_two_files / "augmented.mcap").write_bytes(b"")
    (in_two_files / "other.db3").write_bytes(b"")
    (in_two_files / "other.db3-wal").write_bytes(b"what is not read need not be complete")
    with BagReader([in_two_files]) as reader:
        (said,) = reader.unnamed
        assert said.startswith(f"{in_two_files}: its metadata.yaml does not name {late}, left out")
    with BagReader([in_two_files / names[0]]) as reader:
        assert reader.unnamed == []
    with BagReader([in_two_files, in_two_files / late]) as reader:
        assert reader.unnamed == []
        assert len(texts(reader)) == 6
    with pytest.raises(BagError, match=f"{names[0]}: this recording is given twice"):
        BagReader([in_two_files, in_two_files / names[0]]).__enter__()


def write_mcap(path: Path, times: list[int], **options: Any) -> Path:
    """Write an mcap of Strings at some times, with options of its writer."""
    with path.open("wb") as file:
        writer = McapWriter(file, **options)
        writer.start(profile="ros2", library="test")
        channel = writer.register_channel(
            "/a", "cdr", writer.register_schema(STRING, "ros2msg", b"string data")
        )
        for at in times:
            writer.add_message(channel, at, b"\0\1\0\0\1\0\0\0\0", at)
        writer.finish()
    return path


def test_a_database_that_cannot_be_read_is_said_for_what_it_is(
    tmp_path: Path, write_bag: WriteBag, words: list[tuple[str, int, Any]]
) -> None:
    """Cut off, empty, or something else."""
    data = write_bag(tmp_path / "bag.db3", words).read_bytes()
    path = tmp_path / "odd.db3"
    for content, said in (
        (data[:-4096], "it ends too early or is damaged; `sqlite3 FILE .recover` may save a part"),
        (b"", "it is no rosbag2 database, or an empty one"),
        (b"words" * 1000, "it is no rosbag2 database, or its beginning is damaged"),
    ):
        path.write_bytes(content)
        with pytest.raises(BagError, match=f": {said}$"):
            BagReader([path]).__enter__()


def test_an_mcap_with_topics_and_no_messages_lacks_no_index(tmp_path: Path) -> None:
    """There is nothing to recover, as in a database without messages."""
    path = write_mcap(tmp_path / "bag.mcap", [])
    with pytest.raises(BagError, match=r"bag\.mcap: the recording holds no message"):
        BagReader([path]).__enter__()
    folder = tmp_path / "folder"
    with Ros2Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.add_connection("/a", STRING, typestore=jazzy_typestore())
    with pytest.raises(BagError, match="folder: the recording holds no message"):
        BagReader([folder]).__enter__()


@pytest.mark.parametrize("encoding", ["jsonschema", "protobuf"])
def test_an_mcap_with_types_that_are_not_of_ros_is_no_damaged_one(
    tmp_path: Path, encoding: str
) -> None:
    """As one that other programs than ROS 2's have written topics into."""
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2", library="test")
        writer.register_channel("/j", "json", writer.register_schema("j", encoding, b"{}"))
        writer.finish()
    with pytest.raises(BagError, match=f"are described as {encoding}, which is not ROS 2's way"):
        BagReader([path]).__enter__()


def test_an_mcap_without_an_index_of_messages_is_no_damaged_one(tmp_path: Path) -> None:
    """Also a window of it was read as empty."""
    path = write_mcap(tmp_path / "bag.mcap", [10, 20], index_types=IndexType.CHUNK)
    with pytest.raises(BagError, match="no index of messages; `mcap recover` writes one"):
        BagReader([path]).__enter__()


def test_an_mcap_without_any_index_has_to_be_in_order_of_time(tmp_path: Path) -> None:
    """It is read as it lies."""
    path = write_mcap(tmp_path / "bag.mcap", [10, 20], use_chunking=False)
    with BagReader([path]) as reader:
        assert [message.log_time_ns for message in reader.messages()] == [10, 20]
    path = write_mcap(tmp_path / "bag.mcap", [20, 10], use_chunking=False)
    with (
        BagReader([path]) as reader,
        pytest.raises(BagError, match=r"not in order of time, and have no index; `mcap recover`"),
    ):
        list(reader.messages())


def test_times_beyond_those_that_numbers_hold_are_said(tmp_path: Path) -> None:
    """An mcap has room for them: an unsigned number of 64 bits."""
    path = write_mcap(tmp_path / "bag.mcap", [10, 2**63])
    with pytest.raises(BagError, match=r"bag\.mcap: the log times go on after the year 2262"):
        BagReader([path]).__enter__()


def test_a_latched_topic_is_known(tmp_path: Path, factory: RosbagsFactory) -> None:
    """ROS 1 marks latching at the connection."""
    path = tmp_path / "bag.bag"
    store = jazzy_typestore()
    with Ros1Writer(path) as writer:
        for topic, latching in (("/a", 1), ("/b", 0)):
            connection = writer.add_connection(topic, STRING, typestore=store, latching=latching)
            writer.write(connection, 1, store.serialize_ros1(factory.make(STRING), STRING))
    with BagReader([path]) as reader:
        assert [topic.is_latched for topic in reader.topics] == [True, False]


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_transforms_are_read_quickly_and_slowly_alike(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag, suffix: str
) -> None:
    """The shortcut gives what was recorded."""
    edges = [StampedTransform("map", "odom", 5, (1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8))]
    records = [("/tf", 5, make_transforms(factory, edges))]
    with BagReader([write_bag(tmp_path / f"bag{suffix}", records)]) as reader:
        (message,) = reader.messages()
        assert reader.transforms(message) == edges
        big_endian = jazzy_typestore().serialize_cdr(
            records[0][2], "tf2_msgs/msg/TFMessage", little_endian=False
        )
        assert reader.transforms(message._replace(data=bytes(big_endian))) == edges
        with pytest.raises(InputError, match=r"^/tf: the message at 5 ns is no tf2_msgs"):
            reader.transforms(message._replace(data=message.data[:30]))


def mcap(path: Path, *, schema: str = "", encoding: str = "cdr", data: bytes = b"") -> Path:
    """Write a recording of one message that is of type my/msg/Odd, and one String."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2")
        for topic, name, text in (("/odd", "my/msg/Odd", schema), ("/a", STRING, "string data\n")):
            schema_encoding = "ros2msg" if text else ""
            number = writer.register_schema(name, schema_encoding, text.encode())
            channel = writer.register_channel(topic, encoding if topic == "/odd" else "cdr", number)
            payload = data if topic == "/odd" else b"\0\1\0\0\2\0\0\0x\0"
            writer.add_message(channel, 1, payload, 1)
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({}, "/odd: the recording does not define its type, my/msg/Odd, and it is none of ROS's"),
        ({"schema": "int32 !!"}, "/odd: the recording's definition of my/msg/Odd cannot be under"),
        ({"schema": "other/Missing x"}, "/odd: the recording's definition of my/msg/Odd cannot be"),
        ({"schema": "int32 x", "encoding": "json"}, "/odd: its messages are encoded as json"),
    ],
)
def test_one_odd_type_does_not_spoil_the_others(
    tmp_path: Path, options: dict[str, Any], sentence: str
) -> None:
    """A type that cannot be understood is an error only where it is needed."""
    with BagReader([mcap(tmp_path / "bag.mcap", **options)]) as reader:
        odd, word = sorted(reader.messages(), key=lambda message: message.topic, reverse=True)
        assert reader.deserialize(word).data == "x"
        with pytest.raises(BagError) as caught:
            reader.deserialize(odd)
    assert str(caught.value).startswith(sentence)


def test_malformed_bytes_are_an_input_error(tmp_path: Path) -> None:
    """One bad message is the message's fault, named with topic, time and type."""
    with BagReader([mcap(tmp_path / "bag.mcap", schema="int32 x", data=b"\0\1\0\0\1")]) as reader:
        (message,) = reader.messages(("/odd",))
        with pytest.raises(InputError, match=r"^/odd: the message at 1 ns is no my/msg/Odd, "):
            reader.deserialize(message)


@pytest.mark.parametrize("suffix", KINDS)
def test_a_truncated_recording_is_said(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag, suffix: str
) -> None:
    """Whatever is cut off, the error is a sentence that begins with the path."""
    records = strings(factory, *(("/a", k, "x" * 1000) for k in range(100)))
    data = write_bag(tmp_path / f"bag{suffix}", records).read_bytes()
    cut = tmp_path / f"cut{suffix}"
    for size in (0, 5, 13, 40, 5000, len(data) // 2, len(data) - 9000):
        cut.write_bytes(data[:size])
        with pytest.raises(BagError) as caught, BagReader([cut]) as reader:
            list(reader.messages())
        assert str(caught.value).startswith(f"{cut}: ")
        assert "Error: " not in str(caught.value)


@pytest.mark.parametrize("left_out", ["repeat_channels", "repeat_schemas"])
def test_an_mcap_whose_summary_lacks_its_topics_is_said(tmp_path: Path, left_out: str) -> None:
    """Messages are there, but nothing says of which topics or types: it is not one without any."""
    path = tmp_path / "bag.mcap"
    options = {left_out: False}
    with path.open("wb") as file:
        writer = McapWriter(file, **options)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema(STRING, "ros2msg", b"string data")
        channel = writer.register_channel("/a", "cdr", schema)
        for at in (10, 20):
            writer.add_message(channel, at, b"\0\1\0\0\1\0\0\0\0", at)
        writer.finish()
    with pytest.raises(BagError, match="its summary lacks the topics"), BagReader([path]):
        pass


def test_paths_that_are_no_recordings_are_said(tmp_path: Path) -> None:
    """Each mistake has its sentence."""
    (tmp_path / "folder").mkdir()
    for name in ("a.bag", "b.mcap", "c.txt", "d.bag.active", "e.mcap.zstd", "folder/x.db3"):
        (tmp_path / name).write_bytes(b"")
    for names, sentence in (
        ([], "no recording was given"),
        (["nix.bag"], "there is no such file or folder"),
        (["c.txt"], "it is no recording; give a rosbag2 folder, an .mcap, .db3 or .bag file"),
        (["d.bag.active"], "`rosbag reindex` makes a .bag of it"),
        (["e.mcap.zstd"], "give its folder, if that has a metadata.yaml, or decompress it (zstd"),
        (["folder"], "no rosbag2 recording; give the files in it themselves: x.db3"),
        (["a.bag", "b.mcap"], "recordings of ROS 1 and of ROS 2 cannot be read together"),
    ):
        with pytest.raises(BagError) as caught:
            BagReader([tmp_path / name for name in names])
        assert sentence in str(caught.value)


@pytest.mark.parametrize("suffix", KINDS)
def test_an_empty_recording_is_said(tmp_path: Path, write_bag: WriteBag, suffix: str) -> None:
    """A recording without messages is refused."""
    path = write_bag(tmp_path / f"bag{suffix}", [])
    with pytest.raises(BagError, match="the recording holds no message"), BagReader([path]):
        pass


def test_a_folder_that_lost_its_file_is_said(
    tmp_path: Path, write_bag: WriteBag, words: list[tuple[str, int, Any]]
) -> None:
    """metadata.yaml without its files, or malformed, is named."""
    file = write_bag(tmp_path / "bag.mcap", words)
    file.unlink()
    file.parent.rename(tmp_path / "it's")
    for folder in (tmp_path / "it's", file.parent):
        with pytest.raises(BagError, match=r"names are missing: \S+mcap; give those"):
            BagReader([folder]).__enter__()
        folder.rename(file.parent)
    (file.parent / "metadata.yaml").write_text("a: [")
    with pytest.raises(BagError, match=r"its metadata\.yaml is malformed"):
        BagReader([file.parent]).__enter__()


@pytest.mark.parametrize(
    ("changed", "words_of_it"),
    [
        ({"version": 99}, "is of an unknown version"),
        ({"version": None}, "is empty or no rosbag2 metadata"),
        ({"storage_identifier": "sqlite4"}, "names another storage than mcap and sqlite3"),
        ({"duration": ...}, "lacks a part of rosbag2's metadata"),
        ({"serialization_format": "json"}, "names topics that are not CDR"),
    ],
)
def test_metadata_that_are_not_understood_are_said(
    tmp_path: Path,
    write_bag: WriteBag,
    words: list[tuple[str, int, Any]],
    changed: dict[str, Any],
    words_of_it: str,
) -> None:
    """As of a newer rosbag2; the file itself is read all the same."""
    file = write_bag(tmp_path / "bag.mcap", words)
    metadata = file.parent / "metadata.yaml"
    content = yaml.safe_load(metadata.read_text())
    information = content["rosbag2_bagfile_information"]
    topic = information["topics_with_message_count"][0]["topic_metadata"]
    for key, value in changed.items():
        (topic if key in topic else information)[key] = value
        if value is ...:
            del information[key]
    metadata.write_text(yaml.safe_dump(content))
    said = rf"its metadata\.yaml {words_of_it}; give the files in it"
    with pytest.raises(BagError, match=said):
        BagReader([file.parent]).__enter__()
    with BagReader([file]) as reader:
        assert len(list(reader.messages())) == len(words)


def test_every_real_recording_is_read_whole(real_data: Path) -> None:
    """All messages of all real recordings are read and understood."""
    paths = sorted(real_data.glob("*/*.bag"))
    assert len(paths) == 9
    for path in paths:
        with BagReader([path]) as reader:
            counted = sum(topic.count for topic in reader.topics)
            objects = [reader.deserialize(message) for message in reader.messages()]
        assert len(objects) == counted


def test_an_mcap_is_read_in_file_order_chunk_by_chunk(
    tmp_path: Path, write_bag: WriteBag, factory: RosbagsFactory
) -> None:
    """Of 48 MB, compressed to a hundredth, a few are in memory at a time, in `are check`, too."""
    texts_of_a_megabyte = strings(factory, *(("/a", at, "." * 10**6) for at in range(48)))
    path = write_bag(tmp_path / "bag.mcap", texts_of_a_megabyte)
    with BagReader([path]) as reader:
        tracemalloc.start()
        try:
            assert sum(1 for _ in reader.in_file_order(["/a"])) == 48
            of_reader = tracemalloc.get_traced_memory()[1]
            tracemalloc.reset_peak()
            assert check_files((path,), is_live=True)[0].looked_at == 48
            of_check = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    assert max(of_reader, of_check) < 16 * 10**6
