"""The octomap computed anew: a right one passes, and what is missing or too much is found."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from are_ros.bag.decoded import Scene
from are_ros.checks.oracle.solids import Cloud
from are_ros.checks.record import Record
from are_ros.checks.result import CheckResult, Outcome
from are_ros.checks.sensors.octomap import check_octomap, met_voxels
from are_ros.checks.sensors.scans import KnownWalls
from are_ros.conventions import NS_PER_S
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters

Points = NDArray[np.float64]
SIZE_M = 0.1
NOW_NS = 20 * NS_PER_S
SIDE = (np.arange(10) + 0.5) * SIZE_M
FLOOR = np.array([(x, y, -0.05) for x in SIDE for y in SIDE])
BOX = np.array([(x, y, z) for x in SIDE[3:7] for y in SIDE[4:6] for z in SIDE[:2]])
"""A box 0.3 m long in x and 0.2 m wide and high, half a voxel off: all its voxels have a face."""


def judged(points_m: Points, values: dict[str, Any] | None = None) -> CheckResult:
    """Check an octomap that came out, over a floor on which that box stands."""
    usual = {"costmap.gate": "all", "sensors.shape": "box", "world.voxel_size": SIZE_M}
    record = Record(with_values(Parameters(), usual | (values or {})), walls="octomap")
    record.clouds.append(Cloud(FLOOR, "map", 0))
    centre, half = np.array([(0.5, 0.5, 0.1)]), np.array([(0.15, 0.1, 0.1)])
    one, arrivals = np.array([7]), np.array([0])
    scene = Scene(NOW_NS, NOW_NS, "map", one, centre, np.zeros(1), half, arrivals, arrivals)
    record.scenes.append(replace(scene, box_centres_m=np.zeros((1, 3))))
    record.octomaps.add(Cloud(points_m, "map", NOW_NS))
    return check_octomap(record)


def test_a_right_octomap_passes() -> None:
    """Voxels that are only touched may be there or not."""
    result = judged(np.concatenate((FLOOR, BOX)))
    assert result.outcome is Outcome.PASSED, result.sentence()
    assert result.looked_at >= 116


BROKEN: dict[str, tuple[Callable[[], Points], str]] = {
    "a voxel too few": (lambda: np.concatenate((FLOOR, BOX[1:])), "lacks 1"),
    "a real one too few": (lambda: np.concatenate((FLOOR[1:], BOX)), "lacks 1"),
    "one too many": (
        lambda: np.concatenate((FLOOR, BOX, [(0.05, 0.05, 0.95)])),
        "1 voxels that nothing",
    ),
    "one twice": (lambda: np.concatenate((FLOOR, BOX, BOX[:1])), "twice"),
    "aside": (lambda: np.concatenate((FLOOR, BOX + 0.02)), "no centre"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_is_broken_is_found(case: str) -> None:
    """And said in a sentence."""
    make, said = BROKEN[case]
    result = judged(make())
    assert result.outcome is Outcome.FAILED
    assert said in result.sentence()


def test_what_cannot_be_known_is_skipped() -> None:
    """Where detected artefacts stand elsewhere, and where markers show no meshes."""
    certain = judged(FLOOR, {"certainty.enabled": True, "costmap.gate": "perceived"})
    assert certain.outcome is Outcome.SKIPPED
    assert "markers that are meshes" in judged(FLOOR, {"sensors.shape": "mesh"}).sentence()


def test_why_walls_are_not_known_is_said() -> None:
    """An octomap that changes is in the recording; one in another frame is told by the frame."""
    one, other = Cloud(FLOOR, "map", 0), Cloud(FLOOR[1:], "map", NS_PER_S)
    leaves = np.array([(0.05, 0.05, 0.05), (0.15, 0.15, 0.15), (0.3, 0.3, 0.3)])
    for clouds, said in (
        ([], "that is not in the recording"),
        ([one, other], "the octomap changed: there are 2 in the recording"),
        ([Cloud(FLOOR, "odom", 0)], "in the frame 'odom', not the map's"),
        ([Cloud(leaves, "map", 0)], "no lattice of voxels of one size"),
        ([one], ""),
    ):
        record = Record(with_values(Parameters(), {}), walls="octomap", clouds=clouds)
        doubt = KnownWalls(record).doubt
        assert said in doubt if said else not doubt


def test_voxels_of_a_triangle_are_those_of_its_points() -> None:
    """Points strewn over triangles lie in voxels that they meet, and nearly all are found so."""
    random = np.random.default_rng(5)
    triangles = random.uniform(0.0, 4.0, (30, 3, 3))
    weights = random.dirichlet((1.0, 1.0, 1.0), 200_000)
    for triangle in triangles:
        x, y, z = np.floor(weights @ triangle).astype(int).T
        voxels = np.argwhere(np.bincount(16 * x + 4 * y + z, minlength=64).reshape(4, 4, 4))
        points = {*map(tuple, voxels.tolist())}
        met = met_voxels(triangle[None], 0.0)
        assert points <= met
        assert len(met) <= 1.1 * len(points) + 3
        assert met_voxels(triangle[None], -0.01) <= met <= met_voxels(triangle[None], 0.01)
