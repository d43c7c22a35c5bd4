"""The augmented costmap against a full exact distance transform, cell for cell."""

import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from are_ros.builder.costmap import inflation as costmap_module
from are_ros.builder.costmap.inflation import (
    NARROW_RADIUS_CELLS,
    InflatedCostmap,
    inflated,
    inflation_costs,
    published_by_cost,
    table_size,
)
from are_ros.builder.costmap.registration import CellPatch, patch_changes

Mask = npt.NDArray[np.bool_]
Patches = Mapping[int, CellPatch]

INFLATION_M, SCALING, INSCRIBED_M = 0.55, 10.0, 0.22
SHAPE = (23, 31)


class FollowingCostmap(InflatedCostmap):
    """A costmap that finds out itself how the patches changed."""

    def set_map(self, occupied: Mask, unknown: Mask, resolution_m: float) -> None:
        """Take a map without artefacts."""
        super().set_map(occupied, unknown, resolution_m)
        self._patches: Patches = {}

    def take(self, patches: Patches) -> bool:
        """Take the patches of now; return whether a published byte changed."""
        changes, self._patches = patch_changes(self._patches, patches), dict(patches)
        return self.update(changes)


def nav2_cost(d2_cells: int, resolution_m: float, inflation_m: float) -> int:
    """Return Nav2's cost at a squared distance, one cell at a time, as its own code has it."""
    distance_m = math.sqrt(d2_cells) * resolution_m
    if d2_cells == 0:
        return 254
    if distance_m > inflation_m + 1e-9:
        return 0
    if distance_m <= INSCRIBED_M + 1e-9:
        return 253
    return int(252 * math.exp(-SCALING * (distance_m - INSCRIBED_M)))


def expected_costs(
    occupied: Mask,
    unknown: Mask,
    patches: Patches,
    resolution_m: float = 0.05,
    inflation_m: float = INFLATION_M,
) -> npt.NDArray[np.uint8]:
    """Return the inflation of walls and artefacts together, by scipy's transform of the whole."""
    obstacles = occupied.copy()
    for patch in patches.values():
        rows, cols = patch.mask.shape
        obstacles[patch.row0 : patch.row0 + rows, patch.col0 : patch.col0 + cols] |= patch.mask
    costs = np.zeros(obstacles.shape, np.uint8)
    if obstacles.any():
        squares = np.rint(distance_transform_edt(~obstacles) ** 2).astype(int)
        values, places = np.unique(squares, return_inverse=True)
        by_value = [nav2_cost(int(d2), resolution_m, inflation_m) for d2 in values]
        costs = np.array(by_value, np.uint8)[places].reshape(obstacles.shape)
    costs[unknown & (costs < 253)] = 255
    return costs


