"""Frames, robot and camera of a recording, as the node finds them: by tf, odometry, parameters."""

from typing import Any, Final

from are_ros.builder.assembly import (
    chosen_camera,
    default_camera,
    robot_tracker,
    set_static_frames,
)
from are_ros.errors import FrameError
from are_ros.messages.camera_info import read_camera_info
from are_ros.messages.common import read_header
from are_ros.messages.odometry import OdometryNumbers
from are_ros.messages.transforms import StampedTransform
from are_ros.parameters.choices import CameraModel, OdometryUse
from are_ros.parameters.model import Parameters
from are_ros.world.cameras import Camera
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.transforms.table import TransformSource
from are_ros.world.transforms.tree import FrameTree

_SOURCES: Final = {
    OdometryUse.AUTO: TransformSource.ODOMETRY,
    OdometryUse.USE: TransformSource.PREFERRED_ODOMETRY,
}


class RecordedFrames:
    """A tree with the static frames of the parameters, fed with transforms and odometry.

    The methods return why an input was refused, empty if it was accepted.
    """

    def __init__(self, parameters: Parameters) -> None:
        self.tree = FrameTree()
        self._source = _SOURCES.get(parameters.frames.odometry)
        set_static_frames(parameters, self.tree)

    def take_transform(self, transform: StampedTransform, *, is_static: bool) -> str:
        """Take one of /tf or /tf_static."""
        parent, child, stamp_ns, place, turn = transform
        try:
            if is_static:
                self.tree.set_static(parent, child, place, turn)
            else:
                self.tree.set_transform(parent, child, stamp_ns, place, turn)
        except FrameError as error:
            return str(error)
        return ""

    def take_odometry(self, numbers: OdometryNumbers, base: str) -> str:
        """Take the pose of an odometry, as `frames.odometry` says; of `base` if it names none."""
        if self._source is None:
            return ""
        child, stamp_ns = numbers.child_frame_id or base, numbers.stamp_ns
        place, turn = numbers.pose[:3], numbers.pose[3:]
        try:
            self.tree.set_transform(
                numbers.frame_id, child, stamp_ns, place, turn, source=self._source
            )
        except FrameError as error:
            return str(error)
        return ""


class RecordedRobot:
    """Poses of robot and camera from transforms, odometry and CameraInfo in the order of the log.

    A refused transform is left out: `are check` reports it, here a pose is missing.
    """

    def __init__(self, parameters: Parameters, *, has_camera_info: bool) -> None:
        """Take the parameters; without CameraInfo in the recording they define the camera."""
        self._parameters = parameters
        self._frames = RecordedFrames(parameters)
        self.tree = self._frames.tree
        self._tracker = robot_tracker(parameters, self._frames.tree)
        is_awaited = has_camera_info and parameters.camera.model is CameraModel.AUTO
        self.camera: Camera | None = None if is_awaited else default_camera(parameters)

    def take_transform(self, transform: StampedTransform, *, is_static: bool) -> None:
        """Take one of /tf or /tf_static."""
        self._frames.take_transform(transform, is_static=is_static)

    def take_odometry(self, numbers: OdometryNumbers) -> None:
        """Take the pose of an odometry, as `frames.odometry` says."""
        self._frames.take_odometry(numbers, self._tracker.base_frame())

    def take_camera(self, message: Any) -> None:
        """Take a CameraInfo. Raises InputError where it describes no camera."""
        view = read_camera_info(message).view(rectified=self._parameters.camera.rectified)
        frame_id = read_header(message, "camera_info").frame_id
        received = Camera(view, frame_id, RigidTransform.identity())
        self.camera = chosen_camera(self._parameters, received)

    @property
    def missing(self) -> str:
        """Why the pose of the robot that was asked for last is not known, empty if it is."""
        return self._tracker.missing

    def poses(self, now_ns: int) -> tuple[RigidTransform | None, RigidTransform | None]:
        """Return map_from_base and map_from_camera as of a tick, None where not known."""
        pose = self._tracker.pose(now_ns)
        camera = self._tracker.map_from_camera(self.camera, now_ns) if self.camera else None
        return (pose.map_from_base if pose else None), camera
