"""The judge of augmented scans: it finds what is wrong, and nothing in honest runs; real matrix."""

import importlib.util
import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.checks.oracle.plane import signed_distances_m
from are_ros.population.meshes.geometry import mesh_of
from tests.oracles import lattices, made_scans
from tests.oracles.judge_kernels import mesh_distances, mesh_hits
from tests.oracles.rays import ray_hits_m
from tests.oracles.recorded import Outputs, Scan, read_inputs, read_outputs
from tests.oracles.recordings import Changes, change_recording
from tests.oracles.scan_judge import Verdict, judge
from tests.replay.conftest import RunAre

ReplaySample = Callable[..., Path]
SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "judge_scans.py"
TOPIC = "/ar_builder/scan"
S = 1_000_000_000
AHEAD, WALLED, LEFT = 60, 0, 90
"""Beams that meet box 1 without a real return, the wall, and box 2 with one."""


def verdict_of(run: Outputs, truth: Outputs | None = None, wall_m: float = 6.0) -> Verdict:
    """Return the verdict on a made-up run."""
    return judge(
        made_scans.real_scans(),
        run,
        truth or made_scans.outputs(),
        made_scans.frames(),
        "map",
        made_scans.room(wall_m),
    )


def with_beam(beam: int, change: Callable[[float], float]) -> Outputs:
    """Return the honest run with one beam of its fourth scan changed."""
    run = made_scans.outputs()
    scans = run.scans[TOPIC]
    ranges = scans[3].ranges.copy()
    ranges[beam] = change(float(ranges[beam]))
    scans[3] = made_scans.scan(scans[3].stamp_ns, ranges)
    return run


def test_an_honest_run_passes() -> None:
    """Every beam is looked at; ends are exact, also between the ticks."""
    verdict = verdict_of(made_scans.outputs())
    assert verdict.wrong() == {}
    assert verdict.counts["beams"] == len(made_scans.STAMPS_NS) * made_scans.BEAMS
    assert verdict.counts["changed without a return"] >= 80
    assert verdict.counts["changed"] > 250
    assert np.concatenate(verdict.errors_m).max() < 1e-6


@pytest.mark.parametrize(
    ("beam", "change", "kind"),
    [
        pytest.param(AHEAD, lambda r: r + 0.008, "ghost", id="moved by 8 mm"),
        pytest.param(AHEAD, lambda _: np.inf, "missing", id="taken out"),
        pytest.param(WALLED, lambda _: 3.0, "ghost", id="where nobody is"),
        pytest.param(WALLED, lambda _: 6.9, "ghost", id="behind the wall"),
        pytest.param(LEFT, lambda r: r + 1.8, "farther", id="farther than what is real"),
        pytest.param(AHEAD, lambda r: r + 1.0, "through", id="the far side of a box"),
        pytest.param(AHEAD, lambda _: -np.inf, "too near", id="too near without anybody"),
        pytest.param(AHEAD, lambda _: np.nan, "ghost", id="made NaN"),
    ],
)
def test_a_changed_beam_is_found(beam: int, change: Callable[[float], float], kind: str) -> None:
    """One beam of nearly a thousand."""
    verdict = verdict_of(with_beam(beam, change))
    assert verdict.wrong()[kind] == 1
    assert f"beam {beam}:" in verdict.examples[kind]


def test_poses_of_50_ms_earlier_are_found() -> None:
    """At 1 m/s that is 5 cm: every beam that ends on the mover is wrong, no other."""
    run = made_scans.outputs()
    for k, stamp_ns in enumerate(made_scans.STAMPS_NS):
        old = made_scans.virtual_ranges(stamp_ns - made_scans.TICK_NS)
        run.scans[TOPIC][k] = made_scans.scan(stamp_ns, old)
    verdict = verdict_of(run)
    on_first = sum(
        np.isfinite(made_scans.returns(made_scans.near_face_m(s), -0.5, 0.5)).sum()
        for s in made_scans.STAMPS_NS
    )
    assert verdict.wrong()["ghost"] == pytest.approx(on_first, abs=2 * len(made_scans.STAMPS_NS))


