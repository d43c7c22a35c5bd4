"""The node's process: a context, a node, an executor, and an orderly end."""

from collections.abc import Sequence
from typing import Any, Final

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions

from are_ros.errors import AreError
from are_ros.node.ar_builder_node import NAME, ArBuilderNode
from are_ros.node.startup import Stop, make_room, refusals_of_ros

_OK, _FAILED = 0, 1
_WAIT_S: Final = 0.1
_FLUSH_S: Final = 2.0


def run(arguments: Sequence[str] | None, stop: Stop) -> int:
    """Run the node until `stop` is set; return the exit status, 1 if it could not run."""
    make_room()
    context = Context()
    try:
        with refusals_of_ros():
            rclpy.init(
                args=None if arguments is None else list(arguments),
                context=context,
                signal_handler_options=SignalHandlerOptions.NO,
            )
            node = ArBuilderNode(context=context)
        return _live(node, stop)
    except AreError as cause:
        get_logger(NAME).fatal(str(cause))
        return _FAILED
    finally:
        if context.ok():
            rclpy.shutdown(context=context)


def _live(node: ArBuilderNode, stop: Stop) -> int:
    """Let the node live until it is to stop; the outputs that it leaves behind are real."""
    node.is_wanted = lambda: not stop.is_set
    try:
        executor = _executor(node.context)
        executor.add_node(node)
        is_running = stop.is_set or _start(node)
        while is_running and not stop.is_set and node.context.ok():
            executor.spin_once(timeout_sec=_WAIT_S)
    finally:
        node.retire()
        node.flush(_FLUSH_S)
        node.destroy_node()
    return _OK if is_running or stop.is_set else _FAILED


def _start(node: ArBuilderNode) -> bool:
    """Configure and activate the node, if it is to do so itself; tell whether that was possible."""
    if not node.bridge.node_values.autostart:
        return True
    done = TransitionCallbackReturn.SUCCESS
    return bool(node.trigger_configure() == done and node.trigger_activate() == done)


def _executor(context: Context) -> Any:
    """Return the executor that costs least: that of events where this rclpy has one."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)
