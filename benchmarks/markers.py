"""1,000 moving CUBE markers out: encoded and published as bytes, against rclpy's own objects.

    ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST python benchmarks/markers.py [repetitions]

It needs rclpy and visualization_msgs: in a terminal where ROS 2 is sourced, or in the environment
that `make test` builds. One peer builds the 1,000 objects each time, the other changes the poses
of the same ones; both publish them as a MarkerArray. Ours takes what the marker display gave out,
encodes it and publishes the bytes. All publish to nobody, then to a subscriber in this process
which takes the bytes. What the display costs is said apart, for 1,000 artefacts (3,000 markers
with labels and headings) of which all, half or none move.

Rounds alternate, and each calls its way ten times: the first call finds the caches full of what the
others left, as a tick does, the rest find its own data there. Medians of both are printed.
"""

import argparse
import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import rclpy
from rclpy.node import Node
from visualization_msgs.msg import Marker, MarkerArray

from are_ros.builder.files.catalogue_file import SHIPPED_CATALOGUE, read_catalogue
from are_ros.builder.markers import MarkerBatch, MarkerDisplay
from are_ros.builder.scene import Scene
from are_ros.conventions import NS_PER_S
from are_ros.messages.markers import MarkerEncoder
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import CatalogueRow

COUNT = 1_000
CALLS = 10
OURS = "are_ros, encoded"
PERIOD_NS = NS_PER_S // 10
TICKS = 8
Action = Callable[[], None]


class Walk(PoseHistory):
    """The history of an artefact that moves at 1 m/s, seen at one pose."""

    def velocity_at(self, t_ns: int) -> tuple[float, float, float]:
        """Return the rates of x, y [m/s] and yaw [rad/s]."""
        yaw_rad = self.pose_at(t_ns).yaw_rad
        return math.cos(yaw_rad), math.sin(yaw_rad), 0.0


def artefacts_of(rows: Sequence[CatalogueRow], offset_m: float) -> list[Artefact]:
    """Return one artefact of each row, all moved by the same offset."""
    artefacts = []
    for number, row in enumerate(rows):
        x_m, y_m, yaw_rad = number % 40 + offset_m, number // 40, 0.1 * number + offset_m
        walk = Walk(0, GroundPose(x_m, y_m, 0.0, yaw_rad))
        artefacts.append(Artefact(number, row, Origin.RANDOM, 0, walk, behaviour="walking"))
    return artefacts


class Ticks:
    """The same ticks over and over, of artefacts the first `moving` of which move at each."""

    def __init__(self, rows: Sequence[CatalogueRow], moving: int) -> None:
        standing = artefacts_of(rows, 0.0)[moving:]
        self._scenes = [
            Scene.of(artefacts_of(rows, 0.1 * k)[:moving] + standing, 0)
            for k in range(TICKS if moving else 1)
        ]
        self._display = MarkerDisplay()
        self._encoder = MarkerEncoder()
        self._now = 0

    def draw(self) -> MarkerBatch:
        """Return what the display gives out at the next tick."""
        self._now += 1
        scene = self._scenes[self._now % len(self._scenes)]
        return self._display.update(self._now * PERIOD_NS, scene, ())

    def encode(self, batch: MarkerBatch) -> bytes:
        """Return a batch as bytes."""
        return self._encoder.encode("map", self._now * PERIOD_NS, batch)

    def drawn(self) -> list[MarkerBatch]:
        """Return what comes at the next ticks, without the DELETEALL of the first."""
        return [self.draw() for _ in range(TICKS + 1)][1:]


def cubes_of(batch: MarkerBatch) -> MarkerBatch:
    """Return the bodies among the markers of a display."""
    return MarkerBatch(batch.looks[::3], batch.ids[::3], batch.poses[::3].copy())


def rclpy_marker(number: int, pose: npt.NDArray[np.float64]) -> Any:
    """Return a CUBE as an object of rclpy."""
    marker = Marker(ns="body", id=number, type=Marker.CUBE, action=Marker.ADD)
    marker.header.frame_id = "map"
    marker.lifetime.sec = 3
    marker.scale.x, marker.scale.y, marker.scale.z = 0.5, 0.6, 1.7
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = 0.2, 0.4, 0.6, 1.0
    put(marker, pose)
    return marker


def put(marker: Any, pose: npt.NDArray[np.float64]) -> None:
    """Change the pose of a marker."""
    place, turn = marker.pose.position, marker.pose.orientation
    place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = pose.tolist()


