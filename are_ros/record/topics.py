"""The topics of a recording: selection, publishers, quality of service, subscriptions."""

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

from rclpy.node import Node
from rclpy.qos import QoSProfile

from are_ros.bag.clock import CLOCK_TOPIC
from are_ros.bag.roles import slashed
from are_ros.bag.types import InstalledTypes
from are_ros.bag.writer import OfferedQos, partial_path
from are_ros.errors import BagError, InputError, NodeError
from are_ros.node.message_classes import message_class
from are_ros.node.qos import profile_of
from are_ros.record.file import CLOCK_TYPE, FileWriter
from are_ros.record.inbox import Inbox
from are_ros.replay.progress import Say
from are_ros.wording import why_refused

# The options of a recording.


@dataclass(frozen=True)
class RecordOptions:
    """The options of `are record`.

    `path` is an .mcap file. `topics` (empty: all) and `exclude` are names, in which * and ? stand
    for anything; hidden topics (/_name) are recorded only where all of the name is given.
    `wait_for`: the recording is ready when these have a publisher. `duration_s` counts from then
    on, in simulated seconds if `use_sim_time`: log times are then /clock's. Existing files are
    kept unless `overwrite`.
    """

    path: Path
    topics: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    duration_s: float | None = None
    use_sim_time: bool = False
    wait_for: tuple[str, ...] = ()
    overwrite: bool = False

    def is_selected(self, topic: str) -> bool:
        """Return whether a topic, by its full name, is to be recorded."""
        if _matches(topic, self.exclude):
            return False
        if "/_" in topic:  # hidden
            return topic in map(slashed, self.topics)
        return not self.topics or _matches(topic, self.topics)

    def named_topics(self) -> tuple[str, ...]:
        """Return the full names of the topics that were asked for by name."""
        names = (slashed(name) for name in self.topics if not {"*", "?", "["} & set(name))
        return tuple(name for name in names if self.is_selected(name))

    def awaited_topics(self) -> frozenset[str]:
        """Return the full names of `wait_for`; BagError if one of them is not to be recorded."""
        names = frozenset(slashed(name) for name in self.wait_for)
        for name in sorted(names):
            if not self.is_selected(name):
                raise BagError(f"{name} is waited for, but it is not among the topics to record")
        return names

    def prepare_place(self) -> None:
        """Make the folder of the file; BagError if it cannot be, or something stands there."""
        if self.path.suffix != ".mcap":
            raise BagError(f"{self.path}: a recording is an .mcap file")
        if self.path.is_dir():
            raise BagError(f"{self.path} is a folder; choose another name")
        if not self.overwrite:
            self._refuse_existing()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as cause:
            message = f"{self.path.parent}: the folder cannot be made: {why_refused(cause)}"
            raise BagError(message) from cause

    def _refuse_existing(self) -> None:
        partial = partial_path(self.path)
        if partial.exists():
            raise BagError(
                f"{partial} is there: a recording that still runs, or was killed"
                " (`mcap recover` saves it); move it away, or choose another name or --overwrite"
            )
        if self.path.exists():
            raise BagError(f"{self.path} exists already; choose another name, or --overwrite")


def _matches(topic: str, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(topic, slashed(pattern)) for pattern in patterns)


# The quality of service to record with, from what the publishers of a topic offer.


_DEPTH, _BULKY_DEPTH = 1000, 100
"""Messages that may wait in the middleware; they are taken many times in a second."""

_BULKY: Final = (
    "nav_msgs/msg/OccupancyGrid",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/PointCloud2",
)
"""A thousand messages of these types would fill the memory."""


def offered_by(profile: QoSProfile) -> OfferedQos:
    """Return the QoS that a publisher offers, in the words of rosbag2."""
    return OfferedQos(
        reliability=profile.reliability.name.lower(),
        durability=profile.durability.name.lower(),
        history=profile.history.name.lower(),
        depth=profile.depth,
        deadline_ns=profile.deadline.nanoseconds,
        lifespan_ns=profile.lifespan.nanoseconds,
        liveliness=profile.liveliness.name.lower(),
        lease_ns=profile.liveliness_lease_duration.nanoseconds,
    )


def matching(offered: Sequence[OfferedQos], type_name: str) -> QoSProfile:
    """Return the QoS that all publishers can serve.

    It is reliable, or transient local, only if each of them is: a subscription that asks for more
    gets nothing from a publisher that offers less.
    """
    is_reliable = all(profile.reliability == "reliable" for profile in offered)
    is_latched = all(profile.durability == "transient_local" for profile in offered)
    return profile_of(is_reliable, is_latched, _BULKY_DEPTH if type_name in _BULKY else _DEPTH)


# The published topics, and their changes.


_RECHECK_S = 1.0
"""How often publishers are compared although their number is the same."""


