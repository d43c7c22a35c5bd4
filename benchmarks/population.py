"""A tick of a whole population, grown with the map, against a step of pyrvo with as many agents.

Ours: 0.1 s, two sub-steps, of all that happens to the artefacts: arrivals, departures, decisions
(the behaviours of the shipped people but standing, on a map of rooms), planning, motion,
collisions; no perception, no messages. The map has rooms of 12 m with doors of 2 m and pillars of
0.4 m, in cells of 0.1 m, and 12 m^2 of free ground for each one alive. Lives are 60 s long in the
mean, and end where one is. Some stop, pause or stand talking, so there are more alive than the
number of a row, such that about that number move in a sub-step.

pyrvo (ORCA) has as many agents as have moved here in the warm-up, one for 12 m^2 too, in discs of
the mean size of our people, at their speed, each with goals within 15 m of itself; a time step of
0.1 s, and what its examples Blocks and Roadmap have: neighbour distance 15 m, 10 neighbours, time
horizons of 5 s. A step is `do_step` after the preferred velocities of all were set in Python, as
its examples do; without walls, and with ours as polygons (the like of what ours do). What a step
costs it does not depend on the time step, so one is compared with a tick and with a sub-step of
ours. One thread.

Prints the median and 90th percentile of ticks over 10 s of simulated time, the median of
interleaved repetitions each, in time of the thread, which other programs disturb less.
Run: python benchmarks/population.py [--largest N] [--repetitions R]
"""

import argparse
import importlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.builder import assembly
from are_ros.builder.files.catalogue_file import SHIPPED_CATALOGUE, read_catalogue
from are_ros.builder.population_manager import PopulationManager
from are_ros.builder.simulation import Simulation
from are_ros.conventions import NS_PER_S
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

SIZES = (100, 300, 1_000, 3_000, 10_000)
MOVING_SHARE = 0.73
"""Of those alive, how many move in a sub-step, as measured; the rest stops, pauses or talks."""
AREA_OF_ONE_M2 = 12.0
MEAN_LIFE_S = 60.0
WARM_UP_S = 15.0
MEASURED_S = 10.0
TICK_NS = NS_PER_S // 10
RESOLUTION_M = 0.1
ROOM_M = 12.0
DOOR_M = 2.0
WALL_M = 0.2
PILLAR_M = 0.4
FREE_SHARE = 0.96
PEER_STEPS = 10
GOALS_WITHIN_M = 15.0
NEIGHBOURS_WITHIN_M, NEIGHBOURS, HORIZON_S = 15.0, 10, 5.0

Rectangle = tuple[float, float, float, float]
"""x0, y0, x1, y1 [m]."""


def obstacles(side_m: float) -> list[Rectangle]:
    """Return the wall pieces and pillars of a square hall, its outer walls left out."""
    count = math.ceil(side_m / ROOM_M)
    half, gap = 0.5 * (ROOM_M - DOOR_M), 0.5 * WALL_M
    found: list[Rectangle] = []
    for i, j in np.ndindex(count, count):
        x, y = ROOM_M * i, ROOM_M * j
        for start in (0.0, half + DOOR_M):
            found.append((x - gap, y + start, x + gap, y + start + half))
            found.append((x + start, y - gap, x + start + half, y + gap))
        for dx, dy in ((3.0, 3.0), (9.0, 3.0), (3.0, 9.0), (9.0, 9.0)):
            found.append((x + dx, y + dy, x + dx + PILLAR_M, y + dy + PILLAR_M))
    low, high = WALL_M, side_m - WALL_M
    clipped = [tuple(min(max(v, low), high) for v in one) for one in found]
    return [(a, b, c, d) for a, b, c, d in clipped if c - a > gap and d - b > gap]


def hall(side_m: float) -> OccupancyGrid:
    """Return the map of a square hall."""
    size = round(side_m / RESOLUTION_M)
    cells = np.zeros((size, size), np.int8)
    edge = round(WALL_M / RESOLUTION_M)
    cells[:edge] = cells[-edge:] = cells[:, :edge] = cells[:, -edge:] = 100
    for rectangle in obstacles(side_m):
        x0, y0, x1, y1 = (round(v / RESOLUTION_M) for v in rectangle)
        cells[y0:y1, x0:x1] = 100
    return OccupancyGrid(cells, RESOLUTION_M, RigidTransform.identity(), "map")