def test_the_last_pose_instead_of_that_at_the_stamp_is_found() -> None:
    """A scan between two sub-steps that shows whom it was at the first of them."""
    run = made_scans.outputs()
    stamp_ns = made_scans.STAMPS_NS[1]
    old = made_scans.virtual_ranges(stamp_ns - stamp_ns % made_scans.TICK_NS)
    run.scans[TOPIC][1] = made_scans.scan(stamp_ns, old)
    assert stamp_ns % made_scans.TICK_NS == 30_000_000
    assert verdict_of(run).wrong()["ghost"] > 20


def test_a_return_behind_a_wall_is_found() -> None:
    """The boxes stand where they are said to be, but a mapped wall is before them.

    Beams with a real return behind that wall say that it is gone: they may end there.
    """
    verdict = verdict_of(made_scans.outputs(), wall_m=2.0)
    assert verdict.wrong() == {"wall": verdict.counts["changed without a return"]}
    assert verdict.counts["wall over 0.5 m"] > 0


def test_what_a_wall_hides_need_not_be_shown() -> None:
    """Without a return there is no virtual one behind a wall, and none is missed."""
    run = made_scans.outputs()
    for k, one in enumerate(run.scans[TOPIC]):
        hidden = one.ranges.copy()
        hidden[made_scans.BLIND] = np.inf
        run.scans[TOPIC][k] = made_scans.scan(one.stamp_ns, hidden)
    assert verdict_of(run, wall_m=2.0).wrong() == {}
    assert verdict_of(run, wall_m=6.0).wrong().keys() == {"missing"}


def test_an_artefact_that_no_tick_has_shown_yet_is_found() -> None:
    """It arrived before the scan, but the first tick that shows it is after."""
    run = made_scans.outputs()
    shown_ns = made_scans.STAMPS_NS[2] + 1
    for tick in run.ticks:
        if tick.stamp_ns < shown_ns:
            del tick.poses[2]
    verdict = verdict_of(run)
    assert verdict.wrong()["ghost"] == verdict.counts["ghost of one that no tick has shown yet"]
    assert verdict.wrong()["ghost"] > 30


def test_an_artefact_that_has_departed_is_found() -> None:
    """What ends on one that went before the stamp ends nowhere."""
    run, truth = made_scans.outputs(), made_scans.outputs()
    gone_ns = made_scans.STAMPS_NS[4] - 1
    for one in (run, truth):
        one.departed_ns[2] = gone_ns
        for tick in one.ticks:
            if tick.stamp_ns > gone_ns:
                del tick.poses[2]
    verdict = verdict_of(run, truth)
    assert verdict.wrong()["ghost"] == verdict.counts["ghost of one that has departed"] > 30


def test_lost_and_altered_scans_are_found() -> None:
    """A scan that did not come out, one with another header, and ticks that show other lives."""
    run = made_scans.outputs()
    del run.scans[TOPIC][2]
    run.scans[TOPIC][3].message.range_max = 30.0
    assert verdict_of(run).wrong() == {"lost scan": 1, "header": 1}
    late = made_scans.outputs(late_by_ns=1_000_000)
    assert verdict_of(late).wrong() == {"lives": len(late.ticks)}


def random_rays(count: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return an origin and unit vectors (N, 3) that mostly meet something round 0."""
    random = np.random.default_rng(5)
    origin = np.array((2.1, -1.3, 0.4))
    ways = random.normal(0.0, 0.5, (count, 3)) - origin
    return origin, ways / np.linalg.norm(ways, axis=1)[:, None]


@pytest.mark.parametrize("label", ["person_adult", "pallet_euro", "car_mobility_scooter"])
def test_the_judges_rays_are_those_of_embree(label: str) -> None:
    """On meshes of the catalogue; what differs is embree's single precision."""
    triangles = np.asarray(mesh_of(read_catalogue().rows_named(label)[0]).triangles)
    origin, ways = random_rays(4000)
    found = mesh_hits(origin, ways, triangles)
    mesh = trimesh.Trimesh(
        triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), process=False
    )
    at, rays, _ = RayMeshIntersector(mesh).intersects_location(
        np.repeat(origin[None], len(ways), axis=0), ways, multiple_hits=False
    )
    expected = np.full(len(ways), np.inf)
    expected[rays] = np.linalg.norm(at - origin, axis=1)
    same = np.isfinite(found) == np.isfinite(expected)
    assert same.mean() > 0.998
    both = np.isfinite(found) & np.isfinite(expected)
    assert both.sum() > 500
    assert np.quantile(np.abs(found[both] - expected[both]), 0.998) < 1e-4
    ends = origin + found[both][:, None] * ways[both]
    assert mesh_distances(ends, triangles).max() < 1e-9
    shifted = ends + np.array((0.0, 0.0, 10.0))
    top_m = triangles[:, :, 2].max()
    assert (mesh_distances(shifted, triangles) >= shifted[:, 2] - top_m - 1e-9).all()


