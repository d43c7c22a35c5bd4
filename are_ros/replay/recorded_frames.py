"""Frames, robot and camera of a recording, as the node finds them: by tf, odometry, parameters."""

from contextlib import suppress
from typing import Any, Final

from are_ros.bag.reader import BagMessage, BagReader
from are_ros.bag.roles import CAMERA
from are_ros.builder.assembly import (
    chosen_camera,
    default_camera,
    odometry_source,
    robot_tracker,
    set_static_frames,
)
from are_ros.conventions import NS_PER_S
from are_ros.errors import FrameError, InputError
from are_ros.messages.common import read_header
from are_ros.messages.images.image import read_camera_info
from are_ros.messages.transforms import OdometryNumbers, StampedTransform
from are_ros.parameters.choices import CameraModel
from are_ros.parameters.model import Parameters
from are_ros.world.cameras import Camera, CameraAt
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.transforms.tree import FrameTree

FRAME_ROLES: Final = ("tf", "tf_static", "odom")
ROBOT_ROLES: Final = (*FRAME_ROLES, CAMERA)


class RecordedFrames:
    """A tree with the static frames of the parameters, fed with transforms and odometry.

    It keeps samples for `history_ns`. A refused transform is left out: `are check` reports it.
    """

    def __init__(self, parameters: Parameters, history_ns: int = 10 * NS_PER_S) -> None:
        self.tree = FrameTree(history_ns)
        self._parameters = parameters
        self._source = odometry_source(parameters)
        set_static_frames(parameters, self.tree)

    def base_frame(self) -> str:
        """Return the frame of odometry messages without a child frame."""
        return self._parameters.frames.base

    def take_message(self, reader: BagReader, message: BagMessage, role: str) -> None:
        """Take a message of tf, tf_static or odom; a malformed one is left out."""
        with suppress(InputError):  # a replay counts it, and goes on
            if role == "odom":
                self.take_odometry(reader.odometry(message))
                return
            for transform in reader.transforms(message):
                self.take_transform(transform, is_static=role == "tf_static")

    def take_transform(self, transform: StampedTransform, *, is_static: bool) -> None:
        """Take one of /tf or /tf_static."""
        parent, child, stamp_ns, place, turn = transform
        with suppress(FrameError):
            if is_static:
                self.tree.set_static(parent, child, place, turn)
            else:
                self.tree.set_transform(parent, child, stamp_ns, place, turn)

    def take_odometry(self, numbers: OdometryNumbers) -> None:
        """Take the pose of an odometry, as `frames.odometry` says."""
        if self._source is None:
            return
        parent, child = numbers.frame_id, numbers.child_frame_id or self.base_frame()
        place, turn = numbers.pose[:3], numbers.pose[3:]
        with suppress(FrameError):
            self.tree.set_transform(
                parent, child, numbers.stamp_ns, place, turn, source=self._source
            )


class RecordedRobot(RecordedFrames):
    """Poses of robot and camera, from transforms, odometry and CameraInfo in their order."""

    def __init__(self, parameters: Parameters, *, has_camera_info: bool) -> None:
        """Take the parameters; without CameraInfo in the recording they define the camera."""
        super().__init__(parameters)
        self._tracker = robot_tracker(parameters, self.tree)
        is_awaited = has_camera_info and parameters.camera.model is CameraModel.AUTO
        self.camera: Camera | None = None if is_awaited else default_camera(parameters)
        self._others: dict[int, Camera] = {}

    def base_frame(self) -> str:
        """Return the robot's base: that of the parameters, else base_footprint or base_link."""
        return self._tracker.base_frame()

    def take(self, role: str, value: Any) -> None:
        """Take a value of `bag.decoded` by its role: tf, tf_static, odom or camera/camera_info."""
        if role == CAMERA:
            self.take_camera(value.message)
        elif role == "odom":
            self.take_odometry(value.numbers)
        else:
            for transform in value.samples:
                self.take_transform(transform, is_static=role == "tf_static")

    def take_camera(self, message: Any, number: int = 0) -> None:
        """Take a CameraInfo of the first camera, or of that number of `camera.others` (from 1).

        Raises InputError where it describes no camera.
        """
        view = read_camera_info(message).view(rectified=self._parameters.camera.rectified)
        frame_id = read_header(message, "camera_info").frame_id
        received = Camera(view, frame_id, RigidTransform.identity())
        if number:
            self._others[number] = received
        else:
            self.camera = chosen_camera(self._parameters, received)

    @property
    def missing(self) -> str:
        """Why the pose of the robot that was asked for last is not known, empty if it is."""
        return self._tracker.missing

    def forget_after(self, now_ns: int) -> None:
        """Forget transforms later than `now_ns`, and the robot's pose: the clock jumped back."""
        self.tree.forget_after(now_ns)
        self._tracker.forget()

    def poses(self, now_ns: int) -> tuple[RigidTransform | None, RigidTransform | None]:
        """Return map_from_base and map_from_camera as of a tick, None where not known."""
        pose = self._tracker.pose(now_ns)
        camera = self._tracker.map_from_camera(self.camera, now_ns) if self.camera else None
        return (pose.map_from_base if pose else None), camera

    def others(self, now_ns: int) -> list[CameraAt]:
        """Return the cameras after the first as of a tick, those whose pose is known."""
        found = []
        for number, camera in sorted(self._others.items()):
            pose = self._tracker.map_from_camera(camera, now_ns)
            if pose is not None:
                found.append(CameraAt(number, camera.view, pose))
        return found
