"""Checks of a small replay written by hand, right and broken on purpose in every way.

It has six ticks, two artefacts, one map, one robot and one laser.
"""

import copy
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.typing import NDArray

from are_ros.bag.types import jazzy_typestore
from are_ros.bag.writer import BagWriter
from are_ros.builder.costmap.inflation import InflatedCostmap
from are_ros.builder.costmap.registration import CellPatch, covered_cells, patch_changes
from are_ros.checks.grids import LatchedGrid, LatestGrid
from are_ros.checks.oracle.plane import distances_m
from are_ros.checks.result import CheckResult, Tally
from are_ros.checks.run import Outcome, check_recording
from are_ros.checks.sensors.depth_images import box_triangles
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError
from are_ros.messages.sensors import SENSORS, SensorKind
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import write_ros_parameters
from are_ros.replay.command import check_command
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.making import RosbagsFactory

MS = 1_000_000
START_NS = 1000 * NS_PER_S
TICKS_NS = tuple(START_NS + k * 100 * MS for k in range(6))
SIZE_M = (0.3, 0.2, 1.0)
Point3 = tuple[float, float, float]
PLACES = {1: (0.05, 0.0, 0.3), 2: (0.53, 0.41, 0.0)}
LIVES_NS = {
    1: (START_NS - 10 * MS, START_NS + 350 * MS),
    2: (START_NS + 150 * MS, START_NS + 90 * NS_PER_S),
}
SEEN: tuple[set[int], ...] = (set(), {1}, {1}, set(), {2}, {2})
ROBOT = (-0.6, -0.6)
SCAN_NS = START_NS + 220 * MS

OUT = "/ar_builder/"
TYPES = {
    "augmented_map": "nav_msgs/msg/OccupancyGrid",
    "artefact_map": "nav_msgs/msg/OccupancyGrid",
    "artefact_map_updates": "map_msgs/msg/OccupancyGridUpdate",
    "augmented_costmap": "nav_msgs/msg/OccupancyGrid",
    "augmented_map_updates": "map_msgs/msg/OccupancyGridUpdate",
    "artefacts": "are_msgs/msg/ArtefactArray",
    "perceived": "are_msgs/msg/PerceivedArtefactArray",
    "events": "are_msgs/msg/ArtefactEvent",
    "metrics": "are_msgs/msg/SceneMetrics",
    "markers": "visualization_msgs/msg/MarkerArray",
    "scan": "sensor_msgs/msg/LaserScan",
}
GRIDS = ("augmented_map", "artefact_map", "augmented_costmap")
INPUT_TYPES = {
    "/map": "nav_msgs/msg/OccupancyGrid",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/scan": "sensor_msgs/msg/LaserScan",
}
MAKE = RosbagsFactory().make


@dataclass(eq=False)
class Draft:
    """What is to be written: by topic the type, whether it is latched, and (log time, message)."""

    messages: dict[str, list[tuple[int, Any]]] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)
    latched: set[str] = field(default_factory=set)
    values: dict[str, Any] = field(default_factory=dict)

    def of(self, name: str) -> list[tuple[int, Any]]:
        """Return the messages of an output, by its name without the prefix."""
        return self.messages[OUT + name]

    def write(self, folder: Path) -> Path:
        """Write augmented.mcap, effective.yaml and what of metrics.json matters."""
        folder.mkdir(exist_ok=True)
        with BagWriter(folder / "augmented.mcap") as writer:
            for topic, type_name in self.types.items():
                is_latched = topic in self.latched
                writer.add_topic(topic, type_name, is_latched=is_latched, depth=1)
            stream = [
                (log_ns, topic, message)
                for topic, messages in self.messages.items()
                for log_ns, message in messages
            ]
            for log_ns, topic, message in stream:
                if isinstance(message, bytes):
                    writer.write_raw(topic, log_ns, message)
                else:
                    writer.write(topic, log_ns, message)
        parameters = with_values(Parameters(), self.values)
        (folder / "effective.yaml").write_text(write_ros_parameters(parameters))
        (folder / "metrics.json").write_text('{"walls": "map"}')
        return folder


def make_draft() -> Draft:
    """Return a replay in which everything is right."""
    draft = Draft()
    draft.types = INPUT_TYPES | {OUT + name: type_name for name, type_name in TYPES.items()}
    draft.latched = {"/map", "/tf_static", *(OUT + name for name in GRIDS)}
    draft.messages = {topic: [] for topic in draft.types}
    draft.values = {
        "robot.radius": 0.12,
        "costmap.inflation_radius": 0.35,
        "augmented_map.max_rate": 10.0,
        "camera.model": "pinhole",
    }
    real = real_cells()
    draft.messages["/map"].append((START_NS - 50 * MS, make_grid(real, START_NS)))
    _add_frames(draft)
    _add_scans(draft)
    _add_ticks(draft, real)
    return draft


