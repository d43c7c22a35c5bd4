"""When a player sends what: at its time, or as another decides."""

import time
from collections.abc import Callable
from typing import Final, Protocol

from are_ros.conventions import NS_PER_S
from are_ros.replay.bag_reader import BagMessage

_ASK_S: Final = 0.05
_REST_S: Final = 0.5
_APART_S: Final = 0.001
"""So long between the messages from before the start: a reader's queue is short."""

ShouldStop = Callable[[], bool]


class Pace(Protocol):
    """What decides when the next thing is sent."""

    def begin(self, now_ns: int) -> None:
        """Begin a pass at this time of the recording."""

    def wait_until(self, now_ns: int) -> bool:
        """Wait for this time of the recording; False if it is to end before."""

    def wait_a_little(self) -> bool:
        """Wait between messages that count as sent at the same time; False as above."""

    def rest(self) -> None:
        """Let those who got the map of the start take it in."""

    def about_to_send(self, message: BagMessage) -> None:
        """Get ready for a message."""

    def sent(self, message: BagMessage) -> None:
        """Take note of a message."""

    def about_to_tell(self) -> None:
        """Get ready for the time to go on: everything earlier was sent."""

    def told(self) -> None:
        """Let what goes by the time follow."""

    def end(self) -> None:
        """Let what was sent last be taken."""


class Lifelike:
    """Sends each thing at its time, `rate` times as fast as it happened."""

    def __init__(self, rate: float, should_stop: ShouldStop) -> None:
        self.worst_s = 0.0
        self._rate = rate
        self._should_stop = should_stop
        self._asked_s = 0.0

    def begin(self, now_ns: int) -> None:
        """Begin a pass: now is this time of the recording."""
        self._zero_ns, self._zero_s = now_ns, time.monotonic()

    def wait_until(self, now_ns: int) -> bool:
        """Sleep until it is time; tell whether to go on."""
        due_s = self._zero_s + (now_ns - self._zero_ns) / NS_PER_S / self._rate
        while True:
            here_s = time.monotonic()
            if here_s - self._asked_s >= _ASK_S:
                self._asked_s = here_s
                if self._should_stop():
                    return False
            if here_s >= due_s:
                self.worst_s = max(self.worst_s, here_s - due_s)
                return True
            time.sleep(min(due_s - here_s, _ASK_S))

    def wait_a_little(self) -> bool:
        """Sleep for as long as a reader takes for a message; tell whether to go on."""
        time.sleep(_APART_S)
        return not self._should_stop()

    def rest(self) -> None:
        """Sleep for a moment: what comes while a map is taken in would count as come later."""
        time.sleep(_REST_S)

    def about_to_send(self, message: BagMessage) -> None:
        """Do nothing."""

    def sent(self, message: BagMessage) -> None:
        """Do nothing."""

    def about_to_tell(self) -> None:
        """Do nothing: time goes on by itself."""

    def told(self) -> None:
        """Do nothing."""

    def end(self) -> None:
        """Do nothing: the publishers stay for a moment."""
