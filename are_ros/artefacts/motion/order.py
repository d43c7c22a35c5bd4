"""What an artefact is to do until told otherwise."""

from typing import NamedTuple


class Order(NamedTuple):
    """Move to `subgoal_m` (x, y in the map frame), or brake and stand where it is None.

    `speed_mps` is the speed wanted; the type's own limit holds, too. With `stop_there` the subgoal
    is the end of the way, else it is passed. `face_rad` is the heading wanted when standing there
    (None: any), of those that turn on the spot. The comfort distances are kept from others, the
    robot and the walls where possible.
    """

    subgoal_m: tuple[float, float] | None
    speed_mps: float
    stop_there: bool = True
    face_rad: float | None = None
    comfort_m: float = 0.3
    robot_comfort_m: float = 0.5
    wall_comfort_m: float = 0.1


STAND = Order(None, 0.0)
