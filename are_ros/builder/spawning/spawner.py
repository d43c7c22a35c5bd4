"""Where artefacts may arrive: in the present region, away from robot, goal and other artefacts.

`Spawning` keeps the region and its `Placer` up to date with the environment and with the part of it
that the robot can reach. `OutOfView` tells which boxes no camera sees: for artefacts that arrive
and vanish unseen (section 3.2).
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.navigation.terrain import Terrains
from are_ros.agents.robots import RobotPose
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.occlusion.zbuffer import ZBuffer
from are_ros.builder.spawning.placement import PlacementConstraints, Placer
from are_ros.errors import ParameterError
from are_ros.parameters.choices import Appear, Leave, Region
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import GroundPose
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.departures import Cause
from are_ros.wording import listed
from are_ros.world.boxes import OrientedBoxes, overlaps_any
from are_ros.world.cameras import CameraAt, ViewModel
from are_ros.world.environment import Environment
from are_ros.world.footprint import Footprint, signed_distance_m
from are_ros.world.regions import (
    RegionFinder,
    SpawnRegion,
    Zones,
    read_zones_file,
    region_finder,
    region_of_zones,
)

_GROWN_M: Final = 1e-3
_STRIDES: Final = (32, 4, 1)
"""A box is looked for in every 32nd row and column of pixels first, then in every fourth: nearly
all that are in view are found there, by a fraction of the rays."""


class OutOfView:
    """Tells which boxes no camera sees.

    A box is in view if a pixel of a camera shows it within the range, in front of the environment.
    Other artefacts do not hide it, because they move. The test is the z-buffer (equation 2) without
    mutual occlusion. Boxes are enlarged by a millimetre, so that rounding errors count as in view.
    Without a viewpoint, every box is hidden.
    """

    def __init__(self, max_range_m: float) -> None:
        self._max_range_m = max_range_m
        self._environment: Environment | None = None
        self._viewpoints: tuple[CameraAt, ...] = ()
        self._buffers: list[tuple[ViewModel, list[ZBuffer]]] = []

    def look(self, environment: Environment, viewpoints: Sequence[CameraAt]) -> None:
        """Set the environment and the viewpoints; nothing is computed before `hides`."""
        self._environment, self._viewpoints = environment, tuple(viewpoints)

    def hides(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell which of N boxes in the map frame no camera sees: bool (N,)."""
        hidden = np.ones(len(boxes), np.bool_)
        if self._environment is None or not self._viewpoints:
            return hidden
        field = VoxelField.of(self._environment.voxels)
        grown = OrientedBoxes(boxes.centres_m, boxes.yaws_rad, boxes.half_sizes_m + _GROWN_M)
        self._buffers = [(point.view, self._buffers_of(point.view)) for point in self._viewpoints]
        for point, (_, buffers) in zip(self._viewpoints, self._buffers, strict=True):
            for buffer in buffers:
                left = np.flatnonzero(hidden)
                in_question = grown.take(left)
                shown = buffer.visibility(point.map_from_camera, in_question, field, mutual=False)
                hidden[left] = shown.visible_pixels == 0
        return hidden

    def _buffers_of(self, view: ViewModel) -> list[ZBuffer]:
        """Return the z-buffers of a view; those of the last call if the view is the same."""
        known = (buffers for other, buffers in self._buffers if other == view)
        return next(known, None) or [ZBuffer(view, self._max_range_m, n) for n in _STRIDES]


Allowed = Callable[[OrientedBoxes], npt.NDArray[np.bool_]]
"""Tells which of N boxes may stand where they are: bool (N,)."""


def check_zones(parameters: Parameters, zones: Zones) -> None:
    """Raise ParameterError if artefacts shall arrive or appear in zones, and none is listed."""
    if parameters.population.region is Region.ZONES and not zones.zones:
        raise ParameterError("population.region is zones, but population.zones lists none")
    if parameters.population.appear is Appear.ZONES and not zones.ways_in:
        raise ParameterError(
            "population.appear is zones, "
            "but population.zones names no file that lists entrances or zones"
        )


