"""A hall full of people that tests look into: a builder without outputs, and what it is told."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import ArtefactEvent
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.population_manager import PopulationManager
from are_ros.builder.tick import Demand
from are_ros.conventions import NS_PER_S
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import Artefact, GroundPose
from are_ros.population.catalogue import Catalogue, CatalogueRow, MotionLimits
from are_ros.population.meshes.shapes import Shape
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

START_NS = 1_000 * NS_PER_S
STEP_NS = NS_PER_S // 20
Block = tuple[float, float, float, float]
"""x0, x1, y0, y1 in metres, half-open."""

QUIET: Mapping[str, Any] = {
    "population.arrival_rate": 0.0,
    "mixture.weights": (1.0,),
    "mixture.rates": (0.5,),
    "robot.radius": 0.2,
    "robot.clearance": 0.1,
}
WALK = MotionLimits(1.3, 1.5, 3.0, 0.0, 1.8)
DRIVE = MotionLimits(2.0, 1.0, 1.0, 1.3, 1.0)


def row(
    index: int,
    behaviour: str,
    motion: MotionLimits = WALK,
    size_m: tuple[float, float, float] = (0.3, 0.5, 1.7),
) -> CatalogueRow:
    """Return a type that does one thing."""
    label = f"{behaviour.rpartition(':')[2].lower()} {index}"
    shape = Shape.PERSON if motion.speed_mps else Shape.CRATE
    return CatalogueRow(
        index, label, "kind", size_m, (0, 0, 0), shape, motion=motion, behaviours={behaviour: 1.0}
    )


WALKER, FOLLOWER, GATHERER, POST, CART = 0, 1, 2, 3, 4
TYPES = Catalogue(
    (
        row(WALKER, "walking"),
        row(FOLLOWER, "following"),
        row(GATHERER, "gathering"),
        row(POST, "standing", MotionLimits(), (0.4, 0.4, 1.6)),
        row(CART, "driving", DRIVE, (1.2, 0.6, 1.0)),
    )
)


def hall(width_m: float, depth_m: float, *blocks: Block, gap: Block | None = None) -> OccupancyGrid:
    """Return a hall from (0, 0) with cells of 0.1 m and walls of one cell, open at `gap`."""
    cells = np.zeros((round(10 * depth_m), round(10 * width_m)), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    for value, parts in ((100, blocks), (0, (gap,) if gap else ())):
        for part in parts:
            x0, x1, y0, y1 = (round(10 * number) for number in part)
            cells[y0:y1, x0:x1] = value
    return OccupancyGrid(cells, 0.1, RigidTransform.identity(), "map")


@dataclass(eq=False)
class Town:
    """A builder with its map and its robot; times in seconds after the start."""

    builder: ArBuilder

    @classmethod
    def of(
        cls,
        values: Mapping[str, Any] | None = None,
        grid: OccupancyGrid | None = None,
        types: Catalogue = TYPES,
        robot: tuple[float, float] | None = (0.5, 0.5),
    ) -> "Town":
        """Return a town, 10 x 8 m if nothing is said, where the robot stands in a corner."""
        parameters = with_values(Parameters(), {**QUIET, **(values or {})})
        town = cls(ArBuilder(parameters, types, Demand(False, False, False)))
        town.map(0.0, grid or hall(10.0, 8.0))
        if robot is not None:
            town.robot(0.0, *robot)
        return town

    @property
    def lives(self) -> PopulationManager:
        """Return the lives."""
        return self.builder.lives

    @staticmethod
    def ns(t_s: float) -> int:
        """Return a time as the builder takes it."""
        return START_NS + round(t_s * NS_PER_S)

    def map(self, t_s: float, grid: OccupancyGrid) -> None:
        """Receive a map."""
        self.builder.receive_map(grid, self.ns(t_s))

    def robot(self, t_s: float, x_m: float, y_m: float, yaw_rad: float = 0.0) -> None:
        """Receive the robot's pose, of now."""
        turn = (0.0, 0.0, math.sin(0.5 * yaw_rad), math.cos(0.5 * yaw_rad))
        now_ns = self.ns(t_s)
        self.builder.receive_transform("map", "base_link", now_ns, (x_m, y_m, 0.0), turn, now_ns)

    def place(
        self,
        kind: int,
        x_m: float,
        y_m: float,
        t_s: float = 0.0,
        *,
        yaw_rad: float = 0.0,
        life_s: float | None = 1e4,
        behaviour: str = "",
    ) -> int:
        """Place an artefact of a type, and return its id."""
        life_ns = None if life_s is None else round(life_s * NS_PER_S)
        types, pose = self.builder.catalogue, GroundPose(x_m, y_m, 0.0, yaw_rad)
        return self.lives.place(
            types.rows[kind], pose, self.ns(t_s), life_ns=life_ns, behaviour=behaviour
        )

    def one(self, artefact_id: int) -> Artefact:
        """Return one that lives."""
        return self.lives.population.living[artefact_id]

    def run(self, from_s: float, until_s: float, rate_hz: float = 20.0) -> "Record":
        """Tick at a rate since the epoch; return the poses at each sub-step, and what happened."""
        record, tick = Record({}, []), math.ceil(self.ns(from_s) * rate_hz / NS_PER_S - 1e-6)
        seen_ns = self.ns(from_s)
        while (now_ns := round(tick * NS_PER_S / rate_hz)) <= self.ns(until_s):
            record.events += self.builder.step(now_ns).events
            record.look(self.lives, seen_ns, now_ns)
            seen_ns, tick = max(now_ns, seen_ns), tick + 1
        return record


@dataclass(eq=False)
class Record:
    """Who was where at which sub-step [ns], (id -> pose and what it did), and the events."""

    moments: dict[int, dict[int, tuple[GroundPose, str]]]
    events: list[ArtefactEvent]

    def look(self, lives: PopulationManager, after_ns: int, until_ns: int) -> None:
        """Take the sub-steps of a half-open stretch (after, until]."""
        for index in range(after_ns // STEP_NS + 1, until_ns // STEP_NS + 1):
            t_ns = index * STEP_NS
            there = lives.scene_at(t_ns).artefacts
            self.moments[t_ns] = {a.id: (a.ground_pose_at(t_ns), a.behaviour) for a in there}

    def way_of(self, artefact_id: int) -> npt.NDArray[np.float64]:
        """Return x, y, yaw (K, 3) of one at the sub-steps that it lived."""
        poses = [m[artefact_id][0] for m in self.moments.values() if artefact_id in m]
        return np.array([(p.x_m, p.y_m, p.yaw_rad) for p in poses]).reshape(-1, 3)


def events_of(events: Sequence[ArtefactEvent], artefact_id: int) -> list[ArtefactEvent]:
    """Return the events of one."""
    return [event for event in events if event.artefact_id == artefact_id]