def real_cells() -> NDArray[np.int8]:
    """Return the real map, 20 x 20 cells of 0.1 m from (-1, -1): walls about, some unknown."""
    cells = np.zeros((20, 20), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    cells[15:18, 3:6] = -1
    cells[4, 15] = 40
    return cells


def make_header(stamp_ns: int, frame_id: str = "map") -> Any:
    """Return a Header."""
    return MAKE("std_msgs/msg/Header", stamp=make_time(stamp_ns), frame_id=frame_id)


def make_time(stamp_ns: int) -> Any:
    """Return a Time."""
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    return MAKE("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)


def make_pose(x: float, y: float, z: float, yaw: float) -> Any:
    """Return a Pose."""
    turn = MAKE("geometry_msgs/msg/Quaternion", z=math.sin(0.5 * yaw), w=math.cos(0.5 * yaw))
    place = MAKE("geometry_msgs/msg/Point", x=x, y=y, z=z)
    return MAKE("geometry_msgs/msg/Pose", position=place, orientation=turn)


def make_grid(cells: NDArray[np.int8], stamp_ns: int) -> Any:
    """Return an OccupancyGrid."""
    info = MAKE(
        "nav_msgs/msg/MapMetaData",
        resolution=0.1,
        width=cells.shape[1],
        height=cells.shape[0],
        origin=make_pose(-1.0, -1.0, 0.0, 0.0),
    )
    data = cells.reshape(-1).copy()
    return MAKE("nav_msgs/msg/OccupancyGrid", header=make_header(stamp_ns), info=info, data=data)


def make_artefact(number: int) -> Any:
    """Return an Artefact at its place."""
    x, y, yaw = PLACES[number]
    arrival_ns, departure_ns = LIVES_NS[number]
    return MAKE(
        "are_msgs/msg/Artefact",
        id=number,
        label="crate",
        pose=make_pose(x, y, 0.4, yaw),
        ground_pose=make_pose(x, y, 0.0, yaw),
        box_centre=MAKE("geometry_msgs/msg/Point", z=0.1),
        size=MAKE("geometry_msgs/msg/Vector3", x=SIZE_M[0], y=SIZE_M[1], z=SIZE_M[2]),
        arrival=make_time(arrival_ns),
        departure=make_time(departure_ns),
    )


def make_event(kind: int, number: int, stamp_ns: int) -> Any:
    """Return an ArtefactEvent."""
    header = make_header(stamp_ns)
    return MAKE("are_msgs/msg/ArtefactEvent", header=header, kind=kind, id=number, label="crate")


def make_transforms(stamp_ns: int, edges: Iterable[tuple[str, str, float, float, float]]) -> Any:
    """Return a TFMessage of edges (parent, child, x, y, z)."""
    transforms = [
        MAKE(
            "geometry_msgs/msg/TransformStamped",
            header=make_header(stamp_ns, parent),
            child_frame_id=child,
            transform=MAKE(
                "geometry_msgs/msg/Transform",
                translation=MAKE("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
            ),
        )
        for parent, child, x, y, z in edges
    ]
    return MAKE("tf2_msgs/msg/TFMessage", transforms=transforms)


def make_marker(namespace: str, number: int, action: int = 0, kind: int = 1) -> Any:
    """Return a Marker that lives for 3 s; that of the labels is a text."""
    x, y, yaw = PLACES[number]
    kind = 9 if namespace == "label" else kind
    return MAKE(
        "visualization_msgs/msg/Marker",
        header=make_header(START_NS),
        ns=namespace,
        id=number,
        type=kind,
        action=action,
        pose=make_pose(x, y, 0.5, yaw),
        scale=MAKE("geometry_msgs/msg/Vector3", x=0.3, y=0.2, z=1.0),
        color=MAKE("std_msgs/msg/ColorRGBA", r=1.0, a=1.0),
        lifetime=MAKE("builtin_interfaces/msg/Duration", sec=3),
        text="crate" if kind == 9 else "",
    )


def make_scan(ranges: Iterable[float]) -> Any:
    """Return a LaserScan whose first beam looks at artefact 1 from the robot."""
    x, y, _ = PLACES[1]
    values = np.array([*ranges], np.float32)
    return MAKE(
        "sensor_msgs/msg/LaserScan",
        header=make_header(SCAN_NS, "laser"),
        angle_min=math.atan2(y - ROBOT[1], x - ROBOT[0]),
        angle_max=math.atan2(y - ROBOT[1], x - ROBOT[0]) + 3 * 1.5,
        angle_increment=1.5,
        range_min=0.1,
        range_max=10.0,
        ranges=values,
        intensities=np.full(len(values), 7.0, np.float32),
    )


def patches(ids: Iterable[int]) -> dict[int, CellPatch]:
    """Return the cells of artefacts at their places."""
    numbers = [*ids]
    places = np.array([PLACES[i] for i in numbers]).reshape(-1, 3)
    centres = np.column_stack((places[:, :2], np.full(len(numbers), 0.5)))
    half = np.tile(0.5 * np.array(SIZE_M), (len(numbers), 1))
    origin = RigidTransform.planar(-1.0, -1.0, 0.0)
    grid = OccupancyGrid(real_cells(), float(np.float32(0.1)), origin, "map")
    covers = covered_cells(OrientedBoxes(centres, places[:, 2], half), grid)
    return {number: covers.patch(k) for k, number in enumerate(numbers)}


def _add_frames(draft: Draft) -> None:
    static = make_transforms(START_NS, [("base_link", "laser", 0.0, 0.0, 0.3)])
    draft.messages["/tf_static"].append((START_NS - 90 * MS, static))
    for step in range(-4, 26):
        stamp_ns = START_NS + step * 20 * MS
        edges = [("map", "odom", 0.1, 0.0, 0.0), ("odom", "base_link", ROBOT[0] - 0.1, ROBOT[1], 0)]
        draft.messages["/tf"].append((stamp_ns + 5 * MS, make_transforms(stamp_ns, edges)))


def _add_scans(draft: Draft) -> None:
    distance = math.hypot(PLACES[1][0] - ROBOT[0], PLACES[1][1] - ROBOT[1])
    draft.messages["/scan"].append((SCAN_NS + MS, make_scan((3.0, 2.0, math.inf, 1.0))))
    augmented = make_scan((distance - 0.1, 2.0, math.inf, 1.0))
    augmented.intensities[0] = 0.0
    draft.of("scan").append((SCAN_NS + 5 * MS, augmented))
    without, seen = make_scan((math.inf, 2.0, math.inf, 1.0)), copy.deepcopy(augmented)
    for message in (without, seen):
        message.header.stamp = make_time(SCAN_NS + 20 * MS)
    draft.messages["/scan"].append((SCAN_NS + 21 * MS, without))
    draft.of("scan").append((SCAN_NS + 25 * MS, seen))


def _add_ticks(draft: Draft, real: NDArray[np.int8]) -> None:
    costmap = InflatedCostmap(0.35, 3.0, 0.12)
    costmap.set_map(real == 100, (real == -1) | (real == 40), float(np.float32(0.1)))
    last: dict[str, NDArray[np.int8]] = {}
    before: dict[int, CellPatch] = {}
    for tick, now_ns in enumerate(TICKS_NS):
        alive = [i for i, (since_ns, to_ns) in LIVES_NS.items() if since_ns <= now_ns < to_ns]
        admitted = patches(i for i in alive if i in SEEN[tick])
        costmap.update(patch_changes(before, admitted))
        before = admitted
        for name, base in (("augmented_map", real), ("artefact_map", np.zeros_like(real))):
            cells = base.copy()
            for patch in admitted.values():
                patch.part_of(cells)[patch.mask] = 100
            if name in last and np.array_equal(cells, last[name]):
                continue
            draft.of(name).append((now_ns, make_grid(cells, now_ns)))
            if name in last:
                update = _update(last[name], cells, now_ns)
                draft.of(f"{name}_updates").append((now_ns, update))
            if name == "augmented_map":
                costs = make_grid(costmap.published().copy(), now_ns)
                draft.of("augmented_costmap").append((now_ns, costs))
            last[name] = cells
        _add_lists(draft, tick, now_ns, alive)
    _add_markers(draft)
    for i, (arrival_ns, departure_ns) in LIVES_NS.items():
        _add_event(draft, 0, i, arrival_ns)
        _add_event(draft, 1, i, departure_ns)
    for kind, i, tick in ((4, 1, 1), (5, 1, 3), (4, 2, 4)):
        _add_event(draft, kind, i, TICKS_NS[tick])
    draft.of("events").sort(key=lambda entry: entry[0])


def _update(before: NDArray[np.int8], after: NDArray[np.int8], now_ns: int) -> Any:
    rows, cols = np.nonzero(before != after)
    part = after[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]
    return MAKE(
        "map_msgs/msg/OccupancyGridUpdate",
        header=make_header(now_ns),
        x=int(cols.min()),
        y=int(rows.min()),
        width=part.shape[1],
        height=part.shape[0],
        data=part.reshape(-1).copy(),
    )


def _add_lists(draft: Draft, tick: int, now_ns: int, alive: list[int]) -> None:
    artefacts = [make_artefact(i) for i in alive]
    array = MAKE("are_msgs/msg/ArtefactArray", header=make_header(now_ns), artefacts=artefacts)
    draft.of("artefacts").append((now_ns, array))
    seen = [_sighting(i, now_ns) for i in sorted(SEEN[tick])]
    kind = "are_msgs/msg/PerceivedArtefactArray"
    draft.of("perceived").append((now_ns, MAKE(kind, header=make_header(now_ns), artefacts=seen)))
    covered = np.zeros((20, 20), np.bool_)
    for patch in patches(alive).values():
        patch.part_of(covered)[patch.mask] = True
    real = real_cells()
    metrics = MAKE(
        "are_msgs/msg/SceneMetrics",
        header=make_header(now_ns),
        alive=len(alive),
        perceived=len(seen),
        arrivals=sum(since_ns <= now_ns for since_ns, _ in LIVES_NS.values()),
        departures=sum(to_ns <= now_ns for _, to_ns in LIVES_NS.values()),
        clutter_ratio=float(covered.sum() / ((real >= 0) & (real <= 25)).sum()),
        rho=math.nan,
    )
    draft.of("metrics").append((now_ns, metrics))


def _sighting(number: int, now_ns: int) -> Any:
    return MAKE(
        "are_msgs/msg/PerceivedArtefact",
        id=number,
        classes=["crate"],
        probabilities=np.ones(1, np.float32),
        visible_pixels=100,
        unoccluded_pixels=200,
        visible_fraction=0.5,
        range=1.0,
        existence=1.0,
        roi=MAKE("sensor_msgs/msg/RegionOfInterest", x_offset=10, y_offset=10, width=20, height=30),
        last_seen=make_time(now_ns),
    )


def _add_markers(draft: Draft) -> None:
    names = ("body", "label")
    shows: dict[int, list[Any]] = {
        0: [make_marker("", 1, action=3), *(make_marker(name, 1) for name in names)],
        2: [make_marker(name, 2) for name in names],
        4: [make_marker(name, 1, action=2) for name in names],
    }
    shows[0][1] = _mesh(1)
    for tick, markers in shows.items():
        array = MAKE("visualization_msgs/msg/MarkerArray", markers=markers)
        draft.of("markers").append((TICKS_NS[tick], array))


def _mesh(number: int) -> Any:
    marker = make_marker("body", number, kind=11)
    marker.points = [MAKE("geometry_msgs/msg/Point", x=float(i), y=float(i * i)) for i in range(3)]
    marker.colors = [MAKE("std_msgs/msg/ColorRGBA", g=0.5, a=1.0) for _ in range(3)]
    return marker


def _add_event(draft: Draft, kind: int, number: int, stamp_ns: int) -> None:
    due = [tick_ns for tick_ns in TICKS_NS if tick_ns >= stamp_ns]
    if due:
        draft.of("events").append((due[0], make_event(kind, number, stamp_ns)))


Break = Callable[[Draft], None]
MISSING = "rays that artefacts stop"


@pytest.fixture(scope="module")
def right() -> Draft:
    """Return a replay in which everything is right; not to be changed."""
    return make_draft()


def results_of(draft: Draft, folder: Path, map_file: Path | None = None) -> dict[str, CheckResult]:
    """Write a replay, check it, and return the results by name."""
    results = tuple(check_recording(draft.write(folder), map_file))
    return {result.name: result for result in results}


def test_a_right_replay_passes_every_check(right: Draft, tmp_path: Path) -> None:
    """Nothing fails or is skipped where all inputs are there, and each check looks at something."""
    results = tuple(check_recording(right.write(tmp_path)))
    assert [r.sentence() for r in results if r.outcome is not Outcome.PASSED] == []
    assert all(result.looked_at > 0 for result in results)
    assert len({result.name for result in results}) == len(results) == 30


def _drop(name: str, index: int) -> Break:
    return lambda draft: draft.of(name).__delitem__(index)


def _put(name: str, index: int, path: str, value: Any) -> Break:
    """Return what sets a field of one message; numbers in the path are indices."""

    def change(draft: Draft) -> None:
        *parents, last = path.split(".")
        target = (draft.messages[name] if name.startswith("/") else draft.of(name))[index][1]
        for part in parents:
            target = target[int(part)] if part.isdecimal() else getattr(target, part)
        if last.isdecimal():
            target[int(last)] = value
        else:
            setattr(target, last, value)

    return change


def _add_to_events(*entries: tuple[int, int, int]) -> Break:
    """Return what adds events (kind, id, tick), stamped at their tick."""

    def change(draft: Draft) -> None:
        for kind, number, tick in entries:
            event = make_event(kind, number, TICKS_NS[tick])
            draft.of("events").append((TICKS_NS[tick], event))
        draft.of("events").sort(key=lambda entry: entry[0])

    return change


def _move_artefact(number: int, x: float, y: float) -> Break:
    """Return what puts an artefact elsewhere, in its lists only."""

    def change(draft: Draft) -> None:
        for _, message in draft.of("artefacts"):
            for artefact in message.artefacts:
                if artefact.id == number:
                    for pose in (artefact.pose, artefact.ground_pose):
                        pose.position.x, pose.position.y = x, y

    return change


def _move_robot(draft: Draft) -> None:
    for _, message in draft.messages["/tf"]:
        message.transforms[1].transform.translation.x = -0.2
        message.transforms[1].transform.translation.y = 0.0


def _list_the_dead(draft: Draft) -> None:
    draft.of("artefacts")[4][1].artefacts.insert(0, make_artefact(1))


def _perceive_the_dead(draft: Draft) -> None:
    draft.of("perceived")[4][1].artefacts.insert(0, _sighting(1, TICKS_NS[4]))


def _swap_ids(draft: Draft) -> None:
    draft.of("artefacts")[2][1].artefacts.reverse()


def _delete_all_last(draft: Draft) -> None:
    markers = draft.of("markers")[0][1].markers
    markers.append(markers.pop(0))


def _show_twice(draft: Draft) -> None:
    markers = draft.of("markers")[0][1].markers
    markers.append(markers[1])


def _cut_an_event(draft: Draft) -> None:
    draft.of("events")[0] = (TICKS_NS[0], b"\0\1\0\0short")


def _cut_markers(draft: Draft) -> None:
    draft.of("markers")[0] = (TICKS_NS[0], b"\0\1\0\0\1\0\0\0")


def _go_back_in_time(draft: Draft) -> None:
    draft.messages["/tf_static"].append((START_NS - 95 * MS, draft.messages["/tf_static"][0][1]))


def _retype(draft: Draft) -> None:
    draft.types["/ar_builder/metrics"] = "std_msgs/msg/Header"
    draft.messages["/ar_builder/metrics"] = []


def _forget_topic(draft: Draft) -> None:
    del draft.types["/ar_builder/markers"], draft.messages["/ar_builder/markers"]


def _add_topic(draft: Draft) -> None:
    draft.types["/ar_builder/secret"] = "std_msgs/msg/Header"


def _shown_after_the_end(draft: Draft) -> None:
    """Show artefact 1 again at the last tick, after its departure."""
    array = MAKE("visualization_msgs/msg/MarkerArray", markers=[make_marker("label", 1)])
    draft.of("markers").append((TICKS_NS[5], array))


def _short_lives(draft: Draft) -> None:
    for marker in draft.of("markers")[2 - 1][1].markers:
        marker.lifetime.sec, marker.lifetime.nanosec = 0, 150 * MS


def _raise_cost(draft: Draft) -> None:
    data = draft.of("augmented_costmap")[1][1].data
    data[np.flatnonzero((data > 0) & (data < 98))[0]] += 1


def _lower_cost(draft: Draft) -> None:
    data = draft.of("augmented_costmap")[0][1].data
    data[np.flatnonzero(data == 99)[0]] = 98


def _forget_grids(draft: Draft) -> None:
    for name in (*GRIDS, "augmented_map_updates", "artefact_map_updates"):
        del draft.of(name)[1 if name.endswith("updates") else 2]


def _forget_grids_of_a_slow_node(draft: Draft) -> None:
    """Let the departure wait as if it were a move."""
    draft.values["augmented_map.max_rate"] = 1.0
    _forget_grids(draft)


def _again(name: str) -> Break:
    """Return what publishes a grid once more a tick later, before it may."""

    def change(draft: Draft) -> None:
        draft.values["augmented_map.max_rate"] = 5.0
        again = copy.deepcopy(draft.of(name)[1][1])
        again.header.stamp = make_time(TICKS_NS[2])
        draft.of(name).insert(2, (TICKS_NS[2], again))

    return change


def _unknown_artefacts(draft: Draft) -> None:
    """Leave open in the artefact map what is open in the real one."""
    for _, message in draft.of("artefact_map"):
        message.data[(real_cells().reshape(-1) < 0) & (message.data == 0)] = -1


def _scan_after_departure(draft: Draft) -> None:
    for topic in ("/scan", "/ar_builder/scan"):
        log_ns, message = draft.messages[topic][0]
        message.header.stamp = make_time(START_NS + 380 * MS)
        draft.messages[topic][0] = (log_ns + 160 * MS, message)


def _scan_before_first_sight(draft: Draft) -> None:
    """Let artefact 1 be one that arrived a moment before the scan, after the tick before it."""
    arrival_ns = SCAN_NS - 5 * MS
    for name, kept in (("artefacts", slice(3, None)), ("perceived", slice(3, None))):
        for index, (_, message) in enumerate(draft.of(name)):
            if index < 3:
                message.artefacts = [one for one in message.artefacts if one.id != 1]
        for _, message in draft.of(name)[kept]:
            for one in message.artefacts:
                if one.id == 1 and name == "artefacts":
                    one.arrival = make_time(arrival_ns)
    for k, (_, event) in enumerate(draft.of("events")):
        if event.kind == 0 and event.id == 1:
            event.header.stamp = make_time(arrival_ns)
            draft.of("events")[k] = (TICKS_NS[3], event)
    draft.of("events").sort(key=lambda entry: entry[0])


def _walk_away(draft: Draft) -> None:
    """Let artefact 1 be on its way at the tick before the scan: 5 cm in 20 ms."""
    for artefact in draft.of("artefacts")[2][1].artefacts:
        if artefact.id == 1:
            artefact.twist.linear.x = 2.5
            artefact.twist.linear.y = 2.5


def _too_close(beam: int) -> Break:
    """Return what makes artefact 1 nearer than the laser measures, in one beam."""

    def change(draft: Draft) -> None:
        distance = float(draft.of("scan")[0][1].ranges[0])
        for topic in ("/scan", "/ar_builder/scan"):
            draft.messages[topic][0][1].range_min = 0.9 if beam == 0 else 0.1
        ranges = draft.of("scan")[0][1].ranges
        ranges[0] = 3.0 if beam else distance
        draft.of("scan")[0][1].intensities[0] = 7.0 if beam else 0.0
        ranges[beam] = -math.inf

    return change


def _as_it_came(index: int, shape: str) -> Break:
    """Return what lets one scan go out as it came in, with artefact 1 in the way of a beam."""

    def change(draft: Draft) -> None:
        draft.values["sensors.shape"] = shape
        _show_box(draft)
        when, real = draft.messages["/scan"][index]
        draft.of("scan")[index] = (when + 4 * MS, copy.deepcopy(real))

    return change


def _show_box(draft: Draft) -> None:
    """Let the mesh of artefact 1 be that of its box, which is 0.4 m lower than its pose."""
    corners = box_triangles() * 0.5 * np.array(SIZE_M) + (0.0, 0.0, 0.1)
    marker = draft.of("markers")[0][1].markers[1]
    points = corners.reshape(-1, 3).tolist()
    marker.points = [MAKE("geometry_msgs/msg/Point", x=x, y=y, z=z) for x, y, z in points]
    marker.colors = [marker.colors[0]] * len(marker.points)


def _without_text(draft: Draft) -> None:
    draft.of("markers")[1][1].markers[1].text = " "


def _open_cell(draft: Draft) -> None:
    data, real = draft.of("augmented_map")[1][1].data, real_cells().reshape(-1)
    data[np.flatnonzero((data == 100) & (real == 0))[0]] = 0


BROKEN: dict[str, tuple[str, Break, str]] = {
    "cut event": ("rosbags reader", _cut_an_event, "/ar_builder/events at 1000.0"),
    "cut markers": ("rosbags reader", _cut_markers, "/ar_builder/markers"),
    "time goes back": ("log times", _go_back_in_time, "/tf_static goes back"),
    "wrong type": ("topics and types", _retype, "/ar_builder/metrics of type std_msgs"),
    "missing topic": ("topics and types", _forget_topic, "/ar_builder/markers"),
    "unknown topic": ("topics and types", _add_topic, "/ar_builder/secret"),
    "volatile map": (
        "quality of service",
        lambda draft: draft.latched.remove("/ar_builder/augmented_map"),
        "/ar_builder/augmented_map is offered as reliable, volatile",
    ),
    "latched events": (
        "quality of service",
        lambda draft: draft.latched.add("/ar_builder/events"),
        "/ar_builder/events",
    ),
    "no perceived": ("ticks", _drop("perceived", 3), "at 1000.300000000 s"),
    "wrong frame": ("ticks", _put("artefacts", 0, "header.frame_id", "odom"), "'odom'"),
    "frame of perceived": ("ticks", _put("perceived", 1, "header.frame_id", "odom"), "'odom'"),
    "wrong stamp": ("ticks", _put("metrics", 1, "header.stamp.nanosec", 5), "~/metrics"),
    "between the ticks": (
        "ticks",
        lambda draft: draft.values.update({"builder.tick_rate": 3.0}),
        "there is no tick",
    ),
    "ids descend": ("ticks", _swap_ids, "do not ascend: [2, 1]"),
    "above the ground": (
        "ticks",
        _put("artefacts", 1, "artefacts.0.ground_pose.position.z", -0.1),
        "artefact 1 does not stand on its ground pose",
    ),
    "not finite": (
        "ticks",
        _put("artefacts", 1, "artefacts.0.pose.position.x", math.nan),
        "artefact 1 has numbers that are not finite",
    ),
    "id reused": ("lives", _add_to_events((0, 1, 5)), "id 1 arrives again"),
    "departs twice": ("lives", _add_to_events((1, 1, 5)), "id 1 departs"),
    "event too late": ("lives", _put("events", 0, "header.stamp.sec", 2000), "at 2000."),
    "dead in the list": ("lives", _list_the_dead, "in the ids [1]"),
    "missing in the list": ("lives", _put("artefacts", 2, "artefacts", []), "in the ids [1, 2]"),
    "listed early": ("lives", _put("artefacts", 2, "artefacts.1.arrival.sec", 1001), "id 2"),
    "alive": ("metrics", _put("metrics", 2, "alive", 3), "alive is 3"),
    "blocked": ("metrics", _put("metrics", 5, "blocked", 1), "blocked is 1"),
    "blocked unsaid": ("metrics", _add_to_events((2, 0, 3)), "blocked is 0"),
    "contacts": ("metrics", _add_to_events((6, 2, 5)), "robot_contacts is 0"),
    "dead perceived": ("perceived", _perceive_the_dead, "id 1 is not alive"),
    "few pixels": (
        "perceived",
        _put("perceived", 1, "artefacts.0.visible_pixels", 50),
        "tau is 50",
    ),
    "region": ("perceived", _put("perceived", 1, "artefacts.0.roi.x_offset", 630), "630, 10"),
    "fraction": (
        "perceived",
        _put("perceived", 1, "artefacts.0.visible_fraction", 0.9),
        "fraction 0.89",
    ),
    "classes": ("perceived", _put("perceived", 1, "artefacts.0.classes", []), "probabilities"),
    "LOST unsaid": ("sight events", _drop("events", 3), "at 1000.300000000 s LOST"),
    "in the wall": ("walls", _move_artefact(2, 0.8, 0.41), "id 2 covers the occupied cell"),
    "one in the other": (
        "overlaps of artefacts",
        _move_artefact(2, 0.1, 0.05),
        "ids 1 and 2 overlap by",
    ),
    "in the robot": ("overlaps with the robot", _move_robot, "id 1 overlaps the robot"),
    "clutter": ("clutter ratio", _put("metrics", 2, "clutter_ratio", 0.5), "it is 0.5"),
    "four points": (
        "marker rules",
        lambda draft: draft.of("markers")[0][1].markers[1].points.pop(),
        "marker 1 of 'body' has 2 points",
    ),
    "colours": (
        "marker rules",
        lambda draft: draft.of("markers")[0][1].markers[1].colors.pop(),
        "2 colours for 3 points",
    ),
    "invisible": ("marker rules", _put("markers", 1, "markers.0.color.a", 0.0), "the colour"),
    "flat": ("marker rules", _put("markers", 1, "markers.0.scale.z", 0.0), "the scale"),
    "not turned": (
        "marker rules",
        _put("markers", 1, "markers.0.pose.orientation.w", 0.0),
        "no unit quaternion",
    ),
    "marker frame": (
        "marker rules",
        _put("markers", 1, "markers.0.header.frame_id", "odom"),
        "is in frame 'odom'",
    ),
    "no such action": ("marker rules", _put("markers", 1, "markers.0.action", 1), "the action 1"),
    "no such type": ("marker rules", _put("markers", 1, "markers.0.type", 44), "of type 44"),
    "no text": ("marker rules", _without_text, "has no text"),
    "marker twice": ("marker rules", _show_twice, "twice"),
    "DELETEALL late": ("marker rules", _delete_all_last, "is not the first"),
    "dead on display": ("markers of the living", _drop("markers", 2), "stale [1]"),
    "faded": ("markers of the living", _short_lives, "missing [2]"),
    "label of the unseen": (
        "markers of the living",
        _put("markers", 1, "markers.0.color.a", 0.35),
        "'label' is wrong: stale [2]",
    ),
    "label forgotten": (
        "markers of the living",
        lambda draft: draft.of("markers")[1][1].markers.pop(),
        "'label' is wrong: stale [], missing [2]",
    ),
    "byte outside": ("augmented map", _put("augmented_map", 1, "data.25", 1), "cell (1, 5) is 1"),
    "unstamped map": (
        "augmented map",
        _put("augmented_map", 1, "header.stamp.sec", 1),
        "another stamp",
    ),
    "hole inside": ("augmented map", _open_cell, "it must be 100"),
    "deleted unknown": (
        "marker rules",
        _put("markers", 2, "markers.0.id", 77),
        "marker 77 of 'body' is deleted, but was not there",
    ),
    "no frame": (
        "marker rules",
        _put("markers", 1, "markers.0.header.frame_id", ""),
        "names no frame",
    ),
    "endless marker": (
        "markers fade",
        _put("markers", 1, "markers.1.lifetime.sec", 0),
        "marker 2 of 'label' has a lifetime of 0 s",
    ),
    "long marker": (
        "markers fade",
        _put("markers", 1, "markers.1.lifetime.sec", 4),
        "a lifetime of 4 s",
    ),
    "outlives": ("markers fade", _shown_after_the_end, "its artefact departed at 1000.35"),
    "map moved": (
        "augmented map",
        _put("augmented_map", 1, "info.origin.position.x", -0.9),
        "geometry",
    ),
    "map is stale": ("augmented map is current", _forget_grids, "at 1000.300000000 s"),
    "costmap is stale": ("costmap is current", _forget_grids, "at 1000.300000000 s"),
    "artefact map is stale": ("artefact map is current", _forget_grids, "at 1000.300000000 s"),
    "departure waits": (
        "augmented map is current",
        _forget_grids_of_a_slow_node,
        "at 1000.300000000 s the last one still shows",
    ),
    "artefacts stay": (
        "artefact map is current",
        _forget_grids_of_a_slow_node,
        "at 1000.300000000 s the last one still shows",
    ),
    "costs stay": (
        "costmap is current",
        _forget_grids_of_a_slow_node,
        "at 1000.300000000 s the last one still shows",
    ),
    "too often": (
        "augmented map is current",
        _again("augmented_map"),
        "at 1000.200000000 s it goes out 0.1 s after the last one, though nobody came or went",
    ),
    "costs too often": ("costmap is current", _again("augmented_costmap"), "though nobody"),
    "artefact unknown": ("artefact map", _unknown_artefacts, "is -1, it must be 0"),
    "no artefact": ("artefact map", _put("artefact_map", 1, "data", np.zeros(400, np.int8)), "100"),
    "wrong artefact update": (
        "artefact map updates",
        _put("artefact_map_updates", 1, "data.0", 7),
        "cell",
    ),
    "wrong update": ("map updates", _put("augmented_map_updates", 1, "data.0", 7), "cell"),
    "update unsaid": ("map updates", _drop("augmented_map_updates", 1), "without an update"),
    "update too wide": ("map updates", _put("augmented_map_updates", 1, "x", 19), "beyond the map"),
    "low cost": ("costmap is never lower than the real map's", _lower_cost, "must be 99"),
    "other cost": ("costmap", _raise_cost, "it must be"),
    "longer beam": ("scans", _put("scan", 0, "ranges.1", 2.5), "2.5 m in beam 1"),
    "beam of nan": ("scans", _put("scan", 0, "ranges.1", math.nan), "nan m in beam 1"),
    "intensity": ("scans", _put("scan", 0, "intensities.2", 1.0), "intensity of beam 2"),
    "scan's range": ("scans", _put("scan", 0, "range_max", 9.0), "range_max"),
    "no input scan": ("scans", _put("/scan", 0, "header.stamp.sec", 1), "no scan of this stamp"),
    "beam at nothing": (
        "ends of changed beams",
        _put("scan", 0, "ranges.1", 1.5),
        "where no artefact is; 1 such",
    ),
    "hole in the air": (
        "ends of changed beams",
        _put("scan", 0, "ranges.0", 0.6),
        "where no artefact is",
    ),
    "beam behind a wall": (
        "walls before changed beams",
        _put("scan", 1, "ranges.2", 0.6),
        "behind what is occupied at (-0.9",
    ),
    "beam at the unseen": (
        "ends of changed beams",
        _scan_before_first_sight,
        "where no artefact is",
    ),
    "beam at yesterday": ("ends of changed beams", _walk_away, "where no artefact is"),
    "beam at the dead": ("ends of changed beams", _scan_after_departure, "where no artefact is"),
    "scan as it came": (MISSING, _as_it_came(0, "mesh"), "artefact 1 is in the way of 1 ray"),
    "as it came, box": (MISSING, _as_it_came(0, "box"), "artefact 1 is in the way of 1 ray"),
    "as it came, of no return": (MISSING, _as_it_came(1, "box"), "at 1000.240000000 s as it came"),
    "nothing too close": ("ends of changed beams", _too_close(1), "where no artefact is"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_is_broken_is_caught(case: str, right: Draft, tmp_path: Path) -> None:
    """The check whose business it is fails, with a counter-example that names the place."""
    name, break_it, text = BROKEN[case]
    draft = copy.deepcopy(right)
    break_it(draft)
    result = results_of(draft, tmp_path)[name]
    assert result.outcome is Outcome.FAILED, result.sentence()
    assert text in result.counter_example
    assert result.sentence().startswith(f"{name}: FAILED, {result.failures} wrong of")


def test_a_reported_contact_may_overlap_the_robot(right: Draft, tmp_path: Path) -> None:
    """From its ROBOT_CONTACT event on an artefact may overlap the robot, not before."""
    draft = copy.deepcopy(right)
    _move_robot(draft)
    _add_to_events((6, 1, 0))(draft)
    name = "overlaps with the robot"
    assert results_of(draft, tmp_path)[name].outcome is Outcome.PASSED
    draft = copy.deepcopy(right)
    _move_robot(draft)
    _add_to_events((6, 1, 2))(draft)
    result = results_of(draft, tmp_path)[name]
    assert result.failures == 2


def test_bodies_may_touch_between_two_sub_steps(right: Draft, tmp_path: Path) -> None:
    """By less than a centimetre, and at the instant of a sub-step not at all."""
    name, outcomes = "overlaps of artefacts", []
    for step_s, x_m in ((0.05, 0.37), (0.09, 0.37), (0.09, 0.353)):  # by 4 mm, 4 mm and 2 cm
        draft = copy.deepcopy(right)
        draft.values["motion.step"] = step_s
        _move_artefact(2, x_m, 0.045)(draft)
        outcomes.append(results_of(draft, tmp_path)[name].outcome)
    assert outcomes == [Outcome.FAILED, Outcome.PASSED, Outcome.FAILED]


def test_a_new_map_counts_from_the_next_sub_step_on(right: Draft, tmp_path: Path) -> None:
    """A tick between its arrival and that sub-step shows the old one."""
    for step_s, outcome in ((0.05, Outcome.FAILED), (0.09, Outcome.PASSED)):
        draft = copy.deepcopy(right)
        draft.values["motion.step"] = step_s
        other = copy.deepcopy(draft.messages["/map"][0][1])
        other.data[other.data == 0] = 50
        draft.messages["/map"].append((TICKS_NS[5] - 20 * MS, other))
        assert results_of(draft, tmp_path)["augmented map is current"].outcome is outcome, step_s


def test_who_comes_and_goes_waits_for_no_rate(right: Draft, tmp_path: Path) -> None:
    """The rate is that of moves: grids of successive ticks are right if somebody came or went."""
    draft = copy.deepcopy(right)
    draft.values["augmented_map.max_rate"] = 1.0
    results = results_of(draft, tmp_path)
    assert [r.sentence() for r in results.values() if r.outcome is Outcome.FAILED] == []


def test_an_artefact_between_two_ticks_is_where_its_twist_takes_it(
    right: Draft, tmp_path: Path
) -> None:
    """Until the next sub-step exactly, then on the line to where the next tick has it."""
    for stamp_ns, twist_mps in ((220, 2.0), (240, 2.0), (275, 1.0)):
        draft = copy.deepcopy(right)
        went_m = twist_mps * min(stamp_ns - 200, 50) / 1000.0
        left = 0.0 if stamp_ns < 250 else (stamp_ns - 250) / 50
        ahead_m = went_m * (1.0 - left)  # it is back at the next tick
        for topic in ("/scan", "/ar_builder/scan"):
            log_ns, message = draft.messages[topic][0]
            message.header.stamp = make_time(START_NS + stamp_ns * MS)
            draft.messages[topic] = [(log_ns + 80 * MS, message)]
        (one,) = [a for a in draft.of("artefacts")[2][1].artefacts if a.id == 1]
        x, y, yaw = PLACES[1]
        toward = math.atan2(y - ROBOT[1], x - ROBOT[0])
        one.twist.linear.x = twist_mps * math.cos(toward - yaw)
        one.twist.linear.y = twist_mps * math.sin(toward - yaw)
        ranges = draft.of("scan")[0][1].ranges
        distance = float(ranges[0])
        for off_m, outcome in ((0.0, Outcome.PASSED), (-0.1, Outcome.FAILED)):
            ranges[0] = distance + ahead_m + off_m
            ends = results_of(draft, tmp_path)["ends of changed beams"]
            assert ends.outcome is outcome, (stamp_ns, ends.sentence())


def test_an_artefact_that_jumped_between_two_ticks_is_as_far_as_the_events_say(
    right: Draft, tmp_path: Path
) -> None:
    """Put aside by 0.2 m and back again: a beam ends 0.15 m from where both ticks show it.

    A scan of the very sub-step in which it is put aside shows it there, too; one before does not.
    """
    ranges = right.of("scan")[0][1].ranges
    for stamp_ms, expected in ((275, Outcome.PASSED), (250, Outcome.PASSED), (249, Outcome.FAILED)):
        draft = copy.deepcopy(right)
        for topic in ("/scan", "/ar_builder/scan"):
            log_ns, message = draft.messages[topic][0]
            message.header.stamp = make_time(START_NS + stamp_ms * MS)
            draft.messages[topic] = [(log_ns + 80 * MS, message)]
        draft.of("scan")[0][1].ranges[0] = float(ranges[0]) - 0.15
        outcomes = []
        for value_m in (0.05, 0.2):
            jumps = [make_event(3, 1, START_NS + at_ms * MS) for at_ms in (250, 300)]
            for jump in jumps:
                jump.value = value_m
            told = copy.deepcopy(draft)
            told.of("events").extend((START_NS + 300 * MS, jump) for jump in jumps)
            told.of("events").sort(key=lambda entry: entry[0])
            outcomes.append(results_of(told, tmp_path)["ends of changed beams"].outcome)
        assert outcomes == [Outcome.FAILED, expected], stamp_ms


def test_an_artefact_may_be_too_close_to_measure(right: Draft, tmp_path: Path) -> None:
    """A beam may become -inf where an artefact is nearer than range_min."""
    draft = copy.deepcopy(right)
    _too_close(0)(draft)
    results = results_of(draft, tmp_path)
    assert results["scans"].outcome is Outcome.PASSED, results["scans"].sentence()
    ends = results["ends of changed beams"]
    assert ends.outcome is Outcome.PASSED, ends.sentence()


def _with_sonar(
    draft: Draft, range_m: float, real_m: float = math.inf, source: str = "/range"
) -> Draft:
    """Add a reading of a sonar at the laser's place, whose axis passes artefact 1 by 0.15 rad."""
    x, y, _ = PLACES[1]
    toward = math.atan2(y - ROBOT[1], x - ROBOT[0])
    static = make_transforms(START_NS, [("laser", "sonar", 0.0, 0.0, 0.0)])
    turn = static.transforms[0].transform.rotation
    turn.z, turn.w = math.sin(0.5 * (toward - 0.15)), math.cos(0.5 * (toward - 0.15))
    draft.messages["/tf_static"].append((START_NS - 80 * MS, static))
    for topic, value_m, late_ns in ((source, real_m, MS), (OUT + "range", range_m, 5 * MS)):
        message = MAKE(
            "sensor_msgs/msg/Range",
            header=make_header(SCAN_NS, "sonar"),
            field_of_view=0.5,
            min_range=0.1,
            max_range=10.0,
            range=value_m,
        )
        draft.types[topic] = "sensor_msgs/msg/Range"
        draft.messages[topic] = [(SCAN_NS + late_ns, message)]
    return draft


def test_a_range_is_judged_like_a_beam(right: Draft, tmp_path: Path) -> None:
    """It ends at an artefact anywhere in its cone, and only gets shorter."""
    x, y, yaw = PLACES[1]
    start_m, centre_m = np.array((*ROBOT, 0.3)), np.array((x, y, 0.5))
    near_m = float(distances_m(start_m[None], centre_m, yaw, 0.5 * np.array(SIZE_M))[0])
    for range_m, real_m, wrong in (
        (near_m, math.inf, ""),
        (near_m, near_m + 1.0, ""),
        (near_m - 0.1, math.inf, "ends of changed beams"),
        (near_m + 0.5, math.inf, "ends of changed beams"),
        (near_m, near_m - 0.1, "scans"),
        (near_m, 0.0, ""),
        (near_m, 0.05, "scans"),
    ):
        draft = _with_sonar(copy.deepcopy(right), range_m, real_m)
        results = results_of(draft, tmp_path)
        assert results["scans"].looked_at == 3
        failed = {name for name, result in results.items() if result.outcome is Outcome.FAILED}
        assert failed == ({wrong} if wrong else set()), (range_m, failed)
    del draft.messages["/range"], draft.types["/range"]
    told = results_of(draft, tmp_path)["scans"].sentence()
    assert "/ar_builder/range" in told
    assert "has no scan of this stamp that came in" in told


def test_a_range_beside_a_scan_may_come_from_any_topic(right: Draft, tmp_path: Path) -> None:
    """The only sonar is the input of the only augmented range, though a laser is there, too."""
    for source in ("/range", "/sonar"):
        results = results_of(_with_sonar(copy.deepcopy(right), 5.0, 5.0, source), tmp_path)
        assert results["scans"].outcome is Outcome.PASSED, results["scans"].sentence()
        told = results["scans"].sentence()
        assert " readings (" in told
        assert "1 range among them" in told


def test_the_other_numbers_of_a_range_stay(right: Draft, tmp_path: Path) -> None:
    """Each of them is its input's, also if the range is."""
    for name in ("radiation_type", "field_of_view", "min_range", "max_range", "variance"):
        draft = _with_sonar(copy.deepcopy(right), 5.0, 5.0)
        setattr(draft.messages[OUT + "range"][0][1], name, 1)
        result = results_of(draft, tmp_path)["scans"]
        assert result.outcome is Outcome.FAILED
        assert (
            f"/ar_builder/range at 1000.220000000 s has {name} 1.0, its input" in result.sentence()
        )


@pytest.mark.parametrize("kind", SENSORS.values(), ids=SENSORS)
def test_every_kind_of_sensor_is_judged(kind: SensorKind, right: Draft, tmp_path: Path) -> None:
    """A reading that was made of no input is found, whatever kind it is of."""
    draft = copy.deepcopy(right)
    source = f"/front/{kind.role}"
    topic = OUT + source[1:]
    for name, stamp_ns in ((source, SCAN_NS - 50 * MS), (topic, SCAN_NS)):
        reading = kind.miniature("laser", stamp_ns)
        message = jazzy_typestore().deserialize_cdr(kind.encode(reading), kind.type_name)
        draft.types[name], draft.messages[name] = kind.type_name, [(SCAN_NS + 5 * MS, message)]
    results = results_of(draft, tmp_path).values()
    failed = [r.sentence() for r in results if r.outcome is Outcome.FAILED]
    assert [sentence for sentence in failed if topic in sentence and "that came in" in sentence]


def _with_cloud(draft: Draft, real_m: list[Point3], ours_m: list[Point3], ring: int = 4) -> Draft:
    """Add a cloud of the laser, its points before and after; the last one after has this ring."""
    for topic, points_m, late_ns in (("/lidar", real_m, MS), (OUT + "points", ours_m, 5 * MS)):
        rows = np.zeros(len(points_m), [("xyz", "<f4", 3), ("ring", "<u2"), ("intensity", "<f4")])
        rows["xyz"], rows["ring"], rows["intensity"] = points_m, 4, 9.0
        if topic != "/lidar":
            rows["ring"][-1], rows["intensity"][-1] = ring, 0.0
        layout = (("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("ring", 12, 4), ("intensity", 14, 7))
        message = MAKE(
            "sensor_msgs/msg/PointCloud2",
            header=make_header(SCAN_NS, "laser"),
            height=1,
            width=len(rows),
            fields=[
                MAKE("sensor_msgs/msg/PointField", name=name, offset=at, datatype=kind, count=1)
                for name, at, kind in layout
            ],
            point_step=18,
            row_step=18 * len(rows),
            data=rows.view(np.uint8).reshape(-1),
        )
        draft.types[topic] = "sensor_msgs/msg/PointCloud2"
        draft.messages[topic] = [(SCAN_NS + late_ns, message)]
    return draft


def test_a_cloud_is_judged_point_by_point(right: Draft, tmp_path: Path) -> None:
    """Points come nearer on their rays, to an artefact, and keep the rest."""
    x, y, yaw = PLACES[1]
    start_m, centre_m = np.array((*ROBOT, 0.3)), np.array((x, y, 0.5))
    near_m = float(distances_m(start_m[None], centre_m, yaw, 0.5 * np.array(SIZE_M))[0])
    toward = math.atan2(y - ROBOT[1], x - ROBOT[0])

    def at(far_m: float, off: float = 0.0) -> Point3:
        return far_m * math.cos(toward + off), far_m * math.sin(toward + off), 0.0

    far, hit = at(near_m + 1.0), at(near_m + 0.05)
    for real_m, ours_m, ring, wrong in (
        ([far], [hit], 4, ""),
        ([far], [far, hit], 4, ""),
        ([far], [at(near_m - 0.3)], 4, "ends of changed beams"),
        ([far], [far, at(near_m + 0.5)], 4, "ends of changed beams"),
        ([far], [at(near_m + 0.05, 0.01)], 4, "scans"),
        ([hit], [far], 4, "scans"),
        ([far], [hit], 5, "scans"),
        ([far, far], [hit], 4, "scans"),
    ):
        draft = _with_cloud(copy.deepcopy(right), real_m, ours_m, ring)
        results = results_of(draft, tmp_path)
        assert results["scans"].looked_at == 3
        failed = {name: r.sentence() for name, r in results.items() if r.outcome is Outcome.FAILED}
        assert set(failed) == ({wrong} if wrong else set()), (ours_m, failed)


def test_a_cloud_that_went_out_as_it_came_is_caught(right: Draft, tmp_path: Path) -> None:
    """A point behind an artefact, not one before it, nor one that nothing is in front of."""
    x, y, _ = PLACES[1]
    toward, apart_m = math.atan2(y - ROBOT[1], x - ROBOT[0]), math.hypot(x - ROBOT[0], y - ROBOT[1])
    for far_m, off, wrong in ((3.0, 0.0, True), (apart_m - 0.2, 0.0, False), (3.0, 0.5, False)):
        point = far_m * math.cos(toward + off), far_m * math.sin(toward + off), 0.0
        draft = copy.deepcopy(right)
        _show_box(draft)
        _with_cloud(draft, [point, (math.nan,) * 3], [point, (math.nan,) * 3])
        draft.messages[OUT + "points"][0][1].data = draft.messages["/lidar"][0][1].data
        result = results_of(draft, tmp_path)[MISSING]
        assert result.looked_at == 3
        assert (result.outcome is Outcome.FAILED) == wrong, result.sentence()
        assert result.counter_example.startswith("/ar_builder/points" if wrong else "")


def test_a_beam_that_no_artefact_has_to_stop_may_stay(right: Draft, tmp_path: Path) -> None:
    """Past the triangles in its box, to what is nearer, to a wall, or said to be too close."""

    def at_all(shape: str, value: float) -> Draft:
        draft = copy.deepcopy(right)
        for topic in ("/scan", "/ar_builder/scan"):
            draft.messages[topic][0][1].ranges[0] = value
        _as_it_came(0, shape)(draft)
        return draft

    def results(draft: Draft) -> CheckResult:
        return results_of(draft, tmp_path)[MISSING]

    assert results(at_all("box", 3.0)).outcome is Outcome.FAILED
    assert results(at_all("box", 0.6)).outcome is Outcome.PASSED
    assert results(at_all("box", -math.inf)).outcome is Outcome.PASSED
    hollow, hidden, unseen = (at_all("mesh", math.inf) for _ in range(3))
    points = hollow.of("markers")[0][1].markers[1].points
    for point in points:
        point.z = min(point.z, -0.2)
    assert results(hollow).outcome is Outcome.PASSED
    for _, message in hidden.messages["/map"]:
        message.data.reshape(20, 20)[7, 7] = 100
    assert results(hidden).outcome is Outcome.PASSED
    unseen.values["sensors.gate"] = "perceived"
    assert results(unseen).outcome is Outcome.SKIPPED


def test_memory_and_gate_decide_what_the_map_shows(right: Draft, tmp_path: Path) -> None:
    """The same maps are wrong where the parameters admit more artefacts."""
    for values in ({"costmap.gate": "all"}, {"costmap.memory": 0.2}):
        draft = copy.deepcopy(right)
        draft.values |= values
        results = results_of(draft, tmp_path)
        assert results["augmented map"].outcome is Outcome.FAILED
        assert results["costmap"].outcome is Outcome.FAILED


def test_of_several_camera_infos_any_may_be_the_cameras(right: Draft, tmp_path: Path) -> None:
    """A region is in the image of one of them, whichever comes last; else it is wrong."""
    type_name = "sensor_msgs/msg/CameraInfo"
    for larger, outcome in ((640, Outcome.PASSED), (20, Outcome.FAILED)):
        draft = copy.deepcopy(right)
        draft.values["camera.model"] = "auto"
        for k, width in enumerate((larger, 16, 8)):
            info = MAKE(type_name, width=width, height=width)
            draft.types[f"/c{k}/camera_info"] = type_name
            draft.messages[f"/c{k}/camera_info"] = [(START_NS - 40 * MS + k, info)]
        assert results_of(draft, tmp_path)["perceived"].outcome is outcome


@pytest.mark.parametrize("role", ["images", "depths"])
def test_an_image_of_16_bits_is_one_of_depths_unless_it_is_given_as_colours(
    right: Draft, tmp_path: Path, role: str
) -> None:
    """A thermal camera's passes through; depths of 5 m behind an artefact may not."""
    draft = copy.deepcopy(right)
    draft.values |= {f"sensors.{role}": ["/thermal/image_rect"], "sensors.shape": "box"}
    header, p = make_header(SCAN_NS, "laser"), (10.0, 0, 15.5, 0, 0, 10.0, 11.5, 0, 0, 0, 1.0, 0)
    info = MAKE(
        "sensor_msgs/msg/CameraInfo",
        header=header,
        width=32,
        height=24,
        distortion_model="plumb_bob",
        p=np.array(p),
        r=np.array((0, -1.0, 0, 0, 0, -1.0, 1.0, 0, 0)),
    )
    image = MAKE(
        "sensor_msgs/msg/Image",
        header=header,
        width=32,
        height=24,
        encoding="mono16",
        step=64,
        data=np.full(32 * 24, 5000, "<u2").view(np.uint8),
    )
    out = OUT + ("camera" if role == "images" else "depth")
    for k, topic in enumerate(("/thermal/camera_info", f"{out}/camera_info")):
        draft.types[topic] = "sensor_msgs/msg/CameraInfo"
        draft.messages[topic] = [(SCAN_NS + (1 + 4 * k) * MS, info)]
    for k, topic in enumerate(("/thermal/image_rect", f"{out}/image")):
        draft.types[topic] = "sensor_msgs/msg/Image"
        draft.messages[topic] = [(SCAN_NS + (1 + 4 * k) * MS + 1, image)]
    result = results_of(draft, tmp_path).get("depth images computed anew")
    is_failed = result is not None and result.outcome is Outcome.FAILED
    assert is_failed == (role == "depths")


def test_the_memory_begins_with_the_last_look(right: Draft, tmp_path: Path) -> None:
    """With a camera slower than the ticks that is before the tick that still tells of it."""
    draft = copy.deepcopy(right)
    draft.values["costmap.memory"] = 0.15
    draft.of("perceived")[2][1].artefacts[0].last_seen = make_time(TICKS_NS[1])
    results = results_of(draft, tmp_path)
    assert [r.sentence() for r in results.values() if r.outcome is Outcome.FAILED] == []


def test_a_damaged_file_is_a_result(right: Draft, tmp_path: Path) -> None:
    """A flipped byte or a missing end fails both readers, and raises nothing."""
    path = right.write(tmp_path) / "augmented.mcap"
    whole = path.read_bytes()
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    damaged = [b"", whole[: len(whole) // 2]]
    chunk = summary.chunk_indexes[0]
    for place in (chunk.chunk_start_offset + chunk.chunk_length // 2, len(whole) - 200):
        flipped = bytearray(whole)
        flipped[place] ^= 0x01
        damaged.append(bytes(flipped))
    for data in damaged:
        path.write_bytes(data)
        results = {result.name: result for result in check_recording(tmp_path)}
        assert results["mcap reader"].outcome is Outcome.FAILED
        assert "skipped" not in results["mcap reader"].sentence()


def test_what_is_wrong_with_an_input_is_no_fault_of_the_results(
    right: Draft, tmp_path: Path
) -> None:
    """A cut scan and a map without cells were refused: they are left out, and all else passes."""
    draft = copy.deepcopy(right)
    draft.messages["/scan"].append((START_NS + 5 * MS, b"\x00\x01\x00\x00\x01"))
    empty = make_grid(np.zeros((1, 1), np.int8), START_NS)
    empty.info.width, empty.info.height = 0, 0
    empty.data = np.zeros(0, np.int8)
    draft.messages["/map"].append((START_NS + 100 * MS, empty))
    for name in ("/scan", "/map"):
        draft.messages[name].sort(key=lambda pair: pair[0])
    results = results_of(draft, tmp_path)
    assert [one.sentence() for one in results.values() if one.outcome is Outcome.FAILED] == []
    left_out = "not looked at: 2 messages of the inputs that cannot be read"
    assert left_out in results["rosbags reader"].sentence()
    draft.messages[OUT + "scan"].append((START_NS + 60_000 * MS, b"\x00\x01\x00\x00\x01"))
    assert results_of(draft, tmp_path)["rosbags reader"].outcome is Outcome.FAILED


def test_what_cannot_be_checked_is_skipped_with_the_reason(right: Draft, tmp_path: Path) -> None:
    """Without inputs robot, scans and grids are skipped; without parameters what needs them."""
    draft = copy.deepcopy(right)
    for topic in INPUT_TYPES:
        del draft.types[topic], draft.messages[topic]
    results = results_of(draft, tmp_path)
    skipped = {name for name, result in results.items() if result.outcome is Outcome.SKIPPED}
    assert {"overlaps with the robot", "scans", "costmap", "augmented map", "walls"} <= skipped
    assert skipped == {name for name, result in results.items() if result.needs_inputs}
    said: list[str] = []
    assert check_command(said.append, tmp_path, None, None)
    assert said[-1].startswith(f"{len(skipped)} skipped checks need the inputs")
    no_map = "the recording holds no real map, and no map file was given"
    for name in ("walls", "clutter ratio", "augmented map", "costmap", "costmap is current"):
        assert results[name].reason == no_map
    assert all(r.outcome is not Outcome.FAILED for r in results.values())
    (tmp_path / "effective.yaml").unlink()
    results = {result.name: result for result in check_recording(tmp_path)}
    assert "nothing tells its parameters" in results["perceived"].sentence()
    assert not results["walls"].needs_inputs  # they alone would not do
    whole: list[str] = []
    folder = right.write(tmp_path / "whole")
    assert check_command(whole.append, folder, None, None)
    assert ": passed" in whole[-1]


def test_the_real_map_may_come_from_a_file(right: Draft, tmp_path: Path) -> None:
    """A map file stands in for the map of the recording, and another map does not fit."""
    draft = copy.deepcopy(right)
    for _, message in draft.messages["/map"]:
        message.data[:] = 0
    real = real_cells()
    values = np.select([real == 100, real == 0], [0, 254], 205).astype(np.uint8)
    (tmp_path / "map.pgm").write_bytes(b"P5 20 20 255\n" + np.flipud(values).tobytes())
    text = "image: map.pgm\nresolution: 0.1\norigin: [-1.0, -1.0, 0.0]\nnegate: 0\n"
    text += "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    (tmp_path / "map.yaml").write_text(text)
    results = results_of(draft, tmp_path / "out")
    assert results["augmented map"].outcome is Outcome.FAILED
    results = results_of(draft, tmp_path / "out", tmp_path / "map.yaml")
    assert results["augmented map"].counter_example.startswith("at 1000.000000000 s cell (4, 15)")
    assert results["augmented map"].failures == 4  # the one cell that no map file can hold
    assert results["walls"].outcome is Outcome.PASSED


def test_without_a_recording_there_is_an_error(tmp_path: Path) -> None:
    """A folder without augmented.mcap is refused."""
    with pytest.raises(BagError, match=r"there is no augmented\.mcap"):
        tuple(check_recording(tmp_path))


def test_a_lag_before_and_after_another_map_is_not_one_long_lag() -> None:
    """What the grid ought to show is open while another map comes: the lag begins anew."""
    real: Any = object()
    judge: Any = SimpleNamespace(shows=lambda *_: False)

    def failures_of(known: Iterable[tuple[int, bool]]) -> int:
        tally = Tally("augmented map is current", "tick")
        grid = LatchedGrid(OUT + "augmented_map", tally, Parameters(), judge)
        for at_ns, is_known in known:
            scene = SimpleNamespace(stamp_ns=START_NS + at_ns)
            known_map = real if is_known else None
            tick: Any = SimpleNamespace(is_sure=True, covers=[], scene=scene, real=known_map)
            grid.take(tick, LatestGrid(real, is_new=False, is_sent=False))
        return tally.failures

    changes = [(0, True), *((k * 100 * MS, False) for k in range(1, 22)), (2200 * MS, True)]
    assert failures_of(changes) == 0
    assert failures_of([(at_ns, True) for at_ns, _ in changes]) > 0
