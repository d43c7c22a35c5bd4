"""What is perceived of the artefacts, what happened to them, and the metrics, as bytes."""

from collections.abc import Sequence
from struct import Struct
from typing import Final

import numpy as np

from are_ros.builder.events import ArtefactEvent
from are_ros.builder.outputs import PerceivedArtefact, SceneMetrics
from are_ros.messages.cdr import CdrWriter

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
