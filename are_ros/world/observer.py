"""An observer: a robot that perceives, with its shape and its camera."""

from dataclasses import dataclass

import numpy as np

from are_ros.world.footprint import Footprint
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.view_models import ViewModel

FORWARD_FROM_OPTICAL = RigidTransform(np.zeros(3), np.array((-0.5, 0.5, -0.5, 0.5)))
"""An optical frame (z forward, x right, y down) in a body frame (x forward, y left, z up)."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A view model and where it sits: in a frame of the tree, or mounted on the base.

    `frame_id` is the optical frame; where it is empty, `base_from_optical` says where it is.
    """

    view: ViewModel
    frame_id: str
    base_from_optical: RigidTransform


@dataclass(frozen=True, eq=False)
class Observer:
    """A robot of this name and footprint, on `base_frame` (empty: found in the frame tree)."""

    name: str
    base_frame: str
    footprint: Footprint


def mounted_camera(view: ViewModel, mount: tuple[float, ...]) -> Camera:
    """Return a camera on the base that looks along +x of its mount.

    `mount` is x, y, z [m], yaw, pitch, roll [rad] in the base frame.
    """
    x, y, z, yaw, pitch, roll = mount
    base_from_mount = RigidTransform.from_xyz_ypr(x, y, z, yaw, pitch, roll)
    return Camera(view, "", base_from_mount @ FORWARD_FROM_OPTICAL)
