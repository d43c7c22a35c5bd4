"""The augmented laser scans: one sensor path per topic, and what their beams may meet."""

import math
from operator import attrgetter
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder.lives import Lives
from are_ros.builder.occlusion.meshes import MeshBank, MeshSelection, Tree, cast, enters, inverse
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.schedule import tick_period_ns
from are_ros.builder.sensor_path import ReleasedScan, SensorPath, SensorPathCounts
from are_ros.conventions import seconds_to_ns
from are_ros.parameters.choices import SensorGate, Shape
from are_ros.parameters.model import Parameters, SensorsParameters
from are_ros.world.environment import Environment
from are_ros.world.frame_tree import FrameTree
from are_ros.world.laser_scan import LaserScan
from are_ros.world.oriented_boxes import OrientedBoxes
from are_ros.world.rigid_transform import RigidTransform

_TURN: Final = 2.0 * math.pi


def augment_scan(
    scan: LaserScan,
    map_from_laser: RigidTransform,
    boxes: OrientedBoxes,
    shapes: MeshSelection | None = None,
    surface: VoxelField | None = None,
) -> LaserScan:
    """Return the scan with virtual returns where an artefact is nearer than what was measured.

    The scan is `checked`; `boxes` are the artefacts' in the map frame, `shapes` their meshes
    (None: the boxes themselves), `surface` is that of the environment (None: there is none). The
    laser's plane may have any orientation. Per beam, with the first hit on any artefact, Euclidean
    [m]:

    - within [range_min, range_max] it replaces a farther real return, wherever the environment has
      a wall: the return is the evidence that the way there is free;
    - it replaces +inf, NaN, a range above range_max or below range_min (many drivers write 0.0
      where nothing came back) where the environment's surface is not in front of it;
    - nearer than range_min it becomes -inf (REP 117: too close), unless the return is nearer still;
    - beyond range_max, or not nearer than a valid return, it changes nothing, and -inf stays.

    A beam that starts inside a box hits it at 0; a mesh has only its surface. Beams that stay, stay
    bit for bit; replaced ones have intensity 0. Where nothing is replaced the same object returns.
    """
    if not len(boxes):
        return scan
    selection = MeshSelection.boxes_only(len(boxes)) if shapes is None else shapes
    hits = np.full(len(scan.ranges), np.inf)
    _first_hits(
        map_from_laser.translation_m,
        map_from_laser.rotation_matrix(),
        (scan.angle_min_rad, scan.angle_increment_rad),
        scan.range_max_m,
        boxes.packed,
        selection.indices,
        selection.pool.tree,
        hits,
    )
    if hits.min() == np.inf:
        return scan
    ranges, replaced = _merged(scan, hits.astype(np.float32), map_from_laser, surface)
    if not replaced.any():
        return scan
    dimmed = (
        np.where(replaced, np.float32(0.0), scan.intensities) if len(scan.intensities) else None
    )
    return scan.with_ranges(ranges, scan.intensities if dimmed is None else dimmed)


