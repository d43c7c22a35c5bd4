"""How the simulated robot is built: its frames, its fixed joints and its camera."""

import math
from typing import Final

from are_ros.messages.transforms import StampedTransform
from are_ros.world.camera_info import CameraInfo
from are_ros.world.rigid_transform import RigidTransform

MAP_FRAME: Final = "map"
ODOM_FRAME: Final = "odom"
BASE_FRAME: Final = "base_footprint"
SCAN_FRAME: Final = "base_scan"
CAMERA_FRAME: Final = "camera_optical_frame"

ROBOT_RADIUS_M: Final = 0.22
SCAN_HEIGHT_M: Final = 0.2

BASE_FROM_SCAN: Final = RigidTransform.planar(0.0, 0.0, 0.0, SCAN_HEIGHT_M)

_LINK_HEIGHT_M: Final = 0.05
_CAMERA_HEIGHT_M: Final = 0.9
_CAMERA_DOWN_RAD: Final = math.radians(8.0)

_JOINTS: Final = (
    (BASE_FRAME, "base_link", RigidTransform.planar(0.0, 0.0, 0.0, _LINK_HEIGHT_M)),
    (
        "base_link",
        SCAN_FRAME,
        RigidTransform.planar(0.0, 0.0, 0.0, SCAN_HEIGHT_M - _LINK_HEIGHT_M),
    ),
    (
        "base_link",
        "camera_link",
        RigidTransform.from_xyz_ypr(
            0.05, 0.0, _CAMERA_HEIGHT_M - _LINK_HEIGHT_M, 0.0, _CAMERA_DOWN_RAD, 0.0
        ),
    ),
    # REP 103: z ahead, x to the right, y down.
    (
        "camera_link",
        CAMERA_FRAME,
        RigidTransform.from_xyz_ypr(0.0, 0.0, 0.0, -0.5 * math.pi, 0.0, -0.5 * math.pi),
    ),
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
    """Return the transforms of /tf_static."""
    return [stamped(parent, child, stamp_ns, pose) for parent, child, pose in _JOINTS]


def stamped(
    parent: str, child: str, stamp_ns: int, parent_from_child: RigidTransform
) -> StampedTransform:
    """Return a transform as it goes into a message."""
    x, y, z = parent_from_child.translation_m.tolist()
    i, j, k, w = parent_from_child.rotation_xyzw.tolist()
    return StampedTransform(parent, child, stamp_ns, (x, y, z), (i, j, k, w))
