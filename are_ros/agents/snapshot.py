"""Everybody as the others see them, at the end of one sub-step: who is near, where, how fast."""

import math
from collections.abc import Callable, Collection, Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.situation import Neighbour
from are_ros.agents.navigation.step_kernels import CrowdArrays
from are_ros.agents.neighbours import Neighbourhood
from are_ros.population.artefact import Artefact

_Floats = npt.NDArray[np.float64]
_Group = tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Neighbourhood]


class AgentSnapshot:
    """N artefacts by id, ascending; made for one sub-step, and computed as far as it is asked for.

    `ids` int64 (N,), `poses` float64 (N, 4), x, y, z, yaw in the map frame, `speeds_mps` float64
    (N,) along the yaw, `radii_m` float64 (N,) of the circles about (x, y) that hold the bodies.
    `sees` tells whether an artefact could go straight from where it is to a point, `doing` at
    which indices those of a behaviour are, ascending.
    """

    def __init__(
        self,
        artefacts: Sequence[Artefact],
        columns: tuple[npt.NDArray[np.int64], _Floats, _Floats, _Floats],
        sees: Callable[[Neighbour, float, float], bool],
        doing: Callable[[str], npt.NDArray[np.int64]],
    ) -> None:
        """Take the artefacts, and the columns: ids, poses, speeds, radii."""
        self._artefacts = artefacts
        self._ids, poses, speeds_mps, self._radii_m = columns
        self._poses = np.ascontiguousarray(poses)
        self._speeds_mps = np.ascontiguousarray(speeds_mps)
        self._sees, self._doing = sees, doing
        self._neighbours: dict[int, Neighbour] = {}
        self._groups: dict[tuple[str, ...], _Group] = {}

    def neighbour(self, artefact_id: int) -> Neighbour | None:
        """Return an artefact that is alive, None if it is not."""
        index = self.index_of(artefact_id)
        if index == len(self._ids) or self._ids[index] != artefact_id:
            return None
        return self.neighbours([index])[0]

    def points_within(
        self,
        x_m: float,
        y_m: float,
        radius_m: float,
        behaviour: str,
        activities: Collection[str],
        but_id: int,
    ) -> npt.NDArray[np.float64]:
        """Return where those are, (M, 2), whom `within` returns, but for one."""
        _, ids, group = self._group(behaviour, activities)
        return group.points_within(x_m, y_m, radius_m, ids, but_id)

    def index_of(self, artefact_id: int) -> int:
        """Return the index in the arrays of an artefact that is there."""
        return int(self._ids.searchsorted(artefact_id))

    def indices_of(self, artefact_ids: Sequence[int]) -> list[int]:
        """Return the indices in the arrays of artefacts that are there."""
        indices: list[int] = self._ids.searchsorted(artefact_ids).tolist()
        return indices

    def neighbours(self, indices: Sequence[int]) -> list[Neighbour]:
        """Return who is at some indices of the arrays, each made once."""
        neighbours = self._neighbours
        new = [i for i in indices if i not in neighbours]
        if new:
            poses, speeds_mps = self._poses[new].tolist(), self._speeds_mps[new].tolist()
            artefacts, radii_m = [self._artefacts[i] for i in new], self._radii_m[new].tolist()
            made = map(_neighbour, artefacts, poses, speeds_mps, radii_m)
            neighbours.update(zip(new, made, strict=True))
        return [neighbours[i] for i in indices]

    def within(
        self,
        x_m: float,
        y_m: float,
        radius_m: float,
        behaviour: str = "",
        activities: Collection[str] = (),
    ) -> Sequence[Neighbour]:
        """Return those whose (x, y) is at most this far from a point, the nearest first.

        Of one behaviour, if it is given, and at one of these activities, if any are.
        """
        if behaviour:
            who, _, group = self._group(behaviour, activities)
            chosen: list[int] = who[group.within(x_m, y_m, radius_m)].tolist()
            return self.neighbours(chosen)
        near: list[int] = self._neighbourhood.within(x_m, y_m, radius_m).tolist()
        if activities:
            near = [i for i in near if self._artefacts[i].activity in activities]
        return self.neighbours(near)

    def sees(self, me: Neighbour, x_m: float, y_m: float) -> bool:
        """Say whether this artefact could go straight on to a point, were nobody in its way."""
        return self._sees(me, x_m, y_m)

    @cached_property
    def crowd(self) -> CrowdArrays:
        """Everybody, as `route_step` takes them."""
        cells = self._neighbourhood.cells
        return (*cells, self._poses, self._speeds_mps, self._radii_m)

    @cached_property
    def _neighbourhood(self) -> Neighbourhood:
        return Neighbourhood(self._poses[:, :2])

    def _group(self, behaviour: str, activities: Collection[str]) -> _Group:
        """Return those of one behaviour, at one of these activities if any: indices, ids, where."""
        key = (behaviour, *activities)
        if key not in self._groups:
            indices = self._doing(behaviour)
            if activities:
                at = [self._artefacts[i].activity in activities for i in indices.tolist()]
                indices = indices[np.array(at, np.bool_)]
            points_m = self._poses[indices, :2]
            self._groups[key] = indices, self._ids[indices], Neighbourhood(points_m)
        return self._groups[key]


def _neighbour(
    artefact: Artefact, pose: list[float], speed_mps: float, radius_m: float
) -> Neighbour:
    """Return one as others see it, at a pose x, y, z, yaw."""
    (x_m, y_m, _, yaw_rad), row = pose, artefact.row
    return Neighbour(
        artefact.id,
        row.class_name,
        row.label,
        x_m,
        y_m,
        yaw_rad,
        speed_mps * math.cos(yaw_rad),
        speed_mps * math.sin(yaw_rad),
        radius_m,
        artefact.behaviour,
        artefact.activity,
    )
