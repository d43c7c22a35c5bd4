"""The maps, their updates and the costmap, tick by tick, through the loops of the clock.

In a replay every grid belongs to a tick. Live, grids are latched with a depth of one, so a recorder
may miss one that the next followed at once; and while the node is not active, or takes its leave,
the real map is given out as it is.
"""

from collections.abc import Iterable, Iterator

from are_ros.bag.decoded import Grid, GridUpdate
from are_ros.checks.grid_judges import (
    UPDATES_OF,
    AdmittedTick,
    Cells,
    Currency,
    GridJudge,
    GridTallies,
    Held,
    admitted_by_tick,
    first_difference,
    updated,
)
from are_ros.checks.oracle_solids import RealMap
from are_ros.checks.record import GridMessage, Record, real_map
from are_ros.checks.result import CheckResult, at_s, skipped
from are_ros.parameters.model import Parameters


def check_grids(loops: Iterable[tuple[Record, Iterator[GridMessage]]]) -> list[CheckResult]:
    """Follow the grids through the loops of a recording; the messages are in order of time."""
    checks: _GridChecks | None = None
    results: list[CheckResult] = []
    for record, messages in loops:
        if record.parameters is None or not record.maps:
            for _ in messages:  # they are still to be deserialised
                pass
            results = _skipped_grids(record)
            continue
        checks = checks or _GridChecks(record.parameters, is_live=record.is_live)
        checks.follow(record, record.parameters, messages)
    return checks.results() if checks else results


def _skipped_grids(record: Record) -> list[CheckResult]:
    """Return the outcomes where it is not known what the grids ought to show."""
    reason, lacks_inputs = "there is no effective.yaml, which says what the grids show", False
    if record.parameters is not None:
        reason, lacks_inputs = record.why_no_map(), record.lacks_inputs
    names = [tally.name for tally in GridTallies().all()]
    return [skipped(name, reason, needs_inputs=lacks_inputs) for name in names]


class _Pending:
    """A stream of messages, taken up to a time."""

    def __init__(self, messages: Iterator[GridMessage]) -> None:
        self._messages = messages
        self._next = next(messages, None)

    def until(self, at_ns: int | None) -> list[GridMessage]:
        """Return the messages up to then; all that are left for None."""
        taken: list[GridMessage] = []
        while self._next is not None and (at_ns is None or self._next[1].at_ns <= at_ns):
            taken.append(self._next)
            self._next = next(self._messages, None)
        return taken


