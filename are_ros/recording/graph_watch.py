"""Which topics are published, by whom, and what has changed since it was last asked."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rclpy.node import Node

from are_ros.recording._publisher_qos import offered_by
from are_ros.replay.offered_qos import OfferedQos

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
    type_hashes: tuple[str, ...]
    offered: tuple[OfferedQos, ...]
    publishers: tuple[bytes, ...]


class GraphWatch:
    """Asks a node about the topics that are selected."""

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
            tuple(sorted({str(info.topic_type_hash) for info in infos})),
            tuple(offered_by(info.qos_profile) for info in infos),
            tuple(bytes(info.endpoint_gid) for info in infos),
        )
