"""A player that runs in a thread of its own, what it plays, and a node that notes what it hears."""

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from are_ros.bag.types import jazzy_typestore
from are_ros.bag.writer import BagWriter
from are_ros.conventions import NS_PER_S
from bags.simulation.making import RosbagsFactory
from tests.ros import WAIT_S, nap, running_s

START_NS = 1_700_000_000 * NS_PER_S + 3_000_000
"""Not on the grid of /clock."""
LISTENER = "/listener"
STRING = "std_msgs/msg/String"
UNKNOWN = "nowhere_msgs/msg/Thing"

Record = tuple[str, float, str]
"""Topic, seconds after `START_NS`, and text."""


class Heard(NamedTuple):
    """A message as a node heard it: topic, text, and what its clock said."""

    topic: str
    text: str
    clock_ns: int


class PlayerRun:
    """What a test sees of a player: what it said, how far it came, and its outcome."""

    def __init__(self) -> None:
        self.stop = threading.Event()
        self.sentences: list[str] = []
        self.windows_ns: list[tuple[int, int]] = []
        self.reached_ns: list[int] = []
        self.outcome: Any = None
        self.error: Exception | None = None
        self.ended = threading.Event()

    def work(self, options: Any) -> None:
        """Play, and keep what comes of it."""
        from are_ros.record.player import play

        try:
            self.outcome = play(options, self.sentences.append, self._open, self.stop.is_set)
        except Exception as error:  # noqa: BLE001 - raised again in the test's own thread
            self.error = error
        finally:
            self.ended.set()

    def _open(self, start_ns: int, end_ns: int) -> Any:
        self.windows_ns.append((start_ns, end_ns))
        return self._reach

    def _reach(self, now_ns: int) -> None:
        self.reached_ns.append(now_ns)  # to a list that a test may have put there meanwhile


@contextmanager
def playing(bag: Path, **options: Any) -> Iterator[PlayerRun]:
    """Play while the block runs; afterwards it is told to stop."""
    from are_ros.record.publishers import PlayOptions

    run = PlayerRun()
    thread = threading.Thread(target=run.work, args=(PlayOptions((bag,), **options),))
    thread.start()
    try:
        yield run
    finally:
        run.stop.set()
        thread.join(2.0 * WAIT_S)
    assert run.ended.is_set(), "the player did not stop"
    if run.error is not None:
        raise run.error


def played(bag: Path, **options: Any) -> PlayerRun:
    """Play to the end, and return what is seen of it."""
    with playing(bag, **options) as run:
        assert run.ended.wait(2.0 * WAIT_S), "the player did not come to its end"
    return run


def listen(
    world: Any, topics: Sequence[str], *, qos: Any = 100, name: str = "listener"
) -> list[Heard]:
    """Make a node that subscribes to strings, by /clock; what it hears is appended to the list."""
    from std_msgs.msg import String

    heard: list[Heard] = []
    node = world.make_node(name, parameters={"use_sim_time": True})

    def subscribe(topic: str) -> None:
        def note(message: Any) -> None:
            heard.append(Heard(topic, message.data, node.get_clock().now().nanoseconds))

        node.create_subscription(String, topic, note, qos)

    for topic in topics:
        subscribe(topic)
    return heard


def texts(heard: Sequence[Heard], topic: str) -> list[str]:
    """Return what was heard on a topic, in order."""
    return [one.text for one in heard if one.topic == topic]


def wait_for_text(heard: Sequence[Heard], text: str) -> None:
    """Wait until another thread has heard a text; the test fails after a while."""
    end_s = running_s() + WAIT_S
    while all(one.text != text for one in heard):
        assert running_s() < end_s, f"{text} was not heard"
        nap()


def write_strings(
    path: Path,
    records: Sequence[Record],
    *,
    latched: Sequence[str] = (),
    best_effort: Sequence[str] = (),
    unknown: Sequence[str] = (),
) -> Path:
    """Write strings as a recording of ROS 2; topics that are `unknown` have a type nobody has."""
    factory = RosbagsFactory()
    messages = [(topic, at_s, factory.make(STRING, data=text)) for topic, at_s, text in records]
    return write_messages(path, messages, latched=latched, best_effort=best_effort, unknown=unknown)


def write_messages(
    path: Path,
    records: Sequence[tuple[str, float, Any]],
    *,
    latched: Sequence[str] = (),
    best_effort: Sequence[str] = (),
    unknown: Sequence[str] = (),
) -> Path:
    """Write (topic, seconds after `START_NS`, message) as a recording of ROS 2."""
    store = jazzy_typestore()
    types = {topic: message.__msgtype__ for topic, _, message in records}
    types |= dict.fromkeys(unknown, UNKNOWN)
    if unknown:
        store = _with_unknown_type()
    with BagWriter(path, store) as writer:
        for topic, type_name in types.items():
            is_reliable = topic not in best_effort
            is_latched = topic in latched
            writer.add_topic(
                topic, type_name, is_latched=is_latched, is_reliable=is_reliable, depth=1
            )
        for topic, at_s, message in records:
            data = store.serialize_cdr(message, message.__msgtype__)
            writer.write_raw(topic, at_ns(at_s), data)
    return path


def at_ns(at_s: float) -> int:
    """Return the log time so many seconds after the start."""
    return START_NS + round(at_s * NS_PER_S)


def _with_unknown_type() -> Any:
    """Return the types of Jazzy and one that nothing on this machine has."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("string data\n", UNKNOWN))
    return store


def clock_values(start_ns: int, end_ns: int, period_ns: int) -> list[int]:
    """Return what /clock is to say: the start, multiples of the period, and the end."""
    first = (start_ns // period_ns + 1) * period_ns
    return [start_ns, *range(first, end_ns, period_ns), end_ns]


def collect_clock(world: Any, name: str = "watcher") -> list[int]:
    """Subscribe to /clock, reliably, and return the list to which its values are appended."""
    from rosgraph_msgs.msg import Clock

    values: list[int] = []

    def note(message: Any) -> None:
        values.append(message.clock.sec * NS_PER_S + message.clock.nanosec)

    world.make_node(name).create_subscription(Clock, "/clock", note, 1000)
    return values


def profile(**options: Any) -> Any:
    """Return a profile; `is_latched`, `is_reliable` and `depth` say which."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    chosen: Mapping[str, Any] = {"is_latched": False, "is_reliable": True, "depth": 10} | options
    reliability, durability = ReliabilityPolicy, DurabilityPolicy
    return QoSProfile(
        depth=chosen["depth"],
        reliability=reliability.RELIABLE if chosen["is_reliable"] else reliability.BEST_EFFORT,
        durability=durability.TRANSIENT_LOCAL if chosen["is_latched"] else durability.VOLATILE,
    )
