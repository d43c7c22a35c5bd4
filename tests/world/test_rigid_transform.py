"""Rigid transforms against matrices and scipy's rotations."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from are_ros.errors import InvalidTransformError
from are_ros.world.rigid_transform import MAX_REACH_M, RigidTransform, product

metres = st.floats(-100, 100)
angles = st.floats(-math.pi, math.pi)
transforms = st.builds(RigidTransform.from_xyz_ypr, metres, metres, metres, angles, angles, angles)


@given(metres, metres, metres, angles, angles, angles)
def test_yaw_pitch_roll_turn_in_that_order(
    x: float, y: float, z: float, yaw: float, pitch: float, roll: float
) -> None:
    """The rotation is scipy's intrinsic ZYX, the translation the three numbers."""
    transform = RigidTransform.from_xyz_ypr(x, y, z, yaw, pitch, roll)
    expected = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    np.testing.assert_allclose(transform.rotation_matrix(), expected, atol=1e-14)
    assert transform.translation_m.tolist() == [x, y, z]


@pytest.mark.parametrize(
    ("left", "right"),
    [((3,), (3,)), ((5, 3), (3,)), ((3,), (3, 2)), ((4, 5, 3), (3, 3)), ((7, 5, 3), (7, 3, 4))],
)
def test_products_are_those_of_matrices(left: tuple[int, ...], right: tuple[int, ...]) -> None:
    """As of numpy's operator, but for rounding."""
    random = np.random.default_rng(2)
    a, b = random.normal(size=left), random.normal(size=right)
    np.testing.assert_allclose(product(a, b), a @ b, atol=1e-14)


@given(transforms, transforms)
def test_composition_multiplies_matrices(a: RigidTransform, b: RigidTransform) -> None:
    """The matrix of a @ b is the product of the matrices, its quaternion of unit length."""
    np.testing.assert_allclose((a @ b).matrix(), a.matrix() @ b.matrix(), atol=1e-11)
    assert np.linalg.norm((a @ b).rotation_xyzw) == pytest.approx(1.0, abs=1e-15)


@given(transforms)
def test_the_inverse_undoes(a: RigidTransform) -> None:
    """A transform composed with its inverse is the identity, from either side."""
    for both in (a @ a.inverse(), a.inverse() @ a):
        np.testing.assert_allclose(both.matrix(), np.eye(4), atol=1e-11)


@given(transforms, metres, metres, metres)
def test_points_move_as_by_the_matrix(a: RigidTransform, x: float, y: float, z: float) -> None:
    """Applying to points is the homogeneous product, for several points, one and none."""
    points = np.array([[x, y, z], [0.0, 0.0, 0.0]])
    expected = (a.matrix() @ np.column_stack((points, np.ones(2))).T).T[:, :3]
    np.testing.assert_allclose(a.apply(points), expected, atol=1e-11)
    assert a.apply(np.empty((0, 3))).shape == (0, 3)


@given(metres, metres, angles, metres)
def test_a_planar_transform_has_its_yaw(x: float, y: float, yaw: float, z: float) -> None:
    """A planar transform turns about z alone and gives its yaw back."""
    transform = RigidTransform.planar(x, y, yaw, z)
    assert math.remainder(transform.yaw_rad() - yaw, 2 * math.pi) == pytest.approx(0, abs=1e-12)
    assert transform.translation_m.tolist() == [x, y, z]
    np.testing.assert_array_equal(transform.rotation_matrix()[2], [0, 0, 1])


def test_the_identity_changes_nothing() -> None:
    """The identity has the unit matrix."""
    np.testing.assert_array_equal(RigidTransform.identity().matrix(), np.eye(4))


def test_its_arrays_are_read_only() -> None:
    """Neither array of a transform can be written to, however it was made."""
    for transform in (RigidTransform.identity(), RigidTransform.adopt(np.eye(7)[6])):
        with pytest.raises(ValueError, match="read-only"):
            transform.translation_m[0] = 1.0
        with pytest.raises(ValueError, match="read-only"):
            transform.rotation_xyzw[0] = 1.0


def test_checked_numbers_are_normalised() -> None:
    """A quaternion of a recording that is nearly of unit length becomes so."""
    transform = RigidTransform.checked([1, 2, 3], [0.0, 0.0, 0.7, 0.714])
    assert np.linalg.norm(transform.rotation_xyzw) == pytest.approx(1.0, abs=1e-15)
    assert transform.translation_m.dtype == np.float64


@pytest.mark.parametrize(
    ("translation", "rotation", "reason"),
    [
        ((math.nan, 0, 0), (0, 0, 0, 1), "not finite"),
        ((0, math.inf, 0), (0, 0, 0, 1), "not finite"),
        ((0, 0, 0), (0, math.nan, 0, 1), "not finite"),
        ((0, 0, 0), (0, 0, 0, -math.inf), "not finite"),
        ((0, 0, MAX_REACH_M * 1.001), (0, 0, 0, 1), "exceeds 1e"),
        ((-1e300, 0, 0), (0, 0, 0, 1), "exceeds 1e"),
        ((0, 0, 0), (1e200, 0, 0, 1), "length inf, not 1"),
        ((0, 0, 0), (0, 0, 0, 0), "length 0, not 1"),
        ((0, 0, 0), (0, 0, 0, 1.0051), "length 1.0051, not 1"),
    ],
)
def test_unusable_numbers_are_refused(
    translation: tuple[float, float, float],
    rotation: tuple[float, float, float, float],
    reason: str,
) -> None:
    """Numbers that are not finite, too far, or no rotation, are refused with the reason."""
    with pytest.raises(InvalidTransformError, match=reason):
        RigidTransform.checked(translation, rotation)


def test_the_farthest_translation_is_taken() -> None:
    """The bound itself is allowed, in every coordinate at once."""
    far = (MAX_REACH_M, -MAX_REACH_M, MAX_REACH_M)
    assert RigidTransform.checked(far, (0, 0, 0, 1)).translation_m.tolist() == list(far)
