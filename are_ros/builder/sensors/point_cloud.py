"""A cloud of points (sensor_msgs/PointCloud2), and its augmentation with artefacts."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder.sensors.cloud_rays import WIDEST_GAP_RAD, rays_between, rays_of_holes
from are_ros.builder.sensors.obstacles import Obstacles
from are_ros.errors import InputError
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.rigid_transform import RigidTransform, product

_Floats = npt.NDArray[np.float64]
_Indices = npt.NDArray[np.int64]

_NOTHING_M: Final = 1e-3
"""A point this near to the sensor is no return; many drivers write (0, 0, 0) for none."""

_FORMATS: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""The datatypes of PointField as numpy formats."""
_FLOATS: Final = (7, 8)

_ROWS: Final = ("ring", "channel", "line", "row")
"""Fields with the number of the beam that measured a point."""
_STRENGTHS: Final = ("intensity", "intensities", "reflectivity", "reflectance", "signal")
"""Fields that are 0 on an artefact, as the intensities of a scan are."""
_LENGTHS: Final = ("range", "distance")
"""Fields that are proportional to the distance from the sensor, in any unit."""

_SLACK: Final = 1e-9
"""Relative slack of the ball around a box, for rounding."""

_Columns = npt.NDArray[np.void]


class CloudField(NamedTuple):
    """A field of each point: sensor_msgs/PointField."""

    name: str
    offset: int
    datatype: int
    numbers: int = 1


_Coordinate = npt.NDArray[np.floating]
_EVERYWHERE: Final = np.array([(0.0, 0.0, 1.0, -2.0)])
"""A cone that holds all directions."""


