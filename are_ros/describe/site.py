"""The site of a description: the area of a map, its region, and the rows that fit there."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.assembly import robot_footprint
from are_ros.builder.real_world import RealWorld
from are_ros.builder.spawning.placement import Placer
from are_ros.builder.spawning.spawner import check_zones
from are_ros.parameters.choices import Region
from are_ros.parameters.model import Parameters
from are_ros.population.catalogue import Catalogue
from are_ros.population.randomness import Purpose, generator
from are_ros.wording import listed, percent
from are_ros.world.environment import Environment
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.regions import SpawnRegion, Zones, read_zones_file, region_finder
from are_ros.world.transforms.tree import FrameTree

UNIT_AREA_M2: Final = 100.0
"""The area that figures refer to without a map."""
_WIDEST: Final = 100
"""So many characters of the labels that fit nowhere are shown."""


@dataclass(frozen=True, eq=False)
class Survey:
    """A map as an environment, and the region on it: the largest of `parts` parts."""

    environment: Environment
    region: SpawnRegion
    parts: int


@dataclass(frozen=True, eq=False)
class Site:
    """An area [m^2] on which artefacts arrive; without a survey it is free of obstacles.

    `misfits` are the indices of the rows that find no place even on the empty map.
    """

    area_m2: float = UNIT_AREA_M2
    survey: Survey | None = None
    misfits: frozenset[int] = frozenset()


def surveyed(grid: OccupancyGrid, parameters: Parameters, catalogue: Catalogue) -> Site:
    """Return the site of a map; ParameterError where zones are missing or bad.

    Where the region is what the robot can reach it is taken to start in the largest part.
    """
    world = RealWorld(parameters.world, parameters.frames.map, FrameTree())
    world.set_grid(grid)
    environment = world.environment
    assert environment is not None, "a grid makes an environment"  # noqa: S101 - for the type
    survey = _survey(environment, parameters)
    placer = Placer(environment, survey.region)
    unplaced = (
        row.index
        for row in catalogue.rows
        if placer.place(row, generator(parameters.seed, Purpose.PLACE, 0)) is None
    )
    return Site(survey.region.area_m2, survey, frozenset(unplaced))


def site_rows(
    site: Site, parameters: Parameters, catalogue: Catalogue, probabilities: npt.NDArray[np.float64]
) -> list[tuple[str, str]]:
    """Return the rows on the map, the region, and the artefacts that do not fit there."""
    rate = f"{parameters.population.arrival_rate:g} arrivals/(m^2 s)"
    kind = parameters.population.region
    if site.survey is None:
        return [("region", f"{kind.value} space, {rate}")]
    region = _region_text(site.survey, kind, site.area_m2)
    rows = [
        ("map", _map_text(site.survey.environment)),
        ("region", f"{region}, {rate}" if site.area_m2 else f"{region}: nobody can arrive"),
    ]
    if site.misfits:
        rows += _misfit_rows(site, catalogue, probabilities)
    return rows


def _survey(environment: Environment, parameters: Parameters) -> Survey:
    settings = parameters.population
    radius_m = robot_footprint(parameters.robot).inscribed_radius_m
    zones = read_zones_file(Path(settings.zones)) if settings.zones else Zones()
    check_zones(parameters, zones)
    finder = region_finder(
        settings.region,
        environment.grid,
        environment.classes.free,
        environment.clearance_m,
        radius_m,
        zones=zones,
    )
    if settings.region is not Region.REACHABLE:
        return Survey(environment, finder.at(None), 1)
    parts, point_m = _largest_part(environment, radius_m)
    return Survey(environment, finder.at(point_m), parts)


def _largest_part(
    environment: Environment, radius_m: float
) -> tuple[int, tuple[float, float] | None]:
    """Return how many parts there are that a robot can drive in, and a point of the largest."""
    import cv2

    is_open = (environment.clearance_m >= radius_m) & environment.classes.free
    labels = np.asarray(cv2.connectedComponents(is_open.view(np.uint8), connectivity=4)[1])
    sizes = np.bincount(labels.ravel())[1:]
    if not len(sizes):
        return 0, None
    cell = np.argwhere(labels == 1 + int(np.argmax(sizes)))[:1]
    x_m, y_m = environment.grid.cells_to_points(cell)[0].tolist()
    return len(sizes), (x_m, y_m)


def _map_text(environment: Environment) -> str:
    grid, classes = environment.grid, environment.classes
    free_m2 = int(classes.free.sum()) * grid.cell_area_m2
    occupied_m2 = int(classes.occupied.sum()) * grid.cell_area_m2
    cells = f"{grid.width} x {grid.height} cells of {grid.resolution_m:g} m"
    return f"{cells}: {free_m2:.4g} m^2 free, {occupied_m2:.4g} m^2 occupied"


def _region_text(survey: Survey, kind: Region, area_m2: float) -> str:
    if kind is Region.ZONES:
        covered_m2 = int(survey.region.mask.sum()) * survey.environment.grid.cell_area_m2
        return f"zones of {covered_m2:.4g} m^2, by their weights {area_m2:.4g} m^2"
    if kind is Region.FREE:
        return f"all free space, {area_m2:.4g} m^2"
    if not survey.parts:
        return "reachable space: the robot fits nowhere"
    if survey.parts == 1:
        return f"reachable space, {area_m2:.4g} m^2"
    return f"reachable space: the largest of {survey.parts} parts, {area_m2:.4g} m^2"


def _misfit_rows(
    site: Site, catalogue: Catalogue, probabilities: npt.NDArray[np.float64]
) -> list[tuple[str, str]]:
    rows = [row.index for row in catalogue.rows if row.index in site.misfits]
    noun = "row fits" if len(rows) == 1 else "rows fit"
    share = percent(float(probabilities[rows].sum()))
    text = f"{len(rows)} {noun} nowhere in the region: {share} of arrivals blocked"
    labels = list(dict.fromkeys(catalogue.rows[index].label for index in rows))
    named, kept = listed(labels), len(labels)
    while len(named) > _WIDEST and kept > 1:
        kept -= 1
        named = listed([*labels[:kept], f"{len(labels) - kept} more"])
    return [("too large", text), ("", named)]