def test_the_judges_boxes_are_the_same_as_triangles() -> None:
    """A box by slabs, and the same by its twelve triangles."""
    half = np.array((0.4, 0.3, 0.9))
    triangles = np.asarray(trimesh.creation.box(2.0 * half).triangles)
    origin, ways = random_rays(4000)
    by_slabs, by_triangles = (
        ray_hits_m(origin, ways, np.zeros(3), 0.0, half),
        mesh_hits(origin, ways, triangles),
    )
    met = np.isfinite(by_slabs)
    assert met.sum() > 1000
    assert np.array_equal(met, np.isfinite(by_triangles))
    assert np.abs(by_slabs[met] - by_triangles[met]).max() < 1e-9
    points = np.random.default_rng(3).uniform(-1.5, 1.5, (2000, 3))
    assert np.allclose(
        np.abs(signed_distances_m(points, np.zeros(3), 0.0, half)),
        mesh_distances(points, triangles),
    )


def test_the_first_solid_cell_is_that_of_small_steps() -> None:
    """Against a march in steps of a millimetre, on a random lattice."""
    random = np.random.default_rng(2)
    solid = random.random((30, 40, 4)) < 0.02
    lattice = lattices.Lattice(solid, np.array((-1.0, 2.0, 0.5)), np.array((0.1, 0.1, 0.2)))
    origins = np.array((0.3, 3.0, 0.9)) + random.uniform(-0.3, 0.3, (400, 3))
    ways = random.normal(size=(400, 3)) * (1.0, 1.0, 0.05)
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    found = lattice.first_solid(origins, ways, np.full(400, 3.0))
    for origin, way, far in zip(origins, ways, found, strict=True):
        steps = np.arange(0.0, 3.0, 1e-3)
        cells = np.floor((origin + steps[:, None] * way - lattice.corner) / lattice.size)
        inside = ((cells >= 0) & (cells < solid.shape)).all(axis=1)
        cells = np.where(inside[:, None], cells, 0).astype(int)
        own = (cells == cells[0]).all(axis=1)
        met = np.flatnonzero(inside & ~own & solid[tuple(cells.T)])
        marched = steps[met[0]] if len(met) else np.inf
        if np.isfinite(marched):  # a march may jump over a corner, so it is never the shorter
            assert far <= marched + 1e-9
        if np.isfinite(far):
            at = origin + (far + 1e-7) * way
            cell = np.floor((at - lattice.corner) / lattice.size).astype(int)
            assert solid[tuple(cell)]


def test_the_judge_reads_octomaps(real_data: Path) -> None:
    """As many voxels as its source says."""
    lattice = lattices.of_octomap_file(real_data / "octomap-geb079" / "geb079.bt")
    assert lattice.solid.sum() == 185673
    assert lattice.size == pytest.approx(0.08)


def log_and_stamps(scans: list[Scan]) -> npt.NDArray[np.int64]:
    """Return log times and stamps (N, 2) [ns]."""
    return np.array([(one.log_ns, one.stamp_ns) for one in scans])


