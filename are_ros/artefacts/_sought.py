"""What a placer is asked for."""

from dataclasses import dataclass

from are_ros.artefacts._turning import Turning
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.surroundings import Disc, Surroundings


@dataclass(frozen=True, eq=False)
class Sought:
    """What a pose is sought for: a row, what is about it, a disc to be in, room to turn.

    Without a `turning` the artefact need not be able to turn there.
    """

    row: CatalogueRow
    around: Surroundings
    within: Disc | None
    turning: Turning | None

    @property
    def key(self) -> tuple[float, ...]:
        """What decides, of all this, where the static map has room."""
        row, turning = self.row, self.turning
        shape = (*row.size_m, *row.box_centre_in_artefact_m[:2])
        return shape if turning is None else shape + turning.key

    @property
    def radius_m(self) -> float:
        """Radius of a disc about F_A that is clear of walls in every pose sought."""
        return _inscribed_radius_m(self.row) if self.turning is None else self.turning.radius_m


def _inscribed_radius_m(row: CatalogueRow) -> float:
    """Return the radius of the largest disc about F_A within the box's footprint, at least 0."""
    offset_x_m, offset_y_m, _ = row.box_centre_in_artefact_m
    room_x_m = 0.5 * row.size_m[0] - abs(offset_x_m)
    room_y_m = 0.5 * row.size_m[1] - abs(offset_y_m)
    return max(0.0, min(room_x_m, room_y_m))
