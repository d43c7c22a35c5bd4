"""The node among others: it takes a map, hands it on, and puts what it is asked for into it."""

from array import array
from typing import Any

import pytest

from tests.ros import RosWorld

SIDE = 40


@pytest.fixture
def node(ros: RosWorld) -> Any:
    """Return an active ar_builder that shows all artefacts, and has none of its own accord."""
    from are_ros.node.ar_builder_node import ArBuilderNode

    parameters = {"population.arrival_rate": 0.0, "costmap.gate": "all"}
    made = ros.make_node("ar_builder", kind=ArBuilderNode, parameters=parameters)
    made.trigger_configure()
    made.trigger_activate()
    return made


def room() -> Any:
    """Return the map of an empty room of 4 x 4 m."""
    from nav_msgs.msg import OccupancyGrid

    grid = OccupancyGrid(data=array("b", bytes(SIDE * SIDE)))
    grid.header.frame_id = "map"
    grid.info.width = grid.info.height = SIDE
    grid.info.resolution = 0.1
    grid.info.origin.orientation.w = 1.0
    return grid


@pytest.mark.usefixtures("node")
def test_the_map_is_handed_on_and_an_artefact_put_into_it(ros: RosWorld) -> None:
    """First the real map, then 100 where the artefact stands, and nowhere else."""
    from are_msgs.srv import SpawnArtefact
    from nav_msgs.msg import OccupancyGrid
    from rclpy.qos import DurabilityPolicy, QoSProfile

    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    robot = ros.make_node("robot")
    maps = ros.collect(robot, OccupancyGrid, "/ar_builder/augmented_map", latched)
    robot.create_publisher(OccupancyGrid, "/map", latched).publish(room())
    ros.spin_until(lambda: maps)
    assert maps[0].data == room().data

    request = SpawnArtefact.Request(label="person", row=-1)
    request.pose.header.frame_id = "map"
    request.pose.pose.position.x = request.pose.pose.position.y = 2.05
    request.pose.pose.orientation.w = 1.0
    response = ros.call(robot, SpawnArtefact, "/ar_builder/spawn", request)
    assert response.success, response.message
    ros.spin_until(lambda: 100 in maps[-1].data)
    occupied = {divmod(index, SIDE) for index, value in enumerate(maps[-1].data) if value}
    assert (20, 20) in occupied
    assert max(abs(row - 20) + abs(column - 20) for row, column in occupied) <= 10
    assert set(maps[-1].data) == {0, 100}
