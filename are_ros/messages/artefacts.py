"""The artefacts, those perceived, events and metrics as the bytes of their messages."""

import math
from collections.abc import Sequence
from struct import Struct
from typing import Final, NamedTuple

import numpy as np

from are_ros.agents.events import ArtefactEvent, ArtefactState, PerceivedArtefact, SceneMetrics
from are_ros.messages.cdr import CdrWriter

_ID_AND_ROW: Final = Struct("<QI")
_NUMBERS: Final = Struct("<26d")
"""Both poses, the box's centre and size, and the twist."""

_ORIGIN: Final = Struct("<B")


class _Block(NamedTuple):
    """One artefact as bytes, between multiples of eight: head, numbers, tail and `padding`."""

    state: ArtefactState
    head: bytes
    tail: bytes
    padding: int
    whole: bytes


class ArtefactEncoder:
    """Encodes lists of artefacts, and keeps what did not change since the last of them."""

    def __init__(self) -> None:
        self._blocks: dict[int, _Block] = {}

    def encode(self, frame_id: str, stamp_ns: int, states: Sequence[ArtefactState]) -> bytes:
        """Return an are_msgs/ArtefactArray; ids are distinct."""
        blocks = [self._block(state) for state in states]
        self._blocks = {block.state.artefact_id: block for block in blocks}
        writer = CdrWriter()
        writer.header(frame_id, stamp_ns)
        writer.count(len(blocks))
        if not blocks:
            return writer.message()
        writer.align(8)
        parts = [block.whole for block in blocks]
        parts[-1] = parts[-1][: len(parts[-1]) - blocks[-1].padding]
        return b"".join((writer.message(), *parts))

    def _block(self, state: ArtefactState) -> _Block:
        """Return an artefact as bytes; those of a state that is the same are kept."""
        known = self._blocks.get(state.artefact_id)
        if known is None:
            head, tail = _head(state), _tail(state)
        elif known.state is state:
            return known
        else:
            head = known.head if _is_head_same(known.state, state) else _head(state)
            tail = known.tail if _is_tail_same(known.state, state) else _tail(state)
        padding = -len(tail) % 8
        whole = b"".join((head, _numbers(state), tail, bytes(padding)))
        return _Block(state, head, tail, padding, whole)


def _head(state: ArtefactState) -> bytes:
    """Return what stands before the numbers, padded for them."""
    writer = CdrWriter()
    writer.pack(_ID_AND_ROW, 8, state.artefact_id, state.row)
    writer.text(state.label)
    writer.text(state.class_name)
    writer.align(8)
    return writer.part()


def _is_head_same(one: ArtefactState, other: ArtefactState) -> bool:
    return one.row == other.row and one.label == other.label and one.class_name == other.class_name


def _numbers(state: ArtefactState) -> bytes:
    pose, ground = state.map_from_artefact, state.ground_pose
    half_rad = 0.5 * ground.yaw_rad
    return _NUMBERS.pack(
        *pose.translation_m.tolist(),
        *pose.rotation_xyzw.tolist(),
        *(ground.x_m, ground.y_m, ground.z_m),
        *(0.0, 0.0, math.sin(half_rad), math.cos(half_rad)),
        *state.box_centre_m,
        *state.size_m,
        *state.linear_velocity_m_s,
        *state.angular_velocity_rad_s,
    )


def _tail(state: ArtefactState) -> bytes:
    """Return what stands behind the numbers."""
    writer = CdrWriter()
    writer.text(state.behaviour)
    writer.time(state.arrival_ns)
    writer.time(state.departure_ns)
    writer.pack(_ORIGIN, 1, state.origin)
    writer.count(len(state.features))
    for key, value in state.features.items():
        writer.text(key)
        writer.text(value)
    return writer.part()


def _is_tail_same(one: ArtefactState, other: ArtefactState) -> bool:
    return (
        one.behaviour == other.behaviour
        and one.departure_ns == other.departure_ns
        and one.arrival_ns == other.arrival_ns
        and one.origin == other.origin
        and one.features == other.features
    )


# What is perceived of the artefacts, what happened to them, and the metrics, as bytes.


_BYTE: Final = Struct("<B")
_UINT64: Final = Struct("<Q")
_DOUBLE: Final = Struct("<d")
_POSE_SIZE_TWIST: Final = Struct("<88d")
"""A pose and a twist, each with its covariance, and the size between them."""

_PIXELS_AND_SHARES: Final = Struct("<2I3f")
_REGION: Final = Struct("<4I?")
_COUNTS: Final = Struct("<2I")
_LONG_COUNTS_AND_MEASURES: Final = Struct("<5Q3d")


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


def encode_event(frame_id: str, event: ArtefactEvent) -> bytes:
    """Return an are_msgs/ArtefactEvent; its kinds are the constants of the message."""
    writer = CdrWriter()
    writer.header(frame_id, event.stamp_ns)
    writer.pack(_BYTE, 1, event.kind)
    writer.pack(_UINT64, 8, event.artefact_id)
    writer.text(event.label)
    writer.text(event.detail)
    writer.pack(_DOUBLE, 8, event.value)
    return writer.message()


def encode_metrics(frame_id: str, stamp_ns: int, metrics: SceneMetrics) -> bytes:
    """Return an are_msgs/SceneMetrics."""
    writer = CdrWriter()
    writer.header(frame_id, stamp_ns)
    writer.pack(_COUNTS, 4, metrics.alive, metrics.perceived)
    writer.pack(
        _LONG_COUNTS_AND_MEASURES,
        8,
        metrics.arrivals,
        metrics.departures,
        metrics.blocked,
        metrics.displaced,
        metrics.robot_contacts,
        metrics.area_m2,
        metrics.clutter_ratio,
        metrics.rho,
    )
    return writer.message()


def _append_perceived(writer: CdrWriter, artefact: PerceivedArtefact) -> None:
    pose, (x, y, width, height) = artefact.map_from_artefact, artefact.roi_px
    writer.pack(_UINT64, 8, artefact.artefact_id)
    writer.text(artefact.label)
    writer.count(len(artefact.classes))
    for name in artefact.classes:
        writer.text(name)
    writer.numbers(np.array(artefact.probabilities), "<f4")
    writer.pack(
        _POSE_SIZE_TWIST,
        8,
        *pose.translation_m.tolist(),
        *pose.rotation_xyzw.tolist(),
        *artefact.pose_covariance,
        *artefact.size_m,
        *artefact.linear_velocity_m_s,
        *artefact.angular_velocity_rad_s,
        *artefact.twist_covariance,
    )
    writer.pack(
        _PIXELS_AND_SHARES,
        4,
        artefact.visible_pixels,
        artefact.unoccluded_pixels,
        artefact.visible_fraction,
        artefact.range_m,
        artefact.existence,
    )
    writer.pack(_REGION, 4, x, y, height, width, False)
    writer.time(artefact.last_seen_ns)
