"""Tests of the picture of a replay from above."""

import math
import tracemalloc
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from are_ros.agents.events import SceneMetrics
from are_ros.draw.map import known_part, shaded, window_of, with_furniture
from are_ros.draw.overview import _leader_px, _legends, _title, draw_overview, subtitle_of
from are_ros.draw.palette import Rgb
from are_ros.draw.robot import fan_at, level_sight, other_fans, spread_indices, walls_of
from are_ros.draw.scene import Life, SceneRecord, TickSeries, Track
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.world.cameras import (
    CameraAt,
    OmnidirectionalView,
    PinholeView,
    ViewModel,
    mounted_camera,
)
from are_ros.world.footprint import Footprint
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap
from tests.draw.made_runs import run, walker

PERSON_BGR = (0x5B, 0x49, 0xD1)
PINHOLE = PinholeView.from_field_of_view(64, 48, math.pi / 2)
ALL_AROUND = OmnidirectionalView(64, 16, -0.5, 0.5)
Image = npt.NDArray[np.uint8]


def _room(yaw_rad: float = 0.0, side: int = 60) -> OccupancyGrid:
    """Return a walled room, 0.1 m cells, with unknown all around."""
    cells = np.full((side, side), -1, dtype=np.int8)
    cells[5:-5, 5:-5] = 100
    cells[6:-6, 6:-6] = 0
    return OccupancyGrid(cells, 0.1, RigidTransform.planar(-1.0, -2.0, yaw_rad), "map")


def _life(
    artefact_id: int, x_m: float, y_m: float, *, perceived: bool, name: str = "person"
) -> Life:
    row = CatalogueRow(0, f"{name}_a", name, (0.6, 0.9, 1.8), (0.0, 0.0, 0.9), Shape.WALL)
    track = Track(np.array([10**9]), np.array([(x_m, y_m, 0.4)]))
    seen_ns = np.array([10**9, 2 * 10**9] if perceived else [], dtype=np.int64)
    return Life(artefact_id, row, 10**9, None, "", track, seen_ns)


def _record(
    lives: Sequence[Life] = (),
    way: Sequence[tuple[float, float, float]] = (),
    view: ViewModel = PINHOLE,
) -> SceneRecord:
    stamps = np.arange(1, len(way) + 1, dtype=np.int64) * 10**9
    camera = mounted_camera(view, (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)).base_from_optical
    poses = [RigidTransform.planar(*pose) @ camera for pose in way]
    numbers = [(*p.translation_m, *p.rotation_xyzw) for p in poses]
    zeros = np.zeros(len(way), dtype=np.int64)
    arrived = len(lives)
    return SceneRecord(
        seed=1,
        max_range_m=30.0,
        footprint=Footprint.disc(0.25),
        robot=Track(stamps, np.array(way, dtype=np.float64).reshape(-1, 3)),
        camera=Track(stamps.copy(), np.array(numbers, dtype=np.float64).reshape(-1, 7)),
        views=(view,),
        view_of_pose=zeros,
        lives=tuple(lives),
        events=(),
        series=TickSeries(stamps.copy(), zeros.copy(), zeros.copy(), zeros.astype(float), 0),
        metrics=SceneMetrics(arrived, 0, arrived, 0, 0, 0, 0, 1.0, 0.0),
    )


def _drawn(record: SceneRecord, grid: OccupancyGrid, path: Path) -> Image:
    draw_overview(record, grid, path, occupied_threshold=65)
    image = cv2.imread(str(path))
    assert image is not None
    return np.asarray(image, dtype=np.uint8)


def _count(image: Image, bgr: tuple[int, int, int]) -> int:
    return int((image == bgr).all(axis=2).sum())


