"""The artefacts, what is perceived of them, their events and the metrics as are_msgs."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from are_ros.artefacts.artefact import GroundPose
from are_ros.builder.events import ArtefactEvent
from are_ros.builder.outputs import ArtefactState, PerceivedArtefact, SceneMetrics
from are_ros.messages.factory import MessageFactory
from are_ros.messages.geometry import make_point, make_quaternion, make_twist, make_vector
from are_ros.messages.headers import make_header
from are_ros.messages.poses import make_pose
from are_ros.messages.times import make_time


def make_artefacts(
    factory: MessageFactory, frame_id: str, stamp_ns: int, artefacts: Iterable[Any]
) -> Any:
    """Return an are_msgs/ArtefactArray of messages that `make_artefact` made."""
    return factory.make(
        "are_msgs/msg/ArtefactArray",
        header=make_header(factory, frame_id, stamp_ns),
        artefacts=list(artefacts),
    )


def make_perceived(
    factory: MessageFactory,
    frame_id: str,
    stamp_ns: int,
    observer: str,
    perceived: Iterable[PerceivedArtefact],
) -> Any:
    """Return an are_msgs/PerceivedArtefactArray: A_f of one observer, in the map's frame."""
    return factory.make(
        "are_msgs/msg/PerceivedArtefactArray",
        header=make_header(factory, frame_id, stamp_ns),
        observer=observer,
        artefacts=[_make_perceived_artefact(factory, artefact) for artefact in perceived],
    )


def make_event(factory: MessageFactory, frame_id: str, event: ArtefactEvent) -> Any:
    """Return an are_msgs/ArtefactEvent; its kinds are the constants of the message."""
    return factory.make(
        "are_msgs/msg/ArtefactEvent",
        header=make_header(factory, frame_id, event.stamp_ns),
        kind=int(event.kind),
        id=event.artefact_id,
        label=event.label,
        detail=event.detail,
        value=float(event.value),
    )


def make_metrics(
    factory: MessageFactory, frame_id: str, stamp_ns: int, metrics: SceneMetrics
) -> Any:
    """Return an are_msgs/SceneMetrics."""
    return factory.make(
        "are_msgs/msg/SceneMetrics",
        header=make_header(factory, frame_id, stamp_ns),
        alive=metrics.alive,
        perceived=metrics.perceived,
        arrivals=metrics.arrivals,
        departures=metrics.departures,
        blocked=metrics.blocked,
        displaced=metrics.displaced,
        robot_contacts=metrics.robot_contacts,
        area_m2=float(metrics.area_m2),
        clutter_ratio=float(metrics.clutter_ratio),
        rho=float(metrics.rho),
    )


def make_artefact(factory: MessageFactory, state: ArtefactState) -> Any:
    """Return an are_msgs/Artefact: the ground truth of one artefact, in the map's frame."""
    return factory.make(
        "are_msgs/msg/Artefact",
        id=state.artefact_id,
        row=state.row,
        label=state.label,
        class_name=state.class_name,
        pose=make_pose(factory, state.map_from_artefact),
        ground_pose=_make_ground_pose(factory, state.ground_pose),
        box_centre=make_point(factory, state.box_centre_m),
        size=make_vector(factory, state.size_m),
        twist=make_twist(factory, state.linear_velocity_m_s, state.angular_velocity_rad_s),
        behaviour=state.behaviour,
        arrival=make_time(factory, state.arrival_ns),
        departure=make_time(factory, state.departure_ns),
        origin=int(state.origin),
        features=[
            factory.make("diagnostic_msgs/msg/KeyValue", key=key, value=value)
            for key, value in state.features.items()
        ],
    )


def _make_perceived_artefact(factory: MessageFactory, artefact: PerceivedArtefact) -> Any:
    linear, angular = artefact.linear_velocity_m_s, artefact.angular_velocity_rad_s
    x, y, width, height = artefact.roi_px
    return factory.make(
        "are_msgs/msg/PerceivedArtefact",
        id=artefact.artefact_id,
        label=artefact.label,
        classes=list(artefact.classes),
        probabilities=np.array(artefact.probabilities, dtype=np.float32),
        pose=factory.make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=make_pose(factory, artefact.map_from_artefact),
            covariance=np.array(artefact.pose_covariance, dtype=np.float64),
        ),
        size=make_vector(factory, artefact.size_m),
        twist=factory.make(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=make_twist(factory, linear, angular),
            covariance=np.array(artefact.twist_covariance, dtype=np.float64),
        ),
        visible_pixels=artefact.visible_pixels,
        unoccluded_pixels=artefact.unoccluded_pixels,
        visible_fraction=float(artefact.visible_fraction),
        range=float(artefact.range_m),
        existence=float(artefact.existence),
        roi=factory.make(
            "sensor_msgs/msg/RegionOfInterest",
            x_offset=x,
            y_offset=y,
            height=height,
            width=width,
            do_rectify=False,
        ),
        last_seen=make_time(factory, artefact.last_seen_ns),
    )


def _make_ground_pose(factory: MessageFactory, pose: GroundPose) -> Any:
    half_rad = 0.5 * pose.yaw_rad
    return factory.make(
        "geometry_msgs/msg/Pose",
        position=make_point(factory, (pose.x_m, pose.y_m, pose.z_m)),
        orientation=make_quaternion(factory, (0.0, 0.0, math.sin(half_rad), math.cos(half_rad))),
    )
