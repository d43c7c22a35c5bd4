"""All agents as the others see them at the end of one sub-step: poses, speeds, neighbours."""

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.situation import Neighbour
from are_ros.agents.navigation.destinations import Destinations
from are_ros.agents.navigation.step_kernels import CrowdArrays
from are_ros.agents.neighbours import Neighbourhood
from are_ros.population.artefact import Artefact

_Floats = npt.NDArray[np.float64]
_Group = tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Neighbourhood]


class AgentSnapshot:
    """N artefacts in the order of their ids, at one sub-step; results are computed on demand.

    `ids` int64 (N,), `poses` float64 (N, 4), x, y, z, yaw in the map frame, `speeds_mps` float64
    (N,) along the yaw, `ahead_m` float64 (N, AHEAD, 2) where each will be at the end of the next
    epochs, `radii_m` float64 (N,) of circles about (x, y) that contain the bodies.
    `sees` tells whether walls leave an artefact a straight way to a point; `doing` returns the
    indices of the artefacts with a behaviour, ascending.
    """

    def __init__(
        self,
        artefacts: Sequence[Artefact],
        columns: tuple[npt.NDArray[np.int64], _Floats, _Floats, _Floats, _Floats],
        sees: Callable[[Neighbour, float, float], bool],
        doing: Callable[[str], npt.NDArray[np.int64]],
    ) -> None:
        """Take the artefacts, and the columns: ids, poses, speeds, places ahead, radii."""
        self._artefacts = artefacts
        self._ids, poses, speeds_mps, self._ahead_m, self._radii_m = columns
        self._poses = np.ascontiguousarray(poses)
        self._speeds_mps = np.ascontiguousarray(speeds_mps)
        self._sees, self._doing = sees, doing
        self._neighbours: dict[int, Neighbour] = {}
        self._groups: dict[tuple[str, ...], _Group] = {}
        self._nearest: dict[tuple[Neighbourhood, Destinations], npt.NDArray[np.int64]] = {}

    def neighbour(self, artefact_id: int) -> Neighbour | None:
        """Return an artefact that is alive, None if it is not."""
        index = int(self._ids.searchsorted(artefact_id))
        if index == len(self._ids) or self._ids[index] != artefact_id:
            return None
        return self.neighbour_at(index)

    def places_within(
        self,
        me: Neighbour,
        radius_m: float,
        behaviour: str,
        activities: Collection[str],
        places: Destinations,
    ) -> Sequence[int]:
        """Return the index of the destination nearest to each of the others within a radius.

        They come in the order of `within`; there is at least one destination.
        """
        _, ids, group = self._group(behaviour, activities)
        found = group.within(me.x_m, me.y_m, radius_m)
        found = found[ids[found] != me.id]
        if not len(found):
            return ()
        nearest: list[int] = self._nearest_places(group, places)[found].tolist()
        return nearest

    def indices_of(self, artefact_ids: Sequence[int]) -> list[int]:
        """Return the indices of artefacts that are in the arrays."""
        indices: list[int] = self._ids.searchsorted(artefact_ids).tolist()
        return indices

    def neighbour_at(self, index: int) -> Neighbour:
        """Return the artefact at an index as a neighbour, which is constructed once."""
        neighbour = self._neighbours.get(index)
        if neighbour is None:
            neighbour = _neighbour(self._artefacts[index], *self._numbers[index].tolist())
            self._neighbours[index] = neighbour
        return neighbour

    def within(
        self,
        x_m: float,
        y_m: float,
        radius_m: float,
        behaviour: str = "",
        activities: Collection[str] = (),
    ) -> Iterable[Neighbour]:
        """Yield the artefacts whose (x, y) is within a radius of a point, the nearest first.

        With `behaviour` and `activities`, only those with that behaviour and one of the activities.
        """
        if behaviour:
            indices, _, group = self._group(behaviour, activities)
            chosen: list[int] = indices[group.within(x_m, y_m, radius_m)].tolist()
            return map(self.neighbour_at, chosen)
        near: list[int] = self._neighbourhood.within(x_m, y_m, radius_m).tolist()
        if activities:
            near = [i for i in near if self._artefacts[i].activity in activities]
        return map(self.neighbour_at, near)

    def sees(self, me: Neighbour, x_m: float, y_m: float) -> bool:
        """Return whether walls leave this artefact a straight way to a point."""
        return self._sees(me, x_m, y_m)

    @cached_property
    def crowd(self) -> CrowdArrays:
        """All artefacts, as `prospect_of` takes them."""
        cells = self._neighbourhood.cells
        return (*cells, self._poses, self._ahead_m, self._radii_m)

    @cached_property
    def _numbers(self) -> _Floats:
        """A row for each: x, y [m], yaw [rad], speed [m/s] and radius [m]."""
        x_m, y_m, _, yaw_rad = self._poses.T
        return np.column_stack((x_m, y_m, yaw_rad, self._speeds_mps, self._radii_m))

    @cached_property
    def _neighbourhood(self) -> Neighbourhood:
        return Neighbourhood(self._poses[:, :2])

    def _group(self, behaviour: str, activities: Collection[str]) -> _Group:
        """Return the artefacts with a behaviour and one of the activities: indices, ids, grid."""
        key = (behaviour, *activities)
        if key not in self._groups:
            indices = self._doing(behaviour)
            if activities:
                at = [self._artefacts[i].activity in activities for i in indices.tolist()]
                indices = indices[np.array(at, np.bool_)]
            points_m = self._poses[indices, :2]
            self._groups[key] = indices, self._ids[indices], Neighbourhood(points_m)
        return self._groups[key]

    def _nearest_places(self, group: Neighbourhood, places: Destinations) -> npt.NDArray[np.int64]:
        """Return the index of the destination nearest to each of a group; they are found once."""
        key = group, places
        if key not in self._nearest:
            self._nearest[key] = places.nearest_to(group.cells[0])
        return self._nearest[key]


def _neighbour(
    artefact: Artefact, x_m: float, y_m: float, yaw_rad: float, speed_mps: float, radius_m: float
) -> Neighbour:
    """Return an artefact as others see it."""
    row = artefact.row
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