def test_all_cameras_are_drawn(tmp_path: Path) -> None:
    """One that looks back is in the picture, and its field of view ends behind the robot."""
    record = _record((), ((2.5, 2.5, 0.0),))
    camera = mounted_camera(PINHOLE, (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)).base_from_optical
    backward = CameraAt(1, PINHOLE, RigidTransform.planar(2.5, 2.5, math.pi) @ camera)
    both = replace(record, others={10**9: (backward,)})
    (fan,) = other_fans(both, walls_of(_room(), 65), 10**9)
    assert fan[1:, 0].max() < 2.5
    assert other_fans(record, walls_of(_room(), 65), 10**9) == []
    one, two = (_drawn(each, _room(), tmp_path / "a.png") for each in (record, both))
    assert (one != two).any(axis=2).sum() > 10_000
    alone = replace(both, camera=Track(np.zeros(0, np.int64), np.zeros((0, 7))))
    assert alone.has_cameras
    blind = _drawn(replace(alone, others={}), _room(), tmp_path / "b.png")
    drawn = _drawn(alone, _room(), tmp_path / "b.png")
    assert (drawn[: blind.shape[0]] != blind[: drawn.shape[0]]).any(axis=2).sum() > 5_000


def test_a_number_has_a_line_to_its_artefact() -> None:
    """From the side of the number to the nearest point of the outline, as many points find it."""
    turned = np.array(((60.0, 10.0), (95.0, 30.0), (80.0, 56.0), (45.0, 36.0)))
    sides = np.roll(turned, -1, axis=0) - turned
    points = np.concatenate([turned + share * sides for share in np.linspace(0.0, 1.0, 2001)])
    for left, top in ((0.0, 0.0), (120.0, 20.0), (60.0, 90.0), (20.0, 50.0)):
        begin, end = _leader_px((left, top, left + 14.0, top + 9.0), turned)
        middle = np.array((left + 7.0, top + 4.5))
        shortest_px = np.linalg.norm(points - middle, axis=1).min()
        assert np.linalg.norm(end - middle) == pytest.approx(shortest_px, abs=1e-3)
        assert np.linalg.norm(points - end, axis=1).min() < 0.02
        assert left <= begin[0] <= left + 14.0
        assert top <= begin[1] <= top + 9.0


WAY = ((0.5, 0.5, 0.0), (1.5, 0.5, 0.3), (2.5, 1.5, 1.0))


def test_same_bytes(tmp_path: Path) -> None:
    """The same record gives the same bytes."""
    record = _record([_life(1, 2.0, 2.0, perceived=True)], WAY)
    for name in ("a.png", "b.png"):
        draw_overview(record, _room(), tmp_path / name, occupied_threshold=65)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_the_octomap_is_drawn_and_hides_at_the_height_of_the_camera(tmp_path: Path) -> None:
    """A shelf of 1.5 m cuts a fan off, a bench of 0.5 m does not; both are in the picture."""
    grid = _room()
    record = _record((), ((0.5, 0.5, 0.0),))
    for height_m, is_hiding in ((1.5, True), (0.5, False)):
        occupied = np.zeros((60, 60, 20), np.uint8)
        occupied[25:28, 10:50, : round(10 * height_m)] = 1
        voxels = VoxelMap(grid.origin, (0.1, 0.1, 0.1), occupied)
        fan = fan_at(record, walls_of(grid, 65, voxels), 0)
        assert fan is not None
        assert (fan[:, 0].max() < 1.9) == is_hiding
        draw_overview(record, grid, tmp_path / "a.png", occupied_threshold=65, voxels=voxels)
        draw_overview(record, grid, tmp_path / "b.png", occupied_threshold=65)
        one, other = (cv2.imread(str(tmp_path / name)) for name in ("a.png", "b.png"))
        assert one is not None
        assert other is not None
        share = 0.3 * 4.0 / (5.0 * 5.0)
        assert (one != other).any(axis=2).mean() > 0.3 * share


