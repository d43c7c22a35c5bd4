"""What a grid must show at a tick: the real map, or its inflation, with the admitted artefacts."""

from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.oracle_solids import Cover, RealMap
from are_ros.conventions import OCCUPIED
from are_ros.parameters.model import Parameters
from are_ros.replay._check_admission import AdmittedTick
from are_ros.replay._check_costmap import Inflation
from are_ros.replay._check_file import PREFIX
from are_ros.replay._check_result import Tally, at_s
from are_ros.replay._check_scene import time_ns
from are_ros.wording import counted

Cells = NDArray[np.int8]

MAP: Final = PREFIX + "augmented_map"
ARTEFACT_MAP: Final = PREFIX + "artefact_map"
UPDATES_OF: Final = MappingProxyType(
    {MAP: PREFIX + "augmented_map_updates", ARTEFACT_MAP: PREFIX + "artefact_map_updates"}
)
"""The maps that go out as updates, too, with the topics of these."""
COSTMAP: Final = PREFIX + "augmented_costmap"


class GridTallies:
    """The nine outcomes, in their order: of each grid, by topic, and how it keeps up."""

    def __init__(self) -> None:
        self.grids = {
            MAP: Tally("augmented map", "message"),
            ARTEFACT_MAP: Tally("artefact map", "message"),
            COSTMAP: Tally("costmap", "message"),
        }
        self.ages = {
            MAP: Tally("augmented map is current", "tick"),
            ARTEFACT_MAP: Tally("artefact map is current", "tick"),
            COSTMAP: Tally("costmap is current", "tick"),
        }
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

    def judge(self, topic: str, tick: AdmittedTick, real: RealMap, message: Any) -> None:
        """Compare a grid with what it must be."""
        grid = self._grid_of(self._tallies.grids[topic], tick, real, message)
        if grid is not None:
            judge = self._judge_costs if topic == COSTMAP else self._judge_map
            judge(topic, tick, real, grid)

    def _judge_map(self, topic: str, tick: AdmittedTick, real: RealMap, grid: RealMap) -> None:
        """Compare a map with what it is drawn on byte by byte: 100 where an artefact is."""
        expected = expected_map(grid.cells, drawn_on(topic, real), tick.covers)
        if not np.array_equal(expected, grid.cells):
            where = at_s(tick.scene.stamp_ns)
            self._tallies.grids[topic].fail(f"{where} {first_difference(expected, grid.cells)}")

    def _judge_costs(self, topic: str, tick: AdmittedTick, real: RealMap, grid: RealMap) -> None:
        """Compare a costmap with an inflation of our own."""
        where = at_s(tick.scene.stamp_ns)
        self._tallies.floor.look()
        floor = self._inflation_of(real).static_low
        if (grid.cells < floor).any():
            text = first_difference(np.maximum(grid.cells, floor), grid.cells)
            self._tallies.floor.fail(f"{where} {text}")
        within = self.nearest_costs(grid.cells, real, tick.covers)
        if not np.array_equal(within, grid.cells):
            self._tallies.grids[topic].fail(f"{where} {first_difference(within, grid.cells)}")

    def nearest_costs(self, cells: Cells, real: RealMap, covers: list[Cover]) -> Cells:
        """Return the costmap that may be, nearest to the one given."""
        low, high = self._inflation_of(real).bounds(covers)
        return np.clip(cells, low, high)

    def shows(self, topic: str, grid: RealMap, real: RealMap, covers: list[Cover]) -> bool:
        """Tell whether a map or costmap shows these artefacts on the real map, and nothing else."""
        if not grid.has_geometry_of(real):
            return False
        if topic in UPDATES_OF:
            expected = expected_map(grid.cells, drawn_on(topic, real), covers)
            return np.array_equal(expected, grid.cells)
        return np.array_equal(self.nearest_costs(grid.cells, real, covers), grid.cells)

    def _inflation_of(self, real: RealMap) -> Inflation:
        if self._inflation is None or self._inflation.real is not real:
            self._inflation = Inflation(real, self._parameters)
        return self._inflation

    def _grid_of(
        self, tally: Tally, tick: AdmittedTick, real: RealMap, message: Any
    ) -> RealMap | None:
        """Return a published grid, None where it has not the geometry or has another stamp."""
        tally.look()
        where = at_s(tick.scene.stamp_ns)
        is_stamped = time_ns(message.header.stamp) == tick.scene.stamp_ns
        tally.require(is_stamped, f"{where} it has another stamp")
        try:
            grid = RealMap.of_message(message, tick.scene.log_ns)
        except ValueError:
            tally.fail(f"{where} its data do not fit its size")
            return None
        if not grid.has_geometry_of(real):
            tally.fail(f"{where} its geometry is not that of the real map")
            return None
        return grid


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


def updated(cells: Cells, update: Any) -> Cells | None:
    """Return cells with an OccupancyGridUpdate applied, None if it does not fit."""
    height, width = cells.shape
    data = np.asarray(update.data, np.int8)
    fits = 0 <= update.x <= width - update.width and 0 <= update.y <= height - update.height
    if not fits or data.size != update.width * update.height:
        return None
    applied: Cells = cells.copy()
    rows, cols = slice(update.y, update.y + update.height), slice(update.x, update.x + update.width)
    applied[rows, cols] = data.reshape(update.height, update.width)
    return applied


def first_difference(wanted: Cells, found: Cells) -> str:
    """Return the first cell where two grids differ, and how many do."""
    cells = np.argwhere(wanted != found)
    row, col = (int(index) for index in cells[0])
    values = f"is {found[row, col]}, it must be {wanted[row, col]}"
    return f"cell ({row}, {col}) {values}; {counted(len(cells), 'such cell')}"
