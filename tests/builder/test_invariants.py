"""The invariants of DESIGN over a longer run, each by a slow check that shares no code with it.

A robot drives round a block in a building of 10 x 8 m for nine seconds, among some twenty
artefacts that come and go; walls appear and vanish; a laser of 180 beams turns. What the tests know
of the truth is the list of artefacts of each tick and the inputs that they gave themselves.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.ndimage import distance_transform_edt

from are_ros.agents.events import ArtefactState, EventKind
from are_ros.bag.reader import BagMessage
from are_ros.builder.markers import MarkerAction
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.builder.sensors.sensor_path import ReleasedReading
from are_ros.builder.tick import Tick
from are_ros.checks.oracle.plane import (
    Outline,
    PlainBoxes,
    overlapping,
    rectangle_depths_m,
)
from are_ros.errors import InputError
from are_ros.messages.feed import Feed
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import GroundPose
from are_ros.replay.listeners import TickWriter
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from tests.oracles.rays import ray_chords_m

Scene = Any
"""The `Scene` of conftest, which tests cannot import."""
Make = Callable[..., Scene]
Floats = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int8]
TICKS, PERIOD_S, RESOLUTION_M, TOUCH_M = 90, 0.1, 0.1, 1e-5
ROBOT_RADIUS_M, LASER_HEIGHT_M, BEAMS = 0.2, 0.2, 180
VALUES = {
    "population.arrival_rate": 0.06,
    "population.mean_life": 5.0,
    "population.group_size": 1.3,
    "robot.clearance": 0.05,
    "augmented_map.max_rate": 100.0,
    "costmap.inflation_radius": 0.4,
}
RUNS: dict[str, dict[str, Any]] = {
    "all": {"costmap.gate": "all", "collisions.on_robot_contact": "displace"},
    "perceived": {"costmap.gate": "perceived", "collisions.on_robot_contact": "hold", "seed": 5},
}


@dataclass(eq=False)
class Moment:
    """A tick, and what a reader of the outputs knows after it."""

    tick: Tick
    real: OccupancyGrid
    augmented: Cells
    costmap: Cells
    drawn: frozenset[int]


@dataclass(eq=False)
class Run:
    """All moments, and each scan: as it came and left, who stood there at its stamp, the map."""

    gate: str
    moments: list[Moment] = field(default_factory=list)
    scans: list[tuple[LaserScan, ReleasedReading, tuple[ArtefactState, ...], Cells, float]] = field(
        default_factory=list
    )
    inputs: list[tuple[npt.NDArray[Any], bytes]] = field(default_factory=list)


def building(extra: tuple[int, int, int, int]) -> OccupancyGrid:
    """Return the map: free cells of many values, a block to drive round, an unknown corner."""
    rows, cols = np.indices((80, 100))
    cells = ((7 * rows + 3 * cols) % 20).astype(np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    cells[35:45, 42:58] = 90
    cells[1:8, 1:8] = -1
    cells[extra[0] : extra[1], extra[2] : extra[3]] = 100
    return OccupancyGrid(cells, RESOLUTION_M, RigidTransform.identity(), "map")


def robot_pose(t_s: float) -> tuple[float, float, float]:
    """Return where the robot is: on an ellipse about the block."""
    phase = 0.7 * t_s
    x, y = 5.0 + 2.5 * math.cos(phase), 4.0 + 2.0 * math.sin(phase)
    return x, y, math.atan2(2.0 * math.cos(phase), -2.5 * math.sin(phase))


def measured(index: int) -> npt.NDArray[np.float32]:
    """Return ranges near and far, and all that REP 117 knows besides."""
    ranges = np.full(BEAMS, 4.0 + 0.01 * index, dtype=np.float32)
    for every, value in ((5, 0.6), (7, np.inf), (11, np.nan), (13, 0.0), (17, -np.inf)):
        ranges[index % every :: every] = value
    return ranges


def a_scan(scene: Scene, index: int) -> LaserScan:
    """Return the scan of a tick's time."""
    step = 2.0 * math.pi / BEAMS
    none = np.empty(0, dtype=np.float32)
    first, last, stamp_ns = -math.pi, math.pi - step, scene.ns(PERIOD_S * index)
    ranges = measured(index)
    return LaserScan("laser", stamp_ns, first, last, step, 0.0, 0.1, 0.1, 8.0, ranges, none)


