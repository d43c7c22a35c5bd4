"""The builder driven by the node's clock: inputs are stored on arrival, then taken in order."""

from collections import deque
from collections.abc import Callable, Container, Iterable, Mapping
from time import monotonic_ns, sleep
from typing import Final, NamedTuple, Protocol

from are_ros.agents.events import ArtefactEvent
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.costmap.augmented_map import without_artefacts
from are_ros.builder.simulation import CLOCK_JITTER_NS
from are_ros.builder.spawning.requests import Requests, SpawnRequest
from are_ros.builder.tick import Demand, Tick, TickSchedule
from are_ros.conventions import NS_PER_S
from are_ros.errors import AreError, InputError
from are_ros.messages.feed import OTHER_CAMERA, Decoding, Feed, RawMessage
from are_ros.messages.goals import read_clicked_point
from are_ros.messages.maps import encode_grid, read_grid
from are_ros.messages.sensors import CAMERA_INFO, SENSORS, SensorOutputs, sensor_topics
from are_ros.messages.tick_encoding import ALL_OUTPUTS, OCTOMAP, TickEncoder
from are_ros.node.watches import MINUTE_NS, PREPARING, CallbackTimer, FaultWatch, TickWatch
from are_ros.parameters.choices import CostmapGate, SensorGate
from are_ros.parameters.model import Parameters
from are_ros.population.catalogue import Catalogue
from are_ros.world.cameras import ViewModel
from are_ros.world.environment import Environment
from are_ros.world.rigid_transform import RigidTransform

_BACKLOG_NS: Final = NS_PER_S
"""Ticks that are later than this are left out: the machine cannot keep up, or time leapt."""
_MOST_MISSED_NS: Final = 5 * NS_PER_S
"""Time that the node has missed is simulated afterwards, up to this; beyond it, artefacts stand
still instead: else each standstill would take longer than the one before."""
_LATCHED: Final = (
    "map",
    "octomap_point_cloud_centers",
    "tf_static",
    "camera/camera_info",
    OTHER_CAMERA,
    CAMERA_INFO,
)
"""These may have been latched, and do not come again."""
_COSTLY: Final = ("map", "octomap_point_cloud_centers")
"""These take long to process: they are processed on arrival, not before the next tick."""
_MOST_KEPT: Final = 1000
_MOVING: Final = ("tf", "odom", "tf_static")
"""The roles of the transforms that a scan may wait for."""
_LISTENS_NS: Final = NS_PER_S // 100
"""So long the node listens after a scan's deadline before it judges it, by the wall's clock. A
process that was stopped has to get from the network first what came meanwhile."""
_STALL_NS: Final = NS_PER_S // 10
"""A tick that is later than this was late for the transforms, too."""
_LISTENS_MOST_NS: Final = NS_PER_S
"""So long after its deadline no scan is kept back, however late the node always is."""
_NONE_NS: Final = -(2**63)


class Inbox(Protocol):
    """The messages that DDS holds and no callback has taken yet, and the node's clock."""

    def waiting(self, roles: Container[str]) -> Iterable[RawMessage]:
        """Yield, and take, the messages of the inputs of some roles."""

    def is_time_simulated(self) -> bool:
        """Return whether the node's time is that of /clock."""


class OutputSink(Protocol):
    """Takes the outputs: publishers, or a list in tests."""

    def wanted(self) -> Container[str]:
        """Return the names of the outputs that have subscribers, or are latched."""

    def publish(self, name: str, data: bytes) -> None:
        """Send the bytes of a message."""


class _Stored(NamedTuple):
    message: RawMessage
    received_ns: int


