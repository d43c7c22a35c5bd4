"""A made-up room for the tests of the judge: a laser, walls, boxes that move; by formulas only.

The laser stands at 0, 0 and looks along +x into a room whose far wall is the plane x = 6. Boxes are
cubes of a metre, so the beams that meet the near face of one at x end at x / cos. Box 1 goes
along +x at 1 m/s and is at x = 3 (its near face at 2.5) at second 1; box 2 stands at x = 5, off to
the left. Scans come at odd times between the ticks.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from tests.oracles.lattices import Lattice
from tests.oracles.recorded import Frames, Outputs, Scan, Tick

FIRST, STEP, BEAMS = -0.6, 0.01, 121
TURNS = FIRST + STEP * np.arange(BEAMS)
WALL_M, RANGE_M = 6.0, 20.0
TICK_NS = 50_000_000
STAMPS_NS = tuple(int(1e9 + k * 130e6) for k in range(8))
BLIND = slice(55, 66)
"""Beams without a return, ahead: the first box is seen in them."""


def near_face_m(stamp_ns: int) -> float:
    """Return the x of the near face of box 1."""
    return 1.5 + 1e-9 * stamp_ns


def returns(x_m: float, low_m: float, high_m: float) -> npt.NDArray[np.float64]:
    """Return the ranges of a face at x between two y, inf beside it."""
    y = x_m * np.tan(TURNS)
    return np.where((low_m <= y) & (y <= high_m), x_m / np.cos(TURNS), np.inf)


def side_returns(y_m: float, low_m: float, high_m: float) -> npt.NDArray[np.float64]:
    """Return the ranges of a face at y, to the left, between two x, inf beside it."""
    with np.errstate(divide="ignore"):
        x = y_m / np.tan(TURNS)
        return np.where((low_m <= x) & (x <= high_m), y_m / np.sin(TURNS), np.inf)


def real_ranges() -> npt.NDArray[np.float32]:
    """Return what the laser measures: the wall, and nothing in the blind beams."""
    ranges = np.asarray(WALL_M / np.cos(TURNS), dtype=np.float32)
    ranges[BLIND] = np.inf
    return ranges


def virtual_ranges(stamp_ns: int) -> npt.NDArray[np.float32]:
    """Return the same with the two boxes in it."""
    first = returns(near_face_m(stamp_ns), -0.5, 0.5)
    boxes = np.minimum(first, np.minimum(returns(4.5, 1.0, 2.0), side_returns(1.0, 4.5, 5.5)))
    return np.asarray(np.minimum(boxes, real_ranges()), dtype=np.float32)


def scan(stamp_ns: int, ranges: npt.NDArray[np.float32]) -> Scan:
    """Return a scan of these ranges."""
    message = SimpleNamespace(
        header=SimpleNamespace(frame_id="laser"),
        angle_min=FIRST,
        angle_max=FIRST + STEP * (BEAMS - 1),
        angle_increment=STEP,
        time_increment=0.0,
        scan_time=0.1,
        range_min=0.1,
        range_max=RANGE_M,
        ranges=ranges,
        intensities=(),
    )
    return Scan(stamp_ns, stamp_ns, message, ranges)


def real_scans() -> list[Scan]:
    """Return the real scans."""
    return [scan(stamp_ns, real_ranges()) for stamp_ns in STAMPS_NS]


def kind() -> Any:
    """Return what is said of a cube of a metre."""
    return SimpleNamespace(
        row=0,
        box_centre=SimpleNamespace(x=0.0, y=0.0, z=0.0),
        size=SimpleNamespace(x=1.0, y=1.0, z=1.0),
    )


def outputs(late_by_ns: int = 0) -> Outputs:
    """Return an honest run; ticks every 50 ms from 0 to 3 s, the poses late by some time."""
    ticks = [
        Tick(
            stamp_ns,
            {
                1: np.array((near_face_m(stamp_ns - late_by_ns) + 0.5, 0.0, 0.5, 0.0)),
                2: np.array((5.0, 1.5, 0.5, 0.0)),
            },
            {1: np.array((1.0, 0.0, 0.0)), 2: np.zeros(3)},
        )
        for stamp_ns in range(0, 3_000_000_000, TICK_NS)
    ]
    scans = [scan(stamp_ns, virtual_ranges(stamp_ns)) for stamp_ns in STAMPS_NS]
    return Outputs(ticks=ticks, scans={"/ar_builder/scan": scans}, kinds={1: kind(), 2: kind()})


def frames() -> Frames:
    """Return the laser's pose: on the map's origin, 0.2 m up."""
    tree = Frames()
    pose = (Rotation.identity().as_matrix(), np.array((0.0, 0.0, 0.2)))
    tree.add_static("map", "laser", pose)
    return tree


def room(wall_m: float = WALL_M) -> Lattice:
    """Return the wall, in cells of 5 cm."""
    solid = np.zeros((200, 400, 1), dtype=np.bool_)
    solid[round((wall_m + 1.0) / 0.05)] = True
    return Lattice(solid, np.array((-1.0, -10.0, 0.0)), np.array((0.05, 0.05, 2.5)))
