"""What is told of behaviours, against enumeration, and against what artefacts truly do."""

import itertools
import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from are_ros.builder.certainty.belief import BehaviourLaw, Belief, behaviour_shares
from are_ros.builder.certainty.false_alarms import FIRST_ID
from tests.builder.certainty.hall import (
    CATALOGUE,
    detector,
    look,
    ns,
    room,
    scene,
    seeing,
    view,
    walkers,
)
from tests.builder.certainty.test_calibration import is_calibrated

Floats = npt.NDArray[np.float64]
NAMES = ("walking", "stopping", "running")
RATES = np.array(((-0.25, 0.2, 0.05), (0.5, -0.5, 0.0), (0.3, 0.1, -0.4)))
"""How the behaviours of the tests follow each other [1/s]."""
ON = {"certainty.behaviour_accuracy": 0.6, "certainty.behaviour_time": 0.5}


def slow_expm(matrix: Floats) -> Floats:
    """Return the exponential of a small matrix by many small steps."""
    step = np.eye(len(matrix)) + matrix / 2.0**20
    for _ in range(20):
        step = step @ step
    return step


def law_of_counts() -> BehaviourLaw:
    """Return a law that has seen a hundred seconds of each behaviour."""
    law = BehaviourLaw(dict.fromkeys(NAMES, 1 / 3), 10.0)
    for was, became in itertools.product(range(3), range(3)):
        if was != became:
            for _ in range(round(100.0 * RATES[was, became])):
                law.count_time(NAMES[was], NAMES[became], 0.0)
        else:
            law.count_time(NAMES[was], NAMES[was], 100.0)
    return law


def test_rates_are_counts_over_times() -> None:
    """Begun with one change in a mean life, which is spread over all others."""
    rates = law_of_counts().rates()
    assert rates.sum(axis=1) == pytest.approx(np.zeros(3), abs=1e-15)
    assert rates[0, 1] == pytest.approx((20 + 0.5) / 110.0)
    assert rates[1, 2] == pytest.approx(0.5 / 110.0)
    assert BehaviourLaw({"one": 1.0}, 10.0).rates().tolist() == [[0.0]]


@pytest.mark.parametrize("seed", range(6))
def test_the_belief_is_that_of_all_histories(seed: int) -> None:
    """The sum over all sequences of behaviours, weighted by looks and changes."""
    random = np.random.default_rng(seed)
    law, accuracy, times_s = law_of_counts(), 0.7, random.uniform(0.1, 3.0, 5)
    belief, named = Belief(np.array((0.5, 0.3, 0.2))), list[int]()
    for dt_s in times_s:
        law.predict([belief], float(dt_s))
        draws, truth = np.random.default_rng(int(100 * dt_s)), int(random.integers(3))
        uniform, shift = draws.random(), int(draws.integers(1, 3))
        named.append(truth if uniform < accuracy else (truth + shift) % 3)
        belief.look(np.random.default_rng(int(100 * dt_s)), truth, accuracy, 0)
    steps = [slow_expm(law.rates() * dt_s) for dt_s in times_s]
    weights = np.zeros(3)
    for states in itertools.product(range(3), repeat=6):
        weight = (0.5, 0.3, 0.2)[states[0]]
        for k, step in enumerate(steps):
            weight *= step[states[k], states[k + 1]]
            weight *= accuracy if named[k] == states[k + 1] else 0.5 * (1.0 - accuracy)
        weights[states[-1]] += weight
    assert belief.probabilities == pytest.approx(weights / weights.sum(), abs=1e-6)


def test_a_look_names_the_truth_as_often_as_it_says() -> None:
    """And the others alike (four sigmas); of nothing it names any one alike."""
    draws, counts = np.random.default_rng(5), np.zeros((2, 4))
    for row, truth in enumerate((2, None)):
        for _ in range(4000):
            belief = Belief(np.full(4, 0.25))
            belief.look(draws, truth, 0.7, 0)
            counts[row, int(belief.probabilities.argmax())] += 1
    wanted = np.array(((0.1, 0.1, 0.7, 0.1), (0.25, 0.25, 0.25, 0.25)))
    assert counts / 4000 == pytest.approx(wanted, abs=4.0 * math.sqrt(0.25 / 4000))


