"""`ar_builder`: the AR-builder as a lifecycle node beside a robot's navigation stack."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic_ns
from traceback import format_exc
from typing import Any, Final

from rclpy.clock import Clock, ClockType, JumpThreshold
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.logging import get_logger

from are_ros.builder.assembly import catalogue_of
from are_ros.builder.tick import Demand
from are_ros.builder.warm_up import WarmUpNeeds, warm_up
from are_ros.conventions import NS_PER_S
from are_ros.errors import AreError, CatalogueError, NodeError, ParameterError
from are_ros.messages.sensors import MINIATURES
from are_ros.messages.tick_encoding import offered_outputs
from are_ros.node.diagnostics import Reporter
from are_ros.node.heartbeat import listen_for_relief, offer_heartbeat
from are_ros.node.live_builder import LiveBuilder
from are_ros.node.message_classes import message_class
from are_ros.node.parameters import ParameterBridge
from are_ros.node.qos import advertise, profile_of
from are_ros.node.services import Services
from are_ros.node.topics import (
    Publishers,
    Subscriptions,
    WireDecoding,
    WireMessage,
    with_full_names,
)
from are_ros.node.watches import GRACE_S, CallbackTimer, Lasting, Watchdog
from are_ros.parameters.choices import OnRobotContact
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import EFFECTIVE_TOPIC, EFFECTIVE_TYPE, write_ros_parameters
from are_ros.parameters.validation import with_contact_policy
from are_ros.population.catalogue import Catalogue
from are_ros.population.mixture import mixture_of
from are_ros.world.transforms.sources import Remark

NAME: Final = "ar_builder"
_ON_CONTACT: Final = OnRobotContact.HOLD
"""What `auto` means for a live robot, which can react."""
_REPORT_S: Final = 1.0
_OVERDUE_NS: Final = 2 * NS_PER_S
_STAND_IN_S: Final = 3.0
"""After this time without CameraInfo the default camera is used."""
_MOST_SENTENCES: Final = 1000
_KERNELS_A_LINE: Final = 25
_LEAPS: Final = JumpThreshold(
    min_forward=Duration(seconds=1), min_backward=Duration(nanoseconds=-1), on_clock_change=True
)
"""After such a jump of the clock the timers are wrong: the node runs the due work at once."""
_DONE, _FAILED = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class ArBuilderNode(LifecycleNode):  # type: ignore[misc] # rclpy is only partly typed
    """Callbacks store the messages; `LiveBuilder.work` takes them and runs the due ticks.

    From configure to cleanup the real map and the scans are relayed; while the node is active, and
    not paused, artefacts are among them. Raises ParameterError where the parameters given are bad,
    NodeError where are_msgs is not installed. `is_wanted()` is asked while the kernels compile; a
    configuration ends early when it returns False.
    """

    def __init__(self, node_name: str = NAME, **options: Any) -> None:
        super().__init__(node_name, **options)
        self._heartbeat = offer_heartbeat(self)
        self.live: LiveBuilder | None = None
        self._inputs: Subscriptions | None = None
        self._outputs: Publishers | None = None
        self._catalogue: Catalogue | None = None
        self.is_wanted: Callable[[], bool] = lambda: True
        self._is_active = self._is_paused = False
        self._said: set[str] = set()
        self.bridge = ParameterBridge(
            self, lambda: self.live is not None, self._check, self._reconfigure
        )
        self._requests = Services(
            self,
            lambda: self.live if self._is_active else None,
            self.now_ns,
            self._set_paused,
            self._turn,
        )
        diagnostics = advertise(self, "diagnostic_msgs/msg/DiagnosticArray", "/diagnostics")
        self._reporter = Reporter(self, diagnostics)
        latched = profile_of(True, True, 1)
        self._effective = advertise(self, EFFECTIVE_TYPE, f"~/{EFFECTIVE_TOPIC}", latched)
        self._is_blind, self._is_only_mapped = Lasting(_STAND_IN_S), Lasting(GRACE_S)
        self._stand_in = ""
        listen_for_relief(self, self._repeat_maps)
        self._busy = CallbackTimer()
        self._hangs: Watchdog | None = None
        self._wakes_ns: int | None = None
        self._timer = self.create_timer(_REPORT_S, self._wake)
        self._timer.cancel()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._alarm = self.create_timer(0.0, self._leapt, clock=steady)
        self._alarm.cancel()
        self._leaps = self.get_clock().create_jump_callback(
            _LEAPS, post_callback=lambda _: self._alarm.reset()
        )
        self._report_timer = self.create_timer(_REPORT_S, self._report, clock=steady)
        self._reported_ns = monotonic_ns()

    def now_ns(self) -> int:
        """Return the time of the node's clock, 0 before the first /clock of simulated time."""
        return int(self.get_clock().now().nanoseconds)

    def _LifecycleNodeMixin__on_change_state(self, request: Any, response: Any) -> Any:  # noqa: N802 - rclpy has no other way
        """Refuse a transition that the present state does not have: rclpy would end the node."""
        try:
            return super()._LifecycleNodeMixin__on_change_state(request, response)
        except RuntimeError as cause:  # RCLError
            self.get_logger().warning(f"~/change_state is refused: {cause}")
            response.success = False
            return response

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the parameters, compile the kernels, subscribe, and relay."""
        del state
        try:
            with self._turn("transitions"):
                self._configure(with_contact_policy(self.bridge.values, _ON_CONTACT))
        except AreError as cause:
            if self.is_wanted():
                self.get_logger().error(str(cause))
            else:
                self.get_logger().info(f"not configured, as the node is to end: {cause}")
            self._close()
            return _FAILED
        except Exception:  # rclpy swallows it without a word
            self.get_logger().error(f"configure failed:\n{format_exc()}")
            self._close()
            raise
        return _DONE

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start the population, and add artefacts to the outputs."""
        del state
        self._is_active, self._is_paused = True, False
        self._reporter.active_since_ns = monotonic_ns()
        with self._turn("transitions"):
            self._resume()
        self.get_logger().info("active: artefacts arrive once there is a map")
        return _DONE

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Remove the artefacts from the outputs; the real map is still relayed."""
        del state
        self.retire()
        self.get_logger().info("inactive: the real map is relayed")
        return _DONE

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Drop all state, subscriptions and publishers."""
        del state
        self._close()
        return _DONE

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Delete every marker and publish the real map."""
        del state
        self.retire()
        self._reporter.is_shut_down = True
        return _DONE

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin again unconfigured."""
        del state
        self._close()
        return _DONE

    def starts_itself(self) -> bool:
        """Configure and activate if `autostart` is true; return False if that failed."""
        if not self.bridge.node_values.autostart:
            return True
        return bool(self.trigger_configure() == _DONE and self.trigger_activate() == _DONE)

    def retire(self) -> None:
        """Delete every marker and publish the real map; callable at any time."""
        if self.live is not None and self.live.is_running:
            with self._turn("transitions"):
                self.live.pause(self.now_ns())
        self._is_active = self._is_paused = False
        self._reporter.active_since_ns = None
        self._timer.cancel()

    def flush(self, timeout_s: float) -> None:
        """Wait until reliable subscribers have acknowledged all messages, at most this long."""
        late = self._outputs.flush(timeout_s) if self._outputs is not None else []
        if late:
            self.get_logger().warning(
                f"a subscriber has not taken the last of {', '.join(late)} within {timeout_s:g} s"
            )

    def _configure(self, parameters: Parameters) -> None:
        parameters = with_full_names(self, parameters)
        catalogue = self._catalogue = catalogue_of(parameters)
        _check_for(catalogue, parameters)
        self.get_logger().info("preparing the kernels (a minute or two the first time)")
        needs = WarmUpNeeds(MINIATURES)
        if not warm_up(catalogue, needs, self.is_wanted, count=self._tell_kernels):
            raise NodeError("its kernels are not compiled")
        self._said.clear()
        subscriptions = self._inputs = Subscriptions(
            self, parameters.sensors, parameters.camera.others, self._store, self._say
        )
        offered = offered_outputs(parameters, Demand(octomap=True))
        publishers = self._outputs = Publishers(
            self,
            subscriptions.roles,
            offered,
            self._say,
            parameters.sensors,
        )
        decoding = WireDecoding()
        self.live = LiveBuilder(
            parameters,
            catalogue,
            decoding,
            subscriptions.roles,
            subscriptions,
            publishers,
            self._refused,
        )
        self.live.busy = self._busy
        self._hangs = Watchdog(self._busy, self._cry)
        subscriptions.follow_publishers()
        self._tell(parameters)
        self.get_logger().info("configured: the real map is relayed when it comes")

    def _tell_kernels(self, done: int, total: int) -> None:
        if done % _KERNELS_A_LINE == 0:
            self.get_logger().info(f"{done} kernels are compiled, of at most {total}")

    def _close(self) -> None:
        self.retire()
        for part in (self._inputs, self._outputs):
            if part is not None:
                part.close()
        if self._hangs is not None:
            self._hangs.close()
        self.live = self._inputs = self._outputs = self._catalogue = self._hangs = None

    def _resume(self) -> None:
        if self.live is not None:
            self.live.resume(self.now_ns())
            self._work()

    @contextmanager
    def _turn(self, what: str) -> Iterator[None]:
        """Time a callback, and report a behaviour that blocked it."""
        self._busy.begin(monotonic_ns(), what)
        try:
            yield
        finally:
            ended_ns = monotonic_ns()
            self._busy.end(ended_ns)
            hung = self._hangs.take() if self._hangs and not self._busy.turn else None
            if hung is not None:
                turn, who = hung
                lasted_s = (ended_ns - turn.began_ns) / NS_PER_S
                sentence = f"{who} did not return: for {lasted_s:.1f} s the node stood still"
                self.get_logger().error(sentence)
                if self.live is not None:
                    self.live.faults.hung = sentence

    def _cry(self, sentence: str) -> None:
        """Log from the watchdog's thread, by a logger without a node: nothing goes to /rosout."""
        get_logger(f"watch.{self.get_name()}").error(sentence)

    def _store(self, message: WireMessage) -> None:
        with self._turn("inputs"):
            if self.live is not None and self.live.store(message, self.now_ns()):
                self._work()
            self._report_if_overdue()

    def _wake(self) -> None:
        """Run the due work when the timer fires."""
        if self._wakes_ns is not None:
            self._busy.woke(monotonic_ns(), self._wakes_ns)
        with self._turn("ticks"):
            self._work()

    def _work(self) -> None:
        """Run the due work, log the faults, and set the timer for the next due time."""
        live, publishers = self.live, self._outputs
        if live is None or publishers is None:
            self._timer.cancel()
            return
        if publishers.has_new_viewer():
            live.builder.show_everything()
        live.work(self.now_ns())
        for sentence in live.faults.sentences(monotonic_ns()):
            self.get_logger().error(sentence)
        self._reporter.happened(live.take_events(), monotonic_ns())
        due_ns, self._wakes_ns = live.next_due_ns(), None
        if due_ns is None:
            self._timer.cancel()
            return
        period_ns = max(due_ns - self.now_ns(), 1)
        self._timer.timer_period_ns = period_ns
        self._timer.reset()
        if not self.get_clock().ros_time_is_active:
            self._wakes_ns = monotonic_ns() + period_ns

    def _leapt(self) -> None:
        """Run the due work once after a jump of the clock."""
        self._alarm.cancel()
        with self._turn("ticks"):
            self._work()

    def _report_if_overdue(self) -> None:
        """Report at last: with too much to do the timer waits behind all messages of a backlog."""
        if monotonic_ns() - self._reported_ns > _OVERDUE_NS:
            self._report()

    def _report(self) -> None:
        """Once a second: follow the publishers, run the due work, publish diagnostics."""
        self._reported_ns = monotonic_ns()
        with self._turn("diagnostics"):
            if self.live is not None and self._inputs is not None:
                self._inputs.follow_publishers()
                self._look_for_camera(self.live, self._inputs)
                self._work()
                for notice in self.live.take_notices():
                    self._say(notice, is_warning=not isinstance(notice, Remark))
            now_ns = monotonic_ns()
            busy = self._busy.figures(now_ns)
            self._reporter.report(self.live, self._inputs, busy, now_ns, is_paused=self._is_paused)
            for doubt in self._reporter.doubts:
                self._say(doubt)

    def _look_for_camera(self, live: LiveBuilder, subscriptions: Subscriptions) -> None:
        """Use the default camera where no CameraInfo is published, and warn later."""
        now_ns, is_offered = monotonic_ns(), subscriptions.is_offered("camera/camera_info")
        is_missing = self._is_active and not is_offered and live.builder.camera is None
        if is_offered or live.builder.camera is None:
            self._stand_in = ""
        if self._is_blind.see(now_ns, holds=is_missing):
            self._stand_in = live.builder.use_default_camera()
        # Publishers are discovered one after the other, and the robot may start after the node.
        is_only_map_offered = self._is_active and not is_offered and subscriptions.is_offered("map")
        if self._is_only_mapped.see(now_ns, holds=is_only_map_offered) and self._stand_in:
            self._say(f"nobody publishes CameraInfo: {self._stand_in}")

    def _repeat_maps(self) -> None:
        """Send the last maps again: the guard took this process for dead, and stood in."""
        if self._outputs is not None:
            self._outputs.repeat_maps()

    def _set_paused(self, is_paused: bool) -> str:
        if self.live is None or is_paused == self._is_paused:
            return "it is already paused" if is_paused else "it is not paused"
        self._is_paused = is_paused
        if is_paused:
            self.live.pause(self.now_ns())
            return "paused: the real map is relayed"
        self._resume()
        return "artefacts live on"

    def _check(self, candidate: Parameters) -> None:
        """Refuse parameters that the catalogue or the zones in use cannot take."""
        if self._catalogue is not None:
            _check_for(self._catalogue, candidate)
        if self.live is not None:
            self.live.builder.lives.check(candidate)

    def _reconfigure(self, values: Parameters) -> None:
        if self.live is not None:
            with self._turn("parameters"):
                values = with_full_names(self, with_contact_policy(values, _ON_CONTACT))
                self.live.reconfigure(values, self.now_ns())
                self._tell(values)
                self._work()

    def _tell(self, parameters: Parameters) -> None:
        """Publish the parameters in force, so that a recording of the node's topics has them."""
        text = write_ros_parameters(parameters)
        self._effective.publish(message_class(EFFECTIVE_TYPE)(data=text))

    def _refused(self, topic: str, sentence: str) -> None:
        if self._inputs is not None:
            self._inputs.watches[topic].refused(monotonic_ns(), sentence)
        self._say(sentence)

    def _say(self, sentence: str, *, is_warning: bool = True) -> None:
        """Log a sentence, each once."""
        if sentence not in self._said and len(self._said) < _MOST_SENTENCES:
            self._said.add(sentence)
            if is_warning:
                self.get_logger().warning(sentence)
            else:
                self.get_logger().info(sentence)


def _check_for(catalogue: Catalogue, parameters: Parameters) -> None:
    """Raise ParameterError for parameters that a catalogue cannot take."""
    mixture_of(parameters, catalogue)
    if label := parameters.clicks.label:
        try:
            catalogue.rows_named(label)
        except CatalogueError as cause:
            raise ParameterError(f"parameter 'clicks.label': {cause}") from cause
