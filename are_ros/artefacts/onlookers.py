"""Everybody as the others see them, at the end of one sub-step: who is near, where, how fast."""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from are_ros.artefacts._step_kernels import CrowdArrays
from are_ros.artefacts.artefact import Artefact
from are_ros.artefacts.behaviours.situation import Fellow
from are_ros.artefacts.neighbourhood import Neighbourhood

_Group = tuple[npt.NDArray[np.intp], npt.NDArray[np.int64], Neighbourhood]


class Onlookers:
    """N artefacts by id, ascending; made for one sub-step, and computed as far as it is asked for.

    `ids` int64 (N,), `poses` float64 (N, 4), x, y, z, yaw in the map frame, `speeds_mps` float64
    (N,) along the yaw, `radii_m` float64 (N,) of the circles about (x, y) that hold the bodies.
    `sees` tells whether an artefact could go straight from where it is to a point, `doers` who of
    the living is of a behaviour; without it they are looked through.
    """

    def __init__(
        self,
        living: Mapping[int, Artefact],
        ids: npt.NDArray[np.int64],
        poses: npt.NDArray[np.float64],
        speeds_mps: npt.NDArray[np.float64],
        radii_m: npt.NDArray[np.float64],
        sees: Callable[[Fellow, float, float], bool],
        doers: Callable[[str], Sequence[int]] | None = None,
    ) -> None:
        self.living = living
        self._ids = ids
        self._poses = np.ascontiguousarray(poses)
        self._speeds_mps = np.ascontiguousarray(speeds_mps)
        self._radii_m = radii_m
        self._sees = sees
        self._doers = doers or self._looked_through
        self._fellows: dict[int, Fellow] = {}
        self._groups: dict[tuple[str, ...], _Group] = {}

    def fellow(self, artefact_id: int) -> Fellow | None:
        """Return an artefact that is alive, None if it is not."""
        artefact = self.living.get(artefact_id)
        if artefact is None:
            return None
        index = self.index_of(artefact_id)
        if index not in self._fellows:
            speed_mps, radius_m = float(self._speeds_mps[index]), float(self._radii_m[index])
            pose: list[float] = self._poses[index].tolist()
            self._fellows[index] = _fellow(artefact, pose, speed_mps, radius_m)
        return self._fellows[index]

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

    def has(self, artefact_ids: Sequence[int]) -> list[bool]:
        """Say which of some artefacts are there."""
        ids = np.array(artefact_ids, np.int64)
        before, upto = (self._ids.searchsorted(ids, side) for side in ("left", "right"))
        found: list[bool] = (before < upto).tolist()
        return found

    def fellows(self, artefacts: Sequence[Artefact]) -> list[Fellow]:
        """Return artefacts that are there: of many at once much quicker than one by one."""
        indices = self.indices_of([artefact.id for artefact in artefacts])
        return self._as_fellows(indices, artefacts)

    def within(
        self,
        x_m: float,
        y_m: float,
        radius_m: float,
        behaviour: str = "",
        activities: Collection[str] = (),
    ) -> Sequence[Fellow]:
        """Return those whose (x, y) is at most this far from a point, the nearest first.

        Of one behaviour, if it is given, and at one of these activities, if any are.
        """
        if behaviour:
            who, _, group = self._group(behaviour, activities)
            chosen: list[int] = who[group.within(x_m, y_m, radius_m)].tolist()
            return self._fellows_at(chosen)
        near: list[int] = self._neighbourhood.within(x_m, y_m, radius_m).tolist()
        if activities:
            living, ids = self.living, self._id_list
            near = [i for i in near if living[ids[i]].activity in activities]
        return self._fellows_at(near)

    def sees(self, me: Fellow, x_m: float, y_m: float) -> bool:
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
            living, who = self.living, self._doers(behaviour)
            if activities:
                who = [i for i in who if living[i].activity in activities]
            ids = np.array(who, np.int64)
            indices = self._ids.searchsorted(ids)
            self._groups[key] = indices, ids, Neighbourhood(self._poses[indices, :2])
        return self._groups[key]

    def _looked_through(self, behaviour: str) -> list[int]:
        """Return the ids of those of one behaviour."""
        found = map(self.living.get, self._id_list)
        return [one.id for one in found if one is not None and one.behaviour == behaviour]

    @cached_property
    def _id_list(self) -> list[int]:
        ids: list[int] = self._ids.tolist()
        return ids

    def _fellows_at(self, indices: Sequence[int]) -> list[Fellow]:
        """Return who is at some indices of the arrays, each made once."""
        fellows = self._fellows
        new = [i for i in indices if i not in fellows]
        if new:
            ids: list[int] = self._ids[new].tolist()
            self._as_fellows(new, [self.living[artefact_id] for artefact_id in ids])
        return [fellows[i] for i in indices]

    def _as_fellows(self, indices: Sequence[int], artefacts: Sequence[Artefact]) -> list[Fellow]:
        """Make fellows of those at some indices, and keep them."""
        poses, speeds_mps = self._poses[indices].tolist(), self._speeds_mps[indices].tolist()
        radii_m = self._radii_m[indices].tolist()
        fellows = list(map(_fellow, artefacts, poses, speeds_mps, radii_m))
        self._fellows.update(zip(indices, fellows, strict=True))
        return fellows


def _fellow(artefact: Artefact, pose: list[float], speed_mps: float, radius_m: float) -> Fellow:
    """Return one as others see it, at a pose x, y, z, yaw."""
    (x_m, y_m, _, yaw_rad), row = pose, artefact.row
    return Fellow(
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
