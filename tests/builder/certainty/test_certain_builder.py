"""The builder with certainty: what it leaves alone, and what follows the list of the perceived."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from are_ros.agents.events import EventKind
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.certainty.false_alarms import FIRST_ID
from are_ros.builder.tick import Demand, Tick
from are_ros.conventions import NS_PER_S
from are_ros.messages.tick_encoding import TickEncoder, offered_outputs
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import with_file
from tests.builder.town import START_NS, TYPES, hall

PRESETS = Path(__file__).resolve().parents[3] / "config" / "presets"
CROWD = {
    "population.arrival_rate": 0.05,
    "population.mean_life": 12.0,
    "mixture.weights": (1.0,),
    "mixture.rates": (2.0,),
    "camera.width": 160,
    "camera.height": 120,
    "occlusion.tau": 5,
    "population.region": "free",
    "seed": 4,
}


def parameters_of(preset: str, values: Mapping[str, Any] | None = None) -> Parameters:
    """Return the parameters of a crowd in front of a small camera, with a preset."""
    parameters = Parameters()
    if preset:
        parameters = with_file(parameters, PRESETS / f"certainty_{preset}.yaml")
    return with_values(parameters, {**CROWD, **(values or {})})


def run(
    preset: str,
    values: Mapping[str, Any] | None = None,
    rate_hz: float = 10.0,
    seconds: float = 20.0,
) -> list[Tick]:
    """Return the ticks of a hall in which a robot turns on the spot."""
    parameters = parameters_of(preset, {"builder.tick_rate": rate_hz, **(values or {})})
    builder = ArBuilder(parameters, TYPES, Demand(markers=False))
    builder.receive_map(hall(10.0, 8.0), START_NS)
    ticks = []
    for k in range(round(seconds * rate_hz)):
        now_ns, yaw = START_NS + round(k * NS_PER_S / rate_hz), 0.3 * k / rate_hz
        turn = (0.0, 0.0, float(np.sin(0.5 * yaw)), float(np.cos(0.5 * yaw)))
        builder.receive_transform("map", "base_link", now_ns, (5.0, 4.0, 0.0), turn, now_ns)
        ticks.append(builder.step(now_ns))
    return ticks


def encoded(ticks: list[Tick], *names: str) -> list[tuple[object, ...]]:
    """Return the messages of some outputs."""
    encoder = TickEncoder()
    return [tuple(one) for tick in ticks for one in encoder.encode(tick, names)]


@pytest.fixture(scope="module")
def plain() -> list[Tick]:
    """Return the ticks without certainty."""
    return run("")


@pytest.fixture(scope="module")
def poor() -> list[Tick]:
    """Return the ticks with a poor detector, often wrong."""
    return run("poor", {"certainty.false_alarm_rate": 2.0})


def test_without_certainty_there_is_no_word_of_it(plain: list[Tick]) -> None:
    """All is certain, as of the tick, and there are no paths."""
    assert sum(len(tick.perceived) for tick in plain) > 100
    for tick in plain:
        assert (tick.perception.stamp_ns, tick.perception.paths) == (tick.stamp_ns, None)
        assert all(one.existence == 1.0 and not any(one.pose_covariance) for one in tick.perceived)
    assert encoded(plain, "predicted") == []


def test_a_perfect_detector_gives_the_same_bytes(plain: list[Tick]) -> None:
    """Its list is A_f, and so are the grids, the events and the metrics."""
    names = ("perceived", "augmented_map", "augmented_costmap", "events", "metrics", "artefacts")
    assert encoded(run("perfect"), *names) == encoded(plain, *names)


def test_lives_motions_and_decisions_are_the_same(plain: list[Tick], poor: list[Tick]) -> None:
    """To the bit, though what is perceived is not."""
    assert encoded(poor, "artefacts") == encoded(plain, "artefacts")
    assert encoded(poor, "perceived") != encoded(plain, "perceived")
    changes = (EventKind.PERCEIVED, EventKind.LOST)
    told = [[e for tick in ticks for e in tick.events if e.kind not in changes]
            for ticks in (plain, poor)]  # fmt: skip
    assert told[0] == told[1]


def test_the_same_again_gives_the_same_bytes(poor: list[Tick]) -> None:
    """All draws come from the seed."""
    again = run("poor", {"certainty.false_alarm_rate": 2.0})
    names = ("perceived", "predicted", "augmented_map", "events", "metrics")
    assert encoded(again, *names) == encoded(poor, *names)


def test_false_alarms_are_in_the_list_and_in_the_grid_but_nowhere_else(poor: list[Tick]) -> None:
    """Where they are told to be; no event and no artefact is of them."""
    alarmed = 0
    cells: Any = None
    for tick in poor:
        if tick.grids.artefact_map is not None:
            cells = tick.grids.artefact_map
        ids = {one.artefact_id for one in tick.perceived if one.artefact_id >= FIRST_ID}
        assert not ids & set(tick.scene.ids.tolist())
        assert not any(event.artefact_id >= FIRST_ID for event in tick.events)
        for one in tick.perceived:
            if one.artefact_id in ids and tick.grids.artefact_map is not None:
                alarmed += 1
                at = cells.cell_at(*one.map_from_artefact.translation_m[:2].tolist())
                assert at is None or cells.cells[at] == 100
        assert tick.metrics.perceived == len(tick.perceived)
    assert alarmed > 10


def test_a_gate_for_all_shows_artefacts_where_they_are(plain: list[Tick]) -> None:
    """It does not ask what is perceived."""
    everything = {"costmap.gate": "all", "certainty.false_alarm_rate": 2.0}
    names = ("augmented_map", "augmented_costmap")
    assert encoded(run("poor", everything), *names) == encoded(run("", everything), *names)
    assert encoded(plain, *names) != encoded(run("", everything), *names)


@pytest.mark.parametrize("rate_hz", [5.0, 20.0])
def test_false_alarms_come_at_their_rate_however_often_the_camera_looks(rate_hz: float) -> None:
    """At 5 and 20 Hz about as many in 20 s: Poisson with the mean 60, four sigmas."""
    values = {"certainty.false_alarm_rate": 3.0, "certainty.min_existence": 0.0}
    ticks = run("good", {**values, "camera.rate": rate_hz}, rate_hz)
    ids = {one.artefact_id for tick in ticks for one in tick.perceived}
    assert sum(number >= FIRST_ID for number in ids) == pytest.approx(60, abs=4 * 60**0.5)


@pytest.mark.parametrize("applies", [False, True])
def test_sensors_meet_what_is_perceived_only_where_it_is_asked_for(
    make_scene: Callable[..., Any], applies: bool
) -> None:
    """By default what is in A_f; else what is in the list, which is a second late here."""
    scene = make_scene(
        {
            "certainty.enabled": True,
            "certainty.detection": 1.0,
            "certainty.half_fraction": 0.0,
            "certainty.latency": 1.0,
            "certainty.applies_to_sensors": applies,
            "sensors.gate": "perceived",
        }
    )
    scene.map(0.0)
    scene.laser(0.0)
    scene.robot(0.0, 1.0, 2.0)
    scene.place(0, (2.5, 2.0), 0.0)
    hit = {}
    for t_s in (0.1, 1.2):
        scene.robot(t_s, 1.0, 2.0)
        scene.tick(t_s)
        received = scene.scan(t_s)
        (released,) = scene.builder.take_readings()
        hit[t_s] = not np.array_equal(released.reading.ranges, received.ranges)
    assert hit == {0.1: not applies, 1.2: True}


def test_a_farewell_and_a_jump_of_the_clock_forget_the_tracks() -> None:
    """Nothing is perceived, and the next tick begins anew."""
    builder = ArBuilder(parameters_of("good", {"certainty.coast": 100.0}), TYPES)
    builder.receive_map(hall(10.0, 8.0), START_NS)
    turn, tick = (0.0, 0.0, 0.0, 1.0), None
    for k in range(100):
        now_ns = START_NS + k * NS_PER_S // 10
        builder.receive_transform("map", "base_link", now_ns, (2.0, 4.0, 0.0), turn, now_ns)
        tick = builder.step(now_ns)
    assert tick is not None
    assert tick.perceived
    gone = builder.farewell(now_ns)
    assert (gone.perceived, gone.perception.stamp_ns) == ((), now_ns)
    assert (gone.perception.paths, gone.perception.step_ns) == ((), tick.perception.step_ns)
    assert gone.perception.step_ns > 0
    assert builder.step(now_ns + NS_PER_S // 10).perceived == ()
    builder.restart(START_NS)
    assert builder.step(START_NS).perceived == ()


@pytest.mark.parametrize("latency_s", [0.0, 0.25])
def test_a_tick_of_a_clock_that_was_set_back_a_little_perceives_as_before(latency_s: float) -> None:
    """It is another look, which may miss one or two; no time goes by for the tracks."""
    parameters = parameters_of("good", {"certainty.latency": latency_s})
    builder, turn = ArBuilder(parameters, TYPES), (0.0, 0.0, 0.0, 1.0)
    builder.receive_map(hall(10.0, 8.0), START_NS)
    for k in range(100):
        now_ns = START_NS + k * NS_PER_S // 10
        builder.receive_transform("map", "base_link", now_ns, (2.0, 4.0, 0.0), turn, now_ns)
        before = {one.artefact_id for one in builder.step(now_ns).perceived}
    after = {one.artefact_id for one in builder.step(now_ns - NS_PER_S // 20).perceived}
    assert after <= before
    assert len(after) > 0.8 * len(before)


def test_paths_are_offered_only_where_there_are_some() -> None:
    """With certainty, and a horizon."""
    assert "predicted" not in offered_outputs(Parameters())
    assert "predicted" in offered_outputs(parameters_of("good"))
    none = parameters_of("good", {"certainty.prediction_horizon": 0.0})
    assert "predicted" not in offered_outputs(none)
