"""The diagnostics: a snapshot of the node, and the status of each part (docs/diagnostics.md)."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from operator import itemgetter
from typing import Any, Final

from are_ros.conventions import NS_PER_S
from are_ros.messages.common import MessageFactory, make_header
from are_ros.node.watches import BusyFigures, FaultSnapshot, InputFigures, TickFigures
from are_ros.wording import counted

# A line of the diagnostics.


class Level(IntEnum):
    """The levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class Status:
    """What is said about one part of the node: a sentence, and the figures behind it."""

    level: Level
    name: str
    message: str
    values: Mapping[str, str] = field(default_factory=dict)


def figure(value: float | None, unit: str = "", digits: int = 1) -> str:
    """Return a number with its unit, "-" where there is none."""
    if value is None:
        return "-"
    return f"{value:.{digits}f} {unit}".rstrip()


# What there is to say about a node at one moment, as plain values.


class NodeState(Enum):
    """The states of a lifecycle node in which it rests."""

    UNCONFIGURED = "unconfigured"
    INACTIVE = "inactive"
    ACTIVE = "active"
    FINALIZED = "finalized"


@dataclass(frozen=True)
class InputSnapshot:
    """An input: its role, the full name of its topic, and what came in."""

    role: str
    topic: str
    figures: InputFigures = field(default_factory=InputFigures)
    is_required: bool = False
    is_latched: bool = False
    """It comes once, or when it changes; so it never goes stale."""
    publishers: int = 0


@dataclass(frozen=True)
class ScanSnapshot:
    """How the scans of a topic left: in all, and as they came, without artefacts, of late."""

    topic: str
    exact: int = 0
    held: int = 0
    passed_through: int = 0
    passed_through_lately: int = 0
    """In the last 10 s."""
    last_problem: str = ""
    late_s: float = 0.0
    """How long after a scan its transform came, at most, of those that came too late lately."""


@dataclass(frozen=True)
class PopulationSnapshot:
    """The counts of the population since the start, and of arrivals in the last minute."""

    alive: int = 0
    arrivals: int = 0
    departures: int = 0
    blocked: int = 0
    displaced: int = 0
    arrivals_lately: int = 0
    blocked_lately: int = 0
    """Artefacts that found no place; `arrivals` holds none of them."""
    is_map_closed: bool = False
    """There is a map, but no free cell in it."""


@dataclass(frozen=True)
class ContactSnapshot:
    """The robot's contacts with artefacts: how many, and how long ago which was the last."""

    count: int = 0
    last: str = ""
    """As "person_adult 7, 0.05 m deep"."""
    last_age_s: float | None = None


@dataclass(frozen=True)
class NodeSnapshot:
    """The node at one moment. A problem is one sentence, empty where there is none.

    `active_s` is for how long the node has been active, 0 while it is not. `robot_problem` and
    `camera_problem` say why the pose of the robot or of its camera in the map is not known.
    """

    state: NodeState
    is_paused: bool = False
    active_s: float = 0.0
    uses_sim_time: bool = False
    is_without_clock: bool = False
    """It uses simulated time, and no /clock has come yet."""
    stamps_ahead_s: float | None = None
    """How much later than the node's time the newest transform is stamped; None without one."""
    inputs: tuple[InputSnapshot, ...] = ()
    robot_problem: str = ""
    camera_problem: str = ""
    cloud_problem: str = ""
    """Why the cloud of voxels that was received is not used yet."""
    ticks: TickFigures | None = None
    busy: BusyFigures = field(default_factory=BusyFigures)
    population: PopulationSnapshot = field(default_factory=PopulationSnapshot)
    contacts: ContactSnapshot = field(default_factory=ContactSnapshot)
    scans: tuple[ScanSnapshot, ...] = ()
    faults: FaultSnapshot = field(default_factory=FaultSnapshot)


# What the diagnostics say of an input.


GRACE_S: Final = 5.0
"""For so long after activation nothing that is missing is an error."""
_STALE_PERIODS: Final = 5.0
_STALE_S: Final = 1.0


def input_status(entry: InputSnapshot, active_s: float) -> Status:
    """Return the status of an input of a node that has been active for `active_s`."""
    level, message = _verdict(entry, active_s)
    figures = entry.figures
    values = {
        "topic": entry.topic,
        "publishers": str(entry.publishers),
        "messages": str(figures.count),
        "refused": str(figures.refused),
        "rate": figure(figures.rate_hz, "Hz"),
        "age": figure(figures.age_s, "s"),
        "last refusal": figures.last_refusal or "-",
    }
    return Status(level, f"inputs/{entry.role}", message, values)


