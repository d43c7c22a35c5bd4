"""Nodes in tests: a context, an executor and nodes of its own for each test, all cleaned up."""

import fcntl
import os
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

_WITHOUT_ROS = Path(sys.prefix, "without-ros")
NOT_SET_UP = (
    _WITHOUT_ROS.read_text(encoding="utf-8").strip()
    if _WITHOUT_ROS.is_file()
    else "rclpy and are_msgs are not set up: make test does it"
)
_DOMAINS = range(41, 102)
"""Up to 101 the ports are none that Linux gives away; the low numbers are left to people."""


def is_ros_available() -> bool:
    """Tell whether rclpy and the messages of ARE are installed."""
    return all(find_spec(package) is not None for package in ("rclpy", "are_msgs"))


def keep_ros_apart() -> None:
    """Set the environment: DDS on this machine only, a domain and log folder of the tests' own.

    To be called before anything imports rclpy. Processes that a test starts inherit it.
    """
    folder = Path(tempfile.gettempdir()) / f"are_ros_tests_{os.getuid()}"
    folder.mkdir(exist_ok=True)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(_claimed_domain(folder))
    os.environ["ROS_LOG_DIR"] = str(folder / "log")


def _claimed_domain(folder: Path) -> int:
    """Return a domain that no other test process has; it is ours until this process ends."""
    for step in range(len(_DOMAINS)):
        domain = _DOMAINS[(os.getpid() + step) % len(_DOMAINS)]
        lock = os.open(folder / f"domain_{domain}.lock", os.O_CREAT | os.O_RDWR, 0o666)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            continue
        return domain
    raise RuntimeError(f"all of the ROS domains {_DOMAINS} are taken by other tests")


class RosWorld:
    """Nodes in one process with an executor that turns only when told to.

    `spin_until` runs callbacks in the test's own thread; inside `with world.spinning():` a thread
    runs them. An exception of a callback fails the test in either case. `close` destroys all.
    """

    def __init__(self, *, use_events_executor: bool = False) -> None:
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.experimental.events_executor import EventsExecutor

        kind = EventsExecutor if use_events_executor else SingleThreadedExecutor
        self.context = Context()
        self.context.init(args=[])
        self.executor = kind(context=self.context)
        self._nodes: list[Any] = []
        self._is_spun_elsewhere = False

    def make_node(
        self,
        name: str = "tester",
        *,
        parameters: Mapping[str, Any] | None = None,
        arguments: Sequence[str] = (),
        kind: Callable[..., Any] | None = None,
        **options: Any,
    ) -> Any:
        """Return a new node that this world spins and destroys.

        `parameters` are overrides, `arguments` follow `--ros-args`, `kind` is the class (Node) or
        a function, which gets name, context, cli_args, parameter_overrides and the `options`.
        """
        from rclpy.node import Node
        from rclpy.parameter import Parameter

        overrides = [Parameter(path, value=value) for path, value in (parameters or {}).items()]
        node = (kind or Node)(
            name,
            context=self.context,
            cli_args=["--ros-args", *arguments],
            parameter_overrides=overrides,
            **options,
        )
        return self.add(node)

    def add(self, node: Any) -> Any:
        """Spin and in the end destroy a node that was made with this world's context."""
        self._nodes.append(node)
        self.executor.add_node(node)
        return node

    def spin_until(self, is_done: Callable[[], Any], timeout_s: float = 10.0) -> None:
        """Run callbacks until `is_done()`; the test fails when it is not within the time."""
        deadline_s = time.monotonic() + timeout_s
        while not is_done():
            if time.monotonic() > deadline_s:
                pytest.fail(f"what was waited for did not happen within {timeout_s} s")
            self._turn()

    def spin_for(self, duration_s: float) -> None:
        """Run callbacks for a while."""
        deadline_s = time.monotonic() + duration_s
        while time.monotonic() < deadline_s:
            self._turn()

    def collect(self, node: Any, kind: type[Any], topic: str, qos: Any = 10) -> list[Any]:
        """Subscribe, and return the list to which messages are appended as they come."""
        messages: list[Any] = []
        node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def call(
        self, node: Any, kind: type[Any], service: str, request: Any = None, timeout_s: float = 10.0
    ) -> Any:
        """Call a service from a node, and return the response."""
        client = node.create_client(kind, service)
        self.spin_until(client.service_is_ready, timeout_s)
        future = client.call_async(kind.Request() if request is None else request)
        self.spin_until(future.done, timeout_s)
        node.destroy_client(client)
        return future.result()

    @contextmanager
    def spinning(self) -> Iterator[None]:
        """Let a thread run the callbacks inside a `with` block."""
        stop, caught = threading.Event(), list[BaseException]()
        thread = threading.Thread(target=self._spin, args=(stop, caught), daemon=True)
        self._is_spun_elsewhere = True
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()
            self._is_spun_elsewhere = False
        if caught:
            raise caught[0]

    def close(self) -> None:
        """Destroy executor, nodes and context."""
        self.executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        self.context.shutdown()

    def _turn(self) -> None:
        if self._is_spun_elsewhere:
            time.sleep(0.002)
        else:
            self.executor.spin_once(timeout_sec=0.02)

    def _spin(self, stop: threading.Event, caught: list[BaseException]) -> None:
        try:
            while not stop.is_set():
                self.executor.spin_once(timeout_sec=0.05)
        except Exception as cause:  # noqa: BLE001 - raised again in the test's own thread
            caught.append(cause)


def import_rclpy_quietly() -> None:
    """Import what warns when it is imported for the first time, which no test can help.

    Where messages were built, rclpy finds the generator, whose parser (lark) uses `sre_parse`.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        if find_spec("rosidl_generator_py") is not None:
            import rosidl_generator_py  # noqa: F401
        import rclpy  # noqa: F401
