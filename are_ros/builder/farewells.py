"""Those who are leaving: their lives are over, and they are on their way out (section 3.2)."""

import numpy as np
import numpy.typing as npt

from are_ros.agents.table import AgentTable
from are_ros.artefacts.artefact import Artefact
from are_ros.builder.out_of_view import OutOfView
from are_ros.conventions import seconds_to_ns
from are_ros.parameters.choices import Leave
from are_ros.parameters.model import PopulationParameters


class Farewells:
    """Says who may go that is not at an exit: out of patience, or unseen where there is no exit."""

    def __init__(self, settings: PopulationParameters) -> None:
        self._since_ns: dict[int, int] = {}
        self.reconfigure(settings)

    def reconfigure(self, settings: PopulationParameters) -> None:
        """Let other values hold from now on; who is leaving goes on."""
        self.walks_to_exit = settings.leave is Leave.WALK_TO_EXIT
        self._patience_ns = seconds_to_ns(settings.exit_patience)

    def begin(self, artefact: Artefact, now_ns: int) -> None:
        """Let an artefact be on its way out."""
        self._since_ns[artefact.id] = now_ns

    def end(self, artefact_id: int) -> None:
        """Forget one who is gone."""
        self._since_ns.pop(artefact_id, None)

    def due(
        self,
        now_ns: int,
        table: AgentTable,
        exits_m: npt.NDArray[np.float64],
        out_of_view: OutOfView,
    ) -> list[int]:
        """Return the ids of those who vanish now, ascending."""
        if not self._since_ns:
            return []
        ids = sorted(self._since_ns)
        late = [now_ns - self._since_ns[i] >= self._patience_ns for i in ids]
        if len(exits_m):
            return [i for i, is_late in zip(ids, late, strict=True) if is_late]
        boxes = table.boxes.take(table.rows_of(ids))
        hidden = out_of_view.hides(boxes).tolist()
        return [i for i, gone in zip(ids, np.logical_or(late, hidden), strict=True) if gone]
