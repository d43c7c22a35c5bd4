"""The real surface as a lattice of solid cells, for the judge of scans; by the oracle."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml
from PIL import Image

from are_ros.checks.oracle.solids import Walls

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Lattice:
    """Solid cells (X, Y, Z) of a size (3,) from a low corner (3,), in the map's frame [m]."""

    solid: npt.NDArray[np.bool_]
    corner: Floats
    size: Floats

    @property
    def slack_m(self) -> float:
        """The diagonal of a cell, on the floor for walls that are one cell high."""
        axes = 2 if self.solid.shape[2] == 1 else 3
        return float(np.linalg.norm(self.size[:axes]))

    @cached_property
    def _walls(self) -> Walls:
        return Walls(self.corner, 0.0, self.size, np.argwhere(self.solid))

    def first_solid(self, origins: Floats, ways: Floats, reach: Floats) -> Floats:
        """Return how far rays (N, 3) go until they enter a solid cell, inf beyond `reach` (N,)."""
        return self._walls.first_solid(origins, ways, reach)


def of_map_file(path: Path, wall_height_m: float = 2.5) -> Lattice:
    """Return the walls of a map_server's map: occupied cells, extruded from the floor."""
    said = yaml.safe_load(path.read_text())
    if said["origin"][2] != 0:
        raise AssertionError(f"{path}: the judge takes no turned map")
    grey = np.asarray(Image.open(path.parent / said["image"]).convert("L"), dtype=np.float64)
    darkness = grey / 255.0 if said["negate"] else (255.0 - grey) / 255.0
    occupied = np.flipud(darkness > said["occupied_thresh"]).T
    size = float(said["resolution"])
    corner = np.array((said["origin"][0], said["origin"][1], 0.0), dtype=np.float64)
    return Lattice(np.ascontiguousarray(occupied[:, :, None]), corner, _cell(size, wall_height_m))


def of_grid(message: Any, wall_height_m: float = 2.5) -> Lattice:
    """Return the walls of an OccupancyGrid message."""
    info = message.info
    if abs(info.origin.orientation.z) > 1e-12:
        raise AssertionError("the judge takes no turned map")
    cells = np.asarray(message.data, dtype=np.int8).reshape(info.height, info.width)
    corner = np.array((info.origin.position.x, info.origin.position.y, 0.0))
    solid = np.ascontiguousarray((cells >= 65).T[:, :, None])
    return Lattice(solid, corner, _cell(float(info.resolution), wall_height_m))


def of_cloud(message: Any) -> Lattice:
    """Return the voxels of a cloud of their centres, in the map's frame; x, y, z are float32."""
    offsets = {one.name: one.offset for one in message.fields}
    rows = np.asarray(message.data, dtype=np.uint8).reshape(-1, message.point_step)
    columns = [rows[:, offsets[axis] : offsets[axis] + 4].copy() for axis in "xyz"]
    centres = np.concatenate([one.view(np.float32) for one in columns], axis=1).astype(np.float64)
    steps = np.diff(np.unique(np.round(centres[:, 0], 4)))
    size = float(np.median(steps[steps > 1e-3]))
    low = centres.min(axis=0)
    cells = np.rint((centres - low) / size).astype(np.int64)
    solid = np.zeros(cells.max(axis=0) + 1, dtype=np.bool_)
    solid[tuple(cells.T)] = True
    return Lattice(solid, low - 0.5 * size, np.full(3, size))


def of_octomap_file(path: Path) -> Lattice:
    """Return the occupied voxels of an OctoMap .bt file."""
    content = path.read_bytes()
    begin = content.index(b"\ndata\n") + len(b"\ndata\n")
    lines = content[:begin].decode().splitlines()
    size = next(float(line.split()[1]) for line in lines if line.startswith("res "))
    leaves = _leaves(content, begin)
    low = leaves[:, :3].min(axis=0)
    solid = np.zeros((leaves[:, :3] + leaves[:, 3:]).max(axis=0) - low, dtype=np.bool_)
    one = leaves[:, 3] == 1
    solid[tuple((leaves[one, :3] - low).T)] = True
    for x, y, z, edge in leaves[~one] - (*low, 0):
        solid[x : x + edge, y : y + edge, z : z + edge] = True
    return Lattice(solid, (low - 32768) * size, np.full(3, size))


def _leaves(content: bytes, begin: int) -> npt.NDArray[np.int64]:
    """Return the occupied leaves of a tree in its order of writing: low corner and edge (N, 4)."""
    found = []
    at, stack = begin, [(0, 0, 0, 1 << 16)]
    while stack:
        x, y, z, edge = stack.pop()
        bits = int.from_bytes(content[at : at + 2], "little")
        at, half, inner = at + 2, edge // 2, []
        for child in range(8):
            kind = (bits >> (2 * child)) & 3
            corner = (x + half * (child & 1), y + half * (child >> 1 & 1), z + half * (child >> 2))
            if kind == 2:
                found.append((*corner, half))
            elif kind == 3:
                inner.append((*corner, half))
        stack.extend(reversed(inner))
    return np.array(found, dtype=np.int64)


def _cell(size_m: float, height_m: float) -> Floats:
    return np.array((size_m, size_m, height_m))
