"""Which boxes overlap: the spatial hash against a k-d tree with numpy; and a whole sub-step.

Boxes of 0.4 to 1.0 m at the density of a crowd. The peer finds near centres with SciPy's cKDTree
and tests the separating axes in numpy; both give the same pairs. Run:
python benchmarks/collisions.py [repetitions]
"""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from are_ros.agents.collisions import CollisionResolver, Displace
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.footprint import Footprint
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.world.overlapping import overlapping_pairs


def crowd(count: int, generator: np.random.Generator) -> OrientedBoxes:
    """Return boxes on the ground, one per 2.25 m^2."""
    points_m = generator.uniform(0.0, 1.5 * np.sqrt(count), (count, 2)) + 5.0
    halves_m = np.column_stack((generator.uniform(0.2, 0.5, (count, 2)), np.full(count, 0.9)))
    centres_m = np.column_stack((points_m, np.full(count, 0.9)))
    return OrientedBoxes(centres_m, generator.uniform(-3.0, 3.0, count), halves_m)


def peer_pairs(boxes: OrientedBoxes) -> npt.NDArray[np.int64]:
    """Return the overlapping pairs by cKDTree and numpy."""
    reach_m = 2.0 * float(np.hypot(*boxes.half_sizes_m[:, :2].T).max())
    pairs = cKDTree(boxes.centres_m[:, :2]).query_pairs(reach_m, output_type="ndarray")
    corners = boxes.footprints()
    first, second = corners[pairs[:, 0]], corners[pairs[:, 1]]
    overlap = np.ones(len(pairs), dtype=np.bool_)
    for polygon in (first, second):
        for k in (0, 1):
            edge = polygon[:, k + 1] - polygon[:, k]
            axis = (edge / np.linalg.norm(edge, axis=1, keepdims=True))[:, :, None]
            a, b = (first @ axis)[..., 0], (second @ axis)[..., 0]
            depth = np.minimum(a.max(1), b.max(1)) - np.maximum(a.min(1), b.min(1))
            overlap &= depth > 1e-9
    found = pairs[overlap]
    ordered: npt.NDArray[np.int64] = found[np.lexsort((found[:, 1], found[:, 0]))]
    return ordered


def sub_step(boxes: OrientedBoxes, generator: np.random.Generator) -> Callable[[], object]:
    """Return one resolution of a crowd without overlaps in which all have moved by 5 cm."""
    side = int(10 * (1.5 * np.sqrt(len(boxes)) + 10.0))
    grid = OccupancyGrid(
        np.zeros((side, side), dtype=np.int8), 0.1, RigidTransform.identity(), "map"
    )
    environment = Environment(grid, classify(grid, 65, 25), None, PlaneGround(0.0), 0.06)
    resolver, robot = CollisionResolver(Displace(), 2.0), Footprint.disc(0.22).at(5.0, 5.0, 0.0)
    ids = np.arange(len(boxes))
    settled = resolver.resolve(ids, boxes, boxes, environment, robot)
    stays = settled.outcomes <= 2
    start, ids = settled.boxes.take(stays), ids[stays]
    moves_m = np.pad(generator.normal(0.0, 0.05, (len(ids), 2)), ((0, 0), (0, 1)))
    moved = OrientedBoxes(start.centres_m + moves_m, start.yaws_rad, start.half_sizes_m)
    return lambda: resolver.resolve(ids, moved, start, environment, robot)


def milliseconds(action: Callable[[], object]) -> float:
    """Return how long one call takes [ms]."""
    start = time.perf_counter()
    action()
    return 1e3 * (time.perf_counter() - start)


def main(repetitions: int) -> None:
    """Print medians of interleaved runs."""
    generator = np.random.default_rng(0)
    print(
        "boxes  pairs  cKDTree+numpy [ms]  overlapping_pairs [ms]  ratio  sub-step, all move [ms]"
    )
    for count in (100, 1_000, 10_000):
        boxes = crowd(count, generator)
        pairs = overlapping_pairs(boxes)
        if not np.array_equal(pairs, peer_pairs(boxes)):
            raise SystemExit("the pairs differ")
        step = sub_step(boxes, generator)
        step()
        actions = (lambda: peer_pairs(boxes), lambda: overlapping_pairs(boxes), step)  # noqa: B023
        runs = [[milliseconds(action) for action in actions] for _ in range(repetitions)]
        peer, ours, resolved = np.median(runs, axis=0)
        row = f"{count:5d} {len(pairs):6d} {peer:19.3f} {ours:23.3f} {peer / ours:6.1f}"
        print(f"{row} {resolved:24.3f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("repetitions", nargs="?", type=int, default=21)
    main(parser.parse_args().repetitions)
