"""The node and a recorder as processes, fed with the sample, and the replay of the same time."""

import fcntl
import os
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from are_ros.agents.events import EventKind
from are_ros.bag.reader import BagReader
from are_ros.builder.tick import Demand
from are_ros.conventions import NS_PER_S
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import EFFECTIVE_TOPIC, read_ros_parameters
from are_ros.replay.output_folder import AUGMENTED
from are_ros.replay.session import run_replay
from are_ros.replay.timeline import ReplayOptions
from tests.ros import undisturbed

SAMPLE = Path(__file__).resolve().parents[2] / "bags" / "sample_office.mcap"
PREFIX = "/ar_builder/"
MANY = (
    *("--set", "population.arrival_rate:=0.03", "--set", "population.mean_life:=5"),
    *("--set", "collisions.on_robot_contact:=displace", "--seed", "10"),
)
"""Many short lives, so that seconds hold all that can happen to them."""
_SAID = "said.txt"
_LONGEST_S = 600.0
"""It ends by itself before that, with a sentence, whatever it waits for in vain."""
_STALLED_S = 1.0
_ALIGNMENT = 4


class Sent(NamedTuple):
    """A recorded message: its bytes, and the message that they mean."""

    data: bytes
    message: Any


class Event(NamedTuple):
    """What happened to which artefact, and when."""

    kind: EventKind
    identifier: int
    stamp_ns: int


class Fate(NamedTuple):
    """Who an artefact is, and when it comes and goes."""

    row: int
    arrival_ns: int
    departure_ns: int


_LIVE_ALONE = (f"{PREFIX}transition_event", f"{PREFIX}{EFFECTIVE_TOPIC}")
"""Outputs that a replay does not have."""


def run_are(*words: object) -> "subprocess.CompletedProcess[str]":
    """Run `are` as a process of its own, which has the DDS of this test process."""
    command = [sys.executable, "-m", "are_ros", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=_LONGEST_S, check=False)


def run_demo(folder: Path, *words: object, bag: Path = SAMPLE) -> None:
    """Run `are demo` into a folder, and keep what it said beside the results.

    Three processes keep time with each other by the clock of the wall, and give each other a second
    or two for some things: where the machine stalls meanwhile they are run again, twice at most.
    """
    command = ("demo", bag, *MANY, *words, "--out", folder)
    done = undisturbed(lambda: run_are(*command), _STALLED_S, tries=3)
    assert done.returncode == 0, done.stderr
    (folder / _SAID).write_text(done.stderr, encoding="utf-8")


def said_by(folder: Path) -> str:
    """Return what the demo said whose results are in a folder."""
    return (folder / _SAID).read_text(encoding="utf-8")


def replay_of(live: Path, folder: Path, duration_s: float | None) -> None:
    """Replay what was played live, in this process, by the parameters that the node had."""
    parameters = with_values(Parameters(), read_ros_parameters(live / "effective.yaml"))
    demand = Demand(octomap=True)  # as the recorder, who listens to everything
    options = ReplayOptions(
        *((SAMPLE,), parameters, folder),
        duration_s=duration_s,
        demand=demand,
        is_wait_given=True,
    )
    run_replay(options, lambda _: None, lambda *_: lambda _: None)


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """Return a folder of results, which the first of the test processes that asks makes."""
    is_alone = "PYTEST_XDIST_WORKER" not in os.environ
    base = factory.getbasetemp() if is_alone else factory.getbasetemp().parent
    folder, done = base / name, base / f"{name}.done"
    with (base / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not done.exists():
            make(folder)
            done.touch()
    return folder


@cache
def outputs_of(folder: Path) -> dict[str, list[Sent]]:
    """Return the messages of each output, in their order."""
    found: dict[str, list[Sent]] = defaultdict(list)
    with BagReader([folder / AUGMENTED]) as reader:
        for one in reader.messages([topic.name for topic in reader.topics]):
            if one.topic.startswith(PREFIX) and one.topic not in _LIVE_ALONE:
                sent = Sent(bytes(one.data), reader.deserialize(one))
                found[one.topic.removeprefix(PREFIX)].append(sent)
    return dict(found)


def topics_of(folder: Path) -> dict[str, int]:
    """Return how many messages of each topic were recorded."""
    with BagReader([folder / AUGMENTED]) as reader:
        return {topic.name: topic.count for topic in reader.topics}


def on_the_wire(data: bytes) -> bytes:
    """Return a message as RTPS carries it: with zeros up to a multiple of four bytes."""
    return data + bytes(-len(data) % _ALIGNMENT)


def stamp_ns_of(message: Any) -> int:
    """Return the stamp of an output; of markers that of the first."""
    stamped = message.markers[0] if hasattr(message, "markers") else message
    return time_ns(stamped.header.stamp)


def time_ns(stamp: Any) -> int:
    """Return a ROS time in nanoseconds."""
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)


def events_of(outputs: Mapping[str, list[Sent]]) -> list[Event]:
    """Return the events in their order."""
    messages = [sent.message for sent in outputs["events"]]
    return [Event(EventKind(one.kind), int(one.id), time_ns(one.header.stamp)) for one in messages]


def fates_of(outputs: Mapping[str, list[Sent]]) -> dict[int, Fate]:
    """Return what became of each artefact, by its id."""
    return {
        int(one.id): Fate(int(one.row), time_ns(one.arrival), time_ns(one.departure))
        for sent in outputs["artefacts"]
        for one in sent.message.artefacts
    }
