"""A live message on its way into a file: as it was received, and as it is written."""

from typing import NamedTuple


class Received(NamedTuple):
    """A message as it came: CDR bytes, and the wall clock's times [ns] of arrival and sending."""

    topic: str
    received_ns: int
    published_ns: int
    data: bytes


class Stamped(NamedTuple):
    """A message as it goes into the file: CDR bytes, and its log and publish times [ns]."""

    topic: str
    log_time_ns: int
    publish_time_ns: int
    data: bytes
