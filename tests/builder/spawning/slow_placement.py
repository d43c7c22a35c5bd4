"""Slow, obvious twins of where artefacts may arrive, and maps in pictures to ask them about."""

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from are_ros.builder.spawning.placement import Placer
from are_ros.population.catalogue import CatalogueRow, MeshFile, MotionLimits
from are_ros.population.randomness import Purpose, generator
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.regions import SpawnRegion
from are_ros.world.rigid_transform import RigidTransform

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

ROOMS = """
##########
#....#...#
#....#...#
#........#
#....#...#
#.##.....#
#........#
##########
"""

STANDS = MotionLimits()
TURNS = MotionLimits(speed_mps=1.0)
DRIVES = MotionLimits(speed_mps=1.0, turn_radius_m=1.5)


def free_cells(picture: str) -> Mask:
    """Return the cells of a picture that are free."""
    return np.array([[cell == "." for cell in line.strip()] for line in picture.split()])


def row_of(
    length_m: float,
    width_m: float,
    offset_m: tuple[float, float] = (0.0, 0.0),
    motion: MotionLimits = STANDS,
) -> CatalogueRow:
    """Return a type of box, its frame off the middle; what can move does."""
    size_m, centre_m, mesh = (length_m, width_m, 1.0), (*offset_m, 0.1), MeshFile(Path("none.obj"))
    doings = {"walking" if motion.speed_mps > 0.0 else "standing": 1.0}
    return CatalogueRow(0, "box", "box", size_m, centre_m, mesh, motion=motion, behaviours=doings)


def environment_of(
    free: Mask,
    resolution_m: float = 1.0,
    origin: RigidTransform | None = None,
    ground_m: float = 0.0,
) -> Environment:
    """Return a map without voxels, on a plane."""
    cells = np.where(free, 0, 100).astype(np.int8)
    grid = OccupancyGrid(cells, resolution_m, origin or RigidTransform.identity(), "map")
    return Environment(grid, classify(grid, 65, 25), None, PlaneGround(ground_m), 0.06)


def region_of(mask: Mask, weight: npt.NDArray[np.float32] | None = None) -> SpawnRegion:
    """Return a region of these cells."""
    return SpawnRegion(mask.copy(), weight, float(mask.sum()))


def placer_of(free: Mask, resolution_m: float = 1.0) -> Placer:
    """Return what places on a map, wherever it is free."""
    return Placer(environment_of(free, resolution_m), region_of(free))


def stream(number: int) -> np.random.Generator:
    """Return the random numbers of one arrival."""
    return generator(1, Purpose.PLACE, number)


def corners_of(row: CatalogueRow, poses: Floats) -> Floats:
    """Return the corners (N, 4, 2) of a row's footprints at poses (N, 3), by complex numbers."""
    offset = complex(*row.box_centre_in_artefact_m[:2])
    half = 0.5 * np.array(row.size_m[:2])
    local = offset + np.array(
        [complex(x, y) for x in (-half[0], half[0]) for y in (-half[1], half[1])]
    )
    turned = (poses[:, 0] + 1j * poses[:, 1])[:, None] + local * np.exp(1j * poses[:, 2])[:, None]
    return np.stack((turned.real, turned.imag), axis=-1)


def parted(first: Floats, second: Floats, axes: Floats) -> npt.NDArray[np.bool_]:
    """Say which corner sets (N, 4, 2) are parted along any of the axes (N, K, 2)."""
    along_first, along_second = first @ np.swapaxes(axes, 1, 2), second @ np.swapaxes(axes, 1, 2)
    before = along_first.max(axis=1) <= along_second.min(axis=1) + 1e-9
    after = along_second.max(axis=1) <= along_first.min(axis=1) + 1e-9
    return np.asarray(np.any(before | after, axis=1))


def axes_of(yaws_rad: Floats) -> Floats:
    """Return the axes (N, 2, 2) of boxes."""
    cos, sin = np.cos(yaws_rad), np.sin(yaws_rad)
    return np.stack((np.stack((cos, sin), axis=-1), np.stack((-sin, cos), axis=-1)), axis=1)


