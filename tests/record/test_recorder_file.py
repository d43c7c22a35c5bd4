"""The file of a recording, and the thread that writes it."""

import threading
from contextlib import suppress
from pathlib import Path

import pytest
from mcap.exceptions import EndOfFile
from mcap.records import Message, Metadata
from mcap.stream_reader import StreamReader

from are_ros.bag.reader import BagReader
from are_ros.bag.writer import BagWriter, OfferedQos
from are_ros.errors import BagError
from are_ros.record.file import FileWriter
from are_ros.record.inbox import LossCount, Stamped

STRING = "std_msgs/msg/String", (OfferedQos(),)
DATA = b"\x00\x01\x00\x00\x02\x00\x00\x00x\x00"


class SlowBag(BagWriter):
    """A recording on a disk that waits."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.may_write = threading.Event()

    def add_topic(self, topic: str, type_name: str, **options: object) -> None:
        """Wait before the first message."""
        assert self.may_write.wait(60.0)
        super().add_topic(topic, type_name, **options)  # type: ignore[arg-type]


def salvage(path: Path) -> list[object]:
    """Return the records of a file that ends too early."""
    records: list[object] = []
    with path.open("rb") as stream, suppress(EndOfFile):
        for record in StreamReader(stream).records:
            records.append(record)  # noqa: PERF402 - extend would lose them at the exception
    return records


def test_topics_without_messages_are_in_the_file(tmp_path: Path) -> None:
    """They come last; those with messages in the order of their first one."""
    with FileWriter(BagWriter(tmp_path / "x.mcap")) as file:
        for topic in ("/silent", "/b", "/a"):
            file.announce(topic, *STRING)
        file.put([Stamped("/a", 1, 1, DATA), Stamped("/b", 2, 2, DATA), Stamped("/a", 3, 3, DATA)])
    assert list(file.counts().items()) == [("/a", 2), ("/b", 1), ("/silent", 0)]
    with BagReader([tmp_path / "x.mcap"]) as reader:
        assert [message.topic for message in reader.messages()] == ["/a", "/b", "/a"]


def test_what_the_disk_cannot_take_is_dropped_and_counted(tmp_path: Path) -> None:
    """The memory is bounded; what fits in later is written again."""
    bag = SlowBag(tmp_path / "x.mcap")
    message = Stamped("/a", 1, 1, DATA)
    with FileWriter(bag, most_bytes=2 * len(DATA)) as file:
        file.announce("/a", *STRING)
        file.put([message] * 5)
        assert file.dropped == {"/a": 3}
        bag.may_write.set()
    assert file.counts() == {"/a": 2}


def test_a_failed_recording_keeps_its_part(tmp_path: Path) -> None:
    """All that was put is in it, with a note of what it is, for `mcap recover` to find."""
    notes = {"if_unfinished": "recover it"}
    bag = BagWriter(tmp_path / "x.mcap", notes=notes, keeps_partial=True)
    with pytest.raises(ZeroDivisionError), FileWriter(bag) as file:  # noqa: PT012 - order matters
        file.announce("/a", *STRING)
        file.put([Stamped("/a", 1, 1, DATA), Stamped("/a", 2, 2, DATA)])
        raise ZeroDivisionError
    assert [path.name for path in tmp_path.iterdir()] == ["x.mcap.part"]
    saved = salvage(tmp_path / "x.mcap.part")
    assert [record.data for record in saved if isinstance(record, Message)] == [DATA, DATA]
    assert [record.metadata for record in saved if isinstance(record, Metadata)] == [notes]


def test_an_error_of_the_thread_reaches_the_caller(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the end at the latest."""

    def fail(*_: object) -> None:
        raise BagError("the disk is full")

    monkeypatch.setattr(BagWriter, "write_raw", fail)
    with (  # noqa: PT012 - what raises is the end of the block
        pytest.raises(BagError, match="the disk is full"),
        FileWriter(BagWriter(tmp_path / "x.mcap")) as file,
    ):
        file.announce("/a", *STRING)
        file.put([Stamped("/a", 1, 1, DATA)])
    assert list(tmp_path.iterdir()) == []


def test_gaps_in_a_publishers_numbers_are_losses() -> None:
    """They count once the publisher is seen to be the same; another one's do not."""
    losses = LossCount()
    losses.see(3)
    losses.settle(1, are_the_same=False)
    for sequence in (7, 8, 11):
        losses.see(sequence)
    assert losses.lost == 0
    losses.settle(1, are_the_same=True)
    assert losses.lost == 2
    losses.see(40)
    losses.settle(1, are_the_same=False)
    losses.see(60)
    losses.settle(1, are_the_same=True)
    assert losses.lost == 2


def test_several_publishers_cannot_be_told_apart() -> None:
    """Their numbers are mixed: nothing is counted."""
    losses = LossCount()
    losses.settle(2, are_the_same=False)
    for sequence in (1, 50, 2, 51):
        losses.see(sequence)
    losses.settle(2, are_the_same=True)
    assert losses.lost == 0
