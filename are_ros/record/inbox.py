"""Messages of the recorded topics, taken from the middleware in bulk, in order of arrival.

No callback is used. The executors of rclpy do not fit: EventsExecutor (7.1.6) fails on callbacks
that ask for the time of reception, and the other one takes several times as long for a message.
"""

import time
from collections import OrderedDict
from collections.abc import Iterator, Mapping
from operator import attrgetter
from typing import Any, Final, NamedTuple

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

# Lost messages of a topic, counted by gaps in the publisher's sequence numbers.


class LossCount:
    """Counts sequence gaps of one topic while it has one publisher.

    A gap counts only if the publishers are the same afterwards: messages of a new publisher arrive
    before it is discovered, with sequence numbers of its own.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._last: int | None = None
        self._unproven = 0
        self._is_alone = False

    def see(self, sequence: int) -> None:
        """Take the sequence number of a message, in order of arrival."""
        if self._is_alone:
            if self._last is not None and sequence > self._last + 1:
                self._unproven += sequence - self._last - 1
            self._last = sequence

    def settle(self, publishers: int, *, are_the_same: bool) -> None:
        """Take the number of publishers, and whether they are the same as at the last call."""
        if are_the_same:
            self.lost += self._unproven
        else:
            self._last = None
        self._unproven = 0
        self._is_alone = publishers == 1


class Stamped(NamedTuple):
    """A message on its way into a file: CDR bytes, and its log and publish times [ns].

    As it comes these are the wall clock's times of arrival and of sending.
    """

    topic: str
    log_time_ns: int
    publish_time_ns: int
    data: bytes


_MOST_AT_ONCE: Final = 250
"""Messages taken from one topic before the others have their turn."""

_REMEMBERED = 1000
"""The messages of a topic that are recognised; a publisher latches fewer."""

_OVERLAP_S = 1.0
"""How long an old subscription stays beside its successor, until publishers have found that."""


class Inbox:
    """Subscriptions of a node without an executor."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._topics: dict[str, _TopicInbox] = {}

    def subscribe(self, topic: str, message_class: type[Any], qos: QoSProfile) -> None:
        """Subscribe to a topic, or change its quality of service.

        No message is lost or doubled by the change: both subscriptions exist for a while.
        """
        if topic not in self._topics:
            self._topics[topic] = _TopicInbox(self._node, topic, message_class)
        self._topics[topic].subscribe(qos)

    def is_connected(self, topic: str) -> bool:
        """Return whether a publisher of the topic is connected."""
        return topic in self._topics and self._topics[topic].is_connected()

    def publishers_found(self, topic: str, count: int, *, are_the_same: bool) -> None:
        """Pass the number of publishers of a topic to its loss count."""
        if topic in self._topics:
            self._topics[topic].losses.settle(count, are_the_same=are_the_same)

    def take_all(self) -> list[Stamped]:
        """Return the messages since the last call, in order of arrival."""
        messages = [message for topic in self._topics.values() for message in topic.take()]
        messages.sort(key=attrgetter("log_time_ns"))
        return messages

    def missed(self) -> Mapping[str, int]:
        """Return the number of lost messages by topic, where it is known and not zero."""
        counts = {name: topic.losses.lost for name, topic in self._topics.items()}
        return {name: count for name, count in counts.items() if count}


class _TopicInbox:
    """One topic: the subscription in force, and until it is found also the one before."""

    def __init__(self, node: Node, topic: str, message_class: type[Any]) -> None:
        self._node = node
        self._topic = topic
        self._class = message_class
        self._subscriptions: list[Subscription] = []
        self._overlap_ends_s = 0.0
        self._seen: OrderedDict[tuple[int, int], None] = OrderedDict()
        self.losses = LossCount()

    def subscribe(self, qos: QoSProfile) -> None:
        subscription = self._node.create_subscription(
            self._class,
            self._topic,
            _never_called,
            qos,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        self._subscriptions.append(subscription)
        self._overlap_ends_s = time.monotonic() + _OVERLAP_S

    def is_connected(self) -> bool:
        return bool(self._subscriptions[-1].get_publisher_count() > 0)

    def take(self) -> Iterator[Stamped]:
        for subscription in self._subscriptions:
            yield from self._drain(subscription)
        if len(self._subscriptions) > 1 and time.monotonic() > self._overlap_ends_s:
            for old in self._subscriptions[:-1]:
                yield from self._drain(old)
                self._node.destroy_subscription(old)
            del self._subscriptions[:-1]

    def _drain(self, subscription: Subscription) -> Iterator[Stamped]:
        take = subscription.handle.take_message
        for _ in range(_MOST_AT_ONCE):
            taken = take(self._class, True)
            if taken is None:
                return
            data, info = taken
            sequence = info["publication_sequence_number"]
            published_ns = info["source_timestamp"]
            if sequence is None or self._is_new(published_ns, sequence):
                received_ns = info["received_timestamp"] or time.time_ns()
                yield Stamped(self._topic, received_ns, published_ns, data)

    def _is_new(self, published_ns: int, sequence: int) -> bool:
        """Return whether a message was not taken before, by this or another subscription."""
        key = (published_ns, sequence)
        if key in self._seen:
            return False
        self._seen[key] = None
        if len(self._seen) > _REMEMBERED:
            self._seen.popitem(last=False)
        self.losses.see(sequence)
        return True


def _never_called(message: bytes) -> None:
    """Fail: rclpy requires a callback, and only an executor would call it."""
    raise NotImplementedError(f"{len(message)} bytes were called back: nothing may spin this node")
