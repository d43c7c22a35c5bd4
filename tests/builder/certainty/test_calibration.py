"""A world of artefacts that come, hide and go: of what is said to exist, the said share does."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from are_ros.agents.events import Sighting
from are_ros.builder.certainty.false_alarms import FIRST_ID
from are_ros.builder.certainty.perception import View
from are_ros.population.artefact import Artefact
from are_ros.world.boxes import OrientedBoxes
from tests.builder.certainty.hall import detector, ns, room, scene, seeing, sight, view, walkers

ROOM = room()
MEAN_LIFE_S = 8.0
VALUES = {
    "population.mean_life": MEAN_LIFE_S,
    "certainty.false_alarm_rate": 1.5,
    "certainty.false_alarm_life": 1.2,
    "certainty.detection": 0.75,
    "certainty.half_fraction": 0.4,
    "certainty.coast": 4.0,
    "certainty.class_accuracy": 0.6,
}
ARRIVALS_PER_S = 1.5
SECONDS = 800
FRACTIONS = (0.0, 0.3, 0.6, 1.0)


class Said(NamedTuple):
    """What was said of one track at one time, and whether it was so."""

    number: int
    existence: float
    exists: bool
    classes: dict[str, float]
    true_class: str


@cache
def fractions(second: int) -> Any:
    """Return what is visible in patches of 3 m, (32, 32); it changes each second."""
    return np.random.default_rng(second).choice(FRACTIONS, (32, 32))


def view_at(t_s: float) -> View:
    """Return a view that sees boxes that are not there as it sees artefacts."""

    def imagine(boxes: OrientedBoxes) -> list[Sighting | None]:
        x, y = (boxes.centres_m[:, :2] // 3.0).astype(int).T % 32
        found = fractions(int(t_s))[x, y].tolist()
        return [sight(fraction) if fraction else None for fraction in found]

    return view(imagine, ROOM)


def told(rate_hz: float) -> Iterator[Said]:
    """Yield what is told each 2 s of a world in which artefacts are hidden at times."""
    random = np.random.default_rng(23)
    eye = detector({**VALUES, "builder.tick_rate": rate_hz, "camera.rate": rate_hz})
    newcomers, alive = iter(walkers(6_000)), dict[int, tuple[Artefact, float]]()
    of_id, next_s = dict[int, str](), 0.0
    for k in range(round(SECONDS * rate_hz)):
        t_s = k / rate_hz
        while next_s <= t_s:
            one = next(newcomers)
            alive[one.id] = one, next_s + random.exponential(MEAN_LIFE_S)
            of_id[one.id] = one.row.class_name
            next_s += random.exponential(1.0 / ARRIVALS_PER_S)
        alive = {i: (one, end_s) for i, (one, end_s) in alive.items() if end_s > t_s}
        now = scene([one for one, _ in alive.values()], t_s)
        found = zip(now.ids.tolist(), view_at(t_s).imagine(now.boxes), strict=True)
        seen = {i: one for i, one in found if one is not None}
        perception = eye.observe(
            ns(t_s), now, seeing(seen, replace(view_at(t_s), period_s=1.0 / rate_hz))
        )
        if k % round(2 * rate_hz) == 0:
            for each in perception.artefacts:
                classes = dict(zip(each.classes, each.probabilities, strict=True))
                number = each.artefact_id
                yield Said(number, each.existence, number in alive, classes, of_id.get(number, ""))


@pytest.fixture(scope="module", params=[5.0, pytest.param(20.0, marks=pytest.mark.long)])
def said(request: pytest.FixtureRequest) -> list[Said]:
    """Return what is said, at each of these rates."""
    return list(told(request.param))


def is_calibrated(said: Any, right: Any) -> list[int]:
    """Compare ten bins, of at least 50, with the shares; return how many are in each.

    Reports of one track two seconds apart are not quite independent: five sigmas, and 0.01.
    """
    bins = np.minimum((said * 10).astype(int), 9)
    counts: list[int] = np.bincount(bins, minlength=10).tolist()
    for each in range(10):
        chosen = bins == each
        if counts[each] >= 50:
            mean, share = said[chosen].mean(), right[chosen].mean()
            sigma = np.sqrt(max(mean * (1.0 - mean), 0.01) / counts[each])
            assert abs(share - mean) < 5.0 * sigma + 0.01, (each, mean, share, counts[each])
    return counts


def test_existence_is_calibrated_in_ten_bins(said: list[Said]) -> None:
    """True tracks, those of the departed, and false alarms alike; no bin is empty."""
    counts = is_calibrated(
        np.array([one.existence for one in said]), np.array([one.exists for one in said])
    )
    assert min(counts) >= 50
    assert 0.05 < np.mean([one.number >= FIRST_ID for one in said]) < 0.5


def test_classes_are_calibrated_in_ten_bins(said: list[Said]) -> None:
    """Of all tracks of artefacts, for all their classes."""
    pairs = [
        (probability, name == one.true_class)
        for one in said
        if one.true_class
        for name, probability in one.classes.items()
    ]
    counts = is_calibrated(*np.array(pairs, float).T)
    assert sum(count >= 50 for count in counts) >= 8
