"""Fixtures of the simulation tests: one office, and one short recording of it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from bags.simulation.building import Building
from bags.simulation.making import RosbagsFactory
from bags.simulation.office import OFFICE_START, office_building, office_driver
from bags.simulation.robot import DriveLimits
from bags.simulation.simulator import Simulator
from bags.simulation.topics import record


@dataclass(eq=False)
class ListSink:
    """A `MessageSink` that keeps everything."""

    topics: dict[str, str] = field(default_factory=dict)
    latched: set[str] = field(default_factory=set)
    messages: list[tuple[str, int, Any]] = field(default_factory=list)

    def add_topic(
        self,
        topic: str,
        type_name: str,
        *,
        is_latched: bool = False,
        is_reliable: bool = True,  # noqa: ARG002 - a MessageSink
        depth: int = 10,  # noqa: ARG002 - a MessageSink
    ) -> None:
        """Keep the topic."""
        self.topics[topic] = type_name
        if is_latched:
            self.latched.add(topic)

    def write(self, topic: str, log_time_ns: int, message: Any) -> None:
        """Keep the message."""
        self.messages.append((topic, log_time_ns, message))

    def of(self, topic: str) -> list[tuple[int, Any]]:
        """Return the log times and messages of one topic."""
        return [(when_ns, message) for name, when_ns, message in self.messages if name == topic]


@pytest.fixture(scope="session")
def office() -> Building:
    """Return the sample office."""
    return office_building()


@pytest.fixture(scope="session")
def record_office(office: Building) -> Callable[[float, int], ListSink]:
    """Return a recorder of the tour's first seconds, from a start time on."""

    def run(duration_s: float, start_ns: int) -> ListSink:
        limits, sink = DriveLimits(), ListSink()
        simulator = Simulator(office, OFFICE_START, limits=limits, start_ns=start_ns)
        record(simulator, office_driver(limits), sink, RosbagsFactory(), duration_s)
        return sink

    return run
