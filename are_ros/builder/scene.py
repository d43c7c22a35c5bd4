"""The artefacts of one instant, with their boxes."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from are_ros.agents.trajectory_buffer import motions_at
from are_ros.population.artefact import Artefact, GroundPose, boxes_of
from are_ros.population.catalogue import CatalogueRow
from are_ros.world.boxes import OrientedBoxes


@dataclass(frozen=True, eq=False)
class Scene:
    """N artefacts in the order of their ids, where they stand, and their boxes in the map frame.

    `motions` float64 (N, 7) are the poses, and the rates of x, y [m/s] and yaw [rad/s].
    """

    artefacts: tuple[Artefact, ...]
    poses: tuple[GroundPose, ...]
    boxes: OrientedBoxes
    motions: npt.NDArray[np.float64]

    @classmethod
    def of(cls, artefacts: Sequence[Artefact], t_ns: int) -> "Scene":
        """Return the scene of these artefacts at `t_ns`."""
        placed, rates = motions_at([artefact.history for artefact in artefacts], t_ns)
        poses = tuple(map(GroundPose._make, placed.tolist()))
        boxes = boxes_of([artefact.row for artefact in artefacts], poses)
        return cls(tuple(artefacts), poses, boxes, np.concatenate((placed, rates), axis=1))

    @cached_property
    def ids(self) -> npt.NDArray[np.int64]:
        """The ids (N,), ascending."""
        return np.array([artefact.id for artefact in self.artefacts], dtype=np.int64)

    @cached_property
    def rows(self) -> tuple[CatalogueRow, ...]:
        """The rows of the artefacts."""
        return tuple([artefact.row for artefact in self.artefacts])

    def __len__(self) -> int:
        """Count the artefacts."""
        return len(self.artefacts)

    def only(self, ids: frozenset[int]) -> "Scene":
        """Return the scene of the artefacts with these ids."""
        chosen = [i for i, artefact in enumerate(self.artefacts) if artefact.id in ids]
        return Scene(
            tuple(self.artefacts[i] for i in chosen),
            tuple(self.poses[i] for i in chosen),
            self.boxes.take(np.array(chosen, dtype=np.int64)),
            self.motions[np.array(chosen, dtype=np.int64)],
        )
