"""The frames that a recording tells of, as the node has them: from tf, odometry and parameters."""

from typing import Final

from are_ros.builder.assembly import set_static_frames
from are_ros.errors import FrameError
from are_ros.messages.odometry import OdometryNumbers
from are_ros.messages.transforms import StampedTransform
from are_ros.parameters.choices import OdometryUse
from are_ros.parameters.model import Parameters
from are_ros.world.transforms.table import TransformSource
from are_ros.world.transforms.tree import FrameTree

_SOURCES: Final = {
    OdometryUse.AUTO: TransformSource.ODOMETRY,
    OdometryUse.USE: TransformSource.PREFERRED_ODOMETRY,
}


class RecordedFrames:
    """A tree with the static frames of the parameters, fed with transforms and odometry.

    What takes one returns why it cannot be taken, empty if it can.
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
