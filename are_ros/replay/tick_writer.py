"""The outputs of the builder into a recording, under the names that they have live."""

from collections.abc import Sequence

from are_ros.builder.sensor_path import ReleasedScan
from are_ros.builder.tick import EVERYTHING, Demand, Tick
from are_ros.messages.tick_encoding import OUTPUTS, TickEncoder, encode_scan, scan_outputs
from are_ros.replay.bag_writer import BagWriter

PREFIX = "/ar_builder/"


class TickWriter:
    """Encodes ticks and released scans, and appends them."""

    def __init__(
        self, writer: BagWriter, scan_topics: Sequence[str], demand: Demand = EVERYTHING
    ) -> None:
        """Announce all output topics; `scan_topics` are the input topics of the scans."""
        self._writer = writer
        self._encoder = TickEncoder(demand)
        self._scan_outputs = {t: PREFIX + name for t, name in scan_outputs(scan_topics).items()}
        for name, (type_name, is_latched, depth) in OUTPUTS.items():
            writer.add_topic(PREFIX + name, type_name, is_latched=is_latched, depth=depth)
        for output in self._scan_outputs.values():
            writer.add_topic(output, "sensor_msgs/msg/LaserScan")

    def write_tick(self, tick: Tick) -> None:
        """Append everything that a tick gives out, at its time."""
        for name, stamp_ns, data in self._encoder.encode(tick):
            self._writer.write_raw(PREFIX + name, stamp_ns, data)

    def write_scans(self, scans: Sequence[ReleasedScan]) -> None:
        """Append scans, each at the time when it was released."""
        for released in scans:
            output = self._scan_outputs[released.topic]
            self._writer.write_raw(output, released.released_ns, encode_scan(released.scan))