def people() -> Catalogue:
    """Return the shipped people, none of whom just stands."""
    rows = read_catalogue(SHIPPED_CATALOGUE).rows_named("person")
    return Catalogue(tuple(_not_standing(row, index) for index, row in enumerate(rows)))


def _not_standing(row: CatalogueRow, index: int) -> CatalogueRow:
    weights = {name: weight for name, weight in row.behaviours.items() if name != "standing"}
    total = sum(weights.values())
    behaviours = {name: weight / total for name, weight in weights.items()}
    return replace(row, index=index, behaviours=behaviours)


class Town:
    """A population in its hall, from the instant on at which it has its size."""

    def __init__(self, moving: int) -> None:
        alive = round(moving / MOVING_SHARE)
        self.side_m = math.sqrt(AREA_OF_ONE_M2 * alive / FREE_SHARE)
        self._parameters = with_values(
            Parameters(),
            {
                "population.region": "free",
                "population.mean_life": MEAN_LIFE_S,
                "population.max_alive": 100_000,
                "population.arrival_rate": 1.0 / AREA_OF_ONE_M2,
                "mixture.weights": (1.0,),
                "mixture.rates": (4.0,),
            },
        )
        reality = Simulation(self._parameters, people())
        self.now_ns = 1_000 * NS_PER_S
        reality.receive_map(hall(self.side_m), self.now_ns)
        self.lives: PopulationManager = reality.lives
        self._fill(alive)

    def _fill(self, alive: int) -> None:
        """Let them arrive sixty times as fast until they are so many."""
        while len(self.lives.population.living) < alive:
            self.tick()
        rate = 1.0 / (AREA_OF_ONE_M2 * MEAN_LIFE_S)
        parameters = with_values(self._parameters, {"population.arrival_rate": rate})
        self.lives.reconfigure(parameters, assembly.collision_resolver(parameters), self.now_ns)

    def tick(self) -> None:
        """Go a tick on."""
        self.now_ns += TICK_NS
        self.lives.touch(self.now_ns)  # as if something came in, or an idle world would stand
        self.lives.advance(self.now_ns)
        self.lives.take_events()

    def moving(self, duration_s: float) -> int:
        """Run for a while; return how many have moved in a sub-step of it, in the mean."""
        before = self.lives.crowd.counts.moving_steps
        ticks = len(self.run(duration_s))
        return round((self.lives.crowd.counts.moving_steps - before) / (2 * ticks))

    def run(self, duration_s: float) -> npt.NDArray[np.float64]:
        """Return what each tick took [ms]."""
        count = round(duration_s * NS_PER_S / TICK_NS)
        return np.array([milliseconds(self.tick) for _ in range(count)])


@dataclass(frozen=True)
class Walker:
    """The mean of our people: radius [m] and speed [m/s]."""

    radius_m: float
    speed_mps: float

    @classmethod
    def mean(cls) -> "Walker":
        """Return the mean over the rows."""
        rows = people().rows
        radii = [0.5 * math.hypot(row.size_m[0], row.size_m[1]) for row in rows]
        speeds = [row.motion.speed_mps for row in rows]
        return cls(float(np.mean(radii)), float(np.mean(speeds)))


