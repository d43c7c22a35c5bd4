"""The augmented map, its updates and the costmap, each against the real map and the artefacts."""

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from are_ros.conventions import NS_PER_S, OCCUPIED
from are_ros.parameters.model import Parameters
from are_ros.replay._check_admission import AdmittedTick, admitted_by_tick
from are_ros.replay._check_cells import RealMap
from are_ros.replay._check_costmap import Inflation
from are_ros.replay._check_currency import Currency
from are_ros.replay._check_file import PREFIX
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Tally, at_s, skipped
from are_ros.replay._check_scene import time_ns

Message = tuple[str, int, Any]

_NAMES: Final = (
    "augmented map",
    "augmented map is current",
    "map updates",
    "costmap is never lower than the real map's",
    "costmap",
    "costmap is current",
)


def check_grids(record: Record, messages: Iterator[Message]) -> list[CheckResult]:
    """Follow the grids tick by tick; `messages` are theirs, in order of log time."""
    if record.parameters is None or not record.maps:
        reason = "there is no effective.yaml, which says what the grids show"
        if record.parameters is not None:
            reason = "the recording holds no real map, and no map file was given"
        for _ in messages:  # they are still to be deserialised
            pass
        return [skipped(name, reason) for name in _NAMES]
    checks = _GridChecks(record.parameters)
    pending = _Pending(messages)
    for tick in admitted_by_tick(record, record.parameters.costmap):
        checks.stray(pending.until(tick.scene.log_ns - 1))
        checks.take(tick, pending.until(tick.scene.log_ns))
    checks.stray(pending.until(None))
    return checks.results()


class _Pending:
    """A stream of messages, taken up to a time."""

    def __init__(self, messages: Iterator[Message]) -> None:
        self._messages = messages
        self._next = next(messages, None)

    def until(self, log_ns: int | None) -> list[Message]:
        """Return the messages logged up to then; all that are left for None."""
        taken: list[Message] = []
        while self._next is not None and (log_ns is None or self._next[1] <= log_ns):
            taken.append(self._next)
            self._next = next(self._messages, None)
        return taken


