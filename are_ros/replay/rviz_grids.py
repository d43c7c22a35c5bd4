"""The Map display of rviz: a whole grid, then patches of it; and the two palettes."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import InputError
from are_ros.messages.grid import read_grid
from are_ros.world.occupancy_grid import OccupancyGrid

Palette = npt.NDArray[np.uint8]

MAP_ALPHA: Final = 0.7
"""What rviz gives to a Map display unless told otherwise."""


@dataclass
class MapDisplay:
    """Takes grids and updates in the order of their reception.

    An update that comes before any grid is left out; one that reaches beyond is a complaint.
    """

    complaint: str = ""
    _grid: OccupancyGrid | None = None
    _cells: npt.NDArray[np.int8] | None = None

    def take_grid(self, message: Any) -> None:
        """Take a nav_msgs/OccupancyGrid; a malformed one leaves the old one."""
        try:
            self._grid = read_grid(message)
        except InputError as error:
            self.complaint = str(error)
            return
        self._cells, self.complaint = self._grid.cells.copy(), ""

    def take_update(self, message: Any) -> None:
        """Take a map_msgs/OccupancyGridUpdate."""
        if self._cells is None:
            return
        height, width = int(message.height), int(message.width)
        row, col = int(message.y), int(message.x)
        data = np.asarray(message.data, dtype=np.int8)
        rows, cols = self._cells.shape
        fits = 0 <= row <= rows - height and 0 <= col <= cols - width
        if not fits or data.size != height * width:
            self.complaint = "an update reaches beyond the map"
            return
        self._cells[row : row + height, col : col + width] = data.reshape(height, width)

    @property
    def grid(self) -> OccupancyGrid | None:
        """The grid as it is now, None before the first one."""
        if self._grid is None or self._cells is None:
            return None
        known = self._grid
        return OccupancyGrid(
            self._cells, known.resolution_m, known.origin, known.frame_id, known.stamp_ns
        )


def map_palette() -> Palette:
    """Return red, green, blue and alpha (256, 4) of each value, as unsigned, in scheme "map"."""
    palette = _common_palette()
    values = 255 - (255 * np.arange(101)) // 100
    palette[:101] = np.column_stack((values, values, values, np.full(101, 255)))
    return palette


def costmap_palette() -> Palette:
    """Return red, green, blue and alpha (256, 4) of each value, as unsigned, in "costmap".

    Free is clear; then blue to red, 99 (inscribed) cyan and 100 (lethal) purple.
    """
    palette = _common_palette()
    values = (255 * np.arange(1, 99)) // 100
    opaque = np.full(98, 255)
    palette[0] = (0, 0, 0, 0)
    palette[1:99] = np.column_stack((values, 0 * values, 255 - values, opaque))
    palette[99], palette[100] = (0, 255, 255, 255), (255, 0, 255, 255)
    return palette


def _common_palette() -> Palette:
    """Return the colours of what is no cost: green above 100, red to yellow below -1, -1 grey."""
    palette = np.zeros((256, 4), dtype=np.uint8)
    palette[101:128] = (0, 255, 0, 255)
    shades = (255 * np.arange(127)) // 126
    palette[128:255] = np.column_stack((np.full(127, 255), shades, 0 * shades, np.full(127, 255)))
    palette[255] = (0x70, 0x89, 0x86, 255)
    return palette