class Driver:
    """Gives a builder the inputs of the run, and keeps what comes out."""

    def __init__(self, scene: Scene, gate: str) -> None:
        self.run = Run(gate)
        self._scene = scene
        self._scans: dict[int, tuple[LaserScan, tuple[ArtefactState, ...], float]] = {}
        self._drawn: set[int] = set()
        self._augmented = self._costmap = np.zeros((0, 0), dtype=np.int8)
        self._real = building((0, 0, 0, 0))

    def drive(self, ticks: int) -> Run:
        """Run from the map alone on; the robot comes at the third tick."""
        scene = self._scene
        place = (0.0, 0.0, LASER_HEIGHT_M)
        scene.builder.receive_transform(
            "base_link", "laser", 0, place, (0.0, 0.0, 0.0, 1.0), scene.ns(0.0), is_static=True
        )
        self._take_map(0)
        for index in range(1, ticks + 1):
            t_s = PERIOD_S * index
            tick = scene.tick(t_s)
            self._keep(tick)
            if index >= 3:
                scene.robot(t_s, *robot_pose(t_s))
                self._take_scan(index, tick)
                scene.robot(t_s + 0.05, *robot_pose(t_s + 0.05))
            if index % 13 == 0:
                self._take_map(index)
        return self.run

    def _take_map(self, index: int) -> None:
        row0, col0 = (5 + 11 * index) % 60, 10 + (17 * index) % 20
        self._real = building((row0, row0 + 8, col0, col0 + 5))
        self._note(self._real.cells)
        self._scene.builder.receive_map(self._real, self._scene.ns(PERIOD_S * index + 0.06))

    def _take_scan(self, index: int, tick: Tick) -> None:
        scan = a_scan(self._scene, index)
        self._note(scan.ranges)
        self._scans[scan.stamp_ns] = (scan, tick.artefacts, PERIOD_S * index)
        now_ns = self._scene.ns(PERIOD_S * index + 0.03)
        self._scene.builder.receive_reading("scan", scan, now_ns)
        for released in self._scene.builder.take_readings():
            given, states, t_s = self._scans[released.reading.stamp_ns]
            self.run.scans.append((given, released, states, self._real.cells, t_s))

    def _note(self, array: npt.NDArray[Any]) -> None:
        self.run.inputs.append((array, array.tobytes()))

    def _keep(self, tick: Tick) -> None:
        if tick.grids.augmented_map is not None:
            self._augmented = tick.grids.augmented_map.cells
        if tick.grids.costmap is not None:
            self._costmap = tick.grids.costmap.cells
        for marker, number in zip(tick.markers.looks, tick.markers.ids.tolist(), strict=True):
            if marker.action is MarkerAction.DELETEALL:
                self._drawn.clear()
            elif marker.action is MarkerAction.ADD:
                self._drawn.add(number)
            else:
                self._drawn.discard(number)
        kept = (self._augmented, self._costmap, frozenset(self._drawn))
        self.run.moments.append(Moment(tick, self._real, *kept))


@pytest.fixture(scope="module", params=RUNS)
def run(request: pytest.FixtureRequest, make_scene: Make) -> Run:
    """Return the run with all artefacts in the grids, or with those perceived only."""
    return Driver(make_scene(VALUES | RUNS[request.param]), request.param).drive(TICKS)


# --- slow geometry


Place = tuple[GroundPose, tuple[float, ...], tuple[float, ...]]


def place_of(state: ArtefactState) -> Place:
    """Return all that decides where a box is: pose, size, centre."""
    return state.ground_pose, state.size_m, state.box_centre_m


