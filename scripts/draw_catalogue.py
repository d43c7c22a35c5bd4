"""Draws docs/images/catalogue.png: `python scripts/draw_catalogue.py`, all types that ARE ships.

Every row of the shipped catalogue and of the presets with robots of their own is painted as an
artefact of an id of its own, seen obliquely from 2 to 12 m, as the painter shows it to a camera.
With labels (`python scripts/draw_catalogue.py --out FILE robot_disc car_van ...`), only these. So
is docs/images/persons.png made, with the labels of persons: `--together --turn 200 --width 117`.
"""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.builder.rendering.painter import Lighting, PaintedBody, Painter
from are_ros.builder.rendering.surface import SurfaceBank
from are_ros.population.catalogue import CatalogueRow
from are_ros.world.cameras import FORWARD_FROM_OPTICAL, PinholeView
from are_ros.world.rigid_transform import RigidTransform

_BESIDE_M = 0.66
_PRESETS = [Path("config/presets/warehouse_catalogue.yaml")]


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("labels", nargs="*")
    parser.add_argument("--out", type=Path, default=Path("docs/images/catalogue.png"))
    parser.add_argument("--width", type=int, default=150, help="of one picture [px]")
    parser.add_argument("--columns", type=int, default=8)
    parser.add_argument("--together", action="store_true", help="on one floor, without labels")
    parser.add_argument("--turn", type=float, default=145.0, help="degrees, 180 is head-on")
    parser.add_argument("--distance", type=float, help="metres; as much as it needs by default")
    arguments = parser.parse_args()
    rows = list(read_catalogue().rows)
    rows += [row for preset in _PRESETS for row in read_catalogue(preset).rows]
    known = list({row.label: row for row in rows}.values())
    if arguments.labels:
        known = [row for label in arguments.labels for row in known if row.label == label]
    if arguments.together:
        sheet = _together(known, arguments.width, math.radians(arguments.turn))
    else:
        sheet = _sheet(known, arguments)
    sheet.quantize(256, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).save(
        arguments.out, optimize=True
    )


def _sheet(rows: Sequence[CatalogueRow], arguments: argparse.Namespace) -> Image.Image:
    """Return the pictures of all rows, in columns."""
    width, columns = arguments.width, arguments.columns
    height = width * 3 // 4
    tiles = [
        _picture(row, number, (width, height), math.radians(arguments.turn), arguments.distance)
        for number, row in enumerate(rows)
    ]
    sheet = Image.new("RGB", (columns * width, -(-len(tiles) // columns) * height), "white")
    for number, tile in enumerate(tiles):
        sheet.paste(tile, (number % columns * width, number // columns * height))
    return sheet


def _together(rows: Sequence[CatalogueRow], width_each: int, yaw_rad: float) -> Image.Image:
    """Return one picture of all rows side by side on one floor, `_BESIDE_M` apart."""
    width, away_m, eye_m = width_each * len(rows), 1.2 * _BESIDE_M * len(rows), 1.3
    height = 2 * width // 5
    view = PinholeView(width, height, 1.15 * width, 1.15 * width, 0.5 * width, 0.4 * height)
    placed = [
        (row, RigidTransform.planar(away_m, (0.5 * (len(rows) - 1) - k) * _BESIDE_M, yaw_rad))
        for k, row in enumerate(rows)
    ]
    return _painted(placed, view, eye_m, 0.0)


def _picture(
    row: CatalogueRow,
    artefact_id: int,
    size_px: tuple[int, int],
    yaw_rad: float,
    distance_m: float | None,
) -> Image.Image:
    """Return the picture of one artefact, with its label."""
    width, height = size_px
    focal = 1.4 * width
    half = 0.5 * np.array(row.size_m)
    reach = max(0.75 * math.hypot(half[0], half[1]) + 0.15, half[2] * 1.5)
    away = distance_m or max(2.8 * reach + 0.5 * half[0], 1.2)
    eye_m = max(1.1, 1.1 * half[2])
    view = PinholeView(width, height, focal, focal, 0.5 * width, 0.5 * height)
    pitch_rad = math.atan2(eye_m - half[2], away)
    placed = [(row, RigidTransform.planar(away, 0.0, yaw_rad))]
    picture = _painted(placed, view, eye_m, pitch_rad, artefact_id)
    ImageDraw.Draw(picture).text((4, 2), row.label, fill=(40, 40, 40))
    return picture


def _painted(
    placed: Sequence[tuple[CatalogueRow, RigidTransform]],
    view: PinholeView,
    eye_m: float,
    pitch_rad: float,
    first_id: int = 0,
) -> Image.Image:
    """Return a picture of artefacts on a floor, from the height of an eye above its origin."""
    camera = (
        RigidTransform.from_xyz_ypr(0.0, 0.0, eye_m, 0.0, pitch_rad, 0.0) @ FORWARD_FROM_OPTICAL
    )
    bank, bodies = SurfaceBank(1), []
    for number, (row, pose) in enumerate(placed, first_id):
        half = 0.5 * np.array(row.size_m)
        upright = RigidTransform.from_xyz_ypr(0.0, 0.0, float(half[2]), 0.0, 0.0, 0.0)
        bodies.append(PaintedBody(bank.of(row, number), pose @ upright, half, 0.0))
    rays = view.directions() @ camera.rotation_matrix().T.astype(np.float32)
    floor_m = np.where(rays[:, :, 2] < -1e-3, eye_m / np.maximum(-rays[:, :, 2], 1e-3), np.inf)
    is_floor = (rays[:, :, 2] < -0.02)[:, :, np.newaxis]
    empty = np.where(is_floor, (176, 177, 178), (204, 206, 208)).astype(np.uint8)
    light = Lighting(is_estimated=False, brightness=1.0, azimuth_rad=3.9, noise=0.0, blur_px=0.4)
    painting = Painter(view).paint(
        empty, camera, bodies, floor_m.astype(np.float32), light, np.random.default_rng(0)
    )
    return Image.fromarray(empty if painting.pixels is None else painting.pixels)


if __name__ == "__main__":
    main()
