"""Messages of are_msgs back into the values of the builder, as far as a picture needs them."""

from typing import Any

from are_ros.artefacts.artefact import GroundPose, Origin
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.shapes import Shape
from are_ros.builder.events import ArtefactEvent, EventKind
from are_ros.builder.outputs import ArtefactState, SceneMetrics, Vector3
from are_ros.messages.common import read_time
from are_ros.world.rigid_transform import RigidTransform

_ACTIVITY = "activity"


def state_of(message: Any) -> ArtefactState:
    """Return the ground truth of an are_msgs/Artefact."""
    pose, ground = _transform(message.pose), _transform(message.ground_pose)
    x_m, y_m, z_m = ground.translation_m.tolist()
    features = {feature.key: feature.value for feature in message.features}
    return ArtefactState(
        artefact_id=int(message.id),
        row=int(message.row),
        label=message.label,
        class_name=message.class_name,
        map_from_artefact=pose,
        ground_pose=GroundPose(x_m, y_m, z_m, ground.yaw_rad()),
        box_centre_m=_vector(message.box_centre),
        size_m=_vector(message.size),
        linear_velocity_m_s=_vector(message.twist.linear),
        angular_velocity_rad_s=_vector(message.twist.angular),
        behaviour=message.behaviour,
        arrival_ns=read_time(message.arrival),
        departure_ns=read_time(message.departure),
        origin=Origin(message.origin),
        features=features,
        activity=features.get(_ACTIVITY, ""),
    )


def row_of(state: ArtefactState) -> CatalogueRow:
    """Return what an artefact tells of its row: label, class and box; the rest is unknown."""
    return CatalogueRow(
        state.row, state.label, state.class_name, state.size_m, state.box_centre_m, Shape.WALL
    )


def event_of(message: Any) -> ArtefactEvent:
    """Return an are_msgs/ArtefactEvent as a value."""
    return ArtefactEvent(
        read_time(message.header.stamp),
        EventKind(message.kind),
        int(message.id),
        message.label,
        message.detail,
        float(message.value),
    )


def metrics_of(message: Any) -> SceneMetrics:
    """Return an are_msgs/SceneMetrics as a value."""
    return SceneMetrics(
        alive=int(message.alive),
        perceived=int(message.perceived),
        arrivals=int(message.arrivals),
        departures=int(message.departures),
        blocked=int(message.blocked),
        displaced=int(message.displaced),
        robot_contacts=int(message.robot_contacts),
        area_m2=float(message.area_m2),
        clutter_ratio=float(message.clutter_ratio),
        rho=float(message.rho),
    )


def _transform(pose: Any) -> RigidTransform:
    place, turn = pose.position, pose.orientation
    return RigidTransform.checked((place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w))


def _vector(message: Any) -> Vector3:
    return float(message.x), float(message.y), float(message.z)
