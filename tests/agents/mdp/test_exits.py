"""Exits: the middles of polygons, or the openings of the map that a person can go out by."""

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from are_ros.agents.mdp.exits import exits_of
from are_ros.parameters.choices import Region
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.map_io import read_map_file
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.regions import Zone, Zones, region_finder
from are_ros.world.rigid_transform import RigidTransform

Floats = npt.NDArray[np.float64]

BLOCK_M = 0.5
"""A character of a picture is 5 x 5 cells of 0.1 m; the first line is the lowest row."""
VALUES = {".": 0, "#": 100, "?": -1}
NO_ZONES = Zones()

HOUSE = """
##########
#........#
#........#
#.........
#.........
#........#
####..####
???#..#???
???????###
???????###
"""
"""A room of 4 x 2.5 m; a door of 1 m to the grid's border, a passage up into the unknown."""


def _environment(picture: str, origin: RigidTransform | None = None) -> Environment:
    lines = picture.split()
    blocks = np.array([[VALUES[mark] for mark in line] for line in lines], np.int8)
    cells = np.kron(blocks, np.ones((5, 5), np.int8))
    return _of(OccupancyGrid(cells, BLOCK_M / 5, origin or RigidTransform.identity(), "map"))


def _of(grid: OccupancyGrid) -> Environment:
    return Environment(grid, classify(grid, 65, 25), None, PlaneGround(0.0), 0.01)


def _exits(environment: Environment, zones: Zones = NO_ZONES) -> Floats:
    """Return the exits of all free space, having seen that people can stand at each."""
    exits = exits_of(environment, environment.classes.free, zones)
    assert exits.shape == (len(exits), 2)
    assert (environment.lookup(exits) >= 0.3).all()
    return exits


def _zone(*corners: tuple[float, float]) -> Zone:
    return Zone("", np.array(corners))


def test_openings_are_at_the_border_and_next_to_the_unknown() -> None:
    """The door's point and the passage's, each in the middle and just inside."""
    exits = _exits(_environment(HOUSE))
    np.testing.assert_allclose(exits, [(4.7, 2.0), (2.5, 3.7)], atol=0.11)


def test_openings_turn_with_the_map() -> None:
    """On a turned and shifted grid the same points come out, turned and shifted."""
    origin = RigidTransform.planar(3.0, -2.0, 0.8)
    plain = _exits(_environment(HOUSE))
    turned = _exits(_environment(HOUSE, origin))
    upright = np.column_stack((plain, np.zeros(len(plain))))
    np.testing.assert_allclose(turned, origin.apply(upright)[:, :2], atol=1e-9)


def test_a_gap_narrower_than_a_person_is_no_exit() -> None:
    """Half a metre lets nobody through, but somebody of 0.4 m."""
    environment = _environment(HOUSE.replace("#.........\n#........#", "#........#\n#........#"))
    np.testing.assert_allclose(_exits(environment), [(2.5, 3.7)], atol=0.11)
    free = environment.classes.free
    assert len(exits_of(environment, free, NO_ZONES, width_m=0.4)) == 2


@pytest.mark.parametrize(("pocket", "is_exit"), [("?", False), ("????????", True)])
def test_a_small_gap_in_the_map_leads_nowhere(pocket: str, is_exit: bool) -> None:
    """A hole of 0.5 m x 1 m that nobody has seen is no way out; a large part of a hall is."""
    line = f"#{pocket:.<12}#\n"
    picture = "##############\n" + "#............#\n" * 3 + 3 * line + "##############\n"
    assert bool(len(_exits(_environment(picture)))) == is_exit


def test_a_wide_opening_has_several_points() -> None:
    """A floor of 20 m x 6 m that the map cuts off all around has exits all around."""
    exits = _exits(_environment((40 * "." + "\n") * 12))
    apart = np.hypot(*(exits[:, None] - exits[None]).transpose(2, 0, 1))
    assert 20 <= len(exits) <= 35
    assert apart[~np.eye(len(exits), dtype=np.bool_)].min() > 0.75
    to_border = np.minimum(exits, (20.0, 6.0) - exits).min(axis=1)
    assert to_border.max() < 0.5


def test_openings_of_other_parts_than_the_region_are_none() -> None:
    """Of two rooms with a door each, only the region's counts; an empty region has none."""
    environment = _environment("##..###..##\n#....#....#\n#....#....#\n#....#....#\n###########")
    left = environment.classes.free.copy()
    left[:, 25:] = False
    np.testing.assert_allclose(exits_of(environment, left, NO_ZONES), [(1.5, 0.3)], atol=0.11)
    assert len(_exits(environment)) == 2
    assert exits_of(environment, np.zeros_like(left), NO_ZONES).shape == (0, 2)


def test_polygons_come_first() -> None:
    """Exits, else entrances; zones are neither, and then the openings are."""
    environment = _environment(HOUSE)
    corner = _zone((0.5, 0.5), (1.5, 0.5), (1.5, 1.5), (0.5, 1.5))
    middle = _zone((2.0, 1.0), (3.0, 1.0), (3.0, 2.0), (2.0, 2.0))
    both = Zones(entrances=(corner,), exits=(middle,))
    np.testing.assert_allclose(_exits(environment, both), [(2.5, 1.5)], atol=0.11)
    entrances = Zones(entrances=(corner, middle))
    expected = [(1.0, 1.0), (2.5, 1.5)]
    np.testing.assert_allclose(_exits(environment, entrances), expected, atol=0.11)
    np.testing.assert_array_equal(_exits(environment, Zones(zones=(middle,))), _exits(environment))


