"""The augmented costmap against a full exact distance transform, measured side by side.

200 artefacts (180 people, 20 cars) are all moved at once on a map of 4000 x 4000 cells of 0.05 m,
inflation 0.55 m. The peer is OpenCV's exact Euclidean distance transform of the whole map, alone
and with the costs looked up from it. Run: python benchmarks/costmap.py [repetitions]
"""

import argparse
import functools
import time
from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt

from are_ros.builder.costmap.augmented_map import AugmentedMap
from are_ros.builder.costmap.inflation import InflatedCostmap, inflation_costs
from are_ros.builder.costmap.registration import CellPatch, patch_changes

Mask = npt.NDArray[np.bool_]
Costs = npt.NDArray[np.uint8]

RESOLUTION_M = 0.05
INFLATION_M, SCALING, INSCRIBED_M = 0.55, 10.0, 0.22
SIDE_CELLS, ARTEFACTS = 4000, 200
PEER, PEER_ALONE = "OpenCV exact EDT", "OpenCV exact EDT, 1 thread"
PEER_WITH_COSTS = "OpenCV exact EDT, costs looked up"


def walls(generator: np.random.Generator) -> Mask:
    """Return rooms of 20 m with doors of 2 m, and some clutter."""
    occupied: Mask = generator.random((SIDE_CELLS, SIDE_CELLS)) < 2e-4
    occupied[::400] = occupied[:, ::400] = True
    for door in range(0, SIDE_CELLS, 400):
        occupied[::400, door + 180 : door + 220] = False
        occupied[door + 180 : door + 220, ::400] = False
    return occupied


def crowd(generator: np.random.Generator) -> dict[int, CellPatch]:
    """Return artefacts somewhere on the map, each with a ragged mask of its own."""
    patches = {}
    for artefact_id in range(ARTEFACTS):
        size = (36, 90) if artefact_id % 10 == 0 else (10, 8 + artefact_id % 5)
        row0, col0 = generator.integers(0, SIDE_CELLS - 100, 2).tolist()
        patches[artefact_id] = CellPatch.of(row0, col0, generator.random(size) < 0.9)
    return patches


def milliseconds(action: Callable[[], object]) -> float:
    """Return how long one call takes [ms]."""
    start = time.perf_counter()
    action()
    return 1e3 * (time.perf_counter() - start)


def full_transform(occupied: Mask, patches: dict[int, CellPatch]) -> npt.NDArray[np.float32]:
    """Return OpenCV's exact distances [cells] over the map with the artefacts in it."""
    free = np.logical_not(occupied).view(np.uint8)
    for patch in patches.values():
        rows, cols = patch.mask.shape
        window = free[patch.row0 : patch.row0 + rows, patch.col0 : patch.col0 + cols]
        window[patch.mask] = 0
    return np.asarray(cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE), np.float32)


def full_costs(occupied: Mask, patches: dict[int, CellPatch]) -> Costs:
    """Return the peer's costs: squared distances in cells, through a table."""
    reach = int(INFLATION_M / RESOLUTION_M + 1e-9) + 1
    distances_m = np.sqrt(np.arange(reach**2 + 1)) * RESOLUTION_M
    table = inflation_costs(distances_m, SCALING, INSCRIBED_M)
    table[distances_m > INFLATION_M + 1e-9] = 0
    distances = full_transform(occupied, patches)
    np.minimum(distances, reach, out=distances)
    costs: Costs = table[(distances * distances + 0.5).astype(np.int32)]
    return costs


def on_one_thread(action: Callable[[], object]) -> None:
    """Call with OpenCV kept to one thread."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    action()
    cv2.setNumThreads(threads)


def car_milliseconds() -> float:
    """Return the median time of the first patch of a 4.5 x 1.8 m car, inflation 0.70 m [ms]."""
    floor = np.zeros((900, 900), np.bool_)
    times = []
    for _ in range(9):
        costmap = InflatedCostmap(0.70, 3.0, INSCRIBED_M)
        costmap.set_map(floor, floor, 0.01)
        car = {1: CellPatch.of(200, 200, np.ones((450, 180), np.bool_))}
        times.append(milliseconds(functools.partial(costmap.update, patch_changes({}, car))))
    return float(np.median(times))


def measured(repetitions: int) -> tuple[dict[str, float], int]:
    """Return medians [ms] of interleaved runs, and the greatest difference from the peer's costs.

    The first round, which compiles, is left out.
    """
    generator = np.random.default_rng(7)
    occupied = walls(generator)
    unknown = np.zeros_like(occupied)
    costmap = InflatedCostmap(INFLATION_M, SCALING, INSCRIBED_M)
    costmap.set_map(occupied, unknown, RESOLUTION_M)
    augmented = AugmentedMap(np.where(occupied, 100, 0).astype(np.int8))
    before: dict[int, CellPatch] = {}
    times: dict[str, list[float]] = {}
    difference = 0
    for _ in range(repetitions + 1):
        patches = crowd(generator)
        moved, standing = patch_changes(before, patches), patch_changes(patches, dict(patches))
        before = patches
        actions: dict[str, Callable[[], object]] = {
            "200 patches compared": functools.partial(patch_changes, before, dict(patches)),
            "costmap, 200 moved": functools.partial(costmap.update, moved),
            "costmap, 200 standing": functools.partial(costmap.update, standing),
            "augmented map, 200 moved": functools.partial(augmented.update, moved),
            "augmented map, 200 standing": functools.partial(augmented.update, standing),
            PEER: functools.partial(full_transform, occupied, patches),
            PEER_ALONE: functools.partial(
                on_one_thread, functools.partial(full_transform, occupied, patches)
            ),
            PEER_WITH_COSTS: functools.partial(full_costs, occupied, patches),
        }
        for name, action in actions.items():
            times.setdefault(name, []).append(milliseconds(action))
        apart = full_costs(occupied, patches).astype(np.int16) - costmap.costs
        difference = max(difference, int(np.abs(apart).max()))
    new_map = functools.partial(costmap.set_map, occupied, unknown, RESOLUTION_M)
    times["costmap, new map"] = [milliseconds(new_map) for _ in range(4)]
    return {name: float(np.median(values[1:])) for name, values in times.items()}, difference


def main(repetitions: int) -> None:
    """Print medians and ratios of one run."""
    medians, difference = measured(repetitions)
    print(f"OpenCV {cv2.__version__}, {cv2.getNumThreads()} threads; this: 1 thread")
    print(f"{'':36s} {'ms':>9s}   EDT/this  1 thread  with costs")
    for name, median in medians.items():
        ratios = [medians[peer] / median for peer in (PEER, PEER_ALONE, PEER_WITH_COSTS)]
        print(f"{name:36s} {median:9.3f}" + "".join(f" {ratio:9.1f}" for ratio in ratios))
    print(f"greatest difference of costs over {repetitions + 1} x 16 M cells: {difference}")
    print(f"car on a 0.01 m grid, its first patch: {car_milliseconds():.2f} ms")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("repetitions", nargs="?", type=int, default=9)
    main(parser.parse_args().repetitions)
