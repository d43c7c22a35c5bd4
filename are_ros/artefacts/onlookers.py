"""Everybody as the others see them, at the end of one sub-step: who is near, where, how fast."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

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
        self._poses = poses
        self._speeds_mps = speeds_mps
        self._radii_m = radii_m
        self._sees = sees
        self._fellows: dict[int, Fellow] = {}

    def fellow(self, artefact_id: int) -> Fellow | None:
        """Return an artefact that is alive, None if it is not."""
        if artefact_id not in self._living:
            return None
        return self._fellow_at(int(np.searchsorted(self._ids, artefact_id)))

    def within(self, x_m: float, y_m: float, radius_m: float) -> Sequence[Fellow]:
        """Return those whose (x, y) is at most this far from a point, the nearest first."""
        near = self._neighbourhood.within(x_m, y_m, radius_m)
        return [self._fellow_at(i) for i in near.tolist()]

    def sees(self, me: Fellow, x_m: float, y_m: float) -> bool:
        """Say whether this artefact could go straight on to a point, were nobody in its way."""
        return self._sees(me, x_m, y_m)

    def expected(
        self, me: Fellow, radius_m: float, ahead_s: float
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return where those near me will be a little later, (M, 2), and their radii (M,).

        Those within `radius_m` now, if they go on as they do; the standing ones too.
        """
        near = self._neighbourhood.within(me.x_m, me.y_m, radius_m)
        near = near[self._ids[near] != me.id]
        ways_m, yaws_rad = ahead_s * self._speeds_mps[near], self._poses[near, 3]
        headings = np.column_stack((np.cos(yaws_rad), np.sin(yaws_rad)))
        return self._poses[near, :2] + ways_m[:, None] * headings, self._radii_m[near]

    @cached_property
    def _neighbourhood(self) -> Neighbourhood:
        return Neighbourhood(self._poses[:, :2])

    def _fellow_at(self, i: int) -> Fellow:
        artefact_id = int(self._ids[i])
        known = self._fellows.get(artefact_id)
        if known is None:
            known = self._fellows[artefact_id] = self._made(i, self._living[artefact_id])
        return known

    def _made(self, i: int, artefact: Artefact) -> Fellow:
        x_m, y_m, _, yaw_rad = self._poses[i].tolist()
        speed_mps = float(self._speeds_mps[i])
        return Fellow(
            artefact.id,
            artefact.row.class_name,
            artefact.row.label,
            x_m,
            y_m,
            yaw_rad,
            speed_mps * math.cos(yaw_rad),
            speed_mps * math.sin(yaw_rad),
            float(self._radii_m[i]),
            artefact.behaviour,
            artefact.activity,
        )
