"""What takes the outputs of a replay: the record for the picture, the recording, the inputs."""

from collections.abc import Sequence

from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.sensor_path import ReleasedScan
from are_ros.builder.tick import Tick
from are_ros.replay.bag_reader import BagMessage
from are_ros.replay.input_copy import InputCopy
from are_ros.replay.runner import Listener
from are_ros.replay.scene_record import SceneRecorder
from are_ros.replay.tick_writer import TickWriter


class Silence:
    """Ignores everything; what listens to less than all derives from it."""

    def take_tick(self, tick: Tick) -> None:
        """Take a tick."""

    def take_scans(self, scans: Sequence[ReleasedScan]) -> None:
        """Take scans that left the sensor path."""

    def take_input(self, message: BagMessage, received_ns: int) -> None:
        """Take an input, after the builder did."""


class RecordKeeper(Silence):
    """Keeps what picture and metrics need."""

    def __init__(self, recorder: SceneRecorder, builder: ArBuilder) -> None:
        self._recorder = recorder
        self._builder = builder

    def take_tick(self, tick: Tick) -> None:
        """Keep a tick, with the camera that it looked through."""
        self._recorder.add(tick, self._builder.camera)


class CameraWatch(Silence):
    """Keeps the time of the first tick that knew the camera, None before there is one."""

    def __init__(self, builder: ArBuilder) -> None:
        self.first_ns: int | None = None
        self._builder = builder

    def take_tick(self, tick: Tick) -> None:
        """Look whether the camera is known."""
        if self.first_ns is None and self._builder.camera is not None:
            self.first_ns = tick.stamp_ns


class OutputWriter(Silence):
    """Writes ticks and scans."""

    def __init__(self, writer: TickWriter) -> None:
        self._writer = writer

    def take_tick(self, tick: Tick) -> None:
        """Write a tick."""
        self._writer.write_tick(tick)

    def take_scans(self, scans: Sequence[ReleasedScan]) -> None:
        """Write scans."""
        self._writer.write_scans(scans)


class InputWriter(Silence):
    """Writes the inputs."""

    def __init__(self, copy: InputCopy) -> None:
        self._copy = copy

    def take_input(self, message: BagMessage, received_ns: int) -> None:
        """Write an input."""
        self._copy.write(message, received_ns)


class All(Silence):
    """Tells several listeners, in their order."""

    def __init__(self, listeners: Sequence[Listener]) -> None:
        self._listeners = tuple(listeners)

    def take_tick(self, tick: Tick) -> None:
        """Tell of a tick."""
        for listener in self._listeners:
            listener.take_tick(tick)

    def take_scans(self, scans: Sequence[ReleasedScan]) -> None:
        """Tell of scans."""
        for listener in self._listeners:
            listener.take_scans(scans)

    def take_input(self, message: BagMessage, received_ns: int) -> None:
        """Tell of an input."""
        for listener in self._listeners:
            listener.take_input(message, received_ns)
