"""The grids of a live recording: each that a tick gave out, and what a late subscriber has.

Grids are latched with a depth of one, so a recorder may miss one that the next followed at once;
while the node is not active, or takes its leave, the real map is given out as it is.
"""

from collections.abc import Iterable, Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.oracle_solids import Cover, RealMap, are_same
from are_ros.conventions import NS_PER_S
from are_ros.parameters.model import Parameters
from are_ros.replay._check_admission import AdmittedTick, admitted_by_tick
from are_ros.replay._check_grid_judges import (
    UPDATES_OF,
    GridJudge,
    GridTallies,
    first_difference,
    updated,
)
from are_ros.replay._check_grids import Message, Pending, skipped_grids
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Tally, at_s
from are_ros.replay._check_scene import time_ns

_GRACE_NS: Final = NS_PER_S
"""For so long, beyond the interval of publication, a recorder may have missed the last grid."""


def check_live_grids(
    loops: Iterable[tuple[Record, Iterator[Message]]],
) -> list[CheckResult]:
    """Follow the grids through the loops of a recording; the messages are in the ticks' time."""
    checks: _LiveGrids | None = None
    results: list[CheckResult] = []
    for record, messages in loops:
        if record.parameters is None or not record.maps:
            results = skipped_grids(record)
            continue
        checks = checks or _LiveGrids(record.parameters)
        checks.follow(record, record.parameters, Pending(messages))
    return checks.results() if checks else results


class _Held:
    """The grid of one topic that a late subscriber would get, and since when it is wrong."""

    def __init__(self, topic: str, tally: Tally, judge: GridJudge) -> None:
        self._topic = topic
        self._tally = tally
        self._judge = judge
        self._wrong_ns: int | None = None
        self._last: tuple[RealMap, RealMap, list[Cover], bool] | None = None
        self.grid: RealMap | None = None

    def take(self, tick: AdmittedTick, real: RealMap, patience_ns: int) -> None:
        """Fail once it has shown other artefacts than those of the ticks for too long."""
        if self.grid is None or not tick.is_sure:
            self._wrong_ns = None
            self._tally.leave_out("tick", "for which it is open what was, or ought to be, shown")
            return
        self._tally.look()
        now_ns = tick.scene.stamp_ns
        if self._is_right(self.grid, real, tick.covers):
            self._wrong_ns = None
            return
        self._wrong_ns = now_ns if self._wrong_ns is None else self._wrong_ns
        if now_ns - self._wrong_ns >= patience_ns:
            text = f"the last one has not shown the artefacts since {at_s(self._wrong_ns)[3:]}"
            self._tally.fail(f"{at_s(now_ns)} {text}")

    def _is_right(self, grid: RealMap, real: RealMap, covers: list[Cover]) -> bool:
        if self._last is not None:
            last_grid, last_real, last_covers, is_right = self._last
            if last_grid is grid and last_real is real and are_same(last_covers, covers):
                return is_right
        is_right = self._judge.shows(self._topic, grid, real, covers)
        self._last = (grid, real, covers, is_right)
        return is_right


