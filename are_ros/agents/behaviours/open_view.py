"""A simple view to try a behaviour with: a few neighbours in a plane, with a few walls or none."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from are_ros.agents.behaviours.situation import Neighbour, Point

if TYPE_CHECKING:
    from are_ros.agents.navigation.destinations import Destinations


@dataclass(frozen=True)
class OpenView:
    """Neighbours, and walls as pairs of end points, map frame [m].

    A straight way is clear if it crosses no wall; the width of bodies is ignored.
    """

    neighbours: Sequence[Neighbour] = ()
    walls_m: Sequence[tuple[Point, Point]] = ()

    def neighbour(self, artefact_id: int) -> Neighbour | None:
        """Return the neighbour of this id, None if there is none."""
        return next(
            (neighbour for neighbour in self.neighbours if neighbour.id == artefact_id), None
        )

    def within(
        self,
        x_m: float,
        y_m: float,
        radius_m: float,
        behaviour: str = "",
        activities: Collection[str] = (),
    ) -> Sequence[Neighbour]:
        """Return the neighbours in the closed disc, the nearest first, then by id."""
        chosen = [f for f in self.neighbours if behaviour in {"", f.behaviour}]
        if activities:
            chosen = [f for f in chosen if f.activity in activities]
        squares = {f.id: (f.x_m - x_m) ** 2 + (f.y_m - y_m) ** 2 for f in chosen}
        inside = [f for f in chosen if squares[f.id] <= radius_m**2]
        return sorted(inside, key=lambda f: (squares[f.id], f.id))

    def places_within(
        self,
        me: Neighbour,
        radius_m: float,
        behaviour: str,
        activities: Collection[str],
        places: "Destinations",
    ) -> Sequence[int]:
        """Return the index of the destination nearest to each of the others in the disc."""
        found = self.within(*me.point_m, radius_m, behaviour, activities)
        places_m: list[Point] = places.destinations_m.tolist()
        away_m = [[math.dist(f.point_m, p) for p in places_m] for f in found if f.id != me.id]
        return [row.index(min(row)) for row in away_m]

    def sees(self, me: Neighbour, x_m: float, y_m: float) -> bool:
        """Return whether the segment to a point crosses no wall."""
        here, there = (me.x_m, me.y_m), (x_m, y_m)
        return not any(_cross(here, there, start, end) for start, end in self.walls_m)


def _cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    return _side(a, b, c) * _side(a, b, d) < 0.0 and _side(c, d, a) * _side(c, d, b) < 0.0


def _side(a: Point, b: Point, point: Point) -> float:
    return (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0])
