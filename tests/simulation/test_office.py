"""The sample office and the tour through it."""

import cv2
import numpy as np
import pytest

from are_ros.conventions import FREE, OCCUPIED
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.occupancy_grid import classify
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap
from bags.simulation.building import Building, surface_centres_m
from bags.simulation.office import OFFICE_START, OFFICE_TOUR_S, office_driver
from bags.simulation.robot import ROBOT_RADIUS_M, DriveLimits, RobotState
from bags.simulation.simulator import STEPS_PER_S, Simulator

ROOMS = {
    "south-west office": (2.4, 3.0),
    "south office": (4.9, 3.2),
    "kitchen": (9.9, 3.6),
    "north-west office": (1.8, 7.3),
    "store": (6.1, 8.5),
    "open-plan office": (10.5, 7.2),
    "lobby": (12.4, 4.1),
    "meeting table": (12.1, 2.9),
}


@pytest.fixture(scope="module")
def clearance(office: Building) -> Environment:
    """Return the office as an environment, for its distance from anything not free."""
    grid = office.grid()
    return Environment(grid, classify(grid, 65, 25), None, PlaneGround(), 0.11)


def test_the_tour_stays_clear_and_ends_in_time(office: Building, clearance: Environment) -> None:
    """The base never comes nearer than 0.1 m to anything, at speeds within the limits."""
    limits = DriveLimits()
    simulator, driver = Simulator(office, OFFICE_START, limits=limits), office_driver(limits)
    states = []
    for _ in range(round(OFFICE_TOUR_S * STEPS_PER_S)):
        states.append(simulator.state)
        simulator.step(driver.command(simulator.state))
    assert driver.is_done
    points = np.array([(state.x_m, state.y_m) for state in states])
    assert clearance.lookup(points).min() > ROBOT_RADIUS_M + 0.1
    speeds = np.array([state.speed_m_s for state in states])
    assert speeds.max() <= 0.6
    assert speeds.mean() > 0.3


def test_a_robot_reaches_every_room(clearance: Environment) -> None:
    """The space that its centre may use is connected from the start to all rooms."""
    grid = clearance.grid
    usable = (clearance.clearance_m > ROBOT_RADIUS_M + 0.05).astype(np.uint8)
    _, labels = cv2.connectedComponents(usable, connectivity=4)
    points = [(OFFICE_START.x_m, OFFICE_START.y_m), *ROOMS.values()]
    found = [int(labels[row, col]) for row, col in grid.points_to_cells(points)]
    assert found[0] > 0
    assert dict.fromkeys(ROOMS, found[0]) == dict(zip(ROOMS, found[1:], strict=True))


def test_nothing_leaks_out(clearance: Environment) -> None:
    """Free cells do not touch the unknown outside: the outer walls are closed."""
    grid = clearance.grid
    x, y = grid.cells_to_points(np.argwhere(grid.cells == FREE)).T
    assert (x.min(), x.max(), y.min(), y.max()) == pytest.approx((0.225, 15.775, 0.225, 10.775))
    assert 100.0 < len(x) * grid.cell_area_m2 < 140.0


def test_scans_end_on_walls(office: Building) -> None:
    """At 8 places at least 95 % of the returns lie within 0.1 m of an occupied cell."""
    grid = office.grid()
    free = (grid.cells != OCCUPIED).astype(np.uint8)
    distance_m = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * 0.05
    for x, y in ROOMS.values():
        start = RobotState(x, y, 0.3)
        simulator = Simulator(office, start, limits=DriveLimits(), seed=2)
        scan = simulator.scan()
        hit = np.isfinite(scan.ranges)
        assert hit.mean() > 0.9
        ends = simulator.map_from_base.apply(
            scan.directions()[hit] * scan.ranges[hit, np.newaxis].astype(np.float64)
        )
        cells = grid.points_to_cells(ends)
        assert (distance_m[cells[:, 0], cells[:, 1]] <= 0.1).mean() >= 0.95


def test_the_voxels_come_back_from_their_cloud(office: Building) -> None:
    """From the surface as float32 the size is inferred, and the lattice is the building's."""
    centres = surface_centres_m(office.voxels()).astype(np.float32)
    voxels = VoxelMap.from_centres(centres, None, RigidTransform.identity())
    assert voxels.voxel_size_m == pytest.approx((0.1, 0.1, 0.1), abs=1e-4)
    assert voxels.occupied_count == len(centres)
    assert voxels.bounds_m().tolist() == pytest.approx(
        np.array([[0.0, 0.0, -0.1], [16.0, 11.0, 2.4]]), abs=1e-3
    )