class Spawning:
    """Chooses arrival poses in the spawn region of the present environment.

    `region` is None before it is known. `goal` is the footprint at the robot's goal, None if that
    is not known; arrivals keep away from it. `out_of_view` tells what no camera sees.
    """

    def __init__(
        self, parameters: Parameters, footprint: Footprint, terrains: Terrains | None = None
    ) -> None:
        self._terrains = terrains or Terrains()
        self.goal: Footprint | None = None
        self.out_of_view = OutOfView(parameters.occlusion.max_range)
        self._robot_radius_m = footprint.inscribed_radius_m
        zones = parameters.population.zones
        self.zones = read_zones_file(Path(zones)) if zones else Zones()
        self._environment: Environment | None = None
        self._finder: RegionFinder | None = None
        self.region: SpawnRegion | None = None
        self._placer: Placer | None = None
        self._entrances: Placer | None = None
        self.reconfigure(parameters)

    def reconfigure(self, parameters: Parameters) -> None:
        """Use other distances, and another way to appear, from now on; region and zones stay.

        Raises ParameterError as `check_zones`, and changes nothing then.
        """
        check_zones(parameters, self.zones)
        self._population = parameters.population
        self._clearance_m = parameters.robot.clearance

    @property
    def area_m2(self) -> float:
        """The effective area of the region, 0 before it is known."""
        return self.region.area_m2 if self.region else 0.0

    @property
    def doubt_about_region(self) -> str:
        """Where nobody can arrive on a map with free cells, and why; empty if that is as wanted."""
        if self._finder is None:
            return ""
        if self.area_m2 > 0.0:
            idle = self._finder.idle_zones
            where = f"nobody can arrive in {listed(idle)} of population.zones"
            return f"{where}: no free cell of the map is there" if idle else ""
        is_reachable = self._population.region is Region.REACHABLE
        if is_reachable and self._finder.last_point_m is None:
            return (
                "nobody can arrive: the robot stands on no free cell of the map, by its pose in tf;"
                " is it localised? (population.region: free does without its pose)"
            )
        return (
            "nobody can arrive: population.zones leaves no free cell of the map; are its polygons "
            "in the map's frame?"
        )

    @property
    def needs_viewpoints(self) -> bool:
        """Whether arrivals or departures depend on what the cameras see."""
        appear, leave = self._population.appear, self._population.leave
        return appear is Appear.OUT_OF_VIEW or leave is not Leave.VANISH

    def refresh(
        self,
        environment: Environment,
        robot: RobotPose | None,
        viewpoints: Sequence[CameraAt] = (),
    ) -> bool:
        """Update the region and the cameras' views; return whether the region has changed."""
        self.out_of_view.look(environment, viewpoints)
        if self._finder is None or environment is not self._environment:
            self._finder = self._finder_for(environment)
            self._environment = environment
        region = self._finder.at(_point_of(robot))
        if region is self.region:
            return False
        self.region, self._placer = region, Placer(environment, region, self._terrains)
        self._entrances = None
        return True

    def place(
        self,
        row: CatalogueRow,
        generator: np.random.Generator,
        others: OrientedBoxes,
        robot: RobotPose | None,
        near: tuple[float, float] | None,
        preferred: Allowed | None = None,
        *,
        appears: bool = True,
    ) -> GroundPose | Cause:
        """Draw a pose for an artefact, near the first of its group; the cause where none is free.

        Poses whose boxes `preferred` refuses are used only if there are no others. One that does
        not appear, as it has been there for long, is anywhere in the region.
        """
        placer = self._placer_to_use() if appears else self._placer
        if placer is None:
            return Cause.NO_PLACE
        shapes = ([robot.footprint] if robot else []) + ([self.goal] if self.goal else [])
        keep_out = tuple((shape, self._clearance_m) for shape in shapes)
        within = None if near is None else (*near, self._population.group_radius)
        refused = set[str]()

        def allowed(boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
            passed = np.ones(len(boxes), np.bool_)
            for name, test in tests.items():
                passed[passed] = now = test(boxes.take(passed))
                if not now.all():
                    refused.add(name)
            return passed

        tests = dict[str, Allowed]()
        if appears and self._population.appear is Appear.OUT_OF_VIEW:
            tests["hidden"] = self.out_of_view.hides
        if preferred is not None:
            tests["preferred"] = preferred
        around = PlacementConstraints(others, keep_out, allowed if tests else None, within)
        pose = placer.place(row, generator, around)
        if pose is None and "preferred" in refused:
            del tests["preferred"]
            pose = placer.place(row, generator, around)
        return pose or (Cause.NO_HIDDEN_PLACE if "hidden" in refused else Cause.NO_PLACE)

    def fits(self, row: CatalogueRow, generator: np.random.Generator) -> bool:
        """Tell whether an artefact would find a place in the region on the empty map."""
        return self._placer is not None and self._placer.place(row, generator) is not None

    def why_not(
        self,
        box: OrientedBoxes,
        environment: Environment,
        others: OrientedBoxes,
        robot: RobotPose | None,
        clearance_m: float | None = None,
    ) -> str:
        """Return why a box of length one cannot stand where it is, empty if it can."""
        if not environment.is_placeable(box)[0]:
            return "it would stand in a wall, or not on free cells only"
        if overlaps_any(box, others)[0]:
            return "it would overlap another artefact"
        least_m = self._clearance_m if clearance_m is None else clearance_m
        if robot is not None and signed_distance_m(robot.footprint, box)[0] < least_m:
            if least_m <= 0.0:
                return "it would overlap the robot"
            return f"it would be nearer to the robot than robot.clearance, {least_m} m"
        return ""

    def _placer_to_use(self) -> Placer | None:
        """Return the placer of the region or, where artefacts appear there, of the entrances."""
        environment, region = self._environment, self.region
        if environment is None or region is None or self._population.appear is not Appear.ZONES:
            return self._placer
        if self._entrances is None:
            ways_in = self._entrance_region(environment, region)
            self._entrances = Placer(environment, ways_in, self._terrains)
        return self._entrances

    def _entrance_region(self, environment: Environment, region: SpawnRegion) -> SpawnRegion:
        """Return the entrances within the region; if the region is zones, within free space."""
        mask = region.mask
        if self._population.region is Region.ZONES:
            mask = self.zones.allowed(environment.classes.free, environment.grid)
        return region_of_zones(self.zones.ways_in, mask, environment.grid)

    def _finder_for(self, environment: Environment) -> RegionFinder:
        return region_finder(
            self._population.region,
            environment.grid,
            environment.classes.free,
            environment.clearance_m,
            self._robot_radius_m,
            zones=self.zones,
            last_point_m=self._finder.last_point_m if self._finder else None,
        )


def _point_of(robot: RobotPose | None) -> tuple[float, float] | None:
    if robot is None:
        return None
    x_m, y_m, _ = robot.map_from_base.translation_m.tolist()
    return x_m, y_m
