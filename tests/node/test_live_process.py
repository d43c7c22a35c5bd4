"""The process of the node: how it ends at a signal, and what it says of bad arguments."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from threading import Thread
from typing import Any, NamedTuple

import pytest

from tests.ros import NOT_SET_UP, WAIT_S, RosWorld, nap, running_s, undisturbed, wait_until

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from rclpy.qos import QoSProfile, ReliabilityPolicy

from are_ros.messages.tick_encoding import OUTPUTS
from are_ros.node.message_classes import message_class, service_class
from are_ros.node.qos import INPUTS, input_qos, output_qos
from are_ros.node.startup import main
from are_ros.parameters.model import SensorsParameters
from tests.node.live_bench import DELETE_ALL, stamp_ns
from tests.node.live_scene import (
    FACTORY,
    QUIET,
    laser_mount,
    ns,
    odometry,
    pose_at,
    robot_at,
    room,
    scan,
    transforms,
)

Start = Callable[..., "Process"]
PROGRAM = """
import signal, sys

known = signal.signal

def listen(number, handler):
    before = known(number, handler)
    if number == signal.SIGTERM and callable(handler):
        print("up", file=sys.stderr, flush=True)
    return before

signal.signal = listen
from are_ros.node.startup import main
sys.exit(main(sys.argv[1:]))
"""
"""It says when it listens to signals: before that, one would end any process."""
HANGING = """
classes:
  person:
    shape: person
    motion: {speed_mps: 1.0, turn_rate_radps: 3.0}
rows:
  - {label: post, class: person, size_m: [0.3, 0.4, 1.7], behaviours: {"HANGS": 1}}
"""
HEART = """
import rclpy
from are_ros.node.heartbeat import offer_heartbeat

rclpy.init()
node = rclpy.create_node("ar_builder")
heartbeat = offer_heartbeat(node)
timer = node.create_timer(0.5, lambda: None)
try:
    rclpy.spin(node)
except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
    node.destroy_node()
"""
"""Of the node nothing but its heartbeat.