def test_behaviours_that_the_catalogue_does_not_know_are_learnt() -> None:
    """They were impossible before; then they have a number, and a sure look finds them."""
    law = BehaviourLaw({"walking": 1.0}, 10.0)
    belief = law.belief()
    assert belief.ranked(law.names) == (("walking",), (1.0,))
    law.count_time("walking", "dancing", 0.1)
    law.count_begun("dancing")
    assert law.names == ["walking", "dancing"]
    assert law.belief().ranked(law.names)[0] == ("walking", "dancing")
    belief.widen(2)
    belief.look(np.random.default_rng(1), law.number("dancing"), 1.0, 0)
    assert belief.ranked(law.names) == (("dancing",), (1.0,))
    law.predict([belief], 1.0)
    assert belief.probabilities[1] > 0.8


def test_the_catalogue_gives_the_first_shares() -> None:
    """Of the behaviours of its rows, weighted by how probable these are."""
    first = replace(CATALOGUE.rows[0], behaviours={"walking": 3.0, "stopping": 1.0})
    second = replace(CATALOGUE.rows[1], behaviours={"walking": 1.0})
    shares = behaviour_shares([first, second], np.array((0.4, 0.6)))
    assert shares == pytest.approx({"walking": 0.9, "stopping": 0.1})


def test_probabilities_of_behaviours_are_calibrated_in_ten_bins() -> None:
    """Of artefacts that change their minds: what is told with p is so with the share p."""
    random, eye = np.random.default_rng(31), detector(ON | {"certainty.detection": 0.8})
    artefacts, dt_s = walkers(20), 0.5
    steps = slow_expm(RATES * dt_s)
    states = random.integers(3, size=len(artefacts))
    said: list[tuple[float, bool]] = []
    for k in range(600):
        if k % 30 == 0:  # others come, whose behaviours are of the same law
            artefacts = walkers(20, seed=k, first_id=1 + 100 * k)
            states = random.integers(3, size=len(artefacts))
        states = np.array([random.choice(3, p=steps[state]) for state in states])
        for artefact, state in zip(artefacts, states.tolist(), strict=True):
            artefact.behaviour = NAMES[state]
        truth = {one.id: one.behaviour for one in artefacts}
        perception = look(eye, artefacts, k * dt_s, 0.6)
        if k > 60 and k % 2 == 0:
            for one in perception.artefacts:
                if one.artefact_id in truth:
                    true = truth[one.artefact_id]
                    pairs = zip(one.behaviours, one.behaviour_probabilities, strict=True)
                    said += [(p, name == true) for name, p in pairs]
    counts = is_calibrated(*np.array(said, float).T)
    assert min(counts) >= 50


def test_by_default_nothing_is_told_and_nothing_else_changes_with_it() -> None:
    """The draws of all other things are theirs alone."""
    plain, telling = detector(), detector(ON)
    artefacts = walkers(5)
    for k in range(50):
        without, told = (look(eye, artefacts, 0.1 * k, 0.5).artefacts for eye in (plain, telling))
        assert [one.behaviours for one in without] == [()] * len(without)
        for one, other in zip(without, told, strict=True):
            assert sum(other.behaviour_probabilities) == pytest.approx(1.0)
            assert [*other.behaviour_probabilities] == sorted(
                other.behaviour_probabilities, reverse=True
            )
            assert one.pose_covariance == other.pose_covariance
            assert one.probabilities == other.probabilities
            assert repr(one.map_from_artefact) == repr(other.map_from_artefact)


def test_it_can_begin_while_the_node_runs() -> None:
    """Tracks that are there already are told from their next detection on."""
    eye, artefacts = detector(), walkers(3)
    look(eye, artefacts, 0.0)
    eye.parameters = detector(ON).parameters
    told = look(eye, artefacts, 0.1).artefacts
    assert told
    assert all(one.behaviours for one in told)


def test_a_false_alarm_does_nothing_in_particular() -> None:
    """Any behaviour is named of it; on the average none more than others."""
    eye = detector(ON | {"certainty.false_alarm_rate": 30.0, "certainty.false_alarm_life": 5.0})
    someone = walkers(3)
    for artefact, name in zip(someone, NAMES, strict=True):
        artefact.behaviour = name
    for k in range(40):
        told = eye.observe(ns(0.1 * k), scene(someone, 0.1 * k), seeing({}, view(None, room())))
    alarms = [one for one in told.artefacts if one.artefact_id >= FIRST_ID]
    assert len(alarms) > 50
    assert all(sum(one.behaviour_probabilities) == pytest.approx(1.0) for one in alarms)
