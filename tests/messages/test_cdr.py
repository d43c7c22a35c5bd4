"""Bytes of XCDR1, value by value."""

from struct import Struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.errors import InputError
from are_ros.messages.cdr import CdrWriter, encapsulated, pack_time

BYTE, DOUBLE = Struct("<B"), Struct("<d")


def test_a_message_begins_with_its_encapsulation() -> None:
    """Little-endian CDR without options, then the body, aligned from there."""
    writer = CdrWriter()
    writer.count(3)
    assert writer.message() == encapsulated(b"\3\0\0\0") == b"\0\1\0\0\3\0\0\0"


@given(phase=st.integers(0, 7), length=st.integers(0, 9))
def test_a_part_is_what_stands_in_the_whole(phase: int, length: int) -> None:
    """A part made for its phase is the bytes that a writer which came so far appends."""
    whole, part = CdrWriter(), CdrWriter(phase)
    for _ in range(8 + phase):
        whole.pack(BYTE, 1, 255)
    before = len(whole.message())
    for writer in (whole, part):
        writer.text("x" * length)
        writer.pack(DOUBLE, 8, 0.5)
        writer.pack(BYTE, 1, 7)
        writer.time(3)
    assert part.part() == whole.message()[before:]


def test_a_text_ends_with_nul() -> None:
    """Its length counts bytes, the end among them."""
    writer = CdrWriter()
    writer.text("")
    writer.text("ß")
    assert writer.part() == b"\1\0\0\0\0\0\0\0\3\0\0\0\xc3\x9f\0"


def test_a_nul_is_refused() -> None:
    """A text that CDR cannot carry is an error, not a damaged message."""
    with pytest.raises(InputError, match="NUL"):
        CdrWriter().text("a\0b")


def test_no_numbers_need_no_alignment() -> None:
    """An empty sequence is its length alone; another is padded to the size of its numbers."""
    empty, full = CdrWriter(), CdrWriter()
    empty.numbers(np.zeros((0, 3)), "<f8")
    full.numbers(np.array([[1.0, 2.0]]), "<f8")
    assert empty.part() == bytes(4)
    assert full.part() == b"\1\0\0\0\0\0\0\0" + np.array([1.0, 2.0], "<f8").tobytes()


@pytest.mark.parametrize(
    ("time_ns", "stamp"), [(0, (0, 0)), (1_500_000_000, (1, 500_000_000)), (-1, (-1, 999_999_999))]
)
def test_nanoseconds_are_never_negative(time_ns: int, stamp: tuple[int, int]) -> None:
    """Before the epoch the seconds are negative and the nanoseconds are not."""
    assert Struct("<iI").unpack(pack_time(time_ns)) == stamp
