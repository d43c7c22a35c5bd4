"""`are view --live`: the scene of the running node in a browser, with what can be changed in it."""

import queue
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, Final

import numpy as np
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import qos_profile_parameter_events

from are_ros.bag.decoded import value_of
from are_ros.draw.scene import Moment
from are_ros.draw.viewer import (
    LAYERS,
    MISSING_VISER,
    ViewedScene,
    aim_camera,
    has_viser,
    start_server,
    stop_server,
    wxyz_of,
)
from are_ros.errors import AreError, NodeError
from are_ros.messages.feed import OTHER_CAMERA
from are_ros.messages.images.image import camera_info_topic
from are_ros.messages.sensors import sensor_outputs
from are_ros.messages.tick_encoding import OUTPUTS
from are_ros.node.message_classes import message_class, service_class
from are_ros.node.qos import INPUTS, InputSubscription, output_qos
from are_ros.node.startup import executor_of, ros_session, stop_on_signals
from are_ros.parameters.declaration import Description, describe, value_at, with_values
from are_ros.parameters.model import Parameters
from are_ros.replay.pictures import place_of
from are_ros.replay.progress import Say
from are_ros.replay.recorded_scene import AUGMENTED_SCAN, SceneReader, other_camera_roles
from are_ros.wording import listed
from are_ros.world.cameras import Camera

_NODE: Final = "ar_builder"
_INPUTS: Final = ("map", "octomap_point_cloud_centers", "camera/camera_info", "odom")
_PATIENCE_S: Final = 60.0
_ATTEMPTS: Final = 6
_ANSWER_S: Final = 5.0
"""For an answer while somebody looks at the scene, which stands still meanwhile."""
_SILENCE_S: Final = 3.0
_FOLLOW_S: Final = 1.0
_WAY_TICKS: Final = 100
_DRAW_WAYS_EVERY: Final = 10
_SLIDER_STEPS: Final = 200
_MARGIN_M: Final = 6.0
_PAUSE: Final = "pause"


def view_live_command(say: Say, namespace: str, port: int) -> None:
    """Serve the scene of the node at http://localhost:PORT until a signal comes; port 0: any.

    Waits up to a minute for the node. Raises NodeError without viser, or where it does not answer.
    """
    if not has_viser():
        raise NodeError(MISSING_VISER)
    with (
        stop_on_signals(is_last=False) as stop,
        ros_session("are_viewer") as node,
        executor_of(node) as executor,
        _running(port) as server,
    ):
        remote = RemoteNode(node, executor, namespace, stop.should_stop)
        say(f"waiting for {remote.name}, for a minute at most")
        try:
            live = LiveView(server, remote, remote.parameters())
        except NodeError:
            if stop.is_set:
                raise KeyboardInterrupt from None
            raise
        say(f"the running node can be seen at http://localhost:{server.get_port()}; Ctrl-C ends it")
        while not stop.is_set:
            executor.spin_once(timeout_sec=0.05)
            live.work()


@contextmanager
def _running(port: int) -> Iterator[Any]:
    server = start_server(port)
    try:
        yield server
    finally:
        stop_server(server)


