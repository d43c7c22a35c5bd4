"""The ring search: nearest first, in a fixed order, on free cells only."""

import numpy as np
import pytest

from are_ros.agents.collisions import RingSearch
from are_ros.conventions import OCCUPIED, UNKNOWN
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.footprint import Footprint
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform


def _environment(*columns: tuple[int, int, int]) -> Environment:
    """Return 10 m x 10 m of free cells, but for columns (first, last + 1, value)."""
    cells = np.zeros((100, 100), dtype=np.int8)
    for first, last, value in columns:
        cells[:, first:last] = value
    grid = OccupancyGrid(cells, 0.1, RigidTransform.identity(), "map")
    return Environment(grid, classify(grid, 65, 25), None, PlaneGround(0.5), 0.06)


def _box(x: float, y: float, yaw: float = 0.0) -> OrientedBoxes:
    return OrientedBoxes(np.array([[x, y, 1.5]]), np.array([yaw]), np.array([[0.2, 0.2, 1.0]]))


def test_the_first_ring_from_the_x_axis_on_is_tried_first() -> None:
    """With room everywhere the box moves 0.1 m along +x; it keeps its heading, on the ground."""
    found = RingSearch(2.0).nearest(_box(5, 5, 0.3), OrientedBoxes.empty(), None, _environment())
    assert found is not None
    offset_m, box = found
    assert offset_m == pytest.approx([0.1, 0.0])
    assert box.centres_m[0] == pytest.approx([5.1, 5.0, 1.5])
    assert box.yaws_rad[0] == 0.3


def test_a_new_wall_is_left_on_the_nearer_side() -> None:
    """A wall from x = 4.9 to 5.5 over a box at 5.0 of 0.4 m: left to 4.7, not right to 5.7."""
    found = RingSearch(2.0).nearest(
        _box(5.0, 5.0), OrientedBoxes.empty(), None, _environment((49, 55, OCCUPIED))
    )
    assert found is not None
    assert found[0] == pytest.approx([-0.3, 0.0], abs=0.02)


def test_nobody_is_pushed_into_the_unknown() -> None:
    """The unknown is no wall, but no place either: the nearest free one is further."""
    environment = _environment((0, 49, UNKNOWN), (49, 55, OCCUPIED))
    found = RingSearch(2.0).nearest(_box(5.0, 5.0), OrientedBoxes.empty(), None, environment)
    assert found is not None
    assert found[0][0] >= 0.7 - 1e-9


def test_others_and_the_robot_are_avoided() -> None:
    """Between another box on the right and a robot on the left, the way is up."""
    robot = Footprint.disc(0.5).at(4.5, 5.0, 0.0)
    found = RingSearch(2.0).nearest(_box(5.0, 5.0), _box(5.25, 5.0), robot, _environment())
    assert found is not None
    assert found[0][1] > 0.2


def test_where_the_robot_is_about_to_be_is_avoided_if_there_is_another_place() -> None:
    """Aside of its way, though ahead is nearer; ahead where walls leave no place aside."""
    robot, ahead = (
        Footprint.disc(0.3).at(4.6, 5.0, 0.0),
        Footprint(np.array([[4.6, 5], [6, 5]]), 0.3),
    )
    search, nobody = RingSearch(0.7), OrientedBoxes.empty()
    onward = search.nearest(_box(5.0, 5.0), nobody, robot, _environment())
    aside = search.nearest(_box(5.0, 5.0), nobody, robot, _environment(), ahead)
    assert onward is not None
    assert aside is not None
    assert onward[0] == pytest.approx([0.1, 0.0])
    assert abs(aside[0][1]) >= 0.5 - 1e-9
    cells = np.full((100, 100), OCCUPIED, np.int8)
    cells[46:54] = 0
    grid = OccupancyGrid(cells, 0.1, RigidTransform.identity(), "map")
    aisle = Environment(grid, classify(grid, 65, 25), None, PlaneGround(0.5), 0.06)
    pushed = search.nearest(_box(5.0, 5.0), nobody, robot, aisle, ahead)
    assert pushed is not None
    assert pushed[0] == pytest.approx([0.1, 0.0])


def test_without_room_nothing_is_found() -> None:
    """All occupied within the radius, or a radius of zero: none."""
    environment = _environment((20, 80, OCCUPIED))
    assert RingSearch(2.0).nearest(_box(5, 5), OrientedBoxes.empty(), None, environment) is None
    assert RingSearch(0.0).nearest(_box(5, 5), OrientedBoxes.empty(), None, environment) is None
