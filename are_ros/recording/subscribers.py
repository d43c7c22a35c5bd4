"""Waiting for those who want to hear: so that the first messages are not lost."""

import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from rclpy.node import Node

from are_ros.errors import NodeError
from are_ros.recording.play_options import PlayOptions

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
    say: Callable[[str], None],
    should_stop: Callable[[], bool],
) -> bool:
    """Wait until the nodes of `options` listen, and all who are known to listen are connected.

    They are if for half a second nobody came; where one cannot be connected (it asks for more than
    was recorded), the wait ends after two. Returns whether to go on; NodeError if a node does not
    listen in time. `say` takes what is waited for, now and then.
    """
    patience = _Patience(options.wait_s, say)
    for name in options.wait_for:
        while not _is_listening(node, name, publishers):
            patience.wait_for(name)
            if should_stop():
                return False
            time.sleep(_ASK_S)
    return _await_connections(node, publishers, bool(options.wait_for), should_stop)


class _Patience:
    """Says what is waited for, now and then, until it has been too long."""

    def __init__(self, wait_s: float, say: Callable[[str], None]) -> None:
        self._wait_s, self._say = wait_s, say
        self._began_s = time.monotonic()
        self._say_after_s = _SILENT_S

    def wait_for(self, name: str) -> None:
        """Say that a node is waited for, if it is time to; NodeError where it has been too long."""
        passed_s = time.monotonic() - self._began_s
        if passed_s > self._wait_s:
            message = f"{name} is waited for, but it listened to nothing within"
            raise NodeError(f"{message} {self._wait_s:g} s: does it run, and by this name?")
        if passed_s >= self._say_after_s:
            if self._say_after_s <= _SILENT_S:
                self._say(
                    f"waiting for {name} to listen (the first time, ar_builder compiles its kernels"
                    " for a minute or two)"
                )
            else:
                given = f"it is given {self._wait_s:g} s"
                self._say(f"still waiting for {name} after {passed_s:.0f} s; {given}")
            self._say_after_s = passed_s + _SAY_EVERY_S


def _await_connections(
    node: Node,
    publishers: Mapping[str, Any],
    is_somebody_awaited: bool,
    should_stop: Callable[[], bool],
) -> bool:
    """Wait until nobody comes any more; tell whether to go on."""
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


def _is_listening(node: Node, name: str, publishers: Mapping[str, Any]) -> bool:
    """Tell whether a node subscribes to one of the topics."""
    space, _, short = name.strip("/").rpartition("/")
    return any(
        (info.node_name, info.node_namespace) == (short, f"/{space}")
        for topic in publishers
        if topic != "/clock"
        for info in node.get_subscriptions_info_by_topic(topic)
    )


def _are_connected(node: Node, publishers: Mapping[str, Any]) -> bool:
    return all(
        publisher.get_subscription_count() >= len(node.get_subscriptions_info_by_topic(topic))
        for topic, publisher in publishers.items()
    )
