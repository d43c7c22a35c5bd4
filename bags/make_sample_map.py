"""Writes the map of a recording for map_server: `python bags/make_sample_map.py`.

It makes sample_office_map.yaml and the image beside it, from sample_office.mcap.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from are_ros.bag.reader import BagReader
from are_ros.conventions import FREE, OCCUPIED
from are_ros.messages.maps import read_grid
from are_ros.world.occupancy_grid import OccupancyGrid

HERE = Path(__file__).parent
SAMPLE, SAMPLE_MAP = HERE / "sample_office.mcap", HERE / "sample_office_map.yaml"
OCCUPIED_GREY, UNKNOWN_GREY, FREE_GREY = 0, 205, 254
"""The shades of map_saver."""

YAML = """\
image: {image}
mode: trinary
resolution: {resolution_m:.7g}
origin: [{x_m:.7g}, {y_m:.7g}, {yaw_rad:.7g}]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


def main() -> None:
    """Write the map and say what it is."""
    arguments = _parsed_arguments()
    grid = recorded_map(arguments.bag)
    write_map(grid, arguments.out)
    sides_m = [round(side * grid.resolution_m, 3) for side in (grid.width, grid.height)]
    print(f"{arguments.out}: {grid.width} x {grid.height} cells, {sides_m[0]} m x {sides_m[1]} m")


def recorded_map(bag: Path, topic: str = "/map") -> OccupancyGrid:
    """Return the first map of a recording."""
    with BagReader([bag]) as reader:
        message = next(reader.messages((topic,)), None)
        if message is None:
            raise SystemExit(f"{bag}: there is no map on {topic}")
        return read_grid(reader.deserialize(message))


def write_map(grid: OccupancyGrid, path: Path) -> None:
    """Write a YAML file and a PNG of the same name: occupied, free and unknown cells."""
    image = path.with_suffix(".png")
    x_m, y_m, _ = grid.origin.translation_m.tolist()
    ok, data = cv2.imencode(".png", _shades(grid.cells), (cv2.IMWRITE_PNG_COMPRESSION, 9))
    if not ok:
        raise SystemExit(f"{image}: OpenCV cannot write it")
    image.write_bytes(data.tobytes())
    fields = {"image": image.name, "resolution_m": grid.resolution_m, "x_m": x_m, "y_m": y_m}
    path.write_text(YAML.format(**fields, yaw_rad=grid.origin.yaw_rad()), encoding="utf-8")


def _shades(cells: npt.NDArray[np.int8]) -> npt.NDArray[np.uint8]:
    """Return the image, its upper row the last of the grid."""
    shades = np.full(cells.shape, UNKNOWN_GREY, dtype=np.uint8)
    shades[cells == FREE] = FREE_GREY
    shades[cells == OCCUPIED] = OCCUPIED_GREY
    return np.flipud(shades)


def _parsed_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bag", type=Path, default=SAMPLE, help="the recording")
    parser.add_argument("--out", type=Path, default=SAMPLE_MAP, help="the YAML file to write")
    return parser.parse_args()


if __name__ == "__main__":
    main()