class RemoteNode:
    """The running node as its services and parameters show it."""

    def __init__(
        self,
        node: Node,
        executor: SingleThreadedExecutor,
        namespace: str,
        should_stop: Callable[[], bool],
    ) -> None:
        self.node = node
        self.namespace = f"/{namespace.strip('/')}".rstrip("/")
        self.name = f"{self.namespace}/{_NODE}"
        self.patience_s = _PATIENCE_S
        """How long a service and its answer are waited for, each."""
        self._executor = executor
        self._should_stop = should_stop
        self._clients: dict[str, Any] = {}

    def topic(self, name: str) -> str:
        """Return the full name of a topic in the node's namespace."""
        return name if name.startswith("/") else f"{self.namespace}/{name}"

    def heard(self) -> dict[str, str]:
        """Return the topics that the node subscribes to, as remapped, and their types."""
        try:
            found = self.node.get_subscriber_names_and_types_by_node(_NODE, self.namespace or "/")
        except NodeNameNonExistentError:
            return {}
        return {topic: types[0] for topic, types in found}

    def ask(self, service: str, type_name: str, *, attempts: int = _ATTEMPTS, **fields: Any) -> Any:
        """Return the answer of one of the node's services. Raises NodeError if none comes.

        An answer can be lost: a node may give it before its middleware knows who asks. So there are
        several `attempts`, which share the patience; one where asking twice is another matter. An
        answer may also be late: that to an earlier attempt counts as well.
        """
        if service not in self._clients:
            kind = service_class(type_name)
            self._clients[service] = self.node.create_client(kind, f"{self.name}/{service}")
        client = self._clients[service]
        request = client.srv_type.Request()
        for name, value in fields.items():
            setattr(request, name, value)
        if not self._awaited(client.service_is_ready, self.patience_s):
            raise NodeError(
                f"{self.name}/{service} is not there: `are node` starts the node, and ROS_DOMAIN_ID"
                f" has to be the same here{self._others()}"
            )
        asked = list[Any]()
        try:
            for _ in range(attempts):
                asked.append(client.call_async(request))
                self._awaited(lambda: any(one.done() for one in asked), self.patience_s / attempts)
                for one in asked:
                    if one.done():
                        return one.result()
        finally:
            for one in asked:
                client.remove_pending_request(one)
        raise NodeError(f"{self.name}/{service} does not answer")

    def _others(self) -> str:
        """Return what to add where nodes of this name run in other namespaces."""
        known = self.node.get_node_names_and_namespaces()
        others = {f"{place.rstrip('/')}/{name}" for name, place in known if name == _NODE}
        others.discard(self.name)  # as one that was killed is known for a while
        return f"; --namespace names that of {listed(sorted(others))}" if others else ""

    def parameters(self) -> Parameters:
        """Return the current parameters of the node."""
        paths = [item.path for item in describe(Parameters())]
        kind = "rcl_interfaces/srv/GetParameters"
        answer = self.ask("get_parameters", kind, names=paths)
        values = map(parameter_value_to_python, answer.values)
        known = {p: v for p, v in zip(paths, values, strict=False) if v is not None}
        return with_values(Parameters(), known)

    def set_parameter(self, path: str, value: float) -> str:
        """Set a parameter; return why that was refused, empty if it was not."""
        message = Parameter(path, value=value).to_parameter_msg()
        kind = "rcl_interfaces/srv/SetParameters"
        result = self.ask("set_parameters", kind, parameters=[message]).results[0]
        return "" if result.successful else str(result.reason)

    def _awaited(self, is_done: Callable[[], bool], patience_s: float) -> bool:
        """Spin until a condition holds or a time [s] is over; return whether it holds."""
        end_s = time.monotonic() + patience_s
        while not is_done() and not self._should_stop() and time.monotonic() < end_s:
            self._executor.spin_once(timeout_sec=0.05)
        return is_done()


