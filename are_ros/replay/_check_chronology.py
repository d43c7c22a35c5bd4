"""Live recordings: which loop of the clock a message belongs to, and the tick that came before it.

Log times are of the recorder's clock: late, coarse, perhaps another clock than that of the stamps,
and where a looping recording was played, they stand still or go back. The ticks, by their stamps
and in the order of the file, tell the time instead.
"""

from bisect import bisect_right
from dataclasses import dataclass, field
from struct import Struct
from struct import error as StructError  # noqa: N812
from typing import Final, NamedTuple

from are_ros.conventions import NS_PER_S

_STAMPS: Final = (Struct(">iI"), Struct("<iI"))
_LISTS: Final = ("visualization_msgs/msg/MarkerArray", "tf2_msgs/msg/TFMessage")
_JUMP_NS: Final = NS_PER_S
"""Ticks that go back by more than this are those of a clock that jumped."""

_NEIGHBOURS: Final = 500
"""Messages so near to the jump may belong to the other side, if their stamps say so."""


class Moment(NamedTuple):
    """The loop of the clock, counted from 0, and the last tick before, in its time."""

    loop: int
    tick_ns: int


def stamp_of(type_name: str, data: bytes) -> int | None:
    """Return the stamp of a message whose type begins with a header, or with a list of such."""
    offset = 8 if type_name in _LISTS else 4
    try:
        seconds, nanoseconds = _STAMPS[data[1] & 1].unpack_from(data, offset)
    except (StructError, IndexError):
        return None
    return int(seconds) * NS_PER_S + int(nanoseconds)


@dataclass
class Chronology:
    """The ticks of a recording by the places of their messages in it."""

    _places: list[int] = field(default_factory=list)
    _stamps_ns: list[int] = field(default_factory=list)
    _starts: list[int] = field(default_factory=lambda: [0])
    """Where in these lists each loop begins."""

    @property
    def loops(self) -> int:
        """How many loops there are, at least one."""
        return len(self._starts)

    def add_tick(self, place: int, stamp_ns: int) -> None:
        """Take a tick; places ascend."""
        if self._stamps_ns and stamp_ns < self._stamps_ns[-1] - _JUMP_NS:
            self._starts.append(len(self._places))
        self._places.append(place)
        self._stamps_ns.append(stamp_ns)

    def moment(self, place: int, stamp_ns: int | None) -> Moment:
        """Return when a message at a place of the file came; near a jump its stamp decides."""
        if not self._places:
            return Moment(0, stamp_ns or 0)
        index = max(bisect_right(self._places, place) - 1, 0)
        here = bisect_right(self._starts, index) - 1
        choices = [Moment(here, self._stamps_ns[index])]
        if stamp_ns is not None:
            choices += self._beyond(here, place)
        return min(choices, key=lambda moment: abs(moment.tick_ns - (stamp_ns or 0)))

    def _beyond(self, loop: int, place: int) -> list[Moment]:
        """Return the ends of the neighbouring loops, where they are near."""
        found = []
        first = self._starts[loop]
        if loop and place - self._places[first] < _NEIGHBOURS:
            found.append(Moment(loop - 1, self._stamps_ns[first - 1]))
        if loop + 1 < len(self._starts):
            after = self._starts[loop + 1]
            if self._places[after] - place < _NEIGHBOURS:
                found.append(Moment(loop + 1, self._stamps_ns[after]))
        return found
