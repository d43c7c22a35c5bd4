"""The publishers of a player: recorded topics, /clock, and the wait for subscribers."""

import math
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final

from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from are_ros.bag.clock import CLOCK_TOPIC
from are_ros.bag.reader import CDR, BagMessage, BagReader, BagTopic, encoding_of, not_cdr
from are_ros.bag.roles import TF_TYPES, slashed
from are_ros.bag.types import ros2_type
from are_ros.conventions import NS_PER_S
from are_ros.errors import AreError, BagError, NodeError
from are_ros.node.message_classes import message_class
from are_ros.node.qos import profile_of
from are_ros.replay.progress import Say
from are_ros.wording import counted, listed

# The options of the player.


@dataclass(frozen=True)
class PlayOptions:
    """The options of `are play`; BagError for one that makes no sense.

    `topics` (empty: all) and `exclude` are names as recorded, `remaps` gives others. `clock_hz` of
    0: no /clock. `lockstep` names the nodes to keep in step with, `wait_for` those
    to wait for, for at most `wait_s`: long enough for kernels to be compiled on a busy machine.
    """

    bags: tuple[Path, ...]
    rate: float = 1.0
    loop: bool = False
    start_s: float = 0.0
    duration_s: float | None = None
    topics: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    remaps: Mapping[str, str] = field(default_factory=dict)
    clock_hz: float = 100.0
    lockstep: tuple[str, ...] = ()
    wait_for: tuple[str, ...] = ()
    wait_s: float = 600.0

    def __post_init__(self) -> None:
        if not 0.0 < self.rate < math.inf:
            raise BagError(f"--rate {self.rate}: it is not a number above 0")
        if not 0.0 <= self.clock_hz <= 1000.0:
            raise BagError(f"--clock {self.clock_hz}: it is not a rate from 0 to 1000 Hz")
        if self.lockstep and not self.clock_hz:
            raise BagError("--lockstep needs /clock: leave --clock 0 out")

    def check_topics(self, recorded: Collection[str]) -> None:
        """Raise BagError where an option names a topic that was not recorded."""
        known = set(map(slashed, recorded))
        named = {"--topics": self.topics, "--exclude": self.exclude, "--remap": self.remaps}
        for option, topics in named.items():
            for topic in topics:
                if slashed(topic) not in known:
                    there = ", ".join(sorted(known))
                    raise BagError(f"{option} {topic}: not in the recording, which has {there}")

    def is_chosen(self, topic: str) -> bool:
        """Return whether a recorded topic is to be played."""
        chosen = not self.topics or slashed(topic) in map(slashed, self.topics)
        return chosen and slashed(topic) not in map(slashed, self.exclude)

    def target(self, topic: str) -> str:
        """Return the name under which a recorded topic is played."""
        remaps = {slashed(source): target for source, target in self.remaps.items()}
        return slashed(remaps.get(slashed(topic), topic))


LARGE_BYTES: Final = 60_000
"""More does not fit into one packet, and packets may be lost on the way and be sent again."""
_DEPTH: Final = 100
_ADDING_TYPES: Final = (*TF_TYPES, "rcl_interfaces/msg/Log")
"""A message of these adds to those before it; any other latched one takes their place."""
OWN_CLOCK: Final = "the player tells the time itself"
"""Why a recorded /clock is not played."""


