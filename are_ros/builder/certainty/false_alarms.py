"""False alarms: detections of what is not there, uniform over the area that the camera sees."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import Sighting
from are_ros.builder.certainty.perception import View
from are_ros.builder.certainty.track import Body, boxes_at
from are_ros.conventions import seconds_to_ns
from are_ros.parameters.model import CertaintyParameters
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.mixture import TruncatedPoissonMixture
from are_ros.population.randomness import Purpose, generator
from are_ros.population.scenario import LAST_ID
from are_ros.world.environment import Environment

FIRST_ID: Final = LAST_ID + 1
"""Ids of false alarms count from here; those of artefacts never get there."""

_PLACES: Final = 32
"""So many places are tried at once."""
_TRIES: Final = 8


class FalseAlarm(NamedTuple):
    """A false alarm that has just begun: it goes on until `end_ns`."""

    artefact_id: int
    body: Body
    sighting: Sighting
    end_ns: int


class FalseAlarms:
    """Draws how many false alarms begin at a look, where, of which type, and for how long.

    The number is Poisson, and the same whatever else happens: it has a generator of its own, and so
    has each false alarm, by its id.
    """

    def __init__(
        self, seed: int, rows: Sequence[CatalogueRow], law: TruncatedPoissonMixture
    ) -> None:
        self._seed, self._rows, self.law = seed, rows, law
        self._numbers = generator(seed, Purpose.FALSE_ALARM, 0)
        self._next_id = FIRST_ID

    def begin(self, now_ns: int, settings: CertaintyParameters, view: View) -> list[FalseAlarm]:
        """Return those that begin at a look; none where the camera sees no free place."""
        count = int(self._numbers.poisson(settings.false_alarm_rate * view.period_s))
        ids = range(self._next_id, self._next_id + count)
        self._next_id += count
        begun = (self._begin(number, now_ns, settings.false_alarm_life, view) for number in ids)
        return [alarm for alarm in begun if alarm is not None]

    def _begin(self, number: int, now_ns: int, life_s: float, view: View) -> FalseAlarm | None:
        """Draw places, uniform over the free area within the range, until the camera sees one."""
        draws = generator(self._seed, Purpose.FALSE_ALARM, number)
        row = self._rows[self.law.sample(draws)]
        end_ns = now_ns + max(1, seconds_to_ns(draws.exponential(life_s)))
        corners_m = _free_corners_m(view)
        if not len(corners_m):
            return None
        for _ in range(_TRIES):
            bodies = self._bodies(row, corners_m, draws, now_ns, view.environment)
            boxes = boxes_at([body.motion for body in bodies], [body.shape for body in bodies])
            for body, sighting in zip(bodies, view.imagine(boxes), strict=True):
                if sighting is not None:
                    return FalseAlarm(number, body, sighting, end_ns)
        return None

    def _bodies(
        self,
        row: CatalogueRow,
        corners_m: npt.NDArray[np.float64],
        draws: np.random.Generator,
        now_ns: int,
        environment: Environment,
    ) -> list[Body]:
        """Draw boxes of a row that stand in free cells."""
        grid = environment.grid
        chosen = corners_m[draws.integers(len(corners_m), size=_PLACES)]
        local = np.zeros((_PLACES, 3))
        local[:, :2] = chosen + grid.resolution_m * draws.random((_PLACES, 2))
        yaws = draws.uniform(-math.pi, math.pi, _PLACES)
        motions = np.zeros((_PLACES, 7))
        motions[:, :2], motions[:, 3] = grid.origin.apply(local)[:, :2], yaws
        shapes = [Body.box(row, motion, now_ns).shape for motion in motions.tolist()]
        motions[:, 2] = environment.ground_heights_m(boxes_at(motions, shapes))
        return [Body.box(row, motion, now_ns) for motion in motions.tolist()]


def _free_corners_m(view: View) -> npt.NDArray[np.float64]:
    """Return the low corners (M, 2), in the grid's frame, of free cells with middles in range."""
    grid = view.environment.grid
    local_m = grid.origin.inverse().apply(np.array([[*view.camera_m.tolist(), 0.0]]))[0, :2]
    low, high = (
        np.floor((local_m + side * view.max_range_m) / grid.resolution_m) for side in (-1.0, 1.0)
    )
    col0, row0 = np.maximum(low, 0.0).astype(np.int64).tolist()
    col1, row1 = np.maximum(high + 1.0, 0.0).astype(np.int64).tolist()
    cells = np.argwhere(view.environment.classes.free[row0:row1, col0:col1])
    corners_m = grid.resolution_m * (cells[:, ::-1] + np.array((col0, row0)))
    middles_m = corners_m + 0.5 * grid.resolution_m
    near: npt.NDArray[np.float64] = corners_m[
        np.hypot(*(middles_m - local_m).T) <= view.max_range_m
    ]
    return near
