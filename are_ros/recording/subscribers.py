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


def await_subscribers(
    node: Node,
    publishers: Mapping[str, Any],
    options: PlayOptions,
    should_stop: Callable[[], bool],
) -> bool:
    """Wait until the nodes of `options` listen, and all who are known to listen are connected.

    They are if for half a second nobody came; where one cannot be connected (it asks for more than
    was recorded), the wait ends after two. Returns whether to go on; NodeError if a node does not
    listen in time.
    """
    deadline_s = time.monotonic() + options.wait_s
    for name in options.wait_for:
        while not _is_listening(node, name, publishers):
            if time.monotonic() > deadline_s:
                message = f"{name} is waited for, but it listened to nothing within"
                raise NodeError(f"{message} {options.wait_s:g} s")
            if should_stop():
                return False
            time.sleep(_ASK_S)
    return _await_connections(node, publishers, bool(options.wait_for), should_stop)


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