def test_recordings_are_changed_as_asked(sample_bag: Path, tmp_path: Path) -> None:
    """Stamps by the shift, scans by their delay, a third of the beams, a gap; the rest is kept."""
    changes = Changes(
        shift_s=-7.6, late_s=0.25, jitter_s=0.05, infinite=0.3, gaps=((10.0, 100.0),), seed=1
    )
    old = read_inputs(sample_bag)
    new = read_inputs(change_recording(sample_bag, tmp_path / "changed", changes))
    before, after = log_and_stamps(old.scans["/scan"]), log_and_stamps(new.scans["/scan"])
    assert len(before) == len(after)
    moved = after - before
    gap_ns = np.where(moved[:, 1] > 50 * S, 100 * S, 0)
    assert set((moved[:, 1] - gap_ns).tolist()) == {-7_600_000_000}
    assert (moved[:, 0] - gap_ns).min() >= 0.25 * S
    assert (moved[:, 0] - gap_ns).max() <= 0.35 * S
    assert 90 < (gap_ns == 0).sum() < 110
    lost = np.mean([np.isinf(one.ranges).mean() for one in new.scans["/scan"]])
    assert 0.2 < lost < 0.3
    kept = [
        np.array_equal(b.ranges[np.isfinite(b.ranges)], a.ranges[np.isfinite(b.ranges)])
        for a, b in zip(old.scans["/scan"], new.scans["/scan"], strict=True)
    ]
    assert all(kept)
    stamp_ns = old.scans["/scan"][30].stamp_ns
    there = old.frames.lookup("map", "base_scan", stamp_ns)
    shifted = new.frames.lookup("map", "base_scan", stamp_ns - 7_600_000_000)
    assert there is not None
    assert shifted is not None
    assert np.allclose(there[1], shifted[1])
    assert np.allclose(there[0], shifted[0])


@pytest.mark.parametrize("shape", ["box", "mesh"])
def test_the_sample_passes_the_judge(
    replay_sample: ReplaySample, sample_bag: Path, shape: str
) -> None:
    """Eight seconds of the sample at 10 Hz: every beam is as it should be."""
    run = replay_sample("--with-inputs", "--set", f"sensors.shape:={shape}")
    skipped = ("--skip", "perception", "--skip", "grids", "--skip", "markers")
    truth = replay_sample("--set", "builder.tick_rate:=20", *skipped)
    inputs = read_inputs(sample_bag)
    rows = read_catalogue().rows
    triangles = {row.index: np.asarray(mesh_of(row).triangles) for row in rows}
    verdict = judge(
        inputs.scans["/scan"],
        read_outputs(run / "augmented.mcap"),
        read_outputs(truth / "augmented.mcap"),
        inputs.frames,
        "map",
        lattices.of_cloud(inputs.cloud),
        triangles if shape == "mesh" else None,
    )
    assert verdict.counts["scans"] >= 78
    assert verdict.counts["changed"] > 400
    assert verdict.counts["poses of ticks"] > 100
    assert verdict.wrong() == {}, verdict.examples


@pytest.fixture(scope="module")
def matrix() -> ModuleType:
    """Return the script of the matrix as a module."""
    spec = importlib.util.spec_from_file_location("judge_scans", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_matrix_has_every_recording_rate_and_shape(matrix: ModuleType) -> None:
    """Of the recordings as they are every rate and shape, of each variant two."""
    runs = list(matrix.matrix(15.0))
    assert len({run.key for run in runs}) == len(runs)
    for case in matrix.CASES:
        own = [run for run in runs if run.case is case]
        whole = {(run.rate_hz, run.shape) for run in own if run.variant == matrix.WHOLE}
        assert whole == {(rate, shape) for rate in (5, 10, 20) for shape in ("box", "mesh")}
        if case.scan:
            assert {run.variant for run in own} == set(matrix.VARIANTS)


CHANGES = {"as-is", "shift+7.6", "late400", "gap"}


@pytest.mark.long
@pytest.mark.parametrize("name", ["tb3", "jarvis-circle-low", "jarvis-inverted-low", "ship-base"])
def test_real_recordings_pass_the_judge(
    matrix: ModuleType,
    real_data: Path,
    run_are: RunAre,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
) -> None:
    """Real recordings, shifted, late, with a gap: `are check` and the judge find nothing.

    `python scripts/judge_scans.py` does the whole matrix, in processes of their own.
    """

    def are(*words: str) -> tuple[int, str]:
        done = run_are(*words)
        return done.returncode, done.stdout + done.stderr

    bench = matrix.Bench(matrix.ROOT, real_data, tmp_path / "work", 1, [])
    bench.are = are
    runs = [run for run in matrix.matrix(10.0) if run.case.name == name]
    runs = sorted((run for run in runs if run.variant in CHANGES), key=lambda run: run.variant)
    lines: list[dict[str, Any]] = [bench.done(run) for run in runs]
    with capsys.disabled():
        matrix.report(lines)
    wrong = [json.dumps(line, indent=1) for line in lines if matrix.is_wrong(line)]
    assert len(lines) == 12
    assert sum(line["counts"]["beams"] for line in lines) > 300_000
    assert not wrong, "\n".join(wrong)
