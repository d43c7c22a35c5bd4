"""Zones: polygons of a YAML file (to arrive in, to keep out of, ways in, ways out), as cells."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import ParameterError
from are_ros.world._planar import cosine_and_sine
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.yaml_text import read_yaml

_LISTS_OF_ZONES: Final = ("zones", "entrances", "exits")
_FILE_FIELDS: Final = frozenset({*_LISTS_OF_ZONES, "no_spawn"})
_ZONE_FIELDS: Final = frozenset({"name", "polygon", "weight"})


@dataclass(frozen=True, eq=False)
class Zone:
    """A polygon where artefacts arrive `weight` (> 0) times as densely as where the weight is 1.

    `polygon_m` is float64 (K >= 3, 2) in the map frame [m], closed by itself, even-odd inside.
    """

    name: str
    polygon_m: npt.NDArray[np.float64]
    weight: float = 1.0


@dataclass(frozen=True, eq=False)
class Zones:
    """The content of a zones file: where artefacts may arrive, never do, come in and go out.

    Where zones overlap their weights add. `no_spawn` holds polygons as in `Zone`; the weight of
    an exit means nothing.
    """

    zones: tuple[Zone, ...] = ()
    no_spawn: tuple[npt.NDArray[np.float64], ...] = ()
    entrances: tuple[Zone, ...] = ()
    exits: tuple[Zone, ...] = ()

    @property
    def ways_in(self) -> tuple[Zone, ...]:
        """The entrances; where none is marked, the zones."""
        return self.entrances or self.zones

    @property
    def ways_out(self) -> tuple[Zone, ...]:
        """The exits; where none is marked, the entrances."""
        return self.exits or self.entrances


def read_zones_file(path: Path) -> Zones:
    """Read `zones: [{name, polygon: [[x, y], ...], weight}]` and `no_spawn: [[[x, y], ...]]`.

    `entrances` and `exits` are lists as `zones` is. Each list may be left out; `name` defaults to
    "zone N" ("entrance N", "exit N"), `weight` to 1. Raises `ParameterError` that names file,
    field and reason.
    """
    content = _yaml_mapping(path)
    _refuse_unknown(content, _FILE_FIELDS, str(path))
    zones, entrances, exits = (_zones(content, field, path) for field in _LISTS_OF_ZONES)
    no_spawn = [
        _polygon(entry, f"{path}: no_spawn[{number}]")
        for number, entry in enumerate(_list_of(content, "no_spawn", path))
    ]
    return Zones(zones, tuple(no_spawn), entrances, exits)


def zone_weights(zones: Sequence[Zone], grid: OccupancyGrid) -> npt.NDArray[np.float32]:
    """Return float32 (height, width): the sum of the weights of the zones over each cell."""
    weights = np.zeros((grid.height, grid.width), np.float32)
    for zone in zones:
        weights[polygon_mask(zone.polygon_m, grid)] += zone.weight
    return weights


def polygon_mask(polygon_m: npt.NDArray[np.float64], grid: OccupancyGrid) -> npt.NDArray[np.bool_]:
    """Return bool (height, width): the cells whose centres lie in the polygon (map frame).

    Low edges are inside, high edges are not, so polygons that share an edge share no cell.
    """
    corners = _in_cells(polygon_m, grid)
    toggles = np.zeros((grid.height, grid.width + 1), np.bool_)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        _toggle_right_of_edge(toggles, start, end)
    return np.logical_xor.accumulate(toggles, axis=1)[:, :-1]


def _in_cells(polygon_m: npt.NDArray[np.float64], grid: OccupancyGrid) -> npt.NDArray[np.float64]:
    """Return the corners as (x, y) in cells, so that cell (row, col) is centred at (col, row)."""
    cosine, sine = cosine_and_sine(grid.origin.rotation_xyzw)
    offset = polygon_m - grid.origin.translation_m[:2]
    x = offset[:, 0] * cosine + offset[:, 1] * sine
    y = offset[:, 1] * cosine - offset[:, 0] * sine
    return np.column_stack((x, y)) / grid.resolution_m - 0.5


def _toggle_right_of_edge(
    toggles: npt.NDArray[np.bool_],
    start: npt.NDArray[np.float64],
    end: npt.NDArray[np.float64],
) -> None:
    """Flip, in each row whose centre line the edge crosses, the first cell right of it."""
    height, width = toggles.shape
    low, high = (start, end) if start[1] <= end[1] else (end, start)
    first, last = np.clip(np.ceil((low[1], high[1])), 0, height)
    rows = np.arange(int(first), int(last))
    if rows.size:
        x = low[0] + (rows - low[1]) * (high[0] - low[0]) / (high[1] - low[1])
        toggles[rows, np.clip(np.ceil(x), 0, width - 1).astype(np.int64)] ^= True


def _yaml_mapping(path: Path) -> Mapping[str, Any]:
    content = read_yaml(path, f"{path}: the zones file", ParameterError)
    if not isinstance(content, dict):
        names = ", ".join(sorted(_FILE_FIELDS))
        raise ParameterError(f"{path}: the file must map some of {names} to lists")
    return content


def _list_of(content: Mapping[str, Any], field: str, path: Path) -> list[Any]:
    entries = content.get(field)
    if entries is None:
        return []
    if not isinstance(entries, list):
        raise ParameterError(f"{path}: {field} is no list")
    return entries


def _refuse_unknown(content: Mapping[Any, Any], known: frozenset[str], where: str) -> None:
    unknown = sorted(str(name) for name in content if name not in known)
    if unknown:
        names = ", ".join(sorted(known))
        raise ParameterError(f"{where}: {unknown[0]} is no field of it; these are: {names}")


def _zones(content: Mapping[str, Any], field: str, path: Path) -> tuple[Zone, ...]:
    """Return the zones of one list; those without a name take the list's, in the singular."""
    entries = enumerate(_list_of(content, field, path))
    singular = field.removesuffix("s")
    return tuple(
        _zone(entry, f"{path}: {field}[{number}]", f"{singular} {number}")
        for number, entry in entries
    )


def _zone(entry: Any, where: str, default_name: str) -> Zone:
    if not isinstance(entry, dict):
        raise ParameterError(f"{where} is no mapping of name, polygon and weight")
    _refuse_unknown(entry, _ZONE_FIELDS, where)
    name = entry.get("name", default_name)
    if not isinstance(name, str):
        raise ParameterError(f"{where}.name is {name!r}, not a text")
    weight = entry.get("weight", 1.0)
    if not (_is_number(weight) and weight > 0.0):
        raise ParameterError(f"{where}.weight is {weight!r}, not a finite number above 0")
    return Zone(name, _polygon(entry.get("polygon"), f"{where}.polygon"), float(weight))


def _polygon(corners: Any, where: str) -> npt.NDArray[np.float64]:
    if not isinstance(corners, list) or len(corners) < 3:
        raise ParameterError(f"{where} is no list of at least three corners [x, y]")
    for number, corner in enumerate(corners):
        if not (isinstance(corner, list) and len(corner) == 2 and all(map(_is_number, corner))):
            raise ParameterError(f"{where}[{number}] is {corner!r}, not two finite numbers [x, y]")
    polygon_m = np.array(corners, dtype=np.float64)
    polygon_m.flags.writeable = False
    return polygon_m


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
