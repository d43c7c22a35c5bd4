"""The live node and the replay give the same: over real DDS, in processes of their own."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from are_ros.agents.events import EventKind
from tests.record.live_runs import (
    Sent,
    events_of,
    fates_of,
    on_the_wire,
    outputs_of,
    replay_of,
    run_demo,
    stamp_ns_of,
)

SUB_STEP_NS = 50_000_000
OUTPUTS = {
    *("artefacts", "perceived", "metrics", "events", "markers", "scan"),
    *("augmented_map", "augmented_map_updates", "augmented_costmap"),
    *("artefact_map", "artefact_map_updates", "augmented_octomap"),
    *("camera/image/compressed", "camera/camera_info"),
    *("depth/image/compressedDepth", "depth/camera_info"),
}

HAPPENED = {
    *(EventKind.ARRIVED, EventKind.DEPARTED, EventKind.DISPLACED),
    *(EventKind.PERCEIVED, EventKind.LOST, EventKind.ROBOT_CONTACT),
}

Outputs = Mapping[str, list[Sent]]


def assert_equal(live: Outputs, replayed: Outputs) -> None:
    """Check that the outputs are the same up to the end of the window, message for message.

    What the live node sends beyond is of the last /clock, the end itself, and of its farewell:
    later than the last tick of the replay.
    """
    last_ns = stamp_ns_of(replayed["artefacts"][-1].message)
    assert live.keys() == replayed.keys() == OUTPUTS
    for name, expected in replayed.items():
        found = live[name][: len(expected)]
        for number, (one, other) in enumerate(zip(found, expected, strict=True)):
            equal = on_the_wire(one.data) == on_the_wire(other.data)
            assert equal, f"{name} {number}:\n{one.message}\n{other.message}"
        beyond = [stamp_ns_of(sent.message) for sent in live[name][len(expected) :]]
        assert all(stamp_ns > last_ns for stamp_ns in beyond), name


def test_in_lockstep_every_message_is_the_replay_s(lockstep_run: Path, replayed: Path) -> None:
    """All outputs, to the byte, while artefacts come, go, are seen, lost and driven into."""
    live, expected = outputs_of(lockstep_run), outputs_of(replayed)
    assert {event.kind for event in events_of(expected)} >= HAPPENED
    assert len(fates_of(expected)) > 20
    assert len(expected["artefacts"]) == 150
    assert_equal(live, expected)


def test_at_a_rate_the_same_artefacts_live(free_run: Path, replayed: Path) -> None:
    """Who comes, of which row, and when it comes and goes: times within two sub-steps.

    Lives begin with the sub-step that first finds the map. At a rate the time goes on while DDS
    carries the map, so that it may be found a sub-step later than where it was recorded: all lives
    are then later by as much. Where artefacts stand depends on what the robot's pose was then, and
    so does who finds no place; and who lives for less than a tick may be seen by none, in either.
    """
    live, expected = fates_of(outputs_of(free_run)), fates_of(outputs_of(replayed))
    told = {event.identifier for event in events_of(outputs_of(replayed))}
    common = [number for number in expected if number in live]
    assert len(common) >= len(expected) - 2
    assert set(live) <= {max(expected) + 1, *told}
    for number in common:
        one, other = live[number], expected[number]
        assert one.row == other.row
        assert abs(one.arrival_ns - other.arrival_ns) <= 2 * SUB_STEP_NS
        assert abs(one.departure_ns - other.departure_ns) <= 2 * SUB_STEP_NS


def test_at_a_rate_the_same_happens(free_run: Path, replayed: Path) -> None:
    """Arrivals and departures are told in the same order, and at times within two sub-steps."""
    for kind in (EventKind.ARRIVED, EventKind.DEPARTED):
        live, expected = (
            [event for event in events_of(outputs_of(folder)) if event.kind == kind]
            for folder in (free_run, replayed)
        )
        assert abs(len(live) - len(expected)) <= 2
        for one, other in zip(live, expected, strict=False):
            assert one.identifier == other.identifier
            assert abs(one.stamp_ns - other.stamp_ns) <= 2 * SUB_STEP_NS


@pytest.mark.long
def test_the_whole_sample_in_lockstep_is_the_replay_s(
    ros_available: None,  # noqa: ARG001 - it skips
    tmp_path: Path,
) -> None:
    """A minute of it, to the byte."""
    run_demo(tmp_path / "live", "--lockstep")
    replay_of(tmp_path / "live", tmp_path / "replay", None)
    live, expected = outputs_of(tmp_path / "live"), outputs_of(tmp_path / "replay")
    assert {event.kind for event in events_of(expected)} >= HAPPENED
    assert_equal(live, expected)
