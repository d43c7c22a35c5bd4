"""What an artefact needs beside the room for its box, to set out from where it arrives."""

from typing import Protocol

import numpy as np
import numpy.typing as npt

from are_ros.artefacts._setting_out import SettingOut
from are_ros.artefacts._turning import Turning
from are_ros.artefacts.behaviours.standing import Standing
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.motion.body import Body
from are_ros.artefacts.terrain import Terrains
from are_ros.artefacts.traveller import Traveller
from are_ros.world.environment import Environment

_Mask = npt.NDArray[np.bool_]
_Floats = npt.NDArray[np.float64]


class Leeway(Protocol):
    """Tells from where an artefact can set out, as far as the static map decides."""

    @property
    def is_searched_for(self) -> bool:
        """Whether all of the lattice is searched for such a pose; then they lead out at once."""

    @property
    def radius_m(self) -> float:
        """Radius of a disc about F_A that is free at every such pose."""

    @property
    def key(self) -> tuple[float, ...]:
        """What tells two of them apart in one environment, beside the shape of the box."""

    @property
    def is_anywhere(self) -> bool:
        """Whether there is any place on the map where one could set out."""

    def is_free_at(self, points_m: _Floats) -> _Mask:
        """Tell at which points (N, >= 2) the disc is free, and can leave: bool (N,)."""

    def leads_out(self, poses: _Floats) -> _Mask:
        """Tell of poses (N, 4), x, y, 0, yaw, at such points which lead out of it: bool (N,)."""


def leeway_of(
    row: CatalogueRow, environment: Environment, terrains: Terrains, region: _Mask
) -> Leeway | None:
    """Return what a row's artefacts need to set out; None if they only stand.

    `region` bool (H, W) are the cells that they may be in.
    """
    if row.motion.speed_mps <= 0.0 or set(row.behaviours) <= {Standing.name}:
        return None
    body = Body.of(row)
    terrain = terrains.of(environment, body.height_m)
    if body.turn_radius_m <= 0.0:
        return Turning(terrain, body.radius_m, region)
    return SettingOut(terrain, body, Traveller.of(row, body).radius_m, region)
