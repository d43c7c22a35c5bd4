"""Compiling the kernels before they are needed, by miniature scenes, in two processes."""

import gc
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from typing import IO, Any, Final

import numpy as np
import numpy.typing as npt
from numba.core import event

from are_ros._compiled import KERNELS, name_of, on_long_stack
from are_ros.agents.body import MotionCommand
from are_ros.agents.simulate import CrowdSimulator
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.assembly import collision_resolver
from are_ros.builder.sensors.image import MINIATURE_PX
from are_ros.builder.sensors.lens import Lens
from are_ros.builder.sensors.sensor_path import MakeReading
from are_ros.builder.tick import MOTION_ONLY, Demand
from are_ros.conventions import FREE, NS_PER_S, OCCUPIED
from are_ros.errors import PlacementError
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import GroundPose
from are_ros.population.catalogue import Catalogue, MotionLimits
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import Camera, PinholeView, mounted_camera
from are_ros.world.environment import Environment
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.regions import SpawnRegion, Zones
from are_ros.world.rigid_transform import RigidTransform

_BASE: Final = "base_link"
_NO_TURN = (0.0, 0.0, 0.0, 1.0)
_SIDE = 120
_TICKS = 20
_READINGS = 8
"""Ticks with readings. After six, all kernels of the shipped catalogue have run."""
_TICK_NS = NS_PER_S // 10
_PAUSE_S = 0.05
_STDOUT = 1
_HELP: Final = f"import os; from {__name__} import help_out; help_out(); os._exit(0)"
"""What the second process does. It leaves at once: to free all that it made takes a second."""
_FEW_COLLECTIONS = 20_000, 20, 20
"""The compiler makes many objects that stay: looking for garbage was a tenth of its time."""
_REHEARSED: Final[set[bytes]] = set()
"""For what the kernels of this process are ready, as kernels themselves are a process's."""
_EVERYTHING = Demand(octomap=True)
_MINIATURE = {
    "population.arrival_rate": 0.5,
    "population.mean_life": 1.0,
    "population.appear": "out_of_view",
    "mixture.weights": (0.85, 0.15),
    "camera.width": MINIATURE_PX[0],
    "camera.height": MINIATURE_PX[1],
    "occlusion.tau": 0,
    "robot.clearance": 0.2,
}


@dataclass(frozen=True)
class WarmUpNeeds:
    """What a run needs, so that it waits for no other kernels.

    `sensors` make a reading of each kind of sensor that it has. Kernels of meshes are compiled if a
    row of the catalogue has one.
    """

    sensors: tuple[MakeReading, ...]
    demand: Demand = _EVERYTHING
    has_voxels: bool = True


Count = Callable[[int, int], None]
"""Takes how many kernels are compiled, and how many there are at most."""


@on_long_stack
def warm_up(
    catalogue: Catalogue,
    needs: WarmUpNeeds,
    is_wanted: Callable[[], bool] = lambda: True,
    count: Count = lambda _done, _total: None,
) -> bool:
    """Compile, or load from the cache, the builder's kernels: a minute where they are not there.

    A second process compiles decisions, perception, maps and sensors, while this one compiles
    arrivals, the local planner, and sensors from the last one on. The user's own behaviours are not
    called. What this process has rehearsed once is ready. `is_wanted` is asked every second or so;
    when it returns False, the compilation stops and False is returned. An exception from a signal
    handler cannot stop it: the compiler crashes, or swallows it.
    """
    catalogue = _tame(catalogue)
    rehearsal = pickle.dumps((catalogue, needs))
    if rehearsal in _REHEARSED:
        return is_wanted()
    with ExitStack() as stack:
        stack.callback(gc.set_threshold, *gc.get_threshold())
        gc.set_threshold(*_FEW_COLLECTIONS)
        helper = _Helper(rehearsal, stack)
        compilation = _Compilation(is_wanted, count, helper)
        stack.enter_context(event.install_listener("numba:compile", compilation))
        try:
            _Scene(catalogue, needs, compilation.ask).plan()
            scene = _Scene(catalogue, needs, compilation.ask)
            scene.live()
            if helper.is_busy():
                scene.take_readings(reversed(range(len(needs.sensors))))  # the two meet
            while helper.is_busy():
                compilation.ask()
                helper.wait()
            scene.sense()
        except _UnwantedError:
            return False
    _REHEARSED.add(rehearsal)
    return True


class _UnwantedError(BaseException):
    """The kernels are no longer wanted; no `except Exception` of the compiler catches this."""


