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
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

import pytest

from are_ros.node.startup import PROFILE, PROFILE_VARIABLE, has_room

Result = TypeVar("Result")
_WITHOUT_ROS = Path(sys.prefix, "without-ros")
NOT_SET_UP = (
    _WITHOUT_ROS.read_text(encoding="utf-8").strip()
    if _WITHOUT_ROS.is_file()
    else "rclpy and are_msgs are not set up: make test does it"
)
_DOMAINS = range(41, 102)
"""Up to 101 the ports are none that Linux gives away; the low numbers are left to people."""
_LEASE = """<builtin><discovery_config>
    <leaseDuration><sec>600</sec></leaseDuration>
    <leaseAnnouncement><sec>3</sec></leaseAnnouncement>
  </discovery_config></builtin>"""
"""It is 20 s otherwise: when a machine stalls for longer, participants take each other for dead,
and lose what is under way."""
_SMALL_PROFILE = """<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <participant profile_name="of_tests" is_default_profile="true"><rtps></rtps></participant>
</profiles>
"""

WAIT_S = 60.0
"""So long is waited for what must come. It costs nothing where it comes, and leaves DDS and a busy
machine the time for a second and a third try where it is late."""
_TICK_S, _LONGEST_S = 0.01, 0.1


class _RunningTime:
    """The monotonic clock without stalls, by a thread that wakes a hundred times a second.

    From one wake to the next at most `_LONGEST_S` counts: what is beyond is a stall.
    """

    def __init__(self) -> None:
        self._mark_s = time.monotonic(), time.monotonic()
        threading.Thread(target=self._run, daemon=True).start()

    def now_s(self) -> float:
        """Return the time."""
        counted_s, marked_s = self._mark_s
        return counted_s + min(time.monotonic() - marked_s, _LONGEST_S)

    def _run(self) -> None:
        while True:
            time.sleep(_TICK_S)
            self._mark_s = self.now_s(), time.monotonic()


@cache
def _running_time() -> _RunningTime:
    return _RunningTime()


def running_s() -> float:
    """Return a time [s] that stands still while the machine does.

    Test machines stall for many seconds, which says nothing of what is tested: whatever is to
    happen within a time is measured by this one. Where nothing stalls it is that of the wall.
    """
    return _running_time().now_s()


def stalled_s() -> float:
    """Return how long [s] the machine has stalled so far, from some beginning on."""
    return time.monotonic() - running_s()


def running_ns() -> int:
    """Return the same in nanoseconds."""
    return round(running_s() * 1e9)


def wait_until(
    is_done: Callable[[], Any], turn: Callable[[], None], timeout_s: float = WAIT_S
) -> None:
    """Turn until `is_done()`; the test fails when it is not within the running time."""
    end_s = running_s() + timeout_s
    while not is_done():
        if running_s() > end_s:
            pytest.fail(f"what was waited for did not happen within {timeout_s} s")
        turn()


def nap() -> None:
    """Let other threads and processes go on: what `wait_until` turns where they do the work."""
    time.sleep(0.005)


def undisturbed(measure: Callable[[], Result], most_s: float = 0.1, tries: int = 5) -> Result:
    """Return a result for which the machine stalled `most_s` or less; the last one if none is.

    For what goes by the clock of the wall, and makes up for a stall in a hurry.
    """
    while True:
        began_s = stalled_s()
        found = measure()
        tries -= 1
        if not tries or stalled_s() - began_s <= most_s:
            return found


def is_ros_available() -> bool:
    """Tell whether rclpy and the messages of ARE are installed."""
    return all(find_spec(package) is not None for package in ("rclpy", "are_msgs"))


def keep_ros_apart() -> None:
    """Set the environment: DDS on this machine only, a domain and log folder of the tests' own.

    And participants that survive a stall of the machine.

    To be called before anything imports rclpy. Processes that a test starts inherit it.
    """
    folder = Path(tempfile.gettempdir()) / f"are_ros_tests_{os.getuid()}"
    folder.mkdir(exist_ok=True)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(_claimed_domain(folder))
    os.environ["ROS_LOG_DIR"] = str(folder / "log")
    profile = folder / f"profile_{os.environ['ROS_DOMAIN_ID']}.xml"
    profile.write_text(_profile(), encoding="utf-8")
    os.environ[PROFILE_VARIABLE] = str(profile)


def _profile() -> str:
    """Return the profile that `are` has by itself, where it has one, with a longer lease."""
    text = PROFILE.read_text(encoding="utf-8") if has_room() else _SMALL_PROFILE
    return text.replace("<rtps>", f"<rtps>{_LEASE}")


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

    def spin_until(self, is_done: Callable[[], Any], timeout_s: float = WAIT_S) -> None:
        """Run callbacks until `is_done()`; the test fails when it is not within the time."""
        wait_until(is_done, self._turn, timeout_s)

    def spin_for(self, duration_s: float) -> None:
        """Run callbacks for a while."""
        end_s = running_s() + duration_s
        while running_s() < end_s:
            self._turn()

    def collect(self, node: Any, kind: type[Any], topic: str, qos: Any = 10) -> list[Any]:
        """Subscribe, and return the list to which messages are appended as they come."""
        messages: list[Any] = []
        node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def call(
        self,
        node: Any,
        kind: type[Any],
        service: str,
        request: Any = None,
        timeout_s: float = WAIT_S,
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
        """Destroy executor, nodes and context.

        A destroyed lifecycle node keeps its state machine, and with it a participant of DDS whose
        services nobody serves any more, until it is collected. pytest holds what fixtures return
        beyond the end of the test: the next one would find that participant, and see it vanish at
        some moment of its own. So nodes are emptied.
        """
        self.executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
            vars(node).clear()
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
