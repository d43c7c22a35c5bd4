"""/diagnostics: the snapshot of the node, the status of each part, and the reporter.

See docs/diagnostics.md for the page of the user.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Final

from are_ros.agents.events import ArtefactEvent, EventKind
from are_ros.builder.ar_builder import ArBuilder
from are_ros.conventions import NEVER_NS, NS_PER_S
from are_ros.messages.cdr import CdrWriter
from are_ros.messages.sensors import SENSORS, noun_of
from are_ros.node.live_builder import LiveBuilder
from are_ros.node.watches import (
    GRACE_S,
    LATELY_NS,
    MINUTE_NS,
    PREPARING,
    CountWatch,
    FaultWatch,
    InputSnapshot,
    Lasting,
    TickFigures,
)
from are_ros.wording import counted, several

if TYPE_CHECKING:
    from rclpy.node import Node

    from are_ros.node.topics import Subscriptions

# A line of the diagnostics.


class Level(IntEnum):
    """The levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class Status:
    """The status of one part of the node: a sentence and its figures."""

    level: Level
    name: str
    message: str
    values: Mapping[str, str] = field(default_factory=dict)


def figure(value: float | None, unit: str, digits: int = 1) -> str:
    """Return a number with its unit, "-" where there is none."""
    if value is None:
        return "-"
    return f"{value:.{digits}f} {unit}".rstrip()


# The state of a node at one moment, as plain values.


class NodeState(Enum):
    """The states of a lifecycle node in which it rests."""

    UNCONFIGURED = "unconfigured"
    INACTIVE = "inactive"
    ACTIVE = "active"
    FINALIZED = "finalized"


@dataclass(frozen=True)
class SensorSnapshot:
    """The augmented readings of a topic: totals, and those recently passed through unchanged.

    `role` is the kind of the sensor, a key of `SENSORS`.
    """

    topic: str
    role: str = "scan"
    exact: int = 0
    held: int = 0
    passed_through: int = 0
    passed_through_lately: int = 0
    """In the last 10 s."""
    last_problem: str = ""
    late_s: float = 0.0
    """The largest delay of a transform behind its reading, of those recently too late."""


@dataclass(frozen=True)
class PopulationSnapshot:
    """The counts of the population: totals, and arrivals in the last minute."""

    alive: int = 0
    arrivals: int = 0
    departures: int = 0
    blocked: int = 0
    displaced: int = 0
    arrivals_lately: int = 0
    blocked_lately: int = 0
    """Artefacts without a feasible pose; not part of `arrivals`."""
    is_map_closed: bool = False
    """There is a map, but no free cell in it."""
    doubt_about_region: str = ""
    """Where nobody can arrive though map and robot are known, and why."""


@dataclass(frozen=True)
class NodeSnapshot:
    """The node at one moment. A problem is one sentence, empty where there is none.

    `active_s` is for how long the node has been active, 0 while it is not. `robot_problem` and
    `camera_problem` say why the pose of the robot or of its camera in the map is not known.
    """

    state: NodeState
    is_paused: bool = False
    namesake: str = ""
    """The name that this node shares with another one, empty where it is its own."""
    active_s: float = 0.0
    uses_sim_time: bool = False
    is_without_clock: bool = False
    """It uses simulated time, and no /clock has come yet, or only 0: rclpy knows no difference."""
    clocks: int = 0
    """How many publish the /clock that it uses; 0 unless there have been several for a while."""
    stamps_ahead_s: float | None = None
    """How much later than the node's time the newest transform is stamped; None without one."""
    inputs: tuple[InputSnapshot, ...] = ()
    robot_problem: str = ""
    robot_beyond: str = ""
    """That the robot's pose is known, and not on the map."""
    awaits_robot: bool = False
    """Nobody arrives before the robot's pose is known."""
    camera_problem: str = ""
    cloud_problem: str = ""
    """Why the cloud of voxels that was received is not used yet."""
    ticks: TickFigures | None = None
    busy_ms: Mapping[str, float] = field(default_factory=dict)
    """The longest time without an answer in the last minute, by kind of work."""
    population: PopulationSnapshot = field(default_factory=PopulationSnapshot)
    contacts: int = 0
    last_contact: str = ""
    """As "person_adult 7, 0.05 m deep"."""
    last_contact_age_s: float = math.inf
    sensors: tuple[SensorSnapshot, ...] = ()
    faults: FaultWatch = field(default_factory=FaultWatch)