class _Compilation(event.Listener):  # type: ignore[misc] # numba is not typed
    """Counts the kernels that compile, here and in the helper, which begin with the first.

    Raises _UnwantedError before another one compiles: the one place where it harms nothing.
    """

    def __init__(self, is_wanted: Callable[[], bool], count: Count, helper: "_Helper") -> None:
        self._is_wanted, self._count, self._helper = is_wanted, count, helper
        self._kernels: set[str] = set()

    def ask(self) -> None:
        """Ask whether to go on, and tell how far it is."""
        if not self._is_wanted():
            raise _UnwantedError
        if self._helper.is_busy():
            self._tell(self._helper.compiled())

    def on_start(self, compilation: Any) -> None:
        """Ask whether to go on; the first kernel calls for help."""
        self.ask()
        if kernel := _kernel_of(compilation):
            self._helper.start()
            self._tell({kernel})

    def on_end(self, _: Any) -> None:
        """Go on."""

    def _tell(self, kernels: set[str]) -> None:
        if not kernels <= self._kernels:
            self._kernels |= kernels
            self._count(len(self._kernels), len(KERNELS))


def _kernel_of(compilation: Any) -> str:
    """Return the name of the kernel of ours that an event is about, if it is one."""
    dispatcher = (compilation.data or {}).get("dispatcher")
    name = "" if dispatcher is None else name_of(dispatcher.py_func)
    return name if name in KERNELS else ""


class _Helper:
    """A second process, which compiles about half of the kernels into the same cache.

    If it fails, this process compiles what is missing.
    """

    def __init__(self, rehearsal: bytes, stack: ExitStack) -> None:
        self._rehearsal = rehearsal
        self._stack = stack
        self._process: subprocess.Popen[bytes] | None = None
        self._rest = b""

    def start(self) -> None:
        """Start it, unless it was started before or there is only one core."""
        if self._process is not None or len(os.sched_getaffinity(0)) == 1:
            return
        path = os.pathsep.join(filter(None, sys.path))
        self._process = self._stack.enter_context(
            subprocess.Popen(  # noqa: S603 - this very program
                [sys.executable, "-c", _HELP],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": path},
            )
        )
        self._stack.callback(self._process.kill)
        with suppress(BrokenPipeError):
            _pipe(self._process.stdin).write(self._rehearsal)
            _pipe(self._process.stdin).close()
        os.set_blocking(_pipe(self._process.stdout).fileno(), False)

    def is_busy(self) -> bool:
        """Tell whether it still compiles."""
        return self._process is not None and self._process.poll() is None

    def wait(self) -> None:
        """Wait for a moment, or until it has ended."""
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_PAUSE_S)

    def compiled(self) -> set[str]:
        """Return the names of the kernels that it has begun to compile since the last call."""
        if self._process is None:
            return set()
        said = self._rest + (_pipe(self._process.stdout).read() or b"")
        *names, self._rest = said.split(b"\n")
        return {name.decode() for name in names}


def _pipe(pipe: IO[bytes] | None) -> IO[bytes]:
    if pipe is None:
        raise ValueError("the process was started without this pipe")
    return pipe


class _Names(event.Listener):  # type: ignore[misc] # numba is not typed
    """Writes the name of each kernel that compiles to the parent process."""

    def on_start(self, compilation: Any) -> None:
        """Write it at once: if the parent is gone, this process ends."""
        if kernel := _kernel_of(compilation):
            os.write(_STDOUT, f"{kernel}\n".encode())

    def on_end(self, _: Any) -> None:
        """Go on."""


@on_long_stack
def help_out() -> None:
    """Compile decisions, perception, maps and sensors, as the second process.

    Its input says for what. Decisions come first: the parent process needs them soonest.
    """
    gc.set_threshold(*_FEW_COLLECTIONS)
    catalogue, needs = pickle.load(sys.stdin.buffer)  # noqa: S301 - our own parent wrote it
    standing, still = {"standing": 1.0}, MotionLimits(speed_mps=0.0)
    rows = [replace(row, behaviours=standing, motion=still) for row in catalogue.rows]
    with event.install_listener("numba:compile", _Names()):
        _Scene(catalogue, needs, lambda: None).decide()
        _Scene(Catalogue(tuple(rows)), needs, lambda: None).sense()