def test_fine_and_coarse_voxels_cover_their_cells() -> None:
    """Neither do fine ones get lost between the middles of cells nor have coarse ones holes."""
    grid = _room()
    part = known_part(grid)
    for size_m, count in ((0.02, 50), (0.25, 4)):
        occupied = np.zeros((count, 1, 1), np.uint8)
        occupied[:] = 1
        corner = grid.origin.apply(np.array((1.03, 1.03, 0.5)))
        pose = RigidTransform(corner, grid.origin.rotation_xyzw)
        low = occupied[:, :, [0] * math.ceil(0.2 / size_m)].copy()
        shown = with_furniture(grid, part, VoxelMap(pose, (size_m,) * 3, low))
        cols = np.flatnonzero((shown.cells != part.cells).any(axis=0)) + part.col0
        assert cols[0] == 10
        assert np.array_equal(np.diff(cols), np.ones(len(cols) - 1))
        assert len(cols) in {10, 11}


def test_furniture_of_a_large_map_takes_little_memory() -> None:
    """All places of its cells at once are 150 bytes a cell: 4 GB of a hall of 100 m at 2 cm."""
    grid = OccupancyGrid(np.zeros((1500, 2000), np.int8), 0.02, RigidTransform.identity(), "map")
    occupied = np.zeros((60, 40, 10), np.uint8)
    occupied[10:20, 5:40, 2] = 1
    voxels = VoxelMap(RigidTransform.identity(), (0.7, 0.7, 0.1), occupied)
    tracemalloc.start()
    shown = with_furniture(grid, known_part(grid), voxels)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 30 * grid.cells.size
    rows, cols = np.nonzero(shown.cells)
    assert [rows.min(), cols.min(), cols.max()] == [175, 350, 699]
    assert rows.max() == 1399
    assert len(rows) == (1400 - 175) * (700 - 350)


def test_settings_of_the_user_change_nothing(tmp_path: Path) -> None:
    """Settings of matplotlib in force neither show in the picture nor are they changed."""
    import matplotlib as mpl

    draw_overview(_record((), WAY), _room(), tmp_path / "a.png", occupied_threshold=65)
    with mpl.rc_context({"font.size": 30, "axes.facecolor": "red", "lines.linewidth": 9}):
        draw_overview(_record((), WAY), _room(), tmp_path / "b.png", occupied_threshold=65)
        assert mpl.rcParams["font.size"] == 30
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_perceived_is_filled_and_unperceived_is_not(tmp_path: Path) -> None:
    """A perceived artefact fills its footprint with its class's colour, another one does not."""
    filled, pale = (
        _count(
            _drawn(_record([_life(1, 2.0, 2.0, perceived=seen)]), _room(), tmp_path / "a.png"),
            PERSON_BGR,
        )
        for seen in (True, False)
    )
    assert filled > 3000
    assert pale < 0.3 * filled


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, math.pi / 2, -2.5])
def test_rotated_origin(tmp_path: Path, yaw_rad: float) -> None:
    """The map is drawn where it lies, also with a rotated origin: walls are there, in dark grey."""
    image = _drawn(_record((), WAY), _room(yaw_rad), tmp_path / "a.png")
    assert _count(image, (104, 95, 88)) > 1000


@pytest.mark.parametrize(
    "cells",
    [
        np.full((3, 4), -1, dtype=np.int8),
        np.zeros((1, 1), dtype=np.int8),
        np.zeros((2, 500), dtype=np.int8),
        np.zeros((500, 2), dtype=np.int8),
    ],
)
def test_odd_maps_without_a_scene(tmp_path: Path, cells: npt.NDArray[np.int8]) -> None:
    """Nothing to see, in maps of any shape, gives a picture all the same."""
    grid = OccupancyGrid(cells, 0.05, RigidTransform.identity(), "map")
    assert _drawn(_record(), grid, tmp_path / "a.png").shape[0] > 100


