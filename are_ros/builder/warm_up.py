"""Compiling the kernels before they are needed: a miniature scene, run once."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from numba.core import event

from are_ros.artefacts.artefact import GroundPose
from are_ros.artefacts.catalogue import Catalogue
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.assembly import collision_resolver
from are_ros.builder.laser_scan import LaserScan
from are_ros.conventions import FREE, NS_PER_S, OCCUPIED
from are_ros.errors import PlacementError
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import Camera, PinholeView, mounted_camera
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

_NO_TURN = (0.0, 0.0, 0.0, 1.0)
_SIDE = 120
_WIDTH, _HEIGHT = 32, 24
_MINIATURE = {
    "population.arrival_rate": 0.5,
    "population.mean_life": 1.0,
    "population.appear": "out_of_view",
    "mixture.weights": (0.85, 0.15),
    "camera.width": _WIDTH,
    "camera.height": _HEIGHT,
    "occlusion.tau": 0,
    "robot.clearance": 0.2,
}


class _Unwanted(BaseException):
    """Nobody wants the kernels any more; no `except Exception` of the compiler's stops this."""


class _BetweenKernels(event.Listener):  # type: ignore[misc] # numba is not typed
    """Raises _Unwanted before another kernel compiles: the one place where it harms nothing."""

    def __init__(self, is_wanted: Callable[[], bool]) -> None:
        self._is_wanted = is_wanted

    def on_start(self, _: Any) -> None:
        """Ask whether to go on."""
        if not self._is_wanted():
            raise _Unwanted

    def on_end(self, _: Any) -> None:
        """Go on."""


def warm_up(catalogue: Catalogue, is_wanted: Callable[[], bool] = lambda: True) -> bool:
    """Compile, or load from the cache, every kernel of the builder: a minute or two.

    Behaviours of the user's own are left out: nobody is told of a rehearsal's artefacts.
    Asks every second or so whether that `is_wanted`; stops, and returns False, when it is not. An
    exception out of a signal's handler is no way to stop it: the compiler crashes, or swallows it.
    """
    with event.install_listener("numba:compile", _BetweenKernels(is_wanted)):
        try:
            return _run(catalogue, is_wanted)
        except _Unwanted:
            return False


def _run(catalogue: Catalogue, is_wanted: Callable[[], bool]) -> bool:
    """Run a room with a robot, a wall, voxels, a scan and some artefacts for two seconds."""
    count = len(catalogue.rows)
    rates = (count / 4, count / 2)  # small and large ones, of a catalogue of any length
    parameters = with_values(Parameters(), {**_MINIATURE, "mixture.rates": rates})
    catalogue = _tame(catalogue)
    builder = ArBuilder(parameters, catalogue)
    builder.receive_map(_room(), 0)
    builder.receive_cloud(_cloud(), "map", 0, 0.1)
    row = catalogue.rows[0]
    for tick in range(20):
        if not is_wanted():
            return False
        now_ns = tick * NS_PER_S // 10
        builder.receive_transform("map", "base_link", now_ns, (0.1 * tick, 0, 0), _NO_TURN, now_ns)
        builder.receive_reading("scan", _scan(now_ns), now_ns)
        if tick == 1:
            builder.receive_camera(_lens(), now_ns)
            builder.lives.place(row, GroundPose(2.0, 1.5, 0.0, 0.1), now_ns)
            _let_walk(builder, catalogue, now_ns)
        builder.step(now_ns)
        builder.take_readings()
    _let_collide(builder)
    return True


def _tame(catalogue: Catalogue) -> Catalogue:
    """Return a catalogue whose rows walk in place of what behaviours of the user's own would do."""
    rows = []
    for row in catalogue.rows:
        shares = dict.fromkeys([name for name in row.behaviours if ":" not in name], 0.0)
        for name, share in row.behaviours.items():
            known = "walking" if ":" in name else name
            shares[known] = shares.get(known, 0.0) + share
        rows.append(replace(row, behaviours=shares))
    return Catalogue(tuple(rows))


def _let_walk(builder: ArBuilder, catalogue: Catalogue, now_ns: int) -> None:
    """Place two of the smallest type that moves, if there is one, in each other's way."""
    movers = [row for row in catalogue.rows if row.motion.speed_mps > 0.0]
    if not movers:
        return
    smallest = min(movers, key=lambda row: row.size_m[0] * row.size_m[1])
    for y_m in (-2.0, -1.0):
        with suppress(PlacementError):  # one that is too large for the room walks nowhere
            pose = GroundPose(-2.0, y_m, 0.0, 0.0)
            builder.lives.place(smallest, pose, now_ns, behaviour="walking")


def _let_collide(builder: ArBuilder) -> None:
    """Resolve a collision: planning leaves so few that the room may have seen none."""
    environment = builder.lives.environment
    if environment is None:
        return
    halves_m, yaws_rad = np.full((2, 3), 0.2), np.zeros(2)
    apart, together = (
        OrientedBoxes(np.array([[0.0, y_m, 0.5], [0.0, -y_m, 0.5]]), yaws_rad, halves_m)
        for y_m in (0.5, 0.1)
    )
    resolver = collision_resolver(builder.parameters)
    resolver.resolve(np.array([1, 2]), together, apart, environment, ())


def _room() -> OccupancyGrid:
    cells = np.full((_SIDE, _SIDE), FREE, dtype=np.int8)
    cells[:, -5:] = OCCUPIED
    cells[:5, :20] = -1
    return OccupancyGrid(cells, 0.05, RigidTransform.planar(-3.0, -3.0, 0.0), "map")


def _cloud() -> npt.NDArray[np.float32]:
    """Return a wall and some floor, as voxel centres."""
    side = np.arange(10) * 0.1 + 0.05
    wall = np.array([(2.85, y, z) for y in side for z in side])
    floor = np.array([(x, y, -0.05) for x in side for y in side])
    return np.concatenate((wall, floor)).astype(np.float32)  # as clouds come in messages


def _lens() -> Camera:
    """Return a camera of the miniature's size whose lens distorts."""
    view = PinholeView(_WIDTH, _HEIGHT, 16.0, 16.0, 15.5, 11.5, distortion=(0.1, *[0.0] * 13))
    return mounted_camera(view, (0.0, 0.0, 0.5, 0.0, 0.0, 0.0))


def _scan(stamp_ns: int) -> LaserScan:
    ranges = np.full(36, 2.5, dtype=np.float32)
    ranges[::2] = np.inf
    none = np.empty(0, dtype=np.float32)
    return LaserScan("base_link", stamp_ns, -3.1, 3.1, 6.2 / 35, 0.0, 0.1, 0.05, 8.0, ranges, none)
