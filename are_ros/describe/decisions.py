"""What a type of artefact would do on a map: values, best moves, and the lives of a small crowd."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.body import Body
from are_ros.agents.mdp.coarse_map import CoarseMap, CoarseMaps
from are_ros.agents.mdp.model import MAX_REACH, Problem, TravelModel, problem_of, solve, ways_to
from are_ros.agents.navigation.destinations import destinations_in
from are_ros.agents.navigation.profile import NavigationProfile
from are_ros.agents.navigation.terrain import Terrains
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.spawning.placement import PlacementConstraints, Placer
from are_ros.builder.tick import MOTION_ONLY
from are_ros.conventions import NS_PER_S
from are_ros.describe.site import Survey
from are_ros.errors import CatalogueError, MapError
from are_ros.parameters.choices import Region
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import BehaviourParameters, Parameters
from are_ros.population.artefact import boxes_of
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.randomness import Purpose, generator
from are_ros.wording import listed, percent

SHOWN_S: Final = (5.0, 10.0, 20.0)
"""Remaining lives that are shown, beside the longest horizon."""

CROWD: Final = 40
LIFE_NS: Final = 60 * NS_PER_S
"""So many artefacts are simulated, each for so long."""

MOMENT_NS: Final = NS_PER_S // 4
"""Between two moments of a life that are kept."""

_AREA_OF_ONE_M2: Final = 8.0
"""In crowds as dense as this at most; there are several, one after the other, on a small map."""

_USUAL_PACE: Final = 0.9
"""In the middle of the paces that walking draws."""

_WALKS: Final = ("walking", "driving")
_RUNS: Final = "running"
_ALL_PLANES: Final = 2**62

_Record = tuple[list[tuple[float, float]], list[str]]
Floats = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]


def row_named(catalogue: Catalogue, name: str) -> CatalogueRow:
    """Return the row with this label or index; CatalogueError, with near labels, if there is none.

    Raises it for a row that never moves, too: it has nothing to decide.
    """
    rows = {row.label: row for row in catalogue.rows}
    row = rows.get(name)
    if row is None and name.isdecimal() and int(name) < len(catalogue.rows):
        row = catalogue.rows[int(name)]
    if row is None:
        raise CatalogueError(
            f"--decisions {name}: the catalogue has no such row{_near(rows, name)}"
        )
    if row.motion.speed_mps <= 0.0:
        raise CatalogueError(f"--decisions {name}: {row.label} never moves, it has no choice")
    return row


def _near(rows: dict[str, CatalogueRow], name: str) -> str:
    """Return which rows may have been meant."""
    if name.isdecimal():
        return f"; they are numbered from 0 to {len(rows) - 1}"
    near = [label for label, row in rows.items() if row.class_name == name]
    near = near or get_close_matches(name, rows, n=3)
    return f"; did you mean {' or '.join(near[:3])}?" if near else "; --all lists them"


# Values and best moves.


@dataclass(frozen=True, eq=False)
class BestMoves:
    """The values with some epochs left, on h x w coarse cells, and the best moves.

    `values` float64 (h, w) are those of the best of the four headings, NaN where there is no way;
    `paces` and `moves` int64 (h, w) the best action from there: move 0 stays, 1 to 4 go east,
    north, west and south of the grid; -1 where there is no way.
    """

    left_s: float
    values: Floats
    paces: Numbers
    moves: Numbers

    @property
    def running_share(self) -> float:
        """The share of the cells with a way from which the best move is at the second pace."""
        return float((self.paces > 0).sum() / max(1, (self.moves >= 0).sum()))


@dataclass(frozen=True, eq=False)
class JourneyValues:
    """The decision process of a type going to one goal on a map, for several remaining lives."""

    coarse: CoarseMap
    model: TravelModel
    goal_m: tuple[float, float]
    horizons: tuple[BestMoves, ...]


def journey_of(
    row: CatalogueRow,
    settings: BehaviourParameters,
    survey: Survey,
    shown_s: Sequence[float] = SHOWN_S,
) -> JourneyValues:
    """Return the values of going to the roomiest destination of a map; MapError if it fits nowhere.

    The type goes at nine tenths of its speed, as its artefacts do on average.
    """
    period_s = settings.decision_period
    longest = max(1, round(settings.max_horizon / period_s))
    coarse, goal_m = _goal_of(row, settings, survey)
    slip = settings.slip if row.slip is None else row.slip
    model = TravelModel.of(row, paces_mps(row), coarse.cell_size_m, period_s, slip)
    goal = coarse.cell_of(*goal_m)
    assert goal is not None, "a goal was found in a cell"  # noqa: S101 - for the type
    ways = ways_to(coarse.edges, coarse.nearness, goal, model)
    problem, is_open = problem_of(ways), np.isfinite(ways.costs)
    solution = solve(problem, longest, _ALL_PLANES)
    epochs = sorted({*(min(longest, max(1, round(s / period_s))) for s in shown_s), longest})
    horizons = tuple(
        best_moves(problem, solution.plane(t), solution.plane(t - 1), is_open, t * period_s)
        for t in epochs
    )
    return JourneyValues(coarse, model, goal_m, horizons)


def paces_mps(row: CatalogueRow) -> tuple[float, ...]:
    """Return the speeds [m/s] at which a type goes to its destinations: walking, then running."""
    speed_mps, factor = _USUAL_PACE * row.motion.speed_mps, row.motion.running_factor
    runs = row.behaviours.get(_RUNS, 0.0) > 0.0
    walks = any(row.behaviours.get(name, 0.0) > 0.0 for name in _WALKS) or not runs
    return tuple(sorted({*([speed_mps] * walks), *([factor * speed_mps] * runs)}))


def _goal_of(
    row: CatalogueRow, settings: BehaviourParameters, survey: Survey
) -> tuple[CoarseMap, tuple[float, float]]:
    """Return the coarse map of a type, and the first destination in its largest part."""
    profile, environment = NavigationProfile.of(row, Body.of(row)), survey.environment
    terrain, maps = Terrains().of(environment, profile.height_m), CoarseMaps(settings.cell_size)
    places = destinations_in(environment.grid, survey.region.mask, environment.clearance_m)
    for radius_m in dict.fromkeys((profile.radius_m, profile.narrow_m)):
        coarse = maps.of(terrain, radius_m)
        sizes = np.bincount(coarse.components[coarse.components >= 0], minlength=1)
        largest = sizes.argmax()
        for x_m, y_m in places.destinations_m.tolist():
            cell = coarse.cell_of(x_m, y_m)
            if cell is not None and coarse.components[cell] == largest:
                return coarse, coarse.anchor_of(cell)
    reason = "it is too wide for it" if len(places.destinations_m) else "there is no floor on it"
    raise MapError(f"{row.label} has no destination on this map: {reason}")


def best_moves(
    problem: Problem,
    values: npt.NDArray[np.float32],
    later: npt.NDArray[np.float32],
    is_open: npt.NDArray[np.bool_],
    left_s: float,
) -> BestMoves:
    """Return the best moves where `values` float32 (4, h, w) are V_t, and `later` V_(t-1).

    There are some from the cells that are open (h, w). Of equal actions the first counts: staying,
    the paces in their order, each by direction.
    """
    actions = action_values(problem, later)
    heading = values.argmax(axis=0)
    best = np.take_along_axis(actions, heading[None, None], axis=0)[0].argmax(axis=0)
    moves = np.where(best == 0, 0, 1 + (best - 1) % 4)
    paces = np.where(best == 0, 0, (best - 1) // 4)
    return BestMoves(
        left_s,
        np.where(is_open, values.max(axis=0).astype(np.float64), np.nan),
        np.where(is_open, paces, 0),
        np.where(is_open, moves, -1),
    )


def action_values(problem: Problem, later: npt.NDArray[np.float32]) -> Floats:
    """Return Q (4, 1 + 4 P, h, w) by heading and action: staying, then the moves of each pace.

    `later` float32 (4, h, w) are the values an epoch later. A move that slips fails, or goes to
    either side; before a move one turns (docs/decisions.md).
    """
    model, gains = problem.model, problem.gains.astype(np.float64)
    straight, fails, aside = model.chances
    result = np.empty((4, *gains.shape))
    result[:, 0] = gains[0] + later
    for pace, reach in enumerate(model.reaches):
        ends = [_after(later[d], problem.lengths[d], reach, d) for d in range(4)]
        of_pace = gains[1 + 4 * pace :][:4] + np.array(ends)
        lost = model.effort[pace] + model.rest
        for move in range(4):
            sides = of_pace[(move + 1) % 4] + of_pace[(move + 3) % 4]
            failed = gains[0] - lost + later[move]
            brings = straight * of_pace[move] + aside * sides + fails * failed
            for heading in range(4):
                turn = (0.0, model.quarter_turn, model.half_turn, model.quarter_turn)
                result[heading, 1 + 4 * pace + move] = brings - turn[(move - heading) % 4]
    return result


def _after(
    later: npt.NDArray[np.float32], lengths: npt.NDArray[np.uint8], reach: int, direction: int
) -> npt.NDArray[np.float32]:
    """Return the values (h, w) at the ends of moves in a direction, of at most `reach` cells."""
    rows, cols = np.indices(later.shape)
    steps = np.minimum(lengths.astype(np.int64), min(reach, MAX_REACH))
    row_step, col_step = ((0, 1), (1, 0), (0, -1), (-1, 0))[direction]
    ends: npt.NDArray[np.float32] = later[rows + row_step * steps, cols + col_step * steps]
    return ends


# The lives of a small crowd.


@dataclass(frozen=True, eq=False)
class Way:
    """Where an artefact was at each moment of its life, (N, 2) [m], and its behaviours (N,)."""

    points_m: Floats
    behaviours: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Lives:
    """What became of the artefacts of a crowd.

    `catalogue` are the shares of the behaviours by the row, in its order; behaviours that are not
    in it (walking out) have 0.
    """

    ways: tuple[Way, ...]
    catalogue: dict[str, float]

    @property
    def shares_over_time(self) -> Floats:
        """The share of those alive in each behaviour (B, N), by the time since their arrival."""
        names, longest = list(self.catalogue), max(len(way.behaviours) for way in self.ways)
        counts = np.zeros((len(names), longest))
        for way in self.ways:
            for k, name in enumerate(way.behaviours):
                counts[names.index(name), k] += 1.0
        shares: Floats = counts / counts.sum(axis=0)
        return shares

    @property
    def shares(self) -> dict[str, float]:
        """The share of all time that was spent in each behaviour."""
        done = [name for way in self.ways for name in way.behaviours]
        return {name: done.count(name) / len(done) for name in self.catalogue}


def simulate_lives(
    row: CatalogueRow,
    catalogue: Catalogue,
    parameters: Parameters,
    survey: Survey,
    progress: Callable[[int], object] = lambda _: None,
) -> Lives:
    """Let 40 artefacts of a type, or a few more, live for a minute each on a map, without a robot.

    On a small map they come one crowd after the other. `progress` gets the time [ns], which ends
    at `simulated_ns`. MapError if none finds a place.
    """
    builder = ArBuilder(_alone(parameters), catalogue, MOTION_ONLY)
    builder.receive_map(survey.environment.grid, 0)
    placer, known = Placer(survey.environment, survey.region), dict[int, _Record]()
    size = crowds_of(survey)[1]
    for now_ns in range(0, simulated_ns(survey), MOMENT_NS):
        builder.lives.touch(now_ns)
        builder.step(now_ns)
        if now_ns % LIFE_NS == 0:
            first = 1 + now_ns // LIFE_NS * size
            streams = (generator(parameters.seed, Purpose.PLACE, first + k) for k in range(size))
            _place(builder, placer, row, streams, now_ns)
        for artefact in builder.lives.scene_at(now_ns).artefacts:
            points_m, behaviours = known.setdefault(artefact.id, ([], []))
            points_m.append(artefact.ground_pose_at(now_ns)[:2])
            behaviours.append(artefact.behaviour)
        progress(now_ns + MOMENT_NS)
    if not known:
        raise MapError(f"{row.label} finds no place on this map")
    ways = tuple(Way(np.array(points_m), tuple(done)) for points_m, done in known.values())
    shares = {name: share for name, share in row.behaviours.items() if share > 0.0}
    return Lives(ways, shares | {n: 0.0 for way in ways for n in way.behaviours if n not in shares})


def crowds_of(survey: Survey) -> tuple[int, int]:
    """Return in how many crowds the artefacts come on a map, and the size of each."""
    most = max(1, min(CROWD, int(survey.region.area_m2 / _AREA_OF_ONE_M2)))
    crowds = math.ceil(CROWD / most)
    return crowds, math.ceil(CROWD / crowds)


def simulated_ns(survey: Survey) -> int:
    """Return how long all crowds live [ns]."""
    return crowds_of(survey)[0] * LIFE_NS


def _alone(parameters: Parameters) -> Parameters:
    """Return parameters with which nobody comes by chance, and no robot is needed."""
    changes: dict[str, Any] = {
        "population.arrival_rate": 0.0,
        "population.scenario": "",
        "population.max_alive": 2 * CROWD,
    }
    if parameters.population.region is Region.REACHABLE:
        changes["population.region"] = Region.FREE.value
    return with_values(parameters, changes)


def _place(
    builder: ArBuilder,
    placer: Placer,
    row: CatalogueRow,
    streams: Iterable[np.random.Generator],
    now_ns: int,
) -> None:
    """Add an artefact for each random stream that finds a place."""
    poses: list[Sequence[float]] = []
    for stream in streams:
        taken = PlacementConstraints(boxes_of([row] * len(poses), poses))
        pose = placer.place(row, stream, taken)
        if pose is not None:
            poses.append(pose)
            builder.lives.place(row, pose, now_ns, life_ns=LIFE_NS)


# In words.


def decision_lines(
    row: CatalogueRow, settings: BehaviourParameters, journey: JourneyValues, lives: Lives
) -> list[tuple[str, str]]:
    """Return what the decisions of a type rest on, and what came of them, as pairs of cells."""
    model, coarse, slip = journey.model, journey.coarse, f"{journey.model.slip:g}"
    reaches = listed([f"{reach}" for reach in model.reaches])
    cells = "cell" if reaches == "1" else "cells"
    speeds = listed([f"{speed:.2g} m/s" for speed in paces_mps(row)])
    paces = zip(model.effort, paces_mps(row), strict=True)
    effort = listed([f"{price:.3g} at {speed:.2g} m/s" for price, speed in paces])
    turns = f"{model.quarter_turn:.3g} for a quarter turn, {model.half_turn:.3g} for a half"
    walls = f"up to {model.clearance:.3g} more beside walls"
    runs = [f"{percent(one.running_share)} at {one.left_s:g} s" for one in journey.horizons]
    return [
        ("reach", f"{reaches} {cells} of {coarse.cell_size_m:g} m in an epoch ({speeds})"),
        ("epoch", f"{settings.decision_period:g} s, horizon {journey.horizons[-1].left_s:g} s"),
        ("prices", f"of an epoch {model.time:.3g}, {walls}; {model.rest:.3g} less for a stop"),
        ("", f"effort {effort}"),
        ("", turns),
        ("goal", f"worth {model.goal:.3g}; late: {model.late:g} times the rest of the way"),
        ("policy", f"temperature {settings.temperature:g}, persistence {settings.persistence:g} s"),
        ("slip", slip if row.slip is None else f"{slip}, of the row"),
        *([("runs", f"best on {', '.join(runs)}")] if len(model.reaches) > 1 else []),
        *_share_rows(lives),
    ]


def _share_rows(lives: Lives) -> list[tuple[str, str]]:
    """Return the shares of the simulated time, and those of the catalogue."""
    catalogue, realised = lives.catalogue, lives.shares
    names = sorted(realised, key=lambda name: -catalogue[name])
    words = [f"{name} {percent(realised[name])} ({percent(catalogue[name])})" for name in names]
    lines = [", ".join(words[k : k + 3]) for k in range(0, len(words), 3)]
    whose = f"of the time of {len(lives.ways)} simulated lives (of the catalogue)"
    return [("shares", whose), *(("", line) for line in lines)]
