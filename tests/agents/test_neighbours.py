"""Who is near, against all distances."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.agents.neighbours import Neighbourhood

COORDINATES = st.floats(-50.0, 50.0) | st.sampled_from((0.0, 4.0, -4.0, 1e6, -1e6))


def slow(points_m: np.ndarray, x_m: float, y_m: float, radius_m: float) -> list[int]:
    """Return the indices within the disc by trying all."""
    squares = [(x - x_m) ** 2 + (y - y_m) ** 2 for x, y in points_m.tolist()]
    near = [i for i, square in enumerate(squares) if square <= radius_m**2]
    return sorted(near, key=lambda i: (squares[i], i))


@given(
    points=st.lists(st.tuples(COORDINATES, COORDINATES), max_size=30),
    centre=st.tuples(COORDINATES, COORDINATES),
    radius_m=st.floats(0.0, 200.0),
    cell_m=st.floats(0.5, 10.0),
)
def test_it_finds_whom_all_distances_find(
    points: list[tuple[float, float]],
    centre: tuple[float, float],
    radius_m: float,
    cell_m: float,
) -> None:
    """Everybody within the radius is found once, the nearest first, also outliers."""
    points_m = np.array(points, dtype=np.float64).reshape(-1, 2)
    found = Neighbourhood(points_m, cell_m).within(*centre, radius_m)
    assert found.tolist() == slow(points_m, *centre, radius_m)


@pytest.mark.parametrize("count", [0, 1, 2000])
def test_a_crowd_of_any_size(count: int) -> None:
    """A crowd is asked about a place inside and one outside of it."""
    points_m = np.random.default_rng(4).uniform(0.0, 100.0, (count, 2))
    near = Neighbourhood(points_m)
    for centre in ((50.0, 50.0), (-3.0, 120.0)):
        assert near.within(*centre, 7.0).tolist() == slow(points_m, *centre, 7.0)


@pytest.mark.parametrize("radius_m", [1e15, 1e30, np.inf])
def test_a_radius_without_end_finds_all(radius_m: float) -> None:
    """A behaviour of a user's asks so for everybody."""
    points_m = np.random.default_rng(4).uniform(0.0, 100.0, (50, 2))
    found = Neighbourhood(points_m).within(50.0, 50.0, radius_m)
    assert found.tolist() == slow(points_m, 50.0, 50.0, 1e6)
    assert len(found) == 50


def test_the_nearest_point_is_the_first_of_the_nearest() -> None:
    """On a grid, where several often are as near; also from far away, and among outliers."""
    rng = np.random.default_rng(8)
    for count in (1, 2, 40):
        places_m, points_m = (rng.integers(-4, 5, (n, 2)).astype(np.float64) for n in (30, count))
        points_m[-1] *= 1e4
        places_m[-1] *= 1e5
        away_m = np.hypot(*np.moveaxis(places_m[:, None] - points_m, 2, 0))
        nearest = Neighbourhood(points_m, 0.5).nearest_to(places_m)
        np.testing.assert_array_equal(nearest, away_m.argmin(axis=1))
