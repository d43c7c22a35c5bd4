"""Robot footprints: Nav2's string form, radii, and distances against the Minkowski difference."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from are_ros.errors import ParameterError
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.footprint import Footprint, penetration_m, signed_distance_m

_SQUARE = "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"


def _box(x: float, y: float, yaw: float, ahead: float, aside: float) -> OrientedBoxes:
    return OrientedBoxes(np.array([[x, y, 1.0]]), np.array([yaw]), np.array([[ahead, aside, 1.0]]))


def _minkowski_distance(vertices: NDArray[np.float64], corners: NDArray[np.float64]) -> float:
    """Return the signed distance of the origin from the hull of all differences."""
    hull = ConvexHull((vertices[:, None] - corners[None]).reshape(-1, 2))
    inside = float(hull.equations[:, 2].max())
    if inside <= 0.0:
        return inside
    ends = hull.points[hull.simplices]
    edges = ends[:, 1] - ends[:, 0]
    share = np.clip(-(ends[:, 0] * edges).sum(1) / (edges * edges).sum(1), 0.0, 1.0)
    return float(np.hypot(*(ends[:, 0] + share[:, None] * edges).T).min())


def test_nav2_string_becomes_a_counter_clockwise_hull() -> None:
    """Order, a point inside, a point on an edge and a repeated one do not matter."""
    text = "[[0.3, 0.2], [0.3, -.2], [0.0, 0.0], [-0.3, -0.2], [-3e-1, 0.2], [0, 0.2], [0.3, 0.2]]"
    vertices = Footprint.parse(text).vertices_m
    assert vertices.tolist() == [[-0.3, -0.2], [0.3, -0.2], [0.3, 0.2], [-0.3, 0.2]]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "not of the form"),
        ("[[0.1, 0.2], [", "not of the form"),
        ("__import__('os')", "not of the form"),
        ("0.3", "not a list of three"),
        ("[[0, 0], [1, 0]]", "not a list of three"),
        ("[[0, 0], [1, 0], [1]]", "is not a point"),
        ("[[0, 0], [1, 0], ['a', 1]]", "is not a point"),
        ("[[0, 0], [1, 0], [1e999, 1]]", "is not a point"),
        ("[[0, 0], [1, 0], [True, 1]]", "is not a point"),
        ("[[0, 0], [1, 1], [2, 2]]", "enclose no area"),
    ],
)
def test_a_malformed_string_is_refused_with_the_reason(text: str, reason: str) -> None:
    """The sentence begins with the parameter and says what is wrong."""
    with pytest.raises(ParameterError, match=reason) as raised:
        Footprint.parse(text)
    assert str(raised.value).startswith("robot.footprint: ")


def test_no_vertices_or_a_negative_radius_is_refused() -> None:
    """A footprint is never empty."""
    with pytest.raises(ValueError, match="at least one vertex"):
        Footprint(np.zeros((0, 2)))
    with pytest.raises(ValueError, match="radius cannot be"):
        Footprint.disc(-0.1)


def test_radii_of_a_rectangle_and_of_a_disc() -> None:
    """Padding adds to both radii; a footprint beside the origin has no inscribed disc."""
    square = Footprint.parse(_SQUARE)
    assert square.inscribed_radius_m == pytest.approx(0.2)
    assert square.circumscribed_radius_m == pytest.approx(np.hypot(0.3, 0.2))
    assert square.padded(0.1).inscribed_radius_m == pytest.approx(0.3)
    disc = Footprint.disc(0.22)
    assert (disc.inscribed_radius_m, disc.circumscribed_radius_m) == (0.22, 0.22)
    assert square.at(1.0, 0.0, 0.0).inscribed_radius_m == 0.0


def test_a_pose_turns_and_moves_the_footprint() -> None:
    """Facing +y at (1, 2), the front left corner is at (1 - 0.2, 2 + 0.3)."""
    moved = Footprint.parse(_SQUARE).at(1.0, 2.0, np.pi / 2)
    assert np.isclose(moved.vertices_m, [0.8, 2.3]).all(axis=1).any()
    with pytest.raises(ValueError, match="read-only"):
        moved.vertices_m[0, 0] = 0.0


def test_distances_that_can_be_read_off() -> None:
    """A disc of 0.25 m beside, at the corner of, inside, and touching a box of 2 m x 1 m."""
    disc = Footprint.disc(0.25)
    boxes = OrientedBoxes(
        np.array([[2.0, 0, 0], [-1.3, 0.9, 0], [0.9, 0.0, 0], [0.0, 0.75, 0]]),
        np.zeros(4),
        np.tile([1.0, 0.5, 1.0], (4, 1)),
    )
    assert signed_distance_m(disc, boxes) == pytest.approx([0.75, 0.25, -0.35, 0.0])


_CM = st.integers(-250, 250)


@given(
    st.lists(st.tuples(_CM, _CM), min_size=1, max_size=6),
    st.tuples(_CM, _CM),
    st.integers(-30, 30),
    st.tuples(st.integers(1, 120), st.integers(1, 120)),
)
def test_distance_is_that_of_the_minkowski_difference(
    points: list[tuple[int, int]], centre: tuple[int, int], turn: int, half: tuple[int, int]
) -> None:
    """Apart or overlapping, one vertex or six: the origin's signed distance from the hull."""
    footprint = Footprint(np.array(points) / 100, 0.15)
    box = _box(centre[0] / 100, centre[1] / 100, turn / 10, half[0] / 100, half[1] / 100)
    expected = _minkowski_distance(footprint.vertices_m, box.footprints()[0]) - 0.15
    assert signed_distance_m(footprint, box)[0] == pytest.approx(expected, abs=1e-9)


@given(st.integers(0, 1000))
def test_penetration_is_the_negative_part_of_the_distance(seed: int) -> None:
    """Leaving out far boxes changes no depth."""
    generator = np.random.default_rng(seed)
    footprint = Footprint(generator.uniform(-0.5, 0.5, (4, 2)), generator.uniform(0.0, 0.3))
    boxes = OrientedBoxes(
        generator.uniform(-2.0, 2.0, (20, 3)),
        generator.uniform(-4.0, 4.0, 20),
        generator.uniform(0.05, 0.8, (20, 3)),
    )
    expected = np.maximum(-signed_distance_m(footprint, boxes), 0.0)
    assert np.array_equal(penetration_m(footprint, boxes), expected)
