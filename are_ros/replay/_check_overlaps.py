"""No artefact overlaps a wall or another one at any tick."""

from collections.abc import Iterator
from math import isnan

import numpy as np

from are_ros.checks.oracle import overlapping
from are_ros.checks.oracle_solids import SURE, Cover, Covers, RealMap, are_same, layer
from are_ros.parameters.model import Parameters
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Tally, at_s, skipped
from are_ros.replay._check_scene import Scene
from are_ros.wording import counted


def covers_by_tick(record: Record) -> Iterator[tuple[Scene, RealMap | None, list[Cover]]]:
    """Yield each scene with the real map that it knew, and its boxes' cells there."""
    covers: Covers | None = None
    for scene in record.scenes:
        real = record.real_map_at(scene.stamp_ns)
        if real is None:
            yield scene, None, []
            continue
        if covers is None or covers.real is not real:
            covers = Covers(real)
        yield scene, real, covers.of(scene)


def check_walls(record: Record) -> CheckResult:
    """No box covers an occupied cell of the map (voxels of a cloud are not looked at)."""
    tally = Tally("walls", "box")
    if record.parameters is None:
        return skipped(tally.name, "there is no effective.yaml, which says what is occupied")
    if not record.maps:
        return skipped(tally.name, record.why_no_map(), needs_inputs=record.lacks_inputs)
    threshold = record.parameters.world.occupied_threshold
    for scene, real, covers in covers_by_tick(record):
        if real is None:
            tally.leave_out("tick", "without a map")
            continue
        values = real.cells.reshape(-1)
        for i, cover in enumerate(covers):
            tally.look()
            hit = cover.sure[values[cover.sure] >= threshold]
            if hit.size:
                row, col = divmod(int(hit[0]), real.cells.shape[1])
                cell = f"the occupied cell ({row}, {col})"
                tally.fail(f"{at_s(scene.stamp_ns)} id {scene.ids[i]} covers {cell}")
    return tally.result()


def check_clutter(record: Record) -> CheckResult:
    """Compare the clutter ratio with the share of free cells that all artefacts cover."""
    tally = Tally("clutter ratio", "tick")
    if record.parameters is None:
        return skipped(tally.name, "there is no effective.yaml, which says what is free")
    if not record.maps:
        return skipped(tally.name, record.why_no_map(), needs_inputs=record.lacks_inputs)
    metrics = dict(record.metrics)
    last_real: RealMap | None = None
    last_covers: list[Cover] = []
    free = least = most = 0
    is_known = False
    for scene, real, covers in covers_by_tick(record):
        if real is None or scene.log_ns not in metrics:
            tally.leave_out("tick", "without a map" if real is None else "without metrics")
            continue
        if real is not last_real:
            free = _free_count(real, record.parameters)
        if real is not last_real or not are_same(covers, last_covers):
            least, most = _counts(covers, real)
        last_real, last_covers = real, covers
        found = float(metrics[scene.log_ns].clutter_ratio)
        if isnan(found) and real.since_ns == scene.stamp_ns:
            continue  # the map of that very time may have come after the tick
        is_known = is_known or not isnan(found)
        if record.is_live and not is_known:
            tally.leave_out("tick", "before the node knew a map")
            continue
        tally.look()
        if free and not least / free - 1e-12 <= found <= most / free + 1e-12:
            wanted = f"{least / free:.9g}, {least} of {counted(free, 'free cell')}"
            tally.fail(f"{at_s(scene.stamp_ns)} it is {found:.9g}, not {wanted}")
    return tally.result()


def _counts(covers: list[Cover], real: RealMap) -> tuple[int, int]:
    """Return how many cells the boxes cover, and how many if touching counts."""
    cells = layer(covers, real)
    return int(np.count_nonzero(cells == SURE)), int(np.count_nonzero(cells))


def _free_count(real: RealMap, parameters: Parameters) -> int:
    is_free = (real.cells >= 0) & (real.cells <= parameters.world.free_threshold)
    return int(np.count_nonzero(is_free))


def check_neighbours(record: Record) -> CheckResult:
    """No two boxes overlap, in the plane and in height."""
    tally = Tally("overlaps of artefacts", "pair")
    last: Scene | None = None
    found: list[str] = []
    for scene in record.scenes:
        tally.look(len(scene.ids) * (len(scene.ids) - 1) // 2)
        if not scene.is_like(last):
            found = [
                f"ids {scene.ids[i]} and {scene.ids[j]} overlap by {depth_m:.6f} m"
                for i, j, depth_m in overlapping(scene)
            ]
        for text in found:
            tally.fail(f"{at_s(scene.stamp_ns)} {text}")
        last = scene
    return tally.result()
