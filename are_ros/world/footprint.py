"""The robot's footprint, and its signed distance to the rectangles of packed boxes."""

import ast
from dataclasses import dataclass
from math import cos, hypot, sin

import numpy as np
from numpy.typing import NDArray

from are_ros._compiled import compiled
from are_ros.errors import ParameterError
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.rigid_transform import product

_FloatArray = NDArray[np.float64]


@compiled
def signed_distances(vertices: _FloatArray, radius_m: float, packed: _FloatArray) -> _FloatArray:
    """Return the signed distances (N,) of a rounded polygon (K, 2) from boxes (N, 8).

    If they overlap: minus the penetration depth, the largest gap over all edge normals. These are
    those of the Minkowski difference, so the least translation is among them. Else one end of the
    shortest line between the two is a vertex of either.
    """
    out, polygon = np.empty(packed.shape[0]), np.empty(vertices.shape)
    count = vertices.shape[0]
    edges = count if count > 1 else 0
    for i in range(packed.shape[0]):
        hx, hy = packed[i, 5], packed[i, 6]
        low_x, high_x, low_y, high_y, least = np.inf, -np.inf, np.inf, -np.inf, np.inf
        for k in range(count):  # into the frame of the box
            dx, dy = vertices[k, 0] - packed[i, 0], vertices[k, 1] - packed[i, 1]
            polygon[k, 0] = dx * packed[i, 3] + dy * packed[i, 4]
            polygon[k, 1] = dy * packed[i, 3] - dx * packed[i, 4]
            low_x, high_x = min(low_x, polygon[k, 0]), max(high_x, polygon[k, 0])
            low_y, high_y = min(low_y, polygon[k, 1]), max(high_y, polygon[k, 1])
            x, y = max(abs(polygon[k, 0]) - hx, 0.0), max(abs(polygon[k, 1]) - hy, 0.0)
            least = min(least, x * x + y * y)
        separation = max(low_x - hx, -high_x - hx, low_y - hy, -high_y - hy)
        for k in range(edges):
            ax, ay = polygon[k, 0], polygon[k, 1]
            ex, ey = polygon[(k + 1) % count, 0] - ax, polygon[(k + 1) % count, 1] - ay
            offset = ey * ax - ex * ay
            gap = -(hx * abs(ey) + hy * abs(ex) + offset) / np.hypot(ex, ey)
            separation = max(separation, gap)
        if separation <= 0.0:
            out[i] = separation - radius_m
            continue
        for k in range(edges):
            ax, ay = polygon[k, 0], polygon[k, 1]
            ex, ey = polygon[(k + 1) % count, 0] - ax, polygon[(k + 1) % count, 1] - ay
            for corner in range(4):
                x, y = (hx if corner & 2 else -hx), (hy if corner & 1 else -hy)
                along = ((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey)
                along = min(max(along, 0.0), 1.0)
                least = min(least, (ax + along * ex - x) ** 2 + (ay + along * ey - y) ** 2)
        out[i] = np.sqrt(least) - radius_m
    return out


@dataclass(frozen=True, eq=False)
class Footprint:
    """A rounded convex polygon: all points within `radius_m` of the hull of the vertices.

    `vertices_m` float64 (K, 2), K >= 1, any order on the way in; kept read-only as the corners
    of their convex hull, counter-clockwise. One vertex and a radius make a disc. The frame is the
    robot's base, or after `at` the one in which its pose was given. Raises ValueError for no or
    non-finite vertices, or a negative or non-finite radius.
    """

    vertices_m: NDArray[np.float64]
    radius_m: float = 0.0

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices_m, dtype=np.float64).reshape(-1, 2)
        if not len(vertices) or not np.isfinite(vertices).all():
            raise ValueError("a footprint needs at least one vertex, and finite ones")
        if not 0.0 <= self.radius_m < np.inf:
            raise ValueError(f"a footprint's radius cannot be {self.radius_m}")
        self._keep(_convex_hull(vertices), self.radius_m)

    @classmethod
    def disc(cls, radius_m: float) -> "Footprint":
        """Return a disc about the origin."""
        return cls(np.zeros((1, 2)), radius_m)

    @classmethod
    def parse(cls, text: str) -> "Footprint":
        """Return the hull of the points in Nav2's string form, "[[x, y], [x, y], ...]", in metres.

        Raises ParameterError unless the text holds at least
        three points, of two finite numbers each, that are not all on one line.
        """
        footprint = cls(_parsed_points(text))
        if len(footprint.vertices_m) < 3:
            raise ParameterError(f"robot.footprint: the points of {text!r} enclose no area")
        return footprint

    def at(self, x_m: float, y_m: float, yaw_rad: float) -> "Footprint":
        """Return the footprint of a base that stands at this pose, in the frame of the pose."""
        c, s = cos(yaw_rad), sin(yaw_rad)
        turned = product(self.vertices_m, np.array([[c, s], [-s, c]]))
        footprint = object.__new__(Footprint)
        footprint._keep(np.array((x_m, y_m)) + turned, self.radius_m)
        return footprint

    def padded(self, padding_m: float) -> "Footprint":
        """Return the footprint grown by a distance in all directions, corners rounded."""
        return Footprint(self.vertices_m, self.radius_m + padding_m)

    @property
    def inscribed_radius_m(self) -> float:
        """Radius of the largest disc about the origin inside the footprint; 0 if there is none."""
        origin = OrientedBoxes(np.zeros((1, 3)), np.zeros(1), np.zeros((1, 3)))
        return max(0.0, -float(signed_distance_m(self, origin)[0]))

    @property
    def circumscribed_radius_m(self) -> float:
        """Radius of the smallest disc about the origin that holds the footprint."""
        return float(np.hypot(*self.vertices_m.T).max()) + self.radius_m

    def _keep(self, vertices_m: NDArray[np.float64], radius_m: float) -> None:
        """Set the fields of the frozen value; a rigid motion needs no second hull."""
        vertices_m.flags.writeable = False
        object.__setattr__(self, "vertices_m", vertices_m)
        object.__setattr__(self, "radius_m", float(radius_m))


