"""Where artefacts may arrive in the present environment, and away from whom."""

from pathlib import Path

import numpy as np

from are_ros.artefacts.artefact import GroundPose
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.placement import Placer
from are_ros.artefacts.surroundings import Disc, KeepOut, Surroundings
from are_ros.builder.robots import RobotPose
from are_ros.errors import ParameterError
from are_ros.parameters.choices import Region
from are_ros.parameters.model import Parameters
from are_ros.world.environment import Environment
from are_ros.world.footprint import Footprint, signed_distance_m
from are_ros.world.oriented_boxes import OrientedBoxes, overlaps_any
from are_ros.world.region import RegionFinder, SpawnRegion, region_finder
from are_ros.world.zones import Zones, read_zones_file


class Spawning:
    """Keeps region and placer in step with the environment and with the robot's place in it.

    `goal` is where the robot is going, None where that is not known: nobody arrives there.
    """

    def __init__(self, parameters: Parameters, footprint: Footprint) -> None:
        self.goal: Footprint | None = None
        self.reconfigure(parameters)
        self._robot_radius_m = footprint.inscribed_radius_m
        zones = parameters.population.zones
        self._zones = read_zones_file(Path(zones)) if zones else Zones()
        if parameters.population.region is Region.ZONES and not self._zones.zones:
            raise ParameterError("population.region is zones, but population.zones lists none")
        self._environment: Environment | None = None
        self._finder: RegionFinder | None = None
        self._region: SpawnRegion | None = None
        self._placer: Placer | None = None

    def reconfigure(self, parameters: Parameters) -> None:
        """Keep other distances from now on; region and zones stay."""
        self._population = parameters.population
        self._clearance_m = parameters.robot.clearance

    @property
    def area_m2(self) -> float:
        """The effective area of the region, 0 before it is known."""
        return self._region.area_m2 if self._region else 0.0

    def refresh(self, environment: Environment, robot: RobotPose | None) -> bool:
        """Follow environment and robot; return whether the region is another one than before."""
        if self._finder is None or environment is not self._environment:
            self._finder = self._finder_for(environment)
            self._environment = environment
        region = self._finder.at(_point_of(robot))
        if region is self._region:
            return False
        self._region, self._placer = region, Placer(environment, region)
        return True

    def place(
        self,
        row: CatalogueRow,
        generator: np.random.Generator,
        others: OrientedBoxes,
        robot: RobotPose | None,
        near: tuple[float, float] | None,
    ) -> GroundPose | None:
        """Draw a pose for an artefact, near the first of its group; None if there is none."""
        if self._placer is None:
            return None
        shapes = ([robot.footprint] if robot else []) + ([self.goal] if self.goal else [])
        keep_out = tuple(KeepOut(shape, self._clearance_m) for shape in shapes)
        within = None if near is None else Disc(*near, self._population.group_radius)
        return self._placer.place(row, generator, Surroundings(others, keep_out), within)

    def why_not(
        self,
        box: OrientedBoxes,
        environment: Environment,
        others: OrientedBoxes,
        robot: RobotPose | None,
    ) -> str:
        """Return why a box of length one cannot stand where it is, empty if it can."""
        if not environment.is_placeable(box)[0]:
            return "it would stand in a wall, or not on free cells only"
        if overlaps_any(box, others)[0]:
            return "it would overlap another artefact"
        if robot is not None and signed_distance_m(robot.footprint, box)[0] < self._clearance_m:
            return f"it would be nearer to the robot than robot.clearance, {self._clearance_m} m"
        return ""

    def _finder_for(self, environment: Environment) -> RegionFinder:
        return region_finder(
            self._population.region,
            environment.grid,
            environment.classes.free,
            environment.clearance_m,
            self._robot_radius_m,
            zones=self._zones,
            last_point_m=self._finder.last_point_m if self._finder else None,
        )


def _point_of(robot: RobotPose | None) -> tuple[float, float] | None:
    if robot is None:
        return None
    x_m, y_m, _ = robot.map_from_base.translation_m.tolist()
    return x_m, y_m