@cache
def box_of(place: Place) -> PlainBoxes:
    """Return a box in the oracle's form."""
    pose, size_m, centre_m = place
    feet = np.array([(pose.x_m, pose.y_m, pose.z_m)])
    return PlainBoxes.standing(
        feet, np.array([pose.yaw_rad]), np.array([centre_m]), np.array([size_m])
    )


def boxes_of(states: Sequence[ArtefactState]) -> PlainBoxes:
    """Return all boxes in the oracle's form."""
    boxes = [box_of(place_of(state)) for state in states]
    return PlainBoxes(
        np.concatenate([np.empty((0, 3)), *(box.centres_m for box in boxes)]),
        np.concatenate([np.empty(0), *(box.yaws_rad for box in boxes)]),
        np.concatenate([np.empty((0, 3)), *(box.half_sizes_m for box in boxes)]),
    )


@cache
def cell_depths_m(place: Place, shape: tuple[int, int]) -> Floats:
    """Return for each cell (h, w) by how much its square and the footprint overlap."""
    box = box_of(place)
    rows, cols = (index.ravel() for index in np.indices(shape))
    middles = RESOLUTION_M * (np.column_stack((cols, rows)) + 0.5)
    half, square = box.half_sizes_m[0], np.full(2, 0.5 * RESOLUTION_M)
    apart = middles - box.centres_m[0, :2]
    return rectangle_depths_m(apart, box.yaws_rad[0], half, 0.0, square).reshape(shape)


def admitted(moment: Moment, gate: str) -> list[ArtefactState]:
    """Return who belongs into the grids."""
    if gate == "all":
        return list(moment.tick.artefacts)
    ids = {seen.artefact_id for seen in moment.tick.perceived}
    return [state for state in moment.tick.artefacts if state.artefact_id in ids]


def covered(states: list[ArtefactState], shape: tuple[int, int]) -> tuple[Any, Any]:
    """Return which cells are surely covered, and which may be or not within rounding."""
    sure, maybe = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    for state in states:
        depths = cell_depths_m(place_of(state), shape)
        sure |= depths > TOUCH_M
        maybe |= np.abs(depths) <= TOUCH_M
    return sure, maybe & ~sure


