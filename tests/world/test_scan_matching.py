"""Finding scans on a map: rooms made here, in which the answer is known."""

import math

import numpy as np
import numpy.typing as npt
import pytest

from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.scan_matching import (
    DISTINCT_M,
    DISTINCT_RAD,
    Alignment,
    PlanarPose,
    ScanCloud,
    ScanMatcher,
    _CoarseMap,
    wrapped,
)

CELL_M = 0.05
Cells = npt.NDArray[np.int8]
Points = npt.NDArray[np.float64]


def room(width_m: float, height_m: float) -> Cells:
    """Return an empty room with walls of two cells, in the midst of unknown cells."""
    height, width = round(height_m / CELL_M), round(width_m / CELL_M)
    cells = np.full((height + 12, width + 12), -1, np.int8)
    cells[4:-4, 4:-4] = 100
    cells[6:-6, 6:-6] = 0
    return cells


def put(cells: Cells, x_m: float, y_m: float, width_m: float, height_m: float) -> None:
    """Put a block into a room; (0, 0) is the room's corner."""
    row, col = 6 + round(y_m / CELL_M), 6 + round(x_m / CELL_M)
    cells[row : row + round(height_m / CELL_M), col : col + round(width_m / CELL_M)] = 100


NOWHERE = PlanarPose(0.0, 0.0, 0.0)


def grid_of(cells: Cells, origin: PlanarPose = NOWHERE) -> OccupancyGrid:
    """Return the grid of cells, its corner anywhere."""
    return OccupancyGrid(cells, CELL_M, RigidTransform.planar(*origin), "map")


def scanned(
    cells: Cells, places_m: list[tuple[float, float]], map_from_cloud: PlanarPose, reach_m: float
) -> ScanCloud:
    """Return what a laser sees from places in the grid's frame, marching by a fifth of a cell."""
    ends, origins, scans = [], [], []
    for number, (x, y) in enumerate(places_m):
        for angle in np.linspace(-math.pi, math.pi, 240, endpoint=False):
            steps = np.arange(0.0, reach_m, 0.2 * CELL_M)
            xs, ys = x + steps * math.cos(angle), y + steps * math.sin(angle)
            rows, cols = (ys / CELL_M).astype(int), (xs / CELL_M).astype(int)
            inside = (rows >= 0) & (rows < cells.shape[0]) & (cols >= 0) & (cols < cells.shape[1])
            hits = np.flatnonzero(cells[rows[inside], cols[inside]] == 100)
            if len(hits):
                ends.append((xs[hits[0]], ys[hits[0]]))
                origins.append((x, y))
                scans.append(number)
    back = map_from_cloud.inverse()
    return ScanCloud(back.apply(np.array(ends)), back.apply(np.array(origins)), np.array(scans))


def matcher_of(grid: OccupancyGrid) -> ScanMatcher:
    """Return the matcher for a grid, with the usual thresholds."""
    return ScanMatcher(grid, classify(grid, 65, 20))


def aligned(matcher: ScanMatcher, cloud: ScanCloud) -> Alignment:
    """Align; something must be found."""
    found = matcher.align(cloud)
    assert found is not None
    return found


def assert_near(pose: PlanarPose, truth: PlanarPose, at_m: npt.NDArray[np.float64]) -> None:
    """Assert that the cloud lies within 5 cm and 1 degree of where it should."""
    middle = at_m.mean(axis=0)[np.newaxis]
    assert np.hypot(*(pose.apply(middle) - truth.apply(middle))[0]) < 0.05
    assert abs(wrapped(pose.yaw_rad - truth.yaw_rad)) < math.radians(1.0)


@pytest.fixture(scope="module")
def furnished() -> Cells:
    """Return a room that looks different from everywhere."""
    cells = room(7.0, 5.0)
    put(cells, 1.0, 3.5, 1.5, 0.4)
    put(cells, 5.2, 0.8, 0.5, 1.4)
    put(cells, 3.0, 0.0, 0.3, 1.2)
    return cells


def test_poses_compose_and_invert() -> None:
    """A pose after its inverse is none, and composing is applying twice."""
    a, b = PlanarPose(1.0, -2.0, 2.5), PlanarPose(0.3, 0.7, 1.9)
    points = np.array([[1.0, 0.0], [-2.0, 3.0]])
    np.testing.assert_allclose(a.after(b).apply(points), a.apply(b.apply(points)), atol=1e-12)
    np.testing.assert_allclose(a.inverse().after(a), (0.0, 0.0, 0.0), atol=1e-12)