class _GridChecks:
    """The checks of the grids, with what was published last."""

    def __init__(self, parameters: Parameters, *, is_live: bool) -> None:
        self._is_live = is_live
        self._tallies = GridTallies()
        self._judge = GridJudge(parameters, self._tallies)
        self._ages: dict[str, Currency | Held] = {
            topic: Held(topic, tally, parameters, self._judge)
            if is_live
            else Currency(topic, tally, parameters)
            for topic, tally in self._tallies.ages.items()
        }
        self._held: dict[str, RealMap | None] = {}
        """What a late subscriber gets, by topic."""
        self._chains: dict[str, tuple[Cells, RealMap | None] | None] = {}
        """The maps as updates made them, with the real map; None where one may be missing."""
        self._forget()

    def follow(
        self, record: Record, parameters: Parameters, messages: Iterator[GridMessage]
    ) -> None:
        """Follow one loop of the clock."""
        pending, is_first = _Pending(messages), True
        for tick in admitted_by_tick(record, parameters.costmap):
            self._take_others(record, pending.until(tick.scene.at_ns - 1))
            if record.runs.is_beginning(tick.scene.stamp_ns) and not is_first:
                self._forget()
            is_first = False
            self._take_tick(record, tick, pending.until(tick.scene.at_ns))
        self._take_others(record, pending.until(None))

    def results(self) -> list[CheckResult]:
        """Return the outcomes."""
        return [tally.result() for tally in self._tallies.all()]

    def _forget(self) -> None:
        """Begin anew after a gap."""
        self._held = dict.fromkeys(self._ages)
        self._chains = dict.fromkeys(UPDATES_OF)

    def _take_tick(self, record: Record, tick: AdmittedTick, messages: list[GridMessage]) -> None:
        """Judge what a tick gave out, then what came with it and is not its own."""
        own: dict[str, Grid] = {}
        updates: dict[str, GridUpdate] = {}
        others: list[GridMessage] = []
        for topic, message in messages:
            if not self._is_own(tick, message) or topic in own or topic in updates:
                others.append((topic, message))
            elif isinstance(message, Grid):
                own[topic] = message
            else:
                updates[topic] = message
        is_map_sent = any(topic in own for topic in UPDATES_OF)
        for topic, age in self._ages.items():
            if topic in own:
                self._hold(topic, own[topic])
                if tick.real is None or not tick.is_sure:
                    tally = self._tallies.grids[topic]
                    tally.leave_out("grid", "for which it is open what to show")
                else:
                    self._judge.judge(topic, tick, tick.real, own[topic])
            if tick.real is not None:
                is_sent = is_map_sent if topic in UPDATES_OF else topic in own
                is_new, grid = topic in own, self._held[topic]
                age.take(tick, tick.real, grid, is_new=is_new, is_sent=is_sent)
        for topic, of_updates in UPDATES_OF.items():
            self._follow_updates(record, tick, topic, updates.get(of_updates), topic in own)
        self._take_others(record, others)

    def _is_own(self, tick: AdmittedTick, message: Grid | GridUpdate) -> bool:
        """Tell whether a tick gave this out: in a replay one that knows a map, whatever it says."""
        if self._is_live:
            return message.stamp_ns == tick.scene.stamp_ns
        return tick.real is not None

    def _take_others(self, record: Record, messages: list[GridMessage]) -> None:
        """Judge grids that belong to no tick: bare ones, or those of ticks that were missed."""
        for topic, message in messages:
            of_map = topic.removesuffix("_updates")
            if not self._is_live:
                tally = self._tallies.grids[of_map]
                tally.look()
                tally.fail(f"{topic} {at_s(message.at_ns)} belongs to no tick that knows a map")
            elif isinstance(message, Grid):
                grid = self._hold(topic, message)
                if topic in UPDATES_OF:
                    self._chains[topic] = None if grid is None else (grid.cells, None)
                if grid is not None:
                    self._judge_other(record, topic, grid)
            elif (chain := self._chains[of_map]) is not None:
                cells = updated(chain[0], message)
                self._chains[of_map] = None if cells is None else (cells, chain[1])

    def _judge_other(self, record: Record, topic: str, grid: RealMap) -> None:
        """Of a live recording: it is the real map's, or of a tick that the recording missed."""
        at_ns = grid.since_ns
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

    def _hold(self, topic: str, message: Grid) -> RealMap | None:
        """Keep what a late subscriber gets now; a malformed grid is a fault."""
        try:
            grid = real_map(message)
        except ValueError:
            grid = None
            if self._is_live:
                tally = self._tallies.grids[topic]
                tally.look()
                tally.fail(f"{topic} {at_s(message.at_ns)} its data do not fit its size")
        self._held[topic] = grid
        return grid

    def _follow_updates(
        self,
        record: Record,
        tick: AdmittedTick,
        topic: str,
        update: GridUpdate | None,
        is_sent: bool,
    ) -> None:
        """Apply the update to the map before, where that is known: it is the next map."""
        where, tally = at_s(tick.scene.stamp_ns), self._tallies.updates[topic]
        chain = None if tick.real is None else self._chains[topic]
        grid = self._held[topic] if is_sent else None
        cells = None if chain is None else chain[0]
        if update is not None and cells is not None and (is_sent or self._is_live):
            tally.look()
            cells = updated(cells, update)
            tally.require(cells is not None, f"{where} an update reaches beyond the map")
        elif update is not None and self._is_live:
            tally.leave_out("update", "of a map that is not known")
        elif update is not None:
            tally.look()
            tally.fail(f"{where} an update comes without a map before and after it")
        if not is_sent:
            self._chains[topic] = None if cells is None or chain is None else (cells, chain[1])
            return
        self._chains[topic] = None if grid is None else (grid.cells, tick.real)
        if cells is None or grid is None or chain is None:
            return
        is_new_map = update is None and chain[1] is not None and chain[1] is not tick.real
        if is_new_map or record.runs.is_fresh(tick.scene.stamp_ns):
            return
        if cells.shape == grid.cells.shape and (cells != grid.cells).any():
            how = "without an update" if update is None else "with the update"
            tally.fail(f"{where} the map before {how}: {first_difference(grid.cells, cells)}")