def nav2_costs(lethal: Any, unknown: Any) -> npt.NDArray[np.int64]:
    """Return Nav2's inflated costs as it publishes them; unknown counts as lowest (-1)."""
    distances = distance_transform_edt(~lethal) * RESOLUTION_M
    costs = np.floor(252.0 * np.exp(-3.0 * (distances - ROBOT_RADIUS_M))).astype(np.int64)
    costs[distances > VALUES["costmap.inflation_radius"] + 1e-6] = 0
    published = np.where(costs > 0, 1 + 97 * (costs - 1) // 251, 0)
    published[distances <= ROBOT_RADIUS_M + 1e-6] = 99
    published[distances == 0.0] = 100
    published[unknown & (published < 99)] = -1
    return published


# --- the invariants


def test_the_run_is_worth_checking(run: Run) -> None:
    """Artefacts come, go, are moved aside and are driven into."""
    last = run.moments[-1].tick.metrics
    assert last.arrivals > 15
    assert last.departures > 3
    assert last.displaced > 0
    assert last.robot_contacts > 0


def test_the_map_is_the_real_one_outside_artefacts_and_100_inside(run: Run) -> None:
    """At every tick, byte for byte, whoever moved or went since."""
    inside = 0
    for moment in run.moments:
        sure, maybe = covered(admitted(moment, run.gate), moment.real.cells.shape)
        expected = np.where(sure, np.int8(100), moment.real.cells)
        assert np.array_equal(moment.augmented[~maybe], expected[~maybe])
        inside += int(sure.sum())
    assert inside > 1000


def test_the_costmap_is_never_below_that_of_the_real_map(run: Run) -> None:
    """And lethal in the artefacts; by the distance transform of another library."""
    for moment in run.moments[::3]:
        cells = moment.real.cells
        real = nav2_costs(cells >= 65, (cells < 0) | ((cells > 25) & (cells < 65)))
        assert (moment.costmap >= real).all()
        sure, _ = covered(admitted(moment, run.gate), cells.shape)
        assert (moment.costmap[sure] == 100).all()


def test_the_map_is_relayed_before_the_robot_is_known(run: Run) -> None:
    """The first ticks give the real map and its costmap, with nothing in them."""
    for moment in run.moments[:2]:
        cells = moment.real.cells
        assert moment.tick.map_from_base is None
        assert moment.augmented.tobytes() == cells.tobytes()
        assert np.array_equal(moment.costmap, nav2_costs(cells >= 65, cells < 0))


def test_no_artefact_overlaps_a_wall(run: Run) -> None:
    """Of the map in force at the tick."""
    for moment in run.moments:
        occupied = moment.real.cells >= 65
        for state in moment.tick.artefacts:
            depths = cell_depths_m(place_of(state), occupied.shape)
            assert depths[occupied].max() <= TOUCH_M


def test_no_two_artefacts_overlap(run: Run) -> None:
    """All stand on the ground, so that footprints decide."""
    for moment in run.moments:
        depths = [depth for _, _, depth in overlapping(boxes_of(moment.tick.artefacts))]
        assert max(depths, default=0.0) <= TOUCH_M


def test_none_overlaps_the_robot_but_for_reported_contacts(run: Run) -> None:
    """Each overlap at a tick was told as a contact; where they make way there is none."""
    touching: set[int] = set()
    told: set[int] = set()
    robot = Outline.of("", ROBOT_RADIUS_M)
    for moment in run.moments:
        told |= {e.artefact_id for e in moment.tick.events if e.kind is EventKind.ROBOT_CONTACT}
        if moment.tick.map_from_base is None:
            continue
        centre = moment.tick.map_from_base.translation_m[:2]
        boxes = boxes_of(moment.tick.artefacts)
        depths = robot.depths_m(float(centre[0]), float(centre[1]), 0.0, boxes)
        touching |= {
            state.artefact_id
            for state, depth in zip(moment.tick.artefacts, depths, strict=True)
            if depth > TOUCH_M
        }
    assert touching <= told
    assert told
    assert bool(touching) == (run.gate == "perceived")


def test_a_departed_artefact_is_in_no_list_and_not_drawn(run: Run) -> None:
    """Markers are exactly the living; who departed never comes back under its id."""
    departed: set[int] = set()
    for moment in run.moments:
        alive = {state.artefact_id for state in moment.tick.artefacts}
        ended = {e.artefact_id for e in moment.tick.events if e.kind is EventKind.DEPARTED}
        departed |= ended
        assert moment.drawn == {artefact_id % 2**31 for artefact_id in alive}
        assert not alive & departed
        assert not {seen.artefact_id for seen in moment.tick.perceived} - alive
        assert moment.tick.metrics.alive == len(alive)
    assert departed


def hits_m(states: tuple[ArtefactState, ...], t_s: float) -> tuple[Floats, Floats]:
    """Return each beam's first hit on the boxes, and the length of its shortest graze."""
    x, y, yaw = robot_pose(t_s)
    angles = yaw - math.pi + np.arange(BEAMS) * (2.0 * math.pi / BEAMS)
    rays = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(BEAMS)))
    nearest, graze = np.full(BEAMS, np.inf), np.full(BEAMS, np.inf)
    for state in states:
        box = box_of(place_of(state))
        start, half = np.array((x, y, LASER_HEIGHT_M)), box.half_sizes_m[0]
        near, far = ray_chords_m(start, rays, box.centres_m[0], box.yaws_rad[0], half)
        is_hit = (far >= near) & (far > 0.0)
        graze = np.where(np.abs(far - near) < 1e-3, 0.0, graze)
        nearest = np.where(is_hit, np.minimum(nearest, np.maximum(near, 0.0)), nearest)
    return nearest, graze