@pytest.mark.parametrize("yaw", [-2.9, -0.7, 0.0, 1.6])
def test_a_room_is_found_wherever_its_map_lies(furnished: Cells, yaw: float) -> None:
    """Maps with a turned origin, clouds turned otherwise: one answer, and the right one."""
    origin = PlanarPose(3.0 * yaw, -2.0, 0.5 - yaw)
    grid_from_cloud = PlanarPose(2.0, 1.5, yaw)
    cloud = scanned(furnished, [(2.0, 1.8), (3.9, 3.0), (6.3, 3.6)], grid_from_cloud, 20.0)
    found = aligned(matcher_of(grid_of(furnished, origin)), cloud)
    assert_near(found.best.pose, origin.after(grid_from_cloud), cloud.origins_m)
    assert found.best.near > 0.97
    assert not found.is_ambiguous
    assert not found.best.is_poor
    assert found.slides_rad is None


def test_a_wild_return_far_away_does_not_widen_the_search(furnished: Cells) -> None:
    """One endpoint 60 m beyond a room of 7 m: as many headings are tried, and the room is found."""
    truth = PlanarPose(1.0, 2.0, 0.8)
    cloud = scanned(furnished, [(2.0, 1.8), (3.9, 3.0)], truth, 20.0)
    wild = ScanCloud(
        np.concatenate((cloud.endpoints_m, [[60.0, 3.0]])),
        np.concatenate((cloud.origins_m, cloud.origins_m[-1:])),
        np.append(cloud.scans, cloud.scans[-1]),
    )
    matcher, headings = matcher_of(grid_of(furnished)), set[int]()
    for one in (cloud, wild):
        found = matcher.align(one, lambda _, count: headings.add(count))
        assert found is not None
        assert_near(found.best.pose, truth, cloud.origins_m)
    assert max(headings) < 1.5 * min(headings)


def test_people_who_are_not_on_the_map_do_not_matter(furnished: Cells) -> None:
    """A quarter of the endpoints may be anywhere before the walls."""
    truth = PlanarPose(1.0, 2.0, 0.8)
    cloud = scanned(furnished, [(2.0, 1.8), (3.9, 3.0)], truth, 20.0)
    dice = np.random.Generator(np.random.PCG64(3))
    ends = cloud.endpoints_m.copy()
    crowd = dice.random(len(ends)) < 0.25
    part = dice.uniform(0.3, 0.8, (int(crowd.sum()), 1))
    ends[crowd] = cloud.origins_m[crowd] * (1.0 - part) + ends[crowd] * part
    found = aligned(matcher_of(grid_of(furnished)), ScanCloud(ends, cloud.origins_m, cloud.scans))
    assert_near(found.best.pose, truth, cloud.origins_m)
    assert 0.7 < found.best.near < 0.85


def test_the_search_finds_what_trying_every_pose_finds() -> None:
    """The first candidate is the best pose of the lattice; each is far from those before it."""
    cells = room(3.0, 2.2)
    put(cells, 1.7, 0.6, 0.3, 0.4)
    cloud = scanned(cells, [(1.1, 1.3)], PlanarPose(0.2, 0.1, 1.0), 5.0)
    coarse = matcher_of(grid_of(cells))._coarse
    points = (cloud.endpoints_m - cloud.origins_m[0]) / coarse.cell_m
    peaks = coarse._peaks(points)
    best = _lattice_score(coarse, points, *peaks[0])
    height, width = coarse.values.shape
    yaws = np.arange(0.0, 2.0 * math.pi, 1.0 / np.hypot(*points.T).max())
    for yaw in yaws.tolist():
        for x, y in np.ndindex(width, height):
            assert _lattice_score(coarse, points, x, y, yaw) <= best + 1e-3
    for number, (x, y, yaw) in enumerate(peaks):
        for x1, y1, yaw1 in peaks[:number]:
            is_away = math.hypot(x - x1, y - y1) * coarse.cell_m >= DISTINCT_M
            assert is_away or abs(wrapped(yaw - yaw1)) >= DISTINCT_RAD


def _lattice_score(coarse: _CoarseMap, points: Points, x: float, y: float, yaw: float) -> float:
    """Return the sum of the map's values at the cells of the points, one by one."""
    total = 0.0
    for px, py in points.tolist():
        col = round(math.cos(yaw) * px - math.sin(yaw) * py) + int(x)
        row = round(math.sin(yaw) * px + math.cos(yaw) * py) + int(y)
        if 0 <= row < coarse.values.shape[0] and 0 <= col < coarse.values.shape[1]:
            total += float(coarse.values[row, col])
    return total


