"""What a recording of the live node holds, in a few lines."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from are_ros.builder.events import EventKind
from are_ros.replay.bag_reader import BagReader

_PREFIX: Final = "/ar_builder/"
_TOPICS: Final = ("artefacts", "perceived", "events", "scan", "markers", "augmented_map")


@dataclass
class _Tally:
    ticks: int = 0
    alive: list[int] = field(default_factory=list)
    labels: dict[int, str] = field(default_factory=dict)
    perceived: set[int] = field(default_factory=set)
    events: Counter[EventKind] = field(default_factory=Counter)
    messages: Counter[str] = field(default_factory=Counter)

    def take(self, name: str, message: Any) -> None:
        """Count one message of an output."""
        self.messages[name] += 1
        if name == "artefacts":
            self.ticks += 1
            self.alive.append(len(message.artefacts))
            self.labels.update({one.id: one.class_name for one in message.artefacts})
        elif name == "perceived":
            self.perceived.update(one.id for one in message.artefacts)
        elif name == "events":
            self.events[EventKind(message.kind)] += 1


def summary_of(path: Path) -> list[str]:
    """Return the lines; BagError where the file is no recording."""
    tally = _Tally()
    with BagReader([path]) as reader:
        wanted = {_PREFIX + name: name for name in _TOPICS}
        for message in reader.messages(tuple(wanted)):
            tally.take(wanted[message.topic], reader.deserialize(message))
    return list(_lines(tally))


def _lines(tally: _Tally) -> Iterator[str]:
    events, alive = tally.events, tally.alive or [0]
    yield (
        f"artefacts    {events[EventKind.ARRIVED]} arrived, {events[EventKind.DEPARTED]} departed; "
        f"alive {sum(alive) / len(alive):.1f} on average, {max(alive)} at most"
    )
    yield f"perceived    {len(tally.perceived)} of {len(tally.labels)} at some time"
    contacts = events[EventKind.ROBOT_CONTACT]
    yield f"robot        {contacts} {'contact' if contacts == 1 else 'contacts'} with artefacts"
    sent = tally.messages
    yield f"ticks        {tally.ticks}"
    yield (
        f"published    {sent['augmented_map']} augmented maps, {sent['scan']} augmented scans, "
        f"{sent['markers']} marker messages"
    )
