"""Tests of the survey of a map: its areas, its region, and who fits nowhere."""

from collections.abc import Callable
from pathlib import Path

import pytest

from are_ros.describe.configuration import describe_lines, staying_share
from are_ros.describe.site import Site, surveyed
from are_ros.errors import ParameterError
from are_ros.parameters.model import Parameters
from are_ros.population.catalogue import Catalogue
from are_ros.population.mixture import mixture_of
from are_ros.world.occupancy_grid import OccupancyGrid

GridOf = Callable[[str], OccupancyGrid]
ParametersOf = Callable[..., Parameters]

TWO_ROOMS = """
#########
#....#..#
#....#..#
#....#..#
####### #
"""


def _text(parameters: Parameters, catalogue: Catalogue, site: Site) -> str:
    return "\n".join(describe_lines(parameters, catalogue, site))


def test_reachable_space_is_the_largest_part(
    grid_of: GridOf, parameters_of: ParametersOf, catalogue: Catalogue
) -> None:
    """Where the robot starts is not known: the larger of two rooms is taken, and that is said."""
    parameters = parameters_of()
    site = surveyed(grid_of(TWO_ROOMS), parameters, catalogue)
    assert site.area_m2 == pytest.approx(12 * 0.25)
    text = _text(parameters, catalogue, site)
    assert "Population on 3 m^2\n" in text
    assert "9 x 5 cells of 0.5 m: 4.5 m^2 free, 6.5 m^2 occupied" in text
    assert "reachable space: the largest of 2 parts, 3 m^2, 0.0005 arrivals/(m^2 s)" in text


def test_one_part_is_not_called_the_largest(
    grid_of: GridOf, parameters_of: ParametersOf, catalogue: Catalogue
) -> None:
    """A map of one room is its region."""
    parameters = parameters_of()
    text = _text(parameters, catalogue, surveyed(grid_of("...\n..."), parameters, catalogue))
    assert "region         reachable space, 1.5 m^2, " in text


def test_a_map_without_free_space_is_said(
    grid_of: GridOf, parameters_of: ParametersOf, catalogue: Catalogue
) -> None:
    """All of it is wall: nobody can arrive."""
    parameters = parameters_of(population__region="free")
    text = _text(parameters, catalogue, surveyed(grid_of("##\n##"), parameters, catalogue))
    assert "all free space, 0 m^2: nobody can arrive" in text


def test_a_robot_that_fits_nowhere_has_no_region(
    grid_of: GridOf, parameters_of: ParametersOf, catalogue: Catalogue
) -> None:
    """A robot of 3 m finds no room on 2 m: nobody arrives, and the reason is said."""
    parameters = parameters_of(robot__radius=1.5)
    site = surveyed(grid_of("....\n....\n....\n...."), parameters, catalogue)
    text = _text(parameters, catalogue, site)
    assert site.area_m2 == 0.0
    assert "reachable space: the robot fits nowhere: nobody can arrive" in text
    assert "arrivals       none" in text


def test_all_free_space(grid_of: GridOf, parameters_of: ParametersOf, catalogue: Catalogue) -> None:
    """With region free both rooms count."""
    parameters = parameters_of(population__region="free")
    site = surveyed(grid_of(TWO_ROOMS), parameters, catalogue)
    assert site.area_m2 == pytest.approx(18 * 0.25)
    assert "all free space, 4.5 m^2" in _text(parameters, catalogue, site)


def test_zones_count_by_their_weights(
    grid_of: GridOf, parameters_of: ParametersOf, catalogue: Catalogue, tmp_path: Path
) -> None:
    """A zone of weight 3 has its cells' area three times; without a file it is refused."""
    zones = tmp_path / "zones.yaml"
    zones.write_text(
        "zones: [{polygon: [[0.5, 0.5], [1.5, 0.5], [1.5, 1.5], [0.5, 1.5]], weight: 3}]"
    )
    parameters = parameters_of(population__region="zones", population__zones=str(zones))
    site = surveyed(grid_of(TWO_ROOMS), parameters, catalogue)
    assert site.area_m2 == pytest.approx(3.0)
    text = _text(parameters, catalogue, site)
    assert "zones of 1 m^2, by their weights 3 m^2" in text
    with pytest.raises(ParameterError, match="zones"):
        surveyed(grid_of(TWO_ROOMS), parameters_of(population__region="zones"), catalogue)
    zones.write_text("exits: [{polygon: [[0.5, 0.5], [1.5, 0.5], [1.5, 1.5]]}]")
    nowhere = parameters_of(population__appear="zones", population__zones=str(zones))
    with pytest.raises(ParameterError, match="names no file that lists entrances or zones"):
        surveyed(grid_of(TWO_ROOMS), nowhere, catalogue)


def test_who_fits_nowhere_is_blocked_always(
    grid_of: GridOf, parameters_of: ParametersOf, catalogue: Catalogue
) -> None:
    """A van of 5 m in a room of 2 m: its share of arrivals is blocked, and the law is without."""
    parameters = parameters_of()
    site = surveyed(grid_of(TWO_ROOMS), parameters, catalogue)
    probabilities = mixture_of(parameters, catalogue).probabilities()
    assert site.misfits == {2}
    assert staying_share(probabilities, catalogue, site) == pytest.approx(1.0 - probabilities[2])
    percent = f"{100.0 * probabilities[2]:.1f} %"
    text = _text(parameters, catalogue, site)
    assert f"1 row fits nowhere in the region: {percent} of arrivals blocked" in text
    assert catalogue.rows[2].label in text
    load = 0.0005 * 3.0 * 60.0 * (1.0 - probabilities[2])
    assert f"Poisson({load:.3g})" in text
