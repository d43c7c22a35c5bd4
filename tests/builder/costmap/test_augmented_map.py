"""The augmented map against a map composed afresh, byte for byte, and its rate limit."""

import numpy as np
import numpy.typing as npt
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.builder.costmap.augmented_map import AugmentedMap, ChangedRectangle, RateLimit
from are_ros.builder.costmap.registration import CellPatch, patch_changes
from are_ros.conventions import NS_PER_S
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

Cells = npt.NDArray[np.int8]

SHAPE = (9, 12)
MS = 1_000_000


class FollowingMap(AugmentedMap):
    """A map that finds out itself how the patches changed."""

    def __init__(self, real: Cells) -> None:
        super().__init__(real)
        self._patches: dict[int, CellPatch] = {}
        self._grid = OccupancyGrid(real, 1.0, RigidTransform.identity(), "map")

    def follow(self, patches: dict[int, CellPatch]) -> ChangedRectangle | None:
        """Take the patches of now; return what of the map goes out, all of it at first."""
        self.update(patch_changes(self._patches, patches))
        self._patches = patches
        is_changed = self.is_changed
        grid, update = self.take(7, self._grid)
        assert is_changed == (grid is not None)
        if grid is None:
            return None
        assert np.array_equal(grid.cells, self.cells)
        if update is None:
            return ChangedRectangle(0, 0, *self.cells.shape)
        assert np.array_equal(update.cells, update.rectangle.of(self.cells))
        return update.rectangle


def composed(real: Cells, patches: dict[int, CellPatch]) -> Cells:
    """Return the real map with 100 under each patch, cell after cell."""
    cells: Cells = real.copy()
    for patch in patches.values():
        for row, col in np.argwhere(patch.mask):
            cells[patch.row0 + row, patch.col0 + col] = 100
    return cells


def smallest_rectangle(before: Cells, after: Cells) -> ChangedRectangle | None:
    """Return the bounding rectangle of the cells that differ."""
    rows, cols = np.nonzero(before != after)
    if len(rows) == 0:
        return None
    row0, col0 = int(rows.min()), int(cols.min())
    return ChangedRectangle(row0, col0, int(rows.max()) - row0 + 1, int(cols.max()) - col0 + 1)


@st.composite
def patches_on(draw: st.DrawFn, shape: tuple[int, int]) -> CellPatch:
    """Draw a patch within the grid, of any pattern, perhaps without cells."""
    row0, col0 = draw(st.integers(0, shape[0] - 1)), draw(st.integers(0, shape[1] - 1))
    rows = draw(st.integers(1, min(5, shape[0] - row0)))
    cols = draw(st.integers(1, min(5, shape[1] - col0)))
    cells = draw(st.lists(st.booleans(), min_size=rows * cols, max_size=rows * cols))
    return CellPatch.of(row0, col0, np.array(cells).reshape(rows, cols))


SCENES = st.lists(
    st.dictionaries(st.integers(0, 4), patches_on(SHAPE), max_size=4), min_size=1, max_size=6
)


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 10**6), scenes=SCENES)
def test_bytes_are_the_real_ones_outside_and_100_inside(
    seed: int, scenes: list[dict[int, CellPatch]]
) -> None:
    """Any moves, over any bytes; the rectangle is the smallest, and enough to follow."""
    real = np.random.default_rng(seed).integers(-128, 128, SHAPE).astype(np.int8)
    augmented = FollowingMap(real)
    follower = real.copy()
    for number, patches in enumerate(scenes):
        before = augmented.cells.copy()
        changed = augmented.follow(patches)
        after = composed(real, patches)
        assert np.array_equal(augmented.cells, after)
        if number == 0:
            assert changed == ChangedRectangle(0, 0, *SHAPE)
        else:
            assert changed == smallest_rectangle(before, after)
        if changed is not None:
            changed.of(follower)[:] = changed.of(augmented.cells)
        assert np.array_equal(follower, after)


def test_overlapping_artefacts_part_without_a_trace() -> None:
    """When one of two that overlap leaves, the other keeps the shared cells."""
    real = np.full(SHAPE, -1, np.int8)
    augmented = FollowingMap(real)
    one = CellPatch.of(2, 2, np.ones((3, 3), np.bool_))
    other = CellPatch.of(3, 3, np.ones((3, 3), np.bool_))
    augmented.follow({1: one, 2: other})
    assert augmented.follow({2: other}) == ChangedRectangle(2, 2, 3, 3)
    assert np.array_equal(augmented.cells, composed(real, {2: other}))
    assert augmented.follow({}) == ChangedRectangle(3, 3, 3, 3)
    assert np.array_equal(augmented.cells, real)


