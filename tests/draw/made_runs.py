"""Small records of runs made by hand, for the tests of pictures and animations."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from are_ros.agents.events import ArtefactEvent, EventKind, SceneMetrics
from are_ros.conventions import NS_PER_S
from are_ros.draw.canvas import Canvas
from are_ros.draw.scene import Doing, Life, SceneRecord, TickSeries, Track
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.world.cameras import PinholeView, mounted_camera
from are_ros.world.footprint import Footprint
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

TICK_NS = NS_PER_S // 10
VIEW = PinholeView.from_field_of_view(64, 48, math.pi / 2)
Point = tuple[float, float]


def hall(side_m: float = 10.0) -> OccupancyGrid:
    """Return a walled hall from (0, 0), 0.1 m cells."""
    cells = np.full((round(10 * side_m),) * 2, 100, dtype=np.int8)
    cells[1:-1, 1:-1] = 0
    return OccupancyGrid(cells, 0.1, RigidTransform.identity(), "map")


def texts_written(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return a list that gets each text which is written on a canvas from now on."""
    texts: list[str] = []
    write = Canvas.text

    def noted(canvas: Canvas, text: str, *place: Any, **look: Any) -> Any:
        texts.append(text)
        return write(canvas, text, *place, **look)

    monkeypatch.setattr(Canvas, "text", noted)
    return texts


def walker(
    number: int,
    start: Point,
    end: Point,
    *,
    ticks: int = 100,
    seen: Sequence[int] = (),
    name: str = "person",
    behaviour: str = "walking",
    activity: str = "",
    gone: bool = False,
) -> Life:
    """Return who goes straight from one point to another, perceived in some ticks."""
    row = CatalogueRow(0, f"{name}_a", name, (0.4, 0.6, 1.8), (0.0, 0.0, 0.0), Shape.WALL)
    yaw = math.atan2(end[1] - start[1], end[0] - start[0])
    points = np.linspace(start, end, ticks)
    stamps = np.arange(1, ticks + 1, dtype=np.int64) * TICK_NS
    seen_ns = np.array([TICK_NS * (1 + tick) for tick in seen], dtype=np.int64)
    poses = np.column_stack((points, np.full(ticks, yaw)))
    return Life(
        number,
        row,
        TICK_NS,
        departure_ns=int(stamps[-1]) + 1 if gone else None,
        left_by="life_over" if gone else "",
        footprints=Track(stamps, poses),
        seen_ns=seen_ns,
        doings=(Doing(TICK_NS, behaviour, activity),),
    )


def event(kind: EventKind, tick: int, number: int) -> ArtefactEvent:
    """Return an event of an artefact."""
    return ArtefactEvent(TICK_NS * (1 + tick), kind, number, "person_a", "", 0.0)


def run(
    lives: Sequence[Life],
    *,
    way: Sequence[tuple[float, float, float]] = (),
    ticks: int = 100,
    events: Sequence[ArtefactEvent] = (),
) -> SceneRecord:
    """Return the record of so many ticks, with a robot on its way, a pose a tick."""
    stamps = np.arange(1, ticks + 1, dtype=np.int64) * TICK_NS
    zeros = np.zeros(ticks, dtype=np.int64)
    robot = Track(stamps[: len(way)].copy(), np.array(way, dtype=np.float64).reshape(-1, 3))
    count = len(lives)
    return SceneRecord(
        seed=1,
        max_range_m=6.0,
        footprint=Footprint.disc(0.25),
        robot=robot,
        camera=_camera(stamps[: len(way)].copy(), way),
        views=(VIEW,),
        view_of_pose=np.zeros(len(way), dtype=np.int64),
        lives=tuple(lives),
        events=tuple(events),
        series=TickSeries(stamps, zeros.copy(), zeros.copy(), zeros.astype(float), 0),
        metrics=SceneMetrics(count, 0, count, 0, 0, 0, 0, 1.0, 0.0),
    )


def _camera(stamps_ns: Any, way: Sequence[tuple[float, float, float]]) -> Track:
    mount = mounted_camera(VIEW, (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)).base_from_optical
    poses = [RigidTransform.planar(*pose) @ mount for pose in way]
    numbers = [(*pose.translation_m, *pose.rotation_xyzw) for pose in poses]
    return Track(stamps_ns, np.array(numbers, dtype=np.float64).reshape(-1, 7))
