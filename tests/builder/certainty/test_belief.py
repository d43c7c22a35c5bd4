"""Existence and class of a track, by Bayes' rule, against enumeration and against the truth."""

import math

import numpy as np
import pytest

from are_ros.builder.certainty.belief import Belief, Census, Existence

CLASSES = {"person": 0.6, "car": 0.3, "pallet": 0.1}


def enumerated(
    prior: float, chances: list[tuple[float, bool]], rates: tuple[float, float]
) -> float:
    """Return the probability that an artefact is there, by all histories of when things end.

    Slow and obvious: the source is drawn, then the step in which it ends; looks are a second apart.
    """
    weights = {True: 0.0, False: 0.0}
    for is_artefact, share, rate in ((True, prior, rates[0]), (False, 1.0 - prior, rates[1])):
        for end in range(len(chances) + 1):
            lasts = math.exp(-rate * end)
            weight = share * (lasts if end == len(chances) else lasts * (1.0 - math.exp(-rate)))
            for step, (chance, is_detected) in enumerate(chances):
                detects = chance if step < end else 0.0
                weight *= detects if is_detected else 1.0 - detects
            weights[is_artefact and end == len(chances)] += weight
    return weights[True] / sum(weights.values())


@pytest.mark.parametrize("seed", range(8))
def test_existence_is_that_of_all_histories(seed: int) -> None:
    """For any sequence of detections, misses and looks at which nothing can be seen."""
    random = np.random.default_rng(seed)
    chances = [(float(random.choice((0.0, 0.4, 0.9))), False) for _ in range(8)]
    chances = [(p, bool(p and random.random() < 0.4)) for p, _ in chances]
    belief = Existence(0.7, 0.3)
    for probability, is_detected in chances:
        belief = belief.later(1.0, 0.1, 1.3)
        belief = belief.detected() if is_detected else belief.missed(probability)
        assert sum(belief) == pytest.approx(1.0, abs=1e-12)
    assert belief.artefact == pytest.approx(enumerated(0.7, chances, (0.1, 1.3)), abs=1e-12)


def test_a_sure_miss_is_the_end() -> None:
    """What would surely have been detected is not there."""
    assert Existence(1.0, 0.0).missed(1.0) == (0.0, 0.0, 1.0)
    assert Existence(1.0, 0.0).detected() == (1.0, 0.0, 0.0)


def test_the_census_is_the_rule_of_succession() -> None:
    """The prior of a track is the share among those before it."""
    census = Census(CLASSES)
    assert census.existence(are_false_alarms_possible=True).artefact == 0.5
    for _ in range(3):
        census.count_artefact("car")
    census.count_false_alarm()
    assert census.existence(are_false_alarms_possible=True).artefact == pytest.approx(4.0 / 6.0)
    assert census.existence(are_false_alarms_possible=False) == (1.0, 0.0, 0.0)
    names, shares = census.class_belief().ranked(census.classes)
    assert names == ("car", "person", "pallet")
    thirds = (0.3 + 1 / 3 + 3, 0.6 + 1 / 3, 0.1 + 1 / 3)
    assert shares == pytest.approx([share / 5.0 for share in thirds])


def test_class_probabilities_are_calibrated() -> None:
    """Of 30,000 beliefs, those that say p are right with the share p, bin by bin (four sigmas)."""
    random = np.random.default_rng(11)
    prior, said, right = (0.6, 0.3, 0.1), list[float](), list[bool]()
    for true_index in random.choice(3, size=10_000, p=prior):
        belief = Belief(np.array(prior))
        for _ in range(1 + int(random.integers(3))):
            belief.look(random, int(true_index), 0.7, 0)
        names, probabilities = belief.ranked(tuple(CLASSES))
        said += probabilities
        right += [name == tuple(CLASSES)[true_index] for name in names]
    bins = np.minimum((np.array(said) * 10).astype(int), 9)
    assert len(set(bins.tolist())) >= 8
    for each in set(bins.tolist()):
        chosen = bins == each
        mean, share = np.mean(np.array(said)[chosen]), np.mean(np.array(right)[chosen])
        assert share == pytest.approx(mean, abs=4.0 * math.sqrt(mean * (1 - mean) / chosen.sum()))


def test_a_sure_look_names_the_true_class_alone() -> None:
    """Then no other class is possible."""
    belief = Belief(np.array((0.6, 0.3, 0.1)))
    belief.look(np.random.default_rng(1), 2, 1.0, 0)
    assert belief.ranked(tuple(CLASSES)) == (("pallet",), (1.0,))


def test_one_class_is_certain() -> None:
    """There is no other to take it for."""
    belief = Belief(np.array((1.0,)))
    belief.look(np.random.default_rng(1), 0, 0.2, 0)
    assert belief.ranked(("thing",)) == (("thing",), (1.0,))


def test_a_detection_after_hours_is_of_an_artefact() -> None:
    """No probability is left of either source by then; a false alarm does not last so long."""
    belief = Existence(0.7, 0.3).later(7000.0, 0.2, 2.0)
    assert (belief.artefact, belief.false_alarm) == (0.0, 0.0)
    assert belief.detected() == Existence(1.0, 0.0)