Without its timer one signal in a thousand, at the beginning of rclpy's spin, wakes nobody up.
"""
READY, PREPARING = "active: artefacts arrive", "preparing the kernels"
SOON_S = 10.0
"""So long after a signal the process has ended, which takes one or two on an idle machine, and half
a minute if kernels were waited for; stalls of the machine do not count."""
PREPARED_S = 300.0
"""By then kernels are compiled on the slowest machine."""


class Process:
    """A node in a process of its own, and what it writes on stderr."""

    def __init__(self, words: Sequence[str], environment: Mapping[str, str] = os.environ) -> None:
        self._popen = subprocess.Popen(
            [sys.executable, *words],
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        )
        self.said: list[str] = []
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._popen.stderr is not None
        with self._popen.stderr as lines:
            for line in lines:
                self.said.append(line)

    def wait_for(self, sentence: str) -> None:
        """Wait until it writes a sentence; the test fails when it ends without."""
        wait_until(lambda: self._has_said(sentence) or not self._reader.is_alive(), nap, PREPARED_S)
        assert self._has_said(sentence), self.said

    def _has_said(self, sentence: str) -> bool:
        return any(sentence in line for line in self.said)

    def signal(self, number: int) -> None:
        """Send a signal."""
        self._popen.send_signal(number)

    def end(self, timeout_s: float = WAIT_S) -> int:
        """Wait for its end, and return the exit status; it has left no traceback."""
        wait_until(lambda: not self.is_alive(), nap, timeout_s)
        status = self._popen.wait()
        self._reader.join(WAIT_S)
        complaints = [line for line in self.said if "Traceback" in line or "ignored" in line]
        assert complaints == [], self.said
        return status

    def is_alive(self) -> bool:
        """Tell whether it has not ended yet."""
        return self._popen.poll() is None

    def kill(self) -> None:
        """Leave nothing behind."""
        self._popen.kill()
        self._popen.wait()


@pytest.fixture
def start(catalogue_file: Path) -> Iterator[Start]:
    """Return what starts a node: with `values` by path, or a quiet one; and its environment."""
    started: list[Process] = []

    def begin(values: dict[str, Any] | None = None, **environment: str) -> Process:
        own = {**QUIET, "catalogue": str(catalogue_file)} if values is None else values
        words = [word for path, value in own.items() for word in ("-p", f"{path}:={text(value)}")]
        words = ["-c", PROGRAM, "--ros-args", *words]
        process = Process(words, {**os.environ, **environment})
        started.append(process)
        return process

    yield begin
    for process in started:
        process.kill()


def text(value: Any) -> str:
    """Return a value as the command line has it."""
    return str(value).lower() if isinstance(value, bool) else str(value)


@pytest.mark.parametrize(
    ("delay_s", "number"),
    [
        (0.1, signal.SIGTERM),
        (0.5, signal.SIGINT),
        (1.0, signal.SIGTERM),
        (2.0, signal.SIGINT),
        (4.0, signal.SIGTERM),
    ],
)
def test_it_ends_at_a_signal_at_any_moment(
    ros_available: None,  # noqa: ARG001 - it skips where there is none
    start: Start,
    delay_s: float,
    number: int,
) -> None:
    """While it imports, prepares or runs: with 0, soon, and without a traceback."""
    process = start({})
    process.wait_for("up")
    time.sleep(delay_s)
    process.signal(number)
    assert process.end(SOON_S) == 0


def test_it_ends_while_kernels_compile(
    ros_available: None,  # noqa: ARG001 - it skips where there is none
    start: Start,
    tmp_path: Path,
) -> None:
    """As after an installation: they are not waited for."""
    process = start(NUMBA_CACHE_DIR=str(tmp_path))
    process.wait_for(PREPARING)
    time.sleep(1.0)
    process.signal(signal.SIGINT)
    assert process.end(SOON_S) == 0
    assert not any("configured: the real map" in line for line in process.said)
    assert not any(line.startswith("[ERROR") for line in process.said)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_leaves_what_is_real(
    ros: RosWorld, start: Start, catalogue_file: Path, number: int
) -> None:
    """Every marker is deleted, the last map is the real one; a second signal changes nothing."""
    process = start({**QUIET, "catalogue": str(catalogue_file), "costmap.gate": "all"})
    user = ros.make_node("user")
    heard = {name: collect(ros, user, name) for name in ("augmented_map", "markers", "artefacts")}
    publish(user, "map", room())
    process.wait_for(READY)
    ros.spin_until(lambda: heard["augmented_map"])
    placed = spawn(ros, user, pose_at(2.05, 2.05))
    ros.spin_until(lambda: heard["augmented_map"][-1].data.tolist().count(100) == 4 * 39 + 25)
    ros.spin_until(lambda: any(m.id == placed for m in heard["markers"][-1].markers))
    process.signal(number)
    process.signal(number)
    began_s = running_s()
    ros.spin_until(lambda: not process.is_alive())
    assert running_s() - began_s < SOON_S
    assert process.end() == 0
    ros.spin_until(lambda: is_farewell(heard))
    ros.spin_for(0.2)
    assert is_farewell(heard), "nothing comes after it"


def test_a_behaviour_that_never_returns_does_not_keep_it(
    ros: RosWorld, start: Start, tmp_path: Path
) -> None:
    """A second after the signal it is ended, and what is real is left; the log says who it was."""
    catalogue = tmp_path / "catalogue.yaml"
    hangs = "tests.agents.behaviours.failing:Hangs"
    catalogue.write_text(HANGING.replace("HANGS", hangs), encoding="utf-8")
    process = start({**QUIET, "catalogue": str(catalogue), "costmap.gate": "all"})
    user = ros.make_node("user")
    heard = {name: collect(ros, user, name) for name in ("augmented_map", "markers", "artefacts")}
    publish(user, "map", room())
    process.wait_for(READY)
    ros.spin_until(lambda: heard["augmented_map"])
    spawn(ros, user, pose_at(2.05, 2.05))
    process.wait_for("has not returned for a second; the node stands still")
    process.signal(signal.SIGINT)
    ros.spin_until(lambda: not process.is_alive())
    assert process.end() == 0
    ros.spin_until(lambda: is_farewell(heard))
    (ended,) = (line for line in process.said if "was told to end" in line)
    assert f"{hangs} of artefact " in ended
    assert "TimeoutError: it had not returned a second after" in ended
    assert "failing.py, line " in ended


@pytest.fixture
def guard(ros_available: None) -> Iterator[Process]:  # noqa: ARG001 - it skips
    """Return the process of `are guard`."""
    process = Process(["-m", "are_ros", "guard"])
    yield process
    process.kill()


class Guarded(NamedTuple):
    """A guarded node with one artefact in its maps: its process, its user, the maps that came."""

    process: Process
    user: Any
    maps: list[Any]
    artefact_maps: list[Any]


@pytest.fixture
def guarded(ros: RosWorld, start: Start, guard: Process, catalogue_file: Path) -> Guarded:
    """Return a node that the guard watches."""
    process = start({**QUIET, "catalogue": str(catalogue_file), "costmap.gate": "all"})
    user = ros.make_node("user")
    maps, artefacts = (collect(ros, user, name) for name in ("augmented_map", "artefact_map"))
    publish(user, "map", room())
    process.wait_for(READY)
    guard.wait_for("/ar_builder runs, and is guarded")
    ros.spin_until(lambda: maps)
    spawn(ros, user, pose_at(2.05, 2.05))
    ros.spin_until(lambda: artefacts and artefacts[-1].data.tolist().count(100) == 25)
    return Guarded(process, user, maps, artefacts)


def test_the_guard_gives_the_real_map_back(ros: RosWorld, guard: Process, guarded: Guarded) -> None:
    """Once, within a second of a kill; never while the node lives, be it stalled or paused."""
    process, user, maps, artefacts = guarded
    pause = service_class("std_srvs/srv/SetBool")
    for is_paused in (True, False):
        assert ask(ros, user, "pause", pause, pause.Request(data=is_paused)).success
    ros.spin_until(lambda: artefacts[-1].data.tolist().count(100) == 25)
    process.signal(signal.SIGSTOP)
    ros.spin_for(0.4)
    process.signal(signal.SIGCONT)
    ros.spin_for(1.2)
    assert artefacts[-1].data.tolist().count(100) == 25, "the guard does nothing while it lives"
    sent = len(maps), len(artefacts)
    process.kill()
    began_s = running_s()
    ros.spin_until(lambda: (len(maps), len(artefacts)) > sent and not any(artefacts[-1].data))
    ros.spin_until(lambda: maps[-1].data == room().data)
    assert running_s() - began_s < 1.0
    ros.spin_for(0.3)
    assert (len(maps), len(artefacts)) == (sent[0] + 1, sent[1] + 1), "once"
    late = collect(ros, user, "augmented_map")
    ros.spin_until(lambda: late)
    assert late[-1].data == room().data
    guard.signal(signal.SIGINT)
    assert guard.end(SOON_S) == 0


def test_a_node_that_the_guard_took_for_dead_gets_its_maps_back(
    ros: RosWorld, guard: Process, guarded: Guarded
) -> None:
    """It was stopped, and knows of nothing; nothing moves that would make it send them again."""
    process, _, maps, artefacts = guarded
    augmented = maps[-1].data
    process.signal(signal.SIGSTOP)
    guard.wait_for("/ar_builder was killed")
    ros.spin_until(lambda: not any(artefacts[-1].data) and maps[-1].data == room().data)
    process.signal(signal.SIGCONT)
    ros.spin_until(lambda: artefacts[-1].data.tolist().count(100) == 25)
    ros.spin_until(lambda: maps[-1].data == augmented)


@pytest.fixture
def heart() -> Iterator[Callable[[], Process]]:
    """Return what starts the heartbeat of a node; none is left behind."""
    with ExitStack() as stack:

        def begin() -> Process:
            process = Process(["-c", HEART])
            stack.callback(process.kill)
            return process

        yield begin


def test_the_guard_leaves_the_field_to_a_node_that_is_back(
    ros: RosWorld, guard: Process, heart: Callable[[], Process]
) -> None:
    """What it published itself reaches nobody any more, and a node that ends in order is let go."""
    user = ros.make_node("user")
    publish(user, "map", room())
    killed = heart()
    guard.wait_for("runs, and is guarded")
    killed.kill()
    guard.wait_for("/ar_builder was killed")
    guard.wait_for("the real map is published, and an empty artefact map")
    back = heart()
    wait_until(lambda: sum("is guarded" in line for line in guard.said) == 2, nap)
    late = collect(ros, user, "augmented_map")
    back.signal(signal.SIGINT)
    assert back.end(SOON_S) == 0
    ros.spin_for(1.2)
    assert late == []
    assert sum("was killed" in line for line in guard.said) == 1


@pytest.mark.parametrize("reliability", [ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT])
def test_the_guard_hears_a_map_that_is_not_latched(
    ros: RosWorld, guard: Process, heart: Callable[[], Process], reliability: ReliabilityPolicy
) -> None:
    """As the node does; also one that nobody sends again if it is lost."""
    user = ros.make_node("user")
    profile = QoSProfile(depth=1, reliability=reliability)
    publisher = user.create_publisher(type(room()), "/map", profile)
    killed = heart()
    guard.wait_for("runs, and is guarded")
    ros.spin_until(publisher.get_subscription_count)
    for _ in range(5):  # what goes by best effort may come before the guard knows the publisher
        publisher.publish(room())
        ros.spin_for(0.2)
    killed.kill()
    guard.wait_for("/ar_builder was killed")
    guard.wait_for("the real map is published, and an empty artefact map")


def test_the_guard_is_light() -> None:
    """It must not wait for compiled kernels, nor hold them in memory."""
    code = "import sys, are_ros.cli, are_ros.node.guard; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def is_farewell(heard: Mapping[str, Sequence[Any]]) -> bool:
    """Tell whether the last messages of all outputs say that nothing is there but what is real."""
    return (
        heard["augmented_map"][-1].data == room().data
        and [marker.action for marker in heard["markers"][-1].markers] == [DELETE_ALL]
        and heard["artefacts"][-1].artefacts == []
    )


def collect(ros: RosWorld, user: Any, name: str) -> list[Any]:
    """Subscribe to an output, and return what comes."""
    kind = message_class(OUTPUTS[name].type_name)
    return ros.collect(user, kind, f"/ar_builder/{name}", output_qos(name))


def publish(user: Any, role: str, message: Any) -> Any:
    """Publish an input, and return its publisher."""
    publisher = user.create_publisher(type(message), f"/{role}", input_qos(role))
    publisher.publish(message)
    return publisher


def spawn(ros: RosWorld, user: Any, pose: Any) -> int:
    """Place a post for an hour, and return its id: a machine that stalls makes tests long."""
    kind = service_class("are_msgs/srv/SpawnArtefact")
    request = kind.Request(pose=pose, label="post")  # any row of the label
    request.life.sec = 3600
    answer = ask(ros, user, "spawn", kind, request)
    assert answer.success, answer.message
    return int(answer.id)


def ask(ros: RosWorld, user: Any, service: str, kind: type[Any], request: Any) -> Any:
    """Call a service of the node, and return the response.

    An answer is lost where the node's process has not seen the client yet. It sees clients in their
    order, so that one answer to a later client is enough.
    """
    client = user.create_client(kind, f"/ar_builder/{service}")
    state = service_class("lifecycle_msgs/srv/GetState")
    later = user.create_client(state, "/ar_builder/get_state")
    answers: list[Any] = []

    def knock() -> None:
        if client.service_is_ready() and later.service_is_ready():
            later.call_async(state.Request()).add_done_callback(answers.append)
        ros.spin_for(0.1)

    wait_until(lambda: answers, knock)
    future = client.call_async(request)
    ros.spin_until(future.done)
    return future.result()


def test_it_waits_to_be_told_without_autostart(ros: RosWorld, start: Start) -> None:
    """It goes through the states that a lifecycle manager asks for, and ends in each."""
    process = start({"autostart": False})
    user = ros.make_node("user")
    kind = service_class("lifecycle_msgs/srv/ChangeState")
    metrics = collect(ros, user, "metrics")
    state = service_class("lifecycle_msgs/srv/GetState")
    answer = ask(ros, user, "get_state", state, state.Request())
    assert answer.current_state.label == "unconfigured"
    for label in ("configure", "activate"):
        transition = FACTORY.make("lifecycle_msgs/msg/Transition", label=label)
        request = kind.Request(transition=transition)
        answer = ask(ros, user, "change_state", kind, request)
        assert answer.success, label
    publisher = publish(user, "tf", robot_at(0.0))
    ros.spin_until(lambda: len(metrics) > 2 and publisher.get_subscription_count())
    process.signal(signal.SIGTERM)
    assert process.end(SOON_S) == 0


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["-p", "population.arrival_rate:=-1.0"], "'population.arrival_rate': -1.0 is below 0.0"),
        (["-p", "population.arrival_rate:=many"], "'many' is not a number"),
        (["-p", "no.such:=1"], "parameter 'no.such': there is no such parameter"),
        (["-p", "catalogue:=/nowhere.yaml"], "the catalogue /nowhere.yaml cannot be read"),
        (["-p", "broken"], "Couldn't parse parameter override rule: '-p broken'"),
        (["-p", "use_sim_time:=maybe"], "'use_sim_time'"),
        (["--params-file", "/nowhere.yaml"], "Couldn't parse params file"),
        (["--no-such-flag"], "does not know the arguments ['--no-such-flag']"),
    ],
)
def test_bad_arguments_are_refused_in_a_sentence(
    ros_available: None,  # noqa: ARG001 - it skips where there is none
    capfd: pytest.CaptureFixture[str],
    words: list[str],
    sentence: str,
) -> None:
    """With exit status 1, and no traceback."""
    assert main(["--ros-args", *words]) == 1
    said = capfd.readouterr().err
    (line,) = (line for line in said.splitlines() if "[ar_builder]" in line)
    assert sentence in line
    assert "Traceback" not in said


def test_a_refusal_is_the_exit_status(
    ros_available: None,  # noqa: ARG001 - it skips where there is none
    start: Start,
) -> None:
    """Of the process."""
    process = start({"population.mean_life": 0.0})
    assert process.end() == 1
    assert any("'population.mean_life': 0.0 is below 0.001" in line for line in process.said)


# ------------------------------------------------------------------------------------- stalls

STALLS_S = (0.06, 0.1, 0.2, 0.4)
ROUNDS = 3
SCANS_PER_STALL = 8
ENOUGH_SCANS = 0.7 * len(STALLS_S) * ROUNDS * SCANS_PER_STALL
MOST_ROUNDS = 4
"""So often all stalls are gone through until enough scans count: a machine may be busy."""
TF_PERIOD_S, TF_LAG_S = 0.02, 0.015
LISTENED_S = 0.005
"""So long a node that is not busy takes to have a scan, after which it is stopped."""


class Driver:
    """A robot by the clock of the wall: scans at 10 Hz; transforms and odometry at 50 Hz.

    What is to be sent by now is sent by `turn`; a transform 15 ms after its stamp. `sent_s` and
    `followed_s` are when a scan was sent, and the first transform at or after its stamp.
    """

    def __init__(self, ros: RosWorld, user: Any) -> None:
        self.sent_s: dict[int, float] = {}
        self.followed_s: dict[int, float] = {}
        self._ros = ros
        kinds = {role: message_class(INPUTS[role].type_name) for role in ("tf", "odom", "scan")}
        self._publishers = {
            role: user.create_publisher(kind, INPUTS[role].topic or f"/{role}", input_qos(role))
            for role, kind in kinds.items()
        }
        self._began_s = time.time()
        self._scans = self._moves = 0

    def drive(self, scans: int) -> None:
        """Go on until so many more scans are sent, and the last one a little ago."""
        until = self._scans + scans
        while self._scans < until or time.time() < self._scan_s(until - 1) + LISTENED_S:
            self.turn()

    def drive_for(self, duration_s: float) -> None:
        """Go on for a while."""
        until_s = time.time() + duration_s
        while time.time() < until_s:
            self.turn()

    def drive_until_heard(self, heard: Sequence[Any]) -> None:
        """Go on until what was sent so far has been heard, or something later."""
        ended_ns = max(self.sent_s)
        wait_until(lambda: stamp_ns(heard[-1]) > ended_ns, self.turn)

    def turn(self) -> None:
        """Send what is due, in the order of when it is, and take what has come."""
        while min(self._scan_due_s(), self._move_due_s()) <= time.time():
            if self._scan_due_s() < self._move_due_s():
                self._send_scan()
            else:
                self._send_move()
        self._ros.executor.spin_once(timeout_sec=0.001)

    def _send_scan(self) -> None:
        stamp_s = self._scan_s(self._scans)
        self._publishers["scan"].publish(scan(stamp_s))
        self.sent_s[ns(stamp_s)] = time.monotonic()
        self._scans += 1

    def _send_move(self) -> None:
        stamp_s = self._move_s(self._moves)
        origin = ("map", "odom", stamp_s, (0.0, 0.0, 0.0), 0.0)
        pose = ("odom", "base_link", stamp_s, (1.0, 2.0, 0.0), 0.0)
        self._publishers["tf"].publish(transforms(origin, pose))
        self._publishers["odom"].publish(odometry(stamp_s, 1.0, 2.0))
        for waiting_ns in self.sent_s:
            if waiting_ns <= ns(stamp_s):
                self.followed_s.setdefault(waiting_ns, time.monotonic())
        self._moves += 1

    def _scan_due_s(self) -> float:
        return self._scan_s(self._scans)

    def _move_due_s(self) -> float:
        return self._move_s(self._moves) + TF_LAG_S

    def _scan_s(self, number: int) -> float:
        return self._began_s + 0.01 + 0.1 * number

    def _move_s(self, number: int) -> float:
        return self._began_s + TF_PERIOD_S * number


@pytest.mark.parametrize(
    "tf_wait_s", [pytest.param(0.05, marks=pytest.mark.long), SensorsParameters().tf_wait]
)
def test_after_a_stall_no_scan_is_bare_whose_transform_came(
    ros: RosWorld, start: Start, catalogue_file: Path, tf_wait_s: float
) -> None:
    """The process is stopped while scans, transforms and odometry go on: all show the post.

    That is 1.8 m before the laser, the walls are not nearer than 3.5 m. A scan is left out whose
    transform was sent late, or that was lost (scans are best effort), as this process or the whole
    machine stalled.
    """
    values = {"catalogue": str(catalogue_file), "sensors.tf_wait": tf_wait_s}
    process = start({**QUIET, **values})
    user = ros.make_node("user")
    heard = ros.collect(user, message_class("sensor_msgs/msg/LaserScan"), "/ar_builder/scan", 1000)
    kept = publish(user, "map", room()), publish(user, "tf_static", laser_mount())
    process.wait_for(READY)
    ros.spin_until(lambda: all(publisher.get_subscription_count() for publisher in kept))
    driver = Driver(ros, user)
    wait_until(lambda: heard, driver.turn)
    spawn(ros, user, pose_at(3.0, 2.0))

    def late_of_bare_s() -> list[float]:
        """Return how late the transforms of bare scans were sent, of those sent in time."""
        begun_ns = ns(time.time() + 0.1)  # no tick is later; what was due before is older
        driver.drive(2)
        in_time: dict[int, float] = {}
        for _ in range(MOST_ROUNDS):
            for stall_s in STALLS_S * ROUNDS:
                driver.drive(SCANS_PER_STALL)
                process.signal(signal.SIGSTOP)
                driver.drive_for(stall_s)
                process.signal(signal.SIGCONT)
            driver.drive(SCANS_PER_STALL)
            driver.drive_until_heard(heard)
            nearest_m = {stamp_ns(message): min(message.ranges) for message in heard}
            late_s = {at: driver.followed_s[at] - driver.sent_s[at] for at in driver.followed_s}
            stamps = {stamp for stamp in nearest_m.keys() & late_s.keys() if stamp > begun_ns}
            in_time = {at: nearest_m[at] for at in stamps if late_s[at] < tf_wait_s - 0.02}
            if len(in_time) > ENOUGH_SCANS:
                break
        assert len(in_time) > ENOUGH_SCANS
        return [late_s[stamp] for stamp, range_m in in_time.items() if range_m > 3.0]

    assert undisturbed(late_of_bare_s) == []
