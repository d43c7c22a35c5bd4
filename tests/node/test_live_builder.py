"""The live builder without DDS: what it stores, relays, runs and skips, by the clock it is told."""

from collections.abc import Callable, Collection, Container, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.ros import NOT_SET_UP

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from rclpy.serialization import deserialize_message, serialize_message

from are_ros.agents.events import EventKind
from are_ros.builder.assembly import catalogue_of
from are_ros.builder.sensors.sensor_path import SensorPathCounts
from are_ros.builder.spawning.requests import SpawnRequest
from are_ros.messages.tick_encoding import ALL_OUTPUTS, OCTOMAP, OUTPUTS
from are_ros.node.live_builder import LiveBuilder
from are_ros.node.message_classes import message_class
from are_ros.node.qos import INPUTS
from are_ros.node.topics import WireDecoding, WireMessage
from are_ros.node.watches import CallbackTimer
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.world.rigid_transform import RigidTransform
from bags.simulation.making import make_cloud, make_header
from tests.node.live_bench import DELETE_ALL
from tests.node.live_scene import (
    FACTORY,
    QUIET,
    camera_info,
    click_at,
    laser_mount,
    ns,
    path_to,
    robot_at,
    room,
    scan,
)

ROLES = ("map", "octomap_point_cloud_centers", "odom", "scan", "tf", "tf_static", "plan")
MAP = "augmented_map"


class OutputSink:
    """Takes what goes out, of the outputs that are wanted; latched ones are."""

    def __init__(self) -> None:
        self.names: set[str] = set(OUTPUTS)
        self.sent: list[tuple[str, bytes]] = []

    def wanted(self) -> Collection[str]:
        """Return the names of the outputs that somebody listens to."""
        latched = {name for name, output in OUTPUTS.items() if output.is_latched}
        return self.names | latched

    def publish(self, name: str, data: bytes) -> None:
        """Take a message."""
        self.sent.append((name, data))

    def take(self, name: str) -> list[Any]:
        """Return the messages of an output, and forget them."""
        kind = message_class(
            "sensor_msgs/msg/LaserScan" if name == "scan" else ALL_OUTPUTS[name][0]
        )
        found = [deserialize_message(data, kind) for sent, data in self.sent if sent == name]
        self.sent = [entry for entry in self.sent if entry[0] != name]
        return found

    def take_names(self) -> list[str]:
        """Return what was sent, in its order, and forget it."""
        names, self.sent = [name for name, _ in self.sent], []
        return names


class Inbox:
    """What DDS holds, by role, and which clock the node has."""

    def __init__(self) -> None:
        self.held: list[tuple[str, Any]] = []
        self.is_simulated = True

    def waiting(self, roles: Container[str]) -> Iterator[WireMessage]:
        """Give out what is held of some roles."""
        taken = [entry for entry in self.held if entry[0] in roles]
        self.held = [entry for entry in self.held if entry[0] not in roles]
        for role, message in taken:
            type_name = INPUTS[role].type_name
            yield WireMessage(f"/{role}", type_name, serialize_message(message))

    def is_time_simulated(self) -> bool:
        """Tell whether the time is that of /clock."""
        return self.is_simulated