def expected_published(costs: npt.NDArray[np.uint8]) -> npt.NDArray[np.int8]:
    """Return the costs translated one by one, as Costmap2DPublisher fills its table."""
    special = {0: 0, 253: 99, 254: 100, 255: -1}
    table = [special.get(cost, 1 + (97 * (cost - 1)) // 251) for cost in range(256)]
    return np.array(table, np.int8)[costs]


def a_map(shape: tuple[int, int], seed: int, wall_share: float = 0.01) -> tuple[Mask, Mask]:
    """Return random occupied cells and a random block of unknown ones."""
    generator = np.random.default_rng(seed)
    occupied = generator.random(shape) < wall_share
    unknown = np.zeros(shape, np.bool_)
    row0, col0 = generator.integers(0, shape[0]), generator.integers(0, shape[1])
    unknown[row0 : row0 + shape[0] // 2, col0 : col0 + shape[1] // 2] = True
    return occupied, unknown & ~occupied


def a_costmap(
    occupied: Mask, unknown: Mask, resolution_m: float = 0.05, inflation_m: float = INFLATION_M
) -> FollowingCostmap:
    """Return a costmap of this map, without artefacts."""
    costmap = FollowingCostmap(inflation_m, SCALING, INSCRIBED_M)
    costmap.set_map(occupied, unknown, resolution_m)
    return costmap


def open_floor(shape: tuple[int, int] = SHAPE) -> tuple[Mask, Mask]:
    """Return a map without wall or unknown cell."""
    return np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)


@st.composite
def patches_on(draw: st.DrawFn, shape: tuple[int, int]) -> CellPatch:
    """Draw a patch within the grid, often at its edge, of any pattern, perhaps without cells."""
    row0, col0 = draw(st.integers(0, shape[0] - 1)), draw(st.integers(0, shape[1] - 1))
    rows = draw(st.integers(1, min(6, shape[0] - row0)))
    cols = draw(st.integers(1, min(6, shape[1] - col0)))
    bits = draw(st.integers(0, 2 ** (rows * cols) - 1))
    cells = [bool(bits >> i & 1) for i in range(rows * cols)]
    return CellPatch.of(row0, col0, np.array(cells).reshape(rows, cols))


SCENES = st.lists(
    st.dictionaries(st.integers(0, 4), patches_on(SHAPE), max_size=4), min_size=1, max_size=6
)


def test_formula_gives_nav2s_costs() -> None:
    """Lethal at 0, inscribed up to the radius, then floor(252 exp(-k (d - r)))."""
    distances_m = np.array([0.0, 0.01, 0.22, 0.32, 0.42, 1.22])
    assert inflation_costs(distances_m, 10.0, 0.22).tolist() == [254, 253, 253, 92, 34, 0]


def test_published_table_is_that_of_nav2() -> None:
    """The ends and the special values are those of Costmap2DPublisher."""
    table = published_by_cost()
    assert table[[0, 1, 2, 3, 4, 126, 251, 252, 253, 254, 255]].tolist() == [
        *(0, 1, 1, 1, 2, 49, 97, 98, 99, 100, -1)
    ]
    assert np.array_equal(table, expected_published(np.arange(256, dtype=np.uint8)))


@pytest.mark.parametrize("radius", [0, 1, 2, 7, NARROW_RADIUS_CELLS, NARROW_RADIUS_CELLS + 1])
@pytest.mark.parametrize("margin", [0, 3, 200])
def test_kernel_finds_the_exact_squared_distance(radius: int, margin: int) -> None:
    """Narrow and wide integers agree with scipy; the table here tells squared distances apart."""
    mask = np.random.default_rng(radius).random((9, 14)) < 0.1
    squares = np.rint(distance_transform_edt(~np.pad(mask, margin)) ** 2).astype(int)
    d2 = np.arange(table_size(radius))
    for modulus in (251, 241):
        costs = np.where(d2 <= radius**2, d2 % modulus + 1, 0).astype(np.uint8)
        expected = np.where(squares <= radius**2, squares % modulus + 1, 0)
        assert np.array_equal(inflated(mask, costs, radius, margin), expected)


def test_kernel_takes_masks_without_cells() -> None:
    """An empty mask, and one of no rows, inflate to nothing."""
    costs = np.full(table_size(2), 7, np.uint8)
    costs[9:] = 0
    assert not inflated(np.zeros((3, 4), np.bool_), costs, 2, 2).any()
    assert inflated(np.zeros((0, 0), np.bool_), costs, 2, 0).shape == (0, 0)


@pytest.mark.parametrize("seed", range(8))
def test_real_map_alone_is_inflated_exactly(seed: int) -> None:
    """Without artefacts the costs are those of the transform, unknown cells included."""
    occupied, unknown = a_map((60, 80), seed)
    costmap = a_costmap(occupied, unknown)
    costs = expected_costs(occupied, unknown, {})
    assert np.array_equal(costmap.costs, costs)
    assert np.array_equal(costmap.published(), expected_published(costs))


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 10**6), share=st.sampled_from([0.0, 0.005, 0.1]), scenes=SCENES)
def test_every_scene_of_a_sequence_equals_the_full_transform(
    seed: int, share: float, scenes: list[dict[int, CellPatch]]
) -> None:
    """Moves, arrivals, departures, overlaps, edges, walls and unknown cells: all exact."""
    occupied, unknown = a_map(SHAPE, seed, share)
    costmap = a_costmap(occupied, unknown)
    static = costmap.costs.copy()
    before = costmap.published().copy()
    for number, patches in enumerate(scenes):
        changed = costmap.take(patches)
        costs = expected_costs(occupied, unknown, patches)
        assert np.array_equal(costmap.costs, costs)
        assert np.array_equal(costmap.published(), expected_published(costs))
        assert changed == (number == 0 or not np.array_equal(before, costmap.published()))
        lowest = np.where(static == 255, -1, static.astype(int))
        assert (np.where(costs == 255, -1, costs.astype(int)) >= lowest).all()
        before = costmap.published().copy()


def test_crowd_that_walks_for_a_while_stays_exact() -> None:
    """40 artefacts on a larger map, 30 ticks, some standing, some leaving."""
    generator = np.random.default_rng(3)
    occupied, unknown = a_map((240, 300), 3, 0.001)
    costmap = a_costmap(occupied, unknown)
    patches: dict[int, CellPatch] = {}
    for _ in range(30):
        for artefact_id in generator.integers(0, 40, 15):
            row0, col0 = generator.integers(0, (228, 288))
            mask = generator.random((12, 12)) < 0.8
            patches[int(artefact_id)] = CellPatch.of(int(row0), int(col0), mask)
        patches.pop(int(generator.integers(0, 40)), None)
        costmap.take(patches)
        assert np.array_equal(costmap.costs, expected_costs(occupied, unknown, patches))


def test_car_on_a_centimetre_grid_is_exact() -> None:
    """A patch of 180 x 450 cells with 70 cells around it, turned, over a wall."""
    occupied, unknown = open_floor((420, 620))
    occupied[:, 300] = True
    rows, cols = np.mgrid[:320, :480]
    mask = (np.abs((cols - 240) - (rows - 160)) < 150) & (np.abs(cols - 240 + rows - 160) < 90)
    patches = {1: CellPatch.of(60, 80, mask)}
    costmap = a_costmap(occupied, unknown, 0.01, 0.70)
    costmap.take(patches)
    assert np.array_equal(costmap.costs, expected_costs(occupied, unknown, patches, 0.01, 0.70))


