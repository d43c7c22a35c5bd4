"""`are export --mesh` from a replay's recording to its files."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import trimesh

from are_ros.errors import BagError
from are_ros.export.command import export_mesh, export_sets, moment_at
from tests.conftest import full_disk
from tests.oracles.lattices import of_cloud
from tests.oracles.rays import ray_chords_m
from tests.oracles.recorded import read_inputs, read_outputs
from tests.replay.conftest import ReplaySample, RunAre

UPRIGHT = np.array(((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)))


@pytest.mark.parametrize("at_s", [0.0, 3.25, None])
def test_the_file_has_the_artefacts_of_the_tick_where_they_were(
    run_are: RunAre, sample_replay: Path, tmp_path: Path, at_s: float | None
) -> None:
    """Each node fills the box that the recording has for its artefact."""
    path = tmp_path / "scene.glb"
    words = () if at_s is None else ("--at", at_s)
    done = run_are("export", sample_replay, "--mesh", path, *words)
    assert done.returncode == 0, done.stderr
    assert f"mesh: {path} (" in done.stderr
    outputs = read_outputs(sample_replay / "augmented.mcap")
    tick = outputs.ticks[{0.0: 0, 3.25: 32, None: -1}[at_s]]
    scene = trimesh.load(path, process=False)
    nodes = {*scene.graph.nodes_geometry} - {"environment", "floor"}
    assert nodes == {f"{outputs.kinds[i].label} {i}" for i in tick.poses}
    assert len(nodes) > (-1 if at_s == 0.0 else 1)
    for number, (x, y, z, yaw) in tick.poses.items():
        state = outputs.kinds[number]
        world_from_node, shape = scene.graph[f"{state.label} {number}"]
        points = trimesh.transform_points(scene.geometry[shape].vertices, world_from_node)
        offset = points @ UPRIGHT.T - (x, y, z)
        cos, sin = math.cos(yaw), math.sin(yaw)
        turned = (
            cos * offset[:, 0] + sin * offset[:, 1],
            cos * offset[:, 1] - sin * offset[:, 0],
            offset[:, 2],
        )
        low, high = np.min(turned, axis=1), np.max(turned, axis=1)
        centre, half = box_of(state)
        assert (*low, *high) == pytest.approx((*(centre - half), *(centre + half)), abs=2e-3)


@pytest.mark.parametrize(
    ("stamps_ns", "at_s", "chosen_ns"),
    [
        ((10**9, 11 * 10**8, 12 * 10**8, 12 * 10**8 + 7), None, 12 * 10**8),
        ((10**9, 11 * 10**8, 12 * 10**8, 12 * 10**8 + 7), 0.2, 12 * 10**8),
        ((10**9, 11 * 10**8), None, 11 * 10**8),
        ((10**9 + 3, 11 * 10**8 + 3), None, 11 * 10**8 + 3),  # of another tick rate
    ],
)
def test_what_a_node_sends_at_its_end_is_no_tick(
    stamps_ns: tuple[int, ...], at_s: float | None, chosen_ns: int
) -> None:
    """It has removed all artefacts, and the mesh would be empty."""
    series = SimpleNamespace(stamps_ns=np.array(stamps_ns))
    record: Any = SimpleNamespace(series=series)
    record.moment = lambda stamp_ns: SimpleNamespace(stamp_ns=stamp_ns)
    assert moment_at(record, at_s, 10.0).stamp_ns == chosen_ns


def box_of(state: Any) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the centre of an artefact's box in F_A, and half its size."""
    centre, size = state.box_centre, state.size
    return np.array((centre.x, centre.y, centre.z)), 0.5 * np.array((size.x, size.y, size.z))


def test_rays_hit_the_walls_and_artefacts_of_the_recording(
    run_are: RunAre, sample_replay: Path, tmp_path: Path
) -> None:
    """From above one of them, against a walk over the recorded voxels and the boxes."""
    path = tmp_path / "scene.ply"
    assert run_are("export", sample_replay, "--mesh", path, "--at", 5).returncode == 0
    mesh = trimesh.load(path, process=False)
    lattice = of_cloud(read_inputs(sample_replay / "augmented.mcap").cloud)
    outputs = read_outputs(sample_replay / "augmented.mcap")
    (tick,) = (t for t in outputs.ticks if t.stamp_ns == outputs.ticks[0].stamp_ns + 5 * 10**9)
    bodies, rng = np.array([pose[:3] for pose in tick.poses.values()]), np.random.default_rng(2)
    start = np.array((bodies[0, 0] + 0.31, bodies[0, 1] + 0.17, 2.23))
    at_bodies = bodies[rng.integers(len(bodies), size=2000)] - start
    ways = np.concatenate((rng.normal(size=(2000, 3)), at_bodies + rng.normal(0, 0.2, (2000, 3))))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    starts = np.tile(start, (len(ways), 1))
    points, rays, _ = mesh.ray.intersects_location(starts, ways, multiple_hits=False)
    found = np.full(len(ways), np.inf)
    found[rays] = np.linalg.norm(points - start, axis=1)
    walls = lattice.first_solid(starts, ways, np.full(len(ways), 100.0))
    is_wall = np.isclose(found, walls, atol=1e-3)
    is_body = np.zeros(len(ways), dtype=bool)
    for number, (x, y, z, yaw) in tick.poses.items():
        (ahead, aside, above), half = box_of(outputs.kinds[number])
        cos, sin = math.cos(yaw), math.sin(yaw)
        centre = np.array((x + cos * ahead - sin * aside, y + sin * ahead + cos * aside, z + above))
        enter, leave = ray_chords_m(start, ways, centre, yaw, half)
        is_body |= (found >= enter - 1e-3) & (found <= leave + 1e-3) & (enter <= leave)
    assert is_wall.sum() > 2000
    assert (is_body & ~is_wall).sum() > 200
    assert (is_wall | (is_body & (found < walls))).mean() > 0.998