@dataclass(frozen=True, eq=False)
class PointCloud:
    """H x W points as they were received, in the frame of their sensor, with all their fields.

    `data` is uint8 (H, row_step) and becomes read-only; each row begins with W points of
    `point_step` bytes. With H = 1 the cloud is unorganised: it holds only rays that came back. Else
    it has a point for each ray, and no return is NaN, infinite or (0, 0, 0). All rays begin at the
    frame's origin. Numbers from outside must come through `checked`.
    """

    frame_id: str
    stamp_ns: int
    fields: tuple[CloudField, ...]
    is_bigendian: bool
    is_dense: bool
    width: int
    point_step: int
    data: npt.NDArray[np.uint8]

    def __post_init__(self) -> None:
        data = self.data.view()
        data.flags.writeable = False
        object.__setattr__(self, "data", data)

    @classmethod
    def of_points(
        cls, frame_id: str, stamp_ns: int, points_m: npt.NDArray[np.floating]
    ) -> "PointCloud":
        """Return the unorganised cloud of finite points (N, 3) [m], as x, y, z float32."""
        data = np.ascontiguousarray(points_m, dtype="<f4").view(np.uint8).reshape(1, -1)
        fields = tuple(CloudField(axis, 4 * k, 7) for k, axis in enumerate("xyz"))
        return cls(frame_id, stamp_ns, fields, False, True, len(points_m), 12, data)

    @classmethod
    def checked(
        cls,
        data: npt.NDArray[np.uint8],
        *,
        frame_id: str,
        stamp_ns: int,
        fields: Sequence[CloudField],
        is_bigendian: bool,
        is_dense: bool,
        shape: tuple[int, int],
        steps: tuple[int, int],
        source: str = "points",
    ) -> "PointCloud":
        """Return a cloud of `data` uint8 (N,), height and width, row_step and point_step.

        InputError, whose sentence begins with `source`, if the frame is empty, a coordinate is
        missing or no float, or steps and data do not fit together.
        """
        (height, width), (row_step, point_step) = shape, steps
        if not frame_id:
            raise InputError(f"{source}: header.frame_id is empty")
        if row_step < width * point_step:
            raise InputError(
                f"{source}: row_step {row_step} is less than width {width}"
                f" x point_step {point_step}"
            )
        if data.size != height * row_step:
            raise InputError(
                f"{source}: data has {data.size} bytes, but height {height} x row_step"
                f" {row_step} = {height * row_step}"
            )
        named = {field.name: field for field in fields}
        for axis in "xyz":
            field = named.get(axis)
            if sum(field.name == axis for field in fields) > 1:
                raise InputError(f"{source}: fields have more than one {axis}")
            if field is None or field.datatype not in _FLOATS or field.numbers > 1:
                have = ", ".join(named) or "none"
                raise InputError(
                    f"{source}: fields have no {axis} of one float32 or float64 ({have})"
                )
            if field.offset + np.dtype(_FORMATS[field.datatype]).itemsize > point_step:
                raise InputError(f"{source}: field {axis} ends beyond point_step {point_step}")
        rows = data.reshape(height, row_step)
        return cls(
            frame_id, stamp_ns, tuple(fields), is_bigendian, is_dense, width, point_step, rows
        )

    @classmethod
    def miniature(cls, frame_id: str, stamp_ns: int) -> "PointCloud":
        """Return a row of points at 2.5 m, with a gap, for `warm_up`."""
        angles = np.delete(np.arange(40), slice(10, 14)) * 0.1
        points_m = 2.5 * np.stack((np.cos(angles), np.sin(angles), np.zeros_like(angles)), axis=1)
        return cls.of_points(frame_id, stamp_ns, points_m)

    def points_m(self) -> npt.NDArray[np.float32] | _Floats:
        """Return the points (H * W, 3) [m], row by row, NaN where it has NaN; the array is new.

        It is float32, or float64 if any of x, y, z is.
        """
        columns = self._columns(self.data, self.width)
        stored = [columns[axis] for axis in "xyz"]
        dtype = np.result_type(*(values.dtype.newbyteorder("=") for values in stored))
        return np.stack([values.ravel().astype(dtype) for values in stored], axis=1)

    def column(self, names: Sequence[str]) -> npt.NDArray[np.float64] | None:
        """Return the numbers (H * W,) of the first field that has one of the names, if any has."""
        columns = self._columns(self.data, self.width)
        found = _names(columns, names)
        return columns[found[0]].ravel().astype(np.float64) if found else None

    def augmented(self, map_from_sensor: RigidTransform, obstacles: Obstacles) -> "PointCloud":
        """Return the cloud with points on the artefacts where they are nearer than what came back.

        The cloud is `checked`. Per ray, with the first hit on any artefact, Euclidean:

        - a return behind the hit becomes the hit, on the same ray, whatever walls the environment
          has: the return proves that the ray is free up to there; one in front of it stays;
        - a ray without a return becomes the hit if that is no farther than the farthest return of
          the cloud, and the environment's surface is not in front of it.

        Which rays had no return follows from the order of an organised cloud, and in an unorganised
        one from the gaps in its rows (see `cloud_rays`): there, points are added at the end. A
        point on an artefact has strength 0; its other fields are those of the return that it
        replaces, or of the ray's neighbour. If nothing changes, the same object is returned.
        """
        axes = self._coordinates()
        farthest_m = _farthest_return(*axes)
        cones = _cones(map_from_sensor, obstacles.boxes, farthest_m)
        if not len(cones):
            return self
        is_organised = len(self.data) > 1  # there the rays of all holes follow from all returns
        returns, rays, ranges_m = _returns_in(*axes, _EVERYWHERE if is_organised else cones)
        hits_m = obstacles.first_hits(map_from_sensor, rays, ranges_m)
        is_behind = hits_m < ranges_m
        owners, free = self._rays_without_return(returns, rays)
        seen_m = obstacles.first_hits(map_from_sensor, free, farthest_m)
        is_seen = seen_m < np.inf
        is_seen[is_seen] = ~obstacles.are_hidden(map_from_sensor, free[is_seen], seen_m[is_seen])
        if not is_behind.any() and not is_seen.any():
            return self
        units = self._units_of_lengths()
        data, width, places = self._with_room(owners[is_seen])
        places = np.concatenate((returns[is_behind], places))
        rays = np.concatenate((rays[is_behind], free[is_seen]))
        hits_m = np.concatenate((hits_m[is_behind], seen_m[is_seen]))
        _write_hits(self._columns(data, width), places, rays, hits_m, units)
        return replace(self, data=data, width=width)

    def _columns(self, data: npt.NDArray[np.uint8], width: int) -> _Columns:
        """Return a view (height, width) of the single numbers of each point, by field."""
        order, fields = ">" if self.is_bigendian else "<", dict[str, tuple[np.dtype[Any], int]]()
        for name, offset, datatype, numbers in self.fields:
            number = np.dtype(order + _FORMATS.get(datatype, "V0"))
            if numbers <= 1 and 0 < number.itemsize <= self.point_step - offset:
                fields.setdefault(name, (number, offset))
        formats, offsets = zip(*fields.values(), strict=True)
        point = np.dtype(
            {
                "names": list(fields),
                "formats": formats,
                "offsets": offsets,
                "itemsize": self.point_step,
            }
        )
        strides = data.shape[1], self.point_step
        columns: _Columns = np.ndarray((len(data), width), point, data, 0, strides)
        return columns

    def _coordinates(self) -> tuple[_Coordinate, _Coordinate, _Coordinate]:
        """Return x, y and z (height, width) [m]: views where the processor can read these."""
        columns = self._columns(self.data, self.width)
        x, y, z = (columns[axis] for axis in "xyz")
        if all(one.dtype.isnative for one in (x, y, z)):
            return x, y, z
        points_m = self.points_m().reshape(*x.shape, 3)
        return points_m[..., 0], points_m[..., 1], points_m[..., 2]

    def _rays_without_return(
        self, returns: _Indices, directions: _Floats
    ) -> tuple[_Indices, _Floats]:
        """Return the rays (K, 3) without a return, and the points (K,) that they belong to.

        That is the ray's own point, or in an unorganised cloud its neighbour's.
        """
        if len(self.data) != 1:
            return rays_of_holes((len(self.data), self.width), returns, directions)
        columns = self._columns(self.data, self.width)
        rows = next((columns[name][0, returns] for name in _names(columns, _ROWS)), None)
        neighbours, rays = rays_between(directions, rows)
        return returns[neighbours], rays

    def _units_of_lengths(self) -> dict[str, float]:
        """Return how much a field grows per metre of distance from the sensor, by field."""
        columns = self._columns(self.data, self.width)
        names = _names(columns, _LENGTHS)
        if not names:
            return {}
        returns, _, ranges_m = _returns_in(*self._coordinates(), _EVERYWHERE)
        return {name: float(np.median(columns[name].ravel()[returns] / ranges_m)) for name in names}

    def _with_room(self, owners: _Indices) -> tuple[npt.NDArray[np.uint8], int, _Indices]:
        """Return a copy of the data with room for rays without return, its width, and their places.

        In an organised cloud these are the rays' own points, else copies of their neighbours.
        """
        if len(self.data) != 1:
            return self.data.copy(), self.width, owners
        points = self.data[0, : self.width * self.point_step].reshape(self.width, self.point_step)
        points = np.concatenate((points, points[owners]))
        return points.reshape(1, -1), len(points), np.arange(self.width, len(points))