def walls_m(cells: Cells, t_s: float, margin_m: float) -> Floats:
    """Return how far each beam gets before it is in an occupied cell, grown by a margin."""
    x, y, yaw = robot_pose(t_s)
    angles = yaw - math.pi + np.arange(BEAMS) * (2.0 * math.pi / BEAMS)
    along = np.arange(0.0, 8.0, 0.004)
    points = np.stack(
        (x + np.outer(np.cos(angles), along), y + np.outer(np.sin(angles), along)), -1
    )
    is_wall = np.zeros(points.shape[:2], np.bool_)
    for dx, dy in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        cols, rows = np.floor((points + margin_m * np.array((dx, dy))) / RESOLUTION_M).astype(int).T
        inside = (rows >= 0) & (rows < cells.shape[0]) & (cols >= 0) & (cols < cells.shape[1])
        hit = inside & (cells[np.where(inside, rows, 0), np.where(inside, cols, 0)] >= 65)
        is_wall = is_wall | hit.T if margin_m > 0.0 else hit.T & (is_wall | ((dx, dy) == (1, 1)))
    walls: Floats = np.where(is_wall.any(axis=1), along[is_wall.argmax(axis=1)], np.inf)
    return walls


def test_no_real_return_leaves_a_scan_unless_a_virtual_surface_is_in_front(run: Run) -> None:
    """Beam by beam, at the scan's own stamp: the input's bits, or the hit before it.

    Where there was no return, the walls of the map hide what stands behind them.
    """
    replaced, hidden = 0, 0
    assert len(run.scans) > TICKS - 6
    for given, released, states, cells, t_s in run.scans:
        assert released.is_augmented
        hits, graze = hits_m(states, t_s)
        at_least, at_most = walls_m(cells, t_s, 0.005), walls_m(cells, t_s, -0.005)
        real, out = given.ranges, released.reading.ranges
        changed = out.view(np.uint32) != real.view(np.uint32)
        is_return = (real >= given.range_min_m) & (real <= given.range_max_m)
        in_front = np.where(is_return, hits < real, hits <= given.range_max_m) & ~np.isneginf(real)
        behind = ~is_return & (at_most < hits)
        with np.errstate(invalid="ignore"):
            clear = (graze > 0.0) & ~(np.abs(hits - real) < 1e-4)
            clear &= is_return | (at_most < hits - 0.005) | (at_least > hits + 0.005)
        assert np.array_equal(changed[clear], (in_front & ~behind)[clear])
        virtual = changed & clear & (hits >= given.range_min_m)
        np.testing.assert_allclose(out[virtual], hits[virtual], atol=1e-4)
        replaced += int(changed.sum())
        hidden += int((clear & in_front & behind).sum())
    assert replaced > 500
    assert hidden > 20


def test_inputs_are_never_written_to(run: Run) -> None:
    """Maps and scans that came in are the bytes that they were; what went out is none of them."""
    for array, content in run.inputs:
        assert array.tobytes() == content
    for moment in run.moments:
        assert not np.shares_memory(moment.augmented, moment.real.cells)


def told(tick: Tick) -> tuple[Any, ...]:
    """Return what a tick says, bit for bit."""
    grids = tick.grids
    return (
        [(s.artefact_id, s.label, s.ground_pose, s.arrival_ns) for s in tick.artefacts],
        [(p.artefact_id, p.sighting) for p in tick.perceived],
        tick.events,
        [(m.namespace, m.action, m.scale) for m in tick.markers.looks],
        tick.markers.ids.tolist(),
        grids.augmented_map and grids.augmented_map.cells.tobytes(),
        grids.costmap and grids.costmap.cells.tobytes(),
    )