def test_hundreds_of_artefacts(tmp_path: Path) -> None:
    """Hundreds of artefacts of many classes, also unknown ones, are drawn."""
    random = np.random.default_rng(1)
    lives = [
        _life(i, *random.uniform(-1, 4, 2).tolist(), perceived=i % 2 == 0, name=f"class{i % 9}")
        for i in range(200)
    ]
    assert _drawn(_record(lives, WAY), _room(), tmp_path / "a.png").size > 0


def test_one_pose_of_an_all_round_camera(tmp_path: Path) -> None:
    """A robot that stands still with a camera that sees all around is drawn."""
    record = _record((), [(1.0, 1.0, 0.0)], ALL_AROUND)
    assert _drawn(record, _room(), tmp_path / "a.png").size > 0


def test_known_part_and_window() -> None:
    """The picture is cut to the known cells, and grows for what lies outside them."""
    grid = _room()
    part = known_part(grid)
    assert (part.cells.shape, part.row0, part.col0) == ((50, 50), 5, 5)
    window = window_of(grid, part, np.zeros((0, 2)))
    assert (window.left, window.right) == pytest.approx((-0.6, 4.6))
    assert (window.bottom, window.top) == pytest.approx((-1.6, 3.6))
    assert window_of(grid, part, np.array([(9.0, 0.0)])).right > 9.0


