"""Who of those on their way out may vanish now."""

import numpy as np
import numpy.typing as npt
import pytest

from are_ros.agents.table import AgentTable
from are_ros.builder.population_manager import overdue
from are_ros.builder.spawning.spawner import OutOfView
from are_ros.conventions import NS_PER_S
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.shapes import Shape
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


def crowd_at(*xs_m: float) -> AgentTable:
    """Return one at each x; the ids are 10, 11 and so on."""
    table = AgentTable(0.05)
    for k, x_m in enumerate(xs_m):
        history = PoseHistory(0, GroundPose(x_m, 0.0, 0.0, 0.0))
        table.add(Artefact(10 + k, ROW, Origin.RANDOM, 0, history))
    return table


def leave(table: AgentTable, artefact_id: int, t_s: float) -> None:
    """Let one be leaving."""
    table.leaving_ns[table.row_of(artefact_id)] = round(t_s * NS_PER_S)


def due(
    table: AgentTable, t_s: float, exits: npt.NDArray[np.float64], patience_s: float = 10.0
) -> list[int]:
    """Return who vanishes."""
    now_ns, patience_ns = (round(time_s * NS_PER_S) for time_s in (t_s, patience_s))
    return overdue(table, now_ns, patience_ns, exits, Camera())


def test_nobody_vanishes_who_is_not_leaving() -> None:
    """Not even unseen."""
    assert due(crowd_at(-1.0, 1.0), 100.0, NO_EXITS) == []


@pytest.mark.parametrize(("t_s", "gone"), [(9.999, []), (10.0, [11]), (12.0, [10, 11])])
def test_where_there_are_exits_patience_decides(t_s: float, gone: list[int]) -> None:
    """Ten seconds from each one's own beginning, in the order of ids, seen or not."""
    table = crowd_at(-1.0, 1.0)
    leave(table, 11, 0.0)
    leave(table, 10, 2.0)
    assert due(table, t_s, EXITS) == gone


def test_where_there_are_none_the_unseen_vanish() -> None:
    """Of two who leave and one who does not, the one behind the camera; the other when late."""
    table = crowd_at(-1.0, -1.0, 1.0)
    for artefact_id in (12, 10):
        leave(table, artefact_id, 0.0)
    assert due(table, 1.0, NO_EXITS) == [10]
    assert due(table, 10.0, NO_EXITS) == [10, 12]


def test_who_is_gone_is_asked_for_no_more() -> None:
    """One that was removed otherwise."""
    table = crowd_at(-1.0)
    leave(table, 10, 0.0)
    table.remove(10)
    assert due(table, 1.0, NO_EXITS, 0.0) == []


def test_other_values_hold_for_who_is_leaving_already() -> None:
    """Less patience makes late at once."""
    table = crowd_at(1.0)
    leave(table, 10, 0.0)
    assert due(table, 2.0, EXITS) == []
    assert due(table, 2.0, EXITS, 1.0) == [10]
