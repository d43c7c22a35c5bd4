"""How the robot is built."""

import math

import numpy as np
import pytest

from are_ros.world.transforms.tree import FrameTree
from bags.simulation.frames import (
    BASE_FRAME,
    BASE_FROM_SCAN,
    CAMERA_FRAME,
    CAMERA_INFO,
    SCAN_FRAME,
    fixed_joints,
)


@pytest.fixture(scope="module")
def frames() -> FrameTree:
    """Return the tree of the fixed joints."""
    tree = FrameTree()
    for joint in fixed_joints(7):
        assert joint.stamp_ns == 7
        tree.set_static(joint.parent, joint.child, joint.translation_m, joint.rotation_xyzw)
    return tree


def test_the_camera_looks_ahead_and_slightly_down(frames: FrameTree) -> None:
    """It stands 0.9 m up; its optical axis dips by 8 degrees, image right is the robot's right."""
    base_from_optical = frames.lookup(BASE_FRAME, CAMERA_FRAME, 0)
    assert base_from_optical.translation_m.tolist() == pytest.approx([0.05, 0.0, 0.9])
    right, _, ahead = base_from_optical.rotation_matrix().T
    dip = math.radians(8.0)
    assert ahead.tolist() == pytest.approx([math.cos(dip), 0.0, -math.sin(dip)])
    assert right.tolist() == pytest.approx([0.0, -1.0, 0.0])


def test_the_laser_is_level(frames: FrameTree) -> None:
    """The chain of joints is what the simulator casts its rays from."""
    base_from_scan = frames.lookup(BASE_FRAME, SCAN_FRAME, 0)
    np.testing.assert_allclose(base_from_scan.matrix(), BASE_FROM_SCAN.matrix(), atol=1e-12)
    assert base_from_scan.translation_m.tolist() == pytest.approx([0.0, 0.0, 0.2])


def test_the_camera_sees_70_degrees() -> None:
    """Between the first and the last column, on the middle row, nearly so with the distortion."""
    rays = CAMERA_INFO.view(rectified=False).directions()[240, [0, -1]].astype(np.float64)
    angle = math.degrees(math.acos(float(rays[0] @ rays[1])))
    assert angle == pytest.approx(70.0, abs=4.0)
