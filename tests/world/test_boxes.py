"""Oriented boxes against slow twins: clipped polygons, and all pairs."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from are_ros.world.boxes import (
    OrientedBoxes,
    any_overlap,
    candidate_pairs,
    overlaps_any,
)
from tests.world.overlapping import overlapping_pairs, overlaps

Polygon = list[tuple[float, float]]


def _box(
    x: float, y: float, yaw: float = 0.0, half: tuple[float, float] = (0.5, 0.5), z: float = 1.0
) -> OrientedBoxes:
    return OrientedBoxes(np.array([[x, y, z]]), np.array([yaw]), np.array([[*half, 1.0]]))


def _random_boxes(count: int, side_m: float, seed: int) -> OrientedBoxes:
    generator = np.random.default_rng(seed)
    return OrientedBoxes(
        generator.uniform(0.0, side_m, (count, 3)) * (1.0, 1.0, 0.2),
        generator.uniform(-4.0, 4.0, count),
        generator.uniform(0.1, 0.6, (count, 3)),
    )


def _clipped(polygon: Polygon, window: NDArray[np.float64]) -> Polygon:
    """Clip a polygon by a convex window, counter-clockwise (Sutherland-Hodgman)."""
    for (ax, ay), (bx, by) in itertools.pairwise([*window.tolist(), window[0].tolist()]):
        sides = [(bx - ax) * (y - ay) - (by - ay) * (x - ax) for x, y in polygon]
        kept: Polygon = []
        for k, (x, y) in enumerate(polygon):
            x0, y0 = polygon[k - 1]
            if (sides[k] > 0.0) != (sides[k - 1] > 0.0):
                share = sides[k - 1] / (sides[k - 1] - sides[k])
                kept.append((x0 + share * (x - x0), y0 + share * (y - y0)))
            if sides[k] > 0.0:
                kept.append((x, y))
        polygon = kept
    return polygon


def _area(polygon: Polygon) -> float:
    return 0.5 * sum(
        polygon[k - 1][0] * y - x * polygon[k - 1][1] for k, (x, y) in enumerate(polygon)
    )


def test_corners_run_counter_clockwise_from_the_front_left() -> None:
    """A box of 2 m x 1 m that faces +y has its front left corner at low x, high y."""
    corners = _box(1.0, 2.0, np.pi / 2, (1.0, 0.5)).footprints()
    assert np.allclose(corners[0], [[0.5, 3.0], [0.5, 1.0], [1.5, 1.0], [1.5, 3.0]])


def test_arrays_are_read_only_and_the_callers_are_not() -> None:
    """The value's arrays refuse writing; the array that was given stays as it was."""
    yaws = np.zeros(1)
    boxes = OrientedBoxes(np.zeros((1, 3)), yaws, np.ones((1, 3)))
    with pytest.raises(ValueError, match="read-only"):
        boxes.yaws_rad[0] = 1.0
    yaws[0] = 1.0


def test_lengths_must_agree() -> None:
    """Two centres and one yaw are refused."""
    with pytest.raises(ValueError, match="differ in length"):
        OrientedBoxes(np.zeros((2, 3)), np.zeros(1), np.ones((2, 3)))


def test_at_and_take_choose_boxes() -> None:
    """An index gives one box, a mask the boxes chosen, and none is a set as well."""
    boxes = _random_boxes(3, 5.0, 1)
    assert boxes.at(-1).yaws_rad[0] == boxes.yaws_rad[2]
    assert len(boxes.take(np.array([True, False, True]))) == 2
    assert overlapping_pairs(OrientedBoxes.empty()).shape == (0, 2)
    with pytest.raises(IndexError):
        boxes.at(3)


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, np.pi, 0.3])
def test_touching_boxes_do_not_overlap(yaw: float) -> None:
    """Side by side, at any common heading, is no overlap; two micrometres closer is one."""
    direction = np.array([np.cos(yaw), np.sin(yaw)])
    x, y = 0.1 + direction
    assert not overlaps(_box(0.1, 0.1, yaw), _box(x, y, yaw))[0]
    x, y = 0.1 + direction * (1.0 - 2e-6)
    assert overlaps(_box(0.1, 0.1, yaw), _box(x, y, yaw))[0]


def test_boxes_above_each_other_do_not_overlap() -> None:
    """The z-interval counts: a box that stands on another only touches it."""
    assert not overlaps(_box(0.0, 0.0, z=1.0), _box(0.2, 0.0, z=3.0))[0]
    assert overlaps(_box(0.0, 0.0, z=1.0), _box(0.2, 0.0, z=2.9))[0]


@given(
    st.integers(-200, 200),
    st.integers(-200, 200),
    st.integers(-24, 24),
    st.tuples(st.integers(1, 150), st.integers(1, 150)),
)
def test_overlap_is_a_common_area(x: int, y: int, turn: int, half: tuple[int, int]) -> None:
    """Two footprints overlap exactly when one clipped by the other keeps an area."""
    fixed = _box(0.0, 0.0, 0.2, (1.0, 0.4))
    other = _box(x / 100, y / 100, turn * np.pi / 24, (half[0] / 100, half[1] / 100))
    window = fixed.footprints()[0]
    common = _area(_clipped([(a, b) for a, b in other.footprints()[0]], window))
    if not 0.0 < common < 1e-8:
        assert overlaps(fixed, other)[0] == (common > 0.0)