class LiveView:
    """Subscribes to the node's inputs and outputs, shows them, and forwards requests of browsers.

    viser answers browsers in threads of its own: requests wait in a queue until `work`.
    """

    def __init__(self, server: Any, remote: RemoteNode, parameters: Parameters) -> None:
        self.answer = ""
        """The answer to the last request from the browser."""
        self._server, self._remote, self._parameters = server, remote, parameters
        self._requests: queue.SimpleQueue[Callable[[], str]] = queue.SimpleQueue()
        self._scene: ViewedScene | None = None
        self._shown_revision = -1
        self.ticks: deque[Moment] = deque(maxlen=_WAY_TICKS)
        self._count = 0
        self._heard_s = self._followed_s = time.monotonic()
        self._is_silent = False
        self._inputs: dict[tuple[str, str], InputSubscription] = {}
        self.sliders: dict[str, Any] = {}
        """The handles of the sliders, by the paths of their parameters."""
        self._reader = SceneReader(parameters, self._show, has_camera_info=True, is_live=True)
        try:
            self._subscribe()
        except InvalidTopicNameException as cause:
            raise NodeError(f"{remote.name} names a topic that ROS 2 has not: {cause}") from cause
        self._add_controls()
        remote.patience_s = _ANSWER_S

    def work(self) -> None:
        """Follow the publishers, carry out the browser's requests, and show the answers there."""
        if time.monotonic() - self._followed_s > _FOLLOW_S:
            self._followed_s = time.monotonic()
            self._follow_inputs()
        if self.ticks and not self._is_silent and time.monotonic() - self._heard_s > _SILENCE_S:
            self._is_silent = True
            self.counts.content = (
                f"nothing comes from {self._remote.name}: it has ended, or its clock stands still"
            )
        while True:
            try:
                request = self._requests.get_nowait()
            except queue.Empty:
                return
            try:
                self.answer = request()
            except AreError as cause:
                self.answer = str(cause)
            self._status.content = self.answer

    # ------------------------------------------------------------------------------ subscriptions

    def _subscribe(self) -> None:
        node, remote = self._remote.node, self._remote
        self._follow_inputs()
        scans = [remote.topic(name) for name in self._parameters.sensors.scans]
        outputs = {name: (name, OUTPUTS[name].type_name) for name in ("artefacts", "perceived")}
        for name in sensor_outputs(dict.fromkeys(scans, "scan")).values():
            outputs[name] = (AUGMENTED_SCAN, INPUTS["scan"].type_name)
        for name, (role, kind) in outputs.items():
            take, topic = self._callback(role, kind), f"{remote.name}/{name}"
            node.create_subscription(message_class(kind), topic, take, output_qos(name))
        events = message_class("rcl_interfaces/msg/ParameterEvent")
        qos = qos_profile_parameter_events
        node.create_subscription(events, "/parameter_events", self._follow, qos)

    def _follow_inputs(self) -> None:
        """Listen where the node listens, to what publishers offer there."""
        node, wanted = self._remote.node, self._wanted()
        for (role, name), topic in remapped(wanted, self._remote.heard()).items():
            listening = self._inputs.get((role, name))
            if listening is not None and listening.topic != topic:
                node.destroy_subscription(listening.subscription)
                listening = None
            if listening is None:
                input_role = wanted[role, name]
                callback = self._callback(role, INPUTS[input_role].type_name)
                listening = InputSubscription(node, input_role, callback, topic)
                self._inputs[role, name] = listening
            listening.follow()

    def _wanted(self) -> dict[tuple[str, str], str]:
        """Return the roles in `INPUTS` of what is shown, by its own role and its topic."""
        remote, scans = self._remote, self._parameters.sensors.scans
        # Robots of their own namespaces have a /tf in common, or each its own.
        places = dict.fromkeys(("", remote.namespace))
        wanted = {(role, f"{at}/{role}"): role for role in ("tf", "tf_static") for at in places}
        wanted |= {(role, remote.topic(role)): role for role in _INPUTS}
        wanted |= {("scan", remote.topic(name)): "scan" for name in scans}
        cameras = other_camera_roles(self._parameters).items()
        return wanted | {(role, remote.topic(topic)): OTHER_CAMERA for topic, role in cameras}

    def _callback(self, role: str, type_name: str) -> Callable[[Any], None]:
        """Return the callback for a role; a message that is refused is not shown."""

        def take(message: Any) -> None:
            with suppress(AreError, ValueError, OverflowError):
                self._reader.take(role, value_of(type_name, message, 0))

        return take

    # ------------------------------------------------------------------------------ drawing

    def _show(self, tick: Moment, _: Camera | None) -> None:
        if self._reader.revision != self._shown_revision or self._scene is None:
            self._draw_place(tick)
        if self._scene is None:
            return
        self._heard_s = time.monotonic()
        if self._is_silent:  # it may be another node, with parameters of its own
            self._is_silent = False
            self._requests.put(self._read_parameters)
        self.ticks.append(tick)
        self._count += 1
        with self._server.atomic():
            self._scene.show(tick)
            if self._count % _DRAW_WAYS_EVERY == 0:
                self._scene.draw_ways(list(self.ticks))
        counts = len(tick.artefacts), len(tick.perceived)
        self.counts.content = "{} artefacts, {} perceived".format(*counts)
        if self._follows_camera.value and tick.map_from_camera is not None:
            self._look_through(tick.map_from_camera)

    def _draw_place(self, tick: Moment) -> None:
        """Draw the map, and draw it anew when another one arrives."""
        reader = self._reader
        if reader.grid is None:
            return
        place = place_of(self._parameters, reader.grid, reader.voxels(), reader.camera)
        self._shown_revision = reader.revision
        self._server.scene.reset()
        self._scene = ViewedScene(self._server.scene, place)
        aim_camera(self._server, place, [tick], _MARGIN_M)
        for name, box in self._layers.items():
            self._scene.switch(name, is_shown=box.value)

    def _look_through(self, map_from_camera: Any) -> None:
        for client in self._server.get_clients().values():
            with client.atomic():
                client.camera.wxyz = wxyz_of(map_from_camera.rotation_xyzw)
                client.camera.position = tuple(map_from_camera.translation_m.tolist())

    # ------------------------------------------------------------------------- what can be changed

    def _add_controls(self) -> None:
        gui = self._server.gui
        self.counts = gui.add_markdown("waiting for the map and the node's artefacts")
        """What is shown, or why nothing is: the first text of the page."""
        self._status = gui.add_markdown("")
        artefacts = gui.add_button_group(
            "artefacts", (_PAUSE, "go on"), hint="The node's service ~/pause."
        )

        def pause(_: Any) -> None:
            is_paused = artefacts.value == _PAUSE
            self._requests.put(lambda: self.pause(is_paused=is_paused))

        artefacts.on_click(pause)
        self._follows_camera = gui.add_checkbox("look through the robot's camera", False)
        with gui.add_folder("place an artefact"):
            rows = self._labels()
            self._label = gui.add_dropdown("which", tuple(rows), initial_value=rows[0])
            clicks = gui.add_checkbox("a click on the ground places it", False)
            clicks.on_update(lambda _: self.take_clicks(is_on=clicks.value))
        with gui.add_folder("layers"):
            self._layers = {name: gui.add_checkbox(name, True) for name in LAYERS}
        for name, box in self._layers.items():
            box.on_update(lambda _, name=name, box=box: self._switch(name, box.value))
        self._add_sliders()

    def _add_sliders(self) -> None:
        """Add a slider for each number that may change while the node runs."""
        sections: dict[str, list[Description]] = {}
        for item in describe(Parameters()):
            if item.live and type(item.default) in {int, float}:
                sections.setdefault(item.path.rpartition(".")[0], []).append(item)
        for section, items in sections.items():
            with self._server.gui.add_folder(section or "parameters", expand_by_default=False):
                for item in items:
                    self._add_slider(item)

    def _add_slider(self, item: Description) -> None:
        value = value_at(self._parameters, item.path)
        low, high, step = slider_range(item, value)
        slider = self._server.gui.add_slider(
            item.path.rpartition(".")[2] + (f" [{item.unit}]" if item.unit else ""),
            min=low,
            max=high,
            step=step,
            initial_value=type(item.default)(min(max(value, low), high)),
            hint=item.text,
        )
        kind = int if type(item.default) is int else float
        self.sliders[item.path] = slider

        def send(event: Any) -> None:
            if event.client is not None:  # else the slider follows the node
                self._requests.put(lambda: self._set(item.path, kind(slider.value)))

        slider.on_update(send)

    def _follow(self, event: Any) -> None:
        """Move the sliders of the node's parameters that somebody has set."""
        if event.node != self._remote.name:
            return
        for parameter in event.changed_parameters:
            if parameter.name in self.sliders:
                self._move_slider(parameter.name, parameter_value_to_python(parameter.value))

    def _move_slider(self, path: str, value: float) -> None:
        slider = self.sliders[path]
        value = type(slider.value)(value)
        slider.min, slider.max = min(slider.min, value), max(slider.max, value)
        slider.value = value

    def _read_parameters(self) -> str:
        """Move all sliders to the parameters of the node."""
        parameters = self._remote.parameters()
        for path in self.sliders:
            self._move_slider(path, value_at(parameters, path))
        return f"{self._remote.name} is there again"

    def _set(self, path: str, value: float) -> str:
        return self._remote.set_parameter(path, value) or f"{path} is {value:g}"

    def pause(self, *, is_paused: bool) -> str:
        """Pause the node, or let it go on; return what it says."""
        answer = self._remote.ask("pause", "std_srvs/srv/SetBool", data=is_paused)
        return str(answer.message)

    def _switch(self, name: str, is_shown: bool) -> None:
        if self._scene is not None:
            self._scene.switch(name, is_shown=is_shown)

    def _labels(self) -> list[str]:
        from are_ros.builder.assembly import catalogue_of

        try:
            catalogue = catalogue_of(self._parameters)
        except AreError:
            return ["any"]
        return ["any", *catalogue.class_names, *dict.fromkeys(r.label for r in catalogue.rows)]

    def take_clicks(self, *, is_on: bool) -> None:
        """Let a click on the ground place an artefact, or not any more."""
        scene = self._server.scene
        if is_on:
            scene.on_click()(lambda event: self.clicked(event.ray_origin, event.ray_direction))
        else:
            scene.remove_click_callback()

    def clicked(self, origin: Any, direction: Any) -> None:
        """Place an artefact where the ray of a click meets the ground."""
        ground_m = self._parameters.world.ground_height
        start, way = np.asarray(origin, np.float64), np.asarray(direction, np.float64)
        if way[2] < 0.0 and start[2] > ground_m:
            x_m, y_m, _ = (start + way * ((ground_m - start[2]) / way[2])).tolist()
            self._requests.put(lambda: self._spawn(x_m, y_m))

    def _spawn(self, x_m: float, y_m: float) -> str:
        pose = message_class("geometry_msgs/msg/PoseStamped")()
        pose.header.frame_id = self._parameters.frames.map
        pose.pose.position.x, pose.pose.position.y = x_m, y_m
        pose.pose.orientation.w = 1.0
        label = "" if self._label.value == "any" else self._label.value
        kind = "are_msgs/srv/SpawnArtefact"
        answer = self._remote.ask("spawn", kind, attempts=1, pose=pose, label=label)
        return str(answer.message)


