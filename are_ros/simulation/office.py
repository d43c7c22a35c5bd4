"""The sample building: one floor of an office, and a minute's tour through it.

16 m by 11 m, its south-west corner at the map's origin, x to the east. A corridor runs from the
west to the lobby with its meeting table; rooms lie on both sides, the open-plan office north-east.
"""

import math
from typing import Final

from are_ros.simulation._office_plan import CHAIRS, CHAIR_HEIGHT, CHAIR_RADIUS, COLUMNS, DOORWAYS, DOOR_LEAVES, FLOOR, FURNITURE, INNER_WALLS, OUTER_WALLS, TURNED_FURNITURE
from are_ros.simulation.building import Building
from are_ros.simulation.robot import DriveLimits, RobotState
from are_ros.simulation.route import RouteFollower, Waypoint
from are_ros.simulation.solids import Cuboid, Cylinder, Solid

OFFICE_START: Final = RobotState(1.2, 5.5, 0.0)
OFFICE_TOUR_S: Final = 60.0

_WALL_M: Final = 2.4
_DOOR_M: Final = 2.1
_LEAF_SIZE_M: Final = (0.94, 0.06, 2.0)


def office_building() -> Building:
    """Return the floor with its walls, doors and furniture."""
    floor = Cuboid.between(*FLOOR, 0.0)
    return Building(floor, (*_shell(), *_furniture()))


def office_driver(limits: DriveLimits) -> RouteFollower:
    """Return the driver of the tour: corridor, an office, the open-plan office, the lobby."""
    waypoints = (
        Waypoint(4.2, 5.5),
        Waypoint(4.9, 5.2),
        Waypoint(4.9, 3.5, _headings(-140, -20)),
        Waypoint(4.9, 5.0),
        Waypoint(6.0, 5.5),
        Waypoint(8.4, 5.5),
        Waypoint(8.8, 6.0),
        Waypoint(8.8, 7.1, _headings(60)),
        Waypoint(12.4, 7.2, _headings(80)),
        Waypoint(13.6, 6.9),
        Waypoint(13.5, 5.4),
        Waypoint(12.4, 4.1, _headings(-70)),
        Waypoint(11.2, 5.3),
        Waypoint(9.9, 5.3, _headings(250)),
    )
    return RouteFollower(waypoints, limits)


def _shell() -> tuple[Solid, ...]:
    """Return walls, lintels over the doorways, and the open leaves of the doors."""
    walls = (Cuboid.between(*wall, _WALL_M) for wall in (*OUTER_WALLS, *INNER_WALLS))
    lintels = (Cuboid.between(*doorway, _WALL_M, _DOOR_M) for doorway in DOORWAYS)
    return (*walls, *lintels, *(_leaf(*leaf) for leaf in DOOR_LEAVES))


def _furniture() -> tuple[Solid, ...]:
    """Return what stands in the rooms."""
    aligned = (Cuboid.between(*rectangle, top_m) for rectangle, top_m in FURNITURE)
    turned = (
        Cuboid(x, y, length, width, top, yaw_rad=math.radians(heading))
        for x, y, length, width, top, heading in TURNED_FURNITURE
    )
    chairs = (Cylinder(x, y, CHAIR_RADIUS, CHAIR_HEIGHT) for x, y in CHAIRS)
    return (*aligned, *turned, *chairs, *(Cylinder(*column) for column in COLUMNS))


def _leaf(hinge_x_m: float, hinge_y_m: float, heading_deg: float) -> Cuboid:
    """Return a door leaf that stands open at a heading from its hinge."""
    length_m, width_m, top_m = _LEAF_SIZE_M
    yaw_rad = math.radians(heading_deg)
    x_m = hinge_x_m + 0.5 * length_m * math.cos(yaw_rad)
    y_m = hinge_y_m + 0.5 * length_m * math.sin(yaw_rad)
    return Cuboid(x_m, y_m, length_m, width_m, top_m, yaw_rad=yaw_rad)


def _headings(*degrees: float) -> tuple[float, ...]:
    return tuple(math.radians(heading) for heading in degrees)
