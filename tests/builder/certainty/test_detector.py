"""The list that a detector and a tracker give: when, of whom, and in what order."""

from collections.abc import Sequence

import numpy as np
import pytest

from are_ros.agents.events import PerceivedArtefact
from are_ros.builder.certainty.perception import Perception
from are_ros.builder.certainty.track import Process
from are_ros.population.artefact import Artefact
from tests.builder.certainty.hall import detector, look, ns, scene, seeing, sights, walkers

PERFECT = {
    "certainty.detection": 1.0,
    "certainty.half_fraction": 0.0,
    "certainty.half_range": 0.0,
    "certainty.class_accuracy": 1.0,
    **{
        f"certainty.{name}": 0.0
        for name in (
            *("position_noise", "range_noise", "bearing_noise", "yaw_noise", "speed_noise"),
            *("turn_noise", "acceleration", "turn_acceleration", "coast"),
        )
    },
}


def text(perception: Perception) -> list[tuple[object, ...]]:
    """Return what a list says, as comparable values."""
    return [
        (one.artefact_id, *one.map_from_artefact.translation_m.tolist(), one.existence, one.classes)
        for one in perception.artefacts
    ]


def run(values: dict[str, object], crowd: Sequence[Artefact]) -> list[Perception]:
    """Return three seconds of looks at a crowd, with false alarms."""
    eye = detector({"certainty.false_alarm_rate": 2.0, **values})
    return [look(eye, crowd, 0.1 * k, 0.4) for k in range(30)]


def test_the_same_seed_gives_the_same_and_another_gives_another() -> None:
    """All draws come from the seed."""
    crowd = walkers(20)
    first, again = run({"seed": 5}, crowd), run({"seed": 5}, crowd)
    assert [*map(text, first)] == [*map(text, again)]
    assert [*map(text, first)] != [*map(text, run({"seed": 6}, crowd))]


def test_what_is_told_of_one_does_not_depend_on_the_others() -> None:
    """But for the priors, which are the shares among all: detections and errors are its own."""
    crowd = walkers(20)

    def errors(perceptions: Sequence[Perception]) -> list[list[float]]:
        return [
            one.map_from_artefact.translation_m.tolist()
            for perception in perceptions
            for one in perception.artefacts
            if one.artefact_id == 7
        ]

    alone = errors(run({}, crowd[6:7]))
    assert alone == errors(run({}, crowd))
    assert len(alone) > 20


def test_live_parameters_change_what_it_expects() -> None:
    """Classes and false alarms by another mixture, as a detector has that begins with it."""
    skewed = {"mixture.weights": (1.0,), "mixture.rates": (0.01,)}
    kept, new = detector(), detector(skewed)
    old = kept._census.class_belief()
    kept.reconfigure(new.parameters)
    assert kept._census.class_belief().probabilities == pytest.approx(
        new._census.class_belief().probabilities
    )
    assert kept._census.class_belief().probabilities[0] > old.probabilities[0] + 0.1
    assert kept._false_alarms.law.probabilities() == pytest.approx(
        new._false_alarms.law.probabilities()
    )
    assert kept._behaviours.belief().probabilities == pytest.approx(
        new._behaviours.belief().probabilities
    )


def test_a_list_is_in_the_order_of_ids_and_of_its_stamp() -> None:
    """The false alarms come last."""
    for perception in run({}, walkers(20)):
        ids = [one.artefact_id for one in perception.artefacts]
        assert ids == sorted(ids)
        assert perception.boxes is not None
        assert len(perception.boxes) == len(ids)