def test_pooling_keeps_thin_walls() -> None:
    """In a map of many cells a wall of one cell is still there."""
    cells = np.zeros((10, 3000), dtype=np.int8)
    cells[7, 1234] = 100
    grid = OccupancyGrid(cells, 0.01, RigidTransform.identity(), "map")
    image, factor = shaded(known_part(grid), cell_px=2.0)
    assert factor == 3
    assert image[7 // 3, 1234 // 3].tolist() == [88, 95, 104, 255]
    assert (image[:, :, 0] == 88).sum() == 1


def _marched_slowly(grid: OccupancyGrid, start: tuple[float, float], angle_rad: float) -> float:
    """Return how far a ray gets, by steps of a fiftieth of a cell."""
    step_m = grid.resolution_m / 50
    lengths = np.arange(int(6.0 / step_m)) * step_m
    ray = np.array((math.cos(angle_rad), math.sin(angle_rad)))
    cells = grid.points_to_cells(np.array(start) + lengths[:, np.newaxis] * ray)
    inside = grid.contains(cells)
    hit = inside & (grid.cells[cells[:, 0] * inside, cells[:, 1] * inside] >= 65)
    return float(lengths[np.argmax(hit)]) if hit.any() else 6.0


def test_rays_end_at_walls() -> None:
    """Rays stop at walls as slow stepping says, but for some that graze a corner."""
    random = np.random.default_rng(5)
    room = _room(0.6)
    cells = room.cells.copy()
    cells[10:50, 10:50][random.random((40, 40)) < 0.01] = 100
    cells[18:23, 28:33] = 0
    grid = OccupancyGrid(cells, 0.1, room.origin, "map")
    start = tuple(grid.cells_to_points([(20, 30)])[0].tolist())
    angles = np.linspace(-math.pi, math.pi, 300)
    rays = np.column_stack((np.cos(angles), np.sin(angles)))
    level = np.column_stack((rays, np.zeros(300)))
    fast = walls_of(grid, 65).first_hits(np.array((*start, 1.0)), level, 6.0)
    slow = np.array([_marched_slowly(grid, start, angle) for angle in angles.tolist()])
    assert (np.abs(fast - slow) < 0.1 * grid.resolution_m).mean() > 0.97


def test_rays_in_the_open_reach_the_range() -> None:
    """Without walls, and outside the map, rays reach as far as the camera measures."""
    grid = OccupancyGrid(np.zeros((20, 20), np.int8), 0.1, RigidTransform.identity(), "map")
    optical = mounted_camera(PINHOLE, (5.0, 1.0, 1.0, 0.0, 0.0, 0.0)).base_from_optical
    rays, reach_m = level_sight(PINHOLE, optical, walls_of(grid, 65), 30.0, 9)
    assert rays.shape == (9, 2)
    assert np.hypot(*rays.T) == pytest.approx(np.ones(9))
    assert reach_m == pytest.approx(np.full(9, 30.0), rel=1e-3)


def test_taller_artefacts_end_a_fan() -> None:
    """An artefact that reaches up to the camera casts a shadow; the ray ends behind it."""
    blocked = _record([_life(1, 2.5, 0.5, perceived=True)], WAY[:1])
    reaches = []
    for record in (blocked, _record((), WAY[:1])):
        fan = fan_at(record, walls_of(_room(), 65), 0)
        assert fan is not None
        offsets = fan[1:] - (0.5, 0.5)
        ahead = np.argmin(np.abs(np.arctan2(offsets[:, 1], offsets[:, 0])))
        reaches.append(float(fan[1 + ahead, 0]))
    assert reaches[0] == pytest.approx(2.5 + 0.3 / math.cos(0.4), abs=0.1)
    assert reaches[1] == pytest.approx(4.4, abs=0.12)


def test_fan_of_a_pinhole_is_as_wide_as_its_view() -> None:
    """The fan of a pinhole camera begins at the camera and opens by its field of view."""
    fan = fan_at(_record((), WAY[:1]), walls_of(_room(), 65), 0)
    assert fan is not None
    assert fan[0] == pytest.approx((0.5, 0.5))
    offsets = fan[[1, -1]] - fan[0]
    half = math.atan(63 / 64)
    assert sorted(np.arctan2(offsets[:, 1], offsets[:, 0])) == pytest.approx(
        [-half, half], abs=0.01
    )


def test_poses_are_spread_over_the_way() -> None:
    """Poses are chosen by what the robot drove, not by how long it stood, and the last is one."""
    way = [(0.0, 0.0, 0.0)] * 50 + [(0.1 * i, 0.0, 0.0) for i in range(40)]
    chosen = spread_indices(_record((), way), 4)
    assert len(chosen) == 4
    assert [way[i][0] for i in chosen] == pytest.approx([0.65, 1.95, 3.25, 3.9], abs=0.11)
    assert spread_indices(_record((), [(0.0, 0.0, 0.0)] * 9), 4) == [0, 8]
    assert spread_indices(_record(), 4) == []


def test_the_subtitle_says_how_many_have_no_room() -> None:
    """And nothing of it where all have."""
    record = run([walker(1, (2, 2), (8, 6))])
    assert subtitle_of(record, 0, "metrics.json")[-1] == "numbers are ids, as in metrics.json"
    assert subtitle_of(record, 3, "/tags")[-1] == (
        "numbers are ids, as in /tags; 3 numbers left out for want of room"
    )
    scripted = subtitle_of(run([walker(1_000_000_001, (2, 2), (8, 6))]), 0, "metrics.json")
    assert scripted[-1] == "numbers are ids, as in metrics.json, s0 for 1000000000"


def test_without_perception_nothing_is_said_to_be_perceived() -> None:
    """Neither in the title nor in the legend: nobody looked."""
    record = _record([_life(1, 1.0, 1.0, perceived=False)], [(0.0, 0.0, 0.0)] * 2)
    blind = replace(record, series=replace(record.series, blind_ticks=None))
    colours: dict[str, Rgb] = {"person": (1, 2, 3)}
    said = [
        [_title(one), *(e.name for part in _legends(one, colours, {}, 0) for e in part)]
        for one in (record, blind)
    ]
    assert said[0][:2] == ["1 virtual artefact arrived, 0 perceived", "person  0 of 1"]
    assert said[1][:2] == ["1 virtual artefact arrived, perception left out", "person  1"]
    assert [one for one in said[0][2:] if one not in said[1]] == ["perceived", "never perceived"]