# The status of an input.


_STALE_PERIODS: Final = 5.0
_STALE_S: Final = 1.0


def input_status(entry: InputSnapshot, active_s: float) -> Status:
    """Return the status of an input of a node that has been active for `active_s`."""
    level, message = _verdict(entry, active_s)
    values = {
        "topic": entry.topic,
        "publishers": str(entry.publishers),
        "messages": str(entry.count),
        "refused": str(entry.refused),
        "rate": figure(entry.rate_hz, "Hz"),
        "age": figure(entry.age_s, "s"),
        "last refusal": entry.last_refusal or "-",
    }
    return Status(level, f"inputs/{entry.role}", message, values)


def _verdict(entry: InputSnapshot, active_s: float) -> tuple[Level, str]:
    if entry.age_s is None:
        return _nothing_yet(entry, active_s)
    if _is_stale(entry):
        rate = figure(entry.rate_hz, "Hz")
        age = figure(entry.age_s, "s")
        return Level.STALE, f"it has stopped: it came at {rate}, and the last one is {age} old"
    if entry.is_required and entry.refused == entry.count:
        refused = counted(entry.count, "message")
        return Level.ERROR, f"{refused}, none of use; the last: {entry.last_refusal}"
    if entry.refused_lately:
        refused = counted(entry.refused_lately, "message")
        return Level.WARN, f"{refused} refused in the last 10 s; the last: {entry.last_refusal}"
    if entry.is_latched or entry.rate_hz is None:
        received = counted(entry.count, "message")
        return Level.OK, f"{received}, the last {figure(entry.age_s, 's')} ago"
    return Level.OK, figure(entry.rate_hz, "Hz")


def _nothing_yet(entry: InputSnapshot, active_s: float) -> tuple[Level, str]:
    if not entry.is_required:
        if active_s >= GRACE_S and _is_mistyped(entry):
            return Level.WARN, f"no message yet{_why_nothing(entry)}"
        is_silent = entry.publishers and not entry.is_latched and not _is_new(entry)
        why = _why_nothing(entry) if is_silent else "; the node works without"
        return Level.OK, f"no message yet{why}"
    if active_s < GRACE_S or _is_new(entry):
        return Level.OK, "no message yet"
    return Level.ERROR, f"no message for {active_s:.0f} s{_why_nothing(entry)}"


def _why_nothing(entry: InputSnapshot) -> str:
    if not entry.publishers:
        return f": nobody publishes {entry.topic}"
    if entry.mistyped:
        return f": {entry.topic} is published as {entry.mistyped}"
    publishers = counted(entry.publishers, "publisher")
    asked = f"is its QoS compatible (the node asks for {entry.asked})?"
    return f", though {entry.topic} has {publishers}; {asked}"


def _is_mistyped(entry: InputSnapshot) -> bool:
    """Tell whether its publishers have sent another type for so long that it is meant so."""
    return bool(entry.mistyped) and not _is_new(entry)


def _is_new(entry: InputSnapshot) -> bool:
    """Tell whether a publisher has come so lately that nothing need have come from it."""
    return bool(entry.publishers) and entry.published_s < GRACE_S


def input_doubts(snapshot: NodeSnapshot) -> list[str]:
    """Return a sentence for each input of which nothing comes, though it is required or published.

    Of those that are not required only such as are published as another type are told.
    """
    if snapshot.active_s < GRACE_S:
        return []
    lacking = [one for one in _lacking(snapshot) if not _is_new(one)]
    lacking += [one for one in snapshot.inputs if _is_mistyped(one) and not one.is_required]
    return [f"no message of {one.topic} yet{_why_nothing(one)}" for one in lacking]


def _lacking(snapshot: NodeSnapshot) -> list[InputSnapshot]:
    return [one for one in snapshot.inputs if one.is_required and one.age_s is None]


