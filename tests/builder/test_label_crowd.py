"""Whose labels would run into each other, against looking at each pair."""

import math

import numpy as np
import pytest

from are_ros.builder.markers import FAR_M, MOST_LABELS, NEAR_M, crowded_ids


def _slowly(ids: list[int], places_m: list[tuple[float, float]], before: set[int]) -> set[int]:
    found = set()
    for i, one in zip(ids, places_m, strict=True):
        for j, other in zip(ids, places_m, strict=True):
            limit_m = FAR_M if {i, j} <= before else NEAR_M
            if i != j and math.dist(one, other) < limit_m:
                found.add(i)
    return found


@pytest.mark.parametrize("count", [0, 1, 2, 15, 60])
def test_crowds_are_those_of_all_pairs(count: int) -> None:
    """Also where some were crowded before."""
    random = np.random.default_rng(count)
    for _ in range(20):
        ids = random.permutation(3 * count)[:count].tolist()
        places_m = random.uniform(0.0, 8.0, (count, 2))
        before = set(random.permutation(3 * count)[:count].tolist())
        wanted = _slowly(ids, [(x, y) for x, y in places_m.tolist()], before)
        assert crowded_ids(ids, places_m, frozenset(before)) == wanted


def test_of_very_many_all_are_ids() -> None:
    """However far apart they stand."""
    ids = [*range(MOST_LABELS + 1)]
    places_m = np.column_stack((100.0 * np.arange(len(ids)), np.zeros(len(ids))))
    assert crowded_ids(ids, places_m, frozenset()) == frozenset(ids)
    assert crowded_ids(ids[1:], places_m[1:], frozenset()) == frozenset()