def _verdict(entry: InputSnapshot, active_s: float) -> tuple[Level, str]:
    figures = entry.figures
    if figures.age_s is None:
        return _nothing_yet(entry, active_s)
    if _is_stale(entry):
        rate = figure(figures.rate_hz, "Hz")
        age = figure(figures.age_s, "s")
        return Level.STALE, f"it has stopped: it came at {rate}, and the last one is {age} old"
    if entry.is_required and figures.refused == figures.count:
        refused = counted(figures.count, "message")
        return Level.ERROR, f"{refused}, none of use; the last: {figures.last_refusal}"
    if figures.refused_lately:
        refused = counted(figures.refused_lately, "message")
        return Level.WARN, f"{refused} refused in the last 10 s; the last: {figures.last_refusal}"
    if entry.is_latched or figures.rate_hz is None:
        received = counted(figures.count, "message")
        return Level.OK, f"{received}, the last {figure(figures.age_s, 's')} ago"
    return Level.OK, figure(figures.rate_hz, "Hz")


def _nothing_yet(entry: InputSnapshot, active_s: float) -> tuple[Level, str]:
    if not entry.is_required:
        return Level.OK, "no message yet; the node works without"
    if active_s < GRACE_S:
        return Level.OK, "no message yet"
    if not entry.publishers:
        return Level.ERROR, f"no message for {active_s:.0f} s: nobody publishes {entry.topic}"
    reason = f"{entry.topic} has {counted(entry.publishers, 'publisher')}; is its QoS compatible?"
    return Level.ERROR, f"no message for {active_s:.0f} s, though {reason}"


def _is_stale(entry: InputSnapshot) -> bool:
    age_s, period_s = entry.figures.age_s, entry.figures.period_s
    if entry.is_latched or age_s is None or period_s is None:
        return False
    return age_s > _STALE_S and age_s > _STALE_PERIODS * period_s


_CONTACT_S: Final = 5.0
_TICK_STOP_S: Final = 1.0
_TICK_STOP_PERIODS: Final = 5.0
_RARE: Final = frozenset({"preparing", "transitions"})
"""What may take longer than a tick's period, and is no reason to warn."""
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
    """Return what is said of each part of the node.

    Of an inactive node these are state, clock and inputs; of an unconfigured one, state and clock.
    """
    found = [_state(snapshot), _clock(snapshot)]
    found += [input_status(entry, snapshot.active_s) for entry in snapshot.inputs]
    if snapshot.state is not NodeState.ACTIVE:
        return found
    found += [_robot(snapshot), _camera(snapshot), _cloud(snapshot)]
    found += [
        _ticks(snapshot),
        _answers(snapshot),
        _population(snapshot),
        _behaviours(snapshot),
        _contacts(snapshot),
    ]
    return found + [_scan(scan) for scan in snapshot.scans]


def make_diagnostics(
    factory: MessageFactory, stamp_ns: int, found: Iterable[Status], node_name: str = "ar_builder"
) -> Any:
    """Return a diagnostic_msgs/DiagnosticArray; its names are as "ar_builder: inputs/scan"."""
    message = "diagnostic_msgs/msg/DiagnosticArray"
    header = make_header(factory, "", stamp_ns)
    entries = [_message(factory, status, node_name) for status in found]
    return factory.make(message, header=header, status=entries)


def _message(factory: MessageFactory, status: Status, node_name: str) -> Any:
    values = [
        factory.make("diagnostic_msgs/msg/KeyValue", key=key, value=value)
        for key, value in status.values.items()
    ]
    return factory.make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=int(status.level),
        name=f"{node_name}: {status.name}",
        message=status.message,
        hardware_id="are_ros",
        values=values,
    )


def _state(snapshot: NodeSnapshot) -> Status:
    message = _STATES[snapshot.state]
    if snapshot.state is NodeState.ACTIVE and snapshot.is_paused:
        message = "paused: the real map is relayed"
    values = {"state": snapshot.state.value, "paused": "yes" if snapshot.is_paused else "no"}
    return Status(Level.OK, "state", message, values)


def _clock(snapshot: NodeSnapshot) -> Status:
    values = {"use_sim_time": "true" if snapshot.uses_sim_time else "false"}
    if snapshot.uses_sim_time and snapshot.is_without_clock:
        message = "use_sim_time is true, but nothing came on /clock: the time stands still"
        return Status(Level.ERROR, "clock", message, values)
    if doubt := clock_doubt(snapshot):
        return Status(Level.ERROR, "clock", doubt, values)
    message = "the time of /clock" if snapshot.uses_sim_time else "the time of this machine"
    return Status(Level.OK, "clock", message, values)


def clock_doubt(snapshot: NodeSnapshot) -> str:
    """Return what is to be said where stamps and the node's clock are of different times."""
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


def _robot(snapshot: NodeSnapshot) -> Status:
    problem = snapshot.robot_problem
    if not problem:
        return Status(Level.OK, "frames/robot", "its pose in the map is known")
    level = Level.OK if snapshot.active_s < GRACE_S else Level.ERROR
    return Status(level, "frames/robot", f"no pose of the robot: {problem}")


def _camera(snapshot: NodeSnapshot) -> Status:
    problem = snapshot.camera_problem
    if not problem:
        return Status(Level.OK, "frames/camera", "its pose in the map is known")
    level = Level.OK if snapshot.active_s < GRACE_S else Level.WARN
    return Status(level, "frames/camera", f"nothing is perceived: {problem}")


