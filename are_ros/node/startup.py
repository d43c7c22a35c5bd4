"""The node's process: signals, shared memory for DDS, start, spin, and an orderly end.

Nothing here imports rclpy at the top: signals are handled before anything slow is imported.
"""

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Final

from are_ros.errors import AreError, NodeError, missing_packages

if TYPE_CHECKING:
    from rclpy.node import Node

    from are_ros.node.ar_builder_node import ArBuilderNode

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)
_WAIT_S: Final = 0.1
_FLUSH_S: Final = 2.0


class Stop:
    """A flag that signals set. They raise nothing: an exception would crash a compiled kernel."""

    def __init__(self) -> None:
        self.is_set = False
        self.at_first: Callable[[], object] = lambda: None
        """Called by the first signal."""

    def __call__(self, number: int, frame: Any) -> None:
        """Take a signal."""
        del number, frame
        if not self.is_set:
            self.is_set = True
            self.at_first()

    def should_stop(self) -> bool:
        """Return whether a signal was received."""
        return self.is_set


@contextmanager
def stop_on_signals(*, is_last: bool = True) -> Iterator[Stop]:
    """Yield a flag that SIGINT and SIGTERM set while the block runs; for the main thread.

    With `is_last` the process ends after the block: once a signal came, later ones are ignored.
    """
    stop = Stop()
    before = {number: signal.signal(number, stop) for number in _SIGNALS}
    try:
        yield stop
    finally:
        for number, previous in before.items():
            signal.signal(number, signal.SIG_IGN if is_last and stop.is_set else previous)


_PATIENCE_S: Final = 1.0
_NEXT_S: Final = 0.1


@contextmanager
def ending_hung_behaviours(stop: Stop) -> Iterator[None]:
    """End user-defined behaviours that have not returned a second after a signal.

    While the block runs, in the main thread. Their call raises a TimeoutError, so the artefact
    stands, and the node can end. Compiled code cannot be ended so.
    """
    from are_ros.agents.behaviours.calls import running_behaviour

    def end(number: int, frame: FrameType | None) -> None:
        del number
        if running_behaviour(frame):
            raise TimeoutError("it had not returned a second after the node was told to end")

    def start_timer() -> None:
        signal.setitimer(signal.ITIMER_REAL, _PATIENCE_S, _NEXT_S)

    before = signal.signal(signal.SIGALRM, end)
    stop.at_first = start_timer
    try:
        yield
    finally:
        stop.at_first = lambda: None
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


# How Fast DDS, the middleware of ROS 2 as it comes, carries the messages of a process.


PROFILE: Final = Path(__file__).parent / "data" / "fastdds.xml"
PROFILE_VARIABLE: Final = "FASTRTPS_DEFAULT_PROFILES_FILE"

_CHOICES: Final = (PROFILE_VARIABLE, "FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS")
_PROFILE_HERE: Final = Path("DEFAULT_FASTRTPS_PROFILES.xml")
_SHARED_MEMORY: Final = Path("/dev/shm")  # noqa: S108 - where Fast DDS has its segments
_ROOM_BYTES: Final = 48 << 20
"""For the segments of node, recorder and player, and as much again for others."""


def make_room() -> None:
    """Give Fast DDS a profile with larger shared-memory segments and faster repair of losses.

    Call it before rclpy starts. A profile that the user has chosen stays; where shared memory is
    short, the default of Fast DDS stays. Other middlewares ignore it.
    """
    is_chosen = any(os.environ.get(name) for name in _CHOICES) or _PROFILE_HERE.exists()
    if is_chosen or not has_room():
        return
    os.environ[PROFILE_VARIABLE] = str(PROFILE)


def has_room() -> bool:
    """Return whether shared memory has room for the segments of the profile."""
    try:
        free = os.statvfs(_SHARED_MEMORY)
    except OSError:
        return False
    return free.f_bavail * free.f_frsize >= _ROOM_BYTES


