"""A scene for the tests of the composed builder: a room of 4 x 4 m, a robot, four types."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.builder.tick import Demand, Tick
from are_ros.conventions import NS_PER_S
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import GroundPose
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

START_NS = 1_000 * NS_PER_S
SIDE = 40
NO_TURN = (0.0, 0.0, 0.0, 1.0)
PLAIN = {
    "population.arrival_rate": 0.0,
    "mixture.weights": (1.0,),
    "mixture.rates": (0.5,),
    "robot.radius": 0.2,
    "robot.clearance": 0.1,
    "camera.width": 64,
    "camera.height": 48,
    "occlusion.tau": 0,
    "occlusion.shape": "box",
    "sensors.shape": "box",
    "markers.shape": "box",
}
"""Nobody arrives by chance, a small camera sees whatever shows in a pixel, all is a box."""


def _row(index: int, label: str, size_m: tuple[float, float, float]) -> CatalogueRow:
    surface, forever = Shape.CRATE, label == "pillar"
    return CatalogueRow(index, label, "thing", size_m, (0.0, 0.0, 0.0), surface, forever=forever)


CATALOGUE = Catalogue(
    (
        _row(0, "post", (0.4, 0.4, 1.6)),
        _row(1, "crate", (0.6, 0.3, 0.3)),
        _row(2, "screen", (0.1, 1.2, 2.0)),
        _row(3, "pillar", (0.3, 0.3, 2.2)),
    )
)


@dataclass(eq=False)
class Scene:
    """A builder, and what tests do to it; times in seconds after the start, metres, radians."""

    builder: ArBuilder

    @staticmethod
    def ns(t_s: float) -> int:
        """Return a time as the builder takes it."""
        return START_NS + round(t_s * NS_PER_S)

    @staticmethod
    def row(index: int) -> CatalogueRow:
        """Return a row: 0 post, 1 crate, 2 screen, 3 pillar (for ever)."""
        return CATALOGUE.rows[index]

    @staticmethod
    def room(*blocks: tuple[int, int, int, int], frame_id: str = "map") -> OccupancyGrid:
        """Return the room: free cells of 0.1 m from (0, 0) within walls one cell thick.

        `blocks` are more occupied cells: row0, row1, col0, col1, half-open.
        """
        cells = np.zeros((SIDE, SIDE), dtype=np.int8)
        cells[[0, -1]] = cells[:, [0, -1]] = 100
        for row0, row1, col0, col1 in blocks:
            cells[row0:row1, col0:col1] = 100
        return OccupancyGrid(cells, 0.1, RigidTransform.identity(), frame_id)

    def map(self, t_s: float, *blocks: tuple[int, int, int, int]) -> OccupancyGrid:
        """Receive the room as the map."""
        grid = self.room(*blocks)
        self.builder.receive_map(grid, self.ns(t_s))
        return grid

    def robot(self, t_s: float, x: float, y: float, yaw: float = 0.0) -> None:
        """Receive the robot's pose, stamped and received now."""
        turn = RigidTransform.planar(0.0, 0.0, yaw).rotation_xyzw
        now_ns = self.ns(t_s)
        self.builder.receive_transform("map", "base_link", now_ns, (x, y, 0.0), turn, now_ns)

    def place(
        self,
        index: int,
        at: tuple[float, float],
        t_s: float,
        *,
        yaw: float = 0.0,
        life_s: float = 1000.0,
    ) -> int:
        """Place an artefact of a row, and return its id."""
        pose, life_ns = GroundPose(*at, 0.0, yaw), round(life_s * NS_PER_S)
        return self.builder.lives.place(self.row(index), pose, self.ns(t_s), life_ns=life_ns)

    def tick(self, t_s: float) -> Tick:
        """Run a tick."""
        return self.builder.step(self.ns(t_s))

    def laser(self, t_s: float) -> None:
        """Receive where the laser is: 0.3 m above the base, turned as it is."""
        now_ns, place = self.ns(t_s), (0.0, 0.0, 0.3)
        self.builder.receive_transform(
            "base_link", "laser", now_ns, place, NO_TURN, now_ns, is_static=True
        )

    def scan(
        self, t_s: float, *, stamp_s: float | None = None, ranges: Sequence[float] = (3.5,) * 360
    ) -> LaserScan:
        """Receive a scan of a whole turn from straight behind, counter-clockwise."""
        step = 2.0 * np.pi / len(ranges)
        scan = LaserScan(
            frame_id="laser",
            stamp_ns=self.ns(t_s if stamp_s is None else stamp_s),
            angle_min_rad=-np.pi,
            angle_max_rad=np.pi - step,
            angle_increment_rad=step,
            time_increment_s=0.0,
            scan_time_s=0.1,
            range_min_m=0.05,
            range_max_m=10.0,
            ranges=np.array(ranges, dtype=np.float32),
            intensities=np.full(len(ranges), 7.0, dtype=np.float32),
        ).checked()
        self.builder.receive_reading("scan", scan, self.ns(t_s))
        return scan


@pytest.fixture(scope="session")
def make_scene() -> Callable[..., Any]:
    """Return a maker of scenes: parameters by path over `PLAIN`, and the demand."""

    def make(values: Mapping[str, Any] | None = None, demand: Demand | None = None) -> Scene:
        parameters = with_values(Parameters(), PLAIN | dict(values or {}))
        return Scene(ArBuilder(parameters, CATALOGUE, demand or Demand()))

    return make


@pytest.fixture
def scene(make_scene: Callable[..., Scene]) -> Scene:
    """Return a plain scene: the map at 0 s, the robot at (1, 2) looking along +x, no tick yet."""
    plain = make_scene()
    plain.map(0.0)
    plain.robot(0.0, 1.0, 2.0)
    return plain
