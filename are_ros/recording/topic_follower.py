"""Follows the topics of a recording as they appear and as their publishers change."""

import time
from collections.abc import Callable, Collection
from typing import Final

from rclpy.node import Node
from rclpy.qos import QoSProfile

from are_ros.errors import InputError, NodeError
from are_ros.recording._publisher_qos import matching
from are_ros.recording._topic_types import TopicTypes
from are_ros.recording.file_writer import Announcement, FileWriter
from are_ros.recording.graph_watch import GraphWatch, PublishedTopic
from are_ros.recording.inbox import Inbox
from are_ros.recording.log_clock import CLOCK_TOPIC, CLOCK_TYPE
from are_ros.recording.record_options import RecordOptions

_LONGEST_LOOK_S: Final = 0.02


class TopicFollower:
    """Subscribes to what is to be recorded, announces it to the file, says what cannot be.

    `skipped` are the topics that are not recorded, with the reason.
    """

    def __init__(
        self,
        node: Node,
        options: RecordOptions,
        types: TopicTypes,
        inbox: Inbox,
        file: FileWriter,
        say: Callable[[str], None],
    ) -> None:
        self._options = options
        self._types = types
        self._inbox = inbox
        self._file = file
        self._say = say
        self._watch = GraphWatch(node, self._is_wanted)
        self._type_names: dict[str, str] = {}
        self._qos: dict[str, QoSProfile] = {}
        self._doubted: set[str] = set()
        self.skipped: dict[str, str] = {}

    def look(self) -> bool:
        """Ask who publishes what; return False if some of it was left for the next time.

        Types take long to load, and messages must not wait. NodeError where /clock is needed and
        is no clock.
        """
        until_s = time.monotonic() + _LONGEST_LOOK_S
        for topic, has_changed in self._watch.look():
            if topic.name not in self.skipped:
                self._inbox.publishers_found(
                    topic.name, len(topic.publishers), are_the_same=not has_changed
                )
                if has_changed:
                    self._follow(topic)
                    if time.monotonic() > until_s:
                        return False
        return True

    def are_connected(self, topics: Collection[str]) -> bool:
        """Tell whether publishers of all these topics send to us; a skipped one is not awaited."""
        return all(name in self.skipped or self._inbox.is_connected(name) for name in topics)

    def finish(self) -> None:
        """Look for the last time, and say what was asked for and never seen."""
        self.look()
        for name in self._options.named_topics():
            if name not in self.skipped and name not in self._type_names:
                self._skip(name, "nobody published it")

    def _skip(self, name: str, reason: str) -> None:
        self.skipped[name] = reason
        self._say(f"{name} is not recorded: {reason}")

    def _is_wanted(self, name: str) -> bool:
        return self._is_our_clock(name) or self._options.is_selected(name)

    def _is_our_clock(self, name: str) -> bool:
        return self._options.use_sim_time and name == CLOCK_TOPIC

    def _follow(self, topic: PublishedTopic) -> None:
        """Subscribe, or change the subscription; the type stays what it was when first seen."""
        if topic.name not in self._type_names and self._is_our_clock(topic.name):
            _check_clock(topic)
        try:
            type_name = self._type_names.get(topic.name) or _only_type(topic)
            message_class = self._types.class_of(type_name)
        except (InputError, NodeError) as reason:
            self._skip(topic.name, str(reason))
            return
        self._say_doubts(topic, type_name)
        self._type_names[topic.name] = type_name
        if self._options.is_selected(topic.name):
            self._file.announce(topic.name, Announcement(type_name, topic.offered))
        qos = matching(topic.offered, type_name)
        if qos != self._qos.get(topic.name):
            self._qos[topic.name] = qos
            self._inbox.subscribe(topic.name, message_class, qos)

    def _say_doubts(self, topic: PublishedTopic, type_name: str) -> None:
        """Say once where a publisher means another type, or another definition of it."""
        if topic.name in self._doubted:
            return
        others = [name for name in topic.type_names if name != type_name]
        if others:
            self._say(
                f"{topic.name} is also published as {others[0]}: only {type_name} is recorded"
            )
        elif all(self._types.is_as_published(type_name, text) for text in topic.type_hashes):
            return
        else:
            self._say(
                f"{topic.name}: a publisher's {type_name} is not the one that is installed here and"
                " stands in the recording; readers may misunderstand its messages"
            )
        self._doubted.add(topic.name)


def _only_type(topic: PublishedTopic) -> str:
    if len(topic.type_names) > 1:
        raise InputError(f"it is published as {' and as '.join(topic.type_names)}")
    return topic.type_names[0]


def _check_clock(topic: PublishedTopic) -> None:
    """Raise what ends the recording: without a clock no message has its time."""
    if topic.type_names != (CLOCK_TYPE,):
        kinds = " and ".join(topic.type_names)
        raise NodeError(f"{CLOCK_TOPIC} is published as {kinds}: that gives no simulated time")
