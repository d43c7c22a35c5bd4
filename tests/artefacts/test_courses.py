"""Where everybody is going: numbers that are used again, arrays that are let go."""

import gc
import weakref

import numpy as np

from are_ros.artefacts.catalogue import CatalogueRow, MotionLimits
from are_ros.artefacts.coarse_map import CoarseMap
from are_ros.artefacts.courses import Courses
from are_ros.artefacts.mdp import TravelModel
from are_ros.artefacts.motion.body import Body
from are_ros.artefacts.shapes import Shape
from are_ros.artefacts.traveller import Traveller
from are_ros.artefacts.value_tables import ValueTable, ValueTables
from tests.artefacts.floors import terrain_of, two_rooms

WALK = MotionLimits(1.3, 1.5, 3.0, 0.0, 1.8)
ROW = CatalogueRow(0, "one", "person", (0.3, 0.5, 1.7), (0, 0, 0), Shape.PERSON, motion=WALK)
GOAL_M = (2.0, 2.0)


def coarse_map() -> CoarseMap:
    """Return two small rooms for a person."""
    return CoarseMap(terrain_of(two_rooms(60, 64, slice(30, 34), slice(20, 40))), 0.25)


def table_of(coarse: CoarseMap) -> ValueTable:
    """Return a table of its own, of going to the goal."""
    found = ValueTables(10).value(coarse, TravelModel(reach=3), GOAL_M)
    assert found is not None
    return found


def test_who_sets_out_keeps_its_number_and_who_comes_gets_one_that_is_free() -> None:
    """A list as long as the most that there ever were at once, and one."""
    courses, coarse, kind = Courses(), coarse_map(), Traveller.of(ROW, Body.of(ROW))
    table = table_of(coarse)

    def set_out(artefact_id: int, speed_mps: float = 1.0) -> int:
        return courses.set_out(artefact_id, (kind, GOAL_M, speed_mps), coarse, table).number

    assert [set_out(i) for i in (7, 3, 9)] == [1, 2, 3]
    assert set_out(3, 1.2) == 2
    courses.forget(7)
    courses.forget(3)
    courses.forget(55)
    assert sorted((set_out(5), set_out(6))) == [1, 2]
    assert set_out(7) == 4
    assert len(courses.arrays) == 5
    assert courses.get(3) is None
    found = courses.get(5)
    assert found is not None
    assert found[:3] == (kind, GOAL_M, 1.0)
    planes = courses.arrays[found.number][1][0]
    np.testing.assert_array_equal(planes, table.planes)
    courses.clear()
    assert courses.get(5) is None
    assert set_out(8) == 1


def test_values_that_nobody_goes_by_are_let_go() -> None:
    """When one sets out to somewhere else, when it is forgotten, and when all are."""
    coarse, kind = coarse_map(), Traveller.of(ROW, Body.of(ROW))
    wanted = (kind, GOAL_M, 1.0)
    for ends in ("another", "forget", "clear"):
        courses, table = Courses(), table_of(coarse)
        planes = table.planes
        while isinstance(planes.base, np.ndarray):
            planes = planes.base
        owner = weakref.ref(planes)
        courses.set_out(1, wanted, coarse, table)
        del table, planes
        gc.collect()
        assert owner() is not None
        if ends == "another":
            courses.set_out(1, wanted, coarse, table_of(coarse))
        elif ends == "forget":
            courses.forget(1)
        else:
            courses.clear()
        gc.collect()
        assert owner() is None