def _merged(
    scan: LaserScan,
    hits: npt.NDArray[np.float32],
    map_from_laser: RigidTransform,
    surface: VoxelField | None,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """Return the ranges with the hits in them, and which were replaced; the rules above."""
    real = scan.ranges
    nearest = np.float32(scan.range_min_m)
    farthest = np.float32(min(scan.range_max_m, float(np.finfo(np.float32).max)))
    returned = (real >= nearest) & (real <= farthest)
    too_close = np.isneginf(real)
    nearer = np.where(returned, hits < real, hits <= farthest)
    replaced = nearer & ~too_close
    if surface is not None:
        doubtful = np.flatnonzero(replaced & ~returned)
        replaced[doubtful] = ~_are_hidden(scan, doubtful, hits[doubtful], map_from_laser, surface)
    virtual = np.where(hits < nearest, np.float32(-np.inf), hits)
    return np.where(replaced, virtual, real), replaced


def _are_hidden(
    scan: LaserScan,
    beams: npt.NDArray[np.int64],
    hits_m: npt.NDArray[np.float32],
    map_from_laser: RigidTransform,
    surface: VoxelField,
) -> npt.NDArray[np.bool_]:
    """Tell at which of some beams (K,) the environment is met before the hit (K,), bool (K,)."""
    if not len(beams):
        return np.empty(0, np.bool_)
    angles = scan.angle_min_rad + beams * scan.angle_increment_rad
    planar = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    directions = planar @ map_from_laser.rotation_matrix()[:, :2].T
    origin_m, farthest_m = map_from_laser.translation_m, float(hits_m.max())
    hidden: npt.NDArray[np.bool_] = surface.first_hits(origin_m, directions, farthest_m) < hits_m
    return hidden


@compiled
def _first_hits(
    laser_m: npt.NDArray[np.float64],
    map_from_laser: npt.NDArray[np.float64],
    angles: tuple[float, float],
    range_max_m: float,
    boxes: npt.NDArray[np.float64],
    meshes: npt.NDArray[np.int64],
    tree: Tree,
    hits_m: npt.NDArray[np.float64],
) -> None:
    """Lower each beam's hit [m] to the first on any box or mesh; `boxes` as `OrientedBoxes.packed`.

    A ball around the box cuts the laser's plane in a disc; only beams within its angles are cast.
    """
    normal = map_from_laser[:, 2]
    for box in range(boxes.shape[0]):
        apart = boxes[box, :3] - laser_m
        radius2 = boxes[box, 5] ** 2 + boxes[box, 6] ** 2 + boxes[box, 7] ** 2
        height = apart[0] * normal[0] + apart[1] * normal[1] + apart[2] * normal[2]
        if height * height > radius2:
            continue
        x = apart[0] * map_from_laser[0, 0] + apart[1] * map_from_laser[1, 0]
        y = apart[0] * map_from_laser[0, 1] + apart[1] * map_from_laser[1, 1]
        x, y = x + apart[2] * map_from_laser[2, 0], y + apart[2] * map_from_laser[2, 1]
        disc, range_m = math.sqrt(radius2 - height * height) + 1e-6, math.sqrt(x * x + y * y)
        if range_m - disc > range_max_m:
            continue
        half = math.asin(disc / range_m) if disc < range_m else math.pi
        _cast_sector(
            (math.atan2(y, x), half + 1e-6),
            map_from_laser,
            angles,
            range_max_m,
            apart,
            boxes[box],
            meshes[box],
            tree,
            hits_m,
        )


@compiled
def _cast_sector(
    sector: tuple[float, float],
    map_from_laser: npt.NDArray[np.float64],
    angles: tuple[float, float],
    range_max_m: float,
    apart_m: npt.NDArray[np.float64],
    box: npt.NDArray[np.float64],
    mesh: int,
    tree: Tree,
    hits_m: npt.NDArray[np.float64],
) -> None:
    """Cast the beams within `half` of a middle angle, in every turn that the scan makes."""
    (middle, half), (first, step) = sector, angles
    last = first + step * (hits_m.size - 1)
    low, high = min(first, last), max(first, last)
    turn = math.ceil((low - middle - half) / _TURN)
    while middle + turn * _TURN - half <= high:
        a = (middle + turn * _TURN - half - first) / step
        b = (middle + turn * _TURN + half - first) / step
        begin = max(0, math.ceil(min(a, b)))
        end = min(hits_m.size - 1, math.floor(max(a, b)))
        for beam in range(begin, end + 1):
            angle = first + step * beam
            hit = _cast_beam(angle, map_from_laser, range_max_m, apart_m, box, mesh, tree)
            hits_m[beam] = min(hits_m[beam], hit)
        turn += 1


@compiled
def _cast_beam(
    angle: float,
    map_from_laser: npt.NDArray[np.float64],
    range_max_m: float,
    apart_m: npt.NDArray[np.float64],
    box: npt.NDArray[np.float64],
    mesh: int,
    tree: Tree,
) -> float:
    """Return the first hit [m] of one beam on one box or its mesh, inf if none."""
    a, b = math.cos(angle), math.sin(angle)
    x = a * map_from_laser[0, 0] + b * map_from_laser[0, 1]
    y = a * map_from_laser[1, 0] + b * map_from_laser[1, 1]
    dz = a * map_from_laser[2, 0] + b * map_from_laser[2, 1]
    cosine, sine = box[3], box[4]
    dx, dy = cosine * x + sine * y, cosine * y - sine * x
    ox = -cosine * apart_m[0] - sine * apart_m[1]
    oy = sine * apart_m[0] - cosine * apart_m[1]
    if mesh >= 0:
        return cast(tree, mesh, ox, oy, -apart_m[2], dx, dy, dz, range_max_m)[0]
    corners = np.array((-box[5], -box[6], -box[7], box[5], box[6], box[7]))
    return enters(corners, ox, oy, -apart_m[2], inverse(dx), inverse(dy), inverse(dz))


class ScanAugmentation:
    """Augments each scan at its own stamp with the artefacts that were there at that stamp.

    Of these, with those that a tick could have shown by then: an artefact is visible from the first
    tick not before its arrival, in all outputs alike. `perceived` are the ids that `sensors.gate:
    perceived` lets through.
    """

    def __init__(
        self, parameters: Parameters, frames: FrameTree, lives: Lives, meshes: MeshBank
    ) -> None:
        self.perceived: frozenset[int] = frozenset()
        self._settings = parameters.sensors
        self._history_ns = seconds_to_ns(parameters.poses.history)
        self._tick_ns = tick_period_ns(parameters.builder.tick_rate)
        self._frame_names = parameters.frames
        self._frames = frames
        self._lives = lives
        self._meshes = meshes
        self._paths: dict[str, SensorPath] = {}

    def reconfigure(self, settings: SensorsParameters) -> None:
        """Let other settings hold from now on, the wait also for the next scans of known topics."""
        self._settings = settings
        for path in self._paths.values():
            path.wait_ns = seconds_to_ns(settings.tf_wait)

    def prepare(self, environment: Environment) -> None:
        """Make an environment ready to be scanned, if scans come."""
        if self._paths:
            VoxelField.of(environment.voxels)

    def push(self, topic: str, scan: LaserScan, received_ns: int) -> None:
        """Take a scan in; topics do not wait for each other."""
        if topic not in self._paths:
            self._paths[topic] = SensorPath(
                self._frames,
                self._frame_names.map,
                self._frame_names.odom,
                seconds_to_ns(self._settings.tf_wait),
                self._history_ns,
                self._augmented,
            )
        self._paths[topic].push(topic, scan, received_ns)

    def transforms_came(self, now_ns: int) -> None:
        """Release the scans whose transform has become known."""
        for path in self._paths.values():
            path.transforms_came(now_ns)

    def next_deadline_ns(self) -> int | None:
        """Return when the next scan must leave, None if none waits."""
        deadlines = [path.next_deadline_ns() for path in self._paths.values()]
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def deadline_passed(self, now_ns: int) -> None:
        """Release the scans whose deadline is not after `now_ns`."""
        for path in self._paths.values():
            path.deadline_passed(now_ns)

    def take(self) -> list[ReleasedScan]:
        """Return what was released since the last call, in the order of release."""
        released = [scan for path in self._paths.values() for scan in path.take()]
        return sorted(released, key=attrgetter("released_ns")) if len(self._paths) > 1 else released

    def flush(self, now_ns: int) -> None:
        """Release all that still waits: the input has ended."""
        for path in self._paths.values():
            path.flush(now_ns)

    def clear(self) -> None:
        """Drop what waits: the clock jumped back."""
        for path in self._paths.values():
            path.clear()

    def counts(self) -> dict[str, SensorPathCounts]:
        """Return how the scans of each topic left."""
        return {topic: path.counts for topic, path in self._paths.items()}

    def problems(self) -> dict[str, str]:
        """Return, by topic, why the last scan that passed through unaugmented did."""
        return {
            topic: path.last_problem for topic, path in self._paths.items() if path.last_problem
        }

    def late_ns(self) -> dict[str, int]:
        """Return, by topic, how late the transforms were for which scans did not wait [ns]."""
        return {topic: path.late_ns for topic, path in self._paths.items()}

    def _augmented(self, scan: LaserScan, map_from_laser: RigidTransform) -> LaserScan:
        last_tick_ns = scan.stamp_ns // self._tick_ns * self._tick_ns
        scene = self._lives.scene_at(scan.stamp_ns, arrived_by_ns=last_tick_ns)
        if self._settings.gate is SensorGate.PERCEIVED:
            scene = scene.only(self.perceived)
        if not len(scene):
            return scan
        shapes = self._meshes.selection(scene.rows) if self._settings.shape is Shape.MESH else None
        environment = self._lives.environment
        surface = VoxelField.of(environment.voxels) if environment else None
        return augment_scan(scan, map_from_laser, scene.boxes, shapes, surface)
