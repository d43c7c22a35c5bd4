"""Rigid transforms: how a child frame stands in its parent (section 3.1, Frames)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import InvalidTransformError

MAX_TILT_RAD: Final = 1e-3
"""Roll and pitch up to this are treated as numerical noise."""


def tilt_rad(rotation_xyzw: npt.ArrayLike) -> float:
    """Return the angle between the turned z axis and z of a unit quaternion, in 0..pi."""
    x, y, z, w = np.asarray(rotation_xyzw, dtype=np.float64)
    return float(2.0 * np.arctan2(np.hypot(x, y), np.hypot(z, w)))


def yaw_only(rotation_xyzw: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the unit quaternion (4,) of the part about z; a pure yaw comes back as it was."""
    _, _, z, w = np.asarray(rotation_xyzw, dtype=np.float64)
    norm = np.hypot(z, w)
    return np.array([0.0, 0.0, z / norm, w / norm])


def cosine_and_sine(rotation_xyzw: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Return cos and sin of the yaw of a quaternion about z."""
    z, w = float(rotation_xyzw[2]), float(rotation_xyzw[3])
    return w * w - z * z, 2.0 * w * z


Vector = npt.NDArray[np.float64]
Values = Sequence[float] | npt.NDArray[np.floating]
Quaternion = tuple[float, float, float, float]

_new = object.__new__

UNIT_TOLERANCE = 1e-2
"""How far a quaternion's squared norm may be from 1.

The bound of tf2 (10e-3, in BufferCore) for transforms that enter its tree. Recordings hold
quaternions of float32 and of printed decimals: what is within the bound is normalised.
"""

MAX_REACH_M = 1e7
"""No coordinate of a translation is farther from 0: kernels of float32 stay far from overflow."""


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """The value `parent_from_child`: takes points of the child frame into the parent frame.

    `translation_m` is float64 (3,), the child's origin in the parent frame [m]; `rotation_xyzw` is
    float64 (4,), a unit quaternion. Both become read-only. The constructor takes them as they are;
    `checked` is the way in for numbers from outside.
    """

    translation_m: Vector
    rotation_xyzw: Vector

    def __post_init__(self) -> None:
        self.translation_m.setflags(write=False)
        self.rotation_xyzw.setflags(write=False)

    @classmethod
    def identity(cls) -> "RigidTransform":
        """Return the transform of a frame onto itself."""
        return cls(np.zeros(3), np.array((0.0, 0.0, 0.0, 1.0)))

    @classmethod
    def checked(cls, translation_m: Values, rotation_xyzw: Values) -> "RigidTransform":
        """Return the transform of 3 + 4 numbers, the quaternion normalised.

        InvalidTransformError if a number is not finite, a coordinate exceeds `MAX_REACH_M`, or the
        quaternion is not of unit length (its squared norm further than `UNIT_TOLERANCE` from 1).
        """
        x, y, z = (float(value) for value in translation_m)
        i, j, k, w = (float(value) for value in rotation_xyzw)
        reason = why_invalid(x, y, z, i, j, k, w)
        if reason is not None:
            raise InvalidTransformError(f"the transform cannot be used: {reason}")
        return cls(np.array((x, y, z)), np.array(normalised(i, j, k, w)))

    @classmethod
    def adopt(cls, values: Vector) -> "RigidTransform":
        """Return the transform whose numbers are a float64 array (7,): x y z, then x y z w.

        The array is not copied and becomes read-only; it is quicker than the constructor.
        """
        # By position: the keyword takes three times as long, and numpy's stubs know only that.
        values.setflags(False)  # type: ignore[call-arg,unused-ignore]
        transform = _new(cls)
        fields = transform.__dict__
        fields["translation_m"], fields["rotation_xyzw"] = values[:3], values[3:]
        return transform

    @classmethod
    def from_xyz_ypr(
        cls, x: float, y: float, z: float, yaw: float, pitch: float, roll: float
    ) -> "RigidTransform":
        """Return the transform of a position [m] and angles [rad].

        Turned by yaw about z, then pitch about the new y, then roll about the new x (REP 103).
        """
        cos_y, sin_y = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
        cos_p, sin_p = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
        cos_r, sin_r = math.cos(0.5 * roll), math.sin(0.5 * roll)
        rotation = (
            sin_r * cos_p * cos_y - cos_r * sin_p * sin_y,
            cos_r * sin_p * cos_y + sin_r * cos_p * sin_y,
            cos_r * cos_p * sin_y - sin_r * sin_p * cos_y,
            cos_r * cos_p * cos_y + sin_r * sin_p * sin_y,
        )
        return cls(np.array((x, y, z), dtype=np.float64), np.array(rotation))

    @classmethod
    def planar(cls, x: float, y: float, yaw: float, z: float = 0.0) -> "RigidTransform":
        """Return the transform of metres and a rotation about z by `yaw` [rad]."""
        rotation = np.array((0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)))
        return cls(np.array((x, y, z), dtype=np.float64), rotation)

    def __matmul__(self, other: "RigidTransform") -> "RigidTransform":
        """Compose: `a_from_b @ b_from_c` is `a_from_c`; the quaternion is normalised again."""
        mine: Quaternion = tuple(self.rotation_xyzw.tolist())
        x, y, z = self.translation_m.tolist()
        dx, dy, dz = _rotated(mine, *other.translation_m.tolist())
        rotation = _product(mine, tuple(other.rotation_xyzw.tolist()))
        return RigidTransform(np.array((x + dx, y + dy, z + dz)), np.array(normalised(*rotation)))

    def inverse(self) -> "RigidTransform":
        """Return `child_from_parent`."""
        i, j, k, w = self.rotation_xyzw.tolist()
        x, y, z = self.translation_m.tolist()
        turned_back = (-i, -j, -k, w)
        translation = _rotated(turned_back, -x, -y, -z)
        return RigidTransform(np.array(translation), np.array(turned_back))

    def rotation_matrix(self) -> Vector:
        """Return the rotation as float64 (3, 3); its columns are the child's axes in the parent."""
        x, y, z, w = self.rotation_xyzw.tolist()
        return np.array(
            (
                (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
                (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
                (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
            )
        )

    def matrix(self) -> Vector:
        """Return the homogeneous matrix, float64 (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation_matrix()
        matrix[:3, 3] = self.translation_m
        return matrix

    def apply(self, points_m: npt.NDArray[np.floating]) -> Vector:
        """Return points (N, 3) [m] of the child frame in the parent frame, float64 (N, 3)."""
        return product(points_m, self.rotation_matrix().T) + self.translation_m

    def yaw_rad(self) -> float:
        """Return the heading of the child's x axis about the parent's z, in [-pi, pi]."""
        x, y, z, w = self.rotation_xyzw.tolist()
        return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def product(a: npt.ArrayLike, b: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the matrix product `a @ b`, the same on each processor to the last bit.

    The sums of `@` are in an order, and fused, as the BLAS has it for the kind of processor. `b` is
    a vector (n,) or has the shape (..., n, m); `a` is (..., n).
    """
    how = "...j,j->..." if b.ndim == 1 else "...j,jk->...k" if b.ndim == 2 else "...ij,...jk->...ik"
    return np.asarray(np.einsum(how, np.asarray(a), b))


def in_level_frame(
    map_from_frame: RigidTransform, points_m: npt.ArrayLike
) -> tuple[Vector, Vector]:
    """Return x and y (N,), in a frame that is turned about z only, of points (N, 2 or 3)."""
    offset_m = np.asarray(points_m, dtype=np.float64)[:, :2] - map_from_frame.translation_m[:2]
    cosine, sine = cosine_and_sine(map_from_frame.rotation_xyzw)
    x_m = offset_m[:, 0] * cosine + offset_m[:, 1] * sine
    y_m = offset_m[:, 1] * cosine - offset_m[:, 0] * sine
    return x_m, y_m


def why_invalid(x: float, y: float, z: float, i: float, j: float, k: float, w: float) -> str | None:
    """Return why a translation (x, y, z) [m] and a quaternion (i, j, k, w) are refused, or None."""
    norm2 = i * i + j * j + k * k + w * w
    is_near = abs(x) <= MAX_REACH_M and abs(y) <= MAX_REACH_M and abs(z) <= MAX_REACH_M
    if is_near and abs(norm2 - 1.0) <= UNIT_TOLERANCE:
        return None
    if not all(map(math.isfinite, (x, y, z, i, j, k, w))):
        return f"a number is not finite: translation {x, y, z}, rotation {i, j, k, w}"
    if not is_near:
        return f"the translation {x, y, z} exceeds {MAX_REACH_M:g} m in one coordinate or more"
    return f"the rotation {i, j, k, w} has length {math.sqrt(norm2):.6g}, not 1"


def normalised(i: float, j: float, k: float, w: float) -> Quaternion:
    """Return the quaternion scaled to length 1; one that is 1 already comes back unchanged."""
    norm2 = i * i + j * j + k * k + w * w
    if abs(norm2 - 1.0) < 1e-15:
        return i, j, k, w
    scale = 1.0 / math.sqrt(norm2)
    return i * scale, j * scale, k * scale, w * scale


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return Hamilton's product a b: first turned by b, then by a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _rotated(q: Quaternion, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the vector (x, y, z) turned by q: v + 2 u x (u x v + w v), u the vector part."""
    i, j, k, w = q
    cx, cy, cz = j * z - k * y + w * x, k * x - i * z + w * y, i * y - j * x + w * z
    return x + 2 * (j * cz - k * cy), y + 2 * (k * cx - i * cz), z + 2 * (i * cy - j * cx)