def test_the_same_inputs_and_seed_give_the_same_bytes(run: Run, make_scene: Make) -> None:
    """Another builder in the same process, tick by tick and scan by scan."""
    again = Driver(make_scene(VALUES | RUNS[run.gate]), run.gate).drive(40)
    for moment, twin in zip(run.moments, again.moments, strict=False):
        assert told(moment.tick) == told(twin.tick)
    for one, other in zip(run.scans, again.scans, strict=False):
        assert one[1].released_ns == other[1].released_ns
        assert one[1].reading.ranges.tobytes() == other[1].reading.ranges.tobytes()


# --- the robot's own topics, and bad input


class Announced:
    """A writer that keeps the names of its topics."""

    def __init__(self) -> None:
        self.topics: list[str] = []

    def add_topic(self, topic: str, type_name: str, **_: object) -> None:
        """Keep the name."""
        assert type_name
        self.topics.append(topic)


@pytest.mark.parametrize("scans", [("/scan",), ("/front/scan", "/rear/scan")])
def test_nothing_is_written_on_a_topic_of_the_robot(scans: tuple[str, ...]) -> None:
    """All outputs have names of their own, below /ar_builder."""
    writer: Any = Announced()
    TickWriter(writer, dict.fromkeys(scans, "scan"), Parameters())
    assert len(writer.topics) == len(set(writer.topics))
    assert all(topic.startswith("/ar_builder/") for topic in writer.topics)


def map_message(cells: Any, resolution: float, frame_id: str = "map") -> Any:
    """Return a message like nav_msgs/OccupancyGrid, of four columns."""
    turn = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
    origin = SimpleNamespace(position=SimpleNamespace(x=0.0, y=0.0, z=0.0), orientation=turn)
    info = SimpleNamespace(resolution=resolution, width=4, height=len(cells) // 4, origin=origin)
    header = SimpleNamespace(frame_id=frame_id, stamp=SimpleNamespace(sec=1, nanosec=0))
    return SimpleNamespace(header=header, info=info, data=np.array(cells, dtype=np.int8))


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (map_message([0] * 16, -1.0), "resolution"),
        (map_message([0] * 17, 0.1), "17 cells"),
        (map_message([0] * 15 + [101], 0.1), "101"),
        (map_message([0] * 16, 0.1, "elsewhere"), "elsewhere"),
    ],
)
def test_bad_input_is_refused_and_counted_and_the_last_good_value_stays(
    make_scene: Make, bad: Any, reason: str
) -> None:
    """The sentence names topic and reason; the relay goes on; the next good map is taken."""
    scene, messages = make_scene(), [map_message([0] * 16, 0.1), bad, map_message([9] * 16, 0.1)]
    reader: Any = SimpleNamespace(deserialize=lambda message: messages[message.data[-1]])
    feed = Feed(reader, scene.builder, {"/real_map": "map"})
    values = []
    for index in range(3):
        message = BagMessage("/real_map", scene.ns(float(index)), bytes(12) + bytes([index]), None)
        feed.take(message, scene.ns(float(index)))
        tick = scene.tick(index + 0.5)
        assert scene.builder.world.grid.frame_id == "map"
        sent = tick.grids.augmented_map
        values.append(None if sent is None else int(sent.cells[0, 0]))
    assert values == [0, None, 9]
    assert feed.refusals.counts == {"/real_map": 1}
    assert feed.refusals.sentences["/real_map"].startswith("/real_map: ")
    assert reason in feed.refusals.sentences["/real_map"]


def test_a_bad_map_leaves_artefacts_and_grids_as_they_were(scene: Scene) -> None:
    """Whoever stands, stands; the grid of the next tick is as without it."""
    scene.place(0, (2.5, 2.0), 0.0)
    before = scene.tick(0.1)
    with pytest.raises(InputError):
        scene.builder.receive_map(scene.room((15, 25, 20, 30), frame_id="odom"), scene.ns(0.15))
    after = scene.tick(0.5)
    assert told(before)[0] == told(after)[0]
    assert after.grids.augmented_map is None
    assert EventKind.DISPLACED not in [event.kind for event in after.events]