@pytest.mark.parametrize("latency_s", [0.1, 0.25, 0.3])
def test_the_list_is_of_the_newest_tick_that_is_old_enough(latency_s: float) -> None:
    """Its stamp says so, and its poses are those of then; before there is one, it is empty."""
    crowd = walkers(5)
    eye = detector({**PERFECT, "certainty.latency": latency_s})
    ticks = -(-round(latency_s * 1000) // 100)
    for k in range(10):
        seen = look(eye, crowd, 0.1 * k)
        if k < ticks:
            assert seen.artefacts == ()
            continue
        then = scene(crowd, 0.1 * (k - ticks))
        assert seen.stamp_ns == ns(0.1 * (k - ticks))
        places = [one.map_from_artefact.translation_m[:2] for one in seen.artefacts]
        np.testing.assert_array_equal(places, then.motions[:, :2])
        assert {one.sighting.seen_ns for one in seen.artefacts} == {seen.stamp_ns}


def test_no_list_is_of_before_the_beginning_of_time() -> None:
    """Where a clock begins at 0, the first lists are of 0, and empty."""
    eye = detector({**PERFECT, "certainty.latency": 0.3})
    empty = scene((), 0.0)
    stamps = [eye.observe(k * 10**8, empty, seeing({})).stamp_ns for k in range(6)]
    assert stamps == [0, 0, 0, 0, 10**8, 2 * 10**8]


def test_a_track_coasts_and_is_given_up() -> None:
    """Unseen it goes on for a second, ever less sure, and says when it was last seen."""
    crowd = walkers(1)
    eye = detector({**PERFECT, "certainty.coast": 1.0, "certainty.acceleration": 0.5})
    (before,) = look(eye, crowd, 0.0).artefacts
    variance = before.pose_covariance[0]
    for k in range(1, 11):
        seen = eye.observe(ns(0.1 * k), scene(crowd, 0.1 * k), seeing({}))
        (one,) = seen.artefacts
        assert one.sighting.seen_ns == ns(0.0)
        assert one.pose_covariance[0] > variance
        variance = one.pose_covariance[0]
    assert eye.observe(ns(1.1), scene(crowd, 1.1), seeing({})).artefacts == ()


def test_between_looks_it_predicts() -> None:
    """A camera that looks each half second: the list goes on, with growing covariances."""
    values = {"camera.rate": 2.0, "certainty.coast": 0.0, "certainty.detection": 1.0}
    crowd, eye = walkers(1), detector({**values, "certainty.half_fraction": 0.0})
    spreads = []
    for k in range(10):
        seen = seeing(sights(crowd)) if k % 5 == 0 else None
        (one,) = eye.observe(ns(0.1 * k), scene(crowd, 0.1 * k), seen).artefacts
        spreads.append(one.pose_covariance[0])
    assert all(np.diff(spreads)[[0, 1, 2, 3, 5, 6, 7, 8]] > 0.0)
    assert spreads[5] < spreads[4]


def test_the_departed_is_missed_and_forgotten() -> None:
    """It is listed for some looks, with less and less existence."""
    crowd, eye = walkers(1), detector({"certainty.detection": 0.6, "certainty.half_fraction": 0.0})
    for k in range(5):
        look(eye, crowd, 0.1 * k)
    told = []
    for k in range(5, 15):
        told += [
            o.existence for o in eye.observe(ns(0.1 * k), scene((), 0.0), seeing({})).artefacts
        ]
    assert 2 < len(told) < 10
    assert all(np.diff(told) < 0.0)


def test_a_path_is_the_estimate_that_goes_on() -> None:
    """At constant rates, with the covariance of the tracker's own model, step by step."""
    crowd = walkers(4)
    eye = detector({"certainty.prediction_horizon": 1.5, "certainty.prediction_step": 0.5})
    for k in range(5):
        seen = look(eye, crowd, 0.1 * k)
    assert seen.paths is not None
    assert seen.step_ns == ns(0.5) - ns(0.0)
    process = Process.of(eye.parameters.certainty, 1.0)
    for one, path in zip(seen.artefacts, seen.paths, strict=True):
        assert path.artefact_id == one.artefact_id
        assert path.numbers.shape == (3, 43)
        track = eye._tracks[one.artefact_id]
        x, y, _, yaw, vx, vy, turn = track.estimate
        wanted = (x + vx, y + vy, 0.8, 0.0, 0.0, np.sin(0.5 * (yaw + turn)))
        np.testing.assert_allclose(path.numbers[1, :6], wanted, atol=1e-12)
        grown = process.step @ track.error.covariance @ process.step.T
        grown = grown + process.noise @ process.noise.T
        told = path.numbers[1, 7:].reshape(6, 6)
        np.testing.assert_allclose(told[np.ix_((0, 1, 5), (0, 1, 5))], grown[:3, :3], atol=1e-12)
        assert np.count_nonzero(told) <= 9


def test_without_a_horizon_there_are_no_paths() -> None:
    """Not even empty ones."""
    eye = detector({"certainty.prediction_horizon": 0.0})
    assert look(eye, walkers(2), 0.0).paths is None


def test_a_label_is_known_as_far_as_the_class_is() -> None:
    """A detector that may be wrong gives the most probable class as the label."""

    def labels(accuracy: float) -> list[PerceivedArtefact]:
        eye = detector({**PERFECT, "certainty.class_accuracy": accuracy})
        return list(look(eye, walkers(50), 0.0).artefacts)

    truths = {one.id: one.row for one in walkers(50)}
    assert all(one.label == truths[one.artefact_id].label for one in labels(1.0))
    unsure = labels(0.5)
    assert all(one.label == one.classes[0] for one in unsure)
    assert all(list(one.probabilities) == sorted(one.probabilities)[::-1] for one in unsure)
    wrong = [one.classes[0] != truths[one.artefact_id].class_name for one in unsure]
    assert 5 < sum(wrong) < 45
