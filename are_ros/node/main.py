"""`ar_builder`, the process: a node, an executor, and an orderly end at any signal."""

import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions

from are_ros.errors import AreError
from are_ros.node.ar_builder_node import NAME, ArBuilderNode

_OK, _FAILED = 0, 1
_WAIT_S: Final = 0.1
_FLUSH_S: Final = 1.0
_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


class _Stopped(BaseException):
    """A signal came while there was nothing yet that could end in an orderly way."""


class _StopFlag:
    """Set by a signal; until `is_armed`, a signal ends what is going on at once."""

    def __init__(self) -> None:
        self.is_set = False
        self.is_armed = False

    def __call__(self, number: int, frame: Any) -> None:
        """Take a signal."""
        del number, frame
        self.is_set = True
        if not self.is_armed:
            raise _Stopped


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until a signal ends it; return the exit status, 1 if it could not run.

    On SIGINT and SIGTERM, at any moment, every marker is deleted and the last map is the real one.
    """
    stop = _StopFlag()
    with _signals_to(stop):
        context = Context()
        try:
            rclpy.init(
                args=None if arguments is None else list(arguments),
                context=context,
                signal_handler_options=SignalHandlerOptions.NO,
            )
            return _run(context, stop)
        except _Stopped:
            return _OK
        except AreError as cause:
            get_logger(NAME).fatal(str(cause))
            return _FAILED
        finally:
            stop.is_armed = True
            if context.ok():
                rclpy.shutdown(context=context)


def _run(context: Context, stop: _StopFlag) -> int:
    node = ArBuilderNode(context=context)
    try:
        executor = _executor(context)
        executor.add_node(node)
        is_running = _start(node)
        stop.is_armed = True
        while is_running and not stop.is_set and context.ok():
            executor.spin_once(timeout_sec=_WAIT_S)
        return _OK if is_running else _FAILED
    finally:
        stop.is_armed = True
        node.retire()
        node.flush(_FLUSH_S)
        node.destroy_node()


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


@contextmanager
def _signals_to(handler: _StopFlag) -> Iterator[None]:
    before = {number: signal.signal(number, handler) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)
