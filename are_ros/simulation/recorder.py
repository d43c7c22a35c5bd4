"""Records a simulated drive, as `ros2 bag record` would on the robot."""

import heapq
from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np

from are_ros.messages.factory import MessageFactory
from are_ros.simulation.route import Driver
from are_ros.simulation.simulator import STEPS_PER_S, Simulator
from are_ros.simulation.topics import MAX_LATENCY_NS, ROBOT_TOPICS, RobotSpeech, TimedMessage


class MessageSink(Protocol):
    """What a recording goes into; the replay's `BagWriter` is one."""

    def add_topic(
        self,
        topic: str,
        type_name: str,
        *,
        is_latched: bool = False,
        is_reliable: bool = True,
        depth: int = 10,
    ) -> None:
        """Announce a topic and its quality of service."""

    def write(self, topic: str, log_time_ns: int, message: Any) -> None:
        """Append a message that the sink's own factory made."""


def record(
    simulator: Simulator,
    driver: Driver,
    sink: MessageSink,
    factory: MessageFactory,
    duration_s: float,
    seed: int = 0,
) -> None:
    """Drive for [0, duration_s) and write all messages stamped in it, in order of arrival."""
    for topic in ROBOT_TOPICS:
        sink.add_topic(
            topic.name,
            topic.type_name,
            is_latched=topic.is_latched,
            is_reliable=topic.is_reliable,
            depth=topic.depth,
        )
    speech = RobotSpeech(simulator, factory, np.random.default_rng(seed))
    spoken = _spoken(simulator, driver, speech, round(duration_s * STEPS_PER_S))
    for message in _in_order(spoken):
        sink.write(message.topic, message.arrival_ns, message.message)


def _spoken(
    simulator: Simulator, driver: Driver, speech: RobotSpeech, steps: int
) -> Iterator[TimedMessage]:
    """Yield all messages in order of their stamps."""
    yield from speech.latched()
    for _ in range(steps):
        yield from speech.due()
        simulator.step(driver.command(simulator.state))


def _in_order(messages: Iterator[TimedMessage]) -> Iterator[TimedMessage]:
    """Sort by arrival messages that arrive out of order by at most the longest latency."""
    waiting: list[tuple[int, int, TimedMessage]] = []
    for number, message in enumerate(messages):
        heapq.heappush(waiting, (message.arrival_ns, number, message))
        while waiting[0][0] <= message.arrival_ns - MAX_LATENCY_NS:
            yield heapq.heappop(waiting)[2]
    while waiting:
        yield heapq.heappop(waiting)[2]
