"""The artefacts, those perceived, events and metrics as the bytes of their messages."""

import math
from collections.abc import Sequence
from struct import Struct
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import (
    ArtefactEvent,
    PerceivedArtefact,
    PredictedPath,
    SceneMetrics,
)
from are_ros.builder.scene import Scene, Status, features_of
from are_ros.conventions import NS_PER_S
from are_ros.messages.cdr import CdrWriter
from are_ros.population.artefact import Artefact

_ID_AND_ROW: Final = Struct("<QI")


class _Block(NamedTuple):
    """What stands before and behind the numbers of an artefact, which begin at a multiple of 8."""

    artefact: Artefact
    status: Status
    head: bytes
    tail: bytes


class ArtefactEncoder:
    """Encodes the artefacts of scenes, and keeps what did not change since the last one."""

    def __init__(self) -> None:
        self._blocks: dict[int, _Block] = {}

    def encode(self, frame_id: str, stamp_ns: int, scene: Scene) -> bytes:
        """Return an are_msgs/ArtefactArray; ids are distinct."""
        writer = CdrWriter()
        writer.header(frame_id, stamp_ns)
        writer.count(len(scene))
        before, self._blocks = self._blocks, {}
        parts = [b""]
        numbers = _numbers(scene).tobytes()
        size = len(numbers) // max(len(scene), 1)
        for k, (artefact, status) in enumerate(zip(scene.artefacts, scene.status, strict=True)):
            block = before.get(artefact.id)
            if block is None or block.artefact is not artefact or block.status != status:
                block = _Block(artefact, status, _head(artefact), _tail(artefact, status))
            self._blocks[artefact.id] = block
            parts += (block.head, numbers[k * size : (k + 1) * size], block.tail)
            parts.append(bytes(-len(block.tail) % 8))
        if scene.artefacts:
            writer.align(8)
        return b"".join((writer.message(), *parts[:-1]))


def _head(artefact: Artefact) -> bytes:
    """Return what stands before the numbers, padded for them."""
    row = artefact.row
    writer = CdrWriter()
    writer.pack(_ID_AND_ROW, 8, artefact.id, row.index)
    writer.text(row.label)
    writer.text(row.class_name)
    writer.align(8)
    return writer.part()


def _numbers(scene: Scene) -> npt.NDArray[np.float64]:
    """Return the numbers (N, 26): pose, ground pose, the box's centre and size, and the twist."""
    numbers = np.zeros((len(scene), 26), dtype="<f8")
    numbers[:, :7] = scene.poses
    numbers[:, 7:10] = scene.motions[:, :3]
    numbers[:, 12:14] = scene.poses[:, 5:]
    boxes = [(*row.box_centre_in_artefact_m, *row.size_m) for row in scene.rows]
    numbers[:, 14:20] = np.array(boxes).reshape(-1, 6)
    numbers[:, 20:22] = scene.twists[:, :2]
    numbers[:, 25] = scene.twists[:, 2]
    return numbers


_LATEST_NS: Final = 2**31 * NS_PER_S - 1
"""The latest time that a builtin_interfaces/Time holds, in 2038."""


def _tail(artefact: Artefact, status: Status) -> bytes:
    """Return what stands behind the numbers."""
    departure_ns, behaviour, activity, planner = status
    features = features_of(artefact.row, activity, planner)
    writer = CdrWriter()
    writer.text(behaviour)
    writer.time(artefact.arrival_ns)
    writer.time(min(departure_ns or 0, _LATEST_NS))
    writer.byte(artefact.origin)
    writer.count(len(features))
    for key, value in features.items():
        writer.text(key)
        writer.text(value)
    return writer.part()


# What is perceived of the artefacts, what happened to them, and the metrics, as bytes.


_UINT64: Final = Struct("<Q")
_PIXELS_AND_SHARES: Final = Struct("<2I3f")
_COUNTS: Final = Struct("<5Q")


def encode_perceived(
    frame_id: str, stamp_ns: int, observer: str, perceived: Sequence[PerceivedArtefact]
) -> bytes:
    """Return an are_msgs/PerceivedArtefactArray: A_f of one observer, in the map's frame."""
    writer = CdrWriter()
    writer.header(frame_id, stamp_ns)
    writer.text(observer)
    writer.count(len(perceived))
    for artefact in perceived:
        _append_perceived(writer, artefact)
    return writer.message()


def encode_predicted(
    frame_id: str, stamp_ns: int, observer: str, step_ns: int, paths: Sequence[PredictedPath]
) -> bytes:
    """Return an are_msgs/PredictedPathArray: poses in the map's frame, `step_ns` apart."""
    writer = CdrWriter()
    writer.header(frame_id, stamp_ns)
    writer.text(observer)
    writer.time(step_ns)
    writer.count(len(paths))
    for path in paths:
        writer.pack(_UINT64, 8, path.artefact_id)
        writer.numbers(path.numbers, "<f8")
    return writer.message()


def encode_event(frame_id: str, event: ArtefactEvent) -> bytes:
    """Return an are_msgs/ArtefactEvent; its kinds are the constants of the message."""
    writer = CdrWriter()
    writer.header(frame_id, event.stamp_ns)
    writer.byte(event.kind)
    writer.pack(_UINT64, 8, event.artefact_id)
    writer.text(event.label)
    writer.text(event.detail)
    writer.doubles(event.value)
    return writer.message()


def encode_metrics(frame_id: str, stamp_ns: int, metrics: SceneMetrics) -> bytes:
    """Return an are_msgs/SceneMetrics; rho of Eq. 3 is NaN: the planning time is not known here."""
    writer = CdrWriter()
    writer.header(frame_id, stamp_ns)
    writer.count(metrics.alive)
    writer.count(metrics.perceived)
    writer.pack(
        _COUNTS,
        8,
        metrics.arrivals,
        metrics.departures,
        metrics.blocked,
        metrics.displaced,
        metrics.robot_contacts,
    )
    writer.doubles(metrics.area_m2, metrics.clutter_ratio, math.nan)
    return writer.message()


def _append_perceived(writer: CdrWriter, artefact: PerceivedArtefact) -> None:
    writer.pack(_UINT64, 8, artefact.artefact_id)
    writer.text(artefact.label)
    writer.texts(artefact.classes)
    writer.numbers(np.array(artefact.probabilities), "<f4")
    writer.pose(artefact.map_from_artefact)
    writer.doubles(
        *artefact.pose_covariance,
        *artefact.size_m,
        *artefact.linear_velocity_m_s,
        *artefact.angular_velocity_rad_s,
        *artefact.twist_covariance,
    )
    seen = artefact.sighting
    writer.pack(
        _PIXELS_AND_SHARES,
        4,
        seen.visible_pixels,
        seen.unoccluded_pixels,
        seen.visible_fraction,
        seen.range_m,
        artefact.existence,
    )
    writer.region(seen.roi_px)
    writer.time(seen.seen_ns)
    writer.texts(seen.cameras)
    writer.texts(artefact.behaviours)
    writer.numbers(np.array(artefact.behaviour_probabilities), "<f4")