@contextmanager
def refusals_of_ros() -> Iterator[None]:
    """Turn an error of rclpy into a NodeError, without the line of its sources."""
    from rclpy.exceptions import ParameterException  # after the signals: rclpy takes long to import

    try:
        yield
    except (RuntimeError, ParameterException) as cause:
        reason = str(cause).partition(", at /")[0]
        if type(cause).__name__ == "UnknownROSArgsError":  # its text is a list
            reason = f"it does not know the arguments {reason}"
        raise NodeError(f"ROS does not start: {reason}") from cause


@contextmanager
def ros_context(arguments: Sequence[str] | None) -> Iterator[Any]:
    """Yield an rclpy context of its own, without signal handlers; NodeError if ROS refuses."""
    import rclpy
    from rclpy.context import Context
    from rclpy.signals import SignalHandlerOptions

    make_room()
    context = Context()
    try:
        words = None if arguments is None else list(arguments)
        with refusals_of_ros():
            rclpy.init(args=words, context=context, signal_handler_options=SignalHandlerOptions.NO)
        yield context
    finally:
        context.try_shutdown()


@contextmanager
def ros_session(name: str, *, has_services: bool = False) -> Iterator["Node"]:
    """Yield the ROS node of a command, which no executor spins; it is destroyed at the end.

    No signal and no other node ends its context. With `has_services` it has the parameter
    services, whose requests the caller answers.
    """
    from rclpy.node import Node
    from rclpy.parameter import Parameter

    with ros_context([]) as context:
        node = Node(
            name,
            context=context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=has_services,
            parameter_overrides=[Parameter("start_type_description_service", value=False)],
        )
        try:
            yield node
        finally:
            node.destroy_node()


@contextmanager
def executor_of(node: Any) -> Iterator[Any]:
    """Yield an executor with one thread that has the node; it is shut down before the context is.

    An executor that outlives its context may print a traceback when Python collects it.
    """
    from rclpy.executors import SingleThreadedExecutor

    executor = SingleThreadedExecutor(context=node.context)
    try:
        executor.add_node(node)
        yield executor
    finally:
        executor.shutdown()


# `ar_builder`, the program.

_NAME: Final = "ar_builder"


def main(arguments: Sequence[str] | None = None) -> int | str:
    """Run the node until a signal ends it; return the exit status, 1 if it could not run.

    Or a sentence for `sys.exit`, where a package is not installed.

    On SIGINT and SIGTERM, at any moment, every marker is deleted and the last map is the real one.
    """
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")  # a damaged picture is told in our sentence
    with stop_on_signals() as stop:
        try:
            return run(arguments, stop)
        except ModuleNotFoundError as cause:
            return f"{_NAME}: {missing_packages(cause)}"


def run(arguments: Sequence[str] | None, stop: Stop) -> int:
    """Run the node until `stop` is set; return the exit status, 1 if it could not run."""
    if stop.is_set:
        return 0
    try:
        from are_ros.node.ar_builder_node import ArBuilderNode

        with ros_context(arguments) as context, ending_hung_behaviours(stop):
            with refusals_of_ros():
                node = ArBuilderNode(context=context)
            return 0 if _spin(node, stop) else 1
    except AreError as cause:
        return fatal(_NAME, cause)


def fatal(name: str, cause: AreError) -> int:
    """Log the error that ended a process; return its exit status."""
    from rclpy.logging import get_logger

    get_logger(name).fatal(str(cause))
    return 1


def _spin(node: "ArBuilderNode", stop: Stop) -> bool:
    """Run the node until `stop`, then publish the real outputs; return whether it started."""
    node.is_wanted = lambda: not stop.is_set
    try:
        with _cheapest_executor_of(node) as executor:
            is_running = stop.is_set or node.starts_itself()
            while is_running and not stop.is_set and node.context.ok():
                executor.spin_once(timeout_sec=_WAIT_S)
    finally:
        node.retire()
        node.flush(_FLUSH_S)
        node.destroy_node()
    return is_running or stop.is_set


@contextmanager
def _cheapest_executor_of(node: Any) -> Iterator[Any]:
    """Yield EventsExecutor with the node where this rclpy has one, else that with one thread."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        with executor_of(node) as executor:
            yield executor
        return
    executor = EventsExecutor(context=node.context)
    executor.add_node(node)
    yield executor
