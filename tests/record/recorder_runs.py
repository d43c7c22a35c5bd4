"""A recorder that runs in a thread of its own while a test publishes."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from are_ros.bag.reader import BagMessage, BagReader
from tests.ros import WAIT_S


class RecorderRun:
    """What a test sees of a recorder: when it is ready, what it said, and its outcome."""

    def __init__(self) -> None:
        self.ready = threading.Event()
        self.stop = threading.Event()
        self.sentences: list[str] = []
        self.outcome: Any = None
        self.error: Exception | None = None

    def work(self, options: Any) -> None:
        """Record until told to stop, and keep what comes of it."""
        from are_ros.record.recorder import record

        try:
            self.outcome = record(options, self.sentences.append, self.ready.set, self.stop.is_set)
        except Exception as error:  # noqa: BLE001 - raised again in the test's own thread
            self.error = error
        finally:
            self.ready.set()


@contextmanager
def recording(path: Path, *wait_for: str, **options: Any) -> Iterator[RecorderRun]:
    """Record while the block runs, from when publishers of `wait_for` are found."""
    from are_ros.record.topics import RecordOptions

    run = RecorderRun()
    wanted = RecordOptions(path, wait_for=wait_for, **options)
    thread = threading.Thread(target=run.work, args=(wanted,))
    thread.start()
    try:
        assert run.ready.wait(2.0 * WAIT_S), "the recorder did not become ready"
        yield run
    finally:
        run.stop.set()
        thread.join(2.0 * WAIT_S)
    assert not thread.is_alive(), "the recorder did not stop"
    if run.error is not None:
        raise run.error


def recorded(path: Path) -> list[BagMessage]:
    """Return the messages of a recording in order of log time."""
    with BagReader([path]) as reader:
        return list(reader.messages())


def recorded_data(path: Path, topic: str) -> list[bytes]:
    """Return the bytes of one topic's messages."""
    return [bytes(message.data) for message in recorded(path) if message.topic == topic]