def remapped(
    wanted: Mapping[tuple[str, str], str], heard: Mapping[str, str]
) -> dict[tuple[str, str], str]:
    """Return where each of the wanted inputs is, given what the node subscribes to.

    One that the node does not hear is remapped, if the node hears just one other topic of its type:
    but for the CameraInfo of its images, where it hears more.
    """
    named, found = {name for _, name in wanted}, {key: key[1] for key in wanted}
    kinds = {key: INPUTS[input_role].type_name for key, input_role in wanted.items()}
    beside_images = {camera_info_topic(name) for name in heard if heard[name].endswith("Image")}
    for kind in set(kinds.values()):
        lost = [key for key in wanted if kinds[key] == kind and key[1] not in heard]
        others = [name for name in heard if heard[name] == kind and name not in named]
        if len(others) > 1:
            others = [name for name in others if name not in beside_images]
        if len(lost) == len(others) == 1:
            found[lost[0]] = others[0]
    return found


def slider_range(item: Description, value: float) -> tuple[float, float, float]:
    """Return the least and the greatest value of a parameter's slider, and its step.

    The slider ends at four times the value or the default, where the bounds are farther away.
    """
    usual = max(abs(value), abs(float(item.default)))  # type: ignore[arg-type]
    reach = 4.0 * usual if usual > 0.0 else 1.0
    low = max(-reach, -reach if item.low is None else item.low)
    high = max(value, min(reach, reach if item.high is None else item.high))
    if type(item.default) is int:
        return int(low), max(int(np.ceil(high)), int(low) + 1), 1
    return low, high, (high - low) / _SLIDER_STEPS
