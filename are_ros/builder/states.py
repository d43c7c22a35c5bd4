"""The artefacts as what goes out: ground truth, and what is perceived of it."""

import math
from collections.abc import Mapping

from are_ros.artefacts.artefact import Artefact, GroundPose, map_from_artefact
from are_ros.builder.observation import Sighting
from are_ros.builder.outputs import ArtefactState, PerceivedArtefact, Vector3
from are_ros.builder.scene import Scene

_CERTAIN = (0.0,) * 36


class StateKeeper:
    """Gives the state of each living artefact; of one that stands, the same object again."""

    def __init__(self) -> None:
        self._kept: dict[int, ArtefactState] = {}

    def states(self, scene: Scene, now_ns: int) -> list[ArtefactState]:
        """Return the ground truth of all of the scene of `now_ns`, in their order."""
        pairs = zip(scene.artefacts, scene.poses, strict=True)
        states = [self._state(artefact, pose, now_ns) for artefact, pose in pairs]
        self._kept = {state.artefact_id: state for state in states}
        return states

    def _state(self, artefact: Artefact, pose: GroundPose, now_ns: int) -> ArtefactState:
        kept, velocity = self._kept.get(artefact.id), artefact.history.velocity_at(now_ns)
        if kept is not None and not any(velocity) and _still_holds(kept, artefact, pose):
            return kept
        return _state_of(artefact, pose, velocity)


def _still_holds(state: ArtefactState, artefact: Artefact, pose: GroundPose) -> bool:
    """Tell whether a state is also that of one who stands at a pose."""
    return (
        state.ground_pose is pose
        and not any((*state.linear_velocity_m_s, *state.angular_velocity_rad_s))
        and state.departure_ns == (artefact.departure_ns or 0)
        and state.behaviour == artefact.behaviour
        and state.activity == artefact.activity
    )


def artefact_state(artefact: Artefact, now_ns: int) -> ArtefactState:
    """Return the ground truth of an artefact at `now_ns`, in the map's frame."""
    history = artefact.history
    return _state_of(artefact, history.pose_at(now_ns), history.velocity_at(now_ns))


def _state_of(artefact: Artefact, pose: GroundPose, velocity: Vector3) -> ArtefactState:
    """Return the ground truth of an artefact at a pose; rates of x, y, yaw in the map's frame."""
    row = artefact.row
    linear_m_s, angular_rad_s = _twist(pose.yaw_rad, velocity)
    return ArtefactState(
        artefact_id=artefact.id,
        row=row.index,
        label=row.label,
        class_name=row.class_name,
        map_from_artefact=map_from_artefact(row, pose),
        ground_pose=pose,
        box_centre_m=row.box_centre_in_artefact_m,
        size_m=row.size_m,
        linear_velocity_m_s=linear_m_s,
        angular_velocity_rad_s=angular_rad_s,
        behaviour=artefact.behaviour,
        activity=artefact.activity,
        arrival_ns=artefact.arrival_ns,
        departure_ns=artefact.departure_ns or 0,
        origin=artefact.origin,
        features=_features(row.features, artefact.activity),
    )


def _features(features: Mapping[str, str], activity: str) -> Mapping[str, str]:
    """Return the row's features, and what the artefact does just now where that is to be said."""
    return {**features, "activity": activity} if activity else features


def perceived_artefact(state: ArtefactState, sighting: Sighting, seen_ns: int) -> PerceivedArtefact:
    """Return what an observer without any uncertainty knows of an artefact that it saw."""
    return PerceivedArtefact(
        artefact_id=state.artefact_id,
        label=state.label,
        classes=(state.class_name,),
        probabilities=(1.0,),
        map_from_artefact=state.map_from_artefact,
        pose_covariance=_CERTAIN,
        size_m=state.size_m,
        linear_velocity_m_s=state.linear_velocity_m_s,
        angular_velocity_rad_s=state.angular_velocity_rad_s,
        twist_covariance=_CERTAIN,
        visible_pixels=sighting.visible_pixels,
        unoccluded_pixels=sighting.unoccluded_pixels,
        visible_fraction=sighting.visible_pixels / max(sighting.unoccluded_pixels, 1),
        range_m=sighting.range_m,
        existence=1.0,
        roi_px=sighting.roi_px,
        last_seen_ns=seen_ns,
    )


def _twist(yaw_rad: float, velocity: Vector3) -> tuple[Vector3, Vector3]:
    """Return the velocities in F_A, linear and angular, of the rates of x, y and yaw."""
    vx_m_s, vy_m_s, turn_rad_s = velocity
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    forward_m_s, left_m_s = cos * vx_m_s + sin * vy_m_s, cos * vy_m_s - sin * vx_m_s
    return (forward_m_s, left_m_s, 0.0), (0.0, 0.0, turn_rad_s)
