"""Whether the robot of a recording stands where its map lets it: else the two do not fit."""

from typing import Final

from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.tick import Tick
from are_ros.parameters.choices import Region
from are_ros.replay.listeners import Silence
from are_ros.world.environment import Environment

_SHARE: Final = 0.1
"""A robot that grazes a wall for a while is not worth a word."""
_LEAST_AREA_M2: Final = 3.0
"""Who turns on the spot needs about as much: no place that a robot is driven in is smaller."""


class StandingWatch(Silence):
    """Looks at each tick whether the cell of the robot's base is free."""

    def __init__(self, builder: ArBuilder) -> None:
        self._builder = builder
        self._ticks = 0
        self._outside_m: list[tuple[float, float]] = []
        self._area_m2 = 0.0

    def take_tick(self, tick: Tick) -> None:
        """Look where the robot stands, as soon as there are a map and its pose."""
        environment = self._builder.world.environment
        if environment is None or tick.map_from_base is None:
            return
        x_m, y_m, _ = tick.map_from_base.translation_m.tolist()
        self._ticks += 1
        self._area_m2 = max(self._area_m2, tick.metrics.area_m2)
        if not _is_free(environment, (x_m, y_m)):
            self._outside_m.append((x_m, y_m))

    def sentences(self) -> list[str]:
        """Return what a user should know: nothing where robot and map agree."""
        doubts = []
        outside = self._outside()
        if outside > _SHARE * self._ticks:
            doubts.append(
                "the robot stood on occupied or unknown cells, or beyond the map, "
                f"in {outside} of {self._ticks} ticks"
            )
        kind = self._builder.parameters.population.region
        if self._ticks and kind is Region.REACHABLE and self._area_m2 < _LEAST_AREA_M2:
            doubts.append(f"the robot can reach {self._area_m2:.1f} m^2 of the map at most")
        question = "does the map belong to the recording, and is its frame right?"
        return [f"{', and '.join(doubts)}: {question}"] if doubts else []

    def _outside(self) -> int:
        """Return how often the cell was not free, then and in the last map.

        While a map is being made, the cells under the robot may come to be known only later.
        """
        last = self._builder.world.environment
        return 0 if last is None else sum(not _is_free(last, at_m) for at_m in self._outside_m)


def _is_free(environment: Environment, at_m: tuple[float, float]) -> bool:
    cell = environment.grid.cell_at(*at_m)
    return cell is not None and bool(environment.classes.free[cell])