class Rig:
    """A live builder, what it gave out, and what it refused; times in seconds."""

    def __init__(self, parameters: Parameters) -> None:
        self.outlet = OutputSink()
        self.inbox = Inbox()
        self.refused: list[tuple[str, str]] = []
        roles = {f"/{role}": role for role in (*ROLES, "camera/camera_info", "clicked_point")}
        roles["/camera/depth"] = "depth"
        self.live = LiveBuilder(
            parameters,
            catalogue_of(parameters),
            WireDecoding(),
            roles,
            self.inbox,
            self.outlet,
            lambda *refusal: self.refused.append(refusal),
        )

    def store(self, role: str, message: Any, t_s: float) -> bool:
        """Store an input, a message or its bytes, as received at a time."""
        data = message if isinstance(message, bytes) else serialize_message(message)
        kind = INPUTS["depth" if role == "camera/depth" else role].type_name
        return self.live.store(WireMessage(f"/{role}", kind, data), ns(t_s))

    def work(self, t_s: float) -> None:
        """Tell the time."""
        self.live.work(ns(t_s))

    def place(self, x: float, y: float, t_s: float) -> int:
        """Place a post."""
        request = SpawnRequest("map", RigidTransform.planar(x, y, 0.0), "post")
        return self.live.requests.spawn(request, ns(t_s))

    def stamps(self, name: str = "metrics") -> list[int]:
        """Return the stamps of an output [ms], and forget its messages."""
        stamps = [message.header.stamp for message in self.outlet.take(name)]
        return [stamp.sec * 1000 + stamp.nanosec // 1_000_000 for stamp in stamps]


MakeRig = Callable[..., Rig]


@pytest.fixture
def make_rig(
    ros_available: None,  # noqa: ARG001 - it imports quietly
    catalogue_file: Path,
) -> MakeRig:
    """Return what makes a rig with parameters of its own."""

    def make(**values: Any) -> Rig:
        own = {path.replace("__", "."): value for path, value in values.items()}
        quiet = {path: tuple(v) if isinstance(v, list) else v for path, v in QUIET.items()}
        every = {**quiet, "catalogue": str(catalogue_file), **own}
        return Rig(with_values(Parameters(), every))

    return make


@pytest.fixture
def rig(make_rig: MakeRig) -> Iterator[Rig]:
    """Return a rig that runs since 10 s, with a map and a robot; nothing is refused in the end.

    Scans wait for 0.05 s.
    """
    made = make_rig(costmap__gate="all", sensors__tf_wait=0.05)
    made.live.resume(ns(10.0))
    made.store("map", room(), 10.0)
    made.store("tf", robot_at(10.0), 10.0)
    made.work(10.05)
    made.outlet.sent.clear()
    yield made
    assert made.refused == []


def depth(t_s: float) -> Any:
    """Return an image in which nothing came back, of the camera's size."""
    return FACTORY.make(
        "sensor_msgs/msg/Image",
        header=make_header(FACTORY, "laser", ns(t_s)),
        height=48,
        width=64,
        encoding="16UC1",
        step=128,
        data=np.zeros(48 * 128, np.uint8),
    )


def test_depth_images_wait_for_their_camera_info_and_go_out_with_it(rig: Rig) -> None:
    """Those of the camera's own namespace; without ticks both are relayed as they came."""
    image, info = depth(10.06), camera_info(10.06, frame_id="laser")
    rig.store("tf_static", laser_mount(), 10.06)
    rig.store("camera/depth", image, 10.06)
    rig.work(10.07)
    assert rig.outlet.take_names() == []
    rig.store("tf", robot_at(10.1), 10.07)
    rig.store("camera/camera_info", info, 10.08)
    rig.work(10.09)
    names = ["depth/camera_info", "depth/image"]
    assert [name for name, _ in rig.outlet.sent] == names
    types = [INPUTS[role].type_name for role in ("camera/camera_info", "depth")]
    sent = [data for _, data in rig.outlet.sent]
    found = [deserialize_message(d, message_class(t)) for d, t in zip(sent, types, strict=True)]
    assert found == [info, image]
    assert rig.live.builder.sensors.counts() == {"/camera/depth": SensorPathCounts(exact=1)}
    rig.live.pause(ns(10.1))
    rig.outlet.sent.clear()
    rig.store("camera/depth", image, 10.2)
    rig.store("camera/camera_info", info, 10.2)
    assert rig.outlet.take_names() == names[::-1]


# ------------------------------------------------------------------------------------- ticks


def test_ticks_run_in_order_with_what_came_before_them(rig: Rig) -> None:
    """Though all of it is worked through at once, later."""
    rig.store("tf", robot_at(10.1, x=1.1), 10.09)
    rig.store("map", room((30, 34, 30, 34)), 10.12)
    rig.store("tf", robot_at(10.2, x=1.2), 10.15)
    assert rig.outlet.sent == []
    rig.work(10.25)
    maps = {m.header.stamp.nanosec: m.data.tolist().count(100) for m in rig.outlet.take(MAP)}
    assert maps == {100_000_000: 4 * 39, 200_000_000: 4 * 39 + 16}
    assert rig.stamps() == [10_100, 10_200]


def test_nothing_runs_before_resume_and_nothing_before_the_time_is_known(make_rig: MakeRig) -> None:
    """The first tick is the first multiple of the period from then on."""
    rig = make_rig()
    rig.store("map", room(), 5.0)
    rig.work(5.0)
    assert rig.live.next_due_ns() is None
    rig.live.resume(0)
    rig.work(0.0)
    assert rig.live.next_due_ns() == 1
    assert rig.stamps() == []
    rig.work(7.05)
    assert rig.live.next_due_ns() == ns(7.1)
    rig.work(7.3)
    assert rig.stamps() == [7_100, 7_200, 7_300]


def test_what_is_latched_waits_for_the_time(make_rig: MakeRig) -> None:
    """It counts as received then; what moves is of no use any more."""
    rig = make_rig()
    rig.live.resume(0)
    for role, message in (("map", room()), ("tf", robot_at(9.9)), ("tf_static", laser_mount())):
        rig.store(role, message, 0.0)
    rig.work(10.0)
    builder = rig.live.builder
    assert builder.world.environment is not None
    assert builder.frames.has_frame("laser")
    assert not builder.frames.has_frame("map")


def test_late_ticks_are_run_up_to_a_second_and_then_skipped(rig: Rig) -> None:
    """And counted as skipped; each that runs late is counted as late."""
    rig.work(11.04)
    assert rig.stamps() == [10_100 + 100 * index for index in range(10)]
    assert rig.live.watch.skipped_count == 0
    rig.work(20.0)
    assert rig.stamps() == [19_100 + 100 * index for index in range(10)]
    assert rig.live.watch.skipped_count == 80
    assert rig.live.watch.count == 1 + 10 + 10
    assert rig.live.watch.late_count == 9 + 9


def test_after_a_long_standstill_nothing_of_it_is_simulated(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Artefacts stand where they were, lives go on with what was left of them; it is said once.

    Else each turn would take longer than the one before, on a machine that cannot keep up.
    """
    request = SpawnRequest("map", RigidTransform.planar(2.05, 2.05, 0.0), "post", life_ns=ns(60.0))
    rig.live.requests.spawn(request, ns(10.05))
    rig.work(10.2)
    crowd, steps = rig.live.builder.lives.crowd, list[int]()
    (before,) = rig.outlet.take("artefacts")[-1].artefacts
    sub_step = crowd.step

    def step(t_ns: int, *rest: Any) -> None:
        steps.append(t_ns)
        sub_step(t_ns, *rest)

    monkeypatch.setattr(crowd, "step", step)
    for t_s in (400.0, 420.0, 421.0):
        rig.store("tf", robot_at(t_s), t_s)
        rig.work(t_s)
    (after,) = rig.outlet.take("artefacts")[-1].artefacts
    assert (after.id, after.pose) == (before.id, before.pose)
    lost_s = 400.0 - 10.2 + 420.0 - 400.0
    assert after.departure.sec == pytest.approx(10.05 + 60.0 + lost_s, abs=1.0)
    assert min(steps) >= ns(400.0)
    assert len(steps) <= 2 + 20
    (said,) = (one for one in rig.live.take_notices() if "stood still" in one)
    assert said.startswith("the artefacts stood still for 389.8 s: the machine did not keep up")


def test_a_turn_is_named_after_what_was_done_in_it(make_rig: MakeRig) -> None:
    """A map and a camera are made ready, before a tick needs them; the rest has its own names.

    The camera once it is known where artefacts may arrive.
    """
    rig = make_rig(camera__model="auto", population__arrival_rate=0.2, robot__clearance=0.0)
    rig.live.resume(ns(10.0))

    def name_of_turn(t_s: float) -> str:
        rig.live.busy = CallbackTimer()
        rig.live.busy.begin(0, "inputs")
        rig.work(t_s)
        rig.live.busy.end(1)
        return next(iter(rig.live.busy.figures(1)))

    def buffer() -> object:
        return rig.live.builder._watch.eyes[0]._buffer

    rig.store("tf", robot_at(10.0), 10.01)
    assert name_of_turn(10.01) == "inputs"
    rig.store("map", room(), 10.02)
    assert name_of_turn(10.02) == "preparing"
    assert buffer() is None
    rig.store("camera/camera_info", camera_info(10.0, frame_id="base_link"), 10.03)
    assert name_of_turn(10.03) == "inputs"
    assert name_of_turn(10.051) == "preparing"
    ready = buffer()
    assert ready is not None
    rig.store("camera/camera_info", camera_info(10.03, frame_id="base_link"), 10.06)
    names = [name_of_turn(10.06 + 0.05 * k) for k in range(60)]
    assert {*names} == {"inputs", "ticks", "arrivals"}
    assert len(rig.live.builder.lives.population.living) > 0
    assert buffer() is ready


def test_a_clock_that_jumps_back_begins_the_ticks_anew(rig: Rig) -> None:
    """Messages that were stored before the jump are worked through before it."""
    rig.place(2.0, 2.0, 10.05)
    rig.store("tf", robot_at(10.1), 10.15)
    rig.store("tf", robot_at(5.0), 5.02)
    rig.work(5.2)
    assert rig.stamps() == [10_100, 5_100, 5_200]
    assert EventKind.DEPARTED in {event.kind for event in rig.live.take_events()}
    assert rig.live.next_due_ns() == ns(5.3)
    assert any("the clock jumped back by" in notice for notice in rig.live.take_notices())
    assert rig.live.take_notices() == []


def test_events_are_given_once(rig: Rig) -> None:
    """Those of all ticks since they were last asked for."""
    artefact_id = rig.place(2.0, 2.0, 10.05)
    rig.work(10.3)
    arrived = [e.artefact_id for e in rig.live.take_events() if e.kind is EventKind.ARRIVED]
    assert arrived == [artefact_id]
    assert rig.live.take_events() == ()


# ------------------------------------------------------------------------------------- demand


@pytest.mark.parametrize(
    ("values", "names", "perception", "markers"),
    [
        ({"costmap__gate": "all"}, set(), False, False),
        ({"costmap__gate": "all"}, {"artefacts"}, False, False),
        ({"costmap__gate": "all"}, {"perceived"}, True, False),
        ({"costmap__gate": "all"}, {"metrics"}, True, False),
        ({"costmap__gate": "all"}, {"events"}, True, False),
        ({"costmap__gate": "all"}, {"markers"}, True, True),
        ({"costmap__gate": "all", "sensors__gate": "perceived"}, set(), True, False),
        ({"costmap__gate": "perceived"}, set(), True, False),
    ],
)
def test_what_nobody_listens_to_is_not_computed(
    make_rig: MakeRig, values: dict[str, str], names: set[str], *, perception: bool, markers: bool
) -> None:
    """Only the grids are always there, for they are latched; a gate may need perception."""
    rig = make_rig(**values)
    rig.outlet.names = names
    rig.live.resume(ns(10.0))
    rig.store("map", room(), 10.0)
    rig.store("tf", robot_at(10.0), 10.0)
    rig.work(10.3)
    demand = rig.live.builder.demand
    assert (demand.perception, demand.grids, demand.markers) == (perception, True, markers)
    assert (rig.live.builder.looks > 0) == perception
    sent = set(rig.outlet.take_names())
    assert {MAP, "artefact_map", "augmented_costmap"} <= sent
    assert sent <= names | {MAP, "artefact_map", "augmented_costmap"}


def test_who_begins_to_listen_is_served_from_the_next_tick_on(rig: Rig) -> None:
    """With all markers, if the node says that there is a new viewer."""
    rig.outlet.names = set()
    artefact_id = rig.place(2.0, 2.0, 10.05)
    rig.work(10.2)
    assert rig.outlet.take("markers") == rig.outlet.take("perceived") == []
    rig.outlet.names = {"markers", "perceived"}
    rig.live.builder.show_everything()
    rig.store("tf", robot_at(10.2), 10.25)
    rig.work(10.3)
    (perceived,) = rig.outlet.take("perceived")
    assert [one.id for one in perceived.artefacts] == [artefact_id]
    (markers,) = rig.outlet.take("markers")
    assert markers.markers[0].action == DELETE_ALL
    assert {marker.id for marker in markers.markers[1:]} == {artefact_id}


def test_the_octomap_goes_out_while_somebody_listens(rig: Rig) -> None:
    """Latched, but not for nobody; a pause leaves it without artefacts."""
    wall = np.array([(3.55, y, 0.55) for y in np.arange(10) * 0.1 + 0.05], np.float32)
    cloud = make_cloud(FACTORY, "map", ns(10.0), wall)
    rig.store("octomap_point_cloud_centers", cloud, 10.06)
    rig.place(2.0, 2.0, 10.06)
    rig.outlet.names = set()
    rig.work(10.2)
    assert rig.outlet.take(OCTOMAP) == []
    rig.outlet.names = {OCTOMAP}
    rig.work(10.3)
    (augmented,) = rig.outlet.take(OCTOMAP)
    assert augmented.width > len(wall)
    rig.outlet.names = set()
    rig.live.pause(ns(10.35))
    (bare,) = rig.outlet.take(OCTOMAP)
    assert bytes(bare.data) == wall.tobytes()
    new = np.concatenate((wall, wall + np.float32(0.1)))
    rig.store("octomap_point_cloud_centers", make_cloud(FACTORY, "map", ns(10.4), new), 10.4)
    rig.work(10.45)
    (bare,) = rig.outlet.take(OCTOMAP)
    assert bare.width == len(new)


def test_an_octomap_for_nobody_is_not_sent_in_a_pause(rig: Rig) -> None:
    """Who comes later gets it when the artefacts live on."""
    wall = np.array([(3.55, y, 0.55) for y in np.arange(10) * 0.1 + 0.05], np.float32)
    rig.outlet.names = set()
    rig.live.pause(ns(10.05))
    rig.store("octomap_point_cloud_centers", make_cloud(FACTORY, "map", ns(10.1), wall), 10.1)
    rig.work(10.2)
    assert rig.outlet.take(OCTOMAP) == []


# ------------------------------------------------------------------------------------- scans


def test_a_scan_is_worked_on_at_once_and_so_is_what_it_waits_for(rig: Rig) -> None:
    """Transforms need not, while nothing waits for them."""
    assert not rig.store("tf", robot_at(10.05), 10.06)
    assert not rig.store("tf_static", laser_mount(), 10.06)
    assert rig.store("scan", scan(10.1), 10.12)
    rig.work(10.12)
    assert rig.stamps("scan") == []
    assert rig.live.next_due_ns() == ns(10.12 + 0.05)
    assert not rig.store("plan", path_to(3.0, 3.0), 10.13)
    assert rig.store("tf", robot_at(10.11), 10.13)
    rig.work(10.13)
    assert rig.stamps("scan") == [10_100]
    assert rig.live.next_due_ns() == ns(10.2)


def test_a_scan_waits_no_longer_than_it_may(rig: Rig) -> None:
    """Then it goes as it came."""
    rig.store("tf_static", laser_mount(), 10.06)
    rig.store("scan", scan(10.4), 10.1)
    rig.work(10.149)
    assert rig.stamps("scan") == []
    rig.work(10.15)
    assert rig.stamps("scan") == [10_400]
    assert rig.live.builder.sensors.counts()["/scan"].passed_through == 1


@pytest.mark.parametrize("is_simulated", [False, True])
def test_what_came_in_a_stall_counts_for_the_scans_of_before_it(
    rig: Rig, *, is_simulated: bool
) -> None:
    """DDS has had it for long when the node, 0.4 s late, is called for the deadline first."""
    rig.inbox.is_simulated = is_simulated
    rig.store("tf_static", laser_mount(), 10.05)
    rig.place(3.0, 2.0, 10.05)
    rig.work(10.1)
    rig.store("scan", scan(10.13), 10.13)
    rig.work(10.13)
    rig.inbox.held = [("tf", robot_at(10.15)), ("plan", path_to(3.0, 2.0))]
    rig.work(10.5)
    (message,) = rig.outlet.take("scan")
    assert min(message.ranges) == pytest.approx(1.8, abs=0.01)
    assert [role for role, _ in rig.inbox.held] == ["plan"]
    assert rig.live.builder.sensors.counts()["/scan"] == SensorPathCounts(exact=1)


@pytest.mark.parametrize("is_held", [True, False])
def test_late_ticks_have_the_pose_of_their_own_time(rig: Rig, *, is_held: bool) -> None:
    """The robot drove on while the node stood still; DDS holds that, or callbacks stored it."""
    rig.inbox.is_simulated = False
    rig.place(3.0, 2.0, 10.05)
    rig.work(10.1)
    moves = [robot_at(10.2), robot_at(10.3, x=2.9), robot_at(10.6, x=2.9)]
    if is_held:
        rig.inbox.held = [("tf", move) for move in moves]
    else:
        for move in moves:
            rig.store("tf", move, 10.65)
    rig.work(10.65)
    assert rig.stamps() == [10_100, 10_200, 10_300, 10_400, 10_500, 10_600]
    (contact,) = (e for e in rig.live.take_events() if e.kind is EventKind.ROBOT_CONTACT)
    assert ns(10.2) < contact.stamp_ns <= ns(10.3)


def test_what_was_stored_in_a_stall_counts_too(rig: Rig) -> None:
    """A scan's callback came first, and what the transform's stored lies behind its deadline."""
    rig.store("tf_static", laser_mount(), 10.05)
    rig.store("scan", scan(10.08), 10.08)
    rig.work(10.08)
    rig.store("scan", scan(10.4), 10.5)
    rig.store("tf", robot_at(10.1), 10.5)
    rig.work(10.5)
    assert rig.live.builder.sensors.counts()["/scan"] == SensorPathCounts(exact=1)


def test_a_process_that_was_stopped_listens_before_it_judges(rig: Rig) -> None:
    """Its clock has gone on, and DDS has not yet read from the network what came meanwhile."""
    rig.inbox.is_simulated = False
    rig.store("tf_static", laser_mount(), 10.05)
    rig.store("scan", scan(10.08), 10.08)
    rig.work(10.08)
    rig.work(10.395)
    assert rig.live.next_due_ns() == ns(10.4)
    rig.work(10.401)
    assert rig.outlet.take("scan") == []
    assert rig.live.next_due_ns() == ns(10.405)
    rig.work(10.6)  # stopped again
    assert rig.outlet.take("scan") == []
    rig.inbox.held = [("tf", robot_at(10.1))]
    rig.work(10.61)
    assert rig.live.builder.sensors.counts()["/scan"] == SensorPathCounts(exact=1)


def test_who_is_always_late_lets_scans_go_after_a_second(rig: Rig) -> None:
    """However late the node is at each look, no scan waits for ever."""
    rig.inbox.is_simulated = False
    deadline_s = 10.08 + 0.05
    rig.store("scan", scan(10.08), 10.08)
    rig.work(10.08)
    looks_s = [deadline_s + 0.1 * k for k in range(12)]
    for t_s in looks_s:
        rig.work(t_s)
        if rig.outlet.take("scan"):
            break
    assert t_s == looks_s[-1]
    assert rig.live.builder.sensors.counts()["/scan"] == SensorPathCounts(passed_through=1)


def test_a_scan_that_waits_leaves_before_the_pause(rig: Rig) -> None:
    """It does not come after those that are relayed then."""
    rig.store("scan", scan(10.1), 10.1)
    rig.live.pause(ns(10.11))
    assert not rig.store("scan", scan(10.2), 10.2)
    rig.store("tf", robot_at(10.3), 10.3)
    rig.work(11.0)
    assert rig.stamps("scan") == [10_100, 10_200]


# ------------------------------------------------------------------------------------- relays


@pytest.mark.parametrize("t_s", [0.0, 10.0])
def test_maps_and_scans_are_relayed_at_once_while_nothing_runs(
    make_rig: MakeRig, t_s: float
) -> None:
    """To the byte; beside them an empty artefact map, and the costmap once the time is known."""
    rig = make_rig()
    real = {role: serialize_message(m) for role, m in (("map", room()), ("scan", scan(9.9)))}
    for role, data in real.items():
        assert not rig.store(role, data, t_s)
    rig.store("tf", robot_at(9.9), t_s)
    rig.work(t_s)
    (empty,) = rig.outlet.take("artefact_map")
    assert (empty.info.width, set(empty.data.tolist())) == (40, {0})
    assert rig.outlet.sent[:2] == [(MAP, real["map"]), ("scan", real["scan"])]
    costmaps = [
        costmap.data.tolist().count(100) for costmap in rig.outlet.take("augmented_costmap")
    ]
    assert costmaps == ([4 * 39] if t_s else [])
    assert len(rig.outlet.sent) == 2


def test_they_are_relayed_while_the_time_is_not_known(make_rig: MakeRig) -> None:
    """Though the node is active; then ticks take over."""
    rig = make_rig()
    rig.live.resume(0)
    rig.store("map", room(), 0.0)
    rig.store("scan", scan(9.9), 0.0)
    assert rig.outlet.take_names() == [MAP, "artefact_map", "scan"]
    rig.work(10.0)
    rig.work(10.1)
    (grid,) = rig.outlet.take(MAP)
    assert (grid.header.stamp.sec, grid.data) == (10, room().data)


def test_a_pause_takes_artefacts_away_and_resuming_brings_them_back(rig: Rig) -> None:
    """At the places where they were."""
    artefact_id = rig.place(2.05, 2.05, 10.05)
    rig.work(10.2)
    (before,) = rig.outlet.take("artefacts")[-1].artefacts
    rig.live.pause(ns(10.25))
    assert rig.outlet.take(MAP)[-1].data == room().data
    assert [marker.action for marker in rig.outlet.take("markers")[-1].markers] == [DELETE_ALL]
    assert rig.outlet.take("artefacts")[-1].artefacts == []
    rig.outlet.sent.clear()
    rig.work(60.0)
    assert rig.outlet.sent == []
    assert rig.live.next_due_ns() is None
    rig.live.resume(ns(60.0))
    rig.work(60.1)
    (after,) = rig.outlet.take("artefacts")[-1].artefacts
    assert (after.id, after.pose) == (artefact_id, before.pose)
    assert rig.outlet.take(MAP)[-1].data.tolist().count(100) == 4 * 39 + 25
    assert {m.id for m in rig.outlet.take("markers")[0].markers[1:]} == {artefact_id}


# ------------------------------------------------------------------------------------- refusals


def test_what_is_refused_is_told_with_its_topic(make_rig: MakeRig) -> None:
    """When it is taken; the inputs around it are."""
    rig = make_rig()
    rig.live.resume(ns(10.0))
    rig.store("map", b"\0\1\0\0", 10.0)
    rig.store("map", room(), 10.01)
    rig.store("plan", b"\0\1\0\0", 10.02)
    assert rig.refused == []
    rig.work(10.1)
    topics = [topic for topic, _ in rig.refused]
    assert topics == ["/map", "/plan"]
    assert rig.refused[0][1] == "/map: 4 bytes that are no nav_msgs/msg/OccupancyGrid"
    assert rig.live.builder.world.environment is not None


def test_clicks_are_requests_while_it_runs(make_rig: MakeRig) -> None:
    """In the order of what came; at other times they are refused."""
    rig = make_rig()
    rig.store("clicked_point", click_at(2.0, 2.0), 9.0)
    rig.work(9.0)
    rig.live.resume(ns(10.0))
    rig.store("clicked_point", click_at(2.0, 2.0), 10.0)
    rig.store("map", room(), 10.01)
    rig.store("clicked_point", click_at(2.0, 2.0), 10.02)
    rig.store("clicked_point", click_at(2.1, 2.0), 10.03)
    rig.work(10.1)
    assert len(rig.live.builder.lives.population.living) == 1
    reasons = ["nobody lives", "there is no map yet", "it would overlap another artefact"]
    assert len(rig.refused) == len(reasons)
    for (topic, sentence), reason in zip(rig.refused, reasons, strict=True):
        assert topic == "/clicked_point"
        assert sentence.startswith("/clicked_point: ")
        assert reason in sentence


def test_parameters_hold_from_their_instant_on(rig: Rig) -> None:
    """What came before is worked through with the old ones."""
    artefact_id = rig.place(2.5, 2.0, 10.05)
    rig.store("tf", robot_at(10.1), 10.1)
    blind = with_values(rig.live.builder.parameters, {"occlusion.tau": 64 * 48})
    rig.live.reconfigure(blind, ns(10.1))
    rig.work(10.2)
    seen = [[one.id for one in message.artefacts] for message in rig.outlet.take("perceived")]
    assert seen == [[artefact_id], []]


@pytest.mark.parametrize("request_name", ["reconfigure", "pause"])
def test_a_request_before_the_first_clock_begins_no_time(
    make_rig: MakeRig, request_name: str
) -> None:
    """Parameters are set, or the node deactivated, at time 0; with /clock nothing leaps."""
    rig = make_rig()
    rig.live.resume(0)
    if request_name == "pause":
        rig.live.pause(0)
        rig.live.resume(0)
    else:
        fewer = with_values(rig.live.builder.parameters, {"population.arrival_rate": 0.001})
        rig.live.reconfigure(fewer, 0)
    rig.store("map", room(), 1_700_000_000.0)
    rig.work(1_700_000_000.1)
    assert rig.live.take_notices() == []
    assert rig.live.builder.lives.population.living == {}