def robot_doubt(snapshot: NodeSnapshot) -> str:
    """Return the sentence about a pose of the robot that has not come for a while, or is off.

    It is "" if the robot is on the map. Without the required inputs or a time there is none: those
    come first.
    """
    is_early = snapshot.active_s < GRACE_S or bool(_lacking(snapshot))
    if is_early or snapshot.is_without_clock:
        return ""
    if snapshot.robot_problem:
        nobody = " and nobody arrives" if snapshot.awaits_robot else ""
        return f"no pose of the robot, so nothing is perceived{nobody}: {snapshot.robot_problem}"
    return snapshot.robot_beyond


def _is_stale(entry: InputSnapshot) -> bool:
    age_s, period_s = entry.age_s, entry.period_s
    if entry.is_latched or age_s is None or period_s is None:
        return False
    return age_s > _STALE_S and age_s > _STALE_PERIODS * period_s


_CONTACT_S: Final = 5.0
_TICK_STOP_S: Final = 1.0
_TICK_STOP_PERIODS: Final = 5.0
_RARE: Final = frozenset({PREPARING, "transitions"})
"""These kinds of work may take longer than a tick's period without a warning."""
_OTHER_TIMES_S: Final = 30 * 86_400.0
"""Clocks of machines that are set wrongly are less apart; simulated time is by decades."""
_YEAR_S: Final = 365.25 * 86_400.0
_BLOCKED_SHARE: Final = 0.5
_FEWEST_ARRIVALS: Final = 4
"""Of fewer arrivals in a minute no share is worth a warning."""
_STATES: Final = {
    NodeState.UNCONFIGURED: "unconfigured: nothing is received and nothing published",
    NodeState.INACTIVE: "inactive: the real map is relayed",
    NodeState.ACTIVE: "active",
    NodeState.FINALIZED: "finalized: the node has shut down",
}


def statuses(snapshot: NodeSnapshot) -> list[Status]:
    """Return the status of each part of the node.

    Of an inactive node, and of one without a time on /clock, these are state, clock and inputs; of
    an unconfigured one, state and clock.
    """
    found = [_state(snapshot), _clock(snapshot)]
    found += [input_status(entry, snapshot.active_s) for entry in snapshot.inputs]
    if snapshot.state is not NodeState.ACTIVE or snapshot.is_without_clock:
        return found
    found += [
        *_frames(snapshot),
        _ticks(snapshot),
        _answers(snapshot),
        _population(snapshot),
        _behaviours(snapshot),
        _contacts(snapshot),
    ]
    return found + [_sensor(sensor) for sensor in snapshot.sensors]


def encode_diagnostics(
    stamp_ns: int, found: Sequence[Status], node_name: str = "ar_builder"
) -> bytes:
    """Return a diagnostic_msgs/DiagnosticArray; its names are as "ar_builder: inputs/scan"."""
    writer = CdrWriter()
    writer.header("", stamp_ns)
    writer.count(len(found))
    for status in found:
        writer.byte(status.level)
        for text in (f"{node_name}: {status.name}", status.message, "are_ros"):
            writer.text(text)
        writer.count(len(status.values))
        for key, value in status.values.items():
            writer.text(key)
            writer.text(value)
    return writer.message()


def _state(snapshot: NodeSnapshot) -> Status:
    message = _STATES[snapshot.state]
    if snapshot.state is NodeState.ACTIVE and snapshot.is_paused:
        message = "paused: the real map is relayed"
    values = {"state": snapshot.state.value, "paused": "yes" if snapshot.is_paused else "no"}
    if snapshot.namesake:
        return Status(Level.WARN, "state", f"{message}; {name_doubt(snapshot)}", values)
    return Status(Level.OK, "state", message, values)


def name_doubt(snapshot: NodeSnapshot) -> str:
    """Return a warning if another node has the name of this one; else ""."""
    if not snapshot.namesake:
        return ""
    return (
        f"another node is called {snapshot.namesake}, too: they publish on the same topics; "
        "end one, or give one a namespace (--namespace)"
    )


WITHOUT_CLOCK: Final = (
    "use_sim_time is true, but nothing or only 0 came on /clock, as of a simulator that is paused: "
    "the time stands still"
)