def test_departed_artefact_leaves_nothing_behind() -> None:
    """After the last departure the costmap is that of the real map."""
    costmap = a_costmap(*a_map(SHAPE, 5))
    static, published = costmap.costs.copy(), costmap.published().copy()
    costmap.take({1: CellPatch.of(3, 3, np.ones((4, 4), np.bool_))})
    assert costmap.costs[4, 4] == 254
    assert costmap.take({})
    assert np.array_equal(costmap.costs, static)
    assert np.array_equal(costmap.published(), published)


def test_standing_artefact_costs_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal masks are inflated once, whoever casts them and wherever they stand."""
    costmap = a_costmap(*open_floor())
    calls: list[tuple[int, ...]] = []

    def counting(
        mask: Mask, cost_of_d2: npt.NDArray[np.uint8], radius_cells: int, margin_cells: int
    ) -> npt.NDArray[np.uint8]:
        calls.append(mask.shape)
        return inflated(mask, cost_of_d2, radius_cells, margin_cells)

    monkeypatch.setattr(costmap_module, "inflated", counting)
    for col0 in (2, 2, 8):
        square = CellPatch.of(4, 4, np.ones((2, 2), np.bool_))
        walker = CellPatch.of(9, col0, np.ones((2, 2), np.bool_))
        costmap.take({1: square, 2: walker})
    assert calls == [(2, 2)]
    costmap.take({})
    costmap.take({1: CellPatch.of(4, 4, np.ones((2, 2), np.bool_))})
    assert calls == [(2, 2), (2, 2)], "masks out of use are not kept"


def test_unknown_cells_take_inscribed_costs_only() -> None:
    """An artefact among unknown cells shows itself and its inscribed ring, nothing further."""
    occupied, unknown = open_floor()
    unknown[:] = True
    costmap = a_costmap(occupied, unknown)
    costmap.take({1: CellPatch.of(10, 10, np.ones((1, 1), np.bool_))})
    assert costmap.costs[10, 10:16].tolist() == [254, 253, 253, 253, 253, 255]
    assert costmap.published()[10, 10:16].tolist() == [100, 99, 99, 99, 99, -1]


def test_change_that_walls_hide_is_none() -> None:
    """An artefact inside a wall raises no cost; the first update reports the new map."""
    occupied, unknown = open_floor()
    occupied[5:9, 5:9] = True
    costmap = a_costmap(occupied, unknown)
    inside = {1: CellPatch.of(6, 6, np.ones((2, 2), np.bool_))}
    assert costmap.take({})
    assert not costmap.take(inside)
    assert not costmap.take(inside)


@pytest.mark.parametrize(
    ("inflation_m", "resolution_m", "cells"),
    [(0.70, 0.05, 14), (0.55, 0.05, 11), (0.30, 0.1, 3), (0.70, 0.02, 35), (0.12, 0.05, 2)],
)
def test_radius_reaches_the_cells_it_is_a_multiple_of(
    inflation_m: float, resolution_m: float, cells: int
) -> None:
    """Rounding of 14 * 0.05 does not lose the outermost ring; a part of a cell does not count."""
    occupied, unknown = open_floor((1, 50))
    occupied[0, 0] = True
    costmap = FollowingCostmap(inflation_m, 0.0, 0.0)
    costmap.set_map(occupied, unknown, resolution_m)
    assert costmap.costs[0].tolist() == [254] + [252] * cells + [0] * (49 - cells)


@pytest.mark.parametrize("inflation_m", [0.0, 1e6])
def test_extreme_radii(inflation_m: float) -> None:
    """No inflation leaves the obstacles; one wider than the map reaches all of it."""
    occupied, unknown = open_floor((6, 7))
    occupied[0, 0] = True
    costmap = FollowingCostmap(inflation_m, 0.0, 0.0)
    costmap.set_map(occupied, unknown, 0.05)
    costmap.take({1: CellPatch.of(5, 6, np.ones((1, 1), np.bool_))})
    free = costmap.costs[costmap.costs < 254]
    assert (costmap.costs == 254).sum() == 2
    assert (free == (0 if inflation_m == 0.0 else 252)).all()


def test_new_map_forgets_the_artefacts_of_the_old() -> None:
    """A map of another size starts afresh, and reports a change once."""
    costmap = a_costmap(*open_floor())
    patches = {1: CellPatch.of(20, 28, np.ones((3, 3), np.bool_))}
    costmap.take(patches)
    costmap.set_map(*open_floor((8, 9)), 0.1)
    assert not costmap.costs.any()
    assert costmap.take({})
    assert not costmap.take({})


def test_views_are_read_only() -> None:
    """What is handed out cannot be written to."""
    costmap = a_costmap(*open_floor())
    assert not costmap.costs.flags.writeable
    assert not costmap.published().flags.writeable