class LiveBuilder:
    """Stores inputs, and works through them: ticks run at their times with what came before.

    Before `resume` and after `pause` the population stands still and no output is augmented: scans
    and maps are relayed unchanged. `refused(topic, sentence)` is called for each refused message.
    """

    def __init__(
        self,
        parameters: Parameters,
        catalogue: Catalogue,
        decoding: Decoding,
        roles: Mapping[str, str],
        inbox: Inbox,
        sink: OutputSink,
        refused: Callable[[str, str], None],
    ) -> None:
        self.builder = ArBuilder(parameters, catalogue)
        self.requests = Requests(self.builder)
        self.faults = FaultWatch()
        self.busy = CallbackTimer()
        self.watch = TickWatch(round(NS_PER_S / parameters.builder.tick_rate))
        self.is_running = False
        self._events: list[ArtefactEvent] = []
        self._roles = roles
        self._inbox = inbox
        self._sink = sink
        self._refused = refused
        self._decoding = decoding
        # A click is a request, and no input of the builder.
        inputs = {topic: role for topic, role in roles.items() if role != "clicked_point"}
        self._feed = Feed(decoding, self.builder, inputs)
        self._encoder = TickEncoder(with_boxes=parameters.sensors.boxes)
        self._stored: deque[_Stored] = deque()
        self._schedule: TickSchedule | None = None
        self._now_ns = 0
        self._said_ns: int | None = None
        self._look_ns: int | None = None
        self._worked_ns = monotonic_ns()
        self._has_prepared = False
        self._views: list[ViewModel] = []
        self._shown: Environment | None = None
        self.sensors = sensor_topics(roles)
        self._sensor_outputs = SensorOutputs(roles, parameters.sensors)
        self.builder.lives.is_paused = True
        self.builder.lives.report_faults_to(self.faults.take)
        if "camera/camera_info" in roles.values():
            self.builder.await_camera()

    def store(self, message: RawMessage, received_ns: int) -> bool:
        """Store an input until `work`; return whether `work` is to be called at once.

        While no ticks run, maps and scans are relayed at once. At time 0 the clock is not known
        yet: then only latched inputs are kept.
        """
        role, has_time = self._roles[message.topic], received_ns > 0
        if not (self.is_running and has_time):
            self._relay(role, message)
        if role in SENSORS and not self.is_running:
            return False
        if has_time:
            self._stored.append(_Stored(message, received_ns))
        elif role in _LATCHED:
            self._keep(role, message)
        is_awaited = role in _MOVING and self.builder.next_deadline_ns() is not None
        return self.is_running and (role in SENSORS or role in _COSTLY or is_awaited)

    def _keep(self, role: str, message: RawMessage) -> None:
        """Keep latched inputs until the time is known: the newest of each, and all statics."""
        replaced = [
            stored
            for stored in self._stored
            if stored.message.topic == message.topic
            and (role != "tf_static" or stored.message.data == message.data)
        ]
        for stored in replaced:
            self._stored.remove(stored)
        self._stored.append(_Stored(message, 0))
        while len(self._stored) > _MOST_KEPT:
            self._stored.popleft()

    def work(self, now_ns: int) -> None:
        """Take the stored inputs, run the due ticks, release the scans past their deadline."""
        if now_ns <= 0:
            return
        ticks, offered = self.watch.count, self._offered
        self._has_prepared = False
        self._read_what_ticks_are_late_for(now_ns)
        self._read_what_sensors_wait_for(now_ns)
        self.builder.judges_until_ns = _NONE_NS
        while self._stored:
            message, received_ns = self._stored.popleft()
            self._take(message, received_ns or now_ns)
        self.builder.judges_until_ns = self._judges_until_ns(now_ns)
        self._run_ticks(now_ns)
        if self.is_running:
            self.builder.advance(now_ns)
            self._send_readings()
            self._prepare_camera()
        if self._has_prepared:
            self.busy.call_it(PREPARING)
        elif self._offered != offered:
            self.busy.call_it("arrivals")
        elif self.watch.count != ticks:
            self.busy.call_it("ticks")
        self._worked_ns = monotonic_ns()

    def next_due_ns(self) -> int | None:
        """Return when `work` has something to do unless an input comes, None if never."""
        if not self.is_running:
            return None
        if self._schedule is None:
            return 1  # as soon as the time is known
        deadline_ns = self.builder.next_deadline_ns()
        tick_ns = self._schedule.next_ns
        return tick_ns if deadline_ns is None else min(tick_ns, self._look_ns or deadline_ns)

    def resume(self, now_ns: int) -> None:
        """Start the population and the ticks."""
        self.work(now_ns)
        self.is_running, self._schedule = True, None
        self.builder.lives.pause(now_ns, is_paused=False)

    def pause(self, now_ns: int) -> None:
        """Remove all artefacts from the outputs, and stop their time."""
        self.work(now_ns)
        self.builder.finish(now_ns)
        self._send_readings()
        self.is_running = False
        self.builder.lives.pause(now_ns, is_paused=True)
        self._shown = self.builder.world.environment
        self._send_tick(self.builder.farewell(now_ns))

    def reconfigure(self, parameters: Parameters, now_ns: int) -> None:
        """Apply new values of the live parameters; ParameterError if refused."""
        self.work(now_ns)
        self.builder.reconfigure(parameters, now_ns)

    def take_events(self) -> tuple[ArtefactEvent, ...]:
        """Return the events since the last call."""
        events, self._events = tuple(self._events), []
        return events

    def take_notices(self) -> list[str]:
        """Return the notices about inputs and frames since the last call."""
        notices = [*self.builder.notices, *self.builder.frames.drain_notices()]
        self.builder.notices.clear()
        return notices

    @property
    def _offered(self) -> int:
        """The number of arrivals so far, those without a place included."""
        counts = self.builder.lives.population.counts
        return counts.arrived + counts.blocked

    def _read_what_ticks_are_late_for(self, now_ns: int) -> None:
        """Let what moved while the node stood still count from the first tick that is late for it.

        A tick looks at no stamp after its own: so the robot is where it was then, and a contact is
        told in time. By /clock, log times decide, as in a replay.
        """
        if not self.is_running or self._schedule is None or self._inbox.is_time_simulated():
            return
        due_ns = self._schedule.next_ns
        if not _STALL_NS < now_ns - due_ns <= _MOST_MISSED_NS:
            return
        if monotonic_ns() - self._worked_ns > _STALL_NS:
            sleep(_LISTENS_NS / NS_PER_S)
        for message in self._inbox.waiting(_MOVING):
            self.store(message, now_ns)
        since = (
            _Stored(message, min(received_ns, due_ns - 1))
            if self._roles[message.topic] in _MOVING
            else _Stored(message, received_ns)
            for message, received_ns in self._stored
        )
        self._stored = deque(sorted(since, key=lambda stored: stored.received_ns))

    def _read_what_sensors_wait_for(self, now_ns: int) -> None:
        """Store the transforms that came before `now_ns`, if a scan's deadline has passed by it.

        The node may be late, and their callbacks be due after the one that calls this.
        """
        deadline_ns = self.builder.next_deadline_ns()
        if deadline_ns is not None and deadline_ns <= now_ns:
            for message in self._inbox.waiting(_MOVING):
                self.store(message, now_ns)

    def _judges_until_ns(self, now_ns: int) -> int:
        """Return up to when deadlines are judged now: by the wall's clock, at the second look.

        The first says that a deadline has passed, the second has to come in time: then the node
        was awake, and has listened. What came in a stall counts, so, for the scans of before it.
        Simulated time comes as messages come, after those that were sent before it.
        """
        deadline_ns, look_ns = self.builder.next_deadline_ns(), self._look_ns
        if deadline_ns is None or deadline_ns > now_ns or self._inbox.is_time_simulated():
            self._look_ns = None
            return now_ns
        if look_ns is not None and now_ns < look_ns <= now_ns + _LISTENS_NS:
            return _NONE_NS
        is_in_time = look_ns is not None and 0 <= now_ns - look_ns <= _LISTENS_NS
        if is_in_time or now_ns - deadline_ns > _LISTENS_MOST_NS:
            self._look_ns = None
            return now_ns
        self._look_ns = now_ns + _LISTENS_NS
        return _NONE_NS

    def _take(self, message: RawMessage, received_ns: int) -> None:
        self._run_ticks(received_ns)
        self._follow_clock(received_ns)
        if self._roles[message.topic] == "clicked_point":
            self._click(message, received_ns)
        elif sentence := self._feed.take(message, received_ns):
            self._refused(message.topic, sentence)
        if self._roles[message.topic] in _COSTLY:
            self._took_map(received_ns)
        self._send_readings()

    def _took_map(self, now_ns: int) -> None:
        """Prepare for a new environment; what is latched of the last one is replaced at once."""
        self._has_prepared = True
        self.builder.prepare()
        environment = self.builder.world.environment
        if not self.is_running and environment is not self._shown:
            self._shown = environment
            latched = ("augmented_costmap", "augmented_octomap")
            self._send_tick(self.builder.farewell(now_ns), latched)

    def _prepare_camera(self) -> None:
        """Prepare a new camera, after the population has begun: it would be delayed otherwise.

        Inputs that arrive during it are received late, also the first robot pose.
        """
        views = [camera.view for camera in self.builder.cameras if camera is not None]
        is_new = any(view not in self._views for view in views)
        if is_new and self.builder.lives.area_m2 > 0.0:
            self._views, self._has_prepared = views, True
            self.builder.prepare_cameras()

    def _click(self, message: RawMessage, received_ns: int) -> None:
        """Spawn an artefact at a clicked point, or refuse it with the reason."""
        topic = message.topic
        try:
            if not self.is_running:
                raise InputError(f"{topic}: nobody lives: not active, or paused")
            point = read_clicked_point(self._decoding.deserialize(message), topic)
        except AreError as cause:
            self._refused(topic, str(cause))
            return
        x_m, y_m, _ = point.points_m[0].tolist()
        here = RigidTransform.planar(x_m, y_m, 0.0)
        label = self.builder.parameters.clicks.label
        try:
            self.requests.spawn(SpawnRequest(point.frame_id, here, label), received_ns)
        except AreError as cause:
            self._refused(topic, f"{topic}: {cause}")

    def _relay(self, role: str, message: RawMessage) -> None:
        """Relay real readings and maps while no ticks run."""
        for name in self._sensor_outputs.relays_of(message.topic):
            self._sink.publish(name, message.data)
        if role == "map":
            self._relay_map(message)

    def _relay_map(self, message: RawMessage) -> None:
        """Relay a map that the builder accepts; the builder reports the reason for a refusal."""
        try:
            grid = read_grid(self._decoding.deserialize(message), message.topic)
        except AreError:
            return
        if grid.frame_id == self.builder.parameters.frames.map:
            self._sink.publish("augmented_map", message.data)
            self._sink.publish("artefact_map", encode_grid(without_artefacts(grid)))

    def _run_ticks(self, until_ns: int) -> None:
        self._follow_clock(until_ns)
        if not self.is_running:
            return
        if self._schedule is None:
            rate_hz = self.builder.parameters.builder.tick_rate
            self._schedule = TickSchedule.of(rate_hz, until_ns)
        self.watch.skipped(monotonic_ns(), self._schedule.skip_to(until_ns, _BACKLOG_NS))
        while (tick_ns := self._schedule.pop(until_ns)) is not None:
            self._run_tick(tick_ns, until_ns - tick_ns)

    def _run_tick(self, tick_ns: int, late_ns: int) -> None:
        began_ns = monotonic_ns()
        wanted = self._sink.wanted()
        self.builder.demand = self._encoder.demand = self._demand(wanted)
        tick = self.builder.step(tick_ns)
        self._events += tick.events
        self._send_tick(tick, wanted)
        self._send_readings()
        ended_ns = monotonic_ns()
        self.watch.ran(ended_ns, ended_ns - began_ns, late_ns)

    def _demand(self, wanted: Container[str]) -> Demand:
        """Return which outputs to compute; grids always, since they are latched.

        The octomap, too, is latched, but too large to be computed for nobody.
        """
        parameters = self.builder.parameters
        by_gates = CostmapGate.PERCEIVED is parameters.costmap.gate
        by_gates = by_gates or SensorGate.PERCEIVED is parameters.sensors.gate
        perception = by_gates or any(
            output.of_perception and name in wanted for name, output in ALL_OUTPUTS.items()
        )
        return Demand(perception, markers="markers" in wanted, octomap=OCTOMAP in wanted)

    def _send_tick(self, tick: Tick, wanted: Container[str] | None = None) -> None:
        for name, _, data in self._encoder.encode(tick, wanted):
            self._sink.publish(name, data)

    def _send_readings(self) -> None:
        for released in self.builder.take_readings():
            for name, data in self._sensor_outputs.messages(released):
                self._sink.publish(name, data)

    def _follow_clock(self, now_ns: int) -> None:
        """Begin the ticks anew when the clock has jumped back, as the builder does.

        Where it is far ahead, let the artefacts stand still for the time in between.
        """
        if now_ns < self._now_ns - CLOCK_JITTER_NS:
            self._schedule = None
        elif now_ns < self._now_ns:
            return
        elif self.is_running and now_ns > self._now_ns + _MOST_MISSED_NS:
            self._stand_still(now_ns)
        self._now_ns = now_ns

    def _stand_still(self, now_ns: int) -> None:
        """Let the artefacts stand still up to now, and say so, once a minute at most."""
        missed_s, wall_ns = self.builder.stand_still(now_ns), monotonic_ns()
        if missed_s and (self._said_ns is None or wall_ns >= self._said_ns + MINUTE_NS):
            self._said_ns = wall_ns
            self.builder.notices.append(
                f"the artefacts stood still for {missed_s:.1f} s: the machine did not keep up (see "
                "`answers` in the diagnostics), or the clock leapt"
            )
