"""Artefacts on tracks in the real world: their jumps are said, and some leave with a sub-step."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from are_ros.artefacts.population_events import Cause
from are_ros.builder.events import ArtefactEvent, EventKind

Scene = Any
"""The `Scene` of conftest, which tests cannot import."""
Make = Callable[..., Scene]

CRATE = "artefacts: [{label: crate, arrives: 0.1, stays: %s, left_by: %s, track: [%s]}]\n"


@pytest.fixture
def scripted(make_scene: Make, tmp_path: Path) -> Callable[[str], Scene]:
    """Return a maker of the room, the robot at (1, 2), with a scenario."""

    def make(scenario: str) -> Scene:
        path = tmp_path / "scenario.yaml"
        path.write_text(scenario, encoding="utf-8")
        scene = make_scene({"population.scenario": str(path)})
        scene.map(0.0)
        scene.robot(0.0, 1.0, 2.0)
        return scene

    return make


def told(scene: Scene, until_s: float) -> list[ArtefactEvent]:
    """Return what has happened until then, arrivals apart."""
    for k in range(1, round(until_s / 0.05) + 1):
        scene.robot(0.05 * k, 1.0, 2.0)
        scene.builder.advance(scene.ns(0.05 * k))
    events: list[ArtefactEvent] = scene.builder.lives.take_events()
    return [event for event in events if event.kind is not EventKind.ARRIVED]


def test_a_jump_is_said_and_counted(scripted: Callable[[str], Scene]) -> None:
    """Once, with how far; neither going, nor turning or sinking on the spot is one."""
    poses = (
        "[0, 2.5, 2.0, 0, 0], [0.5, 3.0, 2.0, 0, 0], [0.8, 3.0, 2.0, 0, 0],"
        "[0.8000005, 3.0, 2.0, 0, 1], [1.2, 3.0, 2.0, 0, 1], [1.2000005, 2.7, 1.6, 0, 1]"
    )
    scene = scripted(CRATE % (5, "life_over", poses))
    (event,) = told(scene, 2.0)
    assert (event.kind, event.detail) == (EventKind.DISPLACED, "moved")
    assert event.value == pytest.approx(0.5)
    assert event.stamp_ns == scene.ns(1.25)
    assert scene.builder.lives.displaced == 1


def test_who_ends_with_a_sub_step_is_met_in_it(scripted: Callable[[str], Scene]) -> None:
    """It stands where the robot is at its very end: the contact is said, then that it left."""
    poses = (
        "[0, 2.5, 2.0, 0, 0], [0.1, 2.5, 2.0, 0, 0], [0.15, 1.1, 2.0, 0, 0], [0.2, 1.1, 2.0, 0, 0]"
    )
    contact, departed = told(scripted(CRATE % (0.1, "displaced", poses)), 1.0)
    assert (contact.kind, departed.kind) == (EventKind.ROBOT_CONTACT, EventKind.DEPARTED)
    assert contact.stamp_ns == departed.stamp_ns
    assert departed.detail == Cause.DISPLACED.value


def test_who_ends_before_it_is_not(scripted: Callable[[str], Scene]) -> None:
    """A life that is over when a sub-step ends, with no pose of the track then, is over before."""
    poses = "[0, 2.5, 2.0, 0, 0], [0.1, 2.5, 2.0, 0, 0], [0.15, 1.1, 2.0, 0, 0]"
    scene = scripted(CRATE % (0.1, "displaced", poses))
    (departed,) = told(scene, 1.0)
    assert (departed.kind, departed.stamp_ns) == (EventKind.DEPARTED, scene.ns(0.2))
    assert scene.builder.lives.displaced == 1


def test_who_leaves_with_a_sub_step_goes_though_nothing_moves(
    scripted: Callable[[str], Scene],
) -> None:
    """No input comes in any more, so that nobody moves: its life is over all the same."""
    poses = "[0, 2.5, 2.0, 0, 0], [9, 2.5, 2.0, 0, 0]"
    scene = scripted(CRATE % (8.9, "life_over", poses))
    scene.builder.advance(scene.ns(20.0))
    *_, departed = scene.builder.lives.take_events()
    assert (departed.kind, departed.stamp_ns) == (EventKind.DEPARTED, scene.ns(9.0))