class _Scene:
    """A room with a robot, a wall, voxels, a scan and some artefacts, for two seconds."""

    def __init__(self, catalogue: Catalogue, needs: WarmUpNeeds, ask: Callable[[], None]) -> None:
        count = len(catalogue.rows)
        rates = (count / 4, count / 2)  # small and large ones, of a catalogue of any length
        self._catalogue, self._needs, self._ask = catalogue, needs, ask
        self._parameters = with_values(Parameters(), {**_MINIATURE, "mixture.rates": rates})
        self._builder = ArBuilder(self._parameters, catalogue, MOTION_ONLY)
        self._builder.receive_map(_room(), 0)
        self._tick = 0

    def plan(self) -> None:
        """Let agents plan motions by commands of ours: the local planner without decisions."""
        crowd, environment = self._crowd()
        rows = range(len(crowd.table))
        if rows:
            crowd.planner.give_commands(rows, [MotionCommand((1.0, -1.5), 1.0) for _ in rows])
            crowd.planner.step(0, environment, None)

    def decide(self) -> None:
        """Let agents decide where to go: navigation without motion."""
        crowd, environment = self._crowd()
        mask = environment.classes.free
        crowd.enter(environment, SpawnRegion(mask, None, 1.0), Zones())
        _find_nearest(crowd)
        for index in range(_TICKS):
            crowd.decisions.decide(index, index * crowd.period_ns, None)

    def _crowd(self) -> tuple[CrowdSimulator, Environment]:
        """Return the simulation with two agents that can walk, if a row of the catalogue can."""
        now_ns = self._move()
        _let_walk(self._builder, self._catalogue, now_ns)
        environment = self._builder.lives.environment
        if environment is None:
            raise RuntimeError("the miniature scene has no environment")
        return self._builder.lives.crowd, environment

    def live(self) -> None:
        """Let artefacts arrive and move, without a camera that sees them."""
        builder = self._builder
        anywhere = with_values(self._parameters, {"population.appear": "anywhere"})
        builder.reconfigure(anywhere, 0)
        for _ in range(_TICKS):
            now_ns = self._move()
            if self._tick == 2:
                _let_walk(builder, self._catalogue, now_ns)
            builder.step(now_ns)
        _find_nearest(builder.lives.crowd)

    def sense(self) -> None:
        """Let them be seen, scanned and mapped."""
        builder = self._builder
        builder.reconfigure(self._parameters, self._tick * _TICK_NS)
        builder.demand = self._needs.demand
        if self._needs.has_voxels:
            builder.receive_cloud(_voxels(), "map", self._tick * _TICK_NS, 0.1)
        builder.receive_camera(_lens(), self._tick * _TICK_NS)
        self.take_readings(range(len(self._needs.sensors)))
        _let_collide(builder)

    def take_readings(self, order: Iterable[int]) -> None:
        """Let sensors make a reading each at every tick, in this order."""
        builder = self._builder
        topics = {f"sensor_{k}": self._needs.sensors[k] for k in order}
        for topic, make in topics.items():
            if hasattr(make(_BASE, 0), "seen_through"):
                builder.await_lens(topic, "camera_info")
                builder.receive_lens(topic, Lens.miniature(_BASE), self._tick * _TICK_NS)
        for i in range(_READINGS):
            now_ns = self._move()
            for topic, make in topics.items():
                builder.receive_reading(topic, make(_BASE, now_ns), now_ns)
            if i == 1:
                pose = GroundPose(2.0, 1.5, 0.0, 0.1)
                with suppress(PlacementError):  # an artefact may stand there
                    builder.lives.place(self._catalogue.rows[0], pose, now_ns)
            builder.step(now_ns)
            builder.take_readings()

    def _move(self) -> int:
        """Move the robot on, and return the time."""
        self._ask()
        now_ns, x_m = self._tick * _TICK_NS, 0.1 * (self._tick % _TICKS)
        self._builder.receive_transform("map", _BASE, now_ns, (x_m, 0, 0), _NO_TURN, now_ns)
        self._tick += 1
        return now_ns


def _tame(catalogue: Catalogue) -> Catalogue:
    """Return a catalogue whose rows have no behaviours and planners of the user's own."""
    return Catalogue(
        tuple(
            replace(
                row,
                behaviours=_known(row.behaviours, "walking"),
                planners=_known(row.planners, "dynamic_window"),
            )
            for row in catalogue.rows
        )
    )


def _known(shares: Mapping[str, float], instead: str) -> dict[str, float]:
    """Return shares by name, with another name in place of classes of the user's own."""
    known = dict.fromkeys([name for name in shares if ":" not in name], 0.0)
    for name, share in shares.items():
        own = instead if ":" in name else name
        known[own] = known.get(own, 0.0) + share
    return known


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


def _find_nearest(crowd: CrowdSimulator) -> None:
    """Find the destination nearest to a point, as those do who look for a meeting."""
    places = crowd.navigation.places
    if len(places.destinations_m):
        places.nearest_to(np.zeros((1, 2)))


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
    resolver.resolve(np.array([1, 2]), together, apart, environment, None)


def _room() -> OccupancyGrid:
    cells = np.full((_SIDE, _SIDE), FREE, dtype=np.int8)
    cells[:, -5:] = OCCUPIED
    cells[:5, :20] = -1
    return OccupancyGrid(cells, 0.05, RigidTransform.planar(-3.0, -3.0, 0.0), "map")


def _voxels() -> npt.NDArray[np.float32]:
    """Return a wall and some floor, as voxel centres."""
    side = np.arange(10) * 0.1 + 0.05
    wall = np.array([(2.85, y, z) for y in side for z in side])
    floor = np.array([(x, y, -0.05) for x in side for y in side])
    return np.concatenate((wall, floor)).astype(np.float32)  # as clouds come in messages


def _lens() -> Camera:
    """Return a camera of the miniature's size whose lens distorts."""
    view = PinholeView(*MINIATURE_PX, 16.0, 16.0, 15.5, 11.5, distortion=(0.1, *[0.0] * 13))
    return mounted_camera(view, (0.0, 0.0, 0.5, 0.0, 0.0, 0.0))
