"""The artefacts as what goes out: ground truth, and what is perceived of it."""

import math

from are_ros.agents.events import ArtefactState, PerceivedArtefact
from are_ros.builder.observation import Sighting
from are_ros.builder.scene import Scene
from are_ros.population.artefact import Artefact, GroundPose, map_from_artefact

_CERTAIN = (0.0,) * 36
_Key = tuple[bytes, int | None, str, str]


class StateKeeper:
    """Gives the state of each artefact of a scene; of one that has not changed, the same object."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[_Key, ArtefactState]] = {}

    def states(self, scene: Scene) -> list[ArtefactState]:
        """Return the ground truth of all of a scene, in their order."""
        raw, known, states = scene.motions.tobytes(), self._known, list[ArtefactState]()
        self._known = {}
        for k, artefact in enumerate(scene.artefacts):
            # by their bits: -0.0 is not 0.0 in the bytes of a message
            what = (artefact.departure_ns, artefact.behaviour, artefact.activity)
            key = (raw[56 * k : 56 * k + 56], *what)
            before = known.get(artefact.id)
            if before is None or before[0] != key:
                before = (key, _state_of(artefact, scene.poses[k], scene.motions[k, 4:].tolist()))
            self._known[artefact.id] = before
            states.append(before[1])
        return states


def _state_of(artefact: Artefact, pose: GroundPose, rates: list[float]) -> ArtefactState:
    """Return the ground truth of an artefact at a pose; rates of x, y, yaw in the map's frame."""
    row, activity = artefact.row, artefact.activity
    vx_m_s, vy_m_s, turn_rad_s = rates
    cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    return ArtefactState(
        artefact_id=artefact.id,
        row=row.index,
        label=row.label,
        class_name=row.class_name,
        map_from_artefact=map_from_artefact(row, pose),
        ground_pose=pose,
        box_centre_m=row.box_centre_in_artefact_m,
        size_m=row.size_m,
        linear_velocity_m_s=(cos * vx_m_s + sin * vy_m_s, cos * vy_m_s - sin * vx_m_s, 0.0),
        angular_velocity_rad_s=(0.0, 0.0, turn_rad_s),
        behaviour=artefact.behaviour,
        activity=activity,
        arrival_ns=artefact.arrival_ns,
        departure_ns=artefact.departure_ns or 0,
        origin=artefact.origin,
        features={**row.features, "activity": activity} if activity else row.features,
    )


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
