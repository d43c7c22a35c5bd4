"""The grids that go out: on change, at most so often, and losing nothing."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from are_ros.builder.costmap.augmented_map import GridAugmentation, Grids
from are_ros.builder.costmap.inflation import InflatedCostmap
from are_ros.builder.costmap.registration import CellPatch
from are_ros.conventions import OCCUPIED
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform

MS = 1_000_000


def environment(cells: Any) -> Environment:
    """Return the environment of some cells of 0.1 m, on a turned origin."""
    array = np.array(cells, dtype=np.int8)
    grid = OccupancyGrid(array, 0.1, RigidTransform.planar(1.0, 2.0, 0.3), "map", 5)
    return Environment(grid, classify(grid, 65, 25), None, PlaneGround(0.0), 0.01)


def patch(row0: int, col0: int, rows: int = 1, cols: int = 1) -> CellPatch:
    """Return a full patch."""
    return CellPatch.of(row0, col0, np.ones((rows, cols), dtype=np.bool_))


@pytest.fixture
def grids() -> GridAugmentation:
    """Return grids that may go out ten times a second, inflated by one cell."""
    return GridAugmentation(InflatedCostmap(0.1, 3.0, 0.05), 10.0)


FREE = environment(np.zeros((6, 6)))


def sent(result: Grids) -> tuple[bool, bool, bool]:
    """Return which of map, update and costmap went out."""
    return (result.augmented_map is not None, result.update is not None, result.costmap is not None)


def test_the_first_tick_gives_the_map_and_nothing_after_it(grids: GridAugmentation) -> None:
    """Geometry, frame and bytes are the real map's; the stamp is the tick's."""
    real = environment(np.arange(36).reshape(6, 6) - 1)
    first = grids.update(7, real, {})
    assert sent(first) == (True, False, True)
    assert first.augmented_map is not None
    assert first.augmented_map.cells.tobytes() == real.grid.cells.tobytes()
    assert first.augmented_map.origin is real.grid.origin
    assert (first.augmented_map.frame_id, first.augmented_map.stamp_ns) == ("map", 7)
    assert first.augmented_map.resolution_m == 0.1
    assert sent(grids.update(200 * MS, real, {})) == (False, False, False)


def test_a_change_goes_out_with_its_rectangle(grids: GridAugmentation) -> None:
    """Only the cells that changed, as they now are."""
    grids.update(0, FREE, {})
    result = grids.update(100 * MS, FREE, {1: patch(2, 3, 2, 1)})
    assert sent(result) == (True, True, True)
    assert result.update is not None
    where = result.update.rectangle
    assert (where.row0, where.col0, where.height, where.width) == (2, 3, 2, 1)
    assert result.update.cells.tolist() == [[OCCUPIED], [OCCUPIED]]
    assert (result.update.frame_id, result.update.stamp_ns) == ("map", 100 * MS)


def test_a_move_that_comes_too_early_is_kept(grids: GridAugmentation) -> None:
    """Both moves go out together at the end of the interval, in one rectangle."""
    grids.update(0, FREE, {})
    grids.update(10 * MS, FREE, {1: patch(0, 0), 2: patch(3, 3)})
    moved = {1: patch(0, 1), 2: patch(3, 3)}
    assert sent(grids.update(50 * MS, FREE, moved)) == (False, False, False)
    moved[1] = patch(5, 5)
    assert sent(grids.update(90 * MS, FREE, moved)) == (False, False, False)
    result = grids.update(110 * MS, FREE, moved)
    assert result.update is not None
    where = result.update.rectangle
    assert (where.row0, where.col0, where.height, where.width) == (0, 0, 6, 6)
    assert int((result.update.cells == OCCUPIED).sum()) == 2


def test_who_appears_or_goes_does_so_at_its_tick(grids: GridAugmentation) -> None:
    """In all that goes out, however soon after the last; with what others moved meanwhile."""
    grids.update(0, FREE, {1: patch(0, 0)})
    appeared = grids.update(10 * MS, FREE, {1: patch(0, 1), 2: patch(3, 3)})
    gone = grids.update(20 * MS, FREE, {1: patch(0, 2)})
    for result, cells in ((appeared, [[0, 1], [3, 3]]), (gone, [[0, 2]])):
        assert sent(result) == (True, True, True)
        assert result.augmented_map is not None
        assert result.artefact_map is not None
        assert result.costmap is not None
        for grid in (result.augmented_map, result.artefact_map, result.costmap):
            assert np.argwhere(grid.cells == OCCUPIED).tolist() == cells
    assert sent(grids.update(30 * MS, FREE, {1: patch(0, 3)})) == (False, False, False)


def test_a_new_cloud_over_the_same_map_is_no_change(grids: GridAugmentation) -> None:
    """The environment is another one, the grids go on: a change goes out with its rectangle."""
    grids.update(0, FREE, {1: patch(2, 2)})
    same = environment(np.zeros((6, 6)))
    assert sent(grids.update(200 * MS, same, {1: patch(2, 2)})) == (False, False, False)
    assert sent(grids.update(400 * MS, same, {1: patch(2, 3)})) == (True, True, True)


def test_another_in_the_same_place_is_no_change(grids: GridAugmentation) -> None:
    """Nothing goes out where no byte is another."""
    grids.update(0, FREE, {1: patch(2, 2)})
    assert sent(grids.update(10 * MS, FREE, {2: patch(2, 2)})) == (False, False, False)


@given(
    real=arrays(np.int8, (5, 7), elements=st.sampled_from([-1, 0, 40, 100])),
    walks=st.lists(
        st.dictionaries(st.integers(1, 3), st.tuples(st.integers(0, 4), st.integers(0, 6))),
        max_size=12,
    ),
)
@settings(deadline=None)
def test_the_artefact_map_is_the_difference_at_each_tick(
    real: Any, walks: list[dict[int, tuple[int, int]]]
) -> None:
    """Of the augmented and the real map, for who reads whole maps and for who reads updates."""
    augmentation = GridAugmentation(InflatedCostmap(0.1, 3.0, 0.05), 10.0)
    here = environment(real)
    whole: dict[str, Any] = {}
    followed: dict[str, Any] = {}
    for step, places in enumerate(walks):
        patches = {i: patch(row, col) for i, (row, col) in places.items()}
        result = augmentation.update(30 * MS * step, here, patches)
        for name, grid, update in (
            ("augmented", result.augmented_map, result.update),
            ("artefacts", result.artefact_map, result.artefact_update),
        ):
            if grid is not None:
                whole[name] = grid.cells
            if update is not None:
                update.rectangle.of(followed[name])[:] = update.cells
            elif grid is not None:
                followed[name] = grid.cells.copy()
            assert (update is None) == (grid is None or step == 0)
        for held in (whole, followed):
            shown = held["artefacts"] == OCCUPIED
            assert set(np.unique(held["artefacts"])) <= {0, OCCUPIED}
            assert np.array_equal(np.where(shown, OCCUPIED, real), held["augmented"])
            assert np.array_equal(shown & (real != OCCUPIED), held["augmented"] != real)


def test_what_came_and_went_in_between_is_told_as_it_now_is(grids: GridAugmentation) -> None:
    """A reader that has only the updates ends with the same map."""
    grids.update(0, FREE, {1: patch(1, 1)})
    grids.update(50 * MS, FREE, {1: patch(1, 2)})
    result = grids.update(100 * MS, FREE, {1: patch(1, 1)})
    assert result.update is not None
    assert result.update.cells.tolist() == [[OCCUPIED, 0]]
    assert result.augmented_map is not None
    assert np.argwhere(result.augmented_map.cells).tolist() == [[1, 1]]


def test_what_goes_out_is_a_copy(grids: GridAugmentation) -> None:
    """Later ticks do not change what was given out."""
    first = grids.update(0, FREE, {1: patch(1, 1)})
    grids.update(100 * MS, FREE, {})
    assert first.augmented_map is not None
    assert first.costmap is not None
    assert first.augmented_map.cells[1, 1] == OCCUPIED
    assert first.costmap.cells[1, 1] == OCCUPIED


def test_a_new_map_starts_anew(grids: GridAugmentation) -> None:
    """Another size, with the artefacts that stand in it, and no update of the old one."""
    grids.update(0, FREE, {1: patch(1, 1)})
    larger = environment(np.zeros((9, 8)))
    result = grids.update(100 * MS, larger, {1: patch(4, 4)})
    assert sent(result) == (True, False, True)
    assert result.augmented_map is not None
    assert np.argwhere(result.augmented_map.cells).tolist() == [[4, 4]]


def test_a_new_map_waits_for_the_interval_like_any_change(grids: GridAugmentation) -> None:
    """And it is not lost."""
    grids.update(0, FREE, {})
    larger = environment(np.zeros((9, 8)))
    assert sent(grids.update(50 * MS, larger, {})) == (False, False, False)
    assert sent(grids.update(100 * MS, larger, {})) == (True, False, True)


def test_to_prepare_loses_nothing(grids: GridAugmentation) -> None:
    """Preparing a map before its first tick, or twice, changes nothing of what goes out."""
    grids.prepare(FREE)
    grids.prepare(FREE)
    assert sent(grids.update(0, FREE, {1: patch(1, 1)})) == (True, False, True)


def test_the_costmap_is_that_of_walls_artefacts_and_unknown(
    make_scene: Callable[..., Any],
) -> None:
    """With the builder's parameters: lethal in the cell, inscribed around it, unknown kept."""
    scene = make_scene({"costmap.inflation_radius": 0.3, "costmap.gate": "all"})
    cells = scene.room().cells.copy()
    cells[30:35, 30:35] = -1
    scene.builder.receive_map(
        OccupancyGrid(cells, 0.1, RigidTransform.identity(), "map"), scene.ns(0.0)
    )
    scene.place(0, (2.0, 2.0), 0.0)
    costmap = scene.tick(0.1).grids.costmap.cells
    assert (costmap[18:22, 18:22] == 100).all()
    assert costmap[20, 22] == costmap[20, 23] == 99
    assert 0 < costmap[20, 24] < 99
    assert costmap[20, 25] == 0
    assert costmap[32, 32] == -1


def test_who_stands_is_in_a_new_map_too(grids: GridAugmentation) -> None:
    """Although it has not moved since the last one."""
    walls = np.zeros((6, 6))
    walls[0] = 100
    grids.update(0, FREE, {1: patch(2, 4)})
    result = grids.update(400 * MS, environment(walls), {1: patch(2, 4)})
    assert result.augmented_map is not None
    assert result.artefact_map is not None
    assert result.augmented_map.cells[2, 4] == result.artefact_map.cells[2, 4] == 100


def test_who_comes_back_after_a_farewell_goes_out_at_once(grids: GridAugmentation) -> None:
    """The same artefact in the same place: it is not there until it is sent anew."""
    grids.update(0, FREE, {1: patch(2, 2)})
    bare = grids.bare(10 * MS, FREE)
    assert bare.augmented_map is not None
    assert bare.augmented_map.cells.max() == 0
    assert sent(grids.update(20 * MS, FREE, {1: patch(2, 2)})) == (True, True, True)
