"""Requests at run time: spawn an artefact, remove one, remove all, set another seed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from are_ros.agents.behaviours.registry import BEHAVIOURS, why_not
from are_ros.builder.simulation import Simulation
from are_ros.errors import CatalogueError
from are_ros.population.artefact import GroundPose, on_ground
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.randomness import Purpose, generator
from are_ros.world.rigid_transform import RigidTransform

_ANY_ROW: Final = -1


@dataclass(frozen=True, eq=False)
class SpawnRequest:
    """A request to place an artefact at `frame_from_pose`: x, y and yaw, on the ground.

    `label` names a row or a class; `row` is the index of a row, -1 for any row of the label. With
    `life_ns` None, the life is drawn; so is a behaviour that is not given.
    """

    frame_id: str
    frame_from_pose: RigidTransform
    label: str = ""
    row: int = _ANY_ROW
    life_ns: int | None = None
    behaviour: str = ""


class Requests:
    """Executes requests at once, or raises the reason and changes nothing."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._seed = simulation.parameters.seed
        self._requests = 0

    def spawn(self, request: SpawnRequest, now_ns: int) -> int:
        """Place an artefact at exactly this pose, and return its id.

        Raises CatalogueError for an unknown label or row, or a behaviour that the row cannot have,
        FrameError for an unknown frame, PlacementError if it cannot stand there.
        """
        simulation = self._simulation
        simulation.advance(now_ns)
        row = self._row_of(request)
        pose = self._ground_pose(request, row)
        return simulation.lives.place(
            row, pose, now_ns, life_ns=request.life_ns, behaviour=request.behaviour
        )

    def remove(self, artefact_id: int, now_ns: int) -> None:
        """Remove one artefact; InputError if none of this id is alive."""
        self._simulation.advance(now_ns)
        self._simulation.lives.remove(artefact_id, now_ns)

    def clear(self, now_ns: int) -> int:
        """Remove all artefacts, and return how many; arrivals go on."""
        self._simulation.advance(now_ns)
        return self._simulation.lives.clear(now_ns)

    def reseed(self, seed: int, now_ns: int) -> None:
        """Draw from another seed from now on; artefacts alive stay."""
        self._simulation.reseed(seed, now_ns)
        self._seed, self._requests = seed, 0

    def _row_of(self, request: SpawnRequest) -> CatalogueRow:
        catalogue = self._simulation.catalogue
        rows: Sequence[CatalogueRow]
        rows = catalogue.rows_named(request.label) if request.label else catalogue.rows
        if request.row == _ANY_ROW:
            rows = self._able(rows, request)
            self._requests += 1
            stream = generator(self._seed, Purpose.REQUEST, self._requests)
            return rows[int(stream.integers(len(rows)))]
        chosen = [row for row in rows if row.index == request.row]
        if not chosen:
            among = f" of '{request.label}'" if request.label else ""
            first, last = rows[0].index, rows[-1].index
            message = f"the catalogue has no row {request.row}{among}: the rows are {first}..{last}"
            raise CatalogueError(message)
        return self._able(chosen, request)[0]

    def _able(self, rows: Sequence[CatalogueRow], request: SpawnRequest) -> Sequence[CatalogueRow]:
        """Return the rows that can have the behaviour requested; CatalogueError if none can.

        A user-defined class must be named in the catalogue: no request imports other code.
        """
        name = request.behaviour
        if not name:
            return rows
        named = {own for row in self._simulation.catalogue.rows for own in row.behaviours}
        if name not in named and name not in BEHAVIOURS:
            known = ", ".join(sorted(named | set(BEHAVIOURS)))
            raise CatalogueError(f"behaviour '{name}' is not known; known are {known}")
        refusals = [why_not(name, row.motion.speed_mps) for row in rows]
        able = [row for row, refusal in zip(rows, refusals, strict=True) if refusal is None]
        if not able:
            raise CatalogueError(f"behaviour '{name}' {refusals[0]}")
        return able

    def _ground_pose(self, request: SpawnRequest, row: CatalogueRow) -> GroundPose:
        """Return the pose in the map frame, on the ground."""
        map_frame = self._simulation.parameters.frames.map
        frame_id = request.frame_id.lstrip("/") or map_frame
        map_from_frame = self._simulation.frames.lookup_latest(map_frame, frame_id)
        map_from_pose = map_from_frame @ request.frame_from_pose
        x_m, y_m, _ = map_from_pose.translation_m.tolist()
        yaw_rad = map_from_pose.yaw_rad()
        flat = GroundPose(x_m, y_m, 0.0, yaw_rad)
        environment = self._simulation.world.environment
        return flat if environment is None else on_ground(row, flat, environment)