def test_a_square_room_is_ambiguous() -> None:
    """Four headings fit as well as each other; all are named."""
    cells = room(4.0, 4.0)
    grid_from_cloud = PlanarPose(2.0, 1.0, 0.3)
    cloud = scanned(cells, [(1.8, 1.5), (3.0, 2.9)], grid_from_cloud, 20.0)
    found = aligned(matcher_of(grid_of(cells)), cloud)
    assert found.is_ambiguous
    yaws = sorted(match.pose.yaw_rad for match in (found.best, *found.equals))
    np.testing.assert_allclose(np.diff(yaws), math.pi / 2, atol=0.02)
    assert found.slides_rad is None


def test_a_landmark_makes_the_square_room_plain() -> None:
    """The same room with a cupboard in a corner has one answer."""
    cells = room(4.0, 4.0)
    put(cells, 0.0, 3.2, 1.4, 0.8)
    truth = PlanarPose(2.0, 1.0, 0.3)
    cloud = scanned(cells, [(1.8, 1.5), (3.0, 2.9)], truth, 20.0)
    found = aligned(matcher_of(grid_of(cells)), cloud)
    assert not found.is_ambiguous
    assert_near(found.best.pose, truth, cloud.origins_m)


def test_a_corridor_is_ambiguous_along_itself() -> None:
    """A laser that sees no end of a corridor can be anywhere along it, and that is said."""
    cells = room(24.0, 2.0)
    put(cells, 0.0, 0.0, 3.0, 0.8)
    cloud = scanned(cells, [(12.0, 1.2), (13.0, 1.3)], PlanarPose(5.0, 1.0, 0.2), 4.0)
    found = aligned(matcher_of(grid_of(cells)), cloud)
    assert found.is_ambiguous
    assert found.slides_rad is not None
    assert abs(math.sin(found.slides_rad)) < 0.1


def test_the_map_of_another_place_is_not_taken(furnished: Cells) -> None:
    """Scans of a furnished room fit nowhere in a hall of pillars, or badly."""
    hall = room(9.0, 9.0)
    for x_m in np.arange(0.6, 8.5, 1.2):
        for y_m in np.arange(0.6, 8.5, 1.2):
            put(hall, float(x_m), float(y_m), 0.2, 0.2)
    cloud = scanned(furnished, [(2.0, 1.8), (3.9, 3.0)], PlanarPose(0.0, 0.0, 0.0), 20.0)
    found = matcher_of(grid_of(hall)).align(cloud)
    assert found is None or found.best.is_poor


def test_a_beam_through_a_wall_speaks_against_a_pose() -> None:
    """Of two equal rooms in a row, a drive through the door between them tells which is which."""
    cells = room(8.0, 4.0)
    put(cells, 3.95, 0.0, 0.1, 1.5)
    put(cells, 3.95, 2.5, 0.1, 1.5)
    truth = PlanarPose(0.0, 0.0, 0.0)
    cloud = scanned(cells, [(3.0, 2.3)], truth, 20.0)
    matcher = matcher_of(grid_of(cells))
    right = matcher.match(cloud, truth)
    behind = matcher.match(cloud, PlanarPose(0.0, 1.2, 0.0))
    assert right.through < 0.02
    assert behind.through > 0.1


def test_a_fine_map_is_searched_as_a_coarse_one_is(furnished: Cells) -> None:
    """Cells of a centimetre are pooled for the search, and used to refine."""
    fine = np.kron(furnished, np.ones((5, 5), np.int8))
    grid = OccupancyGrid(fine, CELL_M / 5, RigidTransform.identity(), "map")
    truth = PlanarPose(1.0, 2.0, -2.0)
    cloud = scanned(furnished, [(2.0, 1.8), (3.9, 3.0)], truth, 20.0)
    found = aligned(matcher_of(grid), cloud)
    assert_near(found.best.pose, truth, cloud.origins_m)
    assert matcher_of(grid)._coarse.cell_m == pytest.approx(4 * CELL_M)


@pytest.mark.parametrize("percent", [-3, 0, 2, 3])
def test_a_map_of_another_scale_is_told(furnished: Cells, percent: int) -> None:
    """It is found, and fits, beside its place. A cell is 1 % of the room, which is as exact."""
    cloud = scanned(furnished, [(1.0, 1.0), (4.0, 2.5), (6.0, 4.0)], NOWHERE, 8.0)
    cloud = cloud.scaled(1.0 - percent / 100.0)
    matcher = matcher_of(grid_of(furnished))
    scale = matcher.best_scale(cloud, aligned(matcher, cloud).best)
    assert scale == pytest.approx(1.0 + percent / 100.0, abs=0.011)
    assert (scale == 1.0) == (percent == 0)