def test_the_middle_of_a_polygon_is_moved_to_where_one_can_stand() -> None:
    """In a polygon that is half wall, or bent about its middle; one in a wall is left out."""
    environment = _environment(HOUSE)
    wall = _zone((0.0, 0.0), (5.0, 0.0), (5.0, 0.4), (0.0, 0.4))
    half = _zone((2.0, 2.6), (3.0, 2.6), (3.0, 3.4), (2.0, 3.4))
    bent = _zone((0.5, 0.5), (4.5, 0.5), (4.5, 3.0), (4.0, 3.0), (4.0, 1.0), (0.5, 1.0))
    exits = _exits(environment, Zones(exits=(wall, half, bent)))
    assert len(exits) == 2
    assert np.hypot(*(exits[0] - (2.5, 3.0))) < 0.1
    assert exits[1, 0] > 4.0 or exits[1, 1] < 1.0
    assert _exits(environment, Zones(exits=(wall,))).shape == (0, 2)


def test_a_polygon_keeps_to_the_region_as_far_as_it_can() -> None:
    """Its middle is not in the region, a corner is; without the corner its middle will do."""
    environment = _environment(HOUSE)
    region = environment.classes.free.copy()
    region[:, 15:] = False
    across = Zones(exits=(_zone((1.0, 1.0), (4.0, 1.0), (4.0, 2.0), (1.0, 2.0)),))
    exits = exits_of(environment, region, across)
    np.testing.assert_allclose(exits, [(1.45, 1.5)], atol=0.11)
    beyond = Zones(exits=(_zone((2.0, 1.0), (4.0, 1.0), (4.0, 2.0), (2.0, 2.0)),))
    np.testing.assert_allclose(exits_of(environment, region, beyond), [(3.0, 1.5)], atol=0.11)


MAPS = {
    "tb3_sandbox": "nav2-maps/tb3_sandbox.yaml",
    "depot": "nav2-maps/depot.yaml",
    "jarvis": "drl-jarvis-hall/i-108_10mm.yaml",
    "warehouse": "nav2-maps/warehouse.yaml",
}
INSIDE = {"tb3_sandbox": (-2.0, -0.5), "depot": (6.0, 7.0), "jarvis": (8.0, 4.0)}


def _reachable(environment: Environment, point_m: tuple[float, float]) -> npt.NDArray[np.bool_]:
    finder = region_finder(
        Region.REACHABLE, environment.grid, environment.classes.free, environment.clearance_m, 0.22
    )
    mask = finder.at(point_m).mask
    assert mask.any()
    return mask


@pytest.mark.parametrize("name", list(INSIDE))
def test_rooms_that_are_closed_all_around_have_no_exits(real_data: Path, name: str) -> None:
    """Walls with holes of some cells, pillars with the unknown inside, free cells outside."""
    environment = _of(read_map_file(real_data / MAPS[name]))
    region = _reachable(environment, INSIDE[name])
    assert exits_of(environment, region, NO_ZONES).shape == (0, 2)


def test_the_alcoves_of_the_hall_open_to_the_maps_border(real_data: Path) -> None:
    """Two of them, closed off from the hall; there is an exit in the middle of each."""
    environment = _of(read_map_file(real_data / MAPS["jarvis"]))
    np.testing.assert_allclose(_exits(environment), [(1.4, 0.3), (13.4, 0.3)], atol=0.05)


def test_a_warehouse_is_left_through_its_gates(real_data: Path) -> None:
    """By its long open side and by the gap in the corner, not into racks or through their legs."""
    environment = _of(read_map_file(real_data / MAPS["warehouse"]))
    exits = _exits(environment)
    assert 8 <= len(exits) <= 12
    assert (exits[:-1, 1] < -24.6).all()
    np.testing.assert_allclose(exits[-1], (-14.4, 24.9), atol=0.1)


def test_a_depot_cut_in_two_is_left_where_it_was_cut(real_data: Path) -> None:
    """All along the cut, but where a shelf stands on it; each point is less than 1 m inside."""
    whole = read_map_file(real_data / MAPS["depot"])
    grid = OccupancyGrid(
        np.ascontiguousarray(whole.cells[:, :300]), whole.resolution_m, whole.origin, "map"
    )
    environment = _of(grid)
    region = _reachable(environment, (6.0, 7.0))
    exits = exits_of(environment, region, NO_ZONES)
    cells = grid.points_to_cells(exits)
    assert 4 <= len(exits) <= 9
    assert region[cells[:, 0], cells[:, 1]].all()
    assert (300 - cells[:, 1]).max() * grid.resolution_m < 1.0
    assert math.dist(exits[0], exits[1]) > 1.0
    np.testing.assert_array_equal(exits_of(environment, region, NO_ZONES), exits)
