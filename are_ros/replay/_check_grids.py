"""The maps of a replay, their updates and the costmap, tick by tick."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.oracle_solids import RealMap
from are_ros.conventions import NS_PER_S, OCCUPIED
from are_ros.parameters.model import Parameters
from are_ros.replay._check_admission import AdmittedTick, admitted_by_tick
from are_ros.replay._check_currency import Currency
from are_ros.replay._check_grid_judges import (
    COSTMAP,
    UPDATES_OF,
    GridJudge,
    GridTallies,
    drawn_on,
    first_difference,
    updated,
)
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, at_s, skipped

Message = tuple[str, int, Any]


def check_grids(record: Record, messages: Iterator[Message]) -> list[CheckResult]:
    """Follow the grids tick by tick; `messages` are theirs, in order of log time."""
    if record.parameters is None or not record.maps:
        for _ in messages:  # they are still to be deserialised
            pass
        return skipped_grids(record)
    checks = _GridChecks(record.parameters)
    pending = Pending(messages)
    for tick in admitted_by_tick(record, record.parameters.costmap):
        checks.stray(pending.until(tick.scene.log_ns - 1))
        checks.take(tick, pending.until(tick.scene.log_ns))
    checks.stray(pending.until(None))
    return checks.results()


def skipped_grids(record: Record) -> list[CheckResult]:
    """Return the outcomes where it is not known what the grids ought to show."""
    reason, lacks_inputs = "there is no effective.yaml, which says what the grids show", False
    if record.parameters is not None:
        reason, lacks_inputs = record.why_no_map(), record.lacks_inputs
    names = [tally.name for tally in GridTallies().all()]
    return [skipped(name, reason, needs_inputs=lacks_inputs) for name in names]


class Pending:
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
    """The checks of the grids, with what was published last."""

    def __init__(self, parameters: Parameters) -> None:
        self._tallies = GridTallies()
        self._judge = GridJudge(parameters, self._tallies)
        interval_ns = -int(-NS_PER_S // parameters.augmented_map.max_rate)
        threshold = parameters.world.occupied_threshold
        self._ages = {
            topic: Currency(tally, interval_ns, threshold if topic == COSTMAP else OCCUPIED)
            for topic, tally in self._tallies.ages.items()
        }
        self._last: dict[str, tuple[NDArray[np.int8], RealMap | None]] = {}

    def take(self, tick: AdmittedTick, messages: list[Message]) -> None:
        """Judge what a tick published, and whether it ought to have published."""
        by_topic = {topic: message for topic, _, message in messages}
        if tick.real is None:
            self.stray(messages)
            return
        is_map_sent = any(topic in by_topic for topic in UPDATES_OF)
        for topic, age in self._ages.items():
            message = by_topic.get(topic)
            if message is not None:
                self._judge.judge(topic, tick, tick.real, message)
            is_published = message is not None
            is_sent = is_map_sent if topic in UPDATES_OF else is_published
            age.take(tick, drawn_on(topic, tick.real), is_published=is_published, is_sent=is_sent)
        for topic, updates in UPDATES_OF.items():
            self._follow_updates(tick, topic, by_topic.get(topic), by_topic.get(updates))

    def stray(self, messages: list[Message]) -> None:
        """Count messages that belong to no tick with a map."""
        for topic, log_ns, _ in messages:
            tally = self._tallies.grids[topic.removesuffix("_updates")]
            tally.look()
            tally.fail(f"{topic} {at_s(log_ns)} belongs to no tick that knows a map")

    def results(self) -> list[CheckResult]:
        """Return the outcomes."""
        return [tally.result() for tally in self._tallies.all()]

    def _follow_updates(self, tick: AdmittedTick, topic: str, grid: Any, update: Any) -> None:
        """Apply the update to the map before: that is the next map."""
        where, tally = at_s(tick.scene.stamp_ns), self._tallies.updates[topic]
        cells = None
        if grid is not None:
            cells = np.asarray(grid.data, np.int8).reshape(grid.info.height, grid.info.width)
        last, last_real = self._last.get(topic, (None, None))
        if cells is not None:
            self._last[topic] = cells, tick.real
        if update is None:
            if cells is not None and last is not None and last_real is tick.real:
                same = np.array_equal(last, cells)
                tally.require(same, f"{where} the map changed without an update")
            return
        tally.look()
        if cells is None or last is None or last.shape != cells.shape:
            tally.fail(f"{where} an update comes without a map before and after it")
            return
        applied = updated(last, update)
        if applied is None:
            tally.fail(f"{where} an update reaches beyond the map")
        elif not np.array_equal(applied, cells):
            text = first_difference(cells, applied)
            tally.fail(f"{where} the map before with the update: {text}")
