"""False alarms: how many, where, for how long, and that they are nobody."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
import pytest
from scipy.stats import chisquare, expon, kstest, poisson

from are_ros.agents.events import Sighting
from are_ros.builder.certainty.false_alarms import FIRST_ID, FalseAlarm, FalseAlarms
from are_ros.builder.certainty.perception import View
from are_ros.conventions import NS_PER_S
from are_ros.parameters.model import CertaintyParameters
from are_ros.population.mixture import TruncatedPoissonMixture
from are_ros.world.boxes import OrientedBoxes
from tests.builder.certainty.hall import (
    CATALOGUE,
    START_NS,
    VIEW,
    detector,
    ns,
    scene,
    seeing,
    sight,
    sights,
    view,
    walkers,
)

LEVEL = 1e-3
LAW = TruncatedPoissonMixture((1.0,), (1.0,), 4)


def alarms(
    looks: int, period_s: float, view_: View = VIEW, seed: int = 7, **values: Any
) -> list[list[FalseAlarm]]:
    """Return the false alarms that begin at each of some looks."""
    view_ = replace(view_, period_s=period_s)
    settings, source = CertaintyParameters(**values), FalseAlarms(seed, CATALOGUE.rows, LAW)
    return [
        source.begin(START_NS + round(k * period_s * NS_PER_S), settings, view_)
        for k in range(looks)
    ]


@pytest.mark.parametrize(("rate_hz", "looks"), [(5, 3_000), (10, 3_000), (20, 3_000)])
def test_their_number_is_poisson_at_the_rate(rate_hz: int, looks: int) -> None:
    """At each look, with the mean rate * period; so a second has as many at 5, 10 and 20 Hz."""
    counts = Counter(map(len, alarms(looks, 1.0 / rate_hz, false_alarm_rate=4.0)))
    mean = 4.0 / rate_hz
    top = int(poisson(mean).isf(5.0 / looks))
    observed = [counts[n] for n in range(top)] + [sum(v for n, v in counts.items() if n >= top)]
    expected = [looks * poisson(mean).pmf(n) for n in range(top)]
    assert chisquare(observed, [*expected, looks - sum(expected)]).pvalue > LEVEL


def ahead(boxes: OrientedBoxes) -> Sequence[Sighting | None]:
    """See what is ahead, x > |y|, within 6 m."""
    places = boxes.centres_m[:, :2].tolist()
    return [sight() if x > abs(y) and math.hypot(x, y) < 6.0 else None for x, y in places]


def test_they_are_uniform_over_the_visible_area() -> None:
    """In equal parts of a quarter of a disc (level 1e-3), and nowhere else."""
    begun = [*chain.from_iterable(alarms(200, 1.0, view(ahead), false_alarm_rate=10.0))]
    places = np.array([one.body.motion[:2] for one in begun])
    assert len(places) > 1_800
    ranges, bearings = np.hypot(*places.T), np.arctan2(places[:, 1], places[:, 0])
    assert ranges.max() < 6.0
    assert np.abs(bearings).max() < 0.25 * math.pi
    rings = np.minimum((ranges / 6.0) ** 2 * 4, 3).astype(int)
    sectors = ((bearings / (0.5 * math.pi) + 0.5) * 4).astype(int)
    assert chisquare(np.bincount(4 * rings + sectors, minlength=16)).pvalue > LEVEL


def test_their_lives_are_exponential_and_their_types_those_of_the_catalogue() -> None:
    """With the mean of the parameter, and by Eq. 1."""
    begun = [*chain.from_iterable(alarms(200, 1.0, false_alarm_rate=10.0, false_alarm_life=0.7))]
    lives = [(one.end_ns - one.body.at_ns) / NS_PER_S for one in begun]
    assert kstest(lives, expon(scale=0.7).cdf).pvalue > LEVEL
    rows = np.bincount([one.body.row.index for one in begun], minlength=4)
    assert chisquare(rows, LAW.probabilities() * len(begun)).pvalue > LEVEL


def test_where_nothing_can_be_seen_there_are_none() -> None:
    """They need a place in view."""
    assert not any(alarms(5, 1.0, view(lambda boxes: [None] * len(boxes)), false_alarm_rate=9.0))


def test_a_false_alarm_does_not_depend_on_the_others() -> None:
    """The third is the same, whatever the rate brought before it."""
    few = [*chain.from_iterable(alarms(2_000, 0.1, false_alarm_rate=0.1))]
    many = [*chain.from_iterable(alarms(10, 0.1, false_alarm_rate=30.0))]
    assert few[2].artefact_id == many[2].artefact_id == FIRST_ID + 2
    assert few[2].body.motion == many[2].body.motion
    assert few[2].end_ns - few[2].body.at_ns == many[2].end_ns - many[2].body.at_ns


def test_the_detector_tracks_them_as_it_tracks_others_and_they_die() -> None:
    """Each has an id of its own, is doubted as soon as it is over, and is then gone.

    Two artefacts a second come into view, too, so that half of what begins is true.
    """
    eye, crowd = detector({"certainty.false_alarm_rate": 2.0}), walkers(200)
    told: dict[int, list[float]] = {}
    for k in range(1_000):
        here = crowd[k // 5 : k // 5 + 1]
        seen = eye.observe(ns(0.1 * k), scene(here, 0.1 * k), seeing(sights(here)))
        for one in seen.artefacts:
            told.setdefault(one.artefact_id, []).append(one.existence)
    false = [values for number, values in told.items() if number >= FIRST_ID]
    assert 150 < len(false) < 250
    assert 3.0 < np.mean([len(values) for values in false]) < 12.0
    assert np.mean([values[0] for values in false]) == pytest.approx(0.5, abs=0.1)
    assert np.mean([values[-1] for values in false if len(values) > 3]) < 0.35
    assert {number for number in told if number < FIRST_ID} <= {one.id for one in crowd}