@compiled
def _farthest_return(x: _Coordinate, y: _Coordinate, z: _Coordinate) -> float:
    """Return how far away the farthest return is [m], 0 if there is none."""
    farthest = 0.0
    for row in range(x.shape[0]):
        for k in range(x.shape[1]):
            a, b, c = np.float64(x[row, k]), np.float64(y[row, k]), np.float64(z[row, k])
            square = a * a + b * b + c * c
            if farthest < square < np.inf:
                farthest = square
    farthest_m = np.sqrt(farthest)
    return farthest_m if farthest_m > _NOTHING_M else 0.0


@compiled
def _returns_in(
    x: _Coordinate, y: _Coordinate, z: _Coordinate, cones: _Floats
) -> tuple[_Indices, _Floats, _Floats]:
    """Return indices (N,), unit vectors (N, 3) and ranges (N,) [m] of the returns in some cones."""
    found = np.empty(x.size, np.int64)
    rays, ranges_m = np.empty((x.size, 3)), np.empty(x.size)
    count, width = 0, x.shape[1]
    for row in range(x.shape[0]):
        for k in range(width):
            a, b, c = np.float64(x[row, k]), np.float64(y[row, k]), np.float64(z[row, k])
            range_m = np.sqrt(a * a + b * b + c * c)
            if not _NOTHING_M < range_m < np.inf:
                continue
            a, b, c = a / range_m, b / range_m, c / range_m
            for cone in range(cones.shape[0]):
                if a * cones[cone, 0] + b * cones[cone, 1] + c * cones[cone, 2] > cones[cone, 3]:
                    found[count], ranges_m[count] = row * width + k, range_m
                    rays[count, 0], rays[count, 1], rays[count, 2] = a, b, c
                    count += 1
                    break
    return found[:count].copy(), rays[:count].copy(), ranges_m[:count].copy()


def _cones(map_from_sensor: RigidTransform, boxes: OrientedBoxes, farthest_m: float) -> _Floats:
    """Return cones (M, 4) about the boxes within reach: axis in the sensor's frame, and cosine.

    They are so much wider than the boxes that the gaps in front of these have both their ends
    inside.
    """
    apart_m = product(
        boxes.centres_m - map_from_sensor.translation_m, map_from_sensor.rotation_matrix()
    )
    away_m, radii_m = np.linalg.norm(apart_m, axis=1), np.linalg.norm(boxes.half_sizes_m, axis=1)
    angles = np.arcsin(np.minimum(radii_m / np.maximum(away_m, 1e-9), 1.0)) + WIDEST_GAP_RAD
    angles = np.where(away_m <= radii_m, np.pi, np.minimum(angles, np.pi))
    axes = apart_m / np.maximum(away_m, 1e-9)[:, None]
    cones = np.column_stack((axes, np.cos(angles) - _SLACK))
    reached: _Floats = cones[away_m - radii_m <= farthest_m]
    return reached


def _names(columns: _Columns, names: Sequence[str]) -> list[str]:
    """Return those of some names that the columns have."""
    return [name for name in names if name in (columns.dtype.names or ())]


def _write_hits(
    columns: _Columns,
    places: _Indices,
    rays: _Floats,
    hits_m: _Floats,
    units: dict[str, float],
) -> None:
    """Write hits [m] along rays (K, 3) to some points (K,) of the columns."""
    at = np.unravel_index(places, columns.shape)
    for axis, component in zip("xyz", rays.T, strict=True):
        columns[axis][at] = component * hits_m
    for name in _names(columns, _STRENGTHS):
        columns[name][at] = 0
    for name, unit in units.items():
        is_whole = np.issubdtype(columns[name].dtype, np.integer)
        columns[name][at] = np.rint(unit * hits_m) if is_whole else unit * hits_m
