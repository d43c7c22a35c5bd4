"""What the minds are shown when they decide: everybody and the robot, as the last sub-step left."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from are_ros.agents.table import AgentTable
from are_ros.artefacts.artefact import Artefact
from are_ros.artefacts.behaviours.situation import RobotView
from are_ros.artefacts.minds import Minds
from are_ros.artefacts.motion.robot import RobotMotion
from are_ros.artefacts.motion.traffic import Traffic
from are_ros.artefacts.onlookers import Onlookers
from are_ros.artefacts.track_player import TrackPlayer


def view_of(
    living: Mapping[int, Artefact],
    table: AgentTable,
    traffic: Traffic,
    minds: Minds,
    player: TrackPlayer,
) -> Onlookers:
    """Return everybody as the others see them."""

    def doers(behaviour: str) -> Sequence[int]:
        """Return the ids, ascending, of those of a behaviour, which a track may change."""
        found = minds.doers.of(behaviour)
        on_track = [i for i in player.ids if living[i].behaviour == behaviour]
        return sorted([*found, *on_track]) if on_track else found

    return Onlookers(
        living, table.ids, table.poses, traffic.motion[:, 5], table.radii_m, minds.sees, doers
    )


def robot_view(robot: RobotMotion, plan_m: npt.NDArray[np.float64]) -> RobotView:
    """Return the robot as the behaviours see it."""
    return RobotView(
        robot.x_m,
        robot.y_m,
        robot.yaw_rad,
        robot.vx_mps,
        robot.vy_mps,
        robot.footprint.circumscribed_radius_m,
        plan_m,
    )
