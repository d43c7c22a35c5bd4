"""What a placer is asked for."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.artefacts._leeway import Leeway
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.surroundings import Disc, Surroundings


@dataclass(frozen=True, eq=False)
class Sought:
    """What a pose is sought for: a row, what is about it, a disc to be in, room to set out.

    Without a `leeway` the artefact need not be able to set out from there.
    """

    row: CatalogueRow
    around: Surroundings
    within: Disc | None
    leeway: Leeway | None

    @property
    def key(self) -> tuple[float, ...]:
        """What decides, of all this, where the static map has room."""
        row, leeway = self.row, self.leeway
        shape = (*row.size_m, *row.box_centre_in_artefact_m[:2])
        return shape if leeway is None else shape + leeway.key

    @property
    def radius_m(self) -> float:
        """Radius of a disc about F_A that is clear of walls in every pose sought."""
        return _inscribed_radius_m(self.row) if self.leeway is None else self.leeway.radius_m

    def leading_out(
        self, poses: npt.NDArray[np.float64], which: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.int64]:
        """Return those indices, of some, of poses (N, 4), x, y, 0, yaw, that lead out."""
        return which if self.leeway is None else which[self.leeway.leads_out(poses[which])]


def _inscribed_radius_m(row: CatalogueRow) -> float:
    """Return the radius of the largest disc about F_A within the box's footprint, at least 0."""
    offset_x_m, offset_y_m, _ = row.box_centre_in_artefact_m
    room_x_m = 0.5 * row.size_m[0] - abs(offset_x_m)
    room_y_m = 0.5 * row.size_m[1] - abs(offset_y_m)
    return max(0.0, min(room_x_m, room_y_m))