class _GridChecks:
    """The six checks of the grids, with what was published last."""

    def __init__(self, parameters: Parameters) -> None:
        tallies = [Tally(name, "ticks" if "current" in name else "messages") for name in _NAMES]
        self._tallies = tallies
        self._map, map_age, self._updates, self._floor, self._costmap, costmap_age = tallies
        self._parameters = parameters
        interval_ns = -int(-NS_PER_S // parameters.augmented_map.max_rate)
        threshold = parameters.world.occupied_threshold
        self._ages = {
            PREFIX + "augmented_map": Currency(map_age, interval_ns, OCCUPIED),
            PREFIX + "augmented_costmap": Currency(costmap_age, interval_ns, threshold),
        }
        self._last_cells: NDArray[np.int8] | None = None
        self._last_real: RealMap | None = None
        self._inflation: Inflation | None = None

    def take(self, tick: AdmittedTick, messages: list[Message]) -> None:
        """Judge what a tick published, and whether it ought to have published."""
        by_topic = {topic: message for topic, _, message in messages}
        if tick.real is None:
            self.stray(messages)
            return
        for name, judge in (
            ("augmented_map", self._judge_map),
            ("augmented_costmap", self._judge_costs),
        ):
            message = by_topic.get(PREFIX + name)
            if message is not None:
                judge(tick, tick.real, message)
            self._ages[PREFIX + name].take(tick, tick.real, is_published=message is not None)
        self._follow_updates(
            tick,
            by_topic.get(PREFIX + "augmented_map"),
            by_topic.get(PREFIX + "augmented_map_updates"),
        )

    def stray(self, messages: list[Message]) -> None:
        """Count messages that belong to no tick with a map."""
        for topic, log_ns, _ in messages:
            tally = self._costmap if topic.endswith("costmap") else self._map
            tally.look()
            tally.fail(f"{topic} {at_s(log_ns)} belongs to no tick that knows a map")

    def results(self) -> list[CheckResult]:
        """Return the outcomes."""
        return [tally.result() for tally in self._tallies]

    def _judge_map(self, tick: AdmittedTick, real: RealMap, message: Any) -> None:
        where = at_s(tick.scene.stamp_ns)
        grid = _grid_of(self._map, tick, real, message)
        if grid is None:
            return
        expected, found = real.cells.flatten(), grid.cells.reshape(-1)
        for cover in tick.covers:
            expected[cover.sure] = OCCUPIED
            expected[cover.touched[found[cover.touched] == OCCUPIED]] = OCCUPIED
        if not np.array_equal(expected, found):
            text = _first_difference(expected.reshape(grid.cells.shape), grid.cells)
            self._map.fail(f"{where} {text}")

    def _judge_costs(self, tick: AdmittedTick, real: RealMap, message: Any) -> None:
        where = at_s(tick.scene.stamp_ns)
        grid = _grid_of(self._costmap, tick, real, message)
        if grid is None:
            return
        if self._inflation is None or self._inflation.real is not real:
            self._inflation = Inflation(real, self._parameters)
        self._floor.look()
        floor = self._inflation.static_low
        if (grid.cells < floor).any():
            text = _first_difference(np.maximum(grid.cells, floor), grid.cells)
            self._floor.fail(f"{where} {text}")
        low, high = self._inflation.bounds(tick.covers)
        within = np.clip(grid.cells, low, high)
        if not np.array_equal(within, grid.cells):
            self._costmap.fail(f"{where} {_first_difference(within, grid.cells)}")

    def _follow_updates(self, tick: AdmittedTick, grid: Any, update: Any) -> None:
        """Apply the update to the map before: that is the next map."""
        where = at_s(tick.scene.stamp_ns)
        cells = None
        if grid is not None:
            cells = np.asarray(grid.data, np.int8).reshape(grid.info.height, grid.info.width)
        last, last_real = self._last_cells, self._last_real
        if cells is not None:
            self._last_cells, self._last_real = cells, tick.real
        if update is None:
            if cells is not None and last is not None and last_real is tick.real:
                same = np.array_equal(last, cells)
                self._updates.require(same, f"{where} the map changed without an update")
            return
        self._updates.look()
        if cells is None or last is None or last.shape != cells.shape:
            self._updates.fail(f"{where} an update comes without a map before and after it")
            return
        applied = _updated(last, update)
        if applied is None:
            self._updates.fail(f"{where} an update reaches beyond the map")
        elif not np.array_equal(applied, cells):
            text = _first_difference(cells, applied)
            self._updates.fail(f"{where} the map before with the update: {text}")


def _grid_of(tally: Tally, tick: AdmittedTick, real: RealMap, message: Any) -> RealMap | None:
    """Return a published grid, None where it has not the real map's geometry or another stamp."""
    tally.look()
    where = at_s(tick.scene.stamp_ns)
    tally.require(
        time_ns(message.header.stamp) == tick.scene.stamp_ns, f"{where} it has another stamp"
    )
    try:
        grid = RealMap.of_message(message, tick.scene.log_ns)
    except ValueError:
        tally.fail(f"{where} its data do not fit its size")
        return None
    if not grid.has_geometry_of(real):
        tally.fail(f"{where} its geometry is not that of the real map")
        return None
    return grid


def _updated(cells: NDArray[np.int8], update: Any) -> NDArray[np.int8] | None:
    """Return cells with an OccupancyGridUpdate applied, None if it does not fit."""
    height, width = cells.shape
    data = np.asarray(update.data, np.int8)
    fits = 0 <= update.x <= width - update.width and 0 <= update.y <= height - update.height
    if not fits or data.size != update.width * update.height:
        return None
    applied: NDArray[np.int8] = cells.copy()
    rows, cols = slice(update.y, update.y + update.height), slice(update.x, update.x + update.width)
    applied[rows, cols] = data.reshape(update.height, update.width)
    return applied


def _first_difference(wanted: NDArray[np.int8], found: NDArray[np.int8]) -> str:
    """Return the first cell where two grids differ, and how many do."""
    cells = np.argwhere(wanted != found)
    row, col = (int(index) for index in cells[0])
    values = f"is {found[row, col]}, it must be {wanted[row, col]}"
    return f"cell ({row}, {col}) {values}; {len(cells)} such cells"