@pytest.mark.parametrize(("count", "side_m"), [(2, 0.5), (60, 3.0), (300, 12.0)])
def test_hashed_pairs_are_all_pairs(count: int, side_m: float) -> None:
    """The hash finds each pair once and in order, as testing all of them does."""
    boxes = _random_boxes(count, side_m, count)
    expected = [
        pair
        for pair in itertools.combinations(range(count), 2)
        if overlaps(boxes.at(pair[0]), boxes.at(pair[1]))[0]
    ]
    assert [tuple(pair) for pair in overlapping_pairs(boxes).tolist()] == expected


def test_a_huge_box_and_a_far_one_break_no_pair() -> None:
    """A wall over everything meets all; one box a thousand kilometres away meets none."""
    crowd = _random_boxes(100, 6.0, 3)
    centres = np.concatenate((crowd.centres_m, [[0.0, 0.0, 1.0], [1e6, -1e6, 1.0]]))
    halves = np.concatenate((crowd.half_sizes_m, [[200.0, 200.0, 5.0], [0.5, 0.5, 1.0]]))
    pairs = overlapping_pairs(OrientedBoxes(centres, np.append(crowd.yaws_rad, [0, 0]), halves))
    assert np.count_nonzero(pairs[:, 1] == 100) == 100
    assert not (pairs == 101).any()
    assert len(pairs) == 100 + len(overlapping_pairs(crowd))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", [0, 1, 2, 3])
def test_rectangles_that_are_not_finite_are_refused(value: float, column: int) -> None:
    """At once: no size of a hash cell would ever be large enough for them."""
    rectangles = np.array([[0.0, 0.0, 1.0, 1.0], [0.5, 0.5, 2.0, 2.0], [5.0, 5.0, 6.0, 6.0]])
    assert candidate_pairs(rectangles).tolist() == [[0, 1]]
    rectangles[1, column] = value
    with pytest.raises(ValueError, match="finite"):
        candidate_pairs(rectangles)


def test_boxes_at_no_place_are_refused() -> None:
    """A pose that is not a number overlaps nobody, and must not go unnoticed."""
    boxes = _random_boxes(4, 1.0, 1)
    centres = boxes.centres_m.copy()
    centres[2, 1] = np.nan
    with pytest.raises(ValueError, match="finite"):
        overlapping_pairs(OrientedBoxes(centres, boxes.yaws_rad, boxes.half_sizes_m))


@given(st.integers(0, 10**6), st.integers(0, 60), st.floats(1.0, 200.0))
def test_any_overlap_is_that_there_are_pairs(seed: int, count: int, side_m: float) -> None:
    """Few or many, crowded or not, about the origin or far from it."""
    boxes = _random_boxes(count, side_m, seed)
    assert any_overlap(boxes) == (len(overlapping_pairs(boxes)) > 0)


def test_any_overlap_finds_the_only_two_among_thousands() -> None:
    """Wherever they are, and whatever their ids; touching is none."""
    at = np.arange(0.0, 50.0)
    centres = np.array([(x, y, 1.0) for x in at for y in at])
    halves, yaws = np.full_like(centres, 0.4), np.zeros(len(centres))
    halves[7, 0] = 1.1  # a wide one makes wide cells
    assert any_overlap(OrientedBoxes(centres, yaws, halves))
    halves[7, 0] = 0.6  # it touches those beside it
    assert not any_overlap(OrientedBoxes(centres, yaws, halves))
    for i, j in ((0, 1), (0, 50), (1234, 1285), (2498, 2499), (2400, 49)):
        moved = centres.copy()
        moved[i] = centres[j] + (0.79, -0.79, 0.0)
        assert any_overlap(OrientedBoxes(moved, yaws, halves))


def test_boxes_of_packed_rows_are_those_that_were_packed() -> None:
    """Nothing is computed anew, and nothing can be written."""
    boxes = _random_boxes(5, 4.0, 1)
    same = OrientedBoxes.of_packed(boxes.packed, boxes.yaws_rad)
    assert same.packed.base is boxes.packed or same.packed is boxes.packed
    for name in ("centres_m", "yaws_rad", "half_sizes_m", "packed"):
        assert np.array_equal(getattr(same, name), getattr(boxes, name))
        assert not getattr(same, name).flags.writeable


def test_any_of_is_the_union_of_single_tests() -> None:
    """A box overlaps any of the others if it overlaps one of them."""
    boxes, others = _random_boxes(80, 8.0, 5), _random_boxes(30, 8.0, 6)
    expected = np.zeros(80, dtype=bool)
    for j in range(30):
        expected |= overlaps(boxes, others.at(j))
    assert np.array_equal(overlaps_any(boxes, others), expected)
    assert 0 < np.count_nonzero(expected) < 80