def _clock(snapshot: NodeSnapshot) -> Status:
    values = {"use_sim_time": "true" if snapshot.uses_sim_time else "false"}
    if snapshot.is_without_clock:
        return Status(Level.ERROR, "clock", WITHOUT_CLOCK, values)
    if doubt := clock_doubt(snapshot):
        return Status(Level.ERROR, "clock", doubt, values)
    message = "the time of /clock" if snapshot.uses_sim_time else "the time of this machine"
    return Status(Level.OK, "clock", message, values)


def clock_doubt(snapshot: NodeSnapshot) -> str:
    """Return a warning about a clock that stays away, two, or one days off the stamps; else ""."""
    if snapshot.is_without_clock and snapshot.active_s >= GRACE_S:
        return WITHOUT_CLOCK
    if snapshot.clocks > 1:
        return (
            f"{snapshot.clocks} publishers give /clock (two players, or a simulator and a player): "
            "the time jumps to and fro between them; end all but one"
        )
    ahead_s = snapshot.stamps_ahead_s
    if ahead_s is None or abs(ahead_s) < _OTHER_TIMES_S:
        return ""
    side = "later" if ahead_s > 0.0 else "earlier"
    apart = f"{abs(ahead_s) / _YEAR_S:.1f} years {side} than the time of"
    if snapshot.uses_sim_time:
        return (
            f"transforms are stamped {apart} /clock: is use_sim_time set by mistake, "
            "or does another recording give the clock?"
        )
    return (
        f"transforms are stamped {apart} this machine: for a simulated robot or one that is "
        "played from a recording, start the node with --use-sim-time (use_sim_time:=true)"
    )


def _frames(snapshot: NodeSnapshot) -> list[Status]:
    """Return whether robot, camera and cloud have their place, the first two after a while."""
    is_begun = snapshot.active_s >= GRACE_S
    no_robot, no_camera = (Level.ERROR, Level.WARN) if is_begun else (Level.OK, Level.OK)
    robot, camera, cloud = snapshot.robot_problem, snapshot.camera_problem, snapshot.cloud_problem
    known = "its pose in the map is known"
    parts = [
        ("frames/robot", robot and f"no pose of the robot: {robot}", no_robot, known),
        ("frames/camera", camera and f"nothing is perceived: {camera}", no_camera, known),
        (
            "cloud",
            cloud and f"the cloud of voxels is not used yet: {cloud}",
            Level.WARN,
            "no cloud waits",
        ),
    ]
    if not robot:
        parts[0] = ("frames/robot", snapshot.robot_beyond, Level.WARN, known)
    return [
        Status(level, name, said) if said else Status(Level.OK, name, fine)
        for name, said, level, fine in parts
    ]


FALLS_BEHIND: Final = "the node does not keep up with its clock"


def load_doubt(snapshot: NodeSnapshot) -> str:
    """Return a warning if ticks are left out again and again; else ""."""
    if snapshot.ticks is None or snapshot.ticks.left_out == 0:
        return ""
    return (
        f"{FALLS_BEHIND}: ticks are left out, and readings come late or without artefacts; fewer "
        "artefacts or sensors, or a lower builder.tick_rate are less work (see /diagnostics)"
    )


def _ticks(snapshot: NodeSnapshot) -> Status:
    ticks = snapshot.ticks
    if ticks is None or ticks.age_s is None:
        return Status(Level.OK, "ticks", "no tick yet")
    values = {
        "ticks": str(ticks.count),
        "skipped": str(ticks.skipped),
        "late": str(ticks.late),
        "period": figure(1e3 * ticks.period_s, "ms"),
        "p50": figure(ticks.p50_ms, "ms"),
        "p99": figure(ticks.p99_ms, "ms"),
        "longest": figure(ticks.max_ms, "ms"),
    }
    is_over = ticks.age_s > max(_TICK_STOP_S, _TICK_STOP_PERIODS * ticks.period_s)
    if is_over and not snapshot.is_paused:
        message = f"the last tick was {ticks.age_s:.1f} s ago: the time stands still, or one hangs"
        return Status(Level.STALE, "ticks", message, values)
    durations = f"p50 {figure(ticks.p50_ms, 'ms')}, p99 {figure(ticks.p99_ms, 'ms')}"
    if ticks.left_out > 0:
        message = f"{ticks.left_out} were left out in the last minute: {FALLS_BEHIND}; {durations}"
        return Status(Level.WARN, "ticks", message, values)
    if ticks.over > 1 and ticks.p99_ms is not None and ticks.p99_ms > 1e3 * ticks.period_s:
        message = f"ticks take longer than their period, {values['period']}: {durations}"
        return Status(Level.WARN, "ticks", message, values)
    return Status(Level.OK, "ticks", durations, values)


