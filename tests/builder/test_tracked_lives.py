"""Artefacts on tracks in the real world: their jumps are said, and they leave on time."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from are_ros.agents.events import ArtefactEvent, EventKind

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
    assert scene.builder.lives.crowd.counts.displaced == 1


def test_a_life_that_ends_with_a_sub_step_ends_before_it(scripted: Callable[[str], Scene]) -> None:
    """At the instant of a sub-step a departure comes first: the robot touches nobody."""
    poses = "[0, 2.5, 2.0, 0, 0], [0.1, 2.5, 2.0, 0, 0], [0.2, 1.1, 2.0, 0, 0]"
    scene = scripted(CRATE % (0.1, "displaced", poses))
    (departed,) = told(scene, 1.0)
    assert (departed.kind, departed.stamp_ns) == (EventKind.DEPARTED, scene.ns(0.2))
    assert scene.builder.lives.crowd.counts.displaced == 1