@dataclass(frozen=True)
class PublishedTopic:
    """A topic with its publishers, at least one; ours do not count.

    `publishers` are their identifiers; the other tuples are without repetitions, but `offered` has
    a profile for each publisher.
    """

    name: str
    type_names: tuple[str, ...]
    offered: tuple[OfferedQos, ...]
    publishers: tuple[bytes, ...]


class TopicGraph:
    """The publishers of the selected topics, by the graph of a node."""

    def __init__(self, node: Node, is_selected: Callable[[str], bool]) -> None:
        self._node = node
        self._is_selected = is_selected
        self._known: dict[str, PublishedTopic] = {}
        self._counts: dict[str, int] = {}
        self._rechecked_s = 0.0

    def look(self) -> Iterator[tuple[PublishedTopic, bool]]:
        """Yield each published topic that is selected, and whether it is new or has changed."""
        is_recheck = time.monotonic() - self._rechecked_s > _RECHECK_S
        if is_recheck:
            self._rechecked_s = time.monotonic()
        for name, _ in self._node.get_topic_names_and_types():
            if self._is_selected(name):
                yield from self._look_at(name, is_recheck=is_recheck)

    def _look_at(self, name: str, *, is_recheck: bool) -> Iterator[tuple[PublishedTopic, bool]]:
        count = self._node.count_publishers(name)
        known = self._known.get(name)
        if count != self._counts.get(name) or is_recheck:
            self._counts[name] = count
            found = self._ask(name)
            if found is not None and found != known:
                self._known[name] = found
                yield found, True
                return
        if known is not None:
            yield known, False

    def _ask(self, name: str) -> PublishedTopic | None:
        node = self._node
        infos = [
            info
            for info in node.get_publishers_info_by_topic(name)
            if (info.node_name, info.node_namespace) != (node.get_name(), node.get_namespace())
        ]
        if not infos:
            return None
        infos.sort(key=lambda info: info.endpoint_gid)
        return PublishedTopic(
            name,
            tuple(sorted({info.topic_type for info in infos})),
            tuple(offered_by(info.qos_profile) for info in infos),
            tuple(bytes(info.endpoint_gid) for info in infos),
        )


_LONGEST_LOOK_S: Final = 0.02


class TopicFollower:
    """Subscribes to the selected topics, and announces them to the file.

    `skipped` are the topics that are not recorded, with the reason.
    """

    def __init__(
        self,
        node: Node,
        options: RecordOptions,
        types: InstalledTypes,
        inbox: Inbox,
        file: FileWriter,
        say: Say,
    ) -> None:
        self._options = options
        self._types = types
        self._inbox = inbox
        self._file = file
        self._say = say
        self._watch = TopicGraph(node, self._is_wanted)
        self._type_names: dict[str, str] = {}
        self._qos: dict[str, QoSProfile] = {}
        self._doubted: set[str] = set()
        self.skipped: dict[str, str] = {}

    def look(self) -> bool:
        """Look for new topics and publishers; return False if there is more to look at.

        Types take long to load, and messages must not wait. NodeError where /clock is needed but
        has another type.
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
        """Return whether all these topics are skipped or have a connected publisher."""
        return all(name in self.skipped or self._inbox.is_connected(name) for name in topics)

    def finish(self) -> None:
        """Look for the last time, and report topics asked for by name that never came."""
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
        """Subscribe, or change the subscription; the first type that was seen stays."""
        if topic.name not in self._type_names and self._is_our_clock(topic.name):
            _check_clock(topic)
        try:
            type_name = self._type_names.get(topic.name) or _only_type(topic)
            self._types.learn(type_name)
            kind = message_class(type_name)
        except (InputError, NodeError) as reason:
            self._skip(topic.name, str(reason))
            return
        self._say_doubts(topic, type_name)
        self._type_names[topic.name] = type_name
        if self._options.is_selected(topic.name):
            self._file.announce(topic.name, type_name, topic.offered)
        qos = matching(topic.offered, type_name)
        if qos != self._qos.get(topic.name):
            self._qos[topic.name] = qos
            self._inbox.subscribe(topic.name, kind, qos)

    def _say_doubts(self, topic: PublishedTopic, type_name: str) -> None:
        """Warn once where a publisher has another type."""
        if topic.name in self._doubted:
            return
        others = [name for name in topic.type_names if name != type_name]
        if others:
            self._doubted.add(topic.name)
            self._say(
                f"{topic.name} is also published as {others[0]}: only {type_name} is recorded"
            )


def _only_type(topic: PublishedTopic) -> str:
    if len(topic.type_names) > 1:
        raise InputError(f"it is published as {' and as '.join(topic.type_names)}")
    return topic.type_names[0]


def _check_clock(topic: PublishedTopic) -> None:
    """Raise NodeError if /clock has another type: messages would have no time."""
    if topic.type_names != (CLOCK_TYPE,):
        kinds = " and ".join(topic.type_names)
        raise NodeError(f"{CLOCK_TOPIC} is published as {kinds}: that gives no simulated time")
