"""Waiting for those who want to hear: so that the first messages are not lost."""

import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from rclpy.node import Node

from are_ros.errors import NodeError
from are_ros.recording.play_options import PlayOptions

_GRACE_S: Final = 1.0
_SETTLE_S: Final = 0.2
"""Publisher and subscriber do not find each other at the same instant."""
_ASK_S: Final = 0.05


def await_subscribers(
    node: Node,
    publishers: Mapping[str, Any],
    options: PlayOptions,
    should_stop: Callable[[], bool],
) -> bool:
    """Wait until `options.wait_for` listens, and all who are known to listen are connected.

    Where one cannot be connected (it asks for more than was recorded), the wait ends after a
    second. Returns whether to go on; NodeError if the node does not listen in time.
    """
    deadline_s = time.monotonic() + options.wait_s
    while options.wait_for and not _is_listening(node, options.wait_for, publishers):
        if time.monotonic() > deadline_s:
            message = f"--wait-for {options.wait_for}: it listened to nothing within"
            raise NodeError(f"{message} {options.wait_s:g} s")
        if should_stop():
            return False
        time.sleep(_ASK_S)
    deadline_s = time.monotonic() + _GRACE_S
    begun_s = time.monotonic()
    while time.monotonic() < deadline_s:
        is_settled = time.monotonic() - begun_s > _SETTLE_S
        if should_stop():
            return False
        if is_settled and options.wait_for and _are_connected(node, publishers):
            break
        time.sleep(_ASK_S)
    time.sleep(_SETTLE_S)
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
