"""The summary of a recording of the live node, in a few lines."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from are_ros.bag.decoded import (
    ARRIVED,
    DEPARTED,
    ROBOT_CONTACT,
    Event,
    Grid,
    Perceived,
    Scene,
)
from are_ros.bag.recording import PREFIX, Recording, find_recording
from are_ros.conventions import NS_PER_S, OCCUPIED
from are_ros.replay.recorded_scene import grid_of
from are_ros.wording import counted
from are_ros.world.occupancy_grid import OccupancyGrid

_COUNTED: Final = ("scan", "markers", "augmented_map")
_OUT_OF_STEP: Final = 2
_TOPICS: Final = ("artefacts", "perceived", "events", "artefact_map", *_COUNTED)


@dataclass
class _Tally:
    alive: list[int] = field(default_factory=list)
    """How many artefacts there were, tick by tick."""
    stamps_ns: list[int] = field(default_factory=list)
    labels: dict[int, str] = field(default_factory=dict)
    perceived: set[int] = field(default_factory=set)
    events: Counter[int] = field(default_factory=Counter)
    messages: Counter[str] = field(default_factory=Counter)
    in_the_maps: dict[int, set[int]] = field(default_factory=dict)
    """Ids by tick: the artefacts on occupied cells of the last artefact map."""
    in_sight: dict[int, set[int]] = field(default_factory=dict)
    _map: OccupancyGrid | None = None

    def take(self, name: str, value: Any) -> None:
        """Count one message of an output, by its value where that matters."""
        self.messages[name] += 1
        if isinstance(value, Scene):
            self.alive.append(len(value.ids))
            self.stamps_ns.append(value.stamp_ns)
            ids = value.ids.tolist()
            self.labels.update(zip(ids, value.classes, strict=True))
            places = zip(ids, value.ground_poses[:, :2].tolist(), strict=True)
            shown = {number for number, place in places if self._is_in_the_map(*place)}
            self.in_the_maps[value.stamp_ns] = shown
        elif isinstance(value, Grid):
            self._map = grid_of(value)
        elif isinstance(value, Perceived):
            self.in_sight[value.stamp_ns] = set(value.ids)
            self.perceived |= value.ids
        elif isinstance(value, Event):
            self.events[value.kind] += 1

    def _is_in_the_map(self, x_m: float, y_m: float) -> bool:
        if self._map is None:
            return False
        cell = self._map.cell_at(x_m, y_m)
        return cell is not None and int(self._map.cells[cell]) == OCCUPIED


def summary_of(path: Path) -> list[str]:
    """Return the lines; BagError where the file is no recording."""
    tally = _Tally()
    files = find_recording(path)
    with Recording(files) as recording:
        wanted = {PREFIX + name: name for name in _TOPICS}
        for message in recording.in_log_order(wanted):
            name = wanted[message.topic]
            tally.take(name, None if name in _COUNTED else recording.decode(message))
    return list(_lines(tally, files.effective().builder.tick_rate))


def _lines(tally: _Tally, rate_hz: float) -> Iterator[str]:
    events, alive = tally.events, tally.alive or [0]
    yield (
        f"artefacts    {events[ARRIVED]} arrived, {events[DEPARTED]} departed; "
        f"alive {sum(alive) / len(alive):.1f} on average, {max(alive)} at most"
    )
    perceived = tally.perceived & tally.labels.keys()  # false alarms have no label
    yield f"perceived    {len(perceived)} of {len(tally.labels)} at some time"
    yield f"robot        {counted(events[ROBOT_CONTACT], 'contact')} with artefacts"
    shown = sum(map(len, tally.in_the_maps.values()))
    hidden = sum(len(ids - tally.in_sight.get(t, set())) for t, ids in tally.in_the_maps.items())
    ticks = len(alive)
    yield (
        f"in the maps  {shown / ticks:.1f} on average, {hidden / ticks:.1f} of them out of sight "
        "(costmap.memory, costmap.gate)"
    )
    sent = tally.messages
    yield f"ticks        {_ticks(tally.stamps_ns, rate_hz)}"
    yield (
        f"published    {counted(sent['augmented_map'], 'augmented map')}, "
        f"{counted(sent['scan'], 'augmented scan')}, {counted(sent['markers'], 'marker message')}"
    )


def _ticks(stamps_ns: list[int], rate_hz: float) -> str:
    """Return how many ticks there were, and of how many if more than two of them lack.

    The first and the last may come out of step.
    """
    count = len(stamps_ns)
    due = 1 + round((stamps_ns[-1] - stamps_ns[0]) / NS_PER_S * rate_hz) if count else 0
    if count + _OUT_OF_STEP >= due:
        return str(count)
    return (
        f"{count} of {due}: the node did not keep up with the recording, so scans and contacts may "
        "be missing; a lower --rate, or --lockstep, gives it time"
    )