def marker_ways(publisher: Any, batches: Sequence[MarkerBatch]) -> Mapping[str, Action]:
    """Return the ways of publishing 1,000 cubes, each at new poses."""
    encoder, kept = MarkerEncoder(), [rclpy_marker(k, p) for k, p in enumerate(batches[0].poses)]
    tick = 0

    def next_batch() -> MarkerBatch:
        nonlocal tick
        tick += 1
        return batches[tick % TICKS]

    def built() -> None:
        markers = [rclpy_marker(k, pose) for k, pose in enumerate(next_batch().poses)]
        publisher.publish(MarkerArray(markers=markers))

    def reused() -> None:
        for marker, pose in zip(kept, next_batch().poses, strict=True):
            put(marker, pose)
            marker.header.stamp.sec = tick
        publisher.publish(MarkerArray(markers=kept))

    def ours() -> None:
        publisher.publish(encoder.encode("map", tick * PERIOD_NS, next_batch()))

    return {"rclpy, built": built, "rclpy, reused": reused, OURS: ours}


def display_ways(publisher: Any, rows: Sequence[CatalogueRow]) -> Mapping[str, Action]:
    """Return the parts of a tick, and the whole of it, when all, half or none of `rows` move."""
    ways: dict[str, Action] = {}
    for name, moving in (("all move", COUNT), ("half move", COUNT // 2), ("all stand", 0)):
        drawing, encoding, whole = (Ticks(rows, moving) for _ in range(3))
        ways[f"{name}: display"] = partial(_draw, drawing)
        ways[f"{name}: encoding"] = partial(_encode, encoding, deque(encoding.drawn()))
        ways[f"{name}: display, encoding, publishing"] = partial(_publish, publisher, whole)
    return ways


def _draw(ticks: Ticks) -> None:
    ticks.draw()


def _encode(ticks: Ticks, batches: deque[MarkerBatch]) -> None:
    batches.rotate(-1)
    ticks.encode(batches[0])


def _publish(publisher: Any, ticks: Ticks) -> None:
    publisher.publish(ticks.encode(ticks.draw()))


def medians_us(
    ways: Mapping[str, Action], repetitions: int, between: Action
) -> dict[str, tuple[float, float]]:
    """Return the median times [us] of each way, measured in turns: of first calls, and of others.

    What `between` does after each call is not measured.
    """
    taken: dict[str, list[list[float]]] = {name: [] for name in ways}
    for _ in range(repetitions):
        for name, action in ways.items():
            taken[name].append([measured_us(action, between) for _ in range(CALLS)])
    return {
        name: (float(np.median([t[0] for t in times])), float(np.median([t[1:] for t in times])))
        for name, times in taken.items()
    }


def measured_us(action: Action, between: Action) -> float:
    """Return how long an action takes [us]."""
    start = time.perf_counter()
    action()
    elapsed_us = 1e6 * (time.perf_counter() - start)
    between()
    return elapsed_us


def report(heading: str, medians: Mapping[str, tuple[float, float]]) -> None:
    """Print medians, and how many times longer than ours where ours is among them."""
    print(f"{heading:40s} {'first [us]':>12s} {'then [us]':>12s} {'x first':>8s} {'x then':>8s}")
    for name, medians_of_name in medians.items():
        row = f"{name:40s} " + " ".join(f"{median:12.1f}" for median in medians_of_name)
        if OURS in medians:
            ours = medians[OURS]
            row += "".join(f"{m / o:9.0f}" for m, o in zip(medians_of_name, ours, strict=True))
        print(row)
    print()


def main(repetitions: int) -> None:
    """Print medians of interleaved runs."""
    rows = [row for _ in range(COUNT) for row in read_catalogue(SHIPPED_CATALOGUE).rows[:1]]
    batches = [cubes_of(batch) for batch in Ticks(rows, COUNT).drawn()]
    rclpy.init()
    node = Node("markers_benchmark")
    publisher = node.create_publisher(MarkerArray, "markers", 10)
    nobody = medians_us(marker_ways(publisher, batches), repetitions, lambda: None)
    display = medians_us(display_ways(publisher, rows), repetitions, lambda: None)
    received: list[bytes] = []
    node.create_subscription(MarkerArray, "markers", received.append, 10, raw=True)
    one = medians_us(
        marker_ways(publisher, batches), repetitions, lambda: rclpy.spin_once(node, timeout_sec=1)
    )
    report("1,000 cubes to nobody", nobody)
    report("1,000 cubes to one subscriber", one)
    report("1,000 artefacts to nobody", display)
    if len({len(data) for data in received}) != 1:
        raise SystemExit("the messages received differ in length, or there are none")
    rclpy.shutdown()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("repetitions", nargs="?", type=int, default=21)
    main(parser.parse_args().repetitions)