def _cloud(snapshot: NodeSnapshot) -> Status:
    problem = snapshot.cloud_problem
    if not problem:
        return Status(Level.OK, "cloud", "no cloud waits")
    return Status(Level.WARN, "cloud", f"the cloud of voxels is not used yet: {problem}")


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
    if ticks.over > 1 and ticks.p99_ms is not None and ticks.p99_ms > 1e3 * ticks.period_s:
        message = f"ticks take longer than their period, {values['period']}: {durations}"
        return Status(Level.WARN, "ticks", message, values)
    return Status(Level.OK, "ticks", durations, values)


def _answers(snapshot: NodeSnapshot) -> Status:
    longest_ms = snapshot.busy.longest_ms
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
    if share is not None and share > _BLOCKED_SHARE and offered >= _FEWEST_ARRIVALS:
        message = (
            f"{counts.blocked_lately} of {offered} that were to arrive in the last minute found "
            "no place: fewer (population.arrival_rate), or a larger region or max_alive"
        )
        return Status(Level.WARN, "population", message, values)
    return Status(Level.OK, "population", f"{counted(counts.alive, 'artefact')} alive", values)


def _behaviours(snapshot: NodeSnapshot) -> Status:
    faults = snapshot.faults
    values = {name: f"{count} failed" for name, count in faults.counts.items()}
    said = [faults.hung] if faults.hung else []
    if faults.counts:
        who = counted(sum(faults.counts.values()), "artefact")
        said.append(f"the behaviour of {who} has failed, and they stand; the last: {faults.last}")
    if not said:
        return Status(Level.OK, "behaviours", "none failed", values)
    return Status(Level.WARN, "behaviours", "; ".join(said), values)


def _contacts(snapshot: NodeSnapshot) -> Status:
    contacts = snapshot.contacts
    values = {"contacts": str(contacts.count), "last": contacts.last or "-"}
    if contacts.last_age_s is not None and contacts.last_age_s <= _CONTACT_S:
        message = f"the robot has touched {contacts.last}, {contacts.last_age_s:.1f} s ago"
        return Status(Level.WARN, "robot contact", message, values)
    return Status(Level.OK, "robot contact", counted(contacts.count, "contact"), values)


def _scan(scan: ScanSnapshot) -> Status:
    name = f"scans/{scan.topic.lstrip('/')}"
    values = {
        "exact": str(scan.exact),
        "held": str(scan.held),
        "passed through": str(scan.passed_through),
        "last problem": scan.last_problem or "-",
        "late transforms": figure(scan.late_s or None, "s", 3),
    }
    if scan.passed_through_lately:
        passed = counted(scan.passed_through_lately, "scan")
        message = f"{passed} without artefacts in the last 10 s: {scan.last_problem}"
        if scan.late_s:
            needed_s = math.ceil(100.0 * scan.late_s + 1.0) / 100.0
            message += (
                f"; transforms come up to {scan.late_s:.3f} s after the scans: "
                f"set sensors.tf_wait to {needed_s:.2f}"
            )
        return Status(Level.WARN, name, message, values)
    return Status(Level.OK, name, f"{counted(scan.exact + scan.held, 'scan')} augmented", values)


# How long nobody has offered to tell of the camera, and when that is worth a word.


_STAND_IN_S: Final = 3.0


class CameraWatch:
    """Tells when the default camera is to stand in, and when it is to be said that it does.

    Times are those of a clock that never jumps. Publishers are discovered one after the other,
    and a robot may be started after the node: so nothing is said before a map has been on offer
    for the grace, all the while without a CameraInfo.
    """

    def __init__(self) -> None:
        self._blind_since_ns: int | None = None
        self._mapped_since_ns: int | None = None

    def is_to_stand_in(self, now_ns: int, *, is_missing: bool) -> bool:
        """Tell whether a camera has been missing, and no CameraInfo on offer, for some seconds."""
        self._blind_since_ns = _since(self._blind_since_ns, now_ns, holds=is_missing)
        return _has_lasted(self._blind_since_ns, now_ns, _STAND_IN_S)

    def is_to_be_said(self, now_ns: int, *, is_only_map_offered: bool) -> bool:
        """Tell whether there has been a map on offer, but no CameraInfo, for the grace."""
        self._mapped_since_ns = _since(self._mapped_since_ns, now_ns, holds=is_only_map_offered)
        return _has_lasted(self._mapped_since_ns, now_ns, GRACE_S)


def _since(before_ns: int | None, now_ns: int, *, holds: bool) -> int | None:
    """Return since when something has held without a break."""
    if not holds:
        return None
    return now_ns if before_ns is None else before_ns


def _has_lasted(since_ns: int | None, now_ns: int, least_s: float) -> bool:
    return since_ns is not None and now_ns - since_ns >= least_s * NS_PER_S
