"""The diagnostics of the node, gathered from its parts once a second."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

from rclpy.node import Node

from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.outputs import ArtefactEvent, EventKind
from are_ros.conventions import NS_PER_S
from are_ros.node.diagnostics import (
    ContactSnapshot,
    NodeSnapshot,
    NodeState,
    PopulationSnapshot,
    ScanSnapshot,
    clock_doubt,
    make_diagnostics,
    statuses,
)
from are_ros.node.live_builder import LiveBuilder
from are_ros.node.message_classes import RclpyFactory
from are_ros.node.qos import advertise
from are_ros.node.subscriptions import Subscriptions
from are_ros.node.watches import BusyFigures, CountWatch

_MINUTE_NS: Final = 60 * NS_PER_S
_LATELY_NS: Final = 10 * NS_PER_S


class Reporter:
    """Publishes /diagnostics. Times are of a clock that never jumps, but for messages' stamps."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = advertise(node, "diagnostic_msgs/msg/DiagnosticArray", "/diagnostics")
        self._factory = RclpyFactory()
        self._active_since_ns: int | None = None
        self._is_shut_down = False
        self._blocked, self._arrived = CountWatch(_MINUTE_NS), CountWatch(_MINUTE_NS)
        self._passed: dict[str, CountWatch] = {}
        self._last_contact: tuple[str, int] | None = None
        self.clock_doubt = ""
        """What the log should say of the clock after the last report, empty if nothing."""

    def activated(self, now_ns: int) -> None:
        """Say that the node is active from now on."""
        self._active_since_ns = now_ns

    def deactivated(self) -> None:
        """Say that the node is not active any more."""
        self._active_since_ns = None

    def shut_down(self) -> None:
        """Say that the node will never be active again."""
        self._is_shut_down = True

    def happened(self, events: tuple[ArtefactEvent, ...], now_ns: int) -> None:
        """Take what happened since the last tick."""
        for event in events:
            if event.kind is EventKind.ROBOT_CONTACT:
                last = f"{event.label} {event.artefact_id}, {event.value:.2f} m deep"
                self._last_contact = (last, now_ns)

    def report(
        self,
        live: LiveBuilder | None,
        subscriptions: Subscriptions | None,
        busy: BusyFigures,
        now_ns: int,
        *,
        is_paused: bool,
    ) -> None:
        """Publish how the node does."""
        snapshot = self._snapshot(live, subscriptions, now_ns, is_paused=is_paused)
        snapshot = replace(snapshot, busy=busy)
        self.clock_doubt = clock_doubt(snapshot)
        stamp_ns = int(self._node.get_clock().now().nanoseconds)
        name = self._node.get_fully_qualified_name().lstrip("/")
        message = make_diagnostics(self._factory, stamp_ns, statuses(snapshot), name)
        self._publisher.publish(message)

    def _snapshot(
        self,
        live: LiveBuilder | None,
        subscriptions: Subscriptions | None,
        now_ns: int,
        *,
        is_paused: bool,
    ) -> NodeSnapshot:
        uses_sim_time = bool(self._node.get_parameter("use_sim_time").value)
        is_without_clock = uses_sim_time and not self._node.get_clock().now().nanoseconds
        since_ns = self._active_since_ns
        common: dict[str, Any] = {
            "state": self._state(live),
            "is_paused": is_paused,
            "active_s": 0.0 if since_ns is None else (now_ns - since_ns) / NS_PER_S,
            "uses_sim_time": uses_sim_time,
            "is_without_clock": is_without_clock,
            "inputs": tuple(subscriptions.snapshots(now_ns)) if subscriptions else (),
        }
        return NodeSnapshot(**common, **(self._of_builder(live, now_ns) if live else {}))

    def _state(self, live: LiveBuilder | None) -> NodeState:
        if self._is_shut_down:
            return NodeState.FINALIZED
        if live is None:
            return NodeState.UNCONFIGURED
        return NodeState.INACTIVE if self._active_since_ns is None else NodeState.ACTIVE

    def _of_builder(self, live: LiveBuilder, now_ns: int) -> Mapping[str, Any]:
        builder = live.builder
        frame = builder.world.missing_frame()
        return {
            "stamps_ahead_s": self._stamps_ahead_s(builder),
            "robot_problem": builder.robots.missing,
            "camera_problem": _camera_problem(builder),
            "cloud_problem": f"nothing joins its frame '{frame}' to the map" if frame else "",
            "ticks": live.watch.figures(now_ns),
            "population": self._population(builder, now_ns),
            "contacts": self._contacts(builder, now_ns),
            "faults": live.faults.snapshot(),
            "scans": tuple(self._scans(builder, now_ns)),
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
        return PopulationSnapshot(
            alive=len(lives.population.living),
            arrivals=counts.arrived,
            departures=counts.departed,
            blocked=counts.blocked,
            displaced=lives.displaced,
            arrivals_lately=self._arrived.growth(now_ns),
            blocked_lately=self._blocked.growth(now_ns),
            is_map_closed=builder.world.grid is not None and not builder.world.has_free_cells,
        )

    def _contacts(self, builder: ArBuilder, now_ns: int) -> ContactSnapshot:
        count = builder.lives.robot_contacts
        if self._last_contact is None:
            return ContactSnapshot(count)
        last, then_ns = self._last_contact
        return ContactSnapshot(count, last, (now_ns - then_ns) / NS_PER_S)

    def _scans(self, builder: ArBuilder, now_ns: int) -> Iterator[ScanSnapshot]:
        problems, late_ns = builder.sensor_problems(), builder.sensor_lateness_ns()
        for topic, counts in builder.sensor_counts().items():
            watch = self._passed.setdefault(topic, CountWatch(_LATELY_NS))
            watch.update(now_ns, counts.passed_through)
            yield ScanSnapshot(
                topic=topic,
                exact=counts.exact,
                held=counts.held,
                passed_through=counts.passed_through,
                passed_through_lately=watch.growth(now_ns),
                last_problem=problems.get(topic, ""),
                late_s=late_ns.get(topic, 0) / NS_PER_S,
            )


def _camera_problem(builder: ArBuilder) -> str:
    if builder.camera is None:
        return "no CameraInfo came yet"
    if builder.world.environment is None:
        return "there is no map yet"
    return builder.robots.camera_missing