class Peer:
    """Agents of pyrvo that go from goal to goal about them."""

    def __init__(self, rvo: Any, count: int, *, has_walls: bool) -> None:
        walker, self._random = Walker.mean(), np.random.default_rng(count)
        self._side_m = math.sqrt(AREA_OF_ONE_M2 * count / FREE_SHARE)
        self._simulator = rvo.RVOSimulator()
        self._simulator.set_time_step(TICK_NS / NS_PER_S)
        horizons = (HORIZON_S, HORIZON_S)
        self._simulator.set_agent_defaults(
            NEIGHBOURS_WITHIN_M, NEIGHBOURS, *horizons, walker.radius_m, walker.speed_mps
        )
        self._speed_mps = walker.speed_mps
        if has_walls:
            for x0, y0, x1, y1 in obstacles(self._side_m):
                self._simulator.add_obstacle([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
            self._simulator.process_obstacles()
        # about a grid, so that nobody begins in another
        columns = math.ceil(math.sqrt(count))
        pitch_m = self._side_m / columns
        for k in range(count):
            offset_m = self._random.uniform(0.3, 0.7, 2) * pitch_m
            at_m = (k % columns * pitch_m + offset_m[0], k // columns * pitch_m + offset_m[1])
            self._simulator.add_agent(at_m)
        self._goals_m = [
            self._goal_near(self._simulator.get_agent_position(k)) for k in range(count)
        ]

    def _goal_near(self, point: Any) -> tuple[float, float]:
        x_m, y_m = np.clip(
            np.array(point.to_tuple()) + self._random.uniform(-GOALS_WITHIN_M, GOALS_WITHIN_M, 2),
            1.0,
            self._side_m - 1.0,
        ).tolist()
        return x_m, y_m

    def prefer(self) -> None:
        """Set the preferred velocities of all, as the examples of pyrvo do; new goals, too."""
        simulator, speed_mps = self._simulator, self._speed_mps
        for k, goal_m in enumerate(self._goals_m):
            point = simulator.get_agent_position(k)
            dx_m, dy_m = goal_m[0] - point.x, goal_m[1] - point.y
            away_m = math.hypot(dx_m, dy_m)
            if away_m < 1.0:
                self._goals_m[k] = self._goal_near(point)
            share = speed_mps / max(away_m, 1e-9)
            simulator.set_agent_pref_velocity(k, (share * dx_m, share * dy_m))

    def run(self, steps: int) -> npt.NDArray[np.float64]:
        """Return what preferring and `do_step` took [ms] in each step, float64 (steps, 2)."""
        step: Callable[[], object] = self._simulator.do_step
        return np.array([(milliseconds(self.prefer), milliseconds(step)) for _ in range(steps)])


def milliseconds(action: Callable[[], object]) -> float:
    """Return what one call takes of this thread's time [ms]; others on the machine count less."""
    start = time.thread_time()
    action()
    return 1e3 * (time.thread_time() - start)


def compare(moving: int, repetitions: int, rvo: Any) -> float:
    """Print the figures of one size; return our median [ms]."""
    town = Town(moving)
    as_many = town.moving(WARM_UP_S)
    peers = [Peer(rvo, as_many, has_walls=walls) for walls in (False, True)]
    for peer in peers:
        peer.run(5 * PEER_STEPS)
    before, ours, theirs = replace(town.lives.crowd.counts), [], []
    for _ in range(repetitions):
        ticks = town.run(MEASURED_S)
        ours.append((np.median(ticks), np.quantile(ticks, 0.9)))
        theirs.append([np.median(peer.run(PEER_STEPS), axis=0) for peer in peers])
    counts, steps = town.lives.crowd.counts, repetitions * MEASURED_S * 2 * NS_PER_S / TICK_NS
    alive = (counts.artefact_steps - before.artefact_steps) / steps
    moved = (counts.moving_steps - before.moving_steps) / steps
    tick, late = np.median(ours, axis=0).tolist()
    (prefer, step), (prefer_walled, walled) = np.median(theirs, axis=0).tolist()
    among_walls = prefer_walled + walled
    print(
        f"{moving:6d} {alive:7.0f} {moved:7.0f} {tick:9.2f} {late:8.2f} {0.5 * tick:9.2f}"
        f" {prefer + step:9.2f} {step:8.2f} {among_walls:12.2f}"
        f" {among_walls / tick:8.2f} {2.0 * among_walls / tick:9.2f} {(prefer + step) / tick:11.2f}"
    )
    return float(tick)


def main(largest: int, repetitions: int) -> None:
    """Print all figures of one run."""
    try:
        rvo = importlib.import_module("pyrvo")
    except ImportError:
        raise SystemExit("pyrvo is not installed: pip install --no-deps pyrvo") from None
    walker = Walker.mean()
    print(
        f"agents of {walker.radius_m:.2f} m at {walker.speed_mps:.2f} m/s, median of {repetitions}"
    )
    print(
        "             ours [ms]: a tick of 0.1 s, 0.05 s   pyrvo [ms]: a step         pyrvo / ours"
    )
    print(
        " moves   alive   moved    median     90 %  sub-step    no walls  do_step among walls"
        "  walls/tick  /sub-step  no walls/tick"
    )
    ticks = {size: compare(size, repetitions, rvo) for size in SIZES if size <= largest}
    first = ticks[SIZES[0]] / (SIZES[0] * math.log(SIZES[0]))
    print("time over N log N, of that at 100: ", end="")
    print(", ".join(f"{n}: {t / (n * math.log(n)) / first:.2f}" for n, t in ticks.items()))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=int, default=SIZES[-1], help="leave out larger sizes")
    parser.add_argument("--repetitions", type=int, default=5)
    arguments = parser.parse_args()
    main(arguments.largest, arguments.repetitions)
