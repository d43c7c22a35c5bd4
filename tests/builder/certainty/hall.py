"""A hall of artefacts before a detector, without a camera: tests say what is visible of each."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from are_ros.agents.events import Sighting
from are_ros.builder.certainty.detector import Detector
from are_ros.builder.certainty.perception import Perception, View
from are_ros.builder.scene import Scene
from are_ros.conventions import NS_PER_S
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform

START_NS = 1_000 * NS_PER_S
PLAIN = {
    "certainty.enabled": True,
    "certainty.latency": 0.0,
    "certainty.min_existence": 0.0,
    "certainty.false_alarm_rate": 0.0,
    "mixture.weights": (1.0,),
    "mixture.rates": (1.0,),
}
"""A good detector that tells at once all that it knows, and has no false alarms."""
NAMES = ("person", "car", "pallet", "robot")
CATALOGUE = Catalogue(
    tuple(
        CatalogueRow(k, f"small {name}", name, (0.4, 0.4, 1.6), (0.0, 0.0, 0.0), Shape.CRATE)
        for k, name in enumerate(NAMES)
    )
)


class Walk(PoseHistory):
    """A straight walk at constant rates."""

    def __init__(self, start: GroundPose, rates: tuple[float, float, float]) -> None:
        super().__init__(START_NS, start)
        self._rates = rates

    def pose_at(self, t_ns: int) -> GroundPose:
        """Return where it is."""
        dt_s, (vx, vy, turn) = (t_ns - START_NS) / NS_PER_S, self._rates
        x, y, z, yaw = self.latest
        return GroundPose(
            x + vx * dt_s, y + vy * dt_s, z, math.remainder(yaw + turn * dt_s, math.tau)
        )

    def velocity_at(self, t_ns: int) -> tuple[float, float, float]:  # noqa: ARG002 - it is constant
        """Return the rates."""
        return self._rates


def ns(t_s: float) -> int:
    """Return a time after the start [ns]."""
    return START_NS + round(t_s * NS_PER_S)


def detector(values: Mapping[str, Any] | None = None) -> Detector:
    """Return a detector with these parameters over the plain ones."""
    return Detector(with_values(Parameters(), PLAIN | dict(values or {})), CATALOGUE)


def walkers(count: int, seed: int = 1, first_id: int = 1) -> list[Artefact]:
    """Return artefacts of all classes, anywhere within 20 m, that walk and turn."""
    random = np.random.default_rng(seed)
    starts = random.uniform((-20, -20, 0, -math.pi), (20, 20, 0, math.pi), (count, 4))
    rates = random.uniform((-1.5, -1.5, -1.0), (1.5, 1.5, 1.0), (count, 3))
    rows = random.integers(len(NAMES), size=count)
    return [
        Artefact(
            first_id + k,
            CATALOGUE.rows[rows[k]],
            Origin.RANDOM,
            START_NS,
            Walk(GroundPose(*starts[k].tolist()), tuple(rates[k].tolist())),
        )
        for k in range(count)
    ]


def scene(artefacts: Iterable[Artefact], t_s: float) -> Scene:
    """Return them at a time after the start."""
    return Scene.of(sorted(artefacts, key=lambda one: one.id), ns(t_s))


def sight(fraction: float = 1.0, range_m: float = 3.0) -> Sighting:
    """Return a sighting of which this fraction is visible."""
    return Sighting(round(1000 * fraction), 1000, (10, 10, 40, 40), range_m)


def sights(
    artefacts: Sequence[Artefact], fraction: float = 1.0, range_m: float = 3.0
) -> dict[int, Sighting]:
    """Return such a sighting of each."""
    return {one.id: sight(fraction, range_m) for one in artefacts}


def room(side_m: float = 20.0) -> Environment:
    """Return a square room of free cells about the origin."""
    cells = round(side_m / 0.5)
    origin = RigidTransform.planar(-0.5 * side_m, -0.5 * side_m, 0.0)
    grid = OccupancyGrid(np.zeros((cells, cells), np.int8), 0.5, origin, "map")
    return Environment(grid, classify(grid, 65, 25), None, PlaneGround(0.0), 0.01)


def view(
    imagine: Callable[[OrientedBoxes], Sequence[Sighting | None]] | None = None,
    environment: Environment | None = None,
    max_range_m: float = 30.0,
    period_s: float = 0.1,
) -> View:
    """Return a view from the origin that sees every box wholly, unless told otherwise."""
    everything = imagine or (lambda boxes: [sight()] * len(boxes))
    return View(environment or room(), everything, np.zeros(2), max_range_m, period_s)


VIEW = view()


def seeing(sightings: Mapping[int, Sighting], view_: View = VIEW) -> list[View]:
    """Return the look of the only camera."""
    return [replace(view_, sightings=sightings)]


def look(
    eye: Detector, artefacts: Sequence[Artefact], t_s: float, fraction: float = 1.0
) -> Perception:
    """Look at all of them at once."""
    return eye.observe(ns(t_s), scene(artefacts, t_s), seeing(sights(artefacts, fraction)))
