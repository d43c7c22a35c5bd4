"""The checks of what is perceived with certainty: right lists pass, wrong ones are caught."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from are_ros.bag.decoded import Perceived, Predicted, Scene, Sighting, value_of
from are_ros.bag.types import jazzy_typestore
from are_ros.builder.certainty.perception import Perception
from are_ros.builder.costmap.registration import covered_cells
from are_ros.builder.scene import Scene as TruthScene
from are_ros.checks.certainty import PerceivedPlaces, check_certainty, check_predicted
from are_ros.checks.oracle.solids import RealMap
from are_ros.checks.record import Record, at_their_ticks
from are_ros.checks.result import Outcome
from are_ros.checks.run import check_recording
from are_ros.checks.sightings import check_perceived
from are_ros.messages.artefacts import ArtefactEncoder, encode_perceived, encode_predicted
from tests.builder.certainty.hall import detector, look, ns, room, scene, walkers

COUNT = 60
Lists = list[Perceived]


def read(type_name: str, data: bytes, at_ns: int) -> Any:
    """Return a message as the checks have it."""
    message = jazzy_typestore().deserialize_cdr(data, type_name)
    return value_of(type_name, message, at_ns)


def as_scene(now: TruthScene, at_ns: int) -> Scene:
    """Return the truth as the checks read it."""
    data = ArtefactEncoder().encode("map", at_ns, now)
    found: Scene = read("are_msgs/msg/ArtefactArray", data, at_ns)
    return found


def as_perceived(told: Perception, at_ns: int) -> Perceived:
    """Return a list as the checks read it."""
    data = encode_perceived("map", told.stamp_ns, "robot", told.artefacts)
    found: Perceived = read("are_msgs/msg/PerceivedArtefactArray", data, at_ns)
    return found


def as_predicted(told: Perception, at_ns: int) -> Predicted:
    """Return the paths as the checks read them."""
    data = encode_predicted("map", told.stamp_ns, "robot", told.step_ns, told.paths or ())
    found: Predicted = read("are_msgs/msg/PredictedPathArray", data, at_ns)
    return found


@pytest.fixture
def record() -> Record:
    """Return two seconds of a crowd before a detector with false alarms, a tick late."""
    values = {"certainty.latency": 0.1, "certainty.false_alarm_rate": 3.0}
    eye, crowd = detector(values), walkers(COUNT)
    found = Record(eye.parameters)
    for k in range(20):
        now, at_ns = scene(crowd, 0.1 * k), ns(0.1 * k)
        told = look(eye, crowd, 0.1 * k, 0.6)
        found.scenes.append(as_scene(now, at_ns))
        found.perceived.append(as_perceived(told, at_ns))
        found.predicted.append(as_predicted(told, at_ns))
    return found


def changed(record: Record, name: str, change: Callable[[np.ndarray[Any, Any]], Any]) -> None:
    """Change a field of numbers of all sightings."""
    record.perceived = [
        replace(
            message,
            sightings=tuple(
                Sighting(**{**one._asdict(), name: tuple(change(np.array(getattr(one, name))))})
                for one in message.sightings
            ),
        )
        for message in record.perceived
    ]


def test_what_a_detector_tells_is_plausible(record: Record) -> None:
    """All checks pass, over many sightings."""
    results = check_certainty(record), check_predicted(record), check_perceived(record)
    assert [result.outcome for result in results] == [Outcome.PASSED] * 3
    assert all(result.looked_at > 100 for result in results)
    assert all(record.is_of_its_time(message) for message in record.perceived)


def test_behaviours_that_are_not_as_often_true_as_said_are_caught() -> None:
    """Over the first reports of many tracks; and probabilities that do not sum to one."""
    eye, crowd = detector({"certainty.behaviour_accuracy": 0.7}), walkers(100)
    record, random = Record(eye.parameters), np.random.default_rng(3)
    for one in crowd:
        one.behaviour = str(random.choice(("walking", "running")))
    record.scenes.append(as_scene(scene(crowd, 0.0), ns(0.0)))
    record.perceived.append(as_perceived(look(eye, crowd, 0.0), ns(0.0)))
    right = check_certainty(record)
    assert right.outcome is Outcome.PASSED
    assert "behaviours: " in right.reason
    assert check_perceived(record).outcome is Outcome.PASSED
    before = record.perceived
    changed(record, "behaviours", lambda names: ["standing", *names[1:]])
    assert "behaviours 0 are true, and" in check_certainty(record).counter_example
    record.perceived = before
    changed(record, "behaviour_probabilities", lambda p: 0.5 * p)
    assert "has behaviour probabilities that sum to 0.5" in check_perceived(record).counter_example


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("pose_covariance", lambda c: 0.5 * c, "of the pose are"),
        ("pose_covariance", lambda c: 5.0 * c, "of the pose are"),
        ("twist_covariance", lambda c: 0.5 * c, "of the velocity are"),
        ("pose_covariance", lambda c: 0.0 * c, "is off by a normalised square of inf in its pose"),
        ("pose", lambda p: [p[0] + 3.0, *p[1:]], "in its pose"),
        ("twist", lambda t: [t[0], t[1] - 9.0, *t[2:]], "in its velocity"),
    ],
)
def test_errors_that_do_not_fit_their_covariances_are_caught(
    record: Record, name: str, change: Any, said: str
) -> None:
    """Too small ones, too large ones, and errors far beyond."""
    changed(record, name, change)
    result = check_certainty(record)
    assert result.outcome is Outcome.FAILED
    assert said in result.counter_example


def test_what_was_never_there_is_caught(record: Record) -> None:
    """A false alarm where there are none, and an id that nobody had."""
    settings = record.parameters
    assert settings is not None
    quiet = replace(settings.certainty, false_alarm_rate=0.0)
    record.parameters = replace(settings, certainty=quiet)
    assert "is a false alarm, and there are none" in check_perceived(record).counter_example
    record.scenes = record.scenes[:0]
    assert "was never alive" in check_perceived(record).counter_example


def test_paths_of_others_and_paths_that_become_surer_are_caught(record: Record) -> None:
    """Each list has the paths of its own artefacts."""
    right = record.predicted[-1]
    some = dict(right.paths)
    some.pop(next(iter(some)))
    for paths, said in (
        (some, "the ids are not the perceived"),
        ({i: path[::-1] for i, path in right.paths.items()}, "more sure ahead"),
        ({i: path[:-1] for i, path in right.paths.items()}, "has 3 poses"),
    ):
        record.predicted[-1] = replace(right, paths=MappingProxyType(paths))
        assert said in check_predicted(record).counter_example


def test_a_list_of_another_age_is_caught(record: Record) -> None:
    """It is as old as the latency says, less than a tick more."""
    message = record.perceived[5]
    for age_ns, is_right in ((99_999_999, False), (199_999_999, True), (200_000_000, False)):
        aged = replace(message, stamp_ns=message.at_ns - age_ns)
        assert record.is_of_its_time(aged) == is_right


def test_cells_are_those_of_the_places_that_are_told() -> None:
    """As the builder registers them, false alarms too."""
    eye, crowd, places = (
        detector({"certainty.false_alarm_rate": 9.0}),
        walkers(30),
        PerceivedPlaces(),
    )
    grid = room().grid
    for k in range(5):
        told = look(eye, crowd, 0.1 * k)
    places.learn(as_scene(scene(crowd, 0.4), ns(0.4)))
    found = places.covers(as_perceived(told, ns(0.4)), RealMap.of_grid(grid))
    assert told.boxes is not None
    cells = covered_cells(told.boxes, grid)
    for k, one in enumerate(told.artefacts):
        wanted = np.zeros(grid.cells.shape, np.bool_)
        patch = cells.patch(k)
        patch.part_of(wanted)[:] = patch.mask
        cover = found[one.artefact_id]
        assert set(np.flatnonzero(wanted)) - set(cover.touched) == set(cover.sure)


def listed(stamps: Sequence[int]) -> Lists:
    """Return live lists of these stamps."""
    return [Perceived(stamp_ns, stamp_ns, "map", ()) for stamp_ns in stamps]


def test_live_lists_belong_to_the_ticks_that_gave_them_out() -> None:
    """The first that is late enough, each its own, though two lists are alike."""
    ticks = [0, 100, 200, 500, 600]
    lists = listed([-250, -150, 0, 200, 200])
    found = [one.at_ns for one in at_their_ticks(lists, ticks, 250e-9, frozenset())]
    assert found == [0, 100, 500, 600, 200]


def test_the_list_of_a_farewell_is_that_of_no_tick() -> None:
    """It has its own time, and the ticks after a pause have the lists that they gave out."""
    ticks = [0, 100, 200, 1000, 1100]
    lists = listed([-250, -150, -50, 290, 750, 850])
    found = [one.at_ns for one in at_their_ticks(lists, ticks, 250e-9, frozenset([290]))]
    assert found == [0, 100, 200, 290, 1000, 1100]


def test_a_replay_with_a_detector_passes_all_checks(
    replay_sample: Callable[..., Path],
) -> None:
    """From the command to the check, with false alarms in the grids."""
    preset = Path(__file__).resolve().parents[2] / "config" / "presets" / "certainty_good.yaml"
    often, telling = "certainty.false_alarm_rate:=2.0", "certainty.behaviour_accuracy:=0.7"
    values = ("--set", often, "--set", telling)
    out = replay_sample("--params", preset, *values, "--with-inputs")
    results = tuple(check_recording(out))
    wrong = [result.sentence() for result in results if result.outcome is Outcome.FAILED]
    assert wrong == []
    by_name = {result.name: result for result in results}
    assert by_name["certainty"].looked_at > 10
    assert "false alarm" in by_name["certainty"].reason
    assert "behaviours: " in by_name["certainty"].reason
    assert by_name["predicted paths"].outcome is Outcome.PASSED
