"""The checks' own geometry, transforms and decoding against those of the builder's side."""

import ast
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import are_ros.checks
from are_ros.bag.decoded import Scene
from are_ros.bag.marker_decoding import decode_markers
from are_ros.builder.costmap.registration import covered_cells
from are_ros.builder.markers import DELETE_ALL, MarkerBatch, MarkerKind, MarkerLook
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.checks.marker_rules import change_of
from are_ros.checks.oracle.frames import ODOMETRY, TF, Frames
from are_ros.checks.oracle.inflation import Costs, Inflation
from are_ros.checks.oracle.plane import Outline, distances_m, overlap_depths_m
from are_ros.checks.oracle.solids import Covers, RealMap, Walls
from are_ros.checks.record import Record
from are_ros.checks.sensors.scans import KnownWalls
from are_ros.conventions import NS_PER_S
from are_ros.errors import FrameError
from are_ros.messages.markers import MarkerEncoder
from are_ros.parameters.model import Parameters
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.footprint import Footprint, penetration_m
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.transforms.table import TransformSource
from are_ros.world.transforms.tree import FrameTree
from are_ros.world.voxel_map import VoxelMap
from tests.world.overlapping import overlaps

MS = 1_000_000
KNOWN = 10**15


def make_boxes(count: int, seed: int) -> tuple[OrientedBoxes, Scene]:
    """Return random boxes in some square metres, in both forms."""
    generator = np.random.default_rng(seed)
    centres = generator.uniform(-2.0, 2.0, (count, 3))
    yaws = generator.uniform(-math.pi, math.pi, count)
    halves = generator.uniform(0.05, 0.8, (count, 3))
    ids, zeros = np.arange(count), np.zeros(count, np.int64)
    scene = Scene(0, 0, "map", ids, centres, yaws, halves, zeros, zeros, ())
    return OrientedBoxes(centres, yaws, halves), scene


def test_a_tiny_free_map_costs_nothing() -> None:
    """Without an obstacle no distance is small, however few cells there are."""
    for shape in ((1, 1), (3, 2), (40, 40)):
        real = RealMap(np.zeros(shape, np.int8), 0.05, (0.0, 0.0, 0.0), 0.0, "map")
        costs = Costs(radius_m=0.7, scaling=3.0, inscribed_m=0.22)
        assert not Inflation(real, costs, 65, 25).static_high.any(), shape


@pytest.mark.parametrize("is_cloud", [True, False])
def test_walls_are_crossed_where_rays_hit_them(is_cloud: bool) -> None:
    """Random voxels or cells, from free places, rays as long as may be: but for corners cut."""
    generator = np.random.default_rng(7)
    occupied = generator.uniform(size=(30, 24, 8 if is_cloud else 1)) < 0.04
    if is_cloud:
        centres = (np.argwhere(occupied) + 0.5).astype(np.float64) * 0.1
        centres = centres + np.array((1.0, -2.0, 0.3))
        voxels = VoxelMap.from_centres(centres, None, RigidTransform.identity())
        walls = Walls.of_cloud(centres, 0.0)
    else:
        cells = np.where(occupied[:, :, 0].T, np.int8(100), np.int8(0))
        grid = OccupancyGrid(cells, 0.1, RigidTransform.planar(1.0, -2.0, 0.4), "map")
        voxels = VoxelMap.extruded(grid, cells == 100, 2.0, -0.5)
        walls = Walls.of_map(RealMap.of_grid(grid), 65, -0.5, 1.5)
    assert walls is not None
    field, corner = VoxelField.of(voxels), np.array((1.0, -2.0, 0.3))
    late, missed = [], []
    for _ in range(60):
        points = corner + generator.uniform(0.0, 1.0, (21, 3)) * (3.0, 2.4, 0.8)
        start, ways = points[0], points[1:] - points[0]
        lengths = np.linalg.norm(ways, axis=1)
        rays = field.first_hits(start, ways / lengths[:, None], 10.0)
        found = np.linalg.norm(walls.crossed(start, points[1:]) - start, axis=1)
        is_found = np.isfinite(found)
        assert (rays[is_found] < lengths[is_found]).all()
        late += (found[is_found] - rays[is_found]).tolist()
        missed += (~is_found & (rays < lengths - 0.02)).tolist()
    assert len(late) > 100
    assert min(late) > 0.0
    assert np.quantile(late, 0.85) < 0.02  # of the others a corner was cut before
    assert np.mean(missed) < 0.05