def stands_free(row: CatalogueRow, poses: Floats, free: Mask) -> Mask:
    """Test corners against the map's edge, and boxes against each blocked square, by axes."""
    corners = corners_of(row, poses)
    height, width = free.shape
    clear: Mask = np.all(
        (corners > -1e-9) & (corners < np.array((width, height)) + 1e-9), axis=(1, 2)
    )
    for y, x in np.argwhere(~free):
        square = np.array([(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)], dtype=np.float64)
        left = np.flatnonzero(clear)
        axes = np.concatenate((axes_of(poses[left, 2]), axes_of(np.zeros(len(left)))), axis=1)
        squares = np.broadcast_to(square, (len(left), 4, 2))
        clear[left] = parted(corners[left], squares, axes)
    return np.asarray(clear, dtype=np.bool_)


def discs_free(points_m: Floats, radius_m: float, free: Mask) -> Mask:
    """Test discs about points (N, 2) against the map's edge and each blocked square."""
    height, width = free.shape
    room_m = np.minimum(points_m, (width, height) - points_m).min(axis=1)
    for y, x in np.argwhere(~free):
        nearest = np.clip(points_m, (x, y), (x + 1, y + 1))
        room_m = np.minimum(room_m, np.hypot(*(nearest - points_m).T))
    return np.asarray(room_m >= radius_m)


def disc_m(row: CatalogueRow) -> float:
    """Return the radius of the disc that a row's artefacts have to have room for."""
    radius_m = float(np.hypot(*corners_of(row, np.zeros((1, 3)))[0].T).max())
    if row.motion.turn_radius_m == 0.0:
        return radius_m
    radius_m = min(radius_m, 0.5 * row.size_m[1] + 0.1 * row.size_m[0])
    step_m = 0.01 if radius_m <= 0.5 else 0.05
    return step_m * math.ceil(radius_m / step_m - 1e-6)


def turns_free(row: CatalogueRow, points_m: Floats, free: Mask, slack_m: float = 1e-9) -> Mask:
    """Test the disc that a row's artefacts have to have room for."""
    return discs_free(points_m, disc_m(row) - slack_m, free)


def roomy_cells(row: CatalogueRow, free: Mask, slack_m: float = 1e-9) -> Mask:
    """Return the cells of parts that discs roam and that are long enough for a car, and beside."""
    centres_m = (np.argwhere(np.ones_like(free))[:, ::-1] + 0.5).astype(np.float64)
    labels, count = ndimage.label(turns_free(row, centres_m, free, slack_m).reshape(free.shape))
    sizes = np.bincount(labels[free], minlength=count + 1)
    sizes[0] = 0
    for number, slices in enumerate(ndimage.find_objects(labels), 1):
        sizes[number] *= max(side.stop - side.start for side in slices) >= 2.6
    large = np.isin(labels, np.flatnonzero(sizes))
    return np.asarray(ndimage.binary_dilation(large, np.ones((3, 3))), np.bool_)


def drives_off(row: CatalogueRow, poses: Floats, free: Mask, slack_m: float = 1e-9) -> Mask:
    """Test the six ways of a turning radius from poses (N, 3), by boxes every half a cell."""
    length_m, width_m = (max(side_m - 2.0 * slack_m, 0.0) for side_m in row.size_m[:2])
    offset_x_m, offset_y_m, _ = row.box_centre_in_artefact_m
    smaller = row_of(length_m, width_m, (offset_x_m, offset_y_m))
    way_m = row.motion.turn_radius_m
    off = np.zeros(len(poses), np.bool_)
    for sign in (-1.0, 1.0):
        for curvature in np.array([-1.0, 0.0, 1.0]) / (1.01 * way_m):
            is_clear = np.ones(len(poses), np.bool_)
            for along_m in sign * np.linspace(0.0, way_m, math.ceil(2.0 * way_m) + 1):
                turn = curvature * along_m
                chord = (np.exp(1j * turn) - 1.0) / (1j * curvature) if curvature else along_m
                moved = poses[:, 0] + 1j * poses[:, 1] + chord * np.exp(1j * poses[:, 2])
                after = np.column_stack((moved.real, moved.imag, poses[:, 2] + turn))
                is_clear &= stands_free(smaller, after, free)
            off |= is_clear
    return off


def sets_out(row: CatalogueRow, poses: Floats, free: Mask, slack_m: float = 1e-9) -> Mask:
    """Test that one at poses (N, 3) has room for its disc; a car, that it is not shut in, too."""
    out = turns_free(row, poses[:, :2], free, slack_m)
    if row.motion.turn_radius_m > 0.0:
        cols, rows = np.floor(poses[:, :2]).astype(np.int64).T
        out &= roomy_cells(row, free, slack_m)[rows, cols]
        out[out] = drives_off(row, poses[out], free, slack_m)
    return np.asarray(out, np.bool_)
