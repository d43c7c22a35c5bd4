"""One artefact's life as a replay keeps it: when it came and went, where it stood, when seen."""

import math
from array import array
from dataclasses import dataclass, field

import numpy as np

from are_ros.artefacts.artefact import GroundPose
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.draw.scene import Doing, Life, Track


@dataclass
class LifeRecorder:
    """Collects a `Life`, tick by tick; `departure_ns` and `left_by` are set from outside."""

    row: CatalogueRow
    arrival_ns: int
    departure_ns: int | None = None
    left_by: str = ""
    stamps_ns: "array[int]" = field(default_factory=lambda: array("q"))
    poses: "array[float]" = field(default_factory=lambda: array("d"))
    last_pose: GroundPose | None = None
    seen_ns: "array[int]" = field(default_factory=lambda: array("q"))
    doings: list[Doing] = field(default_factory=list)

    def stand(self, stamp_ns: int, pose: GroundPose) -> None:
        """Say where the artefact stands; kept only if it is elsewhere than before."""
        if pose == self.last_pose:
            return
        self.last_pose = pose
        x_m, y_m, _ = self.row.box_centre_in_artefact_m
        cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        self.stamps_ns.append(stamp_ns)
        centre_m = (pose.x_m + cos * x_m - sin * y_m, pose.y_m + sin * x_m + cos * y_m)
        self.poses.extend((*centre_m, pose.yaw_rad))

    def do(self, stamp_ns: int, behaviour: str, activity: str) -> None:
        """Say what it does; kept only if it is something else than before."""
        if not self.doings or self.doings[-1][1:] != (behaviour, activity):
            self.doings.append(Doing(stamp_ns, behaviour, activity))

    def see(self, stamp_ns: int) -> None:
        """Say that a tick perceived it."""
        self.seen_ns.append(stamp_ns)

    def finished(self, artefact_id: int) -> Life:
        """Return the life as it is known so far."""
        return Life(
            artefact_id,
            self.row,
            self.arrival_ns,
            self.departure_ns,
            self.left_by,
            track_of(self.stamps_ns, self.poses, 3),
            len(self.seen_ns),
            self.seen_ns[0] if self.seen_ns else None,
            self.seen_ns[-1] if self.seen_ns else None,
            np.array(self.seen_ns, dtype=np.int64),
            tuple(self.doings),
        )


def track_of(stamps_ns: "array[int]", poses: "array[float]", width: int) -> Track:
    """Return the track of flat stamps and poses, `width` numbers each."""
    stamps = np.array(stamps_ns, dtype=np.int64)
    return Track(stamps, np.array(poses, dtype=np.float64).reshape(-1, width))
