"""Goals as records: what kernels read is what was written."""

from dataclasses import replace

import numpy as np
import pytest

from are_ros.agents.mdp.coarse_map import CoarseMap
from are_ros.agents.mdp.model import TravelModel
from are_ros.agents.mdp.value_tables import ValueTables
from are_ros.agents.navigation.goal_records import (
    GoalSpec,
    goal_record,
    goals_of,
    ground_at,
    record_with_plane,
    spec_at,
    values_at,
)
from tests.agents.floors import terrain_of, two_rooms

SPEC = GoalSpec(0.25, (8.0, 9.0), (8.1, 9.2), 0.4, 0.7)
MODEL = TravelModel(reaches=(2, 4), effort=(0.0, 0.1), slip=0.1, rest=0.05)


def coarse_map() -> CoarseMap:
    """Return a coarse map of two rooms."""
    return CoarseMap(terrain_of(two_rooms(80, 120, slice(58, 62), slice(30, 50))), 0.25)


def test_kernels_read_what_was_written() -> None:
    """All fields of two goals with windows of other sizes, in one array."""
    coarse, tables = coarse_map(), ValueTables(10)
    found = [tables.value(coarse, MODEL, goal_m) for goal_m in ((1.0, 1.0), (5.0, 3.0))]
    whole = [table.value_arrays for table in found if table is not None]
    cut = whole[1]._replace(corner=(3, 4), costs=whole[1].costs[:5].copy())
    cut = cut._replace(
        planes=cut.planes[:, :, :5].copy(),
        settled=cut.settled[:5].copy(),
        lengths=cut.lengths[:, :5].copy(),
    )
    written = [whole[0], cut]
    specs = [SPEC, SPEC._replace(radius_m=0.3)]
    records = [goal_record(coarse.ground, *one) for one in zip(written, specs, strict=True)]
    for goal, values, spec in zip(goals_of(records), written, specs, strict=True):
        assert spec_at(goal) == spec
        for read, field in zip(values_at(goal), values, strict=True):
            np.testing.assert_array_equal(read, field)
        for ground, ground_field in zip(ground_at(goal), coarse.ground, strict=True):
            np.testing.assert_array_equal(ground, ground_field)


def test_one_plane_takes_the_place_of_all() -> None:
    """The values are those of the plane, for whatever epoch, and all of them are settled."""
    coarse = coarse_map()
    table = ValueTables(10).value(coarse, MODEL, (1.0, 1.0))
    assert table is not None
    plane = table.planes[3].copy()
    record = goal_record(coarse.ground, table.value_arrays, SPEC)
    read = values_at(goals_of([record_with_plane(record, plane)])[0])
    np.testing.assert_array_equal(read.planes, plane[None])
    assert not read.settled.size
    np.testing.assert_array_equal(read.costs, table.costs)


def test_arrays_with_gaps_are_refused() -> None:
    """Their numbers do not lie in a row."""
    coarse = coarse_map()
    table = ValueTables(10).value(coarse, MODEL, (1.0, 1.0))
    assert table is not None
    gaps = replace(table, costs=np.asfortranarray(table.costs)).value_arrays
    with pytest.raises(ValueError, match="not contiguous"):
        goal_record(coarse.ground, gaps, SPEC)