def _answers(snapshot: NodeSnapshot) -> Status:
    longest_ms = snapshot.busy_ms
    values = {what: figure(duration_ms, "ms") for what, duration_ms in longest_ms.items()}
    if not longest_ms:
        return Status(Level.OK, "answers", "nothing was asked", values)
    period_ms = 1e3 * snapshot.ticks.period_s if snapshot.ticks else math.inf
    usual_ms = {what: took for what, took in longest_ms.items() if what not in _RARE}
    what, took_ms = max((usual_ms or longest_ms).items(), key=itemgetter(1))
    message = f"none took longer than {figure(took_ms, 'ms')} ({what}) in the last minute"
    if usual_ms and took_ms > period_ms:
        message = f"for {figure(took_ms, 'ms')} the node did not answer: {what}"
        return Status(Level.WARN, "answers", message, values)
    return Status(Level.OK, "answers", message, values)


def _population(snapshot: NodeSnapshot) -> Status:
    counts = snapshot.population
    offered = counts.arrivals_lately + counts.blocked_lately
    share = counts.blocked_lately / offered if offered else None
    values = {
        "alive": str(counts.alive),
        "arrivals": str(counts.arrivals),
        "departures": str(counts.departures),
        "blocked": str(counts.blocked),
        "displaced": str(counts.displaced),
        "blocked in the last minute": figure(None if share is None else 100 * share, "%", 0),
    }
    if counts.is_map_closed:
        message = "the map has no free cell: nobody can arrive"
        return Status(Level.WARN, "population", message, values)
    if counts.doubt_about_region:
        return Status(Level.WARN, "population", counts.doubt_about_region, values)
    if share is not None and share > _BLOCKED_SHARE and offered >= _FEWEST_ARRIVALS:
        message = (
            f"{counts.blocked_lately} of {offered} that were to arrive in the last minute found "
            "no place: fewer (population.arrival_rate), or a larger region or max_alive"
        )
        return Status(Level.WARN, "population", message, values)
    return Status(Level.OK, "population", f"{counted(counts.alive, 'artefact')} alive", values)


def _behaviours(snapshot: NodeSnapshot) -> Status:
    faults = snapshot.faults
    values = {name: f"{count} failed" for name, count in sorted(faults.counts.items())}
    said = [faults.hung] if faults.hung else []
    if faults.counts:
        who = counted(sum(faults.counts.values()), "artefact")
        said.append(f"the behaviour of {who} has failed, and they stand; the last: {faults.last}")
    if not said:
        return Status(Level.OK, "behaviours", "none failed", values)
    return Status(Level.WARN, "behaviours", "; ".join(said), values)


def _contacts(snapshot: NodeSnapshot) -> Status:
    last, age_s = snapshot.last_contact, snapshot.last_contact_age_s
    values = {"contacts": str(snapshot.contacts), "last": last or "-"}
    if age_s <= _CONTACT_S:
        message = f"the robot has touched {last}, {age_s:.1f} s ago"
        return Status(Level.WARN, "robot contact", message, values)
    return Status(Level.OK, "robot contact", counted(snapshot.contacts, "contact"), values)


def _sensor(sensor: SensorSnapshot) -> Status:
    name = f"{SENSORS[sensor.role].parameter}/{sensor.topic.lstrip('/')}"
    noun = noun_of(sensor.role)
    values = {
        "exact": str(sensor.exact),
        "held": str(sensor.held),
        "passed through": str(sensor.passed_through),
        "last problem": sensor.last_problem or "-",
        "late transforms": figure(sensor.late_s or None, "s", 3),
    }
    if sensor.passed_through_lately:
        passed = counted(sensor.passed_through_lately, noun)
        message = f"{passed} without artefacts in the last 10 s: {sensor.last_problem}"
        if sensor.late_s:
            needed_s = math.ceil(100.0 * sensor.late_s + 1.0) / 100.0
            message += (
                f"; transforms come up to {sensor.late_s:.3f} s after the {several(noun)}: "
                f"set sensors.tf_wait to {needed_s:.2f}"
            )
        return Status(Level.WARN, name, message, values)
    augmented = counted(sensor.exact + sensor.held, noun)
    return Status(Level.OK, name, f"{augmented} augmented", values)


