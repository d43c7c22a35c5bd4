"""The frames of a recording for the picture, at their newest or at a stamp.

As rviz knows them from /tf and /tf_static; and, as the node does, from the parameters and, where
tf does not tell, from odometry.
"""

from collections.abc import Iterable
from typing import Final

from are_ros.errors import FrameError
from are_ros.messages.odometry import OdometryNumbers
from are_ros.messages.transforms import StampedTransform
from are_ros.parameters.model import Parameters
from are_ros.replay._recorded_frames import RecordedFrames
from are_ros.world.frame_tree import STATIC
from are_ros.world.rigid_transform import RigidTransform

_USUAL_BASES: Final = ("base_footprint", "base_link")


class RvizFrames:
    """A tree of frames seen from a fixed one; `complaints` say what could not be found or taken."""

    def __init__(self, parameters: Parameters | None = None) -> None:
        self.complaints: list[str] = []
        self._parameters = parameters or Parameters()
        self._frames = RecordedFrames(self._parameters)
        self._tree = self._frames.tree

    def take(self, transforms: Iterable[StampedTransform], *, is_static: bool) -> None:
        """Take the transforms of a message; one that cannot be is a complaint."""
        for transform in transforms:
            self._complain(self._frames.take_transform(transform, is_static=is_static))

    def take_odometry(self, numbers: OdometryNumbers) -> None:
        """Take the pose of an odometry; one that cannot be taken is a complaint."""
        self._complain(self._frames.take_odometry(numbers, self.base()))

    def at(self, fixed: str, frame: str, stamp_ns: int) -> RigidTransform | None:
        """Return fixed_from_frame at a stamp, None where it is not known then."""
        frame = frame.lstrip("/")
        if frame == fixed:
            return RigidTransform.identity()
        return self._tree.try_lookup(fixed, frame, stamp_ns)

    def newest(self, fixed: str, frame: str) -> RigidTransform | None:
        """Return the newest fixed_from_frame, None (and a complaint) where there is none."""
        frame = frame.lstrip("/")
        if frame == fixed:
            return RigidTransform.identity()
        try:
            stamp_ns = self._tree.latest_common_time(fixed, frame)
            return self._tree.lookup(fixed, frame, 0 if stamp_ns == STATIC else stamp_ns)
        except FrameError as error:
            self.complaints.append(str(error))
            return None

    def axes(self, fixed: str) -> dict[str, RigidTransform]:
        """Return the newest pose of every frame that hangs together with the fixed one."""
        poses = {name: self.newest(fixed, name) for name in sorted(self._tree.frame_names())}
        return {name: pose for name, pose in poses.items() if pose is not None}

    def base(self) -> str:
        """Return the name of the robot's base: the one configured, else the usual one there is."""
        usual = (name for name in _USUAL_BASES if self._tree.has_frame(name))
        return self._parameters.frames.base or next(usual, _USUAL_BASES[0])

    def why_unknown(self, fixed: str, frame: str) -> str:
        """Return why the pose of a frame is not known, empty if it is."""
        try:
            self._tree.latest_common_time(fixed, frame)
        except FrameError as error:
            return str(error)
        return ""

    def _complain(self, reason: str) -> None:
        if reason:
            self.complaints.append(reason)
