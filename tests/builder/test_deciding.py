"""What the minds are shown."""

from typing import Any

import numpy as np

from are_ros.artefacts.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.artefacts.catalogue import CatalogueRow, MotionLimits
from are_ros.artefacts.minds import Minds
from are_ros.artefacts.motion.body import Body
from are_ros.artefacts.motion.traffic import Traffic
from are_ros.artefacts.navigation import Navigation
from are_ros.artefacts.shapes import Shape
from are_ros.artefacts.terrain import Terrains
from are_ros.builder.crowd import Crowd
from are_ros.builder.deciding import view_of
from are_ros.parameters.choices import GroundKind
from are_ros.parameters.model import BehaviourParameters

WALK = MotionLimits(1.3, 1.5, 3.0, 0.0, 1.8)
ROW = CatalogueRow(0, "one", "person", (0.3, 0.5, 1.7), (0, 0, 0), Shape.PERSON, motion=WALK)


class Tracks:
    """A player of tracks of some."""

    ids = (2, 6)


def test_those_of_a_behaviour_are_found_whoever_moves_them() -> None:
    """Minds that were sent out, and those on a track, whose doings change as the track says."""
    crowd, traffic = Crowd(GroundKind.PLANE), Traffic(0.05)
    navigation = Navigation(BehaviourParameters(), Terrains())
    minds, living = Minds(1, 0.05, 1.0, navigation), {}
    for k in range(1, 8):
        pose = GroundPose(float(k), 0.0, 0.0, 0.0)
        one = Artefact(k, ROW, Origin.RANDOM, 0, PoseHistory(0, pose), behaviour="walking")
        living[k] = one
        crowd.add(k, ROW, pose)
        traffic.add(k, pose, Body.of(ROW))
        if k not in Tracks.ids:
            minds.admit(one, Body.of(ROW))
    minds.send_out(5)
    player: Any = Tracks()

    def found(behaviour: str) -> list[int]:
        view = view_of(living, crowd, traffic, minds, player)
        return [fellow.id for fellow in view.within(0.0, 0.0, 99.0, behaviour)]

    assert found("walking") == [1, 2, 3, 4, 6, 7]
    assert found("leaving") == [5]
    living[6].behaviour = "leaving"
    assert found("walking") == [1, 2, 3, 4, 7]
    assert found("leaving") == [5, 6]
    minds.dismiss(3)
    crowd.remove(3)
    traffic.remove(3)
    del living[3]
    assert found("walking") == [1, 2, 4, 7]
    np.testing.assert_array_equal(traffic.ids, crowd.ids)