def test_move_onto_what_is_occupied_already_is_no_change() -> None:
    """A byte that was 100 and stays 100 did not change."""
    augmented = FollowingMap(np.full(SHAPE, 100, np.int8))
    augmented.follow({})
    assert augmented.follow({1: CellPatch.of(1, 1, np.ones((2, 2), np.bool_))}) is None


def test_map_is_relayed_before_any_update() -> None:
    """The cells are the real map's at once, and all of it goes out first."""
    augmented = FollowingMap(np.full((2, 3), 7, np.int8))
    assert np.array_equal(augmented.cells, np.full((2, 3), 7))
    assert augmented.follow({}) == ChangedRectangle(0, 0, 2, 3)
    assert augmented.follow({}) is None


def test_cells_and_the_map_given_are_independent() -> None:
    """The view is read-only, and a caller's later writes do not reach the map."""
    given_map = np.zeros(SHAPE, np.int8)
    augmented = FollowingMap(given_map)
    given_map[:] = 3
    assert not augmented.cells.any()
    assert not augmented.cells.flags.writeable


def test_union_of_rectangles_holds_both() -> None:
    """Changes that wait for their publication add up to one rectangle."""
    one, other = ChangedRectangle(2, 8, 3, 1), ChangedRectangle(4, 1, 4, 2)
    assert one.united(other) == other.united(one) == ChangedRectangle(2, 1, 6, 8)
    assert one.united(None) == one


def test_rate_limit_publishes_at_most_five_times_a_second() -> None:
    """With a change at each tick of 10 Hz, every second tick publishes, the first at once."""
    limit = RateLimit(5.0)
    allowed = [tick for tick in range(10) if limit.allows(tick * 100 * MS, changed=True)]
    assert allowed == [0, 2, 4, 6, 8]


def test_rate_limit_loses_no_change() -> None:
    """One that comes too early goes out at the first allowed tick, once."""
    limit = RateLimit(5.0)
    changes = {0: True, 100: True, 150: False, 199: False, 200: False, 400: False}
    allowed = [ms for ms, changed in changes.items() if limit.allows(ms * MS, changed=changed)]
    assert allowed == [0, 200]


def test_rate_limit_lets_out_at_once_what_must() -> None:
    """With what waited; the interval begins anew, and where nothing changed nothing goes out."""
    limit = RateLimit(5.0)
    changes = ((0, 1, 0), (50, 1, 0), (100, 0, 1), (150, 0, 1), (200, 1, 0), (300, 0, 0))
    allowed = [
        ms for ms, new, at_once in changes if limit.allows(ms * MS, bool(new), bool(at_once))
    ]
    assert allowed == [0, 100, 300]


def test_rate_limit_never_rounds_the_rate_up() -> None:
    """At 3 Hz the interval is a third of a second, rounded up to whole nanoseconds."""
    limit = RateLimit(3.0)
    assert limit.allows(0, changed=True)
    assert not limit.allows(333_333_333, changed=True)
    assert limit.allows(333_333_334, changed=False)


@settings(deadline=None)
@given(
    rate_hz=st.floats(0.1, 50.0),
    steps_ms=st.lists(st.tuples(st.integers(1, 300), st.booleans()), max_size=60),
)
def test_rate_limit_keeps_its_interval_and_its_promise(
    rate_hz: float, steps_ms: list[tuple[int, bool]]
) -> None:
    """Publications are an interval apart; a tick that may publish leaves nothing pending."""
    limit = RateLimit(rate_hz)
    now_ns, is_pending = 0, False
    published_ns: list[int] = []
    for step_ms, changed in steps_ms:
        now_ns += step_ms * MS
        is_pending |= changed
        allowed = limit.allows(now_ns, changed=changed)
        since_ns = now_ns - published_ns[-1] if published_ns else 10**18
        assert not allowed or (is_pending and since_ns >= NS_PER_S / rate_hz)
        assert allowed or not is_pending or since_ns < NS_PER_S / rate_hz + 1
        if allowed:
            is_pending = False
            published_ns.append(now_ns)
    assert limit.allows(now_ns + 10 * NS_PER_S, changed=False) == is_pending


def test_rate_limit_survives_a_clock_that_jumps_back() -> None:
    """A bag that loops does not silence the map until the old time comes round."""
    limit = RateLimit(5.0)
    assert limit.allows(10_000 * MS, changed=True)
    assert limit.allows(500 * MS, changed=True)
    assert not limit.allows(600 * MS, changed=True)
    assert limit.allows(700 * MS, changed=False)