# The snapshot is taken and published once a second.


_KILLED_S: Final = 30.0
"""DDS forgets a process that was killed after up to 20 s; its successor is no second one."""


class Reporter:
    """Gathers the diagnostics from the node's parts and publishes them; times are monotonic.

    `active_since_ns` is None while the node is not active.
    """

    active_since_ns: int | None = None
    is_shut_down = False

    def __init__(self, node: "Node", publisher: Any) -> None:
        self._node = node
        self._publisher = publisher
        self._blocked, self._arrived = CountWatch(MINUTE_NS), CountWatch(MINUTE_NS)
        self._passed: dict[str, CountWatch] = {}
        self._last_contact, self._contact_ns = "", NEVER_NS
        self._has_namesake, self._has_clocks = Lasting(_KILLED_S), Lasting(_KILLED_S)
        self._is_lost = Lasting(GRACE_S)
        self.doubts: tuple[str, ...] = ()
        """Warnings for the log: about clock, name and load, and what does not come."""
        self._without_robot = ""
        """What was wrong at first: the sentence changes with the time."""

    def happened(self, events: tuple[ArtefactEvent, ...], now_ns: int) -> None:
        """Take the events since the last tick; the last contact of the robot is kept."""
        for event in events:
            if event.kind is EventKind.ROBOT_CONTACT:
                self._last_contact = f"{event.label} {event.artefact_id}, {event.value:.2f} m deep"
                self._contact_ns = now_ns

    def report(
        self,
        live: LiveBuilder | None,
        subscriptions: "Subscriptions | None",
        busy_ms: Mapping[str, float],
        now_ns: int,
        *,
        is_paused: bool,
    ) -> None:
        """Publish the diagnostics of this moment."""
        stamp_ns = int(self._node.get_clock().now().nanoseconds)
        uses_sim_time = bool(self._node.get_parameter("use_sim_time").value)
        since_ns = self.active_since_ns
        snapshot = NodeSnapshot(
            state=self._state(live),
            is_paused=is_paused,
            namesake=self._namesake(now_ns),
            active_s=0.0 if since_ns is None else (now_ns - since_ns) / NS_PER_S,
            busy_ms=busy_ms,
            uses_sim_time=uses_sim_time,
            is_without_clock=uses_sim_time and not stamp_ns,
            clocks=self._clocks(now_ns) if uses_sim_time else 0,
            inputs=tuple(subscriptions.snapshots(now_ns)) if subscriptions else (),
            **(self._of_builder(live, now_ns) if live else {}),
        )
        doubt = robot_doubt(snapshot)
        if not doubt:
            self._without_robot = ""
        if self._is_lost.see(now_ns, holds=bool(doubt)):
            self._without_robot = self._without_robot or doubt
        doubts = [clock_doubt(snapshot), name_doubt(snapshot), load_doubt(snapshot)]
        doubts.append(self._without_robot)
        doubts += input_doubts(snapshot)
        self.doubts = tuple(doubt for doubt in doubts if doubt)
        name = self._node.get_fully_qualified_name().lstrip("/")
        self._publisher.publish(encode_diagnostics(stamp_ns, statuses(snapshot), name))

    def _namesake(self, now_ns: int) -> str:
        """Return the name of this node if another one has had it for a while; else ""."""
        own = self._node.get_name(), self._node.get_namespace()
        is_shared = self._node.get_node_names_and_namespaces().count(own) > 1
        is_lasting = self._has_namesake.see(now_ns, holds=is_shared)
        return self._node.get_fully_qualified_name() if is_lasting else ""

    def _clocks(self, now_ns: int) -> int:
        """Return how many publish /clock; 0 unless there have been several for a while."""
        clocks = self._node.count_publishers("/clock")
        return clocks if self._has_clocks.see(now_ns, holds=clocks > 1) else 0

    def _state(self, live: LiveBuilder | None) -> NodeState:
        if self.is_shut_down:
            return NodeState.FINALIZED
        if live is None:
            return NodeState.UNCONFIGURED
        return NodeState.INACTIVE if self.active_since_ns is None else NodeState.ACTIVE

    def _of_builder(self, live: LiveBuilder, now_ns: int) -> dict[str, Any]:
        """Return the fields of the snapshot that a configured node has."""
        builder = live.builder
        frame = builder.world.missing_frame()
        return {
            "stamps_ahead_s": self._stamps_ahead_s(builder),
            "robot_problem": builder.robots.missing,
            "robot_beyond": _beyond(builder),
            "awaits_robot": builder.lives.awaits_robot,
            "camera_problem": _camera_problem(builder),
            "cloud_problem": f"nothing joins its frame '{frame}' to the map" if frame else "",
            "ticks": live.watch.figures(now_ns),
            "population": self._population(builder, now_ns),
            "contacts": builder.lives.crowd.contacts.count,
            "last_contact": self._last_contact,
            "last_contact_age_s": (now_ns - self._contact_ns) / NS_PER_S,
            "faults": live.faults,
            "sensors": tuple(self._sensors(live, now_ns)),
        }

    def _stamps_ahead_s(self, builder: ArBuilder) -> float | None:
        """Return how much later than the node's time the newest transform is stamped."""
        clock_ns = int(self._node.get_clock().now().nanoseconds)
        stamps_ns = [edge.last_ns for edge in builder.frames.edges() if not edge.is_static]
        return (max(stamps_ns) - clock_ns) / NS_PER_S if stamps_ns and clock_ns else None

    def _population(self, builder: ArBuilder, now_ns: int) -> PopulationSnapshot:
        lives = builder.lives
        counts = lives.population.counts
        self._arrived.update(now_ns, counts.arrived)
        self._blocked.update(now_ns, counts.blocked)
        has_free_cells = builder.world.has_free_cells
        return PopulationSnapshot(
            alive=len(lives.population.living),
            arrivals=counts.arrived,
            departures=counts.departed,
            blocked=counts.blocked,
            displaced=lives.crowd.counts.displaced,
            arrivals_lately=self._arrived.growth(now_ns),
            blocked_lately=self._blocked.growth(now_ns),
            is_map_closed=builder.world.grid is not None and not has_free_cells,
            doubt_about_region=builder.doubt_about_region,
        )

    def _sensors(self, live: LiveBuilder, now_ns: int) -> Iterator[SensorSnapshot]:
        builder = live.builder
        problems, late_ns = builder.sensors.problems(), builder.sensors.late_ns()
        for topic, counts in builder.sensors.counts().items():
            watch = self._passed.setdefault(topic, CountWatch(LATELY_NS))
            watch.update(now_ns, counts.passed_through)
            yield SensorSnapshot(
                topic=topic,
                role=live.sensors[topic].role,
                exact=counts.exact,
                held=counts.held,
                passed_through=counts.passed_through,
                passed_through_lately=watch.growth(now_ns),
                last_problem=problems.get(topic, ""),
                late_s=late_ns.get(topic, 0) / NS_PER_S,
            )


def _beyond(builder: ArBuilder) -> str:
    """Return the sentence about a robot that is not on the map; empty if it is, or not known."""
    robot, grid = builder.robots.last, builder.world.grid
    if robot is None or grid is None or builder.robots.missing:
        return ""
    x_m, y_m, _ = robot.map_from_base.translation_m.tolist()
    place = f"x {x_m:.1f} m, y {y_m:.1f} m"
    sentence = f"the robot is beyond the map, at {place}: is it localised on this map?"
    return "" if grid.cell_at(x_m, y_m) else sentence


def _camera_problem(builder: ArBuilder) -> str:
    if builder.camera is None:
        return "no CameraInfo came yet"
    if builder.world.environment is None:
        return "there is no map yet"
    awaited = (k for k, camera in enumerate(builder.cameras) if camera is None)
    if (missing := next(awaited, 0)) > 0:
        return f"no CameraInfo of {builder.parameters.camera.others[missing - 1]} came yet"
    return builder.camera_missing
