"""What a recording of the live node holds, in a few lines."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from are_ros.builder.events import EventKind
from are_ros.conventions import OCCUPIED
from are_ros.messages.grid import read_grid
from are_ros.messages.times import read_time
from are_ros.replay.bag_reader import BagReader
from are_ros.world.occupancy_grid import OccupancyGrid

_PREFIX: Final = "/ar_builder/"
_TOPICS: Final = (
    *("artefacts", "perceived", "events", "scan", "markers"),
    *("augmented_map", "artefact_map"),
)


@dataclass
class _Tally:
    ticks: int = 0
    alive: list[int] = field(default_factory=list)
    labels: dict[int, str] = field(default_factory=dict)
    perceived: set[int] = field(default_factory=set)
    events: Counter[EventKind] = field(default_factory=Counter)
    messages: Counter[str] = field(default_factory=Counter)
    in_the_maps: dict[int, set[int]] = field(default_factory=dict)
    """Ids by tick: who stands where the last artefact map has an artefact."""
    in_sight: dict[int, set[int]] = field(default_factory=dict)
    _map: OccupancyGrid | None = None

    def take(self, name: str, message: Any) -> None:
        """Count one message of an output."""
        self.messages[name] += 1
        if name == "artefacts":
            self.ticks += 1
            self.alive.append(len(message.artefacts))
            self.labels.update({one.id: one.class_name for one in message.artefacts})
            shown = {one.id for one in message.artefacts if self._is_in_the_map(one)}
            self.in_the_maps[read_time(message.header.stamp)] = shown
        elif name == "artefact_map":
            self._map = read_grid(message)
        elif name == "perceived":
            seen = {one.id for one in message.artefacts}
            self.in_sight[read_time(message.header.stamp)] = seen
            self.perceived |= seen
        elif name == "events":
            self.events[EventKind(message.kind)] += 1

    def _is_in_the_map(self, artefact: Any) -> bool:
        if self._map is None:
            return False
        place = artefact.ground_pose.position
        cell = self._map.cell_at(place.x, place.y)
        return cell is not None and int(self._map.cells[cell]) == OCCUPIED


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
    shown = sum(map(len, tally.in_the_maps.values()))
    hidden = sum(len(ids - tally.in_sight.get(t, set())) for t, ids in tally.in_the_maps.items())
    ticks = max(tally.ticks, 1)
    yield (
        f"in the maps  {shown / ticks:.1f} on average, {hidden / ticks:.1f} of them out of sight "
        "(costmap.memory, costmap.gate)"
    )
    sent = tally.messages
    yield f"ticks        {tally.ticks}"
    yield (
        f"published    {sent['augmented_map']} augmented maps, {sent['scan']} augmented scans, "
        f"{sent['markers']} marker messages"
    )