def test_ways_from_many_starts_are_crossed_as_each_alone() -> None:
    """To the bit, so that beams of many scans may be looked at side by side."""
    generator = np.random.default_rng(8)
    centres = 0.2 * np.argwhere(generator.random((12, 9, 4)) < 0.1).astype(np.float64)
    walls = Walls.of_cloud(centres, 0.2)
    assert walls is not None
    starts, ends = generator.uniform(0.0, 1.0, (2, 200, 3)) * (2.4, 1.8, 0.8)
    alone = [walls.crossed(start, end[None])[0] for start, end in zip(starts, ends, strict=True)]
    assert 20 < np.isfinite(alone).all(axis=1).sum() < 180
    assert np.array_equal(walls.crossed(starts, ends), alone, equal_nan=True)


def test_walls_are_known_though_the_map_comes_again_and_again() -> None:
    """As a map that is published twice a second; for a second after another one they are not."""
    cells = np.zeros((4, 5), np.int8)
    cells[1, 2] = 100
    record = Record(Parameters(), walls="map")
    for k in range(8):
        cells = cells.copy()
        cells[3, 3] = 100 if k >= 5 else 0
        record.maps.append(RealMap(cells, 0.1, (0.0, 0.0, 0.0), 0.0, "map", k * NS_PER_S // 2))
    walls = KnownWalls(record)
    found = [walls.at(k * NS_PER_S // 2 + 1) for k in range(12)]
    assert [one is not None for one in found] == [k not in {5, 6} for k in range(12)]
    assert found[0] is found[4]
    assert [len(one.solid) for one in found if one is not None] == [1] * 5 + [2] * 5


def test_no_check_imports_what_it_checks() -> None:
    """The modules of the checks import nothing of builder, artefacts or kernels."""
    checks = Path(are_ros.checks.__file__).parent
    decoder = [checks.parent / "bag" / name for name in ("decoded.py", "marker_decoding.py")]
    files = [*checks.rglob("*.py"), *decoder]
    assert len(files) > 10
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                assert not name.startswith(
                    ("are_ros.builder", "are_ros.agents", "are_ros.population")
                ), file.name
                assert "kernel" not in name, file.name


def test_the_oracle_imports_numpy_and_scipy_only() -> None:
    """It shares no code with what it judges, nor with anything else of the package."""
    files = sorted(Path(are_ros.checks.__file__).parent.glob("oracle/*.py"))
    allowed = {"bisect", "dataclasses", "functools", "numpy", "scipy", "typing", "yaml"}
    assert len(files) >= 4
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                is_own = name.startswith("are_ros.checks.oracle")
                assert is_own or name.split(".")[0] in allowed, f"{file.name}: {name}"


def test_overlaps_are_the_builders() -> None:
    """Two boxes overlap by a positive depth exactly where the builder's test says so."""
    boxes, scene = make_boxes(60, 1)
    first, second = np.triu_indices(60, 1)
    ours = overlap_depths_m(scene, first, second) > 0.0
    theirs = overlaps(boxes.take(first), boxes.take(second))
    assert ours.any()
    assert (~ours).any()
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("text", ["", "[[0.4, 0.3], [-0.3, 0.3], [-0.4, -0.3], [0.3, -0.2]]"])
def test_penetration_is_the_builders(text: str) -> None:
    """The depth of a robot in a box is the penetration depth, and not positive where apart."""
    boxes, scene = make_boxes(200, 2)
    footprint = Footprint(np.array(ast.literal_eval(text))) if text else Footprint.disc(0.35)
    outline = Outline.of(text, 0.35)
    assert outline.inscribed_m() == pytest.approx(footprint.inscribed_radius_m, abs=1e-12)
    ours = outline.depths_m(0.3, -0.2, 0.7, scene)
    theirs = penetration_m(footprint.at(0.3, -0.2, 0.7), boxes)
    assert (theirs > 0.0).any()
    np.testing.assert_allclose(np.maximum(ours, 0.0), theirs, atol=1e-9)


def test_distances_from_a_box_are_those_of_its_samples() -> None:
    """The distance from a box is that from a dense lattice of points in it, 0 inside."""
    half, yaw, centre = np.array((0.5, 0.2, 0.3)), 0.6, np.array((1.0, 2.0, 3.0))
    shares = np.array(np.meshgrid(*[np.linspace(-1.0, 1.0, 41)] * 3)).reshape(3, -1).T
    cos, sin = math.cos(yaw), math.sin(yaw)
    inside = shares * half @ np.array(((cos, sin, 0.0), (-sin, cos, 0.0), (0.0, 0.0, 1.0))) + centre
    points = centre + np.random.default_rng(3).uniform(-1.0, 1.0, (40, 3))
    wanted = np.linalg.norm(points[:, None] - inside[None], axis=2).min(axis=1)
    found = distances_m(points, centre, yaw, half)
    np.testing.assert_allclose(found, wanted, atol=0.03)
    assert distances_m(inside, centre, yaw, half).max() < 1e-12


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_cells_are_the_builders(turn: float) -> None:
    """On a straight and on a turned map boxes cover the cells that the builder registers."""
    boxes, scene = make_boxes(80, 4)
    cells: NDArray[np.int8] = np.zeros((70, 50), np.int8)
    grid = OccupancyGrid(cells, 0.05, RigidTransform.planar(-1.2, -1.4, turn), "map")
    registered = covered_cells(boxes, grid)
    for k, cover in enumerate(Covers(RealMap.of_grid(grid)).of(scene)):
        covered = np.zeros((70, 50), np.bool_)
        patch = registered.patch(k)
        patch.part_of(covered)[:] = patch.mask
        np.testing.assert_array_equal(cover.sure, np.flatnonzero(covered))


def test_a_box_that_touches_a_cell_may_or_may_not_cover_it() -> None:
    """A box that ends on the edges of cells covers those inside, and touches those beyond."""
    grid = OccupancyGrid(np.zeros((6, 6), np.int8), 0.5, RigidTransform.identity(), "map")
    zeros = np.zeros(1, np.int64)
    place, half = np.array(((1.5, 1.5, 0.5),)), np.array(((0.5, 0.5, 0.5),))
    scene = Scene(0, 0, "map", zeros, place, np.zeros(1), half, zeros, zeros, ())
    (cover,) = Covers(RealMap.of_grid(grid)).of(scene)
    assert cover.sure.tolist() == [14, 15, 20, 21]
    assert len(cover.touched) == 12


def test_lookups_are_those_of_the_frame_tree() -> None:
    """Chains up and down, interpolated or latest, give what the builder's tree gives."""
    generator, tree, frames = np.random.default_rng(5), FrameTree(), Frames()
    edges = (("map", "odom", 90), ("odom", "base", 20), ("base", "laser", 0), ("base", "arm", 35))
    for parent, child, period in edges:
        for stamp_ns in range(0, 1000 * MS, period * MS) if period else (0,):
            place = generator.normal(size=3)
            turn = generator.normal(size=4)
            numbers = (*place, *(turn / np.linalg.norm(turn)))
            frames.add(parent, child, stamp_ns, stamp_ns, numbers, TF, is_static=not period)
            if period:
                tree.set_transform(parent, child, stamp_ns, numbers[:3], numbers[3:])
            else:
                tree.set_static(parent, child, numbers[:3], numbers[3:])
    for target, source in (("map", "laser"), ("laser", "map"), ("arm", "laser"), ("odom", "arm")):
        latest_ns = tree.latest_before(target, source, 997 * MS)
        assert frames.latest_ns(target, source, 997 * MS, KNOWN) == latest_ns
        for stamp_ns in (latest_ns, 123 * MS, 700 * MS):
            ours = frames.lookup(target, source, stamp_ns, KNOWN)
            assert ours is not None
            theirs = tree.lookup(target, source, stamp_ns).matrix()
            np.testing.assert_allclose(ours.rotation, theirs[:3, :3], atol=1e-9)
            np.testing.assert_allclose(ours.translation_m, theirs[:3, 3], atol=1e-9)
    with pytest.raises(FrameError):
        tree.lookup("map", "laser", 999 * MS)
    assert frames.lookup("map", "laser", 999 * MS, KNOWN) is None
    assert frames.lookup("map", "laser", 123 * MS, 122 * MS) is None
    assert frames.lookup("map", "nowhere", 123 * MS, KNOWN) is None
    for frame, moves_in in (("laser", "odom"), ("arm", "base"), ("map", ""), ("nowhere", "")):
        assert frames.moves_in(frame) == tree.moves_in(frame) == moves_in


def test_a_transform_that_came_late_is_known_from_then_on() -> None:
    """Before, the ones about it are interpolated; what is newer was known all the while."""
    frames = Frames()
    for stamp_ns, log_ns, x_m in ((0, 0, 0.0), (100, 100, 1.0), (50, 200, 9.0), (200, 210, 2.0)):
        numbers = (x_m, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
        frames.add("a", "b", stamp_ns, log_ns, numbers, TF, is_static=False)
    for stamp_ns, known_by_ns, x_m in (
        *((50, 150, 0.5), (50, 200, 9.0), (25, 199, 0.25), (25, 200, 4.5)),
        *((75, 199, 0.75), (75, 200, 5.0), (150, 210, 1.5), (100, 100, 1.0)),
    ):
        pose = frames.lookup("a", "b", stamp_ns, known_by_ns)
        assert pose is not None
        assert pose.translation_m[0] == pytest.approx(x_m)
    assert frames.lookup("a", "b", 150, 209) is None
    assert frames.latest_ns("a", "b", 1000, 150) == 100


def test_a_static_transform_is_what_was_said_last() -> None:
    """Before the second one came, the first holds; of what is no pose, nothing does."""
    frames, turn = Frames(), (0.0, 0.0, 0.0, 1.0)
    for at_ns, x_m in ((10, 1.0), (20, 2.0), (30, math.nan)):
        frames.add("base", "laser", 0, at_ns, (x_m, 0.0, 0.0, *turn), TF, is_static=True)
    frames.add("base", "arm", 5, 5, (0.0, 0.0, 0.0, math.nan, 0.0, 0.0, 1.0), TF, is_static=False)
    for known_ns, x_m in ((5, 1.0), (10, 1.0), (19, 1.0), (20, 2.0), (KNOWN, 2.0)):
        pose = frames.lookup("base", "laser", 100, known_ns)
        assert pose is not None
        assert pose.translation_m[0] == x_m
    assert frames.lookup("base", "arm", 5, KNOWN) is None


@pytest.mark.parametrize("is_turned", [False, True])
def test_given_transforms_hold_against_recorded_ones(is_turned: bool) -> None:
    """As in the builder's tree, also where the pair is given the other way round."""
    generator, tree, frames = np.random.default_rng(6), FrameTree(), Frames()
    x, y, z, yaw, pitch, roll = generator.uniform(-1.5, 1.5, 6).tolist()
    pair = ("laser", "base") if is_turned else ("base", "laser")
    given = RigidTransform.from_xyz_ypr(x, y, z, yaw, pitch, roll)
    place, turn = given.translation_m.tolist(), given.rotation_xyzw.tolist()
    tree.set_static(*pair, place, turn, source=TransformSource.PARAMETER)
    frames.add_given(f"{x!r} {y!r} {z!r} {yaw!r} {pitch!r} {roll!r} {pair[0]} {pair[1]}")
    for parent, child in (("base", "laser"), ("map", "base"), ("laser", "beam")):
        place = generator.normal(size=3).tolist()
        frames.add(parent, child, 0, 0, (*place, 0.0, 0.6, 0.0, 0.8), TF, is_static=True)
        tree.set_static(parent, child, place, (0.0, 0.6, 0.0, 0.8))
    for target, source in (("base", "laser"), ("map", "beam"), ("beam", "base")):
        ours = frames.lookup(target, source, 0, KNOWN)
        assert ours is not None
        theirs = tree.lookup(target, source, 0).matrix()
        np.testing.assert_allclose(ours.rotation, theirs[:3, :3], atol=1e-9)
        np.testing.assert_allclose(ours.translation_m, theirs[:3, 3], atol=1e-9)


@pytest.mark.parametrize("source", [TransformSource.ODOMETRY, TransformSource.PREFERRED_ODOMETRY])
@pytest.mark.parametrize("seed", range(8))
def test_odometry_of_a_part_moves_the_robot_as_in_the_tree(
    seed: int, source: TransformSource
) -> None:
    """A camera below the base by two static transforms, which come in any order, some later."""
    generator, tree, frames = np.random.default_rng(seed), FrameTree(), Frames()
    moving = [("odom", "camera", k * 100 * MS) for k in range(5)]
    static = [("base", "mount", -1), ("mount", "camera", -1), ("map", "odom", -1)]
    edges = [*moving[:2], *static]
    for at in (*generator.permutation(len(edges)), *range(5, 8)):
        parent, child, stamp_ns = [*edges, *moving[2:]][at]
        place, turn = generator.normal(size=3).tolist(), generator.normal(size=4)
        turn = (turn / np.linalg.norm(turn)).tolist()
        is_static, of = stamp_ns < 0, TransformSource.TF if stamp_ns < 0 else source
        frames.add(parent, child, stamp_ns, 0, (*place, *turn), of, is_static=is_static)
        if is_static:
            tree.set_static(parent, child, place, turn)
        else:
            tree.set_transform(parent, child, stamp_ns, place, turn, source=of)
    for target, part in (("map", "base"), ("base", "camera"), ("camera", "odom")):
        ours = frames.lookup(target, part, 350 * MS, KNOWN)
        assert ours is not None
        theirs = tree.lookup(target, part, 350 * MS).matrix()
        np.testing.assert_allclose(ours.rotation, theirs[:3, :3], atol=1e-9)
        np.testing.assert_allclose(ours.translation_m, theirs[:3, 3], atol=1e-9)


@pytest.mark.parametrize("first", ["odometry", "tf"])
def test_a_given_joint_is_turned_round_as_in_the_tree(first: str) -> None:
    """Odometry tells the pose of a camera that moves below the base; the inverse is given.

    A replay records what was given, too.
    """
    turn = (0.0, 0.0, math.sin(0.2), math.cos(0.2))
    tree, frames = FrameTree(), Frames()
    frames.add_given("-1.0 0.5 0.0 -0.4 0.0 0.0 camera base")
    given = RigidTransform.from_xyz_ypr(-1.0, 0.5, 0.0, -0.4, 0.0, 0.0)
    numbers = given.translation_m.tolist(), given.rotation_xyzw.tolist()
    tree.set_static("camera", "base", *numbers, source=TransformSource.PARAMETER)
    frames.add("camera", "base", 0, 0, (*numbers[0], *numbers[1]), TF, is_static=True)
    for stamp_ns in range(0, 5 * MS, MS):
        recorded = [("odom", "camera", TransformSource.ODOMETRY), ("base", "camera", TF)]
        for parent, child, source in recorded if first == "odometry" else recorded[::-1]:
            place = (0.1 * stamp_ns / MS, 2.0, 0.0)
            frames.add(parent, child, stamp_ns, 0, (*place, *turn), source, is_static=False)
            tree.set_transform(parent, child, stamp_ns, place, turn, source=TransformSource(source))
    for target, part in (("odom", "base"), ("odom", "camera")):
        ours = frames.lookup(target, part, 5 * MS // 2, KNOWN)
        assert ours is not None
        theirs = tree.lookup(target, part, 5 * MS // 2).matrix()
        np.testing.assert_allclose(ours.rotation, theirs[:3, :3], atol=1e-9)
        np.testing.assert_allclose(ours.translation_m, theirs[:3, 3], atol=1e-9)


@pytest.mark.parametrize("first", ["odometry", "tf"])
@pytest.mark.parametrize("given", ["map odom", "odom map"])
def test_a_pair_in_both_directions_is_that_of_the_tree(first: str, given: str) -> None:
    """Odometry tells odom -> body, tf body -> odom, and they differ: which holds is said once."""
    generator, tree, frames = np.random.default_rng(7), FrameTree(), Frames()
    parent, child = given.split()
    place = (1.0, 2.0, 0.0)
    tree.set_static(parent, child, place, (0.0, 0.0, 0.0, 1.0), source=TransformSource.PARAMETER)
    frames.add_given(f"1 2 0 0 0 0 {given}")
    claims = [("odom", "body", ODOMETRY), ("body", "odom", TF)]
    for k in range(6):
        for parent, child, source in claims if first == "odometry" else claims[::-1]:
            x, y, yaw = generator.normal(size=3).tolist()
            turn = (0.0, 0.0, math.sin(yaw), math.cos(yaw))
            stamp_ns = k * 100 * MS
            frames.add(parent, child, stamp_ns, 0, (x, y, 0.0, *turn), source, is_static=False)
            of = TransformSource(source)
            tree.set_transform(parent, child, stamp_ns, (x, y, 0.0), turn, source=of)
    for pair in (("map", "body"), ("body", "map")):
        for stamp_ns in (100 * MS, 230 * MS, 500 * MS):
            ours = frames.lookup(*pair, stamp_ns, KNOWN)
            assert ours is not None
            theirs = tree.lookup(*pair, stamp_ns).matrix()
            np.testing.assert_allclose(ours.rotation, theirs[:3, :3], atol=1e-9)
            np.testing.assert_allclose(ours.translation_m, theirs[:3, 3], atol=1e-9)


def test_markers_are_decoded_as_they_were_encoded() -> None:
    """Actions, keys and lifetimes come back from the bytes, whatever the lengths of the texts."""
    markers = [*DELETE_ALL.looks]
    for number, text in enumerate(("a", "bc", "def", "ghij")):
        points, colours = np.ones((3 * number, 3)), np.ones((3 * number, 4), np.float32)
        markers.append(
            MarkerLook(
                f"ns{text}",
                MarkerKind.TRIANGLE_LIST if number else MarkerKind.TEXT_VIEW_FACING,
                text="" if number else text,
                points=points,
                colours=colours,
            )
        )
    ids = [0, *range(1, 5)]
    data = MarkerEncoder().encode("map", 7, MarkerBatch.unposed(markers, ids))
    changes = [change_of(marker) for marker in decode_markers(data)]
    assert [change.fault for change in changes] == [""] * 5
    assert [change.key for change in changes] == [
        (look.namespace, number) for look, number in zip(markers, ids, strict=True)
    ]
    assert [change.action for change in changes] == [int(m.action) for m in markers]
    assert {change.lifetime_ns for change in changes} == {3000 * MS}
    assert {change.frame_id for change in changes} == {"map"}
    for cut in (data[:-20], data + bytes(8), b"\0\0" + data[2:]):
        with pytest.raises(ValueError, match=r"early|malformed|too many|little-endian|end"):
            decode_markers(cut)
