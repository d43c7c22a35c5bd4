"""The grids: each has to show the real map, or its inflation, with the admitted artefacts.

`GridJudge` compares a grid with it. `PublicationTiming` and `LatchedGrid` judge whether the last
grid is up to date: in a replay at the tick, in a live recording after a grace period.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros.bag.decoded import Grid, GridUpdate, Scene
from are_ros.bag.recording import PREFIX
from are_ros.checks.certainty import PerceivedPlaces
from are_ros.checks.oracle.inflation import Costs, Inflation
from are_ros.checks.oracle.plane import Outline
from are_ros.checks.oracle.solids import SURE, Cover, RealMap, are_same, layer
from are_ros.checks.overlaps import covers_by_tick
from are_ros.checks.record import GridMessage, Record, real_map
from are_ros.checks.result import CheckResult, Tally, at_s, skipped
from are_ros.conventions import NS_PER_S, OCCUPIED, seconds_to_ns
from are_ros.parameters.choices import CostmapGate
from are_ros.parameters.model import CostmapParameters, Parameters
from are_ros.wording import counted

Cells = NDArray[np.int8]

MAP: Final = PREFIX + "augmented_map"
ARTEFACT_MAP: Final = PREFIX + "artefact_map"
UPDATES_OF: Final = MappingProxyType(
    {MAP: PREFIX + "augmented_map_updates", ARTEFACT_MAP: PREFIX + "artefact_map_updates"}
)
"""The maps that go out as updates, too, with the topics of these."""
COSTMAP: Final = PREFIX + "augmented_costmap"
_NAMES: Final = MappingProxyType(
    {MAP: "augmented map", ARTEFACT_MAP: "artefact map", COSTMAP: "costmap"}
)

_NEVER: Final = -(2**63)
_GRACE_NS: Final = NS_PER_S
"""After the interval of publication a live recorder may lack the last grid for this time."""


@dataclass(frozen=True, eq=False)
class AdmittedTick:
    """A tick with the real map that it knew (None: none yet), and the admitted boxes' cells.

    `ids` are the admitted artefacts. `is_sure` is unset where a live recording does not tell which
    artefacts were perceived.
    """

    scene: Scene
    real: RealMap | None
    covers: list[Cover]
    ids: frozenset[int]
    is_sure: bool = True


def admitted_by_tick(record: Record, settings: CostmapParameters) -> Iterator[AdmittedTick]:
    """Yield each tick with the artefacts that `costmap.gate` admits to the grids.

    These are all artefacts, or those perceived at most `costmap.memory` before. With certainty,
    what is perceived now stands where it is perceived, whether it is there or not.
    """
    places = PerceivedPlaces()
    has_places = record.settings.certainty.enabled
    lists = {message.at_ns: message for message in record.perceived}
    seen_ns: dict[int, int] = {}
    # With a camera that is slower than the ticks the last look was before the tick.
    perceived = {
        message.at_ns: {one.artefact_id: one.last_seen_ns for one in message.sightings}
        for message in record.perceived
    }
    memory_ns = seconds_to_ns(settings.memory)
    unsure_until_ns = _NEVER
    for scene, real, covers in covers_by_tick(record):
        ids = scene.ids.tolist()
        if settings.gate is CostmapGate.ALL:
            yield AdmittedTick(scene, real, covers, frozenset(ids))
            continue
        is_beginning = bool(memory_ns) and record.runs.is_beginning(scene.stamp_ns)
        if record.is_live and (scene.at_ns not in perceived or is_beginning):
            unsure_until_ns = max(unsure_until_ns, scene.stamp_ns + memory_ns + 1)
        now_seen = perceived.get(scene.at_ns, {})
        seen_ns |= now_seen
        cells = dict(zip(ids, covers, strict=False))  # without a map there are no covers
        places.learn(scene)
        if has_places and real is not None and scene.at_ns in lists:
            cells |= places.covers(lists[scene.at_ns], real)
        known = {*ids, *now_seen} if has_places else ids
        seen_ns = {number: seen_ns[number] for number in known if number in seen_ns}
        limit_ns = scene.stamp_ns - memory_ns
        shown = frozenset(i for i, at_ns in seen_ns.items() if i in now_seen or at_ns >= limit_ns)
        chosen = [cover for number, cover in sorted(cells.items()) if number in shown]
        yield AdmittedTick(scene, real, chosen, shown, scene.stamp_ns >= unsure_until_ns)


class GridTallies:
    """The nine outcomes, in their order: of each grid, by topic, and how it keeps up."""

    def __init__(self) -> None:
        self.grids = {topic: Tally(name, "message") for topic, name in _NAMES.items()}
        self.ages = {topic: Tally(f"{n} is current", "tick") for topic, n in _NAMES.items()}
        self.updates = {
            MAP: Tally("map updates", "message"),
            ARTEFACT_MAP: Tally("artefact map updates", "message"),
        }
        self.floor = Tally("costmap is never lower than the real map's", "message")

    def all(self) -> tuple[Tally, ...]:
        """Return all of them."""
        maps = [
            tally
            for topic in UPDATES_OF
            for tally in (self.grids[topic], self.ages[topic], self.updates[topic])
        ]
        return (*maps, self.floor, self.grids[COSTMAP], self.ages[COSTMAP])


class GridJudge:
    """Compares grids with what artefacts make of the real map."""

    def __init__(self, parameters: Parameters, tallies: GridTallies) -> None:
        self._parameters = parameters
        self._tallies = tallies
        self._inflation: Inflation | None = None

    def judge(self, topic: str, tick: AdmittedTick, real: RealMap, message: Grid) -> None:
        """Compare a grid with what it must be."""
        tally, where = self._tallies.grids[topic], at_s(tick.scene.stamp_ns)
        tally.look()
        is_stamped = message.stamp_ns == tick.scene.stamp_ns
        tally.require(is_stamped, f"{where} it has another stamp")
        try:
            grid = real_map(message)
        except ValueError:
            tally.fail(f"{where} its data do not fit its size")
            return
        if not grid.has_geometry_of(real):
            tally.fail(f"{where} its geometry is not that of the real map")
            return
        if topic == COSTMAP:
            self._judge_floor(where, real, grid.cells)
        nearest = self._nearest(topic, grid.cells, real, tick.covers)
        if not np.array_equal(nearest, grid.cells):
            tally.fail(f"{where} {first_difference(nearest, grid.cells)}")

    def shows(self, topic: str, grid: RealMap, real: RealMap, covers: list[Cover]) -> bool:
        """Tell whether a map or costmap shows these artefacts on the real map, and nothing else."""
        if not grid.has_geometry_of(real):
            return False
        return np.array_equal(self._nearest(topic, grid.cells, real, covers), grid.cells)

    def _judge_floor(self, where: str, real: RealMap, cells: Cells) -> None:
        """Compare a costmap with the lowest costs of the real map alone."""
        tally, floor = self._tallies.floor, self._inflation_of(real).static_low
        tally.look()
        if (cells < floor).any():
            tally.fail(f"{where} {first_difference(np.maximum(cells, floor), cells)}")

    def _nearest(self, topic: str, cells: Cells, real: RealMap, covers: list[Cover]) -> Cells:
        """Return the right map or costmap that is nearest to the cells given."""
        if topic in UPDATES_OF:
            return expected_map(cells, drawn_on(topic, real), covers)
        low, high = self._inflation_of(real).bounds(covers)
        return np.clip(cells, low, high)

    def _inflation_of(self, real: RealMap) -> Inflation:
        if self._inflation is None or self._inflation.real is not real:
            robot, costmap = self._parameters.robot, self._parameters.costmap
            inscribed_m = Outline.of(robot.footprint, robot.radius).inscribed_m()
            costs = Costs(costmap.inflation_radius, costmap.cost_scaling_factor, inscribed_m)
            world = self._parameters.world
            thresholds = world.occupied_threshold, world.free_threshold
            self._inflation = Inflation(real, costs, *thresholds)
        return self._inflation


class LatestGrid(NamedTuple):
    """The last grid of a topic as of a tick.

    `is_new`: it went out at the tick; `is_sent`: it did, or one that shares its interval.
    """

    grid: RealMap | None
    is_new: bool
    is_sent: bool


class PublicationTiming:
    """In a replay, a change is published at the first tick that may publish it.

    That is the next tick if an artefact appears or leaves, else the first one after the interval.
    Nothing is published before.
    """

    def __init__(self, topic: str, tally: Tally, parameters: Parameters) -> None:
        self._topic = topic
        self._tally = tally
        self._interval_ns = _interval_ns(parameters)
        threshold = parameters.world.occupied_threshold
        self._full_value = threshold if topic == COSTMAP else OCCUPIED
        """A real cell with this value or more hides an artefact."""
        self._sent_ns = self._last_ns = _NEVER
        self._last: tuple[RealMap, list[Cover]] | None = None
        self._ids: frozenset[int] = frozenset()

    def take(self, tick: AdmittedTick, latest: LatestGrid) -> None:
        """Follow one tick; fail where a grid goes out too early, or a change does not."""
        if tick.real is None:
            return
        now_ns, real = tick.scene.stamp_ns, drawn_on(self._topic, tick.real)
        self._tally.look()
        is_early = 0 <= now_ns - self._sent_ns < self._interval_ns and tick.ids == self._ids
        if is_early and latest.is_new:
            after = f"{(now_ns - self._sent_ns) / 1e9:g} s after the last one"
            self._tally.fail(f"{at_s(now_ns)} it goes out {after}, though nobody came or went")
        if latest.is_new:
            self._last_ns, self._last = now_ns, (real, tick.covers)
        elif self._last is None:
            # A map of that very time may have come after the tick.
            if real.since_ns < now_ns:
                self._tally.fail(f"{at_s(now_ns)} there is a real map, but nothing was published")
        elif (latest.is_sent or not is_early) and self._is_stale(*self._last, tick, real):
            text = f"shows the artefacts of {at_s(self._last_ns).removeprefix('at ')}"
            self._tally.fail(f"{at_s(now_ns)} the last one still {text}")
        self._sent_ns, self._ids = now_ns if latest.is_sent else self._sent_ns, tick.ids

    def _is_stale(
        self, last_real: RealMap, last: list[Cover], tick: AdmittedTick, real: RealMap
    ) -> bool:
        """Tell whether some cell is certainly another than when the last one went out."""
        if real is not last_real:
            return not np.array_equal(real.cells, last_real.cells)
        if are_same(last, tick.covers):
            return False
        before, now = layer(last, real), layer(tick.covers, real)
        changed = np.abs(before - now) == SURE
        return bool((real.cells.reshape(-1)[changed] < self._full_value).any())


class LatchedGrid:
    """In a live recording, the grid that a late subscriber gets may be out of date for a while."""

    def __init__(self, topic: str, tally: Tally, parameters: Parameters, judge: GridJudge) -> None:
        self._topic = topic
        self._tally = tally
        self._judge = judge
        self._patience_ns = _interval_ns(parameters) + _GRACE_NS
        self._wrong_ns: int | None = None
        self._last: tuple[RealMap, RealMap, list[Cover], bool] | None = None

    def take(self, tick: AdmittedTick, latest: LatestGrid) -> None:
        """Fail when the last grid has shown other artefacts than the ticks for too long.

        That time begins anew where the real map is not known, as while another one comes.
        """
        grid, real = latest.grid, tick.real
        if grid is None or real is None or not tick.is_sure:
            self._wrong_ns = None
            self._tally.leave_out("tick", "for which it is open what was, or ought to be, shown")
            return
        self._tally.look()
        now_ns = tick.scene.stamp_ns
        if self._is_right(grid, real, tick.covers):
            self._wrong_ns = None
            return
        self._wrong_ns = now_ns if self._wrong_ns is None else self._wrong_ns
        if now_ns - self._wrong_ns >= self._patience_ns:
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


def _interval_ns(parameters: Parameters) -> int:
    return -int(-NS_PER_S // parameters.augmented_map.max_rate)


def drawn_on(topic: str, real: RealMap) -> RealMap:
    """Return what a map shows without artefacts: the real map, or nothing."""
    return real.blank if topic == ARTEFACT_MAP else real


def expected_map(found: Cells, real: RealMap, covers: list[Cover]) -> Cells:
    """Return the map that artefacts on `real` may make, nearest to the one found."""
    expected, flat = real.cells.flatten(), found.reshape(-1)
    for cover in covers:
        expected[cover.sure] = OCCUPIED
        expected[cover.touched[flat[cover.touched] == OCCUPIED]] = OCCUPIED
    return expected.reshape(found.shape)


def updated(cells: Cells, update: GridUpdate) -> Cells | None:
    """Return cells with an update applied, None if it does not fit."""
    height, width = cells.shape
    fits = 0 <= update.x <= width - update.width and 0 <= update.y <= height - update.height
    if not fits or update.data.size != update.width * update.height:
        return None
    applied: Cells = cells.copy()
    rows, cols = slice(update.y, update.y + update.height), slice(update.x, update.x + update.width)
    applied[rows, cols] = update.data.reshape(update.height, update.width)
    return applied


def first_difference(wanted: Cells, found: Cells) -> str:
    """Return the first cell where two grids differ, and how many do."""
    cells = np.argwhere(wanted != found)
    row, col = (int(index) for index in cells[0])
    values = f"is {found[row, col]}, it must be {wanted[row, col]}"
    return f"cell ({row}, {col}) {values}; {counted(len(cells), 'such cell')}"


# The maps, their updates and the costmap, tick by tick.


def check_grids(record: Record, messages: Iterator[GridMessage]) -> list[CheckResult]:
    """Follow the grids of a recording; the messages are in order of time."""
    tallies = GridTallies()
    if record.parameters is not None and record.maps:
        _GridChecks(record.parameters, tallies, is_live=record.is_live).follow(record, messages)
        return [tally.result() for tally in tallies.all()]
    for _ in messages:  # reading them is a check of its own
        pass
    reason, lacks_inputs = "nothing tells its parameters, which say what the grids show", False
    if record.parameters is not None:
        reason, lacks_inputs = record.why_no_map(), record.lacks_inputs
    return [skipped(tally.name, reason, needs_inputs=lacks_inputs) for tally in tallies.all()]


class _MessageQueue:
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

    def __init__(self, parameters: Parameters, tallies: GridTallies, *, is_live: bool) -> None:
        self._is_live, self._tallies, self._settings = is_live, tallies, parameters.costmap
        self._judge = GridJudge(parameters, tallies)
        self._ages: dict[str, PublicationTiming | LatchedGrid] = {
            topic: LatchedGrid(topic, tally, parameters, self._judge)
            if is_live
            else PublicationTiming(topic, tally, parameters)
            for topic, tally in tallies.ages.items()
        }
        self._held: dict[str, RealMap | None] = {}
        """What a late subscriber gets, by topic."""
        self._chains: dict[str, tuple[Cells, RealMap | None] | None] = {}
        """The maps as updates made them, with the real map; None where one may be missing."""
        self._forget()

    def follow(self, record: Record, messages: Iterator[GridMessage]) -> None:
        """Follow the ticks."""
        pending, is_first = _MessageQueue(messages), True
        for tick in admitted_by_tick(record, self._settings):
            self._take_others(record, pending.until(tick.scene.at_ns - 1))
            if record.runs.is_beginning(tick.scene.stamp_ns) and not is_first:
                self._forget()
            is_first = False
            self._take_tick(record, tick, pending.until(tick.scene.at_ns))
        self._take_others(record, pending.until(None))

    def _forget(self) -> None:
        """Begin anew after a gap."""
        self._held = dict.fromkeys(self._ages)
        self._chains = dict.fromkeys(UPDATES_OF)

    def _take_tick(self, record: Record, tick: AdmittedTick, messages: list[GridMessage]) -> None:
        """Judge what a tick gave out, then what came with it and is not its own."""
        own: dict[str, Grid] = {}
        updates: dict[str, GridUpdate] = {}
        others: list[GridMessage] = []
        of_farewell = self._of_farewell(record, tick, messages)
        for topic, message in messages:
            # In a replay a tick that knows a map gave it out, whatever it says.
            is_stamped = message.stamp_ns == tick.scene.stamp_ns
            is_own = is_stamped if self._is_live else tick.real is not None
            if not is_own or topic in own or topic in updates or message in of_farewell:
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
            if self._is_live or topic in record.topics:
                is_sent = is_map_sent if topic in UPDATES_OF else topic in own
                age.take(tick, LatestGrid(self._held[topic], topic in own, is_sent))
        for topic, of_updates in UPDATES_OF.items():
            self._follow_updates(record, tick, topic, updates.get(of_updates), topic in own)
        self._take_others(record, others)

    def _of_farewell(
        self, record: Record, tick: AdmittedTick, messages: list[GridMessage]
    ) -> list[Grid]:
        """Return the grids of a farewell that has the stamp of the tick: the last ones, bare.

        Where the clock stood, both were logged at one time.
        """
        stamp_ns, real = tick.scene.stamp_ns, tick.real
        if not self._is_live or real is None or stamp_ns not in record.farewells_ns:
            return []
        last = {
            topic: message
            for topic, message in messages
            if isinstance(message, Grid) and message.stamp_ns == stamp_ns
        }
        return [one for topic, one in last.items() if self._is_bare(topic, one, real)]

    def _is_bare(self, topic: str, message: Grid, real: RealMap) -> bool:
        try:
            return self._judge.shows(topic, real_map(message), real, [])
        except ValueError:  # a malformed grid is told where it is judged
            return False

    def _take_others(self, record: Record, messages: list[GridMessage]) -> None:
        """Judge grids without a tick: real maps, or grids of ticks that the recording missed."""
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
