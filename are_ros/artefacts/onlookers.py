"""Everybody as the others see them, at the end of one sub-step: who is near, where, how fast."""

import math
from bisect import bisect_left
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from are_ros.artefacts._step_kernels import CrowdArrays
from are_ros.artefacts.artefact import Artefact
from are_ros.artefacts.behaviours.situation import Fellow
from are_ros.artefacts.neighbourhood import Neighbourhood


class Onlookers:
    """N artefacts by id, ascending; made for one sub-step, and computed as far as it is asked for.

    `ids` int64 (N,), `poses` float64 (N, 4), x, y, z, yaw in the map frame, `speeds_mps` float64
    (N,) along the yaw, `radii_m` float64 (N,) of the circles about (x, y) that hold the bodies.
    `sees` tells whether an artefact could go straight from where it is to a point.
    """

    def __init__(
        self,
        living: Mapping[int, Artefact],
        ids: npt.NDArray[np.int64],
        poses: npt.NDArray[np.float64],
        speeds_mps: npt.NDArray[np.float64],
        radii_m: npt.NDArray[np.float64],
        sees: Callable[[Fellow, float, float], bool],
    ) -> None:
        self._living = living
        self._ids = ids
        self._poses = np.ascontiguousarray(poses)
        self._speeds_mps = np.ascontiguousarray(speeds_mps)
        self._radii_m = radii_m
        self._sees = sees
        self._fellows: dict[int, Fellow] = {}
        self._who: dict[str, list[int]] = {}
        self._neighbourhoods: dict[str, Neighbourhood] = {}

    def fellow(self, artefact_id: int) -> Fellow | None:
        """Return an artefact that is alive, None if it is not."""
        if artefact_id not in self._living:
            return None
        return self._fellow_at(self.index_of(artefact_id))

    def index_of(self, artefact_id: int) -> int:
        """Return the index in the arrays of an artefact that is there."""
        return bisect_left(self._id_list, artefact_id)

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
        near: list[int] = self._neighbourhood_of(behaviour).within(x_m, y_m, radius_m).tolist()
        if behaviour:
            who = self._who[behaviour]
            near = [who[k] for k in near]
        if activities:
            living, ids = self._living, self._id_list
            near = [i for i in near if living[ids[i]].activity in activities]
        fellows = self._fellows
        return [fellows[i] if i in fellows else self._fellow_at(i) for i in near]

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

    def _neighbourhood_of(self, behaviour: str) -> Neighbourhood:
        """Return the neighbourhood of those of one behaviour, whose indices are `_who` then."""
        if not behaviour:
            return self._neighbourhood
        if behaviour not in self._who:
            found = enumerate(map(self._living.get, self._id_list))
            who = [i for i, one in found if one is not None and one.behaviour == behaviour]
            self._who[behaviour] = who
            self._neighbourhoods[behaviour] = Neighbourhood(self._poses[who, :2])
        return self._neighbourhoods[behaviour]

    @cached_property
    def _id_list(self) -> list[int]:
        ids: list[int] = self._ids.tolist()
        return ids

    def _fellow_at(self, i: int) -> Fellow:
        known = self._fellows.get(i)
        if known is None:
            known = self._fellows[i] = self._made(i, self._living[self._id_list[i]])
        return known

    def _made(self, i: int, artefact: Artefact) -> Fellow:
        x_m, y_m, _, yaw_rad = self._poses[i].tolist()
        speed_mps, row = self._speeds_mps.item(i), artefact.row
        return Fellow(
            artefact.id,
            row.class_name,
            row.label,
            x_m,
            y_m,
            yaw_rad,
            speed_mps * math.cos(yaw_rad),
            speed_mps * math.sin(yaw_rad),
            self._radii_m.item(i),
            artefact.behaviour,
            artefact.activity,
        )
