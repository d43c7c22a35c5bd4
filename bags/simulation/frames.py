"""How the simulated robot is built: its fixed joints and its camera."""

import math
from typing import Final

from are_ros.messages.transforms import StampedTransform
from are_ros.world.cameras import CameraInfo
from are_ros.world.rigid_transform import RigidTransform

# The names of the simulated robot's frames, as REP 105 and TurtleBot have them.


MAP_FRAME: Final = "map"
ODOM_FRAME: Final = "odom"
BASE_FRAME: Final = "base_footprint"
SCAN_FRAME: Final = "base_scan"
CAMERA_FRAME: Final = "camera_optical_frame"


BASE_FROM_SCAN: Final = RigidTransform.planar(0.0, 0.0, 0.0, z=0.2)

_BASE_FROM_LINK: Final = RigidTransform.planar(0.0, 0.0, 0.0, z=0.05)
_BASE_FROM_CAMERA: Final = RigidTransform.from_xyz_ypr(0.05, 0.0, 0.9, 0.0, math.radians(8.0), 0.0)
# REP 103: z ahead, x to the right, y down.
_CAMERA_FROM_OPTICAL: Final = RigidTransform.from_xyz_ypr(
    0.0, 0.0, 0.0, -0.5 * math.pi, 0.0, -0.5 * math.pi
)
BASE_FROM_OPTICAL: Final = _BASE_FROM_CAMERA @ _CAMERA_FROM_OPTICAL
_JOINTS: Final = (
    (BASE_FRAME, "base_link", _BASE_FROM_LINK),
    ("base_link", SCAN_FRAME, _BASE_FROM_LINK.inverse() @ BASE_FROM_SCAN),
    ("base_link", "camera_link", _BASE_FROM_LINK.inverse() @ _BASE_FROM_CAMERA),
    ("camera_link", CAMERA_FRAME, _CAMERA_FROM_OPTICAL),
)

_FOCAL_PX: Final = 457.0
"""A horizontal field of view of 70 degrees at 640 pixels."""

CAMERA_INFO: Final = CameraInfo(
    width=640,
    height=480,
    distortion_model="plumb_bob",
    d=(-0.06, 0.03, 0.0005, -0.0005, 0.0),
    k=(_FOCAL_PX, 0.0, 319.5, 0.0, _FOCAL_PX, 239.5, 0.0, 0.0, 1.0),
    r=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    p=(_FOCAL_PX, 0.0, 319.5, 0.0, 0.0, _FOCAL_PX, 239.5, 0.0, 0.0, 0.0, 1.0, 0.0),
)


def fixed_joints(stamp_ns: int) -> list[StampedTransform]:
    """Return the transforms of /tf_static; the scan frame is level, 0.2 m up."""
    return [stamped(parent, child, stamp_ns, pose) for parent, child, pose in _JOINTS]


def stamped(
    parent: str, child: str, stamp_ns: int, parent_from_child: RigidTransform
) -> StampedTransform:
    """Return a transform as it goes into a message."""
    x, y, z = parent_from_child.translation_m.tolist()
    i, j, k, w = parent_from_child.rotation_xyzw.tolist()
    return StampedTransform(parent, child, stamp_ns, (x, y, z), (i, j, k, w))
