"""The part of a recording that is played, and the time it goes by."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from are_ros.conventions import NS_PER_S, seconds_to_ns
from are_ros.errors import BagError
from are_ros.recording.play_options import PlayOptions
from are_ros.replay.bag_clock import BagClock
from are_ros.replay.bag_reader import BagMessage, BagReader
from are_ros.replay.bag_times import MOVING_ROLES, RecordedTimes
from are_ros.replay.roles import find_roles
from are_ros.replay.timeline import stretches_of

_TF: Final = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_RECENT_NS: Final = 10 * NS_PER_S
"""Of what moves, so much from before the start is sent: as much as tf2 keeps."""


@dataclass(frozen=True, eq=False)
class PlayWindow:
    """The window of a recording that is played, and the time it goes by."""

    reader: BagReader
    clock: BagClock
    first_log_ns: int
    last_log_ns: int
    gaps_ns: int = 0

    @classmethod
    def of(cls, reader: BagReader, options: PlayOptions) -> "PlayWindow":
        """Return the window that the options ask for; BagError where it holds nothing."""
        first_ns = reader.start_ns + seconds_to_ns(options.start_s)
        last_ns = reader.end_ns
        if options.duration_s is not None:
            last_ns = min(last_ns, first_ns + seconds_to_ns(options.duration_s))
        if first_ns >= last_ns:
            length_s = (reader.end_ns - reader.start_ns) / NS_PER_S
            raise BagError(f"the recording is {length_s:.1f} s long: nothing is left to play")
        roles = find_roles(reader.topics, {})
        named = ((roles.topic(role), role) for role in MOVING_ROLES)
        role_of_topic = {topic: role for topic, role in named if topic is not None}
        times = RecordedTimes.read(reader, role_of_topic, first_ns, last_ns)
        clock = BagClock.of(times)
        gaps = stretches_of(times, clock, first_ns, last_ns, reader.files).gaps
        return cls(reader, clock, first_ns, last_ns, sum(gap.length_ns for gap in gaps))

    @property
    def start_ns(self) -> int:
        """The time at which it begins."""
        return self.clock.at(self.first_log_ns)

    @property
    def end_ns(self) -> int:
        """The time at which it ends."""
        return self.clock.at(self.last_log_ns)

    def messages(self, topics: tuple[str, ...]) -> Iterator[tuple[int, BagMessage]]:
        """Yield (time, message) of the window."""
        for message in self.reader.messages(topics, self.first_log_ns, self.last_log_ns):
            yield max(self.clock.at(message.log_time_ns), self.start_ns), message

    def earlier(self, topics: tuple[str, ...]) -> Iterator[BagMessage]:
        """Yield what was sent before the start, and counts as sent at it."""
        known = [topic for topic in self.reader.topics if topic.name in topics]
        latched = {topic.name for topic in known if topic.is_latched or "static" in topic.name}
        moving = {topic.name for topic in known if topic.type_name in _TF} - latched
        if self.first_log_ns == self.reader.start_ns or not latched | moving:
            return
        recent_ns = self.first_log_ns - _RECENT_NS
        for message in self.reader.messages(latched | moving, stop_ns=self.first_log_ns):
            if message.topic in latched or message.log_time_ns >= recent_ns:
                yield message
