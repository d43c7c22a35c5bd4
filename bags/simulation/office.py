"""The sample building: one floor of an office, and a minute's tour through it.

16 m by 11 m, its south-west corner at the map's origin, x to the east. A corridor runs from the
west to the lobby with its meeting table; rooms lie on both sides, the open-plan office north-east.
"""

import math
from typing import Final

from bags.simulation.building import Building, Cuboid, Cylinder, Solid
from bags.simulation.robot import DriveLimits, RobotState, RouteFollower, Waypoint

# The dimensions of the sample office [m]: rectangles are low x, low y, high x, high y.


Rectangle = tuple[float, float, float, float]

FLOOR: Final = (0.0, 0.0, 16.0, 11.0)

OUTER_WALLS: Final = (
    (0.0, 0.0, 16.0, 0.2),
    (0.0, 10.8, 16.0, 11.0),
    (0.0, 0.2, 0.2, 10.8),
    (15.8, 0.2, 16.0, 10.8),
)
INNER_WALLS: Final = (
    # south of the corridor: two offices and the kitchen
    (0.2, 4.5, 2.5, 4.6),
    (3.5, 4.5, 4.4, 4.6),
    (5.4, 4.5, 9.4, 4.6),
    (10.4, 4.5, 10.8, 4.6),
    (3.9, 0.2, 4.0, 4.5),
    (7.7, 0.2, 7.8, 4.5),
    (10.7, 0.2, 10.8, 4.5),
    # north of it: an office, the store, the open-plan office
    (0.2, 6.4, 1.2, 6.5),
    (2.2, 6.4, 5.7, 6.5),
    (6.7, 6.4, 8.2, 6.5),
    (9.4, 6.4, 12.8, 6.5),
    (14.6, 6.4, 15.8, 6.5),
    (4.9, 6.5, 5.0, 10.8),
    (7.3, 6.5, 7.4, 10.8),
)
DOORWAYS: Final = (
    (2.5, 4.5, 3.5, 4.6),
    (4.4, 4.5, 5.4, 4.6),
    (9.4, 4.5, 10.4, 4.6),
    (1.2, 6.4, 2.2, 6.5),
    (5.7, 6.4, 6.7, 6.5),
    (8.2, 6.4, 9.4, 6.5),
    (12.8, 6.4, 14.6, 6.5),
)
DOOR_LEAVES: Final = (
    # x and y of the hinge, heading of the open leaf [degrees]
    (3.47, 4.5, -85.0),
    (5.36, 4.5, -95.0),
    (9.43, 4.5, -110.0),
    (1.24, 6.5, 95.0),
    (5.73, 6.5, 95.0),
)

FURNITURE: Final = (
    # rectangle and height: office in the south-west
    ((0.2, 0.6, 1.0, 2.2), 0.75),
    ((0.2, 2.6, 1.0, 4.2), 0.75),
    ((3.5, 0.4, 3.9, 2.8), 1.8),
    ((1.9, 0.2, 3.1, 0.6), 0.9),
    # office in the south
    ((5.8, 1.2, 7.4, 2.0), 0.75),
    ((5.8, 2.0, 7.4, 2.8), 0.75),
    ((4.0, 0.4, 4.4, 2.4), 1.2),
    ((7.3, 3.6, 7.7, 4.5), 1.8),
    # kitchen: counter, refrigerator
    ((8.4, 0.2, 10.7, 0.8), 0.9),
    ((7.8, 0.2, 8.4, 0.8), 1.9),
    # office in the north-west: bookshelf, sofa
    ((0.2, 7.6, 0.5, 10.4), 2.0),
    ((4.1, 6.9, 4.9, 8.6), 0.7),
    ((1.4, 10.4, 3.0, 10.8), 1.0),
    # store: shelves, copier
    ((5.0, 7.6, 5.5, 10.8), 2.0),
    ((6.8, 6.9, 7.3, 9.9), 2.0),
    ((6.5, 10.1, 7.2, 10.8), 1.1),
    # open-plan office: two islands of desks with screens between, low cupboards
    ((8.6, 8.1, 11.8, 8.9), 0.75),
    ((8.6, 8.9, 11.8, 9.7), 0.75),
    ((8.7, 8.85, 11.7, 8.95), 1.3),
    ((13.0, 8.1, 15.8, 8.9), 0.75),
    ((13.0, 8.9, 15.8, 9.7), 0.75),
    ((13.1, 8.85, 15.8, 8.95), 1.3),
    ((11.6, 10.4, 13.2, 10.8), 1.0),
    ((7.4, 9.2, 7.8, 10.8), 1.8),
    # lobby: meeting table, its partition, whiteboard, sofa
    ((12.4, 1.2, 14.8, 2.3), 0.75),
    ((13.6, 3.7, 15.8, 3.8), 1.4),
    ((15.7, 1.0, 15.8, 2.6), 1.9),
    ((10.8, 0.9, 11.6, 2.9), 0.7),
    ((14.2, 5.9, 15.8, 6.4), 1.1),
)
TURNED_FURNITURE: Final = (
    # x and y of the centre, length, width, height, heading [degrees]
    (2.75, 9.1, 1.6, 0.8, 0.75, 25.0),
    (9.1, 2.5, 0.8, 0.8, 0.75, 40.0),
    (14.7, 4.8, 1.6, 0.6, 1.1, 75.0),
)

CHAIR_RADIUS: Final = 0.24
CHAIR_HEIGHT: Final = 0.85
CHAIRS: Final = (
    (1.35, 1.3),
    (1.3, 3.5),
    (6.4, 0.85),
    (6.7, 3.15),
    (2.5, 9.75),
    (2.75, 8.2),
    (3.5, 8.5),
    (9.3, 7.75),
    (11.1, 7.85),
    (9.5, 10.0),
    (10.9, 10.1),
    (13.7, 10.0),
    (15.1, 10.1),
    (14.9, 7.7),
    (8.45, 2.85),
    (9.75, 2.9),
    (9.0, 1.75),
    (12.8, 0.85),
    (13.6, 0.8),
    (14.4, 0.9),
    (12.8, 2.7),
    (13.6, 2.65),
    (14.5, 2.75),
    (12.05, 1.75),
    (15.35, 4.85),
)

COLUMNS: Final = (
    # x and y of the centre, radius, height: two pillars, then plants
    (12.4, 9.0, 0.22, 2.4),
    (11.9, 5.5, 0.22, 2.4),
    (0.5, 4.9, 0.2, 1.4),
    (4.4, 10.3, 0.25, 1.5),
    (7.75, 6.85, 0.2, 1.3),
    (11.15, 0.55, 0.25, 1.6),
    (15.45, 3.4, 0.22, 1.4),
    (15.45, 6.85, 0.22, 1.4),
)


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