class PlayedTopics:
    """Publishes recorded messages; topics that cannot be published are skipped, with a reason.

    Quality of service is as recorded, but the topics `lasting` are latched, reliably, which serves
    whoever asks for less, too; in lockstep all publishers are reliable.
    """

    def __init__(
        self,
        node: Node,
        reader: BagReader,
        options: PlayOptions,
        lasting: Collection[str],
        say: Say,
    ) -> None:
        self.skipped: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        self._left_out: Counter[str] = Counter()
        self._reader = reader
        self._topics: dict[str, BagTopic] = {}
        self.publishers: dict[str, Any] = {}
        """By the recorded names of the topics that are played."""
        self._unacknowledged: set[str] = set()
        for recorded in reader.topics:
            if recorded.count and options.is_chosen(recorded.name):
                topic = recorded
                if topic.name in lasting:  # reliably, too: by best effort who is late gets nothing
                    topic = replace(recorded, is_latched=True, is_reliable=True)
                self._open(node, topic, options, say)

    def publish(self, message: BagMessage) -> None:
        """Send a message; one of ROS 1 that cannot be understood is counted as skipped.

        A topic that was recorded with two types is played with the first.
        """
        topic, recorded = message.topic, self._topics[message.topic]
        kind = message.connection.msgtype, encoding_of(message.connection)
        if kind != (recorded.type_name, recorded.encoding):
            return
        if self._reader.is_ros1:
            try:
                data = self._reader.as_ros2(message)
            except AreError as cause:
                self.skipped.setdefault(topic, str(cause).removeprefix(f"{topic}: "))
                self._left_out[topic] += 1
                return
        else:
            data = bytes(message.data)
        self.publishers[topic].publish(data)
        self.counts[topic] += 1
        if recorded.is_latched and len(data) > LARGE_BYTES:
            self._unacknowledged.add(topic)

    def left_out(self) -> list[str]:
        """Return a sentence for each topic of which messages could not be converted."""
        return [
            f"{topic}: {counted(count, 'message')} left out, the first: {self.skipped[topic]}"
            for topic, count in sorted(self._left_out.items())
        ]

    def target(self, topic: str) -> str:
        """Return the name under which a recorded topic is played."""
        return str(self.publishers[topic].topic_name)

    def wait_for_latched(self, timeout_s: float) -> bool:
        """Wait until reliable subscribers have the large latched messages; False without any.

        Maps and clouds have many fragments; a lost one is sent again with the next heartbeat of
        DDS, seconds later.
        """
        limit = Duration(seconds=timeout_s)
        waiting, self._unacknowledged = self._unacknowledged, set()
        for topic in waiting:
            self.publishers[topic].wait_for_all_acked(limit)
        return bool(waiting)

    def _open(self, node: Node, topic: BagTopic, options: PlayOptions, say: Say) -> None:
        try:
            self.publishers[topic.name] = self._publisher(node, topic, options)
        except NodeError as cause:
            self.skipped[topic.name] = str(cause)
            say(f"{topic.name} is not played: {cause}")
            return
        self._topics[topic.name] = topic
        self.counts[topic.name] = 0

    def _publisher(self, node: Node, topic: BagTopic, options: PlayOptions) -> Any:
        """Return a new publisher; NodeError, with the reason, where there can be none."""
        type_name = ros2_type(topic.type_name)
        target = options.target(topic.name)
        if CLOCK_TOPIC in (topic.name, slashed(target)) and options.clock_hz:
            raise NodeError(OWN_CLOCK)
        if topic.encoding != CDR:
            raise NodeError(f"its messages are {not_cdr(topic.encoding)}")
        if topic.name in self._topics:
            played = ros2_type(self._topics[topic.name].type_name)
            raise NodeError(f"as {type_name}, since it is played as {played}")
        try:
            return node.create_publisher(message_class(type_name), target, _qos(topic, options))
        except InvalidTopicNameException as cause:
            message = f"{target} is no name of a topic in ROS 2; --remap gives it another"
            raise NodeError(message) from cause
        except RuntimeError as cause:  # RCLError
            message = f"{target} cannot be published as {type_name}; is it of another type here?"
            raise NodeError(message) from cause


def _qos(topic: BagTopic, options: PlayOptions) -> QoSProfile:
    is_reliable = topic.is_reliable or bool(options.lockstep)
    is_last_enough = topic.is_latched and topic.type_name not in _ADDING_TYPES
    is_each_awaited = bool(options.lockstep) and "static" not in topic.name
    depth = 1 if is_last_enough or is_each_awaited else _DEPTH
    return profile_of(is_reliable, topic.is_latched, depth)


# /clock: the time of the recording while it is played.


