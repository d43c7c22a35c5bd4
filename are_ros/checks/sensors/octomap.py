"""The augmented octomap computed anew: which voxels the surfaces of artefacts meet.

Shares no code with what it judges: each triangle is cut into slices of the lattice along x, each
slice along y, and what is left spans voxels along z.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.grids import admitted_by_tick
from are_ros.checks.oracle.solids import Cloud, Walls
from are_ros.checks.record import Record
from are_ros.checks.result import CheckResult, Tally, at_s, skipped
from are_ros.checks.sensors.scans import KnownWalls, bodies_of, box_in
from are_ros.parameters.choices import CostmapGate

Floats = NDArray[np.float64]
Voxel = tuple[int, int, int]

_EDGE: Final = 1e-4
"""Of a voxel: what meets it by less may be missed by either."""


def check_octomap(record: Record) -> CheckResult:
    """Octomaps are M3D with all voxels that surfaces of artefacts meet, and no others."""
    tally, settings = Tally("octomap computed anew", "voxel"), record.settings
    walls = KnownWalls(record)
    if walls.doubt or record.walls != "octomap":
        return skipped(tally.name, walls.doubt or "the walls are those of the map")
    if settings.certainty.enabled and settings.costmap.gate is CostmapGate.PERCEIVED:
        return skipped(tally.name, "it shows artefacts where they are perceived (certainty)")
    shown = {tick.scene.stamp_ns: tick for tick in admitted_by_tick(record, settings.costmap)}
    for cloud in record.octomaps.kept:
        tick, real = shown.get(cloud.since_ns), walls.at(cloud.since_ns)
        if tick is None or real is None or not tick.is_sure:
            tally.leave_out("octomap", "for which it is not known exactly what was where")
            continue
        rows = (i for i, number in enumerate(tick.scene.ids.tolist()) if number in tick.ids)
        bodies = bodies_of(record, [box_in(tick.scene, i) for i in rows])
        if bodies is None:
            tally.leave_out("octomap", "without markers that are meshes")
            continue
        fault = _fault(tally, cloud, real, bodies)
        if fault:
            tally.fail(f"{at_s(cloud.since_ns)} {fault}")
    return tally.result()


def _fault(tally: Tally, cloud: Cloud, real: Walls, bodies: list[Floats]) -> str:
    """Return what is wrong with an octomap, empty if nothing is."""
    places = (cloud.centres_m - real.corner_m) / real.size_m - 0.5
    voxels = np.rint(places).astype(np.int64)
    if np.abs(places - voxels).max(initial=0.0) > 0.01:
        return "has a point that is no centre of a voxel"
    found = set(map(_voxel, voxels.tolist()))
    if len(found) != len(voxels):
        return "has a voxel twice"
    sure = set(map(_voxel, real.solid.tolist()))
    known = sure.copy()
    for body in bodies:
        triangles = (body - real.corner_m) / real.size_m
        sure |= met_voxels(triangles, -_EDGE)
        known |= met_voxels(triangles, _EDGE)
    tally.look(len(known))
    missing, wrong = sure - found, found - known
    if missing:
        return f"lacks {len(missing)} voxels of {len(sure)}, as {min(missing)}"
    return f"has {len(wrong)} voxels that nothing occupies, as {min(wrong)}" if wrong else ""


def _voxel(indices: list[int]) -> Voxel:
    x, y, z = indices
    return x, y, z


def met_voxels(triangles: Floats, margin: float) -> set[Voxel]:
    """Return the unit cubes that triangles (F, 3, 3) meet, each cube larger by a margin."""
    found: set[Voxel] = set()
    for triangle in triangles:
        for x, slice_x in _slices(list(triangle), 0, margin):
            for y, piece in _slices(slice_x, 1, margin):
                heights = [corner[2] for corner in piece]
                first = math.floor(min(heights) - margin)
                last = math.floor(max(heights) + margin)
                # cubes that are smaller leave gaps, in which a piece may lie
                found.update(
                    (x, y, z)
                    for z in range(first, last + 1)
                    if max(heights) >= z - margin and min(heights) <= z + 1 + margin
                )
    return found


def _slices(polygon: list[Floats], axis: int, margin: float) -> list[tuple[int, list[Floats]]]:
    """Return what of a convex polygon lies in each [i - margin, i + 1 + margin] of an axis."""
    low = min(corner[axis] for corner in polygon)
    high = max(corner[axis] for corner in polygon)
    slices = []
    for i in range(math.floor(low - abs(margin)), math.floor(high + abs(margin)) + 1):
        above = _cut(polygon, axis, 1.0, i - margin)
        between = _cut(above, axis, -1.0, -(i + 1 + margin))
        if between:
            slices.append((i, between))
    return slices


def _cut(polygon: list[Floats], axis: int, sign: float, least: float) -> list[Floats]:
    """Return what of a convex polygon has sign * coordinate >= least."""
    kept: list[Floats] = []
    for here, there in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        ours, theirs = sign * here[axis] - least, sign * there[axis] - least
        if ours >= 0.0:
            kept.append(here)
        if ours * theirs < 0.0:
            kept.append(here + (there - here) * (ours / (ours - theirs)))
    return kept
