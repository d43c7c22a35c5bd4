"""Everybody as the others see them, at the end of one sub-step: who is near, where, how fast."""

import math
from bisect import bisect_left
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
        self._after: tuple[float, npt.NDArray[np.float64]] | None = None

    def fellow(self, artefact_id: int) -> Fellow | None:
        """Return an artefact that is alive, None if it is not."""
        if artefact_id not in self._living:
            return None
        return self._fellow_at(bisect_left(self._id_list, artefact_id))

    def within(
        self, x_m: float, y_m: float, radius_m: float, behaviour: str = ""
    ) -> Sequence[Fellow]:
        """Return those whose (x, y) is at most this far from a point, the nearest first.

        Of one behaviour, if it is given.
        """
        near = self._neighbourhood.within(x_m, y_m, radius_m).tolist()
        if behaviour:
            living, ids = self._living, self._id_list
            near = [i for i in near if living[ids[i]].behaviour == behaviour]
        fellows = self._fellows
        return [fellows[i] if i in fellows else self._fellow_at(i) for i in near]

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
        return self._points_after(ahead_s)[near], self._radii_m[near]

    def _points_after(self, ahead_s: float) -> npt.NDArray[np.float64]:
        """Return where everybody (N, 2) will be, if he goes on as he does."""
        if self._after is None or self._after[0] != ahead_s:
            ways_m, yaws_rad = ahead_s * self._speeds_mps, self._poses[:, 3]
            headings = np.column_stack((np.cos(yaws_rad), np.sin(yaws_rad)))
            self._after = (ahead_s, self._poses[:, :2] + ways_m[:, None] * headings)
        return self._after[1]

    @cached_property
    def _neighbourhood(self) -> Neighbourhood:
        return Neighbourhood(self._poses[:, :2])

    @cached_property
    def _id_list(self) -> list[int]:
        ids: list[int] = self._ids.tolist()
        return ids

    @cached_property
    def _rows(self) -> tuple[list[list[float]], list[float], list[float]]:
        """Poses, speeds and radii as lists, of which single numbers are taken much faster."""
        return self._poses.tolist(), self._speeds_mps.tolist(), self._radii_m.tolist()

    def _fellow_at(self, i: int) -> Fellow:
        known = self._fellows.get(i)
        if known is None:
            known = self._fellows[i] = self._made(i, self._living[self._id_list[i]])
        return known

    def _made(self, i: int, artefact: Artefact) -> Fellow:
        poses, speeds_mps, radii_m = self._rows
        x_m, y_m, _, yaw_rad = poses[i]
        speed_mps, row = speeds_mps[i], artefact.row
        return Fellow(
            artefact.id,
            row.class_name,
            row.label,
            x_m,
            y_m,
            yaw_rad,
            speed_mps * math.cos(yaw_rad),
            speed_mps * math.sin(yaw_rad),
            radii_m[i],
            artefact.behaviour,
            artefact.activity,
        )
