"""Farewells: who of those on their way out may vanish now."""

import numpy as np
import numpy.typing as npt
import pytest

from are_ros.artefacts.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.shapes import Shape
from are_ros.builder.crowd import Crowd
from are_ros.builder.farewells import Farewells
from are_ros.builder.out_of_view import OutOfView
from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import GroundKind
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import PopulationParameters
from are_ros.world.boxes import OrientedBoxes

ROW = CatalogueRow(0, "one", "kind", (0.3, 0.5, 1.7), (0.0, 0.0, 0.0), Shape.PERSON)
EXITS, NO_EXITS = np.array([[9.0, 9.0]]), np.empty((0, 2))


class Camera(OutOfView):
    """Sees what is at x > 0."""

    def __init__(self) -> None:
        super().__init__(10.0)

    def hides(self, boxes: OrientedBoxes) -> npt.NDArray[np.bool_]:
        """Tell who is behind it."""
        return np.asarray(boxes.centres_m[:, 0] <= 0.0)


def settings(patience_s: float = 10.0, leave: str = "walk_to_exit") -> PopulationParameters:
    """Return the parameters."""
    return with_values(PopulationParameters(), {"exit_patience": patience_s, "leave": leave})


def crowd_at(*xs_m: float) -> Crowd:
    """Return one at each x; the ids are 10, 11 and so on."""
    crowd = Crowd(GroundKind.PLANE)
    for k, x_m in enumerate(xs_m):
        crowd.add(10 + k, ROW, GroundPose(x_m, 0.0, 0.0, 0.0))
    return crowd


def begin(farewells: Farewells, artefact_id: int, t_s: float) -> None:
    """Let one be leaving."""
    history = PoseHistory(0, GroundPose(0.0, 0.0, 0.0, 0.0))
    farewells.begin(Artefact(artefact_id, ROW, Origin.RANDOM, 0, history), round(t_s * NS_PER_S))


def due(
    farewells: Farewells, t_s: float, crowd: Crowd, exits: npt.NDArray[np.float64]
) -> list[int]:
    """Return who vanishes."""
    return farewells.due(round(t_s * NS_PER_S), crowd, exits, Camera())


def test_nobody_vanishes_who_is_not_leaving() -> None:
    """Not even unseen."""
    assert due(Farewells(settings()), 100.0, crowd_at(-1.0, 1.0), NO_EXITS) == []


@pytest.mark.parametrize(("t_s", "gone"), [(9.999, []), (10.0, [11]), (12.0, [10, 11])])
def test_where_there_are_exits_patience_decides(t_s: float, gone: list[int]) -> None:
    """Ten seconds from each one's own beginning, in the order of ids, seen or not."""
    farewells = Farewells(settings())
    begin(farewells, 11, 0.0)
    begin(farewells, 10, 2.0)
    assert due(farewells, t_s, crowd_at(-1.0, 1.0), EXITS) == gone


def test_where_there_are_none_the_unseen_vanish() -> None:
    """Of two who leave and one who does not, the one behind the camera; the other when late."""
    farewells = Farewells(settings())
    crowd = crowd_at(-1.0, -1.0, 1.0)
    for artefact_id in (12, 10):
        begin(farewells, artefact_id, 0.0)
    assert due(farewells, 1.0, crowd, NO_EXITS) == [10]
    assert due(farewells, 10.0, crowd, NO_EXITS) == [10, 12]


def test_who_is_gone_is_forgotten() -> None:
    """One that was removed otherwise is asked for no more, nor one that never was."""
    farewells = Farewells(settings(0.0))
    begin(farewells, 10, 0.0)
    farewells.end(10)
    farewells.end(99)
    assert due(farewells, 1.0, crowd_at(-1.0), NO_EXITS) == []


def test_other_values_hold_for_who_is_leaving_already() -> None:
    """Less patience makes late at once; vanishing asks nobody to walk."""
    farewells = Farewells(settings())
    walked_before = farewells.walks_to_exit
    begin(farewells, 10, 0.0)
    farewells.reconfigure(settings(1.0, "vanish"))
    assert (walked_before, farewells.walks_to_exit) == (True, False)
    assert due(farewells, 2.0, crowd_at(1.0), EXITS) == [10]