class _LiveGrids:
    """The checks of the grids."""

    def __init__(self, parameters: Parameters) -> None:
        self._tallies = GridTallies()
        self._judge = GridJudge(parameters, self._tallies)
        self._held = {
            topic: _Held(topic, tally, self._judge) for topic, tally in self._tallies.ages.items()
        }
        interval_ns = -int(-NS_PER_S // parameters.augmented_map.max_rate)
        self._patience_ns = interval_ns + _GRACE_NS
        self._chains: dict[str, NDArray[np.int8] | None] = dict.fromkeys(UPDATES_OF)
        """The maps as their updates have made them, None where one may be missing."""

    def follow(self, record: Record, parameters: Parameters, pending: Pending) -> None:
        """Follow one loop of the clock."""
        is_first = True
        for tick in admitted_by_tick(record, parameters.costmap):
            self._take_others(record, pending.until(tick.scene.stamp_ns - 1))
            if record.runs.is_beginning(tick.scene.stamp_ns) and not is_first:
                self._chains = dict.fromkeys(UPDATES_OF)
                for held in self._held.values():
                    held.grid = None
            is_first = False
            self._take_tick(record, tick, pending.until(tick.scene.stamp_ns))
        self._take_others(record, pending.until(None))

    def results(self) -> list[CheckResult]:
        """Return the outcomes."""
        return [tally.result() for tally in self._tallies.all()]

    def _take_tick(self, record: Record, tick: AdmittedTick, messages: list[Message]) -> None:
        """Judge what a tick gave out, then what came with it and is not its own."""
        own: dict[str, Any] = {}
        others: list[Message] = []
        for entry in messages:
            topic, _, message = entry
            if topic in own or time_ns(message.header.stamp) != tick.scene.stamp_ns:
                others.append(entry)
            else:
                own[topic] = message
        for topic, held in self._held.items():
            if topic in own:
                self._hold(topic, own[topic], tick.scene.stamp_ns)
                if tick.real is None or not tick.is_sure:
                    self._tallies.grids[topic].leave_out(
                        "grid", "for which it is open what to show"
                    )
                else:
                    self._judge.judge(topic, tick, tick.real, own[topic])
            if tick.real is not None:
                held.take(tick, tick.real, self._patience_ns)
        for topic in UPDATES_OF:
            self._follow_updates(record, tick, topic, own)
        self._take_others(record, others)

    def _take_others(self, record: Record, messages: list[Message]) -> None:
        """Judge grids that belong to no tick: bare ones, or those of ticks that were missed."""
        for topic, at_ns, message in messages:
            updated_map = topic.removesuffix("_updates")
            if topic != updated_map:
                chain = self._chains[updated_map]
                self._chains[updated_map] = None if chain is None else updated(chain, message)
                continue
            grid = self._hold(topic, message, at_ns)
            if topic in UPDATES_OF:
                self._chains[topic] = None if grid is None else grid.cells
            if grid is not None:
                self._judge_other(record, topic, at_ns, grid)

    def _judge_other(self, record: Record, topic: str, at_ns: int, grid: RealMap) -> None:
        tally, real = self._tallies.grids[topic], record.real_map_at(at_ns)
        is_farewell = at_ns in record.farewells_ns
        may_be_missed = record.runs.is_edge(at_ns) and not record.runs.is_between(at_ns)
        if real is None:
            tally.leave_out("grid", "without a real map, or about the time of another one")
        elif self._judge.shows(topic, grid, real, []):
            tally.look()
        elif may_be_missed and not is_farewell:
            tally.leave_out("grid", "whose tick the recording missed")
        else:
            tally.look()
            what = "shows artefacts at a farewell" if is_farewell else "belongs to no tick"
            tally.fail(f"{topic} {at_s(at_ns)} {what}, and is not the real map's")

    def _hold(self, topic: str, message: Any, at_ns: int) -> RealMap | None:
        """Keep what a late subscriber gets now; a malformed grid is a fault."""
        try:
            grid = RealMap.of_message(message, at_ns)
        except ValueError:
            tally = self._tallies.grids[topic]
            tally.look()
            tally.fail(f"{topic} {at_s(at_ns)} its data do not fit its size")
            grid = None
        self._held[topic].grid = grid
        return grid

    def _follow_updates(
        self, record: Record, tick: AdmittedTick, topic: str, own: dict[str, Any]
    ) -> None:
        """Apply the update to the map before, where that is known: it is the next map."""
        where, tally = at_s(tick.scene.stamp_ns), self._tallies.updates[topic]
        update = own.get(UPDATES_OF[topic])
        chain = None if tick.real is None else self._chains[topic]
        if update is not None and chain is None:
            tally.leave_out("update", "of a map that is not known")
        elif update is not None and chain is not None:
            tally.look()
            chain = updated(chain, update)
            if chain is None:
                tally.fail(f"{where} an update reaches beyond the map")
        self._chains[topic] = chain
        if topic not in own:
            return
        grid = self._held[topic].grid
        self._chains[topic] = None if grid is None else grid.cells
        if chain is None or grid is None or record.runs.is_fresh(tick.scene.stamp_ns):
            return
        if chain.shape == grid.cells.shape and not np.array_equal(chain, grid.cells):
            how = "without an update" if update is None else "with the update"
            tally.fail(f"{where} the map before {how}: {first_difference(grid.cells, chain)}")