def signed_distance_m(footprint: Footprint, boxes: OrientedBoxes) -> NDArray[np.float64]:
    """Return the exact distances (N,) of a footprint from the footprints of boxes, one frame.

    Negative where they overlap: then its size is the penetration depth, the length of the
    shortest translation that parts the two.
    """
    return signed_distances(footprint.vertices_m, footprint.radius_m, boxes.packed)


def penetration_m(footprint: Footprint, boxes: OrientedBoxes) -> NDArray[np.float64]:
    """Return the penetration depths (N,), 0 where apart."""
    return np.maximum(-signed_distance_m(footprint, boxes), 0.0)


def _parsed_points(text: str) -> NDArray[np.float64]:
    """Return the points of Nav2's string form, or raise a ParameterError with the reason."""
    try:
        value = ast.literal_eval(text.strip())
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError) as cause:
        message = f'robot.footprint: {text!r} is not of the form "[[x, y], [x, y], [x, y]]"'
        raise ParameterError(message) from cause
    if not isinstance(value, (list, tuple)) or len(value) < 3:
        raise ParameterError(f"robot.footprint: {text!r} is not a list of three points or more")
    for point in value:
        if not _is_point(point):
            raise ParameterError(
                f"robot.footprint: {point!r} is not a point [x, y] of finite metres"
            )
    return np.array(value, dtype=np.float64)


def _is_point(value: object) -> bool:
    """Tell whether a literal is a pair of finite numbers."""
    return (
        isinstance(value, (list, tuple))
        and len(value) == 2
        and all(type(number) in {int, float} and abs(number) < 1e6 for number in value)
    )


def _convex_hull(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners (K, 2) of the convex hull, counter-clockwise (monotone chain)."""
    ordered = sorted({(float(x), float(y)) for x, y in points})
    if len(ordered) < 3:
        return np.array(ordered)
    lower, upper = _chain(ordered), _chain(ordered[::-1])
    return np.array(lower[:-1] + upper[:-1])


def _chain(ordered: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the hull's vertices on the right of the way through ordered points."""
    chain: list[tuple[float, float]] = []
    for point in ordered:
        while len(chain) >= 2 and not _turns_left(chain[-2], chain[-1], point):
            chain.pop()
        chain.append(point)
    return chain


def _turns_left(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Tell whether a-b-c turns left by more than rounding."""
    turn = (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
    return turn > 1e-12 * hypot(b[0] - a[0], b[1] - a[1]) * hypot(c[0] - b[0], c[1] - b[1])