def test_walls_of_the_map_stand_in_for_an_octomap_that_was_not_recorded(
    run_are: RunAre, replay_sample: ReplaySample, tmp_path: Path
) -> None:
    """It is said; --octomap gives them, in any format that a replay takes."""
    bare, path = replay_sample(), tmp_path / "scene.ply"
    done = run_are("export", bare, "--mesh", path)
    assert done.returncode == 0
    assert "the walls of the map stand in for the octomap of the run" in done.stderr
    assert trimesh.load(path).bounds[1, 2] == pytest.approx(2.5)
    octomap = tmp_path / "cube.pcd"
    rows = "".join(
        f"{x} {y} {z}\n" for x in (4.05, 4.15) for y in (5.05, 5.15) for z in (3.05, 3.15)
    )
    octomap.write_text(f"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 8\nDATA ascii\n{rows}")
    done = run_are("export", bare, "--mesh", path, "--octomap", octomap)
    assert "an environment of 12 triangles" in done.stderr
    assert "stand in" not in done.stderr
    assert trimesh.load(path).bounds[1, 2] == pytest.approx(3.2)


@pytest.mark.parametrize(
    ("words", "status", "reason"),
    [
        ((), 2, "Nothing to write: give --mesh FILE.glb, --tracks, --kitti or --coco"),
        (("--mesh", "scene.obj"), 1, "--mesh scene.obj: its name must end in .glb or .ply"),
        (("--mesh", "a.glb", "--at", "99"), 1, "--at 99: the last tick of the recording is at 7.9"),
        (("--mesh", "a.glb", "--at", "-1"), 2, "-1 is less than 0"),
        (("--tracks", "t", "--at", "3"), 2, "--at is for --mesh alone, which is not given"),
        (("--tracks", "t", "--octomap", "a.bt"), 2, "--octomap is for --mesh alone"),
        (("--coco", "c", "--cloud", "/a"), 2, "--cloud is for --kitti alone"),
        (("--kitti", "k", "--image", "/a"), 2, "--image is for --coco alone"),
        (("--mesh", "no/a.glb"), 1, "no/a.glb: the file cannot be written (no such file"),
        (("--mesh", "a.glb", "--octomap", "none.ot"), 1, "none.ot: the file cannot be read"),
        (("--tracks", "a", "--kitti", "a"), 1, "--kitti a: --tracks writes into a; give each"),
        (("--tracks", "a", "--coco", "a/b"), 1, "--coco a/b: --tracks writes into a; give each"),
        (("--tracks", "a/b", "--coco", "a"), 1, "--tracks a/b: --coco writes into a; give each"),
        (("--kitti", "a/b/c"), 1, "has no augmented cloud"),
    ],
)
def test_what_makes_no_sense_is_refused(
    run_are: RunAre,
    sample_replay: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    status: int,
    reason: str,
) -> None:
    """In one sentence, and nothing is written."""
    monkeypatch.chdir(tmp_path)
    done = run_are("export", sample_replay, *words)
    assert done.returncode == status
    assert reason in done.stderr
    assert not [*tmp_path.iterdir()]


def test_on_a_full_disk_no_part_of_an_export_is_left(sample_replay: Path, tmp_path: Path) -> None:
    """Half a table looks like a whole one."""
    folder = tmp_path / "tracks"
    with full_disk(), pytest.raises(BagError, match="file too large"):
        export_sets(print, sample_replay, {"tracks": folder}, "", "")
    mesh = print, sample_replay, tmp_path / "scene.glb", None, None
    export_mesh(*mesh)
    with full_disk(), pytest.raises(BagError, match="file too large"):
        export_mesh(*mesh)
    assert not [*tmp_path.iterdir()]


def test_an_empty_folder_that_was_there_stays(run_are: RunAre, sample_replay: Path) -> None:
    """Also where the set cannot be written: it is the user's."""
    folder = sample_replay.parent / "empty"
    folder.mkdir()
    done = run_are("export", sample_replay, "--coco", folder)
    assert done.returncode == 1
    assert not [*folder.iterdir()]
    folder.rmdir()


def test_a_recording_without_artefacts_is_refused(run_are: RunAre, sample_bag: Path) -> None:
    """The inputs alone have no scene."""
    done = run_are("export", sample_bag, "--mesh", "a.glb")
    assert done.returncode == 1
    assert "it holds no /ar_builder/artefacts" in done.stderr
