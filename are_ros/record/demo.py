"""`are demo`: the live node over DDS, fed with a recording, its outputs recorded."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Final, NamedTuple

from rclpy.node import Node

from are_ros.bag.reader import BagReader
from are_ros.bag.recording import PREFIX
from are_ros.bag.roles import find_roles
from are_ros.errors import BagError, NodeError
from are_ros.messages.sensors import SENSORS
from are_ros.messages.tick_encoding import OUTPUTS
from are_ros.node.diagnostics import WITHOUT_CLOCK
from are_ros.node.message_classes import service_class
from are_ros.node.startup import executor_of, ros_session
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import write_ros_parameters
from are_ros.record.lockstep import ShouldStop
from are_ros.record.player import PlayOutcome, play
from are_ros.record.publishers import PlayOptions, is_listening
from are_ros.record.recorder import NODE_NAME
from are_ros.replay.output_folder import AUGMENTED, earlier_results
from are_ros.replay.progress import OpenProgress, Say
from are_ros.wording import why_refused

NODE: Final = "/ar_builder"
_RECORDER: Final = f"/{NODE_NAME}"
_ROLES: Final = ("map", "octomap_point_cloud_centers", "odom", "scan", "camera/camera_info", "plan")
_ACTIVE: Final = 3
"""lifecycle_msgs/State.PRIMARY_STATE_ACTIVE"""
_LATCHED: Final = tuple(name for name, output in OUTPUTS.items() if output.is_latched)
_LATCHED_DEPTH: Final = 20
"""In lockstep every map is recorded: none may replace one that is under way."""
_READY_S: Final = 600.0
_ASK_S: Final = 0.05
_END_S: Final = 15.0
_WARNING: Final = re.compile(r"^\[(?:WARN|ERROR|FATAL)\] \[[\d.]+\] \[[^]]*\]: (.+)$", re.MULTILINE)
_DOMAINS: Final = range(102, 41, -1)
"""People mostly use low domain ids."""


@dataclass(frozen=True)
class DemoOptions:
    """The options of `are demo`: recording, parameters, folder, rate."""

    bag: Path
    parameters: Parameters
    out: Path
    rate: float = 2.0
    duration_s: float | None = None
    lockstep: bool = False


def run_demo(
    options: DemoOptions, say: Say, open_progress: OpenProgress, should_stop: ShouldStop
) -> PlayOutcome:
    """Run node and recorder as processes of their own, and play to them from this one.

    Leaves augmented.mcap, effective.yaml, node.log and recorder.log in the folder. Raises AreError.
    """
    keep_to_this_machine()
    topics = _read_topics(options)
    options = replace(options, parameters=with_values(options.parameters, topics.sensors))
    _prepare(options)
    with ExitStack() as stack:
        log = options.out / "recorder.log"
        recorder = stack.enter_context(_process(_record_command(options), log))
        log = options.out / "node.log"
        node = stack.enter_context(_process(_node_command(options, topics), log))
        say("starting the node (kernels that are not there yet compile for a minute or two)")
        _await_active((node, recorder), options.out, should_stop)
        playing = _play_options(options, topics.outputs)
        outcome = play(playing, say, open_progress, should_stop)
        _check_alive((node, recorder), options.out)
    for sentence in _warnings(options.out / "node.log"):
        say(sentence)
    if recorder.returncode:
        say(f"the recording is not complete: {options.out / 'recorder.log'} says why")
    return outcome


def keep_to_this_machine() -> None:
    """Keep DDS on this machine, in a domain of its own.

    Before rclpy starts; a ROS_DOMAIN_ID that is set stays.
    """
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.setdefault("ROS_DOMAIN_ID", str(_DOMAINS[os.getpid() % len(_DOMAINS)]))


def _prepare(options: DemoOptions) -> None:
    parameters = options.parameters
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        # beside the metrics of a replay a recording counts as a replay's
        for path in earlier_results(options.out):
            path.unlink(missing_ok=True)
        text = write_ros_parameters(parameters)
        (options.out / "effective.yaml").write_text(text, encoding="utf-8")
    except OSError as cause:
        message = f"--out {options.out}: it cannot be written ({why_refused(cause)})"
        raise BagError(message) from cause


class _Topics(NamedTuple):
    """The topics of a recording that are not named as the node expects them, and its outputs."""

    renamed: Mapping[str, str]
    """Topics by the role that they are remapped to."""
    sensors: Mapping[str, tuple[str, ...]]
    """Those of sensors whose transport is in their name, by parameter."""
    outputs: tuple[str, ...]
    """Those of a node that was recorded, too: they are not played, this node sends its own."""


def _read_topics(options: DemoOptions) -> _Topics:
    """Return the topics of the recording; BagError if it has no map."""
    bag, sensors = options.bag, options.parameters.sensors
    with BagReader([bag]) as reader:
        roles = find_roles(reader.topics, {})
        outputs = tuple(topic.name for topic in reader.topics if PREFIX in topic.name)
    if roles.topic("map") is None:
        raise BagError(
            f"{bag.name}: the recording has no map, and the demo plays no other; "
            "`are replay` with --map FILE and --with-inputs writes a recording that has it"
        )
    found = {role: roles.topic(role) for role in _ROLES}
    renamed = {role: topic for role, topic in found.items() if topic and topic != f"/{role}"}
    others = [kind for role, kind in SENSORS.items() if role not in _ROLES]
    named = {
        f"sensors.{kind.parameter}": (topic,)
        for kind in others
        if kind.is_by_role(sensors) and (topic := roles.topic(kind.role))
    }
    return _Topics(renamed, named, outputs)


def _play_options(options: DemoOptions, outputs: tuple[str, ...]) -> PlayOptions:
    return PlayOptions(
        bags=(options.bag,),
        exclude=outputs,
        rate=options.rate,
        duration_s=options.duration_s,
        lockstep=(NODE, _RECORDER) if options.lockstep else (),
        wait_for=(NODE, _RECORDER),
    )


def _node_command(options: DemoOptions, topics: _Topics) -> list[str]:
    remaps, sensors = topics.renamed, topics.sensors.values()
    command = [sys.executable, "-m", "are_ros", "node", "--use-sim-time"]
    command += ["--params", str(options.out / "effective.yaml"), "--ros-args"]
    for role, topic in remaps.items():
        command += ["-r", f"{role}:={topic}"]
    if options.lockstep:
        roles = ("odom", "scan", "camera/camera_info")
        for topic in (*(remaps.get(role, f"/{role}") for role in roles), *chain(*sensors)):
            command += ["-p", f"qos_overrides.{topic}.subscription.reliability:=reliable"]
        for name in _LATCHED:
            depth = f"qos_overrides.{NODE}/{name}.publisher.depth:={_LATCHED_DEPTH}"
            command += ["-p", depth]
    return command


def _record_command(options: DemoOptions) -> list[str]:
    command = [sys.executable, "-m", "are_ros", "record", str(options.out / AUGMENTED)]
    excluded = ["--exclude", "/rosout", "--exclude", "/parameter_events"]
    return [*command, "--overwrite", "--use-sim-time", *excluded]


@contextmanager
def _process(command: Sequence[str], log: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """Run a process with its output in a file; end it with SIGINT."""
    with log.open("wb") as words:
        process = subprocess.Popen(command, stdout=words, stderr=words)  # noqa: S603 - our own
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                process.wait(_END_S)
            process.kill()
            process.wait()


def _await_active(
    processes: Sequence["subprocess.Popen[bytes]"], out: Path, should_stop: ShouldStop
) -> None:
    """Wait until the node is active and the recorder listens to it.

    NodeError if one ends, or takes too long.
    """
    deadline_s = time.monotonic() + _READY_S
    with ros_session("are_demo") as node, executor_of(node) as executor:
        client = node.create_client(
            service_class("lifecycle_msgs/srv/GetState"), f"{NODE}/get_state"
        )
        while not should_stop():
            _check_alive(processes, out)
            if time.monotonic() > deadline_s:
                raise NodeError(f"the node was not active within {_READY_S:.0f} s: {out}/node.log")
            is_active = client.wait_for_service(0.2) and _state(client, executor) == _ACTIVE
            if is_active and _is_recorded(node):
                return
            time.sleep(_ASK_S)


def _is_recorded(node: Node) -> bool:
    """Return whether the recorder subscribes to all outputs of the node."""
    return all(
        is_listening(node, _RECORDER, [f"{NODE}/{name}"])
        for name in OUTPUTS
        if node.count_publishers(f"{NODE}/{name}")
    )


def _state(client: Any, executor: Any) -> int:
    """Return the node's lifecycle state, 0 if it does not answer within a second."""
    future = client.call_async(client.srv_type.Request())
    executor.spin_until_future_complete(future, timeout_sec=1.0)
    return int(future.result().current_state.id) if future.done() else 0


def _warnings(log: Path) -> list[str]:
    """Return what a log warns of, each sentence once; the clock begins with the recording."""
    words = log.read_text(encoding="utf-8", errors="replace")
    return [said for said in dict.fromkeys(_WARNING.findall(words)) if said != WITHOUT_CLOCK]


def _check_alive(processes: Sequence["subprocess.Popen[bytes]"], out: Path) -> None:
    for process, name in zip(processes, ("node", "recorder"), strict=True):
        if process.poll() is not None:
            words = (out / f"{name}.log").read_text(encoding="utf-8", errors="replace")
            lines = words.strip().splitlines() or ["it said nothing"]
            raise NodeError(f"the {name} ended early: {lines[-1]}")
