"""Draws the picture of docs/planners.md: `python scripts/draw_manoeuvres.py [--out docs/images]`.

How a car turns round: in the open, in two aisles, and out of a slot in a car park.
"""

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from are_ros.agents.body import Body, MotionCommand
from are_ros.agents.local_planner.planner import LocalPlanner
from are_ros.agents.table import AgentTable
from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.conventions import FREE, OCCUPIED
from are_ros.draw.palette import BAR, END, LAW, ROBOT, WALL, WHITE, hex_of
from are_ros.draw.plots import name_axes, written_figure
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform

PROJECT: Final = Path(__file__).resolve().parents[1]
LABEL: Final = "car_compact_green"
CELL_M, STEP_S, LONGEST_S = 0.05, 0.05, 40.0
EVERY_M: Final = 0.9
"""The way from one outline to the next."""

Box = tuple[float, float, float, float]
"""x0, y0, x1, y1 [m]."""
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """A place with walls, where the car stands in it, and where its way goes on."""

    title: str
    size_m: tuple[float, float]
    start: tuple[float, float, float]
    goal_m: tuple[float, float]
    shown: Box
    walls: tuple[Box, ...] = ()

    def environment(self) -> Environment:
        """Return the place with walls around it."""
        width_m, depth_m = self.size_m
        cells = np.full((round(depth_m / CELL_M), round(width_m / CELL_M)), OCCUPIED, np.int8)
        cells[2:-2, 2:-2] = FREE
        for box in self.walls:
            x0, y0, x1, y1 = (round(v / CELL_M) for v in box)
            cells[y0:y1, x0:x1] = OCCUPIED
        grid = OccupancyGrid(cells, CELL_M, RigidTransform.identity(), "map")
        world = Parameters().world
        classes = classify(grid, world.occupied_threshold, world.free_threshold)
        return Environment(grid, classes, None, PlaneGround(), world.ground_clearance)


SCENES: Final = (
    Scene("in the open", (60.0, 60.0), (30.0, 30.0, 0.0), (14.0, 30.0), (13.0, 17.8, 39.0, 32.8)),
    Scene(
        "in an aisle of 9 m", (60.0, 9.0), (30.0, 4.5, 0.0), (8.0, 4.5), (14.0, -3.0, 40.0, 12.0)
    ),
    Scene(
        "in an aisle of 8 m", (60.0, 8.0), (30.0, 4.0, 0.0), (8.0, 4.0), (14.0, -3.5, 40.0, 11.5)
    ),
    Scene(
        "out of a slot",
        (34.0, 24.0),
        (14.4, 20.5, 0.5 * math.pi),
        (30.0, 6.0),
        (4.0, 8.5, 30.0, 23.5),
        ((0.0, 16.0, 13.0, 24.0), (15.8, 16.0, 34.0, 24.0)),
    ),
)


def drive(scene: Scene, car: Artefact, body: Body) -> Floats:
    """Return x, y, yaw and the signed speed float64 (K, 4) of a car until it is near its goal."""
    table = AgentTable(STEP_S)
    planner, environment = LocalPlanner(table), scene.environment()
    table.add(car, body)
    planner.give_commands([0], [MotionCommand(scene.goal_m, 2.0, stop_there=False)])
    track = [planner.motion[0]]
    for index in range(round(LONGEST_S / STEP_S)):
        planner.step(index, environment, None)
        track.append(planner.motion[0])
        if math.dist(track[-1][:2], scene.goal_m) < body.turn_radius_m:
            break
    return np.array(track)[:, [0, 1, 2, 5]]


def outlines(track: Floats, body: Body) -> Iterator[tuple[Floats, bool]]:
    """Yield the corners (4, 2) of the body every so often, and whether it drives in reverse."""
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    corners = signs * body.half_size_m + np.array(body.centre_m)
    way_m, gear = EVERY_M, 0
    for k in range(1, len(track)):
        x, y, yaw, speed = track[k]
        way_m += math.dist(track[k, :2], track[k - 1, :2])
        if way_m < EVERY_M and int(np.sign(speed)) in {gear, 0}:
            continue
        way_m, gear = 0.0, int(np.sign(speed))
        cos, sin = math.cos(yaw), math.sin(yaw)
        turned = corners @ np.array(((cos, sin), (-sin, cos)))
        yield turned + np.array((x, y)), speed < 0.0


def draw(axes: Any, scene: Scene, track: Floats, body: Body) -> None:
    """Draw the walls, the outlines of the car, and the way of its middle."""
    name_axes(axes, scene.title)
    x0, y0, x1, y1 = scene.shown
    axes.set(xlim=(x0, x1), ylim=(y0, y1), aspect="equal", xticks=[], yticks=[])
    width_m, depth_m = scene.size_m
    axes.set_facecolor(hex_of(BAR))
    for (left, low, right, high), shade in [
        ((0.1, 0.1, width_m - 0.1, depth_m - 0.1), WHITE),
        *((box, BAR) for box in scene.walls),
    ]:
        across, up = (left, right, right, left), (low, low, high, high)
        axes.fill(across, up, facecolor=hex_of(shade), linewidth=0.0)
    for corners, is_back in outlines(track, body):
        colour = hex_of(LAW if is_back else ROBOT)
        axes.fill(*corners.T, facecolor=colour, edgecolor=colour, alpha=0.12, linewidth=0.0)
        axes.fill(*corners.T, fill=False, edgecolor=colour, linewidth=0.6)
    axes.plot(*track[:, :2].T, color=hex_of(END), linewidth=1.2)
    x, y, yaw, _ = track[0]
    ahead = {"arrowstyle": "-|>", "color": hex_of(WALL), "linewidth": 1.2}
    axes.annotate("", (x + 2.6 * math.cos(yaw), y + 2.6 * math.sin(yaw)), (x, y), arrowprops=ahead)


def main() -> None:
    """Draw all scenes."""
    parser = argparse.ArgumentParser(description="Draw the picture of docs/planners.md.")
    parser.add_argument("--out", type=Path, default=PROJECT / "docs" / "images")
    row = next(one for one in read_catalogue().rows if one.label == LABEL)
    body = Body.of(row)
    path = parser.parse_args().out / "manoeuvres.png"
    with written_figure(path, (9.0, 5.7)) as figure:
        for k, scene in enumerate(SCENES):
            x_m, y_m, yaw_rad = scene.start
            pose = GroundPose(x_m, y_m, 0.0, yaw_rad)
            car = Artefact(1, row, Origin.RANDOM, 0, PoseHistory(0, pose))
            axes = figure.add_subplot(2, 2, k + 1)
            draw(axes, scene, drive(scene, car, body), body)
        figure.subplots_adjust(0.01, 0.01, 0.99, 0.95, 0.03, 0.12)
    with Image.open(path) as picture:
        picture.convert("RGB").quantize(64, dither=Image.Dither.NONE).save(path, optimize=True)


if __name__ == "__main__":
    main()