class ClockPublisher:
    """Publishes /clock, reliably, or not at all."""

    def __init__(self, node: Node, clock_hz: float) -> None:
        self._period_ns = round(NS_PER_S / clock_hz) if clock_hz else 0
        self.publishers: dict[str, Any] = {}
        if clock_hz:
            self.publishers[CLOCK_TOPIC] = node.create_publisher(Clock, CLOCK_TOPIC, 10)

    def times_after(self, start_ns: int, end_ns: int) -> Iterator[int]:
        """Yield the multiples of the period after the start, and last the end."""
        if not self._period_ns:
            return
        yield from range(
            (start_ns // self._period_ns + 1) * self._period_ns, end_ns, self._period_ns
        )
        yield end_ns

    def publish(self, now_ns: int) -> None:
        """Publish the time."""
        for publisher in self.publishers.values():
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(now_ns, NS_PER_S)
            publisher.publish(message)


# Waiting for subscribers, so that the first messages are not lost.


_GRACE_S: Final = 2.0
_SHORT_GRACE_S: Final = 1.0
_SETTLE_S: Final = 0.5
"""Publisher and subscriber do not find each other at the same instant, and recorders look for
topics a few times a second."""
_ASK_S: Final = 0.05
_SILENT_S: Final = 3.0
_SAY_EVERY_S: Final = 30.0


def await_subscribers(
    node: Node,
    publishers: Mapping[str, Any],
    options: PlayOptions,
    say: Say,
    should_stop: Callable[[], bool],
) -> bool:
    """Wait until the nodes of `options` subscribe, and all known subscribers are connected.

    The wait ends when no subscriber came for half a second, or after two seconds if one cannot be
    connected (it asks for more than was recorded). Returns False if the player is to stop.
    NodeError if a node does not subscribe in time. `say` gets a sentence now and then.
    """
    began_s, report_after_s = time.monotonic(), _SILENT_S
    for name in options.wait_for:
        while not is_listening(node, name, publishers.keys() - {CLOCK_TOPIC}):
            passed_s = time.monotonic() - began_s
            if passed_s > options.wait_s:
                message = f"{name} is waited for, but it listened to nothing within"
                raise NodeError(f"{message} {options.wait_s:g} s: does it run, and by this name?")
            if passed_s >= report_after_s:
                is_first = report_after_s <= _SILENT_S
                names = node.get_fully_qualified_node_names()
                others = sorted({*names} - {node.get_fully_qualified_name()})
                say(_waiting(name, others, passed_s, options.wait_s, is_first=is_first))
                report_after_s = passed_s + _SAY_EVERY_S
            if should_stop():
                return False
            time.sleep(_ASK_S)
    return _await_connections(node, publishers, bool(options.wait_for), should_stop)


def _waiting(
    name: str, others: Sequence[str], passed_s: float, wait_s: float, *, is_first: bool
) -> str:
    """Say which node is waited for, and which `others` there are if it is not among them."""
    if is_first:
        said = f"waiting for {name} to listen"
    else:
        said = f"still waiting for {name} after {passed_s:.0f} s; it is given {wait_s:g} s"
    wanted = f"/{name.strip('/')}"
    if wanted not in others:
        near = get_close_matches(wanted, others, n=1)
        there_are = "there are" if len(others) > 1 else "there is only"
        known = f"{there_are} {listed(others)}" if others else "there is no other node, either"
        hint = f"did you mean {near[0]}?" if near else known
        return f"{said}: no node has this name yet; {hint}"
    return f"{said} (the first time, ar_builder compiles its kernels for a minute or two)"


def _await_connections(
    node: Node,
    publishers: Mapping[str, Any],
    is_somebody_awaited: bool,
    should_stop: Callable[[], bool],
) -> bool:
    """Wait until no more subscribers come; return whether to go on."""
    deadline_s = time.monotonic() + (_GRACE_S if is_somebody_awaited else _SHORT_GRACE_S)
    connected, since_s = -1, time.monotonic()
    while time.monotonic() < deadline_s:
        if should_stop():
            return False
        count = sum(publisher.get_subscription_count() for publisher in publishers.values())
        if count != connected or not _are_connected(node, publishers):
            connected, since_s = count, time.monotonic()
        if is_somebody_awaited and time.monotonic() - since_s > _SETTLE_S:
            return True
        time.sleep(_ASK_S)
    return True


def is_listening(node: Node, name: str, topics: Iterable[str]) -> bool:
    """Return whether a node subscribes to one of the topics."""
    space, _, short = name.strip("/").rpartition("/")
    return any(
        (info.node_name, info.node_namespace) == (short, f"/{space}")
        for topic in topics
        for info in node.get_subscriptions_info_by_topic(topic)
    )


def _are_connected(node: Node, publishers: Mapping[str, Any]) -> bool:
    return all(
        publisher.get_subscription_count() >= len(node.get_subscriptions_info_by_topic(topic))
        for topic, publisher in publishers.items()
    )
