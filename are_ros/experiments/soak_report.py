"""What a soak leaves behind: soak.json, and soak.png with all ways on the map."""

import json
from pathlib import Path
from typing import Final

from are_ros.errors import InputError
from are_ros.experiments.soak import SoakResult
from are_ros.experiments.soak_picture import draw_soak
from are_ros.wording import why_refused
from are_ros.world.occupancy_grid import OccupancyGrid

NUMBERS: Final = "soak.json"
PICTURE: Final = "soak.png"


def write_soak(result: SoakResult, grid: OccupancyGrid, folder: Path) -> None:
    """Write numbers and picture into a folder, made if need be; InputError where that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(result.as_json(), indent=2)
        (folder / NUMBERS).write_text(text + "\n", encoding="utf-8")
        draw_soak(result, grid, folder / PICTURE)
    except OSError as cause:
        message = f"{folder}: the results cannot be written ({why_refused(cause)})"
        raise InputError(message) from cause
